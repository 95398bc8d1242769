// SPDX-License-Identifier: BSD-3-Clause
#include "quellVary.h"

#include <gtest/gtest.h>

#include <stdexcept>

using namespace quell;

namespace
{
using Values = std::vector<std::string>;

std::string Refusal(const std::string& text)
{
  try
  {
    ParseVary(text);
  }
  catch (const std::invalid_argument& e)
  {
    return e.what();
  }
  return "";
}
}

TEST(Vary, ListsAndRanges)
{
  const VaryAxis list = ParseVary("atrous.SigmaLuminance=1,2,4,2");
  EXPECT_EQ(list.What, "atrous.SigmaLuminance");
  EXPECT_EQ(list.Values, (Values{ "1", "2", "4" })) << "twice is once";
  EXPECT_EQ(ParseVary("a.B=1..4/4").Values, (Values{ "1", "2", "3", "4" }));
  EXPECT_EQ(ParseVary("a.B=0..1/5").Values, (Values{ "0", "0.25", "0.5", "0.75", "1" }));
  EXPECT_EQ(ParseVary("a.B=1..64*4").Values, (Values{ "1", "4", "16", "64" }));
  EXPECT_EQ(ParseVary("a.B=8..0.5*5").Values, (Values{ "8", "4", "2", "1", "0.5" }));
  EXPECT_EQ(ParseVary("a.B=7,1e-3..1e-1*3").Values, (Values{ "7", "0.001", "0.01", "0.1" }));
  EXPECT_EQ(ParseVary("pt.FirstSample=1..20000001/2").Values, (Values{ "1", "20000001" }));
  EXPECT_EQ(ParseVary("clamp=on,off").Values, (Values{ "on", "off" }));
  EXPECT_EQ(ParseVary("pt.Scene=../a.gltf,../b.gltf").Values, (Values{ "../a.gltf", "../b.gltf" })) << "no range";
}

TEST(Vary, WhatMakesNoSenseIsRefused)
{
  EXPECT_NE(Refusal("a.B").find("not of the form"), std::string::npos);
  EXPECT_NE(Refusal("=1").find("not of the form"), std::string::npos);
  EXPECT_NE(Refusal("a.B=").find("not of the form"), std::string::npos);
  EXPECT_NE(Refusal("a.B=1,,2").find("a value is missing"), std::string::npos);
  EXPECT_NE(Refusal("a.B=1,").find("a value is missing"), std::string::npos);
  EXPECT_NE(Refusal("a.B=1..4").find("does not say how many"), std::string::npos);
  EXPECT_NE(Refusal("a.B=1..4/1").find("no number of values from 2"), std::string::npos);
  EXPECT_NE(Refusal("a.B=0..4*3").find("ends above 0"), std::string::npos);
  EXPECT_NE(Refusal("a.B=1..x/3").find("is no number"), std::string::npos);
}

TEST(Vary, CombinationsAreAllOfThemTheLastAxisFastest)
{
  const auto all = Combinations({ { "a.X", { "1", "2" } }, { "b", { "on", "off" } } });
  ASSERT_EQ(all.size(), 4u);
  EXPECT_EQ(ChoiceText(all[0]), "a.X=1 b=on");
  EXPECT_EQ(ChoiceText(all[1]), "a.X=1 b=off");
  EXPECT_EQ(ChoiceText(all[2]), "a.X=2 b=on");
  ASSERT_EQ(Combinations({}).size(), 1u);
  EXPECT_EQ(ChoiceText(Combinations({}).front()), "as in the file");
  const VaryAxis hundred{ "a.X", Values(100, "1") };
  EXPECT_THROW(
    Combinations({ hundred, { "a.Y", Values(100, "1") }, { "a.Z", Values(100, "1") } }), std::invalid_argument);
  EXPECT_THROW(Combinations({ hundred, hundred }), std::invalid_argument) << "one thing twice";
}
