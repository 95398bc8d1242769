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
}

TEST(FireflyClamp, KeepsHueAndLength)
{
  Image in(One, 3), out(One, 3), rest(One, 3);
  in.data = { 30.f, 40.f, 0.f };
  const auto ledger = quell::FireflyClamp(in, 5, out, rest, One);
  EXPECT_FLOAT_EQ(out.data[0], 3.f);
  EXPECT_FLOAT_EQ(out.data[1], 4.f);
  EXPECT_EQ(out.data[2], 0.f);
  EXPECT_EQ(ledger.Clamped, 1);
  EXPECT_NEAR(ledger.EnergyIn, .2126 * 30 + .7152 * 40, 1e-5);
  EXPECT_NEAR(ledger.EnergyRemoved, .9 * ledger.EnergyIn, 1e-5);
  in.data = { 1e30f, 1e30f, 1e30f }; // white: 5 / sqrt(3) each, no overflow on the way
  quell::FireflyClamp(in, 5, out, rest, One);
  for (float v : out.data)
    EXPECT_NEAR(v, 2.886751346, 1e-6);
  in.data = { FLT_MAX, FLT_MAX, 0 };
  quell::FireflyClamp(in, 5, out, rest, One);
  EXPECT_NEAR(Length(out.data.data()), 5, 1e-5);
}

TEST(FireflyClamp, ThresholdItselfAndZero)
{
  Image in(One, 3), out(One, 3), rest(One, 3);
  in.data = { 3, 4, 0 };
  EXPECT_EQ(quell::FireflyClamp(in, 5, out, rest, One).Clamped, 0);
  EXPECT_TRUE(out == in);
  quell::FireflyClamp(in, 0, out, rest, One);
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
    const auto ledger = quell::FireflyClamp(in, threshold, out, rest, e);
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
  const auto a = quell::FireflyClamp(in, 1, out, {}, One);
  const auto b = quell::FireflyClamp(in, 1, {}, {}, One);
  EXPECT_EQ(a.EnergyRemoved, b.EnergyRemoved);
}

TEST(FireflyClamp, NonFinite)
{
  const quell::Rect e{ 0, 0, 3, 3 };
  Image in(e, 3, 1.f), out(e, 3), rest(e, 3);
  in.at(1, 1)[2] = Inf;
  const auto ledger = quell::FireflyClamp(in, 5, out, rest, e);
  EXPECT_EQ(ledger.NonFinite, 1);
  EXPECT_NEAR(ledger.EnergyIn, 8, 1e-5); // the eight others
  for (float v : out.data)
    EXPECT_EQ(v, 1.f);
  for (float v : rest.data)
    EXPECT_EQ(v, 0.f);
}
