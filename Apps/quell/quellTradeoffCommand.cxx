// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellInterrupt.h"
#include "quellPipelineReader.h"
#include "quellProgressLine.h"
#include "quellTemporaryFile.h"
#include "quellTradeoff.h"
#include "quellTradeoffReport.h"

#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <unistd.h>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
/// "100ms", "0.1s", "100".
double ParseBudget(const std::string& text)
{
  std::string number = text;
  double unit = 1;
  const auto ends = [&](const std::string& end)
  { return number.size() > end.size() && number.compare(number.size() - end.size(), end.size(), end) == 0; };
  if (ends("ms"))
  {
    number.resize(number.size() - 2);
  }
  else if (ends("s"))
  {
    number.resize(number.size() - 1);
    unit = 1000;
  }
  double v = 0;
  std::string error;
  if (!detail::ParseDouble(number, 0, 1e9, v, error) || !(v > 0))
  {
    throw UsageError("--budget " + text + ": write milliseconds a frame, as 100ms or 0.5s");
  }
  return v * unit;
}

/// Whole or absent.
void WriteFile(const fs::path& file, const std::string& content)
{
  TemporaryFile temporary(file.string());
  temporary.Write(content);
  if (const int error = temporary.Rename())
  {
    throw StageError("cannot write \"" + file.string() + "\": " + std::strerror(error));
  }
}
}

int TradeoffCommand(const TradeoffArguments& a)
{
  TradeoffOptions options;
  options.Document = ReadDocument(a.File);
  if (!options.Document)
  {
    return ExitUsage;
  }
  options.Graph = GraphOptionsOf(a);
  options.Reference = a.Reference;
  options.Layer = a.Layer.empty() ? "radiance" : a.Layer;
  options.Metrics = a.Metrics;
  options.Output = a.Output;
  options.Seeds = a.Seeds;
  options.Repeats = a.Repeats;
  options.Directory = a.OutputDirectory;
  options.Graph.OutputDirectory.clear();
  options.Graph.Outside = OutsideOutputs::Allowed; // none of them is written
  options.Ledger = !a.NoLedger;
  if (!a.Budget.empty())
  {
    options.Budget = ParseBudget(a.Budget);
  }
  if (!a.Target.empty())
  {
    const auto target = Assignment(a.Target, "--target");
    double v = 0;
    std::string error;
    if (!detail::ParseDouble(target.second, -1e300, 1e300, v, error))
    {
      throw UsageError("--target " + a.Target + ": " + error);
    }
    options.Aim = { target.first, v };
  }
  try
  {
    for (const std::string& text : a.Vary)
    {
      options.Axes.push_back(ParseVary(text));
    }
    Combinations(options.Axes);
  }
  catch (const std::invalid_argument& e)
  {
    throw UsageError(e.what());
  }
  if (!a.Frames.empty())
  {
    Diagnostics messages;
    const auto graph = BuildGraph(options.Document, AllStages(), options.Graph, messages);
    if (!messages.HasErrors())
    {
      int first = 0, end = 1;
      ParseFrames(a.Frames, graph->Ticks, first, end);
      options.Frames = { first, end };
    }
  }
  const auto token = std::make_shared<CancelToken>();
  options.Token = token;
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  int before = -1;
  const bool terminal = isatty(STDERR_FILENO);
  const auto clear = [&]
  {
    if (terminal && before >= 0)
    {
      std::fputs("\r\033[K", stderr);
    }
  };
  double shown = 0;
  options.Progress = [&](int done, int all, const std::string& what)
  {
    const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
    if (before < 0)
    {
      before = done; // runs of an earlier sweep took no time
    }
    const std::string left =
      done > before ? ", " + DurationText(seconds / (done - before) * (all - done)) + " left" : std::string();
    if (terminal)
    {
      std::fprintf(stderr, "\r\033[Krun %d of %d%s: %.60s", done + 1, all, left.c_str(), what.c_str());
      std::fflush(stderr);
    }
    else if (!a.Quiet && (done == before || seconds > shown))
    {
      std::fprintf(stderr, "run %d of %d%s: %s\n", done + 1, all, left.c_str(), what.c_str());
      shown = std::max(2 * shown, 10.);
    }
  };
  std::unique_ptr<Tradeoff> sweep;
  try
  {
    sweep = std::make_unique<Tradeoff>(AllStages(), options);
  }
  catch (const StageError& e)
  {
    throw UsageError(e.what());
  }
  TradeoffReport report;
  {
    const InterruptScope interrupts(token.get(), "quell: stopping after this run; the same command goes on from here");
    report = sweep->Run();
  }
  clear();
  report.Version = QUELL_VERSION;
  const fs::path directory = a.OutputDirectory;
  WriteFile(directory / "tradeoff.csv", TradeoffCsv(report));
  WriteFile(directory / "tradeoff.json", TradeoffJson(report));
  WriteFile(directory / "report.html", TradeoffHtml(report, directory.string()));
  std::error_code ec;
  fs::remove(directory / "best.xml", ec); // of an earlier choice
  if (report.Chosen >= 0)
  {
    WriteFile(directory / "best.xml", sweep->PipelineText(report.Settings[std::size_t(report.Chosen)].Choice));
  }
  for (const std::string& note : report.Notes)
  {
    std::fprintf(stderr, "quell: %s\n", note.c_str());
  }
  std::printf("%swrote %s, tradeoff.csv, tradeoff.json%s\n", TradeoffText(report).c_str(),
    (directory / "report.html").c_str(), report.Chosen >= 0 ? ", best.xml" : "");
  std::fflush(stdout);
  if (token->IsFinishing() || token->IsCancelled())
  {
    std::fprintf(stderr, "quell: interrupted; the same command goes on with what is missing\n");
    return ExitInterrupted;
  }
  if ((!a.Budget.empty() || !a.Target.empty()) && report.Chosen < 0)
  {
    return ExitExceeded;
  }
  for (const SettingResult& s : report.Settings)
  {
    if (!s.Error.empty())
    {
      std::fprintf(stderr, "quell: error: %s: %s\n", ChoiceText(s.Choice).c_str(), s.Error.c_str());
      return ExitFailed;
    }
  }
  return ExitDone;
}
}
