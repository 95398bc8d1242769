// SPDX-License-Identifier: BSD-3-Clause
// Scenes whose radiance is known in closed form.
#include "SceneBuilder.h"
#include "quellIntegrator.h"
#include "quellSimd.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <memory>

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
  i.MaximumBounces = bounces;
  i.RouletteStart = roulette;
  i.Sampling = strategy;
  i.Seed = seed;
  i.SamplesPerPixel = samples;
  i.PixelJitter = Integrator::Jitter::None;
  Film film({ 0, 0, 1, 1 }, { "moments" });
  Estimate e;
  i.Render(film, film.Region(), 0, samples, e.Counters);
  float moments[2];
  film.Develop("moments", film.Region(), samples, ImageOut(moments, 2, film.Region()));
  e.Mean = double(moments[0]);
  e.Error = std::sqrt(double(moments[1]) / (samples - 1.));
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

TEST(Integrator, PathsThatCarryNothingEnd)
{
  const int samples = 256;
  // Of a black wall nothing comes back, with or without roulette; of 1e-30 nothing that roulette would let live.
  for (const int roulette : { 1, 1000 })
  {
    const Estimate black = Render(Furnace(0), 1000, samples, Integrator::Strategy::Mis, roulette);
    EXPECT_EQ(black.Mean, 1);
    EXPECT_LE(black.Counters.Rays, 3 * samples);
  }
  const Estimate faint = Render(Furnace(1e-30f), 1000, samples, Integrator::Strategy::Mis, 1);
  EXPECT_EQ(faint.Mean, 1);
  EXPECT_LE(faint.Counters.Rays, 5 * samples);
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

namespace
{
/// A room with a lamp, a block, a ball with interpolated normals, a map of bumps and colours, coloured vertices, and a
/// sign that is unlit. Diffuse unless `glossy`; `layered`: some glass, a coat and a half-transparent sheet as well.
SceneBuilder Room(bool glossy, bool layered = false, bool sky = false)
{
  SceneBuilder b;
  Texture colours, bumps;
  colours.Width = colours.Height = bumps.Width = bumps.Height = 8;
  colours.SRGB = true;
  for (int i = 0; i < 64; ++i)
  {
    const auto c = std::uint8_t(60 + 3 * i);
    for (std::uint8_t v : { c, std::uint8_t(255 - c), std::uint8_t(200), std::uint8_t(255) })
      colours.Bytes.push_back(v);
    for (int v : { 100 + 7 * (i % 8), 150 - 5 * (i / 8), 230, 255 })
      bumps.Bytes.push_back(std::uint8_t(v));
  }
  b.Scene->Textures = { colours, bumps };
  const auto material = [&](float grey)
  {
    Material m = SceneBuilder::Lambert(grey);
    if (glossy)
    {
      m.Specular = 1;
      m.Roughness = .4f;
    }
    return m;
  };
  const int wall = b.Add(material(.7f)), ball = b.Add(material(.5f));
  Material mapped = material(.8f);
  mapped.BaseColorTexture.Texture = 0;
  mapped.NormalTexture.Texture = 1;
  mapped.NormalScale = 2;
  if (glossy)
    mapped.Metallic = .6f;
  const int bumpy = b.Add(mapped), lamp = b.Add(SceneBuilder::Lambert(0, 6));
  Material sign = SceneBuilder::Lambert(.3f);
  sign.Unlit = true;
  b.Quad(b.Add(sign), { -.9f, 1.2f, -.95f }, { .4f, 0, 0 }, { 0, .4f, 0 });
  b.Quad(bumpy, { -1, 0, 1 }, { 2, 0, 0 }, { 0, 0, -2 });
  b.Scene->Meshes.back().TexCoords[0] = { { 0, 0 }, { 3, 0 }, { 3, 3 }, { 0, 3 } };
  b.Quad(wall, { -1, 0, -1 }, { 2, 0, 0 }, { 0, 2, 0 });
  b.Quad(wall, { -1, 0, 1 }, { 0, 0, -2 }, { 0, 2, 0 });
  b.Scene->Meshes.back().Colors = { { 1, .2f, .2f, 1 }, { 1, .4f, .2f, 1 }, { .5f, .2f, .2f, 1 }, { 1, .2f, .9f, 1 } };
  if (!sky)
    b.Quad(wall, { -1, 2, -1 }, { 2, 0, 0 }, { 0, 0, 2 });
  b.Sphere(ball, { .3f, .5f, 0 }, .4f, 8);
  b.Box(wall, { -.7f, 0, -.5f }, { -.2f, .7f, 0 });
  b.Quad(lamp, { -.3f, 1.9f, -.3f }, { .6f, 0, 0 }, { 0, 0, .6f });
  if (sky)
    b.Sky(.5f);
  if (glossy)
    b.Quad(b.Add(SceneBuilder::Metal(.9f, 0)), { .9f, .1f, .9f }, { 0, 0, -1.8f }, { 0, 1, 0 });
  if (layered)
  {
    Material glass = material(.9f);
    glass.Transmission = 1;
    glass.Volume = true;
    glass.Roughness = .1f;
    glass.AttenuationColor = { .3f, .8f, .5f };
    glass.AttenuationDistance = .5f;
    b.Sphere(b.Add(glass), { -.3f, .3f, .5f }, .25f, 8);
    Material sheet = material(.5f);
    sheet.Mode = AlphaMode::Blend;
    sheet.Alpha = .5f;
    sheet.Clearcoat = 1;
    b.Quad(b.Add(sheet), { .2f, 0, .7f }, { .6f, 0, 0 }, { 0, .8f, 0 });
  }
  b.Camera({ 0, 1, 3.2 }, .8);
  return b;
}

const std::set<std::string> Everything{ "radiance", "emission", "direct", "indirect", "directDiffuse", "directSpecular",
  "indirectDiffuse", "indirectSpecular", "bounce1", "bounce2", "bounce3", "bounce4", "halfA", "halfB", "variance",
  "albedo", "albedoDiffuse", "albedoSpecular", "normal", "roughness", "varianceAlbedo", "varianceNormal", "depth",
  "position", "normalGeometric", "motion", "id", "material", "alpha", "hitDistance" };

struct Picture
{
  std::map<std::string, std::vector<float>> Arrays;
  TraceCounters Counters;
};
int Components(const std::string& array)
{
  for (const char* one :
    { "variance", "roughness", "varianceAlbedo", "varianceNormal", "depth", "id", "material", "alpha", "hitDistance" })
    if (array == one)
      return 1;
  return array == "motion" ? 2 : 3;
}

struct Shot
{
  std::shared_ptr<EmbreeScene> Scene;
  Integrator Tracer;
  int Width = 37, Height = 23, Samples = 5;
  std::set<std::string> Wanted = Everything;
};
Shot Prepared(const SceneBuilder& b)
{
  Shot s;
  s.Scene = std::make_shared<EmbreeScene>(b.Scene);
  s.Scene->SetTime(0, 0);
  s.Tracer.Scene = s.Scene.get();
  const CameraModel& c = b.Scene->Cameras.front();
  s.Tracer.View = s.Tracer.PreviousView = Camera(c, c.WorldFromCamera, s.Scene->Origin(), s.Width, s.Height);
  s.Tracer.MaximumBounces = 5;
  s.Tracer.RouletteStart = 2;
  s.Tracer.SamplesPerPixel = s.Samples;
  s.Tracer.Seed = 7;
  return s;
}
/// Traces in parts of the frame of `tile` x `tile` pixels, in passes of so many samples.
Picture Traced(const Shot& s, int tile = 64, std::vector<int> passes = {})
{
  if (passes.empty())
    passes = { s.Samples };
  Picture p;
  const Rect whole{ 0, 0, s.Width, s.Height };
  Film film(whole, s.Wanted);
  int first = 0;
  for (int count : passes)
  {
    for (int y = 0; y < s.Height; y += tile)
      for (int x = 0; x < s.Width; x += tile)
        s.Tracer.Render(
          film, { x, y, std::min(x + tile, s.Width), std::min(y + tile, s.Height) }, first, count, p.Counters);
    first += count;
  }
  for (const std::string& a : s.Wanted)
  {
    std::vector<float>& v = p.Arrays[a];
    v.resize(std::size_t(whole.area()) * std::size_t(Components(a)));
    film.Develop(a, whole, s.Samples, ImageOut(v.data(), Components(a), whole), s.Tracer.GuideSamples);
  }
  return p;
}
void ExpectSameBits(const Picture& a, const Picture& b, const std::string& what)
{
  for (const auto& entry : a.Arrays)
  {
    const std::vector<float>& other = b.Arrays.at(entry.first);
    ASSERT_EQ(entry.second.size(), other.size());
    std::size_t different = 0;
    for (std::size_t i = 0; i < other.size(); ++i)
      different += std::memcmp(&entry.second[i], &other[i], sizeof(float)) != 0;
    EXPECT_EQ(different, 0u) << what << ": " << entry.first << " of " << other.size();
  }
  EXPECT_EQ(a.Counters.Rays, b.Counters.Rays) << what;
}
}

TEST(Integrator, ChoosesTheLeanestVariant)
{
  using Variant = Integrator::Variant;
  EXPECT_EQ(Prepared(Room(false)).Tracer.Chosen(), Variant::Diffuse);
  EXPECT_EQ(Prepared(Room(true)).Tracer.Chosen(), Variant::Opaque);
  EXPECT_EQ(Prepared(Room(true, true)).Tracer.Chosen(), Variant::General);
  // a coat on what is Lambert's otherwise, or alpha
  SceneBuilder b = Room(false);
  b.Scene->Materials[0].Clearcoat = .5f;
  EXPECT_EQ(Prepared(b).Tracer.Chosen(), Variant::General);
  b = Room(false);
  b.Scene->Materials[0].Mode = AlphaMode::Mask;
  EXPECT_EQ(Prepared(b).Tracer.Chosen(), Variant::General);
  const auto says = [](const Shot& s, const Film& film)
  {
    std::string all;
    for (const std::string& line : s.Tracer.ExplainVariant(film))
      all += line + "\n";
    return all;
  };
  const Film film({ 0, 0, 1, 1 }, { "radiance" }), primary({ 0, 0, 1, 1 }, { "depth" });
  EXPECT_NE(says(Prepared(Room(false)), film).find("diffuse"), std::string::npos);
  EXPECT_NE(says(Prepared(b), film).find("see-through"), std::string::npos);
  EXPECT_NE(says(Prepared(b), primary).find("primary"), std::string::npos);
}

TEST(Integrator, TexturesMayMakeGlassOfMetal)
{
  // metallicFactor is 1 in most files: the texture's blue alone says that this is glass, here half of it
  SceneBuilder b;
  Material m;
  m.Transmission = 1;
  m.MetallicRoughnessTexture.Texture = 0;
  Texture t;
  t.Width = t.Height = 1;
  t.Bytes = { 255, 0, 0, 255 };
  b.Scene->Textures.push_back(t);
  b.Quad(b.Add(m), { -9, -9, 0 }, { 18, 0, 0 }, { 0, 18, 0 });
  b.Scene->Meshes.back().TexCoords[0] = { { 0, 0 }, { 1, 0 }, { 1, 1 }, { 0, 1 } };
  b.Quad(b.Add(SceneBuilder::Lambert(0, 1)), { -9, -9, -1 }, { 18, 0, 0 }, { 0, 18, 0 });
  b.Camera({ 0, 0, 1 }, .001);
  const Shot s = Prepared(b);
  EXPECT_EQ(s.Tracer.Chosen(), Integrator::Variant::General);
  EXPECT_TRUE(s.Scene->Has.Glass);
  const Estimate e = Render(b, 2, 4096);
  EXPECT_NEAR(e.Mean, .96, 4 * e.Error + 1e-4);
}

TEST(Integrator, VariantsAgreeBitForBit)
{
  for (bool sky : { false, true })
    for (auto strategy : { Integrator::Strategy::Mis, Integrator::Strategy::LightOnly, Integrator::Strategy::BsdfOnly })
    {
      Shot s = Prepared(Room(false, false, sky));
      s.Tracer.Sampling = strategy;
      const Picture lean = Traced(s);
      s.Tracer.Force = Integrator::Variant::Opaque;
      const Picture middle = Traced(s);
      ExpectSameBits(lean, middle, "diffuse and opaque");
      s.Tracer.Force = Integrator::Variant::General;
      ExpectSameBits(lean, Traced(s), "diffuse and general");
      s.Tracer.Force = Integrator::Variant::OneByOne;
      ExpectSameBits(lean, Traced(s), "diffuse and one by one");
    }
  for (bool layered : { false, true })
  {
    Shot s = Prepared(Room(true, layered));
    const Picture lean = Traced(s);
    for (auto variant : { Integrator::Variant::General, Integrator::Variant::OneByOne })
    {
      s.Tracer.Force = variant;
      ExpectSameBits(lean, Traced(s), "glossy and " + std::to_string(int(variant)));
    }
  }
}

/// The glossy room with everything that the vectors of opaque surfaces choose among: perfect mirrors, metal,
/// half-metal, no reflection at all, odd indices and tints, one scattering between microfacets, steep bumps, mirrored
/// nodes.
SceneBuilder Motley(int kind)
{
  SceneBuilder b = Room(true, false, kind == 1);
  std::vector<Material>& m = b.Scene->Materials;
  Texture mixed;
  mixed.Width = 8;
  mixed.Height = kind == 2 ? 4 : 8;
  for (int i = 0; i < mixed.Width * mixed.Height; ++i)
    for (int v : { 250 - 3 * i, 4 * i, 2 * i + (kind == 0 ? 100 : 0), 255 - 2 * i })
      mixed.Bytes.push_back(std::uint8_t(v));
  b.Scene->Textures.push_back(mixed);
  if (kind == 1)
  {
    Texture sky;
    sky.Width = 16;
    sky.Height = 8;
    for (int i = 0; i < 128; ++i)
      sky.Floats.insert(sky.Floats.end(), { i == 37 ? 40.f : .1f + .01f * float(i % 7), i % 3 ? .5f : 0.f, .2f, 1 });
    b.Scene->Sky.Texture = int(b.Scene->Textures.size());
    b.Scene->Textures.push_back(sky);
  }
  int n = 0;
  for (Material& each : m)
  {
    each.DoubleSided = true;
    if (each.NormalTexture.Texture >= 0)
    {
      each.MetallicRoughnessTexture.Texture = 2;
      each.SpecularTexture.Texture = each.SpecularColorTexture.Texture = 2;
      each.SpecularColorTexture.Transform[0][2] = .3f;
      each.NormalScale = kind == 0 ? 9.f : .5f;
      each.NormalTexture.TexCoord = 0;
    }
    else if (!each.Unlit)
      switch ((n++ + kind) % 5)
      {
        case 0:
          each.Roughness = 0;
          each.Metallic = .7f;
          break;
        case 1:
          each.MultipleScattering = false;
          each.Ior = 1.2f;
          break;
        case 2:
          each.Specular = 0;
          each.Metallic = 0;
          break;
        case 3:
          each.Ior = 0;
          each.SpecularColor = { .2f, 3, .5f };
          each.Roughness = .05f;
          break;
        default:
          each.Metallic = 1;
          each.Roughness = 1;
          each.BaseColor = { 1, .5f, 0 };
      }
  }
  for (std::size_t i = 1; i < b.Scene->Nodes.size(); i += 2)
    b.Scene->Nodes[i].Scale = { -1, 1, 1 };
  return b;
}

TEST(Integrator, OpaqueSurfacesAgreeBitForBit)
{
  for (int kind = 0; kind < 5; ++kind)
    for (auto strategy : { Integrator::Strategy::Mis, Integrator::Strategy::LightOnly, Integrator::Strategy::BsdfOnly })
    {
      Shot s = Prepared(Motley(kind));
      s.Tracer.Sampling = strategy;
      s.Tracer.RouletteStart = kind;
      ASSERT_EQ(s.Tracer.Chosen(), Integrator::Variant::Opaque);
      const Picture lean = Traced(s);
      EXPECT_EQ(lean.Counters.NonFinite, 0);
      for (auto variant : { Integrator::Variant::General, Integrator::Variant::OneByOne })
      {
        s.Tracer.Force = variant;
        ExpectSameBits(lean, Traced(s), "kind " + std::to_string(kind) + ", variant " + std::to_string(int(variant)));
      }
    }
}

TEST(Integrator, TexturesMakeTheSameBitsHoweverTheyAreLaidOut)
{
  for (int kind = 0; kind < 3; ++kind)
  {
    const SceneBuilder b = Motley(kind);
    Shot s = Prepared(b);
    const Picture tables = Traced(s);
    EmbreeScene::Options options;
    options.TexelBytes = 0;
    EXPECT_GT(s.Scene->GetStatistics().Bytes, 0);
    s.Scene = std::make_shared<EmbreeScene>(b.Scene, options);
    s.Scene->SetTime(0, 0);
    s.Tracer.Scene = s.Scene.get();
    ExpectSameBits(tables, Traced(s), "kind " + std::to_string(kind));
  }
}

TEST(Integrator, EveryInstructionSetMakesTheSameBits)
{
  for (int kind = 0; kind < 4; ++kind)
  {
    const Shot s = Prepared(kind < 3 ? Room(kind > 0, kind > 1) : Motley(1));
    const Picture best = Traced(s);
    for (const SimdTarget& target : SimdTargets())
    {
      ForceSimdTarget(target.Id);
      ExpectSameBits(best, Traced(s), target.Name);
    }
    ForceSimdTarget(0);
  }
}

TEST(Integrator, TilesAndPassesMakeTheSameBits)
{
  for (int kind = 0; kind < 3; ++kind)
  {
    Shot s = Prepared(Room(kind > 0, kind > 1));
    const Picture whole = Traced(s);
    ExpectSameBits(whole, Traced(s, 7), "tiles of 7");
    ExpectSameBits(whole, Traced(s, 1), "single pixels");
    ExpectSameBits(whole, Traced(s, 16, { 1, 3, 1 }), "three passes");
    s.Tracer.GuideSamples = 9;
    ExpectSameBits(Traced(s), Traced(s, 5, { 2, 1, 2 }), "guide samples");
  }
}

TEST(Integrator, PatternsKeepTheirBits)
{
  Shot s = Prepared(Room(false));
  const Picture sobol = Traced(s);
  for (SamplePattern pattern : { SamplePattern::BlueNoise, SamplePattern::Random })
  {
    s.Tracer.Pattern = pattern;
    const Picture whole = Traced(s);
    EXPECT_NE(whole.Arrays.at("radiance"), sobol.Arrays.at("radiance"));
    ExpectSameBits(whole, Traced(s, 7, { 2, 3 }), "tiles of 7, two passes");
    s.Tracer.Force = Integrator::Variant::General;
    ExpectSameBits(whole, Traced(s), "general");
    s.Tracer.Force = Integrator::Variant::Auto;
  }
}

TEST(Integrator, LessDemandMakesTheSameBits)
{
  for (int kind = 0; kind < 3; ++kind)
  {
    Shot s = Prepared(Room(kind > 0, kind > 1));
    const Picture all = Traced(s);
    for (const char* one : { "radiance", "direct", "emission", "bounce2", "albedo", "normal", "depth", "hitDistance" })
    {
      s.Wanted = { one };
      const Picture p = Traced(s);
      EXPECT_EQ(std::memcmp(p.Arrays.at(one).data(), all.Arrays.at(one).data(), p.Arrays.at(one).size() * 4), 0) << one;
      EXPECT_LE(p.Counters.Rays, all.Counters.Rays);
    }
    // primary hits trace no bounce
    s.Wanted = { "depth", "motion", "id" };
    EXPECT_EQ(Traced(s).Counters.Rays, std::int64_t(s.Width) * s.Height * s.Samples);
  }
}

TEST(Integrator, LayersSumUp)
{
  for (int kind = 0; kind < 3; ++kind)
  {
    Shot s = Prepared(Room(kind > 0, kind > 1));
    for (const char* n : { "bounce5" })
      s.Wanted.insert(n);
    Picture p = Traced(s);
    auto& a = p.Arrays;
    double bounced = 0, specular = 0;
    for (std::size_t i = 0; i < a["radiance"].size(); ++i)
    {
      const auto at = [&](const char* name) { return double(a[name][i]); };
      const double slack = 1e-5 * (1 + at("radiance"));
      EXPECT_NEAR(at("emission") + at("direct") + at("indirect"), at("radiance"), slack);
      EXPECT_NEAR(at("directDiffuse") + at("directSpecular"), at("direct"), slack);
      EXPECT_NEAR(at("indirectDiffuse") + at("indirectSpecular"), at("indirect"), slack);
      EXPECT_NEAR(at("bounce1"), at("direct"), slack);
      EXPECT_NEAR(at("bounce2") + at("bounce3") + at("bounce4") + at("bounce5"), at("indirect"), slack);
      EXPECT_NEAR((3 * at("halfA") + 2 * at("halfB")) / 5, at("radiance"), slack);
      bounced += at("bounce3");
      specular += at("directSpecular");
    }
    EXPECT_GT(bounced, 0);
    EXPECT_EQ(specular > 0, kind > 0);
  }
}

TEST(Integrator, GuideSamplesCleanTheGuides)
{
  Shot s = Prepared(Room(true, true));
  s.Samples = s.Tracer.SamplesPerPixel = 1;
  s.Wanted = { "albedo", "normal", "varianceAlbedo", "radiance", "depth" };
  const Picture one = Traced(s);
  s.Tracer.GuideSamples = 64;
  const Picture many = Traced(s);
  // light and primary hits are what they were
  EXPECT_EQ(one.Arrays.at("radiance"), many.Arrays.at("radiance"));
  EXPECT_EQ(one.Arrays.at("depth"), many.Arrays.at("depth"));
  Shot other = s;
  other.Tracer.Seed = 8;
  const Picture again = Traced(other);
  Shot noisy = s;
  noisy.Tracer.GuideSamples = 0;
  noisy.Tracer.Seed = 8;
  const Picture oneAgain = Traced(noisy);
  double single = 0, several = 0, predicted = 0;
  const auto& a = many.Arrays.at("albedo");
  for (std::size_t i = 0; i < a.size(); ++i)
  {
    const double d = double(a[i]) - double(again.Arrays.at("albedo")[i]);
    several += d * d;
    const double e = double(one.Arrays.at("albedo")[i]) - double(oneAgain.Arrays.at("albedo")[i]);
    single += e * e;
  }
  for (float v : many.Arrays.at("varianceAlbedo"))
    predicted += 2 * 3 * double(v);
  EXPECT_LT(several, single / 20);
  EXPECT_GT(several, 0);
  // the variance that the film keeps is that of the means (Sobol points do better than random ones)
  EXPECT_LT(several, 2 * predicted);
  EXPECT_GT(several, predicted / 50);
}

TEST(Integrator, RandomNumbersOfWavefrontsAreThoseOfTheSampler)
{
  auto w = std::make_unique<Wavefront>();
  w->Count = 100;
  const std::uint64_t seed = 0xfedcba9876543210ull;
  for (int i = 0; i < w->Count; ++i)
  {
    const std::uint64_t key = PixelSampler::SeedKey(seed) ^ (std::uint64_t(3 * i) << 20 ^ std::uint64_t(i));
    w->Live.KeyLo[i] = std::uint32_t(key);
    w->Live.KeyHi[i] = std::uint32_t(key >> 32);
    w->Live.Reversed[i] = sampling::ReverseBits(std::uint32_t(i * 77));
  }
  for (std::uint32_t pair : { 0u, 1u, 3u, 22u, 1000u })
  {
    lanes::DrawRandom(*w, pair, 1);
    for (int i = 0; i < w->Count; ++i)
    {
      const Vec2f u = PixelSampler(seed, i, 3 * i, std::uint32_t(i * 77)).Pair(pair);
      EXPECT_EQ(w->Random[2][i], u.x);
      EXPECT_EQ(w->Random[3][i], u.y);
    }
  }
}
