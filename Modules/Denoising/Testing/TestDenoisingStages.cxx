// SPDX-License-Identifier: BSD-3-Clause
#include "Threads.h"
#include "PixelNoise.h"
#include "quellRegisterDenoising.h"
#include "vtkDataArray.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellATrousFilter.h"
#include "vtkQuellAlbedoDemodulate.h"
#include "vtkQuellAlbedoModulate.h"
#include "vtkQuellAovSplit.h"
#include "vtkQuellBilateralFilter.h"
#include "vtkQuellCollector.h"
#include "vtkQuellEmissionSplit.h"
#include "vtkQuellFireflyClamp.h"
#include "vtkQuellKernelFilter.h"
#include "vtkQuellNonLocalMeans.h"
#include "vtkQuellRegressionFilter.h"
#include "vtkQuellSum.h"
#include "vtkQuellVarianceEstimate.h"
#include "vtkQuellVarianceSteeredFilter.h"

#include <gtest/gtest.h>

#include <array>
#include <cfloat>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <random>

namespace
{
const float Inf = std::numeric_limits<float>::infinity();
const float NaN = std::numeric_limits<float>::quiet_NaN();

float Hash(int x, int y, int c, int salt)
{
  return PixelNoise(x, y, c * 97 + salt);
}

/// A noisy frame whose arrays are functions of the pixel; arrays that the table does not know have 3 components.
class vtkQuellNoisyFrame : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellNoisyFrame);
  vtkSetClampMacro(Width, int, 1, 4096);
  vtkGetMacro(Width, int);
  vtkSetClampMacro(Height, int, 1, 4096);
  vtkGetMacro(Height, int);
  /// Replaces the value of (array, x, y, component).
  std::function<float(const std::string&, int, int, int, float)> Change;
  std::string Missing;
  int Runs = 0;
  quell::Rect LastRegion;

  float Value(const std::string& name, int x, int y, int c) const
  {
    const bool right = x > this->Width / 2, sky = x > this->Width * 3 / 4 && y > this->Height * 3 / 4;
    const int salt = name.empty() ? 0 : name[0] * 31 + int(name.size());
    float v = (right ? 2.f : 0.5f) * (0.3f + 1.4f * Hash(x, y, c, salt));
    if (name == "depth")
      v = sky ? Inf : right ? 9.f + 0.02f * y : 4.f + 0.01f * x + 0.02f * y;
    else if (name == "normal")
      v = sky      ? 0.f
          : c == 2 ? std::cos(right ? 0.7f : 0.05f * std::sin(0.3f * x))
          : c == 0 ? std::sin(right ? 0.7f : 0.05f * std::sin(0.3f * x))
                   : 0.f;
    else if (name == "id")
      v = sky ? 0.f : right ? 2.f : 1.f;
    else if (name == "history")
      v = float(int(8 * Hash(x, y, 0, 5)));
    else if (name == "albedo")
      v = ((x / 3 + y / 3) & 1) ? 0.7f : 0.f;
    return this->Change ? this->Change(name, x, y, c, v) : v;
  }

protected:
  vtkQuellNoisyFrame() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    w = this->Width;
    h = this->Height;
  }
  void Execute(quell::StageFrame& frame) override
  {
    ++this->Runs;
    this->LastRegion = frame.Region();
    for (const std::string& name : frame.WantedArrays())
    {
      if (name == this->Missing)
        continue;
      const quell::ArrayType* type = quell::FindArray(name);
      const quell::ImageOut out = type ? frame.Output(name) : frame.AddOutput(name, 3);
      const quell::Rect r = frame.Region();
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
          for (int c = 0; c < out.components; ++c)
            out.at(x, y)[c] = this->Value(name, x, y, c);
    }
  }

private:
  int Width = 75;
  int Height = 70;
};
vtkStandardNewMacro(vtkQuellNoisyFrame);
QUELL_STAGE_DESCRIPTION(vtkQuellNoisyFrame)
void vtkQuellNoisyFrame::Describe(quell::StageDescription& d)
{
  d.Category = "Test";
  for (const quell::ArrayType& a : quell::KnownArrays())
    d.Output(a.Name, a.Kind, a.Doc);
}

struct Quiet
{
  Quiet() { vtkObject::SetGlobalWarningDisplay(0); }
  ~Quiet() { vtkObject::SetGlobalWarningDisplay(1); }
};

/// Connects every input of the stage to the source.
void ConnectAll(vtkQuellStage* stage, vtkAlgorithm* source)
{
  for (const quell::InputPort& port : stage->GetDescription().Inputs)
    stage->ConnectInput(port.Name, source);
}

quell::ArraySet Outputs(vtkQuellStage* stage)
{
  quell::ArraySet names;
  for (const quell::OutputArray& out : stage->GetDescription().Outputs)
    names.insert(out.Name);
  return names;
}

using Pixels = std::map<std::string, std::vector<float>>;
Pixels Read(vtkQuellStage* stage)
{
  Pixels pixels;
  vtkImageData* image = stage->GetOutput();
  for (const std::string& name : Outputs(stage))
    if (auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name.c_str())))
      pixels[name].assign(array->GetPointer(0), array->GetPointer(0) + array->GetNumberOfValues());
  return pixels;
}

bool Same(const std::vector<float>& a, const std::vector<float>& b)
{
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

std::vector<std::string> Types()
{
  quell::StageRegistry registry;
  quell::RegisterDenoisingStages(registry);
  return registry.Types();
}

vtkSmartPointer<vtkQuellStage> Make(const std::string& type)
{
  quell::StageRegistry registry;
  quell::RegisterDenoisingStages(registry);
  vtkSmartPointer<vtkQuellStage> stage = registry.Create(type);
  std::string error;
  if (type == "ATrousFilter") // two passes halo 6: crops of a small frame are real crops
  {
    EXPECT_TRUE(stage->SetPropertyText("Iterations", "2", error)) << error;
  }
  return stage;
}

class EveryStage : public testing::TestWithParam<std::string>
{
};
std::string NameOf(const testing::TestParamInfo<std::string>& info)
{
  return info.param;
}
}

TEST_P(EveryStage, ExecutesOnceAndNothingTheSecondTime)
{
  vtkNew<vtkQuellNoisyFrame> source;
  auto stage = Make(GetParam());
  ConnectAll(stage, source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(stage, Outputs(stage));
  ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
  EXPECT_EQ(stage->GetCounters().Executions, 1);
  EXPECT_EQ(source->Runs, 1);
  EXPECT_EQ(Read(stage).size(), Outputs(stage).size());
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(stage->GetCounters().Executions, 1);
  EXPECT_EQ(source->Runs, 1);
}

// Bands overlap by the rows that later stages read: each pixel is counted once, and the last band tells of all.
TEST_P(EveryStage, CountsAFrameMadeInBandsOnce)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->Change = [](const std::string& name, int x, int y, int, float v)
  { return name != "id" && Hash(x, y, 0, name[0]) < 0.05f ? NaN : v; };
  const auto run = [&](const std::vector<quell::Rect>& bands, std::vector<std::string>& told)
  {
    auto stage = Make(GetParam());
    ConnectAll(stage, source);
    vtkNew<vtkQuellCollector> sink;
    for (const quell::Rect& band : bands)
    {
      sink->ClearRequests();
      sink->AddRequest(stage, Outputs(stage), band);
      EXPECT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
      told.push_back(stage->GetCountedWarning());
      const std::vector<std::string>& all = stage->GetWarnings();
      EXPECT_EQ(std::count(all.begin(), all.end(), told.back()), told.back().empty() ? 0 : 1);
    }
    return stage->GetCounters().NonFinite;
  };
  std::vector<std::string> whole, bands;
  const std::int64_t pixels = run({ { 0, 0, 75, 70 } }, whole);
  EXPECT_GT(pixels, 0);
  EXPECT_EQ(whole.back().find(std::to_string(pixels) + " pixels of "), 0u) << whole.back();
  EXPECT_EQ(run({ { 0, 45, 75, 70 }, { 0, 22, 75, 55 }, { 0, 0, 75, 32 } }, bands), pixels);
  EXPECT_EQ(bands.back(), whole.back());
  EXPECT_NE(bands.front(), whole.back());
}

TEST_P(EveryStage, RegionEqualsCropAndReadsItsHalo)
{
  // NaN pixels too: what fills them may not depend on the region.
  vtkNew<vtkQuellNoisyFrame> source;
  source->Change = [](const std::string& name, int x, int y, int, float v)
  { return name != "id" && Hash(x, y, 0, name[0]) < 0.01f ? NaN : v; };
  auto stage = Make(GetParam());
  ConnectAll(stage, source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(stage, Outputs(stage));
  ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
  const Pixels full = Read(stage);
  int halo = 0;
  for (int p = 0; p < stage->GetNumberOfInputPorts(); ++p)
    halo = std::max(halo, stage->HaloFor(p));
  for (const quell::Rect r : { quell::Rect{ 20, 22, 41, 30 }, quell::Rect{ 0, 0, 3, 70 }, quell::Rect{ 70, 60, 75, 70 },
         quell::Rect{ 37, 37, 38, 38 } })
  {
    sink->ClearRequests();
    sink->AddRequest(stage, Outputs(stage), r);
    source->Modified();
    ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
    EXPECT_EQ(source->LastRegion, r.grown(halo).clipped({ 0, 0, 75, 70 }));
    const Pixels crop = Read(stage);
    for (const auto& entry : crop)
    {
      const std::vector<float>& whole = full.at(entry.first);
      const size_t n = whole.size() / (75 * 70);
      ASSERT_EQ(entry.second.size(), n * r.area());
      for (int y = r.y0; y < r.y1; ++y)
        ASSERT_EQ(0, std::memcmp(entry.second.data() + (y - r.y0) * r.width() * n, whole.data() + (y * 75 + r.x0) * n,
                       r.width() * n * sizeof(float)))
          << entry.first << " row " << y;
    }
  }
}

TEST_P(EveryStage, SameBitsForAnyNumberOfThreads)
{
  vtkNew<vtkQuellNoisyFrame> source;
  auto stage = Make(GetParam());
  ConnectAll(stage, source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(stage, Outputs(stage));
  Pixels first;
  for (const int threads : { 1, 2, 3, 7 })
  {
    stage->Modified();
    bool done = false;
    quelltest::WithThreads(threads, [&] { done = sink->UpdateTick(0); });
    ASSERT_TRUE(done);
    const Pixels now = Read(stage);
    if (first.empty())
      first = now;
    for (const auto& entry : first)
      EXPECT_TRUE(Same(entry.second, now.at(entry.first))) << entry.first << " " << threads;
  }
  EXPECT_EQ(stage->GetCounters().Executions, 4);
}

TEST_P(EveryStage, ExtremesStayFinite)
{
  const std::map<std::string, std::function<float(const std::string&, int, int, int, float)>> cases = {
    { "all NaN", [](const std::string&, int, int, int, float) { return NaN; } },
    { "all infinite", [](const std::string&, int, int, int, float) { return Inf; } },
    { "zero", [](const std::string&, int, int, int, float) { return 0.f; } },
    { "denormal", [](const std::string&, int, int, int, float) { return 1e-42f; } },
    { "1e30", [](const std::string&, int, int, int, float) { return 1e30f; } },
    { "largest", [](const std::string& n, int, int, int, float v) { return n == "depth" || n == "id" ? v : FLT_MAX; } },
    { "a single 1e30", [](const std::string&, int x, int y, int, float v) { return x == 9 && y == 9 ? 1e30f : v; } },
    { "negative", [](const std::string&, int, int, int, float v) { return -v; } },
    { "poison",
      [](const std::string&, int x, int y, int c, float v)
      {
        const float h = Hash(x, y, c, 77);
        return h < 0.02f ? NaN : h < 0.04f ? Inf : h < 0.06f ? -Inf : h < 0.08f ? 1e30f : h < 0.1f ? -1e-6f : v;
      } },
  };
  for (const quell::Rect size :
    { quell::Rect{ 0, 0, 24, 20 }, quell::Rect{ 0, 0, 1, 1 }, quell::Rect{ 0, 0, 1, 9 }, quell::Rect{ 0, 0, 17, 1 } })
    for (const auto& c : cases)
    {
      vtkNew<vtkQuellNoisyFrame> source;
      source->SetWidth(size.x1);
      source->SetHeight(size.y1);
      source->Change = c.second;
      auto stage = Make(GetParam());
      ConnectAll(stage, source);
      vtkNew<vtkQuellCollector> sink;
      sink->AddRequest(stage, Outputs(stage));
      ASSERT_TRUE(sink->UpdateTick(0)) << c.first << ": " << stage->GetErrorText();
      for (const auto& entry : Read(stage))
        for (const float v : entry.second)
          ASSERT_TRUE(std::isfinite(v)) << c.first << ": " << entry.first << " " << size.x1 << " x " << size.y1;
      // A broken pixel is counted and told; a black image is not broken.
      EXPECT_EQ(stage->GetCounters().NonFinite > 0, c.first == "all NaN" || c.first == "all infinite" ||
                                                      (c.first == "poison" && stage->GetCounters().NonFinite > 0))
        << c.first;
      EXPECT_EQ(stage->GetCounters().NonFinite > 0,
        !stage->GetWarnings().empty() && stage->GetWarnings().back().find("not finite") != std::string::npos);
    }
}

TEST_P(EveryStage, MissingArrayAndMissingConnectionAreExplained)
{
  Quiet quiet;
  auto stage = Make(GetParam());
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(stage, Outputs(stage));
  EXPECT_FALSE(sink->UpdateTick(0));
  EXPECT_NE(stage->GetErrorText().find("is not connected"), std::string::npos) << stage->GetErrorText();

  // A foreign producer that simply lacks the array.
  vtkNew<vtkImageData> image;
  image->SetExtent(0, 7, 0, 7, 0, 0);
  vtkNew<vtkFloatArray> other;
  other->SetName("something");
  other->SetNumberOfComponents(1);
  other->SetNumberOfTuples(64);
  image->GetPointData()->AddArray(other);
  stage = Make(GetParam());
  stage->SetInputData(0, image);
  for (int p = 1; p < stage->GetNumberOfInputPorts(); ++p)
    if (!stage->GetDescription().Inputs[p].Optional)
      stage->SetInputData(p, image);
  stage->Update();
  EXPECT_NE(stage->GetErrorText().find("has no array"), std::string::npos) << stage->GetErrorText();
  EXPECT_NE(stage->GetErrorText().find("something"), std::string::npos) << stage->GetErrorText();
  EXPECT_EQ(stage->GetOutput()->GetNumberOfPoints(), 0);
}

TEST_P(EveryStage, PropertiesRefuseWhatIsOutOfRange)
{
  auto stage = Make(GetParam());
  for (const quell::Property& p : stage->GetDescription().Properties)
  {
    const std::string before = stage->GetPropertyText(p.Name);
    std::string error;
    EXPECT_TRUE(stage->SetPropertyText(p.Name, before, error)) << p.Name << " " << error;
    EXPECT_EQ(stage->GetPropertyText(p.Name), before);
    EXPECT_FALSE(p.Doc.empty());
    if (p.Kind == quell::Property::Type::String)
      continue; // any text is one; CheckSettings reads it
    std::vector<std::string> wrong = { "nan", "inf", "", "blue" };
    if (p.Kind != quell::Property::Type::Enum)
    {
      ASSERT_LT(p.Minimum, p.Maximum) << p.Name;
      wrong.push_back(std::to_string(p.Minimum - 1));
      wrong.push_back("1e38");
      char text[64];
      for (const double edge : { p.Minimum, p.Maximum })
      {
        std::snprintf(text, sizeof text, p.Kind == quell::Property::Type::Int ? "%.0f" : "%.17g", edge);
        EXPECT_TRUE(stage->SetPropertyText(p.Name, text, error)) << p.Name << " " << error;
      }
      stage->SetPropertyText(p.Name, before, error);
    }
    for (const std::string& text : wrong)
    {
      error.clear();
      EXPECT_FALSE(stage->SetPropertyText(p.Name, text, error)) << p.Name << " = " << text;
      EXPECT_FALSE(error.empty());
      EXPECT_EQ(stage->GetPropertyText(p.Name), before);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Denoising, EveryStage, testing::ValuesIn(Types()), NameOf);

TEST(DenoisingChain, DemodulateModulateIsTheIdentity)
{
  vtkNew<vtkQuellNoisyFrame> source; // its albedo is 0 in every other square
  vtkNew<vtkQuellAlbedoDemodulate> demod;
  vtkNew<vtkQuellAlbedoModulate> mod;
  demod->ConnectInput("radiance", source);
  demod->ConnectInput("albedo", source);
  mod->ConnectInput("illumination", demod);
  mod->ConnectInput("albedo", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(mod, { "radiance" });
  sink->AddRequest(source, { "radiance" });
  sink->AddRequest(demod, { "illumination" });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(source->Runs, 1);
  const auto out = Read(mod).at("radiance");
  auto in = vtkFloatArray::SafeDownCast(source->GetOutput()->GetPointData()->GetArray("radiance"));
  for (size_t i = 0; i < out.size(); ++i)
    ASSERT_NEAR(out[i] / in->GetValue(vtkIdType(i)), 1, 1.3e-7);
  EXPECT_FALSE(Same(Read(demod).at("illumination"), out));
}

TEST(DenoisingChain, ClampPlusResidualIsTheInput)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellFireflyClamp> clamp;
  clamp->SetThreshold(1.5);
  clamp->ConnectInput("radiance", source);
  vtkNew<vtkQuellSum> sum;
  sum->ConnectInput("radiance", clamp, "radiance");
  sum->ConnectInput("radiance", clamp, "residual");
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(sum, { "radiance" });
  sink->AddRequest(source, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  auto in = vtkFloatArray::SafeDownCast(source->GetOutput()->GetPointData()->GetArray("radiance"));
  EXPECT_EQ(0, std::memcmp(Read(sum).at("radiance").data(), in->GetPointer(0), 75 * 70 * 3 * sizeof(float)));
  EXPECT_GT(clamp->GetClampedPixels(), 100);
  EXPECT_LT(clamp->GetClampedPixels(), 75 * 70);
  EXPECT_GT(clamp->GetEnergyRemoved(), 0);
  EXPECT_LT(clamp->GetEnergyRemoved(), clamp->GetEnergyIn());
  EXPECT_NE(clamp->GetReport().find("removed"), std::string::npos);
}

TEST(DenoisingChain, SumKeepsTheOrderOfConnections)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->Change = [](const std::string& name, int, int, int, float) {
    return name == "direct" ? 1e8f : name == "indirect" ? 1.f : -1e8f;
  };
  vtkNew<vtkQuellSum> sum;
  for (const char* name : { "direct", "indirect", "residual" })
    sum->ConnectInput("radiance", source, name);
  sum->Update();
  EXPECT_EQ(Read(sum).at("radiance")[0], 0.f);
  vtkNew<vtkQuellSum> other;
  for (const char* name : { "direct", "residual", "indirect" })
    other->ConnectInput("radiance", source, name);
  other->Update();
  EXPECT_EQ(Read(other).at("radiance")[0], 1.f);
}

TEST(ATrousStage, IterationsZeroIsIdentityAndFiveReachTheirHalo)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->SetWidth(200);
  source->SetHeight(180);
  vtkNew<vtkQuellATrousFilter> filter;
  EXPECT_EQ(filter->HaloFor(0), 62);
  ConnectAll(filter, source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(filter, { "radiance", "variance", "feedback" });
  ASSERT_TRUE(sink->UpdateTick(0));
  const Pixels full = Read(filter);
  const quell::Rect r{ 92, 85, 101, 93 };
  sink->ClearRequests();
  sink->AddRequest(filter, { "radiance", "variance", "feedback" }, r);
  source->Modified(); // or the frame that is there would do
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(source->LastRegion, r.grown(63).clipped({ 0, 0, 200, 180 }));
  const Pixels crop = Read(filter);
  ASSERT_EQ(crop.at("variance").size(), size_t(r.area()));
  for (const auto& entry : crop)
  {
    const size_t n = entry.second.size() / r.area();
    for (int y = r.y0; y < r.y1; ++y)
      ASSERT_EQ(0, std::memcmp(entry.second.data() + (y - r.y0) * r.width() * n,
                     full.at(entry.first).data() + (y * 200 + r.x0) * n, r.width() * n * sizeof(float)))
        << entry.first;
  }
  filter->SetIterations(0);
  sink->ClearRequests();
  sink->AddRequest(filter, { "radiance" });
  sink->AddRequest(source, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  auto in = vtkFloatArray::SafeDownCast(source->GetOutput()->GetPointData()->GetArray("radiance"));
  EXPECT_EQ(0, std::memcmp(Read(filter).at("radiance").data(), in->GetPointer(0), 200 * 180 * 3 * sizeof(float)));
}

TEST(ATrousStage, FeedbackIsTheColourAfterThatPass)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellATrousFilter> three, one;
  three->SetIterations(3);
  one->SetIterations(1);
  ConnectAll(three, source);
  ConnectAll(one, source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(three, { "radiance", "feedback" });
  sink->AddRequest(one, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_TRUE(Same(Read(three).at("feedback"), Read(one).at("radiance")));
  EXPECT_FALSE(Same(Read(three).at("feedback"), Read(three).at("radiance")));
  three->SetFeedbackIteration(9);
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_TRUE(Same(Read(three).at("feedback"), Read(three).at("radiance")));
}

TEST(ATrousStage, VarianceOutputWithoutInputWarns)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellATrousFilter> filter;
  filter->SetIterations(1);
  filter->ConnectInput("radiance", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(filter, { "radiance", "variance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  ASSERT_EQ(filter->GetWarnings().size(), 1u);
}

TEST(VarianceStage, SvgfChainReducesNoise)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->Change = [](const std::string& name, int x, int, int, float v)
  { return name == "history" ? 1.f + 0 * x : v; };
  vtkNew<vtkQuellVarianceEstimate> variance;
  vtkNew<vtkQuellATrousFilter> filter;
  for (const char* port : { "radiance", "depth", "normal" })
    variance->ConnectInput(port, source);
  filter->ConnectInput("radiance", variance, "radiance");
  filter->ConnectInput("variance", variance, "variance");
  filter->ConnectInput("depth", source);
  filter->ConnectInput("normal", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(filter, { "radiance" });
  sink->AddRequest(source, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  // Left wall: uniform in [.15, .85], mean .5, variance .7^2 / 12 per channel.
  const auto out = Read(filter).at("radiance");
  double error = 0;
  for (int y = 10; y < 60; ++y)
    for (int x = 6; x < 32; ++x)
      error += std::pow(out[(y * 75 + x) * 3] - 0.5, 2) / (50 * 26);
  EXPECT_LT(error, 0.04 * 0.49 / 12);
}

TEST(BilateralStage, AutomaticRadius)
{
  vtkNew<vtkQuellBilateralFilter> filter;
  EXPECT_EQ(filter->HaloFor(0), 6);
  filter->SetSigmaSpatial(1.5);
  EXPECT_EQ(filter->HaloFor(0), 5);
  filter->SetSigmaSpatial(1e30);
  EXPECT_EQ(filter->HaloFor(0), 64);
  filter->SetRadius(3);
  EXPECT_EQ(filter->HaloFor(0), 3);
  filter->SetRadius(0);
  EXPECT_EQ(filter->HaloFor(0), 1);
}

TEST(AovSplitStage, WarnsWhenTheSumFails)
{
  Quiet quiet;
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellAovSplit> split;
  ConnectAll(split, source); // random passes do not add up
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(split, { "residual" });
  ASSERT_TRUE(sink->UpdateTick(0));
  ASSERT_EQ(split->GetWarnings().size(), 1u);
  EXPECT_NE(split->GetWarnings()[0].find("do not add up"), std::string::npos);
  EXPECT_GT(split->GetPixelsOver(), 1000);
  EXPECT_FALSE(split->GetReport().empty());

  vtkNew<vtkQuellAovSplit> alone;
  alone->ConnectInput("combined", source);
  sink->ClearRequests();
  sink->AddRequest(alone, { "direct", "radiance", "residual" });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_TRUE(Same(Read(alone).at("direct"), Read(alone).at("radiance")));
  EXPECT_TRUE(alone->GetWarnings().empty());

  vtkNew<vtkQuellAovSplit> half;
  half->ConnectInput("combined", source);
  half->ConnectInput("diffuseDirect", source);
  sink->ClearRequests();
  sink->AddRequest(half, { "direct" });
  EXPECT_FALSE(sink->UpdateTick(0));
  EXPECT_NE(half->GetErrorText().find("diffuseColor"), std::string::npos);
}

TEST(KernelFilter, FiltersTheNamedArraysWithTheColoursWeights)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->Change = [](const std::string& name, int x, int y, int, float v) {
    return name == "alpha" ? (x == 20 && y == 20 ? 100.f : 0.5f) : name == "radiance" && x == 20 && y == 20 ? NaN : v;
  };
  vtkNew<vtkQuellKernelFilter> filter;
  filter->SetKernel(1);
  filter->SetRadius(2);
  filter->SetArrays("alpha normal varianceAlbedo depth");
  filter->ConnectInput("radiance", source);
  vtkNew<vtkQuellCollector> sink;
  // Only arrays that the table does not list: they are made all the same.
  sink->AddRequest(filter, { "alpha", "normal", "varianceAlbedo", "depth", "albedo", "id" });
  sink->AddRequest(source, { "varianceAlbedo", "albedo", "id", "depth" });
  ASSERT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
  const auto at = [](vtkQuellStage* stage, const char* name, int x, int y, int c)
  { return stage->GetOutput()->GetPointData()->GetArray(name)->GetComponent(y * 75 + x, c); };
  for (int y = 0; y < 70; ++y)
    for (int x = 0; x < 75; ++x)
    {
      ASSERT_NEAR(at(filter, "alpha", x, y, 0), 0.5, 1e-5) << x << " " << y;
      double length = 0;
      for (int c = 0; c < 3; ++c)
        length += at(filter, "normal", x, y, c) * at(filter, "normal", x, y, c);
      ASSERT_TRUE(std::fabs(length - 1) < 1e-6 || length == 0) << x << " " << y;
      ASSERT_EQ(at(filter, "id", x, y, 0), at(source, "id", x, y, 0)) << "passes through";
      ASSERT_EQ(at(filter, "albedo", x, y, 0), at(source, "albedo", x, y, 0)) << "passes through";
      ASSERT_EQ(std::isinf(at(filter, "depth", x, y, 0)), std::isinf(at(source, "depth", x, y, 0)));
    }
  double sum = 0;
  for (int y = 38; y <= 42; ++y)
    for (int x = 8; x <= 12; ++x)
      sum += at(source, "varianceAlbedo", x, y, 0);
  EXPECT_NEAR(at(filter, "varianceAlbedo", 10, 40, 0), sum / 625, 1e-6 * sum);
  EXPECT_EQ(filter->GetCounters().NonFinite, 0) << "radiance itself was not asked for";
}

TEST(KernelFilter, TellsOfArraysThatTheInputLacks)
{
  vtkNew<vtkQuellNoisyFrame> source;
  for (const char* type : { "KernelFilter", "BilateralFilter" })
  {
    auto filter = Make(type);
    std::string error;
    ASSERT_TRUE(filter->SetPropertyText("Arrays", "radiance albdo normal", error)) << error;
    ASSERT_TRUE(filter->SetPropertyText("Radius", "1", error)) << error;
    filter->ConnectInput("radiance", source);
    filter->Update();
    EXPECT_EQ(filter->GetErrorText(), "");
    ASSERT_EQ(filter->GetWarnings().size(), 1u);
    EXPECT_EQ(filter->GetWarnings()[0],
      "input \"radiance\": Arrays names \"albdo\", which is not there; did you mean \"albedo\"?");
    ASSERT_TRUE(filter->SetPropertyText("Arrays", "albedo", error)) << error;
    filter->Update();
    EXPECT_TRUE(filter->GetWarnings().empty());
  }
}

TEST(KernelFilter, RefusesWhatMakesNoSense)
{
  Quiet quiet;
  const std::pair<const char*, const char*> cases[] = { { "1 2; 3 4", "no centre" }, { "1 -1 0", "add up to 0" },
    { "1 one 1", "\"one\" in row 1" } };
  for (const auto& c : cases)
  {
    vtkNew<vtkQuellKernelFilter> filter;
    filter->SetKernel(4);
    filter->SetMatrix(c.first);
    try
    {
      filter->CheckSettings();
      FAIL() << c.first;
    }
    catch (const quell::StageError& e)
    {
      EXPECT_NE(std::string(e.what()).find(c.second), std::string::npos) << e.what();
    }
    vtkNew<vtkQuellNoisyFrame> source;
    filter->ConnectInput("radiance", source);
    filter->Update();
    EXPECT_NE(filter->GetErrorText().find(c.second), std::string::npos) << filter->GetErrorText();
  }
  vtkNew<vtkQuellKernelFilter> filter;
  filter->SetKernel(4);
  filter->SetMatrix("1 -1 0");
  filter->SetNormalize(false);
  EXPECT_NO_THROW(filter->CheckSettings());
  filter->SetArrays("alpha id");
  EXPECT_THROW(filter->CheckSettings(), quell::StageError);
}

TEST(BilateralFilter, TakesAnyListOfGuides)
{
  vtkNew<vtkQuellNoisyFrame> source;
  const auto run = [&](const std::function<void(vtkQuellBilateralFilter*)>& setUp)
  {
    vtkNew<vtkQuellBilateralFilter> filter;
    filter->SetRadius(3);
    filter->SetSigmaRange(1e30);
    filter->ConnectInput("radiance", source);
    setUp(filter);
    vtkNew<vtkQuellCollector> sink;
    sink->AddRequest(filter, { "radiance" });
    EXPECT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
    return Read(filter).at("radiance");
  };
  const auto guide = [&](vtkQuellBilateralFilter* filter, const char* array, const char* sigma, const char* distance)
  {
    std::string error;
    const int port = filter->GetDescription().InputIndex("guide"), c = filter->GetNumberOfInputConnections(port);
    filter->ConnectInput("guide", source, array);
    EXPECT_TRUE(filter->SetInputAttribute(port, c, "sigma", sigma, error)) << error;
    EXPECT_TRUE(!distance || filter->SetInputAttribute(port, c, "distance", distance, error)) << error;
  };
  const auto named = run(
    [&](vtkQuellBilateralFilter* f)
    {
      f->ConnectInput("albedo", source);
      f->ConnectInput("id", source);
      f->SetSigmaAlbedo(0.15);
    });
  const auto listed = run(
    [&](vtkQuellBilateralFilter* f)
    {
      guide(f, "id", "1", nullptr);
      guide(f, "albedo", "0.15", "Euclidean");
    });
  for (size_t i = 0; i < named.size(); ++i)
    ASSERT_NEAR(listed[i], named[i], 1e-5 * named[i]);
  const auto color = run([&](vtkQuellBilateralFilter* f) { guide(f, "radiance", "0.2", nullptr); });
  EXPECT_TRUE(Same(color, run([&](vtkQuellBilateralFilter* f) { f->SetSigmaRange(0.2); }))) << "Color is the default";
  const auto noisy = run(
    [&](vtkQuellBilateralFilter* f)
    {
      guide(f, "radiance", "0.2", nullptr);
      f->ConnectInput("guideVariance", source, "variance");
    });
  EXPECT_FALSE(Same(color, noisy));
}

TEST(BilateralFilter, ExplainsMistakesInGuides)
{
  Quiet quiet;
  vtkNew<vtkQuellNoisyFrame> source;
  const auto error = [&](const std::function<void(vtkQuellBilateralFilter*)>& setUp)
  {
    vtkNew<vtkQuellBilateralFilter> filter;
    filter->ConnectInput("radiance", source);
    setUp(filter);
    filter->Update();
    return filter->GetErrorText();
  };
  const auto has = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_PRED2(has,
    error(
      [&](auto* f)
      {
        f->ConnectInput("guide", source, "position");
        f->SetInputArray(6, 0, "position");
        std::string e;
        f->SetInputAttribute(6, 0, "distance", "plane", e);
      }),
    "needs input \"normal\"");
  EXPECT_PRED2(
    has, error([&](auto* f) { f->ConnectInput("guideVariance", source, "variance"); }), "no guide is connected");
  EXPECT_EQ(error(
              [&](auto* f)
              {
                f->ConnectInput("guide", source, "albedo");
                f->ConnectInput("guide", source, "normal");
                f->ConnectInput("guideVariance", source, "variance");
              }),
    "input \"guideVariance\": \"variance\" does not say of which guide it is; say it with guide=\"albedo\"; guides: "
    "albedo, normal");
  EXPECT_EQ(error(
              [&](auto* f)
              {
                f->ConnectInput("guide", source, "albedo");
                f->ConnectInput("guide", source, "albedo");
                f->ConnectInput("guideVariance", source, "variance");
                std::string e;
                f->SetInputAttribute(7, 0, "guide", "albedo", e);
              }),
    "input \"guideVariance\": several guides are called \"albedo\"; give each a name=\"...\" of its own");
  EXPECT_PRED2(has,
    error(
      [&](auto* f)
      {
        f->ConnectInput("guide", source, "albedo");
        f->ConnectInput("guideVariance", source, "variance");
        std::string e;
        f->SetInputAttribute(7, 0, "guide", "nomral", e);
      }),
    "there is no guide \"nomral\"");
  EXPECT_PRED2(has,
    error(
      [&](auto* f)
      {
        f->ConnectInput("guide", source, "depth");
        f->ConnectInput("guideVariance", source, "variance");
      }),
    "takes no variance");
  EXPECT_PRED2(has,
    error(
      [&](auto* f)
      {
        f->ConnectInput("guide", source, "depth");
        std::string e;
        f->SetInputAttribute(6, 0, "distance", "Normal", e);
      }),
    "\"depth\" has 1 component, distance Normal compares 3; for one component there are Euclidean, LogDepth and Id");
  vtkNew<vtkQuellBilateralFilter> filter;
  std::string text;
  EXPECT_FALSE(filter->SetInputAttribute(6, 0, "distance", "near", text));
  EXPECT_PRED2(has, text, "none of Euclidean, Color");
  EXPECT_FALSE(filter->SetInputAttribute(6, 0, "sigma", "-1", text));
  EXPECT_PRED2(has, text, "sigma");
  EXPECT_FALSE(filter->SetInputAttribute(6, 0, "strength", "1", text));
  EXPECT_PRED2(has, text, "no attribute");
  EXPECT_FALSE(filter->SetInputAttribute(2, 0, "sigma", "1", text)) << "a named guide has a property";
}

TEST(NonLocalStages, HalvesAreFilteredAgainstEachOther)
{
  // Two halves of a step with noise that is the same in no pixel.
  vtkNew<vtkQuellNoisyFrame> source;
  source->SetWidth(60);
  source->SetHeight(40);
  source->Change = [](const std::string& name, int x, int y, int c, float v)
  {
    const float step = x < 30 ? 1.f : 3.f;
    if (name == "halfA" || name == "halfB")
      return step + 0.4f * (Hash(x, y, c, name == "halfA" ? 1 : 2) - 0.5f);
    return name == "radiance" ? step : name == "depth" ? 1.f : name == "albedo" ? 0.5f : v;
  };
  for (const char* type : { "NonLocalMeans", "RegressionFilter" })
    for (const bool known : { false, true })
    {
      auto stage = Make(type);
      std::string error;
      ASSERT_TRUE(stage->SetPropertyText("Radius", "5", error)) << error;
      ASSERT_TRUE(stage->SetPropertyText("PatchRadius", "1", error)) << error;
      ASSERT_TRUE(stage->SetPropertyText("KColor", "1", error)) << error;
      for (const char* port : { "radiance", "halfA", "halfB", "depth" })
        stage->ConnectInput(port, source);
      if (known)
      {
        // of the mean of both: half of a half's, 0.4^2 / 12
        source->Change = [change = source->Change](const std::string& name, int x, int y, int c, float v)
        { return name == "variance" ? 0.16f / 24 : change(name, x, y, c, v); };
        stage->ConnectInput("variance", source);
      }
      vtkNew<vtkQuellCollector> sink;
      sink->AddRequest(stage, { "radiance", "variance" });
      ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
      const auto radiance = Read(stage).at("radiance"), variance = Read(stage).at("variance");
      double before = 0, after = 0, told = 0;
      for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 60; ++x)
        {
          const double truth = x < 30 ? 1 : 3, mean = truth + 0.2 * (Hash(x, y, 1, 1) + Hash(x, y, 1, 2) - 1);
          const double v = radiance[(y * 60 + x) * 3 + 1];
          before += (mean - truth) * (mean - truth);
          after += (v - truth) * (v - truth);
          told += variance[y * 60 + x];
        }
      EXPECT_LT(after, before / 8) << type << known;
      // What is left, as the halves tell it: of the luminance, three channels of independent noise.
      EXPECT_GT(told, 0.1 * after) << type << known;
      EXPECT_LT(told, 2 * after) << type << known;
    }
}

TEST(NonLocalStages, NegativeVarianceOfHalvesIsNone)
{
  // Also where the errors of two widths are estimated with it.
  for (const char* type : { "NonLocalMeans", "RegressionFilter" })
  {
    std::vector<float> made[3];
    const float values[3] = { 0, -1e10f, std::numeric_limits<float>::quiet_NaN() };
    for (int k = 0; k < 3; ++k)
    {
      vtkNew<vtkQuellNoisyFrame> source;
      source->Change = [value = values[k]](const std::string& name, int x, int y, int c, float v)
      {
        if (name == "variance")
          return (x + 3 * y) % 7 == 0 ? value : 0.02f;
        return name == "halfA" || name == "halfB" ? 1 + 0.4f * Hash(x, y, c, name == "halfA" ? 1 : 2) : v;
      };
      auto stage = Make(type);
      std::string error;
      ASSERT_TRUE(stage->SetPropertyText("Radius", "3", error)) << error;
      for (const char* port : { "radiance", "halfA", "halfB", "depth", "variance" })
        stage->ConnectInput(port, source);
      vtkNew<vtkQuellCollector> sink;
      sink->AddRequest(stage, { "radiance" });
      ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
      made[k] = Read(stage).at("radiance");
    }
    EXPECT_EQ(made[1], made[0]) << type;
    EXPECT_EQ(made[2], made[0]) << type;
  }
}

TEST(NonLocalStages, ExplainMistakes)
{
  Quiet quiet;
  vtkNew<vtkQuellNoisyFrame> source;
  const auto has = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  auto stage = Make("NonLocalMeans");
  stage->ConnectInput("radiance", source);
  stage->ConnectInput("halfA", source);
  stage->Update();
  EXPECT_EQ(stage->GetErrorText(), "input \"halfA\": wants input \"halfB\" too; one half alone is no use");
  stage = Make("RegressionFilter");
  stage->ConnectInput("radiance", source);
  for (const char* array : { "radiance", "albedo", "normal", "position" })
    stage->ConnectInput("feature", source, array);
  stage->Update();
  EXPECT_PRED2(has, stage->GetErrorText(), "input \"feature\": the features have 12 components together");
  stage = Make("NonLocalMeans");
  stage->ConnectInput("radiance", source);
  stage->ConnectInput("guideVariance", source);
  stage->Update();
  EXPECT_PRED2(has, stage->GetErrorText(), "no guide is connected");
  std::string error;
  const int guide = stage->GetDescription().InputIndex("guide");
  EXPECT_FALSE(stage->SetInputAttribute(guide, 0, "least", "0", error));
  EXPECT_PRED2(has, error, "least");
  EXPECT_FALSE(stage->SetInputAttribute(guide, 0, "sigma", "1", error));
  EXPECT_FALSE(stage->SetInputAttribute(0, 0, "least", "1", error));
}

TEST(FeaturePrefilter, TakesNoiseAndLeavesTexturesAndCreases)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->SetWidth(64);
  source->SetHeight(48);
  const auto texture = [](int x, int y) { return (x / 8 + y / 8) & 1 ? 0.8f : 0.3f; };
  source->Change = [&](const std::string& name, int x, int y, int c, float v)
  {
    if (name == "albedo")
      return texture(x, y) + 0.1f * (Hash(x, y, c, 1) + Hash(x, y, c, 2) - 1);
    if (name == "normal")
      return (x < 32 ? c == 2 : c == 0) + 0.1f * (Hash(x, y, c, 3) - 0.5f);
    return name == "depth" ? (x < 60 ? 1.f : Inf) : v;
  };
  for (const bool known : { false, true })
  {
    auto stage = Make("FeaturePrefilter");
    for (const char* port : { "albedo", "normal", "depth" })
      stage->ConnectInput(port, source);
    if (known)
    {
      source->Change = [change = source->Change](const std::string& name, int x, int y, int c, float v) {
        return name == "varianceAlbedo" ? 0.01f / 6 : name == "varianceNormal" ? 0.01f / 12 : change(name, x, y, c, v);
      };
      stage->ConnectInput("varianceAlbedo", source);
      stage->ConnectInput("varianceNormal", source);
    }
    vtkNew<vtkQuellCollector> sink;
    sink->AddRequest(stage, { "albedo", "normal" });
    sink->AddRequest(source, { "albedo", "normal" });
    ASSERT_TRUE(sink->UpdateTick(0)) << stage->GetErrorText();
    const Pixels out = Read(stage);
    const auto value = [&](const char* name, int x, int y, int c)
    { return source->GetOutput()->GetPointData()->GetArray(name)->GetComponent(y * 64 + x, c); };
    double before = 0, after = 0, tiltBefore = 0, tiltAfter = 0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 64; ++x)
      {
        const size_t i = size_t(y * 64 + x) * 3;
        if (x >= 60)
        {
          ASSERT_EQ(out.at("albedo")[i], float(value("albedo", x, y, 0))) << "background passes through";
          continue;
        }
        for (int c = 0; c < 3; ++c)
        {
          const double truth = texture(x, y), tilt = x < 32 ? c == 2 : c == 0;
          before += std::pow(value("albedo", x, y, c) - truth, 2);
          after += std::pow(out.at("albedo")[i + c] - truth, 2);
          tiltBefore += std::pow(value("normal", x, y, c) - tilt, 2);
          tiltAfter += std::pow(out.at("normal")[i + c] - tilt, 2);
        }
      }
    EXPECT_LT(after, before / 8) << known;
    EXPECT_LT(tiltAfter, tiltBefore / 8) << known;
  }
}

TEST(EmissionSplit, PartsAddUpAndTheMaskKeepsFiltersOut)
{
  vtkNew<vtkQuellNoisyFrame> source;
  source->Change = [](const std::string& name, int x, int y, int, float v) {
    return name == "radiance" ? (x >= 20 && x < 30 && y >= 20 && y < 26 ? 17.f : 0.2f) : name == "depth" ? 1.f : v;
  };
  vtkNew<vtkQuellEmissionSplit> split;
  split->ConnectInput("radiance", source);
  vtkNew<vtkQuellBilateralFilter> filter;
  filter->SetSigmaRange(1e30);
  filter->ConnectInput("radiance", split);
  filter->ConnectInput("guide", split, "mask");
  std::string error;
  ASSERT_TRUE(filter->SetInputAttribute(filter->GetDescription().InputIndex("guide"), 0, "distance", "Id", error))
    << error;
  vtkNew<vtkQuellSum> sum;
  sum->ConnectInput("radiance", filter, "radiance");
  sum->ConnectInput("radiance", split, "emission");
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(sum, { "radiance" });
  sink->AddRequest(source, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0)) << sum->GetErrorText();
  auto in = vtkFloatArray::SafeDownCast(source->GetOutput()->GetPointData()->GetArray("radiance"));
  const auto out = Read(sum).at("radiance");
  for (size_t i = 0; i < out.size(); ++i)
    ASSERT_EQ(out[i], in->GetValue(vtkIdType(i))) << "neither is the lamp smeared nor is there a dark rim around it";
}

TEST(NonLocalStages, RegressionTakesTheBetterWidthPixelByPixel)
{
  // Left: flat, wants wide weights. Right: faint stripes in the noise, which wide weights mix. Between them, where
  // one side's errors are smoothed into the other, nothing is said.
  const auto truth = [](int x, int y) { return x < 64 ? 1.f : 1.f + 0.2f * (y / 3 % 2); };
  // What is compared is small: noise whose halves really know nothing of each other.
  std::mt19937 generator(3);
  std::vector<float> noise(2 * 128 * 60 * 3);
  for (float& v : noise)
    v = 0.25f * (float(generator() >> 8) * 0x1p-24f - 0.5f);
  const auto half = [&](int x, int y, int c, int which) { return noise[((which * 60 + y) * 128 + x) * 3 + c]; };
  vtkNew<vtkQuellNoisyFrame> source;
  source->SetWidth(128);
  source->SetHeight(60);
  source->Change = [&](const std::string& name, int x, int y, int c, float v)
  {
    if (name == "halfA" || name == "halfB")
      return truth(x, y) + half(x, y, c, name == "halfB");
    if (name == "radiance")
      return truth(x, y) + 0.5f * (half(x, y, c, 0) + half(x, y, c, 1));
    return name == "depth" ? 1.f : v;
  };
  const auto errors = [&](double wide, double narrow)
  {
    vtkNew<vtkQuellRegressionFilter> filter;
    filter->SetRadius(4);
    filter->SetPatchRadius(1);
    filter->SetKColor(wide);
    filter->SetKColorNarrow(narrow);
    for (const char* port : { "radiance", "halfA", "halfB", "depth" })
      filter->ConnectInput(port, source);
    vtkNew<vtkQuellCollector> sink;
    sink->AddRequest(filter, { "radiance" });
    EXPECT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
    const auto out = Read(filter).at("radiance");
    std::array<double, 2> sums{};
    for (int y = 0; y < 60; ++y)
      for (int x = 0; x < 128; ++x)
        for (int c = 0; c < 3; ++c)
          sums[x >= 64] += x >= 40 && x < 72 ? 0 : std::pow(out[size_t(y * 128 + x) * 3 + c] - truth(x, y), 2);
    return sums;
  };
  const auto wide = errors(20, 0), narrow = errors(0.15, 0), both = errors(20, 0.15);
  ASSERT_LT(wide[0], 0.8 * narrow[0]);
  ASSERT_LT(narrow[1], 0.8 * wide[1]);
  EXPECT_LT(both[0], 0.5 * (wide[0] + narrow[0]));
  EXPECT_LT(both[1], 0.5 * (wide[1] + narrow[1]));
}

namespace
{
/// What WeighPixel says of a pixel, multiplied out again.
std::array<double, 3> Weighed(const quell::PixelWeights& weights, const quell::ImageIn& input)
{
  std::array<double, 3> sum{};
  for (const quell::PixelWeights::Part& part : weights.Parts)
    for (int y = part.Window.y0; y < part.Window.y1; ++y)
      for (int x = part.Window.x0; x < part.Window.x1; ++x)
        for (int c = 0; c < 3; ++c)
          if (const float w = part.At(x, y))
            sum[std::size_t(c)] += double(w) * double(input.at(x, y)[c]);
  return sum;
}

quell::ImageIn ViewOf(vtkImageData* image, const char* array)
{
  vtkDataArray* a = image->GetPointData()->GetArray(array);
  const int* e = image->GetExtent();
  return a ? quell::ImageIn(static_cast<float*>(a->GetVoidPointer(0)), a->GetNumberOfComponents(),
               { e[0], e[2], e[1] + 1, e[3] + 1 })
           : quell::ImageIn();
}

void ExpectWeightsMakePixels(
  vtkQuellStage* filter, vtkQuellNoisyFrame* source, const char* what, double tolerance = 1e-5)
{
  SCOPED_TRACE(what);
  ASSERT_TRUE(filter->CanWeigh());
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(filter, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
  const quell::ImageIn in = ViewOf(source->GetOutput(), "radiance"), out = ViewOf(filter->GetOutput(), "radiance");
  ASSERT_TRUE(in && out);
  const int w = source->GetWidth(), h = source->GetHeight();
  const std::pair<int, int> pixels[] = { { 0, 0 }, { w - 1, 0 }, { w / 2, h / 2 }, { w / 2 + 1, h / 3 }, { 7, h - 1 },
    { w - 2, h - 2 }, { 20, 11 } };
  for (const auto& p : pixels)
  {
    quell::PixelWeights weights;
    std::string error;
    ASSERT_TRUE(filter->WeighPixel(p.first, p.second, weights, error)) << error;
    ASSERT_EQ(weights.Parts.size(), 1u);
    double sum = 0;
    for (float v : weights.Parts[0].Weights)
      sum += double(v);
    EXPECT_NEAR(sum, 1, 0.2 * tolerance) << p.first << ", " << p.second;
    const std::array<double, 3> made = Weighed(weights, in);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(
        made[std::size_t(c)], double(out.at(p.first, p.second)[c]), tolerance * double(out.at(p.first, p.second)[c]))
        << p.first << ", " << p.second << " channel " << c;
  }
  quell::PixelWeights none;
  std::string error;
  EXPECT_FALSE(filter->WeighPixel(w, 0, none, error));
  EXPECT_NE(error.find("not in the frame"), std::string::npos) << error;
}
}

// The viewer shows what a pixel is made of: those weights times the input are the output.
TEST(PixelWeights, MakeThePixelOfABilateralFilter)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellBilateralFilter> alone, guided, featured;
  alone->ConnectInput("radiance", source);
  alone->SetRadius(3);
  ExpectWeightsMakePixels(alone, source, "colour alone");
  for (const char* port : { "radiance", "depth", "normal", "albedo", "id" })
    guided->ConnectInput(port, source);
  ExpectWeightsMakePixels(guided, source, "guides");
  featured->ConnectInput("radiance", source);
  featured->ConnectInput("guide", source, "roughness");
  featured->SetRange(2);
  featured->SetRadius(9);
  ExpectWeightsMakePixels(featured, source, "a further feature, wide");
}

TEST(PixelWeights, MakeThePixelOfAllPassesOfATrous)
{
  vtkNew<vtkQuellNoisyFrame> source;
  for (int passes : { 0, 1, 3, 5 })
  {
    vtkNew<vtkQuellATrousFilter> filter;
    for (const char* port : { "radiance", "variance", "depth", "normal", "id" })
      filter->ConnectInput(port, source);
    filter->SetIterations(passes);
    ExpectWeightsMakePixels(filter, source, ("passes " + std::to_string(passes)).c_str());
  }
  vtkNew<vtkQuellATrousFilter> plain;
  plain->ConnectInput("radiance", source);
  plain->SetIterations(4);
  ExpectWeightsMakePixels(plain, source, "without guides and variance");
}

TEST(PixelWeights, AreThoseOfTheMatrix)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellKernelFilter> filter;
  filter->ConnectInput("radiance", source);
  filter->SetKernel(3); // Gaussian
  filter->SetSigma(1.5);
  ExpectWeightsMakePixels(filter, source, "Gaussian");
  filter->SetKernel(4);
  filter->SetMatrix("1 2 3; 4 5 6; 7 8 10");
  ExpectWeightsMakePixels(filter, source, "Matrix");
  quell::PixelWeights weights;
  std::string error;
  ASSERT_TRUE(filter->WeighPixel(20, 20, weights, error)) << error;
  // The first row written is the one on top.
  EXPECT_NEAR(weights.Parts[0].At(19, 21), 1. / 46, 1e-7);
  EXPECT_NEAR(weights.Parts[0].At(21, 19), 10. / 46, 1e-7);
  EXPECT_EQ(weights.Parts[0].At(23, 19), 0);
}

TEST(PixelWeights, MakeThePixelOfTheChosenKernels)
{
  vtkNew<vtkQuellNoisyFrame> source;
  for (int scales : { 0, 1, 4 })
  {
    vtkNew<vtkQuellVarianceSteeredFilter> filter;
    for (const char* port : { "radiance", "variance", "depth", "normal", "id" })
      filter->ConnectInput(port, source);
    filter->SetScales(scales);
    ExpectWeightsMakePixels(filter, source, ("scales " + std::to_string(scales)).c_str());
  }
  vtkNew<vtkQuellVarianceSteeredFilter> plain;
  plain->ConnectInput("radiance", source);
  plain->ConnectInput("variance", source);
  ExpectWeightsMakePixels(plain, source, "without guides");
}

TEST(PixelWeights, MakeThePixelOfNonLocalMeans)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellNonLocalMeans> plain, guided;
  plain->ConnectInput("radiance", source);
  plain->SetRadius(3);
  plain->SetPatchRadius(1);
  ExpectWeightsMakePixels(plain, source, "colour alone");
  guided->ConnectInput("radiance", source);
  guided->ConnectInput("variance", source);
  guided->ConnectInput("depth", source);
  guided->ConnectInput("guide", source, "normal");
  guided->ConnectInput("guide", source, "albedo");
  guided->SetRadius(4);
  ExpectWeightsMakePixels(guided, source, "guides");
}

namespace
{
/// Two halves are two inputs, each with the weights that the other one gave.
void ExpectWeightsOfHalves(vtkQuellNonLocalFilter* filter, double tolerance)
{
  vtkNew<vtkQuellNoisyFrame> a, b;
  b->Change = [](const std::string&, int x, int y, int c, float v) { return v * (0.7f + 0.6f * Hash(x, y, c, 99)); };
  filter->ConnectInput("radiance", a);
  filter->ConnectInput("halfA", a, "radiance");
  filter->ConnectInput("halfB", b, "radiance");
  filter->SetRadius(3);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(filter, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0)) << filter->GetErrorText();
  const quell::ImageIn out = ViewOf(filter->GetOutput(), "radiance");
  for (const auto& p : { std::make_pair(0, 0), std::make_pair(12, 9), std::make_pair(20, 11) })
  {
    quell::PixelWeights weights;
    std::string error;
    ASSERT_TRUE(filter->WeighPixel(p.first, p.second, weights, error)) << error;
    ASSERT_EQ(weights.Parts.size(), 2u);
    EXPECT_EQ(weights.Parts[0].Input, "halfA");
    EXPECT_EQ(weights.Parts[1].Input, "halfB");
    std::array<double, 3> made{};
    for (std::size_t part = 0; part < 2; ++part)
    {
      quell::PixelWeights one;
      one.Parts.push_back(weights.Parts[part]);
      double sum = 0;
      for (float v : one.Parts[0].Weights)
        sum += double(v);
      EXPECT_NEAR(sum, 0.5, tolerance);
      const auto half = Weighed(one, ViewOf((part == 0 ? a : b)->GetOutput(), "radiance"));
      for (std::size_t c = 0; c < 3; ++c)
        made[c] += half[c];
    }
    for (int c = 0; c < 3; ++c)
    {
      const double expected = double(out.at(p.first, p.second)[c]);
      EXPECT_NEAR(made[std::size_t(c)], expected, tolerance * expected);
    }
  }
}
}

TEST(PixelWeights, OfHalvesAreOfBoth)
{
  vtkNew<vtkQuellNonLocalMeans> means;
  ExpectWeightsOfHalves(means, 1e-5);
  // By its formula in double, while the filter weighs in float.
  vtkNew<vtkQuellRegressionFilter> one, two;
  one->SetKColorNarrow(0);
  ExpectWeightsOfHalves(one, 1e-4);
  two->SetKColorNarrow(0.3);
  ExpectWeightsOfHalves(two, 1e-4);
}

TEST(PixelWeights, MakeThePixelOfARegression)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellRegressionFilter> plain, featured;
  plain->ConnectInput("radiance", source);
  plain->SetRadius(3);
  ExpectWeightsMakePixels(plain, source, "a plane", 1e-4);
  featured->ConnectInput("radiance", source);
  featured->ConnectInput("depth", source);
  featured->ConnectInput("guide", source, "normal");
  featured->ConnectInput("feature", source, "albedo");
  featured->ConnectInput("feature", source, "normal");
  featured->SetRadius(4);
  ExpectWeightsMakePixels(featured, source, "features", 1e-4);
}

TEST(PixelWeights, OthersSaySo)
{
  vtkNew<vtkQuellNoisyFrame> source;
  vtkNew<vtkQuellSum> sum;
  sum->ConnectInput("radiance", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(sum, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_FALSE(sum->CanWeigh());
  quell::PixelWeights weights;
  std::string error;
  EXPECT_FALSE(sum->WeighPixel(1, 1, weights, error));
  EXPECT_EQ(error, "this stage has no weights to show");
}
