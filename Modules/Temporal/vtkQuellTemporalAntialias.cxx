// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellTemporalAntialias.h"

#include "quellTemporalAntialias.h"
#include "vtkObjectFactory.h"

#include <atomic>

vtkStandardNewMacro(vtkQuellTemporalAntialias);
QUELL_STAGE_DESCRIPTION(vtkQuellTemporalAntialias)

namespace
{
enum Port
{
  Radiance,
  Motion,
  Depth,
  History
};
}

vtkQuellTemporalAntialias::vtkQuellTemporalAntialias()
{
  this->InitializePorts();
}

void vtkQuellTemporalAntialias::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTemporalAntialias;
  using quell::ArrayKind;
  d.Category = "Temporal";
  d.Brief = "Blends each frame with its own previous output, clipped to the neighbourhood of the new frame.";
  d.Details = "out = h + Alpha (c - h), computed on (c w, w) with w = 1 / (1 + max c), so that small very bright spots "
              "do not flicker and "
              "the way back is exact; linear radiance in and out. h is the previous output at x + motion by a "
              "Catmull-Rom filter clamped "
              "to the central 2 x 2; motion is that of the 3 x 3 pixel nearest to the camera (when depth is "
              "connected). h is moved towards "
              "the mean of the new frame's 3 x 3 until it is within Gamma standard deviations in Y, Co and Cg.\n\n"
              "On the first frame and off screen the input is returned bit for bit. The delayed history covers the "
              "whole frame.\n\n"
              "Border: neighbours outside are left out, history repeats its edge. Non-finite pixels are replaced by "
              "history, else by "
              "the mean of finite neighbours, else by 0, and counted. Sources: Karis 2014, Salvi 2016.";
  d.Input("radiance", ArrayKind::Color, "radiance", "the new frame, filtered");
  d.OptionalInput(
    "motion", ArrayKind::Motion, "motion", "previous - current, pixels, un-jittered; without it nothing moves");
  d.OptionalInput("depth", ArrayKind::Depth, "depth", "picks the nearest surface's motion in the 3 x 3");
  d.Input("history", ArrayKind::Color, "radiance", "delayed: this stage's own radiance of the previous frame");
  d.Inputs[History].Delayed = true;
  d.Inputs[History].Reach = 2; // Catmull-Rom: 4 x 4
  for (int port : { Radiance, Motion, Depth })
    d.Inputs[port].Halo = 1;
  d.Output("radiance", ArrayKind::Color, "the blended frame, linear").Mean({ "radiance", "history" });
  QUELL_DOUBLE(d, Alpha, "", "weight of the new frame");
  QUELL_DOUBLE(d, Gamma, "sigma", "half width of the range that history may keep");
}

bool vtkQuellTemporalAntialias::NeedsInput(int port, const quell::ArraySet&) const
{
  return port != Depth || const_cast<vtkQuellTemporalAntialias*>(this)->GetNumberOfInputConnections(Motion) != 0;
}

double vtkQuellTemporalAntialias::HistoryWeight(int port) const
{
  return port == History ? 1 - this->Alpha : 1;
}

std::vector<std::string> vtkQuellTemporalAntialias::Explain()
{
  std::vector<std::string> lines{
    "history is read at x + motion: its own previous output is made for the whole frame"
  };
  if (this->GetNumberOfInputConnections(Motion) == 0)
    lines.push_back("no motion input: history is read in place");
  return lines;
}

void vtkQuellTemporalAntialias::Execute(quell::StageFrame& frame)
{
  quell::AntialiasInputs in;
  in.frame = frame.Whole();
  in.radiance = frame.Input(Radiance);
  in.motion = frame.Input(Motion);
  in.depth = frame.Input(Depth);
  in.history = frame.Input(History);
  if (in.history && in.history.extent != in.frame)
  {
    this->Warnings.push_back("history of another size is not used");
    in.history = quell::ImageIn();
  }
  const quell::AntialiasParameters parameters{ this->Alpha, this->Gamma };
  const quell::ImageOut out = frame.Output("radiance");
  std::atomic<std::int64_t> bad{ 0 };
  this->ForEachTile(
    frame.Region(), 64, [&](const quell::Rect& tile) { bad += quell::TemporalAntialias(in, parameters, out, tile); });
  this->Counters.NonFinite += bad;
  if (bad > 0)
    this->Warnings.push_back(std::to_string(bad) + " non-finite pixels of the new frame were replaced");
}
