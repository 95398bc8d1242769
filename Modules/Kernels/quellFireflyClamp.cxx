// SPDX-License-Identifier: BSD-3-Clause
#include "quellFireflyClamp.h"

#include "quellGuards.h"

namespace quell
{
namespace
{
constexpr float Off = 1e30f; // a threshold that nothing exceeds
}

ClampLedger FireflyClamp(const ImageIn& radiance, const ImageIn& count, const FireflyClampParameters& parameters,
  const ImageOut& filtered, const ImageOut& residual, const Rect& tile, const ImageIn& albedo) noexcept
{
  ClampLedger ledger;
  // No channel beyond this: no measure exceeds the threshold, which `count` can only raise. Most pixels of most frames.
  const float small = std::fmin(
    parameters.threshold * (parameters.measure == ClampMeasure::Length ? 0.577f : 0.9999f), parameters.largest);
  const float nothing[3] = { 0, 0, 0 };
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3], f[3], r[3] = { 0, 0, 0 };
      const bool good = ReadFilled(radiance, x, y, c);
      if (good && std::fabs(c[0]) <= small && std::fabs(c[1]) <= small && std::fabs(c[2]) <= small)
      {
        Book(ledger, c, nothing, false);
        StoreColor(filtered, x, y, c);
        StoreColor(residual, x, y, nothing);
        continue;
      }
      double threshold = parameters.threshold;
      if (count && parameters.growth > 0)
      {
        const float n = *count.at(x, y);
        threshold *= std::pow(Finite(n) && n > 1 ? double(n) : 1., double(parameters.growth));
      }
      double size = MeasureOf(c, parameters.measure);
      bool clamp = size > threshold && parameters.threshold < Off;
      if (parameters.largest < Off)
      {
        double most = 0;
        for (int k = 0; k < 3; ++k)
        {
          const float a = albedo ? albedo.at(x, y)[k] : 1.f;
          most = std::fmax(most, std::fabs(c[k] * (Finite(a) ? std::fmin(std::fmax(a, parameters.floor), 1.f) : 1.)));
        }
        // Whichever leaves less.
        if (most > parameters.largest && (!clamp || parameters.largest / most < threshold / size))
        {
          clamp = true;
          ledger.Guarded += good;
          threshold = parameters.largest;
          size = most;
        }
      }
      for (int k = 0; k < 3; ++k)
        f[k] = clamp ? SplitExactly(c[k], float(c[k] * (threshold / size)), r[k]) : c[k];
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
