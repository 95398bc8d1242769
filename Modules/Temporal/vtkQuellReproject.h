// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellReproject
 * @brief   brings the previous frame's history to where its points are seen now
 *
 * For each pixel x, colour, moments and history length of the previous frame are fetched at q = x + motion with a
 * bilinear filter whose four taps are tested one by one (inside the frame, surface or background alike, id, depth,
 * normal, finite); see quellReproject.h for the tests, the expected depth of moving points and the rule for moments.
 *
 * Motion is the `motion` input's; without it, it follows from the camera matrices of the two frames (field data of
 * `depth` and of `previousDepth`) and the depth or, more precisely, `position`. That knows the camera only: what moves
 * by itself then has no valid history. Without motion and without matrices the camera is taken to stand still.
 *
 * Outputs: radiance (linear), moments (mean, central second moment), history (frames; 0: disoccluded), mask (below),
 * meanRest (what the moments' mean has beyond a float; 0 unless the input of that name is connected).
 * Inputs history, moments, length, previousDepth, previousNormal, previousId and meanRest are delayed (SetHistory);
 * they cover the whole frame. On the first frame, or after a change of size, everything is 0 and mask is 3.
 *
 * mask: 0 every tap valid; 1 some taps rejected; 2 from the 3 x 3 neighbourhood; and without history: 3 no previous
 * frame; 4 outside of it; 5 not projectable; 6 surface against background; 7 other id; 8 other depth; 9 other normal;
 * 10 history not finite or empty; 11 background.
 *
 * Background, where nothing was hit, has no history unless BackgroundHistory is on: its light is 0 or that of a surface
 * which covers a part of the pixel, and of a surface that moves on a history would keep 1/n as specks.
 *
 * Border: taps outside of the frame are rejected. Non-finite: such history is rejected; non-finite depth is background.
 */
#ifndef vtkQuellReproject_h
#define vtkQuellReproject_h

#include "quellReproject.h"
#include "vtkQuellStage.h"
#include "vtkQuellTemporalModule.h"

class VTKQUELLTEMPORAL_EXPORT vtkQuellReproject : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellReproject);

  enum InterpolationType
  {
    Bilinear = 0,
    CatmullRom = 1
  };

  ///@{ Depth may differ by this many times (slope per pixel + DepthEpsilon depth); default 4.
  vtkSetClampMacro(DepthTolerance, double, 0., 1e6);
  vtkGetMacro(DepthTolerance, double);
  ///@}
  ///@{ Part of the depth that is tolerated on a surface seen face on; default 0.001.
  vtkSetClampMacro(DepthEpsilon, double, 0., 1.);
  vtkGetMacro(DepthEpsilon, double);
  ///@}
  ///@{ Further part of the depth tolerated where the point itself moved, because motion has no depth; default 0.1.
  vtkSetClampMacro(MovingDepthTolerance, double, 0., 1e6);
  vtkGetMacro(MovingDepthTolerance, double);
  ///@}
  ///@{ A point moved where motion and camera differ by more pixels than this; default 0.1.
  vtkSetClampMacro(MotionTolerance, double, 0., 1e6);
  vtkGetMacro(MotionTolerance, double);
  ///@}
  ///@{ Cosine of the largest angle between normals; default 0.9 (26 degrees); -1 accepts nearly all.
  vtkSetClampMacro(NormalThreshold, double, -1., 1.);
  vtkGetMacro(NormalThreshold, double);
  ///@}
  ///@{ Bilinear weight that valid taps must have together; default 0.01.
  vtkSetClampMacro(MinimumWeight, double, 0., 1.);
  vtkGetMacro(MinimumWeight, double);
  ///@}
  ///@{ How colour is fetched where all taps are valid; CatmullRom keeps detail, Bilinear smooths noise. Default
  /// Bilinear.
  vtkSetClampMacro(Interpolation, int, Bilinear, CatmullRom);
  vtkGetMacro(Interpolation, int);
  ///@}

  ///@{ Whether pixels where nothing was hit have a history; default off. On, partly covered pixels of a still camera
  /// converge, and moving surfaces leave specks behind.
  vtkSetMacro(BackgroundHistory, bool);
  vtkGetMacro(BackgroundHistory, bool);
  ///@}

  bool NeedsInput(int port, const quell::ArraySet& asked) const override;
  std::vector<std::string> Explain() override;
  bool FillsOutputs() const override { return true; }
  bool CanWeigh() const override { return true; }

protected:
  vtkQuellReproject();
  ~vtkQuellReproject() override = default;

  void Execute(quell::StageFrame& frame) override;
  /// Pixels of the previous frame. With CatmullRom those of an unsharp colour only: the sharp one is clamped.
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  quell::ReprojectInputs Gather(quell::StageFrame& frame, std::vector<std::string>& warnings);
  quell::ReprojectParameters Parameters() const;

  double DepthTolerance = 4;
  double DepthEpsilon = 1e-3;
  double MovingDepthTolerance = 0.1;
  double MotionTolerance = 0.1;
  double NormalThreshold = 0.9;
  double MinimumWeight = 0.01;
  int Interpolation = Bilinear;
  bool BackgroundHistory = false;

  vtkQuellReproject(const vtkQuellReproject&) = delete;
  void operator=(const vtkQuellReproject&) = delete;
};

#endif
