// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellSum.h"

#include "quellSum.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellSum);
QUELL_STAGE_DESCRIPTION(vtkQuellSum)

void vtkQuellSum::Describe(quell::StageDescription& d)
{
  d.Category = "Denoising";
  d.Brief = "Adds layers.";
  d.Details =
    "`radiance` is the sum over all connections, in float and in their order, so the rounding is always the same. "
    "Signed layers are added as they are; a sum beyond the largest float stays there. A non-finite pixel of a "
    "term is replaced by the mean of its finite neighbours in that term (0 if there are none).";
  d.RepeatableInput("radiance", quell::ArrayKind::Color, "radiance", "a layer; any number of connections");
  d.Output("radiance", quell::ArrayKind::Color, "the sum").AtMost(1, { "radiance" });
}

vtkQuellSum::vtkQuellSum()
{
  this->InitializePorts();
}

int vtkQuellSum::HaloFor(int) const
{
  return 1; // a non-finite pixel is filled from its neighbours
}

void vtkQuellSum::Execute(quell::StageFrame& frame)
{
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->Superclass::Execute(frame);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "the terms");
}

void vtkQuellSum::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  this->NonFinite.Count(tile,
    [&](const quell::Rect& part)
    {
      const quell::ImageOut out = frame.Output("radiance");
      std::int64_t bad = 0;
      for (int c = 0; c < frame.Connections(0); ++c)
        bad += quell::AddTerm(frame.Input(0, c), c == 0, out, part);
      return bad;
    });
}
