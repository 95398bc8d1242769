// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellFireflyClamp.h"

#include "quellFireflyClamp.h"
#include "vtkObjectFactory.h"

#include <cstdio>

vtkStandardNewMacro(vtkQuellFireflyClamp);
QUELL_STAGE_DESCRIPTION(vtkQuellFireflyClamp)

void vtkQuellFireflyClamp::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellFireflyClamp;
  d.Category = "Denoising";
  d.Brief = "Shortens colours longer than a threshold and keeps what it took in a residual.";
  d.Details =
    "Where the Euclidean length of RGB exceeds `Threshold`, the colour is scaled to that length, so its hue stays. "
    "`radiance + residual` is the input exactly, in every channel. Biased: energy is removed, and reported. "
    "A non-finite pixel is replaced by the mean of its finite neighbours (0 if there are none), clamped in turn; "
    "its residual is 0. Source: Bikker, Advanced Graphics, lecture 15, `if dot(E,E) > 25: E = 5 E / |E|`.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "the layer");
  d.Output("radiance", quell::ArrayKind::Color, "the layer, no colour longer than Threshold");
  d.Output("residual", quell::ArrayKind::Color, "input minus radiance");
  QUELL_DOUBLE(d, Threshold, "", "longest colour that stays, in the input's unit; 1e30: off");
}

vtkQuellFireflyClamp::vtkQuellFireflyClamp()
{
  this->InitializePorts();
}

int vtkQuellFireflyClamp::HaloFor(int) const
{
  return 1; // a non-finite pixel is filled from its neighbours
}

void vtkQuellFireflyClamp::Execute(quell::StageFrame& frame)
{
  const quell::ImageIn in = frame.Input(0);
  const quell::ImageOut filtered = frame.Output("radiance"), residual = frame.Output("residual");
  const quell::Rect region = frame.Region();
  // One ledger per row, added in order: the energies have the same bits for any number of threads.
  std::vector<quell::ClampLedger> rows(region.height());
  this->ForEachTile({ 0, region.y0, 1, region.y1 }, 16,
    [&](const quell::Rect& strip)
    {
      for (int y = strip.y0; y < strip.y1; ++y)
        rows[y - region.y0] =
          quell::FireflyClamp(in, float(this->Threshold), filtered, residual, { region.x0, y, region.x1, y + 1 });
    });
  quell::ClampLedger sum;
  for (const quell::ClampLedger& row : rows)
    sum += row;
  this->Pixels = region.area();
  this->ClampedPixels = sum.Clamped;
  this->EnergyIn = sum.EnergyIn;
  this->EnergyRemoved = sum.EnergyRemoved;
  quell::PixelCount bad;
  bad.Add(sum.NonFinite);
  bad.Report(this->Counters, this->Warnings, "radiance");
}

std::string vtkQuellFireflyClamp::GetReport() const
{
  if (this->Pixels == 0)
    return std::string();
  char text[160];
  std::snprintf(text, sizeof text, "clamped %lld of %lld pixels, removed %.3g %% of the energy", this->ClampedPixels,
    this->Pixels, this->EnergyIn > 0 ? 100 * this->EnergyRemoved / this->EnergyIn : 0.);
  return text;
}
