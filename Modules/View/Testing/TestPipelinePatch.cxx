// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelinePatch.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

using namespace quell;

namespace
{
const char* const Hand = R"(<?xml version='1.0'?>
<!-- by hand -->
<pipeline version="1"   doc='a "test"'>

  <variable name="spp" type="int" default="4"
            doc="samples"/>  <!-- why four -->
  <node id="pt" type="PathTraceSource"><property name="Scene" value="a.gltf"/></node>

    <!-- odd indent -->
    <node   id = "blur"
            type="BilateralFilter">
      <input port="radiance" from="pt:radiance"/>
      <!-- narrow -->
      <property name='Radius' value='3'/>

    </node>
  <output name="beauty" from="blur:radiance" file="o.exr"/>
  <!-- the end -->
</pipeline>
)";

PipelineDocument Read(const std::string& text)
{
  Diagnostics messages;
  auto d = ReadPipelineText(text, "test.xml", messages);
  EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
  return *d;
}

std::string Replaced(std::string text, const std::string& from, const std::string& to)
{
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}
}

TEST(PipelinePatch, NothingChangedIsTheSameBytes)
{
  EXPECT_EQ(PatchPipelineText(Hand, Read(Hand)), Hand);
  for (const auto& e : std::filesystem::recursive_directory_iterator(QUELL_SOURCE_DIR "/Data/Pipelines"))
  {
    if (e.path().extension() == ".xml")
    {
      std::ifstream stream(e.path());
      std::stringstream text;
      text << stream.rdbuf();
      Diagnostics messages;
      EXPECT_EQ(PatchPipelineText(text.str(), *ReadPipelineFile(e.path().string(), messages)), text.str()) << e.path();
    }
  }
}

TEST(PipelinePatch, AValueIsReplacedWhereItStands)
{
  PipelineDocument d = Read(Hand);
  d.Nodes[1].Properties[0].Value = "5";
  d.Variables[0].Default = "16";
  EXPECT_EQ(PatchPipelineText(Hand, d), Replaced(Replaced(Hand, "value='3'", "value='5'"), "\"4\"", "\"16\""));
  d = Read(Hand);
  d.Nodes[1].Properties[0].Value = "it's <";
  EXPECT_EQ(PatchPipelineText(Hand, d), Replaced(Hand, "value='3'", "value='it&apos;s &lt;'"));
}

TEST(PipelinePatch, ANewElementFollowsItsNeighbour)
{
  PipelineDocument d = Read(Hand);
  PipelineProperty p;
  p.Name = "Depth";
  p.Value = "1";
  d.Nodes[1].Properties.push_back(p);
  EXPECT_EQ(PatchPipelineText(Hand, d),
    Replaced(Hand, "value='3'/>\n", "value='3'/>\n      <property name=\"Depth\" value=\"1\"/>\n"));

  d = Read(Hand);
  PipelineNode n;
  n.Id = "sum";
  n.Type = "Sum";
  PipelineInput in;
  in.Port = "radiance";
  in.From = "blur";
  n.Inputs.push_back(in);
  d.Nodes.push_back(n);
  EXPECT_EQ(PatchPipelineText(Hand, d),
    Replaced(Hand, "\n    </node>\n",
      "\n    </node>\n  <node id=\"sum\" type=\"Sum\">\n    <input port=\"radiance\" from=\"blur\"/>\n  "
      "</node>\n"));
}

TEST(PipelinePatch, WhatIsRemovedTakesItsCommentAlong)
{
  PipelineDocument d = Read(Hand);
  d.Nodes[1].Properties.clear();
  EXPECT_EQ(PatchPipelineText(Hand, d),
    Replaced(Hand, "\n      <!-- narrow -->\n      <property name='Radius' value='3'/>", ""));
}

TEST(PipelinePatch, ARenamedNodeKeepsItsForm)
{
  PipelineDocument d = Read(Hand);
  d.Nodes[1].Id = "smooth";
  d.Outputs[0].From = "smooth:radiance";
  EXPECT_EQ(PatchPipelineText(Hand, d),
    Replaced(Replaced(Hand, "id = \"blur\"", "id = \"smooth\""), "blur:radiance", "smooth:radiance"));
}

TEST(PipelinePatch, AnEmptyElementGetsChildren)
{
  const std::string text = "<pipeline version=\"1\">\n\t<node id=\"a\" type=\"ImageReader\" />\n</pipeline>";
  PipelineDocument d = Read(text);
  PipelineProperty p;
  p.Name = "File";
  p.Value = "x.exr";
  d.Nodes[0].Properties.push_back(p);
  EXPECT_EQ(PatchPipelineText(text, d),
    "<pipeline version=\"1\">\n\t<node id=\"a\" type=\"ImageReader\">\n\t  <property name=\"File\" "
    "value=\"x.exr\"/>\n\t</node>\n</pipeline>");
  const std::string bare = "<pipeline version=\"1\"/>";
  d = Read(bare);
  PipelineNode n;
  n.Id = "a";
  n.Type = "Sum";
  d.Nodes.push_back(n);
  EXPECT_EQ(Read(PatchPipelineText(bare, d)), d);
}

TEST(PipelinePatch, AnythingThatIsNoPipelineIsWrittenAnew)
{
  const PipelineDocument d = Read(Hand);
  EXPECT_EQ(PatchPipelineText("", d), WritePipelineText(d));
  EXPECT_EQ(PatchPipelineText("<nothing", d), WritePipelineText(d));
}

TEST(PipelinePatch, PositionsDisturbNothing)
{
  const PipelinePositions positions{ { "pt", { 40, -60 } }, { "svgf/atrous", { 300, 12 } },
    { "output:beauty", { 1, 2 } } };
  const std::string with = WithPipelinePositions(Hand, positions);
  EXPECT_EQ(ReadPipelinePositions(with), positions);
  EXPECT_EQ(Read(with), Read(Hand));
  EXPECT_EQ(WithPipelinePositions(with, {}), Hand);
  EXPECT_EQ(WithPipelinePositions(with, positions), with);
  // They survive edits of the document.
  PipelineDocument d = Read(with);
  d.Nodes[1].Properties[0].Value = "5";
  EXPECT_EQ(ReadPipelinePositions(PatchPipelineText(with, d)), positions);
  EXPECT_EQ(ReadPipelinePositions("<a><?quell-view pt x y\n ok 1 2\n far 1e9 0?></a>"),
    (PipelinePositions{ { "ok", { 1, 2 } } }));
  EXPECT_EQ(WithPipelinePositions("<a", positions), "<a");
  EXPECT_EQ(ReadPipelinePositions(WithPipelinePositions("<pipeline/>", positions)), positions);
}
