// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellSampleFilter.h"

#include "quellGuards.h"
#include "quellSampleFilter.h"
#include "quellWeighByMarks.h"
#include "vtkObjectFactory.h"

#include <algorithm>
#include <vector>

vtkStandardNewMacro(vtkQuellSampleFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellSampleFilter)

namespace
{
enum Ports
{
  Radiance,
  Depth,
  Normal,
  Albedo,
  Id
};

quell::SampleFilterInputs InputsOf(const std::vector<quell::ImageIn> (&views)[5])
{
  const auto all = [&views](int port) { return views[port].empty() ? nullptr : views[port].data(); };
  return { int(views[Radiance].size()), all(Radiance), all(Depth), all(Normal), all(Albedo), all(Id) };
}
}

void vtkQuellSampleFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellSampleFilter;
  d.Category = "Denoising";
  d.Brief = "Cross-bilateral filter of individual samples, averaged to pixels afterwards.";
  d.Details =
    "Connect N samples per pixel as N frames (sources with `SamplesPerPixel` 1, `FirstSample` 0 ... N - 1 and, over "
    "several frames, `SamplesPerTick` N), every "
    "port in the same order. `C'(p) = 1/N sum_t F(p, t)`; `F(p, t)` is the mean of the neighbours' samples, weighted "
    "by distance and by how far their own normal, depth, albedo and id are from those of sample t: `w = "
    "exp(-(|q-p|^2 / 2 ss^2 + |n-n'|^2 / 2 sn^2 + (ln z/z')^2 / 2 sd^2 + |a-a'|^2 / 2 sa^2))`. With `Pairs` Same, "
    "sample t meets only samples t; with All, every one. Colour has no say: one sample's colour is mostly noise. "
    "`Demodulate` divides every sample by its own albedo (at least `Floor`) and multiplies its result by it. So the "
    "filter runs before the pixel filter, and pixels with several surfaces in them (edges, depth of field, motion "
    "blur) keep their parts. With one connection it is the pixel-based filter. Taps outside, not finite, of another "
    "id or without a hit have weight 0; a sample that is not finite becomes its neighbours' mean; samples without a "
    "hit pass through. Sources: Bikker, Advanced Graphics, lecture 15 (accumulated or individual samples?); Sen and "
    "Darabi 2012.";
  const auto sample = [&d](const char* name, quell::ArrayKind kind, const char* doc)
  {
    d.RepeatableInput(name, kind, name, doc);
    d.Inputs.back().Optional = d.Inputs.size() > 1;
  };
  sample("radiance", quell::ArrayKind::Color, "a sample of every pixel; any number of connections");
  sample("depth", quell::ArrayKind::Depth, "guide; one connection per sample");
  sample("normal", quell::ArrayKind::Normal, "guide; one connection per sample");
  sample("albedo", quell::ArrayKind::Albedo, "guide and divisor; one connection per sample");
  sample("id", quell::ArrayKind::Id, "never mixes samples of different ids; one connection per sample");
  d.Output("radiance", quell::ArrayKind::Color, "the mean of the filtered samples")
    .Mean({ "radiance" })
    .Except("Demodulate", "true")
    .AtMost(1, { "radiance" })
    .DividedBy("Floor");
  QUELL_INT(d, Radius, "pixels", "half the window's side");
  QUELL_DOUBLE(d, SigmaSpatial, "pixels", "standard deviation in distance; 0: no neighbours");
  QUELL_DOUBLE(d, SigmaNormal, "", "standard deviation of the length of the difference of normals; 1e30: off");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of the relative depth difference; 1e30: off");
  QUELL_DOUBLE(d, SigmaAlbedo, "", "standard deviation of the albedo difference; 1e30: off");
  QUELL_ENUM(d, Pairs, "which samples meet: those with the same number (cost N), or all (cost N^2)", "Same", "All");
  QUELL_BOOL(d, Demodulate, "divide every sample by its own albedo before and multiply by it after");
  QUELL_DOUBLE(d, Floor, "", "albedos below count as this when dividing and multiplying");
}

vtkQuellSampleFilter::vtkQuellSampleFilter()
{
  this->InitializePorts();
}

int vtkQuellSampleFilter::HaloFor(int) const
{
  return std::max(1, this->Radius); // 1: a non-finite sample is filled from its neighbours
}

void vtkQuellSampleFilter::CheckConnections(quell::ConnectionCheck& check) const
{
  const auto times = [](int n) { return std::to_string(n) + (n == 1 ? " connection" : " connections"); };
  const int count = check.Count(Radiance);
  for (int port = Depth; port <= Id; ++port)
  {
    const int n = check.Count(port);
    if (n != 0 && n != count)
      check.Error(port, std::min(n - 1, count), times(n) + ", but \"radiance\" has " + times(count),
        "each sample needs its own, in the same order");
  }
}

double vtkQuellSampleFilter::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  return quell::TileScratchBytes(64, 64, this->HaloFor(0), 12 * std::max(1, this->GetNumberOfInputConnections(0)));
}

void vtkQuellSampleFilter::Gather(
  quell::StageFrame& frame, std::vector<quell::ImageIn> (&views)[5], quell::SampleFilterParameters& p) const
{
  for (int port = Radiance; port <= Id; ++port)
    for (int c = 0; c < frame.Connections(port); ++c)
      views[port].push_back(frame.Input(port, c));
  p.radius = this->Radius;
  p.sigmaSpatial = this->SigmaSpatial;
  p.sigmaNormal = this->SigmaNormal;
  p.sigmaDepth = this->SigmaDepth;
  p.sigmaAlbedo = this->SigmaAlbedo;
  p.pairs = quell::SamplePairs(this->Pairs);
  p.demodulate = this->Demodulate;
  p.floor = float(this->Floor);
}

void vtkQuellSampleFilter::Execute(quell::StageFrame& frame)
{
  std::vector<quell::ImageIn> views[5];
  quell::SampleFilterParameters p;
  this->Gather(frame, views, p);
  const int count = int(views[Radiance].size());
  const quell::SampleFilterInputs in = InputsOf(views);
  const quell::ImageOut out = frame.Output("radiance");
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->ForEachTile(frame.Region(), 64,
    this->NonFinite.Counting(
      [&](const quell::Rect& tile)
      {
        static thread_local quell::Scratch scratch;
        return quell::SampleFilter(in, p, out, tile, scratch.Take(quell::SampleFilterScratch(in, p, tile)));
      }));
  const std::int64_t side = 2 * this->Radius + 1;
  this->Counters.Taps += frame.Region().area() * side * side * count * (this->Pairs ? count : 1);
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "the samples");
}

void vtkQuellSampleFilter::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  std::vector<quell::ImageIn> views[5];
  quell::SampleFilterParameters p;
  this->Gather(frame, views, p);
  // The weights are those of what is divided by albedos.
  const bool divided = p.demodulate && !views[Albedo].empty();
  p.demodulate = false;
  const quell::Rect pixel = frame.Region();
  const std::vector<quell::ImageIn> samples = views[Radiance];
  // Colour has no say in the weights, but what is not finite has none: marked samples take its place, three pixels at
  // a time.
  const quell::Rect around = pixel.grown(p.radius + 1).clipped(frame.Whole());
  std::vector<std::vector<float>> marked(samples.size());
  for (std::size_t t = 0; t < samples.size(); ++t)
  {
    marked[t].resize(3 * std::size_t(around.area()));
    views[Radiance][t] = quell::ImageIn(marked[t].data(), 3, around);
  }
  quell::Scratch scratch;
  for (std::size_t t = 0; t < samples.size(); ++t)
  {
    const std::string name =
      (divided ? "radiance / albedo" : "radiance") + (samples.size() == 1 ? "" : " " + std::to_string(t + 1));
    quell::WeighByMarks(weights, name, samples[t], pixel.grown(p.radius), 1,
      [&](const quell::ImageIn& marks, const quell::ImageOut& out)
      {
        // The filter takes three channels, marks have four.
        for (int first : { 0, 3 })
        {
          const int channels = first == 0 ? 3 : 1;
          for (std::size_t k = 0; k < samples.size(); ++k)
            for (int y = around.y0; y < around.y1; ++y)
              for (int x = around.x0; x < around.x1; ++x)
              {
                float* to = &marked[k][3 * (std::size_t(y - around.y0) * std::size_t(around.width()) +
                                             std::size_t(x - around.x0))];
                const bool finite = quell::Finite3(samples[k].at(x, y));
                for (int c = 0; c < 3; ++c)
                  to[c] = !finite                                        ? samples[k].at(x, y)[c]
                          : k == t && c < channels && marks.inside(x, y) ? marks.at(x, y)[first + c]
                                                                         : 0.f;
              }
          float color[3];
          const quell::SampleFilterInputs in = InputsOf(views);
          quell::SampleFilter(
            in, p, quell::ImageOut(color, 3, pixel), pixel, scratch.Take(quell::SampleFilterScratch(in, p, pixel)));
          std::copy_n(color, channels, out.data + first);
        }
      });
  }
}
