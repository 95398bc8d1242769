// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellFireflyClamp
 * @brief   shortens colours larger than a threshold and keeps the rest as a ledger
 *
 * m(E) > t -> E t / m(E), with m the Euclidean length of RGB, the luminance or the largest channel, see
 * quellFireflyClamp.h. Inputs: radiance (port 0); optional count (frames accumulated so far), which raises the
 * threshold, and albedo, with which Largest limits what the colour stands for. Outputs: radiance, residual; radiance +
 * residual is the input, exactly, channel by channel. Biased: it removes energy, and says how much (GetReport).
 */
#ifndef vtkQuellFireflyClamp_h
#define vtkQuellFireflyClamp_h

#include "quellEnergyLedger.h"
#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellFireflyClamp : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellFireflyClamp);

  ///@{ Largest colour that stays, default 5, range [0, 1e30], in the input's unit. 0: black; 1e30: off.
  vtkSetClampMacro(Threshold, double, 0., 1e30);
  vtkGetMacro(Threshold, double);
  ///@}
  ///@{ How large a colour is: Length (0, default), Luminance (1), Maximum (2); a quell::ClampMeasure.
  vtkSetClampMacro(Measure, int, 0, 2);
  vtkGetMacro(Measure, int);
  ///@}
  ///@{ Exponent of `count` in the threshold, default 0.5, range [0, 1]. Only with that input.
  vtkSetClampMacro(Growth, double, 0., 1.);
  vtkGetMacro(Growth, double);
  ///@}

  ///@{ Largest channel of colour times albedo that stays, default 1e30 (off), range [1, 1e30]: a guard against broken
  /// pixels, in the unit of the light before it was divided.
  vtkSetClampMacro(Largest, double, 1., 1e30);
  vtkGetMacro(Largest, double);
  ///@}
  ///@{ Smallest albedo, default 0.001, range [1e-6, 1]: that of the AlbedoDemodulate before.
  vtkSetClampMacro(Floor, double, 1e-6, 1.);
  vtkGetMacro(Floor, double);
  ///@}

  ///@{ Of the last execution: pixels shortened, and luminance summed over the region before and taken away.
  long long GetClampedPixels() const { return this->Ledger.Total().Clamped; }
  double GetEnergyIn() const { return this->Ledger.Total().EnergyIn; }
  double GetEnergyRemoved() const { return this->Ledger.Total().EnergyRemoved; }
  ///@}
  std::string GetReport() const override;

  int HaloFor(int port) const override;
  bool NeedsInput(int port, const quell::ArraySet& asked) const override;
  double CostPerPixel() const override { return 0.05; }

protected:
  vtkQuellFireflyClamp();
  ~vtkQuellFireflyClamp() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  double Threshold = 5, Growth = 0.5, Largest = 1e30, Floor = 0.001;
  int Measure = 0;
  quell::EnergyLedger Ledger;

  vtkQuellFireflyClamp(const vtkQuellFireflyClamp&) = delete;
  void operator=(const vtkQuellFireflyClamp&) = delete;
};

#endif
