// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPipelineExecutor_h
#define quellPipelineExecutor_h

#include "quellFrameHistory.h"
#include "quellGraph.h"
#include "vtkQuellPipelineModule.h"
#include "vtkSmartPointer.h"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

class vtkQuellCollector;

namespace quell
{
/// A rectangle as people see a picture: origin top left, y down, half open.
struct DisplayRegion
{
  int X0 = 0, Y0 = 0, X1 = 0, Y1 = 0;

  /// In rows that count from the bottom of a frame of that height.
  Rect ToFrame(int height) const { return { this->X0, height - this->Y1, this->X1, height - this->Y0 }; }
};

/// Which outputs a tick makes.
enum class TickMode
{
  Frame,     ///< outputs with one file per frame, sinks
  LastFrame, ///< those and outputs with one file per run
  WarmUp     ///< none: only what the next frame reads of this one
};

struct TickResult
{
  bool Ok = false;
  bool Cancelled = false;
  std::string Error;                 ///< `node "blur" (BilateralFilter): sentence`
  std::string Partial;               ///< "312 of 4096 samples": Ok, but finished early (CancelToken::Finish)
  std::vector<std::string> Files;    ///< written in this tick
  std::vector<std::string> Warnings; ///< `node "pt" (PathTraceSource): sentence`
};

struct NodeCounters
{
  std::string Path, Type;
  StageCounters Counters;
};

/// Runs a checked graph frame by frame: makes a stage for every live node, connects them, asks all outputs and
/// everything that a delayed input will read in one pass per tick, and owns the history between frames.
///
/// **Live** is what outputs with files, sinks and Request()s need, over normal and delayed edges. Delayed producers run
/// on the whole frame, outputs on the region. The history of a tick is committed when its whole frame succeeded.
class VTKQUELLPIPELINE_EXPORT PipelineExecutor
{
public:
  PipelineExecutor(std::shared_ptr<const Graph> graph, const StageRegistry& registry);
  ~PipelineExecutor();
  PipelineExecutor(const PipelineExecutor&) = delete;
  void operator=(const PipelineExecutor&) = delete;

  ///@{ Before the first tick or between ticks.
  void SetCancelToken(std::shared_ptr<CancelToken> token);
  /// Empty: the whole frame.
  void SetRegion(const std::optional<DisplayRegion>& region) { this->Region = region; }
  /// Makes each frame in bands of so many rows, from the top down, so that only a band's pixels (and those around it
  /// that filters read) are held at once: the same files. 0: whole frames. Rows around a band are made more than once.
  /// A frame that is finished early is given up. See CanRunInBands.
  void SetBandRows(int rows) { this->BandRows = rows; }
  /// False (with the reason) for pipelines with delayed inputs, which need whole frames, and with sinks that do.
  bool CanRunInBands(std::string& reason) const;
  /// For files that keep facts about the run. Each also gets `node`, the path of the node that writes it, and, unless the
  /// frame is made in bands, `stages`: JSON, what every stage before took in this frame.
  void SetMetadata(const std::map<std::string, std::string>& entries);
  /// Arrays of a node that the caller wants to look at after each tick (GetImage); an empty set takes the wish back.
  /// False for an unknown node.
  bool Request(const std::string& node, const ArraySet& arrays);
  /// Outputs with files and sinks; off for viewers, which only Request().
  void SetWriteOutputs(bool on);
  /// `progress` is called on the thread of RunTick with a node's path and how much of it is done, in [0, 1].
  /// `watched`: somebody reads GetSamplingStatus in it, so stages estimate their noise.
  void SetProgress(std::function<void(const std::string& node, double fraction)> progress, bool watched = true);
  /// Ticks of history to keep, default 3.
  void SetHistoryLength(int ticks);
  ///@}

  /// Takes over what `from` made where it is still right: stages of the same path, type and connections (with their
  /// data and caches; their properties become this graph's) and the history. For editors that change a graph while it
  /// runs: only what an edit reaches executes again. `from` can only be destroyed afterwards.
  void TakeStages(PipelineExecutor& from);

  /// Changes a parameter; the history stays. False fills `error`.
  bool SetProperty(const std::string& node, const std::string& name, const std::string& text, std::string& error);
  void ClearHistory() { this->History.Clear(); }
  /// Puts what producers had on a tick in place of running it (Checkpoint). Images must cover the whole frame.
  void SetHistory(int tick, FrameHistory::Frame frame) { this->History.Commit(tick, std::move(frame)); }

  /// A partial frame is written but not committed to the history: what follows needs it whole.
  TickResult RunTick(int tick, TickMode mode = TickMode::LastFrame);

  ///@{
  /// Node -> its work in a frame that was finished early; LoadWork is for the next tick that runs (see vtkQuellStage).
  using Work = std::map<std::string, std::string>;
  Work SaveWork() const;
  bool LoadWork(const Work& work, std::string& error);
  ///@}

  /// The frame's size as `node` has it, without executing anything. False fills `error` (`node "x" (T): sentence`).
  bool FrameSize(const std::string& node, int& width, int& height, std::string& error);
  /// Whether the region lies in every output's frame; a sentence otherwise.
  bool CheckRegion(std::string& error);

  /// Null for nodes that are not live. Who holds a stage longer than its executor has it without connections.
  vtkQuellStage* GetStage(const std::string& node) const;
  /// What the node had on the last tick that ran; null when not live.
  vtkImageData* GetImage(const std::string& node) const;
  const FrameHistory& GetHistory() const { return this->History; }
  const Graph& GetGraph() const { return *this->Plan; }
  const std::vector<bool>& LiveNodes() const { return this->Live; }
  bool HasDelays() const { return !this->Kept.empty(); }
  /// Node index -> arrays that the next frame reads.
  const std::map<int, ArraySet>& KeptArrays() const { return this->Kept; }
  bool HasTargets() const { return !this->Targets().empty(); }

  /// One asked thing of a pass.
  struct Target
  {
    int Node = -1;
    ArraySet Arrays;
    bool Whole = false;    ///< the whole frame whatever the region
    bool LastOnly = false; ///< only with TickMode::LastFrame
  };
  std::vector<Target> Targets() const;

  std::vector<NodeCounters> Counters() const; ///< of live nodes in execution order
  void ResetCounters();
  std::vector<std::string> Reports() const; ///< "node: report" of live nodes that have something to say

private:
  struct Observer;
  void Rebuild();
  TickResult TryTick(int tick, TickMode mode);
  void StartOver();
  std::string Title(int node) const;
  std::map<std::string, std::string> FrameMetadata(int node) const;
  struct Asked
  {
    Target What;
    Rect Region; ///< empty: the whole frame
  };
  bool Ask(TickMode mode, std::vector<Asked>& asked, std::string& error);
  bool Pass(int tick, const std::vector<Asked>& asked, TickResult& result);
  std::string PartialText() const;
  bool RunBands(int tick, std::vector<Asked>& asked, TickResult& result);
  bool Information(int node, Rect& whole, std::string& error);

  std::shared_ptr<const Graph> Plan;
  const StageRegistry& Registry;
  std::vector<vtkSmartPointer<vtkQuellStage>> Stages; ///< per node; null: not live
  std::vector<bool> Live;
  std::map<int, ArraySet> Kept;
  std::map<std::string, ArraySet> Requests;
  vtkSmartPointer<vtkQuellCollector> Collector;
  std::unique_ptr<Observer> Watch;
  std::shared_ptr<CancelToken> Token;
  std::optional<DisplayRegion> Region;
  std::map<std::string, std::string> Metadata;
  FrameHistory History;
  std::map<const vtkQuellStage*, StageCounters> Before; ///< when the frame at work began
  int BandRows = 0;
  bool WriteOutputs = true;
  bool Watched = false;
  bool Stale = true; ///< the live set changed
};
}

#endif
