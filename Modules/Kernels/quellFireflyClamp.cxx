// SPDX-License-Identifier: BSD-3-Clause
#include "quellFireflyClamp.h"

#include "quellGuards.h"

namespace quell
{
namespace
{
/// The float nearest to `wanted` from below in magnitude for which f + (c - f) == c.
float Split(float c, float wanted, float& rest) noexcept
{
  float f = wanted;
  rest = c - f;
  while (f + rest != c) // only when c - f is an exact tie and c is odd; the next f ends it
  {
    f = std::nextafter(f, 0.f);
    rest = c - f;
  }
  return f;
}
}

ClampLedger FireflyClamp(const ImageIn& radiance, float threshold, const ImageOut& filtered, const ImageOut& residual,
  const Rect& tile) noexcept
{
  ClampLedger ledger;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3], f[3], r[3] = { 0, 0, 0 };
      const bool good = ReadFilled(radiance, x, y, c);
      const double length = std::sqrt(double(c[0]) * c[0] + double(c[1]) * c[1] + double(c[2]) * c[2]);
      const bool clamp = length > threshold;
      for (int k = 0; k < 3; ++k)
        f[k] = clamp ? Split(c[k], float(c[k] * (threshold / length)), r[k]) : c[k];
      if (good)
      {
        ledger.Clamped += clamp;
        ledger.EnergyIn += 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        ledger.EnergyRemoved += 0.2126 * r[0] + 0.7152 * r[1] + 0.0722 * r[2];
      }
      else
      {
        ++ledger.NonFinite;
        r[0] = r[1] = r[2] = 0;
      }
      if (filtered)
        for (int k = 0; k < 3; ++k)
          filtered.at(x, y)[k] = f[k];
      if (residual)
        for (int k = 0; k < 3; ++k)
          residual.at(x, y)[k] = r[k];
    }
  return ledger;
}
}
