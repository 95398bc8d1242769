// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellATrousFilter.h"

#include "quellATrous.h"
#include "vtkObjectFactory.h"

#include <cmath>
#include <vector>

vtkStandardNewMacro(vtkQuellATrousFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellATrousFilter)

namespace
{
enum Ports
{
  Radiance,
  Variance,
  Depth,
  Normal,
  Id
};
constexpr int RowsPerTask = 16, RowsPerPassTask = 48;
}

void vtkQuellATrousFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellATrousFilter;
  d.Category = "Denoising";
  d.Brief = "Edge-avoiding a-trous wavelet filter, guided by variance, depth and normals (SVGF).";
  d.Details = "`Iterations` passes of the 5 x 5 B3 spline kernel with steps 1, 2, 4 ... Each tap is weighted by "
              "`exp(-|dz| / (SigmaDepth |slope . dq| + DepthEpsilon z))`, `max(0, n.n')^SigmaNormal` and "
              "`exp(-|dl| / (SigmaLuminance sqrt(g) + LuminanceEpsilon (1 + l)))`, g being the variance blurred over 3 "
              "x 3 pixels. "
              "The variance is filtered with the squared weights; it tightens the luminance weight from pass to pass "
              "and is no error bar. "
              "Without `variance` the luminance tolerance is `SigmaColor`, halved in every pass. Taps outside the "
              "image, not finite, of "
              "another id or without a hit have weight 0; a non-finite pixel becomes the weighted mean of its "
              "neighbours; background "
              "passes through. Sources: Schied et al. 2017; Dammertz et al. 2010.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what is filtered; illumination rather than radiance");
  d.OptionalInput("variance", quell::ArrayKind::Variance, "variance", "variance of its luminance");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input").Mean({ "radiance" }).Limited(-1e35, 3.4e38);
  d.Output("variance", quell::ArrayKind::Variance, "the propagated variance").AtMost(1, { "variance" });
  d.Output("feedback", quell::ArrayKind::Color, "the colour after pass FeedbackIteration").Mean({ "radiance" }).Limited(-1e35, 3.4e38);
  QUELL_INT(d, Iterations, "passes", "0: identity; the region grows by 2 (2^Iterations - 1) pixels");
  QUELL_DOUBLE(d, SigmaDepth, "", "depth tolerance in units of the local slope");
  QUELL_DOUBLE(d, SigmaNormal, "", "exponent of the cosine between normals; 0: normals do not matter");
  QUELL_DOUBLE(d, SigmaLuminance, "", "luminance tolerance in standard deviations");
  QUELL_DOUBLE(d, SigmaColor, "", "luminance tolerance of the first pass where no variance is connected");
  QUELL_INT(d, FeedbackIteration, "passes", "after which pass output feedback is taken; 0: the input");
  QUELL_DOUBLE(d, DepthEpsilon, "", "depth tolerance without slope, relative to depth");
  QUELL_DOUBLE(d, LuminanceEpsilon, "", "luminance tolerance without variance, relative to 1 + luminance");
}

vtkQuellATrousFilter::vtkQuellATrousFilter()
{
  this->InitializePorts();
}

int vtkQuellATrousFilter::HaloFor(int port) const
{
  const int halo = std::max(1, quell::ATrousHalo(this->Iterations));
  return port == Variance ? halo + 1 : halo; // a variance that is not a number is filled from its neighbours
}

double vtkQuellATrousFilter::ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet&)
{
  const int reach = std::max(1, this->Iterations > 0 ? 2 << (this->Iterations - 1) : 1);
  const quell::PlaneLayout layout(region.grown(quell::ATrousHalo(this->Iterations)).clipped(whole), reach);
  return quell::GuidedPlanes::Most(10) * double(layout.size()) * sizeof(float);
}

void vtkQuellATrousFilter::Execute(quell::StageFrame& frame)
{
  const quell::Rect region = frame.Region();
  const quell::ImageIn color = frame.Input(Radiance), variance = frame.Input(Variance);
  const quell::ImageIn depth = frame.Input(Depth), normal = frame.Input(Normal), id = frame.Input(Id);
  const quell::ImageOut colorOut = frame.Output("radiance"), varianceOut = frame.Output("variance");
  const quell::ImageOut feedbackOut = frame.Output("feedback");
  if (varianceOut && !variance)
    this->Warnings.push_back("output variance is 0 because input variance is not connected");

  const int feedbackAfter = std::min(this->FeedbackIteration, this->Iterations);
  const int passes = colorOut || varianceOut ? this->Iterations : feedbackAfter;
  // regions[k]: what pass k reads. The large steps come last, so the region shrinks slowly at first.
  std::vector<quell::Rect> regions(passes + 1);
  regions[passes] = region;
  for (int k = passes - 1; k >= 0; --k)
    regions[k] = regions[k + 1].grown(2 << k).clipped(frame.Whole());
  const quell::Rect read = regions[0];

  quell::ATrousPass pass;
  this->Planes.Begin(read, std::max(1, passes ? 2 << (passes - 1) : 1), 10, depth, normal, id);
  pass.in = this->Planes.TakeColor(true, true, bool(variance));
  pass.out = this->Planes.TakeColor(true, true, bool(variance));
  pass.guides = this->Planes.Guides;
  pass.sigmaDepth = float(this->SigmaDepth);
  pass.sigmaNormal = float(this->SigmaNormal);
  pass.sigmaLuminance = float(this->SigmaLuminance);
  pass.depthEpsilon = float(this->DepthEpsilon);
  pass.luminanceEpsilon = float(this->LuminanceEpsilon);

  this->NonFinite.Begin(frame.Region(), frame.Tick());
  const quell::Rect counted = this->NonFinite.CountedRegion();
  const auto rows = [this](const quell::Rect& r, auto&& body)
  {
    this->ForEachTile(
      { 0, r.y0, 1, r.y1 }, RowsPerTask, [&body](const quell::Rect& strip) { body(strip.y0, strip.y1); });
  };
  this->Planes.Fill(rows,
    [&](int y0, int y1)
    {
      this->NonFinite.Add(counted, quell::CopyColor(color, variance, pass.guides, pass.in, y0, y1, counted));
      quell::ClearPadding(pass.guides.layout, pass.out, y0, y1);
    });

  const auto store = [&](const quell::ImageOut& toColor, const quell::ImageOut& toVariance)
  {
    rows(region,
      [&](int y0, int y1)
      {
        quell::StoreFiltered(
          pass.guides, pass.in, color, variance, toColor, toVariance, { region.x0, y0, region.x1, y1 });
      });
  };
  if (feedbackOut && feedbackAfter == 0)
    store(feedbackOut, quell::ImageOut());
  for (int k = 0; k < passes; ++k)
  {
    pass.step = 1 << k;
    pass.fixedSigma = float(std::ldexp(this->SigmaColor, -k));
    const quell::Rect made = regions[k + 1];
    // A task takes every step-th row: rows whose taps lie on each other's rows share work and cache.
    const int tasksPerPhase = (made.height() + pass.step * RowsPerPassTask - 1) / (pass.step * RowsPerPassTask);
    this->ForEachTile({ 0, 0, pass.step * tasksPerPhase, 1 }, 1,
      [&](const quell::Rect& task)
      {
        const int phase = task.x0 / tasksPerPhase, first = task.x0 % tasksPerPhase * RowsPerPassTask;
        const int y = made.y0 + phase + first * pass.step;
        const int count = std::min(RowsPerPassTask, (made.y1 - y + pass.step - 1) / pass.step);
        if (count > 0)
          quell::ATrousRows(pass, y, count, made.x0, made.x1);
      });
    this->Counters.Taps += made.area() * 25;
    std::swap(pass.in, pass.out);
    if (feedbackOut && k + 1 == feedbackAfter)
      store(feedbackOut, quell::ImageOut());
  }
  if (colorOut || varianceOut)
    store(colorOut, varianceOut);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
}

void vtkQuellATrousFilter::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  const quell::ImageIn color = frame.Input(Radiance), variance = frame.Input(Variance);
  const quell::ImageIn depth = frame.Input(Depth), normal = frame.Input(Normal), id = frame.Input(Id);
  const int passes = this->Iterations;
  std::vector<quell::Rect> regions(std::size_t(passes) + 1);
  regions.back() = frame.Region();
  for (int k = passes - 1; k >= 0; --k)
    regions[std::size_t(k)] = regions[std::size_t(k) + 1].grown(2 << k).clipped(frame.Whole());
  const quell::Rect read = regions[0];
  if (double(read.area()) * (passes + 4) > 5e7)
    throw quell::StageError(
      "so many passes reach " + std::to_string(read.area()) + " pixels, too many to say what each of them weighs");

  // What every pass reads, and two sets of planes for marks, which have a colour of their own but the luminance (and
  // variance) that decides the weights.
  quell::GuidedPlanes planes;
  planes.Begin(read, std::max(1, passes ? 2 << (passes - 1) : 1), 5 * (passes + 1) + 8, depth, normal, id);
  std::vector<quell::ColorPlanes> stages;
  for (int k = 0; k <= passes; ++k)
    stages.push_back(planes.TakeColor(true, true, bool(variance)));
  const quell::ColorPlanes marks = planes.TakeColor(true, false, false);
  const quell::ColorPlanes result = planes.TakeColor(true, true, bool(variance));
  quell::ATrousPass pass;
  pass.guides = planes.Guides;
  pass.sigmaDepth = float(this->SigmaDepth);
  pass.sigmaNormal = float(this->SigmaNormal);
  pass.sigmaLuminance = float(this->SigmaLuminance);
  pass.depthEpsilon = float(this->DepthEpsilon);
  pass.luminanceEpsilon = float(this->LuminanceEpsilon);
  const quell::PlaneLayout& layout = pass.guides.layout;
  planes.Fill([](const quell::Rect& r, auto&& body) { body(r.y0, r.y1); },
    [&](int y0, int y1)
    {
      quell::CopyColor(color, variance, pass.guides, stages[0], y0, y1, quell::Rect());
      for (int k = 1; k <= passes; ++k)
        quell::ClearPadding(layout, stages[std::size_t(k)], y0, y1);
      quell::ClearPadding(layout, result, y0, y1);
    });
  for (float* plane : marks.color)
    std::fill_n(plane, layout.size(), 0.f);
  const auto run = [&](int k, const quell::ColorPlanes& from, const quell::ColorPlanes& to)
  {
    pass.in = from;
    pass.out = to;
    pass.step = 1 << k;
    pass.fixedSigma = float(std::ldexp(this->SigmaColor, -k));
    const quell::Rect& made = regions[std::size_t(k) + 1];
    for (int phase = 0; phase < pass.step && made.y0 + phase < made.y1; ++phase)
      quell::ATrousRows(pass, made.y0 + phase, (made.height() - phase + pass.step - 1) / pass.step, made.x0, made.x1);
  };
  for (int k = 0; k < passes; ++k)
    run(k, stages[std::size_t(k)], stages[std::size_t(k) + 1]);

  // From the last pass to the first: the weight of each pixel is handed to those that made it. Of the 25 taps of a
  // pixel exactly one falls into each of 25 classes, so marking a class tells one tap's weight in every pixel.
  std::vector<double> now(std::size_t(read.area()), 0.), next;
  const auto at = [&read](int x, int y)
  { return std::size_t(y - read.y0) * std::size_t(read.width()) + std::size_t(x - read.x0); };
  now[at(frame.Region().x0, frame.Region().y0)] = 1;
  for (int k = passes - 1; k >= 0; --k)
  {
    const int step = 1 << k;
    const quell::Rect& made = regions[std::size_t(k) + 1];
    const auto classOf = [&](int x, int y) { return (y - read.y0) / step % 5 * 5 + (x - read.x0) / step % 5; };
    next.assign(now.size(), 0.);
    quell::ColorPlanes in = stages[std::size_t(k)];
    for (int c = 0; c < 3; ++c)
      in.color[c] = marks.color[c];
    for (int first = 0; first < 25; first += 3)
    {
      for (int y = read.y0; y < read.y1; ++y)
        for (int x = read.x0; x < read.x1; ++x)
          for (int c = 0; c < 3; ++c)
            marks.color[c][layout.at(x, y)] = classOf(x, y) == first + c ? 1.f : 0.f;
      run(k, in, result);
      for (int y = made.y0; y < made.y1; ++y)
        for (int x = made.x0; x < made.x1; ++x)
        {
          const double weight = now[at(x, y)];
          if (weight == 0)
            continue;
          for (int dy = -2; dy <= 2; ++dy)
            for (int dx = -2; dx <= 2; ++dx)
            {
              const int qx = x + dx * step, qy = y + dy * step;
              if (!read.contains(qx, qy))
                continue;
              const int channel = classOf(qx, qy) - first;
              if (channel >= 0 && channel < 3)
                next[at(qx, qy)] += weight * double(result.color[channel][layout.at(x, y)]);
            }
        }
    }
    std::swap(now, next);
  }
  quell::PixelWeights::Part part;
  part.Input = "radiance";
  part.Window = read;
  part.Weights.assign(now.begin(), now.end());
  weights.Parts.push_back(std::move(part));
}
