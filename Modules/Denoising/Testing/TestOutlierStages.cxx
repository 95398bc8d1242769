// SPDX-License-Identifier: BSD-3-Clause
#include "PixelNoise.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"
#include "vtkQuellFireflyClamp.h"
#include "vtkQuellMedianOfMeans.h"
#include "vtkQuellRankClamp.h"
#include "vtkQuellRedistribute.h"
#include "vtkQuellSum.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace
{
constexpr int Width = 60, Height = 44;

float Uniform(int x, int y, int c, int salt)
{
  return PixelNoise(x, y, c * 131 + salt);
}

/// Fireflies among noise: halfA and halfB are independent, radiance is their mean.
class vtkQuellSparks : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellSparks);
  static float Value(const std::string& name, int x, int y, int c)
  {
    if (name == "radiance")
      return .5f * (Value("halfA", x, y, c) + Value("halfB", x, y, c));
    const int salt = name == "halfA" ? 1 : 2;
    return (.5f + Uniform(x, y, c, salt)) * (Uniform(x, y, 9, salt) < .01f ? 200.f : 1.f);
  }

protected:
  vtkQuellSparks() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    w = Width;
    h = Height;
  }
  void Execute(quell::StageFrame& frame) override
  {
    const quell::Rect r = frame.Region();
    for (const std::string& name : frame.WantedArrays())
      if (const quell::ImageOut out = frame.Output(name))
        for (int y = r.y0; y < r.y1; ++y)
          for (int x = r.x0; x < r.x1; ++x)
            for (int c = 0; c < 3; ++c)
              out.at(x, y)[c] = Value(name, x, y, c);
  }
};
vtkStandardNewMacro(vtkQuellSparks);
QUELL_STAGE_DESCRIPTION(vtkQuellSparks)
void vtkQuellSparks::Describe(quell::StageDescription& d)
{
  d.Category = "Test";
  for (const char* name : { "radiance", "halfA", "halfB" })
    d.Output(name, quell::ArrayKind::Color, "test");
}

std::vector<float> Read(vtkQuellStage* stage, const char* name)
{
  auto array = vtkFloatArray::SafeDownCast(stage->GetOutput()->GetPointData()->GetArray(name));
  if (!array)
    return {};
  return { array->GetPointer(0), array->GetPointer(0) + array->GetNumberOfValues() };
}

double Total(const std::vector<float>& values)
{
  double s = 0;
  for (float v : values)
    s += v;
  return s;
}

/// The stage's radiance and residual, added by a Sum stage, are `expected` bit by bit.
void ExpectLedger(vtkQuellStage* stage, const std::vector<float>& expected)
{
  vtkNew<vtkQuellSum> sum;
  sum->ConnectInput("radiance", stage, "radiance");
  sum->ConnectInput("radiance", stage, "residual");
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(sum, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
  const std::vector<float> now = Read(sum, "radiance");
  ASSERT_EQ(now.size(), expected.size());
  EXPECT_EQ(0, std::memcmp(now.data(), expected.data(), now.size() * sizeof(float)));
}
}

TEST(OutlierStages, FilteredPlusResidualIsTheInput)
{
  vtkNew<vtkQuellSparks> source;
  source->Update();
  const std::vector<float> input = Read(source, "radiance");
  vtkNew<vtkQuellRankClamp> rank;
  rank->ConnectInput("radiance", source);
  ExpectLedger(rank, input);
  EXPECT_GT(rank->GetClampedPixels(), 20);
  EXPECT_LT(rank->GetClampedPixels(), Width * Height / 2);
  EXPECT_GT(rank->GetEnergyRemoved(), .2 * rank->GetEnergyIn());
  EXPECT_LT(rank->GetEnergyRemoved(), rank->GetEnergyIn());
  EXPECT_NE(rank->GetReport().find("removed"), std::string::npos);
  for (int measure = 0; measure < 3; ++measure)
  {
    vtkNew<vtkQuellFireflyClamp> clamp;
    clamp->SetMeasure(measure);
    clamp->ConnectInput("radiance", source);
    ExpectLedger(clamp, input);
    EXPECT_GT(clamp->GetClampedPixels(), 20);
    double removed = 0;
    for (size_t i = 0; i < input.size(); i += 3)
    {
      const auto r = Read(clamp, "residual");
      for (int k = 0; k < 3 && i == 0; ++k)
        for (size_t j = size_t(k); j < r.size(); j += 3)
          removed += (k == 0 ? .2126 : k == 1 ? .7152 : .0722) * r[j];
    }
    EXPECT_NEAR(clamp->GetEnergyRemoved() / removed, 1, 1e-9);
  }
}

TEST(OutlierStages, HalvesMakeAMedianOfMeans)
{
  vtkNew<vtkQuellSparks> source;
  vtkNew<vtkQuellMedianOfMeans> means;
  means->SetEstimator(2);
  means->ConnectInput("radiance", source, "halfA");
  means->ConnectInput("radiance", source, "halfB");
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(means, { "radiance", "mean", "residual", "gini" });
  ASSERT_TRUE(sink->UpdateTick(0)) << means->GetErrorText();
  const std::vector<float> mean = Read(means, "mean"), out = Read(means, "radiance");
  float brightest = 0;
  for (int y = 0; y < Height; ++y)
    for (int x = 0; x < Width; ++x)
      for (int c = 0; c < 3; ++c)
      {
        const size_t i = (size_t(y) * Width + x) * 3 + c;
        ASSERT_NEAR(mean[i], vtkQuellSparks::Value("radiance", x, y, c), 1e-6 * mean[i]);
        brightest = std::max(brightest, out[i]);
      }
  EXPECT_LT(brightest, 2); // no firefly hit both halves of a pixel
  EXPECT_GT(Total(mean), 1.5 * Total(out));
  EXPECT_NEAR(double(means->GetClampedPixels()) / (Width * Height), .02, .01);
  ExpectLedger(means, mean);
}

TEST(OutlierStages, RedistributionClosesTheLedger)
{
  vtkNew<vtkQuellSparks> source;
  source->Update();
  const double before = Total(Read(source, "radiance"));
  vtkNew<vtkQuellFireflyClamp> clamp;
  clamp->ConnectInput("radiance", source);
  for (int over = 0; over < 2; ++over)
  {
    vtkNew<vtkQuellRedistribute> spread;
    spread->SetOver(over);
    spread->ConnectInput("radiance", clamp, "radiance");
    spread->ConnectInput("residual", clamp, "residual");
    vtkNew<vtkQuellCollector> sink;
    sink->AddRequest(spread, { "radiance" });
    ASSERT_TRUE(sink->UpdateTick(0)) << spread->GetErrorText();
    const std::vector<float> whole = Read(spread, "radiance");
    EXPECT_NEAR(Total(whole) / before, 1, 1e-6);
    EXPECT_NEAR(spread->GetEnergySpread() / clamp->GetEnergyRemoved(), 1, 1e-9);
    EXPECT_NEAR((spread->GetEnergyLeft() + spread->GetEnergySpread()) / clamp->GetEnergyIn(), 1, 1e-9);
    EXPECT_NE(spread->GetReport().find(over ? "image" : "neighbourhood"), std::string::npos) << spread->GetReport();
    EXPECT_LT(Total(Read(clamp, "radiance")), .6 * before);
    EXPECT_LT(*std::max_element(whole.begin(), whole.end()), 40); // was 300
    // A region is the crop, whatever it reads.
    for (const quell::Rect r : { quell::Rect{ 20, 9, 33, 30 }, quell::Rect{ 59, 43, 60, 44 } })
    {
      sink->ClearRequests();
      sink->AddRequest(spread, { "radiance" }, r);
      source->Modified();
      ASSERT_TRUE(sink->UpdateTick(0));
      const std::vector<float> crop = Read(spread, "radiance");
      ASSERT_EQ(crop.size(), size_t(r.area() * 3));
      for (int y = r.y0; y < r.y1; ++y)
        EXPECT_EQ(0, std::memcmp(crop.data() + size_t(y - r.y0) * r.width() * 3,
                       whole.data() + (size_t(y) * Width + r.x0) * 3, size_t(r.width()) * 3 * sizeof(float)));
    }
  }
}

TEST(OutlierStages, RedistributionAsksForGuidesOnlyWhereItUsesThem)
{
  vtkNew<vtkQuellRedistribute> spread;
  EXPECT_TRUE(spread->NeedsInput(2, { "radiance" }));
  EXPECT_EQ(spread->HaloFor(0), 16);
  spread->SetOver(vtkQuellRedistribute::Image);
  EXPECT_FALSE(spread->NeedsInput(2, { "radiance" }));
  EXPECT_TRUE(spread->NeedsInput(1, { "radiance" }));
  EXPECT_GT(spread->HaloFor(0), 100000);
}

TEST(OutlierStages, TooManyBuffersAreRefused)
{
  vtkObject::SetGlobalWarningDisplay(0);
  vtkNew<vtkQuellSparks> source;
  vtkNew<vtkQuellMedianOfMeans> means;
  for (int i = 0; i < 65; ++i)
    means->ConnectInput("radiance", source);
  means->Update();
  vtkObject::SetGlobalWarningDisplay(1);
  EXPECT_NE(means->GetErrorText().find("at most 64"), std::string::npos) << means->GetErrorText();
}

// Bands of a frame overlap, by the rows that filters read around them: every row is counted once, and what does not
// continue the frame begins another.
TEST(EnergyLedger, CountsEveryRowOfAFrameOnce)
{
  quell::EnergyLedger ledger;
  const auto strips = [](const quell::Rect& rows, auto&& body)
  {
    for (int y = rows.y0; y < rows.y1; y += quell::EnergyLedger::RowsPerStrip)
      body(quell::Rect{ 0, y, 1, std::min(y + quell::EnergyLedger::RowsPerStrip, rows.y1) });
  };
  std::vector<int> made(100, 0);
  const auto run = [&](int y0, int y1, int tick)
  {
    const auto kernel = [&](const quell::Rect& tile)
    {
      quell::ClampLedger sum;
      for (int y = tile.y0; y < tile.y1; ++y)
      {
        ++made[std::size_t(y)];
        sum.Clamped += y % 3 == 0;
        sum.EnergyIn += 7;
        sum.EnergyRemoved += y % 3 == 0;
      }
      return sum;
    };
    return ledger.Run(quell::Rect{ 0, y0, 7, y1 }, tick, strips, kernel).Clamped;
  };
  // From the top down, 5 rows around each band.
  EXPECT_EQ(run(55, 100, 1), 15);
  EXPECT_EQ(run(25, 65, 1), 10); // 25 .. 54
  EXPECT_EQ(run(0, 35, 1), 9);   // 0 .. 24
  EXPECT_EQ(ledger.Text(), "clamped 34 of 700 pixels, removed 4.86 % of the energy");
  EXPECT_EQ(made[60], 2); // but every row of a band is made
  // From the bottom up.
  EXPECT_EQ(run(0, 50, 2), 17);
  EXPECT_EQ(run(40, 100, 2), 17);
  EXPECT_EQ(ledger.Text(), "clamped 34 of 700 pixels, removed 4.86 % of the energy");
  // The same frame once more, another part of it, another frame.
  EXPECT_EQ(run(0, 100, 2), 34);
  EXPECT_EQ(ledger.Text(), "clamped 34 of 700 pixels, removed 4.86 % of the energy");
  EXPECT_EQ(run(30, 60, 2), 10);
  EXPECT_EQ(run(80, 90, 2), 3);
  EXPECT_EQ(ledger.Text(), "clamped 3 of 70 pixels, removed 4.29 % of the energy");
  EXPECT_EQ(run(85, 100, 3), 5);
  EXPECT_EQ(ledger.Text(), "clamped 5 of 105 pixels, removed 4.76 % of the energy");
}
