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
    newLength{ e, 1 };
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
    quell::Accumulate({ this->sample, this->color, this->moments, this->length }, this->par,
      { this->newColor, this->newMoments, this->newLength }, this->e);
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
