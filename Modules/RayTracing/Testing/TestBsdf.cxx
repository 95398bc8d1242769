// SPDX-License-Identifier: BSD-3-Clause
// Single formulas of the scattering functions, their energy and their symmetry.
#include "BsdfTesting.h"

#include <gtest/gtest.h>

#include <random>
#include <thread>

using namespace quell;
using namespace bsdf;

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

TEST(Bsdf, FormsWithoutDivisionAgreeWithTheTextbook)
{
  for (float alpha : { .01f, .3f, 1.f })
    for (float co : { .02f, .5f, 1.f })
      for (float ci : { .01f, .3f, .9f })
      {
        const float so = ggx::Smith(co, alpha * alpha), si = ggx::Smith(ci, alpha * alpha);
        const double g1 = ggx::G1(co, alpha), g2 = ggx::G2(co, ci, alpha);
        EXPECT_NEAR(ggx::Reflection(2, co, ci, so, si) / (2 * g2 / (4 * co)), 1, 1e-5);
        EXPECT_NEAR(ggx::ReflectionPdf(2, co, so) / (2 * g1 / (4 * co)), 1, 1e-5);
        EXPECT_NEAR(ggx::MaskingRatio(co, ci, so, si) / (g2 / g1), 1, 1e-5);
      }
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
  for (float cosine : { 0.f, 1e-6f, .3f, 1.f })
    EXPECT_EQ(FresnelDielectric(cosine, 1, t), 0.f);
}

namespace
{
// alpha x mu, single scattering with F = 1
const float Alphas[] = { .1f, .25f, .5f, .75f, 1 };
const float Cosines[] = { .05f, .1f, .2f, .4f, .6f, .8f, 1 };
const double Single[5][7] = { { .91176, .88346, .90456, .95690, .97668, .98457, .98832 },
  { .93313, .89162, .84816, .84427, .87172, .89727, .91581 },
  { .91255, .86011, .78993, .71636, .68784, .68205, .68785 },
  { .88061, .81071, .71553, .60192, .53515, .49232, .46392 },
  { .84777, .76021, .64165, .49890, .41150, .35126, .30685 } };
const double SingleAverage[] = { .97221, .88233, .70025, .53632, .40915 };
}

TEST(Bsdf, GgxDirectionalAlbedoTable)
{
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 7; ++j)
    {
      const float alpha = Alphas[i], mu = Cosines[j], so = ggx::Smith(mu, alpha * alpha);
      const Vec3f wo = Direction(mu);
      double sum = 0;
      const int n = 1 << 14;
      for (int k = 0; k < n; ++k)
      {
        const Vec2f u = PixelSampler(3, 0, 0, std::uint32_t(k)).Pair(0);
        const Vec3f m = ggx::SampleVisibleNormal(wo, alpha, u.x, u.y);
        const float ci = 2 * Dot(wo, m) * m.z - mu;
        sum += ggx::MaskingRatio(mu, ci, so, ggx::Smith(ci, alpha * alpha));
      }
      EXPECT_NEAR(sum / n, Single[i][j], 1e-3) << "alpha " << alpha << " mu " << mu;
    }
}

TEST(EnergyTables, AgreeWithTheReferenceTable)
{
  const EnergyTables& tables = EnergyTables::Get();
  for (int i = 0; i < 5; ++i)
  {
    EXPECT_NEAR(tables.Average(Alphas[i]).E, SingleAverage[i], 2.5e-3);
    for (int j = 0; j < 7; ++j)
      EXPECT_NEAR(Surface::Energy(tables.At(Alphas[i]), Cosines[j]).E, Single[i][j], 2.5e-3)
        << "alpha " << Alphas[i] << " mu " << Cosines[j];
  }
}

TEST(EnergyTables, SchlickPartAndGlassAgreeWithSampling)
{
  const EnergyTables& tables = EnergyTables::Get();
  for (float roughness : { .1f, .33f, .62f, 1.f })
    for (float mu : { .03f, .17f, .5f, .93f })
    {
      const float alpha = roughness * roughness, so = ggx::Smith(mu, alpha * alpha);
      const Vec3f wo = Direction(mu);
      double schlick = 0, lost[2][2] = {};
      const int n = 1 << 14;
      for (int k = 0; k < n; ++k)
      {
        const Vec2f u = PixelSampler(3, 0, 0, std::uint32_t(k)).Pair(0);
        const Vec3f m = ggx::SampleVisibleNormal(wo, alpha, u.x, u.y);
        const float oh = Dot(wo, m), up = 2 * oh * m.z - mu;
        const double reflected = ggx::MaskingRatio(mu, up, so, ggx::Smith(up, alpha * alpha));
        schlick += reflected * SchlickWeight(oh);
        for (int inside = 0; inside < 2; ++inside)
        {
          const float eta = inside ? 1 / 1.5f : 1.5f;
          float ct;
          const double f = FresnelDielectric(oh, eta, ct);
          const float down = -(m.z * (oh / eta - ct) - mu / eta);
          const double transmitted = f < 1 ? ggx::MaskingRatio(mu, down, so, ggx::Smith(down, alpha * alpha)) : 0;
          lost[inside][1] += 1 - f * reflected - (1 - f) * transmitted;
          lost[inside][0] += 1 - (f < 1 ? transmitted : reflected);
        }
      }
      EXPECT_NEAR(Surface::Energy(tables.At(alpha), mu).B, schlick / n, 4e-3) << roughness << " " << mu;
      for (int inside = 0; inside < 2; ++inside)
        for (int w = 0; w < 2; ++w)
          EXPECT_NEAR(
            EnergyTables::GetGlass(inside ? 1 / 1.5f : 1.5f).At(mu, alpha, float(w)), lost[inside][w] / n, 1.5e-2)
            << "inside " << inside << " factor " << w << " roughness " << roughness << " mu " << mu;
    }
}

TEST(EnergyTables, AreTheSameForThreadsThatMeetOnFirstUse)
{
  const EnergyTables::Glass* seen[4] = {};
  std::vector<std::thread> threads;
  for (auto& s : seen)
    threads.emplace_back([&s]() { s = &EnergyTables::GetGlass(1.27f); });
  for (std::thread& t : threads)
    t.join();
  for (const auto* s : seen)
  {
    EXPECT_EQ(s, seen[0]);
    EXPECT_GT(s->AverageAt(1, 1), .05f);
  }
}

// Light that meets a white surface comes back, whatever its roughness.
TEST(Bsdf, WhiteFurnace)
{
  for (int step = 0; step <= 20; ++step)
  {
    const float r = float(step) / 20;
    Material half = Metal(r);
    half.Metallic = .5f;
    for (float mu : { .05f, .1f, .2f, .4f, .6f, .8f, 1.f })
    {
      const auto check = [&](const char* what, const Material& m)
      { EXPECT_NEAR(Returned(Make(m), mu, 1 << 13), 1, .01) << what << ", roughness " << r << ", cosine " << mu; };
      check("metal", Metal(r));
      check("plastic", Plastic(r));
      check("half metal", half);
      check("thin glass", ThinGlass(r));
      check("glass", ThickGlass(r));
    }
  }
}

// Total reflection makes weights vary: more samples, fewer of the rest.
TEST(Bsdf, WhiteFurnaceOfGlass)
{
  for (float ior : { 1.1f, 1.5f, 2.4f, .8f })
    for (float r : { .05f, .1f, .25f, .5f, .75f, 1.f })
      for (float mu : { .05f, .2f, .6f, 1.f })
        for (bool front : { true, false })
        {
          EXPECT_NEAR(Returned(Make(ThickGlass(r, ior)), mu, 1 << 15, front), 1, .015)
            << "index " << ior << ", roughness " << r << ", cosine " << mu << ", front " << front;
        }
  // a weaker reflection lets more through
  Material weak = ThickGlass(.6f);
  weak.Specular = .3f;
  for (float mu : { .05f, .2f, .6f, 1.f })
    EXPECT_NEAR(Returned(Make(weak), mu, 1 << 14), 1, .01);
}

// The attenuation below a coat is a fit: white stays white within its error.
TEST(Bsdf, WhiteFurnaceUnderACoat)
{
  for (float coat : { 0.f, .25f, .5f, 1.f })
    for (float r : { 0.f, .1f, .2f, .35f, .5f, .75f, 1.f })
      for (float mu : { .05f, .1f, .2f, .5f, 1.f })
        for (float weight : { .5f, 1.f })
        {
          const auto check = [&](const char* what, const Material& m, double error, bool front = true)
          {
            EXPECT_NEAR(Returned(Make(Coated(m, coat, weight)), mu, 1 << 12, front), 1, error)
              << what << ", roughness " << r << " below " << coat << " of weight " << weight << ", cosine " << mu;
          };
          check("plastic", Plastic(r), .025);
          check("metal", Metal(r), .05);
          check("glass", ThickGlass(r), .025);
          check("glass from inside", ThickGlass(r), .05, false);
        }
}

TEST(Bsdf, NoSurfaceCreatesEnergy)
{
  for (float r : { 0.f, .02f, .04f, .1f, .3f, .5f, .7f, .85f, 1.f })
    for (float mu : { .02f, .05f, .2f, .5f, .8f, 1.f })
      for (float specular : { 0.f, .5f, 1.f })
        for (float ior : { 1.f, 1.1f, 1.5f, 3.f, 0.f })
        {
          Material m = Plastic(r);
          m.Specular = specular;
          m.Ior = ior;
          m.SpecularColor = Vec3f(ior == 3 ? 8.f : 1.f);
          EXPECT_LE(Returned(Make(m), mu, 2048), 1.01) << "roughness " << r << " cosine " << mu << " index " << ior;
        }
}

TEST(Bsdf, SeveralScatteringsCanBeLeftOut)
{
  for (int i = 1; i < 5; ++i)
    for (int j = 0; j < 7; ++j)
    {
      Material m = Metal(std::sqrt(Alphas[i]));
      m.MultipleScattering = false;
      EXPECT_NEAR(Returned(Make(m), Cosines[j], 1 << 12), Single[i][j], 3e-3);
      // what the reflection loses reaches the diffuse lobe
      m.Metallic = 0;
      EXPECT_NEAR(Returned(Make(m), Cosines[j], 1 << 12), 1, .01);
      m.Transmission = 1;
      EXPECT_NEAR(Returned(Make(m), Cosines[j], 1 << 12), Single[i][j], 3e-3);
      m.Volume = true;
      EXPECT_LT(Returned(Make(m), Cosines[j], 1 << 12), 1);
    }
}

// Several scatterings colour the light: less of a dark metal's returns than in proportion.
TEST(Bsdf, SeveralScatteringsSaturateTheColour)
{
  Material m = Metal(1);
  m.BaseColor = Vec3f(.5f);
  const double dark = Returned(Make(m), .8f, 1 << 13), white = Returned(Make(Metal(1)), .8f, 1 << 13);
  EXPECT_LT(dark, .47 * white);
  // F^2 E_avg / (1 - F (1 - E_avg)) of the loss, and F of the first reflection (Schlick's average above F0)
  const double e = .35126, average = .40915, f = .5 + .5 / 21, several = f * f * average / (1 - f * (1 - average));
  EXPECT_NEAR(dark, .5 * e + several * (1 - e), .01);
}

TEST(Bsdf, BrightnessIsContinuousAtTheMirrorThreshold)
{
  for (float mu : { .1f, .5f, 1.f })
    for (const Material& kind : { Metal(0), Plastic(0), ThinGlass(0), ThickGlass(0), Coated(Plastic(.5f), 0) })
      for (bool front : { true, false })
      {
        Material rough = kind, mirror = kind;
        (kind.Clearcoat > 0 ? rough.ClearcoatRoughness : rough.Roughness) = std::sqrt(1.01e-3f);
        (kind.Clearcoat > 0 ? mirror.ClearcoatRoughness : mirror.Roughness) = std::sqrt(0.99e-3f);
        ASSERT_NE(Make(rough).HasDelta(), Make(mirror).HasDelta());
        EXPECT_NEAR(Returned(Make(rough), mu, 4096, front), Returned(Make(mirror), mu, 4096, front), .01);
      }
}

// Not only the sum: each direction's share of a nearly smooth interface is that of a smooth one.
TEST(Bsdf, NearlySmoothGlassSplitsLightLikeSmoothGlass)
{
  for (const Material& kind : { ThinGlass(0), ThickGlass(0) })
    for (bool front : { true, false })
      for (float mu : { .2f, .7f, .9f })
      {
        Material rough = kind;
        rough.Roughness = .05f;
        Surface s = Make(rough);
        s.Prepare(mu);
        const Vec3f wo = Direction(mu);
        const float eta = kind.Volume && !front ? 1 / 1.5f : 1.5f;
        float ct;
        const double f = FresnelDielectric(mu, eta, ct);
        double reflected = 0, transmitted = 0;
        Vec3d mean;
        const int n = 1 << 13;
        for (int i = 0; i < n; ++i)
        {
          const PixelSampler random(3, 0, 0, std::uint32_t(i));
          const Vec2f u = random.Pair(0), l = random.Pair(1);
          const Surface::Sampled r = s.Sample(Upright(front), wo, u.x, u.y, l.x, l.y);
          if (!(r.Pdf > 0))
            continue;
          ASSERT_EQ(r.Transmitted, r.Wi.z < 0);
          ASSERT_EQ(r.Eta2, r.Transmitted && kind.Volume ? eta * eta : 1.f);
          const double w = double(r.Specular.x) * r.Eta2 / n;
          (r.Transmitted ? transmitted : reflected) += w;
          if (r.Transmitted)
            mean += Vec3d(r.Wi) * w;
        }
        EXPECT_NEAR(reflected, f, .015) << "cosine " << mu << " front " << front;
        EXPECT_NEAR(transmitted, 1 - f, .015) << "cosine " << mu << " front " << front;
        if (f < 1)
        {
          const Vec3d straight = kind.Volume ? Vec3d(-wo.x / eta, 0, -ct) : Vec3d(-wo);
          mean = Normalized(mean);
          EXPECT_NEAR(mean.x, straight.x, .01);
          EXPECT_NEAR(mean.y, 0, .002);
          EXPECT_NEAR(mean.z, straight.z, .01);
        }
      }
}

TEST(Bsdf, IsReciprocal)
{
  std::mt19937 twister(1);
  std::uniform_real_distribution<float> uniform(0, 1);
  int compared[2] = {};
  for (float roughness : { .15f, .4f, .8f, 1.f })
    for (const Case& c : Kinds(roughness))
      for (int i = 0; i < 200; ++i)
      {
        const Vec3f wo = Direction(.02f + .98f * uniform(twister), 6.2831853f * uniform(twister));
        const float mu = 2 * uniform(twister) - 1;
        if (std::fabs(mu) < .02f)
          continue;
        const Vec3f wi = Direction(mu, 6.2831853f * uniform(twister));
        Surface s = Make(c.Is);
        Vec3f d1, s1, d2, s2;
        float pdf;
        s.Prepare(wo.z);
        s.Evaluate(Upright(c.Front), wo, wi, d1, s1, pdf);
        s.Prepare(std::fabs(wi.z));
        s.Evaluate(wi.z > 0 ? Upright(c.Front) : Upended(c.Front), wi, wo, d2, s2, pdf);
        // f / n_o^2 one way is f / n_i^2 the other
        const float eta = !c.Is.Volume || wi.z > 0 ? 1 : c.Front ? c.Is.Ior : 1 / c.Is.Ior;
        for (int k = 0; k < 3; ++k)
        {
          const double a = double((d1 + s1)[k]) / std::fabs(wi.z) * eta * eta, b = double((d2 + s2)[k]) / wo.z;
          ASSERT_NEAR(a, b, 3e-4 * (a + b) + 1e-7) << c.Name << " roughness " << roughness << " " << wo.z << " " << mu;
          compared[wi.z > 0] += a > 0;
        }
      }
  EXPECT_GT(compared[0], 1000);
  EXPECT_GT(compared[1], 1000);
}

TEST(Bsdf, AlbedosAreWhatComesBack)
{
  for (float roughness : { 0.f, .3f, .7f, 1.f })
    for (Case& c : Kinds(roughness))
      for (float mu : { .2f, .6f, 1.f })
      {
        if (!c.Front)
          continue;
        c.Is.BaseColor = Vec3f(.6f);
        const Surface s = Make(c.Is);
        const double total = Returned(s, mu, 1 << 12);
        const Vec3f all = s.Albedo(mu), diffuse = s.AlbedoDiffuse(mu), rest = s.AlbedoSpecular(mu);
        // rough glass bends differently at every microfacet; a coat's attenuation is that of its normal direction
        EXPECT_NEAR(all.x, total, c.Is.Transmission > 0 || c.Is.Clearcoat > 0 ? .07 : .012)
          << c.Name << " roughness " << roughness << " cosine " << mu;
        EXPECT_NEAR(diffuse.x + rest.x, all.x, 1e-6);
        for (const Vec3f& a : { all, diffuse, rest })
          for (int k = 0; k < 3; ++k)
            EXPECT_TRUE(a[k] >= 0 && a[k] <= 1);
      }
}

TEST(Bsdf, GlassWithoutAnInterfaceIsNotThere)
{
  for (float roughness : { 0.f, .3f, 1.f })
    for (bool volume : { true, false })
      for (bool front : { true, false })
        for (float mu : { 1e-6f, .3f, 1.f })
          for (float u : { 0.f, .5f, .9999999f })
          {
            Material m = ThinGlass(roughness, 1);
            m.Volume = volume;
            Surface s = Make(m);
            const Vec3f wo = Direction(mu);
            s.Prepare(mu);
            const Surface::Sampled r = s.Sample(Upright(front), wo, u, u, u, u);
            EXPECT_TRUE(r.Pdf > 0 && r.Delta && r.Transmitted);
            EXPECT_LT(Length(r.Wi + wo), 1e-6f);
            EXPECT_NEAR(r.Specular.x, 1, 1e-6);
            EXPECT_TRUE(s.IsPureDelta());
          }
}

TEST(Bsdf, RefractionGolden)
{
  Surface s = Make(ThickGlass(0));
  const float c45 = std::sqrt(.5f);
  s.Prepare(c45);
  Surface::Sampled r = s.Sample(Upright(), Direction(c45), .5f, .5f, .5f, .9999f);
  EXPECT_TRUE(r.Transmitted);
  EXPECT_NEAR(r.Wi.z, -.881917104, 1e-6);
  EXPECT_NEAR(r.Wi.x, -c45 / 1.5, 1e-6);
  EXPECT_NEAR(r.Eta2, 2.25, 1e-6);
  EXPECT_NEAR(r.Specular.x, 1 / 2.25, 1e-6);
  // beyond the critical cosine .745355992 everything stays inside
  s.Prepare(.7f);
  r = s.Sample(Upright(false), Direction(.7f), .5f, .5f, .5f, .9999f);
  EXPECT_FALSE(r.Transmitted);
  EXPECT_EQ(r.Specular.x, 1.f);
  s.Prepare(.76f);
  r = s.Sample(Upright(false), Direction(.76f), .5f, .5f, .5f, .9999f);
  EXPECT_TRUE(r.Transmitted);
  EXPECT_NEAR(r.Specular.x, 2.25, 1e-5);
}

TEST(Bsdf, TheCoatHasItsOwnNormal)
{
  Surface s = Make(Coated(Plastic(1), 0));
  ShadingNormals normals = Upright();
  normals.Coat = Normalized(Vec3f(.3f, 0, 1));
  const Vec3f wo = Direction(.9f);
  s.Prepare(.9f);
  const float last = s.PCosine + s.PSpecular + s.PCoat / 2;
  const Surface::Sampled r = s.Sample(normals, wo, .5f, .5f, last, .5f);
  EXPECT_TRUE(r.Delta && r.Pdf > 0);
  EXPECT_NEAR(Length(Normalized(r.Wi + wo) - normals.Coat), 0, 1e-6);
  // the base below it keeps the shading normal: brightest where that mirrors
  Surface rough = Make(Coated(Metal(.2f), 1));
  rough.Prepare(.9f);
  Vec3f d, mirror, aside;
  float pdf;
  rough.Evaluate(normals, wo, Vec3f(-wo.x, 0, wo.z), d, mirror, pdf);
  rough.Evaluate(normals, wo, Normalized(normals.Coat * (2 * Dot(normals.Coat, wo)) - wo), d, aside, pdf);
  EXPECT_GT(mirror.x, 5 * aside.x);
}
