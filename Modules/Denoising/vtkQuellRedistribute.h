// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellRedistribute
 * @brief   gives the energy that a clamp took to the neighbourhood or to the whole image
 *
 * Formula and rules in quellRedistribute.h. Inputs: radiance (port 0: what the clamp left), residual (what it took);
 * optional depth, normal, id, across whose edges nothing is given (Neighbourhood only). Output: radiance, whose sum
 * over the frame is that of both inputs. Over = Image reads the whole frame, whatever region is asked for.
 */
#ifndef vtkQuellRedistribute_h
#define vtkQuellRedistribute_h

#include "quellPixelCount.h"
#include "quellEnergyLedger.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellRedistribute : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellRedistribute);

  enum OverWhat
  {
    Neighbourhood,
    Image
  };
  ///@{ Who receives: Neighbourhood (0, default) or Image (1), there in proportion to luminance.
  vtkSetClampMacro(Over, int, 0, 1);
  vtkGetMacro(Over, int);
  ///@}
  ///@{ Half the side of the largest window in pixels, default 8, range [0, 32]. 0: everything goes back.
  vtkSetClampMacro(Radius, int, 0, 32);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Standard deviation of the kernel of a small residual in pixels, default 1.5, range [0, 1e30].
  vtkSetClampMacro(Sigma, double, 0., 1e30);
  vtkGetMacro(Sigma, double);
  ///@}
  ///@{ Length of a residual from which its kernel widens, default 5, range [1e-30, 1e30]: the clamp's threshold.
  vtkSetClampMacro(Threshold, double, 1e-30, 1e30);
  vtkGetMacro(Threshold, double);
  ///@}
  ///@{ Of the length of the difference of unit normals, default 0.3, range [0, 1e30].
  vtkSetClampMacro(SigmaNormal, double, 0., 1e30);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Of the relative depth difference, default 0.1, range [0, 1e30].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e30);
  vtkGetMacro(SigmaDepth, double);
  ///@}

  ///@{ Of the last execution, luminance summed over the region (Image: the frame): what the clamp left, and what this
  /// gave back.
  double GetEnergyLeft() const { return this->EnergyLeft; }
  double GetEnergySpread() const { return this->EnergySpread; }
  ///@}
  std::string GetReport() const override;

  int HaloFor(int port) const override;
  double CostPerPixel() const override { return 0.1; }
  bool NeedsInput(int port, const quell::ArraySet& asked) const override;

protected:
  vtkQuellRedistribute();
  ~vtkQuellRedistribute() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  int Over = Neighbourhood, Radius = 8;
  double Sigma = 1.5, Threshold = 5, SigmaNormal = 0.3, SigmaDepth = 0.1;
  quell::CountedRows Counted;
  double EnergyLeft = 0, EnergySpread = 0;
  quell::PixelCount NonFinite;

  vtkQuellRedistribute(const vtkQuellRedistribute&) = delete;
  void operator=(const vtkQuellRedistribute&) = delete;
};

#endif
