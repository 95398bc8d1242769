// SPDX-License-Identifier: BSD-3-Clause
// The viewer with its window, driven through VTK's interactor as a mouse and a keyboard would.
#include "AllStages.h"
#include "quellClipboard.h"
#include "quellImageFile.h"
#include "quellMetrics.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellScript.h"
#include "quellViewer.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
const std::string Data = QUELL_SOURCE_DIR "/Data";

/// A directory that looks like the shipped data, so that paths in what is built are those of the shipped files.
class Viewing : public testing::Test
{
protected:
  void SetUp() override
  {
    if (!std::getenv("DISPLAY"))
    {
      GTEST_SKIP() << "no display; run under xvfb-run -a";
    }
    this->Top = fs::path(testing::TempDir()) /
                ("quell-viewer-" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(this->Top);
    for (const char* folder : { "Color", "Images", "Pipelines", "Scenes" })
    {
      fs::create_directories(this->Top / folder);
      for (const auto& e : fs::directory_iterator(Data + "/" + folder))
      {
        if (e.is_regular_file())
        {
          fs::create_symlink(e.path(), this->Top / folder / e.path().filename());
        }
      }
    }
    // Symbolic links lead away from here; these two are looked at by their place.
    for (const char* file : { "Pipelines/library.xml", "Pipelines/quick.xml", "Pipelines/svgf.xml" })
    {
      fs::remove(this->Top / file);
      fs::copy_file(Data + "/" + file, this->Top / file);
    }
    setenv("QUELL_DATA_DIR", this->Top.c_str(), 1);
    this->Back = fs::current_path();
    fs::current_path(this->Top / "Pipelines");
  }
  void TearDown() override
  {
    this->View.reset();
    this->Win.reset();
    if (!this->Back.empty())
    {
      fs::current_path(this->Back);
      unsetenv("QUELL_DATA_DIR");
      fs::remove_all(this->Top);
    }
  }

  void Start(int width, int height, double scale = 1, Viewer::Options options = {})
  {
    Window::Options w;
    w.SharesClipboard = this->Shares;
    w.OffScreen = true;
    w.Width = width;
    w.Height = height;
    w.Scale = scale;
    this->View.reset();
    this->Win.reset();
    this->Win.reset(new Window(w));
    this->Win->SetBlind(true);
    options.Plain = true;
    this->View.reset(new Viewer(*this->Win, Registry(), options));
    this->Run.reset(new ScriptRunner(*this->Win, *this->View, this->Empty));
    this->Run->Draw();
    this->Run->Draw();
  }
  static Viewer::Options Small()
  {
    Viewer::Options o;
    o.Graph.Defines = { { "width", "48" }, { "height", "48" }, { "spp", "2" } };
    return o;
  }
  void Do(const std::string& lines)
  {
    std::istringstream stream(lines);
    for (std::string line; std::getline(stream, line);)
    {
      std::string error;
      ASSERT_TRUE(this->Run->Do(line, error)) << error;
    }
  }
  bool Has(const std::string& mark)
  {
    this->Run->Draw();
    this->Run->Draw();
    return this->View->GetMarks().count(mark) != 0;
  }
  std::string Written(const std::string& file)
  {
    std::ifstream stream(file);
    std::stringstream text;
    text << stream.rdbuf();
    return text.str();
  }

  fs::path Top, Back;
  bool Shares = false; ///< the clipboard, with other programs
  Script Empty;
  std::unique_ptr<Window> Win;
  std::unique_ptr<Viewer> View;
  std::unique_ptr<ScriptRunner> Run;
};

/// What a pipeline does, without its prose and without the order that things were said in.
std::string Essence(PipelineDocument d)
{
  d.Doc = PipelineText();
  d.Comments.clear();
  d.TrailingComments.clear();
  const auto plain = [](PipelineItem& item)
  {
    item.Comments.clear();
    item.TrailingComments.clear();
  };
  plain(d.Time);
  for (PipelineInclude& i : d.Includes)
  {
    plain(i);
  }
  for (PipelineVariable& v : d.Variables)
  {
    plain(v);
    v.Doc = PipelineText();
  }
  for (PipelineNode& n : d.Nodes)
  {
    plain(n);
    n.Doc = PipelineText();
    for (PipelineProperty& p : n.Properties)
    {
      plain(p);
    }
    for (PipelineInput& i : n.Inputs)
    {
      plain(i);
    }
    std::sort(n.Properties.begin(), n.Properties.end(),
      [](const PipelineProperty& a, const PipelineProperty& b) { return a.Name.Value < b.Name.Value; });
    std::stable_sort(n.Inputs.begin(), n.Inputs.end(),
      [](const PipelineInput& a, const PipelineInput& b) { return a.Port.Value < b.Port.Value; });
  }
  for (PipelineOutput& o : d.Outputs)
  {
    plain(o);
  }
  std::sort(d.Nodes.begin(), d.Nodes.end(),
    [](const PipelineNode& a, const PipelineNode& b) { return a.Id.Value < b.Id.Value; });
  std::sort(d.Variables.begin(), d.Variables.end(),
    [](const PipelineVariable& a, const PipelineVariable& b) { return a.Name.Value < b.Name.Value; });
  return WritePipelineText(d);
}

std::string EssenceOf(const std::string& file)
{
  Diagnostics messages;
  const auto d = ReadPipelineFile(file, messages);
  EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
  return Essence(*d);
}
}

// From an empty graph to the shipped SVGF pipeline by mouse and keyboard alone.
TEST_F(Viewing, BuildsTheSvgfPipelineByMouse)
{
  this->Start(1700, 1300);
  const auto add = [&](const std::string& search, const std::string& name)
  {
    this->Do("click graph/add\ntype " + search + "\nkey Return\n");
    if (!name.empty())
    {
      this->Do("key F2\ntype " + name + "\nkey Return\n");
    }
    this->Do("move graph@0.02,0.98\nkey l\n");
  };
  const auto text = [&](const std::string& field, const std::string& value)
  { this->Do("click " + field + "\nkey a ctrl\ntype " + value + "\nkey Return\n"); };
  const auto number = [&](const std::string& field, const std::string& value)
  { this->Do("click " + field + " ctrl\nkey a ctrl\ntype " + value + "\nkey Return\n"); };
  const auto link = [&](const std::string& from, const std::string& to)
  { this->Do("drag out/" + from + " in/" + to + "\n"); };
  const auto variable = [&](const std::string& property, const std::string& name)
  {
    this->Do("click label/" + property + " right\nmove menu/variables\nclick menu/variables\nclick menu/variable/" +
             name + "\n");
  };
  const auto make = [&](const std::string& property)
  { this->Do("click label/" + property + " right\nclick menu/make-variable\n"); };

  this->Do("click welcome/new\n");
  add("PathTr", "");
  text("property/Scene", "../Scenes/cornell-box-moving.gltf");
  make("Scene");
  number("property/Width", "192");
  make("Width");
  number("property/Height", "192");
  make("Height");
  number("property/Seed", "1");
  make("Seed");
  this->Do("click property/PixelJitter\nclick property/PixelJitter/PerFrame\n");
  this->Do("click tab/Pipeline\n");
  for (const auto& v : { std::make_pair("spp", "1"), std::make_pair("frames", "32") })
  {
    text("variable/new", v.first);
    this->Do("click variable/add\n");
    text(std::string("variable/") + v.first + "@0.1,0.5", v.second);
  }
  text("variable/new", "reference");
  this->Do("click variable/type\nclick variable/type/path\nclick variable/add\n");
  text("variable/reference@0.3,0.5", "../Images/cornell-box-moving.0031.exr");
  text("pipeline/first", "0");
  text("pipeline/count", "$(frames)");
  text("pipeline/rate", "24");
  this->Do("click tab/Node\nclick node/pt\n");
  variable("SamplesPerPixel", "spp");
  this->Do("click more/pt\n");

  add("svgf", "direct");
  number("property/alpha", "0.3");
  add("svgf", "indirect");
  add("Sum", "");
  add("TemporalAnti", "taa");
  number("property/Alpha", "0.2");
  add("ImageRe", "reference");
  variable("File", "reference");
  add("CompareI", "");
  number("property/Tick", "31");
  text("property/Label", "beauty");
  add("output", "");
  text("property/file", "out/svgf.####.exr");
  add("output", "preview");
  text("property/file", "out/svgf.png");
  text("property/view", "ACES-like");

  this->Do("move graph@0.02,0.98\nkey l\n");
  for (const char* layer : { "direct", "indirect" })
  {
    link(std::string("pt/") + layer, std::string(layer) + "/radiance");
    for (const char* port : { "albedo", "normal", "depth", "motion", "id" })
    {
      link(std::string("pt/") + port, std::string(layer) + "/" + port);
    }
  }
  this->Do("move graph@0.02,0.98\nkey l\n");
  link("direct/out", "sum/radiance");
  link("indirect/out", "sum/radiance");
  link("pt/emission", "sum/radiance");
  link("sum/radiance", "taa/radiance");
  link("pt/motion", "taa/motion");
  link("pt/depth", "taa/depth");
  link("taa/radiance", "taa/history");
  link("taa/radiance", "compare/image");
  link("reference/radiance", "compare/reference");
  link("pt/radiance", "compare/baseline");
  link("taa/radiance", "output:beauty/image");
  link("taa/radiance", "output:preview/image");
  this->Do("move graph@0.02,0.98\nkey l\nclick node/taa\nkey s ctrl\nclick files/name\nkey a ctrl\ntype built.xml\nkey "
           "Return\nwait\n");

  EXPECT_EQ(EssenceOf("built.xml"), EssenceOf(Data + "/Pipelines/svgf.xml"));
  EXPECT_EQ(this->View->ErrorText(), "");
  ASSERT_TRUE(this->View->Frame() && this->View->Frame()->Ok);
  EXPECT_FALSE(this->View->Frame()->Pruned);
  EXPECT_FALSE(ReadPipelinePositions(this->Written("built.xml")).empty());
}

TEST_F(Viewing, LinksThatDoNotFitAreRefusedAndOthersCanBeTakenOff)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nmove graph@0.02,0.98\nkey l\nframes 3\n");
  const auto before = this->View->Document().Get();
  this->Do("drag out/pt/normal in/blur/depth\n");
  EXPECT_EQ(*this->View->Document().Get(), *before) << "a normal is no depth";
  this->Do("drag out/modulate/radiance in/demodulate/radiance\n");
  EXPECT_EQ(*this->View->Document().Get(), *before) << "that would be a loop";
  this->Do("drag in/blur/depth graph@0.5,0.95\n");
  EXPECT_EQ(this->View->Document().FindNode("", "blur")->Inputs.size(), 3u);
  this->Do("key z ctrl\n");
  EXPECT_EQ(*this->View->Document().Get(), *before);
  this->Do("drag out/pt/depth in/blur/depth\n");
  EXPECT_EQ(*this->View->Document().Get(), *before) << "that is there already";
  // On the body of a node a link finds its port by itself.
  this->Do("click more/pt\nframes 3\ndrag in/blur/normal graph@0.5,0.95\ndrag out/pt/normal node/blur\n");
  EXPECT_EQ(this->View->Document().FindNode("", "blur")->Inputs.back().Port.Value, "normal");
}

TEST_F(Viewing, NodesAreInsertedDeletedDuplicatedAndRenamed)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\nclick link/demodulate/0 right\nclick menu/insert\ntype Firefly\nkey Return\nwait\n");
  ASSERT_TRUE(d.FindNode("", "fireflyClamp"));
  EXPECT_EQ(d.FindNode("", "fireflyClamp")->Inputs[0].From.Value, "scattered:radiance");
  EXPECT_EQ(d.FindNode("", "demodulate")->Inputs[0].From.Value, "fireflyClamp:radiance");
  EXPECT_EQ(this->View->ErrorText(), "");
  this->Do("click node/fireflyClamp\nkey Delete ctrl\nwait\n");
  EXPECT_EQ(d.FindNode("", "demodulate")->Inputs[0].From.Value, "scattered:radiance");
  this->Do("click node/blur\nkey d ctrl\n");
  EXPECT_TRUE(d.FindNode("", "blur2"));
  this->Do("key Delete\n");
  EXPECT_FALSE(d.FindNode("", "blur2"));
  this->Do("click node/blur\nkey F2\ntype soft\nkey Return\nwait\n");
  EXPECT_TRUE(d.FindNode("", "soft"));
  EXPECT_EQ(this->View->Target().Node, "soft");
  this->Do("click node/soft\nkey c ctrl\nmove graph@0.5,0.9\nkey v ctrl\n");
  EXPECT_TRUE(d.FindNode("", "soft2"));
  this->Do("key z ctrl\nkey z ctrl\n");
  EXPECT_TRUE(d.FindNode("", "blur"));
  this->Do("key y ctrl\n");
  EXPECT_TRUE(d.FindNode("", "soft"));
  // A slider is dragged: one step.
  const std::string text = d.Text();
  this->Do("click node/soft\ndrag property/SigmaRange@0.3,0.5 property/SigmaRange@0.8,0.5\nwait\n");
  EXPECT_NE(d.Text(), text);
  this->Do("move graph@0.5,0.95\nkey z ctrl\n");
  EXPECT_EQ(d.Text(), text);
}

TEST_F(Viewing, UnsavedChangesAreAskedFor)
{
  this->Start(1100, 800, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  const std::string shipped = this->Written("quick.xml");
  this->Do("wait\nclick node/blur\nkey Delete\nkey n ctrl\n");
  EXPECT_TRUE(this->Has("ask/save"));
  this->Do("click ask/cancel\n");
  EXPECT_FALSE(this->Has("ask/save"));
  EXPECT_FALSE(this->View->Document().FindNode("", "blur"));
  this->Do("key q ctrl\n");
  EXPECT_FALSE(this->Win->IsClosing());
  this->Do("click ask/discard\n");
  EXPECT_TRUE(this->Win->IsClosing());
  EXPECT_EQ(this->Written("quick.xml"), shipped);

  this->Start(1100, 800, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/blur\nkey Delete ctrl\nkey n ctrl\nclick ask/save\n");
  EXPECT_TRUE(this->View->Document().Nodes("").empty());
  EXPECT_EQ(this->Written("quick.xml").find("\"blur\""), std::string::npos);
  EXPECT_NE(this->Written("quick.xml").find("<!-- Light that was scattered"), std::string::npos);
}

TEST_F(Viewing, AWrongFileIsExplainedAndNothingIsLost)
{
  this->Start(1100, 800);
  std::ofstream("broken.xml") << "<pipeline version=\"1\">\n  <node id=\"a\" type=\"Sum\">\n</pipeline>\n";
  EXPECT_FALSE(this->View->Open("broken.xml"));
  EXPECT_NE(this->View->ErrorText().find("broken.xml:3:"), std::string::npos) << this->View->ErrorText();
  EXPECT_TRUE(this->Has("welcome/back"));
  std::ofstream("broken.xml") << "<pipeline version=\"1\"><node id=\"a\" type=\"Summ\"/></pipeline>\n";
  this->Do("click welcome/again\nwait\n");
  EXPECT_TRUE(this->Has("message/0"));
  EXPECT_NE(this->View->ErrorText().find("Sum"), std::string::npos) << this->View->ErrorText();
  EXPECT_FALSE(this->View->Open("/nowhere/x.xml"));
  this->Do("click welcome/back\n");
  EXPECT_TRUE(this->View->Document().FindNode("", "a"));
}

TEST_F(Viewing, FilesCanBeDropped)
{
  this->Start(1100, 800);
  // A picture that says how it was made is its pipeline; any other one is read.
  this->Do("drop " + Data + "/Images/cornell-box-moving.0031.exr\nframes 3\n");
  EXPECT_GT(this->View->Document().Nodes("").size() + this->View->Document().Get()->Outputs.size(), 0u);
  this->View->New();
  ReadOptions only;
  only.Arrays = { "radiance" };
  WriteImageFile("plain.exr", ReadImageFile(Data + "/Images/cornell-box-moving.0031.exr", nullptr, only));
  this->Do("drop " + fs::absolute("plain.exr").string() + "\nwait\n");
  ASSERT_EQ(this->View->Document().Nodes("").size(), 1u);
  EXPECT_EQ(this->View->ErrorText(), "");
  this->Do("drop " + Data + "/Scenes/cornell-box.gltf\n");
  ASSERT_EQ(this->View->Document().Nodes("").size(), 2u);
  EXPECT_EQ(this->View->Document().Nodes("")[1].Type.Value, "PathTraceSource");
  this->Do("wait\n");
  EXPECT_EQ(this->View->ErrorText(), "");
}

TEST_F(Viewing, TheCameraOrbitsAndTheHistoryGoesOn)
{
  this->Start(1000, 800);
  Viewer::Options o;
  o.Graph.Defines = { { "width", "64" }, { "height", "64" } };
  o.Show = "direct/accumulate:history";
  this->Start(1000, 800, 1, o);
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  this->Do("wait\nmove image\nkey c\nwait\n");
  const FrameFacts before = FrameFacts::Read(this->View->Frame()->Images.begin()->second->GetFieldData());
  this->Do("move image@0.5,0.5\npress left\nmove image@0.51,0.5\nwait\nmove image@0.52,0.5\nwait\nmove "
           "image@0.53,0.5\nwait\nrelease left\nwait\n");
  const auto frame = this->View->Frame();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  EXPECT_GE(frame->LiveTicks, 3);
  const FrameFacts after = FrameFacts::Read(frame->Images.begin()->second->GetFieldData());
  EXPECT_NE(before.WorldToCamera.m[0][0], after.WorldToCamera.m[0][0]);
  EXPECT_NEAR(after.WorldToCamera.Determinant3(), 1, 1e-9) << "a turn, no stretch";
  const ImageIn history = ArrayView(frame->Images.begin()->second, "history");
  ASSERT_TRUE(history);
  int old = 0;
  for (int y = 0; y < 64; ++y)
  {
    for (int x = 0; x < 64; ++x)
    {
      old += history.at(x, y)[0] >= 3;
    }
  }
  EXPECT_GT(old, 64 * 64 / 2);
  this->Do("key h\nwait\n");
  const FrameFacts home = FrameFacts::Read(this->View->Frame()->Images.begin()->second->GetFieldData());
  EXPECT_EQ(before.WorldToCamera.m[0][0], home.WorldToCamera.m[0][0]);
}

TEST_F(Viewing, PointsOfTheTradeCanBeReturnedTo)
{
  Viewer::Options o;
  o.Graph.Defines = { { "width", "32" }, { "height", "32" }, { "spp", "4" } };
  // A reference of the same size: the same scene with more samples.
  {
    GraphOptions g;
    g.Defines = { { "width", "32" }, { "height", "32" }, { "spp", "64" } };
    g.OutputDirectory = this->Top.string();
    Diagnostics messages;
    PipelineExecutor executor(LoadPipeline("quick.xml", Registry(), g, messages), Registry());
    ASSERT_TRUE(executor.RunTick(0).Ok);
  }
  o.Reference = (this->Top / "out/quick.exr").string();
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  const auto first = this->View->Document().Get();
  this->Do("click tab/Trade\nwait\n");
  EXPECT_TRUE(this->Has("points/0"));
  EXPECT_FALSE(this->Has("points/1"));
  this->View->Document().SetProperty("", "blur", "SigmaSpatial", "1");
  this->Do("wait\n");
  EXPECT_TRUE(this->Has("points/1"));
  this->Do("click points/0@0.3,0.5\nwait\n");
  EXPECT_EQ(*this->View->Document().Get(), *first);
  EXPECT_FALSE(this->Has("points/2")) << "it is the same point";
  this->Do("click trade/ledger\nwait\nclick tab/Compare\nwait\n");
  ASSERT_TRUE(this->View->Pictures());
  EXPECT_EQ(this->View->Pictures()->Errors.size(), 5u);
}

TEST_F(Viewing, TheLayoutAndRecentFilesAreRemembered)
{
  Viewer::Options o = Small();
  o.SettingsFile = (this->Top / "view.ini").string();
  this->Start(1100, 800, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick tab/Trade\nframes 3\ndrag splitter/right image@0.5,0.5\n");
  const ImVec4 before = this->View->GetMarks().at("splitter/right");
  this->Start(1100, 800, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\n");
  EXPECT_NEAR(this->View->GetMarks().at("splitter/right").x, before.x, 2);
  EXPECT_TRUE(this->Has("trade/reference"));
  Settings s;
  s.Load(o.SettingsFile);
  ASSERT_EQ(s.Recent().size(), 1u);
  EXPECT_TRUE(fs::equivalent(s.Recent()[0], "quick.xml"));
}

TEST_F(Viewing, WhatIsRecordedReplays)
{
  this->Start(1100, 800, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\n");
  {
    Recorder recorder("recorded.txt");
    this->Win->SetRecorder([&](const WindowEvent& e) { recorder.Take(e, *this->Win); });
    this->Do("drag node/blur graph@0.5,0.9\nwait\nclick node/modulate\nkey Delete ctrl\nwait\n");
    this->Win->SetRecorder(nullptr);
  }
  const std::string text = this->View->Document().Text();
  EXPECT_NE(text, this->Written("quick.xml"));
  this->Start(1100, 800, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  Script script;
  std::string error;
  ASSERT_TRUE(script.Load("recorded.txt", error)) << error;
  EXPECT_EQ(script.Width, 1100);
  ScriptRunner runner(*this->Win, *this->View, script);
  ASSERT_TRUE(runner.Run(error)) << error;
  EXPECT_EQ(this->View->Document().Text(), text);
  EXPECT_FALSE(script.Parse("dance", "s", error));
  EXPECT_NE(error.find("s:1:"), std::string::npos);
  EXPECT_FALSE(runner.Do("click nothing/here", error));
}

// As X delivers them to a window that is late: presses and releases in one go.
TEST_F(Viewing, EventsThatComeTogetherAreTakenOneByOne)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nmove graph@0.3,0.9\n");
  const auto key = [&](const char* sym, char character = 0)
  {
    for (const bool down : { true, false })
    {
      WindowEvent e;
      e.What = WindowEvent::Kind::Key;
      e.Sym = sym;
      e.Down = down;
      this->Win->Send(e);
      if (down && character)
      {
        e.What = WindowEvent::Kind::Text;
        e.Character = static_cast<unsigned char>(character);
        this->Win->Send(e);
      }
    }
  };
  key("Tab");
  this->Do("frames 8\n");
  for (const char c : std::string("Firefly"))
  {
    key(std::string(1, c).c_str(), c);
  }
  key("Return");
  this->Do("frames 60\nwait\n");
  EXPECT_TRUE(this->View->Document().FindNode("", "fireflyClamp"));
}

TEST_F(Viewing, APixelTellsItsWeights)
{
  Viewer::Options o = Small();
  o.Show = "sum";
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick tab/Pixel\nwait\nclick image@0.5,0.5\nwait\nframes 3\n");
  ASSERT_TRUE(this->Has("weights"));
  const auto w = this->View->Weights();
  ASSERT_TRUE(w);
  EXPECT_EQ(w->Node, "blur") << "the nearest filter behind what is shown";
  EXPECT_EQ(w->Error, "");
  double sum = 0;
  for (float v : w->Weights.Parts.at(0).Weights)
  {
    sum += double(v);
  }
  EXPECT_NEAR(sum, 1, 1e-5);
  // The pinned pixel's, whatever the mouse does; another filter setting makes other ones.
  this->Do("move weights@0.3,0.3\nframes 2\nwait\n");
  EXPECT_EQ(this->View->Weights(), w);
  this->View->Document().SetProperty("", "blur", "SigmaSpatial", "0.6");
  this->Do("wait\nframes 2\n");
  ASSERT_TRUE(this->View->Weights());
  EXPECT_GT(this->View->Weights()->Weights.Parts.at(0).At(w->X, w->Y), w->Weights.Parts.at(0).At(w->X, w->Y));
}

TEST_F(Viewing, TwoParameterSetsStandSideBySide)
{
  Viewer::Options o = Small();
  o.Show = "sum";
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\nmove image\nkey p\nwait\n");
  const auto before = d.Get();
  ASSERT_TRUE(this->View->Pictures());
  EXPECT_EQ(this->View->Pictures()->A.Rgba, this->View->Pictures()->B.Rgba);
  const std::vector<std::uint8_t> old = this->View->Pictures()->A.Rgba;
  d.SetProperty("", "blur", "SigmaSpatial", "4");
  d.SetProperty("", "blur", "SigmaRange", "5");
  this->Do("wait\n");
  EXPECT_EQ(this->View->Pictures()->B.Rgba, old) << "set B stays";
  EXPECT_NE(this->View->Pictures()->A.Rgba, old);
  const std::vector<std::uint8_t> changed = this->View->Pictures()->A.Rgba;
  // Both on another node, then A and B changed over.
  this->Do("click node/blur\nwait\n");
  EXPECT_NE(this->View->Pictures()->A.Rgba, this->View->Pictures()->B.Rgba);
  EXPECT_NE(this->View->Pictures()->B.Rgba, old);
  this->Do("click node/sum\nwait\nclick image/swap\nwait\n");
  EXPECT_EQ(*d.Get(), *before);
  EXPECT_EQ(this->View->Pictures()->A.Rgba, old);
  EXPECT_EQ(this->View->Pictures()->B.Rgba, changed);
  this->Do("move image\nkey z ctrl\nwait\n");
  EXPECT_EQ(this->View->Pictures()->A.Rgba, changed);
}

TEST_F(Viewing, TemplatesAreMadeOpenedAndGivenPorts)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\nclick node/blur\nkey g ctrl\nframes 3\nkey a ctrl\ntype soft\nkey Return\nwait\n");
  ASSERT_TRUE(d.FindTemplate("soft"));
  EXPECT_TRUE(d.FindNode("", "soft"));
  EXPECT_EQ(this->View->ErrorText(), "");
  this->Do("click node/soft double\nframes 3\nwait\n");
  EXPECT_TRUE(this->Has("graph/up"));
  EXPECT_TRUE(this->Has("node/blur"));
  this->Do("click tab/Node\nmove graph@0.02,0.98\nclick graph@0.02,0.98\nframes 2\nclick port/name\ntype "
           "mask\nclick port/add-input\nframes 3\n");
  EXPECT_EQ(d.FindTemplate("soft")->Inputs.back().Name.Value, "mask");
  this->Do("click port/delete/mask\nframes 3\n");
  EXPECT_NE(d.FindTemplate("soft")->Inputs.back().Name.Value, "mask");
  this->Do("click graph/up\nwait\n");
  EXPECT_EQ(this->View->ErrorText(), "");
  // One of the library is copied before it is changed.
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  this->Do("wait\nclick node/direct double\nframes 3\nclick tab/Node\nclick template/adopt\nwait\n");
  EXPECT_TRUE(this->View->Document().IsEditable("svgf2"));
  EXPECT_EQ(this->View->Document().FindNode("", "indirect")->Type.Value, "svgf2");
  EXPECT_EQ(this->View->ErrorText(), "");
  // The library itself can be opened: its first template is.
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("library.xml"));
  this->Do("frames 4\n");
  EXPECT_TRUE(this->Has("graph/up"));
  EXPECT_TRUE(this->Has("pipeline/template/svgf"));
}

TEST_F(Viewing, NodesTravelOverTheClipboardOfX)
{
  Clipboard other, third;
  ASSERT_TRUE(other.IsShared());
  // Large texts go in pieces, from one program's connection to another's.
  std::string large;
  for (int i = 0; large.size() < 700000; ++i)
  {
    large += std::to_string(i) + " \u00e4\n";
  }
  other.Set(large);
  EXPECT_TRUE(third.Get() == large);
  EXPECT_TRUE(other.Get() == large) << "from oneself, too";
  third.Set("short");
  EXPECT_EQ(other.Get(), "short");

  this->Shares = true;
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/blur\nkey c ctrl\n");
  EXPECT_NE(other.Get().find("<node id=\"blur\" type=\"BilateralFilter\">"), std::string::npos);
  other.Set("<node id=\"clamp\" type=\"FireflyClamp\"/>");
  this->Do("move graph@0.5,0.9\nkey v ctrl\n");
  EXPECT_TRUE(this->View->Document().FindNode("", "clamp"));
  other.Set("no XML at all");
  const auto before = this->View->Document().Get();
  this->Do("key v ctrl\n");
  EXPECT_EQ(this->View->Document().Get(), before);
}

// Pictures of the window against those that were looked at. By FLIP: text and lines may move by less than one sees.
class Baselines : public Viewing
{
protected:
  void Check(const std::string& name, bool differs = false)
  {
    if (!this->Win->HasFonts())
    {
      GTEST_SKIP() << "the viewer's fonts are not installed";
    }
    int w = 0, h = 0;
    const std::vector<std::uint8_t> pixels = this->Win->Pixels(w, h);
    const auto now = ImageOfPixels(pixels, w, h);
    const std::string file = std::string(QUELL_SOURCE_DIR) + "/Apps/quell-view/Testing/Baselines/" + name + ".png";
    const std::string candidate = testing::TempDir() + "/quell-view-" + name + ".png";
    const auto keep = [&] { WriteImageFile(candidate, now, { { "display", "", ArrayKind::Display, nullptr } }); };
    ReadOptions plain;
    plain.Transfer = FileTransfer::Linear;
    vtkSmartPointer<vtkImageData> baseline;
    try
    {
      baseline = ReadImageFile(file, nullptr, plain);
    }
    catch (const StageError& e)
    {
      keep();
      FAIL() << e.what() << "; the picture is in " << candidate;
    }
    double error = 1;
    ASSERT_NO_THROW(error = ComputeMetric("FLIP", ArrayView(now, "display"), ArrayView(baseline, "radiance")))
      << candidate;
    if (differs)
    {
      EXPECT_GT(error, 0.004) << "it should not look like " << name;
      return;
    }
    if (error > 0.004)
    {
      keep();
    }
    EXPECT_LE(error, 0.004) << "look at " << candidate << " and, if it is right, put it in place of " << file;
  }
};

TEST_F(Baselines, Welcome)
{
  this->Start(1000, 640);
  this->Do("move 990,630\nframes 3\n");
  this->Check("welcome");
}

TEST_F(Baselines, Graph)
{
  Viewer::Options o;
  o.Show = "blur";
  o.Graph.Defines = { { "width", "96" }, { "height", "96" } };
  this->Start(1100, 720, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/blur\nmove 700,690\nwait\nframes 3\n");
  this->Check("graph");
  // Another panel, another node selected, or a link less is no longer that picture.
  this->Do("click tab/Pipeline\nmove 700,690\nwait\nframes 3\n");
  this->Check("graph", true);
}

TEST_F(Baselines, DepthWithPixelAtTwiceTheSize)
{
  Viewer::Options o;
  o.Show = "pt:depth";
  o.Graph.Defines = { { "width", "96" }, { "height", "96" } };
  this->Start(1400, 960, 1.5, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick tab/Pixel\nwait\nclick image@0.5,0.5\nwait\nframes 3\n");
  this->Check("depth-pixel-large");
}

TEST_F(Baselines, Mistakes)
{
  std::ofstream("wrong.xml") << "<pipeline version=\"1\">\n  <node id=\"pt\" type=\"PathTraceSource\"/>\n"
                                "  <node id=\"blur\" type=\"BilateralFilter\">\n    <input port=\"radiance\" "
                                "from=\"pt:radience\"/>\n    <property name=\"SigmaRange\" value=\"-1\"/>\n  </node>\n"
                                "</pipeline>\n";
  this->Start(1000, 640);
  ASSERT_TRUE(this->View->Open("wrong.xml"));
  this->Do("wait\nclick node/blur\nmove 500,630\nwait\nframes 3\n");
  this->Check("mistakes");
}

// A thousand things that nobody in his right mind does.
TEST_F(Viewing, SurvivesAThousandRandomEvents)
{
  std::mt19937 random(7);
  const auto pick = [&random](int n) { return int(random() % unsigned(n)); };
  Viewer::Options o;
  o.Graph.Defines = { { "width", "16" }, { "height", "16" }, { "spp", "1" }, { "frames", "3" } };
  this->Start(900, 620, 1, o);
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  const std::vector<std::string> keys{ "Tab", "Escape", "Delete", "F1", "F2", "Return", "space", "Left", "Right",
    "Home", "End", "l", "a", "f", "1", "w", "x", "d", "k", "p", "c", "h", "r", "plus", "minus", "BackSpace", "Up",
    "Down", "0" };
  const std::vector<std::string> chords{ "z", "y", "c", "v", "d", "a", "n", "x", "g" };
  for (int i = 0; i < 1000; ++i)
  {
    WindowEvent e;
    e.X = pick(900);
    e.Y = pick(620);
    e.Control = pick(12) == 0;
    e.Shift = pick(12) == 0;
    // Half of the time at something.
    const Marks& marks = this->View->GetMarks();
    if (pick(2) && !marks.empty())
    {
      auto mark = marks.begin();
      std::advance(mark, pick(int(marks.size())));
      if (mark->first != "menu/save" && mark->first != "menu/save-as" && mark->first != "ask/save")
      {
        e.X = double((mark->second.x + mark->second.z) / 2);
        e.Y = double((mark->second.y + mark->second.w) / 2);
      }
    }
    this->Win->Send(e);
    switch (pick(6))
    {
      case 0:
      case 1:
        e.What = WindowEvent::Kind::Button;
        e.Button = pick(5) == 0 ? 1 : pick(8) == 0 ? 2 : 0;
        e.Down = true;
        this->Win->Send(e);
        this->Run->Draw();
        if (pick(2))
        {
          WindowEvent move = e;
          move.What = WindowEvent::Kind::Move;
          move.X = pick(900);
          move.Y = pick(620);
          this->Win->Send(move);
          this->Run->Draw();
        }
        e.Down = false;
        this->Win->Send(e);
        break;
      case 2:
        e.What = WindowEvent::Kind::Wheel;
        e.Amount = pick(2) ? 1 : -1;
        this->Win->Send(e);
        break;
      case 3:
        e.What = WindowEvent::Kind::Key;
        e.Down = true;
        e.Control = pick(3) == 0;
        e.Sym = e.Control ? chords[std::size_t(pick(int(chords.size())))] : keys[std::size_t(pick(int(keys.size())))];
        this->Win->Send(e);
        e.Down = false;
        this->Win->Send(e);
        break;
      case 4:
        e.What = WindowEvent::Kind::Text;
        e.Character = unsigned(32 + pick(95));
        e.Sym = std::string(1, char(e.Character));
        e.Control = false;
        this->Win->Send(e);
        break;
      default:
        break;
    }
    this->Run->Draw();
    this->Win->KeepOpen();
    if (this->View->Document().Nodes("").empty() && i % 20 == 0)
    {
      this->View->Open("quick.xml");
    }
  }
  this->Do("key Escape\nkey Escape\nwait\n");
  Diagnostics messages;
  EXPECT_EQ(*ReadPipelineText(this->View->Document().Text(), this->View->Document().Get()->File, messages),
    *this->View->Document().Get());
  EXPECT_EQ(this->Written("quick.xml"), this->Written(Data + "/Pipelines/quick.xml")) << "nothing was saved";
}
