// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellMedianOfMeans.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
const quell::Rect One{ 0, 0, 1, 1 };
struct Result
{
  Image radiance, residual, mean, gini;
  quell::ClampLedger ledger;
};
Result Apply(const std::vector<Image>& buffers, quell::MeansEstimator estimator, double threshold = .25)
{
  const quell::Rect e = buffers[0].extent;
  Result r{ Image(e, 3), Image(e, 3), Image(e, 3), Image(e, 1), {} };
  const std::vector<quell::ImageIn> views(buffers.begin(), buffers.end());
  r.ledger = quell::MedianOfMeans(
    views.data(), int(views.size()), { estimator, threshold }, { r.radiance, r.residual, r.mean, r.gini }, e);
  return r;
}
std::vector<Image> Grey(const std::vector<float>& values)
{
  std::vector<Image> buffers;
  for (float v : values)
    buffers.emplace_back(One, 3, v);
  return buffers;
}
using quell::MeansEstimator;
}

// Appendix B.7 / section 2.6.
TEST(MedianOfMeans, Goldens)
{
  std::vector<float> eleven(11, 1.f);
  eleven[4] = 100; // not sorted
  Result r = Apply(Grey(eleven), MeansEstimator::Gini);
  EXPECT_NEAR(r.gini.data[0], .818182, 1e-6);
  EXPECT_FLOAT_EQ(r.radiance.data[0], 1); // c = 4: the middle three
  EXPECT_FLOAT_EQ(r.mean.data[0], 10);
  EXPECT_FLOAT_EQ(r.residual.data[0], 9);
  EXPECT_NEAR(r.ledger.EnergyIn, 10, 1e-6);
  EXPECT_NEAR(r.ledger.EnergyRemoved, 9, 1e-6);
  EXPECT_FLOAT_EQ(Apply(Grey(eleven), MeansEstimator::Median).radiance.data[0], 1);
  EXPECT_FLOAT_EQ(Apply(Grey(eleven), MeansEstimator::Mean).radiance.data[0], 10);
  EXPECT_FLOAT_EQ(Apply(Grey(eleven), MeansEstimator::Binary).radiance.data[0], 1);
  EXPECT_FLOAT_EQ(Apply(Grey(eleven), MeansEstimator::Binary, .82).radiance.data[0], 10);
  r = Apply(Grey({ 3, 1, 5, 4, 2 }), MeansEstimator::Gini);
  EXPECT_NEAR(r.gini.data[0], .266667, 1e-6);
  EXPECT_FLOAT_EQ(r.radiance.data[0], 3);
  EXPECT_EQ(r.ledger.Clamped, 0); // floor(.2667 * 2) = 0
  const double uneven[] = { 0, 0, 0, 1 };
  EXPECT_NEAR(quell::GiniOfSorted(uneven, 4), .75, 1e-12);
}

TEST(MedianOfMeans, TrimsTheSortedBuffers)
{
  // G = .4545 -> c = floor(.4545 * 2) = 0; with seven: G = .5868, c = floor(.5868 * 3) = 1.
  Result r = Apply(Grey({ 9, 1, 2, 30, 3, 0, 4 }), MeansEstimator::Gini);
  const double sorted[] = { 0, 1, 2, 3, 4, 9, 30 };
  EXPECT_EQ(int(quell::GiniOfSorted(sorted, 7) * 3), 1);
  EXPECT_FLOAT_EQ(r.radiance.data[0], (1 + 2 + 3 + 4 + 9) / 5.f);
  // Sorted by luminance, channels stay together.
  std::vector<Image> buffers = Grey({ 0, 0, 0 });
  buffers[0].data = { 9, 0, 0 }, buffers[1].data = { 0, 9, 0 }, buffers[2].data = { 0, 0, 9 };
  r = Apply(buffers, MeansEstimator::Median);
  EXPECT_EQ(r.radiance.data, std::vector<float>({ 9, 0, 0 })); // blue < red < green
}

TEST(MedianOfMeans, TwoHalves)
{
  for (const float bright : { 2.9f, 3.1f, 1e6f })
  {
    const auto halves = Grey({ bright, 1 });
    const float mean = .5f * (bright + 1);
    EXPECT_FLOAT_EQ(Apply(halves, MeansEstimator::Gini).radiance.data[0], mean); // nothing can be trimmed
    EXPECT_FLOAT_EQ(Apply(halves, MeansEstimator::Median).radiance.data[0], 1);
    EXPECT_FLOAT_EQ(Apply(halves, MeansEstimator::Binary).radiance.data[0], bright > 3 ? 1.f : mean);
  }
  EXPECT_FLOAT_EQ(Apply(Grey({ 7 }), MeansEstimator::Gini).radiance.data[0], 7);
  EXPECT_FLOAT_EQ(Apply(Grey({ 4, 1, 3, 2 }), MeansEstimator::Median).radiance.data[0], 2); // the lower of 2 and 3
}

TEST(MedianOfMeans, LedgerAndAgreement)
{
  const quell::Rect e{ 0, 0, 200, 100 };
  std::vector<Image> buffers;
  Random u(17);
  for (int b = 0; b < 7; ++b)
  {
    buffers.emplace_back(e, 3);
    for (float& v : buffers.back().data)
      v = (u() - .1f) * std::exp(20 * (u() - .5f));
  }
  for (const auto estimator :
    { MeansEstimator::Mean, MeansEstimator::Median, MeansEstimator::Binary, MeansEstimator::Gini })
  {
    const Result r = Apply(buffers, estimator);
    for (size_t i = 0; i < r.mean.data.size(); ++i)
    {
      ASSERT_EQ(r.radiance.data[i] + r.residual.data[i], r.mean.data[i]);
      double mean = 0, largest = 0;
      for (const Image& b : buffers)
      {
        mean += b.data[i] / 7.;
        largest = std::max(largest, std::fabs(double(b.data[i])));
      }
      ASSERT_NEAR(r.mean.data[i], mean, 2e-7 * largest);
    }
    EXPECT_EQ(r.ledger.Clamped > 0, estimator != MeansEstimator::Mean);
  }
  // Buffers that agree: no estimator changes a bit.
  for (const auto estimator : { MeansEstimator::Median, MeansEstimator::Binary, MeansEstimator::Gini })
  {
    const Result r = Apply(std::vector<Image>(5, buffers[0]), estimator);
    EXPECT_LE(r.ledger.Clamped, int(r.mean.data.size() / 1000)); // none but for the rounding of the mean
    for (size_t i = 0; i < r.mean.data.size(); ++i)
      ASSERT_NEAR(r.radiance.data[i], buffers[0].data[i], 1e-7 * std::fabs(buffers[0].data[i]));
  }
}

TEST(MedianOfMeans, NonFiniteAndExtremes)
{
  const quell::Rect e{ 0, 0, 3, 1 };
  std::vector<Image> buffers(3, Image(e, 3, 2.f));
  buffers[1].fill(0, 0, NaN); // left out there
  buffers[1].at(2, 0)[0] = Inf;
  for (Image& b : buffers)
    b.fill(1, 0, NaN); // nothing left: from the neighbours
  const Result r = Apply(buffers, MeansEstimator::Gini);
  EXPECT_EQ(r.ledger.NonFinite, 3);
  for (float v : r.radiance.data)
    EXPECT_EQ(v, 2);
  for (float v : r.residual.data)
    EXPECT_EQ(v, 0);
  EXPECT_EQ(Apply(Grey({ 0, 0, 0 }), MeansEstimator::Gini).gini.data[0], 0);
  EXPECT_EQ(Apply(Grey({ -1, -2, -3 }), MeansEstimator::Gini).gini.data[0], 0);
  for (const float v : { FLT_MAX, -FLT_MAX, 1e-45f })
  {
    const Result x = Apply(Grey({ v, v, -v }), MeansEstimator::Median);
    EXPECT_TRUE(std::isfinite(x.radiance.data[0]) && std::isfinite(x.mean.data[0]));
    EXPECT_EQ(x.radiance.data[0] + x.residual.data[0], x.mean.data[0]);
  }
}

// The mean of skewed noise is kept by Mean alone; more samples per buffer make the others' darkness smaller.
TEST(MedianOfMeans, BiasIsNegativeAndShrinksWithSamples)
{
  const quell::Rect e{ 0, 0, 80, 60 };
  double bias[2][4];
  for (int run = 0; run < 2; ++run)
  {
    const int samples = run ? 400 : 4;
    Random u(23);
    std::vector<Image> buffers(9, Image(e, 3));
    for (Image& b : buffers)
      for (int y = 0; y < e.y1; ++y)
        for (int x = 0; x < e.x1; ++x)
        {
          double sum = 0;
          for (int s = 0; s < samples; ++s)
            sum += -std::log(1 - double(u())) * (u() < 1.f / 64 ? 64 : 1); // mean 2 - 1 / 64
          b.fill(x, y, float(sum / samples));
        }
    for (int k = 0; k < 4; ++k)
    {
      const Result r = Apply(buffers, MeansEstimator(k));
      double sum = 0;
      for (float v : r.radiance.data)
        sum += v;
      bias[run][k] = sum / double(r.radiance.data.size()) - (2 - 1. / 64);
    }
  }
  // E[X^2] = 2 (63 / 64 + 64), so sigma = 11.2.
  const double error = 11.2 / std::sqrt(double(e.area()) * 36);
  EXPECT_LT(std::fabs(bias[0][0]), 4 * error);
  for (int k : { 1, 3 })
  {
    EXPECT_LT(bias[0][k], -4 * error) << k;
    EXPECT_LT(bias[1][k], error) << k;
    EXPECT_GT(bias[1][k], bias[0][k] / 3) << k;
  }
}
