// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelineExecutor.h"

#include "quellImageGuard.h"
#include "quellPixelMemory.h"
#include "vtkCallbackCommand.h"
#include "vtkExecutive.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkNew.h"
#include "vtkQuellCollector.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <algorithm>
#include <cstdio>
#include <new>

namespace quell
{
/// Progress, and VTK's error and warning events: an observed error is not printed, and failures are reported once, by
/// the stage's own sentence.
struct PipelineExecutor::Observer
{
  std::function<void(const std::string&, double)> Progress;
  int Band = 0, Bands = 1; ///< of the frame at work
  std::map<vtkObject*, std::string> Names;
  std::string FirstError;
  vtkQuellStage* FirstFailed = nullptr; ///< never for being cancelled
  std::string FailedText;
  std::shared_ptr<CancelToken> Token;
  std::vector<std::string> Warnings;
  vtkNew<vtkCallbackCommand> Command;

  Observer()
  {
    this->Command->SetClientData(this);
    this->Command->SetCallback([](vtkObject* caller, unsigned long event, void* self, void* data)
      { static_cast<Observer*>(self)->Handle(caller, event, data); });
  }

  void Handle(vtkObject* caller, unsigned long event, void* data)
  {
    const auto name = this->Names.find(caller);
    switch (event)
    {
      case vtkCommand::ErrorEvent:
        if (this->FirstError.empty() && data)
        {
          this->FirstError = static_cast<const char*>(data);
        }
        if (!this->FirstFailed && this->Token && !this->Token->IsCancelled())
        {
          if (vtkQuellStage* stage = vtkQuellStage::SafeDownCast(caller))
          {
            // One failure ends the frame: otherwise what failed would run again on every path that leads to it.
            this->FirstFailed = stage;
            this->FailedText = stage->GetErrorText(); // the next path to it will say "cancelled"
            this->Token->Cancel();
          }
        }
        break;
      case vtkCommand::WarningEvent:
        if (data)
        {
          this->Warnings.push_back(static_cast<const char*>(data));
        }
        break;
      default:
        if (this->Progress && name != this->Names.end())
        {
          const double fraction = event == vtkCommand::StartEvent ? 0.
                                  : event == vtkCommand::EndEvent ? 1.
                                  : data                          ? *static_cast<double*>(data)
                                                                  : 0.;
          this->Progress(name->second, (this->Band + std::min(1., std::max(0., fraction))) / this->Bands);
        }
    }
  }

  void Add(vtkAlgorithm* algorithm, const std::string& name)
  {
    this->Names[algorithm] = name;
    for (unsigned long event : { vtkCommand::StartEvent, vtkCommand::ProgressEvent, vtkCommand::EndEvent,
           vtkCommand::ErrorEvent, vtkCommand::WarningEvent })
    {
      algorithm->AddObserver(event, this->Command);
    }
    algorithm->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, this->Command);
    algorithm->GetExecutive()->AddObserver(vtkCommand::WarningEvent, this->Command);
  }
};

PipelineExecutor::PipelineExecutor(std::shared_ptr<const Graph> graph, const StageRegistry& registry)
  : Plan(graph)
  , Registry(registry)
  , Stages(graph->Nodes.size())
  , Live(graph->Nodes.size(), false)
  , Collector(vtkSmartPointer<vtkQuellCollector>::New())
  , Watch(new Observer)
{
  this->Watch->Add(this->Collector, "");
  this->Watch->Names.erase(this->Collector);
  this->SetCancelToken(std::make_shared<CancelToken>());
  this->Rebuild();
}

PipelineExecutor::~PipelineExecutor()
{
  // Somebody may hold a stage longer than us; it must not call back.
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      stage->SetMetadataSource({});
      stage->RemoveObserver(this->Watch->Command);
      stage->GetExecutive()->RemoveObserver(this->Watch->Command);
    }
  }
  // With each reference to a stage that is dropped VTK looks for cycles in all that leads to it, which takes time with
  // the square of the nodes. From the sources down nothing leads to a stage any more when it is dropped.
  for (int n : this->Plan->Order)
  {
    vtkQuellStage* stage = this->Stages[std::size_t(n)];
    for (int port = 0; stage && port < stage->GetNumberOfInputPorts(); ++port)
    {
      stage->SetInputConnection(port, nullptr);
    }
  }
}

std::string PipelineExecutor::Title(int node) const
{
  const GraphNode& n = this->Plan->Nodes[std::size_t(node)];
  return "node " + Quoted(n.Path) + " (" + n.Type + ")";
}

std::vector<PipelineExecutor::Target> PipelineExecutor::Targets() const
{
  std::vector<Target> targets;
  if (this->WriteOutputs)
  {
    std::vector<bool> isWriter(this->Plan->Nodes.size(), false);
    for (const GraphOutput& o : this->Plan->Outputs)
    {
      if (o.Writer >= 0)
      {
        isWriter[std::size_t(o.Writer)] = true;
        targets.push_back({ o.Writer, {}, false, !o.EveryFrame() });
      }
    }
    for (std::size_t n = 0; n < this->Plan->Nodes.size(); ++n)
    {
      if (!isWriter[n] && this->Plan->Nodes[n].Description().Sink)
      {
        targets.push_back({ int(n), {}, false, false });
      }
    }
  }
  for (const auto& r : this->Requests)
  {
    targets.push_back({ this->Plan->Find(r.first), r.second, false, false });
  }
  return targets;
}

void PipelineExecutor::Rebuild()
{
  if (!this->Stale)
  {
    return;
  }
  this->Stale = false;
  std::vector<int> nodes;
  for (const Target& t : this->Targets())
  {
    nodes.push_back(t.Node);
  }
  this->Live = this->Plan->Needed(nodes);
  this->Kept.clear();
  for (std::size_t n = 0; n < this->Plan->Nodes.size(); ++n)
  {
    const GraphNode& node = this->Plan->Nodes[n];
    if (!this->Live[n])
    {
      continue; // a stage made before stays with its data: a viewer may come back to it
    }
    for (const GraphEdge& e : node.Inputs)
    {
      if (e.Delayed)
      {
        this->Kept[e.Producer].insert(e.Array);
      }
    }
    if (this->Stages[n])
    {
      continue;
    }
    vtkSmartPointer<vtkQuellStage> stage = this->Registry.Create(node.Type);
    for (const GraphProperty& p : node.Properties)
    {
      std::string error;
      stage->SetPropertyText(p.Name, p.Text, error); // checked when the graph was built
    }
    stage->SetTimeline(this->Plan->Ticks);
    stage->SetConnectionsChecked(true); // by the graph builder
    stage->SetCancelToken(this->Token);
    stage->SetWatched(this->Watched);
    stage->SetMetadata(this->Metadata);
    stage->SetMetadataSource([this, n] { return this->FrameMetadata(int(n)); });
    this->Watch->Add(stage, node.Path);
    this->Stages[n] = stage;
  }
  for (std::size_t n = 0; n < this->Plan->Nodes.size(); ++n)
  {
    vtkQuellStage* stage = this->Stages[n];
    if (!this->Live[n] || !stage)
    {
      continue;
    }
    const GraphNode& node = this->Plan->Nodes[n];
    for (const GraphEdge& e : node.Inputs)
    {
      if (e.Delayed)
      {
        stage->SetInputArray(e.Port, 0, e.Array);
        if (!stage->IsDelayed(e.Port))
        {
          stage->SetHistory(e.Port, nullptr);
        }
      }
      else if (stage->GetNumberOfInputConnections(e.Port) <= e.Connection)
      {
        stage->ConnectInput(
          node.Description().Inputs[std::size_t(e.Port)].Name, this->Stages[std::size_t(e.Producer)], e.Array);
      }
      else
      {
        continue;
      }
      for (const auto& a : e.Attributes)
      {
        std::string error;
        stage->SetInputAttribute(e.Port, e.Connection, a.first, a.second, error);
      }
    }
  }
}

void PipelineExecutor::SetCancelToken(std::shared_ptr<CancelToken> token)
{
  this->Token = token ? std::move(token) : std::make_shared<CancelToken>();
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      stage->SetCancelToken(this->Token);
    }
  }
}

void PipelineExecutor::SetMetadata(const std::map<std::string, std::string>& entries)
{
  this->Metadata = entries;
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      stage->SetMetadata(entries);
    }
  }
}

bool PipelineExecutor::Request(const std::string& node, const ArraySet& arrays)
{
  if (this->Plan->Find(node) < 0)
  {
    return false;
  }
  if (arrays.empty())
  {
    this->Requests.erase(node);
  }
  else
  {
    this->Requests[node] = arrays;
  }
  this->Stale = true;
  this->Rebuild();
  return true;
}

void PipelineExecutor::SetWriteOutputs(bool on)
{
  this->WriteOutputs = on;
  this->Stale = true;
  this->Rebuild();
}

void PipelineExecutor::SetProgress(std::function<void(const std::string&, double)> progress, bool watched)
{
  this->Watch->Progress = std::move(progress);
  this->Watched = this->Watch->Progress && watched;
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      stage->SetWatched(this->Watched);
    }
  }
}

PipelineExecutor::Work PipelineExecutor::SaveWork() const
{
  Work work;
  for (std::size_t n = 0; n < this->Stages.size(); ++n)
  {
    std::string bytes = this->Live[n] && this->Stages[n] ? this->Stages[n]->SaveWork() : std::string();
    if (!bytes.empty())
    {
      work[this->Plan->Nodes[n].Path] = std::move(bytes);
    }
  }
  return work;
}

bool PipelineExecutor::LoadWork(const Work& work, std::string& error)
{
  for (const auto& w : work)
  {
    vtkQuellStage* stage = this->GetStage(w.first);
    if (!stage)
    {
      error = "no live node " + Quoted(OneLine(w.first));
      return false;
    }
    if (!stage->LoadWork(w.second, error))
    {
      error = "node " + Quoted(w.first) + ": " + error;
      return false;
    }
  }
  return true;
}

void PipelineExecutor::SetHistoryLength(int ticks)
{
  this->History = FrameHistory(ticks);
}

bool PipelineExecutor::SetProperty(
  const std::string& node, const std::string& name, const std::string& text, std::string& error)
{
  vtkQuellStage* stage = this->GetStage(node);
  if (!stage)
  {
    error = "no live node " + Quoted(node);
    return false;
  }
  return stage->SetPropertyText(name, text, error);
}

vtkQuellStage* PipelineExecutor::GetStage(const std::string& node) const
{
  const int n = this->Plan->Find(node);
  return n < 0 || !this->Live[std::size_t(n)] ? nullptr : this->Stages[std::size_t(n)].GetPointer();
}

vtkImageData* PipelineExecutor::GetImage(const std::string& node) const
{
  vtkQuellStage* stage = this->GetStage(node);
  return stage ? stage->GetOutput() : nullptr;
}

bool PipelineExecutor::Information(int node, Rect& whole, std::string& error)
{
  this->Watch->FirstError.clear();
  vtkQuellStage* stage = this->Stages[std::size_t(node)];
  stage->UpdateInformation();
  int e[6] = { 0, -1, 0, -1, 0, 0 };
  // The stage at fault is the first upstream one with an error.
  for (int n : this->Plan->Order)
  {
    const auto& s = this->Stages[std::size_t(n)];
    if (this->Live[std::size_t(n)] && s && !s->GetErrorText().empty() && !this->Watch->FirstError.empty())
    {
      error = this->Title(n) + ": " + s->GetErrorText();
      return false;
    }
  }
  stage->GetOutputInformation(0)->Get(vtkStreamingDemandDrivenPipeline::WHOLE_EXTENT(), e);
  whole = { e[0], e[2], e[1] + 1, e[3] + 1 };
  if (whole.empty())
  {
    error = this->Title(node) + ": the size of the frame is unknown";
    return false;
  }
  return true;
}

bool PipelineExecutor::FrameSize(const std::string& node, int& width, int& height, std::string& error)
{
  const int n = this->Plan->Find(node);
  if (n < 0 || !this->Live[std::size_t(n)])
  {
    error = "no live node " + Quoted(node);
    return false;
  }
  Rect whole;
  if (!this->Information(n, whole, error))
  {
    return false;
  }
  width = whole.width();
  height = whole.height();
  return true;
}

bool PipelineExecutor::CheckRegion(std::string& error)
{
  if (!this->Region)
  {
    return true;
  }
  for (const Target& t : this->Targets())
  {
    Rect whole;
    if (!this->Information(t.Node, whole, error))
    {
      return false;
    }
    const Rect region = this->Region->ToFrame(whole.height());
    if (region.empty() || !whole.contains(region))
    {
      error = "the region " + std::to_string(this->Region->X0) + "," + std::to_string(this->Region->Y0) + "," +
              std::to_string(this->Region->X1) + "," + std::to_string(this->Region->Y1) +
              " does not lie in the frame of " + std::to_string(whole.width()) + " x " +
              std::to_string(whole.height()) + " pixels";
      return false;
    }
  }
  return true;
}

std::map<std::string, std::string> PipelineExecutor::FrameMetadata(int node) const
{
  std::map<std::string, std::string> m{ { "node", this->Plan->Nodes[std::size_t(node)].Path } };
  if (this->BandRows > 0)
  {
    return m;
  }
  // Names of nodes and types need no quoting.
  std::string stages;
  for (int n : this->Plan->Order)
  {
    const auto& stage = this->Stages[std::size_t(n)];
    const auto before = this->Before.find(stage);
    if (!this->Live[std::size_t(n)] || !stage || before == this->Before.end())
    {
      continue;
    }
    const StageCounters &now = stage->GetCounters(), &then = before->second;
    if (now.Executions == then.Executions)
    {
      continue;
    }
    char text[192];
    std::snprintf(text, sizeof text, "\", \"ms\": %.3f, \"pixels\": %lld, \"rays\": %lld, \"nonFinite\": %lld}",
      1000 * (now.Seconds - then.Seconds), static_cast<long long>(now.Pixels - then.Pixels),
      static_cast<long long>(now.Rays - then.Rays), static_cast<long long>(now.NonFinite - then.NonFinite));
    const GraphNode& g = this->Plan->Nodes[std::size_t(n)];
    stages += (stages.empty() ? "[{\"node\": \"" : ",\n {\"node\": \"") + g.Path + "\", \"type\": \"" + g.Type + text;
  }
  if (!stages.empty())
  {
    m["stages"] = stages + "]";
  }
  return m;
}

bool PipelineExecutor::CanRunInBands(std::string& reason) const
{
  if (!this->Kept.empty())
  {
    reason = "the next frame reads " + this->Title(this->Kept.begin()->first) +
             " through a delayed input, which needs the whole frame";
    return false;
  }
  for (const Target& t : this->Targets())
  {
    const auto& stage = this->Stages[std::size_t(t.Node)];
    if (!stage || !stage->TakesBands())
    {
      reason = this->Title(t.Node) + " needs the whole frame";
      return false;
    }
  }
  return true;
}

/// What a pass asks of whom.
bool PipelineExecutor::Ask(TickMode mode, std::vector<Asked>& asked, std::string& error)
{
  // What a delayed input reads runs on the whole frame.
  for (const auto& k : this->Kept)
  {
    asked.push_back({ { k.first, k.second, true, false }, {} });
  }
  for (const Target& t : this->Targets())
  {
    if (mode == TickMode::WarmUp || (t.LastOnly && mode != TickMode::LastFrame))
    {
      continue;
    }
    Rect region;
    if (this->Region || this->BandRows > 0)
    {
      Rect whole;
      if (!this->Information(t.Node, whole, error))
      {
        return false;
      }
      region = this->Region ? this->Region->ToFrame(whole.height()).clipped(whole) : whole;
      if (region.empty())
      {
        error = this->Title(t.Node) + ": the region lies outside the frame";
        return false;
      }
    }
    asked.push_back({ t, region });
  }
  return true;
}

/// What a source says of a frame that was finished early; empty: nothing.
std::string PipelineExecutor::PartialText() const
{
  for (int n : this->Plan->Order)
  {
    vtkQuellStage* stage = this->Stages[std::size_t(n)];
    const std::string text = this->Live[std::size_t(n)] && stage
                               ? FrameFacts::Read(stage->GetOutput()->GetFieldData()).Partial
                               : std::string();
    if (!text.empty())
    {
      return text;
    }
  }
  return std::string();
}

/// Pass after pass, a band of every region at a time.
bool PipelineExecutor::RunBands(int tick, std::vector<Asked>& asked, TickResult& result)
{
  if (!this->CanRunInBands(result.Error))
  {
    return false;
  }
  int bands = 1;
  for (const Asked& a : asked)
  {
    bands = std::max(bands, (a.Region.height() + this->BandRows - 1) / this->BandRows);
    this->Stages[std::size_t(a.What.Node)]->BeginBands(a.Region);
  }
  bool good = true;
  std::map<int, std::string> counted;          // by node: of the last band, about all of them
  const std::size_t kept = KeepPixelMemory(0); // bands are for those who have little
  this->Watch->Bands = bands;
  for (int band = 0; band < bands && good; ++band)
  {
    this->Watch->Band = band;
    std::vector<Asked> now;
    for (const Asked& a : asked)
    {
      Asked part = a;
      part.Region.y1 = a.Region.y1 - band * this->BandRows;
      part.Region.y0 = std::max(a.Region.y0, part.Region.y1 - this->BandRows);
      if (!part.Region.empty())
      {
        now.push_back(part);
      }
    }
    good = this->Pass(tick, now, result);
    for (std::size_t n = 0; n < this->Stages.size(); ++n)
    {
      const std::string text = this->Live[n] && this->Stages[n] ? this->Stages[n]->GetCountedWarning() : std::string();
      if (!text.empty())
      {
        counted[int(n)] = this->Title(int(n)) + ": " + text;
        result.Warnings.erase(
          std::remove(result.Warnings.begin(), result.Warnings.end(), counted[int(n)]), result.Warnings.end());
      }
    }
    // Bands of different numbers of samples make no frame.
    if (good && this->Token->IsFinishing() && (band + 1 < bands || !this->PartialText().empty()))
    {
      result.Cancelled = true;
      result.Error = "cancelled";
      good = false;
    }
  }
  this->Watch->Band = 0;
  this->Watch->Bands = 1;
  KeepPixelMemory(kept);
  for (const Asked& a : asked)
  {
    vtkQuellStage* stage = this->Stages[std::size_t(a.What.Node)];
    try
    {
      if (good)
      {
        stage->EndBands();
        const std::vector<std::string> files = stage->GetFilesWritten();
        result.Files.insert(result.Files.end(), files.begin(), files.end());
        for (const std::string& w : stage->GetWarnings())
        {
          result.Warnings.push_back(this->Title(a.What.Node) + ": " + w);
        }
      }
    }
    catch (const StageError& e)
    {
      result.Error = this->Title(a.What.Node) + ": " + e.what();
      good = false;
    }
    if (!good)
    {
      stage->DropBands();
    }
  }
  for (const auto& c : counted)
  {
    result.Warnings.push_back(c.second);
  }
  // Bands tend to say the same.
  std::vector<std::string> once;
  for (std::string& w : result.Warnings)
  {
    if (std::find(once.begin(), once.end(), w) == once.end())
    {
      once.push_back(std::move(w));
    }
  }
  result.Warnings = std::move(once);
  return good;
}

/// Updates everything asked in one pass. False with result.Error, and Cancelled.
bool PipelineExecutor::Pass(int tick, const std::vector<Asked>& asked, TickResult& result)
{
  std::map<vtkQuellStage*, std::int64_t> executions;
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      executions[stage] = stage->GetCounters().Executions;
    }
  }
  this->Collector->ClearRequests();
  for (const Asked& a : asked)
  {
    this->Collector->AddRequest(this->Stages[std::size_t(a.What.Node)], a.What.Arrays, a.Region);
  }
  this->Watch->FirstFailed = nullptr;
  this->Watch->Token = this->Token;
  const bool ok = this->Collector->UpdateTick(tick);
  this->Watch->Token = nullptr;
  vtkQuellStage* const failed = this->Watch->FirstFailed;
  if (failed)
  {
    this->Token->ResetCancel();
  }
  // Neither does a connection to us keep a stage from being thrown away, nor does one from an earlier pass linger.
  this->Collector->ClearRequests();

  for (int n : this->Plan->Order)
  {
    vtkQuellStage* stage = this->Stages[std::size_t(n)];
    if (this->Live[std::size_t(n)] && stage && stage->GetCounters().Executions != executions[stage])
    {
      for (const std::string& w : stage->GetWarnings())
      {
        result.Warnings.push_back(this->Title(n) + ": " + w);
      }
      if (ok)
      {
        const std::vector<std::string> files = stage->GetFilesWritten();
        result.Files.insert(result.Files.end(), files.begin(), files.end());
      }
    }
  }
  for (const std::string& w : this->Watch->Warnings)
  {
    result.Warnings.push_back(w.substr(0, w.find_last_not_of(" \n\r\t") + 1));
  }
  if (!ok || this->Token->IsCancelled())
  {
    result.Cancelled = this->Token->IsCancelled();
    result.Error = this->Watch->FirstError.empty() ? "the update failed" : this->Watch->FirstError;
    for (std::size_t n = 0; failed && n < this->Stages.size(); ++n)
    {
      if (this->Stages[n] == failed)
      {
        result.Error = this->Title(int(n)) + ": " + this->Watch->FailedText;
      }
    }
    if (result.Cancelled)
    {
      result.Error = "cancelled";
    }
    return false;
  }
  return true;
}

TickResult PipelineExecutor::RunTick(int tick, TickMode mode)
{
  const std::string noMemory = "there is not enough memory", noWords = "the update failed";
  TickResult result;
  try
  {
    result = this->TryTick(tick, mode);
    const auto endsWith = [&](const std::string& end)
    {
      return result.Error.size() >= end.size() &&
             result.Error.compare(result.Error.size() - end.size(), end.size(), end) == 0;
    };
    if (result.Ok || result.Cancelled || (!endsWith(noMemory) && !endsWith(noWords)))
    {
      return result;
    }
    if (endsWith(noWords))
    {
      result.Error += " without a word, as VTK's do when there is not enough memory";
    }
  }
  catch (const std::bad_alloc&)
  {
    result = TickResult();
    result.Error = noMemory;
  }
  this->StartOver();
  return result;
}

/// VTK's connections and field data do not survive a failed allocation, not even their destruction: all stages are made
/// anew, the old ones left where they are. The history stays.
void PipelineExecutor::StartOver()
{
  if (this->Watch->FirstFailed)
  {
    this->Token->ResetCancel();
  }
  this->Watch->FirstFailed = nullptr;
  this->Watch->Token = nullptr;
  this->Watch->Band = 0;
  this->Watch->Bands = 1;
  this->Watch->Names.clear();
  this->Collector->RemoveObserver(this->Watch->Command);
  this->Collector->GetExecutive()->RemoveObserver(this->Watch->Command);
  this->Collector->Register(nullptr);
  for (auto& stage : this->Stages)
  {
    if (stage)
    {
      stage->SetMetadataSource({});
      stage->RemoveObserver(this->Watch->Command);
      stage->GetExecutive()->RemoveObserver(this->Watch->Command);
      stage->DropBands();
      stage->Register(nullptr);
      stage = nullptr;
    }
  }
  this->Before.clear();
  this->Collector = vtkSmartPointer<vtkQuellCollector>::New();
  this->Watch->Add(this->Collector, "");
  this->Watch->Names.erase(this->Collector);
  this->Stale = true;
}

TickResult PipelineExecutor::TryTick(int tick, TickMode mode)
{
  TickResult result;
  this->Rebuild();
  this->Watch->FirstError.clear();
  this->Watch->Warnings.clear();
  if (this->Token->IsCancelled())
  {
    result.Cancelled = true;
    result.Error = "cancelled";
    return result;
  }

  for (std::size_t n = 0; n < this->Plan->Nodes.size(); ++n)
  {
    if (!this->Live[n])
    {
      continue;
    }
    for (const GraphEdge& e : this->Plan->Nodes[n].Inputs)
    {
      if (e.Delayed)
      {
        this->Stages[n]->SetHistory(
          e.Port, this->History.Find(tick - 1, this->Plan->Nodes[std::size_t(e.Producer)].Path));
      }
    }
  }

  this->Before.clear();
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      this->Before[stage] = stage->GetCounters();
    }
  }
  std::vector<Asked> asked;
  if (!this->Ask(mode, asked, result.Error))
  {
    return result;
  }
  if (!(this->BandRows > 0 && mode != TickMode::WarmUp ? this->RunBands(tick, asked, result)
                                                       : this->Pass(tick, asked, result)))
  {
    return result;
  }

  result.Partial = this->PartialText();
  result.Ok = true;
  if (!result.Partial.empty())
  {
    return result;
  }

  FrameHistory::Frame frame;
  for (const auto& k : this->Kept)
  {
    const std::string& path = this->Plan->Nodes[std::size_t(k.first)].Path;
    frame[path] =
      FrameHistory::Keep(this->Stages[std::size_t(k.first)]->GetOutput(), k.second, this->History.Find(tick, path));
  }
  if (!frame.empty())
  {
    this->History.Commit(tick, std::move(frame));
  }
  return result;
}

void PipelineExecutor::TakeStages(PipelineExecutor& from)
{
  // A stage keeps its connections where producer, array, port and attributes are the same.
  const auto same = [](const Graph& a, const GraphNode& x, const Graph& b, const GraphNode& y)
  {
    if (x.Type != y.Type || x.Inputs.size() != y.Inputs.size())
    {
      return false;
    }
    for (std::size_t i = 0; i < x.Inputs.size(); ++i)
    {
      const GraphEdge &e = x.Inputs[i], &f = y.Inputs[i];
      if (e.Port != f.Port || e.Connection != f.Connection || e.Array != f.Array || e.Delayed != f.Delayed ||
          e.Attributes != f.Attributes ||
          a.Nodes[std::size_t(e.Producer)].Path != b.Nodes[std::size_t(f.Producer)].Path)
      {
        return false;
      }
    }
    return true;
  };
  for (std::size_t n = 0; n < this->Plan->Nodes.size(); ++n)
  {
    const GraphNode& node = this->Plan->Nodes[n];
    const int old = from.Plan->Find(node.Path);
    if (old < 0 || !from.Stages[std::size_t(old)] ||
        !same(*this->Plan, node, *from.Plan, from.Plan->Nodes[std::size_t(old)]))
    {
      continue;
    }
    vtkSmartPointer<vtkQuellStage> stage;
    std::swap(stage, from.Stages[std::size_t(old)]);
    stage->RemoveObserver(from.Watch->Command);
    stage->GetExecutive()->RemoveObserver(from.Watch->Command);
    from.Watch->Names.erase(stage);
    for (const GraphProperty& p : from.Plan->Nodes[std::size_t(old)].Properties)
    {
      const auto named = [&p](const GraphProperty& q) { return q.Name == p.Name; };
      const Property* row = node.Description().FindProperty(p.Name);
      std::string error;
      if (row && std::none_of(node.Properties.begin(), node.Properties.end(), named))
      {
        stage->SetPropertyText(p.Name, row->DefaultText, error);
      }
    }
    for (const GraphProperty& p : node.Properties)
    {
      std::string error;
      stage->SetPropertyText(p.Name, p.Text, error);
    }
    stage->SetTimeline(this->Plan->Ticks);
    stage->SetCancelToken(this->Token);
    stage->SetWatched(this->Watched);
    stage->SetMetadata(this->Metadata);
    stage->SetMetadataSource([this, n] { return this->FrameMetadata(int(n)); });
    if (this->Stages[n])
    {
      this->Watch->Names.erase(this->Stages[n]);
    }
    this->Watch->Add(stage, node.Path);
    this->Stages[n] = stage;
  }
  // Whoever read another object now is connected anew.
  for (std::size_t n = 0; n < this->Plan->Nodes.size(); ++n)
  {
    vtkQuellStage* stage = this->Stages[n];
    if (!stage)
    {
      continue;
    }
    for (const GraphEdge& e : this->Plan->Nodes[n].Inputs)
    {
      if (!e.Delayed && stage->GetNumberOfInputConnections(e.Port) > e.Connection &&
          stage->GetInputAlgorithm(e.Port, e.Connection) != this->Stages[std::size_t(e.Producer)])
      {
        stage->SetInputConnection(e.Port, nullptr);
      }
    }
  }
  this->History = std::move(from.History);
  this->Stale = true;
  this->Rebuild();
}

std::vector<NodeCounters> PipelineExecutor::Counters() const
{
  std::vector<NodeCounters> all;
  for (int n : this->Plan->Order)
  {
    if (this->Live[std::size_t(n)] && this->Stages[std::size_t(n)])
    {
      const GraphNode& node = this->Plan->Nodes[std::size_t(n)];
      all.push_back({ node.Path, node.Type, this->Stages[std::size_t(n)]->GetCounters() });
    }
  }
  return all;
}

void PipelineExecutor::ResetCounters()
{
  for (const auto& stage : this->Stages)
  {
    if (stage)
    {
      stage->ResetCounters();
    }
  }
}

std::vector<std::string> PipelineExecutor::Reports() const
{
  std::vector<std::string> lines;
  for (int n : this->Plan->Order)
  {
    if (this->Live[std::size_t(n)] && this->Stages[std::size_t(n)])
    {
      const std::string line = this->Stages[std::size_t(n)]->GetReport();
      if (!line.empty())
      {
        // A sink speaks of its label; of the others there may be several of a kind.
        const GraphNode& node = this->Plan->Nodes[std::size_t(n)];
        lines.push_back(node.Description().Sink ? line : node.Path + ": " + line);
      }
    }
  }
  return lines;
}
}
