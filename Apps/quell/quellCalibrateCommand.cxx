// SPDX-License-Identifier: BSD-3-Clause
// Measures what stages cost on this machine, for the estimates of explain and run.
#include "quellCommands.h"

#include "vtkQuellStage.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

namespace quell
{
namespace
{
/// Runs some frames of a pipeline without writing anything, and learns from all but the first. False after a mistake
/// that is printed.
bool Learn(const std::string& file, const CalibrateArguments& a, CostModel& model, int& executions)
{
  PipelineArguments arguments;
  arguments.File = file;
  arguments.Defines = a.Defines;
  arguments.AllowOutside = true; // nothing is written
  int errors = 0;
  const std::shared_ptr<Graph> graph = LoadPipelineOrImage(file, GraphOptionsOf(arguments), errors);
  if (!graph)
  {
    return false;
  }
  PipelineExecutor executor(graph, AllStages());
  executor.SetWriteOutputs(false);
  for (const GraphOutput& o : graph->Outputs)
  {
    executor.Request(graph->Nodes[std::size_t(o.Node)].Path, { o.Array });
  }
  executor.SetHistoryLength(1);
  const int last = graph->Ticks.First + graph->Ticks.Count - 1;
  for (int k = 0; k <= a.Frames; ++k)
  {
    // A still is made again and again.
    const int tick = std::min(graph->Ticks.First + k, last);
    for (const NodeCounters& c : executor.Counters())
    {
      if (vtkQuellStage* stage = executor.GetStage(c.Path))
      {
        stage->Modified();
        // A renderer would hand out the samples that it has.
        std::string error;
        if (stage->GetDescription().FindProperty("Seed"))
        {
          stage->SetPropertyText("Seed", std::to_string(k + 1), error);
        }
      }
    }
    executor.ResetCounters();
    const TickResult result = executor.RunTick(tick, TickMode::Frame);
    if (!result.Ok)
    {
      std::fprintf(stderr, "quell: error: %s: %s\n", file.c_str(), result.Error.c_str());
      return false;
    }
    for (const NodeCounters& c : executor.Counters())
    {
      const vtkQuellStage* stage = executor.GetStage(c.Path);
      if (k > 0 && stage && c.Counters.Executions > 0)
      {
        model.Measure(*stage, c.Type, double(c.Counters.Pixels), ThreadCount(), c.Counters.Seconds);
        ++executions;
      }
    }
  }
  return true;
}
}

int CalibrateCommand(const CalibrateArguments& a)
{
  const std::string file = a.Out.empty() ? CostModel::DefaultFile() : a.Out;
  if (file.empty())
  {
    throw UsageError("no directory for the measurements: neither XDG_CACHE_HOME nor HOME is set; say --out FILE");
  }
  std::error_code unknown;
  std::string problem;
  if (!a.Out.empty() && std::filesystem::exists(file, unknown))
  {
    CostModel::Load(file, problem);
    if (!problem.empty())
    {
      throw UsageError("--out " + file + ": what is there are no costs, and is not written over");
    }
  }
  CostModel model = LoadCosts();
  int executions = 0;
  for (const std::string& pipeline : a.Files)
  {
    if (!a.Quiet)
    {
      std::fprintf(stderr, "quell: measuring %s\n", pipeline.c_str());
    }
    if (!Learn(pipeline, a, model, executions))
    {
      std::fprintf(stderr, "nothing was written\n");
      return ExitUsage;
    }
  }
  const int types = model.Settle();
  if (types == 0)
  {
    throw UsageError("nothing was executed: the pipelines have no output, or no node");
  }
  model.Save(file);
  for (const auto& c : model.Nanoseconds())
  {
    std::printf("%-60s %10.4g ns\n", c.first.c_str(), c.second);
  }
  std::printf("learned %d costs from %d executions, wrote %s\n", types, executions, file.c_str());
  return ExitDone;
}
}
