// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellRegressionFilter.h"

#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellRegressionFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellRegressionFilter)

void vtkQuellRegressionFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellRegressionFilter;
  DescribeInputs(d);
  d.Brief = "First-order regression on features with the weights of non-local means (NFOR); for stills.";
  d.RepeatableInput("feature", quell::ArrayKind::Any, "albedo",
    "what the colour is explained with, besides x and y: albedo, normal, position ...; 10 components together");
  d.Inputs.back().Optional = true;
  d.Details =
    "For every pixel p the b that minimises `Sum_q w(p, q) |C(q) - C(p) - b x|^2`, `x = (1, dx, dy, f(q) - f(p))` with "
    "all components f of the `feature`s and the weights of `NonLocalMeans`; `radiance(q) = Sum_p w(p, q) (C(p) + b_p "
    "x) / "
    "Sum_p w(p, q)`, not below 0 where the input is not. Columns are scaled to length 1 with `Ridge` on the diagonal; "
    "a "
    "flat one is left out. Halves, variance, borders, pixels that are not finite and background as in `NonLocalMeans`. "
    "With halves each pixel takes the better of two widths, `KColor` and `KColorNarrow`, by the error that the halves "
    "tell: "
    "`((B - fA)^2 + (A - fB)^2) / 2 - 2 V - (fB - fA)^2 / 4`, smoothed. Features must not share the colour's noise, as "
    "a "
    "spectral renderer's albedo does. Source: Bitterli et al. 2016.";
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input")
    .KeepsConstants({ "radiance", "halfA", "halfB" }, "a line through noisy colours may overshoot them");
  d.Output("variance", quell::ArrayKind::Variance, "of the noise that is left, from the halves; 0 without them")
    .Finite("the square of half a difference");
  QUELL_INT(d, Radius, "pixels", "half the side of the window; 0: identity");
  QUELL_INT(d, PatchRadius, "pixels", "half the side of the patches");
  QUELL_DOUBLE(d, KColor, "", "how many deviations of noise patches may differ; 1e15: colours do not matter");
  QUELL_DOUBLE(d, KColorNarrow, "", "with halves, a second KColor to choose from by estimated error; 0: none");
  QUELL_DOUBLE(d, KGuide, "", "the same for guides; 1e15: they do not matter");
  QUELL_DOUBLE(d, Epsilon, "", "squared difference of colours that does not matter");
  QUELL_DOUBLE(d, Ridge, "", "added to the diagonal of the normalised equations; 1e6: a weighted mean");
}

vtkQuellRegressionFilter::vtkQuellRegressionFilter()
{
  this->Radius = 9;
  this->KColor = 1;
  this->KColorNarrow = 0.5;
  this->InitializePorts();
}

bool vtkQuellRegressionFilter::Selects() const
{
  auto self = const_cast<vtkQuellRegressionFilter*>(this);
  return this->KColorNarrow > 0 && self->GetNumberOfInputConnections(this->GetDescription().InputIndex("halfA")) > 0;
}
