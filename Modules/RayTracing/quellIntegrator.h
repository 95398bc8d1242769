// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellIntegrator_h
#define quellIntegrator_h

#include "quellCamera.h"
#include "quellEmbreeScene.h"
#include "quellSampler.h"
#include "vtkQuellRayTracingModule.h"

#include <cstdint>

namespace quell
{
/// Which parts of a pixel are wanted; what is not wanted is not traced. The wanted parts have the same bits whatever
/// else is wanted.
struct PixelWants
{
  bool Emission = false, Direct = false, Indirect = false; ///< the layers of radiance
  bool Primary = false;                                    ///< depth, position, geometric normal, motion, ids, alpha
  bool Motion = false;
  bool Guides = false; ///< albedo, normal, roughness
  bool HitDistance = false;
};

/// Sums and statistics over the samples of one pixel.
struct PixelResult
{
  int Samples = 0, Hits = 0;
  Vec3d Emission, Direct, Indirect; ///< sums over samples
  Vec3d HalfA, HalfB;               ///< sums of radiance over even and odd samples
  double MeanLuminance = 0,
         SquareLuminance = 0; ///< Welford: mean and summed squared deviation of the sample's luminance
  Vec3d Albedo, Normal;
  double Roughness = 0;
  double Depth = 0; ///< sums over the samples that hit something
  Vec3d Position, NormalGeometric;
  Vec2<double> Motion, SkyMotion;
  double HitDistance = 0;
  int HitDistances = 0;
  int Id = 0, Material = 0; ///< of the first sample that hit something
};

struct TraceCounters
{
  std::int64_t Rays = 0, Paths = 0, NonFinite = 0, Lit = 0; ///< Lit: pixels above 0.001
};

/// Unidirectional path tracing: at every vertex one light sample and one BSDF sample, combined by the power heuristic;
/// Russian roulette by throughput. MaximumBounces n counts scatterings of all kinds: 0 is emission only, 1 direct
/// light, 2 one indirect bounce. A contribution belongs to the layer of its number of non-delta scatterings: none
/// emission, one direct, more indirect.
class VTKQUELLRAYTRACING_EXPORT Integrator
{
public:
  enum class Jitter
  {
    PerSample, ///< anywhere in the pixel's box
    PerFrame,  ///< one Halton(2, 3) - 1/2 offset for the whole frame
    None       ///< pixel centres
  };
  enum class Strategy
  {
    Mis,
    LightOnly,
    BsdfOnly
  };

  const EmbreeScene* Scene = nullptr;
  Camera View, PreviousView;
  PixelWants Wants;
  int MaximumBounces = 6;
  int RouletteStart = 3; ///< scatterings before Russian roulette; above MaximumBounces: none
  std::uint64_t Seed = 0;
  int Tick = 0, SamplesPerPixel = 1, FirstSample = 0;
  float SampleClamp = 0; ///< longest RGB length of a sample's direct and of its indirect layer; 0: no clamp
  Jitter PixelJitter = Jitter::PerSample;
  Strategy Sampling = Strategy::Mis;

  /// All samples of pixel (x, y) of the whole frame; thread-safe.
  void Pixel(int x, int y, PixelResult& result, TraceCounters& counters) const noexcept;

private:
  struct Layers
  {
    Vec3f Of[3];
  };
  void TracePath(const PixelSampler& random, double px, double py, EmbreeScene::Context& context, Layers& layers,
    PixelResult& result, TraceCounters& counters) const noexcept;
};
}

#endif
