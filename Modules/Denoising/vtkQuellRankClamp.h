// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellRankClamp
 * @brief   shortens colours that stand out from their neighbours and keeps the rest as a ledger
 *
 * A pixel larger than Factor times the Rank-th largest of its neighbours is scaled to that size, see quellRankClamp.h.
 * Inputs: radiance (port 0), best demodulated; optional id, so that only neighbours on the same object judge. Outputs:
 * radiance, residual; radiance + residual is the input, exactly, channel by channel. Needs no threshold in radiance,
 * unlike vtkQuellFireflyClamp, but knows single bright pixels from noise only where neighbours have light. Biased.
 */
#ifndef vtkQuellRankClamp_h
#define vtkQuellRankClamp_h

#include "quellEnergyLedger.h"
#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellRankClamp : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellRankClamp);

  ///@{ Half the window's side in pixels, default 1, range [0, 8]. 0: identity.
  vtkSetClampMacro(Radius, int, 0, 8);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Which neighbour is the limit, counted from the largest, default 2, range [1, 288]: a spot of Rank pixels stays.
  vtkSetClampMacro(Rank, int, 1, 288);
  vtkGetMacro(Rank, int);
  ///@}
  ///@{ Times that neighbour's size, default 1, range [0, 1e30]; 1e30: off.
  vtkSetClampMacro(Factor, double, 0., 1e30);
  vtkGetMacro(Factor, double);
  ///@}
  ///@{ How large a colour is: Length (0), Luminance (1, default), Maximum (2); a quell::ClampMeasure.
  vtkSetClampMacro(Measure, int, 0, 2);
  vtkGetMacro(Measure, int);
  ///@}

  ///@{ Of the last execution: pixels shortened, and luminance summed over the region before and taken away.
  long long GetClampedPixels() const { return this->Ledger.Total().Clamped; }
  double GetEnergyIn() const { return this->Ledger.Total().EnergyIn; }
  double GetEnergyRemoved() const { return this->Ledger.Total().EnergyRemoved; }
  ///@}
  std::string GetReport() const override;

  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  double CostPerPixel() const override { return 0.02 * (2 * this->Radius + 1) * (2 * this->Radius + 1); }

protected:
  vtkQuellRankClamp();
  ~vtkQuellRankClamp() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  int Radius = 1, Rank = 2, Measure = 1;
  double Factor = 1;
  quell::EnergyLedger Ledger;

  vtkQuellRankClamp(const vtkQuellRankClamp&) = delete;
  void operator=(const vtkQuellRankClamp&) = delete;
};

#endif
