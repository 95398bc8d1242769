// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterRayTracing.h"

#include "quellStageRegistry.h"
#include "vtkQuellPathTraceSource.h"

void quell::RegisterRayTracingStages(StageRegistry& registry)
{
  registry.Add<vtkQuellPathTraceSource>();
}
