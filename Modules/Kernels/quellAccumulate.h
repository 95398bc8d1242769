// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellAccumulate_h
#define quellAccumulate_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// The new frame and the history that was reprojected onto it (all of the current frame). `radiance` needs one pixel of
/// halo, which is read only to fill non-finite pixels. `moments` may be absent. `meanRest`, where it is there, is what
/// the mean of the moments has beyond a float, and makes the mean one of two floats.
struct AccumulateInputs
{
  ImageIn radiance, history, moments, length;
  ImageIn meanRest = {};
};

struct AccumulateParameters
{
  double alpha = 0.05;
  double momentsAlpha = 0.2;
  double maximumHistory = 32;
};

struct AccumulateOutputs
{
  ImageOut radiance, moments, history;
  ImageOut meanRest = {}; ///< 0 without the input of that name
};

/// Exponential moving average with a true mean at its start. With x the new value, h' the history length (0: none):
///   h = min(h' + 1, maximumHistory);  a = max(alpha, 1 / h);  C = C' + a (x - C')
/// and for the moments of luminance, with a = max(momentsAlpha, 1 / h) and d = lum(x) - mean':
///   mean = mean' + a d;  M2 = (1 - a)(M2' + a d^2)          (central: nothing cancels, unlike E[x^2] - E[x]^2)
/// In steady state independent noise keeps alpha / (2 - alpha) of its variance.
///
/// A mean that is one float stands still where am d is below half its step, and d has that error: M2 is right within
/// 1e-3 up to a mean of 1e4 deviations. With `meanRest` mean' is the sum of two floats, mean = hi + lo with lo at most
/// half a step of hi, and d = (sum of w_c (x_c - hi)) - lo with the weights w_c of luminance, where the differences are
/// exact: within 1e-3 up to 1e6, where the samples' own step (1/16) is 3e-4 of the variance.
///
/// A non-finite pixel counts as no new sample: the history stays as it is. Where there is none either, the mean of the
/// finite pixels of the 3 x 3 is stored (0 when there are none) with length 0, so that the next frame does not use it.
/// A history that is not finite counts as none. Nothing non-finite is ever stored. Returns how many pixels of `tile`
/// were not finite.
///
/// Float vectors, within 1e-5 of the scalar code, which is in double and does the pixels with a value that is not
/// finite or beyond 1e18.
QUELLKERNELS_EXPORT std::int64_t Accumulate(const AccumulateInputs& in, const AccumulateParameters& parameters,
  const AccumulateOutputs& out, const Rect& tile) noexcept;
QUELLKERNELS_EXPORT std::int64_t AccumulateScalar(const AccumulateInputs& in, const AccumulateParameters& parameters,
  const AccumulateOutputs& out, const Rect& tile) noexcept; ///< reference, for tests
}

#endif
