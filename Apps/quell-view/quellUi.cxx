// SPDX-License-Identifier: BSD-3-Clause
#include "quellUi.h"

#include "quellPipelineReader.h"
#include "quellWindow.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>

namespace quell
{
namespace Colors
{
const ImVec4 Background(0.098f, 0.102f, 0.114f, 1), Panel(0.133f, 0.137f, 0.149f, 1), Raised(0.188f, 0.196f, 0.212f, 1),
  Line(0.27f, 0.28f, 0.30f, 1), Text(0.90f, 0.91f, 0.92f, 1), Dim(0.60f, 0.62f, 0.65f, 1),
  Accent(0.36f, 0.66f, 0.95f, 1), Error(0.98f, 0.45f, 0.40f, 1), Warning(0.97f, 0.76f, 0.35f, 1),
  Good(0.47f, 0.82f, 0.52f, 1);
}

void ApplyStyle(float scale)
{
  ImGui::StyleColorsDark();
  ImGuiStyle& s = ImGui::GetStyle();
  s = ImGuiStyle();
  ImGui::StyleColorsDark(&s);
  s.WindowPadding = ImVec2(10, 8);
  s.FramePadding = ImVec2(7, 3);
  s.ItemSpacing = ImVec2(7, 5);
  s.ItemInnerSpacing = ImVec2(5, 4);
  s.WindowRounding = 0;
  s.ChildRounding = 3;
  s.FrameRounding = 3;
  s.PopupRounding = 4;
  s.GrabRounding = 3;
  s.TabRounding = 3;
  s.ScrollbarRounding = 6;
  s.ScrollbarSize = 12;
  s.GrabMinSize = 8;
  s.WindowBorderSize = 0;
  s.PopupBorderSize = 1;
  s.FrameBorderSize = 0;
  s.WindowMinSize = ImVec2(1, 1);
  s.DisabledAlpha = 0.42f;
  s.ScaleAllSizes(scale);
  const auto set = [&s](int index, const ImVec4& c, float alpha = 1)
  { s.Colors[index] = ImVec4(c.x, c.y, c.z, c.w * alpha); };
  using namespace Colors;
  set(ImGuiCol_Text, Text);
  set(ImGuiCol_TextDisabled, Dim);
  set(ImGuiCol_WindowBg, Panel);
  set(ImGuiCol_ChildBg, Panel, 0);
  set(ImGuiCol_PopupBg, ImVec4(0.16f, 0.165f, 0.18f, 0.99f));
  set(ImGuiCol_Border, Line, 0.8f);
  set(ImGuiCol_FrameBg, Raised);
  set(ImGuiCol_FrameBgHovered, ImVec4(0.23f, 0.24f, 0.26f, 1));
  set(ImGuiCol_FrameBgActive, ImVec4(0.26f, 0.27f, 0.30f, 1));
  set(ImGuiCol_TitleBg, Panel);
  set(ImGuiCol_TitleBgActive, Raised);
  set(ImGuiCol_MenuBarBg, ImVec4(0.115f, 0.12f, 0.132f, 1));
  set(ImGuiCol_ScrollbarBg, Panel, 0);
  set(ImGuiCol_ScrollbarGrab, Line);
  set(ImGuiCol_ScrollbarGrabHovered, ImVec4(0.34f, 0.36f, 0.39f, 1));
  set(ImGuiCol_ScrollbarGrabActive, Accent);
  set(ImGuiCol_CheckMark, Accent);
  set(ImGuiCol_SliderGrab, ImVec4(0.32f, 0.55f, 0.78f, 1));
  set(ImGuiCol_SliderGrabActive, Accent);
  set(ImGuiCol_Button, ImVec4(0.21f, 0.22f, 0.24f, 1));
  set(ImGuiCol_ButtonHovered, ImVec4(0.27f, 0.29f, 0.32f, 1));
  set(ImGuiCol_ButtonActive, ImVec4(0.24f, 0.42f, 0.60f, 1));
  set(ImGuiCol_Header, ImVec4(0.22f, 0.31f, 0.40f, 0.7f));
  set(ImGuiCol_HeaderHovered, ImVec4(0.25f, 0.28f, 0.32f, 1));
  set(ImGuiCol_HeaderActive, ImVec4(0.26f, 0.42f, 0.58f, 1));
  set(ImGuiCol_Separator, Line, 0.7f);
  set(ImGuiCol_Tab, Panel);
  set(ImGuiCol_TabHovered, ImVec4(0.25f, 0.28f, 0.32f, 1));
  set(ImGuiCol_TabActive, ImVec4(0.21f, 0.30f, 0.39f, 1));
  set(ImGuiCol_TabUnfocused, Panel);
  set(ImGuiCol_TabUnfocusedActive, ImVec4(0.21f, 0.30f, 0.39f, 1));
  set(ImGuiCol_PlotLines, Accent);
  set(ImGuiCol_PlotHistogram, Accent);
  set(ImGuiCol_TableHeaderBg, Raised);
  set(ImGuiCol_TableBorderLight, Line, 0.5f);
  set(ImGuiCol_TableBorderStrong, Line, 0.8f);
  set(ImGuiCol_TableRowBgAlt, ImVec4(1, 1, 1, 0.02f));
  set(ImGuiCol_TextSelectedBg, ImVec4(0.24f, 0.45f, 0.66f, 0.7f));
  set(ImGuiCol_NavHighlight, Accent, 0.5f);
  set(ImGuiCol_ModalWindowDimBg, ImVec4(0, 0, 0, 0.55f));
}

ImU32 KindColor(ArrayKind kind, float alpha)
{
  ImVec4 c(0.72f, 0.74f, 0.77f, alpha);
  switch (kind)
  {
    case ArrayKind::Color:
      c = ImVec4(0.95f, 0.80f, 0.36f, alpha);
      break;
    case ArrayKind::Albedo:
      c = ImVec4(0.93f, 0.56f, 0.42f, alpha);
      break;
    case ArrayKind::Normal:
      c = ImVec4(0.56f, 0.62f, 0.97f, alpha);
      break;
    case ArrayKind::Position:
      c = ImVec4(0.47f, 0.80f, 0.90f, alpha);
      break;
    case ArrayKind::Depth:
      c = ImVec4(0.45f, 0.72f, 0.74f, alpha);
      break;
    case ArrayKind::Motion:
      c = ImVec4(0.86f, 0.52f, 0.86f, alpha);
      break;
    case ArrayKind::Id:
      c = ImVec4(0.56f, 0.80f, 0.47f, alpha);
      break;
    case ArrayKind::Variance:
      c = ImVec4(0.90f, 0.45f, 0.55f, alpha);
      break;
    case ArrayKind::Moments:
      c = ImVec4(0.80f, 0.50f, 0.65f, alpha);
      break;
    case ArrayKind::History:
      c = ImVec4(0.65f, 0.70f, 0.50f, alpha);
      break;
    case ArrayKind::Display:
      c = ImVec4(0.95f, 0.93f, 0.88f, alpha);
      break;
    default:
      break;
  }
  return ImGui::ColorConvertFloat4ToU32(c);
}

void DrawIcon(ImDrawList* list, const ImVec2& c, float s, Icon icon, ImU32 colour)
{
  const float h = s / 2;
  const auto right = [&](float x, float w)
  { list->AddTriangleFilled(ImVec2(x, c.y - h), ImVec2(x + w, c.y), ImVec2(x, c.y + h), colour); };
  const auto left = [&](float x, float w)
  { list->AddTriangleFilled(ImVec2(x + w, c.y - h), ImVec2(x, c.y), ImVec2(x + w, c.y + h), colour); };
  const auto bar = [&](float x, float w) { list->AddRectFilled(ImVec2(x, c.y - h), ImVec2(x + w, c.y + h), colour); };
  switch (icon)
  {
    case Icon::First:
      bar(c.x - h, s * 0.16f);
      left(c.x - h + s * 0.22f, s * 0.75f);
      break;
    case Icon::StepBack:
      left(c.x - h, s * 0.7f);
      bar(c.x + h - s * 0.2f, s * 0.16f);
      break;
    case Icon::Play:
      right(c.x - h * 0.7f, s * 0.85f);
      break;
    case Icon::Pause:
      bar(c.x - h * 0.7f, s * 0.26f);
      bar(c.x + h * 0.2f, s * 0.26f);
      break;
    case Icon::StepForward:
      bar(c.x - h, s * 0.16f);
      right(c.x - h + s * 0.27f, s * 0.7f);
      break;
    case Icon::Last:
      right(c.x - h, s * 0.75f);
      bar(c.x + h - s * 0.16f, s * 0.16f);
      break;
    case Icon::Loop:
      list->PathArcTo(c, h * 0.9f, 0.5f, 5.3f, 20);
      list->PathStroke(colour, 0, s * 0.14f);
      list->AddTriangleFilled(ImVec2(c.x + h * 1.1f, c.y - h * 0.95f), ImVec2(c.x + h * 1.05f, c.y - h * 0.1f),
        ImVec2(c.x + h * 0.25f, c.y - h * 0.55f), colour);
      break;
    case Icon::Eye:
      list->AddCircle(c, h * 0.95f, colour, 16, s * 0.11f);
      list->AddCircleFilled(c, h * 0.42f, colour, 12);
      break;
    case Icon::Camera:
      list->AddRectFilled(ImVec2(c.x - h, c.y - h * 0.55f), ImVec2(c.x + h * 0.35f, c.y + h * 0.6f), colour, s * 0.12f);
      list->AddTriangleFilled(
        ImVec2(c.x + h, c.y - h * 0.6f), ImVec2(c.x + h, c.y + h * 0.65f), ImVec2(c.x + h * 0.25f, c.y), colour);
      break;
  }
}

bool IconButton(const char* id, Icon icon, double scale, bool on)
{
  const float height = ImGui::GetFrameHeight();
  ImGui::PushID(id);
  if (on)
  {
    ImGui::PushStyleColor(ImGuiCol_Button, ImGui::GetStyleColorVec4(ImGuiCol_ButtonActive));
  }
  const bool pressed = ImGui::Button("##icon", ImVec2(height * 1.3f, height));
  if (on)
  {
    ImGui::PopStyleColor();
  }
  const ImVec2 a = ImGui::GetItemRectMin(), b = ImGui::GetItemRectMax();
  ImVec4 c = Colors::Text;
  c.w *= ImGui::GetStyle().Alpha;
  DrawIcon(ImGui::GetWindowDrawList(), ImVec2((a.x + b.x) / 2, (a.y + b.y) / 2), float(11 * scale), icon,
    ImGui::ColorConvertFloat4ToU32(c));
  ImGui::PopID();
  return pressed;
}

void Heading(const Window& window, const char* text)
{
  ImGui::PushFont(window.Bold());
  ImGui::TextUnformatted(text);
  ImGui::PopFont();
}

std::string Wrapped(const std::string& text, float width)
{
  std::string out, line;
  std::size_t at = 0;
  const auto put = [&](const std::string& word)
  {
    const std::string longer = line.empty() ? word : line + " " + word;
    if (!line.empty() && ImGui::CalcTextSize(longer.c_str()).x > width)
    {
      out += line + "\n";
      line = word;
    }
    else
    {
      line = longer;
    }
    // Longer than a line: a path, broken after a slash.
    while (ImGui::CalcTextSize(line.c_str()).x > width)
    {
      std::size_t best = 0;
      for (std::size_t i = line.find('/'); i != std::string::npos && i + 1 < line.size(); i = line.find('/', i + 1))
      {
        best = ImGui::CalcTextSize(line.c_str(), line.c_str() + i + 1).x <= width ? i + 1 : best;
      }
      if (best == 0)
      {
        break;
      }
      out += line.substr(0, best) + "\n";
      line = line.substr(best);
    }
  };
  while (at <= text.size())
  {
    const std::size_t end = std::min(text.size(), text.find_first_of(" \n", at));
    put(text.substr(at, end - at));
    if (end == text.size())
    {
      break;
    }
    if (text[end] == '\n')
    {
      out += line + "\n";
      line.clear();
    }
    at = end + 1;
  }
  return out + line;
}

void ShowTooltip(const std::string& text, float width)
{
  ImGui::BeginTooltip();
  ImGui::TextUnformatted(Wrapped(text, width).c_str());
  ImGui::EndTooltip();
}

std::string Fitted(const std::string& text, float width)
{
  if (ImGui::CalcTextSize(text.c_str()).x <= width)
  {
    return text;
  }
  std::string cut = text;
  while (!cut.empty() && ImGui::CalcTextSize((cut + "\u2026").c_str()).x > width)
  {
    cut.pop_back();
    while (!cut.empty() && (static_cast<unsigned char>(cut.back()) & 0xC0) == 0x80)
    {
      cut.pop_back();
    }
  }
  return cut + "\u2026";
}

std::string Milliseconds(double ms)
{
  char text[48];
  if (ms >= 10000)
  {
    std::snprintf(text, sizeof text, "%.1f s", ms / 1000);
  }
  else
  {
    std::snprintf(text, sizeof text, ms < 9.95 ? "%.1f ms" : "%.0f ms", ms);
  }
  return text;
}

std::string Bytes(double bytes)
{
  char text[48];
  std::snprintf(text, sizeof text,
    bytes < 999.5e3   ? "%.0f kB"
    : bytes < 99.95e6 ? "%.1f MB"
                      : "%.0f MB",
    bytes < 999.5e3 ? bytes / 1e3 : bytes / 1e6);
  return text;
}

std::string Figure(double v)
{
  char text[48];
  std::snprintf(text, sizeof text, "%.4g", v);
  return text;
}

std::string ShortPath(const std::string& file)
{
  const char* home = std::getenv("HOME");
  std::string text = file;
  if (home && *home && text.compare(0, std::string(home).size(), home) == 0)
  {
    text = "~" + text.substr(std::string(home).size());
  }
  return text.size() <= 60 ? text : "\u2026" + text.substr(text.size() - 58);
}

std::string LineOfFile(const std::string& file, int line)
{
  std::ifstream stream(file);
  std::string text;
  for (int i = 0; i < line; ++i)
  {
    if (!std::getline(stream, text))
    {
      return {};
    }
  }
  const std::size_t first = text.find_first_not_of(" \t");
  text = first == std::string::npos ? std::string() : text.substr(first);
  return text.size() > 110 ? text.substr(0, 108) + "\u2026" : text;
}

std::string PipelineBrief(const std::string& file)
{
  static std::map<std::string, std::string> known;
  const auto at = known.find(file);
  if (at != known.end())
  {
    return at->second;
  }
  Diagnostics ignored;
  const auto document = ReadPipelineFile(file, ignored);
  std::string text = document ? document->Doc.Value : std::string();
  const std::size_t end = text.find_first_of(".:;");
  return known[file] = text.substr(0, end);
}

std::string RangeOf(const Property& p)
{
  if (p.Kind == Property::Type::Enum || p.Kind == Property::Type::Bool || p.Kind == Property::Type::String ||
      p.Kind == Property::Type::Path)
  {
    return {};
  }
  if (!(p.Maximum > p.Minimum) || p.Maximum >= 1e29)
  {
    return p.Minimum > -1e300 ? detail::FormatDouble(p.Minimum) + " or more" : std::string();
  }
  return "[" + detail::FormatDouble(p.Minimum) + ", " + detail::FormatDouble(p.Maximum) + "]";
}

std::string MeaningOf(const Property& p, double value)
{
  std::size_t at = 0;
  while (at < p.Doc.size())
  {
    const std::size_t end = std::min(p.Doc.size(), p.Doc.find(';', at));
    std::string part = p.Doc.substr(at, end - at);
    part.erase(0, part.find_first_not_of(' '));
    at = end + 1;
    // Several stand in one part, too: "1e30: box, 0: identity" and "0: none, 1: direct light".
    for (std::size_t begin = 0; begin < part.size();)
    {
      const std::size_t comma = std::min(part.size(), part.find(", ", begin));
      const std::string piece = part.substr(begin, comma - begin);
      const std::size_t colon = piece.find(": ");
      double number = 0;
      std::string error;
      if (colon != std::string::npos && detail::ParseDouble(piece.substr(0, colon), -1e308, 1e308, number, error) &&
          number == value)
      {
        // Up to the next one of them.
        std::size_t stop = comma;
        while (stop < part.size())
        {
          const std::size_t after = part.find(": ", stop);
          const std::string next = after == std::string::npos ? "" : part.substr(stop + 2, after - stop - 2);
          if (detail::ParseDouble(next, -1e308, 1e308, number, error))
          {
            break;
          }
          stop = std::min(part.size(), part.find(", ", stop + 2));
        }
        const std::string meaning = part.substr(begin + colon + 2, stop - begin - colon - 2);
        return meaning.substr(0, meaning.find(". "));
      }
      begin = comma + 2;
    }
  }
  return std::fabs(value) >= 1e29 ? "no limit" : std::string();
}

const std::vector<HelpSection>& HelpSections()
{
  static const std::vector<HelpSection> sections{
    { 0, "Image",
      { { "wheel", "zoom at the pointer" }, { "drag", "pan" }, { "F  /  1", "fit  /  one pixel is one pixel" },
        { "click", "pin the pixel inspector, again to let go" }, { "+  -  0", "exposure up, down, none" },
        { "C", "camera mode, and out of it: drag orbits," }, { "", "Shift+drag pans, the wheel dollies" },
        { "H", "back to the scene's camera" } } },
    { 0, "Compare",
      { { "W", "wipe between A and B; drag the line" }, { "X", "flip between A and B" }, { "D", "difference" },
        { "K", "put the picture aside as B" }, { "P", "put the parameters aside as set B" },
        { "Shift+P", "swap set A and set B" } } },
    { 0, "Time",
      { { "Space", "play and stop" }, { "Left  Right", "step" }, { "Home  End", "first and last frame" },
        { "Esc", "stop what runs" }, { "R", "run it again" } } },
    { 1, "Graph",
      { { "click a node", "select it and show its picture" }, { "click an output", "show that array" },
        { "drag from a pin", "connect; what does not fit says why" }, { "drop a link on nothing", "nodes that fit" },
        { "double click", "open the palette, or a template" }, { "right click", "menu of the node or the link" },
        { "drag a node on a link", "insert it there" }, { "drag", "select in a rectangle; middle button or Alt pans" },
        { "wheel", "zoom" } } },
    { 1, "Edit",
      { { "Tab", "palette" }, { "Del  /  Ctrl+Del", "delete  /  and reconnect" }, { "Ctrl+D", "duplicate" },
        { "Ctrl+C X V", "copy, cut, paste as XML" }, { "F2", "rename" },
        { "Ctrl+G", "make a template of the selection" }, { "L  /  A", "arrange  /  fit the graph" },
        { "Ctrl+Z  Ctrl+Y", "undo, redo" }, { "Alt+Up", "out of a template" } } },
    { 1, "File",
      { { "Ctrl+N O S", "new, open, save" }, { "Ctrl+Shift+S", "save as" }, { "drop", "pipeline, scene or picture" },
        { "F1", "this page" } } }
  };
  return sections;
}
}
