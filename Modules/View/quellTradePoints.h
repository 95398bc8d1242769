// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTradePoints_h
#define quellTradePoints_h

#include "quellPipelineDocument.h"
#include "quellPresenter.h"
#include "quellRenderSession.h"
#include "vtkQuellViewModule.h"

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace quell
{
/// One state of a pipeline, how long its frame took and how far it was from the reference.
struct TradePoint
{
  std::string Label; ///< what differs from the pipeline as it was opened
  double Milliseconds = 0, Error = 0;
  std::shared_ptr<const PipelineDocument> Document;
  int Tick = 0;
  ViewTarget Target;
  std::string Reference; ///< which picture it was compared with
  HistoryMode History = HistoryMode::Exact;
  bool Pareto = false; ///< no comparable point is both faster and better

  /// The same array of the same node in the same frame against the same reference: figures of two changes. Anything
  /// else says nothing about which change was the better one.
  bool ComparableWith(const TradePoint& o) const
  {
    return this->Tick == o.Tick && this->Target == o.Target && this->Reference == o.Reference &&
           this->History == o.History;
  }
};

/// The points that a session collects, one for each state of the document and each thing that was looked at; measured
/// again, a state keeps its shortest time (the first run of a state does work that later ones have cached).
class VTKQUELLVIEW_EXPORT TradePoints
{
public:
  std::string Metric = "relMSE";
  const std::vector<TradePoint>& All() const { return this->Points; }
  /// Indices of the points that can be compared with this one, oldest first.
  std::vector<int> ComparableWith(const TradePoint& point) const;
  /// Forgets the points, and names later ones by what differs from `opened`; null: from the first point's document.
  void Clear(std::shared_ptr<const PipelineDocument> opened = nullptr)
  {
    this->Points.clear();
    this->Opened = std::move(opened);
  }
  /// Index of the point that it is now. An empty label is filled in.
  int Add(TradePoint point);
  void Remove(int index);

  ///@{ How long nodes took when they ran: a frame that only an edit below them made says nothing about it.
  /// An execution that only added arrays to what was traced before (far fewer rays) does not count.
  void Learn(const std::string& node, double seconds, std::int64_t rays = 0)
  {
    if (2 * rays >= this->Rays[node])
    {
      this->Seconds[node] = seconds;
      this->Rays[node] = rays;
    }
  }
  double KnownSeconds(const std::string& node) const
  {
    const auto at = this->Seconds.find(node);
    return at == this->Seconds.end() ? 0. : at->second;
  }
  ///@}

private:
  void Mark();
  std::map<std::string, double> Seconds;
  std::map<std::string, std::int64_t> Rays;
  std::vector<TradePoint> Points;
  std::shared_ptr<const PipelineDocument> Opened;
};

/// What differs between two documents, for a point's label: "blur.SigmaSpatial 2 -> 1.25", "clamp added".
VTKQUELLVIEW_EXPORT std::string ChangeText(const PipelineDocument& before, const PipelineDocument& now);

/// Milliseconds of a frame, sources and readers included.
VTKQUELLVIEW_EXPORT double FrameMilliseconds(const ViewFrame& frame);

/// What each node costs and buys: the pipeline without the node, on a thread of its own, the same ticks and seed.
struct LedgerRow
{
  std::string Node;
  std::string Note;        ///< why there are no figures
  double Error = 0;        ///< without the node
  double Milliseconds = 0; ///< of the frame without it
  bool Done = false;
};
class VTKQUELLVIEW_EXPORT LedgerRun
{
public:
  /// `target` is of the document's top level; the last of the frames [first, tick] is compared.
  LedgerRun(std::shared_ptr<const PipelineDocument> document, const GraphOptions& options,
    const StageRegistry& registry, const ViewTarget& target, int tick, const Picture& reference,
    const std::string& metric);
  ~LedgerRun(); ///< cancels and waits
  std::vector<LedgerRow> Rows() const;
  double BaseError() const; ///< of the whole pipeline; negative: not known yet
  double BaseMilliseconds() const;
  bool Finished() const;
  std::shared_ptr<const PipelineDocument> Document() const;

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};
}

#endif
