// SPDX-License-Identifier: BSD-3-Clause
// Layers, statistics and features of the path tracer: identities, what they say about the picture, and the same bits
// however it is made.
#include "Threads.h"
#include "RenderScene.h"
#include "quellSimd.h"
#include "vtkQuellPathTraceSource.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <thread>

using namespace quell;
using statistics::Picture;
using trust::Settings;
using trust::Shoot;
using trust::Shot;

namespace
{
constexpr float Infinity = std::numeric_limits<float>::infinity();

/// A room with everything in it: lamp, spot, mirror, rough and smooth metal, glass, a see-through sheet, an unlit
/// plate, textures, and a piece of sky.
SceneBuilder Everything()
{
  SceneBuilder b;
  Texture t;
  t.Width = t.Height = 4;
  for (int i = 0; i < 16; ++i)
    t.Floats.insert(
      t.Floats.end(), { .2f + .05f * float(i), .9f - .05f * float(i), i % 3 ? .7f : .1f, i % 2 ? 1.f : .3f });
  b.Scene->Textures.push_back(t);
  Material floor = SceneBuilder::Lambert(1);
  floor.Specular = 1;
  floor.Roughness = .4f;
  floor.BaseColorTexture.Texture = 0;
  b.AddMesh(b.Add(floor), { { -2, 0, 2 }, { 2, 0, 2 }, { 2, 0, -2 }, { -2, 0, -2 } }, { 0, 1, 2, 0, 2, 3 })
    .TexCoords[0] = { { 0, 0 }, { 3, 0 }, { 3, 3 }, { 0, 3 } };
  b.Quad(b.Add(SceneBuilder::Metal(.9f, 0)), { -2, 0, -2 }, { 2, 0, 0 }, { 0, 1.5f, 0 });
  b.Quad(b.Add(SceneBuilder::Lambert(.3f, 6)), { -.4f, 2, -.4f }, { .8f, 0, 0 }, { 0, 0, .8f });
  b.Sphere(b.Add(SceneBuilder::Metal(.8f, .4f)), { .6f, .5f, -.5f }, .5f, 16);
  Material glass;
  glass.Metallic = 0;
  glass.Roughness = 0;
  glass.Transmission = 1;
  glass.Volume = true;
  glass.AttenuationColor = { .6f, .9f, .7f };
  glass.AttenuationDistance = .5f;
  b.Box(b.Add(glass), { -.6f, .1f, 0 }, { -.1f, .8f, .4f });
  Material sheet = SceneBuilder::Lambert(.6f);
  sheet.Mode = AlphaMode::Blend;
  sheet.Alpha = .5f;
  sheet.BaseColorTexture.Texture = 0;
  b.Quad(b.Add(sheet), { .1f, .05f, 1 }, { .8f, 0, 0 }, { 0, .6f, 0 });
  Material unlit = SceneBuilder::Lambert(.5f);
  unlit.Unlit = true;
  b.Quad(b.Add(unlit), { -1.8f, .2f, .5f }, { .5f, 0, 0 }, { 0, .7f, 0 });
  Node node;
  node.Translation = { 1.5, 1.8, 1 };
  b.Scene->Nodes.push_back(node);
  PunctualLight spot;
  spot.Node = int(b.Scene->Nodes.size()) - 1;
  spot.Intensity = { 2, 1, 3 };
  b.Scene->Lights.push_back(spot);
  b.Sky(.3f);
  b.Camera({ 0, 1, 4 }, .7, .1);
  return b;
}
SceneBuilder MetalOnly()
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Metal(.8f, .3f)), { -3, 0, 3 }, { 6, 0, 0 }, { 0, 0, -6 });
  b.Sphere(b.Add(SceneBuilder::Metal(.5f, .8f)), { 0, .8f, 0 }, .8f, 16);
  b.Quad(b.Add(SceneBuilder::Lambert(0, 5)), { -.5f, 3, -.5f }, { 1, 0, 0 }, { 0, 0, 1 });
  b.Camera({ 0, 1, 4 }, .7, .1);
  return b;
}
SceneBuilder DiffuseOnly()
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Lambert(.8f)), { -3, 0, 3 }, { 6, 0, 0 }, { 0, 0, -6 });
  b.Sphere(b.Add(SceneBuilder::Lambert(.5f)), { 0, .8f, 0 }, .8f, 16);
  b.Quad(b.Add(SceneBuilder::Lambert(.1f, 5)), { -.5f, 3, -.5f }, { 1, 0, 0 }, { 0, 0, 1 });
  b.Camera({ 0, 1, 4 }, .7, .1);
  return b;
}

const std::set<std::string>& Layers()
{
  static const std::set<std::string> all{ "radiance", "emission", "direct", "indirect", "directDiffuse",
    "directSpecular", "indirectDiffuse", "indirectSpecular", "bounce1", "bounce2", "bounce3", "bounce4", "bounce5",
    "halfA", "halfB", "moments", "variance" };
  return all;
}

/// Everything that a film keeps.
const std::set<std::string>& AllArrays()
{
  static const std::set<std::string> all = []()
  {
    std::set<std::string> a = Layers();
    for (const char* name :
      { "albedo", "albedoDiffuse", "albedoSpecular", "normal", "roughness", "varianceAlbedo", "varianceNormal", "depth",
        "position", "normalGeometric", "motion", "id", "material", "alpha", "hitDistance", "samples" })
      a.insert(name);
    return a;
  }();
  return all;
}

/// `parts` add up to `whole` at every pixel, but for the rounding of each to float.
void ExpectSum(const Shot& shot, const char* whole, const std::vector<std::string>& parts)
{
  const Picture& w = shot[whole];
  double worst = 0, largest = 0;
  for (std::size_t i = 0; i < w.Pixels.size(); ++i)
  {
    double sum = 0, size = std::fabs(double(w.Pixels[i]));
    for (const std::string& p : parts)
    {
      sum += double(shot[p].Pixels[i]);
      size = std::max(size, std::fabs(double(shot[p].Pixels[i])));
    }
    // half an ulp of each; sums of the same doubles in another order are far below that
    const double bound = size * double(parts.size() + 1) * 0x1p-24;
    const double off = std::fabs(sum - double(w.Pixels[i]));
    worst = std::max(worst, bound > 0 ? off / bound : off > 0 ? 1e30 : 0);
    largest = std::max(largest, size);
  }
  EXPECT_LE(worst, 1.01) << whole << ", in units of the rounding";
  EXPECT_GT(largest, 0) << whole;
}
}

TEST(Layers, AddUpAtEveryPixel)
{
  for (const SceneBuilder& b : { Everything(), MetalOnly(), DiffuseOnly() })
    for (int roulette : { 2, 1000 })
    {
      Settings s;
      s.Width = 40;
      s.Height = 32;
      s.Samples = 6;
      s.Bounces = 5;
      s.Roulette = roulette;
      const Shot shot = Shoot(b.Scene, s, Layers());
      ExpectSum(shot, "radiance", { "emission", "direct", "indirect" });
      ExpectSum(shot, "direct", { "directDiffuse", "directSpecular" });
      ExpectSum(shot, "indirect", { "indirectDiffuse", "indirectSpecular" });
      ExpectSum(shot, "direct", { "bounce1" });
      ExpectSum(shot, "indirect", { "bounce2", "bounce3", "bounce4", "bounce5" });
      ExpectSum(shot, "radiance", { "emission", "bounce1", "bounce2", "bounce3", "bounce4", "bounce5" });
      for (const std::string& name : Layers())
        for (float v : shot[name].Pixels)
          ASSERT_TRUE(std::isfinite(v) && v >= 0) << name;
    }
}

// Which layer a contribution belongs to, in scenes that have one kind only.
TEST(Layers, AreWhatTheyAreCalled)
{
  Settings s;
  s.Samples = 16;
  s.Bounces = 5;
  const Shot diffuse = Shoot(DiffuseOnly().Scene, s, Layers()), metal = Shoot(MetalOnly().Scene, s, Layers());
  for (float v : diffuse["directSpecular"].Pixels)
    EXPECT_LE(v, 1e-6f);
  EXPECT_EQ(diffuse["direct"].Pixels, diffuse["directDiffuse"].Pixels);
  for (const char* name : { "directDiffuse", "indirectDiffuse" })
    for (std::size_t i = 0; i < metal[name].Pixels.size(); ++i)
      // the lamp is Lambert and black: no diffuse light anywhere
      EXPECT_EQ(metal[name].Pixels[i], 0.f) << name;
  // a deeper layer than MaximumBounces is empty; the first n are what shorter paths give, bit by bit, without roulette
  for (int n = 0; n < 5; ++n)
  {
    s.Bounces = n;
    const Shot shorter = Shoot(Everything().Scene, s, Layers());
    s.Bounces = 5;
    const Shot longer = Shoot(Everything().Scene, s, Layers());
    for (int k = 1; k <= 5; ++k)
    {
      const std::string name = "bounce" + std::to_string(k);
      double sum = 0;
      for (float v : shorter[name].Pixels)
        sum += double(v);
      EXPECT_EQ(sum > 0, k <= n) << name << " of " << n;
      // mirrors and glass count as scatterings: only what has met none of them is complete
      for (std::size_t i = 0; i < shorter[name].Pixels.size(); ++i)
        ASSERT_LE(shorter[name].Pixels[i], longer[name].Pixels[i] * 1.00001f + 1e-7f) << name << " of " << n;
    }
  }
}

// What is demanded changes what is traced, not what is found.
TEST(Layers, DoNotDependOnTheDemand)
{
  Settings s;
  s.Width = 24;
  s.Height = 20;
  s.Samples = 4;
  s.Bounces = 4;
  s.Roulette = 2;
  for (const SceneBuilder& b : { Everything(), MetalOnly(), DiffuseOnly() })
  {
    const Shot all = Shoot(b.Scene, s, AllArrays());
    for (const std::string& name : AllArrays())
    {
      const Shot alone = Shoot(b.Scene, s, { name });
      if (name.compare(0, 6, "bounce") == 0)
      {
        EXPECT_EQ(all[name].Pixels, alone[name].Pixels) << name;
        continue;
      }
      ASSERT_EQ(all[name].Pixels.size(), alone[name].Pixels.size());
      EXPECT_EQ(
        std::memcmp(all[name].Pixels.data(), alone[name].Pixels.data(), all[name].Pixels.size() * sizeof(float)), 0)
        << name;
      EXPECT_LE(alone.Counters.Rays, all.Counters.Rays) << name;
    }
    // primary features shoot one ray per path
    EXPECT_EQ(Shoot(b.Scene, s, { "depth", "id", "position", "motion" }).Counters.Rays, 24 * 20 * 4);
  }
}

TEST(PixelStatistics, HalvesAndMoments)
{
  for (int samples : { 1, 2, 5, 8 })
  {
    Settings s;
    s.Samples = samples;
    const Shot shot = Shoot(Everything().Scene, s, Layers());
    const int even = (samples + 1) / 2, odd = samples / 2;
    for (std::size_t p = 0; p < shot["variance"].Pixels.size(); ++p)
    {
      double luminance = 0;
      for (std::size_t c = 0; c < 3; ++c)
      {
        const double a = double(shot["halfA"].Pixels[3 * p + c]), b = double(shot["halfB"].Pixels[3 * p + c]),
                     whole = double(shot["radiance"].Pixels[3 * p + c]);
        const double mean = samples == 1 ? (a + b) / 2 : (even * a + odd * b) / samples;
        ASSERT_NEAR(mean, whole, 3 * 0x1p-24 * std::max(a, std::max(b, whole)));
        const double weights[] = { .2126, .7152, .0722 };
        luminance += weights[c] * whole;
      }
      const double mean = double(shot["moments"].Pixels[2 * p]), second = double(shot["moments"].Pixels[2 * p + 1]);
      ASSERT_NEAR(mean, luminance, 1e-6 * luminance + 1e-12);
      const double variance = double(shot["variance"].Pixels[p]);
      ASSERT_NEAR(variance, samples > 1 ? second / (samples - 1) : 0, 1e-6 * variance + 1e-14) << samples;
      if (samples == 2)
      {
        // two samples: the halves are the samples
        double half[2] = {};
        for (int k = 0; k < 2; ++k)
        {
          const Picture& h = shot[k ? "halfB" : "halfA"];
          half[k] =
            .2126 * double(h.Pixels[3 * p]) + .7152 * double(h.Pixels[3 * p + 1]) + .0722 * double(h.Pixels[3 * p + 2]);
        }
        const double apart = std::fabs(half[0] - half[1]);
        ASSERT_NEAR(variance, apart * apart / 4, apart * 0x1p-23 * std::max(half[0], half[1]) + 1e-6 * variance);
      }
    }
  }
}

// Over seeds, pixels spread as far as `variance` says. Samples of one pixel are stratified: a pixel's own variance is
// at most what independent samples have, so
//   E[n variance] is within [1, 1 + 1/(n - 1)] of the variance of one sample (never below: it may not flatter),
//   and the means' own spread is not above `variance`.
TEST(PixelStatistics, VariancePredictsTheSpread)
{
  const SceneBuilder b = MetalOnly();
  Settings s;
  s.Width = s.Height = 12;
  s.Bounces = 3;
  const int seeds = trust::LongTests() ? 4000 : 160, pixels = s.Width * s.Height;
  for (int n : { 4, 16 })
  {
    std::vector<double> single(std::size_t(pixels), 0.), singleSquare(single), mean(single), meanSquare(single),
      claimed(single);
    for (int k = 0; k < seeds; ++k)
    {
      s.Seed = std::uint64_t(1000 + k);
      s.Samples = n;
      const Shot many = Shoot(b.Scene, s, { "moments", "variance" });
      s.Samples = 1;
      s.Seed = std::uint64_t(900000 + k);
      const Shot one = Shoot(b.Scene, s, { "moments" });
      for (std::size_t p = 0; p < std::size_t(pixels); ++p)
      {
        const double m = double(many["moments"].Pixels[2 * p]), o = double(one["moments"].Pixels[2 * p]);
        mean[p] += m;
        meanSquare[p] += m * m;
        single[p] += o;
        singleSquare[p] += o * o;
        claimed[p] += double(many["variance"].Pixels[p]);
      }
    }
    double varianceOfOne = 0, varianceOfMean = 0, claim = 0;
    for (std::size_t p = 0; p < std::size_t(pixels); ++p)
    {
      varianceOfOne += (singleSquare[p] - single[p] * single[p] / seeds) / (seeds - 1);
      varianceOfMean += (meanSquare[p] - mean[p] * mean[p] / seeds) / (seeds - 1);
      claim += claimed[p] / seeds;
    }
    // the same by chi-squared with (seeds - 1) * pixels degrees of freedom, but for the noise's kurtosis
    const double ratio = n * claim / varianceOfOne, kept = varianceOfMean / claim;
    std::printf(
      "  %d samples: n variance / variance of one sample %.4f, spread of the means / variance %.4f\n", n, ratio, kept);
    EXPECT_GT(ratio, .95);
    EXPECT_LT(ratio, (1 + 1. / (n - 1)) * 1.05);
    EXPECT_LT(kept, 1.05);
    EXPECT_GT(kept, .05);
  }
}

namespace
{
struct PixelValues
{
  Vec3f Albedo, AlbedoDiffuse, AlbedoSpecular, Normal, NormalGeometric, Position;
  float Roughness = 0, Depth = 0, Id = 0, Material = 0, Alpha = 0, HitDistance = 0;
};
/// The pixel at the middle of a long lens.
PixelValues Probe(const SceneBuilder& b, int samples = 1, int bounces = 8)
{
  Settings s;
  s.Width = s.Height = 1;
  s.Samples = samples;
  s.Bounces = bounces;
  s.PixelJitter = Integrator::Jitter::None;
  const Shot shot = Shoot(b.Scene, s, AllArrays());
  const auto three = [&](const char* name)
  { return Vec3f(shot[name].Pixels[0], shot[name].Pixels[1], shot[name].Pixels[2]); };
  const auto one = [&](const char* name) { return shot[name].Pixels[0]; };
  PixelValues v;
  v.Albedo = three("albedo");
  v.AlbedoDiffuse = three("albedoDiffuse");
  v.AlbedoSpecular = three("albedoSpecular");
  v.Normal = three("normal");
  v.NormalGeometric = three("normalGeometric");
  v.Position = three("position");
  v.Roughness = one("roughness");
  v.Depth = one("depth");
  v.Id = one("id");
  v.Material = one("material");
  v.Alpha = one("alpha");
  v.HitDistance = one("hitDistance");
  return v;
}
void ExpectNear(const Vec3f& a, const Vec3f& b, float tolerance, const char* what)
{
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(a[i], b[i], tolerance) << what << " component " << i;
}
/// A wall at z = -5 that faces +z, of albedo .3 .6 .9, object 1.
SceneBuilder Wall()
{
  SceneBuilder b;
  Material m = SceneBuilder::Lambert(1);
  m.BaseColor = { .3f, .6f, .9f };
  m.Roughness = .8f;
  b.Quad(b.Add(m), { -50, -50, -5 }, { 100, 0, 0 }, { 0, 100, 0 });
  b.Sky(1);
  return b;
}
}

TEST(Guides, Background)
{
  SceneBuilder b = Wall();
  CameraModel c;
  // away from the wall
  c.WorldFromCamera.m[0][0] = c.WorldFromCamera.m[2][2] = -1;
  c.YFov = .001;
  b.Scene->Cameras.assign(1, c);
  const PixelValues v = Probe(b, 3);
  EXPECT_EQ(v.Albedo, Vec3f(1.f));
  EXPECT_EQ(v.AlbedoDiffuse, Vec3f(1.f));
  EXPECT_EQ(v.AlbedoSpecular, Vec3f());
  EXPECT_EQ(v.Normal, Vec3f());
  EXPECT_EQ(v.NormalGeometric, Vec3f());
  EXPECT_EQ(v.Position, Vec3f());
  EXPECT_EQ(v.Roughness, 0.f);
  EXPECT_EQ(v.Depth, Infinity);
  EXPECT_EQ(v.Id, 0.f);
  EXPECT_EQ(v.Material, 0.f);
  EXPECT_EQ(v.Alpha, 0.f);
  EXPECT_EQ(v.HitDistance, Infinity);
}

TEST(Guides, DiffuseWall)
{
  SceneBuilder b = Wall();
  b.Camera({ 0, 0, 1 }, .001);
  const PixelValues v = Probe(b);
  ExpectNear(v.Albedo, { .3f, .6f, .9f }, 1e-6f, "albedo");
  ExpectNear(v.AlbedoDiffuse, { .3f, .6f, .9f }, 1e-6f, "albedoDiffuse");
  EXPECT_EQ(v.AlbedoSpecular, Vec3f());
  ExpectNear(v.Normal, { 0, 0, 1 }, 1e-6f, "normal");
  EXPECT_NEAR(v.Roughness, .8f, 1e-6f);
  EXPECT_NEAR(v.Depth, 6, 1e-5);
  EXPECT_EQ(v.Id, 1.f);
  EXPECT_EQ(v.Material, 1.f);
  // from behind: the normals are on the viewer's side
  CameraModel c;
  c.WorldFromCamera.m[0][0] = c.WorldFromCamera.m[2][2] = -1;
  c.WorldFromCamera.m[2][3] = -9;
  c.YFov = .001;
  b.Scene->Cameras.assign(1, c);
  const PixelValues behind = Probe(b);
  ExpectNear(behind.Normal, { 0, 0, -1 }, 1e-6f, "normal");
  ExpectNear(behind.NormalGeometric, { 0, 0, -1 }, 1e-6f, "normalGeometric");
}

// Through mirrors and glass to the first surface that is neither; position, depth and ids stay at the first hit.
TEST(Guides, MirrorsAndGlass)
{
  SceneBuilder b = Wall();
  // two mirrors at 45 degrees: forward, up, forward again to the wall
  const int mirror = b.Add(SceneBuilder::Metal(.9f, 0));
  b.Quad(mirror, { -1, -1, -1 }, { 2, 0, 0 }, { 0, 2, -2 });
  b.Quad(mirror, { -1, 1, -1 }, { 2, 0, 0 }, { 0, 2, -2 });
  b.Camera({ 0, 0, 1 }, .001);
  const PixelValues v = Probe(b, 1);
  EXPECT_EQ(v.Id, 2.f);
  EXPECT_EQ(v.Material, 2.f);
  EXPECT_NEAR(v.Depth, 3, 1e-5);
  ExpectNear(v.NormalGeometric, { 0, std::sqrt(.5f), std::sqrt(.5f) }, 1e-6f, "normalGeometric");
  ExpectNear(v.Albedo, { .3f, .6f, .9f }, 1e-5f, "albedo");
  EXPECT_NEAR(v.Roughness, .8f, 1e-5f);
  EXPECT_NEAR(std::fabs(v.Normal.z), 1, 1e-5);
  // cut before the wall: of the last vertex seen
  const PixelValues cut = Probe(b, 1, 1);
  EXPECT_NEAR(cut.Roughness, 0, 1e-6);

  // a pane of glass before the wall
  SceneBuilder g = Wall();
  Material glass;
  glass.Metallic = 0;
  glass.Roughness = 0;
  glass.Transmission = 1;
  glass.Volume = true;
  g.Box(g.Add(glass), { -9, -9, -1 }, { 9, 9, -.5f });
  g.Camera({ 0, 0, 1 }, .001);
  const PixelValues w = Probe(g, 1024);
  EXPECT_EQ(w.Id, 2.f);
  EXPECT_NEAR(w.Depth, 1.5, 1e-5);
  // 4 % twice are reflected to the sky behind the camera (albedo 1), all inter-reflections .0769 together
  const float sky = .076923f;
  ExpectNear(w.Albedo, Vec3f(.3f, .6f, .9f) * (1 - sky) + Vec3f(sky), .02f, "albedo");
  ExpectNear(w.Normal, { 0, 0, 1 }, 1e-5f, "normal");

  // a sheet of alpha 1/4: a quarter of the samples stop at it
  SceneBuilder a = Wall();
  Material sheet = SceneBuilder::Lambert(.1f);
  sheet.Mode = AlphaMode::Blend;
  sheet.Alpha = .25f;
  // not through the line where its triangles meet: there both may stop a ray
  a.Quad(a.Add(sheet), { -9, -8, -1 }, { 18, 0, 0 }, { 0, 18, 0 });
  a.Camera({ 0, 0, 1 }, .001);
  const PixelValues s = Probe(a, 4096);
  ExpectNear(s.Albedo, Vec3f(.3f, .6f, .9f) * .75f + Vec3f(.025f), .02f, "albedo");
  EXPECT_NEAR(s.Depth, .25 * 2 + .75 * 6, .1);
  EXPECT_EQ(s.Alpha, 1.f);
}

TEST(Guides, HitDistance)
{
  // a floor 2 below a ceiling, seen straight on: 2 / cosine, mean over the cosine lobe = 2 * integral of 2 mu / mu = 4
  SceneBuilder b;
  const int m = b.Add(SceneBuilder::Lambert(.5f));
  b.Quad(m, { -5000, 0, 5000 }, { 10000, 0, 0 }, { 0, 0, -10000 });
  b.Quad(m, { -5000, 2, -5000 }, { 10000, 0, 0 }, { 0, 0, 10000 });
  b.Camera({ 0, 1, 0 }, .001, std::atan(1.) * 2);
  EXPECT_NEAR(Probe(b, 16384).HitDistance, 4, .15);
}

// Ids: each is an instance's, and its own material goes with it, at any time, seed and number of samples.
TEST(Features, IdsAreStable)
{
  const SceneBuilder b = Everything();
  Settings s;
  s.Width = 64;
  s.Height = 48;
  s.PixelJitter = Integrator::Jitter::None;
  // without the see-through sheet: what it hides is a matter of chance
  Scene still = *b.Scene;
  for (Material& m : still.Materials)
    m.Mode = AlphaMode::Opaque;
  const auto scene = std::make_shared<Scene>(still);
  s.Samples = 1;
  const Shot first = Shoot(scene, s, { "id", "material" });
  s.Samples = 3;
  s.Seed = 99;
  s.Time = 5;
  s.Previous = 4;
  const Shot later = Shoot(scene, s, { "id", "material", "radiance" });
  EXPECT_EQ(first["id"].Pixels, later["id"].Pixels);
  EXPECT_EQ(first["material"].Pixels, later["material"].Pixels);
  std::set<int> seen;
  for (std::size_t p = 0; p < first["id"].Pixels.size(); ++p)
  {
    const int id = int(first["id"].Pixels[p]);
    seen.insert(id);
    if (id == 0)
    {
      ASSERT_EQ(first["material"].Pixels[p], 0.f);
      continue;
    }
    ASSERT_LE(id, int(scene->Instances.size()));
    ASSERT_EQ(int(first["material"].Pixels[p]),
      scene->Meshes[std::size_t(scene->Instances[std::size_t(id) - 1].Mesh)].Material + 1);
  }
  EXPECT_GE(seen.size(), 7u);
}

// Position and depth lie on the pixel's own ray, by the matrices that go with the frame; far from the origin too.
TEST(Features, PositionsProjectToTheirPixels)
{
  for (double away : { 0., 1e6 })
    for (bool orthographic : { false, true })
    {
      SceneBuilder b = Everything();
      for (Node& n : b.Scene->Nodes)
        n.Translation = n.Translation + Vec3d(away, -away, 2 * away);
      CameraModel& c = b.Scene->Cameras[0];
      c.Orthographic = orthographic;
      c.YMag = 1.5;
      c.WorldFromCamera.m[0][3] += away;
      c.WorldFromCamera.m[1][3] -= away;
      c.WorldFromCamera.m[2][3] += 2 * away;
      Settings s;
      s.Width = 48;
      s.Height = 32;
      s.Samples = 1;
      s.PixelJitter = Integrator::Jitter::None;
      const Shot shot = Shoot(b.Scene, s, { "position", "depth", "alpha" });
      int hits = 0;
      double worst = 0, deep = 0;
      for (int y = 0; y < s.Height; ++y)
        for (int x = 0; x < s.Width; ++x)
        {
          if (shot["alpha"].At(x, y, 0) == 0)
            continue;
          ++hits;
          const Vec3d p(shot["position"].At(x, y, 0), shot["position"].At(x, y, 1), shot["position"].At(x, y, 2));
          const Mat4& m = shot.View.WorldToNdc();
          const Vec3d clip = m.Point(p);
          const double w = m.m[3][0] * p.x + m.m[3][1] * p.y + m.m[3][2] * p.z + m.m[3][3];
          worst = std::max({ worst, std::fabs((clip.x / w + 1) / 2 * s.Width - x - .5),
            std::fabs((clip.y / w + 1) / 2 * s.Height - y - .5) });
          const double z = -shot.View.WorldToCamera().Point(p).z;
          deep = std::max(deep, std::fabs(z - shot["depth"].At(x, y, 0)) / z);
        }
      EXPECT_GT(hits, 300);
      EXPECT_LT(worst, 1e-3) << "pixels, " << away << (orthographic ? " orthographic" : "");
      EXPECT_LT(deep, 1e-5);
    }
}

namespace
{
/// What moves, with where each of its points was before as a function of where it is now.
struct Mover
{
  std::string Name;
  std::shared_ptr<Scene> World;
  std::function<Vec3d(const Vec3d&)> Before; ///< absolute positions
};
constexpr double Now = 1, Then = .5;

void Animate(Scene& scene, int node, AnimatedPath path, std::vector<float> from, const std::vector<float>& to)
{
  AnimationChannel c;
  c.Node = node;
  c.Path = path;
  c.Times = { 0, 2 };
  c.Values = std::move(from);
  c.Values.insert(c.Values.end(), to.begin(), to.end());
  scene.Animation.push_back(c);
}
/// A fine grid in the plane z = 0, 2 x 2.
std::vector<Vec3f> GridPoints(int n)
{
  std::vector<Vec3f> p;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j)
      p.push_back({ 2 * float(j) / float(n) - 1, 2 * float(i) / float(n) - 1, 0 });
  return p;
}
std::vector<std::uint32_t> GridTriangles(int n)
{
  std::vector<std::uint32_t> t;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
    {
      const std::uint32_t a = std::uint32_t(i * (n + 1) + j), c = a + std::uint32_t(n) + 1;
      t.insert(t.end(), { a, a + 1, c, a + 1, c + 1, c });
    }
  return t;
}

std::vector<Mover> Movers()
{
  std::vector<Mover> all;
  const auto start = []()
  {
    SceneBuilder b;
    b.Quad(b.Add(SceneBuilder::Lambert(.5f)), { -9, -9, -2 }, { 18, 0, 0 }, { 0, 18, 0 });
    b.Sky(1);
    b.Camera({ 0, 0, 4 }, .8);
    return b;
  };
  const auto still = [](const Vec3d& p) { return p; };
  {
    SceneBuilder b = start();
    b.AddMesh(0, GridPoints(4), GridTriangles(4));
    Node node;
    b.Scene->Nodes.push_back(node);
    const int camera = int(b.Scene->Nodes.size()) - 1;
    b.Scene->Cameras[0].Node = camera;
    Animate(*b.Scene, camera, AnimatedPath::Translation, { 0, 0, 4 }, { .4f, -.2f, 3.2f });
    Animate(*b.Scene, camera, AnimatedPath::Rotation, { 0, 0, 0, 1 }, { 0, std::sin(.1f), 0, std::cos(.1f) });
    all.push_back({ "camera", b.Scene, still });
  }
  {
    SceneBuilder b = start();
    b.AddMesh(0, GridPoints(4), GridTriangles(4));
    Animate(*b.Scene, 1, AnimatedPath::Translation, { 0, 0, 0 }, { .3f, .2f, -.4f });
    Animate(*b.Scene, 1, AnimatedPath::Rotation, { 0, 0, 0, 1 }, { 0, 0, std::sin(.4f), std::cos(.4f) });
    std::shared_ptr<Scene> scene = b.Scene;
    all.push_back({ "rigid", scene,
      [scene](const Vec3d& p)
      {
        if (p.z < -1.9)
          return p;
        // rotation about z by angle(t) = .8 t / 2 (slerp), translation linear
        const auto angle = [](double t) { return .8 * t / 2; };
        const auto shift = [](double t) { return Vec3d(.15, .1, -.2) * t; };
        const Vec3d q = p - shift(Now);
        const double a = angle(Then) - angle(Now), c = std::cos(a), s = std::sin(a);
        return Vec3d(c * q.x - s * q.y, s * q.x + c * q.y, q.z) + shift(Then);
      } });
  }
  {
    // morphed: y grows by the weight times x / 2
    SceneBuilder b = start();
    Mesh& mesh = b.AddMesh(0, GridPoints(8), GridTriangles(8));
    MorphTarget target;
    for (const Vec3f& p : mesh.Positions)
      target.Positions.push_back({ 0, p.x / 2, 0 });
    mesh.Targets.push_back(target);
    b.Scene->Nodes[1].Weights = { 0 };
    Animate(*b.Scene, 1, AnimatedPath::Weights, { 0 }, { 2 });
    all.push_back(
      { "morphed", b.Scene, [](const Vec3d& p) { return p.z < -1.9 ? p : p + Vec3d(0, (Then - Now) * p.x / 2, 0); } });
  }
  {
    // skinned: the second joint goes up; weights linear in x, so y rises by t (x + 1) / 4
    SceneBuilder b = start();
    Mesh& mesh = b.AddMesh(0, GridPoints(8), GridTriangles(8));
    mesh.Influences = 4;
    for (const Vec3f& p : mesh.Positions)
    {
      const float w = (p.x + 1) / 2;
      mesh.Joints.insert(mesh.Joints.end(), { 0, 1, 0, 0 });
      mesh.JointWeights.insert(mesh.JointWeights.end(), { 1 - w, w, 0, 0 });
    }
    Skin skin;
    for (int j = 0; j < 2; ++j)
    {
      skin.Joints.push_back(int(b.Scene->Nodes.size()));
      b.Scene->Nodes.push_back(Node());
      skin.InverseBind.push_back(Mat4());
    }
    b.Scene->Skins.push_back(skin);
    b.Scene->Nodes[1].Skin = 0;
    Animate(*b.Scene, skin.Joints[1], AnimatedPath::Translation, { 0, 0, 0 }, { 0, 1, 0 });
    all.push_back({ "skinned", b.Scene,
      [](const Vec3d& p) { return p.z < -1.9 ? p : p + Vec3d(0, (Then - Now) / 2 * (p.x + 1) / 2, 0); } });
  }
  return all;
}
}

// motion = where the material point was on the previous frame's screen minus the pixel: against the motion that the
// scene was built with, and against the previous frame's own position AOV, read at x + motion.
TEST(Features, MotionMeetsThePreviousFrame)
{
  for (const Mover& mover : Movers())
  {
    Settings s;
    s.Width = 96;
    s.Height = 80;
    s.Samples = 1;
    s.PixelJitter = Integrator::Jitter::None;
    s.Time = Now;
    s.Previous = Then;
    const Shot now = Shoot(mover.World, s, { "motion", "position", "id" });
    s.Time = s.Previous = Then;
    const Shot then = Shoot(mover.World, s, { "position", "id" });
    const auto position = [](const Shot& shot, int x, int y)
    {
      return Vec3d(shot["position"].At(x, y, 0), shot["position"].At(x, y, 1), shot["position"].At(x, y, 2)) +
             shot.Origin;
    };

    double worst = 0, largest = 0, worstRead = 0;
    int read = 0, moving = 0;
    for (int y = 0; y < s.Height; ++y)
      for (int x = 0; x < s.Width; ++x)
      {
        const int id = int(now["id"].At(x, y, 0));
        ASSERT_GT(id, 0);
        const Vec3d before = mover.Before(position(now, x, y));
        const double mx = now["motion"].At(x, y, 0), my = now["motion"].At(x, y, 1);
        Vec2<double> pixel;
        ASSERT_TRUE(then.View.Project(before - then.Origin, 1, pixel));
        worst = std::max({ worst, std::fabs(pixel.x - (x + .5) - mx), std::fabs(pixel.y - (y + .5) - my) });
        largest = std::max(largest, std::hypot(mx, my));
        moving += mx != 0 || my != 0;
        // and through the matrix that the frame's facts carry
        const Mat4& m = then.View.WorldToNdc();
        const Vec3d p = before - then.Origin, clip = m.Point(p);
        const double w = m.m[3][0] * p.x + m.m[3][1] * p.y + m.m[3][2] * p.z + m.m[3][3];
        worst = std::max({ worst, std::fabs((clip.x / w + 1) / 2 * s.Width - (x + .5) - mx),
          std::fabs((clip.y / w + 1) / 2 * s.Height - (y + .5) - my) });

        // the previous frame's positions at x + motion, between four pixels of the same flat object
        const double fx = x + mx, fy = y + my;
        const int x0 = int(std::floor(fx)), y0 = int(std::floor(fy));
        if (x0 < 0 || y0 < 0 || x0 + 1 >= s.Width || y0 + 1 >= s.Height)
          continue;
        bool same = true;
        Vec3d there;
        for (int k = 0; k < 4; ++k)
        {
          const int px = x0 + k % 2, py = y0 + k / 2;
          same &= int(then["id"].At(px, py, 0)) == id;
          there += position(then, px, py) * ((k % 2 ? fx - x0 : 1 - fx + x0) * (k / 2 ? fy - y0 : 1 - fy + y0));
        }
        if (!same)
          continue;
        ++read;
        worstRead = std::max(worstRead, Length(there - before));
      }
    std::printf("  %s: motion off by at most %.2g pixels (largest %.1f), position read there by %.2g\n",
      mover.Name.c_str(), worst, largest, worstRead);
    EXPECT_LT(worst, 2e-3) << mover.Name;
    EXPECT_GT(largest, 2.) << mover.Name;
    EXPECT_GT(moving, 500) << mover.Name;
    EXPECT_GT(read, 2500) << mover.Name;
    // a pixel is .04 to .07 wide there; perspective is not linear between pixels by far less than that
    EXPECT_LT(worstRead, 2e-3) << mover.Name;
  }
}

// What keeps still has exactly no motion; the sky moves with the camera's turn alone.
TEST(Features, MotionOfStillThingsAndTheSky)
{
  Settings s;
  s.Samples = 2;
  s.Time = Now;
  s.Previous = Then;
  const Shot still = Shoot(Everything().Scene, s, { "motion" });
  for (float v : still["motion"].Pixels)
    ASSERT_EQ(v, 0.f);

  SceneBuilder b;
  b.Sky(1);
  b.Camera({ 0, 0, 0 }, .8);
  b.Scene->Nodes.push_back(Node());
  b.Scene->Cameras[0].Node = 0;
  Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 0, 0 }, { 7, 8, 9 });
  s.PixelJitter = Integrator::Jitter::None;
  s.Width = s.Height = 33;
  const Shot moved = Shoot(b.Scene, s, { "motion" });
  for (float v : moved["motion"].Pixels)
    ASSERT_NEAR(v, 0.f, 1e-4);
  Animate(*b.Scene, 0, AnimatedPath::Rotation, { 0, 0, 0, 1 }, { 0, std::sin(.1f), 0, std::cos(.1f) });
  const Shot turned = Shoot(b.Scene, s, { "motion" });
  // the centre: turned by .1 rad per second to the left since then, so it was left of here... by tan(.05) of the lens
  EXPECT_NEAR(turned["motion"].At(16, 16, 0), -std::tan(.05) / std::tan(.4) * 33 / 2, 1e-2);
  EXPECT_NEAR(turned["motion"].At(16, 16, 1), 0, 1e-3);
}

namespace
{
/// All arrays of a film that was rendered in pieces.
std::vector<float> Pieces(const std::shared_ptr<const Scene>& scene, int tileWidth, int tileHeight,
  const std::vector<int>& passes, const Rect& region, bool backwards = false, double visit = -1)
{
  EmbreeScene built(scene);
  if (visit >= 0)
  {
    built.SetTime(visit, visit - 1);
    built.SetTime(visit / 3, visit / 2);
  }
  built.SetTime(.7, .3);
  Integrator i;
  i.Scene = &built;
  i.View = trust::CameraOf(built, 0, 32, 24, false);
  i.PreviousView = trust::CameraOf(built, 0, 32, 24, true);
  i.MaximumBounces = 5;
  i.RouletteStart = 2;
  i.Seed = 3;
  int samples = 0;
  for (int n : passes)
    samples += n;
  i.SamplesPerPixel = samples;
  Film film(region, AllArrays());
  TraceCounters counters;
  std::vector<Rect> tiles;
  for (int y = region.y0; y < region.y1; y += tileHeight)
    for (int x = region.x0; x < region.x1; x += tileWidth)
      tiles.push_back({ x, y, std::min(x + tileWidth, region.x1), std::min(y + tileHeight, region.y1) });
  if (backwards)
    std::reverse(tiles.begin(), tiles.end());
  int first = 0;
  for (int n : passes)
  {
    for (const Rect& tile : tiles)
      i.Render(film, tile, first, n, counters);
    first += n;
  }
  std::vector<float> out;
  const Rect window{ 5, 3, 20, 19 };
  for (const std::string& name : AllArrays())
  {
    std::vector<float> p(std::size_t(trust::Components(name)) * std::size_t(window.area()));
    film.Develop(name, window, samples, ImageOut(p.data(), trust::Components(name), window));
    out.insert(out.end(), p.begin(), p.end());
  }
  return out;
}
bool SameBits(const std::vector<float>& a, const std::vector<float>& b)
{
  return a.size() == b.size() && !a.empty() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}
std::shared_ptr<Scene> MovingEverything()
{
  SceneBuilder b = Everything();
  Animate(*b.Scene, 3, AnimatedPath::Translation, { 0, 0, 0 }, { .5f, .1f, .2f });
  Animate(*b.Scene, 2, AnimatedPath::Rotation, { 0, 0, 0, 1 }, { 0, 0, std::sin(.2f), std::cos(.2f) });
  Mesh& mesh = b.AddMesh(0, GridPoints(4), GridTriangles(4));
  MorphTarget target;
  for (const Vec3f& p : mesh.Positions)
    target.Positions.push_back({ p.y / 3, p.x / 2, .2f });
  mesh.Targets.push_back(target);
  b.Scene->Nodes.back().Scale = { .3, .3, .3 };
  b.Scene->Nodes.back().Translation = { 0, 1.2, .3 };
  Animate(*b.Scene, int(b.Scene->Nodes.size()) - 1, AnimatedPath::Weights, { 0 }, { 1 });
  return b.Scene;
}
}

TEST(SameBits, TilesRegionsAndPasses)
{
  const std::shared_ptr<const Scene> scene = MovingEverything();
  const Rect all{ 0, 0, 32, 24 };
  const std::vector<float> whole = Pieces(scene, 32, 24, { 8 }, all);
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 1, 1, { 8 }, all))) << "pixel by pixel";
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 7, 5, { 8 }, all, true))) << "7 x 5 tiles, the last one first";
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 32, 1, { 8 }, all))) << "rows";
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 32, 24, { 8 }, { 5, 3, 20, 19 }))) << "a region";
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 32, 24, { 8 }, { 4, 0, 21, 24 }))) << "another region";
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 32, 24, { 1, 1, 1, 1, 1, 1, 1, 1 }, all))) << "passes of one sample";
  EXPECT_TRUE(SameBits(whole, Pieces(scene, 16, 3, { 3, 1, 4 }, all))) << "passes of 3, 1, 4 samples";
}

// A pose is a function of the time, not of the poses before it.
TEST(SameBits, Poses)
{
  const std::shared_ptr<const Scene> scene = MovingEverything();
  const Rect all{ 0, 0, 32, 24 };
  EXPECT_TRUE(SameBits(Pieces(scene, 32, 24, { 4 }, all), Pieces(scene, 32, 24, { 4 }, all, false, 2)));
}

TEST(SameBits, InstructionSets)
{
  const std::shared_ptr<const Scene> scene = MovingEverything();
  const Rect all{ 0, 0, 32, 24 };
  const std::vector<float> best = Pieces(scene, 32, 24, { 4 }, all);
  int targets = 0;
  for (const SimdTarget& t : SimdTargets())
  {
    ForceSimdTarget(t.Id);
    EXPECT_TRUE(SameBits(best, Pieces(scene, 32, 24, { 4 }, all))) << t.Name;
    ++targets;
  }
  ForceSimdTarget(0);
  EXPECT_GT(targets, 0);
}

// The lean variants of the integrator and the general one make the same picture, where the lean ones are allowed.
TEST(SameBits, Variants)
{
  using Variant = Integrator::Variant;
  const auto check =
    [](const std::shared_ptr<const Scene>& scene, const std::vector<Variant>& variants, const char* name)
  {
    Settings s;
    s.Samples = 5;
    s.Bounces = 5;
    s.Roulette = 2;
    s.Force = Variant::General;
    const Shot general = Shoot(scene, s, AllArrays());
    for (Variant v : variants)
    {
      s.Force = v;
      const Shot lean = Shoot(scene, s, AllArrays());
      EXPECT_EQ(lean.Counters.Rays, general.Counters.Rays) << name << " variant " << int(v);
      for (const std::string& array : AllArrays())
        EXPECT_TRUE(SameBits(lean[array].Pixels, general[array].Pixels))
          << name << " variant " << int(v) << ' ' << array;
    }
  };
  check(DiffuseOnly().Scene, { Variant::Auto, Variant::Diffuse, Variant::Opaque }, "diffuse");
  SceneBuilder sky = DiffuseOnly();
  sky.Sky(.5f);
  check(sky.Scene, { Variant::Auto, Variant::Diffuse, Variant::Opaque }, "diffuse under a sky");
  check(MetalOnly().Scene, { Variant::Auto, Variant::Opaque }, "metal");
  check(Everything().Scene, { Variant::Auto }, "everything");
}

// Other sample patterns, the same mean; independent samples have exactly the variance that they claim.
TEST(PixelStatistics, Patterns)
{
  const SceneBuilder b = MetalOnly();
  Settings s;
  s.Samples = 64;
  s.Bounces = 3;
  std::vector<Shot> shots;
  for (SamplePattern p : { SamplePattern::Sobol, SamplePattern::BlueNoise, SamplePattern::Random })
  {
    s.Pattern = p;
    s.Seed = std::uint64_t(10 + int(p));
    shots.push_back(Shoot(b.Scene, s, { "radiance", "moments", "variance" }));
  }
  for (int k = 0; k < 3; ++k)
  {
    const statistics::BlockTest t =
      statistics::BySpread(shots[std::size_t(k)]["radiance"], shots[std::size_t((k + 1) % 3)]["radiance"]);
    EXPECT_TRUE(t.Agrees()) << k << ": " << t.Text();
    EXPECT_LT(t.Whole, statistics::NormalThreshold(statistics::SidakLevel(.001, 3))) << k << ": " << t.Text();
  }

  // Sum over seeds and pixels of (mean - true mean)^2 / variance; pixels of the floor, whose noise is not too skewed.
  s.Pattern = SamplePattern::Random;
  s.Width = s.Height = 10;
  s.Samples = 16;
  const int seeds = trust::LongTests() ? 4000 : 300;
  std::vector<double> mean(100, 0.), square(100, 0.), claim(100, 0.);
  for (int k = 0; k < seeds; ++k)
  {
    s.Seed = std::uint64_t(5000 + k);
    const Shot shot = Shoot(b.Scene, s, { "moments", "variance" });
    for (std::size_t p = 0; p < 100; ++p)
    {
      const double m = double(shot["moments"].Pixels[2 * p]);
      mean[p] += m;
      square[p] += m * m;
      claim[p] += double(shot["variance"].Pixels[p]);
    }
  }
  double spread = 0, claimed = 0, worst = 0;
  for (std::size_t p = 0; p < 100; ++p)
  {
    const double v = (square[p] - mean[p] * mean[p] / seeds) / (seeds - 1);
    spread += v;
    claimed += claim[p] / seeds;
    // a pixel's own chi-squared, its noise about normal
    if (claim[p] > 0)
      worst = std::max(worst, std::fabs(v / (claim[p] / seeds) - 1));
  }
  std::printf(
    "  independent samples: spread of the means / variance %.4f, worst pixel off by %.2f\n", spread / claimed, worst);
  EXPECT_NEAR(spread / claimed, 1, .06);
  EXPECT_LT(worst, .6);
}

// As many threads as said, also where the pool has fewer: each takes the next tile.
TEST(SameBits, OwnThreads)
{
  const std::shared_ptr<const Scene> scene = MovingEverything();
  EmbreeScene built(scene);
  built.SetTime(.7, .3);
  Integrator i;
  i.Scene = &built;
  i.View = trust::CameraOf(built, 0, 40, 32, false);
  i.PreviousView = trust::CameraOf(built, 0, 40, 32, true);
  i.MaximumBounces = 5;
  i.SamplesPerPixel = 4;
  std::vector<double> first;
  for (int threads : { 1, 2, 3, 7 })
  {
    Film film({ 0, 0, 40, 32 }, AllArrays());
    std::atomic<int> next{ 0 };
    const auto work = [&]()
    {
      TraceCounters counters;
      for (int t = next++; t < 80; t = next++)
      {
        const int x = t % 10 * 4, y = t / 10 * 4;
        i.Render(film, { x, y, x + 4, y + 4 }, 0, 4, counters);
      }
    };
    std::vector<std::thread> pool;
    for (int t = 1; t < threads; ++t)
      pool.emplace_back(work);
    work();
    for (std::thread& t : pool)
      t.join();
    if (threads == 1)
      first = film.Data();
    ASSERT_FALSE(first.empty());
    EXPECT_EQ(std::memcmp(first.data(), film.Data().data(), first.size() * sizeof(double)), 0) << threads;
  }
}

// Nobody can say which of several surfaces in one plane is in front; but it is one of them, and always the same one.
TEST(SameBits, SurfacesInOnePlane)
{
  std::vector<float> first;
  for (int threads : { 1, 2, 3, 7 })
  {
    SceneBuilder b; // built anew each time
    b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -1, -1, 0 }, { 2, 0, 0 }, { 0, 2, 0 });
    b.Quad(b.Add(SceneBuilder::Lambert(0, 2)), { -.5f, -.8f, 0 }, { 1.7f, 0, 0 }, { 0, 1.3f, 0 });
    b.Quad(b.Add(SceneBuilder::Lambert(0, 3)), { 0, -.9f, 0 }, { .8f, .7f, 0 }, { -.7f, .8f, 0 });
    b.Camera({ 0, 0, 3 }, .8);
    std::vector<float> out;
    quelltest::WithThreads(threads,
      [&]()
      {
        vtkNew<vtkQuellPathTraceSource> s;
        s->SetScene(b.Scene);
        s->SetWidth(50);
        s->SetHeight(41);
        s->SetAlwaysMake({ "radiance", "id" });
        s->Update();
        for (const char* name : { "radiance", "id" })
          if (auto a = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray(name)))
            out.insert(out.end(), a->GetPointer(0), a->GetPointer(0) + a->GetNumberOfValues());
      });
    ASSERT_EQ(out.size(), std::size_t(50 * 41 * 4));
    const float* id = &out[std::size_t(50 * 41 * 3)];
    EXPECT_GT(std::count_if(id, id + 50 * 41, [](float v) { return v > 0; }), 50 * 41 / 3);
    for (std::size_t i = 0; i < 50 * 41; ++i)
      ASSERT_EQ(out[3 * i], id[i]) << "light of one surface and the id of another";
    if (first.empty())
      first = out;
    EXPECT_TRUE(SameBits(first, out)) << threads;
  }
}

TEST(SameBits, Threads)
{
  const std::shared_ptr<const Scene> scene = MovingEverything();
  std::vector<float> first;
  for (int threads : { 1, 2, 3, 7 })
  {
    std::vector<float> out;
    quelltest::WithThreads(threads,
      [&]()
      {
        vtkNew<vtkQuellPathTraceSource> s;
        s->SetScene(scene);
        s->SetWidth(50);
        s->SetHeight(41);
        s->SetSamplesPerPixel(3);
        s->SetMaximumBounces(4);
        s->SetAlwaysMake({ "radiance", "variance", "albedo", "normal", "motion", "halfB", "position" });
        s->Update();
        EXPECT_EQ(s->GetErrorText(), "");
        for (const char* name : { "radiance", "variance", "albedo", "normal", "motion", "halfB", "position" })
          if (auto a = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray(name)))
            out.insert(out.end(), a->GetPointer(0), a->GetPointer(0) + a->GetNumberOfValues());
      });
    if (threads == 1)
      first = out;
    EXPECT_EQ(out.size(), std::size_t(50 * 41 * (3 + 1 + 3 + 3 + 2 + 3 + 3)));
    EXPECT_TRUE(SameBits(first, out)) << threads;
  }
}

// Another seed, tick or sample gives other noise; the same ones the same.
TEST(SameBits, OnlyWithTheSameSeed)
{
  Settings s;
  s.Samples = 2;
  const Shot a = Shoot(Everything().Scene, s, { "radiance" }), b = Shoot(Everything().Scene, s, { "radiance" });
  s.Seed = 2;
  const Shot c = Shoot(Everything().Scene, s, { "radiance" });
  EXPECT_TRUE(SameBits(a["radiance"].Pixels, b["radiance"].Pixels));
  EXPECT_FALSE(SameBits(a["radiance"].Pixels, c["radiance"].Pixels));
}
