// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellATrous.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
using Rows = void (*)(const quell::ATrousPass&, int, int, int, int) noexcept;

/// Filters a whole image; `change` edits the pass. Vector rows unless `filter` says otherwise, `together` rows a call.
struct Result
{
  Image color, variance;
};
template <class F>
Result Filter(const quell::Rect& e, const Scene& s, bool variance, bool normals, bool ids, int passes, F&& change,
  Rows filter = quell::ATrousRows, int together = 1000)
{
  Planes planes(e, std::max(3, 2 << passes), s.color, variance ? quell::ImageIn(s.variance) : quell::ImageIn(), s.depth,
    normals ? quell::ImageIn(s.normal) : quell::ImageIn(), ids ? quell::ImageIn(s.id) : quell::ImageIn());
  quell::ATrousPass p = planes.pass(1);
  change(p);
  for (int k = 0; k < passes; ++k)
  {
    p.step = 1 << k;
    for (int phase = 0; phase < std::min(p.step, e.height()); ++phase)
    {
      const int rows = (e.height() - phase + p.step - 1) / p.step;
      for (int i = 0; i < rows; i += together)
        filter(p, e.y0 + phase + i * p.step, std::min(together, rows - i), e.x0, e.x1);
    }
    std::swap(p.in, p.out);
  }
  Result r{ Image(e, 3), Image(e, 1) };
  quell::StoreFiltered(planes.guides, p.in, s.color, s.variance, r.color, r.variance, e);
  return r;
}
const auto Same = [](quell::ATrousPass&) {};

/// Colour only, flat geometry, no edge stopping: the bare kernel.
Scene Flat(int w, int h, float value)
{
  Scene s(w, h);
  s.color = Image(s.color.extent, 3, value);
  s.variance = Image(s.color.extent, 1, 1.f);
  s.depth = Image(s.color.extent, 1, 2.f);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      s.normal.at(x, y)[0] = 0, s.normal.at(x, y)[2] = 1;
  s.id = Image(s.color.extent, 1, 1.f);
  return s;
}
const auto NoEdges = [](quell::ATrousPass& p) { p.fixedSigma = 1e30f; };
}

// The published micro-test: a 5 x 5 ramp, luminance = depth = x, variance 1, one pass, epsilons 1e-6.
TEST(ATrous, GoldenRamp)
{
  Scene s = Flat(5, 5, 0);
  for (int y = 0; y < 5; ++y)
    for (int x = 0; x < 5; ++x)
    {
      s.color.fill(x, y, float(x));
      *s.depth.at(x, y) = float(x);
    }
  const double color[3] = { .2160739, 1.0524077, 2.0000000 }, variance[3] = { .1881337, .1458541, .1386788 };
  const auto epsilons = [](quell::ATrousPass& p) { p.depthEpsilon = p.luminanceEpsilon = 1e-6f; };
  for (const Rows row : { quell::ATrousRows, quell::ATrousRowsScalar })
  {
    const Result r = Filter(s.color.extent, s, true, true, true, 1, epsilons, row);
    for (int x = 0; x < 3; ++x)
    {
      EXPECT_NEAR(r.color.at(x, 2)[0], color[x], 2e-6) << x;
      EXPECT_NEAR(*r.variance.at(x, 2), variance[x], 1e-6) << x;
    }
  }
}

TEST(ATrous, ImpulseIsTheB3Spline)
{
  Scene s = Flat(13, 13, 0);
  s.color.fill(6, 6, 256.f);
  const Result r = Filter(s.color.extent, s, false, false, false, 1, NoEdges);
  const int h[5] = { 1, 4, 6, 4, 1 };
  for (int y = 2; y < 11; ++y)
    for (int x = 2; x < 11; ++x)
    {
      const bool in = std::abs(x - 6) <= 2 && std::abs(y - 6) <= 2;
      EXPECT_EQ(r.color.at(x, y)[1], in ? float(h[x - 4] * h[y - 4]) : 0.f) << x << " " << y;
    }
}

// Noise gain and width of the cascade, away from borders.
TEST(ATrous, CascadeGainAndWidth)
{
  const double gain[4] = { 7.4768e-2, 1.5246e-2, 3.6433e-3, 9.0088e-4 };
  for (int n = 1; n <= 4; ++n)
  {
    const int half = quell::ATrousHalo(n), size = 4 * half + 1, c = 2 * half;
    Scene s = Flat(size, size, 0);
    s.color.fill(c, c, 1.f);
    const Result r = Filter(s.color.extent, s, false, false, false, n, NoEdges);
    double sum = 0, squares = 0, width = 0;
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x)
      {
        const double v = r.color.at(x, y)[0];
        sum += v;
        squares += v * v;
        width += v * (x - c) * (x - c);
      }
    EXPECT_NEAR(sum, 1, 1e-5);
    EXPECT_NEAR(squares / gain[n - 1], 1, 1e-4) << n;
    EXPECT_NEAR(width, (std::pow(4., n) - 1) / 3, 1e-3) << n;
    // The halo is exact: the kernel reaches it and no further.
    EXPECT_GT(r.color.at(c + half, c)[0], 0.f);
    EXPECT_EQ(r.color.at(c + half + 1, c)[0], 0.f);
  }
}

TEST(ATrous, VarianceIsFilteredWithSquaredWeights)
{
  Scene s = Flat(32, 32, 1);
  const Result r = Filter(s.color.extent, s, true, true, true, 3, Same);
  EXPECT_NEAR(*r.variance.at(16, 16), std::pow(.0747681, 3), 1e-8);
}

TEST(ATrous, ConstantsAreFixedPoints)
{
  for (const float v : { 0.f, 1e-42f, 0.1f, 7.3f, 1e30f, 3e38f })
  {
    Scene s(48, 40);
    s.color = Image(s.color.extent, 3, v);
    ForEachTarget(
      [&](const char* name)
      {
        const Result r = Filter(s.color.extent, s, true, true, false, 4, Same);
        EXPECT_TRUE(r.color == s.color) << v << " " << name;
      });
    EXPECT_TRUE(Filter(s.color.extent, s, false, true, true, 2, Same).color == s.color) << v;
  }
}

TEST(ATrous, ZeroVarianceKeepsTheImage)
{
  Scene s(40, 30);
  s.variance = Image(s.color.extent, 1, 0.f);
  const Result r = Filter(s.color.extent, s, true, true, false, 3, Same);
  // Neighbours differ by far more than the epsilon 1e-6 (1 + l).
  EXPECT_TRUE(r.color.data == s.color.data);
}

// 0^128 = 0 for every neighbour, 1 for the pixel itself.
TEST(ATrous, ANormalOfLengthZeroCountsForItselfAlone)
{
  Scene s = Flat(33, 29, 0);
  Random u(9);
  for (float& v : s.color.data)
    v = u();
  for (int k = 0; k < 3; ++k)
    s.normal.at(16, 14)[k] = 0;
  Scene other = s;
  other.color.fill(16, 14, 1e6f);
  for (const Rows rows : { quell::ATrousRows, quell::ATrousRowsScalar })
  {
    const Result r = Filter(s.color.extent, s, false, true, false, 3, NoEdges, rows);
    const Result q = Filter(s.color.extent, other, false, true, false, 3, NoEdges, rows);
    for (int y = 0; y < 29; ++y)
      for (int x = 0; x < 33; ++x)
      {
        if (x != 16 || y != 14)
        {
          ASSERT_EQ(0, std::memcmp(r.color.at(x, y), q.color.at(x, y), 12)) << x << " " << y;
        }
      }
    EXPECT_NEAR(r.color.at(16, 14)[1], s.color.at(16, 14)[1], 1e-6);
    EXPECT_NEAR(q.color.at(16, 14)[1], 1e6, 1);
    EXPECT_GT(std::fabs(r.color.at(12, 12)[1] - s.color.at(12, 12)[1]), 1e-3) << "others are filtered";
  }
}

TEST(ATrous, EdgesStop)
{
  Scene s = Flat(32, 16, 0);
  for (int y = 0; y < 16; ++y)
    for (int x = 16; x < 32; ++x)
      s.color.fill(x, y, 1.f);
  // Nothing but luminance differs, and it is allowed to: the step is blurred.
  EXPECT_GT(Filter(s.color.extent, s, false, true, true, 2, NoEdges).color.at(15, 8)[0], 0.1f);
  Scene depth = s, normal = s, id = s, sky = s;
  for (int y = 0; y < 16; ++y)
    for (int x = 16; x < 32; ++x)
    {
      *depth.depth.at(x, y) = 2.2f;
      normal.normal.at(x, y)[0] = 1, normal.normal.at(x, y)[2] = 0;
      *id.id.at(x, y) = 2;
      *sky.depth.at(x, y) = Inf;
    }
  for (const Scene* t : { &depth, &normal, &id, &sky })
    EXPECT_LT(
      Compare(Filter(s.color.extent, *t, false, true, true, 2, NoEdges).color.data, s.color.data).relative, 1e-6);
  // An exponent of 0 accepts every normal.
  EXPECT_GT(Filter(s.color.extent, normal, false, true, false, 2,
              [](quell::ATrousPass& p)
              {
                p.fixedSigma = 1e30f;
                p.sigmaNormal = 0;
              })
              .color.at(15, 8)[0],
    0.1f);
}

TEST(ATrous, SlantedPlaneIsOneSurface)
{
  Scene s = Flat(40, 40, 0);
  Random u(5);
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 40; ++x)
    {
      s.color.fill(x, y, u());
      *s.depth.at(x, y) = 10 + 0.5f * x - 0.25f * y;
    }
  const auto spread = [&](const Image& image)
  {
    double sum = 0, squares = 0;
    for (int y = 8; y < 32; ++y)
      for (int x = 8; x < 32; ++x)
      {
        sum += image.at(x, y)[0];
        squares += double(image.at(x, y)[0]) * image.at(x, y)[0];
      }
    return squares / 576 - sum * sum / 576 / 576;
  };
  const double tilted = spread(Filter(s.color.extent, s, false, true, true, 3, NoEdges).color);
  EXPECT_LT(tilted, 0.05 * spread(s.color)); // still smooths well along the slope
  for (int i = 0; i < 1600; ++i)
    s.depth.data[i] += 5 * u(); // rough depth: taps no longer fit the slope
  EXPECT_GT(spread(Filter(s.color.extent, s, false, true, true, 3, NoEdges).color), 2 * tilted);
}

TEST(ATrous, ScalarAgreesWithEveryTarget)
{
  const Scene s(97, 61);
  for (const bool variance : { true, false })
    for (const bool normals : { true, false })
      for (const bool ids : { false, true })
        for (const float sigmaNormal : { 128.f, 50.f, 1.f, 0.f })
          for (const int passes : { 1, 4 })
          {
            const auto change = [&](quell::ATrousPass& p)
            {
              p.sigmaNormal = sigmaNormal;
              p.fixedSigma = 0.7f;
            };
            const Result scalar =
              Filter(s.color.extent, s, variance, normals, ids, passes, change, quell::ATrousRowsScalar);
            ForEachTarget(
              [&](const char* name)
              {
                const Result simd = Filter(s.color.extent, s, variance, normals, ids, passes, change);
                const Difference c = Compare(simd.color.data, scalar.color.data);
                EXPECT_LT(c.relative, 1e-5) << name << " " << sigmaNormal << " " << variance << normals << ids;
                EXPECT_LT(c.smape, 1e-6) << name;
                if (variance)
                {
                  // Squared weights, with the rounding of a cosine to the power 128 in each of four passes.
                  EXPECT_LT(
                    Compare(simd.variance.data, scalar.variance.data, 1e-6).relative, passes == 1 ? 1e-5 : 2.5e-5)
                    << name;
                }
              });
          }
}

// What neighbouring rows share has the same bits as what each computes alone; wide images are done in several pieces.
TEST(ATrous, BitsDoNotDependOnTheRowsSharedOut)
{
  const Scene s(1300, 9), tall(70, 130);
  ForEachTarget(
    [&](const char* name)
    {
      for (const Scene* scene : { &s, &tall })
        for (const bool ids : { false, true })
          for (const float sigmaNormal : { 128.f, 50.f })
          {
            const auto change = [&](quell::ATrousPass& p) { p.sigmaNormal = sigmaNormal; };
            const auto run = [&](int together)
            { return Filter(scene->color.extent, *scene, true, true, ids, 5, change, quell::ATrousRows, together); };
            const Result all = run(1000);
            for (const int together : { 1, 2, 7 })
            {
              const Result some = run(together);
              EXPECT_TRUE(some.color == all.color && some.variance == all.variance) << name << " " << together;
            }
          }
    });
}

// The same pixel from another crop, another strip of columns, another layout: the same bits.
TEST(ATrous, BitsDoNotDependOnTheRegion)
{
  const Scene s(120, 70);
  const int passes = 3;
  ForEachTarget(
    [&](const char* name)
    {
      const Result full = Filter(s.color.extent, s, true, true, true, passes, Same);
      for (const quell::Rect want : { quell::Rect{ 50, 30, 63, 41 }, quell::Rect{ 0, 0, 9, 70 },
             quell::Rect{ 101, 52, 120, 70 }, quell::Rect{ 61, 35, 62, 36 } })
      {
        const quell::Rect read = want.grown(quell::ATrousHalo(passes)).clipped(s.color.extent);
        const Result crop = Filter(read, s, true, true, true, passes, Same);
        for (int y = want.y0; y < want.y1; ++y)
          for (int x = want.x0; x < want.x1; ++x)
          {
            ASSERT_EQ(0, std::memcmp(crop.color.at(x, y), full.color.at(x, y), 12)) << name << " " << x << " " << y;
            ASSERT_EQ(*crop.variance.at(x, y), *full.variance.at(x, y)) << name << " " << x << " " << y;
          }
      }
    });
}

TEST(ATrous, NonFiniteIsContained)
{
  for (const float poison : { NaN, Inf, -Inf })
  {
    Scene s = Flat(24, 24, 1);
    Random u(9);
    for (float& v : s.color.data)
      v = 1 + 0.1f * u();
    const Result clean = Filter(s.color.extent, s, true, true, false, 3, Same);
    Scene bad = s;
    bad.color.at(12, 12)[0] = poison;
    Planes planes(s.color.extent, 8, bad.color, s.variance, s.depth, s.normal);
    EXPECT_EQ(planes.bad, 1);
    for (const Rows row : { quell::ATrousRows, quell::ATrousRowsScalar })
    {
      const Result r = Filter(s.color.extent, bad, true, true, false, 3, Same, row);
      for (size_t i = 0; i < r.color.data.size(); ++i)
      {
        ASSERT_TRUE(r.color.data[i] > 0.99f && r.color.data[i] < 1.11f) << i;
        ASSERT_NEAR(r.color.data[i], clean.color.data[i], 0.02);
      }
      for (float v : r.variance.data)
        ASSERT_TRUE(v > 0 && v < 1);
      // One pass reaches 2 pixels; further away not a bit has changed.
      const Result one = Filter(s.color.extent, bad, true, true, false, 1, Same, row);
      const Result cleanOne = Filter(s.color.extent, s, true, true, false, 1, Same, row);
      EXPECT_EQ(0, std::memcmp(one.color.at(0, 9), cleanOne.color.at(0, 9), 3 * 24 * sizeof(float)));
    }
    // Guides that are no numbers: depth counts as no hit, a normal as none.
    Scene guides = s;
    *guides.depth.at(5, 5) = poison;
    guides.normal.at(8, 8)[1] = poison;
    *guides.variance.at(15, 15) = poison;
    const Result r = Filter(s.color.extent, guides, true, true, false, 3, Same);
    for (int c = 0; c < 3; ++c)
    {
      EXPECT_EQ(r.color.at(5, 5)[c], s.color.at(5, 5)[c]);
      EXPECT_EQ(r.color.at(8, 8)[c], s.color.at(8, 8)[c]);
    }
    for (float v : r.color.data)
      ASSERT_TRUE(v > 0.99f && v < 1.11f);
    for (float v : r.variance.data)
      ASSERT_TRUE(std::isfinite(v) && v >= 0);
  }
}

TEST(ATrous, NoFiniteNeighbourGivesZero)
{
  Scene s = Flat(6, 6, 0);
  s.color = Image(s.color.extent, 3, NaN);
  const Result r = Filter(s.color.extent, s, true, true, false, 2, Same);
  for (float v : r.color.data)
    EXPECT_EQ(v, 0.f);
  for (float v : r.variance.data)
    EXPECT_EQ(v, 0.f);
}

TEST(ATrous, BackgroundPassesThrough)
{
  Scene s(40, 30);
  Result r = Filter(s.color.extent, s, true, true, false, 3, Same);
  int sky = 0;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      if (*s.depth.at(x, y) == Inf)
      {
        ++sky;
        ASSERT_EQ(0, std::memcmp(r.color.at(x, y), s.color.at(x, y), 12));
        ASSERT_EQ(*r.variance.at(x, y), *s.variance.at(x, y));
      }
  EXPECT_GT(sky, 20);
  s.depth = Image(s.color.extent, 1, Inf);
  r = Filter(s.color.extent, s, true, true, false, 3, Same);
  EXPECT_TRUE(r.color == s.color);
}

TEST(ATrous, TinyAndThinImages)
{
  for (const quell::Rect e :
    { quell::Rect{ 0, 0, 1, 1 }, quell::Rect{ 0, 0, 1, 17 }, quell::Rect{ 0, 0, 33, 1 }, quell::Rect{ 0, 0, 2, 2 } })
  {
    Scene s = Flat(e.x1, e.y1, 2.5f);
    EXPECT_TRUE(Filter(e, s, true, true, true, 5, Same).color == s.color);
    Random u(2);
    for (float& v : s.color.data)
      v = u();
    const Result simd = Filter(e, s, true, true, true, 5, Same);
    const Result scalar = Filter(e, s, true, true, true, 5, Same, quell::ATrousRowsScalar);
    EXPECT_LT(Compare(simd.color.data, scalar.color.data).relative, 5e-5);
    if (e.area() == 1)
    {
      EXPECT_TRUE(simd.color == s.color);
    }
  }
}

TEST(ATrous, HugeVarianceAndValuesStayFinite)
{
  Scene s = Flat(16, 16, 1e30f);
  s.color.fill(8, 8, 3e38f);
  s.variance = Image(s.color.extent, 1, Inf);
  const Result r = Filter(s.color.extent, s, true, true, true, 3, Same);
  double in = 0, out = 0;
  for (size_t i = 0; i < r.color.data.size(); ++i)
  {
    ASSERT_TRUE(std::isfinite(r.color.data[i]) && r.color.data[i] >= 0.99e30f);
    in = std::max(in, double(s.color.data[i]));
    out = std::max(out, double(r.color.data[i]));
  }
  EXPECT_LE(out, in);
  for (float v : r.variance.data)
    ASSERT_TRUE(std::isfinite(v));
}

// The difference of two colours may exceed the largest float although both are below it.
TEST(ATrous, OppositeExtremesStayFinite)
{
  for (const float a : { 2e38f, FLT_MAX })
    for (const bool variance : { false, true })
      for (const Rows row : { quell::ATrousRows, quell::ATrousRowsScalar })
      {
        Scene s = Flat(40, 40, 1.f);
        s.color.fill(20, 20, a);
        s.color.fill(21, 20, -a);
        const Result r = Filter(s.color.extent, s, variance, true, true, 5, Same, row);
        for (float v : r.color.data)
          ASSERT_TRUE(std::isfinite(v)) << v;
        EXPECT_NEAR(r.color.at(0, 0)[0], 1, 1e-5); // the taps that far away are no neighbours of 1
      }
}
