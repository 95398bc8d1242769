// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellDemodulate_h
#define quellDemodulate_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// Divides light by reflectance, so that a filter does not blur textures.
///
///   illumination = radiance / d,   d = clamp(albedo, floor, 1) per channel
///
/// `radiance` (3), `albedo` (3), `out` (3); any linear unit, sign is kept. `d` is the same in Modulate, so
/// Modulate(Demodulate(x)) is x to 1 ulp for every albedo, 0 included, while |x| / d <= FLT_MAX; larger quotients are
/// limited to FLT_MAX. An absent albedo view and a non-finite albedo channel count as 1. A pixel whose radiance is not
/// finite gets the mean of its finite neighbours' illumination (0: none). Pixelwise, halo 1 for that rule. Returns the
/// number of such pixels. Source: Bikker, INFOMAGR 15; the floor as in Falcor's SVGF pass (1e-3).
QUELLKERNELS_EXPORT std::int64_t Demodulate(
  const ImageIn& radiance, const ImageIn& albedo, float floor, const ImageOut& out, const Rect& tile) noexcept;

/// The inverse: radiance = illumination * clamp(albedo, floor, 1). A non-finite illumination is replaced by the mean of
/// its finite neighbours before it is multiplied by its own albedo.
QUELLKERNELS_EXPORT std::int64_t Modulate(
  const ImageIn& illumination, const ImageIn& albedo, float floor, const ImageOut& out, const Rect& tile) noexcept;
}

#endif
