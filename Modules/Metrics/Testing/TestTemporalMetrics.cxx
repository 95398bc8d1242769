// SPDX-License-Identifier: BSD-3-Clause
// Closed forms: what an exponential average does to noise, to a step and to a mover.
#include "quellStageDescription.h"
#include "quellTemporalMetrics.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellCompareFrames.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkTrivialProducer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

using namespace quell;

namespace
{
constexpr int Width = 64, Height = 48;

struct Frame
{
  std::vector<float> Data;
  int Channels;

  explicit Frame(int channels = 3, float value = 0)
    : Data(std::size_t(Width) * Height * std::size_t(channels), value)
    , Channels(channels)
  {
  }
  float* at(int x, int y)
  {
    return &this->Data[(std::size_t(y) * Width + std::size_t(x)) * std::size_t(this->Channels)];
  }
  void fill(int x, int y, float v) { std::fill_n(this->at(x, y), this->Channels, v); }
  operator ImageIn() const { return ImageIn(this->Data.data(), this->Channels, Rect{ 0, 0, Width, Height }); }
};

/// h = (1 - a) h + a x
void Average(Frame& h, const Frame& x, float a)
{
  for (std::size_t i = 0; i < h.Data.size(); ++i)
    h.Data[i] += a * (x.Data[i] - h.Data[i]);
}

std::map<std::string, double> ValuesOf(const TemporalMetrics& m)
{
  const auto values = m.Values();
  return { values.begin(), values.end() };
}
}

TEST(TemporalMetrics, FlickerOfWhiteNoiseIsItsDeviation)
{
  std::mt19937 random(1);
  std::normal_distribution<float> normal(0, 0.1f);
  const float a = 0.2f;
  TemporalMetrics raw, averaged, constantError;
  const Frame reference(3, 0.5f), offset(3, 0.8f);
  Frame h(3, 0.5f);
  // Long before the measurement, so that the average is in its steady state.
  for (int n = -40; n < 40; ++n)
  {
    Frame x(3);
    for (float& v : x.Data)
      v = 0.5f + normal(random);
    Average(h, x, a);
    if (n < 0)
      continue;
    raw.Add(x, reference, {}, {});
    averaged.Add(h, reference, {}, {});
    constantError.Add(offset, reference, {}, {});
  }
  EXPECT_NEAR(ValuesOf(raw)["flicker"], 0.1, 0.1 * 0.01);
  EXPECT_NEAR(ValuesOf(averaged)["flicker"], 0.1 * a / std::sqrt(2 - a), 0.1 * a / std::sqrt(2 - a) * 0.01);
  // What is always wrong by the same amount does not flicker.
  EXPECT_EQ(ValuesOf(constantError)["flicker"], 0.);
  // A reference that stands still has no step.
  EXPECT_EQ(ValuesOf(raw).count("lag"), 0u);
  EXPECT_EQ(ValuesOf(raw).count("warp"), 0u);
}

TEST(TemporalMetrics, LagOfAnExponentialAverage)
{
  for (const float a : { 0.5f, 0.2f, 0.1f })
  {
    TemporalMetrics m, perfect;
    Frame h(3, 1.f);
    for (int n = 0; n < 150; ++n)
    {
      // A small step first: the larger one is what is measured.
      const Frame reference(3, n < 5 ? 0.9f : n < 20 ? 1.f : 3.f);
      if (n < 20)
        h = reference;
      Average(h, reference, a);
      m.Add(h, reference, {}, {});
      perfect.Add(reference, reference, {}, {});
    }
    EXPECT_EQ(m.StepFrame(), 20);
    EXPECT_NEAR(ValuesOf(m)["lag"], (1 - a) / a, 1e-4 * (1 - a) / a);
    EXPECT_EQ(ValuesOf(perfect)["lag"], 0.);
    EXPECT_EQ(ValuesOf(perfect)["ghost"], 0.);
  }
}

TEST(TemporalMetrics, GhostIsTheAreaBehindAMover)
{
  // A bar of 16 columns moves by 2 each frame over a dark ground; an average without reprojection.
  const float a = 0.5f;
  TemporalMetrics m;
  Frame h(1, 0.1f);
  const auto bar = [](int n)
  {
    Frame f(1, 0.1f);
    for (int y = 8; y < 40; ++y)
      for (int x = 2 * n; x < 2 * n + 16; ++x)
        f.fill(x, y, 1.f);
    return f;
  };
  const int frames = 16;
  for (int n = 0; n < frames; ++n)
  {
    const Frame reference = bar(n);
    if (n == 0)
      h = reference;
    else
      Average(h, reference, a);
    m.Add(h, reference, {}, {});
  }
  // Uncovered j frames ago, (1 - a)^j of the bar is left: 0.5, 0.25, 0.125 count, 0.0625 does not. The same before it.
  double expected = 0;
  for (int n = 1; n < frames; ++n)
    expected += 2 * std::min(n, 3) * 2 * 32 / double(Width * Height);
  EXPECT_NEAR(ValuesOf(m)["ghost"], expected / (frames - 1), 1e-12);
}

TEST(TemporalMetrics, WarpFollowsMotion)
{
  // A linear ramp that moves by (1.5, -0.25) pixels a frame: bilinear reads are exact.
  TemporalMetrics follows, stands, torn;
  Frame motion(2), none(2), ids(1, 1.f);
  for (int y = 0; y < Height; ++y)
    for (int x = 0; x < Width; ++x)
    {
      motion.at(x, y)[0] = -1.5f, motion.at(x, y)[1] = 0.25f;
      // The left half belongs to something else in odd frames' neighbourhood: those taps do not count.
      ids.fill(x, y, x < 20 ? 2.f : 1.f);
    }
  for (int n = 0; n < 4; ++n)
  {
    Frame ramp(3), split(3);
    for (int y = 0; y < Height; ++y)
      for (int x = 0; x < Width; ++x)
      {
        const float v = float(x - 1.5 * n) + 3 * float(y + 0.25 * n);
        ramp.fill(x, y, v);
        split.fill(x, y, x < 20 ? -100.f : v);
      }
    follows.Add(ramp, ramp, motion, {});
    stands.Add(ramp, {}, none, {});
    torn.Add(split, {}, motion, ids);
  }
  EXPECT_NEAR(ValuesOf(follows)["warp"], 0, 1e-5);
  EXPECT_NEAR(ValuesOf(follows)["warp of the reference"], 0, 1e-5);
  EXPECT_NEAR(ValuesOf(stands)["warp"], 0.75, 1e-5); // 1.5 - 3 * 0.25
  EXPECT_EQ(ValuesOf(stands).count("warp of the reference"), 0u);
  EXPECT_NEAR(ValuesOf(torn)["warp"], 0, 1e-5);
}

TEST(TemporalMetrics, SaysWhatDoesNotFit)
{
  TemporalMetrics m;
  Frame good(3, 1.f), bad(3, 1.f);
  bad.at(3, 2)[1] = std::numeric_limits<float>::quiet_NaN();
  m.Add(good, {}, {}, {});
  EXPECT_TRUE(m.Values().empty()); // of one frame nothing can be said
  const auto message = [&](const ImageIn& test)
  {
    try
    {
      m.Add(test, {}, {}, {});
    }
    catch (const StageError& e)
    {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(
    message(bad), "image 1 of the sequence has 1 non-finite pixel, the first at column 3, row 2 from the bottom");
  EXPECT_EQ(message(Frame(1)), "image 1 of the sequence has another size");
}

namespace
{
vtkSmartPointer<vtkImageData> ImageOf(const Frame& f)
{
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetExtent(0, Width - 1, 0, Height - 1, 0, 0);
  vtkNew<vtkFloatArray> array;
  array->SetName("radiance");
  array->SetNumberOfComponents(f.Channels);
  array->SetNumberOfTuples(Width * Height);
  std::copy(f.Data.begin(), f.Data.end(), array->GetPointer(0));
  image->GetPointData()->AddArray(array);
  return image;
}
}

TEST(CompareFrames, ReportsThePairOfFrames)
{
  Frame now(3, 1.f), before(3, 0.9f), reference(3, 0.5f), referenceBefore(3, 0.4f), broken(3, 1.f);
  now.fill(5, 7, 1.5f);
  broken.at(2, 1)[0] = std::numeric_limits<float>::infinity();
  vtkNew<vtkTrivialProducer> image, referenceImage;
  image->SetOutput(ImageOf(now));
  referenceImage->SetOutput(ImageOf(reference));
  vtkNew<vtkQuellCompareFrames> stage;
  stage->SetLabel("beauty");
  stage->ConnectInput("image", image);
  const auto port = [&](const char* name) { return stage->GetDescription().InputIndex(name); };
  const auto report = [&]
  {
    EXPECT_TRUE(stage->GetExecutive()->Update());
    EXPECT_EQ(stage->GetErrorText(), "");
    return stage->GetReport();
  };
  stage->SetHistory(port("previous"), nullptr);
  EXPECT_EQ(report(), "beauty: not compared: there is no frame before");
  EXPECT_TRUE(stage->GetWarnings().empty());
  stage->SetHistory(port("previous"), ImageOf(before));
  stage->SetAlwaysMake({ "error" });
  // All pixels change by 0.1, one by 0.6.
  const double n = double(Width) * Height, flicker = std::sqrt((0.01 * (n - 1) + 0.36) / n / 2);
  char text[64];
  std::snprintf(text, sizeof text, "beauty: flicker %.3g", flicker);
  EXPECT_EQ(report(), text);
  vtkDataArray* error = stage->GetOutput()->GetPointData()->GetArray("error");
  ASSERT_NE(error, nullptr);
  EXPECT_NEAR(error->GetComponent(7 * Width + 5, 0), 0.6, 1e-6);
  EXPECT_NEAR(error->GetComponent(7 * Width + 6, 0), 0.1, 1e-6);
  // The reference changes by as much: what is left is the one pixel.
  stage->ConnectInput("reference", referenceImage);
  stage->SetHistory(port("previousReference"), ImageOf(referenceBefore));
  std::snprintf(text, sizeof text, "beauty: flicker %.3g", std::sqrt(0.25 / n / 2));
  EXPECT_EQ(report(), text);
  stage->SetHistory(port("previous"), ImageOf(broken));
  EXPECT_EQ(report(),
    "beauty: not compared: image 0 of the sequence has 1 non-finite pixel, the first at column 2, row 1 from "
    "the bottom");
  EXPECT_EQ(stage->GetWarnings().size(), 1u);
}
