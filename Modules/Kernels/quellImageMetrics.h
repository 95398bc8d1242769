// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellImageMetrics_h
#define quellImageMetrics_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// Error of one value t against its reference r; a pixel's error is the mean over its channels.
enum class PixelError
{
  Squared,         ///< (t - r)^2
  Absolute,        ///< |t - r|
  RelativeSquared, ///< (t - r)^2 / (r^2 + 0.01): relMSE
  Mrse,            ///< (t - r)^2 / (r + 0.01)^2: pbrt's form
  Smape,           ///< |t - r| / (|t| + |r| + 0.01)
  SquaredToned,    ///< squared, both through ToneForMetrics
  SquaredClamped   ///< squared, both clamped to [0, 1]
};

/// c / (1 + c), then the sRGB transfer (12.92 c up to 0.0031308, else 1.055 c^(1/2.4) - 0.055); negative values give 0.
QUELLKERNELS_EXPORT double ToneForMetrics(double c) noexcept;
QUELLKERNELS_EXPORT double ClampForMetrics(double c) noexcept; ///< to [0, 1]

/// Error of the pixel at column `x`, row `y`, both counted from the corner of either view (their extents may differ in
/// place, not in size). Views must have the same number of channels.
QUELLKERNELS_EXPORT double PixelErrorAt(
  PixelError kind, const ImageIn& test, const ImageIn& reference, int x, int y) noexcept;

/// Sum over one row in double, from left to right: adding rows in order gives the same bits for any thread count.
QUELLKERNELS_EXPORT double ErrorRowSum(PixelError kind, const ImageIn& test, const ImageIn& reference, int y) noexcept;

/// Sum of all but the `leftOut` largest of `count` errors. `scratch` holds `count` values and is overwritten.
QUELLKERNELS_EXPORT double TrimmedSum(
  const double* errors, double* scratch, std::int64_t count, std::int64_t leftOut) noexcept;

/// Pixels with a value that is not finite, and the first of them in row order (corner-relative; untouched when none).
QUELLKERNELS_EXPORT std::int64_t CountNonFinite(const ImageIn& image, int& firstX, int& firstY) noexcept;
}

#endif
