// SPDX-License-Identifier: BSD-3-Clause
// What the design promises, asked of the real thing: shipped pipelines with the path tracer and every filter in place.
#include "../AllStages.h"
#include "quellImageFile.h"
#include "quellPipelineExecutor.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"
#include "vtkSMPTools.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <gtest/gtest.h>

namespace
{
/// A shipped pipeline that writes nothing; `node` is looked at.
struct Pipeline
{
  std::shared_ptr<quell::Graph> graph;
  std::unique_ptr<quell::PipelineExecutor> executor;
  std::string node;

  Pipeline(const char* file, const char* lookAt, quell::ArraySet arrays, quell::GraphOptions::Assignments defines)
    : node(lookAt)
  {
    quell::GraphOptions options;
    options.Defines = std::move(defines);
    quell::Diagnostics diagnostics;
    graph =
      quell::LoadPipeline(std::string(QUELL_SOURCE_DIR "/Data/Pipelines/") + file, Registry(), options, diagnostics);
    if (!graph)
      throw std::runtime_error(std::string(file) + " has mistakes");
    executor = std::make_unique<quell::PipelineExecutor>(graph, Registry());
    executor->SetWriteOutputs(false);
    executor->Request(node, arrays);
  }
  void Tick(int t)
  {
    const quell::TickResult result = executor->RunTick(t);
    ASSERT_TRUE(result.Ok) << result.Error;
  }
  std::vector<float> Read(const char* name, const quell::Rect& r) const
  {
    vtkImageData* image = executor->GetImage(node);
    auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name));
    std::vector<float> out;
    if (!array)
      return out;
    const int* e = image->GetExtent();
    const int n = array->GetNumberOfComponents();
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        for (int c = 0; c < n; ++c)
          out.push_back(array->GetValue((vtkIdType(y - e[2]) * (e[1] - e[0] + 1) + x - e[0]) * n + c));
    return out;
  }
  quell::StageCounters Counters(const std::string& path) const
  {
    for (const quell::NodeCounters& n : executor->Counters())
      if (n.Path == path)
        return n.Counters;
    ADD_FAILURE() << "no node " << path;
    return {};
  }
};

bool SameBits(const std::vector<float>& a, const std::vector<float>& b)
{
  return !a.empty() && a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}
const quell::GraphOptions::Assignments small{ { "width", "48" }, { "height", "40" }, { "frames", "5" } };
}

TEST(ShippedPipelines, TemporalRegionEqualsCropBitForBit)
{
  Pipeline whole("svgf.xml", "taa", { "radiance" }, small);
  for (int t = 0; t < 4; ++t)
    whole.Tick(t);
  for (const quell::DisplayRegion& region :
    { quell::DisplayRegion{ 0, 0, 1, 1 }, { 10, 8, 31, 22 }, { 40, 33, 48, 40 } })
  {
    Pipeline part("svgf.xml", "taa", { "radiance" }, small);
    part.executor->SetRegion(region);
    for (int t = 0; t < 4; ++t)
      part.Tick(t);
    const quell::Rect r = region.ToFrame(40);
    EXPECT_TRUE(SameBits(whole.Read("radiance", r), part.Read("radiance", r))) << region.X0;
  }
}

TEST(ShippedPipelines, ThreadsDoNotChangeBits)
{
  Pipeline two("svgf.xml", "taa", { "radiance" }, small), one("svgf.xml", "taa", { "radiance" }, small);
  for (int t = 0; t < 3; ++t)
    two.Tick(t);
  vtkSMPTools::LocalScope(vtkSMPTools::Config{ 1 },
    [&]
    {
      for (int t = 0; t < 3; ++t)
        one.Tick(t);
    });
  EXPECT_TRUE(SameBits(two.Read("radiance", { 0, 0, 48, 40 }), one.Read("radiance", { 0, 0, 48, 40 })));
}

TEST(ShippedPipelines, SecondIdenticalRequestExecutesNothing)
{
  Pipeline run("svgf.xml", "taa", { "radiance" }, small);
  run.Tick(0);
  run.Tick(1);
  std::map<std::string, std::int64_t> before;
  for (const quell::NodeCounters& n : run.executor->Counters())
    before[n.Path] = n.Counters.Executions;
  const std::vector<float> pixels = run.Read("radiance", { 0, 0, 48, 40 });
  run.Tick(1);
  for (const quell::NodeCounters& n : run.executor->Counters())
    EXPECT_EQ(n.Counters.Executions, before[n.Path]) << n.Path;
  EXPECT_EQ(before["pt"], 2) << "many consumers, one execution a frame";
  EXPECT_TRUE(SameBits(pixels, run.Read("radiance", { 0, 0, 48, 40 })));
}

TEST(ShippedPipelines, SliderMoveKeepsThePastAndTracesNothing)
{
  Pipeline run("svgf.xml", "taa", { "radiance" }, small);
  for (int t = 0; t < 3; ++t)
    run.Tick(t);
  const std::vector<float> pixels = run.Read("radiance", { 0, 0, 48, 40 });
  const std::int64_t rays = run.Counters("pt").Rays;
  std::string error;
  ASSERT_TRUE(run.executor->SetProperty("indirect/atrous", "SigmaLuminance", "0.5", error)) << error;
  run.Tick(2);
  EXPECT_FALSE(SameBits(pixels, run.Read("radiance", { 0, 0, 48, 40 })));
  ASSERT_TRUE(run.executor->SetProperty("indirect/atrous", "SigmaLuminance", "2", error)) << error;
  run.Tick(2);
  EXPECT_TRUE(SameBits(pixels, run.Read("radiance", { 0, 0, 48, 40 }))) << "there and back gives the same frame";
  EXPECT_EQ(run.Counters("pt").Rays, rays) << "the source is not asked again";
}

TEST(ShippedPipelines, UnreadArraysAreNotTraced)
{
  // Guides alone: one camera ray a pixel, no light is sampled, no bounce is followed.
  Pipeline guides(
    "aov.xml", "pt", { "depth", "normalGeometric", "id" }, { { "width", "32" }, { "height", "32" }, { "spp", "1" } });
  guides.Tick(0);
  EXPECT_EQ(guides.Counters("pt").Rays, 32 * 32);
  EXPECT_EQ(guides.Counters("pt").Bytes, 32 * 32 * (1 + 3 + 1) * 4);
  Pipeline light("aov.xml", "pt", { "radiance" }, { { "width", "32" }, { "height", "32" }, { "spp", "1" } });
  light.Tick(0);
  EXPECT_GT(light.Counters("pt").Rays, 2 * 32 * 32);
  EXPECT_EQ(light.Counters("pt").Bytes, 32 * 32 * 3 * 4);
}

TEST(ShippedPipelines, TracesTheGrownRegionOfASpatialPipeline)
{
  Pipeline run("quick.xml", "sum", { "radiance" }, { { "width", "64" }, { "height", "64" }, { "spp", "1" } });
  run.executor->SetRegion(quell::DisplayRegion{ 30, 30, 32, 31 });
  run.Tick(0);
  const std::int64_t traced = run.Counters("pt").Pixels;
  EXPECT_GE(traced, 2 * 1);
  EXPECT_LT(traced, 24 * 24) << "the region and its halo, not the frame";
  EXPECT_EQ(run.Counters("sum").Pixels, 2);
}

TEST(ShippedPipelines, LayersAddUpToTheBeauty)
{
  const quell::ArraySet layers{ "radiance", "emission", "direct", "indirect" };
  Pipeline run("aov.xml", "pt", layers, { { "width", "48" }, { "height", "36" }, { "spp", "4" } });
  run.Tick(0);
  const quell::Rect all{ 0, 0, 48, 36 };
  const std::vector<float> sum = run.Read("radiance", all), e = run.Read("emission", all), d = run.Read("direct", all),
                           i = run.Read("indirect", all);
  ASSERT_FALSE(sum.empty());
  for (size_t k = 0; k < sum.size(); ++k)
    ASSERT_NEAR(sum[k], e[k] + d[k] + i[k], 4e-6 * (1 + std::fabs(sum[k]))) << k;
}

TEST(ShippedPipelines, EveryArrayComesBackFromItsFileUnderItsName)
{
  const std::string directory = testing::TempDir() + "/quell-aov";
  std::filesystem::remove_all(directory);
  quell::GraphOptions options;
  options.Defines = { { "width", "24" }, { "height", "18" }, { "spp", "4" } };
  options.OutputDirectory = directory;
  quell::Diagnostics diagnostics;
  auto graph = quell::LoadPipeline(QUELL_SOURCE_DIR "/Data/Pipelines/aov.xml", Registry(), options, diagnostics);
  ASSERT_TRUE(graph) << diagnostics.ToText();
  quell::PipelineExecutor executor(graph, Registry());
  const quell::TickResult result = executor.RunTick(0);
  ASSERT_TRUE(result.Ok) << result.Error;
  vtkImageData* made = executor.GetImage("pt");
  const auto read = quell::ReadImageFile(directory + "/out/aov.0000.exr");
  ASSERT_GE(made->GetPointData()->GetNumberOfArrays(), 30);
  for (int i = 0; i < made->GetPointData()->GetNumberOfArrays(); ++i)
  {
    const std::string name = made->GetPointData()->GetArrayName(i);
    auto a = vtkFloatArray::SafeDownCast(made->GetPointData()->GetArray(i));
    auto b = vtkFloatArray::SafeDownCast(read->GetPointData()->GetArray(name.c_str()));
    ASSERT_TRUE(b) << name;
    ASSERT_EQ(a->GetNumberOfValues(), b->GetNumberOfValues()) << name;
    EXPECT_EQ(0, std::memcmp(a->GetPointer(0), b->GetPointer(0), std::size_t(a->GetNumberOfValues()) * sizeof(float)))
      << name;
  }
  std::filesystem::remove_all(directory);
}
