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

std::string SamplingText(const SamplingStatus& s)
{
  if (s.Target <= 0)
  {
    return std::string();
  }
  std::string text = std::to_string(s.Samples) + " of " + std::to_string(s.Target) + " samples";
  char number[64];
  if (s.SamplesPerSecond > 0)
  {
    std::snprintf(number, sizeof number, ", %.3g M samples/s", s.SamplesPerSecond * 1e-6);
    text += number;
  }
  if (s.Noise >= 0)
  {
    std::snprintf(number, sizeof number, ", noise %.2g %%", 100 * s.Noise);
    text += number;
  }
  return text;
}

ProgressLine::ProgressLine(int frames, bool quiet)
  : Frames(frames)
  , Start(std::chrono::steady_clock::now())
  , Last(Start)
  , FrameStart(Start)
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

void ProgressLine::Update(int framesDone, double done, const std::string& what, const SamplingStatus& status)
{
  if (!this->IsShown())
  {
    return;
  }
  const auto now = std::chrono::steady_clock::now();
  const double inFrame = std::chrono::duration<double>(now - this->FrameStart).count();
  if (this->Bar ? now - this->Last < std::chrono::milliseconds(100) : inFrame < this->NextLine)
  {
    return;
  }
  this->Last = now;
  const double fraction = std::min(1., (framesDone + std::min(1., std::max(0., done))) / this->Frames);
  const double elapsed = std::chrono::duration<double>(now - this->Start).count();
  const std::string frame =
    "frame " + std::to_string(std::min(framesDone + 1, this->Frames)) + " of " + std::to_string(this->Frames);
  std::string left;
  if (fraction > 0.01 || (fraction > 1e-6 && elapsed >= 1))
  {
    left = ", " + DurationText(elapsed * (1 - fraction) / std::max(1e-6, fraction)) + " left";
  }
  const std::string sampling = SamplingText(status);
  std::string at = what.substr(0, 32) + (sampling.empty() ? "" : ": ") + sampling;
  if (this->Lines)
  {
    this->NextLine = inFrame + std::min(60., std::max(1., inFrame));
    std::fprintf(stderr, "%s: %d %%%s, %s\n", frame.c_str(), int(100 * fraction), left.c_str(), at.c_str());
    return;
  }
  const int width = 24, filled = int(fraction * width);
  std::string bar(std::size_t(filled), '=');
  bar.resize(std::size_t(width), ' ');
  std::string line = "[" + bar + "] " + frame + left + "  " + at;
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
  this->FrameStart = std::chrono::steady_clock::now();
  this->NextLine = 1;
  if (this->Lines)
  {
    std::fprintf(stderr, "frame %d (%d of %d) in %.2f s\n", tick, framesDone, this->Frames, seconds);
  }
}
}
