// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPlanes_h
#define quellPlanes_h

#include "quellImageView.h"

#include <cstddef>

namespace quell
{
/// Where pixel (x, y) of the frame lies in a planar scratch image: one float per pixel and plane, rows padded on both
/// sides so that taps beyond the frame and the lanes of a last partial vector read (and write) memory that exists. One
/// pad row below and above. What the padding must hold is said by the kernel that fills it.
struct PlaneLayout
{
  /// At least the lanes of the widest vector (64 floats: 2048 bits).
  static constexpr int Lanes = 64;

  Rect extent;               ///< pixels that exist
  int pad = Lanes;           ///< floats left of extent.x0; at least as many right of extent.x1
  std::ptrdiff_t stride = 0; ///< floats from one row to the next

  PlaneLayout() = default;
  /// `reach`: how far a tap may be from a pixel horizontally.
  PlaneLayout(const Rect& e, int reach) noexcept
    : extent(e)
  {
    this->pad = (reach + Lanes - 1) / Lanes * Lanes;
    if (this->pad == 0)
      this->pad = Lanes;
    // An odd number of cache lines: rows that lie 2^k apart do not meet in the same few lines of the nearest cache.
    this->stride = (std::ptrdiff_t(e.width()) + Lanes - 1) / Lanes * Lanes + 2 * std::ptrdiff_t(this->pad) + Lanes + 16;
  }
  /// Floats of one plane; an odd number of cache lines, for the same reason.
  std::size_t size() const noexcept { return (std::size_t(this->stride) * (this->extent.height() + 2)) | 16; }
  /// Index of pixel (x, y); y may be one row outside.
  std::ptrdiff_t at(int x, int y) const noexcept
  {
    return (y - this->extent.y0 + 1) * this->stride + this->pad + (x - this->extent.x0);
  }
};
}

#endif
