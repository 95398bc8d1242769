// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTestThreads_h
#define quellTestThreads_h

#include "vtkSMPTools.h"

#include <cstddef>
#include <tbb/global_control.h>

namespace quelltest
{
/// Runs `body` with that many threads. VTK alone would not go beyond the processors of the machine: TBB leaves out what
/// it is asked for above them, without a word, unless it is told that more are allowed.
template <class F>
void WithThreads(int threads, F&& body)
{
  const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
  vtkSMPTools::LocalScope(vtkSMPTools::Config{ threads }, body);
}
}

#endif
