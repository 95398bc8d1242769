// SPDX-License-Identifier: BSD-3-Clause
// glTF's parameters become the lobes that its specification says.
#include "BsdfTesting.h"

#include <gtest/gtest.h>

using namespace quell;
using namespace bsdf;

TEST(BsdfMaterials, MetallicRoughness)
{
  Material m = Plastic(.5f);
  m.BaseColor = Vec3f(.8f, .4f, .2f);
  m.Metallic = .25f;
  const Surface s = Make(m);
  EXPECT_NEAR(s.Alpha, .25, 1e-6);
  EXPECT_NEAR(s.Diffuse.y, .4 * .75, 1e-6);
  EXPECT_NEAR(s.F0.x, .04 * .75 + .8 * .25, 1e-6);
  EXPECT_NEAR(s.F0.z, .04 * .75 + .2 * .25, 1e-6);
  EXPECT_NEAR(s.F90.x, 1, 1e-6);
  EXPECT_EQ(s.Glass, 0.f);
}

TEST(BsdfMaterials, SpecularFactorAndColour)
{
  Material m = Plastic(.5f);
  m.Specular = .5f;
  m.SpecularColor = Vec3f(2, .5f, 100);
  Surface s = Make(m);
  // specular min(F0 colour, 1)
  EXPECT_NEAR(s.F0.x, .04, 1e-6);
  EXPECT_NEAR(s.F0.y, .01, 1e-6);
  EXPECT_NEAR(s.F0.z, .5, 1e-6);
  EXPECT_NEAR(s.F90.x, .5, 1e-6);
  EXPECT_NEAR(s.DiffuseF0, .5, 1e-6);
  // metals know neither
  m.Metallic = 1;
  s = Make(m);
  EXPECT_EQ(s.F0, Vec3f(1.f));
  EXPECT_EQ(s.F90, Vec3f(1.f));
  m.Metallic = 0;
  m.Specular = 0;
  s = Make(m);
  EXPECT_FALSE(s.HasSpecular);
  Vec3f d, f;
  float pdf;
  s.Prepare(.3f);
  s.Evaluate(Upright(), Direction(.3f), Direction(.5f), d, f, pdf);
  EXPECT_NEAR(d.x, .5 / 3.14159265, 1e-6);
  EXPECT_EQ(f, Vec3f());
}

TEST(BsdfMaterials, Index)
{
  Material m = Plastic(.5f);
  m.Ior = 2;
  EXPECT_NEAR(Make(m).F0.x, 1 / 9., 1e-6);
  EXPECT_EQ(Make(m).F90.x, 1.f);
  m.Ior = 1;
  EXPECT_FALSE(Make(m).HasSpecular);
  m.Ior = 0; // reflects everything, as KHR_materials_ior says
  EXPECT_EQ(Make(m).F0.x, 1.f);
  // Schlick's curve returns as much of uniform light as the exact equations
  for (float ior : { 1.01f, 1.05f, 1.1f, 1.2f, 1.33f })
  {
    m.Ior = ior;
    double exact = 0;
    for (int i = 0; i < 1000; ++i)
    {
      float t;
      const float mu = (float(i) + .5f) / 1000;
      exact += 2 * mu * FresnelDielectric(mu, ior, t) / 1000;
    }
    const Surface s = Make(m);
    EXPECT_NEAR((s.F0.x + (s.F90.x - s.F0.x) / 21) / exact, 1, .03) << "index " << ior;
  }
}

TEST(BsdfMaterials, TransmissionTimesMetallic)
{
  Material m = ThickGlass(.3f);
  m.BaseColor = Vec3f(.5f, 1, 1);
  m.Transmission = .75f;
  m.Metallic = .4f;
  const Surface s = Make(m);
  EXPECT_NEAR(s.Glass, .6 * .75, 1e-6);
  EXPECT_NEAR(s.Diffuse.x, .5 * .6 * .25, 1e-6);
  EXPECT_NEAR(s.F0.x, .04 * .6 * .25 + .5 * .4, 1e-6);
  EXPECT_EQ(s.GlassTint, m.BaseColor);
  EXPECT_FALSE(s.Thin);
  EXPECT_TRUE(s.ScattersBelow());
  m.Roughness = 0;
  EXPECT_FALSE(Make(m).ScattersBelow());
  // a texture may make the volume thin
  MaterialValues v(m);
  v.Thickness = 0;
  EXPECT_TRUE(MakeSurface(m, v).Thin);
  m.Metallic = 1;
  EXPECT_EQ(Make(m).Glass, 0.f);
}

TEST(BsdfMaterials, GlassTakesSpecularColourAndFactor)
{
  Material m = ThickGlass(0);
  m.SpecularColor = Vec3f(4, 1, 0);
  m.Specular = .5f;
  Surface s = Make(m);
  s.Prepare(1);
  // at normal incidence .5 min(.04 colour, 1) of each colour; a chance of the largest, and the rest goes through
  const auto up = s.Sample(Upright(), Up, .5f, .5f, .5f, .0799f);
  ASSERT_FALSE(up.Transmitted);
  EXPECT_NEAR(up.Specular.x, 1, 1e-5);
  EXPECT_NEAR(up.Specular.y, .25, 1e-5);
  EXPECT_NEAR(up.Specular.z, 0, 1e-5);
  const auto down = s.Sample(Upright(), Up, .5f, .5f, .5f, .0801f);
  EXPECT_TRUE(down.Transmitted);
  // total reflection knows no factor
  s.Prepare(.5f);
  const auto total = s.Sample(Upright(false), Direction(.5f), .5f, .5f, .5f, .9999f);
  EXPECT_FALSE(total.Transmitted);
  EXPECT_EQ(total.Specular, Vec3f(1.f));
}

TEST(BsdfMaterials, Clearcoat)
{
  // glTF: f_coat = clearcoat Fresnel(1.5), and black below a black base
  Material m = Coated(Plastic(1), 0, .5f);
  m.BaseColor = Vec3f();
  m.Specular = 0;
  Surface s = Make(m);
  for (float mu : { .1f, .5f, 1.f })
    EXPECT_NEAR(Returned(s, mu, 1 << 10), .5 * (.04 + .96 * std::pow(1 - mu, 5)), 1e-3);
  EXPECT_TRUE(s.IsPureDelta());
  EXPECT_NEAR(Make(Coated(m, .5f)).CoatAlpha, .25, 1e-6);
  // the values of textures
  MaterialValues v(m);
  EXPECT_EQ(v.Clearcoat, .5f);
  v.Clearcoat = 0;
  EXPECT_EQ(MakeSurface(m, v).Coat, 0.f);
  EXPECT_FALSE(MakeSurface(m, v).Layered());
}

TEST(BsdfMaterials, UnlitScattersNothing)
{
  Material m = Coated(ThickGlass(.3f), .2f);
  m.Unlit = true;
  const Surface s = Make(m);
  EXPECT_FALSE(s.HasSmooth());
  EXPECT_FALSE(s.HasDelta());
  EXPECT_EQ(Returned(s, .5f, 64), 0);
}

// What passes a pane straight is the mean of what Sample sends there, with a coat, a tint or diffuse colour beside it.
TEST(BsdfMaterials, PanesPassWhatTheSamplesPass)
{
  for (int kind = 0; kind < 4; ++kind)
  {
    Material m = Plastic(0);
    m.BaseColor = Vec3f(.9f, .6f, .3f);
    m.Transmission = kind == 0 ? 1.f : .6f;
    m.Clearcoat = kind == 2 ? .7f : 0.f;
    if (kind == 3)
      m.SpecularColor = Vec3f(3, 1, .2f);
    Surface s = Make(m);
    ASSERT_TRUE(s.IsPane());
    for (float mu : { .05f, .3f, .9f })
    {
      s.Prepare(mu);
      Vec3d sum;
      const int n = 256;
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
        {
          const Surface::Sampled out =
            s.Sample(Upright(), Direction(mu), .3f, .7f, (float(i) + .5f) / n, (float(j) + .5f) / n);
          if (out.Straight)
          {
            EXPECT_TRUE(out.Delta && out.Transmitted);
            sum += Vec3d(out.Specular) * (1. / (n * n));
          }
        }
      const Vec3f passed = s.StraightThrough(Upright(), Direction(mu));
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(passed[c], sum[c], 8e-3) << kind << ' ' << mu;
    }
  }
  Material m = Plastic(.5f);
  m.Transmission = 1;
  EXPECT_EQ(Make(m).StraightThrough(Upright(), Direction(.5f)), Vec3f()) << "rough";
  m.Roughness = 0;
  m.Volume = true;
  EXPECT_EQ(Make(m).StraightThrough(Upright(), Direction(.5f)), Vec3f()) << "refracts";
}
