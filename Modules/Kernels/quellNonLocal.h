// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellNonLocal_h
#define quellNonLocal_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>

namespace quell
{
/// A feature that steers the weights of the mean, or that the regression explains the colour with.
struct NonLocalFeature
{
  ImageIn value;    ///< 1 to 3 components
  ImageIn variance; ///< absent: 0; of the pixel's mean value, 1 component (averaged over those of `value`) or as many
  double least = 1e-3; ///< tau: squared difference that no pixel resolves
};

struct NonLocalInputs
{
  static constexpr int MostFeatures = 8, MostRegressors = 10;

  ImageIn target;                         ///< 3: what is filtered
  ImageIn guide;                          ///< 3: whose patches are compared; the other half buffer, or `target` itself
  ImageIn variance;                       ///< of `guide`'s pixel values, 1 component (for all channels) or 3; absent: 0
  ImageIn depth;                          ///< 1, +inf where nothing was hit; absent: everything is hit
  NonLocalFeature weighing[MostFeatures]; ///< enter the weights
  int weighingCount = 0;
  NonLocalFeature regressors[MostFeatures]; ///< value alone; MostRegressors components together
  int regressorCount = 0;
};

struct NonLocalParameters
{
  int radius = 10; ///< of the window, pixels
  int patch = 3;   ///< of the patches
  double kColor = 0.45;
  double kFeature = 0.6;
  double epsilon = 1e-7; ///< squared colour units, keeps 0 / 0 out
  bool regress = false;
  double ridge = 1e-4; ///< added to the diagonal of the normalised normal equations
};

/// One pair of pixels of the patch distance, before it is averaged over the patch and the channels:
/// ((up - uq)^2 - (Vp + min(Vp, Vq))) / (epsilon + k^2 (Vp + Vq)), at most 1e4.
QUELLKERNELS_EXPORT double NonLocalDistance(double up, double uq, double vp, double vq, double k, double epsilon);

/// Joint non-local means, or first-order regression with its weights, of the pixels of a tile.
///
///   d(p, q) = mean over the patch and the channels of NonLocalDistance(u(p + o), u(q + o), ...)
///   F(p, q) = max over the weighing features of
///             max(0, |f(p) - f(q)|^2 - (V(p) + min(V(p), V(q)))) / (kFeature^2 max(tau, V(p), |grad f(p)|^2))
///   w(p, q) = exp(-max(0, d, F))
///
///   mean:     C'(p) = C(p) + Sum_q w(p, q) (C(q) - C(p)) / Sum_q w(p, q)
///   regress:  for every p the b that minimises Sum_q w(p, q) |C(q) - C(p) - b x|^2,
///             x = (1, dx / r, dy / r, f(q) - f(p))
///             (columns scaled to length 1, `ridge` on the diagonal but for the constant); each pixel gets the mean of
///             what the models around it predict for it, C'(q) = Sum_p w(p, q) (C(p) + b_p x) / Sum_p w(p, q), but not
///             less than min(0, C(q))
///
/// Pixels of a patch pair that are outside the frame, not finite or not hit are left out of d. Such pixels are no taps;
/// one that is not finite counts as the mean of its finite 3 x 3 neighbours where it is filtered; one without a hit
/// passes through. Feature values that are not finite count as 0, variances below 0 or not finite as 0. Constants are
/// fixed points to the last bit; images that are linear in the window and the features are reproduced by the regression
/// (to the ridge). The views cover the tile grown by NonLocalHalo as far as the frame goes. `scratch` holds
/// NonLocalScratch(...) floats. Returns the number of pixels of `tile` that were not finite. The bits do not depend on
/// the tile. Cost per pixel: (2 radius + 1)^2 weights of about 50 operations; the regression adds (m + 1) (m + 8) / 2 +
/// 3 m multiply-adds to each, m = 2 + components of the regressors. Source: Rousselle, Knaus and Zwicker 2012;
/// Rousselle, Manzi and Zwicker 2013 (features, sections 4 and 5); Bitterli et al. 2016, section 4, for the regression.
QUELLKERNELS_EXPORT std::int64_t NonLocal(const NonLocalInputs& in, const NonLocalParameters& parameters,
  const ImageOut& out, const Rect& tile, float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t NonLocalScratch(
  const NonLocalInputs& in, const NonLocalParameters& parameters, const Rect& tile) noexcept;
constexpr int NonLocalHalo(int radius, int patch, bool regress) noexcept
{
  return (regress ? 2 : 1) * radius + patch + 1;
}
/// What the regression makes pixel (x, y) of: C' = Sum_q weights(q) C(q), before it is kept above min(0, C). `weights`
/// has 1 component and covers the pixels within 2 radius, as far as the frame goes. In double; allocates.
QUELLKERNELS_EXPORT void NonLocalRegressionWeights(
  const NonLocalInputs& in, const NonLocalParameters& parameters, int x, int y, const ImageOut& weights);
/// The same straight from the formula in double, for tests.
QUELLKERNELS_EXPORT void NonLocalScalar(
  const NonLocalInputs& in, const NonLocalParameters& parameters, const ImageOut& out, const Rect& tile);
}

#endif
