// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellVarianceEstimate
 * @brief   variance of luminance, over frames where there were enough, else over neighbours
 *
 * SVGF's estimate, formula in quellVariance.h. Inputs: radiance (port 0: accumulated illumination); optional moments
 * (mean, central second moment over frames), length (frames), depth, normal, id, meanRest (the mean's second float).
 * Outputs: variance, radiance.
 *
 * Without moments every pixel is estimated in space (a single frame); without length the moments are trusted
 * everywhere. Output radiance is the input where the history is long enough, else the neighbourhood's mean with the
 * same weights.
 */
#ifndef vtkQuellVarianceEstimate_h
#define vtkQuellVarianceEstimate_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellVarianceEstimate : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellVarianceEstimate);

  ///@{ Frames from which the moments are used, default 4, range [1, 64]; below, the estimate is raised by this over
  /// length.
  vtkSetClampMacro(MinimumHistory, int, 1, 64);
  vtkGetMacro(MinimumHistory, int);
  ///@}
  ///@{ Whose variance:
  /// Frame (0), of one frame's pixel as SVGF has it, or
  /// Mean (1), of the accumulated pixel: divided by min(length, MaximumSamples).
  vtkSetClampMacro(VarianceOf, int, 0, 1);
  vtkGetMacro(VarianceOf, int);
  ///@}
  ///@{ What an endless history is worth in frames, for Mean: (2 - alpha) / alpha, default 9 (alpha .2), range [1, 1e6].
  vtkSetClampMacro(MaximumSamples, double, 1., 1e6);
  vtkGetMacro(MaximumSamples, double);
  ///@}
  ///@{ Depth tolerance in units of the local slope, default 1, range [0, 1e6].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e6);
  vtkGetMacro(SigmaDepth, double);
  ///@}
  ///@{ Exponent of the cosine between normals, default 128, range [0, 4096]. 0: normals do not matter.
  vtkSetClampMacro(SigmaNormal, double, 0., 4096.);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Depth tolerance on a surface without slope, relative to depth, default 1e-4, range [0, 1].
  vtkSetClampMacro(DepthEpsilon, double, 0., 1.);
  vtkGetMacro(DepthEpsilon, double);
  ///@}

  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  double CostPerPixel() const override { return 0.1; }
  bool FillsOutputs() const override { return true; }

protected:
  vtkQuellVarianceEstimate();
  ~vtkQuellVarianceEstimate() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  int MinimumHistory = 4, VarianceOf = 0;
  double MaximumSamples = 9, SigmaDepth = 1, SigmaNormal = 128, DepthEpsilon = 1e-4;
  quell::PixelCount NonFinite;

  vtkQuellVarianceEstimate(const vtkQuellVarianceEstimate&) = delete;
  void operator=(const vtkQuellVarianceEstimate&) = delete;
};

#endif
