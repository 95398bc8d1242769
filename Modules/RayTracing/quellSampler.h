// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSampler_h
#define quellSampler_h

#include "quellVector.h"

#include <cstdint>

namespace quell
{
/// Random numbers of the path tracer: Owen-scrambled Sobol points, padded in pairs. A number is a pure function of
/// (seed, sample index, pixel, pair), never of the order of calls, the region, the tile or the thread.
/// Every decision of a path has a fixed pair (the ledger below), so skipping a branch shifts nothing.
namespace sampling
{
inline std::uint32_t ReverseBits(std::uint32_t v) noexcept
{
  v = __builtin_bswap32(v);
  v = ((v & 0x0f0f0f0fu) << 4) | ((v >> 4) & 0x0f0f0f0fu);
  v = ((v & 0x33333333u) << 2) | ((v >> 2) & 0x33333333u);
  return ((v & 0x55555555u) << 1) | ((v >> 1) & 0x55555555u);
}

/// A bijection of 64-bit integers that maps 0 to 0.
inline std::uint64_t Mix64(std::uint64_t v) noexcept
{
  v ^= v >> 31;
  v *= 0x7fb5d329728ea185ull;
  v ^= v >> 27;
  v *= 0x81dadef4bc2dd44dull;
  return v ^ (v >> 33);
}

/// Nested uniform scramble of a number whose bits are already reversed (least significant bit first).
inline std::uint32_t ScrambleReversed(std::uint32_t v, std::uint32_t seed) noexcept
{
  v ^= v * 0x3d20adeau;
  v += seed;
  v *= (seed >> 16) | 1u;
  v ^= v * 0x05526c56u;
  return v ^ (v * 0x53a22864u);
}
inline std::uint32_t Owen(std::uint32_t v, std::uint32_t seed) noexcept
{
  return ReverseBits(ScrambleReversed(ReverseBits(v), seed));
}

/// Bits of Sobol dimension 1 in reversed order: the generator matrix is Pascal's triangle mod 2, that is the
/// substitution x -> 1 + x in the polynomial whose coefficients are the bits, done block by block.
inline std::uint32_t PascalReversed(std::uint32_t v) noexcept
{
  v ^= v >> 16;
  v ^= (v & 0xff00ff00u) >> 8;
  v ^= (v & 0xf0f0f0f0u) >> 4;
  v ^= (v & 0xccccccccu) >> 2;
  return v ^ ((v & 0xaaaaaaaau) >> 1);
}
/// Sobol dimensions 0 and 1.
inline std::uint32_t Sobol0(std::uint32_t i) noexcept
{
  return ReverseBits(i);
}
inline std::uint32_t Sobol1(std::uint32_t i) noexcept
{
  return ReverseBits(PascalReversed(i));
}

/// [0, 1); the largest value is 1 - 2^-24.
inline float UnitFloat(std::uint32_t v) noexcept
{
  return float(v >> 8) * 0x1p-24f;
}

/// Radical inverse, for Halton points.
inline double RadicalInverse(int base, std::uint32_t i) noexcept
{
  double f = 1, r = 0;
  for (; i != 0; i /= std::uint32_t(base))
  {
    f /= base;
    r += f * double(i % std::uint32_t(base));
  }
  return r;
}
/// The i-th (1, 2, ...) offset of the Halton(2, 3) sequence, in [-1/2, 1/2)^2 pixels.
inline Vec2<double> HaltonOffset(std::uint32_t i) noexcept
{
  return { RadicalInverse(2, i) - 0.5, RadicalInverse(3, i) - 0.5 };
}
}

/// The dimension ledger: which pair feeds which decision.
enum SamplePair : std::uint32_t
{
  PairPixel = 0, ///< position in the pixel
  PairLens = 1,
  PairTime = 2,
  PairFirstBounce = 3, ///< then PairsPerBounce for each vertex
  PairLightPick = 0,   ///< x: which light, y: Russian roulette
  PairLightPoint = 1,
  PairBsdf = 2,
  PairLobe = 3, ///< x: which lobe, y: reflect or transmit
  PairsPerBounce = 4
};

/// Numbers of one sample of one pixel.
class PixelSampler
{
public:
  /// `index` is frame * samplesPerPixel + sample, so that accumulation over frames continues the sequence.
  PixelSampler(std::uint64_t seed, int x, int y, std::uint32_t index) noexcept
    : Key(SeedKey(seed) ^ (std::uint64_t(std::uint32_t(y)) << 20 ^ std::uint64_t(std::uint32_t(x))))
    , Reversed(sampling::ReverseBits(index))
  {
  }
  /// Seeds are mixed before they meet the pixel: images of neighbouring seeds would be permutations of each other.
  static std::uint64_t SeedKey(std::uint64_t seed) noexcept { return sampling::Mix64(seed + 0x9e3779b97f4a7c15ull); }

  Vec2f Pair(std::uint32_t pair) const noexcept
  {
    using namespace sampling;
    const std::uint64_t h = Mix64((this->Key ^ (std::uint64_t(pair) << 40)) + 0x9e3779b97f4a7c15ull);
    const std::uint64_t s = Mix64(h);
    const std::uint32_t i = ReverseBits(ScrambleReversed(this->Reversed, std::uint32_t(h)));
    return { UnitFloat(ReverseBits(ScrambleReversed(i, std::uint32_t(s)))),
      UnitFloat(ReverseBits(ScrambleReversed(PascalReversed(i), std::uint32_t(s >> 32)))) };
  }
  Vec2f Bounce(int depth, SamplePair pair) const noexcept
  {
    return this->Pair(PairFirstBounce + PairsPerBounce * std::uint32_t(depth) + pair);
  }
  /// White-noise key of a ray (`which`: 2 * depth, + 1 for its shadow ray): decides about see-through surfaces.
  std::uint32_t RayKey(std::uint32_t which) const noexcept
  {
    return std::uint32_t(
      sampling::Mix64(sampling::Mix64(this->Key + 0xd1b54a32d192ed03ull * (which + 1)) ^ this->Reversed) >> 32);
  }

private:
  std::uint64_t Key;
  std::uint32_t Reversed;
};

/// Uniform number of a (ray, surface) pair: does not depend on the order in which a ray meets surfaces.
inline float SurfaceRandom(std::uint32_t rayKey, std::uint32_t geometry, std::uint32_t primitive) noexcept
{
  const std::uint64_t v = (std::uint64_t(geometry) << 32 | primitive) + 0x9e3779b97f4a7c15ull * (rayKey + 1ull);
  return sampling::UnitFloat(std::uint32_t(sampling::Mix64(v) >> 32));
}
}

#endif
