// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellAlbedoDemodulate
 * @brief   divides a layer by its albedo
 *
 * illumination = radiance / clamp(albedo, Floor, 1), see quellDemodulate.h. Inputs: radiance (port 0), albedo. Outputs:
 * illumination. AlbedoModulate with the same Floor takes it back to 1 ulp, also where the albedo is 0. Border: none
 * (halo 1 for the fill of non-finite pixels, whose illumination becomes the mean of their finite neighbours').
 */
#ifndef vtkQuellAlbedoDemodulate_h
#define vtkQuellAlbedoDemodulate_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellAlbedoDemodulate : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellAlbedoDemodulate);

  ///@{ Smallest divisor, default 1e-3, range [1e-6, 1]. Must be the same in the AlbedoModulate that follows.
  vtkSetClampMacro(Floor, double, 1e-6, 1.);
  vtkGetMacro(Floor, double);
  ///@}

  int HaloFor(int port) const override;
  double CostPerPixel() const override { return 0.05; }
  bool FillsOutputs() const override { return true; }

protected:
  vtkQuellAlbedoDemodulate();
  ~vtkQuellAlbedoDemodulate() override = default;
  void Execute(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  double Floor = 1e-3;
  quell::PixelCount NonFinite;

  vtkQuellAlbedoDemodulate(const vtkQuellAlbedoDemodulate&) = delete;
  void operator=(const vtkQuellAlbedoDemodulate&) = delete;
};

#endif
