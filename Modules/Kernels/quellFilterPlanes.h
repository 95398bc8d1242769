// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFilterPlanes_h
#define quellFilterPlanes_h

#include "quellImageView.h"
#include "quellKernelsModule.h"
#include "quellPlanes.h"

#include <cstdint>

namespace quell
{
/// Planar copies of what the SVGF family compares: made once per frame, read by every pass. Absent: nullptr.
struct GuidePlanes
{
  PlaneLayout layout;
  float* depth = nullptr;  ///< +inf: no hit, not a number, or outside. Without a depth input 1 everywhere
  float* slopeX = nullptr; ///< depth change per pixel: of the two one-sided differences that stay on hit pixels
  float* slopeY = nullptr; ///< (and on the same id) the smaller in magnitude; 0 where there is none
  float* normal[3] = {};   ///< 0 where not finite; absent without a normal input
  float* id = nullptr;     ///< absent without an id input
};

/// What a pass reads and writes.
struct ColorPlanes
{
  float* color[3] = {};       ///< finite always; of an invalid pixel the mean of its finite neighbours
  float* luminance = nullptr; ///< FilterLuminance(color); +inf marks a tap of weight 0: input not finite, or outside
  float* variance =
    nullptr; ///< in [0, 1e38]; -1 where nothing was hit, the colour is invalid, or outside. May be absent
};

///@{ Rows [y0, y1) of the layout's extent, padding included; views cover at least the extent.
/// An absent view gives the value said above. CopyGuides for all rows comes before CopySlopes.
/// Rows may be done in parallel.
QUELLKERNELS_EXPORT void CopyGuides(
  const ImageIn& depth, const ImageIn& normal, const ImageIn& id, const GuidePlanes& planes, int y0, int y1) noexcept;
QUELLKERNELS_EXPORT void CopySlopes(const GuidePlanes& planes, int y0, int y1) noexcept;
/// Colours are limited to [-1e35, 3.4e38], so that the difference of two is finite.
/// Returns the number of pixels of `counted` with a colour that is not finite. A variance that is not a number is
/// replaced by the mean of its neighbours' (0: none), +inf becomes 1e38, negative values 0. `variance` may be absent.
QUELLKERNELS_EXPORT std::int64_t CopyColor(const ImageIn& color, const ImageIn& variance, const GuidePlanes& guides,
  const ColorPlanes& planes, int y0, int y1, const Rect& counted) noexcept;
/// Only the padding: for the second set of planes that passes write to.
QUELLKERNELS_EXPORT void ClearPadding(const PlaneLayout& layout, const ColorPlanes& planes, int y0, int y1) noexcept;
///@}

/// Interleaves planes into `color` (3) and `variance` (1), each of which may be absent, over `tile`. Where nothing was
/// hit the input passes through unchanged (a colour that is not finite as the mean of its finite neighbours).
QUELLKERNELS_EXPORT void StoreFiltered(const GuidePlanes& guides, const ColorPlanes& planes, const ImageIn& inputColor,
  const ImageIn& inputVariance, const ImageOut& color, const ImageOut& variance, const Rect& tile) noexcept;
}

#endif
