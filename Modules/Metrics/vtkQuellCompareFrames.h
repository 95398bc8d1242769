// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class vtkQuellCompareFrames
 * Sink that says how a frame changed since the one before, and should not have: `flicker` and `warp` of
 * quellTemporalMetrics.h for this pair of frames.
 *
 * Inputs: the image and (delayed) the image of the frame before; optional: motion (for warp), id, a reference and
 * (delayed) the reference of the frame before. Output `error`: the difference between the frame and the one before at
 * p + motion (nearest pixel; without motion at p), mean over channels of its absolute value, that of the reference
 * subtracted where there is one; 0 where nothing was there. Units: of the image. A first frame, or pixels that are not
 * finite, are reported as `not compared` and why.
 */
#ifndef vtkQuellCompareFrames_h
#define vtkQuellCompareFrames_h

#include "vtkQuellMetricsModule.h"
#include "vtkQuellStage.h"

class VTKQUELLMETRICS_EXPORT vtkQuellCompareFrames : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellCompareFrames);

  ///@{ What the report calls the image; default "image".
  void SetLabel(const std::string& label);
  const std::string& GetLabel() const { return this->Label; }
  ///@}

  std::string GetReport() const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;

protected:
  vtkQuellCompareFrames();
  ~vtkQuellCompareFrames() override = default;

  void Execute(quell::StageFrame& frame) override;

private:
  std::string Compare(quell::StageFrame& frame) const;

  std::string Label = "image";
  std::string Report;

  vtkQuellCompareFrames(const vtkQuellCompareFrames&) = delete;
  void operator=(const vtkQuellCompareFrames&) = delete;
};

#endif
