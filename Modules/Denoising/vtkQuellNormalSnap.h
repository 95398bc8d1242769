// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellNormalSnap
 * @brief   gives pixels that show several surfaces the normal of one of them
 *
 * The mean of the unit normals of a pixel's samples has length 1 only where they agree. On creases and silhouettes it
 * is like the normals of none of the surfaces: guided filters find no taps there, history is refused, and the pixel
 * stays as noisy as it came. Normals shorter than 0.99 (or, where a source makes normals unit, those whose variance
 * says that the samples' differ) are replaced by the normal of the neighbour, within 5 x 5 pixels, that fits the
 * pixel's depth (or position) and id and is most like the mean; see quellSnapNormals.h for the formula. Filters then
 * treat the pixel's light as that of this one surface; the albedo, mixed as it is, keeps the edge smooth once it is
 * multiplied again.
 *
 * Inputs: normal (port 0); optional depth, position (instead of depth: distance from the neighbour's plane), id, all of
 * one sample of the pixel or as good, and varianceNormal. Output: normal. Border: neighbours outside are no candidates.
 * A normal that is not finite becomes 0. Normals of pixels that are not mixed, or without a hit, stay to the last bit.
 */
#ifndef vtkQuellNormalSnap_h
#define vtkQuellNormalSnap_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellNormalSnap : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellNormalSnap);

  ///@{ Of plane distance or depth relative to depth, default 0.02, range [1e-6, 1e30].
  vtkSetClampMacro(SigmaDepth, double, 1e-6, 1e30);
  vtkGetMacro(SigmaDepth, double);
  ///@}

  ///@{ Variance per component of the mean normal from which a pixel is mixed, where the variance is connected; default
  /// 0.001, range [0, 1].
  vtkSetClampMacro(MixedVariance, double, 0., 1.);
  vtkGetMacro(MixedVariance, double);
  ///@}

  int HaloFor(int port) const override;
  void CheckConnections(quell::ConnectionCheck& check) const override;

protected:
  vtkQuellNormalSnap();
  ~vtkQuellNormalSnap() override = default;
  void Execute(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  double SigmaDepth = 0.02, MixedVariance = 1e-3;
  quell::PixelCount NonFinite;

  vtkQuellNormalSnap(const vtkQuellNormalSnap&) = delete;
  void operator=(const vtkQuellNormalSnap&) = delete;
};

#endif
