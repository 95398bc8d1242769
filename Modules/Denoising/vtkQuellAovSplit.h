// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellAovSplit
 * @brief   makes Quell's layers from another renderer's passes
 *
 * Formulas in quellAovSplit.h. Inputs: combined (port 0); optional diffuseDirect, diffuseIndirect, diffuseColor,
 * glossyDirect, glossyIndirect, glossyColor, transmissionDirect, transmissionIndirect, transmissionColor, volumeDirect,
 * volumeIndirect, emission, environment, albedo. Outputs: radiance, emission, direct, indirect, their diffuse and
 * specular parts, the albedos and residual = radiance - (emission + direct + indirect). A sum that is off by more than
 * Tolerance is a warning. Given only combined, direct = combined and the residual is 0.
 */
#ifndef vtkQuellAovSplit_h
#define vtkQuellAovSplit_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellAovSplit : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellAovSplit);

  ///@{ What light passes hold: Demodulated (0, default; Blender: light already divided by colour) or Radiance (1).
  vtkSetClampMacro(Convention, int, 0, 1);
  vtkGetMacro(Convention, int);
  ///@}
  ///@{ Largest |residual| relative to radiance + 1e-3 that is not warned of, default 0.01, range [0, 1e6].
  vtkSetClampMacro(Tolerance, double, 0., 1e6);
  vtkGetMacro(Tolerance, double);
  ///@}

  ///@{ Of the last execution: pixels beyond Tolerance and the largest relative difference.
  long long GetPixelsOver() const { return this->PixelsOver; }
  double GetWorst() const { return this->Worst; }
  ///@}
  std::string GetReport() const override;

  int HaloFor(int port) const override;
  void CheckConnections(quell::ConnectionCheck& check) const override;
  double CostPerPixel() const override { return 0.05; }

protected:
  vtkQuellAovSplit();
  ~vtkQuellAovSplit() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  int Convention = 0;
  double Tolerance = 0.01;
  long long PixelsOver = 0;
  double Worst = 0;
  bool HasPasses = false;
  quell::PixelCount NonFinite;

  vtkQuellAovSplit(const vtkQuellAovSplit&) = delete;
  void operator=(const vtkQuellAovSplit&) = delete;
};

#endif
