// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSampleFilter_h
#define quellSampleFilter_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>

namespace quell
{
/// One image per sample and quantity: `count` views each, or null where a quantity is not used. They cover the tile
/// grown by the radius, as far as the frame goes.
struct SampleFilterInputs
{
  int count = 0;
  const ImageIn* radiance = nullptr; ///< 3, linear
  const ImageIn* depth = nullptr;    ///< 1, +inf where nothing was hit
  const ImageIn* normal = nullptr;   ///< 3, unit
  const ImageIn* albedo = nullptr;   ///< 3
  const ImageIn* id = nullptr;       ///< 1
};

enum class SamplePairs
{
  Same, ///< sample t of a pixel meets sample t of its neighbours
  All   ///< and every other of theirs and of its own pixel
};

/// A sigma of 0 lets only equal values pass; a sigma of at least 1e30 removes its term.
struct SampleFilterParameters
{
  int radius = 5;
  double sigmaSpatial = 2; ///< pixels
  double sigmaNormal = 0.2;
  double sigmaDepth = 0.05; ///< relative to depth
  double sigmaAlbedo = 0.1;
  SamplePairs pairs = SamplePairs::All;
  bool demodulate = false; ///< filter radiance / albedo of every sample, multiply by the sample's own albedo after
  float floor = 1e-3f;     ///< albedos below count as this, as in Demodulate
};

/// Filters samples instead of pixels, and only then averages the pixel:
///
///   C'(p) = 1/N Sum_t a_pt Sum_{q, s in S(t)} w(pt, qs) c_qs / a_qs  /  Sum_{q, s in S(t)} w(pt, qs)
///   w     = exp(-(|q-p|^2 / 2 ss^2 + D)), 0 for another id
///   D     = |n_pt - n_qs|^2 / 2 sn^2 + (ln z_pt / z_qs)^2 / 2 sd^2 + |a_pt - a_qs|^2 / 2 sa^2
///
/// with S(t) = {t} or all samples, and a = 1 without `demodulate`. Every sample is compared by features of its own, so
/// that a pixel with two surfaces in it (an edge, a lens out of focus, an open shutter) takes from each what belongs to
/// it, in the parts that the pixel filter gave them: the filter runs before the pixel filter. From means per pixel such
/// a pixel resembles nobody. With one sample this is the cross-bilateral filter of the pixel without a term of colour
/// (the colour of one sample is mostly noise). Cost: N windows for Same, N^2 for All; memory N times the arrays.
///
/// Border: taps outside have weight 0. A sample that is not finite has weight 0; as a centre it becomes its neighbours'
/// mean (without usable taps: of the finite 3 x 3 of its image, else 0). A guide value that is not finite is left out
/// for its pairs. With depths, samples without a hit pass through and are no taps. Constants are fixed points. Without
/// noise in the features the mean of the noise is kept: no bias from colour. Returns the number of pixels of `tile`
/// with a sample that is not finite. `scratch` holds SampleFilterScratch floats. Source: Bikker, INFOMAGR 15,
/// "accumulated or individual samples?"; sample features as in Sen and Darabi 2012 (random parameter filtering).
QUELLKERNELS_EXPORT std::int64_t SampleFilter(const SampleFilterInputs& in, const SampleFilterParameters& parameters,
  const ImageOut& out, const Rect& tile, float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t SampleFilterScratch(
  const SampleFilterInputs& in, const SampleFilterParameters& parameters, const Rect& tile) noexcept;
/// The same straight from the formula in double, for tests.
QUELLKERNELS_EXPORT void SampleFilterScalar(const SampleFilterInputs& in, const SampleFilterParameters& parameters,
  const ImageOut& out, const Rect& tile) noexcept;
}

#endif
