// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellBilateralFilter.h"

#include "quellBilateral.h"
#include "quellCarriedArrays.h"
#include "quellGuideVariances.h"
#include "quellWeighByMarks.h"
#include "vtkObjectFactory.h"

#include <cctype>
#include <cmath>

vtkStandardNewMacro(vtkQuellBilateralFilter);
QUELL_STAGE_DESCRIPTION(vtkQuellBilateralFilter)

namespace
{
enum Ports
{
  Radiance,
  Depth,
  Normal,
  Albedo,
  Position,
  Id,
  Guide,
  GuideVariance
};
constexpr int LargestRadius = 64, TileSize = 96;

const std::vector<std::string> distances = { "Euclidean", "Color", "Normal", "Plane", "LogDepth", "Id" };

quell::ArrayKind KindOf(const std::string& array)
{
  const quell::ArrayType* type = quell::FindArray(array);
  return type ? type->Kind : quell::ArrayKind::Any;
}

quell::GuideDistance UsualDistance(const std::string& array)
{
  switch (KindOf(array))
  {
    case quell::ArrayKind::Color:
      return quell::GuideDistance::Color;
    case quell::ArrayKind::Normal:
      return quell::GuideDistance::Normal;
    case quell::ArrayKind::Position:
      return quell::GuideDistance::Plane;
    case quell::ArrayKind::Depth:
      return quell::GuideDistance::LogDepth;
    case quell::ArrayKind::Id:
      return quell::GuideDistance::Id;
    default:
      return quell::GuideDistance::Euclidean;
  }
}

double UsualSigma(quell::GuideDistance distance)
{
  switch (distance)
  {
    case quell::GuideDistance::Color:
      return 0.5;
    case quell::GuideDistance::Normal:
      return 0.2;
    case quell::GuideDistance::Plane:
    case quell::GuideDistance::LogDepth:
      return 0.05;
    default:
      return 0.1;
  }
}

std::string Lower(std::string text)
{
  for (char& c : text)
    c = char(std::tolower((unsigned char)c));
  return text;
}
}

void vtkQuellBilateralFilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellBilateralFilter;
  d.Category = "Denoising";
  d.Brief = "Bilateral filter; with guides a cross-bilateral filter.";
  d.Details =
    "`w = exp(-(|q-p|^2 / 2 ss^2 + |R(q)-R(p)|^2 / 2 sr^2 + |n(q)-n(p)|^2 / 2 sn^2 + |a(q)-a(p)|^2 / 2 sa^2 + D^2 / 2 "
    "sd^2))` "
    "over the square of `Radius`, with the colour R in the space `Range` and D the relative depth difference or, with "
    "positions and normals, the distance from the centre's tangent plane relative to depth. A sigma of 0 lets only "
    "equal "
    "values pass; 1e30 removes its term. Taps outside the image, not finite, of another id or without a hit have "
    "weight 0; a "
    "non-finite pixel becomes the weighted mean of its neighbours; background passes through.\n\n"
    "Every connection of `guide` adds a feature of its own: `distance=\"Euclidean | Color | Normal | Plane | LogDepth "
    "| "
    "Id\"` (default: what suits the array), `sigma` (default 0.1, 0.5, 0.2, 0.05, 0.05) and `name`. A `guideVariance` "
    "with `guide=\"name\"` says how noisy that feature is: its term becomes `max(0, d^2 - (V(p) + min(V(p), V(q)))) / "
    "(2 max(sigma^2, V(p)))`, V summed over the components. Arrays named in `Arrays` take the colour's weights. "
    "Sources: Tomasi and Manduchi 1998; Petschnigg et al. 2004; Eisemann and Durand 2004; Rousselle et al. 2013.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "what is filtered; illumination rather than radiance");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide");
  d.OptionalInput("albedo", quell::ArrayKind::Albedo, "albedo", "guide");
  d.OptionalInput("position", quell::ArrayKind::Position, "position",
    "with depth and normal: compares by plane distance instead of depth");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.RepeatableInput("guide", quell::ArrayKind::Any, "albedo", "a further feature")
    .Attribute("distance", "how its values are compared; default: what suits the array", distances)
    .Attribute("sigma", "standard deviation of that distance; default 0.1, 0.5, 0.2, 0.05, 0.05 or 0.1")
    .Attribute("name", "by which a guideVariance calls it; default: the array's name");
  d.RepeatableInput("guideVariance", quell::ArrayKind::Any, "varianceAlbedo",
     "variance of a guide's mean value (1 component: averaged over its components)")
    .Attribute("guide", "name of the guide that it belongs to");
  d.Inputs[Guide].Optional = d.Inputs[GuideVariance].Optional = true;
  d.Output("radiance", quell::ArrayKind::Color, "the filtered input").Mean({ "radiance" });
  QUELL_INT(d, Radius, "pixels", "half the window's side; -1: ceil(3 SigmaSpatial), at most 64; 0: identity");
  QUELL_DOUBLE(d, SigmaSpatial, "pixels", "standard deviation in distance; 0: identity");
  QUELL_DOUBLE(d, SigmaRange, "", "standard deviation in colour, in the units of Range");
  QUELL_ENUM(d, Range, "what colours are compared in, c = radiance / White: c, c / (1 + luminance), log(1 + c)",
    "Linear", "ToneMapped", "Log");
  QUELL_DOUBLE(d, White, "", "radiance that is white; a frame k times as bright is filtered alike with k times this");
  QUELL_DOUBLE(d, SigmaNormal, "", "standard deviation of the length of the difference of normals");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of depth or plane distance, relative to depth");
  QUELL_DOUBLE(d, SigmaAlbedo, "", "standard deviation of the albedo difference");
  QUELL_STRING(d, Arrays, "further arrays of the first input that take the colour's weights, by blanks: alpha");
}

vtkQuellBilateralFilter::vtkQuellBilateralFilter()
{
  this->InitializePorts();
}

int vtkQuellBilateralFilter::EffectiveRadius() const
{
  if (this->Radius >= 0)
    return this->Radius;
  return int(std::min(double(LargestRadius), std::ceil(3 * this->SigmaSpatial)));
}

void vtkQuellBilateralFilter::SetArrays(const std::string& names)
{
  if (names == this->Arrays)
    return;
  this->Arrays = names;
  this->Modified();
}

bool vtkQuellBilateralFilter::SetInputAttribute(
  int port, int connection, const std::string& name, const std::string& value, std::string& error)
{
  GuideSettings now = this->Settings[{ port, connection }];
  if ((port == Guide && name == "name") || (port == GuideVariance && name == "guide"))
    now.Name = value;
  else if (port == Guide && name == "sigma")
  {
    if (!quell::detail::ParseDouble(value, 0, 1e30, now.Sigma, error))
    {
      error = "sigma = " + error;
      return false;
    }
  }
  else if (port == Guide && name == "distance")
  {
    now.Distance = -1;
    for (std::size_t k = 0; k < distances.size(); ++k)
      if (Lower(distances[k]) == Lower(value))
        now.Distance = int(k);
    if (now.Distance < 0)
    {
      error = "distance = \"" + value + "\" is none of";
      for (const std::string& d : distances)
        error += (d == distances.front() ? " " : ", ") + d;
      return false;
    }
  }
  else
    return this->vtkQuellStage::SetInputAttribute(port, connection, name, value, error);
  GuideSettings& old = this->Settings[{ port, connection }];
  if (old.Name != now.Name || old.Sigma != now.Sigma || old.Distance != now.Distance)
  {
    old = now;
    this->Modified();
  }
  return true;
}

bool vtkQuellBilateralFilter::Makes(const std::string& array) const
{
  return this->vtkQuellStage::Makes(array) || quell::IsCarriedArray(this->Arrays, array);
}

void vtkQuellBilateralFilter::CheckSettings()
{
  for (const std::string& name : quell::CarriedArrays(this->Arrays))
    if (KindOf(name) == quell::ArrayKind::Id || KindOf(name) == quell::ArrayKind::Moments ||
        KindOf(name) == quell::ArrayKind::Depth)
      throw quell::StageError("Arrays: \"" + name + "\" has no weighted mean (" + quell::KindDoc(KindOf(name)) + ")");
}

int vtkQuellBilateralFilter::HaloFor(int) const
{
  // A non-finite pixel is filled from its neighbours; so is a carried value, which may be a tap.
  return quell::CarriedArrays(this->Arrays).empty() ? std::max(1, this->EffectiveRadius())
                                                    : this->EffectiveRadius() + 1;
}

double vtkQuellBilateralFilter::CostPerPixel() const
{
  const double side = 2 * this->EffectiveRadius() + 1;
  return 0.1 + side * side / 121;
}

vtkQuellBilateralFilter::GuideSettings vtkQuellBilateralFilter::SettingsOf(int port, int connection) const
{
  const auto found = this->Settings.find({ port, connection });
  return found == this->Settings.end() ? GuideSettings() : found->second;
}

int vtkQuellBilateralFilter::DistanceOf(int connection, const std::string& array, bool normals) const
{
  const GuideSettings settings = this->SettingsOf(Guide, connection);
  if (settings.Distance >= 0)
    return settings.Distance;
  const quell::GuideDistance usual = UsualDistance(array);
  return int(usual == quell::GuideDistance::Plane && !normals ? quell::GuideDistance::Euclidean : usual);
}

void vtkQuellBilateralFilter::CheckConnections(quell::ConnectionCheck& check) const
{
  quell::CheckCarriedArrays(check, this->Arrays, quell::BilateralInputs::MostCarriedComponents, true);
  check.WantAtMost(Guide, quell::BilateralInputs::MostGuides);
  std::vector<std::string> names, wanted;
  for (int c = 0; c < check.Count(Guide); ++c)
  {
    names.push_back(this->GuideName(c, check.At(Guide, c).Array));
    this->CheckGuide(check, c);
  }
  for (int c = 0; c < check.Count(GuideVariance); ++c)
    wanted.push_back(this->SettingsOf(GuideVariance, c).Name);
  const std::vector<int> of = quell::CheckGuideVariances(check, Guide, names, GuideVariance, wanted);
  for (int c = 0; c < check.Count(GuideVariance); ++c)
  {
    const int guide = of[std::size_t(c)];
    const int distance = guide < 0 ? 0 : this->DistanceOf(guide, check.At(Guide, guide).Array, check.Count(Normal) > 0);
    if (distance >= int(quell::GuideDistance::Plane))
      check.Error(GuideVariance, c,
        "guide \"" + names[std::size_t(guide)] + "\" is compared by distance " + distances[std::size_t(distance)] +
          ", which takes no variance",
        "distances that do: Euclidean, Color, Normal");
  }
}

void vtkQuellBilateralFilter::CheckGuide(quell::ConnectionCheck& check, int c) const
{
  const quell::ConnectionCheck::Connection& guide = check.At(Guide, c);
  const int n = guide.Components;
  const auto distance = quell::GuideDistance(this->DistanceOf(c, guide.Array, check.Count(Normal) > 0));
  const std::string& name = distances[std::size_t(distance)];
  const bool vector = distance == quell::GuideDistance::Color || distance == quell::GuideDistance::Normal ||
                      distance == quell::GuideDistance::Plane;
  const std::string has = "\"" + guide.Array + "\" has " + std::to_string(n) + (n == 1 ? " component" : " components");
  if (n > 3)
    check.Error(Guide, c, has + ", a guide may have 3");
  else if (n > 0 && ((vector && n != 3) || (distance == quell::GuideDistance::LogDepth && n != 1)))
    check.Error(Guide, c, has + ", distance " + name + " compares " + (vector ? "3" : "1"),
      n == 1   ? "for one component there are Euclidean, LogDepth and Id"
      : n == 3 ? "for three components there are Euclidean, Color, Normal and Plane"
               : "distance=\"Euclidean\" takes any up to 3");
  else if (distance == quell::GuideDistance::Plane && check.Count(Normal) == 0)
    check.Error(Guide, c, "distance Plane needs input \"normal\"", "connect it, or say distance=\"Euclidean\"");
}

std::string vtkQuellBilateralFilter::GuideName(int connection, const std::string& array) const
{
  const std::string own = this->SettingsOf(Guide, connection).Name;
  return own.empty() ? array : own;
}

double vtkQuellBilateralFilter::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  // Colour and what is carried, validity, the named guides, plane distance, further guides with their variances.
  const int planes =
    3 + quell::BilateralInputs::MostCarriedComponents + 1 + 8 + 7 + 6 * this->GetNumberOfInputConnections(Guide) + 1;
  const int radius = this->EffectiveRadius(), side = 2 * radius + 1;
  // Weights that serve two pixels are kept for some rows.
  const bool shared = radius <= quell::BilateralParameters::MostSharedRadius;
  return quell::TileScratchBytes(TileSize, TileSize, radius, planes) +
         (shared ? quell::TileScratchBytes(TileSize, radius + 1, 0, 0.5 * side * side) : 0.);
}

void vtkQuellBilateralFilter::Gather(
  quell::StageFrame& frame, quell::BilateralInputs& in, quell::BilateralParameters& p) const
{
  in.radiance = frame.Input(Radiance);
  in.depth = frame.Input(Depth);
  in.normal = frame.Input(Normal);
  in.albedo = frame.Input(Albedo);
  in.position = frame.Input(Position);
  in.id = frame.Input(Id);
  std::vector<std::string> names;
  for (int c = 0; c < frame.Connections(Guide); ++c) // a delayed one without history is none
  {
    names.push_back(this->GuideName(c, this->GetInputArray(Guide, c)));
    quell::BilateralGuide& g = in.guides[in.guideCount++];
    g.value = frame.Input(Guide, c);
    g.distance = quell::GuideDistance(this->DistanceOf(c, this->GetInputArray(Guide, c), bool(in.normal)));
    const double sigma = this->SettingsOf(Guide, c).Sigma;
    g.sigma = sigma < 0 ? UsualSigma(g.distance) : sigma;
  }
  for (int c = 0; c < frame.Connections(GuideVariance); ++c)
  {
    const int guide =
      quell::GuideOfVariance(names, this->SettingsOf(GuideVariance, c).Name, this->GetInputArray(GuideVariance, c));
    if (guide >= 0)
      in.guides[guide].variance = frame.Input(GuideVariance, c);
  }
  p.radius = this->EffectiveRadius();
  p.sigmaSpatial = this->SigmaSpatial;
  p.sigmaRange = this->SigmaRange;
  p.range = quell::RangeSpace(this->Range);
  p.white = this->White;
  p.sigmaNormal = this->SigmaNormal;
  p.sigmaDepth = this->SigmaDepth;
  p.sigmaAlbedo = this->SigmaAlbedo;
}

void vtkQuellBilateralFilter::Execute(quell::StageFrame& frame)
{
  this->CheckSettings();
  quell::BilateralInputs in;
  quell::BilateralParameters p;
  this->Gather(frame, in, p);
  quell::BilateralOutputs out;
  out.radiance = frame.Output("radiance");
  int components = 0;
  for (const std::string& name : quell::CarriedArrays(this->Arrays))
  {
    if (!frame.Wants(name))
      continue;
    const quell::ImageIn image = frame.InputArray(Radiance, 0, name);
    components += image.components;
    if (components > quell::BilateralInputs::MostCarriedComponents)
      throw quell::StageError(
        "Arrays: more than " + std::to_string(quell::BilateralInputs::MostCarriedComponents) + " components together");
    in.carried[in.carriedCount] = image;
    out.carried[in.carriedCount++] = frame.AddOutput(name, image.components);
  }

  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->ForEachTile(frame.Region(), TileSize,
    this->NonFinite.Counting(
      [&](const quell::Rect& tile)
      {
        static thread_local quell::Scratch scratch;
        return quell::Bilateral(in, p, out, tile, scratch.Take(quell::BilateralScratch(in, p, tile)));
      }));
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "radiance");
  const std::int64_t side = 2 * this->EffectiveRadius() + 1;
  this->Counters.Taps += frame.Region().area() * side * side;
}

void vtkQuellBilateralFilter::Weigh(quell::StageFrame& frame, quell::PixelWeights& weights)
{
  quell::BilateralInputs in;
  quell::BilateralParameters p;
  this->Gather(frame, in, p);
  const quell::Rect pixel = frame.Region();
  // Carried values take the colour's weights.
  float color[3];
  in.carriedCount = 1;
  quell::BilateralOutputs out;
  out.radiance = quell::ImageOut(color, 3, pixel);
  quell::Scratch scratch;
  quell::WeighByMarks(weights, "radiance", in.radiance, pixel.grown(p.radius), 1,
    [&](const quell::ImageIn& marks, const quell::ImageOut& result)
    {
      in.carried[0] = marks;
      out.carried[0] = result;
      quell::Bilateral(in, p, out, pixel, scratch.Take(quell::BilateralScratch(in, p, pixel)));
    });
}
