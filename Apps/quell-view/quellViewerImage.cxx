// SPDX-License-Identifier: BSD-3-Clause
// The picture: what is shown, zoom and pan, comparison, pixel inspector, histogram, the camera.
#include "quellUi.h"
#include "quellViewer.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <imgui_internal.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <set>

namespace quell
{
namespace
{
const char* const CompareNames[] = { "A alone", "Wipe", "Flip", "Difference", "Signed difference", "Relative error",
  "FLIP map" };

/// Array names of an image, for lists.
std::vector<std::string> ArraysOf(vtkImageData* image)
{
  std::vector<std::string> names;
  for (int i = 0; image && i < image->GetPointData()->GetNumberOfArrays(); ++i)
  {
    if (vtkDataArray* a = image->GetPointData()->GetArray(i))
    {
      names.push_back(a->GetName() ? a->GetName() : "");
    }
  }
  return names;
}

std::string ValueText(float v)
{
  char text[32];
  if (std::isnan(v))
  {
    return "NaN";
  }
  if (std::isinf(v))
  {
    return v > 0 ? "+inf" : "-inf";
  }
  std::snprintf(text, sizeof text, "%.5g", double(v));
  return text;
}
}

Picture Viewer::PictureOf(const ViewTarget& target) const
{
  return this->PictureIn(this->LastGood, target);
}

Picture Viewer::PictureIn(const std::shared_ptr<const ViewFrame>& frame, const ViewTarget& target) const
{
  Picture p;
  if (!frame || target.Node.empty())
  {
    return p;
  }
  const ViewTarget real = ResolveTarget(*frame->Document, target);
  const auto image = frame->Images.find(real.Node);
  if (image == frame->Images.end())
  {
    return p;
  }
  p.Image = image->second;
  p.Array = real.Array;
  const auto known = frame->Arrays.find(real.Node);
  if (p.Array.empty() && known != frame->Arrays.end() && !known->second.empty())
  {
    p.Array = known->second.front().Name;
  }
  const ImageIn view = ArrayView(p.Image, p.Array);
  if (!view)
  {
    return Picture();
  }
  p.Kind = KindOf(p.Array, view.components);
  if (known != frame->Arrays.end())
  {
    for (const OutputArray& a : known->second)
    {
      if (a.Name == p.Array && a.Kind != ArrayKind::Any)
      {
        p.Kind = a.Kind;
      }
    }
  }
  return p;
}

Picture Viewer::PictureB() const
{
  switch (this->BFrom)
  {
    case SourceB::Node:
      return this->PictureOf(this->B);
    case SourceB::Kept:
      return this->Kept;
    case SourceB::Parameters:
      return this->PictureIn(this->GoodB, this->A);
    default:
      break;
  }
  Picture p = this->Reference;
  // The reference's array of the name that is shown, where it has one.
  const Picture a = this->PictureOf(this->A);
  if (p && a && ArrayView(p.Image, a.Array))
  {
    p.Array = a.Array;
    p.Kind = a.Kind;
  }
  return p;
}

void Viewer::ImageToolbar()
{
  // Narrower where that is enough for one line, else in several; where even that leaves no picture, behind a button.
  const float whole = ImGui::GetContentRegionAvail().x;
  const bool few = whole < this->S(430);
  const bool range = this->Presented && this->Presented->A.Style != DisplayStyle::View && !this->Display.AutoRange;
  const double wanted = 150 + 140 + 112 + (range ? 200 : 218) + 130 + 60 +
                        (this->Compared == CompareMode::Off ? 0 : 158) +
                        (this->Compared == CompareMode::Difference || this->Compared == CompareMode::Signed ? 88 : 0) +
                        (this->Compared != CompareMode::Off && this->BFrom == SourceB::Parameters ? 54 : 0);
  const double shrink = few ? std::min(1., double(whole) / double(this->S(345)))
                            : std::min(1., std::max(0.72, double(whole) / double(this->S(wanted))));
  // What is shown: node and array.
  ImGui::SetNextItemWidth(this->S(150 * shrink));
  const std::string nodeText = this->A.Node.empty() ? "nothing" : this->A.Node;
  if (ImGui::BeginCombo("##node", nodeText.c_str(), ImGuiComboFlags_HeightLarge))
  {
    for (const PipelineNode& n : this->Doc.Nodes(""))
    {
      if (ImGui::Selectable(n.Id.Value.c_str(), n.Id.Value == this->A.Node))
      {
        this->SelectTarget(n.Id.Value, "");
      }
      this->Tooltip(n.Type.Value);
    }
    ImGui::EndCombo();
  }
  this->Mark("image/node");
  this->Tooltip("The node whose picture is shown; clicking a node in the graph does the same");
  ImGui::SameLine();
  const ViewTarget real = ResolveTarget(*this->Doc.Get(), this->A);
  const Picture shown = this->PictureOf(this->A);
  ImGui::SetNextItemWidth(this->S(140 * shrink));
  const std::string arrayText = !this->A.Array.empty() ? this->A.Array : shown ? shown.Array : "";
  if (ImGui::BeginCombo("##array", arrayText.c_str(), ImGuiComboFlags_HeightLarge))
  {
    const int box = this->Scope.empty() ? this->Model.Find(this->A.Node) : -1;
    std::vector<std::string> own;
    if (box >= 0 && this->Model.Boxes[std::size_t(box)].Kind == BoxKind::Instance)
    {
      for (const GraphPin& p : this->Model.Boxes[std::size_t(box)].Outputs)
      {
        if (ImGui::Selectable(p.Name.c_str(), p.Name == this->A.Array))
        {
          this->SelectTarget(this->A.Node, p.Name);
        }
        own.push_back(p.Name);
      }
    }
    else if (this->LastGood)
    {
      const auto known = this->LastGood->Arrays.find(real.Node);
      bool separated = false;
      if (known != this->LastGood->Arrays.end())
      {
        for (const OutputArray& a : known->second)
        {
          if (a.Name.compare(0, 6, "bounce") == 0 && a.Name.size() > 7)
          {
            continue; // bounce10 ... would fill the list
          }
          const GraphBox* b = box >= 0 ? &this->Model.Boxes[std::size_t(box)] : nullptr;
          if (!separated && b && b->Description && !b->Description->FindOutput(a.Name) && &a != &known->second.front())
          {
            ImGui::Separator();
            ImGui::TextColored(Colors::Dim, "passed through or on demand");
            separated = true;
          }
          if (ImGui::Selectable(a.Name.c_str(), a.Name == arrayText))
          {
            this->SelectTarget(this->A.Node, a.Name);
          }
          this->Tooltip(std::string(KindName(a.Kind)) + ": " + a.Doc);
        }
      }
    }
    ImGui::EndCombo();
  }
  this->Mark("image/array");
  if (few)
  {
    ImGui::SameLine();
    if (ImGui::Button("\u2026"))
    {
      ImGui::OpenPopup("more");
    }
    this->Mark("image/more");
    this->Tooltip("How it is shown, and what it is compared with");
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(8), this->S(6)));
    if (ImGui::BeginPopup("more"))
    {
      this->CloseMenuOnEscape();
      const auto below = [](float, double) {};
      const auto wide = [this](double) { return this->S(190); };
      this->DisplayControls(below, wide);
      this->CompareControls(below, wide);
      ImGui::EndPopup();
    }
    ImGui::PopStyleVar();
    return;
  }
  const auto next = [this](float needs, double gap)
  {
    ImGui::SameLine(0, this->S(gap));
    if (ImGui::GetContentRegionAvail().x < needs)
    {
      ImGui::NewLine();
    }
  };
  const auto width = [this, shrink](double points) { return this->S(points * shrink); };
  this->DisplayControls(next, width);
  this->CompareControls(next, width);
}

/// `next(width, gap)` goes to where the next control stands; `width` says how wide one becomes that wants so much.
void Viewer::DisplayControls(const std::function<void(float, double)>& next, const std::function<float(double)>& width)
{
  next(width(112), 14);
  ImGui::SetNextItemWidth(width(112));
  const char* styleName = "Automatic";
  for (const auto& s : DisplayStyleNames())
  {
    styleName = s.first == this->Display.Style ? s.second : styleName;
  }
  if (ImGui::BeginCombo("##style", styleName))
  {
    for (const auto& s : DisplayStyleNames())
    {
      if (ImGui::Selectable(s.second, s.first == this->Display.Style))
      {
        this->Display.Style = s.first;
      }
    }
    ImGui::EndCombo();
  }
  this->Mark("image/style");
  this->Tooltip("How numbers become colours; Automatic goes by what the array is");
  const DisplayStyle style = this->Presented ? this->Presented->A.Style : DisplayStyle::View;
  if (style == DisplayStyle::View)
  {
    next(width(100), 7);
    ImGui::SetNextItemWidth(width(100));
    if (ImGui::BeginCombo("##view", this->Display.View.c_str()))
    {
      for (const std::string& v : this->Views)
      {
        if (ImGui::Selectable(v.c_str(), v == this->Display.View))
        {
          this->Display.View = v;
        }
      }
      ImGui::EndCombo();
    }
    this->Mark("image/view");
    this->Tooltip("OpenColorIO view of the shipped configuration");
    next(width(110), 7);
    float exposure = float(this->Display.Exposure);
    ImGui::SetNextItemWidth(width(110));
    if (ImGui::SliderFloat("##exposure", &exposure, -8, 8, "%+.2f EV"))
    {
      this->Display.Exposure = double(exposure);
    }
    if (ImGui::IsItemClicked(1))
    {
      this->Display.Exposure = 0;
    }
    this->Mark("image/exposure");
    this->Tooltip("Exposure in stops (+ and -; 0 or a right click resets)");
  }
  else if (style != DisplayStyle::Direction && style != DisplayStyle::Labels)
  {
    next(this->S(60), 7);
    bool automaticRange = this->Display.AutoRange;
    if (ImGui::Checkbox("auto", &automaticRange))
    {
      this->Display.AutoRange = automaticRange;
      if (!automaticRange && this->Presented)
      {
        this->Display.Low = this->Presented->A.Low;
        this->Display.High = this->Presented->A.High;
      }
    }
    this->Mark("image/auto");
    this->Tooltip("Range from the picture (0.2 % of the values on either side are left out)");
    if (!this->Display.AutoRange)
    {
      float range[2] = { float(this->Display.Low), float(this->Display.High) };
      next(width(130), 7);
      ImGui::SetNextItemWidth(width(130));
      if (ImGui::DragFloat2("##range", range, std::max(1e-5f, std::fabs(range[1] - range[0]) * 0.005f), 0, 0, "%.4g"))
      {
        this->Display.Low = double(range[0]);
        this->Display.High = double(range[1]);
      }
    }
  }
}

void Viewer::CompareControls(const std::function<void(float, double)>& next, const std::function<float(double)>& width)
{
  const Picture shown = this->PictureOf(this->A);
  next(width(130), 14);
  ImGui::SetNextItemWidth(width(130));
  if (ImGui::BeginCombo("##compare", CompareNames[int(this->Compared)]))
  {
    for (int i = 0; i < 7; ++i)
    {
      if (ImGui::Selectable(CompareNames[i], i == int(this->Compared)))
      {
        this->Compared = CompareMode(i);
        this->FlipShowsB = this->Compared == CompareMode::Flip;
      }
      this->Mark(std::string("compare/") + std::to_string(i));
    }
    ImGui::EndCombo();
  }
  this->Mark("image/compare");
  this->Tooltip("Compare the picture (A) with another one (B)");
  if (this->Compared != CompareMode::Off)
  {
    next(width(150), 7);
    ImGui::SetNextItemWidth(width(150));
    const std::string bText =
      this->BFrom == SourceB::Node
        ? (this->B.Node.empty() ? "choose B" : this->B.Node + (this->B.Array.empty() ? "" : ":" + this->B.Array))
      : this->BFrom == SourceB::Kept       ? (this->Kept ? "kept: " + this->KeptName : "nothing is kept")
      : this->BFrom == SourceB::Parameters ? "parameter set B"
      : this->Reference                    ? "reference"
                                           : "choose B";
    if (ImGui::BeginCombo("##b", bText.c_str(), ImGuiComboFlags_HeightLarge))
    {
      if (ImGui::Selectable(this->Reference ? "reference" : "reference file\u2026"))
      {
        this->BFrom = SourceB::Reference;
        if (!this->Reference)
        {
          this->OpenFileDialog("reference", "Compare with", ".exr .hdr .png .jpg .pfm");
        }
      }
      this->Mark("source/reference");
      if (this->Reference && ImGui::Selectable("another reference file\u2026"))
      {
        this->OpenFileDialog("reference", "Compare with", ".exr .hdr .png .jpg .pfm");
      }
      if (ImGui::Selectable("the picture as it is now (K)", false, this->LastGood ? 0 : ImGuiSelectableFlags_Disabled))
      {
        this->Kept = this->PictureOf(this->A);
        this->KeptName = this->A.Node;
        this->BFrom = SourceB::Kept;
      }
      this->Mark("source/keep");
      if (ImGui::Selectable("the parameters as they are now (P)"))
      {
        this->PutParametersAside();
      }
      this->Mark("source/parameters");
      this->Tooltip(
        "Puts them aside as set B. Both sets run from then on, so they can be compared on any frame, on any "
        "node and while the camera turns.");
      if (this->SetB && ImGui::Selectable(("parameter " + this->NameOfSetB()).c_str()))
      {
        this->BFrom = SourceB::Parameters;
      }
      if (this->Kept && ImGui::Selectable(("kept: " + this->KeptName).c_str()))
      {
        this->BFrom = SourceB::Kept;
      }
      ImGui::Separator();
      for (const PipelineNode& n : this->Doc.Nodes(""))
      {
        if (ImGui::Selectable(n.Id.Value.c_str(), this->BFrom == SourceB::Node && this->B.Node == n.Id.Value))
        {
          this->BFrom = SourceB::Node;
          this->B = { n.Id.Value, "" };
          // The same array of both, where both have it.
          if (this->LastGood && shown)
          {
            const auto known = this->LastGood->Arrays.find(ResolveTarget(*this->Doc.Get(), this->B).Node);
            if (known != this->LastGood->Arrays.end() &&
                std::any_of(known->second.begin(), known->second.end(),
                  [&](const OutputArray& a) { return a.Name == shown.Array; }) &&
                n.IsInstance == false)
            {
              this->B.Array = shown.Array;
            }
          }
        }
        this->Mark("b/" + n.Id.Value);
      }
      ImGui::EndCombo();
    }
    this->Mark("image/b");
    if (this->BFrom == SourceB::Parameters && this->SetB)
    {
      this->Tooltip("parameter " + this->NameOfSetB());
      next(this->S(48), 7);
      if (this->Button("Swap", "image/swap", "Edits set B and puts A aside (Shift+P); one step of undo"))
      {
        this->SwapParameters();
      }
    }
    if (this->Compared == CompareMode::Difference || this->Compared == CompareMode::Signed)
    {
      next(width(80), 7);
      ImGui::SetNextItemWidth(width(80));
      ImGui::SliderFloat("##gain", &this->Gain, 0.1f, 1000, "\u00d7 %.3g", ImGuiSliderFlags_Logarithmic);
      this->Mark("image/gain");
      this->Tooltip("Gain of the difference");
    }
  }
}

void Viewer::Legend(const DisplayImage& image, const ImVec2& at, const std::string& title)
{
  ImDrawList* list = ImGui::GetWindowDrawList();
  const float width = this->S(150), height = this->S(10), pad = this->S(7);
  ImGui::PushFont(this->Win.Small());
  const float line = ImGui::GetTextLineHeight();
  const ImVec2 a(at.x - width - 2 * pad, at.y - height - 2 * line - 2 * pad - this->S(3));
  list->AddRectFilled(a, at, IM_COL32(16, 17, 20, 215), this->S(4));
  list->AddText(ImVec2(a.x + pad, a.y + pad * 0.7f), ImGui::GetColorU32(Colors::Text), title.c_str());
  const float y = a.y + pad * 0.7f + line + this->S(3);
  const int steps = 50;
  for (int i = 0; i < steps; ++i)
  {
    std::uint8_t c[3];
    MapColor(image.Style, (i + 0.5) / steps, c);
    list->AddRectFilled(ImVec2(a.x + pad + width * float(i) / steps, y),
      ImVec2(a.x + pad + width * float(i + 1) / steps + 0.5f, y + height), IM_COL32(c[0], c[1], c[2], 255));
  }
  const std::string low = Figure(image.Low), high = Figure(image.High);
  list->AddText(ImVec2(a.x + pad, y + height + this->S(1)), ImGui::GetColorU32(Colors::Dim), low.c_str());
  list->AddText(ImVec2(a.x + pad + width - ImGui::CalcTextSize(high.c_str()).x, y + height + this->S(1)),
    ImGui::GetColorU32(Colors::Dim), high.c_str());
  if (image.Logarithmic)
  {
    list->AddText(ImVec2(a.x + pad + width / 2 - ImGui::CalcTextSize("log").x / 2, y + height + this->S(1)),
      ImGui::GetColorU32(Colors::Dim), "log");
  }
  ImGui::PopFont();
}

void Viewer::CameraGesture(const ImVec2& min, const ImVec2& max, bool hovered)
{
  ImGuiIO& io = ImGui::GetIO();
  const Picture shown = this->PictureOf(this->A);
  if (!shown)
  {
    return;
  }
  const bool dragging = ImGui::IsItemActive() && (io.MouseDelta.x != 0 || io.MouseDelta.y != 0);
  const bool wheeling = hovered && io.MouseWheel != 0;
  if (!dragging && !wheeling)
  {
    return;
  }
  const FrameFacts facts = FrameFacts::Read(shown.Image->GetFieldData());
  if (!this->Camera)
  {
    Mat4 inverse;
    if (!facts.HasCamera || !facts.WorldToCamera.Inverse(inverse))
    {
      this->Tell("this picture has no camera: only path-traced ones have", true);
      return;
    }
    inverse.m[0][3] += facts.Origin.x;
    inverse.m[1][3] += facts.Origin.y;
    inverse.m[2][3] += facts.Origin.z;
    this->Camera = inverse;
    this->Playing = false;
  }
  Mat4& c = *this->Camera;
  const auto column = [&](int i) { return Vec3d{ c.m[0][i], c.m[1][i], c.m[2][i] }; };
  const Vec3d right = column(0), up = column(1), back = column(2), eye = column(3);
  // Around what the middle of the picture sees.
  double distance = 0;
  const ImageIn depth = ArrayView(shown.Image, "depth");
  if (depth)
  {
    const float d = depth.at((depth.extent.x0 + depth.extent.x1) / 2, (depth.extent.y0 + depth.extent.y1) / 2)[0];
    distance = std::isfinite(d) ? double(d) : 0;
  }
  if (!(distance > 0))
  {
    // No depth in this picture: the scene's origin, as far as it lies ahead.
    const Vec3d origin{ facts.Origin.x, facts.Origin.y, facts.Origin.z };
    distance = Dot(eye - origin, back);
    if (!(distance > 1e-6))
    {
      distance = std::max(1e-3, Length(eye - origin));
    }
  }
  const Vec3d pivot = eye - back * distance;
  const double extent = double(std::max(1.f, max.y - min.y));
  const auto set = [&c](int i, const Vec3d& v)
  {
    c.m[0][i] = v.x;
    c.m[1][i] = v.y;
    c.m[2][i] = v.z;
  };
  if (wheeling)
  {
    const double factor = std::pow(0.9, double(io.MouseWheel));
    set(3, pivot + back * (distance * factor));
  }
  if (dragging && io.KeyShift)
  {
    const double step = distance / extent;
    set(3, eye - right * (double(io.MouseDelta.x) * step) + up * (double(io.MouseDelta.y) * step));
  }
  else if (dragging)
  {
    const double yaw = -double(io.MouseDelta.x) / extent * 3.2, pitch = -double(io.MouseDelta.y) / extent * 3.2;
    const auto turn = [](const Vec3d& v, const Vec3d& axis, double angle)
    {
      const double co = std::cos(angle), si = std::sin(angle);
      return v * co + Cross(axis, v) * si + axis * (Dot(axis, v) * (1 - co));
    };
    const Vec3d worldUp{ 0, 1, 0 };
    Vec3d b = turn(back, worldUp, yaw), r = turn(right, worldUp, yaw);
    const Vec3d tilted = turn(b, r, pitch);
    // Not over the poles.
    if (std::fabs(tilted.y) < 0.995 || std::fabs(tilted.y) < std::fabs(b.y))
    {
      b = tilted;
    }
    b = Normalized(b);
    r = Normalized(r - b * Dot(r, b));
    set(0, r);
    set(1, Cross(b, r));
    set(2, b);
    set(3, pivot + b * distance);
  }
  ++this->CameraSerial;
  this->HurryNext = false;
}

void Viewer::DrawImage(const ImVec2& min, const ImVec2& max)
{
  ImGuiIO& io = ImGui::GetIO();
  ImDrawList* list = ImGui::GetWindowDrawList();
  const ImVec2 size(max.x - min.x, max.y - min.y);
  if (size.x < 8 || size.y < 8)
  {
    return;
  }
  list->AddRectFilled(min, max, IM_COL32(20, 20, 21, 255));
  ImGui::SetCursorScreenPos(min);
  ImGui::InvisibleButton("canvas", size,
    ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonMiddle | ImGuiButtonFlags_MouseButtonRight);
  this->MarkRect("image", min, max);
  const bool hovered = ImGui::IsItemHovered();
  const std::shared_ptr<const Presentation> p = this->Presented;
  const bool any = p && p->A.Width > 0 && p->A.Error.empty() && this->TextureA.Id();
  if (!any)
  {
    std::string text = "Nothing to show yet", hint;
    if (this->Doc.Nodes("").empty())
    {
      text = "The graph is empty";
      hint = "Press Tab or double-click below for a node; a source such as PathTraceSource or ImageReader comes first.";
    }
    else if (this->Shown && !this->Shown->Ok && !this->Shown->Error.empty())
    {
      text = "No picture";
      hint = this->Shown->Error;
    }
    else if (!this->Session->Idle())
    {
      text = "Working\u2026";
    }
    else if (p && !p->A.Error.empty())
    {
      hint = p->A.Error;
    }
    ImGui::PushFont(this->Win.Bold());
    const ImVec2 t = ImGui::CalcTextSize(text.c_str());
    list->AddText(ImVec2(min.x + (size.x - t.x) / 2, min.y + size.y / 2 - t.y * 1.5f), ImGui::GetColorU32(Colors::Dim),
      text.c_str());
    ImGui::PopFont();
    const float wrap = std::min(size.x - this->S(40), this->S(560));
    const ImVec2 h = ImGui::CalcTextSize(hint.c_str(), nullptr, false, wrap);
    list->AddText(ImGui::GetFont(), ImGui::GetFontSize(), ImVec2(min.x + (size.x - h.x) / 2, min.y + size.y / 2),
      ImGui::GetColorU32(text == "No picture" ? Colors::Warning : Colors::Dim), hint.c_str(), nullptr, wrap);
    return;
  }
  const double w = p->A.Width, h = p->A.Height;
  if (this->FitImage)
  {
    this->Zoom = std::min((double(size.x) - 8) / w, (double(size.y) - 8) / h);
    // Whole multiples look best where there is room.
    this->Zoom = this->Zoom > 2 ? std::floor(this->Zoom * 2) / 2 : this->Zoom;
    this->Centre = ImVec2(float(w / 2), float(h / 2));
  }
  const ImVec2 middle((min.x + max.x) / 2, (min.y + max.y) / 2);
  const auto toScreen = [&](double x, double y)
  {
    return ImVec2(float(std::floor(double(middle.x) + (0 - double(this->Centre.x)) * this->Zoom) + x * this->Zoom),
      float(std::floor(double(middle.y) + (0 - double(this->Centre.y)) * this->Zoom) + y * this->Zoom));
  };
  const auto toImage = [&](const ImVec2& s)
  {
    const ImVec2 o = toScreen(0, 0);
    return ImVec2(float(double(s.x - o.x) / this->Zoom), float(double(s.y - o.y) / this->Zoom));
  };

  // The line of the wipe comes before panning.
  const bool wipes = this->Compared == CompareMode::Wipe && this->TextureB.Id() && p->B.Error.empty();
  const ImVec2 a = toScreen(0, 0), b = toScreen(w, h);
  const float wipeX = a.x + this->WipeAt * (b.x - a.x);
  if (wipes)
  {
    const bool near = hovered && std::fabs(io.MousePos.x - wipeX) < this->S(6);
    if (near && ImGui::IsMouseClicked(0))
    {
      this->DraggingWipe = true;
    }
    if (near || this->DraggingWipe)
    {
      ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeEW);
    }
  }
  if (!ImGui::IsMouseDown(0))
  {
    this->DraggingWipe = false;
  }
  if (this->DraggingWipe)
  {
    this->WipeAt = std::min(1.f, std::max(0.f, (io.MousePos.x - a.x) / std::max(1.f, b.x - a.x)));
  }
  else if (this->CameraMode)
  {
    this->CameraGesture(min, max, hovered);
  }
  else
  {
    if (hovered && io.MouseWheel != 0)
    {
      const ImVec2 before = toImage(io.MousePos);
      const double steps[] = { 0.05, 0.0625, 0.083, 0.125, 0.167, 0.25, 0.333, 0.5, 0.667, 1, 1.5, 2, 3, 4, 6, 8, 12,
        16, 24, 32, 48, 64 };
      double next = this->Zoom;
      if (io.MouseWheel > 0)
      {
        for (double s : steps)
        {
          if (s > this->Zoom * 1.001)
          {
            next = s;
            break;
          }
        }
      }
      else
      {
        for (double s : steps)
        {
          next = s < this->Zoom * 0.999 ? s : next;
        }
      }
      this->Zoom = std::min(64., std::max(0.05, next));
      this->FitImage = false;
      const ImVec2 after = toImage(io.MousePos);
      this->Centre.x += before.x - after.x;
      this->Centre.y += before.y - after.y;
    }
    if (ImGui::IsItemActive() && (io.MouseDelta.x != 0 || io.MouseDelta.y != 0) &&
        (ImGui::IsMouseDragging(0, this->S(3)) || ImGui::IsMouseDragging(2, this->S(3))))
    {
      this->FitImage = false;
      this->Centre.x -= float(double(io.MouseDelta.x) / this->Zoom);
      this->Centre.y -= float(double(io.MouseDelta.y) / this->Zoom);
    }
    const ImVec2 drag = ImGui::GetMouseDragDelta(0, 0);
    if (hovered && ImGui::IsMouseReleased(0) && std::hypot(drag.x, drag.y) < this->S(3))
    {
      this->PixelPinned = !this->PixelPinned && this->PixelValid;
    }
  }
  this->Centre.x = std::min(float(w), std::max(0.f, this->Centre.x));
  this->Centre.y = std::min(float(h), std::max(0.f, this->Centre.y));

  if (!this->PixelPinned)
  {
    const ImVec2 at = toImage(io.MousePos);
    this->PixelValid = hovered && at.x >= 0 && at.y >= 0 && double(at.x) < w && double(at.y) < h;
    this->PixelX = int(at.x);
    this->PixelY = int(at.y);
  }
  this->PixelValid = this->PixelValid && this->PixelX < p->A.Width && this->PixelY < p->A.Height;

  const bool map = int(this->Compared) >= int(CompareMode::Difference);
  const bool mapGood = map && this->TextureMap.Id() && p->Map.Error.empty() && p->Map.Width > 0;
  const bool flipped = this->Compared == CompareMode::Flip && this->FlipShowsB && this->TextureB.Id();
  list->PushClipRect(min, max, true);
  const ImVec2 pa = toScreen(0, 0), pb = toScreen(w, h);
  const WindowTexture& main = mapGood ? this->TextureMap : flipped ? this->TextureB : this->TextureA;
  list->AddImage(main.Id(), pa, pb);
  if (wipes)
  {
    const float x = pa.x + this->WipeAt * (pb.x - pa.x);
    list->AddImage(this->TextureB.Id(), ImVec2(x, pa.y), pb, ImVec2(this->WipeAt, 0), ImVec2(1, 1));
    list->AddLine(ImVec2(x, pa.y), ImVec2(x, pb.y), IM_COL32(255, 255, 255, 210), this->S(1.5));
    list->AddCircleFilled(ImVec2(x, (pa.y + pb.y) / 2), this->S(5), IM_COL32(255, 255, 255, 230));
  }
  list->AddRect(ImVec2(pa.x - 1, pa.y - 1), ImVec2(pb.x + 1, pb.y + 1), IM_COL32(70, 72, 76, 255));

  // Numbers in the pixels, as soon as there is room for them.
  if (this->Zoom >= 48)
  {
    const Picture shown = this->PictureOf(this->A);
    const ImageIn v = shown ? ArrayView(shown.Image, shown.Array) : ImageIn();
    const ImVec2 from = toImage(min), to = toImage(max);
    ImGui::PushFont(this->Win.Small());
    for (int y = std::max(0, int(from.y)); v && y < std::min(int(h), int(to.y) + 1); ++y)
    {
      for (int x = std::max(0, int(from.x)); x < std::min(int(w), int(to.x) + 1); ++x)
      {
        const float* f = v.at(v.extent.x0 + x, v.extent.y1 - 1 - y);
        const ImVec2 corner = toScreen(x, y);
        for (int c = 0; c < std::min(3, v.components); ++c)
        {
          char text[24];
          std::snprintf(text, sizeof text, "%.3g", double(f[c]));
          const ImVec2 at(corner.x + 3, corner.y + 2 + float(c) * (ImGui::GetTextLineHeight() - 1));
          list->AddText(ImVec2(at.x + 1, at.y + 1), IM_COL32(0, 0, 0, 190), text);
          list->AddText(at,
            v.components == 1 ? IM_COL32(255, 255, 255, 255)
            : c == 0          ? IM_COL32(255, 150, 150, 255)
            : c == 1          ? IM_COL32(160, 255, 160, 255)
                              : IM_COL32(165, 185, 255, 255),
            text);
        }
      }
    }
    ImGui::PopFont();
  }
  if (this->PixelValid && (this->PixelPinned || this->Zoom >= 4))
  {
    const ImVec2 q0 = toScreen(this->PixelX, this->PixelY), q1 = toScreen(this->PixelX + 1, this->PixelY + 1);
    const float grow = std::max(0.f, this->S(3) - (q1.x - q0.x) / 2);
    list->AddRect(
      ImVec2(q0.x - grow - 1, q0.y - grow - 1), ImVec2(q1.x + grow + 1, q1.y + grow + 1), IM_COL32(0, 0, 0, 200));
    list->AddRect(ImVec2(q0.x - grow, q0.y - grow), ImVec2(q1.x + grow, q1.y + grow),
      this->PixelPinned ? ImGui::GetColorU32(Colors::Accent) : IM_COL32(255, 255, 255, 220));
  }
  list->PopClipRect();

  // Labels of what is where.
  ImGui::PushFont(this->Win.Small());
  int labels = 0;
  const auto label = [&](const ImVec2& at, const std::string& text, bool right, const ImVec4& colour)
  {
    const ImVec2 t = ImGui::CalcTextSize(text.c_str());
    const ImVec2 q(right ? at.x - t.x - this->S(10) : at.x, at.y);
    this->MarkRect("label/" + std::to_string(labels++), q, ImVec2(q.x + t.x + this->S(10), q.y + t.y + this->S(6)));
    list->AddRectFilled(
      q, ImVec2(q.x + t.x + this->S(10), q.y + t.y + this->S(6)), IM_COL32(16, 17, 20, 200), this->S(3));
    list->AddText(ImVec2(q.x + this->S(5), q.y + this->S(3)), ImGui::GetColorU32(colour), text.c_str());
  };
  const Picture shown = this->PictureOf(this->A);
  std::string nameA = this->A.Node + (shown ? "  " + shown.Array : "");
  if (this->Compared != CompareMode::Off && this->BFrom == SourceB::Parameters && this->SetB)
  {
    const bool same = this->SetB == this->Doc.Get() || *this->SetB == *this->Doc.Get();
    nameA += Fitted(same ? "  set A, the same" : "  set A: " + ChangeText(*this->SetB, *this->Doc.Get()),
      std::max(this->S(120), size.x * 0.6f));
  }
  const std::string nameB = this->BFrom == SourceB::Node         ? this->B.Node
                            : this->BFrom == SourceB::Kept       ? "kept " + this->KeptName
                            : this->BFrom == SourceB::Parameters ? "set B"
                                                                 : "reference";
  const ImVec2 corner(min.x + this->S(8), min.y + this->S(8)), opposite(max.x - this->S(8), min.y + this->S(8));
  // Lines below the names; each finds the next free place.
  float lineY = corner.y;
  const auto line = [&](const std::string& text, const ImVec4& colour)
  {
    lineY += ImGui::GetTextLineHeight() + this->S(10);
    label(ImVec2(corner.x, lineY), Fitted(text, size.x - this->S(26)), false, colour);
  };
  if (map)
  {
    label(corner, nameA + "  against  " + nameB, false, Colors::Text);
    const std::string error = !p->MapError.empty() ? p->MapError : p->Map.Error;
    if (!error.empty())
    {
      line(error, Colors::Warning);
    }
    else if (const std::string figures = this->DifferenceText(); mapGood && !figures.empty())
    {
      line(figures, Colors::Text);
    }
    if (mapGood && p->Map.Style != DisplayStyle::View)
    {
      this->Legend(p->Map, ImVec2(max.x - this->S(8), max.y - this->S(8)), CompareNames[int(this->Compared)]);
    }
  }
  else
  {
    label(corner, flipped ? "B  " + nameB : (this->Compared != CompareMode::Off ? "A  " : "") + nameA, false,
      flipped ? Colors::Accent : Colors::Text);
    if (wipes)
    {
      label(opposite, "B  " + nameB, true, Colors::Accent);
    }
    if (this->Compared != CompareMode::Off && (!p->Wish.B || !p->B.Error.empty()))
    {
      const bool set = this->BFrom == SourceB::Parameters && this->SetB;
      line(!p->B.Error.empty()                                                 ? p->B.Error
           : !set                                                              ? "choose what B is, above"
           : this->ShownB && !this->ShownB->Ok && !this->ShownB->Error.empty() ? "set B: " + this->ShownB->Error
                                                                               : "set B is at work\u2026",
        Colors::Warning);
    }
    if (p->A.Style == DisplayStyle::Heat || p->A.Style == DisplayStyle::LogHeat || p->A.Style == DisplayStyle::Gray ||
        p->A.Style == DisplayStyle::Error || p->A.Style == DisplayStyle::Signed)
    {
      this->Legend(p->A, ImVec2(max.x - this->S(8), max.y - this->S(8)), shown.Array);
    }
  }
  if (p->A.NonFinite > 0)
  {
    label(ImVec2(corner.x, max.y - this->S(30)),
      std::to_string(p->A.NonFinite) + (p->A.NonFinite == 1 ? " pixel is" : " pixels are") +
        " not finite, the first at (" + std::to_string(p->A.FirstX) + ", " + std::to_string(p->A.FirstY) +
        ") from the bottom left",
      false, Colors::Warning);
  }
  else if (this->CameraMode)
  {
    label(ImVec2(corner.x, max.y - this->S(30)), "camera: drag orbits, Shift+drag pans, wheel dollies, H goes home",
      false, Colors::Accent);
  }
  if (this->LastGood && this->Shown && !this->Shown->Ok && !this->Shown->Error.empty())
  {
    line("an older picture: " + this->Shown->Error, Colors::Error);
  }
  ImGui::PopFont();
}

std::string Viewer::DifferenceText() const
{
  if (!this->Presented || !this->Presented->Difference.Known)
  {
    return {};
  }
  const DifferenceFigures& d = this->Presented->Difference;
  const std::string odd = d.OnlyOneFinite == 0
                            ? std::string()
                            : "; in " + std::to_string(d.OnlyOneFinite) +
                                (d.OnlyOneFinite == 1 ? " pixel" : " pixels") + " only one of them is a number";
  if (!(d.Largest > 0))
  {
    return (odd.empty() ? "no difference: A and B are equal" : "no difference in numbers") + odd;
  }
  return "largest difference " + Figure(d.Largest) + " at x " + std::to_string(d.LargestX) + " y " +
         std::to_string(this->Presented->A.Height - 1 - d.LargestY) + ", mean " + Figure(d.Mean) + odd;
}

void Viewer::ImagePanel(const ImVec2& min, const ImVec2& max)
{
  ImGui::SetNextWindowPos(min);
  ImGui::SetNextWindowSize(ImVec2(max.x - min.x, max.y - min.y));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(6), this->S(5)));
  ImGui::Begin("##image", nullptr,
    ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings |
      ImGuiWindowFlags_NoBringToFrontOnFocus | ImGuiWindowFlags_NoScrollWithMouse);
  this->ImageToolbar();
  const float y = ImGui::GetCursorScreenPos().y;
  const float foot = ImGui::GetTextLineHeight() + this->S(6);
  this->DrawImage(ImVec2(min.x, y), ImVec2(max.x, max.y - foot));
  // One line on the pixel below the mouse.
  ImGui::SetCursorScreenPos(ImVec2(min.x + this->S(8), max.y - foot + this->S(3)));
  ImGui::PushFont(this->Win.Small());
  char zoom[32];
  std::snprintf(zoom, sizeof zoom, "%.0f %%", 100 * this->Zoom);
  ImGui::TextColored(Colors::Dim, "%s", zoom);
  const Picture shown = this->PictureOf(this->A);
  const ImageIn v = shown ? ArrayView(shown.Image, shown.Array) : ImageIn();
  if (v && this->PixelValid && this->PixelX < v.extent.width() && this->PixelY < v.extent.height())
  {
    const int x = v.extent.x0 + this->PixelX, fromBottom = v.extent.y1 - 1 - this->PixelY;
    ImGui::SameLine(this->S(72));
    ImGui::TextColored(this->PixelPinned ? Colors::Accent : Colors::Dim, "x %d  y %d", this->PixelX, this->PixelY);
    ImGui::SameLine(this->S(190));
    const auto values = [](const float* f, int n, const char* gap)
    {
      std::string text;
      for (int c = 0; c < n; ++c)
      {
        text += (c ? gap : "") + ValueText(f[c]);
      }
      return text;
    };
    const float* a = v.at(x, fromBottom);
    const Picture other = this->Compared == CompareMode::Off ? Picture() : this->PictureB();
    const ImageIn w = other ? ArrayView(other.Image, other.Array) : ImageIn();
    std::string text = values(a, v.components, "   ");
    if (w && w.components == v.components && w.extent.width() == v.extent.width() &&
        w.extent.height() == v.extent.height())
    {
      const float* b = w.at(w.extent.x0 + this->PixelX, w.extent.y1 - 1 - this->PixelY);
      std::vector<float> minus;
      for (int c = 0; c < v.components; ++c)
      {
        minus.push_back(a[c] == b[c] ? 0.f : a[c] - b[c]);
      }
      text = "A " + values(a, v.components, " ") + "   B " + values(b, v.components, " ") + "   A-B " +
             values(minus.data(), v.components, " ");
    }
    ImGui::PopFont();
    ImGui::PushFont(this->Win.Mono());
    if (ImGui::CalcTextSize(text.c_str()).x > ImGui::GetContentRegionAvail().x)
    {
      ImGui::PopFont();
      ImGui::PushFont(this->Win.Small());
    }
    ImGui::TextColored(Colors::Text, "%s", text.c_str());
    this->MarkRect("image/values " + text, ImGui::GetItemRectMin(), ImGui::GetItemRectMax());
    this->Tooltip(text);
  }
  ImGui::PopFont();
  ImGui::End();
  ImGui::PopStyleVar();
}

/// Of a weight between -1 and 1; on a root scale, so that small ones are told apart.
static void WeightColor(const WeightsSummary& s, double v, std::uint8_t* rgb)
{
  const double t = std::sqrt(std::min(1., std::fabs(v)));
  MapColor(s.Negative ? DisplayStyle::Signed : DisplayStyle::Heat, s.Negative ? 0.5 + (v < 0 ? -t : t) / 2 : t, rgb);
}

/// The filters that the shown picture was made by, the nearest first.
static std::vector<std::string> FiltersBehind(const ViewFrame& frame, const std::string& node)
{
  std::vector<std::string> found;
  const std::shared_ptr<const Graph>& graph = frame.Pipeline;
  const int start = graph ? graph->Find(node) : -1;
  std::vector<int> open;
  std::set<int> known;
  if (start >= 0)
  {
    open.push_back(start);
    known.insert(start);
  }
  for (std::size_t i = 0; i < open.size(); ++i)
  {
    const GraphNode& n = graph->Nodes[std::size_t(open[i])];
    for (const ViewFrame::Node& f : frame.Nodes)
    {
      if (f.Path == n.Path && f.Weighs)
      {
        found.push_back(f.Path);
      }
    }
    for (const GraphEdge& e : n.Inputs)
    {
      if (!e.Delayed && known.insert(e.Producer).second)
      {
        open.push_back(e.Producer);
      }
    }
  }
  return found;
}

void Viewer::Inspector()
{
  const Picture shown = this->PictureOf(this->A);
  this->WantWeights = false;
  if (!shown)
  {
    ImGui::TextColored(Colors::Dim, "No picture to look into.");
    this->WantAllArrays = false;
    return;
  }
  this->WantAllArrays = this->AllArrays;
  const ImageIn v = ArrayView(shown.Image, shown.Array);
  if (!this->PixelValid || !v || this->PixelX >= v.extent.width() || this->PixelY >= v.extent.height())
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Dim, "Point at a pixel of the picture; a click keeps it here.");
    ImGui::PopTextWrapPos();
    return;
  }
  const int x = v.extent.x0 + this->PixelX, y = v.extent.y1 - 1 - this->PixelY;
  Heading(this->Win, this->PixelPinned ? "Pinned pixel" : "Pixel");
  ImGui::SameLine();
  ImGui::TextColored(Colors::Dim, "x %d  y %d", this->PixelX, this->PixelY);
  this->Tooltip("from the top left");
  // The neighbourhood, enlarged.
  const int radius = 4;
  const std::vector<std::string> filters =
    FiltersBehind(*this->LastGood, ResolveTarget(*this->LastGood->Document, this->A).Node);
  this->WantWeights = !filters.empty();
  this->SummarizeWeights();
  // Beside it, what the filter takes from where.
  const float room = ImGui::GetContentRegionAvail().x - this->S(4);
  const float cell =
    std::floor(std::min(this->S(20), (filters.empty() ? room : (room - this->S(10)) / 2) / (2 * radius + 1)));
  const ImVec2 at = ImGui::GetCursorScreenPos();
  ImDrawList* list = ImGui::GetWindowDrawList();
  if (this->Presented && this->Presented->A.Width == v.extent.width())
  {
    const DisplayImage& d = this->Presented->A;
    for (int j = -radius; j <= radius; ++j)
    {
      for (int i = -radius; i <= radius; ++i)
      {
        const int px = this->PixelX + i, py = this->PixelY + j;
        const ImVec2 q(at.x + float(i + radius) * cell, at.y + float(j + radius) * cell);
        if (px < 0 || py < 0 || px >= d.Width || py >= d.Height)
        {
          continue;
        }
        const std::uint8_t* c = &d.Rgba[std::size_t(4 * (py * d.Width + px))];
        list->AddRectFilled(q, ImVec2(q.x + cell - 1, q.y + cell - 1), IM_COL32(c[0], c[1], c[2], 255));
      }
    }
    const ImVec2 q(at.x + float(radius) * cell, at.y + float(radius) * cell);
    list->AddRect(
      ImVec2(q.x - 1, q.y - 1), ImVec2(q.x + cell, q.y + cell), ImGui::GetColorU32(Colors::Accent), 0, 0, this->S(1.5));
    ImGui::Dummy(ImVec2(cell * (2 * radius + 1), cell * (2 * radius + 1)));
    if (!filters.empty())
    {
      ImGui::SameLine(0, this->S(10));
      this->WeightsMap(cell * (2 * radius + 1));
    }
    ImGui::Dummy(ImVec2(0, this->S(2)));
  }
  if (!filters.empty())
  {
    this->WeightsPanel(filters, x, y);
    ImGui::Dummy(ImVec2(0, this->S(4)));
    Heading(this->Win, "Arrays");
  }
  if (ImGui::BeginTable("values", 2, ImGuiTableFlags_RowBg | ImGuiTableFlags_SizingFixedFit))
  {
    ImGui::TableSetupColumn("array");
    ImGui::TableSetupColumn("values", ImGuiTableColumnFlags_WidthStretch);
    for (const std::string& name : ArraysOf(shown.Image))
    {
      const ImageIn a = ArrayView(shown.Image, name);
      if (!a)
      {
        continue;
      }
      ImGui::TableNextRow();
      ImGui::TableNextColumn();
      ImGui::PushFont(this->Win.Small());
      ImGui::TextColored(name == shown.Array ? Colors::Accent : Colors::Dim, "%s", name.c_str());
      const ArrayType* type = FindArray(name);
      this->Tooltip(type ? type->Doc : "");
      ImGui::PopFont();
      ImGui::TableNextColumn();
      ImGui::PushFont(this->Win.Mono());
      std::string text, whole, tight;
      bool finite = true;
      for (int c = 0; c < a.components; ++c)
      {
        const float f = a.at(x, y)[c];
        finite = finite && (std::isfinite(f) || InfinityIsValue(KindOf(name, a.components), name));
        char four[32];
        std::snprintf(four, sizeof four, "%-9.3g", double(f));
        text += std::isfinite(f) ? four : ValueText(f) + "  ";
        whole += (c ? "  " : "") + ValueText(f);
        std::snprintf(four, sizeof four, "%.3g", double(f));
        tight += (c ? " " : "") + (std::isfinite(f) ? std::string(four) : ValueText(f));
      }
      // In a narrow panel closer together and smaller: the last one counts as much.
      if (ImGui::CalcTextSize(text.substr(0, text.find_last_not_of(' ') + 1).c_str()).x >
          ImGui::GetContentRegionAvail().x)
      {
        ImGui::PopFont();
        ImGui::PushFont(this->Win.Small());
        text = tight;
      }
      ImGui::TextColored(finite ? Colors::Text : Colors::Error, "%s", text.c_str());
      ImGui::PopFont();
      this->Tooltip(name + "\n" + whole);
    }
    ImGui::EndTable();
  }
  // What the picture did not need is not made before somebody asks: a path tracer would trace anew for it.
  std::vector<std::string> missing;
  const auto known = this->LastGood->Arrays.find(ResolveTarget(*this->LastGood->Document, this->A).Node);
  for (const OutputArray& a : known == this->LastGood->Arrays.end() ? std::vector<OutputArray>() : known->second)
  {
    if (a.Name.compare(0, 6, "bounce") != 0 && !shown.Image->GetPointData()->HasArray(a.Name.c_str()))
    {
      missing.push_back(a.Name);
    }
  }
  if (this->AllArrays)
  {
    if (this->Button("Only what the picture needs", "pixel/few", "From the next change on"))
    {
      this->AllArrays = false;
    }
  }
  else if (!missing.empty())
  {
    std::string names;
    for (const std::string& name : missing)
    {
      names += (names.empty() ? "" : ", ") + name;
    }
    if (this->Button(("+ " + std::to_string(missing.size()) + " more").c_str(), "pixel/all",
          ("Runs the frame again for " + names).c_str()))
    {
      this->AllArrays = true;
    }
  }
}

void Viewer::WeighPinned()
{
  const Picture shown = this->PictureOf(this->A);
  const ImageIn v = shown ? ArrayView(shown.Image, shown.Array) : ImageIn();
  std::string node;
  if (this->RightTab == "Pixel" && this->WantWeights && this->PixelValid && v && this->LastGood && !this->Playing)
  {
    const std::vector<std::string> filters =
      FiltersBehind(*this->LastGood, ResolveTarget(*this->LastGood->Document, this->A).Node);
    if (std::find(filters.begin(), filters.end(), this->WeighNode) != filters.end())
    {
      node = this->WeighNode;
    }
    else if (!filters.empty())
    {
      node = filters.front();
    }
  }
  this->Session->Weigh(
    node, node.empty() ? 0 : v.extent.x0 + this->PixelX, node.empty() ? 0 : v.extent.y1 - 1 - this->PixelY);
}

void Viewer::SummarizeWeights()
{
  const std::shared_ptr<const ViewWeights> w = this->Weighed;
  if (!w || this->WeightsOf == w)
  {
    return;
  }
  this->WeightsOf = w;
  this->WeightsSum = WeightsSummary();
  WeightsSummary& s = this->WeightsSum;
  if (w->Weights.Parts.empty())
  {
    return;
  }
  // One map of all parts: where several inputs are filtered, a pixel's weights are added up.
  s.Window = w->Weights.Parts.front().Window;
  for (const PixelWeights::Part& part : w->Weights.Parts)
  {
    s.Window = s.Window.united(part.Window);
  }
  s.Values.assign(std::size_t(s.Window.area()), 0.);
  for (const PixelWeights::Part& part : w->Weights.Parts)
  {
    std::size_t i = 0;
    for (int row = part.Window.y0; row < part.Window.y1; ++row)
    {
      for (int column = part.Window.x0; column < part.Window.x1; ++column, ++i)
      {
        s.Values[std::size_t(row - s.Window.y0) * std::size_t(s.Window.width()) + std::size_t(column - s.Window.x0)] +=
          double(part.Weights[i]);
      }
    }
  }
  double magnitude = 0;
  std::size_t largest = 0;
  for (std::size_t i = 0; i < s.Values.size(); ++i)
  {
    const double v = s.Values[i];
    s.Sum += v;
    s.Squares += v * v;
    magnitude += std::fabs(v);
    s.Negative = s.Negative || v < -1e-7;
    if (std::fabs(v) > std::fabs(s.Values[largest]))
    {
      largest = i;
    }
  }
  s.Most = std::fabs(s.Values[largest]);
  s.LargestX = s.Window.x0 + int(largest % std::size_t(s.Window.width())) - w->X;
  s.LargestY = s.Window.y0 + int(largest / std::size_t(s.Window.width())) - w->Y;
  std::vector<double> sorted = s.Values;
  std::sort(sorted.begin(), sorted.end(), [](double a, double b) { return std::fabs(a) > std::fabs(b); });
  for (double part = 0; s.Needed < sorted.size() && part < 0.99 * magnitude; ++s.Needed)
  {
    part += std::fabs(sorted[s.Needed]);
  }
  // What holds 99 % of the weight, with the pixel in the middle: the rest would only make it small.
  const double least = s.Needed > 0 ? std::fabs(sorted[s.Needed - 1]) : 1.;
  for (int row = s.Window.y0; row < s.Window.y1; ++row)
  {
    for (int column = s.Window.x0; column < s.Window.x1; ++column)
    {
      if (s.At(column, row) != 0 && std::fabs(s.At(column, row)) >= least)
      {
        s.Reach = std::max({ s.Reach, std::abs(column - w->X), std::abs(row - w->Y) });
      }
    }
  }
  DisplayImage map;
  map.Width = map.Height = 2 * s.Reach + 1;
  map.Rgba.resize(4 * std::size_t(map.Width) * std::size_t(map.Height));
  for (int j = 0; j < map.Height; ++j)
  {
    for (int i = 0; i < map.Width; ++i)
    {
      const int column = w->X - s.Reach + i, row = w->Y + s.Reach - j;
      std::uint8_t* to = &map.Rgba[4 * (std::size_t(j) * std::size_t(map.Width) + std::size_t(i))];
      to[0] = to[1] = to[2] = 44;
      to[3] = 255;
      if (s.Window.contains(column, row))
      {
        WeightColor(s, s.Most > 0 ? s.At(column, row) / s.Most : 0., to);
      }
    }
  }
  this->TextureWeights.Upload(this->Win.Get(), map);
}

void Viewer::WeightsMap(float side)
{
  const ImVec2 at = ImGui::GetCursorScreenPos();
  ImDrawList* list = ImGui::GetWindowDrawList();
  const std::shared_ptr<const ViewWeights> w = this->WeightsOf;
  const WeightsSummary& s = this->WeightsSum;
  if (!w || s.Values.empty() || !this->TextureWeights.Id())
  {
    list->AddRectFilled(at, ImVec2(at.x + side, at.y + side), IM_COL32(44, 44, 44, 255));
    ImGui::Dummy(ImVec2(side, side));
    return;
  }
  const float cell = side / float(2 * s.Reach + 1);
  list->AddImage(this->TextureWeights.Id(), at, ImVec2(at.x + side, at.y + side));
  const float grow = std::max(0.f, this->S(3) - cell / 2);
  const ImVec2 own(at.x + float(s.Reach) * cell, at.y + float(s.Reach) * cell);
  list->AddRect(ImVec2(own.x - grow, own.y - grow), ImVec2(own.x + cell + grow, own.y + cell + grow),
    ImGui::GetColorU32(Colors::Accent), 0, 0, this->S(1.5));
  ImGui::InvisibleButton("weights", ImVec2(side, side));
  this->Mark("weights");
  if (ImGui::IsItemHovered())
  {
    const ImVec2 mouse = ImGui::GetIO().MousePos;
    const int i = int((mouse.x - at.x) / cell) - s.Reach, j = int((mouse.y - at.y) / cell) - s.Reach;
    std::string text = "x " + std::to_string(this->PixelX + i) + "  y " + std::to_string(this->PixelY + j);
    const bool inside = s.Window.contains(w->X + i, w->Y - j);
    if (!inside)
    {
      text += "\nbeyond the window or the picture";
    }
    for (const PixelWeights::Part& part : w->Weights.Parts)
    {
      text += inside ? "\n" + Figure(double(part.At(w->X + i, w->Y - j))) + " \u00d7 " + part.Input : "";
    }
    ShowTooltip(text, this->S(300));
  }
}

void Viewer::WeightsPanel(const std::vector<std::string>& filters, int x, int y)
{
  const bool chosen = std::find(filters.begin(), filters.end(), this->WeighNode) != filters.end();
  const std::string node = chosen ? this->WeighNode : filters.front();
  Heading(this->Win, "Weights");
  ImGui::SameLine();
  ImGui::TextColored(Colors::Dim, "of");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(-1);
  if (ImGui::BeginCombo("##weigh", node.c_str()))
  {
    for (const std::string& f : filters)
    {
      if (ImGui::Selectable(f.c_str(), f == node))
      {
        this->WeighNode = f;
      }
      this->Mark("weigh/" + f);
    }
    ImGui::EndCombo();
  }
  this->Mark("weigh");
  this->Tooltip(
    "The filters that made this picture, the nearest first. Shown is what made this very pixel of the "
    "filter: the sum of weight times input is its output. Of Reproject these are pixels of the frame before.");
  const std::shared_ptr<const ViewWeights> w = this->WeightsOf;
  if (!w || w->Node != node || w->X != x || w->Y != y || w->Frame != this->LastGood->Number)
  {
    ImGui::TextColored(Colors::Dim, this->Playing ? "not while it plays" : "\u2026");
    return;
  }
  const WeightsSummary& s = this->WeightsSum;
  if (!w->Error.empty() || s.Values.empty())
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Warning, "%s", w->Error.c_str());
    ImGui::PopTextWrapPos();
    return;
  }
  ImGui::PushFont(this->Win.Small());
  // The middle in numbers, on the map's colours.
  if (ImGui::BeginTable("numbers", 5, ImGuiTableFlags_SizingStretchSame))
  {
    for (int row = y + 2; row >= y - 2; --row)
    {
      ImGui::TableNextRow();
      for (int column = x - 2; column <= x + 2; ++column)
      {
        ImGui::TableNextColumn();
        if (!s.Window.contains(column, row))
        {
          ImGui::TextColored(Colors::Dim, "\u2013");
          continue;
        }
        const double v = s.At(column, row);
        std::uint8_t c[3];
        WeightColor(s, s.Most > 0 ? v / s.Most : 0., c);
        ImGui::TableSetBgColor(ImGuiTableBgTarget_CellBg, IM_COL32(c[0], c[1], c[2], 255));
        char text[24];
        std::snprintf(text, sizeof text, std::fabs(v) >= 1e-4 || v == 0 ? "%.4f" : "%.0e", v);
        const bool bright = 0.3 * c[0] + 0.59 * c[1] + 0.11 * c[2] > 140;
        ImGui::TextColored(bright ? ImVec4(0, 0, 0, 1) : ImVec4(1, 1, 1, 1), "%s", text);
      }
    }
    ImGui::EndTable();
  }
  if (ImGui::BeginTable("weights", 2, ImGuiTableFlags_SizingFixedFit))
  {
    const auto line = [](const char* name, const std::string& value)
    {
      ImGui::TableNextRow();
      ImGui::TableNextColumn();
      ImGui::TextColored(Colors::Dim, "%s", name);
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(value.c_str());
    };
    const bool centre = s.LargestX == 0 && s.LargestY == 0;
    const double largest = s.At(x + s.LargestX, y + s.LargestY);
    line("largest",
      Figure(largest) + (centre
                            ? std::string(", its own")
                            : ", " + std::to_string(std::abs(s.LargestX)) + (s.LargestX < 0 ? " left, " : " right, ") +
                                std::to_string(std::abs(s.LargestY)) + (s.LargestY < 0 ? " below" : " above")));
    line("window", std::to_string(s.Window.width()) + " \u00d7 " + std::to_string(s.Window.height()) + ", 99 % in " +
                     std::to_string(s.Needed) + (s.Needed == 1 ? " pixel" : " pixels"));
    line("sum", Figure(s.Sum));
    // Of several inputs, each one's part: of an average over time, what is new and what is history.
    for (const PixelWeights::Part& part : w->Weights.Parts)
    {
      double sum = 0;
      for (float v : part.Weights)
      {
        sum += double(v);
      }
      if (w->Weights.Parts.size() > 1)
      {
        line(part.Input.c_str(), Figure(sum));
      }
    }
    if (s.Squares > 0 && !s.Negative && s.Sum > 1e-9)
    {
      char pixels[32];
      std::snprintf(pixels, sizeof pixels, "%.3g pixels", s.Sum * s.Sum / s.Squares);
      line("like a mean of", pixels);
    }
    ImGui::EndTable();
  }
  ImGui::PopFont();
}

void Viewer::HistogramPlot()
{
  if (!this->Presented || this->Presented->Bars.Channels == 0)
  {
    ImGui::TextColored(Colors::Dim, "no values");
    return;
  }
  const Histogram& h = this->Presented->Bars;
  const auto value = [&h](double at) { return h.Logarithmic ? std::pow(10., at) : at; };
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size(ImGui::GetContentRegionAvail().x, this->S(110));
  ImDrawList* list = ImGui::GetWindowDrawList();
  list->AddRectFilled(at, ImVec2(at.x + size.x, at.y + size.y), IM_COL32(22, 23, 26, 255), this->S(3));
  double most = 1;
  for (int c = 0; c < h.Channels; ++c)
  {
    for (int n : h.Counts[std::size_t(c)])
    {
      most = std::max(most, std::log1p(double(n)));
    }
  }
  const ImU32 colours[3] = { h.Channels == 1 ? IM_COL32(210, 212, 216, 170) : IM_COL32(240, 90, 90, 130),
    IM_COL32(100, 220, 110, 120), IM_COL32(100, 140, 250, 130) };
  for (int c = 0; c < h.Channels; ++c)
  {
    for (int i = 0; i < Histogram::Bins; ++i)
    {
      const float height =
        float(std::log1p(double(h.Counts[std::size_t(c)][std::size_t(i)])) / most) * (size.y - this->S(6));
      if (height > 0)
      {
        const float x0 = at.x + size.x * float(i) / Histogram::Bins,
                    x1 = at.x + size.x * float(i + 1) / Histogram::Bins;
        list->AddRectFilled(ImVec2(x0, at.y + size.y - height), ImVec2(x1, at.y + size.y), colours[c]);
      }
    }
  }
  ImGui::Dummy(size);
  this->Mark("histogram");
  ImGui::PushFont(this->Win.Small());
  const float axis = ImGui::GetCursorPosX();
  if (h.Logarithmic)
  {
    // A tick for each power of ten.
    for (int d = int(std::ceil(h.Low)); d <= int(std::floor(h.High)); ++d)
    {
      const float x = at.x + size.x * float((d - h.Low) / (h.High - h.Low));
      list->AddLine(ImVec2(x, at.y + size.y - this->S(5)), ImVec2(x, at.y + size.y), IM_COL32(255, 255, 255, 110));
    }
  }
  ImGui::TextColored(Colors::Dim, "%s", Figure(value(h.Low)).c_str());
  if (h.Below + h.Above > 0)
  {
    const std::string beyond = std::to_string(h.Below + h.Above) + " beyond";
    ImGui::SameLine(axis + size.x / 2 - ImGui::CalcTextSize(beyond.c_str()).x / 2);
    ImGui::TextColored(Colors::Dim, "%s", beyond.c_str());
    this->Tooltip(std::to_string(h.Below) + " values are below the axis, " + std::to_string(h.Above) + " above");
  }
  const std::string high = Figure(value(h.High));
  ImGui::SameLine(axis + size.x - ImGui::CalcTextSize(high.c_str()).x);
  ImGui::TextColored(Colors::Dim, "%s", high.c_str());
  for (int c = 0; c < h.Channels; ++c)
  {
    ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(colours[c] | IM_COL32(0, 0, 0, 255)), "mean %-9s min %-9s max %s",
      Figure(h.Mean[std::size_t(c)]).c_str(), Figure(h.Minimum[std::size_t(c)]).c_str(),
      Figure(h.Maximum[std::size_t(c)]).c_str());
  }
  if (h.NonFinite > 0)
  {
    ImGui::TextColored(Colors::Warning, "%lld pixels are not finite", static_cast<long long>(h.NonFinite));
  }
  ImGui::PopFont();
}

void Viewer::ComparePanel()
{
  Heading(this->Win, "Histogram");
  ImGui::SameLine(ImGui::GetContentRegionAvail().x - this->S(76));
  bool logarithmic = this->Presented && this->Presented->Wish.LogHistogram;
  ImGui::PushStyleVar(ImGuiStyleVar_FramePadding, ImVec2(this->S(3), this->S(1)));
  if (ImGui::Checkbox("log axis", &logarithmic))
  {
    this->LogHistogram = logarithmic;
  }
  ImGui::PopStyleVar();
  this->Mark("histogram/log");
  this->Tooltip("Values on a log scale; counts always are");
  this->HistogramPlot();
  ImGui::Dummy(ImVec2(0, this->S(8)));
  Heading(this->Win, "Error against a reference");
  ImGui::PushTextWrapPos(0);
  if (!this->Reference)
  {
    ImGui::TextColored(Colors::Dim, "A converged picture of the same frame turns every change into a number.");
  }
  else
  {
    ImGui::TextColored(Colors::Dim, "%s", ShortPath(this->ReferenceFile).c_str());
    this->Tooltip(this->ReferenceFile);
  }
  ImGui::PopTextWrapPos();
  if (this->Button(this->Reference ? "Another reference\u2026" : "Choose a reference\u2026", "compare/reference"))
  {
    this->OpenFileDialog("reference", "Compare with", ".exr .hdr .png .jpg .pfm");
  }
  if (!this->ReferenceError.empty())
  {
    ImGui::PushTextWrapPos(0);
    ImGui::TextColored(Colors::Error, "%s", this->ReferenceError.c_str());
    ImGui::PopTextWrapPos();
  }
  if (this->Reference && this->Presented)
  {
    if (!this->Presented->ErrorsText.empty())
    {
      ImGui::PushTextWrapPos(0);
      ImGui::TextColored(Colors::Warning, "%s", this->Presented->ErrorsText.c_str());
      ImGui::PopTextWrapPos();
    }
    if (!this->Presented->Errors.empty() && ImGui::BeginTable("errors", 2, ImGuiTableFlags_RowBg))
    {
      for (const auto& e : this->Presented->Errors)
      {
        ImGui::TableNextRow();
        ImGui::TableNextColumn();
        ImGui::TextColored(Colors::Dim, "%s", e.first.c_str());
        ImGui::TableNextColumn();
        ImGui::PushFont(this->Win.Mono());
        ImGui::TextUnformatted(Figure(e.second).c_str());
        ImGui::PopFont();
      }
      ImGui::EndTable();
    }
  }
}
}
