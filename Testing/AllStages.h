// SPDX-License-Identifier: BSD-3-Clause
#ifndef AllStages_h
#define AllStages_h

#include "quellRegisterColor.h"
#include "quellRegisterDenoising.h"
#include "quellRegisterImageIO.h"
#include "quellRegisterMetrics.h"
#include "quellRegisterRayTracing.h"
#include "quellRegisterTemporal.h"
#include "quellStageRegistry.h"

/// Every stage type, as the program has them.
inline const quell::StageRegistry& Registry()
{
  static const quell::StageRegistry registry = []
  {
    quell::StageRegistry r;
    quell::RegisterRayTracingStages(r);
    quell::RegisterDenoisingStages(r);
    quell::RegisterTemporalStages(r);
    quell::RegisterImageIOStages(r);
    quell::RegisterColorStages(r);
    quell::RegisterMetricsStages(r);
    return r;
  }();
  return registry;
}

#endif
