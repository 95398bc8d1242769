// SPDX-License-Identifier: BSD-3-Clause
#include "quellRankClamp.h"

#include "quellGuards.h"

#include <algorithm>
#include <functional>

namespace quell
{
namespace
{
constexpr double Largest = 3.402823466e38;

int RadiusOf(const RankClampParameters& p) noexcept
{
  return std::max(0, std::min(p.radius, RankClampParameters::LargestRadius));
}
}

std::size_t RankClampScratch(const RankClampParameters& parameters, const Rect& tile) noexcept
{
  return std::size_t(tile.grown(RadiusOf(parameters)).area());
}

ClampLedger RankClamp(const ImageIn& radiance, const ImageIn& id, const RankClampParameters& p,
  const ImageOut& filtered, const ImageOut& residual, const Rect& tile, float* scratch) noexcept
{
  const int radius = RadiusOf(p);
  // Sizes of the tile and what is around it; -1: does not count.
  const Rect around = tile.grown(radius);
  const ImageOut sizes(scratch, 1, around);
  for (int y = around.y0; y < around.y1; ++y)
    for (int x = around.x0; x < around.x1; ++x)
    {
      float size = -1;
      if (radiance.inside(x, y) && Finite3(radiance.at(x, y)))
        size = float(std::min(Largest, MeasureOf(radiance.at(x, y), p.measure)));
      *sizes.at(x, y) = size;
    }
  const float factor = float(p.factor);
  const bool off = p.factor >= 1e30;
  ClampLedger ledger;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3], f[3], r[3] = { 0, 0, 0 };
      const bool good = ReadFilled(radiance, x, y, c);
      const float size = good ? *sizes.at(x, y) : float(std::min(Largest, MeasureOf(c, p.measure)));
      // Few pixels stand out, so first only count the neighbours that would let this one pass.
      const int x0 = x - radius, y0 = y - radius, x1 = x + radius, y1 = y + radius;
      const float own = id ? *id.at(x, y) : 0;
      const auto counts = [&](int qx, int qy, float m)
      { return m >= 0 && !(qx == x && qy == y) && (!id || *id.at(qx, qy) == own); };
      int passing = 0, taps = 0;
      for (int qy = y0; qy <= y1; ++qy)
      {
        const float* row = sizes.at(x0, qy);
        for (int qx = x0; qx <= x1; ++qx, ++row)
          if (counts(qx, qy, *row))
          {
            ++taps;
            passing += factor * *row >= size;
          }
      }
      const int rank = std::min(std::max(1, p.rank), taps);
      const bool clamp = taps > 0 && passing < rank && !off;
      double scale = 1;
      if (clamp)
      {
        constexpr int Side = 2 * RankClampParameters::LargestRadius + 1;
        float values[Side * Side];
        int n = 0;
        for (int qy = y0; qy <= y1; ++qy)
          for (int qx = x0; qx <= x1; ++qx)
          {
            const float m = *sizes.at(qx, qy);
            if (counts(qx, qy, m))
              values[n++] = m;
          }
        std::nth_element(values, values + rank - 1, values + n, std::greater<float>());
        scale = double(factor * values[rank - 1]) / MeasureOf(c, p.measure);
      }
      for (int k = 0; k < 3; ++k)
        f[k] = clamp ? SplitExactly(c[k], float(c[k] * scale), r[k]) : c[k];
      if (good)
        Book(ledger, c, r, clamp);
      else
      {
        ++ledger.NonFinite;
        r[0] = r[1] = r[2] = 0;
      }
      StoreColor(filtered, x, y, f);
      StoreColor(residual, x, y, r);
    }
  return ledger;
}
}
