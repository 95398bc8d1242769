// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEnergyLedger_h
#define quellEnergyLedger_h

#include "quellClampLedger.h"
#include "quellCountedRows.h"
#include "quellImageView.h"
#include "vtkQuellDenoisingModule.h"

#include <algorithm>
#include <string>
#include <vector>

namespace quell
{
/// What an outlier stage took away from the last frame: booked by strips, told in one line.
class VTKQUELLDENOISING_EXPORT EnergyLedger
{
public:
  /// `forEachStrip(rows, body)` runs body(strip) in parallel over strips of rows; `kernel(tile)` works on one and
  /// returns its ledger. Strips are added in their order, so the energies have the same bits for any number of threads.
  /// Returns the ledger of the rows that are new in this tick.
  template <class Loop, class Kernel>
  ClampLedger Run(const Rect& region, int tick, const Loop& forEachStrip, const Kernel& kernel)
  {
    bool started = false;
    const Rect counted = this->Counted.Add(region, tick, started);
    std::vector<ClampLedger> strips((region.height() + RowsPerStrip - 1) / RowsPerStrip);
    forEachStrip(Rect{ 0, region.y0, 1, region.y1 },
      [&](const Rect& strip)
      {
        const int y0 = std::clamp(counted.y0, strip.y0, strip.y1), y1 = std::clamp(counted.y1, y0, strip.y1);
        if (strip.y0 < y0)
          kernel(Rect{ region.x0, strip.y0, region.x1, y0 });
        if (y0 < y1)
          strips[(strip.y0 - region.y0) / RowsPerStrip] = kernel(Rect{ region.x0, y0, region.x1, y1 });
        if (y1 < strip.y1)
          kernel(Rect{ region.x0, y1, region.x1, strip.y1 });
      });
    ClampLedger sum;
    for (const ClampLedger& strip : strips)
      sum += strip;
    if (started)
    {
      this->Pixels = 0;
      this->Sum = ClampLedger();
    }
    this->Pixels += counted.area();
    this->Sum += sum;
    return sum;
  }
  /// Of the last tick.
  const ClampLedger& Total() const { return this->Sum; }
  /// "clamped 12 of 400 pixels, removed 1.5 % of the energy"; empty before the first run.
  std::string Text(const char* what = "clamped") const;

  static constexpr int RowsPerStrip = 16;

private:
  CountedRows Counted;
  ClampLedger Sum;
  long long Pixels = 0;
};
}

#endif
