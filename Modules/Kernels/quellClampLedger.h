// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellClampLedger_h
#define quellClampLedger_h

#include "quellImageView.h"

#include <cmath>
#include <cstdint>

namespace quell
{
/// What an outlier stage took away, for its ledger. Sums are of Rec. 709 luminance, in double.
struct ClampLedger
{
  std::int64_t Clamped = 0;   ///< pixels that were changed
  std::int64_t NonFinite = 0; ///< pixels replaced
  std::int64_t Guarded = 0;   ///< of Clamped, those that a guard against broken pixels shortened
  double EnergyIn = 0;        ///< of the finite pixels
  double EnergyRemoved = 0;

  ClampLedger& operator+=(const ClampLedger& o) noexcept
  {
    this->Clamped += o.Clamped;
    this->NonFinite += o.NonFinite;
    this->Guarded += o.Guarded;
    this->EnergyIn += o.EnergyIn;
    this->EnergyRemoved += o.EnergyRemoved;
    return *this;
  }
};

/// How large a colour is.
enum class ClampMeasure
{
  Length,    ///< Euclidean length of RGB: dot(E, E) of the lecture's macro
  Luminance, ///< magnitude of the Rec. 709 luminance
  Maximum    ///< magnitude of the largest channel: Lighthouse 2, pbrt
};

/// In double: no finite colour overflows.
inline double MeasureOf(const float* c, ClampMeasure measure) noexcept
{
  if (measure == ClampMeasure::Luminance)
    return std::fabs(0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]);
  if (measure == ClampMeasure::Maximum)
    return std::fmax(std::fabs(c[0]), std::fmax(std::fabs(c[1]), std::fabs(c[2])));
  return std::sqrt(double(c[0]) * c[0] + double(c[1]) * c[1] + double(c[2]) * c[2]);
}

/// The float nearest to `wanted` from below in magnitude for which f + (c - f) == c; |wanted| <= |c|, of c's sign.
/// c - f is exact for f >= c / 2; below, it is rounded to a half of c's last place, and the sum rounds back to c but
/// for ties.
inline float SplitExactly(float c, float wanted, float& rest) noexcept
{
  float f = wanted;
  rest = c - f;
  while (f + rest != c) // only when c - f is an exact tie and c is odd; the next f ends it
  {
    f = std::nextafter(f, 0.f);
    rest = c - f;
  }
  return f;
}

/// Books one pixel: `in` was turned into `in - residual`.
inline void Book(ClampLedger& ledger, const float* in, const float* residual, bool clamped) noexcept
{
  ledger.Clamped += clamped;
  ledger.EnergyIn += 0.2126 * in[0] + 0.7152 * in[1] + 0.0722 * in[2];
  ledger.EnergyRemoved += 0.2126 * residual[0] + 0.7152 * residual[1] + 0.0722 * residual[2];
}

/// Stores a colour where the view is there.
inline void StoreColor(const ImageOut& image, int x, int y, const float* c) noexcept
{
  if (image)
    for (int k = 0; k < 3; ++k)
      image.at(x, y)[k] = c[k];
}
}

#endif
