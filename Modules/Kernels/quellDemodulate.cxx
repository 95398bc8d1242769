// SPDX-License-Identifier: BSD-3-Clause
#include "quellDemodulate.h"

#include "quellGuards.h"

namespace quell
{
namespace
{
const float white[3] = { 1, 1, 1 };

float Divisor(float albedo, float floor) noexcept
{
  const float inside = albedo < floor ? floor : albedo > 1.f ? 1.f : albedo;
  return Finite(albedo) ? inside : 1.f;
}
}

std::int64_t Demodulate(
  const ImageIn& radiance, const ImageIn& albedo, float floor, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  const auto illumination = [&](int x, int y, float* v)
  {
    const float* c = radiance.at(x, y);
    const float* a = albedo ? albedo.at(x, y) : white;
    if (!Finite3(c))
      return false;
    for (int k = 0; k < 3; ++k)
      v[k] = Limited(c[k] / Divisor(a[k], floor));
    return true;
  };
  const int count = 3 * tile.width();
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    const float* c = radiance.at(tile.x0, y);
    const float* a = albedo ? albedo.at(tile.x0, y) : nullptr;
    float* o = out.at(tile.x0, y);
    // Channel by channel, which the compiler vectorises; pixels that are not finite (rare) are done again.
    int wrong = 0;
    for (int i = 0; i < count; ++i)
    {
      o[i] = Limited(c[i] / Divisor(a ? a[i] : 1.f, floor));
      wrong |= !Finite(c[i]);
    }
    if (wrong)
      for (int x = tile.x0; x < tile.x1; ++x)
        if (!Finite3(radiance.at(x, y)))
        {
          FillFromNeighbours<3>(radiance.extent, x, y, out.at(x, y), illumination);
          ++bad;
        }
  }
  return bad;
}

std::int64_t Modulate(
  const ImageIn& illumination, const ImageIn& albedo, float floor, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  const int count = 3 * tile.width();
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    const float* c = illumination.at(tile.x0, y);
    const float* a = albedo ? albedo.at(tile.x0, y) : nullptr;
    float* o = out.at(tile.x0, y);
    int wrong = 0;
    for (int i = 0; i < count; ++i)
    {
      o[i] = c[i] * Divisor(a ? a[i] : 1.f, floor);
      wrong |= !Finite(c[i]);
    }
    if (wrong)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        float filled[3];
        if (ReadFilled(illumination, x, y, filled))
          continue;
        const float* p = albedo ? albedo.at(x, y) : white;
        for (int k = 0; k < 3; ++k)
          out.at(x, y)[k] = filled[k] * Divisor(p[k], floor);
        ++bad;
      }
  }
  return bad;
}
}
