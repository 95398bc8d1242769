// SPDX-License-Identifier: BSD-3-Clause
// The graph editor.
#include "quellUi.h"
#include "quellPipelineReader.h"
#include "quellViewer.h"

#include <imgui_internal.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace quell
{
namespace
{
const float BoxWidth = 176, HeaderHeight = 25, RowHeight = 18, FootHeight = 7, PinRadius = 4.5f;

/// To add rectangles to.
const ImRect Nowhere(1e9f, 1e9f, -1e9f, -1e9f);
ImRect RectOf(const ImVec2& position, const ImVec2& size)
{
  return ImRect(position.x, position.y, position.x + size.x, position.y + size.y);
}

/// A point of a link's way and whether it goes on to the right (1) or to the left (-1) there.
struct WayPoint
{
  ImVec2 At;
  float Direction = 1;
};

/// A smooth line through the points, level in each of them.
std::vector<ImVec2> Smooth(const std::vector<WayPoint>& way, float least, float z)
{
  std::vector<ImVec2> line;
  for (std::size_t i = 0; i + 1 < way.size(); ++i)
  {
    const WayPoint &p = way[i], &q = way[i + 1];
    const float dx = std::fabs(q.At.x - p.At.x), dy = std::fabs(q.At.y - p.At.y);
    const float reach = p.Direction != q.Direction ? std::max(12 * z, std::min(60 * z, dy * 0.6f))
                                                   : std::max(least, std::min(190 * z, dx * 0.5f));
    const ImVec2 c1(p.At.x + p.Direction * reach, p.At.y), c2(q.At.x - q.Direction * reach, q.At.y);
    const int steps = 20;
    for (int k = line.empty() ? 0 : 1; k <= steps; ++k)
    {
      line.push_back(ImBezierCubicCalc(p.At, c1, c2, q.At, float(k) / steps));
    }
  }
  return line;
}

float DistanceToLine(const std::vector<ImVec2>& line, const ImVec2& p)
{
  float best = 1e9f;
  for (std::size_t i = 0; i + 1 < line.size(); ++i)
  {
    const ImVec2 near = ImLineClosestPoint(line[i], line[i + 1], p);
    best = std::min(best, std::hypot(near.x - p.x, near.y - p.y));
  }
  return best;
}

/// Subsequence match with a score; 0: none.
int MatchScore(const std::string& text, const std::string& search)
{
  if (search.empty())
  {
    return 1;
  }
  const auto lower = [](const std::string& s)
  {
    std::string l = s;
    std::transform(l.begin(), l.end(), l.begin(), [](unsigned char c) { return char(std::tolower(c)); });
    return l;
  };
  const std::string t = lower(text), s = lower(search);
  const std::size_t at = t.find(s);
  if (at != std::string::npos)
  {
    return at == 0 ? 100 : 60;
  }
  std::size_t i = 0;
  for (char c : t)
  {
    i += i < s.size() && s[i] == c ? 1 : 0;
  }
  return i == s.size() && s.size() >= 2 ? 20 : 0;
}
}

ImVec2 Viewer::ToScreen(const ImVec2& g) const
{
  const float z = this->GraphZoom * float(this->Scale);
  return ImVec2(this->GraphMin.x + (g.x + this->GraphOffset.x) * z, this->GraphMin.y + (g.y + this->GraphOffset.y) * z);
}

ImVec2 Viewer::ToGraph(const ImVec2& s) const
{
  const float z = this->GraphZoom * float(this->Scale);
  return ImVec2((s.x - this->GraphMin.x) / z - this->GraphOffset.x, (s.y - this->GraphMin.y) / z - this->GraphOffset.y);
}

ImVec2 Viewer::PinPosition(int box, int pin, bool output) const
{
  const BoxLayout& l = this->Boxes[std::size_t(box)];
  float row = 0;
  if (output)
  {
    const auto at = std::find(l.ShownOutputs.begin(), l.ShownOutputs.end(), pin);
    row = at == l.ShownOutputs.end() ? float(l.ShownOutputs.size()) : float(at - l.ShownOutputs.begin());
  }
  else
  {
    row = float(std::max(0, pin));
  }
  return ImVec2(l.Position.x + (output ? l.Size.x : 0), l.Position.y + HeaderHeight + (row + 0.5f) * RowHeight + 2);
}

void Viewer::RefreshGraph()
{
  const std::uint64_t arraysOf = this->LastGood ? this->LastGood->Number : 0;
  if (this->ModelOf != this->Doc.Revision() || this->ModelScope != this->Scope ||
      (this->ModelArraysOf != arraysOf && this->Dragging.Kind == Drag::What::None))
  {
    this->Model =
      GraphModel::Build(this->Doc, this->Scope, this->Registry, this->LastGood ? &this->LastGood->Arrays : nullptr);
    if (this->ModelScope != this->Scope)
    {
      this->GraphWantsFit = true;
    }
    this->ModelOf = this->Doc.Revision();
    this->ModelArraysOf = arraysOf;
    this->ModelScope = this->Scope;
    std::set<std::string> still;
    for (const GraphBox& b : this->Model.Boxes)
    {
      if (this->Selected.count(b.Id))
      {
        still.insert(b.Id);
      }
    }
    this->Selected = still;
    this->HoveredLink = -1;
    this->Dragging.TakenLink = -1;
  }
  const std::vector<BoxLayout> before = this->Boxes;
  this->Boxes.resize(this->Model.Boxes.size());
  for (std::size_t i = 0; i < this->Model.Boxes.size(); ++i)
  {
    const GraphBox& b = this->Model.Boxes[i];
    BoxLayout& l = this->Boxes[i];
    l.ShownOutputs.clear();
    const bool all = this->Expanded.count(PositionKey(this->Scope, b.Id)) != 0 || b.Outputs.size() <= 3 ||
                     b.Kind == BoxKind::TemplateInputs;
    for (std::size_t o = 0; o < b.Outputs.size(); ++o)
    {
      if (all || o == 0 || b.Outputs[o].Links > 0 ||
          (this->Scope.empty() && this->A.Node == b.Id && this->A.Array == b.Outputs[o].Name))
      {
        l.ShownOutputs.push_back(int(o));
      }
    }
    const std::size_t more =
      l.ShownOutputs.size() < b.Outputs.size() || (all && b.Outputs.size() > 3 && b.Kind != BoxKind::TemplateInputs)
        ? 1
        : 0;
    const std::size_t rows = std::max(b.Inputs.size(), l.ShownOutputs.size() + more);
    l.Size = ImVec2(BoxWidth, HeaderHeight + float(rows) * RowHeight + FootHeight + 2);
  }
  this->PlaceNewBoxes();
}

void Viewer::PlaceNewBoxes()
{
  const PipelinePositions& known = this->Doc.Positions();
  std::vector<BoxSize> sizes;
  bool any = false, missing = false;
  for (std::size_t i = 0; i < this->Boxes.size(); ++i)
  {
    sizes.push_back({ double(this->Boxes[i].Size.x), double(this->Boxes[i].Size.y) });
    const auto at = known.find(PositionKey(this->Scope, this->Model.Boxes[i].Id));
    if (at != known.end())
    {
      this->Boxes[i].Position = ImVec2(float(at->second.first), float(at->second.second));
      any = true;
    }
    else
    {
      missing = true;
    }
  }
  if (!missing)
  {
    return;
  }
  // What has no place of its own is where it is drawn now, as soon as other boxes come or go.
  const auto shown = [&]
  {
    PipelinePositions places;
    for (std::size_t i = 0; i < this->Boxes.size(); ++i)
    {
      places[PositionKey(this->Scope, this->Model.Boxes[i].Id)] = { double(this->Boxes[i].Position.x),
        double(this->Boxes[i].Position.y) };
    }
    this->Doc.SetShownPlaces(places);
  };
  if (!any)
  {
    // Arranged once; boxes stay where they are when one of them grows.
    std::string key = this->Scope;
    for (const GraphBox& b : this->Model.Boxes)
    {
      key += " " + b.Id;
    }
    if (key != this->ArrangedKey)
    {
      this->Arranged = ArrangeGraph(this->Model, sizes);
      this->ArrangedKey = key;
    }
    for (std::size_t i = 0; i < this->Boxes.size(); ++i)
    {
      this->Boxes[i].Position = ImVec2(float(this->Arranged[i].first), float(this->Arranged[i].second));
    }
    shown();
    return;
  }
  // Some have a place: the others go right of what they read, below what is there.
  for (std::size_t i = 0; i < this->Boxes.size(); ++i)
  {
    if (known.count(PositionKey(this->Scope, this->Model.Boxes[i].Id)))
    {
      continue;
    }
    ImVec2 at(40, 40);
    for (const GraphLink& l : this->Model.Links)
    {
      if (l.To == int(i) && l.From >= 0 && l.From != int(i))
      {
        const BoxLayout& from = this->Boxes[std::size_t(l.From)];
        at = ImVec2(std::max(at.x, from.Position.x + from.Size.x + 60), from.Position.y);
      }
    }
    bool moved = true;
    for (int round = 0; moved && round < 50; ++round)
    {
      moved = false;
      for (std::size_t j = 0; j < this->Boxes.size(); ++j)
      {
        const BoxLayout& o = this->Boxes[j];
        if (j != i && (j < i || known.count(PositionKey(this->Scope, this->Model.Boxes[j].Id))) &&
            at.x < o.Position.x + o.Size.x + 10 && at.x + this->Boxes[i].Size.x + 10 > o.Position.x &&
            at.y < o.Position.y + o.Size.y + 10 && at.y + this->Boxes[i].Size.y + 10 > o.Position.y)
        {
          at.y = o.Position.y + o.Size.y + 20;
          moved = true;
        }
      }
    }
    this->Boxes[i].Position = at;
  }
  shown();
}

void Viewer::Reveal(const std::set<std::string>& boxes)
{
  this->Selected = boxes;
  this->Revealed = boxes;
}

/// Moves the graph so far that what came is seen, beside the list of mistakes that may come with it.
void Viewer::KeepInView()
{
  if (this->Revealed.empty())
  {
    return;
  }
  ImRect around = Nowhere;
  for (std::size_t i = 0; i < this->Boxes.size(); ++i)
  {
    if (this->Revealed.count(this->Model.Boxes[i].Id))
    {
      around.Add(RectOf(this->Boxes[i].Position, this->Boxes[i].Size));
    }
  }
  const ImVec2 a = around.Min, b = around.Max;
  const ImVec2 p = this->ToScreen(a), q = this->ToScreen(b);
  const float edge = this->S(12), z = this->GraphZoom * float(this->Scale);
  const ImVec2 low(this->GraphMin.x + edge, this->GraphMin.y + this->S(38)),
    high(this->GraphMax.x - edge, this->GraphMax.y - edge);
  if (q.x - p.x > high.x - low.x || q.y - p.y > high.y - low.y)
  {
    if (p.x < low.x || q.x > high.x || p.y < low.y || q.y > high.y)
    {
      this->FitGraph();
    }
  }
  else
  {
    this->GraphOffset.x += (std::max(0.f, low.x - p.x) - std::max(0.f, q.x - high.x)) / z;
    this->GraphOffset.y += (std::max(0.f, low.y - p.y) - std::max(0.f, q.y - high.y)) / z;
  }
  // The check of what was added may still bring the list of mistakes.
  if (b.x < a.x || (this->Checked && this->Checked->Document == this->Doc.Get()))
  {
    this->Revealed.clear();
  }
}

void Viewer::FitGraph()
{
  if (this->Boxes.empty())
  {
    this->GraphZoom = 1;
    this->GraphOffset = ImVec2(0, 0);
    return;
  }
  ImRect around = Nowhere;
  for (const BoxLayout& l : this->Boxes)
  {
    around.Add(RectOf(l.Position, l.Size));
  }
  const ImVec2 a = around.Min, b = around.Max;
  const float w = (this->GraphMax.x - this->GraphMin.x) / float(this->Scale) - 50,
              h = (this->GraphMax.y - this->GraphMin.y) / float(this->Scale) - 60;
  this->GraphZoom = std::min(1.f, std::max(0.25f, std::min(w / (b.x - a.x), h / (b.y - a.y))));
  const float z = this->GraphZoom;
  this->GraphOffset = ImVec2((w + 50) / z / 2 - (a.x + b.x) / 2, (h + 76) / z / 2 - (a.y + b.y) / 2);
}

void Viewer::ArrangeAll()
{
  std::vector<BoxSize> sizes;
  for (const BoxLayout& l : this->Boxes)
  {
    sizes.push_back({ double(l.Size.x), double(l.Size.y) });
  }
  const auto places = ArrangeGraph(this->Model, sizes);
  std::vector<std::pair<std::string, std::pair<double, double>>> to;
  for (std::size_t i = 0; i < places.size(); ++i)
  {
    to.emplace_back(this->Model.Boxes[i].Id, places[i]);
  }
  this->Doc.Arrange(this->Scope, to);
  this->GraphWantsFit = true;
}

void Viewer::EnterScope(const std::string& scope)
{
  if (scope != this->Scope)
  {
    this->Scope = scope;
    this->Selected.clear();
    this->RefreshGraph();
  }
}

void Viewer::BeginRename(const std::string& box)
{
  this->Renaming = box;
  if (box == "@")
  {
    this->Renaming.clear();
    return;
  }
  this->RenameText = box.compare(0, 7, "output:") == 0 ? box.substr(7)
                     : box.compare(0, 5, "port:") == 0 ? box.substr(5)
                                                       : box;
  this->RenameFocus = true;
}

void Viewer::CopySelection(bool cut)
{
  const std::vector<std::string> boxes(this->Selected.begin(), this->Selected.end());
  std::size_t count = 0;
  const std::string xml = this->Doc.CopyXml(this->Scope, boxes, &count);
  if (xml.empty())
  {
    return;
  }
  this->Clipboard = xml;
  ImGui::SetClipboardText(xml.c_str());
  if (cut)
  {
    this->Doc.Remove(this->Scope, boxes);
  }
  else
  {
    this->Tell("copied " + std::to_string(count) + (count == 1 ? " node" : " nodes") + " as XML" +
               (count < boxes.size() ? ", without the template's ports" : ""));
  }
}

void Viewer::Paste()
{
  const char* text = ImGui::GetClipboardText();
  const std::string xml = text && *text ? text : this->Clipboard;
  if (xml.empty())
  {
    return;
  }
  const ImVec2 mouse = ImGui::GetIO().MousePos;
  const bool inside = mouse.x > this->GraphMin.x && mouse.x < this->GraphMax.x && mouse.y > this->GraphMin.y &&
                      mouse.y < this->GraphMax.y;
  const ImVec2 at = this->ToGraph(
    inside ? mouse : ImVec2((this->GraphMin.x + this->GraphMax.x) / 2, (this->GraphMin.y + this->GraphMax.y) / 2));
  std::string error;
  const std::vector<std::string> made = this->Doc.PasteXml(this->Scope, xml, double(at.x), double(at.y), error);
  if (made.empty())
  {
    this->Tell(error, true);
  }
  else
  {
    this->Reveal(std::set<std::string>(made.begin(), made.end()));
    this->ShowWelcome = false;
  }
}

void Viewer::DeleteSelection(bool reconnect)
{
  if (!this->Selected.empty())
  {
    for (const std::string& box : std::set<std::string>(this->Selected))
    {
      if (box.compare(0, 5, "port:") == 0)
      {
        this->Doc.RemoveTemplatePort(this->Scope, box.substr(5));
      }
    }
    std::string unread;
    this->Doc.Remove(
      this->Scope, std::vector<std::string>(this->Selected.begin(), this->Selected.end()), reconnect, &unread);
    this->Selected.clear();
    if (!unread.empty())
    {
      this->Tell(unread, true);
    }
  }
}

void Viewer::DuplicateSelection()
{
  if (!this->Selected.empty())
  {
    const std::vector<std::string> made =
      this->Doc.Duplicate(this->Scope, std::vector<std::string>(this->Selected.begin(), this->Selected.end()), 40, 40);
    if (!made.empty())
    {
      this->Reveal(std::set<std::string>(made.begin(), made.end()));
    }
  }
}

// ---- the palette ----------------------------------------------------------------------------------------------------
/// Of a link that was dropped on nothing: a template has a port for it.
bool Viewer::TemplateFits(const PipelineTemplate& t) const
{
  const GraphBox& b = this->Model.Boxes[std::size_t(this->PaletteLinkBox)];
  const bool out = this->PaletteLinkOutput;
  const std::size_t pin = std::size_t(this->PaletteLinkPin);
  if (pin >= (out ? b.Outputs.size() : b.Inputs.size()))
  {
    return false;
  }
  // As an instance of it stands in a graph, in a pipeline of its own.
  PipelineDocument alone = this->Doc.FindTemplate(t.Name.Value) ? *this->Doc.Get() : *this->Library;
  alone.Nodes.clear();
  alone.Outputs.clear();
  PipelineNode instance;
  instance.IsInstance = true;
  instance.Id.Value = "i";
  instance.Type = t.Name;
  alone.Nodes.push_back(instance);
  EditDocument document(&this->Registry);
  document.Set(std::make_shared<PipelineDocument>(alone));
  const GraphModel model = GraphModel::Build(document, "", this->Registry);
  const int at = model.Find("i");
  if (at < 0)
  {
    return false;
  }
  const GraphBox& box = model.Boxes[std::size_t(at)];
  return out ? std::any_of(box.Inputs.begin(), box.Inputs.end(),
                 [&](const GraphPin& p) { return KindFits(p.Kind, b.Outputs[pin].Kind, b.Outputs[pin].Components); })
             : std::any_of(box.Outputs.begin(), box.Outputs.end(),
                 [&](const GraphPin& p) { return KindFits(b.Inputs[pin].Kind, p.Kind, p.Components); });
}

/// A new box to a pin, at the port where it fits best.
void Viewer::ConnectWherever(int box, int pin, bool isOutput, const std::string& to)
{
  const GraphBox& b = this->Model.Boxes[std::size_t(box)];
  const std::string id = b.Id, name = isOutput ? b.Outputs[std::size_t(pin)].Name : b.Inputs[std::size_t(pin)].Name;
  this->RefreshGraph();
  const int own = this->Model.Find(id), other = this->Model.Find(to);
  if (own < 0 || other < 0)
  {
    return;
  }
  const GraphBox &mine = this->Model.Boxes[std::size_t(own)], &made = this->Model.Boxes[std::size_t(other)];
  const int ownPin = isOutput ? mine.FindOutput(name) : mine.FindInput(name);
  int best = -1, bestScore = 0;
  LinkVerdict verdict;
  const std::vector<GraphPin>& pins = isOutput ? made.Inputs : made.Outputs;
  for (std::size_t p = 0; p < pins.size() && ownPin >= 0; ++p)
  {
    const LinkVerdict v =
      isOutput ? this->Model.Judge(own, ownPin, other, int(p)) : this->Model.Judge(other, int(p), own, ownPin);
    const int score = !v.Ok ? 0 : 1 + (pins[p].Name == name ? 8 : 0) + (p == 0 ? 1 : 0) + (v.Delay ? 0 : 2);
    if (score > bestScore)
    {
      bestScore = score;
      best = int(p);
      verdict = v;
    }
  }
  if (best >= 0)
  {
    const GraphBox& reader = isOutput ? made : mine;
    const GraphPin& in = reader.Inputs[std::size_t(isOutput ? best : ownPin)];
    std::string error;
    this->Doc.Connect(this->Scope, isOutput ? this->Model.Reference(own, ownPin) : this->Model.Reference(other, best),
      reader.Id, in.Name, verdict.Delay, in.Repeatable, error);
  }
}

void Viewer::AddFromPalette(const std::string& type, bool isTemplate, const std::string& library)
{
  const double x = double(this->PaletteAt.x), y = double(this->PaletteAt.y);
  std::string error;
  this->PaletteOpen = false;
  if (type == "output")
  {
    std::string from;
    if (this->PaletteLinkBox >= 0 && this->PaletteLinkOutput && this->PaletteLinkBox < int(this->Model.Boxes.size()))
    {
      from = this->Model.Reference(this->PaletteLinkBox, this->PaletteLinkPin);
    }
    this->Reveal({ this->Doc.AddOutput(from, x, y) });
    this->PaletteLinkBox = -1;
    return;
  }
  if (isTemplate)
  {
    if (!library.empty() && !this->Doc.AddInclude(this->RelativeToFile(library), error))
    {
      this->Tell(error, true);
      return;
    }
    const int box = this->PaletteLinkBox, pin = this->PaletteLinkPin;
    const std::string made = this->Doc.AddInstance(this->Scope, type, x, y);
    this->PaletteLinkBox = -1;
    if (box >= 0 && box < int(this->Model.Boxes.size()))
    {
      this->ConnectWherever(box, pin, this->PaletteLinkOutput, made);
    }
    this->Reveal({ made });
    this->ShowWelcome = false;
    return;
  }
  const StageDescription* d = this->Registry.Describe(type);
  if (!d)
  {
    return;
  }
  if (this->PaletteOnLink >= 0 && this->PaletteOnLink < int(this->Model.Links.size()))
  {
    const GraphLink link = this->Model.Links[std::size_t(this->PaletteOnLink)];
    int port = 0;
    std::string array;
    this->PaletteOnLink = -1;
    if (this->Model.FitsOnLink(*d, link, port, array, error))
    {
      const std::string id = this->Doc.InsertOnLink(
        this->Scope, this->Model.Boxes[std::size_t(link.To)].Id, link.Index, *d, port, array, x, y);
      this->Reveal({ id });
      return;
    }
    this->Tell(error, true);
    return;
  }
  // With a link that was dropped on nothing: connected where it fits best.
  const int linkBox = this->PaletteLinkBox, linkPin = this->PaletteLinkPin;
  std::string from, toBox, toPort;
  bool repeatable = false, delayed = false;
  std::string kindName;
  ArrayKind kind = ArrayKind::Any;
  int components = 0;
  if (linkBox >= 0 && linkBox < int(this->Model.Boxes.size()))
  {
    const GraphBox& b = this->Model.Boxes[std::size_t(linkBox)];
    if (this->PaletteLinkOutput && linkPin >= 0 && linkPin < int(b.Outputs.size()))
    {
      from = this->Model.Reference(linkBox, linkPin);
      kind = b.Outputs[std::size_t(linkPin)].Kind;
      components = b.Outputs[std::size_t(linkPin)].Components;
      kindName = b.Outputs[std::size_t(linkPin)].Name;
    }
    else if (!this->PaletteLinkOutput && linkPin >= 0 && linkPin < int(b.Inputs.size()))
    {
      toBox = b.Id;
      toPort = b.Inputs[std::size_t(linkPin)].Name;
      repeatable = b.Inputs[std::size_t(linkPin)].Repeatable;
      delayed = b.Inputs[std::size_t(linkPin)].Delayed;
      kind = b.Inputs[std::size_t(linkPin)].Kind;
    }
  }
  this->PaletteLinkBox = -1;
  const std::string id = this->Doc.AddNode(this->Scope, type, x, y);
  if (!from.empty())
  {
    const int port = GraphModel::BestInput(*d, kindName, kind, components);
    if (port >= 0)
    {
      this->Doc.Connect(this->Scope, from, id, d->Inputs[std::size_t(port)].Name, d->Inputs[std::size_t(port)].Delayed,
        d->Inputs[std::size_t(port)].Repeatable, error);
    }
  }
  else if (!toBox.empty())
  {
    for (const OutputArray& a : d->Outputs)
    {
      if (KindFits(kind, a.Kind, a.Components))
      {
        this->Doc.Connect(this->Scope, id + ":" + a.Name, toBox, toPort, delayed, repeatable, error);
        break;
      }
    }
  }
  this->Reveal({ id });
  this->ShowWelcome = false;
  if (this->A.Node.empty() && this->Scope.empty())
  {
    this->SelectTarget(id, "");
  }
}

void Viewer::PaletteWindow()
{
  if (!this->PaletteOpen)
  {
    return;
  }
  const ImGuiIO& io = ImGui::GetIO();
  const ImVec2 size(
    std::min(this->S(430), io.DisplaySize.x - this->S(16)), std::min(this->S(360), io.DisplaySize.y - this->S(16)));
  const ImVec2 at(std::max(0.f, std::min(this->PaletteScreen.x, io.DisplaySize.x - size.x - this->S(8))),
    std::max(0.f, std::min(this->PaletteScreen.y, io.DisplaySize.y - size.y - this->S(8))));
  ImGui::SetNextWindowPos(at);
  ImGui::SetNextWindowSize(size);
  ImGui::PushStyleVar(ImGuiStyleVar_WindowBorderSize, 1);
  ImGui::PushStyleColor(ImGuiCol_WindowBg, ImGui::GetStyleColorVec4(ImGuiCol_PopupBg));
  ImGui::Begin("##palette", nullptr,
    ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
      ImGuiWindowFlags_NoSavedSettings);
  if (this->PaletteFocus)
  {
    ImGui::SetWindowFocus();
    ImGui::SetKeyboardFocusHere();
  }
  ImGui::SetNextItemWidth(-1);
  const std::string before = this->PaletteSearch;
  const bool enter = ImGui::InputTextWithHint(
    "##search", "search the nodes", &this->PaletteSearch, ImGuiInputTextFlags_EnterReturnsTrue);
  this->Mark("palette/search");
  if (before != this->PaletteSearch)
  {
    this->PaletteChoice = 0;
  }
  const ImVec2 windowMin = ImGui::GetWindowPos(), windowMax(windowMin.x + size.x, windowMin.y + size.y);
  if (!this->PaletteFocus && (ImGui::IsMouseClicked(0) || ImGui::IsMouseClicked(1)) &&
      !ImGui::IsMouseHoveringRect(windowMin, windowMax, false))
  {
    this->PaletteOpen = false;
  }

  struct Entry
  {
    std::string Type, Brief, Category, Library; ///< Library: a file that has to be included for it
    bool IsTemplate = false;
    int Score = 0;
  };
  std::vector<Entry> entries;
  const bool linked = this->PaletteLinkBox >= 0 && this->PaletteLinkBox < int(this->Model.Boxes.size());
  for (const std::string& type : this->Registry.Types())
  {
    const StageDescription* d = this->Registry.Describe(type);
    Entry e{ type, d->Brief, d->Category, "", false, 0 };
    e.Score = std::max(MatchScore(type, this->PaletteSearch),
      std::max(MatchScore(d->Category, this->PaletteSearch) / 2,
        this->PaletteSearch.size() >= 3 && d->Brief.find(this->PaletteSearch) != std::string::npos ? 10 : 0));
    if (linked)
    {
      const GraphBox& b = this->Model.Boxes[std::size_t(this->PaletteLinkBox)];
      if (this->PaletteLinkOutput && this->PaletteLinkPin < int(b.Outputs.size()))
      {
        const GraphPin& p = b.Outputs[std::size_t(this->PaletteLinkPin)];
        e.Score = GraphModel::BestInput(*d, p.Name, p.Kind, p.Components) < 0 ? 0 : e.Score;
      }
      else if (!this->PaletteLinkOutput && this->PaletteLinkPin < int(b.Inputs.size()))
      {
        const ArrayKind kind = b.Inputs[std::size_t(this->PaletteLinkPin)].Kind;
        e.Score = std::any_of(d->Outputs.begin(), d->Outputs.end(),
                    [kind](const OutputArray& a) { return KindFits(kind, a.Kind, a.Components); })
                    ? e.Score
                    : 0;
      }
    }
    if (this->PaletteOnLink >= 0 && this->PaletteOnLink < int(this->Model.Links.size()))
    {
      int port = 0;
      std::string array, why;
      e.Score =
        this->Model.FitsOnLink(*d, this->Model.Links[std::size_t(this->PaletteOnLink)], port, array, why) ? e.Score : 0;
    }
    if (e.Score > 0)
    {
      entries.push_back(e);
    }
  }
  const auto addTemplate = [&](const PipelineTemplate& t, const std::string& doc, const std::string& library)
  {
    Entry e{ t.Name.Value, t.Doc.Given ? t.Doc.Value : doc, "Templates", library, true, 0 };
    e.Score = MatchScore(t.Name.Value, this->PaletteSearch);
    if (e.Score > 0 && (!linked || this->TemplateFits(t)))
    {
      entries.push_back(e);
    }
  };
  if (this->PaletteOnLink < 0)
  {
    for (const PipelineTemplate& t : this->Doc.Get()->Templates)
    {
      if (t.Name.Value != this->Scope)
      {
        addTemplate(t, "a template of this pipeline", "");
      }
    }
    for (const PipelineInclude& i : this->Doc.Get()->Includes)
    {
      for (const PipelineTemplate& t : i.Content ? i.Content->Templates : std::vector<PipelineTemplate>())
      {
        addTemplate(t, "a template of " + i.File.Value, "");
      }
    }
  }
  if (this->PaletteOnLink < 0 && this->Scope.empty())
  {
    // The shipped library, which is included when something of it is taken.
    const std::string library = DataDirectory() + "/Pipelines/library.xml";
    if (!this->Library)
    {
      Diagnostics ignored;
      this->Library = ReadPipelineFile(library, ignored);
    }
    for (const PipelineTemplate& t : this->Library->Templates)
    {
      if (!this->Doc.FindTemplate(t.Name.Value))
      {
        addTemplate(t, "", library);
      }
    }
  }
  if (this->Scope.empty() && this->PaletteOnLink < 0 && (!linked || this->PaletteLinkOutput))
  {
    Entry e{ "output", "What a run writes: a file for each frame, or one for the last", "Outputs", "", false, 0 };
    e.Score = MatchScore("output", this->PaletteSearch);
    if (e.Score > 0)
    {
      entries.push_back(e);
    }
  }
  if (this->PaletteSearch.empty())
  {
    // By what one builds first.
    const auto rank = [](const std::string& c)
    {
      const char* order[] = { "RayTracing", "IO", "Denoising", "Temporal", "Color", "Metrics", "Outputs", "Templates" };
      for (int i = 0; i < 8; ++i)
      {
        if (c == order[i])
        {
          return i;
        }
      }
      return 8;
    };
    std::stable_sort(entries.begin(), entries.end(),
      [&](const Entry& x, const Entry& y) { return rank(x.Category) < rank(y.Category); });
  }
  else
  {
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& x, const Entry& y) { return x.Score > y.Score; });
  }
  if (this->Win.Pressed("Down"))
  {
    ++this->PaletteChoice;
  }
  if (this->Win.Pressed("Up"))
  {
    --this->PaletteChoice;
  }
  this->PaletteChoice = std::max(0, std::min(int(entries.size()) - 1, this->PaletteChoice));
  ImGui::BeginChild("list", ImVec2(0, 0), false);
  std::string category;
  bool chosen = false;
  for (std::size_t i = 0; i < entries.size(); ++i)
  {
    const Entry& e = entries[i];
    if (this->PaletteSearch.empty() && e.Category != category)
    {
      category = e.Category;
      ImGui::PushFont(this->Win.Small());
      ImGui::TextColored(Colors::Accent, "%s", category.c_str());
      ImGui::PopFont();
    }
    ImGui::PushID(int(i));
    if (ImGui::Selectable("##entry", int(i) == this->PaletteChoice))
    {
      this->AddFromPalette(e.Type, e.IsTemplate, e.Library);
      chosen = true;
    }
    this->Mark("palette/" + e.Type);
    this->Tooltip(e.Brief);
    if (int(i) == this->PaletteChoice && (this->Win.Pressed("Down") || this->Win.Pressed("Up")))
    {
      ImGui::SetScrollHereY();
    }
    ImGui::SameLine(this->S(6));
    ImGui::TextUnformatted(e.Type.c_str());
    ImGui::SameLine(this->S(170));
    ImGui::PushFont(this->Win.Small());
    ImGui::TextColored(Colors::Dim, "%s", Fitted(e.Brief, ImGui::GetContentRegionAvail().x - this->S(4)).c_str());
    ImGui::PopFont();
    ImGui::PopID();
    if (chosen)
    {
      break;
    }
  }
  if (entries.empty())
  {
    ImGui::TextColored(Colors::Dim, "%s",
      !linked                   ? "nothing of that name"
      : this->PaletteLinkOutput ? "no node of that name takes this"
                                : "no node of that name makes this");
  }
  ImGui::EndChild();
  ImGui::End();
  ImGui::PopStyleColor();
  ImGui::PopStyleVar();
  if (enter && !chosen && !entries.empty())
  {
    const Entry& e = entries[std::size_t(this->PaletteChoice)];
    this->AddFromPalette(e.Type, e.IsTemplate, e.Library);
  }
  this->PaletteFocus = false;
  if (!this->PaletteOpen)
  {
    this->PaletteLinkBox = this->PaletteOnLink = -1;
    this->PaletteSearch.clear();
  }
}

// ---- the canvas -----------------------------------------------------------------------------------------------------
void Viewer::GraphPanel(const ImVec2& min, const ImVec2& max)
{
  this->GraphMin = min;
  this->GraphMax = max;
  this->RefreshGraph();
  ImGuiIO& io = ImGui::GetIO();
  // Until the check of an edit is back the list stays as it was: it would come and go with every key.
  const bool checked = this->Checked && this->Checked->Document == this->Doc.Get();
  const bool hasMessages = this->Checked && !this->Checked->Messages.empty() &&
                           (checked || this->Checked->Document->File == this->Doc.Get()->File);
  // Three lines, the rest scrolls.
  const float messageLine = ImGui::GetTextLineHeight() + this->S(5);
  const float shownLines =
    !this->MessagesOpen ? 1.f : std::min(3.f, float(hasMessages ? this->Checked->Messages.size() : 0));
  const float messagesHeight =
    hasMessages ? std::min((max.y - min.y) * 0.4f, this->S(13) + shownLines * messageLine) : 0.f;
  const ImVec2 end(max.x, max.y - messagesHeight);
  this->GraphMax = end;
  if (this->GraphWantsFit && !this->Boxes.empty())
  {
    this->FitGraph();
    this->GraphWantsFit = !checked; // its list of mistakes takes room
  }
  this->KeepInView();
  ImGui::SetNextWindowPos(min);
  ImGui::SetNextWindowSize(ImVec2(end.x - min.x, end.y - min.y));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(0, 0));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, ImVec4(0.112f, 0.116f, 0.127f, 1));
  ImGui::Begin("##graph", nullptr,
    ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings |
      ImGuiWindowFlags_NoBringToFrontOnFocus | ImGuiWindowFlags_NoScrollWithMouse);
  ImGui::PopStyleVar();
  ImGui::PopStyleColor();
  ImDrawList* list = ImGui::GetWindowDrawList();

  // Dots that show where one is.
  const float z = this->GraphZoom * float(this->Scale);
  const float step = 40 * z;
  if (step > 9)
  {
    const ImVec2 first = this->ToScreen(ImVec2(0, 0));
    for (float x = min.x + std::fmod(first.x - min.x, step); x < end.x; x += step)
    {
      for (float y = min.y + std::fmod(first.y - min.y, step); y < end.y; y += step)
      {
        list->AddRectFilled(ImVec2(x, y), ImVec2(x + 1.5f, y + 1.5f), IM_COL32(255, 255, 255, 16));
      }
    }
  }

  ImGui::SetCursorScreenPos(min);
  ImGui::SetNextItemWidth(0);
  ImGui::InvisibleButton("canvas", ImVec2(std::max(1.f, end.x - min.x), std::max(1.f, end.y - min.y)),
    ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonMiddle | ImGuiButtonFlags_MouseButtonRight);
  ImGui::SetItemAllowOverlap();
  const bool hovered = ImGui::IsItemHovered() && !this->PaletteOpen;
  const bool active = ImGui::IsItemActive();
  this->MarkRect("graph", min, end);
  const ImVec2 mouse = io.MousePos;

  // ---- where things are on the screen
  // Links go around boxes that they have nothing to do with, and back below those they come from and lead to.
  std::vector<std::vector<ImVec2>> curves(this->Model.Links.size());
  for (std::size_t i = 0; i < this->Model.Links.size(); ++i)
  {
    const GraphLink& l = this->Model.Links[i];
    if (l.From < 0 || l.To < 0 || l.ToPin < 0)
    {
      continue;
    }
    const ImVec2 from = this->ToScreen(this->PinPosition(l.From, l.FromPin, true));
    const ImVec2 to = this->ToScreen(this->PinPosition(l.To, l.ToPin, false));
    const auto corner = [&](int box, bool low)
    {
      const BoxLayout& b = this->Boxes[std::size_t(box)];
      return this->ToScreen(low ? ImVec2(b.Position.x + b.Size.x, b.Position.y + b.Size.y) : b.Position);
    };
    std::vector<WayPoint> way{ { from, 1 }, { to, 1 } };
    if (to.x < from.x + 8 * z)
    {
      const float y = std::max(corner(l.From, true).y, corner(l.To, true).y) + (14 + 5 * float(l.ToPin % 3)) * z;
      way = { { from, 1 }, { ImVec2(from.x - 4 * z, y), -1 }, { ImVec2(to.x + 4 * z, y), -1 }, { to, 1 } };
      if (l.From == l.To || std::fabs(from.x - to.x) < 40 * z)
      {
        way[1].At.x = from.x - 10 * z;
        way[2].At.x = to.x + 10 * z;
      }
    }
    else
    {
      ImVec2 low(1e9f, 1e9f), high(-1e9f, -1e9f);
      for (int round = 0; round < 3; ++round)
      {
        const std::vector<ImVec2> line = Smooth(way, 30 * z, z);
        bool crosses = false;
        for (std::size_t b = 0; b < this->Boxes.size(); ++b)
        {
          if (int(b) == l.From || int(b) == l.To)
          {
            continue;
          }
          const ImVec2 p = corner(int(b), false), q = corner(int(b), true);
          const bool hit = std::any_of(line.begin(), line.end(),
            [&](const ImVec2& v) { return v.x > p.x && v.x < q.x && v.y > p.y - 2 * z && v.y < q.y + 2 * z; });
          if (hit && p.x > from.x - 4 * z && q.x < to.x + 4 * z)
          {
            crosses = true;
            low = ImVec2(std::min(low.x, p.x), std::min(low.y, p.y));
            high = ImVec2(std::max(high.x, q.x), std::max(high.y, q.y));
          }
        }
        if (!crosses)
        {
          break;
        }
        const float middle = (from.y + to.y) / 2, room = (7 + 4 * float(l.FromPin % 4)) * z;
        const float above = low.y - room, below = high.y + room;
        const float y = std::fabs(above - middle) < std::fabs(below - middle) ? above : below;
        way = { { from, 1 }, { ImVec2(std::max(low.x - 4 * z, from.x + 10 * z), y), 1 },
          { ImVec2(std::min(high.x + 4 * z, to.x - 10 * z), y), 1 }, { to, 1 } };
      }
    }
    curves[i] = Smooth(way, (way.size() > 2 ? 14 : 30) * z, z);
  }
  int pinBox = -1, pin = -1, overBox = -1, overOutputRow = -1;
  bool pinIsOutput = false, overMore = false;
  const float grab = std::max(7.f, 8 * z);
  for (int i = int(this->Boxes.size()) - 1; i >= 0 && hovered && overBox < 0; --i)
  {
    const BoxLayout& l = this->Boxes[std::size_t(i)];
    const GraphBox& b = this->Model.Boxes[std::size_t(i)];
    for (std::size_t p = 0; p < b.Inputs.size() && pinBox < 0; ++p)
    {
      const ImVec2 at = this->ToScreen(this->PinPosition(i, int(p), false));
      if (std::fabs(at.x - mouse.x) < grab && std::fabs(at.y - mouse.y) < RowHeight * z / 2)
      {
        pinBox = i;
        pin = int(p);
        pinIsOutput = false;
      }
    }
    for (std::size_t k = 0; k < l.ShownOutputs.size() && pinBox < 0; ++k)
    {
      const ImVec2 at = this->ToScreen(this->PinPosition(i, l.ShownOutputs[k], true));
      if (std::fabs(at.x - mouse.x) < grab && std::fabs(at.y - mouse.y) < RowHeight * z / 2)
      {
        pinBox = i;
        pin = l.ShownOutputs[k];
        pinIsOutput = true;
      }
    }
    const ImVec2 a = this->ToScreen(l.Position),
                 c = this->ToScreen(ImVec2(l.Position.x + l.Size.x, l.Position.y + l.Size.y));
    if (mouse.x >= a.x && mouse.x <= c.x && mouse.y >= a.y && mouse.y <= c.y)
    {
      overBox = i;
      const int row = int((this->ToGraph(mouse).y - l.Position.y - HeaderHeight - 2) / RowHeight);
      if (mouse.y > a.y + HeaderHeight * z && mouse.x > (a.x + c.x) / 2 && row >= 0)
      {
        if (row < int(l.ShownOutputs.size()))
        {
          overOutputRow = l.ShownOutputs[std::size_t(row)];
        }
        else if (row == int(l.ShownOutputs.size()) && b.Outputs.size() > 3 && b.Kind != BoxKind::TemplateInputs)
        {
          overMore = true;
        }
      }
    }
    else if (pinBox == i)
    {
      overBox = i;
    }
  }
  this->HoveredLink = -1;
  if (hovered && overBox < 0)
  {
    float nearest = 6 * std::max(1.f, z);
    for (std::size_t i = 0; i < curves.size(); ++i)
    {
      if (this->Model.Links[i].From >= 0 && this->Model.Links[i].ToPin >= 0)
      {
        const float d = DistanceToLine(curves[i], mouse);
        if (d < nearest)
        {
          nearest = d;
          this->HoveredLink = int(i);
        }
      }
    }
  }

  // ---- the mouse
  const bool editable = this->Doc.IsEditable(this->Scope);
  if (hovered && (io.MouseWheel != 0 || ImGui::IsMouseClicked(0) || ImGui::IsMouseClicked(2)))
  {
    this->GraphWantsFit = false;
    this->Revealed.clear();
  }
  if (hovered && io.MouseWheel != 0)
  {
    const ImVec2 before = this->ToGraph(mouse);
    this->GraphZoom = std::min(2.f, std::max(0.2f, this->GraphZoom * std::pow(1.12f, io.MouseWheel)));
    const ImVec2 after = this->ToGraph(mouse);
    this->GraphOffset.x += after.x - before.x;
    this->GraphOffset.y += after.y - before.y;
  }
  if (hovered && (ImGui::IsMouseClicked(2) || (ImGui::IsMouseClicked(0) && io.KeyAlt)))
  {
    this->Dragging.Kind = Drag::What::Pan;
    this->Dragging.Start = mouse;
    this->Dragging.StartOffset = this->GraphOffset;
  }
  else if (hovered && ImGui::IsMouseClicked(0))
  {
    this->Dragging = Drag();
    this->Dragging.Start = mouse;
    if (pinBox >= 0 && editable)
    {
      this->Dragging.Box = pinBox;
      this->Dragging.Pin = pin;
      this->Dragging.Kind = pinIsOutput ? Drag::What::LinkFromOutput : Drag::What::LinkFromInput;
      if (!pinIsOutput)
      {
        // Taken up at its end, the link goes along.
        for (std::size_t i = 0; i < this->Model.Links.size(); ++i)
        {
          const GraphLink& l = this->Model.Links[i];
          if (l.To == pinBox && l.ToPin == pin && l.From >= 0 && l.FromPin >= 0 &&
              !(this->Model.Boxes[std::size_t(pinBox)].Inputs[std::size_t(pin)].Repeatable && io.KeyShift))
          {
            this->Dragging.Kind = Drag::What::LinkFromOutput;
            this->Dragging.Box = l.From;
            this->Dragging.Pin = l.FromPin;
            this->Dragging.TakenLink = int(i);
          }
        }
      }
    }
    else if (overBox >= 0)
    {
      const std::string id = this->Model.Boxes[std::size_t(overBox)].Id;
      if (overMore)
      {
        const std::string key = PositionKey(this->Scope, id);
        if (!this->Expanded.erase(key))
        {
          this->Expanded.insert(key);
        }
      }
      else
      {
        if (io.KeyShift || io.KeyCtrl)
        {
          if (!this->Selected.erase(id))
          {
            this->Selected.insert(id);
          }
        }
        else if (!this->Selected.count(id))
        {
          this->Selected = { id };
        }
        this->Dragging.Kind = Drag::What::Boxes;
        this->Dragging.Box = overBox;
        for (std::size_t i = 0; i < this->Boxes.size(); ++i)
        {
          if (this->Selected.count(this->Model.Boxes[i].Id))
          {
            this->Dragging.Origins[this->Model.Boxes[i].Id] = this->Boxes[i].Position;
          }
        }
        const GraphBox& b = this->Model.Boxes[std::size_t(overBox)];
        if (!io.KeyShift && !io.KeyCtrl && b.Kind != BoxKind::TemplateInputs)
        {
          // What is selected is shown.
          if (b.Kind == BoxKind::Output || b.Kind == BoxKind::TemplateOutput)
          {
            for (const GraphLink& l : this->Model.Links)
            {
              if (l.To == overBox && l.Index == 0 && l.From >= 0 && l.FromPin >= 0)
              {
                const std::string node = this->NodePathOf(this->Model.Boxes[std::size_t(l.From)].Id);
                if (!node.empty())
                {
                  this->SelectTarget(node, this->Model.Boxes[std::size_t(l.From)].Outputs[std::size_t(l.FromPin)].Name);
                }
              }
            }
          }
          else if (const std::string path = this->NodePathOf(b.Id); !path.empty() && !b.Outputs.empty())
          {
            if (overOutputRow >= 0)
            {
              this->SelectTarget(path, b.Outputs[std::size_t(overOutputRow)].Name);
            }
            else if (this->A.Node != path)
            {
              this->SelectTarget(path, "");
            }
          }
        }
      }
    }
    else
    {
      this->Dragging.Kind = Drag::What::Rubber;
      if (!io.KeyShift && !io.KeyCtrl)
      {
        this->Selected.clear();
      }
    }
  }
  if (hovered && ImGui::IsMouseDoubleClicked(0))
  {
    if (overBox < 0 && this->HoveredLink < 0)
    {
      this->PaletteOpen = this->PaletteFocus = true;
      this->PaletteScreen = mouse;
      this->PaletteAt = this->ToGraph(mouse);
      this->PaletteSearch.clear();
      this->PaletteChoice = 0;
      this->PaletteLinkBox = this->PaletteOnLink = -1;
      this->Dragging = Drag();
    }
    else if (overBox >= 0 && this->Model.Boxes[std::size_t(overBox)].Kind == BoxKind::Instance && pinBox < 0)
    {
      const std::string scope = this->Model.Boxes[std::size_t(overBox)].Type;
      this->Dragging = Drag();
      ImGui::End();
      this->EnterScope(scope);
      return;
    }
  }
  if (hovered && this->Win.Pressed("Tab") && editable)
  {
    this->PaletteOpen = this->PaletteFocus = true;
    this->PaletteScreen = mouse;
    this->PaletteAt = this->ToGraph(mouse);
    this->PaletteSearch.clear();
    this->PaletteChoice = 0;
    this->PaletteLinkBox = this->PaletteOnLink = -1;
  }

  // The verdict on the link at hand.
  LinkVerdict verdict;
  int linkFrom = -1, linkFromPin = -1, linkTo = -1, linkToPin = -1;
  const bool linking =
    this->Dragging.Kind == Drag::What::LinkFromOutput || this->Dragging.Kind == Drag::What::LinkFromInput;
  if (linking && this->Dragging.Box < int(this->Model.Boxes.size()))
  {
    const bool fromOutput = this->Dragging.Kind == Drag::What::LinkFromOutput;
    int otherBox = -1, otherPin = -1;
    if (pinBox >= 0 && pinIsOutput != fromOutput)
    {
      otherBox = pinBox;
      otherPin = pin;
    }
    else if (overBox >= 0 && pinBox < 0 && overBox != this->Dragging.Box)
    {
      // On the body of a node: where it fits best.
      const GraphBox& own = this->Model.Boxes[std::size_t(this->Dragging.Box)];
      const GraphBox& b = this->Model.Boxes[std::size_t(overBox)];
      int score = 0;
      const std::size_t count = fromOutput ? b.Inputs.size() : b.Outputs.size();
      for (std::size_t p = 0; p < count; ++p)
      {
        const LinkVerdict v = fromOutput ? this->Model.Judge(this->Dragging.Box, this->Dragging.Pin, overBox, int(p))
                                         : this->Model.Judge(overBox, int(p), this->Dragging.Box, this->Dragging.Pin);
        const std::string ownName = fromOutput ? own.Outputs[std::size_t(this->Dragging.Pin)].Name
                                               : own.Inputs[std::size_t(this->Dragging.Pin)].Name;
        const std::string name = fromOutput ? b.Inputs[p].Name : b.Outputs[p].Name;
        const int s =
          !v.Ok ? 0 : 1 + (name == ownName ? 8 : 0) + (v.Replaces ? 0 : 2) + (p == 0 ? 1 : 0) + (v.Delay ? 0 : 2);
        if (s > score)
        {
          score = s;
          otherBox = overBox;
          otherPin = int(p);
        }
      }
      if (otherPin < 0)
      {
        otherBox = overBox;
        otherPin = 0;
      }
    }
    if (otherBox >= 0)
    {
      linkFrom = fromOutput ? this->Dragging.Box : otherBox;
      linkFromPin = fromOutput ? this->Dragging.Pin : otherPin;
      linkTo = fromOutput ? otherBox : this->Dragging.Box;
      linkToPin = fromOutput ? otherPin : this->Dragging.Pin;
      verdict = this->Model.Judge(linkFrom, linkFromPin, linkTo, linkToPin);
    }
  }
  // A node that is dragged over a link and would fit on it.
  int dropLink = -1, dropPort = 0;
  std::string dropArray, dropReason;
  if (this->Dragging.Kind == Drag::What::Boxes && this->Dragging.Moved && this->Dragging.Origins.size() == 1 &&
      editable)
  {
    const int own = this->Dragging.Box;
    const GraphBox& b = this->Model.Boxes[std::size_t(own)];
    const bool loose = std::none_of(this->Model.Links.begin(), this->Model.Links.end(),
      [own](const GraphLink& l) { return l.From == own || (l.To == own && l.ToPin == 0); });
    if (loose && b.Description)
    {
      const BoxLayout& l = this->Boxes[std::size_t(own)];
      const ImVec2 middle = this->ToScreen(ImVec2(l.Position.x + l.Size.x / 2, l.Position.y + l.Size.y / 2));
      float nearest = (l.Size.y / 2 + 4) * z;
      for (std::size_t i = 0; i < curves.size(); ++i)
      {
        const GraphLink& link = this->Model.Links[i];
        if (link.From < 0 || link.ToPin < 0 || link.To == own || link.From == own)
        {
          continue;
        }
        const float d = std::min(DistanceToLine(curves[i], middle), DistanceToLine(curves[i], mouse) + 4 * z);
        int port = 0;
        std::string array;
        if (d < nearest && this->Model.FitsOnLink(*b.Description, link, port, array, dropReason))
        {
          nearest = d;
          dropLink = int(i);
          dropPort = port;
          dropArray = array;
        }
      }
    }
  }

  if (this->Dragging.Kind != Drag::What::None)
  {
    const ImVec2 delta(mouse.x - this->Dragging.Start.x, mouse.y - this->Dragging.Start.y);
    this->Dragging.Moved = this->Dragging.Moved || std::hypot(delta.x, delta.y) > this->S(4);
    if (this->Dragging.Kind == Drag::What::Pan)
    {
      this->GraphOffset =
        ImVec2(this->Dragging.StartOffset.x + delta.x / z, this->Dragging.StartOffset.y + delta.y / z);
    }
    if (this->Dragging.Kind == Drag::What::Boxes && this->Dragging.Moved && editable)
    {
      std::vector<std::pair<std::string, std::pair<double, double>>> to;
      for (std::size_t i = 0; i < this->Boxes.size(); ++i)
      {
        const std::string& id = this->Model.Boxes[i].Id;
        const auto origin = this->Dragging.Origins.find(id);
        if (origin != this->Dragging.Origins.end())
        {
          to.emplace_back(
            id, std::make_pair(double(origin->second.x + delta.x / z), double(origin->second.y + delta.y / z)));
          this->Boxes[i].Position =
            ImVec2(float(std::floor(to.back().second.first + 0.5)), float(std::floor(to.back().second.second + 0.5)));
        }
        else if (!this->Doc.Positions().count(PositionKey(this->Scope, id)))
        {
          // The others stay where they were shown.
          to.emplace_back(id, std::make_pair(double(this->Boxes[i].Position.x), double(this->Boxes[i].Position.y)));
        }
      }
      this->Doc.Move(this->Scope, to);
      this->ModelOf = this->Doc.Revision(); // nothing but places changed
    }
    if (this->Dragging.Kind == Drag::What::Rubber)
    {
      const ImVec2 a(std::min(mouse.x, this->Dragging.Start.x), std::min(mouse.y, this->Dragging.Start.y));
      const ImVec2 b(std::max(mouse.x, this->Dragging.Start.x), std::max(mouse.y, this->Dragging.Start.y));
      if (this->Dragging.Moved)
      {
        for (std::size_t i = 0; i < this->Boxes.size(); ++i)
        {
          const BoxLayout& l = this->Boxes[i];
          const ImVec2 p = this->ToScreen(l.Position),
                       q = this->ToScreen(ImVec2(l.Position.x + l.Size.x, l.Position.y + l.Size.y));
          if (p.x < b.x && q.x > a.x && p.y < b.y && q.y > a.y)
          {
            this->Selected.insert(this->Model.Boxes[i].Id);
          }
          else if (!io.KeyShift && !io.KeyCtrl)
          {
            this->Selected.erase(this->Model.Boxes[i].Id);
          }
        }
      }
    }
    const bool released =
      !ImGui::IsMouseDown(this->Dragging.Kind == Drag::What::Pan && !io.KeyAlt && !ImGui::IsMouseDown(0) ? 2 : 0) ||
      (!active && !ImGui::IsMouseDown(0) && !ImGui::IsMouseDown(2));
    if (released)
    {
      if (linking && linkTo >= 0)
      {
        const GraphLink* taken =
          this->Dragging.TakenLink >= 0 && this->Dragging.TakenLink < int(this->Model.Links.size())
            ? &this->Model.Links[std::size_t(this->Dragging.TakenLink)]
            : nullptr;
        const bool same = taken && taken->To == linkTo && taken->ToPin == linkToPin;
        if (!same && verdict.Ok)
        {
          const GraphBox& to = this->Model.Boxes[std::size_t(linkTo)];
          const GraphPin& in = to.Inputs[std::size_t(linkToPin)];
          std::string error;
          if (taken)
          {
            this->Doc.Disconnect(this->Scope, this->Model.Boxes[std::size_t(taken->To)].Id, taken->Index);
          }
          if (!this->Doc.Connect(this->Scope, this->Model.Reference(linkFrom, linkFromPin), to.Id, in.Name,
                verdict.Delay, in.Repeatable, error))
          {
            this->Tell(error, true);
          }
        }
        else if (!same && !verdict.Ok)
        {
          this->Tell(verdict.Reason, true);
        }
      }
      else if (linking && this->Dragging.TakenLink >= 0 && this->Dragging.Moved && overBox < 0)
      {
        const GraphLink& l = this->Model.Links[std::size_t(this->Dragging.TakenLink)];
        this->Doc.Disconnect(this->Scope, this->Model.Boxes[std::size_t(l.To)].Id, l.Index);
      }
      else if (linking && this->Dragging.Moved && overBox < 0 && hovered)
      {
        this->PaletteOpen = this->PaletteFocus = true;
        this->PaletteScreen = mouse;
        this->PaletteAt = this->ToGraph(mouse);
        this->PaletteSearch.clear();
        this->PaletteChoice = 0;
        this->PaletteLinkBox = this->Dragging.Box;
        this->PaletteLinkPin = this->Dragging.Pin;
        this->PaletteLinkOutput = this->Dragging.Kind == Drag::What::LinkFromOutput;
        this->PaletteOnLink = -1;
      }
      else if (linking && !this->Dragging.Moved && this->Dragging.Kind == Drag::What::LinkFromOutput &&
               this->Dragging.TakenLink < 0)
      {
        const std::string path = this->NodePathOf(this->Model.Boxes[std::size_t(this->Dragging.Box)].Id);
        if (!path.empty())
        {
          this->SelectTarget(
            path, this->Model.Boxes[std::size_t(this->Dragging.Box)].Outputs[std::size_t(this->Dragging.Pin)].Name);
        }
      }
      else if (this->Dragging.Kind == Drag::What::Boxes && !this->Dragging.Moved && overBox >= 0 && !io.KeyShift &&
               !io.KeyCtrl)
      {
        this->Selected = { this->Model.Boxes[std::size_t(overBox)].Id };
      }
      else if (dropLink >= 0)
      {
        const GraphLink l = this->Model.Links[std::size_t(dropLink)];
        const GraphBox& b = this->Model.Boxes[std::size_t(this->Dragging.Box)];
        this->Doc.PutOnLink(
          this->Scope, this->Model.Boxes[std::size_t(l.To)].Id, l.Index, b.Id, *b.Description, dropPort, dropArray);
      }
      this->Dragging = Drag();
    }
  }

  // ---- drawing
  list->PushClipRect(min, end, true);
  // Links first, so that nodes lie on them.
  for (std::size_t i = 0; i < curves.size(); ++i)
  {
    const GraphLink& l = this->Model.Links[i];
    if (l.From < 0 || l.ToPin < 0)
    {
      continue;
    }
    if (int(i) == this->Dragging.TakenLink && this->Dragging.Moved)
    {
      continue;
    }
    const GraphBox& from = this->Model.Boxes[std::size_t(l.From)];
    const ArrayKind kind = l.FromPin >= 0 ? from.Outputs[std::size_t(l.FromPin)].Kind : ArrayKind::Any;
    const bool touched = this->Selected.count(from.Id) || this->Selected.count(this->Model.Boxes[std::size_t(l.To)].Id);
    const bool bright = int(i) == this->HoveredLink || int(i) == dropLink;
    const float alpha = bright ? 1.f : touched ? 0.95f : this->Selected.empty() ? 0.75f : 0.4f;
    const ImU32 colour = l.FromPin < 0 ? ImGui::GetColorU32(Colors::Error) : KindColor(kind, alpha);
    const float thick = (bright ? 3.4f : 2.f) * std::max(0.6f, z);
    const std::vector<ImVec2>& line = curves[i];
    if (!l.Delayed)
    {
      list->AddPolyline(line.data(), int(line.size()), colour, 0, thick);
    }
    else
    {
      // Dashes: from the previous frame.
      float along = 0;
      for (std::size_t k = 0; k + 1 < line.size(); ++k)
      {
        const float length = std::hypot(line[k + 1].x - line[k].x, line[k + 1].y - line[k].y);
        const int parts = std::max(1, int(length / (3 * std::max(0.5f, z))));
        for (int n = 0; n < parts; ++n)
        {
          const float u = float(n) / float(parts), v = float(n + 1) / float(parts);
          if (std::fmod(along + u * length, 11 * z) < 6.5f * z)
          {
            list->AddLine(ImLerp(line[k], line[k + 1], u), ImLerp(line[k], line[k + 1], v), colour, thick);
          }
        }
        along += length;
      }
    }
    const ImVec2 half = line[line.size() / 2];
    this->MarkRect("link/" + this->Model.Boxes[std::size_t(l.To)].Id + "/" + std::to_string(l.Index),
      ImVec2(half.x - 2, half.y - 2), ImVec2(half.x + 2, half.y + 2));
  }
  const ViewProgress progress = this->Session->Progress();
  const auto text = [&](const ImVec2& at, const std::string& s, ImU32 colour, float size, bool bold)
  {
    if (size >= this->S(7.5)) // smaller ones are only dots
    {
      list->AddText(bold ? this->Win.Bold() : this->Win.Small(), size, at, colour, s.c_str());
    }
  };
  const auto measure = [&](const std::string& s, float size, bool bold)
  { return (bold ? this->Win.Bold() : this->Win.Small())->CalcTextSizeA(size, 1e9f, 0, s.c_str()).x; };
  const auto fit = [&](std::string s, float size, bool bold, float width)
  {
    if (measure(s, size, bold) <= width)
    {
      return s;
    }
    while (!s.empty() && measure(s + "\u2026", size, bold) > width)
    {
      s.pop_back();
    }
    return s + "\u2026";
  };
  // Small boxes have letters as large as their rows allow; the smallest have their name alone, all over them.
  const float rowSize = std::max(11.5f * z, std::min(this->S(9.5), 0.84f * RowHeight * z));
  const bool compact = rowSize < this->S(7.5);
  const float titleSize = compact ? this->S(10) : std::max(13 * z, std::min(this->S(11), 0.8f * HeaderHeight * z));
  for (std::size_t i = 0; i < this->Boxes.size(); ++i)
  {
    const GraphBox& b = this->Model.Boxes[i];
    const BoxLayout& l = this->Boxes[i];
    const ImVec2 a = this->ToScreen(l.Position),
                 c = this->ToScreen(ImVec2(l.Position.x + l.Size.x, l.Position.y + l.Size.y));
    this->MarkRect("node/" + b.Id, a, ImVec2(c.x, a.y + HeaderHeight * z));
    const bool selected = this->Selected.count(b.Id) != 0;
    const std::string path = this->Scope.empty() ? b.Id : this->NodePathOf(b.Id);
    const bool shown = !path.empty() && (this->A.Node == path || (b.Kind == BoxKind::Instance && this->A.Node == path));
    const Diagnostic* mistake = nullptr;
    if (this->Checked && this->Checked->Document == this->Doc.Get())
    {
      for (const Diagnostic& d : this->Checked->Messages)
      {
        const bool mine = !d.Node.empty() &&
                          (d.Node == path || (b.Kind == BoxKind::Instance && TopOf(d.Node) == b.Id)) &&
                          (!d.Node.empty());
        if (mine && (!mistake || d.Level == Severity::Error))
        {
          mistake = &d;
        }
      }
    }
    list->AddRectFilled(
      ImVec2(a.x + 2 * z, a.y + 3 * z), ImVec2(c.x + 2 * z, c.y + 3 * z), IM_COL32(0, 0, 0, 70), 6 * z);
    list->AddRectFilled(a, c, IM_COL32(43, 45, 50, 255), 5 * z);
    ImVec4 head(0.235f, 0.25f, 0.28f, 1);
    if (b.Kind == BoxKind::Output || b.Kind == BoxKind::TemplateOutput)
    {
      head = ImVec4(0.20f, 0.31f, 0.25f, 1);
    }
    else if (b.Kind == BoxKind::Instance || b.Kind == BoxKind::TemplateInputs)
    {
      head = ImVec4(0.29f, 0.25f, 0.37f, 1);
    }
    else if (b.Inputs.empty())
    {
      head = ImVec4(0.34f, 0.27f, 0.18f, 1);
    }
    list->AddRectFilled(
      a, ImVec2(c.x, a.y + HeaderHeight * z), ImGui::ColorConvertFloat4ToU32(head), 5 * z, ImDrawFlags_RoundCornersTop);
    if (b.Kind == BoxKind::Instance)
    {
      // A second card behind: there is something inside.
      list->AddRect(
        ImVec2(a.x - 3 * z, a.y - 3 * z), ImVec2(c.x - 3 * z, c.y - 3 * z), IM_COL32(120, 105, 160, 120), 5 * z);
    }
    list->AddRect(a, c,
      mistake && mistake->Level == Severity::Error ? ImGui::GetColorU32(Colors::Error)
      : selected                                   ? ImGui::GetColorU32(Colors::Accent)
                                                   : IM_COL32(78, 82, 90, 255),
      5 * z, 0, (selected || mistake ? 2.f : 1.f) * std::max(0.7f, z));
    // The header: name left, time right, an eye where the picture comes from.
    double seconds = 0;
    bool ran = false, known = false;
    if (this->LastGood && !path.empty())
    {
      for (const ViewFrame::Node& n : this->LastGood->Nodes)
      {
        if (n.Path == path || (b.Kind == BoxKind::Instance && TopOf(n.Path) == path))
        {
          seconds += n.Counters.Seconds;
          ran = ran || n.Counters.Executions > 0;
          known = true;
        }
      }
    }
    if (compact)
    {
      list->AddRectFilled(
        ImVec2(a.x + 1, a.y + 1), ImVec2(c.x - 1, c.y - 1), ImGui::ColorConvertFloat4ToU32(head), 5 * z);
      const float line = titleSize * 1.05f, width = c.x - a.x - 2;
      const int most = std::max(1, int((c.y - a.y) / line));
      std::string rest = b.Title;
      std::vector<std::string> lines;
      while (!rest.empty())
      {
        std::string now = rest;
        const bool last = int(lines.size()) + 1 == most;
        while (now.size() > 1 && measure(now, titleSize, true) > width && !last)
        {
          now.pop_back();
        }
        now = last ? fit(rest, titleSize, true, width) : now;
        lines.push_back(now);
        rest = last ? std::string() : rest.substr(now.size());
      }
      const float top = (a.y + c.y) / 2 - line * float(lines.size()) / 2;
      for (std::size_t n = 0; n < lines.size(); ++n)
      {
        text(ImVec2((a.x + c.x - measure(lines[n], titleSize, true)) / 2, top + line * float(n)), lines[n],
          ImGui::GetColorU32(!b.Known ? Colors::Error
                             : shown  ? Colors::Accent
                                      : Colors::Text),
          titleSize, true);
      }
    }
    std::string time = known && !this->Given.Plain ? (ran ? Milliseconds(1000 * seconds) : "kept") : std::string();
    float timeWidth = time.empty() ? 0 : measure(time, rowSize * 0.93f, false) + 8 * z;
    const float eye = shown ? 18 * z : 0;
    if (!compact)
    {
      text(ImVec2(a.x + 9 * z + eye, a.y + HeaderHeight * z / 2 - titleSize * 0.58f),
        fit(b.Title, titleSize, true, c.x - a.x - 18 * z - eye - timeWidth),
        ImGui::GetColorU32(b.Known ? Colors::Text : Colors::Error), titleSize, true);
    }
    if (shown && !compact)
    {
      DrawIcon(
        list, ImVec2(a.x + 15 * z, a.y + HeaderHeight * z / 2), 11 * z, Icon::Eye, ImGui::GetColorU32(Colors::Accent));
    }
    if (!time.empty() && !compact)
    {
      text(ImVec2(c.x - timeWidth, a.y + 6.5f * z), time, ImGui::GetColorU32(ran ? Colors::Text : Colors::Dim),
        rowSize * 0.93f, false);
    }
    // Rows
    for (std::size_t p = 0; p < b.Inputs.size(); ++p)
    {
      const GraphPin& in = b.Inputs[p];
      const ImVec2 at = this->ToScreen(this->PinPosition(int(i), int(p), false));
      float alpha = 1;
      if (linking)
      {
        alpha = this->Dragging.Kind == Drag::What::LinkFromOutput &&
                    this->Model.Judge(this->Dragging.Box, this->Dragging.Pin, int(i), int(p)).Ok
                  ? 1.f
                  : 0.22f;
      }
      const bool over = pinBox == int(i) && !pinIsOutput && pin == int(p);
      const float r = PinRadius * z * (over ? 1.5f : 1);
      if (in.Links > 0)
      {
        list->AddCircleFilled(at, r, KindColor(in.Kind, alpha));
      }
      else
      {
        list->AddCircleFilled(at, r, IM_COL32(30, 31, 34, 255));
        list->AddCircle(at, r,
          !in.Optional && !linking ? ImGui::GetColorU32(Colors::Warning) : KindColor(in.Kind, alpha), 0,
          1.6f * std::max(0.7f, z));
      }
      const ImVec4 colour = in.Links > 0 ? Colors::Text : !in.Optional ? Colors::Warning : Colors::Dim;
      const float half = l.ShownOutputs.size() > p ? 0.5f : 0.95f;
      text(ImVec2(at.x + 10 * z, at.y - rowSize * 0.58f), fit(in.Name, rowSize, false, (c.x - a.x) * half - 14 * z),
        ImGui::GetColorU32(ImVec4(colour.x, colour.y, colour.z, alpha)), rowSize, false);
      this->MarkRect("in/" + b.Id + "/" + in.Name, ImVec2(at.x - r, at.y - r), ImVec2(at.x + r, at.y + r));
    }
    for (std::size_t k = 0; k < l.ShownOutputs.size(); ++k)
    {
      const GraphPin& out = b.Outputs[std::size_t(l.ShownOutputs[k])];
      const ImVec2 at = this->ToScreen(this->PinPosition(int(i), l.ShownOutputs[k], true));
      float alpha = 1;
      if (linking)
      {
        alpha = this->Dragging.Kind == Drag::What::LinkFromInput &&
                    this->Model.Judge(int(i), l.ShownOutputs[k], this->Dragging.Box, this->Dragging.Pin).Ok
                  ? 1.f
                  : 0.22f;
        alpha = this->Dragging.Box == int(i) && this->Dragging.Pin == l.ShownOutputs[k] &&
                    this->Dragging.Kind == Drag::What::LinkFromOutput
                  ? 1.f
                  : alpha;
      }
      const bool over = pinBox == int(i) && pinIsOutput && pin == l.ShownOutputs[k];
      const float r = PinRadius * z * (over ? 1.5f : 1);
      list->AddCircleFilled(at, r, KindColor(out.Kind, alpha));
      const bool isShown = shown && (this->A.Array == out.Name || (this->A.Array.empty() && l.ShownOutputs[k] == 0));
      const ImVec4 colour = isShown ? Colors::Accent : out.Links > 0 ? Colors::Text : Colors::Dim;
      const float half = b.Inputs.size() > k ? 0.5f : 0.95f;
      const std::string name = fit(out.Name, rowSize, false, (c.x - a.x) * half - 14 * z);
      text(ImVec2(at.x - 10 * z - measure(name, rowSize, false), at.y - rowSize * 0.58f), name,
        ImGui::GetColorU32(ImVec4(colour.x, colour.y, colour.z, alpha)), rowSize, false);
      this->MarkRect("out/" + b.Id + "/" + out.Name, ImVec2(at.x - r, at.y - r), ImVec2(at.x + r, at.y + r));
    }
    if (b.Outputs.size() > 3 && b.Kind != BoxKind::TemplateInputs)
    {
      const ImVec2 at = this->ToScreen(ImVec2(
        l.Position.x + l.Size.x, l.Position.y + HeaderHeight + (float(l.ShownOutputs.size()) + 0.5f) * RowHeight + 2));
      const std::size_t hidden = b.Outputs.size() - l.ShownOutputs.size();
      const std::string s = hidden > 0 ? "+ " + std::to_string(hidden) + " more" : "fewer";
      text(ImVec2(at.x - 10 * z - measure(s, rowSize, false), at.y - rowSize * 0.58f), s,
        ImGui::GetColorU32(overMore && overBox == int(i) ? Colors::Accent : Colors::Dim), rowSize, false);
      this->MarkRect(
        "more/" + b.Id, ImVec2(at.x - 40 * z, at.y - rowSize / 2), ImVec2(at.x - 12 * z, at.y + rowSize / 2));
    }
    if (b.Kind == BoxKind::Output && !b.Type.empty())
    {
      const std::string name = fit(b.Type, rowSize * 0.93f, false, c.x - a.x - 60 * z);
      text(ImVec2(c.x - 8 * z - measure(name, rowSize * 0.93f, false), c.y - (FootHeight + RowHeight) * z), name,
        ImGui::GetColorU32(Colors::Dim), rowSize * 0.93f, false);
    }
    // Progress along the lower edge.
    double done = 0;
    int parts = 0;
    for (const auto& d : progress.Done)
    {
      if (d.first == path || (b.Kind == BoxKind::Instance && TopOf(d.first) == path))
      {
        done += d.second;
        ++parts;
      }
    }
    if (progress.Busy && parts > 0 && !this->Given.Plain)
    {
      const float y = c.y - 4 * z;
      list->AddRectFilled(ImVec2(a.x + 5 * z, y), ImVec2(c.x - 5 * z, y + 2 * z), IM_COL32(255, 255, 255, 25));
      list->AddRectFilled(ImVec2(a.x + 5 * z, y),
        ImVec2(a.x + 5 * z + (c.x - a.x - 10 * z) * float(done / parts), y + 2 * z),
        ImGui::GetColorU32(Colors::Accent));
    }
  }
  if (linking && this->Dragging.Moved && this->Dragging.Box < int(this->Boxes.size()))
  {
    const bool fromOutput = this->Dragging.Kind == Drag::What::LinkFromOutput;
    const GraphBox& b = this->Model.Boxes[std::size_t(this->Dragging.Box)];
    const ArrayKind kind =
      fromOutput ? b.Outputs[std::size_t(this->Dragging.Pin)].Kind : b.Inputs[std::size_t(this->Dragging.Pin)].Kind;
    const ImVec2 start = this->ToScreen(this->PinPosition(this->Dragging.Box, this->Dragging.Pin, fromOutput));
    ImVec2 stop = mouse;
    if (linkTo >= 0 && verdict.Ok)
    {
      stop = fromOutput ? this->ToScreen(this->PinPosition(linkTo, linkToPin, false))
                        : this->ToScreen(this->PinPosition(linkFrom, linkFromPin, true));
    }
    const ImVec2 from = fromOutput ? start : stop, to = fromOutput ? stop : start;
    const float reach = std::max(30 * z, std::fabs(to.x - from.x) * 0.5f);
    const ImU32 colour = linkTo >= 0 && !verdict.Ok ? ImGui::GetColorU32(Colors::Error) : KindColor(kind);
    list->AddBezierCubic(
      from, ImVec2(from.x + reach, from.y), ImVec2(to.x - reach, to.y), to, colour, 2.6f * std::max(0.6f, z));
    std::string words;
    if (linkTo >= 0)
    {
      std::string what = this->Model.Reference(linkFrom, linkFromPin);
      if (verdict.Ok)
      {
        const GraphBox& reader = this->Model.Boxes[std::size_t(linkTo)];
        what += " \u2192 " + reader.Id + "." + reader.Inputs[std::size_t(linkToPin)].Name;
      }
      words = verdict.Ok ? what + (verdict.Reason.empty() ? "" : "\n" + verdict.Reason) : verdict.Reason;
    }
    else
    {
      words = fromOutput
                ? b.Outputs[std::size_t(this->Dragging.Pin)].Name + ": let go over nothing for nodes that take it"
                : b.Inputs[std::size_t(this->Dragging.Pin)].Name + ": let go over nothing for nodes that make it";
    }
    ImGui::PushStyleColor(ImGuiCol_Text, linkTo >= 0 && !verdict.Ok ? Colors::Error : Colors::Text);
    ShowTooltip(words, this->S(340));
    ImGui::PopStyleColor();
  }
  else if (hovered && this->Dragging.Kind == Drag::What::None)
  {
    if (pinBox >= 0)
    {
      const GraphBox& b = this->Model.Boxes[std::size_t(pinBox)];
      const GraphPin& p = pinIsOutput ? b.Outputs[std::size_t(pin)] : b.Inputs[std::size_t(pin)];
      ShowTooltip(p.Name + "  " + std::string(KindName(p.Kind)) + (p.Repeatable ? ", several" : "") +
                    (p.Delayed                     ? ", of the previous frame"
                      : p.Optional && !pinIsOutput ? ", optional"
                                                   : "") +
                    (p.Doc.empty() ? "" : "\n" + p.Doc),
        this->S(320));
    }
    else if (this->HoveredLink >= 0)
    {
      const GraphLink& l = this->Model.Links[std::size_t(this->HoveredLink)];
      ShowTooltip(l.Text + " \u2192 " + this->Model.Boxes[std::size_t(l.To)].Id + "." +
                    this->Model.Boxes[std::size_t(l.To)].Inputs[std::size_t(l.ToPin)].Name +
                    (l.Delayed ? "\nreads the previous frame" : "") + "\nright click: insert a node, delete",
        this->S(320));
    }
    else if (overBox >= 0 && this->Checked && this->Checked->Document == this->Doc.Get())
    {
      const std::string path = this->NodePathOf(this->Model.Boxes[std::size_t(overBox)].Id);
      std::string words;
      for (const Diagnostic& d : this->Checked->Messages)
      {
        if (!d.Node.empty() && d.Node == path)
        {
          words += (words.empty() ? "" : "\n") + d.What + (d.Hint.empty() ? "" : "; " + d.Hint);
        }
      }
      if (!words.empty())
      {
        ShowTooltip(words, this->S(340));
      }
    }
  }
  if (this->Dragging.Kind == Drag::What::Rubber && this->Dragging.Moved)
  {
    list->AddRectFilled(this->Dragging.Start, mouse, IM_COL32(90, 165, 240, 28));
    list->AddRect(this->Dragging.Start, mouse, IM_COL32(90, 165, 240, 160));
  }
  if (this->Boxes.empty())
  {
    const char* hint = "Tab or a double click adds a node";
    const ImVec2 t = ImGui::CalcTextSize(hint);
    list->AddText(ImVec2((min.x + end.x - t.x) / 2, (min.y + end.y - t.y) / 2), ImGui::GetColorU32(Colors::Dim), hint);
  }
  list->PopClipRect();

  // ---- a bar on top: where one is, and the palette
  ImGui::SetCursorScreenPos(ImVec2(min.x + this->S(8), min.y + this->S(6)));
  ImGui::BeginGroup();
  if (this->Button("+ Node", "graph/add", "A node of the palette (Tab, or a double click on the canvas)", editable))
  {
    this->PaletteOpen = this->PaletteFocus = true;
    this->PaletteScreen = ImVec2(min.x + this->S(8), min.y + this->S(38));
    this->PaletteAt = this->ToGraph(ImVec2((min.x + end.x) / 2 - 88 * z, (min.y + end.y) / 2 - 30 * z));
    this->PaletteSearch.clear();
    this->PaletteChoice = 0;
    this->PaletteLinkBox = this->PaletteOnLink = -1;
  }
  ImGui::SameLine();
  if (this->Button(
        "Arrange", "graph/arrange", "Producers left of readers, few crossings (L)", !this->Boxes.empty() && editable))
  {
    this->ArrangeAll();
  }
  ImGui::SameLine();
  if (this->Button("Fit", "graph/fit", "See all of it (A)", !this->Boxes.empty()))
  {
    this->FitGraph();
  }
  if (!this->Scope.empty())
  {
    ImGui::SameLine(0, this->S(14));
    if (this->Button("pipeline", "graph/up", "Out of the template (Alt+Up)"))
    {
      ImGui::EndGroup();
      ImGui::End();
      this->EnterScope("");
      return;
    }
    ImGui::SameLine();
    ImGui::AlignTextToFramePadding();
    ImGui::TextColored(Colors::Dim, "\u203a");
    ImGui::SameLine();
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(this->Scope.c_str());
    if (!editable)
    {
      ImGui::SameLine();
      ImGui::TextColored(Colors::Warning, "a template of another file: to look at only");
    }
  }
  ImGui::EndGroup();

  // ---- menus
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(8), this->S(6)));
  if (hovered && ImGui::IsMouseReleased(1) && ImGui::GetMouseDragDelta(1, 0).x == 0)
  {
    if (overBox >= 0)
    {
      const std::string id = this->Model.Boxes[std::size_t(overBox)].Id;
      if (!this->Selected.count(id))
      {
        this->Selected = { id };
      }
      ImGui::OpenPopup("node menu");
    }
    else if (this->HoveredLink >= 0)
    {
      this->PaletteOnLink = this->HoveredLink;
      this->PaletteAt = this->ToGraph(mouse);
      this->PaletteScreen = mouse;
      ImGui::OpenPopup("link menu");
    }
    else if (editable)
    {
      this->PaletteOpen = this->PaletteFocus = true;
      this->PaletteScreen = mouse;
      this->PaletteAt = this->ToGraph(mouse);
      this->PaletteSearch.clear();
      this->PaletteChoice = 0;
      this->PaletteLinkBox = this->PaletteOnLink = -1;
    }
  }
  if (ImGui::BeginPopup("node menu"))
  {
    this->CloseMenuOnEscape();
    const std::string one = this->Selected.size() == 1 ? *this->Selected.begin() : std::string();
    const int index = this->Model.Find(one);
    const GraphBox* b = index >= 0 ? &this->Model.Boxes[std::size_t(index)] : nullptr;
    const bool node = b && (b->Kind == BoxKind::Stage || b->Kind == BoxKind::Instance);
    if (ImGui::MenuItem("Show its picture", nullptr, false, node))
    {
      this->SelectTarget(this->NodePathOf(one), "");
    }
    if (ImGui::MenuItem("Compare with it (B)", nullptr, false, node && this->Scope.empty()))
    {
      this->B = { one, "" };
      this->BFrom = SourceB::Node;
      this->Compared = this->Compared == CompareMode::Off ? CompareMode::Wipe : this->Compared;
    }
    this->Mark("menu/compare");
    if (b && b->Kind == BoxKind::Instance && ImGui::MenuItem("Open the template"))
    {
      this->EnterScope(b->Type);
    }
    ImGui::Separator();
    if (ImGui::MenuItem("Rename\u2026", "F2", false, b && editable && b->Kind != BoxKind::TemplateInputs))
    {
      this->BeginRename(one);
    }
    this->Mark("menu/rename");
    if (ImGui::MenuItem("Duplicate", "Ctrl+D", false, editable))
    {
      this->DuplicateSelection();
    }
    if (ImGui::MenuItem("Copy as XML", "Ctrl+C"))
    {
      this->CopySelection(false);
    }
    if (ImGui::MenuItem("Make a template\u2026", "Ctrl+G", false, this->Scope.empty()))
    {
      this->AskForTemplate();
    }
    this->Mark("menu/template");
    ImGui::Separator();
    if (ImGui::MenuItem("Delete", "Del", false, editable))
    {
      this->DeleteSelection(false);
    }
    this->Mark("menu/delete");
    if (ImGui::MenuItem("Delete and reconnect", "Ctrl+Del", false, editable))
    {
      this->DeleteSelection(true);
    }
    this->Mark("menu/dissolve");
    ImGui::EndPopup();
  }
  if (ImGui::BeginPopup("link menu"))
  {
    this->CloseMenuOnEscape();
    if (this->PaletteOnLink >= 0 && this->PaletteOnLink < int(this->Model.Links.size()))
    {
      const GraphLink l = this->Model.Links[std::size_t(this->PaletteOnLink)];
      const GraphBox& to = this->Model.Boxes[std::size_t(l.To)];
      ImGui::TextColored(Colors::Dim, "%s", l.Text.c_str());
      if (ImGui::MenuItem("Insert a node\u2026", nullptr, false, editable && to.Kind != BoxKind::TemplateOutput))
      {
        this->PaletteOpen = this->PaletteFocus = true;
        this->PaletteSearch.clear();
        this->PaletteChoice = 0;
        this->PaletteLinkBox = -1;
      }
      this->Mark("menu/insert");
      const bool canDelay = l.ToPin > 0 && (to.Kind == BoxKind::Stage || to.Kind == BoxKind::Instance);
      if (ImGui::MenuItem("Read the previous frame", nullptr, l.Delayed, editable && (canDelay || l.Delayed)))
      {
        this->Doc.SetDelay(this->Scope, to.Id, l.Index, !l.Delayed);
      }
      ImGui::Separator();
      if (ImGui::MenuItem("Delete the link", nullptr, false, editable))
      {
        this->Doc.Disconnect(this->Scope, to.Id, l.Index);
        this->PaletteOnLink = -1;
      }
      this->Mark("menu/unlink");
    }
    ImGui::EndPopup();
  }
  ImGui::PopStyleVar();
  ImGui::End();

  if (!this->Renaming.empty())
  {
    const int index = this->Model.Find(this->Renaming);
    if (index < 0)
    {
      this->Renaming.clear();
    }
    else
    {
      const BoxLayout& l = this->Boxes[std::size_t(index)];
      ImGui::SetNextWindowPos(this->ToScreen(l.Position));
      ImGui::SetNextWindowSize(ImVec2(std::max(this->S(160), l.Size.x * z), 0));
      ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(3), this->S(3)));
      ImGui::Begin("##rename", nullptr,
        ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings);
      if (this->RenameFocus)
      {
        ImGui::SetWindowFocus();
        ImGui::SetKeyboardFocusHere();
      }
      ImGui::SetNextItemWidth(-1);
      const bool enter = ImGui::InputText(
        "##name", &this->RenameText, ImGuiInputTextFlags_EnterReturnsTrue | ImGuiInputTextFlags_AutoSelectAll);
      this->Mark("rename");
      const bool left = !this->RenameFocus && ImGui::IsItemDeactivated();
      this->RenameFocus = false;
      this->PropertyErrorText(this->Renaming + ".rename");
      if (this->Win.Pressed("Escape"))
      {
        this->Renaming.clear();
      }
      else if (enter || left)
      {
        std::string error;
        const bool output = this->Renaming.compare(0, 7, "output:") == 0;
        const bool port = this->Renaming.compare(0, 5, "port:") == 0;
        if (port ? this->Doc.RenameTemplatePort(this->Scope, this->Renaming.substr(5), this->RenameText, error)
                 : this->Doc.Rename(this->Scope, this->Renaming, this->RenameText, error))
        {
          this->RenameGiven(this->Renaming, this->RenameText);
          if (this->A.Node == this->Renaming && this->Scope.empty())
          {
            this->A.Node = this->RenameText;
          }
          this->Selected = { (output ? "output:" : port ? "port:" : "") + this->RenameText };
          this->Renaming.clear();
        }
        else if (enter)
        {
          // Another name can be typed where the wrong one was.
          this->PropertyError = error;
          this->PropertyErrorOf = this->Renaming + ".rename";
          this->PropertyErrorAt = this->Doc.Revision();
          this->RenameFocus = true;
        }
        else
        {
          this->Tell(error, true);
          this->Renaming.clear();
        }
      }
      ImGui::End();
      ImGui::PopStyleVar();
    }
  }
  this->PaletteWindow();
  if (hasMessages)
  {
    this->MessagesPanel(ImVec2(min.x, end.y), max);
  }
}
}
