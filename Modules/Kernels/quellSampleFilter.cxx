// SPDX-License-Identifier: BSD-3-Clause
#include "quellSampleFilter.h"

#include "quellGuidePlanes.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <new>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellSampleFilter.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellSampleFilter_once
#define quellSampleFilter_once
namespace quell
{
namespace
{
constexpr float LargestSampleStep = 1e34f; // differences of colours: a window of them does not overflow

struct SampleRow
{
  const GuidedTile* own;
  const GuidedTile* taps; ///< `count` of them, of one layout
  int count;
  const float* spatial; ///< exponents of (2 radius + 1)^2 distances
  int radius;
  float* result[3]; ///< one row
};

int EffectiveRadius(const SampleFilterParameters& p) noexcept
{
  return p.sigmaSpatial > 0 && p.radius > 0 ? p.radius : 0;
}

GuidedInputs Guided(const SampleFilterInputs& in, const SampleFilterParameters& p, int s) noexcept
{
  GuidedInputs g;
  g.color = in.radiance[s];
  if (in.depth)
    g.depth = in.depth[s];
  if (in.normal)
    g.normal = in.normal[s];
  if (in.albedo)
    g.albedo = in.albedo[s];
  if (in.id)
    g.id = in.id[s];
  g.sigmaNormal = p.sigmaNormal;
  g.sigmaDepth = p.sigmaDepth;
  g.sigmaAlbedo = p.sigmaAlbedo;
  return g;
}

/// What a channel is divided by, as in Demodulate.
float Divisor(const SampleFilterInputs& in, const SampleFilterParameters& p, int s, int x, int y, int k) noexcept
{
  if (!p.demodulate || !in.albedo)
    return 1;
  const float a = in.albedo[s].at(x, y)[k];
  return !Finite(a) || a > 1 ? 1.f : a < p.floor ? p.floor : a;
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
void SampleRowOf(const SampleRow& a, int y, int x0, int x1)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d)), radius = a.radius, side = 2 * radius + 1;
  const GuidedTile& own = *a.own;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const V step = hn::Set(d, LargestSampleStep), minusStep = hn::Set(d, -LargestSampleStep);
  const auto first = own.layout.at(x0, y);
  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    V c[3], f[GuidedTile::MostFeatures];
    for (int k = 0; k < 3; ++k)
      c[k] = hn::LoadU(d, own.color[k] + p);
    for (int k = 0; k < own.features; ++k)
      f[k] = hn::LoadU(d, own.feature[k] + p);
    V sw = zero, sc[3] = { zero, zero, zero };
    for (int s = 0; s < a.count; ++s)
    {
      const GuidedTile& t = a.taps[s];
      for (int dy = -radius; dy <= radius; ++dy)
      {
        if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
          continue;
        // Rows first: hundreds of weights one after the other would round in the fifth digit.
        V rw = zero, rc[3] = { zero, zero, zero };
        for (int dx = -radius; dx <= radius; ++dx)
        {
          const auto q = p + dy * t.layout.stride + dx;
          V e = hn::Add(hn::Set(d, a.spatial[(dy + radius) * side + dx + radius]), hn::LoadU(d, t.penalty + q));
          for (int k = 0; k < own.features; ++k)
          {
            const V delta = hn::Sub(hn::LoadU(d, t.feature[k] + q), f[k]);
            V square = hn::Mul(delta, delta);
            if (Gaps)
              square = hn::IfThenElseZero(hn::Eq(square, square), square);
            e = hn::Add(e, square);
          }
          const V w = NegExp2(d, e);
          rw = hn::Add(rw, w);
          for (int k = 0; k < 3; ++k)
          {
            const V delta = hn::Sub(hn::LoadU(d, t.color[k] + q), c[k]);
            rc[k] = hn::MulAdd(w, hn::Min(hn::Max(delta, minusStep), step), rc[k]);
          }
        }
        sw = hn::Add(sw, rw);
        for (int k = 0; k < 3; ++k)
          sc[k] = hn::Add(sc[k], rc[k]);
      }
    }
    const auto some = hn::Gt(sw, hn::Set(d, 1e-30f));
    const V inv = hn::Div(one, hn::IfThenElse(some, sw, one));
    for (int k = 0; k < 3; ++k)
      hn::StoreU(hn::IfThenElse(some, hn::MulAdd(sc[k], inv, c[k]), c[k]), d, a.result[k] + i);
  }
}

void SampleRowImpl(const SampleRow& a, bool gaps, int y, int x0, int x1)
{
  if (gaps)
    SampleRowOf<true>(a, y, x0, x1);
  else
    SampleRowOf<false>(a, y, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(SampleRowImpl);

namespace
{
PlaneLayout TileLayout(const SampleFilterInputs& in, const SampleFilterParameters& p, const Rect& tile) noexcept
{
  const int r = EffectiveRadius(p);
  return PlaneLayout(tile.grown(r).clipped(in.radiance[0].extent), r);
}
/// Floats that the tiles' descriptions take.
std::size_t DescriptionSize(int count) noexcept
{
  return (sizeof(GuidedTile) * count + alignof(GuidedTile)) / sizeof(float) + 2;
}
}

std::size_t SampleFilterScratch(
  const SampleFilterInputs& in, const SampleFilterParameters& p, const Rect& tile) noexcept
{
  const PlaneLayout layout = TileLayout(in, p, tile);
  const std::size_t side = 2 * std::size_t(EffectiveRadius(p)) + 1;
  return DescriptionSize(in.count) + layout.size() * Guided(in, p, 0).Planes() * in.count + 6 * layout.stride +
         side * side;
}

std::int64_t SampleFilter(const SampleFilterInputs& in, const SampleFilterParameters& p, const ImageOut& out,
  const Rect& tile, float* scratch) noexcept
{
  const int radius = EffectiveRadius(p), n = in.count;
  const PlaneLayout layout = TileLayout(in, p, tile);
  auto address = reinterpret_cast<std::uintptr_t>(scratch);
  address = (address + alignof(GuidedTile) - 1) / alignof(GuidedTile) * alignof(GuidedTile);
  GuidedTile* tiles = reinterpret_cast<GuidedTile*>(address);
  scratch += DescriptionSize(n);
  bool gaps = false;
  for (int s = 0; s < n; ++s)
  {
    GuidedTile& t = *new (tiles + s) GuidedTile;
    t.layout = layout;
    std::int64_t bad = 0;
    scratch = FillGuidedTile(Guided(in, p, s), t, scratch, tile, bad);
    gaps |= t.gaps;
    if (p.demodulate && in.albedo)
      for (int y = layout.extent.y0; y < layout.extent.y1; ++y)
        for (int x = layout.extent.x0; x < layout.extent.x1; ++x)
          for (int k = 0; k < 3; ++k)
          {
            float& c = t.color[k][layout.at(x, y)];
            c = Limited(c / Divisor(in, p, s, x, y, k));
          }
  }
  SampleRow a;
  a.radius = radius;
  for (float*& row : a.result)
  {
    row = scratch;
    scratch += layout.stride;
  }
  float* sums[3];
  for (float*& row : sums)
  {
    row = scratch;
    scratch += layout.stride;
  }
  float* spatial = scratch;
  const double perSquare =
    p.sigmaSpatial < GuidedInputs::Off ? 0.5 * 1.4426950408889634 / (p.sigmaSpatial * p.sigmaSpatial) : 0;
  for (int dy = -radius; dy <= radius; ++dy)
    for (int dx = -radius; dx <= radius; ++dx)
      *scratch++ = radius ? float((dx * dx + dy * dy) * perSquare) : 0.f;
  a.spatial = spatial;

  std::int64_t bad = 0;
  const int width = tile.width();
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    for (float* row : sums)
      std::fill(row, row + width, 0.f);
    for (int t = 0; t < n; ++t)
    {
      a.own = tiles + t;
      const bool all = p.pairs == SamplePairs::All;
      a.taps = all ? tiles : tiles + t;
      a.count = all ? n : 1;
      HWY_DYNAMIC_DISPATCH(SampleRowImpl)(a, gaps, y, tile.x0, tile.x1);
      for (int i = 0; i < width; ++i)
      {
        const int x = tile.x0 + i;
        const bool hit = !in.depth || Finite(*in.depth[t].at(x, y));
        for (int k = 0; k < 3; ++k)
        {
          const float v = hit ? a.result[k][i] : a.own->color[k][layout.at(x, y)];
          sums[k][i] = Limited(sums[k][i] + Limited(v * Divisor(in, p, t, x, y, k)) / float(n));
        }
      }
    }
    for (int i = 0; i < width; ++i)
    {
      const int x = tile.x0 + i;
      bool finite = true;
      for (int t = 0; t < n; ++t)
        finite = finite && Finite3(in.radiance[t].at(x, y));
      bad += !finite;
      for (int k = 0; k < 3; ++k)
        out.at(x, y)[k] = sums[k][i];
    }
  }
  return bad;
}

void SampleFilterScalar(
  const SampleFilterInputs& in, const SampleFilterParameters& p, const ImageOut& out, const Rect& tile) noexcept
{
  const int r = EffectiveRadius(p), n = in.count;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      double total[3] = {};
      for (int t = 0; t < n; ++t)
      {
        const GuidedInputs own = Guided(in, p, t);
        float filled[3];
        ReadFilled(in.radiance[t], x, y, filled);
        double c[3], sw = 0, sc[3] = {};
        for (int k = 0; k < 3; ++k)
          c[k] = filled[k];
        if (!in.depth || Finite(*in.depth[t].at(x, y)))
        {
          for (int s = 0; s < n; ++s)
            for (int qy = y - r; qy <= y + r; ++qy)
              for (int qx = x - r; qx <= x + r; ++qx)
              {
                const GuidedInputs other = Guided(in, p, s);
                if ((p.pairs == SamplePairs::Same && s != t) || !GuideCounts(other, qx, qy))
                  continue;
                double e = GuideExponentBetween(own, x, y, other, qx, qy);
                if (r && p.sigmaSpatial < GuidedInputs::Off)
                  e += ((qx - x) * (qx - x) + (qy - y) * (qy - y)) / (2 * p.sigmaSpatial * p.sigmaSpatial);
                const double w = e <= 80 ? std::exp(-e) : 0;
                sw += w;
                for (int k = 0; k < 3; ++k)
                  sc[k] += w * (double(in.radiance[s].at(qx, qy)[k]) / Divisor(in, p, s, qx, qy, k));
              }
          if (sw > 0)
            for (int k = 0; k < 3; ++k)
              c[k] = sc[k] / sw * Divisor(in, p, t, x, y, k);
        }
        for (int k = 0; k < 3; ++k)
          total[k] += c[k] / n;
      }
      for (int k = 0; k < 3; ++k)
        out.at(x, y)[k] = float(total[k]);
    }
}
}
#endif
