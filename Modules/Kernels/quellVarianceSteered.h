// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellVarianceSteered_h
#define quellVarianceSteered_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>

namespace quell
{
/// Guides may be absent; the views cover the tile grown by VarianceSteeredHalo, as far as the frame goes.
struct VarianceSteeredInputs
{
  ImageIn radiance; ///< 3, linear
  ImageIn variance; ///< 1, of the mean luminance of `radiance` as it is here, demodulated or not
  ImageIn depth;    ///< 1, +inf where nothing was hit
  ImageIn normal;   ///< 3, unit
  ImageIn albedo;   ///< 3
  ImageIn id;       ///< 1
};

struct VarianceSteeredParameters
{
  static constexpr int MostScales = 5;

  int scales = 4;           ///< kernels besides the identity: sigma 0.5, 1, 2, 4, 8 pixels
  double sigmaNormal = 0.2; ///< length of the difference of unit normals; 1e30: off
  double sigmaDepth = 0.05; ///< relative to depth
  double sigmaAlbedo = 0.1;
};

struct VarianceSteeredOutputs
{
  ImageOut radiance;           ///< 3
  ImageOut variance;           ///< 1, of the filtered luminance
  ImageOut sigma;              ///< 1, pixels: the mean of what was chosen; 0: identity
  ImageOut parts = ImageOut(); ///< MostScales + 1: P_s, of the identity first
};

/// Cross-filter whose width at every pixel is the one with the smallest estimated error:
///
///   F_s(p) = Sum w c(q) / Sum w over |dx|, |dy| <= ceil(2.5 s), s = 0.5, 1, 2 ...
///   V_s(p) = Sum w^2 V(q) / (Sum w)^2
///   w      = exp(-(|q-p|^2 / 2 s^2 + D)), 0 for another id
///   D      = |n(q)-n(p)|^2 / 2 sn^2 + (ln z(q)/z(p))^2 / 2 sd^2 + |a(q)-a(p)|^2 / 2 sa^2
///   E_s(p) = (l(F_s) - l(c))^2 + V(p) (2 w(p,p) / Sum w - 1),   E_0 = V(p) for the identity
///   s(p)   = the s of the least Sum_q E_s(q) over 7 x 7 pixels that were hit; first of equals
///   C'     = c + Sum_s P_s (F_s - c),  V' = (Sum_s P_s sqrt(V_s))^2,  P_s = the part of the 3 x 3 pixels that chose s
///
/// E_s is Stein's unbiased estimate of the squared error (F_s - truth)^2: for noise of variance V that is independent
/// between pixels, E[(F - c)^2] = E[(F - t)^2] + V - 2 Cov(F, c), and Cov = V dF/dc = V w(p,p) / Sum w. It asks neither
/// for Gaussian noise (F is linear) nor for an exact V (V enters linearly: an unbiased estimate does), needs no pilot
/// image, and sees edges that no guide shows: w has no term of colour, so F_s is linear in c. What it cannot know is
/// the error of a single pixel, hence the sum over 7 x 7. Its errors are absolute: next to a bright edge the edge
/// decides, around an outlier the outlier. V' is an upper bound for the mix (its parts fully correlated), without the
/// chance in the choice itself.
///
/// V = 0 everywhere: the identity, bit by bit. Constants: c, bit by bit. Units: radiance any linear unit, V in its
/// square. Border: taps outside have weight 0. A colour that is not finite has weight 0 and no vote and gets its
/// neighbours' mean (without usable taps: of the finite 3 x 3, else 0); a variance that is not a number is the mean of
/// its finite neighbours', negative ones are 0; a guide value that is not finite is left out for its pairs. With a
/// depth input, pixels without a hit pass through. Returns the number of pixels of `tile` with colours that are not
/// finite.
///
/// Source: Stein 1981; Li, Wu, Chuang 2012, "SURE-based optimization for adaptive sampling and reconstruction" (scales
/// of a cross-bilateral filter chosen per pixel, estimates filtered before they are compared); the mix of neighbouring
/// choices as in Rousselle, Knaus, Zwicker 2012.
QUELLKERNELS_EXPORT std::int64_t VarianceSteered(const VarianceSteeredInputs& in,
  const VarianceSteeredParameters& parameters, const VarianceSteeredOutputs& out, const Rect& tile,
  float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t VarianceSteeredScratch(
  const VarianceSteeredInputs& in, const VarianceSteeredParameters& parameters, const Rect& tile) noexcept;
QUELLKERNELS_EXPORT int VarianceSteeredRadius(int scale) noexcept; ///< of scale 1, 2 ...; 0 for the identity
QUELLKERNELS_EXPORT int VarianceSteeredHalo(const VarianceSteeredParameters& parameters) noexcept;

/// What one pixel is made of: with P as VarianceSteered gave it in `parts`, `weights` (1 component, over the pixels
/// within VarianceSteeredRadius of the widest kernel or some of them) gets the w' with C' = Sum w'(q) c(q). In double,
/// straight from the formula.
QUELLKERNELS_EXPORT void VarianceSteeredWeights(const VarianceSteeredInputs& in,
  const VarianceSteeredParameters& parameters, const float* parts, int x, int y, const ImageOut& weights) noexcept;

/// F, V and w(p,p) / Sum w of one pixel and scale straight from the formula in double, for tests.
struct VarianceSteeredPixel
{
  double Color[3] = {}, Variance = 0, Centre = 1;
};
QUELLKERNELS_EXPORT VarianceSteeredPixel VarianceSteeredScalar(
  const VarianceSteeredInputs& in, const VarianceSteeredParameters& parameters, int scale, int x, int y) noexcept;
/// The same by the vector code, for a pixel of a tile: what VarianceSteered compares.
QUELLKERNELS_EXPORT VarianceSteeredPixel VarianceSteeredVector(const VarianceSteeredInputs& in,
  const VarianceSteeredParameters& parameters, int scale, int x, int y, float* scratch) noexcept;
}

#endif
