// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellKernelFilter.h"

#include <gtest/gtest.h>

using namespace quelltest;
using quell::FilterKernel;
using quell::KernelMode;

namespace
{
Image Filtered(const Image& in, const FilterKernel& k, const quell::Rect& tile, bool normalize = true,
  KernelMode mode = KernelMode::Mean, const Image& gate = {}, std::int64_t* bad = nullptr)
{
  Image out(tile, in.components, NaN);
  std::vector<float> scratch(quell::KernelFilterScratch(in, k, tile), NaN);
  const std::int64_t n = quell::KernelFilter(in, gate, k, normalize, mode, out, tile, scratch.data());
  if (bad)
    *bad = n;
  return out;
}
FilterKernel Parsed(const char* text)
{
  FilterKernel k;
  std::string error;
  EXPECT_TRUE(quell::ParseKernel(text, k, error)) << error;
  return k;
}
std::vector<FilterKernel> SomeKernels()
{
  return { quell::IdentityKernel(), quell::BoxKernel(1), quell::BoxKernel(4), quell::Peak3x3Kernel(),
    quell::GaussianKernel(1, 3), quell::GaussianKernel(2.5, -1), Parsed("1 2 1"), Parsed("1; 2; 4; 2; 1"),
    Parsed("0 -1 0; -1 5 -1; 0 -1 0"), Parsed("1 2 3 4 5; 0 0 7 0 0; 5 3 1 3 5") };
}
/// Impulse response over a field, and what the kernel is worth.
struct Response
{
  double sum = 0, squares = 0, variance = 0;
};
Response ResponseOf(const FilterKernel& k)
{
  const quell::Rect e{ 0, 0, 21, 21 };
  Image image(e, 1, 0.f);
  image.fill(10, 10, 1.f);
  const Image out = Filtered(image, k, e);
  Response r;
  for (int y = 0; y < 21; ++y)
    for (int x = 0; x < 21; ++x)
    {
      const double v = *out.at(x, y);
      r.sum += v;
      r.squares += v * v;
      r.variance += v * (x - 10) * (x - 10);
    }
  return r;
}
}

// The table of fixed kernels: sum, noise gain, variance per axis, and the answers to three frequencies.
TEST(KernelFilter, PublishedProperties)
{
  struct Row
  {
    FilterKernel k;
    double squares, variance, x, xy, half;
  };
  const Row rows[] = { { quell::IdentityKernel(), 1, 0, 1, 1, 1 },
    { quell::BoxKernel(1), .111111, .666667, -.333333, .111111, .333333 },
    { quell::Peak3x3Kernel(), .157025, .454545, .090909, -.090909, .545455 },
    { Parsed("1 4 6 4 1; 4 16 24 16 4; 6 24 36 24 6; 4 16 24 16 4; 1 4 6 4 1"), .0747681, 1, 0, 0, .25 } };
  for (const Row& row : rows)
  {
    const Response r = ResponseOf(row.k);
    EXPECT_NEAR(r.sum, 1, 1e-6);
    EXPECT_NEAR(r.squares, row.squares, 1e-6);
    EXPECT_NEAR(r.variance, row.variance, 2e-6);
    // A wave is an eigenvector: look at it in the middle.
    const quell::Rect e{ 0, 0, 16, 16 };
    Image x(e, 1), xy(e, 1), half(e, 1);
    for (int j = 0; j < 16; ++j)
      for (int i = 0; i < 16; ++i)
      {
        x.fill(i, j, i & 1 ? -1.f : 1.f);
        xy.fill(i, j, (i + j) & 1 ? -1.f : 1.f);
        half.fill(i, j, i & 1 ? 0.f : i & 2 ? -1.f : 1.f);
      }
    EXPECT_NEAR(*Filtered(x, row.k, e).at(8, 8), row.x, 1e-6);
    EXPECT_NEAR(*Filtered(xy, row.k, e).at(8, 8), row.xy, 1e-6);
    EXPECT_NEAR(*Filtered(half, row.k, e).at(8, 8), row.half, 1e-6);
  }
  EXPECT_NEAR(ResponseOf(quell::GaussianKernel(1, 3)).squares, .079680140, 1e-7);
  const Image one = []
  {
    Image i({ 0, 0, 9, 9 }, 1, 0.f);
    i.fill(4, 4, 1.f);
    return i;
  }();
  EXPECT_NEAR(*Filtered(one, quell::GaussianKernel(1, 3), one.extent).at(4, 4), 1 / 6.279784796, 1e-7);
}

TEST(KernelFilter, ReadsMatrices)
{
  const FilterKernel k = Parsed(" 1,2 3;\n 4 5 6\n7 8 9e0; ");
  EXPECT_EQ(k.RadiusX, 1);
  EXPECT_EQ(k.RadiusY, 1);
  EXPECT_FLOAT_EQ(k.Weights[0] * float(k.Scale), 7); // the lowest row is the last one
  EXPECT_FLOAT_EQ(k.Weights[8] * float(k.Scale), 3);
  EXPECT_FALSE(k.Separable());
  EXPECT_TRUE(Parsed("1 2 1; 2 4 2; 1 2 1").Separable());
  EXPECT_FALSE(quell::Peak3x3Kernel().Separable());
  EXPECT_EQ(Parsed("1 2 3 4 5").RadiusY, 0);
  const std::pair<const char*, const char*> mistakes[] = { { "", "it is empty" }, { ";1", "row 1 is empty" },
    { "1 2; 3", "row 2 has 1 numbers, row 1 has 2" }, { "1 2; 3 4", "no centre" },
    { "1 x 3", "\"x\" in row 1 is not a number" }, { "1 2 3; 4 1.5.2 3; 1 2 3", "\"1.5.2\" in row 2" },
    { "1 nan 3", "\"nan\"" }, { "0 0 0", "all its weights are 0" }, { "1 1e31 1", "1e31" } };
  for (const auto& m : mistakes)
  {
    FilterKernel left = quell::BoxKernel(2);
    std::string error;
    EXPECT_FALSE(quell::ParseKernel(m.first, left, error)) << m.first;
    EXPECT_NE(error.find(m.second), std::string::npos) << m.first << ": " << error;
    EXPECT_EQ(left.RadiusX, 2) << "left alone";
  }
  std::string wide = "1", error;
  for (int i = 0; i < 130; ++i)
    wide += " 1";
  FilterKernel none;
  EXPECT_FALSE(quell::ParseKernel(wide, none, error));
  EXPECT_NE(error.find("too large"), std::string::npos);
}

TEST(KernelFilter, LimitsOfTheGaussian)
{
  EXPECT_EQ(quell::GaussianKernel(0, 3).Weights.size(), 1u);
  EXPECT_EQ(quell::GaussianKernel(0.01, -1).RadiusX, 1);
  EXPECT_EQ(quell::GaussianKernel(2.1, -1).RadiusX, 7);
  EXPECT_EQ(quell::GaussianKernel(1e6, -1).RadiusX, 64);
  for (const float w : quell::GaussianKernel(1e30, 2).Weights)
    EXPECT_EQ(w, 1.f);
  for (const float w : quell::GaussianKernel(1e-300, 1).Weights)
    EXPECT_TRUE(w == 0.f || w == 1.f);
}

TEST(KernelFilter, ScalarAgreesWithEveryTarget)
{
  Scene s(53, 37);
  s.color.at(20, 10)[1] = NaN;
  s.color.fill(0, 0, Inf);
  *s.variance.at(7, 7) = -1;
  *s.variance.at(30, 30) = NaN;
  Image alpha(s.color.extent, 1);
  Random u(5);
  for (float& v : alpha.data)
    v = u();
  const quell::Rect e = s.color.extent;
  for (const FilterKernel& k : SomeKernels())
    for (const bool normalize : { true, false })
    {
      Image color(e, 3), variance(e, 1), carried(e, 1);
      quell::KernelFilterScalar(s.color, {}, k, normalize, KernelMode::Mean, color, e);
      quell::KernelFilterScalar(s.variance, s.color, k, normalize, KernelMode::Variance, variance, e);
      quell::KernelFilterScalar(alpha, s.color, k, normalize, KernelMode::Mean, carried, e);
      ForEachTarget(
        [&](const char* name)
        {
          // Weights of both signs may cancel: relative to what is summed.
          const bool cancels = *std::min_element(k.Weights.begin(), k.Weights.end()) < 0;
          const double floor = cancels ? 10. : 1e-6;
          const Difference c = Compare(Filtered(s.color, k, e, normalize).data, color.data, floor);
          const Difference v =
            Compare(Filtered(s.variance, k, e, normalize, KernelMode::Variance, s.color).data, variance.data, 1e-6);
          const Difference a =
            Compare(Filtered(alpha, k, e, normalize, KernelMode::Mean, s.color).data, carried.data, floor);
          for (const Difference& d : { c, v, a })
          {
            EXPECT_LT(d.relative, 1e-5) << name << " " << k.RadiusX << " " << k.RadiusY << " " << normalize;
            EXPECT_LT(d.smape, 1e-6) << name << " " << k.RadiusX << " " << k.RadiusY << " " << normalize;
          }
        });
    }
}

TEST(KernelFilter, ConstantsAreFixedPointsAndIdentityIsExact)
{
  for (const float v : { 0.f, 1e-42f, 0.1f, 7.3f, 1e30f, 3e38f })
    for (const FilterKernel& k : SomeKernels())
    {
      Image image({ 0, 0, 20, 16 }, 3, v);
      EXPECT_TRUE(Filtered(image, k, image.extent) == image) << v;
      image.at(5, 5)[1] = NaN;
      const Image out = Filtered(image, k, image.extent);
      for (const float o : out.data)
        ASSERT_EQ(o, v);
    }
  const Scene s(30, 20);
  EXPECT_TRUE(Filtered(s.color, quell::IdentityKernel(), s.color.extent) == s.color);
  EXPECT_TRUE(Filtered(s.color, quell::IdentityKernel(), s.color.extent, false) == s.color);
}

TEST(KernelFilter, BordersAreNormalisedByTheWeightsInside)
{
  const quell::Rect e{ 0, 0, 3, 3 };
  Image image(e, 1);
  for (int i = 0; i < 9; ++i)
    image.data[i] = float(i);
  // Corner: 6, 3 (right), 3 (up), 1 (diagonal) of pixels 0, 1, 3, 4.
  EXPECT_NEAR(*Filtered(image, quell::Peak3x3Kernel(), e).at(0, 0), (6 * 0 + 3 * 1 + 3 * 3 + 1 * 4) / 13., 1e-6);
  EXPECT_NEAR(*Filtered(image, quell::BoxKernel(1), e).at(0, 0), 2, 1e-6);
  EXPECT_NEAR(*Filtered(image, quell::BoxKernel(9), e).at(2, 2), 4, 1e-6);
  // The matrix is laid over the image, top row up; without a normaliser it is a plain sum.
  EXPECT_NEAR(*Filtered(image, Parsed("0 0 1; 0 0 0; 0 0 0"), e).at(1, 1), 8, 1e-6);
  EXPECT_NEAR(*Filtered(image, Parsed("-1 0 1; -2 0 2; -1 0 1"), e, false).at(1, 1), 8, 1e-5);
  EXPECT_NEAR(*Filtered(image, Parsed("-1 0 1; -2 0 2; -1 0 1"), e).at(1, 1), 4, 1e-6) << "no sum: the pixel stays";
}

TEST(KernelFilter, EnergyIsKeptInTheInterior)
{
  const quell::Rect e{ 0, 0, 52, 52 };
  Image image(e, 3, 0.f);
  Random u(3);
  double before[3] = {};
  for (int y = 18; y < 34; ++y)
    for (int x = 18; x < 34; ++x)
      for (int c = 0; c < 3; ++c)
        before[c] += image.at(x, y)[c] = u() * (u() < 0.02f ? 100.f : 1.f);
  for (const FilterKernel& k : SomeKernels())
  {
    double after[3] = {};
    const Image out = Filtered(image, k, e);
    for (size_t i = 0; i < out.data.size(); ++i)
      after[i % 3] += out.data[i];
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(after[c] / before[c], 1, 1e-6);
  }
}

TEST(KernelFilter, VarianceIsThatOfTheWeightedMean)
{
  const quell::Rect e{ 0, 0, 9, 9 };
  const Image ones(e, 1, 1.f);
  EXPECT_NEAR(*Filtered(ones, quell::BoxKernel(1), e, true, KernelMode::Variance).at(4, 4), 1 / 9., 1e-7);
  EXPECT_NEAR(*Filtered(ones, quell::BoxKernel(1), e, true, KernelMode::Variance).at(0, 0), 1 / 4., 1e-7);
  EXPECT_NEAR(*Filtered(ones, quell::Peak3x3Kernel(), e, true, KernelMode::Variance).at(4, 4), .157025, 1e-6);
  EXPECT_NEAR(*Filtered(ones, quell::GaussianKernel(1, 3), e, true, KernelMode::Variance).at(4, 4), .079680140, 1e-7);
}

TEST(KernelFilter, NonFinitePixelsDoNotSpreadAndGateTheOthers)
{
  const quell::Rect e{ 0, 0, 11, 11 };
  for (const float poison : { NaN, Inf, -Inf })
    for (const FilterKernel& k : SomeKernels())
    {
      Image image(e, 3, 2.f);
      image.at(5, 5)[1] = poison;
      std::int64_t bad = 0;
      const Image out = Filtered(image, k, e, true, KernelMode::Mean, {}, &bad);
      EXPECT_EQ(bad, 1);
      for (const float v : out.data)
        ASSERT_EQ(v, 2.f);
    }
  // Alpha takes the colour's weights: where colour is no number, alpha has no say.
  Image color(e, 3, 1.f), alpha(e, 1, 0.25f);
  color.at(5, 5)[0] = NaN;
  *alpha.at(5, 5) = 1000;
  for (const float v : Filtered(alpha, quell::BoxKernel(2), e, true, KernelMode::Mean, color).data)
    ASSERT_TRUE(v == 0.25f || v == 1000.f || v > 0) << v;
  EXPECT_EQ(*Filtered(alpha, quell::BoxKernel(2), e, true, KernelMode::Mean, color).at(4, 4), 0.25f);
  Image none(e, 3, NaN);
  for (const float v : Filtered(none, quell::BoxKernel(2), e).data)
    ASSERT_EQ(v, 0.f);
}

TEST(KernelFilter, BitsDoNotDependOnTheTile)
{
  Scene s(90, 50);
  s.color.at(33, 20)[0] = NaN;
  for (const FilterKernel& k : SomeKernels())
  {
    const Image full = Filtered(s.color, k, s.color.extent);
    for (const quell::Rect tile :
      { quell::Rect{ 0, 0, 16, 16 }, quell::Rect{ 31, 17, 50, 23 }, quell::Rect{ 73, 49, 90, 50 } })
    {
      const Image part = Filtered(s.color, k, tile);
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x)
          ASSERT_EQ(0, std::memcmp(part.at(x, y), full.at(x, y), 12)) << x << " " << y;
    }
  }
}
