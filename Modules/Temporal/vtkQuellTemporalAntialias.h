// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellTemporalAntialias
 * @brief   temporal anti-aliasing: blends each frame with its own previous output, clipped to the neighbourhood
 *
 * out = h + Alpha (c - h), all in c / (1 + max c): h is the previous output at x + motion (motion of the 3 x 3 pixel
 * nearest to the camera), by a Catmull-Rom filter, clipped towards the mean of the new frame's 3 x 3 within Gamma
 * standard deviations in YCoCg. Linear radiance in and out; see quellTemporalAntialias.h.
 *
 * `history` is a delayed input: this stage's own radiance of the previous frame. On the first frame, after a change of
 * size and where x + motion is off screen the input is returned bit for bit.
 * Border: neighbours outside of the frame are left out. Non-finite: such pixels are replaced by history, else by the
 * mean of their finite neighbours, else by 0, and counted.
 */
#ifndef vtkQuellTemporalAntialias_h
#define vtkQuellTemporalAntialias_h

#include "vtkQuellStage.h"
#include "vtkQuellTemporalModule.h"

class VTKQUELLTEMPORAL_EXPORT vtkQuellTemporalAntialias : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTemporalAntialias);

  ///@{ Weight of the new frame; default 0.1, 1 returns the input.
  vtkSetClampMacro(Alpha, double, 0., 1.);
  vtkGetMacro(Alpha, double);
  ///@}
  ///@{ Half width, in standard deviations, of the range that history may keep; default 1, larger ghosts more and
  /// flickers less.
  vtkSetClampMacro(Gamma, double, 0., 1e6);
  vtkGetMacro(Gamma, double);
  ///@}

  bool NeedsInput(int port, const quell::ArraySet& asked) const override;
  /// 1 - Alpha for the history, in the stage's own c / (1 + max c).
  double HistoryWeight(int port) const override;
  bool FillsOutputs() const override { return true; }
  std::vector<std::string> Explain() override;

protected:
  vtkQuellTemporalAntialias();
  ~vtkQuellTemporalAntialias() override = default;

  void Execute(quell::StageFrame& frame) override;

private:
  double Alpha = 0.1;
  double Gamma = 1;

  vtkQuellTemporalAntialias(const vtkQuellTemporalAntialias&) = delete;
  void operator=(const vtkQuellTemporalAntialias&) = delete;
};

#endif
