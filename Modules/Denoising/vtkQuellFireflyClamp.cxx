// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellFireflyClamp.h"

#include "quellFireflyClamp.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellFireflyClamp);
QUELL_STAGE_DESCRIPTION(vtkQuellFireflyClamp)

namespace
{
enum Ports
{
  Radiance,
  Count,
  Albedo
};
}

void vtkQuellFireflyClamp::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellFireflyClamp;
  d.Category = "Denoising";
  d.Brief = "Shortens colours larger than a threshold and keeps what it took in a residual.";
  d.Details =
    "Where the size of the colour (`Measure`) exceeds `Threshold`, the colour is scaled to that size, so its hue "
    "stays. `radiance + residual` is the input exactly, in every channel. With `count`, the frames or samples "
    "accumulated so far, the threshold is `Threshold count^Growth`: the bias of what is accumulated after the clamp "
    "vanishes with the count, while one outlier adds at most `Threshold count^(Growth - 1)` to the mean. `Largest` "
    "is a guard besides: no channel of `colour clamp(albedo, Floor, 1)` stays larger. Biased: "
    "energy is removed, and reported. A non-finite pixel is replaced by the mean of its finite neighbours (0 if "
    "there are none), clamped in turn; its residual is 0. Source: Bikker, Advanced Graphics, lecture 15, `if "
    "dot(E,E) > 25: E = 5 E / |E|` (Length); Lighthouse 2 and pbrt (Maximum).";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "the layer");
  d.OptionalInput("count", quell::ArrayKind::History, "history", "frames accumulated so far; raises the threshold");
  d.OptionalInput(
    "albedo", quell::ArrayKind::Albedo, "albedo", "what the colour was divided by, for Largest; without it 1");
  d.Output("radiance", quell::ArrayKind::Color, "the layer, no colour larger than the threshold").Part("radiance");
  d.Output("residual", quell::ArrayKind::Color, "input minus radiance").Part("radiance");
  QUELL_DOUBLE(d, Threshold, "", "largest colour that stays, in the input's unit; 1e30: off");
  QUELL_ENUM(d, Measure,
    "how large a colour is: the Euclidean length of RGB, its luminance, or its largest channel (magnitudes)", "Length",
    "Luminance", "Maximum");
  QUELL_DOUBLE(d, Growth, "", "exponent of `count` in the threshold; 0: the threshold stays");
  QUELL_DOUBLE(d, Largest, "",
    "largest channel of colour times albedo that stays: 65504 is the largest number of a half float; 1e30: off");
  QUELL_DOUBLE(d, Floor, "", "smallest albedo, as in AlbedoDemodulate");
}

vtkQuellFireflyClamp::vtkQuellFireflyClamp()
{
  this->InitializePorts();
}

int vtkQuellFireflyClamp::HaloFor(int port) const
{
  return port == Radiance ? 1 : 0; // a non-finite pixel is filled from its neighbours
}

bool vtkQuellFireflyClamp::NeedsInput(int port, const quell::ArraySet& asked) const
{
  return port != Albedo || this->Largest < 1e30 ? this->Superclass::NeedsInput(port, asked) : false;
}

void vtkQuellFireflyClamp::Execute(quell::StageFrame& frame)
{
  const quell::ImageIn in = frame.Input(Radiance), count = frame.Input(Count), albedo = frame.Input(Albedo);
  const quell::ImageOut filtered = frame.Output("radiance"), residual = frame.Output("residual");
  const quell::FireflyClampParameters p{ float(this->Threshold), quell::ClampMeasure(this->Measure),
    float(this->Growth), float(this->Largest), float(this->Floor) };
  const quell::ClampLedger ledger = this->Ledger.Run(
    frame.Region(), frame.Tick(),
    [this](const quell::Rect& rows, auto&& body) { this->ForEachTile(rows, quell::EnergyLedger::RowsPerStrip, body); },
    [&](const quell::Rect& strip) { return quell::FireflyClamp(in, count, p, filtered, residual, strip, albedo); });
  quell::PixelCount::Report(
    ledger.NonFinite, this->Ledger.Total().NonFinite, this->Counters, this->Warnings, this->CountedWarning, "radiance");
  // Without a number: bands of one frame say the same.
  if (ledger.Guarded > 0)
    this->Warnings.push_back("there are pixels larger than Largest (" + quell::detail::FormatDouble(this->Largest) +
                             "); they count as so large");
}

std::string vtkQuellFireflyClamp::GetReport() const
{
  // Largest is a guard against broken pixels: it speaks when there are some.
  const bool off = this->Threshold >= 1e30 && this->Ledger.Total().Clamped == 0;
  return off ? std::string() : this->Ledger.Text();
}
