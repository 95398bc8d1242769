// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellCompareImages
 * @brief   measures an image against a reference and reports it in one line
 *
 * GetReport() gives e.g. "beauty: relMSE 0.00123, 47.1 times lower than the noisy input's 0.0579 (reference
 * cornell.exr)" after an update; metrics are those of quellMetrics.h. Output: `error`, the relMSE of each pixel.
 *
 * Where the reference does not show what is rendered (another size, scene or camera, as far as both frames say), where
 * a pixel is not finite or a metric cannot be computed, the report says "not compared: ..." with the reason, a warning
 * is kept and `error` is 0; the update succeeds.
 *
 * Scene and camera are known by the frame facts in field data: the scene's hash, and the x, y and w rows of worldToNdc
 * together with the origin, within 1e-4 of the largest entry (files may keep them as float32).
 */
#ifndef vtkQuellCompareImages_h
#define vtkQuellCompareImages_h

#include "vtkQuellMetricsModule.h"
#include "vtkQuellStage.h"

class VTKQUELLMETRICS_EXPORT vtkQuellCompareImages : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellCompareImages);

  ///@{ Metric names, separated by blanks; default "relMSE".
  void SetMetrics(const std::string& names);
  const std::string& GetMetrics() const { return this->Metrics; }
  ///@}
  ///@{ Compares at this tick only; default -1: at every tick (the report is the last one's).
  vtkSetClampMacro(Tick, int, -1, 1 << 30);
  vtkGetMacro(Tick, int);
  ///@}
  ///@{ What the report calls the image; default "image".
  void SetLabel(const std::string& label);
  const std::string& GetLabel() const { return this->Label; }
  ///@}

  std::string GetReport() const override;
  bool AllowsOtherExtent(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;

protected:
  vtkQuellCompareImages();
  ~vtkQuellCompareImages() override = default;

  /// Not a source: refuses unknown metric names while information is gathered, before any pixel is made.
  void DescribeSource(int& width, int& height) override;
  void Execute(quell::StageFrame& frame) override;

private:
  std::string ReferenceName();
  std::string Compare(quell::StageFrame& frame);

  std::string Metrics = "relMSE";
  int Tick = -1;
  std::string Label = "image";
  std::string Report;

  vtkQuellCompareImages(const vtkQuellCompareImages&) = delete;
  void operator=(const vtkQuellCompareImages&) = delete;
};

#endif
