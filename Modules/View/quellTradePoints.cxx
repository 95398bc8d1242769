// SPDX-License-Identifier: BSD-3-Clause
#include "quellTradePoints.h"

#include "quellDisplayMapping.h"
#include "quellGraphModel.h"
#include "quellLeaveOut.h"
#include "quellMetrics.h"
#include "vtkImageData.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <thread>

namespace quell
{
int TradePoints::Add(TradePoint point)
{
  for (std::size_t i = 0; i < this->Points.size(); ++i)
  {
    TradePoint& p = this->Points[i];
    if (p.ComparableWith(point) && (p.Document == point.Document || *p.Document == *point.Document))
    {
      p.Milliseconds = std::min(p.Milliseconds, point.Milliseconds);
      p.Error = point.Error;
      this->Mark();
      return int(i);
    }
  }
  if (!this->Opened)
  {
    this->Opened = point.Document;
  }
  if (point.Label.empty())
  {
    point.Label = ChangeText(*this->Opened, *point.Document);
  }
  this->Points.push_back(std::move(point));
  this->Mark();
  return int(this->Points.size()) - 1;
}

std::vector<int> TradePoints::ComparableWith(const TradePoint& point) const
{
  std::vector<int> found;
  for (std::size_t i = 0; i < this->Points.size(); ++i)
  {
    if (this->Points[i].ComparableWith(point))
    {
      found.push_back(int(i));
    }
  }
  return found;
}

void TradePoints::Remove(int index)
{
  if (index >= 0 && index < int(this->Points.size()))
  {
    this->Points.erase(this->Points.begin() + index);
    this->Mark();
  }
}

void TradePoints::Mark()
{
  for (TradePoint& p : this->Points)
  {
    p.Pareto = std::none_of(this->Points.begin(), this->Points.end(),
      [&p](const TradePoint& q)
      {
        return q.ComparableWith(p) && q.Milliseconds <= p.Milliseconds && q.Error <= p.Error &&
               (q.Milliseconds < p.Milliseconds || q.Error < p.Error);
      });
  }
}

double FrameMilliseconds(const ViewFrame& frame)
{
  double seconds = 0;
  for (const ViewFrame::Node& n : frame.Nodes)
  {
    seconds += n.Counters.Seconds;
  }
  return 1000 * seconds;
}

std::string ChangeText(const PipelineDocument& before, const PipelineDocument& now)
{
  const auto find = [](const std::vector<PipelineNode>& nodes, const std::string& id) -> const PipelineNode*
  {
    for (const PipelineNode& n : nodes)
    {
      if (n.Id.Value == id)
      {
        return &n;
      }
    }
    return nullptr;
  };
  std::vector<std::string> changes;
  const auto nodes =
    [&](const std::vector<PipelineNode>& a, const std::vector<PipelineNode>& b, const std::string& prefix)
  {
    for (const PipelineNode& n : b)
    {
      const PipelineNode* old = find(a, n.Id.Value);
      if (!old)
      {
        changes.push_back(prefix + n.Id.Value + " added");
        continue;
      }
      const auto value = [](const PipelineNode& node, const std::string& name) -> const std::string*
      {
        for (const PipelineProperty& p : node.Properties)
        {
          if (p.Name.Value == name)
          {
            return &p.Value.Value;
          }
        }
        return nullptr;
      };
      for (const PipelineProperty& p : n.Properties)
      {
        const std::string* was = value(*old, p.Name.Value);
        if (!was || *was != p.Value.Value)
        {
          changes.push_back(
            prefix + n.Id.Value + "." + p.Name.Value + " " + (was ? *was + " \u2192 " : "= ") + p.Value.Value);
        }
      }
      for (const PipelineProperty& p : old->Properties)
      {
        if (!value(n, p.Name.Value))
        {
          changes.push_back(prefix + n.Id.Value + "." + p.Name.Value + " reset");
        }
      }
      bool same = n.Inputs.size() == old->Inputs.size();
      for (std::size_t i = 0; same && i < n.Inputs.size(); ++i)
      {
        same =
          n.Inputs[i].From.Value == old->Inputs[i].From.Value && n.Inputs[i].Port.Value == old->Inputs[i].Port.Value;
      }
      if (!same)
      {
        changes.push_back(prefix + n.Id.Value + " connected anew");
      }
    }
    for (const PipelineNode& n : a)
    {
      if (!find(b, n.Id.Value))
      {
        changes.push_back(prefix + n.Id.Value + " deleted");
      }
    }
  };
  nodes(before.Nodes, now.Nodes, "");
  for (const PipelineTemplate& t : now.Templates)
  {
    for (const PipelineTemplate& old : before.Templates)
    {
      if (old.Name.Value == t.Name.Value)
      {
        nodes(old.Nodes, t.Nodes, t.Name.Value + "/");
      }
    }
  }
  for (const PipelineVariable& v : now.Variables)
  {
    for (const PipelineVariable& old : before.Variables)
    {
      if (old.Name.Value == v.Name.Value && old.Default.Value != v.Default.Value)
      {
        changes.push_back(v.Name.Value + " " + old.Default.Value + " \u2192 " + v.Default.Value);
      }
    }
  }
  if (changes.empty())
  {
    return "as opened";
  }
  std::string text;
  for (std::size_t i = 0; i < changes.size() && i < 3; ++i)
  {
    text += (i ? ", " : "") + changes[i];
  }
  return changes.size() > 3 ? text + " and " + std::to_string(changes.size() - 3) + " more" : text;
}

struct LedgerRun::Internals
{
  std::shared_ptr<const PipelineDocument> Document;
  GraphOptions Options;
  const StageRegistry* Registry = nullptr;
  ViewTarget Target;
  int Tick = 0;
  Picture Reference;
  std::string Metric;
  std::shared_ptr<CancelToken> Token = std::make_shared<CancelToken>();
  mutable std::mutex Mutex;
  std::vector<LedgerRow> Rows;
  double Error = -1, Milliseconds = 0;
  bool Finished = false;
  std::thread Thread;

  bool Measure(std::shared_ptr<const PipelineDocument> document, const ViewTarget& asked, double& error,
    double& milliseconds, std::string& note)
  {
    Diagnostics messages;
    const ViewTarget target = ResolveTarget(*document, asked);
    const auto pruned = PrunedTo(*document, { target.Node });
    GraphOptions options = this->Options;
    options.Outputs.clear();
    const auto graph = BuildGraph(pruned, *this->Registry, options, messages);
    if (messages.HasErrors())
    {
      note = messages.All().front().What;
      return false;
    }
    PipelineExecutor executor(graph, *this->Registry);
    executor.SetWriteOutputs(false);
    executor.SetCancelToken(this->Token);
    if (!executor.Request(target.Node, { target.Array }))
    {
      note = "there is no node " + Quoted(target.Node);
      return false;
    }
    const int first = executor.HasDelays() ? graph->Ticks.First : this->Tick;
    for (int t = first; t <= this->Tick; ++t)
    {
      executor.ResetCounters();
      const TickResult result = executor.RunTick(t, TickMode::Frame);
      if (!result.Ok)
      {
        note = result.Error;
        return false;
      }
    }
    double seconds = 0;
    for (const NodeCounters& c : executor.Counters())
    {
      seconds += c.Counters.Seconds;
    }
    milliseconds = 1000 * seconds;
    try
    {
      error = ComputeMetric(this->Metric, ArrayView(executor.GetImage(target.Node), target.Array),
        ArrayView(this->Reference.Image, this->Reference.Array));
    }
    catch (const std::exception& e)
    {
      note = e.what();
      return false;
    }
    return true;
  }

  void Run()
  {
    double error = 0, milliseconds = 0;
    std::string note;
    const bool base = this->Measure(this->Document, this->Target, error, milliseconds, note);
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      if (base)
      {
        this->Error = error;
        this->Milliseconds = milliseconds;
      }
      else
      {
        for (LedgerRow& r : this->Rows)
        {
          r.Note = note;
        }
      }
    }
    for (std::size_t i = 0; base && i < this->Rows.size(); ++i)
    {
      if (this->Token->IsCancelled())
      {
        break;
      }
      LedgerRow row;
      row.Node = this->Rows[i].Node;
      const auto without = LeaveOut(*this->Document, row.Node, *this->Registry, row.Note);
      ViewTarget target = this->Target;
      if (TopOf(target.Node) == row.Node)
      {
        // What is looked at is gone itself: what it read is seen instead.
        for (const PipelineNode& n : this->Document->Nodes)
        {
          if (n.Id.Value == row.Node && !n.Inputs.empty())
          {
            target.Node = NodeOfReference(n.Inputs.front().From.Value, &target.Array);
          }
        }
      }
      row.Done = without && this->Measure(without, target, row.Error, row.Milliseconds, row.Note);
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Rows[i] = row;
    }
    std::lock_guard<std::mutex> lock(this->Mutex);
    this->Finished = true;
  }
};

LedgerRun::LedgerRun(std::shared_ptr<const PipelineDocument> document, const GraphOptions& options,
  const StageRegistry& registry, const ViewTarget& target, int tick, const Picture& reference,
  const std::string& metric)
  : Internal(new Internals)
{
  Internals& in = *this->Internal;
  in.Document = document;
  in.Options = options;
  in.Registry = &registry;
  in.Target = target;
  in.Tick = tick;
  in.Reference = reference;
  in.Metric = metric;
  for (const std::string& id : RemovableNodes(*document, registry))
  {
    // What the target does not need costs and buys nothing.
    const auto pruned = PrunedTo(*document, { target.Node });
    for (const PipelineNode& n : pruned->Nodes)
    {
      if (n.Id.Value == id)
      {
        LedgerRow row;
        row.Node = id;
        in.Rows.push_back(row);
      }
    }
  }
  in.Thread = std::thread([this] { this->Internal->Run(); });
}

LedgerRun::~LedgerRun()
{
  this->Internal->Token->Cancel();
  this->Internal->Thread.join();
}

std::vector<LedgerRow> LedgerRun::Rows() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Rows;
}
double LedgerRun::BaseError() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Error;
}
double LedgerRun::BaseMilliseconds() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Milliseconds;
}
bool LedgerRun::Finished() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Finished;
}
std::shared_ptr<const PipelineDocument> LedgerRun::Document() const
{
  return this->Internal->Document;
}
}
