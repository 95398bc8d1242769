// SPDX-License-Identifier: BSD-3-Clause
#include "quellLeaveOut.h"

#include "quellDiagnostic.h"

#include <algorithm>

namespace quell
{
namespace
{
/// Ports of a node as far as leaving it out needs them.
struct Through
{
  std::string Input, Output; ///< first port of each; empty: none
};

const PipelineTemplate* FindTemplate(const PipelineDocument& d, const std::string& name)
{
  for (const PipelineTemplate& t : d.Templates)
  {
    if (t.Name.Value == name)
    {
      return &t;
    }
  }
  for (const PipelineInclude& i : d.Includes)
  {
    const PipelineTemplate* t = i.Content ? FindTemplate(*i.Content, name) : nullptr;
    if (t)
    {
      return t;
    }
  }
  return nullptr;
}

Through PortsOf(const PipelineDocument& document, const PipelineNode& node, const StageRegistry& registry)
{
  Through ports;
  if (node.IsInstance)
  {
    const PipelineTemplate* t = FindTemplate(document, node.Type.Value);
    if (t)
    {
      ports.Input = t->Inputs.empty() ? "" : t->Inputs.front().Name.Value;
      ports.Output = t->Outputs.empty() ? "" : t->Outputs.front().Name.Value;
    }
    return ports;
  }
  const StageDescription* description = registry.Describe(node.Type.Value);
  if (description)
  {
    ports.Input = description->Inputs.empty() ? "" : description->Inputs.front().Name;
    ports.Output = description->Outputs.empty() ? "" : description->Outputs.front().Name;
  }
  return ports;
}

/// Reads of the node, by any attribute that names a producer.
template <class Document, class F>
void EachFrom(Document& d, const F& visit)
{
  for (auto& n : d.Nodes)
  {
    for (auto& i : n.Inputs)
    {
      visit(i.From);
    }
  }
  for (auto& o : d.Outputs)
  {
    visit(o.From);
    for (auto& l : o.Layers)
    {
      visit(l.From);
    }
  }
}

bool Names(const PipelineText& from, const std::string& id)
{
  const std::string& s = from.Value;
  return s.compare(0, id.size(), id) == 0 && (s.size() == id.size() || s[id.size()] == ':');
}

const PipelineInput* FirstInput(const PipelineNode& node, const std::string& port)
{
  const auto at =
    std::find_if(node.Inputs.begin(), node.Inputs.end(), [&](const PipelineInput& i) { return i.Port.Value == port; });
  return at == node.Inputs.end() ? nullptr : &*at;
}
}

std::shared_ptr<PipelineDocument> LeaveOut(
  const PipelineDocument& document, const std::string& id, const StageRegistry& registry, std::string& error)
{
  const auto at =
    std::find_if(document.Nodes.begin(), document.Nodes.end(), [&](const PipelineNode& n) { return n.Id.Value == id; });
  if (at == document.Nodes.end())
  {
    std::vector<std::string> names;
    for (const PipelineNode& n : document.Nodes)
    {
      names.push_back(n.Id.Value);
    }
    const std::string near = DidYouMean(id, names);
    error = "there is no node " + Quoted(id) + " at the top level of the pipeline; " +
            (near.empty() ? "it has " + Listed(names) : near);
    return nullptr;
  }
  const std::string who = "node " + Quoted(id) + " cannot be left out: ";
  const Through ports = PortsOf(document, *at, registry);
  const PipelineInput* input =
    ports.Input.empty() || ports.Output.empty() ? nullptr : FirstInput(*at, ports.Input);
  if (!input)
  {
    error = who + (ports.Output.empty() ? "it passes nothing on" : "it has no input to take its place");
    return nullptr;
  }
  if (input->Delay.Given && input->Delay.Value != "0")
  {
    error = who + "its first input reads the previous frame";
    return nullptr;
  }
  const std::string& source = input->From.Value;
  const std::string producer = source.substr(0, source.find(':'));
  if (producer == id)
  {
    error = who + "it reads itself";
    return nullptr;
  }
  bool read = false;
  EachFrom(document, [&](const PipelineText& from) { read = read || Names(from, id); });
  if (!read)
  {
    error = who + "nobody reads it";
    return nullptr;
  }
  auto out = std::make_shared<PipelineDocument>(document);
  out->Nodes.erase(out->Nodes.begin() + (at - document.Nodes.begin()));
  EachFrom(*out,
    [&](PipelineText& from)
    {
      if (!Names(from, id))
      {
        return;
      }
      const std::string array = from.Value.size() > id.size() ? from.Value.substr(id.size() + 1) : ports.Output;
      from.Value = array == ports.Output ? source : producer + ":" + array;
    });
  return out;
}

std::vector<std::string> RemovableNodes(const PipelineDocument& document, const StageRegistry& registry)
{
  std::vector<std::string> ids;
  for (const PipelineNode& n : document.Nodes)
  {
    std::string error;
    if (LeaveOut(document, n.Id.Value, registry, error))
    {
      ids.push_back(n.Id.Value);
    }
  }
  return ids;
}
}
