// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellImageFile.h"
#include "quellJsonText.h"
#include "quellMetrics.h"
#include "quellTemporalMetrics.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>

namespace quell
{
namespace
{
std::vector<std::string> ArrayNames(const ReadReport& report)
{
  std::vector<std::string> names;
  for (const FileArray& a : report.Arrays)
  {
    names.push_back(a.Name);
  }
  return names;
}

void RequireLayer(const std::string& file, const ReadReport& report, const std::string& layer)
{
  const std::vector<std::string> names = ArrayNames(report);
  if (std::find(names.begin(), names.end(), layer) == names.end())
  {
    const std::string near = DidYouMean(layer, names);
    throw StageError(file + ": no layer " + Quoted(layer) + "; " + (near.empty() ? "it has " + Listed(names) : near));
  }
}

ImageIn View(vtkImageData* image, const std::string& file, const std::string& layer)
{
  vtkFloatArray* array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(layer.c_str()));
  if (!array)
  {
    throw StageError(file + ": layer " + Quoted(layer) + " holds no float pixels");
  }
  int e[6];
  image->GetExtent(e);
  return ImageIn(array->GetPointer(0), array->GetNumberOfComponents(), Rect{ e[0], e[2], e[1] + 1, e[3] + 1 });
}

std::string SizeText(const ReadReport& r)
{
  return std::to_string(r.Width) + " x " + std::to_string(r.Height);
}

/// Dark blue over purple and orange to light yellow: lightness grows with the error, readable without colour.
void FalseColor(double t, float* out)
{
  static const double stops[5][3] = { { 0.02, 0.02, 0.08 }, { 0.28, 0.07, 0.42 }, { 0.71, 0.21, 0.33 },
    { 0.97, 0.55, 0.18 }, { 0.99, 0.97, 0.75 } };
  const double x = std::min(1., std::max(0., t)) * 4;
  const int i = std::min(3, int(x));
  for (int c = 0; c < 3; ++c)
  {
    out[c] = float(stops[i][c] + (stops[i + 1][c] - stops[i][c]) * (x - i));
  }
}

/// Errors of the pixels, smallest first.
std::vector<float> SortedErrors(const std::string& metric, const ImageIn& test, const ImageIn& reference)
{
  const Rect r = reference.extent;
  std::vector<float> values(std::size_t(r.area()));
  ComputeErrorMap(metric, test, reference, ImageOut(values.data(), 1, r));
  std::sort(values.begin(), values.end());
  return values;
}

/// The value that the share `q` of the pixels does not exceed.
double Percentile(const std::vector<float>& sorted, double q)
{
  const std::size_t rank = std::size_t(std::ceil(q * double(sorted.size())));
  return double(sorted[std::min(sorted.size() - 1, rank > 0 ? rank - 1 : 0)]);
}

/// The picture's brightest colour stands for the returned value: the 99.9th percentile, so that one firefly does not
/// make everything else black.
double WriteMap(const std::string& file, const std::string& metric, const ImageIn& test, const ImageIn& reference)
{
  const Rect r = reference.extent;
  std::vector<float> values(std::size_t(r.area()));
  ComputeErrorMap(metric, test, reference, ImageOut(values.data(), 1, r));
  std::vector<float> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  const double bright = Percentile(sorted, 0.999), scale = bright > 0 ? bright : 1.;
  const auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetExtent(r.x0, r.x1 - 1, r.y0, r.y1 - 1, 0, 0);
  const bool exr = file.size() > 4 && file.compare(file.size() - 4, 4, ".exr") == 0;
  const auto array = vtkSmartPointer<vtkFloatArray>::New();
  array->SetName(exr ? "error" : "display");
  array->SetNumberOfComponents(exr ? 1 : 3);
  array->SetNumberOfTuples(vtkIdType(values.size()));
  for (std::size_t i = 0; i < values.size(); ++i)
  {
    if (exr)
    {
      array->GetPointer(0)[i] = values[i];
    }
    else
    {
      FalseColor(double(values[i]) / scale, array->GetPointer(vtkIdType(3 * i)));
    }
  }
  image->GetPointData()->AddArray(array);
  WriteImageFile(file, image);
  return scale;
}

bool IsSequence(const std::string& path)
{
  return std::filesystem::path(path).filename().string().find('#') != std::string::npos;
}

bool IsTemporal(const std::string& metric)
{
  const std::vector<std::string>& names = TemporalMetrics::Names();
  return std::find(names.begin(), names.end(), metric) != names.end();
}

/// Numbers of the frames that are there, in order.
std::vector<int> FramesOf(const std::string& pattern)
{
  const std::filesystem::path path(pattern);
  const std::string name = path.filename().string();
  const std::size_t end = name.rfind('#') + 1, begin = name.find_last_not_of('#', end - 1) + 1;
  const std::string prefix = name.substr(0, begin), suffix = name.substr(end);
  std::set<int> numbers;
  std::error_code ec;
  for (std::filesystem::directory_iterator at(path.has_parent_path() ? path.parent_path() : ".", ec), last; at != last;
       at.increment(ec))
  {
    const std::string file = at->path().filename().string();
    long long n = 0;
    std::string error;
    if (file.size() > prefix.size() + suffix.size() && file.compare(0, prefix.size(), prefix) == 0 &&
        file.compare(file.size() - suffix.size(), suffix.size(), suffix) == 0)
    {
      std::string digits = file.substr(prefix.size(), file.size() - prefix.size() - suffix.size());
      const bool negative = digits.front() == '-';
      digits.erase(0, negative ? 1 : 0);
      digits.erase(0, std::min(digits.find_first_not_of('0'), digits.size() - 1));
      if (detail::ParseInt((negative ? "-" : "") + digits, -100000000, 200000000, n, error) &&
          std::filesystem::path(SequencePath(pattern, int(n))).filename() == file)
      {
        numbers.insert(int(n));
      }
    }
  }
  return { numbers.begin(), numbers.end() };
}

/// Sums of a layer over the frames.
struct LayerErrors
{
  std::string Layer;
  std::vector<std::pair<std::string, double>> Values; ///< means over frames; then the temporal ones
  std::vector<double> Percentiles;                    ///< of the first metric, in the last frame
  double Brightest = 0;
  std::string Map;
  std::vector<std::string> Undefined; ///< asked for, and why there is no value
};

const double Shares[] = { 0.5, 0.9, 0.99, 0.999, 1 };

/// `out.png` for the layer `albedo`: out.albedo.png
std::string WithLayer(const std::string& file, const std::string& layer)
{
  const std::filesystem::path path(file);
  return (path.parent_path() / (path.stem().string() + "." + layer + path.extension().string())).string();
}

class Comparison
{
public:
  Comparison(const CompareArguments& a, std::vector<std::string> metrics)
    : Arguments(a)
    , Metrics(std::move(metrics))
  {
  }
  /// What both files have, or what was asked for.
  void Layers(const std::string& test, const std::string& reference)
  {
    const ReadReport t = ReadImageHeader(test), r = ReadImageHeader(reference);
    std::vector<std::string> layers = this->Arguments.Layers;
    if (layers.empty())
    {
      layers = { "radiance" };
    }
    if (std::find(layers.begin(), layers.end(), "all") != layers.end())
    {
      layers.clear();
      const std::vector<std::string> theirs = ArrayNames(r);
      for (const std::string& name : ArrayNames(t))
      {
        if (std::find(theirs.begin(), theirs.end(), name) != theirs.end())
        {
          layers.push_back(name);
        }
      }
      if (layers.empty())
      {
        throw StageError(test + " and " + reference + " have no layer in common: " + Listed(ArrayNames(t)) + "; and " +
                         Listed(theirs));
      }
    }
    for (const std::string& layer : layers)
    {
      RequireLayer(test, t, layer);
      RequireLayer(reference, r, layer);
      this->Results.push_back({ layer, {}, {}, 0, {}, {} });
    }
    this->Temporal.resize(layers.size());
    const std::vector<std::string> names = ArrayNames(t);
    this->HasMotion = std::find(names.begin(), names.end(), "motion") != names.end();
    this->HasId = this->HasMotion && std::find(names.begin(), names.end(), "id") != names.end();
  }
  void Add(const std::string& testFile, const std::string& referenceFile, int tick);
  void Finish();

  std::vector<LayerErrors> Results;
  int Frames = 0;

private:
  const CompareArguments& Arguments;
  std::vector<std::string> Metrics;
  std::vector<TemporalMetrics> Temporal;
  bool HasMotion = false, HasId = false, Told = false;
};

void Comparison::Add(const std::string& testFile, const std::string& referenceFile, int tick)
{
  const bool sequence = IsSequence(this->Arguments.Test);
  const ReadReport testHeader = ReadImageHeader(testFile), referenceHeader = ReadImageHeader(referenceFile);
  if (testHeader.Width != referenceHeader.Width || testHeader.Height != referenceHeader.Height)
  {
    throw StageError("the images differ in size: " + testFile + " is " + SizeText(testHeader) + " pixels, " +
                     referenceFile + " is " + SizeText(referenceHeader));
  }
  ReadOptions options;
  for (const LayerErrors& l : this->Results)
  {
    RequireLayer(testFile, testHeader, l.Layer);
    RequireLayer(referenceFile, referenceHeader, l.Layer);
    options.Arrays.insert(l.Layer);
  }
  const Rect whole{ 0, 0, testHeader.Width, testHeader.Height };
  options.Region = whole.clipped(testHeader.DataWindow).clipped(referenceHeader.DataWindow);
  if (options.Region.empty())
  {
    throw StageError("the images have no pixel in common: their data windows do not overlap");
  }
  if (options.Region != whole && !this->Told)
  {
    this->Told = true;
    std::fprintf(stderr, "quell: warning: comparing the %d x %d pixels that both files hold\n", options.Region.width(),
      options.Region.height());
  }
  const vtkSmartPointer<vtkImageData> referenceImage = ReadImageFile(referenceFile, nullptr, options);
  // With motion, and ids where it is known, a sequence is also compared with itself.
  for (const char* extra : { "motion", "id" })
  {
    if (sequence && (extra[0] == 'm' ? this->HasMotion : this->HasId))
    {
      options.Arrays.insert(extra);
    }
  }
  const vtkSmartPointer<vtkImageData> testImage = ReadImageFile(testFile, nullptr, options);
  for (std::size_t k = 0; k < this->Results.size(); ++k)
  {
    LayerErrors& l = this->Results[k];
    const ImageIn test = View(testImage, testFile, l.Layer), reference = View(referenceImage, referenceFile, l.Layer);
    std::vector<std::pair<std::string, double>> values;
    std::string problem;
    for (const std::string& m : this->Metrics)
    {
      if (IsTemporal(m))
      {
        continue;
      }
      try
      {
        values.emplace_back(m, ComputeMetric(m, test, reference));
      }
      catch (const StageError& e)
      {
        // Of the usual set, what an image cannot have (FLIP of depth, SSIM of ten pixels) is left out; an image that no
        // metric can be computed of is an error.
        problem = e.what();
        if (this->Results.size() == 1 && (!this->Arguments.Metrics.empty() || !this->Arguments.Maxima.empty()))
        {
          throw StageError(problem);
        }
      }
    }
    const bool all = this->Results.size() > 1;
    if (values.empty() && !problem.empty() && !all)
    {
      throw StageError(problem);
    }
    if (values.empty() && !problem.empty())
    {
      std::fprintf(stderr, "quell: warning: layer \"%s\" is left out: %s\n", l.Layer.c_str(), problem.c_str());
      continue;
    }
    if (l.Values.empty())
    {
      l.Values.resize(values.size(), { "", 0. });
    }
    for (std::size_t i = 0; i < values.size() && i < l.Values.size(); ++i)
    {
      l.Values[i].first = values[i].first;
      l.Values[i].second += values[i].second;
    }
    if (sequence)
    {
      this->Temporal[k].Add(test, reference, this->HasMotion ? View(testImage, testFile, "motion") : ImageIn(),
        this->HasId ? View(testImage, testFile, "id") : ImageIn());
    }
    if (!values.empty() && this->Arguments.Percentiles)
    {
      const std::vector<float> sorted = SortedErrors(values.front().first, test, reference);
      l.Percentiles.clear();
      for (const double q : Shares)
      {
        l.Percentiles.push_back(Percentile(sorted, q));
      }
    }
    if (!values.empty() && !this->Arguments.Map.empty())
    {
      const std::string file = all ? WithLayer(this->Arguments.Map, l.Layer) : this->Arguments.Map;
      l.Map = SequencePath(file, tick);
      l.Brightest = WriteMap(l.Map, values.front().first, test, reference);
    }
  }
  ++this->Frames;
}

void Comparison::Finish()
{
  for (std::size_t k = 0; k < this->Results.size(); ++k)
  {
    LayerErrors& l = this->Results[k];
    for (auto& v : l.Values)
    {
      v.second /= std::max(1, this->Frames);
    }
    for (const auto& v : this->Temporal[k].Values())
    {
      const std::string name = v.first.substr(0, v.first.find(' '));
      const bool asked = this->Arguments.Metrics.empty() ||
                         std::find(this->Metrics.begin(), this->Metrics.end(), name) != this->Metrics.end();
      if (asked)
      {
        l.Values.push_back(v);
      }
    }
    for (const std::string& m : this->Metrics)
    {
      const bool there = std::any_of(
        l.Values.begin(), l.Values.end(), [&m](const std::pair<std::string, double>& v) { return v.first == m; });
      if (IsTemporal(m) && !there)
      {
        l.Undefined.push_back(m + ": " +
                              (this->Frames < 2                   ? "needs at least two frames"
                                : m == "warp" && !this->HasMotion ? "the test files have no layer \"motion\""
                                : m == "warp"                     ? "no pixel's motion stays inside the image"
                                                                  : "the reference does not change"));
      }
    }
  }
}

void PrintTable(const Comparison& c)
{
  const std::vector<LayerErrors>& results = c.Results;
  if (results.size() == 1)
  {
    std::size_t width = 0;
    for (const auto& v : results.front().Values)
    {
      width = std::max(width, v.first.size());
    }
    for (const auto& v : results.front().Values)
    {
      std::printf("%-*s  %.6g\n", int(width), v.first.c_str(), v.second);
    }
    return;
  }
  std::size_t width = 5;
  std::vector<std::string> names;
  for (const LayerErrors& l : results)
  {
    width = std::max(width, l.Layer.size());
    for (const auto& v : l.Values)
    {
      if (std::find(names.begin(), names.end(), v.first) == names.end())
      {
        names.push_back(v.first);
      }
    }
  }
  std::printf("%-*s", int(width), "layer");
  for (const std::string& n : names)
  {
    std::printf("  %*s", int(std::max<std::size_t>(11, n.size())), n.c_str());
  }
  std::printf("\n");
  for (const LayerErrors& l : results)
  {
    if (l.Values.empty())
    {
      continue;
    }
    std::printf("%-*s", int(width), l.Layer.c_str());
    for (const std::string& n : names)
    {
      const auto v = std::find_if(
        l.Values.begin(), l.Values.end(), [&n](const std::pair<std::string, double>& x) { return x.first == n; });
      char text[32] = "-";
      if (v != l.Values.end())
      {
        std::snprintf(text, sizeof text, "%.6g", v->second);
      }
      std::printf("  %*s", int(std::max<std::size_t>(11, n.size())), text);
    }
    std::printf("\n");
  }
}
}

int CompareCommand(const CompareArguments& a)
{
  const bool sequence = IsSequence(a.Test);
  std::vector<std::string> known = MetricNames();
  known.insert(known.end(), TemporalMetrics::Names().begin(), TemporalMetrics::Names().end());
  const auto requireMetric = [&](const std::string& name)
  {
    if (std::find(known.begin(), known.end(), name) == known.end())
    {
      const std::string near = DidYouMean(name, known);
      throw UsageError("unknown metric " + Quoted(name) + "; " + (near.empty() ? "metrics: " + Listed(known) : near));
    }
    if (IsTemporal(name) && !sequence)
    {
      throw UsageError(name + " is of a sequence: write #### for the frame number in the file names");
    }
  };
  if (!sequence && (IsSequence(a.Reference) || !a.Frames.empty()))
  {
    throw UsageError(
      a.Test + " is one image: for a sequence write #### for the frame number (the reference may stay one image)");
  }
  std::vector<std::string> metrics = a.Metrics;
  std::vector<std::pair<std::string, double>> maxima;
  for (const std::string& m : a.Metrics)
  {
    requireMetric(m);
  }
  for (const std::string& text : a.Maxima)
  {
    const auto entry = Assignment(text, "--max");
    requireMetric(entry.first);
    if (!IsTemporal(entry.first) && HigherIsBetter(entry.first))
    {
      throw UsageError("--max " + text + ": a higher " + entry.first + " is better; bound an error instead");
    }
    double limit = 0;
    std::string error;
    if (!detail::ParseDouble(entry.second, 0, 1e300, limit, error))
    {
      throw UsageError("--max " + text + ": " + error);
    }
    maxima.emplace_back(entry.first, limit);
    if (std::find(metrics.begin(), metrics.end(), entry.first) == metrics.end())
    {
      metrics.push_back(entry.first);
    }
  }
  if (metrics.empty())
  {
    metrics = { "relMSE", "relMSE@0.1%", "SMAPE", "PSNR", "SSIM", "FLIP" };
  }

  if ((!a.Map.empty() || a.Percentiles) && std::all_of(metrics.begin(), metrics.end(), IsTemporal))
  {
    throw UsageError(std::string(a.Map.empty() ? "--percentiles" : "--map") + ": " + metrics.front() +
                     " has no value of a pixel; name a metric of single images too, as --metric relMSE");
  }
  for (const std::string& file : { a.Test, a.Reference })
  {
    std::error_code unknown;
    if (!a.Map.empty() && (a.Map == file || std::filesystem::equivalent(a.Map, file, unknown)))
    {
      throw UsageError("--map " + a.Map + " would write over what is compared");
    }
  }

  std::vector<int> frames{ 0 };
  if (sequence)
  {
    frames = FramesOf(a.Test);
    if (frames.empty())
    {
      throw StageError(a.Test + ": no such file; #### stands for the number of a frame");
    }
    if (!a.Frames.empty())
    {
      // Every frame that is asked for has to be there.
      Timeline all;
      all.First = frames.front(), all.Count = frames.back() - frames.front() + 1;
      int first = 0, end = 0;
      ParseFrames(a.Frames, all, first, end, a.Test);
      frames.clear();
      for (int n = first; n < end; ++n)
      {
        frames.push_back(n);
      }
    }
    for (std::size_t i = 1; i < frames.size(); ++i)
    {
      if (frames[i] != frames[i - 1] + 1)
      {
        throw StageError(SequencePath(a.Test, frames[i - 1] + 1) + " is missing: frames " +
                         std::to_string(frames.front()) + " to " + std::to_string(frames.back()) +
                         " are not all there; --frames A:B compares a part");
      }
    }
  }
  Comparison comparison(a, metrics);
  const auto referenceOf = [&](int tick)
  { return IsSequence(a.Reference) ? SequencePath(a.Reference, tick) : a.Reference; };
  const auto testOf = [&](int tick) { return sequence ? SequencePath(a.Test, tick) : a.Test; };
  comparison.Layers(testOf(frames.front()), referenceOf(frames.front()));
  for (const int tick : frames)
  {
    comparison.Add(testOf(tick), referenceOf(tick), tick);
  }
  comparison.Finish();

  nlohmann::json out = { { "test", a.Test }, { "reference", a.Reference } };
  out["exceeded"] = nlohmann::json::array();
  if (sequence)
  {
    out["frames"] = { frames.front(), frames.back() };
  }
  std::string verdicts;
  const bool several = comparison.Results.size() > 1;
  nlohmann::json layers = nlohmann::json::object();
  for (const LayerErrors& l : comparison.Results)
  {
    nlohmann::json layer = { { "metrics", nlohmann::json::object() } };
    for (const auto& v : l.Values)
    {
      layer["metrics"][v.first] = v.second;
    }
    if (!l.Percentiles.empty())
    {
      for (std::size_t i = 0; i < l.Percentiles.size(); ++i)
      {
        layer["percentiles"][detail::FormatDouble(100 * Shares[i])] = l.Percentiles[i];
      }
    }
    if (!l.Map.empty())
    {
      layer["map"] = { { "file", l.Map }, { "metric", l.Values.front().first }, { "brightest", l.Brightest } };
    }
    for (const std::string& why : l.Undefined)
    {
      layer["undefined"].push_back(why);
    }
    for (const auto& limit : maxima)
    {
      const auto elsewhere = [&limit](const LayerErrors& other)
      {
        return std::any_of(other.Values.begin(), other.Values.end(),
          [&limit](const std::pair<std::string, double>& x) { return x.first == limit.first; });
      };
      if (!elsewhere(l) && !IsTemporal(limit.first) &&
          std::any_of(comparison.Results.begin(), comparison.Results.end(), elsewhere))
      {
        continue; // a layer that cannot have this metric, beside one that has
      }
      const auto v = std::find_if(l.Values.begin(), l.Values.end(),
        [&limit](const std::pair<std::string, double>& x) { return x.first == limit.first; });
      // Written so that a value that is not a number, or is not there, exceeds too.
      if (v == l.Values.end() || !(v->second <= limit.second))
      {
        out["exceeded"].push_back(several ? l.Layer + " " + limit.first : limit.first);
        verdicts += "quell: " + limit.first + (several ? " of " + l.Layer : std::string()) +
                    (v == l.Values.end() ? " is not defined for these frames"
                                         : " is " + detail::FormatDouble(v->second) + ", more than " +
                                             detail::FormatDouble(limit.second)) +
                    "\n";
      }
    }
    layers[l.Layer] = layer;
  }
  if (several)
  {
    out["layers"] = layers;
  }
  else
  {
    out["layer"] = comparison.Results.front().Layer;
    out.update(layers.begin().value());
  }
  if (a.Json)
  {
    std::printf("%s\n", JsonText(out).c_str());
  }
  else
  {
    if (sequence)
    {
      std::printf("frames %d to %d: means, and what changes between frames\n", frames.front(), frames.back());
    }
    PrintTable(comparison);
    for (const LayerErrors& l : comparison.Results)
    {
      for (const std::string& why : l.Undefined)
      {
        std::printf("%sno %s\n", several ? (l.Layer + ": ").c_str() : "", why.c_str());
      }
      if (!l.Percentiles.empty())
      {
        std::printf("%s%s of the pixels%s:", several ? (l.Layer + ": ").c_str() : "", l.Values.front().first.c_str(),
          sequence ? " of the last frame" : "");
        for (std::size_t i = 0; i < l.Percentiles.size(); ++i)
        {
          std::printf("%s %g %% up to %.4g", i ? "," : "", 100 * Shares[i], l.Percentiles[i]);
        }
        std::printf("\n");
      }
      if (!l.Map.empty())
      {
        std::printf("wrote %s: %s of each pixel, brightest at %.4g\n", l.Map.c_str(), l.Values.front().first.c_str(),
          l.Brightest);
      }
    }
  }
  std::fflush(stdout);
  std::fputs(verdicts.c_str(), stderr);
  return verdicts.empty() ? ExitDone : ExitExceeded;
}
}
