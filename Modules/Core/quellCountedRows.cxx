// SPDX-License-Identifier: BSD-3-Clause
#include "quellCountedRows.h"

quell::Rect quell::CountedRows::Add(const Rect& region, int tick, bool& started)
{
  Rect added = region;
  const bool same = tick == this->Tick && region.x0 == this->Rows.x0 && region.x1 == this->Rows.x1;
  const bool below = same && region.y0 < this->Rows.y0 && region.y1 >= this->Rows.y0 && region.y1 <= this->Rows.y1;
  const bool above = same && region.y1 > this->Rows.y1 && region.y0 <= this->Rows.y1 && region.y0 >= this->Rows.y0;
  started = !below && !above;
  if (started)
    this->Rows = region;
  else if (below)
  {
    added.y1 = this->Rows.y0;
    this->Rows.y0 = region.y0;
  }
  else
  {
    added.y0 = this->Rows.y1;
    this->Rows.y1 = region.y1;
  }
  this->Tick = tick;
  return added;
}
