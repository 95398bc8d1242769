// SPDX-License-Identifier: BSD-3-Clause
#ifndef PixelNoise_h
#define PixelNoise_h

#include <cstdint>

/// A number in [0, 1) for every (x, y, salt), the same in every run.
inline float PixelNoise(int x, int y, int salt)
{
  std::uint32_t h = std::uint32_t(x) * 0x9E3779B1u ^ std::uint32_t(y) * 0x85EBCA77u ^ std::uint32_t(salt) * 0xC2B2AE3Du;
  h ^= h >> 15;
  h *= 0x2C1B3C6Du;
  h ^= h >> 12;
  h *= 0x297A2D39u;
  h ^= h >> 15;
  return float(h >> 8) * 0x1p-24f;
}

#endif
