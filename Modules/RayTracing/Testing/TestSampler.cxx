// SPDX-License-Identifier: BSD-3-Clause
#include "quellSampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

using namespace quell;
using namespace quell::sampling;

TEST(Sampler, Mix64Golden)
{
  EXPECT_EQ(Mix64(0), 0u);
  EXPECT_EQ(Mix64(1), 0xccde22c1faa4d20full);
  EXPECT_EQ(Mix64(2), 0x99bc45837549a41full);
  EXPECT_EQ(Mix64(3), 0xf0b342aa2aab95d4ull);
}

TEST(Sampler, SobolGolden)
{
  const std::uint32_t d0[] = { 0, 0x80000000, 0x40000000, 0xc0000000, 0x20000000, 0xa0000000, 0x60000000, 0xe0000000 };
  const std::uint32_t d1[] = { 0, 0x80000000, 0xc0000000, 0x40000000, 0xa0000000, 0x20000000, 0x60000000, 0xe0000000 };
  for (std::uint32_t i = 0; i < 8; ++i)
  {
    EXPECT_EQ(Sobol0(i), d0[i]);
    EXPECT_EQ(Sobol1(i), d1[i]);
  }
}

TEST(Sampler, OwenGolden)
{
  const std::uint32_t v[] = { 0, 0x40000000, 0x80000000, 0xc0000000 };
  const std::uint32_t s1[] = { 0xd5a1fe3d, 0x9eb2548c, 0x2d0e2f36, 0x40b55a18 };
  const std::uint32_t sd[] = { 0xa792495e, 0xd2afd17f, 0x6607918a, 0x23ff6d4e };
  const std::uint32_t low[] = { 0xd5a1fe3d, 0xd5a1fe3c, 0xd5a1fe3f, 0xd5a1fe3e };
  for (int i = 0; i < 4; ++i)
  {
    EXPECT_EQ(Owen(v[i], 1), s1[i]);
    EXPECT_EQ(Owen(v[i], 0xdeadbeef), sd[i]);
    EXPECT_EQ(Owen(std::uint32_t(i), 1), low[i]);
  }
  const std::uint32_t points[4][2] = { { 0x2c65899d, 0xec380f31 }, { 0x89d62303, 0x45503510 },
    { 0x747c9826, 0x2b38a279 }, { 0xc9cd31b9, 0x8efc1d5e } };
  for (std::uint32_t i = 0; i < 4; ++i)
  {
    const std::uint32_t k = Owen(i, 0x12345);
    EXPECT_EQ(Owen(Sobol0(k), 0x9e3779b9), points[i][0]);
    EXPECT_EQ(Owen(Sobol1(k), 0x85ebca6b), points[i][1]);
  }
}

TEST(Sampler, PairsAreNets)
{
  // 16 points of any pair put one into every elementary interval of area 1/16
  for (std::uint32_t pair : { 0u, 3u, 6u, 41u })
    for (std::uint32_t first : { 0u, 16u, 4096u })
      for (int k = 0; k <= 4; ++k)
      {
        std::vector<int> count(16);
        for (std::uint32_t i = 0; i < 16; ++i)
        {
          const Vec2f u = PixelSampler(7, 12, 34, first + i).Pair(pair);
          ++count[std::size_t(int(u.x * (1 << k)) * (1 << (4 - k)) + int(u.y * (1 << (4 - k))))];
        }
        for (int c : count)
          EXPECT_EQ(c, 1) << "pair " << pair << " k " << k;
      }
}

TEST(Sampler, HaltonGolden)
{
  const double g[8][2] = { { 0, -.166667 }, { -.25, .166667 }, { .25, -.388889 }, { -.375, -.055556 },
    { .125, .277778 }, { -.125, -.277778 }, { .375, .055556 }, { -.4375, .388889 } };
  for (std::uint32_t i = 0; i < 8; ++i)
  {
    EXPECT_NEAR(HaltonOffset(i + 1).x, g[i][0], 1e-6);
    EXPECT_NEAR(HaltonOffset(i + 1).y, g[i][1], 1e-6);
  }
}

TEST(Sampler, NeighboursSeedsAndFramesAreUncorrelated)
{
  const auto correlation = [](const PixelSampler& a, const PixelSampler& b)
  {
    double sum = 0;
    for (std::uint32_t p = 0; p < 512; ++p)
    {
      const Vec2f u = a.Pair(p), v = b.Pair(p);
      sum += (u.x - .5) * (v.x - .5) + (u.y - .5) * (v.y - .5);
    }
    return sum / 1024 * 12;
  };
  const PixelSampler base(0, 0, 0, 0);
  EXPECT_NEAR(correlation(base, base), 1, 0.15);
  for (const PixelSampler& other : { PixelSampler(0, 1, 0, 0), PixelSampler(0, 0, 1, 0), PixelSampler(1, 0, 0, 0),
         PixelSampler(1, 1, 0, 0), PixelSampler(0, 61, 0, 0) })
    EXPECT_LT(std::fabs(correlation(base, other)), 0.15);
}

TEST(Sampler, UnitFloatStaysBelowOne)
{
  EXPECT_EQ(UnitFloat(0), 0.f);
  EXPECT_LT(UnitFloat(0xffffffffu), 1.f);
}
