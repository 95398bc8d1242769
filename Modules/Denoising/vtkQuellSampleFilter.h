// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellSampleFilter
 * @brief   cross-bilateral filter of individual samples, averaged to pixels afterwards
 *
 * Formula and rules in quellSampleFilter.h. Inputs, all repeatable, one connection per sample and in the same order:
 * radiance (port 0); optional depth, normal, albedo, id, each with as many connections as radiance or none. Output:
 * radiance. A sample is a frame of a source with SamplesPerPixel = 1 and its own FirstSample;
 * SamplesPerTick = N keeps the samples of successive frames apart.
 *
 * With one connection this is the pixel-based filter; with several, pixels that hold more than one surface (edges,
 * depth of field, motion blur) keep their parts, and textures may be divided out sample by sample (Demodulate). Costs N
 * or N^2 times the pixel-based filter's time and N times the arrays.
 */
#ifndef vtkQuellSampleFilter_h
#define vtkQuellSampleFilter_h

#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

#include <vector>

namespace quell
{
struct SampleFilterParameters;
}

class VTKQUELLDENOISING_EXPORT vtkQuellSampleFilter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellSampleFilter);

  ///@{ Half the window's side in pixels, default 5, range [0, 32]. 0: the mean of the samples (with Pairs Same).
  vtkSetClampMacro(Radius, int, 0, 32);
  vtkGetMacro(Radius, int);
  ///@}
  ///@{ Standard deviation in pixels, default 2, range [0, 1e30].
  vtkSetClampMacro(SigmaSpatial, double, 0., 1e30);
  vtkGetMacro(SigmaSpatial, double);
  ///@}
  ///@{ Of the length of the difference of unit normals, default 0.2, range [0, 1e30].
  vtkSetClampMacro(SigmaNormal, double, 0., 1e30);
  vtkGetMacro(SigmaNormal, double);
  ///@}
  ///@{ Of the relative depth difference, default 0.05, range [0, 1e30].
  vtkSetClampMacro(SigmaDepth, double, 0., 1e30);
  vtkGetMacro(SigmaDepth, double);
  ///@}
  ///@{ Of the albedo difference, default 0.1, range [0, 1e30].
  vtkSetClampMacro(SigmaAlbedo, double, 0., 1e30);
  vtkGetMacro(SigmaAlbedo, double);
  ///@}
  ///@{ Which samples meet: Same (0) or All (1, default); a quell::SamplePairs.
  vtkSetClampMacro(Pairs, int, 0, 1);
  vtkGetMacro(Pairs, int);
  ///@}
  ///@{ Divide every sample by its own albedo before and multiply by it after, default true. Needs albedo.
  vtkSetMacro(Demodulate, bool);
  vtkGetMacro(Demodulate, bool);
  ///@}
  ///@{ Albedos below count as this, default 1e-3, range [1e-6, 1].
  vtkSetClampMacro(Floor, double, 1e-6, 1.);
  vtkGetMacro(Floor, double);
  ///@}

  bool CanWeigh() const override { return true; }
  int HaloFor(int port) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  void CheckConnections(quell::ConnectionCheck& check) const override;
  double CostPerPixel() const override { return 8. * (2 * this->Radius + 1) * (2 * this->Radius + 1) / 121; }

protected:
  vtkQuellSampleFilter();
  ~vtkQuellSampleFilter() override = default;
  void Execute(quell::StageFrame& frame) override;
  void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights) override;

private:
  void Gather(
    quell::StageFrame& frame, std::vector<quell::ImageIn> (&views)[5], quell::SampleFilterParameters& p) const;

  int Radius = 5, Pairs = 1;
  double SigmaSpatial = 2, SigmaNormal = 0.2, SigmaDepth = 0.05, SigmaAlbedo = 0.1, Floor = 1e-3;
  bool Demodulate = true;
  quell::PixelCount NonFinite;

  vtkQuellSampleFilter(const vtkQuellSampleFilter&) = delete;
  void operator=(const vtkQuellSampleFilter&) = delete;
};

#endif
