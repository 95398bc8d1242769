// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellLeaveOut_h
#define quellLeaveOut_h

#include "quellPipelineDocument.h"
#include "quellStageRegistry.h"
#include "vtkQuellPipelineModule.h"

#include <memory>
#include <string>
#include <vector>

namespace quell
{
/// The pipeline without the node or instance `id` of its top level: whoever read its first output reads what its first
/// input read, and whoever read another array of it asks the same producer for that array. What nobody needs then is
/// left to the executor to skip. Null with a sentence in `error` where that is not possible: no such node (with the
/// nearest name), one without inputs, one whose first input reads the previous frame, one that is an output itself
/// without readers. Whether the result fits together is BuildGraph's to say.
VTKQUELLPIPELINE_EXPORT std::shared_ptr<PipelineDocument> LeaveOut(
  const PipelineDocument& document, const std::string& id, const StageRegistry& registry, std::string& error);

/// Ids that LeaveOut would take, in the order of the file.
VTKQUELLPIPELINE_EXPORT std::vector<std::string> RemovableNodes(
  const PipelineDocument& document, const StageRegistry& registry);
}

#endif
