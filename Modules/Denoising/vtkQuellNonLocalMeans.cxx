// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellNonLocalMeans.h"

#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellNonLocalMeans);
QUELL_STAGE_DESCRIPTION(vtkQuellNonLocalMeans)

void vtkQuellNonLocalMeans::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellNonLocalMeans;
  DescribeInputs(d);
  d.Brief = "Joint non-local means: weights by how alike patches and guides are, half buffers against each other.";
  d.Details =
    "`w = exp(-max(0, d, F))`, d being the mean over the patch and the channels of `((u_p - u_q)^2 - (V_p + min(V_p, "
    "V_q))) / (Epsilon + KColor^2 (V_p + V_q))`, and F the largest over the guides of `(|f_p - f_q|^2 - (V_p + "
    "min(V_p, "
    "V_q))) / (KGuide^2 max(least, V_p, |grad f_p|^2))`. With `halfA` and `halfB` each half is filtered with weights "
    "from the other, `radiance = (A' + B') / 2` and `variance = lum((A' - B') / 2)^2`; else the weights come from "
    "`radiance`. A `variance` that is not connected is estimated. Taps outside the image, not finite or without a hit "
    "have weight 0 and are left out of patches; a non-finite pixel becomes the weighted mean of its neighbours; "
    "background "
    "passes through. Sources: Rousselle et al. 2012; Rousselle et al. 2013.";
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input").Mean({ "radiance", "halfA", "halfB" });
  d.Output("variance", quell::ArrayKind::Variance, "of the noise that is left, from the halves; 0 without them")
    .Finite("the square of half a difference");
  QUELL_INT(d, Radius, "pixels", "half the side of the window; 0: identity");
  QUELL_INT(d, PatchRadius, "pixels", "half the side of the patches");
  QUELL_DOUBLE(d, KColor, "", "how many deviations of noise patches may differ; 1e15: colours do not matter");
  QUELL_DOUBLE(d, KGuide, "", "the same for guides; 1e15: they do not matter");
  QUELL_DOUBLE(d, Epsilon, "", "squared difference of colours that does not matter");
}

vtkQuellNonLocalMeans::vtkQuellNonLocalMeans()
{
  this->InitializePorts();
}
