// SPDX-License-Identifier: BSD-3-Clause
#include "quellStageReference.h"

#include "quellXmlDocument.h"
#include "vtkQuellStage.h"

#include <algorithm>
#include <limits>
#include <map>

namespace quell
{
namespace
{
std::string NumberText(double v, bool whole)
{
  return whole ? std::to_string((long long)v) : detail::FormatDouble(v);
}

/// Bounds of the number type itself say nothing to a reader.
bool IsOpen(double v)
{
  return v >= 2147483647. || v <= -2147483648.;
}

std::string Cell(const std::string& text)
{
  std::string out;
  for (char c : text)
  {
    if (c == '|')
    {
      out += "\\|";
    }
    else
    {
      out += c == '\n' ? ' ' : c;
    }
  }
  return out;
}

std::string Wrapped(const std::string& text, const std::string& indent, std::size_t width = 100)
{
  std::string out, line;
  std::size_t at = 0;
  while (at < text.size())
  {
    std::size_t end = text.find_first_of(" \n", at);
    end = end == std::string::npos ? text.size() : end;
    const std::string word = text.substr(at, end - at);
    if (!line.empty() && indent.size() + line.size() + 1 + word.size() > width)
    {
      out += indent + line + "\n";
      line.clear();
    }
    line += (line.empty() || word.empty() ? "" : " ") + word;
    at = end + 1;
  }
  return line.empty() ? out : out + indent + line + "\n";
}

std::string PortNotes(const InputPort& p)
{
  std::string notes;
  if (p.Optional)
  {
    notes += ", optional";
  }
  if (p.Repeatable)
  {
    notes += ", repeatable";
  }
  return notes;
}
}

std::string RangeText(const Property& p)
{
  switch (p.Kind)
  {
    case Property::Type::Enum:
      return Listed(p.Enumerators);
    case Property::Type::Int:
    case Property::Type::Double:
    case Property::Type::Vector:
    {
      const bool whole = p.Kind == Property::Type::Int;
      const bool noLow = IsOpen(p.Minimum), noHigh = IsOpen(p.Maximum);
      if (noLow && noHigh)
      {
        return {};
      }
      if (noHigh)
      {
        return NumberText(p.Minimum, whole) + " or more";
      }
      if (noLow)
      {
        return NumberText(p.Maximum, whole) + " or less";
      }
      return "[" + NumberText(p.Minimum, whole) + ", " + NumberText(p.Maximum, whole) + "]";
    }
    default:
      return {};
  }
}

std::string StageList(const StageRegistry& registry)
{
  std::map<std::string, std::vector<const StageDescription*>> categories;
  std::size_t width = 0;
  for (const std::string& type : registry.Types())
  {
    const StageDescription* d = registry.Describe(type);
    categories[d->Category].push_back(d);
    width = std::max(width, type.size());
  }
  std::string out;
  for (const auto& c : categories)
  {
    out += c.first + "\n";
    for (const StageDescription* d : c.second)
    {
      out += "  " + d->Type + std::string(width - d->Type.size() + 2, ' ') + d->Brief + "\n";
    }
  }
  return out;
}

std::string StageText(const StageDescription& d)
{
  std::string out = d.Type + " (" + d.Category + ")\n" + Wrapped(d.Brief, "  ");
  if (!d.Inputs.empty())
  {
    out += "inputs\n";
    for (const InputPort& p : d.Inputs)
    {
      out += "  " + p.Name + ": " + KindName(p.Kind) + " (" + KindDoc(p.Kind) + ")" + PortNotes(p) + "\n" +
             Wrapped(p.Doc, "      ");
    }
  }
  if (!d.Outputs.empty())
  {
    out += "outputs\n";
    for (const OutputArray& o : d.Outputs)
    {
      out += "  " + o.Name + ": " + KindName(o.Kind) + "\n" + Wrapped(o.Doc, "      ");
    }
  }
  if (!d.Properties.empty())
  {
    out += "properties\n";
    for (const Property& p : d.Properties)
    {
      out += "  " + p.Name + " = " + (p.DefaultText.empty() ? "\"\"" : p.DefaultText) +
             (p.Unit.empty() ? "" : " " + p.Unit) + " (" + p.TypeName();
      const std::string range = RangeText(p);
      out += (range.empty() ? "" : ", " + range) + ")\n" + Wrapped(p.Doc, "      ");
    }
  }
  if (!d.Details.empty())
  {
    out += "\n" + d.Details + "\n";
  }
  return out;
}

std::string StageMarkdown(const StageRegistry& registry, const std::vector<std::string>& types)
{
  std::map<std::string, std::vector<const StageDescription*>> categories;
  for (const std::string& type : types)
  {
    if (const StageDescription* d = registry.Describe(type))
    {
      categories[d->Category].push_back(d);
    }
  }
  std::string out = "# Stage reference\n\nMade by `quell nodes --markdown` from the stages' own tables.\n";
  if (types.size() > 1)
  {
    for (const auto& c : categories)
    {
      out += "\n**" + c.first + "**:";
      for (std::size_t i = 0; i < c.second.size(); ++i)
      {
        std::string anchor = c.second[i]->Type;
        std::transform(anchor.begin(), anchor.end(), anchor.begin(),
          [](char l) { return l >= 'A' && l <= 'Z' ? char(l - 'A' + 'a') : l; });
        out += (i ? ", [" : " [") + c.second[i]->Type + "](#" + anchor + ")";
      }
      out += "\n";
    }
  }
  for (const auto& c : categories)
  {
    for (const StageDescription* d : c.second)
    {
      out += "\n## " + d->Type + "\n\n" + d->Brief + "\n";
      if (!d->Details.empty())
      {
        out += "\n" + d->Details + "\n";
      }
      if (!d->Inputs.empty())
      {
        out += "\n| input | kind | |\n|---|---|---|\n";
        for (const InputPort& p : d->Inputs)
        {
          out += "| `" + p.Name + "` | " + KindName(p.Kind) + PortNotes(p) + " | " + Cell(p.Doc) + " |\n";
        }
      }
      if (!d->Outputs.empty())
      {
        out += "\n| output | kind | |\n|---|---|---|\n";
        for (const OutputArray& o : d->Outputs)
        {
          out += "| `" + o.Name + "` | " + KindName(o.Kind) + " | " + Cell(o.Doc) + " |\n";
        }
      }
      if (!d->Properties.empty())
      {
        out += "\n| property | type | default | range | |\n|---|---|---|---|---|\n";
        for (const Property& p : d->Properties)
        {
          out += "| `" + p.Name + "` | " + p.TypeName() + " | " +
                 (p.DefaultText.empty() ? "" : "`" + Cell(p.DefaultText) + "`") +
                 (p.Unit.empty() ? "" : " " + Cell(p.Unit)) + " | " + Cell(RangeText(p)) + " | " + Cell(p.Doc) + " |\n";
        }
      }
    }
  }
  return out;
}

namespace
{
class Schema
{
public:
  std::string Out;

  void Line(int depth, const std::string& text) { this->Out += std::string(std::size_t(2 * depth), ' ') + text + "\n"; }

  void Documentation(int depth, const std::string& text)
  {
    this->Line(depth, "<xs:annotation><xs:documentation>" + EscapeXml(text) + "</xs:documentation></xs:annotation>");
  }

  void Attribute(const std::string& name, bool required, const std::string& type = "xs:string")
  {
    this->Line(
      2, "<xs:attribute name=\"" + name + "\" type=\"" + type + "\"" + (required ? " use=\"required\"" : "") + "/>");
  }

  /// A complex type whose children may come in any order.
  void Begin(
    const std::string& name, const std::string& doc, const std::vector<std::pair<std::string, std::string>>& children)
  {
    this->Line(1, "<xs:complexType name=\"" + name + "\">");
    this->Documentation(2, doc);
    if (!children.empty())
    {
      this->Line(2, "<xs:choice minOccurs=\"0\" maxOccurs=\"unbounded\">");
      for (const auto& c : children)
      {
        this->Line(3, "<xs:element name=\"" + c.first + "\" type=\"" + c.second + "\"/>");
      }
      this->Line(2, "</xs:choice>");
    }
  }
  void End() { this->Line(1, "</xs:complexType>"); }
};
}

std::string PipelineXsd(const StageRegistry& registry)
{
  Schema s;
  s.Line(0, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
  s.Line(0, "<!-- Made by quell nodes, option xsd, from the stages' own tables. -->");
  s.Line(0, "<xs:schema xmlns:xs=\"http://www.w3.org/2001/XMLSchema\">");
  s.Line(1, "<xs:element name=\"pipeline\" type=\"Pipeline\"/>");

  s.Line(1, "<xs:simpleType name=\"StageType\">");
  s.Line(2, "<xs:restriction base=\"xs:string\">");
  std::map<std::string, std::vector<std::string>> properties;
  for (const std::string& type : registry.Types())
  {
    const StageDescription* d = registry.Describe(type);
    s.Line(3, "<xs:enumeration value=\"" + EscapeXml(type) + "\">");
    s.Documentation(4, d->Brief);
    s.Line(3, "</xs:enumeration>");
    for (const Property& p : d->Properties)
    {
      const std::string range = RangeText(p);
      properties[p.Name].push_back(type + ": " + p.TypeName() + ", default " +
                                   (p.DefaultText.empty() ? "empty" : p.DefaultText) +
                                   (range.empty() ? "" : ", " + range) + ". " + p.Doc);
    }
  }
  s.Line(2, "</xs:restriction>");
  s.Line(1, "</xs:simpleType>");

  s.Line(1, "<xs:simpleType name=\"PropertyName\">");
  s.Line(2, "<xs:restriction base=\"xs:string\">");
  for (const auto& p : properties)
  {
    std::string doc;
    for (const std::string& line : p.second)
    {
      doc += (doc.empty() ? "" : " | ") + line;
    }
    s.Line(3, "<xs:enumeration value=\"" + EscapeXml(p.first) + "\">");
    s.Documentation(4, doc);
    s.Line(3, "</xs:enumeration>");
  }
  s.Line(2, "</xs:restriction>");
  s.Line(1, "</xs:simpleType>");

  s.Line(1, "<xs:simpleType name=\"VariableType\">");
  s.Line(2, "<xs:restriction base=\"xs:string\">");
  for (const char* type : { "int", "double", "bool", "string", "path" })
  {
    s.Line(3, std::string("<xs:enumeration value=\"") + type + "\"/>");
  }
  s.Line(2, "</xs:restriction>");
  s.Line(1, "</xs:simpleType>");

  // Templates and variables may compute a type or a name: then only the program can check it.
  s.Line(1, "<xs:simpleType name=\"Expression\">");
  s.Line(2, "<xs:restriction base=\"xs:string\"><xs:pattern value=\".*[$][(].*[)].*\"/></xs:restriction>");
  s.Line(1, "</xs:simpleType>");
  s.Line(1, "<xs:simpleType name=\"StageTypeText\"><xs:union memberTypes=\"StageType Expression\"/></xs:simpleType>");
  s.Line(
    1, "<xs:simpleType name=\"PropertyNameText\"><xs:union memberTypes=\"PropertyName Expression\"/></xs:simpleType>");

  s.Begin("Pipeline", "A graph of image stages.",
    { { "include", "Include" }, { "variable", "Variable" }, { "time", "Time" }, { "template", "Template" },
      { "node", "Node" }, { "instance", "Instance" }, { "output", "Output" } });
  s.Attribute("version", true, "xs:positiveInteger");
  s.Attribute("doc", false);
  s.End();
  s.Begin("Include", "Takes the variables and templates of another file, relative to this one.", {});
  s.Attribute("file", true);
  s.End();
  s.Begin("Variable", "A value that the command line may override; $(name) stands for it in attributes.", {});
  s.Attribute("name", true);
  s.Attribute("type", true, "VariableType");
  s.Attribute("default", true);
  s.Attribute("doc", false);
  s.End();
  s.Begin("Time", "The frames of a run: first, how many, and how many per second of scene time.", {});
  s.Attribute("first", false);
  s.Attribute("count", false);
  s.Attribute("rate", false);
  s.End();
  s.Begin("Template", "A part of a graph to be instantiated several times.",
    { { "parameter", "Variable" }, { "port", "Port" }, { "node", "Node" }, { "instance", "Instance" } });
  s.Attribute("name", true);
  s.Attribute("doc", false);
  s.End();
  s.Begin("Port", "A template's input, read by its nodes as @name; with from, its output.", {});
  s.Attribute("name", true);
  s.Attribute("type", false);
  s.Attribute("from", false);
  s.Attribute("doc", false);
  s.End();
  s.Begin("Node", "A stage.", { { "property", "Property" }, { "input", "Input" } });
  s.Attribute("id", true);
  s.Attribute("type", true, "StageTypeText");
  s.Attribute("doc", false);
  s.End();
  s.Begin("Instance", "A template, put in with its parameters and inputs.",
    { { "parameter", "Parameter" }, { "input", "InstanceInput" } });
  s.Attribute("id", true);
  s.Attribute("template", true);
  s.Attribute("doc", false);
  s.End();
  s.Begin("Property", "A parameter of the stage.", {});
  s.Attribute("name", true, "PropertyNameText");
  s.Attribute("value", true);
  s.End();
  s.Begin("Parameter", "A parameter of the template.", {});
  s.Attribute("name", true);
  s.Attribute("value", true);
  s.End();
  s.Begin("InstanceInput", "Connects a port of the template to node:array; delay=1 reads the previous frame.", {});
  s.Attribute("port", true);
  s.Attribute("from", true);
  s.Attribute("delay", false);
  s.End();
  s.Begin("Input",
    "Connects a port to node:array (or @port within a template); delay=1 reads the previous frame; optional=1 leaves "
    "the "
    "connection out where the node has no such array. Further attributes belong to the stage.",
    {});
  s.Attribute("port", true);
  s.Attribute("from", true);
  s.Attribute("delay", false);
  s.Attribute("optional", false);
  s.Line(2, "<xs:anyAttribute namespace=\"##any\" processContents=\"lax\"/>");
  s.End();
  s.Begin("Output", "Names an array and, with file, writes it; #### in the name is the frame's number.",
    { { "property", "Property" }, { "layer", "Layer" } });
  s.Attribute("name", true);
  s.Attribute("from", false);
  s.Attribute("file", false);
  s.Attribute("view", false);
  s.Attribute("display", false);
  s.Attribute("doc", false);
  s.End();
  s.Begin("Layer", "One more layer of the output's file.", {});
  s.Attribute("from", true);
  s.Attribute("name", false);
  s.End();
  s.Line(0, "</xs:schema>");
  return s.Out;
}
}
