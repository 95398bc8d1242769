// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBilateral_h
#define quellBilateral_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>

namespace quell
{
/// Guides may be absent; the views cover the tile grown by the radius, as far as the frame goes.
struct BilateralInputs
{
  ImageIn radiance; ///< 3, linear
  ImageIn depth;    ///< 1, +inf where nothing was hit
  ImageIn normal;   ///< 3, unit
  ImageIn albedo;   ///< 3
  ImageIn position; ///< 3, scene units; only used together with depth and normal
  ImageIn id;       ///< 1
};

enum class RangeSpace
{
  Linear,     ///< c
  ToneMapped, ///< c / (1 + lum c)
  Log         ///< log(1 + c)
};

/// A sigma of 0 lets only equal values pass; a sigma of at least 1e30 removes its term.
struct BilateralParameters
{
  int radius = 6;
  double sigmaSpatial = 2; ///< pixels
  double sigmaRange = 0.5; ///< in the units of the range space
  RangeSpace range = RangeSpace::ToneMapped;
  double sigmaNormal = 0.2; ///< length of the difference of unit normals
  double sigmaDepth = 0.05; ///< relative to depth
  double sigmaAlbedo = 0.1;
};

/// Joint bilateral filter over the square |dx|, |dy| <= radius:
///
///   C'(p) = C(p) + Sum w (C(q) - C(p)) / Sum w
///   w = exp(-(|q-p|^2 / 2 ss^2 + |R(q)-R(p)|^2 / 2 sr^2 + |n(q)-n(p)|^2 / 2 sn^2 + |a(q)-a(p)|^2 / 2 sa^2 + D^2 / 2
///   sd^2))
///
/// with one exp of the summed exponents; R is the colour in the range space. D is the relative depth difference
/// |ln z(q) - ln z(p)|, or, with positions, the distance of q from p's tangent plane, |n(p) . (x(q) - x(p))| / z(p),
/// which does not fall off along slanted surfaces. With ids, taps of another id have weight 0. radius 0 or ss 0: the
/// identity. Border: taps outside have weight 0. A tap that is not finite has weight 0; a centre that is not finite
/// gets the weighted mean of its neighbours without the range term (no usable tap: the mean of its finite 3 x 3
/// neighbours, else 0). A guide value that is not finite is left out for its pairs. With a depth input, pixels where
/// nothing was hit pass through and are no taps. Constants are fixed points to the last bit; 0 and denormal images too.
/// `scratch` holds BilateralScratch(...) floats. Returns the number of pixels of `tile` that were not finite.
/// Source: Tomasi and Manduchi 1998, eq. 5; Petschnigg et al. 2004 and Eisemann and Durand 2004 for the guides.
QUELLKERNELS_EXPORT std::int64_t Bilateral(const BilateralInputs& in, const BilateralParameters& parameters,
  const ImageOut& out, const Rect& tile, float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t BilateralScratch(
  const BilateralInputs& in, const BilateralParameters& parameters, const Rect& tile) noexcept;
/// The same straight from the formula in double, for tests.
QUELLKERNELS_EXPORT void BilateralScalar(
  const BilateralInputs& in, const BilateralParameters& parameters, const ImageOut& out, const Rect& tile) noexcept;
}

#endif
