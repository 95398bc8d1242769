// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellTemporalAntialias.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

using namespace quell;

namespace
{
using quelltest::Inf;
using quelltest::NaN;

struct Taa
{
  Rect frame;
  std::vector<float> color, history, motion, depth, result;
  AntialiasParameters par;

  Taa(int w, int h, float value)
    : frame{ 0, 0, w, h }
    , color(3 * w * h, value)
    , history(3 * w * h, value)
    , motion(2 * w * h)
    , depth(w * h, 1)
    , result(3 * w * h, -1)
  {
  }
  std::size_t index(int x, int y) const { return std::size_t(y) * frame.width() + x; }
  void set(std::vector<float>& v, int x, int y, float r, float g, float b)
  {
    v[3 * index(x, y)] = r;
    v[3 * index(x, y) + 1] = g;
    v[3 * index(x, y) + 2] = b;
  }
  void move(float x, float y)
  {
    for (std::size_t i = 0; i < motion.size(); i += 2)
    {
      motion[i] = x;
      motion[i + 1] = y;
    }
  }
  std::int64_t run(bool withHistory = true)
  {
    const ImageIn h = withHistory ? ImageIn(history.data(), 3, frame) : ImageIn();
    return TemporalAntialias(
      { { color.data(), 3, frame }, { motion.data(), 2, frame }, { depth.data(), 1, frame }, h, frame }, par,
      { result.data(), 3, frame }, frame);
  }
  float at(int x, int y, int c = 0) const { return result[3 * index(x, y) + c]; }
};
}

TEST(TemporalAntialias, FirstFrameIsTheInputBitForBit)
{
  Taa t(5, 4, 0);
  const float values[] = { 0.1f, 1e30f, 1e-42f, 3, 0, 1e-6f, 65504 };
  for (std::size_t i = 0; i < t.color.size(); ++i)
    t.color[i] = values[i % 7];
  t.run(false);
  EXPECT_EQ(t.result, t.color);
}

TEST(TemporalAntialias, ConstantImageIsAFixedPoint)
{
  for (float v : { 0.f, 1e-42f, 1e-6f, 0.18f, 1.f, 1e4f, 1e16f, 1e30f })
    for (float m : { 0.f, 0.37f, -1.61f })
    {
      Taa t(8, 8, v);
      t.move(m, 0.5f * m);
      t.run();
      EXPECT_EQ(t.result, t.color) << v << " " << m;
    }
}

TEST(TemporalAntialias, OffScreenReturnsTheInput)
{
  for (float m : { 1e9f, -1e9f, NaN, Inf, 8.f, -8.f })
  {
    Taa t(8, 8, 0.25f);
    t.history.assign(t.history.size(), 0.5f);
    t.set(t.color, 3, 3, 0.7f, 0.1f, 0.2f);
    t.move(m, 0);
    t.run();
    EXPECT_EQ(t.result, t.color) << m;
  }
}

TEST(TemporalAntialias, HistoryIsClippedToTheNeighbourhood)
{
  // A flat neighbourhood keeps nothing of another history.
  Taa flat(5, 5, 0.5f);
  flat.history.assign(flat.history.size(), 100.f);
  flat.run();
  EXPECT_FLOAT_EQ(flat.at(2, 2), 0.5f);

  // A gray one keeps mean + gamma sigma, in c / (1 + c), and blends: written out here.
  Taa t(3, 3, 0);
  const float gray[9] = { 0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.8f, 0.9f };
  double mean = 0, square = 0;
  for (int i = 0; i < 9; ++i)
  {
    t.set(t.color, i % 3, i / 3, gray[i], gray[i], gray[i]);
    const double c = gray[i] / (1. + gray[i]);
    mean += c / 9;
    square += c * c / 9;
  }
  t.history.assign(t.history.size(), 50.f);
  for (double gamma : { 0.5, 1., 1.25 })
  {
    t.par.gamma = gamma;
    t.par.alpha = 0.1;
    t.run();
    const double clipped = mean + gamma * std::sqrt(square - mean * mean);
    const double blended = clipped + 0.1 * (0.5 / 1.5 - clipped);
    EXPECT_NEAR(t.at(1, 1), blended / (1 - blended), 1e-5) << gamma;
  }
  // Within the range it is kept: only the blend remains.
  t.par.gamma = 1;
  t.history.assign(t.history.size(), 0.55f);
  t.run();
  const double blended = 0.55 / 1.55 + 0.1 * (0.5 / 1.5 - 0.55 / 1.55);
  EXPECT_NEAR(t.at(1, 1), blended / (1 - blended), 1e-6);
}

TEST(TemporalAntialias, BrightSpotsAreDamped)
{
  // One new pixel of 1000 in a noisy gray image must not add alpha * 1000.
  Taa t(7, 7, 0.5f);
  t.set(t.color, 3, 3, 1000, 1000, 1000);
  t.run();
  EXPECT_LT(t.at(3, 3), 1.f);
  EXPECT_GT(t.at(3, 3), 0.5f);
}

TEST(TemporalAntialias, MotionOfTheNearestSurfaceIsUsed)
{
  Taa t(9, 9, 0.5f);
  t.par.gamma = 1e6;
  // History is a ramp in x. Only pixel (5, 4) is near and moves by +2.
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 9; ++x)
      t.set(t.history, x, y, 0.1f * x, 0.1f * x, 0.1f * x);
  for (std::size_t i = 0; i < t.color.size(); ++i)
    t.color[i] = t.history[i];
  t.motion[2 * t.index(5, 4)] = 2;
  t.par.alpha = 0;
  t.run();
  EXPECT_NEAR(t.at(4, 4), 0.4f, 1e-6);
  t.depth[t.index(5, 4)] = 0.5f;
  t.run();
  EXPECT_NEAR(t.at(4, 4), 0.6f, 1e-6);
  EXPECT_NEAR(t.at(6, 5), 0.8f, 1e-6);
  EXPECT_NEAR(t.at(3, 4), 0.3f, 1e-6); // two pixels away
  // Depth that is not finite is far.
  t.depth.assign(t.depth.size(), Inf);
  t.depth[t.index(4, 4)] = NaN;
  t.run();
  EXPECT_NEAR(t.at(4, 4), 0.4f, 1e-6);
}

TEST(TemporalAntialias, HistoryIsFetchedByCatmullRom)
{
  Taa t(12, 12, 0.5f);
  t.par = { 0, 1e6 };
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 12; ++x)
    {
      t.set(t.history, x, y, x == 6 ? 0.2f : 0.1f, 0.1f, 0.1f);
      t.set(t.color, x, y, (x + y) % 2 ? 0.f : 1.f, 0.5f, 0.2f);
    }
  t.move(0.5f, 0);
  t.run();
  // Half way, the weights are (-1, 9, 9, -1) / 16: 9/16 of the line where a bilinear fetch would have 8/16.
  const double bright = 9. / 16, w1 = 1 / 1.2, w0 = 1 / 1.1;
  const double expected = (bright * 0.2 * w1 + (1 - bright) * 0.1 * w0) / (bright * w1 + (1 - bright) * w0);
  EXPECT_NEAR(t.at(5, 6, 0), expected, 1e-6);
  EXPECT_NEAR(t.at(5, 6, 1), 0.1, 1e-3);
}

TEST(TemporalAntialias, NonFiniteNeverSpreads)
{
  for (float bad : { NaN, Inf, -Inf })
  {
    Taa t(9, 9, 0.5f);
    t.set(t.color, 4, 4, 0.5f, bad, 0.5f);
    EXPECT_EQ(t.run(), 1);
    for (float v : t.result)
      EXPECT_FLOAT_EQ(v, 0.5f);
    EXPECT_EQ(t.run(false), 1);
    for (float v : t.result)
      EXPECT_FLOAT_EQ(v, 0.5f);
    // In the history, at a fractional fetch: four by four pixels would be lost to a plain filter.
    Taa h(9, 9, 0.5f);
    h.set(h.history, 4, 4, bad, bad, bad);
    h.move(0.3f, 0.4f);
    EXPECT_EQ(h.run(), 0);
    for (float v : h.result)
      EXPECT_FLOAT_EQ(v, 0.5f);
    Taa all(3, 3, bad);
    EXPECT_EQ(all.run(), 9);
    EXPECT_EQ(all.result, std::vector<float>(27, 0.f));
  }
}

namespace
{
/// Everything at once: edges, motion of all sizes, a region far brighter, fireflies, some bad pixels.
Taa Wild(int w, int h, bool bad)
{
  Taa t(w, h, 0);
  quelltest::Random u(3);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const float base = (x > w / 2 ? 1e5f : 0.3f) * (u() < 0.01f ? 1e3f : 1.f);
      for (int c = 0; c < 3; ++c)
      {
        t.color[3 * t.index(x, y) + c] = base * (0.5f + u());
        t.history[3 * t.index(x, y) + c] = base * (0.6f + 0.8f * u()) - (u() < 0.02f ? 1.f : 0.f);
      }
      t.motion[2 * t.index(x, y)] = u() < 0.3f ? 0.f : 6 * u() - 3;
      t.motion[2 * t.index(x, y) + 1] = u() < 0.3f ? 0.f : 6 * u() - 3;
      t.depth[t.index(x, y)] = u() < 0.1f ? Inf : 1 + float(x / 9) + 0.1f * u();
    }
  if (bad)
    for (int i = 0; i < 12; ++i)
    {
      t.color[std::size_t(u() * float(t.color.size()))] = i % 2 ? NaN : 3e38f;
      t.history[std::size_t(u() * float(t.history.size()))] = i % 3 ? Inf : -2e30f;
      t.motion[std::size_t(u() * float(t.motion.size()))] = i % 2 ? NaN : 1e9f;
    }
  return t;
}
std::int64_t RunOver(Taa& t, const Rect& tile, bool scalar)
{
  const AntialiasInputs in{ { t.color.data(), 3, t.frame }, { t.motion.data(), 2, t.frame },
    { t.depth.data(), 1, t.frame }, { t.history.data(), 3, t.frame }, t.frame };
  const ImageOut out(t.result.data(), 3, t.frame);
  return scalar ? TemporalAntialiasScalar(in, t.par, out, tile) : TemporalAntialias(in, t.par, out, tile);
}
}

TEST(TemporalAntialias, ScalarAgreesWithEveryTarget)
{
  for (const bool bad : { false, true })
    for (const double alpha : { 0.1, 0.5 })
      for (const double gamma : { 1., 1.25, 1e6 })
      {
        Taa scalar = Wild(211, 67, bad);
        scalar.par = { alpha, gamma };
        Taa vector = scalar;
        const std::int64_t count = RunOver(scalar, scalar.frame, true);
        quelltest::ForEachTarget(
          [&](const char* name)
          {
            EXPECT_EQ(RunOver(vector, vector.frame, false), count) << name;
            const quelltest::Difference e = quelltest::Compare(vector.result, scalar.result, 1e-2); // some are nearly 0
            EXPECT_LT(e.relative, 1e-5) << name << " " << bad << " " << alpha << " " << gamma;
            EXPECT_LT(e.smape, 1e-6) << name;
          });
      }
}

TEST(TemporalAntialias, ConstantsAreFixedPointsOnEveryTarget)
{
  quelltest::ForEachTarget(
    [&](const char* name)
    {
      for (const float v : { 0.f, 1e-42f, 0.18f, 1.f, 65504.f, 1e11f, 1e30f, -0.7f })
        for (const float m : { 0.f, 0.37f, -1.61f })
        {
          Taa t(40, 9, v);
          t.move(m, 0.5f * m);
          t.run();
          EXPECT_EQ(t.result, t.color) << v << " " << m << " " << name;
        }
    });
}

TEST(TemporalAntialias, TilesGiveTheSameBits)
{
  Taa whole = Wild(300, 40, true), tiles = whole;
  RunOver(whole, whole.frame, false);
  for (const int size : { 7, 64, 131 })
  {
    for (int y = 0; y < 40; y += size)
      for (int x = 0; x < 300; x += size)
        RunOver(tiles, Rect{ x, y, x + size, y + size }.clipped(whole.frame), false);
    EXPECT_EQ(0, std::memcmp(tiles.result.data(), whole.result.data(), whole.result.size() * sizeof(float))) << size;
  }
}
