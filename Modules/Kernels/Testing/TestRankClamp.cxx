// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellRankClamp.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cfloat>
#include <functional>

using namespace quelltest;

namespace
{
quell::ClampLedger Apply(const Image& in, const Image& id, const quell::RankClampParameters& p, Image& out, Image& rest)
{
  out = Image(in.extent, 3);
  rest = Image(in.extent, 3);
  std::vector<float> scratch(quell::RankClampScratch(p, in.extent));
  return quell::RankClamp(in, id, p, out, rest, in.extent, scratch.data());
}
quell::RankClampParameters Parameters(int radius, int rank, double factor = 1)
{
  quell::RankClampParameters p;
  p.radius = radius, p.rank = rank, p.factor = factor;
  return p;
}
}

TEST(RankClamp, TheRankthLargestNeighbourIsTheLimit)
{
  Image in({ 0, 0, 3, 3 }, 3), out, rest;
  for (int i = 0; i < 9; ++i)
    in.fill(i % 3, i / 3, float(i)); // the centre is 4; its neighbours 0 1 2 3 5 6 7 8
  in.fill(1, 1, 100);
  for (int rank = 1; rank <= 10; ++rank)
    for (const double factor : { 1., 1.5 })
    {
      const auto ledger = Apply(in, {}, Parameters(1, rank, factor), out, rest);
      const float neighbours[] = { 8, 7, 6, 5, 3, 2, 1, 0 };
      const float limit = float(neighbours[std::min(rank, 8) - 1] * factor);
      EXPECT_NEAR(out.at(1, 1)[0], limit, 1e-6 * limit) << rank;
      EXPECT_EQ(out.at(1, 1)[0] + rest.at(1, 1)[0], 100.f);
      EXPECT_GE(ledger.Clamped, 1);
      EXPECT_NEAR(ledger.EnergyIn, 0 + 1 + 2 + 3 + 100 + 5 + 6 + 7 + 8, 1e-5);
    }
  // Hue stays.
  in.at(1, 1)[0] = 10, in.at(1, 1)[1] = 20, in.at(1, 1)[2] = 0;
  Apply(in, {}, Parameters(1, 1), out, rest);
  EXPECT_NEAR(out.at(1, 1)[1] / out.at(1, 1)[0], 2, 1e-6);
  EXPECT_EQ(out.at(1, 1)[2], 0);
  EXPECT_NEAR(.2126 * out.at(1, 1)[0] + .7152 * out.at(1, 1)[1], 8, 1e-5);
}

TEST(RankClamp, SpotsOfUpToRankPixelsGo)
{
  for (const int pixels : { 1, 2, 3 })
    for (const int rank : { 1, 2 })
    {
      Image in({ 0, 0, 9, 9 }, 3, 1.f), out, rest;
      const int spot[3][2] = { { 4, 4 }, { 5, 4 }, { 4, 5 } };
      for (int i = 0; i < pixels; ++i)
        in.fill(spot[i][0], spot[i][1], 50);
      const auto ledger = Apply(in, {}, Parameters(1, rank), out, rest);
      if (pixels > rank)
        EXPECT_TRUE(out == in) << pixels << " " << rank;
      else
      {
        EXPECT_EQ(ledger.Clamped, pixels) << pixels << " " << rank;
        for (float v : out.data)
          EXPECT_NEAR(v, 1, 1e-6);
      }
    }
}

TEST(RankClamp, AgainstSortingForEveryPixel)
{
  Scene scene(41, 37, 5);
  for (const bool ids : { false, true })
    for (const auto& p : { Parameters(1, 2), Parameters(2, 3, 1.25), Parameters(8, 20, .9), Parameters(1, 8, 3) })
    {
      Image out, rest;
      const auto ledger = Apply(scene.color, ids ? scene.id : Image(), p, out, rest);
      std::int64_t clamped = 0;
      for (int y = 0; y < 37; ++y)
        for (int x = 0; x < 41; ++x)
        {
          std::vector<double> sizes;
          for (int qy = y - p.radius; qy <= y + p.radius; ++qy)
            for (int qx = x - p.radius; qx <= x + p.radius; ++qx)
              if ((qx != x || qy != y) && scene.color.extent.contains(qx, qy) &&
                  (!ids || *scene.id.at(qx, qy) == *scene.id.at(x, y)))
                sizes.push_back(quell::MeasureOf(scene.color.at(qx, qy), p.measure));
          std::sort(sizes.begin(), sizes.end(), std::greater<double>());
          const float* c = scene.color.at(x, y);
          double scale = 1;
          if (!sizes.empty())
            scale = std::min(
              1., p.factor * sizes[std::min(size_t(p.rank), sizes.size()) - 1] / quell::MeasureOf(c, p.measure));
          clamped += scale < 1;
          for (int k = 0; k < 3; ++k)
          {
            ASSERT_NEAR(out.at(x, y)[k], c[k] * scale, 1e-6 * c[k]) << x << " " << y;
            ASSERT_EQ(out.at(x, y)[k] + rest.at(x, y)[k], c[k]);
          }
        }
      EXPECT_NEAR(double(ledger.Clamped), double(clamped), 2); // sizes equal but for the last place
      EXPECT_GT(clamped, 5);
    }
}

TEST(RankClamp, ConstantsBordersAndWhatDoesNotCount)
{
  Image out, rest;
  for (const quell::Rect e : { quell::Rect{ 0, 0, 7, 5 }, quell::Rect{ 0, 0, 1, 1 }, quell::Rect{ 0, 0, 1, 9 } })
    for (const float v : { 0.f, 1e-42f, .3f, 1e30f, FLT_MAX })
      for (const auto& p : { Parameters(1, 1), Parameters(1, 8), Parameters(8, 288) })
      {
        const Image in(e, 3, v);
        EXPECT_EQ(Apply(in, {}, p, out, rest).Clamped, 0);
        EXPECT_TRUE(out == in);
      }
  // Nobody of its kind around: stays. Radius 0 and a factor beyond everything: off.
  Image in({ 0, 0, 3, 3 }, 3, 1.f), id({ 0, 0, 3, 3 }, 1, 1.f);
  in.fill(1, 1, 40);
  id.fill(1, 1, 2);
  EXPECT_EQ(Apply(in, id, Parameters(1, 1), out, rest).Clamped, 0);
  EXPECT_EQ(Apply(in, {}, Parameters(1, 1), out, rest).Clamped, 1);
  EXPECT_EQ(Apply(in, {}, Parameters(0, 1), out, rest).Clamped, 0);
  EXPECT_EQ(Apply(in, {}, Parameters(1, 1, 1e30), out, rest).Clamped, 0);
  // Taps and centre that are not numbers.
  in.at(0, 0)[1] = Inf;
  in.at(1, 1)[0] = NaN;
  const auto ledger = Apply(in, {}, Parameters(1, 1), out, rest);
  EXPECT_EQ(ledger.NonFinite, 2);
  EXPECT_NEAR(ledger.EnergyIn, 7, 1e-6);
  for (float v : out.data)
    EXPECT_EQ(v, 1);
  for (float v : rest.data)
    EXPECT_EQ(v, 0);
  // A scale below the smallest normal number.
  in = Image({ 0, 0, 3, 1 }, 3, 1e-38f);
  in.fill(1, 0, FLT_MAX);
  Apply(in, {}, Parameters(1, 1), out, rest);
  EXPECT_NEAR(out.at(1, 0)[0], 1e-38, 1e-43);
}

TEST(RankClamp, TilesMakeNoDifference)
{
  Scene scene(50, 40, 9);
  const auto p = Parameters(3, 4, 1.1);
  Image whole, rest;
  Apply(scene.color, scene.id, p, whole, rest);
  Image tiled(scene.color.extent, 3);
  double removed = 0, all = 0;
  for (int y = 0; y < 40; y += 7)
    for (int x = 0; x < 50; x += 11)
    {
      const quell::Rect tile{ x, y, std::min(50, x + 11), std::min(40, y + 7) };
      std::vector<float> scratch(quell::RankClampScratch(p, tile));
      removed += quell::RankClamp(scene.color, scene.id, p, tiled, {}, tile, scratch.data()).EnergyRemoved;
    }
  EXPECT_TRUE(tiled == whole);
  std::vector<float> scratch(quell::RankClampScratch(p, scene.color.extent));
  all = quell::RankClamp(scene.color, scene.id, p, {}, {}, scene.color.extent, scratch.data()).EnergyRemoved;
  EXPECT_NEAR(removed, all, 1e-9 * all);
  EXPECT_GT(all, 0);
}

TEST(RankClamp, LargestFactorIsOff)
{
  Image in({ 0, 0, 9, 9 }, 3), out, rest;
  in.fill(4, 4, 7); // between black ones
  in.fill(1, 1, FLT_MAX);
  EXPECT_EQ(Apply(in, {}, Parameters(1, 1, 1e30), out, rest).Clamped, 0);
  EXPECT_TRUE(out == in);
  EXPECT_EQ(Apply(in, {}, Parameters(1, 1, 9e29), out, rest).Clamped, 2);
}
