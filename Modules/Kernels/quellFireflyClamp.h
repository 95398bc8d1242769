// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFireflyClamp_h
#define quellFireflyClamp_h

#include "quellClampLedger.h"
#include "quellImageView.h"
#include "quellKernelsModule.h"

namespace quell
{
struct FireflyClampParameters
{
  float threshold = 5;
  ClampMeasure measure = ClampMeasure::Length;
  float growth = 0;      ///< exponent g of the count in the threshold; only with `count`
  float largest = 1e30f; ///< L, of a channel of E times albedo; 1e30: off
  float floor = 0.001f;  ///< smallest albedo
};

/// Shortens colours that are too large and keeps their hue:
///
///   t        = threshold n^growth, n = max(1, count) (1 without `count`)
///   filtered = E          where m(E) <= t
///            = E t / m(E) elsewhere
///   residual = E - filtered
///
/// and with L < 1e30 in turn E L / M where M > L, M being the largest magnitude of a channel of E clamp(albedo, floor,
/// 1): what the light is that an illumination E stands for. `count` does not raise L. Without `albedo`, or where it is
/// not finite, it is 1.
///
/// m is the Euclidean length of RGB, the magnitude of the luminance, or the largest channel's magnitude. `radiance` (3)
/// in any linear unit; `count` (1: frames or samples accumulated before this one) may be absent; `filtered` and
/// `residual` (3) may each be absent. filtered + residual == E in float, channel by channel, exactly: where rounding
/// would break that, `filtered` is moved by one ulp towards 0. m is taken in double, so nothing overflows up to
/// FLT_MAX; threshold 0 gives black. A non-finite pixel is replaced by the mean of its finite neighbours (0: none),
/// which is clamped in turn; its residual is 0. A count that is not finite counts as 1. Pixelwise, halo 1 for the
/// filling.
///
/// Biased: it removes the mean of max(0, m - t) of what it is given. With 0 < growth < 1 and the count of what is
/// accumulated after the clamp the bias vanishes with the count, while one outlier adds at most t / n to the mean.
/// Source: Bikker, INFOMAGR 15, `if dot(E,E) > 25: E = 5 E / |E|`; Lighthouse 2 and pbrt (largest channel).
QUELLKERNELS_EXPORT ClampLedger FireflyClamp(const ImageIn& radiance, const ImageIn& count,
  const FireflyClampParameters& parameters, const ImageOut& filtered, const ImageOut& residual, const Rect& tile,
  const ImageIn& albedo = {}) noexcept;
}

#endif
