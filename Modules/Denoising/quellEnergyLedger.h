// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEnergyLedger_h
#define quellEnergyLedger_h

#include "quellClampLedger.h"
#include "quellImageView.h"
#include "vtkQuellDenoisingModule.h"

#include <string>
#include <vector>

namespace quell
{
/// What an outlier stage's last execution took away: booked by strips, told in one line.
class VTKQUELLDENOISING_EXPORT EnergyLedger
{
public:
  /// `forEachStrip(rows, body)` runs body(strip) in parallel over strips of rows; `kernel(tile)` works on one and
  /// returns its ledger. Strips are added in their order, so the energies have the same bits for any number of threads.
  template <class Loop, class Kernel>
  void Run(const Rect& region, const Loop& forEachStrip, const Kernel& kernel)
  {
    std::vector<ClampLedger> strips((region.height() + RowsPerStrip - 1) / RowsPerStrip);
    forEachStrip(Rect{ 0, region.y0, 1, region.y1 },
      [&](const Rect& strip) {
        strips[(strip.y0 - region.y0) / RowsPerStrip] = kernel(Rect{ region.x0, strip.y0, region.x1, strip.y1 });
      });
    this->Pixels = region.area();
    this->Sum = ClampLedger();
    for (const ClampLedger& strip : strips)
      this->Sum += strip;
  }
  const ClampLedger& Total() const { return this->Sum; }
  /// "clamped 12 of 400 pixels, removed 1.5 % of the energy"; empty before the first run.
  std::string Text(const char* what = "clamped") const;

  static constexpr int RowsPerStrip = 16;

private:
  ClampLedger Sum;
  long long Pixels = 0;
};
}

#endif
