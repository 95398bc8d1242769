// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellNonLocalFilter.h"

#include "quellFeatureNoise.h"
#include "quellGuards.h"
#include "quellGuideVariances.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace
{
enum Ports
{
  Radiance,
  HalfA,
  HalfB,
  Variance,
  Depth,
  Guide,
  GuideVariance,
  Feature ///< of the regression alone
};
constexpr int TileSize = 64, NoiseReach = 2;
constexpr int OuterFloats = 15, InnerFloats = 6; ///< a pixel, of two candidates with their errors, and of the choice
constexpr int SmoothRadius = 9, SmoothPatch = 1; ///< of the errors and of the choice between bandwidths
constexpr double LargestError = 1e35;            ///< 19 x 19 of them do not overflow

/// Per channel, the mean of (A - B)^2 / 2 over the 3 x 3 neighbours that are finite in both: the variance of a half.
void HalfVariance(const quell::ImageIn& a, const quell::ImageIn& b, const quell::ImageOut& out) noexcept
{
  const quell::Rect& r = out.extent;
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x)
    {
      double sum[3] = {};
      int n = 0;
      for (int qy = std::max(y - 1, a.extent.y0); qy < std::min(y + 2, a.extent.y1); ++qy)
        for (int qx = std::max(x - 1, a.extent.x0); qx < std::min(x + 2, a.extent.x1); ++qx)
        {
          const float *u = a.at(qx, qy), *v = b.at(qx, qy);
          if (!quell::Finite3(u) || !quell::Finite3(v))
            continue;
          for (int c = 0; c < 3; ++c)
            sum[c] += 0.5 * (double(u[c]) - v[c]) * (double(u[c]) - v[c]);
          ++n;
        }
      for (int c = 0; c < 3; ++c)
        out.at(x, y)[c] = n ? float(std::min(LargestError, sum[c] / n)) : 0.f;
    }
}
}

void vtkQuellNonLocalFilter::DescribeInputs(quell::StageDescription& d)
{
  d.Category = "Denoising";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what is filtered; illumination rather than radiance");
  d.OptionalInput(
    "halfA", quell::ArrayKind::Color, "halfA", "with halfB: one half of the samples, filtered in its place");
  d.OptionalInput("halfB", quell::ArrayKind::Color, "halfB", "the other half; each gives the weights of the other");
  d.OptionalInput("variance", quell::ArrayKind::Any, "variance",
    "of radiance's pixel values: of the luminance or per channel; else estimated");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "tells the background, which passes through");
  d.RepeatableInput("guide", quell::ArrayKind::Any, "albedo", "a feature that steers the weights")
    .Attribute("name", "by which a guideVariance calls it; default: the array's name")
    .Attribute("least", "tau, the squared difference that no pixel resolves; default 1e-3");
  d.RepeatableInput("guideVariance", quell::ArrayKind::Any, "varianceAlbedo",
     "variance of a guide's mean value (1 component: averaged over its components)")
    .Attribute("guide", "name of the guide that it belongs to");
  d.Inputs[Guide].Optional = d.Inputs[GuideVariance].Optional = true;
}

bool vtkQuellNonLocalFilter::SetInputAttribute(
  int port, int connection, const std::string& name, const std::string& value, std::string& error)
{
  GuideSettings now = this->Settings[{ port, connection }];
  if ((port == Guide && name == "name") || (port == GuideVariance && name == "guide"))
    now.Name = value;
  else if (port == Guide && name == "least")
  {
    if (!quell::detail::ParseDouble(value, 1e-30, 1e30, now.Least, error))
    {
      error = "least = " + error;
      return false;
    }
  }
  else
    return this->vtkQuellStage::SetInputAttribute(port, connection, name, value, error);
  GuideSettings& old = this->Settings[{ port, connection }];
  if (old.Name != now.Name || old.Least != now.Least)
  {
    old = now;
    this->Modified();
  }
  return true;
}

int vtkQuellNonLocalFilter::HaloFor(int) const
{
  const int own = quell::NonLocalHalo(this->Radius, this->PatchRadius, this->Regresses()) + NoiseReach;
  return own + (this->Selects() ? 2 * quell::NonLocalHalo(SmoothRadius, SmoothPatch, false) : 0);
}

bool vtkQuellNonLocalFilter::NeedsInput(int port, const quell::ArraySet&) const
{
  auto* self = const_cast<vtkQuellNonLocalFilter*>(this);
  // Without history there are no halves.
  return port != Radiance || this->Selects() || this->IsDelayed(HalfA) || this->IsDelayed(HalfB) ||
         self->GetNumberOfInputConnections(HalfA) == 0 || self->GetNumberOfInputConnections(HalfB) == 0;
}

vtkQuellNonLocalFilter::GuideSettings vtkQuellNonLocalFilter::SettingsOf(int port, int connection) const
{
  const auto found = this->Settings.find({ port, connection });
  return found == this->Settings.end() ? GuideSettings() : found->second;
}

void vtkQuellNonLocalFilter::CheckConnections(quell::ConnectionCheck& check) const
{
  const bool a = check.Count(HalfA) > 0, b = check.Count(HalfB) > 0;
  if (a != b)
    check.Error(a ? HalfA : HalfB, 0, std::string("wants input \"") + (a ? "halfB" : "halfA") + "\" too",
      "one half alone is no use");
  if (check.Count(Variance) > 0)
    check.WantComponents(Variance, 0, { 1, 3 });
  check.WantAtMost(Guide, quell::NonLocalInputs::MostFeatures);
  std::vector<std::string> names, wanted;
  for (int c = 0; c < check.Count(Guide); ++c)
  {
    const std::string own = this->SettingsOf(Guide, c).Name;
    names.push_back(own.empty() ? check.At(Guide, c).Array : own);
    check.WantComponents(Guide, c, { 1, 2, 3 });
  }
  for (int c = 0; c < check.Count(GuideVariance); ++c)
    wanted.push_back(this->SettingsOf(GuideVariance, c).Name);
  quell::CheckGuideVariances(check, Guide, names, GuideVariance, wanted);
  if (!this->Regresses())
    return;
  check.WantAtMost(Feature, quell::NonLocalInputs::MostFeatures);
  int components = 0, last = 0;
  for (int c = 0; c < check.Count(Feature); ++c)
  {
    check.WantComponents(Feature, c, { 1, 2, 3 });
    const int before = components;
    components += check.At(Feature, c).Components;
    last = before <= quell::NonLocalInputs::MostRegressors ? c : last;
  }
  if (components > quell::NonLocalInputs::MostRegressors)
    check.Error(Feature, last,
      "the features have " + std::to_string(components) + " components together, at most " +
        std::to_string(quell::NonLocalInputs::MostRegressors) + " are possible");
}

double vtkQuellNonLocalFilter::ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet&)
{
  const int features =
    this->GetNumberOfInputConnections(Guide) + (this->Regresses() ? this->GetNumberOfInputConnections(Feature) : 0);
  const double side = 2 * this->Radius + 1, rows = 2 * (2 * this->PatchRadius + 1) + 1;
  double bytes = quell::TileScratchBytes(TileSize, TileSize, this->HaloFor(0), 14 + 4 * features + 8 + 6) +
                 quell::TileScratchBytes(TileSize + 2 * this->HaloFor(0), 1, 0, side * side * rows / 3);
  if (this->Selects())
  {
    const int reach = quell::NonLocalHalo(SmoothRadius, SmoothPatch, false);
    bytes += sizeof(float) * (OuterFloats * double(region.grown(2 * reach).clipped(whole).area()) +
                               InnerFloats * double(region.grown(reach).clipped(whole).area()));
  }
  return bytes;
}

/// All but the target, the guide and its variance.
quell::NonLocalInputs vtkQuellNonLocalFilter::Guides(quell::StageFrame& frame)
{
  quell::NonLocalInputs in;
  in.depth = frame.Input(Depth);
  std::vector<std::string> names;
  for (int c = 0; c < frame.Connections(Guide); ++c) // a delayed one without history is none
  {
    const GuideSettings settings = this->SettingsOf(Guide, c);
    names.push_back(settings.Name.empty() ? this->GetInputArray(Guide, c) : settings.Name);
    quell::NonLocalFeature& f = in.weighing[in.weighingCount++];
    f.value = frame.Input(Guide, c);
    f.least = settings.Least;
  }
  for (int c = 0; c < frame.Connections(GuideVariance); ++c)
  {
    const int guide =
      quell::GuideOfVariance(names, this->SettingsOf(GuideVariance, c).Name, this->GetInputArray(GuideVariance, c));
    if (guide >= 0)
      in.weighing[guide].variance = frame.Input(GuideVariance, c);
  }
  for (int c = 0; this->Regresses() && c < frame.Connections(Feature); ++c)
    in.regressors[in.regressorCount++].value = frame.Input(Feature, c);
  return in;
}

quell::NonLocalParameters vtkQuellNonLocalFilter::Parameters() const
{
  quell::NonLocalParameters p;
  p.radius = this->Radius;
  p.patch = this->PatchRadius;
  p.kColor = this->KColor;
  p.kFeature = this->KGuide;
  p.epsilon = this->Epsilon;
  p.ridge = this->Ridge;
  p.regress = this->Regresses();
  return p;
}

namespace
{
/// What is filtered: radiance, or its halves with the weights of each other.
struct Pictures
{
  explicit Pictures(quell::StageFrame& frame)
    : Radiance(frame.Input(Ports::Radiance))
    , HalfA(frame.Input(Ports::HalfA))
    , HalfB(frame.Input(Ports::HalfB))
    , Variance(frame.Input(Ports::Variance))
    , Halves(this->HalfA && this->HalfB)
  {
  }

  /// The variance of the buffer that gives the weights, for the pixels that a tile reads.
  quell::ImageIn NoiseOf(const quell::ImageIn& depth, const quell::Rect& tile, int reach, quell::Scratch& memory) const
  {
    if (this->Variance && !this->Halves)
      return this->Variance;
    const quell::Rect grown = tile.grown(reach).clipped((this->Halves ? this->HalfA : this->Radiance).extent);
    const int components = this->Halves ? 3 : 1;
    const quell::ImageOut made(
      memory.Take(std::size_t(grown.area()) * components + quell::FeatureNoiseScratch(grown)), components, grown);
    if (this->Variance)
      for (int y = grown.y0; y < grown.y1; ++y)
        for (int x = grown.x0; x < grown.x1; ++x)
          for (int c = 0; c < 3; ++c)
          {
            const float v = this->Variance.at(x, y)[this->Variance.components == 3 ? c : 0];
            // Errors are estimated with it, and a negative one is none.
            made.at(x, y)[c] = v > 0 ? 2 * std::min(v, float(LargestError)) : 0.f;
          }
    else if (this->Halves)
      HalfVariance(this->HalfA, this->HalfB, made);
    else
      quell::FeatureNoise(this->Radiance, quell::ImageIn(), depth, made, grown, made.data + grown.area());
    return made;
  }

  /// quell::NonLocal of `target` with the weights of `guide`.
  std::int64_t Filter(quell::NonLocalInputs in, const quell::NonLocalParameters& p, const quell::ImageIn& target,
    const quell::ImageIn& guide, const quell::ImageOut& result, const quell::Rect& tile) const
  {
    static thread_local quell::Scratch planes, noise;
    in.target = target;
    in.guide = guide;
    in.variance = this->NoiseOf(in.depth, tile, quell::NonLocalHalo(p.radius, p.patch, p.regress), noise);
    return quell::NonLocal(in, p, result, tile, planes.Take(quell::NonLocalScratch(in, p, tile)));
  }

  quell::ImageIn Radiance, HalfA, HalfB, Variance;
  bool Halves;
};

/// Which of two bandwidths the halves ask for at each pixel of `region`: `finish(tile, candidates, narrow)` gets both
/// halves of both candidates, the narrow one first, and in the first channel of `narrow` its part.
template <class Loop, class Finish>
void SelectWidths(const Pictures& pictures, const quell::NonLocalInputs& in, const quell::NonLocalParameters& p,
  double narrowColor, const quell::Rect& region, const quell::Rect& whole, const Loop& loop, const Finish& finish)
{
  const quell::ImageIn &radiance = pictures.Radiance, &halfA = pictures.HalfA, &halfB = pictures.HalfB;
  // Two candidates where their errors are looked at, errors where the choice is, and the choice where it is smoothed.
  quell::NonLocalParameters smooth;
  smooth.radius = SmoothRadius;
  smooth.patch = SmoothPatch;
  smooth.kColor = 1;
  smooth.epsilon = p.epsilon;
  quell::NonLocalInputs plain;
  plain.depth = in.depth;
  const int reach = quell::NonLocalHalo(SmoothRadius, SmoothPatch, false);
  const quell::Rect inner = region.grown(reach).clipped(whole);
  const quell::Rect outer = region.grown(2 * reach).clipped(whole);
  quell::Scratch block;
  float* next = block.Take(std::size_t(outer.area()) * OuterFloats + std::size_t(inner.area()) * InnerFloats);
  const auto image = [&next](const quell::Rect& r)
  {
    const quell::ImageOut made(next, 3, r);
    next += r.area() * 3;
    return made;
  };
  const quell::ImageOut candidates[2][2] = { { image(outer), image(outer) }, { image(outer), image(outer) } };
  const quell::ImageOut errors = image(outer), smoothed = image(inner), choice = image(inner);
  const double widths[2] = { narrowColor, p.kColor };
  loop(
    outer,
    [&](const quell::Rect& tile)
    {
      for (int k = 0; k < 2; ++k)
      {
        quell::NonLocalParameters candidate = p;
        candidate.kColor = widths[k];
        pictures.Filter(in, candidate, halfA, halfB, candidates[k][0], tile);
        pictures.Filter(in, candidate, halfB, halfA, candidates[k][1], tile);
      }
      static thread_local quell::Scratch noise;
      const quell::ImageIn ofHalf = pictures.NoiseOf(in.depth, tile, 0, noise);
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x)
        {
          const float *a = halfA.at(x, y), *b = halfB.at(x, y);
          float* e = errors.at(x, y);
          e[2] = 0;
          for (int k = 0; k < 2; ++k)
          {
            const float *fa = candidates[k][0].at(x, y), *fb = candidates[k][1].at(x, y);
            double sum = 0;
            for (int c = 0; c < 3; ++c)
            {
              const double ba = double(b[c]) - fa[c], ab = double(a[c]) - fb[c], ff = double(fb[c]) - fa[c];
              sum += 0.5 * (ba * ba + ab * ab) - ofHalf.at(x, y)[c] - 0.25 * ff * ff;
            }
            e[k] = std::isfinite(sum) ? float(std::max(-LargestError, std::min(LargestError, sum / 3))) : 0.f;
          }
        }
    },
    0, 0.8);
  loop(
    inner,
    [&](const quell::Rect& tile)
    {
      pictures.Filter(plain, smooth, errors, radiance, smoothed, tile);
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x)
        {
          float* chosen = choice.at(x, y);
          chosen[0] = smoothed.at(x, y)[0] < smoothed.at(x, y)[1] ? 1.f : 0.f;
          chosen[1] = chosen[2] = 0;
        }
    },
    0.8, 0.9);
  loop(
    region,
    [&](const quell::Rect& tile)
    {
      static thread_local quell::Scratch results;
      const quell::ImageOut narrow(results.Take(std::size_t(tile.area()) * 3), 3, tile);
      pictures.Filter(plain, smooth, choice, radiance, narrow, tile);
      finish(tile, candidates, quell::ImageIn(narrow));
    },
    0.9, 1);
}

/// Pixels of the window are marked, three at a time, and filtered with the weights that the picture was filtered with.
quell::PixelWeights::Part MeanWeights(
  quell::NonLocalInputs in, const quell::NonLocalParameters& p, const quell::Rect& pixel)
{
  const quell::ImageIn target = in.target;
  quell::PixelWeights::Part part;
  part.Window = pixel.grown(std::max(1, p.radius)).clipped(target.extent);
  part.Weights.resize(std::size_t(part.Window.area()));
  const quell::Rect around = pixel.grown(quell::NonLocalHalo(p.radius, p.patch, p.regress)).clipped(target.extent);
  std::vector<float> values(3 * std::size_t(around.area()));
  const quell::ImageOut marks(values.data(), 3, around);
  for (int y = around.y0; y < around.y1; ++y)
    for (int x = around.x0; x < around.x1; ++x)
      std::fill_n(marks.at(x, y), 3, quell::Finite3(target.at(x, y)) ? 0.f : std::numeric_limits<float>::quiet_NaN());
  in.target = marks;
  const int width = part.Window.width();
  const auto at = [&](std::size_t i)
  { return marks.at(part.Window.x0 + int(i) % width, part.Window.y0 + int(i) / width); };
  quell::Scratch planes;
  for (std::size_t i = 0; i < part.Weights.size(); i += 3)
  {
    const std::size_t end = std::min(part.Weights.size(), i + 3);
    float result[3] = {};
    for (std::size_t k = i; k < end; ++k)
      if (quell::Finite3(at(k)))
        at(k)[k % 3] = 1;
    quell::NonLocal(in, p, quell::ImageOut(result, 3, pixel), pixel, planes.Take(quell::NonLocalScratch(in, p, pixel)));
    for (std::size_t k = i; k < end; ++k)
      if (quell::Finite3(at(k)))
      {
        part.Weights[k] = result[k % 3];
        at(k)[k % 3] = 0;
      }
  }
  return part;
}

/// Of the models of both bandwidths; `narrow` is the part of the narrow one.
quell::PixelWeights::Part ModelWeights(const quell::NonLocalInputs& in, const quell::NonLocalParameters& p,
  double narrowColor, double narrow, const quell::Rect& pixel)
{
  quell::PixelWeights::Part part;
  part.Window = pixel.grown(std::max(1, 2 * p.radius)).clipped(in.target.extent);
  part.Weights.assign(std::size_t(part.Window.area()), 0.f);
  std::vector<float> made(part.Weights.size());
  for (int k = 0; k < 2; ++k)
  {
    const double mix = k == 0 ? 1 - narrow : narrow;
    if (!(mix > 0))
      continue;
    quell::NonLocalParameters candidate = p;
    candidate.kColor = k == 0 ? p.kColor : narrowColor;
    quell::NonLocalRegressionWeights(in, candidate, pixel.x0, pixel.y0, quell::ImageOut(made.data(), 1, part.Window));
    double sum[3] = {};
    std::size_t i = 0;
    for (int y = part.Window.y0; y < part.Window.y1; ++y)
      for (int x = part.Window.x0; x < part.Window.x1; ++x, ++i)
      {
        for (int c = 0; c < 3 && made[i] != 0; ++c)
          sum[c] += double(made[i]) * double(in.target.at(x, y)[c]);
        part.Weights[i] += float(mix * double(made[i]));
      }
    for (int c = 0; c < 3; ++c)
      if (sum[c] < std::min(0., double(in.target.at(pixel.x0, pixel.y0)[c])))
        throw quell::StageError("the model is below 0 here and cut off: no weights stand for that");
  }
  return part;
}
}

void vtkQuellNonLocalFilter::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  const Pictures pictures(frame);
  const quell::ImageIn &halfA = pictures.HalfA, &halfB = pictures.HalfB;
  const quell::Rect pixel = frame.Region();
  const quell::NonLocalParameters p = this->Parameters();
  quell::NonLocalInputs in = this->Guides(frame);
  double narrow = 0;
  if (pictures.Halves && this->Selects())
    SelectWidths(
      pictures, in, p, this->KColorNarrow, pixel, frame.Whole(),
      [](const quell::Rect& rect, const auto& work, double, double) { work(rect); },
      [&](const quell::Rect&, const quell::ImageOut[2][2], const quell::ImageIn& part)
      { narrow = double(part.at(pixel.x0, pixel.y0)[0]); });
  quell::Scratch noise;
  in.variance = pictures.NoiseOf(in.depth, pixel, quell::NonLocalHalo(p.radius, p.patch, p.regress), noise);
  const auto weigh = [&](const quell::ImageIn& target, const quell::ImageIn& guide, const char* name, float share)
  {
    in.target = target;
    in.guide = guide;
    quell::PixelWeights::Part part =
      p.regress ? ModelWeights(in, p, this->KColorNarrow, narrow, pixel) : MeanWeights(in, p, pixel);
    part.Input = name;
    for (float& w : part.Weights)
      w *= share;
    weights.Parts.push_back(std::move(part));
  };
  if (!pictures.Halves)
  {
    weigh(pictures.Radiance, pictures.Radiance, "radiance", 1);
    return;
  }
  // A half that is not finite at the pixel leaves it to the other one.
  const bool a = quell::Finite3(halfA.at(pixel.x0, pixel.y0)), b = quell::Finite3(halfB.at(pixel.x0, pixel.y0));
  if (a || !b)
    weigh(halfA, halfB, "halfA", a == b ? 0.5f : 1.f);
  if (b || !a)
    weigh(halfB, halfA, "halfB", a == b ? 0.5f : 1.f);
}

void vtkQuellNonLocalFilter::Execute(quell::StageFrame& frame)
{
  const Pictures pictures(frame);
  const quell::ImageIn &radiance = pictures.Radiance, &halfA = pictures.HalfA, &halfB = pictures.HalfB;
  const quell::NonLocalInputs in = this->Guides(frame);
  const quell::NonLocalParameters p = this->Parameters();
  const quell::ImageOut out = frame.Output("radiance"), varianceOut = frame.Output("variance");
  const quell::Rect region = frame.Region();
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  const auto store = [&](const quell::ImageIn& a, const quell::ImageIn& b, const quell::Rect& tile)
  {
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        const float *u = a.at(x, y), *v = b.at(x, y);
        // A half that is not finite here is only what its neighbours say; the other one knows more.
        const bool knowsA = quell::Finite3(halfA.at(x, y)), knowsB = quell::Finite3(halfB.at(x, y));
        if (knowsA != knowsB)
          (knowsA ? v : u) = knowsA ? u : v;
        double difference[3];
        for (int c = 0; c < 3; ++c)
        {
          difference[c] = 0.5 * (double(u[c]) - v[c]);
          if (out)
            out.at(x, y)[c] = float(0.5 * (double(u[c]) + v[c]));
        }
        if (varianceOut)
        {
          const double l = 0.2126 * difference[0] + 0.7152 * difference[1] + 0.0722 * difference[2];
          *varianceOut.at(x, y) = float(std::min(1e38, l * l));
        }
      }
  };
  const std::int64_t side = 2 * this->Radius + 1;
  this->Counters.Taps +=
    region.area() * side * side * (pictures.Halves ? 2 : 1) * (this->Selects() && pictures.Halves ? 2 : 1);

  if (!pictures.Halves)
    this->ForEachTile(region, TileSize,
      this->NonFinite.Counting(
        [&](const quell::Rect& tile)
        {
          static thread_local quell::Scratch spare;
          return pictures.Filter(in, p, radiance, radiance,
            out ? out : quell::ImageOut(spare.Take(std::size_t(tile.area()) * 3), 3, tile), tile);
        }));
  else if (!this->Selects())
    this->ForEachTile(region, TileSize,
      this->NonFinite.Counting(
        [&](const quell::Rect& tile)
        {
          static thread_local quell::Scratch results;
          const quell::ImageOut a(results.Take(std::size_t(tile.area()) * 6), 3, tile);
          const quell::ImageOut b(a.data + tile.area() * 3, 3, tile);
          const std::int64_t bad =
            pictures.Filter(in, p, halfA, halfB, a, tile) + pictures.Filter(in, p, halfB, halfA, b, tile);
          store(a, b, tile);
          return bad;
        }));
  else
  {
    SelectWidths(
      pictures, in, p, this->KColorNarrow, region, frame.Whole(),
      [&](const quell::Rect& rect, const auto& work, double from, double to)
      { this->ForEachTile(rect, TileSize, work, from, to); },
      [&](const quell::Rect& tile, const quell::ImageOut candidates[2][2], const quell::ImageIn& narrow)
      {
        for (int y = tile.y0; y < tile.y1; ++y)
          for (int x = tile.x0; x < tile.x1; ++x)
          {
            this->NonFinite.Add({ x, y, x + 1, y + 1 }, !quell::Finite3(halfA.at(x, y)));
            this->NonFinite.Add({ x, y, x + 1, y + 1 }, !quell::Finite3(halfB.at(x, y)));
            this->NonFinite.Add({ x, y, x + 1, y + 1 }, !quell::Finite3(radiance.at(x, y)));
            for (int half = 0; half < 2; ++half)
              for (int c = 0; c < 3; ++c)
              {
                float& wide = candidates[1][half].at(x, y)[c];
                wide += narrow.at(x, y)[0] * (candidates[0][half].at(x, y)[c] - wide);
              }
          }
        store(candidates[1][0], candidates[1][1], tile);
      });
  }
  this->NonFinite.Report(
    this->Counters, this->Warnings, this->CountedWarning, pictures.Halves ? "the halves" : "radiance");
}
