// SPDX-License-Identifier: BSD-3-Clause
#include "SourceTesting.h"
#include "quellCamera.h"
#include "quellFrameFacts.h"
#include "quellRegisterRayTracing.h"
#include "quellStageRegistry.h"

#include "vtkObject.h"
#include "vtkSMPTools.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

using namespace quell;
using sourcetesting::Array;
using sourcetesting::Configure;
using sourcetesting::Copy;

namespace
{
/// The room, with its sphere and its camera on the move if asked for.
std::shared_ptr<Scene> Room(bool moving = false)
{
  std::shared_ptr<Scene> room = sourcetesting::Room();
  if (moving)
  {
    Scene& s = *room;
    AnimationChannel c;
    c.Node = 3;
    c.Times = { 0, 10 };
    c.Values = { 0, 0, 0, -10, 0, 0 };
    s.Animation.push_back(c);
    Node node;
    s.Nodes.push_back(node);
    s.Cameras[0].Node = int(s.Nodes.size()) - 1;
    s.Nodes.back().HasMatrix = false;
    s.Nodes.back().Translation = { 0, 1, 4 };
    c.Node = s.Cameras[0].Node;
    c.Values = { 0, 1, 4, 2, 1, 4 };
    s.Animation.push_back(c);
  }
  return room;
}

/// Exactly these arrays of tick 0.
void Ask(vtkQuellPathTraceSource* s, const ArraySet& names)
{
  EXPECT_TRUE(sourcetesting::Ask(s, names)) << s->GetErrorText();
}

const ArraySet Everything = { "radiance", "emission", "direct", "indirect", "albedo", "normal", "roughness", "depth",
  "position", "normalGeometric", "motion", "id", "material", "hitDistance", "variance", "halfA", "halfB", "samples",
  "alpha" };
}

TEST(PathTraceSource, IsRegistered)
{
  StageRegistry registry;
  RegisterRayTracingStages(registry);
  ASSERT_TRUE(registry.Create("PathTraceSource"));
  EXPECT_EQ(registry.Describe("PathTraceSource")->FindProperty("MaximumBounces")->DefaultText, "-1");
}

TEST(PathTraceSource, LayersSumToRadiance)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room());
  s->SetAlwaysMake(Everything);
  s->Update();
  ASSERT_EQ(s->GetErrorText(), "");
  const auto r = Copy(s, "radiance"), e = Copy(s, "emission"), d = Copy(s, "direct"), i = Copy(s, "indirect"),
             a = Copy(s, "halfA"), b = Copy(s, "halfB"), v = Copy(s, "variance");
  ASSERT_EQ(r.size(), 40u * 32u * 3u);
  double sums[3] = {};
  for (std::size_t k = 0; k < r.size(); ++k)
  {
    ASSERT_NEAR(e[k] + d[k] + i[k], r[k], 4e-7 * (1 + r[k]));
    ASSERT_NEAR((a[k] + b[k]) / 2, r[k], 4e-7 * (1 + r[k]));
    sums[0] += e[k];
    sums[1] += d[k];
    sums[2] += i[k];
  }
  for (double sum : sums)
    EXPECT_GT(sum, 10);
  // two samples: the variance of the mean is the squared half difference
  for (std::size_t p = 0; p < v.size(); ++p)
  {
    const double la = .2126 * a[3 * p] + .7152 * a[3 * p + 1] + .0722 * a[3 * p + 2];
    const double lb = .2126 * b[3 * p] + .7152 * b[3 * p + 1] + .0722 * b[3 * p + 2];
    ASSERT_NEAR(v[p], (la - lb) * (la - lb) / 4, 1e-4 * (1e-3 + v[p]));
  }
}

TEST(PathTraceSource, ArraysHaveTheSameBitsAloneOrTogether)
{
  vtkNew<vtkQuellPathTraceSource> all;
  Configure(all, Room());
  all->SetAlwaysMake(Everything);
  all->Update();
  for (const std::string& name : Everything)
  {
    vtkNew<vtkQuellPathTraceSource> one;
    Configure(one, Room());
    Ask(one, { name });
    EXPECT_EQ(one->GetOutput()->GetPointData()->GetNumberOfArrays(), 1);
    EXPECT_EQ(Copy(one, name.c_str()), Copy(all, name.c_str())) << name;
  }
}

TEST(PathTraceSource, RegionIsTheCropBitForBit)
{
  vtkNew<vtkQuellPathTraceSource> whole, part;
  Configure(whole, Room());
  Configure(part, Room());
  whole->SetAlwaysMake(Everything);
  part->SetAlwaysMake(Everything);
  whole->Update();
  int extent[6] = { 7, 28, 5, 21, 0, 0 };
  part->UpdateExtent(extent);
  ASSERT_EQ(part->GetCounters().Pixels, 22 * 17);
  for (const std::string& name : Everything)
  {
    vtkFloatArray *w = Array(whole, name.c_str()), *p = Array(part, name.c_str());
    ASSERT_TRUE(w && p) << name;
    const int n = w->GetNumberOfComponents();
    for (int y = 5; y <= 21; ++y)
      ASSERT_EQ(
        0, std::memcmp(w->GetPointer((y * 40 + 7) * n), p->GetPointer((y - 5) * 22 * n), sizeof(float) * 22 * n))
        << name;
  }
}

TEST(PathTraceSource, ThreadsChangeNoBit)
{
  std::vector<float> images[2];
  for (int t = 0; t < 2; ++t)
    vtkSMPTools::LocalScope(vtkSMPTools::Config{ t + 1 },
      [&]()
      {
        vtkNew<vtkQuellPathTraceSource> s;
        Configure(s, Room());
        s->Update();
        images[t] = Copy(s, "radiance");
      });
  EXPECT_FALSE(images[0].empty());
  EXPECT_EQ(images[0], images[1]);
}

TEST(PathTraceSource, SeedsAndTicksDiffer)
{
  std::vector<std::vector<float>> images;
  for (int k = 0; k < 3; ++k)
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Room());
    s->SetSeed(k == 1);
    s->SetTimeline({ 0, 5, 24 });
    s->UpdateInformation();
    s->UpdateTimeStep(k == 2 ? 1 : 0);
    images.push_back(Copy(s, "radiance"));
  }
  EXPECT_NE(images[0], images[1]);
  EXPECT_NE(images[0], images[2]);
}

TEST(PathTraceSource, WhatWasTracedIsKept)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room());
  s->Update();
  const auto first = Copy(s, "radiance");
  const auto rays = s->GetCounters().Rays;
  EXPECT_GT(rays, 40 * 32 * 2 * 3 / 2);
  s->Modified();
  s->Update();
  EXPECT_EQ(s->GetCounters().Executions, 2);
  EXPECT_EQ(s->GetCounters().Rays, rays);
  EXPECT_EQ(Copy(s, "radiance"), first);
  // one more array costs its own camera rays only
  s->SetAlwaysMake({ "depth" });
  s->Update();
  ASSERT_TRUE(Array(s, "depth"));
  EXPECT_EQ(s->GetCounters().Rays, rays + 40 * 32 * 2);
  // another parameter traces again
  s->SetSeed(5);
  s->Update();
  EXPECT_GT(s->GetCounters().Rays, 2 * rays);
}

TEST(PathTraceSource, UnreadArraysTraceNoBounces)
{
  const auto rays = [](ArraySet wanted)
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Room());
    Ask(s, wanted);
    return double(s->GetCounters().Rays) / (40 * 32 * 2);
  };
  EXPECT_EQ(rays({ "depth", "id", "material", "position", "motion", "normalGeometric", "alpha" }), 1);
  EXPECT_EQ(rays({ "samples" }), 0);
  const double guides = rays({ "albedo", "normal" }), emission = rays({ "emission" }), direct = rays({ "direct" }),
               full = rays({ "radiance" });
  EXPECT_GT(guides, 1); // through the mirror
  EXPECT_LT(guides, 1.5);
  EXPECT_LT(emission, 1.5);
  EXPECT_LT(direct, 3.6);
  EXPECT_GT(full, direct + .05);
}

TEST(PathTraceSource, BackgroundsAndConsistency)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 40, 32, 3);
  s->SetAlwaysMake(Everything);
  s->Update();
  int sky = 0, mirror = 0;
  for (vtkIdType p = 0; p < 40 * 32; ++p)
  {
    const bool hit = std::isfinite(Array(s, "depth")->GetValue(p));
    EXPECT_EQ(hit, Array(s, "id")->GetValue(p) > 0);
    EXPECT_EQ(hit, Array(s, "alpha")->GetValue(p) > 0);
    EXPECT_EQ(Array(s, "samples")->GetValue(p), 3);
    if (!hit)
    {
      ++sky;
      for (int c = 0; c < 3; ++c)
      {
        EXPECT_EQ(Array(s, "albedo")->GetTypedComponent(p, c), 1.f);
        EXPECT_EQ(Array(s, "normal")->GetTypedComponent(p, c), 0.f);
        EXPECT_EQ(Array(s, "position")->GetTypedComponent(p, c), 0.f);
        EXPECT_NEAR(Array(s, "radiance")->GetTypedComponent(p, c), .2f, 1e-6f);
        EXPECT_EQ(Array(s, "direct")->GetTypedComponent(p, c), 0.f);
      }
      EXPECT_TRUE(std::isinf(Array(s, "hitDistance")->GetValue(p)));
    }
    mirror += Array(s, "id")->GetValue(p) == 2;
    EXPECT_EQ(Array(s, "motion")->GetTypedComponent(p, 0), 0.f);
    EXPECT_EQ(Array(s, "motion")->GetTypedComponent(p, 1), 0.f);
  }
  EXPECT_GT(sky, 50);
  EXPECT_GT(mirror, 50);
}

TEST(PathTraceSource, FactsProjectPositionsToTheirPixels)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 41, 31, 1);
  s->SetPixelJitter(vtkQuellPathTraceSource::None);
  s->SetAlwaysMake({ "position", "depth" });
  s->Update();
  const FrameFacts f = FrameFacts::Read(s->GetOutput()->GetFieldData());
  ASSERT_TRUE(f.HasCamera);
  for (int y = 0; y < 31; ++y)
    for (int x = 0; x < 41; ++x)
    {
      const float depth = Array(s, "depth")->GetValue(y * 41 + x);
      if (!std::isfinite(depth))
        continue;
      double p[3], c[4];
      Array(s, "position")->GetTuple(y * 41 + x, p);
      for (int i = 0; i < 4; ++i)
        c[i] = f.WorldToNdc.m[i][0] * p[0] + f.WorldToNdc.m[i][1] * p[1] + f.WorldToNdc.m[i][2] * p[2] +
               f.WorldToNdc.m[i][3];
      ASSERT_NEAR((c[0] / c[3] + 1) / 2 * 41, x + .5, 1e-4);
      ASSERT_NEAR((c[1] / c[3] + 1) / 2 * 31, y + .5, 1e-4);
      ASSERT_NEAR(c[3], depth, 1e-5 * depth);
      ASSERT_NEAR(-(f.WorldToCamera.Point({ p[0], p[1], p[2] }).z), depth, 1e-5 * depth);
    }
}

TEST(PathTraceSource, MotionFollowsCameraAndObjects)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(true), 64, 48, 1);
  s->SetTimeline({ 0, 10, 10 });
  s->SetAlwaysMake({ "position", "motion", "id" });
  s->UpdateInformation();
  s->UpdateTimeStep(3);
  const FrameFacts before = FrameFacts::Read(s->GetOutput()->GetFieldData());
  s->UpdateTimeStep(4);
  ASSERT_EQ(s->GetErrorText(), "");
  const FrameFacts now = FrameFacts::Read(s->GetOutput()->GetFieldData());
  EXPECT_EQ(now.Tick, 4);
  EXPECT_NEAR(now.Time, .4, 1e-12);
  int counts[2] = {};
  const auto pixel = [](const FrameFacts& f, const Vec3d& p)
  {
    double c[4];
    for (int i = 0; i < 4; ++i)
      c[i] =
        f.WorldToNdc.m[i][0] * p.x + f.WorldToNdc.m[i][1] * p.y + f.WorldToNdc.m[i][2] * p.z + f.WorldToNdc.m[i][3];
    return Vec2<double>{ (c[0] / c[3] + 1) * 32, (c[1] / c[3] + 1) * 24 };
  };
  for (int k = 0; k < 64 * 48; ++k)
  {
    const float id = Array(s, "id")->GetValue(k);
    if (id == 0)
    {
      // a camera that does not turn: the sky stands still
      EXPECT_NEAR(Array(s, "motion")->GetTypedComponent(k, 0), 0, 1e-6);
      continue;
    }
    double q[3];
    Array(s, "position")->GetTuple(k, q);
    const Vec3d p(q[0], q[1], q[2]);
    // the sphere went 0.1 to the left per tick
    const Vec3d then = id == 4 ? p + Vec3d(.1, 0, 0) : p;
    const Vec2<double> a = pixel(now, p), b = pixel(before, then);
    ASSERT_NEAR(Array(s, "motion")->GetTypedComponent(k, 0), b.x - a.x, 2e-4);
    ASSERT_NEAR(Array(s, "motion")->GetTypedComponent(k, 1), b.y - a.y, 2e-4);
    ++counts[id == 4];
  }
  EXPECT_GT(counts[0], 500);
  EXPECT_GT(counts[1], 50);
}

TEST(PathTraceSource, ExtremesStayFinite)
{
  vtkNew<vtkQuellPathTraceSource> s;
  const auto check = [&](std::shared_ptr<Scene> scene, int w, int h, const char* what)
  {
    Configure(s, scene, w, h, 4);
    s->SetAlwaysMake({ "radiance", "albedo", "normal", "variance", "position" });
    s->Update();
    ASSERT_EQ(s->GetErrorText(), "") << what;
    for (const char* name : { "radiance", "albedo", "normal", "position" })
      for (float v : Copy(s, name))
        ASSERT_TRUE(std::isfinite(v)) << what << ' ' << name;
  };
  check(std::make_shared<Scene>(), 5, 4, "nothing at all");
  auto room = Room();
  check(room, 1, 1, "one pixel");
  room = Room();
  room->Sky = Environment();
  room->Materials[1].Emission = Vec3f();
  s->SetDefaultSky(vtkQuellPathTraceSource::Never);
  check(room, 16, 16, "no light");
  for (float v : Copy(s, "radiance"))
    ASSERT_EQ(v, 0.f);
  EXPECT_FALSE(s->GetWarnings().empty());
  s->SetDefaultSky(vtkQuellPathTraceSource::WhenDark);
  room = Room();
  room->Materials[1].Emission = Vec3f(1e30f);
  check(room, 16, 16, "1e30");
  room = Room();
  room->Materials[1].Emission = Vec3f(3e38f);
  check(room, 16, 16, "3e38");
  room = Room();
  room->Meshes[3].Positions[40].x = std::numeric_limits<float>::quiet_NaN();
  room->Meshes[2].Positions[2] = room->Meshes[2].Positions[0];
  check(room, 16, 16, "NaN vertex, lamp without area");
  EXPECT_FALSE(s->GetWarnings().empty());
  for (float roughness : { 0.f, .03f, .05f, 1.f })
  {
    room = Room();
    room->Materials[0].BaseColor = Vec3f(1.f);
    room->Materials[2].Roughness = roughness;
    check(room, 16, 16, "roughness");
  }
}

TEST(PathTraceSource, StudioSkyLightsWhatHasNoLight)
{
  const auto mean = [](const std::vector<float>& values)
  {
    double sum = 0;
    for (float v : values)
      sum += v;
    return sum / double(values.size());
  };
  const auto warned = [](vtkQuellPathTraceSource* s, const char* text)
  {
    for (const std::string& warning : s->GetWarnings())
      if (warning.find(text) != std::string::npos)
        return true;
    return false;
  };
  auto dark = Room();
  dark->Sky = Environment();
  dark->Materials[1].Emission = Vec3f();
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, dark, 16, 16, 4);
    s->Update();
    EXPECT_GT(mean(Copy(s, "radiance")), .1);
    EXPECT_TRUE(warned(s, "studio sky"));
    s->SetDefaultSky(vtkQuellPathTraceSource::Never);
    s->Update();
    EXPECT_EQ(mean(Copy(s, "radiance")), 0.);
    EXPECT_TRUE(warned(s, "no light"));
  }
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, dark, 16, 16, 1);
    Ask(s, { "depth" });
    EXPECT_FALSE(warned(s, "studio sky")) << "no light was asked for";
  }
  {
    // A lamp that lights nothing the camera sees, far away: black, and a warning says so.
    auto feeble = Room();
    feeble->Sky = Environment();
    feeble->Materials[1].Emission = Vec3f(1e-6f);
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, feeble, 16, 16, 4);
    s->Update();
    EXPECT_TRUE(warned(s, "almost every pixel is black"));
    s->SetDefaultSky(vtkQuellPathTraceSource::Always);
    s->Update();
    EXPECT_GT(mean(Copy(s, "radiance")), .1);
  }
  {
    auto unlit = Room();
    unlit->Sky = Environment();
    for (Material& m : unlit->Materials)
      m.Unlit = true;
    EXPECT_TRUE(unlit->HasLight()) << "nothing needs light";
  }
}

TEST(PathTraceSource, FramingFillsTheFrameWithTheBox)
{
  for (const Vec3d& size : { Vec3d(1, 1, 1), Vec3d(8, 1, .1), Vec3d(.1, 5, 3), Vec3d(2, 0, 2) })
    for (int width : { 64, 32, 128 })
    {
      const Vec3d low(3, -2, 7);
      const Camera camera = Camera::Framing(low, low + size, Vec3d(), width, 64);
      double reach = 0;
      for (int corner = 0; corner < 8; ++corner)
      {
        const Vec3d p = low + Vec3d(corner & 1 ? size.x : 0, corner & 2 ? size.y : 0, corner & 4 ? size.z : 0);
        Vec2<double> pixel;
        ASSERT_TRUE(camera.Project(p, 1, pixel));
        reach = std::max({ reach, std::fabs(2 * pixel.x / width - 1), std::fabs(2 * pixel.y / 64 - 1) });
      }
      EXPECT_NEAR(reach, .92, 1e-6) << size.x << ' ' << width;
      EXPECT_GT(camera.Position.z, low.z + size.z) << "in front";
    }
}

TEST(PathTraceSource, FarFromTheOriginIsTheSameImage)
{
  const Vec3d far(1e6, -1e6, 1e6);
  std::vector<float> images[2];
  for (int k = 0; k < 2; ++k)
  {
    auto room = Room();
    if (k)
    {
      for (Node& n : room->Nodes)
        n.Translation = far;
      for (int i = 0; i < 3; ++i)
        room->Cameras[0].WorldFromCamera.m[i][3] += far[i];
    }
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, room, 40, 32, 4);
    s->Update();
    images[k] = Copy(s, "radiance");
    const FrameFacts f = FrameFacts::Read(s->GetOutput()->GetFieldData());
    EXPECT_EQ(Length(f.Origin) > 1e6, k == 1);
  }
  double error = 0, sum = 0;
  for (std::size_t i = 0; i < images[0].size(); ++i)
  {
    error += std::fabs(images[0][i] - images[1][i]);
    sum += images[0][i];
  }
  EXPECT_LT(error, 5e-3 * sum);
}

TEST(PathTraceSource, ClampBoundsSamples)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 40, 32, 1);
  s->SetSampleClamp(.3);
  s->SetAlwaysMake({ "direct", "indirect" });
  s->Update();
  double longest = 0;
  for (const char* name : { "direct", "indirect" })
  {
    const auto v = Copy(s, name);
    for (std::size_t i = 0; i < v.size(); i += 3)
      longest = std::max(longest, std::sqrt(double(v[i]) * v[i] + v[i + 1] * v[i + 1] + v[i + 2] * v[i + 2]));
  }
  EXPECT_NEAR(longest, .3, 1e-5);
}

TEST(PathTraceSource, MistakesAreToldBeforeTracing)
{
  vtkObject::GlobalWarningDisplayOff();
  vtkNew<vtkQuellPathTraceSource> s;
  s->UpdateInformation();
  EXPECT_NE(s->GetErrorText().find("set Scene"), std::string::npos);
  s->SetScene(std::string("/nowhere/at-all.gltf"));
  s->UpdateInformation();
  EXPECT_NE(s->GetErrorText().find("at-all.gltf"), std::string::npos);
  s->SetScene(Room());
  s->SetCamera("garden");
  s->UpdateInformation();
  EXPECT_NE(s->GetErrorText().find("garden"), std::string::npos);
  s->SetCamera("0");
  s->Update();
  EXPECT_EQ(s->GetErrorText(), "");
  vtkObject::GlobalWarningDisplayOn();
}

TEST(PathTraceSource, EveryTextureCountsAlone)
{
  // One feature, black texture: as if the factor were 0. Red of the colour textures, where 0 would mean the same.
  using Change = void (*)(Material&, bool textured);
  const Change changes[] = {
    [](Material& m, bool textured)
    {
      m.Clearcoat = textured ? 1 : 0;
      m.ClearcoatTexture.Texture = textured ? 0 : -1;
    },
    [](Material& m, bool textured)
    {
      m.Clearcoat = 1;
      m.ClearcoatRoughness = textured ? 1 : 0;
      m.ClearcoatRoughnessTexture.Texture = textured ? 0 : -1;
    },
    [](Material& m, bool textured)
    {
      m.Specular = textured ? 1 : 0;
      m.SpecularTexture.Texture = textured ? 0 : -1;
    },
    [](Material& m, bool textured)
    {
      m.SpecularColor = Vec3f(textured ? 1.f : 0.f);
      m.SpecularColorTexture.Texture = textured ? 0 : -1;
    },
    [](Material& m, bool textured)
    {
      m.Transmission = 1;
      m.Roughness = 0;
      m.Volume = textured;
      m.Thickness = textured ? 1 : 0;
      m.ThicknessTexture.Texture = textured ? 0 : -1;
    },
  };
  int which = 0;
  for (const Change change : changes)
  {
    std::vector<float> pictures[2];
    for (bool textured : { false, true })
    {
      SceneBuilder b;
      Material m;
      m.BaseColor = Vec3f(.5f);
      m.Metallic = 0;
      m.Roughness = .3f;
      change(m, textured);
      Texture black;
      black.Width = black.Height = 1;
      black.Bytes = { 0, 0, 0, 0 };
      b.Scene->Textures.push_back(black);
      b.Quad(b.Add(m), { -1, -1, 0 }, { 2, 0, 0 }, { 0, 2, 0 });
      b.Scene->Meshes.back().TexCoords[0] = { { 0, 0 }, { 1, 0 }, { 1, 1 }, { 0, 1 } };
      b.Quad(b.Add(SceneBuilder::Lambert(.5f, 2)), { -1, -1, -2 }, { 2, 0, 0 }, { 0, 2, 0 });
      b.Sky(1);
      b.Camera({ .3, .2, 2 }, .6);
      vtkNew<vtkQuellPathTraceSource> s;
      Configure(s, b.Scene, 16, 16, 4);
      s->SetAlwaysMake({ "radiance" });
      s->Update();
      ASSERT_EQ(s->GetErrorText(), "");
      pictures[textured] = Copy(s, "radiance");
    }
    ASSERT_EQ(pictures[0].size(), pictures[1].size());
    for (std::size_t i = 0; i < pictures[0].size(); ++i)
      ASSERT_NEAR(pictures[0][i], pictures[1][i], 1e-5f) << "feature " << which;
    ++which;
  }
}

TEST(PathTraceSource, CamerasThatShowNowhereAreRefused)
{
  vtkObject::GlobalWarningDisplayOff();
  for (int axis = 0; axis < 4; ++axis) // 3: all of them
  {
    auto room = Room();
    for (CameraModel& c : room->Cameras)
    {
      c.Node = -1;
      c.Name = "flat";
      for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
          c.WorldFromCamera.m[row][column] *= column == axis || axis == 3 ? 0 : 1;
    }
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, room, 4, 4, 1);
    s->Update();
    // What is to the right follows from the other two.
    EXPECT_EQ(s->GetErrorText().find("camera \"flat\" shows in no direction") == std::string::npos, axis == 0)
      << axis << s->GetErrorText();
  }
  vtkObject::GlobalWarningDisplayOn();
}

TEST(PathTraceSource, EveryLensMakesFiniteArrays)
{
  for (double radius : { 1., 1e4, 1e7, 1e8, 3e8, 1e9 })
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Room(), 16, 16, 8);
    s->SetLensRadius(radius);
    Ask(s, { "radiance", "position", "normal", "normalGeometric", "motion", "albedo", "depth" });
    for (const char* name : { "radiance", "position", "normal", "normalGeometric", "motion", "albedo" })
    {
      auto array = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray(name));
      ASSERT_NE(array, nullptr) << name;
      for (vtkIdType i = 0; i < array->GetNumberOfValues(); ++i)
        ASSERT_TRUE(std::isfinite(array->GetValue(i))) << radius << " " << name << " " << i;
    }
    auto depth = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray("depth"));
    for (vtkIdType i = 0; i < depth->GetNumberOfValues(); ++i) // +inf: nothing there
      ASSERT_GT(depth->GetValue(i), 0) << radius << " " << i;
  }
}

TEST(PathTraceSource, ScenesOfSizesWithoutDigitsAreTold)
{
  for (double scale : { 1e-12, 1e-8, 1., 1e11, 1e14 })
  {
    auto room = Room();
    for (Mesh& mesh : room->Meshes)
      for (Vec3f& p : mesh.Positions)
        p = p * float(scale);
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, room, 4, 4, 1);
    s->Update();
    const auto& warnings = s->GetWarnings();
    const bool told = std::any_of(warnings.begin(), warnings.end(),
      [](const std::string& w) { return w.find("choose another unit of length") != std::string::npos; });
    EXPECT_EQ(told, scale < 1e-9 || scale > 1e12) << scale << s->GetErrorText();
  }
}

TEST(PathTraceSource, CamerasWithoutDigitsAreRefused)
{
  auto room = Room();
  for (CameraModel& c : room->Cameras)
  {
    c.Node = -1;
    c.Name = "far";
    c.WorldFromCamera.m[0][3] = 1e20;
  }
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, room, 4, 4, 1);
  vtkObject::GlobalWarningDisplayOff();
  s->Update();
  vtkObject::GlobalWarningDisplayOn();
  EXPECT_NE(s->GetErrorText().find("camera \"far\""), std::string::npos) << s->GetErrorText();
}
