// SPDX-License-Identifier: BSD-3-Clause
#include "quellTradeoff.h"

#include "quellCancelToken.h"
#include "quellCostModel.h"
#include "quellImageFile.h"
#include "quellJsonText.h"
#include "quellLeaveOut.h"
#include "quellMetrics.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineWriter.h"
#include "quellProvenance.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>

namespace fs = std::filesystem;

namespace quell
{
Spread SpreadOf(std::vector<double> values)
{
  Spread s;
  if (values.empty())
  {
    return s;
  }
  std::sort(values.begin(), values.end());
  const auto at = [&](double q)
  {
    const double place = q * double(values.size() - 1);
    const std::size_t i = std::size_t(place);
    const double next = values[std::min(i + 1, values.size() - 1)];
    return values[i] + (place - double(i)) * (next - values[i]);
  };
  s.Low = at(0.25);
  s.Middle = at(0.5);
  s.High = at(0.75);
  return s;
}

namespace
{
/// Smaller is better, whatever the metric.
double Badness(const std::string& metric, double value)
{
  return HigherIsBetter(metric) ? -value : value;
}

double MetricOf(const SettingResult& s, const std::string& metric)
{
  const auto at = s.Metrics.find(metric);
  return at == s.Metrics.end() ? std::numeric_limits<double>::quiet_NaN() : at->second.Mean;
}

bool Measured(const SettingResult& s, const std::string& metric)
{
  return s.Error.empty() && s.Runs > 0 && std::isfinite(MetricOf(s, metric));
}

ImageIn ViewOf(vtkImageData* image, const std::string& array)
{
  auto data = image ? vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array.c_str())) : nullptr;
  if (!data)
  {
    return {};
  }
  int e[6];
  image->GetExtent(e);
  return ImageIn(data->GetPointer(0), data->GetNumberOfComponents(), Rect{ e[0], e[2], e[1] + 1, e[3] + 1 });
}

vtkSmartPointer<vtkImageData> NewImage(const Rect& r)
{
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetExtent(r.x0, r.x1 - 1, r.y0, r.y1 - 1, 0, 0);
  return image;
}
float* AddArray(vtkImageData* image, const std::string& name, int components)
{
  vtkNew<vtkFloatArray> array;
  array->SetName(name.c_str());
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(image->GetNumberOfPoints());
  image->GetPointData()->AddArray(array);
  return array->GetPointer(0);
}

/// Per channel and pixel over the runs of a setting: mean and sum of squared deviations (Welford), kept as an image
/// file so that an interrupted sweep goes on.
struct Moments
{
  int Runs = 0;
  vtkSmartPointer<vtkImageData> Image;

  void Add(const ImageIn& t)
  {
    if (!this->Image)
    {
      this->Image = NewImage(t.extent);
      const std::size_t n = std::size_t(t.extent.area()) * std::size_t(t.components);
      std::fill_n(AddArray(this->Image, "mean", t.components), n, 0.f);
      std::fill_n(AddArray(this->Image, "deviation", t.components), n, 0.f);
    }
    const ImageIn mean = ViewOf(this->Image, "mean"), m2 = ViewOf(this->Image, "deviation");
    float *a = const_cast<float*>(mean.data), *b = const_cast<float*>(m2.data);
    ++this->Runs;
    const std::size_t n = std::size_t(t.extent.area()) * std::size_t(t.components);
    for (std::size_t i = 0; i < n; ++i)
    {
      const double v = double(t.data[i]), d = v - double(a[i]), m = double(a[i]) + d / this->Runs;
      a[i] = float(m);
      b[i] = float(double(b[i]) + d * (v - m));
    }
  }
  void Save(const std::string& file) const
  {
    WriteOptions options;
    options.Metadata["runs"] = std::to_string(this->Runs);
    WriteImageFile(file, this->Image,
      { { "mean", "mean", ArrayKind::Color, nullptr }, { "deviation", "deviation", ArrayKind::Color, nullptr } },
      options);
  }
  /// False where the file does not hold so many runs.
  bool Load(const std::string& file, int runs)
  {
    try
    {
      ReadReport report;
      this->Image = ReadImageFile(file, &report);
      this->Runs = runs;
      return report.Metadata["runs"] == std::to_string(runs) && ViewOf(this->Image, "mean").data &&
             ViewOf(this->Image, "deviation").data;
    }
    catch (const StageError&)
    {
      return false;
    }
  }
};
}

int ChooseSetting(const std::vector<SettingResult>& settings, const std::string& metric, double budget,
  const std::optional<std::pair<std::string, double>>& aim, std::string& text)
{
  int best = -1, nearest = -1;
  const auto number = [](double v) { return RoundedText(v, 4); };
  const std::string& judged = aim ? aim->first : metric;
  for (std::size_t i = 0; i < settings.size(); ++i)
  {
    const SettingResult& s = settings[i];
    if (!Measured(s, judged))
    {
      continue;
    }
    const double bad = Badness(judged, MetricOf(s, judged)), ms = s.Milliseconds.Middle;
    const auto better = [&](int other, bool byTime)
    {
      if (other < 0)
      {
        return true;
      }
      const SettingResult& o = settings[std::size_t(other)];
      const double otherBad = Badness(judged, MetricOf(o, judged)), otherMs = o.Milliseconds.Middle;
      return byTime ? ms < otherMs || (ms == otherMs && bad < otherBad)
                    : bad < otherBad || (bad == otherBad && ms < otherMs);
    };
    if (aim)
    {
      if (bad <= Badness(judged, aim->second) && better(best, true))
      {
        best = int(i);
      }
      if (better(nearest, false))
      {
        nearest = int(i);
      }
    }
    else
    {
      if (ms <= budget && better(best, false))
      {
        best = int(i);
      }
      if (better(nearest, true))
      {
        nearest = int(i);
      }
    }
  }
  if (aim)
  {
    const std::string what = judged + " " + (HigherIsBetter(judged) ? ">= " : "<= ") + number(aim->second);
    text = best >= 0 ? "the fastest with " + what
           : nearest >= 0
             ? "no setting has " + what + "; the nearest is " + ChoiceText(settings[std::size_t(nearest)].Choice) +
                 " with " + number(MetricOf(settings[std::size_t(nearest)], judged))
             : "nothing was measured";
  }
  else
  {
    text = best >= 0      ? "the lowest error (" + judged + ") within " + number(budget) + " ms"
           : nearest >= 0 ? "no setting takes " + number(budget) + " ms or less; the fastest is " +
                              ChoiceText(settings[std::size_t(nearest)].Choice) + " with " +
                              number(settings[std::size_t(nearest)].Milliseconds.Middle) + " ms"
                          : "nothing was measured";
    if (HigherIsBetter(judged) && best >= 0)
    {
      text = "the highest " + judged + " within " + number(budget) + " ms";
    }
  }
  return best;
}

void MarkPareto(std::vector<SettingResult>& settings, const std::string& metric)
{
  for (SettingResult& s : settings)
  {
    s.Pareto = Measured(s, metric);
    for (const SettingResult& o : settings)
    {
      if (&o == &s || !s.Pareto || !Measured(o, metric))
      {
        continue;
      }
      const double ms = s.Milliseconds.Middle, other = o.Milliseconds.Middle;
      const double bad = Badness(metric, MetricOf(s, metric)), otherBad = Badness(metric, MetricOf(o, metric));
      const bool twin = other == ms && otherBad == bad;
      s.Pareto = !(other <= ms && otherBad <= bad && (!twin || &o < &s));
    }
  }
}

struct Tradeoff::Internals
{
  /// Settings whose graphs differ in properties alone share an executor: what a property does not reach is not run
  /// again.
  struct Group
  {
    std::shared_ptr<Graph> First;
    std::unique_ptr<PipelineExecutor> Executor;
    std::map<std::string, double> LastSeconds; ///< of nodes that need not run
    bool Warm = false;
  };
  struct Setting
  {
    VaryChoice Choice;
    std::string Left, Key;
    std::shared_ptr<Graph> Pipeline;
    int Group = -1;
    SettingResult Result;
    Moments Sum;
    std::vector<std::map<std::string, double>> Nodes, Metrics; ///< a run each: node -> ms; metric -> value (new seeds)
    std::vector<int> Rounds;                                   ///< of those runs
    std::string Picture;
  };

  const StageRegistry& Registry;
  TradeoffOptions Options;
  std::vector<Setting> Settings, Ledger;
  std::vector<Group> Groups;
  int First = 0, Start = 0, End = 1, Rounds = 1, Done = 0, All = 0;
  long long FirstSeed = 1;
  vtkSmartPointer<vtkImageData> Reference;
  int ReferenceTick = -1;
  std::vector<std::string> Notes;

  Internals(const StageRegistry& registry, TradeoffOptions options)
    : Registry(registry)
    , Options(std::move(options))
  {
  }

  std::string RunsFile() const { return (fs::path(this->Options.Directory) / "runs.jsonl").string(); }
  std::string StateFile(const Setting& s) const
  {
    return (fs::path(this->Options.Directory) / "state" / (HashHex(s.Key) + ".exr")).string();
  }

  bool Cancelled() const
  {
    return this->Options.Token && (this->Options.Token->IsCancelled() || this->Options.Token->IsFinishing());
  }

  bool Prepare(Setting& s, std::string& error) const;
  void Prepare();
  void Join(Setting& s);
  const GraphOutput& Output(const Graph& graph) const;
  ImageIn ReferenceAt(int tick);
  void Apply(Group& group, const Setting& s, int seed);
  bool Execute(Setting& s, int round, std::string& error);
  void RunAll(std::vector<Setting>& settings);
  void Load(std::vector<Setting>& settings);
  void Append(const Setting& s) const;
  nlohmann::json Header() const;
  void CheckDirectory();
  void CheckSize(const Setting& s);
  void Summarise(Setting& s);
};

const GraphOutput& Tradeoff::Internals::Output(const Graph& graph) const
{
  if (graph.Outputs.empty())
  {
    throw StageError("the pipeline has no output to measure");
  }
  if (this->Options.Output.empty())
  {
    return graph.Outputs.front();
  }
  if (const GraphOutput* o = graph.FindOutput(this->Options.Output))
  {
    return *o;
  }
  std::vector<std::string> names;
  for (const GraphOutput& o : graph.Outputs)
  {
    names.push_back(o.Name);
  }
  const std::string near = DidYouMean(this->Options.Output, names);
  throw StageError(
    "no output " + Quoted(this->Options.Output) + "; " + (near.empty() ? "the pipeline has " + Listed(names) : near));
}

/// The graph of one setting.
bool Tradeoff::Internals::Prepare(Setting& s, std::string& error) const
{
  std::shared_ptr<const PipelineDocument> document = this->Options.Document;
  GraphOptions options = this->Options.Graph;
  options.Seed.reset();
  std::vector<std::string> gone;
  const auto leave = [&](const std::string& node)
  {
    document = LeaveOut(*document, node, this->Registry, error);
    gone.push_back(node);
    return document != nullptr;
  };
  if (!s.Left.empty() && !leave(s.Left))
  {
    return false;
  }
  for (const auto& c : s.Choice)
  {
    const bool isVariable = std::any_of(document->Variables.begin(), document->Variables.end(),
      [&](const PipelineVariable& v) { return v.Name.Value == c.first; });
    if (c.first.find('.') != std::string::npos)
    {
      options.Properties.push_back(c);
    }
    else if (isVariable)
    {
      options.Defines.push_back(c);
    }
    else if (c.second == "off")
    {
      if (std::find(gone.begin(), gone.end(), c.first) == gone.end() && !leave(c.first))
      {
        return false;
      }
    }
    else if (c.second != "on" || !LeaveOut(*this->Options.Document, c.first, this->Registry, error))
    {
      error = error.empty() || c.second != "on"
                ? Quoted(c.first) + " is neither NODE.PROPERTY nor a variable; a node takes on and off"
                : error;
      return false;
    }
  }
  // What is left out has no properties to set.
  const auto isGone = [&](const std::pair<std::string, std::string>& p)
  {
    for (const std::string& node : gone)
    {
      if (p.first.compare(0, node.size(), node) == 0 && p.first.size() > node.size() &&
          (p.first[node.size()] == '.' || p.first[node.size()] == '/'))
      {
        return true;
      }
    }
    return false;
  };
  options.Properties.erase(
    std::remove_if(options.Properties.begin(), options.Properties.end(), isGone), options.Properties.end());
  Diagnostics messages;
  s.Pipeline = BuildGraph(document, this->Registry, options, messages);
  if (messages.HasErrors())
  {
    messages.Sort();
    for (const Diagnostic& d : messages.All())
    {
      if (d.Level == Severity::Error)
      {
        error += (error.empty() ? "" : "\n") + d.ToText();
      }
    }
    s.Pipeline.reset();
    return false;
  }
  return true;
}

/// Finds or makes the group of a setting.
void Tradeoff::Internals::Join(Setting& s)
{
  const auto same = [](const Graph& a, const Graph& b)
  {
    if (a.Nodes.size() != b.Nodes.size() || a.Ticks.First != b.Ticks.First || a.Ticks.Count != b.Ticks.Count ||
        a.Ticks.Rate != b.Ticks.Rate)
    {
      return false;
    }
    for (std::size_t n = 0; n < a.Nodes.size(); ++n)
    {
      const GraphNode &x = a.Nodes[n], &y = b.Nodes[n];
      if (x.Path != y.Path || x.Type != y.Type || x.Inputs.size() != y.Inputs.size())
      {
        return false;
      }
      for (std::size_t e = 0; e < x.Inputs.size(); ++e)
      {
        const GraphEdge &p = x.Inputs[e], &q = y.Inputs[e];
        if (p.Port != q.Port || p.Connection != q.Connection || p.Producer != q.Producer || p.Array != q.Array ||
            p.Delayed != q.Delayed || p.Attributes != q.Attributes)
        {
          return false;
        }
      }
    }
    return true;
  };
  for (std::size_t g = 0; g < this->Groups.size(); ++g)
  {
    if (same(*this->Groups[g].First, *s.Pipeline))
    {
      s.Group = int(g);
      return;
    }
  }
  s.Group = int(this->Groups.size());
  this->Groups.emplace_back();
  Group& group = this->Groups.back();
  group.First = s.Pipeline;
  group.Executor = std::make_unique<PipelineExecutor>(s.Pipeline, this->Registry);
  group.Executor->SetWriteOutputs(false);
  const GraphOutput& output = this->Output(*s.Pipeline);
  group.Executor->Request(s.Pipeline->Nodes[std::size_t(output.Node)].Path, { output.Array });
  group.Executor->SetHistoryLength(1);
  if (this->Options.Token)
  {
    group.Executor->SetCancelToken(this->Options.Token);
  }
}

void Tradeoff::Internals::Prepare()
{
  TradeoffOptions& o = this->Options;
  if (o.Metrics.empty())
  {
    o.Metrics = { "relMSE", "FLIP", "SSIM" };
  }
  if (o.Aim && std::find(o.Metrics.begin(), o.Metrics.end(), o.Aim->first) == o.Metrics.end())
  {
    o.Metrics.push_back(o.Aim->first);
  }
  const std::vector<std::string> known = MetricNames();
  for (const std::string& m : o.Metrics)
  {
    if (std::find(known.begin(), known.end(), m) == known.end())
    {
      const std::string near = DidYouMean(m, known);
      throw StageError("unknown metric " + Quoted(m) + "; " + (near.empty() ? "metrics: " + Listed(known) : near));
    }
  }
  // Settings that differ only in properties of a node that both leave out are one.
  const auto repeats = [&](const VaryChoice& choice)
  {
    for (const auto& off : choice)
    {
      for (std::size_t i = 0; i < choice.size() && off.second == "off"; ++i)
      {
        const std::string& what = choice[i].first;
        if (what.compare(0, off.first.size(), off.first) == 0 && what.size() > off.first.size() &&
            (what[off.first.size()] == '.' || what[off.first.size()] == '/') &&
            choice[i].second != o.Axes[i].Values.front())
        {
          return true;
        }
      }
    }
    return false;
  };
  std::string errors;
  for (const VaryChoice& choice : Combinations(o.Axes))
  {
    if (repeats(choice))
    {
      continue;
    }
    Setting s;
    s.Choice = choice;
    s.Key = ChoiceText(choice);
    std::string error;
    if (!this->Prepare(s, error) && errors.find(error) == std::string::npos)
    {
      errors += (errors.empty() ? "" : "\n") + error;
    }
    this->Settings.push_back(std::move(s));
  }
  if (!errors.empty())
  {
    throw StageError(errors);
  }
  for (const VaryAxis& axis : o.Axes)
  {
    const std::size_t dot = axis.What.rfind('.');
    if (dot != std::string::npos && axis.What.substr(dot + 1) == "Seed")
    {
      throw StageError(
        "--vary " + axis.What + ": the runs choose the seeds; say how many with --seeds, from --seed on");
    }
  }
  for (Setting& s : this->Settings)
  {
    this->Join(s);
  }
  const Graph& graph = *this->Settings.front().Pipeline;
  const PipelineExecutor& executor = *this->Groups.front().Executor;
  const int first = graph.Ticks.First, last = first + graph.Ticks.Count - 1;
  const bool history =
    std::any_of(this->Groups.begin(), this->Groups.end(), [](const Group& g) { return g.Executor->HasDelays(); });
  this->First = history ? last : first;
  this->End = this->First + 1;
  if (o.Frames)
  {
    this->First = o.Frames->first;
    this->End = o.Frames->second;
  }
  this->Start = history ? first : this->First;
  this->FirstSeed = o.Graph.Seed.value_or(1);
  bool seeded = false;
  for (std::size_t n = 0; n < graph.Nodes.size(); ++n)
  {
    seeded = seeded || (executor.LiveNodes()[n] && graph.Nodes[n].Description().FindProperty("Seed"));
  }
  if (!seeded && o.Seeds > 1)
  {
    this->Notes.push_back("no node has a seed: the images are the same in every run, and errors have no spread");
    o.Seeds = 1;
  }
  this->Rounds = std::max(o.Seeds, o.Repeats);
  this->ReferenceAt(this->First);
  for (const Setting& s : this->Settings)
  {
    this->CheckSize(s);
  }
}

ImageIn Tradeoff::Internals::ReferenceAt(int tick)
{
  const bool sequence = this->Options.Reference.find('#') != std::string::npos;
  if (!this->Reference || (sequence && tick != this->ReferenceTick))
  {
    const std::string file = SequencePath(this->Options.Reference, tick);
    ReadOptions options;
    options.Arrays = { this->Options.Layer };
    this->Reference = ReadImageFile(file, nullptr, options);
    this->ReferenceTick = tick;
  }
  return ViewOf(this->Reference, this->Options.Layer);
}

/// Another size than the reference's is refused before anything runs.
void Tradeoff::Internals::CheckSize(const Setting& s)
{
  Group& group = this->Groups[std::size_t(s.Group)];
  this->Apply(group, s, this->Options.Seeds);
  const std::string path = s.Pipeline->Nodes[std::size_t(this->Output(*s.Pipeline).Node)].Path;
  int width = 0, height = 0;
  std::string error;
  if (!group.Executor->FrameSize(path, width, height, error))
  {
    throw StageError(error);
  }
  const Rect r = ViewOf(this->Reference, this->Options.Layer).extent;
  if (width != r.width() || height != r.height())
  {
    throw StageError("the reference " + this->Options.Reference + " is " + std::to_string(r.width()) + " x " +
                     std::to_string(r.height()) + " pixels, the output " + std::to_string(width) + " x " +
                     std::to_string(height) + (s.Choice.empty() ? std::string() : " with " + ChoiceText(s.Choice)));
  }
}

/// Gives the group's stages the properties of the setting, and their seeds: the first one + `seed`.
void Tradeoff::Internals::Apply(Group& group, const Setting& s, int seed)
{
  for (std::size_t n = 0; n < s.Pipeline->Nodes.size(); ++n)
  {
    const GraphNode& node = s.Pipeline->Nodes[n];
    vtkQuellStage* stage = group.Executor->GetStage(node.Path);
    if (!stage)
    {
      continue;
    }
    for (const Property& p : node.Description().Properties)
    {
      std::string text = node.Stage->GetPropertyText(p.Name), error;
      if (p.Name == "Seed")
      {
        text = std::to_string(this->FirstSeed + seed);
      }
      if (text != stage->GetPropertyText(p.Name))
      {
        stage->SetPropertyText(p.Name, text, error);
      }
    }
  }
}

bool Tradeoff::Internals::Execute(Setting& s, int round, std::string& error)
{
  Group& group = this->Groups[std::size_t(s.Group)];
  PipelineExecutor& executor = *group.Executor;
  if (!group.Warm)
  {
    // What happens once (reading the scene, building its hierarchy) belongs to no setting, nor does this seed.
    this->Apply(group, s, this->Options.Seeds);
    const TickResult warm = executor.RunTick(this->Start, TickMode::Frame);
    if (!warm.Ok)
    {
      error = warm.Error;
      return false;
    }
    group.Warm = true;
  }
  executor.ClearHistory();
  // A round that no seed is left for repeats the first ones, for the times.
  this->Apply(group, s, round % this->Options.Seeds);
  std::map<std::string, double> seconds;
  std::map<std::string, double> sums;
  const GraphOutput& output = this->Output(*group.First);
  const std::string path = group.First->Nodes[std::size_t(output.Node)].Path;
  const bool newSeed = round < this->Options.Seeds;
  for (int tick = this->Start; tick < this->End; ++tick)
  {
    executor.ResetCounters();
    const TickResult result = executor.RunTick(tick, TickMode::Frame);
    if (!result.Ok || !result.Partial.empty())
    {
      error = result.Ok ? "interrupted" : result.Error;
      return false;
    }
    if (tick < this->First)
    {
      continue;
    }
    for (const NodeCounters& c : executor.Counters())
    {
      if (c.Counters.Executions > 0)
      {
        group.LastSeconds[c.Path] = c.Counters.Seconds;
      }
      seconds[c.Path] += group.LastSeconds[c.Path];
    }
    const ImageIn test = ViewOf(executor.GetImage(path), output.Array);
    const ImageIn reference = this->ReferenceAt(tick);
    if (!test.data)
    {
      error = "node " + Quoted(path) + " made no array " + Quoted(output.Array);
      return false;
    }
    if (test.extent.width() != reference.extent.width() || test.extent.height() != reference.extent.height() ||
        test.components != reference.components)
    {
      const auto size = [](const ImageIn& i)
      {
        return std::to_string(i.extent.width()) + " x " + std::to_string(i.extent.height()) + " x " +
               std::to_string(i.components);
      };
      throw StageError("the reference " + this->Options.Reference + " has " + size(reference) +
                       " values, the output has " + size(test));
    }
    if (!newSeed)
    {
      continue;
    }
    try
    {
      for (const std::string& m : this->Options.Metrics)
      {
        sums[m] += ComputeMetric(m, test, reference);
      }
    }
    catch (const StageError& e)
    {
      throw StageError("output " + Quoted(output.Name) + " (" + output.Array + ") against " + this->Options.Reference +
                       ": " + e.what());
    }
    if (tick + 1 == this->End)
    {
      s.Sum.Add(test);
      if (s.Sum.Runs == 1)
      {
        const auto image = NewImage(test.extent);
        std::memcpy(AddArray(image, "radiance", test.components), test.data,
          std::size_t(test.extent.area()) * std::size_t(test.components) * sizeof(float));
        s.Picture = "pictures/" + HashHex(s.Key) + ".png";
        WriteImageFile((fs::path(this->Options.Directory) / s.Picture).string(), image);
      }
    }
  }
  const double frames = double(this->End - this->First);
  for (auto& n : seconds)
  {
    n.second *= 1000 / frames;
  }
  for (auto& m : sums)
  {
    m.second /= frames;
  }
  s.Nodes.push_back(std::move(seconds));
  s.Metrics.push_back(std::move(sums));
  s.Rounds.push_back(round);
  return true;
}

nlohmann::json Tradeoff::Internals::Header() const
{
  Diagnostics unused;
  nlohmann::json h = { { "tradeoff", 1 }, { "reference", this->Options.Reference }, { "layer", this->Options.Layer },
    { "output", this->Output(*this->Settings.front().Pipeline).Name }, { "metrics", this->Options.Metrics },
    { "first", this->First }, { "end", this->End }, { "seeds", this->Options.Seeds },
    { "firstSeed", this->FirstSeed } };
  // The file with what the command line said; the settings stand in the runs.
  Diagnostics messages;
  const auto plain = BuildGraph(this->Options.Document, this->Registry, this->Options.Graph, messages);
  h["pipeline"] = HashHex(WritePipelineText(*SelfContained(*plain, this->Registry, unused)));
  h["inputs"] = InputHashes(*plain);
  return h;
}

/// The runs of an earlier sweep are gone on with; those of another sweep are nobody's to overwrite.
void Tradeoff::Internals::CheckDirectory()
{
  std::error_code ec;
  fs::create_directories(fs::path(this->Options.Directory) / "state", ec);
  if (ec)
  {
    throw StageError("cannot make the directory \"" + this->Options.Directory + "\": " + ec.message());
  }
  const std::string header = JsonText(this->Header(), -1);
  std::ifstream old(this->RunsFile());
  std::string line;
  if (old && std::getline(old, line))
  {
    if (line != header)
    {
      throw StageError("\"" + this->RunsFile() +
                       "\" holds another sweep (pipeline, reference, metrics, frames or seeds differ): choose another "
                       "--out, or delete it");
    }
  }
}

void Tradeoff::Internals::Append(const Setting& s) const
{
  std::error_code ec;
  const bool fresh = !fs::exists(this->RunsFile(), ec) || fs::file_size(this->RunsFile(), ec) == 0;
  std::ofstream out(this->RunsFile(), std::ios::app);
  if (fresh)
  {
    out << JsonText(this->Header(), -1) << "\n";
  }
  const nlohmann::json run = { { "setting", s.Key }, { "round", s.Rounds.back() }, { "ms", s.Nodes.back() },
    { "metrics", s.Metrics.back() }, { "picture", s.Picture } };
  out << JsonText(run, -1) << "\n";
  if (!out.flush())
  {
    throw StageError("cannot write \"" + this->RunsFile() + "\": is the disk full?");
  }
}

void Tradeoff::Internals::Load(std::vector<Setting>& settings)
{
  std::ifstream file(this->RunsFile());
  std::string line;
  std::getline(file, line); // the header
  std::map<std::string, Setting*> known;
  for (Setting& s : settings)
  {
    known[s.Key] = &s;
  }
  while (std::getline(file, line))
  {
    // The last line of an interrupted run may be cut off.
    const nlohmann::json run = nlohmann::json::parse(line, nullptr, false);
    if (run.is_discarded() || !run.contains("setting"))
    {
      continue;
    }
    const auto at = known.find(run["setting"].get<std::string>());
    if (at == known.end())
    {
      continue;
    }
    Setting& s = *at->second;
    if (run["round"].get<int>() != int(s.Rounds.size()))
    {
      continue;
    }
    s.Rounds.push_back(run["round"].get<int>());
    s.Nodes.push_back(run["ms"].get<std::map<std::string, double>>());
    s.Metrics.push_back(run["metrics"].get<std::map<std::string, double>>());
    s.Picture = run["picture"].get<std::string>();
  }
  for (Setting& s : settings)
  {
    const int seeds = std::min(int(s.Rounds.size()), this->Options.Seeds);
    if (seeds > 0 && !s.Sum.Load(this->StateFile(s), seeds))
    {
      s.Sum = Moments();
      s.Rounds.clear();
      s.Nodes.clear();
      s.Metrics.clear();
    }
    this->Done += int(s.Rounds.size());
  }
}

void Tradeoff::Internals::RunAll(std::vector<Setting>& settings)
{
  this->All += int(settings.size()) * this->Rounds;
  this->Load(settings);
  for (int round = 0; round < this->Rounds; ++round)
  {
    for (std::size_t k = 0; k < settings.size(); ++k)
    {
      Setting& s = settings[round % 2 == 0 ? k : settings.size() - 1 - k];
      if (!s.Result.Error.empty() || int(s.Rounds.size()) != round)
      {
        continue;
      }
      if (this->Cancelled())
      {
        return;
      }
      if (this->Options.Progress)
      {
        this->Options.Progress(this->Done, this->All, s.Left.empty() ? s.Key : "without " + s.Left);
      }
      std::string error;
      if (!this->Execute(s, round, error))
      {
        if (this->Cancelled())
        {
          return;
        }
        s.Result.Error = error;
        continue;
      }
      if (round < this->Options.Seeds)
      {
        s.Sum.Save(this->StateFile(s));
      }
      this->Append(s);
      ++this->Done;
    }
  }
}

void Tradeoff::Internals::Summarise(Setting& s)
{
  SettingResult& r = s.Result;
  r.Choice = s.Choice;
  r.Left = s.Left;
  r.Runs = int(s.Rounds.size());
  r.Seeds = std::min(r.Runs, this->Options.Seeds);
  r.Picture = s.Picture;
  std::vector<double> all, filters;
  std::map<std::string, std::vector<double>> nodes;
  for (const auto& run : s.Nodes)
  {
    double sum = 0, filter = 0;
    for (const auto& n : run)
    {
      const GraphNode& node = s.Pipeline->Nodes[std::size_t(s.Pipeline->Find(n.first))];
      const bool file = node.Type == "ImageReader" || node.Type == "ImageWriter";
      sum += file ? 0 : n.second;
      filter += file || node.Inputs.empty() ? 0 : n.second;
      nodes[n.first].push_back(n.second);
    }
    all.push_back(sum);
    filters.push_back(filter);
  }
  r.Milliseconds = SpreadOf(all);
  r.FilterMilliseconds = SpreadOf(filters);
  for (const auto& n : nodes)
  {
    r.Nodes[n.first] = SpreadOf(n.second);
  }
  for (const std::string& m : this->Options.Metrics)
  {
    double sum = 0, squares = 0;
    int n = 0;
    for (const auto& run : s.Metrics)
    {
      const auto at = run.find(m);
      if (at != run.end())
      {
        // Welford
        const double d = at->second - sum;
        sum += d / ++n;
        squares += d * (at->second - sum);
      }
    }
    if (n > 0)
    {
      r.Metrics[m].Mean = sum;
      if (n > 1)
      {
        r.Metrics[m].StandardError = std::sqrt(squares / (n - 1) / n);
      }
    }
  }
  const int k = s.Sum.Runs;
  if (k > 1)
  {
    const ImageIn mean = ViewOf(s.Sum.Image, "mean"), m2 = ViewOf(s.Sum.Image, "deviation"),
                  reference = this->ReferenceAt(this->End - 1);
    double bias = 0, variance = 0;
    const std::size_t n = std::size_t(mean.extent.area()) * std::size_t(mean.components);
    for (std::size_t i = 0; i < n; ++i)
    {
      const double ref = double(reference.data[i]), d = double(mean.data[i]) - ref, s2 = double(m2.data[i]) / (k - 1),
                   w = 1 / (ref * ref + 0.01);
      bias += w * (d * d - s2 / k);
      variance += w * s2;
    }
    r.BiasSquared = bias / double(n);
    r.Variance = variance / double(n);
  }
}

Tradeoff::Tradeoff(const StageRegistry& registry, TradeoffOptions options)
  : Internal(new Internals(registry, std::move(options)))
{
  this->Internal->Prepare();
}

Tradeoff::~Tradeoff() = default;

std::string Tradeoff::PipelineText(const VaryChoice& choice) const
{
  Internals::Setting s;
  s.Choice = choice;
  std::string error;
  if (!this->Internal->Prepare(s, error))
  {
    throw StageError(error);
  }
  Diagnostics messages;
  return WritePipelineText(*SelfContained(*s.Pipeline, this->Internal->Registry, messages));
}

TradeoffReport Tradeoff::Run()
{
  Internals& in = *this->Internal;
  const TradeoffOptions& o = in.Options;
  in.CheckDirectory();
  TradeoffReport report;
  report.Pipeline = o.Document->File;
  report.Reference = o.Reference;
  report.Output = in.Output(*in.Settings.front().Pipeline).Name;
  report.Machine = MachineText();
  report.Metrics = o.Metrics;
  report.FirstFrame = in.First;
  report.EndFrame = in.End;
  report.FirstSeed = int(in.FirstSeed);
  report.Seeds = o.Seeds;
  report.Rounds = in.Rounds;
  report.Notes = in.Notes;
  const ImageIn reference = in.ReferenceAt(in.First);
  report.Width = reference.extent.width();
  report.Height = reference.extent.height();

  in.RunAll(in.Settings);
  for (Internals::Setting& s : in.Settings)
  {
    in.Summarise(s);
    report.Settings.push_back(s.Result);
  }
  MarkPareto(report.Settings, o.Metrics.front());
  if (o.Budget > 0 || o.Aim)
  {
    report.Chosen = ChooseSetting(report.Settings, o.Metrics.front(), o.Budget, o.Aim, report.ChosenText);
  }
  report.LedgerOf = std::max(0, report.Chosen);
  const Internals::Setting& base = in.Settings[std::size_t(report.LedgerOf)];
  for (int n : base.Pipeline->Order)
  {
    const std::string& path = base.Pipeline->Nodes[std::size_t(n)].Path;
    if (report.Settings[std::size_t(report.LedgerOf)].Nodes.count(path))
    {
      report.NodeOrder.push_back(path);
    }
  }
  if (!o.Ledger || in.Cancelled())
  {
    return report;
  }

  for (const std::string& node : RemovableNodes(*o.Document, in.Registry))
  {
    const bool off = std::any_of(base.Choice.begin(), base.Choice.end(),
      [&](const std::pair<std::string, std::string>& c) { return c.first == node && c.second == "off"; });
    // Only what has a part in the measured image.
    const bool live = std::any_of(report.NodeOrder.begin(), report.NodeOrder.end(),
      [&](const std::string& path) { return path == node || path.compare(0, node.size() + 1, node + "/") == 0; });
    if (off || !live)
    {
      continue;
    }
    Internals::Setting s;
    s.Choice = base.Choice;
    s.Left = node;
    s.Key = ChoiceText(base.Choice) + " without " + node;
    std::string error;
    if (in.Prepare(s, error))
    {
      in.Join(s);
    }
    else
    {
      s.Result.Error = error.substr(0, error.find('\n'));
    }
    in.Ledger.push_back(std::move(s));
  }
  in.RunAll(in.Ledger);
  for (Internals::Setting& s : in.Ledger)
  {
    if (s.Pipeline)
    {
      in.Summarise(s);
    }
    s.Result.Left = s.Left;
    s.Result.Choice = s.Choice;
    report.Ledger.push_back(s.Result);
  }
  return report;
}
}
