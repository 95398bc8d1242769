// SPDX-License-Identifier: BSD-3-Clause
// Every pipeline of Data/Pipelines, small, over numbers of threads, ways to cut the frame and instruction sets. Each
// pair of two of these settings is met at least once (pairwise design); every run must have the bits of the first one
// with the same instruction set, and all of them together differ by rounding alone.
#include "AllStages.h"
#include "Threads.h"
#include "quellPipelineExecutor.h"
#include "quellSimd.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkObject.h"
#include "vtkPointData.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <iterator>
#include <set>

namespace
{
const int threads[] = { 1, 2, 3, 7 };
/// Regions as parts of the frame's width and height, in sixteenths.
const std::vector<std::vector<quell::DisplayRegion>> tilings = { { { 0, 0, 16, 16 } },
  { { 0, 0, 7, 16 }, { 7, 0, 16, 16 } }, { { 0, 0, 16, 3 }, { 0, 3, 16, 11 }, { 0, 11, 16, 16 } },
  { { 0, 0, 9, 5 }, { 9, 0, 16, 5 }, { 0, 5, 9, 16 }, { 9, 5, 16, 16 } }, { { 5, 6, 9, 15 } } };

/// Few rows in which each pair of values of any two of the factors occurs: always the row with most new pairs.
/// `levels`: how many values each factor has.
std::vector<std::vector<int>> Pairwise(const std::vector<int>& levels)
{
  const int factors = int(levels.size());
  std::set<std::array<int, 4>> met;
  std::size_t all = 0, rows = 1;
  for (int i = 0; i < factors; ++i)
  {
    rows *= std::size_t(levels[i]);
    for (int j = 0; j < i; ++j)
      all += std::size_t(levels[i]) * std::size_t(levels[j]);
  }
  std::vector<std::vector<int>> chosen;
  while (met.size() < all)
  {
    std::vector<int> best;
    int most = 0;
    for (std::size_t number = 0; number < rows; ++number)
    {
      std::vector<int> row;
      for (std::size_t rest = number; int(row.size()) < factors; rest /= std::size_t(levels[row.size() - 1]))
        row.push_back(int(rest % std::size_t(levels[row.size()])));
      int fresh = 0;
      for (int i = 0; i < factors; ++i)
        for (int j = 0; j < i; ++j)
          fresh += !met.count({ i, j, row[i], row[j] });
      if (fresh > most)
      {
        most = fresh;
        best = row;
      }
    }
    for (int i = 0; i < factors; ++i)
      for (int j = 0; j < i; ++j)
        met.insert({ i, j, best[i], best[j] });
    chosen.push_back(best);
  }
  return chosen;
}

/// A sanitizer looks at what is read and when, 10 to 50 times as slowly: fewer pixels, and one instruction set. Kernel
/// tests go through the others.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool Sanitized = true;
#else
constexpr bool Sanitized = false;
#endif
constexpr int Side = Sanitized ? 32 : 64, MostFrames = Sanitized ? 2 : 4;

struct Shipped
{
  std::string Name;
  quell::GraphOptions::Assignments Defines;
  bool Traces = false;
};

/// Every file that has outputs; small where it has the variables for that.
std::vector<Shipped> ShippedPipelines()
{
  std::vector<Shipped> found;
  for (const auto& entry : std::filesystem::directory_iterator(QUELL_SOURCE_DIR "/Data/Pipelines"))
  {
    if (entry.path().extension() != ".xml")
      continue;
    std::ifstream in(entry.path());
    const std::string text{ std::istreambuf_iterator<char>(in), {} };
    if (text.find("<output ") == std::string::npos)
      continue;
    Shipped s;
    s.Name = entry.path().filename().string();
    const auto define = [&](const char* name, const std::string& value)
    {
      if (text.find(std::string("<variable name=\"") + name + "\"") != std::string::npos)
        s.Defines.emplace_back(name, value);
    };
    define("width", std::to_string(Side));
    define("height", std::to_string(Side));
    define("spp", "2");
    // Sequences of files have the frames that they have; one picture is the same in every frame.
    const bool traces = text.find("type=\"PathTraceSource\"") != std::string::npos;
    if (traces || text.find("####.exr\" doc=") == std::string::npos)
      define("frames", traces ? std::to_string(MostFrames) : "1");
    s.Traces = traces;
    found.push_back(s);
  }
  std::sort(found.begin(), found.end(), [](const Shipped& a, const Shipped& b) { return a.Name < b.Name; });
  return found;
}

/// Values of all outputs of all frames; NaN where no region was made.
using Frames = std::vector<float>;

class Film
{
public:
  explicit Film(const Shipped& shipped)
    : Pipeline(shipped)
  {
  }
  Frames Make(const std::vector<quell::DisplayRegion>& regions)
  {
    Frames frames;
    for (const quell::DisplayRegion& part : regions)
    {
      quell::GraphOptions options;
      options.Defines = this->Pipeline.Defines;
      quell::Diagnostics diagnostics;
      const std::shared_ptr<quell::Graph> graph = quell::LoadPipeline(
        QUELL_SOURCE_DIR "/Data/Pipelines/" + this->Pipeline.Name, Registry(), options, diagnostics);
      if (!graph)
        throw std::runtime_error("has mistakes");
      quell::PipelineExecutor executor(graph, Registry());
      executor.SetWriteOutputs(false);
      std::map<int, quell::ArraySet> asked;
      for (const quell::GraphOutput& output : graph->Outputs)
        asked[output.Node].insert(output.Array);
      for (const auto& entry : asked)
        executor.Request(graph->Nodes[std::size_t(entry.first)].Path, entry.second);
      int w = 0, h = 0;
      std::string error;
      if (!executor.FrameSize(graph->Nodes[std::size_t(graph->Outputs.at(0).Node)].Path, w, h, error))
        throw std::runtime_error(error);
      // A new pipeline must be small here as well: it has variables width, height and frames.
      if (this->Pipeline.Traces && (w != Side || h != Side || graph->Ticks.Count > MostFrames))
        throw std::runtime_error("is not as small as width, height and frames should make it");
      const quell::DisplayRegion region{ part.X0 * w / 16, part.Y0 * h / 16, part.X1 * w / 16, part.Y1 * h / 16 };
      if (region.X1 - region.X0 < w || region.Y1 - region.Y0 < h)
        executor.SetRegion(region);
      const quell::Rect r = region.ToFrame(h);
      std::size_t at = 0;
      for (int t = graph->Ticks.First; t < graph->Ticks.First + graph->Ticks.Count; ++t)
      {
        const quell::TickResult result = executor.RunTick(t);
        if (!result.Ok)
          throw std::runtime_error(result.Error);
        for (const auto& entry : asked)
          for (const std::string& name : entry.second)
          {
            vtkImageData* image = executor.GetImage(graph->Nodes[std::size_t(entry.first)].Path);
            auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name.c_str()));
            if (!array)
              throw std::runtime_error("no " + name);
            const int n = array->GetNumberOfComponents();
            const std::size_t size = std::size_t(w) * h * n;
            if (frames.size() < at + size)
              frames.resize(at + size, std::nanf(""));
            const int* e = image->GetExtent();
            for (int y = r.y0; y < r.y1; ++y)
              std::memcpy(&frames[at + (std::size_t(y) * w + r.x0) * n],
                array->GetPointer((vtkIdType(y - e[2]) * (e[1] - e[0] + 1) + r.x0 - e[0]) * n),
                std::size_t(r.width()) * n * sizeof(float));
            at += size;
          }
      }
    }
    return frames;
  }

private:
  const Shipped& Pipeline;
};

/// Only what both made is compared.
std::size_t Differing(const Frames& a, const Frames& b)
{
  std::size_t n = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    n += !std::isnan(b[i]) && std::memcmp(&a[i], &b[i], sizeof(float)) != 0;
  return n;
}
/// The values that differ most, for a failure's message.
std::string Worst(const Frames& a, const Frames& b)
{
  std::vector<std::pair<double, std::size_t>> by;
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!std::isnan(b[i]) && a[i] != b[i])
      by.emplace_back(std::fabs(double(a[i]) - b[i]) / (std::fabs(double(a[i])) + std::fabs(double(b[i]))), i);
  std::sort(by.rbegin(), by.rend());
  std::string text = "; " + std::to_string(by.size()) + " of " + std::to_string(a.size()) + " values differ, most";
  for (std::size_t k = 0; k < std::min<std::size_t>(8, by.size()); ++k)
    text += " [" + std::to_string(by[k].second) + "] " + quell::detail::FormatDouble(a[by[k].second]) + " " +
            quell::detail::FormatDouble(b[by[k].second]);
  return text;
}
double Smape(const Frames& a, const Frames& b)
{
  double sum = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!std::isnan(b[i]))
    {
      const double d = std::fabs(double(a[i]) - b[i]), m = std::fabs(double(a[i])) + std::fabs(double(b[i]));
      sum += d / (m + 0.01); // as the metric of that name
      ++n;
    }
  return n ? sum / double(n) : 1;
}
}

TEST(Determinism, ShippedPipelinesOverThreadsTilingsAndInstructionSets)
{
  vtkObject::SetGlobalWarningDisplay(0);
  std::vector<quell::SimdTarget> targets = quell::SimdTargets();
  ASSERT_FALSE(targets.empty());
  if (Sanitized)
    targets.resize(1);
  const std::vector<Shipped> pipelines = ShippedPipelines();
  ASSERT_GE(pipelines.size(), 14u);
  const std::vector<std::vector<int>> runs =
    Pairwise({ int(pipelines.size()), int(std::size(threads)), int(tilings.size()), int(targets.size()) });
  std::printf("%zu pipelines x %zu numbers of threads x %zu tilings x %zu instruction sets: %zu runs meet all pairs\n",
    pipelines.size(), std::size(threads), tilings.size(), targets.size(), runs.size());
  for (std::size_t p = 0; p < pipelines.size(); ++p)
  {
    SCOPED_TRACE(pipelines[p].Name);
    Film film(pipelines[p]);
    // What each instruction set makes of whole frames.
    std::vector<Frames> whole(targets.size());
    double worst = 0;
    for (std::size_t t = 0; t < targets.size(); ++t)
    {
      quell::ForceSimdTarget(targets[t].Id);
      quelltest::WithThreads(1, [&] { whole[t] = film.Make(tilings[0]); });
      ASSERT_FALSE(whole[t].empty());
      ASSERT_EQ(whole[t].size(), whole[0].size());
      ASSERT_TRUE(std::none_of(whole[t].begin(), whole[t].end(), [](float v) { return std::isnan(v); }));
      worst = std::max(worst, Smape(whole[0], whole[t]));
      EXPECT_LE(Smape(whole[0], whole[t]), 1e-5)
        << targets[t].Name << " against " << targets[0].Name << Worst(whole[0], whole[t]);
    }
    for (const std::vector<int>& run : runs)
    {
      if (run[0] != int(p) || (run[1] == 0 && run[2] == 0))
        continue; // one thread and the whole frame: made above
      quell::ForceSimdTarget(targets[std::size_t(run[3])].Id);
      Frames frames;
      quelltest::WithThreads(threads[run[1]], [&] { frames = film.Make(tilings[std::size_t(run[2])]); });
      ASSERT_EQ(frames.size(), whole[0].size());
      EXPECT_EQ(Differing(whole[std::size_t(run[3])], frames), 0u)
        << "values differ with " << threads[run[1]] << " threads, tiling " << run[2] << ", "
        << targets[std::size_t(run[3])].Name << Worst(whole[std::size_t(run[3])], frames);
    }
    std::printf("  %-32s SMAPE across instruction sets %.1e\n", pipelines[p].Name.c_str(), worst);
  }
  quell::ForceSimdTarget(0);
  vtkObject::SetGlobalWarningDisplay(1);
}
