// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellVarianceSteeredFilter.h"

#include "quellVarianceSteered.h"
#include "vtkObjectFactory.h"

#include <algorithm>

vtkStandardNewMacro(vtkQuellVarianceSteeredFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellVarianceSteeredFilter)

namespace
{
enum Ports
{
  Radiance,
  Variance,
  Depth,
  Normal,
  Albedo,
  Id
};
constexpr int TileSize = 96;

quell::VarianceSteeredInputs Gather(const quell::StageFrame& frame)
{
  quell::VarianceSteeredInputs in;
  in.radiance = frame.Input(Radiance);
  in.variance = frame.Input(Variance);
  in.depth = frame.Input(Depth);
  in.normal = frame.Input(Normal);
  in.albedo = frame.Input(Albedo);
  in.id = frame.Input(Id);
  return in;
}
}

void vtkQuellVarianceSteeredFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellVarianceSteeredFilter;
  d.Category = "Denoising";
  d.Brief = "Filters every pixel with the kernel whose estimated error, from the variance, is smallest.";
  d.Details =
    "Kernels are Gaussians of sigma 0.5, 1, 2, 4, 8 pixels (`Scales` of them) times Gaussian weights of the "
    "connected guides; colour has no say in the weights, so each is linear. The error of a kernel F at a pixel is "
    "estimated without bias by Stein's formula, `(l(F) - l(c))^2 + V (2 w0 - 1)`, with V the variance of the pixel's "
    "mean and w0 the pixel's own weight, added up over 7 x 7 pixels; the identity's error is V. The kernel with the "
    "least wins, choices are mixed over 3 x 3 pixels. The variance is propagated (`sum w^2 V / (sum w)^2`, an upper "
    "bound for the mix). Variance 0 everywhere: the identity, bit by bit; so `variance` must be the pixel's, which a "
    "path tracer cannot know from one sample: take it from `VarianceEstimate` then. It must be the variance of this "
    "very input: a path tracer's `variance` fits radiance, not illumination; with it, filter direct + indirect and "
    "connect the albedo as a guide. Taps outside, not finite, of another id or without a hit have weight 0; a "
    "non-finite pixel becomes its neighbours' mean; background passes through. Sources: Stein 1981; Li, Wu, Chuang "
    "2012; Rousselle, Knaus, Zwicker 2012.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what is filtered");
  d.Input("variance", quell::ArrayKind::Variance, "variance", "of the pixel's mean luminance");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide");
  d.OptionalInput("albedo", quell::ArrayKind::Albedo, "albedo", "guide");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input").Mean({ "radiance" });
  d.Output("variance", quell::ArrayKind::Variance, "of its luminance").AtMost(1, { "variance" });
  d.Output("sigma", quell::ArrayKind::Scalar, "pixels: the mean width chosen; 0: identity", 1).Within(0, 8);
  QUELL_INT(d, Scales, "", "kernels to choose among besides the identity; 0: identity");
  QUELL_DOUBLE(d, SigmaNormal, "", "standard deviation of the length of the difference of normals; 1e30: off");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of the relative depth difference; 1e30: off");
  QUELL_DOUBLE(d, SigmaAlbedo, "", "standard deviation of the albedo difference; 1e30: off");
}

vtkQuellVarianceSteeredFilter::vtkQuellVarianceSteeredFilter()
{
  this->InitializePorts();
}

int vtkQuellVarianceSteeredFilter::HaloFor(int) const
{
  quell::VarianceSteeredParameters p;
  p.scales = this->Scales;
  return quell::VarianceSteeredHalo(p);
}

double vtkQuellVarianceSteeredFilter::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  // What is read; a result and an error for each scale.
  return quell::TileScratchBytes(
    TileSize, TileSize, this->HaloFor(0), 13 + 9 * (quell::VarianceSteeredParameters::MostScales + 1));
}

void vtkQuellVarianceSteeredFilter::Execute(quell::StageFrame& frame)
{
  const quell::VarianceSteeredInputs in = Gather(frame);
  const quell::VarianceSteeredParameters p{ this->Scales, this->SigmaNormal, this->SigmaDepth, this->SigmaAlbedo };
  const quell::VarianceSteeredOutputs out{ frame.Output("radiance"), frame.Output("variance"), frame.Output("sigma") };
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  // What is around a tile is judged again with it: larger tiles waste less.
  this->ForEachTile(frame.Region(), TileSize,
    this->NonFinite.Counting(
      [&](const quell::Rect& tile)
      {
        static thread_local quell::Scratch scratch;
        return quell::VarianceSteered(in, p, out, tile, scratch.Take(quell::VarianceSteeredScratch(in, p, tile)));
      }));
  const std::int64_t side = 2 * quell::VarianceSteeredRadius(this->Scales) + 1;
  this->Counters.Taps += frame.Region().area() * side * side;
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
}

void vtkQuellVarianceSteeredFilter::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  const quell::VarianceSteeredInputs in = Gather(frame);
  const quell::VarianceSteeredParameters p{ this->Scales, this->SigmaNormal, this->SigmaDepth, this->SigmaAlbedo };
  const quell::Rect pixel = frame.Region();
  // Which kernels it is mixed of is known by filtering it once more.
  float chosen[quell::VarianceSteeredParameters::MostScales + 1];
  quell::VarianceSteeredOutputs out;
  out.parts = quell::ImageOut(chosen, quell::VarianceSteeredParameters::MostScales + 1, pixel);
  quell::Scratch scratch;
  quell::VarianceSteered(in, p, out, pixel, scratch.Take(quell::VarianceSteeredScratch(in, p, pixel)));
  quell::PixelWeights::Part part;
  part.Input = "radiance";
  part.Window = pixel.grown(std::max(1, quell::VarianceSteeredRadius(this->Scales))).clipped(in.radiance.extent);
  part.Weights.resize(std::size_t(part.Window.area()));
  quell::VarianceSteeredWeights(
    in, p, chosen, pixel.x0, pixel.y0, quell::ImageOut(part.Weights.data(), 1, part.Window));
  weights.Parts.push_back(std::move(part));
}
