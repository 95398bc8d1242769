// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEmissionSplit_h
#define quellEmissionSplit_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
struct EmissionSplitParameters
{
  float threshold = 4;    ///< luminance of what only a light source has, radiance units
  int neighbours = 3;     ///< of the 8, so many must be as bright: a lamp is an area, a firefly is not
  int grow = 2;           ///< pixels around a lamp that its pixel filter may reach
  float edgePart = 0.05f; ///< of the threshold: how bright such a pixel is at least
};

/// Finds light sources seen directly in a frame that has no emission pass, and takes them out.
///
///   bright(p): luminance(p) > threshold, and so it is at `neighbours` or more of the 8 pixels around p
///   lamp(p):   bright(p), or
///              luminance(p) > edgePart max of luminance over the bright pixels at most `grow` columns and rows away:
///              the lamp covers more than that part of it
///   emission = radiance at lamps, else 0;   rest = radiance - emission;   mask = 1 at lamps, else 0
///
/// emission + rest is the input, bit for bit; one of them is 0. Luminance is Rec. 709. Outside the frame nothing is
/// bright. A pixel that is not finite is not bright; it is filled from its neighbours, and is a lamp if that is bright
/// enough for an edge. The views cover the tile grown by 1 + grow (at least 1) as far as the frame goes. Outputs may be
/// absent. Returns the number of pixels of `tile` that were not finite. Limits: lamps of fewer than neighbours + 1
/// pixels, and those dimmer than the brightest surface, are not told apart; where there is an emission pass, use that.
QUELLKERNELS_EXPORT std::int64_t EmissionSplit(const ImageIn& radiance, const EmissionSplitParameters& parameters,
  const ImageOut& emission, const ImageOut& rest, const ImageOut& mask, const Rect& tile) noexcept;
}

#endif
