// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterImageIO.h"

#include "vtkQuellImageReader.h"
#include "vtkQuellImageWriter.h"

namespace quell
{
void RegisterImageIOStages(StageRegistry& registry)
{
  registry.Add<vtkQuellImageReader>();
  registry.Add<vtkQuellImageWriter>();
}
}
