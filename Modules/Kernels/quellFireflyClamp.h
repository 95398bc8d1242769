// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFireflyClamp_h
#define quellFireflyClamp_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// What a clamp took away, for its ledger. Sums are of Rec. 709 luminance, in double.
struct ClampLedger
{
  std::int64_t Clamped = 0;   ///< pixels that were shortened
  std::int64_t NonFinite = 0; ///< pixels replaced
  double EnergyIn = 0;        ///< of the finite pixels
  double EnergyRemoved = 0;

  ClampLedger& operator+=(const ClampLedger& o) noexcept
  {
    this->Clamped += o.Clamped;
    this->NonFinite += o.NonFinite;
    this->EnergyIn += o.EnergyIn;
    this->EnergyRemoved += o.EnergyRemoved;
    return *this;
  }
};

/// Shortens colours that are too long and keeps their hue:
///
///   filtered = E                 where |E| <= threshold  (|E| = Euclidean length of RGB)
///            = E threshold/|E|   elsewhere
///   residual = E - filtered
///
/// `radiance` (3) in any linear unit; `filtered` and `residual` (3) may each be absent. filtered + residual == E in
/// float, channel by channel, exactly: where rounding would break that, `filtered` is moved by one ulp towards 0. The
/// length is taken in double, so nothing overflows up to FLT_MAX; threshold 0 gives black. A non-finite pixel is
/// replaced by the mean of its finite neighbours (0: none), which is clamped in turn; its residual is 0. Pixelwise,
/// halo 1 for that rule. Biased: it removes the mean of max(0, |E| - threshold). Source: Bikker, INFOMAGR 15, `if
/// dot(E,E) > 25: E = 5 E / |E|`.
QUELLKERNELS_EXPORT ClampLedger FireflyClamp(const ImageIn& radiance, float threshold, const ImageOut& filtered,
  const ImageOut& residual, const Rect& tile) noexcept;
}

#endif
