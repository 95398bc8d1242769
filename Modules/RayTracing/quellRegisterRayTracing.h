// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterRayTracing_h
#define quellRegisterRayTracing_h

#include "vtkQuellRayTracingModule.h"

namespace quell
{
class StageRegistry;
VTKQUELLRAYTRACING_EXPORT void RegisterRayTracingStages(StageRegistry& registry);
}

#endif
