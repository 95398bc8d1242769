// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSampler_h
#define quellSampler_h

#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <cstdint>

namespace quell
{
/// Random numbers of the path tracer, in pairs. A number is a pure function of (seed, frame, sample, pixel, pair),
/// never of the order of calls, the region, the tile or the thread. Every decision of a path has a fixed pair (the
/// ledger below), so skipping a branch shifts nothing.
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

/// Bits of x and y in turns, x first: the place of a pixel along the Z curve.
inline std::uint32_t Morton(std::uint32_t x, std::uint32_t y) noexcept
{
  const auto spread = [](std::uint32_t v)
  {
    v &= 0xffffu;
    v = (v | v << 8) & 0x00ff00ffu;
    v = (v | v << 4) & 0x0f0f0f0fu;
    v = (v | v << 2) & 0x33333333u;
    return (v | v << 1) & 0x55555555u;
  };
  return spread(x) | spread(y) << 1;
}

/// The permutations of 0..3, in the order of the published tables; permutation p maps d to bits 2 d and 2 d + 1 of its
/// byte.
constexpr std::uint8_t Permutations4[24] = { 0xe4, 0xb4, 0xd8, 0x78, 0x6c, 0x9c, 0xe1, 0xb1, 0xc9, 0x39, 0x2d, 0x8d,
  0xc6, 0x36, 0xd2, 0x72, 0x4e, 0x1e, 0x27, 0x87, 0x1b, 0x4b, 0x63, 0x93 };

/// The place of a sample of a pixel in the Sobol sequence (Ahmed and Wonka, "Screen-Space Blue-Noise Diffusion of Monte
/// Carlo Sampling Error via Hierarchical Ordering of Pixels", 2020): `index` is Morton << log2 samples | sample, of
/// `bits` bits; each base-4 digit is permuted by a hash of those above it and of `key`, and a single lowest bit, where
/// `bits` is odd, flipped. A bijection of the numbers below 2^bits that keeps every aligned block of 4^k together.
inline std::uint32_t ZSobolIndex(std::uint32_t index, int bits, std::uint64_t key) noexcept
{
  std::uint32_t result = 0;
  const int lowest = bits & 1;
  for (int shift = bits - 2; shift >= lowest; shift -= 2)
  {
    const std::uint64_t higher = std::uint64_t(index) >> (shift + 2);
    const unsigned p = unsigned((Mix64(higher ^ key) >> 24) % 24u), digit = (index >> shift) & 3u;
    result |= ((std::uint32_t(Permutations4[p]) >> (2 * digit)) & 3u) << shift;
  }
  if (lowest)
    result |= (index & 1u) ^ std::uint32_t(Mix64((std::uint64_t(index) >> 1) ^ key) & 1u);
  return result;
}

/// O'Neill's PCG32 (XSH RR): its stream `stream` from state `state`.
class Pcg32
{
public:
  Pcg32(std::uint64_t state, std::uint64_t stream) noexcept
    : Increment(stream << 1 | 1u)
  {
    this->Next();
    this->State += state;
    this->Next();
  }
  std::uint32_t Next() noexcept
  {
    const std::uint64_t s = this->State;
    this->State = s * 6364136223846793005ull + this->Increment;
    const std::uint32_t x = std::uint32_t(((s >> 18) ^ s) >> 27), r = std::uint32_t(s >> 59);
    return x >> r | x << ((32 - r) & 31u);
  }

private:
  std::uint64_t State = 0, Increment;
};

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

/// The dimension ledger: which pair feeds which decision. Each pair is shuffled and scrambled on its own, so two
/// decisions never share structure; within one pair both numbers are stratified together.
///
///   pair                        x                          y
///   0  PairPixel                position in the pixel      position in the pixel
///   1  PairLens                 point on the lens          point on the lens
///   2  PairTime                 time within the shutter    (free)
///   3 + 4 d + PairLightPick     which light                Russian roulette
///   3 + 4 d + PairLightPoint    point on the light         point on the light
///   3 + 4 d + PairBsdf          direction                  direction
///   3 + 4 d + PairLobe          which lobe                 reflect or transmit
///
/// d is the number of scatterings before the vertex. Decisions whose number is open (see-through surfaces along a ray)
/// take white noise by RayKey and SurfaceRandom instead.
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

/// Where the numbers come from.
///
/// Sobol (default): an Owen-scrambled Sobol sequence of each pixel's own. Any 2^k first samples of a pixel are a net in
/// each pair, and frames continue the sequence: the least error of a pixel, errors of neighbours independent.
///
/// BlueNoise: the pixels of a frame share one sequence along a randomized Z curve, so that neighbours complement each
/// other: the error of a frame is blue noise, for the eye or a filter to remove. Meant for a number of samples that is
/// a power of two (others lose a little). From frame to frame an exclusive-or moves all points by a point of a Sobol
/// sequence over frames: that keeps each frame blue, and the samples that a pixel gets at one per frame over 2^k frames
/// are a net. (So the next frame's errors rather oppose this one's; some later frame visits the strata next to these
/// and looks alike.) Measured at one sample per pixel with smooth integrands of two dimensions: 4.5 to 8 times less
/// power than Sobol below an eighth of the sampling frequency; after a Gaussian blur of 2 pixels 2.2 to 3 times less
/// error (root mean square), 2 times with an edge through the integrand. After 32 frames of one sample: error .038,
/// that of Sobol .034, of Random .106. A pair costs about 75 ns where Sobol's costs 15.
///
/// Random: independent numbers (PCG32 per pixel, sample and pair), for comparison.
enum class SamplePattern : std::uint8_t
{
  Sobol,
  BlueNoise,
  Random
};

/// Numbers of one sample of one pixel.
class PixelSampler
{
public:
  /// Sobol numbers. `index` is frame * samplesPerPixel + sample, so that accumulation over frames continues the
  /// sequence.
  PixelSampler(std::uint64_t seed, int x, int y, std::uint32_t index) noexcept
    : Key(SeedKey(seed) ^ (std::uint64_t(std::uint32_t(y)) << 20 ^ std::uint64_t(std::uint32_t(x))))
    , Reversed(sampling::ReverseBits(index))
  {
  }
  /// Sample `sample` (from 0; may be beyond samplesPerPixel) of frame `tick`. For Sobol the same as above with the
  /// index tick * samplesPerPixel + sample.
  PixelSampler(SamplePattern pattern, std::uint64_t seed, int x, int y, int tick, std::uint32_t sample,
    int samplesPerPixel) noexcept
    : PixelSampler(seed, x, y, std::uint32_t(tick) * std::uint32_t(samplesPerPixel) + sample)
  {
    this->Pattern = pattern;
    if (pattern == SamplePattern::BlueNoise)
      this->StartBlueNoise(seed, x, y, tick, sample, samplesPerPixel);
  }
  /// Seeds are mixed before they meet the pixel: images of neighbouring seeds would be permutations of each other.
  static std::uint64_t SeedKey(std::uint64_t seed) noexcept { return sampling::Mix64(seed + 0x9e3779b97f4a7c15ull); }

  Vec2f Pair(std::uint32_t pair) const noexcept
  {
    using namespace sampling;
    if (__builtin_expect(this->Pattern != SamplePattern::Sobol, 0))
      return this->OtherPair(pair);
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
  VTKQUELLRAYTRACING_EXPORT void StartBlueNoise(
    std::uint64_t seed, int x, int y, int tick, std::uint32_t sample, int samplesPerPixel) noexcept;
  VTKQUELLRAYTRACING_EXPORT Vec2f OtherPair(std::uint32_t pair) const noexcept;

  std::uint64_t Key;
  std::uint32_t Reversed; ///< sample index, lowest bit first
  SamplePattern Pattern = SamplePattern::Sobol;
  // BlueNoise only:
  std::uint8_t Log2Samples = 0, Bits = 0;
  std::uint32_t Cell = 0; ///< Z-curve index of the pixel in its tile, then the sample
  std::uint32_t Turn = 0; ///< reversed number of the frame
  std::uint64_t TileKey = 0;
};

/// Uniform number of a (ray, surface) pair: does not depend on the order in which a ray meets surfaces.
inline float SurfaceRandom(std::uint32_t rayKey, std::uint32_t geometry, std::uint32_t primitive) noexcept
{
  const std::uint64_t v = (std::uint64_t(geometry) << 32 | primitive) + 0x9e3779b97f4a7c15ull * (rayKey + 1ull);
  return sampling::UnitFloat(std::uint32_t(sampling::Mix64(v) >> 32));
}
}

#endif
