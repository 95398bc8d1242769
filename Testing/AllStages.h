// SPDX-License-Identifier: BSD-3-Clause
#ifndef AllStages_h
#define AllStages_h

#include "../Apps/quellAllStages.h"

/// Every stage type, as the programs have them.
inline const quell::StageRegistry& Registry()
{
  return quell::AllStages();
}

#endif
