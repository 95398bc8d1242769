// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellAlbedoModulate.h"

#include "quellDemodulate.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellAlbedoModulate);
QUELL_STAGE_DESCRIPTION(vtkQuellAlbedoModulate)

namespace
{
enum Ports
{
  Illumination,
  Albedo
};
}

void vtkQuellAlbedoModulate::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellAlbedoModulate;
  d.Category = "Denoising";
  d.Brief = "Multiplies illumination by its albedo: the inverse of AlbedoDemodulate.";
  d.Details =
    "`radiance = illumination * clamp(albedo, Floor, 1)` per channel, with the floor of the `AlbedoDemodulate` "
    "before. A non-finite albedo counts as 1. A non-finite illumination is replaced by the mean of its finite "
    "neighbours (0 if there are none).";
  d.Input("illumination", quell::ArrayKind::Color, "illumination", "filtered illumination");
  d.OptionalInput("albedo", quell::ArrayKind::Albedo, "albedo", "the reflectance that was divided out; without it 1");
  d.Output("radiance", quell::ArrayKind::Color, "the layer with its albedo").AtMost(1, { "illumination" });
  QUELL_DOUBLE(d, Floor, "", "smallest factor; the same as in AlbedoDemodulate");
}

vtkQuellAlbedoModulate::vtkQuellAlbedoModulate()
{
  this->InitializePorts();
}

int vtkQuellAlbedoModulate::HaloFor(int port) const
{
  return port == Illumination ? 1 : 0; // a non-finite pixel is filled from its neighbours
}

void vtkQuellAlbedoModulate::Execute(quell::StageFrame& frame)
{
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->Superclass::Execute(frame);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "illumination");
}

void vtkQuellAlbedoModulate::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  this->NonFinite.Count(tile,
    [&](const quell::Rect& part)
    {
      return quell::Modulate(
        frame.Input(Illumination), frame.Input(Albedo), float(this->Floor), frame.Output("radiance"), part);
    });
}
