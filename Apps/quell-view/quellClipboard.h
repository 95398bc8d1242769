// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellClipboard_h
#define quellClipboard_h

#include <memory>
#include <string>

namespace quell
{
/// The X selection CLIPBOARD: what other programs copy and paste. A connection, a hidden window and a thread of its own
/// answer who asks, whatever the event loop does. Text is UTF-8; large texts come and go in pieces (INCR of the ICCCM).
class Clipboard
{
public:
  Clipboard(); ///< without a display it remembers texts for this program alone
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
