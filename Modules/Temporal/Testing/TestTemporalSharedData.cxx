// SPDX-License-Identifier: BSD-3-Clause
// Frames of other renderers, where the shared test data lie beside the checkout.
#include "quellAccumulate.h"
#include "quellImageMetrics.h"
#include "quellReproject.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

using namespace quell;

namespace
{
const std::string Room = QUELL_SHARED_DATA "/denoise-cycles-room/";
const std::string Box = QUELL_SHARED_DATA "/denoise-games202-3frames/input/";

struct Picture
{
  int w = 0, h = 0, c = 0;
  std::vector<float> data;
  Picture() = default;
  Picture(int width, int height, int channels)
    : w(width)
    , h(height)
    , c(channels)
    , data(std::size_t(width) * height * channels)
  {
  }
  Rect extent() const { return { 0, 0, w, h }; }
  ImageIn in() const { return data.empty() ? ImageIn() : ImageIn(data.data(), c, this->extent()); }
  ImageOut out() { return { data.data(), c, this->extent() }; }
};

/// A whole file, from which channels are taken by name with row 0 at the bottom.
struct File
{
  OIIO::ImageSpec spec;
  std::vector<float> all;

  explicit File(const std::string& name)
  {
    auto in = OIIO::ImageInput::open(name);
    if (!in)
      return;
    spec = in->spec();
    all.resize(std::size_t(spec.width) * spec.height * spec.nchannels);
    in->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, all.data());
  }
  Picture get(const std::vector<std::string>& channels) const
  {
    Picture p(spec.width, spec.height, int(channels.size()));
    for (int k = 0; k < p.c; ++k)
    {
      const int from = spec.channelindex(channels[k]);
      EXPECT_GE(from, 0) << channels[k];
      for (int y = 0; y < p.h; ++y)
        for (int x = 0; x < p.w; ++x)
          p.out().at(x, p.h - 1 - y)[k] = all[(std::size_t(y) * p.w + x) * spec.nchannels + std::max(from, 0)];
    }
    return p;
  }
};

struct State
{
  Picture depth, normal, id, color, moments, length;
};

double RelMse(const Picture& test, const Picture& reference)
{
  double sum = 0;
  for (int y = 0; y < test.h; ++y)
    sum += ErrorRowSum(PixelError::RelativeSquared, test.in(), reference.in(), y);
  return sum / (double(test.w) * test.h);
}

/// Reprojects `before` onto `now` (unless there is none) and accumulates `radiance` into now.color; returns the mask.
Picture Step(const State& before, State& now, const Picture& radiance, ReprojectInputs in)
{
  const int w = radiance.w, h = radiance.h;
  Picture color(w, h, 3), moments(w, h, 2), length(w, h, 1), mask(w, h, 1);
  in.frame = radiance.extent();
  in.depth = now.depth.in();
  in.normal = now.normal.in();
  in.id = now.id.in();
  in.history = before.color.in();
  in.moments = before.moments.in();
  in.length = before.length.in();
  in.previousDepth = before.depth.in();
  in.previousNormal = before.normal.in();
  in.previousId = before.id.in();
  Reproject(in, ReprojectParameters(), { color.out(), moments.out(), length.out(), mask.out() }, in.frame);
  now.color = Picture(w, h, 3);
  now.moments = Picture(w, h, 2);
  now.length = Picture(w, h, 1);
  Accumulate({ radiance.in(), color.in(), moments.in(), length.in() }, AccumulateParameters(),
    { now.color.out(), now.moments.out(), now.length.out() }, in.frame);
  return mask;
}
}

TEST(TemporalSharedData, CyclesRoomWithMovingCameraAndBlock)
{
  const File reference(Room + "reference.0008.exr");
  if (reference.all.empty())
    GTEST_SKIP() << "no shared data";
  const Picture truth = reference.get({ "R", "G", "B" });
  State before;
  Picture noisy, positionBefore;
  double history = 0, offset = 0, reversed = 0;
  for (int frame = 1; frame <= 8; ++frame)
  {
    const File file(Room + "noisy.000" + std::to_string(frame) + ".exr");
    const std::string v = "ViewLayer.";
    noisy = file.get({ v + "Combined.R", v + "Combined.G", v + "Combined.B" });
    State now;
    now.depth = file.get({ v + "Depth.Z" });
    for (float& z : now.depth.data)
      z = z > 1e9f ? std::numeric_limits<float>::infinity() : z;
    now.normal = file.get({ v + "Normal.X", v + "Normal.Y", v + "Normal.Z" });
    now.id = file.get({ v + "IndexOB.X" });
    Picture motion = file.get({ v + "Vector.X", v + "Vector.Y" });
    ReprojectInputs in;
    in.motion = motion.in();
    const Picture mask = Step(before, now, noisy, in);
    const Picture position = file.get({ v + "Position.X", v + "Position.Y", v + "Position.Z" });
    if (frame == 8)
    {
      int kept = 0, hit = 0;
      for (std::size_t i = 0; i < mask.data.size(); ++i)
      {
        kept += mask.data[i] < 3;
        hit += std::isfinite(now.depth.data[i]);
      }
      history = double(kept) / hit;
      // World positions instead of colour: on what stands still, they must come back as they are.
      State places = before;
      places.color = positionBefore;
      for (double* error : { &offset, &reversed })
      {
        Picture color(noisy.w, noisy.h, 3), m(noisy.w, noisy.h, 1);
        ReprojectInputs p = in;
        p.frame = noisy.extent();
        p.depth = now.depth.in();
        p.normal = now.normal.in();
        p.history = places.color.in();
        p.previousDepth = places.depth.in();
        p.previousNormal = places.normal.in();
        Reproject(p, ReprojectParameters(), { color.out(), {}, {}, m.out() }, p.frame);
        std::vector<double> distances;
        for (int i = 0; i < noisy.w * noisy.h; ++i)
          if (m.data[i] < 3 && std::isfinite(now.depth.data[i]))
            distances.push_back(std::hypot(color.data[3 * i] - position.data[3 * i],
              color.data[3 * i + 1] - position.data[3 * i + 1], color.data[3 * i + 2] - position.data[3 * i + 2]));
        std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
        *error = distances[distances.size() / 2];
        for (float& value : motion.data)
          value = -value;
      }
    }
    before = now;
    positionBefore = position;
  }
  const double raw = RelMse(noisy, truth), accumulated = RelMse(before.color, truth);
  std::printf(
    "relMSE raw %.4g, accumulated %.4g, ratio %.2f; %.1f %% of the surface pixels have history; median position error "
    "%.4g (motion reversed: %.4g)\n",
    raw, accumulated, raw / accumulated, 100 * history, offset, reversed);
  EXPECT_GT(history, 0.9);
  EXPECT_LT(accumulated, raw / 3);
  EXPECT_LT(offset, reversed / 3);
}

TEST(TemporalSharedData, BoxWithMovingBallByMatrices)
{
  if (File(Box + "depth_0.exr").all.empty())
    GTEST_SKIP() << "no shared data";
  // Seven object-to-world matrices, world to camera, world to screen (512 x 512 pixels, centres at .5), row-major.
  std::vector<Mat4> matrices[2];
  State frames[2];
  Picture position[2];
  for (int f = 0; f < 2; ++f)
  {
    const std::string n = std::to_string(f) + ".exr";
    frames[f].depth = File(Box + "depth_" + n).get({ "Y" });
    frames[f].id = File(Box + "ID_" + n).get({ "Y" });
    frames[f].normal = File(Box + "normal_" + n).get({ "R", "G", "B" });
    position[f] = File(Box + "position_" + n).get({ "R", "G", "B" });
    for (std::size_t i = 0; i < frames[f].id.data.size(); ++i)
      if (frames[f].id.data[i] < 0)
        frames[f].depth.data[i] = std::numeric_limits<float>::infinity();
    std::ifstream in(Box + "matrix_" + std::to_string(f) + ".mat", std::ios::binary);
    const std::vector<char> bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    ASSERT_EQ(bytes.size(), 4 + 9 * 64u);
    for (int k = 0; k < 9; ++k)
    {
      float m[16];
      std::memcpy(m, &bytes[4 + 64 * k], 64);
      Mat4 d;
      for (int i = 0; i < 16; ++i)
        d.m[i / 4][i % 4] = m[i];
      matrices[f].push_back(d);
    }
  }
  const int w = 512, h = 512;
  const auto screen = [&](int f, const Vec3d& p, double& x, double& y)
  {
    const Mat4& m = matrices[f][8];
    const Vec3d v = m.Point(p);
    const double q = m.m[3][0] * p.x + m.m[3][1] * p.y + m.m[3][2] * p.z + m.m[3][3];
    x = v.x / q;
    y = h - v.y / q;
  };
  Picture motion(w, h, 2);
  int moving = 0;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const int id = int(*frames[1].id.in().at(x, y));
      if (id < 0)
        continue;
      const float* p = position[1].in().at(x, y);
      Mat4 back;
      ASSERT_TRUE(matrices[1][id].Inverse(back));
      const Vec3d now{ p[0], p[1], p[2] }, then = matrices[0][id].Point(back.Point(now));
      double x0, y0, x1, y1;
      screen(1, now, x1, y1);
      screen(0, then, x0, y0);
      motion.out().at(x, y)[0] = float(x0 - x1);
      motion.out().at(x, y)[1] = float(y0 - y1);
      moving += std::hypot(x0 - x1, y0 - y1) > 0.5;
    }
  EXPECT_GT(moving, 500);
  // The ball's object coordinates are its history: they must come back on the ball, wherever it is now.
  const auto coordinates = [&](int f)
  {
    Picture c(w, h, 3);
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x)
      {
        const int id = int(*frames[f].id.in().at(x, y));
        Mat4 back;
        if (id < 0 || !matrices[f][id].Inverse(back))
          continue;
        const float* p = position[f].in().at(x, y);
        const Vec3d v = back.Point({ p[0], p[1], p[2] });
        for (int k = 0; k < 3; ++k)
          c.out().at(x, y)[k] = float(v[k]);
      }
    return c;
  };
  const Picture before = coordinates(0), now = coordinates(1);
  ReprojectInputs in;
  in.frame = { 0, 0, w, h };
  in.depth = frames[1].depth.in();
  in.normal = frames[1].normal.in();
  in.id = frames[1].id.in();
  in.motion = motion.in();
  in.history = before.in();
  in.previousDepth = frames[0].depth.in();
  in.previousNormal = frames[0].normal.in();
  in.previousId = frames[0].id.in();
  Picture color(w, h, 3), mask(w, h, 1);
  Reproject(in, ReprojectParameters(), { color.out(), {}, {}, mask.out() }, in.frame);
  int accepted = 0, hits = 0, lost = 0;
  std::vector<double> errors;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const int id = int(*frames[1].id.in().at(x, y));
      if (id < 0)
        continue;
      ++hits;
      const int m = int(*mask.in().at(x, y));
      accepted += m < 3;
      lost += m == int(ReprojectMask::IdDiffers);
      if (m == 0 && id == 6)
        errors.push_back(std::hypot(color.in().at(x, y)[0] - now.in().at(x, y)[0],
          color.in().at(x, y)[1] - now.in().at(x, y)[1], color.in().at(x, y)[2] - now.in().at(x, y)[2]));
    }
  ASSERT_GT(errors.size(), 500u);
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  std::printf("%d of %d pixels have history, %d lost theirs to another object; median error on the ball %.3g\n",
    accepted, hits, lost, errors[errors.size() / 2]);
  EXPECT_GT(accepted, 0.98 * hits);
  EXPECT_GT(lost, 20);
  EXPECT_LT(errors[errors.size() / 2], 2e-3);
}
