// SPDX-License-Identifier: BSD-3-Clause
#include "quellPixelMemory.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <set>
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

// A frame that needs much more than the floor finds its blocks again in the next one; later small frames let them go.
TEST(PixelMemory, KeepsWhatAFrameNeededUntilThePeakFades)
{
  const std::size_t floats = PixelMemoryKept / sizeof(float) / 4;
  std::set<float*> first;
  for (int round = 0; round < 3; ++round)
  {
    std::vector<float*> all;
    for (int i = 0; i < 8; ++i)
    {
      all.push_back(TakePixelMemory(floats));
      all.back()[0] = all.back()[floats - 1] = float(i);
    }
    if (round == 0)
      first.insert(all.begin(), all.end());
    EXPECT_EQ(std::set<float*>(all.begin(), all.end()), first);
    EXPECT_LT(PixelMemoryWaiting(), PixelMemoryKept);
    for (int i = 0; i < 8; ++i)
    {
      EXPECT_EQ(all[std::size_t(i)][0], float(i));
      EXPECT_EQ(all[std::size_t(i)][floats - 1], float(i));
      GivePixelMemory(all[std::size_t(i)]);
    }
    EXPECT_GE(PixelMemoryWaiting(), 2 * PixelMemoryKept);
  }
  for (int i = 0; i < 3 * 4096; ++i)
    GivePixelMemory(TakePixelMemory(50000));
  EXPECT_LE(PixelMemoryWaiting(), PixelMemoryKept);
  GivePixelMemory(TakePixelMemory(0));
}

// Blocks of another size make room: what is held never exceeds the peak by more than the floor.
TEST(PixelMemory, OtherSizesTakeThePlaceOfTheOld)
{
  const std::size_t floats = PixelMemoryKept / sizeof(float) / 4;
  for (std::size_t size : { floats, floats + 1000, floats + 2000, floats + 3000 })
  {
    std::vector<float*> all;
    for (int i = 0; i < 8; ++i)
      all.push_back(TakePixelMemory(size));
    EXPECT_LE(PixelMemoryWaiting(), PixelMemoryKept);
    for (float* block : all)
      GivePixelMemory(block);
    EXPECT_LE(PixelMemoryWaiting(), 3 * PixelMemoryKept);
  }
}

// Where memory is short nothing waits but what the peak allows.
TEST(PixelMemory, KeepsNothingAboveThePeakWhereItIsShort)
{
  const std::size_t before = KeepPixelMemory(0), floats = 300000;
  EXPECT_EQ(before, PixelMemoryKept);
  // Peaks of other tests are forgotten.
  for (int i = 0; i < 3 * 4096; ++i)
    GivePixelMemory(TakePixelMemory(50000));
  float* held = TakePixelMemory(floats);
  GivePixelMemory(TakePixelMemory(floats));
  EXPECT_EQ(PixelMemoryWaiting(), floats * sizeof(float));
  float* other = TakePixelMemory(floats + 1000);
  EXPECT_EQ(PixelMemoryWaiting(), 0u) << "a block of another size takes its place";
  GivePixelMemory(other);
  GivePixelMemory(held);
  EXPECT_EQ(KeepPixelMemory(before), 0u);
}
