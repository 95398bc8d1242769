// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellScript_h
#define quellScript_h

#include "quellWindow.h"

#include <cstdio>
#include <string>
#include <vector>

namespace quell
{
class Viewer;

/// What mouse and keyboard do, as text, one action a line:
///
///     size 1280 800               of the window, on the first line
///     move PLACE                  PLACE: x,y from the top left; a thing's name, its middle; name@0.1,0.5, a part of it
///     click PLACE [right] [middle] [double] [ctrl] [shift] [alt]
///     drag PLACE PLACE [middle] [ctrl] [shift] [alt]
///     press BUTTON, release BUTTON    left, right, middle, where the mouse is
///     wheel PLACE N [ctrl] [shift] [alt]
///     key NAME [ctrl] [shift] [alt]   as X11 calls it: Delete, F2, z
///     type TEXT                   to the end of the line
///     drop FILE
///     wait                        until nothing is at work
///     frames N
///     screenshot FILE
///
/// Names are those the viewer marks: node/blur, out/pt/radiance, in/blur/radiance, property/Radius, palette/Sum.
class Script
{
public:
  struct Line
  {
    int Number = 0;
    std::string Action;
    std::vector<std::string> Words; ///< after the action
    std::string Rest;               ///< the same, unsplit
  };
  std::vector<Line> Lines;
  int Width = 0, Height = 0;

  bool Load(const std::string& file, std::string& error);
  bool Parse(const std::string& text, const std::string& name, std::string& error);
  std::string Name, Directory; ///< files in it are relative to where it is
};

/// Sends a script's events the way VTK's interactor does and draws the frames between them.
class ScriptRunner
{
public:
  ScriptRunner(Window& window, Viewer& viewer, const Script& script)
    : Win(window)
    , View(viewer)
    , Text(script)
  {
  }
  /// False after the first line that cannot be done.
  bool Run(std::string& error);
  bool Do(const Script::Line& line, std::string& error);
  bool Do(const std::string& line, std::string& error);
  /// Until nothing is at work and two frames are the same; false after a minute.
  bool Settle();
  void Draw();

private:
  bool Find(const std::string& place, ImVec2& at, std::string& error);
  void MoveTo(const ImVec2& to, bool slowly);

  Window& Win;
  Viewer& View;
  const Script& Text;
  ImVec2 Mouse{ -100, -100 };
  bool Control = false, Shift = false, Alt = false;
};

/// Writes events as a script.
class Recorder
{
public:
  explicit Recorder(const std::string& file);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  void operator=(const Recorder&) = delete;
  void Take(const WindowEvent& event, const Window& window);

private:
  std::FILE* File = nullptr;
  bool Begun = false, Moved = false;
  double X = -1, Y = -1;
};
}

#endif
