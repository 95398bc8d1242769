// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellEmissionSplit.h"

#include "quellEmissionSplit.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellEmissionSplit);
QUELL_STAGE_DESCRIPTION(vtkQuellEmissionSplit)

void vtkQuellEmissionSplit::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellEmissionSplit;
  d.Category = "Denoising";
  d.Brief = "Takes lamps seen directly out of a frame that has no emission pass.";
  d.Details =
    "A pixel is bright when its luminance exceeds `Threshold` and so do `Neighbours` of the 8 around it (a lamp is an "
    "area, a firefly is not); a lamp is a bright pixel, or one that is brighter than EdgePart times the brightest of "
    "the bright ones at most `Grow` columns and rows away. `emission` is the input in lamps and `radiance` elsewhere, "
    "else 0: their sum is the "
    "input to the last bit. Give `mask` to the filters that follow as a guide with distance `Id`. Nothing outside the "
    "image is bright; a pixel that is not finite becomes the mean of its finite neighbours, in `emission` if that is a "
    "lamp's edge, else in `radiance`.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "the beauty");
  d.Output("radiance", quell::ArrayKind::Color, "everything but lamps").Part("radiance");
  d.Output("emission", quell::ArrayKind::Color, "lamps").Part("radiance");
  d.Output("mask", quell::ArrayKind::Scalar, "1 in lamps, else 0").Within(0, 1);
  QUELL_DOUBLE(d, Threshold, "", "luminance that only light sources have; 1e30: there are none");
  QUELL_INT(
    d, Neighbours, "pixels", "of the 8 around a bright pixel, so many must be bright; 0: fireflies are lamps too");
  QUELL_INT(d, Grow, "pixels", "how far around a lamp pixels may show a part of it");
  QUELL_DOUBLE(d, EdgePart, "", "of the lamp's luminance: how bright a pixel of its edge is at least");
}

vtkQuellEmissionSplit::vtkQuellEmissionSplit()
{
  this->InitializePorts();
}

int vtkQuellEmissionSplit::HaloFor(int) const
{
  return 1 + this->Grow;
}

void vtkQuellEmissionSplit::Execute(quell::StageFrame& frame)
{
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->Superclass::Execute(frame);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
}

void vtkQuellEmissionSplit::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  this->NonFinite.Count(tile,
    [&](const quell::Rect& part)
    {
      quell::EmissionSplitParameters p;
      p.threshold = float(this->Threshold);
      p.neighbours = this->Neighbours;
      p.grow = this->Grow;
      p.edgePart = float(this->EdgePart);
      return quell::EmissionSplit(
        frame.Input(0), p, frame.Output("emission"), frame.Output("radiance"), frame.Output("mask"), part);
    });
}
