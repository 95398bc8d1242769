// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellVariance_h
#define quellVariance_h

#include "quellFilterPlanes.h"
#include "quellKernelsModule.h"

namespace quell
{
/// Planar temporal statistics. All absent: every pixel is estimated in space from its colour.
struct MomentPlanes
{
  float* mean = nullptr;    ///< of the luminance over frames; absent: the luminance of the colour
  float* central = nullptr; ///< central second moment over frames; absent: 0
  float* history = nullptr; ///< frames in them; absent: 1
  float* rest = nullptr;    ///< what the mean has beyond a float; absent: 0
};

/// Rows [y0, y1) of the planes, padding included. `moments` (mean, central second moment) and `history` may each be
/// absent: without `history` every pixel has seen `unknownHistory` frames. A pixel with a moment that is not finite
/// counts as history 0 with mean = luminance, central = 0; a history that is not finite or is negative as 0.
/// `meanRest`, which may be absent, goes with `moments`; one that is not finite counts as 0.
QUELLKERNELS_EXPORT void CopyMoments(const ImageIn& moments, const ImageIn& history, const ImageIn& meanRest,
  const PlaneLayout& layout, const ColorPlanes& color, const MomentPlanes& planes, float unknownHistory, int y0,
  int y1) noexcept;

/// Variance of the luminance: temporal where a pixel has seen enough frames, else from its neighbourhood (SVGF).
///
///   h >= minimumHistory (and there is a central moment):  V = central(p), C' = C(p)
///   else, over the 7 x 7 window with the weights w = wz wn of ATrousPass at step 1 (centre 1):
///     C' = C(p) + Sum w (C(q) - C(p)) / Sum w
///     m  = Sum w mean(q) / Sum w
///     V  = Sum w (central(q) + (mean(q) - m)^2) / Sum w * max(1, minimumHistory / h)
///     V  = l(p)^2 where the other taps together weigh less than 1/100: unknown,
///          and 0 would freeze the pixel unfiltered
///   ofMean: V is divided by min(h, maximumSamples)
///
/// Two passes over the window (no E[x^2] - E[x]^2), the weights kept between them; differences are limited to 1e18, so
/// V is at most ~1e37 and finite. With a rest, means are the sums of two floats and taken as differences to the
/// centre's. Units: luminance squared. Border: taps outside, not hit, not finite, or of another id have weight 0. Where
/// nothing was hit the colour keeps its planes and V is -1 (StoreFiltered gives 0).
/// Source: Schied et al. 2017, section 4.2; the boost 4/h as in Falcor's SVGF pass.
struct VariancePass
{
  static constexpr int Radius = 3;

  GuidePlanes guides;
  ColorPlanes in, out; ///< in.variance is not used; out.luminance may be absent
  MomentPlanes moments;
  float sigmaDepth = 1.f, sigmaNormal = 128.f, depthEpsilon = 1e-4f;
  float minimumHistory = 4.f;
  bool ofMean = false;
  float maximumSamples = 9.f; ///< (2 - alpha) / alpha: what an exponential average with alpha = .2 is worth
};

/// The same where every pixel of `tile` has seen enough frames, straight from the inputs: writes `radiance` and
/// `variance` (each may be absent), the bits of VarianceRow. False, with arbitrary output, where a pixel needs its
/// neighbours: too young, or with a colour or moment that is not finite. `moments` is there; `history` and `depth` may
/// be absent.
QUELLKERNELS_EXPORT bool VarianceOverFrames(const VariancePass& pass, const ImageIn& color, const ImageIn& moments,
  const ImageIn& history, const ImageIn& depth, const ImageOut& radiance, const ImageOut& variance,
  const Rect& tile) noexcept;

///@{ Pixels [x0, x1) of row y. The vector code may also write some pixels right of x1 in `out`.
QUELLKERNELS_EXPORT void VarianceRow(const VariancePass& pass, int y, int x0, int x1) noexcept;
QUELLKERNELS_EXPORT void VarianceRowScalar(const VariancePass& pass, int y, int x0, int x1) noexcept; ///< for tests
///@}
}

#endif
