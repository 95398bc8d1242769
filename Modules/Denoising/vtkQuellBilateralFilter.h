// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellBilateralFilter
 * @brief   bilateral and cross-bilateral filter
 *
 * Weighted mean over (2 Radius + 1)^2 pixels, Gaussian in distance, colour (range) and every connected guide, one exp
 * per tap; formula, border and non-finite rule in quellBilateral.h. Inputs: radiance (port 0); optional depth, normal,
 * albedo, position, id. Outputs: radiance. A sigma of 0 lets only equal values pass, 1e30 removes the term.
 *
 * Colour alone is a poor guide on raw path-traced input, where a firefly resembles only itself: clamp first, filter
 * illumination, connect guides and raise SigmaRange.
 */
#ifndef vtkQuellBilateralFilter_h
#define vtkQuellBilateralFilter_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellBilateralFilter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellBilateralFilter);

  ///@{ Half the window's side in pixels; -1 (default): ceil(3 SigmaSpatial), at most 64. Range [-1, 64]. 0: identity.
  vtkSetClampMacro(Radius, int, -1, 64);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Standard deviation in pixels, default 2, range [0, 1e30].
  vtkSetClampMacro(SigmaSpatial, double, 0., 1e30);
  vtkGetMacro(SigmaSpatial, double);
  ///@}
  ///@{ Of colour, in units of Range, default 0.5, range [0, 1e30].
  vtkSetClampMacro(SigmaRange, double, 0., 1e30);
  vtkGetMacro(SigmaRange, double);
  ///@}
  ///@{ What colours are compared in: Linear (0), ToneMapped c / (1 + lum c) (1, default), Log log(1 + c) (2).
  vtkSetClampMacro(Range, int, 0, 2);
  vtkGetMacro(Range, int);
  ///@}
  ///@{ Of the length of the difference of unit normals, default 0.2, range [0, 1e30].
  vtkSetClampMacro(SigmaNormal, double, 0., 1e30);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Of the relative depth difference (with positions: plane distance / depth), default 0.05, range [0, 1e30].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e30);
  vtkGetMacro(SigmaDepth, double);
  ///@}
  ///@{ Of the albedo difference, default 0.1, range [0, 1e30].
  vtkSetClampMacro(SigmaAlbedo, double, 0., 1e30);
  vtkGetMacro(SigmaAlbedo, double);
  ///@}

  int HaloFor(int port) const override;

protected:
  vtkQuellBilateralFilter();
  ~vtkQuellBilateralFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  int EffectiveRadius() const;

  int Radius = -1;
  double SigmaSpatial = 2, SigmaRange = 0.5;
  int Range = 1;
  double SigmaNormal = 0.2, SigmaDepth = 0.05, SigmaAlbedo = 0.1;
  quell::PixelCount NonFinite;

  vtkQuellBilateralFilter(const vtkQuellBilateralFilter&) = delete;
  void operator=(const vtkQuellBilateralFilter&) = delete;
};

#endif
