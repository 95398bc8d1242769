// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellImageReader.h"

#include "quellImageFile.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"

#include <algorithm>
#include <cmath>

vtkStandardNewMacro(vtkQuellImageReader);
QUELL_STAGE_DESCRIPTION(vtkQuellImageReader)

vtkQuellImageReader::vtkQuellImageReader()
{
  this->InitializePorts();
}
vtkQuellImageReader::~vtkQuellImageReader() = default;

void vtkQuellImageReader::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellImageReader;
  d.Category = "IO";
  d.Brief = "Reads named arrays from an OpenEXR or another image file, or from a sequence of files.";
  d.Details =
    "Every layer of the file is an array; the layers of Quell, Blender, Arnold, pbrt, Mitsuba and OIDN get the names "
    "of their "
    "role (`Documentation/aov.md`), others keep their own. Only what is asked for is read.\n\n"
    "The frame is the display window. Pixels outside the data window hold the array's background (0; albedo 1; depth "
    "+inf). Values are not changed: non-finite ones pass. Integer pixels of formats other than EXR are decoded from "
    "sRGB.";
  d.Output("radiance", quell::ArrayKind::Color, "the file's plain R G B channels, or its beauty pass")
    .Anything("files are read as they are; every stage behind it contains what is not finite");
  QUELL_PATH(d, File, "image file; a run of # in its name is replaced by the frame's tick, e.g. noisy.####.exr");
  QUELL_STRING(
    d, PlainArray, "array that plain R G B or Y channels make, e.g. albedo for a file that holds nothing else");
  QUELL_ENUM(d, Transfer, "how pixels become linear; Automatic: integers are sRGB-encoded, floats are linear",
    "Automatic", "Linear", "Srgb");
}

void vtkQuellImageReader::SetFile(const std::string& file)
{
  if (file == this->File)
    return;
  this->File = file;
  this->Modified();
}

void vtkQuellImageReader::SetPlainArray(const std::string& name)
{
  if (name == this->PlainArray)
    return;
  this->PlainArray = name;
  this->Modified();
}

namespace
{
quell::ReadOptions OptionsOf(vtkQuellImageReader* reader)
{
  if (reader->GetFile().empty())
    throw quell::StageError("no file given; set File");
  quell::ReadOptions options;
  options.PlainArray = reader->GetPlainArray().empty() ? "radiance" : reader->GetPlainArray();
  options.Transfer = quell::FileTransfer(reader->GetTransfer());
  return options;
}
}

void vtkQuellImageReader::DescribeSource(int& width, int& height)
{
  const quell::ReadOptions options = OptionsOf(this);
  // A run may begin in the middle of a sequence, and the sequence itself anywhere: all frames have one size.
  const quell::ReadReport header =
    quell::ReadImageHeader(quell::SequenceSample(this->File, this->Ticks.First), options);
  width = header.Width;
  height = header.Height;
}

std::vector<quell::OutputArray> vtkQuellImageReader::ListDynamicOutputs()
{
  // A graph asks before it knows its first tick: any file of the sequence tells the names.
  const quell::ReadOptions options = OptionsOf(this);
  const quell::ReadReport header =
    quell::ReadImageHeader(quell::SequenceSample(this->File, this->Ticks.First), options);
  std::vector<quell::OutputArray> list;
  for (const quell::FileArray& array : header.Arrays)
  {
    quell::OutputArray out;
    out.Name = array.Name;
    out.Kind = array.Kind;
    out.Components = int(array.Channels.size());
    out.Doc = "channels";
    for (const std::string& channel : array.Channels)
      out.Doc += " " + channel;
    list.push_back(out);
  }
  return list;
}

// Foreign files are where non-finite values come in: here they are counted and located, filters only survive them.
void vtkQuellImageReader::CountNonFinite(const std::string& name, const quell::ImageIn& view, const quell::Rect& rows)
{
  const quell::ArrayType* known = quell::FindArray(name);
  // Infinity is what depth and hit distance hold where nothing was hit.
  const bool infinityIsFine = known && std::isinf(known->Background);
  // What a later band adds lies below: its first is the first of all.
  long long bad = 0;
  int firstX = 0, firstY = 0;
  for (int y = rows.y0; y < rows.y1; ++y)
    for (int x = rows.x0; x < rows.x1; ++x)
    {
      const float* v = view.at(x, y);
      bool fine = true;
      for (int c = 0; c < view.components; ++c)
        fine = fine && (std::isfinite(v[c]) || (infinityIsFine && v[c] > 0));
      if (!fine && bad++ == 0)
      {
        firstX = x;
        firstY = y;
      }
    }
  this->Counters.NonFinite += bad;
  Bad& all = this->NonFinite[name];
  if (bad && (all.Pixels == 0 || firstY < all.FirstY))
  {
    all.FirstX = firstX;
    all.FirstY = firstY;
  }
  all.Pixels += bad;
}

double vtkQuellImageReader::ScratchBytes(const quell::Rect&, const quell::Rect& whole, const quell::ArraySet&)
{
  double channels = 0;
  try
  {
    for (const quell::OutputArray& array : this->ListDynamicOutputs())
      channels += array.Components;
  }
  catch (const quell::StageError&)
  {
    return 0; // said where it matters
  }
  return quell::ReadBufferBytes(whole.width(), whole.height(), channels);
}

std::vector<std::string> vtkQuellImageReader::ListSequenceFiles(int tick) const
{
  const std::string path = quell::SequencePath(this->File, tick);
  return path == this->File ? std::vector<std::string>() : std::vector<std::string>{ path };
}

void vtkQuellImageReader::Execute(quell::StageFrame& frame)
{
  quell::ReadOptions options = OptionsOf(this);
  options.Arrays = frame.WantedArrays();
  options.Region = frame.Region();
  options.Cancelled = [this] { return this->IsCancelled(); };
  if (options.Region.empty() || options.Arrays.empty())
    return;
  const std::string path = quell::SequenceFile(this->File, frame.Tick());
  // The size is checked first: the region refers to the frame that was announced.
  const quell::ReadReport header = quell::ReadImageHeader(path, options);
  if (header.Width != frame.Whole().width() || header.Height != frame.Whole().height())
    throw quell::StageError("cannot read \"" + path + "\": it is " + std::to_string(header.Width) + " x " +
                            std::to_string(header.Height) + " pixels, but the sequence began with " +
                            std::to_string(frame.Whole().width()) + " x " + std::to_string(frame.Whole().height()) +
                            "; all frames must have one size");
  std::map<std::string, quell::ImageOut> outputs;
  for (const quell::FileArray& array : header.Arrays)
    if (options.Arrays.count(array.Name))
    {
      const int components = int(array.Channels.size());
      const quell::ImageOut out = frame.AddOutput(array.Name, components);
      if (out.components != components)
        throw quell::StageError("cannot read \"" + path + "\": \"" + array.Name + "\" has " +
                                std::to_string(components) + " components there, not " +
                                std::to_string(out.components));
      options.Into[array.Name] = out.data;
      outputs.emplace(array.Name, out);
    }
  quell::ReadReport report;
  quell::ReadImageFile(path, &report, options);
  bool started = false;
  const quell::Rect rows = this->Counted.Add(frame.Region(), frame.Tick(), started);
  if (started)
    this->NonFinite.clear();
  for (const auto& output : outputs)
    this->CountNonFinite(output.first, output.second, rows);
  for (const auto& bad : this->NonFinite)
    if (bad.second.Pixels)
      this->CountedWarning += (this->CountedWarning.empty() ? "" : "; ") + std::to_string(bad.second.Pixels) +
                              " pixels of " + bad.first + " are not finite, the first at (" +
                              std::to_string(bad.second.FirstX) + ", " + std::to_string(bad.second.FirstY) +
                              ") from the bottom left";
  if (!this->CountedWarning.empty())
    this->Warnings.push_back(this->CountedWarning);
  frame.OutputFacts = report.Facts;
  frame.OutputFacts.Tick = frame.Tick();
  this->Warnings.insert(this->Warnings.end(), report.Warnings.begin(), report.Warnings.end());
}
