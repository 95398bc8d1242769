// SPDX-License-Identifier: BSD-3-Clause
// Other programs of the screen, as far as tests need them. Apart from the tests, for Xlib's names are everywhere.
#ifndef quellXClients_h
#define quellXClients_h

#include <atomic>
#include <functional>
#include <string>
#include <thread>
#include <vector>

/// What a file manager does when files are dragged over a window and let go: XdndEnter, XdndPosition, XdndDrop, and the
/// list of files for who asks. `pump` lets the window handle its events. Empty when the window said that it has taken
/// them, else what did not happen.
std::string DropFiles(
  unsigned long window, int x, int y, const std::vector<std::string>& files, const std::function<void()>& pump);

/// A clipboard manager: takes over what a program that ends has copied.
class ClipboardManager
{
public:
  ClipboardManager();
  ~ClipboardManager();
  /// Texts that were handed over, joined.
  std::string Saved() const { return this->IsSaved ? this->Text : std::string(); }

private:
  void Loop();
  void* Connection = nullptr;
  unsigned long Own = 0;
  std::string Text;
  std::atomic<bool> IsSaved{ false }, Quit{ false };
  std::thread Thread;
};

#endif
