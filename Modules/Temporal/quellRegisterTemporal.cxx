// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterTemporal.h"

#include "quellStageRegistry.h"
#include "vtkQuellReproject.h"
#include "vtkQuellTemporalAccumulate.h"
#include "vtkQuellTemporalAntialias.h"

namespace quell
{
void RegisterTemporalStages(StageRegistry& registry)
{
  registry.Add<vtkQuellReproject>();
  registry.Add<vtkQuellTemporalAccumulate>();
  registry.Add<vtkQuellTemporalAntialias>();
}
}
