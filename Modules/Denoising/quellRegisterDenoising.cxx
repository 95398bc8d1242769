// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterDenoising.h"

#include "vtkQuellATrousFilter.h"
#include "vtkQuellAlbedoDemodulate.h"
#include "vtkQuellAlbedoModulate.h"
#include "vtkQuellAovSplit.h"
#include "vtkQuellBilateralFilter.h"
#include "vtkQuellEmissionSplit.h"
#include "vtkQuellFeaturePrefilter.h"
#include "vtkQuellFireflyClamp.h"
#include "vtkQuellKernelFilter.h"
#include "vtkQuellMedianOfMeans.h"
#include "vtkQuellNonLocalMeans.h"
#include "vtkQuellNormalSnap.h"
#include "vtkQuellRankClamp.h"
#include "vtkQuellRedistribute.h"
#include "vtkQuellRegressionFilter.h"
#include "vtkQuellSampleFilter.h"
#include "vtkQuellSum.h"
#include "vtkQuellVarianceEstimate.h"
#include "vtkQuellVarianceSteeredFilter.h"

void quell::RegisterDenoisingStages(StageRegistry& registry)
{
  registry.Add<vtkQuellATrousFilter>();
  registry.Add<vtkQuellAlbedoDemodulate>();
  registry.Add<vtkQuellAlbedoModulate>();
  registry.Add<vtkQuellAovSplit>();
  registry.Add<vtkQuellBilateralFilter>();
  registry.Add<vtkQuellEmissionSplit>();
  registry.Add<vtkQuellFeaturePrefilter>();
  registry.Add<vtkQuellFireflyClamp>();
  registry.Add<vtkQuellKernelFilter>();
  registry.Add<vtkQuellMedianOfMeans>();
  registry.Add<vtkQuellNonLocalMeans>();
  registry.Add<vtkQuellNormalSnap>();
  registry.Add<vtkQuellRankClamp>();
  registry.Add<vtkQuellRedistribute>();
  registry.Add<vtkQuellRegressionFilter>();
  registry.Add<vtkQuellSampleFilter>();
  registry.Add<vtkQuellSum>();
  registry.Add<vtkQuellVarianceEstimate>();
  registry.Add<vtkQuellVarianceSteeredFilter>();
}
