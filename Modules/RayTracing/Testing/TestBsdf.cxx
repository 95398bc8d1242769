// SPDX-License-Identifier: BSD-3-Clause
#include "quellBsdf.h"
#include "quellLightSampler.h"
#include "quellSampler.h"

#include <gtest/gtest.h>

#include <random>

using namespace quell;

TEST(Bsdf, ConcentricAndFrameGolden)
{
  const Vec2f d = ConcentricDisc(.25f, .75f);
  EXPECT_NEAR(d.x, -.353553391, 1e-6);
  EXPECT_NEAR(d.y, .353553391, 1e-6);
  const Frame f(Vec3f(0, 0, -1));
  EXPECT_EQ(f.t, Vec3f(1, 0, 0));
  EXPECT_EQ(f.b, Vec3f(0, -1, 0));
  EXPECT_EQ(ConcentricDisc(.5f, .5f).x, 0.f);
}

TEST(Bsdf, HeuristicGolden)
{
  EXPECT_NEAR(PowerHeuristic(.3f, .1f), .9, 1e-6);
  EXPECT_NEAR(BalanceHeuristic(.3f, .1f), .75, 1e-6);
  EXPECT_NEAR(PowerHeuristic(1e30f, 1e30f), .5, 1e-6);
  const float inf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(PowerHeuristic(inf, 1), 1.f);
  EXPECT_EQ(PowerHeuristic(1, inf), 0.f);
  EXPECT_EQ(PowerHeuristic(0, 0), 0.f);
}

TEST(Bsdf, GgxGolden)
{
  EXPECT_NEAR(ggx::D(0, 1, .5f), 1.273239545, 1e-5);
  EXPECT_NEAR(ggx::D(1 - .81f, .9f, .5f), .516548154, 1e-5);
  EXPECT_NEAR(ggx::Lambda(.7f, .5f), .061294059, 1e-6);
  EXPECT_NEAR(ggx::D(0, 1, 1e-4f) / 3.18e7, 1, 2e-3);
  const Vec3f m = ggx::SampleVisibleNormal(Vec3f(.6f, 0, .8f), .5f, .25f, .75f);
  EXPECT_NEAR(m.x, .478262990, 1e-5);
  EXPECT_NEAR(m.y, 0, 1e-6);
  EXPECT_NEAR(m.z, .878216666, 1e-5);
}

TEST(Bsdf, FresnelTable)
{
  const double c[] = { 1, .8, .6, .4, .2, .1, .01 };
  const double outside[] = { .04, .043895, .064525, .132509, .338894, .571593, .943753 };
  const double inside[] = { .04, .114141, 1, 1, 1, 1, 1 };
  for (int i = 0; i < 7; ++i)
  {
    float t;
    EXPECT_NEAR(FresnelDielectric(float(c[i]), 1.5f, t), outside[i], 2e-6);
    EXPECT_NEAR(FresnelDielectric(float(c[i]), 1 / 1.5f, t), inside[i], 2e-6);
  }
  float t;
  FresnelDielectric(std::sqrt(.5f), 1.5f, t);
  EXPECT_NEAR(t, .881917104, 1e-6);
  EXPECT_NEAR(FresnelDielectric(.3f, 1, t), 0, 1e-12);
}

namespace
{
Surface White(float roughness, float f0, float diffuse)
{
  Surface s;
  s.Diffuse = Vec3f(diffuse);
  s.F0 = Vec3f(f0);
  s.F90 = Vec3f(f0 > 0 ? 1.f : 0.f);
  s.DiffuseF0 = f0;
  s.DiffuseF90 = s.F90.x;
  s.Alpha = roughness * roughness;
  s.Finish();
  return s;
}

/// Hemispherical reflectance for a direction by sampling.
double Reflectance(Surface s, float mu, int n)
{
  const Vec3f normal(0, 0, 1), wo(std::sqrt(1 - mu * mu), 0, mu);
  s.Prepare(mu);
  double sum = 0;
  for (int i = 0; i < n; ++i)
  {
    const PixelSampler random(3, 0, 0, std::uint32_t(i));
    const Vec2f u = random.Pair(0), l = random.Pair(1);
    const Surface::Sampled r = s.Sample(normal, normal, wo, true, u.x, u.y, l.x, l.y);
    if (r.Pdf > 0)
      sum += r.Weight.x;
  }
  return sum / n;
}
}

TEST(Bsdf, GgxDirectionalAlbedoTable)
{
  const float alpha[] = { .1f, .25f, .5f, .75f, 1 };
  const float mu[] = { .05f, .1f, .2f, .4f, .6f, .8f, 1 };
  const double e[5][7] = { { .91176, .88346, .90456, .95690, .97668, .98457, .98832 },
    { .93313, .89162, .84816, .84427, .87172, .89727, .91581 },
    { .91255, .86011, .78993, .71636, .68784, .68205, .68785 },
    { .88061, .81071, .71553, .60192, .53515, .49232, .46392 },
    { .84777, .76021, .64165, .49890, .41150, .35126, .30685 } };
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 7; ++j)
      EXPECT_NEAR(Reflectance(White(std::sqrt(alpha[i]), 1, 0), mu[j], 1 << 14), e[i][j], 1e-3)
        << "alpha " << alpha[i] << " mu " << mu[j];
}

TEST(Bsdf, NoSurfaceCreatesEnergy)
{
  for (float roughness : { 0.f, .02f, .1f, .3f, .5f, .7f, .85f, 1.f })
    for (float f0 : { 0.f, .02f, .04f, .2f, .5f, .9f, 1.f })
      for (float mu : { .01f, .05f, .2f, .5f, .8f, 1.f })
        EXPECT_LE(Reflectance(White(roughness, f0, 1), mu, 4096), 1.004)
          << "roughness " << roughness << " f0 " << f0 << " mu " << mu;
  // smooth: exactly 1
  EXPECT_NEAR(Reflectance(White(0, .04f, 1), .05f, 1 << 15), 1, 4e-3);
}

TEST(Bsdf, BrightnessIsContinuousAtTheMirrorThreshold)
{
  for (float mu : { .1f, .5f, 1.f })
  {
    const double rough = Reflectance(White(std::sqrt(1.01e-3f), 1, 0), mu, 4096);
    const double mirror = Reflectance(White(std::sqrt(0.99e-3f), 1, 0), mu, 4096);
    EXPECT_NEAR(rough, mirror, .02 * mirror);
  }
}

TEST(Bsdf, EvaluateIsReciprocalAndMatchesTheSampler)
{
  std::mt19937 twister(1);
  std::uniform_real_distribution<float> uniform(0, 1);
  const Vec3f normal(0, 0, 1);
  for (float roughness : { .3f, .8f })
  {
    Surface s = White(roughness, .04f, .7f);
    const Vec3f wo = Normalized(Vec3f(.6f, .2f, .5f));
    s.Prepare(wo.z);
    // 12 x 12 cells of equal solid angle: counts against the integral of the pdf, chi-squared
    const int n = 12, draws = 60000, sub = 24;
    std::vector<double> expected(n * n), counted(n * n);
    for (int a = 0; a < n * sub; ++a)
      for (int b = 0; b < n * sub; ++b)
      {
        const float z = (a + .5f) / (n * sub), r = std::sqrt(1 - z * z), p = 2 * Pi * (b + .5f) / (n * sub);
        Vec3f d, f;
        float pdf;
        s.Evaluate(normal, wo, Vec3f(r * std::cos(p), r * std::sin(p), z), d, f, pdf);
        expected[a / sub * n + b / sub] += pdf * 2 * Pi / (n * sub * n * sub) * draws;
      }
    double below = draws;
    for (double e : expected)
      below -= e;
    EXPECT_GT(below, -.01 * draws);
    for (int i = 0; i < draws; ++i)
    {
      const auto r = s.Sample(normal, normal, wo, true, uniform(twister), uniform(twister), uniform(twister), 0);
      if (!(r.Pdf > 0))
        continue;
      Vec3f d, f, d2, f2;
      float pdf, pdf2;
      s.Evaluate(normal, wo, r.Wi, d, f, pdf);
      ASSERT_NEAR(r.Pdf, pdf, 1e-5 * pdf);
      s.Evaluate(normal, r.Wi, wo, d2, f2, pdf2);
      ASSERT_NEAR((d + f).x, (d2 + f2).x, 1e-4 * (d + f).x);
      const int a = std::min(n - 1, int(r.Wi.z * n));
      const float phi = std::atan2(r.Wi.y, r.Wi.x) / (2 * Pi);
      ++counted[a * n + std::min(n - 1, int((phi < 0 ? phi + 1 : phi) * n))];
    }
    double chi2 = 0;
    int cells = 0;
    for (int i = 0; i < n * n; ++i)
      if (expected[i] > 8)
      {
        chi2 += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
        ++cells;
      }
    EXPECT_GT(cells, 60);
    EXPECT_LT(chi2, cells + 5 * std::sqrt(2. * cells)) << "roughness " << roughness;
  }
}

TEST(LightSampler, PdfMatchesTheSampler)
{
  // a sky of 8 x 4 texels, one of them hot, and two triangles: every direction's density against counts
  Scene scene;
  Texture t;
  t.Width = 8;
  t.Height = 4;
  t.Floats.assign(4 * 32, 1);
  t.Floats[4 * 11] = t.Floats[4 * 11 + 1] = t.Floats[4 * 11 + 2] = 50;
  t.Floats[4 * 20] = std::numeric_limits<float>::quiet_NaN();
  scene.Textures.push_back(t);
  scene.Sky.Present = true;
  scene.Sky.Color = Vec3f(1.f);
  scene.Sky.Texture = 0;
  LightSampler lights;
  lights.Build({}, {}, {}, scene, 1);
  const int nz = 16, np = 32, draws = 60000, sub = 16;
  std::vector<double> expected(nz * np), counted(nz * np);
  double total = 0;
  for (int a = 0; a < nz * sub; ++a)
    for (int b = 0; b < np * sub; ++b)
    {
      const float z = 2 * (a + .5f) / (nz * sub) - 1, r = std::sqrt(1 - z * z), p = 2 * Pi * (b + .5f) / (np * sub);
      const double q =
        lights.SkyPdf(Vec3f(r * std::cos(p), z, r * std::sin(p))) * 4 * Pi / (double(nz * sub) * np * sub);
      expected[a / sub * np + b / sub] += q * draws;
      total += q;
    }
  EXPECT_NEAR(total, 1, 5e-3);
  std::mt19937 twister(2);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample s;
    if (!lights.Draw(Vec3f(), std::min(uniform(twister), .9999999f), std::min(uniform(twister), .9999999f),
          std::min(uniform(twister), .9999999f), s))
      continue;
    const float phi = std::atan2(s.Wi.z, s.Wi.x) / (2 * Pi);
    ++counted[std::min(nz - 1, int((s.Wi.y + 1) / 2 * nz)) * np +
              std::min(np - 1, int((phi < 0 ? phi + 1 : phi) * np))];
  }
  double chi2 = 0;
  int cells = 0;
  for (std::size_t i = 0; i < expected.size(); ++i)
    if (expected[i] > 8)
    {
      chi2 += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
      ++cells;
    }
  // texel borders cross cells: the quadrature of the expectation allows a little more than pure chance
  EXPECT_LT(chi2, 1.3 * cells + 5 * std::sqrt(2. * cells));
  EXPECT_GT(cells, 100);
}
