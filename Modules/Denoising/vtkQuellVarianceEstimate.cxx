// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellVarianceEstimate.h"

#include "quellGuidedPlanes.h"
#include "quellVariance.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQuellVarianceEstimate);
QUELL_STAGE_DESCRIPTION(vtkQuellVarianceEstimate)

namespace
{
enum Ports
{
  Radiance,
  Moments,
  Length,
  Depth,
  Normal,
  Id,
  MeanRest
};
constexpr int TileWidth = 128, TileRows = 16; // the planes of one lie in the second cache
}

void vtkQuellVarianceEstimate::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellVarianceEstimate;
  d.Category = "Denoising";
  d.Brief = "Estimates the variance of luminance: over frames where there were enough, else over neighbours.";
  d.Details = "With `length >= MinimumHistory` the variance is the central second moment over frames and the colour "
              "passes through. Else "
              "both are means over 7 x 7 pixels with SVGF's depth and normal weights, the variance raised by "
              "`MinimumHistory / length`; "
              "a pixel without usable neighbours gets its squared luminance, because 0 would freeze it unfiltered. "
              "Without `moments` "
              "every pixel is estimated in space; without `length` the moments are trusted everywhere. Taps outside "
              "the image, not "
              "finite, of another id or without a hit have weight 0. A non-finite pixel becomes the weighted mean of "
              "its neighbours. "
              "Background passes through with variance 0. Source: Schied et al. 2017, section 4.2.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "accumulated illumination");
  d.OptionalInput(
    "moments", quell::ArrayKind::Moments, "moments", "mean and central second moment of luminance over frames");
  d.OptionalInput("length", quell::ArrayKind::History, "history", "frames in the moments");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide of the spatial estimate");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide of the spatial estimate");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.OptionalInput("meanRest", quell::ArrayKind::Scalar, "meanRest",
    "TemporalAccumulate's: what the moments' mean has beyond a float");
  d.Output("variance", quell::ArrayKind::Variance, "variance of luminance")
    .Finite("a square, raised where the history is short; not negative");
  d.Output("radiance", quell::ArrayKind::Color, "the input; its neighbourhood's mean where the variance is spatial")
    .Mean({ "radiance" }).Limited(-1e35, 3.4e38);
  QUELL_INT(d, MinimumHistory, "frames", "length from which the moments are used");
  QUELL_ENUM(d, VarianceOf,
    "whose variance: of one frame's pixel, as SVGF has it, or of the mean of min(length, MaximumSamples) frames",
    "Frame", "Mean");
  QUELL_DOUBLE(d, MaximumSamples, "frames", "what an endless history is worth: (2 - alpha) / alpha");
  QUELL_DOUBLE(d, SigmaDepth, "", "depth tolerance in units of the local slope");
  QUELL_DOUBLE(d, SigmaNormal, "", "exponent of the cosine between normals; 0: normals do not matter");
  QUELL_DOUBLE(d, DepthEpsilon, "", "depth tolerance without slope, relative to depth");
}

vtkQuellVarianceEstimate::vtkQuellVarianceEstimate()
{
  this->InitializePorts();
}

int vtkQuellVarianceEstimate::HaloFor(int) const
{
  return quell::VariancePass::Radius;
}

double vtkQuellVarianceEstimate::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  return quell::TileScratchBytes(TileWidth, TileRows, quell::VariancePass::Radius, quell::GuidedPlanes::Most(13));
}

void vtkQuellVarianceEstimate::Execute(quell::StageFrame& frame)
{
  const quell::Rect region = frame.Region();
  const quell::ImageIn color = frame.Input(Radiance), moments = frame.Input(Moments), length = frame.Input(Length);
  const quell::ImageIn meanRest = moments ? frame.Input(MeanRest) : quell::ImageIn();
  const quell::ImageIn depth = frame.Input(Depth), normal = frame.Input(Normal), id = frame.Input(Id);
  const quell::ImageOut colorOut = frame.Output("radiance"), varianceOut = frame.Output("variance");

  quell::VariancePass parameters;
  parameters.sigmaDepth = float(this->SigmaDepth);
  parameters.sigmaNormal = float(this->SigmaNormal);
  parameters.depthEpsilon = float(this->DepthEpsilon);
  parameters.minimumHistory = float(this->MinimumHistory);
  parameters.ofMean = this->VarianceOf == 1;
  parameters.maximumSamples = float(this->MaximumSamples);

  this->NonFinite.Begin(frame.Region(), frame.Tick());
  std::atomic<std::int64_t> estimated{ 0 };
  const auto inSpace = [&](const quell::Rect& tile)
  {
    static thread_local quell::GuidedPlanes planes;
    quell::VariancePass pass = parameters;
    const bool temporal = bool(moments) || bool(length);
    planes.Begin(tile.grown(quell::VariancePass::Radius).clipped(frame.Whole()), quell::VariancePass::Radius,
      meanRest ? 13 : 12, depth, normal, id);
    pass.in = planes.TakeColor(true, true, false);
    pass.out = planes.TakeColor(bool(colorOut), false, true);
    pass.moments.mean = planes.Take(bool(moments));
    pass.moments.central = planes.Take(bool(moments));
    pass.moments.history = planes.Take(temporal);
    pass.moments.rest = planes.Take(bool(meanRest));
    pass.guides = planes.Guides;
    const quell::Rect counted = tile.clipped(this->NonFinite.CountedRegion());
    planes.Fill([](const quell::Rect& r, auto&& body) { body(r.y0, r.y1); },
      [&](int y0, int y1)
      {
        this->NonFinite.Add(counted, quell::CopyColor(color, quell::ImageIn(), pass.guides, pass.in, y0, y1, counted));
        if (temporal)
          quell::CopyMoments(
            moments, length, meanRest, pass.guides.layout, pass.in, pass.moments, pass.minimumHistory, y0, y1);
      });
    for (int y = tile.y0; y < tile.y1; ++y)
      quell::VarianceRow(pass, y, tile.x0, tile.x1);
    quell::StoreFiltered(pass.guides, pass.out, color, quell::ImageIn(), colorOut, varianceOut, tile);
    estimated += tile.area();
  };
  const int across = (region.width() + TileWidth - 1) / TileWidth, up = (region.height() + TileRows - 1) / TileRows;
  this->ForEachTile({ 0, 0, across, up }, 1,
    [&](const quell::Rect& t)
    {
      const int x = region.x0 + t.x0 * TileWidth, y = region.y0 + t.y0 * TileRows;
      const quell::Rect tile{ x, y, std::min(x + TileWidth, region.x1), std::min(y + TileRows, region.y1) };
      // After some frames nearly every tile ends here.
      if (!moments ||
          !quell::VarianceOverFrames(parameters, color, moments, length, depth, colorOut, varianceOut, tile))
        inSpace(tile);
    });
  constexpr int side = 2 * quell::VariancePass::Radius + 1;
  this->Counters.Taps += estimated * side * side;
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
}
