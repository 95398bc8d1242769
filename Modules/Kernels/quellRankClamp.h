// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRankClamp_h
#define quellRankClamp_h

#include "quellClampLedger.h"
#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>

namespace quell
{
struct RankClampParameters
{
  static constexpr int LargestRadius = 8;

  int radius = 1; ///< half the window's side, [0, LargestRadius]; 0: the identity
  int rank = 2;   ///< the neighbour whose size is the limit, counted from the largest: 1, 2 ...
  double factor = 1;
  ClampMeasure measure = ClampMeasure::Luminance;
};

/// Shortens a colour that stands out from its neighbours and keeps its hue:
///
///   L        = factor m_(rank), the rank-th largest m(q) over the window |dx|, |dy| <= radius without its centre
///   filtered = E           where m(E) <= L
///            = E L / m(E)  elsewhere
///   residual = E - filtered
///
/// The centre takes no part in its own judgement: among n values that include it no deviation exceeds (n - 1) / sqrt(n)
/// standard deviations, so a test with it would miss what it looks for. `id` (1) may be absent; with it only neighbours
/// of the centre's id count. Fewer than `rank` neighbours: the smallest of them is the limit; none: the pixel stays.
/// Bright spots of up to `rank` pixels go, larger ones stay. filtered + residual == E in float, channel by
/// channel, exactly (see FireflyClamp). `radiance` in any linear unit. Border: taps outside do not count. Taps that are
/// not finite do not count; a centre that is not finite is replaced by the mean of its finite 3 x 3 neighbours (0:
/// none), clamped in turn, with residual 0. Constants are fixed points. Halo max(1, radius).
///
/// Biased towards 0 for every skewed noise, more so where few neighbours saw any light. `scratch` holds
/// RankClampScratch floats. Source: rank conditioned rank selection (Hardie and Barner 1994), as in NRD's anti-firefly
/// (there with rank 1, factor 1, and the neighbour's colour instead of its size).
QUELLKERNELS_EXPORT ClampLedger RankClamp(const ImageIn& radiance, const ImageIn& id,
  const RankClampParameters& parameters, const ImageOut& filtered, const ImageOut& residual, const Rect& tile,
  float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t RankClampScratch(const RankClampParameters& parameters, const Rect& tile) noexcept;
}

#endif
