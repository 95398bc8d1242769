// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFrameHistory_h
#define quellFrameHistory_h

#include "vtkQuellCoreModule.h"
#include "vtkQuellStage.h"
#include "vtkSmartPointer.h"

#include <map>
#include <string>

namespace quell
{
/// What producers had on earlier frames, keyed by tick: the only state between frames. The executor owns it and commits
/// after a whole frame succeeded. Images are shallow: arrays are shared with the producer's output until that executes
/// again (VTK allocates a new array while somebody else holds the old one).
class VTKQUELLCORE_EXPORT FrameHistory
{
public:
  explicit FrameHistory(int ticksKept = 3)
    : Kept(ticksKept)
  {
  }

  /// Everything kept of one frame: producer name -> image.
  using Frame = std::map<std::string, vtkSmartPointer<vtkImageData>>;

  /// Keeps `arrays` of `image` (with its field data). Returned images are the same objects when nothing changed.
  static vtkSmartPointer<vtkImageData> Keep(vtkImageData* image, const ArraySet& arrays, vtkImageData* previous);

  /// Replaces tick `tick` as a whole and forgets the oldest ticks beyond the number kept.
  void Commit(int tick, Frame frame);
  /// nullptr when that tick (or producer) is not kept.
  vtkImageData* Find(int tick, const std::string& producer) const;
  const Frame* FindFrame(int tick) const;
  void Clear() { this->Frames.clear(); }

private:
  int Kept;
  std::map<int, Frame> Frames;
};
}

#endif
