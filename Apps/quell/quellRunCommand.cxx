// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellExplain.h"
#include "quellPipelineWriter.h"
#include "quellProgressLine.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <set>

namespace quell
{
namespace
{
using Clock = std::chrono::steady_clock;

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
  explicit FrameProgress(const PipelineExecutor& executor) : Executor(executor) {}
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

std::string HashText(const std::string& text)
{
  std::uint64_t h = 14695981039346656037ull;  // FNV-1a
  for (unsigned char c : text)
  {
    h = (h ^ c) * 1099511628211ull;
  }
  char out[20];
  std::snprintf(out, sizeof out, "%016llx", static_cast<unsigned long long>(h));
  return out;
}

/// What a file needs to say where it came from.
std::map<std::string, std::string> Provenance(const RunArguments& a, const Graph& graph)
{
  std::map<std::string, std::string> m;
  m["pipeline"] = WritePipelineText(*graph.Document);
  m["pipelineHash"] = HashText(m["pipeline"]);
  m["version"] = QUELL_VERSION;
  std::string options;
  const auto add = [&options](const char* option, const std::vector<std::string>& values) {
    for (const std::string& v : values)
    {
      options += (options.empty() ? "" : "\n") + std::string(option) + " " + v;
    }
  };
  add("-D", a.Defines);
  add("--set", a.Sets);
  if (a.Seed)
  {
    add("--seed", { std::to_string(*a.Seed) });
  }
  if (!options.empty())
  {
    m["options"] = options;
  }
  return m;
}

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
std::vector<std::string> WrittenNames(const PipelineExecutor& executor, const std::vector<std::string>& files, int frames)
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

bool WriteStats(const std::string& file, const PreparedRun& run, int frames, double seconds, const std::vector<double>& frameSeconds,
  const std::vector<std::string>& files)
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
    out["nodes"].push_back({ { "id", c.Path }, { "type", c.Type }, { "executions", k.Executions }, { "pixels", k.Pixels },
      { "bytes", k.Bytes }, { "rays", k.Rays }, { "paths", k.Paths }, { "taps", k.Taps }, { "nonFinite", k.NonFinite },
      { "seconds", k.Seconds } });
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
  executor.SetMetadata(Provenance(arguments, *run.Pipeline));

  const int warmUp = WarmUpFrames(executor, run.First);
  const int frames = run.End - run.First, ticks = frames + warmUp;
  ProgressLine line(ticks, arguments.Quiet);
  FrameProgress progress(executor);
  int done = 0;
  executor.SetProgress([&](const std::string& node, double fraction) { line.Update(done, progress.Update(node, fraction), node); });

  const Clock::time_point start = Clock::now();
  std::vector<std::string> files;
  std::vector<double> frameSeconds;
  std::set<std::string> warned;
  int finished = 0, status = ExitDone;
  for (int tick = run.First - warmUp; tick < run.End; ++tick)
  {
    progress.NewFrame();
    const Clock::time_point frameStart = Clock::now();
    const TickMode mode = tick < run.First ? TickMode::WarmUp : tick + 1 < run.End ? TickMode::Frame : TickMode::LastFrame;
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
    frameSeconds.push_back(SecondsSince(frameStart));
    line.FrameDone(tick, done, frameSeconds.back());
  }
  line.Clear();
  const double seconds = SecondsSince(start);

  if (finished > 0)
  {
    const std::vector<std::string> names = WrittenNames(executor, files, finished);
    const std::string count = finished == 1 ? "1 frame" : std::to_string(finished) + " frames";
    std::string text = names.empty() ? "ran " + count
      : finished == 1                ? "wrote " + Enumerated(names)
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
  if (!arguments.Stats.empty() && !WriteStats(arguments.Stats, run, finished, seconds, frameSeconds, files) && status == ExitDone)
  {
    status = ExitFailed;
  }
  return status;
}
}
