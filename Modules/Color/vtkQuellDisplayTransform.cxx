// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellDisplayTransform.h"

#include "quellGuards.h"
#include "quellImageGuard.h"
#include "vtkObjectFactory.h"

#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <dlfcn.h>
#include <filesystem>
#include <fstream>
#include <set>

namespace fs = std::filesystem;
namespace OCIO = OCIO_NAMESPACE;

namespace
{
/// Beyond this any view shows its white; OpenColorIO's own arithmetic fails far above.
constexpr float LargestValue = 65504.f;

std::string Listed(const std::vector<std::string>& names)
{
  std::string text;
  for (const std::string& n : names)
    text += (text.empty() ? "\"" : ", \"") + n + "\"";
  return text.empty() ? "none" : quell::OneLine(text, 1000);
}

/// `name` if it is there, the default for an empty one, else an error with a hint.
std::string Choose(const char* what, const std::string& name, const std::vector<std::string>& names,
  const std::string& fallback, const std::string& path)
{
  if (name.empty())
    return fallback;
  if (std::find(names.begin(), names.end(), name) != names.end())
    return name;
  const std::string near = quell::NearestName(name, names);
  throw quell::StageError("\"" + path + "\" has no " + what + " \"" + name + "\"; " +
                          (near.empty() ? std::string() : "did you mean \"" + near + "\"? ") + "it has " +
                          Listed(names));
}

void AddFiles(const OCIO::ConstTransformRcPtr& transform, std::set<std::string>& files)
{
  if (const auto file = OCIO_DYNAMIC_POINTER_CAST<const OCIO::FileTransform>(transform))
    files.insert(file->getSrc());
  else if (const auto group = OCIO_DYNAMIC_POINTER_CAST<const OCIO::GroupTransform>(transform))
    for (int i = 0; i < group->getNumTransforms(); ++i)
      AddFiles(group->getTransform(i), files);
}

/// Tables that any part of the configuration names.
std::set<std::string> FilesOf(const OCIO::ConstConfigRcPtr& config)
{
  std::set<std::string> files;
  for (int i = 0; i < config->getNumColorSpaces(OCIO::SEARCH_REFERENCE_SPACE_ALL, OCIO::COLORSPACE_ALL); ++i)
    if (const auto space = config->getColorSpace(
          config->getColorSpaceNameByIndex(OCIO::SEARCH_REFERENCE_SPACE_ALL, OCIO::COLORSPACE_ALL, i)))
      for (const auto direction : { OCIO::COLORSPACE_DIR_TO_REFERENCE, OCIO::COLORSPACE_DIR_FROM_REFERENCE })
        AddFiles(space->getTransform(direction), files);
  for (int i = 0; i < config->getNumViewTransforms(); ++i)
    if (const auto view = config->getViewTransform(config->getViewTransformNameByIndex(i)))
      for (const auto direction : { OCIO::VIEWTRANSFORM_DIR_TO_REFERENCE, OCIO::VIEWTRANSFORM_DIR_FROM_REFERENCE })
        AddFiles(view->getTransform(direction), files);
  for (int i = 0; i < config->getNumNamedTransforms(OCIO::NAMEDTRANSFORM_ALL); ++i)
    if (const auto named = config->getNamedTransform(config->getNamedTransformNameByIndex(OCIO::NAMEDTRANSFORM_ALL, i)))
      for (const auto direction : { OCIO::TRANSFORM_DIR_FORWARD, OCIO::TRANSFORM_DIR_INVERSE })
        AddFiles(named->getTransform(direction), files);
  for (int i = 0; i < config->getNumLooks(); ++i)
    if (const auto look = config->getLook(config->getLookNameByIndex(i)))
      for (const auto& transform : { look->getTransform(), look->getInverseTransform() })
        AddFiles(transform, files);
  return files;
}

/// Whether OpenColorIO 2.1 would read it for ever, and take memory all the while: a cineSpace table whose metadata do
/// not end. The library tries every format on every file, so the name says nothing.
bool IsEndless(const std::string& file)
{
  std::ifstream in(file, std::ios::binary);
  const auto next = [&in](std::string& line)
  {
    while (std::getline(in, line))
    {
      const auto begin = line.find_first_not_of(" \t\r\f\v");
      if (begin == std::string::npos)
        continue;
      line.erase(0, begin);
      std::transform(line.begin(), line.end(), line.begin(), [](unsigned char c) { return char(std::toupper(c)); });
      return true;
    }
    return false;
  };
  const auto begins = [](const std::string& line, const char* word) { return line.rfind(word, 0) == 0; };
  std::string line;
  if (!next(line) || !begins(line, "CSPLUTV100") || !next(line) || !next(line) || !begins(line, "BEGIN METADATA"))
    return false;
  while (next(line))
    if (begins(line, "END METADATA"))
      return false;
  return true;
}

void CheckFiles(const OCIO::ConstConfigRcPtr& config)
{
  for (const std::string& name : FilesOf(config))
  {
    std::string file;
    try
    {
      file = config->getCurrentContext()->resolveFileLocation(name.c_str());
    }
    catch (const OCIO::Exception&)
    {
      continue; // whoever needs it says so
    }
    std::error_code ec;
    if (!fs::is_regular_file(file, ec))
      throw OCIO::Exception(("the table " + file + " is no file").c_str());
    if (IsEndless(file))
      throw OCIO::Exception(("the table " + file + " is damaged: its metadata do not end").c_str());
  }
}
}

struct vtkQuellDisplayTransform::Internals
{
  std::string Key;
  fs::file_time_type Written;
  OCIO::ConstCPUProcessorRcPtr Processor;
};

vtkStandardNewMacro(vtkQuellDisplayTransform);
QUELL_STAGE_DESCRIPTION(vtkQuellDisplayTransform)

vtkQuellDisplayTransform::vtkQuellDisplayTransform()
  : Data(new Internals)
{
  this->InitializePorts();
}
vtkQuellDisplayTransform::~vtkQuellDisplayTransform() = default;

void vtkQuellDisplayTransform::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellDisplayTransform;
  d.Category = "Color";
  d.Brief = "Linear radiance to display values through an OpenColorIO view.";
  d.Details =
    "display = clamp(view(radiance 2^Exposure), 0, 1), the view applied to the configuration's `scene_linear` role.\n\n"
    "Pixels that are not finite are replaced by the mean of their finite neighbours (3 x 3, inside the frame; 0 when "
    "there are "
    "none) and counted, and values are clamped to +-65504 before OpenColorIO, which would turn them into black or "
    "NaN.\n\n"
    "The shipped configuration has one display, `sRGB`, with the views `ACES-like` (Narkowicz's 2016 fit to the ACES "
    "tone "
    "curve), `sRGB` (the encoding alone) and `Raw` (no transform).";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "linear, Rec. 709 primaries in the shipped configuration");
  d.Output("display", quell::ArrayKind::Display, "encoded for the display, in [0, 1]").Within(0, 1);
  QUELL_PATH(d, Config, "OpenColorIO configuration (OpenColorIO 2.1); empty: the shipped one");
  QUELL_STRING(d, Display, "display of the configuration; empty: its default");
  QUELL_STRING(d, View, "view of that display; empty: its default");
  QUELL_DOUBLE(d, Exposure, "stops", "gain before the view, 2^Exposure");
}

void vtkQuellDisplayTransform::SetText(std::string& member, const std::string& value)
{
  if (member == value)
    return;
  member = value;
  this->Modified();
}
void vtkQuellDisplayTransform::SetConfig(const std::string& path)
{
  this->SetText(this->Config, path);
}
void vtkQuellDisplayTransform::SetDisplay(const std::string& name)
{
  this->SetText(this->Display, name);
}
void vtkQuellDisplayTransform::SetView(const std::string& name)
{
  this->SetText(this->View, name);
}

int vtkQuellDisplayTransform::HaloFor(int) const
{
  return 1;
}

std::string vtkQuellDisplayTransform::ShippedConfig()
{
  std::vector<fs::path> places;
  if (const char* dir = std::getenv("QUELL_DATA_DIR"))
    places.push_back(fs::path(dir) / "Color/config.ocio");
  Dl_info library;
  if (dladdr(reinterpret_cast<void*>(&vtkQuellDisplayTransform::ShippedConfig), &library) && library.dli_fname)
  {
    std::error_code ec;
    const fs::path dir = fs::weakly_canonical(library.dli_fname, ec).parent_path();
    // <prefix>/lib or <prefix>/lib/<architecture>
    places.push_back(dir.parent_path() / "share/quell/Color/config.ocio");
    places.push_back(dir.parent_path().parent_path() / "share/quell/Color/config.ocio");
  }
  places.push_back(fs::path(QUELL_SOURCE_DATA_DIR) / "Color/config.ocio");
  std::vector<std::string> tried;
  for (const fs::path& place : places)
  {
    std::error_code ec;
    if (fs::is_regular_file(place, ec))
      return place.string();
    tried.push_back(place.string());
  }
  throw quell::StageError("the shipped colour configuration is missing; set Config, or QUELL_DATA_DIR to Quell's data "
                          "directory (looked for " +
                          Listed(tried) + ")");
}

// Makes the processor where settings or file changed; all mistakes in them end here.
void vtkQuellDisplayTransform::CheckSettings()
{
  const std::string path = this->Config.empty() ? ShippedConfig() : this->Config;
  std::error_code ec;
  if (!fs::is_regular_file(path, ec))
    throw quell::StageError(
      "there is no colour configuration \"" + path + "\"; check Config, or leave it empty for the shipped one");
  const std::string key = path + "\n" + this->Display + "\n" + this->View;
  const auto written = fs::last_write_time(path, ec);
  if (!this->Data->Processor || this->Data->Key != key || this->Data->Written != written)
  {
    this->Data->Processor.reset();
    try
    {
      const OCIO::ConstConfigRcPtr config = OCIO::Config::CreateFromFile(path.c_str());
      CheckFiles(config);
      std::vector<std::string> displays, views;
      for (int i = 0; i < config->getNumDisplays(); ++i)
        displays.push_back(config->getDisplay(i));
      const std::string display = Choose("display", this->Display, displays, config->getDefaultDisplay(), path);
      for (int i = 0; i < config->getNumViews(display.c_str()); ++i)
        views.push_back(config->getView(display.c_str(), i));
      const std::string view = Choose("view", this->View, views, config->getDefaultView(display.c_str()), path);
      OCIO::DisplayViewTransformRcPtr transform = OCIO::DisplayViewTransform::Create();
      transform->setSrc(OCIO::ROLE_SCENE_LINEAR);
      transform->setDisplay(display.c_str());
      transform->setView(view.c_str());
      // Lossless: the default set replaces powers and logarithms by approximations.
      this->Data->Processor = config->getProcessor(transform)->getOptimizedCPUProcessor(
        OCIO::BIT_DEPTH_F32, OCIO::BIT_DEPTH_F32, OCIO::OPTIMIZATION_LOSSLESS);
    }
    catch (const OCIO::Exception& e)
    {
      throw quell::StageError("cannot use the colour configuration \"" + path +
                              "\": " + quell::OneLine(e.what(), 1000) + "; OpenColorIO " + OCIO::GetVersion() +
                              " reads configurations up to its own version, leave Config empty for the shipped one");
    }
    this->Data->Key = key;
    this->Data->Written = written;
  }
}

void vtkQuellDisplayTransform::Prepare(quell::StageFrame& frame)
{
  this->CheckSettings();
  const quell::ImageIn in = frame.Input(0);
  bool started = false;
  const quell::Rect region = this->Counted.Add(frame.Region(), frame.Tick(), started).clipped(in.extent);
  long long bad = 0;
  int firstX = 0, firstY = 0;
  for (int y = region.y0; y < region.y1; ++y)
    for (int x = region.x0; x < region.x1; ++x)
      if (!quell::Finite3(in.at(x, y)) && bad++ == 0)
      {
        firstX = x;
        firstY = y;
      }
  this->Counters.NonFinite += bad;
  if (started)
    this->NonFinite = 0;
  // What a later band adds lies below: its first is the first of all.
  if (bad && (this->NonFinite == 0 || firstY < this->FirstY))
  {
    this->FirstX = firstX;
    this->FirstY = firstY;
  }
  this->NonFinite += bad;
  if (this->NonFinite)
  {
    this->CountedWarning = std::to_string(this->NonFinite) + " pixels of radiance are not finite, the first at (" +
                           std::to_string(this->FirstX) + ", " + std::to_string(this->FirstY) +
                           ") from the bottom left; filled from neighbours";
    this->Warnings.push_back(this->CountedWarning);
  }
}

void vtkQuellDisplayTransform::ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const
{
  const quell::ImageIn in = frame.Input(0);
  const quell::ImageOut out = frame.Output("display");
  if (!in || !out)
    return;
  const float gain = float(std::exp2(this->Exposure));
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float v[3];
      quell::ReadFilled(in, x, y, v);
      for (int c = 0; c < 3; ++c)
        out.at(x, y)[c] = std::min(LargestValue, std::max(-LargestValue, v[c] * gain));
    }
    OCIO::PackedImageDesc row(out.at(tile.x0, y), tile.width(), 1, 3);
    this->Data->Processor->apply(row);
    for (float* v = out.at(tile.x0, y); v < out.at(tile.x0, y) + 3 * tile.width(); ++v)
      *v = std::isfinite(*v) ? std::min(1.f, std::max(0.f, *v)) : 0.f;
  }
}
