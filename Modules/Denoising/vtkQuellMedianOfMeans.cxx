// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellMedianOfMeans.h"

#include "quellMedianOfMeans.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellMedianOfMeans);
QUELL_STAGE_DESCRIPTION(vtkQuellMedianOfMeans)

void vtkQuellMedianOfMeans::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellMedianOfMeans;
  d.Category = "Denoising";
  d.Brief = "Averages independent buffers so that an outlier in one of them cannot pull the mean.";
  d.Details =
    "In every pixel the buffers are sorted by luminance, `l_(1) <= ... <= l_(M)`; `G = 2 Sum j l_(j) / (M Sum l) - "
    "(M + 1) / M` tells how uneven they are. Estimators: Mean; Median (of an even number the darker of the two in "
    "the middle); Binary, the mean where `G <= GiniThreshold` and else the median; Gini, the mean without the "
    "`floor(G floor(M / 2))` darkest and as many brightest. `radiance + residual` is `mean` exactly. Buffers must "
    "hold equally many independent samples: connect a source's `halfA` and `halfB`, or sources that differ in "
    "`FirstSample`. Two buffers leave Gini nothing to trim: use Binary. Biased low for skewed noise, less with more "
    "samples per buffer; the energy is reported. A buffer that is not finite in a pixel is left out there; a pixel "
    "without any is replaced by the mean of its finite neighbours (0 if there are none). Sources: Jung, Meyer, "
    "DeLong 2015; Buisine, Delepoulle, Renaud 2021.";
  d.RepeatableInput("radiance", quell::ArrayKind::Color, "radiance", "a buffer; 1 to 64 connections");
  d.Output("radiance", quell::ArrayKind::Color, "the robust mean").Mean({ "radiance" });
  d.Output("residual", quell::ArrayKind::Color, "mean minus radiance; signed").AtMost(2, { "radiance" });
  d.Output("mean", quell::ArrayKind::Color, "mean of the buffers, as radiance + residual", 3).Mean({ "radiance" });
  d.Output("gini", quell::ArrayKind::Scalar, "G", 1).Within(0, 1);
  QUELL_ENUM(d, Estimator, "how buffers are averaged", "Mean", "Median", "Binary", "Gini");
  QUELL_DOUBLE(d, GiniThreshold, "", "of Binary: G above which the median is taken");
}

vtkQuellMedianOfMeans::vtkQuellMedianOfMeans()
{
  this->InitializePorts();
}

int vtkQuellMedianOfMeans::HaloFor(int) const
{
  return 1; // a non-finite pixel is filled from its neighbours
}

void vtkQuellMedianOfMeans::CheckConnections(quell::ConnectionCheck& check) const
{
  check.WantAtMost(0, quell::MedianOfMeansParameters::MostBuffers);
}

void vtkQuellMedianOfMeans::Execute(quell::StageFrame& frame)
{
  const int count = frame.Connections(0);
  std::vector<quell::ImageIn> buffers;
  for (int c = 0; c < count; ++c)
    buffers.push_back(frame.Input(0, c));
  const quell::MedianOfMeansParameters p{ quell::MeansEstimator(this->Estimator), this->GiniThreshold };
  const quell::MedianOfMeansOutputs out{ frame.Output("radiance"), frame.Output("residual"), frame.Output("mean"),
    frame.Output("gini") };
  const quell::ClampLedger ledger = this->Ledger.Run(
    frame.Region(), frame.Tick(),
    [this](const quell::Rect& rows, auto&& body) { this->ForEachTile(rows, quell::EnergyLedger::RowsPerStrip, body); },
    [&](const quell::Rect& strip) { return quell::MedianOfMeans(buffers.data(), count, p, out, strip); });
  quell::PixelCount::Report(ledger.NonFinite, this->Ledger.Total().NonFinite, this->Counters, this->Warnings,
    this->CountedWarning, "the buffers");
}

std::string vtkQuellMedianOfMeans::GetReport() const
{
  return this->Ledger.Text("took another value than the mean in");
}
