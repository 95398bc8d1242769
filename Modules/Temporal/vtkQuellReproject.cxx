// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellReproject.h"

#include "quellReproject.h"
#include "vtkObjectFactory.h"

#include <algorithm>
#include <cmath>
#include <limits>

vtkStandardNewMacro(vtkQuellReproject);
QUELL_STAGE_DESCRIPTION(vtkQuellReproject)

namespace
{
enum Port
{
  Depth,
  Normal,
  Id,
  Motion,
  Position,
  History,
  Moments,
  Length,
  PreviousDepth,
  PreviousNormal,
  PreviousId,
  MeanRest
};

std::string SizeText(const quell::Rect& r)
{
  return std::to_string(r.width()) + " x " + std::to_string(r.height());
}
}

vtkQuellReproject::vtkQuellReproject()
{
  this->InitializePorts();
}

void vtkQuellReproject::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellReproject;
  using quell::ArrayKind;
  d.Category = "Temporal";
  d.Brief = "Brings the previous frame's colour, moments and history length to where its points are seen now.";
  d.Details =
    "History is read at q = x + motion. Each of the four bilinear taps must lie inside the frame, be surface or "
    "background like "
    "the pixel, have its id, a depth with |z_expected - z| <= DepthTolerance (slope + DepthEpsilon z), a normal with "
    "n . n' > NormalThreshold and finite values; the others' weights are renormalised when they sum to MinimumWeight "
    "or more, "
    "otherwise the valid pixels of the 3 x 3 are averaged, otherwise there is no history. z_expected is the point's "
    "depth in "
    "the previous camera. Where motion differs from the camera's by more than MotionTolerance pixels, the point moved "
    "and its "
    "previous depth is not known: the tolerance grows by MovingDepthTolerance z when ids are connected, otherwise by "
    "the "
    "distance that the extra motion stands for.\n\n"
    "A mix of (mean, M2) with weights w adds the spread of the means: M2 = sum w (M2_i + (mean_i - mean)^2).\n\n"
    "Without `motion` the matrices of both frames give it (the camera's only). The delayed inputs cover the whole "
    "frame.\n\n"
    "mask: 0 all taps, 1 some taps, 2 from the 3 x 3; no history: 3 no previous frame, 4 off screen, 5 not "
    "projectable, "
    "6 surface against background, 7 id, 8 depth, 9 normal, 10 history not finite or empty, 11 background.\n\n"
    "Pixels where nothing was hit have no history unless BackgroundHistory is on. Their light is 0, or that of a "
    "surface "
    "which covers a part of the pixel; the surface moves on and a history would keep 1/n of it where it was, as "
    "specks. "
    "What is seen of the background itself has no noise.\n\n"
    "Border: taps outside are rejected. Non-finite history is rejected; a non-finite depth is background; a non-finite "
    "motion is off screen. Source: Schied et al. 2017, section 4.";
  d.Input("depth", ArrayKind::Depth, "depth", "this frame's depth");
  d.Input("normal", ArrayKind::Normal, "normal", "this frame's normals");
  d.OptionalInput("id", ArrayKind::Id, "id", "this frame's object ids");
  d.OptionalInput(
    "motion", ArrayKind::Motion, "motion", "where each point was: previous - current, pixels, un-jittered");
  d.OptionalInput(
    "position", ArrayKind::Position, "position", "world positions; used only without motion, instead of depth");
  d.Input("history", ArrayKind::Color, "radiance", "delayed: the previous frame's accumulated colour");
  d.OptionalInput("moments", ArrayKind::Moments, "moments", "delayed: its moments");
  d.OptionalInput(
    "length", ArrayKind::History, "history", "delayed: its history length; without it, 1 where there is history");
  d.Input("previousDepth", ArrayKind::Depth, "depth", "delayed: the previous frame's depth");
  d.Input("previousNormal", ArrayKind::Normal, "normal", "delayed: its normals");
  d.OptionalInput("previousId", ArrayKind::Id, "id", "delayed: its ids");
  d.OptionalInput(
    "meanRest", ArrayKind::Scalar, "meanRest", "delayed: its meanRest, the second float of the moments' mean");
  d.Inputs[Depth].Halo = 1;
  d.Inputs[Id].Halo = 1;
  for (int port : { History, Moments, Length, PreviousDepth, PreviousNormal, PreviousId, MeanRest })
  {
    d.Inputs[port].Delayed = true;
    d.Inputs[port].Reach = 2; // Catmull-Rom: 4 x 4; else 2 x 2, or 3 x 3 around the nearest
  }
  d.Output("radiance", ArrayKind::Color, "the history's colour; 0 without history").Mean({ "history" }).OrZero();
  d.Output("moments", ArrayKind::Moments, "the history's moments")
    .Finite("means add their spread to the second moment, a square");
  d.Output("history", ArrayKind::History, "the history's length in frames; 0 where there is none")
    .Mean({ "length" })
    .OrZero();
  d.Output("mask", ArrayKind::Scalar, "how each pixel got its history or why it has none (0 to 11)").Within(0, 11);
  d.Output("meanRest", ArrayKind::Scalar, "what the moments' mean has beyond a float; 0 without the input")
    .Finite("at most half a step of the mean");
  QUELL_DOUBLE(d, DepthTolerance, "", "accepted depth difference, in (slope per pixel + DepthEpsilon depth)");
  QUELL_DOUBLE(d, DepthEpsilon, "", "part of the depth tolerated on a surface seen face on");
  QUELL_DOUBLE(d, MovingDepthTolerance, "", "further part of the depth tolerated where the point itself moved");
  QUELL_DOUBLE(d, MotionTolerance, "pixels", "motion beyond the camera's own by which a point counts as moved");
  QUELL_DOUBLE(d, NormalThreshold, "", "cosine of the largest accepted angle between normals");
  QUELL_DOUBLE(d, MinimumWeight, "", "bilinear weight that valid taps must have together");
  QUELL_ENUM(d, Interpolation, "colour where all taps are valid: Bilinear smooths, CatmullRom keeps detail", "Bilinear",
    "CatmullRom");
  QUELL_BOOL(d, BackgroundHistory,
    "keep a history where nothing was hit: still cameras converge there, moving surfaces leave specks");
}

bool vtkQuellReproject::NeedsInput(int port, const quell::ArraySet&) const
{
  return port != Position || const_cast<vtkQuellReproject*>(this)->GetNumberOfInputConnections(Motion) == 0;
}

std::vector<std::string> vtkQuellReproject::Explain()
{
  std::vector<std::string> lines{
    "history is read at x + motion: what its delayed inputs keep is made for the whole frame"
  };
  if (this->GetNumberOfInputConnections(Motion) == 0)
    lines.push_back("no motion input: motion follows from the camera matrices, so only the camera's movement is known");
  else if (this->GetNumberOfInputConnections(Position) != 0)
    lines.push_back("position left out: motion is connected");
  return lines;
}

quell::ReprojectInputs vtkQuellReproject::Gather(quell::StageFrame& frame, std::vector<std::string>& warnings)
{
  quell::ReprojectInputs in;
  in.frame = frame.Whole();
  in.depth = frame.Input(Depth);
  in.normal = frame.Input(Normal);
  in.id = frame.Input(Id);
  in.motion = frame.Input(Motion);
  in.position = frame.Input(Position);
  in.history = frame.Input(History);
  if (in.history)
  {
    in.moments = frame.Input(Moments);
    in.length = frame.Input(Length);
    in.previousDepth = frame.Input(PreviousDepth);
    in.previousNormal = frame.Input(PreviousNormal);
    in.previousId = frame.Input(PreviousId);
    in.meanRest = in.moments ? frame.Input(MeanRest) : quell::ImageIn();
    for (const quell::ImageIn& view :
      { in.history, in.moments, in.length, in.previousDepth, in.previousNormal, in.previousId, in.meanRest })
      if (view && view.extent != in.frame)
      {
        warnings.push_back(
          "history of another size is not used: it is " + SizeText(view.extent) + ", the frame " + SizeText(in.frame));
        in.history = quell::ImageIn();
        break;
      }
  }
  if (in.history)
  {
    const quell::FrameFacts now = frame.Facts(Depth);
    const quell::FrameFacts then = frame.Facts(frame.Has(PreviousDepth) ? PreviousDepth : History);
    if (now.HasCamera && then.HasCamera)
    {
      in.current = quell::ViewGeometry(now.WorldToNdc, now.WorldToCamera);
      in.previous = quell::ViewGeometry(then.WorldToNdc, then.WorldToCamera, now.Origin - then.Origin);
      if (!in.current.IsValid() || !in.previous.IsValid())
        warnings.push_back(in.motion ? "a camera matrix cannot be inverted: depth is compared loosely"
                                     : "a camera matrix cannot be inverted: no history");
    }
    else if (!in.motion)
    {
      in.stillCamera = !now.HasCamera && !then.HasCamera;
      warnings.push_back(in.stillCamera ? "neither motion nor camera matrices: the camera is taken to stand still"
                                        : "no motion, and only one of the two frames has a camera matrix: no history");
    }
  }

  return in;
}

quell::ReprojectParameters vtkQuellReproject::Parameters() const
{
  quell::ReprojectParameters parameters;
  parameters.depthTolerance = this->DepthTolerance;
  parameters.depthEpsilon = this->DepthEpsilon;
  parameters.movingDepthTolerance = this->MovingDepthTolerance;
  parameters.motionTolerance = this->MotionTolerance;
  parameters.normalThreshold = this->NormalThreshold;
  parameters.minimumWeight = this->MinimumWeight;
  parameters.catmullRom = this->Interpolation == CatmullRom;
  parameters.backgroundHistory = this->BackgroundHistory;
  return parameters;
}

void vtkQuellReproject::Execute(quell::StageFrame& frame)
{
  const quell::ReprojectInputs in = this->Gather(frame, this->Warnings);
  const quell::ReprojectParameters parameters = this->Parameters();
  const quell::ReprojectOutputs out{ frame.Output("radiance"), frame.Output("moments"), frame.Output("history"),
    frame.Output("mask"), frame.Output("meanRest") };
  this->ForEachTile(frame.Region(), 64, [&](const quell::Rect& tile) { quell::Reproject(in, parameters, out, tile); });
}

void vtkQuellReproject::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  std::vector<std::string> ignored;
  quell::ReprojectInputs in = this->Gather(frame, ignored);
  quell::ReprojectParameters parameters = this->Parameters();
  const quell::Rect pixel = frame.Region();
  float mask = 0, result[3] = {};
  const auto run = [&]
  {
    quell::ReprojectOutputs out;
    out.radiance = quell::ImageOut(result, 3, pixel);
    out.mask = quell::ImageOut(&mask, 1, pixel);
    quell::Reproject(in, parameters, out, pixel);
  };
  run();
  static const char* const reasons[] = { "there is no previous frame", "its point was outside of the previous frame",
    "its point cannot be projected into the previous camera", "surface became background, or the reverse",
    "another id was there", "another depth was there", "another normal was there",
    "the history is not finite, or has no sample yet", "nothing was hit" };
  const int why = int(mask) - int(quell::ReprojectMask::NoHistory);
  if (why >= 0)
    throw quell::StageError(std::string("no history here: ") + reasons[std::min(why, 8)]);
  if (parameters.catmullRom && int(mask) == int(quell::ReprojectMask::Used))
    throw quell::StageError("CatmullRom clamps the colour to the four pixels around: no weights stand for that");
  // Where its taps are: a history that holds every pixel's place gives their mean.
  const quell::ImageIn history = in.history;
  const quell::Rect& whole = history.extent;
  std::vector<float> values(3 * std::size_t(whole.area()));
  const quell::ImageOut marks(values.data(), 3, whole);
  const auto finite = [](const float* v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (int y = whole.y0; y < whole.y1; ++y)
    for (int x = whole.x0; x < whole.x1; ++x)
    {
      const bool good = finite(history.at(x, y));
      marks.at(x, y)[0] = good ? float(x) : nan;
      marks.at(x, y)[1] = good ? float(y) : nan;
      marks.at(x, y)[2] = good ? 1.f : nan;
    }
  in.history = quell::ImageIn(marks);
  run();
  const int column = int(std::floor(result[0])), row = int(std::floor(result[1]));
  quell::PixelWeights::Part part;
  part.Input = "history";
  part.Window = quell::Rect{ column - 2, row - 2, column + 4, row + 4 }.clipped(whole);
  part.Weights.resize(std::size_t(part.Window.area()));
  for (float& v : values)
    v = std::isfinite(v) ? 0.f : v;
  const auto at = [&](std::size_t i)
  { return marks.at(part.Window.x0 + int(i) % part.Window.width(), part.Window.y0 + int(i) / part.Window.width()); };
  for (std::size_t i = 0; i < part.Weights.size(); ++i)
  {
    if (!finite(at(i)))
      continue;
    at(i)[0] = 1;
    run();
    at(i)[0] = 0;
    part.Weights[i] = result[0];
  }
  weights.Parts.push_back(std::move(part));
}
