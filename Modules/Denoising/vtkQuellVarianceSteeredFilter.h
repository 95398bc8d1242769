// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellVarianceSteeredFilter
 * @brief   cross-filter whose width at every pixel is the one with the smallest estimated error
 *
 * Gaussian kernels of 0.5, 1, 2 ... pixels times weights of the guides; Stein's unbiased estimate of the squared error,
 * from the variance of the pixel's mean, chooses among them and the identity. Formula and rules in
 * quellVarianceSteered.h. Inputs: radiance (port 0), variance; optional depth, normal, albedo, id. Outputs: radiance,
 * variance (propagated), sigma (the width chosen).
 *
 * Where the variance is 0 nothing is filtered: a path tracer's own `variance` says 0 for one sample per pixel and where
 * no sample saw the light; put a vtkQuellVarianceEstimate in between there. The variance must be that of the input: the
 * path tracer's belongs to radiance, not to illumination.
 */
#ifndef vtkQuellVarianceSteeredFilter_h
#define vtkQuellVarianceSteeredFilter_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellVarianceSteeredFilter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellVarianceSteeredFilter);

  ///@{ Kernels to choose among, besides the identity: sigma 0.5, 1, 2, 4, 8 pixels; default 4, range [0, 5].
  vtkSetClampMacro(Scales, int, 0, 5);
  vtkGetMacro(Scales, int);
  ///@}
  ///@{ Of the length of the difference of unit normals, default 0.2, range [0, 1e30].
  vtkSetClampMacro(SigmaNormal, double, 0., 1e30);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Of the relative depth difference, default 0.05, range [0, 1e30].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e30);
  vtkGetMacro(SigmaDepth, double);
  ///@}
  ///@{ Of the albedo difference, default 0.1, range [0, 1e30].
  vtkSetClampMacro(SigmaAlbedo, double, 0., 1e30);
  vtkGetMacro(SigmaAlbedo, double);
  ///@}

  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  double CostPerPixel() const override { return 4; }
  bool CanWeigh() const override { return true; }

protected:
  vtkQuellVarianceSteeredFilter();
  ~vtkQuellVarianceSteeredFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  int Scales = 4;
  double SigmaNormal = 0.2, SigmaDepth = 0.05, SigmaAlbedo = 0.1;
  quell::PixelCount NonFinite;

  vtkQuellVarianceSteeredFilter(const vtkQuellVarianceSteeredFilter&) = delete;
  void operator=(const vtkQuellVarianceSteeredFilter&) = delete;
};

#endif
