// SPDX-License-Identifier: BSD-3-Clause
#include "quellRenderSession.h"

#include "quellExplain.h"
#include "vtkDataArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"
#include "vtkQuellPathTraceSource.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>

namespace quell
{
namespace
{
using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

bool SameOptions(const GraphOptions& a, const GraphOptions& b)
{
  return a.Defines == b.Defines && a.Properties == b.Properties && a.Outputs == b.Outputs && a.Seed == b.Seed &&
         a.OutputDirectory == b.OutputDirectory && a.Outside == b.Outside;
}

/// What is wrong with a pipeline, for somebody who looks at it: here every node runs that is shown, so one line says
/// that a run would have nothing to write.
std::vector<Diagnostic> ForViewer(const PipelineDocument& document, const std::vector<Diagnostic>& all)
{
  std::vector<Diagnostic> messages;
  bool idle = false;
  for (Diagnostic d : all)
  {
    if (d.What == "feeds no output and will not run")
    {
      if (document.Outputs.empty())
      {
        idle = true;
        continue;
      }
      d.What = "feeds no output: quell run leaves it out";
    }
    messages.push_back(d);
  }
  if (idle)
  {
    Diagnostic d;
    d.Level = Severity::Warning;
    d.What = "no output: quell run has nothing to write";
    d.Hint = "+ Node, output adds one";
    messages.push_back(d);
  }
  return messages;
}

/// What a wish changes beside the ways to get there.
bool SamePicture(const ViewWish& a, const ViewWish& b)
{
  return a.Document == b.Document && SameOptions(a.Options, b.Options) && a.Tick == b.Tick && a.Targets == b.Targets &&
         a.AllArrays == b.AllArrays && a.CameraSerial == b.CameraSerial && a.Refine == b.Refine &&
         bool(a.Camera) == bool(b.Camera);
}

bool SameView(const ViewWish& a, const ViewWish& b)
{
  return SamePicture(a, b) && a.Paused == b.Paused && a.Play == b.Play;
}
}

std::string TopOf(const std::string& path)
{
  return path.substr(0, path.find('/'));
}

std::string NodeOfReference(const std::string& from, std::string* array)
{
  const std::size_t colon = from.rfind(':');
  if (array)
  {
    *array = colon == std::string::npos ? std::string() : from.substr(colon + 1);
  }
  return from.empty() || from[0] == '@' ? std::string() : from.substr(0, colon);
}

std::shared_ptr<PipelineDocument> PrunedTo(const PipelineDocument& document, const std::vector<std::string>& nodes)
{
  auto pruned = std::make_shared<PipelineDocument>(document);
  std::set<std::string> needed;
  std::vector<std::string> open;
  for (const std::string& n : nodes)
  {
    open.push_back(TopOf(n));
  }
  while (!open.empty())
  {
    const std::string id = open.back();
    open.pop_back();
    if (!needed.insert(id).second)
    {
      continue;
    }
    for (const PipelineNode& n : document.Nodes)
    {
      if (n.Id.Value == id)
      {
        for (const PipelineInput& i : n.Inputs)
        {
          open.push_back(TopOf(NodeOfReference(i.From.Value)));
        }
      }
    }
  }
  const auto unneeded = [&needed](const PipelineNode& n)
  { return !needed.count(n.Id.Value) && n.Id.Value.find("$(") == std::string::npos; };
  pruned->Nodes.erase(std::remove_if(pruned->Nodes.begin(), pruned->Nodes.end(), unneeded), pruned->Nodes.end());
  pruned->Outputs.clear();
  return pruned;
}

vtkImageData* ViewFrame::Image(const std::string& node) const
{
  const auto found = this->Images.find(node);
  return found == this->Images.end() ? nullptr : found->second.GetPointer();
}

struct RenderSession::Internals
{
  explicit Internals(const StageRegistry& registry)
    : Registry(registry)
    , Token(std::make_shared<CancelToken>())
  {
  }

  const StageRegistry& Registry;
  std::shared_ptr<CancelToken> Token;

  mutable std::mutex Mutex;
  mutable std::condition_variable Changed;
  bool Quit = false, Stopped = false;
  ViewWish Wanted;
  std::uint64_t Serial = 0, DoneSerial = 0, Serving = 0;
  std::shared_ptr<const ViewFrame> Frame;
  std::shared_ptr<const ViewCheck> Check;
  std::string WeighNode;
  int WeighX = 0, WeighY = 0;
  std::shared_ptr<const ViewWeights> Weighed;
  ViewProgress State;
  Clock::time_point Began;
  std::function<void()> Notify;
  std::thread Thread;

  // Below: the thread's own.
  std::unique_ptr<PipelineExecutor> Executor;
  std::shared_ptr<Graph> Pipeline;
  std::shared_ptr<const PipelineDocument> BuiltOf;
  GraphOptions BuiltOptions;
  std::vector<std::string> BuiltFor; ///< nodes, where the graph is pruned
  bool Pruned = false;
  std::map<std::string, std::vector<OutputArray>> Arrays;
  std::uint64_t Number = 0;
  std::string BuildError;
  int LastTick = 0; ///< that a frame was made of
  int LiveTick = 0, LiveTicks = 0, LiveBase = 0, LiveSerial = -1;
  bool Live = false;
  std::optional<Mat4> LivePose;
  struct SampledSource
  {
    std::string Path;
    int Samples = 1, First = 0;
  };
  /// Sources that have all samples of a tick: asked again they have nothing to do, or only further arrays.
  std::map<std::string, std::pair<int, vtkMTimeType>> Complete;

  bool IsComplete(const std::vector<SampledSource>& sources, int tick) const
  {
    return std::all_of(sources.begin(), sources.end(),
      [&](const SampledSource& s)
      {
        const auto at = this->Complete.find(s.Path);
        vtkQuellStage* stage = this->Executor->GetStage(s.Path);
        return stage && at != this->Complete.end() && at->second.first == tick &&
               at->second.second == stage->GetMTime();
      });
  }

  /// With the mutex held: weights are asked for that are not those there are.
  bool WantsWeights() const
  {
    if (this->WeighNode.empty() || !this->Frame || !this->Frame->Ok)
    {
      return false;
    }
    const ViewWeights* w = this->Weighed.get();
    return !w || w->Frame != this->Frame->Number || w->Node != this->WeighNode || w->X != this->WeighX ||
           w->Y != this->WeighY;
  }

  void ServeWeights()
  {
    auto w = std::make_shared<ViewWeights>();
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      if (!this->WantsWeights())
      {
        return;
      }
      w->Frame = this->Frame->Number;
      w->Node = this->WeighNode;
      w->X = this->WeighX;
      w->Y = this->WeighY;
    }
    vtkQuellStage* stage = this->Executor ? this->Executor->GetStage(w->Node) : nullptr;
    if (!stage)
    {
      w->Error = "there is no node " + Quoted(w->Node);
    }
    else if (!stage->CanWeigh())
    {
      w->Error = w->Node + " is no filter that weighs pixels";
    }
    else
    {
      // What was shown since may have replaced what its inputs held: then it runs once more, to the same end.
      if (!stage->WeighPixel(w->X, w->Y, w->Weights, w->Error) && w->Error.find(" has no array ") != std::string::npos)
      {
        stage->Modified();
        if (this->Executor->RunTick(this->LastTick, TickMode::Frame).Ok)
        {
          w->Error.clear();
          stage->WeighPixel(w->X, w->Y, w->Weights, w->Error);
        }
      }
    }
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Weighed = w;
    }
    this->Wake();
  }

  bool Superseded(std::uint64_t serial) const
  {
    std::lock_guard<std::mutex> lock(this->Mutex);
    return this->Quit || this->Stopped || this->Serial != serial;
  }

  void Wake() const
  {
    this->Changed.notify_all();
    std::function<void()> notify;
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      notify = this->Notify;
    }
    if (notify)
    {
      notify();
    }
  }

  void SetPhase(const std::string& phase)
  {
    std::lock_guard<std::mutex> lock(this->Mutex);
    this->State.Phase = phase;
    this->State.Done.clear();
    this->State.Node.clear();
    this->State.Fraction = 0;
  }

  /// Makes graph and executor where document, options or (while parts have mistakes) targets changed.
  bool Build(const ViewWish& wish)
  {
    std::vector<std::string> targets;
    for (const ViewTarget& t : wish.Targets)
    {
      targets.push_back(t.Node);
    }
    const bool sameText = this->BuiltOf == wish.Document && SameOptions(this->BuiltOptions, wish.Options);
    if (sameText && (this->Pipeline || !this->BuildError.empty()) && (!this->Pruned || targets == this->BuiltFor))
    {
      return this->Pipeline != nullptr;
    }
    Diagnostics messages;
    std::shared_ptr<Graph> graph;
    try
    {
      graph = BuildGraph(wish.Document, this->Registry, wish.Options, messages);
    }
    catch (const std::exception& e)
    {
      messages.Error({}, {}, e.what());
    }
    messages.Sort();
    bool pruned = false;
    if (messages.HasErrors())
    {
      Diagnostics rest;
      GraphOptions options = wish.Options;
      options.Outputs.clear();
      graph = BuildGraph(PrunedTo(*wish.Document, targets), this->Registry, options, rest);
      pruned = true;
      if (rest.HasErrors())
      {
        graph = nullptr;
      }
    }
    auto check = std::make_shared<ViewCheck>();
    check->Document = wish.Document;
    check->Messages = ForViewer(*wish.Document, messages.All());
    check->Errors = messages.ErrorCount();
    if (graph)
    {
      check->Ticks = graph->Ticks;
    }
    this->BuiltOf = wish.Document;
    this->BuiltOptions = wish.Options;
    this->BuiltFor = targets;
    this->Pruned = pruned;
    this->Arrays.clear();
    this->BuildError.clear();
    if (graph)
    {
      auto executor = std::make_unique<PipelineExecutor>(graph, this->Registry);
      executor->SetWriteOutputs(false);
      executor->SetCancelToken(this->Token);
      executor->SetProgress(
        [this](const std::string& node, double fraction)
        {
          std::lock_guard<std::mutex> lock(this->Mutex);
          this->State.Node = node;
          this->State.Fraction = fraction;
          this->State.Done[node] = fraction;
        },
        false);
      if (this->Executor)
      {
        executor->TakeStages(*this->Executor);
      }
      this->Executor = std::move(executor);
      for (std::size_t n = 0; n < graph->Nodes.size(); ++n)
      {
        this->Arrays[graph->Nodes[n].Path] = graph->Arrays(int(n));
      }
    }
    else
    {
      this->BuildError = "the pipeline cannot run";
      for (const Diagnostic& d : messages.All())
      {
        if (d.Level == Severity::Error)
        {
          this->BuildError = (d.Where.empty() ? std::string() : d.Where + ": ") + d.What;
          break;
        }
      }
    }
    this->Pipeline = graph;
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Check = check;
    }
    this->Wake();
    return graph != nullptr;
  }

  /// The node that really makes what is shown: an instance's name stands for its first output's node.
  bool Request(const ViewWish& wish, std::string& error)
  {
    std::map<std::string, ArraySet> asked;
    for (std::size_t i = 0; i < wish.Targets.size(); ++i)
    {
      const ViewTarget& t = wish.Targets[i];
      const auto known = this->Arrays.find(t.Node);
      if (known == this->Arrays.end())
      {
        error = t.Node.empty() ? std::string("nothing is chosen") : "there is no node " + Quoted(t.Node);
        return false;
      }
      const std::string array = !t.Array.empty()         ? t.Array
                                : !known->second.empty() ? known->second.front().Name
                                                         : std::string();
      const auto named = [&array](const OutputArray& a) { return a.Name == array; };
      if (std::none_of(known->second.begin(), known->second.end(), named))
      {
        error = "node " + Quoted(t.Node) + " has no array " + Quoted(array);
        return false;
      }
      asked[t.Node].insert(array);
      if (wish.AllArrays && i == 0)
      {
        for (const OutputArray& a : known->second)
        {
          if (a.Name.compare(0, 6, "bounce") != 0)
          {
            asked[t.Node].insert(a.Name);
          }
        }
      }
    }
    for (const GraphNode& n : this->Pipeline->Nodes)
    {
      const auto a = asked.find(n.Path);
      this->Executor->Request(n.Path, a == asked.end() ? ArraySet() : a->second);
    }
    if (!this->Executor->HasTargets())
    {
      error = "nothing is chosen";
      return false;
    }
    return true;
  }

  /// History of another size, or without an array that is read now, would fail every frame.
  void DropWrongHistory(int tick)
  {
    const Graph& graph = *this->Pipeline;
    for (const auto& k : this->Executor->KeptArrays())
    {
      const std::string& path = graph.Nodes[std::size_t(k.first)].Path;
      vtkImageData* image = this->Executor->GetHistory().Find(tick - 1, path);
      int w = 0, h = 0;
      std::string error;
      bool good = true;
      if (image)
      {
        const int* size = image->GetDimensions();
        good = this->Executor->FrameSize(path, w, h, error) && size[0] == w && size[1] == h;
        for (const std::string& array : k.second)
        {
          const bool first = array.empty() && image->GetPointData()->GetNumberOfArrays() > 0;
          good = good && (first || image->GetPointData()->GetArray(array.c_str()));
        }
      }
      else
      {
        good = this->Executor->GetHistory().FindFrame(tick - 1) == nullptr;
      }
      if (!good)
      {
        this->Executor->ClearHistory();
        return;
      }
    }
  }

  std::vector<SampledSource> Sources() const
  {
    std::vector<SampledSource> sources;
    for (const NodeCounters& c : this->Executor->Counters())
    {
      vtkQuellStage* stage = this->Executor->GetStage(c.Path);
      if (stage && stage->GetDescription().FindProperty("SamplesPerPixel") &&
          stage->GetDescription().FindProperty("FirstSample"))
      {
        const auto number = [&](const char* name)
        {
          long long v = 0;
          std::string error;
          detail::ParseInt(stage->GetPropertyText(name), 0, 1LL << 40, v, error);
          return int(v);
        };
        // The graph's own values: the stage may stand at another number from before.
        SampledSource s;
        s.Path = c.Path;
        const GraphNode& node = this->Pipeline->Nodes[std::size_t(this->Pipeline->Find(c.Path))];
        const auto text = [&](const char* name, int fallback)
        {
          for (const GraphProperty& p : node.Properties)
          {
            long long v = 0;
            std::string error;
            if (p.Name == name && detail::ParseInt(p.Text, 0, 1LL << 40, v, error))
            {
              fallback = int(v);
            }
          }
          return fallback;
        };
        (void)number;
        s.Samples = text("SamplesPerPixel", 1);
        s.First = text("FirstSample", 0);
        sources.push_back(s);
      }
    }
    return sources;
  }

  /// Sample numbers of a tick begin at tick * SamplesPerPixel + FirstSample: fewer samples of the same sequence begin
  /// where all of them do.
  void SetSamples(const std::vector<SampledSource>& sources, int tick, int samples)
  {
    for (const SampledSource& s : sources)
    {
      const int now = samples <= 0 ? s.Samples : samples;
      const long long first = s.First + (long long)(tick) * (s.Samples - now);
      std::string error;
      this->Executor->SetProperty(s.Path, "SamplesPerPixel", std::to_string(now), error);
      this->Executor->SetProperty(
        s.Path, "FirstSample", std::to_string(std::max(0LL, std::min(1LL << 30, first))), error);
    }
  }

  void SetPose(const ViewWish& wish, const std::vector<SampledSource>& sources)
  {
    for (const SampledSource& s : sources)
    {
      auto* source = vtkQuellPathTraceSource::SafeDownCast(this->Executor->GetStage(s.Path));
      if (!source)
      {
        continue;
      }
      if (!this->Live)
      {
        source->ClearViewpoint();
        continue;
      }
      vtkQuellPathTraceSource::Viewpoint v;
      v.Camera = *wish.Camera;
      v.Before = this->LivePose ? *this->LivePose : *wish.Camera;
      v.Tick = this->LiveBase;
      v.FromScene = !this->LivePose;
      source->SetViewpoint(v);
    }
  }

  std::shared_ptr<ViewFrame> Blank(const ViewWish& wish, std::uint64_t serial)
  {
    auto f = std::make_shared<ViewFrame>();
    f->Serial = serial;
    f->Number = ++this->Number;
    f->Document = wish.Document;
    f->Pipeline = this->Pipeline;
    f->Pruned = this->Pruned;
    f->Tick = wish.Tick;
    f->Arrays = this->Arrays;
    return f;
  }

  void Publish(std::shared_ptr<ViewFrame> frame)
  {
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Frame = std::move(frame);
    }
    this->Wake();
  }

  enum class Outcome
  {
    Done,
    Failed,
    GivenUp
  };

  /// One frame with a number of samples (0: the pipeline's).
  Outcome RunOnce(const ViewWish& wish, std::uint64_t serial, int tick, const std::vector<SampledSource>& sources,
    int samples, bool final)
  {
    this->SetSamples(sources, tick, samples);
    this->SetPose(wish, sources);
    std::map<std::string, StageCounters> before;
    for (const NodeCounters& c : this->Executor->Counters())
    {
      before[c.Path] = c.Counters;
    }
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Began = Clock::now();
    }
    const Clock::time_point start = Clock::now();
    this->LastTick = tick;
    const TickResult result = this->Executor->RunTick(tick, TickMode::Frame);
    if (result.Cancelled)
    {
      return Outcome::GivenUp;
    }
    std::shared_ptr<ViewFrame> f = this->Blank(wish, serial);
    f->Seconds = SecondsSince(start);
    f->Tick = this->Live ? this->LiveBase : tick;
    f->LiveTicks = this->LiveTicks;
    f->Ok = result.Ok;
    f->Error = result.Error;
    f->Warnings = result.Warnings;
    f->Reports = this->Executor->Reports();
    f->Final = final;
    if (!sources.empty())
    {
      f->SamplesAsked = sources.front().Samples;
      f->Samples = samples > 0 ? samples : f->SamplesAsked;
    }
    for (const NodeCounters& c : this->Executor->Counters())
    {
      ViewFrame::Node n{ c.Path, c.Type, c.Counters, 0, false };
      const vtkQuellStage* stage = this->Executor->GetStage(c.Path);
      n.Weighs = stage && stage->CanWeigh();
      const StageCounters& b = before[c.Path];
      n.Counters.Executions -= b.Executions;
      n.Counters.Pixels -= b.Pixels;
      n.Counters.Bytes -= b.Bytes;
      n.Counters.Rays -= b.Rays;
      n.Counters.Paths -= b.Paths;
      n.Counters.Taps -= b.Taps;
      n.Counters.NonFinite -= b.NonFinite;
      n.Counters.Seconds -= b.Seconds;
      if (vtkImageData* image = this->Executor->GetImage(c.Path))
      {
        for (int a = 0; a < image->GetPointData()->GetNumberOfArrays(); ++a)
        {
          vtkDataArray* array = image->GetPointData()->GetArray(a);
          n.Bytes += array ? double(array->GetNumberOfValues()) * array->GetDataTypeSize() : 0.;
        }
      }
      f->Nodes.push_back(n);
    }
    if (result.Ok && samples <= 0)
    {
      for (const SampledSource& source : sources)
      {
        this->Complete[source.Path] = { tick, this->Executor->GetStage(source.Path)->GetMTime() };
      }
    }
    if (result.Ok)
    {
      for (const ViewTarget& t : wish.Targets)
      {
        if (vtkImageData* image = this->Executor->GetImage(t.Node))
        {
          vtkSmartPointer<vtkImageData>& copy = f->Images[t.Node];
          if (!copy)
          {
            copy = vtkSmartPointer<vtkImageData>::New();
            copy->ShallowCopy(image);
          }
        }
      }
    }
    this->Publish(f);
    return result.Ok ? Outcome::Done : Outcome::Failed;
  }

  /// Frames before `tick` that its history needs.
  Outcome WarmUp(const ViewWish& wish, std::uint64_t serial, int tick, const std::vector<SampledSource>& sources)
  {
    this->DropWrongHistory(tick);
    if (!this->Executor->HasDelays() || wish.History == HistoryMode::None ||
        this->Executor->GetHistory().FindFrame(tick - 1))
    {
      return Outcome::Done;
    }
    const int first = this->Pipeline->Ticks.First;
    int from =
      std::max(first, wish.History == HistoryMode::Exact ? first : tick - PlanHistory(*this->Executor, tick).Frames);
    // Go on from the newest frame there is on the way.
    for (int t = tick - 2; t >= from; --t)
    {
      if (this->Executor->GetHistory().FindFrame(t))
      {
        from = t + 1;
        break;
      }
    }
    this->SetSamples(sources, tick, 0);
    for (int t = from; t < tick; ++t)
    {
      this->SetPhase("history: frame " + std::to_string(t) + " of " + std::to_string(tick));
      const TickResult result = this->Executor->RunTick(t, TickMode::WarmUp);
      if (result.Cancelled || this->Superseded(serial))
      {
        return Outcome::GivenUp;
      }
      if (!result.Ok)
      {
        std::shared_ptr<ViewFrame> f = this->Blank(wish, serial);
        f->Error = result.Error;
        this->Publish(f);
        return Outcome::Failed;
      }
    }
    return Outcome::Done;
  }

  /// Everything that a wish asks, until it is done or replaced.
  void Serve(ViewWish wish, std::uint64_t serial)
  {
    if (!wish.Document || wish.Paused)
    {
      return;
    }
    if (!this->Build(wish))
    {
      std::shared_ptr<ViewFrame> f = this->Blank(wish, serial);
      f->Error = this->BuildError;
      this->Publish(f);
      return;
    }
    std::string error;
    if (!this->Request(wish, error))
    {
      std::shared_ptr<ViewFrame> f = this->Blank(wish, serial);
      f->Error = wish.Targets.empty() ? std::string() : error;
      this->Publish(f);
      return;
    }
    const std::vector<SampledSource> sources = this->Sources();
    if (wish.Camera && !sources.empty())
    {
      if (!this->Live)
      {
        this->Live = true;
        this->LiveTicks = 0;
        this->LiveBase = wish.Tick;
        this->LiveTick = wish.Tick;
        this->LivePose.reset();
        this->LiveSerial = -1;
      }
      if (this->LiveSerial != wish.CameraSerial)
      {
        ++this->LiveTick;
        ++this->LiveTicks;
      }
      const Outcome outcome = this->RunOnce(wish, serial, this->LiveTick, sources, 0, true);
      if (outcome == Outcome::Done)
      {
        this->LiveSerial = wish.CameraSerial;
        this->LivePose = wish.Camera;
      }
      else if (outcome == Outcome::GivenUp && this->LiveSerial != wish.CameraSerial)
      {
        --this->LiveTick;
        --this->LiveTicks;
      }
      return;
    }
    if (this->Live)
    {
      this->Live = false;
      this->LivePose.reset();
      this->Executor->ClearHistory();
    }

    const int first = this->Pipeline->Ticks.First, count = std::max(1, this->Pipeline->Ticks.Count);
    int tick = std::min(first + count - 1, std::max(first, wish.Tick));
    for (;;)
    {
      const Clock::time_point start = Clock::now();
      if (this->WarmUp(wish, serial, tick, sources) != Outcome::Done)
      {
        return;
      }
      this->DropWrongHistory(tick);
      // On the way to many samples: 1, 4, 16 ... of the same sequence.
      const int target = sources.empty() ? 0 : sources.front().Samples;
      const bool alike =
        std::all_of(sources.begin(), sources.end(), [&](const SampledSource& s) { return s.Samples == target; });
      this->SetSamples(sources, tick, 0);
      this->SetPose(wish, sources);
      if (wish.Progressive && !wish.Play && alike && !this->IsComplete(sources, tick))
      {
        for (int n = 1; 2 * n <= target; n *= 4)
        {
          this->SetPhase(std::to_string(n) + " of " + std::to_string(target) + " samples");
          if (this->RunOnce(wish, serial, tick, sources, n, false) != Outcome::Done || this->Superseded(serial))
          {
            return;
          }
          if (SecondsSince(start) < 0.02 && n >= 4)
          {
            break; // the whole is as quick
          }
        }
      }
      this->SetPhase("");
      if (this->RunOnce(wish, serial, tick, sources, 0, !wish.Refine) != Outcome::Done)
      {
        return;
      }
      if (!wish.Play)
      {
        break;
      }
      if (tick + 1 < first + count)
      {
        ++tick;
      }
      else if (wish.Loop)
      {
        tick = first;
      }
      else
      {
        return;
      }
      if (wish.PlayRate > 0)
      {
        std::unique_lock<std::mutex> lock(this->Mutex);
        const auto due =
          start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / wish.PlayRate));
        this->Changed.wait_until(lock, due, [&] { return this->Quit || this->Stopped || this->Serial != serial; });
      }
      if (this->Superseded(serial))
      {
        return;
      }
    }
    if (wish.Refine && !sources.empty())
    {
      for (long long n = 2LL * sources.front().Samples; n <= 4096; n *= 2)
      {
        if (this->Superseded(serial))
        {
          return;
        }
        this->SetPhase("refining to " + std::to_string(n) + " samples");
        if (this->RunOnce(wish, serial, tick, sources, int(n), 2 * n > 4096) != Outcome::Done)
        {
          return;
        }
      }
    }
  }

  void Loop()
  {
    for (;;)
    {
      ViewWish wish;
      std::uint64_t serial = 0;
      {
        std::unique_lock<std::mutex> lock(this->Mutex);
        this->State = ViewProgress();
        this->Changed.notify_all();
        this->Changed.wait(lock, [this]
          { return this->Quit || (!this->Stopped && this->Serial != this->DoneSerial) || this->WantsWeights(); });
        if (this->Quit)
        {
          return;
        }
        if (this->Stopped || this->Serial == this->DoneSerial)
        {
          this->State.Busy = true;
          this->Began = Clock::now();
          lock.unlock();
          this->ServeWeights();
          continue;
        }
        wish = this->Wanted;
        serial = this->Serving = this->Serial;
        this->Token->Reset();
        this->State.Busy = true;
        this->Began = Clock::now();
      }
      try
      {
        this->Serve(wish, serial);
      }
      catch (const std::exception& e)
      {
        std::shared_ptr<ViewFrame> f = this->Blank(wish, serial);
        f->Error = e.what();
        this->Publish(f);
      }
      {
        std::lock_guard<std::mutex> lock(this->Mutex);
        this->DoneSerial = serial;
      }
      this->Wake();
    }
  }
};

RenderSession::RenderSession(const StageRegistry& registry)
  : Internal(new Internals(registry))
{
  this->Internal->Thread = std::thread([this] { this->Internal->Loop(); });
}

RenderSession::~RenderSession()
{
  {
    std::lock_guard<std::mutex> lock(this->Internal->Mutex);
    this->Internal->Quit = true;
    this->Internal->Notify = nullptr;
    this->Internal->Token->Cancel();
  }
  this->Internal->Changed.notify_all();
  this->Internal->Thread.join();
}

std::uint64_t RenderSession::Wish(const ViewWish& wish)
{
  std::uint64_t serial = 0;
  {
    std::lock_guard<std::mutex> lock(this->Internal->Mutex);
    Internals& in = *this->Internal;
    // Stopped stays stopped until something else is wished for: a viewer wishes the same again with every paint.
    if (in.Serial > 0 && (in.Stopped ? !wish.Play && SamePicture(in.Wanted, wish) : SameView(in.Wanted, wish)))
    {
      in.Wanted = wish;
      return in.Serial;
    }
    in.Wanted = wish;
    in.Stopped = false;
    serial = ++in.Serial;
    // What a hand drags (a slider, the camera) may only give up a frame that has shown something already: else a stream
    // of wishes would keep every frame from its end.
    if (in.State.Busy && (wish.Hurry || (in.Frame && in.Frame->Serial == in.Serving)))
    {
      in.Token->Cancel();
    }
  }
  this->Internal->Changed.notify_all();
  return serial;
}

void RenderSession::Weigh(const std::string& node, int x, int y)
{
  {
    std::lock_guard<std::mutex> lock(this->Internal->Mutex);
    Internals& in = *this->Internal;
    if (in.WeighNode == node && in.WeighX == x && in.WeighY == y)
    {
      return;
    }
    in.WeighNode = node;
    in.WeighX = x;
    in.WeighY = y;
  }
  this->Internal->Changed.notify_all();
}

std::shared_ptr<const ViewWeights> RenderSession::Weights() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Weighed;
}

void RenderSession::Cancel()
{
  {
    std::lock_guard<std::mutex> lock(this->Internal->Mutex);
    this->Internal->Stopped = true;
    this->Internal->Token->Cancel();
  }
  this->Internal->Changed.notify_all();
}

std::shared_ptr<const ViewFrame> RenderSession::Latest() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Frame;
}

std::shared_ptr<const ViewCheck> RenderSession::Checked() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Check;
}

ViewProgress RenderSession::Progress() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  ViewProgress p = this->Internal->State;
  p.Elapsed = p.Busy ? SecondsSince(this->Internal->Began) : 0.;
  return p;
}

bool RenderSession::Idle() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  const Internals& in = *this->Internal;
  return !in.State.Busy && (in.Stopped || in.Serial == in.DoneSerial) && !in.WantsWeights();
}

bool RenderSession::WaitIdle(double seconds) const
{
  std::unique_lock<std::mutex> lock(this->Internal->Mutex);
  const Internals& in = *this->Internal;
  return in.Changed.wait_for(lock, std::chrono::duration<double>(seconds),
    [&in] { return !in.State.Busy && (in.Stopped || in.Serial == in.DoneSerial) && !in.WantsWeights(); });
}

void RenderSession::SetNotify(std::function<void()> notify)
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  this->Internal->Notify = std::move(notify);
}
}
