// SPDX-License-Identifier: BSD-3-Clause
#include "quellKernelFilter.h"

#include "quellGuards.h"
#include "quellPlanes.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellKernelFilter.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellKernelFilter_once
#define quellKernelFilter_once
namespace quell
{
namespace
{
constexpr int MostComponents = 4;
/// Differences beyond this count as this: 129 x 129 of them do not overflow a float.
constexpr float LargestDifference = 1e34f;
/// Of the sum of magnitudes: a sum of weights below it is none.
constexpr float LeastSum = 1e-6f;

/// One row of results: taps over the rows [low, high] and columns [-radius, radius] around the centre.
struct KernelRow
{
  int components = 0;
  const float* value[MostComponents];  ///< what is summed
  const float* centre[MostComponents]; ///< r, or null: sums without a centre
  const float* weight = nullptr;       ///< of the tap: m, or what the first pass has summed
  float* result[MostComponents];
  float* sum = nullptr;       ///< of the weights; null: not wanted
  const float* tap = nullptr; ///< in the order of the loops
  int low = 0, high = 0, radius = 0;
  std::ptrdiff_t stride = 0;
  float scale = 1;                    ///< without a normaliser
  bool normalize = true;              ///< divide by the sum of the weights
  bool squares = false;               ///< variance: squared weights
  bool first = false, second = false; ///< of two passes
};
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
/// Pixels [p, p + count) of the planes; results at [o, ...).
void KernelRowImpl(const KernelRow& k, std::ptrdiff_t p, std::ptrdiff_t o, int count)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const V most = hn::Set(d, LargestDifference), least = hn::Set(d, -LargestDifference);
  for (int i = 0; i < count; i += lanes)
  {
    V sum[MostComponents] = { zero, zero, zero, zero };
    V r[MostComponents] = { zero, zero, zero, zero };
    if (k.centre[0])
      for (int c = 0; c < k.components; ++c)
        r[c] = hn::LoadU(d, k.centre[c] + p + i);
    V sw = zero, magnitude = zero;
    const float* next = k.tap;
    for (int dy = k.low; dy <= k.high; ++dy)
      for (int dx = -k.radius; dx <= k.radius; ++dx)
      {
        const auto q = p + i + dy * k.stride + dx;
        const V tap = hn::Set(d, *next++), w = hn::Mul(tap, hn::LoadU(d, k.weight + q));
        sw = hn::Add(sw, w);
        magnitude = hn::Add(magnitude, hn::Abs(w));
        // What the first pass summed has its masks in it.
        const V factor = !k.squares ? w : k.second ? hn::Mul(tap, tap) : hn::Mul(w, w);
        for (int c = 0; c < k.components; ++c)
        {
          const V v = hn::LoadU(d, k.value[c] + q);
          sum[c] = hn::MulAdd(factor, k.centre[0] ? hn::Min(hn::Max(hn::Sub(v, r[c]), least), most) : v, sum[c]);
        }
      }
    const auto some = hn::Gt(hn::Abs(sw), hn::Mul(hn::Set(d, LeastSum), magnitude));
    const V inverse = hn::Div(one, hn::IfThenElse(some, sw, one));
    for (int c = 0; c < k.components; ++c)
    {
      V v = sum[c];
      if (!k.normalize)
        v = hn::Mul(v, hn::Set(d, k.scale));
      else if (k.squares)
        v = k.first ? v : hn::IfThenElseZero(some, hn::Mul(hn::Mul(v, inverse), inverse));
      else
        v = hn::IfThenElse(some, hn::MulAdd(v, inverse, r[c]), r[c]);
      hn::StoreU(v, d, k.result[c] + o + i);
    }
    if (k.sum)
      hn::StoreU(sw, d, k.sum + o + i);
  }
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(KernelRowImpl);

namespace
{
/// Scales the largest magnitude to 1 and looks for a product.
void Finish(FilterKernel& k, const std::vector<double>& weights)
{
  const int w = 2 * k.RadiusX + 1, h = 2 * k.RadiusY + 1;
  std::size_t top = 0;
  for (std::size_t i = 0; i < weights.size(); ++i)
    if (std::fabs(weights[i]) > std::fabs(weights[top]))
      top = i;
  const double most = std::fabs(weights[top]);
  k.Scale = most > 0 ? most : 1;
  k.Weights.resize(weights.size());
  for (std::size_t i = 0; i < weights.size(); ++i)
    k.Weights[i] = float(weights[i] / k.Scale);
  k.Across.clear();
  k.Up.clear();
  // With negative weights the sum of a row may be 0 where that of the matrix is not.
  if (w * h <= w + h || *std::min_element(weights.begin(), weights.end()) < 0)
    return;
  // The row and the column through the largest weight make the matrix, or it is no product.
  const std::size_t row = top / w, column = top % w;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const double product = weights[row * w + x] * (weights[y * w + column] / weights[top]);
      if (std::fabs(product - weights[std::size_t(y) * w + x]) > 1e-12 * most)
        return;
    }
  for (int x = 0; x < w; ++x)
    k.Across.push_back(float(weights[row * w + x] / k.Scale));
  for (int y = 0; y < h; ++y)
    k.Up.push_back(float(weights[y * w + column] / weights[top]));
}

PlaneLayout TileLayout(const ImageIn& in, const FilterKernel& k, const Rect& tile) noexcept
{
  const Rect grown{ tile.x0 - k.RadiusX, tile.y0 - k.RadiusY, tile.x1 + k.RadiusX, tile.y1 + k.RadiusY };
  return PlaneLayout(grown.clipped(in.extent), k.RadiusX);
}

bool FiniteAll(const float* c, int n) noexcept
{
  bool good = true;
  for (int k = 0; k < n; ++k)
    good = good && Finite(c[k]);
  return good;
}

/// Value of a pixel, or of its neighbourhood where it is not finite; false then.
bool ReadAny(const ImageIn& in, KernelMode mode, int x, int y, float* out) noexcept
{
  const int n = in.components;
  const auto good = [&](const float* c) { return FiniteAll(c, n) && (mode == KernelMode::Mean || *c >= 0); };
  const float* c = in.at(x, y);
  if (good(c))
  {
    for (int k = 0; k < n; ++k)
      out[k] = c[k];
    return true;
  }
  FillFromNeighbours<MostComponents>(in.extent, x, y, out,
    [&](int qx, int qy, float* v)
    {
      const float* q = in.at(qx, qy);
      for (int k = 0; k < MostComponents; ++k)
        v[k] = k < n ? q[k] : 0.f;
      return good(q);
    });
  return false;
}
}

FilterKernel IdentityKernel()
{
  return FilterKernel();
}

FilterKernel BoxKernel(int radius)
{
  FilterKernel k;
  k.RadiusX = k.RadiusY = std::min(std::max(radius, 0), LargestKernelRadius);
  const std::size_t side = 2 * std::size_t(k.RadiusX) + 1;
  Finish(k, std::vector<double>(side * side, 1.));
  return k;
}

FilterKernel Peak3x3Kernel()
{
  FilterKernel k;
  k.RadiusX = k.RadiusY = 1;
  Finish(k, { 1, 3, 1, 3, 6, 3, 1, 3, 1 });
  return k;
}

FilterKernel GaussianKernel(double sigma, int radius)
{
  FilterKernel k;
  if (!(sigma > 0) || radius == 0)
    return k;
  if (radius < 0)
    radius = std::max(1, int(std::min(double(LargestKernelRadius), std::ceil(3 * sigma))));
  radius = std::min(radius, LargestKernelRadius);
  k.RadiusX = k.RadiusY = radius;
  const double factor = sigma < 1e30 ? 0.5 / sigma / sigma : 0;
  std::vector<double> line;
  for (int i = -radius; i <= radius; ++i)
    line.push_back(i ? std::exp(-std::min(1e4, i * i * factor)) : 1.);
  std::vector<double> weights;
  for (const double up : line)
    for (const double across : line)
      weights.push_back(up * across);
  Finish(k, weights);
  return k;
}

bool ParseKernel(const std::string& text, FilterKernel& kernel, std::string& error)
{
  std::vector<std::vector<double>> rows(1);
  const char* p = text.data();
  const char* const end = p + text.size();
  while (p < end)
  {
    if (*p == ';' || *p == '\n')
    {
      if (*p == ';' || !rows.back().empty())
        rows.emplace_back();
      ++p;
    }
    else if (*p == ' ' || *p == ',' || *p == '\t' || *p == '\r')
      ++p;
    else
    {
      double v = 0;
      const auto read = std::from_chars(*p == '+' ? p + 1 : p, end, v);
      const bool stops = read.ptr == end || *read.ptr == ';' || *read.ptr == ',' || *read.ptr <= ' ';
      if (read.ec != std::errc() || !stops || !std::isfinite(v) || std::fabs(v) > 1e30)
      {
        const char* to = p;
        while (to < end && *to != ';' && *to != ',' && *to > ' ')
          ++to;
        error = "\"" + std::string(p, to) + "\" in row " + std::to_string(rows.size()) +
                " is not a number of at most 1e30 in magnitude";
        return false;
      }
      rows.back().push_back(v);
      p = read.ptr;
    }
  }
  if (rows.size() > 1 && rows.back().empty())
    rows.pop_back(); // a last semicolon
  const std::size_t width = rows[0].size(), height = rows.size();
  const std::size_t most = 2 * LargestKernelRadius + 1;
  if (width == 0)
  {
    error = height > 1 ? "row 1 is empty" : "it is empty; write rows of numbers like \"1 3 1; 3 6 3; 1 3 1\"";
    return false;
  }
  for (std::size_t y = 1; y < height; ++y)
    if (rows[y].size() != width)
    {
      error = "row " + std::to_string(y + 1) + " has " + std::to_string(rows[y].size()) + " numbers, row 1 has " +
              std::to_string(width);
      return false;
    }
  if (width % 2 == 0 || height % 2 == 0)
  {
    error =
      std::to_string(height) + " x " + std::to_string(width) + " (rows x columns) has no centre; both must be odd";
    return false;
  }
  if (width > most || height > most)
  {
    error = std::to_string(height) + " x " + std::to_string(width) + " is too large; at most " + std::to_string(most) +
            " x " + std::to_string(most);
    return false;
  }
  std::vector<double> weights;
  bool any = false;
  for (std::size_t y = height; y-- > 0;)
    for (const double v : rows[y])
    {
      weights.push_back(v);
      any |= v != 0;
    }
  if (!any)
  {
    error = "all its weights are 0";
    return false;
  }
  kernel = FilterKernel();
  kernel.RadiusX = int(width) / 2;
  kernel.RadiusY = int(height) / 2;
  Finish(kernel, weights);
  return true;
}

void KernelSums(const FilterKernel& kernel, double& sum, double& magnitude)
{
  sum = magnitude = 0;
  for (const float w : kernel.Weights)
  {
    sum += w * kernel.Scale;
    magnitude += std::fabs(w * kernel.Scale);
  }
}

std::size_t KernelFilterScratch(const ImageIn& in, const FilterKernel& kernel, const Rect& tile) noexcept
{
  const PlaneLayout layout = TileLayout(in, kernel, tile);
  // Values, m; the first pass' values and sums; one row of results.
  return layout.size() * 2 * (in.components + 1) + MostComponents * layout.stride;
}

std::int64_t KernelFilter(const ImageIn& in, const ImageIn& gate, const FilterKernel& kernel, bool normalize,
  KernelMode mode, const ImageOut& out, const Rect& tile, float* scratch) noexcept
{
  const PlaneLayout layout = TileLayout(in, kernel, tile);
  const Rect& e = layout.extent;
  const int n = std::min(in.components, MostComponents);
  const bool variance = mode == KernelMode::Variance;
  const auto plane = [&scratch, &layout]
  {
    float* p = scratch;
    scratch += layout.size();
    return p;
  };
  float *value[MostComponents], *first[MostComponents], *result[MostComponents];
  for (int c = 0; c < n; ++c)
    value[c] = plane();
  float* mask = plane();
  for (int c = 0; c < n; ++c)
    first[c] = plane();
  float* sums = plane();
  for (int c = 0; c < n; ++c)
    result[c] = scratch + c * layout.stride;
  // Lanes and taps beyond the frame read padding: no weight, and numbers.
  for (int c = 0; c < n; ++c)
    std::fill(value[c], value[c] + layout.size(), 0.f);
  std::fill(mask, mask + layout.size(), 0.f);

  std::int64_t bad = 0;
  for (int y = e.y0; y < e.y1; ++y)
    for (int x = e.x0; x < e.x1; ++x)
    {
      const auto i = layout.at(x, y);
      float v[MostComponents];
      bool good = ReadAny(in, mode, x, y, v);
      bad += !good && tile.contains(x, y);
      if (gate)
        good = good && FiniteAll(gate.at(x, y), gate.components);
      for (int c = 0; c < n; ++c)
        value[c][i] = variance ? std::min(v[c], LargestDifference) : v[c];
      mask[i] = good || !normalize ? 1.f : 0.f;
    }

  KernelRow row;
  row.components = n;
  row.normalize = normalize;
  row.squares = variance;
  row.stride = layout.stride;
  const bool centred = normalize && !variance;
  for (int c = 0; c < MostComponents; ++c)
  {
    row.value[c] = c < n ? value[c] : nullptr;
    row.centre[c] = centred && c < n ? value[c] : nullptr;
    row.result[c] = c < n ? result[c] : nullptr;
  }
  row.weight = mask;
  if (kernel.Separable())
  {
    row.tap = kernel.Across.data();
    row.radius = kernel.RadiusX;
    row.first = true;
    row.sum = sums;
    for (int c = 0; c < n; ++c)
      row.result[c] = first[c];
    for (int y = e.y0; y < e.y1; ++y)
    {
      const auto p = layout.at(tile.x0, y);
      HWY_DYNAMIC_DISPATCH(KernelRowImpl)(row, p, p, tile.width());
    }
    row.first = false;
    row.second = true;
    row.sum = nullptr;
    row.weight = normalize ? sums : mask;
    for (int c = 0; c < n; ++c)
    {
      row.value[c] = first[c];
      row.result[c] = result[c];
    }
  }
  row.scale = float(variance ? kernel.Scale * kernel.Scale : kernel.Scale);
  row.radius = kernel.Separable() ? 0 : kernel.RadiusX;
  const float* const taps = kernel.Separable() ? kernel.Up.data() : kernel.Weights.data();
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    row.low = std::max(-kernel.RadiusY, e.y0 - y);
    row.high = std::min(kernel.RadiusY, e.y1 - 1 - y);
    row.tap = taps + std::ptrdiff_t(row.low + kernel.RadiusY) * (2 * row.radius + 1);
    HWY_DYNAMIC_DISPATCH(KernelRowImpl)(row, layout.at(tile.x0, y), 0, tile.width());
    for (int x = tile.x0; x < tile.x1; ++x)
      for (int c = 0; c < n; ++c)
        out.at(x, y)[c] = Limited(result[c][x - tile.x0]);
  }
  return bad;
}

void KernelFilterScalar(const ImageIn& in, const ImageIn& gate, const FilterKernel& kernel, bool normalize,
  KernelMode mode, const ImageOut& out, const Rect& tile) noexcept
{
  const bool variance = mode == KernelMode::Variance;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float r[MostComponents];
      ReadAny(in, mode, x, y, r);
      double sw = 0, magnitude = 0, sum[MostComponents] = {};
      const float* w = kernel.Weights.data();
      for (int dy = -kernel.RadiusY; dy <= kernel.RadiusY; ++dy)
        for (int dx = -kernel.RadiusX; dx <= kernel.RadiusX; ++dx, ++w)
        {
          const int qx = x + dx, qy = y + dy;
          float v[MostComponents];
          if (!in.inside(qx, qy))
            continue;
          bool good = ReadAny(in, mode, qx, qy, v);
          if (gate)
            good = good && FiniteAll(gate.at(qx, qy), gate.components);
          if (normalize && !good)
            continue;
          sw += *w;
          magnitude += std::fabs(*w);
          for (int c = 0; c < in.components; ++c)
            sum[c] += variance    ? double(*w) * *w * v[c]
                      : normalize ? double(*w) * (double(v[c]) - r[c])
                                  : double(*w) * v[c];
        }
      const bool some = std::fabs(sw) > LeastSum * magnitude;
      for (int c = 0; c < in.components; ++c)
        out.at(x, y)[c] = float(!normalize ? sum[c] * (variance ? kernel.Scale * kernel.Scale : kernel.Scale)
                                : variance ? (some ? sum[c] / sw / sw : 0)
                                           : (some ? r[c] + sum[c] / sw : r[c]));
    }
}
}
#endif
