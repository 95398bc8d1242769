// SPDX-License-Identifier: BSD-3-Clause
#include "quellEnergyLedger.h"

#include <cstdio>

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

std::string quell::EnergyLedger::Text(const char* what) const
{
  if (this->Pixels == 0)
    return std::string();
  char text[160];
  std::snprintf(text, sizeof text, "%s %lld of %lld pixels, removed %.3g %% of the energy", what,
    static_cast<long long>(this->Sum.Clamped), this->Pixels,
    this->Sum.EnergyIn > 0 ? 100 * this->Sum.EnergyRemoved / this->Sum.EnergyIn : 0.);
  return text;
}
