// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPipelinePatch_h
#define quellPipelinePatch_h

#include "quellPipelineDocument.h"
#include "vtkQuellPipelineModule.h"

#include <map>
#include <string>
#include <utility>

namespace quell
{
/// The file `original` with what `edited` changes, and every other byte as it was: comments, blank lines, line breaks
/// within tags, the order of elements. Elements are matched by name and id (name, port, file); a value that changed is
/// replaced where it stands, a new element is written after the one before it and indented as its neighbours are. Where
/// that does not read back as `edited` (an original that is no pipeline, another encoding), the whole is written anew.
VTKQUELLPIPELINE_EXPORT std::string PatchPipelineText(const std::string& original, const PipelineDocument& edited);

/// Where an editor drew nodes: "pt", "output:beauty", inside of templates "svgf/atrous" -> x, y. They are kept in a
/// processing instruction, which readers pass over, so no element is touched and no hash of the pipeline changes:
///
///     <?quell-view
///       pt 40 60
///       svgf/atrous 300 60
///     ?>
using PipelinePositions = std::map<std::string, std::pair<double, double>>;
VTKQUELLPIPELINE_EXPORT PipelinePositions ReadPipelinePositions(const std::string& text);
/// Replaces them, or adds them before the root's end tag; an empty map takes them out. Unchanged when `text` is not
/// well-formed.
VTKQUELLPIPELINE_EXPORT std::string WithPipelinePositions(const std::string& text, const PipelinePositions& positions);
}

#endif
