// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellIntegrator_h
#define quellIntegrator_h

#include "quellCamera.h"
#include "quellEmbreeScene.h"
#include "quellFilm.h"
#include "quellPixelFilter.h"
#include "quellSampler.h"
#include "quellWavefront.h"
#include "vtkQuellRayTracingModule.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace quell
{
struct TraceCounters
{
  std::int64_t Rays = 0, Paths = 0, NonFinite = 0; ///< NonFinite: samples dropped
  std::vector<RecordedRay>* Record = nullptr;      ///< where rays are recorded, for measurements
};

/// Unidirectional path tracing: at every vertex one light sample and one BSDF sample, combined by the power heuristic;
/// Russian roulette by throughput. MaximumBounces n counts scatterings of all kinds: 0 is emission only, 1 direct
/// light, 2 one indirect bounce. A contribution belongs to the layer of its number of non-delta scatterings: none
/// emission, one direct, more indirect.
///
/// Light samples pass thin smooth walls of glass (Surface::IsPane) straight and lose what those hold back; each counts
/// as a scattering, so that the path that samples the glass itself, which is combined with them, is of the same number.
/// More than EmbreeScene::PanesMet::Most in a row block them.
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
  int MaximumBounces = 6;
  int RouletteStart = 3; ///< scatterings before Russian roulette; above MaximumBounces: none
  std::uint64_t Seed = 0;
  SamplePattern Pattern = SamplePattern::Sobol;
  int Tick = 0, SamplesPerPixel = 1, FirstSample = 0;
  int SamplesPerTick = 0; ///< of the sequence, from one tick to the next; 0: SamplesPerPixel
  float SampleClamp = 0;  ///< longest RGB length of a sample's direct and of its indirect layer; 0: no clamp
  Jitter PixelJitter = Jitter::PerSample;
  PixelFilter Filter;   ///< density of the samples around the pixel's centre, with Jitter::PerSample
  bool Shutter = false; ///< the shutter is open for more than a moment: rays have times in [0, 1)
  Strategy Sampling = Strategy::Mis;
  /// Camera rays per pixel that make the guides alone (albedos, normal, roughness and the variances of them) in place
  /// of the light samples: cheap, since they end at the guide vertex, and so clean guides of textures, edges and blur
  /// with one light sample. Their random numbers are independent of those of the light. 0: light samples make them.
  int GuideSamples = 0;

  /// The integrator is compiled once for each of these; all make the same bits where they are allowed.
  enum class Variant
  {
    Auto,    ///< the leanest that the scene allows
    Diffuse, ///< every surface is Lambert's and opaque: everything in vectors
    Opaque,  ///< no glass, no clearcoat, nothing see-through
    General, ///< glass and clearcoats one by one, everything else in vectors
    OneByOne ///< what the others are compared with: every vertex by itself
  };
  Variant Force = Variant::Auto; ///< for tests and measurements; must be allowed

  /// Stack that Render needs for its paths, whatever is traced.
  static std::size_t ScratchBytes() noexcept;
  /// The variant that Render uses.
  Variant Chosen() const noexcept;
  /// Which variant it is and why, and what `film` spares, a line each.
  std::vector<std::string> ExplainVariant(const Film& film) const;

  /// Samples [first, first + count) of the pixels of `part` into `film`, whose wants decide what is traced. The samples
  /// of a pixel must come in order, without gaps, from 0; guide samples are made together with the first. Thread-safe
  /// for parts that do not overlap. Best with a few hundred samples a call; needs some 300 KB of stack.
  void Render(Film& film, const Rect& part, int first, int count, TraceCounters& counters) const noexcept;

private:
  struct Batch;
  template <Variant>
  void Run(Batch& batch) const noexcept;
  void Primary(Batch& batch) const noexcept;
  void DrawRandom(Batch& batch, std::uint32_t pair, int slot) const noexcept;
  void DrawBounce(Batch& batch, int depth, SamplePair pair) const noexcept;
  void Sky(Batch& batch, int row) const noexcept;
  void Emit(Batch& batch, int row, const SurfaceHit& hit, const Vec3f& emission, const Vec3f& unlit) const noexcept;
  bool Scatter(Batch& batch, int row, int depth) const noexcept;
  void DrawLights(Batch& batch) const noexcept;
  void DiffuseVertices(Batch& batch, int depth) const noexcept;
  void OpaqueVertices(Batch& batch, int depth) const noexcept;
  void GeneralVertices(Batch& batch, int depth) const noexcept;
};
}

#endif
