// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellProgressLine_h
#define quellProgressLine_h

#include "vtkQuellStage.h"

#include <chrono>
#include <string>

namespace quell
{
/// One line on stderr that is drawn over and over: a bar, the frame, the time left, samples and noise of the stage at
/// work. Where stderr is no terminal, one plain line per frame instead, and in a long frame lines after 1, 2, 4, ...
/// and then every 60 seconds.
class ProgressLine
{
public:
  ProgressLine(int frames, bool quiet);
  ~ProgressLine();

  /// `done` of the current frame, in [0, 1]; `what` is being worked on.
  void Update(int framesDone, double done, const std::string& what, const SamplingStatus& status);
  /// Whether anybody sees it.
  bool IsShown() const { return this->Bar || this->Lines; }
  void FrameDone(int tick, int framesDone, double seconds);
  /// Removes the bar, so that other lines can be printed.
  void Clear();

private:
  int Frames;
  bool Bar = false, Lines = false, Drawn = false;
  std::chrono::steady_clock::time_point Start, Last, FrameStart;
  double NextLine = 1; ///< seconds after FrameStart
};

/// "0.4 s", "12 s", "3 min 20 s", "2 h 5 min".
std::string DurationText(double seconds);
/// "312 of 4096 samples, 1.6 M samples/s, noise 2.3 %"; empty for a stage that does not sample.
std::string SamplingText(const SamplingStatus& status);
}

#endif
