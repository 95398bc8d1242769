// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFrameFacts_h
#define quellFrameFacts_h

#include "quellVector.h"
#include "vtkQuellCoreModule.h"

#include <string>

class vtkFieldData;

namespace quell
{
/// What is true of a whole frame; rides in the field data of every image (from port 0 to the output) and, at the end,
/// in EXR metadata. World is relative to Origin. Matrices are column-vector, un-jittered, for row 0 at the BOTTOM:
/// pixel (x, y) centre has ndc = (2 (x + .5) / W - 1, 2 (y + .5) / H - 1); worldToNdc includes the perspective, so
/// p' = M (p, 1), ndc = p'.xy / p'.w, and p'.w is the depth along the view axis (perspective cameras).
struct VTKQUELLCORE_EXPORT FrameFacts
{
  bool HasCamera = false;
  Mat4 WorldToCamera; ///< camera looks along -z, y up
  Mat4 WorldToNdc;
  Vec3d Origin; ///< world position of the recentred origin
  int Tick = 0;
  double Time = 0; ///< scene seconds
  long long Seed = 0;
  int SamplesPerPixel = 0; ///< spent on this frame
  std::string Partial;     ///< "312 of 4096 samples": the frame was finished early; empty: it is complete
  std::string Scene;       ///< content hash of what was rendered; empty: unknown

  /// Missing entries leave the defaults.
  static FrameFacts Read(vtkFieldData* data);
  void Write(vtkFieldData* data) const;
};
}

#endif
