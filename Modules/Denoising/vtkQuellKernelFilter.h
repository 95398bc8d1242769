// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellKernelFilter
 * @brief   filter with fixed weights: box, Gaussian, 3 x 3 peak, any matrix
 *
 * Weighted mean over a window with weights that depend on the distance alone; formula, border and non-finite rule in
 * quellKernelFilter.h. Input: radiance (port 0). Outputs: radiance and, with the same weights, every array of that
 * input which Arrays names (under its own name; other arrays pass through). A pixel whose colour is not finite weighs
 * nothing in any of them, so alpha keeps up with its colour. Normals come out with length 1 (or 0), variances are
 * filtered with the squared weights, depths and other arrays stay as they are where they are not finite; ids and
 * materials, which have no mean, and moments are refused. Energy: kept in the interior with Normalize; towards borders
 * a pixel counts for more, as its kernel is normalised by the weights that fall inside.
 * Cost: 2 (2 r + 1) taps for Box, Gaussian and matrices that are products, else as many as the matrix has.
 */
#ifndef vtkQuellKernelFilter_h
#define vtkQuellKernelFilter_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

namespace quell
{
struct FilterKernel;
}

class VTKQUELLDENOISING_EXPORT vtkQuellKernelFilter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellKernelFilter);

  ///@{ Identity (0), Box (1), Peak3x3 (2): [1 3 1; 3 6 3; 1 3 1] / 22, Gaussian (3, default), Matrix (4).
  vtkSetClampMacro(Kernel, int, 0, 4);
  vtkGetMacro(Kernel, int);
  ///@}
  ///@{ Half the side of Box and Gaussian in pixels, range [-1, 64]; -1 (default): 1, or ceil(3 Sigma) for Gaussian.
  vtkSetClampMacro(Radius, int, -1, 64);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Standard deviation of Gaussian in pixels, default 1, range [0, 1e30]. 0: identity, 1e30: box.
  vtkSetClampMacro(Sigma, double, 0., 1e30);
  vtkGetMacro(Sigma, double);
  ///@}
  ///@{ Weights of Matrix: numbers by blanks, rows by semicolons, the top row first; odd numbers of both, at most 129.
  void SetMatrix(const std::string& text);
  const std::string& GetMatrix() const { return this->Matrix; }
  ///@}
  ///@{ Divide by the sum of the weights that fall inside, default on. Off: a plain sum, for derivatives.
  vtkSetMacro(Normalize, bool);
  vtkGetMacro(Normalize, bool);
  ///@}
  ///@{ Names of further arrays of the first input that are filtered likewise, by blanks: "alpha albedo normal".
  void SetArrays(const std::string& names);
  const std::string& GetArrays() const { return this->Arrays; }
  ///@}

  bool CanWeigh() const override { return true; }
  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  double CostPerPixel() const override { return 0.05 + 0.01 * this->HaloFor(0); }
  bool FillsOutputs() const override { return true; }
  bool Makes(const std::string& array) const override;
  void CheckSettings() override;
  void CheckConnections(quell::ConnectionCheck& check) const override;

protected:
  vtkQuellKernelFilter();
  ~vtkQuellKernelFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  /// Throws quell::StageError for a Matrix that is none.
  quell::FilterKernel MakeKernel() const;

  int Kernel = 3, Radius = -1;
  double Sigma = 1;
  std::string Matrix = "1 3 1; 3 6 3; 1 3 1", Arrays;
  bool Normalize = true;
  quell::PixelCount NonFinite;

  vtkQuellKernelFilter(const vtkQuellKernelFilter&) = delete;
  void operator=(const vtkQuellKernelFilter&) = delete;
};

#endif
