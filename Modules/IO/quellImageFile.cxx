// SPDX-License-Identifier: BSD-3-Clause
#include "quellImageFile.h"

#include "quellAovNames.h"
#include "quellImageGuard.h"
#include "quellMemoryLimits.h"
#include "quellTemporaryFile.h"

#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <set>

#include <unistd.h>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
constexpr double BufferBytes = 64 << 20;      ///< of rows read or written at once, where 32 rows are not more
constexpr int ReadRows = 64, WriteRows = 256; ///< at once, where they are not more

constexpr float MaximumHalf = 65504.f;
constexpr float MaximumRgbe = 0x1.fdp126f; ///< 254 / 256 2^127: beyond it the one byte of exponent begins anew
[[noreturn]] void Refuse(
  const char* doing, const std::string& path, const std::string& cause, const std::string& remedy)
{
  std::string text = std::string("cannot ") + doing + " \"" + path + "\": " + cause;
  if (!remedy.empty())
    text += "; " + remedy;
  throw StageError(text);
}

std::int64_t FileBytes(const std::string& path)
{
  std::error_code ec;
  const auto size = fs::file_size(path, ec);
  return ec ? 0 : std::int64_t(size);
}

/// Among formats whose readers hold (quellImageGuard.h), with sizes that can be.
std::string CheckedFormat(const std::string& path)
{
  std::error_code ec;
  const fs::file_status status = fs::status(path, ec);
  if (!fs::exists(status))
    Refuse("read", path, "there is no such file",
      "check the path (those in a pipeline are relative to its file, those of the command line to the working "
      "directory)");
  if (fs::is_directory(status))
    Refuse("read", path, "it is a directory", "name a file in it, or a pattern such as frame.####.exr");
  if (!fs::is_regular_file(status)) // opening it might wait for ever
    Refuse("read", path, fs::is_fifo(status) || fs::is_socket(status) ? "it is a pipe" : "it is a device",
      "images are read from files, more than once");
  std::ifstream in(path, std::ios::binary);
  if (!in)
    Refuse("read", path, "permission denied", "check the file's permissions");
  char head[16] = {};
  in.read(head, sizeof head);
  if (in.gcount() == 0)
    Refuse("read", path, "the file is empty", "write it again");
  const std::string format = SniffImage(head, std::size_t(in.gcount()));
  if (format.empty() || format == "webp")
    Refuse("read", path, "this is no image format that Quell reads", ImageFormatRemedy);
  in.clear();
  in.seekg(0);
  if (const ImageFault fault = CheckImageHead(in, format, FileBytes(path)))
    Refuse("read", path, fault.Cause, fault.Remedy);
  return format;
}

/// Runs `work` so that nothing but a StageError with the file's name comes out.
template <class F>
auto Guarded(const char* doing, const std::string& path, F&& work) -> decltype(work())
{
  try
  {
    return work();
  }
  catch (const StageError&)
  {
    throw;
  }
  catch (const std::bad_alloc&)
  {
    Refuse(doing, path, "not enough memory", "ask for fewer arrays or a smaller region; the file may be damaged");
  }
  catch (const std::exception& e)
  {
    Refuse(doing, path, OneLine(e.what()), "the file may be damaged");
  }
}

bool ParseDoubles(const std::string& text, double* out, int n)
{
  const char* p = text.data();
  const char* end = p + text.size();
  for (int i = 0; i < n; ++i)
  {
    while (p < end && *p == ' ')
      ++p;
    const auto result = std::from_chars(p, end, out[i]);
    if (result.ec != std::errc())
      return false;
    p = result.ptr;
  }
  return p == end;
}
std::string FormatDoubles(const double* v, int n)
{
  std::string text;
  for (int i = 0; i < n; ++i)
    text += (i ? " " : "") + detail::FormatDouble(v[i]);
  return text;
}
template <class T>
bool ParseInteger(const std::string& text, T& out)
{
  T v = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), v);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size())
    return false;
  out = v;
  return true;
}

/// The standard attributes have Imath's layout (row vectors), a left-handed camera that looks along +z, and a raster
/// whose origin is the top left corner.
Mat4 ToFileCamera(const Mat4& m)
{
  Mat4 out;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      out.m[j][i] = i == 2 ? -m.m[i][j] : m.m[i][j];
  return out;
}
Mat4 ToFileNdc(const Mat4& m)
{
  Mat4 out;
  for (int j = 0; j < 4; ++j)
  {
    out.m[j][0] = 0.5 * (m.m[3][j] + m.m[0][j]);
    out.m[j][1] = 0.5 * (m.m[3][j] - m.m[1][j]);
    out.m[j][2] = m.m[2][j];
    out.m[j][3] = m.m[3][j];
  }
  return out;
}
/// pbrt writes the same matrices transposed, and its raster's y points up. An affine camera matrix tells which: 0 0 0 1
/// is its last column (Imath's layout) or its last row.
bool IsTransposed(const float* camera)
{
  const auto affine = [&](int stride, int start)
  { return camera[start] == 0 && camera[start + stride] == 0 && camera[start + 2 * stride] == 0; };
  const bool lastColumn = affine(4, 3), lastRow = affine(1, 12);
  return lastRow && !lastColumn;
}
bool FromFile(const float* camera, const float* ndc, FrameFacts& facts)
{
  const bool transposed = IsTransposed(camera);
  for (int i = 0; i < 16; ++i)
    if (!std::isfinite(camera[i]) || !std::isfinite(ndc[i]))
      return false;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
    {
      const double c = transposed ? camera[4 * i + j] : camera[4 * j + i];
      facts.WorldToCamera.m[i][j] = i == 2 ? -c : c;
    }
  for (int j = 0; j < 4; ++j)
  {
    const auto at = [&](int i) { return double(transposed ? ndc[4 * i + j] : ndc[4 * j + i]); };
    facts.WorldToNdc.m[0][j] = 2 * at(0) - at(3);
    facts.WorldToNdc.m[1][j] = transposed ? 2 * at(1) - at(3) : at(3) - 2 * at(1);
    facts.WorldToNdc.m[2][j] = at(2);
    facts.WorldToNdc.m[3][j] = at(3);
  }
  facts.HasCamera = true;
  return true;
}

ArrayKind KindFromName(const std::string& name)
{
  for (int k = 0; k < int(ArrayKind::Any); ++k)
    if (name == KindName(ArrayKind(k)))
      return ArrayKind(k);
  return ArrayKind::Any;
}

struct OpenPart
{
  int Subimage = 0;
  OIIO::ImageSpec Spec;
};

struct OpenFile
{
  std::unique_ptr<OIIO::ImageInput> Input;
  std::vector<OpenPart> Parts;
  std::vector<NamedChannels> Arrays;
  ReadReport Report;
  Rect Display; ///< in the file's raster, y down
};

std::string LibraryError(OIIO::ImageInput* input)
{
  std::string text = input ? input->geterror() : std::string();
  const std::string global = OIIO::geterror();
  return OneLine(text.empty() ? global : text);
}

FrameFacts FactsOf(const OIIO::ImageSpec& spec, const std::map<std::string, std::string>& entries)
{
  FrameFacts facts;
  const auto find = [&](const char* name)
  {
    const auto found = entries.find(name);
    return found == entries.end() ? std::string() : found->second;
  };
  double camera[16], ndc[16], origin[3];
  if (ParseDoubles(find("worldToCamera"), camera, 16) && ParseDoubles(find("worldToNdc"), ndc, 16))
  {
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
      {
        facts.WorldToCamera.m[i][j] = camera[4 * i + j];
        facts.WorldToNdc.m[i][j] = ndc[4 * i + j];
      }
    facts.HasCamera = true;
  }
  else
  {
    const OIIO::ParamValue* c = spec.find_attribute("worldToCamera", OIIO::TypeMatrix);
    const OIIO::ParamValue* n = spec.find_attribute("worldToNDC", OIIO::TypeMatrix);
    if (c && n)
      FromFile(static_cast<const float*>(c->data()), static_cast<const float*>(n->data()), facts);
  }
  if (ParseDoubles(find("origin"), origin, 3))
    facts.Origin = { origin[0], origin[1], origin[2] };
  ParseInteger(find("tick"), facts.Tick);
  ParseInteger(find("seed"), facts.Seed);
  if (!ParseInteger(find("samplesPerPixel"), facts.SamplesPerPixel))
    facts.SamplesPerPixel = std::max(0, spec.get_int_attribute("samplesPerPixel", 0));
  ParseDoubles(find("time"), &facts.Time, 1);
  facts.Scene = find("scene");
  facts.Partial = find("partial");
  return facts;
}

OpenFile Open(const std::string& path, const ReadOptions& options)
{
  OpenFile file;
  ReadReport& report = file.Report;
  report.Format = CheckedFormat(path);
  OIIO::geterror();
  file.Input = OIIO::ImageInput::create(report.Format);
  if (!file.Input)
    Refuse("read", path, "OpenImageIO was built without support for " + report.Format, "convert it to OpenEXR");
  OIIO::ImageSpec config, spec;
  config.attribute("oiio:UnassociatedAlpha", 1);
  if (!file.Input->open(path, spec, config))
    Refuse("read", path, LibraryError(file.Input.get()), "the file is damaged or not finished: write it again");

  const bool exr = report.Format == "openexr";
  const std::int64_t bytes = FileBytes(path);
  std::vector<FilePart> names;
  int deep = 0, otherSize = 0;
  for (int s = 0; s < (exr ? 256 : 1) && file.Input->seek_subimage(s, 0); ++s)
  {
    spec = file.Input->spec();
    if (spec.deep)
    {
      ++deep;
      continue;
    }
    if (const ImageFault fault = CheckImageSpec(spec, bytes))
      Refuse("read", path, fault.Cause, fault.Remedy);
    const Rect display{ spec.full_x, spec.full_y, spec.full_x + spec.full_width, spec.full_y + spec.full_height };
    if (!file.Parts.empty() && display != file.Display)
    {
      ++otherSize;
      continue;
    }
    file.Display = display;
    const int h = display.y1;
    const Rect window{ spec.x - display.x0, h - (spec.y + spec.height), spec.x - display.x0 + spec.width, h - spec.y };
    report.DataWindow = report.DataWindow.united(window);
    FilePart part;
    part.Name = spec.get_string_attribute("oiio:subimagename");
    part.Channels = spec.channelnames;
    part.Channels.resize(spec.nchannels);
    if (!exr)
    {
      // CMYK and the like have become RGB; whatever a file calls its channels, their order is known.
      static const char* const byCount[4][4] = { { "Y" }, { "Y", "A" }, { "R", "G", "B" }, { "R", "G", "B", "A" } };
      for (int c = 0; c < std::min(4, spec.nchannels); ++c)
        part.Channels[c] = byCount[std::min(4, spec.nchannels) - 1][c];
    }
    names.push_back(part);
    file.Parts.push_back({ s, spec });
  }
  if (file.Parts.empty())
  {
    if (deep)
      Refuse("read", path, "it holds deep samples (several per pixel)",
        "flatten it first, e.g. oiiotool IN --flatten -o OUT");
    Refuse("read", path, LibraryError(file.Input.get()), "the file is damaged: write it again");
  }
  if (deep)
    report.Warnings.push_back("\"" + path + "\": deep parts were left out");
  if (otherSize)
    report.Warnings.push_back("\"" + path + "\": parts with another display window than the first were left out");

  const OIIO::ImageSpec& first = file.Parts[0].Spec;
  report.Width = file.Display.width();
  report.Height = file.Display.height();
  std::map<std::string, ArrayKind> kinds;
  for (const auto& attribute : first.extra_attribs)
  {
    const std::string name = attribute.name().string();
    if (name.compare(0, 6, "quell:") == 0)
      report.Metadata[name.substr(6)] = attribute.get_string();
    else
      report.Attributes[name] = attribute.get_string();
  }
  ChannelDialect dialect = ChannelDialect::Other;
  const auto has = [&](const char* channel)
  { return std::find(names[0].Channels.begin(), names[0].Channels.end(), channel) != names[0].Channels.end(); };
  if (report.Metadata.count("format"))
  {
    dialect = ChannelDialect::Quell;
    // "layer=kind layer=kind"; the plain layer is "-".
    const std::string layers = report.Metadata.count("layers") ? report.Metadata["layers"] : std::string();
    for (size_t p = 0; p < layers.size();)
    {
      const size_t end = std::min(layers.find(' ', p), layers.size());
      const std::string entry = layers.substr(p, end - p);
      const size_t equal = entry.find('=');
      if (equal != std::string::npos)
        kinds[entry.substr(0, equal) == "-" ? std::string() : entry.substr(0, equal)] =
          KindFromName(entry.substr(equal + 1));
      p = end + 1;
    }
  }
  else if (report.Attributes.count("BlenderMultiChannel"))
    dialect = ChannelDialect::Blender;
  else if (has("Ns.X") && has("dzdx"))
    dialect = ChannelDialect::Pbrt;
  file.Arrays = NameArrays(names, dialect, options.PlainArray, kinds);
  for (const NamedChannels& array : file.Arrays)
  {
    FileArray entry;
    entry.Name = array.Array;
    entry.Kind = array.Kind;
    const OIIO::ImageSpec& part = file.Parts[array.Part].Spec;
    for (int c : array.Channels)
      entry.Channels.push_back(
        c < int(part.channelnames.size()) ? part.channelnames[c] : names[array.Part].Channels[c]);
    entry.Type = part.channelformat(array.Channels[0]).c_str();
    report.Arrays.push_back(entry);
  }
  report.Facts = FactsOf(first, report.Metadata);
  for (const char* internal :
    { "format", "layers", "worldToCamera", "worldToNdc", "origin", "tick", "time", "seed", "samplesPerPixel", "scene" })
    report.Metadata.erase(internal);
  const auto chromaticities = report.Attributes.find("chromaticities");
  if (chromaticities != report.Attributes.end() && dialect != ChannelDialect::Quell)
  {
    static const float rec709[8] = { .64f, .33f, .3f, .6f, .15f, .06f, .3127f, .329f };
    const OIIO::ParamValue* value = first.find_attribute("chromaticities");
    bool same = value && value->type().basetype == OIIO::TypeDesc::FLOAT && value->type().numelements() == 8;
    for (int i = 0; same && i < 8; ++i)
      same = std::fabs(static_cast<const float*>(value->data())[i] - rec709[i]) < 2e-3f;
    if (!same)
      report.Warnings.push_back("\"" + path + "\": its primaries are not Rec. 709 and were not converted");
  }
  return file;
}

float DecodeSrgb(float v)
{
  return v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
}
float EncodeSrgb(float v)
{
  return v <= 0.0031308f ? v * 12.92f : 1.055f * std::pow(v, 1.f / 2.4f) - 0.055f;
}

vtkSmartPointer<vtkFloatArray> NewArray(
  vtkImageData* image, const std::string& name, int components, float background, float* memory)
{
  auto array = vtkSmartPointer<vtkFloatArray>::New();
  array->SetName(name.c_str());
  array->SetNumberOfComponents(components);
  if (memory)
    array->SetArray(memory, image->GetNumberOfPoints() * components, 1);
  else
    array->SetNumberOfTuples(image->GetNumberOfPoints());
  std::fill_n(array->GetPointer(0), std::size_t(image->GetNumberOfPoints()) * components, background);
  image->GetPointData()->AddArray(array);
  return array;
}

/// A destination of one channel of a part.
struct Target
{
  int Channel = 0;
  float* Data = nullptr; ///< component of the array's first pixel
  int Components = 0;
};

void ThrowIf(const std::function<bool()>& cancelled)
{
  if (cancelled && cancelled())
    throw StageError("cancelled");
}

/// Reads channels [lo, hi) of all rows in `rows` (file raster), a block at a time, and hands each block over.
void ReadBlocks(const std::string& path, OpenFile& file, const OpenPart& part, const Rect& wanted, int lo, int hi,
  OIIO::TypeDesc type, const std::function<bool()>& cancelled,
  const std::function<void(const void*, const Rect&)>& give)
{
  const OIIO::ImageSpec& spec = part.Spec;
  const bool tiled = spec.tile_width > 0;
  Rect block = wanted;
  int step = ReadRows;
  if (tiled)
  {
    const auto down = [](int v, int origin, int size) { return origin + (v - origin) / size * size; };
    block.x0 = down(wanted.x0, spec.x, spec.tile_width);
    block.x1 = std::min(down(wanted.x1 - 1, spec.x, spec.tile_width) + spec.tile_width, spec.x + spec.width);
    block.y0 = down(wanted.y0, spec.y, spec.tile_height);
    step = std::max(spec.tile_height, step / spec.tile_height * spec.tile_height);
  }
  else
  {
    block.x0 = spec.x;
    block.x1 = spec.x + spec.width;
    // Whole compression blocks, or each would be unpacked twice.
    block.y0 = spec.y + (wanted.y0 - spec.y) / 256 * 256;
    if (wanted.y0 - block.y0 >= 32)
      block.y0 += (wanted.y0 - block.y0) / 32 * 32;
  }
  const std::int64_t row = std::int64_t(block.width()) * (hi - lo) * 4;
  while (step > 32 && !tiled && double(row * step) > BufferBytes)
    step /= 2;
  if (const ImageFault fault = CheckImageRows(spec))
    Refuse("read", path, fault.Cause, fault.Remedy);
  std::vector<unsigned char> buffer(size_t(row) * size_t(std::min(step, spec.y + spec.height - block.y0)));
  for (int y = block.y0; y < wanted.y1; y += step)
  {
    ThrowIf(cancelled);
    const Rect now{ block.x0, y, block.x1, std::min(y + step, spec.y + spec.height) };
    const bool ok =
      tiled
        ? file.Input->read_tiles(part.Subimage, 0, now.x0, now.x1, now.y0, now.y1, 0, 1, lo, hi, type, buffer.data())
        : file.Input->read_scanlines(part.Subimage, 0, now.y0, now.y1, 0, lo, hi, type, buffer.data());
    if (!ok)
      Refuse("read", path, LibraryError(file.Input.get()), "the file is damaged or was cut off: write it again");
    give(buffer.data(), now);
  }
}

void ReadArrays(const std::string& path, OpenFile& file, const ReadOptions& options, vtkImageData* image)
{
  const Rect whole{ 0, 0, file.Report.Width, file.Report.Height };
  const Rect region = options.Region.empty() ? whole : options.Region;
  if (!whole.contains(region))
    Refuse("read", path,
      "the region lies outside the frame of " + std::to_string(whole.width()) + " x " + std::to_string(whole.height()) +
        " pixels",
      "choose a region inside");
  image->SetExtent(region.x0, region.x1 - 1, region.y0, region.y1 - 1, 0, 0);

  std::vector<const NamedChannels*> wanted;
  std::int64_t components = 0;
  for (const NamedChannels& array : file.Arrays)
    if (options.Arrays.empty() || options.Arrays.count(array.Array))
    {
      wanted.push_back(&array);
      components += std::int64_t(array.Channels.size());
    }
  // Memory of the caller's own is limited there.
  const std::int64_t limit =
    std::min<std::int64_t>(options.MaximumBytes, std::int64_t(std::min<std::uint64_t>(PixelMemoryLimit(), INT64_MAX)));
  if (components * 4 * region.area() > limit && options.Into.empty())
    Refuse("read", path,
      "the arrays asked for need " + std::to_string(components * 4 * region.area() >> 20) +
        " MiB, more than the limit of " + std::to_string(limit >> 20) + " MiB",
      "ask for fewer arrays or a smaller region, or allow more with --memory MB");

  std::map<int, std::vector<Target>> targets;
  for (const NamedChannels* array : wanted)
  {
    const ArrayType* known = FindArray(array->Array);
    const int n = int(array->Channels.size());
    const auto into = options.Into.find(array->Array);
    auto data = NewArray(
      image, array->Array, n, known ? known->Background : 0.f, into == options.Into.end() ? nullptr : into->second);
    for (int c = 0; c < n; ++c)
      targets[array->Part].push_back({ array->Channels[c], data->GetPointer(0) + c, n });
  }

  const bool exr = file.Report.Format == "openexr";
  for (auto& entry : targets)
  {
    const OpenPart& part = file.Parts[entry.first];
    const OIIO::ImageSpec& spec = part.Spec;
    // Region and data window, both in the file's raster.
    const Rect rows{ region.x0 + file.Display.x0, file.Display.y1 - region.y1, region.x1 + file.Display.x0,
      file.Display.y1 - region.y0 };
    const Rect window{ spec.x, spec.y, spec.x + spec.width, spec.y + spec.height };
    const Rect inside = rows.clipped(window);
    if (inside.empty())
      continue;
    // Integers would come scaled to [0, 1] among floats, so they are read apart, each channel as it is.
    std::set<int> floats, integers;
    for (const Target& t : entry.second)
      (exr && spec.channelformat(t.Channel).basetype == OIIO::TypeDesc::UINT32 ? integers : floats).insert(t.Channel);
    std::vector<std::pair<int, int>> runs;
    if (!floats.empty())
      runs.push_back({ *floats.begin(), *floats.rbegin() + 1 });
    for (int c : integers)
      runs.push_back({ c, c + 1 });
    bool inexact = false;
    for (size_t r = 0; r < runs.size(); ++r)
    {
      const bool isFloat = r == 0 && !floats.empty();
      const int lo = runs[r].first, n = runs[r].second - lo;
      ReadBlocks(path, file, part, inside, lo, lo + n, isFloat ? OIIO::TypeFloat : OIIO::TypeUInt32, options.Cancelled,
        [&](const void* block, const Rect& at)
        {
          const Rect copy = at.clipped(inside);
          for (const Target& t : entry.second)
          {
            if (!(isFloat ? floats : integers).count(t.Channel) || t.Channel < lo || t.Channel >= lo + n)
              continue;
            for (int y = copy.y0; y < copy.y1; ++y)
            {
              const size_t offset = (size_t(y - at.y0) * at.width() + (copy.x0 - at.x0)) * n + (t.Channel - lo);
              const int outY = file.Display.y1 - 1 - y - region.y0, outX = copy.x0 - file.Display.x0 - region.x0;
              float* out = t.Data + (std::ptrdiff_t(outY) * region.width() + outX) * t.Components;
              if (isFloat)
              {
                const float* in = static_cast<const float*>(block) + offset;
                for (int x = copy.x0; x < copy.x1; ++x, in += n, out += t.Components)
                  *out = *in;
              }
              else
              {
                const std::uint32_t* in = static_cast<const std::uint32_t*>(block) + offset;
                for (int x = copy.x0; x < copy.x1; ++x, in += n, out += t.Components)
                {
                  *out = float(*in);
                  inexact = inexact || *in > (1u << 24);
                }
              }
            }
          }
        });
    }
    if (inexact)
      file.Report.Warnings.push_back("\"" + path + "\": integers beyond 2^24 were rounded to float");
  }

  const bool integerFile = !exr && file.Parts[0].Spec.format.is_floating_point() == false;
  const bool decode = options.Transfer == FileTransfer::Srgb ||
                      (options.Transfer == FileTransfer::Automatic && integerFile && file.Report.Format != "hdr");
  for (const NamedChannels* array : wanted)
  {
    auto data = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array->Array.c_str()));
    float* v = data->GetPointer(0);
    const std::int64_t count = data->GetNumberOfValues();
    const float inf = std::numeric_limits<float>::infinity();
    switch (array->Conversion)
    {
      case ChannelConversion::FlipY:
        for (std::int64_t i = 1; i < count; i += data->GetNumberOfComponents())
          v[i] = -v[i];
        break;
      case ChannelConversion::FarIsInfinite:
        for (std::int64_t i = 0; i < count; ++i)
          v[i] = v[i] >= 1e10f ? inf : v[i];
        break;
      case ChannelConversion::ZeroIsInfinite:
        for (std::int64_t i = 0; i < count; ++i)
          v[i] = v[i] == 0.f ? inf : v[i];
        break;
      case ChannelConversion::None:
        break;
    }
    if (decode && array->Array != "alpha")
      for (std::int64_t i = 0; i < count; ++i)
        v[i] = DecodeSrgb(v[i]);
  }
  file.Report.Facts.Write(image->GetFieldData());
}
}

ReadReport ReadImageHeader(const std::string& path, const ReadOptions& options)
{
  return Guarded("read", path, [&] { return Open(path, options).Report; });
}

vtkSmartPointer<vtkImageData> ReadImageFile(const std::string& path, ReadReport* report, const ReadOptions& options)
{
  return Guarded("read", path,
    [&]
    {
      OpenFile file = Open(path, options);
      for (const std::string& name : options.Arrays)
        if (std::none_of(
              file.Arrays.begin(), file.Arrays.end(), [&](const NamedChannels& a) { return a.Array == name; }))
        {
          std::vector<std::string> names;
          std::string list;
          for (const NamedChannels& a : file.Arrays)
          {
            names.push_back(a.Array);
            list += (list.empty() ? "" : ", ") + a.Array;
          }
          const std::string near = NearestName(name, names);
          Refuse("read", path, "it has no array \"" + name + "\"",
            (near.empty() ? std::string("it holds ") : "did you mean \"" + near + "\"? It holds ") + list);
        }
      auto image = vtkSmartPointer<vtkImageData>::New();
      ReadArrays(path, file, options, image);
      if (report)
        *report = file.Report;
      return image;
    });
}

std::string SequencePath(const std::string& pattern, int tick)
{
  const size_t slash = pattern.find_last_of('/');
  const size_t start = slash == std::string::npos ? 0 : slash + 1;
  const size_t last = pattern.find_last_of('#');
  if (last == std::string::npos || last < start)
    return pattern;
  size_t first = last;
  while (first > start && pattern[first - 1] == '#')
    --first;
  char digits[32];
  std::snprintf(digits, sizeof(digits), "%0*d", int(std::min<size_t>(last - first + 1, 20)), tick);
  return pattern.substr(0, first) + digits + pattern.substr(last + 1);
}

std::vector<int> SequenceNumbers(const std::string& pattern)
{
  std::vector<int> numbers;
  if (SequencePath(pattern, 0) == pattern)
    return numbers;
  const std::filesystem::path folder = std::filesystem::path(pattern).parent_path();
  std::error_code error;
  for (std::filesystem::directory_iterator file(folder.empty() ? "." : folder, error), end; !error && file != end;
       file.increment(error))
  {
    // A file belongs when its digits, put into the pattern, give its name.
    const std::string name = (folder / file->path().filename()).string();
    std::size_t at = std::mismatch(name.begin(), name.end(), pattern.begin(), pattern.end()).first - name.begin();
    while (at > 0 && std::isdigit(static_cast<unsigned char>(name[at - 1])))
      --at;
    if (at > 0 && at < name.size() && name[at - 1] == '-')
      --at;
    int number = 0;
    const auto parsed = std::from_chars(name.data() + at, name.data() + name.size(), number);
    if (parsed.ec == std::errc() && SequencePath(pattern, number) == name)
      numbers.push_back(number);
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

std::string SequenceSample(const std::string& pattern, int tick)
{
  const std::string wanted = SequencePath(pattern, tick);
  std::error_code error;
  if (wanted == pattern || std::filesystem::exists(wanted, error))
    return wanted;
  const std::vector<int> numbers = SequenceNumbers(pattern);
  return numbers.empty() ? wanted : SequencePath(pattern, numbers.front());
}

std::string SequenceFile(const std::string& pattern, int tick)
{
  const std::string path = SequencePath(pattern, tick);
  std::error_code error;
  if (path == pattern || std::filesystem::exists(path, error))
    return path;
  const std::vector<int> numbers = SequenceNumbers(pattern);
  std::string ranges;
  std::size_t count = 0;
  for (std::size_t i = 0; i < numbers.size();)
  {
    std::size_t end = i + 1;
    while (end < numbers.size() && numbers[end] == numbers[end - 1] + 1)
      ++end;
    if (++count <= 8)
      ranges += (ranges.empty() ? "" : ", ") + std::to_string(numbers[i]) +
                (end - i > 1 ? ":" + std::to_string(numbers[end - 1]) : std::string());
    i = end;
  }
  throw StageError("frame " + std::to_string(tick) + " of \"" + pattern + "\" is missing: there is no \"" + path +
                   "\"; the sequence has " +
                   (numbers.empty() ? "no files" : (numbers.size() > 1 ? "frames " : "frame ") + ranges) +
                   (count > 8 ? " and more" : ""));
}

namespace
{
/// A layer ready to be written.
struct OutLayer
{
  std::string Layer;
  ArrayKind Kind = ArrayKind::Any;
  std::string Name;
  ImageIn View;
  std::vector<std::string> Channels;
  bool AsHalf = false;
};

/// Where the library writes to. Some of its formats ignore that a disk is full, and one ends the process: they are told
/// that all went well, and Error() tells us.
class CheckedFile : public OIIO::Filesystem::IOProxy
{
public:
  CheckedFile(const std::string& name, int file)
    : IOProxy(name, Write)
    , File(file)
  {
  }
  const char* proxytype() const override { return "quell"; } // of "file" the library would want its FILE
  std::size_t write(const void* data, std::size_t size) override
  {
    if (this->m_pos != this->Start + std::int64_t(this->Buffer.size()) || this->Buffer.size() + size > (1u << 20))
    {
      this->Flush();
      this->Start = this->m_pos;
    }
    if (size > (1u << 20))
      this->Put(data, size, this->m_pos);
    else
      this->Buffer.append(static_cast<const char*>(data), size);
    this->m_pos += std::int64_t(size);
    if (size > (1u << 20))
      this->Start = this->m_pos;
    this->End = std::max(this->End, this->m_pos);
    return size;
  }
  std::size_t pwrite(const void* data, std::size_t size, int64_t offset) override
  {
    this->Flush();
    this->Put(data, size, offset);
    this->End = std::max<std::int64_t>(this->End, offset + std::int64_t(size));
    return size;
  }
  std::size_t pread(void* data, std::size_t size, int64_t offset) override
  {
    this->Flush();
    const ssize_t n = ::pread(this->File, data, size, offset);
    return n > 0 ? std::size_t(n) : 0;
  }
  std::size_t read(void* data, std::size_t size) override
  {
    const std::size_t n = this->pread(data, size, this->m_pos);
    this->m_pos += std::int64_t(n);
    return n;
  }
  std::size_t size() const override { return std::size_t(this->End); }
  void Flush()
  {
    this->Put(this->Buffer.data(), this->Buffer.size(), this->Start);
    this->Start += std::int64_t(this->Buffer.size());
    this->Buffer.clear();
  }
  int Error() const { return this->Failure; } ///< errno of the first write that failed

private:
  void Put(const void* data, std::size_t size, std::int64_t at)
  {
    const char* from = static_cast<const char*>(data);
    while (size > 0 && this->Failure == 0)
    {
      const ssize_t n = ::pwrite(this->File, from, size, at);
      if (n < 0 && errno == EINTR)
        continue;
      if (n <= 0)
        this->Failure = n < 0 ? errno : ENOSPC;
      else
      {
        from += n;
        at += n;
        size -= std::size_t(n);
      }
    }
  }

  int File, Failure = 0;
  std::string Buffer;
  std::int64_t Start = 0, End = 0; ///< of the buffer; of the file
};

/// Keeps float32 for what half would spoil: exact integers, distances, offsets and squares.
bool MayBeHalf(ArrayKind kind)
{
  switch (kind)
  {
    case ArrayKind::Color:
    case ArrayKind::Albedo:
    case ArrayKind::Normal:
    case ArrayKind::Scalar:
    case ArrayKind::Display:
      return true;
    default:
      return false;
  }
}

std::vector<OutLayer> PrepareLayers(
  const std::string& path, vtkImageData* image, std::vector<LayerSpec> layers, const Rect& region, bool half)
{
  if (layers.empty())
  {
    for (int i = 0; i < image->GetPointData()->GetNumberOfArrays(); ++i)
      if (const char* name = image->GetPointData()->GetArrayName(i))
        layers.push_back({ name, std::string(), ArrayKind::Any, nullptr });
    std::stable_partition(layers.begin(), layers.end(), [](const LayerSpec& l) { return l.Array == "radiance"; });
  }
  if (layers.empty())
    Refuse("write", path, "there is no array to write", "connect at least one layer");
  std::vector<OutLayer> out;
  std::set<std::string> used;
  bool plainTaken = false;
  for (const LayerSpec& spec : layers)
  {
    vtkImageData* source = spec.Image ? spec.Image : image;
    vtkDataArray* any = source ? source->GetPointData()->GetArray(spec.Array.c_str()) : nullptr;
    vtkFloatArray* array = vtkFloatArray::SafeDownCast(any);
    if (!array)
      Refuse("write", path,
        any ? "the array \"" + spec.Array + "\" is not float" : "there is no array \"" + spec.Array + "\"", "");
    const int n = array->GetNumberOfComponents();
    if (n < 1 || n > 4)
      Refuse(
        "write", path, "the array \"" + spec.Array + "\" has " + std::to_string(n) + " components, not 1 to 4", "");
    int e[6];
    source->GetExtent(e);
    OutLayer layer;
    layer.Name = spec.Array;
    layer.View = ImageIn(array->GetPointer(0), n, { e[0], e[2], e[1] + 1, e[3] + 1 });
    if (!layer.View.extent.contains(region))
      Refuse("write", path, "the array \"" + spec.Array + "\" does not cover the region to write", "");
    layer.Kind = spec.Kind;
    const ArrayType* known = FindArray(spec.Array);
    if (layer.Kind == ArrayKind::Any && known && known->Components == n)
      layer.Kind = known->Kind;
    if (layer.Kind == ArrayKind::Any)
      layer.Kind = n == 1 ? ArrayKind::Scalar : n >= 3 ? ArrayKind::Color : ArrayKind::Any;
    layer.AsHalf = half && MayBeHalf(layer.Kind);
    const bool colour = n >= 3 && (layer.Kind == ArrayKind::Color || layer.Kind == ArrayKind::Display);
    if (!spec.Layer.empty())
      layer.Layer = spec.Layer;
    else if (colour && !plainTaken)
      layer.Layer.clear();
    else
      layer.Layer = spec.Array == "radiance" ? spec.Array : StandardLayer(spec.Array);
    plainTaken = plainTaken || (colour && layer.Layer.empty());
    for (char c : layer.Layer)
      if (!std::isalnum(static_cast<unsigned char>(c)) && !std::strchr("_.-", c))
        Refuse("write", path,
          "the layer name \"" + layer.Layer + "\" has a character other than letters, digits, _ . -",
          "choose another name");
    layer.Channels = ChannelNames(layer.Layer, layer.Kind, n);
    for (const std::string& channel : layer.Channels)
      if (!used.insert(channel).second)
        Refuse("write", path, "two layers have the channel \"" + channel + "\"",
          "give the layer of \"" + spec.Array + "\" another name, e.g. name=\"" + spec.Array + "2\"");
    out.push_back(layer);
  }
  return out;
}

const char* CompressionName(FileCompression c)
{
  static const char* const names[] = { "none", "rle", "zips", "zip", "piz", "pxr24", "dwaa", "dwab" };
  return names[int(c)];
}

OIIO::ImageSpec ExrSpec(const std::vector<OutLayer>& layers, const FrameFacts& facts, const Rect& region, int width,
  int height, const WriteOptions& options)
{
  OIIO::ImageSpec spec(region.width(), region.height(), 0, OIIO::TypeFloat);
  spec.x = region.x0;
  spec.y = height - region.y1;
  spec.full_x = spec.full_y = 0;
  spec.full_width = width;
  spec.full_height = height;
  std::string kinds;
  bool anyHalf = false, allHalf = true;
  for (const OutLayer& layer : layers)
  {
    kinds +=
      (kinds.empty() ? "" : " ") + (layer.Layer.empty() ? std::string("-") : layer.Layer) + "=" + KindName(layer.Kind);
    for (const std::string& channel : layer.Channels)
    {
      spec.channelnames.push_back(channel);
      spec.channelformats.push_back(layer.AsHalf ? OIIO::TypeHalf : OIIO::TypeFloat);
      anyHalf = anyHalf || layer.AsHalf;
      allHalf = allHalf && layer.AsHalf;
    }
  }
  spec.nchannels = int(spec.channelnames.size());
  if (allHalf)
    spec.set_format(OIIO::TypeHalf);
  if (allHalf || !anyHalf)
    spec.channelformats.clear();
  spec.attribute("compression", CompressionName(options.Compression));
  spec.attribute("oiio:ColorSpace", "Linear");
  for (const auto& entry : options.Metadata)
    spec.attribute(entry.first.compare(0, 6, "quell:") == 0 ? entry.first : "quell:" + entry.first, entry.second);
  if (facts.HasCamera)
  {
    float m[16];
    for (const bool ndc : { false, true })
    {
      const Mat4 matrix = ndc ? ToFileNdc(facts.WorldToNdc) : ToFileCamera(facts.WorldToCamera);
      for (int i = 0; i < 16; ++i)
        m[i] = float((&matrix.m[0][0])[i]);
      spec.attribute(ndc ? "worldToNDC" : "worldToCamera", OIIO::TypeMatrix, m);
    }
    spec.attribute("quell:worldToCamera", FormatDoubles(&facts.WorldToCamera.m[0][0], 16));
    spec.attribute("quell:worldToNdc", FormatDoubles(&facts.WorldToNdc.m[0][0], 16));
    const double origin[3] = { facts.Origin.x, facts.Origin.y, facts.Origin.z };
    spec.attribute("quell:origin", FormatDoubles(origin, 3));
  }
  spec.attribute("quell:format", "1");
  spec.attribute("quell:layers", kinds);
  spec.attribute("quell:tick", std::to_string(facts.Tick));
  spec.attribute("quell:time", detail::FormatDouble(facts.Time));
  spec.attribute("quell:seed", std::to_string(facts.Seed));
  spec.attribute("quell:samplesPerPixel", std::to_string(facts.SamplesPerPixel));
  if (!facts.Scene.empty())
    spec.attribute("quell:scene", facts.Scene);
  if (!facts.Partial.empty())
    spec.attribute("quell:partial", facts.Partial);
  return spec;
}

/// Which of the layers of a file of another format is its colour, and which its alpha.
struct PlainLayers
{
  std::size_t Colour = 0;
  int Alpha = -1;
  int Channels = 0; ///< of the colour in the file
  bool Linear = false;
};

PlainLayers FindPlainLayers(const std::string& path, const std::string& extension, const std::vector<OutLayer>& layers)
{
  PlainLayers plain;
  const OutLayer& colour = layers[0];
  if (layers.size() == 2 && layers[1].View.components == 1 && layers[1].Name == "alpha")
    plain.Alpha = 1;
  if (layers.size() > (plain.Alpha > 0 ? 2u : 1u))
    Refuse("write", path,
      "a " + extension + " file holds one colour layer, but " + std::to_string(layers.size()) + " are connected",
      "write .exr, or one file per layer");
  plain.Linear = extension == ".hdr" || extension == ".pfm";
  plain.Channels = plain.Linear ? 3 : colour.View.components;
  if (colour.View.components == 2 || (plain.Linear && colour.View.components > 3))
    Refuse("write", path,
      "the array \"" + colour.Name + "\" has " + std::to_string(colour.View.components) + " components, which a " +
        extension + " file cannot hold",
      "write .exr");
  if (extension != ".png" && extension != ".tif" && extension != ".tiff" && extension != ".tga")
    plain.Alpha = -1;
  return plain;
}

OIIO::ImageSpec PlainSpec(const PlainLayers& plain, const std::string& extension, const Rect& region)
{
  const int channels = plain.Channels + (plain.Alpha > 0 ? 1 : 0);
  OIIO::ImageSpec spec(region.width(), region.height(), channels, plain.Linear ? OIIO::TypeFloat : OIIO::TypeUInt8);
  if (plain.Alpha > 0)
  {
    spec.alpha_channel = plain.Channels;
    spec.attribute("oiio:UnassociatedAlpha", 1);
  }
  // In a TIFF it becomes Exif data, which OpenImageIO 2.4 writes wrongly through a proxy; sRGB is what readers assume.
  if (extension != ".tif" && extension != ".tiff")
    spec.attribute("oiio:ColorSpace", plain.Linear ? "Linear" : "sRGB");
  if (extension == ".jpg" || extension == ".jpeg")
    spec.attribute("Compression", "jpeg:95");
  return spec;
}
}

namespace
{
std::string KnownExtension(const std::string& path)
{
  std::string extension = fs::path(path).extension().string();
  for (char& c : extension)
    c = char(std::tolower(static_cast<unsigned char>(c)));
  static const std::set<std::string> known{ ".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".tga", ".hdr" };
  if (!known.count(extension))
    Refuse("write", path,
      extension.empty() ? "the name has no extension" : "\"" + extension + "\" is not a known format",
      "end it in .exr (or .png, .jpg, .tif, .bmp, .tga, .hdr)");
  return extension;
}
}

namespace
{
/// Renaming would replace a file that somebody has made read-only, and devices.
void CheckUnprotected(const std::string& path)
{
  std::error_code ec;
  if (fs::is_other(fs::symlink_status(path, ec)))
    Refuse("write", path, "it is a device or a pipe", "choose another name");
  if (fs::is_regular_file(path, ec) && access(path.c_str(), W_OK) != 0)
    Refuse("write", path, "the file that is there may not be written (" + std::string(std::strerror(errno)) + ")",
      "choose another name, or change its permissions");
}
}

void CheckWritable(const std::string& path)
{
  if (path.empty())
    throw StageError("no file name given to write to; set File");
  KnownExtension(path);
  std::error_code ec;
  if (fs::is_directory(path, ec))
    Refuse("write", path, "it is a directory", "name a file in it");
  // The directory itself may be made later: what exists of the way to it decides.
  fs::path place = fs::absolute(path, ec).parent_path();
  while (!fs::exists(place, ec) && place.has_parent_path() && place != place.parent_path())
    place = place.parent_path();
  if (!fs::is_directory(place, ec))
    Refuse("write", path, "\"" + place.string() + "\" is not a directory", "choose another place");
  if (access(place.c_str(), W_OK) != 0)
    Refuse("write", path, "no files can be made in \"" + place.string() + "\"", "choose another place");
  CheckUnprotected(path);
}

struct ImageFileWriter::Internals
{
  std::string Path, Extension;
  WriteOptions Options;
  FrameFacts Facts;
  Rect Region;
  int Width = 0, Height = 0;
  std::unique_ptr<TemporaryFile> Temporary;
  std::unique_ptr<CheckedFile> File;
  std::unique_ptr<OIIO::ImageOutput> Output; ///< closed before the temporary file goes
  OIIO::ImageSpec Spec;
  PlainLayers Plain;
  int Next = 0; ///< the row above what comes next
  std::vector<std::string> Names, Channels;
  std::vector<std::int64_t> Clamped; ///< per layer
  WriteReport Report;

  bool Exr() const { return this->Extension == ".exr"; }
  void Open(const std::vector<OutLayer>& layers);
  void FillExr(const std::vector<OutLayer>& layers, int y, float* row);
  void FillPlain(const std::vector<OutLayer>& layers, int y, float* row);
  void CheckWrites(int error) const
  {
    if (error)
      Refuse("write", this->Path, std::strerror(error),
        error == ENOSPC || error == EDQUOT ? "make room there, or choose another place" : "choose another place");
  }
};

void ImageFileWriter::Internals::Open(const std::vector<OutLayer>& layers)
{
  const fs::path parent = fs::path(this->Path).parent_path();
  if (!parent.empty())
  {
    std::error_code ec;
    fs::create_directories(parent, ec);
    if (ec || !fs::is_directory(parent))
      Refuse("write", this->Path,
        "the directory \"" + parent.string() +
          "\" cannot be made: " + (ec ? ec.message() : std::string("a file has its name")),
        "choose another place");
  }
  if (this->Exr())
    this->Spec = ExrSpec(layers, this->Facts, this->Region, this->Width, this->Height, this->Options);
  else
  {
    this->Plain = FindPlainLayers(this->Path, this->Extension, layers);
    this->Spec = PlainSpec(this->Plain, this->Extension, this->Region);
  }
  CheckUnprotected(this->Path);
  this->Temporary = std::make_unique<TemporaryFile>(this->Path);
  if (this->Temporary->Error())
    Refuse("write", this->Path,
      std::string("no file can be made there: ") + std::strerror(this->Temporary->Error()), "choose another place");
  // The extension alone, without a dot, names the format.
  this->Output = OIIO::ImageOutput::create(this->Exr() ? "openexr" : this->Extension.substr(1));
  if (!this->Output)
    Refuse("write", this->Path, "OpenImageIO writes no " + this->Extension + " files",
      "write .exr, .png, .jpg, .tif or .hdr");
  this->File = std::make_unique<CheckedFile>(this->Temporary->Path(), this->Temporary->Descriptor());
  if (!this->Output->set_ioproxy(this->File.get()))
    Refuse("write", this->Path, "OpenImageIO writes " + this->Extension + " files only by itself", "write .exr");
  const bool opened = this->Output->open(this->Temporary->Path(), this->Spec);
  this->CheckWrites(this->File->Error());
  if (!opened)
    Refuse("write", this->Path, OneLine(this->Output->geterror()), "check that the directory can be written to");
  this->Clamped.assign(layers.size(), 0);
  for (const OutLayer& layer : layers)
  {
    this->Names.push_back(layer.Name);
    this->Channels.insert(this->Channels.end(), layer.Channels.begin(), layer.Channels.end());
  }
}

void ImageFileWriter::Internals::FillExr(const std::vector<OutLayer>& layers, int y, float* row)
{
  int first = 0;
  for (size_t l = 0; l < layers.size(); ++l)
  {
    const OutLayer& layer = layers[l];
    const int n = layer.View.components;
    const float* in = layer.View.at(this->Region.x0, y);
    float* out = row + first;
    for (int x = 0; x < this->Region.width(); ++x, in += n, out += this->Spec.nchannels)
    {
      for (int c = 0; c < n; ++c)
        out[c] = in[c];
      if (layer.Kind == ArrayKind::Motion && n > 1)
        out[1] = -out[1];
      if (layer.AsHalf)
        for (int c = 0; c < n; ++c)
          if (std::isfinite(out[c]) && std::fabs(out[c]) > MaximumHalf)
          {
            out[c] = std::copysign(MaximumHalf, out[c]);
            ++this->Clamped[l];
          }
    }
    first += n;
  }
}

void ImageFileWriter::Internals::FillPlain(const std::vector<OutLayer>& layers, int y, float* row)
{
  const OutLayer& colour = layers[this->Plain.Colour];
  const OutLayer* const alpha = this->Plain.Alpha > 0 ? &layers[std::size_t(this->Plain.Alpha)] : nullptr;
  const bool encoded = colour.Kind == ArrayKind::Display;
  const int n = this->Plain.Channels;
  const float* in = colour.View.at(this->Region.x0, y);
  for (int x = 0; x < this->Region.width(); ++x, in += colour.View.components, row += this->Spec.nchannels)
  {
    for (int c = 0; c < n; ++c)
    {
      float v = in[colour.View.components == 1 ? 0 : c];
      if (!this->Plain.Linear)
      {
        if (!std::isfinite(v))
        {
          ++this->Report.NonFinite;
          v = 0;
        }
        v = std::min(1.f, std::max(0.f, v));
        // Quantised here, so that rounding does not depend on the library: to the nearest of 255 steps.
        v = std::floor((encoded ? v : EncodeSrgb(v)) * 255.f + 0.5f) / 255.f;
      }
      else if (!std::isfinite(v))
      {
        ++this->Report.NonFinite;
        v = 0;
      }
      else if (v < 0 || v > MaximumRgbe)
      {
        ++this->Clamped[this->Plain.Colour];
        v = std::min(MaximumRgbe, std::max(0.f, v));
      }
      row[c] = v;
    }
    if (alpha)
    {
      const float a = alpha->View.at(this->Region.x0 + x, y)[0];
      row[n] = std::isfinite(a) ? std::floor(std::min(1.f, std::max(0.f, a)) * 255.f + 0.5f) / 255.f : 0.f;
    }
  }
}

ImageFileWriter::ImageFileWriter(const std::string& path, const FrameFacts& facts, const WriteOptions& options)
  : Internal(new Internals)
{
  Internals& in = *this->Internal;
  in.Path = path;
  in.Facts = facts;
  in.Options = options;
  in.Region = options.Region;
  in.Width = options.Width;
  in.Height = options.Height;
  in.Next = in.Region.y1;
  if (path.empty())
    throw StageError("no file name given to write to; set File");
  if (in.Region.empty())
    Refuse("write", path, "the image is empty or has several slices", "");
  if (!Rect{ 0, 0, in.Width, in.Height }.contains(in.Region))
    Refuse("write", path, "the region lies outside the frame", "");
  in.Extension = KnownExtension(path);
}

ImageFileWriter::~ImageFileWriter() = default;

void ImageFileWriter::Write(const Rect& band, vtkImageData* image, const std::vector<LayerSpec>& layers)
{
  Internals& in = *this->Internal;
  Guarded("write", in.Path,
    [&]
    {
      const std::vector<OutLayer> ready = PrepareLayers(in.Path, image, layers, band, in.Options.Half);
      if (!in.Output)
        in.Open(ready);
      std::vector<std::string> channels;
      for (const OutLayer& layer : ready)
        channels.insert(channels.end(), layer.Channels.begin(), layer.Channels.end());
      if (channels != in.Channels || band.x0 != in.Region.x0 || band.x1 != in.Region.x1 || band.y1 != in.Next ||
          band.y0 < in.Region.y0)
        Refuse("write", in.Path, "a band of rows does not go on where the last one ended", "");
      const size_t row = size_t(band.width()) * size_t(in.Spec.nchannels);
      int step = WriteRows;
      while (step > 32 && double(row * step * sizeof(float)) > BufferBytes)
        step /= 2;
      std::vector<float> buffer(row * std::min(step, band.height()));
      for (int top = band.y1; top > band.y0; top -= step)
      {
        ThrowIf(in.Options.Cancelled);
        const int count = std::min(step, top - band.y0), first = in.Spec.y + in.Region.y1 - top;
        for (int i = 0; i < count; ++i)
          in.Exr() ? in.FillExr(ready, top - 1 - i, buffer.data() + row * i)
                   : in.FillPlain(ready, top - 1 - i, buffer.data() + row * i);
        const bool written = in.Output->write_scanlines(first, first + count, 0, OIIO::TypeFloat, buffer.data());
        in.CheckWrites(in.File->Error());
        if (!written)
          Refuse("write", in.Path, OneLine(in.Output->geterror()), "");
      }
      in.Next = band.y0;
    });
}

WriteReport ImageFileWriter::Finish()
{
  Internals& in = *this->Internal;
  Guarded("write", in.Path,
    [&]
    {
      if (!in.Output || in.Next != in.Region.y0)
        Refuse("write", in.Path, "rows of it are missing", "");
      const bool closed = in.Output->close();
      in.File->Flush();
      in.CheckWrites(in.File->Error());
      in.CheckWrites(in.Temporary->Close());
      if (!closed)
        Refuse("write", in.Path, OneLine(in.Output->geterror()), "");
      if (const int error = in.Temporary->Rename())
        Refuse("write", in.Path, std::strerror(error), "choose another file name");
    });
  WriteReport& report = in.Report;
  for (size_t l = 0; l < in.Clamped.size(); ++l)
    if (in.Clamped[l])
    {
      report.Clamped += in.Clamped[l];
      report.Warnings.push_back("\"" + in.Path + "\": " + std::to_string(in.Clamped[l]) + " values of \"" +
                                in.Names[l] + "\" " +
                                (in.Plain.Linear ? "outside [0, 1.69e38] were clamped for .hdr"
                                                 : "beyond 65504 were clamped for half precision"));
    }
  if (report.NonFinite)
    report.Warnings.push_back(
      "\"" + in.Path + "\": " + std::to_string(report.NonFinite) + " values that are not finite were written as 0");
  return report;
}

double ReadBufferBytes(int width, int height, double channels)
{
  // Ours, limited, and the library's of at least 256 rows.
  const double row = double(width) * channels * sizeof(float);
  return std::min(BufferBytes, row * std::min(height, ReadRows)) + row * std::min(height, 256);
}

double WriteBufferBytes(int width, int height, double channels)
{
  // Ours, limited, and the library's of the same rows in the file's format.
  return 2 * std::min(BufferBytes, double(width) * channels * sizeof(float) * std::min(height, WriteRows));
}

void WriteImageFile(const std::string& path, vtkImageData* image, const std::vector<LayerSpec>& layers,
  const WriteOptions& options, WriteReport* report)
{
  vtkImageData* first = image ? image : layers.empty() ? nullptr : layers[0].Image;
  if (!first)
    Refuse("write", path, "there is no image", "");
  int e[6];
  first->GetExtent(e);
  const Rect extent{ e[0], e[2], e[1] + 1, e[3] + 1 };
  WriteOptions whole = options;
  if (whole.Region.empty() && e[4] == e[5])
    whole.Region = extent;
  whole.Width = options.Width > 0 ? options.Width : extent.x1;
  whole.Height = options.Height > 0 ? options.Height : extent.y1;
  ImageFileWriter writer(path, FrameFacts::Read(first->GetFieldData()), whole);
  writer.Write(whole.Region, first, layers);
  WriteReport done = writer.Finish();
  if (report)
    *report = std::move(done);
}
}
