// SPDX-License-Identifier: BSD-3-Clause
// Loading a pipeline with its options; the commands that only look at it: check and explain.
#include "quellCommands.h"
#include "quellExplain.h"
#include "quellPipelineReader.h"

#include <nlohmann/json.hpp>

#include <cstdio>

namespace quell
{
namespace
{
void Print(const Diagnostics& messages)
{
  std::fputs(messages.ToText().c_str(), stderr);
}

std::string CountText(int n, const char* what)
{
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

int ParseFrame(const std::string& text, const std::string& option)
{
  long long n = 0;
  std::string error;
  if (!detail::ParseInt(text, -100000000, 200000000, n, error))
  {
    throw UsageError("--frames " + option + ": " + error + "; write A:B for frames A up to but not B");
  }
  return int(n);
}

void ParseFrames(const std::string& text, const Timeline& ticks, int& first, int& end)
{
  first = ticks.First;
  end = ticks.First + ticks.Count;
  if (text.empty())
  {
    return;
  }
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos)
  {
    first = ParseFrame(text, text);
    end = first + 1;
  }
  else
  {
    if (colon > 0)
    {
      first = ParseFrame(text.substr(0, colon), text);
    }
    if (colon + 1 < text.size())
    {
      end = ParseFrame(text.substr(colon + 1), text);
    }
  }
  if (first >= end)
  {
    throw UsageError("--frames " + text + ": no frame; A:B means frames A up to but not B");
  }
  if (first < ticks.First || end > ticks.First + ticks.Count)
  {
    throw UsageError("--frames " + text + ": the pipeline has frames " + std::to_string(ticks.First) + ":" +
      std::to_string(ticks.First + ticks.Count));
  }
}

std::optional<DisplayRegion> ParseRegion(const std::string& text)
{
  if (text.empty())
  {
    return {};
  }
  int v[4] = { 0, 0, 0, 0 };
  std::size_t at = 0;
  bool good = true;
  for (int i = 0; i < 4 && good; ++i)
  {
    const std::size_t comma = i < 3 ? text.find(',', at) : text.size();
    long long n = 0;
    std::string error;
    good = comma != std::string::npos && detail::ParseInt(text.substr(at, comma - at), 0, 1000000, n, error);
    v[i] = int(n);
    at = comma + 1;
  }
  if (!good)
  {
    throw UsageError("--region " + text + ": not of the form X0,Y0,X1,Y1 with whole numbers from 0");
  }
  if (v[0] >= v[2] || v[1] >= v[3])
  {
    throw UsageError("--region " + text + ": empty; X0,Y0 is the top left pixel and X1,Y1 the first one beyond the bottom right");
  }
  return DisplayRegion{ v[0], v[1], v[2], v[3] };
}

nlohmann::json PlanJson(const ExecutionPlan& plan)
{
  using nlohmann::json;
  json out;
  out["file"] = plan.File;
  out["width"] = plan.Width;
  out["height"] = plan.Height;
  out["frames"] = { { "first", plan.FirstTick }, { "end", plan.EndTick }, { "warmUp", plan.WarmUp }, { "rate", plan.Ticks.Rate } };
  out["variables"] = json::object();
  for (const auto& v : plan.Variables)
  {
    out["variables"][v.first] = v.second;
  }
  out["outputs"] = json::array();
  for (const auto& o : plan.Outputs)
  {
    out["outputs"].push_back({ { "name", o.Name }, { "from", o.From }, { "file", o.File }, { "everyFrame", o.EveryFrame } });
  }
  out["nodes"] = json::array();
  for (const PlannedNode& n : plan.Nodes)
  {
    json node = { { "id", n.Path }, { "type", n.Type }, { "executes", n.Executes }, { "makes", n.Makes }, { "passes", n.Passes },
      { "leftOut", n.LeftOut }, { "keeps", n.Keeps }, { "bytes", n.Bytes }, { "notes", n.Notes } };
    node["region"] = { n.Region.x0, plan.Height - n.Region.y1, n.Region.x1, plan.Height - n.Region.y0 };
    node["properties"] = json::object();
    for (const auto& p : n.Properties)
    {
      node["properties"][p.first] = p.second;
    }
    node["reads"] = json::array();
    for (const auto& r : n.Reads)
    {
      node["reads"].push_back({ { "port", r.Port }, { "from", r.Producer + ":" + r.Array }, { "delay", r.Delayed },
        { "needed", r.Needed }, { "halo", r.Halo } });
    }
    out["nodes"].push_back(node);
  }
  out["leftOut"] = json::array();
  for (const auto& l : plan.LeftOut)
  {
    out["leftOut"].push_back({ { "what", l.first }, { "why", l.second } });
  }
  return out;
}
}

bool PrepareRun(const PipelineArguments& a, PreparedRun& run)
{
  GraphOptions options;
  for (const std::string& d : a.Defines)
  {
    options.Defines.push_back(Assignment(d, "-D"));
  }
  for (const std::string& s : a.Sets)
  {
    options.Properties.push_back(Assignment(s, "--set"));
  }
  for (const std::string& o : a.Outputs)
  {
    options.Outputs.push_back(Assignment(o, "--output"));
  }
  options.Seed = a.Seed;
  options.OutputDirectory = a.OutputDirectory;
  run.Region = ParseRegion(a.Region);

  Diagnostics messages;
  run.Pipeline = LoadPipeline(a.File, AllStages(), options, messages);
  Print(messages);
  if (!run.Pipeline)
  {
    std::fprintf(stderr, "%s; nothing was executed\n", CountText(messages.ErrorCount(), "error").c_str());
    return false;
  }
  ParseFrames(a.Frames, run.Pipeline->Ticks, run.First, run.End);
  run.Executor = std::make_unique<PipelineExecutor>(run.Pipeline, AllStages());
  if (!run.Executor->HasTargets())
  {
    throw UsageError(a.File + ": no output has a file; give one in the pipeline or with --output NAME=FILE");
  }
  run.Executor->SetRegion(run.Region);
  return true;
}

int CheckCommand(const std::string& file)
{
  Diagnostics messages;
  const std::shared_ptr<Graph> graph = LoadPipeline(file, AllStages(), GraphOptions(), messages);
  Print(messages);
  if (!graph)
  {
    std::fprintf(stderr, "%s\n", CountText(messages.ErrorCount(), "error").c_str());
    return ExitUsage;
  }
  int nodes = 0;
  for (const GraphNode& n : graph->Nodes)
  {
    nodes += !n.Internal;
  }
  std::printf("%s: no mistakes; %s, %s, %s\n", file.c_str(), CountText(nodes, "node").c_str(),
    CountText(int(graph->Outputs.size()), "output").c_str(), CountText(graph->Ticks.Count, "frame").c_str());
  return ExitDone;
}

int ExplainCommand(const ExplainArguments& arguments)
{
  PreparedRun run;
  if (!PrepareRun(arguments, run))
  {
    return ExitUsage;
  }
  std::string error;
  if (run.Region && !run.Executor->CheckRegion(error))
  {
    throw UsageError(error);
  }
  const ExecutionPlan plan = MakePlan(*run.Executor, run.Region, run.First, run.End);
  if (!plan.Error.empty())
  {
    std::fprintf(stderr, "quell: error: %s\n", plan.Error.c_str());
    return ExitFailed;
  }
  const std::string text = arguments.Dot ? PlanDot(plan) : arguments.Json ? PlanJson(plan).dump(2) + "\n" : PlanText(plan);
  std::fputs(text.c_str(), stdout);
  return ExitDone;
}
}
