// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellEmissionSplit
 * @brief   takes lamps seen directly out of a frame that has no emission pass
 *
 * Emission is never filtered, but a file may hold the beauty alone. Pixels brighter than Threshold that touch others as
 * bright are lamps, and what is bright next to them is their edge; formulas in quellEmissionSplit.h. Input: radiance
 * (port 0). Outputs: radiance (the rest, 0 in lamps), emission (0 elsewhere) and mask (1 in lamps), whose sum is the
 * input to the last bit. Connect mask to the filters that follow as a guide with distance="Id", so that the holes that
 * lamps leave do not darken what is around them, and add emission at the end.
 */
#ifndef vtkQuellEmissionSplit_h
#define vtkQuellEmissionSplit_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellEmissionSplit : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellEmissionSplit);

  ///@{ Luminance that only light sources have, default 4, range [0, 1e30]; 1e30: there are none.
  vtkSetClampMacro(Threshold, double, 0., 1e30);
  vtkGetMacro(Threshold, double);
  ///@}
  ///@{ Neighbours of 8 that must be as bright, default 3, range [0, 8]; 0: fireflies are lamps too.
  vtkSetClampMacro(Neighbours, int, 0, 8);
  vtkGetMacro(Neighbours, int);
  ///@}
  ///@{ Pixels around a lamp that may show a part of it, default 2 (a pixel filter of radius 1.5), range [0, 8].
  vtkSetClampMacro(Grow, int, 0, 8);
  vtkGetMacro(Grow, int);
  ///@}
  ///@{ Luminance of such a pixel at least, in parts of the lamp's, default 0.05, range [0, 1].
  vtkSetClampMacro(EdgePart, double, 0., 1.);
  vtkGetMacro(EdgePart, double);
  ///@}

  int HaloFor(int port) const override;
  double CostPerPixel() const override { return 0.1; }
  bool FillsOutputs() const override { return true; }

protected:
  vtkQuellEmissionSplit();
  ~vtkQuellEmissionSplit() override = default;
  void Execute(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  double Threshold = 4, EdgePart = 0.05;
  int Neighbours = 3, Grow = 2;
  quell::PixelCount NonFinite;

  vtkQuellEmissionSplit(const vtkQuellEmissionSplit&) = delete;
  void operator=(const vtkQuellEmissionSplit&) = delete;
};

#endif
