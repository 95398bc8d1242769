// SPDX-License-Identifier: BSD-3-Clause
// What every stage owes, checked for each type in the registry: a complete table, honest properties, odd sizes,
// non-finite pixels, crops and thread counts. A new stage is tested here by being registered.
#include "Threads.h"
#include "StageBench.h"

#include <gtest/gtest.h>

#include <set>
#include <sstream>

namespace
{
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
    quelltest::WithThreads(threads, [&] { ok = bench.Run(); });
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
