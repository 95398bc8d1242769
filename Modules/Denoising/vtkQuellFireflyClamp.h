// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellFireflyClamp
 * @brief   shortens colours longer than a threshold and keeps the rest as a ledger
 *
 * |E| > Threshold -> E Threshold / |E|, with |E| the Euclidean length of RGB, see quellFireflyClamp.h. Input: radiance
 * (port 0). Outputs: radiance, residual; radiance + residual is the input, exactly, channel by channel. Biased: it
 * removes energy, and says how much (GetReport).
 */
#ifndef vtkQuellFireflyClamp_h
#define vtkQuellFireflyClamp_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellFireflyClamp : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellFireflyClamp);

  ///@{ Longest colour that stays, default 5, range [0, 1e30], in the input's unit. 0: black; 1e30: off.
  vtkSetClampMacro(Threshold, double, 0., 1e30);
  vtkGetMacro(Threshold, double);
  ///@}

  ///@{ Of the last execution: pixels shortened, and luminance summed over the region before and taken away.
  long long GetClampedPixels() const { return this->ClampedPixels; }
  double GetEnergyIn() const { return this->EnergyIn; }
  double GetEnergyRemoved() const { return this->EnergyRemoved; }
  ///@}
  std::string GetReport() const override;

  int HaloFor(int port) const override;

protected:
  vtkQuellFireflyClamp();
  ~vtkQuellFireflyClamp() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  double Threshold = 5;
  long long ClampedPixels = 0, Pixels = 0;
  double EnergyIn = 0, EnergyRemoved = 0;

  vtkQuellFireflyClamp(const vtkQuellFireflyClamp&) = delete;
  void operator=(const vtkQuellFireflyClamp&) = delete;
};

#endif
