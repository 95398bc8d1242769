// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellTemporalAccumulate.h"

#include "quellAccumulate.h"
#include "vtkObjectFactory.h"

#include <algorithm>
#include <atomic>

vtkStandardNewMacro(vtkQuellTemporalAccumulate);
QUELL_STAGE_DESCRIPTION(vtkQuellTemporalAccumulate)

vtkQuellTemporalAccumulate::vtkQuellTemporalAccumulate()
{
  this->InitializePorts();
}

void vtkQuellTemporalAccumulate::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTemporalAccumulate;
  using quell::ArrayKind;
  d.Category = "Temporal";
  d.Brief = "Mixes the new frame into its reprojected history.";
  d.Details =
    "h = min(h' + 1, MaximumHistory); a = max(Alpha, 1/h); C = C' + a (x - C'). Moments of luminance, with "
    "a = max(MomentsAlpha, 1/h) and d = lum(x) - mean': mean = mean' + a d, M2 = (1 - a)(M2' + a d^2). Where the "
    "history length "
    "is 0 the new frame is taken as it is.\n\n"
    "A stationary picture keeps Alpha / (2 - Alpha) of its noise variance: 0.2 leaves 1/9, 0.05 leaves 1/39. The price "
    "is lag "
    "where light changes, since only geometry is validated: after a step, 1 % is left after 21 frames with 0.2, 90 "
    "with 0.05.\n\n"
    "A non-finite pixel of the new frame keeps its history; without history it gets the mean of its finite 3 x 3 "
    "neighbours (0 without any) and length 0. It is counted. Nothing non-finite is stored.";
  d.Input("radiance", ArrayKind::Color, "radiance", "the new frame");
  d.Input("history", ArrayKind::Color, "radiance", "Reproject's radiance");
  d.OptionalInput("moments", ArrayKind::Moments, "moments", "Reproject's moments");
  d.Input("length", ArrayKind::History, "history", "Reproject's history");
  d.Inputs[0].Halo = 1;
  d.Output("radiance", ArrayKind::Color, "accumulated colour").Mean({ "radiance", "history" });
  d.Output("moments", ArrayKind::Moments, "mean and central second moment of the frames' luminance")
    .Finite("the second moment is a square");
  d.Output("history", ArrayKind::History, "frames accumulated, at most MaximumHistory").Within(0, 1048576);
  QUELL_DOUBLE(d, Alpha, "", "smallest weight of the new frame in the colour");
  QUELL_DOUBLE(d, MomentsAlpha, "", "smallest weight of the new frame in the moments");
  QUELL_INT(d, MaximumHistory, "frames", "largest history length; 1 means no history");
}

double vtkQuellTemporalAccumulate::HistoryWeight(int port) const
{
  const double least = 1. / this->MaximumHistory;
  const double color = 1 - std::max(this->Alpha, least), moments = 1 - std::max(this->MomentsAlpha, least);
  return port == 0 ? 1 : port == 1 ? color : port == 2 ? moments : std::max(color, moments);
}

void vtkQuellTemporalAccumulate::Execute(quell::StageFrame& frame)
{
  const quell::AccumulateInputs in{ frame.Input(0), frame.Input(1), frame.Input(2), frame.Input(3) };
  const quell::AccumulateOutputs out{ frame.Output("radiance"), frame.Output("moments"), frame.Output("history") };
  const quell::AccumulateParameters parameters{ this->Alpha, this->MomentsAlpha, double(this->MaximumHistory) };
  std::atomic<std::int64_t> bad{ 0 };
  this->ForEachTile(
    frame.Region(), 64, [&](const quell::Rect& tile) { bad += quell::Accumulate(in, parameters, out, tile); });
  this->Counters.NonFinite += bad;
  if (bad > 0)
    this->Warnings.push_back(std::to_string(bad) + " non-finite pixels of the new frame were not accumulated");
}
