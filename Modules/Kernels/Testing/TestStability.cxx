// SPDX-License-Identifier: BSD-3-Clause
// What is kept from frame to frame, over very many frames: no drift against the closed form, variances of noise far
// from 0, and nothing that the largest numbers leave behind.
#include "TestPlanes.h"
#include "quellAccumulate.h"
#include "quellReproject.h"
#include "quellTemporalAntialias.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cfloat>

using namespace quelltest;

namespace
{
constexpr int Pixels = 64;

/// A row of pixels that keeps its history, and the same in double.
struct Average
{
  quell::Rect e{ 0, 0, Pixels, 1 };
  quell::AccumulateParameters par;
  Image sample{ e, 3 }, color{ e, 3 }, moments{ e, 2 }, length{ e, 1 }, newColor{ e, 3 }, newMoments{ e, 2 },
    newLength{ e, 1 }, rest{ e, 1 }, newRest{ e, 1 };
  bool twoFloats = false; ///< of the mean
  bool scalar = false;
  std::vector<double> mean = std::vector<double>(Pixels), second = mean, exact = mean;
  double frames = 0;

  Average(double alpha, double momentsAlpha)
    : par{ alpha, momentsAlpha, 1e9 }
  {
  }
  template <class F>
  void Add(F&& value)
  {
    this->frames += 1;
    const double a = std::max(this->par.alpha, 1 / this->frames),
                 am = std::max(this->par.momentsAlpha, 1 / this->frames);
    for (int i = 0; i < Pixels; ++i)
    {
      const float v = value(i);
      this->sample.fill(i, 0, v);
      this->exact[i] += a * (v - this->exact[i]);
      const double d = v - this->mean[i];
      this->mean[i] += am * d;
      this->second[i] = (1 - am) * (this->second[i] + am * d * d);
    }
    quell::AccumulateInputs in{ this->sample, this->color, this->moments, this->length };
    quell::AccumulateOutputs out{ this->newColor, this->newMoments, this->newLength };
    if (this->twoFloats)
      in.meanRest = this->rest, out.meanRest = this->newRest;
    if (this->scalar)
      quell::AccumulateScalar(in, this->par, out, this->e);
    else
      quell::Accumulate(in, this->par, out, this->e);
    std::swap(this->rest, this->newRest);
    std::swap(this->color, this->newColor);
    std::swap(this->moments, this->newMoments);
    std::swap(this->length, this->newLength);
  }
  double WorstColor() const
  {
    double worst = 0;
    for (int i = 0; i < Pixels; ++i)
      for (int c = 0; c < 3; ++c)
        worst = std::max(worst, std::fabs(this->color.at(i, 0)[c] - this->exact[i]) / std::fabs(this->exact[i]));
    return worst;
  }
  /// Absolute, of the mean as it is carried.
  double WorstMean() const
  {
    double worst = 0;
    for (int i = 0; i < Pixels; ++i)
      worst =
        std::max(worst, std::fabs(double(this->moments.at(i, 0)[0]) + this->rest.at(i, 0)[0] - this->mean[i]));
    return worst;
  }
  /// Of the ensemble: all pixels together.
  double VarianceError() const
  {
    double sum = 0, exactSum = 0;
    for (int i = 0; i < Pixels; ++i)
      sum += this->moments.at(i, 0)[1], exactSum += this->second[i];
    return std::fabs(sum / exactSum - 1);
  }
};

/// Uniform noise of mean 0 and deviation 1.
struct Noise
{
  Random u;
  explicit Noise(std::uint32_t seed)
    : u(seed)
  {
  }
  double operator()() { return std::sqrt(12.) * (double(u()) - 0.5); }
};
}

TEST(Stability, AHundredThousandFramesOfNoiseDoNotDrift)
{
  for (const quell::SimdTarget& target : quell::SimdTargets())
  {
    quell::ForceSimdTarget(target.Id);
    for (const double alpha : { 1e-9, 0.001, 0.05 })
    {
      Average average(alpha, alpha);
      Noise noise(5);
      for (int n = 0; n < 100000; ++n)
        average.Add([&](int) { return float(2 + 0.5 * noise()); });
      // Every frame rounds once, and is forgotten after 1 / alpha: a random walk, a hundredth of what the noise leaves.
      EXPECT_LE(average.WorstColor(), 0x1p-23 * std::sqrt(std::min(1e5, 1 / alpha)))
        << target.Name << " alpha " << alpha;
      EXPECT_LE(average.VarianceError(), 1e-3) << target.Name << " alpha " << alpha;
      EXPECT_EQ(average.length.data[0], 1e5f);
    }
  }
  quell::ForceSimdTarget(0);
}

// What is constant stays, to the last bit, for any weight and value.
TEST(Stability, AHundredThousandConstantFramesChangeNoBit)
{
  for (const double alpha : { 1e-9, 0.001, 0.3 })
  {
    Average average(alpha, alpha);
    for (int n = 0; n < 100000; ++n)
      average.Add([](int i) { return std::ldexp(0.1f + 0.01f * float(i), i - 32); });
    for (int i = 0; i < Pixels; ++i)
    {
      EXPECT_EQ(average.color.at(i, 0)[1], std::ldexp(0.1f + 0.01f * float(i), i - 32));
      // The luminance of a grey is rounded; the same rounding each time leaves no variance.
      EXPECT_LE(average.moments.at(i, 0)[1], 0.f) << i;
    }
  }
}

// A mean of 10^k deviations, over as many frames as fill the moments: 1e-3 of the variance that the frames really had.
TEST(Stability, VarianceFarFromZero)
{
  for (const double ratio : { 1., 10., 100., 1e3, 1e4 })
    for (const double alpha : { 1e-9, 0.01, 0.2 })
      for (const int frames : { 1000, 30000 })
      {
        Average average(alpha, alpha);
        Noise noise(std::uint32_t(7 + ratio));
        for (int n = 0; n < frames; ++n)
          average.Add([&](int) { return float(ratio + noise()); });
        EXPECT_LE(average.VarianceError(), 1e-3)
          << "mean / deviation " << ratio << ", alpha " << alpha << ", " << frames;
      }
}

// The same with the mean carried as two floats: 10^6 deviations, in the scalar code and with every instruction set.
TEST(Stability, VarianceFarFromZeroWithTwoFloats)
{
  std::vector<quell::SimdTarget> targets = quell::SimdTargets();
  targets.insert(targets.begin(), quell::SimdTarget());
  double worst = 0, worstOfOne = 0;
  for (std::size_t t = 0; t < targets.size(); ++t)
    for (const double ratio : { 1., 1e4, 1e5, 1e6, -1e6 })
      for (const double alpha : { 1e-9, 0.01, 0.2 })
        for (const int frames : { 1000, 20000 })
        {
          if (frames > 1000 && t > 1)
            continue;
          quell::ForceSimdTarget(t ? targets[t].Id : 0);
          Average average(alpha, alpha), one(alpha, alpha);
          average.twoFloats = true;
          average.scalar = one.scalar = t == 0;
          Noise noise(std::uint32_t(9 + std::fabs(ratio)));
          double sum = 0, squares = 0;
          for (int n = 0; n < frames; ++n)
          {
            float now[Pixels];
            for (int i = 0; i < Pixels; ++i)
            {
              const double x = noise();
              sum += x, squares += x * x;
              now[i] = float(ratio + x);
            }
            average.Add([&](int i) { return now[i]; });
            one.Add([&](int i) { return now[i]; });
          }
          SCOPED_TRACE(std::string(t ? targets[t].Name : "scalar") + ", mean / deviation " + std::to_string(ratio) +
                       ", alpha " + std::to_string(alpha) + ", " + std::to_string(frames));
          EXPECT_LE(average.VarianceError(), 2e-5) << "of the frames as floats";
          EXPECT_LE(average.WorstMean(), 2e-5);
          worst = std::max(worst, average.VarianceError());
          worstOfOne = std::max(worstOfOne, one.VarianceError());
          if (alpha < 1e-3)
          {
            // Against the noise before it was rounded to floats around the mean: a step of 1/16 adds 1/16^2 / 12.
            const double count = double(Pixels) * frames, all = squares / count - sum * sum / count / count;
            double within = 0;
            for (int i = 0; i < Pixels; ++i)
              within += average.moments.at(i, 0)[1] / Pixels;
            EXPECT_NEAR(within * frames / (frames - 1.), all, 1e-3 * all);
          }
        }
  quell::ForceSimdTarget(0);
  EXPECT_GT(worstOfOne, 0.01) << "one float would do as well";
  RecordProperty("worst", std::to_string(worst));
}

// The loop of a renderer: reprojected by parts of a pixel, accumulated, and the variance taken over frames and over
// neighbours. Against the same in double.
TEST(Stability, VarianceFarFromZeroThroughTheLoop)
{
  const quell::Rect e{ 0, 0, 40, 24 };
  const double ratio = 1e6, shift[2] = { 0.3, -0.4 };
  for (const bool twoFloats : { true, false })
  {
    Image depth(e, 1, 5.f), normal(e, 3), motion(e, 2), sample(e, 3), color(e, 3), moments(e, 2), length(e, 1),
      rest(e, 1);
    Image oldColor(e, 3), oldMoments(e, 2), oldLength(e, 1), oldRest(e, 1), mask(e, 1);
    struct Exact
    {
      double mean = 0, second = 0, length = 0;
    };
    std::vector<Exact> exact(40 * 24);
    for (int i = 0; i < 40 * 24; ++i)
    {
      normal.data[3 * i + 2] = 1;
      motion.data[2 * i] = float(shift[0]), motion.data[2 * i + 1] = float(shift[1]);
    }
    Noise noise(31);
    double error = 0, sum = 0, spatial = 0, spatialSum = 0;
    for (int n = 0; n < 200; ++n)
    {
      for (int i = 0; i < 40 * 24; ++i)
        for (int c = 0; c < 3; ++c)
          sample.data[3 * i + c] = float(ratio + noise());
      quell::ReprojectInputs in;
      in.frame = e;
      in.depth = in.previousDepth = depth;
      in.normal = in.previousNormal = normal;
      in.motion = motion;
      if (n > 0)
        in.history = color, in.moments = moments, in.length = length;
      if (n > 0 && twoFloats)
        in.meanRest = rest;
      quell::Reproject(in, {}, { oldColor, oldMoments, oldLength, mask, oldRest }, e);
      quell::AccumulateInputs now{ sample, oldColor, oldMoments, oldLength };
      if (twoFloats)
        now.meanRest = oldRest;
      quell::Accumulate(now, { 0.05, 0.05, 1e9 }, { color, moments, length, rest }, e);

      const std::vector<Exact> old = exact;
      for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 40; ++x)
        {
          Exact was;
          double weights = 0;
          for (int pass = 0; pass < 2; ++pass)
          {
            Exact mix;
            for (int k = 0; k < 4; ++k)
            {
              const double qx = x + double(float(shift[0])), qy = y + double(float(shift[1]));
              const int u = int(std::floor(qx)) + (k & 1), v = int(std::floor(qy)) + (k >> 1);
              const double w = std::max(0., 1 - std::fabs(qx - u)) * std::max(0., 1 - std::fabs(qy - v));
              if (!e.contains(u, v) || n == 0)
                continue;
              const Exact& o = old[std::size_t(v * 40 + u)];
              weights += pass ? 0 : w;
              mix.mean += w * o.mean;
              mix.second += w * (o.second + (o.mean - was.mean) * (o.mean - was.mean));
              mix.length += w * o.length;
            }
            if (weights > 0)
              was = { mix.mean / weights, mix.second / weights, mix.length / weights };
          }
          const float* s = sample.at(x, y);
          const double l = 0.2126 * s[0] + 0.7152 * s[1] + 0.0722 * s[2];
          Exact& p = exact[std::size_t(y * 40 + x)];
          p.length = was.length + 1;
          const double a = std::max(0.05, 1 / p.length), d = l - was.mean;
          p.mean = was.length > 0 ? was.mean + a * d : l;
          p.second = was.length > 0 ? (1 - a) * (was.second + a * d * d) : 0;
        }
    }
    // Over frames, pixel by pixel.
    for (int i = 0; i < 40 * 24; ++i)
      error += std::fabs(moments.data[2 * i + 1] - exact[std::size_t(i)].second), sum += exact[std::size_t(i)].second;
    // And over the neighbours of a pixel that is too young: the same in double, all weights 1 on this wall.
    const Image young(e, 1, 1.f);
    const Planes planes(e, quell::VariancePass::Radius, color, {}, depth, normal, {}, moments, young,
      twoFloats ? quell::ImageIn(rest) : quell::ImageIn());
    for (const auto row : { quell::VarianceRow, quell::VarianceRowScalar })
    {
      quell::VariancePass pass = planes.variancePass();
      pass.minimumHistory = 2; // raises what is of one frame by 2
      for (int y = 0; y < 24; ++y)
        row(pass, y, 0, 40);
      for (int y = 3; y < 21; ++y)
        for (int x = 3; x < 37; ++x)
        {
          double mean = 0, second = 0;
          for (int v = -3; v <= 3; ++v)
            for (int u = -3; u <= 3; ++u)
              mean += exact[std::size_t((y + v) * 40 + x + u)].mean / 49;
          for (int v = -3; v <= 3; ++v)
            for (int u = -3; u <= 3; ++u)
            {
              const Exact& q = exact[std::size_t((y + v) * 40 + x + u)];
              second += (q.second + (q.mean - mean) * (q.mean - mean)) / 49;
            }
          const double found = 0.5 * pass.out.variance[pass.guides.layout.at(x, y)];
          spatial += std::fabs(found - second), spatialSum += second;
        }
    }
    if (twoFloats)
    {
      EXPECT_LE(error / sum, 1e-3);
      EXPECT_LE(spatial / spatialSum, 1e-3);
    }
    else
      EXPECT_GT(error / sum, 1e-3) << "one float would do as well";
    std::printf("%s: over frames %.1e, over neighbours %.1e\n", twoFloats ? "two floats" : "one float", error / sum,
      spatial / spatialSum);
  }
}

// The rest of a mean is garbage, or the mean's own opposite: finite and gone with the history.
TEST(Stability, GarbageInTheRestOfTheMean)
{
  for (const float garbage : { NaN, Inf, -Inf, FLT_MAX, -FLT_MAX, 1e30f, 1e-42f, -3.f })
    for (const bool scalar : { true, false })
    {
      Average average(0.2, 0.2);
      average.twoFloats = true;
      average.scalar = scalar;
      average.Add([](int i) { return 3 + 0.1f * float(i); });
      std::fill(average.rest.data.begin(), average.rest.data.end(), garbage);
      for (int n = 0; n < 700; ++n)
      {
        average.Add([](int i) { return 3 + 0.1f * float(i); });
        for (const Image* image : { &average.color, &average.moments, &average.rest })
          for (float v : image->data)
            ASSERT_TRUE(std::isfinite(v)) << garbage << " frame " << n;
      }
      // 0.8^700 of 3.4e38 is nothing, and the squares of the first frames are cut off there.
      for (int i = 0; i < Pixels; ++i)
      {
        EXPECT_NEAR(average.moments.at(i, 0)[0], 3 + 0.1f * float(i), 1e-6 * (3 + i)) << garbage;
        EXPECT_LE(average.moments.at(i, 0)[1], 1e-10) << garbage;
        EXPECT_LE(std::fabs(average.rest.at(i, 0)[0]), 1e-6f) << garbage;
      }
    }
}

TEST(Stability, AlternatingExtremesLeaveNothing)
{
  const float pairs[][2] = { { 0, FLT_MAX }, { -FLT_MAX, FLT_MAX }, { 1e-42f, 1e38f }, { 1e30f, -1e30f }, { 0, 1e-42f },
    { 65504, -1 }, { 1e18f, 0 }, { 1.1e18f, 1e-30f } };
  for (const auto& pair : pairs)
    for (const double alpha : { 0.2, 0.05 })
    {
      Average average(alpha, 0.2);
      for (int n = 0; n < 2000; ++n)
      {
        average.Add([&](int i) { return pair[(n + i) & 1]; });
        for (const Image* image : { &average.color, &average.moments })
          for (float v : image->data)
            ASSERT_TRUE(std::isfinite(v)) << pair[0] << " " << pair[1] << " frame " << n;
      }
      for (int i = 0; i < Pixels; ++i)
        ASSERT_GE(average.moments.at(i, 0)[1], 0.f);
      // (1 - 0.05)^n 3.4e38 is below the rounding of 0.5 after 2100 frames; the second moment forgets faster.
      for (int n = 0; n < 3000; ++n)
        average.Add([](int) { return 0.5f; });
      for (int i = 0; i < Pixels; ++i)
      {
        EXPECT_NEAR(average.color.at(i, 0)[0], 0.5f, 1e-6);
        EXPECT_NEAR(average.moments.at(i, 0)[0], 0.5f, 1e-6);
        EXPECT_NEAR(average.moments.at(i, 0)[1], 0.f, 1e-12);
      }
    }
}

// The whole loop, reprojection included: a constant picture that moves by parts of a pixel for 5,000 frames.
TEST(Stability, AMovingConstantStaysWhatItIs)
{
  const quell::Rect e{ 0, 0, 24, 16 };
  Image depth(e, 1, 5.f), normal(e, 3), motion(e, 2), sample(e, 3), color(e, 3), moments(e, 2), length(e, 1);
  Image radiance(e, 3), mean(e, 2), frames(e, 1), blended(e, 3), taa(e, 3);
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 24; ++x)
    {
      normal.at(x, y)[2] = 1;
      for (int c = 0; c < 3; ++c)
        sample.at(x, y)[c] = blended.at(x, y)[c] = 0.1f + 0.3f * float(c);
    }
  for (int n = 0; n < 5000; ++n)
  {
    for (int i = 0; i < 24 * 16; ++i)
      motion.data[2 * i] = 0.3f * float(n % 3 - 1), motion.data[2 * i + 1] = 0.17f;
    quell::ReprojectInputs in;
    in.frame = e;
    in.depth = in.previousDepth = depth;
    in.normal = in.previousNormal = normal;
    in.motion = motion;
    if (n > 0)
      in.history = color, in.moments = moments, in.length = length;
    quell::ReprojectParameters par;
    par.catmullRom = true;
    Image mask(e, 1);
    quell::Reproject(in, par, { radiance, mean, frames, mask }, e);
    quell::Accumulate({ sample, radiance, mean, frames }, { 0.05, 0.2, 1e9 }, { color, moments, length }, e);
    quell::AntialiasInputs anti;
    anti.frame = e;
    anti.radiance = color;
    anti.motion = motion;
    anti.history = blended;
    quell::TemporalAntialias(anti, {}, taa, e);
    std::swap(taa, blended);
  }
  for (int i = 0; i < 3 * 24 * 16; ++i)
  {
    EXPECT_EQ(color.data[i], sample.data[i]);
    EXPECT_EQ(blended.data[i], sample.data[i]);
  }
  // Not so the number of frames: a point that came in over the border has been there since.
  EXPECT_GT(*std::max_element(length.data.begin(), length.data.end()), 15.f);
}

// Weights at the ends of their range: 0 keeps the first frame for ever, 1 and a history of one frame keep nothing.
TEST(Stability, WeightsOfNothingAndOfEverything)
{
  Average frozen(0, 0), none(1, 1), one(0, 0);
  one.par.maximumHistory = 1;
  frozen.par.maximumHistory = 1e30;
  Noise noise(11);
  std::vector<float> last(Pixels);
  for (int n = 0; n < 50; ++n)
  {
    for (float& v : last)
      v = float(3 + noise());
    for (Average* a : { &none, &one })
      a->Add([&](int i) { return last[i]; });
  }
  for (int i = 0; i < Pixels; ++i)
  {
    EXPECT_EQ(none.color.at(i, 0)[0], last[i]);
    EXPECT_EQ(one.color.at(i, 0)[0], last[i]);
    EXPECT_EQ(none.moments.at(i, 0)[1], 0.f);
  }
  // Without a least weight the average is the mean of all frames.
  double sum = 0;
  for (int n = 1; n <= 1000; ++n)
  {
    frozen.Add([n](int) { return float(n); });
    sum += n;
  }
  EXPECT_NEAR(frozen.color.data[0], sum / 1000, 1e-3);
}

// Where the length says that there is no history, whatever else lies there is not read.
TEST(Stability, GarbageWhereTheHistoryIsEmpty)
{
  for (const float garbage : { NaN, Inf, -FLT_MAX, 1e30f })
    for (const float length : { 0.f, -1.f, NaN, Inf })
    {
      Average average(0.2, 0.2);
      for (Image* image : { &average.color, &average.moments })
        std::fill(image->data.begin(), image->data.end(), garbage);
      std::fill(average.length.data.begin(), average.length.data.end(), length);
      average.Add([](int i) { return float(i); });
      for (int i = 0; i < Pixels; ++i)
      {
        EXPECT_EQ(average.color.at(i, 0)[2], float(i)) << garbage << " " << length;
        EXPECT_EQ(average.moments.at(i, 0)[1], 0.f);
        EXPECT_EQ(average.length.at(i, 0)[0], 1.f);
      }
    }
}

// Depth comes from the ray, never from a depth buffer: the rows of near and far plane are not even looked at.
TEST(Stability, TheNearPlaneDoesNotMatter)
{
  quell::Mat4 ndc, camera;
  ndc.m[0][0] = 1.5, ndc.m[1][1] = 2;
  ndc.m[3][2] = -1, ndc.m[3][3] = 0;
  for (const double near : { 1e-6, 1e-3, 1. })
  {
    const double far = 1e6;
    ndc.m[2][2] = -(far + near) / (far - near), ndc.m[2][3] = -2 * far * near / (far - near);
    const quell::ViewGeometry view(ndc, camera);
    ASSERT_TRUE(view.IsValid());
    for (const double d : { 1., 2., 1e5 })
    {
      double x = 0, y = 0, depth = 0;
      ASSERT_TRUE(view.Project({ 0.1 * d, 0.2 * d, -d }, x, y, depth));
      EXPECT_EQ(depth, d) << near;
      const quell::Vec3d p = view.Unproject(x, y, depth);
      EXPECT_NEAR(p.x, 0.1 * d, 1e-12 * d);
      EXPECT_NEAR(p.z, -d, 1e-12 * d);
    }
  }
}
