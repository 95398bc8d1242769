// SPDX-License-Identifier: BSD-3-Clause
#include "quellEmissionSplit.h"

#include "quellGuards.h"

#include <algorithm>

namespace quell
{
std::int64_t EmissionSplit(const ImageIn& radiance, const EmissionSplitParameters& p, const ImageOut& emission,
  const ImageOut& rest, const ImageOut& mask, const Rect& tile) noexcept
{
  const auto luminance = [&radiance](int x, int y)
  {
    const float* c = radiance.inside(x, y) ? radiance.at(x, y) : nullptr;
    return c && Finite3(c) ? FilterLuminance(c[0], c[1], c[2]) : 0.f;
  };
  const auto bright = [&](int x, int y)
  {
    if (!(luminance(x, y) > p.threshold))
      return false;
    int n = -1; // itself
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        n += luminance(x + dx, y + dy) > p.threshold;
    return n >= p.neighbours;
  };
  const auto lamp = [&](int x, int y, float own)
  {
    if (!(own > p.edgePart * p.threshold))
      return false;
    float brightest = 0;
    for (int dy = -p.grow; dy <= p.grow; ++dy)
      for (int dx = -p.grow; dx <= p.grow; ++dx)
        if (bright(x + dx, y + dy))
        {
          if (dx == 0 && dy == 0)
            return true;
          brightest = std::max(brightest, luminance(x + dx, y + dy));
        }
    return brightest > 0 && own > p.edgePart * brightest;
  };
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3];
      bad += !ReadFilled(radiance, x, y, c);
      const bool is = lamp(x, y, FilterLuminance(c[0], c[1], c[2])); // filled: a hole in a lamp is lamp
      for (int k = 0; k < 3; ++k)
      {
        if (emission)
          emission.at(x, y)[k] = is ? c[k] : 0.f;
        if (rest)
          rest.at(x, y)[k] = is ? 0.f : c[k];
      }
      if (mask)
        *mask.at(x, y) = is ? 1.f : 0.f;
    }
  return bad;
}
}
