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
  const ImageOut& filtered, const ImageOut& residual, const Rect& tile) noexcept
{
  ClampLedger ledger;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3], f[3], r[3] = { 0, 0, 0 };
      const bool good = ReadFilled(radiance, x, y, c);
      double threshold = parameters.threshold;
      if (count && parameters.growth > 0)
      {
        const float n = *count.at(x, y);
        threshold *= std::pow(Finite(n) && n > 1 ? double(n) : 1., double(parameters.growth));
      }
      const double size = MeasureOf(c, parameters.measure);
      const bool clamp = size > threshold && parameters.threshold < Off;
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
