// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellStageReference_h
#define quellStageReference_h

#include "quellStageRegistry.h"
#include "vtkQuellPipelineModule.h"

#include <string>
#include <vector>

namespace quell
{
/// Stage types with their first sentence, grouped by category, for a terminal.
VTKQUELLPIPELINE_EXPORT std::string StageList(const StageRegistry& registry);
/// One stage for a terminal: ports, arrays, properties with default and range.
VTKQUELLPIPELINE_EXPORT std::string StageText(const StageDescription& stage);
/// The reference of these types (all: registry.Types()) as one Markdown document.
VTKQUELLPIPELINE_EXPORT std::string StageMarkdown(const StageRegistry& registry, const std::vector<std::string>& types);

/// "[0, 1]", "0 or more", "Scale, Drop", "" where everything goes.
VTKQUELLPIPELINE_EXPORT std::string RangeText(const Property& property);
}

#endif
