// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGuidePlanes_h
#define quellGuidePlanes_h

#include "quellGuards.h"
#include "quellPlanes.h"

#include <cstddef>
#include <cstdint>
#include <limits>

namespace quell
{
/// A tile in planes for filters whose weights come from guides alone. Every guide is scaled so that its exponent (base
/// 2) is the squared difference of the planes.
struct GuidedTile
{
  static constexpr int MostFeatures = 8; ///< normal 3, albedo 3, depth 1, id 1

  PlaneLayout layout;
  float* color[3] = {};
  float* variance = nullptr;         ///< may be absent
  float* penalty = nullptr;          ///< added to a tap's exponent: 0, or +inf for a tap that does not count
  float* feature[MostFeatures] = {}; ///< those that are used
  int features = 0;
  bool gaps = false; ///< some feature value is not a number: left out for its pairs
};

struct GuidedInputs
{
  ImageIn color, variance, depth, normal, albedo, id;
  double sigmaNormal = 0.2, sigmaDepth = 0.05, sigmaAlbedo = 0.1;

  static constexpr double Off = 1e30;
  int Features() const noexcept
  {
    return 3 * (this->normal && this->sigmaNormal < Off) + 3 * (this->albedo && this->sigmaAlbedo < Off) +
           (this->depth && this->sigmaDepth < Off) + bool(this->id);
  }
  /// Planes that FillGuidedTile uses.
  int Planes() const noexcept { return 4 + bool(this->variance) + this->Features(); }
};

/// Fills the planes of `tile.layout`, padding included, from `scratch` (Planes() x layout.size() floats). Returns where
/// the scratch goes on. Adds to `bad` the pixels of `counted` with a colour that is not finite. `tile.color` holds the
/// filled colours.
float* FillGuidedTile(
  const GuidedInputs& in, GuidedTile& tile, float* scratch, const Rect& counted, std::int64_t& bad) noexcept;

/// The exponent (base e) of the guides between two pixels, of one image or two, straight from the formula, and whether
/// a tap counts at all.
double GuideExponentBetween(const GuidedInputs& in, int x, int y, const GuidedInputs& other, int qx, int qy) noexcept;
bool GuideCounts(const GuidedInputs& in, int qx, int qy) noexcept;

/// In [0, 1e36]; what is not finite is the mean of its finite neighbours' (0: none).
float ReadCleanVariance(const ImageIn& image, int x, int y) noexcept;
}

#endif
