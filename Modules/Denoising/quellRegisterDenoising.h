// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterDenoising_h
#define quellRegisterDenoising_h

#include "quellStageRegistry.h"
#include "vtkQuellDenoisingModule.h"

namespace quell
{
/// Adds ATrousFilter, AlbedoDemodulate, AlbedoModulate, AovSplit, BilateralFilter, FireflyClamp, Sum, VarianceEstimate.
VTKQUELLDENOISING_EXPORT void RegisterDenoisingStages(StageRegistry& registry);
}

#endif
