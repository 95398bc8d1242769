// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellAlbedoDemodulate.h"

#include "quellDemodulate.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellAlbedoDemodulate);
QUELL_STAGE_DESCRIPTION(vtkQuellAlbedoDemodulate)

namespace
{
enum Ports
{
  Radiance,
  Albedo
};
}

void vtkQuellAlbedoDemodulate::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellAlbedoDemodulate;
  d.Category = "Denoising";
  d.Brief = "Divides a layer by its albedo, so that filters do not blur textures.";
  d.Details =
    "`illumination = radiance / clamp(albedo, Floor, 1)` per channel. `AlbedoModulate` with the same `Floor` gives "
    "the radiance back to one unit in the last place, also where the albedo is 0. A non-finite albedo counts as 1. "
    "A pixel with non-finite radiance gets the mean of its finite neighbours' illumination (0 if there are none).";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "the layer");
  d.OptionalInput("albedo", quell::ArrayKind::Albedo, "albedo", "the reflectance that the layer holds; without it 1");
  d.Output("illumination", quell::ArrayKind::Color, "the layer divided by its albedo")
    .AtMost(1, { "radiance" })
    .DividedBy("Floor");
  QUELL_DOUBLE(d, Floor, "", "smallest divisor; AlbedoModulate must use the same");
}

vtkQuellAlbedoDemodulate::vtkQuellAlbedoDemodulate()
{
  this->InitializePorts();
}

int vtkQuellAlbedoDemodulate::HaloFor(int) const
{
  return 1; // a non-finite pixel is filled from its neighbours
}

void vtkQuellAlbedoDemodulate::Execute(quell::StageFrame& frame)
{
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->Superclass::Execute(frame);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
}

void vtkQuellAlbedoDemodulate::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  this->NonFinite.Count(tile,
    [&](const quell::Rect& part)
    {
      return quell::Demodulate(
        frame.Input(Radiance), frame.Input(Albedo), float(this->Floor), frame.Output("illumination"), part);
    });
}
