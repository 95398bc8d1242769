// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellExplain_h
#define quellExplain_h

#include "quellPipelineExecutor.h"
#include "vtkQuellPipelineModule.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// What one node would do for one frame.
struct PlannedNode
{
  struct Read
  {
    std::string Port, Producer, Array;
    bool Delayed = false;
    bool Needed = true;  ///< false: connected, but not read for what is asked
    int Halo = 0;
  };
  std::string Path, Type;
  bool Executes = true;  ///< false: only passes arrays on
  Rect Region;           ///< rows from the bottom, as stages see it
  std::vector<Read> Reads;
  std::vector<std::string> Makes, Passes, LeftOut;  ///< LeftOut: described outputs that nobody reads
  std::vector<std::string> Keeps;                   ///< read by the next frame; the node runs on the whole frame
  double Bytes = 0;                                 ///< of arrays made per frame
  std::vector<std::string> Notes;                   ///< what the stage itself leaves out and why
  std::vector<std::pair<std::string, std::string>> Properties;  ///< that differ from the default
};

/// The plan of a run: what would be executed, in order, and what not and why.
struct ExecutionPlan
{
  struct Output
  {
    std::string Name, From, File;
    bool EveryFrame = true;
  };
  std::string File;
  int Width = 0, Height = 0;
  Timeline Ticks;
  int FirstTick = 0, EndTick = 0;  ///< frames written: [FirstTick, EndTick)
  int WarmUp = 0;                  ///< frames before FirstTick that are computed for their history
  std::vector<std::pair<std::string, std::string>> Variables;
  std::vector<Output> Outputs;
  std::vector<PlannedNode> Nodes;
  std::vector<std::pair<std::string, std::string>> LeftOut;  ///< `node "x" (T)` -> why
  std::string Error;                                         ///< why the plan is not complete
};

/// Asks every live stage for its information (which opens no more than headers) and propagates demand as a pass would;
/// executes nothing. Frames: the run's [first, end), as quell run takes them.
VTKQUELLPIPELINE_EXPORT ExecutionPlan MakePlan(
  PipelineExecutor& executor, const std::optional<DisplayRegion>& region, int first, int end);

/// How many frames before `first` a run computes for their history: all since the timeline's first when anything is
/// delayed, so that the frame has the same bits as in a run from the beginning; none otherwise.
VTKQUELLPIPELINE_EXPORT int WarmUpFrames(const PipelineExecutor& executor, int first);

VTKQUELLPIPELINE_EXPORT std::string PlanText(const ExecutionPlan& plan);
VTKQUELLPIPELINE_EXPORT std::string PlanDot(const ExecutionPlan& plan);
}

#endif
