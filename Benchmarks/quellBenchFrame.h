// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBenchFrame_h
#define quellBenchFrame_h

#include "quellImageView.h"

#include <vector>

namespace quell
{
/// Pixels that own their memory.
struct BenchImage
{
  Rect Extent;
  int Components = 0;
  std::vector<float> Data;

  BenchImage() = default;
  BenchImage(int width, int height, int components)
    : Extent{ 0, 0, width, height }
    , Components(components)
    , Data(std::size_t(width) * std::size_t(height) * std::size_t(components))
  {
  }
  float* at(int x, int y) { return ImageOut(*this).at(x, y); }
  const float* at(int x, int y) const { return ImageIn(*this).at(x, y); }
  operator ImageIn() const { return ImageIn(this->Data.data(), this->Components, this->Extent); }
  operator ImageOut() { return ImageOut(this->Data.data(), this->Components, this->Extent); }
};

/// A made-up frame of a path tracer at one sample a pixel: a room with a tiled floor, a dozen balls and a window on the
/// sky (a tenth of the picture), seen from a camera that moved a little since `tick - 1`; the noise of each tick is
/// another one, heavy-tailed, with fireflies. Everything is a pure function of (width, height, tick).
struct BenchFrame
{
  BenchImage Direct, Indirect, Emission; ///< radiance layers
  BenchImage Illumination, Variance;     ///< the direct light without albedo, and the variance of its luminance
  BenchImage Albedo, Normal, Depth, Id, Motion, Position;

  BenchFrame(int width, int height, int tick);
};
}

#endif
