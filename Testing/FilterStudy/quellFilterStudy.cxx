// SPDX-License-Identifier: BSD-3-Clause
#include "quellFilterStudy.h"

#include "quellPipelineExecutor.h"
#include "quellRegisterDenoising.h"
#include "quellRegisterImageIO.h"
#include "quellRegisterRayTracing.h"
#include "quellRegisterTemporal.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

namespace quell
{
namespace
{
constexpr int ReferenceSeed = 1000000;
constexpr const char* ReferenceOutput = "reference";
constexpr int Block = 8;
constexpr double Floor = 0.01;
/// A pixel is mixed when the variance of its samples' normals or albedos is above this.
constexpr double MixedVariance = 0.01;

double Luminance(const double* c)
{
  return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
}

/// Mean and sum of squared deviations of every pixel's channels and luminance.
struct Moments
{
  int Count = 0;
  std::vector<double> Mean, M2; ///< 4 per pixel: r, g, b, luminance
  std::vector<double> Energy;   ///< per seed
  std::vector<float> First;

  void Add(const float* pixels, std::size_t n)
  {
    if (this->Mean.empty())
    {
      this->Mean.assign(4 * n, 0);
      this->M2.assign(4 * n, 0);
      this->First.assign(pixels, pixels + 3 * n);
    }
    ++this->Count;
    double energy = 0;
    for (std::size_t i = 0; i < n; ++i)
    {
      double v[4] = { pixels[3 * i], pixels[3 * i + 1], pixels[3 * i + 2], 0 };
      v[3] = Luminance(v);
      energy += v[3];
      for (int k = 0; k < 4; ++k)
      {
        double& mean = this->Mean[4 * i + k];
        const double d = v[k] - mean;
        mean += d / this->Count;
        this->M2[4 * i + k] += d * (v[k] - mean);
      }
    }
    this->Energy.push_back(energy);
  }
  double Variance(std::size_t i) const { return this->Count > 1 ? this->M2[i] / (this->Count - 1) : 0; }
};

const float* Pixels(vtkImageData* image, const std::string& array, int components, const std::string& who)
{
  auto* floats = image ? vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array.c_str())) : nullptr;
  if (!floats || floats->GetNumberOfComponents() != components)
    throw std::runtime_error(who + " has no array \"" + array + "\" of " + std::to_string(components) + " components");
  return floats->GetPointer(0);
}

std::shared_ptr<const Graph> Load(const StudyOptions& options, const StageRegistry& registry)
{
  GraphOptions o;
  o.Defines = options.Defines;
  o.Properties = options.Properties;
  Diagnostics diagnostics;
  std::shared_ptr<const Graph> graph = LoadPipeline(options.File, registry, o, diagnostics);
  if (!graph)
    throw std::runtime_error(diagnostics.ToText());
  return graph;
}

/// Ticks firstTick ... lastTick with a seed of its own for every source that `targets` need.
void Run(PipelineExecutor& executor, const std::vector<int>& targets, long long seed, int firstTick, int lastTick)
{
  const Graph& graph = executor.GetGraph();
  const std::vector<bool> needed = graph.Needed(targets);
  std::string error;
  for (std::size_t i = 0; i < graph.Nodes.size(); ++i)
    if (needed[i] && graph.Nodes[i].Description().FindProperty("Seed") &&
        !executor.SetProperty(graph.Nodes[i].Path, "Seed", std::to_string(seed), error))
      throw std::runtime_error(error);
  executor.ClearHistory();
  for (int tick = firstTick; tick <= lastTick; ++tick)
  {
    const TickResult result = executor.RunTick(tick);
    if (!result.Ok)
      throw std::runtime_error(result.Error);
  }
}

/// The source's picture of many samples, twice.
struct Reference
{
  std::vector<float> Color[2];
  std::vector<double> Variance; ///< of the mean luminance of pt:radiance, both together
  std::vector<bool> Mixed;
  int Width = 0, Height = 0;
};

Reference RunReference(const StudyOptions& options, const StageRegistry& registry)
{
  StudyOptions o = options;
  o.Properties.emplace_back("pt.SamplesPerPixel", std::to_string(options.ReferenceSamples));
  const std::shared_ptr<const Graph> graph = Load(o, registry);
  PipelineExecutor executor(graph, registry);
  executor.SetWriteOutputs(false);
  if (!executor.Request("pt", { "radiance", "variance", "varianceNormal", "varianceAlbedo" }))
    throw std::runtime_error("the pipeline has no source \"pt\"");
  std::string node = "pt", array = "radiance";
  if (const GraphOutput* output = graph->FindOutput(ReferenceOutput))
  {
    node = graph->Nodes[output->Node].Path;
    array = output->Array;
    if (node != "pt")
      executor.Request(node, { array });
  }
  Reference r;
  for (int i = 0; i < 2; ++i)
  {
    Run(executor, { graph->Find("pt"), graph->Find(node) }, ReferenceSeed + i, options.LastTick, options.LastTick);
    vtkImageData* image = executor.GetImage("pt");
    const int* size = image->GetDimensions();
    r.Width = size[0];
    r.Height = size[1];
    const std::size_t n = std::size_t(r.Width) * r.Height;
    const float* color = Pixels(executor.GetImage(node), array, 3, node);
    const float* variance = Pixels(image, "variance", 1, "pt");
    const float* normal = Pixels(image, "varianceNormal", 1, "pt");
    const float* albedo = Pixels(image, "varianceAlbedo", 1, "pt");
    r.Color[i].assign(color, color + 3 * n);
    r.Variance.resize(n);
    r.Mixed.resize(n);
    for (std::size_t p = 0; p < n; ++p)
    {
      r.Variance[p] += variance[p] / 4.;
      r.Mixed[p] = r.Mixed[p] || double(normal[p] + albedo[p]) * options.ReferenceSamples > MixedVariance;
    }
  }
  return r;
}

StudyCase Judge(const Moments& m, const Reference& r)
{
  StudyCase c;
  const std::size_t n = r.Variance.size();
  const int k = m.Count;
  c.Sample = m.First;
  c.Bias.resize(n);
  std::vector<double> bias2(n);
  double energy[2] = {}, mixed = 0;
  std::size_t mixedPixels = 0, off = 0;
  for (std::size_t i = 0; i < n; ++i)
  {
    double variance = 0, mean[3];
    for (int ch = 0; ch < 3; ++ch)
    {
      const double r1 = r.Color[0][3 * i + ch], r2 = r.Color[1][3 * i + ch], t = m.Mean[4 * i + ch];
      const double s2 = m.Variance(4 * i + ch);
      mean[ch] = (r1 + r2) / 2;
      const double weight = 1 / (mean[ch] * mean[ch] + Floor) / 3;
      bias2[i] += ((t - r1) * (t - r2) - s2 / k) * weight;
      variance += s2 * weight;
    }
    c.Bias2 += bias2[i] / double(n);
    c.Variance += variance / double(n);
    if (r.Mixed[i])
    {
      mixed += bias2[i] + variance;
      ++mixedPixels;
    }
    for (int j = 0; j < 2; ++j)
      energy[j] += 0.2126 * r.Color[j][3 * i] + 0.7152 * r.Color[j][3 * i + 1] + 0.0722 * r.Color[j][3 * i + 2];
    const double l = Luminance(mean), delta = m.Mean[4 * i + 3] - l;
    off += std::fabs(delta) > 3 * std::sqrt(m.Variance(4 * i + 3) / k + r.Variance[i]) + 1e-6 * l;
    c.Bias[i] = float(delta / (l + 0.1));
  }
  c.MixedError = mixedPixels ? mixed / double(mixedPixels) : 0;
  c.Biased = double(off) / double(n);
  // Blocks rather than pixels, because filters make neighbours alike.
  double sum = 0, squares = 0;
  int blocks = 0;
  for (int y = 0; y < r.Height; y += Block)
    for (int x = 0; x < r.Width; x += Block)
    {
      double b = 0;
      int pixels = 0;
      for (int qy = y; qy < std::min(y + Block, r.Height); ++qy)
        for (int qx = x; qx < std::min(x + Block, r.Width); ++qx, ++pixels)
          b += bias2[std::size_t(qy) * r.Width + qx];
      sum += b / pixels;
      squares += b * b / pixels / pixels;
      ++blocks;
    }
  if (blocks > 1)
    c.Bias2Error = std::sqrt(std::max(0., squares - sum * sum / blocks) / (blocks - 1.) / blocks);
  const double reference = (energy[0] + energy[1]) / 2;
  double mean = 0, spread = 0;
  for (const double e : m.Energy)
    mean += e / k;
  for (const double e : m.Energy)
    spread += (e - mean) * (e - mean);
  c.Energy = mean / reference - 1;
  c.EnergyError = std::sqrt(spread / (k - 1.) / k + (energy[0] - energy[1]) * (energy[0] - energy[1]) / 4) / reference;
  return c;
}
}

const StudyCase* Study::Find(const std::string& name) const
{
  for (const StudyCase& c : this->Cases)
    if (c.Name == name)
      return &c;
  return nullptr;
}

StageRegistry StudyRegistry()
{
  StageRegistry registry;
  RegisterRayTracingStages(registry);
  RegisterDenoisingStages(registry);
  RegisterTemporalStages(registry);
  RegisterImageIOStages(registry);
  return registry;
}

Study RunStudy(const StudyOptions& options, const StageRegistry& registry)
{
  const auto say = [&options](const std::string& text)
  {
    if (options.Progress)
      options.Progress(text);
  };
  const std::shared_ptr<const Graph> graph = Load(options, registry);
  say("reference");
  const Reference reference = RunReference(options, registry);
  const std::size_t n = reference.Variance.size();

  Study study;
  study.Width = reference.Width;
  study.Height = reference.Height;
  study.Seeds = options.Seeds;
  study.ReferenceSamples = options.ReferenceSamples;
  study.Reference.resize(3 * n);
  for (std::size_t i = 0; i < 3 * n; ++i)
    study.Reference[i] = 0.5f * (reference.Color[0][i] + reference.Color[1][i]);
  std::size_t mixed = 0;
  for (const bool m : reference.Mixed)
    mixed += m;
  study.Mixed = double(mixed) / double(n);

  PipelineExecutor executor(graph, registry);
  executor.SetWriteOutputs(false);
  std::map<std::string, ArraySet> asked;
  std::vector<int> targets;
  std::vector<GraphOutput> outputs;
  for (const GraphOutput& out : graph->Outputs)
  {
    const bool wanted =
      options.Only.empty() || std::find(options.Only.begin(), options.Only.end(), out.Name) != options.Only.end();
    if (out.Name == ReferenceOutput || !wanted)
      continue;
    outputs.push_back(out);
    asked[graph->Nodes[out.Node].Path].insert(out.Array);
    targets.push_back(out.Node);
  }
  for (const auto& entry : asked)
    executor.Request(entry.first, entry.second);
  if (outputs.empty())
    throw std::runtime_error("no output to judge");
  std::vector<Moments> moments(outputs.size());
  for (int seed = 1; seed <= options.Seeds; ++seed)
  {
    say("seed " + std::to_string(seed) + " of " + std::to_string(options.Seeds));
    Run(executor, targets, seed, 0, options.LastTick);
    for (std::size_t o = 0; o < moments.size(); ++o)
    {
      const GraphNode& node = graph->Nodes[outputs[o].Node];
      moments[o].Add(Pixels(executor.GetImage(node.Path), outputs[o].Array, 3, node.Path), n);
    }
  }
  std::map<std::string, double> seconds;
  for (const NodeCounters& counters : executor.Counters())
    seconds[counters.Path] = counters.Counters.Seconds / options.Seeds / (options.LastTick + 1);
  for (std::size_t o = 0; o < moments.size(); ++o)
  {
    const GraphOutput& out = outputs[o];
    StudyCase c = Judge(moments[o], reference);
    c.Name = out.Name;
    for (const PipelineOutput& written : graph->Document->Outputs)
      if (written.Name.Value == out.Name)
        c.Doc = written.Doc.Value;
    const std::vector<bool> needed = graph->Needed({ out.Node });
    for (std::size_t i = 0; i < needed.size(); ++i)
    {
      const GraphNode& node = graph->Nodes[i];
      if (!needed[i] || node.Description().Inputs.empty())
        continue;
      c.Seconds += seconds[node.Path];
      if (vtkQuellStage* stage = executor.GetStage(node.Path))
        c.Report += stage->GetReport().empty() ? "" : (c.Report.empty() ? "" : "; ") + stage->GetReport();
    }
    study.Cases.push_back(std::move(c));
  }
  const int pt = graph->Find("pt");
  for (const GraphProperty& p : graph->Nodes[pt].Properties)
    if (p.Name == "SamplesPerPixel")
      study.SamplesPerPixel = std::stoi(p.Text);
  return study;
}
}
