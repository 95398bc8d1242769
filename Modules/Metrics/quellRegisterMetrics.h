// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterMetrics_h
#define quellRegisterMetrics_h

#include "vtkQuellMetricsModule.h"

namespace quell
{
class StageRegistry;
/// Adds CompareImages.
VTKQUELLMETRICS_EXPORT void RegisterMetricsStages(StageRegistry& registry);
}

#endif
