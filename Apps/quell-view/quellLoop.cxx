// SPDX-License-Identifier: BSD-3-Clause
#include "quellLoop.h"

#include "quellViewer.h"

#include <algorithm>
#include <chrono>
#include <thread>

namespace quell
{
void RunWindow(Window& window, Viewer& viewer, const std::function<bool()>& goOn)
{
  using Clock = std::chrono::steady_clock;
  using std::chrono::milliseconds;
  const auto ui = [&viewer] { viewer.Ui(); };
  const auto never = milliseconds(1 << 30);
  Clock::time_point awake = Clock::now(), laid = awake - std::chrono::seconds(1), painted = laid;
  Clock::duration took{};
  std::uint64_t pictures = 0;
  window.SetBlind(true);
  while (!goOn || goOn())
  {
    const Clock::time_point now = Clock::now();
    const bool events = window.Poll() || window.HasEvents() || window.IsClosing();
    const bool news = viewer.HasNews(), works = viewer.IsWorking();
    awake = events || news ? now : awake;
    // A little longer than the last event: tooltips, the caret, hover.
    const bool lingers = now - awake < milliseconds(1200);
    const Clock::duration pause = events || news ? milliseconds(8)
                                  : works        ? milliseconds(100)
                                  : lingers      ? milliseconds(30)
                                                 : never;
    if (now - laid >= pause)
    {
      laid = now;
      bool open = window.Frame(ui);
      // What came together is laid out one after the other and painted once, but not out of sight for long.
      while (open && window.HasEvents() && Clock::now() - now < milliseconds(60))
      {
        open = window.Frame(ui);
      }
      const Clock::time_point before = Clock::now();
      const bool slow = works && took > milliseconds(4);
      if (!slow || viewer.PictureCount() != pictures ||
          before - painted >= std::max<Clock::duration>(milliseconds(100), 8 * took))
      {
        window.Paint();
        painted = Clock::now();
        took = painted - before;
        pictures = viewer.PictureCount();
      }
      if (!open)
      {
        break;
      }
    }
    std::this_thread::sleep_until(now + milliseconds(lingers || works ? 8 : 30));
  }
  window.SetBlind(false);
}
}
