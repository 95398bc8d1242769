// SPDX-License-Identifier: BSD-3-Clause
// Facts that the filter report must find again, on small pictures and fewer seeds.
#include "quellFilterStudy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <set>
#include <stdexcept>

namespace
{
const quell::Study& Small()
{
  static const quell::Study study = []
  {
    quell::StudyOptions o;
    o.File = std::string(QUELL_SOURCE_DIR) + "/Testing/FilterStudy/filters.xml";
    o.Defines = { { "width", "48" }, { "height", "48" }, { "spp", "4" } };
    // Lower than the report's, so that a clamp's loss stands out of the scatter of few seeds.
    o.Properties = { { "length.Threshold", "0.3" }, { "luminance.Threshold", "0.17" }, { "spread.Threshold", "0.3" } };
    o.Only = { "none", "clamp-length", "clamp-luminance", "rank-clamp", "spread-near", "spread-image",
      "median-of-halves", "bilateral", "prefiltered", "cross", "estimate", "atrous", "steered", "gaussian" };
    o.Seeds = 24;
    o.ReferenceSamples = 512;
    return quell::RunStudy(o, quell::StudyRegistry());
  }();
  return study;
}
const quell::StudyCase& Case(const std::string& name)
{
  const quell::StudyCase* c = Small().Find(name);
  if (!c)
    throw std::runtime_error("no case " + name);
  return *c;
}
}

TEST(FilterStudy, UnfilteredIsUnbiased)
{
  const quell::StudyCase& c = Case("none");
  EXPECT_GT(c.Variance, .02);
  EXPECT_LT(std::fabs(c.Bias2), 4 * c.Bias2Error);
  EXPECT_LT(std::fabs(c.Bias2), .02 * c.Variance);
  EXPECT_LT(std::fabs(c.Energy), 4 * c.EnergyError);
  EXPECT_LT(c.EnergyError, .02);
  EXPECT_LT(c.Biased, .03); // heavy tails: more than the 0.3 % of a normal distribution
}

TEST(FilterStudy, ClampsLoseEnergyAndRedistributionGivesItBack)
{
  for (const char* name : { "clamp-length", "clamp-luminance", "rank-clamp", "median-of-halves" })
  {
    const quell::StudyCase& c = Case(name);
    EXPECT_LT(c.Energy, -4 * c.EnergyError) << name;
    EXPECT_LT(c.Variance, Case("none").Variance) << name;
    EXPECT_NE(c.Report.find("removed"), std::string::npos) << name;
  }
  for (const char* name : { "spread-near", "spread-image" })
  {
    const quell::StudyCase& c = Case(name);
    EXPECT_LT(std::fabs(c.Energy), 4 * c.EnergyError) << name;
    EXPECT_NEAR(c.Energy, Case("none").Energy, 1e-5) << name; // the same sums, seed by seed
    EXPECT_LT(c.Variance, Case("none").Variance) << name;
  }
  EXPECT_LT(Case("spread-near").Bias2, Case("spread-image").Bias2); // right place against no place
}

TEST(FilterStudy, SmoothingBuysVarianceWithBias)
{
  const quell::StudyCase& none = Case("none");
  for (const char* name : { "gaussian", "bilateral", "prefiltered", "cross", "estimate", "atrous", "steered" })
  {
    const quell::StudyCase& c = Case(name);
    EXPECT_LT(c.Variance, .5 * none.Variance) << name;
    EXPECT_GT(c.Bias2, none.Bias2) << name;
    if (name != std::string("gaussian")) // blurs across edges: its bias eats what it gains
    {
      EXPECT_LT(c.Error(), none.Error()) << name;
    }
    EXPECT_GT(c.Biased, none.Biased) << name;
  }
}

TEST(FilterStudy, ErrorIsBiasAndVariance)
{
  // The mean over seeds of the error against a noise-free reference is what Error() says. Take a filter whose result
  // does not depend on the seed: all its error is bias, whatever the references' noise.
  const quell::Study& s = Small();
  EXPECT_EQ(s.Seeds, 24);
  EXPECT_EQ(s.SamplesPerPixel, 4);
  EXPECT_EQ(s.Reference.size(), std::size_t(48 * 48 * 3));
  EXPECT_GT(s.Mixed, .01);
  EXPECT_LT(s.Mixed, .5);
  const std::string file = testing::TempDir() + "quell-study-black.xml";
  std::ofstream(file) << R"(<pipeline version="1" doc="black">
    <node id="pt" type="PathTraceSource"><property name="Scene" value=")" QUELL_SOURCE_DIR
                         R"(/Data/Scenes/cornell-box.gltf"/>
      <property name="Width" value="24"/><property name="Height" value="24"/><property name="SamplesPerPixel" value="2"/>
    </node>
    <node id="black" type="FireflyClamp"><input port="radiance" from="pt:radiance"/>
      <property name="Threshold" value="0"/></node>
    <output name="black" from="black:radiance"/></pipeline>)";
  quell::StudyOptions o;
  o.File = file;
  o.Seeds = 3;
  o.ReferenceSamples = 256;
  const quell::Study black = quell::RunStudy(o, quell::StudyRegistry());
  std::remove(file.c_str());
  const quell::StudyCase& c = black.Cases[0];
  EXPECT_EQ(c.Variance, 0);
  EXPECT_DOUBLE_EQ(c.Energy, -1);
  double expected = 0;
  for (const float r : black.Reference)
    expected += double(r) * r / (double(r) * r + .01) / double(black.Reference.size());
  EXPECT_NEAR(c.Bias2, expected, .01 * expected);
}

TEST(FilterStudy, SingleSamplesAreThoseOfThePixel)
{
  // What samples.xml compares is the same light: eight sources of one sample each are one source of eight.
  quell::StudyOptions o;
  o.File = std::string(QUELL_SOURCE_DIR) + "/Testing/FilterStudy/samples.xml";
  o.Defines = { { "width", "40" }, { "height", "24" }, { "lens", "0.06" }, { "clamp", "1e30" } };
  o.Only = { "none", "clamp-samples", "same" };
  o.Seeds = 2;
  o.ReferenceSamples = 64;
  const quell::Study s = quell::RunStudy(o, quell::StudyRegistry());
  const std::vector<float>&mean = s.Find("none")->Sample, &samples = s.Find("clamp-samples")->Sample;
  ASSERT_EQ(mean.size(), std::size_t(40 * 24 * 3));
  double energy = 0, filtered = 0;
  for (std::size_t i = 0; i < mean.size(); ++i)
  {
    ASSERT_NEAR(samples[i], mean[i], 3e-6 * mean[i] + 1e-9) << i;
    energy += mean[i];
    filtered += s.Find("same")->Sample[i];
  }
  EXPECT_GT(energy, 100);
  EXPECT_NEAR(filtered / energy, 1, .1);
  EXPECT_GT(s.Mixed, .05);
}

// Every filter of the registry is a case of the report; what changes no light on its own is named here.
TEST(FilterStudy, EveryFilterStageIsACase)
{
  const std::set<std::string> others = { "AlbedoDemodulate", "AlbedoModulate", "AovSplit", "EmissionSplit", "Sum",
    "Reproject" };
  std::string files;
  for (const char* name : { "filters.xml", "samples.xml", "temporal.xml" })
  {
    std::ifstream in(std::string(QUELL_SOURCE_DIR) + "/Testing/FilterStudy/" + name);
    files.append(std::istreambuf_iterator<char>(in), {});
  }
  std::ifstream in(std::string(QUELL_SOURCE_DIR) + "/Documentation/filters.md");
  const std::string page(std::istreambuf_iterator<char>(in), {});
  const quell::StageRegistry registry = quell::StudyRegistry();
  int cases = 0;
  for (const std::string& type : registry.Types())
  {
    const std::string& category = registry.Describe(type)->Category;
    if ((category != "Denoising" && category != "Temporal") || others.count(type))
      continue;
    ++cases;
    EXPECT_NE(files.find("doc=\"" + type + ": "), std::string::npos) << "no case of the study is of " << type;
    EXPECT_NE(page.find("| " + type + " | "), std::string::npos) << "./bootstrap.sh report filters: no row of " << type;
  }
  EXPECT_GT(cases, 12);
}

TEST(FilterStudy, MistakesAreTold)
{
  quell::StudyOptions o;
  o.File = std::string(QUELL_SOURCE_DIR) + "/Testing/FilterStudy/filters.xml";
  o.Properties = { { "length.Treshold", "1" } };
  try
  {
    quell::RunStudy(o, quell::StudyRegistry());
    FAIL() << "an unknown property was accepted";
  }
  catch (const std::runtime_error& e)
  {
    EXPECT_NE(std::string(e.what()).find("Treshold"), std::string::npos) << e.what();
  }
}
