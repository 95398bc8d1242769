// SPDX-License-Identifier: BSD-3-Clause
#include "quellVarianceSteered.h"

#include "quellFilledWeights.h"
#include "quellGuidePlanes.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellVarianceSteered.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellVarianceSteered_once
#define quellVarianceSteered_once
namespace quell
{
namespace
{
constexpr int Votes = 3;                    // half the side of the square over which errors are added
constexpr int Mix = 1;                      // and of the one over which choices are mixed
constexpr float LargestSteeredStep = 1e34f; // differences of colours: 41 x 41 of them do not overflow
constexpr int MostScales = VarianceSteeredParameters::MostScales;

double SigmaOf(int scale) noexcept
{
  return std::ldexp(1., scale - 2);
}

int ScalesOf(const VarianceSteeredParameters& p) noexcept
{
  return p.scales < 0 ? 0 : p.scales > MostScales ? MostScales : p.scales;
}

/// One scale's results, in planes of the layout of what is judged.
struct ScalePlanes
{
  float *color[3], *variance, *centre;
};

struct SteeredRow
{
  GuidedTile tile;
  PlaneLayout results;
  ScalePlanes scale[MostScales];
  int scales;
  int radius[MostScales];          ///< growing
  const float* kernel[MostScales]; ///< (2 radius + 1)^2 weights of distance
};
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
/// Sums of a vector of pixels at every scale.
template <class V>
struct SteeredSums
{
  V weight[MostScales], variance[MostScales], color[MostScales][3];
};

/// Adds the taps that the Scales widest kernels reach, and no narrower one. The sums are copied so that they stay in
/// registers: most taps are those of the widest kernel alone.
template <int Scales, bool Gaps, class D, class V>
HWY_INLINE void AddRing(D d, const SteeredRow& a, int y, std::ptrdiff_t p, const V* c, const V* f, SteeredSums<V>& all)
{
  const GuidedTile& t = a.tile;
  const int first = a.scales - Scales, radius = a.radius[first], inside = first > 0 ? a.radius[first - 1] : -1;
  const int features = t.features;
  const V step = hn::Set(d, LargestSteeredStep), minusStep = hn::Set(d, -LargestSteeredStep);
  V sw[Scales], sv[Scales], sc[Scales][3];
  for (int s = 0; s < Scales; ++s)
  {
    sw[s] = all.weight[first + s];
    sv[s] = all.variance[first + s];
    for (int k = 0; k < 3; ++k)
      sc[s][k] = all.color[first + s][k];
  }
  const float* kernel[Scales];
  for (int dy = -radius; dy <= radius; ++dy)
  {
    if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
      continue;
    for (int s = 0; s < Scales; ++s)
    {
      const int r = a.radius[first + s];
      kernel[s] = a.kernel[first + s] + (dy + r) * (2 * r + 1) + r;
    }
    const auto row = p + dy * t.layout.stride;
    for (int dx = -radius; dx <= radius; ++dx)
    {
      if (dx == -inside && dy >= -inside && dy <= inside)
        dx = inside + 1;
      if (dx > radius)
        break;
      const auto q = row + dx;
      V e = hn::LoadU(d, t.penalty + q);
      for (int k = 0; k < features; ++k)
      {
        V delta = hn::Sub(hn::LoadU(d, t.feature[k] + q), f[k]);
        if (Gaps) // the same rounding as without: whether there are gaps depends on the tile
          delta = hn::IfThenElseZero(hn::Eq(delta, delta), delta);
        e = hn::MulAdd(delta, delta, e);
      }
      const V g = NegExp2(d, e), v = hn::LoadU(d, t.variance + q);
      V delta[3];
      for (int k = 0; k < 3; ++k)
        delta[k] = hn::Min(hn::Max(hn::Sub(hn::LoadU(d, t.color[k] + q), c[k]), minusStep), step);
      for (int s = 0; s < Scales; ++s)
      {
        const V w = hn::Mul(g, hn::Set(d, kernel[s][dx]));
        sw[s] = hn::Add(sw[s], w);
        sv[s] = hn::MulAdd(hn::Mul(w, w), v, sv[s]);
        for (int k = 0; k < 3; ++k)
          sc[s][k] = hn::MulAdd(w, delta[k], sc[s][k]);
      }
    }
  }
  for (int s = 0; s < Scales; ++s)
  {
    all.weight[first + s] = sw[s];
    all.variance[first + s] = sv[s];
    for (int k = 0; k < 3; ++k)
      all.color[first + s][k] = sc[s][k];
  }
}

template <bool Gaps>
void SteeredRowOf(const SteeredRow& a, int y, int x0, int x1)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d)), last = a.scales - 1;
  const GuidedTile& t = a.tile;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const auto first = t.layout.at(x0, y), firstResult = a.results.at(x0, y);
  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    V c[3], f[GuidedTile::MostFeatures];
    for (int k = 0; k < 3; ++k)
      c[k] = hn::LoadU(d, t.color[k] + p);
    for (int k = 0; k < t.features; ++k)
      f[k] = hn::LoadU(d, t.feature[k] + p);
    SteeredSums<V> sums;
    for (int s = 0; s <= last; ++s)
      sums.weight[s] = sums.variance[s] = sums.color[s][0] = sums.color[s][1] = sums.color[s][2] = zero;
    AddRing<1, Gaps>(d, a, y, p, c, f, sums);
    if (last >= 1)
      AddRing<2, Gaps>(d, a, y, p, c, f, sums);
    if (last >= 2)
      AddRing<3, Gaps>(d, a, y, p, c, f, sums);
    if (last >= 3)
      AddRing<4, Gaps>(d, a, y, p, c, f, sums);
    if (last >= 4)
      AddRing<5, Gaps>(d, a, y, p, c, f, sums);
    const V centre = NegExp2(d, hn::LoadU(d, t.penalty + p));
    for (int s = 0; s <= last; ++s)
    {
      const auto some = hn::Gt(sums.weight[s], hn::Set(d, 1e-30f));
      const V inv = hn::Div(one, hn::IfThenElse(some, sums.weight[s], one));
      const auto at = firstResult + i;
      for (int k = 0; k < 3; ++k)
        hn::StoreU(hn::IfThenElse(some, hn::MulAdd(sums.color[s][k], inv, c[k]), c[k]), d, a.scale[s].color[k] + at);
      hn::StoreU(hn::IfThenElse(some, hn::Mul(hn::Mul(sums.variance[s], inv), inv), hn::LoadU(d, t.variance + p)), d,
        a.scale[s].variance + at);
      hn::StoreU(hn::Mul(centre, inv), d, a.scale[s].centre + at);
    }
  }
}

void SteeredRowImpl(const SteeredRow& a, int y, int x0, int x1)
{
  if (a.tile.gaps)
    SteeredRowOf<true>(a, y, x0, x1);
  else
    SteeredRowOf<false>(a, y, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(SteeredRowImpl);

namespace
{
GuidedInputs Guided(const VarianceSteeredInputs& in, const VarianceSteeredParameters& p) noexcept
{
  return { in.radiance, in.variance, in.depth, in.normal, in.albedo, in.id, p.sigmaNormal, p.sigmaDepth,
    p.sigmaAlbedo };
}

/// What is judged around a tile, and what that reads.
struct Areas
{
  PlaneLayout tile, results;
  Areas(const VarianceSteeredInputs& in, const VarianceSteeredParameters& p, const Rect& pixels) noexcept
  {
    const int radius = VarianceSteeredRadius(ScalesOf(p));
    const Rect judged = pixels.grown(Votes + Mix).clipped(in.radiance.extent);
    this->results = PlaneLayout(judged, 0);
    this->tile = PlaneLayout(judged.grown(radius).clipped(in.radiance.extent), radius);
  }
};

double Luminance(const float* r, const float* g, const float* b, std::ptrdiff_t i) noexcept
{
  return 0.2126 * r[i] + 0.7152 * g[i] + 0.0722 * b[i];
}

/// Filters what is judged at every scale.
float* FilterScales(const VarianceSteeredInputs& in, const VarianceSteeredParameters& p, const Rect& pixels,
  float* scratch, SteeredRow& a, std::int64_t& bad) noexcept
{
  const Areas areas(in, p, pixels);
  a.tile.layout = areas.tile;
  a.results = areas.results;
  a.scales = ScalesOf(p);
  scratch = FillGuidedTile(Guided(in, p), a.tile, scratch, pixels, bad);
  for (int s = 0; s < a.scales; ++s)
  {
    ScalePlanes& planes = a.scale[s];
    for (float** plane : { &planes.color[0], &planes.color[1], &planes.color[2], &planes.variance, &planes.centre })
    {
      *plane = scratch;
      scratch += a.results.size();
    }
    const int r = a.radius[s] = VarianceSteeredRadius(s + 1);
    const double perSquare = 0.5 / (SigmaOf(s + 1) * SigmaOf(s + 1));
    a.kernel[s] = scratch;
    for (int dy = -r; dy <= r; ++dy)
      for (int dx = -r; dx <= r; ++dx)
        *scratch++ = float(std::exp(-perSquare * (dx * dx + dy * dy)));
  }
  if (a.scales > 0)
    for (int y = a.results.extent.y0; y < a.results.extent.y1; ++y)
      HWY_DYNAMIC_DISPATCH(SteeredRowImpl)(a, y, a.results.extent.x0, a.results.extent.x1);
  return scratch;
}
}

int VarianceSteeredRadius(int scale) noexcept
{
  return scale <= 0 ? 0 : int(std::ceil(2.5 * SigmaOf(scale)));
}

int VarianceSteeredHalo(const VarianceSteeredParameters& p) noexcept
{
  return VarianceSteeredRadius(ScalesOf(p)) + Votes + Mix;
}

std::size_t VarianceSteeredScratch(
  const VarianceSteeredInputs& in, const VarianceSteeredParameters& p, const Rect& tile) noexcept
{
  const Areas areas(in, p, tile);
  std::size_t size = areas.tile.size() * Guided(in, p).Planes();
  const int scales = ScalesOf(p);
  size += areas.results.size() * (5 * scales);
  for (int s = 1; s <= scales; ++s)
    size += std::size_t(2 * VarianceSteeredRadius(s) + 1) * (2 * VarianceSteeredRadius(s) + 1);
  // Errors and their sums along rows, in double; choices.
  return size + areas.results.size() * (4 * (scales + 1) + 1) + 2;
}

std::int64_t VarianceSteered(const VarianceSteeredInputs& in, const VarianceSteeredParameters& p,
  const VarianceSteeredOutputs& out, const Rect& tile, float* scratch) noexcept
{
  std::int64_t bad = 0;
  SteeredRow a;
  scratch = FilterScales(in, p, tile, scratch, a, bad);
  const PlaneLayout& layout = a.results;
  const Rect& judged = layout.extent;
  const std::size_t size = layout.size();
  scratch += reinterpret_cast<std::uintptr_t>(scratch) % sizeof(double) ? 1 : 0;
  double* errors = reinterpret_cast<double*>(scratch);
  double* rows = errors + size * (a.scales + 1);
  float* choice = reinterpret_cast<float*>(rows + size * (a.scales + 1));

  // Estimated squared error of the identity (0) and of every scale.
  for (int y = judged.y0; y < judged.y1; ++y)
    for (int x = judged.x0; x < judged.x1; ++x)
    {
      const auto i = layout.at(x, y);
      const auto q = a.tile.layout.at(x, y);
      for (int s = 0; s <= a.scales; ++s)
        errors[size * s + i] = 0;
      if (a.tile.penalty[q] != 0 || a.scales == 0)
        continue; // no vote
      const double c = Luminance(a.tile.color[0], a.tile.color[1], a.tile.color[2], q), v = a.tile.variance[q];
      errors[i] = v;
      for (int s = 1; s <= a.scales; ++s)
      {
        const ScalePlanes& f = a.scale[s - 1];
        const double delta = Luminance(f.color[0], f.color[1], f.color[2], i) - c;
        errors[size * s + i] = delta * delta + v * (2 * double(f.centre[i]) - 1);
      }
    }
  for (int s = 0; s <= a.scales; ++s)
    for (int y = judged.y0; y < judged.y1; ++y)
      for (int x = judged.x0; x < judged.x1; ++x)
      {
        double sum = 0;
        for (int qx = std::max(judged.x0, x - Votes); qx <= std::min(judged.x1 - 1, x + Votes); ++qx)
          sum += errors[size * s + layout.at(qx, y)];
        rows[size * s + layout.at(x, y)] = sum;
      }
  const Rect mixed = tile.grown(Mix).clipped(judged);
  for (int y = mixed.y0; y < mixed.y1; ++y)
    for (int x = mixed.x0; x < mixed.x1; ++x)
    {
      int best = 0;
      double least = 0;
      for (int s = 0; s <= a.scales; ++s)
      {
        double sum = 0;
        for (int qy = std::max(judged.y0, y - Votes); qy <= std::min(judged.y1 - 1, y + Votes); ++qy)
          sum += rows[size * s + layout.at(x, qy)];
        if (s == 0 || sum < least)
        {
          best = s;
          least = sum;
        }
      }
      choice[layout.at(x, y)] = float(best);
    }
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      const auto i = layout.at(x, y);
      const auto q = a.tile.layout.at(x, y);
      const bool hit = !in.depth || Finite(*in.depth.at(x, y));
      int chose[MostScales + 1] = {}, voters = 0;
      for (int qy = std::max(mixed.y0, y - Mix); qy <= std::min(mixed.y1 - 1, y + Mix); ++qy)
        for (int qx = std::max(mixed.x0, x - Mix); qx <= std::min(mixed.x1 - 1, x + Mix); ++qx, ++voters)
          ++chose[int(choice[layout.at(qx, qy)])];
      double c[3], deviation, sigma = 0;
      for (int k = 0; k < 3; ++k)
        c[k] = a.tile.color[k][q];
      const bool valid = a.tile.penalty[q] == 0;
      if (hit && !valid && a.scales > 0) // no value of its own: the smallest kernel's
      {
        chose[1] += chose[0];
        chose[0] = 0;
      }
      deviation = std::sqrt(double(a.tile.variance[q])) * (hit ? double(chose[0]) / voters : 1.);
      for (int s = 1; hit && s <= a.scales; ++s)
        if (chose[s] > 0)
        {
          const ScalePlanes& f = a.scale[s - 1];
          const double part = double(chose[s]) / voters;
          for (int k = 0; k < 3; ++k)
            c[k] += part * (double(f.color[k][i]) - a.tile.color[k][q]);
          deviation += part * std::sqrt(double(f.variance[i]));
          sigma += part * SigmaOf(s);
        }
      if (out.radiance)
        for (int k = 0; k < 3; ++k)
          out.radiance.at(x, y)[k] = float(c[k]);
      if (out.variance)
        *out.variance.at(x, y) = hit && chose[0] == voters ? a.tile.variance[q] : float(deviation * deviation);
      if (out.sigma)
        *out.sigma.at(x, y) = float(sigma);
      if (out.parts)
        for (int s = 0; s <= MostScales; ++s)
          out.parts.at(x, y)[s] = hit ? float(chose[s]) / float(voters) : s == 0 ? 1.f : 0.f;
    }
  return bad;
}

VarianceSteeredPixel VarianceSteeredVector(
  const VarianceSteeredInputs& in, const VarianceSteeredParameters& p, int scale, int x, int y, float* scratch) noexcept
{
  std::int64_t bad = 0;
  SteeredRow a;
  FilterScales(in, p, { x, y, x + 1, y + 1 }, scratch, a, bad);
  const auto i = a.results.at(x, y);
  const ScalePlanes& f = a.scale[scale - 1];
  return { { f.color[0][i], f.color[1][i], f.color[2][i] }, f.variance[i], f.centre[i] };
}

void VarianceSteeredWeights(const VarianceSteeredInputs& in, const VarianceSteeredParameters& p, const float* parts,
  int x, int y, const ImageOut& weights) noexcept
{
  const GuidedInputs guides = Guided(in, p);
  const Rect& e = weights.extent;
  for (int qy = e.y0; qy < e.y1; ++qy)
    for (int qx = e.x0; qx < e.x1; ++qx)
      *weights.at(qx, qy) = 0;
  const auto own = [&](double part) { AddFilledWeight(in.radiance, x, y, part, weights); };
  if (parts[0] > 0)
    own(double(parts[0]));
  for (int scale = 1; scale <= ScalesOf(p); ++scale)
  {
    if (!(parts[scale] > 0))
      continue;
    const int r = VarianceSteeredRadius(scale);
    const Rect taps = Rect{ x - r, y - r, x + r + 1, y + r + 1 }.clipped(in.radiance.extent);
    const auto weight = [&](int qx, int qy)
    {
      if (!GuideCounts(guides, qx, qy))
        return 0.;
      const double exponent = GuideExponentBetween(guides, x, y, guides, qx, qy);
      return exponent > 80 ? 0.
                           : std::exp(-exponent - ((qx - x) * (qx - x) + (qy - y) * (qy - y)) /
                                                    (2 * SigmaOf(scale) * SigmaOf(scale)));
    };
    double sum = 0;
    for (int qy = taps.y0; qy < taps.y1; ++qy)
      for (int qx = taps.x0; qx < taps.x1; ++qx)
        sum += weight(qx, qy);
    if (!(sum > 1e-30))
    {
      own(double(parts[scale]));
      continue;
    }
    for (int qy = taps.y0; qy < taps.y1; ++qy)
      for (int qx = taps.x0; qx < taps.x1; ++qx)
        if (e.contains(qx, qy))
          *weights.at(qx, qy) += float(double(parts[scale]) * weight(qx, qy) / sum);
  }
}

VarianceSteeredPixel VarianceSteeredScalar(
  const VarianceSteeredInputs& in, const VarianceSteeredParameters& p, int scale, int x, int y) noexcept
{
  const GuidedInputs guides = Guided(in, p);
  VarianceSteeredPixel out;
  float c[3];
  ReadFilled(in.radiance, x, y, c);
  const int r = VarianceSteeredRadius(scale);
  double sw = 0, sv = 0, sc[3] = {};
  for (int qy = y - r; qy <= y + r; ++qy)
    for (int qx = x - r; qx <= x + r; ++qx)
    {
      if (!GuideCounts(guides, qx, qy))
        continue;
      double e = GuideExponentBetween(guides, x, y, guides, qx, qy);
      const double w = (e <= 80 ? std::exp(-e) : 0) *
                       std::exp(-((qx - x) * (qx - x) + (qy - y) * (qy - y)) / (2 * SigmaOf(scale) * SigmaOf(scale)));
      sw += w;
      sv += w * w * ReadCleanVariance(in.variance, qx, qy);
      for (int k = 0; k < 3; ++k)
        sc[k] += w * (double(in.radiance.at(qx, qy)[k]) - c[k]);
    }
  for (int k = 0; k < 3; ++k)
    out.Color[k] = c[k] + (sw > 0 ? sc[k] / sw : 0);
  out.Variance = sw > 0 ? sv / (sw * sw) : ReadCleanVariance(in.variance, x, y);
  out.Centre = GuideCounts(guides, x, y) ? 1 / sw : 0;
  return out;
}
}
#endif
