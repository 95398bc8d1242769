// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellCompareImages.h"

#include "quellMetrics.h"
#include "vtkObjectFactory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

vtkStandardNewMacro(vtkQuellCompareImages);
QUELL_STAGE_DESCRIPTION(vtkQuellCompareImages)

namespace
{
enum Port
{
  Image,
  Reference,
  Baseline
};

std::string SizeText(const quell::Rect& r)
{
  return std::to_string(r.width()) + " x " + std::to_string(r.height());
}

std::string Format(const char* format, double v)
{
  char text[64];
  std::snprintf(text, sizeof(text), format, v);
  return text;
}

bool SameCamera(const quell::FrameFacts& a, const quell::FrameFacts& b)
{
  double largest = 0, difference = 0;
  for (int i : { 0, 1, 3 })
    for (int j = 0; j < 4; ++j)
    {
      largest = std::max(largest, std::fabs(a.WorldToNdc.m[i][j]));
      difference = std::max(difference, std::fabs(a.WorldToNdc.m[i][j] - b.WorldToNdc.m[i][j]));
    }
  const double shift = quell::Length(a.Origin - b.Origin);
  return difference <= 1e-4 * largest && shift <= 1e-4 * std::max(1., quell::Length(a.Origin));
}

/// Whole images crop to the pixels that were computed.
quell::ImageIn Crop(const quell::ImageIn& v, const quell::Rect& r)
{
  return v ? quell::ImageIn(v.at(r.x0, r.y0), v.components, r, v.rowStride) : v;
}

std::string Sentence(const std::string& metric, double value, const double* noisy)
{
  const bool psnr = metric.compare(0, 4, "PSNR") == 0;
  const char* number = psnr ? "%.2f dB" : "%.3g";
  std::string text = metric + " " + Format(number, value);
  if (!noisy)
    return text;
  const std::string theirs = " the noisy input's " + Format(number, *noisy);
  if (psnr)
    return text + ", " + Format("%.2f dB", std::fabs(value - *noisy)) + (value >= *noisy ? " above" : " below") +
           theirs;
  if (quell::HigherIsBetter(metric))
    return text + ", " + (value >= *noisy ? "above" : "below") + theirs;
  if (value == *noisy)
    return text + ", the same as" + theirs;
  if (!(value > 0) || !(*noisy > 0))
    return text + (value < *noisy ? ", lower than" : ", higher than") + theirs;
  return text + ", " + Format("%.3g", value < *noisy ? *noisy / value : value / *noisy) + " times " +
         (value < *noisy ? "lower" : "higher") + " than" + theirs;
}
}

vtkQuellCompareImages::vtkQuellCompareImages()
{
  this->InitializePorts();
}

void vtkQuellCompareImages::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellCompareImages;
  using quell::ArrayKind;
  d.Category = "Metrics";
  d.Brief = "Measures an image against a reference and reports it in one line.";
  std::string names;
  for (const std::string& name : quell::MetricNames())
    names += (names.empty() ? "" : ", ") + name;
  d.Details = "Metrics: " + names +
              ".\n\nWhere the reference has another size, or (as far as both frames say) another scene or camera, or a "
              "pixel is not "
              "finite, the report says `not compared` and why, and a warning is kept; the run goes on.";
  d.Sink = true;
  d.Input("image", ArrayKind::Color, "radiance", "the image to judge");
  d.Input("reference", ArrayKind::Color, "radiance", "what it should look like; may have another size");
  d.OptionalInput("baseline", ArrayKind::Color, "radiance", "what to compare the error with: the noisy input");
  d.Output("error", ArrayKind::Scalar, "relMSE of each pixel")
    .Finite("squares of differences, relative to what may be 0");
  QUELL_STRING(d, Metrics, "metric names, separated by blanks");
  QUELL_INT(d, Tick, "", "compare at this tick only; -1: at every tick");
  QUELL_STRING(d, Label, "what the report calls the image");
}

void vtkQuellCompareImages::SetMetrics(const std::string& names)
{
  if (names == this->Metrics)
    return;
  this->Metrics = names;
  this->Modified();
}

void vtkQuellCompareImages::SetLabel(const std::string& label)
{
  if (label == this->Label)
    return;
  this->Label = label;
  this->Modified();
}

bool vtkQuellCompareImages::AllowsOtherExtent(int port) const
{
  return port == Reference;
}

std::string vtkQuellCompareImages::GetReport() const
{
  return this->Report.empty() ? this->Report : this->Label + ": " + this->Report;
}

// One metric after the other; a name that is none is refused elsewhere.
double vtkQuellCompareImages::ScratchBytes(const quell::Rect& region, const quell::Rect&, const quell::ArraySet&)
{
  double most = 0;
  std::istringstream names(this->Metrics);
  const std::vector<std::string> known = quell::MetricNames();
  for (std::string name; names >> name;)
    if (std::count(known.begin(), known.end(), name))
      most = std::max(most, quell::MetricScratchBytes(name));
  return most * double(region.area());
}

std::string vtkQuellCompareImages::ReferenceName()
{
  auto* producer = vtkQuellStage::SafeDownCast(this->GetInputAlgorithm(Reference, 0));
  if (producer)
    for (const quell::Property& p : producer->GetDescription().Properties)
      if (p.Kind == quell::Property::Type::Path)
      {
        const std::string path = p.GetText(producer);
        return path.substr(path.find_last_of('/') + 1);
      }
  return std::string();
}

std::string vtkQuellCompareImages::Compare(quell::StageFrame& frame)
{
  const quell::ImageIn whole = frame.Input(Reference);
  if (whole.extent.width() != frame.Whole().width() || whole.extent.height() != frame.Whole().height())
    throw quell::StageError("the reference is " + SizeText(whole.extent) + ", the image " + SizeText(frame.Whole()));
  const quell::FrameFacts ours = frame.Facts(Image), theirs = frame.Facts(Reference);
  if (!ours.Scene.empty() && !theirs.Scene.empty() && ours.Scene != theirs.Scene)
    throw quell::StageError("the reference is of another scene");
  if (ours.HasCamera && theirs.HasCamera && !SameCamera(ours, theirs))
    throw quell::StageError("the reference is of another camera");

  const quell::Rect region = frame.Region();
  const quell::ImageIn image = Crop(frame.Input(Image), region), baseline = Crop(frame.Input(Baseline), region);
  // The reference may sit elsewhere in its own coordinates.
  const quell::Rect& e = whole.extent;
  const int dx = e.x0 - frame.Whole().x0, dy = e.y0 - frame.Whole().y0;
  const quell::ImageIn reference = Crop(whole, { region.x0 + dx, region.y0 + dy, region.x1 + dx, region.y1 + dy });

  std::string report;
  std::istringstream names(this->Metrics);
  for (std::string name; names >> name;)
  {
    const double value = quell::ComputeMetric(name, image, reference);
    double noisy = 0;
    if (baseline)
      noisy = quell::ComputeMetric(name, baseline, reference);
    report += (report.empty() ? "" : "; ") + Sentence(name, value, baseline ? &noisy : nullptr);
  }
  if (const quell::ImageOut map = frame.Output("error"))
    quell::ComputeErrorMap("relMSE", image, reference, map);
  const std::string name = this->ReferenceName();
  return name.empty() ? report : report + " (reference " + name + ")";
}

void vtkQuellCompareImages::DescribeSource(int& width, int& height)
{
  width = height = 0;
  std::istringstream names(this->Metrics);
  int count = 0;
  for (std::string name; names >> name; ++count)
    quell::HigherIsBetter(name);
  if (count == 0)
    throw quell::StageError("Metrics names no metric");
}

void vtkQuellCompareImages::Execute(quell::StageFrame& frame)
{
  if (this->Tick >= 0 && frame.Tick() != this->Tick)
  {
    if (this->Report.empty())
      this->Report = "not compared: tick " + std::to_string(this->Tick) + " was not among the frames";
    return;
  }
  try
  {
    this->Report = this->Compare(frame);
  }
  catch (const quell::StageError& error)
  {
    this->Report = std::string("not compared: ") + error.what();
    this->Warnings.push_back(this->Report);
  }
}
