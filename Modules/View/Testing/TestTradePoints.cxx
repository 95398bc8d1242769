// SPDX-License-Identifier: BSD-3-Clause
#include "AllStages.h"
#include "quellEditDocument.h"
#include "quellTradePoints.h"
#include "vtkImageData.h"

#include <gtest/gtest.h>

using namespace quell;

namespace
{
struct States
{
  EditDocument Doc{ &Registry() };
  std::shared_ptr<const PipelineDocument> First, Second;
  States()
  {
    std::vector<Diagnostic> messages;
    EXPECT_TRUE(this->Doc.Open(std::string(QUELL_SOURCE_DIR) + "/Data/Pipelines/quick.xml", messages));
    this->First = this->Doc.Get();
    this->Doc.SetProperty("", "blur", "SigmaSpatial", "1.25");
    this->Second = this->Doc.Get();
  }
  TradePoint Point(std::shared_ptr<const PipelineDocument> document, double milliseconds, double error) const
  {
    TradePoint p;
    p.Document = document;
    p.Milliseconds = milliseconds;
    p.Error = error;
    p.Tick = 31;
    p.Target = { "sum", "radiance" };
    p.Reference = "reference.exr";
    return p;
  }
};
}

TEST(TradePoints, OnlyPointsOfOneThingAreComparedWithEachOther)
{
  const States s;
  TradePoints points;
  points.Clear(s.First);
  EXPECT_EQ(points.Add(s.Point(s.First, 100, 0.3)), 0);
  // Faster and better than all others, each of something else.
  TradePoint frame = s.Point(s.First, 10, 0.01), node = frame, array = frame, reference = frame, history = frame;
  frame.Tick = 0;
  node.Target.Node = "pt";
  array.Target.Array = "albedo";
  reference.Reference = "other.exr";
  history.History = HistoryMode::None;
  int index = 1;
  for (const TradePoint& other : { frame, node, array, reference, history })
  {
    EXPECT_EQ(points.Add(other), index++);
  }
  for (const TradePoint& p : points.All())
  {
    EXPECT_TRUE(p.Pareto) << "alone in its list";
    EXPECT_EQ(p.Label, "as opened");
  }
  EXPECT_EQ(points.ComparableWith(s.Point(s.Second, 0, 0)), std::vector<int>{ 0 });
  // A change is compared with what it changed, and only with that.
  EXPECT_EQ(points.Add(s.Point(s.Second, 90, 0.2)), 6);
  EXPECT_FALSE(points.All()[0].Pareto);
  EXPECT_TRUE(points.All()[6].Pareto);
  for (int i = 1; i < 6; ++i)
  {
    EXPECT_TRUE(points.All()[std::size_t(i)].Pareto) << i;
  }
  EXPECT_EQ(points.ComparableWith(points.All()[0]), (std::vector<int>{ 0, 6 }));
  EXPECT_EQ(points.ComparableWith(points.All()[2]), std::vector<int>{ 2 });
  points.Remove(6);
  EXPECT_TRUE(points.All()[0].Pareto) << "better again than nothing";
}

TEST(TradePoints, AStateMeasuredAgainIsThePointThatItWas)
{
  const States s;
  TradePoints points;
  EXPECT_EQ(points.Add(s.Point(s.First, 100, 0.3)), 0);
  EXPECT_EQ(points.Add(s.Point(s.Second, 90, 0.2)), 1);
  EXPECT_EQ(points.Add(s.Point(s.First, 80, 0.3)), 0);
  EXPECT_EQ(points.Add(s.Point(s.First, 120, 0.3)), 0);
  EXPECT_EQ(points.All().size(), 2u);
  EXPECT_EQ(points.All()[0].Milliseconds, 80);
}

TEST(TradePoints, NamesSayWhatDiffersFromTheOpenedFile)
{
  const States s;
  TradePoints points;
  points.Clear(s.First);
  // The reference came after the change: the first point is not "as opened".
  points.Add(s.Point(s.Second, 90, 0.2));
  EXPECT_NE(points.All()[0].Label.find("blur.SigmaSpatial"), std::string::npos) << points.All()[0].Label;
  EXPECT_NE(points.All()[0].Label.find("1.25"), std::string::npos) << points.All()[0].Label;
  points.Add(s.Point(s.First, 100, 0.3));
  EXPECT_EQ(points.All()[1].Label, "as opened");
  points.Clear();
  points.Add(s.Point(s.Second, 90, 0.2));
  EXPECT_EQ(points.All()[0].Label, "as opened") << "a graph that was begun here: the first point is where it begins";
}
