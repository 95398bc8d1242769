// SPDX-License-Identifier: BSD-3-Clause
// Looks and small widgets that the panels share.
#ifndef quellUi_h
#define quellUi_h

#include "quellStageDescription.h"

#include <imgui.h>

#include <string>
#include <utility>
#include <vector>

namespace quell
{
class Window;

/// Neutral grays, so that nothing around a picture tints it; one accent.
namespace Colors
{
extern const ImVec4 Background, Panel, Raised, Line, Text, Dim, Accent, Error, Warning, Good;
}
void ApplyStyle(float scale);

/// The colour of links and pins of a kind.
ImU32 KindColor(ArrayKind kind, float alpha = 1);

enum class Icon
{
  First,
  StepBack,
  Play,
  Pause,
  StepForward,
  Last,
  Loop,
  Eye,
  Camera
};
bool IconButton(const char* id, Icon icon, double scale, bool on = false);
void DrawIcon(ImDrawList* list, const ImVec2& centre, float size, Icon icon, ImU32 colour);

void Heading(const Window& window, const char* text);
/// Lines no longer than `width`, broken at spaces (paths after a slash): Dear ImGui also breaks after a quote or a dot.
std::string Wrapped(const std::string& text, float width);
void ShowTooltip(const std::string& text, float width);
/// Text cut to a width, with an ellipsis.
std::string Fitted(const std::string& text, float width);

std::string Milliseconds(double ms);
std::string Bytes(double bytes);
std::string Figure(double v);                   ///< 4 digits
std::string ShortPath(const std::string& file); ///< "~" for the home
std::string LineOfFile(const std::string& file, int line);
/// The first sentence of a pipeline file's doc.
std::string PipelineBrief(const std::string& file);

struct HelpSection
{
  int Column;
  const char* Title;
  std::vector<std::pair<const char*, const char*>> Lines;
};
const std::vector<HelpSection>& HelpSections();

/// "[0, 1]", "0 or more"; empty where there is nothing to say.
std::string RangeOf(const Property& property);
/// What a value stands for that is no amount: "all of them" where the property's help says "-1: all of them".
std::string MeaningOf(const Property& property, double value);
}

#endif
