// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellGuards.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

TEST(Guards, Extremes)
{
  EXPECT_TRUE(quell::Finite(FLT_MAX));
  EXPECT_TRUE(quell::Finite(-FLT_MAX));
  EXPECT_TRUE(quell::Finite(1e-42f));
  EXPECT_FALSE(quell::Finite(Inf));
  EXPECT_FALSE(quell::Finite(-Inf));
  EXPECT_FALSE(quell::Finite(NaN));
  EXPECT_EQ(quell::Sane({ -1.f, 2.f, 0.f }), quell::Vec3f(0, 2, 0));
  EXPECT_EQ(quell::Sane({ 1.f, NaN, 0.f }), quell::Vec3f());
  EXPECT_EQ(quell::SafeDivide(3, 0), 0.f);
  EXPECT_EQ(quell::SafeDivide(3, 2), 1.5f);
  EXPECT_EQ(quell::NegativeExp(0), 1.f);
  EXPECT_EQ(quell::NegativeExp(81), 0.f);
  EXPECT_EQ(quell::NegativeExp(NaN), 0.f);
  EXPECT_EQ(quell::NegativeExp(Inf), 0.f);
  EXPECT_GT(quell::NegativeExp(80), 0.f);
  EXPECT_EQ(quell::FilterLuminance(FLT_MAX, FLT_MAX, FLT_MAX), 1e38f);
  EXPECT_NEAR(quell::FilterLuminance(1, 1, 1), 1, 1e-6);
}

// cos^128 at the angles tabulated for SVGF's normal weight.
TEST(Guards, CosinePowerTable)
{
  const double degrees[] = { 1, 2, 5, 10, 15, 20 }, weights[] = { .980692, .924966, .613848, .140925, .0118, .000348 };
  for (int i = 0; i < 6; ++i)
    EXPECT_NEAR(quell::CosinePower(float(std::cos(degrees[i] * M_PI / 180)), 128), weights[i], i < 4 ? 2e-5 : 5e-5);
  EXPECT_EQ(quell::CosinePower(1.01f, 128), 1.f);
  EXPECT_EQ(quell::CosinePower(-1, 128), 0.f);
  EXPECT_EQ(quell::CosinePower(0, 128), 0.f);
  EXPECT_EQ(quell::CosinePower(0, 0), 1.f);
}

TEST(Guards, FillUsesOnlyFiniteNeighboursInside)
{
  Image image({ 0, 0, 3, 3 }, 3, 1.f);
  image.fill(1, 1, NaN);
  image.at(0, 0)[1] = Inf; // one channel spoils the pixel
  image.fill(2, 2, 8.f);
  float c[3];
  EXPECT_FALSE(quell::ReadFilled(image, 1, 1, c));
  EXPECT_FLOAT_EQ(c[0], 2.f); // (6 * 1 + 8) / 7
  EXPECT_TRUE(quell::ReadFilled(image, 2, 2, c));
  EXPECT_EQ(c[0], 8.f);
  Image lonely({ 4, 4, 5, 5 }, 3, NaN);
  EXPECT_FALSE(quell::ReadFilled(lonely, 4, 4, c));
  EXPECT_EQ(c[0], 0.f);
  Image large({ 0, 0, 3, 1 }, 3, FLT_MAX);
  large.fill(1, 0, NaN);
  quell::ReadFilled(large, 1, 0, c);
  EXPECT_EQ(c[0], FLT_MAX);
}

TEST(Simd, TargetsCanBeForced)
{
  const auto targets = quell::SimdTargets();
  ASSERT_FALSE(targets.empty());
  ForEachTarget([](const char* name) { EXPECT_STREQ(quell::SimdTargetName(), name); });
  EXPECT_STREQ(quell::SimdTargetName(), targets.front().Name);
}

TEST(Simd, NegativeExp2Accuracy)
{
  std::vector<float> in, out;
  for (int i = 0; i < 64 * 4000; ++i)
    in.push_back(115.f * float(i) / (64 * 4000));
  in[1] = 1e-30f;
  out.resize(in.size());
  ForEachTarget(
    [&](const char* name)
    {
      quell::NegativeExp2(in.data(), out.data(), in.size());
      double worst = 0;
      for (size_t i = 0; i < in.size(); ++i)
        worst = std::max(worst, std::fabs(out[i] / std::exp2(-double(in[i])) - 1));
      EXPECT_LT(worst, 3e-7) << name;
      EXPECT_EQ(out[0], 1.f) << name;
      EXPECT_EQ(out[1], 1.f) << name;
      std::vector<float> extreme(64, 115.1f), e(64);
      extreme[0] = Inf, extreme[1] = NaN, extreme[2] = FLT_MAX, extreme[3] = 1e9f;
      quell::NegativeExp2(extreme.data(), e.data(), 64);
      for (float v : e)
        EXPECT_EQ(v, 0.f) << name;
    });
}
