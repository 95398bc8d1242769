// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCommandLine_h
#define quellCommandLine_h

#include "quellViewer.h"

#include <string>

namespace quell
{
struct CommandLineFault
{
  std::string Text; ///< one or more sentences, with the nearest valid choice; empty: nothing is wrong
  int Status = 0;   ///< the program's exit status
  explicit operator bool() const { return !this->Text.empty(); }
};

/// What of the options does not fit the pipeline in `file`: -D, --set, --show, --frame (status 2), and a reference that
/// cannot be read (status 1). Mistakes in the file itself are the viewer's to show.
CommandLineFault CheckCommandLine(
  const std::string& file, const Viewer::Options& options, const StageRegistry& registry);
}

#endif
