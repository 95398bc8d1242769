// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellSum
 * @brief   adds layers
 *
 * radiance = the sum over the connections of input radiance, in float and in the order of the connections, so the
 * rounding is always the same; signed layers (a residual) are added as they are. See quellSum.h for overflow and
 * non-finite pixels.
 */
#ifndef vtkQuellSum_h
#define vtkQuellSum_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellSum : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellSum);

  int HaloFor(int port) const override;
  double CostPerPixel() const override { return 0.05; }
  bool FillsOutputs() const override { return true; }

protected:
  vtkQuellSum();
  ~vtkQuellSum() override = default;
  void Execute(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  quell::PixelCount NonFinite;

  vtkQuellSum(const vtkQuellSum&) = delete;
  void operator=(const vtkQuellSum&) = delete;
};

#endif
