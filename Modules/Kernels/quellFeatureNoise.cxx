// SPDX-License-Identifier: BSD-3-Clause
#include "quellFeatureNoise.h"

#include "quellGuards.h"

#include <algorithm>

namespace quell
{
namespace
{
constexpr float LeastCosine = 0.9f, MedianOfChiSquare3 = 0.789f;

/// The lower median of at most 9 values; sorts them.
float Median(float* v, int n) noexcept
{
  for (int i = 1; i < n; ++i)
  {
    const float x = v[i];
    int j = i;
    for (; j > 0 && v[j - 1] > x; --j)
      v[j] = v[j - 1];
    v[j] = x;
  }
  return v[(n - 1) / 2];
}
}

std::size_t FeatureNoiseScratch(const Rect& tile) noexcept
{
  // raw, and the differences of each pixel to four of its neighbours, of a rectangle that is larger by 2
  return std::size_t(tile.grown(2).area()) * 5;
}

void FeatureNoise(const ImageIn& value, const ImageIn& normal, const ImageIn& depth, const ImageOut& out,
  const Rect& tile, float* scratch) noexcept
{
  constexpr float none = -1;
  constexpr int step[4][2] = { { 1, 0 }, { -1, 1 }, { 0, 1 }, { 1, 1 } };
  const Rect outer = tile.grown(2).clipped(value.extent), grown = tile.grown(1).clipped(value.extent);
  const std::ptrdiff_t width = outer.width(), area = outer.area();
  float* const raw = scratch;
  float* const square[4] = { raw + area, raw + 2 * area, raw + 3 * area, raw + 4 * area };
  const auto at = [&](int x, int y) { return (y - outer.y0) * width + (x - outer.x0); };
  const auto counts = [&](int x, int y) { return Finite3(value.at(x, y)) && (!depth || Finite(*depth.at(x, y))); };
  for (int y = outer.y0; y < outer.y1; ++y)
    for (int x = outer.x0; x < outer.x1; ++x)
    {
      const bool here = counts(x, y);
      const float* f = value.at(x, y);
      for (int k = 0; k < 4; ++k)
      {
        float& s = square[k][at(x, y)];
        const int qx = x + step[k][0], qy = y + step[k][1];
        s = none;
        if (!here || !outer.contains(qx, qy) || !counts(qx, qy))
          continue;
        if (normal)
        {
          const float *a = normal.at(x, y), *b = normal.at(qx, qy);
          if (!(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] >= LeastCosine))
            continue;
        }
        const float* g = value.at(qx, qy);
        const float sum = (g[0] - f[0]) * (g[0] - f[0]) + (g[1] - f[1]) * (g[1] - f[1]) + (g[2] - f[2]) * (g[2] - f[2]);
        s = std::min(sum, 1e36f) * (0.5f / 3 / MedianOfChiSquare3);
      }
    }
  for (int y = grown.y0; y < grown.y1; ++y)
    for (int x = grown.x0; x < grown.x1; ++x)
    {
      float squares[8];
      int n = 0;
      for (int k = 0; k < 4; ++k)
      {
        const float forth = square[k][at(x, y)];
        if (forth >= 0)
          squares[n++] = forth;
        const int qx = x - step[k][0], qy = y - step[k][1];
        const float back = outer.contains(qx, qy) ? square[k][at(qx, qy)] : none;
        if (back >= 0)
          squares[n++] = back;
      }
      // none: not a pixel whose noise could be told; 0: too few neighbours
      raw[at(x, y)] = n >= 3 ? Median(squares, n) : counts(x, y) ? 0.f : none;
    }
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float values[9];
      int n = 0;
      for (int qy = std::max(y - 1, grown.y0); qy < std::min(y + 2, grown.y1); ++qy)
        for (int qx = std::max(x - 1, grown.x0); qx < std::min(x + 2, grown.x1); ++qx)
          if (raw[at(qx, qy)] >= 0)
            values[n++] = raw[at(qx, qy)];
      *out.at(x, y) = n && raw[at(x, y)] >= 0 ? Median(values, n) : 0.f;
    }
}
}
