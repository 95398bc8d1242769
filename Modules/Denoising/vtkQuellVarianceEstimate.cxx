// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellVarianceEstimate.h"

#include "quellVariance.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellVarianceEstimate);
QUELL_STAGE_DESCRIPTION(vtkQuellVarianceEstimate)

namespace
{
enum Ports
{
  Radiance,
  Moments,
  Length,
  Depth,
  Normal,
  Id
};
constexpr int RowsPerTask = 8;
}

void vtkQuellVarianceEstimate::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellVarianceEstimate;
  d.Category = "Denoising";
  d.Brief = "Estimates the variance of luminance: over frames where there were enough, else over neighbours.";
  d.Details = "With `length >= MinimumHistory` the variance is the central second moment over frames and the colour "
              "passes through. Else "
              "both are means over 7 x 7 pixels with SVGF's depth and normal weights, the variance raised by "
              "`MinimumHistory / length`; "
              "a pixel without usable neighbours gets its squared luminance, because 0 would freeze it unfiltered. "
              "Without `moments` "
              "every pixel is estimated in space; without `length` the moments are trusted everywhere. Taps outside "
              "the image, not "
              "finite, of another id or without a hit have weight 0. A non-finite pixel becomes the weighted mean of "
              "its neighbours. "
              "Background passes through with variance 0. Source: Schied et al. 2017, section 4.2.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "accumulated illumination");
  d.OptionalInput(
    "moments", quell::ArrayKind::Moments, "moments", "mean and central second moment of luminance over frames");
  d.OptionalInput("length", quell::ArrayKind::History, "history", "frames in the moments");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide of the spatial estimate");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide of the spatial estimate");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.Output("variance", quell::ArrayKind::Variance, "variance of luminance");
  d.Output("radiance", quell::ArrayKind::Color, "the input; its neighbourhood's mean where the variance is spatial");
  QUELL_INT(d, MinimumHistory, "frames", "length from which the moments are used");
  QUELL_ENUM(d, VarianceOf,
    "whose variance: of one frame's pixel, as SVGF has it, or of the mean of min(length, MaximumSamples) frames",
    "Frame", "Mean");
  QUELL_DOUBLE(d, MaximumSamples, "frames", "what an endless history is worth: (2 - alpha) / alpha");
  QUELL_DOUBLE(d, SigmaDepth, "", "depth tolerance in units of the local slope");
  QUELL_DOUBLE(d, SigmaNormal, "", "exponent of the cosine between normals; 0: normals do not matter");
  QUELL_DOUBLE(d, DepthEpsilon, "", "depth tolerance without slope, relative to depth");
}

vtkQuellVarianceEstimate::vtkQuellVarianceEstimate()
{
  this->InitializePorts();
}

int vtkQuellVarianceEstimate::HaloFor(int) const
{
  return quell::VariancePass::Radius;
}

void vtkQuellVarianceEstimate::Execute(quell::StageFrame& frame)
{
  const quell::Rect region = frame.Region();
  const quell::Rect read = region.grown(quell::VariancePass::Radius).clipped(frame.Whole());
  const quell::ImageIn color = frame.Input(Radiance), moments = frame.Input(Moments), length = frame.Input(Length);
  const quell::ImageIn depth = frame.Input(Depth), normal = frame.Input(Normal), id = frame.Input(Id);
  const quell::ImageOut colorOut = frame.Output("radiance");

  quell::VariancePass pass;
  const bool temporal = bool(moments) || bool(length);
  this->Planes.Begin(read, quell::VariancePass::Radius, 12, depth, normal, id);
  pass.in = this->Planes.TakeColor(true, true, false);
  pass.out = this->Planes.TakeColor(bool(colorOut), false, true);
  pass.moments.mean = this->Planes.Take(bool(moments));
  pass.moments.central = this->Planes.Take(bool(moments));
  pass.moments.history = this->Planes.Take(temporal);
  pass.guides = this->Planes.Guides;
  pass.sigmaDepth = float(this->SigmaDepth);
  pass.sigmaNormal = float(this->SigmaNormal);
  pass.depthEpsilon = float(this->DepthEpsilon);
  pass.minimumHistory = float(this->MinimumHistory);
  pass.ofMean = this->VarianceOf == 1;
  pass.maximumSamples = float(this->MaximumSamples);

  this->NonFinite.Reset();
  const auto rows = [this](const quell::Rect& r, auto&& body)
  {
    this->ForEachTile(
      { 0, r.y0, 1, r.y1 }, RowsPerTask, [&body](const quell::Rect& strip) { body(strip.y0, strip.y1); });
  };
  this->Planes.Fill(rows,
    [&](int y0, int y1)
    {
      this->NonFinite.Add(quell::CopyColor(color, quell::ImageIn(), pass.guides, pass.in, y0, y1, region));
      if (temporal)
        quell::CopyMoments(moments, length, pass.guides.layout, pass.in, pass.moments, pass.minimumHistory, y0, y1);
    });
  rows(region,
    [&](int y0, int y1)
    {
      for (int y = y0; y < y1; ++y)
        quell::VarianceRow(pass, y, region.x0, region.x1);
      quell::StoreFiltered(pass.guides, pass.out, color, quell::ImageIn(), colorOut, frame.Output("variance"),
        { region.x0, y0, region.x1, y1 });
    });
  constexpr int side = 2 * quell::VariancePass::Radius + 1;
  this->Counters.Taps += region.area() * side * side;
  this->NonFinite.Report(this->Counters, this->Warnings, "radiance");
}
