// SPDX-License-Identifier: BSD-3-Clause
// What every stage owes, checked for each type in the registry: a complete table, honest properties, odd sizes,
// non-finite pixels, crops and thread counts. A new stage is tested here by being registered.
#include "../AllStages.h"
#include "vtkDataArray.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"
#include "vtkQuellStage.h"
#include "vtkSMPTools.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <gtest/gtest.h>
#include <limits>
#include <set>
#include <sstream>

namespace
{
enum class Content
{
  Plain,
  Zero,
  NotANumber, ///< one NaN pixel in every colour
  Infinite,   ///< one +inf pixel in every colour
  Huge,       ///< 1e30 everywhere
  Peak,       ///< 2 x 2 pixels of 3e38 among small ones
  Denormal    ///< 1e-42 everywhere
};

float Noise(std::uint32_t x, std::uint32_t y, std::uint32_t c)
{
  std::uint32_t h = x * 0x9e3779b9u ^ y * 0x85ebca6bu ^ c * 0xc2b2ae35u;
  h ^= h >> 16;
  h *= 0x7feb352du;
  h ^= h >> 15;
  h *= 0x846ca68bu;
  h ^= h >> 16;
  return float(h >> 8) * 0x1p-24f;
}

/// A tilted plane with a step in depth, a second object and a corner of background.
class vtkQuellContractSource : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellContractSource);
  int Width = 17, Height = 13;
  Content What = Content::Plain;

protected:
  vtkQuellContractSource() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    w = this->Width;
    h = this->Height;
  }
  void Execute(quell::StageFrame& frame) override
  {
    const quell::Rect r = frame.Region();
    for (const std::string& name : frame.WantedArrays())
    {
      const quell::ImageOut out = frame.Output(name);
      if (!out)
        continue;
      const quell::ArrayType* type = quell::FindArray(name);
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
        {
          const bool background = x + y > this->Width + this->Height - 8 && this->Width > 8;
          for (int c = 0; c < out.components; ++c)
            out.at(x, y)[c] = background ? type->Background : this->Pixel(type->Kind, x, y, c);
        }
    }
  }

private:
  float Pixel(quell::ArrayKind kind, int x, int y, int c) const
  {
    const bool second = x > this->Width / 2;
    switch (kind)
    {
      case quell::ArrayKind::Color:
        if (this->What == Content::Zero)
          return 0;
        if (this->What == Content::Huge)
          return 1e30f;
        if (this->What == Content::Denormal)
          return 1e-42f;
        if (this->What == Content::Peak && x / 2 == this->Width / 6 && y / 2 == this->Height / 6)
          return 3e38f;
        if (x == this->Width / 3 && y == this->Height / 3)
        {
          if (this->What == Content::NotANumber)
            return std::nanf("");
          if (this->What == Content::Infinite)
            return std::numeric_limits<float>::infinity();
        }
        return 4 * Noise(x, y, c) * Noise(x, y, c + 7);
      case quell::ArrayKind::Albedo:
        return second && c == 1 ? 0.f : 0.2f + 0.6f * Noise(x / 4, y / 4, c);
      case quell::ArrayKind::Normal:
        return c == 2 ? (second ? 0.8f : 1.f) : c == 0 && second ? 0.6f : 0.f;
      case quell::ArrayKind::Position:
        return c == 0 ? 0.1f * x : c == 1 ? 0.1f * y : second ? -1.f : 0.f;
      case quell::ArrayKind::Depth:
        return (second ? 5.f : 3.f) + 0.01f * x;
      case quell::ArrayKind::Motion:
        return c == 0 ? 0.3f : -0.2f;
      case quell::ArrayKind::Id:
        return second ? 2.f : 1.f;
      case quell::ArrayKind::Variance:
        return 0.1f;
      case quell::ArrayKind::Moments:
        return c == 0 ? 0.5f : 0.1f;
      case quell::ArrayKind::History:
        return float(1 + x % 6);
      case quell::ArrayKind::Display:
        return Noise(x, y, c);
      default:
        return Noise(x, y, c);
    }
  }
};
vtkStandardNewMacro(vtkQuellContractSource);
QUELL_STAGE_DESCRIPTION(vtkQuellContractSource)
void vtkQuellContractSource::Describe(quell::StageDescription& d)
{
  for (const quell::ArrayType& a : quell::KnownArrays())
    d.Output(a.Name, a.Kind, a.Doc);
}

std::string ArrayFor(quell::ArrayKind kind)
{
  switch (kind)
  {
    case quell::ArrayKind::Scalar:
      return "roughness";
    case quell::ArrayKind::Any:
    case quell::ArrayKind::Color:
      return "radiance";
    default:
      for (const quell::ArrayType& a : quell::KnownArrays())
        if (a.Kind == kind)
          return a.Name;
  }
  return "radiance";
}

using Pixels = std::map<std::string, std::vector<float>>;

/// One stage with every input connected to a contract source; delayed inputs read the same source as their past.
struct Bench
{
  vtkNew<vtkQuellContractSource> source, past;
  vtkSmartPointer<vtkQuellStage> stage;
  vtkNew<vtkQuellCollector> sink;
  quell::ArraySet outputs;

  Bench(const std::string& type, int width, int height, Content what)
  {
    source->Width = past->Width = width;
    source->Height = past->Height = height;
    source->What = past->What = what;
    stage = Registry().Create(type);
    const quell::StageDescription& d = stage->GetDescription();
    quell::ArraySet pastArrays;
    for (const quell::InputPort& port : d.Inputs)
      if (port.Delayed)
        pastArrays.insert(ArrayFor(port.Kind));
    if (!pastArrays.empty())
    {
      past->SetAlwaysMake(pastArrays);
      past->Update();
    }
    for (size_t p = 0; p < d.Inputs.size(); ++p)
    {
      if (d.Inputs[p].Delayed)
      {
        stage->SetHistory(int(p), past->GetOutput());
        stage->SetInputArray(int(p), 0, ArrayFor(d.Inputs[p].Kind));
      }
      else
        stage->ConnectInput(d.Inputs[p].Name, source, ArrayFor(d.Inputs[p].Kind));
    }
    for (const quell::OutputArray& o : d.Outputs)
      outputs.insert(o.Name);
  }

  bool Run(const quell::Rect& region = quell::Rect())
  {
    sink->ClearRequests();
    sink->AddRequest(stage, outputs, region);
    return sink->UpdateTick(0);
  }
  Pixels Read(const quell::Rect& region)
  {
    Pixels pixels;
    vtkImageData* image = stage->GetOutput();
    for (const std::string& name : outputs)
    {
      auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name.c_str()));
      if (!array)
        continue;
      const int* e = image->GetExtent();
      const int n = array->GetNumberOfComponents();
      for (int y = region.y0; y < region.y1; ++y)
        for (int x = region.x0; x < region.x1; ++x)
          for (int c = 0; c < n; ++c)
            pixels[name].push_back(array->GetValue((vtkIdType(y - e[2]) * (e[1] - e[0] + 1) + x - e[0]) * n + c));
    }
    return pixels;
  }
};

bool SameBits(const Pixels& a, const Pixels& b, std::string& where)
{
  for (const auto& entry : a)
  {
    const auto other = b.find(entry.first);
    if (other == b.end() || other->second.size() != entry.second.size() ||
        std::memcmp(other->second.data(), entry.second.data(), entry.second.size() * 4) != 0)
    {
      where = entry.first;
      return false;
    }
  }
  return a.size() == b.size();
}

class StageContract : public testing::TestWithParam<std::string>
{
protected:
  void SetUp() override { vtkObject::SetGlobalWarningDisplay(0); }
  void TearDown() override { vtkObject::SetGlobalWarningDisplay(1); }
  bool IsFilter() const
  {
    const quell::StageDescription* d = Registry().Describe(this->GetParam());
    return !d->Inputs.empty() && !d->Outputs.empty();
  }
};

std::vector<std::string> AllTypes()
{
  return Registry().Types();
}
}

TEST_P(StageContract, TableIsComplete)
{
  const quell::StageDescription& d = *Registry().Describe(this->GetParam());
  EXPECT_EQ(d.Type, this->GetParam());
  EXPECT_FALSE(d.Category.empty());
  EXPECT_GT(d.Brief.size(), 10u);
  EXPECT_GT(d.Details.size(), 20u) << "formula, border rule, NaN rule, source";
  std::set<std::string> names;
  for (const quell::InputPort& p : d.Inputs)
  {
    EXPECT_TRUE(names.insert(p.Name).second) << p.Name;
    EXPECT_FALSE(p.Doc.empty()) << p.Name;
  }
  EXPECT_TRUE(d.Inputs.empty() || !d.Inputs[0].Delayed) << "port 0 carries size and time: it is live";
  names.clear();
  for (const quell::OutputArray& o : d.Outputs)
  {
    EXPECT_TRUE(names.insert(o.Name).second) << o.Name;
    EXPECT_FALSE(o.Doc.empty()) << o.Name;
    EXPECT_GT(o.Components, 0) << o.Name;
    const quell::ArrayType* known = quell::FindArray(o.Name);
    EXPECT_TRUE(!known || known->Components == o.Components) << o.Name;
  }
}

TEST_P(StageContract, PropertiesKeepTheirWord)
{
  vtkSmartPointer<vtkQuellStage> stage = Registry().Create(this->GetParam());
  std::ostringstream printed;
  stage->PrintSelf(printed, vtkIndent());
  std::set<std::string> names;
  for (const quell::Property& p : stage->GetDescription().Properties)
  {
    SCOPED_TRACE(p.Name);
    EXPECT_TRUE(names.insert(p.Name).second);
    EXPECT_FALSE(p.Doc.empty());
    EXPECT_NE(printed.str().find(p.Name + ":"), std::string::npos);
    std::string error;
    const std::string before = p.GetText(stage);
    EXPECT_EQ(before, p.DefaultText);
    const vtkMTimeType time = stage->GetMTime();
    EXPECT_TRUE(p.SetText(stage, before, error)) << "the default is inside its range: " << error;
    EXPECT_EQ(stage->GetMTime(), time) << "setting the same value again changes nothing";
    if (p.Kind == quell::Property::Type::String || p.Kind == quell::Property::Type::Path)
      continue;
    for (const char* bad : { "nan", "inf", "-inf", "1e999", "x", "" })
      EXPECT_FALSE(p.SetText(stage, bad, error)) << bad;
    EXPECT_EQ(stage->GetMTime(), time);
    if (p.Kind == quell::Property::Type::Int || p.Kind == quell::Property::Type::Double)
    {
      EXPECT_LT(p.Minimum, p.Maximum);
      EXPECT_FALSE(p.SetText(stage, quell::detail::FormatDouble(p.Minimum - 1), error)) << "below the range";
      const std::string top = p.Kind == quell::Property::Type::Int ? std::to_string((long long)p.Maximum)
                                                                   : quell::detail::FormatDouble(p.Maximum);
      EXPECT_TRUE(p.SetText(stage, top, error)) << error;
      EXPECT_EQ(p.GetText(stage), top);
    }
    for (const std::string& e : p.Enumerators)
    {
      EXPECT_TRUE(p.SetText(stage, e, error)) << error;
      EXPECT_EQ(p.GetText(stage), e);
    }
  }
}

TEST_P(StageContract, OddSizesAndASecondUpdate)
{
  if (!this->IsFilter())
    GTEST_SKIP() << "not a filter";
  const int sizes[][2] = { { 1, 1 }, { 1, 9 }, { 9, 1 }, { 17, 13 }, { 70, 66 } };
  for (const auto& size : sizes)
  {
    SCOPED_TRACE(std::to_string(size[0]) + "x" + std::to_string(size[1]));
    Bench bench(this->GetParam(), size[0], size[1], Content::Plain);
    ASSERT_TRUE(bench.Run()) << bench.stage->GetErrorText();
    const Pixels out = bench.Read({ 0, 0, size[0], size[1] });
    EXPECT_EQ(out.size(), bench.outputs.size());
    const auto executions = bench.stage->GetCounters().Executions;
    EXPECT_EQ(executions, 1);
    ASSERT_TRUE(bench.Run());
    EXPECT_EQ(bench.stage->GetCounters().Executions, executions) << "a second identical request executes nothing";
  }
}

TEST_P(StageContract, ExtremesStayFiniteAndDoNotSpread)
{
  if (!this->IsFilter())
    GTEST_SKIP() << "not a filter";
  for (Content what : { Content::Plain, Content::Zero, Content::NotANumber, Content::Infinite, Content::Huge,
         Content::Peak, Content::Denormal })
  {
    SCOPED_TRACE(int(what));
    Bench bench(this->GetParam(), 33, 29, what);
    const bool ran = bench.Run();
    if (Registry().Describe(this->GetParam())->Sink && !ran)
      continue; // a comparison may refuse a non-finite image, with a message
    ASSERT_TRUE(ran) << bench.stage->GetErrorText();
    const Pixels out = bench.Read({ 0, 0, 33, 29 });
    for (const auto& entry : out)
    {
      const quell::OutputArray* o = bench.stage->GetDescription().FindOutput(entry.first);
      if (o->Kind != quell::ArrayKind::Color && o->Kind != quell::ArrayKind::Albedo &&
          o->Kind != quell::ArrayKind::Display)
        continue;
      int bad = 0;
      for (float v : entry.second)
        bad += !std::isfinite(v);
      EXPECT_EQ(bad, 0) << entry.first;
    }
  }
}

TEST_P(StageContract, RegionEqualsCropBitForBit)
{
  if (!this->IsFilter())
    GTEST_SKIP() << "not a filter";
  Bench whole(this->GetParam(), 70, 66, Content::Plain);
  ASSERT_TRUE(whole.Run()) << whole.stage->GetErrorText();
  const quell::Rect regions[] = { { 0, 0, 1, 1 }, { 30, 20, 45, 41 }, { 66, 60, 70, 66 } };
  for (const quell::Rect& region : regions)
  {
    if (Registry().Describe(this->GetParam())->Sink)
      GTEST_SKIP() << "a comparison is of the whole frame";
    Bench part(this->GetParam(), 70, 66, Content::Plain);
    ASSERT_TRUE(part.Run(region)) << part.stage->GetErrorText();
    std::string where;
    EXPECT_TRUE(SameBits(whole.Read(region), part.Read(region), where)) << where << " in region " << region.x0;
  }
}

TEST_P(StageContract, SameBitsForAnyNumberOfThreads)
{
  if (!this->IsFilter())
    GTEST_SKIP() << "not a filter";
  Pixels first;
  for (int threads : { 1, 2, 3, 7 })
  {
    Bench bench(this->GetParam(), 150, 140, Content::Plain);
    bool ok = false;
    vtkSMPTools::LocalScope(vtkSMPTools::Config{ threads }, [&] { ok = bench.Run(); });
    ASSERT_TRUE(ok) << bench.stage->GetErrorText();
    const Pixels out = bench.Read({ 0, 0, 150, 140 });
    std::string where;
    if (first.empty())
      first = out;
    EXPECT_TRUE(SameBits(first, out, where)) << where << " with " << threads << " threads";
  }
}

INSTANTIATE_TEST_SUITE_P(All, StageContract, testing::ValuesIn(AllTypes()),
  [](const testing::TestParamInfo<std::string>& type) { return type.param; });
