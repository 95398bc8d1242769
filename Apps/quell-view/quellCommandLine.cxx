// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommandLine.h"

#include "quellImageFile.h"
#include "quellPipelineReader.h"

#include <algorithm>
#include <filesystem>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
std::string Nearest(const std::string& name, const std::vector<std::string>& names, const char* kind)
{
  const std::string near = DidYouMean(name, names);
  return near.empty() ? std::string(kind) + ": " + Listed(names) : near;
}

/// Why nothing is to be seen under this name; empty: there is.
std::string WrongShow(const std::string& show, const PipelineDocument& d, const Graph* graph)
{
  std::vector<std::string> names;
  for (const PipelineOutput& o : d.Outputs)
  {
    names.push_back(o.Name.Value);
  }
  if (std::find(names.begin(), names.end(), show) != names.end())
  {
    return {};
  }
  std::string array;
  std::string node = NodeOfReference(show, &array);
  node = node.empty() ? show : node;
  bool known = false;
  for (const PipelineNode& n : d.Nodes)
  {
    names.push_back(n.Id.Value);
    known = known || n.Id.Value == node;
  }
  const int index = graph ? graph->Find(node) : -1;
  if (!known && index < 0)
  {
    // Nodes within templates are named by their path.
    for (const GraphNode& n : graph ? graph->Nodes : std::vector<GraphNode>())
    {
      if (n.Path.find('/') != std::string::npos)
      {
        names.push_back(n.Path);
      }
    }
    return "there is no output and no node " + Quoted(node) + "; " + Nearest(node, names, "there are");
  }
  if (array.empty() || !graph)
  {
    return {};
  }
  std::vector<std::string> arrays;
  const ViewTarget real = ResolveTarget(d, { node, array });
  if (index < 0 && real.Node != node)
  {
    return {}; // a port of an instance, which leads to an inner node
  }
  if (index < 0)
  {
    for (const PipelineNode& n : d.Nodes)
    {
      if (n.Id.Value != node)
      {
        continue;
      }
      EditDocument document;
      document.Set(std::make_shared<PipelineDocument>(d));
      if (const PipelineTemplate* t = document.FindTemplate(n.Type.Value))
      {
        for (const PipelinePort& p : t->Outputs)
        {
          arrays.push_back(p.Name.Value);
        }
      }
    }
  }
  else
  {
    for (const OutputArray& a : graph->Arrays(index))
    {
      arrays.push_back(a.Name);
    }
  }
  if (std::find(arrays.begin(), arrays.end(), array) != arrays.end())
  {
    return {};
  }
  return "node " + Quoted(node) + " has no array " + Quoted(array) + "; " + Nearest(array, arrays, "it has");
}
}

CommandLineFault CheckCommandLine(
  const std::string& file, const Viewer::Options& options, const StageRegistry& registry)
{
  std::error_code ec;
  const auto lines = [](std::string& text, const std::string& line) { text += (text.empty() ? "" : "\n") + line; };
  CommandLineFault fault;
  if (fs::path(file).extension() == ".xml" && fs::is_regular_file(file, ec))
  {
    Diagnostics reading;
    const std::shared_ptr<const PipelineDocument> document = ReadPipelineFile(file, reading);
    if (document && !reading.HasErrors())
    {
      Diagnostics messages;
      const std::shared_ptr<Graph> graph = BuildGraph(document, registry, options.Graph, messages);
      for (const Diagnostic& d : messages.All())
      {
        if (d.Level == Severity::Error && d.Place.File == "command line")
        {
          lines(fault.Text, (d.Where.empty() ? std::string() : d.Where + ": ") + d.What +
                              (d.Hint.empty() ? std::string() : "; " + d.Hint));
        }
      }
      const std::string show = options.Show.empty() ? std::string() : WrongShow(options.Show, *document, graph.get());
      if (!show.empty())
      {
        lines(fault.Text, "--show " + options.Show + ": " + show);
      }
      if (options.Frame && graph)
      {
        const int first = graph->Ticks.First, last = first + std::max(1, graph->Ticks.Count) - 1;
        if (*options.Frame < first || *options.Frame > last)
        {
          lines(fault.Text,
            "--frame " + std::to_string(*options.Frame) +
              (first == last ? ": the only frame is " + std::to_string(first)
                             : ": frames go from " + std::to_string(first) + " to " + std::to_string(last)));
        }
      }
    }
  }
  if (fault)
  {
    fault.Status = 2;
    return fault;
  }
  if (!options.Reference.empty())
  {
    if (!fs::exists(options.Reference, ec))
    {
      fault.Text = "--reference " + options.Reference + ": there is no such file; the path is seen from " +
                   fs::current_path(ec).string();
    }
    else
    {
      try
      {
        ReadImageHeader(options.Reference);
      }
      catch (const StageError& e)
      {
        fault.Text = std::string("--reference: ") + e.what();
      }
    }
    fault.Status = fault ? 1 : 0;
  }
  return fault;
}
}
