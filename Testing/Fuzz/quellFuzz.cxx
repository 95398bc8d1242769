// SPDX-License-Identifier: BSD-3-Clause
// quell-fuzz [options, see quellFuzzWatch.h] FILE|DIRECTORY...
//
// Reads mutated pipeline files with every stage type in place. Promises:
// - loading ends with a graph or with an error that says where; messages are one line of readable text each, not too
//   long;
// - what was read can be written, and reads back as the same document;
// - a file that loads is valid for the schema; its self-contained form loads as well; a plan of it can be made.
#include "../AllStages.h"
#include "../Graphs/SchemaTools.h"
#include "quellExplain.h"
#include "quellFuzz.h"
#include "quellFuzzTools.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"
#include "quellPipelineSchema.h"
#include "quellPipelineWriter.h"
#include "quellProvenance.h"
#include "quellXmlDocument.h"
#include "vtkObject.h"

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <stdexcept>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
std::vector<FuzzCase> ReadSeeds(const std::vector<std::string>& paths)
{
  std::vector<FuzzCase> seeds;
  for (const fs::path& file : SeedFiles(paths, ".xml"))
    seeds.push_back({ file.string(), Contents(file) });
  return seeds;
}

/// Throws what promise was broken. True: the file loads.
bool CheckDocument(const FuzzCase& document, const SchemaValidator& schema, const std::string& wanted)
{
  Diagnostics messages;
  const auto read = ReadPipelineText(document.Text, document.Name, messages);
  Promise(read != nullptr, "no document");
  const bool parsed = read->Place.Line > 0;
  Promise(parsed || messages.HasErrors(), "neither a document nor an error");
  Diagnostics grammar = messages;
  std::shared_ptr<Graph> graph;
  if (parsed)
    graph = BuildGraph(read, Registry(), {}, messages);
  messages.Sort();
  std::size_t length = 0;
  for (const Diagnostic& d : messages.All())
  {
    const std::string text = d.ToText();
    length = std::max(length, text.size());
    Promise(!d.What.empty() && !d.Place.File.empty(), "an error without words or file");
    Promise(d.Place.Line > 0 || document.Text.size() > XmlLimits().Bytes, "an error without a line: " + text);
    Promise(IsReadable(d.Where + d.What + d.Hint), "an error with control characters: " + text);
  }
  Promise(length < 20000, "an error of " + std::to_string(length) + " characters");
  Promise(wanted.empty() || messages.ToText().find(wanted) != std::string::npos,
    "no message \"" + wanted + "\" in\n" + messages.ToText().substr(0, 2000));
  if (parsed && !grammar.HasErrors())
  {
    const std::string text = WritePipelineText(*read);
    Diagnostics again;
    const auto second = ReadPipelineText(text, document.Name, again);
    // Escapes and indentation make the text longer: past the limit there is nothing to compare.
    Promise(
      *second == *read || text.size() > XmlLimits().Bytes, "what was written reads differently\n" + again.ToText());
  }
  if (messages.HasErrors())
    return false;
  Promise(graph != nullptr, "no graph and no error");
  Promise(graph->Order.size() == graph->Nodes.size(), "nodes without a place in the order");
  const std::string invalid = schema.Check(document.Text);
  Promise(invalid.empty(), "loads, but is not valid for the schema: " + invalid);
  Diagnostics own;
  const auto record = SelfContained(*graph, Registry(), own);
  Promise(!own.HasErrors(), "no self-contained form: " + own.ToText());
  const auto reread = ReadPipelineText(WritePipelineText(*record), "/elsewhere/x.exr", own);
  const auto rebuilt = BuildGraph(reread, Registry(), {}, own);
  Promise(!own.HasErrors(), "the self-contained form has mistakes: " + own.ToText());
  // Plans open files and walk the graph from node to node: one document in four, and not the longest chains.
  if (graph->Nodes.size() < 1000 && document.Text.size() % 4 == 0)
  {
    PipelineExecutor executor(graph, Registry());
    PlanText(MakePlan(executor, {}, graph->Ticks.First, graph->Ticks.First + 1));
  }
  return true;
}

const std::vector<FuzzBomb>& Bombs()
{
  static const std::vector<FuzzBomb> bombs = FuzzBombs();
  return bombs;
}

class PipelineFiles : public FuzzTarget
{
public:
  PipelineFiles(const FuzzOptions& a)
    : Seeds(ReadSeeds(a.Paths))
    , Mutator(this->Seeds, a.Seed)
  {
  }
  bool Empty() const { return this->Seeds.empty(); }
  std::uint64_t Fixed() const override { return Bombs().size() + this->Seeds.size(); }
  FuzzCase Make(std::uint64_t n) override
  {
    if (n < Bombs().size())
      return { (fs::path(this->Seeds.front().Name).parent_path() / "bomb.xml").string(), Bombs()[n].Text };
    n -= Bombs().size();
    return n < this->Seeds.size() ? this->Seeds[n] : this->Mutator.Make(n);
  }
  void Begin() override
  {
    vtkObject::GlobalWarningDisplayOff();
    this->Schema = std::make_unique<SchemaValidator>(PipelineXsd(Registry()));
  }
  bool Check(const FuzzCase& document, std::uint64_t n) override
  {
    return CheckDocument(document, *this->Schema, n < Bombs().size() ? Bombs()[n].Message : std::string());
  }

private:
  std::vector<FuzzCase> Seeds;
  FuzzMutator Mutator;
  std::unique_ptr<SchemaValidator> Schema;
};
}

int main(int argc, char** argv)
{
  FuzzOptions a;
  if (const int status = ParseFuzzOptions(argc, argv, "quell-fuzz", a))
    return status;
  try
  {
    PipelineFiles files(a);
    if (files.Empty())
      throw std::runtime_error("no seeds");
    return WatchFuzz(a, files);
  }
  catch (const std::exception& e)
  {
    std::cerr << "quell-fuzz: " << e.what() << "\n";
    return 2;
  }
}
