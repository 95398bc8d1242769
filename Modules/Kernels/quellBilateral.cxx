// SPDX-License-Identifier: BSD-3-Clause
#include "quellBilateral.h"

#include "quellGuards.h"
#include "quellPlanes.h"

#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellBilateral.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellBilateral_once
#define quellBilateral_once
namespace quell
{
namespace
{
constexpr int MostFeatures = 11;
constexpr double NoTerm = 1e30;

/// A tile in planes. Every feature is scaled so that its exponent (base 2) is the squared difference itself.
struct BilateralTile
{
  PlaneLayout layout;
  float* color[3];
  float* penalty;               ///< added to a tap's exponent: 0, or +inf for a tap that does not count
  float* feature[MostFeatures]; ///< range 3, normal 3, albedo 3, depth 1, id 1: those that are used
  int features = 0;
  bool gaps = false; ///< some feature value is not a number
  float* plane[7];   ///< normal 3, position 3, 1/(sigma z) for the plane distance; plane[0] absent without it
  float* result[3];  ///< one row
};

enum Layout
{
  UsesRange = 1,
  UsesNormal = 2,
  UsesAlbedo = 4,
  UsesDepth = 8,
  UsesPlane = 16,
  UsesId = 32
};

int Uses(const BilateralInputs& in, const BilateralParameters& p) noexcept
{
  int u = p.sigmaRange < NoTerm ? UsesRange : 0;
  if (in.normal && p.sigmaNormal < NoTerm)
    u |= UsesNormal;
  if (in.albedo && p.sigmaAlbedo < NoTerm)
    u |= UsesAlbedo;
  if (in.depth && p.sigmaDepth < NoTerm)
    u |= in.position && in.normal ? UsesPlane : UsesDepth;
  if (in.id)
    u |= UsesId;
  return u;
}

int PlaneCount(int uses) noexcept
{
  return 4 + 3 * ((uses & UsesRange) != 0) + 3 * ((uses & UsesNormal) != 0) + 3 * ((uses & UsesAlbedo) != 0) +
         ((uses & UsesDepth) != 0) + 7 * ((uses & UsesPlane) != 0) + ((uses & UsesId) != 0);
}

int EffectiveRadius(const BilateralParameters& p) noexcept
{
  return p.sigmaSpatial > 0 && p.radius > 0 ? p.radius : 0;
}

PlaneLayout TileLayout(const BilateralInputs& in, const BilateralParameters& p, const Rect& tile) noexcept
{
  const int r = EffectiveRadius(p);
  return PlaneLayout(tile.grown(r).clipped(in.radiance.extent), r);
}

/// Differences of colours beyond this count as this: 129 x 129 of them do not overflow a float.
constexpr float LargestStep = 1e34f;

/// sqrt(log2(e) / 2) / sigma; 0 turns into 2^60: exact, so that only equal values have a difference of 0.
double FeatureScale(double sigma) noexcept
{
  return sigma > 1e-17 ? std::sqrt(0.5 * 1.4426950408889634) / sigma : 1152921504606846976.;
}

float Scaled(double v, double scale) noexcept
{
  v *= scale;
  return float(v > 1e38 ? 1e38 : v < -1e38 ? -1e38 : v); // NaN stays
}

void RangeValue(const float* c, RangeSpace space, double* out) noexcept
{
  const double l = 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
  for (int k = 0; k < 3; ++k)
    out[k] = space == RangeSpace::Linear       ? c[k]
             : space == RangeSpace::ToneMapped ? c[k] / (1 + (l > 0 ? l : 0))
                                               : std::log1p(c[k] > 0 ? double(c[k]) : 0.);
}
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
template <bool Gaps>
void BilateralRow(const BilateralTile& t, const float* spatial, int radius, int y, int x0, int x1)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d)), side = 2 * radius + 1;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const V step = hn::Set(d, LargestStep), minusStep = hn::Set(d, -LargestStep);
  const auto difference = [&](const float* plane, V centre)
  { return hn::Min(hn::Max(hn::Sub(hn::LoadU(d, plane), centre), minusStep), step); };
  const auto first = t.layout.at(x0, y);
  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    const V r = hn::LoadU(d, t.color[0] + p), g = hn::LoadU(d, t.color[1] + p), b = hn::LoadU(d, t.color[2] + p);
    V f[MostFeatures];
    for (int k = 0; k < t.features; ++k)
      f[k] = hn::LoadU(d, t.feature[k] + p);
    V plane[7];
    if (t.plane[0])
      for (int k = 0; k < 7; ++k)
        plane[k] = hn::LoadU(d, t.plane[k] + p);
    V sw = zero, sr = zero, sg = zero, sb = zero;
    for (int dy = -radius; dy <= radius; ++dy)
    {
      if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
        continue;
      for (int dx = -radius; dx <= radius; ++dx)
      {
        const auto q = p + dy * t.layout.stride + dx;
        V e = hn::Add(hn::Set(d, spatial[(dy + radius) * side + dx + radius]), hn::LoadU(d, t.penalty + q));
        for (int k = 0; k < t.features; ++k)
        {
          const V delta = hn::Sub(hn::LoadU(d, t.feature[k] + q), f[k]);
          V square = hn::Mul(delta, delta);
          if (Gaps)
            square = hn::IfThenElseZero(hn::Eq(square, square), square);
          e = hn::Add(e, square);
        }
        if (t.plane[0])
        {
          V delta = hn::Mul(plane[0], hn::Sub(hn::LoadU(d, t.plane[3] + q), plane[3]));
          delta = hn::MulAdd(plane[1], hn::Sub(hn::LoadU(d, t.plane[4] + q), plane[4]), delta);
          delta = hn::MulAdd(plane[2], hn::Sub(hn::LoadU(d, t.plane[5] + q), plane[5]), delta);
          delta = hn::Mul(delta, plane[6]);
          V square = hn::Mul(delta, delta);
          if (Gaps)
            square = hn::IfThenElseZero(hn::Eq(square, square), square);
          e = hn::Add(e, square);
        }
        const V w = NegExp2(d, e);
        sw = hn::Add(sw, w);
        sr = hn::MulAdd(w, difference(t.color[0] + q, r), sr);
        sg = hn::MulAdd(w, difference(t.color[1] + q, g), sg);
        sb = hn::MulAdd(w, difference(t.color[2] + q, b), sb);
      }
    }
    const auto some = hn::Gt(sw, hn::Set(d, 1e-30f));
    const V inv = hn::Div(one, hn::IfThenElse(some, sw, one));
    hn::StoreU(hn::IfThenElse(some, hn::MulAdd(sr, inv, r), r), d, t.result[0] + i);
    hn::StoreU(hn::IfThenElse(some, hn::MulAdd(sg, inv, g), g), d, t.result[1] + i);
    hn::StoreU(hn::IfThenElse(some, hn::MulAdd(sb, inv, b), b), d, t.result[2] + i);
  }
}

void BilateralRowImpl(const BilateralTile& t, const float* spatial, int radius, int y, int x0, int x1)
{
  if (t.gaps)
    BilateralRow<true>(t, spatial, radius, y, x0, x1);
  else
    BilateralRow<false>(t, spatial, radius, y, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(BilateralRowImpl);

std::size_t BilateralScratch(
  const BilateralInputs& in, const BilateralParameters& parameters, const Rect& tile) noexcept
{
  const PlaneLayout layout = TileLayout(in, parameters, tile);
  const std::size_t side = 2 * std::size_t(EffectiveRadius(parameters)) + 1;
  return layout.size() * PlaneCount(Uses(in, parameters)) + 3 * layout.stride + side * side;
}

std::int64_t Bilateral(const BilateralInputs& in, const BilateralParameters& parameters, const ImageOut& out,
  const Rect& tile, float* scratch) noexcept
{
  const int uses = Uses(in, parameters), radius = EffectiveRadius(parameters), side = 2 * radius + 1;
  BilateralTile t;
  t.layout = TileLayout(in, parameters, tile);
  const Rect& e = t.layout.extent;
  const std::size_t size = t.layout.size();
  const auto next = [&scratch, size]
  {
    float* plane = scratch;
    scratch += size;
    return plane;
  };
  for (float*& plane : t.color)
    plane = next();
  t.penalty = next();
  for (float*& plane : t.plane)
    plane = uses & UsesPlane ? next() : nullptr;

  // Lanes right of the last pixel and taps beyond the frame read padding: no weight, and numbers.
  for (float* plane : t.color)
    std::fill(plane, plane + size, 0.f);
  std::fill(t.penalty, t.penalty + size, std::numeric_limits<float>::infinity());
  if (uses & UsesPlane)
    for (float* plane : t.plane)
      std::fill(plane, plane + size, 0.f);

  const auto forEach = [&](auto&& body)
  {
    for (int y = e.y0; y < e.y1; ++y)
    {
      const auto row = t.layout.at(e.x0, y);
      for (int x = e.x0; x < e.x1; ++x)
        body(x, y, row + (x - e.x0));
    }
  };
  // One plane per component of a guide; `value` returns what is compared, NaN for "no data".
  const auto addFeature = [&](double sigma, auto&& value)
  {
    float* plane = t.feature[t.features++] = next();
    std::fill(plane, plane + size, 0.f);
    const double scale = FeatureScale(sigma);
    forEach(
      [&](int x, int y, std::ptrdiff_t i)
      {
        plane[i] = Scaled(value(x, y), scale);
        t.gaps |= plane[i] != plane[i];
      });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto component = [nan](const ImageIn& image, int k)
  {
    return [&image, k, nan](int x, int y)
    {
      const float v = image.at(x, y)[k];
      return Finite(v) ? double(v) : nan;
    };
  };

  std::int64_t bad = 0;
  forEach(
    [&](int x, int y, std::ptrdiff_t i)
    {
      float c[3];
      const bool good = ReadFilled(in.radiance, x, y, c);
      for (int k = 0; k < 3; ++k)
        t.color[k][i] = c[k];
      bad += !good && tile.contains(x, y);
      const bool hit = !in.depth || Finite(*in.depth.at(x, y));
      t.penalty[i] = good && hit ? 0.f : std::numeric_limits<float>::infinity();
    });
  if (uses & UsesRange)
    for (int k = 0; k < 3; ++k)
      addFeature(parameters.sigmaRange,
        [&](int x, int y)
        {
          const float* c = in.radiance.at(x, y);
          double v[3];
          if (!Finite3(c))
            return nan;
          RangeValue(c, parameters.range, v);
          return v[k];
        });
  if (uses & UsesNormal)
    for (int k = 0; k < 3; ++k)
      addFeature(parameters.sigmaNormal, component(in.normal, k));
  if (uses & UsesAlbedo)
    for (int k = 0; k < 3; ++k)
      addFeature(parameters.sigmaAlbedo, component(in.albedo, k));
  if (uses & UsesDepth)
    addFeature(parameters.sigmaDepth,
      [&](int x, int y)
      {
        const float z = *in.depth.at(x, y);
        if (!Finite(z))
          return nan;
        // "Only equal" is asked of the depths themselves: different ones may share a logarithm in float.
        return parameters.sigmaDepth > 0 ? std::log(z > 1e-30f ? double(z) : 1e-30) : double(z);
      });
  if (uses & UsesId)
    addFeature(0, component(in.id, 0));
  if (uses & UsesPlane)
    forEach(
      [&](int x, int y, std::ptrdiff_t i)
      {
        const float z = *in.depth.at(x, y);
        for (int k = 0; k < 3; ++k)
        {
          t.plane[k][i] = in.normal.at(x, y)[k];
          t.plane[3 + k][i] = in.position.at(x, y)[k];
        }
        t.plane[6][i] =
          Finite(z) ? Scaled(1 / (z > 1e-30f ? double(z) : 1e-30), FeatureScale(parameters.sigmaDepth)) : 0.f;
        t.gaps |= !Finite3(in.normal.at(x, y)) || !Finite3(in.position.at(x, y));
      });

  for (float*& row : t.result)
  {
    row = scratch;
    scratch += t.layout.stride;
  }
  float* spatial = scratch;
  const double perPixel = parameters.sigmaSpatial < NoTerm
                            ? 0.5 * 1.4426950408889634 / (parameters.sigmaSpatial * parameters.sigmaSpatial)
                            : 0;
  for (int dy = -radius; dy <= radius; ++dy)
    for (int dx = -radius; dx <= radius; ++dx)
      spatial[(dy + radius) * side + dx + radius] = radius ? float((dx * dx + dy * dy) * perPixel) : 0.f;

  for (int y = tile.y0; y < tile.y1; ++y)
  {
    HWY_DYNAMIC_DISPATCH(BilateralRowImpl)(t, spatial, radius, y, tile.x0, tile.x1);
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      const bool hit = !in.depth || Finite(*in.depth.at(x, y));
      float* o = out.at(x, y);
      for (int k = 0; k < 3; ++k)
        o[k] = hit ? t.result[k][x - tile.x0] : t.color[k][t.layout.at(x, y)];
    }
  }
  return bad;
}

void BilateralScalar(
  const BilateralInputs& in, const BilateralParameters& p, const ImageOut& out, const Rect& tile) noexcept
{
  const int uses = Uses(in, p), radius = EffectiveRadius(p);
  // |delta|^2 / 2 sigma^2 of `n` components; a component without data is left out.
  const auto term = [](const double* a, const double* b, int n, double sigma)
  {
    double e = 0;
    for (int k = 0; k < n; ++k)
      if (std::isfinite(a[k]) && std::isfinite(b[k]) && a[k] != b[k])
        e += sigma > 1e-17 ? (a[k] - b[k]) * (a[k] - b[k]) / (2 * sigma * sigma) : 1e300;
    return e;
  };
  const auto guide = [&term](const ImageIn& image, int n, double sigma, int x, int y, int qx, int qy)
  {
    double a[3], b[3];
    for (int k = 0; k < n; ++k)
    {
      a[k] = image.at(x, y)[k];
      b[k] = image.at(qx, qy)[k];
    }
    return term(a, b, n, sigma);
  };
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3];
      const bool good = ReadFilled(in.radiance, x, y, c);
      float* o = out.at(x, y);
      for (int k = 0; k < 3; ++k)
        o[k] = c[k];
      if (in.depth && !Finite(*in.depth.at(x, y)))
        continue;
      double sw = 0, sc[3] = {}, range[3] = {};
      if (good)
        RangeValue(c, p.range, range);
      for (int qy = y - radius; qy <= y + radius; ++qy)
        for (int qx = x - radius; qx <= x + radius; ++qx)
        {
          if (!in.radiance.inside(qx, qy) || !Finite3(in.radiance.at(qx, qy)))
            continue;
          if (in.depth && !Finite(*in.depth.at(qx, qy)))
            continue;
          const float* q = in.radiance.at(qx, qy);
          double e = 0;
          if (p.sigmaSpatial < NoTerm && radius)
            e += ((qx - x) * (qx - x) + (qy - y) * (qy - y)) / (2 * p.sigmaSpatial * p.sigmaSpatial);
          if (uses & UsesRange && good)
          {
            double v[3];
            RangeValue(q, p.range, v);
            e += term(v, range, 3, p.sigmaRange);
          }
          if (uses & UsesNormal)
            e += guide(in.normal, 3, p.sigmaNormal, x, y, qx, qy);
          if (uses & UsesAlbedo)
            e += guide(in.albedo, 3, p.sigmaAlbedo, x, y, qx, qy);
          if (uses & UsesId)
            e += guide(in.id, 1, 0, x, y, qx, qy);
          if (uses & UsesDepth)
          {
            const double a = std::log(std::max(1e-30, double(*in.depth.at(x, y))));
            const double b = std::log(std::max(1e-30, double(*in.depth.at(qx, qy))));
            e += term(&a, &b, 1, p.sigmaDepth);
          }
          if (uses & UsesPlane)
          {
            double a = 0, b = 0;
            for (int k = 0; k < 3; ++k)
              a += double(in.normal.at(x, y)[k]) * (in.position.at(qx, qy)[k] - in.position.at(x, y)[k]);
            a /= std::max(1e-30, double(*in.depth.at(x, y)));
            e += term(&a, &b, 1, p.sigmaDepth);
          }
          const double w = e <= 80 ? std::exp(-e) : 0;
          sw += w;
          for (int k = 0; k < 3; ++k)
            sc[k] += w * (double(q[k]) - c[k]);
        }
      if (sw > 0)
        for (int k = 0; k < 3; ++k)
          o[k] = float(c[k] + sc[k] / sw);
    }
}
}
#endif
