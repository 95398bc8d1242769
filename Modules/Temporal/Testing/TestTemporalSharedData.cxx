// SPDX-License-Identifier: BSD-3-Clause
// Frames of other renderers, where the shared test data lie beside the checkout.
#include "quellAccumulate.h"
#include "quellImageMetrics.h"
#include "quellReproject.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
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
    : w(width), h(height), c(channels), data(std::size_t(width) * height * channels)
  {
  }
  Rect extent() const { return { 0, 0, w, h }; }
  ImageIn in() const { return data.empty() ? ImageIn() : ImageIn(data.data(), c, this->extent()); }
  ImageOut out() { return { data.data(), c, this->extent() }; }
};

/// The named channels of a file, row 0 at the bottom.
Picture Load(const std::string& file, const std::vector<std::string>& channels)
{
  auto in = OIIO::ImageInput::open(file);
  if (!in)
    return Picture();
  const OIIO::ImageSpec spec = in->spec();
  std::vector<float> all(std::size_t(spec.width) * spec.height * spec.nchannels);
  in->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, all.data());
  Picture p(spec.width, spec.height, int(channels.size()));
  for (int k = 0; k < p.c; ++k)
  {
    const int from = spec.channelindex(channels[k]);
    EXPECT_GE(from, 0) << channels[k];
    for (int y = 0; y < p.h; ++y)
      for (int x = 0; x < p.w; ++x)
        p.out().at(x, p.h - 1 - y)[k] = all[(std::size_t(y) * p.w + x) * spec.nchannels + from];
  }
  return p;
}

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
  const Picture truth = Load(Room + "reference.0008.exr", { "R", "G", "B" });
  if (truth.w == 0)
    GTEST_SKIP() << "no shared data";
  State before;
  Picture last, noisy;
  double history = 0;
  for (int frame = 1; frame <= 8; ++frame)
  {
    const std::string file = Room + "noisy.000" + std::to_string(frame) + ".exr", v = "ViewLayer.";
    noisy = Load(file, { v + "Combined.R", v + "Combined.G", v + "Combined.B" });
    State now;
    now.depth = Load(file, { v + "Depth.Z" });
    for (float& z : now.depth.data)
      z = z > 1e9f ? std::numeric_limits<float>::infinity() : z;
    now.normal = Load(file, { v + "Normal.X", v + "Normal.Y", v + "Normal.Z" });
    now.id = Load(file, { v + "IndexOB.X" });
    const Picture motion = Load(file, { v + "Vector.X", v + "Vector.Y" });
    ReprojectInputs in;
    in.motion = motion.in();
    const Picture mask = Step(before, now, noisy, in);
    if (frame == 8)
    {
      int kept = 0;
      for (float m : mask.data)
        kept += m < 3;
      history = double(kept) / double(mask.data.size());
    }
    last = now.color;
    before = now;
  }
  const double raw = RelMse(noisy, truth), accumulated = RelMse(last, truth);
  RecordProperty("raw", std::to_string(raw));
  RecordProperty("accumulated", std::to_string(accumulated));
  std::printf("relMSE raw %.4g, accumulated %.4g, ratio %.2f; %.1f %% of the pixels have history\n", raw, accumulated,
    raw / accumulated, 100 * history);
  EXPECT_GT(history, 0.9);
  EXPECT_LT(accumulated, raw / 3);
}
