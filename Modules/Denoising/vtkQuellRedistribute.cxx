// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellRedistribute.h"

#include "quellRedistribute.h"
#include "vtkObjectFactory.h"

#include <cstdio>
#include <vector>

vtkStandardNewMacro(vtkQuellRedistribute);
QUELL_STAGE_DESCRIPTION(vtkQuellRedistribute)

namespace
{
enum Ports
{
  Radiance,
  Residual,
  Depth,
  Normal,
  Id
};
constexpr int WholeFrame = 1 << 24; // a halo beyond every image
constexpr int RowsPerTask = 16;
}

void vtkQuellRedistribute::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellRedistribute;
  d.Category = "Denoising";
  d.Brief = "Gives the energy that a clamp took to the neighbourhood or to the whole image.";
  d.Details =
    "Neighbourhood: every pixel's residual is spread by a Gaussian of `Sigma sqrt(max(1, |residual| / Threshold))` "
    "pixels within `Radius`, times weights of normal, depth and id, and its weights are divided by their sum over "
    "the pixels that exist. Image: all residuals together are added in proportion to luminance (evenly to a black "
    "image). Either way the sum over the frame of the output is that of both inputs, per channel: together with the "
    "clamp the energy is right, its place is not, and a caustic becomes a glow. A pixel without a hit keeps its own "
    "residual. Image needs the whole frame, whatever region is asked for, and in a sequence it makes the whole frame "
    "brighter where one pixel flashes. A non-finite residual counts as 0; a non-finite radiance is replaced by the "
    "mean of its finite neighbours (0 if there are none). Source: Bikker, Advanced Graphics, lecture 15: spread the "
    "energy.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what the clamp left");
  d.Input("residual", quell::ArrayKind::Color, "residual", "what the clamp took; signed");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "nothing is given across a step");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "nothing is given across an edge");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "nothing is given to another id");
  d.Output("radiance", quell::ArrayKind::Color, "radiance and all of the residual")
    .Finite("a neighbourhood's whole residual may meet in one pixel")
    .Total({ "radiance", "residual" });
  QUELL_ENUM(d, Over, "who receives", "Neighbourhood", "Image");
  QUELL_INT(d, Radius, "pixels", "half the side of the largest window; 0: every pixel gets its own residual back");
  QUELL_DOUBLE(d, Sigma, "pixels", "standard deviation of the kernel of a small residual; 0: radiance + residual");
  QUELL_DOUBLE(d, Threshold, "", "length of a residual from which its kernel widens, in the input's unit");
  QUELL_DOUBLE(d, SigmaNormal, "", "standard deviation of the length of the difference of normals; 1e30: off");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of the relative depth difference; 1e30: off");
}

vtkQuellRedistribute::vtkQuellRedistribute()
{
  this->InitializePorts();
}

int vtkQuellRedistribute::HaloFor(int) const
{
  if (this->Over == Image)
    return WholeFrame;
  return std::max(1, 2 * this->Radius); // those that give, and all to whom they give
}

bool vtkQuellRedistribute::NeedsInput(int port, const quell::ArraySet&) const
{
  return this->Over == Neighbourhood || port <= Residual;
}

void vtkQuellRedistribute::Execute(quell::StageFrame& frame)
{
  quell::RedistributeInputs in;
  in.radiance = frame.Input(Radiance);
  in.residual = frame.Input(Residual);
  in.depth = frame.Input(Depth);
  in.normal = frame.Input(Normal);
  in.id = frame.Input(Id);
  const quell::ImageOut out = frame.Output("radiance");
  // Of all that takes part: for Image the whole frame, else what is new of this frame.
  bool started = false;
  const quell::Rect added = this->Counted.Add(frame.Region(), frame.Tick(), started);
  const quell::Rect counted = this->Over == Image ? frame.Whole() : added;
  std::vector<quell::ImageEnergy> rows(counted.height());
  this->ForEachTile(
    { 0, counted.y0, 1, counted.y1 }, RowsPerTask,
    [&](const quell::Rect& strip)
    {
      for (int y = strip.y0; y < strip.y1; ++y)
        rows[y - counted.y0] = quell::SumEnergy(in.radiance, in.residual, { counted.x0, y, counted.x1, y + 1 });
    },
    0, 0.2);
  quell::ImageEnergy sum;
  for (const quell::ImageEnergy& row : rows)
    sum += row;
  if (started || this->Over == Image)
    this->EnergyLeft = this->EnergySpread = 0;
  this->EnergyLeft += sum.Luminance;
  this->EnergySpread += 0.2126 * sum.Residual[0] + 0.7152 * sum.Residual[1] + 0.0722 * sum.Residual[2];

  this->NonFinite.Begin(frame.Region(), frame.Tick());
  if (this->Over == Image)
    this->ForEachTile(frame.Region(), 64,
      this->NonFinite.Counting(
        [&](const quell::Rect& tile) { return quell::RedistributeEvenly(in.radiance, in.residual, sum, out, tile); }),
      0.2, 1);
  else
  {
    const quell::RedistributeParameters p{ this->Radius, this->Sigma, this->Threshold, this->SigmaNormal,
      this->SigmaDepth };
    this->ForEachTile(frame.Region(), 64,
      this->NonFinite.Counting(
        [&](const quell::Rect& tile)
        {
          std::vector<double> scratch(quell::RedistributeScratch(tile));
          return quell::Redistribute(in, p, out, tile, scratch.data());
        }),
      0.2, 1);
  }
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance or residual");
}

std::string vtkQuellRedistribute::GetReport() const
{
  const double energy = this->EnergyLeft + this->EnergySpread;
  if (!(energy > 0))
    return std::string();
  char text[120];
  std::snprintf(text, sizeof text, "gave %.3g %% of the energy back to the %s", 100 * this->EnergySpread / energy,
    this->Over == Image ? "image" : "neighbourhood");
  return text;
}
