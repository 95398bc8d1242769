// SPDX-License-Identifier: BSD-3-Clause
#include "quellEnergyLedger.h"

#include <cstdio>

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
