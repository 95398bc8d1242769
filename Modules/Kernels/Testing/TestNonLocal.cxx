// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellNonLocal.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
Image Filtered(const quell::NonLocalInputs& in, const quell::NonLocalParameters& p, const quell::Rect& tile,
  std::int64_t* bad = nullptr)
{
  Image out(tile, 3, NaN);
  std::vector<float> scratch(quell::NonLocalScratch(in, p, tile), NaN);
  const std::int64_t n = quell::NonLocal(in, p, out, tile, scratch.data());
  if (bad)
    *bad = n;
  return out;
}
quell::NonLocalInputs Inputs(const Scene& s, bool features, bool regress)
{
  quell::NonLocalInputs in;
  in.target = in.guide = s.color;
  in.variance = s.variance;
  in.depth = s.depth;
  if (features)
  {
    in.weighing[0].value = s.normal;
    in.weighing[1].value = s.albedo;
    in.weighing[1].variance = s.variance;
    in.weighingCount = 2;
  }
  if (regress)
  {
    in.regressors[0].value = s.albedo;
    in.regressors[1].value = s.normal;
    in.regressorCount = 2;
  }
  return in;
}
quell::NonLocalParameters Small(bool regress)
{
  quell::NonLocalParameters p;
  p.radius = regress ? 3 : 4;
  p.patch = 1;
  p.kColor = 1;
  p.regress = regress;
  return p;
}
}

TEST(NonLocal, GoldenDistance)
{
  // (1 - 2)^2 - (.1 + .1) over 1e-7 + .25 (.1 + .2)
  EXPECT_NEAR(quell::NonLocalDistance(1, 2, .1, .2, .5, 1e-7), 10.666652, 1e-6);
  EXPECT_NEAR(quell::NonLocalDistance(1, 2, .1, .2, .5, 1e-10), 10.666667, 1e-6);
  EXPECT_EQ(quell::NonLocalDistance(0, 1e6, 0, 0, .5, 1e-7), 1e4);
  EXPECT_LT(quell::NonLocalDistance(1, 1, .1, .2, .5, 1e-7), 0);
  // Two pixels that touch, patches of one pixel: the weight is exp(-d).
  Image two({ 0, 0, 2, 1 }, 3, 1.f), variance({ 0, 0, 2, 1 }, 1);
  two.fill(1, 0, 1.5f);
  variance.data = { .1f, .2f };
  quell::NonLocalInputs in;
  in.target = in.guide = two;
  in.variance = variance;
  quell::NonLocalParameters p;
  p.radius = 1, p.patch = 0, p.kColor = .5;
  const double w = std::exp(-quell::NonLocalDistance(1, 1.5, .1, .2, .5, 1e-7));
  ForEachTarget([&](const char* name)
    { EXPECT_NEAR(Filtered(in, p, two.extent).at(0, 0)[1], 1 + .5 * w / (1 + w), 1e-6) << name; });
}

TEST(NonLocal, ScalarAgreesWithEveryTarget)
{
  Scene s(39, 27);
  for (float& v : s.color.data) // without fireflies of 50: the regression's own rounding is what is looked at
    v = std::min(v, 8.f);
  s.color.at(20, 10)[1] = NaN;
  s.albedo.at(10, 20)[2] = Inf;
  *s.variance.at(3, 3) = NaN;
  *s.variance.at(4, 3) = -1;
  for (const bool regress : { false, true })
    for (const bool features : { false, true })
    {
      const auto in = Inputs(s, features, regress);
      const auto p = Small(regress);
      Image scalar(s.color.extent, 3);
      quell::NonLocalScalar(in, p, scalar, s.color.extent);
      ForEachTarget(
        [&](const char* name)
        {
          const Difference d = Compare(Filtered(in, p, s.color.extent).data, scalar.data, 1e-3);
          EXPECT_LT(d.relative, 1e-5) << name << " " << regress << features;
          EXPECT_LT(d.smape, 1e-6) << name << " " << regress << features;
        });
    }
}

TEST(NonLocal, ConstantsAreFixedPoints)
{
  for (const bool regress : { false, true })
    for (const float v : { 0.f, 1e-42f, 0.1f, 7.3f, 1e30f, 3e38f })
    {
      Scene s(25, 18);
      s.color = Image(s.color.extent, 3, v);
      EXPECT_TRUE(Filtered(Inputs(s, true, regress), Small(regress), s.color.extent) == s.color) << v << regress;
    }
}

// The colour is a + b x + c y + f . feature: a first-order model says it all.
TEST(NonLocal, RegressionReproducesWhatIsLinear)
{
  const quell::Rect e{ 0, 0, 40, 30 };
  Image color(e, 3), feature(e, 2);
  Random u(4);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
    {
      feature.at(x, y)[0] = (x / 3 + y / 3) & 1 ? 0.8f : 0.2f; // a checkerboard
      feature.at(x, y)[1] = u();
      for (int c = 0; c < 3; ++c)
        color.at(x, y)[c] = 5 + 0.03f * c * x - 0.05f * y + 2 * feature.at(x, y)[0] - float(c) * feature.at(x, y)[1];
    }
  quell::NonLocalInputs in;
  in.target = in.guide = color;
  in.regressors[0].value = feature;
  in.regressorCount = 1;
  quell::NonLocalParameters p;
  p.regress = true;
  p.radius = 5, p.patch = 1;
  p.kColor = 1e3, p.epsilon = 1e30; // all weights 1
  p.ridge = 1e-6;
  const Image out = Filtered(in, p, e);
  for (size_t i = 0; i < out.data.size(); ++i)
    ASSERT_NEAR(out.data[i] / color.data[i], 1, 1e-4);
  // Features that are 0, the same everywhere, or the same as others add nothing and take nothing away.
  const Image nothing(e, 3), flat(e, 3, 0.7f);
  for (const Image* more : { &nothing, &flat, (const Image*)&feature })
  {
    in.regressors[1].value = *more;
    in.regressorCount = 2;
    const Image same = Filtered(in, p, e);
    for (size_t i = 0; i < same.data.size(); ++i)
      ASSERT_NEAR(same.data[i] / color.data[i], 1, 1e-4) << i;
  }
  in.regressorCount = 1;
  // The weighted mean does not.
  p.regress = false;
  EXPECT_GT(Compare(Filtered(in, p, e).data, color.data).relative, 0.1);
}

TEST(NonLocal, RemovesNoiseAndKeepsEdges)
{
  const quell::Rect e{ 0, 0, 64, 64 };
  for (const bool regress : { false, true })
  {
    Image a(e, 3), b(e, 3), variance(e, 1, 0.0033f); // of uniform noise of width 0.2
    Random u(9);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
        for (int c = 0; c < 3; ++c)
        {
          a.at(x, y)[c] = (x < 32 ? 0.2f : 1.f) + 0.2f * (u() - 0.5f);
          b.at(x, y)[c] = (x < 32 ? 0.2f : 1.f) + 0.2f * (u() - 0.5f);
        }
    quell::NonLocalInputs in;
    in.target = a, in.guide = b, in.variance = variance;
    quell::NonLocalParameters p;
    p.radius = 5, p.patch = 1, p.kColor = 0.7, p.regress = regress;
    const Image out = Filtered(in, p, e);
    double before = 0, after = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
      {
        const double truth = x < 32 ? 0.2 : 1;
        before += std::pow(a.at(x, y)[0] - truth, 2);
        after += std::pow(out.at(x, y)[0] - truth, 2);
      }
    EXPECT_LT(after, before / 15) << regress;
    EXPECT_NEAR(out.at(31, 30)[0], 0.2, 0.08);
    EXPECT_NEAR(out.at(32, 30)[0], 1.0, 0.08);
  }
}

// Powers of two, so that nothing rounds otherwise: with the squares of light and epsilon in its unit, no bit depends on
// the unit.
TEST(NonLocal, LightOfAnySize)
{
  Scene s(39, 27);
  const Image ofAlbedo = s.variance;
  for (const bool regress : { false, true })
  {
    quell::NonLocalParameters p = Small(regress);
    quell::NonLocalInputs in = Inputs(s, true, regress);
    in.weighing[1].variance = ofAlbedo;
    const Image wanted = Filtered(in, p, s.color.extent);
    for (const int exponent : { -45, -10, 20, 50 })
    {
      SCOPED_TRACE(exponent);
      Scene other = s;
      for (float& v : other.color.data)
        v = std::ldexp(v, exponent);
      for (float& v : other.variance.data)
        v = std::ldexp(v, 2 * exponent);
      in = Inputs(other, true, regress);
      in.weighing[1].variance = ofAlbedo;
      quell::NonLocalParameters q = p;
      q.epsilon = std::ldexp(p.epsilon, 2 * exponent);
      Image found = Filtered(in, q, s.color.extent);
      for (float& v : found.data)
        v = std::ldexp(v, -exponent);
      EXPECT_TRUE(found.data == wanted.data);
    }
  }
}

TEST(NonLocal, NonFiniteAndBackground)
{
  for (const bool regress : { false, true })
    for (const float poison : { NaN, Inf, -Inf })
    {
      Scene s(24, 24);
      s.depth = Image(s.color.extent, 1, 2.f);
      s.color = Image(s.color.extent, 3, 1.f);
      s.color.at(9, 9)[2] = poison;
      *s.depth.at(0, 0) = Inf;
      s.color.fill(0, 0, 500.f);
      std::int64_t bad = 0;
      const Image out = Filtered(Inputs(s, true, regress), Small(regress), s.color.extent, &bad);
      EXPECT_EQ(bad, 1);
      for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 24; ++x)
          ASSERT_EQ(out.at(x, y)[2], x + y ? 1.f : 500.f) << x << " " << y << " " << regress;
    }
}

TEST(NonLocal, BitsDoNotDependOnTheTile)
{
  Scene s(90, 40);
  s.color.at(33, 20)[0] = NaN;
  for (const bool regress : { false, true })
  {
    const auto in = Inputs(s, true, regress);
    const auto p = Small(regress);
    ForEachTarget(
      [&](const char* name)
      {
        const Image full = Filtered(in, p, s.color.extent);
        for (const quell::Rect tile :
          { quell::Rect{ 0, 0, 16, 16 }, quell::Rect{ 31, 17, 50, 23 }, quell::Rect{ 73, 39, 90, 40 } })
        {
          const Image part = Filtered(in, p, tile);
          for (int y = tile.y0; y < tile.y1; ++y)
            for (int x = tile.x0; x < tile.x1; ++x)
              ASSERT_EQ(0, std::memcmp(part.at(x, y), full.at(x, y), 12)) << name << regress << " " << x << " " << y;
        }
      });
  }
}

TEST(NonLocal, TinyImages)
{
  for (const quell::Rect e : { quell::Rect{ 0, 0, 1, 1 }, quell::Rect{ 0, 0, 1, 9 }, quell::Rect{ 0, 0, 40, 1 } })
    for (const bool regress : { false, true })
    {
      Scene s(e.x1, e.y1);
      const Image out = Filtered(Inputs(s, true, regress), Small(regress), e);
      for (const float v : out.data)
        EXPECT_TRUE(std::isfinite(v));
    }
}
