// SPDX-License-Identifier: BSD-3-Clause
#include "quellEditDocument.h"

#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellRenderSession.h"
#include "quellTemporaryFile.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
const std::size_t MaximumSteps = 500;
const char* const OutputPrefix = "output:";
const char* const PortPrefix = "port:";

bool HasPrefix(const std::string& s, const char* prefix)
{
  return s.compare(0, std::strlen(prefix), prefix) == 0;
}
std::string After(const std::string& s, const char* prefix)
{
  return s.substr(std::strlen(prefix));
}

bool RefersTo(const std::string& from, const std::string& id)
{
  return from == id || (from.size() > id.size() && from.compare(0, id.size(), id) == 0 && from[id.size()] == ':');
}

std::string Renamed(const std::string& from, const std::string& id, const std::string& now)
{
  return RefersTo(from, id) ? now + from.substr(id.size()) : from;
}

std::shared_ptr<PipelineDocument> Empty()
{
  auto d = std::make_shared<PipelineDocument>();
  d->Version = "1";
  d->File = "untitled.xml";
  return d;
}

/// False: it cannot be opened, and the text is empty.
bool ReadWhole(const std::string& file, std::string& text)
{
  std::ifstream stream(file, std::ios::binary);
  std::stringstream all;
  all << stream.rdbuf();
  text = all.str();
  return stream.is_open();
}

/// `document` with the places that it has in a file of that text; null where the text says something else. Included
/// files are not read again.
std::shared_ptr<PipelineDocument> LocatedIn(
  const std::string& text, const std::string& file, const PipelineDocument& document)
{
  Diagnostics messages;
  std::shared_ptr<PipelineDocument> located = ReadPipelineText(text, file, messages);
  if (!located || *located != document || located->Includes.size() != document.Includes.size())
  {
    return nullptr;
  }
  for (std::size_t i = 0; i < located->Includes.size(); ++i)
  {
    located->Includes[i].Content = document.Includes[i].Content;
  }
  return located;
}

/// Places of texts keep naming the file they are from, so that relative paths go on being seen from there.
PipelineText TextAt(const PipelineDocument& d, const std::string& value)
{
  PipelineText t(value);
  t.Place.File = d.File;
  return t;
}

const PipelineTemplate* TemplateWithin(const PipelineDocument& d, const std::string& name)
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
    if (const PipelineTemplate* t = i.Content ? TemplateWithin(*i.Content, name) : nullptr)
    {
      return t;
    }
  }
  return nullptr;
}
}

std::string PositionKey(const std::string& scope, const std::string& box)
{
  return scope.empty() ? box : scope + "/" + box;
}

bool IsPipelineName(const std::string& s)
{
  if (s.empty() || s.size() > 128)
  {
    return false;
  }
  for (std::size_t i = 0; i < s.size(); ++i)
  {
    const char c = s[i];
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
    if (!letter && (i == 0 || !((c >= '0' && c <= '9') || c == '-')))
    {
      return false;
    }
  }
  return true;
}

EditDocument::EditDocument(const StageRegistry* registry)
  : Registry(registry)
{
  this->Clear();
}

void EditDocument::Clear()
{
  this->Set(Empty());
}

void EditDocument::Set(std::shared_ptr<const PipelineDocument> document)
{
  this->Now = { document, {} };
  this->ShownPlaces.clear();
  this->Undone.clear();
  this->Redone.clear();
  this->MergeKey.clear();
  this->Path.clear();
  this->SavedText.clear();
  this->SavedDocument = document;
  this->SavedPositions.clear();
  ++this->Count;
}

bool EditDocument::Open(const std::string& file, std::vector<Diagnostic>& messages)
{
  Diagnostics d;
  std::error_code ec;
  std::string text;
  if (!fs::is_regular_file(file, ec) || !ReadWhole(file, text))
  {
    SourceLocation place;
    place.File = file;
    d.Error(place, {}, fs::exists(file, ec) ? "cannot be read" : "there is no such file");
    messages = d.All();
    return false;
  }
  auto document = ReadPipelineFile(file, d);
  d.Sort();
  messages = d.All();
  // Mistakes below the root are shown in the graph; without a root there is nothing to show.
  const bool isPipeline = document && (document->Version.Given || !document->Nodes.empty() ||
                                        !document->Templates.empty() || !document->Outputs.empty());
  if (!isPipeline && d.HasErrors())
  {
    return false;
  }
  this->Set(document);
  this->Path = file;
  this->SavedText = text;
  this->Now.Positions = this->SavedPositions = ReadPipelinePositions(this->SavedText);
  return true;
}

bool EditDocument::IsDirty() const
{
  return (this->Now.Document != this->SavedDocument && *this->Now.Document != *this->SavedDocument) ||
         this->Now.Positions != this->SavedPositions;
}

std::string EditDocument::Text() const
{
  const std::string body = this->SavedText.empty() ? WritePipelineText(*this->Now.Document)
                                                   : PatchPipelineText(this->SavedText, *this->Now.Document);
  return this->Now.Positions == ReadPipelinePositions(body) ? body : WithPipelinePositions(body, this->Now.Positions);
}

bool EditDocument::Save(const std::string& file, std::string& error)
{
  if (file.empty())
  {
    error = "the pipeline has no file yet";
    return false;
  }
  const State before = this->Now;
  const std::string directory = fs::path(file).parent_path().string();
  if (this->Path != file)
  {
    auto moved = std::make_shared<PipelineDocument>(*this->Now.Document);
    this->MovePaths(*moved, directory);
    this->Now.Document = moved;
  }
  const std::string text = this->Text();
  // A link stays one: what it leads to is written.
  std::error_code ec;
  const fs::path real = fs::is_symlink(file, ec) ? fs::weakly_canonical(file, ec) : fs::path(file);
  TemporaryFile temporary(real.string());
  // What was not saved stays as it was, its paths seen from where it is.
  const auto fail = [&](const std::string& why)
  {
    error = "cannot write " + file + ": " + why;
    this->Now = before;
    return false;
  };
  temporary.Write(text);
  if (const int failure = temporary.Rename())
  {
    return fail(std::strerror(failure));
  }
  this->SavedText = text;
  this->SavedPositions = this->Now.Positions;
  if (this->Path != file)
  {
    // Relative paths are seen from the file: read it as it will be read.
    this->Path = file;
    Diagnostics ignored;
    this->Now.Document = ReadPipelineFile(file, ignored);
    // So does every earlier and later state, or undoing would lead back to paths that lead nowhere from here.
    for (std::vector<Step>* steps : { &this->Undone, &this->Redone })
    {
      for (Step& step : *steps)
      {
        auto moved = std::make_shared<PipelineDocument>(*step.Before.Document);
        this->MovePaths(*moved, directory);
        step.Before.Document = LocatedIn(PatchPipelineText(text, *moved), file, *moved);
        if (!step.Before.Document)
        {
          this->Undone.clear();
          this->Redone.clear();
          break;
        }
      }
    }
    this->MergeKey.clear();
    ++this->Count;
  }
  this->SavedDocument = this->Now.Document;
  return true;
}

bool EditDocument::ChangedOnDisk() const
{
  std::error_code ec;
  if (this->Path.empty() || !fs::is_regular_file(this->Path, ec))
  {
    return false;
  }
  std::string text;
  ReadWhole(this->Path, text);
  return text != this->SavedText;
}

void EditDocument::MovePaths(PipelineDocument& d, const std::string& directory) const
{
  std::error_code ec;
  const fs::path from =
    fs::weakly_canonical(fs::absolute(d.Directory.empty() ? fs::path(".") : fs::path(d.Directory), ec), ec);
  const fs::path to =
    fs::weakly_canonical(fs::absolute(directory.empty() ? fs::path(".") : fs::path(directory), ec), ec);
  if (from == to)
  {
    return;
  }
  const auto move = [&](PipelineText& text)
  {
    if (text.Value.empty() || text.Value.find("$(") != std::string::npos || fs::path(text.Value).is_absolute())
    {
      return;
    }
    const fs::path full = fs::weakly_canonical(from / text.Value, ec);
    const fs::path relative = full.lexically_relative(to);
    text.Value = relative.empty() ? full.generic_string() : relative.generic_string();
  };
  for (PipelineInclude& i : d.Includes)
  {
    move(i.File);
  }
  for (PipelineVariable& v : d.Variables)
  {
    if (v.Type.Value == "path")
    {
      move(v.Default);
    }
  }
  const auto nodes = [&](std::vector<PipelineNode>& list)
  {
    for (PipelineNode& n : list)
    {
      const StageDescription* type = this->Registry && !n.IsInstance ? this->Registry->Describe(n.Type.Value) : nullptr;
      for (PipelineProperty& p : n.Properties)
      {
        const Property* row = type ? type->FindProperty(p.Name.Value) : nullptr;
        if (row && row->Kind == Property::Type::Path)
        {
          move(p.Value);
        }
      }
    }
  };
  nodes(d.Nodes);
  for (PipelineTemplate& t : d.Templates)
  {
    nodes(t.Nodes);
  }
}

// ---- steps ----------------------------------------------------------------------------------------------------------
PipelineDocument& EditDocument::Begin()
{
  this->Draft = std::make_shared<PipelineDocument>(*this->Now.Document);
  this->DraftPositions = this->Now.Positions;
  return *this->Draft;
}

void EditDocument::Commit(const std::string& label, const std::string& mergeKey)
{
  const bool merges = !mergeKey.empty() && mergeKey == this->MergeKey && !this->Undone.empty();
  const bool changes = *this->Draft != *this->Now.Document || this->DraftPositions != this->Now.Positions;
  if (changes)
  {
    if (!merges)
    {
      this->Undone.push_back({ this->Now, label });
      if (this->Undone.size() > MaximumSteps)
      {
        this->Undone.erase(this->Undone.begin());
      }
    }
    this->Redone.clear();
    const bool sameDocument = *this->Draft == *this->Now.Document;
    this->Now.Positions = this->DraftPositions;
    if (!sameDocument)
    {
      this->Now.Document = this->Draft; // a box that was moved leaves the session's document alone
      this->Locate();
    }
    ++this->Count;
    this->MergeKey = mergeKey;
  }
  this->Draft.reset();
}

/// Messages name lines: those of what saving would write, not those of what was opened.
void EditDocument::Locate()
{
  const PipelineDocument& now = *this->Now.Document;
  if (const auto located = LocatedIn(this->Text(), now.File, now))
  {
    located->Directory = now.Directory;
    this->Now.Document = located;
  }
}

void EditDocument::Undo()
{
  if (this->Undone.empty())
  {
    return;
  }
  const Step step = this->Undone.back();
  this->Undone.pop_back();
  this->Redone.push_back({ this->Now, step.Label });
  this->Now = step.Before;
  this->MergeKey.clear();
  ++this->Count;
}

void EditDocument::Redo()
{
  if (this->Redone.empty())
  {
    return;
  }
  const Step step = this->Redone.back();
  this->Redone.pop_back();
  this->Undone.push_back({ this->Now, step.Label });
  this->Now = step.Before;
  this->MergeKey.clear();
  ++this->Count;
}

void EditDocument::Replace(const std::string& label, std::shared_ptr<const PipelineDocument> document)
{
  this->Begin() = *document;
  this->Commit(label);
}

// ---- looking things up ----------------------------------------------------------------------------------------------
std::vector<PipelineNode>* EditDocument::EditNodes(PipelineDocument& d, const std::string& scope) const
{
  if (scope.empty())
  {
    return &d.Nodes;
  }
  for (PipelineTemplate& t : d.Templates)
  {
    if (t.Name.Value == scope)
    {
      return &t.Nodes;
    }
  }
  return nullptr;
}

PipelineNode* EditDocument::EditNode(PipelineDocument& d, const std::string& scope, const std::string& id) const
{
  std::vector<PipelineNode>* nodes = this->EditNodes(d, scope);
  if (nodes)
  {
    for (PipelineNode& n : *nodes)
    {
      if (n.Id.Value == id)
      {
        return &n;
      }
    }
  }
  return nullptr;
}

PipelineTemplate* EditDocument::EditTemplate(PipelineDocument& d, const std::string& name) const
{
  for (PipelineTemplate& t : d.Templates)
  {
    if (t.Name.Value == name)
    {
      return &t;
    }
  }
  return nullptr;
}

std::string EditDocument::FreeTemplateName(const std::string& hint) const
{
  std::string name = IsPipelineName(hint) ? hint : "group";
  const std::string stem = name;
  for (int i = 2; this->FindTemplate(name); ++i)
  {
    name = stem + std::to_string(i);
  }
  return name;
}

std::string EditDocument::MakeTemplate(const std::vector<std::string>& boxes, const std::string& name,
  const std::function<std::string(const std::string&)>& typeOf, std::string& error)
{
  if (!IsPipelineName(name))
  {
    error = Quoted(name) + " is no name: letters, digits, _ and -, beginning with a letter";
    return {};
  }
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  std::set<std::string> chosen;
  for (const PipelineNode& n : d.Nodes)
  {
    if (std::find(boxes.begin(), boxes.end(), n.Id.Value) != boxes.end())
    {
      chosen.insert(n.Id.Value);
    }
  }
  if (chosen.empty())
  {
    error = "select the nodes that belong together";
    return {};
  }
  const auto isInside = [&chosen](const std::string& from) { return chosen.count(TopOf(NodeOfReference(from))) != 0; };
  // Who is needed by the chosen and needs them would be on both sides of the instance.
  std::map<std::string, std::set<std::string>> reads;
  for (const PipelineNode& n : d.Nodes)
  {
    for (const PipelineInput& i : n.Inputs)
    {
      if (!i.Delay.Given)
      {
        reads[n.Id.Value].insert(TopOf(NodeOfReference(i.From.Value)));
      }
    }
  }
  const auto behind = [&](const std::set<std::string>& start, const auto& next)
  {
    std::set<std::string> found;
    std::vector<std::string> open(start.begin(), start.end());
    while (!open.empty())
    {
      const std::string id = open.back();
      open.pop_back();
      for (const std::string& n : next(id))
      {
        if (!start.count(n) && found.insert(n).second)
        {
          open.push_back(n);
        }
      }
    }
    return found;
  };
  const std::set<std::string> before = behind(chosen, [&](const std::string& id) { return reads[id]; });
  const std::set<std::string> after = behind(chosen,
    [&](const std::string& id)
    {
      std::set<std::string> readers;
      for (const auto& r : reads)
      {
        if (r.second.count(id))
        {
          readers.insert(r.first);
        }
      }
      return readers;
    });
  for (const std::string& id : before)
  {
    if (after.count(id))
    {
      error = Quoted(id) + " lies between them: select it, too";
      return {};
    }
  }

  PipelineTemplate t;
  t.Name = TextAt(d, this->FreeTemplateName(name));
  t.Place.File = d.File;
  const auto portName = [&t](std::string hint)
  {
    hint = IsPipelineName(hint) ? hint : "port";
    std::string free = hint;
    const auto taken = [&](const PipelinePort& p) { return p.Name.Value == free; };
    for (int i = 2;
         std::any_of(t.Inputs.begin(), t.Inputs.end(), taken) || std::any_of(t.Outputs.begin(), t.Outputs.end(), taken);
         ++i)
    {
      free = hint + std::to_string(i);
    }
    return free;
  };
  PipelineNode instance;
  instance.IsInstance = true;
  instance.Id = TextAt(d, this->FreeName("", t.Name.Value));
  instance.Type = t.Name;
  instance.Place.File = d.File;
  std::map<std::string, std::string> in, out; // what is read -> port
  for (const PipelineNode& n : d.Nodes)
  {
    if (!chosen.count(n.Id.Value))
    {
      continue;
    }
    PipelineNode inner = n;
    for (PipelineInput& i : inner.Inputs)
    {
      if (i.From.Value.empty() || isInside(i.From.Value))
      {
        continue;
      }
      // A port read from the previous frame is another one: the delay stands outside.
      const std::string key = i.From.Value + (i.Delay.Given ? " " + i.Delay.Value : std::string());
      auto known = in.find(key);
      if (known == in.end())
      {
        PipelinePort port;
        port.Name = TextAt(d, portName(i.Port.Value));
        const std::string type = typeOf ? typeOf(i.From.Value) : std::string();
        if (!type.empty())
        {
          port.Type = TextAt(d, type);
        }
        port.Place.File = d.File;
        t.Inputs.push_back(port);
        PipelineInput outer;
        outer.Port = port.Name;
        outer.From = i.From;
        outer.Delay = i.Delay;
        outer.Place.File = d.File;
        instance.Inputs.push_back(outer);
        known = in.emplace(key, port.Name.Value).first;
      }
      i.From = TextAt(d, "@" + known->second);
      i.Delay = PipelineText();
    }
    t.Nodes.push_back(inner);
  }
  const auto lead = [&](PipelineText& from)
  {
    if (from.Value.empty() || !isInside(from.Value))
    {
      return;
    }
    auto known = out.find(from.Value);
    if (known == out.end())
    {
      std::string array;
      NodeOfReference(from.Value, &array);
      PipelinePort port;
      port.Name = TextAt(d, portName(out.empty() ? "out" : array.empty() ? "out" : array));
      port.From = TextAt(d, from.Value);
      port.Place.File = d.File;
      t.Outputs.push_back(port);
      known = out.emplace(from.Value, port.Name.Value).first;
    }
    from = TextAt(d, instance.Id.Value + ":" + known->second);
  };
  std::vector<PipelineNode> nodes;
  bool placed = false;
  for (PipelineNode& n : d.Nodes)
  {
    if (chosen.count(n.Id.Value))
    {
      if (!placed)
      {
        nodes.push_back(instance);
      }
      placed = true;
      continue;
    }
    for (PipelineInput& i : n.Inputs)
    {
      lead(i.From);
    }
    nodes.push_back(n);
  }
  for (PipelineOutput& o : d.Outputs)
  {
    lead(o.From);
    for (PipelineLayer& l : o.Layers)
    {
      lead(l.From);
    }
  }
  // What the instance itself reads of the previous frame of its own.
  for (PipelineNode& n : nodes)
  {
    if (n.Id.Value == instance.Id.Value)
    {
      for (PipelineInput& i : n.Inputs)
      {
        lead(i.From);
      }
    }
  }
  if (t.Outputs.empty())
  {
    // Nobody reads them yet: the last one that none of them reads.
    std::string last;
    for (const PipelineNode& n : t.Nodes)
    {
      const bool read = std::any_of(t.Nodes.begin(), t.Nodes.end(),
        [&](const PipelineNode& m)
        {
          return std::any_of(m.Inputs.begin(), m.Inputs.end(),
            [&](const PipelineInput& i) { return TopOf(NodeOfReference(i.From.Value)) == n.Id.Value; });
        });
      last = read && !last.empty() ? last : n.Id.Value;
    }
    PipelinePort port;
    port.Name = TextAt(d, portName("out"));
    port.From = TextAt(d, last);
    port.Place.File = d.File;
    t.Outputs.push_back(port);
  }
  d.Nodes = std::move(nodes);
  const std::string id = instance.Id.Value;
  double x = 0, y = 0, left = 1e300, top = 1e300;
  int count = 0;
  for (const std::string& box : chosen)
  {
    const auto at = this->DraftPositions.find(PositionKey("", box));
    if (at != this->DraftPositions.end())
    {
      x += at->second.first;
      y += at->second.second;
      left = std::min(left, at->second.first);
      top = std::min(top, at->second.second);
      ++count;
    }
  }
  for (const std::string& box : chosen)
  {
    const auto at = this->DraftPositions.find(PositionKey("", box));
    if (at != this->DraftPositions.end())
    {
      const auto place = at->second;
      this->DraftPositions.erase(at);
      this->Place(t.Name.Value, box, place.first - left + 260, place.second - top + 40);
    }
  }
  if (count > 0)
  {
    this->Place("", id, x / count, y / count);
  }
  d.Templates.push_back(std::move(t));
  this->Commit("make a template of " + std::to_string(chosen.size()) + (chosen.size() == 1 ? " node" : " nodes"));
  return id;
}

std::string EditDocument::AdoptTemplate(const std::string& name, std::string& error)
{
  const PipelineTemplate* from = this->FindTemplate(name);
  if (!from || this->IsEditable(name))
  {
    error = from ? Quoted(name) + " is this file's already" : "there is no template " + Quoted(name);
    return {};
  }
  PipelineTemplate copy = *from;
  PipelineDocument& d = this->Begin();
  copy.Name = TextAt(d, this->FreeTemplateName(name));
  const auto adopt = [&](std::vector<PipelineNode>& nodes)
  {
    for (PipelineNode& n : nodes)
    {
      if (n.IsInstance && n.Type.Value == name)
      {
        n.Type.Value = copy.Name.Value;
      }
    }
  };
  adopt(d.Nodes);
  for (PipelineTemplate& t : d.Templates)
  {
    adopt(t.Nodes);
  }
  const std::string made = copy.Name.Value;
  d.Templates.push_back(std::move(copy));
  this->Commit("copy template " + name);
  return made;
}

namespace
{
/// `t`: null where the template cannot be edited.
bool CanAddPort(const PipelineTemplate* t, const std::string& name, std::string& error)
{
  const auto named = [&name](const PipelinePort& p) { return p.Name.Value == name; };
  if (!t || !IsPipelineName(name) || std::any_of(t->Inputs.begin(), t->Inputs.end(), named) ||
      std::any_of(t->Outputs.begin(), t->Outputs.end(), named))
  {
    error = !t                      ? "this template belongs to another file"
            : !IsPipelineName(name) ? Quoted(name) + " is no name: letters, digits, _ and -, beginning with a letter"
                                    : "there is a port " + Quoted(name) + " already";
    return false;
  }
  return true;
}
}

bool EditDocument::AddTemplateInput(
  const std::string& scope, const std::string& name, const std::string& type, std::string& error)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  PipelineTemplate* t = this->EditTemplate(d, scope);
  if (!CanAddPort(t, name, error))
  {
    return false;
  }
  PipelinePort port;
  port.Name = TextAt(d, name);
  port.Type = type.empty() ? PipelineText() : TextAt(d, type);
  port.Place.File = d.File;
  t->Inputs.push_back(port);
  this->Commit("add port " + name);
  return true;
}

bool EditDocument::AddTemplateOutput(
  const std::string& scope, const std::string& name, const std::string& from, std::string& error)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  PipelineTemplate* t = this->EditTemplate(d, scope);
  if (!CanAddPort(t, name, error))
  {
    return false;
  }
  PipelinePort port;
  port.Name = TextAt(d, name);
  port.From = TextAt(d, from);
  port.Place.File = d.File;
  t->Outputs.push_back(port);
  this->Commit("add port " + name);
  return true;
}

bool EditDocument::RemoveTemplatePort(const std::string& scope, const std::string& name)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  PipelineTemplate* t = this->EditTemplate(d, scope);
  if (!t)
  {
    return false;
  }
  const auto named = [&name](const PipelinePort& p) { return p.Name.Value == name; };
  const auto input = std::find_if(t->Inputs.begin(), t->Inputs.end(), named);
  const auto output = std::find_if(t->Outputs.begin(), t->Outputs.end(), named);
  const auto drop = [](std::vector<PipelineInput>& inputs, const std::function<bool(const PipelineInput&)>& gone)
  { inputs.erase(std::remove_if(inputs.begin(), inputs.end(), gone), inputs.end()); };
  std::vector<std::vector<PipelineNode>*> scopes{ &d.Nodes };
  for (PipelineTemplate& other : d.Templates)
  {
    scopes.push_back(&other.Nodes);
  }
  if (input != t->Inputs.end())
  {
    t->Inputs.erase(input);
    for (PipelineNode& n : t->Nodes)
    {
      drop(n.Inputs, [&](const PipelineInput& i) { return i.From.Value == "@" + name; });
    }
    for (std::vector<PipelineNode>* nodes : scopes)
    {
      for (PipelineNode& n : *nodes)
      {
        if (n.IsInstance && n.Type.Value == scope)
        {
          drop(n.Inputs, [&](const PipelineInput& i) { return i.Port.Value == name; });
        }
      }
    }
  }
  else if (output != t->Outputs.end() && t->Outputs.size() > 1)
  {
    t->Outputs.erase(output);
    for (std::vector<PipelineNode>* nodes : scopes)
    {
      std::set<std::string> gone;
      for (const PipelineNode& n : *nodes)
      {
        if (n.IsInstance && n.Type.Value == scope)
        {
          gone.insert(n.Id.Value + ":" + name);
        }
      }
      for (PipelineNode& n : *nodes)
      {
        drop(n.Inputs, [&](const PipelineInput& i) { return gone.count(i.From.Value) != 0; });
      }
      for (PipelineOutput& o : d.Outputs)
      {
        if (nodes == &d.Nodes && gone.count(o.From.Value))
        {
          o.From = PipelineText();
        }
      }
    }
  }
  else
  {
    return false; // no such port, or the only way out
  }
  this->DraftPositions.erase(PositionKey(scope, "port:" + name));
  this->Commit("delete port " + name);
  return true;
}

bool EditDocument::RenameTemplatePort(
  const std::string& scope, const std::string& port, const std::string& name, std::string& error)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  PipelineTemplate* t = this->EditTemplate(d, scope);
  if (name == port)
  {
    return true;
  }
  if (!CanAddPort(t, name, error))
  {
    return false;
  }
  const auto named = [&port](const PipelinePort& p) { return p.Name.Value == port; };
  const auto input = std::find_if(t->Inputs.begin(), t->Inputs.end(), named);
  const auto output = std::find_if(t->Outputs.begin(), t->Outputs.end(), named);
  const bool isInput = input != t->Inputs.end();
  if (!isInput && output == t->Outputs.end())
  {
    error = "there is no port " + Quoted(port);
    return false;
  }
  (isInput ? *input : *output).Name.Value = name;
  if (isInput)
  {
    for (PipelineNode& n : t->Nodes)
    {
      for (PipelineInput& i : n.Inputs)
      {
        i.From.Value = i.From.Value == "@" + port ? "@" + name : i.From.Value;
      }
    }
    for (PipelinePort& o : t->Outputs)
    {
      o.From.Value = o.From.Value == "@" + port ? "@" + name : o.From.Value;
    }
  }
  // At the instances, in the pipeline and in templates.
  const auto inScope =
    [&](std::vector<PipelineNode>& nodes, const std::function<void(const std::function<void(PipelineText&)>&)>& others)
  {
    std::set<std::string> read;
    for (PipelineNode& n : nodes)
    {
      if (n.IsInstance && n.Type.Value == scope)
      {
        read.insert(n.Id.Value + ":" + port);
        for (PipelineInput& i : n.Inputs)
        {
          i.Port.Value = isInput && i.Port.Value == port ? name : i.Port.Value;
        }
      }
    }
    const auto follow = [&](PipelineText& from)
    {
      if (!isInput && read.count(from.Value))
      {
        from.Value = from.Value.substr(0, from.Value.size() - port.size()) + name;
      }
    };
    for (PipelineNode& n : nodes)
    {
      for (PipelineInput& i : n.Inputs)
      {
        follow(i.From);
      }
    }
    others(follow);
  };
  inScope(d.Nodes,
    [&d](const std::function<void(PipelineText&)>& follow)
    {
      for (PipelineOutput& o : d.Outputs)
      {
        follow(o.From);
        for (PipelineLayer& l : o.Layers)
        {
          follow(l.From);
        }
      }
    });
  for (PipelineTemplate& other : d.Templates)
  {
    inScope(other.Nodes,
      [&other](const std::function<void(PipelineText&)>& follow)
      {
        for (PipelinePort& p : other.Outputs)
        {
          follow(p.From);
        }
      });
  }
  const auto at = this->DraftPositions.find(PositionKey(scope, PortPrefix + port));
  if (at != this->DraftPositions.end())
  {
    const auto where = at->second;
    this->DraftPositions.erase(at);
    this->DraftPositions[PositionKey(scope, PortPrefix + name)] = where;
  }
  this->Commit("rename port " + port);
  return true;
}

const std::vector<PipelineNode>& EditDocument::Nodes(const std::string& scope) const
{
  static const std::vector<PipelineNode> none;
  if (scope.empty())
  {
    return this->Now.Document->Nodes;
  }
  const PipelineTemplate* t = this->FindTemplate(scope);
  return t ? t->Nodes : none;
}

const PipelineNode* EditDocument::FindNode(const std::string& scope, const std::string& id) const
{
  for (const PipelineNode& n : this->Nodes(scope))
  {
    if (n.Id.Value == id)
    {
      return &n;
    }
  }
  return nullptr;
}

const PipelineTemplate* EditDocument::FindTemplate(const std::string& name) const
{
  return TemplateWithin(*this->Now.Document, name);
}

bool EditDocument::IsEditable(const std::string& scope) const
{
  if (scope.empty())
  {
    return true;
  }
  const std::vector<PipelineTemplate>& own = this->Now.Document->Templates;
  return std::any_of(own.begin(), own.end(), [&scope](const PipelineTemplate& t) { return t.Name.Value == scope; });
}

std::string EditDocument::FreeName(const std::string& scope, const std::string& hint) const
{
  std::string stem = hint;
  while (stem.size() > 1 && stem.back() >= '0' && stem.back() <= '9')
  {
    stem.pop_back();
  }
  stem = IsPipelineName(stem) ? stem : "node";
  std::set<std::string> taken;
  for (const PipelineNode& n : this->Nodes(scope))
  {
    taken.insert(n.Id.Value);
  }
  if (scope.empty())
  {
    for (const PipelineOutput& o : this->Now.Document->Outputs)
    {
      taken.insert(OutputPrefix + o.Name.Value);
    }
  }
  const bool output = HasPrefix(hint, OutputPrefix);
  stem = output ? After(hint, OutputPrefix) : stem;
  const auto full = [&](const std::string& s) { return output ? OutputPrefix + s : s; };
  if (!taken.count(full(stem)))
  {
    return stem;
  }
  for (int i = 2;; ++i)
  {
    const std::string name = stem + std::to_string(i);
    if (!taken.count(full(name)))
    {
      return name;
    }
  }
}

void EditDocument::SetShownPlaces(const PipelinePositions& places)
{
  for (const auto& p : places)
  {
    this->ShownPlaces[p.first] = { std::floor(p.second.first + 0.5), std::floor(p.second.second + 0.5) };
  }
}

/// In a draft that changes which boxes there are: else the others would be laid out anew.
void EditDocument::KeepPlaces()
{
  const PipelineDocument& d = *this->Now.Document;
  const auto keep = [this](const std::string& scope, const std::string& box)
  {
    const std::string key = PositionKey(scope, box);
    const auto shown = this->ShownPlaces.find(key);
    if (shown != this->ShownPlaces.end())
    {
      this->DraftPositions.emplace(key, shown->second);
    }
  };
  for (const PipelineNode& n : d.Nodes)
  {
    keep("", n.Id.Value);
  }
  for (const PipelineOutput& o : d.Outputs)
  {
    keep("", OutputPrefix + o.Name.Value);
  }
  for (const PipelineTemplate& t : d.Templates)
  {
    keep(t.Name.Value, "@");
    for (const PipelineNode& n : t.Nodes)
    {
      keep(t.Name.Value, n.Id.Value);
    }
    for (const PipelinePort& p : t.Outputs)
    {
      keep(t.Name.Value, PortPrefix + p.Name.Value);
    }
  }
}

void EditDocument::Place(const std::string& scope, const std::string& box, double x, double y)
{
  this->DraftPositions[PositionKey(scope, box)] = { std::floor(x + 0.5), std::floor(y + 0.5) };
}

// ---- nodes ----------------------------------------------------------------------------------------------------------
std::string EditDocument::AddNode(
  const std::string& scope, const std::string& type, double x, double y, const std::string& idHint)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  std::vector<PipelineNode>* nodes = this->EditNodes(d, scope);
  if (!nodes)
  {
    return {};
  }
  // "ATrousFilter" -> "aTrous": the type's words without what every stage is.
  std::string hint = idHint;
  if (hint.empty())
  {
    hint = type;
    for (const char* tail : { "Filter", "Source", "Images", "Transform", "Estimate" })
    {
      const std::size_t n = std::strlen(tail);
      if (hint.size() > n && hint.compare(hint.size() - n, n, tail) == 0)
      {
        hint.erase(hint.size() - n);
      }
    }
    hint[0] = char(std::tolower(static_cast<unsigned char>(hint[0])));
    hint = type == "PathTraceSource" ? "pt" : hint;
  }
  PipelineNode n;
  n.Id = TextAt(d, this->FreeName(scope, hint));
  n.Type = TextAt(d, type);
  n.Place.File = d.File;
  nodes->push_back(n);
  this->Place(scope, n.Id.Value, x, y);
  this->Commit("add " + n.Id.Value);
  return n.Id.Value;
}

std::string EditDocument::AddInstance(const std::string& scope, const std::string& templateName, double x, double y)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  std::vector<PipelineNode>* nodes = this->EditNodes(d, scope);
  if (!nodes)
  {
    return {};
  }
  PipelineNode n;
  n.IsInstance = true;
  n.Id = TextAt(d, this->FreeName(scope, templateName));
  n.Type = TextAt(d, templateName);
  n.Place.File = d.File;
  nodes->push_back(n);
  this->Place(scope, n.Id.Value, x, y);
  this->Commit("add " + n.Id.Value);
  return n.Id.Value;
}

bool EditDocument::Remove(
  const std::string& scope, const std::vector<std::string>& boxes, bool reconnect, std::string* unread)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  std::vector<PipelineNode>* nodes = this->EditNodes(d, scope);
  if (!nodes)
  {
    return false;
  }
  const auto goes = [&boxes](const std::string& from)
  { return std::any_of(boxes.begin(), boxes.end(), [&](const std::string& b) { return RefersTo(from, b); }); };
  // Reader -> what it reads instead, and what it could not take.
  std::vector<std::pair<std::string, std::pair<std::string, std::vector<std::string>>>> losses;
  bool any = false;
  for (const std::string& box : boxes)
  {
    this->DraftPositions.erase(PositionKey(scope, box));
    if (HasPrefix(box, OutputPrefix))
    {
      const auto named = [&](const PipelineOutput& o) { return o.Name.Value == After(box, OutputPrefix); };
      const auto at = std::find_if(d.Outputs.begin(), d.Outputs.end(), named);
      if (at != d.Outputs.end() && scope.empty())
      {
        d.Outputs.erase(at);
        any = true;
      }
      continue;
    }
    const auto named = [&](const PipelineNode& n) { return n.Id.Value == box; };
    const auto at = std::find_if(nodes->begin(), nodes->end(), named);
    if (at == nodes->end())
    {
      continue;
    }
    // What its first port reads takes its place, where that is wanted and there is such a thing: all of it where the
    // reader takes several. Other ports of the same kind carry pictures, too; nobody reads those any more.
    std::vector<std::string> instead, beside;
    if (reconnect && !at->Inputs.empty() && !at->Inputs.front().Delay.Given)
    {
      const std::string& first = at->Inputs.front().Port.Value;
      const StageDescription* type =
        this->Registry && !at->IsInstance ? this->Registry->Describe(at->Type.Value) : nullptr;
      const auto kindOf = [type](const std::string& port)
      {
        const int index = type ? type->InputIndex(port) : -1;
        return index < 0 ? ArrayKind::Any : type->Inputs[std::size_t(index)].Kind;
      };
      for (const PipelineInput& i : at->Inputs)
      {
        if (i.Delay.Given || RefersTo(i.From.Value, box))
        {
          continue;
        }
        if (i.Port.Value == first)
        {
          instead.push_back(i.From.Value);
        }
        else if (kindOf(first) != ArrayKind::Any && kindOf(i.Port.Value) == kindOf(first))
        {
          beside.push_back(i.From.Value);
        }
      }
    }
    nodes->erase(at);
    any = true;
    const auto lose = [&](const std::string& reader, std::size_t taken)
    {
      std::vector<std::string> lost;
      for (const std::vector<std::string>* list : { &instead, &beside })
      {
        for (std::size_t i = list == &instead ? taken : 0; i < list->size(); ++i)
        {
          if (!goes((*list)[i]))
          {
            lost.push_back((*list)[i]);
          }
        }
      }
      if (!lost.empty())
      {
        losses.push_back({ reader, { instead.front(), lost } });
      }
    };
    const auto follow = [&](const std::string& reader, std::string& from)
    {
      if (!RefersTo(from, box))
      {
        return true;
      }
      if (instead.empty())
      {
        return false;
      }
      from = instead.front();
      lose(reader, 1);
      return true;
    };
    for (PipelineNode& n : *nodes)
    {
      const StageDescription* type = this->Registry && !n.IsInstance ? this->Registry->Describe(n.Type.Value) : nullptr;
      std::vector<PipelineInput> inputs;
      for (PipelineInput& i : n.Inputs)
      {
        const int port = type ? type->InputIndex(i.Port.Value) : -1;
        if (RefersTo(i.From.Value, box) && port >= 0 && type->Inputs[std::size_t(port)].Repeatable)
        {
          for (const std::string& from : instead)
          {
            inputs.push_back(i);
            inputs.back().From.Value = from;
          }
          if (!instead.empty())
          {
            lose(n.Id.Value, instead.size());
          }
        }
        else if (follow(n.Id.Value, i.From.Value))
        {
          inputs.push_back(i);
        }
      }
      n.Inputs = inputs;
    }
    if (scope.empty())
    {
      for (PipelineOutput& o : d.Outputs)
      {
        if (!follow(o.Name.Value, o.From.Value))
        {
          o.From = PipelineText();
        }
        o.Layers.erase(std::remove_if(o.Layers.begin(), o.Layers.end(),
                         [&](PipelineLayer& l) { return !follow(o.Name.Value, l.From.Value); }),
          o.Layers.end());
      }
    }
    else
    {
      for (PipelineTemplate& t : d.Templates)
      {
        for (PipelinePort& p : t.Outputs)
        {
          if (t.Name.Value == scope && !follow(p.Name.Value, p.From.Value))
          {
            p.From.Value.clear();
          }
        }
      }
    }
  }
  if (unread)
  {
    // "beauty, preview: modulate:radiance goes on, pt:emission is no longer read"
    unread->clear();
    for (std::size_t i = 0; i < losses.size(); ++i)
    {
      std::string readers = losses[i].first;
      while (i + 1 < losses.size() && losses[i + 1].second == losses[i].second)
      {
        readers += losses[++i].first == readers ? "" : ", " + losses[i].first;
      }
      std::string lost;
      for (const std::string& from : losses[i].second.second)
      {
        lost += (lost.empty() ? "" : ", ") + from;
      }
      *unread += (unread->empty() ? "" : "; ") + readers + ": " + losses[i].second.first + " goes on, " + lost +
                 (losses[i].second.second.size() == 1 ? " is" : " are") + " no longer read";
    }
  }
  if (any)
  {
    this->Commit(boxes.size() == 1 ? "delete " + boxes.front() : "delete " + std::to_string(boxes.size()) + " nodes");
  }
  return any;
}

std::vector<std::string> EditDocument::Duplicate(
  const std::string& scope, const std::vector<std::string>& boxes, double dx, double dy)
{
  if (scope.empty() &&
      std::any_of(boxes.begin(), boxes.end(), [](const std::string& b) { return HasPrefix(b, OutputPrefix); }))
  {
    // Outputs need names and files of their own; a paste of a copy gives them.
    const std::string xml = this->CopyXml(scope, boxes);
    double left = 0, top = 0;
    bool placed = false;
    for (const auto& p : ReadPipelinePositions(xml))
    {
      left = placed ? std::min(left, p.second.first) : p.second.first;
      top = placed ? std::min(top, p.second.second) : p.second.second;
      placed = true;
    }
    std::string error;
    const std::vector<std::string> copies =
      xml.empty() ? std::vector<std::string>() : this->PasteXml(scope, xml, left + dx, top + dy, error);
    if (!copies.empty())
    {
      this->Undone.back().Label =
        copies.size() == 1 ? "duplicate " + boxes.front() : "duplicate " + std::to_string(copies.size()) + " nodes";
    }
    return copies;
  }
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  std::vector<PipelineNode>* nodes = this->EditNodes(d, scope);
  std::vector<std::string> made;
  if (!nodes)
  {
    return made;
  }
  std::vector<std::pair<std::string, std::string>> names;
  std::set<std::string> taken;
  std::vector<PipelineNode> copies;
  for (const std::string& box : boxes)
  {
    const PipelineNode* n = this->FindNode(scope, box);
    if (!n)
    {
      continue;
    }
    std::string name = this->FreeName(scope, box);
    while (taken.count(name))
    {
      name = this->FreeName(scope, name);
      if (taken.count(name))
      {
        // FreeName knows the document only; count on from what was given away.
        std::string stem = name;
        while (stem.size() > 1 && stem.back() >= '0' && stem.back() <= '9')
        {
          stem.pop_back();
        }
        int i = 2;
        while (taken.count(stem + std::to_string(i)) || this->FindNode(scope, stem + std::to_string(i)))
        {
          ++i;
        }
        name = stem + std::to_string(i);
      }
    }
    taken.insert(name);
    names.emplace_back(box, name);
    PipelineNode copy = *n;
    copy.Id = TextAt(d, name);
    copies.push_back(copy);
    const auto at = this->DraftPositions.find(PositionKey(scope, box));
    if (at != this->DraftPositions.end())
    {
      const auto place = at->second;
      this->Place(scope, name, place.first + dx, place.second + dy);
    }
    made.push_back(name);
  }
  for (PipelineNode& copy : copies)
  {
    for (PipelineInput& i : copy.Inputs)
    {
      for (const auto& name : names)
      {
        if (RefersTo(i.From.Value, name.first))
        {
          i.From.Value = Renamed(i.From.Value, name.first, name.second);
          break;
        }
      }
    }
    nodes->push_back(copy);
  }
  if (!made.empty())
  {
    this->Commit(
      made.size() == 1 ? "duplicate " + boxes.front() : "duplicate " + std::to_string(made.size()) + " nodes");
  }
  return made;
}

bool EditDocument::Rename(const std::string& scope, const std::string& box, const std::string& name, std::string& error)
{
  if (!IsPipelineName(name))
  {
    error = "a name starts with a letter or _ and goes on with letters, digits, _ and -";
    return false;
  }
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  if (HasPrefix(box, OutputPrefix))
  {
    const std::string old = After(box, OutputPrefix);
    for (const PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == name && name != old)
      {
        error = "there is an output " + Quoted(name) + " already";
        return false;
      }
    }
    for (PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == old)
      {
        o.Name = TextAt(d, name);
      }
    }
  }
  else
  {
    PipelineNode* node = this->EditNode(d, scope, box);
    if (!node)
    {
      error = "there is no node " + Quoted(box);
      return false;
    }
    if (name != box && this->FindNode(scope, name))
    {
      error = "there is a node " + Quoted(name) + " already";
      return false;
    }
    node->Id.Value = name;
    for (PipelineNode& n : *this->EditNodes(d, scope))
    {
      for (PipelineInput& i : n.Inputs)
      {
        i.From.Value = Renamed(i.From.Value, box, name);
      }
    }
    if (scope.empty())
    {
      for (PipelineOutput& o : d.Outputs)
      {
        o.From.Value = Renamed(o.From.Value, box, name);
        for (PipelineLayer& l : o.Layers)
        {
          l.From.Value = Renamed(l.From.Value, box, name);
        }
      }
    }
    for (PipelineTemplate& t : d.Templates)
    {
      if (t.Name.Value == scope)
      {
        for (PipelinePort& p : t.Outputs)
        {
          p.From.Value = Renamed(p.From.Value, box, name);
        }
      }
    }
  }
  const auto at = this->DraftPositions.find(PositionKey(scope, box));
  if (at != this->DraftPositions.end())
  {
    const auto where = at->second;
    this->DraftPositions.erase(at);
    this->DraftPositions[PositionKey(scope, HasPrefix(box, OutputPrefix) ? OutputPrefix + name : name)] = where;
  }
  this->Commit("rename " + box);
  return true;
}

void EditDocument::Move(
  const std::string& scope, const std::vector<std::pair<std::string, std::pair<double, double>>>& to)
{
  this->Begin();
  std::string key = "move";
  for (const auto& t : to)
  {
    this->Place(scope, t.first, t.second.first, t.second.second);
    key += " " + t.first;
  }
  this->Commit(to.size() == 1 ? "move " + to.front().first : "move " + std::to_string(to.size()) + " nodes", key);
}

void EditDocument::Arrange(
  const std::string& scope, const std::vector<std::pair<std::string, std::pair<double, double>>>& to)
{
  this->Begin();
  for (const auto& t : to)
  {
    this->Place(scope, t.first, t.second.first, t.second.second);
  }
  this->Commit("arrange");
}

std::string EditDocument::CopyXml(
  const std::string& scope, const std::vector<std::string>& boxes, std::size_t* count) const
{
  PipelineDocument copy;
  copy.Version = "1";
  PipelinePositions positions;
  const auto chosen = [&](const std::string& box)
  {
    if (std::find(boxes.begin(), boxes.end(), box) == boxes.end())
    {
      return false;
    }
    const std::string key = PositionKey(scope, box);
    const auto at = this->Now.Positions.find(key), shown = this->ShownPlaces.find(key);
    if (at != this->Now.Positions.end())
    {
      positions[box] = at->second;
    }
    else if (shown != this->ShownPlaces.end())
    {
      positions[box] = shown->second;
    }
    return true;
  };
  for (const PipelineNode& n : this->Nodes(scope))
  {
    if (chosen(n.Id.Value))
    {
      copy.Nodes.push_back(n);
    }
  }
  for (const PipelineOutput& o : this->Now.Document->Outputs)
  {
    if (scope.empty() && chosen(OutputPrefix + o.Name.Value))
    {
      copy.Outputs.push_back(o);
    }
  }
  // With the variables that they read.
  const auto reads = [&copy](const PipelineVariable& v)
  {
    const std::string name = "$(" + v.Name.Value + ")";
    const auto has = [&name](const PipelineText& text) { return text.Value.find(name) != std::string::npos; };
    return std::any_of(copy.Nodes.begin(), copy.Nodes.end(),
             [&](const PipelineNode& n)
             {
               return std::any_of(
                 n.Properties.begin(), n.Properties.end(), [&](const PipelineProperty& p) { return has(p.Value); });
             }) ||
           std::any_of(copy.Outputs.begin(), copy.Outputs.end(), [&](const PipelineOutput& o) { return has(o.File); });
  };
  for (const PipelineVariable& v : this->Now.Document->Variables)
  {
    if (reads(v))
    {
      copy.Variables.push_back(v);
    }
  }
  const std::size_t all = copy.Nodes.size() + copy.Outputs.size();
  if (count)
  {
    *count = all;
  }
  return all == 0 ? std::string() : WithPipelinePositions(WritePipelineText(copy), positions);
}

std::vector<std::string> EditDocument::PasteXml(
  const std::string& scope, const std::string& text, double x, double y, std::string& error)
{
  std::vector<std::string> made;
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  std::vector<PipelineNode>* nodes = this->EditNodes(d, scope);
  if (!nodes)
  {
    error = "this template belongs to another file";
    return made;
  }
  Diagnostics messages;
  std::string whole = text;
  // A bare <node> is a paste, too.
  const std::size_t first = whole.find_first_not_of(" \t\r\n");
  if (first != std::string::npos &&
      (whole.compare(first, 5, "<node") == 0 || whole.compare(first, 9, "<instance") == 0 ||
        whole.compare(first, 7, "<output") == 0))
  {
    whole = "<pipeline version=\"1\">" + whole + "</pipeline>";
  }
  const auto pasted = ReadPipelineText(whole, d.File, messages);
  if (messages.HasErrors())
  {
    error = "the clipboard holds no nodes: " + messages.All().front().What;
    return made;
  }
  const bool outputs = scope.empty() && !pasted->Outputs.empty();
  if (pasted->Nodes.empty() && !outputs)
  {
    error = pasted->Outputs.empty() ? "the clipboard holds no nodes"
                                    : "the clipboard holds outputs to files, which a template cannot have";
    return made;
  }
  for (const PipelineVariable& v : pasted->Variables)
  {
    if (std::none_of(d.Variables.begin(), d.Variables.end(),
          [&v](const PipelineVariable& known) { return known.Name.Value == v.Name.Value; }))
    {
      d.Variables.push_back(v);
    }
  }
  const PipelinePositions positions = ReadPipelinePositions(whole);
  double left = 0, top = 0;
  bool placed = false;
  for (const auto& p : positions)
  {
    left = placed ? std::min(left, p.second.first) : p.second.first;
    top = placed ? std::min(top, p.second.second) : p.second.second;
    placed = true;
  }
  std::vector<std::pair<std::string, std::string>> names;
  std::set<std::string> taken;
  for (const PipelineNode& n : *nodes)
  {
    taken.insert(n.Id.Value);
  }
  for (const PipelineNode& n : pasted->Nodes)
  {
    std::string stem = n.Id.Value;
    while (stem.size() > 1 && stem.back() >= '0' && stem.back() <= '9')
    {
      stem.pop_back();
    }
    std::string name = n.Id.Value;
    for (int i = 2; taken.count(name); ++i)
    {
      name = stem + std::to_string(i);
    }
    taken.insert(name);
    names.emplace_back(n.Id.Value, name);
  }
  int count = 0;
  for (std::size_t k = 0; k < pasted->Nodes.size(); ++k)
  {
    PipelineNode n = pasted->Nodes[k];
    n.Id.Value = names[k].second;
    for (PipelineInput& i : n.Inputs)
    {
      for (const auto& name : names)
      {
        if (RefersTo(i.From.Value, name.first))
        {
          i.From.Value = Renamed(i.From.Value, name.first, name.second);
          break;
        }
      }
    }
    const auto at = positions.find(names[k].first);
    if (at != positions.end())
    {
      this->Place(scope, n.Id.Value, x + at->second.first - left, y + at->second.second - top);
    }
    else
    {
      this->Place(scope, n.Id.Value, x + 30 * count, y + 30 * count);
      ++count;
    }
    nodes->push_back(n);
    made.push_back(n.Id.Value);
  }
  for (std::size_t k = 0; outputs && k < pasted->Outputs.size(); ++k)
  {
    PipelineOutput o = pasted->Outputs[k];
    const std::string old = o.Name.Value, file = o.File.Value;
    const auto stands = [&d](const PipelineOutput& wanted)
    {
      return std::any_of(d.Outputs.begin(), d.Outputs.end(),
        [&](const PipelineOutput& other)
        {
          return other.Name.Value == wanted.Name.Value ||
                 (!wanted.File.Value.empty() && other.File.Value == wanted.File.Value);
        });
    };
    // Two outputs of one name, or into one file, cannot be. The number stands before the frame's and the extension.
    std::size_t stem = std::min(file.size(), file.find_last_of('.'));
    while (stem > 0 && (file[stem - 1] == '#' || (stem < file.size() && file[stem] == '#' && file[stem - 1] == '.')))
    {
      --stem;
    }
    for (int i = 2; stands(o); ++i)
    {
      o.Name.Value = old + std::to_string(i);
      o.File.Value = file.empty() ? file : file.substr(0, stem) + "-" + std::to_string(i) + file.substr(stem);
    }
    const auto follow = [&](PipelineText& from)
    {
      for (const auto& name : names)
      {
        if (RefersTo(from.Value, name.first))
        {
          from.Value = Renamed(from.Value, name.first, name.second);
          return;
        }
      }
      const std::string id = TopOf(NodeOfReference(from.Value));
      if (std::none_of(nodes->begin(), nodes->end(), [&id](const PipelineNode& n) { return n.Id.Value == id; }))
      {
        from = PipelineText(); // to be connected
      }
    };
    follow(o.From);
    for (PipelineLayer& l : o.Layers)
    {
      follow(l.From);
    }
    const std::string box = OutputPrefix + o.Name.Value;
    const auto at = positions.find(OutputPrefix + old);
    if (at != positions.end())
    {
      this->Place("", box, x + at->second.first - left, y + at->second.second - top);
    }
    else
    {
      this->Place("", box, x + 30 * count, y + 30 * count);
      ++count;
    }
    d.Outputs.push_back(o);
    made.push_back(box);
  }
  this->Commit(made.size() == 1 ? "paste " + made.front() : "paste " + std::to_string(made.size()) + " nodes");
  return made;
}

// ---- links ----------------------------------------------------------------------------------------------------------
bool EditDocument::Connect(const std::string& scope, const std::string& from, const std::string& box,
  const std::string& port, bool delayed, bool repeatable, std::string& error)
{
  PipelineDocument& d = this->Begin();
  if (HasPrefix(box, OutputPrefix))
  {
    for (PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == After(box, OutputPrefix))
      {
        if (port == "layer")
        {
          PipelineLayer l;
          l.From = TextAt(d, from);
          o.Layers.push_back(l);
        }
        else
        {
          o.From = TextAt(d, from);
        }
        this->Commit("connect " + box);
        return true;
      }
    }
    error = "there is no output " + Quoted(box);
    return false;
  }
  if (HasPrefix(box, PortPrefix))
  {
    for (PipelineTemplate& t : d.Templates)
    {
      for (PipelinePort& p : t.Outputs)
      {
        if (t.Name.Value == scope && p.Name.Value == After(box, PortPrefix))
        {
          p.From = TextAt(d, from);
          this->Commit("connect " + box);
          return true;
        }
      }
    }
    error = "there is no port " + Quoted(box);
    return false;
  }
  PipelineNode* node = this->EditNode(d, scope, box);
  if (!node)
  {
    error = "there is no node " + Quoted(box);
    return false;
  }
  PipelineInput input;
  input.Port = TextAt(d, port);
  input.From = TextAt(d, from);
  input.Place.File = d.File;
  if (delayed)
  {
    input.Delay = TextAt(d, "1");
  }
  const auto same = [&port](const PipelineInput& i) { return i.Port.Value == port; };
  const auto at = std::find_if(node->Inputs.begin(), node->Inputs.end(), same);
  if (at != node->Inputs.end() && !repeatable)
  {
    at->From = input.From;
    at->Delay = input.Delay;
  }
  else
  {
    node->Inputs.push_back(input);
  }
  this->Commit("connect " + box);
  return true;
}

bool EditDocument::Disconnect(const std::string& scope, const std::string& box, int index)
{
  PipelineDocument& d = this->Begin();
  if (HasPrefix(box, OutputPrefix))
  {
    for (PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == After(box, OutputPrefix))
      {
        if (index > 0 && index <= int(o.Layers.size()))
        {
          o.Layers.erase(o.Layers.begin() + index - 1);
        }
        else
        {
          o.From = PipelineText();
        }
        this->Commit("disconnect " + box);
        return true;
      }
    }
    return false;
  }
  PipelineNode* node = this->EditNode(d, scope, box);
  if (!node || index < 0 || index >= int(node->Inputs.size()))
  {
    return false;
  }
  node->Inputs.erase(node->Inputs.begin() + index);
  this->Commit("disconnect " + box);
  return true;
}

bool EditDocument::Reconnect(const std::string& scope, const std::string& box, int index, const std::string& from)
{
  PipelineDocument& d = this->Begin();
  PipelineNode* node = this->EditNode(d, scope, box);
  if (!node || index < 0 || index >= int(node->Inputs.size()))
  {
    return false;
  }
  node->Inputs[std::size_t(index)].From = TextAt(d, from);
  this->Commit("connect " + box);
  return true;
}

bool EditDocument::SetDelay(const std::string& scope, const std::string& box, int index, bool delayed)
{
  PipelineDocument& d = this->Begin();
  PipelineNode* node = this->EditNode(d, scope, box);
  if (!node || index < 0 || index >= int(node->Inputs.size()))
  {
    return false;
  }
  node->Inputs[std::size_t(index)].Delay = delayed ? TextAt(d, "1") : PipelineText();
  this->Commit(delayed ? "read the previous frame" : "read this frame");
  return true;
}

std::string EditDocument::InsertOnLink(const std::string& scope, const std::string& box, int index,
  const StageDescription& type, int inPort, const std::string& outArray, double x, double y)
{
  const std::size_t steps = this->Undone.size();
  const std::string id = this->AddNode(scope, type.Type, x, y);
  if (id.empty())
  {
    return id;
  }
  if (!this->PutOnLink(scope, box, index, id, type, inPort, outArray))
  {
    this->Undo();
    this->Redone.clear();
    return {};
  }
  // Two commits, one step.
  if (this->Undone.size() == steps + 2)
  {
    this->Undone.pop_back();
    this->Undone.back().Label = "insert " + id;
  }
  return id;
}

bool EditDocument::PutOnLink(const std::string& scope, const std::string& box, int index, const std::string& node,
  const StageDescription& type, int inPort, const std::string& outArray)
{
  if (inPort < 0 || inPort >= int(type.Inputs.size()))
  {
    return false;
  }
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  PipelineNode* middle = this->EditNode(d, scope, node);
  PipelineText* from = nullptr;
  if (HasPrefix(box, OutputPrefix))
  {
    for (PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == After(box, OutputPrefix))
      {
        from = index > 0 && index <= int(o.Layers.size()) ? &o.Layers[std::size_t(index - 1)].From : &o.From;
      }
    }
  }
  else if (PipelineNode* reader = this->EditNode(d, scope, box))
  {
    if (index >= 0 && index < int(reader->Inputs.size()))
    {
      from = &reader->Inputs[std::size_t(index)].From;
    }
  }
  if (!middle || !from || RefersTo(from->Value, node) || box == node)
  {
    return false;
  }
  const std::string port = type.Inputs[std::size_t(inPort)].Name;
  PipelineInput input;
  input.Port = TextAt(d, port);
  input.From = TextAt(d, from->Value);
  middle->Inputs.erase(std::remove_if(middle->Inputs.begin(), middle->Inputs.end(),
                         [&port](const PipelineInput& i) { return i.Port.Value == port; }),
    middle->Inputs.end());
  middle->Inputs.insert(middle->Inputs.begin(), input);
  *from = TextAt(d, node + (outArray.empty() ? "" : ":" + outArray));
  this->Commit("insert " + node);
  return true;
}

// ---- values ---------------------------------------------------------------------------------------------------------
void EditDocument::SetProperty(
  const std::string& scope, const std::string& box, const std::string& name, const std::string& value, bool merge)
{
  PipelineDocument& d = this->Begin();
  std::vector<PipelineProperty>* properties = nullptr;
  if (HasPrefix(box, OutputPrefix))
  {
    for (PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == After(box, OutputPrefix))
      {
        properties = &o.Properties;
      }
    }
  }
  else if (PipelineNode* node = this->EditNode(d, scope, box))
  {
    properties = &node->Properties;
  }
  if (!properties)
  {
    return;
  }
  const auto named = [&name](const PipelineProperty& p) { return p.Name.Value == name; };
  const auto at = std::find_if(properties->begin(), properties->end(), named);
  if (at != properties->end())
  {
    at->Value = TextAt(d, value);
  }
  else
  {
    PipelineProperty p;
    p.Name = TextAt(d, name);
    p.Value = TextAt(d, value);
    p.Place.File = d.File;
    properties->push_back(p);
  }
  this->Commit(box + "." + name, merge ? "set " + scope + "/" + box + "." + name : std::string());
}

void EditDocument::ResetProperty(const std::string& scope, const std::string& box, const std::string& name)
{
  PipelineDocument& d = this->Begin();
  PipelineNode* node = this->EditNode(d, scope, box);
  if (!node)
  {
    return;
  }
  node->Properties.erase(std::remove_if(node->Properties.begin(), node->Properties.end(),
                           [&name](const PipelineProperty& p) { return p.Name.Value == name; }),
    node->Properties.end());
  this->Commit("reset " + box + "." + name);
}

const PipelineText* EditDocument::FindProperty(
  const std::string& scope, const std::string& box, const std::string& name) const
{
  const std::vector<PipelineProperty>* properties = nullptr;
  if (HasPrefix(box, OutputPrefix))
  {
    for (const PipelineOutput& o : this->Now.Document->Outputs)
    {
      if (o.Name.Value == After(box, OutputPrefix))
      {
        properties = &o.Properties;
      }
    }
  }
  else if (const PipelineNode* n = this->FindNode(scope, box))
  {
    properties = &n->Properties;
  }
  if (properties)
  {
    for (const PipelineProperty& p : *properties)
    {
      if (p.Name.Value == name)
      {
        return &p.Value;
      }
    }
  }
  return nullptr;
}

void EditDocument::SetDoc(const std::string& scope, const std::string& box, const std::string& doc)
{
  PipelineDocument& d = this->Begin();
  const PipelineText text = doc.empty() ? PipelineText() : TextAt(d, doc);
  if (HasPrefix(box, OutputPrefix))
  {
    for (PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == After(box, OutputPrefix))
      {
        o.Doc = text;
      }
    }
  }
  else if (PipelineNode* n = this->EditNode(d, scope, box))
  {
    n->Doc = text;
  }
  this->Commit("note of " + box, "doc " + scope + "/" + box);
}

void EditDocument::SetPipelineDoc(const std::string& doc)
{
  PipelineDocument& d = this->Begin();
  d.Doc = doc.empty() ? PipelineText() : TextAt(d, doc);
  this->Commit("description", "pipeline doc");
}

bool EditDocument::SetVariable(const std::string& name, const std::string& value, bool merge)
{
  PipelineDocument& d = this->Begin();
  for (PipelineVariable& v : d.Variables)
  {
    if (v.Name.Value == name)
    {
      v.Default = TextAt(d, value);
      this->Commit("variable " + name, merge ? "variable " + name : std::string());
      return true;
    }
  }
  return false;
}

bool EditDocument::AddVariable(
  const std::string& name, const std::string& type, const std::string& value, std::string& error)
{
  if (!IsPipelineName(name))
  {
    error = "a name starts with a letter or _ and goes on with letters, digits, _ and -";
    return false;
  }
  PipelineDocument& d = this->Begin();
  for (const PipelineVariable& v : d.Variables)
  {
    if (v.Name.Value == name)
    {
      error = "there is a variable " + Quoted(name) + " already";
      return false;
    }
  }
  PipelineVariable v;
  v.Name = TextAt(d, name);
  v.Type = TextAt(d, type);
  v.Default = TextAt(d, value);
  v.Place.File = d.File;
  d.Variables.push_back(v);
  this->Commit("add variable " + name);
  return true;
}

std::string EditDocument::MakeVariable(
  const std::string& scope, const std::string& box, const Property& row, const std::string& value)
{
  PipelineDocument& d = this->Begin();
  PipelineNode* node = this->EditNode(d, scope, box);
  PipelineTemplate* own = scope.empty() ? nullptr : this->EditTemplate(d, scope);
  if (!node || (!scope.empty() && !own))
  {
    return {};
  }
  std::vector<PipelineVariable>& variables = own ? own->Parameters : d.Variables;
  std::string stem = row.Name;
  stem[0] = char(std::tolower(static_cast<unsigned char>(stem[0])));
  const auto taken = [&](const std::string& name)
  {
    const auto named = [&name](const PipelineVariable& v) { return v.Name.Value == name; };
    return std::any_of(variables.begin(), variables.end(), named) ||
           std::any_of(d.Variables.begin(), d.Variables.end(), named);
  };
  std::string name = stem;
  for (int i = 2; taken(name); ++i)
  {
    name = stem + std::to_string(i);
  }
  PipelineVariable v;
  v.Name = TextAt(d, name);
  v.Type = TextAt(d, row.Kind == Property::Type::Int      ? "int"
                     : row.Kind == Property::Type::Double ? "double"
                     : row.Kind == Property::Type::Bool   ? "bool"
                     : row.Kind == Property::Type::Path   ? "path"
                                                          : "string");
  v.Default = TextAt(d, value);
  if (!row.Doc.empty())
  {
    v.Doc = TextAt(d, row.Doc);
  }
  v.Place.File = d.File;
  variables.push_back(v);
  const auto named = [&row](const PipelineProperty& p) { return p.Name.Value == row.Name; };
  auto at = std::find_if(node->Properties.begin(), node->Properties.end(), named);
  if (at == node->Properties.end())
  {
    PipelineProperty p;
    p.Name = TextAt(d, row.Name);
    p.Place.File = d.File;
    node->Properties.push_back(p);
    at = node->Properties.end() - 1;
  }
  at->Value = TextAt(d, "$(" + name + ")");
  this->Commit("make " + box + "." + row.Name + " a variable");
  return name;
}

bool EditDocument::AddInclude(const std::string& file, std::string& error)
{
  std::error_code ec;
  const std::string full = JoinPath(this->Now.Document->Directory, file);
  for (const PipelineInclude& i : this->Now.Document->Includes)
  {
    if (fs::equivalent(JoinPath(this->Now.Document->Directory, i.File.Value), full, ec))
    {
      return true;
    }
  }
  Diagnostics messages;
  const auto content = ReadPipelineFile(full, messages);
  if (messages.HasErrors())
  {
    error = messages.All().front().ToText();
    return false;
  }
  PipelineDocument& d = this->Begin();
  PipelineInclude i;
  i.File = TextAt(d, file);
  i.Content = content;
  i.Place.File = d.File;
  d.Includes.push_back(i);
  this->Commit("include " + fs::path(file).filename().string());
  return true;
}

bool EditDocument::RemoveVariable(const std::string& name)
{
  PipelineDocument& d = this->Begin();
  const auto at = std::find_if(
    d.Variables.begin(), d.Variables.end(), [&name](const PipelineVariable& v) { return v.Name.Value == name; });
  if (at == d.Variables.end())
  {
    return false;
  }
  d.Variables.erase(at);
  this->Commit("delete variable " + name);
  return true;
}

void EditDocument::SetTime(const std::string& first, const std::string& count, const std::string& rate)
{
  PipelineDocument& d = this->Begin();
  d.Time.Given = true;
  const auto set = [&d](PipelineText& text, const std::string& value)
  {
    if (text.Value != value)
    {
      text = value.empty() ? PipelineText() : TextAt(d, value);
    }
  };
  set(d.Time.First, first);
  set(d.Time.Count, count);
  set(d.Time.Rate, rate);
  this->Commit("timeline", "time");
}

std::string EditDocument::AddOutput(const std::string& from, double x, double y)
{
  PipelineDocument& d = this->Begin();
  this->KeepPlaces();
  const std::string name = this->FreeName("", std::string(OutputPrefix) + "beauty");
  PipelineOutput o;
  o.Name = TextAt(d, name);
  o.From = from.empty() ? PipelineText() : TextAt(d, from);
  o.File = TextAt(d, "out/" + name + ".####.exr");
  o.Place.File = d.File;
  d.Outputs.push_back(o);
  this->Place("", OutputPrefix + name, x, y);
  this->Commit("add output " + name);
  return OutputPrefix + name;
}

bool EditDocument::SetOutput(
  const std::string& name, const std::string& attribute, const std::string& value, bool merge)
{
  PipelineDocument& d = this->Begin();
  for (PipelineOutput& o : d.Outputs)
  {
    if (o.Name.Value == name)
    {
      const PipelineText text = value.empty() ? PipelineText() : TextAt(d, value);
      (attribute == "file"       ? o.File
        : attribute == "view"    ? o.View
        : attribute == "display" ? o.Display
                                 : o.From) = text;
      this->Commit("output " + name, merge ? "output " + name + " " + attribute : std::string());
      return true;
    }
  }
  return false;
}
}
