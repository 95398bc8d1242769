// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellDemodulate.h"
#include "quellSum.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
/// Units in the last place between two finite floats of the same sign.
std::int64_t Ulps(float a, float b)
{
  std::int32_t i, j;
  std::memcpy(&i, &a, 4);
  std::memcpy(&j, &b, 4);
  return std::abs(std::int64_t(i) - j);
}
const quell::Rect One{ 0, 0, 1, 1 };
}

TEST(Demodulate, RoundTripAtTheExtremes)
{
  const float floor = 1e-3f;
  for (const float x : { 0.f, 1e-42f, 1e-30f, 0.3f, 1.f, 5e6f, 1e30f, -0.7f })
    for (const float a : { 0.f, 1e-8f, floor, 0.05f, 0.18f, 0.999f, 1.f, 10.f, -1.f, NaN, Inf })
    {
      Image radiance(One, 3, x), albedo(One, 3, a), illumination(One, 3), back(One, 3);
      EXPECT_EQ(quell::Demodulate(radiance, albedo, floor, illumination, One), 0);
      EXPECT_TRUE(std::isfinite(*illumination.at(0, 0))) << x << " " << a;
      quell::Modulate(illumination, albedo, floor, back, One);
      EXPECT_LE(Ulps(back.data[1], x), 1) << x << " over " << a;
    }
}

TEST(Demodulate, RandomRoundTripIsAtMostOneUlp)
{
  Random u(3);
  const quell::Rect e{ 0, 0, 300, 300 };
  Image radiance(e, 3), albedo(e, 3), illumination(e, 3), back(e, 3);
  for (float& v : radiance.data)
    v = std::exp(40 * (u() - 0.5f));
  for (float& v : albedo.data)
    v = u();
  quell::Demodulate(radiance, albedo, 1e-3f, illumination, e);
  quell::Modulate(illumination, albedo, 1e-3f, back, e);
  std::int64_t off = 0;
  for (size_t i = 0; i < back.data.size(); ++i)
  {
    const auto ulps = Ulps(back.data[i], radiance.data[i]);
    ASSERT_LE(ulps, 1);
    off += ulps;
  }
  // Known rate of the rounding of (x / d) * d; far less would mean that nothing was divided.
  EXPECT_NEAR(double(off) / back.data.size(), 0.114, 0.03);
}

TEST(Demodulate, ValuesAndLimits)
{
  Image radiance(One, 3), albedo(One, 3), out(One, 3);
  radiance.data = { 1.f, 1.f, 3e38f };
  albedo.data = { 0.5f, 0.f, 0.01f };
  quell::Demodulate(radiance, albedo, 1e-3f, out, One);
  EXPECT_FLOAT_EQ(out.data[0], 2.f);
  EXPECT_FLOAT_EQ(out.data[1], 1000.f);
  EXPECT_EQ(out.data[2], FLT_MAX);
  quell::Modulate(radiance, albedo, 0.25f, out, One);
  EXPECT_FLOAT_EQ(out.data[0], 0.5f);
  EXPECT_FLOAT_EQ(out.data[1], 0.25f);
}

TEST(Demodulate, CheckerOfConstantIlluminationIsFlat)
{
  const quell::Rect e{ 0, 0, 8, 8 };
  Image radiance(e, 3), albedo(e, 3), out(e, 3);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x)
    {
      albedo.fill(x, y, (x + y) & 1 ? 0.5f : 0.25f);
      radiance.fill(x, y, 3.f * albedo.at(x, y)[0]);
    }
  quell::Demodulate(radiance, albedo, 1e-3f, out, e);
  for (float v : out.data)
    EXPECT_EQ(v, 3.f);
}

TEST(Demodulate, NonFiniteIsFilledCountedAndContained)
{
  const quell::Rect e{ 2, 3, 7, 8 };
  for (const float poison : { NaN, Inf, -Inf })
  {
    Image radiance(e, 3, 2.f), albedo(e, 3, 0.5f), out(e, 3), clean(e, 3);
    quell::Demodulate(radiance, albedo, 1e-3f, clean, e);
    radiance.at(4, 5)[1] = poison;
    EXPECT_EQ(quell::Demodulate(radiance, albedo, 1e-3f, out, e), 1);
    EXPECT_TRUE(out == clean);
    EXPECT_EQ(quell::Modulate(radiance, albedo, 1e-3f, out, e), 1);
    for (float v : out.data)
      EXPECT_EQ(v, 1.f);
  }
}

TEST(Sum, OrderOverflowAndNonFinite)
{
  const quell::Rect e{ 0, 0, 3, 2 };
  Image a(e, 3, 1e8f), b(e, 3, 1.f), c(e, 3, -1e8f), out(e, 3, 77.f);
  quell::AddTerm(a, true, out, e);
  quell::AddTerm(b, false, out, e);
  quell::AddTerm(c, false, out, e);
  EXPECT_EQ(out.data[0], 0.f); // (1e8 + 1) - 1e8 in float
  quell::AddTerm(a, true, out, e);
  quell::AddTerm(c, false, out, e);
  quell::AddTerm(b, false, out, e);
  EXPECT_EQ(out.data[0], 1.f);
  Image large(e, 3, 3e38f);
  large.fill(1, 0, NaN);
  EXPECT_EQ(quell::AddTerm(large, true, out, e), 1);
  EXPECT_EQ(out.data[3], 3e38f);
  quell::AddTerm(large, false, out, e);
  for (float v : out.data)
    EXPECT_EQ(v, FLT_MAX);
}
