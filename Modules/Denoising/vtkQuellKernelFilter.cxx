// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellKernelFilter.h"

#include "quellCarriedArrays.h"
#include "quellGuards.h"
#include "quellKernelFilter.h"
#include "quellWeighByMarks.h"
#include "vtkObjectFactory.h"

#include <cmath>

vtkStandardNewMacro(vtkQuellKernelFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellKernelFilter)

namespace
{
enum Ports
{
  Radiance
};
enum Kernels
{
  Identity,
  Box,
  Peak3x3,
  Gaussian,
  FromMatrix
};
constexpr int TileSize = 64;

quell::ArrayKind KindOf(const std::string& array)
{
  const quell::ArrayType* type = quell::FindArray(array);
  return type ? type->Kind : quell::ArrayKind::Any;
}
}

void vtkQuellKernelFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellKernelFilter;
  d.Category = "Denoising";
  d.Brief = "Filters with fixed weights: box, Gaussian, a 3 x 3 peak or any matrix.";
  d.Details =
    "`out(p) = Sum w(q - p) c(q) / Sum w(q - p)` over the taps that are inside the image and finite, so borders are "
    "normalised by the weights that fall inside, constants stay to the last bit, and the sum over the interior is "
    "kept. "
    "`Peak3x3` is `[1 3 1; 3 6 3; 1 3 1] / 22`. Every array that `Arrays` names is filtered with the weights of the "
    "colour (a pixel whose colour is not finite weighs nothing in alpha either); normals come out with length 1, "
    "variances are those of the weighted mean of independent pixels; ids, materials and moments are refused. Without "
    "`Normalize` the plain sum, with 0 outside the image. A pixel that is not finite becomes the mean of its "
    "neighbours by the same weights; in further arrays, a depth that is not finite stays.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what is filtered, and the arrays named in Arrays");
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input")
    .Mean({ "radiance" })
    .Except("Normalize", "false")
    .Except("Kernel", "Matrix");
  QUELL_ENUM(d, Kernel, "the weights", "Identity", "Box", "Peak3x3", "Gaussian", "Matrix");
  QUELL_INT(
    d, Radius, "pixels", "half the side of Box and Gaussian; -1: 1, or ceil(3 Sigma) (at most 64) for Gaussian");
  QUELL_DOUBLE(d, Sigma, "pixels", "standard deviation of Gaussian; 0: identity, 1e30: box");
  QUELL_STRING(d, Matrix,
    "weights of Matrix: numbers by blanks, rows by semicolons, the top row first; odd numbers of both, at most 129");
  QUELL_BOOL(d, Normalize, "divide by the sum of the weights that fall inside; off: a plain sum, for derivatives");
  QUELL_STRING(
    d, Arrays, "further arrays of the first input that are filtered likewise, by blanks: alpha albedo normal");
}

vtkQuellKernelFilter::vtkQuellKernelFilter()
{
  this->InitializePorts();
}

void vtkQuellKernelFilter::SetMatrix(const std::string& text)
{
  if (text == this->Matrix)
    return;
  this->Matrix = text;
  this->Modified();
}

void vtkQuellKernelFilter::SetArrays(const std::string& names)
{
  if (names == this->Arrays)
    return;
  this->Arrays = names;
  this->Modified();
}

quell::FilterKernel vtkQuellKernelFilter::MakeKernel() const
{
  quell::FilterKernel kernel;
  std::string error;
  switch (this->Kernel)
  {
    case Box:
      return quell::BoxKernel(this->Radius < 0 ? 1 : this->Radius);
    case Peak3x3:
      return quell::Peak3x3Kernel();
    case Gaussian:
      return quell::GaussianKernel(this->Sigma, this->Radius);
    case FromMatrix:
      if (!quell::ParseKernel(this->Matrix, kernel, error))
        throw quell::StageError("Matrix: " + error);
      return kernel;
    default:
      return quell::IdentityKernel();
  }
}

void vtkQuellKernelFilter::CheckSettings()
{
  const quell::FilterKernel kernel = this->MakeKernel();
  double sum = 0, magnitude = 0;
  quell::KernelSums(kernel, sum, magnitude);
  if (this->Normalize && std::fabs(sum) <= 1e-6 * magnitude)
    throw quell::StageError(
      "Matrix: its weights add up to 0, so there is nothing to divide by; set Normalize to false");
  for (const std::string& name : quell::CarriedArrays(this->Arrays))
    if (KindOf(name) == quell::ArrayKind::Id || KindOf(name) == quell::ArrayKind::Moments)
      throw quell::StageError("Arrays: \"" + name + "\" has no weighted mean (" + quell::KindDoc(KindOf(name)) + ")");
}

bool vtkQuellKernelFilter::Makes(const std::string& array) const
{
  return this->vtkQuellStage::Makes(array) || quell::IsCarriedArray(this->Arrays, array);
}

int vtkQuellKernelFilter::HaloFor(int) const
{
  int radius = this->Kernel == Peak3x3 || (this->Kernel == Box && this->Radius < 0) ? 1 : std::max(0, this->Radius);
  if (this->Kernel == Gaussian)
    radius = quell::GaussianKernel(this->Sigma, this->Radius).RadiusX;
  else if (this->Kernel == FromMatrix)
  {
    quell::FilterKernel kernel;
    std::string error;
    radius = quell::ParseKernel(this->Matrix, kernel, error) ? std::max(kernel.RadiusX, kernel.RadiusY) : 0;
  }
  else if (this->Kernel == Identity)
    radius = 0;
  return radius + 1; // a tap that is not finite is filled from its own neighbours
}

double vtkQuellKernelFilter::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  return quell::TileScratchBytes(TileSize, TileSize, this->HaloFor(0), 2 * (4 + 1));
}

void vtkQuellKernelFilter::CheckConnections(quell::ConnectionCheck& check) const
{
  quell::CheckCarriedArrays(check, this->Arrays, 4, false);
}

void vtkQuellKernelFilter::Execute(quell::StageFrame& frame)
{
  this->CheckSettings();
  const quell::FilterKernel kernel = this->MakeKernel();
  struct Work
  {
    quell::ImageIn in;
    quell::ImageOut out;
    quell::ArrayKind kind;
  };
  std::vector<Work> works;
  const quell::ImageIn color = frame.Input(Radiance);
  if (frame.Wants("radiance"))
    works.push_back({ color, frame.Output("radiance"), quell::ArrayKind::Color });
  for (const std::string& name : quell::CarriedArrays(this->Arrays))
    if (frame.Wants(name))
    {
      const quell::ImageIn in = frame.InputArray(Radiance, 0, name);
      if (in.components < 1 || in.components > 4)
        throw quell::StageError("Arrays: \"" + name + "\" has " + std::to_string(in.components) + " components");
      works.push_back({ in, frame.AddOutput(name, in.components), KindOf(name) });
    }
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->ForEachTile(frame.Region(), TileSize,
    this->NonFinite.Counting(
      [&](const quell::Rect& tile)
      {
        static thread_local quell::Scratch scratch;
        std::int64_t bad = 0;
        for (const Work& w : works)
        {
          const auto mode =
            w.kind == quell::ArrayKind::Variance ? quell::KernelMode::Variance : quell::KernelMode::Mean;
          const bool isColor = w.in.data == color.data;
          const std::int64_t found = quell::KernelFilter(w.in, isColor ? quell::ImageIn() : color, kernel,
            this->Normalize, mode, w.out, tile, scratch.Take(quell::KernelFilterScratch(w.in, kernel, tile)));
          if (isColor)
            bad += found;
          if (w.kind != quell::ArrayKind::Normal && w.kind != quell::ArrayKind::Depth)
            continue;
          for (int y = tile.y0; y < tile.y1; ++y)
            for (int x = tile.x0; x < tile.x1; ++x)
            {
              float* o = w.out.at(x, y);
              const float* in = w.in.at(x, y);
              if (w.kind == quell::ArrayKind::Depth)
                *o = quell::Finite(*in) ? *o : *in;
              else
              {
                const float length = std::sqrt(o[0] * o[0] + o[1] * o[1] + o[2] * o[2]);
                for (int c = 0; c < 3; ++c)
                  o[c] = length > 1e-6f ? o[c] / length : 0.f;
              }
            }
        }
        return bad;
      }));
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
  const std::int64_t taps =
    kernel.Separable() ? std::int64_t(kernel.Across.size() + kernel.Up.size()) : std::int64_t(kernel.Weights.size());
  this->Counters.Taps += frame.Region().area() * taps * std::int64_t(works.size());
}

void vtkQuellKernelFilter::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  const quell::FilterKernel kernel = this->MakeKernel();
  const quell::ImageIn color = frame.Input(Radiance);
  const quell::Rect pixel = frame.Region();
  quell::Scratch scratch;
  quell::WeighByMarks(weights, "radiance", color, pixel.grown(std::max(kernel.RadiusX, kernel.RadiusY)), 1,
    [&](const quell::ImageIn& marks, const quell::ImageOut& out)
    {
      quell::KernelFilter(marks, color, kernel, this->Normalize, quell::KernelMode::Mean, out, pixel,
        scratch.Take(quell::KernelFilterScratch(marks, kernel, pixel)));
    });
}
