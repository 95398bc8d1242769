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
  Clock::time_point awake = Clock::now(), ended = awake - std::chrono::seconds(1), looked = awake;
  Clock::duration took{};
  while (!goOn || goOn())
  {
    const Clock::time_point now = Clock::now();
    const bool events = window.Poll() || window.HasEvents() || window.IsClosing();
    const bool news = viewer.HasNews(), works = viewer.IsWorking();
    awake = events || news ? now : awake;
    // A little longer than the last event: tooltips, the caret, hover.
    const bool lingers = now - awake < milliseconds(1200);
    const Clock::duration pause = std::max<Clock::duration>(events || news ? milliseconds(4)
                                                            : lingers      ? milliseconds(works ? 60 : 30)
                                                            : works        ? milliseconds(120)
                                                                           : milliseconds(1 << 30),
      works ? std::min<Clock::duration>(2 * took, milliseconds(100)) : Clock::duration::zero());
    if (now - ended >= pause)
    {
      if (!window.Frame(ui))
      {
        return;
      }
      ended = Clock::now();
      took = ended - now;
    }
    looked = Clock::now();
    std::this_thread::sleep_until(
      std::max(looked, std::min(now + milliseconds(lingers || works ? 8 : 30), std::max(looked, ended + pause))));
  }
}
}
