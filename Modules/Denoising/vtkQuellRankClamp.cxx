// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellRankClamp.h"

#include "quellRankClamp.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellRankClamp);
QUELL_STAGE_DESCRIPTION(vtkQuellRankClamp)

namespace
{
enum Ports
{
  Radiance,
  Id
};
}

void vtkQuellRankClamp::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellRankClamp;
  d.Category = "Denoising";
  d.Brief = "Shortens colours that stand out from their neighbours and keeps what it took in a residual.";
  d.Details =
    "A colour larger than `Factor` times the `Rank`-th largest of its neighbours in the square of `Radius` is scaled "
    "to that size, so its hue stays. The pixel itself takes no part in the judgement. Bright spots of up to `Rank` "
    "pixels go, glints too; larger ones stay. With `id` only neighbours on the same object count; with none, the "
    "pixel stays. `radiance + residual` is the input exactly, in every channel. Biased: energy is removed, and "
    "reported; most where few neighbours saw any light (one sample per pixel), so use it on what several samples or "
    "frames have filled. Taps outside or not finite do not count; a non-finite pixel is replaced by the mean of its "
    "finite neighbours (0 if there are none), clamped in turn, with residual 0. Source: rank conditioned rank "
    "selection, Hardie and Barner 1994.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "the layer; illumination rather than radiance");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "only neighbours of the same id judge");
  d.Output("radiance", quell::ArrayKind::Color, "the layer without pixels that stand out").Part("radiance");
  d.Output("residual", quell::ArrayKind::Color, "input minus radiance").Part("radiance");
  QUELL_INT(d, Radius, "pixels", "half the window's side; 0: identity");
  QUELL_INT(d, Rank, "", "which neighbour is the limit, counted from the largest");
  QUELL_DOUBLE(d, Factor, "", "times that neighbour's size; 1e30: off");
  QUELL_ENUM(d, Measure,
    "how large a colour is: the Euclidean length of RGB, its luminance, or its largest channel (magnitudes)", "Length",
    "Luminance", "Maximum");
}

vtkQuellRankClamp::vtkQuellRankClamp()
{
  this->InitializePorts();
}

int vtkQuellRankClamp::HaloFor(int) const
{
  return std::max(1, this->Radius); // 1: a non-finite pixel is filled from its neighbours
}

double vtkQuellRankClamp::ScratchBytes(const quell::Rect& region, const quell::Rect&, const quell::ArraySet&)
{
  return quell::TileScratchBytes(region.width(), quell::EnergyLedger::RowsPerStrip, this->Radius, 1);
}

void vtkQuellRankClamp::Execute(quell::StageFrame& frame)
{
  const quell::ImageIn in = frame.Input(Radiance), id = frame.Input(Id);
  const quell::ImageOut filtered = frame.Output("radiance"), residual = frame.Output("residual");
  const quell::RankClampParameters p{ this->Radius, this->Rank, this->Factor, quell::ClampMeasure(this->Measure) };
  const quell::ClampLedger ledger = this->Ledger.Run(
    frame.Region(), frame.Tick(),
    [this](const quell::Rect& rows, auto&& body) { this->ForEachTile(rows, quell::EnergyLedger::RowsPerStrip, body); },
    [&](const quell::Rect& strip)
    {
      static thread_local quell::Scratch scratch;
      return quell::RankClamp(in, id, p, filtered, residual, strip, scratch.Take(quell::RankClampScratch(p, strip)));
    });
  const std::int64_t side = 2 * this->Radius + 1;
  this->Counters.Taps += frame.Region().area() * side * side;
  quell::PixelCount::Report(
    ledger.NonFinite, this->Ledger.Total().NonFinite, this->Counters, this->Warnings, this->CountedWarning, "radiance");
}

std::string vtkQuellRankClamp::GetReport() const
{
  return this->Ledger.Text();
}
