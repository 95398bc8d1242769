// SPDX-License-Identifier: BSD-3-Clause
#include "quellPixelCount.h"

#include "quellPlanes.h"
#include "vtkSMPTools.h"

#include <algorithm>

void quell::PixelCount::Report(StageCounters& counters, std::vector<std::string>& warnings, const char* what) const
{
  const std::int64_t n = this->Pixels;
  if (n == 0)
    return;
  counters.NonFinite += n;
  warnings.push_back(std::to_string(n) + (n == 1 ? " pixel" : " pixels") + " of " + what + (n == 1 ? " was" : " were") +
                     " not finite and filled from finite neighbours");
}

double quell::TileScratchBytes(int width, int height, int halo, double planes)
{
  const PlaneLayout layout({ 0, 0, width + 2 * halo, height + 2 * halo }, 2 * halo);
  return planes * double(layout.size()) * sizeof(float) * std::max(1, vtkSMPTools::GetEstimatedNumberOfThreads());
}
