// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSimd_h
#define quellSimd_h

#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace quell
{
/// An instruction set that the kernels were compiled for and this processor runs.
struct SimdTarget
{
  std::int64_t Id = 0;
  const char* Name = "";
};

/// Best first.
QUELLKERNELS_EXPORT std::vector<SimdTarget> SimdTargets();
/// For tests and measurements: use this target from now on, in all kernels; 0 goes back to the best. Not thread-safe.
QUELLKERNELS_EXPORT void ForceSimdTarget(std::int64_t id);
/// The target in use.
QUELLKERNELS_EXPORT const char* SimdTargetName();

/// exp2(-x) of `count` values by the vector code that filters use for their weights, for x >= 0; 0 for x > 115 and for
/// NaN. Relative error at most 3e-7. `in` and `out` hold a multiple of 64 floats.
QUELLKERNELS_EXPORT void NegativeExp2(const float* in, float* out, std::size_t count) noexcept;
}

#endif
