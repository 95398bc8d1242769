// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelineWriter.h"

#include "quellXmlDocument.h"

namespace quell
{
namespace
{
class Writer
{
public:
  std::string Out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";

  void Comments(const std::vector<std::string>& comments)
  {
    for (std::string c : comments)
    {
      // XML forbids "--" within and "-" at the end; only a program can have put them there.
      for (std::size_t at = 0; (at = c.find("--", at)) != std::string::npos;)
      {
        c.insert(++at, " ");
      }
      if (!c.empty() && c.back() == '-')
      {
        c += ' ';
      }
      this->Indent();
      this->Out += "<!--" + c + "-->\n";
    }
  }

  void Open(const char* name, const PipelineItem& item)
  {
    this->CloseTag();
    this->Comments(item.Comments);
    this->Indent();
    this->Out += std::string("<") + name;
    this->Pending = true;
    ++this->Depth;
  }

  void Attribute(const std::string& name, const PipelineText& text)
  {
    if (text.Given)
    {
      this->Out += " " + name + "=\"" + EscapeXml(text.Value) + "\"";
    }
  }

  void Close(const char* name, const PipelineItem& item)
  {
    if (!item.TrailingComments.empty())
    {
      this->CloseTag();
      this->Comments(item.TrailingComments);
    }
    --this->Depth;
    if (this->Pending)
    {
      this->Out += "/>\n";
      this->Pending = false;
      return;
    }
    this->Indent();
    this->Out += std::string("</") + name + ">\n";
  }

  void Variable(const char* name, const PipelineVariable& v)
  {
    this->Open(name, v);
    this->Attribute("name", v.Name);
    this->Attribute("type", v.Type);
    this->Attribute("default", v.Default);
    this->Attribute("doc", v.Doc);
    this->Close(name, v);
  }

  void Port(const PipelinePort& p)
  {
    this->Open("port", p);
    this->Attribute("name", p.Name);
    this->Attribute("type", p.Type);
    this->Attribute("from", p.From);
    this->Attribute("doc", p.Doc);
    this->Close("port", p);
  }

  void Properties(const char* element, const std::vector<PipelineProperty>& properties)
  {
    for (const PipelineProperty& p : properties)
    {
      this->Open(element, p);
      this->Attribute("name", p.Name);
      this->Attribute("value", p.Value);
      this->Close(element, p);
    }
  }

  void Node(const PipelineNode& n)
  {
    const char* element = n.IsInstance ? "instance" : "node";
    const char* property = n.IsInstance ? "parameter" : "property";
    this->Open(element, n);
    this->Attribute("id", n.Id);
    this->Attribute(n.IsInstance ? "template" : "type", n.Type);
    this->Attribute("doc", n.Doc);
    this->Properties(property, n.Properties);
    for (const PipelineInput& input : n.Inputs)
    {
      this->Open("input", input);
      this->Attribute("port", input.Port);
      this->Attribute("from", input.From);
      this->Attribute("delay", input.Delay);
      this->Attribute("optional", input.Optional);
      for (const PipelineInput::Attribute& a : input.Attributes)
      {
        this->Attribute(a.Name, a.Value);
      }
      this->Close("input", input);
    }
    this->Close(element, n);
  }

private:
  void Indent() { this->Out.append(std::size_t(2 * this->Depth), ' '); }
  void CloseTag()
  {
    if (this->Pending)
    {
      this->Out += ">\n";
      this->Pending = false;
    }
  }
  int Depth = 0;
  bool Pending = false; ///< a start tag is open for attributes
};
}

std::string WritePipelineText(const PipelineDocument& d)
{
  Writer w;
  w.Open("pipeline", d);
  w.Attribute("version", d.Version);
  w.Attribute("doc", d.Doc);
  for (const PipelineAttribute& a : d.Schema)
  {
    w.Attribute(a.Name, a.Value);
  }
  for (const PipelineInclude& i : d.Includes)
  {
    w.Open("include", i);
    w.Attribute("file", i.File);
    w.Close("include", i);
  }
  for (const PipelineVariable& v : d.Variables)
  {
    w.Variable("variable", v);
  }
  if (d.Time.Given)
  {
    w.Open("time", d.Time);
    w.Attribute("first", d.Time.First);
    w.Attribute("count", d.Time.Count);
    w.Attribute("rate", d.Time.Rate);
    w.Close("time", d.Time);
  }
  for (const PipelineTemplate& t : d.Templates)
  {
    w.Open("template", t);
    w.Attribute("name", t.Name);
    w.Attribute("doc", t.Doc);
    for (const PipelineVariable& p : t.Parameters)
    {
      w.Variable("parameter", p);
    }
    for (const PipelinePort& p : t.Inputs)
    {
      w.Port(p);
    }
    for (const PipelineNode& n : t.Nodes)
    {
      w.Node(n);
    }
    for (const PipelinePort& p : t.Outputs)
    {
      w.Port(p);
    }
    w.Close("template", t);
  }
  for (const PipelineNode& n : d.Nodes)
  {
    w.Node(n);
  }
  for (const PipelineOutput& o : d.Outputs)
  {
    w.Open("output", o);
    w.Attribute("name", o.Name);
    w.Attribute("from", o.From);
    w.Attribute("file", o.File);
    w.Attribute("view", o.View);
    w.Attribute("display", o.Display);
    w.Attribute("doc", o.Doc);
    w.Properties("property", o.Properties);
    for (const PipelineLayer& l : o.Layers)
    {
      w.Open("layer", l);
      w.Attribute("from", l.From);
      w.Attribute("name", l.Name);
      w.Attribute("optional", l.Optional);
      w.Close("layer", l);
    }
    w.Close("output", o);
  }
  w.Close("pipeline", d);
  return w.Out;
}
}
