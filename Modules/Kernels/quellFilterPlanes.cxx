// SPDX-License-Identifier: BSD-3-Clause
#include "quellFilterPlanes.h"

#include "quellGuards.h"

#include <algorithm>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellFilterPlanes.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellFilterPlanes_once
#define quellFilterPlanes_once
namespace quell
{
namespace
{
// Radiance is not negative; what is, is noise of a filter before. With these limits the difference of two colours is
// below FLT_MAX, and so is a weighted mean of such differences.
constexpr float LeastColor = -1e35f, LargestColor = 3.4e38f;
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
// Rows between interleaved and planar, whole vectors only: they return how many pixels they did. Products and sums are
// those of the scalar loops that do the rest.

int SplitNormalsImpl(const float* HWY_RESTRICT in, int count, float* HWY_RESTRICT x, float* HWY_RESTRICT y,
  float* HWY_RESTRICT z, float longest)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const V limit = hn::Set(d, longest);
  int i = 0;
  for (; i + lanes <= count; i += lanes)
  {
    V a, b, c;
    hn::LoadInterleaved3(d, in + 3 * i, a, b, c);
    const auto good = hn::And(hn::Lt(hn::Abs(a), limit), hn::And(hn::Lt(hn::Abs(b), limit), hn::Lt(hn::Abs(c), limit)));
    hn::StoreU(hn::IfThenElseZero(good, a), d, x + i);
    hn::StoreU(hn::IfThenElseZero(good, b), d, y + i);
    hn::StoreU(hn::IfThenElseZero(good, c), d, z + i);
  }
  return i;
}

int SplitColorsImpl(const float* HWY_RESTRICT in, int count, float* HWY_RESTRICT red, float* HWY_RESTRICT green,
  float* HWY_RESTRICT blue, float* HWY_RESTRICT luminance, int* wrong)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  const V least = hn::Set(d, -1e38f), most = hn::Set(d, 1e38f);
  const V darkest = hn::Set(d, LeastColor), brightest = hn::Set(d, LargestColor);
  int i = 0, bad = 0;
  for (; i + lanes <= count; i += lanes)
  {
    V r, g, b;
    hn::LoadInterleaved3(d, in + 3 * i, r, g, b);
    const auto good = hn::And(hn::Lt(hn::Abs(r), inf), hn::And(hn::Lt(hn::Abs(g), inf), hn::Lt(hn::Abs(b), inf)));
    V l = hn::Add(hn::Mul(hn::Set(d, 0.7152f), g), hn::Mul(hn::Set(d, 0.0722f), b));
    l = hn::Add(hn::Mul(hn::Set(d, 0.2126f), r), l);
    l = hn::Min(hn::Max(l, least), most);
    hn::StoreU(hn::Min(hn::Max(r, darkest), brightest), d, red + i);
    hn::StoreU(hn::Min(hn::Max(g, darkest), brightest), d, green + i);
    hn::StoreU(hn::Min(hn::Max(b, darkest), brightest), d, blue + i);
    hn::StoreU(hn::IfThenElse(good, l, inf), d, luminance + i);
    bad |= !hn::AllTrue(d, good);
  }
  *wrong |= bad;
  return i;
}

int JoinColorsImpl(const float* HWY_RESTRICT red, const float* HWY_RESTRICT green, const float* HWY_RESTRICT blue,
  int count, float* HWY_RESTRICT out)
{
  const hn::ScalableTag<float> d;
  const int lanes = int(hn::Lanes(d));
  int i = 0;
  for (; i + lanes <= count; i += lanes)
    hn::StoreInterleaved3(hn::LoadU(d, red + i), hn::LoadU(d, green + i), hn::LoadU(d, blue + i), d, out + 3 * i);
  return i;
}

/// Writes up to a vector beyond `count` pixels.
void SlopesImpl(const float* HWY_RESTRICT depth, const float* HWY_RESTRICT id, std::ptrdiff_t step, int count,
  float* HWY_RESTRICT out)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  for (int i = 0; i < count; i += int(hn::Lanes(d)))
  {
    const V z = hn::LoadU(d, depth + i), next = hn::LoadU(d, depth + i + step), last = hn::LoadU(d, depth + i - step);
    V forward = hn::IfThenElse(hn::Lt(hn::Abs(next), inf), hn::Sub(next, z), inf);
    V backward = hn::IfThenElse(hn::Lt(hn::Abs(last), inf), hn::Sub(z, last), inf);
    if (id)
    {
      const V own = hn::LoadU(d, id + i);
      forward = hn::IfThenElse(hn::Eq(own, hn::LoadU(d, id + i + step)), forward, inf);
      backward = hn::IfThenElse(hn::Eq(own, hn::LoadU(d, id + i - step)), backward, inf);
    }
    const V s = hn::IfThenElse(hn::Le(hn::Abs(forward), hn::Abs(backward)), forward, backward);
    hn::StoreU(hn::IfThenElseZero(hn::Lt(hn::Abs(s), inf), s), d, out + i);
  }
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(SplitNormalsImpl);
HWY_EXPORT(SplitColorsImpl);
HWY_EXPORT(JoinColorsImpl);
HWY_EXPORT(SlopesImpl);

namespace
{
constexpr float LongestNormal = 1e6f; // a longer one is no direction (and its dot product may overflow)
constexpr float Inf = std::numeric_limits<float>::infinity();
constexpr float LargestVariance = 1e38f; // Sum w^2 v stays below FLT_MAX

float LimitColor(float c) noexcept
{
  return std::min(std::max(c, LeastColor), LargestColor);
}

/// Fills the padding of row y, and the pad rows beside the first and last row.
void Pad(const PlaneLayout& layout, float* plane, int y, float value) noexcept
{
  if (!plane)
    return;
  const Rect& e = layout.extent;
  float* row = plane + layout.at(e.x0, y) - layout.pad;
  std::fill(row, row + layout.pad, value);
  std::fill(row + layout.pad + e.width(), row + layout.stride, value);
  if (y == e.y0)
    std::fill(row - layout.stride, row, value);
  if (y == e.y1 - 1)
    std::fill(row + layout.stride, row + 2 * layout.stride, value);
}

float CleanVariance(float v) noexcept
{
  return v > 0 ? (v < LargestVariance ? v : LargestVariance) : 0.f;
}

float ReadVariance(const ImageIn& image, int x, int y) noexcept
{
  const float v = *image.at(x, y);
  if (Finite(v))
    return CleanVariance(v);
  float mean = 0;
  FillFromNeighbours<1>(image.extent, x, y, &mean,
    [&image](int qx, int qy, float* out)
    {
      const float q = *image.at(qx, qy);
      *out = CleanVariance(q);
      return Finite(q);
    });
  return mean;
}
}

void CopyGuides(
  const ImageIn& depth, const ImageIn& normal, const ImageIn& id, const GuidePlanes& planes, int y0, int y1) noexcept
{
  const PlaneLayout& layout = planes.layout;
  const Rect& e = layout.extent;
  const int w = e.width();
  for (int y = y0; y < y1; ++y)
  {
    const std::ptrdiff_t row = layout.at(e.x0, y);
    Pad(layout, planes.depth, y, Inf);
    float* z = planes.depth + row;
    if (depth)
    {
      const float* in = depth.at(e.x0, y);
      for (int i = 0; i < w; ++i)
        z[i] = std::fabs(in[i]) < Inf ? in[i] : Inf;
    }
    else
      std::fill(z, z + w, 1.f);
    if (planes.normal[0])
    {
      float *nx = planes.normal[0] + row, *ny = planes.normal[1] + row, *nz = planes.normal[2] + row;
      for (int c = 0; c < 3; ++c)
        Pad(layout, planes.normal[c], y, 0.f);
      const float* in = normal.at(e.x0, y);
      const int done = HWY_DYNAMIC_DISPATCH(SplitNormalsImpl)(in, w, nx, ny, nz, LongestNormal);
      in += 3 * done;
      for (int i = done; i < w; ++i, in += 3)
      {
        const bool good =
          std::fabs(in[0]) < LongestNormal && std::fabs(in[1]) < LongestNormal && std::fabs(in[2]) < LongestNormal;
        nx[i] = good ? in[0] : 0.f;
        ny[i] = good ? in[1] : 0.f;
        nz[i] = good ? in[2] : 0.f;
      }
    }
    if (planes.id)
    {
      Pad(layout, planes.id, y, 0.f);
      const float* in = id.at(e.x0, y);
      std::copy(in, in + w, planes.id + row);
    }
  }
}

void CopySlopes(const GuidePlanes& planes, int y0, int y1) noexcept
{
  const PlaneLayout& layout = planes.layout;
  const Rect& e = layout.extent;
  for (int y = y0; y < y1; ++y)
  {
    Pad(layout, planes.slopeX, y, 0.f);
    Pad(layout, planes.slopeY, y, 0.f);
    const std::ptrdiff_t row = layout.at(e.x0, y);
    const float* id = planes.id ? planes.id + row : nullptr;
    HWY_DYNAMIC_DISPATCH(SlopesImpl)(planes.depth + row, id, 1, e.width(), planes.slopeX + row);
    HWY_DYNAMIC_DISPATCH(SlopesImpl)(planes.depth + row, id, layout.stride, e.width(), planes.slopeY + row);
  }
}

void ClearPadding(const PlaneLayout& layout, const ColorPlanes& planes, int y0, int y1) noexcept
{
  for (int y = y0; y < y1; ++y)
  {
    for (float* plane : planes.color)
      Pad(layout, plane, y, 0.f);
    Pad(layout, planes.luminance, y, Inf);
    Pad(layout, planes.variance, y, -1.f);
  }
}

std::int64_t CopyColor(const ImageIn& color, const ImageIn& variance, const GuidePlanes& guides,
  const ColorPlanes& planes, int y0, int y1, const Rect& counted) noexcept
{
  const PlaneLayout& layout = guides.layout;
  const Rect& e = layout.extent;
  const int w = e.width();
  std::int64_t bad = 0;
  ClearPadding(layout, planes, y0, y1);
  for (int y = y0; y < y1; ++y)
  {
    const std::ptrdiff_t row = layout.at(e.x0, y);
    float *r = planes.color[0] + row, *g = planes.color[1] + row, *b = planes.color[2] + row;
    float* l = planes.luminance + row;
    const float* z = guides.depth + row;
    const float* in = color.at(e.x0, y);
    int badInRow = 0;
    for (int i = HWY_DYNAMIC_DISPATCH(SplitColorsImpl)(in, w, r, g, b, l, &badInRow); i < w; ++i)
    {
      const float cr = in[3 * i], cg = in[3 * i + 1], cb = in[3 * i + 2];
      const bool good = Finite(cr) & Finite(cg) & Finite(cb);
      r[i] = LimitColor(cr), g[i] = LimitColor(cg), b[i] = LimitColor(cb);
      l[i] = good ? FilterLuminance(cr, cg, cb) : Inf;
      badInRow += !good;
    }
    if (planes.variance)
    {
      float* v = planes.variance + row;
      const float* from = variance.at(e.x0, y);
      int unknown = 0;
      for (int i = 0; i < w; ++i)
      {
        v[i] = (l[i] < Inf) & (z[i] < Inf) ? CleanVariance(from[i]) : -1.f;
        unknown |= !Finite(from[i]);
      }
      if (unknown)
        for (int i = 0; i < w; ++i)
          v[i] = l[i] < Inf && z[i] < Inf ? ReadVariance(variance, e.x0 + i, y) : -1.f;
    }
    if (badInRow)
      for (int i = 0; i < w; ++i)
        if (!(l[i] < Inf))
        {
          float c[3];
          ReadFilled(color, e.x0 + i, y, c);
          r[i] = LimitColor(c[0]), g[i] = LimitColor(c[1]), b[i] = LimitColor(c[2]);
          bad += counted.contains(e.x0 + i, y);
        }
  }
  return bad;
}

void StoreFiltered(const GuidePlanes& guides, const ColorPlanes& planes, const ImageIn& inputColor,
  const ImageIn& inputVariance, const ImageOut& color, const ImageOut& variance, const Rect& tile) noexcept
{
  const PlaneLayout& layout = guides.layout;
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    const std::ptrdiff_t row = layout.at(tile.x0, y);
    const float* z = guides.depth + row;
    const int count = tile.width();
    int sky = 0;
    for (int i = 0; i < count; ++i)
      sky |= !(z[i] < Inf);
    if (color)
    {
      float* o = color.at(tile.x0, y);
      const float *r = planes.color[0] + row, *g = planes.color[1] + row, *b = planes.color[2] + row;
      for (int i = HWY_DYNAMIC_DISPATCH(JoinColorsImpl)(r, g, b, count, o); i < count; ++i)
        o[3 * i] = r[i], o[3 * i + 1] = g[i], o[3 * i + 2] = b[i];
      if (sky)
        for (int i = 0; i < count; ++i)
          if (!(z[i] < Inf))
            ReadFilled(inputColor, tile.x0 + i, y, o + 3 * i);
    }
    if (variance)
    {
      float* o = variance.at(tile.x0, y);
      if (planes.variance)
        for (int i = 0; i < count; ++i)
          o[i] = planes.variance[row + i] > 0 ? planes.variance[row + i] : 0.f;
      else
        std::fill(o, o + count, 0.f);
      if (sky)
        for (int i = 0; i < count; ++i)
          if (!(z[i] < Inf))
            o[i] = inputVariance ? ReadVariance(inputVariance, tile.x0 + i, y) : 0.f;
    }
  }
}
}
#endif
