// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterMetrics.h"

#include "quellStageRegistry.h"
#include "vtkQuellCompareFrames.h"
#include "vtkQuellCompareImages.h"

namespace quell
{
void RegisterMetricsStages(StageRegistry& registry)
{
  registry.Add<vtkQuellCompareFrames>();
  registry.Add<vtkQuellCompareImages>();
}
}
