// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFilledWeights_h
#define quellFilledWeights_h

#include "quellGuards.h"
#include "quellImageView.h"

namespace quell
{
/// Adds `part` to the weights of what ReadFilled makes pixel (x, y) of `image` of: the pixel itself or, where it is not
/// finite, its finite 3 x 3 neighbours, each as much. Those outside of `weights` (1 component) are left out.
inline void AddFilledWeight(const ImageIn& image, int x, int y, double part, const ImageOut& weights) noexcept
{
  if (Finite3(image.at(x, y)))
  {
    *weights.at(x, y) += float(part);
    return;
  }
  const Rect around = Rect{ x - 1, y - 1, x + 2, y + 2 }.clipped(image.extent);
  int finite = 0;
  for (int pass = 0; pass < 2; ++pass)
    for (int qy = around.y0; qy < around.y1; ++qy)
      for (int qx = around.x0; qx < around.x1; ++qx)
        if (Finite3(image.at(qx, qy)))
        {
          if (pass == 0)
            ++finite;
          else if (weights.extent.contains(qx, qy))
            *weights.at(qx, qy) += float(part / finite);
        }
}
}

#endif
