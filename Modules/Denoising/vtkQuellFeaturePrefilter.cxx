// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellFeaturePrefilter.h"

#include "quellBilateral.h"
#include "quellFeatureNoise.h"
#include "vtkObjectFactory.h"

#include <cmath>

vtkStandardNewMacro(vtkQuellFeaturePrefilter);
QUELL_STAGE_DESCRIPTION(vtkQuellFeaturePrefilter)

namespace
{
enum Ports
{
  Albedo,
  Normal,
  Depth,
  Position,
  Id,
  VarianceAlbedo,
  VarianceNormal
};
constexpr int TileSize = 64, NoiseReach = 2;
}

void vtkQuellFeaturePrefilter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellFeaturePrefilter;
  d.Category = "Denoising";
  d.Brief = "Takes the noise out of albedo and normals, along the surface, before they demodulate and guide.";
  d.Details =
    "A bilateral mean over the square of `Radius`, by normal (for the albedo), plane distance relative to depth "
    "(without positions: relative depth), id and the feature itself, `exp(-max(0, |f(q) - f(p)|^2 - (V(p) + min(V(p), "
    "V(q)))) / 2 max(SigmaFeature^2, V(p)))`: what the variance V of the feature's noise explains is no edge, textures "
    "and creases beyond it stay. A variance that is not connected is estimated from the medians of squared differences "
    "of neighbours; a texture finer than three pixels is then taken for noise. Constants and pixels without a hit "
    "stay; a "
    "feature that is not finite becomes the mean of its neighbours. Source: Rousselle et al. 2013.";
  d.Input("albedo", quell::ArrayKind::Albedo, "albedo", "noisy reflectance");
  d.OptionalInput("normal", quell::ArrayKind::Normal, "normal", "guide of the albedo, and filtered itself");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "guide");
  d.OptionalInput("position", quell::ArrayKind::Position, "position",
    "with depth and normal: compares by plane distance instead of depth");
  d.OptionalInput("id", quell::ArrayKind::Id, "id", "never mixes pixels of different ids");
  d.OptionalInput("varianceAlbedo", quell::ArrayKind::Any, "varianceAlbedo",
    "of the pixel's mean albedo: per component or averaged; else estimated");
  d.OptionalInput("varianceNormal", quell::ArrayKind::Any, "varianceNormal",
    "of the pixel's mean normal: per component or averaged; else estimated");
  d.Output("albedo", quell::ArrayKind::Albedo, "the filtered albedo").Mean({ "albedo" });
  d.Output("normal", quell::ArrayKind::Normal, "the filtered normal; 0 without input normal").AtMost(1, { "normal" });
  QUELL_INT(d, Radius, "pixels", "half the window's side; 0: identity");
  QUELL_DOUBLE(d, SigmaFeature, "", "difference of a feature without noise that counts as an edge; 1e30: none does");
  QUELL_DOUBLE(d, SigmaNormal, "", "standard deviation of the length of the difference of normals, for the albedo");
  QUELL_DOUBLE(d, SigmaDepth, "", "standard deviation of plane distance or depth, relative to depth");
  QUELL_BOOL(d, EstimateNoise, "estimate the variance that is not connected; off: such a feature is free of noise");
}

vtkQuellFeaturePrefilter::vtkQuellFeaturePrefilter()
{
  this->InitializePorts();
}

int vtkQuellFeaturePrefilter::HaloFor(int) const
{
  return std::max(1, this->Radius) + NoiseReach;
}

void vtkQuellFeaturePrefilter::CheckConnections(quell::ConnectionCheck& check) const
{
  for (int port : { VarianceAlbedo, VarianceNormal })
    if (check.Count(port) > 0)
      check.WantComponents(port, 0, { 1, 3 });
}

double vtkQuellFeaturePrefilter::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  // The noise and its differences; colour, up to four guides with a variance, plane distance.
  return quell::TileScratchBytes(TileSize, TileSize, this->HaloFor(0), 6 + 4 + 4 * 4 + 7);
}

void vtkQuellFeaturePrefilter::Execute(quell::StageFrame& frame)
{
  const quell::ImageIn albedo = frame.Input(Albedo), normal = frame.Input(Normal), depth = frame.Input(Depth);
  const quell::ImageIn position = frame.Input(Position), id = frame.Input(Id);
  struct Feature
  {
    quell::ImageIn value, variance;
    quell::ImageOut out;
    bool isNormal;
  };
  Feature features[2] = { { albedo, frame.Input(VarianceAlbedo), frame.Output("albedo"), false },
    { normal, frame.Input(VarianceNormal), frame.Output("normal"), true } };
  if (features[1].out && !normal)
    this->Warnings.push_back("output normal is 0 because input normal is not connected");

  quell::BilateralParameters p;
  p.radius = this->Radius;
  p.sigmaSpatial = p.sigmaRange = 1e30;
  p.sigmaAlbedo = 1e30;
  p.sigmaNormal = 1e30;
  p.sigmaDepth = this->SigmaDepth;
  this->NonFinite.Begin(frame.Region(), frame.Tick());
  this->ForEachTile(frame.Region(), TileSize,
    this->NonFinite.Counting(
      [&](const quell::Rect& tile)
      {
        static thread_local quell::Scratch noise, planes;
        std::int64_t bad = 0;
        for (const Feature& f : features)
        {
          if (!f.out || !f.value)
            continue;
          quell::BilateralInputs in;
          in.radiance = f.value;
          in.depth = depth;
          in.position = position;
          in.normal = normal;
          in.id = id;
          const auto add = [&in](const quell::ImageIn& value, double sigma) -> quell::BilateralGuide&
          {
            quell::BilateralGuide& g = in.guides[in.guideCount++];
            g.value = value;
            g.sigma = sigma;
            return g;
          };
          quell::BilateralGuide& self = add(f.value, this->SigmaFeature);
          self.variance = f.variance;
          if (!f.variance && this->EstimateNoise)
          {
            const quell::Rect grown = tile.grown(std::max(1, this->Radius)).clipped(f.value.extent);
            const quell::ImageOut estimate(
              noise.Take(std::size_t(grown.area()) + quell::FeatureNoiseScratch(grown)), 1, grown);
            // Normals are no guide to their own noise.
            quell::FeatureNoise(
              f.value, f.isNormal ? quell::ImageIn() : normal, depth, estimate, grown, estimate.data + grown.area());
            self.variance = estimate;
          }
          if (normal && !f.isNormal)
            add(normal, this->SigmaNormal).distance = quell::GuideDistance::Normal;
          bad += quell::Bilateral(in, p, { f.out, {} }, tile, planes.Take(quell::BilateralScratch(in, p, tile)));
          if (!f.isNormal)
            continue;
          for (int y = tile.y0; y < tile.y1; ++y)
            for (int x = tile.x0; x < tile.x1; ++x)
            {
              float* n = f.out.at(x, y);
              const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
              // What had length 1 stays to the last bit.
              if (std::fabs(length - 1) > 1e-6f)
                for (int c = 0; c < 3; ++c)
                  n[c] = length > 1e-6f && length < 1e30f ? n[c] / length : 0.f;
            }
        }
        return bad;
      }));
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "the features");
  const std::int64_t side = 2 * this->Radius + 1;
  this->Counters.Taps += frame.Region().area() * side * side * (bool(features[0].out) + bool(features[1].out));
}
