// SPDX-License-Identifier: BSD-3-Clause
// The command line: what it takes is declared here, what it does is in the *Command.cxx files.
#include "quellCommands.h"
#include "vtkSMPTools.h"

#include <CLI/CLI.hpp>
#include <tbb/global_control.h>

#include <csignal>
#include <cstdio>
#include <iostream>
#include <exception>
#include <memory>

namespace quell
{
std::pair<std::string, std::string> Assignment(const std::string& text, const std::string& option)
{
  const std::size_t at = text.find('=');
  if (at == std::string::npos || at == 0)
  {
    throw UsageError(option + " " + text + ": not of the form name=value");
  }
  return { text.substr(0, at), text.substr(at + 1) };
}
}

namespace
{
void AddPipelineOptions(CLI::App* app, quell::PipelineArguments& a)
{
  app->add_option("FILE", a.File, "Pipeline file, or an EXR that a run wrote: the pipeline in it")->required();
  app->add_option("-D", a.Defines, "Give a variable of the file another value")
    ->type_name("NAME=VALUE")
    ->allow_extra_args(false);
  app->add_option("--set", a.Sets, "Set a node's property; inner nodes as indirect/atrous.PhiColor")
    ->type_name("NODE.PROPERTY=VALUE")
    ->allow_extra_args(false);
  app->add_option("--seed", a.Seed, "Set the property Seed of every node that has one")->type_name("N");
  app->add_option("--frames", a.Frames, "Frames A to B; N alone is one frame")->type_name("A:B");
  app
    ->add_option("--warmup-tolerance", a.WarmUpTolerance,
      "Weight that frames before those computed may have had in the first one asked, default 0.001; 0 computes all "
      "frames")
    ->type_name("T")
    ->check(CLI::Range(0., 1.))
    ->check(CLI::Validator(
      [](std::string& text) // the range lets NaN pass
      {
        double value = 0;
        std::string error;
        return quell::detail::ParseDouble(text, 0, 1, value, error) ? std::string() : error;
      },
      ""));
  app->add_option("--region", a.Region, "Part of the frame: pixels from the top left corner, half open")
    ->type_name("X0,Y0,X1,Y1");
  app->add_option("--output", a.Outputs, "Write an output, or any array as NODE:ARRAY, to a file")
    ->type_name("NAME=FILE")
    ->allow_extra_args(false);
  app->add_option("--out", a.OutputDirectory, "Directory for relative output files")->type_name("DIR");
  const CLI::Validator positive(
    [](const std::string& text)
    {
      double value = 0;
      std::string error;
      const bool good = quell::detail::ParseDouble(text, 0, 1e300, value, error) && value > 0;
      return good ? std::string() : quell::Quoted(text) + " is not a positive number";
    },
    "");
  app->add_flag("--allow-outside", a.AllowOutside,
    "Let the pipeline write to files outside of the working directory or DIR; what --output and --set name may lie "
    "anywhere");
  app
    ->add_option("--memory", a.MemoryMegabytes,
      "Make each frame in bands of rows where the run would need more than this many 10^6 bytes (arrays, the stages' "
      "scratch and 170 for the program), or refuse to start where bands do not do; scenes come on top. "
      "Default: a quarter of the machine's memory, three quarters where bands do not do")
    ->type_name("MB")
    ->check(positive);
  app
    ->add_option("--scene-memory", a.SceneMemoryMegabytes,
      "Refuse scenes whose vertices, textures and instances take more; default half of the machine's memory")
    ->type_name("MB")
    ->check(positive);
}
}

namespace
{
int Run(int argc, char** argv)
{
  CLI::App app("Quell: node-graph image pipelines that turn noisy path-traced frames into clean ones.", "quell");
  app.set_version_flag("--version", "quell " QUELL_VERSION);
  app.require_subcommand(1);
  app.failure_message(CLI::FailureMessage::simple);

  quell::RunArguments run;
  int threads = 0;
  CLI::App* runApp = app.add_subcommand("run", "Run a pipeline");
  AddPipelineOptions(runApp, run);
  runApp->add_flag("--resume", run.Resume, "Go on after the last frame that an earlier run finished");
  runApp->add_option("--threads", threads, "Threads to use; all when not given")
    ->type_name("N")
    ->check(CLI::Range(1, 4096));
  runApp->add_option("--stats", run.Stats, "Write counters and seconds of every node as JSON")->type_name("FILE.json");
  runApp->add_flag("--quiet", run.Quiet, "No progress");

  runApp->add_flag("--times", run.Times, "At the end, what every node was estimated to take and what it took");

  quell::ExplainArguments explain;
  CLI::App* explainApp = app.add_subcommand("explain", "Say what a run would do, and do nothing");
  AddPipelineOptions(explainApp, explain);
  CLI::Option* dot = explainApp->add_flag("--dot", explain.Dot, "As a Graphviz graph");
  explainApp->add_flag("--json", explain.Json, "As JSON")->excludes(dot);

  std::string checked;
  CLI::App* checkApp = app.add_subcommand("check", "Report every mistake of a pipeline file");
  checkApp->add_option("FILE", checked, "Pipeline file, or an EXR that a run wrote")->required();
  bool checkOutside = false;
  checkApp->add_flag(
    "--allow-outside", checkOutside, "Files outside of the working directory are no mistake (see quell run)");

  quell::NodesArguments nodes;
  CLI::App* nodesApp = app.add_subcommand("nodes", "List stage types, or describe one");
  nodesApp->add_option("TYPE", nodes.Type, "Stage type");
  CLI::Option* markdown = nodesApp->add_flag("--markdown", nodes.Markdown, "Reference as Markdown");
  CLI::Option* xsd = nodesApp->add_flag("--xsd", nodes.Xsd, "XML Schema of pipeline files")->excludes(markdown);
  nodesApp->add_flag("--json", nodes.Json, "As JSON")->excludes(markdown)->excludes(xsd);

  std::string inspected;
  bool inspectJson = false;
  CLI::App* inspectApp = app.add_subcommand("inspect", "Layers of an image file: roles, ranges, non-finite pixels");
  inspectApp->add_option("FILE", inspected, "Image file")->required();
  inspectApp->add_flag("--json", inspectJson, "As JSON");

  quell::CompareArguments compare;
  CLI::App* compareApp = app.add_subcommand("compare", "Errors of an image or a sequence against a reference");
  compareApp->add_option("TEST", compare.Test, "Image file; #### stands for the frame number of a sequence")
    ->required();
  compareApp->add_option("REFERENCE", compare.Reference, "Image file, or with #### one for each frame")->required();
  compareApp
    ->add_option("--layer", compare.Layers, "Array to compare, default radiance; all: every one that both files have")
    ->type_name("L ...")
    ->allow_extra_args(false);
  compareApp->add_option("--frames", compare.Frames, "Frames A to B of a sequence; default all that are there")
    ->type_name("A:B");
  compareApp->add_flag("--percentiles", compare.Percentiles,
    "Also what the first metric is at most in 50, 90, 99 and 99.9 % of the pixels");
  compareApp->add_option("--metric", compare.Metrics, "Metric to compute; may be given several times")
    ->type_name("NAME")
    ->allow_extra_args(false);
  compareApp->add_option("--max", compare.Maxima, "Exit with status 3 when a metric is above this")
    ->type_name("NAME=VALUE")
    ->allow_extra_args(false);
  compareApp->add_flag("--json", compare.Json, "As JSON");
  compareApp
    ->add_option("--map", compare.Map,
      "Write the first metric's value of each pixel as a picture (.exr: as numbers); "
      "with several layers OUT.LAYER.png, of a sequence with #### one a frame")
    ->type_name("OUT.png");

  quell::VerifyArguments verify;
  CLI::App* verifyApp =
    app.add_subcommand("verify", "Run again what an image says it was made by, and compare every bit");
  verifyApp->add_option("FILE", verify.File, "EXR that quell run wrote")->required();
  verifyApp->add_flag("--json", verify.Json, "As JSON");
  verifyApp->add_option("--threads", threads, "Threads to use; all when not given")
    ->type_name("N")
    ->check(CLI::Range(1, 4096));
  verifyApp->add_flag("--quiet", verify.Quiet, "No progress");

  quell::CalibrateArguments calibrate;
  CLI::App* calibrateApp =
    app.add_subcommand("calibrate", "Measure what stages cost on this machine, for the estimates of explain and run");
  calibrateApp->add_option("FILE", calibrate.Files, "Pipeline files whose stages are measured; nothing is written")
    ->required();
  calibrateApp->add_option("-D", calibrate.Defines, "Give a variable of the files another value")
    ->type_name("NAME=VALUE ...");
  calibrateApp->add_option("--repeats", calibrate.Frames, "Frames to measure after the first one, default 4")
    ->type_name("N")
    ->check(CLI::Range(1, 1000));
  calibrateApp
    ->add_option("--out", calibrate.Out,
      "Where the costs are kept; default $QUELL_COSTS, else quell/costs.json in $XDG_CACHE_HOME or ~/.cache")
    ->type_name("FILE.json");
  calibrateApp->add_option("--threads", threads, "Threads to use; all when not given")
    ->type_name("N")
    ->check(CLI::Range(1, 4096));
  calibrateApp->add_flag("--quiet", calibrate.Quiet, "No progress");

  quell::TradeoffArguments tradeoff;
  CLI::App* tradeoffApp = app.add_subcommand("tradeoff", "Measure speed against accuracy over settings of a pipeline");
  tradeoffApp->add_option("FILE", tradeoff.File, "Pipeline file, or an EXR that a run wrote")->required();
  tradeoffApp->add_option("--reference", tradeoff.Reference, "Image without noise; #### stands for the frame")
    ->type_name("REF.exr")
    ->required();
  tradeoffApp
    ->add_option("--vary", tradeoff.Vary,
      "NODE.PROPERTY or VARIABLE = values: a list 1,2,4; FROM..TO/COUNT in equal steps, FROM..TO*COUNT in equal "
      "ratios; "
      "NODE=on,off leaves a node out. Several make all combinations")
    ->type_name("WHAT=VALUES")
    ->allow_extra_args(false);
  tradeoffApp->add_option("--seeds", tradeoff.Seeds, "Runs with seeds of their own, default 4")
    ->type_name("N")
    ->check(CLI::Range(1, 10000));
  tradeoffApp->add_option("--repeats", tradeoff.Repeats, "At least so many runs, for the times, default 3")
    ->type_name("N")
    ->check(CLI::Range(1, 10000));
  tradeoffApp
    ->add_option("--metric", tradeoff.Metrics, "Errors to compute, the first one decides; default relMSE, FLIP, SSIM")
    ->type_name("NAME")
    ->allow_extra_args(false);
  CLI::Option* budget =
    tradeoffApp->add_option("--budget", tradeoff.Budget, "Choose the best that takes no longer a frame, as 100ms")
      ->type_name("MS");
  tradeoffApp->add_option("--target", tradeoff.Target, "Choose the fastest that reaches this")
    ->type_name("METRIC=VALUE")
    ->excludes(budget);
  tradeoffApp->add_option("--output", tradeoff.Output, "Output of the pipeline to measure, default the first")
    ->type_name("NAME");
  tradeoffApp->add_option("--layer", tradeoff.Layer, "Array of the reference, default radiance")->type_name("L");
  tradeoffApp->add_flag("--no-ledger", tradeoff.NoLedger, "Do not measure what each node buys by leaving it out");
  tradeoffApp
    ->add_option("--out", tradeoff.OutputDirectory, "Directory for the report; an interrupted sweep goes on in it")
    ->type_name("DIR")
    ->required();
  tradeoffApp->add_option("-D", tradeoff.Defines, "Give a variable of the file another value")
    ->type_name("NAME=VALUE")
    ->allow_extra_args(false);
  tradeoffApp->add_option("--set", tradeoff.Sets, "Set a node's property")
    ->type_name("NODE.PROPERTY=VALUE")
    ->allow_extra_args(false);
  tradeoffApp->add_option("--seed", tradeoff.Seed, "The first seed, default 1")->type_name("N");
  tradeoffApp
    ->add_option("--frames", tradeoff.Frames, "Frames to measure; default the last one, without history the first")
    ->type_name("A:B");
  tradeoffApp->add_option("--threads", threads, "Threads to use; all when not given")
    ->type_name("N")
    ->check(CLI::Range(1, 4096));
  tradeoffApp->add_flag("--quiet", tradeoff.Quiet, "No progress");

  try
  {
    app.parse(argc, argv);
  }
  catch (const CLI::ParseError& e)
  {
    if (argc > 1 && argv[1][0] != '-' && app.get_subcommands().empty())
    {
      std::vector<std::string> names;
      for (const CLI::App* command : app.get_subcommands([](CLI::App*) { return true; }))
      {
        names.push_back(command->get_name());
      }
      const std::string near = quell::NearestName(argv[1], names);
      std::string all;
      for (const std::string& name : names)
      {
        all += (all.empty() ? "" : ", ") + name;
      }
      std::fprintf(stderr, "quell: error: no command %s; %s\n", quell::Quoted(argv[1]).c_str(),
        near.empty() ? ("commands: " + all).c_str() : ("did you mean " + near + "?").c_str());
      return quell::ExitUsage;
    }
    return app.exit(e) == 0 ? quell::ExitDone : quell::ExitUsage;
  }

  // Embree and VTK share TBB's pool.
  std::unique_ptr<tbb::global_control> limit;
  if (threads > 0)
  {
    limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
    vtkSMPTools::Initialize(threads);
  }
  try
  {
    if (*runApp)
    {
      return quell::RunCommand(run);
    }
    if (*explainApp)
    {
      return quell::ExplainCommand(explain);
    }
    if (*checkApp)
    {
      return quell::CheckCommand(checked, checkOutside);
    }
    if (*nodesApp)
    {
      return quell::NodesCommand(nodes);
    }
    if (*inspectApp)
    {
      return quell::InspectCommand(inspected, inspectJson);
    }
    if (*verifyApp)
    {
      return quell::VerifyCommand(verify);
    }
    if (*calibrateApp)
    {
      return quell::CalibrateCommand(calibrate);
    }
    if (*tradeoffApp)
    {
      return quell::TradeoffCommand(tradeoff);
    }
    return quell::CompareCommand(compare);
  }
  catch (const quell::UsageError& e)
  {
    std::fprintf(stderr, "quell: error: %s\n", e.what());
    return quell::ExitUsage;
  }
  catch (const std::bad_alloc&)
  {
    std::fprintf(stderr, "quell: error: there is not enough memory\n");
    return quell::ExitFailed;
  }
  catch (const std::exception& e)
  {
    std::fprintf(stderr, "quell: error: %s\n", e.what());
    return quell::ExitFailed;
  }
}
}

int main(int argc, char** argv)
{
  // A reader that is gone and a file that may not grow are errors like others: the frame's file must not stay half
  // written, the exit status be ours.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  const int status = Run(argc, argv);
  // What was printed may be the result: a full disk behind it is a failure.
  std::cout.flush();
  if ((std::fflush(stdout) != 0 || std::ferror(stdout) || !std::cout) && status == quell::ExitDone)
  {
    std::fprintf(stderr, "quell: error: cannot write to standard output\n");
    return quell::ExitFailed;
  }
  return status;
}
