// SPDX-License-Identifier: BSD-3-Clause
#include "quellProvenance.h"

#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <vector>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
std::string Absolute(const std::string& path)
{
  std::error_code code;
  const fs::path absolute = fs::absolute(path, code);
  return code ? path : absolute.lexically_normal().string();
}

bool IsRelativePath(const std::string& text)
{
  return !text.empty() && text[0] != '/' && text.find("://") == std::string::npos;
}

/// A literal text as an attribute's value.
std::string Escaped(const std::string& text)
{
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i)
  {
    out += text.compare(i, 2, "$(") == 0 ? "$$" : std::string(1, text[i]);
  }
  return out;
}

void SetText(PipelineText& text, const std::string& value)
{
  text.Value = value;
  text.Given = true;
}

/// Names in $(...) of a text.
void CollectNames(const std::string& text, std::set<std::string>& names)
{
  for (std::size_t at = 0; (at = text.find("$(", at)) != std::string::npos; at += 2)
  {
    const std::size_t end = text.find(')', at);
    if (end != std::string::npos && (at == 0 || text[at - 1] != '$'))
    {
      names.insert(text.substr(at + 2, end - at - 2));
    }
  }
}

class Writer
{
public:
  Writer(const Graph& graph, const StageRegistry& registry, Diagnostics& diagnostics)
    : Source(graph)
    , Registry(registry)
    , Messages(diagnostics)
    , Out(std::make_shared<PipelineDocument>(*graph.Document))
  {
  }

  std::shared_ptr<PipelineDocument> Write()
  {
    PipelineDocument& d = *this->Out;
    d.Includes.clear();
    d.Variables.clear();
    d.Templates.clear();
    this->Gather(*this->Source.Document);
    const std::set<std::string> usedBefore = this->UsedNames();
    const std::set<std::string> instantiatedBefore = this->Instantiated();
    this->MakePathsAbsolute();
    this->WriteDefines();
    this->WriteOutputs();
    this->WriteSettings();
    this->CheckPaths();
    this->Prune(usedBefore, instantiatedBefore);
    return this->Out;
  }

private:
  /// Included variables and templates first, as the builder declares them; a file may declare a library's variable
  /// anew.
  void Gather(const PipelineDocument& from)
  {
    for (const PipelineInclude& i : from.Includes)
    {
      if (i.Content)
      {
        this->Gather(*i.Content);
      }
    }
    const bool included = &from != this->Source.Document.get();
    for (const PipelineVariable& v : from.Variables)
    {
      auto& all = this->Out->Variables;
      const auto same =
        std::find_if(all.begin(), all.end(), [&v](const PipelineVariable& o) { return o.Name.Value == v.Name.Value; });
      if (same != all.end())
      {
        *same = v;
        this->Included.erase(v.Name.Value);
        continue;
      }
      all.push_back(v);
      if (included)
      {
        this->Included.insert(v.Name.Value);
      }
    }
    for (const PipelineTemplate& t : from.Templates)
    {
      this->Out->Templates.push_back(t);
      if (included)
      {
        this->IncludedTemplates.insert(t.Name.Value);
      }
    }
  }

  /// Variables that anything but a variable nobody uses refers to.
  std::set<std::string> UsedNames() const
  {
    std::set<std::string> names;
    const auto visit = [&names](const PipelineText& t) { CollectNames(t.Value, names); };
    const PipelineDocument& d = *this->Out;
    EachText(d, visit);
    for (std::size_t before = 0; before != names.size();)
    {
      before = names.size();
      for (const PipelineVariable& v : d.Variables)
      {
        if (names.count(v.Name.Value))
        {
          visit(v.Default);
        }
      }
    }
    return names;
  }

  /// Templates that the nodes lead to.
  std::set<std::string> Instantiated() const
  {
    std::set<std::string> names;
    std::vector<const std::vector<PipelineNode>*> open{ &this->Out->Nodes };
    while (!open.empty())
    {
      const std::vector<PipelineNode>& nodes = *open.back();
      open.pop_back();
      for (const PipelineNode& n : nodes)
      {
        if (!n.IsInstance || !names.insert(this->Expanded(n.Type.Value)).second)
        {
          continue;
        }
        for (const PipelineTemplate& t : this->Out->Templates)
        {
          if (t.Name.Value == this->Expanded(n.Type.Value))
          {
            open.push_back(&t.Nodes);
          }
        }
      }
    }
    return names;
  }

  /// With the values of the pipeline's variables; a template's own parameters stay as they are.
  std::string Expanded(const std::string& text) const
  {
    std::string out = text;
    std::set<std::string> names;
    CollectNames(text, names);
    for (const std::string& name : names)
    {
      const auto value = this->Source.Variables.find(name);
      if (value != this->Source.Variables.end())
      {
        const std::string from = "$(" + name + ")";
        for (std::size_t at = 0; (at = out.find(from, at)) != std::string::npos; at += value->second.size())
        {
          out.replace(at, from.size(), value->second);
        }
      }
    }
    return out;
  }

  // ---- paths ----------------------------------------------------------------------------------------------------
  /// A path written in a file, seen from that file. A leading variable brings its own directory.
  void MakeAbsolute(PipelineText& text) const
  {
    if (IsRelativePath(text.Value) && text.Value.compare(0, 2, "$(") != 0)
    {
      const std::string directory = Absolute(DirectoryOf(text.Place.File).empty() ? "." : DirectoryOf(text.Place.File));
      text.Value = (fs::path(Escaped(directory)) / text.Value).lexically_normal().string();
    }
  }

  void MakePathsAbsolute(std::vector<PipelineNode>& nodes) const
  {
    for (PipelineNode& n : nodes)
    {
      const StageDescription* stage = n.IsInstance ? nullptr : this->Registry.Describe(this->Expanded(n.Type.Value));
      const PipelineTemplate* t = n.IsInstance ? this->FindTemplate(this->Expanded(n.Type.Value)) : nullptr;
      for (PipelineProperty& p : n.Properties)
      {
        const Property* property = stage ? stage->FindProperty(p.Name.Value) : nullptr;
        bool path = property && property->Kind == Property::Type::Path;
        for (std::size_t i = 0; t && i < t->Parameters.size(); ++i)
        {
          path = path || (t->Parameters[i].Name.Value == p.Name.Value && t->Parameters[i].Type.Value == "path");
        }
        if (path)
        {
          this->MakeAbsolute(p.Value);
        }
      }
    }
  }

  const PipelineTemplate* FindTemplate(const std::string& name) const
  {
    for (const PipelineTemplate& t : this->Out->Templates)
    {
      if (t.Name.Value == name)
      {
        return &t;
      }
    }
    return nullptr;
  }

  /// Variables and parameters whose values stay as they are, whatever their type says: names of output files, which are
  /// relative to the working directory of each run, and what stands in properties that are no paths, and in the time.
  std::set<std::string> PlainNames() const
  {
    std::set<std::string> names;
    for (const PipelineOutput& o : this->Out->Outputs)
    {
      CollectNames(o.File.Value, names);
    }
    for (const PipelineText* text : { &this->Out->Time.First, &this->Out->Time.Count, &this->Out->Time.Rate })
    {
      CollectNames(text->Value, names);
    }
    this->CollectPlain(this->Out->Nodes, names);
    for (const PipelineTemplate& t : this->Out->Templates)
    {
      this->CollectPlain(t.Nodes, names);
    }
    return names;
  }

  void CollectPlain(const std::vector<PipelineNode>& nodes, std::set<std::string>& names) const
  {
    for (const PipelineNode& n : nodes)
    {
      for (const PipelineProperty& p : n.Properties)
      {
        if (!n.IsInstance && !this->IsPath(this->Expanded(n.Type.Value), this->Expanded(p.Name.Value)))
        {
          CollectNames(p.Value.Value, names);
        }
      }
    }
  }

  void MakePathsAbsolute()
  {
    const std::set<std::string> plain = this->PlainNames();
    for (PipelineVariable& v : this->Out->Variables)
    {
      if (v.Type.Value == "path" && !plain.count(v.Name.Value))
      {
        this->MakeAbsolute(v.Default);
      }
    }
    for (std::size_t i = 0; i < this->Out->Templates.size(); ++i)
    {
      PipelineTemplate& t = this->Out->Templates[i];
      for (PipelineVariable& p : t.Parameters)
      {
        if (p.Type.Value == "path" && !plain.count(p.Name.Value))
        {
          this->MakeAbsolute(p.Default);
        }
      }
      this->MakePathsAbsolute(t.Nodes);
    }
    this->MakePathsAbsolute(this->Out->Nodes);
    for (PipelineOutput& o : this->Out->Outputs)
    {
      for (PipelineProperty& p : o.Properties)
      {
        if (this->IsPath("DisplayTransform", p.Name.Value) || this->IsPath("ImageWriter", p.Name.Value))
        {
          this->MakeAbsolute(p.Value);
        }
      }
    }
  }

  bool IsPath(const std::string& type, const std::string& property) const
  {
    const StageDescription* d = this->Registry.Describe(type);
    const Property* p = d ? d->FindProperty(property) : nullptr;
    return p && p->Kind == Property::Type::Path;
  }

  // ---- what the command line said ---------------------------------------------------------------------------------
  void WriteDefines()
  {
    const std::set<std::string> plain = this->PlainNames();
    for (const auto& define : this->Source.Options.Defines)
    {
      for (PipelineVariable& v : this->Out->Variables)
      {
        if (v.Name.Value == define.first)
        {
          const bool path = v.Type.Value == "path" && !plain.count(define.first) && IsRelativePath(define.second);
          SetText(v.Default, Escaped(path ? Absolute(define.second) : define.second));
        }
      }
    }
  }

  void WriteOutputs()
  {
    for (const auto& a : this->Source.Options.Outputs)
    {
      auto& outputs = this->Out->Outputs;
      auto output =
        std::find_if(outputs.begin(), outputs.end(), [&a](const PipelineOutput& o) { return o.Name.Value == a.first; });
      if (output == outputs.end())
      {
        std::string name;
        for (char c : a.first)
        {
          name += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ? c : '-';
        }
        const std::string stem = name;
        for (int i = 2; std::any_of(
               outputs.begin(), outputs.end(), [&name](const PipelineOutput& o) { return o.Name.Value == name; });
             ++i)
        {
          name = stem + "-" + std::to_string(i);
        }
        // Asked for twice, only the last file is written.
        const auto again = this->NewOutputs.find(a.first);
        if (again != this->NewOutputs.end())
        {
          output = outputs.begin() + again->second;
        }
        else
        {
          PipelineOutput o;
          SetText(o.Name, name);
          SetText(o.From, Escaped(a.first));
          this->NewOutputs[a.first] = std::ptrdiff_t(outputs.size());
          outputs.push_back(o);
          output = outputs.end() - 1;
        }
      }
      SetText(output->File, Escaped(a.second));
    }
  }

  void WriteSettings()
  {
    std::set<std::pair<std::string, std::string>> set;
    for (const auto& a : this->Source.Options.Properties)
    {
      const std::size_t dot = a.first.rfind('.');
      if (dot == std::string::npos)
      {
        continue;
      }
      const std::string path = a.first.substr(0, dot), name = a.first.substr(dot + 1);
      set.insert({ path, name });
      const int n = this->Source.Find(path);
      const Property* property = n >= 0 ? this->Source.Nodes[std::size_t(n)].Description().FindProperty(name) : nullptr;
      const bool absolute = property && property->Kind == Property::Type::Path && IsRelativePath(a.second);
      this->Set(path, name, Escaped(absolute ? Absolute(a.second) : a.second));
    }
    for (const GraphNode& n : this->Source.Nodes)
    {
      if (this->Source.Options.Seed && !n.Internal && n.Description().FindProperty("Seed") &&
          !set.count({ n.Path, "Seed" }))
      {
        this->Set(n.Path, "Seed", std::to_string(*this->Source.Options.Seed));
      }
    }
  }

  void Set(const std::string& path, const std::string& name, const std::string& value)
  {
    const std::size_t colon = path.rfind(':');
    if (colon != std::string::npos)
    {
      this->SetOfOutput(path.substr(0, colon), name, value);
      return;
    }
    std::vector<std::string> ids;
    for (std::size_t at = 0; at <= path.size();)
    {
      const std::size_t slash = std::min(path.find('/', at), path.size());
      ids.push_back(path.substr(at, slash - at));
      at = slash + 1;
    }
    if (!this->SetIn(this->Out->Nodes, ids, 0, name, value))
    {
      Diagnostic d;
      d.Level = Severity::Warning;
      d.Place.File = "command line";
      d.Where = "--set " + path + "." + name;
      d.What = "cannot be written into the files' own pipeline";
      this->Messages.Add(std::move(d));
    }
  }

  void SetOfOutput(const std::string& output, const std::string& name, const std::string& value)
  {
    for (PipelineOutput& o : this->Out->Outputs)
    {
      if (o.Name.Value == output)
      {
        PipelineText* const own = name == "File"      ? &o.File
                                  : name == "View"    ? &o.View
                                  : name == "Display" ? &o.Display
                                                      : nullptr;
        if (own)
        {
          SetText(*own, value);
        }
        else if (o.File.Given)
        {
          SetProperty(o.Properties, name, value);
        }
      }
    }
  }

  static void SetProperty(std::vector<PipelineProperty>& properties, const std::string& name, const std::string& value)
  {
    for (PipelineProperty& p : properties)
    {
      if (p.Name.Value == name)
      {
        SetText(p.Value, value);
        return;
      }
    }
    PipelineProperty p;
    SetText(p.Name, name);
    SetText(p.Value, value);
    properties.push_back(p);
  }

  bool SetIn(std::vector<PipelineNode>& nodes, const std::vector<std::string>& ids, std::size_t at,
    const std::string& name, const std::string& value)
  {
    for (PipelineNode& n : nodes)
    {
      if (this->Expanded(n.Id.Value) != ids[at] || n.IsInstance != (at + 1 < ids.size()))
      {
        continue;
      }
      if (!n.IsInstance)
      {
        SetProperty(n.Properties, name, value);
        return true;
      }
      const PipelineTemplate* t = this->FindTemplate(this->Expanded(n.Type.Value));
      if (!t)
      {
        return false;
      }
      // Other instances keep the template as it is. `nodes` may be of a template: adding one must not move it.
      PipelineTemplate copy = *t;
      const bool own = this->Copies.count(copy.Name.Value) != 0;
      if (!own)
      {
        const std::string stem = copy.Name.Value + "-" + ids[at];
        std::string unique = stem;
        for (int i = 2; this->FindTemplate(unique) || this->Copies.count(unique); ++i)
        {
          unique = stem + "-" + std::to_string(i);
        }
        this->Copies.insert(unique);
        SetText(copy.Name, unique);
      }
      if (!this->SetIn(copy.Nodes, ids, at + 1, name, value))
      {
        return false;
      }
      SetText(n.Type, copy.Name.Value);
      if (!own)
      {
        this->Out->Templates.push_back(copy);
        return true;
      }
      for (PipelineTemplate& old : this->Out->Templates)
      {
        if (old.Name.Value == copy.Name.Value)
        {
          old = copy;
        }
      }
      return true;
    }
    return false;
  }

  // ---- the rest -------------------------------------------------------------------------------------------------
  /// A path put together from a string variable of a library, say, still depends on where that was: such properties are
  /// written out.
  void CheckPaths()
  {
    Diagnostics ignored;
    // From the text alone, and somewhere else.
    const auto document = ReadPipelineText(WritePipelineText(*this->Out), "/pipeline.xml", ignored);
    const std::shared_ptr<Graph> again = BuildGraph(document, this->Registry, GraphOptions(), ignored);
    for (const GraphNode& n : this->Source.Nodes)
    {
      const int same = again->Find(n.Path);
      for (const GraphProperty& p : n.Properties)
      {
        const Property* property = n.Description().FindProperty(p.Name);
        if (!property || property->Kind != Property::Type::Path || p.Text.empty() ||
            p.Text.find("://") != std::string::npos)
        {
          continue;
        }
        bool kept = false;
        for (std::size_t i = 0; same >= 0 && i < again->Nodes[std::size_t(same)].Properties.size(); ++i)
        {
          const GraphProperty& now = again->Nodes[std::size_t(same)].Properties[i];
          kept = kept || (now.Name == p.Name && now.Text == Absolute(p.Text));
        }
        if (!kept)
        {
          this->Set(n.Path, p.Name, Escaped(Absolute(p.Text)));
        }
      }
    }
  }

  void Prune(const std::set<std::string>& usedBefore, const std::set<std::string>& instantiatedBefore)
  {
    const std::set<std::string> instantiated = this->Instantiated();
    auto& templates = this->Out->Templates;
    templates.erase(std::remove_if(templates.begin(), templates.end(),
                      [&](const PipelineTemplate& t)
                      {
                        const std::string& name = t.Name.Value;
                        return !instantiated.count(name) &&
                               (this->IncludedTemplates.count(name) || instantiatedBefore.count(name));
                      }),
      templates.end());
    const std::set<std::string> used = this->UsedNames();
    auto& variables = this->Out->Variables;
    variables.erase(std::remove_if(variables.begin(), variables.end(),
                      [&](const PipelineVariable& v)
                      {
                        const std::string& name = v.Name.Value;
                        return !used.count(name) && (this->Included.count(name) || usedBefore.count(name));
                      }),
      variables.end());
  }

  const Graph& Source;
  const StageRegistry& Registry;
  Diagnostics& Messages;
  std::shared_ptr<PipelineDocument> Out;
  std::set<std::string> Included, IncludedTemplates, Copies;
  std::map<std::string, std::ptrdiff_t> NewOutputs;
};
}

std::shared_ptr<PipelineDocument> SelfContained(
  const Graph& graph, const StageRegistry& registry, Diagnostics& diagnostics)
{
  return Writer(graph, registry, diagnostics).Write();
}

void ContentHash::Add(const void* data, std::size_t bytes)
{
  const unsigned char* p = static_cast<const unsigned char*>(data);
  this->Length += bytes;
  while (bytes > 0)
  {
    const std::size_t take = std::min(bytes, sizeof this->Rest - this->Pending);
    std::memcpy(this->Rest + this->Pending, p, take);
    this->Pending += take;
    p += take;
    bytes -= take;
    if (this->Pending < sizeof this->Rest)
    {
      return;
    }
    this->Pending = 0;
    std::uint64_t w = 0;
    for (int i = 7; i >= 0; --i)
    {
      w = w << 8 | this->Rest[i];
    }
    this->Word(w);
  }
}

std::uint64_t ContentHash::Value() const
{
  ContentHash copy = *this;
  static const unsigned char zeros[8] = {};
  if (copy.Pending)
  {
    copy.Add(zeros, sizeof copy.Rest - copy.Pending);
  }
  copy.Word(this->Length);
  copy.Word(0);
  return copy.State;
}

std::string ContentHash::Hex() const
{
  char out[20];
  std::snprintf(out, sizeof out, "%016llx", static_cast<unsigned long long>(this->Value()));
  return out;
}

std::string HashHex(const std::string& bytes)
{
  ContentHash hash;
  hash.Add(bytes.data(), bytes.size());
  return hash.Hex();
}

namespace
{
void AddFileHash(const std::string& file, std::map<std::string, std::string>& hashes)
{
  const std::string path = Absolute(file);
  std::error_code code;
  if (hashes.count(path) || !fs::is_regular_file(path, code))
  {
    return;
  }
  std::ifstream stream(path, std::ios::binary);
  std::vector<char> buffer(1 << 20);
  ContentHash hash;
  while (stream.read(buffer.data(), std::streamsize(buffer.size())) || stream.gcount() > 0)
  {
    hash.Add(buffer.data(), std::size_t(stream.gcount()));
  }
  if (stream.eof())
  {
    hashes[path] = hash.Hex();
  }
}
}

std::map<std::string, std::string> InputHashes(const Graph& graph)
{
  std::map<std::string, std::string> hashes;
  for (const GraphNode& n : graph.Nodes)
  {
    for (const GraphProperty& p : n.Properties)
    {
      const Property* property = n.Description().FindProperty(p.Name);
      if (property && property->Kind == Property::Type::Path && !p.Text.empty())
      {
        AddFileHash(p.Text, hashes);
      }
    }
  }
  return hashes;
}

std::map<std::string, std::string> SequenceHashes(const Graph& graph, int tick)
{
  std::map<std::string, std::string> hashes;
  for (const GraphNode& n : graph.Nodes)
  {
    for (const std::string& file : n.Stage ? n.Stage->ListSequenceFiles(tick) : std::vector<std::string>())
    {
      AddFileHash(file, hashes);
    }
  }
  return hashes;
}
}
