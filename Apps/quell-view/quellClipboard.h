// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellClipboard_h
#define quellClipboard_h

#include <memory>
#include <string>

namespace quell
{
/// How large text wants to be on a screen of 96 dots an inch, 1: what the desktop says (resource Xft.dpi), else what
/// the screen measures where that is clearly more. In quarters, [1, 4]. `display`: Xlib's, may be null.
double ScreenScale(void* display);

/// The X selection CLIPBOARD: what other programs copy and paste. A connection, a hidden window and a thread of its own
/// answer who asks, whatever the event loop does. Text is UTF-8; large texts come and go in pieces (INCR of the ICCCM).
class Clipboard
{
public:
  Clipboard(); ///< without a display it remembers texts for this program alone
  /// A clipboard manager, where one runs, takes over what is here; else it is gone with us, as X has it.
  ~Clipboard();
  Clipboard(const Clipboard&) = delete;
  void operator=(const Clipboard&) = delete;

  void Set(const std::string& text);
  /// What the owner of the clipboard hands over; empty when there is none, it has no text, or it does not answer
  /// within a second.
  std::string Get();
  bool IsShared() const; ///< with other programs

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};
}

#endif
