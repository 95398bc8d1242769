// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellAlbedoModulate
 * @brief   multiplies illumination by its albedo
 *
 * radiance = illumination * clamp(albedo, Floor, 1), the inverse of AlbedoDemodulate, see quellDemodulate.h. Inputs:
 * illumination (port 0), albedo. Outputs: radiance. Border and non-finite pixels as there.
 */
#ifndef vtkQuellAlbedoModulate_h
#define vtkQuellAlbedoModulate_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellAlbedoModulate : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellAlbedoModulate);

  ///@{ Smallest factor, default 1e-3, range [1e-6, 1]. Must be that of the AlbedoDemodulate before.
  vtkSetClampMacro(Floor, double, 1e-6, 1.);
  vtkGetMacro(Floor, double);
  ///@}

  int HaloFor(int port) const override;
  double CostPerPixel() const override { return 0.05; }
  bool FillsOutputs() const override { return true; }

protected:
  vtkQuellAlbedoModulate();
  ~vtkQuellAlbedoModulate() override = default;
  void Execute(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  double Floor = 1e-3;
  quell::PixelCount NonFinite;

  vtkQuellAlbedoModulate(const vtkQuellAlbedoModulate&) = delete;
  void operator=(const vtkQuellAlbedoModulate&) = delete;
};

#endif
