// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellBilateralFilter
 * @brief   bilateral and cross-bilateral filter
 *
 * Weighted mean over (2 Radius + 1)^2 pixels, Gaussian in distance, colour (range) and every connected guide, one exp
 * per tap; formula, border and non-finite rule in quellBilateral.h. Inputs: radiance (port 0); optional depth, normal,
 * albedo, position, id with a sigma each; and guide, repeatable, for any list of features. In XML
 *
 *     <input port="guide" from="pt:roughness" sigma="0.1"/>
 *     <input port="guide" from="pt:albedo" distance="Euclidean" sigma="0.1" name="a"/>
 *     <input port="guideVariance" from="pt:varianceAlbedo" guide="a"/>
 *
 * `distance` is Euclidean, Color (in the space Range), Normal, Plane (positions; needs normal), LogDepth or Id; without
 * it, what suits the array's name. A guideVariance tells the variance of the noise in the guide whose `name` (by
 * default the name of its array) it gives; with a single guide that may be left out. Outputs: radiance and, with the
 * same weights, the arrays of the first input that Arrays names (alpha). A sigma of 0 lets only equal values pass, 1e30
 * removes the term. Energy: not kept; noise-free guides keep edges, the range term is biased towards dark.
 *
 * Cost: (2 Radius + 1)^2 taps; without planes and noisy guides and up to a radius of 8 each weight serves both of its
 * pixels. Colour alone is a poor guide on raw path-traced input, where a firefly resembles only itself: clamp first,
 * filter illumination, connect guides and raise SigmaRange.
 */
#ifndef vtkQuellBilateralFilter_h
#define vtkQuellBilateralFilter_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

#include <map>
#include <utility>

namespace quell
{
struct BilateralInputs;
struct BilateralParameters;
}

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
  ///@{ What colours c = radiance / White are compared in: Linear c (0), ToneMapped c / (1 + lum c) (1, default), Log
  /// log(1 + c) (2).
  vtkSetClampMacro(Range, int, 0, 2);
  vtkGetMacro(Range, int);
  ///@}
  ///@{ Radiance that is white in the picture, default 1, range [1e-30, 1e30]. A frame k times as bright is filtered
  ///alike
  /// with k times this.
  vtkSetClampMacro(White, double, 1e-30, 1e30);
  vtkGetMacro(White, double);
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

  ///@{ Names of further arrays of the first input that take the colour's weights, by blanks; 4 components together.
  void SetArrays(const std::string& names);
  const std::string& GetArrays() const { return this->Arrays; }
  ///@}

  bool CanWeigh() const override { return true; }
  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  double CostPerPixel() const override;
  bool FillsOutputs() const override { return true; }
  bool Makes(const std::string& array) const override;
  void CheckSettings() override;
  void CheckConnections(quell::ConnectionCheck& check) const override;
  /// `name`, `distance` and `sigma` of a guide; `guide` of a guideVariance.
  bool SetInputAttribute(
    int port, int connection, const std::string& name, const std::string& value, std::string& error) override;

protected:
  vtkQuellBilateralFilter();
  ~vtkQuellBilateralFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  int EffectiveRadius() const;
  /// Radiance and guides as the ports have them, and the properties.
  void Gather(quell::StageFrame& frame, quell::BilateralInputs& in, quell::BilateralParameters& p) const;
  struct GuideSettings
  {
    std::string Name;  ///< of a guide, or of the guide whose variance it is; empty: the array's
    int Distance = -1; ///< quell::GuideDistance; -1: what suits the array
    double Sigma = -1; ///< -1: what suits the distance
  };

  GuideSettings SettingsOf(int port, int connection) const;
  int DistanceOf(int connection, const std::string& array, bool normals) const; ///< quell::GuideDistance in force
  std::string GuideName(int connection, const std::string& array) const;
  void CheckGuide(quell::ConnectionCheck& check, int connection) const;

  int Radius = -1;
  double SigmaSpatial = 2, SigmaRange = 0.5;
  double White = 1;
  int Range = 1;
  double SigmaNormal = 0.2, SigmaDepth = 0.05, SigmaAlbedo = 0.1;
  std::string Arrays;
  std::map<std::pair<int, int>, GuideSettings> Settings; ///< by port and connection
  quell::PixelCount NonFinite;

  vtkQuellBilateralFilter(const vtkQuellBilateralFilter&) = delete;
  void operator=(const vtkQuellBilateralFilter&) = delete;
};

#endif
