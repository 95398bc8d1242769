// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRegisterImageIO_h
#define quellRegisterImageIO_h

#include "quellStageRegistry.h"
#include "vtkQuellIOModule.h"

namespace quell
{
/// Adds ImageReader and ImageWriter.
VTKQUELLIO_EXPORT void RegisterImageIOStages(StageRegistry& registry);
}

#endif
