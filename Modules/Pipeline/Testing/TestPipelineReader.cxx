// SPDX-License-Identifier: BSD-3-Clause
// The file: positions, expansion, paths, round trip. Testing/Fuzz has files that are mutilated at random.
#include "PipelineTestStages.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"
#include "quellPipelineSchema.h"
#include "quellPipelineWriter.h"
#include "quellStageReference.h"
#include "quellXmlDocument.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

using namespace quell;
namespace fs = std::filesystem;

namespace
{
/// A directory of files, gone with the test.
class Files : public ::testing::Test
{
protected:
  void SetUp() override
  {
    std::string name = (fs::temp_directory_path() / "quell-pipeline-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    this->Directory = name;
  }
  void TearDown() override
  {
    std::error_code code;
    fs::remove_all(this->Directory, code);
  }
  std::string Write(const std::string& name, const std::string& text)
  {
    const std::string path = this->Directory + "/" + name;
    fs::create_directories(fs::path(path).parent_path());
    std::ofstream(path) << text;
    return path;
  }
  std::string Directory;
};
using Paths = Files;
using Includes = Files;

const char* const Everything = R"xml(<?xml version="1.0" encoding="UTF-8"?>
<!-- before the root -->
<pipeline version="1" doc="a &quot;quoted&quot; &lt;doc&gt; &amp; &#228;">
  <variable name="spp" type="int" default="2" doc="samples"/>
  <!-- how long -->
  <time first="3" count="$(spp)" rate="23.976"/>
  <template name="soft" doc="blur">
    <parameter name="radius" type="int" default="1"/>
    <port name="in" type="color" doc="what to blur"/>
    <node id="box" type="TestBox">
      <property name="Radius" value="$(radius)"/>
      <input port="radiance" from="@in"/>
      <!-- at the end of the node -->
    </node>
    <port name="out" from="box:radiance"/>
  </template>
  <node id="pt" type="TestSource" doc="the source"/>
  <instance id="a" template="soft"><parameter name="radius" value="3"/><input port="in" from="pt:radiance"/></instance>
  <node id="acc" type="TestAccumulate">
    <input port="radiance" from="a:out"/>
    <input port="history" from="acc:radiance" delay="1"/>
  </node>
  <node id="w" type="ImageWriter">
    <property name="File" value="w&#10;.exr"/>
    <input port="layer" from="pt:albedo" name="al"/>
  </node>
  <output name="beauty" from="acc:radiance" file="b.####.exr"/>
  <output name="aovs" file="a.exr"><layer from="pt:depth" name="Z"/><layer from="pt:normal"/></output>
  <output name="shown" from="acc:radiance" file="s.png" view="v" display="d"/>
</pipeline>
<!-- after the root -->
)xml";

std::shared_ptr<PipelineDocument> Read(const std::string& text, Diagnostics& messages)
{
  return ReadPipelineText(text, "t.xml", messages);
}
}

TEST(XmlDocument, PlacesOfElementsAndAttributes)
{
  XmlElement root;
  Diagnostics messages;
  ASSERT_TRUE(ParseXml(
    "<?xml version=\"1.0\"?>\n<a  x='1'\n   y = \"2>3\"><b\xC3\xA4 z=\"&lt;\"/>\n  <c/></a>", "f", root, messages));
  EXPECT_EQ(root.Place.ToText(), "f:2:1");
  EXPECT_EQ(root.Attributes.at(0).Place.ToText(), "f:2:5");
  EXPECT_EQ(root.Attributes.at(1).Place.ToText(), "f:3:4");
  EXPECT_EQ(root.Attributes.at(1).Value, "2>3");
  EXPECT_EQ(root.Children.at(0).Place.ToText(), "f:3:14");
  EXPECT_EQ(root.Children.at(0).Attributes.at(0).Place.ToText(), "f:3:18"); // columns are characters, not bytes
  EXPECT_EQ(root.Children.at(1).Place.ToText(), "f:4:3");
}

TEST(XmlDocument, BoundsAndRefusals)
{
  const auto error = [](const std::string& text, const XmlLimits& limits = XmlLimits())
  {
    XmlElement root;
    Diagnostics messages;
    EXPECT_FALSE(ParseXml(text, "f", root, messages, limits));
    EXPECT_EQ(messages.All().size(), 1u);
    return messages.ToText();
  };
  EXPECT_EQ(error(""), "f:1:1: error: not well-formed XML: no element found\n");
  EXPECT_EQ(error("<a>\n  <b></a>"), "f:2:8: error: not well-formed XML: mismatched tag\n");
  EXPECT_EQ(error("<a x='1' x='2'/>"), "f:1:10: error: not well-formed XML: duplicate attribute\n");
  EXPECT_EQ(error("<a/><b/>"), "f:1:5: error: not well-formed XML: junk after document element\n");
  EXPECT_EQ(error("<a>&nbsp;</a>"), "f:1:4: error: not well-formed XML: undefined entity\n");
  const std::string doctype =
    "error: document type declarations are not allowed; pipelines need no DTD and no entities; use "
    "<variable> and <include>\n";
  EXPECT_EQ(error("<!DOCTYPE a [<!ENTITY e \"x\">]><a>&e;</a>"), "f:1:1: " + doctype);
  EXPECT_EQ(error("<!DOCTYPE a SYSTEM \"file:///etc/passwd\"><a/>"), "f:1:1: " + doctype);
  std::string deep;
  for (int i = 0; i < 100000; ++i)
    deep += "<a>";
  EXPECT_EQ(error(deep), "f:1:193: error: elements are nested more than 64 deep\n");
  XmlLimits few;
  few.Elements = 3;
  EXPECT_EQ(error("<a><b/><b/><b/></a>", few), "f:1:12: error: more than 3 elements and comments\n");
  few.Bytes = 10;
  EXPECT_EQ(error("<a>       </a>", few), "f: error: the file has 14 bytes, more than the 10 allowed\n");
}

TEST(PipelineReader, ReadWriteReadIsTheIdentity)
{
  Diagnostics messages;
  const auto first = Read(Everything, messages);
  ASSERT_FALSE(messages.HasErrors()) << messages.ToText();
  EXPECT_EQ(first->Doc.Value, "a \"quoted\" <doc> & \xC3\xA4");
  EXPECT_EQ(first->Templates.at(0).Nodes.at(0).TrailingComments.at(0), " at the end of the node ");
  const std::string text = WritePipelineText(*first);
  const auto second = Read(text, messages);
  ASSERT_FALSE(messages.HasErrors()) << messages.ToText() << text;
  EXPECT_TRUE(*first == *second) << text;
  EXPECT_EQ(WritePipelineText(*second), text);
  for (const char* comment : { "before the root", "how long", "at the end of the node", "after the root" })
    EXPECT_NE(text.find(comment), std::string::npos) << comment;
  // and equality is not blind
  auto changed = std::make_shared<PipelineDocument>(*second);
  changed->Nodes[0].Id.Value = "other";
  EXPECT_FALSE(*first == *changed);
}

TEST(PipelineReader, ShippedPipelinesRoundTrip)
{
  const fs::path directory = fs::path(QUELL_SOURCE_DIR) / "Data" / "Pipelines";
  if (!fs::is_directory(directory))
    GTEST_SKIP() << "no " << directory;
  for (const auto& entry : fs::recursive_directory_iterator(directory))
  {
    if (entry.path().extension() != ".xml")
      continue;
    Diagnostics messages;
    const auto first = ReadPipelineFile(entry.path().string(), messages);
    ASSERT_FALSE(messages.HasErrors()) << messages.ToText();
    const auto second = ReadPipelineText(WritePipelineText(*first), entry.path().string(), messages);
    EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
    EXPECT_TRUE(*first == *second) << entry.path();
  }
}

TEST(PipelineGraph, VariablesAndTime)
{
  const std::string text = R"xml(<pipeline version="1">
    <variable name="n" type="int" default="2"/>
    <variable name="m" type="string" default="$(n)0$(late)"/>
    <variable name="late" type="int" default="1"/>
    <time first="-1" count="$(m)" rate="12.5"/>
    <node id="pt" type="TestSource"><property name="Width" value="$(n)$(n)"/></node>
    <node id="r" type="TestReader"><property name="File" value="$$(n) $ $$ 5$"/></node>
    <output name="o" from="pt"/><output name="p" from="r:foreign"/></pipeline>)xml";
  Diagnostics messages;
  GraphOptions options;
  auto graph = BuildGraph(Read(text, messages), pipelinetest::Registry(), options, messages);
  ASSERT_EQ(messages.ToText(), "");
  EXPECT_EQ(graph->Ticks.First, -1);
  EXPECT_EQ(graph->Ticks.Count, 201);
  EXPECT_EQ(graph->Ticks.Rate, 12.5);
  EXPECT_EQ(graph->Nodes[0].Stage->GetPropertyText("Width"), "22");
  EXPECT_EQ(graph->Nodes[1].Stage->GetPropertyText("File"), "$(n) $ $$ 5$");
  EXPECT_EQ(graph->Variables.at("m"), "201");

  options.Defines = { { "n", "7" } };
  options.Properties = { { "pt.Height", "5" } };
  options.Seed = 11;
  graph = BuildGraph(Read(text, messages), pipelinetest::Registry(), options, messages);
  ASSERT_EQ(messages.ToText(), "");
  EXPECT_EQ(graph->Ticks.Count, 701);
  EXPECT_EQ(graph->Nodes[0].Stage->GetPropertyText("Width"), "77");
  EXPECT_EQ(graph->Nodes[0].Stage->GetPropertyText("Height"), "5");
  EXPECT_EQ(graph->Nodes[0].Stage->GetPropertyText("Seed"), "11");
}

TEST(PipelineGraph, OutputsFromTheCommandLine)
{
  const std::string text = R"xml(<pipeline version="1"><node id="pt" type="TestSource"/>
    <output name="beauty" from="pt:radiance"/></pipeline>)xml";
  Diagnostics messages;
  GraphOptions options;
  options.Outputs = { { "beauty", "b.####.exr" }, { "pt:depth", "/tmp/d.exr" } };
  options.OutputDirectory = "results";
  const auto graph = BuildGraph(Read(text, messages), pipelinetest::Registry(), options, messages);
  ASSERT_EQ(messages.ToText(), "");
  ASSERT_EQ(graph->Outputs.size(), 2u);
  EXPECT_EQ(graph->Outputs[0].File, "results/b.####.exr");
  EXPECT_EQ(graph->Outputs[1].File, "/tmp/d.exr");
  EXPECT_EQ(graph->Outputs[1].Array, "depth");
  EXPECT_EQ(graph->Nodes[std::size_t(graph->Outputs[0].Writer)].Path, "beauty:write");
  EXPECT_EQ(graph->Nodes[std::size_t(graph->Outputs[0].Writer)].Stage->GetPropertyText("File"), "results/b.####.exr");
}

TEST_F(Paths, AreSeenFromTheFileThatSaysThem)
{
  this->Write("scenes/room.gltf", "{}");
  this->Write("lib/scenes/other.gltf", "{}");
  this->Write("lib/seq.0004.exr", "");
  this->Write("lib/lib.xml", R"xml(<pipeline version="1">
    <variable name="other" type="path" default="scenes/other.gltf"/>
    <template name="src"><node id="s" type="TestSource"><property name="Scene" value="seq.####.exr"/></node>
    <port name="out" from="s:radiance"/></template></pipeline>)xml");
  const std::string main = this->Write("main.xml", R"xml(<pipeline version="1">
    <include file="lib/lib.xml"/>
    <variable name="scene" type="path" default="scenes/room.gltf"/>
    <node id="a" type="TestSource"><property name="Scene" value="$(scene)"/></node>
    <node id="b" type="TestSource"><property name="Scene" value="$(other)"/></node>
    <node id="c" type="TestSource"><property name="Scene" value="scenes/room.gltf"/></node>
    <instance id="d" template="src"/>
    <node id="sum" type="TestSum"><input port="radiance" from="a"/><input port="radiance" from="b"/>
      <input port="radiance" from="c"/><input port="radiance" from="d:out"/></node>
    <output name="o" from="sum" file="out/o.exr"/></pipeline>)xml");
  Diagnostics messages;
  GraphOptions options;
  auto graph = LoadPipeline(main, pipelinetest::Registry(), options, messages);
  ASSERT_TRUE(graph) << messages.ToText();
  EXPECT_EQ(messages.ToText(), "");
  const auto scene = [&](const char* node)
  { return graph->Nodes[std::size_t(graph->Find(node))].Stage->GetPropertyText("Scene"); };
  EXPECT_EQ(scene("a"), this->Directory + "/scenes/room.gltf");
  EXPECT_EQ(scene("b"), this->Directory + "/lib/scenes/other.gltf");
  EXPECT_EQ(scene("c"), this->Directory + "/scenes/room.gltf");
  EXPECT_EQ(scene("d/s"), this->Directory + "/lib/seq.####.exr");
  EXPECT_EQ(graph->Outputs[0].File, "out/o.exr");

  // From the command line: the working directory's.
  options.Defines = { { "scene", "scenes/room.gltf" } };
  EXPECT_EQ(LoadPipeline(main, pipelinetest::Registry(), options, messages), nullptr);
  EXPECT_EQ(
    messages.ToText(), main + ":4:59: error: node \"a\" (TestSource): Scene = \"scenes/room.gltf\": no such file\n");
  const fs::path before = fs::current_path();
  fs::current_path(this->Directory);
  Diagnostics fresh;
  graph = LoadPipeline(main, pipelinetest::Registry(), options, fresh);
  fs::current_path(before);
  ASSERT_TRUE(graph) << fresh.ToText();
  EXPECT_EQ(scene("a"), "scenes/room.gltf");
}

TEST_F(Includes, LoopsAreFoundAndLibrariesAreReadOnce)
{
  this->Write(
    "c.xml", "<pipeline version=\"1\"><template name=\"t\"><port name=\"out\" from=\"x\"/></template></pipeline>");
  this->Write("a.xml", "<pipeline version=\"1\"><include file=\"b.xml\"/></pipeline>");
  this->Write(
    "b.xml", "<pipeline version=\"1\"><include file=\"a.xml\"/><node id=\"n\" type=\"TestSource\"/></pipeline>");
  Diagnostics messages;
  LoadPipeline(this->Directory + "/a.xml", pipelinetest::Registry(), {}, messages);
  EXPECT_EQ(messages.ToText(),
    this->Directory + "/b.xml:1:32: error: include \"a.xml\": the file includes itself: a.xml -> b.xml -> a.xml\n" +
      this->Directory +
      "/b.xml:1:46: error: <node> \"n\": an included file may hold includes, variables and templates only\n");
  this->Write("twice.xml", "<pipeline version=\"1\">\n<include file=\"c.xml\"/><include file=\"./c.xml\"/><include "
                           "file=\"no.xml\"/></pipeline>");
  Diagnostics more;
  LoadPipeline(this->Directory + "/twice.xml", pipelinetest::Registry(), {}, more);
  EXPECT_EQ(more.ToText(),
    this->Directory + "/twice.xml:2:58: error: include \"no.xml\": no such file: " + this->Directory + "/no.xml\n");
}

TEST_F(Files, TheSchemaAcceptsPipelinesAndRefusesOthers)
{
  if (std::system("xmllint --version > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "no xmllint";
  const std::string schema = this->Write("p.xsd", PipelineXsd(pipelinetest::Registry()));
  const auto validates = [&](const std::string& text)
  {
    const std::string file = this->Write("p.xml", text);
    return std::system(("xmllint --noout --schema " + schema + " " + file + " > /dev/null 2>&1").c_str()) == 0;
  };
  EXPECT_TRUE(validates(Everything));
  EXPECT_TRUE(validates("<pipeline version=\"1\"><node id=\"a\" type=\"$(t)\"/></pipeline>"));
  EXPECT_FALSE(validates("<pipeline version=\"1\"><node id=\"a\" type=\"TestBoxx\"/></pipeline>"));
  EXPECT_FALSE(validates("<pipeline version=\"1\"><node id=\"a\" type=\"TestBox\"><property name=\"Radios\" "
                         "value=\"1\"/></node></pipeline>"));
  EXPECT_FALSE(validates("<pipeline><node id=\"a\" type=\"TestBox\"/></pipeline>"));
  EXPECT_FALSE(validates("<pipeline version=\"1\"><nodes/></pipeline>"));
}

TEST(StageReference, Markdown)
{
  const std::string text = StageMarkdown(pipelinetest::Registry(), { "TestBox" });
  EXPECT_NE(text.find("## TestBox\n\nMean over a box.\n"), std::string::npos) << text;
  EXPECT_NE(text.find("| `normal` | normal, optional | copied to mask |\n"), std::string::npos) << text;
  EXPECT_NE(text.find("| `Radius` | int | `1` pixels | [0, 16] | Radius of the box. |\n"), std::string::npos) << text;
  EXPECT_NE(text.find("| `Mode` | enum | `Scale` | Scale, Drop | Does nothing. |\n"), std::string::npos) << text;
}
