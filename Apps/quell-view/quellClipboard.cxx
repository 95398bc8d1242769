// SPDX-License-Identifier: BSD-3-Clause
#include "quellClipboard.h"

#include <X11/Xatom.h>
#include <X11/Xlib.h>

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

namespace quell
{
namespace
{
using Clock = std::chrono::steady_clock;
constexpr std::size_t MostText = std::size_t(64) << 20;

/// Requestors vanish while they are answered; that must not end the program, as X's own handler would.
int PassOver(Display*, XErrorEvent*)
{
  return 0;
}
}

double ScreenScale(void* display)
{
  Display* d = static_cast<Display*>(display);
  if (!d)
  {
    return 1;
  }
  double dots = 0;
  const char* said = XGetDefault(d, "Xft", "dpi");
  if (!said || std::sscanf(said, "%lf", &dots) != 1)
  {
    const int screen = DefaultScreen(d);
    const double millimetres = DisplayHeightMM(d, screen);
    dots = millimetres > 0 ? 25.4 * DisplayHeight(d, screen) / millimetres : 96.;
    dots = dots >= 140 ? dots : 96; // most screens only claim to be of some size
  }
  return std::min(4., std::max(1., std::floor(dots / 96 * 4 + 0.5) / 4));
}

struct Clipboard::Internals
{
  Display* Connection = nullptr;
  ::Window Hidden = 0;
  Atom Selection = 0, Targets = 0, Utf8 = 0, PlainUtf8 = 0, Text = 0, Incr = 0, Ours = 0, Stamp = 0;
  int Wake[2] = { -1, -1 };
  std::thread Thread;

  std::mutex Mutex;
  std::condition_variable Answered;
  bool Quit = false;
  bool TakesOwnership = false, Takes = false, Asks = false, Waits = false;
  std::string Own;
  std::string Received;

  // The thread's own.
  bool Collecting = false;
  Time Since = CurrentTime;
  std::string Collected;
  Clock::time_point AskedAt;
  struct Transfer
  {
    ::Window To;
    Atom Property, Type;
    std::string Text;
    std::size_t Sent;
    Clock::time_point Last;
  };
  std::vector<Transfer> Transfers;

  std::size_t PieceSize() const
  {
    return std::min<std::size_t>(std::size_t(1) << 16, std::size_t(XMaxRequestSize(this->Connection)) * 4 - 100);
  }

  void Poke() const
  {
    const char c = 0;
    if (write(this->Wake[1], &c, 1) < 0)
    {
      // The pipe is full: it will wake.
    }
  }

  void Answer(const std::string& text)
  {
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Received = text;
      this->Waits = false;
    }
    this->Collecting = false;
    this->Answered.notify_all();
  }

  /// Reads and deletes our property; false when there is none.
  bool ReadProperty(std::string& text, Atom& type)
  {
    unsigned char* data = nullptr;
    int format = 0;
    unsigned long count = 0, left = 0;
    type = 0;
    if (XGetWindowProperty(this->Connection, this->Hidden, this->Ours, 0, long(MostText / 4), True, AnyPropertyType,
          &type, &format, &count, &left, &data) != Success)
    {
      return false;
    }
    if (data && format == 8)
    {
      text.assign(reinterpret_cast<const char*>(data), count);
    }
    if (data)
    {
      XFree(data);
    }
    return type != 0;
  }

  /// Somebody pastes what we have.
  void Serve(const XSelectionRequestEvent& request)
  {
    XEvent reply = {};
    reply.xselection.type = SelectionNotify;
    reply.xselection.requestor = request.requestor;
    reply.xselection.selection = request.selection;
    reply.xselection.target = request.target;
    reply.xselection.time = request.time;
    reply.xselection.property = request.property ? request.property : request.target; // old clients name none
    std::string text;
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      text = this->Own;
    }
    const Atom property = reply.xselection.property;
    if (request.target == this->Targets)
    {
      const Atom all[] = { this->Targets, this->Stamp, this->Utf8, this->PlainUtf8, this->Text, XA_STRING };
      XChangeProperty(this->Connection, request.requestor, property, XA_ATOM, 32, PropModeReplace,
        reinterpret_cast<const unsigned char*>(all), int(sizeof all / sizeof all[0]));
    }
    else if (request.target == this->Stamp)
    {
      const long since = long(this->Since);
      XChangeProperty(this->Connection, request.requestor, property, XA_INTEGER, 32, PropModeReplace,
        reinterpret_cast<const unsigned char*>(&since), 1);
    }
    else if (request.target == this->Utf8 || request.target == this->PlainUtf8 || request.target == this->Text ||
             request.target == XA_STRING)
    {
      const Atom type = request.target == this->Text ? this->Utf8 : request.target;
      if (text.size() <= this->PieceSize())
      {
        XChangeProperty(this->Connection, request.requestor, property, type, 8, PropModeReplace,
          reinterpret_cast<const unsigned char*>(text.data()), int(text.size()));
      }
      else
      {
        XSelectInput(this->Connection, request.requestor, PropertyChangeMask);
        const long size = long(text.size());
        XChangeProperty(this->Connection, request.requestor, property, this->Incr, 32, PropModeReplace,
          reinterpret_cast<const unsigned char*>(&size), 1);
        this->Transfers.push_back({ request.requestor, property, type, text, 0, Clock::now() });
      }
    }
    else
    {
      reply.xselection.property = 0;
    }
    XSendEvent(this->Connection, request.requestor, False, 0, &reply);
    XFlush(this->Connection);
  }

  /// The next piece, when the last one was taken; an empty one ends it.
  void Continue(const XPropertyEvent& event)
  {
    for (std::size_t i = 0; i < this->Transfers.size(); ++i)
    {
      Transfer& t = this->Transfers[i];
      if (t.To != event.window || t.Property != event.atom || event.state != PropertyDelete)
      {
        continue;
      }
      const std::size_t size = std::min(this->PieceSize(), t.Text.size() - t.Sent);
      XChangeProperty(this->Connection, t.To, t.Property, t.Type, 8, PropModeReplace,
        reinterpret_cast<const unsigned char*>(t.Text.data() + t.Sent), int(size));
      XFlush(this->Connection);
      t.Sent += size;
      t.Last = Clock::now();
      if (size == 0)
      {
        this->Transfers.erase(this->Transfers.begin() + std::ptrdiff_t(i));
      }
      return;
    }
  }

  void Handle(const XEvent& event)
  {
    switch (event.type)
    {
      case SelectionRequest:
        this->Serve(event.xselectionrequest);
        break;
      case SelectionNotify:
      {
        std::string text;
        Atom type = 0;
        if (event.xselection.property == 0 || !this->ReadProperty(text, type))
        {
          // Programs that know no UTF-8 may have plain text.
          if (event.xselection.target == this->Utf8)
          {
            XConvertSelection(this->Connection, this->Selection, XA_STRING, this->Ours, this->Hidden, CurrentTime);
            XFlush(this->Connection);
          }
          else
          {
            this->Answer({});
          }
        }
        else if (type == this->Incr)
        {
          this->Collecting = true;
          this->Collected.clear();
        }
        else
        {
          this->Answer(text);
        }
        break;
      }
      case PropertyNotify:
        if (event.xproperty.window == this->Hidden && event.xproperty.atom == this->Ours &&
            event.xproperty.state == PropertyNewValue && this->Collecting)
        {
          std::string piece;
          Atom type = 0;
          if (!this->ReadProperty(piece, type) || piece.empty() || this->Collected.size() + piece.size() > MostText)
          {
            this->Answer(this->Collected);
          }
          else
          {
            this->Collected += piece;
            this->AskedAt = Clock::now(); // it comes, slowly
          }
        }
        else if (event.xproperty.window != this->Hidden)
        {
          this->Continue(event.xproperty);
        }
        break;
      default:
        break;
    }
  }

  /// The program ends, and with it what it copied: a clipboard manager, where there is one, takes it over.
  void HandOver()
  {
    const Atom manager = XInternAtom(this->Connection, "CLIPBOARD_MANAGER", False);
    if (XGetSelectionOwner(this->Connection, this->Selection) != this->Hidden ||
        XGetSelectionOwner(this->Connection, manager) == 0)
    {
      return;
    }
    const Atom all[] = { this->Utf8, this->PlainUtf8, XA_STRING };
    XChangeProperty(this->Connection, this->Hidden, this->Ours, XA_ATOM, 32, PropModeReplace,
      reinterpret_cast<const unsigned char*>(all), int(sizeof all / sizeof all[0]));
    XConvertSelection(this->Connection, manager, XInternAtom(this->Connection, "SAVE_TARGETS", False), this->Ours,
      this->Hidden, CurrentTime);
    XFlush(this->Connection);
    Clock::time_point last = Clock::now();
    while (Clock::now() - last < std::chrono::seconds(2))
    {
      while (XPending(this->Connection) > 0)
      {
        XEvent event;
        XNextEvent(this->Connection, &event);
        if (event.type == SelectionNotify && event.xselection.selection == manager)
        {
          return; // it has all it wants
        }
        this->Handle(event);
        last = Clock::now();
      }
      pollfd source{ ConnectionNumber(this->Connection), POLLIN, 0 };
      poll(&source, 1, 50);
      if (source.revents & (POLLERR | POLLHUP))
      {
        return;
      }
    }
  }

  void Loop()
  {
    for (;;)
    {
      bool own = false, ask = false, quit = false;
      {
        std::lock_guard<std::mutex> lock(this->Mutex);
        quit = this->Quit;
        std::swap(own, this->TakesOwnership);
        std::swap(ask, this->Asks);
      }
      if (quit)
      {
        this->HandOver();
        return;
      }
      if (own)
      {
        XSetSelectionOwner(this->Connection, this->Selection, this->Hidden, CurrentTime);
        XSync(this->Connection, False); // whoever asks from now on asks us
        {
          std::lock_guard<std::mutex> lock(this->Mutex);
          this->Takes = false;
        }
        this->Answered.notify_all();
      }
      if (ask)
      {
        this->AskedAt = Clock::now();
        const ::Window owner = XGetSelectionOwner(this->Connection, this->Selection);
        if (owner == this->Hidden)
        {
          std::string text;
          {
            std::lock_guard<std::mutex> lock(this->Mutex);
            text = this->Own;
          }
          this->Answer(text);
        }
        else if (owner == 0)
        {
          this->Answer({});
        }
        else
        {
          XDeleteProperty(this->Connection, this->Hidden, this->Ours);
          XConvertSelection(this->Connection, this->Selection, this->Utf8, this->Ours, this->Hidden, CurrentTime);
          XFlush(this->Connection);
        }
      }
      while (XPending(this->Connection) > 0)
      {
        XEvent event;
        XNextEvent(this->Connection, &event);
        this->Handle(event);
      }
      bool waits = false;
      {
        std::lock_guard<std::mutex> lock(this->Mutex);
        waits = this->Waits;
        if (this->TakesOwnership || this->Asks || this->Quit)
        {
          continue;
        }
      }
      if (waits && Clock::now() - this->AskedAt > std::chrono::seconds(1))
      {
        this->Answer({});
        continue;
      }
      // Who stopped taking pieces will not come back.
      this->Transfers.erase(std::remove_if(this->Transfers.begin(), this->Transfers.end(),
                              [](const Transfer& t) { return Clock::now() - t.Last > std::chrono::seconds(10); }),
        this->Transfers.end());
      pollfd sources[2] = { { ConnectionNumber(this->Connection), POLLIN, 0 }, { this->Wake[0], POLLIN, 0 } };
      poll(sources, 2, waits ? 50 : this->Transfers.empty() ? -1 : 1000);
      if (sources[1].revents & POLLIN)
      {
        char drain[64];
        if (read(this->Wake[0], drain, sizeof drain) < 0)
        {
          return;
        }
      }
      if (sources[0].revents & (POLLERR | POLLHUP))
      {
        return; // the display is gone
      }
    }
  }
};

Clipboard::Clipboard()
  : Internal(new Internals)
{
  Internals& in = *this->Internal;
  XInitThreads();
  in.Connection = XOpenDisplay(nullptr);
  if (!in.Connection)
  {
    return;
  }
  if (pipe(in.Wake) != 0)
  {
    XCloseDisplay(in.Connection);
    in.Connection = nullptr;
    return;
  }
  XSetErrorHandler(PassOver);
  in.Hidden = XCreateSimpleWindow(in.Connection, DefaultRootWindow(in.Connection), -10, -10, 1, 1, 0, 0, 0);
  XSelectInput(in.Connection, in.Hidden, PropertyChangeMask);
  in.Selection = XInternAtom(in.Connection, "CLIPBOARD", False);
  in.Targets = XInternAtom(in.Connection, "TARGETS", False);
  in.Stamp = XInternAtom(in.Connection, "TIMESTAMP", False);
  in.Utf8 = XInternAtom(in.Connection, "UTF8_STRING", False);
  in.PlainUtf8 = XInternAtom(in.Connection, "text/plain;charset=utf-8", False);
  in.Text = XInternAtom(in.Connection, "TEXT", False);
  in.Incr = XInternAtom(in.Connection, "INCR", False);
  in.Ours = XInternAtom(in.Connection, "QUELL_PASTE", False);
  in.Thread = std::thread([&in] { in.Loop(); });
}

Clipboard::~Clipboard()
{
  Internals& in = *this->Internal;
  if (!in.Connection)
  {
    return;
  }
  {
    std::lock_guard<std::mutex> lock(in.Mutex);
    in.Quit = true;
  }
  in.Poke();
  in.Thread.join();
  XDestroyWindow(in.Connection, in.Hidden);
  XCloseDisplay(in.Connection);
  close(in.Wake[0]);
  close(in.Wake[1]);
}

bool Clipboard::IsShared() const
{
  return this->Internal->Connection != nullptr;
}

void Clipboard::Set(const std::string& text)
{
  Internals& in = *this->Internal;
  std::unique_lock<std::mutex> lock(in.Mutex);
  in.Own = text;
  if (in.Connection)
  {
    in.TakesOwnership = in.Takes = true;
    in.Poke();
    in.Answered.wait_for(lock, std::chrono::seconds(1), [&in] { return !in.Takes; });
  }
}

std::string Clipboard::Get()
{
  Internals& in = *this->Internal;
  std::unique_lock<std::mutex> lock(in.Mutex);
  if (!in.Connection)
  {
    return in.Own;
  }
  in.Asks = in.Waits = true;
  in.Poke();
  // The thread answers within a second; longer only while pieces of something large arrive.
  in.Answered.wait_for(lock, std::chrono::seconds(10), [&in] { return !in.Waits; });
  in.Waits = false;
  return in.Received;
}
}
