// SPDX-License-Identifier: BSD-3-Clause
#include "quellCheckpoint.h"
#include "quellCommands.h"
#include "quellExplain.h"
#include "quellImageFile.h"
#include "quellImageGuard.h"
#include "quellInterrupt.h"
#include "quellJsonText.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellProgressLine.h"
#include "quellProvenance.h"
#include "quellSimd.h"
#include "quellTemporaryName.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <sstream>

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

std::string Enumerated(const std::vector<std::string>& names)
{
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
  {
    text += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
  }
  return text;
}

std::string LinesOf(const std::map<std::string, std::string>& hashes)
{
  std::string lines;
  for (const auto& input : hashes)
  {
    lines += input.second + " " + input.first + "\n";
  }
  return lines;
}

/// What a file needs to say where it came from. `pipeline` alone makes the same run again; the rest is for people and
/// checks.
std::map<std::string, std::string> Provenance(const PreparedRun& run)
{
  std::map<std::string, std::string> m;
  Diagnostics messages;
  m["pipeline"] = WritePipelineText(*SelfContained(*run.Pipeline, AllStages(), messages));
  std::fputs(messages.ToText().c_str(), stderr);
  m["pipelineHash"] = HashHex(m["pipeline"]);
  // Names of files are bytes, XML is not.
  Diagnostics again;
  if (ReadPipelineText(m["pipeline"], "", again)->Place.Line <= 0)
  {
    m.erase("pipeline");
    m.erase("pipelineHash");
    std::fprintf(stderr, "quell: warning: the name of a file or directory in this pipeline holds bytes that XML cannot "
                         "(no UTF-8, or control characters): the frames will not hold their pipeline\n");
  }
  m["version"] = QUELL_VERSION;
  m["instructions"] = SimdTargetName();
  if (const std::string inputs = LinesOf(InputHashes(*run.Pipeline)); !inputs.empty())
  {
    m["inputs"] = inputs;
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

/// The same of one frame: its own file of every sequence that is read.
std::map<std::string, std::string> ProvenanceOf(
  const std::map<std::string, std::string>& run, const std::map<std::string, std::string>& sequences)
{
  std::map<std::string, std::string> m = run;
  if (!sequences.empty())
  {
    m["inputs"] += LinesOf(sequences);
  }
  return m;
}

/// Where a run starts, and which frames it need not make.
struct Progress
{
  int Start = 0;                 ///< the first tick to run
  std::set<int> Done;            ///< finished by an earlier run
  std::optional<int> Unfinished; ///< has samples of an earlier run
};

/// The first file that one of the two has with another hash.
std::string ChangedInput(
  const std::map<std::string, std::string>& theirs, const std::map<std::string, std::string>& ours)
{
  const auto linesOf = [](const std::map<std::string, std::string>& m)
  {
    std::set<std::string> lines;
    const auto found = m.find("inputs");
    std::istringstream text(found == m.end() ? std::string() : found->second);
    for (std::string line; std::getline(text, line);)
    {
      lines.insert(line);
    }
    return lines;
  };
  const std::set<std::string> a = linesOf(theirs), b = linesOf(ours);
  for (const auto* lines : { &b, &a })
  {
    for (const std::string& line : *lines)
    {
      if (!(a.count(line) && b.count(line)) && line.find(' ') != std::string::npos)
      {
        return "the input file " + OneLine(line.substr(line.find(' ') + 1));
      }
    }
  }
  return "the input files";
}

/// A file is written from the top down under another name: with its last row all of it is there, unless something
/// happened to it later.
bool IsWhole(const std::string& file, const ReadReport& header)
{
  try
  {
    ReadOptions last;
    last.Region = header.DataWindow.clipped({ 0, 0, header.Width, header.Height });
    last.Region.y1 = std::min(last.Region.y1, last.Region.y0 + 1);
    if (!header.Arrays.empty())
    {
      last.Arrays = { header.Arrays.back().Name };
    }
    ReadImageFile(file, nullptr, last);
    return true;
  }
  catch (const StageError&)
  {
    return false;
  }
}

/// Files of the frames [first, end) that outputs should have and have not, at most a few.
std::vector<std::string> MissingFiles(const PreparedRun& run, int first, int end, std::size_t most)
{
  std::vector<std::string> missing;
  for (int tick = std::max(first, run.First); tick < end && missing.size() < most; ++tick)
  {
    for (const PipelineExecutor::Target& t : run.Executor->Targets())
    {
      const vtkQuellStage* stage = run.Executor->GetStage(run.Pipeline->Nodes[std::size_t(t.Node)].Path);
      if (!stage->GetDescription().FindProperty("File") || (t.LastOnly && tick + 1 < run.End))
      {
        continue;
      }
      const std::string pattern = stage->GetPropertyText("File"), file = SequencePath(pattern, tick);
      std::error_code code;
      if (file != pattern && !std::filesystem::exists(file, code))
      {
        missing.push_back(file);
      }
    }
  }
  return missing;
}

/// Frames without history are finished when their files are there and of this very pipeline.
void SkipFinishedFrames(const PreparedRun& run, const std::map<std::string, std::string>& ofRun, Progress& progress)
{
  bool otherInstructions = false;
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
    std::map<std::string, std::string> metadata;
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
        const ReadReport header = done ? ReadImageHeader(file) : ReadReport();
        done = done && IsWhole(file, header);
        theirs = header.Metadata;
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
      if (done && metadata.empty())
      {
        metadata = ProvenanceOf(ofRun, SequenceHashes(graph, tick));
      }
      if (done && theirs.count("pipelineHash"))
      {
        otherInstructions = otherInstructions || value(theirs, "instructions") != value(metadata, "instructions");
        for (const char* key : { "pipelineHash", "inputs", "region", "version" })
        {
          if (value(theirs, key) != value(metadata, key))
          {
            throw UsageError("--resume: " + file + " was made by another " +
                             (std::strcmp(key, "pipelineHash") == 0 ? "pipeline or other options"
                               : std::strcmp(key, "inputs") == 0    ? "state of " + ChangedInput(theirs, metadata)
                               : std::strcmp(key, "region") == 0    ? "region"
                                                                    : "version of this program") +
                             "; nothing was executed");
          }
        }
      }
      // Without a number in its name the file is of whatever frame was last.
      done = done && !theirs.count("partial") && progress.Unfinished != tick;
      done =
        done && (pattern != file || !theirs.count("frames") || value(theirs, "frames") == value(metadata, "frames"));
    }
    if (done)
    {
      progress.Done.insert(tick);
    }
  }
  if (otherInstructions)
  {
    std::fprintf(stderr,
      "quell: warning: --resume: frames that are there were made with another instruction set than %s; the others may "
      "differ in the last digits\n",
      SimdTargetName());
  }
  if (progress.Done.empty() && progress.Unfinished != run.First)
  {
    std::fprintf(stderr, "quell: --resume: no frame is finished; starting from frame %d\n", run.First);
  }
  else if (!progress.Done.empty())
  {
    std::fprintf(stderr, "quell: --resume: %d of %d frames are there already and are not made again\n",
      int(progress.Done.size()), run.End - run.First);
  }
}

/// Keeps the file from which an interrupted run goes on: the history of the last frame, for sequences that have one,
/// and the samples of a frame that was finished early.
class Checkpoints
{
public:
  Checkpoints(PreparedRun& run)
    : Run(run)
    , Start(run.First - run.History.Frames)
  {
    this->On = run.Executor->HasDelays() && run.End - this->Start > 1;
    this->File = CheckpointPath(*run.Executor);
    // Opens all inputs: only where it is needed before the end of the run.
    if (this->On)
    {
      this->Identity = this->IdentityOfRun();
    }
  }

  /// Before it is overwritten: somebody may have forgotten --resume.
  void MentionOld() const
  {
    if (IsCheckpoint(this->File))
    {
      std::fprintf(stderr,
        "quell: %s of a run that was not completed is there; starting from frame %d, --resume would go on\n",
        this->File.c_str(), this->Start);
    }
  }

  void SetProgress(ProgressLine* line) { this->Line = line; }

  bool Exists() const
  {
    std::error_code code;
    return std::filesystem::exists(this->File, code);
  }
  /// Where to start (the end: nothing is left to do); throws UsageError when there is a checkpoint that is not of this
  /// run.
  int Resume(const std::map<std::string, std::string>& metadata)
  {
    std::error_code code;
    if (!std::filesystem::exists(this->File, code))
    {
      std::fprintf(stderr, "quell: --resume: there is no checkpoint %s; starting from frame %d\n", this->File.c_str(),
        this->Start);
      return this->Start;
    }
    const Checkpoint checkpoint = this->Read();
    // Without a whole frame there may still be samples of the first one.
    const bool samplesOnly = checkpoint.Tick == this->Start - 1 && !checkpoint.Work.empty();
    if ((checkpoint.Tick < this->Start && !samplesOnly) || checkpoint.Tick + 1 >= this->Run.End)
    {
      // Killed between the last frame and the end of the run.
      Progress all;
      if (checkpoint.Tick + 1 == this->Run.End)
      {
        SkipFinishedFrames(this->Run, metadata, all);
      }
      if (int(all.Done.size()) == this->Run.End - this->Run.First)
      {
        return this->Run.End; // the checkpoint stays: a longer run may go on from it
      }
      throw UsageError("--resume: checkpoint " + this->File + " is of frame " + std::to_string(checkpoint.Tick) +
                       ", which leaves none of the frames " + std::to_string(this->Run.First) + ":" +
                       std::to_string(this->Run.End - 1) + " to be made; nothing was executed");
    }
    std::string error;
    if (!samplesOnly && !Restore(*this->Run.Executor, checkpoint, error))
    {
      throw UsageError("--resume: checkpoint " + this->File + ": " + error);
    }
    this->TakeWork(checkpoint);
    if (samplesOnly)
    {
      return this->Start;
    }
    this->Saved = this->Finished = checkpoint.Tick;
    this->Any = true;
    const std::vector<std::string> missing = MissingFiles(this->Run, this->Run.First, this->Saved + 1, 3);
    if (!missing.empty())
    {
      std::fprintf(stderr,
        "quell: warning: --resume: %s%s not there and not made again: a history goes on after the last frame; a run "
        "without --resume makes all\n",
        Enumerated(missing).c_str(), missing.size() > 1 ? " are" : " is");
    }
    std::fprintf(stderr, "quell: --resume: going on after frame %d, from %s\n", this->Saved, this->File.c_str());
    return this->Saved + 1;
  }

  /// The frame whose samples were saved, of a run without history.
  std::optional<int> ResumeWork()
  {
    std::error_code code;
    if (!std::filesystem::exists(this->File, code))
    {
      return {};
    }
    this->TakeWork(this->Read());
    return this->Work.empty() ? std::optional<int>() : std::optional<int>(this->WorkTick);
  }

  void BeforeFrame(int tick)
  {
    if (this->Work.empty() || tick != this->WorkTick)
    {
      return;
    }
    std::string error;
    this->Loaded = this->Run.Executor->LoadWork(this->Work, error);
    if (!this->Loaded)
    {
      std::fprintf(stderr, "quell: warning: %s: %s; frame %d is made anew\n", this->File.c_str(), error.c_str(), tick);
    }
    this->Work.clear();
  }

  /// `sequences`: what was read of sequences for it. Writing may take a tenth of the time: small frames are not slowed
  /// down, and a run that stops by itself writes in End().
  void FrameDone(int tick, const std::map<std::string, std::string>& sequences)
  {
    this->AddInputs(sequences);
    this->Finished = tick;
    this->Any = true;
    if (!this->On && this->Loaded && tick == this->WorkTick)
    {
      this->Remove(); // this frame is whole now
    }
    if (this->On && SecondsSince(this->LastWrite) >= 10 * this->Cost)
    {
      this->Write();
    }
  }

  /// After a frame that was finished early: its samples are written in End().
  void FramePartial(int tick)
  {
    this->Work = this->Run.Executor->SaveWork();
    this->WorkTick = tick;
  }

  void End(bool complete)
  {
    if (complete)
    {
      this->Remove();
      return;
    }
    if (!this->Work.empty())
    {
      if (this->Write())
      {
        std::fprintf(stderr, "quell: --resume goes on with the samples of frame %d, from %s\n", this->WorkTick,
          this->File.c_str());
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
  RunIdentity IdentityOfRun() const
  {
    // Frames without history are the same wherever a run starts.
    RunIdentity id = IdentityOf(
      *this->Run.Executor, this->Run.Region, this->Run.Executor->HasDelays() ? this->Start : 0, QUELL_VERSION);
    id[InstructionSet] = SimdTargetName();
    return id;
  }

  /// The history of a frame is of all files that were read up to it.
  void AddInputs(const std::map<std::string, std::string>& hashes)
  {
    for (const auto& h : hashes)
    {
      this->Inputs["the contents of " + h.first + ":"] = h.second;
    }
  }

  void Remove() const
  {
    std::error_code code;
    if (IsCheckpoint(this->File))
    {
      std::filesystem::remove(this->File, code);
    }
  }

  /// Throws UsageError when it is damaged or not of this run.
  Checkpoint Read()
  {
    try
    {
      Checkpoint checkpoint = ReadCheckpoint(this->File);
      if (this->Identity.empty())
      {
        this->Identity = this->IdentityOfRun();
      }
      const Timeline& ticks = this->Run.Pipeline->Ticks;
      const int end = std::max(this->Run.End, ticks.First + ticks.Count);
      RunIdentity theirs = checkpoint.Identity, ours = this->Identity;
      for (int tick = this->Start; this->On && tick <= checkpoint.Tick && tick < end; ++tick)
      {
        this->AddInputs(SequenceHashes(*this->Run.Pipeline, tick));
      }
      ours.insert(this->Inputs.begin(), this->Inputs.end());
      // Another machine may have no choice.
      if (theirs[InstructionSet] != ours[InstructionSet])
      {
        std::fprintf(stderr,
          "quell: warning: --resume: the frames up to now were made with the instruction set %s, this run uses %s; "
          "they "
          "may differ in the last digits from those of one run\n",
          OneLine(theirs[InstructionSet]).c_str(), SimdTargetName());
      }
      ours[InstructionSet] = theirs[InstructionSet];
      const std::string difference = DifferenceOf(theirs, ours);
      if (!difference.empty())
      {
        throw UsageError(
          "--resume: checkpoint " + this->File + " is of another run: " + difference + "; nothing was executed");
      }
      return checkpoint;
    }
    catch (const StageError& e)
    {
      throw UsageError(std::string("--resume: ") + e.what() + "; delete it to start from the beginning");
    }
  }

  void TakeWork(const Checkpoint& checkpoint)
  {
    if (checkpoint.Work.empty() || checkpoint.WorkTick >= this->Run.End ||
        checkpoint.WorkTick < this->Run.First - this->Run.History.Frames)
    {
      return;
    }
    this->Work = checkpoint.Work;
    this->WorkTick = checkpoint.WorkTick;
    std::fprintf(
      stderr, "quell: --resume: going on with the samples of frame %d, from %s\n", this->WorkTick, this->File.c_str());
  }

  bool Write()
  {
    const Clock::time_point start = Clock::now();
    if (this->Identity.empty())
    {
      this->Identity = this->IdentityOfRun();
    }
    Checkpoint checkpoint;
    checkpoint.Identity = this->Identity;
    checkpoint.Identity.insert(this->Inputs.begin(), this->Inputs.end());
    checkpoint.Tick = this->Any ? this->Finished : this->Start - 1;
    if (const FrameHistory::Frame* frame = this->Run.Executor->GetHistory().FindFrame(this->Finished))
    {
      checkpoint.Frame = *frame;
    }
    checkpoint.Work = this->Work;
    checkpoint.WorkTick = this->WorkTick;
    bool good = true;
    try
    {
      WriteCheckpoint(this->File, checkpoint);
      this->Saved = this->Finished;
      this->Failed = false;
    }
    catch (const StageError& e)
    {
      good = false;
      if (!this->Failed) // once, and tried again after every frame
      {
        if (this->Line)
        {
          this->Line->Clear();
        }
        const std::string state = this->Saved > NoTick
                                    ? "--resume would go on after frame " + std::to_string(this->Saved)
                                    : std::string("this run cannot be resumed yet");
        std::fprintf(stderr, "quell: warning: %s; %s\n", e.what(), state.c_str());
      }
      this->Failed = true;
    }
    this->LastWrite = Clock::now();
    this->Cost = SecondsSince(start);
    return good;
  }

  static constexpr const char* InstructionSet = "the program: instruction set";
  static constexpr int NoTick = std::numeric_limits<int>::min();
  PreparedRun& Run;
  int Start;
  bool On = false, Any = false, Loaded = false, Failed = false;
  std::string File;
  RunIdentity Identity, Inputs; ///< Inputs: of the sequences that are read
  ProgressLine* Line = nullptr;
  int Finished = NoTick, Saved = NoTick;
  PipelineExecutor::Work Work; ///< read and not yet given to the executor, or to be written
  int WorkTick = 0;
  Clock::time_point LastWrite = Clock::now();
  double Cost = 0;
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
  // Whole or not at all, as frames are.
  const std::string part = TemporaryName(file);
  errno = 0;
  std::ofstream stream(part);
  stream << JsonText(out) << "\n";
  stream.close();
  if (!stream || std::rename(part.c_str(), file.c_str()) != 0)
  {
    std::fprintf(stderr, "quell: error: --stats %s cannot be written: %s\n", file.c_str(), std::strerror(errno));
    std::remove(part.c_str());
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
  std::error_code unknown;
  if (!arguments.Stats.empty() && std::filesystem::equivalent(arguments.Stats, arguments.File, unknown))
  {
    throw UsageError("--stats " + arguments.Stats + " would write over the pipeline file; nothing was executed");
  }
  for (const GraphNode& n : run.Pipeline->Nodes)
  {
    for (const GraphProperty& p : n.Properties)
    {
      const Property* property = n.Description().FindProperty(p.Name);
      if (!arguments.Stats.empty() && property && property->Kind == Property::Type::Path &&
          std::filesystem::equivalent(arguments.Stats, p.Text, unknown))
      {
        throw UsageError("--stats " + arguments.Stats + " would write over what node " + Quoted(n.Path) +
                         " reads; nothing was executed");
      }
    }
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

  Progress resumed;
  resumed.Start = run.First - run.History.Frames;
  Checkpoints checkpoints(run);
  if (arguments.Resume && executor.HasDelays())
  {
    // A history cannot be begun in the middle, but nothing is left to do where every frame is there.
    Progress all = resumed;
    if (!checkpoints.Exists())
    {
      SkipFinishedFrames(run, metadata, all);
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
