// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellATrousFilter
 * @brief   edge-avoiding a-trous wavelet filter of SVGF
 *
 * Iterations passes of the 5 x 5 B3 spline kernel with steps 1, 2, 4 ..., each tap weighted by depth, normal and
 * luminance; formula, border and non-finite rule in quellATrous.h. Inputs: radiance (port 0); optional variance, depth,
 * normal, id. Outputs: radiance, variance (propagated; makes the luminance weight tighter from pass to pass and is no
 * error bar: taps of later passes are correlated), feedback (the colour after pass FeedbackIteration, for the next
 * frame's history).
 *
 * Without variance the luminance weight uses SigmaColor, halved in every pass (Dammertz et al. 2010), and output
 * variance is 0 with a warning. Without depth every pixel counts as hit at the same depth; without normals wn = 1.
 * Background passes through. Keeps its planes (about 19 floats per pixel of the grown region) between frames.
 */
#ifndef vtkQuellATrousFilter_h
#define vtkQuellATrousFilter_h

#include "quellGuidedPlanes.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellATrousFilter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellATrousFilter);

  ///@{ Passes, default 5, range [0, 10]. 0: identity. The region grows by 2 (2^Iterations - 1) pixels.
  vtkSetClampMacro(Iterations, int, 0, 10);
  vtkGetMacro(Iterations, int);
  ///@}
  ///@{ Depth tolerance in units of the local slope, default 1, range [0, 1e6].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e6);
  vtkGetMacro(SigmaDepth, double);
  ///@}
  ///@{ Exponent of the cosine between normals, default 128, range [0, 4096]. 0: normals do not matter.
  vtkSetClampMacro(SigmaNormal, double, 0., 4096.);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Luminance tolerance in standard deviations, default 4, range [0, 1e6]. 1e6: practically off.
  vtkSetClampMacro(SigmaLuminance, double, 0., 1e6);
  vtkGetMacro(SigmaLuminance, double);
  ///@}
  ///@{ Luminance tolerance of the first pass without variance, default 1, range [0, 1e30].
  vtkSetClampMacro(SigmaColor, double, 0., 1e30);
  vtkGetMacro(SigmaColor, double);
  ///@}
  ///@{ After which pass output feedback is taken, default 1, range [0, 10]; 0: the input; more than Iterations: the
  /// result.
  vtkSetClampMacro(FeedbackIteration, int, 0, 10);
  vtkGetMacro(FeedbackIteration, int);
  ///@}
  ///@{ Depth tolerance on a surface without slope, relative to depth, default 1e-4, range [0, 1].
  vtkSetClampMacro(DepthEpsilon, double, 0., 1.);
  vtkGetMacro(DepthEpsilon, double);
  ///@}
  ///@{ Luminance tolerance without variance, relative to 1 + luminance, default 1e-6, range [1e-9, 1].
  vtkSetClampMacro(LuminanceEpsilon, double, 1e-9, 1.);
  vtkGetMacro(LuminanceEpsilon, double);
  ///@}

  /// Of all passes together.
  bool CanWeigh() const override { return true; }
  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  double CostPerPixel() const override { return 0.1 + 0.18 * this->Iterations; }
  bool FillsOutputs() const override { return true; }

protected:
  vtkQuellATrousFilter();
  ~vtkQuellATrousFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  int Iterations = 5, FeedbackIteration = 1;
  double SigmaDepth = 1, SigmaNormal = 128, SigmaLuminance = 4, SigmaColor = 1;
  double DepthEpsilon = 1e-4, LuminanceEpsilon = 1e-6;
  quell::PixelCount NonFinite;
  quell::GuidedPlanes Planes;

  vtkQuellATrousFilter(const vtkQuellATrousFilter&) = delete;
  void operator=(const vtkQuellATrousFilter&) = delete;
};

#endif
