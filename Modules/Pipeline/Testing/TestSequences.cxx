// SPDX-License-Identifier: BSD-3-Clause
// Runs that begin in the middle, go on later, or are made again from their own record.
#include "PipelineTestStages.h"
#include "quellCheckpoint.h"
#include "quellExplain.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellProvenance.h"
#include "vtkFieldData.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <unistd.h>

namespace fs = std::filesystem;
using namespace quell;
using pipelinetest::Load;
using pipelinetest::TheLog;

namespace
{
/// A folder of the test's own, gone afterwards.
class Sequences : public ::testing::Test
{
protected:
  void SetUp() override
  {
    TheLog() = pipelinetest::Log();
    const std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    this->Folder = fs::temp_directory_path() / ("quell-" + name + "-" + std::to_string(getpid()));
    fs::create_directories(this->Folder);
  }
  void TearDown() override { fs::remove_all(this->Folder); }
  std::string Write(const std::string& name, const std::string& text) const
  {
    const fs::path path = this->Folder / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << text;
    return path.string();
  }
  static std::string Read(const std::string& path)
  {
    std::ifstream stream(path, std::ios::binary);
    return { std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>() };
  }
  fs::path Folder;
};
using Provenance = Sequences;
using Checkpoints = Sequences;
using WarmUp = Sequences;

// Feedback, a producer read one frame later, and a second state.
const std::string Temporal = R"xml(
  <time first="0" count="8"/>
  <node id="pt" type="TestSource"><property name="Width" value="9"/><property name="Height" value="5"/></node>
  <node id="acc" type="TestAccumulate">
    <input port="radiance" from="pt:radiance"/>
    <input port="history" from="blur:radiance" delay="1"/>
  </node>
  <node id="blur" type="TestBox"><property name="Radius" value="2"/><input port="radiance" from="acc:radiance"/></node>
  <node id="mix" type="TestMix">
    <input port="radiance" from="blur:radiance"/>
    <input port="history" from="mix:radiance" delay="1"/>
  </node>
  <output name="beauty" from="mix:radiance" file="b.####.exr"/>)xml";

/// Writes the state after the ticks run.
Checkpoint After(PipelineExecutor& executor, int tick)
{
  Checkpoint c;
  c.Identity = IdentityOf(executor, {}, 0, "1");
  c.Tick = tick;
  if (const FrameHistory::Frame* frame = executor.GetHistory().FindFrame(tick))
  {
    c.Frame = *frame;
  }
  return c;
}
}

// ---- the record ---------------------------------------------------------------------------------------------------

TEST_F(Provenance, TheTextAloneMakesTheSameGraphFromElsewhere)
{
  this->Write("scenes/box.gltf", "box");
  this->Write("library/lamp.gltf", "lamp");
  this->Write("here/other.gltf", "other");
  this->Write("library/lib.xml", R"xml(<pipeline version="1">
    <variable name="lamp" type="path" default="lamp.gltf"/>
    <variable name="folder" type="string" default="."/>
    <variable name="radius" type="int" default="1"/>
    <variable name="unused" type="int" default="1"/>
    <template name="soft">
      <parameter name="r" type="int" default="$(radius)"/>
      <port name="in"/>
      <node id="box" type="TestBox"><property name="Radius" value="$(r)"/><input port="radiance" from="@in"/></node>
      <port name="out" from="box:radiance"/>
    </template>
    <template name="pair">
      <port name="in"/>
      <instance id="one" template="soft"><input port="in" from="@in"/></instance>
      <node id="light" type="TestSource"><property name="Scene" value="lamp.gltf"/></node>
      <instance id="two" template="soft"><input port="in" from="light:radiance"/></instance>
      <node id="add" type="TestSum"><input port="radiance" from="one:out"/><input port="radiance" from="two:out"/></node>
      <port name="out" from="add:radiance"/>
    </template>
    <template name="idle"><port name="in"/><port name="out" from="@in"/></template>
  </pipeline>)xml");
  const std::string file = this->Write("pipelines/p.xml", R"xml(<pipeline version="1">
    <include file="../library/lib.xml"/>
    <variable name="scene" type="path" default="../scenes/box.gltf"/>
    <variable name="seed" type="int" default="4"/>
    <variable name="size" type="int" default="16"/>
    <variable name="width" type="int" default="$(size)"/>
    <variable name="name" type="string" default="plain"/>
    <time count="$(size)"/>
    <node id="pt" type="TestSource">
      <property name="Scene" value="$(scene)"/><property name="Width" value="$(width)"/><property name="Seed" value="$(seed)"/>
    </node>
    <node id="lamp" type="TestSource"><property name="Scene" value="$(lamp)"/></node>
    <node id="string" type="TestSource"><property name="Scene" value="$(folder)/lamp.gltf"/></node>
    <instance id="a" template="pair"><input port="in" from="pt:radiance"/></instance>
    <instance id="b" template="pair"><input port="in" from="lamp:radiance"/></instance>
    <node id="sum" type="TestSum">
      <input port="radiance" from="a:out"/><input port="radiance" from="b:out"/><input port="radiance" from="string:radiance"/>
    </node>
    <output name="beauty" from="sum:radiance" file="out/$(name).####.exr"/>
    <output name="idle" from="pt:albedo"/>
  </pipeline>)xml");

  GraphOptions options;
  options.Defines = { { "size", "12" }, { "name", "a$(b) \"<&>\"" } };
  options.Properties = { { "a/one/box.Radius", "3" }, { "a/one/box.Quiet", "true" }, { "b/two/box.Gain", "0.5" },
    { "lamp.Scene", (this->Folder / "here/other.gltf").string() }, { "lamp.Seed", "9" } };
  options.Seed = 77;
  options.Outputs = { { "beauty", "x.####.exr" }, { "pt:depth", "d.exr" } };
  options.OutputDirectory = "elsewhere";
  Diagnostics messages;
  const auto graph = LoadPipeline(file, pipelinetest::Registry(), options, messages);
  ASSERT_TRUE(graph) << messages.ToText();

  Diagnostics none;
  const std::string text = WritePipelineText(*SelfContained(*graph, pipelinetest::Registry(), none));
  EXPECT_EQ(none.ToText(), "");
  const auto document = ReadPipelineText(text, "/somewhere/image.exr", none);
  GraphOptions plain;
  plain.OutputDirectory = "elsewhere";
  const auto again = BuildGraph(document, pipelinetest::Registry(), plain, none);
  EXPECT_EQ(none.ToText(), "") << text; // not even a warning

  EXPECT_EQ(again->Ticks.Count, 12);
  int compared = 0;
  for (const GraphNode& n : graph->Nodes)
  {
    const std::string path = n.Path == "pt:depth:write" ? "pt-depth:write" : n.Path;
    const int same = again->Find(path);
    ASSERT_GE(same, 0) << path << "\n" << text;
    const GraphNode& other = again->Nodes[std::size_t(same)];
    EXPECT_EQ(other.Type, n.Type);
    for (const Property& p : n.Description().Properties)
    {
      EXPECT_EQ(p.GetText(other.Stage), p.GetText(n.Stage)) << path << "." << p.Name;
      ++compared;
    }
    ASSERT_EQ(other.Inputs.size(), n.Inputs.size()) << path;
    for (std::size_t i = 0; i < n.Inputs.size(); ++i)
    {
      EXPECT_EQ(other.Inputs[i].Array, n.Inputs[i].Array);
      EXPECT_EQ(
        again->Nodes[std::size_t(other.Inputs[i].Producer)].Path, graph->Nodes[std::size_t(n.Inputs[i].Producer)].Path);
    }
  }
  EXPECT_EQ(again->Nodes.size(), graph->Nodes.size());
  EXPECT_GT(compared, 30);
  // What was said, not only what it led to.
  EXPECT_EQ(again->Nodes[std::size_t(again->Find("a/one/box"))].Stage->GetPropertyText("Radius"), "3");
  EXPECT_EQ(again->Nodes[std::size_t(again->Find("b/one/box"))].Stage->GetPropertyText("Radius"), "1");
  EXPECT_EQ(again->Nodes[std::size_t(again->Find("a/light"))].Stage->GetPropertyText("Seed"), "77");
  EXPECT_EQ(again->Nodes[std::size_t(again->Find("lamp"))].Stage->GetPropertyText("Seed"), "9");
  EXPECT_EQ(text.find("\"idle\" type"), std::string::npos);
  EXPECT_EQ(text.find("template name=\"idle\""), std::string::npos);
  EXPECT_EQ(text.find("unused"), std::string::npos);
  EXPECT_EQ(text.find("\"seed\""), std::string::npos) << "every Seed is written out: the variable would do nothing";
  // Size still steers width.
  EXPECT_NE(text.find("name=\"width\" type=\"int\" default=\"$(size)\""), std::string::npos) << text;

  // A record of a record is the record.
  EXPECT_EQ(WritePipelineText(*SelfContained(*again, pipelinetest::Registry(), none)), text);
}

TEST_F(Provenance, PropertiesOfOutputsReachWriterAndView)
{
  const std::string body = R"xml(<node id="pt" type="TestSource"/>
    <output name="shown" from="pt" file="s.png" view="plain"><property name="Gain" value="1"/></output>)xml";
  Diagnostics messages;
  const auto bad = ReadPipelineText("<pipeline version=\"1\">" + body + "</pipeline>", "t.xml", messages);
  BuildGraph(bad, pipelinetest::Registry(), {}, messages);
  // The test's writer and view have no properties but those that the output's attributes say.
  EXPECT_NE(messages.ToText().find("output \"shown\": no property \"Gain\""), std::string::npos) << messages.ToText();

  GraphOptions options;
  options.Properties = { { "shown:view.Display", "P3" }, { "shown:write.File", "t.png" } };
  const auto graph = Load(
    "<node id=\"pt\" type=\"TestSource\"/><output name=\"shown\" from=\"pt\" file=\"s.png\" view=\"plain\"/>", options);
  Diagnostics none;
  const std::string text = WritePipelineText(*SelfContained(*graph, pipelinetest::Registry(), none));
  const auto again = BuildGraph(ReadPipelineText(text, "t.exr", none), pipelinetest::Registry(), {}, none);
  EXPECT_EQ(none.ToText(), "");
  EXPECT_EQ(again->Nodes[std::size_t(again->Find("shown:view"))].Stage->GetPropertyText("Display"), "P3");
  EXPECT_EQ(again->Nodes[std::size_t(again->Find("shown:write"))].Stage->GetPropertyText("File"), "t.png");
}

TEST_F(Provenance, ContentHashDependsOnEveryByteAndNotOnThePieces)
{
  const std::string bytes = "The quick brown fox jumps over it";
  ContentHash pieces;
  for (std::size_t at = 0; at < bytes.size(); at += 3)
  {
    pieces.Add(bytes.data() + at, std::min<std::size_t>(3, bytes.size() - at));
  }
  EXPECT_EQ(pieces.Hex(), HashHex(bytes));
  std::set<std::string> seen{ HashHex(bytes), HashHex(bytes + '\0'), HashHex("") };
  for (std::size_t i = 0; i < bytes.size(); ++i)
  {
    std::string other = bytes;
    other[i] = char(other[i] ^ 1);
    seen.insert(HashHex(other));
    seen.insert(HashHex(bytes.substr(0, i)));
  }
  EXPECT_EQ(seen.size(), 3 + 2 * bytes.size() - 1); // "" twice

  const std::string scene = this->Write("s.gltf", "one");
  const auto graph =
    Load("<node id=\"pt\" type=\"TestSource\"><property name=\"Scene\" value=\"" + scene + "\"/></node>");
  const auto before = InputHashes(*graph);
  ASSERT_EQ(before.size(), 1u);
  EXPECT_EQ(before.begin()->first, scene);
  this->Write("s.gltf", "two");
  EXPECT_NE(InputHashes(*graph).begin()->second, before.begin()->second);
}

// ---- checkpoints --------------------------------------------------------------------------------------------------

TEST_F(Checkpoints, GoingOnGivesTheBitsOfAnUninterruptedRun)
{
  PipelineExecutor whole(Load(Temporal), pipelinetest::Registry());
  for (int t = 0; t < 8; ++t)
    ASSERT_TRUE(whole.RunTick(t).Ok);
  const auto expected = TheLog().Files;
  ASSERT_EQ(expected.size(), 8u);
  TheLog() = pipelinetest::Log();

  const std::string file = (this->Folder / "deep/t.checkpoint").string();
  {
    PipelineExecutor first(Load(Temporal), pipelinetest::Registry());
    first.SetHistoryLength(1);
    TheLog().Token = std::make_shared<CancelToken>();
    TheLog().CancelAtTick = 4;
    first.SetCancelToken(TheLog().Token);
    int done = -1;
    for (int t = 0; t < 8 && first.RunTick(t).Ok; ++t)
      done = t;
    ASSERT_EQ(done, 3);
    WriteCheckpoint(file, After(first, done));
  }
  const std::size_t before = TheLog().Files.size();
  ASSERT_EQ(before, 4u);
  TheLog().CancelAtTick = -1;
  PipelineExecutor second(Load(Temporal), pipelinetest::Registry());
  const Checkpoint checkpoint = ReadCheckpoint(file);
  EXPECT_EQ(checkpoint.Tick, 3);
  EXPECT_EQ(DifferenceOf(checkpoint.Identity, IdentityOf(second, {}, 0, "1")), "");
  std::string error;
  ASSERT_TRUE(Restore(second, checkpoint, error)) << error;
  for (int t = 4; t < 8; ++t)
    ASSERT_TRUE(second.RunTick(t).Ok);
  ASSERT_EQ(TheLog().Files.size(), 8u);
  for (std::size_t i = 0; i < 8; ++i)
  {
    EXPECT_EQ(TheLog().Files[i].Name, expected[i].Name);
    EXPECT_EQ(TheLog().Files[i].Layers, expected[i].Layers) << "frame " << i;
  }
  // Nothing but the checkpoint is left in its folder.
  EXPECT_EQ(std::distance(fs::directory_iterator(fs::path(file).parent_path()), fs::directory_iterator()), 1);
}

TEST_F(Checkpoints, FactsOfTheFrameComeBack)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  Checkpoint c = After(executor, 0);
  FrameFacts facts;
  facts.HasCamera = true;
  facts.WorldToCamera.m[1][2] = 0.1;
  facts.Origin = { 1e6, -2, 1. / 3 };
  facts.Seed = -5;
  facts.Scene = "abc";
  facts.Partial = "3 of 8 samples";
  c.WorkTick = 1;
  c.Work["pt"] = std::string("sums\0and more", 13);
  c.Work["other"] = std::string();
  c.Unfinished = { -3, 1, 7 };
  vtkImageData* image = c.Frame.begin()->second;
  facts.Write(image->GetFieldData());
  const std::string file = (this->Folder / "c").string();
  WriteCheckpoint(file, c);
  const Checkpoint read = ReadCheckpoint(file);
  EXPECT_EQ(read.Identity, c.Identity);
  const FrameFacts back = FrameFacts::Read(read.Frame.begin()->second->GetFieldData());
  EXPECT_TRUE(back.HasCamera);
  EXPECT_EQ(back.WorldToCamera.m[1][2], 0.1);
  EXPECT_EQ(back.Origin, facts.Origin);
  EXPECT_EQ(back.Seed, -5);
  EXPECT_EQ(back.Scene, "abc");
  EXPECT_EQ(back.Partial, "3 of 8 samples");
  EXPECT_EQ(read.WorkTick, 1);
  EXPECT_EQ(read.Work, c.Work);
  EXPECT_EQ(read.Unfinished, c.Unfinished);
}

TEST_F(Checkpoints, APartialFrameIsWrittenAndLeavesTheHistory)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  TheLog() = pipelinetest::Log();
  const TickResult whole = executor.RunTick(0);
  ASSERT_TRUE(whole.Ok);
  EXPECT_EQ(whole.Partial, "");
  EXPECT_TRUE(executor.SaveWork().empty());
  TheLog().PartialAtTick = 1;
  const TickResult partial = executor.RunTick(1);
  ASSERT_TRUE(partial.Ok) << partial.Error;
  EXPECT_EQ(partial.Partial, "3 of 8 samples");
  EXPECT_FALSE(partial.Files.empty());
  EXPECT_NE(executor.GetHistory().FindFrame(0), nullptr);
  EXPECT_EQ(executor.GetHistory().FindFrame(1), nullptr);
  // what is made of it says so, whichever port it came in by
  EXPECT_EQ(FrameFacts::Read(executor.GetImage("mix")->GetFieldData()).Partial, "3 of 8 samples");

  const PipelineExecutor::Work work = executor.SaveWork();
  ASSERT_EQ(work.size(), 1u);
  EXPECT_EQ(work.at("pt"), "sums of seed 1");
  PipelineExecutor other(Load(Temporal), pipelinetest::Registry());
  std::string error;
  EXPECT_TRUE(other.LoadWork(work, error)) << error;
  EXPECT_EQ(TheLog().Work["1"], "sums of seed 1");
  EXPECT_FALSE(other.LoadWork({ { "pt", "rubbish" } }, error));
  EXPECT_EQ(error, "node \"pt\": these are no sums");
  EXPECT_FALSE(other.LoadWork({ { "nobody", "sums" } }, error));
  EXPECT_EQ(error, "no live node \"nobody\"");
  EXPECT_FALSE(other.LoadWork({ { "mix", "sums" } }, error));
  TheLog() = pipelinetest::Log();
}

TEST_F(Checkpoints, TheDifferenceIsNamed)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  const RunIdentity id = IdentityOf(executor, {}, 0, "1");
  const auto difference = [&id](const GraphOptions& options, const std::string& body = Temporal)
  {
    PipelineExecutor other(Load(body, options), pipelinetest::Registry());
    return DifferenceOf(id, IdentityOf(other, {}, 0, "1"));
  };
  GraphOptions options;
  EXPECT_EQ(difference(options), "");
  options.Properties = { { "mix.Alpha", "0.25" } };
  EXPECT_EQ(difference(options), "node \"mix\": Alpha was 0.5 and is 0.25");
  options = GraphOptions();
  options.Seed = 8;
  EXPECT_EQ(difference(options), "node \"pt\": Seed was 1 and is 8");
  options = GraphOptions();
  options.Outputs = { { "pt:depth", "d.exr" } };
  EXPECT_NE(difference(options).find("node \"pt:depth:write\": "), std::string::npos) << difference(options);
  std::string body = Temporal;
  body.replace(body.find("blur:radiance\" delay"), 13, "acc:radiance");
  EXPECT_EQ(difference({}, body), "node \"acc\": input \"history\" was blur:radiance of the previous frame and is "
                                  "acc:radiance of the previous frame");
  EXPECT_EQ(DifferenceOf(id, IdentityOf(executor, DisplayRegion{ 0, 0, 2, 2 }, 0, "1")),
    "--region: was the whole frame and is 0,0,2,2");
  EXPECT_EQ(DifferenceOf(id, IdentityOf(executor, {}, 3, "1")), "the first frame computed: was 0 and is 3");
  EXPECT_EQ(DifferenceOf(id, IdentityOf(executor, {}, 0, "2")), "the program: version was 1 and is 2");
  // A file may hold anything; a terminal obeys it.
  EXPECT_EQ(
    DifferenceOf({ { "node\n\"a\":", "\x1b[2J1" } }, { { "node\n\"a\":", "2" } }), "node \"a\": was [2J1 and is 2");
  std::string error;
  EXPECT_FALSE(executor.LoadWork({ { "a\x1b\n", "" } }, error));
  EXPECT_EQ(error, "no live node \"a\"");
}

TEST_F(Checkpoints, AStateOfAnotherShapeIsRefused)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  Checkpoint c = After(executor, 0);
  std::string error;
  GraphOptions larger;
  larger.Properties = { { "pt.Width", "10" } };
  PipelineExecutor other(Load(Temporal, larger), pipelinetest::Registry());
  EXPECT_FALSE(Restore(other, c, error));
  EXPECT_EQ(error, "\"blur\" is not of 10 x 5 pixels in it");
  EXPECT_EQ(other.GetHistory().FindFrame(0), nullptr);
  c.Frame.erase("mix");
  PipelineExecutor same(Load(Temporal), pipelinetest::Registry());
  EXPECT_FALSE(Restore(same, c, error));
  EXPECT_EQ(error, "\"mix:radiance\" is not in it");
}

TEST_F(Checkpoints, DamagedFilesAreErrors)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  ASSERT_TRUE(executor.RunTick(0).Ok);
  const std::string file = (this->Folder / "c").string();
  Checkpoint c = After(executor, 0);
  c.Identity = { { "a", "b" } };
  FrameFacts facts;
  facts.Scene = "s";
  facts.Write(c.Frame.begin()->second->GetFieldData());
  WriteCheckpoint(file, c);
  const std::string good = Sequences::Read(file);
  ASSERT_GT(good.size(), 1000u);
  EXPECT_NO_THROW(ReadCheckpoint(file));

  const auto refused = [&](const std::string& bytes)
  {
    this->Write("c", bytes);
    try
    {
      ReadCheckpoint(file);
    }
    catch (const StageError& e)
    {
      return std::string(e.what()).find("checkpoint " + file + ": ") == 0;
    }
    return false;
  };
  for (std::size_t n = 0; n < good.size(); n += n < 300 ? 1 : 37)
  {
    EXPECT_TRUE(refused(good.substr(0, n))) << "cut after " << n;
  }
  EXPECT_TRUE(refused(good + "x"));
  for (std::size_t i = 0; i < good.size(); i += i < 400 ? 1 : 31)
  {
    for (int change : { 1, 0xff })
    {
      std::string bad = good;
      bad[i] = char(bad[i] ^ change);
      EXPECT_TRUE(refused(bad)) << "byte " << i;
    }
  }
  EXPECT_TRUE(refused(std::string(64, '\0')));
  fs::remove(file);
  EXPECT_THROW(ReadCheckpoint(file), StageError);
  fs::create_directories(file);
  EXPECT_THROW(ReadCheckpoint(file), StageError);
  EXPECT_THROW(WriteCheckpoint(file, c), StageError); // a folder is in the way
}

TEST_F(Checkpoints, LiesBesideTheOutputs)
{
  PipelineExecutor executor(Load(Temporal,
                              []
                              {
                                GraphOptions o;
                                o.Outputs = { { "beauty", "out/b.####.exr" } };
                                o.OutputDirectory = "dir";
                                return o;
                              }()),
    pipelinetest::Registry());
  EXPECT_EQ(CheckpointPath(executor), "dir/out/t.checkpoint");
}

// ---- beginning in the middle ----------------------------------------------------------------------------------------

namespace
{
std::string Loops(int chained, double alpha, int count)
{
  std::string body = "<time count=\"" + std::to_string(count) + "\"/><node id=\"m0\" type=\"TestSource\"/>";
  for (int i = 1; i <= chained; ++i)
  {
    const std::string id = "m" + std::to_string(i);
    body += "<node id=\"" + id + "\" type=\"TestMix\"><property name=\"Alpha\" value=\"" + std::to_string(alpha) +
            "\"/><input port=\"radiance\" from=\"m" + std::to_string(i - 1) + "\"/><input port=\"history\" from=\"" +
            id + "\" delay=\"1\"/></node>";
  }
  return body + "<output name=\"o\" from=\"m" + std::to_string(chained) + "\" file=\"o.####.exr\"/>";
}

/// Largest difference of a frame between a full run and one that begins with `history`.
double Difference(const std::string& body, int frame, const HistoryPlan& history)
{
  PipelineExecutor full(Load(body), pipelinetest::Registry()), late(Load(body), pipelinetest::Registry());
  for (int t = 0; t <= frame; ++t)
    EXPECT_TRUE(full.RunTick(t, t < frame ? TickMode::WarmUp : TickMode::LastFrame).Ok);
  for (int t = frame - history.Frames; t <= frame; ++t)
    EXPECT_TRUE(late.RunTick(t, t < frame ? TickMode::WarmUp : TickMode::LastFrame).Ok);
  const auto& files = TheLog().Files;
  const std::vector<float>& a = files[files.size() - 2].Layers.begin()->second;
  const std::vector<float>& b = files[files.size() - 1].Layers.begin()->second;
  double worst = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    worst = std::max(worst, std::fabs(double(a[i]) - b[i]));
  return worst;
}
}

TEST_F(WarmUp, OneLoopForgetsGeometrically)
{
  const std::string body = Loops(1, 0.5, 40);
  PipelineExecutor executor(Load(body), pipelinetest::Registry());
  const HistoryPlan plan = PlanHistory(executor, 30, 1e-3);
  EXPECT_EQ(plan.Frames, 9);
  EXPECT_DOUBLE_EQ(plan.RestWeight, std::pow(0.5, 10));
  // Values are in [0, 1): the difference is at most the weight. It is not far below: the bound is no guess.
  const double difference = Difference(body, 30, plan);
  EXPECT_LE(difference, plan.RestWeight + 1e-6);
  EXPECT_GE(difference, plan.RestWeight / 4);
  EXPECT_EQ(HistoryText(plan), "history: 9 frames before are computed and not written; those before them would have "
                               "had a weight of at most 0.00098");
  // Too few frames before: all of them, and nothing is missing.
  EXPECT_EQ(PlanHistory(executor, 7).Frames, 7);
  EXPECT_EQ(PlanHistory(executor, 7).RestWeight, 0);
  EXPECT_EQ(PlanHistory(executor, 0).Frames, 0);
  EXPECT_EQ(PlanHistory(executor, 30, 0).Frames, 30);
  EXPECT_EQ(Difference(body, 30, PlanHistory(executor, 30, 0)), 0);
}

TEST_F(WarmUp, ChainedLoopsForgetTogether)
{
  const std::string body = Loops(2, 0.5, 60);
  PipelineExecutor executor(Load(body), pipelinetest::Registry());
  const HistoryPlan plan = PlanHistory(executor, 50, 1e-3);
  // Two geometric tails convolved: w^n (1 + n (1 - w)) with n = k + 1.
  int n = 1;
  while (std::pow(0.5, n) * (1 + 0.5 * n) > 1e-3)
    ++n;
  EXPECT_EQ(plan.Frames, n - 1);
  EXPECT_NEAR(plan.RestWeight, std::pow(0.5, n) * (1 + 0.5 * n), 1e-12);
  EXPECT_LE(Difference(body, 50, plan), plan.RestWeight + 1e-6);
  EXPECT_GT(plan.Frames, PlanHistory(PipelineExecutor(Load(Loops(1, 0.5, 60)), pipelinetest::Registry()), 50).Frames);
}

TEST_F(WarmUp, ALoopThatNeverForgetsNeedsAllFrames)
{
  PipelineExecutor executor(Load(Temporal), pipelinetest::Registry());
  EXPECT_EQ(PlanHistory(executor, 6).Frames, 6);
  EXPECT_EQ(PlanHistory(executor, 6).RestWeight, 0);
  EXPECT_EQ(HistoryText(PlanHistory(executor, 6)),
    "history: 6 frames before are computed and not written; the bits are those of a run from the first frame");
  PipelineExecutor still(Load(Loops(1, 0, 9)), pipelinetest::Registry());
  EXPECT_EQ(PlanHistory(still, 6).Frames, 6);
}

TEST_F(WarmUp, APastOutsideOfLoopsNeedsOneFrameEach)
{
  const std::string body = R"xml(<time count="9"/><node id="pt" type="TestSource"/>
    <node id="one" type="TestAccumulate"><input port="radiance" from="pt"/><input port="history" from="pt" delay="1"/></node>
    <node id="two" type="TestAccumulate"><input port="radiance" from="pt"/><input port="history" from="one:radiance" delay="1"/></node>
    <output name="o" from="two" file="o.####.exr"/>)xml";
  PipelineExecutor executor(Load(body), pipelinetest::Registry());
  const HistoryPlan plan = PlanHistory(executor, 6);
  EXPECT_EQ(plan.Frames, 2);
  EXPECT_EQ(plan.RestWeight, 0);
  EXPECT_EQ(Difference(body, 6, plan), 0);
  EXPECT_GT(Difference(body, 6, { 1, 0 }), 0);
}

TEST_F(WarmUp, ThePlanSaysWhatIsHeld)
{
  PipelineExecutor executor(Load(Loops(1, 0.5, 40)), pipelinetest::Registry());
  const ExecutionPlan plan = MakePlan(executor, {}, 30, 31);
  EXPECT_EQ(plan.WarmUp, 9);
  // Source, mix, and the mix of the frame before: three colours of 40 x 24.
  EXPECT_EQ(PlanBytes(plan), 3 * 40 * 24 * 3 * 4.);
  const std::string text = PlanText(plan);
  EXPECT_NE(text.find("frame 30"), std::string::npos);
  EXPECT_NE(text.find("history: 9 frames before are computed"), std::string::npos) << text;
  EXPECT_NE(
    text.find("scenes not counted: 34.6 kB of arrays with what is kept of the frame before, 0 B of"), std::string::npos)
    << text;
}
