// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellProvenance_h
#define quellProvenance_h

#include "quellGraph.h"
#include "vtkQuellPipelineModule.h"

#include <cstdint>
#include <map>
#include <string>

namespace quell
{
/// The pipeline of a graph with everything the command line said written into it, so that its text alone makes the same
/// graph again: includes resolved, -D as the variables' defaults, --set and --seed as properties (a template is copied
/// for the instance whose inner node is set), --output as outputs, input paths absolute. Output files stay relative.
/// What only the replaced texts used (a variable, a template) is left out.
///
/// Adds a warning for every setting that cannot be written (a node whose id is made from a template's parameter).
VTKQUELLPIPELINE_EXPORT std::shared_ptr<PipelineDocument> SelfContained(
  const Graph& graph, const StageRegistry& registry, Diagnostics& diagnostics);

///@{
/// Path properties of the nodes: absolute file name -> hash of its bytes (HashHex). What cannot be read is left out.
/// Only the named files are hashed, not what they refer to. Of sequences (####): the files of one tick.
VTKQUELLPIPELINE_EXPORT std::map<std::string, std::string> InputHashes(const Graph& graph);
VTKQUELLPIPELINE_EXPORT std::map<std::string, std::string> SequenceHashes(const Graph& graph, int tick);
///@}

/// 64-bit hash of bytes, for telling files apart, not against forgery: FNV-1a over 64-bit little-endian words, the last
/// one padded with zeros, then over the number of bytes. Feed it in pieces.
class VTKQUELLPIPELINE_EXPORT ContentHash
{
public:
  void Add(const void* data, std::size_t bytes);
  std::uint64_t Value() const;
  std::string Hex() const; ///< of Value(), 16 digits

private:
  void Word(std::uint64_t w) { this->State = (this->State ^ w) * 1099511628211ull ^ (this->State >> 29); }
  std::uint64_t State = 14695981039346656037ull, Length = 0;
  unsigned char Rest[8] = {};
  std::size_t Pending = 0;
};
VTKQUELLPIPELINE_EXPORT std::string HashHex(const std::string& bytes);
}

#endif
