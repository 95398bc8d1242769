// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellCompareFrames.h"

#include "quellTemporalMetrics.h"
#include "quellGuards.h"
#include "vtkObjectFactory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

vtkStandardNewMacro(vtkQuellCompareFrames);
QUELL_STAGE_DESCRIPTION(vtkQuellCompareFrames)

namespace
{
enum Ports
{
  Image,
  Previous,
  Motion,
  Id,
  PreviousId,
  Reference,
  PreviousReference
};

/// The part of a view that was computed.
quell::ImageIn Crop(const quell::ImageIn& v, const quell::Rect& r)
{
  return v ? quell::ImageIn(v.at(r.x0, r.y0), v.components, r, v.rowStride) : v;
}
}

vtkQuellCompareFrames::vtkQuellCompareFrames()
{
  this->InitializePorts();
}

void vtkQuellCompareFrames::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellCompareFrames;
  using quell::ArrayKind;
  d.Category = "Metrics";
  d.Brief = "Measures how a frame changed since the one before, and should not have.";
  d.Details = "The report says `flicker`, sqrt(mean (e - e')^2 / 2) with e the error of this frame and e' that of the "
              "one before (without a reference: the frames themselves, right for a view that stands still), and, "
              "where motion is connected, `warp`, sqrt(mean (t(p) - t'(p + motion))^2), bilinear, over pixels whose "
              "taps lie inside and have the same id. A mean over many frames, and lag and ghosts, are what `quell "
              "compare` computes of files.\n\nThe first frame, and pixels that are not finite, are reported as `not "
              "compared` and why; the run goes on.";
  d.Sink = true;
  d.Input("image", ArrayKind::Color, "radiance", "the frame");
  d.Input("previous", ArrayKind::Color, "radiance", "delayed: the frame before");
  d.OptionalInput("motion", ArrayKind::Motion, "motion", "where each point was: previous - current, pixels");
  d.OptionalInput("id", ArrayKind::Id, "id", "with previousId: what shows another surface is not compared");
  d.OptionalInput("previousId", ArrayKind::Id, "id", "delayed: the ids of the frame before");
  d.OptionalInput("reference", ArrayKind::Color, "radiance", "what the frame should look like");
  d.OptionalInput("previousReference", ArrayKind::Color, "radiance", "delayed: the same of the frame before");
  for (int port : { Previous, PreviousId, PreviousReference })
  {
    d.Inputs[port].Delayed = true;
    d.Inputs[port].Reach = 1; // bilinear
  }
  d.Output("error", ArrayKind::Scalar, "change of each pixel, along the motion, that the reference does not have")
    .AtMost(1, { "image", "previous", "reference", "previousReference" });
  QUELL_STRING(d, Label, "what the report calls the image");
}

void vtkQuellCompareFrames::SetLabel(const std::string& label)
{
  if (label == this->Label)
    return;
  this->Label = label;
  this->Modified();
}

std::string vtkQuellCompareFrames::GetReport() const
{
  return this->Report.empty() ? this->Report : this->Label + ": " + this->Report;
}

// TemporalMetrics keeps two frames of each of its inputs but motion.
double vtkQuellCompareFrames::ScratchBytes(const quell::Rect& region, const quell::Rect&, const quell::ArraySet&)
{
  const bool reference = this->GetNumberOfInputConnections(Reference) > 0;
  const bool id = this->GetNumberOfInputConnections(Id) > 0;
  return 2. * double(sizeof(float)) * (3 + (reference ? 3 : 0) + (id ? 1 : 0)) * double(region.area());
}

std::string vtkQuellCompareFrames::Compare(quell::StageFrame& frame) const
{
  const quell::Rect region = frame.Region();
  const quell::ImageIn now = Crop(frame.Input(Image), region), motion = Crop(frame.Input(Motion), region);
  const quell::ImageIn whole = frame.Input(Previous);
  if (!whole)
    throw quell::StageError("there is no frame before");
  if (whole.extent != frame.Whole())
    throw quell::StageError("the frame before has another size");
  const quell::ImageIn then = Crop(whole, region);
  const bool references = frame.Input(Reference) && frame.Input(PreviousReference);
  const quell::ImageIn r = references ? Crop(frame.Input(Reference), region) : quell::ImageIn();
  const quell::ImageIn rThen = references ? Crop(frame.Input(PreviousReference), region) : quell::ImageIn();
  const bool ids = frame.Input(Id) && frame.Input(PreviousId);
  const quell::ImageIn id = ids ? Crop(frame.Input(Id), region) : quell::ImageIn();
  const quell::ImageIn idThen = ids ? Crop(frame.Input(PreviousId), region) : quell::ImageIn();

  quell::TemporalMetrics metrics;
  metrics.Add(then, rThen, motion, idThen);
  metrics.Add(now, r, motion, id);
  std::string report;
  for (const auto& v : metrics.Values())
  {
    if (v.first.compare(0, 7, "flicker") != 0 && v.first.compare(0, 4, "warp") != 0)
      continue;
    char text[96];
    std::snprintf(text, sizeof text, "%s%s %.3g", report.empty() ? "" : ", ", v.first.c_str(), v.second);
    report += text;
  }
  if (const quell::ImageOut map = frame.Output("error"))
    for (int y = region.y0; y < region.y1; ++y)
      for (int x = region.x0; x < region.x1; ++x)
      {
        const float* m = motion ? motion.at(x, y) : nullptr;
        const double px = m ? std::floor(x + double(m[0]) + 0.5) : x, py = m ? std::floor(y + double(m[1]) + 0.5) : y;
        float sum = 0;
        if (px >= region.x0 && py >= region.y0 && px < region.x1 && py < region.y1)
          for (int c = 0; c < now.components; ++c)
          {
            float d = now.at(x, y)[c] - then.at(int(px), int(py))[c];
            if (references)
              d -= r.at(x, y)[c] - rThen.at(int(px), int(py))[c];
            sum += std::fabs(d) / float(now.components);
          }
        *map.at(x, y) = quell::Limited(sum);
      }
  return report;
}

void vtkQuellCompareFrames::Execute(quell::StageFrame& frame)
{
  try
  {
    this->Report = this->Compare(frame);
  }
  catch (const quell::StageError& error)
  {
    this->Report = std::string("not compared: ") + error.what();
    if (const quell::ImageOut map = frame.Output("error"))
      for (int y = map.extent.y0; y < map.extent.y1; ++y)
        std::fill_n(map.at(map.extent.x0, y), map.extent.width(), 0.f);
    if (frame.Input(Previous))
      this->Warnings.push_back(this->Report);
  }
}
