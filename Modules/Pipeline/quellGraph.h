// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGraph_h
#define quellGraph_h

#include "quellPipelineDocument.h"
#include "quellStageRegistry.h"
#include "vtkQuellPipelineModule.h"
#include "vtkQuellStage.h"
#include "vtkSmartPointer.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// What becomes of output files that a pipeline wants outside of the output directory: by absolute paths, `..`, symbolic
/// links or variables. Whoever only reads pipelines need not care; what writes their outputs should not trust them.
enum class OutsideOutputs
{
  Allowed,
  Refused, ///< an error; not for names that GraphOptions give
  Moved    ///< to a folder "outside" in the output directory, numbered; for runs whose files are thrown away
};

/// What the command line (or a viewer) says on top of the file. Relative paths in here are the working directory's.
struct GraphOptions
{
  using Assignments = std::vector<std::pair<std::string, std::string>>;
  Assignments Defines;           ///< variable -> value
  Assignments Properties;        ///< "node.Property" -> value; inner nodes as "indirect/atrous.PhiColor"
  Assignments Outputs;           ///< an output's name or "node:array" -> file
  std::optional<long long> Seed; ///< property Seed of every node that has one
  std::string OutputDirectory;   ///< relative output files are put here; empty: working directory
  OutsideOutputs Outside = OutsideOutputs::Allowed;
};

/// One connection of a node's input.
struct GraphEdge
{
  int Port = 0;
  int Connection = 0; ///< index among the connections of this port
  int Producer = -1;  ///< index into Graph::Nodes
  std::string Array;
  bool Delayed = false;
  std::vector<std::pair<std::string, std::string>> Attributes;
  SourceLocation Place;
};

struct GraphProperty
{
  std::string Name, Text; ///< expanded; paths resolved
  SourceLocation Place;
};

/// A node after templates are expanded: "pt", "indirect/atrous", or made for an output: "beauty:view", "beauty:write".
struct GraphNode
{
  std::string Path, Type;
  std::vector<GraphProperty> Properties;
  std::vector<GraphEdge> Inputs;
  /// Has the properties set, but no connections; what checks and editors ask. Executors make their own.
  vtkSmartPointer<vtkQuellStage> Stage;
  SourceLocation Place;
  std::vector<std::string> Context; ///< instances it is in, innermost first, as sentences
  bool Internal = false;            ///< made for an output
  std::vector<std::string> LeftOut; ///< optional inputs whose producer has no such array, as sentences

  const StageDescription& Description() const { return this->Stage->GetDescription(); }
};

struct GraphOutput
{
  std::string Name;
  int Node = -1; ///< producer
  std::string Array;
  std::string File; ///< empty: only a name
  int Writer = -1;  ///< the ImageWriter node, when there is a file
  SourceLocation Place;

  /// A file without #### holds one frame: it is written for the last one of a run.
  bool EveryFrame() const { return this->File.find('#') != std::string::npos; }
};

/// A pipeline ready to run: flat, expanded, checked.
struct VTKQUELLPIPELINE_EXPORT Graph
{
  std::vector<GraphNode> Nodes;
  std::vector<GraphOutput> Outputs;
  Timeline Ticks;
  std::map<std::string, std::string> Variables; ///< name -> value in force
  std::vector<int> Order;                       ///< producers before readers (delayed edges left out)
  std::shared_ptr<const PipelineDocument> Document;
  GraphOptions Options;

  int Find(const std::string& path) const; ///< -1: none
  const GraphOutput* FindOutput(const std::string& name) const;
  /// Arrays that a node can be asked for: described, dynamic and passed through from port 0.
  std::vector<OutputArray> Arrays(int node) const;
  /// Nodes that `targets` need, over normal and delayed edges.
  std::vector<bool> Needed(const std::vector<int>& targets) const;
};

/// Expands and checks. All mistakes are collected; the graph may be used only when there is no error.
VTKQUELLPIPELINE_EXPORT std::shared_ptr<Graph> BuildGraph(std::shared_ptr<const PipelineDocument> document,
  const StageRegistry& registry, const GraphOptions& options, Diagnostics& diagnostics);

/// ReadPipelineFile and BuildGraph; sorts the diagnostics. Null after an error.
VTKQUELLPIPELINE_EXPORT std::shared_ptr<Graph> LoadPipeline(
  const std::string& file, const StageRegistry& registry, const GraphOptions& options, Diagnostics& diagnostics);
}

#endif
