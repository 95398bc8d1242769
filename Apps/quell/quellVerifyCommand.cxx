// SPDX-License-Identifier: BSD-3-Clause
// Runs again what an image says it was made by, and compares.
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellImageFile.h"
#include "quellInterrupt.h"
#include "quellJsonText.h"
#include "quellPipelineReader.h"
#include "quellProgressLine.h"
#include "quellProvenance.h"
#include "quellSimd.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
/// A directory of this process's own, gone afterwards.
class TemporaryDirectory
{
public:
  TemporaryDirectory()
    : Path((fs::temp_directory_path() / "quell-verify-XXXXXX").string())
  {
    // Made anew under a name that nobody can have taken before.
    if (!mkdtemp(&this->Path[0]))
    {
      throw StageError("cannot make a directory " + this->Path + ": " + std::strerror(errno));
    }
  }
  ~TemporaryDirectory()
  {
    std::error_code ec;
    fs::remove_all(this->Path, ec);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  void operator=(const TemporaryDirectory&) = delete;
  std::string Path;
};

std::string Entry(const std::map<std::string, std::string>& metadata, const char* key)
{
  const auto at = metadata.find(key);
  return at == metadata.end() ? std::string() : at->second;
}

struct Difference
{
  std::int64_t Pixels = 0, Differing = 0;
  double Largest = 0, Smape = 0;
};

/// Values that are the same bits, or both not a number, are the same.
Difference Compare(const vtkFloatArray* a, const vtkFloatArray* b)
{
  auto* first = const_cast<vtkFloatArray*>(a);
  auto* second = const_cast<vtkFloatArray*>(b);
  const int n = first->GetNumberOfComponents();
  Difference d;
  d.Pixels = first->GetNumberOfTuples();
  const float *x = first->GetPointer(0), *y = second->GetPointer(0);
  double sum = 0;
  for (std::int64_t p = 0; p < d.Pixels; ++p)
  {
    bool same = true;
    for (int c = 0; c < n; ++c)
    {
      const float v = x[p * n + c], w = y[p * n + c];
      const bool equal = std::memcmp(&v, &w, sizeof v) == 0 || (std::isnan(v) && std::isnan(w));
      same = same && equal;
      if (!equal)
      {
        const double distance = std::fabs(double(v) - double(w));
        d.Largest = distance <= d.Largest ? d.Largest : distance; // also for NaN
        sum += distance / (std::fabs(double(v)) + std::fabs(double(w)) + 0.01);
      }
    }
    d.Differing += !same;
  }
  d.Smape = sum / double(std::max<std::int64_t>(1, d.Pixels * n));
  return d;
}
}

int VerifyCommand(const VerifyArguments& a)
{
  ReadReport report;
  const ReadReport header = ReadImageHeader(a.File);
  ReadOptions options; // what the file holds, not what it leaves empty
  options.Region = Rect{ 0, 0, header.Width, header.Height }.clipped(header.DataWindow);
  const vtkSmartPointer<vtkImageData> image = ReadImageFile(a.File, &report, options);
  const std::map<std::string, std::string>& said = report.Metadata;
  if (Entry(said, "pipeline").empty())
  {
    throw UsageError(a.File + ": no pipeline is in this image; those that quell run writes have it, unless another "
                              "program wrote them anew");
  }
  if (!report.Facts.Partial.empty())
  {
    throw UsageError(a.File + ": it was finished early, with " + report.Facts.Partial +
                     "; how far a render gets before an interrupt cannot be made again");
  }
  if (HashHex(said.at("pipeline")) != Entry(said, "pipelineHash"))
  {
    std::fprintf(stderr, "quell: warning: %s: the pipeline in it was changed after it was written\n", a.File.c_str());
  }
  const TemporaryDirectory place;
  PipelineArguments arguments;
  arguments.File = a.File;
  arguments.OutputDirectory = place.Path;
  arguments.DiscardsOutputs = true;
  arguments.Region = Entry(said, "region");
  PreparedRun run;
  if (!PrepareRun(arguments, run))
  {
    return ExitUsage;
  }
  // Which of its outputs it is.
  const Graph& graph = *run.Pipeline;
  const int writer = graph.Find(Entry(said, "node"));
  if (writer < 0 || !graph.Nodes[std::size_t(writer)].Description().FindProperty("File"))
  {
    throw UsageError(a.File + ": it does not say which output of its pipeline it is (node " +
                     Quoted(Entry(said, "node")) + "); an older quell wrote it");
  }
  const std::string pattern = graph.Nodes[std::size_t(writer)].Stage->GetPropertyText("File");
  const int tick = report.Facts.Tick, lastTick = graph.Ticks.First + graph.Ticks.Count - 1;
  const auto notMade = [&](int frame)
  {
    return UsageError(a.File + ": it says that frame " + std::to_string(frame) +
                      " was computed for it, and its pipeline has frames " + std::to_string(graph.Ticks.First) + ":" +
                      std::to_string(lastTick));
  };
  if (tick < graph.Ticks.First || tick > lastTick)
  {
    throw notMade(tick);
  }
  // The frames before it that its history had.
  int first = tick;
  if (run.Executor->HasDelays())
  {
    const std::string frames = Entry(said, "frames"), warmUp = Entry(said, "warmUp");
    long long from = graph.Ticks.First, before = 0;
    std::string error;
    const bool known =
      warmUp.empty() || (detail::ParseInt(frames.substr(0, frames.find(':')), -100000000, 200000000, from, error) &&
                          detail::ParseInt(warmUp, 0, 100000000, before, error));
    if (!known)
    {
      throw UsageError(a.File + ": it does not say with which frame its run began");
    }
    first = warmUp.empty() ? graph.Ticks.First : int(from - before);
    if (first < graph.Ticks.First || first > tick)
    {
      throw notMade(first);
    }
  }

  const auto token = std::make_shared<CancelToken>();
  const InterruptScope interrupts(token.get(), "quell: stopping");
  run.Executor->SetCancelToken(token);
  run.Executor->SetHistoryLength(1);
  ProgressLine line(tick + 1 - first, a.Quiet);
  for (int t = first; t <= tick; ++t)
  {
    const TickResult result = run.Executor->RunTick(t, t < tick ? TickMode::WarmUp : TickMode::LastFrame);
    if (!result.Ok || token->IsFinishing())
    {
      line.Clear();
      if (result.Cancelled || token->IsFinishing())
      {
        std::fprintf(stderr, "quell: interrupted\n");
        return ExitInterrupted;
      }
      throw StageError("frame " + std::to_string(t) + ": " + result.Error);
    }
    line.FrameDone(t, t + 1 - first, 0);
  }
  line.Clear();
  const std::string remade = SequencePath(pattern, tick);
  const ReadReport now = ReadImageHeader(remade);
  if (now.Width != header.Width || now.Height != header.Height || now.DataWindow != header.DataWindow)
  {
    const auto size = [](const ReadReport& r)
    {
      return std::to_string(r.DataWindow.width()) + " x " + std::to_string(r.DataWindow.height()) + " of " +
             std::to_string(r.Width) + " x " + std::to_string(r.Height) + " pixels";
    };
    if (a.Json)
    {
      std::printf("%s\n",
        nlohmann::json({ { "file", a.File }, { "frame", tick }, { "same", false },
                         { "layers", nlohmann::json::array() }, { "size", size(header) }, { "remadeSize", size(now) } })
          .dump(2)
          .c_str());
    }
    else
    {
      std::printf("%s: frame %d differs from what its pipeline makes\n  it has %s, its pipeline makes %s\n",
        a.File.c_str(), tick, size(header).c_str(), size(now).c_str());
    }
    return ExitExceeded;
  }
  const vtkSmartPointer<vtkImageData> again = ReadImageFile(remade, nullptr, options);

  nlohmann::json out = { { "file", a.File }, { "frame", tick }, { "layers", nlohmann::json::array() } };
  bool same = true;
  std::string text;
  for (const FileArray& layer : report.Arrays)
  {
    const auto mine = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(layer.Name.c_str()));
    const auto theirs = vtkFloatArray::SafeDownCast(again->GetPointData()->GetArray(layer.Name.c_str()));
    if (!mine || !theirs || mine->GetNumberOfValues() != theirs->GetNumberOfValues() ||
        mine->GetNumberOfComponents() != theirs->GetNumberOfComponents())
    {
      same = false;
      text += "  " + layer.Name + ": the pipeline does not make it, or of another size\n";
      out["layers"].push_back({ { "name", layer.Name }, { "made", false } });
      continue;
    }
    const Difference d = Compare(mine, theirs);
    same = same && d.Differing == 0;
    char line2[200];
    if (d.Differing == 0)
    {
      std::snprintf(line2, sizeof line2, ": every bit of %lld pixels\n", static_cast<long long>(d.Pixels));
    }
    else
    {
      std::snprintf(line2, sizeof line2, ": %lld of %lld pixels differ, by %.3g at most, SMAPE %.3g\n",
        static_cast<long long>(d.Differing), static_cast<long long>(d.Pixels), d.Largest, d.Smape);
    }
    text += "  " + layer.Name + line2;
    out["layers"].push_back({ { "name", layer.Name }, { "made", true }, { "pixels", d.Pixels },
      { "differing", d.Differing }, { "largest", d.Largest }, { "SMAPE", d.Smape } });
  }
  out["same"] = same;
  if (!same)
  {
    const std::string version = Entry(said, "version"), instructions = Entry(said, "instructions");
    if (!version.empty() && version != QUELL_VERSION)
    {
      text += "  it was written by quell " + version + ", this is " + QUELL_VERSION + "\n";
    }
    if (!instructions.empty() && instructions != SimdTargetName())
    {
      text += "  it was computed with " + instructions + " instructions, these are " + SimdTargetName() +
              ": last bits may differ\n";
    }
  }
  if (a.Json)
  {
    std::printf("%s\n", JsonText(out).c_str());
  }
  else
  {
    std::printf("%s: frame %d %s\n%s", a.File.c_str(), tick,
      same ? "is what its pipeline makes" : "differs from what its pipeline makes", text.c_str());
  }
  return same ? ExitDone : ExitExceeded;
}
}
