// SPDX-License-Identifier: BSD-3-Clause
// Published and derived numbers of the filters that no other test holds: the widest cascade, what SVGF's propagated
// variance leaves out, powers of the normal weight, long averages, what clamps keep; and the energy of every kernel
// that is normalised.
#include "TestPlanes.h"
#include "quellAccumulate.h"
#include "quellBilateral.h"
#include "quellFireflyClamp.h"
#include "quellKernelFilter.h"
#include "quellNonLocal.h"
#include "quellSampleFilter.h"
#include "quellVarianceSteered.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
/// `passes` a-trous passes over flat geometry that no weight but the spline's shapes.
Image Cascade(const Image& color, int passes, Image* variance = nullptr)
{
  const quell::Rect e = color.extent;
  Image depth(e, 1, 2.f), ones(e, 1, 1.f);
  Planes planes(e, std::max(3, 2 << passes), color, variance ? quell::ImageIn(*variance) : quell::ImageIn(), depth);
  quell::ATrousPass p = planes.pass(1);
  p.fixedSigma = 1e30f;
  p.sigmaLuminance = 1e30f;
  for (int k = 0; k < passes; ++k)
  {
    p.step = 1 << k;
    for (int phase = 0; phase < std::min(p.step, e.height()); ++phase)
      quell::ATrousRows(p, e.y0 + phase, (e.height() - phase + p.step - 1) / p.step, e.x0, e.x1);
    std::swap(p.in, p.out);
  }
  Image out(e, 3), var(e, 1);
  quell::StoreFiltered(planes.guides, p.in, color, variance ? quell::ImageIn(*variance) : quell::ImageIn(), out,
    variance ? quell::ImageOut(var) : quell::ImageOut(), e);
  if (variance)
    *variance = var;
  return out;
}

/// Noise in the middle of black, so wide a border that no kernel of `reach` loses anything over the edge.
Image Island(int reach, double sums[3])
{
  const int side = 2 * reach + 14;
  Image image({ 0, 0, side, side }, 3, 0.f);
  Random u(3);
  for (int c = 0; c < 3; ++c)
    sums[c] = 0;
  for (int y = reach; y < reach + 14; ++y)
    for (int x = reach; x < reach + 14; ++x)
      for (int c = 0; c < 3; ++c)
        sums[c] += image.at(x, y)[c] = u() * (u() < 0.02f ? 100.f : 1.f);
  return image;
}
void ExpectSums(const Image& image, const double sums[3], const char* what)
{
  double now[3] = {};
  for (size_t i = 0; i < image.data.size(); ++i)
    now[i % 3] += image.data[i];
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(now[c] / sums[c], 1, 1e-5) << what << " " << c;
}
}

// Five passes: noise gain 2.2461e-4 and sigma 18.466 pixels, a footprint of 125 x 125 (ALGORITHMS 3.5, 3.7).
TEST(Goldens, CascadeOfFivePasses)
{
  const int half = quell::ATrousHalo(5), size = 4 * half + 1, c = 2 * half; // borders would cut what passes hand on
  Image impulse({ 0, 0, size, size }, 3, 0.f);
  impulse.fill(c, c, 1.f);
  const Image r = Cascade(impulse, 5);
  double sum = 0, squares = 0, width = 0;
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x)
    {
      const double v = r.at(x, y)[0];
      sum += v, squares += v * v, width += v * (x - c) * (x - c);
    }
  EXPECT_EQ(2 * half + 1, 125);
  EXPECT_GT(r.at(c - half, c)[0], 0.f);
  EXPECT_EQ(r.at(c - half - 1, c)[0], 0.f);
  EXPECT_NEAR(sum, 1, 1e-5);
  EXPECT_NEAR(squares / 2.2461e-4, 1, 1e-4);
  EXPECT_NEAR(std::sqrt(width), 18.466, 1e-3);
}

// SVGF takes the noise of a pass for independent: after five passes it believes in 96 times less than there is.
TEST(Goldens, PropagatedVarianceOfACascade)
{
  const double gain[5] = { 7.4768e-2, 1.5246e-2, 3.6433e-3, 9.0088e-4, 2.2461e-4 };
  const double believed[5] = { 7.48e-2, 5.59e-3, 4.18e-4, 3.13e-5, 2.34e-6 }, factor[5] = { 1, 2.7, 8.7, 29, 96 };
  for (int n = 1; n <= 5; ++n)
  {
    const int half = quell::ATrousHalo(n), size = 2 * half + 1;
    Image color({ 0, 0, size, size }, 3, 1.f), variance({ 0, 0, size, size }, 1, 1.f);
    Cascade(color, n, &variance);
    const double v = *variance.at(half, half);
    EXPECT_NEAR(v / believed[n - 1], 1, 2e-3) << n;
    EXPECT_NEAR(gain[n - 1] / v / factor[n - 1], 1, 0.02) << n;
  }
}

// cos^128 (ALGORITHMS 8.4): the part of the tap's spline weight that is left, read off two pixels.
TEST(Goldens, PowersOfTheNormalWeight)
{
  const double degrees[7] = { 1, 2, 5, 10, 15, 20, 30 };
  const double weight[7] = { .980692, .924966, .613848, .140925, .0118, .000348, 1.0e-8 };
  const double tolerance[7] = { 2e-5, 2e-5, 2e-5, 1e-5, 3e-5, 1e-6, 2e-9 };
  const quell::Rect e{ 0, 0, 2, 1 };
  for (int k = 0; k < 7; ++k)
  {
    const double a = degrees[k] * 3.14159265358979 / 180;
    Image color(e, 3, 0.f), depth(e, 1, 2.f), normal(e, 3, 0.f);
    color.fill(1, 0, 1.f);
    normal.at(0, 0)[2] = 1;
    normal.at(1, 0)[0] = float(std::sin(a)), normal.at(1, 0)[2] = float(std::cos(a));
    for (const auto rows : { quell::ATrousRows, quell::ATrousRowsScalar })
    {
      Planes planes(e, 4, color, {}, depth, normal);
      quell::ATrousPass p = planes.pass(1);
      p.fixedSigma = 1e30f;
      rows(p, 0, 1, 0, 2);
      // C' = h0 h1 w / (h0^2 + h0 h1 w)
      const double c = planes.atrousOut.color[0][planes.guides.layout.at(0, 0)];
      EXPECT_NEAR(c / (1 - c) * 1.5, weight[k], tolerance[k]) << degrees[k];
    }
  }
}

// Frames after which 1 % of a step is left, and the noise that stays (ALGORITHMS 5.3).
TEST(Goldens, MovingAverages)
{
  const struct
  {
    double alpha, gain;
    int frames;
  } rows[] = { { .2, .1111, 21 }, { .1, .0526, 44 }, { .05, .02564, 90 }, { .02, .0101, 228 }, { .01, .005025, 459 } };
  const quell::Rect e{ 0, 0, 1, 1 };
  for (const auto& row : rows)
  {
    const quell::AccumulateParameters par{ row.alpha, row.alpha, 1e6 };
    Image radiance(e, 3), history(e, 3, 1.f), length(e, 1, 1e6f), out(e, 3), frames(e, 1);
    double squares = 0;
    int below = 0;
    for (int n = 1; n <= 1200; ++n)
    {
      // What is left of the step is also the weight of a frame n ago, over alpha.
      squares += std::pow(row.alpha * history.data[0], 2);
      quell::Accumulate({ radiance, history, {}, length }, par, { out, {}, frames }, e);
      history = out, length = frames;
      if (!below && out.data[0] < .01f)
        below = n;
    }
    EXPECT_EQ(below, row.frames) << row.alpha;
    EXPECT_NEAR(squares / row.gain, 1, 2e-3) << row.alpha;
  }
}

// 1e5 frames of .1: the incremental mean and the moving average stay there; the form (1 - a) C + a x drifts to
// .100001171, a float sum to 9998.557 (appendix B.12). 0, 1, 0, 1 ... has the mean .5.
TEST(Goldens, AHundredThousandFrames)
{
  const quell::Rect e{ 0, 0, 1, 1 };
  for (const double alpha : { 1e-9, .2 })
  {
    const quell::AccumulateParameters par{ alpha, alpha, 1e9 };
    Image same(e, 3, .1f), radiance = same, history(e, 3), length(e, 1), out(e, 3), frames(e, 1);
    Image switching(e, 3), otherLength(e, 1);
    for (int n = 0; n < 100000; ++n)
    {
      quell::Accumulate({ same, history, {}, length }, par, { out, {}, frames }, e);
      history = out, length = frames;
      radiance.fill(0, 0, float(n & 1));
      quell::Accumulate({ radiance, switching, {}, otherLength }, par, { out, {}, frames }, e);
      switching = out, otherLength = frames;
    }
    EXPECT_EQ(history.data[0], .1f) << alpha; // .100000001
    EXPECT_EQ(length.data[0], 1e5f);
    if (alpha < .1)
    {
      EXPECT_NEAR(switching.data[0], .5, 1e-5);
    }
  }
}

// What a clamp keeps of exponential noise with mean 1, and of a light that one sample in V finds (ALGORITHMS 2.2).
TEST(Goldens, WhatAClampKeeps)
{
  const quell::Rect e{ 0, 0, 1000, 400 };
  Image noise(e, 3);
  for (size_t i = 0; i < noise.data.size() / 3; ++i)
    noise.data[3 * i] = noise.data[3 * i + 1] = noise.data[3 * i + 2] =
      float(-std::log(1 - (i + .5) / double(e.area())));
  const double limits[4] = { 1, 3, 5, 10 }, kept[4] = { .632121, .950213, .993262, .999955 };
  quell::FireflyClampParameters p;
  p.measure = quell::ClampMeasure::Maximum;
  for (int k = 0; k < 4; ++k)
  {
    p.threshold = float(limits[k]);
    const auto ledger = quell::FireflyClamp(noise, {}, p, {}, {}, e);
    EXPECT_NEAR(1 - ledger.EnergyRemoved / ledger.EnergyIn, kept[k], 2e-6) << limits[k];
  }
  Image caustic(e, 3);
  for (int i = 0; i < 4000; ++i) // p = 1 / 100
    std::fill_n(&caustic.data[300 * size_t(i)], 3, 100.f);
  p.threshold = 5;
  const auto ledger = quell::FireflyClamp(caustic, {}, p, {}, {}, e);
  EXPECT_NEAR(1 - ledger.EnergyRemoved / ledger.EnergyIn, 5. / 100, 1e-6);
}

// Half buffers tell the variance of their mean as (A - B)^2 / 4: right on average, off by 1.4142 of itself in a pixel
// (appendix B.11), which is why whoever reads it smooths it first.
TEST(Goldens, VarianceOfHalves)
{
  Random u(9);
  double mean = 0, squares = 0;
  const int n = 200000;
  for (int i = 0; i < n; ++i)
  {
    const double r = std::sqrt(-2 * std::log(1 - double(u()))), a = 6.283185307179586 * u();
    // Each half has twice the variance of the mean, here 1.
    const double d = std::sqrt(2.) * r * (std::cos(a) - std::sin(a)), v = d * d / 4;
    mean += v / n, squares += v * v / n;
  }
  EXPECT_NEAR(mean, 1, .01);
  EXPECT_NEAR(std::sqrt(squares - mean * mean) / mean, 1.4142, .02);
}

// Normalised kernels give what they take, where no border cuts them: weights that only the distance makes, and those of
// equal guides.
TEST(Goldens, EnergyIsKeptInTheInterior)
{
  ForEachTarget(
    [&](const char*)
    {
      double sums[3];
      {
        const Image image = Island(2 * quell::ATrousHalo(3), sums);
        ExpectSums(Cascade(image, 3), sums, "a-trous");
      }
      {
        const Image image = Island(12, sums);
        Image out(image.extent, 3), same(image.extent, 3, .5f), depth(image.extent, 1, 3.f);
        quell::BilateralInputs in;
        in.radiance = image, in.albedo = same, in.depth = depth, in.normal = same;
        quell::BilateralParameters p;
        p.radius = 6, p.sigmaSpatial = 2, p.sigmaRange = 1e30;
        std::vector<float> scratch(quell::BilateralScratch(in, p, image.extent));
        quell::Bilateral(in, p, { out, {} }, image.extent, scratch.data());
        ExpectSums(out, sums, "bilateral");
      }
      {
        const Image image = Island(10, sums), second = Island(10, sums), same(image.extent, 3, .5f);
        const quell::ImageIn radiance[2] = { image, second }, albedo[2] = { same, same };
        for (const auto pairs : { quell::SamplePairs::Same, quell::SamplePairs::All })
        {
          quell::SampleFilterInputs in;
          in.count = 2, in.radiance = radiance, in.albedo = albedo;
          quell::SampleFilterParameters p;
          p.pairs = pairs, p.demodulate = true;
          Image out(image.extent, 3);
          std::vector<float> scratch(quell::SampleFilterScratch(in, p, image.extent));
          quell::SampleFilter(in, p, out, image.extent, scratch.data());
          ExpectSums(out, sums, "samples");
        }
      }
      {
        // So much noise that all patches are alike: the mean over the window.
        const Image image = Island(10, sums), variance(image.extent, 1, 1e6f);
        quell::NonLocalInputs in;
        in.target = in.guide = image, in.variance = variance;
        quell::NonLocalParameters p;
        p.radius = 4, p.patch = 1, p.kColor = 1;
        Image out(image.extent, 3);
        std::vector<float> scratch(quell::NonLocalScratch(in, p, image.extent));
        quell::NonLocal(in, p, out, image.extent, scratch.data());
        ExpectSums(out, sums, "non-local means");
      }
      {
        // Every scale, pixel by pixel.
        const Image image = Island(20, sums), variance(image.extent, 1, 1.f);
        quell::VarianceSteeredInputs in;
        in.radiance = image, in.variance = variance;
        quell::VarianceSteeredParameters p;
        std::vector<float> scratch(quell::VarianceSteeredScratch(in, p, image.extent));
        for (int scale = 1; scale <= 3; ++scale)
        {
          Image out(image.extent, 3);
          for (int y = 10; y < image.extent.y1 - 10; ++y)
            for (int x = 10; x < image.extent.x1 - 10; ++x)
            {
              const auto v = quell::VarianceSteeredVector(in, p, scale, x, y, scratch.data());
              for (int c = 0; c < 3; ++c)
                out.at(x, y)[c] = float(v.Color[c]);
            }
          ExpectSums(out, sums, "variance-steered");
        }
      }
    });
}
