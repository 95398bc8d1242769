// SPDX-License-Identifier: BSD-3-Clause
// A sweep over stages whose errors and times are known: a source of noise of known variance, filters of known bias.
#include "quellCancelToken.h"
#include "quellImageFile.h"
#include "quellLeaveOut.h"
#include "quellPipelineReader.h"
#include "quellStageRegistry.h"
#include "quellTradeoff.h"
#include "quellTradeoffReport.h"
#include "vtkQuellStage.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <unistd.h>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
constexpr int Side = 64;

/// 1 + Amplitude * a value of mean 0 and variance 1 that depends on pixel, seed and tick.
class vtkQuellNoise : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellNoise);
  vtkSetClampMacro(Seed, int, 0, 1 << 30);
  vtkGetMacro(Seed, int);
  vtkSetClampMacro(Amplitude, double, 0., 10.);
  vtkGetMacro(Amplitude, double);
  static int Made;

protected:
  vtkQuellNoise() { this->InitializePorts(); }
  void DescribeSource(int& width, int& height) override { width = height = Side; }
  void Execute(StageFrame& frame) override
  {
    ++Made;
    const ImageOut out = frame.Output("radiance");
    const Rect r = frame.Region();
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        for (int c = 0; c < 3; ++c)
        {
          std::uint32_t h = std::uint32_t(x + Side * (y + Side * c)) * 2654435761u +
                            std::uint32_t(this->Seed) * 40503u * 977u + std::uint32_t(frame.Tick()) * 69069u;
          for (int k = 0; k < 3; ++k)
          {
            h ^= h >> 15;
            h *= 2246822519u;
            h ^= h >> 13;
            h *= 3266489917u;
          }
          out.at(x, y)[c] = float(1 + this->Amplitude * (h & 1u << 20 ? 1 : -1));
        }
  }
  int Seed = 0;
  double Amplitude = 0.5;
};
int vtkQuellNoise::Made = 0;
vtkStandardNewMacro(vtkQuellNoise);
QUELL_STAGE_DESCRIPTION(vtkQuellNoise)
void vtkQuellNoise::Describe(StageDescription& d)
{
  using Self = vtkQuellNoise;
  d.Category = "Test";
  d.Brief = "Noise.";
  d.Output("radiance", ArrayKind::Color, "noise");
  QUELL_INT(d, Seed, "", "Seed.");
  QUELL_DOUBLE(d, Amplitude, "", "Amplitude.");
}

/// Offset + Keep * (input - 1) + 1: variance goes with Keep squared, the bias is Offset.
class vtkQuellShrink : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellShrink);
  vtkSetClampMacro(Keep, double, 0., 1.);
  vtkGetMacro(Keep, double);
  vtkSetClampMacro(Offset, double, -1., 1.);
  vtkGetMacro(Offset, double);

protected:
  vtkQuellShrink() { this->InitializePorts(); }
  void ExecuteTile(const StageFrame& frame, const Rect& tile) const override
  {
    const ImageIn in = frame.Input(0);
    const ImageOut out = frame.Output("radiance");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        for (int c = 0; c < 3; ++c)
          out.at(x, y)[c] = float(1 + this->Offset + this->Keep * (double(in.at(x, y)[c]) - 1));
  }
  double Keep = 0.5, Offset = 0;
};
vtkStandardNewMacro(vtkQuellShrink);
QUELL_STAGE_DESCRIPTION(vtkQuellShrink)
void vtkQuellShrink::Describe(StageDescription& d)
{
  using Self = vtkQuellShrink;
  d.Category = "Test";
  d.Brief = "Shrinks.";
  d.Input("radiance", ArrayKind::Color, "radiance", "noise");
  d.Output("radiance", ArrayKind::Color, "less of it");
  QUELL_DOUBLE(d, Keep, "", "Keep.");
  QUELL_DOUBLE(d, Offset, "", "Offset.");
}

const StageRegistry& Registry()
{
  static const StageRegistry registry = []
  {
    StageRegistry r;
    r.Add<vtkQuellNoise>();
    r.Add<vtkQuellShrink>();
    return r;
  }();
  return registry;
}

class Sweeps : public ::testing::Test
{
protected:
  void SetUp() override
  {
    static int counter = 0;
    this->Directory = testing::TempDir() + "quellTradeoff" + std::to_string(getpid()) + "_" + std::to_string(counter++);
    fs::create_directories(this->Directory);
    vtkNew<vtkImageData> image;
    image->SetExtent(0, Side - 1, 0, Side - 1, 0, 0);
    vtkNew<vtkFloatArray> ones;
    ones->SetName("radiance");
    ones->SetNumberOfComponents(3);
    ones->SetNumberOfTuples(Side * Side);
    ones->Fill(1);
    image->GetPointData()->AddArray(ones);
    WriteImageFile(this->Directory + "/reference.exr", image);
    vtkQuellNoise::Made = 0;
  }
  void TearDown() override { fs::remove_all(this->Directory); }

  TradeoffOptions Options(const std::vector<std::string>& vary, const std::string& body = Chain)
  {
    Diagnostics messages;
    TradeoffOptions o;
    o.Document = ReadPipelineText("<pipeline version=\"1\">" + body + "</pipeline>", "t.xml", messages);
    EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
    for (const std::string& v : vary)
      o.Axes.push_back(ParseVary(v));
    o.Reference = this->Directory + "/reference.exr";
    o.Directory = this->Directory + "/out";
    o.Metrics = { "relMSE" };
    return o;
  }
  static TradeoffReport Run(const TradeoffOptions& o) { return Tradeoff(Registry(), o).Run(); }
  static std::string Refusal(const TradeoffOptions& o)
  {
    try
    {
      Run(o);
    }
    catch (const StageError& e)
    {
      return e.what();
    }
    return "";
  }

  static constexpr const char* Chain = R"xml(
    <variable name="keep" type="double" default="0.5"/>
    <node id="noise" type="Noise"/>
    <node id="first" type="Shrink"><input port="radiance" from="noise:radiance"/><property name="Keep" value="$(keep)"/></node>
    <node id="second" type="Shrink"><input port="radiance" from="first:radiance"/><property name="Offset" value="0.1"/></node>
    <output name="o" from="second:radiance"/>)xml";
  std::string Directory;
};
}

TEST_F(Sweeps, ErrorsBiasAndVarianceAreThoseOfTheClosedForm)
{
  TradeoffOptions o = this->Options({ "second.Keep=1,0.5,0.25", "second.Offset=0,0.2" });
  o.Seeds = 8;
  const TradeoffReport r = Run(o);
  ASSERT_EQ(r.Settings.size(), 6u);
  for (const SettingResult& s : r.Settings)
  {
    SCOPED_TRACE(ChoiceText(s.Choice));
    EXPECT_EQ(s.Error, "");
    EXPECT_EQ(s.Runs, 8);
    // values are 1 + offset +- a: the relative error is that over 1.01
    const double keep = std::stod(s.Choice[0].second), offset = std::stod(s.Choice[1].second), a = 0.5 * 0.5 * keep;
    EXPECT_NEAR(s.Metrics.at("relMSE").Mean, (offset * offset + a * a) / 1.01, 6 * offset * a / Side / 1.01 + 1e-6);
    EXPECT_NEAR(s.Variance, a * a / 1.01, 0.02 * a * a) << "8 samples, 12288 values";
    EXPECT_NEAR(s.BiasSquared, offset * offset / 1.01, 0.02 * a * a + offset * a / Side + 1e-6);
    EXPECT_NEAR(s.BiasSquared + s.Variance, s.Metrics.at("relMSE").Mean, 1e-6) << "an identity";
    EXPECT_GT(s.Milliseconds.Middle, 0);
    EXPECT_LE(s.Milliseconds.Low, s.Milliseconds.Middle);
    EXPECT_LE(s.Milliseconds.Middle, s.Milliseconds.High);
  }
}

TEST_F(Sweeps, WhatASettingDoesNotTouchIsNotRunAgain)
{
  TradeoffOptions o = this->Options({ "second.Keep=1..0.1/10" });
  o.Seeds = 2;
  o.Repeats = 2;
  o.Ledger = false;
  Run(o);
  EXPECT_EQ(vtkQuellNoise::Made, 1 + 2) << "a warm-up and one for every seed, not for every setting";
}

TEST_F(Sweeps, TheLedgerSaysWhatANodeBought)
{
  TradeoffOptions o = this->Options({});
  const TradeoffReport r = Run(o);
  ASSERT_EQ(r.Settings.size(), 1u);
  ASSERT_EQ(r.Ledger.size(), 2u);
  EXPECT_EQ(r.NodeOrder, (std::vector<std::string>{ "noise", "first", "second" }));
  // +-.5 shrinks to .125 with offset .1; without the first to .25, without the second to .25 and no offset
  EXPECT_EQ(r.Ledger[0].Left, "first");
  EXPECT_EQ(r.Ledger[1].Left, "second");
  EXPECT_NEAR(r.Settings[0].Metrics.at("relMSE").Mean, (0.01 + 0.125 * 0.125) / 1.01, 2e-3);
  EXPECT_NEAR(r.Ledger[0].Metrics.at("relMSE").Mean, (0.01 + 0.0625) / 1.01, 3e-3);
  EXPECT_NEAR(r.Ledger[1].Metrics.at("relMSE").Mean, 0.0625 / 1.01, 1e-5);
}

TEST_F(Sweeps, NodesVariablesAndSeedsCanBeVaried)
{
  TradeoffOptions o = this->Options({ "second=on,off", "keep=1,0.5" });
  o.Ledger = false;
  o.Seeds = 2;
  const TradeoffReport r = Run(o);
  ASSERT_EQ(r.Settings.size(), 4u);
  EXPECT_NEAR(r.Settings[0].Metrics.at("relMSE").Mean, (0.01 + 0.0625) / 1.01, 3e-3); // on, 1
  EXPECT_NEAR(r.Settings[3].Metrics.at("relMSE").Mean, 0.0625 / 1.01, 1e-5);          // off, .5
  EXPECT_EQ(r.Settings[3].Nodes.count("second"), 0u);
}

TEST_F(Sweeps, PropertiesOfWhatIsLeftOutMakeNoSettings)
{
  TradeoffOptions o = this->Options({ "second.Keep=1,0.5,0.25", "second=on,off" });
  o.Ledger = false;
  o.Seeds = o.Repeats = 1;
  EXPECT_EQ(Run(o).Settings.size(), 4u) << "three with it, one without";
}

TEST_F(Sweeps, AnInterruptedSweepGoesOnToTheSameNumbers)
{
  const std::vector<std::string> vary{ "first.Keep=1,0.5,0.25" };
  TradeoffOptions o = this->Options(vary);
  const TradeoffReport whole = Run(o);
  o.Directory = this->Directory + "/parts";
  int runs = 0;
  for (int k = 0; k < 40; ++k)
  {
    // Two runs at a time.
    o.Token = std::make_shared<CancelToken>();
    const int until = runs + 2;
    o.Progress = [&, token = o.Token](int done, int, const std::string&)
    {
      if (done >= until)
        token->Finish();
      runs = std::max(runs, done);
    };
    const TradeoffReport part = Run(o);
    if (!o.Token->IsFinishing())
    {
      ASSERT_EQ(part.Settings.size(), whole.Settings.size());
      for (std::size_t i = 0; i < whole.Settings.size(); ++i)
      {
        EXPECT_EQ(part.Settings[i].Metrics.at("relMSE").Mean, whole.Settings[i].Metrics.at("relMSE").Mean) << i;
        EXPECT_EQ(part.Settings[i].Variance, whole.Settings[i].Variance) << i;
        EXPECT_EQ(part.Settings[i].Runs, 4);
      }
      ASSERT_EQ(part.Ledger.size(), whole.Ledger.size());
      EXPECT_GT(k, 5);
      return;
    }
  }
  FAIL() << "it never ends";
}

TEST_F(Sweeps, AnotherSweepIsNotMixedIn)
{
  TradeoffOptions o = this->Options({ "first.Keep=1,0.5" });
  o.Ledger = false;
  Run(o);
  o.Seeds = 3;
  EXPECT_NE(Refusal(o).find("holds another sweep"), std::string::npos);
  o.Seeds = 4;
  o.Repeats = 6; // more of the same is the same sweep
  EXPECT_EQ(Run(o).Settings[0].Runs, 6);
}

TEST_F(Sweeps, MistakesAreToldBeforeAnythingRuns)
{
  EXPECT_NE(Refusal(this->Options({ "first.Kep=1" })).find("did you mean \"Keep\""), std::string::npos);
  EXPECT_NE(Refusal(this->Options({ "frist.Keep=1" })).find("first"), std::string::npos);
  EXPECT_NE(Refusal(this->Options({ "first.Keep=0.5,7" })).find("7"), std::string::npos);
  EXPECT_NE(Refusal(this->Options({ "noise.Seed=1,2" })).find("the runs choose the seeds"), std::string::npos);
  EXPECT_NE(Refusal(this->Options({ "noise=on,off" })).find("no input to take its place"), std::string::npos);
  EXPECT_NE(Refusal(this->Options({ "secnd=on,off" })).find("second"), std::string::npos);
  TradeoffOptions o = this->Options({});
  o.Metrics = { "relMS" };
  EXPECT_NE(Refusal(o).find("relMSE"), std::string::npos);
  o = this->Options({});
  o.Output = "x";
  EXPECT_NE(Refusal(o).find("no output \"x\""), std::string::npos);
  o = this->Options({});
  o.Reference = this->Directory + "/none.exr";
  EXPECT_NE(Refusal(o).find("none.exr"), std::string::npos);
  EXPECT_EQ(vtkQuellNoise::Made, 0);
}

TEST(Choosing, BudgetAimAndPareto)
{
  std::vector<SettingResult> s(4);
  const double ms[] = { 10, 20, 40, 30 }, error[] = { .4, .2, .1, .3 };
  for (int i = 0; i < 4; ++i)
  {
    s[std::size_t(i)].Runs = 1;
    s[std::size_t(i)].Milliseconds.Middle = ms[i];
    s[std::size_t(i)].Metrics["relMSE"].Mean = error[i];
    s[std::size_t(i)].Metrics["SSIM"].Mean = 1 - error[i];
  }
  MarkPareto(s, "relMSE");
  EXPECT_TRUE(s[0].Pareto && s[1].Pareto && s[2].Pareto);
  EXPECT_FALSE(s[3].Pareto) << "slower and worse than the second";
  std::string text;
  EXPECT_EQ(ChooseSetting(s, "relMSE", 35, {}, text), 1);
  EXPECT_EQ(ChooseSetting(s, "relMSE", 5, {}, text), -1);
  EXPECT_NE(text.find("the fastest is as in the file with 10 ms"), std::string::npos) << text;
  EXPECT_EQ(ChooseSetting(s, "relMSE", 0, { { "relMSE", .25 } }, text), 1);
  EXPECT_EQ(ChooseSetting(s, "relMSE", 0, { { "SSIM", .85 } }, text), 2) << "higher is better";
  EXPECT_EQ(ChooseSetting(s, "relMSE", 0, { { "relMSE", .05 } }, text), -1);
  EXPECT_NE(text.find("no setting has relMSE <= 0.05; the nearest is as in the file with 0.1"), std::string::npos)
    << text;
  // twins: one of them stays
  s[3] = s[2];
  MarkPareto(s, "relMSE");
  EXPECT_EQ(int(s[2].Pareto) + int(s[3].Pareto), 1);
  // what failed is nobody's choice
  s[1].Error = "broken";
  EXPECT_EQ(ChooseSetting(s, "relMSE", 35, {}, text), 0);
}

TEST(Choosing, QuartilesAreLinearBetweenRanks)
{
  const Spread s = SpreadOf({ 4, 1, 3, 2, 5 });
  EXPECT_DOUBLE_EQ(s.Low, 2);
  EXPECT_DOUBLE_EQ(s.Middle, 3);
  EXPECT_DOUBLE_EQ(s.High, 4);
  EXPECT_DOUBLE_EQ(SpreadOf({ 1, 2 }).Middle, 1.5);
  EXPECT_DOUBLE_EQ(SpreadOf({}).Middle, 0);
}

TEST_F(Sweeps, ReportsHoldWhatWasMeasured)
{
  TradeoffOptions o = this->Options({ "second.Keep=1,0.5", "second.Offset=0,0.2" });
  o.Seeds = 2;
  o.Repeats = 2;
  o.Aim = { "relMSE", 0.06 };
  Tradeoff sweep(Registry(), o);
  const TradeoffReport r = sweep.Run();
  ASSERT_GE(r.Chosen, 0);
  const auto json = nlohmann::json::parse(TradeoffJson(r));
  EXPECT_EQ(json["settings"].size(), 4u);
  EXPECT_EQ(json["ledger"].size(), 2u);
  EXPECT_EQ(json["settings"][1]["choice"]["second.Offset"], "0.2");
  const std::string csv = TradeoffCsv(r);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + 4 + 2);
  EXPECT_EQ(csv.compare(0, 26, "second.Keep,second.Offset,"), 0) << csv;
  const std::string html = TradeoffHtml(r, o.Directory);
  for (const char* part :
    { "<svg", "What each node bought", "Bias and variance", "data:image/png;base64,", "best.xml" })
    EXPECT_NE(html.find(part), std::string::npos) << part;
  EXPECT_EQ(html.find("http"), std::string::npos) << "opens without a network";
  // the chosen pipeline, by itself, is the chosen setting
  Diagnostics messages;
  const std::string text = sweep.PipelineText(r.Settings[std::size_t(r.Chosen)].Choice);
  TradeoffOptions again = o;
  again.Document = ReadPipelineText(text, "best.xml", messages);
  again.Axes.clear();
  again.Aim.reset();
  again.Directory = this->Directory + "/again";
  EXPECT_EQ(
    Run(again).Settings[0].Metrics.at("relMSE").Mean, r.Settings[std::size_t(r.Chosen)].Metrics.at("relMSE").Mean)
    << text;
}
