// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellExplain_h
#define quellExplain_h

#include "quellCostModel.h"
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
    bool Needed = true; ///< false: connected, but not read for what is asked
    int Halo = 0;
  };
  std::string Path, Type;
  bool Executes = true; ///< false: only passes arrays on
  Rect Region;          ///< rows from the bottom, as stages see it
  std::vector<Read> Reads;
  std::vector<std::string> Makes, Passes, LeftOut; ///< LeftOut: described outputs that nobody reads
  std::vector<std::string> Keeps;                  ///< read by the next frame; the node runs on the whole frame
  double Bytes = 0;                                ///< of arrays made per frame
  double KeptBytes = 0;                            ///< of those kept for the next one
  double ScratchBytes = 0;                         ///< what it needs besides, see vtkQuellStage::ScratchBytes
  double Seconds = -1;                             ///< estimated, of one execution (EstimateCosts); negative: unknown
  std::vector<std::string> Notes;                  ///< what the stage itself leaves out and why
  std::vector<std::pair<std::string, std::string>> Properties; ///< that differ from the default
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
  int FirstTick = 0, EndTick = 0; ///< frames written: [FirstTick, EndTick)
  int WarmUp = 0;                 ///< frames before FirstTick that are computed for their history
  double RestWeight = 0;          ///< see HistoryPlan
  int BandRows = 0, Bands = 1;    ///< rows of a frame made at once, see FitPlan; 0: all, and the nodes are of one frame
  std::vector<std::pair<std::string, std::string>> Variables;
  std::vector<Output> Outputs;
  std::vector<PlannedNode> Nodes;
  std::vector<std::pair<std::string, std::string>> LeftOut; ///< `node "x" (T)` -> why
  int Threads = 0;                                          ///< of the estimates; 0: there are none
  int CostsOfAnotherMachine = 0; ///< nodes whose estimates do not follow from quell calibrate
  std::string Error;             ///< why the plan is not complete
};

/// Asks every live stage for its information (which opens no more than headers) and propagates demand as a pass would;
/// executes nothing. Frames: the run's [first, end), as quell run takes them; `tolerance` as for PlanHistory.
VTKQUELLPIPELINE_EXPORT ExecutionPlan MakePlan(
  PipelineExecutor& executor, const std::optional<DisplayRegion>& region, int first, int end, double tolerance = 1e-3);

/// Fills in what every node of the plan would take.
VTKQUELLPIPELINE_EXPORT void EstimateCosts(
  ExecutionPlan& plan, const PipelineExecutor& executor, const CostModel& model, int threads);
/// Of one frame; negative where nothing is known. `unknown`: nodes that are not in it.
VTKQUELLPIPELINE_EXPORT double PlanSeconds(const ExecutionPlan& plan, int& unknown);

/// MakePlan; where the run needs more memory than `bytes` (PlanMemory), the plan of a band in the middle of the frame
/// with the most rows (a multiple of 16) that fit, and BandRows says so. Where no 16 rows fit, or the pipeline cannot
/// run in bands, `error` says why. bytes 0: no limit.
VTKQUELLPIPELINE_EXPORT ExecutionPlan FitPlan(PipelineExecutor& executor, const std::optional<DisplayRegion>& region,
  int first, int end, double tolerance, double bytes, std::string& error);

/// Frames that a run computes before the first one it writes.
struct HistoryPlan
{
  int Frames = 0;
  double RestWeight =
    0; ///< largest weight that still earlier frames would have had; 0: the bits are those of a full run
};

/// The fewest frames before `first` that bring the weight of all frames before them to `tolerance` or below in
/// everything written; all since the timeline's first when that many do not exist or a loop never forgets
/// (vtkQuellStage::HistoryWeight).
///
/// With T_n(v) the weight of frames n or more back in what v makes now, T_0 = 1, T_n(source) = 0, and for an input of
/// weight w from u (T_n(u), or T_{n-1}(u) where it is delayed): T_n(v) = A + max over inputs with w < 1 of w max(0,
/// T(u) - A), where A is the largest T over inputs with w = 1. k frames before leave T_{k+1}. A single loop of weight w
/// leaves w^(k+1); chained loops are convolved, not multiplied. Averages are meant: what filters decide from them (edge
/// stops, clipping) is not bounded.
VTKQUELLPIPELINE_EXPORT HistoryPlan PlanHistory(const PipelineExecutor& executor, int first, double tolerance = 1e-3);

/// "history: ..." of explain and run; empty when nothing is computed before the first frame.
VTKQUELLPIPELINE_EXPORT std::string HistoryText(const HistoryPlan& history);

/// "in 9 bands of 240 rows ..." with a line end; empty where the frame is made at once.
VTKQUELLPIPELINE_EXPORT std::string BandsText(const ExecutionPlan& plan);
/// Bytes of arrays that a run holds at once: what every node makes for a frame, and what is kept of the one before.
VTKQUELLPIPELINE_EXPORT double PlanBytes(const ExecutionPlan& plan);
/// Resident memory of the program with its libraries, before there are pixels.
constexpr double ProgramBytes = 170e6;
/// What a run needs at most, but for scenes: ProgramBytes, arrays, and the scratch of all stages, which they keep.
VTKQUELLPIPELINE_EXPORT double PlanMemory(const ExecutionPlan& plan);
/// `12.5 MB`, decimal.
VTKQUELLPIPELINE_EXPORT std::string BytesText(double bytes);

VTKQUELLPIPELINE_EXPORT std::string PlanText(const ExecutionPlan& plan);
VTKQUELLPIPELINE_EXPORT std::string PlanDot(const ExecutionPlan& plan);
}

#endif
