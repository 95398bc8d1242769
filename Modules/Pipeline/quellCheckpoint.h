// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCheckpoint_h
#define quellCheckpoint_h

#include "quellFrameHistory.h"
#include "quellPipelineExecutor.h"
#include "vtkQuellPipelineModule.h"

#include <cstdint>
#include <map>
#include <set>
#include <string>

namespace quell
{
/// Everything that decides the bits of a run's frames, as label -> value: properties (defaults too), connections, time,
/// outputs, contents of input files, region, first frame computed, program version. Labels read well in a message.
using RunIdentity = std::map<std::string, std::string>;

/// `start`: the first frame that the run computes, those before the first one written included.
VTKQUELLPIPELINE_EXPORT RunIdentity IdentityOf(
  const PipelineExecutor& executor, const std::optional<DisplayRegion>& region, int start, const std::string& version);
/// "" when equal, else a sentence about the first difference: `node "taa" (TemporalAntialias): Alpha was 0.1 and is
/// 0.2`.
VTKQUELLPIPELINE_EXPORT std::string DifferenceOf(const RunIdentity& before, const RunIdentity& now);

/// The state of a run after a frame, the work in a later one that was finished early, and which frames were, as a file.
/// Little endian, lengths as u32 or u64, no padding:
///
///     "QUELLCKP" u32 version = 3, u64 size of the whole file, i32 tick
///     u32 n, n x { string label, string value }                                     the identity
///     u32 n, n x { string producer, i32 extent[4] (x0, x1, y0, y1 inclusive), f64 origin[3], f64 spacing[3],
///                  u32 m, m x { string name, u32 components, float32 values[] },     rows from the bottom
///                  u32 f, f x { string name, u8 kind, u32 count, values }            field data: 0 f64, 1 i64, 2
///                  string
///     i32 tick of the unfinished frame, u32 n, n x { string node, u64 bytes, bytes }  vtkQuellStage::SaveWork
///     u32 n, n x { i32 tick }                                                        the frames that were
///     u64 ContentHash of everything before
///
/// where a string is a u32 length and that many bytes.
struct VTKQUELLPIPELINE_EXPORT Checkpoint
{
  RunIdentity Identity;
  int Tick = 0; ///< the last whole frame; its history is Frame
  FrameHistory::Frame Frame;
  int WorkTick = 0; ///< what Work is of; behind Tick
  PipelineExecutor::Work Work;
  std::set<int> Unfinished; ///< frames whose files hold fewer samples than they should
};

/// Writes under a temporary name beside `file` and renames; never over what is no checkpoint. Throws StageError with the
/// file's name and the reason.
VTKQUELLPIPELINE_EXPORT void WriteCheckpoint(const std::string& file, const Checkpoint& checkpoint);
/// Throws StageError when the file is not a whole checkpoint. Every length is checked against the bytes that are left
/// before anything of that size is allocated.
VTKQUELLPIPELINE_EXPORT Checkpoint ReadCheckpoint(const std::string& file);

/// A regular file that begins as one.
VTKQUELLPIPELINE_EXPORT bool IsCheckpoint(const std::string& file);

/// Gives the executor the history of the checkpoint (its work not). False (with a sentence) when what the next frame
/// reads is not in it or has another size; then nothing is changed.
VTKQUELLPIPELINE_EXPORT bool Restore(PipelineExecutor& executor, const Checkpoint& checkpoint, std::string& error);

/// `<directory of the first file written>/<name of the pipeline file>.checkpoint`.
VTKQUELLPIPELINE_EXPORT std::string CheckpointPath(const PipelineExecutor& executor);
}

#endif
