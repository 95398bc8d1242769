// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSum_h
#define quellSum_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// Adds one term to a sum: out = first ? term : out + term, 3 channels, float, sign kept. Called once per term in the
/// order of the connections, so the rounding is always the same; sums beyond FLT_MAX stay at FLT_MAX. A non-finite term
/// pixel is replaced by the mean of its finite neighbours in that term (0: none). Pixelwise, halo 1 for that rule.
/// Returns the number of such pixels.
QUELLKERNELS_EXPORT std::int64_t AddTerm(
  const ImageIn& term, bool first, const ImageOut& out, const Rect& tile) noexcept;
}

#endif
