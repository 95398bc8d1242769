// SPDX-License-Identifier: BSD-3-Clause
#include "quellVariance.h"

#include "quellGuards.h"

#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellVariance.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "hwy/contrib/math/math-inl.h"
#include "quellLanes.hxx"

#ifndef quellVariance_once
#define quellVariance_once
namespace quell
{
namespace
{
constexpr float VarianceDepthTiny = 1e-30f;
constexpr float LargestDifference = 1e18f; // its square, 49 times, is still a float
constexpr float LargestStep = 1e34f;       // colour differences: 49 of them do not overflow either
constexpr float AloneWeight = 0.01f;
constexpr float LargestMoment = 1e36f;
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
/// `TwoFloats`: means have a rest.
template <bool TwoFloats>
void VarianceRowOf(const VariancePass& a, int y, int x0, int x1)
{
  constexpr int R = VariancePass::Radius, Side = 2 * R + 1;
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const PlaneLayout& layout = a.guides.layout;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), log2e = hn::Set(d, Log2E);
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  const V largest = hn::Set(d, LargestDifference);
  const V step = hn::Set(d, LargestStep), minusStep = hn::Set(d, -LargestStep);
  const bool normals = a.guides.normal[0] && a.sigmaNormal != 0;
  const V sigmaNormal = hn::Set(d, a.sigmaNormal);
  // The usual exponents are powers of two: that many squarings, of cosines whose power is at least 2^-120.
  int squarings = -1;
  for (int k = 0; k <= 10; ++k)
    squarings = a.sigmaNormal == float(1 << k) ? k : squarings;
  const V leastCosine = hn::Set(d, squarings >= 0 ? std::exp2(-120.f / a.sigmaNormal) : 0.f);
  const float* mean = a.moments.mean ? a.moments.mean : a.in.luminance;
  const float* rest = a.moments.rest;
  const auto first = layout.at(x0, y);

  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    const V z = hn::LoadU(d, a.guides.depth + p);
    const auto hit = hn::Lt(z, inf);
    const V h = a.moments.history ? hn::Max(hn::LoadU(d, a.moments.history + p), one) : one;
    const V c[3] = { hn::LoadU(d, a.in.color[0] + p), hn::LoadU(d, a.in.color[1] + p),
      hn::LoadU(d, a.in.color[2] + p) };
    const V lumIn = hn::LoadU(d, a.in.luminance + p);
    const auto valid = hn::Lt(lumIn, inf);
    V variance = a.moments.central ? hn::LoadU(d, a.moments.central + p) : zero;
    V co[3] = { c[0], c[1], c[2] };
    const V least = hn::Set(d, a.minimumHistory);
    // An invalid centre has no moments of its own, whatever its history.
    const auto spatial = a.moments.central ? hn::And(hit, hn::Or(hn::Lt(h, least), hn::Not(valid))) : hit;
    if (!hn::AllFalse(d, spatial))
    {
      const V scale = hn::Set(d, a.sigmaDepth);
      const V gx = hn::Mul(hn::LoadU(d, a.guides.slopeX + p), scale);
      const V gy = hn::Mul(hn::LoadU(d, a.guides.slopeY + p), scale);
      const V base = hn::MulAdd(hn::Set(d, a.depthEpsilon), hn::Abs(z), hn::Set(d, VarianceDepthTiny));
      const V meanIn = hn::LoadU(d, mean + p);
      // Shift by the centre's mean so that the sum of differences is small; 0 where the centre has none.
      const V shift = hn::IfThenElseZero(valid, meanIn);
      const V restShift = TwoFloats ? hn::IfThenElseZero(valid, hn::LoadU(d, rest + p)) : zero;
      const auto shifted = [&](std::ptrdiff_t q) HWY_ATTR
      {
        const V difference = hn::Sub(hn::LoadU(d, mean + q), shift);
        return TwoFloats ? hn::Add(difference, hn::Sub(hn::LoadU(d, rest + q), restShift)) : difference;
      };
      HWY_ALIGN float weights[Side * Side * 64];
      V sw = zero, sm = zero, sc[3] = { zero, zero, zero };
      V centre = zero;
      for (int dy = -R; dy <= R; ++dy)
      {
        const int qy = y + dy;
        float* row = weights + (dy + R) * Side * lanes;
        if (qy < layout.extent.y0 || qy >= layout.extent.y1)
        {
          for (int k = 0; k < Side; ++k)
            hn::Store(zero, d, row + k * lanes);
          continue;
        }
        for (int dx = -R; dx <= R; ++dx)
        {
          const auto q = p + dy * layout.stride + dx;
          const V lq = hn::LoadU(d, a.in.luminance + q);
          V w;
          if (dx == 0 && dy == 0)
          {
            w = hn::IfThenElseZero(valid, one);
            centre = w;
          }
          else
          {
            const V zq = hn::LoadU(d, a.guides.depth + q);
            const V along = hn::MulAdd(gx, hn::Set(d, float(dx)), hn::Mul(gy, hn::Set(d, float(dy))));
            V e = hn::Mul(hn::Abs(hn::Sub(z, zq)), hn::Div(log2e, hn::Add(hn::Abs(along), base)));
            V facing = one;
            auto keep = hn::And(hn::Lt(lq, inf), hn::Lt(zq, inf));
            if (normals)
            {
              V cosine = hn::Mul(hn::LoadU(d, a.guides.normal[0] + p), hn::LoadU(d, a.guides.normal[0] + q));
              cosine = hn::MulAdd(hn::LoadU(d, a.guides.normal[1] + p), hn::LoadU(d, a.guides.normal[1] + q), cosine);
              cosine = hn::MulAdd(hn::LoadU(d, a.guides.normal[2] + p), hn::LoadU(d, a.guides.normal[2] + q), cosine);
              const auto forward = hn::Gt(cosine, leastCosine);
              cosine = hn::IfThenElse(forward, hn::Min(cosine, one), one);
              keep = hn::And(keep, forward);
              if (squarings >= 0)
              {
                for (int k = 0; k < squarings; ++k)
                  cosine = hn::Mul(cosine, cosine);
                facing = cosine;
              }
              else
                e = hn::NegMulAdd(sigmaNormal, hn::Log2(d, cosine), e);
            }
            if (a.guides.id)
              keep = hn::And(keep, hn::Eq(hn::LoadU(d, a.guides.id + p), hn::LoadU(d, a.guides.id + q)));
            w = hn::IfThenElseZero(keep, hn::Mul(facing, NegExp2(d, hn::Max(e, zero))));
          }
          hn::Store(w, d, row + (dx + R) * lanes);
          sw = hn::Add(sw, w);
          for (int k = 0; k < 3; ++k)
          {
            const V delta = hn::Sub(hn::LoadU(d, a.in.color[k] + q), c[k]);
            sc[k] = hn::MulAdd(w, hn::Min(hn::Max(delta, minusStep), step), sc[k]);
          }
          const V m = hn::IfThenElseZero(hn::Gt(w, zero), shifted(q));
          sm = hn::MulAdd(w, m, sm);
        }
      }
      const auto some = hn::Gt(sw, hn::Set(d, 1e-18f));
      const V inv = hn::Div(one, hn::IfThenElse(some, sw, one));
      const V m = hn::MulAdd(sm, inv, shift), offset = hn::Mul(sm, inv);
      V sv = zero;
      for (int dy = -R; dy <= R; ++dy)
        for (int dx = -R; dx <= R; ++dx)
        {
          const int qy = y + dy;
          if (qy < layout.extent.y0 || qy >= layout.extent.y1)
            continue;
          const auto q = p + dy * layout.stride + dx;
          const V w = hn::Load(d, weights + ((dy + R) * Side + dx + R) * lanes);
          V delta = TwoFloats ? hn::Sub(hn::IfThenElse(hn::Gt(w, zero), shifted(q), offset), offset)
                              : hn::Sub(hn::IfThenElse(hn::Gt(w, zero), hn::LoadU(d, mean + q), m), m);
          delta = hn::Min(hn::Abs(delta), largest);
          V v = hn::Mul(delta, delta);
          if (a.moments.central)
            v = hn::Add(v, hn::LoadU(d, a.moments.central + q));
          sv = hn::MulAdd(w, v, sv);
        }
      const auto alone = hn::Lt(hn::Sub(sw, centre), hn::Set(d, AloneWeight));
      const V boost = hn::Max(one, hn::Div(least, h));
      const V lone = hn::Min(hn::Abs(hn::IfThenElse(valid, lumIn, m)), largest);
      const V estimate = hn::IfThenElse(alone, hn::Mul(lone, lone), hn::Mul(hn::Mul(sv, inv), boost));
      variance = hn::IfThenElse(spatial, estimate, variance);
      const auto replace = hn::And(spatial, some);
      for (int k = 0; k < 3; ++k)
        co[k] = hn::IfThenElse(replace, hn::MulAdd(sc[k], inv, c[k]), c[k]);
    }
    if (a.ofMean)
      variance = hn::Div(variance, hn::Min(h, hn::Set(d, a.maximumSamples)));
    for (int k = 0; k < 3; ++k)
      if (a.out.color[k])
        hn::StoreU(co[k], d, a.out.color[k] + p);
    hn::StoreU(hn::IfThenElse(hit, variance, hn::Set(d, -1.f)), d, a.out.variance + p);
  }
}

void VarianceRowImpl(const VariancePass& a, int y, int x0, int x1)
{
  if (a.moments.rest)
    VarianceRowOf<true>(a, y, x0, x1);
  else
    VarianceRowOf<false>(a, y, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(VarianceRowImpl);

void VarianceRow(const VariancePass& pass, int y, int x0, int x1) noexcept
{
  HWY_DYNAMIC_DISPATCH(VarianceRowImpl)(pass, y, x0, x1);
}

void CopyMoments(const ImageIn& moments, const ImageIn& history, const ImageIn& meanRest, const PlaneLayout& layout,
  const ColorPlanes& color, const MomentPlanes& planes, float unknownHistory, int y0, int y1) noexcept
{
  const Rect& e = layout.extent;
  for (int y = y0; y < y1; ++y)
  {
    const auto row = layout.at(e.x0, y);
    // Lanes beyond the row must read numbers.
    for (float* plane : { planes.mean, planes.central, planes.history, planes.rest })
      if (plane)
      {
        std::fill(plane + row - layout.pad, plane + row, 0.f);
        std::fill(plane + row + e.width(), plane + row - layout.pad + layout.stride, 0.f);
      }
    for (int i = 0; i < e.width(); ++i)
    {
      float h = unknownHistory;
      if (history)
      {
        h = *history.at(e.x0 + i, y);
        h = Finite(h) && h > 0 ? h : 0.f;
      }
      if (moments)
      {
        const float* m = moments.at(e.x0 + i, y);
        const bool good = Finite(m[0]) && m[1] == m[1];
        const float l = color.luminance[row + i];
        float mean = good ? m[0] : l <= LargestMoment ? l : 0.f;
        mean = mean > LargestMoment ? LargestMoment : mean < -LargestMoment ? -LargestMoment : mean;
        planes.mean[row + i] = mean;
        planes.central[row + i] = good && m[1] > 0 ? (m[1] < LargestMoment ? m[1] : LargestMoment) : 0.f;
        h = good ? h : 0.f;
        if (planes.rest)
        {
          // The rest of a mean that is limited, or is the luminance, would be another one's.
          const float r = meanRest && mean == m[0] ? *meanRest.at(e.x0 + i, y) : 0.f;
          planes.rest[row + i] = Finite(r) ? std::min(std::max(r, -LargestMoment), LargestMoment) : 0.f;
        }
      }
      if (planes.history)
        planes.history[row + i] = h;
    }
  }
}

bool VarianceOverFrames(const VariancePass& a, const ImageIn& color, const ImageIn& moments, const ImageIn& history,
  const ImageIn& depth, const ImageOut& radiance, const ImageOut& variance, const Rect& tile) noexcept
{
  constexpr float Inf = std::numeric_limits<float>::infinity();
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    const float *c = color.at(tile.x0, y), *m = moments.at(tile.x0, y);
    const float* h = history ? history.at(tile.x0, y) : nullptr;
    const float* z = depth ? depth.at(tile.x0, y) : nullptr;
    float* v = variance ? variance.at(tile.x0, y) : nullptr;
    int young = 0;
    for (int i = 0; i < tile.width(); ++i)
    {
      const bool hit = !z || std::fabs(z[i]) < Inf;
      const float frames = h ? (h[i] > 1.f ? h[i] : 1.f) : a.minimumHistory;
      young |= !(Finite(c[3 * i]) & Finite(c[3 * i + 1]) & Finite(c[3 * i + 2]) & Finite(m[2 * i]) &
                 (m[2 * i + 1] == m[2 * i + 1]) & (frames < Inf) & (!hit | (frames >= a.minimumHistory)));
      if (v)
      {
        const float central = m[2 * i + 1] > 0 ? (m[2 * i + 1] < LargestMoment ? m[2 * i + 1] : LargestMoment) : 0.f;
        const float trusted = a.ofMean ? central / std::min(std::max(frames, 1.f), a.maximumSamples) : central;
        v[i] = hit && trusted > 0 ? trusted : 0.f;
      }
    }
    if (young)
      return false;
    if (radiance)
      std::copy(c, c + 3 * tile.width(), radiance.at(tile.x0, y));
  }
  return true;
}

void VarianceRowScalar(const VariancePass& a, int y, int x0, int x1) noexcept
{
  constexpr int R = VariancePass::Radius;
  const PlaneLayout& layout = a.guides.layout;
  const float inf = std::numeric_limits<float>::infinity();
  const float* mean = a.moments.mean ? a.moments.mean : a.in.luminance;
  const auto meanAt = [&](std::ptrdiff_t q) { return mean[q] + (a.moments.rest ? double(a.moments.rest[q]) : 0.); };
  for (int x = x0; x < x1; ++x)
  {
    const auto p = layout.at(x, y);
    const float z = a.guides.depth[p];
    for (int c = 0; c < 3; ++c)
      if (a.out.color[c])
        a.out.color[c][p] = a.in.color[c][p];
    a.out.variance[p] = -1;
    if (!(z < inf))
      continue;
    const float h = a.moments.history ? std::max(a.moments.history[p], 1.f) : 1.f;
    const bool valid = a.in.luminance[p] < inf;
    float variance = a.moments.central ? a.moments.central[p] : 0.f;
    if (h < a.minimumHistory || !valid || !a.moments.central)
    {
      double sw = 0, sm = 0, sc[3] = {}, others = 0;
      float weights[(2 * R + 1) * (2 * R + 1)] = {};
      for (int pass = 0; pass < 2; ++pass)
      {
        const double m = pass ? sm / (sw > 0 ? sw : 1) : 0;
        double sv = 0;
        int k = 0;
        for (int dy = -R; dy <= R; ++dy)
          for (int dx = -R; dx <= R; ++dx, ++k)
          {
            if (!layout.extent.contains(x + dx, y + dy))
              continue;
            const auto q = layout.at(x + dx, y + dy);
            if (pass == 1)
            {
              if (weights[k] > 0)
              {
                const double delta = std::min(std::fabs(meanAt(q) - m), double(LargestDifference));
                sv += weights[k] * ((a.moments.central ? a.moments.central[q] : 0.) + delta * delta);
              }
              continue;
            }
            if (!(a.in.luminance[q] < inf) || !(a.guides.depth[q] < inf))
              continue;
            float w = 1;
            if (q != p)
            {
              if (a.guides.id && a.guides.id[p] != a.guides.id[q])
                continue;
              const float along = a.guides.slopeX[p] * dx + a.guides.slopeY[p] * dy;
              w = NegativeExp(std::fabs(z - a.guides.depth[q]) /
                              (a.sigmaDepth * std::fabs(along) + a.depthEpsilon * std::fabs(z) + VarianceDepthTiny));
              if (a.guides.normal[0])
              {
                double cosine = 0; // its error is multiplied by sigmaNormal
                for (int c = 0; c < 3; ++c)
                  cosine += double(a.guides.normal[c][p]) * a.guides.normal[c][q];
                w *= CosinePower(cosine, a.sigmaNormal);
              }
              others += w;
            }
            weights[k] = w;
            sw += w;
            if (w > 0)
              sm += double(w) * meanAt(q);
            for (int c = 0; c < 3; ++c)
            {
              const double delta = double(a.in.color[c][q]) - a.in.color[c][p];
              sc[c] += double(w) * std::min(std::max(delta, -double(LargestStep)), double(LargestStep));
            }
          }
        if (pass == 1)
        {
          const double lone = std::min(std::fabs(valid ? a.in.luminance[p] : m), double(LargestDifference));
          variance = others < AloneWeight ? float(lone * lone) : float(sv / sw) * std::max(1.f, a.minimumHistory / h);
        }
      }
      if (sw > 1e-18)
        for (int c = 0; c < 3; ++c)
          if (a.out.color[c])
            a.out.color[c][p] += float(sc[c] / sw);
    }
    if (a.ofMean)
      variance /= std::min(h, a.maximumSamples);
    a.out.variance[p] = variance;
  }
}
}
#endif
