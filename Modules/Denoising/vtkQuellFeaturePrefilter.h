// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellFeaturePrefilter
 * @brief   takes the noise out of albedo and normals before they demodulate and guide
 *
 * A spectral renderer's albedo, a bump-mapped normal, features behind a lens or a moving shutter are noisy themselves;
 * a layer divided by them and filters guided by them keep that noise. Each feature f is filtered along the surface:
 *
 *   f'(p) = Sum w f(q) / Sum w over |dx|, |dy| <= Radius,   w = exp(-(N + P + S)) where the ids agree
 *   N = |n(q) - n(p)|^2 / 2 SigmaNormal^2                                   (albedo only)
 *   P = (n(p) . (x(q) - x(p)) / z(p))^2 / 2 SigmaDepth^2, without positions (ln z(q) - ln z(p))^2 / 2 SigmaDepth^2
 *   S = max(0, |f(q) - f(p)|^2 - (V(p) + min(V(p), V(q)))) / 2 max(SigmaFeature^2, V(p))
 *
 * with the feature's variance V (quellBilateral.h), from varianceAlbedo or varianceNormal where connected, else
 * estimated (quellFeatureNoise.h): what the noise explains does not count as an edge, textures and creases beyond it
 * stay. Inputs: albedo (port 0), normal, depth, position, id, varianceAlbedo, varianceNormal, all but the first
 * optional. Outputs: albedo, normal (length 1, or 0). Border: taps outside weigh nothing. Pixels without a hit and
 * features that are constant stay to the last bit; a feature that is not finite becomes the mean of its neighbours.
 * Source: the prefiltering step of Rousselle, Manzi and Zwicker 2013, section 5.1, with plane distances.
 */
#ifndef vtkQuellFeaturePrefilter_h
#define vtkQuellFeaturePrefilter_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellFeaturePrefilter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellFeaturePrefilter);

  ///@{ Half the window's side in pixels, default 5, range [0, 32]. 0: identity.
  vtkSetClampMacro(Radius, int, 0, 32);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Difference of a feature without noise that counts as an edge, default 0.01, range [0, 1e30]; 1e30: none does.
  vtkSetClampMacro(SigmaFeature, double, 0., 1e30);
  vtkGetMacro(SigmaFeature, double);
  ///@}
  ///@{ Of the length of the difference of unit normals, for the albedo, default 0.2, range [0, 1e30].
  vtkSetClampMacro(SigmaNormal, double, 0., 1e30);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Of plane distance or depth relative to depth, default 0.02, range [0, 1e30].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e30);
  vtkGetMacro(SigmaDepth, double);
  ///@}
  ///@{ Estimate the variance that is not connected, default on; off: such a feature counts as free of noise.
  vtkSetMacro(EstimateNoise, bool);
  vtkGetMacro(EstimateNoise, bool);
  ///@}

  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  void CheckConnections(quell::ConnectionCheck& check) const override;
  double CostPerPixel() const override { return 0.1 + (2 * this->Radius + 1) * (2 * this->Radius + 1) / 121.; }

protected:
  vtkQuellFeaturePrefilter();
  ~vtkQuellFeaturePrefilter() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  int Radius = 5;
  double SigmaFeature = 0.01, SigmaNormal = 0.2, SigmaDepth = 0.02;
  bool EstimateNoise = true;
  quell::PixelCount NonFinite;

  vtkQuellFeaturePrefilter(const vtkQuellFeaturePrefilter&) = delete;
  void operator=(const vtkQuellFeaturePrefilter&) = delete;
};

#endif
