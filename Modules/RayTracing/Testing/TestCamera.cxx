// SPDX-License-Identifier: BSD-3-Clause
// Lens, shutter and pixel filter: the rays, and what the source makes of them.
#include "SourceTesting.h"
#include "quellCamera.h"
#include "quellFrameFacts.h"
#include "quellPixelFilter.h"
#include "quellSampler.h"

#include <gtest/gtest.h>

#include <cmath>

using namespace quell;
using namespace sourcetesting;

namespace
{
Camera Sample(bool orthographic = false)
{
  CameraModel model;
  model.Orthographic = orthographic;
  model.YMag = 2;
  Mat4 m;
  m.m[0][3] = 1;
  m.m[2][3] = 5;
  return Camera(model, m, Vec3d(), 64, 48);
}
Vec2f Point(std::uint32_t i)
{
  return { sampling::UnitFloat(sampling::Sobol0(i)), sampling::UnitFloat(sampling::Sobol1(i)) };
}
double Brightness(const std::vector<float>& rgb)
{
  double sum = 0;
  for (float v : rgb)
    sum += v;
  return sum / double(rgb.size());
}
/// A white square of radiance 1 in front of black.
std::shared_ptr<Scene> Card(float z = 0)
{
  SceneBuilder b;
  const int white = b.Add(SceneBuilder::Lambert(0, 1));
  b.Quad(white, { -.5f, -.5f, z }, { 1, 0, 0 }, { 0, 1, 0 });
  b.Camera({ 0, 0, 4 }, .7);
  b.Scene->Hash = "card";
  return b.Scene;
}
/// The card passes from left to right: x = -1 at 0 s, +1 at 1 s.
std::shared_ptr<Scene> PassingCard()
{
  auto scene = Card();
  AnimationChannel c;
  c.Node = 0;
  c.Times = { 0, 1 };
  c.Values = { -1, 0, 0, 1, 0, 0 };
  scene->Animation.push_back(c);
  return scene;
}
}

TEST(Camera, TheMiddleOfTheLensIsThePinhole)
{
  for (bool orthographic : { false, true })
  {
    Camera camera = Sample(orthographic);
    camera.LensRadius = .3;
    camera.FocusDistance = 4;
    for (int blades : { 0, 5 })
    {
      camera.LensBlades = blades;
      Vec3d start, direction, from, to;
      camera.Ray(13.25, 40.5, start, direction);
      camera.Ray(13.25, 40.5, { .5f, .5f }, 0, from, to);
      if (blades == 0)
      {
        EXPECT_LT(Length(start - from), 1e-15);
        EXPECT_LT(Length(direction - to), 1e-15);
      }
      // every ray meets the pinhole's at the depth of focus, and nowhere else
      double farthest = 0;
      for (std::uint32_t i = 0; i < 256; ++i)
      {
        camera.Ray(13.25, 40.5, Point(i), 0, from, to);
        const auto at = [&](const Vec3d& s, const Vec3d& d, double depth)
        { return s + d * (depth / Dot(d, camera.Forward)); };
        EXPECT_LT(Length(at(from, to, 4) - at(start, direction, 4)), 1e-12);
        const double off = Length(at(from, to, 8) - at(start, direction, 8));
        farthest = std::max(farthest, off);
        EXPECT_LE(Length(from - start), .3 + 1e-12);
        EXPECT_NEAR(off, Length(from - start), 1e-12) << "twice as far, as much to the other side";
        EXPECT_NEAR(Length(to), 1, 1e-12);
      }
      EXPECT_GT(farthest, .27);
    }
  }
}

TEST(Camera, TheLensIsCoveredEvenly)
{
  Camera camera = Sample(true);
  camera.LensRadius = 1;
  for (int blades : { 0, 3, 6 })
  {
    camera.LensBlades = blades;
    double x = 0, y = 0, xx = 0, yy = 0, area = 0;
    const int n = 4096;
    for (std::uint32_t i = 0; i < n; ++i)
    {
      Vec3d start, direction, from;
      camera.Ray(32, 24, start, direction);
      camera.Ray(32, 24, Point(i), 0, from, direction);
      const Vec3d p = from - start;
      x += p.x;
      y += p.y;
      xx += p.x * p.x;
      yy += p.y * p.y;
      // corners are on the unit circle, one of them up
      if (blades >= 3)
      {
        const double pi = 3.14159265358979, step = 2 * pi / blades;
        for (int k = 0; k < blades; ++k)
          ASSERT_LE(p.x * std::cos(pi / 2 + (k + .5) * step) + p.y * std::sin(pi / 2 + (k + .5) * step),
            std::cos(step / 2) + 1e-9);
        area = std::max(area, p.y);
      }
    }
    // second moment of a regular polygon of circumradius 1: (2 + cos(2 pi / n)) / 12; of a disk 1/4
    const double moment = blades < 3 ? .25 : (2 + std::cos(2 * 3.14159265358979 / blades)) / 12;
    EXPECT_NEAR(x / n, 0, 2e-3) << blades;
    EXPECT_NEAR(y / n, 0, 2e-3) << blades;
    EXPECT_NEAR(xx / n, moment, 3e-3) << blades;
    EXPECT_NEAR(yy / n, moment, 3e-3) << blades;
    if (blades >= 3)
    {
      EXPECT_GT(area, .95) << "a corner is up";
    }
  }
}

TEST(Camera, MovesWhileTheShutterIsOpen)
{
  Camera camera = Sample(), close = Sample();
  CameraModel model;
  Mat4 turned; // a quarter of a degree about y, and a step to the right
  const double a = .25 * 3.14159265358979 / 180;
  turned.m[0][0] = turned.m[2][2] = std::cos(a);
  turned.m[0][2] = std::sin(a);
  turned.m[2][0] = -std::sin(a);
  turned.m[0][3] = 3;
  turned.m[2][3] = 5;
  close = Camera(model, turned, Vec3d(), 64, 48);
  EXPECT_FALSE(camera.MovesInShutter());
  camera.MoveInShutter(camera, camera);
  EXPECT_FALSE(camera.MovesInShutter());
  camera.MoveInShutter(Sample(), close);
  ASSERT_TRUE(camera.MovesInShutter());
  Vec3d s0, d0, s1, d1, s, d;
  Sample().Ray(10, 20, s0, d0);
  close.Ray(10, 20, s1, d1);
  camera.Ray(10, 20, { .5f, .5f }, 0, s, d);
  EXPECT_LT(Length(s - s0) + Length(d - d0), 1e-12);
  camera.Ray(10, 20, { .5f, .5f }, 1, s, d);
  EXPECT_LT(Length(s - s1) + Length(d - d1), 1e-12);
  camera.Ray(10, 20, { .5f, .5f }, .5, s, d);
  EXPECT_LT(Length(s - (s0 + s1) * .5), 1e-12);
  EXPECT_LT(Length(d - Normalized(d0 + d1)), 1e-6);
  // what knows no time does not change
  Vec2<double> pixel, still;
  camera.Project({ 0, 0, 0 }, 1, pixel);
  Sample().Project({ 0, 0, 0 }, 1, still);
  EXPECT_EQ(pixel.x, still.x);
}

TEST(PixelFilter, PositionsHaveTheFiltersDensity)
{
  using Shape = PixelFilter::Shape;
  for (Shape shape : { Shape::Box, Shape::Tent, Shape::Gaussian, Shape::BlackmanHarris })
  {
    const double radius = 1.5;
    const PixelFilter filter(shape, radius);
    constexpr int bins = 24, n = 1 << 14;
    double count[bins] = {}, expected[bins] = {}, sum = 0;
    for (std::uint32_t i = 0; i < n; ++i)
    {
      const Vec2<double> p = filter.Offset(Point(i));
      ASSERT_GE(p.x, -radius);
      ASSERT_LE(p.x, radius);
      ++count[std::min(bins - 1, int((p.x / radius + 1) / 2 * bins))];
    }
    for (int b = 0; b < bins; ++b)
      for (int k = 0; k < 64; ++k)
      {
        const double f = filter.Value(2 * (b + (k + .5) / 64) / bins - 1);
        expected[b] += f;
        sum += f;
      }
    for (int b = 0; b < bins; ++b)
      EXPECT_NEAR(count[b] / n, expected[b] / sum, 4e-4) << int(shape) << ' ' << b;
  }
}

TEST(PathTraceCamera, DefaultsAreTheOldPicture)
{
  vtkNew<vtkQuellPathTraceSource> plain, asked;
  Configure(plain, Room());
  Configure(asked, Room());
  asked->SetPixelFilter(vtkQuellPathTraceSource::Box);
  asked->SetFilterRadius(.5);
  asked->SetShutterTime(.5); // nothing moves
  asked->SetFocusDistance(2);
  asked->SetLensBlades(6);
  plain->Update();
  asked->Update();
  EXPECT_FALSE(Copy(plain, "radiance").empty());
  EXPECT_EQ(Copy(plain, "radiance"), Copy(asked, "radiance"));
  asked->SetLensRadius(.1);
  asked->Update();
  EXPECT_NE(Copy(plain, "radiance"), Copy(asked, "radiance"));
}

TEST(PathTraceCamera, TheCardIsSharpInFocusOnly)
{
  const auto edge = [](double lens, double focus, float z)
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Card(z), 64, 64, 64);
    s->SetLensRadius(lens);
    s->SetFocusDistance(focus);
    s->SetAlwaysMake({ "alpha", "depth", "motion" });
    s->Update();
    EXPECT_EQ(s->GetErrorText(), "");
    int partly = 0;
    double light = 0;
    for (vtkIdType p = 0; p < 64 * 64; ++p)
    {
      const float alpha = Array(s, "alpha")->GetValue(p);
      partly += alpha > 0 && alpha < 1;
      light += alpha;
      EXPECT_EQ(Array(s, "motion")->GetComponent(p, 0), 0) << "a lens moves nothing";
      if (alpha > 0)
      {
        EXPECT_NEAR(Array(s, "depth")->GetValue(p), 4 - z, 1e-5) << "along the axis, wherever on the lens";
      }
    }
    return std::pair<int, double>(partly, light);
  };
  const auto sharp = edge(0, 0, 0), focused = edge(.2, 4, 0), automatic = edge(.2, 0, 0), near = edge(.2, 2.5, 0);
  EXPECT_GT(sharp.first, 60); // the border itself
  EXPECT_LT(sharp.first, 120);
  EXPECT_EQ(focused.first, sharp.first);
  EXPECT_EQ(automatic.first, sharp.first) << "focus 0 is what the middle sees";
  EXPECT_GT(near.first, 4 * sharp.first);
  EXPECT_NEAR(focused.second / sharp.second, 1, 2e-3);
  EXPECT_NEAR(near.second / sharp.second, 1, 1e-2) << "blur spreads light and makes none";
}

TEST(PathTraceCamera, AWideFilterBlursAndKeepsTheEnergy)
{
  const auto total = [](int filter, double radius)
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Card(), 48, 48, 64);
    s->SetPixelFilter(filter);
    s->SetFilterRadius(radius);
    s->Update();
    int partly = 0;
    const std::vector<float> rgb = Copy(s, "radiance");
    for (std::size_t i = 0; i < rgb.size(); i += 3)
      partly += rgb[i] > 0 && rgb[i] < 1;
    return std::pair<int, double>(partly, Brightness(rgb));
  };
  const auto box = total(vtkQuellPathTraceSource::Box, 0);
  for (int filter :
    { vtkQuellPathTraceSource::Tent, vtkQuellPathTraceSource::Gaussian, vtkQuellPathTraceSource::BlackmanHarris })
  {
    const auto wide = total(filter, 3);
    EXPECT_GT(wide.first, 2 * box.first) << filter;
    EXPECT_NEAR(wide.second / box.second, 1, 2e-3) << filter;
  }
}

TEST(PathTraceCamera, TheShutterSmearsWhatMoves)
{
  // One frame per second: over the whole shutter the card, 1 wide, passes x = -1 ... 1 within half a frame on each
  // side.
  const auto columns = [](double shutterTime, std::vector<float>* motion = nullptr, float* position = nullptr)
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, PassingCard(), 96, 32, 64);
    s->SetTimeline({ 0, 3, 2 }); // tick 1 is at 0.5 s: the card is in the middle
    s->SetShutterTime(shutterTime);
    EXPECT_TRUE(Ask(s, { "radiance", "alpha", "motion", "position" }, 1));
    std::vector<double> profile(96);
    for (int x = 0; x < 96; ++x)
      profile[std::size_t(x)] = Array(s, "radiance")->GetComponent(16 * 96 + x, 0);
    if (motion)
      *motion = { float(Array(s, "motion")->GetComponent(16 * 96 + 48, 0)) };
    if (position)
      *position = float(Array(s, "position")->GetComponent(16 * 96 + 48, 0));
    return profile;
  };
  std::vector<float> moved, movedOpen;
  float middle = 0;
  const auto sharp = columns(0, &moved), open = columns(1, &movedOpen, &middle);
  double light[2] = {}, edges[2] = {};
  for (int x = 0; x < 96; ++x)
  {
    light[0] += sharp[std::size_t(x)];
    light[1] += open[std::size_t(x)];
    edges[0] += sharp[std::size_t(x)] > .02 && sharp[std::size_t(x)] < .98;
    edges[1] += open[std::size_t(x)] > .02 && open[std::size_t(x)] < .98;
    // symmetric about the frame's own time
    EXPECT_NEAR(open[std::size_t(x)], open[std::size_t(95 - x)], .1) << x;
  }
  EXPECT_LE(edges[0], 4);
  EXPECT_GT(edges[1], 17) << "a card of 11 pixels moves by its width: both borders smear";
  EXPECT_NEAR(light[1] / light[0], 1, .02);
  // the same motion for every moment of the shutter: from this frame's time to that of the one before
  ASSERT_EQ(moved.size(), 1u);
  EXPECT_NEAR(moved[0], movedOpen[0], .05);
  EXPECT_LT(moved[0], -5);
  EXPECT_NEAR(middle, 0, .06);
  // half the shutter, half the smear
  const auto half = columns(.5);
  double edgesHalf = 0;
  for (double v : half)
    edgesHalf += v > .02 && v < .98;
  EXPECT_NEAR(edgesHalf / edges[1], .5, .1);
}

TEST(PathTraceCamera, ThePassingCameraSmearsTheScene)
{
  auto scene = Card();
  AnimationChannel c;
  Node node;
  node.Translation = { 0, 0, 4 };
  scene->Nodes.push_back(node);
  c.Node = int(scene->Nodes.size()) - 1;
  scene->Cameras[0].Node = c.Node;
  c.Times = { 0, 1 };
  c.Values = { 1, 0, 4, -1, 0, 4 };
  scene->Animation.push_back(c);
  std::vector<float> still, smeared;
  for (double shutter : { 0., 1. })
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, scene, 96, 16, 128);
    s->SetTimeline({ 0, 3, 2 });
    s->SetShutterTime(shutter);
    ASSERT_TRUE(Ask(s, { "radiance" }, 1)) << s->GetErrorText();
    (shutter > 0 ? smeared : still) = Copy(s, "radiance");
    const FrameFacts facts = FrameFacts::Read(s->GetOutput()->GetFieldData());
    EXPECT_NEAR(facts.WorldToCamera.Point(facts.Origin * -1.).x, 0, 1e-9) << "the facts are of the frame's time";
  }
  int edges[2] = {};
  for (std::size_t i = 0; i < still.size(); i += 3)
  {
    edges[0] += still[i] > .02f && still[i] < .98f;
    edges[1] += smeared[i] > .02f && smeared[i] < .98f;
  }
  EXPECT_GT(edges[1], 3 * std::max(1, edges[0]));
  EXPECT_NEAR(Brightness(smeared) / Brightness(still), 1, .02);
}
