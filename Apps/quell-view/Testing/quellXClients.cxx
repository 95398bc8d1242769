// SPDX-License-Identifier: BSD-3-Clause
#include "quellXClients.h"

#include <X11/Xatom.h>
#include <X11/Xlib.h>

#include <poll.h>

#include <chrono>
#include <cstdio>

namespace
{
using Clock = std::chrono::steady_clock;

/// As text/uri-list wants it.
std::string UriOf(const std::string& file)
{
  std::string uri = "file://";
  for (unsigned char c : file)
  {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '/' ||
                       c == '.' || c == '-' || c == '_';
    char code[8];
    std::snprintf(code, sizeof code, "%%%02X", c);
    uri += plain ? std::string(1, char(c)) : std::string(code);
  }
  return uri + "\r\n";
}

/// The next event within a while; false: none came.
bool Next(Display* display, XEvent& event, const std::function<void()>& pump, double seconds)
{
  const Clock::time_point end =
    Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  while (XPending(display) == 0)
  {
    pump();
    pollfd source{ ConnectionNumber(display), POLLIN, 0 };
    poll(&source, 1, 5);
    if (Clock::now() > end)
    {
      return false;
    }
  }
  XNextEvent(display, &event);
  return true;
}

/// Tells who asked for a selection that it is where it was to go.
void Answer(Display* display, const XSelectionRequestEvent& asked)
{
  XEvent reply = {};
  reply.xselection.type = SelectionNotify;
  reply.xselection.requestor = asked.requestor;
  reply.xselection.selection = asked.selection;
  reply.xselection.target = asked.target;
  reply.xselection.property = asked.property;
  reply.xselection.time = asked.time;
  XSendEvent(display, asked.requestor, False, NoEventMask, &reply);
  XFlush(display);
}
}

std::string DropFiles(
  unsigned long window, int x, int y, const std::vector<std::string>& files, const std::function<void()>& pump)
{
  Display* d = XOpenDisplay(nullptr);
  if (!d)
  {
    return "no display";
  }
  const auto atom = [d](const char* name) { return XInternAtom(d, name, False); };
  const Atom selection = atom("XdndSelection"), list = atom("text/uri-list"), status = atom("XdndStatus"),
             finished = atom("XdndFinished");
  const ::Window source = XCreateSimpleWindow(d, DefaultRootWindow(d), -10, -10, 1, 1, 0, 0, 0);
  const auto close = [&](const std::string& result)
  {
    XDestroyWindow(d, source);
    XCloseDisplay(d);
    return result;
  };
  // Windows that take drops say so.
  Atom type = 0;
  int format = 0;
  unsigned long count = 0, left = 0;
  unsigned char* version = nullptr;
  XGetWindowProperty(d, window, atom("XdndAware"), 0, 1, False, XA_ATOM, &type, &format, &count, &left, &version);
  const bool aware = count == 1;
  if (version)
  {
    XFree(version);
  }
  if (!aware)
  {
    return close("the window has no property XdndAware");
  }
  XSetSelectionOwner(d, selection, source, CurrentTime);
  const auto send = [&](const char* message, long l1, long l2, long l3, long l4)
  {
    XEvent e = {};
    e.xclient.type = ClientMessage;
    e.xclient.window = window;
    e.xclient.message_type = atom(message);
    e.xclient.format = 32;
    e.xclient.data.l[0] = long(source);
    e.xclient.data.l[1] = l1;
    e.xclient.data.l[2] = l2;
    e.xclient.data.l[3] = l3;
    e.xclient.data.l[4] = l4;
    XSendEvent(d, window, False, NoEventMask, &e);
    XFlush(d);
  };
  ::Window child = 0;
  int rootX = 0, rootY = 0;
  XTranslateCoordinates(d, window, DefaultRootWindow(d), x, y, &rootX, &rootY, &child);
  send("XdndEnter", 5L << 24, long(list), 0, 0);
  send("XdndPosition", 0, (long(rootX) << 16) | long(rootY), CurrentTime, long(atom("XdndActionCopy")));
  bool dropped = false;
  for (;;)
  {
    XEvent e;
    if (!Next(d, e, pump, 20))
    {
      return close(dropped ? "the window never said that it was finished" : "the window never answered XdndPosition");
    }
    if (e.type == ClientMessage && e.xclient.message_type == status && !dropped)
    {
      if (!(e.xclient.data.l[1] & 1))
      {
        return close("the window would not take it");
      }
      dropped = true;
      send("XdndDrop", 0, CurrentTime, 0, 0);
    }
    else if (e.type == SelectionRequest)
    {
      std::string text;
      for (const std::string& f : files)
      {
        text += UriOf(f);
      }
      const XSelectionRequestEvent& r = e.xselectionrequest;
      XChangeProperty(d, r.requestor, r.property, r.target, 8, PropModeReplace,
        reinterpret_cast<const unsigned char*>(text.data()), int(text.size()));
      Answer(d, r);
    }
    else if (e.type == ClientMessage && e.xclient.message_type == finished)
    {
      return close("");
    }
  }
}

ClipboardManager::ClipboardManager()
{
  Display* d = XOpenDisplay(nullptr);
  this->Connection = d;
  if (d)
  {
    this->Own = XCreateSimpleWindow(d, DefaultRootWindow(d), -10, -10, 1, 1, 0, 0, 0);
    XSetSelectionOwner(d, XInternAtom(d, "CLIPBOARD_MANAGER", False), this->Own, CurrentTime);
    XSync(d, False);
    this->Thread = std::thread([this] { this->Loop(); });
  }
}

ClipboardManager::~ClipboardManager()
{
  this->Quit = true;
  if (this->Thread.joinable())
  {
    this->Thread.join();
    XCloseDisplay(static_cast<Display*>(this->Connection));
  }
}

void ClipboardManager::Loop()
{
  Display* d = static_cast<Display*>(this->Connection);
  const Atom save = XInternAtom(d, "SAVE_TARGETS", False), clipboard = XInternAtom(d, "CLIPBOARD", False),
             utf8 = XInternAtom(d, "UTF8_STRING", False), property = XInternAtom(d, "TEST_SAVED", False);
  XSelectionRequestEvent asked = {};
  while (!this->Quit)
  {
    XEvent e;
    if (!Next(
          d, e, [] {}, 0.05))
    {
      continue;
    }
    if (e.type == SelectionRequest && e.xselectionrequest.target == save)
    {
      asked = e.xselectionrequest;
      XConvertSelection(d, clipboard, utf8, property, this->Own, CurrentTime);
      XFlush(d);
    }
    else if (e.type == SelectionNotify)
    {
      Atom type = 0;
      int format = 0;
      unsigned long count = 0, left = 0;
      unsigned char* data = nullptr;
      XGetWindowProperty(
        d, this->Own, property, 0, 1 << 20, True, AnyPropertyType, &type, &format, &count, &left, &data);
      if (data && format == 8)
      {
        this->Text.assign(reinterpret_cast<const char*>(data), count);
        this->IsSaved = true;
      }
      if (data)
      {
        XFree(data);
      }
      Answer(d, asked);
    }
  }
}
