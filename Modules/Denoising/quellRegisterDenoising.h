// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterDenoising_h
#define quellRegisterDenoising_h

#include "quellStageRegistry.h"
#include "vtkQuellDenoisingModule.h"

namespace quell
{
/// Adds every stage of this module that is not a base class.
VTKQUELLDENOISING_EXPORT void RegisterDenoisingStages(StageRegistry& registry);
}

#endif
