// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterTemporal_h
#define quellRegisterTemporal_h

#include "vtkQuellTemporalModule.h"

namespace quell
{
class StageRegistry;
/// Adds Reproject, TemporalAccumulate and TemporalAntialias.
VTKQUELLTEMPORAL_EXPORT void RegisterTemporalStages(StageRegistry& registry);
}

#endif
