// SPDX-License-Identifier: BSD-3-Clause
// quell-view [FILE] [--frame N] [--screenshot OUT.png]: the window, its loop, and ways to drive it without hands.
#include "../quellAllStages.h"
#include "quellCommandLine.h"
#include "quellLoop.h"
#include "quellScript.h"
#include "quellViewer.h"

#include <CLI/CLI.hpp>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

namespace
{
using namespace quell;

std::pair<std::string, std::string> Split(const std::string& text, const char* option)
{
  const std::size_t at = text.find('=');
  if (at == std::string::npos || at == 0)
  {
    throw CLI::ValidationError(option, text + " is not of the form name=value");
  }
  return { text.substr(0, at), text.substr(at + 1) };
}

int Run(int argc, char** argv)
{
  CLI::App app("Assembles, steers and inspects a Quell pipeline in a window.", "quell-view");
  app.set_version_flag("--version", "quell-view " QUELL_VERSION);
  app.failure_message(CLI::FailureMessage::simple);
  std::string file, show, screenshot, reference, replay, record, tab;
  std::vector<std::string> defines, sets;
  std::optional<long long> seed;
  std::optional<int> frame;
  std::vector<int> size;
  double scale = 0;
  bool plain = false, forget = false;
  app.add_option("FILE", file, "Pipeline (.xml), picture (.exr, .hdr, .png) or scene (.gltf, .glb, .obj)");
  app.add_option("--frame", frame, "Frame to show first")->type_name("N");
  app.add_option("--show", show, "What to show: an output, a node, or node:array")->type_name("WHAT");
  app.add_option("--reference", reference, "Picture to compare with")->type_name("FILE");
  app.add_option("-D", defines, "Give a variable of the file another value")
    ->type_name("NAME=VALUE")
    ->allow_extra_args(false);
  app.add_option("--set", sets, "Set a node's property")->type_name("NODE.PROPERTY=VALUE")->allow_extra_args(false);
  app.add_option("--seed", seed, "Set the property Seed of every node that has one")->type_name("N");
  app
    .add_option(
      "--screenshot", screenshot, "Write the window as PNG when the frame is done, and end; needs no visible window")
    ->type_name("OUT.png");
  app.add_option("--tab", tab, "Panel on the right: Node, Pixel, Compare, Trade, Pipeline")
    ->type_name("NAME")
    ->check(CLI::IsMember({ "Node", "Pixel", "Compare", "Trade", "Pipeline" }));
  app.add_option("--size", size, "Size of the window")
    ->type_name("W H")
    ->expected(2)
    ->allow_extra_args(false)
    ->check(CLI::Range(200, 8192));
  app.add_option("--scale", scale, "Size of text and controls; from the screen when not given")
    ->check(CLI::Range(0.5, 4.));
  app.add_option("--record", record, "Write what mouse and keyboard do to a script")->type_name("FILE");
  app.add_option("--replay", replay, "Do what a script says, and end")->type_name("FILE");
  app.add_flag("--plain", plain, "Show no times and nothing of this machine, for pictures that are compared");
  app.add_flag("--forget", forget, "Neither use nor keep remembered settings");
  try
  {
    app.parse(argc, argv);
  }
  catch (const CLI::ParseError& e)
  {
    return app.exit(e) == 0 ? 0 : 2;
  }

  if (!std::getenv("DISPLAY"))
  {
    std::fputs(
      "quell-view: error: there is no display ($DISPLAY is not set); without a screen run it under xvfb-run -a\n",
      stderr);
    return 2;
  }
  const bool driven = !screenshot.empty() || !replay.empty();
  Viewer::Options options;
  for (const std::string& d : defines)
  {
    options.Graph.Defines.push_back(Split(d, "-D"));
  }
  for (const std::string& s : sets)
  {
    options.Graph.Properties.push_back(Split(s, "--set"));
  }
  options.Graph.Seed = seed;
  options.Frame = frame;
  options.Show = show;
  options.Reference = reference;
  options.Plain = plain;
  options.SettingsFile = forget || driven ? std::string() : Settings::DefaultFile();

  if (const CommandLineFault fault = CheckCommandLine(file, options, AllStages()))
  {
    std::fprintf(stderr, "quell-view: error: %s\n", fault.Text.c_str());
    return fault.Status;
  }

  Settings remembered;
  remembered.Load(options.SettingsFile);
  Window::Options w;
  w.OffScreen = driven;
  w.SharesClipboard = !driven;
  w.Width = size.empty() ? int(remembered.Number("window.width", 1440, 400, 8192)) : size[0];
  w.Height = size.empty() ? int(remembered.Number("window.height", 900, 300, 8192)) : size[1];
  w.Scale = driven && !(scale > 0) ? 1 : scale;
  Script script;
  if (!replay.empty())
  {
    std::string error;
    if (!script.Load(replay, error))
    {
      std::fprintf(stderr, "quell-view: error: %s\n", error.c_str());
      return 2;
    }
    if (script.Width > 0 && size.empty())
    {
      w.Width = script.Width;
      w.Height = script.Height;
    }
  }
  Window window(w);
  Recorder recorder(record);
  if (!record.empty())
  {
    window.SetRecorder([&recorder, &window](const WindowEvent& e) { recorder.Take(e, window); });
  }
  Viewer viewer(window, AllStages(), options);
  bool opened = true;
  if (!file.empty())
  {
    opened = viewer.Open(file);
  }
  if (!tab.empty())
  {
    viewer.ShowTab(tab);
  }
  if (driven)
  {
    ScriptRunner runner(window, viewer, script);
    window.SetBlind(true);
    if (!replay.empty())
    {
      std::string error;
      if (!runner.Run(error))
      {
        std::fprintf(stderr, "quell-view: error: %s\n", error.c_str());
        return 1;
      }
    }
    if (!screenshot.empty())
    {
      runner.Settle();
      window.Screenshot(screenshot);
    }
    const std::string error = viewer.ErrorText();
    if (!error.empty() && !screenshot.empty())
    {
      std::fprintf(stderr, "%s\n", error.c_str());
      return opened ? 1 : 2;
    }
    return 0;
  }

  RunWindow(window, viewer);
  return 0;
}
}

int main(int argc, char** argv)
{
  try
  {
    return Run(argc, argv);
  }
  catch (const CLI::ParseError& e)
  {
    std::fprintf(stderr, "quell-view: error: %s\n", e.what());
    return 2;
  }
  catch (const std::exception& e)
  {
    std::fprintf(stderr, "quell-view: error: %s\n", e.what());
    return 1;
  }
}
