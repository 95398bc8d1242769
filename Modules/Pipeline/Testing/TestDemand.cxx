// SPDX-License-Identifier: BSD-3-Clause
// Demand and history through the executor: what runs, on which region, with which arrays, and what the past is.
#include "PipelineTestStages.h"
#include "quellExplain.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"

#include <gtest/gtest.h>

using namespace quell;
using pipelinetest::CountersOf;
using pipelinetest::Load;
using pipelinetest::TheLog;

namespace
{
const std::string Temporal = R"xml(
  <time first="0" count="8"/>
  <node id="pt" type="TestSource"/>
  <node id="acc" type="TestAccumulate">
    <input port="radiance" from="pt:radiance"/>
    <input port="history" from="blur:radiance" delay="1"/>
  </node>
  <node id="blur" type="TestBox"><property name="Radius" value="2"/><input port="radiance" from="acc:radiance"/></node>
  <output name="beauty" from="blur:radiance" file="b.####.exr"/>)xml";

class Demand : public ::testing::Test
{
protected:
  void SetUp() override { TheLog() = pipelinetest::Log(); }
};
using History = Demand;
using Explain = Demand;

std::vector<float> Crop(const pipelinetest::Log::File& file, const std::string& layer, const Rect& r, int components)
{
  std::vector<float> out;
  const std::vector<float>& all = file.Layers.at(layer);
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x)
      for (int c = 0; c < components; ++c)
        out.push_back(
          all[std::size_t(((y - file.Region.y0) * file.Region.width() + x - file.Region.x0) * components + c)]);
  return out;
}
}

TEST_F(Demand, SeveralOutputsRunTheSourceOnce)
{
  const auto graph = Load(R"xml(
    <node id="pt" type="TestSource"/>
    <node id="blur" type="TestBox"><input port="radiance" from="pt:radiance"/></node>
    <output name="a" from="pt:radiance" file="a.exr"/>
    <output name="b" from="blur:radiance" file="b.exr"/>
    <output name="c" from="pt:depth" file="c.exr"/>
    <output name="d" from="blur:albedo" file="d.exr"/>)xml");
  PipelineExecutor executor(graph, pipelinetest::Registry());
  const TickResult result = executor.RunTick(0);
  ASSERT_TRUE(result.Ok) << result.Error;
  EXPECT_EQ(result.Files, (std::vector<std::string>{ "a.exr", "b.exr", "c.exr", "d.exr" }));
  ASSERT_EQ(TheLog().SourceRuns.size(), 1u);
  // normal is read by nobody; albedo passes through the blur.
  EXPECT_EQ(TheLog().SourceRuns[0].second, (ArraySet{ "radiance", "depth", "albedo" }));
  EXPECT_EQ(CountersOf(executor, "pt").Bytes, 40 * 24 * 7 * 4);
}

TEST_F(Demand, ASecondIdenticalRequestExecutesNothing)
{
  const auto graph = Load(Temporal);
  PipelineExecutor executor(graph, pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  ASSERT_TRUE(executor.RunTick(1).Ok);
  executor.ResetCounters();
  const TickResult again = executor.RunTick(1);
  ASSERT_TRUE(again.Ok);
  EXPECT_TRUE(again.Files.empty());
  for (const NodeCounters& c : executor.Counters())
    EXPECT_EQ(c.Counters.Executions, 0) << c.Path;
}

TEST_F(Demand, TheRegionGrowsByTheHalo)
{
  const auto graph = Load(R"xml(
    <node id="pt" type="TestSource"/>
    <node id="b1" type="TestBox"><property name="Radius" value="2"/><input port="radiance" from="pt:radiance"/></node>
    <node id="b2" type="TestBox"><property name="Radius" value="3"/><input port="radiance" from="b1:radiance"/></node>
    <output name="beauty" from="b2:radiance" file="b.exr"/>)xml");
  PipelineExecutor executor(graph, pipelinetest::Registry());
  executor.SetRegion(DisplayRegion{ 10, 8, 20, 14 });
  ASSERT_TRUE(executor.RunTick(0).Ok);
  // 24 rows: display rows 8 to 14 are rows 10 to 16 from the bottom.
  EXPECT_EQ(TheLog().Files.at(0).Region, (Rect{ 10, 10, 20, 16 }));
  EXPECT_EQ(CountersOf(executor, "b2").Pixels, 10 * 6);
  EXPECT_EQ(CountersOf(executor, "b1").Pixels, 16 * 12);
  EXPECT_EQ(CountersOf(executor, "pt").Pixels, 20 * 16);

  executor.ResetCounters();
  executor.SetRegion(DisplayRegion{ 0, 0, 4, 4 }); // the halo is clipped at the frame's corner
  ASSERT_TRUE(executor.RunTick(0).Ok);
  EXPECT_EQ(CountersOf(executor, "b1").Pixels, 7 * 7);
  EXPECT_EQ(CountersOf(executor, "pt").Pixels, 9 * 9);
}

TEST_F(Demand, ARegionEqualsTheCropOfTheWholeFrameWithFeedbackToo)
{
  PipelineExecutor whole(Load(Temporal), pipelinetest::Registry());
  for (int t = 0; t < 4; ++t)
    ASSERT_TRUE(whole.RunTick(t).Ok);
  const std::vector<pipelinetest::Log::File> full = TheLog().Files;
  TheLog().Files.clear();
  PipelineExecutor part(Load(Temporal), pipelinetest::Registry());
  part.SetRegion(DisplayRegion{ 30, 2, 40, 9 });
  for (int t = 0; t < 4; ++t)
    ASSERT_TRUE(part.RunTick(t).Ok);
  ASSERT_EQ(TheLog().Files.size(), 4u);
  for (int t = 0; t < 4; ++t)
  {
    const auto& file = TheLog().Files[std::size_t(t)];
    EXPECT_EQ(file.Region, (Rect{ 30, 15, 40, 22 }));
    EXPECT_EQ(file.Layers.at("radiance"), Crop(full[std::size_t(t)], "radiance", file.Region, 3)) << "tick " << t;
  }
  // What the next frame reads covers the whole frame.
  EXPECT_EQ(CountersOf(part, "blur").Pixels, 4 * 40 * 24);
}

TEST_F(Demand, AnInputThatIsNotNeededAsksForNothing)
{
  const std::string body = R"xml(
    <node id="pt" type="TestSource"/>
    <node id="blur" type="TestBox"><input port="radiance" from="pt:radiance"/><input port="normal" from="pt:normal"/></node>)xml";
  PipelineExecutor without(
    Load(body + "<output name=\"b\" from=\"blur:radiance\" file=\"b.exr\"/>"), pipelinetest::Registry());
  ASSERT_TRUE(without.RunTick(0).Ok);
  EXPECT_EQ(TheLog().SourceRuns.at(0).second, (ArraySet{ "radiance" }));
  PipelineExecutor with(
    Load(body + "<output name=\"m\" from=\"blur:mask\" file=\"m.exr\"/>"), pipelinetest::Registry());
  ASSERT_TRUE(with.RunTick(0).Ok);
  EXPECT_EQ(TheLog().SourceRuns.at(1).second, (ArraySet{ "normal", "radiance" }));
}

TEST_F(Demand, WhatNoOutputNeedsIsNotMade)
{
  const auto graph = Load(R"xml(
    <node id="pt" type="TestSource"/>
    <node id="acc" type="TestAccumulate">
      <input port="radiance" from="pt:radiance"/>
      <input port="history" from="slow:radiance" delay="1"/>
    </node>
    <node id="slow" type="TestBox"><input port="radiance" from="acc:radiance"/></node>
    <output name="raw" from="pt:radiance" file="raw.exr"/>
    <output name="filtered" from="acc:radiance"/>)xml");
  PipelineExecutor executor(graph, pipelinetest::Registry());
  // `slow` is kept only for `acc`, and `acc` feeds only an output that is not written.
  EXPECT_EQ(executor.GetStage("acc"), nullptr);
  EXPECT_EQ(executor.GetStage("slow"), nullptr);
  EXPECT_FALSE(executor.HasDelays());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  EXPECT_EQ(executor.Counters().size(), 2u);
  // Looking at it brings both back.
  ASSERT_TRUE(executor.Request("acc", { "radiance" }));
  EXPECT_TRUE(executor.HasDelays());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  EXPECT_EQ(CountersOf(executor, "slow").Executions, 1);
  ASSERT_NE(executor.GetImage("acc"), nullptr);
}

TEST_F(Demand, LayersAndViewsOfOutputs)
{
  const auto graph = Load(R"xml(
    <node id="pt" type="TestSource"/>
    <output name="aovs" file="a.exr" from="pt"><layer from="pt:albedo" name="al"/><layer from="pt:depth"/></output>
    <output name="shown" from="pt:radiance" file="s.png" view="plain" display="sRGB"/>)xml");
  PipelineExecutor executor(graph, pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  ASSERT_EQ(TheLog().Files.size(), 2u);
  const auto& aovs = TheLog().Files[TheLog().Files[0].Name == "a.exr" ? 0 : 1];
  const auto& shown = TheLog().Files[TheLog().Files[0].Name == "a.exr" ? 1 : 0];
  ASSERT_EQ(aovs.Layers.size(), 3u);
  EXPECT_EQ(aovs.Layers.at("al").at(0), pipelinetest::SourceValue(0, "albedo", 1, 0, 0, 0));
  EXPECT_EQ(aovs.Layers.at("depth").size(), 40u * 24u);
  EXPECT_EQ(shown.Layers.at("display").at(0), 0.25f * aovs.Layers.at("radiance").at(0));
  EXPECT_EQ(executor.GetStage("shown:view")->GetPropertyText("View"), "plain");
  EXPECT_EQ(executor.GetStage("shown:view")->GetPropertyText("Display"), "sRGB");
}

TEST_F(Demand, AFileWithoutNumberIsWrittenForTheLastFrameOnly)
{
  const auto graph = Load(R"xml(
    <time count="3"/>
    <node id="pt" type="TestSource"/>
    <output name="all" from="pt:radiance" file="a.####.exr"/>
    <output name="last" from="pt:depth" file="last.exr"/>)xml");
  PipelineExecutor executor(graph, pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0, TickMode::Frame).Ok);
  ASSERT_TRUE(executor.RunTick(1, TickMode::Frame).Ok);
  ASSERT_TRUE(executor.RunTick(2, TickMode::LastFrame).Ok);
  ASSERT_EQ(TheLog().Files.size(), 4u);
  EXPECT_EQ(TheLog().SourceRuns[0].second, (ArraySet{ "radiance" })); // depth is not traced for nothing
  EXPECT_EQ(TheLog().SourceRuns[2].second, (ArraySet{ "depth", "radiance" }));
}

TEST_F(Demand, TemplatesAreSeparateNodes)
{
  const auto graph = Load(R"xml(
    <template name="soft">
      <parameter name="radius" type="int" default="1"/>
      <port name="in" type="color"/>
      <node id="box" type="TestBox"><property name="Radius" value="$(radius)"/><input port="radiance" from="@in"/></node>
      <port name="out" from="box:radiance"/>
    </template>
    <template name="twice">
      <port name="in"/>
      <instance id="one" template="soft"><parameter name="radius" value="2"/><input port="in" from="@in"/></instance>
      <instance id="two" template="soft"><input port="in" from="one:out"/></instance>
      <port name="out" from="two:out"/>
    </template>
    <node id="pt" type="TestSource"/>
    <instance id="a" template="twice"><input port="in" from="pt:radiance"/></instance>
    <instance id="b" template="soft"><input port="in" from="pt:radiance"/></instance>
    <node id="sum" type="TestSum">
      <input port="radiance" from="a:out"/><input port="radiance" from="b"/><input port="radiance" from="a/one/box:radiance"/>
    </node>
    <output name="beauty" from="sum" file="s.exr"/>)xml",
    []
    {
      GraphOptions o;
      o.Properties = { { "b/box.Radius", "3" } };
      return o;
    }());
  ASSERT_GE(graph->Find("a/two/box"), 0);
  PipelineExecutor executor(graph, pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  EXPECT_EQ(executor.GetStage("a/one/box")->GetPropertyText("Radius"), "2");
  EXPECT_EQ(executor.GetStage("a/two/box")->GetPropertyText("Radius"), "1");
  EXPECT_EQ(executor.GetStage("b/box")->GetPropertyText("Radius"), "3");
  EXPECT_EQ(executor.GetStage("sum")->GetNumberOfInputConnections(0), 3);
  EXPECT_EQ(TheLog().SourceRuns.size(), 1u);
}

TEST_F(History, RerunningATickReadsTheSamePast)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  for (int t = 0; t < 3; ++t)
    ASSERT_TRUE(executor.RunTick(t).Ok);
  const std::vector<float> before = TheLog().Files.back().Layers.at("radiance");
  std::string error;
  ASSERT_TRUE(executor.SetProperty("blur", "Gain", "0.5", error)) << error;
  ASSERT_TRUE(executor.RunTick(2).Ok);
  EXPECT_NE(TheLog().Files.back().Layers.at("radiance"), before);
  ASSERT_TRUE(executor.SetProperty("blur", "Gain", "1", error));
  ASSERT_TRUE(executor.RunTick(2).Ok);
  EXPECT_EQ(TheLog().Files.back().Layers.at("radiance"), before);
  EXPECT_EQ(CountersOf(executor, "pt").Executions, 3); // a slider downstream does not trace again
}

TEST_F(History, AJumpHasNoPast)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  executor.Request("acc", { "history" });
  ASSERT_TRUE(executor.RunTick(0).Ok);
  EXPECT_EQ(
    *static_cast<float*>(executor.GetImage("acc")->GetPointData()->GetArray("history")->GetVoidPointer(0)), 0.f);
  ASSERT_TRUE(executor.RunTick(1).Ok);
  EXPECT_EQ(
    *static_cast<float*>(executor.GetImage("acc")->GetPointData()->GetArray("history")->GetVoidPointer(0)), 1.f);
  ASSERT_TRUE(executor.RunTick(5).Ok);
  EXPECT_EQ(
    *static_cast<float*>(executor.GetImage("acc")->GetPointData()->GetArray("history")->GetVoidPointer(0)), 0.f);
}

TEST_F(History, StepsBackWithinThreeTicks)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  for (int t = 0; t < 4; ++t)
    ASSERT_TRUE(executor.RunTick(t).Ok);
  const auto third = TheLog().Files.at(2).Layers;
  ASSERT_TRUE(executor.RunTick(2).Ok);
  EXPECT_EQ(TheLog().Files.back().Name, "b.0002.exr");
  EXPECT_EQ(TheLog().Files.back().Layers, third);
}

TEST_F(History, AFailedFrameLeavesTheLastState)
{
  PipelineExecutor reference(Load(Temporal), pipelinetest::Registry());
  for (int t = 0; t < 3; ++t)
    ASSERT_TRUE(reference.RunTick(t).Ok);
  const auto expected = TheLog().Files.back().Layers;

  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  ASSERT_TRUE(executor.RunTick(1).Ok);
  TheLog().FailAtTick = 2;
  const std::size_t files = TheLog().Files.size();
  const TickResult failed = executor.RunTick(2);
  EXPECT_FALSE(failed.Ok);
  EXPECT_FALSE(failed.Cancelled);
  EXPECT_EQ(failed.Error, "node \"pt\" (TestSource): the source broke");
  EXPECT_EQ(TheLog().Files.size(), files);
  EXPECT_EQ(executor.GetHistory().FindFrame(2), nullptr);
  TheLog().FailAtTick = -1;
  ASSERT_TRUE(executor.RunTick(2).Ok);
  EXPECT_EQ(TheLog().Files.back().Layers, expected);
}

TEST_F(History, AFailureEndsTheFrameAtOnce)
{
  // Ten diamonds in a row: a thousand paths lead to the source.
  std::string body = "<node id=\"n0\" type=\"TestSource\"/>";
  for (int i = 1; i <= 10; ++i)
  {
    const std::string before = "<input port=\"radiance\" from=\"n" + std::to_string(i - 1) + ":radiance\"/>";
    body += "<node id=\"n" + std::to_string(i) + "\" type=\"TestSum\">" + before + before + "</node>";
  }
  PipelineExecutor executor(Load(body + "<output name=\"o\" from=\"n10\" file=\"o.exr\"/>"), pipelinetest::Registry());
  TheLog().FailAtTick = 0;
  const TickResult failed = executor.RunTick(0);
  EXPECT_FALSE(failed.Ok);
  EXPECT_FALSE(failed.Cancelled);
  EXPECT_EQ(failed.Error, "node \"n0\" (TestSource): the source broke");
  EXPECT_EQ(TheLog().SourceRuns.size(), 1u);
  TheLog().FailAtTick = -1;
  EXPECT_TRUE(executor.RunTick(0).Ok);
}

TEST_F(History, ACancelledFrameLeavesTheLastState)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  auto token = std::make_shared<CancelToken>();
  executor.SetCancelToken(token);
  ASSERT_TRUE(executor.RunTick(0).Ok);
  TheLog().CancelAtTick = 1;
  TheLog().Token = token;
  const TickResult cancelled = executor.RunTick(1);
  EXPECT_FALSE(cancelled.Ok);
  EXPECT_TRUE(cancelled.Cancelled);
  EXPECT_EQ(TheLog().Files.size(), 1u);
  EXPECT_EQ(executor.GetHistory().FindFrame(1), nullptr);
  EXPECT_NE(executor.GetHistory().FindFrame(0), nullptr);
  token->Reset();
  TheLog().CancelAtTick = -1;
  const TickResult again = executor.RunTick(1);
  EXPECT_TRUE(again.Ok) << again.Error;
  EXPECT_EQ(TheLog().Files.size(), 2u);
}

TEST_F(History, WarmUpMakesOnlyThePast)
{
  PipelineExecutor reference(Load(Temporal), pipelinetest::Registry());
  for (int t = 0; t < 3; ++t)
    ASSERT_TRUE(reference.RunTick(t).Ok);
  const auto expected = TheLog().Files.back().Layers;
  TheLog().Files.clear();
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  EXPECT_EQ(PlanHistory(executor, 2).Frames, 2);
  ASSERT_TRUE(executor.RunTick(0, TickMode::WarmUp).Ok);
  ASSERT_TRUE(executor.RunTick(1, TickMode::WarmUp).Ok);
  EXPECT_TRUE(TheLog().Files.empty());
  ASSERT_TRUE(executor.RunTick(2).Ok);
  EXPECT_EQ(TheLog().Files.at(0).Layers, expected);
}

TEST_F(Explain, ThePlanIsWhatRuns)
{
  const auto graph = Load(Temporal + "<output name=\"n\" from=\"pt:normal\"/>");
  PipelineExecutor executor(graph, pipelinetest::Registry());
  const DisplayRegion region{ 4, 4, 12, 9 };
  executor.SetRegion(region);
  const ExecutionPlan plan = MakePlan(executor, region, 0, 1);
  EXPECT_EQ(plan.Error, "");
  EXPECT_TRUE(TheLog().SourceRuns.empty()) << "explaining executed something";
  ASSERT_TRUE(executor.RunTick(0).Ok);
  for (const PlannedNode& n : plan.Nodes)
  {
    const StageCounters counters = CountersOf(executor, n.Path);
    EXPECT_EQ(counters.Executions, n.Executes ? 1 : 0) << n.Path;
    EXPECT_EQ(counters.Pixels, n.Executes ? n.Region.area() : 0) << n.Path;
    EXPECT_EQ(double(counters.Bytes), n.Bytes) << n.Path;
  }
  EXPECT_EQ(plan.Nodes.front().Makes, (std::vector<std::string>{ "radiance" }));
  EXPECT_EQ(PlanText(plan), "t.xml: frame 0, 40 x 24 pixels\n"
                            "outputs:\n"
                            "  beauty = blur:radiance -> b.####.exr\n"
                            "  n = pt:normal (no file: not written)\n"
                            "plan:\n"
                            "  pt (TestSource) region 0,0,40,24\n"
                            "    makes radiance (11.5 kB)\n"
                            "    not made, nobody reads it: albedo, normal, depth\n"
                            "  acc (TestAccumulate) region 0,0,40,24\n"
                            "    radiance <- pt:radiance\n"
                            "    history <- blur:radiance of the previous frame\n"
                            "    makes radiance (11.5 kB)\n"
                            "    not made, nobody reads it: history\n"
                            "  blur (TestBox) region 0,0,40,24\n"
                            "    set: Radius=2\n"
                            "    radiance <- acc:radiance, halo 2\n"
                            "    makes radiance (11.5 kB)\n"
                            "    keeps radiance for the next frame: runs on the whole frame\n"
                            "    not made, nobody reads it: mask\n"
                            "  beauty:write (ImageWriter) region 4,4,12,9\n"
                            "    set: File=b.####.exr\n"
                            "    layer <- blur:radiance\n"
                            "cost of a frame: 4 stages, 2920 stage pixels, 34.6 kB of arrays\n"
                            "memory: about 170.0 MB, scenes not counted: 46.1 kB of arrays with what is kept of the frame "
                            "before, 0 B of scratch, 170.0 MB the program\n");
  EXPECT_NE(
    PlanDot(plan).find("\"blur\" -> \"acc\" [label=\"radiance\", style=dashed, constraint=false];"), std::string::npos);
}

TEST_F(Explain, CostsAreWhatWasMeasured)
{
  const auto graph = Load(Temporal);
  PipelineExecutor executor(graph, pipelinetest::Registry());
  CostModel model = CostModel::BuiltIn();
  const vtkQuellStage* blur = executor.GetStage("blur");
  ASSERT_NE(blur, nullptr);
  EXPECT_FALSE(model.IsOfThisMachine(*blur, "TestBox"));
  const auto builtIn = model.Nanoseconds();
  EXPECT_LT(model.Seconds(*blur, "TestBox", 1000, 1), 0) << "nobody measured it";
  // Twice 2 us on one thread and once 30 us on two: the median counts, in thread time.
  model.Measure(*blur, "TestBox", 1000, 1, 2e-6);
  model.Measure(*blur, "TestBox", 500, 2, 30e-6);
  model.Measure(*blur, "TestBox", 2000, 1, 4e-6);
  EXPECT_LT(model.Seconds(*blur, "TestBox", 1000, 1), 0) << "not settled yet";
  EXPECT_EQ(model.Settle(), 1);
  EXPECT_TRUE(model.IsOfThisMachine(*blur, "TestBox"));
  EXPECT_FALSE(model.IsOfThisMachine(*blur, "ATrousFilter")) << "that was not measured";
  EXPECT_NEAR(model.Seconds(*blur, "TestBox", 4000, 1), 8e-6, 1e-12);
  EXPECT_NEAR(model.Seconds(*blur, "TestBox", 4000, 2), 4e-6, 1e-12);
  // Kept and read again.
  const std::string file = ::testing::TempDir() + "quell-costs/costs.json";
  model.Save(file);
  std::string problem;
  const CostModel again = CostModel::Load(file, problem);
  EXPECT_EQ(problem, "");
  EXPECT_TRUE(again.IsOfThisMachine(*blur, "TestBox"));
  EXPECT_FALSE(again.IsOfThisMachine(*blur, "ATrousFilter"));
  EXPECT_EQ(again.Nanoseconds().size(), builtIn.size() + 1);
  EXPECT_EQ(again.Nanoseconds(), model.Nanoseconds());

  ExecutionPlan plan = MakePlan(executor, {}, 0, 1);
  EstimateCosts(plan, executor, again, 1);
  int unknown = 0;
  const double seconds = PlanSeconds(plan, unknown);
  EXPECT_NEAR(seconds, 40 * 24 * 2e-9, 1e-12);
  EXPECT_EQ(unknown,
    int(std::count_if(plan.Nodes.begin(), plan.Nodes.end(), [](const PlannedNode& n) { return n.Executes; })) - 1);
  const std::string text = PlanText(plan);
  EXPECT_NE(text.find("    makes radiance (11.5 kB, about 1.9 us)\n"), std::string::npos) << text;
  EXPECT_NE(text.find("time: about 1.9 us a frame with 1 thread (without reading the scene; 3 nodes not known)\n"),
    std::string::npos)
    << text;
}

TEST_F(Explain, ARegionOutsideTheFrameIsRefused)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  std::string error;
  executor.SetRegion(DisplayRegion{ 0, 0, 41, 5 });
  EXPECT_FALSE(executor.CheckRegion(error));
  EXPECT_EQ(error, "the region 0,0,41,5 does not lie in the frame of 40 x 24 pixels");
  executor.SetRegion(DisplayRegion{ 0, 0, 40, 24 });
  EXPECT_TRUE(executor.CheckRegion(error));
}
