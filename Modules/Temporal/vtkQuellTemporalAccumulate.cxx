// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellTemporalAccumulate.h"

#include "quellAccumulate.h"
#include "vtkObjectFactory.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

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
    "The second moment is right within 1e-3 up to a mean of 1e4 deviations. With `meanRest` connected (this stage's "
    "output of that name, delayed, through Reproject) the mean is carried as two floats, moments[0] + meanRest, and it "
    "is right up to 1e6.\n\n"
    "A non-finite pixel of the new frame keeps its history; without history it gets the mean of its finite 3 x 3 "
    "neighbours (0 without any) and length 0. It is counted. Nothing non-finite is stored.";
  d.Input("radiance", ArrayKind::Color, "radiance", "the new frame");
  d.Input("history", ArrayKind::Color, "radiance", "Reproject's radiance");
  d.OptionalInput("moments", ArrayKind::Moments, "moments", "Reproject's moments");
  d.Input("length", ArrayKind::History, "history", "Reproject's history");
  d.OptionalInput("meanRest", ArrayKind::Scalar, "meanRest",
    "Reproject's meanRest; connected, the moments' mean is carried as two floats");
  d.Inputs[0].Halo = 1;
  d.Output("radiance", ArrayKind::Color, "accumulated colour").Mean({ "radiance", "history" });
  d.Output("moments", ArrayKind::Moments, "mean and central second moment of the frames' luminance")
    .Finite("the second moment is a square");
  d.Output("history", ArrayKind::History, "frames accumulated, at most MaximumHistory").Within(0, 1048576);
  d.Output("meanRest", ArrayKind::Scalar, "what the moments' mean has beyond a float; 0 without the input")
    .Finite("at most half a step of the mean");
  QUELL_DOUBLE(d, Alpha, "", "smallest weight of the new frame in the colour");
  QUELL_DOUBLE(d, MomentsAlpha, "", "smallest weight of the new frame in the moments");
  QUELL_INT(d, MaximumHistory, "frames", "largest history length; 1 means no history");
}

double vtkQuellTemporalAccumulate::HistoryWeight(int port) const
{
  const double least = 1. / this->MaximumHistory;
  const double color = 1 - std::max(this->Alpha, least), moments = 1 - std::max(this->MomentsAlpha, least);
  return port == 0 ? 1 : port == 1 ? color : port == 2 || port == 4 ? moments : std::max(color, moments);
}

void vtkQuellTemporalAccumulate::Execute(quell::StageFrame& frame)
{
  const quell::AccumulateInputs in{ frame.Input(0), frame.Input(1), frame.Input(2), frame.Input(3), frame.Input(4) };
  const quell::AccumulateOutputs out{ frame.Output("radiance"), frame.Output("moments"), frame.Output("history"),
    frame.Output("meanRest") };
  const quell::AccumulateParameters parameters{ this->Alpha, this->MomentsAlpha, double(this->MaximumHistory) };
  std::atomic<std::int64_t> bad{ 0 };
  this->ForEachTile(
    frame.Region(), 64, [&](const quell::Rect& tile) { bad += quell::Accumulate(in, parameters, out, tile); });
  this->Counters.NonFinite += bad;
  if (bad > 0)
    this->Warnings.push_back(std::to_string(bad) + " non-finite pixels of the new frame were not accumulated");
}

void vtkQuellTemporalAccumulate::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  const quell::ImageIn radiance = frame.Input(0), history = frame.Input(1);
  const quell::AccumulateParameters parameters{ this->Alpha, this->MomentsAlpha, double(this->MaximumHistory) };
  const quell::Rect pixel = frame.Region();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto finite = [](const float* v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); };
  // Marked in the first channel is a pixel of the new frame, in the second one the history.
  quell::PixelWeights::Part fresh, old;
  fresh.Input = "radiance";
  fresh.Window = pixel.grown(1).clipped(radiance.extent);
  fresh.Weights.resize(std::size_t(fresh.Window.area()));
  old.Input = "history";
  old.Window = pixel;
  old.Weights.resize(1);
  float past[3] = { 0, 1, 0 };
  if (history && !finite(history.at(pixel.x0, pixel.y0)))
    std::fill_n(past, 3, nan);
  std::vector<float> values(3 * fresh.Weights.size());
  const quell::ImageOut marks(values.data(), 3, fresh.Window);
  std::size_t i = 0;
  for (int y = fresh.Window.y0; y < fresh.Window.y1; ++y)
    for (int x = fresh.Window.x0; x < fresh.Window.x1; ++x, ++i)
    {
      for (int qy = fresh.Window.y0; qy < fresh.Window.y1; ++qy)
        for (int qx = fresh.Window.x0; qx < fresh.Window.x1; ++qx)
          std::fill_n(marks.at(qx, qy), 3, finite(radiance.at(qx, qy)) ? 0.f : nan);
      if (!finite(radiance.at(x, y)))
        continue;
      marks.at(x, y)[0] = 1;
      float result[3] = {};
      quell::AccumulateInputs in;
      in.radiance = quell::ImageIn(marks);
      in.history = history ? quell::ImageIn(past, 3, pixel) : quell::ImageIn();
      in.length = frame.Input(3);
      quell::AccumulateOutputs out;
      out.radiance = quell::ImageOut(result, 3, pixel);
      quell::Accumulate(in, parameters, out, pixel);
      fresh.Weights[i] = result[0];
      old.Weights[0] = result[1];
    }
  weights.Parts.push_back(std::move(fresh));
  weights.Parts.push_back(std::move(old));
}
