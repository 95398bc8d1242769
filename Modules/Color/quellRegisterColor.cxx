// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterColor.h"

#include "vtkQuellDisplayTransform.h"

namespace quell
{
void RegisterColorStages(StageRegistry& registry)
{
  registry.Add<vtkQuellDisplayTransform>();
}
}
