// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFlip_h
#define quellFlip_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>

namespace quell
{
/// The FLIP difference (version 1.6) for 67.020645 pixels per degree, cut into steps over rows so that the caller owns
/// memory and threads. All planes are width x height doubles, row by row; image borders repeat the outermost pixels.
///
/// Order: FlipDecode of the whole image, then FlipRow for all rows, then FlipColumn for all rows, each for test and
/// reference; FlipPixel then compares. Input is linear RGB; values outside of [0, 1] are clamped.
///
/// 1. linear RGB -> YCxCz; Y is kept for the features. 2. A Gaussian contrast-sensitivity filter for each channel.
/// 3. Back to RGB, clamped to [0, 1], then L*a*b* with the Hunt adjustment. 4. HyAB distance to the power 0.7, mapped
/// so that 0.4 of the largest possible is 0.95. 5. Edges and points: first and second derivatives of Gaussians of Y,
/// their difference in length over sqrt 2, to the power 0.5. 6. colour^(1 - feature). Sources: Andersson et al. 2020
/// (LDR), 2021 (HDR); constants of version 1.6.
struct FlipImage
{
  static constexpr int Decoded = 3, Rows = 4 + 3, Final = 3 + 2;
  int width = 0, height = 0;
  double* decoded = nullptr; ///< Decoded planes: Y, Cx, Cz
  double* rows = nullptr;    ///< Rows planes: filtered along x
  double* final = nullptr;   ///< Final planes: L, a, b after Hunt; edge, point

  std::size_t planeSize() const noexcept { return std::size_t(width) * std::size_t(height); }
};

/// `tone`: absent (false) for LDR; otherwise the colour is multiplied by 2^exposure and goes through the ACES-like
/// curve (k0 x^2 + k1 x + k2) / (k3 x^2 + k4 x + k5), k = (.9036, .018, 0, .8748, .354, .14). y0 <= row < y1.
QUELLKERNELS_EXPORT void FlipDecode(
  const ImageIn& image, bool tone, double exposure, const FlipImage& out, int y0, int y1) noexcept;
QUELLKERNELS_EXPORT void FlipRow(const FlipImage& image, int y0, int y1) noexcept;
QUELLKERNELS_EXPORT void FlipColumn(const FlipImage& image, int y0, int y1) noexcept;
/// In [0, 1].
QUELLKERNELS_EXPORT double FlipPixel(const FlipImage& test, const FlipImage& reference, int x, int y) noexcept;

/// The exposures (powers of two) of HDR-FLIP: from where the largest luminance of the reference maps to 0.85 to where
/// its median does, `count` >= 2 equally spaced steps; the pixel's HDR-FLIP is the largest FLIP over them.
struct FlipExposures
{
  double start = 0, stop = 0;
  int count = 2;

  double at(int i) const noexcept { return count < 2 ? start : start + i * (stop - start) / (count - 1); }
};
/// A median of 0 (an image that is mostly black) is replaced by `smallest`, the smallest positive luminance; an
/// entirely black reference gives exposure 0.
QUELLKERNELS_EXPORT FlipExposures FlipExposureRange(double largest, double median, double smallest) noexcept;
}

#endif
