// SPDX-License-Identifier: BSD-3-Clause
#include "quellGraphModel.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

namespace quell
{
namespace
{
std::string KindText(ArrayKind kind, int components)
{
  if (kind == ArrayKind::Any && components > 0)
  {
    return "an array of " + std::to_string(components) + (components == 1 ? " component" : " components");
  }
  return std::string(KindName(kind)) + " (" + KindDoc(kind) + ")";
}

bool IsTrue(const PipelineText& text)
{
  return text.Given && text.Value != "0" && text.Value != "false" && !text.Value.empty();
}

ArrayKind KindNamed(const std::string& name)
{
  for (int k = int(ArrayKind::Color); k <= int(ArrayKind::Any); ++k)
  {
    if (name == KindName(ArrayKind(k)))
    {
      return ArrayKind(k);
    }
  }
  return ArrayKind::Any;
}

GraphPin InputPin(const InputPort& port, bool first)
{
  GraphPin p;
  p.Name = port.Name;
  p.Kind = port.Kind;
  p.Components = KindComponents(port.Kind);
  p.Doc = port.Doc;
  p.DefaultArray = port.Array;
  p.Optional = port.Optional;
  p.Repeatable = port.Repeatable;
  p.Delayed = port.Delayed;
  p.First = first;
  return p;
}

GraphPin OutputPin(const OutputArray& a)
{
  GraphPin p;
  p.Name = a.Name;
  p.Kind = a.Kind;
  p.Components = a.Components > 0 ? a.Components : KindComponents(a.Kind);
  p.Doc = a.Doc;
  if (p.Kind == ArrayKind::Any)
  {
    if (const ArrayType* type = FindArray(a.Name))
    {
      // A passed-through array is what its name says.
      p.Kind = type->Kind;
      p.Components = type->Components;
    }
  }
  return p;
}

/// What a template's input port takes: its type where it says one, else what its readers want.
ArrayKind PortKind(const EditDocument& document, const PipelineTemplate& t, const PipelinePort& port,
  const StageRegistry& registry, int depth, bool& needed)
{
  if (port.Type.Given)
  {
    needed = true;
    return KindNamed(port.Type.Value);
  }
  ArrayKind kind = ArrayKind::Any;
  for (const PipelineNode& n : t.Nodes)
  {
    for (const PipelineInput& i : n.Inputs)
    {
      if (i.From.Value != "@" + port.Name.Value)
      {
        continue;
      }
      needed = true;
      ArrayKind wanted = ArrayKind::Any;
      if (n.IsInstance)
      {
        const PipelineTemplate* inner = document.FindTemplate(n.Type.Value);
        if (inner && depth < 8)
        {
          for (const PipelinePort& p : inner->Inputs)
          {
            bool ignored = false;
            if (p.Name.Value == i.Port.Value)
            {
              wanted = PortKind(document, *inner, p, registry, depth + 1, ignored);
            }
          }
        }
      }
      else if (const StageDescription* d = registry.Describe(n.Type.Value))
      {
        const int index = d->InputIndex(i.Port.Value);
        wanted = index >= 0 ? d->Inputs[std::size_t(index)].Kind : ArrayKind::Any;
      }
      kind = kind == ArrayKind::Any ? wanted : kind;
    }
  }
  return kind;
}

/// What stands behind "node:array" within these nodes.
OutputArray ArrayOf(const EditDocument& document, const std::vector<PipelineNode>& nodes, const std::string& from,
  const StageRegistry& registry, int depth)
{
  OutputArray result;
  std::string array;
  const std::string id = NodeOfReference(from, &array);
  for (const PipelineNode& n : nodes)
  {
    if (n.Id.Value != id || depth > 16)
    {
      continue;
    }
    if (n.IsInstance)
    {
      if (const PipelineTemplate* t = document.FindTemplate(n.Type.Value))
      {
        for (const PipelinePort& p : t->Outputs)
        {
          if (p.Name.Value == array || (array.empty() && &p == &t->Outputs.front()))
          {
            return ArrayOf(document, t->Nodes, p.From.Value, registry, depth + 1);
          }
        }
      }
      return result;
    }
    if (const StageDescription* d = registry.Describe(n.Type.Value))
    {
      if (array.empty() && !d->Outputs.empty())
      {
        return d->Outputs.front();
      }
      if (const OutputArray* found = d->FindOutput(array))
      {
        return *found;
      }
    }
  }
  result.Name = array;
  if (const ArrayType* type = FindArray(array))
  {
    result.Kind = type->Kind;
    result.Components = type->Components;
  }
  return result;
}
}

int GraphBox::FindInput(const std::string& name) const
{
  for (std::size_t i = 0; i < this->Inputs.size(); ++i)
  {
    if (this->Inputs[i].Name == name)
    {
      return int(i);
    }
  }
  return -1;
}

int GraphBox::FindOutput(const std::string& name) const
{
  for (std::size_t i = 0; i < this->Outputs.size(); ++i)
  {
    if (this->Outputs[i].Name == name)
    {
      return int(i);
    }
  }
  return -1;
}

bool KindFits(ArrayKind wanted, ArrayKind kind, int components)
{
  if (wanted == ArrayKind::Any)
  {
    return true;
  }
  if (kind == ArrayKind::Any)
  {
    return components <= 0 || components == KindComponents(wanted);
  }
  return kind == wanted;
}

int GraphModel::Find(const std::string& id) const
{
  for (std::size_t i = 0; i < this->Boxes.size(); ++i)
  {
    if (this->Boxes[i].Id == id)
    {
      return int(i);
    }
  }
  return -1;
}

GraphModel GraphModel::Build(const EditDocument& document, const std::string& scope, const StageRegistry& registry,
  const std::map<std::string, std::vector<OutputArray>>* arrays)
{
  GraphModel m;
  const PipelineTemplate* t = scope.empty() ? nullptr : document.FindTemplate(scope);
  if (t)
  {
    GraphBox box;
    box.Id = "@";
    box.Title = "inputs";
    box.Kind = BoxKind::TemplateInputs;
    box.Doc = t->Doc.Value;
    for (const PipelinePort& port : t->Inputs)
    {
      bool needed = false;
      GraphPin p;
      p.Name = port.Name.Value;
      p.Kind = PortKind(document, *t, port, registry, 0, needed);
      p.Components = KindComponents(p.Kind);
      p.Doc = port.Doc.Value;
      box.Outputs.push_back(p);
    }
    m.Boxes.push_back(box);
  }
  for (const PipelineNode& n : document.Nodes(scope))
  {
    GraphBox box;
    box.Id = box.Title = n.Id.Value;
    box.Type = n.Type.Value;
    box.Doc = n.Doc.Value;
    if (n.IsInstance)
    {
      box.Kind = BoxKind::Instance;
      const PipelineTemplate* inner = document.FindTemplate(n.Type.Value);
      box.Known = inner != nullptr;
      if (inner)
      {
        box.Doc = n.Doc.Given ? n.Doc.Value : inner->Doc.Value;
        for (const PipelinePort& port : inner->Inputs)
        {
          GraphPin p;
          p.Name = port.Name.Value;
          bool needed = false;
          p.Kind = PortKind(document, *inner, port, registry, 0, needed);
          p.Components = KindComponents(p.Kind);
          p.Doc = port.Doc.Value;
          p.Optional = !needed;
          box.Inputs.push_back(p);
        }
        for (const PipelinePort& port : inner->Outputs)
        {
          OutputArray a = ArrayOf(document, inner->Nodes, port.From.Value, registry, 0);
          a.Name = port.Name.Value;
          GraphPin p = OutputPin(a);
          p.Doc = port.Doc.Value;
          box.Outputs.push_back(p);
        }
      }
    }
    else
    {
      box.Description = registry.Describe(n.Type.Value);
      box.Known = box.Description != nullptr;
      if (box.Description)
      {
        for (std::size_t i = 0; i < box.Description->Inputs.size(); ++i)
        {
          box.Inputs.push_back(InputPin(box.Description->Inputs[i], i == 0));
        }
        for (const OutputArray& a : box.Description->Outputs)
        {
          box.Outputs.push_back(OutputPin(a));
        }
        // Layers that only the file knows.
        const auto known = arrays && scope.empty() ? arrays->find(n.Id.Value) : decltype(arrays->find("")){};
        if (arrays && scope.empty() && known != arrays->end() && box.Description->Inputs.empty())
        {
          for (const OutputArray& a : known->second)
          {
            if (box.FindOutput(a.Name) < 0 && a.Name.compare(0, 6, "bounce") != 0)
            {
              box.Outputs.push_back(OutputPin(a));
            }
          }
        }
      }
    }
    m.Boxes.push_back(box);
  }
  if (scope.empty())
  {
    for (const PipelineOutput& o : document.Get()->Outputs)
    {
      GraphBox box;
      box.Id = "output:" + o.Name.Value;
      box.Title = o.Name.Value;
      box.Type = o.File.Value;
      box.Doc = o.Doc.Value;
      box.Kind = BoxKind::Output;
      GraphPin p;
      p.Name = "image";
      p.Doc = "what is written";
      p.First = true;
      box.Inputs.push_back(p);
      GraphPin layer;
      layer.Name = "layer";
      layer.Doc = "a further layer of the same EXR";
      layer.Optional = layer.Repeatable = true;
      box.Inputs.push_back(layer);
      m.Boxes.push_back(box);
    }
  }
  if (t)
  {
    for (const PipelinePort& port : t->Outputs)
    {
      GraphBox box;
      box.Id = "port:" + port.Name.Value;
      box.Title = port.Name.Value;
      box.Kind = BoxKind::TemplateOutput;
      box.Doc = port.Doc.Value;
      GraphPin p;
      p.Name = "from";
      p.First = true;
      box.Inputs.push_back(p);
      m.Boxes.push_back(box);
    }
  }

  const auto link = [&](int to, const std::string& port, const PipelineText& from, bool delayed, int index)
  {
    GraphLink l;
    l.To = to;
    l.ToPin = m.Boxes[std::size_t(to)].FindInput(port);
    l.Index = index;
    l.Delayed = delayed;
    l.Text = from.Value;
    if (!from.Given || from.Value.empty())
    {
      return;
    }
    std::string array;
    if (from.Value[0] == '@')
    {
      l.From = m.Find("@");
      array = from.Value.substr(1);
    }
    else
    {
      l.From = m.Find(NodeOfReference(from.Value, &array));
    }
    if (l.From >= 0)
    {
      GraphBox& producer = m.Boxes[std::size_t(l.From)];
      l.FromPin = array.empty() && !producer.Outputs.empty() ? 0 : producer.FindOutput(array);
      if (l.FromPin < 0 && producer.Known && !array.empty() && producer.Kind != BoxKind::TemplateInputs)
      {
        // Passed through, or a layer that is not known yet.
        OutputArray a;
        a.Name = array;
        a.Doc = "passed through";
        producer.Outputs.push_back(OutputPin(a));
        l.FromPin = int(producer.Outputs.size()) - 1;
      }
      if (l.FromPin >= 0)
      {
        ++producer.Outputs[std::size_t(l.FromPin)].Links;
      }
    }
    if (l.ToPin >= 0)
    {
      ++m.Boxes[std::size_t(to)].Inputs[std::size_t(l.ToPin)].Links;
    }
    m.Links.push_back(l);
  };
  for (const PipelineNode& n : document.Nodes(scope))
  {
    const int to = m.Find(n.Id.Value);
    for (std::size_t i = 0; i < n.Inputs.size(); ++i)
    {
      link(to, n.Inputs[i].Port.Value, n.Inputs[i].From, IsTrue(n.Inputs[i].Delay), int(i));
    }
  }
  if (scope.empty())
  {
    for (const PipelineOutput& o : document.Get()->Outputs)
    {
      const int to = m.Find("output:" + o.Name.Value);
      link(to, "image", o.From, false, 0);
      for (std::size_t i = 0; i < o.Layers.size(); ++i)
      {
        link(to, "layer", o.Layers[i].From, false, int(i) + 1);
      }
    }
  }
  if (t)
  {
    for (const PipelinePort& port : t->Outputs)
    {
      link(m.Find("port:" + port.Name.Value), "from", port.From, false, 0);
    }
  }
  return m;
}

std::string GraphModel::Reference(int box, int pin) const
{
  const GraphBox& b = this->Boxes[std::size_t(box)];
  if (pin < 0 || pin >= int(b.Outputs.size()))
  {
    return b.Id;
  }
  const std::string& array = b.Outputs[std::size_t(pin)].Name;
  return b.Kind == BoxKind::TemplateInputs ? "@" + array : b.Id + ":" + array;
}

bool GraphModel::LeadsTo(int a, int b) const
{
  std::vector<int> open{ a };
  std::set<int> seen;
  while (!open.empty())
  {
    const int n = open.back();
    open.pop_back();
    if (n == b)
    {
      return true;
    }
    if (!seen.insert(n).second)
    {
      continue;
    }
    for (const GraphLink& l : this->Links)
    {
      if (l.From == n && !l.Delayed)
      {
        open.push_back(l.To);
      }
    }
  }
  return false;
}

LinkVerdict GraphModel::Judge(int from, int fromPin, int to, int toPin) const
{
  LinkVerdict v;
  if (from < 0 || to < 0 || from >= int(this->Boxes.size()) || to >= int(this->Boxes.size()))
  {
    v.Reason = "there is nothing to connect";
    return v;
  }
  const GraphBox &a = this->Boxes[std::size_t(from)], &b = this->Boxes[std::size_t(to)];
  if (fromPin < 0 || fromPin >= int(a.Outputs.size()))
  {
    v.Reason = a.Title + " has no such output";
    return v;
  }
  if (toPin < 0 || toPin >= int(b.Inputs.size()))
  {
    v.Reason = b.Title + " has no such input";
    return v;
  }
  const GraphPin &out = a.Outputs[std::size_t(fromPin)], &in = b.Inputs[std::size_t(toPin)];
  if (!KindFits(in.Kind, out.Kind, out.Components))
  {
    v.Reason = out.Name + " is " + KindText(out.Kind, out.Components) + "; " + in.Name + " takes " +
               KindText(in.Kind, in.Components);
    return v;
  }
  if (in.Links > 0)
  {
    for (const GraphLink& l : this->Links)
    {
      if (l.To == to && l.ToPin == toPin && l.From == from && l.FromPin == fromPin)
      {
        v.Reason = in.Name + " reads this already";
        return v;
      }
    }
    v.Replaces = !in.Repeatable;
  }
  // A way back to the producer closes a loop, and a loop needs a frame in between.
  const bool loop = from == to || this->LeadsTo(to, from);
  if (loop && in.First)
  {
    v.Reason =
      "this closes a loop, and " + in.Name + ", the first input, cannot read the previous frame; use another input";
    return v;
  }
  if (loop && b.Kind == BoxKind::Instance)
  {
    v.Delay = true;
    v.Ok = true;
    v.Reason = "closes a loop: reads the previous frame";
    return v;
  }
  if (loop && in.Repeatable)
  {
    v.Reason =
      "this closes a loop, and " + in.Name + " takes several connections, which cannot read the previous frame";
    return v;
  }
  v.Ok = true;
  v.Delay = loop || in.Delayed;
  if (v.Delay)
  {
    v.Reason = loop ? "closes a loop: reads the previous frame" : "reads the previous frame";
  }
  else if (v.Replaces)
  {
    v.Reason = "replaces what " + in.Name + " reads now";
  }
  return v;
}

int GraphModel::BestInput(const StageDescription& type, const std::string& array, ArrayKind kind, int components)
{
  int best = -1, score = 0;
  for (std::size_t i = 0; i < type.Inputs.size(); ++i)
  {
    const InputPort& p = type.Inputs[i];
    if (!KindFits(p.Kind, kind, components))
    {
      continue;
    }
    const int s = 1 + (p.Name == array ? 8 : 0) + (p.Array == array ? 4 : 0) + (i == 0 ? 3 : 0) +
                  (p.Kind != ArrayKind::Any ? 1 : 0) - (p.Delayed ? 1 : 0);
    if (s > score)
    {
      best = int(i);
      score = s;
    }
  }
  return best;
}

bool GraphModel::FitsOnLink(
  const StageDescription& type, const GraphLink& link, int& inPort, std::string& outArray, std::string& reason) const
{
  if (link.From < 0 || link.FromPin < 0 || link.ToPin < 0)
  {
    reason = "the link is broken";
    return false;
  }
  const GraphPin& out = this->Boxes[std::size_t(link.From)].Outputs[std::size_t(link.FromPin)];
  const GraphPin& in = this->Boxes[std::size_t(link.To)].Inputs[std::size_t(link.ToPin)];
  // What comes out is what the reader had: its first input must carry the link.
  if (type.Inputs.empty())
  {
    reason = type.Type + " has no input";
    return false;
  }
  if (!KindFits(type.Inputs.front().Kind, out.Kind, out.Components))
  {
    reason = type.Inputs.front().Name + " of " + type.Type + " takes " + KindText(type.Inputs.front().Kind, 0) + ", " +
             out.Name + " is " + KindText(out.Kind, out.Components);
    return false;
  }
  inPort = 0;
  // The output of the same name, else the first that fits the reader.
  for (int pass = 0; pass < 2; ++pass)
  {
    for (const OutputArray& a : type.Outputs)
    {
      if (KindFits(in.Kind, a.Kind, a.Components) && (pass == 1 || a.Name == out.Name))
      {
        outArray = a.Name;
        return true;
      }
    }
  }
  reason = type.Type + " makes nothing that " + in.Name + " takes: " + KindText(in.Kind, in.Components);
  return false;
}

std::vector<std::pair<double, double>> ArrangeGraph(const GraphModel& model, const std::vector<BoxSize>& sizes)
{
  const std::size_t n = model.Boxes.size();
  const double gapX = 70, gapY = 26;
  std::vector<std::vector<int>> readers(n), producers(n);
  for (const GraphLink& l : model.Links)
  {
    // What comes from the previous frame does not order anything.
    if (l.From >= 0 && l.To >= 0 && l.From != l.To && !l.Delayed)
    {
      readers[std::size_t(l.From)].push_back(l.To);
      producers[std::size_t(l.To)].push_back(l.From);
    }
  }
  // Layers: the longest way from a source. A loop (a mistake of the document) ends it.
  std::vector<int> layer(n, 0);
  for (std::size_t round = 0, changed = 1; changed && round <= n; ++round)
  {
    changed = 0;
    for (std::size_t b = 0; b < n; ++b)
    {
      for (int p : producers[b])
      {
        if (layer[b] < layer[std::size_t(p)] + 1 && layer[std::size_t(p)] < int(n))
        {
          layer[b] = layer[std::size_t(p)] + 1;
          changed = 1;
        }
      }
    }
  }
  // A source stands just before its first reader.
  for (std::size_t b = 0; b < n; ++b)
  {
    if (producers[b].empty() && !readers[b].empty())
    {
      int first = int(n);
      for (int r : readers[b])
      {
        first = std::min(first, layer[std::size_t(r)]);
      }
      layer[b] = std::max(0, first - 1);
    }
  }
  std::vector<int> used(layer);
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  std::vector<std::vector<int>> columns(used.size());
  for (std::size_t b = 0; b < n; ++b)
  {
    layer[b] = int(std::lower_bound(used.begin(), used.end(), layer[b]) - used.begin());
    columns[std::size_t(layer[b])].push_back(int(b));
  }
  // Order within a column by the middle of the neighbours, back and forth.
  std::vector<double> place(n, 0);
  for (std::vector<int>& column : columns)
  {
    for (std::size_t i = 0; i < column.size(); ++i)
    {
      place[std::size_t(column[i])] = double(i);
    }
  }
  for (int sweep = 0; sweep < 8; ++sweep)
  {
    const bool forth = sweep % 2 == 0;
    for (std::size_t c = 0; c < columns.size(); ++c)
    {
      std::vector<int>& column = columns[forth ? c : columns.size() - 1 - c];
      std::vector<std::pair<double, int>> order;
      for (int b : column)
      {
        const std::vector<int>& near = forth ? producers[std::size_t(b)] : readers[std::size_t(b)];
        double sum = 0;
        for (int o : near)
        {
          sum += place[std::size_t(o)];
        }
        order.emplace_back(near.empty() ? place[std::size_t(b)] : sum / double(near.size()), b);
      }
      std::stable_sort(order.begin(), order.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
      for (std::size_t i = 0; i < order.size(); ++i)
      {
        column[i] = order[i].second;
        place[std::size_t(order[i].second)] = double(i);
      }
    }
  }
  std::vector<std::pair<double, double>> at(n);
  double x = 0;
  for (const std::vector<int>& column : columns)
  {
    double width = 0, height = -gapY;
    for (int b : column)
    {
      width = std::max(width, sizes[std::size_t(b)].Width);
      height += sizes[std::size_t(b)].Height + gapY;
    }
    double y = -height / 2;
    for (int b : column)
    {
      at[std::size_t(b)] = { x, y };
      y += sizes[std::size_t(b)].Height + gapY;
    }
    x += width + gapX;
  }
  // Boxes go to the height of their neighbours where there is room.
  for (int sweep = 0; sweep < 6; ++sweep)
  {
    for (std::vector<int>& column : columns)
    {
      double lowest = -1e18;
      std::vector<double> wanted;
      for (int b : column)
      {
        double sum = 0;
        int count = 0;
        for (const std::vector<int>* near : { &producers[std::size_t(b)], &readers[std::size_t(b)] })
        {
          for (int o : *near)
          {
            sum += at[std::size_t(o)].second + sizes[std::size_t(o)].Height / 2;
            ++count;
          }
        }
        wanted.push_back(count ? sum / count - sizes[std::size_t(b)].Height / 2 : at[std::size_t(b)].second);
      }
      for (std::size_t i = 0; i < column.size(); ++i)
      {
        const std::size_t b = std::size_t(column[i]);
        double y = std::max(lowest, wanted[i]);
        // Room for those below that want to be higher.
        double below = 0, shift = 0;
        int count = 0;
        for (std::size_t j = i; j < column.size(); ++j)
        {
          const double overlap = y + below - wanted[j];
          if (overlap <= 0 && j > i)
          {
            break;
          }
          shift += overlap;
          ++count;
          below += sizes[std::size_t(column[j])].Height + gapY;
        }
        y = std::max(lowest, y - (count > 1 ? shift / count : 0));
        at[b].second = y;
        lowest = y + sizes[b].Height + gapY;
      }
    }
  }
  double left = 0, top = 0;
  for (std::size_t b = 0; b < n; ++b)
  {
    left = b == 0 ? at[b].first : std::min(left, at[b].first);
    top = b == 0 ? at[b].second : std::min(top, at[b].second);
  }
  for (auto& p : at)
  {
    p.first = std::floor(p.first - left + 40);
    p.second = std::floor(p.second - top + 40);
  }
  return at;
}

ViewTarget ResolveTarget(const PipelineDocument& document, const ViewTarget& target)
{
  const std::function<const PipelineTemplate*(const PipelineDocument&, const std::string&)> find =
    [&find](const PipelineDocument& d, const std::string& name) -> const PipelineTemplate*
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
      if (const PipelineTemplate* t = i.Content ? find(*i.Content, name) : nullptr)
      {
        return t;
      }
    }
    return nullptr;
  };
  ViewTarget at = target;
  std::string prefix;
  const std::vector<PipelineNode>* nodes = &document.Nodes;
  // Walk into "indirect/atrous" first.
  std::string rest = at.Node;
  for (int depth = 0; depth < 32; ++depth)
  {
    const std::string id = TopOf(rest);
    const PipelineNode* node = nullptr;
    for (const PipelineNode& n : *nodes)
    {
      node = n.Id.Value == id ? &n : node;
    }
    if (!node || !node->IsInstance)
    {
      return at;
    }
    const PipelineTemplate* t = find(document, node->Type.Value);
    if (!t)
    {
      return at;
    }
    prefix += id + "/";
    nodes = &t->Nodes;
    if (rest.size() > id.size())
    {
      rest = rest.substr(id.size() + 1);
      continue;
    }
    const PipelinePort* port = nullptr;
    for (const PipelinePort& p : t->Outputs)
    {
      port = p.Name.Value == at.Array || (at.Array.empty() && !port) ? &p : port;
    }
    if (!port)
    {
      return at;
    }
    std::string array;
    rest = NodeOfReference(port->From.Value, &array);
    if (rest.empty())
    {
      return target;
    }
    at.Node = prefix + rest;
    at.Array = array;
  }
  return at;
}
}
