// SPDX-License-Identifier: BSD-3-Clause
#include "../Apps/quellAllStages.h"
#include "quellBench.h"
#ifdef QUELL_BENCH_WINDOW
#include "quellLoop.h"
#include "quellScript.h"
#include "quellViewer.h"
#include "quellWindow.h"
#endif
#include "quellPipelineExecutor.h"
#include "quellPresenter.h"
#include "quellRenderSession.h"
#include "quellPipelineReader.h"
#include "vtkImageData.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <stdexcept>

namespace
{
using namespace quell;
using Clock = std::chrono::steady_clock;

double Since(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

GraphOptions Room()
{
  GraphOptions o;
  o.Defines = { { "width", "640" }, { "height", "360" }, { "spp", "1" }, { "frames", "400" } };
  return o;
}

double Median(std::vector<double> v)
{
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}
}

QUELL_BENCHMARK("svgf-live-640x360",
  "the Cornell room, 640 x 360, 1 sample a pixel, all of SVGF: frames a second of an orbit in the viewer's session "
  "(display picture included) and of a run; milliseconds until a cancelled frame stops")
{
  const std::string file = QUELL_SOURCE_DIR "/Data/Pipelines/svgf.xml";
  Diagnostics messages;
  const std::shared_ptr<const PipelineDocument> document = ReadPipelineFile(file, messages);
  const auto graph = BuildGraph(document, AllStages(), Room(), messages);
  if (messages.HasErrors())
  {
    throw std::runtime_error(messages.ToText());
  }

  PipelineExecutor executor(graph, AllStages());
  executor.SetWriteOutputs(false);
  executor.Request("taa", { "radiance" });
  std::vector<double> run;
  std::clock_t cpu = 0;
  for (int tick = 0; tick < 24; ++tick)
  {
    if (tick == 4)
    {
      cpu = std::clock();
    }
    const Clock::time_point start = Clock::now();
    if (!executor.RunTick(tick, TickMode::Frame).Ok)
    {
      throw std::runtime_error("the pipeline failed");
    }
    if (tick >= 4)
    {
      run.push_back(Since(start));
    }
  }
  const double each = Median(run);
  // What the frame costs whatever else the machine does: of all threads together.
  const double runCpu = double(std::clock() - cpu) / CLOCKS_PER_SEC / double(run.size());

  RenderSession session(AllStages());
  Presenter presenter;
  ViewWish wish;
  wish.Document = document;
  wish.Options = Room();
  wish.Targets = { { "taa", "radiance" } };
  session.Wish(wish);
  session.WaitIdle(60);
  const auto first = session.Latest();
  if (!first || !first->Ok)
  {
    throw std::runtime_error("the session failed");
  }
  const FrameFacts facts = FrameFacts::Read(first->Image("taa")->GetFieldData());
  Mat4 camera;
  facts.WorldToCamera.Inverse(camera);
  camera.m[0][3] += facts.Origin.x;
  camera.m[1][3] += facts.Origin.y;
  camera.m[2][3] += facts.Origin.z;
  std::vector<double> live;
  const Mat4 start = camera;
  for (int i = 0; i < 24; ++i)
  {
    if (i == 4)
    {
      cpu = std::clock();
    }
    const Clock::time_point begin = Clock::now();
    // A turn about the vertical through what the camera looks at.
    const double angle = 0.004 * i, c = std::cos(angle), s = std::sin(angle);
    Mat4 turn;
    turn.m[0][0] = c;
    turn.m[0][2] = s;
    turn.m[2][0] = -s;
    turn.m[2][2] = c;
    wish.Camera = turn * start;
    wish.CameraSerial = i + 1;
    session.Wish(wish);
    session.WaitIdle(60);
    PresentWish p;
    p.A.Image = session.Latest()->Images.at("taa");
    p.A.Array = "radiance";
    p.A.Kind = ArrayKind::Color;
    presenter.Wish(p);
    presenter.WaitIdle(60);
    if (i >= 4)
    {
      live.push_back(Since(begin));
    }
  }
  const double liveEach = Median(live);
  const double liveCpu = double(std::clock() - cpu) / CLOCKS_PER_SEC / double(live.size());
  bench.Report("svgf-live-640x360 run", 1 / each, "frames/s", "limit 8", 1 / each / 8);
  bench.Report("svgf-live-640x360 orbit and display", 1 / liveEach, "frames/s", "limit 5", 1 / liveEach / 5);
  bench.Report("svgf-live-640x360 run, processor time", 1000 * runCpu, "ms", "two cores at 8 frames/s", runCpu / 0.25);
  bench.Report("svgf-live-640x360 orbit and display, processor time", 1000 * liveCpu, "ms", "two cores at 5 frames/s",
    liveCpu / 0.4);

  // Cancelling in the middle of a frame.
  std::vector<double> waits;
  wish.Camera.reset();
  wish.Options.Defines[2].second = "256";
  wish.Progressive = false;
  for (int i = 0; i < 7; ++i)
  {
    wish.Tick = 0;
    wish.Options.Seed = i + 10;
    session.Wish(wish);
    const Clock::time_point begin = Clock::now();
    while (Since(begin) < 0.35 + 0.07 * i)
    {
    }
    const Clock::time_point cancel = Clock::now();
    session.Cancel();
    session.WaitIdle(60);
    waits.push_back(1000 * Since(cancel));
  }
  const double worst = *std::max_element(waits.begin(), waits.end());
  bench.Report("cancel of a frame, worst of 7", worst, "ms", "limit 100 ms", worst / 100);
}

#ifdef QUELL_BENCH_WINDOW
QUELL_BENCHMARK("svgf-window-640x360",
  "the same in the window, 1440 x 900, that a display shows (xvfb-run -a): frames a second while the mouse orbits, "
  "processor time of all of it")
{
  if (!std::getenv("DISPLAY"))
  {
    std::puts("svgf-window-640x360: left out, there is no display; run it under xvfb-run -a");
    return;
  }
  Window::Options w;
  w.Scale = 1;
  Window window(w);
  Viewer::Options options;
  options.Graph = Room();
  Viewer viewer(window, AllStages(), options);
  viewer.Open(QUELL_SOURCE_DIR "/Data/Pipelines/svgf.xml");
  Script none;
  ScriptRunner hand(window, viewer, none);
  hand.Settle();
  std::string error;
  if (!hand.Do("move image@0.3,0.5", error) || !hand.Do("key c", error) || !hand.Do("press left", error))
  {
    throw std::runtime_error(error);
  }
  const ImVec4 image = viewer.GetMarks().at("image");
  const Clock::time_point start = Clock::now();
  Clock::time_point moved = start;
  std::clock_t cpu = 0;
  int from = -1, last = 0, moves = 0;
  Clock::time_point counted = start;
  RunWindow(window, viewer,
    [&]
    {
      // A mouse that reports 60 times a second.
      if (Since(moved) > 1. / 60)
      {
        WindowEvent e;
        e.X = double(image.x) + 0.3 * double(image.z - image.x) + 0.3 * ++moves;
        e.Y = double(image.y + image.w) / 2;
        window.Send(e);
        moved = Clock::now();
      }
      const auto frame = viewer.Frame();
      const int live = frame ? frame->LiveTicks : 0;
      if (from < 0 && live >= 5)
      {
        from = live;
        counted = Clock::now();
        cpu = std::clock();
      }
      last = live;
      return Since(start) < 60 && !(from >= 0 && (live >= from + 30 || Since(counted) > 10));
    });
  const double seconds = Since(counted), frames = std::max(1, last - from);
  const double each = double(std::clock() - cpu) / CLOCKS_PER_SEC / frames;
  bench.Report("svgf-window-640x360 orbit", frames / seconds, "frames/s", "limit 5", frames / seconds / 5);
  bench.Report("svgf-window-640x360 orbit, processor time", 1000 * each, "ms", "two cores at 5 frames/s", each / 0.4);
}
#endif
