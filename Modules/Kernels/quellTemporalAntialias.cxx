// SPDX-License-Identifier: BSD-3-Clause
#include "quellTemporalAntialias.h"

#include "quellReproject.h"
#include "quellVector.h"

#include <algorithm>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellTemporalAntialias.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellTemporalAntialias_once
#define quellTemporalAntialias_once
namespace quell
{
namespace
{
/// What the vector code computes; beyond it, products of three colours would leave the range of float.
constexpr float LargestColor = 1e12f;

/// Planar copy of a part of a row.
struct AntialiasRow
{
  static constexpr int Columns = 128, Size = Columns + 2 + 64;
  alignas(64) float color[3][Size];
  float most[Size], weight[Size]; ///< max(0, colour), 1 / (1 + most)
  float valid[Size];              ///< 1; 0 outside of the frame; NaN where the colour is not finite or too large
  float motion[2][Size], depth[Size];
};

/// A colour times its weight, and the weight.
struct Weighted
{
  Vec3d c;
  double w = 0;
};

bool ReadFinite(const ImageIn& v, int x, int y, Vec3d& c)
{
  const float* p = v.at(x, y);
  c = { p[0], p[1], p[2] };
  return IsFinite(c);
}

Weighted Compress(const Vec3d& c)
{
  const double w = 1 / (1 + std::max(0., MaxComponent(c)));
  return { c * w, w };
}

/// Y = (R + 2 G + B) / 4.
Vec3d ToYCoCg(const Vec3d& c)
{
  return { 0.25 * c.x + 0.5 * c.y + 0.25 * c.z, 0.5 * (c.x - c.z), 0.5 * c.y - 0.25 * (c.x + c.z) };
}

int Clamp(int v, int lo, int hi)
{
  return v < lo ? lo : v > hi ? hi : v;
}

bool FetchHistory(const AntialiasInputs& in, double qx, double qy, Weighted& result) noexcept
{
  const Rect e = in.history.extent;
  const double fx = std::floor(qx), fy = std::floor(qy), tx = qx - fx, ty = qy - fy;
  double wx[4], wy[4];
  CatmullRomWeights(tx, wx);
  CatmullRomWeights(ty, wy);
  Weighted taps[16];
  bool finite[16];
  bool all = true;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i)
    {
      const int k = 4 * j + i;
      finite[k] = true;
      if (wx[i] == 0 || wy[j] == 0)
        continue;
      Vec3d c;
      finite[k] =
        ReadFinite(in.history, Clamp(int(fx) - 1 + i, e.x0, e.x1 - 1), Clamp(int(fy) - 1 + j, e.y0, e.y1 - 1), c);
      all = all && finite[k];
      taps[k] = Compress(c);
    }

  if (all)
  {
    const double big = std::numeric_limits<double>::infinity();
    double sum[4] = { 0, 0, 0, 0 }, lo[4] = { big, big, big, big }, hi[4] = { -big, -big, -big, -big };
    for (int j = 0; j < 4; ++j)
      for (int i = 0; i < 4; ++i)
      {
        const double w = wx[i] * wy[j];
        if (wx[i] == 0 || wy[j] == 0)
          continue;
        const Weighted& t = taps[4 * j + i];
        const double v[4] = { t.c.x, t.c.y, t.c.z, t.w };
        const bool central = (i == 1 || i == 2) && (j == 1 || j == 2);
        for (int c = 0; c < 4; ++c)
        {
          sum[c] += w * v[c];
          if (central)
          {
            lo[c] = std::min(lo[c], v[c]);
            hi[c] = std::max(hi[c], v[c]);
          }
        }
      }
    for (int c = 0; c < 4; ++c)
      sum[c] = std::min(std::max(sum[c], lo[c]), hi[c]);
    result = { { sum[0], sum[1], sum[2] }, sum[3] };
    return true;
  }

  double total = 0;
  result = Weighted();
  for (int j = 1; j <= 2; ++j)
    for (int i = 1; i <= 2; ++i)
    {
      const double w = (i == 2 ? tx : 1 - tx) * (j == 2 ? ty : 1 - ty);
      if (!(w > 0) || !finite[4 * j + i])
        continue;
      total += w;
      result.c += taps[4 * j + i].c * w;
      result.w += taps[4 * j + i].w * w;
    }
  if (!(total >= 0.01))
    return false;
  result.c *= 1 / total;
  result.w /= total;
  return true;
}

/// The formula in double, for any pixel. Returns whether the new frame's pixel is finite.
bool AntialiasPixel(
  const AntialiasInputs& in, const AntialiasParameters& par, const ImageOut& out, int x, int y) noexcept
{
  // The neighbourhood: mean and closest depth.
  Vec3d center, plain;
  const bool usable = ReadFinite(in.radiance, x, y, center);
  Weighted around[9], mean;
  int n = 0, bx = x, by = y;
  float nearest = std::numeric_limits<float>::infinity();
  for (int j = -1; j <= 1; ++j)
    for (int i = -1; i <= 1; ++i)
    {
      const int u = x + i, v = y + j;
      if (!in.frame.contains(u, v) || !in.radiance.inside(u, v))
        continue;
      if (in.depth && in.depth.inside(u, v) && *in.depth.at(u, v) < nearest)
      {
        nearest = *in.depth.at(u, v);
        bx = u;
        by = v;
      }
      Vec3d c;
      if (!ReadFinite(in.radiance, u, v, c))
        continue;
      around[n] = Compress(c);
      plain += c;
      mean.c += around[n].c;
      mean.w += around[n].w;
      ++n;
    }
  if (n > 0)
  {
    plain *= 1. / n;
    mean.c *= 1. / n;
    mean.w /= n;
  }
  Weighted history;
  bool has = false;
  if (in.history)
  {
    double mx = 0, my = 0;
    if (in.motion)
    {
      mx = in.motion.at(bx, by)[0];
      my = in.motion.at(bx, by)[1];
    }
    const double qx = x + mx, qy = y + my;
    // Also false for NaN, and before any conversion to int.
    if (qx >= in.frame.x0 - 0.5 && qx < in.frame.x1 - 0.5 && qy >= in.frame.y0 - 0.5 && qy < in.frame.y1 - 0.5)
      has = FetchHistory(in, qx, qy, history);
  }

  float* o = out.at(x, y);
  if (!has)
  {
    const Vec3d c = usable ? center : plain;
    for (int k = 0; k < 3; ++k)
      o[k] = float(c[k]);
    return usable;
  }

  if (n > 0)
  {
    const Vec3d m = ToYCoCg(mean.c);
    Vec3d variance;
    for (int k = 0; k < n; ++k)
    {
      const Vec3d d = ToYCoCg(around[k].c) - m;
      variance += d * d;
    }
    const Vec3d offset = ToYCoCg(history.c) - m;
    double keep = 1;
    for (int k = 0; k < 3; ++k)
    {
      const double limit = par.gamma * std::sqrt(variance[k] / n), d = std::fabs(offset[k]);
      if (d > limit)
        keep = std::min(keep, limit / d);
    }
    if (keep < 1)
    {
      history.c = mean.c + (history.c - mean.c) * keep;
      history.w = mean.w + (history.w - mean.w) * keep;
    }
  }
  if (usable)
  {
    const Weighted now = Compress(center);
    history.c += (now.c - history.c) * par.alpha;
    history.w += (now.w - history.w) * par.alpha;
  }
  const double limit = std::numeric_limits<float>::max();
  for (int k = 0; k < 3; ++k)
    o[k] = float(std::min(std::max(history.c[k] / history.w, -limit), limit));
  return usable;
}
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
/// Pixels c0 .. c0 + count of row y; rows[0..2] hold columns c0 - 1 .. of rows y - 1 .. y + 1. `result` gets their
/// colours, `again` a 1 for those that AntialiasPixel must do.
///
/// Everything is a difference to the pixel's own compressed colour: with M = max(0, max c), w = 1 / (1 + M),
///   d_k     = c_k w_k - c_0 w_0 = w_k w_0 (dc + (M_0 dc - c_0 dM)),  dc = c_k - c_0, dM = M_k - M_0
///   omega_k = w_k - w_0         = -w_k w_0 dM
/// (d_k by its definition where dM w_k > 2), which float keeps accurate at any brightness, and the result is c_0 + (d -
/// c_0 omega) / (w_0 + omega), in which a constant stays what it is to the last bit, or, far from c_0, (c_0 w_0 + d) /
/// (w_0 + omega).
void AntialiasRowImpl(const AntialiasInputs& in, const AntialiasParameters& par, const AntialiasRow* const* rows, int y,
  int c0, int count, float* HWY_RESTRICT result, float* HWY_RESTRICT again)
{
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  const int lanes = int(hn::Lanes(d));
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), half = hn::Set(d, 0.5f), quarter = hn::Set(d, 0.25f);
  const V largest = hn::Set(d, LargestColor), limit = hn::Set(d, std::numeric_limits<float>::max());
  const V gamma = hn::Set(d, float(par.gamma)), stay = hn::Set(d, float(1 - par.alpha));
  const auto luma = [&](V r, V g, V b) HWY_ATTR { return hn::MulAdd(quarter, hn::Add(r, b), hn::Mul(half, g)); };
  const auto orange = [&](V r, V b) HWY_ATTR { return hn::Mul(half, hn::Sub(r, b)); };
  const auto green = [&](V r, V g, V b) HWY_ATTR { return hn::NegMulAdd(quarter, hn::Add(r, b), hn::Mul(half, g)); };

  for (int i = 0; i < count; i += lanes)
  {
    const AntialiasRow& mid = *rows[1];
    const V c[3] = { hn::LoadU(d, mid.color[0] + i + 1), hn::LoadU(d, mid.color[1] + i + 1),
      hn::LoadU(d, mid.color[2] + i + 1) };
    const V m0 = hn::LoadU(d, mid.most + i + 1), w0 = hn::LoadU(d, mid.weight + i + 1);
    const V much = hn::Set(d, 2.f);
    const auto difference = [&](V ck, V cc, V dm, V wk) HWY_ATTR
    {
      const V dc = hn::Sub(ck, cc);
      // Not fused: for gray the two products cancel exactly.
      const V near = hn::Mul(hn::Mul(wk, w0), hn::Add(dc, hn::Sub(hn::Mul(m0, dc), hn::Mul(cc, dm))));
      // A neighbour that is far darker is lost in dc.
      return hn::IfThenElse(hn::Gt(hn::Mul(hn::Abs(dm), wk), much), hn::NegMulAdd(cc, w0, hn::Mul(ck, wk)), near);
    };

    // The neighbourhood: mean, deviation, and the motion of the nearest surface.
    V delta[9][3], valid[9], mean[3] = { zero, zero, zero }, meanWeight = zero, n = zero;
    V best = hn::Set(d, std::numeric_limits<float>::infinity());
    V mx = hn::LoadU(d, mid.motion[0] + i + 1), my = hn::LoadU(d, mid.motion[1] + i + 1);
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k)
      {
        const AntialiasRow& row = *rows[j];
        const V z = hn::LoadU(d, row.depth + i + k);
        const auto nearer = hn::Lt(z, best);
        best = hn::IfThenElse(nearer, z, best);
        mx = hn::IfThenElse(nearer, hn::LoadU(d, row.motion[0] + i + k), mx);
        my = hn::IfThenElse(nearer, hn::LoadU(d, row.motion[1] + i + k), my);
        const V v = hn::LoadU(d, row.valid + i + k);
        const V dm = hn::Sub(hn::LoadU(d, row.most + i + k), m0);
        const V wk = hn::LoadU(d, row.weight + i + k);
        n = hn::Add(n, v);
        meanWeight = hn::NegMulAdd(hn::Mul(hn::Mul(wk, w0), v), dm, meanWeight);
        valid[3 * j + k] = v;
        for (int q = 0; q < 3; ++q)
        {
          delta[3 * j + k][q] = hn::Mul(v, difference(hn::LoadU(d, row.color[q] + i + k), c[q], dm, wk));
          mean[q] = hn::Add(mean[q], delta[3 * j + k][q]);
        }
      }
    const V inverse = hn::Div(one, n);
    for (V& m : mean)
      m = hn::Mul(m, inverse);
    meanWeight = hn::Mul(meanWeight, inverse);
    V square[3] = { zero, zero, zero };
    for (int k = 0; k < 9; ++k)
    {
      const V r = hn::Sub(delta[k][0], mean[0]), g = hn::Sub(delta[k][1], mean[1]), b = hn::Sub(delta[k][2], mean[2]);
      const V a[3] = { luma(r, g, b), orange(r, b), green(r, g, b) };
      for (int q = 0; q < 3; ++q)
        square[q] = hn::MulAdd(hn::Mul(a[q], a[q]), valid[k], square[q]);
    }

    // Where it was; the comparisons are exact, and false for NaN.
    const V px = hn::Add(hn::Set(d, float(c0 + i)), hn::Iota(d, 0.f)), py = hn::Set(d, float(y));
    auto has = hn::And(
      hn::Ge(mx, hn::Sub(hn::Set(d, in.frame.x0 - 0.5f), px)), hn::Lt(mx, hn::Sub(hn::Set(d, in.frame.x1 - 0.5f), px)));
    has = hn::And(has, hn::And(hn::Ge(my, hn::Sub(hn::Set(d, in.frame.y0 - 0.5f), py)),
                         hn::Lt(my, hn::Sub(hn::Set(d, in.frame.y1 - 0.5f), py))));
    V history[3] = { zero, zero, zero }, historyWeight = zero;
    auto bad = hn::Not(hn::Ge(n, one));
    if (in.history && !hn::AllFalse(d, has))
    {
      mx = hn::IfThenElseZero(has, mx), my = hn::IfThenElseZero(has, my);
      const V fx = hn::Floor(mx), fy = hn::Floor(my);
      V wx[4], wy[4];
      const auto weights = [&](V t, V* w) HWY_ATTR
      {
        // CatmullRomWeights as products: small weights are as accurate as large ones.
        const V u = hn::Sub(one, t), tu = hn::Mul(hn::Mul(half, t), u), steep = hn::Set(d, -1.5f);
        w[0] = hn::Neg(hn::Mul(tu, u));
        w[1] = hn::Mul(u, hn::MulAdd(t, hn::MulAdd(steep, t, one), one));
        w[2] = hn::Mul(t, hn::MulAdd(t, hn::MulAdd(steep, t, hn::Set(d, 2.f)), half));
        w[3] = hn::Neg(hn::Mul(tu, t));
      };
      weights(hn::Sub(mx, fx), wx);
      weights(hn::Sub(my, fy), wy);
      const Rect e = in.history.extent;
      const auto baseX = hn::Add(hn::ConvertTo(di, fx), hn::Add(hn::Set(di, c0 + i - 1 - e.x0), hn::Iota(di, 0)));
      const auto baseY = hn::Add(hn::ConvertTo(di, fy), hn::Set(di, y - 1 - e.y0));
      const auto lastX = hn::Set(di, e.x1 - 1 - e.x0), lastY = hn::Set(di, e.y1 - 1 - e.y0), zeroI = hn::Zero(di);
      // Where all lanes move by the same whole pixels, their taps lie side by side.
      const int firstX = int(hn::GetLane(baseX)), firstY = int(hn::GetLane(baseY));
      const bool together =
        hn::AllTrue(
          d, hn::And(has, hn::And(hn::Eq(fx, hn::Set(d, hn::GetLane(fx))), hn::Eq(fy, hn::Set(d, hn::GetLane(fy)))))) &&
        firstX >= 0 && firstX + lanes + 3 <= e.width() && firstY >= 0 && firstY + 4 <= e.height();
      hn::Vec<decltype(di)> column[4];
      for (int k = 0; k < 4; ++k)
      {
        const auto u = hn::Min(hn::Max(hn::Add(baseX, hn::Set(di, k)), zeroI), lastX);
        column[k] = hn::Add(u, hn::Add(u, u));
      }
      const V big = hn::Set(d, 1e30f);
      V low[4] = { big, big, big, big }, high[4] = { hn::Neg(big), hn::Neg(big), hn::Neg(big), hn::Neg(big) };
      for (int j = 0; j < 4; ++j)
      {
        const auto v = hn::Min(hn::Max(hn::Add(baseY, hn::Set(di, j)), zeroI), lastY);
        const auto row = hn::Mul(v, hn::Set(di, int(in.history.rowStride)));
        for (int k = 0; k < 4; ++k)
        {
          const V a = hn::Mul(wx[k], wy[j]);
          const auto used = hn::And(hn::Ne(wx[k], zero), hn::Ne(wy[j], zero));
          const auto index = hn::Add(row, column[k]);
          V h[3];
          if (together)
            hn::LoadInterleaved3(
              d, in.history.data + (firstY + j) * in.history.rowStride + 3 * (firstX + k), h[0], h[1], h[2]);
          else
            for (int q = 0; q < 3; ++q)
              h[q] = hn::GatherIndex(d, in.history.data + q, index);
          const V size = hn::Max(hn::Max(hn::Abs(h[0]), hn::Abs(h[1])), hn::Abs(h[2]));
          // A comparison with each, because a maximum may forget a NaN.
          const auto fine = hn::And(
            hn::Le(size, largest), hn::And(hn::Eq(h[0], h[0]), hn::And(hn::Eq(h[1], h[1]), hn::Eq(h[2], h[2]))));
          bad = hn::Or(bad, hn::AndNot(fine, hn::And(has, used)));
          const V m = hn::Max(hn::Max(h[0], h[1]), hn::Max(h[2], zero));
          const V wk = hn::Div(one, hn::Add(one, m)), dm = hn::Sub(m, m0);
          V t[4];
          for (int q = 0; q < 3; ++q)
            t[q] = difference(h[q], c[q], dm, wk);
          t[3] = hn::Neg(hn::Mul(hn::Mul(wk, w0), dm));
          for (int q = 0; q < 3; ++q)
            history[q] = hn::IfThenElse(used, hn::MulAdd(a, t[q], history[q]), history[q]);
          historyWeight = hn::IfThenElse(used, hn::MulAdd(a, t[3], historyWeight), historyWeight);
          if ((j == 1 || j == 2) && (k == 1 || k == 2))
            for (int q = 0; q < 4; ++q)
            {
              low[q] = hn::IfThenElse(used, hn::Min(low[q], t[q]), low[q]);
              high[q] = hn::IfThenElse(used, hn::Max(high[q], t[q]), high[q]);
            }
        }
      }
      for (int q = 0; q < 3; ++q)
        history[q] = hn::Min(hn::Max(history[q], low[q]), high[q]);
      historyWeight = hn::Min(hn::Max(historyWeight, low[3]), high[3]);

      const V r = hn::Sub(history[0], mean[0]), g = hn::Sub(history[1], mean[1]), b = hn::Sub(history[2], mean[2]);
      const V offset[3] = { luma(r, g, b), orange(r, b), green(r, g, b) };
      V keep = one;
      for (int q = 0; q < 3; ++q)
      {
        const V most = hn::Mul(gamma, hn::Sqrt(hn::Mul(square[q], inverse))), size = hn::Abs(offset[q]);
        keep = hn::IfThenElse(hn::Gt(size, most), hn::Min(keep, hn::Div(most, size)), keep);
      }
      const auto clip = hn::Lt(keep, one);
      for (int q = 0; q < 3; ++q)
        history[q] = hn::IfThenElse(clip, hn::MulAdd(hn::Sub(history[q], mean[q]), keep, mean[q]), history[q]);
      historyWeight =
        hn::IfThenElse(clip, hn::MulAdd(hn::Sub(historyWeight, meanWeight), keep, meanWeight), historyWeight);
    }
    else
      has = hn::Lt(one, zero);

    const V w = hn::Mul(stay, historyWeight), scale = hn::Div(one, hn::Add(w0, w));
    V out[3];
    for (int q = 0; q < 3; ++q)
    {
      const V change = hn::Mul(hn::NegMulAdd(c[q], w, hn::Mul(stay, history[q])), scale);
      // A small change is added, which keeps constants; a large one would cancel against a bright c_0.
      const V direct = hn::Mul(hn::MulAdd(c[q], w0, hn::Mul(stay, history[q])), scale);
      const auto small = hn::Lt(hn::Abs(change), hn::Mul(quarter, hn::Abs(c[q])));
      const V added = hn::IfThenElse(hn::Or(small, hn::Eq(change, zero)), hn::Add(c[q], change), direct);
      const V o = hn::Min(hn::Max(added, hn::Neg(limit)), limit);
      out[q] = hn::IfThenElse(has, o, c[q]);
    }
    hn::StoreInterleaved3(out[0], out[1], out[2], d, result + 3 * i);
    hn::StoreU(hn::IfThenElseZero(bad, one), d, again + i);
  }
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(AntialiasRowImpl);

namespace
{
/// Columns c0 - 1 .. c0 + count of row y.
void FillRow(const AntialiasInputs& in, AntialiasRow& row, int y, int c0, int count) noexcept
{
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const Rect there = in.radiance.extent.clipped(in.frame);
  const bool any = y >= there.y0 && y < there.y1;
  const int x0 = c0 - 1, columns = count + 2;
  const int first = any ? std::min(std::max(there.x0 - x0, 0), columns) : 0;
  const int last = any ? std::max(std::min(there.x1 - x0, columns), first) : 0;
  // Outside of the frame, and what lanes right of the row read.
  const auto empty = [&row, inf](int from, int to)
  {
    for (float* plane : { row.color[0], row.color[1], row.color[2], row.most, row.valid, row.motion[0], row.motion[1] })
      std::fill(plane + from, plane + to, 0.f);
    std::fill(row.weight + from, row.weight + to, 1.f);
    std::fill(row.depth + from, row.depth + to, inf);
  };
  empty(0, first);
  empty(last, AntialiasRow::Size);
  if (first == last)
    return;
  const float* c = in.radiance.at(x0 + first, y) - 3 * first;
  for (int i = first; i < last; ++i)
  {
    const float r = c[3 * i], g = c[3 * i + 1], b = c[3 * i + 2];
    const bool good = (std::fabs(r) <= LargestColor) & (std::fabs(g) <= LargestColor) & (std::fabs(b) <= LargestColor);
    row.color[0][i] = good ? r : 0.f;
    row.color[1][i] = good ? g : 0.f;
    row.color[2][i] = good ? b : 0.f;
    row.valid[i] = good ? 1.f : nan;
  }
  for (int i = first; i < last; ++i)
  {
    const float r = row.color[0][i], g = row.color[1][i], b = row.color[2][i];
    const float rg = r > g ? r : g, most = b > rg ? b : rg;
    row.most[i] = most > 0 ? most : 0.f;
    row.weight[i] = 1 / (1 + row.most[i]);
  }
  if (in.motion)
  {
    const float* m = in.motion.at(x0 + first, y) - 2 * first;
    for (int i = first; i < last; ++i)
    {
      row.motion[0][i] = m[2 * i];
      row.motion[1][i] = m[2 * i + 1];
    }
  }
  else
  {
    std::fill(row.motion[0] + first, row.motion[0] + last, 0.f);
    std::fill(row.motion[1] + first, row.motion[1] + last, 0.f);
  }
  if (in.depth)
    std::copy_n(in.depth.at(x0 + first, y), last - first, row.depth + first);
  else
    std::fill(row.depth + first, row.depth + last, inf);
}
}

std::int64_t TemporalAntialiasScalar(
  const AntialiasInputs& in, const AntialiasParameters& par, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
      bad += !AntialiasPixel(in, par, out, x, y);
  return bad;
}

std::int64_t TemporalAntialias(
  const AntialiasInputs& in, const AntialiasParameters& par, const ImageOut& out, const Rect& tile) noexcept
{
  // Indices of gathers are of 32 bits.
  if (in.history &&
      std::int64_t(in.history.rowStride) * in.history.extent.height() > std::numeric_limits<int>::max() - 8)
    return TemporalAntialiasScalar(in, par, out, tile);
  std::int64_t bad = 0;
  AntialiasRow memory[3];
  alignas(64) float result[3 * AntialiasRow::Size], again[AntialiasRow::Size];
  for (int c0 = tile.x0; c0 < tile.x1; c0 += AntialiasRow::Columns)
  {
    const int count = std::min(AntialiasRow::Columns, tile.x1 - c0);
    for (int y = tile.y0 - 1; y <= tile.y1; ++y)
    {
      FillRow(in, memory[(y - tile.y0 + 1) % 3], y, c0, count);
      if (y < tile.y0 + 1)
        continue;
      const int at = y - tile.y0 - 1; // the middle row is y - 1
      const AntialiasRow* const rows[3] = { &memory[at % 3], &memory[(at + 1) % 3], &memory[(at + 2) % 3] };
      HWY_DYNAMIC_DISPATCH(AntialiasRowImpl)(in, par, rows, y - 1, c0, count, result, again);
      std::copy(result, result + 3 * count, out.at(c0, y - 1));
      for (int i = 0; i < count; ++i)
        if (again[i] != 0)
          bad += !AntialiasPixel(in, par, out, c0 + i, y - 1);
    }
  }
  return bad;
}
}
#endif
