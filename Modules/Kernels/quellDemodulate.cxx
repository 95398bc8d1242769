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
  if (!Finite(albedo))
    return 1.f;
  return albedo < floor ? floor : albedo > 1.f ? 1.f : albedo;
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
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
      if (!illumination(x, y, out.at(x, y)))
      {
        FillFromNeighbours<3>(radiance.extent, x, y, out.at(x, y), illumination);
        ++bad;
      }
  return bad;
}

std::int64_t Modulate(
  const ImageIn& illumination, const ImageIn& albedo, float floor, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3];
      bad += !ReadFilled(illumination, x, y, c);
      const float* a = albedo ? albedo.at(x, y) : white;
      float* o = out.at(x, y);
      for (int k = 0; k < 3; ++k)
        o[k] = c[k] * Divisor(a[k], floor);
    }
  return bad;
}
}
