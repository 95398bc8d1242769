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
  int Start = 0;            ///< the first tick to run
  std::set<int> Done;       ///< finished by an earlier run
  std::set<int> Unfinished; ///< have fewer samples than they should
};

/// Frames without history are finished when their files are there and of this very pipeline; `tell`: says so.
void SkipFinishedFrames(
  const PreparedRun& run, const std::map<std::string, std::string>& ofRun, ResumePoint& progress, bool tell);

/// Keeps the file from which an interrupted run goes on: the history of the last frame, for sequences that have one,
/// and the samples of a frame that was finished early, with the list of such frames: pictures other than EXR cannot say
/// it themselves. A file of another run, or of this one and further, stays until this run has one of its own to write.
class Checkpoints
{
public:
  explicit Checkpoints(PreparedRun& run);

  /// Of a run without --resume, which somebody may have forgotten.
  void MentionOld();

  void SetProgress(ProgressLine* line) { this->Line = line; }

  bool Exists() const;
  /// Where to start (the end: nothing is left to do); throws UsageError when there is a checkpoint that is not of this
  /// run.
  int Resume(const std::map<std::string, std::string>& metadata);

  /// Of a run without history: takes the samples that were saved; the frames that are unfinished.
  std::set<int> ResumeWork();

  void BeforeFrame(int tick);

  /// `sequences`: what was read of sequences for it. Writing may take a tenth of the time: small frames are not slowed
  /// down, and a run that stops by itself writes in End().
  void FrameDone(int tick, const std::map<std::string, std::string>& sequences);

  /// After a frame that was finished early: its samples are written in End().
  void FramePartial(int tick);

  void End(bool complete);

private:
  RunIdentity IdentityOfRun() const;

  /// What makes a checkpoint one of another run, or ""; what this run would have read up to it is added to `inputs`.
  std::string Difference(const Checkpoint& theirs, RunIdentity& inputs);

  void Remove() const;

  /// Throws UsageError when it is damaged or not of this run.
  Checkpoint Read();

  /// The file is of this run's frames and of a later one than this run has come to.
  bool IsFurther() const;

  /// After a frame without history: it is unfinished no more.
  void Settle(int tick);

  void TakeWork(const Checkpoint& checkpoint);

  bool Write();

  static constexpr const char* InstructionSet = "the program: instruction set";
  static constexpr int NoTick = std::numeric_limits<int>::min();
  PreparedRun& Run;
  int Start;
  bool On = false, Any = false, Failed = false;
  bool Resumed = false, Ours = false; ///< the file was read to go on from; is this run's to replace and to delete
  std::string File;
  RunIdentity Identity, Inputs; ///< Inputs: of the sequences that are read
  ProgressLine* Line = nullptr;
  int Finished = NoTick, Saved = NoTick;
  PipelineExecutor::Work Work; ///< read and not yet given to the executor, or to be written
  int WorkTick = 0;
  bool Halved = false;          ///< this run ended in the middle of a frame
  std::set<int> Unfinished;     ///< of runs without history
  std::optional<int> OlderTick; ///< of a history of this run that was there and was not gone on from
  std::chrono::steady_clock::time_point LastWrite = std::chrono::steady_clock::now();
  double Cost = 0;
};

/// "a, b and c".
std::string Enumerated(const std::vector<std::string>& names);
double SecondsSince(std::chrono::steady_clock::time_point start);
}

#endif
