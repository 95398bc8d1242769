// SPDX-License-Identifier: BSD-3-Clause
#include "TestStages.h"
#include "quellFrameFacts.h"
#include "quellStageRegistry.h"
#include "vtkFieldData.h"
#include "vtkNew.h"

#include <gtest/gtest.h>
#include <set>

using namespace quelltest;

TEST(StageDescription, ReflectsRangeAndDefaultFromTheAccessors)
{
  vtkNew<vtkQuellTestBox> box;
  const quell::Property* p = box->GetDescription().FindProperty("Gain");
  ASSERT_TRUE(p);
  EXPECT_EQ(p->Minimum, 0);
  EXPECT_EQ(p->Maximum, 10);
  EXPECT_EQ(p->DefaultText, "1");
  EXPECT_STREQ(p->TypeName(), "double");
  EXPECT_EQ(box->GetDescription().Type, "TestBox");
}

TEST(StageDescription, RefusesWhatTheClampMacroWouldSwallow)
{
  vtkNew<vtkQuellTestBox> box;
  std::string error;
  const vtkMTimeType before = box->GetMTime();
  for (const char* bad : { "nan", "inf", "11", "-0.1", "0,05", "1x", "", "0x10", "1 2" })
    EXPECT_FALSE(box->SetPropertyText("Gain", bad, error)) << bad;
  EXPECT_EQ(box->GetMTime(), before);
  EXPECT_FALSE(box->SetPropertyText("Gain", "11", error));
  EXPECT_EQ(error, "11 is outside [0, 10] (default 1)");
  EXPECT_FALSE(box->SetPropertyText("Radius", "1.5", error));
  EXPECT_EQ(error, "\"1.5\" is not a whole number (default 1)");
  EXPECT_TRUE(box->SetPropertyText("Gain", " 0.1 ", error));
  EXPECT_EQ(box->GetPropertyText("Gain"), "0.1");
}

TEST(StageDescription, NearestName)
{
  const std::vector<std::string> names{ "Alpha", "MomentsAlpha", "Radius" };
  EXPECT_EQ(quell::NearestName("Aplha", names), "Alpha");
  EXPECT_EQ(quell::NearestName("radius", names), "Radius");
  EXPECT_EQ(quell::NearestName("Completely", names), "");
}

TEST(StageDescription, ArrayTableNamesAreUniqueAndConsistent)
{
  std::set<std::string> names;
  for (const quell::ArrayType& a : quell::KnownArrays())
  {
    EXPECT_TRUE(names.insert(a.Name).second) << a.Name;
    EXPECT_EQ(a.Components, quell::KindComponents(a.Kind)) << a.Name;
  }
  EXPECT_EQ(quell::FindArray("albedo")->Background, 1.f);
  EXPECT_EQ(quell::FindArray("nothing"), nullptr);
}

TEST(StageRegistry, CreatesByName)
{
  quell::StageRegistry registry;
  registry.Add<vtkQuellTestBox>();
  registry.Add<vtkQuellTestSource>();
  EXPECT_EQ(registry.Types(), (std::vector<std::string>{ "TestBox", "TestSource" }));
  EXPECT_TRUE(vtkQuellTestBox::SafeDownCast(registry.Create("TestBox")));
  EXPECT_FALSE(registry.Create("TestBocks"));
  EXPECT_FALSE(registry.Describe("TestBocks"));
}

TEST(FrameFacts, RoundTripIsExact)
{
  quell::FrameFacts f;
  f.HasCamera = true;
  f.WorldToNdc.m[1][2] = 1. / 3;
  f.WorldToCamera.m[3][0] = -7e-300;
  f.Origin = { 1e6 + 0.1, -2, 3 };
  f.Tick = 31;
  f.Time = 31. / 24;
  f.Seed = (1LL << 62) + 1;
  f.SamplesPerPixel = 4;
  f.Scene = "abc";
  vtkNew<vtkFieldData> data;
  f.Write(data);
  const quell::FrameFacts g = quell::FrameFacts::Read(data);
  EXPECT_TRUE(g.HasCamera);
  EXPECT_EQ(g.WorldToNdc.m[1][2], f.WorldToNdc.m[1][2]);
  EXPECT_EQ(g.WorldToCamera.m[3][0], f.WorldToCamera.m[3][0]);
  EXPECT_EQ(g.Origin, f.Origin);
  EXPECT_EQ(g.Tick, 31);
  EXPECT_EQ(g.Time, f.Time);
  EXPECT_EQ(g.Seed, f.Seed);
  EXPECT_EQ(g.SamplesPerPixel, 4);
  EXPECT_EQ(g.Scene, "abc");
}
