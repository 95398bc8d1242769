// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellAccumulate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

using namespace quell;

namespace
{
using quelltest::NaN;

/// A row of pixels whose history is simply its last output.
struct Row
{
  int n;
  Rect extent;
  std::vector<float> color, moments, length;
  AccumulateParameters par;

  explicit Row(int count)
    : n(count)
    , extent{ 0, 0, count, 1 }
    , color(3 * count)
    , moments(2 * count)
    , length(count)
  {
  }
  std::int64_t add(const std::vector<float>& gray)
  {
    std::vector<float> rgb(3 * n);
    for (int i = 0; i < 3 * n; ++i)
      rgb[i] = gray[i / 3];
    return this->addColor(rgb);
  }
  std::int64_t addColor(const std::vector<float>& rgb)
  {
    const std::vector<float> c = color, m = moments, l = length;
    return Accumulate(
      { { rgb.data(), 3, extent }, { c.data(), 3, extent }, { m.data(), 2, extent }, { l.data(), 1, extent } }, par,
      { { color.data(), 3, extent }, { moments.data(), 2, extent }, { length.data(), 1, extent } }, extent);
  }
};
}

TEST(Accumulate, WeightsGiveTheTableOfNoiseGains)
{
  // Pixel k is 1 in frame k only, so after n frames it holds the weight of frame k; independent noise then has the
  // variance of the sum of their squares.
  const int n = 30;
  Row row(n);
  row.par.alpha = 0.2;
  const struct
  {
    int frames;
    double gain;
  } table[] = { { 1, 1 }, { 2, 0.5 }, { 4, 0.25 }, { 5, 0.2 }, { 8, 0.1344288 }, { 16, 0.1117478 } };
  for (int frame = 1; frame <= n; ++frame)
  {
    std::vector<float> x(n, 0.f);
    x[frame - 1] = 1;
    row.add(x);
    double sum = 0, squares = 0;
    for (int k = 0; k < n; ++k)
    {
      sum += row.color[3 * k];
      squares += double(row.color[3 * k]) * row.color[3 * k];
    }
    EXPECT_NEAR(sum, 1, 1e-6);
    for (const auto& entry : table)
      if (entry.frames == frame)
      {
        EXPECT_NEAR(squares, entry.gain, 2e-5) << frame;
      }
  }
  for (double alpha : { 0.2, 0.1, 0.05 })
  {
    // Steady state: alpha / (2 - alpha).
    const int m = 400;
    Row steady(m);
    steady.par = { alpha, alpha, 1e6 };
    for (int frame = 0; frame < m; ++frame)
    {
      std::vector<float> x(m, 0.f);
      x[frame] = 1;
      steady.add(x);
    }
    double squares = 0;
    for (int k = 0; k < m; ++k)
      squares += double(steady.color[3 * k]) * steady.color[3 * k];
    EXPECT_NEAR(squares, alpha / (2 - alpha), 1e-6);
  }
}

TEST(Accumulate, StepDecaysAsThePowerOfAlpha)
{
  Row row(1);
  row.par = { 0.2, 0.2, 32 };
  for (int i = 0; i < 40; ++i)
    row.add({ 1 });
  for (int i = 1; i <= 21; ++i)
  {
    row.add({ 0 });
    EXPECT_NEAR(row.color[0], std::pow(0.8, i), 1e-6);
  }
  EXPECT_LT(row.color[0], 0.01);
}

TEST(Accumulate, HistoryCountsAndIsCapped)
{
  Row row(1);
  row.par.maximumHistory = 5;
  for (int i = 1; i <= 8; ++i)
  {
    row.add({ float(i) });
    EXPECT_EQ(row.length[0], std::min(i, 5));
    if (i <= 5)
    {
      EXPECT_FLOAT_EQ(row.color[0], (i + 1) / 2.f); // a true mean so far
    }
  }
  Row none(1);
  none.par.maximumHistory = 1;
  for (float v : { 3.f, 8.f, 1e-40f })
  {
    none.add({ v });
    EXPECT_EQ(none.color[0], v);
  }
}

TEST(Accumulate, FirstFrameIsTheInputBitForBit)
{
  Row row(4);
  row.color.assign(12, NaN);
  row.moments.assign(8, NaN);
  row.add({ 0.1f, 1e30f, 1e-42f, 0 });
  EXPECT_EQ(row.color[0], 0.1f);
  EXPECT_EQ(row.color[3], 1e30f);
  EXPECT_EQ(row.color[6], 1e-42f);
  EXPECT_EQ(row.color[9], 0);
  EXPECT_EQ(row.moments[1], 0);
  EXPECT_EQ(row.length, std::vector<float>(4, 1.f));
}

TEST(Accumulate, MomentsAreTheWeightedMeanAndVariance)
{
  // Against weights written out, at a mean 1e5 times the deviation, where E[x^2] - E[x]^2 in float is off by more than
  // itself.
  Row row(1);
  std::vector<float> samples;
  for (int i = 0; i < 100; ++i)
  {
    samples.push_back(10000.f + ((i & 1) ? 0.1f : -0.1f) * (1 + i % 3));
    row.add({ samples.back() });
    std::vector<double> w;
    for (std::size_t k = 0; k < samples.size(); ++k)
    {
      const double a = std::max(0.2, 1. / (k + 1));
      for (double& v : w)
        v *= 1 - a;
      w.push_back(a);
    }
    double mean = 0, variance = 0;
    for (std::size_t k = 0; k < w.size(); ++k)
      mean += w[k] * samples[k];
    for (std::size_t k = 0; k < w.size(); ++k)
      variance += w[k] * (samples[k] - mean) * (samples[k] - mean);
    EXPECT_NEAR(row.moments[0], mean, 2e-3);
    if (i > 0)
    {
      EXPECT_NEAR(row.moments[1], variance, 0.02 * variance) << i;
    }
  }
}

TEST(Accumulate, NonFiniteInputKeepsHistory)
{
  for (float bad : { NaN, std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity() })
  {
    Row row(3);
    row.add({ 1, 2, 3 });
    row.add({ 3, 4, 5 });
    const std::vector<float> moments = row.moments;
    EXPECT_EQ(row.addColor({ 9, 9, 9, 7, bad, 7, 9, 9, 9 }), 1);
    EXPECT_EQ(row.color[3], 3);
    EXPECT_EQ(row.color[4], 3);
    EXPECT_EQ(row.length[1], 2);
    EXPECT_EQ(row.moments[2], moments[2]);
    EXPECT_EQ(row.moments[3], moments[3]);
    EXPECT_EQ(row.length[0], 3);
    // Without history: the finite neighbours' mean, and no length, so that the next frame starts anew.
    Row fresh(3);
    EXPECT_EQ(fresh.add({ 1, bad, 3 }), 1);
    EXPECT_EQ(fresh.color[3], 2);
    EXPECT_EQ(fresh.length[1], 0);
    fresh.add({ 1, 8, 3 });
    EXPECT_EQ(fresh.color[3], 8);
    EXPECT_EQ(fresh.length[1], 1);
    Row lost(2);
    EXPECT_EQ(lost.add({ bad, bad }), 2);
    EXPECT_EQ(lost.color, std::vector<float>(6, 0.f));
  }
}

TEST(Accumulate, NonFiniteHistoryVanishesInAFrame)
{
  Row row(3);
  row.add({ 1, 2, 3 });
  row.color[4] = NaN;
  row.moments[4] = std::numeric_limits<float>::infinity();
  row.add({ 3, 4, 5 });
  EXPECT_EQ(row.color[0], 2);
  EXPECT_EQ(row.color[3], 4); // history refused: the new value alone
  EXPECT_EQ(row.color[4], 4);
  EXPECT_EQ(row.length[1], 1);
  EXPECT_EQ(row.color[6], 5);
  EXPECT_EQ(row.length[2], 1);
}

TEST(Accumulate, HugeValuesStayFinite)
{
  Row row(1);
  for (float v : { 3e38f, 0.f, 3e38f, 1.f })
  {
    row.add({ v });
    EXPECT_TRUE(std::isfinite(row.color[0]));
    EXPECT_TRUE(std::isfinite(row.moments[0]));
    EXPECT_TRUE(std::isfinite(row.moments[1]));
  }
}

TEST(Accumulate, ScalarAgreesWithEveryTargetAndAnyTiles)
{
  using quelltest::Image;
  const Rect e{ 0, 0, 203, 31 };
  Image radiance(e, 3), history(e, 3), moments(e, 2), length(e, 1);
  quelltest::Random u(5);
  for (int y = 0; y < e.y1; ++y)
    for (int x = 0; x < e.x1; ++x)
    {
      const float base = u() < 0.05f ? 1e5f : 0.3f;
      for (int c = 0; c < 3; ++c)
      {
        radiance.at(x, y)[c] = base * u();
        history.at(x, y)[c] = base * (0.5f + u());
      }
      moments.at(x, y)[0] = base * (0.5f + u());
      moments.at(x, y)[1] = base * base * u();
      *length.at(x, y) = std::floor(40 * u());
      if (u() < 0.01f)
        radiance.at(x, y)[1] = u() < 0.5f ? NaN : 3e30f;
      if (u() < 0.01f)
        history.at(x, y)[2] = u() < 0.5f ? NaN : -3e30f;
      if (u() < 0.01f)
        moments.at(x, y)[1] = quelltest::Inf;
    }
  const AccumulateParameters par{ 0.05, 0.2, 32 };
  for (const bool withMoments : { true, false })
  {
    const AccumulateInputs in{ radiance, history, withMoments ? ImageIn(moments) : ImageIn(), length };
    Image color[3] = { Image(e, 3), Image(e, 3), Image(e, 3) }, second[3] = { Image(e, 2), Image(e, 2), Image(e, 2) },
          frames[3] = { Image(e, 1), Image(e, 1), Image(e, 1) };
    const std::int64_t bad = AccumulateScalar(in, par, { color[0], second[0], frames[0] }, e);
    EXPECT_GT(bad, 10);
    quelltest::ForEachTarget(
      [&](const char* name)
      {
        EXPECT_EQ(Accumulate(in, par, { color[1], second[1], frames[1] }, e), bad) << name;
        for (const auto& pair : { std::make_pair(&color[1], &color[0]), std::make_pair(&second[1], &second[0]),
               std::make_pair(&frames[1], &frames[0]) })
        {
          const quelltest::Difference d = quelltest::Compare(pair.first->data, pair.second->data, 1e-4);
          EXPECT_LT(d.relative, 1e-5) << name;
          EXPECT_LT(d.smape, 1e-6) << name;
        }
        std::int64_t count = 0;
        for (int y = 0; y < e.y1; y += 13)
          for (int x = 0; x < e.x1; x += 29)
            count += Accumulate(in, par, { color[2], second[2], frames[2] }, Rect{ x, y, x + 29, y + 13 }.clipped(e));
        EXPECT_EQ(count, bad) << name;
        EXPECT_TRUE(color[2] == color[1] && second[2] == second[1] && frames[2] == frames[1]) << name;
      });
  }
}
