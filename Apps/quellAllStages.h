// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellAllStages_h
#define quellAllStages_h

#include "quellRegisterColor.h"
#include "quellRegisterDenoising.h"
#include "quellRegisterImageIO.h"
#include "quellRegisterMetrics.h"
#include "quellRegisterRayTracing.h"
#include "quellRegisterTemporal.h"
#include "quellStageRegistry.h"

namespace quell
{
/// Every stage type: what the programs, their benchmarks and the tests of whole pipelines know. A new module of stages
/// is added here.
inline const StageRegistry& AllStages()
{
  static const StageRegistry registry = []
  {
    StageRegistry r;
    RegisterRayTracingStages(r);
    RegisterDenoisingStages(r);
    RegisterTemporalStages(r);
    RegisterImageIOStages(r);
    RegisterColorStages(r);
    RegisterMetricsStages(r);
    return r;
  }();
  return registry;
}
}

#endif
