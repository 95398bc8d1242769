// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellFeatureNoise.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
Image Noise(const Image& value, const quell::Rect& tile, const Image& normal = {}, const Image& depth = {})
{
  Image out(tile, 1, NaN);
  std::vector<float> scratch(quell::FeatureNoiseScratch(tile), NaN);
  quell::FeatureNoise(value, normal, depth, out, tile, scratch.data());
  return out;
}
/// Gaussian noise of the given deviation on a step in the middle.
Image Noisy(int w, int h, double deviation, float step = 0)
{
  Image value({ 0, 0, w, h }, 3);
  Random u(17);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c)
      {
        double n = -6;
        for (int k = 0; k < 12; ++k)
          n += u();
        value.at(x, y)[c] = float(0.5 + deviation * n) + (x >= w / 2 ? step : 0.f);
      }
  return value;
}
double Mean(const Image& image)
{
  double sum = 0;
  for (const float v : image.data)
    sum += v;
  return sum / double(image.data.size());
}
}

TEST(FeatureNoise, FindsTheVarianceOfGaussianNoise)
{
  for (const double deviation : { 1e-3, 0.05, 2. })
  {
    const Image value = Noisy(60, 60, deviation);
    const double v = Mean(Noise(value, value.extent)) / (deviation * deviation);
    EXPECT_GT(v, 0.8) << deviation; // medians of medians of skewed values: a little low
    EXPECT_LT(v, 1.1) << deviation;
  }
}

// Powers of two: nothing rounds otherwise.
TEST(FeatureNoise, OfLightOfAnySize)
{
  Image noise({ 0, 0, 40, 30 }, 3);
  Random u(5);
  for (float& v : noise.data)
    v = u();
  const Image wanted = Noise(noise, noise.extent);
  for (const int exponent : { -40, 20, 56 })
  {
    Image other = noise;
    for (float& v : other.data)
      v = std::ldexp(v, exponent);
    Image found = Noise(other, other.extent);
    for (float& v : found.data)
      v = std::ldexp(v, -2 * exponent);
    EXPECT_TRUE(found.data == wanted.data) << exponent;
  }
}

TEST(FeatureNoise, DoesNotTakeEdgesAndFlatsForNoise)
{
  const Image flat({ 0, 0, 20, 20 }, 3, 0.3f);
  for (const float v : Noise(flat, flat.extent).data)
    EXPECT_EQ(v, 0.f);
  const Image step = Noisy(40, 40, 1e-3, 0.5f);
  for (const float v : Noise(step, step.extent).data)
    EXPECT_LT(v, 1e-5f);
  Image checker({ 0, 0, 24, 24 }, 3);
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 24; ++x)
      checker.fill(x, y, (x / 4 + y / 4) & 1 ? 0.9f : 0.1f);
  for (const float v : Noise(checker, checker.extent).data)
    EXPECT_EQ(v, 0.f) << "squares of four pixels are a texture";
}

TEST(FeatureNoise, LeavesOutWhatIsNotComparable)
{
  Image value({ 0, 0, 20, 20 }, 3, 0.5f), depth({ 0, 0, 20, 20 }, 1, 1.f), normal({ 0, 0, 20, 20 }, 3, 0.f);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 20; ++x)
    {
      const bool odd = x & 1; // stripes that only the normals tell apart
      normal.at(x, y)[odd] = 1;
      value.fill(x, y, odd ? 0.9f : 0.1f);
    }
  EXPECT_GT(*Noise(value, value.extent).at(10, 10), 0.01f);
  // Each pixel still has those above and below; at the frame's edge too few.
  for (const float v : Noise(value, value.extent, normal).data)
    EXPECT_EQ(v, 0.f);
  *depth.at(5, 5) = Inf;
  value.at(9, 9)[1] = NaN;
  const Image out = Noise(value, value.extent, {}, depth);
  EXPECT_EQ(*out.at(5, 5), 0.f);
  EXPECT_EQ(*out.at(9, 9), 0.f);
  for (const float v : out.data)
    EXPECT_TRUE(std::isfinite(v));
}

TEST(FeatureNoise, BitsDoNotDependOnTheTile)
{
  const Image value = Noisy(50, 40, 0.1, 0.3f);
  const Image full = Noise(value, value.extent);
  for (const quell::Rect tile :
    { quell::Rect{ 0, 0, 7, 9 }, quell::Rect{ 20, 11, 33, 29 }, quell::Rect{ 49, 39, 50, 40 } })
  {
    const Image part = Noise(value, tile);
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        ASSERT_EQ(*part.at(x, y), *full.at(x, y));
  }
}
