// SPDX-License-Identifier: BSD-3-Clause
// Light transport: strategies against each other, closed forms, energy and reciprocity.
#include "RenderScene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>

using namespace quell;
using statistics::BlockTest;
using trust::Centre;
using trust::Estimate;
using trust::Settings;
using trust::Shoot;
using trust::Shot;
using Strategy = Integrator::Strategy;

namespace
{
Material Dielectric(float albedo, float roughness)
{
  Material m;
  m.BaseColor = Vec3f(albedo);
  m.Metallic = 0;
  m.Roughness = roughness;
  return m;
}
Material Glass(float roughness)
{
  Material m;
  m.Metallic = 0;
  m.Roughness = roughness;
  m.Transmission = 1;
  m.Volume = true;
  return m;
}
Material Colored(float r, float g, float b)
{
  Material m = SceneBuilder::Lambert(1);
  m.BaseColor = { r, g, b };
  return m;
}

/// A room open to the camera, 2 wide: floor, ceiling, coloured walls, back.
SceneBuilder Walls()
{
  SceneBuilder b;
  const int white = b.Add(SceneBuilder::Lambert(.7f)), red = b.Add(Colored(.6f, .05f, .05f)),
            green = b.Add(Colored(.1f, .5f, .1f));
  b.Quad(white, { -1, 0, 1 }, { 2, 0, 0 }, { 0, 0, -2 });
  b.Quad(white, { -1, 2, -1 }, { 2, 0, 0 }, { 0, 0, 2 });
  b.Quad(white, { -1, 0, -1 }, { 2, 0, 0 }, { 0, 2, 0 });
  b.Quad(red, { -1, 0, 1 }, { 0, 0, -2 }, { 0, 2, 0 });
  b.Quad(green, { 1, 0, -1 }, { 0, 0, 2 }, { 0, 2, 0 });
  b.Camera({ 0, 1, 3.2 }, .75);
  return b;
}
void CeilingLamp(SceneBuilder& b, float half, float emission, float height = 1.98f)
{
  // from below only: just above a lamp light samples have no finite variance
  Material m = SceneBuilder::Lambert(0, emission);
  m.DoubleSided = false;
  b.Quad(b.Add(m), { -half, height, -half }, { 2 * half, 0, 0 }, { 0, 0, 2 * half });
}

SceneBuilder LampRoom()
{
  SceneBuilder b = Walls();
  CeilingLamp(b, .4f, 8);
  b.Box(b.Add(SceneBuilder::Lambert(.5f)), { -.6f, 0, -.5f }, { -.1f, .9f, 0 });
  return b;
}
SceneBuilder BigCloseLamp()
{
  SceneBuilder b = Walls();
  // fills the ceiling, and a plate stands just below it
  CeilingLamp(b, 1, 1);
  b.Box(b.Add(SceneBuilder::Lambert(.8f)), { -.5f, 1.7f, -.5f }, { .5f, 1.9f, .5f });
  return b;
}
SceneBuilder SunnySky()
{
  SceneBuilder b;
  const int white = b.Add(SceneBuilder::Lambert(.6f));
  b.Quad(white, { -3, 0, 3 }, { 6, 0, 0 }, { 0, 0, -6 });
  b.Sphere(b.Add(Colored(.8f, .4f, .2f)), { 0, .6f, 0 }, .6f, 24);
  Texture t;
  t.Width = 32;
  t.Height = 16;
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 32; ++x)
    {
      const bool sun = (y == 4 || y == 5) && (x == 9 || x == 10);
      const float blue = sun ? 60.f : .2f + .8f * float(16 - y) / 16;
      t.Floats.insert(t.Floats.end(), { sun ? 90.f : .1f + .02f * float(x % 5), sun ? 80.f : .3f, blue, 1 });
    }
  b.Scene->Textures.push_back(t);
  b.Sky(1);
  b.Scene->Sky.Texture = 0;
  b.Camera({ 0, 1.2, 3.5 }, .7, .2);
  return b;
}
SceneBuilder ManyLamps()
{
  // 1000 triangles of very different power all over a room
  SceneBuilder b = Walls();
  for (int k = 0; k < 4; ++k)
  {
    std::vector<Vec3f> p;
    std::vector<std::uint32_t> t;
    for (int i = 0; i < 250; ++i)
    {
      const auto u = [&](int d)
      { return sampling::UnitFloat(std::uint32_t(sampling::Mix64(std::uint64_t(1 + i + 250 * k + 7919 * d)) >> 20)); };
      const Vec3f c{ 1.8f * u(0) - .9f, .05f + 1.9f * u(1), 1.8f * u(2) - .9f };
      const float s = .03f + .05f * u(3);
      p.insert(p.end(), { c, c + Vec3f(s, s * (u(4) - .5f), 0), c + Vec3f(0, s * (u(5) - .5f), s) });
      t.insert(t.end(), { std::uint32_t(3 * i), std::uint32_t(3 * i + 1), std::uint32_t(3 * i + 2) });
    }
    Material m = SceneBuilder::Lambert(.2f);
    m.DoubleSided = k % 2 == 0;
    m.Emission = Vec3f(k == 0 ? 9.f : 1.f, k == 1 ? 4.f : .5f, k == 3 ? 20.f : .1f);
    b.AddMesh(b.Add(m), p, t);
  }
  return b;
}
SceneBuilder RoughMetalRoom()
{
  SceneBuilder b = Walls();
  CeilingLamp(b, .25f, 15);
  b.Sphere(b.Add(SceneBuilder::Metal(.8f, .25f)), { -.4f, .4f, -.2f }, .4f, 24);
  b.Sphere(b.Add(SceneBuilder::Metal(.6f, .7f)), { .5f, .35f, .2f }, .35f, 24);
  b.Box(b.Add(Dielectric(.4f, .3f)), { -.2f, 0, .4f }, { .2f, .3f, .8f });
  return b;
}
SceneBuilder RoughGlassRoom()
{
  SceneBuilder b = Walls();
  CeilingLamp(b, .6f, 4);
  b.Sphere(b.Add(Glass(.5f)), { -.3f, .5f, 0 }, .5f, 24);
  Material thin = Glass(.7f);
  thin.Volume = false;
  thin.BaseColor = { .9f, .6f, .3f };
  b.Quad(b.Add(thin), { .2f, 0, .5f }, { .6f, 0, 0 }, { 0, 1.2f, 0 });
  return b;
}
SceneBuilder TexturedLamp()
{
  SceneBuilder b = Walls();
  Texture t;
  t.Width = t.Height = 8;
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x)
      t.Floats.insert(t.Floats.end(),
        { (x + y) % 2 ? 1.f : 0.f, x == 3 && y == 5 ? 30.f : .1f, float(y) / 8, (x / 4 + y / 4) % 2 ? 1.f : .25f });
  b.Scene->Textures.push_back(t);
  Material m = SceneBuilder::Lambert(.3f, 4);
  m.EmissiveTexture.Texture = 0;
  // seen through in part, by the same picture's alpha
  m.BaseColorTexture.Texture = 0;
  m.Mode = AlphaMode::Blend;
  Mesh& lamp = b.AddMesh(b.Add(m),
    { { -.7f, 1.5f, -.9f }, { .7f, 1.5f, -.9f }, { .7f, 1.9f, .3f }, { -.7f, 1.9f, .3f } }, { 0, 1, 2, 0, 2, 3 });
  lamp.TexCoords[0] = { { 0, 0 }, { 1, 0 }, { 1, 1 }, { 0, 1 } };
  return b;
}
SceneBuilder CoatedRoom()
{
  SceneBuilder b = Walls();
  CeilingLamp(b, .4f, 8);
  Material coat = SceneBuilder::Metal(.5f, .6f);
  coat.Clearcoat = 1;
  coat.ClearcoatRoughness = .3f;
  b.Sphere(b.Add(coat), { -.4f, .5f, 0 }, .5f, 24);
  Material paint = Dielectric(.7f, .8f);
  paint.BaseColor = { .8f, .2f, .1f };
  paint.Clearcoat = .7f;
  paint.ClearcoatRoughness = .25f;
  b.Sphere(b.Add(paint), { .5f, .4f, .3f }, .4f, 24);
  return b;
}

/// A lamp above a tinted window, half of whose pane is frosted by a diffuse share and a coat, and behind a thin box.
SceneBuilder PaneRoom()
{
  SceneBuilder b = Walls();
  CeilingLamp(b, .4f, 8);
  Material pane = Colored(.9f, .7f, .4f);
  pane.Specular = 1;
  pane.Transmission = 1;
  pane.Roughness = 0;
  b.Quad(b.Add(pane), { -1, 1.5f, 1 }, { 1, 0, 0 }, { 0, 0, -2 });
  pane.Transmission = .6f;
  pane.Clearcoat = .8f;
  pane.ClearcoatRoughness = .3f;
  b.Quad(b.Add(pane), { 0, 1.5f, 1 }, { 1, 0, 0 }, { 0, 0, -2 });
  pane = Material();
  pane.Metallic = pane.Roughness = 0;
  pane.Transmission = 1;
  b.Box(b.Add(pane), { -.6f, 0, -.5f }, { -.1f, .9f, 0 });
  return b;
}

double MeanOf(const statistics::Picture& p)
{
  double sum = 0;
  for (float v : p.Pixels)
    sum += double(v);
  return sum / double(p.Pixels.size());
}

/// The three strategies have one mean, block by block; the combination is not worse than `factor` times the better.
void Agree(const char* name, const SceneBuilder& b, int samples, double factor, int bounces = 3)
{
  const Strategy all[] = { Strategy::Mis, Strategy::LightOnly, Strategy::BsdfOnly };
  const char* names[] = { "MIS", "light", "BSDF" };
  Shot shots[3];
  double variance[3];
  Settings s;
  s.Width = s.Height = 32;
  s.Samples = samples * (trust::LongTests() ? 32 : 1);
  s.Bounces = bounces;
  for (int k = 0; k < 3; ++k)
  {
    s.Sampling = all[k];
    s.Seed = std::uint64_t(100 + k);
    shots[k] = Shoot(b.Scene, s, { "radiance", "variance" });
    variance[k] = MeanOf(shots[k]["variance"]);
    EXPECT_EQ(shots[k].Counters.NonFinite, 0);
  }
  EXPECT_GT(MeanOf(shots[0]["radiance"]), .005);
  for (int k = 0; k < 3; ++k)
  {
    const int other = (k + 1) % 3;
    const BlockTest t = statistics::BySpread(shots[k]["radiance"], shots[other]["radiance"], 8);
    std::printf("  %s, %s : %s, %d spp: %s\n", name, names[k], names[other], s.Samples, t.Text().c_str());
    EXPECT_TRUE(t.Agrees()) << names[k] << " against " << names[other] << ": " << t.Text();
    EXPECT_LT(t.Whole, statistics::NormalThreshold(statistics::SidakLevel(.001, 3))) << t.Text();
  }
  std::printf("  %s, variance of MIS over light %.3f, over BSDF %.3f\n", name, variance[0] / variance[1],
    variance[0] / variance[2]);
  EXPECT_LT(variance[0], factor * std::min(variance[1], variance[2]));
}
}

TEST(Strategies, LampRoom)
{
  Agree("lamp room", LampRoom(), 64, 1.2);
}
TEST(Strategies, BigCloseLamp)
{
  Agree("big close lamp", BigCloseLamp(), 64, 1.2);
}
TEST(Strategies, SunnySky)
{
  Agree("sunny sky", SunnySky(), 256, 1.2);
}
TEST(Strategies, ManyLamps)
{
  Agree("1000 lamps", ManyLamps(), 128, 1.2);
}
TEST(Strategies, RoughMetal)
{
  Agree("rough metal", RoughMetalRoom(), 128, 1.2);
}
TEST(Strategies, RoughGlass)
{
  Agree("rough glass", RoughGlassRoom(), 128, 1.2, 5);
}
TEST(Strategies, TexturedLamp)
{
  Agree("textured lamp", TexturedLamp(), 64, 1.2);
}
TEST(Strategies, Panes)
{
  Agree("panes", PaneRoom(), 128, 1.2, 7);
}
TEST(Strategies, Coated)
{
  Agree("clear coat", CoatedRoom(), 128, 1.2);
}

namespace
{
/// A Lambert floor of albedo .5 and the camera's look at its origin.
SceneBuilder Floor()
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Lambert(.5f)), { -20, 0, 20 }, { 40, 0, 0 }, { 0, 0, -40 });
  b.Camera({ 0, 2, 2 }, .01, std::atan(1.));
  return b;
}
/// A disc of `sides` triangles above the floor, of the area of a round one.
void Disc(SceneBuilder& b, float radius, float height, int sides = 512)
{
  const double step = 2 * 3.14159265358979 / sides, r = double(radius) * std::sqrt(step / std::sin(step));
  std::vector<Vec3f> p{ { 0, height, 0 } };
  std::vector<std::uint32_t> t;
  for (int i = 0; i < sides; ++i)
  {
    p.push_back({ float(r * std::cos(i * step)), height, float(r * std::sin(i * step)) });
    t.insert(t.end(), { 0u, std::uint32_t(1 + i), std::uint32_t(1 + (i + 1) % sides) });
  }
  b.AddMesh(b.Add(SceneBuilder::Lambert(0, 1)), p, t);
}

/// Uniform sky of 1 and a quad of the material, seen under the cosine `mu`.
double SkyFurnace(const Material& m, double mu, int samples, double& error, int bounces = 64)
{
  SceneBuilder b;
  b.Quad(b.Add(m), { -20, 0, 20 }, { 40, 0, 0 }, { 0, 0, -40 });
  b.Sky(1);
  const double down = std::asin(mu);
  b.Camera({ 0, 2 * mu, 2 * std::cos(down) }, 1e-4, down);
  Settings s;
  s.Samples = samples;
  s.Bounces = bounces;
  const Estimate e = Centre(b.Scene, s);
  error = e.Error;
  return e.Mean;
}

double Fresnel(double c, double eta)
{
  const double s2 = (1 - c * c) / (eta * eta);
  if (s2 >= 1)
    return 1;
  const double t = std::sqrt(1 - s2), p = (eta * c - t) / (eta * c + t), s = (c - eta * t) / (c + eta * t);
  return (p * p + s * s) / 2;
}
}

// E = pi L R^2 / (R^2 + h^2)
TEST(ClosedForms, DiscLight)
{
  for (float r : { .1f, 1.f, 5.f })
    for (Strategy strategy : { Strategy::Mis, Strategy::LightOnly, Strategy::BsdfOnly })
    {
      SceneBuilder b = Floor();
      Disc(b, r, 1);
      b.Scene->Cameras.clear();
      b.Camera({ 0, .5, .5 }, .0001, std::atan(1.));
      const double gold = .5 * double(r) * double(r) / (double(r) * double(r) + 1);
      Settings s;
      s.Bounces = 1;
      s.Samples = 16384;
      s.Sampling = strategy;
      const Estimate e = Centre(b.Scene, s);
      EXPECT_NEAR(e.Mean, gold, 4 * e.Error + 1e-4 * gold) << r << " strategy " << int(strategy);
    }
}

// E = pi L (R / d)^2
TEST(ClosedForms, SphereLight)
{
  for (Strategy strategy : { Strategy::Mis, Strategy::LightOnly, Strategy::BsdfOnly })
  {
    SceneBuilder b = Floor();
    b.Sphere(b.Add(SceneBuilder::Lambert(0, 1)), { 0, 2, 0 }, .5f, 128);
    b.Scene->Cameras.clear();
    b.Camera({ 0, .5, .5 }, .0001, std::atan(1.));
    Settings s;
    s.Bounces = 1;
    s.Samples = 16384;
    s.Sampling = strategy;
    const Estimate e = Centre(b.Scene, s);
    // the polyhedron's outline is .02 % smaller
    EXPECT_NEAR(e.Mean, .196349541 / 2 / 3.14159265, 4 * e.Error + 3e-4 * .03125) << int(strategy);
  }
}

// E T(theta)^n of a lamp behind n panes of glass, T = (1 - F) tint.
TEST(ClosedForms, LampsShineThroughPanes)
{
  const double theta = .6, c = std::cos(theta), t = (1 - Fresnel(c, 1.5)) * .8;
  for (LightType type : { LightType::Directional, LightType::Point, LightType::Spot })
    for (int panes : { 1, 2, 3, 16, 17 })
    {
      SceneBuilder b = Floor();
      Material m;
      m.BaseColor = Vec3f(.8f);
      m.Metallic = m.Roughness = 0;
      m.Transmission = 1;
      const int pane = b.Add(m);
      // the camera looks from below the panes
      for (int k = 0; k < panes; ++k)
        b.Quad(pane, { -4, 1 + .05f * float(k), 4 }, { 8, 0, 0 }, { 0, 0, -8 });
      b.Scene->Cameras.clear();
      b.Camera({ 0, .5, .5 }, .0001, std::atan(1.));
      Node node;
      node.Translation = { 0, 5 * c, 5 * std::sin(theta) };
      // -z turned down by pi / 2 - theta
      node.Rotation[0] = -std::sin((1.57079632679 - theta) / 2);
      node.Rotation[3] = std::cos((1.57079632679 - theta) / 2);
      b.Scene->Nodes.push_back(node);
      PunctualLight l;
      l.Type = type;
      l.Node = int(b.Scene->Nodes.size()) - 1;
      l.Intensity = Vec3f(3.f);
      l.InnerCone = .4f;
      l.OuterCone = .5f;
      b.Scene->Lights.push_back(l);
      const double e = 3 * c / (type == LightType::Directional ? 1 : 25);
      // direct light: what panes and floor send to and fro is not in the closed form
      const auto direct = [&b](int bounces)
      {
        Settings s;
        s.Width = s.Height = 1;
        s.PixelJitter = quell::Integrator::Jitter::None;
        s.Samples = 4;
        s.Bounces = bounces;
        return double(Shoot(b.Scene, s, { "direct" })["direct"].Pixels[0]);
      };
      const double gold = panes > 16 ? 0 : .5 / 3.14159265 * e * std::pow(t, panes);
      EXPECT_NEAR(direct(1 + panes), gold, 2e-5 * gold) << int(type) << ' ' << panes;
      // each is a scattering
      EXPECT_EQ(direct(panes), 0.) << int(type) << ' ' << panes;
    }
}

TEST(ClosedForms, TheEdgeBetweenTwoTrianglesOfAPaneIsOnePane)
{
  SceneBuilder b = Floor();
  Material m;
  m.Metallic = m.Roughness = 0;
  m.Transmission = 1;
  // The way up from the origin meets the diagonal of the quad.
  b.Quad(b.Add(m), { -4, 1, 4 }, { 8, 0, 0 }, { 0, 0, -8 });
  b.Scene->Cameras.clear();
  b.Camera({ 0, .5, .5 }, .0001, std::atan(1.));
  Node node;
  node.Rotation[0] = -std::sqrt(.5);
  node.Rotation[3] = std::sqrt(.5);
  b.Scene->Nodes.push_back(node);
  PunctualLight l;
  l.Type = LightType::Directional;
  l.Node = int(b.Scene->Nodes.size()) - 1;
  l.Intensity = Vec3f(3.f);
  b.Scene->Lights.push_back(l);
  Settings s;
  s.Width = s.Height = 1;
  s.PixelJitter = quell::Integrator::Jitter::None;
  s.Bounces = 2;
  EXPECT_NEAR(double(Shoot(b.Scene, s, { "direct" })["direct"].Pixels[0]), .5 / 3.14159265 * 3 * .96, 1e-5);
}

TEST(ClosedForms, WhatIsJustBelowALampCastsItsShadow)
{
  for (bool area : { false, true })
    for (double height : { 3., 10., 1000. })
      for (double gap : { 1e-5, 9e-5, 1e-3 })
      {
        SceneBuilder b = Floor();
        const float h = float(height), below = float(height * (1 - gap)), r = float(height * .1);
        b.Quad(b.Add(SceneBuilder::Lambert(0)), { -r, below, r }, { 2 * r, 0, 0 }, { 0, 0, -2 * r });
        if (area)
          b.Quad(b.Add(SceneBuilder::Lambert(0, 10)), { -r / 2, h, -r / 2 }, { r, 0, 0 }, { 0, 0, r });
        else
        {
          Node node;
          node.Translation = { 0, height, 0 };
          b.Scene->Nodes.push_back(node);
          PunctualLight l;
          l.Type = LightType::Point;
          l.Node = int(b.Scene->Nodes.size()) - 1;
          l.Intensity = Vec3f(float(height * height));
          b.Scene->Lights.push_back(l);
        }
        b.Scene->Cameras.clear();
        b.Camera({ 0, .5, .5 }, .0001, std::atan(1.));
        Settings s;
        s.Width = s.Height = 1;
        s.PixelJitter = quell::Integrator::Jitter::None;
        s.Samples = 16;
        s.Bounces = 1;
        EXPECT_EQ(double(Shoot(b.Scene, s, { "direct" })["direct"].Pixels[0]), 0.)
          << area << ' ' << height << ' ' << gap;
      }
}

// Two parallel unit squares at distance 1, F = .199825: the mean over one of them, not a point.
TEST(ClosedForms, ParallelSquares)
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Lambert(.5f)), { -.5f, 0, .5f }, { 1, 0, 0 }, { 0, 0, -1 });
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -.5f, 1, -.5f }, { 1, 0, 0 }, { 0, 0, 1 });
  CameraModel c;
  c.Orthographic = true;
  c.YMag = .5;
  b.Camera({ 0, .5, 0 }, 1, std::atan(1.) * 2);
  c.WorldFromCamera = b.Scene->Cameras[0].WorldFromCamera;
  b.Scene->Cameras[0] = c;
  Settings s;
  s.Width = s.Height = 16;
  s.Samples = 256;
  s.Bounces = 1;
  const Shot shot = Shoot(b.Scene, s, { "radiance", "variance" });
  const double mean = MeanOf(shot["radiance"]), error = std::sqrt(MeanOf(shot["variance"]) / 256);
  EXPECT_NEAR(mean, .5 * .1998248957, 4 * error + 1e-6);
  EXPECT_LT(error, 2e-4);
}

// A wall that sees a lamp in the ceiling at the end of it, at grazing angles: the irradiance of a polygon is
// L / 2 sum angle_i (axis_i . n) over its edges, for the part above the wall's horizon (here all of it).
TEST(ClosedForms, LampAtGrazingAngles)
{
  for (double below : { .01, .05, .1, .3, 1. })
  {
    SceneBuilder b;
    b.Quad(b.Add(SceneBuilder::Lambert(.5f)), { -2, 0, -1 }, { 4, 0, 0 }, { 0, 2, 0 });
    // the lamp in a hole of a black ceiling
    const int black = b.Add(SceneBuilder::Lambert(0));
    b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -.25f, 2, -.25f }, { .5f, 0, 0 }, { 0, 0, .5f });
    b.Quad(black, { -2, 2, -1 }, { 4, 0, 0 }, { 0, 0, .75f });
    b.Quad(black, { -2, 2, -.25f }, { 1.75f, 0, 0 }, { 0, 0, .5f });
    b.Quad(black, { .25f, 2, -.25f }, { 1.75f, 0, 0 }, { 0, 0, .5f });
    // a pixel a thousandth wide on the wall at the height 2 - below
    b.Camera({ 0, 2 - below, 1 }, 1e-6);
    const Vec3d p{ 0, 2 - below, -1 };
    const Vec3d corner[] = { { -.25, 2, -.25 }, { .25, 2, -.25 }, { .25, 2, .25 }, { -.25, 2, .25 } };
    double gold = 0;
    for (int i = 0; i < 4; ++i)
    {
      const Vec3d u = Normalized(corner[i] - p), v = Normalized(corner[(i + 1) % 4] - p), axis = Cross(u, v);
      gold += std::atan2(Length(axis), Dot(u, v)) * Normalized(axis).z / 2;
    }
    gold = std::fabs(gold) * .5 / 3.14159265358979;
    for (Strategy strategy : { Strategy::Mis, Strategy::LightOnly })
    {
      Settings s;
      s.Samples = 65536;
      s.Bounces = 1;
      s.Sampling = strategy;
      const Estimate e = Centre(b.Scene, s);
      EXPECT_NEAR(e.Mean / gold, 1, (4 * e.Error + 1e-7) / gold) << below << " strategy " << int(strategy);
      EXPECT_LT(e.Error, .005 * gold);
    }
  }
}

// Beer-Lambert in a slab with all inter-reflections: T = (1-F)^2 a / (1 - F^2 a^2), a = color^(path / distance).
TEST(ClosedForms, AbsorbingSlab)
{
  for (double angle : { 0., .7, 1.2 })
  {
    SceneBuilder b;
    Material glass = Glass(0);
    glass.AttenuationColor = { .5f, .2f, .9f };
    glass.AttenuationDistance = .15f;
    b.Box(b.Add(glass), { -500, -500, -1 }, { 500, 500, -.9f });
    b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -90, -90, -3 }, { 180, 0, 0 }, { 0, 180, 0 });
    b.Camera({ 0, 0, 1 }, .0001, angle);
    Settings s;
    s.Width = s.Height = 1;
    s.Samples = 65536;
    s.Bounces = 60;
    s.PixelJitter = Integrator::Jitter::None;
    const Shot shot = Shoot(b.Scene, s, { "radiance" });
    const double c = std::cos(angle), f = Fresnel(c, 1.5), ct = std::sqrt(1 - std::sin(angle) * std::sin(angle) / 2.25);
    for (int k = 0; k < 3; ++k)
    {
      const double color[] = { .5, .2, .9 }, a = std::pow(color[k], .1 / ct / .15);
      const double gold = (1 - f) * (1 - f) * a / (1 - f * f * a * a);
      // samples are 0 or up to a: binomial
      EXPECT_NEAR(shot["radiance"].At(0, 0, k), gold, 5 * std::sqrt(gold * a) * .5 / 256 + 1e-5) << angle << ' ' << k;
    }
  }
}

// A smooth dielectric seen from inside under a sky of 1: radiance n^2.
// Solid glass with attenuation at its extremes, under a white sky: where nothing is absorbed all comes back, else what
// the surface reflects. A sheet that is not closed absorbs nothing of what leaves for the sky (no length: ln c times
// infinity is no number); only radiance grows in the glass.
TEST(ClosedForms, AbsorptionWithoutEnd)
{
  for (const bool closed : { true, false })
    for (const float distance : { 1e-30f, 1e30f, std::numeric_limits<float>::infinity() })
    {
      SceneBuilder b;
      Material glass = Glass(0);
      glass.AttenuationColor = { .5f, 0, 1 };
      glass.AttenuationDistance = distance;
      if (closed)
        b.Box(b.Add(glass), { -9, -9, -1 }, { 9, 9, 0 });
      else
        b.Quad(b.Add(glass), { -9, -9, 0 }, { 18, 0, 0 }, { 0, 18, 0 });
      b.Sky(1);
      b.Camera({ 0, 0, 1 }, .0001);
      Settings s;
      s.Width = s.Height = 1;
      s.Samples = 16384;
      s.Bounces = 60;
      s.PixelJitter = Integrator::Jitter::None;
      const Shot shot = Shoot(b.Scene, s, { "radiance" });
      const double open = .04 + .96 / 2.25, noise = 5 * std::sqrt(.04 * .96 / 16384);
      for (int k = 0; k < 3; ++k)
      {
        const double got = shot["radiance"].At(0, 0, k);
        ASSERT_TRUE(std::isfinite(got)) << distance << ' ' << k;
        if (closed && k == 1 && distance > 1)
          continue; // 0^0
        EXPECT_NEAR(got, !closed ? open : k == 2 || distance > 1 ? 1 : .04, noise) << closed << distance << ' ' << k;
      }
    }
}

TEST(ClosedForms, CameraInsideGlass)
{
  for (float ior : { 1.f, 1.33f, 1.5f })
  {
    SceneBuilder b;
    Material m = Glass(0);
    m.Ior = ior;
    b.Sphere(b.Add(m), {}, 1, 32);
    b.Sky(1);
    b.Camera({ .05, .02, 0 }, .5);
    Settings s;
    s.Samples = 4096;
    s.Bounces = 64;
    const Estimate e = Centre(b.Scene, s);
    EXPECT_NEAR(e.Mean, ior * ior, 4 * e.Error + 1e-4) << ior;
  }
}

// Smooth and rough glass, thick and thin, in a sky of 1: invisible.
TEST(ClosedForms, GlassFurnace)
{
  for (bool volume : { true, false })
    for (float roughness : { 0.f, .1f, .2f, .35f, .5f, .7f, 1.f })
      for (float ior : { 1.1f, 1.5f, 2.4f })
      {
        SceneBuilder b;
        Material m = Glass(roughness);
        m.Volume = volume;
        m.Ior = ior;
        b.Box(b.Add(m), { -1, -1, -1 }, { 1, 1, 1 });
        b.Sky(1);
        b.Camera({ .3, .9, 4 }, .0001, .15);
        Settings s;
        s.Samples = 2048;
        s.Bounces = 256;
        s.Roulette = 8;
        const Estimate e = Centre(b.Scene, s);
        EXPECT_NEAR(e.Mean, 1, 4 * e.Error + .01)
          << "roughness " << roughness << " ior " << ior << " volume " << volume;
      }
}

// White metal under a white sky at every roughness and angle: 1, within 1 %.
TEST(ClosedForms, MetalFurnace)
{
  double worst = 0;
  for (int r = 0; r <= 10; ++r)
    for (double mu : { .03, .1, .3, .6, 1. })
    {
      double error;
      const double mean = SkyFurnace(SceneBuilder::Metal(1, float(r) / 10), mu, 8192, error);
      worst = std::max(worst, std::fabs(mean - 1));
      EXPECT_NEAR(mean, 1, 4 * error + .01) << "roughness " << r / 10. << " cosine " << mu;
    }
  std::printf("  white metal: largest departure from 1: %.4f\n", worst);
}

// A white dielectric reflects all, by its reflection or below it; never more than that.
TEST(ClosedForms, DielectricFurnace)
{
  double worst = 0;
  for (int r = 0; r <= 10; ++r)
    for (double mu : { .03, .1, .3, .6, 1. })
    {
      double error;
      const double mean = SkyFurnace(Dielectric(1, float(r) / 10), mu, 8192, error);
      worst = std::max(worst, std::fabs(mean - 1));
      EXPECT_NEAR(mean, 1, 4 * error + .01) << "roughness " << r / 10. << " cosine " << mu;
    }
  std::printf("  white dielectric: largest departure from 1: %.4f\n", worst);
}

// Whatever stands in a room whose walls glow with radiance 1 and reflect nothing, if it absorbs nothing it cannot be
// seen.
TEST(ClosedForms, NothingIsLostOrMade)
{
  SceneBuilder b;
  b.Box(b.Add(SceneBuilder::Lambert(0, 1)), { -3, -3, -3 }, { 3, 3, 3 });
  const Material materials[] = { SceneBuilder::Lambert(1), SceneBuilder::Metal(1, 0), SceneBuilder::Metal(1, .3f),
    SceneBuilder::Metal(1, .8f), Dielectric(1, 0), Dielectric(1, .5f), Glass(0), Glass(.4f) };
  for (int i = 0; i < 8; ++i)
  {
    const float x = -1.2f + .8f * float(i % 4), y = i < 4 ? -.4f : .4f;
    b.Box(b.Add(materials[i]), { x - .35f, y - .35f, -.5f }, { x + .35f, y + .35f, .2f });
  }
  b.Camera({ 0, 0, 2.8 }, .75, .05);
  Settings s;
  s.Width = 64;
  s.Height = 32;
  s.Samples = 64;
  s.Bounces = 512;
  s.Roulette = 6;
  const Shot shot = Shoot(b.Scene, s, { "radiance", "variance", "id" });
  for (int id = 1; id <= 9; ++id)
  {
    double sum = 0, variance = 0;
    int n = 0;
    for (int y = 0; y < s.Height; ++y)
      for (int x = 0; x < s.Width; ++x)
        if (int(shot["id"].At(x, y, 0)) == id)
        {
          sum += shot["radiance"].At(x, y, 1);
          variance += shot["variance"].At(x, y, 0);
          ++n;
        }
    ASSERT_GT(n, 20) << id;
    EXPECT_NEAR(sum / n, 1, 4 * std::sqrt(variance) / n + .01) << "object " << id;
    std::printf("  object %d: %.4f +- %.4f\n", id, sum / n, std::sqrt(variance) / n);
  }
}

// The mean does not depend on Russian roulette, in a room with metal and glass.
TEST(ClosedForms, RouletteChangesNoMean)
{
  SceneBuilder b = RoughMetalRoom();
  b.Sphere(b.Add(Glass(0)), { .1f, .9f, .3f }, .3f, 24);
  Settings s;
  s.Samples = 64;
  s.Bounces = 12;
  const Shot off = Shoot(b.Scene, s, { "radiance" });
  s.Roulette = 1;
  s.Seed = 77;
  const Shot on = Shoot(b.Scene, s, { "radiance" });
  s.Roulette = 0;
  s.Seed = 78;
  const Shot early = Shoot(b.Scene, s, { "radiance" });
  for (const Shot* shot : { &on, &early })
  {
    const BlockTest t = statistics::BySpread(off["radiance"], (*shot)["radiance"]);
    std::printf("  roulette: %s\n", t.Text().c_str());
    EXPECT_TRUE(t.Agrees()) << t.Text();
    EXPECT_LT(t.Whole, 4.1) << t.Text();
    EXPECT_LT(shot->Counters.Rays, off.Counters.Rays);
  }
}

// MaximumBounces n: the furnace of albedo rho ends at (1 - rho^(n+1)) / (1 - rho), for any n that can be asked.
TEST(ClosedForms, EveryNumberOfBounces)
{
  for (float rho : { .5f, .9f, .99f })
  {
    SceneBuilder b;
    b.Box(b.Add(SceneBuilder::Lambert(rho, 1)), { -1, -1, -1 }, { 1, 1, 1 });
    b.Camera({ .2, .1, .3 }, .5);
    for (int n : { 0, 1, 2, 3, 10, 50, 1024 })
    {
      Settings s;
      s.Samples = n > 50 ? 256 : 2048;
      s.Bounces = n;
      const Estimate e = Centre(b.Scene, s);
      const double r = double(rho), gold = (1 - std::pow(r, n + 1)) / (1 - r);
      // inside of the box every strategy sees the same light: the noise is small and that of the last vertex only
      EXPECT_NEAR(e.Mean, gold, 4 * e.Error + 2e-4 * gold) << "rho " << r << " n " << n;
    }
  }
}

// k bounces between two mirrors: rho^k, for each k.
TEST(ClosedForms, MirrorCorridor)
{
  for (int k : { 1, 2, 3, 7, 20 })
  {
    SceneBuilder b;
    b.Quad(b.Add(SceneBuilder::Metal(.5f, 0)), { -50, 0, 50 }, { 100, 0, 0 }, { 0, 0, -100 });
    b.Quad(0, { -50, 1, -50 }, { 100, 0, 0 }, { 0, 0, 100 });
    b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -50, -1, float(-k) - .25f + .5f }, { 100, 0, 0 }, { 0, 3, 0 });
    b.Camera({ 0, .5, 0 }, .0001, std::atan(1.));
    Settings s;
    s.Samples = 4;
    s.Bounces = k;
    const double f = .5 + .5 * std::pow(1 - std::sqrt(.5), 5);
    EXPECT_NEAR(Centre(b.Scene, s).Mean / std::pow(f, k), 1, 1e-5) << k;
    s.Bounces = k - 1;
    EXPECT_EQ(Centre(b.Scene, s).Mean, 0.) << k;
  }
}

namespace
{
/// Sum over the pixels, mean position and variance of the position along x and y, pixels.
struct Spot
{
  double Sum = 0, Mean[2] = {}, Spread[2] = {};
  explicit Spot(const statistics::Picture& p)
  {
    double square[2] = {};
    for (int y = 0; y < p.Height; ++y)
      for (int x = 0; x < p.Width; ++x)
      {
        const double v = p.At(x, y, 0), at[2] = { x + .5, y + .5 };
        Sum += v;
        for (int k = 0; k < 2; ++k)
        {
          Mean[k] += v * at[k];
          square[k] += v * at[k] * at[k];
        }
      }
    for (int k = 0; k < 2; ++k)
    {
      Mean[k] /= Sum;
      Spread[k] = square[k] / Sum - Mean[k] * Mean[k];
    }
  }
};

/// A lamp of `side` units in the depth `z` before a camera of opening angle 2 atan(1/4).
SceneBuilder FarLamp(double z, double side)
{
  SceneBuilder b;
  const float h = float(side / 2);
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -h, -h, float(-z) }, { 2 * h, 0, 0 }, { 0, 2 * h, 0 });
  b.Camera({ 0, 0, 0 }, 2 * std::atan(.25));
  return b;
}
}

// Thin lens of radius R, focus f: a point at depth z becomes an even disc of radius R |z - f| / (z f), in tangents. A
// lamp keeps its light, and the variance of its image grows by radius^2 / 4 along each axis.
TEST(ClosedForms, LensBlur)
{
  Settings s;
  s.Width = s.Height = 64;
  s.Samples = 256;
  s.Bounces = 0;
  const double pixel = 32 / .25; // pixels per unit of tangent
  for (double z : { 2., 4., 12. })
    for (double radius : { 0., .1, .25 })
    {
      s.LensRadius = radius;
      s.FocusDistance = 4;
      const double side = .05 * z * 1.25; // 8 pixels
      const Spot spot(Shoot(FarLamp(z, side).Scene, s, { "radiance" })["radiance"]);
      const double disc = radius * std::fabs(z - 4) / (4 * z) * pixel, width = side / z * pixel;
      EXPECT_NEAR(spot.Sum, width * width, .005 * width * width) << z << ' ' << radius;
      for (int k = 0; k < 2; ++k)
      {
        EXPECT_NEAR(spot.Mean[k], 32, .03) << z << ' ' << radius;
        // lamp and disc; that light counts at the centres of pixels adds -1/12 (edges between pixels) to 1/12 (smooth)
        const double gold = width * width / 12 + disc * disc / 4;
        EXPECT_NEAR(spot.Spread[k], gold, 1. / 12 + 4 * gold / std::sqrt(spot.Sum * s.Samples)) << z << ' ' << radius;
      }
    }
}

// A lamp that moves evenly by d while the shutter is open keeps its light; along its way the variance of its image
// grows by d^2 / 12, and a pixel in the middle is lit for as long as the lamp covers it.
TEST(ClosedForms, MotionBlur)
{
  Settings s;
  s.Width = s.Height = 64;
  s.Samples = 256;
  s.Bounces = 0;
  s.Time = 1;
  const double pixel = 32 / .25, z = 4, side = .25, width = side / z * pixel;
  for (double open : { 0., .25 })
    for (double speed : { 0., 1., -.5 })
    {
      SceneBuilder b = FarLamp(z, side);
      AnimationChannel c;
      c.Node = 0;
      c.Times = { 0, 10 };
      // at time 1.5 in the middle
      c.Values = { float(-1.5 * speed), 0, 0, float(8.5 * speed), 0, 0 };
      b.Scene->Animation.push_back(c);
      s.ShutterOpen = open;
      s.ShutterClose = 1 - open;
      const double way = speed * (1 - 2 * open) / z * pixel;
      const Shot shot = Shoot(b.Scene, s, { "radiance" });
      const Spot spot(shot["radiance"]);
      EXPECT_NEAR(spot.Sum, width * width, .005 * width * width) << open << ' ' << speed;
      EXPECT_NEAR(spot.Mean[0], 32, .05);
      const double gold = (width * width + way * way) / 12;
      const double noise = 4 / std::sqrt(spot.Sum * s.Samples);
      EXPECT_NEAR(spot.Spread[0], gold, 1. / 12 + noise * gold) << open << ' ' << speed;
      EXPECT_NEAR(spot.Spread[1], width * width / 12, 1. / 12 + noise * width * width / 12);
      double covered = 0;
      for (int i = 0; i < 100; ++i)
        for (int j = 0; j < 1000; ++j)
          covered += std::fabs((i + .5) / 100 - way * ((j + .5) / 1000 - .5)) < width / 2 ? 1e-5 : 0;
      EXPECT_NEAR(shot["radiance"].At(32, 32, 0), covered, .03) << open << ' ' << speed;
    }
}

// Light and sensor change places: patch A shines on patch B through everything in between, or B on A.
TEST(ClosedForms, Reciprocity)
{
  double mean[2], error[2];
  for (int way = 0; way < 2; ++way)
  {
    SceneBuilder b = Walls();
    b.Sphere(b.Add(SceneBuilder::Metal(.8f, .4f)), { -.4f, .4f, -.3f }, .4f, 24);
    b.Box(b.Add(Dielectric(.6f, .3f)), { .1f, .3f, -.4f }, { .5f, 1.1f, 0 });
    b.Box(b.Add(Glass(0)), { -.9f, .9f, -.2f }, { -.2f, 1.2f, .4f });
    // A on the ceiling looks down, B on the left wall looks right; .3 x .3 both
    Material dark = SceneBuilder::Lambert(.5f), bright = SceneBuilder::Lambert(.5f, 1);
    // the sensor sees one side, so the lamp has one; interpolated normals are not reciprocal
    dark.DoubleSided = bright.DoubleSided = false;
    for (Mesh& m : b.Scene->Meshes)
      m.Normals.clear();
    b.Quad(b.Add(way == 0 ? bright : dark), { .3f, 1.99f, -.6f }, { .3f, 0, 0 }, { 0, 0, .3f });
    b.Quad(b.Add(way == 0 ? dark : bright), { -.99f, .5f, .3f }, { 0, 0, -.3f }, { 0, .3f, 0 });
    CameraModel c;
    c.Orthographic = true;
    c.YMag = .15;
    if (way == 0)
    {
      // B, from the right: looks along -x
      const double m[3][4] = { { 0, 0, 1, -.95 }, { 0, 1, 0, .65 }, { -1, 0, 0, .15 } };
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j)
          c.WorldFromCamera.m[i][j] = m[i][j];
    }
    else
    {
      // A, from below: looks along +y
      const double m[3][4] = { { 1, 0, 0, .45 }, { 0, 0, -1, 1.95 }, { 0, 1, 0, -.45 } };
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j)
          c.WorldFromCamera.m[i][j] = m[i][j];
    }
    b.Scene->Cameras.assign(1, c);
    Settings s;
    s.Samples = trust::LongTests() ? 16384 : 400;
    s.Bounces = 6;
    s.Seed = std::uint64_t(5 + way);
    const Shot shot = Shoot(b.Scene, s, { "moments", "variance", "id" });
    mean[way] = 0;
    for (int p = 0; p < s.Width * s.Height; ++p)
      mean[way] += double(shot["moments"].Pixels[std::size_t(2 * p)]) / (s.Width * s.Height);
    error[way] = std::sqrt(MeanOf(shot["variance"]) / (s.Width * s.Height));
    // the camera sees the whole patch and nothing else
    for (float id : shot["id"].Pixels)
      ASSERT_EQ(int(id), way == 0 ? 10 : 9);
  }
  std::printf("  A to B %.6f +- %.6f, B to A %.6f +- %.6f\n", mean[0], error[0], mean[1], error[1]);
  EXPECT_NEAR(mean[0], mean[1], 4 * std::hypot(error[0], error[1]));
  EXPECT_LT(error[0], .03 * mean[0]);
  EXPECT_LT(error[1], .03 * mean[1]);
}
