// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellVariance.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
using Row = void (*)(const quell::VariancePass&, int, int, int) noexcept;
struct Result
{
  Image color, variance;
};
template <class F>
Result Estimate(const quell::Rect& e, const Scene& s, bool temporal, bool ids, F&& change, Row row = quell::VarianceRow)
{
  Planes planes(e, 3, s.color, {}, s.depth, s.normal, ids ? quell::ImageIn(s.id) : quell::ImageIn(),
    temporal ? quell::ImageIn(s.moments) : quell::ImageIn(), temporal ? quell::ImageIn(s.history) : quell::ImageIn());
  quell::VariancePass p = planes.variancePass();
  change(p);
  for (int y = e.y0; y < e.y1; ++y)
    row(p, y, e.x0, e.x1);
  Result r{ Image(e, 3), Image(e, 1) };
  quell::StoreFiltered(planes.guides, p.out, s.color, {}, r.color, r.variance, e);
  return r;
}
const auto Same = [](quell::VariancePass&) {};

Scene Wall(int w, int h)
{
  Scene s(w, h);
  s.depth = Image(s.color.extent, 1, 3.f);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      s.normal.at(x, y)[0] = 0, s.normal.at(x, y)[2] = 1;
  return s;
}
}

TEST(Variance, SpatialOfANoisyWall)
{
  Scene s = Wall(64, 64);
  Random u(4);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x)
      s.color.fill(x, y, 1e4f + u()); // uniform: variance 1 / 12, at a mean where float E[x^2] - E[x]^2 is noise
  for (const Row row : { quell::VarianceRow, quell::VarianceRowScalar })
  {
    const Result r = Estimate(s.color.extent, s, false, false, Same, row);
    double mean = 0, color = 0;
    for (int y = 3; y < 61; ++y)
      for (int x = 3; x < 61; ++x)
      {
        mean += *r.variance.at(x, y);
        color += r.color.at(x, y)[1];
      }
    // Raised by 4 (a history of 1), and 48/49 because 49 samples lie nearer to their own mean.
    EXPECT_NEAR(mean / (58 * 58), 4. / 12 * 48 / 49, 0.01);
    EXPECT_NEAR(color / (58 * 58), 1e4 + 0.5, 0.01);
  }
}

TEST(Variance, TemporalWhereHistoryIsLong)
{
  Scene s = Wall(20, 20);
  s.history = Image(s.color.extent, 1, 4.f);
  *s.history.at(10, 10) = 2;
  s.moments = Image(s.color.extent, 2);
  for (int i = 0; i < 400; ++i)
    s.moments.data[2 * i] = 5.f, s.moments.data[2 * i + 1] = 0.25f;
  Result r = Estimate(s.color.extent, s, true, false, Same);
  EXPECT_EQ(*r.variance.at(3, 3), 0.25f);
  EXPECT_EQ(0, std::memcmp(r.color.at(3, 3), s.color.at(3, 3), 12));
  EXPECT_FLOAT_EQ(*r.variance.at(10, 10), 0.5f); // equal means: the pooled central moment, raised by 4 / 2
  EXPECT_NE(0, std::memcmp(r.color.at(10, 10), s.color.at(10, 10), 12));
  // Different means add their spread: half the wall at 5, half at 7, seen from the border between.
  for (int y = 0; y < 20; ++y)
    for (int x = 10; x < 20; ++x)
      s.moments.at(x, y)[0] = 7;
  s.history = Image(s.color.extent, 1, 1.f);
  r = Estimate(s.color.extent, s, true, false, Same);
  EXPECT_NEAR(*r.variance.at(10, 10), 4 * (0.25 + 4. * (3. / 7) * (4. / 7)), 1e-4);
  EXPECT_NEAR(*r.variance.at(5, 10), 4 * 0.25, 1e-5);
}

TEST(Variance, OfMeanDividesByEffectiveFrames)
{
  const Scene s(40, 30);
  const Result frame = Estimate(s.color.extent, s, true, true, Same);
  const Result mean = Estimate(s.color.extent, s, true, true,
    [](quell::VariancePass& p)
    {
      p.ofMean = true;
      p.maximumSamples = 6;
    });
  for (int i = 0; i < 1200; ++i)
    ASSERT_FLOAT_EQ(mean.variance.data[i], frame.variance.data[i] / std::min(6.f, std::max(1.f, s.history.data[i])));
}

TEST(Variance, LonePixelIsNotZero)
{
  Scene s = Wall(9, 9);
  s.color.fill(4, 4, 2.f);
  s.normal.at(4, 4)[0] = 1, s.normal.at(4, 4)[2] = 0;
  const Result r = Estimate(s.color.extent, s, false, false, Same);
  EXPECT_NEAR(*r.variance.at(4, 4), 4, 1e-5); // its luminance squared
  Scene one = Wall(1, 1);
  one.color.fill(0, 0, 3.f);
  EXPECT_NEAR(*Estimate(one.color.extent, one, false, false, Same).variance.at(0, 0), 9, 1e-5);
}

TEST(Variance, ConstantsAndExtremes)
{
  for (const float v : { 0.f, 1e-42f, 0.3f, 1e30f, 3e38f })
  {
    Scene s(24, 20);
    s.color = Image(s.color.extent, 3, v);
    ForEachTarget(
      [&](const char* name)
      {
        const Result r = Estimate(s.color.extent, s, false, false, Same);
        EXPECT_TRUE(r.color == s.color) << v << " " << name;
        for (float x : r.variance.data)
          ASSERT_TRUE(std::isfinite(x) && x >= 0) << v << " " << name;
      });
  }
  Scene s = Wall(16, 16);
  s.color = Image(s.color.extent, 3, 1.f);
  EXPECT_EQ(*Estimate(s.color.extent, s, false, false, Same).variance.at(8, 8), 0.f);
  s.color.fill(8, 8, 1e30f); // its square overflows float
  const Result r = Estimate(s.color.extent, s, false, false, Same);
  for (float v : r.variance.data)
    ASSERT_TRUE(std::isfinite(v));
  EXPECT_GT(*r.variance.at(9, 9), 1e30f);
}

TEST(Variance, NonFiniteHasNoWeight)
{
  Scene s = Wall(20, 20);
  s.color = Image(s.color.extent, 3, 2.f);
  s.color.at(10, 10)[1] = NaN;
  s.color.at(3, 10)[0] = Inf;
  s.moments = Image(s.color.extent, 2, 2.f);
  s.history = Image(s.color.extent, 1, 8.f);
  s.moments.at(6, 6)[1] = NaN;
  s.moments.at(7, 6)[0] = Inf;
  *s.history.at(15, 15) = NaN;
  for (const Row row : { quell::VarianceRow, quell::VarianceRowScalar })
  {
    Result r = Estimate(s.color.extent, s, false, false, Same, row);
    for (float v : r.color.data)
      ASSERT_EQ(v, 2.f);
    for (float v : r.variance.data)
      ASSERT_EQ(v, 0.f);
    r = Estimate(s.color.extent, s, true, false, Same, row);
    for (float v : r.color.data)
      ASSERT_EQ(v, 2.f);
    for (float v : r.variance.data)
      ASSERT_TRUE(v > 1.5f && v <= 8.f) << v;
  }
}

TEST(Variance, ScalarAgreesWithEveryTarget)
{
  const Scene s(83, 47);
  for (const bool temporal : { false, true })
    for (const bool ids : { false, true })
      for (const float sigmaNormal : { 128.f, 0.f, 3.7f })
      {
        const auto change = [&](quell::VariancePass& p) { p.sigmaNormal = sigmaNormal; };
        const Result scalar = Estimate(s.color.extent, s, temporal, ids, change, quell::VarianceRowScalar);
        ForEachTarget(
          [&](const char* name)
          {
            const Result simd = Estimate(s.color.extent, s, temporal, ids, change);
            // The rounding of the cosine is raised to the power 128 (seven squarings in float: 7e-6 of a weight).
            EXPECT_LT(Compare(simd.color.data, scalar.color.data, 0.1).relative, 1.1e-5) << name;
            EXPECT_LT(Compare(simd.color.data, scalar.color.data, 0.1).smape, 1e-6) << name;
            EXPECT_LT(Compare(simd.variance.data, scalar.variance.data, 1e-6).relative, 2e-5) << name;
          });
      }
}

TEST(Variance, BitsDoNotDependOnTheRegion)
{
  const Scene s(70, 50);
  const Result full = Estimate(s.color.extent, s, true, true, Same);
  for (const quell::Rect want : { quell::Rect{ 30, 20, 41, 33 }, quell::Rect{ 63, 0, 70, 5 } })
  {
    const Result crop = Estimate(want.grown(quell::VariancePass::Radius).clipped(s.color.extent), s, true, true, Same);
    for (int y = want.y0; y < want.y1; ++y)
      for (int x = want.x0; x < want.x1; ++x)
      {
        ASSERT_EQ(*crop.variance.at(x, y), *full.variance.at(x, y));
        ASSERT_EQ(0, std::memcmp(crop.color.at(x, y), full.color.at(x, y), 12));
      }
  }
}

// Where every pixel is old enough the short way has the bits of the long one; where one is not, it says so.
TEST(Variance, OverFramesWithoutPlanes)
{
  for (const bool ofMean : { false, true })
  {
    Scene s(45, 23);
    for (int y = 0; y < 23; ++y)
      for (int x = 0; x < 45; ++x)
        *s.history.at(x, y) = 4 + float((x + y) % 9);
    const auto change = [&](quell::VariancePass& p) { p.ofMean = ofMean; };
    const Result all = Estimate(s.color.extent, s, true, false, change);
    quell::VariancePass p;
    p.ofMean = ofMean;
    const quell::Rect tile{ 3, 2, 40, 21 };
    Image color(s.color.extent, 3), variance(s.color.extent, 1);
    const auto made = [&]
    { return quell::VarianceOverFrames(p, s.color, s.moments, s.history, s.depth, color, variance, tile); };
    ASSERT_TRUE(made());
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        EXPECT_EQ(*variance.at(x, y), *all.variance.at(x, y)) << x << " " << y;
        for (int c = 0; c < 3; ++c)
          EXPECT_EQ(color.at(x, y)[c], all.color.at(x, y)[c]) << x << " " << y;
      }
    // Outside of the tile nobody asks; in it, each of these needs neighbours.
    s.history.at(1, 1)[0] = 0;
    EXPECT_TRUE(made());
    const auto needs = [&](float& value, float bad)
    {
      const float before = value;
      value = bad;
      EXPECT_FALSE(made());
      value = before;
      EXPECT_TRUE(made());
    };
    s.depth.at(20, 10)[0] = 5;
    needs(s.history.at(20, 10)[0], 3);
    needs(s.history.at(20, 10)[0], NaN);
    needs(s.moments.at(20, 10)[0], NaN);
    needs(s.moments.at(20, 10)[1], NaN);
    needs(s.color.at(20, 10)[2], NaN);
    needs(s.color.at(39, 20)[0], std::numeric_limits<float>::infinity());
    // Background has no history and needs none.
    s.depth.at(20, 10)[0] = std::numeric_limits<float>::infinity();
    s.history.at(20, 10)[0] = 0;
    ASSERT_TRUE(made());
    EXPECT_EQ(*variance.at(20, 10), 0.f);
  }
}
