// SPDX-License-Identifier: BSD-3-Clause
// The tests by which images are judged, judged themselves.
#include "Statistics.h"

#include <gtest/gtest.h>

#include <random>

using namespace statistics;

namespace
{
enum class Noise
{
  Normal,
  Exponential, ///< skewed, as light is
};

Picture Image(unsigned seed, double mean, double sigma, Noise noise = Noise::Normal, int size = 64, int channels = 3)
{
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  std::exponential_distribution<double> exponential;
  Picture p;
  p.Width = p.Height = size;
  p.Channels = channels;
  for (int i = 0; i < size * size * channels; ++i)
    p.Pixels.push_back(float(mean + sigma * (noise == Noise::Normal ? normal(engine) : exponential(engine) - 1)));
  return p;
}

Picture Constant(double value, int size = 64, int channels = 1)
{
  Picture p;
  p.Width = p.Height = size;
  p.Channels = channels;
  p.Pixels.assign(std::size_t(size * size * channels), float(value));
  return p;
}

/// Chance of more than `count` of `n` where each has chance p.
double BinomialTail(int count, int n, double p)
{
  double sum = 0;
  for (int k = 0; k <= count; ++k)
    sum += std::exp(
      std::lgamma(n + 1.) - std::lgamma(k + 1.) - std::lgamma(n - k + 1.) + k * std::log(p) + (n - k) * std::log1p(-p));
  return 1 - sum;
}
}

TEST(Statistics, Distributions)
{
  EXPECT_NEAR(NormalTail(1.959963985), .05, 1e-9);
  EXPECT_NEAR(NormalTail(-5), 5.733031e-7, 1e-12);
  EXPECT_NEAR(NormalThreshold(.05), 1.959963985, 1e-8);
  // one degree of freedom: Cauchy; two: 1 - t / sqrt(2 + t^2)
  EXPECT_NEAR(StudentTail(3, 1), 1 - 2 / 3.14159265358979 * std::atan(3.), 1e-12);
  EXPECT_NEAR(StudentTail(3, 2), 1 - 3 / std::sqrt(11.), 1e-12);
  EXPECT_NEAR(StudentTail(2.5, 1e8), NormalTail(2.5), 1e-7);
  EXPECT_NEAR(StudentTail(StudentThreshold(1e-5, 63), 63), 1e-5, 1e-10);
  EXPECT_EQ(StudentTail(std::numeric_limits<double>::infinity(), 63), 0.);
  // two degrees of freedom: exponential
  EXPECT_NEAR(ChiSquaredTail(5, 2), std::exp(-2.5), 1e-12);
  EXPECT_NEAR(ChiSquaredTail(.3, 2), std::exp(-.15), 1e-12);
  EXPECT_NEAR(ChiSquaredTail(3.841458821, 1), .05, 1e-9);
  EXPECT_NEAR(ChiSquaredTail(124.342113, 100), .05, 1e-6);
  EXPECT_EQ(ChiSquaredTail(0, 4), 1.);
  // together 1 %
  for (int n : { 1, 10, 3072 })
    EXPECT_NEAR(1 - std::pow(1 - SidakLevel(.01, n), n), .01, 1e-9) << n;
  // halves: 11 bits
  EXPECT_EQ(HalfRounding(1), std::ldexp(1., -11));
  EXPECT_EQ(HalfRounding(1.99), std::ldexp(1., -11));
  EXPECT_EQ(HalfRounding(.3), std::ldexp(1., -13));
  EXPECT_EQ(HalfRounding(1e-6), std::ldexp(1., -25));
}

// Both tests cry wolf as often as they say: 200 pairs of images of equal means.
TEST(Statistics, FalseAlarms)
{
  const int seeds = 200;
  int strict[2] = {}, mild[2] = {}, share = 0;
  double rms = 0;
  for (int s = 0; s < seeds; ++s)
  {
    const Picture a = Image(unsigned(2 * s + 1), 2, .5), b = Image(unsigned(2 * s + 2), 2, .1);
    Picture a1 = Image(unsigned(2 * s + 1), 2, .5, Noise::Normal, 64, 1);
    const Picture v = Constant(.25), w = Constant(.01), b1 = Image(unsigned(5000 + s), 2, .1, Noise::Normal, 64, 1);
    const BlockTest spread = BySpread(a, b);
    strict[0] += spread.Bad > 0;
    mild[0] += BySpread(a, b, 8, .2).Bad > 0;
    strict[1] += ByVariance(a1, v, b1, &w).Bad > 0;
    mild[1] += ByVariance(a1, v, b1, &w, 8, .2).Bad > 0;
    share += !spread.Agrees();
    rms += spread.Rms / seeds;
  }
  for (int k = 0; k < 2; ++k)
  {
    EXPECT_GT(BinomialTail(strict[k] - 1, seeds, .01), 1e-3) << strict[k] << " of " << seeds << " at 1 %";
    EXPECT_GT(BinomialTail(mild[k] - 1, seeds, .2), 1e-3) << mild[k] << " of " << seeds << " at 20 %";
    EXPECT_LT(BinomialTail(mild[k] - 1, seeds, .2), .999) << mild[k] << " of " << seeds << " at 20 %";
  }
  // 192 blocks: 99.75 % of them is all
  EXPECT_EQ(share, strict[0]);
  EXPECT_NEAR(rms, std::sqrt(63. / 61), .01);
  RecordProperty("strict", std::to_string(strict[0]) + " " + std::to_string(strict[1]));
}

// Skewed noise (a light found by chance in one pixel of a few) raises no more false alarms where 99.75 % count.
TEST(Statistics, SkewedNoise)
{
  int alarms = 0;
  for (int s = 0; s < 40; ++s)
    alarms += !BySpread(Image(unsigned(2 * s + 1), 1, 1, Noise::Exponential, 160),
      Image(unsigned(2 * s + 2), 1, 1, Noise::Exponential, 160))
                 .Agrees();
  EXPECT_LE(alarms, 1);
}

// A block that is off by twice the threshold in standard errors is found; a whole image by far less.
TEST(Statistics, FindsABias)
{
  const Picture a = Image(1, 2, .5), b = Image(2, 2, .1);
  const BlockTest clean = BySpread(a, b);
  EXPECT_TRUE(clean.Agrees());
  EXPECT_NEAR(clean.Sensitivity, clean.Threshold * std::sqrt(.26) / 8 / 2, .03);

  Picture local = a;
  for (int y = 16; y < 24; ++y)
    for (int x = 40; x < 48; ++x)
      local.Pixels[std::size_t(3 * (64 * y + x) + 1)] *= float(1 + 2 * clean.Sensitivity);
  const BlockTest found = BySpread(local, b);
  EXPECT_EQ(found.Bad, 1);
  EXPECT_EQ(found.WorstX, 5);
  EXPECT_EQ(found.WorstY, 2);
  EXPECT_EQ(found.WorstChannel, 1);
  EXPECT_FALSE(found.Agrees());

  Picture everywhere = a;
  for (float& v : everywhere.Pixels)
    v *= 1.02f;
  const BlockTest whole = BySpread(everywhere, b);
  EXPECT_GT(whole.Whole, 4.5);
  EXPECT_NEAR(whole.WholeRatio, 1.02, .015);
  EXPECT_GT(whole.Rms, 1.2);
  EXPECT_LT(clean.Whole, 3.5);

  // by claimed variances, against an exact value
  const Picture one = Image(3, 2, .5, Noise::Normal, 64, 1), exact = Constant(2), off = Constant(2.05),
                v = Constant(.25);
  EXPECT_TRUE(ByVariance(one, v, exact, nullptr).Agrees());
  EXPECT_GT(ByVariance(one, v, off, nullptr).Whole, 4.5);
}

// Images without noise: equal, equal after rounding to half, and not.
TEST(Statistics, NoNoise)
{
  const Picture one = Constant(1.2345, 64, 3), half = Constant(1.234375, 64, 3), other = Constant(1.236, 64, 3);
  EXPECT_TRUE(BySpread(one, one).Agrees());
  EXPECT_FALSE(BySpread(one, half).Agrees());
  EXPECT_TRUE(BySpread(one, half, 8, .01, true).Agrees());
  EXPECT_FALSE(BySpread(one, other, 8, .01, true).Agrees());
  EXPECT_TRUE(BySpread(Constant(0, 64, 3), Constant(0, 64, 3)).Agrees());
  EXPECT_FALSE(BySpread(Constant(1e-9, 64, 3), Constant(0, 64, 3)).Agrees());
  EXPECT_FALSE(BySpread(Picture(), Picture()).Agrees());
  Picture broken = one;
  broken.Pixels[77] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(BySpread(broken, one).Agrees());
}

TEST(Statistics, ChiSquaredOfCounts)
{
  std::mt19937 engine(7);
  std::vector<double> even(50, 0.), expected(50, 400.);
  for (int i = 0; i < 20000; ++i)
    ++even[engine() % 50];
  EXPECT_GT(ChiSquaredTest(even, expected), .001);
  std::vector<double> odd = even;
  odd[3] += 100;
  odd[4] -= 100;
  EXPECT_LT(ChiSquaredTest(odd, expected), 1e-4);
  // cells that expect nearly nothing are pooled: no false alarm by one count in one of them
  std::vector<double> rare(1000, .01), seen(1000, 0.);
  rare[0] = 1000;
  seen[0] = 1003;
  seen[500] = 9;
  EXPECT_GT(ChiSquaredTest(seen, rare), .01);
}
