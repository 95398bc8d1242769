// SPDX-License-Identifier: BSD-3-Clause
// The shipped pipelines that filter layers apart: what they split comes back, metals and mirrors too, and emission is
// left alone.
#include "../AllStages.h"
#include "quellPipelineExecutor.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <cmath>
#include <gtest/gtest.h>

namespace
{
/// One frame of a shipped pipeline on the gallery, 64 x 48.
struct Frame
{
  std::shared_ptr<quell::Graph> graph;
  std::unique_ptr<quell::PipelineExecutor> executor;

  Frame(const std::string& file, const char* samples, quell::GraphOptions::Assignments properties)
  {
    quell::GraphOptions options;
    options.Defines = { { "scene", QUELL_SOURCE_DIR "/Data/Scenes/material-gallery.gltf" }, { "width", "64" },
      { "height", "48" }, { "spp", samples } };
    options.Properties = std::move(properties);
    quell::Diagnostics diagnostics;
    graph = quell::LoadPipeline(QUELL_SOURCE_DIR "/Data/Pipelines/" + file, Registry(), options, diagnostics);
    if (!graph)
      throw std::runtime_error(file + " has mistakes");
    executor = std::make_unique<quell::PipelineExecutor>(graph, Registry());
    executor->SetWriteOutputs(false);
    executor->Request("sum", { "radiance" });
    executor->Request(
      "pt", { "radiance", "emission", "direct", "indirect", "albedoDiffuse", "albedoSpecular", "depth" });
    const quell::TickResult result = executor->RunTick(0);
    if (!result.Ok)
      throw std::runtime_error(result.Error);
  }
  std::vector<float> Read(const char* node, const char* name) const
  {
    auto array = vtkFloatArray::SafeDownCast(executor->GetImage(node)->GetPointData()->GetArray(name));
    return std::vector<float>(array->GetPointer(0), array->GetPointer(0) + array->GetNumberOfValues());
  }
};

struct Case
{
  const char* File;
  std::vector<std::string> Layers;
};
const Case cases[] = { { "layers-direct-indirect.xml", { "direct", "indirect" } },
  { "layers-diffuse-specular.xml", { "directDiffuse", "indirectDiffuse", "directSpecular", "indirectSpecular" } },
  { "layers-bounces.xml", { "bounce1", "bounce2", "bounces" } } };
}

TEST(LayerPipelines, WithoutFilteringTheBeautyComesBack)
{
  for (const Case& c : cases)
  {
    quell::GraphOptions::Assignments identity;
    for (const std::string& layer : c.Layers)
    {
      identity.emplace_back(layer + "/first.Radius", "0");
      identity.emplace_back(layer + "/second.Radius", "0");
    }
    const Frame frame(c.File, "2", identity);
    const std::vector<float> in = frame.Read("pt", "radiance"), out = frame.Read("sum", "radiance");
    ASSERT_EQ(in.size(), out.size());
    double largest = 0;
    for (size_t i = 0; i < in.size(); ++i)
    {
      // Black albedos, metals and mirrors included: demodulation is undone to rounding.
      ASSERT_NEAR(out[i], in[i], 2e-6 * (1 + std::fabs(in[i]))) << c.File << " " << i;
      largest = std::max(largest, double(in[i]));
    }
    EXPECT_GT(largest, 1);
  }
}

TEST(LayerPipelines, MetalsAndMirrorsKeepTheirLightAndEmissionIsLeftAlone)
{
  for (const Case& c : cases)
  {
    const Frame frame(c.File, "8", {});
    const std::vector<float> in = frame.Read("pt", "radiance"), out = frame.Read("sum", "radiance");
    const std::vector<float> emission = frame.Read("pt", "emission"), direct = frame.Read("pt", "direct"),
                             indirect = frame.Read("pt", "indirect");
    const std::vector<float> diffuse = frame.Read("pt", "albedoDiffuse"), specular = frame.Read("pt", "albedoSpecular");
    const std::vector<float> depth = frame.Read("pt", "depth");
    double metalIn = 0, metalOut = 0, allIn = 0, allOut = 0;
    int metals = 0, black = 0, changed = 0;
    for (size_t p = 0; p < in.size() / 3; ++p)
    {
      const float *i = &in[3 * p], *o = &out[3 * p];
      const bool metal = diffuse[3 * p] < 0.02f && specular[3 * p] > 0.3f && std::isfinite(depth[p]);
      for (int k = 0; k < 3; ++k)
      {
        // A firefly may be spread: what is compared is the bulk.
        allIn += std::min(i[k], 4.f);
        allOut += std::min(o[k], 4.f);
        metalIn += metal ? std::min(i[k], 4.f) : 0;
        metalOut += metal ? std::min(o[k], 4.f) : 0;
        changed += i[k] != o[k];
        if (direct[3 * p + k] == 0 && indirect[3 * p + k] == 0 && !std::isfinite(depth[p]))
        {
          ASSERT_EQ(o[k], emission[3 * p + k]) << c.File;
        }
      }
      metals += metal;
      black += metal && o[0] + o[1] + o[2] < 1e-3f;
    }
    ASSERT_GT(metals, 100);
    EXPECT_EQ(black, 0) << c.File;
    EXPECT_NEAR(metalOut / metalIn, 1, 0.05) << c.File;
    EXPECT_NEAR(allOut / allIn, 1, 0.03) << c.File;
    EXPECT_GT(changed, int(in.size()) / 2) << "something was filtered";
  }
}
