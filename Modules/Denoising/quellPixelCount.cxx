// SPDX-License-Identifier: BSD-3-Clause
#include "quellPixelCount.h"

#include "quellPlanes.h"
#include "vtkSMPTools.h"

#include <algorithm>

void quell::PixelCount::Begin(const Rect& region, int tick)
{
  bool started = false;
  this->Counted = this->Rows.Add(region, tick, started);
  this->All = started ? 0 : this->All + this->Pixels;
  this->Pixels = 0;
}

void quell::PixelCount::Report(
  StageCounters& counters, std::vector<std::string>& warnings, std::string& countedWarning, const char* what)
{
  Report(this->Pixels, this->All + this->Pixels, counters, warnings, countedWarning, what);
}

void quell::PixelCount::Report(std::int64_t pixels, std::int64_t all, StageCounters& counters,
  std::vector<std::string>& warnings, std::string& countedWarning, const char* what)
{
  counters.NonFinite += pixels;
  if (all == 0)
    return;
  countedWarning = std::to_string(all) + (all == 1 ? " pixel" : " pixels") + " of " + what +
                   (all == 1 ? " was" : " were") + " not finite and filled from finite neighbours";
  warnings.push_back(countedWarning);
}

double quell::TileScratchBytes(int width, int height, int halo, double planes)
{
  const PlaneLayout layout({ 0, 0, width + 2 * halo, height + 2 * halo }, 2 * halo);
  return planes * double(layout.size()) * sizeof(float) * std::max(1, vtkSMPTools::GetEstimatedNumberOfThreads());
}
