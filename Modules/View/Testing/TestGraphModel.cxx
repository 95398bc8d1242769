// SPDX-License-Identifier: BSD-3-Clause
#include "AllStages.h"
#include "quellGraphModel.h"
#include "quellPipelineReader.h"

#include <gtest/gtest.h>

using namespace quell;

namespace
{
EditDocument Opened(const char* name)
{
  EditDocument d;
  std::vector<Diagnostic> messages;
  EXPECT_TRUE(d.Open(std::string(QUELL_SOURCE_DIR) + "/Data/Pipelines/" + name, messages));
  return d;
}

/// Mistakes that a link of these two has in BuildGraph, beside what the rest of the document has anyway.
bool BuildAccepts(
  const std::string& from, const std::string& array, const std::string& to, const std::string& port, bool delay)
{
  auto d = std::make_shared<PipelineDocument>();
  d->Version = "1";
  d->File = "pair.xml";
  PipelineNode a, b;
  a.Id = "a";
  a.Type = from;
  b.Id = "b";
  b.Type = to;
  PipelineInput i;
  i.Port = port;
  i.From = "a:" + array;
  if (delay)
  {
    i.Delay = "1";
  }
  b.Inputs.push_back(i);
  d->Nodes = { a, b };
  Diagnostics messages;
  BuildGraph(d, Registry(), {}, messages);
  for (const Diagnostic& m : messages.All())
  {
    if (m.Level == Severity::Error && m.Where.find("node \"b\"") != std::string::npos &&
        m.Where.find("input \"" + port + "\"") != std::string::npos)
    {
      return false;
    }
  }
  return true;
}
}

// The word on a link while it is dragged is the word that the file would get.
TEST(GraphModel, JudgesLinksAsTheBuilderDoes)
{
  int accepted = 0, refused = 0;
  for (const std::string& from : Registry().Types())
  {
    for (const std::string& to : Registry().Types())
    {
      EditDocument d;
      d.AddNode("", from, 0, 0, "a");
      d.AddNode("", to, 0, 0, "b");
      const GraphModel m = GraphModel::Build(d, "", Registry());
      const GraphBox &a = m.Boxes[0], &b = m.Boxes[1];
      // One output of each kind will do.
      std::set<ArrayKind> seen;
      for (std::size_t o = 0; o < a.Outputs.size(); ++o)
      {
        if (!seen.insert(a.Outputs[o].Kind).second)
        {
          continue;
        }
        for (std::size_t i = 0; i < b.Inputs.size(); ++i)
        {
          const LinkVerdict v = m.Judge(0, int(o), 1, int(i));
          EXPECT_EQ(v.Ok, BuildAccepts(from, a.Outputs[o].Name, to, b.Inputs[i].Name, v.Delay))
            << from << ":" << a.Outputs[o].Name << " -> " << to << "." << b.Inputs[i].Name << ": " << v.Reason;
          EXPECT_TRUE(v.Ok || !v.Reason.empty());
          (v.Ok ? accepted : refused) += 1;
        }
      }
    }
  }
  EXPECT_GT(accepted, 300);
  EXPECT_GT(refused, 300);
}

TEST(GraphModel, LoopsNeedAFrameInBetween)
{
  EditDocument d = Opened("quick.xml");
  const GraphModel m = GraphModel::Build(d, "", Registry());
  const int blur = m.Find("blur"), demodulate = m.Find("demodulate"), modulate = m.Find("modulate");
  const LinkVerdict first = m.Judge(modulate, 0, demodulate, m.Boxes[std::size_t(demodulate)].FindInput("radiance"));
  EXPECT_FALSE(first.Ok);
  EXPECT_NE(first.Reason.find("loop"), std::string::npos) << first.Reason;
  const int guide = m.Boxes[std::size_t(blur)].FindInput("albedo");
  const LinkVerdict pt = m.Judge(m.Find("pt"), m.Boxes[std::size_t(m.Find("pt"))].FindOutput("albedo"), blur, guide);
  EXPECT_TRUE(pt.Ok);
  EXPECT_FALSE(pt.Delay);
  const LinkVerdict same = m.Judge(m.Find("scattered"), 0, demodulate, 0);
  EXPECT_FALSE(same.Ok) << "it reads that already";
  EXPECT_TRUE(m.Judge(m.Find("pt"), 0, demodulate, 0).Replaces);
  EXPECT_FALSE(m.Judge(-1, 0, blur, 0).Ok);
  EXPECT_FALSE(m.Judge(blur, 99, blur, 0).Ok);
  EXPECT_TRUE(m.LeadsTo(m.Find("pt"), m.Find("sum")));
  EXPECT_FALSE(m.LeadsTo(m.Find("sum"), m.Find("pt")));
}

TEST(GraphModel, TemplatesAreGroups)
{
  EditDocument d = Opened("svgf.xml");
  const GraphModel top = GraphModel::Build(d, "", Registry());
  const GraphBox& direct = top.Boxes[std::size_t(top.Find("direct"))];
  EXPECT_EQ(direct.Kind, BoxKind::Instance);
  EXPECT_EQ(direct.Inputs.size(), 6u);
  EXPECT_EQ(direct.Inputs[std::size_t(direct.FindInput("normal"))].Kind, ArrayKind::Normal);
  ASSERT_EQ(direct.Outputs.size(), 1u);
  EXPECT_EQ(direct.Outputs[0].Kind, ArrayKind::Color);
  for (const GraphLink& l : top.Links)
  {
    EXPECT_GE(l.From, 0) << l.Text;
    EXPECT_GE(l.FromPin, 0) << l.Text;
    EXPECT_GE(l.ToPin, 0) << l.Text;
  }
  const GraphModel inside = GraphModel::Build(d, "svgf", Registry());
  EXPECT_GE(inside.Find("@"), 0);
  EXPECT_GE(inside.Find("port:out"), 0);
  for (const GraphLink& l : inside.Links)
  {
    EXPECT_GE(l.FromPin, 0) << l.Text;
  }
  EXPECT_FALSE(d.IsEditable("svgf")) << "it is the library's";
  EXPECT_EQ(ResolveTarget(*d.Get(), { "direct", "out" }), (ViewTarget{ "direct/modulate", "radiance" }));
  EXPECT_EQ(ResolveTarget(*d.Get(), { "direct", "" }), (ViewTarget{ "direct/modulate", "radiance" }));
  EXPECT_EQ(ResolveTarget(*d.Get(), { "direct/atrous", "variance" }), (ViewTarget{ "direct/atrous", "variance" }));
  EXPECT_EQ(ResolveTarget(*d.Get(), { "taa", "" }), (ViewTarget{ "taa", "" }));
  EXPECT_EQ(ResolveTarget(*d.Get(), { "none", "x" }), (ViewTarget{ "none", "x" }));
}

TEST(GraphModel, ArrangedBoxesDoNotCoverEachOther)
{
  for (const char* name : { "svgf.xml", "quick.xml", "layers-bounces.xml", "denoise-blender.xml" })
  {
    EditDocument d = Opened(name);
    const GraphModel m = GraphModel::Build(d, "", Registry());
    std::vector<BoxSize> sizes;
    for (const GraphBox& b : m.Boxes)
    {
      sizes.push_back({ 170, 30 + 18. * double(std::max(b.Inputs.size(), b.Outputs.size())) });
    }
    const auto at = ArrangeGraph(m, sizes);
    for (std::size_t i = 0; i < at.size(); ++i)
    {
      for (std::size_t j = 0; j < i; ++j)
      {
        const bool apart = at[i].first >= at[j].first + sizes[j].Width || at[j].first >= at[i].first + sizes[i].Width ||
                           at[i].second >= at[j].second + sizes[j].Height ||
                           at[j].second >= at[i].second + sizes[i].Height;
        EXPECT_TRUE(apart) << name << ": " << m.Boxes[i].Id << " and " << m.Boxes[j].Id;
      }
    }
    for (const GraphLink& l : m.Links)
    {
      if (!l.Delayed && l.From != l.To)
      {
        EXPECT_LT(at[std::size_t(l.From)].first, at[std::size_t(l.To)].first) << name << ": " << l.Text;
      }
    }
  }
}

TEST(GraphModel, ALoopOrAnUnknownTypeIsDrawnAllTheSame)
{
  Diagnostics messages;
  const auto d = ReadPipelineText(
    "<pipeline version=\"1\"><node id=\"a\" type=\"Sum\"><input port=\"radiance\" from=\"b:radiance\"/></node>"
    "<node id=\"b\" type=\"Sum\"><input port=\"radiance\" from=\"a:radiance\"/></node>"
    "<node id=\"c\" type=\"Nothing\"><input port=\"x\" from=\"a:y\"/><input port=\"radiance\" from=\"gone:z\"/></node>"
    "</pipeline>",
    "x.xml", messages);
  EditDocument e;
  e.Set(d);
  const GraphModel m = GraphModel::Build(e, "", Registry());
  EXPECT_EQ(m.Boxes.size(), 3u);
  EXPECT_FALSE(m.Boxes[2].Known);
  EXPECT_EQ(ArrangeGraph(m, std::vector<BoxSize>(3)).size(), 3u);
}
