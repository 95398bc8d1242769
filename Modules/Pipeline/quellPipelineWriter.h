// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPipelineWriter_h
#define quellPipelineWriter_h

#include "quellPipelineDocument.h"
#include "vtkQuellPipelineModule.h"

#include <string>

namespace quell
{
/// The document as a file: includes, variables, time, templates, nodes and instances, outputs, in that order, with its
/// comments. Reading what this wrote gives an equal document, and writing that again the same bytes.
VTKQUELLPIPELINE_EXPORT std::string WritePipelineText(const PipelineDocument& document);
}

#endif
