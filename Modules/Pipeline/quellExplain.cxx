// SPDX-License-Identifier: BSD-3-Clause
#include "quellExplain.h"

#include "vtkInformation.h"
#include "vtkQuellArraySetKey.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <set>

namespace quell
{
namespace
{
/// Numbered names in a row are drawn together: bounce1 ... bounce64.
std::string Joined(const std::vector<std::string>& names)
{
  const auto stem = [](const std::string& n) { return n.substr(0, n.find_last_not_of("0123456789") + 1); };
  std::string text;
  for (std::size_t i = 0; i < names.size();)
  {
    std::size_t end = i + 1;
    while (end < names.size() && stem(names[end]) == stem(names[i]) &&
           names[end] == stem(names[i]) + std::to_string(std::atoi(names[end - 1].c_str() + stem(names[i]).size()) + 1))
    {
      ++end;
    }
    if (end < i + 4)
    {
      end = i + 1;
    }
    text += (text.empty() ? "" : ", ") + names[i] + (end > i + 1 ? " ... " + names[end - 1] : "");
    i = end;
  }
  return text;
}

std::string RegionText(const Rect& r, int height)
{
  return std::to_string(r.x0) + "," + std::to_string(height - r.y1) + "," + std::to_string(r.x1) + "," +
         std::to_string(height - r.y0);
}

std::string DotQuoted(const std::string& s)
{
  std::string out = "\"";
  for (char c : s)
  {
    if (c == '"' || c == '\\')
    {
      out += '\\';
    }
    out += c;
  }
  return out + "\"";
}
}

std::string BytesText(double bytes)
{
  const char* const units[] = { "B", "kB", "MB", "GB" };
  int u = 0;
  while (bytes >= 1000 && u < 3)
  {
    bytes /= 1000;
    ++u;
  }
  char text[48];
  std::snprintf(text, sizeof text, u ? "%.1f %s" : "%.0f %s", bytes, units[u]);
  return text;
}

double PlanBytes(const ExecutionPlan& plan)
{
  double bytes = 0;
  for (const PlannedNode& n : plan.Nodes)
  {
    bytes += n.Bytes + n.KeptBytes;
  }
  return bytes;
}

double PlanMemory(const ExecutionPlan& plan)
{
  double bytes = ProgramBytes + PlanBytes(plan);
  for (const PlannedNode& n : plan.Nodes)
  {
    bytes += n.ScratchBytes;
  }
  return bytes;
}

void EstimateCosts(ExecutionPlan& plan, const PipelineExecutor& executor, const CostModel& model, int threads)
{
  plan.Threads = threads;
  plan.CostsOfAnotherMachine = 0;
  for (PlannedNode& n : plan.Nodes)
  {
    const vtkQuellStage* stage = executor.GetStage(n.Path);
    if (n.Executes && stage)
    {
      n.Seconds = model.Seconds(*stage, n.Type, double(n.Region.area()), threads);
      plan.CostsOfAnotherMachine += n.Seconds >= 0 && !model.IsOfThisMachine(*stage, n.Type);
    }
  }
}

double PlanSeconds(const ExecutionPlan& plan, int& unknown)
{
  double seconds = -1;
  unknown = 0;
  for (const PlannedNode& n : plan.Nodes)
  {
    unknown += n.Executes && n.Seconds < 0;
    seconds = n.Seconds < 0 ? seconds : std::max(0., seconds) + n.Seconds;
  }
  return seconds < 0 ? seconds : seconds * plan.Bands;
}

HistoryPlan PlanHistory(const PipelineExecutor& executor, int first, double tolerance)
{
  const Graph& graph = executor.GetGraph();
  HistoryPlan plan;
  const int available = std::max(0, first - graph.Ticks.First);
  if (!executor.HasDelays() || available == 0)
  {
    return plan;
  }
  std::vector<int> written;
  for (const PipelineExecutor::Target& t : executor.Targets())
  {
    written.push_back(t.Node);
  }
  std::vector<double> before(graph.Nodes.size(), 1.);
  for (int frames = 0; frames < available; ++frames)
  {
    // T of frames + 1; the first round is T_1, what no frame before leaves.
    std::vector<double> now(graph.Nodes.size(), 0.);
    for (int n : graph.Order)
    {
      const GraphNode& node = graph.Nodes[std::size_t(n)];
      const vtkQuellStage* stage = executor.GetStage(node.Path);
      if (!stage)
      {
        continue;
      }
      double whole = 0;
      for (const GraphEdge& e : node.Inputs)
      {
        if (!(stage->HistoryWeight(e.Port) < 1))
        {
          whole = std::max(whole, (e.Delayed ? before : now)[std::size_t(e.Producer)]);
        }
      }
      double rest = whole;
      for (const GraphEdge& e : node.Inputs)
      {
        const double weight = stage->HistoryWeight(e.Port);
        if (weight < 1)
        {
          const double old = (e.Delayed ? before : now)[std::size_t(e.Producer)];
          rest = std::max(rest, whole + std::max(0., weight) * std::max(0., old - whole));
        }
      }
      now[std::size_t(n)] = rest;
    }
    double rest = 0;
    for (int n : written)
    {
      rest = std::max(rest, now[std::size_t(n)]);
    }
    if (rest <= tolerance)
    {
      plan.Frames = frames;
      plan.RestWeight = rest;
      return plan;
    }
    before = std::move(now);
  }
  plan.Frames = available;
  return plan;
}

std::string HistoryText(const HistoryPlan& history)
{
  if (history.Frames == 0 && history.RestWeight == 0)
  {
    return std::string();
  }
  const std::string frames =
    history.Frames == 1 ? "1 frame before is" : std::to_string(history.Frames) + " frames before are";
  const std::string text = "history: " + frames + " computed and not written";
  if (history.RestWeight == 0)
  {
    return text + "; the bits are those of a run from the first frame";
  }
  char weight[32];
  std::snprintf(weight, sizeof weight, "%.2g", history.RestWeight);
  return text + "; those before them would have had a weight of at most " + weight;
}

ExecutionPlan MakePlan(
  PipelineExecutor& executor, const std::optional<DisplayRegion>& region, int first, int end, double tolerance)
{
  const Graph& graph = executor.GetGraph();
  ExecutionPlan plan;
  plan.File = graph.Document->File;
  plan.Ticks = graph.Ticks;
  plan.FirstTick = first;
  plan.EndTick = end;
  const HistoryPlan history = PlanHistory(executor, first, tolerance);
  plan.WarmUp = history.Frames;
  plan.RestWeight = history.RestWeight;
  plan.Variables.assign(graph.Variables.begin(), graph.Variables.end());
  for (const GraphOutput& o : graph.Outputs)
  {
    plan.Outputs.push_back({ o.Name, graph.Nodes[std::size_t(o.Node)].Path + ":" + o.Array, o.File, o.EveryFrame() });
  }
  const std::vector<bool>& live = executor.LiveNodes();
  for (std::size_t n = 0; n < graph.Nodes.size(); ++n)
  {
    if (!live[n])
    {
      plan.LeftOut.emplace_back(
        "node " + Quoted(graph.Nodes[n].Path) + " (" + graph.Nodes[n].Type + ")", "no output that is written needs it");
    }
  }

  struct Demand
  {
    ArraySet Asked;
    Rect Region;
    bool Any = false;
  };
  std::vector<Demand> demand(graph.Nodes.size());
  std::vector<Rect> wholes(graph.Nodes.size());
  for (int n : graph.Order)
  {
    if (!live[std::size_t(n)])
    {
      continue;
    }
    int width = 0, height = 0;
    if (!executor.FrameSize(graph.Nodes[std::size_t(n)].Path, width, height, plan.Error))
    {
      return plan;
    }
    wholes[std::size_t(n)] = { 0, 0, width, height };
  }
  for (const PipelineExecutor::Target& t : executor.Targets())
  {
    Demand& d = demand[std::size_t(t.Node)];
    const Rect& whole = wholes[std::size_t(t.Node)];
    plan.Width = std::max(plan.Width, whole.width());
    plan.Height = std::max(plan.Height, whole.height());
    d.Asked.insert(t.Arrays.begin(), t.Arrays.end());
    d.Region = d.Region.united(region && !t.Whole ? region->ToFrame(whole.height()).clipped(whole) : whole);
    d.Any = true;
  }
  for (const auto& k : executor.KeptArrays())
  {
    Demand& d = demand[std::size_t(k.first)];
    d.Asked.insert(k.second.begin(), k.second.end());
    d.Region = wholes[std::size_t(k.first)];
    d.Any = true;
  }

  for (auto at = graph.Order.rbegin(); at != graph.Order.rend(); ++at)
  {
    const std::size_t n = std::size_t(*at);
    if (!live[n])
    {
      continue;
    }
    const GraphNode& node = graph.Nodes[n];
    vtkQuellStage* stage = executor.GetStage(node.Path);
    const StageDescription& description = stage->GetDescription();
    const Demand& d = demand[n];
    PlannedNode planned;
    planned.Path = node.Path;
    planned.Type = node.Type;
    planned.Region = d.Region;
    planned.Notes = node.LeftOut;
    std::vector<OutputArray> own = description.Outputs;
    try
    {
      const std::vector<OutputArray> dynamic = stage->ListDynamicOutputs();
      own.insert(own.end(), dynamic.begin(), dynamic.end());
    }
    catch (const std::exception& e)
    {
      planned.Notes.push_back(e.what());
    }
    std::set<std::string> made;
    for (const OutputArray& o : own)
    {
      if (!made.insert(o.Name).second)
      {
        continue;
      }
      if (d.Asked.count(o.Name))
      {
        planned.Makes.push_back(o.Name);
        planned.Bytes += double(d.Region.area()) * std::max(1, o.Components) * double(sizeof(float));
      }
      else
      {
        planned.LeftOut.push_back(o.Name);
      }
    }
    for (const std::string& name : d.Asked)
    {
      if (!made.count(name))
      {
        planned.Passes.push_back(name);
      }
    }
    planned.Executes = !planned.Makes.empty() || description.Sink;
    planned.ScratchBytes = planned.Executes ? stage->ScratchBytes(d.Region, wholes[n], d.Asked) : 0.;
    const auto kept = executor.KeptArrays().find(int(n));
    if (kept != executor.KeptArrays().end())
    {
      planned.Keeps.assign(kept->second.begin(), kept->second.end());
      for (const OutputArray& a : graph.Arrays(int(n)))
      {
        planned.KeptBytes +=
          kept->second.count(a.Name) ? double(d.Region.area()) * std::max(1, a.Components) * double(sizeof(float)) : 0.;
      }
    }
    for (const GraphEdge& e : node.Inputs)
    {
      PlannedNode::Read read;
      read.Port = description.Inputs[std::size_t(e.Port)].Name;
      read.Producer = graph.Nodes[std::size_t(e.Producer)].Path;
      read.Array = e.Array;
      read.Delayed = e.Delayed;
      read.Needed = d.Any && stage->NeedsInput(e.Port, d.Asked);
      read.Halo = read.Needed ? std::max(0, stage->HaloFor(e.Port)) : 0;
      planned.Reads.push_back(read);
      if (e.Delayed)
      {
        continue;
      }
      // The same rules as vtkQuellStage::RequestUpdateExtent.
      Demand& up = demand[std::size_t(e.Producer)];
      const Rect& whole = wholes[std::size_t(e.Producer)];
      up.Any = true;
      up.Region = up.Region.united(stage->AllowsOtherExtent(e.Port) ? whole : d.Region.grown(read.Halo).clipped(whole));
      if (read.Needed)
      {
        up.Asked.insert(e.Array);
      }
      if (e.Port == 0 && e.Connection == 0)
      {
        for (const std::string& name : d.Asked)
        {
          if (!description.FindOutput(name))
          {
            up.Asked.insert(name);
          }
        }
      }
    }
    vtkInformation* asked = stage->GetOutputInformation(0);
    vtkQuellStage::REQUESTED_ARRAYS()->Write(asked, d.Asked);
    for (const std::string& line : stage->Explain())
    {
      planned.Notes.push_back(line);
    }
    asked->Remove(vtkQuellStage::REQUESTED_ARRAYS());
    for (const Property& p : description.Properties)
    {
      const std::string text = p.GetText(stage);
      if (text != p.DefaultText)
      {
        planned.Properties.emplace_back(p.Name, text);
      }
    }
    plan.Nodes.push_back(std::move(planned));
  }
  std::reverse(plan.Nodes.begin(), plan.Nodes.end());
  return plan;
}

std::string BandsText(const ExecutionPlan& plan)
{
  if (plan.BandRows == 0)
  {
    return std::string();
  }
  double inside = 0, made = 0;
  for (const PlannedNode& n : plan.Nodes)
  {
    inside += n.Executes ? double(n.Region.width()) * plan.BandRows : 0.;
    made += n.Executes ? double(n.Region.area()) : 0.;
  }
  char text[200];
  std::snprintf(text, sizeof text,
    "in %d bands of %d rows, one at a time: %s of memory, %s of it arrays, %.0f %% more pixels to make\n", plan.Bands,
    plan.BandRows, BytesText(PlanMemory(plan)).c_str(), BytesText(PlanBytes(plan)).c_str(),
    100 * (inside > 0 ? made / inside - 1 : 0));
  return text;
}

ExecutionPlan FitPlan(PipelineExecutor& executor, const std::optional<DisplayRegion>& region, int first, int end,
  double tolerance, double bytes, std::string& error)
{
  ExecutionPlan whole = MakePlan(executor, region, first, end, tolerance);
  const double needed = PlanMemory(whole);
  if (!whole.Error.empty() || bytes <= 0 || needed <= bytes)
  {
    return whole;
  }
  const DisplayRegion all = region.value_or(DisplayRegion{ 0, 0, whole.Width, whole.Height });
  const int height = all.Y1 - all.Y0;
  const auto banded = [&](int rows)
  {
    DisplayRegion band = all;
    band.Y0 = all.Y0 + std::max(0, (height - rows) / 2);
    band.Y1 = std::min(all.Y1, band.Y0 + rows);
    return MakePlan(executor, band, first, end, tolerance);
  };
  std::string reason;
  int rows = 0;
  if (executor.CanRunInBands(reason))
  {
    // The largest number of blocks of 16 rows that fits.
    int low = 0, high = (height - 1) / 16;
    while (low < high)
    {
      const int middle = (low + high + 1) / 2;
      if (PlanMemory(banded(16 * middle)) <= bytes)
      {
        low = middle;
      }
      else
      {
        high = middle - 1;
      }
    }
    rows = 16 * low;
    if (rows == 0)
    {
      reason = height > 16 ? "bands of 16 rows still need " + BytesText(PlanMemory(banded(16)))
                           : "the frame has too few rows for bands";
    }
  }
  if (rows > 0)
  {
    ExecutionPlan plan = banded(rows);
    plan.BandRows = rows;
    plan.Bands = (height + rows - 1) / rows;
    return plan;
  }
  const auto bytesOf = [](const PlannedNode& n) { return n.Bytes + n.KeptBytes + n.ScratchBytes; };
  std::vector<const PlannedNode*> nodes;
  for (const PlannedNode& n : whole.Nodes)
  {
    nodes.push_back(&n);
  }
  std::stable_sort(nodes.begin(), nodes.end(),
    [&bytesOf](const PlannedNode* x, const PlannedNode* y) { return bytesOf(*x) > bytesOf(*y); });
  std::string largest;
  for (std::size_t i = 0; i < nodes.size() && i < 3; ++i)
  {
    largest += (i ? ", " : "") + Quoted(nodes[i]->Path) + " " + BytesText(bytesOf(*nodes[i]));
  }
  error = "the run needs " + BytesText(needed) + ", " + BytesText(ProgramBytes) +
          " of it the program, most of the rest in " + largest + ", and " + reason;
  return whole;
}

std::string PlanText(const ExecutionPlan& plan)
{
  std::string out = plan.File + ": ";
  const int frames = plan.EndTick - plan.FirstTick;
  out += frames == 1 ? "frame " + std::to_string(plan.FirstTick)
                     : "frames " + std::to_string(plan.FirstTick) + " to " + std::to_string(plan.EndTick - 1) + " (" +
                         std::to_string(frames) + " at " + detail::FormatDouble(plan.Ticks.Rate) + " per second)";
  if (plan.Width > 0)
  {
    out += ", " + std::to_string(plan.Width) + " x " + std::to_string(plan.Height) + " pixels";
  }
  out += "\n";
  const std::string history = HistoryText({ plan.WarmUp, plan.RestWeight });
  out += history.empty() ? history : history + "\n";
  out += BandsText(plan);
  if (!plan.Variables.empty())
  {
    out += "variables:";
    for (const auto& v : plan.Variables)
    {
      out += " " + v.first + "=" + v.second;
    }
    out += "\n";
  }
  out += "outputs:\n";
  for (const auto& o : plan.Outputs)
  {
    out += "  " + o.Name + " = " + o.From;
    out += o.File.empty() ? " (no file: not written)" : " -> " + o.File + (o.EveryFrame ? "" : " (the last frame)");
    out += "\n";
  }
  out += "plan:\n";
  double pixels = 0, bytes = 0;
  for (const PlannedNode& n : plan.Nodes)
  {
    out += "  " + n.Path + " (" + n.Type + ") region " + RegionText(n.Region, plan.Height);
    if (!n.Executes)
    {
      out += ", passes arrays on";
    }
    out += "\n";
    if (!n.Properties.empty())
    {
      out += "    set:";
      for (const auto& p : n.Properties)
      {
        out += " " + p.first + "=" + p.second;
      }
      out += "\n";
    }
    for (const auto& r : n.Reads)
    {
      out += "    " + r.Port + " <- " + r.Producer + ":" + r.Array;
      if (!r.Needed)
      {
        out += ", not needed";
      }
      else if (r.Delayed)
      {
        out += " of the previous frame";
      }
      if (r.Halo > 0)
      {
        out += ", halo " + std::to_string(r.Halo);
      }
      out += "\n";
    }
    if (!n.Makes.empty())
    {
      out += "    makes " + Joined(n.Makes) + " (" + BytesText(n.Bytes) +
             (n.Seconds < 0 ? "" : ", about " + SecondsText(n.Seconds)) + ")\n";
    }
    if (n.ScratchBytes > 0)
    {
      out += "    needs " + BytesText(n.ScratchBytes) + " of scratch\n";
    }
    if (!n.Passes.empty())
    {
      out += "    passes " + Joined(n.Passes) + "\n";
    }
    if (!n.Keeps.empty())
    {
      out += "    keeps " + Joined(n.Keeps) + " for the next frame: runs on the whole frame\n";
    }
    if (!n.LeftOut.empty())
    {
      out += "    not made, nobody reads it: " + Joined(n.LeftOut) + "\n";
    }
    for (const std::string& note : n.Notes)
    {
      out += "    " + note + "\n";
    }
    if (n.Executes)
    {
      pixels += double(n.Region.area());
      bytes += n.Bytes;
    }
  }
  if (!plan.LeftOut.empty())
  {
    out += "left out:\n";
    for (const auto& l : plan.LeftOut)
    {
      out += "  " + l.first + ": " + l.second + "\n";
    }
  }
  char cost[160];
  std::snprintf(cost, sizeof cost, "cost of a %s: %d stages, %.0f stage pixels, %s of arrays\n",
    plan.BandRows > 0 ? "band" : "frame",
    int(std::count_if(plan.Nodes.begin(), plan.Nodes.end(), [](const PlannedNode& n) { return n.Executes; })), pixels,
    BytesText(bytes).c_str());
  out += cost;
  int unknown = 0;
  const double seconds = PlanSeconds(plan, unknown);
  if (seconds >= 0)
  {
    out += "time: about " + SecondsText(seconds) + " a frame with " + std::to_string(plan.Threads) +
           (plan.Threads == 1 ? " thread" : " threads") + " (without reading the scene";
    out += unknown > 0 ? "; " + std::to_string(unknown) + (unknown == 1 ? " node" : " nodes") + " not known)" : ")";
    out += plan.CostsOfAnotherMachine == 0 ? "\n"
                                           : "; costs of " + std::to_string(plan.CostsOfAnotherMachine) +
                                               (plan.CostsOfAnotherMachine == 1 ? " node are" : " nodes are") +
                                               " another machine's, quell calibrate measures this one\n";
  }
  const double held = PlanBytes(plan);
  out += "memory: about " + BytesText(PlanMemory(plan)) + ", scenes not counted: " + BytesText(held) + " of arrays" +
         (held > bytes ? " with what is kept of the frame before, " : ", ") +
         BytesText(PlanMemory(plan) - held - ProgramBytes) + " of scratch, " + BytesText(ProgramBytes) +
         " the program\n";
  return out;
}

std::string PlanDot(const ExecutionPlan& plan)
{
  std::string out = "digraph quell {\n  rankdir=LR;\n  node [shape=box];\n";
  for (const PlannedNode& n : plan.Nodes)
  {
    out += "  " + DotQuoted(n.Path) + " [label=" +
           DotQuoted(n.Path + " | " + n.Type + " | " + RegionText(n.Region, plan.Height) +
                     (n.Seconds < 0 ? "" : " | " + SecondsText(n.Seconds))) +
           "];\n";
  }
  for (const PlannedNode& n : plan.Nodes)
  {
    for (const auto& r : n.Reads)
    {
      out += "  " + DotQuoted(r.Producer) + " -> " + DotQuoted(n.Path) + " [label=" + DotQuoted(r.Array) +
             (r.Delayed   ? ", style=dashed, constraint=false"
               : r.Needed ? ""
                          : ", color=gray") +
             "];\n";
    }
  }
  return out + "}\n";
}
}
