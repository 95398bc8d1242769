// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterColor_h
#define quellRegisterColor_h

#include "quellStageRegistry.h"
#include "vtkQuellColorModule.h"

namespace quell
{
/// Adds DisplayTransform.
VTKQUELLCOLOR_EXPORT void RegisterColorStages(StageRegistry& registry);
}

#endif
