// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellRedistribute_h
#define quellRedistribute_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>

namespace quell
{
/// Guides may be absent. Views cover the tile grown by 2 radius, as far as the frame goes.
struct RedistributeInputs
{
  ImageIn radiance; ///< 3, what the clamp left
  ImageIn residual; ///< 3, what it took; signed
  ImageIn depth;    ///< 1, +inf where nothing was hit
  ImageIn normal;   ///< 3, unit
  ImageIn id;       ///< 1
};

struct RedistributeParameters
{
  int radius = 8;           ///< half the side of the largest window
  double sigma = 1.5;       ///< pixels, of a small residual
  double threshold = 5;     ///< length of a residual from which the kernel widens
  double sigmaNormal = 0.3; ///< length of the difference of unit normals; 1e30: off
  double sigmaDepth = 0.1;  ///< relative to depth; 1e30: off
};

/// Gives what a clamp took to the pixels around:
///
///   out(p) = F(p) + Sum_q r(q) w(q,p) / W(q),   W(q) = Sum_p' w(q,p')
///   w(q,p) = exp(-|p-q|^2 / 2 s^2 - |n(p)-n(q)|^2 / 2 sn^2 - (ln z(p)/z(q))^2 / 2 sd^2), 0 for another id
///   s(q)   = sigma sqrt(max(1, |r(q)| / threshold)), |r| the length; the window is min(radius, ceil(2.5 s)) wide
///
/// Every source's weights add up to 1 over the pixels that exist, so Sum out = Sum F + Sum r over the frame (to float
/// rounding of the outputs), whatever borders and guides do. A peak no higher than threshold / 14 results as long as
/// the window is not cut by `radius`. A pixel without a hit gives to itself only, and receives only from itself; a
/// guide value that is not finite is left out for its pairs. A residual that is not finite counts as 0, a radiance that
/// is not finite as the mean of its finite 3 x 3 neighbours (0: none); pixels with either are counted in the result.
/// Unbiased: what the clamp and this do together keeps the energy, not its place. A zero residual gives F bit by bit.
/// Halo 2 radius. `scratch` holds RedistributeScratch doubles. Source: Bikker, INFOMAGR 15, the second
/// response to fireflies, "spread the energy".
QUELLKERNELS_EXPORT std::int64_t Redistribute(const RedistributeInputs& in, const RedistributeParameters& parameters,
  const ImageOut& out, const Rect& tile, double* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t RedistributeScratch(const Rect& tile) noexcept;

/// Over the whole image: what sums of rows, added in order, tell.
struct ImageEnergy
{
  double Residual[3] = {}; ///< of the finite residuals
  double Luminance = 0;    ///< of the finite, positive radiance
  double Pixels = 0;       ///< with finite radiance
  ImageEnergy& operator+=(const ImageEnergy& o) noexcept
  {
    for (int k = 0; k < 3; ++k)
      this->Residual[k] += o.Residual[k];
    this->Luminance += o.Luminance;
    this->Pixels += o.Pixels;
    return *this;
  }
};
QUELLKERNELS_EXPORT ImageEnergy SumEnergy(const ImageIn& radiance, const ImageIn& residual, const Rect& rows) noexcept;
/// out(p) = F(p) + R l(p) / Sum l with R the sum of all residuals and l = max(0, luminance of F): in proportion to what
/// is there, so that black stays black; where all is black, evenly. Returns the number of non-finite pixels.
QUELLKERNELS_EXPORT std::int64_t RedistributeEvenly(const ImageIn& radiance, const ImageIn& residual,
  const ImageEnergy& energy, const ImageOut& out, const Rect& tile) noexcept;
}

#endif
