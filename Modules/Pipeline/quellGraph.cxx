// SPDX-License-Identifier: BSD-3-Clause
#include "quellGraph.h"

#include "quellPipelineReader.h"

#include <algorithm>
#include <climits>
#include <deque>
#include <filesystem>
#include <functional>
#include <set>
#include <system_error>

namespace fs = std::filesystem;

namespace quell
{
int Graph::Find(const std::string& path) const
{
  for (std::size_t i = 0; i < this->Nodes.size(); ++i)
  {
    if (this->Nodes[i].Path == path)
    {
      return int(i);
    }
  }
  return -1;
}

const GraphOutput* Graph::FindOutput(const std::string& name) const
{
  for (const GraphOutput& o : this->Outputs)
  {
    if (o.Name == name)
    {
      return &o;
    }
  }
  return nullptr;
}

std::vector<OutputArray> Graph::Arrays(int node) const
{
  std::vector<OutputArray> arrays;
  std::set<std::string> seen;
  std::set<int> visited;
  for (int at = node; at >= 0 && visited.insert(at).second;)
  {
    const GraphNode& n = this->Nodes[std::size_t(at)];
    std::vector<OutputArray> own = n.Description().Outputs;
    try
    {
      const std::vector<OutputArray> dynamic = n.Stage->ListDynamicOutputs();
      own.insert(own.end(), dynamic.begin(), dynamic.end());
    }
    catch (const std::exception&)
    {
      // The stage says so itself when it runs.
    }
    for (const OutputArray& a : own)
    {
      if (seen.insert(a.Name).second)
      {
        arrays.push_back(a);
      }
    }
    int next = -1;
    for (const GraphEdge& e : n.Inputs)
    {
      if (e.Port == 0 && e.Connection == 0 && !e.Delayed)
      {
        next = e.Producer;
      }
    }
    at = next;
  }
  return arrays;
}

std::vector<bool> Graph::Needed(const std::vector<int>& targets) const
{
  std::vector<bool> needed(this->Nodes.size(), false);
  std::vector<int> open = targets;
  while (!open.empty())
  {
    const int n = open.back();
    open.pop_back();
    if (n < 0 || needed[std::size_t(n)])
    {
      continue;
    }
    needed[std::size_t(n)] = true;
    for (const GraphEdge& e : this->Nodes[std::size_t(n)].Inputs)
    {
      open.push_back(e.Producer);
    }
  }
  return needed;
}

namespace
{
const std::size_t MaximumText = 65536; // of one expanded value: variables can double and double again
const int MaximumDepth = 16;           // of nested instances
const int MaximumPassages = 256;       // of template ports that a connection leads through
const std::size_t MaximumNodes = 5000;
// Templates multiply what a file says. Every step of the expansion is charged about what it costs in time and memory;
// at a nanosecond and a byte each this is far more than a pipeline of MaximumNodes needs.
const std::size_t MaximumWork = 100000000;
const std::size_t StepWork = 256, ConnectionWork = 1024, ArrayWork = 512;
const std::size_t MaximumHintWork = 50000000; // of comparing misspelt names with all that there are

/// An expanded value and the directory that relative paths in it are seen from.
struct Value
{
  std::string Text, Base;
  bool Ok = true;
};

struct Scope
{
  std::map<std::string, Value> Values;
  const Scope* Parent = nullptr;

  const Value* Find(const std::string& name) const
  {
    for (const Scope* s = this; s; s = s->Parent)
    {
      const auto found = s->Values.find(name);
      if (found != s->Values.end())
      {
        return &found->second;
      }
    }
    return nullptr;
  }
  std::vector<std::string> Names() const
  {
    std::vector<std::string> names;
    for (const Scope* s = this; s; s = s->Parent)
    {
      for (const auto& v : s->Values)
      {
        names.push_back(v.first);
      }
    }
    return names;
  }
};

/// Who a message is about.
struct Who
{
  std::string Where;
  std::vector<std::string> Context;
  std::string Node;
};

struct Instance
{
  std::string Path; ///< "" is the top level
  const PipelineTemplate* Template = nullptr;
  const PipelineNode* Item = nullptr; ///< null: a template that nobody instantiates, checked on its own
  Instance* Parent = nullptr;
  Scope Parameters;
  std::vector<std::string> Context;
  std::string Where;
  std::vector<std::string> Names; ///< ids of the nodes and instances in it
  bool Broken = false;            ///< its template is unknown: say nothing about what refers to it

  std::string Prefix() const { return this->Path.empty() ? std::string() : this->Path + "/"; }
};

/// A text that names arrays, in the scope it was written in.
struct Reference
{
  const PipelineText* From = nullptr;
  Instance* In = nullptr;
  Who About;
};

struct Endpoint
{
  int Node = -1; ///< -1: unknown because of a mistake already reported
  std::string Array;
  bool Delayed = false;  ///< an instance's input on the way says delay="1"
  bool Optional = false; ///< one says optional="1"
  Reference Origin;      ///< the innermost text that named the node
};

const char* const CommandLine = "command line";

/// EachText of a file, of its variables' defaults and of the files that it includes.
template <class F>
void EachTextWithin(const PipelineDocument& d, const F& visit)
{
  for (const PipelineInclude& i : d.Includes)
  {
    if (i.Content)
    {
      EachTextWithin(*i.Content, visit);
    }
  }
  for (const PipelineVariable& v : d.Variables)
  {
    visit(v.Default);
  }
  EachText(d, visit);
}

bool IsName(const std::string& s)
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
const char* const NameRule = "a name starts with a letter or _ and goes on with letters, digits, _ and -";

std::string KindText(ArrayKind kind, int components)
{
  if (kind == ArrayKind::Any && components > 0)
  {
    return "an array of " + std::to_string(components) + (components == 1 ? " component" : " components");
  }
  return std::string(KindName(kind)) + " (" + KindDoc(kind) + ")";
}

bool Fits(ArrayKind wanted, const OutputArray& a)
{
  if (wanted == ArrayKind::Any)
  {
    return true;
  }
  if (a.Kind == ArrayKind::Any)
  {
    return a.Components <= 0 || a.Components == KindComponents(wanted);
  }
  return a.Kind == wanted;
}

class Builder
{
public:
  Builder(std::shared_ptr<const PipelineDocument> document, const StageRegistry& registry, const GraphOptions& options,
    Diagnostics& diagnostics)
    : Document(document)
    , Registry(registry)
    , Options(options)
    , Messages(diagnostics)
    , Result(std::make_shared<Graph>())
  {
    this->Result->Document = document;
    this->Result->Options = options;
  }

  std::shared_ptr<Graph> Build()
  {
    this->CollectVariables();
    this->CollectTemplates(*this->Document);
    this->ReadTime();
    this->Instances.emplace_back();
    Instance& top = this->Instances.back();
    top.Parameters.Parent = &this->Globals;
    std::vector<const PipelineTemplate*> stack;
    this->Flatten(this->Document->Nodes, top, stack);
    this->CheckAssignments();
    this->SetAllProperties(0);
    this->ResolveInstances(0);
    this->ConnectAll(0);
    const std::size_t instances = this->Instances.size();
    this->BuildOutputs();

    // Templates that nobody instantiates are checked like the others, then dropped.
    const std::size_t real = this->Result->Nodes.size();
    this->FlattenUnused();
    this->SetAllProperties(real);
    this->ResolveInstances(instances);
    this->ConnectAll(real);
    this->CheckArrays();
    this->CheckConnections();
    this->CheckCycles();
    this->Result->Nodes.resize(real);
    this->CheckSettings();
    if (!this->Messages.HasErrors())
    {
      this->MakeOrder();
    }
    this->Warn();
    return this->Result;
  }

private:
  // ---- messages -------------------------------------------------------------------------------------------------
  void Say(
    Severity level, const SourceLocation& place, const Who& who, const std::string& what, const std::string& hint = {})
  {
    Diagnostic d;
    d.Level = level;
    d.Place = place;
    d.Where = who.Where;
    d.What = what;
    d.Hint = hint;
    d.Context = who.Context;
    d.Node = who.Node;
    if (level == Severity::Error)
    {
      this->Faulty.insert(who.Node);
    }
    this->Messages.Add(std::move(d));
  }
  void Error(const SourceLocation& place, const Who& who, const std::string& what, const std::string& hint = {})
  {
    this->Say(Severity::Error, place, who, what, hint);
  }
  static SourceLocation OnCommandLine()
  {
    SourceLocation place;
    place.File = CommandLine;
    return place;
  }
  static bool IsCommandLine(const SourceLocation& place) { return place.File == CommandLine && place.Line <= 0; }
  /// Looking for what a misspelt name may have meant costs more than all the rest; after thousands of them, no more.
  bool Hints() const { return this->HintWork <= MaximumHintWork; }
  std::string Near(const std::string& name, const std::vector<std::string>& names)
  {
    for (const std::string& n : names)
    {
      this->HintWork += (name.size() + 1) * (n.size() + 1);
    }
    return this->Hints() ? DidYouMean(name, names) : std::string();
  }
  std::string NearOr(const std::string& name, const std::vector<std::string>& names, const std::string& label)
  {
    const std::string near = this->Near(name, names);
    return near.empty() && this->Hints() ? label + Listed(names) : near;
  }
  /// Charges a step of the expansion; false, once with a message, when there is no end to it.
  bool Spend(std::size_t work, const SourceLocation& place, const Who& who)
  {
    if (this->Overfull)
    {
      return false;
    }
    this->Work += work;
    if (this->Work > MaximumWork)
    {
      this->Overfill(place, who, "the pipeline expands to more than this program takes");
    }
    return !this->Overfull;
  }
  void Overfill(const SourceLocation& place, const Who& who, const std::string& what)
  {
    if (!this->Overfull)
    {
      this->Overfull = true;
      this->Error(place, who, what);
    }
  }

  // ---- variables ------------------------------------------------------------------------------------------------
  /// Expands $(name); "$$(" is a literal "$(".
  Value Expand(const PipelineText& text, const Scope& scope, const Who& who)
  {
    Value value;
    value.Base = text.Place.File == CommandLine ? std::string() : DirectoryOf(text.Place.File);
    const std::string& s = text.Value;
    if (!this->Spend(StepWork + s.size(), text.Place, who))
    {
      value.Ok = false;
      return value;
    }
    for (std::size_t i = 0; i < s.size();)
    {
      if (s.compare(i, 3, "$$(") == 0)
      {
        value.Text += "$(";
        i += 3;
        continue;
      }
      if (s.compare(i, 2, "$(") != 0)
      {
        value.Text += s[i++];
        continue;
      }
      const std::size_t end = s.find(')', i);
      if (end == std::string::npos)
      {
        this->Error(text.Place, who, Quoted(s) + " has no \")\" after \"$(\"", "write $$( for a plain $(");
        value.Ok = false;
        return value;
      }
      const std::string name = s.substr(i + 2, end - i - 2);
      const Value* variable = this->FindValue(name, scope);
      if (!variable)
      {
        this->Error(text.Place, who, "$(" + Quoted(name).substr(1, Quoted(name).size() - 2) + "): no such variable",
          this->NearOr(name, this->VariableNames(scope), "variables: "));
        value.Ok = false;
        i = end + 1;
        continue;
      }
      value.Ok = value.Ok && variable->Ok;
      if (i == 0)
      {
        value.Base = variable->Base;
      }
      value.Text += variable->Text;
      const bool tooLong = value.Text.size() > MaximumText;
      if (tooLong || !this->Spend(variable->Text.size(), text.Place, who))
      {
        if (tooLong)
        {
          this->Error(text.Place, who, "the value grows beyond " + std::to_string(MaximumText) + " characters");
        }
        value.Ok = false;
        value.Text.clear();
        return value;
      }
      i = end + 1;
    }
    return value;
  }

  std::vector<std::string> VariableNames(const Scope& scope) const
  {
    if (!this->Hints())
    {
      return {};
    }
    std::vector<std::string> names = scope.Names();
    std::set<std::string> seen(names.begin(), names.end());
    // While globals are being resolved, those not reached yet count too.
    for (const auto& d : this->Declared)
    {
      if (seen.insert(d->Name.Value).second)
      {
        names.push_back(d->Name.Value);
      }
    }
    return names;
  }

  const Value* FindValue(const std::string& name, const Scope& scope)
  {
    if (const Value* v = scope.Find(name))
    {
      return v;
    }
    const auto declared = this->DeclaredByName.find(name);
    return declared == this->DeclaredByName.end() ? nullptr : this->ResolveVariable(*declared->second);
  }

  /// Values are typed so that a wrong -D is reported where it is said, not where it is used.
  bool CheckType(const std::string& type, const std::string& text, std::string& error) const
  {
    long long i = 0;
    double d = 0;
    bool b = false;
    if (type == "int")
    {
      return detail::ParseInt(text, -(1LL << 53), 1LL << 53, i, error);
    }
    if (type == "double")
    {
      return detail::ParseDouble(text, -1e308, 1e308, d, error);
    }
    return type != "bool" || detail::ParseBool(text, b, error);
  }

  static const std::vector<std::string>& VariableTypes()
  {
    static const std::vector<std::string> types = { "int", "double", "bool", "string", "path" };
    return types;
  }

  const Value* ResolveVariable(const PipelineVariable& v)
  {
    const std::string& name = v.Name.Value;
    const auto known = this->Globals.Values.find(name);
    if (known != this->Globals.Values.end())
    {
      return &known->second;
    }
    Who who;
    who.Where = "variable " + Quoted(name);
    Value value;
    if (std::find(this->Resolving.begin(), this->Resolving.end(), name) != this->Resolving.end())
    {
      std::string loop;
      for (auto n = std::find(this->Resolving.begin(), this->Resolving.end(), name); n != this->Resolving.end(); ++n)
      {
        loop += *n + " <- ";
      }
      this->Error(v.Default.Place, who, "the value depends on itself: " + loop + name);
      value.Ok = false;
      return &(this->Globals.Values[name] = value);
    }
    if (this->Resolving.size() > 1000)
    {
      this->Error(v.Default.Place, who, "variables refer to each other more than 1000 deep");
      value.Ok = false;
      return &(this->Globals.Values[name] = value);
    }
    this->Resolving.push_back(name);
    value = this->Expand(v.Default, this->Globals, who);
    this->Resolving.pop_back();
    const auto again = this->Globals.Values.find(name);
    if (again != this->Globals.Values.end()) // found to be part of a loop meanwhile
    {
      return &again->second;
    }
    value.Ok = value.Ok && v.Default.Given;
    std::string error;
    if (value.Ok && !this->CheckType(v.Type.Value, value.Text, error))
    {
      this->Error(v.Default.Place, who, "default = " + error);
      value.Ok = false;
    }
    const auto define = this->Defines.find(name);
    if (define != this->Defines.end())
    {
      value = Value();
      value.Text = define->second;
      if (!this->CheckType(v.Type.Value, value.Text, error))
      {
        who.Where = "-D " + name;
        this->Error(
          OnCommandLine(), who, error, "the variable is " + v.Type.Value + ", default " + Quoted(v.Default.Value));
        value.Ok = false;
      }
    }
    return &(this->Globals.Values[name] = value);
  }

  void DeclareVariables(const PipelineDocument& d)
  {
    for (const PipelineInclude& i : d.Includes)
    {
      if (i.Content)
      {
        this->DeclareVariables(*i.Content);
      }
    }
    for (const PipelineVariable& v : d.Variables)
    {
      if (!v.Name.Given)
      {
        continue;
      }
      Who who;
      who.Where = "variable " + Quoted(v.Name.Value);
      if (!IsName(v.Name.Value))
      {
        this->Error(v.Name.Place, who, "not a name", NameRule);
        continue;
      }
      this->CheckTypeName(v.Type, who);
      const auto known = this->DeclaredByName.find(v.Name.Value);
      if (known == this->DeclaredByName.end())
      {
        this->Declared.push_back(&v);
        this->DeclaredByName[v.Name.Value] = &v;
      }
      else if (known->second->Place.File == v.Place.File || &d != this->Document.get())
      {
        this->Error(v.Name.Place, who, "already declared at " + known->second->Place.ToText());
      }
      else
      {
        // The file that includes a library may give its variables other defaults.
        *std::find(this->Declared.begin(), this->Declared.end(), known->second) = &v;
        known->second = &v;
      }
    }
  }

  void CheckTypeName(const PipelineText& type, const Who& who)
  {
    const auto& types = VariableTypes();
    if (type.Given && std::find(types.begin(), types.end(), type.Value) == types.end())
    {
      this->Error(type.Place, who, "unknown type " + Quoted(type.Value), this->NearOr(type.Value, types, "types: "));
    }
  }

  void CollectVariables()
  {
    this->DeclareVariables(*this->Document);
    for (const auto& define : this->Options.Defines)
    {
      if (!this->DeclaredByName.count(define.first))
      {
        Who who;
        who.Where = "-D " + define.first;
        std::vector<std::string> names;
        for (const PipelineVariable* v : this->Declared)
        {
          names.push_back(v->Name.Value);
        }
        this->Error(OnCommandLine(), who, "no such variable", this->NearOr(define.first, names, "variables: "));
        continue;
      }
      this->Defines[define.first] = define.second;
    }
    for (const PipelineVariable* v : this->Declared)
    {
      const Value* value = this->ResolveVariable(*v);
      this->Result->Variables[v->Name.Value] = value->Text;
    }
  }

  void ReadTime()
  {
    const PipelineTime& t = this->Document->Time;
    Who who;
    who.Where = "<time>";
    Timeline ticks;
    const auto whole = [&](const PipelineText& text, const char* name, long long lo, long long hi, int& out)
    {
      if (!text.Given)
      {
        return;
      }
      const Value v = this->Expand(text, this->Globals, who);
      long long n = 0;
      std::string error;
      if (!v.Ok)
      {
        return;
      }
      if (detail::ParseInt(v.Text, lo, hi, n, error))
      {
        out = int(n);
      }
      else
      {
        this->Error(text.Place, who, std::string(name) + " = " + error);
      }
    };
    whole(t.First, "first", -100000000, 100000000, ticks.First);
    whole(t.Count, "count", 1, 10000000, ticks.Count);
    if (t.Rate.Given)
    {
      const Value v = this->Expand(t.Rate, this->Globals, who);
      std::string error;
      double rate = 0;
      if (v.Ok && detail::ParseDouble(v.Text, 1e-6, 1e6, rate, error))
      {
        ticks.Rate = rate;
      }
      else if (v.Ok)
      {
        this->Error(t.Rate.Place, who, "rate = " + error);
      }
    }
    this->Result->Ticks = ticks;
  }

  // ---- templates and instances ----------------------------------------------------------------------------------
  void CollectTemplates(const PipelineDocument& d)
  {
    for (const PipelineInclude& i : d.Includes)
    {
      if (i.Content)
      {
        this->CollectTemplates(*i.Content);
      }
    }
    for (const PipelineTemplate& t : d.Templates)
    {
      if (!t.Name.Given)
      {
        continue;
      }
      Who who;
      who.Where = "template " + Quoted(t.Name.Value);
      if (!IsName(t.Name.Value))
      {
        this->Error(t.Name.Place, who, "not a name", NameRule);
        continue;
      }
      const auto known = this->Templates.find(t.Name.Value);
      if (known != this->Templates.end())
      {
        this->Error(t.Name.Place, who, "already defined at " + known->second->Place.ToText());
        continue;
      }
      this->Templates[t.Name.Value] = &t;
      std::map<std::string, SourceLocation> names;
      for (const PipelineVariable& p : t.Parameters)
      {
        this->CheckLocalName(p.Name, "parameter", names, who);
        this->CheckTypeName(p.Type, who);
      }
      names.clear();
      for (const PipelinePort& p : t.Inputs)
      {
        this->CheckLocalName(p.Name, "input port", names, who);
        this->CheckPortKind(p, who);
      }
      names.clear();
      for (const PipelinePort& p : t.Outputs)
      {
        this->CheckLocalName(p.Name, "output port", names, who);
        this->CheckPortKind(p, who);
      }
    }
  }

  void CheckLocalName(
    const PipelineText& name, const char* what, std::map<std::string, SourceLocation>& names, const Who& who)
  {
    if (!name.Given)
    {
      return;
    }
    if (!IsName(name.Value))
    {
      this->Error(name.Place, who, std::string(what) + " " + Quoted(name.Value) + ": not a name", NameRule);
      return;
    }
    const auto added = names.emplace(name.Value, name.Place);
    if (!added.second)
    {
      this->Error(name.Place, who,
        std::string(what) + " " + Quoted(name.Value) + " is already declared at " + added.first->second.ToText());
    }
  }

  /// Kind that a template's port declares, by the name of a kind or of a known array; Any when it declares none.
  static bool FindKind(const std::string& name, ArrayKind& kind)
  {
    for (int k = 0; k <= int(ArrayKind::Any); ++k)
    {
      if (name == KindName(ArrayKind(k)))
      {
        kind = ArrayKind(k);
        return true;
      }
    }
    const ArrayType* array = FindArray(name);
    kind = array ? array->Kind : ArrayKind::Any;
    return array != nullptr;
  }
  static ArrayKind PortKind(const PipelinePort& p)
  {
    ArrayKind kind = ArrayKind::Any;
    if (p.Type.Given)
    {
      FindKind(p.Type.Value, kind);
    }
    return kind;
  }
  void CheckPortKind(const PipelinePort& p, const Who& who)
  {
    ArrayKind kind = ArrayKind::Any;
    if (p.Type.Given && !FindKind(p.Type.Value, kind))
    {
      std::vector<std::string> names;
      for (int k = 0; k <= int(ArrayKind::Any); ++k)
      {
        names.push_back(KindName(ArrayKind(k)));
      }
      this->Error(p.Type.Place, who, "port " + Quoted(p.Name.Value) + ": unknown type " + Quoted(p.Type.Value),
        this->NearOr(p.Type.Value, names, "types: "));
    }
  }

  /// Takes an id in the scope `in`; false (reported) when it cannot be used.
  bool TakeId(const PipelineNode& item, Instance& in, std::string& id)
  {
    Who who;
    who.Context = in.Context;
    who.Where = item.IsInstance ? "instance" : "node";
    if (!item.Id.Given)
    {
      return false;
    }
    const Value v = this->Expand(item.Id, in.Parameters, who);
    if (!v.Ok)
    {
      return false;
    }
    id = v.Text;
    if (!IsName(id))
    {
      this->Error(item.Id.Place, who, "id " + Quoted(id) + " is not a name", NameRule);
      return false;
    }
    const std::string path = in.Prefix() + id;
    const auto used = this->Used.emplace(path, item.Place);
    if (!used.second)
    {
      who.Where.clear();
      this->Error(item.Id.Place, who, "id " + Quoted(id) + " is already used at " + used.first->second.ToText());
      return false;
    }
    in.Names.push_back(id);
    return true;
  }

  void Flatten(const std::vector<PipelineNode>& items, Instance& in, std::vector<const PipelineTemplate*>& stack)
  {
    for (const PipelineNode& item : items)
    {
      std::string id;
      if (!this->TakeId(item, in, id))
      {
        continue;
      }
      if (this->Result->Nodes.size() + this->Instances.size() > MaximumNodes)
      {
        Who who;
        who.Context = in.Context;
        this->Overfill(item.Place, who, TooManyNodes());
      }
      if (this->Overfull)
      {
        return;
      }
      if (item.IsInstance)
      {
        this->FlattenInstance(item, id, in, stack);
      }
      else
      {
        this->FlattenNode(item, id, in);
      }
    }
  }

  static std::string TooManyNodes()
  {
    return "the pipeline expands to more than " + std::to_string(MaximumNodes) + " nodes";
  }

  void FlattenNode(const PipelineNode& item, const std::string& id, Instance& in)
  {
    GraphNode node;
    node.Path = in.Prefix() + id;
    node.Place = item.Place;
    node.Context = in.Context;
    Who who;
    who.Where = "node " + Quoted(id);
    who.Context = in.Context;
    who.Node = node.Path;
    const Value type = this->Expand(item.Type, in.Parameters, who);
    if (type.Ok && item.Type.Given)
    {
      node.Type = type.Text;
      node.Stage = this->Registry.Create(type.Text);
      if (!node.Stage)
      {
        const std::vector<std::string> types = this->Registry.Types();
        const std::string near = this->Near(type.Text, types);
        this->Error(item.Type.Place, who, "unknown type " + Quoted(type.Text),
          near.empty() ? "quell nodes lists the types" : near);
      }
    }
    if (node.Stage)
    {
      who.Where += " (" + node.Type + ")";
    }
    this->ByPath[node.Path] = int(this->Result->Nodes.size());
    this->Items.push_back({ &item, &in, who });
    this->Result->Nodes.push_back(std::move(node));
  }

  void FlattenInstance(
    const PipelineNode& item, const std::string& id, Instance& in, std::vector<const PipelineTemplate*>& stack)
  {
    this->Instances.emplace_back();
    Instance& instance = this->Instances.back();
    instance.Path = in.Prefix() + id;
    instance.Item = &item;
    instance.Parent = &in;
    instance.Parameters.Parent = &this->Globals;
    instance.Where = "instance " + Quoted(id);
    instance.Context = in.Context;
    instance.Broken = true;
    this->InstanceByPath[instance.Path] = &instance;
    Who who;
    who.Where = instance.Where;
    who.Context = in.Context;
    who.Node = instance.Path;
    const Value type = this->Expand(item.Type, in.Parameters, who);
    if (!type.Ok || !item.Type.Given)
    {
      return;
    }
    const auto found = this->Templates.find(type.Text);
    if (found == this->Templates.end())
    {
      std::vector<std::string> names;
      for (const auto& t : this->Templates)
      {
        names.push_back(t.first);
      }
      this->Error(
        item.Type.Place, who, "unknown template " + Quoted(type.Text), this->NearOr(type.Text, names, "templates: "));
      return;
    }
    const PipelineTemplate* t = found->second;
    this->Instantiated.insert(t);
    const auto open = std::find(stack.begin(), stack.end(), t);
    if (open != stack.end())
    {
      std::string loop;
      for (auto s = open; s != stack.end(); ++s)
      {
        loop += (*s)->Name.Value + " -> ";
      }
      this->Error(item.Place, who, "templates instantiate each other without end: " + loop + t->Name.Value);
      return;
    }
    if (int(stack.size()) >= MaximumDepth)
    {
      this->Error(item.Place, who, "instances are nested more than " + std::to_string(MaximumDepth) + " deep");
      return;
    }
    instance.Broken = false;
    instance.Template = t;
    instance.Where += " (template " + Quoted(t->Name.Value) + ")";
    who.Where = instance.Where;
    instance.Context.insert(instance.Context.begin(), "in instance " + Quoted(id) + " at " + item.Place.ToText() +
                                                        ", from template " + Quoted(t->Name.Value) + " at " +
                                                        t->Place.ToText());

    std::map<std::string, const PipelineProperty*> given;
    std::vector<std::string> names;
    for (const PipelineVariable& p : t->Parameters)
    {
      names.push_back(p.Name.Value);
    }
    const std::set<std::string> known(names.begin(), names.end());
    for (const PipelineProperty& p : item.Properties)
    {
      if (!p.Name.Given)
      {
        continue;
      }
      if (!known.count(p.Name.Value))
      {
        this->Error(
          p.Name.Place, who, "no parameter " + Quoted(p.Name.Value), this->NearOr(p.Name.Value, names, "parameters: "));
      }
      else if (!given.emplace(p.Name.Value, &p).second)
      {
        this->Error(p.Name.Place, who,
          "parameter " + Quoted(p.Name.Value) + " is already set at " + given[p.Name.Value]->Place.ToText());
      }
    }
    for (const PipelineVariable& p : t->Parameters)
    {
      if (this->Overfull)
      {
        return;
      }
      if (!p.Name.Given || !p.Default.Given)
      {
        continue;
      }
      const auto set = given.find(p.Name.Value);
      Value value;
      Who about = who;
      if (set != given.end() && set->second->Value.Given)
      {
        value = this->Expand(set->second->Value, in.Parameters, who);
      }
      else
      {
        about.Where = "template " + Quoted(t->Name.Value);
        about.Context = instance.Context;
        value = this->Expand(p.Default, instance.Parameters, about);
      }
      std::string error;
      if (value.Ok && !this->CheckType(p.Type.Value, value.Text, error))
      {
        this->Error(set != given.end() ? set->second->Value.Place : p.Default.Place, about,
          p.Name.Value + " = " + error, set != given.end() ? "default " + Quoted(p.Default.Value) : std::string());
        value.Ok = false;
      }
      instance.Parameters.Values[p.Name.Value] = value;
    }
    stack.push_back(t);
    this->Flatten(t->Nodes, instance, stack);
    stack.pop_back();
  }

  void FlattenUnused()
  {
    for (const PipelineTemplate& t : this->Document->Templates)
    {
      const auto known = this->Templates.find(t.Name.Value);
      if (known == this->Templates.end() || known->second != &t || this->Instantiated.count(&t) || this->Overfull)
      {
        continue;
      }
      this->Instances.emplace_back();
      Instance& instance = this->Instances.back();
      instance.Path = "<" + t.Name.Value + ">";
      instance.Template = &t;
      instance.Parameters.Parent = &this->Globals;
      instance.Where = "template " + Quoted(t.Name.Value);
      instance.Context.push_back("in template " + Quoted(t.Name.Value) + " at " + t.Place.ToText());
      this->InstanceByPath[instance.Path] = &instance;
      Who who;
      who.Where = instance.Where;
      for (const PipelineVariable& p : t.Parameters)
      {
        if (p.Name.Given && p.Default.Given)
        {
          Value value = this->Expand(p.Default, instance.Parameters, who);
          std::string error;
          if (value.Ok && !this->CheckType(p.Type.Value, value.Text, error))
          {
            this->Error(p.Default.Place, who, p.Name.Value + " = " + error);
            value.Ok = false;
          }
          instance.Parameters.Values[p.Name.Value] = value;
        }
      }
      std::vector<const PipelineTemplate*> stack{ &t };
      this->Flatten(t.Nodes, instance, stack);
      this->Unused.push_back(&t);
    }
  }

  // ---- properties -----------------------------------------------------------------------------------------------
  struct Override
  {
    std::string Text;
    bool Used = false;
  };

  /// --set and --seed: known nodes and properties only.
  void CheckAssignments()
  {
    for (const auto& a : this->Options.Properties)
    {
      Who who;
      who.Where = "--set " + a.first;
      const std::size_t dot = a.first.rfind('.');
      if (dot == std::string::npos)
      {
        this->Error(OnCommandLine(), who, "not of the form node.Property=value");
        continue;
      }
      const std::string path = a.first.substr(0, dot), name = a.first.substr(dot + 1);
      const auto found = this->ByPath.find(path);
      // Nodes made for outputs come later; BuildOutputs finds their settings by itself.
      const std::size_t colon = path.find(':');
      if (found == this->ByPath.end() && colon != std::string::npos)
      {
        bool known = false;
        for (const PipelineOutput& o : this->Document->Outputs)
        {
          known = known || o.Name.Value == path.substr(0, colon);
        }
        if (known && (path.substr(colon) == ":write" || path.substr(colon) == ":view"))
        {
          this->Overrides[{ path, name }] = a.second;
          continue;
        }
      }
      if (found == this->ByPath.end())
      {
        std::vector<std::string> names;
        for (const auto& n : this->ByPath)
        {
          names.push_back(n.first);
        }
        this->Error(OnCommandLine(), who, "no node " + Quoted(path), this->NearOr(path, names, "nodes: "));
        continue;
      }
      const GraphNode& node = this->Result->Nodes[std::size_t(found->second)];
      if (node.Stage && !node.Description().FindProperty(name))
      {
        this->Error(OnCommandLine(), who,
          "node " + Quoted(path) + " (" + node.Type + ") has no property " + Quoted(name),
          this->NearOr(name, PropertyNames(node.Description()), "properties: "));
        continue;
      }
      this->Overrides[{ path, name }] = a.second;
    }
    if (this->Options.Seed)
    {
      bool any = false;
      for (const GraphNode& node : this->Result->Nodes)
      {
        if (node.Stage && node.Description().FindProperty("Seed"))
        {
          any = true;
          this->Overrides.emplace(std::make_pair(node.Path, std::string("Seed")), std::to_string(*this->Options.Seed));
        }
      }
      if (!any)
      {
        Who who;
        who.Where = "--seed";
        this->Say(Severity::Warning, OnCommandLine(), who, "no node has a property Seed");
      }
    }
  }

  static std::vector<std::string> PropertyNames(const StageDescription& d)
  {
    std::vector<std::string> names;
    for (const Property& p : d.Properties)
    {
      names.push_back(p.Name);
    }
    return names;
  }

  void SetAllProperties(std::size_t from)
  {
    for (std::size_t n = from; n < this->Result->Nodes.size(); ++n)
    {
      GraphNode& node = this->Result->Nodes[n];
      const Source source = this->Items[n];
      if (!source.Item)
      {
        continue; // made for an output
      }
      std::map<std::string, SourceLocation> seen;
      for (const PipelineProperty& p : source.Item->Properties)
      {
        if (!p.Name.Given || !p.Value.Given)
        {
          continue;
        }
        const Value name = this->Expand(p.Name, source.In->Parameters, source.About);
        if (!name.Ok)
        {
          continue;
        }
        const auto added = seen.emplace(name.Text, p.Place);
        if (!added.second)
        {
          this->Error(p.Name.Place, source.About,
            "property " + Quoted(name.Text) + " is already set at " + added.first->second.ToText());
          continue;
        }
        const Value value = this->Expand(p.Value, source.In->Parameters, source.About);
        if (node.Stage && !node.Description().FindProperty(name.Text))
        {
          this->Error(p.Name.Place, source.About, "no property " + Quoted(name.Text),
            this->NearOr(name.Text, PropertyNames(node.Description()), "properties: "));
          this->BadProperties.insert(int(n));
          continue;
        }
        if (this->Overrides.count({ node.Path, name.Text }))
        {
          continue;
        }
        if (!value.Ok)
        {
          this->BadProperties.insert(int(n));
          continue;
        }
        this->SetProperty(int(n), name.Text, value, p.Value.Place, source.About);
      }
      this->ApplyOverrides(int(n));
    }
  }

  void ApplyOverrides(int n)
  {
    const std::string path = this->Result->Nodes[std::size_t(n)].Path;
    for (const auto& o : this->Overrides)
    {
      if (o.first.first == path)
      {
        Value value;
        value.Text = o.second;
        Who who;
        who.Where = "--set " + path;
        who.Node = path;
        this->SetProperty(n, o.first.second, value, OnCommandLine(), who);
      }
    }
  }

  void SetProperty(int n, const std::string& name, const Value& value, const SourceLocation& place, const Who& who)
  {
    GraphNode& node = this->Result->Nodes[std::size_t(n)];
    if (!node.Stage)
    {
      return;
    }
    const Property* property = node.Description().FindProperty(name);
    if (!property)
    {
      this->Error(place, who, "no property " + Quoted(name),
        this->NearOr(name, PropertyNames(node.Description()), "properties: "));
      this->BadProperties.insert(n);
      return;
    }
    std::string text = value.Text;
    if (property->Kind == Property::Type::Path && !text.empty() && text.find("://") == std::string::npos)
    {
      text = JoinPath(value.Base, text);
      if (!this->PathExists(text))
      {
        this->Error(place, who, name + " = " + Quoted(value.Text) + ": no such file",
          text == value.Text ? std::string() : "looked for " + text);
        this->BadProperties.insert(n);
        return;
      }
    }
    else if (property->Kind == Property::Type::String && node.Description().Sink && name == "File" && !text.empty())
    {
      text = this->OutputPath(text, place, name, who);
      if (text.empty())
      {
        this->BadProperties.insert(n);
        return;
      }
    }
    std::string error;
    if (!property->SetText(node.Stage, text, error))
    {
      this->Error(place, who, name + " = " + error);
      this->BadProperties.insert(n);
      return;
    }
    node.Properties.push_back({ name, text, place });
  }

  /// Where an output file is put; empty after an error.
  std::string OutputPath(const std::string& text, const SourceLocation& place, const std::string& name, const Who& who)
  {
    const std::string path = JoinPath(this->Options.OutputDirectory, text);
    for (const fs::path& part : fs::path(path))
    {
      if (part.native().size() > NAME_MAX)
      {
        this->Error(place, who,
          name + " = " + Quoted(text.substr(0, 40) + "...") + ": a name of " + std::to_string(part.native().size()) +
            " bytes, more than the " + std::to_string(NAME_MAX) + " that a file's may have");
        return std::string();
      }
    }
    if (fs::path(text).parent_path().native().find("##") != std::string::npos)
    {
      this->Error(place, who,
        name + " = " + Quoted(text) + ": the number of a frame stands in the name of a file, not of a directory",
        "write the #### behind the last /");
      return std::string();
    }
    std::string directory;
    if (this->Options.Outside == OutsideOutputs::Allowed || IsCommandLine(place) ||
        IsInside(this->Options.OutputDirectory, path, directory))
    {
      return path;
    }
    if (this->Options.Outside == OutsideOutputs::Moved)
    {
      const std::string file = fs::path(text).filename().string();
      return JoinPath(this->Options.OutputDirectory, "outside/" + std::to_string(this->Moved++) + "/" + file);
    }
    this->Error(place, who,
      name + " = " + Quoted(text) + " lies outside of the directory for output files, " + directory,
      "choose that directory with --out DIR, or let this pipeline write anywhere with --allow-outside");
    return std::string();
  }

  /// Symbolic links count as what they lead to; the last one, the file itself, would be replaced and not followed.
  static bool IsInside(const std::string& outputs, const std::string& path, std::string& directory)
  {
    std::error_code code;
    const fs::path root = fs::weakly_canonical(fs::absolute(outputs.empty() ? "." : outputs, code), code);
    directory = root.string();
    const fs::path file = fs::absolute(path, code);
    const fs::path parent = fs::weakly_canonical(file.parent_path(), code);
    if (code || file.filename() == ".." || file.filename() == "." || path.find('\0') != std::string::npos)
    {
      return false;
    }
    const auto ends = std::mismatch(root.begin(), root.end(), parent.begin(), parent.end());
    // "/a/" has an empty last part.
    return ends.first == root.end() || (std::next(ends.first) == root.end() && ends.first->empty());
  }

  /// A sequence (####) exists when any of its frames does.
  static bool PathExists(const std::string& path)
  {
    std::error_code code;
    if (path.find('\0') != std::string::npos)
    {
      return false;
    }
    const std::string name = fs::path(path).filename().string();
    const std::size_t first = name.find('#');
    if (first == std::string::npos)
    {
      return fs::exists(path, code);
    }
    const std::size_t last = name.find_last_of('#');
    const std::string head = name.substr(0, first), tail = name.substr(last + 1);
    const std::string directory = DirectoryOf(path);
    fs::directory_iterator at(directory.empty() ? "." : directory, code), end;
    for (; !code && at != end; at.increment(code))
    {
      const std::string file = at->path().filename().string();
      if (file.size() > head.size() + tail.size() && file.compare(0, head.size(), head) == 0 &&
          file.compare(file.size() - tail.size(), tail.size(), tail) == 0)
      {
        return true;
      }
    }
    return false;
  }

  // ---- connections ----------------------------------------------------------------------------------------------
  Endpoint Unknown(const Reference& r) const
  {
    Endpoint e;
    e.Origin = r;
    return e;
  }

  /// What a text refers to, through template ports and instance outputs. Mistakes are reported where the text stands.
  std::vector<Endpoint> Resolve(const Reference& r, int depth)
  {
    if (!r.From->Given)
    {
      return { this->Unknown(r) };
    }
    if (!this->Spend(ConnectionWork, r.From->Place, r.About))
    {
      return { this->Unknown(r) };
    }
    // The texts passed on the way here, each in its instance.
    this->Passed.resize(std::size_t(depth));
    const std::pair<const PipelineText*, const Instance*> here(r.From, r.In);
    if (std::find(this->Passed.begin(), this->Passed.end(), here) != this->Passed.end())
    {
      this->Error(r.From->Place, r.About, Quoted(r.From->Value) + " leads back to itself through template ports");
      return { this->Unknown(r) };
    }
    if (depth > MaximumPassages)
    {
      // Whatever reads the same chain comes here too: once is enough.
      if (!this->WayTooLong)
      {
        this->Error(r.From->Place, r.About,
          Quoted(r.From->Value) + " leads through more than " + std::to_string(MaximumPassages) + " template ports");
        this->WayTooLong = true;
      }
      return { this->Unknown(r) };
    }
    this->Passed.push_back(here);
    const Value value = this->Expand(*r.From, r.In->Parameters, r.About);
    if (!value.Ok)
    {
      return { this->Unknown(r) };
    }
    const std::string& text = value.Text;
    if (text.empty())
    {
      this->Error(r.From->Place, r.About, "from is empty", "write node:array");
      return { this->Unknown(r) };
    }
    if (text[0] == '@')
    {
      return this->ResolvePort(r, text.substr(1), depth);
    }
    const std::size_t colon = text.rfind(':');
    const std::string name = text.substr(0, colon);
    const std::string array = colon == std::string::npos ? std::string() : text.substr(colon + 1);
    if (colon != std::string::npos && (array.empty() || name.empty()))
    {
      this->Error(r.From->Place, r.About, Quoted(text) + " is not of the form node:array");
      return { this->Unknown(r) };
    }
    const std::string path = r.In->Prefix() + name;
    const auto node = this->ByPath.find(path);
    if (node != this->ByPath.end())
    {
      Endpoint e;
      e.Node = node->second;
      e.Array = array;
      e.Origin = r;
      if (!this->Result->Nodes[std::size_t(e.Node)].Stage)
      {
        e.Node = -1;
      }
      return { e };
    }
    const auto instance = this->InstanceByPath.find(path);
    if (instance != this->InstanceByPath.end())
    {
      return this->ResolveOutput(r, *instance->second, array, depth);
    }
    if (this->Used.count(path))
    {
      return { this->Unknown(r) }; // its own mistake is reported
    }
    std::vector<std::string> names;
    if (this->Hints())
    {
      names = r.In->Names;
    }
    if (r.In->Path.empty() && this->Hints())
    {
      for (const auto& n : this->ByPath)
      {
        if (n.first.find('/') != std::string::npos)
        {
          names.push_back(n.first);
        }
      }
    }
    this->Error(r.From->Place, r.About, "no node " + Quoted(name), this->NearOr(name, names, "nodes: "));
    return { this->Unknown(r) };
  }

  std::vector<Endpoint> ResolvePort(const Reference& r, const std::string& port, int depth)
  {
    Instance& in = *r.In;
    if (in.Template && in.Item &&
        !this->Spend(in.Template->Inputs.size() + in.Item->Inputs.size(), r.From->Place, r.About))
    {
      return { this->Unknown(r) };
    }
    if (!in.Template)
    {
      this->Error(r.From->Place, r.About, Quoted("@" + port) + " is a template's port, but this is no template",
        "write node:array");
      return { this->Unknown(r) };
    }
    std::vector<std::string> names;
    for (const PipelinePort& p : in.Template->Inputs)
    {
      names.push_back(p.Name.Value);
    }
    if (std::find(names.begin(), names.end(), port) == names.end())
    {
      this->Error(r.From->Place, r.About,
        "template " + Quoted(in.Template->Name.Value) + " has no input port " + Quoted(port),
        this->NearOr(port, names, "ports: "));
      return { this->Unknown(r) };
    }
    if (!in.Item)
    {
      return { this->Unknown(r) };
    }
    std::vector<Endpoint> ends;
    for (const PipelineInput& input : in.Item->Inputs)
    {
      if (input.Port.Given && input.Port.Value == port)
      {
        const Reference outer = this->InstanceInput(in, input);
        std::vector<Endpoint> more = this->Resolve(outer, depth + 1);
        const bool delayed = this->IsDelayed(input, outer), optional = this->IsOptional(input.Optional, outer);
        for (Endpoint& e : more)
        {
          e.Delayed = e.Delayed || delayed;
          e.Optional = e.Optional || optional;
        }
        ends.insert(ends.end(), more.begin(), more.end());
      }
    }
    // A port without any input is reported once, by ResolveInstances.
    return ends.empty() ? std::vector<Endpoint>{ this->Unknown(r) } : ends;
  }

  /// The value of delay="..."; a mistake in it is reported, and counts as a delay, so that it is not called a cycle as
  /// well.
  bool IsDelayed(const PipelineInput& input, const Reference& r)
  {
    if (!input.Delay.Given)
    {
      return false;
    }
    const Value delay = this->Expand(input.Delay, r.In->Parameters, r.About);
    bool delayed = false;
    std::string error;
    if (delay.Ok && !detail::ParseBool(delay.Text, delayed, error))
    {
      this->Error(input.Delay.Place, r.About, "delay = " + Quoted(delay.Text) + " is neither 0 nor 1",
        "delay=\"1\" reads the previous frame");
      return true;
    }
    return delayed;
  }

  /// The same of optional="..."; `what`: "input" or "layer".
  bool IsOptional(const PipelineText& text, const Reference& r, const std::string& what = "input")
  {
    if (!text.Given)
    {
      return false;
    }
    const Value value = this->Expand(text, r.In->Parameters, r.About);
    bool optional = false;
    std::string error;
    if (value.Ok && !detail::ParseBool(value.Text, optional, error))
    {
      this->Error(text.Place, r.About, "optional = " + Quoted(value.Text) + " is neither 0 nor 1",
        "optional=\"1\" leaves the " + what + " out where there is no such array");
    }
    return optional;
  }

  Reference InstanceInput(Instance& instance, const PipelineInput& input) const
  {
    Reference r;
    r.From = &input.From;
    r.In = instance.Parent;
    r.About.Where = instance.Where + ": input " + Quoted(input.Port.Value);
    r.About.Context = instance.Parent->Context;
    r.About.Node = instance.Path;
    return r;
  }

  Reference InstanceOutput(Instance& instance, const PipelinePort& port) const
  {
    Reference r;
    r.From = &port.From;
    r.In = &instance;
    r.About.Where = "template " + Quoted(instance.Template->Name.Value) + ": port " + Quoted(port.Name.Value);
    r.About.Context = instance.Context;
    r.About.Node = instance.Path;
    return r;
  }

  std::vector<Endpoint> ResolveOutput(const Reference& r, Instance& instance, const std::string& port, int depth)
  {
    if (instance.Broken || !this->Spend(instance.Template->Outputs.size(), r.From->Place, r.About))
    {
      return { this->Unknown(r) };
    }
    std::vector<std::string> names;
    for (const PipelinePort& p : instance.Template->Outputs)
    {
      if (port.empty() || p.Name.Value == port)
      {
        return this->Resolve(this->InstanceOutput(instance, p), depth + 1);
      }
      names.push_back(p.Name.Value);
    }
    this->Error(r.From->Place, r.About, instance.Where + " has no output" + (port.empty() ? "" : " " + Quoted(port)),
      this->NearOr(port, names, "it has "));
    return { this->Unknown(r) };
  }

  /// Inputs and outputs of every instance: whether or not anything inside reads them.
  void ResolveInstances(std::size_t from)
  {
    for (std::size_t i = from; i < this->Instances.size(); ++i)
    {
      Instance& instance = this->Instances[i];
      if (!instance.Template || instance.Broken)
      {
        continue;
      }
      for (const PipelinePort& p : instance.Template->Outputs)
      {
        const Reference r = this->InstanceOutput(instance, p);
        for (const Endpoint& e : this->Resolve(r, 0))
        {
          this->Typed.push_back({ e, PortKind(p), r, p.From.Place });
        }
      }
      if (!instance.Item)
      {
        continue;
      }
      Who who;
      who.Where = instance.Where;
      who.Context = instance.Parent->Context;
      who.Node = instance.Path;
      std::vector<std::string> names;
      std::map<std::string, const PipelinePort*> ports;
      for (const PipelinePort& p : instance.Template->Inputs)
      {
        names.push_back(p.Name.Value);
        ports.emplace(p.Name.Value, &p);
      }
      std::set<std::string> connected;
      for (const PipelineInput& input : instance.Item->Inputs)
      {
        const auto port = ports.find(input.Port.Value);
        if (!input.Port.Given)
        {
          continue;
        }
        if (port == ports.end())
        {
          this->Error(input.Port.Place, who, "no input " + Quoted(input.Port.Value),
            this->NearOr(input.Port.Value, names, "inputs: "));
          continue;
        }
        connected.insert(input.Port.Value);
        const Reference r = this->InstanceInput(instance, input);
        const bool optional = this->IsOptional(input.Optional, r);
        for (Endpoint& e : this->Resolve(r, 0))
        {
          e.Optional = e.Optional || optional;
          this->Typed.push_back({ e, PortKind(*port->second), r, input.From.Place });
        }
      }
      for (const PipelinePort& p : instance.Template->Inputs)
      {
        if (p.Name.Given && !connected.count(p.Name.Value))
        {
          this->Error(instance.Item->Place, who, "required input " + Quoted(p.Name.Value) + " is not connected");
        }
      }
    }
  }

  void ConnectAll(std::size_t from)
  {
    for (std::size_t n = from; n < this->Result->Nodes.size(); ++n)
    {
      const Source source = this->Items[n];
      if (!source.Item)
      {
        continue;
      }
      for (const PipelineInput& input : source.Item->Inputs)
      {
        this->Connect(int(n), input, source);
      }
      this->CheckRequired(int(n), source);
    }
  }

  struct Source
  {
    const PipelineNode* Item = nullptr;
    Instance* In = nullptr;
    Who About;
  };

  void Connect(int n, const PipelineInput& input, const Source& source)
  {
    GraphNode& node = this->Result->Nodes[std::size_t(n)];
    if (!input.Port.Given)
    {
      return;
    }
    const Value port = this->Expand(input.Port, source.In->Parameters, source.About);
    Reference r;
    r.From = &input.From;
    r.In = source.In;
    r.About = source.About;
    r.About.Where += ": input " + Quoted(port.Text);
    const std::vector<Endpoint> ends = this->Resolve(r, 0);
    if (!node.Stage || !port.Ok)
    {
      return;
    }
    const StageDescription& d = node.Description();
    const int index = d.InputIndex(port.Text);
    if (index < 0)
    {
      std::vector<std::string> names;
      for (const InputPort& p : d.Inputs)
      {
        names.push_back(p.Name);
      }
      this->Error(
        input.Port.Place, source.About, "no input " + Quoted(port.Text), this->NearOr(port.Text, names, "inputs: "));
      return;
    }
    const bool delayed = this->IsDelayed(input, r);
    const bool anyDelayed =
      delayed || std::any_of(ends.begin(), ends.end(), [](const Endpoint& e) { return e.Delayed; });
    if (anyDelayed && index == 0)
    {
      this->Error(delayed ? input.Delay.Place : input.From.Place, r.About,
        "a stage's first input (" + Quoted(port.Text) + " of " + node.Type + ") cannot be delayed",
        "it gives the frame its size; every other input may read the previous frame");
    }
    bool optional = this->IsOptional(input.Optional, r);
    if (optional && index == 0)
    {
      this->Error(
        input.Optional.Place, r.About, "the first input of a stage cannot be optional", "it gives the frame its size");
      optional = false;
    }
    const InputPort& spec = d.Inputs[std::size_t(index)];
    for (const Endpoint& end : ends)
    {
      if (!this->Spend(ConnectionWork, input.Place, r.About))
      {
        return;
      }
      const auto used = this->Connections.find({ n, index });
      const int connection = used == this->Connections.end() ? 0 : used->second.Count;
      const GraphEdge* first = connection ? &node.Inputs[used->second.First] : nullptr;
      if (first && !spec.Repeatable)
      {
        const bool same = first->Place.ToText() == input.Place.ToText();
        this->Error(input.Place, r.About,
          same ? Quoted(input.From.Value) + " is connected " + std::to_string(ends.size()) + " times"
               : "is already connected at " + first->Place.ToText(),
          "it takes one connection");
        return;
      }
      const bool endDelayed = delayed || end.Delayed;
      if (first && index != 0 && (endDelayed || first->Delayed))
      {
        this->Error(
          input.Place, r.About, "a delayed input takes one connection", "it is connected at " + first->Place.ToText());
        return;
      }
      GraphEdge edge;
      edge.Port = index;
      edge.Connection = connection;
      edge.Producer = end.Node;
      edge.Array = end.Array;
      edge.Delayed = endDelayed;
      edge.Place = input.Place;
      for (const PipelineInput::Attribute& a : input.Attributes)
      {
        const Value value = this->Expand(a.Value, source.In->Parameters, r.About);
        std::string error;
        if (!value.Ok)
        {
          continue;
        }
        if (!node.Stage->SetInputAttribute(index, connection, a.Name, value.Text, error))
        {
          const std::string own = "input " + Quoted(port.Text) + " ";
          if (error.compare(0, own.size(), own) == 0)
          {
            error.erase(0, own.size());
          }
          std::vector<std::string> names = { "port", "from", "delay", "optional" };
          bool known = false;
          for (const InputAttribute& described : spec.Attributes)
          {
            names.push_back(described.Name);
            known = known || described.Name == a.Name;
          }
          this->Error(a.Value.Place, r.About, error, known ? std::string() : this->Near(a.Name, names));
          continue;
        }
        edge.Attributes.emplace_back(a.Name, value.Text);
      }
      this->Ends.push_back({ n, int(node.Inputs.size()), end, r, optional || end.Optional });
      this->AddEdge(n, std::move(edge));
    }
  }

  void AddEdge(int n, GraphEdge edge)
  {
    std::vector<GraphEdge>& inputs = this->Result->Nodes[std::size_t(n)].Inputs;
    PortUse& use = this->Connections[{ n, edge.Port }];
    use.First = use.Count ? use.First : inputs.size();
    ++use.Count;
    inputs.push_back(std::move(edge));
  }

  void CheckRequired(int n, const Source& source)
  {
    const GraphNode& node = this->Result->Nodes[std::size_t(n)];
    if (!node.Stage)
    {
      return;
    }
    const StageDescription& d = node.Description();
    if (!this->Spend(d.Inputs.size() * source.Item->Inputs.size(), node.Place, source.About))
    {
      return;
    }
    for (std::size_t p = 0; p < d.Inputs.size(); ++p)
    {
      bool connected = d.Inputs[p].Optional;
      for (const PipelineInput& input : source.Item->Inputs)
      {
        connected =
          connected || input.Port.Value == d.Inputs[p].Name || input.Port.Value.find("$(") != std::string::npos;
      }
      if (!connected)
      {
        this->Error(node.Place, source.About, "required input " + Quoted(d.Inputs[p].Name) + " is not connected",
          "it wants " + KindText(d.Inputs[p].Kind, 0));
      }
    }
  }

  // ---- outputs --------------------------------------------------------------------------------------------------
  /// A node made for an output; its edges are added by Link.
  int AddInternal(const char* type, const std::string& path, const Who& who, const SourceLocation& place)
  {
    if (this->Result->Nodes.size() > MaximumNodes)
    {
      this->Overfill(place, who, TooManyNodes());
    }
    if (this->Overfull)
    {
      return -1;
    }
    GraphNode node;
    node.Path = path;
    node.Type = type;
    node.Place = place;
    node.Internal = true;
    node.Stage = this->Registry.Create(type);
    if (!node.Stage)
    {
      this->Error(place, who, std::string("this program has no stage ") + type);
      return -1;
    }
    this->Items.push_back({ nullptr, nullptr, who });
    this->Result->Nodes.push_back(std::move(node));
    return int(this->Result->Nodes.size()) - 1;
  }

  void Link(
    int reader, int port, const Endpoint& end, const Who& who, const SourceLocation& place, const PipelineText* layer)
  {
    if (!this->Spend(ConnectionWork, place, who))
    {
      return;
    }
    GraphNode& node = this->Result->Nodes[std::size_t(reader)];
    GraphEdge edge;
    edge.Port = port;
    edge.Connection = this->Connections[{ reader, port }].Count;
    edge.Producer = end.Node;
    edge.Array = end.Array;
    edge.Place = place;
    if (layer && layer->Given)
    {
      Instance& top = this->Instances.front();
      const Value value = this->Expand(*layer, top.Parameters, who);
      std::string error;
      if (value.Ok && !node.Stage->SetInputAttribute(port, edge.Connection, "name", value.Text, error))
      {
        this->Error(layer->Place, who, error);
      }
      else if (value.Ok)
      {
        edge.Attributes.emplace_back("name", value.Text);
      }
    }
    Reference r = end.Origin;
    r.About = who;
    this->Ends.push_back({ reader, int(node.Inputs.size()), end, r, end.Optional });
    this->AddEdge(reader, std::move(edge));
  }

  void BuildOutputs()
  {
    Instance& top = this->Instances.front();
    std::map<std::string, std::string> files = this->AssignOutputs();
    std::map<std::string, SourceLocation> names, written;
    for (const PipelineOutput& o : this->Outputs)
    {
      Who who;
      who.Where = "output " + Quoted(o.Name.Value);
      if (o.Name.Given)
      {
        if (o.Place.File != CommandLine && !IsName(o.Name.Value))
        {
          this->Error(o.Name.Place, who, "not a name", NameRule);
        }
        const auto added = names.emplace(o.Name.Value, o.Place);
        if (!added.second)
        {
          this->Error(o.Name.Place, who, "the name is already used at " + added.first->second.ToText());
          continue;
        }
      }
      struct Layer
      {
        Endpoint End;
        const PipelineText* Name;
        SourceLocation Place;
      };
      std::vector<Layer> layers;
      const auto add = [&](const PipelineText& from, const PipelineText* name, const SourceLocation& place,
                         const PipelineText& optional)
      {
        Reference r;
        r.From = &from;
        r.In = &top;
        r.About = who;
        const bool mayLack = this->IsOptional(optional, r, "layer");
        if (mayLack && layers.empty())
        {
          this->Error(optional.Place, who, "the first layer cannot be optional", "it gives the file its size");
        }
        for (Endpoint e : this->Resolve(r, 0))
        {
          e.Optional = mayLack && !layers.empty();
          layers.push_back({ e, name, place });
        }
      };
      if (o.From.Given)
      {
        add(o.From, nullptr, o.From.Place, PipelineText());
      }
      for (const PipelineLayer& l : o.Layers)
      {
        add(l.From, &l.Name, l.From.Place, l.Optional);
      }
      if (o.View.Given && layers.size() > 1)
      {
        this->Error(
          o.View.Place, who, "a view shows one image, but there are " + std::to_string(layers.size()) + " layers");
      }
      if (o.Display.Given && !o.View.Given)
      {
        this->Error(o.Display.Place, who, "display is given without view");
      }
      if (layers.empty())
      {
        continue;
      }
      GraphOutput output;
      output.Name = o.Name.Value;
      output.Place = o.Place;
      output.Node = layers.front().End.Node;
      output.Array = layers.front().End.Array;
      const Value file = this->Expand(o.File, top.Parameters, who);
      const auto assigned = files.find(o.Name.Value);
      const bool writes = assigned != files.end() || o.File.Given;
      output.File = assigned != files.end() ? assigned->second : file.Text;
      const SourceLocation filePlace = assigned != files.end() ? OnCommandLine() : o.File.Place;
      if (writes && file.Ok && output.File.empty())
      {
        this->Error(filePlace, who, "the file's name is empty");
      }
      if (writes && file.Ok && !output.File.empty())
      {
        output.File = JoinPath(this->Options.OutputDirectory, output.File);
        const auto added = written.emplace(output.File, o.Place);
        if (!added.second)
        {
          this->Error(filePlace, who,
            Quoted(output.File) + " is already written by the output at " + added.first->second.ToText());
        }
        int view = -1;
        if (o.View.Given)
        {
          const Value name = this->Expand(o.View, top.Parameters, who);
          const Value display = this->Expand(o.Display, top.Parameters, who);
          view = this->AddInternal("DisplayTransform", o.Name.Value + ":view", who, o.Place);
          if (view >= 0)
          {
            if (name.Ok)
            {
              this->SetProperty(view, "View", name, o.View.Place, who);
            }
            if (o.Display.Given && display.Ok)
            {
              this->SetProperty(view, "Display", display, o.Display.Place, who);
            }
            this->Link(view, 0, layers.front().End, who, layers.front().Place, nullptr);
            layers.front().End.Node = view;
            layers.front().End.Array = "display";
            layers.front().End.Origin.About = who;
          }
        }
        output.Writer = this->AddInternal("ImageWriter", o.Name.Value + ":write", who, o.Place);
        if (output.Writer >= 0)
        {
          const int port = this->Result->Nodes[std::size_t(output.Writer)].Description().InputIndex("layer");
          Value path;
          path.Text = file.Text;
          if (assigned != files.end())
          {
            path.Text = assigned->second;
          }
          this->SetProperty(output.Writer, "File", path, filePlace, who);
          if (this->Options.Outside == OutsideOutputs::Moved)
          {
            output.File = this->Result->Nodes[std::size_t(output.Writer)].Stage->GetPropertyText("File");
          }
          this->SetOutputProperties(o, output.Writer, view, who);
          if (view >= 0)
          {
            this->ApplyOverrides(view);
          }
          this->ApplyOverrides(output.Writer);
          for (const Layer& l : layers)
          {
            this->Link(output.Writer, std::max(0, port), l.End, who, l.Place, l.Name);
          }
        }
      }
      this->OutputEnds.push_back({ int(this->Result->Outputs.size()), layers.front().End });
      this->Result->Outputs.push_back(output);
    }
  }

  /// <property> of an output: the writer's, or else its view's.
  void SetOutputProperties(const PipelineOutput& o, int writer, int view, const Who& who)
  {
    Instance& top = this->Instances.front();
    std::map<std::string, SourceLocation> seen;
    for (const PipelineProperty& p : o.Properties)
    {
      const Value name = this->Expand(p.Name, top.Parameters, who);
      const Value value = this->Expand(p.Value, top.Parameters, who);
      if (!name.Ok || !value.Ok || !p.Name.Given || !p.Value.Given)
      {
        continue;
      }
      std::vector<std::string> names;
      int owner = -1;
      for (int n : { writer, view })
      {
        if (n < 0)
        {
          continue;
        }
        for (const Property& known : this->Result->Nodes[std::size_t(n)].Description().Properties)
        {
          // What the output's own attributes say is not said twice.
          if (known.Name == "File" || known.Name == "View" || known.Name == "Display")
          {
            continue;
          }
          names.push_back(known.Name);
          owner = owner < 0 && known.Name == name.Text ? n : owner;
        }
      }
      if (owner < 0)
      {
        this->Error(
          p.Name.Place, who, "no property " + Quoted(name.Text), this->NearOr(name.Text, names, "properties: "));
        continue;
      }
      const auto added = seen.emplace(name.Text, p.Place);
      if (!added.second)
      {
        this->Error(
          p.Name.Place, who, "property " + Quoted(name.Text) + " is already set at " + added.first->second.ToText());
        continue;
      }
      if (!this->Overrides.count({ this->Result->Nodes[std::size_t(owner)].Path, name.Text }))
      {
        this->SetProperty(owner, name.Text, value, p.Value.Place, who);
      }
    }
  }

  /// --output NAME=FILE and NODE:ARRAY=FILE; fills Outputs with the file's and the new ones.
  std::map<std::string, std::string> AssignOutputs()
  {
    std::map<std::string, std::string> files;
    this->Outputs.assign(this->Document->Outputs.begin(), this->Document->Outputs.end());
    std::vector<std::string> names;
    for (const PipelineOutput& o : this->Document->Outputs)
    {
      names.push_back(o.Name.Value);
    }
    for (const auto& a : this->Options.Outputs)
    {
      if (files.count(a.first))
      {
        Who who;
        who.Where = "--output " + a.first;
        this->Error(OnCommandLine(), who, "is given twice: " + files[a.first] + " and " + a.second);
        continue;
      }
      if (std::find(names.begin(), names.end(), a.first) != names.end())
      {
        files[a.first] = a.second;
        continue;
      }
      if (a.first.find(':') == std::string::npos && !this->ByPath.count(a.first) &&
          !this->InstanceByPath.count(a.first))
      {
        Who who;
        who.Where = "--output " + a.first;
        this->Error(OnCommandLine(), who, "no such output",
          this->NearOr(a.first, names, "outputs: ") + "; or name an array as NODE:ARRAY");
        continue;
      }
      PipelineOutput o;
      o.Place = OnCommandLine();
      o.Name = PipelineText(a.first);
      o.From = PipelineText(a.first);
      o.Name.Place = o.From.Place = o.File.Place = OnCommandLine();
      this->Outputs.push_back(o);
      files[a.first] = a.second;
      names.push_back(a.first);
    }
    return files;
  }

  // ---- kinds ----------------------------------------------------------------------------------------------------
  struct Available
  {
    std::vector<OutputArray> Arrays;
    bool Known = true; ///< false: some mistake hides what there is
    int State = 0;     ///< 0 new, 1 being made, 2 done
  };

  /// A stage's own refusal of its settings, once a node.
  void Complain(int n, const char* text)
  {
    if (this->Complained.insert(n).second)
    {
      this->Error(this->Result->Nodes[std::size_t(n)].Place, this->Items[std::size_t(n)].About, text);
    }
  }

  void CheckSettings()
  {
    for (std::size_t n = 0; n < this->Result->Nodes.size(); ++n)
    {
      const GraphNode& node = this->Result->Nodes[n];
      if (!node.Stage || this->BadProperties.count(int(n)))
      {
        continue;
      }
      try
      {
        node.Stage->SetTimeline(this->Result->Ticks);
        node.Stage->CheckSettings();
      }
      catch (const std::exception& e)
      {
        this->Complain(int(n), e.what());
      }
    }
  }

  /// The connection that gives a node its frame; null: none.
  const GraphEdge* MainInput(int n) const
  {
    for (const GraphEdge& e : this->Result->Nodes[std::size_t(n)].Inputs)
    {
      if (e.Port == 0 && e.Connection == 0)
      {
        return &e;
      }
    }
    return nullptr;
  }

  /// Made from the source down, not by recursion: a pipeline may be a chain of thousands of nodes.
  const Available& ArraysOf(int n)
  {
    std::vector<int> chain;
    for (int at = n; at >= 0 && this->Availables[at].State == 0;)
    {
      this->Availables[at].State = 1;
      chain.push_back(at);
      const GraphEdge* input = this->MainInput(at);
      at = input ? input->Producer : -1;
    }
    for (auto at = chain.rbegin(); at != chain.rend(); ++at)
    {
      this->MakeArrays(*at);
    }
    return this->Availables[n];
  }

  void MakeArrays(int n)
  {
    Available& a = this->Availables[n];
    const GraphNode& node = this->Result->Nodes[std::size_t(n)];
    std::set<std::string> seen;
    const auto add = [&](const std::vector<OutputArray>& arrays)
    {
      for (const OutputArray& o : arrays)
      {
        if (seen.insert(o.Name).second)
        {
          a.Arrays.push_back(o);
        }
      }
    };
    add(node.Description().Outputs);
    // What it makes may hang on properties that are wrong (and told): where nothing is described nothing is known, and
    // mistakes that follow from them are not told.
    const bool bad = this->BadProperties.count(n) != 0;
    a.Known = !bad || !node.Description().Outputs.empty();
    if (a.Known)
    {
      try
      {
        node.Stage->SetTimeline(this->Result->Ticks);
        add(node.Stage->ListDynamicOutputs());
      }
      catch (const std::exception& e)
      {
        a.Known = false;
        if (!bad)
        {
          this->Complain(n, e.what());
        }
      }
    }
    const GraphEdge* input = this->MainInput(n);
    if (!input)
    {
      a.Known = a.Known && node.Description().Inputs.empty();
    }
    else if (input->Producer < 0)
    {
      a.Known = false;
    }
    else
    {
      const Available& before = this->Availables[input->Producer];
      if (this->Spend(ArrayWork * before.Arrays.size(), node.Place, this->Items[std::size_t(n)].About))
      {
        add(before.Arrays);
      }
      // Within a loop (an error of its own) nothing is known.
      a.Known = a.Known && before.Known && before.State == 2;
    }
    a.State = 2;
  }

  /// The array that a connection reads: named, or the producer's primary one. Null after a mistake (reported here).
  const OutputArray* FindArrayOf(const Endpoint& end, std::string& array, const InputPort* port = nullptr)
  {
    if (end.Node < 0)
    {
      return nullptr;
    }
    const Available& available = this->ArraysOf(end.Node);
    array = end.Array;
    if (array.empty())
    {
      const auto& outputs = this->Result->Nodes[std::size_t(end.Node)].Description().Outputs;
      array = !outputs.empty() ? outputs.front().Name : "radiance";
      bool there = false;
      for (const OutputArray& a : available.Arrays)
      {
        there = there || a.Name == array;
      }
      if (!there && !available.Arrays.empty())
      {
        array = available.Arrays.front().Name;
      }
    }
    for (const OutputArray& a : available.Arrays)
    {
      if (a.Name == array)
      {
        return &a;
      }
    }
    if (available.Known && !this->Overfull)
    {
      const bool can = port && port->Optional && this->IsReader(end.Node);
      this->Missing.push_back({ end.Origin, end.Node, array, can ? port->Name : std::string() });
    }
    return nullptr;
  }

  /// A node whose arrays hang on what is in a file.
  bool IsReader(int n) const
  {
    const StageDescription& d = this->Result->Nodes[std::size_t(n)].Description();
    return d.Inputs.empty() && d.FindProperty("File");
  }

  /// Arrays that are read and not there. A file may lack a dozen that a pipeline wants: all that it has is told once.
  void ReportMissing()
  {
    std::stable_sort(this->Missing.begin(), this->Missing.end(),
      [](const MissingArray& a, const MissingArray& b)
      {
        const SourceLocation &x = a.Origin.From->Place, &y = b.Origin.From->Place;
        return x.Line != y.Line ? x.Line < y.Line : x.Column < y.Column;
      });
    std::set<int> listed;
    for (const MissingArray& m : this->Missing)
    {
      std::vector<std::string> names;
      const std::vector<OutputArray>& arrays = this->Availables[m.Node].Arrays;
      for (std::size_t i = 0; i < arrays.size() && this->Hints(); ++i)
      {
        names.push_back(arrays[i].Name);
      }
      std::string hint = this->Near(m.Array, names);
      if (hint.empty() && this->Hints() && listed.insert(m.Node).second)
      {
        hint = "it has " + Listed(names);
      }
      if (!m.Port.empty())
      {
        hint += (hint.empty() ? "" : "; ") + std::string("with optional=\"1\" the stage does without");
      }
      this->Error(
        m.Origin.From->Place, m.Origin.About, this->NodeTitle(m.Node) + " has no output " + Quoted(m.Array), hint);
    }
  }

  bool Lacks(const Endpoint& end)
  {
    const Available& available = this->ArraysOf(end.Node);
    return available.Known && !end.Array.empty() &&
           std::none_of(available.Arrays.begin(), available.Arrays.end(),
             [&end](const OutputArray& a) { return a.Name == end.Array; });
  }

  /// A stage that knows of its connections what they are now.
  void Renew(GraphNode& node)
  {
    node.Stage = this->Registry.Create(node.Type);
    std::string error; // all of it was accepted before
    for (const GraphProperty& p : node.Properties)
    {
      node.Stage->SetPropertyText(p.Name, p.Text, error);
    }
    for (const GraphEdge& e : node.Inputs)
    {
      for (const auto& a : e.Attributes)
      {
        node.Stage->SetInputAttribute(e.Port, e.Connection, a.first, a.second, error);
      }
    }
  }

  /// Takes connections out and numbers those that stay anew.
  void Drop(const std::map<int, std::set<int>>& dropped)
  {
    for (const auto& d : dropped)
    {
      std::vector<GraphEdge>& inputs = this->Result->Nodes[std::size_t(d.first)].Inputs;
      std::vector<GraphEdge> kept;
      std::map<int, int> counts;
      for (std::size_t i = 0; i < inputs.size(); ++i)
      {
        if (!d.second.count(int(i)))
        {
          kept.push_back(inputs[i]);
          kept.back().Connection = counts[kept.back().Port]++;
        }
      }
      inputs = kept;
      this->Renew(this->Result->Nodes[std::size_t(d.first)]);
    }
  }

  std::string NodeTitle(int n) const { return "node " + Quoted(this->Result->Nodes[std::size_t(n)].Path); }

  void CheckArrays()
  {
    for (std::size_t n = 0; n < this->Result->Nodes.size(); ++n)
    {
      if (this->Result->Nodes[n].Stage)
      {
        this->ArraysOf(int(n));
      }
    }
    std::map<int, std::set<int>> dropped; // reader -> edges
    std::set<std::string> complained;     // texts that a typed template port has refused already
    const auto key = [](const SourceLocation& p) { return p.ToText(); };
    for (const TypedEnd& t : this->Typed)
    {
      // Who reads the port says what it is without: below.
      if (t.End.Optional && t.End.Node >= 0 && this->Lacks(t.End))
      {
        continue;
      }
      std::string array;
      const OutputArray* found = this->FindArrayOf(t.End, array);
      if (found && !Fits(t.Kind, *found))
      {
        this->Error(t.Place, t.From.About,
          "wants " + KindText(t.Kind, 0) + ", but " +
            Quoted(this->Result->Nodes[std::size_t(t.End.Node)].Path + ":" + array) + " is " +
            KindText(found->Kind, found->Components));
        complained.insert(key(t.End.Origin.From->Place));
      }
    }
    for (const PendingEnd& p : this->Ends)
    {
      GraphNode& node = this->Result->Nodes[std::size_t(p.Reader)];
      GraphEdge& edge = node.Inputs[std::size_t(p.Edge)];
      std::string array;
      if (p.Optional && p.End.Node >= 0 && this->Lacks(p.End))
      {
        const InputPort& port = node.Description().Inputs[std::size_t(edge.Port)];
        const std::string why = this->NodeTitle(p.End.Node) + " has no array " + Quoted(p.End.Array);
        // Of the layers of a file, the first is not optional.
        if (port.Optional || edge.Connection > 0)
        {
          node.LeftOut.push_back("input " + Quoted(port.Name) + " left out: " + why);
          this->Lacking[p.End.Node].emplace_back(p.End.Array, p.Reader);
          dropped[p.Reader].insert(p.Edge);
        }
        else
        {
          this->Error(p.From.From->Place, p.From.About, "is required, but " + why,
            "optional=\"1\" is for inputs that the stage can do without");
        }
        continue;
      }
      const OutputArray* found = this->FindArrayOf(p.End, array, &node.Description().Inputs[std::size_t(edge.Port)]);
      edge.Array = array;
      if (!found || complained.count(key(p.End.Origin.From->Place)))
      {
        continue;
      }
      const InputPort& port = node.Description().Inputs[std::size_t(edge.Port)];
      if (!Fits(port.Kind, *found))
      {
        this->Error(p.From.From->Place, p.From.About,
          "wants " + KindText(port.Kind, 0) + ", but " +
            Quoted(this->Result->Nodes[std::size_t(p.End.Node)].Path + ":" + array) + " is " +
            KindText(found->Kind, found->Components));
      }
    }
    this->Drop(dropped);
    for (const auto& o : this->OutputEnds)
    {
      GraphOutput& output = this->Result->Outputs[std::size_t(o.first)];
      if (output.Node >= 0)
      {
        Endpoint end = o.second;
        if (end.Node != output.Node) // a view lies in between
        {
          end.Node = output.Node;
          end.Array = output.Array;
        }
        std::string array;
        this->FindArrayOf(end, array);
        output.Array = array;
      }
    }
    this->ReportMissing();
  }

  /// What stages say of their connections together; where one of them is broken that would be guesswork.
  void CheckConnections()
  {
    for (std::size_t n = 0; n < this->Result->Nodes.size(); ++n)
    {
      const GraphNode& node = this->Result->Nodes[n];
      if (!node.Stage || this->Faulty.count(node.Path) || this->BadProperties.count(int(n)) ||
          std::any_of(node.Inputs.begin(), node.Inputs.end(), [](const GraphEdge& e) { return e.Producer < 0; }))
      {
        continue;
      }
      const StageDescription& d = node.Description();
      ConnectionCheck check;
      check.Ports.resize(d.Inputs.size());
      std::map<std::pair<int, int>, const GraphEdge*> edges;
      for (const GraphEdge& e : node.Inputs)
      {
        const Available& available = this->ArraysOf(e.Producer);
        ConnectionCheck::Connection connection;
        connection.Array = e.Array;
        for (const OutputArray& a : available.Arrays)
        {
          if (a.Name == e.Array)
          {
            connection.Components = a.Components > 0 ? a.Components : KindComponents(a.Kind);
            break;
          }
        }
        connection.Holds = [&available](std::vector<OutputArray>& arrays)
        {
          arrays = available.Arrays;
          return available.Known;
        };
        auto& port = check.Ports[std::size_t(e.Port)];
        port.resize(std::max(port.size(), std::size_t(e.Connection) + 1));
        port[std::size_t(e.Connection)] = connection;
        edges[{ e.Port, e.Connection }] = &e;
      }
      node.Stage->CheckConnections(check);
      for (const ConnectionCheck::Message& m : check.Messages())
      {
        Who who = this->Items[n].About;
        const auto edge = edges.find({ m.Port, m.Connection });
        if (m.Port >= 0)
        {
          who.Where += ": input " + Quoted(d.Inputs[std::size_t(m.Port)].Name);
        }
        this->Say(m.Warning ? Severity::Warning : Severity::Error,
          edge == edges.end() ? node.Place : edge->second->Place, who, m.Text, m.Hint);
      }
    }
  }

  // ---- loops and order ------------------------------------------------------------------------------------------
  /// Every loop without delay, one per strongly connected part: its shortest through its first node.
  void CheckCycles()
  {
    const std::size_t count = this->Result->Nodes.size();
    const std::vector<int> component = this->Components();
    std::set<int> done;
    for (std::size_t n = 0; n < count; ++n)
    {
      if (done.count(component[n]))
      {
        continue;
      }
      // Walk upstream from n until n is met again.
      std::vector<int> reader(count, -1);
      std::vector<const GraphEdge*> via(count, nullptr);
      std::deque<int> open{ int(n) };
      bool found = false;
      while (!open.empty() && !found)
      {
        const int at = open.front();
        open.pop_front();
        for (const GraphEdge& e : this->Result->Nodes[std::size_t(at)].Inputs)
        {
          if (e.Delayed || e.Producer < 0 || component[std::size_t(e.Producer)] != component[n])
          {
            continue;
          }
          if (e.Producer == int(n))
          {
            this->ReportCycle(int(n), at, reader, e);
            found = true;
            break;
          }
          if (reader[std::size_t(e.Producer)] < 0)
          {
            reader[std::size_t(e.Producer)] = at;
            open.push_back(e.Producer);
          }
        }
      }
      if (found)
      {
        done.insert(component[n]);
      }
    }
  }

  void ReportCycle(int first, int last, const std::vector<int>& reader, const GraphEdge& closing)
  {
    // `last` reads `first`; reader[] leads from last back to first's side: last -> ... -> first read each other.
    std::vector<std::string> names;
    for (int at = last; at != first && at >= 0; at = reader[std::size_t(at)])
    {
      names.push_back(this->Result->Nodes[std::size_t(at)].Path);
    }
    const std::string start = this->Result->Nodes[std::size_t(first)].Path;
    std::string loop = start;
    // A long loop is told by both of its ends.
    const std::size_t count = names.size(), shown = 20;
    for (std::size_t i = 0; i < count; ++i)
    {
      if (count > 2 * shown && i == shown)
      {
        loop += " <- ... (" + std::to_string(count - 2 * shown) + " more)";
        i = count - shown;
      }
      loop += " <- " + names[count - 1 - i];
    }
    loop += " <- " + start;
    Who who;
    who.Context = this->Result->Nodes[std::size_t(last)].Context;
    who.Node = start;
    this->Error(
      closing.Place, who, "cycle: " + loop, "say delay=\"1\" on the input that should read the previous frame");
  }

  /// Strongly connected components over edges without delay (Tarjan, without recursion: graphs may be long chains).
  std::vector<int> Components() const
  {
    const std::size_t count = this->Result->Nodes.size();
    std::vector<int> index(count, -1), low(count, 0), component(count, -1);
    std::vector<bool> onStack(count, false);
    std::vector<int> stack;
    int next = 0, components = 0;
    struct Frame
    {
      int Node;
      std::size_t Edge;
    };
    for (std::size_t root = 0; root < count; ++root)
    {
      if (index[root] >= 0)
      {
        continue;
      }
      std::vector<Frame> frames{ { int(root), 0 } };
      while (!frames.empty())
      {
        const std::size_t at = std::size_t(frames.back().Node);
        if (frames.back().Edge == 0 && index[at] < 0)
        {
          index[at] = low[at] = next++;
          stack.push_back(int(at));
          onStack[at] = true;
        }
        const auto& inputs = this->Result->Nodes[at].Inputs;
        if (frames.back().Edge < inputs.size())
        {
          const GraphEdge& e = inputs[frames.back().Edge++];
          if (e.Delayed || e.Producer < 0)
          {
            continue;
          }
          const std::size_t to = std::size_t(e.Producer);
          if (index[to] < 0)
          {
            frames.push_back({ e.Producer, 0 });
          }
          else if (onStack[to])
          {
            low[at] = std::min(low[at], index[to]);
          }
          continue;
        }
        frames.pop_back();
        if (!frames.empty())
        {
          const std::size_t parent = std::size_t(frames.back().Node);
          low[parent] = std::min(low[parent], low[at]);
        }
        if (low[at] == index[at])
        {
          for (;;)
          {
            const int member = stack.back();
            stack.pop_back();
            onStack[std::size_t(member)] = false;
            component[std::size_t(member)] = components;
            if (member == int(at))
            {
              break;
            }
          }
          ++components;
        }
      }
    }
    return component;
  }

  void MakeOrder()
  {
    // Components are numbered producers first, and without loops each holds one node.
    const std::vector<int> component = this->Components();
    this->Result->Order.resize(component.size());
    for (std::size_t n = 0; n < component.size(); ++n)
    {
      this->Result->Order[std::size_t(component[n])] = int(n);
    }
  }

  // ---- warnings -------------------------------------------------------------------------------------------------
  void Warn()
  {
    if (this->Messages.HasErrors())
    {
      return; // what a misspelt name was to use or feed is not known
    }
    std::set<std::string> used;
    EachTextWithin(*this->Document,
      [&used](const PipelineText& text)
      {
        const std::string& s = text.Value;
        for (std::size_t at = 0; (at = s.find("$(", at)) != std::string::npos; at += 2)
        {
          const std::size_t end = s.find(')', at);
          if (end == std::string::npos)
          {
            break;
          }
          used.insert(s.substr(at + 2, end - at - 2));
        }
      });
    for (const PipelineVariable& v : this->Document->Variables)
    {
      if (v.Name.Given && !used.count(v.Name.Value))
      {
        Who who;
        who.Where = "variable " + Quoted(v.Name.Value);
        this->Say(Severity::Warning, v.Place, who, "is never used");
      }
    }
    for (const PipelineTemplate* t : this->Unused)
    {
      // A file without nodes is a library.
      if (!this->Document->Nodes.empty())
      {
        Who who;
        who.Where = "template " + Quoted(t->Name.Value);
        this->Say(Severity::Warning, t->Place, who, "is never instantiated");
      }
    }
    for (const auto& producer : this->Lacking)
    {
      this->WarnOfLacking(producer.first, producer.second);
    }
    std::vector<int> targets;
    for (const GraphOutput& o : this->Result->Outputs)
    {
      targets.push_back(o.Node);
      targets.push_back(o.Writer);
    }
    for (std::size_t n = 0; n < this->Result->Nodes.size(); ++n)
    {
      if (this->Result->Nodes[n].Description().Sink)
      {
        targets.push_back(int(n));
      }
    }
    const std::vector<bool> needed = this->Result->Needed(targets);
    std::set<std::string> liveInstances;
    for (std::size_t n = 0; n < needed.size(); ++n)
    {
      const std::string& path = this->Result->Nodes[n].Path;
      if (needed[n])
      {
        liveInstances.insert(path.substr(0, path.find('/')));
      }
    }
    for (const PipelineNode& item : this->Document->Nodes)
    {
      for (std::size_t n = 0; n < needed.size(); ++n)
      {
        const GraphNode& node = this->Result->Nodes[n];
        if (!item.IsInstance && node.Place.Line == item.Place.Line && node.Place.Column == item.Place.Column &&
            node.Place.File == item.Place.File && !needed[n])
        {
          Who who;
          who.Where = "node " + Quoted(node.Path);
          who.Node = node.Path;
          this->Say(Severity::Warning, node.Place, who, "feeds no output and will not run");
        }
      }
      if (item.IsInstance && !liveInstances.count(item.Id.Value))
      {
        Who who;
        who.Where = "instance " + Quoted(item.Id.Value);
        this->Say(Severity::Warning, item.Place, who, "feeds no output and will not run");
      }
    }
  }

  /// One sentence for all that a producer has not: arrays that the same nodes do without stand together.
  void WarnOfLacking(int producer, const std::vector<std::pair<std::string, int>>& lacking)
  {
    if (std::size_t(producer) >= this->Result->Nodes.size())
    {
      return; // in a template that nobody instantiates
    }
    std::vector<std::pair<std::string, std::vector<std::string>>> readers; // array -> paths, as they come
    for (const auto& l : lacking)
    {
      if (std::size_t(l.second) >= this->Result->Nodes.size())
      {
        continue;
      }
      auto at = std::find_if(readers.begin(), readers.end(), [&l](const auto& r) { return r.first == l.first; });
      at = at == readers.end() ? readers.insert(at, { l.first, {} }) : at;
      const std::string& path = this->Result->Nodes[std::size_t(l.second)].Path;
      if (std::find(at->second.begin(), at->second.end(), path) == at->second.end())
      {
        at->second.push_back(path);
      }
    }
    std::string text;
    while (!readers.empty())
    {
      const std::vector<std::string> who = readers.front().second;
      std::string arrays;
      for (auto r = readers.begin(); r != readers.end();)
      {
        if (r->second == who)
        {
          arrays += (arrays.empty() ? "" : ", ") + r->first;
          r = readers.erase(r);
        }
        else
        {
          ++r;
        }
      }
      text += (text.empty() ? "has no " : "; no ") + arrays + ": " + Listed(who, 8) +
              (who.size() > 1 ? " do" : " does") + " without";
    }
    const GraphNode& node = this->Result->Nodes[std::size_t(producer)];
    Who about;
    about.Where = "node " + Quoted(node.Path) + " (" + node.Type + ")";
    about.Node = node.Path;
    about.Context = node.Context;
    if (!text.empty())
    {
      this->Say(Severity::Warning, node.Place, about, text);
    }
  }

  struct MissingArray
  {
    Reference Origin;
    int Node;
    std::string Array, Port; ///< Port: named where its stage can do without
  };
  struct TypedEnd
  {
    Endpoint End;
    ArrayKind Kind;
    Reference From;
    SourceLocation Place;
  };
  struct PendingEnd
  {
    int Reader, Edge;
    Endpoint End;
    Reference From;
    bool Optional;
  };

  std::shared_ptr<const PipelineDocument> Document;
  const StageRegistry& Registry;
  const GraphOptions& Options;
  Diagnostics& Messages;
  std::shared_ptr<Graph> Result;

  std::map<std::string, std::string> Defines;
  std::vector<const PipelineVariable*> Declared;
  std::map<std::string, const PipelineVariable*> DeclaredByName;
  std::vector<std::string> Resolving;
  Scope Globals;
  std::map<std::string, const PipelineTemplate*> Templates;
  std::set<const PipelineTemplate*> Instantiated;
  std::vector<const PipelineTemplate*> Unused;
  std::vector<std::pair<const PipelineText*, const Instance*>> Passed;
  std::deque<Instance> Instances; // the first is the top level; addresses stay
  std::map<std::string, Instance*> InstanceByPath;
  std::map<std::string, int> ByPath;
  std::map<std::string, SourceLocation> Used;
  std::vector<Source> Items; // parallel to Result->Nodes
  std::map<std::pair<std::string, std::string>, std::string> Overrides;
  std::set<int> BadProperties;
  std::set<std::string> Faulty; ///< paths that errors are about
  std::set<int> Complained;
  std::vector<TypedEnd> Typed;
  std::vector<PendingEnd> Ends;
  std::deque<PipelineOutput> Outputs;
  std::vector<std::pair<int, Endpoint>> OutputEnds;
  std::map<int, Available> Availables;
  struct PortUse
  {
    int Count = 0;
    std::size_t First = 0; ///< index into the node's Inputs
  };
  std::map<std::pair<int, int>, PortUse> Connections; // (node, port)
  bool Overfull = false;                              ///< the expansion was given up
  bool WayTooLong = false;
  std::map<int, std::vector<std::pair<std::string, int>>> Lacking; ///< producer -> (array it has not, who does without)
  std::vector<MissingArray> Missing;
  std::size_t Work = 0, HintWork = 0;
  int Moved = 0; ///< output files (OutsideOutputs::Moved)
};
}

std::shared_ptr<Graph> BuildGraph(std::shared_ptr<const PipelineDocument> document, const StageRegistry& registry,
  const GraphOptions& options, Diagnostics& diagnostics)
{
  return Builder(document, registry, options, diagnostics).Build();
}

std::shared_ptr<Graph> LoadPipeline(
  const std::string& file, const StageRegistry& registry, const GraphOptions& options, Diagnostics& diagnostics)
{
  const std::shared_ptr<PipelineDocument> document = ReadPipelineFile(file, diagnostics);
  std::shared_ptr<Graph> graph;
  // After broken XML or a newer version everything else would be guesswork.
  if (document->Place.Line > 0)
  {
    graph = BuildGraph(document, registry, options, diagnostics);
  }
  diagnostics.Sort();
  return diagnostics.HasErrors() ? nullptr : graph;
}
}
