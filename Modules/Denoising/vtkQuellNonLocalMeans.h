// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellNonLocalMeans
 * @brief   joint non-local means with half buffers
 *
 * A mean over (2 Radius + 1)^2 pixels, weighted by how much alike the patches around them are once what noise explains
 * is taken off, and by guides in the same way; formulas in quellNonLocal.h, half buffers and variance in
 * vtkQuellNonLocalFilter.h. Inputs: radiance (port 0); optional halfA, halfB, variance, depth, guide, guideVariance.
 * Outputs: radiance, variance. Border: what is outside is no tap, and left out of patches. Energy: not kept; biased
 * towards the mode where noise is heavy-tailed and the halves are missing. Cost: about 50 operations per tap, twice
 * with halves; a strong filter for stills. Source: Rousselle, Knaus and Zwicker 2012; Rousselle, Manzi and Zwicker 2013
 * (without their choice between three candidates by SURE).
 */
#ifndef vtkQuellNonLocalMeans_h
#define vtkQuellNonLocalMeans_h

#include "vtkQuellNonLocalFilter.h"

class VTKQUELLDENOISING_EXPORT vtkQuellNonLocalMeans : public vtkQuellNonLocalFilter
{
public:
  vtkTypeMacro(vtkQuellNonLocalMeans, vtkQuellNonLocalFilter);
  static vtkQuellNonLocalMeans* New();
  const quell::StageDescription& GetDescription() const override;
  static void Describe(quell::StageDescription& d);

protected:
  vtkQuellNonLocalMeans();
  ~vtkQuellNonLocalMeans() override = default;

private:
  vtkQuellNonLocalMeans(const vtkQuellNonLocalMeans&) = delete;
  void operator=(const vtkQuellNonLocalMeans&) = delete;
};

#endif
