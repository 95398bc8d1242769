// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellTemporalAccumulate
 * @brief   mixes the new frame into its reprojected history
 *
 * h = min(h' + 1, MaximumHistory); colour += max(Alpha, 1 / h) (new - colour); the moments of luminance alike with
 * MomentsAlpha, as (mean, central second moment). Where history is 0 the new frame is taken as it is. See
 * quellAccumulate.h.
 *
 * Inputs radiance (linear) and the outputs of Reproject. Outputs radiance, moments, history (frames), meanRest.
 *
 * With the input meanRest connected the mean of the moments is carried as two floats, moments[0] + meanRest: the
 * variance is then right within 1e-3 for means of up to 1e6 deviations instead of 1e4. Take it around the loop as the
 * moments are: this stage's meanRest, delayed, to Reproject, and from there to here (and on to VarianceEstimate).
 * Border: nothing but the pixel is read, except to fill. Non-finite: such a pixel of the new frame keeps its history,
 * or gets the mean of its finite neighbours and history 0; it is counted.
 */
#ifndef vtkQuellTemporalAccumulate_h
#define vtkQuellTemporalAccumulate_h

#include "vtkQuellStage.h"
#include "vtkQuellTemporalModule.h"

class VTKQUELLTEMPORAL_EXPORT vtkQuellTemporalAccumulate : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTemporalAccumulate);

  ///@{ Smallest weight of a new frame. Independent noise keeps Alpha / (2 - Alpha) of its variance; a change of light
  /// is down to 1 % after ln(0.01) / ln(1 - Alpha) frames. Default 0.05: 39 frames' worth of samples, 90 frames.
  vtkSetClampMacro(Alpha, double, 0., 1.);
  vtkGetMacro(Alpha, double);
  ///@}
  ///@{ Smallest weight of a new frame in the moments, which should follow faster than colour. Default 0.2.
  vtkSetClampMacro(MomentsAlpha, double, 0., 1.);
  vtkGetMacro(MomentsAlpha, double);
  ///@}
  ///@{ History does not count further than this. Default 32 frames; 1 means no history.
  vtkSetClampMacro(MaximumHistory, int, 1, 1 << 20);
  vtkGetMacro(MaximumHistory, int);
  ///@}

  /// 1 - the smallest weight of a new frame, max(Alpha, 1 / MaximumHistory) for colour and alike for moments. The
  /// start, where the new frame weighs 1 / h, forgets no slower: after k frames the two averages differ in a weight of
  /// (1 - a)^k.
  double HistoryWeight(int port) const override;
  bool FillsOutputs() const override { return true; }
  bool CanWeigh() const override { return true; }

protected:
  vtkQuellTemporalAccumulate();
  ~vtkQuellTemporalAccumulate() override = default;

  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  double Alpha = 0.05;
  double MomentsAlpha = 0.2;
  int MaximumHistory = 32;

  vtkQuellTemporalAccumulate(const vtkQuellTemporalAccumulate&) = delete;
  void operator=(const vtkQuellTemporalAccumulate&) = delete;
};

#endif
