// SPDX-License-Identifier: BSD-3-Clause
#include "quellProgressLine.h"

#include <algorithm>
#include <cstdio>
#include <sys/ioctl.h>
#include <unistd.h>

namespace quell
{
std::string DurationText(double seconds)
{
  char text[64];
  if (seconds < 10)
  {
    std::snprintf(text, sizeof text, "%.1f s", seconds);
    return text;
  }
  const long s = long(seconds + 0.5);
  if (s < 60)
  {
    std::snprintf(text, sizeof text, "%ld s", s);
  }
  else if (s < 3600)
  {
    std::snprintf(text, sizeof text, "%ld min %ld s", s / 60, s % 60);
  }
  else
  {
    std::snprintf(text, sizeof text, "%ld h %ld min", s / 3600, s % 3600 / 60);
  }
  return text;
}

ProgressLine::ProgressLine(int frames, bool quiet)
  : Frames(frames)
  , Start(std::chrono::steady_clock::now())
  , Last(Start)
{
  this->Bar = !quiet && isatty(STDERR_FILENO);
  this->Lines = !quiet && !this->Bar;
}

ProgressLine::~ProgressLine()
{
  this->Clear();
}

void ProgressLine::Clear()
{
  if (this->Drawn)
  {
    std::fputs("\r\033[K", stderr);
    std::fflush(stderr);
    this->Drawn = false;
  }
}

void ProgressLine::Update(int framesDone, double done, const std::string& what)
{
  if (!this->Bar)
  {
    return;
  }
  const auto now = std::chrono::steady_clock::now();
  if (now - this->Last < std::chrono::milliseconds(100))
  {
    return;
  }
  this->Last = now;
  const double fraction = std::min(1., (framesDone + std::min(1., std::max(0., done))) / this->Frames);
  const double elapsed = std::chrono::duration<double>(now - this->Start).count();
  const int width = 24, filled = int(fraction * width);
  std::string bar(std::size_t(filled), '=');
  bar.resize(std::size_t(width), ' ');
  std::string left;
  if (fraction > 0.01)
  {
    left = ", " + DurationText(elapsed * (1 - fraction) / fraction) + " left";
  }
  std::string line = "[" + bar + "] frame " + std::to_string(std::min(framesDone + 1, this->Frames)) + " of " +
                     std::to_string(this->Frames) + left + "  " + what.substr(0, 32);
  // A line that wraps cannot be drawn over. The size may change while we run.
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1)
  {
    line = line.substr(0, std::size_t(size.ws_col - 1));
  }
  std::fprintf(stderr, "\r%s\033[K", line.c_str());
  std::fflush(stderr);
  this->Drawn = true;
}

void ProgressLine::FrameDone(int tick, int framesDone, double seconds)
{
  if (this->Lines)
  {
    std::fprintf(stderr, "frame %d (%d of %d) in %.2f s\n", tick, framesDone, this->Frames, seconds);
  }
}
}
