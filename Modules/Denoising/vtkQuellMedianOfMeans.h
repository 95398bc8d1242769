// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellMedianOfMeans
 * @brief   a mean over independent buffers that outliers cannot pull
 *
 * Formula and rules in quellMedianOfMeans.h. Input: radiance (port 0), repeatable: 2 to 64 buffers of equally many
 * independent samples, such as a path tracer's halfA and halfB, or several sources that differ in FirstSample. Outputs:
 * radiance, residual (mean - radiance), mean, gini. Few samples per buffer make it dark: see GetReport.
 */
#ifndef vtkQuellMedianOfMeans_h
#define vtkQuellMedianOfMeans_h

#include "quellEnergyLedger.h"
#include "quellPixelCount.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

class VTKQUELLDENOISING_EXPORT vtkQuellMedianOfMeans : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellMedianOfMeans);

  ///@{ Mean (0), Median (1), Binary (2) or Gini (3, default); a quell::MeansEstimator.
  vtkSetClampMacro(Estimator, int, 0, 3);
  vtkGetMacro(Estimator, int);
  ///@}
  ///@{ Gini coefficient above which Binary takes the median, default 0.25, range [0, 1].
  vtkSetClampMacro(GiniThreshold, double, 0., 1.);
  vtkGetMacro(GiniThreshold, double);
  ///@}

  ///@{ Of the last execution: pixels that are not the mean, and luminance summed over the region: of the mean, and
  /// taken away from it.
  long long GetClampedPixels() const { return this->Ledger.Total().Clamped; }
  double GetEnergyIn() const { return this->Ledger.Total().EnergyIn; }
  double GetEnergyRemoved() const { return this->Ledger.Total().EnergyRemoved; }
  ///@}
  std::string GetReport() const override;

  int HaloFor(int port) const override;
  void CheckConnections(quell::ConnectionCheck& check) const override;
  double CostPerPixel() const override { return 0.1; }

protected:
  vtkQuellMedianOfMeans();
  ~vtkQuellMedianOfMeans() override = default;
  void Execute(quell::StageFrame& frame) override;

private:
  int Estimator = 3;
  double GiniThreshold = 0.25;
  quell::EnergyLedger Ledger;

  vtkQuellMedianOfMeans(const vtkQuellMedianOfMeans&) = delete;
  void operator=(const vtkQuellMedianOfMeans&) = delete;
};

#endif
