// SPDX-License-Identifier: BSD-3-Clause
#include "quellATrous.h"

#include "quellGuards.h"

#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellATrous.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "hwy/contrib/math/math-inl.h"
#include "quellLanes.hxx"

#ifndef quellATrous_once
#define quellATrous_once
namespace quell
{
namespace
{
constexpr float ATrousKernel[5] = { 1 / 16.f, 1 / 4.f, 3 / 8.f, 1 / 4.f, 1 / 16.f };
constexpr float DepthTiny = 1e-30f;   // keeps 0 / 0 out where depth and slope are both 0
constexpr float LeastWeight = 1e-18f; // a smaller sum is no tap at all; its square is still a normal number

enum class NormalWeight
{
  None,
  Power128,  // the usual exponent: its seven squarings are unrolled
  Squarings, // sigma is another power of two
  Power
};

/// sigma = 2^k, k in [0, 10]; else -1.
int Squarings(float sigma) noexcept
{
  for (int k = 0; k <= 10; ++k)
    if (sigma == float(1 << k))
      return k;
  return -1;
}
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
template <NormalWeight Normals, bool HasId, bool HasVariance>
void RowOf(const ATrousPass& a, int y, int x0, int x1)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const PlaneLayout& layout = a.guides.layout;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), log2e = hn::Set(d, Log2E);
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  const float s = float(a.step);
  const V depthScale = hn::Set(d, a.sigmaDepth * s), depthEpsilon = hn::Set(d, a.depthEpsilon);
  constexpr bool squares = Normals == NormalWeight::Squarings || Normals == NormalWeight::Power128;
  const int squarings = squares ? Squarings(a.sigmaNormal) : 0;
  // Below this cosine its power is below 2^-120: counted as 0, before the squarings reach denormal numbers.
  const V leastCosine = hn::Set(d, squares ? std::exp2(-120.f / a.sigmaNormal) : 0.f);
  const V sigmaNormal = hn::Set(d, a.sigmaNormal);

  const auto first = layout.at(x0, y);
  const int count = x1 - x0;
  for (int i = 0; i < count; i += lanes)
  {
    const auto p = first + i;
    const V z = hn::LoadU(d, a.guides.depth + p);
    const auto hit = hn::Lt(z, inf);
    const V r = hn::LoadU(d, a.in.color[0] + p), g = hn::LoadU(d, a.in.color[1] + p),
            b = hn::LoadU(d, a.in.color[2] + p);
    const V lumIn = hn::LoadU(d, a.in.luminance + p);
    V varIn = zero;
    if (HasVariance)
      varIn = hn::LoadU(d, a.in.variance + p);
    if (hn::AllFalse(d, hit))
    {
      hn::StoreU(r, d, a.out.color[0] + p);
      hn::StoreU(g, d, a.out.color[1] + p);
      hn::StoreU(b, d, a.out.color[2] + p);
      hn::StoreU(lumIn, d, a.out.luminance + p);
      if (HasVariance)
        hn::StoreU(varIn, d, a.out.variance + p);
      continue;
    }
    const auto valid = hn::Lt(lumIn, inf);
    const V l = hn::IfThenElseZero(valid, lumIn);

    // 1 / sL in units of log2(e); 0 (wl = 1) where the centre is not valid.
    V sigma;
    if (HasVariance)
    {
      V sum = zero, weight = zero;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
        {
          const V v = hn::LoadU(d, a.in.variance + p + dy * layout.stride + dx);
          const V k = hn::Set(d, (dx ? 1.f : 2.f) * (dy ? 1.f : 2.f) / 16.f);
          sum = hn::MulAdd(k, hn::Max(v, zero), sum);
          weight = hn::Add(weight, hn::IfThenElseZero(hn::Ge(v, zero), k));
        }
      // No tap at all: the variance is unknown, 0.
      const V mean = hn::IfThenElseZero(hn::Gt(weight, zero), hn::Div(sum, weight));
      sigma = hn::Mul(hn::Set(d, a.sigmaLuminance), hn::Sqrt(mean));
    }
    else
      sigma = hn::Set(d, a.fixedSigma);
    sigma = hn::MulAdd(hn::Set(d, a.luminanceEpsilon), hn::Add(one, hn::Abs(l)), sigma);
    const V invSigma = hn::IfThenElseZero(valid, hn::Div(log2e, sigma));

    // 1 / depth tolerance, in units of log2(e), of the 12 directions (the other 12 are their opposites).
    const V gx = hn::Mul(hn::LoadU(d, a.guides.slopeX + p), depthScale);
    const V gy = hn::Mul(hn::LoadU(d, a.guides.slopeY + p), depthScale);
    const V base = hn::MulAdd(depthEpsilon, hn::Abs(z), hn::Set(d, DepthTiny));
    V invDepth[12];
    for (int k = 0; k < 12; ++k)
    {
      const float dx = float(k % 5 - 2), dy = float(k / 5 - 2);
      const V along = hn::MulAdd(gx, hn::Set(d, dx), hn::Mul(gy, hn::Set(d, dy)));
      invDepth[k] = hn::Div(log2e, hn::Add(hn::Abs(along), base));
    }

    V nx = zero, ny = zero, nz = zero;
    if (Normals != NormalWeight::None)
    {
      nx = hn::LoadU(d, a.guides.normal[0] + p);
      ny = hn::LoadU(d, a.guides.normal[1] + p);
      nz = hn::LoadU(d, a.guides.normal[2] + p);
    }
    V id = zero;
    if (HasId)
      id = hn::LoadU(d, a.guides.id + p);

    V sw = zero, sr = zero, sg = zero, sb = zero, sv = zero;
    const auto tap = [&](std::ptrdiff_t q, float h, V invZ) HWY_ATTR
    {
      const V lq = hn::LoadU(d, a.in.luminance + q);
      const V zq = hn::LoadU(d, a.guides.depth + q);
      V e = hn::Mul(hn::Abs(hn::Sub(z, zq)), invZ);
      e = hn::MulAdd(hn::Abs(hn::Sub(l, lq)), invSigma, e);
      V w;
      if (Normals != NormalWeight::None)
      {
        V cosine = hn::Mul(nx, hn::LoadU(d, a.guides.normal[0] + q));
        cosine = hn::MulAdd(ny, hn::LoadU(d, a.guides.normal[1] + q), cosine);
        cosine = hn::MulAdd(nz, hn::LoadU(d, a.guides.normal[2] + q), cosine);
        cosine = hn::Min(cosine, one);
        if (squares)
        {
          cosine = hn::IfThenElseZero(hn::Gt(cosine, leastCosine), cosine);
          for (int k = 0; k < (Normals == NormalWeight::Power128 ? 7 : squarings); ++k)
            cosine = hn::Mul(cosine, cosine);
          w = hn::Mul(hn::Mul(hn::Set(d, h), cosine), NegExp2(d, e));
        }
        else
        {
          const auto forward = hn::Gt(cosine, zero);
          e = hn::NegMulAdd(sigmaNormal, hn::Log2(d, hn::IfThenElse(forward, cosine, one)), e);
          w = hn::Mul(hn::Set(d, h), hn::IfThenElseZero(forward, NegExp2(d, hn::Max(e, zero))));
        }
      }
      else
        w = hn::Mul(hn::Set(d, h), NegExp2(d, e));
      if (HasId)
        w = hn::IfThenElseZero(hn::Eq(id, hn::LoadU(d, a.guides.id + q)), w);
      sw = hn::Add(sw, w);
      sr = hn::MulAdd(w, hn::Sub(hn::LoadU(d, a.in.color[0] + q), r), sr);
      sg = hn::MulAdd(w, hn::Sub(hn::LoadU(d, a.in.color[1] + q), g), sg);
      sb = hn::MulAdd(w, hn::Sub(hn::LoadU(d, a.in.color[2] + q), b), sb);
      if (HasVariance)
        sv = hn::MulAdd(hn::Mul(w, w), hn::LoadU(d, a.in.variance + q), sv);
    };
    for (int dy = -2; dy <= 2; ++dy)
    {
      const int qy = y + dy * a.step;
      if (qy < layout.extent.y0 || qy >= layout.extent.y1)
        continue;
      const auto q = p + dy * std::ptrdiff_t(a.step) * layout.stride;
      const float h = ATrousKernel[dy + 2];
      const int k = (dy + 2) * 5;
      for (int dx = -2; dx <= 2; ++dx)
      {
        if (dx == 0 && dy == 0)
        {
          const V w = hn::IfThenElseZero(valid, hn::Set(d, 9 / 64.f));
          sw = hn::Add(sw, w);
          if (HasVariance)
            sv = hn::MulAdd(hn::Mul(w, w), varIn, sv);
          continue;
        }
        const int index = k + dx + 2;
        tap(q + dx * a.step, h * ATrousKernel[dx + 2], invDepth[index < 12 ? index : 24 - index]);
      }
    }
    const auto some = hn::And(hit, hn::Gt(sw, hn::Set(d, LeastWeight)));
    const V inv = hn::Div(one, hn::IfThenElse(some, sw, one));
    const V ro = hn::IfThenElse(some, hn::MulAdd(sr, inv, r), r);
    const V go = hn::IfThenElse(some, hn::MulAdd(sg, inv, g), g);
    const V bo = hn::IfThenElse(some, hn::MulAdd(sb, inv, b), b);
    hn::StoreU(ro, d, a.out.color[0] + p);
    hn::StoreU(go, d, a.out.color[1] + p);
    hn::StoreU(bo, d, a.out.color[2] + p);
    V lo = hn::MulAdd(hn::Set(d, 0.7152f), go, hn::Mul(hn::Set(d, 0.0722f), bo));
    lo = hn::MulAdd(hn::Set(d, 0.2126f), ro, lo);
    lo = hn::Min(hn::Max(lo, hn::Set(d, -1e38f)), hn::Set(d, 1e38f));
    hn::StoreU(hn::IfThenElse(some, lo, lumIn), d, a.out.luminance + p);
    if (HasVariance)
      hn::StoreU(hn::IfThenElse(some, hn::Mul(hn::Mul(sv, inv), inv), varIn), d, a.out.variance + p);
  }
}

template <NormalWeight Normals, bool HasId>
void RowWith(const ATrousPass& a, int y, int x0, int x1)
{
  if (a.in.variance)
    RowOf<Normals, HasId, true>(a, y, x0, x1);
  else
    RowOf<Normals, HasId, false>(a, y, x0, x1);
}

template <NormalWeight Normals>
void RowWith(const ATrousPass& a, int y, int x0, int x1)
{
  if (a.guides.id)
    RowWith<Normals, true>(a, y, x0, x1);
  else
    RowWith<Normals, false>(a, y, x0, x1);
}

void ATrousRowImpl(const ATrousPass& a, int y, int x0, int x1)
{
  if (!a.guides.normal[0] || a.sigmaNormal == 0)
    RowWith<NormalWeight::None>(a, y, x0, x1);
  else if (a.sigmaNormal == 128)
    RowWith<NormalWeight::Power128>(a, y, x0, x1);
  else if (Squarings(a.sigmaNormal) >= 0)
    RowWith<NormalWeight::Squarings>(a, y, x0, x1);
  else
    RowWith<NormalWeight::Power>(a, y, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(ATrousRowImpl);

void ATrousRow(const ATrousPass& pass, int y, int x0, int x1) noexcept
{
  HWY_DYNAMIC_DISPATCH(ATrousRowImpl)(pass, y, x0, x1);
}

void ATrousRowScalar(const ATrousPass& a, int y, int x0, int x1) noexcept
{
  const PlaneLayout& layout = a.guides.layout;
  const float inf = std::numeric_limits<float>::infinity();
  for (int x = x0; x < x1; ++x)
  {
    const auto p = layout.at(x, y);
    const float z = a.guides.depth[p], lumIn = a.in.luminance[p];
    for (int c = 0; c < 3; ++c)
      a.out.color[c][p] = a.in.color[c][p];
    a.out.luminance[p] = lumIn;
    if (a.in.variance)
      a.out.variance[p] = a.in.variance[p];
    if (!(z < inf))
      continue;
    const bool valid = lumIn < inf;
    const float l = valid ? lumIn : 0.f;
    float sigma = a.fixedSigma;
    if (a.in.variance)
    {
      float sum = 0, weight = 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
        {
          const float v = a.in.variance[layout.at(x + dx, y + dy)];
          const float k = (dx ? 1.f : 2.f) * (dy ? 1.f : 2.f) / 16.f;
          if (v >= 0)
          {
            sum += k * v;
            weight += k;
          }
        }
      sigma = a.sigmaLuminance * std::sqrt(SafeDivide(sum, weight));
    }
    sigma += a.luminanceEpsilon * (1 + std::fabs(l));
    float sw = 0, sv = 0, sc[3] = {};
    for (int dy = -2; dy <= 2; ++dy)
      for (int dx = -2; dx <= 2; ++dx)
      {
        const int qx = x + dx * a.step, qy = y + dy * a.step;
        if (!layout.extent.contains(qx, qy))
          continue;
        const auto q = layout.at(qx, qy);
        float w = ATrousKernel[dx + 2] * ATrousKernel[dy + 2];
        if (!(a.in.luminance[q] < inf) || !(a.guides.depth[q] < inf))
          continue;
        if (dx != 0 || dy != 0)
        {
          if (a.guides.id && a.guides.id[p] != a.guides.id[q])
            continue;
          const float along = a.step * (a.guides.slopeX[p] * dx + a.guides.slopeY[p] * dy);
          float e = std::fabs(z - a.guides.depth[q]) /
                    (a.sigmaDepth * std::fabs(along) + a.depthEpsilon * std::fabs(z) + DepthTiny);
          if (valid)
            e += std::fabs(l - a.in.luminance[q]) / sigma;
          if (a.guides.normal[0])
          {
            float cosine = 0;
            for (int c = 0; c < 3; ++c)
              cosine += a.guides.normal[c][p] * a.guides.normal[c][q];
            w *= CosinePower(cosine, a.sigmaNormal);
          }
          w *= NegativeExp(e);
        }
        sw += w;
        for (int c = 0; c < 3; ++c)
          sc[c] += w * (a.in.color[c][q] - a.in.color[c][p]);
        if (a.in.variance)
          sv += w * w * a.in.variance[q];
      }
    if (!(sw > LeastWeight))
      continue;
    for (int c = 0; c < 3; ++c)
      a.out.color[c][p] += sc[c] / sw;
    a.out.luminance[p] = FilterLuminance(a.out.color[0][p], a.out.color[1][p], a.out.color[2][p]);
    if (a.in.variance)
      a.out.variance[p] = sv / sw / sw;
  }
}
}
#endif
