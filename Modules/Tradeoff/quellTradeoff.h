// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTradeoff_h
#define quellTradeoff_h

#include "quellGraph.h"
#include "quellVary.h"
#include "vtkQuellTradeoffModule.h"

#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace quell
{
class CancelToken;

/// What a sweep measures and how. Settings = all combinations of the axes; each is run once per round, with the seed of
/// the round; rounds visit the settings forwards and backwards in turn, so that a machine that becomes slower meanwhile
/// is not taken for a slower setting.
struct TradeoffOptions
{
  std::shared_ptr<const PipelineDocument> Document;
  GraphOptions Graph; ///< of all settings; Seed is the first seed, 1 when not given
  std::vector<VaryAxis> Axes;
  int Seeds = 4;      ///< independent noise; 1 where no node has a Seed
  int Repeats = 3;    ///< at least so many rounds, for the times
  std::string Output; ///< name of the measured output; empty: the first one
  std::string Reference, Layer = "radiance";
  std::vector<std::string> Metrics; ///< the first one decides; empty: relMSE, FLIP, SSIM
  /// Frames measured, [First, End); without: the last one, of pipelines without history the first one. What the history
  /// needs before is computed.
  std::optional<std::pair<int, int>> Frames;
  std::string Directory; ///< made; holds the runs, from which an interrupted sweep goes on
  bool Ledger = true;
  double Budget = 0;                                 ///< milliseconds a frame; 0: none
  std::optional<std::pair<std::string, double>> Aim; ///< metric and the value that it must reach
  std::shared_ptr<CancelToken> Token;
  /// Runs done and to do so far, what is at work.
  std::function<void(int done, int all, const std::string& what)> Progress;
};

/// Median and quartiles.
struct Spread
{
  double Low = 0, Middle = 0, High = 0;
};
VTKQUELLTRADEOFF_EXPORT Spread SpreadOf(std::vector<double> values);

struct SettingResult
{
  VaryChoice Choice;
  std::string Left;  ///< of a ledger row: the node that is left out
  std::string Error; ///< why it could not be run; then nothing below
  int Runs = 0, Seeds = 0;
  Spread Milliseconds;       ///< a frame, all stages but readers and writers of files
  Spread FilterMilliseconds; ///< the same without sources
  struct Value
  {
    double Mean = 0;
    double StandardError = std::numeric_limits<double>::quiet_NaN(); ///< of the mean over seeds; NaN for one seed
  };
  std::map<std::string, Value> Metrics;
  /// relMSE = bias + variance of the last frame: with t the runs' mean, s^2 their variance at a pixel, K runs and r the
  /// reference, bias^2 = mean of ((t - r)^2 - s^2 / K) / (r^2 + 0.01) and variance = mean of s^2 / (r^2 + 0.01). NaN
  /// for one seed. Noise of the reference counts as bias.
  double BiasSquared = std::numeric_limits<double>::quiet_NaN(), Variance = BiasSquared;
  std::map<std::string, Spread> Nodes; ///< milliseconds a frame
  bool Pareto = false;                 ///< no other setting is both faster and better
  std::string Picture;                 ///< PNG of the first seed's last frame, relative to the directory
};

struct TradeoffReport
{
  std::string Pipeline, Reference, Output, Machine, Version;
  std::vector<std::string> Metrics;
  int FirstFrame = 0, EndFrame = 1, Width = 0, Height = 0, FirstSeed = 1, Seeds = 1, Rounds = 1;
  std::vector<SettingResult> Settings, Ledger;
  int Chosen = -1;        ///< among Settings; -1: none was asked for, or none does
  std::string ChosenText; ///< "the best within 100 ms", or why there is none
  int LedgerOf = 0;       ///< setting that the ledger's rows leave a node out of
  std::vector<std::string> NodeOrder, Notes;
};

/// A setting that cannot run at all (a value out of range, a node that cannot be left out) is refused before anything
/// runs: throws StageError, with the diagnostics. Also for a missing reference, another size, another sweep in the
/// directory. Cancelled: returns what there is, with Runs less than Rounds.
class VTKQUELLTRADEOFF_EXPORT Tradeoff
{
public:
  Tradeoff(const StageRegistry& registry, TradeoffOptions options);
  ~Tradeoff();
  Tradeoff(const Tradeoff&) = delete;
  void operator=(const Tradeoff&) = delete;

  TradeoffReport Run();
  /// The setting as a pipeline file of its own.
  std::string PipelineText(const VaryChoice& choice) const;

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};

/// The best by the first metric among those within the budget, or the fastest that reaches the aim; -1 with a sentence.
VTKQUELLTRADEOFF_EXPORT int ChooseSetting(const std::vector<SettingResult>& settings, const std::string& metric,
  double budget, const std::optional<std::pair<std::string, double>>& aim, std::string& text);
/// Sets Pareto of all settings, by the first metric and the median time.
VTKQUELLTRADEOFF_EXPORT void MarkPareto(std::vector<SettingResult>& settings, const std::string& metric);
}

#endif
