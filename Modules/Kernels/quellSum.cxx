// SPDX-License-Identifier: BSD-3-Clause
#include "quellSum.h"

#include "quellGuards.h"

namespace quell
{
std::int64_t AddTerm(const ImageIn& term, bool first, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  const int count = 3 * tile.width();
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    const float* c = term.at(tile.x0, y);
    float* o = out.at(tile.x0, y);
    int wrong = 0;
    for (int i = 0; i < count; ++i)
      wrong |= !Finite(c[i]);
    if (!wrong)
    {
      if (first)
        std::copy(c, c + count, o);
      else
        for (int i = 0; i < count; ++i)
          o[i] = Limited(o[i] + c[i]);
      continue;
    }
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float v[3];
      bad += !ReadFilled(term, x, y, v);
      float* p = out.at(x, y);
      for (int k = 0; k < 3; ++k)
        p[k] = first ? v[k] : Limited(p[k] + v[k]);
    }
  }
  return bad;
}
}
