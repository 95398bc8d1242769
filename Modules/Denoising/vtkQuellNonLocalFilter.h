// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellNonLocalFilter
 * @brief   what NonLocalMeans and RegressionFilter share: inputs, half buffers, variance
 *
 * Inputs: radiance (port 0), halfA and halfB, variance, depth, guide and guideVariance (repeatable; a guide's
 * attributes `name` and `least` (tau), a guideVariance's attribute `guide`), see quellNonLocal.h. With both halves the
 * weights that filter one come from the other, so that a weight cannot favour the noise it is to remove (Rousselle et
 * al. 2012):
 *
 *   radiance = (A' + B') / 2,   variance = lum((A' - B') / 2)^2, the noise that is left
 *
 * else the weights come from radiance itself and variance is 0. The variance of the weights' buffer is 2 variance with
 * halves (variance is that of the whole pixel's mean), else variance; where variance is not connected it is estimated:
 * with halves the mean of (A - B)^2 / 2 over 3 x 3 pixels per channel, else as in quellFeatureNoise.h.
 */
#ifndef vtkQuellNonLocalFilter_h
#define vtkQuellNonLocalFilter_h

#include "quellNonLocal.h"
#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

#include <map>
#include <utility>

class VTKQUELLDENOISING_EXPORT vtkQuellNonLocalFilter : public vtkQuellStage
{
public:
  vtkTypeMacro(vtkQuellNonLocalFilter, vtkQuellStage);

  ///@{ Half the side of the window in pixels, range [0, 16]. 0: identity.
  vtkSetClampMacro(Radius, int, 0, 16);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Half the side of the patches in pixels, default 3, range [0, 8].
  vtkSetClampMacro(PatchRadius, int, 0, 8);
  vtkGetMacro(PatchRadius, int);
  ///@}
  ///@{ How many deviations of noise patches may differ, range [1e-3, 1e15]; 1e15: colours do not matter.
  vtkSetClampMacro(KColor, double, 1e-3, 1e15);
  vtkGetMacro(KColor, double);
  ///@}
  ///@{ The same for guides, default 0.6, range [1e-3, 1e15].
  vtkSetClampMacro(KGuide, double, 1e-3, 1e15);
  vtkGetMacro(KGuide, double);
  ///@}
  ///@{ Squared difference of colours that does not matter, default 1e-7, range [1e-30, 1e30].
  vtkSetClampMacro(Epsilon, double, 1e-30, 1e30);
  vtkGetMacro(Epsilon, double);
  ///@}

  bool CanWeigh() const override { return true; }
  int HaloFor(int port) const override;
  /// With both halves radiance is read only where it tells between two widths.
  bool NeedsInput(int port, const quell::ArraySet& asked) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  void CheckConnections(quell::ConnectionCheck& check) const override;
  bool SetInputAttribute(
    int port, int connection, const std::string& name, const std::string& value, std::string& error) override;
  double CostPerPixel() const override
  {
    const double side = 2 * this->Radius + 1;
    return (this->Regresses() ? 60 : 15) * side * side / 441;
  }

protected:
  vtkQuellNonLocalFilter() = default;
  ~vtkQuellNonLocalFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;
  virtual bool Regresses() const { return false; }
  /// Two bandwidths, chosen between by their errors as the halves tell them.
  virtual bool Selects() const { return false; }
  /// The rows that both tables have.
  static void DescribeInputs(quell::StageDescription& d);

  int Radius = 10, PatchRadius = 3;
  double KColor = 0.45, KColorNarrow = 0, KGuide = 0.6, Epsilon = 1e-7, Ridge = 1e-4;

private:
  struct GuideSettings
  {
    std::string Name;
    double Least = 1e-3;
  };
  GuideSettings SettingsOf(int port, int connection) const;
  quell::NonLocalInputs Guides(quell::StageFrame& frame);
  quell::NonLocalParameters Parameters() const;

  std::map<std::pair<int, int>, GuideSettings> Settings; ///< by port and connection
  quell::PixelCount NonFinite;

  vtkQuellNonLocalFilter(const vtkQuellNonLocalFilter&) = delete;
  void operator=(const vtkQuellNonLocalFilter&) = delete;
};

#endif
