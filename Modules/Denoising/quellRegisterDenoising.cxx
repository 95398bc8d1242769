// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterDenoising.h"

#include "vtkQuellATrousFilter.h"
#include "vtkQuellAlbedoDemodulate.h"
#include "vtkQuellAlbedoModulate.h"
#include "vtkQuellAovSplit.h"
#include "vtkQuellBilateralFilter.h"
#include "vtkQuellFireflyClamp.h"
#include "vtkQuellSum.h"
#include "vtkQuellVarianceEstimate.h"

void quell::RegisterDenoisingStages(StageRegistry& registry)
{
  registry.Add<vtkQuellATrousFilter>();
  registry.Add<vtkQuellAlbedoDemodulate>();
  registry.Add<vtkQuellAlbedoModulate>();
  registry.Add<vtkQuellAovSplit>();
  registry.Add<vtkQuellBilateralFilter>();
  registry.Add<vtkQuellFireflyClamp>();
  registry.Add<vtkQuellSum>();
  registry.Add<vtkQuellVarianceEstimate>();
}
