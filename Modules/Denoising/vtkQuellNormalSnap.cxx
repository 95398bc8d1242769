// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellNormalSnap.h"

#include "quellSnapNormals.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellNormalSnap);
QUELL_STAGE_DESCRIPTION(vtkQuellNormalSnap)

namespace
{
enum Port
{
  Normal,
  Depth,
  Position,
  Id,
  VarianceNormal
};
}

void vtkQuellNormalSnap::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellNormalSnap;
  d.Category = "Denoising";
  d.Brief = "Gives pixels that show several surfaces the normal of one of them.";
  d.Details =
    "A mean of unit normals is shorter than 1 where they differ (`E|n - mean|^2 = 1 - |mean|^2`). On creases and "
    "silhouettes it is like none of the surfaces, so guided filters find no taps, history is refused, and edges stay "
    "ragged with noise. A normal shorter than 0.99, or one whose `varianceNormal` is above MixedVariance, becomes that "
    "of the neighbour q in 5 x 5 pixels with the largest `exp(-D^2 / 2 SigmaDepth^2 - |q - p|^2 / 2) n(p) . n(q)`, "
    "where that is above e^-8, D the distance of p from q's plane relative to depth (without positions: the difference "
    "of ln z), of the pixel's id, "
    "hit, "
    "and not mixed itself; without such a neighbour it is made unit. Filters then treat the pixel's light as that of "
    "one "
    "surface; the albedo, mixed as it is, keeps the edge smooth. Other normals and pixels without a hit stay; a normal "
    "that is not finite becomes 0.";
  d.Input("normal", quell::ArrayKind::Normal, "normal", "mean normals of the pixels' samples");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "tells which surface to take");
  d.OptionalInput(
    "position", quell::ArrayKind::Position, "position", "with depth: compares by plane distance instead of depth");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never takes the normal of another id");
  d.OptionalInput("varianceNormal", quell::ArrayKind::Any, "varianceNormal",
    "of the pixel's mean normal, per component or averaged: tells mixed pixels where the source makes normals unit");
  d.Output("normal", quell::ArrayKind::Normal, "normals of single surfaces")
    .Finite("a normal longer than 1 is none of a mixed pixel, and stays");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of plane distance or depth, relative to depth");
  QUELL_DOUBLE(
    d, MixedVariance, "", "variance of the mean normal from which a pixel is mixed, where varianceNormal is connected");
}

vtkQuellNormalSnap::vtkQuellNormalSnap()
{
  this->InitializePorts();
}

int vtkQuellNormalSnap::HaloFor(int) const
{
  return quell::SnapNormalsReach;
}

void vtkQuellNormalSnap::CheckConnections(quell::ConnectionCheck& check) const
{
  if (check.Count(VarianceNormal) > 0)
    check.WantComponents(VarianceNormal, 0, { 1, 3 });
}

void vtkQuellNormalSnap::Execute(quell::StageFrame& frame)
{
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->Superclass::Execute(frame);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "normal");
}

void vtkQuellNormalSnap::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  this->NonFinite.Count(tile,
    [&](const quell::Rect& part)
    {
      quell::SnapNormalsInputs in;
      in.normal = frame.Input(Normal);
      in.depth = frame.Input(Depth);
      in.position = frame.Input(Position);
      in.id = frame.Input(Id);
      in.variance = frame.Input(VarianceNormal);
      quell::SnapNormalsParameters p;
      p.sigmaDepth = this->SigmaDepth;
      p.mixedVariance = this->MixedVariance;
      return quell::SnapNormals(in, p, frame.Output("normal"), part);
    });
}
