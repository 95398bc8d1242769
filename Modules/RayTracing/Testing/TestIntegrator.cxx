// SPDX-License-Identifier: BSD-3-Clause
// Scenes whose radiance is known in closed form.
#include "SceneBuilder.h"
#include "quellIntegrator.h"

#include <gtest/gtest.h>

#include <cmath>

using namespace quell;

namespace
{
struct Estimate
{
  double Mean = 0, Error = 0; ///< of one channel, and its standard error
  TraceCounters Counters;
};

/// The middle pixel of an image of one pixel.
Estimate Render(const SceneBuilder& b, int bounces, int samples,
  Integrator::Strategy strategy = Integrator::Strategy::Mis, int roulette = 1000, std::uint64_t seed = 0)
{
  EmbreeScene scene(b.Scene);
  scene.SetTime(0, 0);
  Integrator i;
  i.Scene = &scene;
  const CameraModel& c = b.Scene->Cameras.front();
  i.View = i.PreviousView = Camera(c, c.WorldFromCamera, scene.Origin(), 1, 1);
  i.Wants.Emission = i.Wants.Direct = i.Wants.Indirect = true;
  i.MaximumBounces = bounces;
  i.RouletteStart = roulette;
  i.Sampling = strategy;
  i.Seed = seed;
  i.SamplesPerPixel = samples;
  i.PixelJitter = Integrator::Jitter::None;
  PixelResult r;
  Estimate e;
  i.Pixel(0, 0, r, e.Counters);
  e.Mean = r.MeanLuminance;
  e.Error = std::sqrt(r.SquareLuminance / (samples - 1.) / samples);
  return e;
}

SceneBuilder Furnace(float albedo)
{
  SceneBuilder b;
  const int m = b.Add(SceneBuilder::Lambert(albedo, 1));
  b.Box(m, { -1, -1, -1 }, { 1, 1, 1 });
  b.Camera({ .2, .1, .3 }, .5);
  return b;
}

/// A Lambert floor of albedo .5 seen from above at an angle; the light is the caller's.
SceneBuilder Floor()
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Lambert(.5f)), { -20, 0, 20 }, { 40, 0, 0 }, { 0, 0, -40 });
  b.Camera({ 0, 2, 2 }, .01, std::atan(1.));
  return b;
}
}

TEST(Integrator, TruncatedFurnace)
{
  const int n[] = { 1, 2, 3, 5, 10 };
  const double gold[2][5] = { { 1.5, 1.75, 1.875, 1.96875, 1.999023 }, { 1.8, 2.44, 2.952, 3.68928, 4.570503 } };
  for (int a = 0; a < 2; ++a)
    for (int k = 0; k < 5; ++k)
    {
      const Estimate e = Render(Furnace(a ? .8f : .5f), n[k], 4096);
      EXPECT_NEAR(e.Mean, gold[a][k], 4 * e.Error + 1e-4) << "n " << n[k];
      EXPECT_LT(e.Error, .02);
    }
  EXPECT_NEAR(Render(Furnace(.8f), 0, 16).Mean, 1, 1e-6);
}

TEST(Integrator, RussianRouletteChangesNoMean)
{
  const Estimate off = Render(Furnace(.8f), 30, 8192);
  const Estimate on = Render(Furnace(.8f), 30, 8192, Integrator::Strategy::Mis, 1);
  EXPECT_NEAR(on.Mean, off.Mean, 4 * std::hypot(on.Error, off.Error));
  EXPECT_LT(on.Counters.Rays, off.Counters.Rays);
}

TEST(Integrator, SquareLightByAllStrategies)
{
  SceneBuilder b = Floor();
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -.5f, 1, -.5f }, { 1, 0, 0 }, { 0, 0, 1 });
  const Estimate mis = Render(b, 1, 16384), light = Render(b, 1, 16384, Integrator::Strategy::LightOnly),
                 bsdf = Render(b, 1, 16384, Integrator::Strategy::BsdfOnly);
  for (const Estimate& e : { mis, light, bsdf })
    EXPECT_NEAR(e.Mean, .119728235, 4 * e.Error + 1e-5);
  EXPECT_LT(mis.Error, bsdf.Error);
}

TEST(Integrator, BigSquareLight)
{
  SceneBuilder b = Floor();
  // the camera stands below it
  b.Scene->Cameras.clear();
  b.Camera({ 0, .5, .5 }, .01, std::atan(1.));
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -5, 1, -5 }, { 10, 0, 0 }, { 0, 0, 10 });
  for (auto s : { Integrator::Strategy::Mis, Integrator::Strategy::LightOnly, Integrator::Strategy::BsdfOnly })
  {
    const Estimate e = Render(b, 1, 8192, s);
    EXPECT_NEAR(e.Mean, .968339557 * .5, 4 * e.Error + 1e-5);
  }
}

TEST(Integrator, OneLightOrTenThousandTriangles)
{
  SceneBuilder b = Floor();
  std::vector<Vec3f> p;
  std::vector<std::uint32_t> t;
  const int n = 70;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j)
      p.push_back({ float(i) / n - .5f, 1, float(j) / n - .5f });
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
    {
      const std::uint32_t a = std::uint32_t(i * (n + 1) + j), c = a + std::uint32_t(n) + 1;
      t.insert(t.end(), { a, c, a + 1, a + 1, c, c + 1 });
    }
  b.AddMesh(b.Add(SceneBuilder::Lambert(0, 1)), p, t);
  const Estimate e = Render(b, 1, 16384);
  EXPECT_NEAR(e.Mean, .119728235, 4 * e.Error + 1e-5);
}

TEST(Integrator, PointSpotAndDirectionalLights)
{
  for (LightType type : { LightType::Point, LightType::Spot, LightType::Directional })
  {
    SceneBuilder b = Floor();
    Node node;
    node.Translation = { 1, 1, 0 };
    // -z turned to -y
    node.Rotation[0] = -std::sqrt(.5);
    node.Rotation[3] = std::sqrt(.5);
    b.Scene->Nodes.push_back(node);
    PunctualLight l;
    l.Type = type;
    l.Node = int(b.Scene->Nodes.size()) - 1;
    l.Intensity = Vec3f(3.f);
    l.InnerCone = .9f;
    l.OuterCone = 1.2f;
    b.Scene->Lights.push_back(l);
    // E = I cos / d^2 at 45 degrees and distance sqrt 2; directional: its own
    const double e = type == LightType::Directional ? 3 : 3 * std::sqrt(.5) / 2;
    EXPECT_NEAR(Render(b, 1, 16).Mean, .5 / 3.14159265 * e, 1e-5) << int(type);
    EXPECT_EQ(Render(b, 0, 16).Mean, 0.);
  }
}

TEST(Integrator, GlassSlab)
{
  // all inter-reflections of a slab, normal incidence: T = .923077 of the white behind it, R = .076923 of black
  SceneBuilder b;
  Material glass;
  glass.Metallic = 0;
  glass.Roughness = 0;
  glass.Transmission = 1;
  glass.Volume = true;
  b.Box(b.Add(glass), { -5, -5, -1 }, { 5, 5, -.9f });
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -9, -9, -3 }, { 18, 0, 0 }, { 0, 18, 0 });
  b.Camera({ 0, 0, 1 }, .001);
  const Estimate e = Render(b, 40, 16384);
  EXPECT_NEAR(e.Mean, .923076923, 4 * e.Error + 1e-4);
  EXPECT_GT(e.Error, 0);
  // index 1: as if it were not there
  b.Scene->Materials[0].Ior = 1;
  EXPECT_NEAR(Render(b, 4, 64).Mean, 1, 1e-5);
}

TEST(Integrator, MirrorCorridor)
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Metal(.5f, 0)), { -50, 0, 50 }, { 100, 0, 0 }, { 0, 0, -100 });
  b.Quad(0, { -50, 1, -50 }, { 100, 0, 0 }, { 0, 0, 100 });
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -50, -1, -4.25f }, { 100, 0, 0 }, { 0, 3, 0 });
  // 45 degrees down: meets the mirrors 4 times before the lamp
  b.Camera({ 0, .5, 0 }, .001, std::atan(1.));
  const double f = .5 + .5 * std::pow(1 - std::sqrt(.5), 5);
  EXPECT_NEAR(Render(b, 10, 16).Mean, std::pow(f, 4), 1e-5);
  EXPECT_EQ(Render(b, 3, 16).Mean, 0.);
}

TEST(Integrator, WhiteSphereUnderWhiteSky)
{
  // any size: no acne, no leaks
  for (float r : { 1e-3f, 1.f, 1e5f })
  {
    SceneBuilder b;
    b.Sphere(b.Add(SceneBuilder::Lambert(1)), {}, r);
    b.Scene->Meshes[0].Normals.clear();
    b.Sky(1);
    b.Camera({ .1 * r, .2 * r, 3. * r }, .01);
    const Estimate e = Render(b, 3, 1024);
    EXPECT_NEAR(e.Mean, 1, 4 * e.Error + 1e-4) << r;
    EXPECT_LT(e.Error, .03);
  }
}

TEST(Integrator, HotTexelInTheSky)
{
  // a uniform sky with one texel of 1e4 overhead: the floor's irradiance by quadrature over the same lookup
  SceneBuilder b = Floor();
  Texture t;
  t.Width = 64;
  t.Height = 32;
  t.Floats.assign(4 * 64 * 32, 1);
  for (int c = 0; c < 3; ++c)
    t.Floats[std::size_t(4 * (6 * 64 + 20) + c)] = 1e4f;
  b.Scene->Textures.push_back(t);
  b.Sky(1);
  b.Scene->Sky.Texture = 0;
  EmbreeScene scene(b.Scene);
  scene.SetTime(0, 0);
  double gold = 0;
  const int n = 1024;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < 2 * n; ++j)
    {
      const float y = (i + .5f) / n, r = std::sqrt(1 - y * y), p = Pi * (j + .5f) / n;
      gold += scene.Lights().Sky({ r * std::cos(p), y, r * std::sin(p) }).x * y * 2 * Pi / n / (2 * n);
    }
  const Estimate e = Render(b, 1, 8192);
  EXPECT_NEAR(e.Mean, gold * .5 / Pi, 4 * e.Error + .002 * gold);
  EXPECT_LT(e.Error, .03 * e.Mean);
}

TEST(Integrator, AlphaLetsLightThrough)
{
  // a half-transparent sheet before a lamp, and its shadow on the floor
  SceneBuilder b = Floor();
  Material sheet = SceneBuilder::Lambert(0);
  sheet.Mode = AlphaMode::Blend;
  sheet.Alpha = .25f;
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -.5f, 1, -.5f }, { 1, 0, 0 }, { 0, 0, 1 });
  b.Quad(b.Add(sheet), { -1.2f, .5f, -1.2f }, { 2.4f, 0, 0 }, { 0, 0, 2.4f });
  b.Scene->Cameras.clear();
  b.Camera({ 0, .4, .4 }, .01, std::atan(1.));
  for (auto s : { Integrator::Strategy::Mis, Integrator::Strategy::LightOnly, Integrator::Strategy::BsdfOnly })
  {
    const Estimate e = Render(b, 1, 16384, s);
    EXPECT_NEAR(e.Mean, .75 * .119728235, 4 * e.Error + 1e-5);
  }
}
