// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellExplain.h"
#include "quellImageFile.h"
#include "quellInterrupt.h"
#include "quellJsonText.h"
#include "quellProgressLine.h"
#include "quellProvenance.h"
#include "quellResume.h"
#include "quellTemporaryFile.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>
#include <set>

namespace quell
{
namespace
{
using Clock = std::chrono::steady_clock;

/// Which part of a frame is done, from each node's own progress weighed by the seconds it took so far, in the first
/// frame by what it says a pixel costs.
class FrameProgress
{
public:
  explicit FrameProgress(const PipelineExecutor& executor)
    : Executor(executor)
  {
  }
  void NewFrame()
  {
    this->Nodes.clear();
    this->All = this->Done = 0;
    for (const NodeCounters& c : this->Executor.Counters())
    {
      this->Nodes[c.Path].Weight = c.Counters.Seconds;
      this->All += c.Counters.Seconds;
    }
    if (this->All > 0)
    {
      return;
    }
    for (auto& n : this->Nodes)
    {
      const vtkQuellStage* stage = this->Executor.GetStage(n.first);
      n.second.Weight = stage ? stage->CostPerPixel() : 1.;
      this->All += n.second.Weight;
    }
  }
  double Update(const std::string& node, double fraction)
  {
    const auto n = this->Nodes.find(node);
    if (n != this->Nodes.end())
    {
      // The difference alone: every node says several times a frame how far it is.
      this->Done += n->second.Weight * (fraction - n->second.Done);
      n->second.Done = fraction;
    }
    return this->All > 0 ? std::min(1., std::max(0., this->Done / this->All)) : 0.;
  }

private:
  struct Part
  {
    double Weight = 0, Done = 0;
  };
  const PipelineExecutor& Executor;
  std::map<std::string, Part> Nodes;
  double All = 0, Done = 0; ///< of the weights
};

/// The names of what was written: a sequence by its pattern, a single frame by its name.
std::vector<std::string> WrittenNames(
  const PipelineExecutor& executor, const std::vector<std::string>& files, int frames)
{
  if (frames == 1)
  {
    std::vector<std::string> names;
    for (const std::string& f : files)
    {
      if (std::find(names.begin(), names.end(), f) == names.end())
      {
        names.push_back(f);
      }
    }
    return names;
  }
  std::vector<std::string> names;
  std::set<std::string> single(files.begin(), files.end());
  for (const NodeCounters& c : executor.Counters())
  {
    const vtkQuellStage* stage = executor.GetStage(c.Path);
    if (c.Counters.Executions > 0 && stage->GetDescription().Sink && stage->GetDescription().FindProperty("File"))
    {
      const std::string name = stage->GetPropertyText("File");
      if (!stage->GetFilesWritten().empty() && std::find(names.begin(), names.end(), name) == names.end())
      {
        names.push_back(name);
      }
    }
  }
  return names.empty() ? std::vector<std::string>(single.begin(), single.end()) : names;
}

/// Estimates of a run and what nodes took, per execution. The first frame is not counted where there are more: it reads
/// the scene and has no history.
struct Times
{
  ExecutionPlan Plan;
  std::map<std::string, StageCounters> FirstFrame;

  StageCounters Of(const NodeCounters& c, bool& first) const
  {
    StageCounters k = c.Counters;
    const auto at = this->FirstFrame.find(c.Path);
    first = at == this->FirstFrame.end() || k.Executions <= at->second.Executions;
    if (!first)
    {
      k.Executions -= at->second.Executions;
      k.Seconds -= at->second.Seconds;
      k.Bytes -= at->second.Bytes;
    }
    return k;
  }
  void Print(const PipelineExecutor& executor) const
  {
    std::printf("%-32s %12s %12s %7s %12s %12s\n", "node", "estimate", "took", "ratio", "arrays est.", "arrays");
    double estimate = 0, took = 0;
    bool anyFirst = false;
    const std::vector<NodeCounters> counters = executor.Counters();
    for (const PlannedNode& n : this->Plan.Nodes)
    {
      const auto c =
        std::find_if(counters.begin(), counters.end(), [&n](const NodeCounters& x) { return x.Path == n.Path; });
      if (!n.Executes || c == counters.end() || c->Counters.Executions == 0)
      {
        continue;
      }
      bool first = false;
      const StageCounters k = this->Of(*c, first);
      anyFirst = anyFirst || first;
      const double seconds = k.Seconds / double(k.Executions);
      char ratio[24] = "";
      if (n.Seconds > 0)
      {
        std::snprintf(ratio, sizeof ratio, "%.2f", seconds / n.Seconds);
        estimate += n.Seconds;
        took += seconds;
      }
      std::printf("%-32s %12s %12s %7s %12s %12s\n", n.Path.c_str(),
        n.Seconds < 0 ? "not known" : SecondsText(n.Seconds).c_str(), SecondsText(seconds).c_str(), ratio,
        BytesText(n.Bytes).c_str(), BytesText(double(k.Bytes) / double(k.Executions)).c_str());
    }
    if (estimate > 0)
    {
      std::printf("%-32s %12s %12s %7.2f\n", "of these", SecondsText(estimate).c_str(), SecondsText(took).c_str(),
        took / estimate);
    }
    if (anyFirst)
    {
      std::printf("of a single frame: with reading the scene and without history, which the estimates leave out\n");
    }
    if (this->Plan.CostsOfAnotherMachine > 0)
    {
      std::printf("estimates of %d nodes are another machine's: quell calibrate measures this one\n",
        this->Plan.CostsOfAnotherMachine);
    }
  }
};

bool WriteStats(const std::string& file, const PreparedRun& run, const Times& times, int frames, double seconds,
  const std::vector<double>& frameSeconds, const std::vector<std::string>& files)
{
  nlohmann::json out;
  out["file"] = run.Pipeline->Document->File;
  out["version"] = QUELL_VERSION;
  out["frames"] = frames;
  out["firstFrame"] = run.First;
  out["seconds"] = seconds;
  out["frameSeconds"] = frameSeconds;
  out["files"] = files;
  out["nodes"] = nlohmann::json::array();
  for (const NodeCounters& c : run.Executor->Counters())
  {
    const StageCounters& k = c.Counters;
    const auto planned = std::find_if(
      times.Plan.Nodes.begin(), times.Plan.Nodes.end(), [&c](const PlannedNode& n) { return n.Path == c.Path; });
    out["nodes"].push_back({ { "id", c.Path }, { "type", c.Type }, { "executions", k.Executions },
      { "pixels", k.Pixels }, { "bytes", k.Bytes }, { "rays", k.Rays }, { "paths", k.Paths }, { "taps", k.Taps },
      { "nonFinite", k.NonFinite }, { "held", k.Held }, { "seconds", k.Seconds } });
    if (planned != times.Plan.Nodes.end() && planned->Seconds >= 0)
    {
      out["nodes"].back()["estimatedSeconds"] = planned->Seconds * double(k.Executions);
    }
  }
  const std::string text = JsonText(out) + "\n";
  std::error_code unknown;
  if (std::filesystem::is_other(std::filesystem::status(file, unknown)))
  {
    // A device or a pipe, as /dev/stdout, is written to and not replaced.
    std::FILE* const device = std::fopen(file.c_str(), "w");
    const bool written = device && std::fwrite(text.data(), 1, text.size(), device) == text.size();
    if (device && std::fclose(device) == 0 && written)
    {
      return true;
    }
    std::fprintf(stderr, "quell: error: --stats %s cannot be written: %s\n", file.c_str(), std::strerror(errno));
    return false;
  }
  // Whole or not at all, as frames are.
  TemporaryFile temporary(file);
  temporary.Write(text);
  if (const int error = temporary.Rename())
  {
    std::fprintf(stderr, "quell: error: --stats %s cannot be written: %s\n", file.c_str(), std::strerror(error));
    return false;
  }
  return true;
}
}

int RunCommand(const RunArguments& arguments)
{
  PreparedRun run;
  if (!PrepareRun(arguments, run))
  {
    return ExitUsage;
  }
  PipelineExecutor& executor = *run.Executor;
  if (!arguments.Stats.empty())
  {
    CheckStatistics(arguments.Stats, arguments, run);
  }
  std::string error;
  if (run.Region && !executor.CheckRegion(error))
  {
    throw UsageError(error);
  }
  const auto token = std::make_shared<CancelToken>();
  const InterruptScope interrupts(
    token.get(), "quell: finishing this frame with the samples it has; again to give it up");
  executor.SetCancelToken(token);
  {
    const ExecutionPlan plan = CheckedPlan(arguments, run);
    if (!plan.Error.empty())
    {
      std::fprintf(stderr, "quell: error: %s\n", plan.Error.c_str());
      return ExitFailed;
    }
    executor.SetBandRows(plan.BandRows);
    if (plan.BandRows > 0 && !arguments.Quiet)
    {
      std::fprintf(stderr, "quell: %s", BandsText(plan).c_str());
    }
  }
  const std::map<std::string, std::string> metadata = Provenance(run);
  executor.SetMetadata(metadata);
  executor.SetHistoryLength(1); // a run only goes forward

  ResumePoint resumed;
  resumed.Start = run.First - run.History.Frames;
  Checkpoints checkpoints(run);
  if (arguments.Resume && executor.HasDelays())
  {
    // A history cannot be begun in the middle, but nothing is left to do where every frame is there.
    ResumePoint all = resumed;
    if (!checkpoints.Exists())
    {
      SkipFinishedFrames(run, metadata, all, false);
    }
    if (int(all.Done.size()) == run.End - run.First)
    {
      std::printf("nothing to do: all %d frames are there\n", run.End - run.First);
      return ExitDone;
    }
    resumed.Start = checkpoints.Resume(metadata);
  }
  else if (arguments.Resume)
  {
    resumed.Unfinished = checkpoints.ResumeWork();
    SkipFinishedFrames(run, metadata, resumed, true);
  }
  else
  {
    checkpoints.MentionOld();
  }
  const std::string history = HistoryText(run.History);
  if (!history.empty() && resumed.Start < run.First)
  {
    std::fprintf(stderr, "quell: %s\n", history.c_str());
  }
  const int ticks = run.End - resumed.Start - int(resumed.Done.size());
  const int frames = run.End - std::max(run.First, resumed.Start) - int(resumed.Done.size());
  if (frames == 0)
  {
    std::printf("nothing to do: all %d frames are there\n", run.End - run.First);
    return ExitDone;
  }
  Times times;
  if (arguments.Times || !arguments.Stats.empty())
  {
    times.Plan = CheckedPlan(arguments, run);
    EstimateCosts(times.Plan, executor, LoadCosts(), ThreadCount());
    executor.ResetCounters();
  }
  ProgressLine line(ticks, arguments.Quiet);
  checkpoints.SetProgress(&line);
  FrameProgress progress(executor);
  int done = 0;
  executor.SetProgress(
    [&](const std::string& node, double fraction)
    {
      const vtkQuellStage* stage = line.IsShown() ? executor.GetStage(node) : nullptr;
      const SamplingStatus sampling = stage ? stage->GetSamplingStatus() : SamplingStatus();
      // Samples of an earlier run took no time in this one.
      const double before = sampling.Target > 0 ? std::min(0.999, double(sampling.Begun) / sampling.Target) : 0.;
      fraction = std::max(0., fraction - before) / (1 - before);
      line.Update(done, progress.Update(node, fraction), node, sampling);
    },
    line.IsShown());

  const Clock::time_point start = Clock::now();
  std::vector<std::string> files;
  std::vector<double> frameSeconds;
  std::set<std::string> warned;
  int finished = 0, status = ExitDone;
  for (int tick = resumed.Start; tick < run.End; ++tick)
  {
    if (resumed.Done.count(tick))
    {
      continue;
    }
    progress.NewFrame();
    const Clock::time_point frameStart = Clock::now();
    const TickMode mode = tick < run.First     ? TickMode::WarmUp
                          : tick + 1 < run.End ? TickMode::Frame
                                               : TickMode::LastFrame;
    checkpoints.BeforeFrame(tick);
    const std::map<std::string, std::string> sequences = SequenceHashes(*run.Pipeline, tick);
    if (!sequences.empty())
    {
      executor.SetMetadata(ProvenanceOf(metadata, sequences));
    }
    const TickResult result = executor.RunTick(tick, mode);
    for (const std::string& w : result.Warnings)
    {
      if (warned.insert(w).second)
      {
        line.Clear();
        std::fprintf(stderr, "quell: warning: frame %d: %s\n", tick, w.c_str());
      }
    }
    if (!result.Ok)
    {
      line.Clear();
      if (result.Cancelled)
      {
        std::fprintf(stderr, "quell: interrupted in frame %d; %d of %d frames are whole\n", tick, finished, frames);
        status = ExitInterrupted;
      }
      else
      {
        std::fprintf(stderr, "quell: error: frame %d: %s\n", tick, result.Error.c_str());
        status = ExitFailed;
      }
      break;
    }
    files.insert(files.end(), result.Files.begin(), result.Files.end());
    if (!result.Partial.empty())
    {
      line.Clear();
      checkpoints.FramePartial(tick);
      const std::string written =
        result.Files.empty() ? "nothing of it is written" : "it is written to " + Enumerated(result.Files);
      std::fprintf(stderr, "quell: interrupted: frame %d has %s, %s; %d of %d frames are whole\n", tick,
        result.Partial.c_str(), written.c_str(), finished, frames);
      status = ExitInterrupted;
      break;
    }
    finished += mode != TickMode::WarmUp;
    ++done;
    if (times.FirstFrame.empty())
    {
      for (const NodeCounters& c : executor.Counters())
      {
        times.FirstFrame[c.Path] = c.Counters;
      }
    }
    checkpoints.FrameDone(tick, sequences);
    frameSeconds.push_back(SecondsSince(frameStart));
    line.FrameDone(tick, done, frameSeconds.back());
    if (token->IsFinishing() && done < ticks)
    {
      line.Clear();
      std::fprintf(stderr, "quell: interrupted after frame %d; %d of %d frames are whole\n", tick, finished, frames);
      status = ExitInterrupted;
      break;
    }
  }
  line.Clear();
  checkpoints.End(status == ExitDone);
  const double seconds = SecondsSince(start);

  if (finished > 0)
  {
    const std::vector<std::string> names = WrittenNames(executor, files, finished);
    const std::string count = finished == 1 ? "1 frame" : std::to_string(finished) + " frames";
    std::string text = names.empty()   ? "ran " + count
                       : finished == 1 ? "wrote " + Enumerated(names)
                                       : "wrote " + count + " to " + Enumerated(names);
    char timing[96];
    if (done > 1)
    {
      std::snprintf(timing, sizeof timing, " in %.1f s (%.2f s a frame)", seconds, seconds / done);
    }
    else
    {
      std::snprintf(timing, sizeof timing, " in %.1f s", seconds);
    }
    std::printf("%s%s\n", text.c_str(), timing);
    if (status == ExitDone)
    {
      for (const std::string& report : executor.Reports())
      {
        std::printf("%s\n", report.c_str());
      }
    }
    if (arguments.Times)
    {
      times.Print(executor);
    }
  }
  std::fflush(stdout);
  if (!arguments.Stats.empty() && !WriteStats(arguments.Stats, run, times, finished, seconds, frameSeconds, files) &&
      status == ExitDone)
  {
    status = ExitFailed;
  }
  return status;
}
}
