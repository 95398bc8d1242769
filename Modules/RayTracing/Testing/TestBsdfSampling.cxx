// SPDX-License-Identifier: BSD-3-Clause
// What Sample makes is what Evaluate says: chi-squared tests of directions against the integral of the pdf, weights
// against values, and numbers that stay finite.
#include "BsdfTesting.h"
#include "Statistics.h"

#include <gtest/gtest.h>

#include <random>

using namespace quell;
using namespace bsdf;

namespace
{
constexpr int Rings = 20, Sectors = 24; ///< cells of equal solid angle over the sphere

/// Integrals of the pdf over the cells, by Gauss-Legendre points in cells that are halved until nothing changes.
struct Integral
{
  const Surface& S;
  ShadingNormals Normals;
  Vec3f Wo;
  double Tolerance;
  int Least; ///< halvings before the first comparison: a narrow lobe must not fall between points

  double Pdf(double z, double phi) const
  {
    const double r = std::sqrt(std::max(0., 1 - z * z));
    Vec3f d, f;
    float pdf;
    S.Evaluate(Normals, Wo, Vec3f(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)), d, f, pdf);
    return pdf;
  }
  double Points(double z0, double z1, double p0, double p1) const
  {
    static const double x[] = { .1127016653792583, .5, .8872983346207417 }, w[] = { 5 / 18., 8 / 18., 5 / 18. };
    double sum = 0;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        sum += w[i] * w[j] * this->Pdf(z0 + (z1 - z0) * x[i], p0 + (p1 - p0) * x[j]);
    return sum * (z1 - z0) * (p1 - p0);
  }
  double Over(double z0, double z1, double p0, double p1, double coarse, int depth) const
  {
    const double z = (z0 + z1) / 2, p = (p0 + p1) / 2;
    const double a = this->Points(z0, z, p0, p), b = this->Points(z, z1, p0, p);
    const double c = this->Points(z0, z, p, p1), d = this->Points(z, z1, p, p1);
    if (depth >= 12 || (depth >= Least && std::fabs(a + b + c + d - coarse) < Tolerance))
      return a + b + c + d;
    return this->Over(z0, z, p0, p, a, depth + 1) + this->Over(z, z1, p0, p, b, depth + 1) +
           this->Over(z0, z, p, p1, c, depth + 1) + this->Over(z, z1, p, p1, d, depth + 1);
  }
  double Cell(int ring, int sector) const
  {
    const double z0 = -1 + 2. * ring / Rings, p0 = 2 * 3.141592653589793 * (double(sector) / Sectors - .5);
    const double z1 = z0 + 2. / Rings, p1 = p0 + 2 * 3.141592653589793 / Sectors;
    return this->Over(z0, z1, p0, p1, this->Points(z0, z1, p0, p1), 0);
  }
};

/// p-value of the samples' directions; those that Sample drops and perfect reflections share one more cell, of what the
/// pdf leaves. Fails where weight times pdf is not the value.
double TestOfDirections(const Surface& prepared, bool front, const Vec3f& wo, int draws, int least, unsigned seed)
{
  const ShadingNormals normals = Upright(front);
  std::vector<double> expected(Rings * Sectors + 1), counted(expected.size());
  const Integral integral{ prepared, normals, wo, 1e-5, least };
  double rest = 1;
  for (int r = 0; r < Rings; ++r)
    for (int s = 0; s < Sectors; ++s)
    {
      const double p = integral.Cell(r, s);
      expected[std::size_t(r * Sectors + s)] = p * draws;
      rest -= p;
    }
  EXPECT_GT(rest, -2e-3);
  expected.back() = std::max(0., rest) * draws;
  std::mt19937 twister(seed);
  const auto uniform = [&]() { return float(twister() >> 8) * 0x1p-24f; };
  double wrong = 0;
  for (int i = 0; i < draws; ++i)
  {
    const float u = uniform(), v = uniform(), a = uniform(), b = uniform();
    const auto r = prepared.Sample(normals, wo, u, v, a, b);
    if (!(r.Pdf > 0) || r.Delta)
    {
      ++counted.back();
      continue;
    }
    Vec3f d, f;
    float pdf;
    prepared.Evaluate(normals, wo, r.Wi, d, f, pdf);
    wrong = std::max({ wrong, std::fabs(double(r.Pdf) / pdf - 1),
      std::fabs(double(Luminance(r.Diffuse)) * r.Pdf - Luminance(d)) / (1e-6 + Luminance(d)),
      std::fabs(double(Luminance(r.Specular)) * r.Pdf - Luminance(f)) / (1e-6 + Luminance(f)) });
    const int ring = std::min(Rings - 1, int((r.Wi.z + 1) / 2 * Rings));
    const double turn = std::atan2(r.Wi.y, r.Wi.x) / (2 * 3.141592653589793) + .5;
    ++counted[std::size_t(ring * Sectors + std::min(Sectors - 1, int(turn * Sectors)))];
  }
  EXPECT_LT(wrong, 5e-3);
  return statistics::ChiSquaredTest(counted, expected);
}

struct Sidak
{
  std::vector<std::pair<double, std::string>> Tests;
  void Add(double p, const std::string& name) { this->Tests.emplace_back(p, name); }
  void Check() const
  {
    const double level = statistics::SidakLevel(.01, double(this->Tests.size()));
    for (const auto& [p, name] : this->Tests)
      EXPECT_GT(p, level) << name << " (one of " << this->Tests.size() << ')';
  }
};
}

TEST(BsdfSampling, DirectionsOfEveryKindFollowTheirPdf)
{
  Sidak tests;
  unsigned seed = 1;
  for (float roughness : { .2f, .45f, 1.f })
    for (const Case& c : Kinds(roughness))
      for (float mu : { .08f, .7f })
      {
        Surface s = Make(c.Is);
        s.Prepare(mu);
        const Vec3f wo = Direction(mu, .3f);
        tests.Add(TestOfDirections(s, c.Front, wo, 20000, roughness < .25f ? 2 : 0, seed++),
          c.Name + ", roughness " + std::to_string(roughness) + ", cosine " + std::to_string(mu));
      }
  tests.Check();
}

TEST(BsdfSampling, DirectionsOfGlassFollowTheirPdfAtEveryIndex)
{
  Sidak tests;
  unsigned seed = 1000;
  for (float ior : { .8f, 1.05f, 1.33f, 2.5f, 0.f })
    for (float roughness : { .2f, .6f })
      for (bool front : { true, false })
        for (float mu : { .1f, .75f })
        {
          Surface s = Make(ThickGlass(roughness, ior));
          s.Prepare(mu);
          tests.Add(
            TestOfDirections(s, front, Direction(mu, -2), 20000, roughness < .3f || ior == 1.05f ? 3 : 0, seed++),
            "index " + std::to_string(ior) + ", roughness " + std::to_string(roughness) + ", cosine " +
              std::to_string(mu) + (front ? "" : ", from inside"));
        }
  tests.Check();
}

// A tilted coat and a shading normal that leans away from the geometry: the cells' borders are none of the pdf's then,
// so compare its integral and first moments.
TEST(BsdfSampling, DirectionsFollowTheirPdfWhereNormalsDiffer)
{
  unsigned seed = 2000;
  for (float roughness : { .5f, 1.f })
    for (const Case& c : Kinds(roughness))
    {
      Surface s = Make(c.Is);
      ShadingNormals normals;
      normals.Geometric = Up;
      normals.Shading = Normalized(Vec3f(.4f, .1f, 1));
      normals.Coat = Normalized(Vec3f(-.2f, .3f, 1));
      normals.Front = c.Front;
      const Vec3f wo = Direction(.6f, 2.5f);
      s.Prepare(Dot(wo, normals.Shading));
      std::mt19937 twister(seed++);
      const auto uniform = [&]() { return float(twister() >> 8) * 0x1p-24f; };
      double sampled[4] = {}, direct[4] = {};
      const int n = 20000, grid = 256;
      for (int i = 0; i < n; ++i)
      {
        const float u = uniform(), v = uniform(), a = uniform(), b = uniform();
        const auto r = s.Sample(normals, wo, u, v, a, b);
        if (!(r.Pdf > 0) || r.Delta)
          continue;
        ASSERT_EQ(Dot(r.Wi, normals.Geometric) > 0, Dot(r.Wi, normals.Shading) > 0);
        const double moments[] = { 1, r.Wi.x, r.Wi.y, r.Wi.z };
        for (int k = 0; k < 4; ++k)
          sampled[k] += moments[k] / n;
      }
      for (int i = 0; i < grid; ++i)
        for (int j = 0; j < grid; ++j)
        {
          const float z = 2 * (float(i) + .5f) / grid - 1;
          const Vec3f wi = Direction(z, 6.2831853f * (float(j) + .5f) / grid);
          Vec3f d, f;
          float pdf;
          s.Evaluate(normals, wo, wi, d, f, pdf);
          const double moments[] = { 1, wi.x, wi.y, wi.z };
          for (int k = 0; k < 4; ++k)
            direct[k] += moments[k] * pdf * 4 * 3.141592653589793 / (grid * grid);
        }
      // no moment has a standard deviation above 1
      for (int k = 0; k < 4; ++k)
        EXPECT_NEAR(direct[k], sampled[k], 4 / std::sqrt(double(n)) + .003)
          << c.Name << " roughness " << roughness << " moment " << k;
    }
}

TEST(BsdfSampling, PerfectLobesHaveTheChanceThatTheirWeightAssumes)
{
  for (const Case& c : Kinds(0))
  {
    Surface s = Make(c.Is);
    s.Prepare(.6f);
    double sum[2] = {}, lobes[2] = {};
    const int n = 1 << 12;
    for (int i = 0; i < n; ++i)
    {
      const PixelSampler random(3, 0, 0, std::uint32_t(i));
      const Vec2f u = random.Pair(0), l = random.Pair(1);
      const auto r = s.Sample(Upright(c.Front), Direction(.6f), u.x, u.y, l.x, l.y);
      if (!(r.Pdf > 0))
        continue; // a rough coat sent it below
      sum[r.Delta] += double(r.Diffuse.x + r.Specular.x) * r.Eta2 / n;
      lobes[r.Delta] += 1. / n;
    }
    EXPECT_EQ(lobes[1] > 0, s.HasDelta()) << c.Name;
    EXPECT_EQ(lobes[0] > 0, s.HasSmooth() && c.Name != "coated glass from inside") << c.Name; // the coat is outside
    if (c.Name == "plastic")
    {
      EXPECT_NEAR(sum[1], s.Fresnel(.6f).x, .003);
    }
    if (c.Name == "glass" || c.Name == "thin glass")
    {
      EXPECT_NEAR(sum[1], 1, 1e-4);
    }
  }
}

TEST(BsdfSampling, NothingBreaksAtTheExtremes)
{
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  const float u[] = { 0, .37f, .99999994f };
  double heaviest[2] = {};
  std::int64_t samples = 0;
  const auto check = [&](const Material& m)
  {
    Surface s = Make(m);
    for (bool front : { true, false })
      for (float mu : { 1e-20f, 1e-6f, 1e-3f, .5f, 1.f })
      {
        s.Prepare(mu);
        const Vec3f wo = Direction(mu);
        const float p = s.PCosine + s.PSpecular + s.PGlass + s.PCoat;
        ASSERT_TRUE(p == 0 || std::fabs(p - 1) < 1e-5f) << p;
        ASSERT_TRUE(IsFinite(s.Albedo(mu)));
        for (float a : u)
          for (float b : u)
            for (float lobe : u)
              for (float side : u)
              {
                const auto r = s.Sample(Upright(front), wo, a, b, lobe, side);
                ++samples;
                ASSERT_TRUE(
                  std::isfinite(r.Pdf) && r.Pdf >= 0 && IsFinite(r.Diffuse) && IsFinite(r.Specular) && IsFinite(r.Wi));
                ASSERT_TRUE(std::isfinite(r.Eta2) && r.Eta2 > 0);
                if (r.Pdf > 0)
                {
                  ASSERT_NEAR(Length(r.Wi), 1, 1e-5);
                  // how much radiance grows when it enters a dense medium is no fault of the sampler
                  heaviest[m.Roughness < .4f] =
                    std::max(heaviest[m.Roughness < .4f], double(MaxComponent(r.Diffuse + r.Specular)) * r.Eta2);
                }
              }
        for (float z : { -1.f, -.5f, -1e-6f, 0.f, 1e-20f, 1e-6f, .5f, 1.f })
        {
          Vec3f d, f;
          float pdf;
          for (const Vec3f& wi : { Direction(z, 3.14159265f), Direction(z, 1), -wo, wo })
          {
            s.Evaluate(Upright(front), wo, wi, d, f, pdf);
            ASSERT_TRUE(IsFinite(d) && IsFinite(f) && std::isfinite(pdf) && pdf >= 0);
            ASSERT_TRUE(std::min({ d.x, d.y, d.z, f.x, f.y, f.z }) >= 0);
          }
        }
      }
  };
  for (float roughness : { 0.f, .0317f, .5f, 1.f })
    for (float ior : { 0.f, .5f, 1.f, 1.0005f, 1.002f, 1.5f, 1e30f })
      for (float transmission : { 0.f, .5f, 1.f })
        for (float metallic : { 0.f, .5f, 1.f })
          for (float coat : { 0.f, 1.f })
          {
            Material m = Metal(roughness);
            m.Ior = ior;
            m.Transmission = transmission;
            m.Metallic = metallic;
            m.Volume = roughness != .5f;
            m.Clearcoat = coat;
            m.ClearcoatRoughness = 1 - roughness;
            check(m);
          }
  for (float bad : { nan, inf, -inf, -1.f, 1e30f, 1e-30f })
    for (int field = 0; field < 9; ++field)
    {
      Material m = ThickGlass(.4f);
      m.Clearcoat = .5f;
      m.Metallic = .2f;
      float* fields[] = { &m.BaseColor.y, &m.Metallic, &m.Roughness, &m.Specular, &m.SpecularColor.x, &m.Ior,
        &m.Transmission, &m.Clearcoat, &m.ClearcoatRoughness };
      *fields[field] = bad;
      check(m);
    }
  EXPECT_GT(samples, 100000);
  EXPECT_LT(heaviest[0], 200);
  // what a nearly smooth surface scatters several times goes to grazing angles alone
  EXPECT_LT(heaviest[1], 1000);
}
