// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellLoop_h
#define quellLoop_h

#include <functional>

namespace quell
{
class Viewer;
class Window;

/// The window's life: a frame when something happened, a few a second while only a progress bar moves, none while
/// nothing does. Where painting takes long (OpenGL in software) it gets no more than a third of the time while there is
/// work, which needs the same processors. Ends when the window is closed or `goOn` says so (asked before every frame).
void RunWindow(Window& window, Viewer& viewer, const std::function<bool()>& goOn = nullptr);
}

#endif
