// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPipelineSchema_h
#define quellPipelineSchema_h

#include "quellStageRegistry.h"
#include "vtkQuellPipelineModule.h"

#include <string>

namespace quell
{
/// An XML Schema (1.0) of the pipeline file: its grammar, the forms of names, links and numbers, stage types, ports,
/// properties and attributes of inputs with their documentation. It accepts every file that the reader accepts; what
/// it cannot refuse is listed in Documentation/pipeline-format.md.
VTKQUELLPIPELINE_EXPORT std::string PipelineXsd(const StageRegistry& registry);
}

#endif
