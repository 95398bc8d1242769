// SPDX-License-Identifier: BSD-3-Clause
// Arithmetic of image skies that LightSampler does for one direction and wavefronts do in vectors: the same bits.
#ifndef quellSkyMap_h
#define quellSkyMap_h

#include "quellBsdf.h"
#include "quellSampler.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace quell
{
namespace skymap
{
constexpr double BelowOne = 0x1.fffffffffffffp-1;

/// Two random numbers, each extended by 32 bits made of all three. `pick` adds what the pair may lack.
inline void Extend(float pick, float u, float v, double& s, double& t) noexcept
{
  std::uint32_t p, x, y;
  std::memcpy(&p, &pick, sizeof p);
  std::memcpy(&x, &u, sizeof x);
  std::memcpy(&y, &v, sizeof y);
  const std::uint64_t h = sampling::Mix64((std::uint64_t(x) << 32 | y) + (p + 1) * 0x9e3779b97f4a7c15ull);
  s = double(u) + double(std::uint32_t(h >> 32)) * 0x1p-56;
  t = double(v) + double(std::uint32_t(h)) * 0x1p-56;
  s = s < BelowOne ? s : BelowOne;
  t = t < BelowOne ? t : BelowOne;
}

/// `minus` is 0 or all ones: t, or k - t. Signs of directions are what no processor can foresee: no branch.
inline float OrMinus(std::uint32_t minus, float k, float t) noexcept
{
  std::uint32_t a, b;
  std::memcpy(&a, &k, sizeof a);
  std::memcpy(&b, &t, sizeof b);
  a &= minus;
  b ^= minus & 0x80000000u;
  std::memcpy(&k, &a, sizeof k);
  std::memcpy(&t, &b, sizeof t);
  return k + t;
}

/// atan2(y, x) in turns, [-1/2, 1/2]. Error below 3e-8, of which 6e-9 are the polynomial's (minimax on [0, 1]). Finite
/// or infinite y, finite x.
inline float Turns(float y, float x) noexcept
{
  const float a = std::fabs(x), b = std::fabs(y), larger = a < b ? b : a;
  const float high = larger < std::numeric_limits<float>::min() ? std::numeric_limits<float>::min() : larger;
  const float low = b < a ? b : a;
  const float q = low / high, z = q * q, z2 = z * z;
  const float p0 = 9.9999933561e-1f - 3.3329860846e-1f * z, p1 = 1.9946566051e-1f - 1.3908630674e-1f * z;
  const float p2 = 9.6421987631e-2f - 5.5912332895e-2f * z, p3 = 2.1862955450e-2f - 4.0545651829e-3f * z;
  float t = ((p0 + p1 * z2) + (p2 + p3 * z2) * (z2 * z2)) * q * (1 / (2 * Pi));
  t = OrMinus(0u - std::uint32_t(b > a), 0.25f, t);
  std::uint32_t sign;
  std::memcpy(&sign, &x, sizeof sign);
  t = OrMinus(0u - (sign >> 31), 0.5f, t);
  return std::copysign(t, y);
}

/// The first of the four texels around a finite direction, in an image with a border, and where between them.
inline std::uint32_t Place(float dx, float dy, float dz, int width, int height, float& tx, float& ty) noexcept
{
  // No arc cosine: near the poles the height alone has no digits left.
  const float u = 0.5f + Turns(dx, -dz), v = 2 * Turns(std::sqrt(dx * dx + dz * dz), dy);
  // places in the bordered image, half a texel back
  const float px = u * float(width) + 0.5f, py = v * float(height) + 0.5f;
  const int cx = int(px), cy = int(py), x = width < cx ? width : cx, y = height < cy ? height : cy;
  tx = px - float(x);
  ty = py - float(y);
  return std::uint32_t(y) * (std::uint32_t(width) + 2u) + std::uint32_t(x);
}

/// The direction of a place in the image: cosine of its distance from the pole, longitude in turns.
inline void Direction(double cosTheta, float turn, float& dx, float& dy, float& dz) noexcept
{
  const double sin2 = (1 - cosTheta) * (1 + cosTheta);
  const float sinTheta = float(std::sqrt(0. < sin2 ? sin2 : 0.));
  float sine, cosine;
  SinCosTurn(turn, sine, cosine);
  dx = -sinTheta * sine;
  dy = float(cosTheta);
  dz = sinTheta * cosine;
}
}
}

#endif
