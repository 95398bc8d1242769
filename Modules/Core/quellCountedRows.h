// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCountedRows_h
#define quellCountedRows_h

#include "quellImageView.h"
#include "vtkQuellCoreModule.h"

#include <algorithm>

namespace quell
{
/// Which rows of a frame have been executed already: a frame made in bands of rows, each with the rows around it that
/// later stages read, is counted once.
class VTKQUELLCORE_EXPORT CountedRows
{
public:
  /// The rows of `region` that were not in an earlier region of this tick; all of it when it does not continue them,
  /// and then, or in another tick, `started` says that what was counted before is another frame's.
  Rect Add(const Rect& region, int tick, bool& started);

private:
  Rect Rows;
  int Tick = 0;
};
}

#endif
