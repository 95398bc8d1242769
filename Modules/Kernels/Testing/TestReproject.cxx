// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellReproject.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <vector>

using namespace quell;

namespace
{
using quelltest::Inf;
using quelltest::NaN;

struct Picture
{
  Rect extent;
  int components = 1;
  std::vector<float> data;

  Picture() = default;
  Picture(const Rect& e, int c, float v = 0)
    : extent(e)
    , components(c)
    , data(std::size_t(e.area()) * c, v)
  {
  }
  ImageIn in() const { return { data.data(), components, extent }; }
  ImageOut out() { return { data.data(), components, extent }; }
  float* at(int x, int y) { return this->out().at(x, y); }
  void fill(const std::function<void(int, int, float*)>& f)
  {
    for (int y = extent.y0; y < extent.y1; ++y)
      for (int x = extent.x0; x < extent.x1; ++x)
        f(x, y, this->at(x, y));
  }
  Picture crop(const Rect& r) const
  {
    Picture p(r, components);
    p.fill([&](int x, int y, float* v) { std::copy_n(this->in().at(x, y), components, v); });
    return p;
  }
};

/// Looks along -z from `eye`, turned by `yaw` about y; square pixels, focal length `focal` in half heights.
struct Camera
{
  Vec3d eye;
  double yaw = 0, focal = 2;

  Mat4 toCamera() const
  {
    Mat4 r;
    const double c = std::cos(yaw), s = std::sin(yaw);
    r.m[0][0] = c;
    r.m[0][2] = -s;
    r.m[2][0] = s;
    r.m[2][2] = c;
    for (int i = 0; i < 3; ++i)
      r.m[i][3] = -(r.m[i][0] * eye.x + r.m[i][1] * eye.y + r.m[i][2] * eye.z);
    return r;
  }
  Mat4 toNdc(double aspect) const
  {
    Mat4 p;
    p.m[0][0] = focal / aspect;
    p.m[1][1] = focal;
    p.m[2][2] = -1; // a near plane of 0: its row is not needed
    p.m[2][3] = 0;
    p.m[3][2] = -1;
    p.m[3][3] = 0;
    return p * toCamera();
  }
  ViewGeometry view(const Rect& frame, const Vec3d& offset = Vec3d()) const
  {
    return { toNdc(double(frame.width()) / frame.height()), toCamera(), offset };
  }
};

/// A whole previous and current frame, all of one surface unless a test changes it.
struct TwoFrames
{
  Rect frame;
  Picture depth, normal, id, motion, history, moments, length, previousDepth, previousNormal, previousId;
  Picture color, outMoments, outLength, mask;
  ReprojectInputs in;
  ReprojectParameters par;

  explicit TwoFrames(int w, int h)
    : frame{ 0, 0, w, h }
  {
    depth = previousDepth = Picture(frame, 1, 5);
    normal = Picture(frame, 3);
    normal.fill([](int, int, float* v) { v[2] = 1; });
    previousNormal = normal;
    id = previousId = Picture(frame, 1, 1);
    motion = Picture(frame, 2);
    history = Picture(frame, 3);
    history.fill(
      [](int x, int y, float* v)
      {
        v[0] = float(x);
        v[1] = float(y);
        v[2] = float(1 + (x * 7 + y * 13) % 11);
      });
    moments = Picture(frame, 2, 1);
    length = Picture(frame, 1, 3);
    color = Picture(frame, 3, -7);
    outMoments = Picture(frame, 2, -7);
    outLength = mask = Picture(frame, 1, -7);
    in.frame = frame;
  }
  void connect()
  {
    in.depth = depth.in();
    in.normal = normal.in();
    in.id = id.in();
    in.motion = motion.in();
    in.history = history.in();
    in.moments = moments.in();
    in.length = length.in();
    in.previousDepth = previousDepth.in();
    in.previousNormal = previousNormal.in();
    in.previousId = previousId.in();
  }
  void run() { Reproject(in, par, { color.out(), outMoments.out(), outLength.out(), mask.out() }, frame); }
  void move(double x, double y)
  {
    motion.fill(
      [&](int, int, float* v)
      {
        v[0] = float(x);
        v[1] = float(y);
      });
  }
  int maskAt(int x, int y) { return int(*mask.at(x, y)); }
};
}

TEST(Reproject, RenormalisesValidTaps)
{
  // Taps (1, 2, 3, 4) at t = (.25, .5), the second invalid: 2 / 0.875.
  for (int why = 0; why < 6; ++why)
  {
    TwoFrames s(4, 4);
    s.history.fill([](int x, int y, float* v) { v[0] = v[1] = v[2] = float(1 + (x & 1) + 2 * (y & 1)); });
    s.move(0.25, 0.5);
    switch (why)
    {
      case 0:
        *s.previousId.at(1, 0) = 9;
        break;
      case 1:
        *s.previousDepth.at(1, 0) = 6;
        break;
      case 2:
        *s.previousDepth.at(1, 0) = Inf;
        break;
      case 3:
        s.previousNormal.at(1, 0)[2] = -1;
        break;
      case 4:
        s.history.at(1, 0)[1] = NaN;
        break;
      case 5:
        *s.length.at(1, 0) = 0;
        break;
    }
    s.connect();
    s.run();
    EXPECT_NEAR(s.color.at(0, 0)[0], 2.2857143, 5e-7) << why;
    EXPECT_EQ(s.maskAt(0, 0), int(ReprojectMask::SomeTaps)) << why;
    EXPECT_EQ(*s.outLength.at(0, 0), 3) << why;
    // All four valid elsewhere: at (0, 2) the plain bilinear value 1.25 (row 2) to 3.25 (row 3).
    EXPECT_NEAR(s.color.at(0, 2)[0], 2.25, 1e-6) << why;
    EXPECT_EQ(s.maskAt(0, 2), 0) << why;
  }
}

TEST(Reproject, IdentityIsBitExact)
{
  TwoFrames s(9, 7);
  const float values[] = { 1e-42f, 0.1f, 1e30f, 3.14159274f, 0, -0.25f };
  int k = 0;
  s.history.fill(
    [&](int, int, float* v)
    {
      for (int c = 0; c < 3; ++c)
        v[c] = values[k++ % 6];
    });
  s.moments.fill(
    [&](int, int, float* v)
    {
      v[0] = values[k++ % 6];
      v[1] = 0.3f;
    });
  s.length.fill([&](int x, int, float* v) { *v = 1 + x + 0.3f; });
  s.depth.fill([](int x, int y, float* v) { *v = 3 + 0.01f * x + 0.002f * y; });
  s.previousDepth = s.depth;
  *s.depth.at(4, 4) = *s.previousDepth.at(4, 4) = Inf;
  s.par.backgroundHistory = true;
  const Camera camera{ { 0.3, -12, 7.7 }, 0.4 };
  for (bool byCamera : { false, true })
  {
    s.connect();
    s.in.current = s.in.previous = camera.view(s.frame);
    if (byCamera)
      s.in.motion = ImageIn();
    s.run();
    EXPECT_EQ(0, std::memcmp(s.color.data.data(), s.history.data.data(), s.color.data.size() * 4)) << byCamera;
    EXPECT_EQ(s.outMoments.data, s.moments.data) << byCamera;
    EXPECT_EQ(s.outLength.data, s.length.data) << byCamera;
    EXPECT_EQ(s.mask.data, std::vector<float>(s.mask.data.size(), 0.f)) << byCamera;
  }
}

TEST(Reproject, ShiftsByFractionsAndUsesFloor)
{
  // The history is its own coordinate, so a bilinear fetch at q returns q.
  for (double mx : { -1.75, -0.5, -0.25, 0.125, 0.5, 2.625 })
  {
    TwoFrames s(16, 8);
    s.move(mx, 0.375);
    s.connect();
    s.run();
    for (int x = 3; x < 13; ++x)
    {
      EXPECT_FLOAT_EQ(s.color.at(x, 3)[0], float(x + mx)) << mx;
      EXPECT_FLOAT_EQ(s.color.at(x, 3)[1], 3.375f) << mx;
    }
  }
  // Left of column 0 only the right tap exists; truncation would read column 0 with a negative fraction.
  TwoFrames s(4, 4);
  s.move(-0.25, 0);
  s.connect();
  s.run();
  EXPECT_EQ(s.color.at(0, 1)[0], 0);
  EXPECT_EQ(s.maskAt(0, 1), int(ReprojectMask::SomeTaps));
  s.move(-1, 0);
  s.run();
  EXPECT_EQ(s.maskAt(0, 1), int(ReprojectMask::OffScreen));
  EXPECT_EQ(*s.outLength.at(0, 1), 0);
  EXPECT_EQ(s.color.at(1, 1)[0], 0);
  EXPECT_EQ(s.maskAt(1, 1), 0);
}

TEST(Reproject, WildMotionIsOffScreen)
{
  for (float m : { 1e9f, -1e9f, 3e38f, NaN, Inf, -Inf })
  {
    TwoFrames s(4, 4);
    s.motion.at(2, 2)[0] = m;
    s.motion.at(1, 2)[1] = m;
    s.connect();
    s.run();
    for (int x : { 1, 2 })
    {
      EXPECT_EQ(s.maskAt(x, 2), int(ReprojectMask::OffScreen)) << m;
      EXPECT_EQ(*s.outLength.at(x, 2), 0) << m;
      EXPECT_EQ(s.color.at(x, 2)[2], 0) << m;
      EXPECT_EQ(s.outMoments.at(x, 2)[1], 0) << m;
    }
    EXPECT_EQ(s.maskAt(3, 2), 0);
  }
}

TEST(Reproject, FirstFrameSaysSo)
{
  TwoFrames s(3, 3);
  s.connect();
  s.in.history = ImageIn();
  s.run();
  EXPECT_EQ(s.mask.data, std::vector<float>(9, 3.f));
  EXPECT_EQ(s.color.data, std::vector<float>(27, 0.f));
  EXPECT_EQ(s.outLength.data, std::vector<float>(9, 0.f));
}

TEST(Reproject, MixOfMomentsAddsTheSpreadOfMeans)
{
  TwoFrames s(4, 4);
  s.moments.fill(
    [](int x, int y, float* v)
    {
      v[0] = float(10 * x + y);
      v[1] = float(1 + x * y);
    });
  s.move(0.25, 0.5);
  s.connect();
  s.run();
  // Mixture of four populations, computed through raw moments.
  const double w[4] = { 0.375, 0.125, 0.375, 0.125 }, mean[4] = { 11, 21, 12, 22 }, m2[4] = { 2, 3, 3, 5 };
  double first = 0, raw = 0;
  for (int i = 0; i < 4; ++i)
  {
    first += w[i] * mean[i];
    raw += w[i] * (m2[i] + mean[i] * mean[i]);
  }
  EXPECT_FLOAT_EQ(s.outMoments.at(1, 1)[0], float(first));
  EXPECT_FLOAT_EQ(s.outMoments.at(1, 1)[1], float(raw - first * first));
}

TEST(Reproject, NonFiniteHistoryIsReplacedByItsNeighbours)
{
  TwoFrames s(8, 8);
  for (int c = 0; c < 3; ++c)
    s.history.at(4, 4)[c] = NaN;
  s.moments.at(2, 2)[1] = Inf;
  s.connect();
  s.run();
  EXPECT_EQ(s.maskAt(4, 4), int(ReprojectMask::Neighbourhood));
  EXPECT_EQ(s.color.at(4, 4)[0], 4); // mean of the eight around it
  EXPECT_EQ(s.color.at(4, 4)[1], 4);
  EXPECT_EQ(s.maskAt(2, 2), int(ReprojectMask::Neighbourhood));
  for (const Picture* p : { &s.color, &s.outMoments, &s.outLength })
    for (float v : p->data)
      EXPECT_TRUE(std::isfinite(v));
  int touched = 0;
  for (float m : s.mask.data)
    touched += m != 0;
  EXPECT_EQ(touched, 2);
}

TEST(Reproject, ReasonsAreReported)
{
  const auto reason = [](const std::function<void(TwoFrames&)>& spoil)
  {
    TwoFrames s(8, 8);
    spoil(s);
    s.connect();
    s.run();
    EXPECT_EQ(*s.outLength.at(4, 4), 0);
    return ReprojectMask(s.maskAt(4, 4));
  };
  EXPECT_EQ(reason([](TwoFrames& s) { s.previousDepth = Picture(s.frame, 1, Inf); }), ReprojectMask::HitDiffers);
  EXPECT_EQ(reason([](TwoFrames& s) { s.depth = Picture(s.frame, 1, Inf); }), ReprojectMask::Background);
  const auto kept = [](TwoFrames& s)
  {
    s.depth = Picture(s.frame, 1, Inf);
    s.par.backgroundHistory = true;
  };
  EXPECT_EQ(reason(kept), ReprojectMask::HitDiffers);
  EXPECT_EQ(reason([](TwoFrames& s) { s.previousId = Picture(s.frame, 1, 2); }), ReprojectMask::IdDiffers);
  EXPECT_EQ(reason([](TwoFrames& s) { s.previousDepth = Picture(s.frame, 1, 9); }), ReprojectMask::DepthDiffers);
  EXPECT_EQ(reason([](TwoFrames& s) { s.previousNormal = Picture(s.frame, 3, 0.577f); }), ReprojectMask::NormalDiffers);
  EXPECT_EQ(reason([](TwoFrames& s) { s.length = Picture(s.frame, 1, 0); }), ReprojectMask::BadHistory);
  EXPECT_EQ(reason([](TwoFrames& s) { s.length = Picture(s.frame, 1, NaN); }), ReprojectMask::BadHistory);
}

TEST(Reproject, NormalThresholdIsACosine)
{
  for (double degrees : { 20., 25.8, 25.9, 40. })
  {
    TwoFrames s(5, 5);
    s.par.normalThreshold = 0.9; // 25.842 degrees
    const double a = degrees * 3.14159265358979 / 180;
    s.previousNormal.fill(
      [&](int, int, float* v)
      {
        // Averages of normals are shorter than 1; only the angle counts.
        v[0] = float(0.5 * std::sin(a));
        v[2] = float(0.5 * std::cos(a));
      });
    s.connect();
    s.run();
    EXPECT_EQ(s.maskAt(2, 2) == 0, degrees < 25.842) << degrees;
  }
}

TEST(Reproject, CameraSidewaysOverAWall)
{
  // A wall at depth 10 seen by a camera that moved by (0.3, -0.1): the image moves by focal * shift / depth half
  // heights.
  TwoFrames s(32, 16);
  s.depth = s.previousDepth = Picture(s.frame, 1, 10);
  s.connect();
  s.in.motion = ImageIn();
  const Camera now{ { 0.3, -0.1, 0 } }, then{ { 0, 0, 0 } };
  s.in.current = now.view(s.frame);
  s.in.previous = then.view(s.frame);
  s.run();
  const double dx = 2 * 0.3 / 10 * 8, dy = 2 * -0.1 / 10 * 8; // half height = 8 pixels
  for (int y = 2; y < 14; ++y)
    for (int x = 2; x < 30; ++x)
    {
      EXPECT_NEAR(s.color.at(x, y)[0], x + dx, 1e-5);
      EXPECT_NEAR(s.color.at(x, y)[1], y + dy, 1e-5);
      EXPECT_EQ(s.maskAt(x, y), 0);
    }
}

TEST(Reproject, DepthIsExpectedInThePreviousCamera)
{
  // The camera went from 12 units off the wall to 10: depth changed by 20 %, the wall did not.
  TwoFrames s(32, 32);
  s.depth = Picture(s.frame, 1, 10);
  s.previousDepth = Picture(s.frame, 1, 12);
  const Camera now{ { 0, 0, 0 } }, then{ { 0, 0, 2 } };
  for (bool withMotion : { false, true })
  {
    s.motion.fill(
      [](int x, int y, float* v)
      {
        v[0] = float((x - 15.5) * (10. / 12 - 1));
        v[1] = float((y - 15.5) * (10. / 12 - 1));
      });
    s.connect();
    if (!withMotion)
      s.in.motion = ImageIn();
    s.in.current = now.view(s.frame);
    s.in.previous = then.view(s.frame);
    s.previousDepth = Picture(s.frame, 1, 12);
    s.in.previousDepth = s.previousDepth.in();
    s.run();
    EXPECT_EQ(s.maskAt(5, 9), 0) << withMotion;
    EXPECT_NEAR(s.color.at(5, 9)[0], 15.5 - 10.5 * 10 / 12, 1e-5) << withMotion;
    EXPECT_EQ(s.maskAt(28, 2), 0) << withMotion;
    // What was at the current depth then is something else, 2 units in front of the wall.
    s.previousDepth = Picture(s.frame, 1, 10);
    s.in.previousDepth = s.previousDepth.in();
    s.run();
    EXPECT_EQ(s.maskAt(5, 9), int(ReprojectMask::DepthDiffers)) << withMotion;
  }
}

TEST(Reproject, SlopedSurfaceIsAcceptedAndAStepIsNot)
{
  // Depth grows by 0.5 a pixel: neighbours differ by 10 % and are still the same surface.
  TwoFrames s(16, 16);
  s.depth.fill([](int x, int, float* v) { *v = 5 + 0.5f * x; });
  s.previousDepth = s.depth;
  s.move(0.6, 0);
  s.par.movingDepthTolerance = 0;
  s.connect();
  s.run();
  EXPECT_EQ(s.maskAt(7, 7), 0);
  // A step between columns 7 and 8 of flat surfaces: the slope must not be taken across it.
  s.depth.fill([](int x, int, float* v) { *v = x < 8 ? 5.f : 7.f; });
  s.previousDepth = s.depth;
  s.connect();
  s.in.id = s.in.previousId = ImageIn();
  s.run();
  EXPECT_EQ(s.maskAt(7, 7), int(ReprojectMask::SomeTaps));
  EXPECT_EQ(s.color.at(7, 7)[0], 7);
}

TEST(Reproject, MovingObjectMayChangeItsDepth)
{
  // A still camera; the object moved 2 pixels sideways and from depth 5 to 5.25.
  const Camera camera{ { 0, 0, 0 } };
  for (bool ids : { true, false })
  {
    TwoFrames s(16, 16);
    s.depth = Picture(s.frame, 1, 5.25f);
    s.move(-2, 0);
    s.connect();
    s.in.current = s.in.previous = camera.view(s.frame);
    if (!ids)
      s.in.id = s.in.previousId = ImageIn();
    s.run();
    // 2 pixels at that depth are 2 / 8 * 5.25 / 2 = 0.66 units: enough without ids, too.
    EXPECT_EQ(s.maskAt(8, 8), 0) << ids;
    // 0.2 pixels are 0.066 units: with ids a tenth of the depth is allowed, without them the move is not believed.
    s.move(-0.2, 0);
    s.run();
    EXPECT_EQ(s.maskAt(8, 8) == 0, ids);
    // A point that did not move (other than by the camera) has no slack at all.
    s.move(0, 0);
    s.run();
    EXPECT_EQ(s.maskAt(8, 8), int(ReprojectMask::DepthDiffers)) << ids;
  }
}

namespace
{
/// A square of half size 1 at depth plane z = -6 with centre (cx, 0) before a wall at z = -10.
struct TwoPlanes
{
  double cx = 0;
  bool hitsSquare(const Vec3d& eye, const Vec3d& d) const
  {
    const double t = (-6 - eye.z) / d.z;
    return std::fabs(eye.x + t * d.x - cx) < 1 && std::fabs(eye.y + t * d.y) < 1;
  }
};
Vec3d RayOf(const Camera& c, const Rect& f, double x, double y)
{
  const double h = 0.5 * f.height();
  return { (x + 0.5 - 0.5 * f.width()) / h / c.focal, (y + 0.5 - h) / h / c.focal, -1 };
}
void Trace(const TwoPlanes& scene, const Camera& c, const Rect& f, Picture& depth, Picture& id)
{
  depth = id = Picture(f, 1);
  depth.fill(
    [&](int x, int y, float* v)
    {
      const bool square = scene.hitsSquare(c.eye, RayOf(c, f, x, y));
      *v = float(c.eye.z + (square ? 6 : 10));
      *id.at(x, y) = square ? 2 : 1;
    });
}
/// Checks every pixel whose 5 x 5 (now) and 3 x 3 (then) are of one surface against visibility by ray casting.
void CheckDisocclusion(
  const TwoPlanes& before, const TwoPlanes& after, const Camera& then, const Camera& now, bool withMotion, bool withIds)
{
  TwoFrames s(64, 64);
  Trace(before, then, s.frame, s.previousDepth, s.previousId);
  Trace(after, now, s.frame, s.depth, s.id);
  // History: the surface's id, so that a wrong surface shows.
  s.history.fill([&](int x, int y, float* v) { v[0] = v[1] = v[2] = *s.previousId.at(x, y); });
  const auto pixelThen = [&](int x, int y, double& qx, double& qy)
  {
    const Vec3d d = RayOf(now, s.frame, x, y);
    const double z = *s.depth.at(x, y);
    Vec3d p = now.eye + d * z;
    if (*s.id.at(x, y) == 2)
      p.x += before.cx - after.cx;
    qx = (p.x - then.eye.x) / (then.eye.z - p.z) * then.focal * 32 + 31.5;
    qy = (p.y - then.eye.y) / (then.eye.z - p.z) * then.focal * 32 + 31.5;
  };
  s.motion.fill(
    [&](int x, int y, float* v)
    {
      double qx, qy;
      pixelThen(x, y, qx, qy);
      v[0] = float(qx - x);
      v[1] = float(qy - y);
    });
  s.connect();
  s.in.current = now.view(s.frame);
  s.in.previous = then.view(s.frame);
  if (!withMotion)
    s.in.motion = ImageIn();
  if (!withIds)
    s.in.id = s.in.previousId = ImageIn();
  s.run();
  int kept = 0, lost = 0;
  for (int y = 3; y < 61; ++y)
    for (int x = 3; x < 61; ++x)
    {
      double qx, qy;
      pixelThen(x, y, qx, qy);
      const int rx = int(std::floor(qx + 0.5)), ry = int(std::floor(qy + 0.5));
      if (rx < 2 || ry < 2 || rx > 61 || ry > 61)
        continue;
      bool clear = true;
      for (int j = -2; j <= 2; ++j)
        for (int i = -2; i <= 2; ++i)
          clear = clear && *s.previousId.at(rx + i, ry + j) == *s.previousId.at(rx, ry);
      if (!clear)
        continue;
      const bool visible = *s.previousId.at(rx, ry) == *s.id.at(x, y);
      (visible ? kept : lost)++;
      EXPECT_EQ(*s.outLength.at(x, y) > 0, visible) << x << " " << y;
      if (visible)
      {
        EXPECT_EQ(s.color.at(x, y)[0], *s.id.at(x, y)) << x << " " << y;
      }
    }
  EXPECT_GT(kept, 1000);
  EXPECT_GT(lost, 20);
}
}

TEST(Reproject, MovingCameraUncoversTheWall)
{
  const TwoPlanes scene;
  for (bool motion : { false, true })
    for (bool ids : { false, true })
      CheckDisocclusion(scene, scene, { { -0.8, 0, 0 } }, { { 0.4, 0.2, 0.5 } }, motion, ids);
}

TEST(Reproject, MovingObjectUncoversTheWall)
{
  TwoPlanes before, after;
  before.cx = -0.7;
  after.cx = 0.5;
  for (bool ids : { false, true })
    CheckDisocclusion(before, after, { { 0, 0, 0 } }, { { 0, 0, 0 } }, true, ids);
}

TEST(Reproject, BackgroundMovesWithRotationOnly)
{
  TwoFrames s(32, 32);
  s.par.backgroundHistory = true;
  s.depth = s.previousDepth = Picture(s.frame, 1, Inf);
  s.id = s.previousId = Picture(s.frame, 1, 0);
  s.normal = s.previousNormal = Picture(s.frame, 3, 0);
  s.connect();
  s.in.motion = ImageIn();
  // A translation leaves it in place.
  s.in.current = Camera{ { 3, 1, 2 } }.view(s.frame);
  s.in.previous = Camera{ { 0, 0, 0 } }.view(s.frame);
  s.run();
  EXPECT_NEAR(s.color.at(11, 20)[0], 11, 1e-5);
  EXPECT_EQ(*s.outLength.at(11, 20), 3);
  // A rotation about the vertical moves the centre column by focal * tan(yaw) half heights.
  s.in.current = Camera{ { 3, 1, 2 }, 0.1 }.view(s.frame);
  s.run();
  const double d = std::atan((11 + 0.5 - 16) / 16. / 2) - 0.1;
  EXPECT_NEAR(s.color.at(11, 16)[0], 16 + 16 * 2 * std::tan(d) - 0.5, 1e-4);
}

// Whole vectors of background, its edge, and scalar code: nothing is fetched there, whatever the history holds.
TEST(Reproject, BackgroundHasNoHistory)
{
  TwoFrames s(300, 6);
  s.depth.fill([](int x, int, float* z) { *z = x < 150 || x == 270 ? 3.f : Inf; });
  s.previousDepth = s.depth;
  s.previousDepth.at(10, 2)[0] = Inf; // a surface does not take the background's history either
  s.move(0.4, 0);
  for (const bool camera : { false, true }) // by motion: vectors; by cameras alone: scalar
  {
    s.connect();
    if (camera)
    {
      s.in.motion = ImageIn();
      s.in.current = s.in.previous = Camera{ { 0, 0, 0 } }.view(s.frame);
    }
    quelltest::ForEachTarget(
      [&](const char* name)
      {
        s.run();
        for (int y = 0; y < 6; ++y)
          for (int x = 0; x < 300; ++x)
          {
            const bool hit = x < 150 || x == 270;
            ASSERT_EQ(*s.outLength.at(x, y) > 0, hit) << name << " " << x << " " << y;
            if (!hit)
            {
              ASSERT_EQ(s.maskAt(x, y), int(ReprojectMask::Background)) << name << " " << x;
              ASSERT_EQ(s.color.at(x, y)[0], 0.f) << name << " " << x;
              ASSERT_EQ(s.outMoments.at(x, y)[1], 0.f) << name << " " << x;
            }
          }
      });
  }
}

TEST(Reproject, PointsBehindThePreviousCameraAreInvalid)
{
  TwoFrames s(8, 8);
  s.connect();
  s.in.motion = ImageIn();
  s.in.current = Camera{ { 0, 0, 0 } }.view(s.frame);
  s.in.previous = Camera{ { 0, 0, -8 } }.view(s.frame); // beyond the surface at depth 5, looking on
  s.run();
  EXPECT_EQ(s.mask.data, std::vector<float>(64, 5.f));
  EXPECT_EQ(s.outLength.data, std::vector<float>(64, 0.f));
}

TEST(Reproject, SingularCamerasAreInvalid)
{
  const Mat4 identity;
  Mat4 flat = Camera().toNdc(1);
  for (double& v : flat.m[0])
    v = 0;
  Mat4 broken = Camera().toNdc(1);
  broken.m[1][1] = NaN;
  Mat4 huge = Camera().toNdc(1);
  huge.m[0][3] = std::numeric_limits<double>::infinity();
  for (const Mat4& m : { flat, broken, huge })
  {
    EXPECT_FALSE(ViewGeometry(m, identity).IsValid());
    TwoFrames s(4, 4);
    s.connect();
    s.in.motion = ImageIn();
    s.in.current = s.in.previous = ViewGeometry(m, identity);
    s.run();
    EXPECT_EQ(s.mask.data, std::vector<float>(16, 5.f));
  }
  EXPECT_TRUE(ViewGeometry(Camera().toNdc(1), identity).IsValid());
}

TEST(Reproject, UnprojectInvertsProject)
{
  const Rect f{ 0, 0, 40, 30 };
  Mat4 parallel, toCamera = Camera{ { 1, 2, 30 }, 0.3 }.toCamera();
  parallel.m[0][0] = 0.1;
  parallel.m[1][1] = 0.15;
  Mat4 shifted = Camera().toNdc(4. / 3); // a lens shift far to the side
  shifted.m[0][2] = -3;
  const ViewGeometry views[] = { Camera{ { 1, 2, 30 }, 0.3 }.view(f), { parallel * toCamera, toCamera },
    Camera{ { 1, 2, 30 }, 0.3 }.view(f, { 100, -50, 3 }), { shifted * toCamera, toCamera } };
  for (const ViewGeometry& v : views)
  {
    ASSERT_TRUE(v.IsValid());
    for (double z : { 0.01, 1., 1e5 })
    {
      double x, y, depth;
      ASSERT_TRUE(v.Project(v.Unproject(0.3, -0.7, z), x, y, depth));
      EXPECT_NEAR(x, 0.3, 1e-9);
      EXPECT_NEAR(y, -0.7, 1e-9);
      EXPECT_NEAR(depth, z, 1e-9 * (1 + z));
    }
  }
}

TEST(Reproject, OriginsMayDiffer)
{
  // The same two cameras, the previous one given relative to an origin shifted by (1000, 0, -500).
  TwoFrames s(16, 16);
  s.connect();
  s.in.motion = ImageIn();
  const Camera now{ { 0.2, 0, 0 } };
  s.in.current = now.view(s.frame);
  s.in.previous = Camera{ { 0, 0, 0 } }.view(s.frame);
  s.run();
  const std::vector<float> plain = s.color.data;
  s.in.previous = Camera{ { -1000, 0, 500 } }.view(s.frame, Vec3d(0, 0, 0) - Vec3d(1000, 0, -500));
  s.run();
  for (std::size_t i = 0; i < plain.size(); ++i)
    EXPECT_NEAR(s.color.data[i], plain[i], 1e-4);
  EXPECT_EQ(s.maskAt(8, 8), 0);
}

TEST(Reproject, CatmullRomKeepsALineAndDoesNotOvershoot)
{
  TwoFrames s(16, 16);
  s.par.catmullRom = true;
  s.move(0.5, 0.25);
  s.connect();
  s.run();
  EXPECT_FLOAT_EQ(s.color.at(7, 7)[0], 7.5f);
  EXPECT_FLOAT_EQ(s.color.at(7, 7)[1], 7.25f);
  // A one pixel wide line loses less than with the bilinear filter; a step does not ring.
  s.history.fill(
    [](int x, int, float* v)
    {
      v[0] = x == 8 ? 1.f : 0.f;
      v[1] = x >= 8 ? 1.f : 0.f;
    });
  s.run();
  EXPECT_NEAR(s.color.at(8, 7)[0], 9. / 16, 1e-6);
  for (int x = 2; x < 13; ++x)
  {
    EXPECT_GE(s.color.at(x, 7)[1], 0);
    EXPECT_LE(s.color.at(x, 7)[1], 1);
  }
}

TEST(Reproject, CropsAndTilesGiveTheSameBits)
{
  TwoFrames s(40, 30);
  s.depth.fill([](int x, int y, float* v) { *v = (x / 7 + y / 5) % 3 == 0 ? 5.f : 5 + 0.1f * x; });
  s.previousDepth = s.depth;
  s.move(0.37, -0.61);
  s.connect();
  s.run();
  const Rect tile{ 11, 6, 29, 21 };
  Picture color(tile, 3), mask(tile, 1);
  const Picture depth = s.depth.crop(tile.grown(1)), id = s.id.crop(tile.grown(1)), normal = s.normal.crop(tile),
                motion = s.motion.crop(tile);
  s.in.depth = depth.in();
  s.in.id = id.in();
  s.in.normal = normal.in();
  s.in.motion = motion.in();
  Reproject(s.in, s.par, { color.out(), {}, {}, mask.out() }, { 11, 6, 20, 21 });
  Reproject(s.in, s.par, { color.out(), {}, {}, mask.out() }, { 20, 6, 29, 21 });
  EXPECT_EQ(color.data, s.color.crop(tile).data);
  EXPECT_EQ(mask.data, s.mask.crop(tile).data);
}

namespace
{
/// Two noisy frames with everything in them: slopes, edges, ids, background, fractional and whole motion, bad history.
void MakeWild(TwoFrames& s, bool smooth)
{
  quelltest::Random u(11);
  for (int y = 0; y < s.frame.y1; ++y)
    for (int x = 0; x < s.frame.x1; ++x)
    {
      const int surface = (x / 37 + y / 11) % 3;
      const bool sky = (x / 90) % 7 == 3;
      for (Picture* depth : { &s.depth, &s.previousDepth })
        *depth->at(x, y) = sky ? Inf : 4.f + 2 * surface + 0.01f * float(x % 50) + 0.002f * u();
      for (Picture* id : { &s.id, &s.previousId })
        *id->at(x, y) = sky ? 0.f : float(1 + surface);
      for (Picture* normal : { &s.normal, &s.previousNormal })
      {
        const float a = 0.4f * u();
        normal->at(x, y)[0] = sky ? 0.f : std::sin(a);
        normal->at(x, y)[2] = sky ? 0.f : std::cos(a);
      }
      s.motion.at(x, y)[0] = smooth ? 3.3f + 0.002f * float(x % 400) : u() < 0.3f ? 0.f : 8 * u() - 4;
      s.motion.at(x, y)[1] = smooth ? -1.4f : u() < 0.3f ? 0.f : 8 * u() - 4;
      for (int c = 0; c < 3; ++c)
        s.history.at(x, y)[c] = (u() < 0.02f ? 1e4f : 1.f) * (0.1f + u());
      s.moments.at(x, y)[0] = 0.2f + u();
      s.moments.at(x, y)[1] = u();
      *s.length.at(x, y) = std::floor(9 * u());
      if (u() < 0.002f)
        s.history.at(x, y)[1] = u() < 0.5f ? NaN : 3e30f;
    }
  s.connect();
}
}

// Also at the coordinates of a 4K frame, where q itself would have lost four digits in float.
TEST(Reproject, ScalarAgreesWithEveryTarget)
{
  for (const bool smooth : { false, true })
    for (const bool cameras : { false, true })
      for (const bool ids : { false, true })
      {
        TwoFrames s(3840, 24);
        MakeWild(s, smooth);
        if (!ids)
          s.in.id = s.in.previousId = ImageIn();
        if (cameras)
        {
          s.in.current = Camera{ { 0.02, 0.01, 0 } }.view(s.frame);
          s.in.previous = Camera{ { 0, 0, 0.01 } }.view(s.frame);
        }
        ReprojectScalar(s.in, s.par, { s.color.out(), s.outMoments.out(), s.outLength.out(), s.mask.out() }, s.frame);
        const TwoFrames scalar = s;
        int used = 0;
        for (float m : scalar.mask.data)
          used += m < 2;
        EXPECT_GT(used, 3840 * 24 / 8);
        quelltest::ForEachTarget(
          [&](const char* name)
          {
            s.run();
            // A comparison with a tolerance may turn where both sides are equal to seven digits.
            int turned = 0;
            for (std::size_t i = 0; i < s.mask.data.size(); ++i)
              if (s.mask.data[i] != scalar.mask.data[i])
              {
                ++turned;
                std::copy_n(&scalar.color.data[3 * i], 3, &s.color.data[3 * i]);
                std::copy_n(&scalar.outMoments.data[2 * i], 2, &s.outMoments.data[2 * i]);
                s.outLength.data[i] = scalar.outLength.data[i];
              }
            EXPECT_LE(turned, 2) << name;
            for (const auto& pair : { std::make_pair(&s.color, &scalar.color),
                   std::make_pair(&s.outMoments, &scalar.outMoments), std::make_pair(&s.outLength, &scalar.outLength) })
            {
              const quelltest::Difference e = quelltest::Compare(pair.first->data, pair.second->data);
              EXPECT_LT(e.relative, 1e-5) << name << " " << smooth << cameras << ids;
              EXPECT_LT(e.smape, 1e-6) << name;
            }
          });
      }
}

TEST(Reproject, AnyTilesGiveTheSameBits)
{
  for (const bool smooth : { false, true })
  {
    TwoFrames whole(300, 50);
    MakeWild(whole, smooth);
    whole.in.current = whole.in.previous = Camera{ { 0.02, 0.01, 0 } }.view(whole.frame);
    whole.run();
    TwoFrames tiled = whole;
    tiled.connect();
    for (const int size : { 7, 33, 64, 131 })
    {
      for (int y = 0; y < 50; y += size)
        for (int x = 0; x < 300; x += size)
          Reproject(tiled.in, tiled.par,
            { tiled.color.out(), tiled.outMoments.out(), tiled.outLength.out(), tiled.mask.out() },
            Rect{ x, y, x + size, y + size }.clipped(whole.frame));
      EXPECT_EQ(0, std::memcmp(tiled.color.data.data(), whole.color.data.data(), whole.color.data.size() * 4)) << size;
      EXPECT_EQ(tiled.outMoments.data, whole.outMoments.data) << size;
      EXPECT_EQ(tiled.outLength.data, whole.outLength.data) << size;
      EXPECT_EQ(tiled.mask.data, whole.mask.data) << size;
    }
  }
}
