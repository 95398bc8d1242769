// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSinCos_h
#define quellSinCos_h

#include <cmath>
#include <cstdint>

namespace quell
{
/// Sine and cosine as plain products and sums, so that scalar code and vectors of any width give the same bits (the
/// library's functions may not). Minimax polynomials; errors below 1.2e-7 on the given ranges.
namespace sincos
{
constexpr float S3 = -1.6666654611e-1f, S5 = 8.3321608736e-3f, S7 = -1.9515295891e-4f;
constexpr float C4 = 4.166664568298827e-2f, C6 = -1.388731625493765e-3f, C8 = 2.443315711809948e-5f;
}

/// x in [-pi/4, pi/4].
inline void SinCosEighth(float x, float& s, float& c) noexcept
{
  using namespace sincos;
  const float z = x * x;
  s = ((S7 * z + S5) * z + S3) * z * x + x;
  c = ((C8 * z + C6) * z + C4) * z * z - 0.5f * z + 1;
}

/// Of the angle 2 pi u, u in [0, 1].
inline void SinCosTurn(float u, float& s, float& c) noexcept
{
  // the nearest multiple of a quarter turn is taken out without rounding
  const float k = std::floor(4 * u + 0.5f);
  float a, b;
  SinCosEighth((u - 0.25f * k) * 6.28318530717958647692f, a, b);
  const int quadrant = int(k) & 3;
  s = quadrant == 0 ? a : quadrant == 1 ? b : quadrant == 2 ? -a : -b;
  c = quadrant == 0 ? b : quadrant == 1 ? -a : quadrant == 2 ? -b : a;
}
}

#endif
