// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSsim_h
#define quellSsim_h

#include "quellKernelsModule.h"

namespace quell
{
/// Half width of SSIM's Gaussian window (11 x 11, sigma 1.5).
constexpr int SsimRadius = 5;

/// Weighted sums along a row of two planes, for each x: of a, b, a^2, b^2, a b, in that order at out[5 x]. Planes are
/// `width` values; beyond the ends the outermost value is repeated.
QUELLKERNELS_EXPORT void SsimRow(const double* a, const double* b, int width, double* out) noexcept;

/// The structural similarity index of one pixel from SsimRow's results of the 11 rows around it, each at that pixel:
///   (2 ma mb + C1)(2 cov + C2) / ((ma^2 + mb^2 + C1)(va + vb + C2)),  C1 = (0.01 L)^2, C2 = (0.03 L)^2
/// with weighted, biased moments. `range` is L, the largest possible value. Equal windows give 1.
/// Source: Wang, Bovik, Sheikh, Simoncelli 2004.
QUELLKERNELS_EXPORT double SsimAt(const double* const rows[2 * SsimRadius + 1], double range) noexcept;
}

#endif
