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

/// The 12 directions of the taps above a pixel or right of it; the other 12 taps are their opposites.
constexpr int Directions = 12;
constexpr int DirectionX[Directions] = { 1, 2, -2, -1, 0, 1, 2, -2, -1, 0, 1, 2 };
constexpr int DirectionY[Directions] = { 0, 0, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2 };
constexpr int Chunk = 640;      // columns at a time: what rows share about them lies in the nearer caches
constexpr int SharedReach = 64; // pixels that a pair may span horizontally to be computed once for both ends

constexpr float DirectionWeight(int k) noexcept
{
  return ATrousKernel[DirectionX[k] + 2] * ATrousKernel[DirectionY[k] + 2];
}

/// The row of a tap; outside of the image the padding below, whose luminance says weight 0.
int TapRow(const PlaneLayout& layout, int y) noexcept
{
  return y >= layout.extent.y0 && y < layout.extent.y1 ? y : layout.extent.y0 - 1;
}

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
/// What the two pixels of a pair share, the same bits from either end: h wn, 0 between different ids. Of `count` pairs
/// with one end from p on and the other from q on.
template <NormalWeight Normals>
void Affinity(const ATrousPass& a, std::ptrdiff_t p, std::ptrdiff_t q, float h, int count, float* HWY_RESTRICT out)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const V one = hn::Set(d, 1.f), scale = hn::Set(d, h);
  constexpr bool squares = Normals == NormalWeight::Squarings || Normals == NormalWeight::Power128;
  const int squarings = Normals == NormalWeight::Power128 ? 7 : squares ? Squarings(a.sigmaNormal) : 0;
  // Below this cosine its power is below 2^-120: counted as 0, before the squarings reach denormal numbers.
  const V least = hn::Set(d, squares ? std::exp2(-120.f / a.sigmaNormal) : 0.f);
  const V sigma = hn::Set(d, a.sigmaNormal);
  const float *nx = a.guides.normal[0], *ny = a.guides.normal[1], *nz = a.guides.normal[2], *id = a.guides.id;
  constexpr int N = 4; // vectors in step: their chains of dependent operations are independent of each other
  for (int i = 0; i < count; i += N * lanes)
  {
    V c[N];
    for (int j = 0; j < N; ++j)
      c[j] = one;
    if (Normals != NormalWeight::None)
    {
      for (int j = 0; j < N; ++j)
        c[j] = hn::Mul(hn::LoadU(d, nx + p + i + j * lanes), hn::LoadU(d, nx + q + i + j * lanes));
      for (int j = 0; j < N; ++j)
        c[j] = hn::MulAdd(hn::LoadU(d, ny + p + i + j * lanes), hn::LoadU(d, ny + q + i + j * lanes), c[j]);
      for (int j = 0; j < N; ++j)
        c[j] = hn::MulAdd(hn::LoadU(d, nz + p + i + j * lanes), hn::LoadU(d, nz + q + i + j * lanes), c[j]);
      for (int j = 0; j < N; ++j)
        c[j] = hn::Min(c[j], one);
      for (int j = 0; j < N; ++j)
        c[j] = hn::IfThenElseZero(hn::Gt(c[j], least), c[j]);
      if (squares)
      {
        for (int k = 0; k < squarings; ++k)
          for (int j = 0; j < N; ++j)
            c[j] = hn::Mul(c[j], c[j]);
      }
      else
        for (int j = 0; j < N; ++j)
        {
          const auto forward = hn::Gt(c[j], hn::Zero(d));
          const V e = hn::Mul(sigma, hn::Log2(d, hn::IfThenElse(forward, c[j], one)));
          c[j] = hn::IfThenElseZero(forward, NegExp2(d, hn::Max(hn::Neg(e), hn::Zero(d))));
        }
    }
    for (int j = 0; j < N; ++j)
      c[j] = hn::Mul(scale, c[j]);
    if (id)
      for (int j = 0; j < N; ++j)
        c[j] =
          hn::IfThenElseZero(hn::Eq(hn::LoadU(d, id + p + i + j * lanes), hn::LoadU(d, id + q + i + j * lanes)), c[j]);
    for (int j = 0; j < N; ++j)
      hn::StoreU(c[j], d, out + i + j * lanes);
  }
}

/// 1 / sL in units of log2(e) of `count` pixels from p on; 0 (wl = 1) where the centre is not valid.
template <bool HasVariance>
void Tolerances(const ATrousPass& a, std::ptrdiff_t p, int count, float* HWY_RESTRICT out)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const std::ptrdiff_t stride = a.guides.layout.stride;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), two = hn::Set(d, 2.f), log2e = hn::Set(d, Log2E);
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  for (int i = 0; i < count; i += lanes)
  {
    const V lumIn = hn::LoadU(d, a.in.luminance + p + i);
    const auto valid = hn::Lt(lumIn, inf);
    V sigma = hn::Set(d, a.fixedSigma);
    if (HasVariance)
    {
      V sum[3], weight[3];
      for (int dy = 0; dy < 3; ++dy)
      {
        const float* HWY_RESTRICT row = a.in.variance + p + i + (dy - 1) * stride;
        const V v0 = hn::LoadU(d, row - 1), v1 = hn::LoadU(d, row), v2 = hn::LoadU(d, row + 1);
        sum[dy] = hn::MulAdd(two, hn::Max(v1, zero), hn::Add(hn::Max(v0, zero), hn::Max(v2, zero)));
        weight[dy] = hn::Add(hn::IfThenElseZero(hn::Ge(v1, zero), two),
          hn::Add(hn::IfThenElseZero(hn::Ge(v0, zero), one), hn::IfThenElseZero(hn::Ge(v2, zero), one)));
      }
      const V total = hn::MulAdd(two, sum[1], hn::Add(sum[0], sum[2]));
      const V weights = hn::MulAdd(two, weight[1], hn::Add(weight[0], weight[2]));
      // No tap at all: the variance is unknown, 0.
      const V mean = hn::IfThenElseZero(hn::Gt(weights, zero), hn::Div(total, weights));
      sigma = hn::Mul(hn::Set(d, a.sigmaLuminance), hn::Sqrt(mean));
    }
    const V l = hn::IfThenElseZero(valid, lumIn);
    sigma = hn::MulAdd(hn::Set(d, a.luminanceEpsilon), hn::Add(one, hn::Abs(l)), sigma);
    hn::StoreU(hn::IfThenElseZero(valid, hn::Div(log2e, sigma)), d, out + i);
  }
}

/// Pixels [x, x + count) of row y; up[k] and down[k]: affinity with the taps at +- direction k.
template <bool HasVariance>
void Centres(const ATrousPass& a, int x, int y, int count, const float* const* up, const float* const* down,
  const float* HWY_RESTRICT tolerance)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const PlaneLayout& layout = a.guides.layout;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), log2e = hn::Set(d, Log2E);
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  const float s = float(a.step);
  const V depthScale = hn::Set(d, a.sigmaDepth * s), depthEpsilon = hn::Set(d, a.depthEpsilon);

  const auto first = layout.at(x, y);
  std::ptrdiff_t offset[2 * Directions];
  for (int k = 0; k < Directions; ++k)
  {
    offset[2 * k] = layout.at(x + DirectionX[k] * a.step, TapRow(layout, y + DirectionY[k] * a.step)) - first;
    offset[2 * k + 1] = layout.at(x - DirectionX[k] * a.step, TapRow(layout, y - DirectionY[k] * a.step)) - first;
  }
  // Rows follow each other: what the next one reads and writes and this one does not (prefetchers follow fewer rows).
  const std::ptrdiff_t read = layout.at(x, TapRow(layout, y + 3 * a.step)) - first;
  const std::ptrdiff_t write = layout.at(x, TapRow(layout, y + a.step)) - first;
  const float* HWY_RESTRICT depth = a.guides.depth;
  const float* HWY_RESTRICT luminance = a.in.luminance;
  const float *HWY_RESTRICT red = a.in.color[0], *HWY_RESTRICT green = a.in.color[1],
                            *HWY_RESTRICT blue = a.in.color[2], *HWY_RESTRICT variance = a.in.variance;
  for (int i = 0; i < count; i += lanes)
  {
    const auto p = first + i;
    for (const float* plane : { depth, luminance, red, green, blue })
      __builtin_prefetch(plane + p + read);
    for (int c = 0; c < 3; ++c)
    {
      if (a.guides.normal[c])
        __builtin_prefetch(a.guides.normal[c] + p + read);
      __builtin_prefetch(a.out.color[c] + p + write, 1);
    }
    __builtin_prefetch(a.guides.slopeX + p + write);
    __builtin_prefetch(a.guides.slopeY + p + write);
    __builtin_prefetch(a.out.luminance + p + write, 1);
    if (HasVariance)
    {
      __builtin_prefetch(variance + p + read);
      __builtin_prefetch(a.out.variance + p + write, 1);
    }
    const V z = hn::LoadU(d, depth + p);
    const auto hit = hn::Lt(z, inf);
    const V r = hn::LoadU(d, red + p), g = hn::LoadU(d, green + p), b = hn::LoadU(d, blue + p);
    const V lumIn = hn::LoadU(d, luminance + p);
    V varIn = zero;
    if (HasVariance)
      varIn = hn::LoadU(d, variance + p);
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

    const V invSigma = hn::LoadU(d, tolerance + i);
    const V gx = hn::Mul(hn::LoadU(d, a.guides.slopeX + p), depthScale);
    const V gy = hn::Mul(hn::LoadU(d, a.guides.slopeY + p), depthScale);
    const V base = hn::MulAdd(depthEpsilon, hn::Abs(z), hn::Set(d, DepthTiny));

    const V centre = hn::IfThenElseZero(valid, hn::Set(d, 9 / 64.f));
    V sw = centre, sr = zero, sg = zero, sb = zero, sv = zero;
    if (HasVariance)
      sv = hn::Mul(hn::Mul(centre, centre), varIn);

    const V largest = hn::Set(d, VanishingExponent);
    alignas(64) float exponents[2 * Directions * PlaneLayout::Lanes];
    const V gxs[5] = { hn::Neg(hn::Add(gx, gx)), hn::Neg(gx), zero, gx, hn::Add(gx, gx) };
    const V gys[3] = { zero, gy, hn::Add(gy, gy) };
    // In two rounds, so that the chains of dependent operations are short: first every exponent ...
    for (int k = 0; k < Directions; ++k)
    {
      const float* HWY_RESTRICT zq = depth + p;
      const float* HWY_RESTRICT lq = luminance + p;
      const std::ptrdiff_t q0 = offset[2 * k], q1 = offset[2 * k + 1];
      // 1 / depth tolerance, in units of log2(e); the same for both taps of a direction.
      const V along = hn::Add(gxs[DirectionX[k] + 2], gys[DirectionY[k]]);
      const V scale = hn::Div(log2e, hn::Add(hn::Abs(along), base));
      const V l0 = hn::Mul(hn::Abs(hn::Sub(l, hn::LoadU(d, lq + q0))), invSigma);
      const V l1 = hn::Mul(hn::Abs(hn::Sub(l, hn::LoadU(d, lq + q1))), invSigma);
      const V z0 = hn::Abs(hn::Sub(z, hn::LoadU(d, zq + q0))), z1 = hn::Abs(hn::Sub(z, hn::LoadU(d, zq + q1)));
      hn::Store(hn::Min(hn::MulAdd(z0, scale, l0), largest), d, exponents + 2 * k * lanes);
      hn::Store(hn::Min(hn::MulAdd(z1, scale, l1), largest), d, exponents + (2 * k + 1) * lanes);
    }
    // ... then the weights and sums.
    constexpr int N = 2;
    for (int k = 0; k < Directions; ++k)
    {
      V e[N], w[N];
      for (int j = 0; j < N; ++j)
        e[j] = hn::Load(d, exponents + (2 * k + j) * lanes);
      NegExp2InStep(d, e, w);
      for (int j = 0; j < N; ++j)
        w[j] = hn::Mul(w[j], hn::LoadU(d, (j & 1 ? down : up)[k] + i));
      for (int j = 0; j < N; ++j)
        sw = hn::Add(sw, w[j]);
      for (int j = 0; j < N; ++j)
        sr = hn::MulAdd(w[j], hn::Sub(hn::LoadU(d, red + p + offset[2 * k + j]), r), sr);
      for (int j = 0; j < N; ++j)
        sg = hn::MulAdd(w[j], hn::Sub(hn::LoadU(d, green + p + offset[2 * k + j]), g), sg);
      for (int j = 0; j < N; ++j)
        sb = hn::MulAdd(w[j], hn::Sub(hn::LoadU(d, blue + p + offset[2 * k + j]), b), sb);
      if (HasVariance)
        for (int j = 0; j < N; ++j)
          sv = hn::MulAdd(hn::Mul(w[j], w[j]), hn::LoadU(d, variance + p + offset[2 * k + j]), sv);
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

template <NormalWeight Normals>
void RowsWith(const ATrousPass& a, int y0, int rows, int x0, int x1)
{
  const PlaneLayout& layout = a.guides.layout;
  constexpr int Slack = 4 * PlaneLayout::Lanes; // what Affinity writes beyond its end
  alignas(64) float memory[3][Directions][Chunk + 2 * SharedReach + Slack];
  const bool share = 2 * a.step <= SharedReach && rows > 1;
  const auto pairs = [&](int slot, int k, int y, int from, int to, int at) HWY_ATTR
  {
    const int dx = DirectionX[k] * a.step, dy = DirectionY[k] * a.step;
    Affinity<Normals>(a, layout.at(from, TapRow(layout, y)), layout.at(from + dx, TapRow(layout, y + dy)),
      DirectionWeight(k), to - from, memory[slot][k] + at);
  };
  for (int c0 = x0; c0 < x1; c0 += Chunk)
  {
    const int c1 = c0 + Chunk < x1 ? c0 + Chunk : x1;
    for (int r = share ? -2 : 0; r < rows; ++r)
    {
      const int y = y0 + r * a.step;
      const float *up[Directions], *down[Directions];
      for (int k = 0; k < Directions; ++k)
      {
        const int dx = DirectionX[k] * a.step, dy = DirectionY[k];
        const int slot = (r + 3) % 3;
        if (share)
        {
          // As the first end from here, as the second end for row y + dy.
          if (r + dy >= 0)
            pairs(slot, k, y, c0 - (dx > 0 ? dx : 0), c1 + (dx < 0 ? -dx : 0), SharedReach - (dx > 0 ? dx : 0));
          up[k] = memory[slot][k] + SharedReach;
          down[k] = memory[(r + 6 - dy) % 3][k] + SharedReach - dx;
        }
        else
        {
          pairs(0, k, y, c0, c1, 0);
          pairs(1, k, y - dy * a.step, c0 - dx, c1 - dx, 0);
          up[k] = memory[0][k];
          down[k] = memory[1][k];
        }
      }
      if (r < 0)
        continue;
      alignas(64) float tolerance[Chunk + PlaneLayout::Lanes];
      if (a.in.variance)
      {
        Tolerances<true>(a, layout.at(c0, y), c1 - c0, tolerance);
        Centres<true>(a, c0, y, c1 - c0, up, down, tolerance);
      }
      else
      {
        Tolerances<false>(a, layout.at(c0, y), c1 - c0, tolerance);
        Centres<false>(a, c0, y, c1 - c0, up, down, tolerance);
      }
    }
  }
}

void ATrousRowsImpl(const ATrousPass& a, int y, int rows, int x0, int x1)
{
  if (!a.guides.normal[0] || a.sigmaNormal == 0)
    RowsWith<NormalWeight::None>(a, y, rows, x0, x1);
  else if (a.sigmaNormal == 128)
    RowsWith<NormalWeight::Power128>(a, y, rows, x0, x1);
  else if (Squarings(a.sigmaNormal) >= 0)
    RowsWith<NormalWeight::Squarings>(a, y, rows, x0, x1);
  else
    RowsWith<NormalWeight::Power>(a, y, rows, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(ATrousRowsImpl);

void ATrousRows(const ATrousPass& pass, int y, int rows, int x0, int x1) noexcept
{
  HWY_DYNAMIC_DISPATCH(ATrousRowsImpl)(pass, y, rows, x0, x1);
}

namespace
{
void RowScalar(const ATrousPass& a, int y, int x0, int x1) noexcept
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

void ATrousRowsScalar(const ATrousPass& pass, int y, int rows, int x0, int x1) noexcept
{
  for (int r = 0; r < rows; ++r)
    RowScalar(pass, y + r * pass.step, x0, x1);
}
}
#endif
