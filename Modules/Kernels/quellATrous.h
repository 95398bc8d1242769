// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellATrous_h
#define quellATrous_h

#include "quellFilterPlanes.h"
#include "quellKernelsModule.h"

namespace quell
{
/// One edge-avoiding a-trous pass of SVGF, step s = 2^i, over planar scratch.
///
///   g(p)  = 3 x 3 Gaussian (1/4, 1/8, 1/16) of the variance around p over taps that exist, renormalised
///   sL(p) = sigmaLuminance sqrt(g(p)) + luminanceEpsilon (1 + |l(p)|)
///   for q = p + s (dx, dy), |dx|, |dy| <= 2, q hit, finite, inside, and of the same id if ids are given:
///     wz = exp(-|z(p) - z(q)| / (sigmaDepth |slope(p) . (q - p)| + depthEpsilon |z(p)|))
///     wn = max(0, min(1, n(p) . n(q))) ^ sigmaNormal      (sigmaNormal 0, or no normals: 1)
///     wl = exp(-|l(p) - l(q)| / sL(p))
///     w  = h(dx) h(dy) wz wn wl,  h = (1/16, 1/4, 3/8, 1/4, 1/16);  centre: h(0)^2 exactly
///   C'(p) = C(p) + Sum w (C(q) - C(p)) / Sum w           (so that a constant is a fixed point to the last bit)
///   V'(p) = Sum w^2 V(q) / (Sum w)^2
///
/// z in scene units, slopes in scene units per pixel, l = Rec. 709 luminance of C. Without a variance plane
/// sL(p) = fixedSigma + luminanceEpsilon (1 + |l(p)|) and V' is not made. Weights below e^-80 (vector
/// code: e^-88) are 0.
/// Border: taps outside have weight 0. A pixel that was not hit keeps its planes. A centre that is not valid
/// (luminance +inf) has weight 0 and wl = 1; it becomes valid when its taps weigh more than 1e-18, else it keeps its
/// planes. Vector and scalar code agree to 1e-5 relative; the result does not depend on how rows are shared out.
/// Source: Schied et al. 2017, Spatiotemporal Variance-Guided Filtering, eqs. 2-5; Dammertz et al. 2010.
struct ATrousPass
{
  GuidePlanes guides;
  ColorPlanes in, out; ///< different memory; padding of both filled (CopyColor, ClearPadding)
  int step = 1;        ///< the layout's pad must be at least 2 step
  float sigmaDepth = 1.f, sigmaNormal = 128.f, sigmaLuminance = 4.f;
  float fixedSigma = 1.f;
  float depthEpsilon = 1e-4f, luminanceEpsilon = 1e-6f;
};

///@{ Pixels [x0, x1) of the `rows` rows y, y + step, y + 2 step ... What two pixels share (normals, ids) is computed
///once
/// for both while rows follow each other like this; the bits are those of single rows. The vector code may also write
/// some pixels right of x1 in `out`; it keeps some 150 KiB on the stack.
QUELLKERNELS_EXPORT void ATrousRows(const ATrousPass& pass, int y, int rows, int x0, int x1) noexcept;
QUELLKERNELS_EXPORT void ATrousRowsScalar(
  const ATrousPass& pass, int y, int rows, int x0, int x1) noexcept; ///< reference, for tests
///@}

/// Pixels that `iterations` passes need around a region: Sum 2 * 2^i = 2 (2^iterations - 1). The 3 x 3 variance blur
/// and the depth slope of a pass reach 1 pixel beyond its centres, which its own taps (at least 2) cover already.
constexpr int ATrousHalo(int iterations) noexcept
{
  return 2 * ((1 << iterations) - 1);
}
}

#endif
