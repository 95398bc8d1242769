// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBilateral_h
#define quellBilateral_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>

namespace quell
{
/// How two pixels' values of a guide are compared.
enum class GuideDistance
{
  Euclidean, ///< length of the difference
  Color,     ///< the same in the range space of the filter
  Normal,    ///< the same of vectors made unit; 0 stays 0
  Plane,     ///< position: |n(p) . (x(q) - x(p))|, over z(p) where a depth is given; needs a normal
  LogDepth,  ///< |ln z(q) - ln z(p)|; a depth of +inf is as far from every finite one as can be
  Id         ///< equal or not; the sigma does not matter
};

/// One feature that steers the weights.
struct BilateralGuide
{
  ImageIn value;    ///< 1 to 3 components; 3 for Color, Normal, Plane, 1 for LogDepth
  ImageIn variance; ///< absent: free of noise; else of the pixel's mean value, 1 component (averaged over those of
                    ///< `value`) or as many as `value` has. Euclidean, Color and Normal take it, the others not
  GuideDistance distance = GuideDistance::Euclidean;
  double sigma = 0.1; ///< in units of the distance
};

/// Guides may be absent; the views cover the tile grown by the radius, as far as the frame goes.
struct BilateralInputs
{
  static constexpr int MostGuides = 16, MostCarried = 4, MostCarriedComponents = 4;

  ImageIn radiance;                  ///< 3, linear
  ImageIn depth;                     ///< 1, +inf where nothing was hit
  ImageIn normal;                    ///< 3, unit
  ImageIn albedo;                    ///< 3
  ImageIn position;                  ///< 3, scene units; only used together with depth and normal
  ImageIn id;                        ///< 1
  BilateralGuide guides[MostGuides]; ///< further ones
  int guideCount = 0;
  ImageIn carried[MostCarried]; ///< filtered with the colour's weights: alpha ...; 4 components together at most
  int carriedCount = 0;
};

struct BilateralOutputs
{
  ImageOut radiance;
  ImageOut carried[BilateralInputs::MostCarried];
};

enum class RangeSpace
{
  Linear,     ///< c / white
  ToneMapped, ///< c / (white + lum c)
  Log         ///< log(1 + c / white)
};

/// A sigma of 0 lets only equal values pass; a sigma of at least 1e30 removes its term.
struct BilateralParameters
{
  /// Up to this radius every weight is computed once for both of its pixels (no guide may be a plane or noisy).
  static constexpr int MostSharedRadius = 8;

  int radius = 6;
  double sigmaSpatial = 2; ///< pixels
  double sigmaRange = 0.5; ///< in the units of the range space
  RangeSpace range = RangeSpace::ToneMapped;
  double white = 1; ///< radiance that is white; > 0. A frame k times as bright is filtered alike with k times this
  double sigmaNormal = 0.2; ///< length of the difference of unit normals
  double sigmaDepth = 0.05; ///< relative to depth
  double sigmaAlbedo = 0.1;
};

/// Joint bilateral filter over the square |dx|, |dy| <= radius:
///
///   C'(p) = C(p) + Sum w (C(q) - C(p)) / Sum w
///   w = exp(-(|q-p|^2 / 2 ss^2 + |R(q)-R(p)|^2 / 2 sr^2 + |n(q)-n(p)|^2 / 2 sn^2 + |a(q)-a(p)|^2 / 2 sa^2 + D^2 / 2
///   sd^2 + Sum_k E_k))
///
/// with one exp of the summed exponents; R is the colour in the range space. D is the relative depth difference
/// |ln z(q) - ln z(p)|, or, with positions, the distance of q from p's tangent plane, |n(p) . (x(q) - x(p))| / z(p),
/// which does not fall off along slanted surfaces. With ids, taps of another id have weight 0. A further guide k adds
///
///   E_k = d_k(p, q)^2 / 2 s_k^2, or, where its variance V (summed over the components) is known,
///   E_k = max(0, d_k(p, q)^2 - (V(p) + min(V(p), V(q)))) / (2 max(s_k^2, V(p)))
///
/// two noisy values of the same thing are V(p) + V(q) apart in the mean, so what noise explains does not count, and
/// noise widens the bandwidth. radius 0 or ss 0: the identity. Border: taps outside have weight 0. A tap that is not
/// finite has weight 0; a centre that is not finite gets the weighted mean of its neighbours without the range term (no
/// usable tap: the mean of its finite 3 x 3 neighbours, else 0). A guide value that is not finite is left out for its
/// pairs; a variance that is not finite or is negative counts as 0. With a depth input, pixels where nothing was hit
/// pass through and are no taps. Constants are fixed points to the last bit; 0 and denormal images too. Carried values
/// take the same weights; one that is not finite is filled from its neighbours first. The mean is not kept (no convex
/// combination's is, unless its weights are symmetric and sum to 1). The bits do not depend on the tile.
/// `scratch` holds BilateralScratch(...) floats. Returns the number of pixels of `tile` that were not finite.
/// Source: Tomasi and Manduchi 1998, eq. 5; Petschnigg et al. 2004 and Eisemann and Durand 2004 for the guides;
/// Rousselle, Manzi and Zwicker 2013, section 5.1, for noisy ones.
QUELLKERNELS_EXPORT std::int64_t Bilateral(const BilateralInputs& in, const BilateralParameters& parameters,
  const BilateralOutputs& out, const Rect& tile, float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t BilateralScratch(
  const BilateralInputs& in, const BilateralParameters& parameters, const Rect& tile) noexcept;
/// The same straight from the formula in double, for tests.
QUELLKERNELS_EXPORT void BilateralScalar(const BilateralInputs& in, const BilateralParameters& parameters,
  const BilateralOutputs& out, const Rect& tile) noexcept;
}

#endif
