// SPDX-License-Identifier: BSD-3-Clause
// Loading a pipeline with its options; the commands that only look at it: check and explain.
#include "quellCheckpoint.h"
#include "quellCommands.h"
#include "quellExplain.h"
#include "quellImageFile.h"
#include "quellJsonText.h"
#include "quellMemoryLimits.h"
#include "quellPipelineReader.h"
#include "quellProvenance.h"

#include "vtkSMPTools.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <unordered_set>

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
    throw UsageError("--frames " + option + ": " + error + "; write A:B for frames A to B");
  }
  return int(n);
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
    throw UsageError(
      "--region " + text + ": empty; X0,Y0 is the top left pixel and X1,Y1 the first one beyond the bottom right");
  }
  return DisplayRegion{ v[0], v[1], v[2], v[3] };
}

/// By its first bytes: the name may be anything.
bool IsExr(const std::string& file)
{
  std::error_code code;
  if (!std::filesystem::is_regular_file(file, code))
  {
    return false; // opening a pipe would wait for ever
  }
  std::ifstream stream(file, std::ios::binary);
  const unsigned char magic[4] = { 0x76, 0x2f, 0x31, 0x01 };
  char head[4] = {};
  return stream.read(head, sizeof head) && std::memcmp(head, magic, sizeof head) == 0;
}

/// What an image that a run wrote says of what it was made from.
struct ImageOrigin
{
  std::string Inputs; ///< lines of hash and file name
  int Tick = 0;
};

void WarnOfChangedInputs(const std::string& file, const ImageOrigin& origin, const Graph& graph)
{
  if (origin.Inputs.empty())
  {
    return;
  }
  std::map<std::string, std::string> now = InputHashes(graph);
  now.merge(SequenceHashes(graph, origin.Tick));
  std::istringstream lines(origin.Inputs);
  std::string hash, name;
  while (lines >> hash && std::getline(lines >> std::ws, name))
  {
    const auto input = now.find(name);
    if (input != now.end() && input->second != hash)
    {
      std::fprintf(stderr, "quell: warning: %s has changed since %s was made\n", name.c_str(), file.c_str());
    }
  }
}

nlohmann::json PlanJson(const ExecutionPlan& plan)
{
  using nlohmann::json;
  json out;
  out["file"] = plan.File;
  out["width"] = plan.Width;
  out["height"] = plan.Height;
  out["frames"] = { { "first", plan.FirstTick }, { "end", plan.EndTick }, { "warmUp", plan.WarmUp },
    { "restWeight", plan.RestWeight }, { "rate", plan.Ticks.Rate } };
  out["arrayBytes"] = PlanBytes(plan);
  out["memoryBytes"] = PlanMemory(plan);
  int unknown = 0;
  const double seconds = PlanSeconds(plan, unknown);
  if (seconds >= 0)
  {
    out["estimate"] = { { "seconds", seconds }, { "threads", plan.Threads }, { "nodesNotKnown", unknown },
      { "ofThisMachine", plan.CostsOfAnotherMachine == 0 } };
  }
  out["variables"] = json::object();
  for (const auto& v : plan.Variables)
  {
    out["variables"][v.first] = v.second;
  }
  out["outputs"] = json::array();
  for (const auto& o : plan.Outputs)
  {
    out["outputs"].push_back(
      { { "name", o.Name }, { "from", o.From }, { "file", o.File }, { "everyFrame", o.EveryFrame } });
  }
  out["nodes"] = json::array();
  for (const PlannedNode& n : plan.Nodes)
  {
    json node = { { "id", n.Path }, { "type", n.Type }, { "executes", n.Executes }, { "makes", n.Makes },
      { "passes", n.Passes }, { "leftOut", n.LeftOut }, { "keeps", n.Keeps }, { "bytes", n.Bytes },
      { "scratchBytes", n.ScratchBytes }, { "keptBytes", n.KeptBytes }, { "notes", n.Notes } };
    if (n.Seconds >= 0)
    {
      node["seconds"] = n.Seconds;
    }
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

void ParseFrames(const std::string& text, const Timeline& ticks, int& first, int& end, const std::string& whose)
{
  const int last = ticks.First + ticks.Count - 1;
  first = ticks.First;
  end = last + 1;
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
      end = ParseFrame(text.substr(colon + 1), text) + 1;
    }
  }
  const std::string range = std::to_string(ticks.First) + ":" + std::to_string(last);
  if (first >= end)
  {
    throw UsageError("--frames " + text + ": no frame; A:B means frames A to B, " + whose + " has " + range);
  }
  if (first < ticks.First || first > last)
  {
    throw UsageError("--frames " + text + ": " + whose + " has frames " + range);
  }
  if (end > last + 1)
  {
    std::fprintf(stderr, "quell: --frames %s: %s has frames %s; ending with frame %d\n", text.c_str(), whose.c_str(),
      range.c_str(), last);
    end = last + 1;
  }
}

GraphOptions GraphOptionsOf(const PipelineArguments& a)
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
  options.Outside = a.AllowOutside ? OutsideOutputs::Allowed : OutsideOutputs::Refused;
  return options;
}

static constexpr int MostCompared = 100000; // names of two patterns

/// True where the two names can be those of one file; both may be patterns with ####.
static bool MayBeOneFile(const std::string& a, const std::string& b, int first, int end)
{
  const auto normal = [](const std::string& path)
  {
    std::error_code code;
    const std::filesystem::path absolute = std::filesystem::absolute(path, code);
    const std::filesystem::path real = std::filesystem::weakly_canonical(absolute, code);
    return code ? absolute.lexically_normal().string() : real.string();
  };
  const std::string x = normal(a), y = normal(b);
  const auto isPattern = [](const std::string& path)
  { return std::filesystem::path(path).filename().string().find('#') != std::string::npos; };
  if (x == y || (!isPattern(x) && !isPattern(y)))
  {
    return x == y;
  }
  // Of two patterns the one may write in one frame what the other reads in another.
  const std::string &pattern = isPattern(x) ? x : y, &other = isPattern(x) ? y : x;
  const std::string directory = std::filesystem::path(pattern).parent_path();
  if (std::filesystem::path(other).parent_path() != directory)
  {
    return false;
  }
  std::unordered_set<std::string> names;
  for (int tick = first; tick < end && isPattern(other) && tick - first < MostCompared; ++tick)
  {
    names.insert(SequencePath(other, tick));
  }
  names.insert(other);
  for (int tick = first; tick < end; ++tick)
  {
    if (names.count(SequencePath(pattern, tick)))
    {
      return true;
    }
  }
  return false;
}

/// "FILE, which node "ID" reads" where a node of the run may read `file`, else nothing.
static std::string ReaderOf(const std::string& file, const PreparedRun& run)
{
  // What other frames read is as dear.
  const Timeline& ticks = run.Pipeline->Ticks;
  const int first = std::min(run.First, ticks.First), end = std::max(run.End, ticks.First + ticks.Count);
  for (const GraphNode& n : run.Pipeline->Nodes)
  {
    for (const GraphProperty& p : n.Properties)
    {
      const Property* property = n.Description().FindProperty(p.Name);
      if (property && property->Kind == Property::Type::Path && !p.Text.empty() && !n.Internal &&
          n.Type != "ImageWriter" && MayBeOneFile(file, p.Text, first, end))
      {
        return p.Text + ", which node " + Quoted(n.Path) + " reads";
      }
    }
  }
  return {};
}

/// What a run would write over: another of its outputs, or a file that it reads.
static void CheckFiles(const PipelineArguments& a, const PreparedRun& run)
{
  const Graph& graph = *run.Pipeline;
  for (const GraphOutput& o : graph.Outputs)
  {
    if (o.File.empty())
    {
      continue;
    }
    const std::string what = "output " + Quoted(o.Name) + " would write over ";
    for (const GraphOutput& other : graph.Outputs)
    {
      if (&other > &o && !other.File.empty() && MayBeOneFile(o.File, other.File, run.First, run.End))
      {
        throw UsageError("outputs " + Quoted(o.Name) + " and " + Quoted(other.Name) +
                         " write the same file: " + o.File + " and " + other.File + "; nothing was executed");
      }
    }
    if (MayBeOneFile(o.File, a.File, run.First, run.End) && !IsExr(a.File))
    {
      throw UsageError(what + "the pipeline file " + a.File + "; nothing was executed");
    }
    const std::string reader = ReaderOf(o.File, run);
    if (!reader.empty())
    {
      throw UsageError(what + reader + "; nothing was executed");
    }
  }
}

void CheckStatistics(const std::string& file, const PipelineArguments& a, const PreparedRun& run)
{
  const std::string what = "--stats " + file + " would write over ", end = "; nothing was executed";
  std::error_code unknown;
  if (std::filesystem::equivalent(file, a.File, unknown))
  {
    throw UsageError(what + "the pipeline file" + end);
  }
  const std::string reader = ReaderOf(file, run);
  if (!reader.empty())
  {
    throw UsageError(what + reader + end);
  }
  for (const GraphOutput& o : run.Pipeline->Outputs)
  {
    if (!o.File.empty() && MayBeOneFile(file, o.File, run.First, run.End))
    {
      throw UsageError(what + o.File + ", output " + Quoted(o.Name) + " of this run" + end);
    }
  }
  if (IsCheckpoint(file) || MayBeOneFile(file, CheckpointPath(*run.Executor), run.First, run.End))
  {
    throw UsageError(what + "a checkpoint" + end);
  }
}

bool PrepareRun(const PipelineArguments& a, PreparedRun& run)
{
  GraphOptions options = GraphOptionsOf(a);
  if (a.DiscardsOutputs)
  {
    options.Outside = OutsideOutputs::Moved;
  }
  // The plan counts arrays between stages; the limit stops what it does not know of.
  SetPixelMemoryLimit(std::uint64_t(std::min(1e18, std::max(0., a.MemoryMegabytes) * 2e6)));
  if (PixelMemoryLimit() < MachineMemory() / 4 * 3)
  {
    SetPixelMemoryLimit(0);
  }
  SetSceneMemoryLimit(std::uint64_t(std::min(1e18, std::max(0., a.SceneMemoryMegabytes) * 1e6)));
  run.Region = ParseRegion(a.Region);

  int errors = 0;
  run.Pipeline = LoadPipelineOrImage(a.File, options, errors);
  if (!run.Pipeline)
  {
    std::fprintf(stderr, "%s; nothing was executed\n", CountText(errors, "error").c_str());
    return false;
  }
  ParseFrames(a.Frames, run.Pipeline->Ticks, run.First, run.End);
  run.Executor = std::make_unique<PipelineExecutor>(run.Pipeline, AllStages());
  if (!run.Executor->HasTargets())
  {
    throw UsageError(a.File + ": no output has a file; give one in the pipeline or with --output NAME=FILE");
  }
  CheckFiles(a, run);
  run.Executor->SetRegion(run.Region);
  run.History = PlanHistory(*run.Executor, run.First, a.WarmUpTolerance);
  return true;
}

/// The document of a pipeline file, or of an image that a run wrote, and what the image says of its inputs.
static std::shared_ptr<const PipelineDocument> ReadPipelineOrImage(
  const std::string& file, Diagnostics& messages, ImageOrigin& origin)
{
  if (!IsExr(file))
  {
    return ReadPipelineFile(file, messages);
  }
  std::map<std::string, std::string> metadata;
  try
  {
    const ReadReport header = ReadImageHeader(file);
    metadata = header.Metadata;
    origin.Tick = header.Facts.Tick;
  }
  catch (const StageError& e)
  {
    throw UsageError(e.what());
  }
  if (!metadata.count("pipeline"))
  {
    throw UsageError(file +
                     ": no pipeline is in this image; those that quell run writes have it, unless another program "
                     "wrote them anew");
  }
  origin.Inputs = metadata["inputs"];
  // Lines and columns of messages are those of the text that quell inspect prints.
  return ReadPipelineText(metadata["pipeline"], file, messages);
}

std::shared_ptr<Graph> LoadPipelineOrImage(const std::string& file, const GraphOptions& options, int& errors)
{
  Diagnostics messages;
  ImageOrigin origin;
  const auto document = ReadPipelineOrImage(file, messages, origin);
  std::shared_ptr<Graph> graph;
  // After broken XML or a newer version everything else would be guesswork.
  if (document->Place.Line > 0)
  {
    graph = BuildGraph(document, AllStages(), options, messages);
  }
  messages.Sort();
  graph = messages.HasErrors() ? nullptr : graph;
  if (graph)
  {
    WarnOfChangedInputs(file, origin, *graph);
  }
  Print(messages);
  errors = messages.ErrorCount();
  return graph;
}

std::shared_ptr<const PipelineDocument> ReadDocument(const std::string& file)
{
  Diagnostics messages;
  ImageOrigin origin;
  const auto document = ReadPipelineOrImage(file, messages, origin);
  messages.Sort();
  Print(messages);
  return messages.HasErrors() ? nullptr : document;
}

ExecutionPlan CheckedPlan(const PipelineArguments& a, PreparedRun& run)
{
  std::string error;
  const bool given = a.MemoryMegabytes > 0;
  double bytes = given ? a.MemoryMegabytes * 1e6 : double(MachineMemory()) / 4;
  ExecutionPlan plan = FitPlan(*run.Executor, run.Region, run.First, run.End, a.WarmUpTolerance, bytes, error);
  if (!error.empty() && !given)
  {
    // What must be whole may have what pixels may have at all.
    bytes *= 3;
    error.clear();
    plan = FitPlan(*run.Executor, run.Region, run.First, run.End, a.WarmUpTolerance, bytes, error);
  }
  if (!error.empty())
  {
    throw UsageError(
      (given ? "--memory " + detail::FormatDouble(a.MemoryMegabytes)
             : "the frame is too large for three quarters of this machine's memory, " + BytesText(bytes)) +
      ": " + error +
      (given ? "; allow more, or make the frame smaller" : "; make the frame smaller, or --memory MB allows more") +
      "; nothing was executed");
  }
  return plan;
}

CostModel LoadCosts()
{
  std::string problem;
  const CostModel model = CostModel::Load(CostModel::DefaultFile(), problem);
  if (!problem.empty())
  {
    std::fprintf(stderr, "quell: warning: %s\n", problem.c_str());
  }
  return model;
}

int ThreadCount()
{
  return std::max(1, vtkSMPTools::GetEstimatedNumberOfThreads());
}

int CheckCommand(const std::string& file, bool allowOutside)
{
  int errors = 0;
  GraphOptions options;
  options.Outside = allowOutside ? OutsideOutputs::Allowed : OutsideOutputs::Refused;
  const std::shared_ptr<Graph> graph = LoadPipelineOrImage(file, options, errors);
  if (!graph)
  {
    std::fprintf(stderr, "%s\n", CountText(errors, "error").c_str());
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
  ExecutionPlan plan = CheckedPlan(arguments, run);
  if (!plan.Error.empty())
  {
    std::fprintf(stderr, "quell: error: %s\n", plan.Error.c_str());
    return ExitFailed;
  }
  EstimateCosts(plan, *run.Executor, LoadCosts(), ThreadCount());
  const std::string text = arguments.Dot    ? PlanDot(plan)
                           : arguments.Json ? JsonText(PlanJson(plan)) + "\n"
                                            : PlanText(plan);
  std::fputs(text.c_str(), stdout);
  return ExitDone;
}
}
