// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellRegressionFilter
 * @brief   nonlinearly weighted first-order regression
 *
 * Around every pixel the colour is explained as a constant plus slopes in x, y and the components of every feature, by
 * least squares weighted like non-local means; a pixel gets the weighted mean of what the models around it predict.
 * Formulas in quellNonLocal.h, half buffers and variance in vtkQuellNonLocalFilter.h. Inputs as NonLocalMeans, and
 * feature (repeatable, 10 components together): albedo, normal, position ... of little noise (FeaturePrefilter).
 * Outputs: radiance, variance.
 *
 * With halves and KColorNarrow there are two candidates f, of both widths, and each pixel takes the better one by
 *
 *   error(k) = mean over the channels of ((B - fA)^2 + (A - fB)^2) / 2 - 2 V - (fB - fA)^2 / 4,  V of the pixel's mean,
 *
 * smoothed like the choice (0 or 1) itself by non-local means (radius 9, patches of 3 x 3, k = 1).
 *
 * Why this one and not blockwise regression (BMFR): that costs a hundredth, but fits blocks of 32 x 32 whose edges only
 * the accumulation over frames hides; for stills the model of every pixel is worth its price, and along shading
 * gradients and antialiased edges, where a mean of any weights is biased, it is exact to first order. The second pass
 * of Bitterli et al. is a second stage. Features must not share the colour's noise (a spectral renderer's albedo does):
 * the model would explain the noise. Energy: not kept, but linear images are. Predictions below 0 become 0 where the
 * pixel was not below. Cost: with 6 feature components about 300 operations per tap, twice with halves, four times with
 * two bandwidths. Source: Bitterli et al. 2016, Nonlinearly weighted first-order regression for denoising Monte Carlo
 * renderings.
 */
#ifndef vtkQuellRegressionFilter_h
#define vtkQuellRegressionFilter_h

#include "vtkQuellNonLocalFilter.h"

class VTKQUELLDENOISING_EXPORT vtkQuellRegressionFilter : public vtkQuellNonLocalFilter
{
public:
  vtkTypeMacro(vtkQuellRegressionFilter, vtkQuellNonLocalFilter);
  static vtkQuellRegressionFilter* New();
  const quell::StageDescription& GetDescription() const override;
  static void Describe(quell::StageDescription& d);

  ///@{ Added to the diagonal of the normalised equations, default 1e-4, range [1e-6, 1e6]; 1e6: a weighted mean.
  vtkSetClampMacro(Ridge, double, 1e-6, 1e6);
  vtkGetMacro(Ridge, double);
  ///@}

  ///@{ With halves, the second, narrower KColor, default 0.5, range [0, 1e15]; 0: there is none.
  vtkSetClampMacro(KColorNarrow, double, 0., 1e15);
  vtkGetMacro(KColorNarrow, double);
  ///@}

protected:
  vtkQuellRegressionFilter();
  ~vtkQuellRegressionFilter() override = default;
  bool Regresses() const override { return true; }
  bool Selects() const override;

private:
  vtkQuellRegressionFilter(const vtkQuellRegressionFilter&) = delete;
  void operator=(const vtkQuellRegressionFilter&) = delete;
};

#endif
