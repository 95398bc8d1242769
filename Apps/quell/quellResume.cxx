// SPDX-License-Identifier: BSD-3-Clause
#include "quellResume.h"

#include "quellImageFile.h"
#include "quellImageGuard.h"
#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellProvenance.h"
#include "quellSimd.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
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

std::string LinesOf(const std::map<std::string, std::string>& hashes)
{
  std::string lines;
  for (const auto& input : hashes)
  {
    lines += input.second + " " + input.first + "\n";
  }
  return lines;
}

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

/// The history of a frame is of all files that were read up to it.
void AddInputs(RunIdentity& inputs, const std::map<std::string, std::string>& hashes)
{
  for (const auto& h : hashes)
  {
    inputs["the contents of " + h.first + ":"] = h.second;
  }
}

/// Files of the run's frames before `end` that outputs should have and have not, or not whole; at most a few.
std::vector<std::string> MissingFiles(const PreparedRun& run, int end, std::size_t most)
{
  std::vector<std::string> missing;
  for (int tick = run.First; tick < end && missing.size() < most; ++tick)
  {
    for (const PipelineExecutor::Target& t : run.Executor->Targets())
    {
      const vtkQuellStage* stage = run.Executor->GetStage(run.Pipeline->Nodes[std::size_t(t.Node)].Path);
      if (!stage->GetDescription().FindProperty("File") || (t.LastOnly && tick + 1 < run.End))
      {
        continue;
      }
      const std::string pattern = stage->GetPropertyText("File"), file = SequencePath(pattern, tick);
      bool whole = file == pattern;
      try
      {
        whole = whole || IsWhole(file, ReadImageHeader(file));
      }
      catch (const StageError&)
      {
        // it stays missing
      }
      if (!whole)
      {
        missing.push_back(file);
      }
    }
  }
  return missing;
}
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

double SecondsSince(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

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

void SkipFinishedFrames(
  const PreparedRun& run, const std::map<std::string, std::string>& ofRun, ResumePoint& progress, bool tell)
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
      if (tell)
      {
        std::fprintf(stderr,
          "quell: --resume: node %s writes no file that would tell which frames are done; starting from frame %d\n",
          Quoted(path).c_str(), run.First);
      }
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
      done = done && !theirs.count("partial") && !progress.Unfinished.count(tick);
      done =
        done && (pattern != file || !theirs.count("frames") || value(theirs, "frames") == value(metadata, "frames"));
    }
    if (done)
    {
      progress.Done.insert(tick);
    }
  }
  if (!tell)
  {
    return;
  }
  if (otherInstructions)
  {
    std::fprintf(stderr,
      "quell: warning: --resume: frames that are there were made with another instruction set than %s; the others may "
      "differ in the last digits\n",
      SimdTargetName());
  }
  if (progress.Done.empty() && !progress.Unfinished.count(run.First))
  {
    std::fprintf(stderr, "quell: --resume: no frame is finished; starting from frame %d\n", run.First);
  }
  else if (!progress.Done.empty())
  {
    std::fprintf(stderr, "quell: --resume: %d of %d frames are there already and are not made again\n",
      int(progress.Done.size()), run.End - run.First);
  }
}

Checkpoints::Checkpoints(PreparedRun& run)
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

void Checkpoints::MentionOld()
{
  if (!IsCheckpoint(this->File))
  {
    return;
  }
  std::string difference;
  try
  {
    const Checkpoint there = ReadCheckpoint(this->File);
    RunIdentity inputs;
    difference = this->Difference(there, inputs);
    if (difference.empty() && this->On)
    {
      this->OlderTick = there.Tick;
    }
    else if (difference.empty())
    {
      this->Unfinished = there.Unfinished;
      this->Work = there.Work;
      this->WorkTick = there.WorkTick;
      this->Ours = true;
    }
  }
  catch (const StageError& e)
  {
    difference = e.what();
  }
  if (difference.empty())
  {
    std::fprintf(stderr,
      "quell: %s of a run that was not completed is there; starting from frame %d, --resume would go on\n",
      this->File.c_str(), this->Start);
  }
  else
  {
    std::fprintf(stderr, "quell: %s of another run is there (%s); this run %s\n", this->File.c_str(),
      difference.c_str(), this->On ? "replaces it" : "leaves it, or replaces it when it is interrupted in a frame");
  }
}

bool Checkpoints::Exists() const
{
  std::error_code code;
  return std::filesystem::exists(this->File, code);
}

int Checkpoints::Resume(const std::map<std::string, std::string>& metadata)
{
  if (!this->Exists())
  {
    std::fprintf(
      stderr, "quell: --resume: there is no checkpoint %s; starting from frame %d\n", this->File.c_str(), this->Start);
    return this->Start;
  }
  const Checkpoint checkpoint = this->Read();
  // Without a whole frame there may still be samples of the first one.
  const bool samplesOnly = checkpoint.Tick == this->Start - 1 && !checkpoint.Work.empty();
  if ((checkpoint.Tick < this->Start && !samplesOnly) || checkpoint.Tick + 1 >= this->Run.End)
  {
    // Killed between the last frame and the end of the run.
    ResumePoint all;
    if (checkpoint.Tick + 1 == this->Run.End)
    {
      SkipFinishedFrames(this->Run, metadata, all, false);
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
  const std::vector<std::string> missing = MissingFiles(this->Run, this->Saved + 1, 3);
  if (!missing.empty())
  {
    std::fprintf(stderr,
      "quell: warning: --resume: %s%s not there, or not whole, and not made again: a history goes on after the last "
      "frame; a run without --resume makes all\n",
      Enumerated(missing).c_str(), missing.size() > 1 ? " are" : " is");
  }
  std::fprintf(stderr, "quell: --resume: going on after frame %d, from %s\n", this->Saved, this->File.c_str());
  return this->Saved + 1;
}

std::set<int> Checkpoints::ResumeWork()
{
  if (this->Exists())
  {
    const Checkpoint checkpoint = this->Read();
    this->Unfinished = checkpoint.Unfinished;
    this->TakeWork(checkpoint);
  }
  return this->Unfinished;
}

void Checkpoints::BeforeFrame(int tick)
{
  if (this->Work.empty() || tick != this->WorkTick || !this->Resumed)
  {
    return;
  }
  std::string error;
  if (!this->Run.Executor->LoadWork(this->Work, error))
  {
    std::fprintf(stderr, "quell: warning: %s: %s; frame %d is made anew\n", this->File.c_str(), error.c_str(), tick);
  }
  this->Work.clear();
}

void Checkpoints::FrameDone(int tick, const std::map<std::string, std::string>& sequences)
{
  AddInputs(this->Inputs, sequences);
  this->Finished = tick;
  this->Any = true;
  if (!this->On)
  {
    this->Settle(tick);
  }
  else if (SecondsSince(this->LastWrite) >= 10 * this->Cost && !this->IsFurther())
  {
    this->Write();
  }
}

void Checkpoints::Settle(int tick)
{
  if (this->Unfinished.erase(tick) == 0)
  {
    return;
  }
  if (tick == this->WorkTick)
  {
    this->Work.clear();
  }
  if (this->Unfinished.empty())
  {
    this->Remove();
  }
  else
  {
    this->Write();
  }
}

void Checkpoints::FramePartial(int tick)
{
  this->Work = this->Run.Executor->SaveWork();
  this->WorkTick = tick;
  this->Unfinished.insert(tick);
  this->Halved = true;
  this->OlderTick.reset(); // one of its frames is overwritten by half of one
}

bool Checkpoints::IsFurther() const
{
  return this->OlderTick && *this->OlderTick > this->Finished;
}

void Checkpoints::End(bool complete)
{
  const Timeline& ticks = this->Run.Pipeline->Ticks;
  // Frames behind those of this run can go on from it.
  const bool stays =
    this->OlderTick &&
    (complete ? *this->OlderTick + 1 >= this->Run.End && this->Run.End < ticks.First + ticks.Count : this->IsFurther());
  if (stays)
  {
    std::fprintf(stderr, "quell: %s stays: --resume goes on after frame %d\n", this->File.c_str(), *this->OlderTick);
    return;
  }
  if (complete)
  {
    // Frames that this run has not made may still be unfinished; what is of another run is not ours to delete.
    if ((this->Ours || this->OlderTick) && (this->On || this->Unfinished.empty()))
    {
      this->Remove();
    }
    return;
  }
  if (this->Halved && this->Write() && !this->Work.empty())
  {
    std::fprintf(
      stderr, "quell: --resume goes on with the samples of frame %d, from %s\n", this->WorkTick, this->File.c_str());
    return;
  }
  if (this->On && this->Any && this->Finished != this->Saved && !this->Halved)
  {
    this->Write();
  }
  if (this->On && this->Saved > NoTick)
  {
    std::fprintf(stderr, "quell: --resume goes on after frame %d\n", this->Saved);
  }
}

RunIdentity Checkpoints::IdentityOfRun() const
{
  // Frames without history are the same wherever a run starts.
  RunIdentity id =
    IdentityOf(*this->Run.Executor, this->Run.Region, this->Run.Executor->HasDelays() ? this->Start : 0, QUELL_VERSION);
  id[InstructionSet] = SimdTargetName();
  return id;
}

void Checkpoints::Remove() const
{
  std::error_code code;
  if (IsCheckpoint(this->File))
  {
    std::filesystem::remove(this->File, code);
  }
}

std::string Checkpoints::Difference(const Checkpoint& theirs, RunIdentity& inputs)
{
  if (this->Identity.empty())
  {
    this->Identity = this->IdentityOfRun();
  }
  const Timeline& ticks = this->Run.Pipeline->Ticks;
  const int end = std::max(this->Run.End, ticks.First + ticks.Count);
  for (int tick = this->Start; this->On && tick <= theirs.Tick && tick < end; ++tick)
  {
    AddInputs(inputs, SequenceHashes(*this->Run.Pipeline, tick));
  }
  RunIdentity ours = this->Identity;
  ours.insert(inputs.begin(), inputs.end());
  // Another machine may have no choice.
  const auto instructions = theirs.Identity.find(InstructionSet);
  ours[InstructionSet] = instructions == theirs.Identity.end() ? std::string() : instructions->second;
  return DifferenceOf(theirs.Identity, ours);
}

Checkpoint Checkpoints::Read()
{
  try
  {
    Checkpoint checkpoint = ReadCheckpoint(this->File);
    const std::string difference = this->Difference(checkpoint, this->Inputs);
    if (!difference.empty())
    {
      throw UsageError(
        "--resume: checkpoint " + this->File + " is of another run: " + difference + "; nothing was executed");
    }
    if (checkpoint.Identity[InstructionSet] != this->Identity[InstructionSet])
    {
      std::fprintf(stderr,
        "quell: warning: --resume: the frames up to now were made with the instruction set %s, this run uses %s; "
        "they may differ in the last digits from those of one run\n",
        OneLine(checkpoint.Identity[InstructionSet]).c_str(), SimdTargetName());
    }
    this->Ours = this->Resumed = true;
    return checkpoint;
  }
  catch (const StageError& e)
  {
    throw UsageError(std::string("--resume: ") + e.what() + "; delete it to start from the beginning");
  }
}

void Checkpoints::TakeWork(const Checkpoint& checkpoint)
{
  const bool now = checkpoint.WorkTick < this->Run.End && checkpoint.WorkTick >= this->Start;
  if (checkpoint.Work.empty() || (this->On && !now))
  {
    return;
  }
  this->Work = checkpoint.Work; // of a frame that another run makes: it stays in the file
  this->WorkTick = checkpoint.WorkTick;
  if (!now)
  {
    return;
  }
  std::fprintf(
    stderr, "quell: --resume: going on with the samples of frame %d, from %s\n", this->WorkTick, this->File.c_str());
}

bool Checkpoints::Write()
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
  checkpoint.Unfinished = this->Unfinished;
  bool good = true;
  try
  {
    WriteCheckpoint(this->File, checkpoint);
    this->Saved = this->Finished;
    this->Ours = true;
    this->OlderTick.reset();
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
      const std::string state = this->Saved > NoTick ? "--resume would go on after frame " + std::to_string(this->Saved)
                                                     : std::string("this run cannot be resumed yet");
      std::fprintf(stderr, "quell: warning: %s; %s\n", e.what(), state.c_str());
    }
    this->Failed = true;
  }
  this->LastWrite = Clock::now();
  this->Cost = SecondsSince(start);
  return good;
}
}
