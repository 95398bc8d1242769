// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelineReader.h"

#include "quellStageDescription.h"
#include "quellXmlDocument.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <set>
#include <system_error>

namespace fs = std::filesystem;

namespace quell
{
std::string JoinPath(const std::string& directory, const std::string& path)
{
  if (directory.empty() || path.empty() || path[0] == '/')
  {
    return path;
  }
  return (fs::path(directory) / path).lexically_normal().string();
}

std::string DirectoryOf(const std::string& path)
{
  return fs::path(path).parent_path().string();
}

namespace
{
struct ElementRule
{
  const char* Name;
  std::vector<std::string> Required, Optional;
  std::vector<std::string> Children;
  bool OpenAttributes = false; ///< further attributes belong to the stage
};

const std::vector<ElementRule>& Rules()
{
  static const std::vector<ElementRule> rules = {
    { "pipeline", { "version" }, { "doc" },
      { "include", "variable", "time", "template", "node", "instance", "output" } },
    { "include", { "file" }, {}, {} },
    { "variable", { "name", "type", "default" }, { "doc" }, {} },
    { "time", {}, { "first", "count", "rate" }, {} },
    { "template", { "name" }, { "doc" }, { "parameter", "port", "node", "instance" } },
    { "node", { "id", "type" }, { "doc" }, { "property", "input" } },
    { "instance", { "id", "template" }, { "doc" }, { "parameter", "input" } },
    { "property", { "name", "value" }, {}, {} },
    { "input", { "port", "from" }, { "delay", "optional" }, {}, true },
    { "port", { "name" }, { "type", "from", "doc" }, {} },
    { "output", { "name" }, { "from", "file", "view", "display", "doc" }, { "property", "layer" } },
    { "layer", { "from" }, { "name", "optional" }, {} },
  };
  return rules;
}
// <parameter> means two things.
const ElementRule& ParameterOfTemplate()
{
  static const ElementRule rule{ "parameter", { "name", "type", "default" }, { "doc" }, {} };
  return rule;
}
const ElementRule& ParameterOfInstance()
{
  static const ElementRule rule{ "parameter", { "name", "value" }, {}, {} };
  return rule;
}
// <input> of an instance: the template's port has no attributes of its own.
const ElementRule& InputOfInstance()
{
  static const ElementRule rule{ "input", { "port", "from" }, { "delay", "optional" }, {} };
  return rule;
}

const ElementRule* FindRule(const std::string& name, const std::string& parent)
{
  if (name == "parameter")
  {
    return parent == "instance" ? &ParameterOfInstance() : &ParameterOfTemplate();
  }
  if (name == "input" && parent == "instance")
  {
    return &InputOfInstance();
  }
  for (const ElementRule& rule : Rules())
  {
    if (name == rule.Name)
    {
      return &rule;
    }
  }
  return nullptr;
}

const char* const SchemaHint =
  "the schema is named in <pipeline>, with xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\"";

/// `<node> "atrous"`: an element as messages call it.
std::string ElementTitle(const XmlElement& e)
{
  for (const char* key : { "id", "name", "port", "file" })
  {
    if (const XmlAttribute* a = e.Find(key))
    {
      return "<" + e.Name + "> " + Quoted(a->Value);
    }
  }
  return "<" + e.Name + ">";
}

std::vector<std::string> Tags(const std::vector<std::string>& names)
{
  std::vector<std::string> tags;
  for (const std::string& n : names)
  {
    tags.push_back("<" + n + ">");
  }
  return tags;
}

class Loader
{
public:
  Loader(Diagnostics& diagnostics)
    : Messages(diagnostics)
  {
  }

  std::shared_ptr<PipelineDocument> LoadFile(
    const std::string& file, const SourceLocation& asked, const std::string& where)
  {
    auto document = std::make_shared<PipelineDocument>();
    document->File = file;
    document->Directory = DirectoryOf(file);
    SourceLocation place = asked;
    if (place.File.empty())
    {
      place.File = file;
    }
    std::error_code code;
    if (!fs::exists(file, code))
    {
      this->Messages.Error(place, where, where.empty() ? "no such file" : "no such file: " + file);
      return document;
    }
    if (!fs::is_regular_file(file, code))
    {
      this->Messages.Error(place, where, where.empty() ? "not a file" : "not a file: " + file);
      return document;
    }
    const std::uintmax_t size = fs::file_size(file, code);
    if (!code && size > XmlLimits().Bytes)
    {
      this->Messages.Error(place, where,
        "the file has " + std::to_string(size) + " bytes, more than the " + std::to_string(XmlLimits().Bytes) +
          " allowed");
      return document;
    }
    std::ifstream stream(file, std::ios::binary);
    if (!stream)
    {
      this->Messages.Error(place, where, where.empty() ? "cannot be opened for reading" : "cannot be opened: " + file);
      return document;
    }
    // A file may grow while it is read, and some have no size at all: past the limit no more is needed to refuse it.
    std::string text;
    char piece[65536];
    while (text.size() <= XmlLimits().Bytes && (stream.read(piece, sizeof piece), stream.gcount() > 0))
    {
      text.append(piece, std::size_t(stream.gcount()));
    }
    this->Parse(text, *document);
    return document;
  }

  void Parse(const std::string& text, PipelineDocument& document)
  {
    XmlElement root;
    if (!ParseXml(text, document.File, root, this->Messages))
    {
      return;
    }
    if (root.Name != "pipeline")
    {
      this->Messages.Error(root.Place, {}, "the root element is <" + root.Name + ">, not <pipeline>");
      return;
    }
    document.Place = root.Place;
    document.Comments = root.Comments;
    document.TrailingComments = root.TrailingComments;
    if (!this->CheckVersion(root))
    {
      return; // a newer grammar would only make misleading errors
    }
    this->TakeSchema(root, document);
    this->Check(root, "");
    document.Version = this->Take(root, "version");
    document.Doc = this->Take(root, "doc");
    const bool included = this->Stack.size() > 1;
    for (const XmlElement& e : root.Children)
    {
      if (included && (e.Name == "time" || e.Name == "node" || e.Name == "instance" || e.Name == "output"))
      {
        this->Messages.Error(
          e.Place, ElementTitle(e), "an included file may hold includes, variables and templates only");
        continue;
      }
      if (e.Name == "include")
      {
        document.Includes.push_back(this->ReadInclude(e, document));
      }
      else if (e.Name == "variable")
      {
        document.Variables.push_back(this->ReadVariable(e));
      }
      else if (e.Name == "time")
      {
        this->ReadTime(e, document);
      }
      else if (e.Name == "template")
      {
        document.Templates.push_back(this->ReadTemplate(e));
      }
      else if (e.Name == "node" || e.Name == "instance")
      {
        document.Nodes.push_back(this->ReadNode(e));
      }
      else if (e.Name == "output")
      {
        document.Outputs.push_back(this->ReadOutput(e));
      }
    }
  }

  std::vector<std::string> Stack; ///< canonical paths of the files being read
  std::set<std::string> Done;     ///< and of those read: a library is loaded once

private:
  bool CheckVersion(const XmlElement& root)
  {
    const XmlAttribute* a = root.Find("version");
    if (!a)
    {
      return true; // Check reports it
    }
    long long version = 0;
    std::string error;
    if (!detail::ParseInt(a->Value, 1, 1000000, version, error))
    {
      this->Messages.Error(
        a->Place, "<pipeline>", "version = " + error, "this program reads version " + std::to_string(PipelineVersion));
      return false;
    }
    if (version > PipelineVersion)
    {
      this->Messages.Error(a->Place, {},
        "pipeline version " + std::to_string(version) + " is newer than this program understands (" +
          std::to_string(PipelineVersion) + ")");
      return false;
    }
    return true;
  }

  /// What XML editors write into the root: namespace prefixes, and where the schema is.
  void TakeSchema(XmlElement& root, PipelineDocument& document) const
  {
    std::vector<XmlAttribute> own;
    for (const XmlAttribute& a : root.Attributes)
    {
      const std::size_t colon = a.Name.find(':');
      const std::string prefix = a.Name.substr(0, colon);
      const std::string name = colon == std::string::npos ? std::string() : a.Name.substr(colon + 1);
      const XmlAttribute* space = root.Find("xmlns:" + prefix);
      const bool schema = (name == "noNamespaceSchemaLocation" || name == "schemaLocation") && space &&
                          space->Value == "http://www.w3.org/2001/XMLSchema-instance";
      if (schema || (prefix == "xmlns" && !name.empty()))
      {
        PipelineText text(a.Value);
        text.Place = a.Place;
        document.Schema.push_back({ a.Name, text });
      }
      else
      {
        own.push_back(a);
      }
    }
    root.Attributes.swap(own);
  }

  /// Unknown and missing attributes, unknown children, stray text; whole subtree.
  void Check(const XmlElement& e, const std::string& parent)
  {
    const ElementRule* rule = FindRule(e.Name, parent);
    if (!rule)
    {
      return;
    }
    std::vector<std::string> known = rule->Required;
    known.insert(known.end(), rule->Optional.begin(), rule->Optional.end());
    for (const XmlAttribute& a : e.Attributes)
    {
      if (!rule->OpenAttributes && std::find(known.begin(), known.end(), a.Name) == known.end())
      {
        const std::string near = DidYouMean(a.Name, known);
        this->Messages.Error(a.Place, ElementTitle(e), "no attribute " + Quoted(a.Name),
          a.Name.compare(0, 4, "xsi:") == 0 ? SchemaHint
          : near.empty()                    ? "it may have " + Listed(known)
                                            : near);
      }
    }
    for (const std::string& name : rule->Required)
    {
      if (!e.Find(name))
      {
        this->Messages.Error(e.Place, ElementTitle(e), "attribute " + Quoted(name) + " is missing");
      }
    }
    if (!e.Text.empty())
    {
      this->Messages.Error(e.TextPlace, ElementTitle(e), "text " + Quoted(e.Text) + " does not belong here",
        "values are written as attributes");
    }
    for (const XmlElement& child : e.Children)
    {
      if (std::find(rule->Children.begin(), rule->Children.end(), child.Name) == rule->Children.end())
      {
        const std::string near = DidYouMean(child.Name, rule->Children);
        this->Messages.Error(child.Place, ElementTitle(e), "element <" + child.Name + "> does not belong here",
          !near.empty()            ? near
          : rule->Children.empty() ? "it holds no elements"
                                   : "it may hold " + Listed(Tags(rule->Children)));
        continue;
      }
      this->Check(child, e.Name);
    }
  }

  PipelineText Take(const XmlElement& e, const char* name) const
  {
    PipelineText text;
    text.Place = e.Place;
    if (const XmlAttribute* a = e.Find(name))
    {
      text.Value = a->Value;
      text.Place = a->Place;
      text.Given = true;
    }
    return text;
  }

  static void TakeItem(const XmlElement& e, PipelineItem& item)
  {
    item.Place = e.Place;
    item.Comments = e.Comments;
    item.TrailingComments = e.TrailingComments;
  }

  PipelineVariable ReadVariable(const XmlElement& e) const
  {
    PipelineVariable v;
    TakeItem(e, v);
    v.Name = this->Take(e, "name");
    v.Type = this->Take(e, "type");
    v.Default = this->Take(e, "default");
    v.Doc = this->Take(e, "doc");
    return v;
  }

  PipelineProperty ReadProperty(const XmlElement& e) const
  {
    PipelineProperty p;
    TakeItem(e, p);
    p.Name = this->Take(e, "name");
    p.Value = this->Take(e, "value");
    return p;
  }

  void ReadTime(const XmlElement& e, PipelineDocument& document)
  {
    if (document.Time.Given)
    {
      this->Messages.Error(e.Place, "<time>", "the time is already given at " + document.Time.Place.ToText());
      return;
    }
    TakeItem(e, document.Time);
    document.Time.Given = true;
    document.Time.First = this->Take(e, "first");
    document.Time.Count = this->Take(e, "count");
    document.Time.Rate = this->Take(e, "rate");
  }

  PipelineTemplate ReadTemplate(const XmlElement& e) const
  {
    PipelineTemplate t;
    TakeItem(e, t);
    t.Name = this->Take(e, "name");
    t.Doc = this->Take(e, "doc");
    for (const XmlElement& c : e.Children)
    {
      if (c.Name == "parameter")
      {
        t.Parameters.push_back(this->ReadVariable(c));
      }
      else if (c.Name == "port")
      {
        PipelinePort p;
        TakeItem(c, p);
        p.Name = this->Take(c, "name");
        p.Type = this->Take(c, "type");
        p.From = this->Take(c, "from");
        p.Doc = this->Take(c, "doc");
        (p.From.Given ? t.Outputs : t.Inputs).push_back(p);
      }
      else if (c.Name == "node" || c.Name == "instance")
      {
        t.Nodes.push_back(this->ReadNode(c));
      }
    }
    return t;
  }

  PipelineNode ReadNode(const XmlElement& e) const
  {
    PipelineNode n;
    TakeItem(e, n);
    n.IsInstance = e.Name == "instance";
    n.Id = this->Take(e, "id");
    n.Type = this->Take(e, n.IsInstance ? "template" : "type");
    n.Doc = this->Take(e, "doc");
    for (const XmlElement& c : e.Children)
    {
      if (c.Name == (n.IsInstance ? "parameter" : "property"))
      {
        n.Properties.push_back(this->ReadProperty(c));
      }
      else if (c.Name == "input")
      {
        PipelineInput input;
        TakeItem(c, input);
        input.Port = this->Take(c, "port");
        input.From = this->Take(c, "from");
        input.Delay = this->Take(c, "delay");
        input.Optional = this->Take(c, "optional");
        for (const XmlAttribute& a : c.Attributes)
        {
          if (a.Name != "port" && a.Name != "from" && a.Name != "delay" && a.Name != "optional")
          {
            input.Attributes.push_back({ a.Name, this->Take(c, a.Name.c_str()) });
          }
        }
        n.Inputs.push_back(input);
      }
    }
    return n;
  }

  PipelineOutput ReadOutput(const XmlElement& e)
  {
    PipelineOutput o;
    TakeItem(e, o);
    o.Name = this->Take(e, "name");
    o.From = this->Take(e, "from");
    o.File = this->Take(e, "file");
    o.View = this->Take(e, "view");
    o.Display = this->Take(e, "display");
    o.Doc = this->Take(e, "doc");
    for (const XmlElement& c : e.Children)
    {
      if (c.Name == "layer")
      {
        PipelineLayer layer;
        TakeItem(c, layer);
        layer.From = this->Take(c, "from");
        layer.Name = this->Take(c, "name");
        layer.Optional = this->Take(c, "optional");
        o.Layers.push_back(layer);
      }
      else if (c.Name == "property")
      {
        o.Properties.push_back(this->ReadProperty(c));
      }
    }
    if (!o.From.Given && o.Layers.empty())
    {
      this->Messages.Error(
        e.Place, ElementTitle(e), "attribute \"from\" is missing", "say what to write, or give <layer>s");
    }
    return o;
  }

  PipelineInclude ReadInclude(const XmlElement& e, const PipelineDocument& document)
  {
    PipelineInclude include;
    TakeItem(e, include);
    include.File = this->Take(e, "file");
    if (!include.File.Given)
    {
      return include;
    }
    const std::string where = "include " + Quoted(include.File.Value);
    if (include.File.Value.empty())
    {
      this->Messages.Error(include.File.Place, where, "the name is empty");
      return include;
    }
    if (include.File.Value.size() > 4096)
    {
      this->Messages.Error(include.File.Place, where, "the name has more than 4096 characters");
      return include;
    }
    if (include.File.Value.find("$(") != std::string::npos)
    {
      this->Messages.Error(include.File.Place, where, "the name of an included file cannot hold variables");
      return include;
    }
    const std::string path = JoinPath(document.Directory, include.File.Value);
    std::error_code code;
    std::string canonical = fs::weakly_canonical(path, code).string();
    if (code)
    {
      canonical = path;
    }
    const auto open = std::find(this->Stack.begin(), this->Stack.end(), canonical);
    if (open != this->Stack.end())
    {
      std::string loop;
      for (auto file = open; file != this->Stack.end(); ++file)
      {
        loop += fs::path(*file).filename().string() + " -> ";
      }
      this->Messages.Error(
        include.File.Place, where, "the file includes itself: " + loop + fs::path(canonical).filename().string());
      return include;
    }
    if (this->Stack.size() > 16)
    {
      this->Messages.Error(include.File.Place, where, "files are included more than 16 deep");
      return include;
    }
    if (!this->Done.insert(canonical).second)
    {
      return include;
    }
    this->Stack.push_back(canonical);
    include.Content = this->LoadFile(path, include.File.Place, where);
    this->Stack.pop_back();
    return include;
  }

  Diagnostics& Messages;
};

std::string Canonical(const std::string& file)
{
  std::error_code code;
  const std::string path = fs::weakly_canonical(file, code).string();
  return code ? file : path;
}
}

std::shared_ptr<PipelineDocument> ReadPipelineFile(const std::string& file, Diagnostics& diagnostics)
{
  Loader loader(diagnostics);
  loader.Stack.push_back(Canonical(file));
  return loader.LoadFile(file, SourceLocation(), {});
}

std::shared_ptr<PipelineDocument> ReadPipelineText(
  const std::string& text, const std::string& file, Diagnostics& diagnostics)
{
  Loader loader(diagnostics);
  loader.Stack.push_back(Canonical(file));
  auto document = std::make_shared<PipelineDocument>();
  document->File = file;
  document->Directory = DirectoryOf(file);
  loader.Parse(text, *document);
  return document;
}
}
