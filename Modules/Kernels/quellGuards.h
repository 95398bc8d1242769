// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGuards_h
#define quellGuards_h

#include "quellImageView.h"
#include "quellVector.h"

#include <cmath>

namespace quell
{
///@{ Small guards that every kernel uses, so that an extreme value is treated in the same way everywhere.
inline bool Finite(float v) noexcept
{
  return std::fabs(v) <= 3.402823466e38f; // false for NaN too
}
inline bool Finite3(const float* c) noexcept
{
  return Finite(c[0]) && Finite(c[1]) && Finite(c[2]);
}
/// Non-negative colour; black where any channel is not finite.
inline Vec3f Sane(const Vec3f& c) noexcept
{
  if (!Finite(c.x) || !Finite(c.y) || !Finite(c.z))
    return {};
  return { c.x > 0 ? c.x : 0.f, c.y > 0 ? c.y : 0.f, c.z > 0 ? c.z : 0.f };
}
/// a / b; 0 where b is 0, for sums in which 0/0 means "no data".
inline float SafeDivide(float a, float b) noexcept
{
  return b != 0 ? a / b : 0.f;
}
/// exp(-x) for x >= 0; 0 beyond 80, long before float exp becomes denormal (87.3), and for NaN.
inline float NegativeExp(float x) noexcept
{
  return x <= 80.f ? std::exp(-x) : 0.f;
}
/// x^n for a cosine x: 0 for x <= 0, x above 1 counts as 1 (normals a little too long). n = 0 accepts every x.
inline float CosinePower(double x, float n) noexcept
{
  if (n == 0)
    return 1.f;
  return x > 0 ? float(std::pow(x < 1 ? x : 1., double(n))) : 0.f;
}
/// An overflowed product or sum stays at the largest float.
inline float Limited(float v) noexcept
{
  return v > 3.402823466e38f ? 3.402823466e38f : v < -3.402823466e38f ? -3.402823466e38f : v;
}
/// Luminance as filters compare it: Rec. 709, limited to +-1e38 so that differences cannot overflow.
inline float FilterLuminance(float r, float g, float b) noexcept
{
  const float l = 0.2126f * r + (0.7152f * g + 0.0722f * b);
  return l < -1e38f ? -1e38f : l > 1e38f ? 1e38f : l;
}
///@}

/// The rule for a non-finite pixel in a pixelwise stage: the mean of what `value(x, y, out)` gives for the finite ones
/// of its 8 neighbours inside `extent`, in row-major order; zeros where there is none. `value` returns false for "not
/// finite". Needs a halo of 1. Sums in double: 8 x FLT_MAX does not overflow.
template <int Components, class F>
bool FillFromNeighbours(const Rect& extent, int x, int y, float* out, F&& value) noexcept
{
  double sum[Components] = {};
  int n = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
    {
      float v[Components];
      if ((dx == 0 && dy == 0) || !extent.contains(x + dx, y + dy) || !value(x + dx, y + dy, v))
        continue;
      for (int c = 0; c < Components; ++c)
        sum[c] += v[c];
      ++n;
    }
  for (int c = 0; c < Components; ++c)
    out[c] = n ? float(sum[c] / n) : 0.f;
  return n != 0;
}

/// Reads pixel (x, y) of a 3-component image into `out`; where it is not finite, the mean of its finite neighbours.
/// Returns false in that case, for the count.
inline bool ReadFilled(const ImageIn& image, int x, int y, float* out) noexcept
{
  const float* c = image.at(x, y);
  if (Finite3(c))
  {
    out[0] = c[0], out[1] = c[1], out[2] = c[2];
    return true;
  }
  FillFromNeighbours<3>(image.extent, x, y, out,
    [&image](int qx, int qy, float* v)
    {
      const float* q = image.at(qx, qy);
      v[0] = q[0], v[1] = q[1], v[2] = q[2];
      return Finite3(q);
    });
  return false;
}
}

#endif
