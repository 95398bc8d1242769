// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellImageFile.h"
#include "quellMetrics.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

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

/// The picture's brightest colour stands for the returned value: the 99.9th percentile, so that one firefly does not
/// make everything else black.
double WriteMap(const std::string& file, const std::string& metric, const ImageIn& test, const ImageIn& reference)
{
  const Rect r = reference.extent;
  std::vector<float> values(std::size_t(r.area()));
  ComputeErrorMap(metric, test, reference, ImageOut(values.data(), 1, r));
  std::vector<float> sorted = values;
  const std::size_t rank = std::min(sorted.size() - 1, std::size_t(double(sorted.size()) * 0.999));
  std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(rank), sorted.end());
  const double scale = sorted[rank] > 0 ? double(sorted[rank]) : 1.;
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
}

int CompareCommand(const CompareArguments& a)
{
  const std::vector<std::string> known = MetricNames();
  const auto requireMetric = [&known](const std::string& name)
  {
    if (std::find(known.begin(), known.end(), name) == known.end())
    {
      const std::string near = DidYouMean(name, known);
      throw UsageError("unknown metric " + Quoted(name) + "; " + (near.empty() ? "metrics: " + Listed(known) : near));
    }
  };
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
    if (HigherIsBetter(entry.first))
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
  const bool chosen = !metrics.empty();
  if (!chosen)
  {
    metrics = { "relMSE", "relMSE@0.1%", "SMAPE", "PSNR", "SSIM", "FLIP" };
  }

  const ReadReport testHeader = ReadImageHeader(a.Test), referenceHeader = ReadImageHeader(a.Reference);
  const std::string layer = a.Layer.empty() ? "radiance" : a.Layer;
  RequireLayer(a.Test, testHeader, layer);
  RequireLayer(a.Reference, referenceHeader, layer);
  if (testHeader.Width != referenceHeader.Width || testHeader.Height != referenceHeader.Height)
  {
    throw StageError("the images differ in size: " + a.Test + " is " + SizeText(testHeader) + " pixels, " +
                     a.Reference + " is " + SizeText(referenceHeader));
  }
  ReadOptions options;
  options.Arrays = { layer };
  const Rect whole{ 0, 0, testHeader.Width, testHeader.Height };
  options.Region = whole.clipped(testHeader.DataWindow).clipped(referenceHeader.DataWindow);
  if (options.Region.empty())
  {
    throw StageError("the images have no pixel in common: their data windows do not overlap");
  }
  if (options.Region != whole)
  {
    std::fprintf(stderr, "quell: warning: comparing the %d x %d pixels that both files hold\n", options.Region.width(),
      options.Region.height());
  }
  const vtkSmartPointer<vtkImageData> testImage = ReadImageFile(a.Test, nullptr, options);
  const vtkSmartPointer<vtkImageData> referenceImage = ReadImageFile(a.Reference, nullptr, options);
  const ImageIn test = View(testImage, a.Test, layer), reference = View(referenceImage, a.Reference, layer);

  nlohmann::json out = { { "test", a.Test }, { "reference", a.Reference }, { "layer", layer } };
  out["metrics"] = nlohmann::json::object();
  out["exceeded"] = nlohmann::json::array();
  std::vector<std::pair<std::string, double>> values;
  for (const std::string& m : metrics)
  {
    try
    {
      values.emplace_back(m, ComputeMetric(m, test, reference));
      out["metrics"][m] = values.back().second;
    }
    catch (const StageError&)
    {
      // Of the usual set, what an image cannot have (FLIP of depth, SSIM of ten pixels) is left out; an image that no
      // metric can be computed of is an error.
      if (chosen || (m == metrics.back() && values.empty()))
      {
        throw;
      }
    }
  }
  bool exceeded = false;
  std::string verdicts;
  for (const auto& limit : maxima)
  {
    for (const auto& v : values)
    {
      // Written so that a value that is not a number exceeds too.
      if (v.first == limit.first && !(v.second <= limit.second))
      {
        exceeded = true;
        out["exceeded"].push_back(v.first);
        verdicts += "quell: " + v.first + " is " + detail::FormatDouble(v.second) + ", more than " +
                    detail::FormatDouble(limit.second) + "\n";
      }
    }
  }
  double scale = 0;
  if (!a.Map.empty())
  {
    const std::string metric = values.front().first;
    scale = WriteMap(a.Map, metric, test, reference);
    out["map"] = { { "file", a.Map }, { "metric", metric }, { "brightest", scale } };
  }
  if (a.Json)
  {
    std::printf("%s\n", out.dump(2).c_str());
  }
  else
  {
    std::size_t width = 0;
    for (const auto& v : values)
    {
      width = std::max(width, v.first.size());
    }
    for (const auto& v : values)
    {
      std::printf("%-*s  %.6g\n", int(width), v.first.c_str(), v.second);
    }
    if (!a.Map.empty())
    {
      std::printf(
        "wrote %s: %s of each pixel, brightest at %.4g\n", a.Map.c_str(), values.front().first.c_str(), scale);
    }
  }
  std::fflush(stdout);
  std::fputs(verdicts.c_str(), stderr);
  return exceeded ? ExitExceeded : ExitDone;
}
}
