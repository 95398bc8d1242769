// SPDX-License-Identifier: BSD-3-Clause
#include "quellFlip.h"
#include "quellImageMetrics.h"
#include "quellSsim.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

using namespace quell;

TEST(ImageMetrics, PixelErrorsByHand)
{
  const float t[3] = { 0.5f, 2, 0 }, r[3] = { 1, 1, 0 };
  const ImageIn a(t, 3, { 0, 0, 1, 1 }), b(r, 3, { 7, 9, 8, 10 }); // placed elsewhere in their frames
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::Squared, a, b, 0, 0), (0.25 + 1) / 3);
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::Absolute, a, b, 0, 0), 1.5 / 3);
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::RelativeSquared, a, b, 0, 0), (0.25 / 1.01 + 1 / 1.01) / 3);
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::Mrse, a, b, 0, 0), (0.25 + 1) / (1.01 * 1.01) / 3);
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::Smape, a, b, 0, 0), (0.5 / 1.51 + 1 / 3.01) / 3);
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::SquaredClamped, a, b, 0, 0), 0.25 / 3);
  EXPECT_NEAR(ToneForMetrics(1), 0.73535698, 1e-7); // sRGB of 1/2
  EXPECT_EQ(ToneForMetrics(-3), 0);
  EXPECT_DOUBLE_EQ(ToneForMetrics(1e30), 1.055 - 0.055);
}

TEST(ImageMetrics, BlackReferenceIsFinite)
{
  const float t[1] = { 1 }, r[1] = { 0 };
  const ImageIn a(t, 1, { 0, 0, 1, 1 }), b(r, 1, { 0, 0, 1, 1 });
  EXPECT_DOUBLE_EQ(PixelErrorAt(PixelError::RelativeSquared, a, b, 0, 0), 100);
  EXPECT_EQ(PixelErrorAt(PixelError::Smape, b, b, 0, 0), 0);
}

TEST(ImageMetrics, TrimmedSumLeavesOutTheLargest)
{
  const std::vector<double> e = { 5, 1, 9, 1, 9, 3, 9, 2 };
  std::vector<double> scratch(e.size());
  const double expected[] = { 39, 30, 21, 12, 7, 4, 2, 1, 0 };
  for (int k = 0; k <= 8; ++k)
    EXPECT_DOUBLE_EQ(TrimmedSum(e.data(), scratch.data(), 8, k), expected[k]) << k;
}

TEST(ImageMetrics, NonFiniteArePlaced)
{
  std::vector<float> v(3 * 20, 1.f);
  const ImageIn image(v.data(), 3, { 10, 10, 15, 14 });
  int x = -1, y = -1;
  EXPECT_EQ(CountNonFinite(image, x, y), 0);
  v[3 * (2 * 5 + 4) + 1] = std::numeric_limits<float>::infinity();
  v[3 * (3 * 5 + 0) + 2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(CountNonFinite(image, x, y), 2);
  EXPECT_EQ(x, 4);
  EXPECT_EQ(y, 2);
}

TEST(Ssim, ConstantsAreLuminanceTermOnly)
{
  // Two constants: (2 a b + C1) / (a^2 + b^2 + C1), C1 = 1e-4.
  const int n = 11;
  std::vector<double> a(n, 0.5), b(n, 0.6), row(5 * n);
  SsimRow(a.data(), b.data(), n, row.data());
  const double* rows[2 * SsimRadius + 1];
  for (auto& r : rows)
    r = &row[5 * 5];
  EXPECT_NEAR(SsimAt(rows, 1), (2 * 0.3 + 1e-4) / (0.25 + 0.36 + 1e-4), 1e-12);
  SsimRow(a.data(), a.data(), n, row.data());
  EXPECT_NEAR(SsimAt(rows, 1), 1, 1e-12);
}

namespace
{
struct Planes
{
  std::vector<double> memory;
  FlipImage image;
  Planes(int w, int h)
  {
    image.width = w;
    image.height = h;
    const std::size_t n = image.planeSize();
    memory.resize(n * 15);
    image.decoded = memory.data();
    image.rows = image.decoded + 3 * n;
    image.final = image.rows + 7 * n;
  }
};
}

TEST(Flip, ConstantsAndRowOrder)
{
  const int w = 9, h = 7;
  const std::vector<float> half(3 * w * h, 0.5f), more(3 * w * h, 0.6f), black(3 * w * h, 0.f), white(3 * w * h, 1.f);
  const auto value = [&](const std::vector<float>& a, const std::vector<float>& b, bool backwards)
  {
    Planes pa(w, h), pb(w, h);
    for (auto* p : { &pa, &pb })
    {
      const ImageIn v(p == &pa ? a.data() : b.data(), 3, { 0, 0, w, h });
      for (int i = 0; i < h; ++i)
        FlipDecode(v, false, 0, p->image, backwards ? h - 1 - i : i, backwards ? h - i : i + 1);
      for (int i = 0; i < h; ++i)
        FlipRow(p->image, backwards ? h - 1 - i : i, backwards ? h - i : i + 1);
      for (int i = 0; i < h; ++i)
        FlipColumn(p->image, backwards ? h - 1 - i : i, backwards ? h - i : i + 1);
    }
    return FlipPixel(pa.image, pb.image, 4, 3);
  };
  EXPECT_NEAR(value(half, more, false), 0.196255, 1e-4);
  EXPECT_NEAR(value(black, white, false), 0.967388, 1e-4);
  EXPECT_EQ(value(black, black, false), 0);
  EXPECT_EQ(value(half, more, false), value(half, more, true));
}

TEST(Flip, ExposuresOfBlackImagesAreGuarded)
{
  EXPECT_EQ(FlipExposureRange(0, 0, 0).start, 0);
  EXPECT_EQ(FlipExposureRange(0, 0, 0).count, 2);
  const FlipExposures e = FlipExposureRange(8, 0, 0.25);
  EXPECT_NEAR(e.stop - e.start, 5, 1e-12);
  EXPECT_EQ(e.count, 5);
  EXPECT_DOUBLE_EQ(e.at(4), e.stop);
}
