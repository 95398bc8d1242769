// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSnapNormals_h
#define quellSnapNormals_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// What a mixed pixel's surface is told by; all but `normal` may be absent. Views cover the tile grown by
/// SnapNormalsReach, as far as the frame goes.
struct SnapNormalsInputs
{
  ImageIn normal;   ///< 3: mean of the samples' unit normals, where nothing was hit 0
  ImageIn depth;    ///< 1, +inf where nothing was hit
  ImageIn position; ///< 3; only used with a depth
  ImageIn id;       ///< 1
  ImageIn variance; ///< of the pixel's mean normal: 1 component (averaged) or 3; for normals that were made unit
};

struct SnapNormalsParameters
{
  double sigmaDepth = 0.02;    ///< relative to depth
  double mixedVariance = 1e-3; ///< variance per component of the mean normal from which a pixel is mixed
};

constexpr int SnapNormalsReach = 2;
/// Below this length a mean of unit normals is of several surfaces: apart by 16 degrees, or a part of nothing.
constexpr float MixedNormalLength = 0.99f;

/// Gives pixels that show several surfaces the normal of one that they show.
///
/// The mean of unit normals has length 1 only where they agree: E|n - mean|^2 = 1 - |mean|^2. Such a mean, of a crease
/// or a silhouette, is like the normals of none of the surfaces, so that guided filters find no taps and history is
/// refused, and the pixel stays as noisy as it came: edges get ragged. Depth, position and id are those of a sample or
/// as good, and tell which surface to take:
///
///   n'(p) = n(p)              where p is not mixed, n(p) = 0, nothing was hit, or there is no candidate
///         = n(q) / |n(q)|     with the q of the largest a n(p) . n(q) / |n(q)| around p, first of equals
///   a     = exp(-D^2 / 2 sigmaDepth^2 - |q - p|^2 / 2)
///   D     = n(q) . (x(q) - x(p)) / z(p) with positions, else ln z(q) / z(p); 0 without depths
///
/// over the candidates q of 5 x 5 pixels: hit, of p's id, not mixed, n(p) . n(q) > 0, a > e^-8. Without a candidate
/// n'(p) is n(p) made unit. A pixel is mixed where |n| < MixedNormalLength or, given the variance, where that is above
/// mixedVariance. What the pixel's albedo and colour are made of does not change; filters
/// then treat its light as that of the one surface, while the albedo, mixed as it is, keeps the edge smooth. Values
/// that are not finite count as 0. Returns how many normals of `tile` were not finite.
QUELLKERNELS_EXPORT std::int64_t SnapNormals(
  const SnapNormalsInputs& in, const SnapNormalsParameters& parameters, const ImageOut& out, const Rect& tile) noexcept;
}

#endif
