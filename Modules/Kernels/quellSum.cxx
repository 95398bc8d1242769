// SPDX-License-Identifier: BSD-3-Clause
#include "quellSum.h"

#include "quellGuards.h"

namespace quell
{
std::int64_t AddTerm(const ImageIn& term, bool first, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3];
      bad += !ReadFilled(term, x, y, c);
      float* o = out.at(x, y);
      for (int k = 0; k < 3; ++k)
        o[k] = first ? c[k] : Limited(o[k] + c[k]);
    }
  return bad;
}
}
