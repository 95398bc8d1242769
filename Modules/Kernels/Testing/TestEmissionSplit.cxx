// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellEmissionSplit.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
struct Split
{
  Image emission, rest, mask;
  std::int64_t bad = 0;
  Split(const Image& in, const quell::EmissionSplitParameters& p, const quell::Rect& tile)
    : emission(tile, 3, NaN)
    , rest(tile, 3, NaN)
    , mask(tile, 1, NaN)
  {
    bad = quell::EmissionSplit(in, p, emission, rest, mask, tile);
  }
};
/// A lamp of 6 x 4 pixels with soft edges, a firefly, a pair of fireflies.
Image Room()
{
  Image room({ 0, 0, 30, 30 }, 3, 0.1f);
  for (int y = 10; y < 14; ++y)
    for (int x = 8; x < 14; ++x)
      room.fill(x, y, 17.f);
  for (int x = 8; x < 14; ++x)
    room.fill(x, 14, 2.f); // half covered
  room.fill(22, 22, 500.f);
  room.fill(25, 5, 50.f);
  room.fill(26, 5, 50.f);
  return room;
}
}

TEST(EmissionSplit, LampsAreAreasAndFirefliesAreNot)
{
  const Image room = Room();
  const Split s(room, {}, room.extent);
  int lamps = 0;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 30; ++x)
    {
      const bool lamp = x >= 8 && x < 14 && y >= 10 && y < 15;
      ASSERT_EQ(*s.mask.at(x, y), lamp ? 1.f : 0.f) << x << " " << y;
      lamps += lamp;
    }
  EXPECT_EQ(lamps, 30);
  quell::EmissionSplitParameters all;
  all.neighbours = 0;
  EXPECT_EQ(*Split(room, all, room.extent).mask.at(22, 22), 1.f);
  quell::EmissionSplitParameters tight;
  tight.grow = 0;
  EXPECT_EQ(*Split(room, tight, room.extent).mask.at(9, 14), 0.f);
  quell::EmissionSplitParameters none;
  none.threshold = 1e30f;
  EXPECT_TRUE(Split(room, none, room.extent).rest == room);
}

// Noise beside a lamp is none of the lamp: the edge is measured by the lamp, not by the threshold.
TEST(EmissionSplit, NoiseBesideALampIsNoEdge)
{
  Image room = Room();
  Random u(3);
  int noisy = 0;
  for (int y = 8; y < 17; ++y)
    for (int x = 6; x < 16; ++x)
      if (room.at(x, y)[1] < 1)
      {
        room.fill(x, y, .8f * u()); // .05 x 17 = .85
        noisy += room.at(x, y)[1] > .05f * 4;
      }
  EXPECT_GT(noisy, 20);
  const Split s(room, {}, room.extent);
  for (int y = 8; y < 17; ++y)
    for (int x = 6; x < 16; ++x)
      ASSERT_EQ(*s.mask.at(x, y), x >= 8 && x < 14 && y >= 10 && y < 15 ? 1.f : 0.f) << x << " " << y;
  room.fill(7, 11, .86f);
  EXPECT_EQ(*Split(room, {}, room.extent).mask.at(7, 11), 1.f);
}

TEST(EmissionSplit, TheSumIsTheInput)
{
  const Scene scene(40, 30); // its fireflies are dense enough to touch
  quell::EmissionSplitParameters p;
  p.threshold = 1.5f, p.neighbours = 1;
  const Split s(scene.color, p, scene.color.extent);
  int lamps = 0;
  for (size_t i = 0; i < s.rest.data.size(); ++i)
  {
    ASSERT_EQ(s.rest.data[i] + s.emission.data[i], scene.color.data[i]);
    ASSERT_TRUE(s.rest.data[i] == 0 || s.emission.data[i] == 0);
    lamps += s.emission.data[i] != 0;
  }
  EXPECT_GT(lamps, 100);
  EXPECT_LT(lamps, 3000);
}

TEST(EmissionSplit, NonFinitePixelsAndTiles)
{
  Image room = Room();
  room.fill(10, 12, NaN);
  room.fill(20, 3, Inf);
  const Split s(room, {}, room.extent);
  EXPECT_EQ(s.bad, 2);
  EXPECT_EQ(*s.mask.at(10, 12), 1.f); // a hole in the lamp is lamp
  EXPECT_EQ(s.emission.at(10, 12)[1], 17.f);
  EXPECT_EQ(s.rest.at(20, 3)[0], 0.1f);
  for (const Image* image : { &s.emission, &s.rest, &s.mask })
    for (const float v : image->data)
      EXPECT_TRUE(std::isfinite(v));
  for (const quell::Rect tile : { quell::Rect{ 7, 9, 12, 20 }, quell::Rect{ 13, 14, 14, 15 } })
  {
    const Split part(room, {}, tile);
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        ASSERT_EQ(*part.mask.at(x, y), *s.mask.at(x, y));
        ASSERT_EQ(0, std::memcmp(part.rest.at(x, y), s.rest.at(x, y), 12));
      }
  }
}
