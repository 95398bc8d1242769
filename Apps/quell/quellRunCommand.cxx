// SPDX-License-Identifier: BSD-3-Clause
#include "quellCheckpoint.h"
#include "quellCommands.h"
#include "quellExplain.h"
#include "quellImageFile.h"
#include "quellPipelineWriter.h"
#include "quellProgressLine.h"
#include "quellProvenance.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <set>

namespace quell
{
namespace
{
using Clock = std::chrono::steady_clock;

std::string RegionText(const DisplayRegion& r)
{
  return std::to_string(r.X0) + "," + std::to_string(r.Y0) + "," + std::to_string(r.X1) + "," + std::to_string(r.Y1);
}

double SecondsSince(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

CancelToken* interruptedToken = nullptr;

/// The first interrupt ends the run after the tiles at work; the next one ends the program.
extern "C" void HandleInterrupt(int signal)
{
  if (interruptedToken)
  {
    interruptedToken->Cancel();
  }
  std::signal(signal, SIG_DFL);
}

/// Installs the handler for as long as a token lives.
struct InterruptScope
{
  explicit InterruptScope(CancelToken* token)
  {
    interruptedToken = token;
    std::signal(SIGINT, HandleInterrupt);
    std::signal(SIGTERM, HandleInterrupt);
  }
  ~InterruptScope()
  {
    std::signal(SIGINT, SIG_DFL);
    std::signal(SIGTERM, SIG_DFL);
    interruptedToken = nullptr;
  }
};

/// Which part of a frame is done, from each node's own progress weighed by the seconds it took so far.
class FrameProgress
{
public:
  explicit FrameProgress(const PipelineExecutor& executor)
    : Executor(executor)
  {
  }
  void NewFrame()
  {
    this->Done.clear();
    this->Weights.clear();
    for (const NodeCounters& c : this->Executor.Counters())
    {
      this->Weights[c.Path] = c.Counters.Seconds;
    }
    double sum = 0;
    for (const auto& w : this->Weights)
    {
      sum += w.second;
    }
    if (sum <= 0)
    {
      for (auto& w : this->Weights)
      {
        w.second = 1;
      }
    }
  }
  double Update(const std::string& node, double fraction)
  {
    this->Done[node] = fraction;
    double sum = 0, all = 0;
    for (const auto& w : this->Weights)
    {
      all += w.second;
      const auto d = this->Done.find(w.first);
      sum += w.second * (d == this->Done.end() ? 0. : d->second);
    }
    return all > 0 ? sum / all : 0.;
  }

private:
  const PipelineExecutor& Executor;
  std::map<std::string, double> Done, Weights;
};

/// What a file needs to say where it came from. `pipeline` alone makes the same run again; the rest is for people and
/// checks.
std::map<std::string, std::string> Provenance(const PreparedRun& run)
{
  std::map<std::string, std::string> m;
  Diagnostics messages;
  m["pipeline"] = WritePipelineText(*SelfContained(*run.Pipeline, AllStages(), messages));
  std::fputs(messages.ToText().c_str(), stderr);
  m["pipelineHash"] = HashHex(m["pipeline"]);
  m["version"] = QUELL_VERSION;
  for (const auto& input : InputHashes(*run.Pipeline))
  {
    m["inputs"] += input.second + " " + input.first + "\n";
  }
  m["frames"] = std::to_string(run.First) + ":" + std::to_string(run.End - 1);
  if (run.Region)
  {
    m["region"] = RegionText(*run.Region);
  }
  if (run.History.RestWeight > 0)
  {
    m["warmUp"] = std::to_string(run.History.Frames);
  }
  return m;
}

/// Where a run starts, and which frames it need not make.
struct Progress
{
  int Start = 0;      ///< the first tick to run
  std::set<int> Done; ///< finished by an earlier run
};

/// Frames without history are finished when their files are there and of this very pipeline.
void SkipFinishedFrames(const PreparedRun& run, const std::map<std::string, std::string>& metadata, Progress& progress)
{
  const PipelineExecutor& executor = *run.Executor;
  const Graph& graph = *run.Pipeline;
  for (const PipelineExecutor::Target& t : executor.Targets())
  {
    const std::string& path = graph.Nodes[std::size_t(t.Node)].Path;
    const vtkQuellStage* stage = executor.GetStage(path);
    if (!stage->GetDescription().FindProperty("File"))
    {
      std::fprintf(stderr,
        "quell: --resume: node %s writes no file that would tell which frames are done; starting from frame %d\n",
        Quoted(path).c_str(), run.First);
      return;
    }
  }
  for (int tick = run.First; tick < run.End; ++tick)
  {
    bool done = true;
    for (const PipelineExecutor::Target& t : executor.Targets())
    {
      const vtkQuellStage* stage = executor.GetStage(graph.Nodes[std::size_t(t.Node)].Path);
      const std::string pattern = stage->GetPropertyText("File");
      if ((t.LastOnly && tick + 1 < run.End) || !done)
      {
        continue;
      }
      const std::string file = SequencePath(pattern, tick);
      std::error_code code;
      done = std::filesystem::is_regular_file(file, code);
      std::map<std::string, std::string> theirs;
      try
      {
        theirs = done ? ReadImageHeader(file).Metadata : theirs;
      }
      catch (const StageError&)
      {
        done = false; // half a file of another program; it is written anew
      }
      // Formats other than EXR carry no hash: being there has to do.
      const auto value = [](const std::map<std::string, std::string>& m, const char* key)
      {
        const auto found = m.find(key);
        return found == m.end() ? std::string() : found->second;
      };
      if (done && theirs.count("pipelineHash"))
      {
        for (const char* key : { "pipelineHash", "inputs", "region", "version" })
        {
          if (value(theirs, key) != value(metadata, key))
          {
            throw UsageError("--resume: " + file + " was made by another " +
                             (std::strcmp(key, "pipelineHash") == 0 ? "pipeline or other options"
                               : std::strcmp(key, "inputs") == 0    ? "state of the input files"
                               : std::strcmp(key, "region") == 0    ? "region"
                                                                    : "version of this program") +
                             "; nothing was executed");
          }
        }
      }
      // Without a number in its name the file is of whatever frame was last.
      done =
        done && (pattern != file || !theirs.count("frames") || value(theirs, "frames") == value(metadata, "frames"));
    }
    if (done)
    {
      progress.Done.insert(tick);
    }
  }
  if (progress.Done.empty())
  {
    std::fprintf(stderr, "quell: --resume: no frame is finished; starting from frame %d\n", run.First);
  }
  else
  {
    std::fprintf(stderr, "quell: --resume: %d of %d frames are there already and are not made again\n",
      int(progress.Done.size()), run.End - run.First);
  }
}

/// Keeps the file from which an interrupted run goes on; only for sequences with history.
class Checkpoints
{
public:
  Checkpoints(PreparedRun& run)
    : Run(run)
    , Start(run.First - run.History.Frames)
  {
    this->On = run.Executor->HasDelays() && run.End - this->Start > 1;
    this->File = CheckpointPath(*run.Executor);
    if (this->On)
    {
      this->Identity = IdentityOf(*run.Executor, run.Region, this->Start, QUELL_VERSION);
    }
  }

  /// Before it is overwritten: somebody may have forgotten --resume.
  void MentionOld() const
  {
    std::error_code code;
    if (this->On && std::filesystem::exists(this->File, code))
    {
      std::fprintf(stderr,
        "quell: %s of a run that was not completed is there; starting from frame %d, --resume would go on\n",
        this->File.c_str(), this->Start);
    }
  }

  void SetProgress(ProgressLine* line) { this->Line = line; }

  /// Where to start; throws UsageError when there is a checkpoint that is not of this run.
  int Resume()
  {
    std::error_code code;
    if (!this->On || !std::filesystem::exists(this->File, code))
    {
      std::fprintf(stderr, "quell: --resume: there is no checkpoint %s; starting from frame %d\n", this->File.c_str(),
        this->Start);
      return this->Start;
    }
    try
    {
      const Checkpoint checkpoint = ReadCheckpoint(this->File);
      const std::string difference = DifferenceOf(checkpoint.Identity, this->Identity);
      if (!difference.empty())
      {
        throw UsageError(
          "--resume: checkpoint " + this->File + " is of another run: " + difference + "; nothing was executed");
      }
      if (checkpoint.Tick < this->Start || checkpoint.Tick + 1 >= this->Run.End)
      {
        throw UsageError("--resume: checkpoint " + this->File + " is of frame " + std::to_string(checkpoint.Tick) +
                         ", which leaves none of the frames " + std::to_string(this->Run.First) + ":" +
                         std::to_string(this->Run.End - 1) + " to be made; nothing was executed");
      }
      std::string error;
      if (!Restore(*this->Run.Executor, checkpoint, error))
      {
        throw UsageError("--resume: checkpoint " + this->File + ": " + error);
      }
      this->Saved = this->Finished = checkpoint.Tick;
      this->Any = true;
    }
    catch (const StageError& e)
    {
      throw UsageError(std::string("--resume: ") + e.what() + "; delete it to start from the beginning");
    }
    std::fprintf(stderr, "quell: --resume: going on after frame %d, from %s\n", this->Saved, this->File.c_str());
    return this->Saved + 1;
  }

  /// After a whole frame. Writing may take a tenth of the time: small frames are not slowed down, and a run that stops
  /// by itself writes in End().
  void FrameDone(int tick)
  {
    this->Finished = tick;
    this->Any = true;
    if (this->On && SecondsSince(this->LastWrite) >= 10 * this->Cost)
    {
      this->Write();
    }
  }

  void End(bool complete)
  {
    std::error_code code;
    if (complete)
    {
      if (this->On)
      {
        std::filesystem::remove(this->File, code);
      }
      return;
    }
    if (this->On && this->Any && this->Finished != this->Saved)
    {
      this->Write();
    }
    if (this->Saved > NoTick)
    {
      std::fprintf(stderr, "quell: --resume goes on after frame %d\n", this->Saved);
    }
  }

private:
  void Write()
  {
    const Clock::time_point start = Clock::now();
    Checkpoint checkpoint;
    checkpoint.Identity = this->Identity;
    checkpoint.Tick = this->Finished;
    if (const FrameHistory::Frame* frame = this->Run.Executor->GetHistory().FindFrame(this->Finished))
    {
      checkpoint.Frame = *frame;
    }
    try
    {
      WriteCheckpoint(this->File, checkpoint);
      this->Saved = this->Finished;
    }
    catch (const StageError& e)
    {
      if (this->Line)
      {
        this->Line->Clear();
      }
      std::fprintf(stderr, "quell: warning: %s; this run cannot be resumed\n", e.what());
      this->On = false;
    }
    this->LastWrite = Clock::now();
    this->Cost = SecondsSince(start);
  }

  static constexpr int NoTick = std::numeric_limits<int>::min();
  PreparedRun& Run;
  int Start;
  bool On = false, Any = false;
  std::string File;
  RunIdentity Identity;
  ProgressLine* Line = nullptr;
  int Finished = NoTick, Saved = NoTick;
  Clock::time_point LastWrite = Clock::now();
  double Cost = 0;
};

std::string Enumerated(const std::vector<std::string>& names)
{
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
  {
    text += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
  }
  return text;
}

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

bool WriteStats(const std::string& file, const PreparedRun& run, int frames, double seconds,
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
    out["nodes"].push_back({ { "id", c.Path }, { "type", c.Type }, { "executions", k.Executions },
      { "pixels", k.Pixels }, { "bytes", k.Bytes }, { "rays", k.Rays }, { "paths", k.Paths }, { "taps", k.Taps },
      { "nonFinite", k.NonFinite }, { "seconds", k.Seconds } });
  }
  std::ofstream stream(file);
  stream << out.dump(2) << "\n";
  stream.flush();
  if (!stream)
  {
    std::fprintf(stderr, "quell: error: --stats %s cannot be written: %s\n", file.c_str(), std::strerror(errno));
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
  std::string error;
  if (run.Region && !executor.CheckRegion(error))
  {
    throw UsageError(error);
  }
  const auto token = std::make_shared<CancelToken>();
  const InterruptScope interrupts(token.get());
  executor.SetCancelToken(token);
  if (arguments.MemoryMegabytes > 0)
  {
    const ExecutionPlan plan = CheckedPlan(arguments, run);
    if (!plan.Error.empty())
    {
      std::fprintf(stderr, "quell: error: %s\n", plan.Error.c_str());
      return ExitFailed;
    }
  }
  const std::map<std::string, std::string> metadata = Provenance(run);
  executor.SetMetadata(metadata);
  executor.SetHistoryLength(1); // a run only goes forward

  Progress resumed;
  resumed.Start = run.First - run.History.Frames;
  Checkpoints checkpoints(run);
  if (arguments.Resume && executor.HasDelays())
  {
    resumed.Start = checkpoints.Resume();
  }
  else if (arguments.Resume)
  {
    SkipFinishedFrames(run, metadata, resumed);
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
  ProgressLine line(ticks, arguments.Quiet);
  checkpoints.SetProgress(&line);
  FrameProgress progress(executor);
  int done = 0;
  executor.SetProgress(
    [&](const std::string& node, double fraction) { line.Update(done, progress.Update(node, fraction), node); });

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
    finished += mode != TickMode::WarmUp;
    ++done;
    checkpoints.FrameDone(tick);
    frameSeconds.push_back(SecondsSince(frameStart));
    line.FrameDone(tick, done, frameSeconds.back());
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
  }
  std::fflush(stdout);
  if (!arguments.Stats.empty() && !WriteStats(arguments.Stats, run, finished, seconds, frameSeconds, files) &&
      status == ExitDone)
  {
    status = ExitFailed;
  }
  return status;
}
}
