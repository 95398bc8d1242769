// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelineSchema.h"

#include "quellPipelineReader.h"
#include "quellStageReference.h"
#include "quellXmlDocument.h"

#include <map>
#include <vector>

namespace quell
{
namespace
{
/// Values of an enumeration with what is said about each.
using Documented = std::map<std::string, std::vector<std::string>>;

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
  void DocumentedAttribute(const std::string& name, const std::string& type, const std::string& doc)
  {
    this->Line(2, "<xs:attribute name=\"" + name + "\" type=\"" + type + "\">");
    this->Documentation(3, doc);
    this->Line(2, "</xs:attribute>");
  }

  void Enumeration(const std::string& name, const Documented& values)
  {
    this->Line(1, "<xs:simpleType name=\"" + name + "\">");
    this->Line(2, "<xs:restriction base=\"xs:string\">");
    for (const auto& value : values)
    {
      std::string doc;
      for (const std::string& line : value.second)
      {
        doc += (doc.empty() ? "" : " | ") + line;
      }
      this->Line(3, "<xs:enumeration value=\"" + EscapeXml(value.first) + "\"" + (doc.empty() ? "/>" : ">"));
      if (!doc.empty())
      {
        this->Documentation(4, doc);
        this->Line(3, "</xs:enumeration>");
      }
    }
    this->Line(2, "</xs:restriction>");
    this->Line(1, "</xs:simpleType>");
  }

  void Restriction(const std::string& name, const std::string& base, const std::vector<std::string>& facets)
  {
    this->Line(1, "<xs:simpleType name=\"" + name + "\">");
    std::string all;
    for (const std::string& facet : facets)
    {
      all += "<xs:" + facet + "/>";
    }
    this->Line(2, "<xs:restriction base=\"" + base + "\">" + all + "</xs:restriction>");
    this->Line(1, "</xs:simpleType>");
  }

  /// A type whose value may be computed: then only the program can check it.
  void OrExpression(const std::string& name, const std::string& type)
  {
    this->Line(
      1, "<xs:simpleType name=\"" + name + "\"><xs:union memberTypes=\"" + type + " Expression\"/></xs:simpleType>");
  }

  void BeginType(const std::string& name, const std::string& doc)
  {
    this->Line(1, "<xs:complexType name=\"" + name + "\">");
    this->Documentation(2, doc);
  }
  void EndType() { this->Line(1, "</xs:complexType>"); }

  /// Children in any order.
  void BeginChildren() { this->Line(2, "<xs:choice minOccurs=\"0\" maxOccurs=\"unbounded\">"); }
  void EndChildren() { this->Line(2, "</xs:choice>"); }

  /// An element; no two of its `among` children may have the same `attribute`, where one is named.
  void Element(int depth, const std::string& name, const std::string& type, const std::string& among = {},
    const std::string& attribute = {})
  {
    const std::string start = "<xs:element name=\"" + name + "\" type=\"" + type + "\"";
    if (among.empty())
    {
      this->Line(depth, start + "/>");
      return;
    }
    this->Line(depth, start + ">");
    this->Unique(depth + 1, among, attribute);
    this->Line(depth, "</xs:element>");
  }
  void Unique(int depth, const std::string& among, const std::string& attribute)
  {
    this->Line(depth, "<xs:unique name=\"unique" + std::to_string(++this->Uniques) + "\"><xs:selector xpath=\"" +
                        among + "\"/><xs:field xpath=\"@" + attribute + "\"/></xs:unique>");
  }

private:
  int Uniques = 0;
};

std::string PropertyDoc(const std::string& type, const Property& p)
{
  const std::string range = RangeText(p);
  return type + ": " + p.TypeName() + ", default " + (p.DefaultText.empty() ? "empty" : p.DefaultText) +
         (range.empty() ? "" : ", " + range) + ". " + p.Doc;
}

/// Names, links and numbers. "$(name)" may stand in most values: `...Text` types allow it.
void WriteSimpleTypes(Schema& s, const StageRegistry& registry)
{
  Documented types, properties, ports, written, kinds;
  for (const std::string& type : registry.Types())
  {
    const StageDescription* d = registry.Describe(type);
    types[type].push_back(d->Brief);
    for (const Property& p : d->Properties)
    {
      properties[p.Name].push_back(PropertyDoc(type, p));
      // What the output's own attributes say is not said twice.
      if ((type == "ImageWriter" || type == "DisplayTransform") && p.Name != "File" && p.Name != "View" &&
          p.Name != "Display")
      {
        written[p.Name].push_back(PropertyDoc(type, p));
      }
    }
    for (const InputPort& p : d->Inputs)
    {
      ports[p.Name].push_back(type + ": " + p.Doc);
    }
  }
  for (const ArrayType& array : KnownArrays())
  {
    kinds[array.Name].push_back(array.Doc);
  }
  for (int k = 0; k <= int(ArrayKind::Any); ++k)
  {
    kinds[KindName(ArrayKind(k))].push_back(KindDoc(ArrayKind(k)));
  }
  const std::string name = "[A-Za-z_][A-Za-z0-9_\\-]{0,127}";
  const std::string link = name + "(/" + name + ")*(:[^:]+)?";
  s.Restriction("Expression", "xs:string", { "pattern value=\"[\\s\\S]*[$][(][\\s\\S]*\"" });
  s.Restriction("Name", "xs:string", { "pattern value=\"" + name + "\"" });
  s.OrExpression("NameText", "Name");
  s.Restriction("Link", "xs:string", { "pattern value=\"" + link + "\"" });
  s.OrExpression("LinkText", "Link");
  s.Restriction("InnerLink", "xs:string", { "pattern value=\"@" + name + "|" + link + "\"" });
  s.OrExpression("InnerLinkText", "InnerLink");
  s.OrExpression("Flag", "xs:boolean");
  // The name of an included file: no "$(" in it.
  s.Restriction("IncludedFile", "xs:string",
    { "pattern value=\"([^$]|[$]+[^$(])*[$]*\"", "minLength value=\"1\"", "maxLength value=\"4096\"" });
  s.Restriction("NotEmpty", "xs:string", { "minLength value=\"1\"" });
  const std::string version = std::to_string(PipelineVersion);
  s.Restriction("Version", "xs:integer", { "minInclusive value=\"1\"", "maxInclusive value=\"" + version + "\"" });
  s.Restriction("First", "xs:integer", { "minInclusive value=\"-100000000\"", "maxInclusive value=\"100000000\"" });
  s.OrExpression("FirstText", "First");
  s.Restriction("Count", "xs:integer", { "minInclusive value=\"1\"", "maxInclusive value=\"10000000\"" });
  s.OrExpression("CountText", "Count");
  s.Restriction("Rate", "xs:double", { "minInclusive value=\"1e-6\"", "maxInclusive value=\"1e6\"" });
  s.OrExpression("RateText", "Rate");
  s.Enumeration("VariableType", { { "int", {} }, { "double", {} }, { "bool", {} }, { "string", {} }, { "path", {} } });
  s.Enumeration("ArrayKind", kinds);
  s.Enumeration("StageType", types);
  s.OrExpression("StageTypeText", "StageType");
  s.Enumeration("PropertyName", properties);
  s.OrExpression("PropertyNameText", "PropertyName");
  s.Enumeration("OutputPropertyName", written.empty() ? properties : written);
  s.OrExpression("OutputPropertyNameText", "OutputPropertyName");
  s.Enumeration("PortName", ports);
  s.OrExpression("PortNameText", "PortName");
}

/// The attributes of their own that connections of any stage may have.
void WriteInputAttributes(Schema& s, const StageRegistry& registry)
{
  Documented docs;
  for (const std::string& type : registry.Types())
  {
    for (const InputPort& p : registry.Describe(type)->Inputs)
    {
      for (const InputAttribute& a : p.Attributes)
      {
        docs[a.Name].push_back(type + ", " + p.Name + ": " + a.Doc + (a.Values.empty() ? "" : "; " + Listed(a.Values)));
      }
    }
  }
  for (const auto& a : docs)
  {
    std::string doc;
    for (const std::string& line : a.second)
    {
      doc += (doc.empty() ? "" : " | ") + line;
    }
    s.DocumentedAttribute(a.first, "xs:string", doc);
  }
}

void WriteNodeTypes(Schema& s, const StageRegistry& registry, const std::string& inner, const std::string& link)
{
  s.BeginType(inner + "Node", "A stage.");
  s.BeginChildren();
  s.Element(3, "property", "Property");
  s.Element(3, "input", inner + "Input");
  s.EndChildren();
  s.Attribute("id", true, "NameText");
  s.Attribute("type", true, "StageTypeText");
  s.Attribute("doc", false);
  s.EndType();
  s.BeginType(inner + "Instance", "A template, put in with its parameters and inputs.");
  s.BeginChildren();
  s.Element(3, "parameter", "Parameter");
  s.Element(3, "input", inner + "InstanceInput");
  s.EndChildren();
  s.Attribute("id", true, "NameText");
  s.Attribute("template", true, "NameText");
  s.Attribute("doc", false);
  s.EndType();
  s.BeginType(inner + "Input",
    "Connects a port to node:array" + std::string(inner.empty() ? "" : ", or @port of the template") +
      "; delay=1 reads the previous frame; optional=1 leaves the connection out where the node has no such array.");
  s.Attribute("port", true, "PortNameText");
  s.Attribute("from", true, link);
  s.Attribute("delay", false, "Flag");
  s.Attribute("optional", false, "Flag");
  WriteInputAttributes(s, registry);
  s.EndType();
  s.BeginType(inner + "InstanceInput",
    "Connects a port of the template to node:array" + std::string(inner.empty() ? "" : ", or @port of this template") +
      "; delay=1 reads the previous frame; optional=1 leaves out what the template connects to the port where the node "
      "has no such array.");
  s.Attribute("port", true, "Name");
  s.Attribute("from", true, link);
  s.Attribute("delay", false, "Flag");
  s.Attribute("optional", false, "Flag");
  s.EndType();
}
}

std::string PipelineXsd(const StageRegistry& registry)
{
  Schema s;
  s.Line(0, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
  s.Line(0, "<!-- Made by quell nodes, option xsd, from the stages' own tables. -->");
  s.Line(0, "<xs:schema xmlns:xs=\"http://www.w3.org/2001/XMLSchema\">");
  s.Line(1, "<xs:element name=\"pipeline\" type=\"Pipeline\">");
  s.Unique(2, "node|instance", "id");
  s.Unique(2, "variable", "name");
  s.Unique(2, "template", "name");
  s.Unique(2, "output", "name");
  s.Line(1, "</xs:element>");
  WriteSimpleTypes(s, registry);

  s.Line(1, "<xs:group name=\"Part\">");
  s.Line(2, "<xs:choice>");
  s.Element(3, "include", "Include");
  s.Element(3, "variable", "Variable");
  s.Line(3, "<xs:element name=\"template\" type=\"Template\">");
  s.Unique(4, "node|instance", "id");
  s.Unique(4, "parameter", "name");
  s.Line(3, "</xs:element>");
  s.Element(3, "node", "Node", "property", "name");
  s.Element(3, "instance", "Instance", "parameter", "name");
  s.Element(3, "output", "Output", "property", "name");
  s.Line(2, "</xs:choice>");
  s.Line(1, "</xs:group>");
  s.BeginType("Pipeline", "A graph of image stages.");
  s.Line(2, "<xs:sequence>");
  s.Line(3, "<xs:group ref=\"Part\" minOccurs=\"0\" maxOccurs=\"unbounded\"/>");
  s.Line(3, "<xs:sequence minOccurs=\"0\">"); // at most one <time>, anywhere
  s.Element(4, "time", "Time");
  s.Line(4, "<xs:group ref=\"Part\" minOccurs=\"0\" maxOccurs=\"unbounded\"/>");
  s.Line(3, "</xs:sequence>");
  s.Line(2, "</xs:sequence>");
  s.Attribute("version", true, "Version");
  s.Attribute("doc", false);
  s.EndType();

  s.BeginType("Include", "Takes the variables and templates of another file, relative to this one.");
  s.Attribute("file", true, "IncludedFile");
  s.EndType();
  s.BeginType("Variable", "A value that the command line may override; $(name) stands for it in attributes.");
  s.Attribute("name", true, "Name");
  s.Attribute("type", true, "VariableType");
  s.Attribute("default", true);
  s.Attribute("doc", false);
  s.EndType();
  s.BeginType("Time", "The frames of a run: first, how many, and how many per second of scene time.");
  s.Attribute("first", false, "FirstText");
  s.Attribute("count", false, "CountText");
  s.Attribute("rate", false, "RateText");
  s.EndType();

  s.BeginType("Template", "A part of a graph to be instantiated several times.");
  s.BeginChildren();
  s.Element(3, "parameter", "Variable");
  s.Element(3, "port", "Port");
  s.Element(3, "node", "InnerNode", "property", "name");
  s.Element(3, "instance", "InnerInstance", "parameter", "name");
  s.EndChildren();
  s.Attribute("name", true, "Name");
  s.Attribute("doc", false);
  s.EndType();
  s.BeginType("Port", "A template's input, read by its nodes as @name; with from, its output.");
  s.Attribute("name", true, "Name");
  s.Attribute("type", false, "ArrayKind");
  s.Attribute("from", false, "InnerLinkText");
  s.Attribute("doc", false);
  s.EndType();
  WriteNodeTypes(s, registry, "", "LinkText");
  WriteNodeTypes(s, registry, "Inner", "InnerLinkText");
  s.BeginType("Property", "A parameter of the stage.");
  s.Attribute("name", true, "PropertyNameText");
  s.Attribute("value", true);
  s.EndType();
  s.BeginType("OutputProperty", "A parameter of the output's writer, or of its view's transform.");
  s.Attribute("name", true, "OutputPropertyNameText");
  s.Attribute("value", true);
  s.EndType();
  s.BeginType("Parameter", "A parameter of the template.");
  s.Attribute("name", true, "Name");
  s.Attribute("value", true);
  s.EndType();

  s.BeginType("Output", "Names an array and, with file, writes it; #### in the name is the frame's number.");
  s.BeginChildren();
  s.Element(3, "property", "OutputProperty");
  s.Element(3, "layer", "Layer");
  s.EndChildren();
  s.Attribute("name", true, "Name");
  s.Attribute("from", false, "LinkText");
  s.Attribute("file", false, "NotEmpty");
  s.Attribute("view", false);
  s.Attribute("display", false);
  s.Attribute("doc", false);
  s.EndType();
  s.BeginType(
    "Layer", "One more layer of the output's file; optional=1 leaves it out where the node has no such array.");
  s.Attribute("from", true, "LinkText");
  s.Attribute("name", false);
  s.Attribute("optional", false, "Flag");
  s.EndType();
  s.Line(0, "</xs:schema>");
  return s.Out;
}
}
