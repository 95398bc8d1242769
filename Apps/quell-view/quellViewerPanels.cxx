// SPDX-License-Identifier: BSD-3-Clause
// The right side: properties, pixel, comparison, the trade-off, the pipeline as a whole, and the list of mistakes.
#include "quellUi.h"
#include "quellViewer.h"
#include "vtkImageData.h"

#include <imgui_internal.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <set>

namespace quell
{
namespace
{
bool IsVariable(const std::string& text)
{
  return text.find("$(") != std::string::npos;
}

/// The number with its meaning, as a format without anything to fill in; empty: `fallback` shows it.
std::string SliderFormat(const Property& p, double value, const char* fallback, float width)
{
  const std::string meaning = MeaningOf(p, value);
  if (meaning.empty())
  {
    return fallback;
  }
  char number[48];
  std::snprintf(number, sizeof number, "%.4g", value);
  const std::string whole = std::fabs(value) >= 1e29 ? meaning : std::string(number) + ": " + meaning;
  std::string format;
  for (char c : Fitted(whole, width))
  {
    format += c == '%' ? "%%" : std::string(1, c);
  }
  return format;
}

/// Where a slider's ends are: a parameter's range may be far wider than what anybody uses.
void SliderRange(const Property& p, double now, double& low, double& high)
{
  low = p.Minimum;
  high = p.Maximum;
  if (high - low <= 1000 && std::isfinite(high - low))
  {
    return;
  }
  double middle = 0;
  std::string error;
  detail::ParseDouble(p.DefaultText, -1e308, 1e308, middle, error);
  const double reach =
    std::max({ 4 * std::fabs(middle), 2 * std::fabs(now), p.Kind == Property::Type::Int ? 16. : 1. });
  low = std::max(p.Minimum, p.Minimum >= 0 ? p.Minimum : -reach);
  high = std::min(p.Maximum, reach);
}
}

std::string Viewer::NodePathOf(const std::string& box) const
{
  // A template's nodes are shown as one of its instances runs them.
  if (this->Scope.empty())
  {
    return box;
  }
  for (const PipelineNode& n : this->Doc.Nodes(""))
  {
    if (n.IsInstance && n.Type.Value == this->Scope)
    {
      return n.Id.Value + "/" + box;
    }
  }
  return {};
}

/// With what the variables stand for now: -D first, in a template what its first instance gives.
std::string Viewer::ValueNow(const std::string& scope, const std::string& text, int depth) const
{
  std::string result;
  std::size_t at = 0;
  for (std::size_t open = text.find("$("); open != std::string::npos && depth < 8; open = text.find("$(", at))
  {
    const std::size_t close = text.find(')', open);
    if (close == std::string::npos)
    {
      break;
    }
    result += text.substr(at, open - at);
    at = close + 1;
    const std::string name = text.substr(open + 2, close - open - 2);
    std::string value = text.substr(open, at - open);
    for (const PipelineVariable& v : this->Doc.Get()->Variables)
    {
      value = v.Name.Value == name ? v.Default.Value : value;
    }
    for (const auto& d : this->Given.Graph.Defines)
    {
      value = d.first == name ? d.second : value;
    }
    if (const PipelineTemplate* t = scope.empty() ? nullptr : this->Doc.FindTemplate(scope))
    {
      for (const PipelineVariable& v : t->Parameters)
      {
        if (v.Name.Value != name)
        {
          continue;
        }
        const PipelineText* given = this->Doc.FindProperty("", TopOf(this->NodePathOf("")), name);
        value = given ? this->ValueNow("", given->Value, depth + 1) : v.Default.Value;
      }
    }
    result += value;
  }
  return result + text.substr(at);
}

std::optional<std::pair<std::string, std::string>> Viewer::GivenProperty(
  const std::string& scope, const std::string& box, const std::string& name) const
{
  std::optional<std::pair<std::string, std::string>> found;
  const PipelineNode* node = this->Doc.FindNode(scope, box);
  if (name == "Seed" && this->Given.Graph.Seed && node && !node->IsInstance)
  {
    found = { std::to_string(*this->Given.Graph.Seed), "--seed" };
  }
  const std::string path = this->NodePathOf(box) + "." + name;
  for (const auto& p : this->Given.Graph.Properties)
  {
    if (p.first == path)
    {
      found = { p.second, "--set" };
    }
  }
  return found;
}

std::optional<std::pair<std::string, std::string>> Viewer::GivenVariable(const std::string& name) const
{
  std::optional<std::pair<std::string, std::string>> found;
  for (const auto& d : this->Given.Graph.Defines)
  {
    if (d.first == name)
    {
      found = { d.second, "-D" };
    }
  }
  return found;
}

void Viewer::DropGivenProperty(const std::string& scope, const std::string& box, const std::string& name)
{
  const auto given = this->GivenProperty(scope, box, name);
  if (!given)
  {
    return;
  }
  const std::string path = this->NodePathOf(box) + "." + name;
  GraphOptions::Assignments& all = this->Given.Graph.Properties;
  all.erase(std::remove_if(all.begin(), all.end(), [&](const auto& p) { return p.first == path; }), all.end());
  if (name == "Seed")
  {
    this->Given.Graph.Seed.reset();
  }
  this->Tell(path + ": " + given->second + " " + given->first + " of the command line counts no longer");
}

void Viewer::DropGivenVariable(const std::string& name)
{
  const auto given = this->GivenVariable(name);
  if (!given)
  {
    return;
  }
  GraphOptions::Assignments& all = this->Given.Graph.Defines;
  all.erase(std::remove_if(all.begin(), all.end(), [&](const auto& p) { return p.first == name; }), all.end());
  this->Tell(name + ": " + given->second + " " + given->first + " of the command line counts no longer");
}

void Viewer::RenameGiven(const std::string& box, const std::string& name)
{
  const std::string path = this->NodePathOf(box), now = this->NodePathOf(name);
  for (auto& p : this->Given.Graph.Properties)
  {
    const bool is = p.first.compare(0, path.size(), path) == 0 && p.first.size() > path.size() &&
                    (p.first[path.size()] == '.' || p.first[path.size()] == '/');
    p.first = is ? now + p.first.substr(path.size()) : p.first;
  }
}

void Viewer::PropertyErrorText(const std::string& of)
{
  if (this->PropertyErrorOf != of || this->PropertyErrorAt != this->Doc.Revision())
  {
    return;
  }
  ImGui::PushFont(this->Win.Small());
  ImGui::PushTextWrapPos(0);
  ImGui::TextColored(Colors::Error, "%s", this->PropertyError.c_str());
  ImGui::PopTextWrapPos();
  ImGui::PopFont();
  this->Mark("error/" + of);
}

void Viewer::RenameFromPanel(const std::string& box, const std::string& name)
{
  std::string error;
  const bool output = box.compare(0, 7, "output:") == 0;
  if (this->Doc.Rename(this->Scope, box, name, error))
  {
    this->RenameGiven(box, name);
    if (this->A.Node == box && this->Scope.empty())
    {
      this->A.Node = name;
    }
    this->Selected = { output ? "output:" + name : name };
    return;
  }
  this->PropertyError = error;
  this->PropertyErrorOf = box + ".name";
  this->PropertyErrorAt = this->Doc.Revision();
}

void Viewer::PropertyMenu(
  const std::string& scope, const std::string& box, const Property& row, const std::string& shown)
{
  if (!ImGui::BeginPopupContextItem("menu"))
  {
    return;
  }
  this->CloseMenuOnEscape();
  const PipelineText* written = this->Doc.FindProperty(scope, box, row.Name);
  if (ImGui::MenuItem("Back to the default", row.DefaultText.c_str(), false, written != nullptr))
  {
    this->Doc.ResetProperty(scope, box, row.Name);
  }
  this->Mark("menu/reset");
  ImGui::Separator();
  const bool node = this->Doc.FindNode(scope, box) && !this->Doc.FindNode(scope, box)->IsInstance;
  if (ImGui::MenuItem(scope.empty() ? "Make it a variable" : "Make it a parameter of the template", nullptr, false,
        node && !IsVariable(shown)))
  {
    const std::string name = this->Doc.MakeVariable(scope, box, row, shown);
    this->Tell(scope.empty() ? "variable " + name + "; see Pipeline" : "parameter " + name + " of its instances");
  }
  this->Mark("menu/make-variable");
  std::vector<std::pair<std::string, std::string>> names;
  if (!scope.empty())
  {
    if (const PipelineTemplate* t = this->Doc.FindTemplate(scope))
    {
      for (const PipelineVariable& v : t->Parameters)
      {
        names.emplace_back(v.Name.Value, v.Default.Value);
      }
    }
  }
  for (const PipelineVariable& v : this->Doc.Get()->Variables)
  {
    names.emplace_back(v.Name.Value, v.Default.Value);
  }
  if (ImGui::BeginMenu("Read a variable", !names.empty()))
  {
    for (const auto& v : names)
    {
      if (ImGui::MenuItem(v.first.c_str(), v.second.c_str()))
      {
        this->Doc.SetProperty(scope, box, row.Name, "$(" + v.first + ")");
      }
      this->Mark("menu/variable/" + v.first);
    }
    ImGui::EndMenu();
  }
  this->Mark("menu/variables");
  ImGui::EndPopup();
}

void Viewer::PropertyRow(const std::string& scope, const std::string& box, const Property& row)
{
  const PipelineText* written = this->Doc.FindProperty(scope, box, row.Name);
  auto given = this->GivenProperty(scope, box, row.Name);
  const std::string mark = "property/" + row.Name;
  ImGui::PushID(row.Name.c_str());
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  ImGui::AlignTextToFramePadding();
  ImGui::PushFont(this->Win.Small());
  const float labelWidth = ImGui::GetContentRegionAvail().x;
  ImGui::TextColored(given     ? Colors::Accent
                     : written ? Colors::Text
                               : Colors::Dim,
    "%s", Fitted(row.Name, labelWidth).c_str());
  ImGui::PopFont();
  this->Mark("label/" + row.Name);
  if (this->Doc.IsEditable(scope))
  {
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(8), this->S(6)));
    const std::uint64_t before = this->Doc.Revision();
    this->PropertyMenu(scope, box, row, written ? written->Value : row.DefaultText);
    ImGui::PopStyleVar();
    // What the menu may have changed.
    written = this->Doc.FindProperty(scope, box, row.Name);
    if (given && this->Doc.Revision() != before)
    {
      this->DropGivenProperty(scope, box, row.Name);
      given.reset();
    }
  }
  std::string range = RangeOf(row);
  this->Tooltip(row.Name + (row.Unit.empty() ? "" : "  [" + row.Unit + "]") + "\n" + row.Doc + "\n" +
                (range.empty() ? "" : "range " + range + ", ") + "default " +
                (row.DefaultText.empty() ? "empty" : row.DefaultText) + "\nright click: variables");
  ImGui::TableNextColumn();
  const float reset = ImGui::GetFrameHeight() + this->S(8);
  const bool editable = this->Doc.IsEditable(scope);
  const auto set = [&](const std::string& text, bool merge)
  {
    std::string error;
    const vtkSmartPointer<vtkQuellStage> probe = this->Registry.Create(
      this->Doc.FindNode(scope, box) ? this->Doc.FindNode(scope, box)->Type.Value : std::string());
    if (!IsVariable(text) && probe && !row.SetText(probe, text, error))
    {
      this->PropertyError = error;
      this->PropertyErrorOf = box + "." + row.Name;
      this->PropertyErrorAt = this->Doc.Revision();
      return;
    }
    this->PropertyErrorOf.clear();
    this->HurryNext = !merge;
    if (!merge && !written && !given && text == row.DefaultText)
    {
      return;
    }
    this->Doc.SetProperty(scope, box, row.Name, text, merge);
    // Whoever turns a knob wants to see it turn.
    this->DropGivenProperty(scope, box, row.Name);
  };
  ImGui::BeginDisabled(!editable);
  const std::string inFile = written ? written->Value : row.DefaultText;
  const std::string shown = given ? given->first : inFile;
  ImGui::SetNextItemWidth(-reset);
  const bool variable = (given || written) && IsVariable(shown);
  const std::string key = scope + "/" + box + "." + row.Name;
  const auto text = [&](const char* hint)
  {
    // What is being typed is its own until Enter or another place takes the focus.
    std::string& edit = this->EditTexts[key];
    const ImGuiID id = ImGui::GetID("##text");
    if (ImGui::GetActiveID() != id)
    {
      edit = shown;
    }
    ImGui::InputTextWithHint("##text", hint, &edit);
    if (ImGui::IsItemDeactivatedAfterEdit() && edit != shown)
    {
      set(edit, false);
    }
  };
  double v = 0;
  std::string error, expanded;
  const bool file = row.Kind == Property::Type::Path || (row.Kind == Property::Type::String && row.Name == "File");
  const auto chooser = [&](const std::string& purpose)
  {
    ImGui::SameLine(0, this->S(3));
    if (ImGui::Button("\u2026", ImVec2(this->S(26), 0)))
    {
      this->OpenFileDialog(purpose, row.Name + " of " + box,
        row.Kind == Property::Type::String ? ".exr .hdr .png .jpg .tif .bmp .tga"
        : row.Name == "Scene"              ? ".gltf .glb .obj"
        : row.Name == "Config"             ? ".ocio"
                                           : ".exr .hdr .png .jpg .pfm .pgm .ppm");
      // Where the file is that stands here now.
      std::error_code ec;
      const std::filesystem::path now = this->ValueNow(scope, shown);
      const std::filesystem::path place =
        std::filesystem::absolute(std::filesystem::path(this->Doc.Get()->Directory) / now, ec)
          .lexically_normal()
          .parent_path();
      if (row.Kind == Property::Type::Path && !now.empty() && !ec && std::filesystem::is_directory(place, ec))
      {
        this->DialogDirectory = place.string();
      }
    }
    this->Mark(mark + "/choose");
    this->Tooltip(
      purpose.compare(0, 9, "variable:") == 0 ? "Another file for variable " + purpose.substr(9) : "Choose a file");
  };
  if (variable)
  {
    // The variable that stands here alone can get another file.
    const std::string& all = shown;
    const std::string name =
      all.compare(0, 2, "$(") == 0 && all.find(')') == all.size() - 1 ? all.substr(2, all.size() - 3) : std::string();
    const std::vector<PipelineVariable>& known = this->Doc.Get()->Variables;
    const bool choose =
      file && scope.empty() &&
      std::any_of(known.begin(), known.end(), [&name](const PipelineVariable& one) { return one.Name.Value == name; });
    ImGui::SetNextItemWidth(-reset - (choose ? this->S(30) : 0.f));
    text("");
    this->Mark(mark);
    const std::string now = this->ValueNow(scope, all);
    this->Tooltip("= " + now + "\na variable of the pipeline gives this value; it can be changed under Pipeline");
    if (choose)
    {
      chooser("variable:" + name);
    }
    const auto fromOutside = this->GivenVariable(name);
    expanded = "= " + (file && !now.empty() ? std::filesystem::path(now).filename().string() : now);
    expanded += fromOutside ? "  (" + fromOutside->second + ")" : std::string();
  }
  else if (row.Kind == Property::Type::Bool)
  {
    bool on = shown == "true" || shown == "1" || shown == "on" || shown == "yes";
    if (ImGui::Checkbox("##bool", &on))
    {
      set(on ? "true" : "false", false);
    }
    this->Mark(mark);
  }
  else if (row.Kind == Property::Type::Enum)
  {
    if (ImGui::BeginCombo("##enum", shown.c_str()))
    {
      for (const std::string& e : row.Enumerators)
      {
        if (ImGui::Selectable(e.c_str(), e == shown))
        {
          set(e, false);
        }
        this->Mark(mark + "/" + e);
      }
      ImGui::EndCombo();
    }
    this->Mark(mark);
  }
  else if ((row.Kind == Property::Type::Int || row.Kind == Property::Type::Double) &&
           detail::ParseDouble(shown, -1e308, 1e308, v, error))
  {
    double low = 0, high = 1;
    SliderRange(row, v, low, high);
    if (row.Kind == Property::Type::Int)
    {
      const double limit = 1e9;
      int i = int(std::min(limit, std::max(-limit, v)));
      if (ImGui::SliderInt("##int", &i, int(std::max(-limit, low)), int(std::min(limit, high)),
            SliderFormat(row, v, "%d", ImGui::GetContentRegionAvail().x - reset - this->S(28)).c_str()))
      {
        set(std::to_string(i), true);
      }
    }
    else
    {
      double d = v;
      const bool wide = low >= 0 && high > 20 * std::max(1e-6, std::fabs(v));
      if (ImGui::SliderScalar("##double", ImGuiDataType_Double, &d, &low, &high,
            SliderFormat(
              row, d, std::fabs(d) >= 1e5 ? "%.3g" : "%.4g", ImGui::GetContentRegionAvail().x - reset - this->S(28))
              .c_str(),
            wide ? ImGuiSliderFlags_Logarithmic : ImGuiSliderFlags_None))
      {
        char rounded[48];
        std::snprintf(rounded, sizeof rounded, "%.4g", d);
        set(rounded, true);
      }
    }
    this->Mark(mark);
    this->Tooltip("drag, or Ctrl+click to type" + (range.empty() ? std::string() : "; range " + range));
  }
  else if (file)
  {
    ImGui::SetNextItemWidth(-reset - this->S(30));
    text("no file");
    this->Mark(mark);
    this->Tooltip(shown.empty() ? row.Doc : shown);
    chooser((row.Kind == Property::Type::Path ? "property:" : "output:") + box + "." + row.Name);
  }
  else
  {
    text("");
    this->Mark(mark);
  }
  if (given)
  {
    expanded = given->second + "; " + (written ? "the file has " : "default ") + (inFile.empty() ? "nothing" : inFile);
  }
  if (given || written)
  {
    ImGui::SameLine(0, this->S(3));
    if (ImGui::Button("\u21ba", ImVec2(ImGui::GetFrameHeight(), 0)))
    {
      if (given)
      {
        this->DropGivenProperty(scope, box, row.Name);
      }
      else
      {
        this->Doc.ResetProperty(scope, box, row.Name);
      }
    }
    this->Mark(mark + "/reset");
    this->Tooltip(given ? "What the file has, instead of " + given->second + " on the command line"
                        : "Back to the default, " + (row.DefaultText.empty() ? "empty" : row.DefaultText));
  }
  ImGui::EndDisabled();
  if (!expanded.empty())
  {
    ImGui::PushFont(this->Win.Small());
    ImGui::SetCursorPosX(ImGui::GetCursorPosX() + ImGui::GetStyle().FramePadding.x);
    ImGui::TextColored(given ? Colors::Accent : Colors::Dim, "%s",
      Fitted(expanded, ImGui::GetContentRegionAvail().x - (given ? 0 : reset)).c_str());
    this->Tooltip(expanded);
    ImGui::PopFont();
    this->MarkRect(mark + "/value " + expanded, ImGui::GetItemRectMin(), ImGui::GetItemRectMax());
  }
  this->PropertyErrorText(box + "." + row.Name);
  ImGui::PopID();
}

void Viewer::MistakesOf(const std::string& box)
{
  if (this->Checked)
  {
    for (const Diagnostic& d : this->Checked->Messages)
    {
      if (!d.Node.empty() && (d.Node == box || TopOf(d.Node) == box) && this->Scope.empty())
      {
        ImGui::PushTextWrapPos(0);
        ImGui::TextColored(d.Level == Severity::Error ? Colors::Error : Colors::Warning, "%s%s%s", d.What.c_str(),
          d.Hint.empty() ? "" : "\n", d.Hint.c_str());
        ImGui::PopTextWrapPos();
      }
    }
  }
}

void Viewer::PropertiesTab()
{
  std::string box = this->Selected.size() == 1 ? *this->Selected.begin() : std::string();
  if (box.empty() && this->Selected.empty() && this->Scope.empty())
  {
    box = TopOf(this->A.Node);
  }
  const int index = this->Model.Find(box);
  if (!this->Scope.empty() &&
      ((index < 0 && this->Selected.empty()) ||
        (index >= 0 && (this->Model.Boxes[std::size_t(index)].Kind == BoxKind::TemplateInputs ||
                         this->Model.Boxes[std::size_t(index)].Kind == BoxKind::TemplateOutput))))
  {
    this->TemplatePanel();
    return;
  }
  if (index < 0)
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Dim, "%s",
      this->Selected.size() > 1 ? (std::to_string(this->Selected.size()) + " nodes are selected; one at a time has "
                                                                           "properties to change.")
                                    .c_str()
                                : "Select a node to see what it does and to change it.");
    ImGui::PopTextWrapPos();
    return;
  }
  const GraphBox& b = this->Model.Boxes[std::size_t(index)];
  Heading(this->Win, b.Title.c_str());
  ImGui::SameLine();
  ImGui::TextColored(b.Known ? Colors::Dim : Colors::Error, "%s",
    b.Kind == BoxKind::Output           ? "output"
    : b.Kind == BoxKind::TemplateInputs ? "the template's inputs"
    : b.Kind == BoxKind::TemplateOutput ? "the template's output"
    : b.Known                           ? b.Type.c_str()
                                        : (b.Type + ": no such type").c_str());
  ImGui::PushFont(this->Win.Small());
  ImGui::PushTextWrapPos(0);
  const std::string doc = !b.Doc.empty() ? b.Doc : b.Description ? b.Description->Brief : std::string();
  if (!doc.empty())
  {
    ImGui::TextColored(Colors::Dim, "%s", doc.c_str());
    if (b.Description)
    {
      this->Tooltip(b.Description->Details);
    }
  }
  ImGui::PopTextWrapPos();
  ImGui::PopFont();
  ImGui::Dummy(ImVec2(0, this->S(3)));
  const auto table = [&](const char* id)
  {
    const bool open = ImGui::BeginTable(id, 2, ImGuiTableFlags_SizingStretchProp);
    if (open)
    {
      ImGui::TableSetupColumn("name", ImGuiTableColumnFlags_WidthStretch, 0.42f);
      ImGui::TableSetupColumn("value", ImGuiTableColumnFlags_WidthStretch, 0.58f);
    }
    return open;
  };
  const auto textRow = [&](const char* name, const std::string& key, const std::string& now, const char* hint,
                         const char* help, const std::function<void(const std::string&)>& set)
  {
    ImGui::TableNextRow();
    ImGui::TableNextColumn();
    ImGui::AlignTextToFramePadding();
    ImGui::PushFont(this->Win.Small());
    ImGui::TextColored(now.empty() ? Colors::Dim : Colors::Text, "%s", name);
    ImGui::PopFont();
    this->Tooltip(help);
    ImGui::TableNextColumn();
    ImGui::PushID(name);
    ImGui::SetNextItemWidth(-1);
    std::string& edit = this->EditTexts[key];
    if (ImGui::GetActiveID() != ImGui::GetID("##t"))
    {
      edit = now;
    }
    ImGui::InputTextWithHint("##t", hint, &edit);
    if (ImGui::IsItemDeactivatedAfterEdit() && edit != now)
    {
      set(edit);
    }
    this->Mark("property/" + std::string(name));
    this->PropertyErrorText(key);
    ImGui::PopID();
  };
  if (b.Kind == BoxKind::Output)
  {
    for (const PipelineOutput& o : this->Doc.Get()->Outputs)
    {
      if ("output:" + o.Name.Value != box)
      {
        continue;
      }
      const std::string name = o.Name.Value;
      if (table("output"))
      {
        textRow("name", box + ".name", name, "", "what the command line calls it",
          [&](const std::string& v) { this->RenameFromPanel(box, v); });
        textRow("file", box + ".file", o.File.Value, "none: only a name",
          "what is written; #### becomes the frame's number, without it only the last frame is written",
          [&](const std::string& v) { this->Doc.SetOutput(name, "file", v); });
        textRow("view", box + ".view", o.View.Value, "none: linear values",
          "OpenColorIO view that the picture goes through, for PNG and JPEG",
          [&](const std::string& v) { this->Doc.SetOutput(name, "view", v); });
        ImGui::EndTable();
      }
      return;
    }
    return;
  }
  if (const PipelineNode* node = this->Doc.FindNode(this->Scope, box))
  {
    if (table("node"))
    {
      textRow("name", box + ".name", box, "", "how links and the command line call this node",
        [&](const std::string& v) { this->RenameFromPanel(box, v); });
      ImGui::EndTable();
    }
    ImGui::Separator();
    if (node->IsInstance)
    {
      const PipelineTemplate* t = this->Doc.FindTemplate(node->Type.Value);
      if (t && table("parameters"))
      {
        for (const PipelineVariable& v : t->Parameters)
        {
          Property row;
          row.Name = v.Name.Value;
          row.Doc = v.Doc.Value;
          row.DefaultText = v.Default.Value;
          row.Kind = v.Type.Value == "bool"     ? Property::Type::Bool
                     : v.Type.Value == "path"   ? Property::Type::Path
                     : v.Type.Value == "int"    ? Property::Type::Int
                     : v.Type.Value == "double" ? Property::Type::Double
                                                : Property::Type::String;
          row.Minimum = -1e300;
          row.Maximum = 1e300;
          // What a node of the template makes of it says what it may be.
          for (const PipelineNode& inner : t->Nodes)
          {
            const StageDescription* type = inner.IsInstance ? nullptr : this->Registry.Describe(inner.Type.Value);
            for (const PipelineProperty& p : inner.Properties)
            {
              const Property* fed =
                type && p.Value.Value == "$(" + row.Name + ")" ? type->FindProperty(p.Name.Value) : nullptr;
              if (fed)
              {
                row.Minimum = fed->Minimum;
                row.Maximum = fed->Maximum;
                row.Unit = fed->Unit;
                row.Kind = fed->Kind;
                row.Enumerators = fed->Enumerators;
                row.Doc = row.Doc.empty() ? fed->Doc : row.Doc;
              }
            }
          }
          if (row.Maximum >= 1e300 && (row.Kind == Property::Type::Int || row.Kind == Property::Type::Double))
          {
            double d = 0;
            std::string error;
            detail::ParseDouble(row.DefaultText, -1e300, 1e300, d, error);
            row.Minimum = std::max(row.Minimum, d >= 0 ? 0 : -1e300);
          }
          this->PropertyRow(this->Scope, box, row);
        }
        ImGui::EndTable();
      }
      if (this->Button("Open the template", "template/open",
            t && !this->Doc.IsEditable(node->Type.Value) ? "It is another file's: to look at, or to copy into this one"
                                                         : nullptr))
      {
        this->EnterScope(node->Type.Value);
      }
    }
    else if (b.Description && table("properties"))
    {
      const std::vector<std::string> names = [&]
      {
        std::vector<std::string> n;
        for (const PipelineProperty& p : node->Properties)
        {
          n.push_back(p.Name.Value);
        }
        return n;
      }();
      for (const Property& row : b.Description->Properties)
      {
        this->PropertyRow(this->Scope, box, row);
      }
      ImGui::EndTable();
      if (b.Description->Properties.empty())
      {
        ImGui::PushTextWrapPos(0);
        ImGui::TextColored(Colors::Dim, "It has nothing to set.");
        ImGui::PopTextWrapPos();
      }
    }
    // Its links.
    if (!node->Inputs.empty() || !b.Inputs.empty())
    {
      ImGui::Dummy(ImVec2(0, this->S(4)));
      ImGui::PushFont(this->Win.Small());
      ImGui::PushStyleColor(ImGuiCol_Header, ImGui::GetStyleColorVec4(ImGuiCol_Button));
      const bool open = ImGui::CollapsingHeader("Inputs");
      ImGui::PopStyleColor();
      if (open)
      {
        for (const GraphPin& pin : b.Inputs)
        {
          bool any = false;
          for (std::size_t i = 0; i < node->Inputs.size(); ++i)
          {
            const PipelineInput& input = node->Inputs[i];
            if (input.Port.Value != pin.Name)
            {
              continue;
            }
            any = true;
            ImGui::PushID(int(i));
            ImGui::Text("%s", pin.Name.c_str());
            this->Tooltip(pin.Doc);
            ImGui::SameLine(this->S(110));
            ImGui::TextColored(
              Colors::Dim, "%s%s", input.From.Value.c_str(), input.Delay.Given ? "  (previous frame)" : "");
            ImGui::SameLine(ImGui::GetWindowWidth() - this->S(44));
            if (ImGui::SmallButton("\u2715"))
            {
              this->Doc.Disconnect(this->Scope, box, int(i));
              ImGui::PopID();
              break;
            }
            ImGui::PopID();
          }
          if (!any)
          {
            ImGui::TextColored(pin.Optional ? Colors::Dim : Colors::Warning, "%s", pin.Name.c_str());
            this->Tooltip(pin.Doc);
            ImGui::SameLine(this->S(110));
            ImGui::TextColored(pin.Optional ? Colors::Dim : Colors::Warning, "%s",
              pin.Optional ? "not connected" : "has to be connected");
          }
        }
      }
      ImGui::PopFont();
    }
  }
  // Below, so that nothing jumps away under the mouse when the check comes back.
  ImGui::Dummy(ImVec2(0, this->S(4)));
  this->MistakesOf(box);
}

/// Ports of the template that is open, and what to do where it is another file's.
void Viewer::TemplatePanel()
{
  const PipelineTemplate* found = this->Doc.FindTemplate(this->Scope);
  if (!found)
  {
    return;
  }
  const PipelineTemplate t = *found; // edits below replace the document
  Heading(this->Win, this->Scope.c_str());
  ImGui::SameLine();
  ImGui::TextColored(Colors::Dim, "template");
  ImGui::PushFont(this->Win.Small());
  ImGui::PushTextWrapPos(0);
  if (!t.Doc.Value.empty())
  {
    ImGui::TextColored(Colors::Dim, "%s", t.Doc.Value.c_str());
  }
  const bool editable = this->Doc.IsEditable(this->Scope);
  if (!editable)
  {
    ImGui::Dummy(ImVec2(0, this->S(4)));
    ImGui::TextColored(Colors::Warning, "It belongs to %s.", ShortPath(t.Place.File).c_str());
    this->Tooltip(t.Place.File);
  }
  ImGui::PopTextWrapPos();
  ImGui::PopFont();
  if (!editable)
  {
    if (this->Button("Copy it into this file", "template/adopt",
          "The instances here become the copy's, which can be edited; the other file stays as it is"))
    {
      std::string error;
      const std::string made = this->Doc.AdoptTemplate(this->Scope, error);
      if (made.empty())
      {
        this->Tell(error, true);
      }
      else
      {
        this->EnterScope(made);
      }
      return;
    }
    ImGui::SameLine();
    if (this->Button("Open that file", "template/file", "To change the template for every pipeline that includes it"))
    {
      this->AskToClose("file:" + t.Place.File);
      return;
    }
  }
  ImGui::Dummy(ImVec2(0, this->S(6)));
  std::string remove;
  std::pair<std::string, std::string> renamed;
  const auto table = [&](const char* title, const std::vector<PipelinePort>& ports, bool inputs)
  {
    Heading(this->Win, title);
    if (ports.empty())
    {
      ImGui::TextColored(Colors::Dim, "none");
    }
    if (ImGui::BeginTable(title, 3, ImGuiTableFlags_SizingStretchProp | ImGuiTableFlags_RowBg))
    {
      ImGui::TableSetupColumn("name", ImGuiTableColumnFlags_WidthStretch, 0.45f);
      ImGui::TableSetupColumn("what", ImGuiTableColumnFlags_WidthStretch, 0.5f);
      ImGui::TableSetupColumn("delete", ImGuiTableColumnFlags_WidthFixed, this->S(22));
      ImGui::PushFont(this->Win.Small());
      for (const PipelinePort& p : ports)
      {
        ImGui::PushID(p.Name.Value.c_str());
        ImGui::TableNextRow();
        ImGui::TableNextColumn();
        if (editable)
        {
          std::string& edit = this->EditTexts["port " + this->Scope + " " + p.Name.Value];
          if (ImGui::GetActiveID() != ImGui::GetID("##port"))
          {
            edit = p.Name.Value;
          }
          ImGui::SetNextItemWidth(-1);
          ImGui::InputText("##port", &edit);
          if (ImGui::IsItemDeactivatedAfterEdit() && edit != p.Name.Value)
          {
            renamed = { p.Name.Value, edit };
          }
          this->Mark("port/rename/" + p.Name.Value);
          this->Tooltip((p.Doc.Value.empty() ? std::string() : p.Doc.Value + "\n") + "type to rename; links follow");
          this->PropertyErrorText("port:" + this->Scope + "." + p.Name.Value);
        }
        else
        {
          ImGui::TextUnformatted(p.Name.Value.c_str());
          this->Tooltip(p.Doc.Value);
        }
        ImGui::TableNextColumn();
        const std::string what = inputs ? p.Type.Value : p.From.Value;
        ImGui::TextColored(what.empty() && !inputs ? Colors::Warning : Colors::Dim, "%s",
          what.empty() ? (inputs ? "any" : "has to be connected") : what.c_str());
        ImGui::TableNextColumn();
        if (editable && (inputs || ports.size() > 1) && ImGui::SmallButton("\u2715"))
        {
          remove = p.Name.Value;
        }
        this->Mark("port/delete/" + p.Name.Value);
        ImGui::PopID();
      }
      ImGui::PopFont();
      ImGui::EndTable();
    }
  };
  table("Inputs", t.Inputs, true);
  ImGui::Dummy(ImVec2(0, this->S(4)));
  table("Outputs", t.Outputs, false);
  if (!remove.empty())
  {
    this->Doc.RemoveTemplatePort(this->Scope, remove);
  }
  if (!renamed.first.empty())
  {
    std::string error;
    if (!this->Doc.RenameTemplatePort(this->Scope, renamed.first, renamed.second, error))
    {
      this->PropertyError = error;
      this->PropertyErrorOf = "port:" + this->Scope + "." + renamed.first;
      this->PropertyErrorAt = this->Doc.Revision();
    }
    return;
  }
  if (!editable)
  {
    return;
  }
  ImGui::Dummy(ImVec2(0, this->S(6)));
  ImGui::SetNextItemWidth(this->S(110));
  ImGui::InputTextWithHint("##newport", "new port", &this->NewPortName);
  this->Mark("port/name");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(this->S(92));
  if (ImGui::BeginCombo("##porttype", this->NewPortType.c_str(), ImGuiComboFlags_HeightLarge))
  {
    std::set<std::string> kinds;
    for (const ArrayType& a : KnownArrays())
    {
      kinds.insert(KindName(a.Kind));
    }
    kinds.insert(KindName(ArrayKind::Any));
    for (const std::string& k : kinds)
    {
      if (ImGui::Selectable(k.c_str(), k == this->NewPortType))
      {
        this->NewPortType = k;
      }
      this->Mark("port/type/" + k);
    }
    ImGui::EndCombo();
  }
  this->Mark("port/type");
  this->Tooltip("what an input takes");
  const auto add = [&](bool input)
  {
    std::string error;
    if (input ? this->Doc.AddTemplateInput(this->Scope, this->NewPortName,
                  this->NewPortType == KindName(ArrayKind::Any) ? "" : this->NewPortType, error)
              : this->Doc.AddTemplateOutput(this->Scope, this->NewPortName, "", error))
    {
      this->NewPortName.clear();
    }
    else
    {
      this->Tell(error, true);
    }
  };
  if (this->Button("Add an input", "port/add-input", nullptr, !this->NewPortName.empty()))
  {
    add(true);
  }
  ImGui::SameLine();
  if (this->Button("Add an output", "port/add-output", nullptr, !this->NewPortName.empty()))
  {
    add(false);
  }
}

void Viewer::PipelineTab()
{
  const PipelineDocument& d = *this->Doc.Get();
  Heading(this->Win, "Pipeline");
  if (this->EditingDoc)
  {
    std::string& edit = this->EditTexts["pipeline doc"];
    ImGui::SetKeyboardFocusHere();
    ImGui::InputTextMultiline("##doc", &edit, ImVec2(-1, this->S(90)));
    if (ImGui::IsItemDeactivated() || this->Button("Done", "pipeline/doc/done"))
    {
      this->Doc.SetPipelineDoc(edit);
      this->EditingDoc = false;
    }
  }
  else
  {
    ImGui::SameLine(ImGui::GetWindowWidth() - this->S(46));
    if (ImGui::SmallButton("edit"))
    {
      this->EditingDoc = true;
      this->EditTexts["pipeline doc"] = d.Doc.Value;
    }
    this->Mark("pipeline/doc");
    ImGui::PushTextWrapPos(0);
    ImGui::PushFont(this->Win.Small());
    ImGui::TextColored(Colors::Dim, "%s", d.Doc.Value.empty() ? "It has no description yet." : d.Doc.Value.c_str());
    ImGui::PopFont();
    ImGui::PopTextWrapPos();
  }
  ImGui::Dummy(ImVec2(0, this->S(6)));
  Heading(this->Win, "Variables");
  ImGui::SameLine();
  ImGui::TextColored(Colors::Dim, "-D name=value on the command line");
  if (d.Variables.empty())
  {
    ImGui::TextColored(Colors::Dim, "None. $(name) in any value stands for a variable.");
  }
  if (ImGui::BeginTable("variables", 3, ImGuiTableFlags_SizingStretchProp))
  {
    ImGui::TableSetupColumn("name", ImGuiTableColumnFlags_WidthStretch, 0.34f);
    ImGui::TableSetupColumn("value", ImGuiTableColumnFlags_WidthStretch, 0.58f);
    ImGui::TableSetupColumn("delete", ImGuiTableColumnFlags_WidthFixed, this->S(22));
    for (const PipelineVariable& v : std::vector<PipelineVariable>(d.Variables))
    {
      const std::string name = v.Name.Value;
      const auto given = this->GivenVariable(name);
      const std::string shown = given ? given->first : v.Default.Value;
      ImGui::PushID(name.c_str());
      ImGui::TableNextRow();
      ImGui::TableNextColumn();
      ImGui::AlignTextToFramePadding();
      ImGui::PushFont(this->Win.Small());
      ImGui::TextColored(given ? Colors::Accent : Colors::Text, "%s", name.c_str());
      ImGui::PopFont();
      this->Tooltip(v.Doc.Value + (v.Doc.Value.empty() ? "" : "\n") + v.Type.Value);
      ImGui::TableNextColumn();
      long long i = 0;
      std::string error;
      if (v.Type.Value == "int" && detail::ParseInt(shown, -1000000000, 1000000000, i, error))
      {
        ImGui::SetNextItemWidth(-1);
        int n = int(i);
        if (ImGui::InputInt("##v", &n, 1, 10))
        {
          this->HurryNext = false;
          this->Doc.SetVariable(name, std::to_string(n), true);
          this->DropGivenVariable(name);
        }
        this->Mark("variable/" + name);
      }
      else
      {
        const bool path = v.Type.Value == "path";
        ImGui::SetNextItemWidth(path ? -this->S(30) : -1);
        std::string& edit = this->EditTexts["variable " + name];
        if (ImGui::GetActiveID() != ImGui::GetID("##t"))
        {
          edit = shown;
        }
        ImGui::InputText("##t", &edit);
        if (ImGui::IsItemDeactivatedAfterEdit() && edit != shown)
        {
          this->Doc.SetVariable(name, edit);
          this->DropGivenVariable(name);
        }
        this->Mark("variable/" + name);
        if (path)
        {
          ImGui::SameLine(0, this->S(3));
          if (ImGui::Button("\u2026", ImVec2(this->S(26), 0)))
          {
            this->OpenFileDialog("variable:" + name, name, ".gltf .glb .obj .exr .hdr .png .jpg .pfm");
          }
        }
      }
      if (given)
      {
        const std::string note =
          given->second + "; the file has " + (v.Default.Value.empty() ? "nothing" : v.Default.Value);
        ImGui::PushFont(this->Win.Small());
        ImGui::TextColored(Colors::Accent, "%s", Fitted(note, ImGui::GetContentRegionAvail().x - this->S(24)).c_str());
        this->Mark("variable/" + name + "/value " + note);
        this->Tooltip(note);
        ImGui::SameLine(0, this->S(3));
        if (ImGui::SmallButton("\u21ba"))
        {
          this->DropGivenVariable(name);
        }
        this->Mark("variable/" + name + "/reset");
        this->Tooltip("What the file has, instead of -D on the command line");
        ImGui::PopFont();
      }
      ImGui::TableNextColumn();
      if (ImGui::SmallButton("\u2715"))
      {
        this->Doc.RemoveVariable(name);
        this->DropGivenVariable(name); // there is nothing left that it could give a value
      }
      this->Tooltip("Delete the variable");
      ImGui::PopID();
    }
    ImGui::EndTable();
  }
  ImGui::SetNextItemWidth(this->S(120));
  ImGui::InputTextWithHint("##newvariable", "new variable", &this->NewVariableName);
  this->Mark("variable/new");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(this->S(80));
  if (ImGui::BeginCombo("##type", this->NewVariableType.c_str()))
  {
    for (const char* t : { "int", "double", "bool", "string", "path" })
    {
      if (ImGui::Selectable(t, this->NewVariableType == t))
      {
        this->NewVariableType = t;
      }
      this->Mark(std::string("variable/type/") + t);
    }
    ImGui::EndCombo();
  }
  this->Mark("variable/type");
  ImGui::SameLine();
  if (this->Button("Add", "variable/add", nullptr, !this->NewVariableName.empty()))
  {
    std::string error;
    if (this->Doc.AddVariable(this->NewVariableName, this->NewVariableType,
          this->NewVariableType == "int" || this->NewVariableType == "double" ? "0"
          : this->NewVariableType == "bool"                                   ? "false"
                                                                              : "",
          error))
    {
      this->NewVariableName.clear();
    }
    else
    {
      this->Tell(error, true);
    }
  }
  ImGui::Dummy(ImVec2(0, this->S(6)));
  Heading(this->Win, "Time");
  const auto timeText = [&](const char* name, const PipelineText& now, const char* fallback, int which)
  {
    ImGui::AlignTextToFramePadding();
    ImGui::PushFont(this->Win.Small());
    ImGui::TextColored(now.Given ? Colors::Text : Colors::Dim, "%s", name);
    ImGui::PopFont();
    ImGui::SameLine(this->S(90));
    ImGui::SetNextItemWidth(this->S(120));
    std::string& edit = this->EditTexts[std::string("time ") + name];
    ImGui::PushID(name);
    if (ImGui::GetActiveID() != ImGui::GetID("##t"))
    {
      edit = now.Value;
    }
    ImGui::InputTextWithHint("##t", fallback, &edit);
    if (ImGui::IsItemDeactivatedAfterEdit() && edit != now.Value)
    {
      const PipelineTime& t = this->Doc.Get()->Time;
      this->Doc.SetTime(
        which == 0 ? edit : t.First.Value, which == 1 ? edit : t.Count.Value, which == 2 ? edit : t.Rate.Value);
    }
    this->Mark(std::string("pipeline/") + name);
    ImGui::PopID();
  };
  timeText("first", d.Time.First, "0", 0);
  timeText("count", d.Time.Count, "1", 1);
  timeText("rate", d.Time.Rate, "24", 2);
  ImGui::Dummy(ImVec2(0, this->S(6)));
  Heading(this->Win, "Outputs");
  for (const PipelineOutput& o : d.Outputs)
  {
    if (ImGui::Selectable(("##o" + o.Name.Value).c_str(), this->Selected.count("output:" + o.Name.Value) != 0))
    {
      this->EnterScope("");
      this->Selected = { "output:" + o.Name.Value };
      this->WantedTab = "Node";
    }
    ImGui::SameLine(0, 0);
    ImGui::TextUnformatted(o.Name.Value.c_str());
    ImGui::SameLine(this->S(90));
    ImGui::TextColored(Colors::Dim, "%s", o.File.Value.c_str());
  }
  const bool addOutput = this->Button("Add an output", "output/add");
  ImGui::Dummy(ImVec2(0, this->S(6)));
  Heading(this->Win, "Templates");
  std::vector<std::pair<std::string, std::string>> templates; // name, file
  const std::function<void(const PipelineDocument&)> collect = [&](const PipelineDocument& from)
  {
    for (const PipelineTemplate& t : from.Templates)
    {
      templates.emplace_back(t.Name.Value, &from == &d ? std::string() : from.File);
    }
    for (const PipelineInclude& i : from.Includes)
    {
      if (i.Content)
      {
        collect(*i.Content);
      }
    }
  };
  collect(d);
  if (templates.empty())
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Dim, "None. Ctrl+G makes one of the selected nodes.");
    ImGui::PopTextWrapPos();
  }
  for (const auto& t : templates)
  {
    if (ImGui::Selectable(("##t" + t.first).c_str(), this->Scope == t.first))
    {
      this->EnterScope(t.first);
    }
    this->Mark("pipeline/template/" + t.first);
    this->Tooltip(t.second.empty() ? "Opens it in the graph" : t.second);
    ImGui::SameLine(0, 0);
    ImGui::TextUnformatted(t.first.c_str());
    ImGui::SameLine(this->S(170));
    ImGui::TextColored(Colors::Dim, "%s", t.second.empty() ? "" : ShortPath(t.second).c_str());
  }
  if (addOutput)
  {
    const std::string from =
      this->A.Node.empty() ? std::string() : this->A.Node + (this->A.Array.empty() ? "" : ":" + this->A.Array);
    this->EnterScope("");
    const ImVec2 at = this->ToGraph(ImVec2(this->GraphMax.x - this->S(220), (this->GraphMin.y + this->GraphMax.y) / 2));
    this->Selected = { this->Doc.AddOutput(from, double(at.x), double(at.y)) };
  }
}

TradePoint Viewer::PointNow() const
{
  TradePoint point;
  point.Document = this->Doc.Get();
  point.Tick = this->Tick;
  point.Target = ResolveTarget(*point.Document, this->A);
  if (point.Target.Array.empty())
  {
    point.Target.Array = this->PictureOf(this->A).Array; // by its name or as the first one: the same array
  }
  point.Reference = this->ReferenceKey;
  point.History = this->History;
  return point;
}

void Viewer::AddTradePoint()
{
  const std::shared_ptr<const Presentation> p = this->Presented;
  if (!this->CollectPoints || !p || !p->Complete || !this->LastGood || !this->LastGood->Final || this->Camera ||
      this->Refine || this->LastGood->Pruned || this->Playing || this->LastGood->Document != this->Doc.Get() ||
      this->LastGood->Tick != this->Tick || !(p->Wish.A == this->PictureOf(this->A)) ||
      !(p->Wish.Reference == this->Reference))
  {
    return;
  }
  TradePoint point = this->PointNow();
  if (this->PointOf == this->LastGood->Number && this->LastPoint.ComparableWith(point))
  {
    return;
  }
  for (const auto& e : p->Errors)
  {
    if (e.first != this->Points.Metric)
    {
      continue;
    }
    point.Error = e.second;
    // What was kept from the frame before took its time then.
    for (const ViewFrame::Node& n : this->LastGood->Nodes)
    {
      point.Milliseconds += 1000 * this->Points.KnownSeconds(n.Path);
    }
    this->PointOf = this->LastGood->Number;
    this->LastPoint = point;
    this->Points.Add(std::move(point));
  }
}

void Viewer::TradeTab()
{
  Heading(this->Win, "What each node takes");
  const std::shared_ptr<const ViewFrame> frame = this->LastGood;
  if (!frame)
  {
    ImGui::TextColored(Colors::Dim, "No frame yet.");
    return;
  }
  std::map<std::string, LedgerRow> rows;
  double baseError = -1, baseMs = 0;
  if (this->Ledger)
  {
    for (const LedgerRow& r : this->Ledger->Rows())
    {
      rows[r.Node] = r;
    }
    baseError = this->Ledger->BaseError();
    baseMs = this->Ledger->BaseMilliseconds();
  }
  // Inner nodes belong to their instance, for the top level is where nodes are left out.
  struct Line
  {
    std::string Name, Type;
    double Ms = 0, Bytes = 0;
    bool Ran = false;
  };
  std::vector<Line> lines;
  double all = 0;
  for (const ViewFrame::Node& n : frame->Nodes)
  {
    const std::string top = TopOf(n.Path);
    auto at = std::find_if(lines.begin(), lines.end(), [&top](const Line& l) { return l.Name == top; });
    if (at == lines.end())
    {
      lines.push_back({ top, n.Type, 0, 0, false });
      at = lines.end() - 1;
    }
    const double seconds = this->Points.KnownSeconds(n.Path);
    at->Ms += 1000 * seconds;
    at->Bytes += n.Bytes + double(n.Counters.Held);
    at->Ran = at->Ran || n.Counters.Executions > 0;
    all += 1000 * seconds;
  }
  if (ImGui::BeginTable("ledger", 4, ImGuiTableFlags_RowBg | ImGuiTableFlags_SizingStretchProp))
  {
    ImGui::TableSetupColumn("node", ImGuiTableColumnFlags_WidthStretch, 0.34f);
    ImGui::TableSetupColumn("time", ImGuiTableColumnFlags_WidthStretch, 0.26f);
    ImGui::TableSetupColumn("memory", ImGuiTableColumnFlags_WidthStretch, 0.2f);
    ImGui::TableSetupColumn("buys", ImGuiTableColumnFlags_WidthStretch, 0.2f);
    ImGui::PushFont(this->Win.Small());
    ImGui::TableHeadersRow();
    for (const Line& l : lines)
    {
      ImGui::TableNextRow();
      ImGui::TableNextColumn();
      ImGui::TextColored(l.Ran ? Colors::Text : Colors::Dim, "%s", l.Name.c_str());
      this->Tooltip(l.Ran ? l.Type : l.Type + "\nkept from the frame before; the time is that of when it ran");
      ImGui::TableNextColumn();
      const ImVec2 at = ImGui::GetCursorScreenPos();
      const float width = ImGui::GetContentRegionAvail().x;
      ImGui::GetWindowDrawList()->AddRectFilled(at,
        ImVec2(at.x + width * float(all > 0 && !this->Given.Plain ? l.Ms / all : 0), at.y + ImGui::GetTextLineHeight()),
        IM_COL32(70, 120, 170, 110), this->S(2));
      ImGui::TextUnformatted(this->Given.Plain ? "" : Milliseconds(l.Ms).c_str());
      ImGui::TableNextColumn();
      ImGui::TextColored(Colors::Dim, "%s", this->Given.Plain ? "" : Bytes(l.Bytes).c_str());
      ImGui::TableNextColumn();
      const auto row = rows.find(l.Name);
      if (row == rows.end())
      {
        ImGui::TextColored(Colors::Dim, "\u2013");
      }
      else if (!row->second.Done)
      {
        ImGui::TextColored(Colors::Dim, "%s", row->second.Note.empty() ? "\u2026" : "?");
        this->Tooltip(row->second.Note);
      }
      else
      {
        const double bought = baseError > 0 ? row->second.Error / baseError : 0;
        ImGui::TextColored(bought > 1.005   ? Colors::Good
                           : bought < 0.995 ? Colors::Error
                                            : Colors::Dim,
          "\u00d7 %s", Figure(bought).c_str());
        this->Tooltip("Without " + l.Name + " the error (" + this->Points.Metric + ") is " + Figure(row->second.Error) +
                      " instead of " + Figure(baseError) + ", " + Figure(bought) +
                      " times as large, and the frame takes " + Milliseconds(row->second.Milliseconds) +
                      " instead of " + Milliseconds(baseMs) + ".");
      }
    }
    ImGui::PopFont();
    ImGui::EndTable();
  }
  const bool running = this->Ledger && !this->Ledger->Finished();
  if (this->Reference)
  {
    if (this->Button(running ? "Stop measuring" : "Measure what each node buys", "trade/ledger",
          "Runs the frame again without each node in turn, all frames before it included, and compares with the "
          "reference"))
    {
      if (running)
      {
        this->Ledger.reset();
      }
      else
      {
        this->Ledger.reset(new LedgerRun(this->Doc.Get(), this->Given.Graph, this->Registry, this->A, this->Tick,
          this->Reference, this->Points.Metric));
      }
    }
    if (running)
    {
      ImGui::SameLine();
      ImGui::TextColored(Colors::Dim, "measuring\u2026");
    }
  }
  ImGui::Dummy(ImVec2(0, this->S(8)));
  Heading(this->Win, "Speed and accuracy");
  if (!this->Reference)
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Dim,
      "With a reference every change becomes a point here: how long a frame takes against "
      "how far it is from the truth. Each can be returned to.");
    ImGui::PopTextWrapPos();
    if (this->Button("Choose a reference\u2026", "trade/reference"))
    {
      this->OpenFileDialog("reference", "Compare with", ".exr .hdr .png .jpg .pfm");
    }
    return;
  }
  ImGui::SameLine();
  ImGui::TextColored(Colors::Dim, "%s", this->Points.Metric.c_str());
  // Points of other frames, nodes and references wait until those are looked at again.
  const std::vector<int> comparable = this->Points.ComparableWith(this->PointNow());
  std::vector<TradePoint> points;
  for (const int i : comparable)
  {
    points.push_back(this->Points.All()[std::size_t(i)]);
  }
  const std::string which =
    "of " + this->A.Node + (this->A.Array.empty() ? "" : ":" + this->A.Array) +
    (this->Checked && this->Checked->Ticks.Count > 1 ? ", frame " + std::to_string(this->Tick) : std::string());
  ImGui::PushFont(this->Win.Small());
  ImGui::PushTextWrapPos(0);
  ImGui::TextColored(Colors::Dim, "%s", which.c_str());
  ImGui::PopTextWrapPos();
  ImGui::PopFont();
  this->Tooltip(
    "Points are of one node's array in one frame: only those can be compared. Others are shown when they are "
    "looked at again.");
  if (points.empty())
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Dim, "%s",
      this->Presented && !this->Presented->ErrorsText.empty() ? this->Presented->ErrorsText.c_str()
                                                              : "The first point comes with the next whole frame.");
    ImGui::PopTextWrapPos();
    return;
  }
  double loX = 1e300, hiX = 0, loY = 1e300, hiY = 0;
  for (const TradePoint& p : points)
  {
    loX = std::min(loX, std::max(1e-3, p.Milliseconds));
    hiX = std::max(hiX, p.Milliseconds);
    loY = std::min(loY, std::max(1e-12, p.Error));
    hiY = std::max(hiY, p.Error);
  }
  loX /= 1.3;
  hiX = std::max(hiX * 1.3, loX * 2);
  loY /= 1.3;
  hiY = std::max(hiY * 1.3, loY * 2);
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size(ImGui::GetContentRegionAvail().x, this->S(170));
  ImDrawList* list = ImGui::GetWindowDrawList();
  list->AddRectFilled(at, ImVec2(at.x + size.x, at.y + size.y), IM_COL32(22, 23, 26, 255), this->S(3));
  const float left = this->S(46), foot = this->S(20);
  const auto place = [&](double ms, double error)
  {
    const double u = std::log(std::max(ms, loX) / loX) / std::log(hiX / loX);
    const double v = std::log(std::max(error, loY) / loY) / std::log(hiY / loY);
    return ImVec2(at.x + left + float(u) * (size.x - left - this->S(8)),
      at.y + size.y - foot - float(v) * (size.y - foot - this->S(8)));
  };
  ImGui::PushFont(this->Win.Small());
  for (int i = 0; i <= 2; ++i)
  {
    const double ms = loX * std::pow(hiX / loX, i / 2.), error = loY * std::pow(hiY / loY, i / 2.);
    const ImVec2 x = place(ms, loY), y = place(loX, error);
    list->AddLine(ImVec2(x.x, at.y + this->S(4)), ImVec2(x.x, at.y + size.y - foot), IM_COL32(255, 255, 255, 18));
    list->AddLine(ImVec2(at.x + left, y.y), ImVec2(at.x + size.x - this->S(4), y.y), IM_COL32(255, 255, 255, 18));
    const std::string tx = this->Given.Plain ? "" : Milliseconds(ms), ty = Figure(error);
    const float w = ImGui::CalcTextSize(tx.c_str()).x;
    list->AddText(
      ImVec2(std::min(at.x + size.x - w - this->S(3), x.x - (i == 0 ? 0 : w / 2)), at.y + size.y - foot + this->S(3)),
      ImGui::GetColorU32(Colors::Dim), tx.c_str());
    char shortText[24];
    std::snprintf(shortText, sizeof shortText, "%.2g", error);
    list->AddText(ImVec2(at.x + this->S(4), std::max(at.y + this->S(2), y.y - this->S(7))),
      ImGui::GetColorU32(Colors::Dim), shortText);
  }
  ImGui::PopFont();
  ImGui::InvisibleButton("plot", size);
  this->Mark("trade/plot");
  int hovered = -1;
  float nearest = this->S(9);
  const ImVec2 mouse = ImGui::GetIO().MousePos;
  for (std::size_t i = 0; i < points.size(); ++i)
  {
    const ImVec2 p = place(points[i].Milliseconds, points[i].Error);
    this->MarkRect("point/" + std::to_string(i), ImVec2(p.x - 3, p.y - 3), ImVec2(p.x + 3, p.y + 3));
    const float d = std::hypot(p.x - mouse.x, p.y - mouse.y);
    if (ImGui::IsItemHovered() && d < nearest)
    {
      nearest = d;
      hovered = int(i);
    }
  }
  for (std::size_t i = 0; i < points.size(); ++i)
  {
    const ImVec2 p = place(points[i].Milliseconds, points[i].Error);
    const bool now = points[i].Document == this->Doc.Get() || *points[i].Document == *this->Doc.Get();
    list->AddCircleFilled(
      p, this->S(hovered == int(i) ? 5.5 : 4), ImGui::GetColorU32(points[i].Pareto ? Colors::Good : Colors::Dim));
    if (now)
    {
      list->AddCircle(p, this->S(7.5), ImGui::GetColorU32(Colors::Accent), 20, this->S(2));
    }
  }
  const auto back = [&](int i)
  {
    // Frame and node are those that are shown: other points are not in the list.
    this->Doc.Replace("return to a point", points[std::size_t(i)].Document);
    this->Tell("as it was: " + points[std::size_t(i)].Label);
  };
  if (hovered >= 0)
  {
    const TradePoint& p = points[std::size_t(hovered)];
    ShowTooltip(p.Label + "\n" + Milliseconds(p.Milliseconds) + ", " + this->Points.Metric + " " + Figure(p.Error) +
                  (p.Pareto ? "\nno point is both faster and better" : "") + "\nclick to return to it",
      this->S(320));
    if (ImGui::IsMouseClicked(0))
    {
      back(hovered);
    }
  }
  ImGui::PushFont(this->Win.Small());
  int remove = -1;
  for (std::size_t i = 0; i < points.size(); ++i)
  {
    ImGui::PushID(int(i));
    const bool now = points[i].Document == this->Doc.Get() || *points[i].Document == *this->Doc.Get();
    const std::string text =
      (this->Given.Plain ? std::string() : Milliseconds(points[i].Milliseconds) + "  ") + Figure(points[i].Error);
    if (ImGui::Selectable("##point", now, 0, ImVec2(ImGui::GetContentRegionAvail().x - this->S(26), 0)))
    {
      back(int(i));
    }
    this->Mark("points/" + std::to_string(i));
    this->Tooltip(points[i].Label);
    ImGui::SameLine(this->S(4) + ImGui::GetStyle().WindowPadding.x);
    ImGui::TextColored(points[i].Pareto ? Colors::Good : Colors::Dim, "%s", text.c_str());
    ImGui::SameLine(this->S(140));
    ImGui::TextUnformatted(Fitted(points[i].Label, ImGui::GetContentRegionAvail().x - this->S(34)).c_str());
    ImGui::SameLine(ImGui::GetWindowWidth() - this->S(36));
    if (ImGui::SmallButton("\u2715"))
    {
      remove = int(i);
    }
    ImGui::PopID();
  }
  ImGui::PopFont();
  if (remove >= 0)
  {
    this->Points.Remove(comparable[std::size_t(remove)]);
  }
}

void Viewer::RightPanel(const ImVec2& min, const ImVec2& max)
{
  ImGui::SetNextWindowPos(min);
  ImGui::SetNextWindowSize(ImVec2(max.x - min.x, max.y - min.y));
  ImGui::Begin("##right", nullptr,
    ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoCollapse |
      ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus | ImGuiWindowFlags_NoScrollbar);
  std::string open;
  ImGui::PushFont(this->Win.Small());
  if (ImGui::BeginTabBar("tabs", ImGuiTabBarFlags_FittingPolicyScroll))
  {
    const auto tab = [&](const char* name, void (Viewer::*draw)())
    {
      const bool wanted = this->WantedTab == name;
      const bool shown = ImGui::BeginTabItem(name, nullptr, wanted ? ImGuiTabItemFlags_SetSelected : 0);
      this->Mark(std::string("tab/") + name);
      if (shown)
      {
        open = name;
        ImGui::PopFont();
        ImGui::BeginChild("body", ImVec2(0, 0), false);
        (this->*draw)();
        ImGui::EndChild();
        ImGui::PushFont(this->Win.Small());
        ImGui::EndTabItem();
      }
    };
    tab("Node", &Viewer::PropertiesTab);
    tab("Pixel", &Viewer::Inspector);
    tab("Compare", &Viewer::ComparePanel);
    tab("Trade", &Viewer::TradeTab);
    tab("Pipeline", &Viewer::PipelineTab);
    ImGui::EndTabBar();
  }
  ImGui::PopFont();
  if (!open.empty())
  {
    if (open == this->WantedTab)
    {
      this->WantedTab.clear();
    }
    this->RightTab = open;
  }
  if (this->RightTab != "Pixel")
  {
    this->WantAllArrays = false;
  }
  ImGui::End();
}

void Viewer::MessagesPanel(const ImVec2& min, const ImVec2& max)
{
  ImGui::SetNextWindowPos(min);
  ImGui::SetNextWindowSize(ImVec2(max.x - min.x, max.y - min.y));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, ImVec4(0.115f, 0.12f, 0.132f, 1));
  ImGui::Begin("##messages", nullptr,
    ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
      ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoFocusOnAppearing);
  // How many there are, on the right; a click on it leaves one line of them.
  const int errors = this->Checked->Errors, all = int(this->Checked->Messages.size());
  const int warnings = all - errors;
  std::string count = errors > 0 ? std::to_string(errors) + (errors == 1 ? " mistake" : " mistakes") : std::string();
  count += warnings > 0 ? (count.empty() ? "" : ", ") + std::to_string(warnings) + (warnings == 1 ? " hint" : " hints")
                        : std::string();
  count += this->MessagesOpen ? "  \u25be" : "  \u25b8";
  ImGui::PushFont(this->Win.Small());
  const float countWidth = ImGui::CalcTextSize(count.c_str()).x + 2 * ImGui::GetStyle().FramePadding.x;
  const ImVec2 start = ImGui::GetCursorPos();
  const bool fold = all > 1 || !this->MessagesOpen;
  if (fold)
  {
    ImGui::SetCursorPosX(ImGui::GetWindowWidth() - ImGui::GetStyle().ScrollbarSize - countWidth - this->S(4));
    ImGui::SetCursorPosY(start.y + ImGui::GetScrollY());
    if (ImGui::SmallButton((count + "##fold").c_str()))
    {
      this->MessagesOpen = !this->MessagesOpen;
    }
    this->Mark("messages/fold");
    this->Tooltip(this->MessagesOpen ? "Leave one line of them" : "Show more of them");
    ImGui::SetCursorPos(start);
  }
  ImGui::PopFont();
  const float room = ImGui::GetContentRegionAvail().x - (fold ? countWidth + this->S(12) : 0.f);
  int i = 0;
  for (const Diagnostic& d : this->Checked->Messages)
  {
    ImGui::PushID(i);
    if (ImGui::Selectable("##m", false, 0, ImVec2(room, 0)))
    {
      const std::string top = TopOf(d.Node);
      if (!top.empty())
      {
        this->EnterScope("");
        this->Reveal({ top });
      }
    }
    this->Mark("message/" + std::to_string(i));
    this->Tooltip((d.Where.empty() ? std::string() : d.Where + ": ") + d.What + (d.Hint.empty() ? "" : "\n" + d.Hint) +
                  (d.Place.Line > 0 ? "\n" + d.Place.File + ", line " + std::to_string(d.Place.Line) : std::string()));
    ImGui::SameLine(ImGui::GetStyle().WindowPadding.x);
    ImGui::PushFont(this->Win.Small());
    ImGui::TextColored(d.Level == Severity::Error ? Colors::Error : Colors::Warning, "%s",
      d.Level == Severity::Error ? "\u25cf" : "\u25b2");
    ImGui::SameLine();
    if (d.Place.Line > 0)
    {
      const bool here = d.Place.File.empty() || d.Place.File == this->Doc.Get()->File;
      ImGui::TextColored(Colors::Dim, "%sline %d",
        here ? "" : (std::filesystem::path(d.Place.File).filename().string() + " ").c_str(), d.Place.Line);
      ImGui::SameLine();
    }
    const float left = room + ImGui::GetStyle().WindowPadding.x - ImGui::GetCursorPosX();
    const std::string what = Fitted((d.Where.empty() ? std::string() : d.Where + ": ") + d.What, left);
    ImGui::TextUnformatted(what.c_str());
    const float rest = left - ImGui::CalcTextSize(what.c_str()).x - this->S(8);
    if (!d.Hint.empty() && rest > this->S(40))
    {
      ImGui::SameLine();
      ImGui::TextColored(Colors::Dim, "%s", Fitted(d.Hint, rest).c_str());
    }
    ImGui::PopFont();
    ImGui::PopID();
    ++i;
  }
  ImGui::End();
  ImGui::PopStyleColor();
}
}
