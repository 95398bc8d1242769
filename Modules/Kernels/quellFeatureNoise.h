// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFeatureNoise_h
#define quellFeatureNoise_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>

namespace quell
{
/// Estimates from one image how noisy a feature is: variance of a pixel's value, averaged over its 3 components.
///
///   raw(p) = median over the 3 x 3 neighbours q of |f(q) - f(p)|^2 / 2 / 3 / 0.789
///   V(p)   = median of raw over 3 x 3
///
/// 0.789 is the median of chi^2 / 3 with three degrees of freedom, so that V is right for Gaussian noise of equal size
/// in the components. A neighbour counts when it is inside, finite, hit and (given normals) n(p) . n(q) >= 0.9; fewer
/// than three: raw = 0, unknown. Medians do not mind an edge that takes less than half of the neighbours; a texture
/// finer than three pixels is taken for noise. `value` and `normal` (3), `depth` (1, may be absent) and their extents
/// cover `tile` grown by 2 as far as the frame goes; `out` (1) gets V, 0 where nothing was hit or the value is not
/// finite. `scratch` holds FeatureNoiseScratch(tile) floats. Bias: with noise from few samples (heavy tails) too low,
/// by up to the ratio of mean and median.
QUELLKERNELS_EXPORT void FeatureNoise(const ImageIn& value, const ImageIn& normal, const ImageIn& depth,
  const ImageOut& out, const Rect& tile, float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t FeatureNoiseScratch(const Rect& tile) noexcept;
}

#endif
