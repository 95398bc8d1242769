// SPDX-License-Identifier: BSD-3-Clause
#include "quellTemporalAntialias.h"

#include "quellReproject.h"
#include "quellVector.h"

#include <limits>

namespace quell
{
namespace
{
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
}

std::int64_t TemporalAntialias(
  const AntialiasInputs& in, const AntialiasParameters& par, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
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
      if (!usable)
        ++bad;

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
        continue;
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
    }
  return bad;
}
}
