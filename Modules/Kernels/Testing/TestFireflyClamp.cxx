// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellFireflyClamp.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
double Length(const float* c)
{
  return std::sqrt(double(c[0]) * c[0] + double(c[1]) * c[1] + double(c[2]) * c[2]);
}
const quell::Rect One{ 0, 0, 1, 1 };
quell::FireflyClampParameters Clamp(float threshold, quell::ClampMeasure measure = quell::ClampMeasure::Length)
{
  quell::FireflyClampParameters p;
  p.threshold = threshold;
  p.measure = measure;
  return p;
}
}

TEST(FireflyClamp, KeepsHueAndLength)
{
  Image in(One, 3), out(One, 3), rest(One, 3);
  in.data = { 30.f, 40.f, 0.f };
  const auto ledger = quell::FireflyClamp(in, {}, Clamp(5), out, rest, One);
  EXPECT_FLOAT_EQ(out.data[0], 3.f);
  EXPECT_FLOAT_EQ(out.data[1], 4.f);
  EXPECT_EQ(out.data[2], 0.f);
  EXPECT_EQ(ledger.Clamped, 1);
  EXPECT_NEAR(ledger.EnergyIn, .2126 * 30 + .7152 * 40, 1e-5);
  EXPECT_NEAR(ledger.EnergyRemoved, .9 * ledger.EnergyIn, 1e-5);
  in.data = { 1e30f, 1e30f, 1e30f }; // white: 5 / sqrt(3) each, no overflow on the way
  quell::FireflyClamp(in, {}, Clamp(5), out, rest, One);
  for (float v : out.data)
    EXPECT_NEAR(v, 2.886751346, 1e-6);
  in.data = { FLT_MAX, FLT_MAX, 0 };
  quell::FireflyClamp(in, {}, Clamp(5), out, rest, One);
  EXPECT_NEAR(Length(out.data.data()), 5, 1e-5);
}

TEST(FireflyClamp, LargestThresholdIsOff)
{
  Image in(One, 3), out(One, 3), rest(One, 3);
  in.data = { FLT_MAX, 1e31f, 0 };
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(1e30f), out, rest, One).Clamped, 0);
  EXPECT_TRUE(out == in);
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(9e29f), out, rest, One).Clamped, 1);
}

TEST(FireflyClamp, LargestIsOfTheLightThatAnIlluminationStandsFor)
{
  quell::FireflyClampParameters p = Clamp(1e30f);
  p.largest = 65504;
  Image in(One, 3), out(One, 3), rest(One, 3), albedo(One, 3);
  // Whatever a half float holds stays to the last bit, also divided by the least albedo.
  in.data = { 65504 / 0.001f * 0.99999f, -1, 3 };
  albedo.data = { 0, 1, 0.5f };
  EXPECT_EQ(quell::FireflyClamp(in, {}, p, out, rest, One, albedo).Clamped, 0);
  EXPECT_TRUE(out == in);
  // Broken ones lose all but that, and keep their hue.
  in.data = { FLT_MAX, -FLT_MAX / 2, 0 };
  albedo.data = { 0.5f, 0.5f, std::nanf("") };
  EXPECT_EQ(quell::FireflyClamp(in, {}, p, out, rest, One, albedo).Guarded, 1);
  EXPECT_FLOAT_EQ(out.data[0], 65504 / 0.5f);
  EXPECT_FLOAT_EQ(out.data[1], -65504);
  EXPECT_EQ(out.data[2], 0.f);
  for (int k = 0; k < 3; ++k)
    EXPECT_EQ(out.data[k] + rest.data[k], in.data[k]);
  // Without an albedo it is of the colour; of both limits the lower one holds, and a count raises the first alone.
  quell::FireflyClamp(in, {}, p, out, rest, One);
  EXPECT_FLOAT_EQ(out.data[0], 65504);
  p.threshold = 5;
  const auto threshold = quell::FireflyClamp(in, {}, p, out, rest, One, albedo);
  EXPECT_EQ(threshold.Clamped, 1);
  EXPECT_EQ(threshold.Guarded, 0);
  EXPECT_NEAR(Length(out.data.data()), 5, 1e-5);
  p.growth = 1;
  Image count(One, 1, 1e6f);
  quell::FireflyClamp(in, count, p, out, rest, One, albedo);
  EXPECT_FLOAT_EQ(out.data[0], 65504 / 0.5f);
}

// The way past pixels that are small gives what the long way gives, to the last bit, around the threshold.
TEST(FireflyClamp, NextToTheThreshold)
{
  Random u(5);
  for (const auto measure :
    { quell::ClampMeasure::Length, quell::ClampMeasure::Luminance, quell::ClampMeasure::Maximum })
    for (int i = 0; i < 20000; ++i)
    {
      Image in(One, 3), out(One, 3), rest(One, 3);
      for (float& v : in.data)
        v = u() - 0.5f;
      const double size = quell::MeasureOf(in.data.data(), measure);
      const float threshold = float(size * (0.999 + 0.002 * u()));
      const auto ledger = quell::FireflyClamp(in, {}, Clamp(threshold, measure), out, rest, One);
      ASSERT_EQ(ledger.Clamped, size > threshold);
      ASSERT_EQ(out == in, size <= threshold);
    }
}

TEST(FireflyClamp, ThresholdItselfAndZero)
{
  Image in(One, 3), out(One, 3), rest(One, 3);
  in.data = { 3, 4, 0 };
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(5), out, rest, One).Clamped, 0);
  EXPECT_TRUE(out == in);
  quell::FireflyClamp(in, {}, Clamp(0), out, rest, One);
  EXPECT_EQ(out.data, std::vector<float>({ 0, 0, 0 }));
  EXPECT_TRUE(rest == in);
}

TEST(FireflyClamp, LedgerIsExactForMillionsOfValues)
{
  Random u(11);
  const quell::Rect e{ 0, 0, 1000, 400 };
  Image in(e, 3), out(e, 3), rest(e, 3);
  for (float& v : in.data)
    v = (u() - 0.2f) * std::exp(60 * (u() - 0.5f));
  in.data[0] = 1e38f, in.data[1] = -1e38f, in.data[2] = 1e-42f;
  for (const float threshold : { 5.f, 0.37f, 1e-8f, 1e10f })
  {
    const auto ledger = quell::FireflyClamp(in, {}, Clamp(threshold), out, rest, e);
    EXPECT_GT(ledger.Clamped, 1000);
    EXPECT_LT(ledger.Clamped, e.area());
    size_t wrong = 0;
    for (size_t i = 0; i < in.data.size(); ++i)
      wrong += out.data[i] + rest.data[i] != in.data[i];
    EXPECT_EQ(wrong, 0u);
    for (int x = 0; x < e.x1; ++x)
      ASSERT_LE(Length(out.at(x, 7)), threshold * (1 + 3e-7));
  }
}

TEST(FireflyClamp, OutputsOnDemand)
{
  Image in(One, 3, 10.f), out(One, 3);
  const auto a = quell::FireflyClamp(in, {}, Clamp(1), out, {}, One);
  const auto b = quell::FireflyClamp(in, {}, Clamp(1), {}, {}, One);
  EXPECT_EQ(a.EnergyRemoved, b.EnergyRemoved);
}

TEST(FireflyClamp, NonFinite)
{
  const quell::Rect e{ 0, 0, 3, 3 };
  Image in(e, 3, 1.f), out(e, 3), rest(e, 3);
  in.at(1, 1)[2] = Inf;
  const auto ledger = quell::FireflyClamp(in, {}, Clamp(5), out, rest, e);
  EXPECT_EQ(ledger.NonFinite, 1);
  EXPECT_NEAR(ledger.EnergyIn, 8, 1e-5); // the eight others
  for (float v : out.data)
    EXPECT_EQ(v, 1.f);
  for (float v : rest.data)
    EXPECT_EQ(v, 0.f);
}

TEST(FireflyClamp, MeasuresKeepHueToo)
{
  Image in(One, 3), out(One, 3), rest(One, 3);
  in.data = { 30.f, 40.f, 2.f };
  quell::FireflyClamp(in, {}, Clamp(10, quell::ClampMeasure::Maximum), out, rest, One);
  EXPECT_EQ(out.data, std::vector<float>({ 7.5f, 10.f, .5f }));
  const double l = .2126 * 30 + .7152 * 40 + .0722 * 2;
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(10, quell::ClampMeasure::Luminance), out, rest, One).Clamped, 1);
  for (int k = 0; k < 3; ++k)
  {
    EXPECT_NEAR(out.data[k], in.data[k] * 10 / l, 1e-6 * in.data[k]);
    EXPECT_EQ(out.data[k] + rest.data[k], in.data[k]);
  }
  in.data = { 0, 0, 60 }; // blue is dark: luminance 4.3
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(5, quell::ClampMeasure::Luminance), out, rest, One).Clamped, 0);
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(5, quell::ClampMeasure::Maximum), out, rest, One).Clamped, 1);
  in.data = { -30, 0, 0 }; // signed layers: magnitudes
  EXPECT_EQ(quell::FireflyClamp(in, {}, Clamp(5, quell::ClampMeasure::Maximum), out, rest, One).Clamped, 1);
  EXPECT_FLOAT_EQ(out.data[0], -5);
}

// Appendix B.7 / section 2.2: E[min(X, c)] of an exponential variable, by the midpoint rule in probability.
TEST(FireflyClamp, KeepsThisMuchOfAnExponential)
{
  const quell::Rect e{ 0, 0, 4000, 100 };
  Image in(e, 3), out(e, 3);
  for (size_t i = 0; i < in.data.size(); ++i)
    in.data[i] = float(-std::log(1 - (double(i / 3) + .5) / double(in.data.size() / 3)));
  const float clips[] = { 1, 3, 5, 10 };
  const double kept[] = { .632121, .950213, .993262, .999955 };
  for (int i = 0; i < 4; ++i)
  {
    const auto ledger = quell::FireflyClamp(in, {}, Clamp(clips[i], quell::ClampMeasure::Luminance), out, {}, e);
    EXPECT_NEAR(ledger.EnergyIn / e.area(), 1, 1e-5);
    EXPECT_NEAR(1 - ledger.EnergyRemoved / ledger.EnergyIn, kept[i], 2e-6);
  }
  // A lamp seen with probability 1/50: clipping at 5 keeps a tenth.
  Image lamp(e, 3);
  for (int y = 0; y < e.y1; ++y)
    for (int x = 0; x < e.x1; x += 50)
      lamp.fill(x, y, 50);
  const auto ledger = quell::FireflyClamp(lamp, {}, Clamp(5, quell::ClampMeasure::Maximum), out, {}, e);
  EXPECT_NEAR(1 - ledger.EnergyRemoved / ledger.EnergyIn, .1, 1e-6);
}

TEST(FireflyClamp, ThresholdGrowsWithTheCount)
{
  const quell::Rect e{ 0, 0, 5, 1 };
  Image in(e, 3, 100.f), out(e, 3), count(e, 1);
  count.data = { 0, 1, 9, NaN, 1e30f };
  auto p = Clamp(2, quell::ClampMeasure::Maximum);
  p.growth = .5f;
  quell::FireflyClamp(in, count, p, out, {}, e);
  const float expected[] = { 2, 2, 6, 2, 100 };
  for (int x = 0; x < 5; ++x)
    EXPECT_FLOAT_EQ(out.at(x, 0)[1], expected[x]);
  p.growth = 0;
  quell::FireflyClamp(in, count, p, out, {}, e);
  for (float v : out.data)
    EXPECT_FLOAT_EQ(v, 2);
  // The mean of n frames, each clamped at t sqrt(n): X = 50 with probability 1/50 is black 49 times. Clamped at 1 it
  // stays at 0.02; with growth the energy comes back.
  double fixedMean = 0, growing = 0;
  Image frame(One, 3), clamped(One, 3), n(One, 1);
  const int frames = 20000;
  for (int i = 0; i < frames; ++i)
  {
    frame.fill(0, 0, i % 50 == 49 ? 50.f : 0.f);
    n.fill(0, 0, float(i + 1));
    auto q = Clamp(1, quell::ClampMeasure::Maximum);
    quell::FireflyClamp(frame, n, q, clamped, {}, One);
    fixedMean += clamped.data[0] / frames;
    q.growth = .5f;
    quell::FireflyClamp(frame, n, q, clamped, {}, One);
    growing += clamped.data[0] / frames;
  }
  EXPECT_NEAR(fixedMean, .02, 1e-6);
  EXPECT_GT(growing, .93);
  EXPECT_LT(growing, 1);
}
