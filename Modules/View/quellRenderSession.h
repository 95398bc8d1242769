// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRenderSession_h
#define quellRenderSession_h

#include "quellPipelineDocument.h"
#include "quellPipelineExecutor.h"
#include "quellVector.h"
#include "vtkQuellViewModule.h"

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace quell
{
/// A node's array that somebody looks at; no array: the node's first output.
struct ViewTarget
{
  std::string Node, Array;
  bool operator==(const ViewTarget& o) const { return this->Node == o.Node && this->Array == o.Array; }
  bool operator!=(const ViewTarget& o) const { return !(*this == o); }
  bool operator<(const ViewTarget& o) const
  {
    return this->Node != o.Node ? this->Node < o.Node : this->Array < o.Array;
  }
};

/// How a frame gets the history that frames before it leave.
enum class HistoryMode
{
  Exact, ///< all frames from the first one: the bits of `quell run`
  Short, ///< as many as `quell run --frames` computes, see PlanHistory
  None   ///< a jump starts without history
};

/// What the viewer wants to see. A plain value: the session compares it with what it has.
struct ViewWish
{
  std::shared_ptr<const PipelineDocument> Document;
  GraphOptions Options;
  int Tick = 0;
  std::vector<ViewTarget> Targets;
  bool AllArrays = false; ///< of the first target's node, for the pixel inspector
  HistoryMode History = HistoryMode::Exact;
  bool Play = false, Loop = true;
  double PlayRate = 0;     ///< frames a second at most; 0: as fast as it goes
  bool Progressive = true; ///< frames of many samples are shown on the way; the last one has the bits of one go
  bool Refine = false;     ///< go on beyond the pipeline's samples while nothing else is to be done
  bool Hurry = true;       ///< what runs is given up for this; else it may show something first
  bool Paused = false;
  /// Live camera, world from camera; a frame per change, time stands still, the history goes on. Empty: the scene's.
  std::optional<Mat4> Camera;
  int CameraSerial = 0; ///< a new number: a new frame, though the pose may be the same
};

/// What became of a wish. Immutable; images are shared with nobody who writes.
struct ViewFrame
{
  std::uint64_t Serial = 0; ///< of the wish; grows
  std::uint64_t Number = 0; ///< of the frame; grows
  std::shared_ptr<const PipelineDocument> Document;
  std::shared_ptr<const Graph> Pipeline; ///< null: could not be built
  bool Pruned = false;                   ///< only what is shown runs: the rest has mistakes
  int Tick = 0;
  int LiveTicks = 0; ///< of a live camera, frames since it took over
  bool Ok = false;
  std::string Error;
  std::vector<std::string> Warnings, Reports;
  std::map<std::string, vtkSmartPointer<vtkImageData>> Images; ///< node -> what it had
  struct Node
  {
    std::string Path, Type;
    StageCounters Counters; ///< of this frame; Held: at its end
    double Bytes = 0;       ///< of the arrays that it has
    bool Weighs = false;    ///< RenderSession::Weigh has an answer
  };
  std::vector<Node> Nodes;           ///< in execution order
  double Seconds = 0;                ///< of RunTick
  int Samples = 0, SamplesAsked = 0; ///< per pixel of the first source, so far and in the pipeline; 0: none
  bool Final = true;                 ///< no more samples will come by themselves
  std::map<std::string, std::vector<OutputArray>> Arrays; ///< what each node can be asked for

  /// The image array; null where the frame does not have it.
  vtkImageData* Image(const std::string& node) const;
};

/// What a filter made a pixel of.
struct ViewWeights
{
  std::uint64_t Frame = 0; ///< ViewFrame::Number
  std::string Node;
  int X = 0, Y = 0; ///< frame coordinates
  PixelWeights Weights;
  std::string Error; ///< why there are none
};

/// State of the work, for progress bars.
struct ViewProgress
{
  bool Busy = false;
  std::string Node;                   ///< at work
  double Fraction = 0;                ///< of it
  std::string Phase;                  ///< "warming up 3 of 12", "16 of 64 samples"
  double Elapsed = 0;                 ///< seconds of the frame at work
  std::map<std::string, double> Done; ///< node -> fraction, of the frame at work
};

/// What a document says: its mistakes, and what each node can be asked for.
struct ViewCheck
{
  std::shared_ptr<const PipelineDocument> Document;
  std::vector<Diagnostic> Messages;
  int Errors = 0;
  Timeline Ticks;
};

/// Runs pipelines on a thread of its own through PipelineExecutor, so that the event loop never waits. A wish replaces
/// the one before; what an edit does not reach is kept (PipelineExecutor::TakeStages). All functions may be called from
/// any thread.
class VTKQUELLVIEW_EXPORT RenderSession
{
public:
  explicit RenderSession(const StageRegistry& registry);
  ~RenderSession(); ///< cancels and waits
  RenderSession(const RenderSession&) = delete;
  void operator=(const RenderSession&) = delete;

  /// Returns the wish's serial.
  std::uint64_t Wish(const ViewWish& wish);
  /// Asks for the weights of a pixel of the newest frame, again whenever there is a newer one; no node: not any more.
  void Weigh(const std::string& node, int x, int y);
  std::shared_ptr<const ViewWeights> Weights() const; ///< null before the first
  /// Gives up what runs and waits for another wish; the same once more (or one that only does not play) is none.
  void Cancel();
  std::shared_ptr<const ViewFrame> Latest() const; ///< null before the first
  std::shared_ptr<const ViewCheck> Checked() const;
  ViewProgress Progress() const;
  /// Nothing runs and nothing is left to do (a playing session is never idle).
  bool Idle() const;
  /// Waits until Idle; false after `seconds`.
  bool WaitIdle(double seconds) const;
  /// Called on the session's thread after every frame and change of state, to wake an event loop.
  void SetNotify(std::function<void()> notify);

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};

/// The document with only what these nodes need, without outputs: runs while other parts of it are unfinished.
VTKQUELLVIEW_EXPORT std::shared_ptr<PipelineDocument> PrunedTo(
  const PipelineDocument& document, const std::vector<std::string>& nodes);
/// "indirect" of "indirect/atrous".
VTKQUELLVIEW_EXPORT std::string TopOf(const std::string& path);
/// "node" of "node:array", "" of "@port"; `array` empty where none is named.
VTKQUELLVIEW_EXPORT std::string NodeOfReference(const std::string& from, std::string* array = nullptr);
}

#endif
