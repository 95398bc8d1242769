// SPDX-License-Identifier: BSD-3-Clause
// Stages that use what single samples and their variance tell: SampleFilter, VarianceSteeredFilter.
#include "PixelNoise.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"
#include "vtkQuellSampleFilter.h"
#include "vtkQuellVarianceSteeredFilter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>

namespace
{
constexpr int Width = 48, Height = 40;

/// One sample per pixel of a wall with a dark and a bright half; the seam, under pixel 24, is seen by chance.
class vtkQuellWallSample : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellWallSample);
  vtkSetClampMacro(Sample, int, 0, 1000);
  vtkGetMacro(Sample, int);

  float Uniform(int x, int y, int c) const { return PixelNoise(x, y, c * 131 + this->Sample + 7); }

protected:
  vtkQuellWallSample() { this->InitializePorts(); }
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
          {
            const bool right = x > 24 || (x == 24 && this->Uniform(x, y, 5) < .5f);
            for (int c = 0; c < out.components; ++c)
              out.at(x, y)[c] = name == "albedo"     ? (right ? .8f : .1f)
                                : name == "id"       ? (right ? 2.f : 1.f)
                                : name == "variance" ? .01f
                                                     : (right ? .8f : .1f) * (.5f + this->Uniform(x, y, 0));
          }
  }

private:
  int Sample = 0;
};
vtkStandardNewMacro(vtkQuellWallSample);
QUELL_STAGE_DESCRIPTION(vtkQuellWallSample)
void vtkQuellWallSample::Describe(quell::StageDescription& d)
{
  d.Category = "Test";
  d.Output("radiance", quell::ArrayKind::Color, "test");
  d.Output("albedo", quell::ArrayKind::Albedo, "test");
  d.Output("id", quell::ArrayKind::Id, "test");
  d.Output("variance", quell::ArrayKind::Variance, "test");
}

std::vector<float> Read(vtkQuellStage* stage, const char* name)
{
  auto array = vtkFloatArray::SafeDownCast(stage->GetOutput()->GetPointData()->GetArray(name));
  if (!array)
    return {};
  return { array->GetPointer(0), array->GetPointer(0) + array->GetNumberOfValues() };
}

struct Quiet
{
  Quiet() { vtkObject::SetGlobalWarningDisplay(0); }
  ~Quiet() { vtkObject::SetGlobalWarningDisplay(1); }
};
}

TEST(SampleStages, SamplesKeepTheSeamThatPixelsCannotSee)
{
  std::vector<vtkSmartPointer<vtkQuellWallSample>> samples;
  vtkNew<vtkQuellSampleFilter> filter;
  for (int s = 0; s < 4; ++s)
  {
    samples.push_back(vtkSmartPointer<vtkQuellWallSample>::New());
    samples.back()->SetSample(s);
    for (const char* port : { "radiance", "albedo", "id" })
      filter->ConnectInput(port, samples.back());
  }
  for (int pairs = 0; pairs < 2; ++pairs)
  {
    filter->SetPairs(pairs);
    vtkNew<vtkQuellCollector> sink;
    sink->AddRequest(filter, { "radiance" });
    ASSERT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
    const std::vector<float> out = Read(filter, "radiance");
    double error = 0, mixed = 0;
    for (int y = 0; y < Height; ++y)
      for (int x = 0; x < Width; ++x)
      {
        double truth = 0; // of these samples: each surface's own brightness is 1
        for (int s = 0; s < 4; ++s)
          truth += (x > 24 || (x == 24 && samples[s]->Uniform(x, y, 5) < .5f) ? .8 : .1) / 4;
        const double e = std::fabs(out[(size_t(y) * Width + x) * 3] / truth - 1);
        error = std::max(error, e);
        if (x == 24)
          mixed = std::max(mixed, e);
      }
    EXPECT_LT(error, .25) << pairs; // of uniform noise of +-50 %
    EXPECT_LT(mixed, .2) << pairs;
    const long long taps = 121LL * Width * Height * 4;
    EXPECT_EQ(filter->GetCounters().Taps, pairs ? 5 * taps : taps);
  }
}

TEST(SampleStages, EachSampleNeedsItsOwnGuides)
{
  Quiet quiet;
  vtkNew<vtkQuellWallSample> a, b;
  vtkNew<vtkQuellSampleFilter> filter;
  filter->ConnectInput("radiance", a);
  filter->ConnectInput("radiance", b);
  filter->ConnectInput("id", a);
  filter->Update();
  EXPECT_NE(filter->GetErrorText().find("\"id\": 1 connection, but \"radiance\" has 2 connections"), std::string::npos)
    << filter->GetErrorText();
  filter->ConnectInput("id", b);
  filter->Update();
  EXPECT_TRUE(filter->GetErrorText().empty()) << filter->GetErrorText();
}

TEST(SampleStages, SteeredWidthIsAnOutput)
{
  vtkNew<vtkQuellWallSample> source;
  vtkNew<vtkQuellVarianceSteeredFilter> filter;
  for (const char* port : { "radiance", "variance", "id" })
    filter->ConnectInput(port, source);
  EXPECT_EQ(filter->HaloFor(0), 14);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(filter, { "radiance", "variance", "sigma" });
  ASSERT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
  const std::vector<float> sigma = Read(filter, "sigma"), variance = Read(filter, "variance");
  double left = 0, right = 0;
  for (int y = 0; y < Height; ++y)
    for (int x = 0; x < 12; ++x)
    {
      left += sigma[size_t(y) * Width + x] / (12. * Height);
      right += sigma[size_t(y) * Width + 36 + x] / (12. * Height);
    }
  // On the left the noise of .03 is less than the variance says, on the right (.23) more: it must look like detail.
  EXPECT_GT(left, 3.5);
  EXPECT_LT(right, left - .5);
  for (float v : variance)
    ASSERT_TRUE(v > 0 && v <= .01f);
  filter->SetScales(0);
  EXPECT_EQ(filter->HaloFor(0), 4);
  sink->ClearRequests();
  sink->AddRequest(filter, { "radiance" });
  sink->AddRequest(source, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(Read(filter, "radiance"), Read(source, "radiance"));
}

// What WeighPixel says of a pixel, multiplied out: the pixel. Of three samples each is a part of its own.
TEST(SampleStages, WeightsOfAllSamplesMakeThePixel)
{
  for (const bool demodulate : { false, true })
  {
    std::vector<vtkSmartPointer<vtkQuellWallSample>> samples;
    vtkNew<vtkQuellSampleFilter> filter;
    filter->SetRadius(2);
    filter->SetDemodulate(demodulate);
    for (int s = 0; s < 3; ++s)
    {
      samples.push_back(vtkSmartPointer<vtkQuellWallSample>::New());
      samples.back()->SetSample(s);
      for (const char* port : { "radiance", "albedo", "id" })
        filter->ConnectInput(port, samples.back());
    }
    vtkNew<vtkQuellCollector> sink;
    sink->AddRequest(filter, { "radiance" });
    ASSERT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
    const std::vector<float> out = Read(filter, "radiance");
    for (const auto& p : { std::make_pair(0, 0), std::make_pair(22, 20), std::make_pair(Width - 1, 7) })
    {
      quell::PixelWeights weights;
      std::string error;
      ASSERT_TRUE(filter->WeighPixel(p.first, p.second, weights, error)) << error;
      ASSERT_EQ(weights.Parts.size(), 3u);
      EXPECT_EQ(weights.Parts[2].Input, demodulate ? "radiance / albedo 3" : "radiance 3");
      for (int c = 0; c < 3; ++c)
      {
        double sum = 0;
        for (int s = 0; s < 3; ++s)
        {
          std::vector<float> in = Read(samples[std::size_t(s)], "radiance");
          const std::vector<float> albedo = Read(samples[std::size_t(s)], "albedo");
          for (std::size_t k = 0; k < in.size() && demodulate; ++k)
            in[k] /= albedo[k];
          const quell::PixelWeights::Part& part = weights.Parts[std::size_t(s)];
          for (int y = part.Window.y0; y < part.Window.y1; ++y)
            for (int x = part.Window.x0; x < part.Window.x1; ++x)
              sum += double(part.At(x, y)) * double(in[(std::size_t(y) * Width + std::size_t(x)) * 3 + std::size_t(c)]);
        }
        const std::size_t at = (std::size_t(p.second) * Width + std::size_t(p.first)) * 3 + std::size_t(c);
        // All three saw the same surface here.
        const double own = demodulate ? double(Read(samples[0], "albedo")[at]) : 1.;
        const double made = double(out[at]) / own;
        EXPECT_NEAR(sum, made, 1e-5 * made) << p.first << ", " << p.second << " channel " << c;
      }
    }
  }
}
