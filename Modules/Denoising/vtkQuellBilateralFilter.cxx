// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellBilateralFilter.h"

#include "quellBilateral.h"
#include "vtkObjectFactory.h"

#include <cmath>

vtkStandardNewMacro(vtkQuellBilateralFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellBilateralFilter)

namespace
{
enum Ports
{
  Radiance,
  Depth,
  Normal,
  Albedo,
  Position,
  Id
};
constexpr int LargestRadius = 64;
}

void vtkQuellBilateralFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellBilateralFilter;
  d.Category = "Denoising";
  d.Brief = "Bilateral filter; with guides a cross-bilateral filter.";
  d.Details =
    "`w = exp(-(|q-p|^2 / 2 ss^2 + |R(q)-R(p)|^2 / 2 sr^2 + |n(q)-n(p)|^2 / 2 sn^2 + |a(q)-a(p)|^2 / 2 sa^2 + D^2 / 2 "
    "sd^2))` "
    "over the square of `Radius`, with the colour R in the space `Range` and D the relative depth difference or, with "
    "positions and normals, the distance from the centre's tangent plane relative to depth. A sigma of 0 lets only "
    "equal "
    "values pass; 1e30 removes its term. Taps outside the image, not finite, of another id or without a hit have "
    "weight 0; a "
    "non-finite pixel becomes the weighted mean of its neighbours; background passes through. Sources: Tomasi and "
    "Manduchi "
    "1998; Petschnigg et al. 2004; Eisemann and Durand 2004.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what is filtered; illumination rather than radiance");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide");
  d.OptionalInput("albedo", quell::ArrayKind::Albedo, "albedo", "guide");
  d.OptionalInput("position", quell::ArrayKind::Position, "position",
    "with depth and normal: compares by plane distance instead of depth");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input");
  QUELL_INT(d, Radius, "pixels", "half the window's side; -1: ceil(3 SigmaSpatial), at most 64; 0: identity");
  QUELL_DOUBLE(d, SigmaSpatial, "pixels", "standard deviation in distance; 0: identity");
  QUELL_DOUBLE(d, SigmaRange, "", "standard deviation in colour, in the units of Range");
  QUELL_ENUM(
    d, Range, "what colours are compared in: c, c / (1 + luminance), log(1 + c)", "Linear", "ToneMapped", "Log");
  QUELL_DOUBLE(d, SigmaNormal, "", "standard deviation of the length of the difference of normals");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of depth or plane distance, relative to depth");
  QUELL_DOUBLE(d, SigmaAlbedo, "", "standard deviation of the albedo difference");
}

vtkQuellBilateralFilter::vtkQuellBilateralFilter()
{
  this->InitializePorts();
}

int vtkQuellBilateralFilter::EffectiveRadius() const
{
  if (this->Radius >= 0)
    return this->Radius;
  return int(std::min(double(LargestRadius), std::ceil(3 * this->SigmaSpatial)));
}

int vtkQuellBilateralFilter::HaloFor(int) const
{
  return std::max(1, this->EffectiveRadius()); // 1: a non-finite pixel is filled from its neighbours
}

void vtkQuellBilateralFilter::Execute(quell::StageFrame& frame)
{
  this->NonFinite.Reset();
  this->Superclass::Execute(frame);
  this->NonFinite.Report(this->Counters, this->Warnings, "radiance");
  const std::int64_t side = 2 * this->EffectiveRadius() + 1;
  this->Counters.Taps += frame.Region().area() * side * side;
}

void vtkQuellBilateralFilter::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  quell::BilateralInputs in;
  in.radiance = frame.Input(Radiance);
  in.depth = frame.Input(Depth);
  in.normal = frame.Input(Normal);
  in.albedo = frame.Input(Albedo);
  in.position = frame.Input(Position);
  in.id = frame.Input(Id);
  quell::BilateralParameters p;
  p.radius = this->EffectiveRadius();
  p.sigmaSpatial = this->SigmaSpatial;
  p.sigmaRange = this->SigmaRange;
  p.range = quell::RangeSpace(this->Range);
  p.sigmaNormal = this->SigmaNormal;
  p.sigmaDepth = this->SigmaDepth;
  p.sigmaAlbedo = this->SigmaAlbedo;
  static thread_local quell::Scratch scratch;
  this->NonFinite.Add(
    quell::Bilateral(in, p, frame.Output("radiance"), tile, scratch.Take(quell::BilateralScratch(in, p, tile))));
}
