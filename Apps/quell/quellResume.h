// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellResume_h
#define quellResume_h

#include "quellCheckpoint.h"
#include "quellCommands.h"
#include "quellProgressLine.h"

#include <chrono>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace quell
{
/// What a file needs to say where it came from. `pipeline` alone makes the same run again; the rest is for people and
/// checks.
std::map<std::string, std::string> Provenance(const PreparedRun& run);
/// The same of one frame: its own file of every sequence that is read.
std::map<std::string, std::string> ProvenanceOf(
  const std::map<std::string, std::string>& run, const std::map<std::string, std::string>& sequences);

/// Where a run starts, and which frames it need not make.
struct ResumePoint
{
  int Start = 0;                 ///< the first tick to run
  std::set<int> Done;            ///< finished by an earlier run
  std::optional<int> Unfinished; ///< has samples of an earlier run
};

/// Frames without history are finished when their files are there and of this very pipeline.
void SkipFinishedFrames(const PreparedRun& run, const std::map<std::string, std::string>& ofRun, ResumePoint& progress);

/// Keeps the file from which an interrupted run goes on: the history of the last frame, for sequences that have one,
/// and the samples of a frame that was finished early.
class Checkpoints
{
public:
  explicit Checkpoints(PreparedRun& run);

  /// Before it is overwritten: somebody may have forgotten --resume.
  void MentionOld() const;

  void SetProgress(ProgressLine* line) { this->Line = line; }

  bool Exists() const;
  /// Where to start (the end: nothing is left to do); throws UsageError when there is a checkpoint that is not of this
  /// run.
  int Resume(const std::map<std::string, std::string>& metadata);

  /// The frame whose samples were saved, of a run without history.
  std::optional<int> ResumeWork();

  void BeforeFrame(int tick);

  /// `sequences`: what was read of sequences for it. Writing may take a tenth of the time: small frames are not slowed
  /// down, and a run that stops by itself writes in End().
  void FrameDone(int tick, const std::map<std::string, std::string>& sequences);

  /// After a frame that was finished early: its samples are written in End().
  void FramePartial(int tick);

  void End(bool complete);

private:
  RunIdentity IdentityOfRun() const;

  /// The history of a frame is of all files that were read up to it.
  void AddInputs(const std::map<std::string, std::string>& hashes);

  void Remove() const;

  /// Throws UsageError when it is damaged or not of this run.
  Checkpoint Read();

  void TakeWork(const Checkpoint& checkpoint);

  bool Write();

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
  std::chrono::steady_clock::time_point LastWrite = std::chrono::steady_clock::now();
  double Cost = 0;
};

/// "a, b and c".
std::string Enumerated(const std::vector<std::string>& names);
double SecondsSince(std::chrono::steady_clock::time_point start);
}

#endif
