// SPDX-License-Identifier: BSD-3-Clause
#include "quellPixelMemory.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

using namespace quell;

TEST(PixelMemory, IsUsedAgainAndAligned)
{
  float* a = TakePixelMemory(100000);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(a) % 64, 0u);
  for (int i = 0; i < 100000; ++i)
    a[i] = 1;
  float* b = TakePixelMemory(100000);
  EXPECT_NE(a, b);
  GivePixelMemory(a);
  float* other = TakePixelMemory(200000);
  EXPECT_NE(other, a);
  EXPECT_EQ(TakePixelMemory(100000), a);
  for (float* p : { a, b, other })
    GivePixelMemory(p);
  GivePixelMemory(nullptr);
}

// What is given back beyond the limit goes to the system: all of it can be taken and filled again and again.
TEST(PixelMemory, KeepsALimitedAmount)
{
  const std::size_t floats = PixelMemoryKept / sizeof(float) / 4;
  for (int round = 0; round < 3; ++round)
  {
    std::vector<float*> all;
    for (int i = 0; i < 8; ++i)
    {
      all.push_back(TakePixelMemory(floats));
      all.back()[0] = all.back()[floats - 1] = float(i);
    }
    for (int i = 0; i < 8; ++i)
    {
      EXPECT_EQ(all[std::size_t(i)][0], float(i));
      EXPECT_EQ(all[std::size_t(i)][floats - 1], float(i));
      GivePixelMemory(all[std::size_t(i)]);
    }
  }
  GivePixelMemory(TakePixelMemory(0));
}
