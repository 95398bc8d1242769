// SPDX-License-Identifier: BSD-3-Clause
#include "quellSampler.h"

#include <algorithm>

namespace quell
{
void PixelSampler::StartBlueNoise(
  std::uint64_t seed, int x, int y, int tick, std::uint32_t sample, int samplesPerPixel) noexcept
{
  int log2 = 0;
  while (log2 < 16 && (1 << log2) < samplesPerPixel)
    ++log2;
  // Tiles keep the index within 32 bits and its cost bounded; between tiles neighbours are as unrelated as across the
  // seams of the Z curve.
  const int side = std::min(8, (32 - log2) / 2);
  const std::uint32_t mask = (1u << side) - 1, px = std::uint32_t(x), py = std::uint32_t(y);
  this->Log2Samples = std::uint8_t(log2);
  this->Bits = std::uint8_t(2 * side + log2);
  this->Cell = sampling::Morton(px & mask, py & mask) << log2 | (sample & ((1u << log2) - 1));
  this->Turn = sampling::ReverseBits(std::uint32_t(tick) + (sample >> log2));
  this->TileKey = sampling::Mix64(SeedKey(seed) ^ (std::uint64_t(py & ~mask) << 32 | (px & ~mask)));
}

Vec2f PixelSampler::OtherPair(std::uint32_t pair) const noexcept
{
  using namespace sampling;
  constexpr std::uint64_t odd = 0x9e3779b97f4a7c15ull;
  if (this->Pattern == SamplePattern::Random)
  {
    // Everything is in the state: streams alone, from one state, are copies of each other with an offset.
    const std::uint64_t h = Mix64((this->Key ^ (std::uint64_t(pair) << 40)) + odd);
    Pcg32 random(Mix64(h ^ Mix64(this->Reversed + odd)), h);
    const std::uint32_t a = random.Next(), b = random.Next();
    return { UnitFloat(a), UnitFloat(b) };
  }
  const std::uint64_t h = Mix64((this->TileKey ^ (std::uint64_t(pair) << 40)) + odd), s = Mix64(h), t = Mix64(s + odd);
  const std::uint32_t i = ZSobolIndex(this->Cell, this->Bits, h);
  // The frame's point: of those that the samples of one pixel would leave to later frames.
  const std::uint32_t turn = ReverseBits(ScrambleReversed(this->Turn, std::uint32_t(t))) << this->Log2Samples;
  const std::uint32_t x = ScrambleReversed(i, std::uint32_t(s)) ^ turn;
  const std::uint32_t y = ScrambleReversed(PascalReversed(i), std::uint32_t(s >> 32)) ^ PascalReversed(turn);
  return { UnitFloat(ReverseBits(x)), UnitFloat(ReverseBits(y)) };
}
}
