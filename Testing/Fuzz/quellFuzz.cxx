// SPDX-License-Identifier: BSD-3-Clause
// quell-fuzz [options, see quellFuzzWatch.h] FILE|DIRECTORY...
//
// Reads mutated pipeline files with every stage type in place. Promises:
// - loading ends with a graph or with an error that says where; messages are one line of readable text each, not too
// long;
// - what was read can be written, and reads back as the same document;
// - a file that loads is valid for the schema; its self-contained form loads as well; a plan of it can be made.
#include "../AllStages.h"
#include "../Graphs/SchemaTools.h"
#include "quellExplain.h"
#include "quellFuzz.h"
#include "quellFuzzWatch.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"
#include "quellPipelineSchema.h"
#include "quellPipelineWriter.h"
#include "quellProvenance.h"
#include "quellXmlDocument.h"
#include "vtkObject.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
std::string Contents(const fs::path& file)
{
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

std::vector<FuzzSeed> ReadSeeds(const std::vector<std::string>& paths)
{
  std::vector<fs::path> files;
  for (const std::string& path : paths)
  {
    if (!fs::is_directory(path))
      files.push_back(path);
    else
      for (const auto& entry : fs::directory_iterator(path))
        if (entry.path().extension() == ".xml")
          files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end()); // directories have no order of their own
  std::vector<FuzzSeed> seeds;
  for (const fs::path& file : files)
    seeds.push_back({ file.string(), Contents(file) });
  return seeds;
}

/// Throws what promise was broken. True: the file loads.
bool CheckDocument(const FuzzSeed& document, const SchemaValidator& schema, const std::string& wanted)
{
  const auto promise = [](bool kept, const std::string& what)
  {
    if (!kept)
      throw std::runtime_error(what);
  };
  Diagnostics messages;
  const auto read = ReadPipelineText(document.Text, document.File, messages);
  promise(read != nullptr, "no document");
  const bool parsed = read->Place.Line > 0;
  promise(parsed || messages.HasErrors(), "neither a document nor an error");
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
    promise(!d.What.empty() && !d.Place.File.empty(), "an error without words or file");
    promise(d.Place.Line > 0 || document.Text.size() > XmlLimits().Bytes, "an error without a line: " + text);
    for (char c : d.Where + d.What + d.Hint)
      promise((unsigned char)c >= 0x20 && c != 0x7F, "an error with control characters: " + text);
  }
  promise(length < 20000, "an error of " + std::to_string(length) + " characters");
  promise(wanted.empty() || messages.ToText().find(wanted) != std::string::npos,
    "no message \"" + wanted + "\" in\n" + messages.ToText().substr(0, 2000));
  if (parsed && !grammar.HasErrors())
  {
    const std::string text = WritePipelineText(*read);
    Diagnostics again;
    const auto second = ReadPipelineText(text, document.File, again);
    // Escapes and indentation make the text longer: past the limit there is nothing to compare.
    promise(
      *second == *read || text.size() > XmlLimits().Bytes, "what was written reads differently\n" + again.ToText());
  }
  if (messages.HasErrors())
    return false;
  promise(graph != nullptr, "no graph and no error");
  promise(graph->Order.size() == graph->Nodes.size(), "nodes without a place in the order");
  const std::string invalid = schema.Check(document.Text);
  promise(invalid.empty(), "loads, but is not valid for the schema: " + invalid);
  Diagnostics own;
  const auto record = SelfContained(*graph, Registry(), own);
  promise(!own.HasErrors(), "no self-contained form: " + own.ToText());
  const auto reread = ReadPipelineText(WritePipelineText(*record), "/elsewhere/x.exr", own);
  const auto rebuilt = BuildGraph(reread, Registry(), {}, own);
  promise(!own.HasErrors(), "the self-contained form has mistakes: " + own.ToText());
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

FuzzSeed Document(std::uint64_t n, FuzzMutator& mutator, const std::vector<FuzzSeed>& seeds, std::string& wanted)
{
  wanted.clear();
  if (n < Bombs().size())
  {
    const FuzzBomb& bomb = Bombs()[n];
    wanted = bomb.Message;
    return { (fs::path(seeds.front().File).parent_path() / "bomb.xml").string(), bomb.Text };
  }
  n -= Bombs().size();
  return n < seeds.size() ? seeds[n] : mutator.Make(n);
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
    std::string wanted;
    const FuzzSeed document = Document(n, this->Mutator, this->Seeds, wanted);
    return { document.File, document.Text };
  }
  void Begin() override
  {
    vtkObject::GlobalWarningDisplayOff();
    this->Schema = std::make_unique<SchemaValidator>(PipelineXsd(Registry()));
  }
  bool Check(const FuzzCase& document, std::uint64_t n) override
  {
    return CheckDocument(
      { document.Name, document.Text }, *this->Schema, n < Bombs().size() ? Bombs()[n].Message : std::string());
  }

private:
  std::vector<FuzzSeed> Seeds;
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
