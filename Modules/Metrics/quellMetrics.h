// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellMetrics_h
#define quellMetrics_h

#include "quellImageView.h"
#include "quellStageDescription.h"
#include "vtkQuellMetricsModule.h"

#include <string>
#include <vector>

namespace quell
{
/// Image errors, in double, with t the test and r the reference; images are linear unless said. The same bits for any
/// number of threads. Scalars are means over pixels of the mean over channels.
///
///   MSE, RMSE, MAE   (t - r)^2, its root, |t - r|
///   relMSE           (t - r)^2 / (r^2 + 0.01)
///   relMSE@0.1%      the same without the worst 0.1 % of the pixels (rounded down), so that single fireflies do not
///   decide MRSE             (t - r)^2 / (r + 0.01)^2, as pbrt has it SMAPE            |t - r| / (|t| + |r| + 0.01)
///   PSNR             -10 log10(MSE) in dB of both images after c / (1 + c) per channel and the sRGB transfer; peak 1
///   PSNR-linear      the same of both clamped to [0, 1]; both at most 200 dB (identical images)
///   SSIM             structural similarity, 11 x 11 Gaussian window of sigma 1.5, whole windows only, mean over
///   channels, toned as
///                    for PSNR; 1 for identical images; at least 11 x 11 pixels
///   SSIM-linear      the same of images clamped to [0, 1]
///   FLIP             FLIP 1.6 of images clamped to [0, 1], 67.02 pixels per degree, 3 channels
///   HDR-FLIP         its largest value over exposures chosen from the reference
VTKQUELLMETRICS_EXPORT std::vector<std::string> MetricNames();
/// True for PSNR and SSIM.
VTKQUELLMETRICS_EXPORT bool HigherIsBetter(const std::string& name);
/// What computing a metric takes for each pixel of the images, besides them: FLIP has many planes.
VTKQUELLMETRICS_EXPORT double MetricScratchBytes(const std::string& name);
/// Throws StageError: unknown name (with the nearest), different sizes or channels, empty or too small images, 3
/// channels missing (FLIP), pixels that are not finite (how many, and where the first is).
VTKQUELLMETRICS_EXPORT double ComputeMetric(const std::string& name, const ImageIn& test, const ImageIn& reference);
/// The metric's value of each pixel into `map` (1 channel, same size): the squared error for MSE, RMSE and PSNR (toned
/// or clamped there), relMSE for relMSE@0.1% too, 1 - SSIM (borders repeated), FLIP. Throws as ComputeMetric does.
VTKQUELLMETRICS_EXPORT void ComputeErrorMap(
  const std::string& name, const ImageIn& test, const ImageIn& reference, const ImageOut& map);
}

#endif
