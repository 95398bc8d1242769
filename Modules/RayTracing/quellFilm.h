// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFilm_h
#define quellFilm_h

#include "quellImageView.h"
#include "quellMemoryLimits.h"
#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <cstddef>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace quell
{
struct SurfacePoint;

/// What one camera path gathered.
struct PathSample
{
  static constexpr int MaximumBounceLayers = 64;

  Vec3f Emission;                       ///< light after no non-delta scattering
  Vec3f Direct, Indirect;               ///< after one, after more
  Vec3f DirectDiffuse, IndirectDiffuse; ///< the part of them that the diffuse lobe of the first non-delta vertex made
  Vec3f* Bounces = nullptr;             ///< [n - 1]: light after n non-delta scatterings; length Film::BounceLayers()
  float HitDistance = -1;               ///< of the first segment after the first non-delta scattering; -1: none
  /// As if it had met nothing; guides and primary hit stay.
  void Darken() noexcept
  {
    Emission = Direct = Indirect = DirectDiffuse = IndirectDiffuse = Vec3f();
    Bounces = nullptr;
    HitDistance = -1;
  }

  /// Guides, at the first vertex that is not a perfect mirror or clear glass.
  Vec3f AlbedoDiffuse{ 1, 1, 1 }, AlbedoSpecular, Albedo{ 1, 1, 1 }, Normal;
  float Roughness = 0;
  /// Takes the guides of a vertex seen under a cosine with its shading normal.
  void Guide(const SurfacePoint& point, float cosine) noexcept;

  /// The primary hit.
  bool Hit = false;
  int Id = 0, Material = 0;
  double Depth = 0;
  Vec3d Position, NormalGeometric;
  Vec2<double> Motion; ///< of the hit, of the sky where nothing was hit
};

/// Sums over the samples of every pixel of a region, of what is wanted and nothing else, in double and in the order of
/// the samples: a picture has the same bits however its samples were divided into passes. Memory per pixel is
/// 8 bytes for each number that has to be kept (24 for radiance alone).
class VTKQUELLRAYTRACING_EXPORT Film
{
public:
  Film() = default;
  /// `arrays`: names as in the stage's table ("radiance", "albedo", "bounce2", ...); unknown names throw
  /// std::invalid_argument.
  /// `memory`: of a film of as many numbers, to be used again: new memory has to be cleared by the system first. Then
  /// the sums are anything until Clear.
  Film(const Rect& region, const std::set<std::string>& arrays, std::vector<double> memory = {});

  /// Offsets of the sums in a pixel's record, -1: not kept.
  struct Slots
  {
    int Radiance = -1, Emission = -1, Direct = -1, Indirect = -1, DirectDiffuse = -1, IndirectDiffuse = -1;
    int Bounces = -1; ///< BounceLayers() triples
    int HalfA = -1, HalfB = -1;
    int Luminance = -1; ///< mean, sum of squared deviations (Welford)
    int Albedo = -1, AlbedoDiffuse = -1, AlbedoSpecular = -1, Normal = -1, Roughness = -1;
    int AlbedoSpread = -1, NormalSpread = -1; ///< mean and sum of squared deviations of a triple: 4 numbers
    int Hits = -1, Depth = -1, Position = -1, NormalGeometric = -1, Motion = -1, Id = -1, Material = -1;
    int HitDistance = -1; ///< sum and count
  };
  const Slots& At() const { return this->Offsets; }

  bool WantsLight() const; ///< any layer of radiance
  bool WantsEmission() const { return this->Lights[0]; }
  bool WantsDirect() const { return this->Lights[1]; }
  bool WantsIndirect() const { return this->Lights[2]; }
  bool WantsSplit() const { return this->Offsets.DirectDiffuse >= 0 || this->Offsets.IndirectDiffuse >= 0; }
  int BounceLayers() const { return this->Bounces; } ///< 0: none wanted, else the highest n of "bouncen"
  bool WantsGuides() const;
  bool WantsPrimary() const { return this->Offsets.Hits >= 0; }
  bool WantsMotion() const { return this->Offsets.Motion >= 0; }
  bool WantsHitDistance() const { return this->Offsets.HitDistance >= 0; }

  const Rect& Region() const { return this->Area; }
  /// Makes it the film of another region of no more pixels; the sums are anything until Clear.
  void MoveTo(const Rect& region) noexcept { this->Area = region; }
  std::size_t BytesPerPixel() const { return sizeof(double) * std::size_t(this->Stride); }
  /// The sums of pixels that have no sample yet; part by part, so that they are in a cache when the samples come.
  void Clear(const Rect& part) noexcept;
  /// Lets go of the sums.
  std::vector<double> TakeMemory() { return std::move(this->Sums); }
  /// All sums, to be stored; a film of the same region and arrays goes on with them.
  const std::vector<double>& Data() const { return this->Sums; }
  /// False when they are not as many as this film keeps; then nothing is changed.
  bool SetData(std::vector<double> sums)
  {
    if (sums.size() != this->Sums.size())
      return false;
    this->Sums = std::move(sums);
    return true;
  }

  /// Adds sample `index` (0, 1, ... in this order) of pixel (x, y); `guides`: its guides as well.
  void Add(int x, int y, int index, const PathSample& sample, bool guides = true) noexcept;
  /// Adds the guides alone of guide sample `index` (0, 1, ... in this order).
  void AddGuides(int x, int y, int index, const PathSample& sample) noexcept;

  /// Writes `array` for `part` (inside of the region), given that every pixel has `samples` samples, into an image of
  /// as many components as the array has. `guideSamples`: of guide samples, where those made the guides; 0: none did.
  void Develop(
    const std::string& array, const Rect& part, int samples, const ImageOut& out, int guideSamples = 0) const;

private:
  double* Record(int x, int y) noexcept
  {
    // Not &Sums[...]: a film of arrays that need no sums is empty.
    return this->Sums.data() +
           (std::size_t(y - this->Area.y0) * std::size_t(this->Area.width()) + std::size_t(x - this->Area.x0)) *
             std::size_t(this->Stride);
  }
  const double* Record(int x, int y) const noexcept { return const_cast<Film*>(this)->Record(x, y); }

  Rect Area;
  Slots Offsets;
  bool Lights[3] = { false, false, false };
  int Bounces = 0, Stride = 0;
  PixelMemoryClaim Claim;
  std::vector<double> Sums;
};
}

#endif
