// SPDX-License-Identifier: BSD-3-Clause
// The viewer with its window, driven through VTK's interactor as a mouse and a keyboard would.
#include "AllStages.h"
#include "quellClipboard.h"
#include "quellCommandLine.h"
#include "quellImageFile.h"
#include "quellMetrics.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellScript.h"
#include "quellUi.h"
#include "quellViewer.h"
#include "quellXClients.h"
#include "vtkDataArray.h"
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
        const fs::path to = this->Top / folder / e.path().filename();
        if (e.is_regular_file() && folder == std::string("Pipelines"))
        {
          fs::copy_file(e.path(), to); // tests write beside them; never through a link
        }
        else if (e.is_regular_file())
        {
          fs::create_symlink(e.path(), to);
        }
      }
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
    w.OffScreen = !this->OnScreen;
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
  /// A file of quick.xml's picture, `side` pixels wide and high.
  std::string MakeReference(int side, const std::string& samples)
  {
    GraphOptions g;
    g.Defines = { { "width", std::to_string(side) }, { "height", std::to_string(side) }, { "spp", samples } };
    g.OutputDirectory = this->Top.string();
    Diagnostics messages;
    PipelineExecutor executor(LoadPipeline("quick.xml", Registry(), g, messages), Registry());
    const TickResult made = executor.RunTick(0);
    EXPECT_TRUE(made.Ok) << made.Error;
    return (this->Top / "out/quick.exr").string();
  }
  std::string Written(const std::string& file)
  {
    std::ifstream stream(file);
    std::stringstream text;
    text << stream.rdbuf();
    return text.str();
  }

  fs::path Top, Back;
  bool Shares = false;   ///< the clipboard, with other programs
  bool OnScreen = false; ///< a window that the X server knows
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
  this->Do("click node/scattered\nkey Delete ctrl\n");
  EXPECT_TRUE(this->Has("told/demodulate: pt:direct goes on, pt:indirect is no longer read"));
  this->Do("key z ctrl\nwait\n");
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

TEST_F(Viewing, ThePageAboutAWrongFileTakesNoEdits)
{
  this->Start(1100, 800, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  const std::string file = this->Written("quick.xml");
  std::ofstream("broken.xml") << "<pipeline version=\"1\">\n  <node id=\"a\" type=\"Sum\">\n</pipeline>\n";
  this->Do("wait\nclick node/blur\ndrop " + fs::absolute("broken.xml").string() + "\nwait\n");
  ASSERT_TRUE(this->Has("welcome/back"));
  const auto before = this->View->Document().Get();
  this->Do("key a ctrl\nkey Delete\nkey d ctrl\nkey x ctrl\nkey v ctrl\nkey z ctrl\nkey l\nkey F2\nkey g ctrl\n"
           "frames 2\nkey s ctrl\nframes 2\n");
  EXPECT_EQ(this->View->Document().Get(), before);
  EXPECT_FALSE(this->View->Document().IsDirty());
  EXPECT_EQ(this->Written("quick.xml"), file);
  EXPECT_TRUE(this->Has("welcome/message")) << "says that nothing was saved";
  this->Do("key s ctrl shift\nframes 2\n");
  EXPECT_FALSE(this->Has("files/name"));
  // What would be added to the graph is not, and the page says so.
  for (const std::string& dropped : { Data + "/Scenes/cornell-box.gltf", Data + "/Images/cornell-box-moving.0031.exr" })
  {
    this->Do("drop " + dropped + "\nframes 3\n");
    EXPECT_EQ(this->View->Document().Get(), before) << dropped;
    EXPECT_TRUE(this->Has("welcome/back"));
  }
  this->Do("click welcome/back\nframes 2\nclick node/blur\nkey Delete\n");
  EXPECT_FALSE(this->View->Document().FindNode("", "blur")) << "seen again, it is edited again";
  // Where nothing is behind the page a scene is welcome.
  this->View->New();
  EXPECT_FALSE(this->View->Open("broken.xml"));
  this->Do("drop " + Data + "/Scenes/cornell-box.gltf\nframes 3\n");
  EXPECT_EQ(this->View->Document().Nodes("").size(), 1u);
  EXPECT_FALSE(this->Has("welcome/back"));
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
  o.Reference = this->MakeReference(32, "64"); // more samples of the same scene
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

TEST_F(Viewing, PointsOfTheTradeAreOfOneNodeAndOneFrame)
{
  Viewer::Options o;
  o.Graph.Defines = { { "width", "32" }, { "height", "32" }, { "spp", "1" } };
  o.Reference = this->MakeReference(32, "1");
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  this->Do("click tab/Trade\nwait\n");
  EXPECT_TRUE(this->Has("points/0"));
  // Another frame and another node: each begins a list of its own.
  this->Do("move image\nkey Right\nwait\n");
  EXPECT_TRUE(this->Has("points/0"));
  EXPECT_FALSE(this->Has("points/1")) << "nothing was changed";
  EXPECT_FALSE(this->Has("point/1"));
  const ViewTarget shown = this->View->Target();
  this->Do("click node/pt\nwait\nclick tab/Trade\nwait\n");
  ASSERT_NE(this->View->Target(), shown);
  EXPECT_FALSE(this->Has("points/1"));
  this->Do("click node/" + shown.Node + "\nwait\nclick tab/Trade\nwait\n");
  ASSERT_EQ(this->View->Target().Node, shown.Node);
  EXPECT_TRUE(this->Has("points/0"));
  EXPECT_FALSE(this->Has("points/1")) << "it is the point that it was";
  // A change is a point beside what it changed.
  const auto first = this->View->Document().Get();
  this->View->Document().SetProperty("", "taa", "Alpha", "0.7");
  this->Do("wait\n");
  EXPECT_TRUE(this->Has("points/1"));
  this->Do("move image\nkey Left\nwait\n");
  EXPECT_FALSE(this->Has("points/2"));
  this->Do("move image\nkey Right\nwait\n");
  EXPECT_TRUE(this->Has("points/1"));
  EXPECT_FALSE(this->Has("points/2"));
  this->Do("click points/0@0.3,0.5\nwait\n");
  EXPECT_EQ(*this->View->Document().Get(), *first);
  EXPECT_FALSE(this->Has("points/2"));
  EXPECT_EQ(this->View->Frame()->Tick, 1);
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

// Somebody types faster than a busy machine draws: a field takes in one frame what came since the last.
TEST_F(Viewing, AFieldTakesInOneFrameAllThatWasTyped)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/blur\nkey F2\nframes 4\n");
  const auto key = [&](const std::string& sym, char character = 0)
  {
    for (const bool down : { true, false })
    {
      WindowEvent e;
      e.What = character && down ? WindowEvent::Kind::Text : WindowEvent::Kind::Key;
      e.Sym = sym;
      e.Character = static_cast<unsigned char>(character);
      e.Down = down;
      this->Win->Send(e);
    }
  };
  const std::string name = "a_name_of_thirty-eight_characters_xxyy";
  for (const char c : name)
  {
    key(std::string(1, c), c);
  }
  this->Win->Frame([&] { this->View->Ui(); });
  EXPECT_FALSE(this->Win->HasEvents()) << "38 characters, one frame";
  // Commands stay in their order with the characters, also where a key goes down twice.
  key("BackSpace");
  key("BackSpace");
  key("z", 'z');
  key("Home");
  key("q", 'q');
  key("Delete");
  key("Return");
  int frames = 0;
  while (this->Win->HasEvents() && ++frames < 100)
  {
    this->Win->Frame([&] { this->View->Ui(); });
  }
  this->Do("frames 3\nwait\n");
  EXPECT_TRUE(this->View->Document().FindNode("", "q" + name.substr(1, name.size() - 3) + "z"));
  EXPECT_LT(frames, 14);
  // Letters that no field waits for are commands, each of its own.
  const int tick = int(this->View->Document().Revision());
  this->Do("move graph@0.5,0.95\nkey z ctrl\n");
  EXPECT_NE(int(this->View->Document().Revision()), tick);
  EXPECT_TRUE(this->View->Document().FindNode("", "blur"));
}

TEST_F(Viewing, ScriptsTypeCharactersNotBytes)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do(
    "wait\nclick node/output:beauty\nframes 3\nclick property/file\nkey a ctrl\ntype \u00e9t\u00e9.exr\nkey Return\n");
  EXPECT_EQ(this->View->Document().Get()->Outputs[0].File.Value, "\u00e9t\u00e9.exr");
  std::string error;
  EXPECT_FALSE(this->Run->Do("type \u20ac", error));
  EXPECT_NE(error.find("U+00FF"), std::string::npos);
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

// What a file manager sends, to a window of the X server.
TEST_F(Viewing, FilesAreDroppedByAnotherProgram)
{
  this->OnScreen = true;
  this->Start(900, 640);
  fs::create_directories("some place");
  fs::copy_file(this->Top / "Scenes/cornell-box.gltf", "some place/r\u00f6om (1).gltf");
  for (const auto& e : fs::directory_iterator(this->Top / "Scenes"))
  {
    if (e.path().extension() == ".bin")
    {
      fs::copy(e.path(), fs::path("some place") / e.path().filename());
    }
  }
  const auto pump = [this]
  {
    this->Win->Poll();
    this->Win->Frame([this] { this->View->Ui(); });
  };
  pump();
  const auto window = reinterpret_cast<unsigned long>(this->Win->Get()->GetGenericWindowId());
  ASSERT_EQ(DropFiles(window, 450, 320, { fs::absolute("some place/r\u00f6om (1).gltf").string() }, pump), "");
  pump();
  ASSERT_EQ(this->View->Document().Nodes("").size(), 1u);
  EXPECT_EQ(this->View->Document().Nodes("")[0].Type.Value, "PathTraceSource");
  const PipelineText* scene = this->View->Document().FindProperty("", "pt", "Scene");
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->Value, "some place/r\u00f6om (1).gltf");
  // Two at once: a picture beside the scene.
  ASSERT_EQ(DropFiles(window, 450, 320,
              { Data + "/Images/cornell-box-moving.0031.exr", Data + "/Scenes/cornell-box-moving.gltf" }, pump),
    "");
  pump();
  EXPECT_EQ(this->View->Document().Nodes("").size(), 2u);
  EXPECT_NE(
    this->View->Document().FindProperty("", "pt", "Scene")->Value.find("cornell-box-moving.gltf"), std::string::npos);
}

TEST_F(Viewing, WhatWasCopiedOutlivesTheProgramWhereSomebodyKeepsIt)
{
  ClipboardManager manager;
  {
    Clipboard ours;
    ASSERT_TRUE(ours.IsShared());
    ours.Set("<node id=\"a\" type=\"Sum\"/> \u00e4");
    EXPECT_EQ(manager.Saved(), "") << "not before it ends";
  }
  EXPECT_EQ(manager.Saved(), "<node id=\"a\" type=\"Sum\"/> \u00e4");
  {
    // Who owns nothing hands nothing over.
    Clipboard other, nothing;
    other.Set("theirs");
    nothing.Get();
  }
  EXPECT_EQ(manager.Saved(), "theirs");
}

// Everything of the bar over the picture can be reached, however narrow it is.
TEST_F(Viewing, TheBarOverThePictureFitsIntoNarrowWindows)
{
  struct Case
  {
    int Width;
    double Scale;
  };
  for (const Case& c : { Case{ 1440, 1 }, Case{ 800, 1 }, Case{ 1600, 2 }, Case{ 800, 2 } })
  {
    this->Start(c.Width, 900, c.Scale, Small());
    ASSERT_TRUE(this->View->Open("quick.xml"));
    this->Do("wait\nmove image\nkey p\nkey d\nwait\nframes 3\n");
    if (this->View->GetMarks().count("image/more"))
    {
      this->Do("click image/more\nframes 3\n");
    }
    const ImVec4 picture = this->View->GetMarks().at("image");
    for (const char* name : { "node", "array", "style", "view", "exposure", "compare", "b", "swap", "gain" })
    {
      ASSERT_TRUE(this->View->GetMarks().count(std::string("image/") + name)) << name << " at " << c.Width;
      const ImVec4 r = this->View->GetMarks().at(std::string("image/") + name);
      EXPECT_GT(r.z - r.x, float(40 * c.Scale)) << name << " at " << c.Width;
      EXPECT_LE(r.z, float(c.Width)) << name << " at " << c.Width;
      EXPECT_TRUE(r.z <= picture.z || c.Scale > 1) << name << " at " << c.Width;
    }
  }
}

TEST_F(Viewing, WhatIsAddedIsSeenBesideTheListOfMistakes)
{
  this->Start(1100, 800, 1, Small());
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  this->Do("wait\nmove graph@0.5,0.9\nkey Tab\ntype svgf\nkey Return\nwait\nframes 3\n");
  ASSERT_TRUE(this->View->Document().FindNode("", "svgf"));
  ASSERT_TRUE(this->Has("message/0"));
  const auto inside = [this](const std::string& node)
  {
    const ImVec4 graph = this->View->GetMarks().at("graph"), box = this->View->GetMarks().at("node/" + node);
    return box.x >= graph.x && box.z <= graph.z && box.y >= graph.y && box.w <= graph.w;
  };
  EXPECT_TRUE(inside("svgf"));
  const ImVec4 graph = this->View->GetMarks().at("graph");
  this->Do("click messages/fold\nframes 3\n");
  EXPECT_GT(this->View->GetMarks().at("graph").w, graph.w + 20) << "one line of them";
  // All of a faulty file are seen from the start, although its mistakes are known later.
  this->Do("click messages/fold\n");
  std::ofstream("faulty.xml") << this->View->Document().Text();
  this->Start(700, 560, 1, Small());
  ASSERT_TRUE(this->View->Open("faulty.xml"));
  this->Do("wait\nframes 3\n");
  ASSERT_TRUE(this->Has("message/0"));
  for (const char* node : { "pt", "svgf", "taa", "output:beauty" })
  {
    EXPECT_TRUE(inside(node)) << node;
  }
}

// All that was copied arrives, outputs too, and is seen.
TEST_F(Viewing, WhatIsPastedIsAllThereAndInView)
{
  this->Shares = true;
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  const std::size_t nodes = d.Nodes("").size(), outputs = d.Get()->Outputs.size();
  this->Do("wait\nmove graph@0.5,0.9\nkey a ctrl\nkey c ctrl\nkey n ctrl\nframes 3\n");
  ASSERT_TRUE(d.Nodes("").empty());
  this->Do("move graph@0.95,0.95\nkey v ctrl\nwait\nframes 3\n");
  EXPECT_EQ(d.Nodes("").size(), nodes);
  EXPECT_EQ(d.Get()->Outputs.size(), outputs);
  const ImVec4 graph = this->View->GetMarks().at("graph");
  int boxes = 0;
  for (const auto& m : this->View->GetMarks())
  {
    if (m.first.compare(0, 5, "node/") == 0)
    {
      ++boxes;
      EXPECT_GE(m.second.x, graph.x) << m.first;
      EXPECT_LE(m.second.z, graph.z) << m.first;
      EXPECT_GE(m.second.y, graph.y) << m.first;
      EXPECT_LE(m.second.w, graph.w) << m.first;
    }
  }
  EXPECT_EQ(std::size_t(boxes), nodes + outputs);
  EXPECT_EQ(this->View->ErrorText(), "");
}

TEST_F(Viewing, BoxesStayWhereTheyAreWhenOthersComeAndGo)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  EditDocument& d = this->View->Document();
  ASSERT_TRUE(d.Positions().empty()) << "the shipped file says nothing of places";
  this->Do("wait\nframes 3\n");
  const auto places = [this]
  {
    std::map<std::string, std::pair<int, int>> at;
    const ImVec4 origin = this->View->GetMarks().at("node/pt");
    for (const auto& m : this->View->GetMarks())
    {
      if (m.first.compare(0, 5, "node/") == 0 && m.first != "node/taa" && m.first != "node/sum2")
      {
        at[m.first] = { int(std::lround(m.second.x - origin.x)), int(std::lround(m.second.y - origin.y)) };
      }
    }
    return at;
  };
  const auto before = places();
  this->Do("click node/taa\nkey Delete\nwait\nframes 3\n");
  ASSERT_FALSE(d.FindNode("", "taa"));
  EXPECT_EQ(places(), before);
  this->Do("move graph@0.9,0.95\nkey z ctrl\nwait\nframes 3\n");
  EXPECT_EQ(places(), before);
  EXPECT_TRUE(d.Positions().empty()) << "undo takes the places back, too";
  EXPECT_FALSE(d.IsDirty());
  this->Do("click node/sum\nkey d ctrl\nwait\nframes 3\n");
  EXPECT_EQ(places(), before);
}

TEST_F(Viewing, ALinkOnNothingOffersTheLibrary)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\ndrag out/pt/direct graph@0.5,0.93\nframes 3\n");
  ASSERT_TRUE(this->Has("palette/search"));
  this->Do("type svgf\nframes 3\n");
  ASSERT_TRUE(this->Has("palette/svgf"));
  this->Do("key Return\nwait\n");
  ASSERT_TRUE(d.FindNode("", "svgf"));
  ASSERT_EQ(d.FindNode("", "svgf")->Inputs.size(), 1u);
  EXPECT_EQ(d.FindNode("", "svgf")->Inputs[0].From.Value, "pt:direct");
  EXPECT_EQ(d.FindNode("", "svgf")->Inputs[0].Port.Value, "radiance");
  // The other way round, and only what fits.
  this->Do("drag in/blur/depth graph@0.3,0.06\nframes 2\ntype svgf\nframes 3\n");
  EXPECT_FALSE(this->Has("palette/svgf")) << "it makes no depth";
}

TEST_F(Viewing, AfterADeletionItsInputIsShownUntilItComesBack)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/modulate\nwait\nkey Delete\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "blur");
  this->Do("click node/blur\nkey Delete\nwait\nmove image\nkey z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "blur");
  this->Do("key z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "modulate");
  this->Do("key y ctrl\nwait\nclick node/sum\nmove image\nkey z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "sum") << "somebody chose another one in between";
  // Several at once: the nearest that is left.
  this->Do("click node/modulate\nwait\nkey a ctrl\nclick node/demodulate ctrl\nclick node/pt ctrl\nclick "
           "node/scattered ctrl\nkey Delete\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "demodulate");
  this->Do("move image\nkey z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "modulate");
}

TEST_F(Viewing, UndoOfANameShowsWhatWasShown)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/blur double\nwait\n");
  this->Do("click node/blur\nwait\n");
  ASSERT_EQ(this->View->Target().Node, "blur");
  this->Do("key F2\nframes 2\nkey a ctrl\ntype zed\nkey Return\nwait\n");
  ASSERT_TRUE(this->View->Document().FindNode("", "zed"));
  EXPECT_EQ(this->View->Target().Node, "zed");
  this->Do("key Delete\nwait\n");
  EXPECT_FALSE(this->View->Document().FindNode("", "zed"));
  this->Do("key z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "zed");
  this->Do("key z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "blur");
  this->Do("key y ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "zed");
  this->Do("key z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "blur");
  // Into a template and out of it.
  this->Do("click node/blur\nkey g ctrl\nframes 2\nclick template/make\nwait\n");
  ASSERT_FALSE(this->View->Document().FindNode("", "blur"));
  EXPECT_NE(this->View->Target().Node, "blur");
  this->Do("key z ctrl\nwait\n");
  EXPECT_EQ(this->View->Target().Node, "blur");
}

TEST_F(Viewing, AMistakeKeepsThePlaceInTime)
{
  Viewer::Options o = Small();
  o.Frame = 3;
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  this->Do("wait\n");
  ASSERT_EQ(this->View->Frame()->Tick, 3);
  this->View->Document().SetVariable("frames", "0");
  this->Do("wait\n");
  EXPECT_NE(this->View->ErrorText(), "");
  this->Do("move image\nkey z ctrl\nwait\n");
  EXPECT_EQ(this->View->ErrorText(), "");
  EXPECT_EQ(this->View->Frame()->Tick, 3);
  this->View->Document().SetProperty("", "pt", "Width", "$(nope)");
  this->Do("wait\nkey Right\nwait\nkey z ctrl\nwait\n");
  EXPECT_EQ(this->View->ErrorText(), "");
  EXPECT_EQ(this->View->Frame()->Tick, 4) << "the way through time is the same";
  // Fewer frames are no mistake.
  this->View->Document().SetVariable("frames", "2");
  this->Do("wait\n");
  EXPECT_EQ(this->View->Frame()->Tick, 1);
}

TEST_F(Viewing, WithoutAnOutputTheLastNodeIsShownAndOneLineSaysSo)
{
  std::ofstream("no-output.xml") << "<pipeline version=\"1\">\n  <node id=\"pt\" type=\"PathTraceSource\">"
                                    "<property name=\"Scene\" value=\"../Scenes/cornell-box.gltf\"/><property "
                                    "name=\"Width\" value=\"32\"/><property name=\"Height\" value=\"32\"/></node>\n"
                                    "  <node id=\"blur\" type=\"BilateralFilter\"><input port=\"radiance\" "
                                    "from=\"pt:radiance\"/></node>\n</pipeline>\n";
  this->Start(1100, 800);
  ASSERT_TRUE(this->View->Open("no-output.xml"));
  this->Do("wait\nframes 3\n");
  EXPECT_EQ(this->View->Target().Node, "blur");
  EXPECT_EQ(this->View->ErrorText(), "");
  EXPECT_TRUE(this->Has("message/0"));
  EXPECT_FALSE(this->Has("message/1"));
}

TEST_F(Viewing, VariablesShowWhatTheyStandFor)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\nclick node/pt\nwait\nframes 3\n");
  EXPECT_TRUE(this->Has("property/Width/value = 48  (-D)")) << "-D comes first";
  EXPECT_TRUE(this->Has("property/Scene/value = cornell-box.gltf"));
  fs::copy_file(this->Top / "Scenes/cornell-box.gltf", this->Top / "Scenes/other.gltf");
  this->Do("click property/Scene/choose\nframes 2\nclick files/other.gltf\nclick files/ok\nwait\n");
  ASSERT_FALSE(d.Get()->Variables.empty());
  EXPECT_EQ(d.FindProperty("", "pt", "Scene")->Value, "$(scene)") << "the variable got it";
  EXPECT_TRUE(this->Has("property/Scene/value = other.gltf"));
}

// What the command line gives is what the panels show, until it is edited; the file keeps its own.
TEST_F(Viewing, ValuesOfTheCommandLineAreShownAndCanBeEdited)
{
  Viewer::Options options = this->Small();
  options.Graph.Properties = { { "blur.SigmaRange", "0.9" }, { "blur.Radius", "2" } };
  this->Start(1300, 1000, 1, options);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  const std::string file = this->Written("quick.xml");
  this->Do("wait\nclick node/blur\nwait\nframes 3\n");
  const std::string inFile =
    d.FindProperty("", "blur", "SigmaRange")
      ? "the file has " + d.FindProperty("", "blur", "SigmaRange")->Value
      : "default " + Registry().Describe("BilateralFilter")->FindProperty("SigmaRange")->DefaultText;
  EXPECT_TRUE(this->Has("property/SigmaRange/value --set; " + inFile));
  EXPECT_FALSE(d.IsDirty());
  const auto first = this->View->Pictures();
  // An edit counts.
  this->Do("click property/SigmaRange ctrl\nkey a ctrl\ntype 0.05\nkey Return\nwait\nframes 2\n");
  ASSERT_TRUE(d.FindProperty("", "blur", "SigmaRange"));
  EXPECT_EQ(d.FindProperty("", "blur", "SigmaRange")->Value, "0.05");
  EXPECT_FALSE(this->Has("property/SigmaRange/value --set; the file has 0.05"));
  EXPECT_TRUE(this->Has("told/blur.SigmaRange: --set 0.9 of the command line counts no longer"));
  const auto second = this->View->Pictures();
  ASSERT_TRUE(first && second);
  EXPECT_NE(first->A.Rgba, second->A.Rgba) << "the picture follows";
  // So does the file's own value, by the button, without a change of the file.
  this->Do("key z ctrl\nwait\nclick property/Radius/reset\nwait\n");
  EXPECT_FALSE(d.IsDirty());
  EXPECT_TRUE(this->Has("told/blur.Radius: --set 2 of the command line counts no longer"));
  // Variables likewise; another one stays.
  this->View->ShowTab("Pipeline");
  this->Do("frames 3\n");
  EXPECT_TRUE(this->Has("variable/width/value -D; the file has 192"));
  EXPECT_EQ(this->View->Pictures()->A.Width, 48);
  this->Do("click variable/width double\nkey a ctrl\ntype 32\nkey Return\nwait\nframes 2\n");
  EXPECT_EQ(this->View->Pictures()->A.Width, 32);
  EXPECT_EQ(this->View->Pictures()->A.Height, 48);
  EXPECT_FALSE(this->Has("variable/width/reset"));
  EXPECT_TRUE(this->Has("variable/height/reset"));
  this->Do("key z ctrl\nclick variable/height/reset\nwait\nframes 2\n");
  EXPECT_EQ(this->View->Pictures()->A.Height, 192);
  EXPECT_EQ(d.Text(), file) << "saving writes the file's own values";
  // A node that goes takes its --set along, and finds it again.
  this->Do("click node/blur\nkey Delete ctrl\nwait\n");
  EXPECT_EQ(this->View->ErrorText(), "");
}

TEST_F(Viewing, LinesOverThePictureLieBelowEachOther)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nmove image\nkey w\nwait\n");
  this->View->Document().SetProperty("", "pt", "Scene", "nowhere.gltf");
  this->Do("wait\nframes 3\n");
  std::vector<ImVec4> labels;
  for (const auto& m : this->View->GetMarks())
  {
    if (m.first.compare(0, 6, "label/") == 0)
    {
      labels.push_back(m.second);
    }
  }
  ASSERT_GE(labels.size(), 3u) << "the name, what B is, and the error";
  for (std::size_t i = 0; i < labels.size(); ++i)
  {
    for (std::size_t k = 0; k < i; ++k)
    {
      EXPECT_FALSE(labels[i].x < labels[k].z && labels[k].x < labels[i].z && labels[i].y < labels[k].w &&
                   labels[k].y < labels[i].w)
        << i << " on " << k;
    }
  }
}

TEST_F(Viewing, PinningAPixelRunsNothing)
{
  Viewer::Options o = Small();
  o.Graph.Defines.back().second = "1"; // of which there are no two halves
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nclick node/pt\nwait\n");
  const std::uint64_t number = this->View->Frame()->Number;
  this->Do("click tab/Pixel\nwait\nclick image@0.5,0.5\nwait\nframes 3\n");
  EXPECT_EQ(this->View->Frame()->Number, number);
  EXPECT_TRUE(this->View->Frame()->Warnings.empty());
  // All of them for who asks.
  vtkPointData* arrays = this->View->Frame()->Image("pt")->GetPointData();
  const int few = arrays->GetNumberOfArrays();
  this->Do("click pixel/all\nwait\n");
  EXPECT_GT(this->View->Frame()->Image("pt")->GetPointData()->GetNumberOfArrays(), few + 10);
  this->Do("click pixel/few\nwait\n");
  this->View->Document().SetProperty("", "pt", "Seed", "9");
  this->Do("wait\n");
  EXPECT_EQ(this->View->Frame()->Image("pt")->GetPointData()->GetNumberOfArrays(), few);
}

TEST_F(Viewing, ADifferenceSaysHowLargeItIs)
{
  Viewer::Options o = Small();
  o.Show = "sum";
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\nmove image\nkey k\nkey d\nwait\nframes 2\n");
  EXPECT_TRUE(this->View->Pictures()->Difference.Known);
  EXPECT_EQ(this->View->Pictures()->Difference.Largest, 0);
  this->View->Document().SetProperty("", "blur", "SigmaSpatial", "5");
  this->Do("wait\nmove image@0.5,0.5\nframes 2\n");
  EXPECT_GT(this->View->Pictures()->Difference.Largest, 0);
  EXPECT_GT(this->View->Pictures()->Difference.Largest, this->View->Pictures()->Difference.Mean);
  const Marks& marks = this->View->GetMarks();
  const auto values = marks.lower_bound("image/values A ");
  ASSERT_NE(values, marks.end());
  EXPECT_NE(values->first.find("   B "), std::string::npos) << values->first;
  EXPECT_NE(values->first.find("   A-B "), std::string::npos);
}

TEST_F(Viewing, AWrongNameIsExplainedWhereItIsTyped)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\nclick node/blur\nwait\nclick property/name\nkey a ctrl\ntype sum\nkey Return\nframes 3\n");
  EXPECT_TRUE(d.FindNode("", "blur"));
  ASSERT_TRUE(this->Has("error/blur.name"));
  const ImVec4 field = this->View->GetMarks().at("property/name"), error = this->View->GetMarks().at("error/blur.name");
  EXPECT_LT(error.y - field.w, 20) << "just below";
  this->Do("click node/modulate\nkey Delete\nwait\nclick node/blur\nframes 3\n");
  EXPECT_FALSE(this->Has("error/blur.name")) << "gone with the next edit";
  // In the graph the field stays until there is a name that goes.
  this->Do("click node/blur\nkey F2\nkey a ctrl\ntype sum\nkey Return\nframes 3\n");
  ASSERT_TRUE(this->Has("rename"));
  EXPECT_TRUE(this->Has("error/blur.rename"));
  this->Do("key a ctrl\ntype soft\nkey Return\nframes 3\n");
  EXPECT_TRUE(d.FindNode("", "soft"));
  EXPECT_FALSE(this->Has("rename"));
}

TEST_F(Viewing, PortsOfATemplateAreRenamed)
{
  this->Start(1300, 1000, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  EditDocument& d = this->View->Document();
  this->Do("wait\nclick node/blur\nkey g ctrl\nframes 3\nkey a ctrl\ntype soft\nkey Return\nwait\nclick node/soft "
           "double\nframes 3\nwait\nclick tab/Node\nclick graph@0.02,0.98\nframes 3\n");
  const std::string port = d.FindTemplate("soft")->Inputs.front().Name.Value;
  this->Do("click port/rename/" + port + "\nkey a ctrl\ntype light\nkey Return\nwait\n");
  EXPECT_EQ(d.FindTemplate("soft")->Inputs.front().Name.Value, "light");
  EXPECT_EQ(this->View->ErrorText(), "");
  this->Do("click port/rename/light\nkey a ctrl\ntype out\nkey Return\nframes 3\n");
  EXPECT_EQ(d.FindTemplate("soft")->Inputs.front().Name.Value, "light");
  EXPECT_TRUE(this->Has("error/port:soft.light"));
  // And in the graph.
  this->Do("click node/port:out\nkey F2\nkey a ctrl\ntype picture\nkey Return\nwait\n");
  EXPECT_EQ(d.FindTemplate("soft")->Outputs.front().Name.Value, "picture");
  this->Do("click graph/up\nwait\n");
  EXPECT_EQ(this->View->ErrorText(), "");
}

TEST_F(Viewing, APictureWithoutRadianceShowsWhatItHas)
{
  ReadOptions only;
  only.Arrays = { "normal" };
  vtkSmartPointer<vtkImageData> image =
    ReadImageFile(Data + "/Images/cornell-box-moving.0031.exr", nullptr, ReadOptions());
  image->GetPointData()->GetArray(0)->SetName("normal");
  WriteImageFile("normals.exr", image, { { "normal", "", ArrayKind::Normal, nullptr } });
  this->Start(1100, 800);
  ASSERT_TRUE(this->View->Open("normals.exr"));
  this->Do("wait\n");
  EXPECT_EQ(this->View->Target().Array, "normal");
  EXPECT_EQ(this->View->ErrorText(), "");
}

// Nothing is written that nobody saves: not beside the file, and nowhere but the layout that is remembered.
TEST_F(Viewing, WritesNothingByItself)
{
  const auto listing = [this]
  {
    std::map<std::string, std::string> files;
    for (const auto& e : fs::recursive_directory_iterator(this->Top))
    {
      files[e.path().string()] = e.is_regular_file() ? this->Written(e.path().string()) : std::string();
    }
    return files;
  };
  const auto before = listing();
  const fs::path settings = this->Top.string() + "-settings";
  fs::remove_all(settings);
  Viewer::Options o = Small();
  o.SettingsFile = (settings / "view.ini").string();
  this->Start(1300, 900, 1, o);
  ASSERT_TRUE(this->View->Open("svgf.xml"));
  // Outputs of the pipeline belong to runs; edits, copies and a question about them to nobody's disk.
  this->Do("wait\nclick node/taa\nkey Delete\nwait\nkey z ctrl\nwait\nkey space\nframes 20\nkey space\nwait\n"
           "click node/sum\nkey c ctrl\nmove graph@0.5,0.95\nkey v ctrl\nwait\nclick tab/Pixel\nclick "
           "image@0.5,0.5\nwait\nclick tab/Trade\nframes 3\nkey s ctrl shift\nframes 3\nclick files/cancel\nkey q "
           "ctrl\nframes 2\nclick ask/discard\n");
  EXPECT_TRUE(this->Win->IsClosing());
  this->View.reset();
  EXPECT_EQ(listing(), before);
  std::vector<std::string> kept;
  for (const auto& e : fs::directory_iterator(settings))
  {
    kept.push_back(e.path().filename().string());
  }
  EXPECT_EQ(kept, std::vector<std::string>{ "view.ini" });
  fs::remove_all(settings);
}

TEST_F(Viewing, NothingIsWrittenOverWithoutTheButtonThatSaysSo)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  const std::string other = this->Written("svgf.xml");
  this->Do("wait\nkey s ctrl shift\nframes 2\nclick files/name\nkey a ctrl\ntype svgf.xml\nkey Return\nframes 3\n");
  EXPECT_EQ(this->Written("svgf.xml"), other);
  EXPECT_TRUE(this->Has("files/ok")) << "the dialog is still open";
  this->Do("key a ctrl\ntype svgf\nkey Return\nframes 3\n");
  EXPECT_EQ(this->Written("svgf.xml"), other) << "the ending is added";
  EXPECT_TRUE(this->Has("files/ok"));
  this->Do("click files/svgf.xml double\nframes 3\n");
  EXPECT_EQ(this->Written("svgf.xml"), other);
  EXPECT_TRUE(this->Has("files/ok"));
  // A save that fails leaves the dialog and the name.
  this->Do("click files/name\nkey a ctrl\ntype /proc/x.xml\nclick files/ok\nframes 3\n");
  EXPECT_TRUE(this->Has("files/ok"));
  this->Do("click files/name\nkey a ctrl\ntype " + (this->Top / "Pipelines/svgf.xml").string() +
           "\nclick files/ok\nframes 3\n");
  EXPECT_NE(this->Written("svgf.xml"), other);
  EXPECT_FALSE(this->Has("files/ok"));
}

TEST_F(Viewing, AsksBeforeItWritesOverWhatAnotherProgramWrote)
{
  this->Start(1300, 900, 1, Small());
  ASSERT_TRUE(this->View->Open("quick.xml"));
  this->Do("wait\n");
  this->View->Document().SetVariable("spp", "5");
  std::ofstream("quick.xml", std::ios::app) << "<!-- theirs -->\n";
  const std::string theirs = this->Written("quick.xml");
  this->Do("key s ctrl\nframes 3\n");
  EXPECT_TRUE(this->Has("changed/cancel"));
  this->Do("click changed/cancel\nframes 2\n");
  EXPECT_EQ(this->Written("quick.xml"), theirs);
  EXPECT_TRUE(this->View->Document().IsDirty());
  this->Do("key s ctrl\nframes 3\nclick changed/open\nwait\n");
  EXPECT_EQ(this->Written("quick.xml"), theirs);
  EXPECT_FALSE(this->View->Document().IsDirty());
  this->View->Document().SetVariable("spp", "6");
  std::ofstream("quick.xml", std::ios::app) << "<!-- again -->\n";
  this->Do("key s ctrl\nframes 3\nclick changed/replace\nframes 2\n");
  EXPECT_EQ(this->Written("quick.xml").find("again"), std::string::npos);
  EXPECT_FALSE(this->View->Document().IsDirty());
}

TEST_F(Viewing, LongTextsBreakBetweenWords)
{
  this->Start(900, 620);
  const float width = ImGui::CalcTextSize("there is no node \"summ\" ").x;
  const std::string words = "there is no node \"summ\"; did you mean \"sum\"? so it goes on";
  std::istringstream lines(Wrapped(words, width));
  std::string all;
  int count = 0;
  for (std::string line; std::getline(lines, line); ++count)
  {
    EXPECT_LE(ImGui::CalcTextSize(line.c_str()).x, width) << line;
    EXPECT_NE(line[0], ';');
    all += (all.empty() ? "" : " ") + line;
  }
  EXPECT_EQ(all, words) << "broken at spaces only";
  EXPECT_GE(count, 3);
  EXPECT_EQ(Wrapped("a\nb c", 1000), "a\nb c");
  const std::string path = Wrapped("../../some/where/else/in/a/directory.gltf", width);
  EXPECT_NE(path.find("/\n"), std::string::npos) << path;
  EXPECT_EQ(path.find(".\n"), std::string::npos) << path;
}

TEST(Texts, RangesAndValuesThatAreNoAmounts)
{
  const auto property = [](const char* type, const char* name)
  { return *Registry().Describe(type)->FindProperty(name); };
  EXPECT_EQ(RangeOf(property("BilateralFilter", "SigmaSpatial")), "0 or more");
  EXPECT_EQ(RangeOf(property("BilateralFilter", "Radius")), "[-1, 64]");
  EXPECT_EQ(MeaningOf(property("BilateralFilter", "Radius"), -1), "ceil(3 SigmaSpatial), at most 64");
  EXPECT_EQ(MeaningOf(property("BilateralFilter", "Radius"), 0), "identity");
  EXPECT_EQ(MeaningOf(property("BilateralFilter", "Radius"), 3), "");
  EXPECT_EQ(MeaningOf(property("PathTraceSource", "Width"), 0), "the scene's resolution, else 256");
  EXPECT_EQ(MeaningOf(property("PathTraceSource", "MaximumBounces"), 1), "direct light");
  EXPECT_EQ(MeaningOf(property("FireflyClamp", "Threshold"), 1e30), "off");
}

TEST(CommandLine, WhatDoesNotFitIsExplainedBeforeAWindowOpens)
{
  const auto fault = [](const std::string& file, const std::function<void(Viewer::Options&)>& set)
  {
    Viewer::Options o;
    set(o);
    return CheckCommandLine(Data + "/Pipelines/" + file, o, Registry());
  };
  const auto says = [](const CommandLineFault& f, int status, const std::string& text)
  {
    EXPECT_EQ(f.Status, status) << f.Text;
    EXPECT_NE(f.Text.find(text), std::string::npos) << f.Text;
  };
  says(fault("quick.xml", [](auto& o) { o.Show = "blurr"; }), 2, "--show blurr: ");
  says(fault("quick.xml", [](auto& o) { o.Show = "blurr"; }), 2, "did you mean \"blur\"?");
  says(fault("quick.xml", [](auto& o) { o.Show = "pt:radience"; }), 2, "did you mean \"radiance\"?");
  says(fault("quick.xml", [](auto& o) { o.Show = "nope"; }), 2, "beauty, preview, pt, ");
  says(fault("svgf.xml", [](auto& o) { o.Show = "direct:aut"; }), 2, "did you mean \"out\"?");
  says(fault("svgf.xml", [](auto& o) { o.Show = "direct/atros"; }), 2, "did you mean \"direct/atrous\"?");
  says(fault("svgf.xml", [](auto& o) { o.Frame = 99; }), 2, "frames go from 0 to 31");
  says(fault("svgf.xml", [](auto& o) { o.Graph.Defines = { { "with", "3" } }; }), 2, "did you mean \"width\"?");
  says(fault("svgf.xml", [](auto& o) { o.Graph.Properties = { { "taa.Alfa", "3" } }; }), 2, "Alpha");
  says(fault("svgf.xml", [](auto& o) { o.Reference = "nope.exr"; }), 1, "seen from " + fs::current_path().string());
  says(fault("svgf.xml", [](auto& o) { o.Reference = QUELL_SOURCE_DIR "/README.md"; }), 1, "README.md");
  for (const char* good :
    { "beauty", "taa", "pt:depth", "direct", "direct:out", "direct/atrous", "direct/atrous:radiance" })
  {
    EXPECT_EQ(fault("svgf.xml", [&](auto& o) { o.Show = good; }).Text, "");
  }
  EXPECT_EQ(fault("svgf.xml",
              [](auto& o)
              {
                o.Frame = 31;
                o.Graph.Defines = { { "width", "32" } };
                o.Reference = Data + "/Images/cornell-box-moving.0031.exr";
              })
              .Text,
    "");
  EXPECT_EQ(fault("nowhere.xml", [](auto& o) { o.Show = "x"; }).Text, "") << "the viewer says what is wrong with files";
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
  this->Do("wait\nclick tab/Pixel\nwait\nclick image@0.5,0.5\nwait\nclick pixel/all\nwait\nmove 300,940\nframes 3\n");
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
