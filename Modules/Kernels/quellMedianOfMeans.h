// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellMedianOfMeans_h
#define quellMedianOfMeans_h

#include "quellClampLedger.h"
#include "quellImageView.h"
#include "quellKernelsModule.h"

namespace quell
{
enum class MeansEstimator
{
  Mean,   ///< of all
  Median, ///< MoN: the buffer in the middle
  Binary, ///< the mean where G <= giniThreshold, else the median
  Gini    ///< G-MoN: the mean of the middle M - 2 c buffers, c = floor(G floor(M / 2))
};

struct MedianOfMeansParameters
{
  static constexpr int MostBuffers = 64;

  MeansEstimator estimator = MeansEstimator::Gini;
  double giniThreshold = 0.25; ///< of Binary
};

struct MedianOfMeansOutputs
{
  ImageOut radiance; ///< 3
  ImageOut residual; ///< 3
  ImageOut mean;     ///< 3
  ImageOut gini;     ///< 1
};

/// A mean that outliers cannot pull: M buffers of independent, equally many samples are sorted by luminance in every
/// pixel, m_(1) <= ... <= m_(M), and those far out are left away as the Gini coefficient of their luminances says:
///
///   G = 2 Sum_j j l_(j) / (M Sum l) - (M + 1) / M,  in [0, 1); 0 where Sum l = 0; negative luminances count as 0
///
/// With an even M the median is the lower of the two in the middle: their mean would keep an outlier of two halves. Two
/// buffers leave Gini nothing to trim (c = 0); Median is the darker one, Binary that where one has three times the
/// other's luminance. radiance + residual == mean in float, exactly: `mean` is made so, within one unit in the last
/// place of the larger of the two. Buffers that are not finite in a pixel are left out (it is counted once); a pixel
/// without any finite one gets the mean over its 3 x 3 neighbours' finite buffers (0: none), residual 0. Every output
/// may be absent. Any linear unit; `count` in [1, MostBuffers]. Halo 1 for the filling.
///
/// Biased low for skewed noise as every median is, less and less with the samples per buffer, and not at all where the
/// buffers agree. Ledger: EnergyIn of the mean, Clamped where the result is not the mean. Source: Jung, Meyer, DeLong
/// 2015 (MoN); Buisine, Delepoulle, Renaud 2021, "Fireflies removing in Monte Carlo rendering with adaptive
/// median of means" (G).
QUELLKERNELS_EXPORT ClampLedger MedianOfMeans(const ImageIn* buffers, int count,
  const MedianOfMeansParameters& parameters, const MedianOfMeansOutputs& out, const Rect& tile) noexcept;

/// G of `count` values sorted upwards.
QUELLKERNELS_EXPORT double GiniOfSorted(const double* values, int count) noexcept;
}

#endif
