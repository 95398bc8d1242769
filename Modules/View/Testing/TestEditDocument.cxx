// SPDX-License-Identifier: BSD-3-Clause
#include "AllStages.h"
#include "quellEditDocument.h"
#include "quellGraphModel.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
std::string Shipped(const char* name)
{
  return std::string(QUELL_SOURCE_DIR) + "/Data/Pipelines/" + name;
}

std::string Contents(const std::string& file)
{
  std::ifstream stream(file, std::ios::binary);
  std::stringstream text;
  text << stream.rdbuf();
  return text.str();
}

EditDocument Opened(const char* name)
{
  EditDocument d(&Registry());
  std::vector<Diagnostic> messages;
  EXPECT_TRUE(d.Open(Shipped(name), messages));
  EXPECT_TRUE(messages.empty());
  return d;
}

int Errors(const EditDocument& d)
{
  Diagnostics messages;
  BuildGraph(d.Get(), Registry(), {}, messages);
  return messages.ErrorCount();
}

fs::path Scratch(const char* name)
{
  const fs::path dir = fs::path(testing::TempDir()) / "quell-edit" / name;
  fs::remove_all(dir);
  fs::create_directories(dir);
  return dir;
}
}

TEST(EditDocument, OpeningAndSavingChangesNoByte)
{
  const fs::path file = Scratch("same") / "svgf.xml";
  for (const char* name : { "svgf.xml", "quick.xml", "library.xml" })
  {
    fs::copy_file(Shipped(name), file, fs::copy_options::overwrite_existing);
    EditDocument d;
    std::vector<Diagnostic> messages;
    ASSERT_TRUE(d.Open(file.string(), messages));
    EXPECT_FALSE(d.IsDirty());
    std::string error;
    ASSERT_TRUE(d.Save(file.string(), error)) << error;
    EXPECT_EQ(Contents(file.string()), Contents(Shipped(name)));
  }
}

TEST(EditDocument, AMovedBoxIsKeptBesideTheText)
{
  EditDocument d = Opened("quick.xml");
  const auto before = d.Get();
  d.Move("", { { "blur", { 300.2, 40 } } });
  EXPECT_EQ(d.Get(), before) << "nothing runs again for it";
  EXPECT_TRUE(d.IsDirty());
  const fs::path file = Scratch("moved") / "a.xml";
  const std::string text = d.Text();
  EXPECT_EQ(WithPipelinePositions(text, {}), Contents(Shipped("quick.xml")));
  EXPECT_EQ(ReadPipelinePositions(text).at("blur"), (std::pair<double, double>(300, 40)));
  d.Undo();
  EXPECT_FALSE(d.IsDirty());
}

TEST(EditDocument, UndoAndRedoWalkThroughEveryState)
{
  EditDocument d = Opened("quick.xml");
  std::vector<std::string> states{ d.Text() };
  const auto step = [&] { states.push_back(d.Text()); };
  const std::string id = d.AddNode("", "FireflyClamp", 10, 20);
  step();
  std::string error;
  ASSERT_TRUE(d.Connect("", "pt:radiance", id, "radiance", false, false, error)) << error;
  step();
  d.SetProperty("", "blur", "SigmaRange", "0.75");
  step();
  ASSERT_TRUE(d.Rename("", "pt", "tracer", error)) << error;
  step();
  ASSERT_TRUE(d.Remove("", { "blur", id }));
  step();
  ASSERT_TRUE(d.SetVariable("spp", "4"));
  step();
  for (std::size_t i = states.size(); i-- > 1;)
  {
    EXPECT_EQ(d.Text(), states[i]);
    d.Undo();
  }
  EXPECT_EQ(d.Text(), states[0]);
  EXPECT_FALSE(d.CanUndo());
  EXPECT_FALSE(d.IsDirty());
  for (std::size_t i = 1; i < states.size(); ++i)
  {
    d.Redo();
    EXPECT_EQ(d.Text(), states[i]);
  }
  EXPECT_FALSE(d.CanRedo());
}

TEST(EditDocument, ASliderThatIsDraggedIsOneStep)
{
  EditDocument d = Opened("quick.xml");
  const std::string before = d.Text();
  for (const char* v : { "0.6", "0.7", "0.8" })
  {
    d.SetProperty("", "blur", "SigmaRange", v, true);
  }
  d.EndMerge();
  d.SetProperty("", "blur", "SigmaRange", "0.9", true);
  d.Undo();
  EXPECT_EQ(d.FindProperty("", "blur", "SigmaRange")->Value, "0.8");
  d.Undo();
  EXPECT_EQ(d.Text(), before);
}

TEST(EditDocument, RenamingFollowsEveryReference)
{
  EditDocument d = Opened("svgf.xml");
  std::string error;
  ASSERT_TRUE(d.Rename("", "taa", "smooth", error)) << error;
  EXPECT_EQ(Errors(d), 0);
  EXPECT_EQ(d.Get()->Outputs[0].From.Value, "smooth:radiance");
  ASSERT_TRUE(d.Rename("", "output:beauty", "final", error)) << error;
  EXPECT_EQ(d.Get()->Outputs[0].Name.Value, "final");
  EXPECT_FALSE(d.Rename("", "smooth", "sum", error));
  EXPECT_NE(error.find("\"sum\""), std::string::npos);
  EXPECT_FALSE(d.Rename("", "smooth", "1st", error));
  EXPECT_FALSE(d.Rename("", "nobody", "x", error));
  // "s" is no "sum": only whole names count.
  EditDocument e;
  const std::string a = e.AddNode("", "ImageReader", 0, 0, "s"), b = e.AddNode("", "ImageReader", 0, 0, "su");
  const std::string sum = e.AddNode("", "Sum", 0, 0, "sum");
  e.Connect("", "s:radiance", sum, "radiance", false, true, error);
  e.Connect("", "su:radiance", sum, "radiance", false, true, error);
  ASSERT_TRUE(e.Rename("", a, "x", error));
  EXPECT_EQ(e.FindNode("", "sum")->Inputs[0].From.Value, "x:radiance");
  EXPECT_EQ(e.FindNode("", "sum")->Inputs[1].From.Value, "su:radiance");
}

TEST(EditDocument, DeletingTakesLinksAlongOrBridgesThem)
{
  EditDocument d = Opened("quick.xml");
  ASSERT_TRUE(d.Remove("", { "blur" }, true));
  EXPECT_EQ(d.FindNode("", "modulate")->Inputs[0].From.Value, "demodulate:illumination");
  EXPECT_EQ(Errors(d), 0);
  d.Undo();
  ASSERT_TRUE(d.Remove("", { "blur" }));
  EXPECT_EQ(d.FindNode("", "modulate")->Inputs.size(), 1u);
  EXPECT_GT(Errors(d), 0);
  EXPECT_FALSE(d.Remove("", { "blur" }));
  ASSERT_TRUE(d.Remove("", { "sum" }));
  EXPECT_FALSE(d.Get()->Outputs[0].From.Given);
  ASSERT_TRUE(d.Remove("", { "output:beauty" }));
  EXPECT_EQ(d.Get()->Outputs.size(), 1u);
}

TEST(EditDocument, ReconnectingTakesAllLayersOrSaysWhatIsLost)
{
  EditDocument d = Opened("quick.xml");
  std::string unread = "?";
  ASSERT_TRUE(d.Remove("", { "blur" }, true, &unread));
  EXPECT_EQ(unread, "") << "guides are no pictures";
  d.Undo();
  // Demodulation takes one picture, an output too.
  ASSERT_TRUE(d.Remove("", { "scattered" }, true, &unread));
  EXPECT_EQ(d.FindNode("", "demodulate")->Inputs[0].From.Value, "pt:direct");
  EXPECT_EQ(unread, "demodulate: pt:direct goes on, pt:indirect is no longer read");
  d.Undo();
  ASSERT_TRUE(d.Remove("", { "sum" }, true, &unread));
  EXPECT_EQ(d.Get()->Outputs[0].From.Value, "modulate:radiance");
  EXPECT_EQ(unread, "beauty, preview: modulate:radiance goes on, pt:emission is no longer read");
  d.Undo();
  // What goes itself is not missed.
  ASSERT_TRUE(d.Remove("", { "scattered", "pt" }, true, &unread));
  EXPECT_EQ(unread, "");
  d.Undo();
  // A sum takes them all.
  std::string error;
  const std::string more = d.AddNode("", "Sum", 0, 0);
  ASSERT_TRUE(d.Connect("", "scattered:radiance", more, "radiance", false, true, error));
  ASSERT_TRUE(d.Connect("", "pt:emission", more, "radiance", false, true, error));
  ASSERT_TRUE(d.Remove("", { "scattered" }, true, &unread));
  const std::vector<PipelineInput>& inputs = d.FindNode("", more)->Inputs;
  ASSERT_EQ(inputs.size(), 3u);
  EXPECT_EQ(inputs[0].From.Value, "pt:direct");
  EXPECT_EQ(inputs[1].From.Value, "pt:indirect");
  EXPECT_EQ(inputs[2].From.Value, "pt:emission");
  EXPECT_EQ(unread, "demodulate: pt:direct goes on, pt:indirect is no longer read");
}

TEST(EditDocument, CopiesKeepTheLinksAmongThem)
{
  EditDocument d = Opened("quick.xml");
  const std::vector<std::string> copies = d.Duplicate("", { "demodulate", "blur" }, 10, 10);
  ASSERT_EQ(copies, (std::vector<std::string>{ "demodulate2", "blur2" }));
  EXPECT_EQ(d.FindNode("", "blur2")->Inputs[0].From.Value, "demodulate2:illumination");
  EXPECT_EQ(d.FindNode("", "demodulate2")->Inputs[0].From.Value, "scattered:radiance");
  EXPECT_EQ(d.Duplicate("", { "blur", "blur2" }, 1, 1).size(), 2u);
  std::set<std::string> ids;
  for (const PipelineNode& n : d.Nodes(""))
  {
    EXPECT_TRUE(ids.insert(n.Id.Value).second) << n.Id.Value;
  }
}

TEST(EditDocument, DuplicatesTakeOutputsAlong)
{
  EditDocument d = Opened("quick.xml");
  d.Move("", { { "sum", { 100, 50 } }, { "output:beauty", { 300, 60 } } });
  const std::vector<std::string> made = d.Duplicate("", { "sum", "output:beauty" }, 40, 40);
  EXPECT_EQ(made, (std::vector<std::string>{ "sum2", "output:beauty2" }));
  ASSERT_EQ(d.Get()->Outputs.size(), 3u);
  EXPECT_EQ(d.Get()->Outputs[2].From.Value, "sum2:radiance");
  EXPECT_EQ(d.Get()->Outputs[2].File.Value, "out/quick-2.exr") << "two outputs cannot go into one file";
  EXPECT_EQ(d.Positions().at("output:beauty2"), std::make_pair(340., 100.));
  EXPECT_EQ(d.FindNode("", "sum2")->Inputs[0].From.Value, "modulate:radiance");
  EXPECT_EQ(d.UndoLabel(), "duplicate 2 nodes");
  EXPECT_EQ(Errors(d), 0);
  d.Undo();
  EXPECT_EQ(d.Get()->Outputs.size(), 2u);
  EXPECT_FALSE(d.FindNode("", "sum2"));
}

TEST(EditDocument, NodesTravelAsXml)
{
  EditDocument d = Opened("quick.xml");
  d.Move("", { { "demodulate", { 100, 50 } }, { "blur", { 300, 80 } } });
  const std::string xml = d.CopyXml("", { "demodulate", "blur" });
  EXPECT_NE(xml.find("<node id=\"blur\""), std::string::npos);
  EditDocument other;
  std::string error;
  const auto made = other.PasteXml("", xml, 10, 20, error);
  ASSERT_EQ(made.size(), 2u) << error;
  EXPECT_EQ(other.Positions().at("demodulate"), (std::pair<double, double>(10, 20)));
  EXPECT_EQ(other.Positions().at("blur"), (std::pair<double, double>(210, 50)));
  const auto again = other.PasteXml("", xml, 0, 0, error);
  EXPECT_EQ(again, (std::vector<std::string>{ "demodulate2", "blur2" }));
  EXPECT_EQ(other.FindNode("", "blur2")->Inputs[0].From.Value, "demodulate2:illumination");
  EXPECT_EQ(other.PasteXml("", "<node id=\"one\" type=\"Sum\"/>", 0, 0, error), (std::vector<std::string>{ "one" }));
  EXPECT_TRUE(other.PasteXml("", "some words", 0, 0, error).empty());
  EXPECT_NE(error, "");
  EXPECT_TRUE(other.PasteXml("", "<pipeline version=\"1\"/>", 0, 0, error).empty());
}

TEST(EditDocument, OutputsTravelWithTheirNodes)
{
  EditDocument d = Opened("quick.xml");
  std::size_t count = 0;
  const std::string xml = d.CopyXml("", { "modulate", "sum", "output:beauty" }, &count);
  EXPECT_EQ(count, 3u);
  EditDocument other;
  std::string error;
  EXPECT_EQ(other.PasteXml("", xml, 0, 0, error), (std::vector<std::string>{ "modulate", "sum", "output:beauty" }))
    << error;
  ASSERT_EQ(other.Get()->Outputs.size(), 1u);
  EXPECT_EQ(other.Get()->Outputs[0].From.Value, d.Get()->Outputs[0].From.Value);
  // What they read of variables comes along; what is there stays as it is.
  const std::string source = d.CopyXml("", { "pt" });
  ASSERT_TRUE(other.AddVariable("width", "int", "77", error)) << error;
  EXPECT_EQ(other.PasteXml("", source, 0, 0, error), (std::vector<std::string>{ "pt" })) << error;
  std::map<std::string, std::string> variables;
  for (const PipelineVariable& v : other.Get()->Variables)
  {
    variables[v.Name.Value] = v.Default.Value;
  }
  EXPECT_EQ(variables.at("width"), "77");
  EXPECT_EQ(variables.at("scene"), "../Scenes/cornell-box.gltf");
  EXPECT_EQ(variables.count("frames"), 0u) << "no node reads it";
  // Beside what is there: another name, another file, the copy's node.
  const auto made = d.PasteXml("", xml, 0, 0, error);
  EXPECT_EQ(made, (std::vector<std::string>{ "modulate2", "sum2", "output:beauty2" }));
  const PipelineOutput& copy = d.Get()->Outputs.back();
  EXPECT_EQ(copy.From.Value.substr(0, 4), "sum2");
  EXPECT_EQ(copy.File.Value, "out/quick-2.exr");
  EXPECT_NE(copy.File.Value, d.Get()->Outputs[0].File.Value);
  EXPECT_EQ(Errors(d), 0);
  // The number stands before the frame's.
  EditDocument frames = Opened("svgf.xml");
  const std::string one = frames.CopyXml("", { "output:beauty" });
  ASSERT_EQ(frames.PasteXml("", one, 0, 0, error).size(), 1u) << error;
  EXPECT_EQ(frames.Get()->Outputs.back().File.Value, "out/svgf-2.####.exr");
  EXPECT_EQ(frames.Get()->Outputs.back().From.Value, frames.Get()->Outputs[0].From.Value);
  EXPECT_TRUE(frames.PasteXml("svgf", one, 0, 0, error).empty()) << "a template writes no files";
}

TEST(EditDocument, BoxesKeepThePlacesTheyAreShownAt)
{
  EditDocument d = Opened("quick.xml");
  PipelinePositions shown;
  for (const PipelineNode& n : d.Nodes(""))
  {
    shown[n.Id.Value] = { 100. * double(shown.size()), 40 };
  }
  shown["output:beauty"] = { 900, 40 };
  shown["stranger"] = { 1, 1 };
  d.SetShownPlaces(shown);
  EXPECT_FALSE(d.IsDirty());
  d.SetProperty("", "blur", "SigmaSpatial", "3");
  EXPECT_TRUE(d.Positions().empty()) << "no box came or went";
  const auto blur = shown.at("blur");
  std::string error;
  ASSERT_TRUE(d.Rename("", "blur", "soft", error)) << error;
  EXPECT_EQ(d.Positions().at("soft"), blur);
  EXPECT_EQ(d.Positions().count("blur"), 0u);
  EXPECT_EQ(d.Positions().count("stranger"), 0u);
  EXPECT_EQ(d.Positions().at("output:beauty"), shown.at("output:beauty"));
  d.Undo();
  EXPECT_TRUE(d.Positions().empty());
  d.Remove("", { "blur" });
  EXPECT_EQ(d.Positions().count("blur"), 0u);
  EXPECT_EQ(d.Positions().at("pt"), shown.at("pt"));
  // A place of its own is not touched.
  d.Undo();
  d.Move("", { { "pt", { 7, 8 } } });
  d.AddNode("", "Sum", 0, 0);
  EXPECT_EQ(d.Positions().at("pt"), (std::pair<double, double>(7, 8)));
  EXPECT_EQ(d.Positions().at("blur"), shown.at("blur"));
}

TEST(EditDocument, InsertingOnALinkIsOneStep)
{
  EditDocument d = Opened("quick.xml");
  const GraphModel m = GraphModel::Build(d, "", Registry());
  const StageDescription& clamp = *Registry().Describe("FireflyClamp");
  for (const GraphLink& l : m.Links)
  {
    if (m.Boxes[std::size_t(l.To)].Id == "demodulate" && l.Index == 0)
    {
      int port = -1;
      std::string array, reason;
      ASSERT_TRUE(m.FitsOnLink(clamp, l, port, array, reason)) << reason;
      const std::string id = d.InsertOnLink("", "demodulate", 0, clamp, port, array, 5, 6);
      ASSERT_NE(id, "");
      EXPECT_EQ(d.FindNode("", id)->Inputs[0].From.Value, "scattered:radiance");
      EXPECT_EQ(d.FindNode("", "demodulate")->Inputs[0].From.Value, id + ":radiance");
      EXPECT_EQ(Errors(d), 0);
      d.Undo();
      EXPECT_FALSE(d.IsDirty());
      EXPECT_FALSE(m.FitsOnLink(*Registry().Describe("ImageReader"), l, port, array, reason));
      EXPECT_NE(reason, "");
    }
  }
}

TEST(EditDocument, APropertyBecomesAVariable)
{
  EditDocument d = Opened("quick.xml");
  const Property& row = *Registry().Describe("BilateralFilter")->FindProperty("SigmaRange");
  EXPECT_EQ(d.MakeVariable("", "blur", row, "0.6"), "sigmaRange");
  EXPECT_EQ(d.FindProperty("", "blur", "SigmaRange")->Value, "$(sigmaRange)");
  EXPECT_EQ(d.Get()->Variables.back().Type.Value, "double");
  EXPECT_EQ(Errors(d), 0);
  std::string error;
  EXPECT_FALSE(d.AddVariable("spp", "int", "1", error));
  EXPECT_FALSE(d.AddVariable("1", "int", "1", error));
  EXPECT_TRUE(d.AddVariable("more", "int", "1", error));
  EXPECT_TRUE(d.RemoveVariable("more"));
  EXPECT_FALSE(d.RemoveVariable("more"));
}

TEST(EditDocument, SavedElsewherePathsLeadToTheSameFiles)
{
  EditDocument d = Opened("svgf.xml");
  const fs::path file = Scratch("deep/er") / "copy.xml";
  std::string error;
  ASSERT_TRUE(d.Save(file.string(), error)) << error;
  EXPECT_EQ(d.File(), file.string());
  EXPECT_EQ(Errors(d), 0);
  EXPECT_EQ(fs::weakly_canonical(file.parent_path() / d.Get()->Includes[0].File.Value),
    fs::weakly_canonical(Shipped("library.xml")));
  EditDocument again;
  std::vector<Diagnostic> messages;
  ASSERT_TRUE(again.Open(file.string(), messages));
  EXPECT_EQ(Errors(again), 0);
  // A save that fails leaves the paths as they are seen from where the document is.
  const auto document = d.Get();
  const std::string text = d.Text(), undo = d.UndoLabel();
  EXPECT_FALSE(d.Save("/nowhere/at/all.xml", error));
  EXPECT_NE(error.find("/nowhere/at/all.xml"), std::string::npos);
  EXPECT_EQ(d.Get(), document);
  EXPECT_EQ(d.Text(), text);
  EXPECT_EQ(d.UndoLabel(), undo);
  EXPECT_FALSE(d.IsDirty());
  EXPECT_EQ(Errors(d), 0);
  EXPECT_FALSE(EditDocument().Save("", error));
}

TEST(EditDocument, UndoneAfterASaveElsewherePathsStillLeadToTheSameFiles)
{
  EditDocument d = Opened("svgf.xml");
  ASSERT_GT(d.Get()->Nodes.size(), 3u);
  d.SetProperty("", "taa", "Alpha", "0.5");
  d.SetProperty("", "taa", "Alpha", "0.6");
  d.Undo();
  const std::string label = d.UndoLabel();
  const fs::path file = Scratch("un/done") / "copy.xml";
  std::string error;
  ASSERT_TRUE(d.Save(file.string(), error)) << error;
  EXPECT_EQ(d.UndoLabel(), label) << "the edit, not the save";
  for (int step = 0; step < 3; ++step) // the edit taken back, made again, and the one after it
  {
    if (step == 0)
    {
      d.Undo();
      EXPECT_TRUE(d.IsDirty());
      EXPECT_NE(d.FindProperty("", "taa", "Alpha")->Value, "0.5");
    }
    else
    {
      d.Redo();
      EXPECT_EQ(d.FindProperty("", "taa", "Alpha")->Value, step == 1 ? "0.5" : "0.6");
    }
    EXPECT_EQ(Errors(d), 0) << step;
    EXPECT_EQ(fs::weakly_canonical(file.parent_path() / d.Get()->Includes[0].File.Value),
      fs::weakly_canonical(Shipped("library.xml")));
    ASSERT_TRUE(d.Save(file.string(), error)) << error;
    EditDocument again;
    std::vector<Diagnostic> messages;
    ASSERT_TRUE(again.Open(file.string(), messages));
    EXPECT_EQ(Errors(again), 0) << step;
  }
}

TEST(EditDocument, KnowsThatSomebodyElseWroteTheFile)
{
  EditDocument d = Opened("quick.xml");
  const fs::path file = Scratch("shared") / "a.xml";
  std::string error;
  ASSERT_TRUE(d.Save(file.string(), error)) << error;
  EXPECT_FALSE(d.ChangedOnDisk());
  std::ofstream(file, std::ios::app) << "<!-- mine -->\n";
  EXPECT_TRUE(d.ChangedOnDisk());
  ASSERT_TRUE(d.Save(file.string(), error)) << error; // who asks may
  EXPECT_FALSE(d.ChangedOnDisk());
  fs::remove(file);
  EXPECT_FALSE(d.ChangedOnDisk()) << "nothing to write over";
}

TEST(EditDocument, ASymbolicLinkStaysOne)
{
  const fs::path folder = Scratch("links");
  EditDocument d = Opened("quick.xml");
  std::string error;
  ASSERT_TRUE(d.Save((folder / "real.xml").string(), error)) << error;
  fs::remove(folder / "link.xml");
  fs::create_symlink("real.xml", folder / "link.xml");
  std::vector<Diagnostic> messages;
  ASSERT_TRUE(d.Open((folder / "link.xml").string(), messages));
  const std::string before = d.Text();
  d.SetVariable("spp", "7");
  ASSERT_TRUE(d.Save((folder / "link.xml").string(), error)) << error;
  EXPECT_TRUE(fs::is_symlink(folder / "link.xml"));
  std::ifstream stream(folder / "real.xml");
  std::stringstream text;
  text << stream.rdbuf();
  EXPECT_EQ(text.str(), d.Text());
  EXPECT_NE(text.str(), before);
}

TEST(EditDocument, WhatCannotBeOpenedChangesNothing)
{
  EditDocument d = Opened("quick.xml");
  const auto before = d.Get();
  std::vector<Diagnostic> messages;
  EXPECT_FALSE(d.Open("/nowhere.xml", messages));
  ASSERT_EQ(messages.size(), 1u);
  const fs::path file = Scratch("bad") / "bad.xml";
  std::ofstream(file) << "<pipeline>\n  <node\n</pipeline>";
  EXPECT_FALSE(d.Open(file.string(), messages));
  ASSERT_FALSE(messages.empty());
  EXPECT_EQ(messages[0].Place.Line, 3);
  EXPECT_EQ(d.Get(), before);
  EXPECT_EQ(d.File(), Shipped("quick.xml"));
  // Mistakes in a pipeline can be opened, to be mended.
  std::ofstream(file) << "<pipeline version=\"1\"><node id=\"a\" type=\"Nothing\"/></pipeline>";
  EXPECT_TRUE(d.Open(file.string(), messages));
  EXPECT_GT(Errors(d), 0);
}

// Whatever is done, the text reads back as the document, undo leads back to the first byte, and nothing falls over.
TEST(EditDocument, SelectedNodesBecomeATemplate)
{
  EditDocument d = Opened("quick.xml");
  const auto before = d.Get();
  std::string error;
  EXPECT_EQ(d.MakeTemplate({ "demodulate", "modulate" }, "soft", nullptr, error), "");
  EXPECT_NE(error.find("\"blur\" lies between them"), std::string::npos) << error;
  EXPECT_EQ(d.MakeTemplate({ "blur" }, "2 words", nullptr, error), "");
  EXPECT_EQ(d.MakeTemplate({}, "soft", nullptr, error), "");
  EXPECT_EQ(d.Get(), before);

  std::vector<std::string> asked;
  const std::string id = d.MakeTemplate(
    { "demodulate", "blur", "modulate" }, "soft",
    [&](const std::string& from)
    {
      asked.push_back(from);
      return from == "pt:depth" ? "depth" : "";
    },
    error);
  ASSERT_EQ(id, "soft") << error;
  EXPECT_EQ(Errors(d), 0);
  const PipelineTemplate* t = d.FindTemplate("soft");
  ASSERT_TRUE(t && d.IsEditable("soft"));
  EXPECT_EQ(t->Nodes.size(), 3u);
  EXPECT_EQ(t->Outputs.size(), 1u);
  EXPECT_EQ(t->Inputs.size(), asked.size()) << "a port for each thing that is read, once";
  EXPECT_EQ(d.FindNode("", id)->Inputs.size(), t->Inputs.size());
  EXPECT_FALSE(d.FindNode("", "blur"));
  EXPECT_TRUE(d.FindNode("soft", "blur"));
  for (const PipelineNode& n : t->Nodes)
  {
    for (const PipelineInput& i : n.Inputs)
    {
      EXPECT_TRUE(i.From.Value[0] == '@' || d.FindNode("soft", i.From.Value.substr(0, i.From.Value.find(':'))));
    }
  }
  d.Undo();
  EXPECT_EQ(*d.Get(), *before);
  // What nobody reads yet leads out of it all the same.
  EditDocument alone(&Registry());
  alone.AddNode("", "PathTraceSource", 0, 0, "pt");
  ASSERT_NE(alone.MakeTemplate({ "pt" }, "source", nullptr, error), "") << error;
  EXPECT_EQ(alone.FindTemplate("source")->Outputs.at(0).From.Value, "pt");
}

TEST(EditDocument, ATemplateOfAnotherFileIsCopiedAndGetsPorts)
{
  EditDocument d = Opened("svgf.xml");
  std::string error;
  EXPECT_FALSE(d.IsEditable("svgf"));
  EXPECT_FALSE(d.AddTemplateInput("svgf", "more", "color", error));
  const std::string own = d.AdoptTemplate("svgf", error);
  ASSERT_EQ(own, "svgf2") << error;
  EXPECT_TRUE(d.IsEditable(own));
  EXPECT_EQ(d.FindNode("", "direct")->Type.Value, own);
  EXPECT_EQ(d.FindNode("", "indirect")->Type.Value, own);
  EXPECT_EQ(Errors(d), 0);
  EXPECT_EQ(d.AdoptTemplate(own, error), "");

  ASSERT_TRUE(d.AddTemplateInput(own, "more", "scalar", error)) << error;
  EXPECT_FALSE(d.AddTemplateInput(own, "more", "scalar", error));
  EXPECT_NE(error.find("already"), std::string::npos);
  EXPECT_FALSE(d.AddTemplateOutput(own, "no name", "", error));
  ASSERT_TRUE(d.AddTemplateOutput(own, "variance", "atrous:variance", error)) << error;
  Diagnostics messages;
  const auto built = BuildGraph(d.Get(), Registry(), {}, messages);
  // The new input is not connected yet, and that is said of the instances.
  EXPECT_GT(messages.ErrorCount(), 0);
  ASSERT_TRUE(d.RemoveTemplatePort(own, "more"));
  EXPECT_EQ(Errors(d), 0);
  ASSERT_TRUE(d.Connect("", "direct:variance", "sum", "radiance", false, true, error)) << error;
  ASSERT_TRUE(d.RemoveTemplatePort(own, "variance"));
  for (const PipelineInput& i : d.FindNode("", "sum")->Inputs)
  {
    EXPECT_NE(i.From.Value, "direct:variance");
  }
  EXPECT_FALSE(d.RemoveTemplatePort(own, "out")) << "the only way out";
  // A property of a node in it becomes a parameter of it.
  const StageDescription* atrous = Registry().Describe("ATrousFilter");
  ASSERT_TRUE(atrous);
  const std::string name = d.MakeVariable(own, "atrous", *atrous->FindProperty("SigmaDepth"), "1");
  EXPECT_EQ(name, "sigmaDepth");
  EXPECT_EQ(d.FindTemplate(own)->Parameters.back().Name.Value, "sigmaDepth");
  EXPECT_EQ(d.FindProperty(own, "atrous", "SigmaDepth")->Value, "$(sigmaDepth)");
  EXPECT_EQ(Errors(d), 0);
}

TEST(EditDocument, PortsOfATemplateGetOtherNames)
{
  EditDocument d = Opened("svgf.xml");
  std::string error;
  EXPECT_FALSE(d.RenameTemplatePort("svgf", "radiance", "light", error)) << "another file's";
  const std::string own = d.AdoptTemplate("svgf", error);
  ASSERT_EQ(own, "svgf2") << error;
  const auto before = d.Get();
  ASSERT_TRUE(d.RenameTemplatePort(own, "radiance", "light", error)) << error;
  EXPECT_EQ(d.FindTemplate(own)->Inputs.front().Name.Value, "light");
  int outside = 0, inside = 0;
  for (const char* instance : { "direct", "indirect" })
  {
    for (const PipelineInput& i : d.FindNode("", instance)->Inputs)
    {
      EXPECT_NE(i.Port.Value, "radiance");
      outside += i.Port.Value == "light" ? 1 : 0;
    }
  }
  for (const PipelineNode& n : d.Nodes(own))
  {
    for (const PipelineInput& i : n.Inputs)
    {
      EXPECT_NE(i.From.Value, "@radiance");
      inside += i.From.Value == "@light" ? 1 : 0;
    }
  }
  EXPECT_EQ(outside, 2);
  EXPECT_GT(inside, 0);
  EXPECT_EQ(Errors(d), 0);
  ASSERT_TRUE(d.RenameTemplatePort(own, "out", "clean", error)) << error;
  EXPECT_EQ(Errors(d), 0);
  int read = 0;
  for (const PipelineInput& i : d.FindNode("", "sum")->Inputs)
  {
    read += i.From.Value == "direct:clean" || i.From.Value == "indirect:clean" ? 1 : 0;
  }
  EXPECT_EQ(read, 2);
  EXPECT_FALSE(d.RenameTemplatePort(own, "light", "clean", error));
  EXPECT_NE(error.find("already"), std::string::npos);
  EXPECT_FALSE(d.RenameTemplatePort(own, "light", "no name", error));
  EXPECT_FALSE(d.RenameTemplatePort(own, "nowhere", "x", error));
  d.Undo();
  d.Undo();
  EXPECT_EQ(*d.Get(), *before);
}

// Lines in messages are those of the text as it would be saved now.
TEST(EditDocument, MistakesHaveTheirLinesAfterEdits)
{
  EditDocument d = Opened("quick.xml");
  std::string error;
  const auto lineOf = [&](const std::string& what)
  {
    std::istringstream text(d.Text());
    int n = 0;
    for (std::string line; std::getline(text, line);)
    {
      ++n;
      if (line.find(what) != std::string::npos)
      {
        return n;
      }
    }
    return -1;
  };
  const auto reported = [&]
  {
    Diagnostics messages;
    BuildGraph(d.Get(), Registry(), {}, messages);
    EXPECT_EQ(messages.ErrorCount(), 1) << messages.ToText();
    return messages.All().empty() ? -2 : messages.All().front().Place.Line;
  };
  d.SetProperty("", "blur", "SigmaRange", "-1");
  const int first = reported();
  EXPECT_EQ(first, lineOf("\"-1\""));
  for (const char* name : { "one", "two", "three" })
  {
    ASSERT_TRUE(d.AddVariable(name, "int", "1", error)) << error;
  }
  EXPECT_EQ(reported(), first + 3);
  EXPECT_EQ(reported(), lineOf("\"-1\""));
  d.Undo();
  EXPECT_EQ(reported(), lineOf("\"-1\""));
  // In a pipeline that was never saved, too.
  EditDocument fresh(&Registry());
  fresh.AddNode("", "PathTraceSource", 0, 0, "pt");
  fresh.AddNode("", "BilateralFilter", 0, 0, "soft");
  Diagnostics messages;
  BuildGraph(fresh.Get(), Registry(), {}, messages);
  ASSERT_GT(messages.ErrorCount(), 0);
  for (const Diagnostic& m : messages.All())
  {
    EXPECT_GT(m.Place.Line, 0) << m.ToText();
  }
}

TEST(EditDocument, AThousandRandomEdits)
{
  std::mt19937 random(20260101);
  const auto pick = [&random](std::size_t n) { return n ? std::size_t(random() % n) : 0; };
  const std::vector<std::string> types = Registry().Types();
  for (const char* name : { "quick.xml", "library.xml" })
  {
    EditDocument d = Opened(name);
    const std::string original = d.Text();
    std::size_t done = 0;
    for (int i = 0; i < 500; ++i)
    {
      const std::vector<PipelineTemplate>& templates = d.Get()->Templates;
      const std::string scope = !templates.empty() && pick(2) ? templates[pick(templates.size())].Name.Value : "";
      const std::vector<PipelineNode> nodes = d.Nodes(scope);
      const std::string node = nodes.empty() ? "none" : nodes[pick(nodes.size())].Id.Value;
      const std::string other = nodes.empty() ? "none" : nodes[pick(nodes.size())].Id.Value;
      const GraphModel m = GraphModel::Build(d, scope, Registry());
      std::string error;
      const std::uint64_t revision = d.Revision();
      switch (pick(16))
      {
        case 0:
        case 1:
          d.AddNode(scope, types[pick(types.size())], double(pick(1000)), double(pick(1000)));
          break;
        case 2:
          d.Remove(scope, { node, other }, pick(2) == 0);
          break;
        case 3:
          d.Duplicate(scope, { node, other }, 20, 20);
          break;
        case 4:
          d.Rename(scope, node, pick(5) ? "n" + std::to_string(pick(40)) : other, error);
          break;
        case 5:
        case 6:
        case 7:
          if (!m.Boxes.empty())
          {
            const int from = int(pick(m.Boxes.size())), to = int(pick(m.Boxes.size()));
            const int out = int(pick(m.Boxes[std::size_t(from)].Outputs.size())),
                      in = int(pick(m.Boxes[std::size_t(to)].Inputs.size()));
            const LinkVerdict v = m.Judge(from, out, to, in);
            EXPECT_TRUE(v.Ok || !v.Reason.empty());
            if (v.Ok)
            {
              d.Connect(scope, m.Reference(from, out), m.Boxes[std::size_t(to)].Id,
                m.Boxes[std::size_t(to)].Inputs[std::size_t(in)].Name, v.Delay,
                m.Boxes[std::size_t(to)].Inputs[std::size_t(in)].Repeatable, error);
            }
          }
          break;
        case 8:
          d.Disconnect(scope, node, int(pick(4)));
          break;
        case 9:
          if (!m.Links.empty())
          {
            const GraphLink l = m.Links[pick(m.Links.size())];
            const StageDescription& type = *Registry().Describe(types[pick(types.size())]);
            int port = 0;
            std::string array, reason;
            if (l.To >= 0 && m.FitsOnLink(type, l, port, array, reason))
            {
              d.InsertOnLink(scope, m.Boxes[std::size_t(l.To)].Id, l.Index, type, port, array, 1, 2);
            }
          }
          break;
        case 10:
          d.SetProperty(scope, node, "P" + std::to_string(pick(5)), pick(2) ? "<&\"'>" : "a\nb", pick(2) == 0);
          break;
        case 11:
          d.ResetProperty(scope, node, "P" + std::to_string(pick(5)));
          break;
        case 12:
          d.Move(scope, { { node, { double(pick(500)), double(pick(500)) } } });
          break;
        case 13:
          d.PasteXml(scope, d.CopyXml(scope, { node, other }), 0, 0, error);
          break;
        case 14:
          if (scope.empty())
          {
            d.AddOutput(node, 0, 0);
          }
          break;
        default:
          pick(3) ? d.Undo() : d.Redo();
      }
      done += d.Revision() != revision;
      if (i % 10 == 0)
      {
        const std::string text = d.Text();
        Diagnostics messages;
        const auto back = ReadPipelineText(text, d.Get()->File, messages);
        ASSERT_EQ(*back, *d.Get()) << name << " after " << i << "\n" << messages.ToText();
        ASSERT_EQ(ReadPipelinePositions(text), d.Positions());
        BuildGraph(d.Get(), Registry(), {}, messages); // mistakes or not, it comes back
        std::vector<BoxSize> sizes(m.Boxes.size());
        EXPECT_EQ(ArrangeGraph(m, sizes).size(), m.Boxes.size());
      }
    }
    EXPECT_GT(done, 200u);
    while (d.CanUndo())
    {
      d.Undo();
    }
    if (done < 500)
    {
      EXPECT_EQ(d.Text(), original) << name;
    }
  }
}
