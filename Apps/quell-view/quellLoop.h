// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellLoop_h
#define quellLoop_h

#include <functional>

namespace quell
{
class Viewer;
class Window;

/// The window's life: events are handled as they come, the window is painted when something happened, a few times a
/// second while only a progress bar moves, and not at all while nothing does. Where painting takes long (OpenGL in
/// software) and there is work, which needs the same processors, a mouse that moves does not paint: new pictures do,
/// and ten times a second all else. Ends when the window is closed or `goOn` says so (asked before every frame).
void RunWindow(Window& window, Viewer& viewer, const std::function<bool()>& goOn = nullptr);
}

#endif
