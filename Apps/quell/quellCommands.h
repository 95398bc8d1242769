// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCommands_h
#define quellCommands_h

#include "../quellAllStages.h"
#include "quellExplain.h"
#include "quellGraph.h"
#include "quellPipelineExecutor.h"
#include "quellStageRegistry.h"

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// The program's exit statuses; scripts depend on them.
enum ExitStatus
{
  ExitDone = 0,
  ExitFailed = 1,
  ExitUsage = 2,
  ExitExceeded = 3,
  ExitInterrupted = 130
};

/// A command line that cannot be obeyed: printed as `quell: error: ...`, exit status 2.
struct UsageError : std::runtime_error
{
  using std::runtime_error::runtime_error;
};

/// What run and explain take alike.
struct PipelineArguments
{
  std::string File;
  std::vector<std::string> Defines, Sets, Outputs;
  std::optional<long long> Seed;
  std::string Frames, Region, OutputDirectory;
  double WarmUpTolerance = 1e-3;
  double MemoryMegabytes = 0;      ///< 0: a quarter of the machine's; three where bands do not do
  double SceneMemoryMegabytes = 0; ///< 0: half of the machine's
  bool DiscardsOutputs = false;    ///< files are thrown away: those outside are put elsewhere
  bool AllowOutside = false;       ///< the pipeline may write outside of OutputDirectory
};
struct RunArguments : PipelineArguments
{
  std::string Stats;
  bool Times = false;
  bool Quiet = false, Resume = false;
};
struct ExplainArguments : PipelineArguments
{
  bool Dot = false, Json = false;
};
struct NodesArguments
{
  std::string Type;
  bool Markdown = false, Xsd = false, Json = false;
};
struct CompareArguments
{
  std::string Test, Reference, Map, Frames;
  std::vector<std::string> Layers, Metrics, Maxima;
  bool Json = false, Percentiles = false;
};

struct VerifyArguments
{
  std::string File;
  bool Json = false, Quiet = false;
};
struct CalibrateArguments
{
  std::vector<std::string> Files, Defines;
  std::string Out;
  int Frames = 4;
  bool Quiet = false;
};
struct TradeoffArguments : PipelineArguments
{
  std::string Reference, Layer, Output, Budget, Target;
  std::vector<std::string> Vary, Metrics;
  int Seeds = 4, Repeats = 3;
  bool NoLedger = false, Quiet = false;
};

int RunCommand(const RunArguments& arguments);
int ExplainCommand(const ExplainArguments& arguments);
int CheckCommand(const std::string& file, bool allowOutside);
int NodesCommand(const NodesArguments& arguments);
int CompareCommand(const CompareArguments& arguments);
int VerifyCommand(const VerifyArguments& arguments);
int TradeoffCommand(const TradeoffArguments& arguments);
int CalibrateCommand(const CalibrateArguments& arguments);
int InspectCommand(const std::string& file, bool json);

/// "name=value" at the first `=`; throws UsageError naming `option`.
std::pair<std::string, std::string> Assignment(const std::string& text, const std::string& option);

/// A pipeline loaded for a run: graph, executor, frames, region. Diagnostics go to stderr.
struct PreparedRun
{
  std::shared_ptr<Graph> Pipeline;
  std::unique_ptr<PipelineExecutor> Executor;
  std::optional<DisplayRegion> Region;
  int First = 0, End = 1;
  HistoryPlan History;
};
/// A pipeline file, or an image that a run wrote, with the pipeline in it. Diagnostics are printed; null after an
/// error. Throws UsageError for an image without pipeline.
std::shared_ptr<Graph> LoadPipelineOrImage(const std::string& file, const GraphOptions& options, int& errors);
/// The same, not yet made a graph; null after an error.
std::shared_ptr<const PipelineDocument> ReadDocument(const std::string& file);
/// -D, --set, --output, --seed, --out and --allow-outside.
GraphOptions GraphOptionsOf(const PipelineArguments& arguments);
/// "A:B" are frames A to B, both of them, "N" is one; `end` is one behind the last. Empty: all. Throws UsageError.
void ParseFrames(
  const std::string& text, const Timeline& ticks, int& first, int& end, const std::string& whose = "the pipeline");
/// Throws UsageError where --stats `file` is one that the run reads or writes otherwise.
void CheckStatistics(const std::string& file, const PipelineArguments& a, const PreparedRun& run);
/// The plan of a run, in bands where --memory, or without it the machine's memory, asks for that; throws UsageError when
/// it needs more all the same.
ExecutionPlan CheckedPlan(const PipelineArguments& arguments, PreparedRun& run);
/// What stages cost, of this machine where it was measured; a file that cannot be read is warned of.
CostModel LoadCosts();
int ThreadCount();
/// False after an error that is already printed (exit status 2). Throws UsageError.
bool PrepareRun(const PipelineArguments& arguments, PreparedRun& run);
}

#endif
