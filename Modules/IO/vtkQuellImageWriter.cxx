// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellImageWriter.h"

#include "quellImageFile.h"

#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"

vtkStandardNewMacro(vtkQuellImageWriter);
QUELL_STAGE_DESCRIPTION(vtkQuellImageWriter)

vtkQuellImageWriter::vtkQuellImageWriter()
{
  this->InitializePorts();
}
vtkQuellImageWriter::~vtkQuellImageWriter() = default;

void vtkQuellImageWriter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellImageWriter;
  d.Category = "IO";
  d.Brief = "Writes named arrays as the layers of one image file per frame.";
  d.Details =
    "The file's extension decides the format. **OpenEXR**: every connection is a layer under its array's standard name "
    "(`Documentation/aov.md`) or under `name=\"...\"` on the input; the first colour is plain R G B. The data window "
    "is the "
    "region that was computed, the display window the whole frame. **PNG, JPEG, TIFF, BMP, TGA**: one colour (and "
    "`alpha`), 8 "
    "bit; display-encoded arrays as they are, linear ones clamped to [0, 1] and sRGB-encoded; values that are not "
    "finite "
    "become 0 and are counted. **HDR**: one linear colour.\n\n"
    "A file is written under a temporary name and renamed, so it is whole or absent. Arrays pass through.";
  d.Sink = true;
  d.RepeatableInput("layer", quell::ArrayKind::Any, "radiance", "an array to be written")
    .Attribute("name", "of the layer in the file; default: the array's standard name");
  QUELL_STRING(d, File, "file to write; a run of # in its name is replaced by the frame's tick; directories are made");
  QUELL_ENUM(d, Compression, "EXR compression; Pxr24, Dwaa and Dwab lose precision", "None", "Rle", "Zips", "Zip",
    "Piz", "Pxr24", "Dwaa", "Dwab");
  QUELL_BOOL(
    d, Half, "EXR colours, albedo, normals and scalars in half precision, clamped to 65504; the rest stays float");
}

void vtkQuellImageWriter::SetFile(const std::string& file)
{
  if (file == this->File)
    return;
  this->File = file;
  this->Modified();
}

bool vtkQuellImageWriter::SetInputAttribute(
  int port, int connection, const std::string& name, const std::string& value, std::string& error)
{
  if (name != "name")
    return this->vtkQuellStage::SetInputAttribute(port, connection, name, value, error);
  bool good = !value.empty() && value.front() != '.' && value.back() != '.';
  for (unsigned char c : value)
    good = good && (std::isalnum(c) || c == '_' || c == '.' || c == '-');
  if (!good)
  {
    error = "\"" + value + "\" is not a layer name; use letters, digits, _ - and . between them";
    return false;
  }
  if (this->LayerNames[connection] != value)
  {
    this->LayerNames[connection] = value;
    this->Modified();
  }
  return true;
}

void vtkQuellImageWriter::SetMetadata(const std::map<std::string, std::string>& entries)
{
  this->Metadata = entries;
}

void vtkQuellImageWriter::SetMetadataSource(const MetadataSource& source)
{
  this->MoreMetadata = source;
}

quell::ArrayKind vtkQuellImageWriter::KindOf(int connection, const std::string& array)
{
  // Whoever makes the array knows its kind: follow the pass-through, which goes up first inputs.
  vtkAlgorithm* producer = this->GetInputAlgorithm(0, connection);
  while (auto stage = vtkQuellStage::SafeDownCast(producer))
  {
    if (const quell::OutputArray* made = stage->GetDescription().FindOutput(array))
    {
      if (made->Kind != quell::ArrayKind::Any)
        return made->Kind;
      break;
    }
    if (stage->GetNumberOfInputPorts() == 0)
    {
      try
      {
        for (const quell::OutputArray& made : stage->ListDynamicOutputs())
          if (made.Name == array)
            return made.Kind;
      }
      catch (const std::exception&)
      {
        // Only a hint: a file that has become unreadable is its reader's error, not ours.
      }
      break;
    }
    producer = stage->GetNumberOfInputConnections(0) > 0 ? stage->GetInputAlgorithm(0, 0) : nullptr;
  }
  return quell::ArrayKind::Any;
}

void vtkQuellImageWriter::CheckSettings()
{
  if (this->File.empty())
    throw quell::StageError("no file name given; set File");
  quell::CheckWritable(quell::SequencePath(this->File, this->Ticks.First));
}

double vtkQuellImageWriter::ScratchBytes(const quell::Rect& region, const quell::Rect&, const quell::ArraySet&)
{
  int channels = 0;
  for (int c = 0; c < this->GetNumberOfInputConnections(0); ++c)
  {
    const quell::ArrayType* known = quell::FindArray(this->GetInputArray(0, c));
    channels += known ? known->Components : 4;
  }
  return quell::WriteBufferBytes(region.width(), region.height(), channels);
}

void vtkQuellImageWriter::Execute(quell::StageFrame& frame)
{
  this->Files.clear();
  if (this->File.empty())
    throw quell::StageError("no file name given; set File");
  if (frame.Region().empty())
    return;
  // One image per connection, holding just the array to be written; stock VTK images may have other scalar types.
  std::vector<vtkSmartPointer<vtkImageData>> images;
  std::vector<quell::LayerSpec> layers;
  for (int c = 0; c < frame.Connections(0); ++c)
  {
    const std::string& name = this->GetInputArray(0, c);
    const quell::ImageIn view = frame.Input(0, c);
    vtkNew<vtkFloatArray> array;
    array->SetName(name.c_str());
    array->SetNumberOfComponents(view.components);
    // Not owned and only read; the view lives as long as the frame.
    array->SetArray(const_cast<float*>(view.data), vtkIdType(view.extent.area()) * view.components, 1);
    auto image = vtkSmartPointer<vtkImageData>::New();
    image->SetExtent(view.extent.x0, view.extent.x1 - 1, view.extent.y0, view.extent.y1 - 1, 0, 0);
    image->GetPointData()->AddArray(array);
    frame.OutputFacts.Write(image->GetFieldData());
    quell::LayerSpec layer;
    layer.Array = name;
    const auto named = this->LayerNames.find(c);
    layer.Layer = named == this->LayerNames.end() ? std::string() : named->second;
    layer.Kind = this->KindOf(c, name);
    layer.Image = image;
    images.push_back(image);
    layers.push_back(layer);
  }
  if (layers.empty())
    throw quell::StageError("nothing is connected to \"layer\"");
  quell::WriteOptions options;
  options.Metadata = this->Metadata;
  if (this->MoreMetadata)
    for (const auto& entry : this->MoreMetadata())
      options.Metadata[entry.first] = entry.second;
  options.Width = frame.Whole().width();
  options.Height = frame.Whole().height();
  const bool bands = !this->BandRegion.empty();
  options.Region = bands ? this->BandRegion : frame.Region();
  options.Compression = quell::FileCompression(this->Compression);
  options.Half = this->Half;
  options.Cancelled = [this] { return this->IsCancelled(); };
  const std::string path = quell::SequencePath(this->File, frame.Tick());
  if (bands)
  {
    if (!this->BandFile)
    {
      this->BandPath = path;
      this->BandFile = std::make_unique<quell::ImageFileWriter>(path, frame.OutputFacts, options);
    }
    this->BandFile->Write(frame.Region(), layers[0].Image, layers);
    return;
  }
  quell::WriteReport report;
  quell::WriteImageFile(path, layers[0].Image, layers, options, &report);
  this->Written(path, report);
}

void vtkQuellImageWriter::Written(const std::string& path, const quell::WriteReport& report)
{
  this->Files.push_back(path);
  this->Counters.NonFinite += report.NonFinite;
  this->Warnings.insert(this->Warnings.end(), report.Warnings.begin(), report.Warnings.end());
}

void vtkQuellImageWriter::BeginBands(const quell::Rect& region)
{
  this->DropBands();
  this->BandRegion = region;
}

void vtkQuellImageWriter::EndBands()
{
  this->BandRegion = {};
  const std::unique_ptr<quell::ImageFileWriter> file = std::move(this->BandFile);
  if (file)
    this->Written(this->BandPath, file->Finish());
}

void vtkQuellImageWriter::DropBands()
{
  this->BandRegion = {};
  this->BandFile.reset();
}
