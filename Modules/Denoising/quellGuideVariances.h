// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGuideVariances_h
#define quellGuideVariances_h

#include "quellConnectionCheck.h"
#include "vtkQuellDenoisingModule.h"

#include <string>
#include <vector>

namespace quell
{
/// The guide that a guideVariance belongs to: the one it names; without a name the only one, or the one whose name
/// follows "variance" in the name of its array. -1: none, -2: several.
/// @param guides  names of the guides: their attribute `name`, or that of their arrays
VTKQUELLDENOISING_EXPORT int GuideOfVariance(
  const std::vector<std::string>& guides, const std::string& name, const std::string& array);

/// Tells of every connection of port `variances` that has no guide, several, or one that has a variance already, or
/// other components than it. `names`: the attribute `guide` of each. Returns the guide of each; < 0 after a mistake.
VTKQUELLDENOISING_EXPORT std::vector<int> CheckGuideVariances(ConnectionCheck& check, int guidePort,
  const std::vector<std::string>& guides, int variancePort, const std::vector<std::string>& names);
}

#endif
