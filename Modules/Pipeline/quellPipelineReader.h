// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPipelineReader_h
#define quellPipelineReader_h

#include "quellPipelineDocument.h"
#include "vtkQuellPipelineModule.h"

#include <memory>
#include <string>

namespace quell
{
/// The newest pipeline version that this program understands.
constexpr int PipelineVersion = 1;

/// Reads a pipeline and everything it includes. Knows the file's grammar, no stage type: unknown elements and
/// attributes, missing attributes, a newer version and malformed XML are diagnosed here, the rest by BuildGraph.
/// Never null; after an error in the XML itself the document is what could be read.
VTKQUELLPIPELINE_EXPORT std::shared_ptr<PipelineDocument> ReadPipelineFile(
  const std::string& file, Diagnostics& diagnostics);
/// Same from memory; `file` names it in messages, and its directory is where included files are looked for.
VTKQUELLPIPELINE_EXPORT std::shared_ptr<PipelineDocument> ReadPipelineText(
  const std::string& text, const std::string& file, Diagnostics& diagnostics);

/// `path` seen from `directory`: unchanged when absolute or when the directory is "".
VTKQUELLPIPELINE_EXPORT std::string JoinPath(const std::string& directory, const std::string& path);
/// "a/b" of "a/b/c", "" of "c", "/" of "/c".
VTKQUELLPIPELINE_EXPORT std::string DirectoryOf(const std::string& path);
}

#endif
