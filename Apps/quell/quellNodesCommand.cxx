// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellPipelineSchema.h"
#include "quellStageReference.h"

#include <nlohmann/json.hpp>

#include <cstdio>

namespace quell
{
namespace
{
nlohmann::json StageJson(const StageDescription& d)
{
  using nlohmann::json;
  json out = { { "type", d.Type }, { "category", d.Category }, { "brief", d.Brief }, { "details", d.Details },
    { "sink", d.Sink } };
  out["inputs"] = json::array();
  for (const InputPort& p : d.Inputs)
  {
    json attributes = json::array();
    for (const InputAttribute& a : p.Attributes)
    {
      attributes.push_back({ { "name", a.Name }, { "values", a.Values }, { "doc", a.Doc } });
    }
    out["inputs"].push_back({ { "name", p.Name }, { "kind", KindName(p.Kind) }, { "array", p.Array },
      { "optional", p.Optional }, { "repeatable", p.Repeatable }, { "attributes", attributes }, { "doc", p.Doc } });
  }
  out["outputs"] = json::array();
  for (const OutputArray& o : d.Outputs)
  {
    out["outputs"].push_back(
      { { "name", o.Name }, { "kind", KindName(o.Kind) }, { "components", o.Components }, { "doc", o.Doc } });
  }
  out["properties"] = json::array();
  for (const Property& p : d.Properties)
  {
    json property = { { "name", p.Name }, { "type", p.TypeName() }, { "default", p.DefaultText }, { "unit", p.Unit },
      { "doc", p.Doc } };
    if (p.Kind == Property::Type::Int || p.Kind == Property::Type::Double || p.Kind == Property::Type::Vector)
    {
      property["minimum"] = p.Minimum;
      property["maximum"] = p.Maximum;
    }
    if (p.Kind == Property::Type::Enum)
    {
      property["values"] = p.Enumerators;
    }
    if (p.Kind == Property::Type::Vector)
    {
      property["components"] = p.Components;
    }
    out["properties"].push_back(property);
  }
  return out;
}
}

int NodesCommand(const NodesArguments& a)
{
  const StageRegistry& registry = AllStages();
  const std::vector<std::string> all = registry.Types();
  if (a.Xsd)
  {
    if (!a.Type.empty())
    {
      throw UsageError("--xsd describes whole pipeline files; leave out " + a.Type);
    }
    std::fputs(PipelineXsd(registry).c_str(), stdout);
    return ExitDone;
  }
  if (!a.Type.empty() && !registry.Describe(a.Type))
  {
    const std::string near = DidYouMean(a.Type, all);
    throw UsageError(
      "unknown stage type " + Quoted(a.Type) + "; " + (near.empty() ? "types: " + Listed(all, 100) : near));
  }
  const std::vector<std::string> types = a.Type.empty() ? all : std::vector<std::string>{ a.Type };
  if (a.Markdown)
  {
    std::fputs(StageMarkdown(registry, types).c_str(), stdout);
  }
  else if (a.Json)
  {
    nlohmann::json out = nlohmann::json::array();
    for (const std::string& type : types)
    {
      out.push_back(StageJson(*registry.Describe(type)));
    }
    std::printf("%s\n", (a.Type.empty() ? out : out.front()).dump(2).c_str());
  }
  else
  {
    std::fputs((a.Type.empty() ? StageList(registry) : StageText(*registry.Describe(a.Type))).c_str(), stdout);
  }
  return ExitDone;
}
}
