// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellVarianceSteered.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
struct Result
{
  Image radiance, variance, sigma;
  std::int64_t bad = 0;
};
Result Apply(const quell::VarianceSteeredInputs& in, const quell::VarianceSteeredParameters& p)
{
  const quell::Rect e = in.radiance.extent;
  Result r{ Image(e, 3), Image(e, 1), Image(e, 1), 0 };
  std::vector<float> scratch(quell::VarianceSteeredScratch(in, p, e), NaN);
  r.bad = quell::VarianceSteered(in, p, { r.radiance, r.variance, r.sigma }, e, scratch.data());
  return r;
}
quell::VarianceSteeredInputs Inputs(const Scene& s)
{
  quell::VarianceSteeredInputs in;
  in.radiance = s.color, in.variance = s.variance, in.depth = s.depth, in.normal = s.normal, in.albedo = s.albedo,
  in.id = s.id;
  return in;
}
/// Standard normal, by Box and Muller.
double Normal(Random& u)
{
  const double r = std::sqrt(-2 * std::log(1 - double(u())));
  return r * std::cos(6.283185307179586 * u());
}
}

TEST(VarianceSteered, ScalesAgreeWithTheFormula)
{
  Scene scene(45, 41, 2);
  scene.color.fill(7, 9, NaN);
  scene.normal.at(20, 20)[1] = NaN;
  *scene.variance.at(11, 12) = NaN;
  *scene.albedo.at(30, 8) = Inf;
  quell::VarianceSteeredParameters p;
  p.scales = 5;
  const auto in = Inputs(scene);
  std::vector<float> scratch(quell::VarianceSteeredScratch(in, p, scene.color.extent));
  ForEachTarget(
    [&](const char* target)
    {
      Random u(4);
      for (int i = 0; i < 12; ++i)
      {
        const int x = i ? int(u() * 45) : 7, y = i ? int(u() * 41) : 9;
        if (!std::isfinite(*scene.depth.at(x, y)))
          continue;
        for (int s = 1; s <= 5; ++s)
        {
          const auto a = quell::VarianceSteeredVector(in, p, s, x, y, scratch.data());
          const auto b = quell::VarianceSteeredScalar(in, p, s, x, y);
          for (int k = 0; k < 3; ++k)
            ASSERT_NEAR(a.Color[k], b.Color[k], 1e-5 * std::fabs(b.Color[k])) << target << s << " " << x << " " << y;
          ASSERT_NEAR(a.Variance, b.Variance, 1e-5 * b.Variance) << target;
          ASSERT_NEAR(a.Centre, b.Centre, 1e-5 * b.Centre) << target;
        }
      }
    });
}

// Without guides and noise gain by hand: sigma 1, radius 3 has Sum w^2 = .079680140 (ALGORITHMS 3.2).
TEST(VarianceSteered, GaussianGolden)
{
  Image color({ 0, 0, 15, 15 }, 3), variance({ 0, 0, 15, 15 }, 1, 2.f);
  color.fill(7, 7, 6.279784796f);
  quell::VarianceSteeredInputs in;
  in.radiance = color, in.variance = variance;
  const auto one = quell::VarianceSteeredScalar(in, {}, 2, 7, 7);
  EXPECT_NEAR(one.Color[0], 1, 1e-7);
  EXPECT_NEAR(one.Variance, 2 * .079680140, 1e-8);
  EXPECT_NEAR(one.Centre, 1 / 6.279784796, 1e-9);
}

TEST(VarianceSteered, NoVarianceIsTheIdentityBitByBit)
{
  Scene scene(40, 36, 3);
  Image zero(scene.color.extent, 1);
  auto in = Inputs(scene);
  in.variance = zero;
  for (int scales = 0; scales <= 5; ++scales)
  {
    quell::VarianceSteeredParameters p;
    p.scales = scales;
    const Result r = Apply(in, p);
    EXPECT_TRUE(r.radiance == scene.color) << scales;
    EXPECT_TRUE(r.variance == zero);
    EXPECT_TRUE(r.sigma == zero);
  }
  in.variance = scene.variance;
  quell::VarianceSteeredParameters none;
  none.scales = 0;
  EXPECT_TRUE(Apply(in, none).radiance == scene.color);
  EXPECT_FALSE(Apply(in, {}).radiance == scene.color);
}

TEST(VarianceSteered, ConstantsStayAndGetTheWidestKernel)
{
  for (const float v : { 0.f, 1e-42f, .3f, 1e30f, FLT_MAX })
  {
    Image color({ 0, 0, 30, 26 }, 3, v), variance({ 0, 0, 30, 26 }, 1, 1.f);
    quell::VarianceSteeredInputs in;
    in.radiance = color, in.variance = variance;
    const Result r = Apply(in, {});
    EXPECT_TRUE(r.radiance == color) << v;
    for (float s : r.sigma.data)
      EXPECT_EQ(s, 4) << v;
    for (float w : r.variance.data)
      EXPECT_LT(w, .05f) << v;
    EXPECT_NEAR(*r.variance.at(15, 13), 1 / (4 * 3.14159265 * 16), 3e-4);
  }
}

// The estimate against the truth: a wave in noise of known variance. Summed over the image, Stein's error of every
// scale is the true one within its scatter; what is chosen is near the best fixed scale or better.
TEST(VarianceSteered, ChoosesTheBestScale)
{
  const quell::Rect e{ 0, 0, 96, 96 };
  for (const double length : { 6., 14., 40., 1e9 })
  {
    Image truth(e, 3), color(e, 3), variance(e, 1);
    Random u(99);
    const double noise = .3;
    for (int y = 0; y < e.y1; ++y)
      for (int x = 0; x < e.x1; ++x)
      {
        const double t = 2 + std::sin(6.283185307179586 * (x + .3 * y) / length);
        truth.fill(x, y, float(t));
        color.fill(x, y, float(t + noise * Normal(u)));
        *variance.at(x, y) = float(noise * noise * (.2 + 1.6 * u())); // right on average only
      }
    quell::VarianceSteeredInputs in;
    in.radiance = color, in.variance = variance;
    const quell::VarianceSteeredParameters p;
    double best = 1e300;
    for (int s = 1; s <= 4; ++s)
    {
      double estimated = 0, real = 0;
      int n = 0;
      for (int y = 0; y < e.y1; y += 3)
        for (int x = 0; x < e.x1; x += 3, ++n)
        {
          const auto f = quell::VarianceSteeredScalar(in, p, s, x, y);
          const double c = color.at(x, y)[0];
          estimated += (f.Color[0] - c) * (f.Color[0] - c) + *variance.at(x, y) * (2 * f.Centre - 1);
          real += (f.Color[0] - truth.at(x, y)[0]) * (f.Color[0] - truth.at(x, y)[0]);
        }
      EXPECT_NEAR(estimated / n, real / n, 4 * noise * noise * std::sqrt(2. / n) + .1 * real / n) << length << " " << s;
      best = std::min(best, real / n);
    }
    const Result r = Apply(in, p);
    double chosen = 0, sigma = 0;
    for (size_t i = 0; i < color.data.size(); i += 3)
      chosen += std::pow(double(r.radiance.data[i]) - truth.data[i], 2) / double(e.area());
    for (float s : r.sigma.data)
      sigma += s / double(e.area());
    EXPECT_LT(chosen, 1.35 * best + .015 * noise * noise) << length;
    EXPECT_LT(chosen, .6 * noise * noise) << length;
    if (length < 10)
    {
      EXPECT_LT(sigma, 1.5);
    }
    if (length > 1e6)
    {
      EXPECT_GT(sigma, 3.2);
    }
  }
}

// More noise, wider kernels; and edges that no guide shows stay.
TEST(VarianceSteered, WidthFollowsTheVariance)
{
  const quell::Rect e{ 0, 0, 80, 40 };
  double before = -1;
  for (const double noise : { .02, .1, .5 })
  {
    Image color(e, 3), variance(e, 1, float(noise * noise));
    Random u(7);
    for (int y = 0; y < e.y1; ++y)
      for (int x = 0; x < e.x1; ++x)
        color.fill(x, y, float((x < 40 ? 1 : 3) + .15 * std::sin(x * .6) + noise * Normal(u)));
    quell::VarianceSteeredInputs in;
    in.radiance = color, in.variance = variance;
    const Result r = Apply(in, {});
    double sigma = 0;
    for (int y = 0; y < e.y1; ++y)
      for (int x = 8; x < 30; ++x)
        sigma += *r.sigma.at(x, y) / (22. * e.y1);
    EXPECT_GT(sigma, before * 1.3);
    before = sigma;
    double left = 0, right = 0;
    for (int y = 4; y < 36; ++y)
    {
      left += r.radiance.at(38, y)[1] / 32;
      right += r.radiance.at(41, y)[1] / 32;
    }
    EXPECT_GT(right - left, 1.5) << noise;
  }
}

TEST(VarianceSteered, NonFiniteIsContained)
{
  Scene scene(40, 36, 6);
  const auto clean = Apply(Inputs(scene), {});
  scene.color.fill(10, 10, NaN);
  scene.color.at(25, 20)[2] = Inf;
  *scene.variance.at(12, 30) = NaN;
  *scene.variance.at(5, 30) = Inf;
  const Result r = Apply(Inputs(scene), {});
  EXPECT_EQ(r.bad, 2);
  for (const Image* image : { &r.radiance, &r.variance, &r.sigma })
    for (float v : image->data)
      ASSERT_TRUE(std::isfinite(v) && v >= 0);
  EXPECT_GT(r.radiance.at(10, 10)[0], .05);
  EXPECT_EQ(r.radiance.at(30, 5)[1], clean.radiance.at(30, 5)[1]); // farther than every reach
}

TEST(VarianceSteered, TilesMakeNoDifference)
{
  Scene scene(70, 60, 12);
  const auto in = Inputs(scene);
  quell::VarianceSteeredParameters p;
  p.scales = 3;
  const Result whole = Apply(in, p);
  Image radiance(scene.color.extent, 3), variance(scene.color.extent, 1), sigma(scene.color.extent, 1);
  for (int y = 0; y < 60; y += 17)
    for (int x = 0; x < 70; x += 23)
    {
      const quell::Rect tile{ x, y, std::min(70, x + 23), std::min(60, y + 17) };
      std::vector<float> scratch(quell::VarianceSteeredScratch(in, p, tile), NaN);
      quell::VarianceSteered(in, p, { radiance, variance, sigma }, tile, scratch.data());
    }
  EXPECT_TRUE(radiance == whole.radiance);
  EXPECT_TRUE(variance == whole.variance);
  EXPECT_TRUE(sigma == whole.sigma);
}
