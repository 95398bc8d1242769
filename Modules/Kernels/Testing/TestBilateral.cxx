// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellBilateral.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
quell::BilateralInputs Inputs(const Scene& s, int guides)
{
  quell::BilateralInputs in;
  in.radiance = s.color;
  if (guides & 1)
    in.depth = s.depth;
  if (guides & 2)
    in.normal = s.normal;
  if (guides & 4)
    in.albedo = s.albedo;
  if (guides & 8)
    in.position = s.position;
  if (guides & 16)
    in.id = s.id;
  return in;
}
Image Filtered(const quell::BilateralInputs& in, const quell::BilateralParameters& p, const quell::Rect& tile,
  std::int64_t* bad = nullptr)
{
  Image out(tile, 3, NaN);
  std::vector<float> scratch(quell::BilateralScratch(in, p, tile), NaN);
  const std::int64_t n = quell::Bilateral(in, p, { out, {} }, tile, scratch.data());
  if (bad)
    *bad = n;
  return out;
}
quell::BilateralParameters Gaussian(double sigma, int radius)
{
  quell::BilateralParameters p;
  p.radius = radius;
  p.sigmaSpatial = sigma;
  p.sigmaRange = 1e30;
  return p;
}
}

// Columns 0, 0, 1, centre column: the published value of the step.
TEST(Bilateral, GoldenStep)
{
  const quell::Rect e{ 0, 0, 3, 3 };
  Image image(e, 3, 0.f), scalar(e, 3);
  for (int y = 0; y < 3; ++y)
    image.at(2, y)[0] = 1;
  quell::BilateralInputs in;
  in.radiance = image;
  quell::BilateralParameters p = Gaussian(1, 1);
  p.sigmaRange = 1;
  p.range = quell::RangeSpace::Linear;
  ForEachTarget([&](const char* name) { EXPECT_NEAR(Filtered(in, p, e).at(1, 1)[0], .186323724, 2e-7) << name; });
  quell::BilateralScalar(in, p, { scalar, {} }, e);
  EXPECT_NEAR(scalar.at(1, 1)[0], .186323724, 2e-8);
  p.sigmaRange = 0.1; // the step is preserved
  EXPECT_LT(Filtered(in, p, e).at(1, 1)[0], 1e-20f);
}

// Noise gain of the Gaussian with sigma 1 and radius 3, and of the box.
TEST(Bilateral, GaussianAndBoxLimits)
{
  const quell::Rect e{ 0, 0, 15, 15 };
  Image image(e, 3, 0.f);
  image.fill(7, 7, 1.f);
  quell::BilateralInputs in;
  in.radiance = image;
  const auto squares = [&](const quell::BilateralParameters& p)
  {
    double sum = 0;
    for (float v : Filtered(in, p, e).data)
      sum += double(v) * v / 3;
    return sum;
  };
  EXPECT_NEAR(Filtered(in, Gaussian(1, 3), e).at(7, 7)[0], 1 / 6.279784796, 2e-7); // one ulp of the peak, 1
  EXPECT_NEAR(squares(Gaussian(1, 3)), .079680140, 1e-7);
  EXPECT_NEAR(squares(Gaussian(1e30, 1)), 1 / 9., 1e-7);
  EXPECT_NEAR(squares(Gaussian(1e29, 1)), 1 / 9., 1e-7);
  EXPECT_NEAR(squares(Gaussian(1e30, 2)), 1 / 25., 1e-7);
}

TEST(Bilateral, IdentityLimits)
{
  const Scene s(30, 20);
  for (const auto& p : { Gaussian(0, 5), Gaussian(2, 0) })
  {
    const Image out = Filtered(Inputs(s, 0), p, s.color.extent);
    EXPECT_TRUE(out == s.color);
  }
  // Range sigma 0: only equal colours mix, and no two are equal here.
  quell::BilateralParameters p = Gaussian(2, 3);
  p.sigmaRange = 0;
  EXPECT_TRUE(Filtered(Inputs(s, 0), p, s.color.extent) == s.color);
  // ... nor do neighbouring floats.
  const quell::Rect e{ 0, 0, 3, 1 };
  Image close(e, 3, 1.f);
  close.fill(1, 0, std::nextafter(1.f, 2.f));
  quell::BilateralInputs in;
  in.radiance = close;
  p.range = quell::RangeSpace::Linear;
  EXPECT_TRUE(Filtered(in, p, e) == close);
}

TEST(Bilateral, ConstantsAreFixedPoints)
{
  for (const float v : { 0.f, 1e-42f, 0.1f, 7.3f, 1e30f, 3e38f })
    for (const int range : { 0, 1, 2 })
    {
      Scene s(20, 16);
      s.color = Image(s.color.extent, 3, v);
      quell::BilateralParameters p;
      p.radius = 3;
      p.range = quell::RangeSpace(range);
      EXPECT_TRUE(Filtered(Inputs(s, 31), p, s.color.extent) == s.color) << v << " " << range;
      p.sigmaRange = 0;
      EXPECT_TRUE(Filtered(Inputs(s, 0), p, s.color.extent) == s.color) << v << " " << range;
    }
}

TEST(Bilateral, ScalarAgreesWithEveryTarget)
{
  Scene s(53, 37);
  s.color.at(20, 10)[1] = NaN;
  s.normal.at(25, 11)[0] = NaN;
  s.albedo.at(10, 20)[2] = Inf;
  s.position.at(12, 12)[1] = NaN;
  for (int guides = 0; guides < 32; ++guides)
  {
    quell::BilateralParameters p;
    p.radius = 4;
    p.range = quell::RangeSpace(guides % 3);
    if (guides == 6)
      p.sigmaNormal = p.sigmaAlbedo = 1e30;
    if (guides == 7)
      p.sigmaDepth = 0;
    const auto in = Inputs(s, guides);
    Image scalar(s.color.extent, 3);
    quell::BilateralScalar(in, p, { scalar, {} }, s.color.extent);
    ForEachTarget(
      [&](const char* name)
      {
        const Difference d = Compare(Filtered(in, p, s.color.extent).data, scalar.data);
        EXPECT_LT(d.relative, 1e-5) << name << " " << guides;
        EXPECT_LT(d.smape, 1e-6) << name << " " << guides;
      });
  }
}

TEST(Bilateral, GuidesStop)
{
  const quell::Rect e{ 0, 0, 20, 10 };
  Scene s(20, 10);
  s.color = Image(e, 3, 0.f), s.depth = Image(e, 1, 2.f), s.albedo = Image(e, 3, 0.5f), s.id = Image(e, 1, 1.f);
  s.normal = Image(e, 3, 0.f), s.position = Image(e, 3, 0.f);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x)
    {
      const bool right = x >= 10;
      s.color.fill(x, y, right);
      *s.depth.at(x, y) = right ? 3.f : 2.f;
      s.normal.at(x, y)[right] = 1;
      s.albedo.fill(x, y, right ? 0.9f : 0.1f);
      *s.id.at(x, y) = right;
      s.position.at(x, y)[0] = right ? 1.f : 0.f; // off the left half's plane x = 0
    }
  quell::BilateralParameters p = Gaussian(2, 5);
  EXPECT_GT(Filtered(Inputs(s, 0), p, e).at(9, 5)[0], 0.1f);
  for (const int guide : { 1, 2, 4, 16 })
    EXPECT_LT(Filtered(Inputs(s, guide), p, e).at(9, 5)[0], 1e-3f) << guide;
  p.sigmaNormal = 1e30;
  EXPECT_LT(Filtered(Inputs(s, 1 + 2 + 8), p, e).at(9, 5)[0], 1e-6f);
  p.sigmaDepth = 1e30;
  EXPECT_GT(Filtered(Inputs(s, 1 + 2 + 8), p, e).at(9, 5)[0], 0.1f);
}

TEST(Bilateral, PlaneDistanceDoesNotFallOffAlongASlant)
{
  // A floor that recedes: depth changes by 10 % per pixel, all points lie in one plane.
  const quell::Rect e{ 0, 0, 9, 9 };
  Scene s(9, 9);
  s.color = Image(e, 3, 0.f), s.normal = Image(e, 3, 0.f), s.position = Image(e, 3, 0.f);
  s.color.fill(4, 6, 1.f);
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 9; ++x)
    {
      *s.depth.at(x, y) = 10.f + y;
      s.normal.at(x, y)[1] = 1;
      s.position.at(x, y)[0] = float(x), s.position.at(x, y)[2] = -(10.f + y);
    }
  quell::BilateralParameters p = Gaussian(2, 4);
  p.sigmaDepth = 0.02;
  const float depth = Filtered(Inputs(s, 1 + 2), p, e).at(4, 4)[0],
              plane = Filtered(Inputs(s, 1 + 2 + 8), p, e).at(4, 4)[0];
  const float free = Filtered(Inputs(s, 0), p, e).at(4, 4)[0];
  EXPECT_NEAR(plane, free, 1e-6);
  EXPECT_LT(depth, 0.1f * free);
}

TEST(Bilateral, NonFiniteAndBackground)
{
  for (const float poison : { NaN, Inf, -Inf })
  {
    Scene s(20, 20);
    s.depth = Image(s.color.extent, 1, 2.f);
    s.color = Image(s.color.extent, 3, 1.f);
    s.color.at(9, 9)[2] = poison;
    *s.depth.at(0, 0) = Inf;
    s.color.fill(0, 0, 500.f);
    *s.depth.at(19, 19) = Inf;
    s.color.fill(19, 19, poison);
    std::int64_t bad = 0;
    quell::BilateralParameters p;
    p.radius = 4;
    const Image out = Filtered(Inputs(s, 1), p, s.color.extent, &bad);
    EXPECT_EQ(bad, 2);
    for (int y = 0; y < 20; ++y)
      for (int x = 0; x < 20; ++x)
        ASSERT_EQ(out.at(x, y)[2], x + y ? 1.f : 500.f) << x << " " << y;
  }
  Scene s(5, 5);
  s.color = Image(s.color.extent, 3, NaN);
  std::int64_t bad = 0;
  for (float v : Filtered(Inputs(s, 31), {}, s.color.extent, &bad).data)
    EXPECT_EQ(v, 0.f);
  EXPECT_EQ(bad, 25);
}

TEST(Bilateral, BitsDoNotDependOnTheTile)
{
  Scene s(90, 50);
  s.color.at(33, 20)[0] = NaN; // some tiles take the path for gaps, others not
  s.normal.at(60, 20)[0] = NaN;
  for (const int guides : { 0, 31, 7 })
  {
    quell::BilateralParameters p;
    const Image full = Filtered(Inputs(s, guides), p, s.color.extent);
    for (const quell::Rect tile :
      { quell::Rect{ 0, 0, 16, 16 }, quell::Rect{ 31, 17, 50, 23 }, quell::Rect{ 73, 49, 90, 50 } })
    {
      const Image part = Filtered(Inputs(s, guides), p, tile);
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x)
          ASSERT_EQ(0, std::memcmp(part.at(x, y), full.at(x, y), 12)) << guides << " " << x << " " << y;
    }
  }
}

TEST(Bilateral, TinyAndThinImages)
{
  for (const quell::Rect e : { quell::Rect{ 0, 0, 1, 1 }, quell::Rect{ 0, 0, 1, 9 }, quell::Rect{ 0, 0, 40, 1 } })
  {
    Scene s(e.x1, e.y1);
    Image scalar(e, 3);
    quell::BilateralScalar(Inputs(s, 31), {}, { scalar, {} }, e);
    const Image out = Filtered(Inputs(s, 31), {}, e);
    EXPECT_LT(Compare(out.data, scalar.data).relative, 1e-5);
    if (e.area() == 1)
    {
      EXPECT_TRUE(out == s.color);
    }
  }
}

namespace
{
quell::BilateralGuide Guide(
  const Image& value, quell::GuideDistance distance, double sigma, const quell::ImageIn& variance = {})
{
  quell::BilateralGuide g;
  g.value = value, g.distance = distance, g.sigma = sigma, g.variance = variance;
  return g;
}
}

// A list of guides says the same as the named inputs, whatever their order.
TEST(Bilateral, GuideListEqualsNamedGuides)
{
  const Scene s(53, 37);
  quell::BilateralParameters p;
  p.radius = 5;
  p.sigmaRange = 1e30;
  quell::BilateralInputs named = Inputs(s, 2 + 4 + 16), listed = Inputs(s, 0);
  listed.guides[0] = Guide(s.id, quell::GuideDistance::Id, 0);
  listed.guides[1] = Guide(s.albedo, quell::GuideDistance::Euclidean, p.sigmaAlbedo);
  listed.guides[2] = Guide(s.normal, quell::GuideDistance::Normal, p.sigmaNormal);
  listed.guideCount = 3;
  EXPECT_LT(Compare(Filtered(named, p, s.color.extent).data, Filtered(listed, p, s.color.extent).data).relative, 1e-5);
  // A guide in place of the range term, and a plane in place of position, normal and depth.
  p.sigmaRange = 0.3;
  named = Inputs(s, 0), listed = Inputs(s, 0);
  const Image a = Filtered(named, p, s.color.extent);
  p.sigmaRange = 1e30;
  listed.guides[0] = Guide(s.color, quell::GuideDistance::Color, 0.3);
  listed.guideCount = 1;
  EXPECT_TRUE(Filtered(listed, p, s.color.extent) == a);
  named = Inputs(s, 1 + 2 + 8), listed = Inputs(s, 1 + 2);
  p.sigmaNormal = 1e30;
  const Image b = Filtered(named, p, s.color.extent);
  listed.guides[0] = Guide(s.position, quell::GuideDistance::Plane, p.sigmaDepth);
  listed.guideCount = 1;
  p.sigmaDepth = 1e30;
  EXPECT_TRUE(Filtered(listed, p, s.color.extent) == b);
}

TEST(Bilateral, ScalarAgreesWithEveryTargetForListsOfGuides)
{
  Scene s(53, 37);
  s.color.at(20, 10)[1] = NaN;
  s.color.at(52, 36)[0] = Inf;
  s.albedo.at(10, 20)[2] = NaN;
  *s.variance.at(11, 12) = NaN;
  *s.variance.at(12, 12) = -1;
  Image alpha(s.color.extent, 1), spread(s.color.extent, 3);
  Random u(8);
  for (float& v : alpha.data)
    v = u();
  for (float& v : spread.data)
    v = 0.02f * u();
  alpha.fill(30, 30, NaN);
  const auto E = quell::GuideDistance::Euclidean;
  const std::vector<std::vector<quell::BilateralGuide>> lists = { { Guide(alpha, E, 0.3) },
    { Guide(s.albedo, E, 0.1, s.variance), Guide(s.normal, quell::GuideDistance::Normal, 0.2, spread) },
    { Guide(s.color, quell::GuideDistance::Color, 0.2, spread), Guide(s.depth, quell::GuideDistance::LogDepth, 0.1) },
    { Guide(s.position, quell::GuideDistance::Plane, 0.3), Guide(s.moments, E, 0.5),
      Guide(s.id, quell::GuideDistance::Id, 1), Guide(s.albedo, E, 0.) },
    { Guide(s.albedo, E, 0., s.variance) } };
  for (const auto& list : lists)
    for (const int radius : { 1, 5, 10 }) // shared weights up to 8
      for (const int guides : { 0, 2, 3 })
      {
        quell::BilateralInputs in = Inputs(s, guides);
        if (!guides)
          in.normal = s.normal;
        for (const auto& g : list)
          in.guides[in.guideCount++] = g;
        in.carried[0] = alpha, in.carried[1] = s.albedo, in.carriedCount = 2;
        quell::BilateralParameters p;
        p.radius = radius;
        p.sigmaSpatial = 3;
        const quell::Rect e = s.color.extent;
        Image color(e, 3), a(e, 1), b(e, 3);
        quell::BilateralScalar(in, p, { color, { a, b } }, e);
        ForEachTarget(
          [&](const char* name)
          {
            Image c2(e, 3, NaN), a2(e, 1, NaN), b2(e, 3, NaN);
            std::vector<float> scratch(quell::BilateralScratch(in, p, e), NaN);
            quell::Bilateral(in, p, { c2, { a2, b2 } }, e, scratch.data());
            for (const Difference& d :
              { Compare(c2.data, color.data), Compare(a2.data, a.data), Compare(b2.data, b.data) })
            {
              EXPECT_LT(d.relative, 1e-5) << name << " " << &list - &lists[0] << " " << radius << " " << guides;
              EXPECT_LT(d.smape, 1e-6) << name << " " << &list - &lists[0] << " " << radius << " " << guides;
            }
          });
      }
}

// Noise in a guide costs nothing when its variance is told, and edges stay.
TEST(Bilateral, VarianceCorrectsTheDistanceOfANoisyGuide)
{
  const quell::Rect e{ 0, 0, 41, 41 };
  Image color(e, 3), guide(e, 1), variance(e, 1, 0.04f);
  Random u(11);
  for (int y = 0; y < 41; ++y)
    for (int x = 0; x < 41; ++x)
    {
      double noise = 0;
      for (int k = 0; k < 12; ++k)
        noise += u() - 0.5;
      *guide.at(x, y) = (x > 20 ? 3.f : 0.f) + 0.2f * float(noise); // standard deviation 0.2
      color.fill(x, y, x > 20 ? 1.f : 0.f);
      color.at(x, y)[0] = u();
    }
  quell::BilateralInputs in;
  in.radiance = color;
  quell::BilateralParameters p = Gaussian(3, 5);
  in.guides[0] = Guide(guide, quell::GuideDistance::Euclidean, 0.02);
  in.guideCount = 1;
  const auto leftover = [&](const Image& out)
  {
    double sum = 0;
    for (int y = 5; y < 36; ++y)
      for (int x = 5; x < 36; ++x)
        sum += (out.at(x, y)[0] - 0.5) * (out.at(x, y)[0] - 0.5);
    return sum / (31 * 31);
  };
  const double free = leftover(Filtered(
    [&]
    {
      auto i = in;
      i.guideCount = 0;
      return i;
    }(),
    p, e));
  const double plain = leftover(Filtered(in, p, e));
  in.guides[0].variance = variance;
  const Image corrected = Filtered(in, p, e);
  EXPECT_GT(plain, 10 * free) << "noise in the guide stops the filter";
  EXPECT_LT(leftover(corrected), 2.5 * free) << "not when its variance is known";
  for (int y = 0; y < 41; ++y)
    EXPECT_LT(corrected.at(20, y)[1], 0.01f) << "a step of fifteen deviations is an edge";
  // By hand: d = 0.5, V = 0.04 and 0.01: (0.25 - 0.05) / (2 max(0.01, 0.04)) = 2.5.
  Image two({ 0, 0, 2, 1 }, 3, 0.f), g({ 0, 0, 2, 1 }, 1), v({ 0, 0, 2, 1 }, 1);
  two.fill(1, 0, 1.f);
  g.data = { 0, 0.5f };
  v.data = { 0.04f, 0.01f };
  in.radiance = two;
  in.guides[0] = Guide(g, quell::GuideDistance::Euclidean, 0.1, v);
  const double w = std::exp(-2.5);
  EXPECT_NEAR(Filtered(in, Gaussian(1e30, 1), two.extent).at(0, 0)[0], w / (1 + w), 1e-6);
}

TEST(Bilateral, CarriesAlphaWithTheColoursWeights)
{
  Scene s(40, 30);
  Image alpha(s.color.extent, 1);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      *alpha.at(x, y) = s.color.at(x, y)[1];
  quell::BilateralInputs in = Inputs(s, 7);
  in.carried[0] = alpha, in.carriedCount = 1;
  for (const int radius : { 4, 9 })
  {
    quell::BilateralParameters p;
    p.radius = radius;
    Image color(s.color.extent, 3), out(s.color.extent, 1);
    std::vector<float> scratch(quell::BilateralScratch(in, p, s.color.extent), NaN);
    quell::Bilateral(in, p, { color, { out } }, s.color.extent, scratch.data());
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x)
        ASSERT_EQ(*out.at(x, y), color.at(x, y)[1]) << x << " " << y;
  }
}

// A frame k times as bright, with k times the white, is filtered alike: bit by bit for powers of two.
TEST(Bilateral, WhiteMakesItBlindToExposure)
{
  const Scene s(40, 30);
  Image bright = s.color;
  for (float& v : bright.data)
    v *= 8;
  for (const auto space : { quell::RangeSpace::Linear, quell::RangeSpace::ToneMapped, quell::RangeSpace::Log })
  {
    quell::BilateralParameters p = Gaussian(2, 4);
    p.sigmaRange = 0.3;
    p.range = space;
    quell::BilateralInputs in = Inputs(s, 3);
    const Image out = Filtered(in, p, s.color.extent);
    Image scalar(s.color.extent, 3);
    in.radiance = bright;
    EXPECT_FALSE(Filtered(in, p, s.color.extent) == out); // white 1 is something else
    p.white = 8;
    Image brighter = Filtered(in, p, s.color.extent);
    quell::BilateralScalar(in, p, { scalar, {} }, s.color.extent);
    for (size_t i = 0; i < out.data.size(); ++i)
    {
      ASSERT_NEAR(brighter.data[i], scalar.data[i], 1e-5 * std::fabs(scalar.data[i])) << int(space);
      brighter.data[i] /= 8;
    }
    EXPECT_TRUE(brighter == out) << int(space);
  }
}
