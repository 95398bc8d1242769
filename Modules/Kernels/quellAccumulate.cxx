// SPDX-License-Identifier: BSD-3-Clause
#include "quellAccumulate.h"

#include "quellVector.h"

#include <algorithm>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellAccumulate.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellAccumulate_once
#define quellAccumulate_once
namespace quell
{
namespace
{
constexpr float LargestSample = 1e18f; // its square is a float; larger ones are done in double
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
/// `count` pixels, whole vectors; sets again[i] where the scalar code must do the pixel. With no history (or moments)
/// the pointer is null; with a `rest` the mean is one of two floats.
template <bool TwoFloats>
void AccumulateRowOf(const AccumulateParameters& par, int count, const float* HWY_RESTRICT sample,
  const float* HWY_RESTRICT history, const float* HWY_RESTRICT moments, const float* HWY_RESTRICT length,
  const float* HWY_RESTRICT rest, float* HWY_RESTRICT color, float* HWY_RESTRICT newMoments,
  float* HWY_RESTRICT newLength, float* HWY_RESTRICT newRest, float* HWY_RESTRICT again)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), largest = hn::Set(d, LargestSample);
  const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
  const V alpha = hn::Set(d, float(par.alpha)), momentsAlpha = hn::Set(d, float(par.momentsAlpha));
  const V most = hn::Set(d, float(par.maximumHistory));
  for (int i = 0; i < count; i += lanes)
  {
    V x[3], c[3] = { zero, zero, zero }, mean = zero, second = zero, h = zero, low = zero;
    hn::LoadInterleaved3(d, sample + 3 * i, x[0], x[1], x[2]);
    auto usual =
      hn::And(hn::Lt(hn::Abs(x[0]), largest), hn::And(hn::Lt(hn::Abs(x[1]), largest), hn::Lt(hn::Abs(x[2]), largest)));
    if (history)
    {
      h = hn::LoadU(d, length + i);
      hn::LoadInterleaved3(d, history + 3 * i, c[0], c[1], c[2]);
      if (moments)
        hn::LoadInterleaved2(d, moments + 2 * i, mean, second);
      const auto old = hn::And(hn::Gt(h, zero), hn::Lt(h, inf));
      h = hn::IfThenElseZero(old, h);
      // Only history that is used need be of usual size.
      if (TwoFloats && moments)
        low = hn::LoadU(d, rest + i);
      for (const V v : { c[0], c[1], c[2], mean, second, low })
        usual = hn::And(usual, hn::Or(hn::Not(old), hn::Lt(hn::Abs(v), largest)));
    }
    const auto some = hn::Gt(h, zero);
    const V n = hn::Min(hn::Add(h, one), most), share = hn::Div(one, n);
    const V a = hn::Min(one, hn::Max(alpha, share)), am = hn::Min(one, hn::Max(momentsAlpha, share));
    const auto luminanceOf = [&](V r, V g, V b) HWY_ATTR
    { return hn::MulAdd(hn::Set(d, 0.2126f), r, hn::MulAdd(hn::Set(d, 0.7152f), g, hn::Mul(hn::Set(d, 0.0722f), b))); };
    const V luminance = luminanceOf(x[0], x[1], x[2]);
    V delta = hn::Sub(luminance, mean);
    if (TwoFloats)
    {
      // Around the mean, or the luminance itself where there is none yet.
      const V hi = hn::IfThenElse(some, mean, luminance);
      const V around = luminanceOf(hn::Sub(x[0], hi), hn::Sub(x[1], hi), hn::Sub(x[2], hi));
      delta = hn::Sub(around, low);
      const V step = hn::IfThenElse(some, hn::MulAdd(am, delta, low), around);
      mean = hn::Add(hi, step); // and what that rounds off (Knuth)
      const V there = hn::Sub(mean, hi);
      low = hn::Add(hn::Sub(hi, hn::Sub(mean, there)), hn::Sub(step, there));
    }
    else
      mean = hn::IfThenElse(some, hn::MulAdd(am, delta, mean), luminance);
    const auto mixed = hn::And(some, hn::Lt(a, one)); // a weight of 1 is exact
    for (int k = 0; k < 3; ++k)
      x[k] = hn::IfThenElse(mixed, hn::MulAdd(hn::Sub(x[k], c[k]), a, c[k]), x[k]);
    second = hn::IfThenElseZero(some, hn::Mul(hn::Sub(one, am), hn::MulAdd(am, hn::Mul(delta, delta), second)));
    hn::StoreInterleaved3(x[0], x[1], x[2], d, color + 3 * i);
    hn::StoreInterleaved2(mean, second, d, newMoments + 2 * i);
    hn::StoreU(hn::IfThenElse(some, n, one), d, newLength + i);
    if (TwoFloats)
      hn::StoreU(low, d, newRest + i);
    hn::StoreU(hn::IfThenElse(usual, zero, one), d, again + i);
  }
}

void AccumulateRowImpl(const AccumulateParameters& par, int count, const float* HWY_RESTRICT sample,
  const float* HWY_RESTRICT history, const float* HWY_RESTRICT moments, const float* HWY_RESTRICT length,
  const float* HWY_RESTRICT rest, float* HWY_RESTRICT color, float* HWY_RESTRICT newMoments,
  float* HWY_RESTRICT newLength, float* HWY_RESTRICT newRest, float* HWY_RESTRICT again)
{
  if (rest)
    AccumulateRowOf<true>(
      par, count, sample, history, moments, length, rest, color, newMoments, newLength, newRest, again);
  else
    AccumulateRowOf<false>(
      par, count, sample, history, moments, length, rest, color, newMoments, newLength, newRest, again);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(AccumulateRowImpl);

namespace
{
Vec3d ColorAt(const ImageIn& v, int x, int y)
{
  const float* p = v.at(x, y);
  return { p[0], p[1], p[2] };
}

float Finite(double v)
{
  const double limit = std::numeric_limits<float>::max();
  return float(std::min(std::max(v, -limit), limit));
}

/// The formula in double, for any pixel. Returns whether the new pixel is finite.
bool AccumulatePixel(
  const AccumulateInputs& in, const AccumulateParameters& par, const AccumulateOutputs& out, int x, int y) noexcept
{
  const Vec3d sample = ColorAt(in.radiance, x, y);
  const bool usable = IsFinite(sample);
  Vec3d color;
  const bool twoFloats = bool(in.meanRest);
  double mean = 0, second = 0, length = 0;
  if (in.history && in.length)
  {
    const double h = *in.length.at(x, y);
    color = ColorAt(in.history, x, y);
    if (in.moments)
    {
      mean = in.moments.at(x, y)[0];
      second = in.moments.at(x, y)[1];
      if (twoFloats)
        mean += *in.meanRest.at(x, y);
    }
    if (h > 0 && std::isfinite(h) && IsFinite(color) && std::isfinite(mean) && std::isfinite(second))
      length = h;
  }

  if (usable)
  {
    const double luminance = Luminance(sample);
    if (length > 0)
    {
      length = std::min(length + 1, par.maximumHistory);
      const double a = std::min(1., std::max(par.alpha, 1 / length));
      color = a < 1 ? color + (sample - color) * a : sample; // a weight of 1 is exact
      const double am = std::min(1., std::max(par.momentsAlpha, 1 / length));
      const double d = luminance - mean;
      mean += am * d;
      second = (1 - am) * (second + am * d * d);
    }
    else
    {
      length = 1;
      color = sample;
      mean = luminance;
      second = 0;
    }
  }
  else
  {
    if (!(length > 0))
    {
      color = Vec3d();
      int n = 0;
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
          if (in.radiance.inside(x + i, y + j) && IsFinite(ColorAt(in.radiance, x + i, y + j)))
          {
            color += ColorAt(in.radiance, x + i, y + j);
            ++n;
          }
      if (n > 0)
        color *= 1. / n;
      mean = Luminance(color);
      second = 0;
    }
  }

  if (out.radiance)
    for (int c = 0; c < 3; ++c)
      out.radiance.at(x, y)[c] = Finite(color[c]);
  if (out.moments)
  {
    out.moments.at(x, y)[0] = Finite(mean);
    out.moments.at(x, y)[1] = Finite(second);
  }
  if (out.meanRest)
    *out.meanRest.at(x, y) = twoFloats ? Finite(mean - Finite(mean)) : 0.f;
  if (out.history)
    *out.history.at(x, y) = float(length);
  return usable;
}
}

std::int64_t AccumulateScalar(
  const AccumulateInputs& in, const AccumulateParameters& par, const AccumulateOutputs& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
      bad += !AccumulatePixel(in, par, out, x, y);
  return bad;
}

std::int64_t Accumulate(
  const AccumulateInputs& in, const AccumulateParameters& par, const AccumulateOutputs& out, const Rect& tile) noexcept
{
  constexpr int Columns = 64; // at least a vector; a part that is not full is copied
  alignas(64) float color[3 * Columns], moments[2 * Columns], length[Columns], rest[Columns] = {}, again[Columns];
  alignas(64) float padded[5][3 * Columns] = {};
  const bool history = in.history && in.length;
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x0 = tile.x0; x0 < tile.x1; x0 += Columns)
    {
      const int count = std::min(Columns, tile.x1 - x0);
      const float* rows[5] = { in.radiance.at(x0, y), history ? in.history.at(x0, y) : nullptr,
        history && in.moments ? in.moments.at(x0, y) : nullptr, history ? in.length.at(x0, y) : nullptr,
        in.meanRest ? in.meanRest.at(x0, y) : nullptr };
      if (count < Columns)
      {
        const int components[5] = { 3, 3, 2, 1, 1 };
        for (int k = 0; k < 5; ++k)
          if (rows[k])
          {
            std::copy(rows[k], rows[k] + components[k] * count, padded[k]);
            rows[k] = padded[k];
          }
      }
      HWY_DYNAMIC_DISPATCH(AccumulateRowImpl)
      (par, Columns, rows[0], rows[1], rows[2], rows[3], rows[4], color, moments, length, rest, again);
      if (out.radiance)
        std::copy(color, color + 3 * count, out.radiance.at(x0, y));
      if (out.moments)
        std::copy(moments, moments + 2 * count, out.moments.at(x0, y));
      if (out.history)
        std::copy(length, length + count, out.history.at(x0, y));
      if (out.meanRest)
        std::copy(rest, rest + count, out.meanRest.at(x0, y));
      for (int i = 0; i < count; ++i)
        if (again[i] != 0)
          bad += !AccumulatePixel(in, par, out, x0 + i, y);
    }
  return bad;
}
}
#endif
