// SPDX-License-Identifier: BSD-3-Clause
#include "quellCheckpoint.h"

#include "quellImageGuard.h"
#include "quellPipelineReader.h"
#include "quellProvenance.h"
#include "quellStageDescription.h"
#include "quellTemporaryFile.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkLongLongArray.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkStringArray.h"

#include <cstring>
#include <filesystem>
#include <fstream>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
const char Magic[8] = { 'Q', 'U', 'E', 'L', 'L', 'C', 'K', 'P' };
const std::uint32_t FormatVersion = 3;
const std::uint64_t HeadBytes = sizeof Magic + 4 + 8, HashBytes = 8;

static_assert(sizeof(float) == 4 && sizeof(double) == 8, "the file's number formats");

/// What a file says may hold anything: no line breaks or codes for a terminal.
std::string Told(const std::string& text)
{
  return OneLine(text, 2000);
}

std::string RegionText(const std::optional<DisplayRegion>& r)
{
  return r ? std::to_string(r->X0) + "," + std::to_string(r->Y0) + "," + std::to_string(r->X1) + "," +
               std::to_string(r->Y1)
           : "the whole frame";
}

class Writer
{
public:
  explicit Writer(TemporaryFile& file)
    : File(file)
  {
  }

  void Bytes(const void* data, std::size_t bytes)
  {
    this->Hash.Add(data, bytes);
    this->File.Write(data, bytes);
  }
  template <class T>
  void Number(T value)
  {
    this->Bytes(&value, sizeof value);
  }
  void String(const std::string& s)
  {
    this->Number(std::uint32_t(s.size()));
    this->Bytes(s.data(), s.size());
  }

  TemporaryFile& File;
  ContentHash Hash;
};

void WriteImage(Writer& w, vtkImageData* image, const std::string& producer)
{
  int e[6];
  image->GetExtent(e);
  w.String(producer);
  for (int i = 0; i < 4; ++i)
  {
    w.Number(std::int32_t(e[i]));
  }
  for (int i = 0; i < 3; ++i)
  {
    w.Number(image->GetOrigin()[i]);
  }
  for (int i = 0; i < 3; ++i)
  {
    w.Number(image->GetSpacing()[i]);
  }
  vtkPointData* points = image->GetPointData();
  w.Number(std::uint32_t(points->GetNumberOfArrays()));
  for (int a = 0; a < points->GetNumberOfArrays(); ++a)
  {
    vtkFloatArray* array = vtkFloatArray::SafeDownCast(points->GetAbstractArray(a));
    if (!array || !array->GetName() || array->GetNumberOfTuples() != image->GetNumberOfPoints())
    {
      throw StageError("an array of node " + Quoted(producer) + " is not float32");
    }
    w.String(array->GetName());
    w.Number(std::uint32_t(array->GetNumberOfComponents()));
    w.Bytes(array->GetPointer(0), std::size_t(array->GetNumberOfValues()) * sizeof(float));
  }
  vtkFieldData* field = image->GetFieldData();
  std::uint32_t count = 0;
  for (int pass = 0; pass < 2; ++pass)
  {
    for (int a = 0; a < field->GetNumberOfArrays(); ++a)
    {
      vtkAbstractArray* array = field->GetAbstractArray(a);
      vtkDoubleArray* doubles = vtkDoubleArray::SafeDownCast(array);
      vtkLongLongArray* integers = vtkLongLongArray::SafeDownCast(array);
      vtkStringArray* strings = vtkStringArray::SafeDownCast(array);
      // Frame facts are of these types; nothing else in the field data is read by a stage.
      if (!array->GetName() || (!doubles && !integers && !strings))
      {
        continue;
      }
      if (pass == 0)
      {
        ++count;
        continue;
      }
      w.String(array->GetName());
      w.Number(std::uint8_t(doubles ? 0 : integers ? 1 : 2));
      w.Number(std::uint32_t(array->GetNumberOfValues()));
      for (vtkIdType i = 0; i < array->GetNumberOfValues(); ++i)
      {
        if (doubles)
        {
          w.Number(doubles->GetValue(i));
        }
        else if (integers)
        {
          w.Number(std::int64_t(integers->GetValue(i)));
        }
        else
        {
          w.String(strings->GetValue(i));
        }
      }
    }
    if (pass == 0)
    {
      w.Number(count);
    }
  }
}

class Reader
{
public:
  Reader(const std::string& file)
  {
    std::error_code code;
    if (fs::is_regular_file(file, code)) // opening a pipe would wait for ever
    {
      this->Stream.open(file, std::ios::binary);
      this->Left = fs::file_size(file, code);
    }
    if (!this->Stream.is_open() || code)
    {
      throw StageError("cannot be opened for reading");
    }
    this->Size = this->Left;
  }

  void Need(std::uint64_t bytes) const
  {
    if (bytes > this->Left)
    {
      throw StageError("damaged or truncated: a length leads beyond its end");
    }
  }
  void Bytes(void* data, std::size_t bytes)
  {
    this->Need(bytes);
    if (bytes > 0 && !this->Stream.read(static_cast<char*>(data), std::streamsize(bytes)))
    {
      throw StageError("cannot be read");
    }
    this->Left -= bytes;
    this->Hash.Add(data, bytes);
  }
  template <class T>
  T Number()
  {
    T value{};
    this->Bytes(&value, sizeof value);
    return value;
  }
  std::string String()
  {
    const std::uint32_t length = this->Number<std::uint32_t>();
    this->Need(length);
    std::string s(length, '\0');
    this->Bytes(&s[0], length);
    return s;
  }
  /// A count of things that take at least `least` bytes each.
  std::uint32_t Count(std::uint64_t least)
  {
    const std::uint32_t n = this->Number<std::uint32_t>();
    this->Need(n * least);
    return n;
  }

  std::ifstream Stream;
  ContentHash Hash;
  std::uint64_t Left = 0, Size = 0;
};

vtkSmartPointer<vtkImageData> ReadImage(Reader& r)
{
  auto image = vtkSmartPointer<vtkImageData>::New();
  std::int32_t e[4];
  for (std::int32_t& v : e)
  {
    v = r.Number<std::int32_t>();
  }
  const std::int64_t width = std::int64_t(e[1]) - e[0] + 1, height = std::int64_t(e[3]) - e[2] + 1;
  if (width < 1 || height < 1 || width > 1 << 20 || height > 1 << 20)
  {
    throw StageError("damaged: an image has an impossible size");
  }
  double geometry[6];
  for (double& v : geometry)
  {
    v = r.Number<double>();
  }
  image->SetExtent(e[0], e[1], e[2], e[3], 0, 0);
  image->SetOrigin(geometry);
  image->SetSpacing(geometry + 3);
  const std::uint64_t pixels = std::uint64_t(width) * std::uint64_t(height);
  const std::uint32_t arrays = r.Count(8);
  for (std::uint32_t a = 0; a < arrays; ++a)
  {
    const std::string name = r.String();
    const std::uint32_t components = r.Number<std::uint32_t>();
    if (components < 1 || components > 64)
    {
      throw StageError("damaged: an array has " + std::to_string(components) + " components");
    }
    r.Need(pixels * components * sizeof(float)); // at most 2^40 * 64 * 4
    vtkNew<vtkFloatArray> array;
    array->SetName(name.c_str());
    array->SetNumberOfComponents(int(components));
    array->SetNumberOfTuples(vtkIdType(pixels));
    r.Bytes(array->GetPointer(0), std::size_t(pixels) * components * sizeof(float));
    image->GetPointData()->AddArray(array);
  }
  const std::uint32_t fields = r.Count(9);
  for (std::uint32_t f = 0; f < fields; ++f)
  {
    const std::string name = r.String();
    const std::uint8_t kind = r.Number<std::uint8_t>();
    const std::uint32_t count = r.Count(kind == 2 ? 4 : 8);
    vtkSmartPointer<vtkAbstractArray> array;
    if (kind == 0)
    {
      vtkNew<vtkDoubleArray> doubles;
      for (std::uint32_t i = 0; i < count; ++i)
      {
        doubles->InsertNextValue(r.Number<double>());
      }
      array = doubles;
    }
    else if (kind == 1)
    {
      vtkNew<vtkLongLongArray> integers;
      for (std::uint32_t i = 0; i < count; ++i)
      {
        integers->InsertNextValue(r.Number<std::int64_t>());
      }
      array = integers;
    }
    else if (kind == 2)
    {
      vtkNew<vtkStringArray> strings;
      for (std::uint32_t i = 0; i < count; ++i)
      {
        strings->InsertNextValue(r.String());
      }
      array = strings;
    }
    else
    {
      throw StageError("damaged: unknown kind of field data");
    }
    array->SetName(name.c_str());
    image->GetFieldData()->AddArray(array);
  }
  return image;
}
}

RunIdentity IdentityOf(
  const PipelineExecutor& executor, const std::optional<DisplayRegion>& region, int start, const std::string& version)
{
  const Graph& graph = executor.GetGraph();
  RunIdentity id;
  id["the program: version"] = version;
  id["--region:"] = RegionText(region);
  id["the first frame computed:"] = std::to_string(start);
  id["<time>: first"] = std::to_string(graph.Ticks.First);
  id["<time>: count"] = std::to_string(graph.Ticks.Count);
  id["<time>: rate"] = detail::FormatDouble(graph.Ticks.Rate);
  for (std::size_t n = 0; n < graph.Nodes.size(); ++n)
  {
    if (!executor.LiveNodes()[n])
    {
      continue;
    }
    const GraphNode& node = graph.Nodes[n];
    const std::string title = "node " + Quoted(node.Path) + ": ";
    id[title + "type"] = node.Type;
    vtkQuellStage* stage = executor.GetStage(node.Path);
    try
    {
      const std::string hash = stage->HashOfContents();
      if (!hash.empty())
      {
        id[title + "the contents of all its files"] = hash;
      }
    }
    catch (const StageError&)
    {
      // its frame will say so
    }
    for (const Property& p : node.Description().Properties)
    {
      std::string text = p.GetText(stage);
      if (!text.empty() && (p.Kind == Property::Type::Path || (node.Description().Sink && p.Name == "File")))
      {
        std::error_code code;
        const fs::path absolute = fs::absolute(text, code);
        text = code ? text : absolute.lexically_normal().string();
      }
      id[title + p.Name] = text;
    }
    for (const GraphEdge& e : node.Inputs)
    {
      const std::string label = title + "input " + Quoted(node.Description().Inputs[std::size_t(e.Port)].Name) +
                                (e.Connection > 0 ? " " + std::to_string(e.Connection + 1) : "");
      std::string text =
        graph.Nodes[std::size_t(e.Producer)].Path + ":" + e.Array + (e.Delayed ? " of the previous frame" : "");
      for (const auto& a : e.Attributes)
      {
        text += " " + a.first + "=" + a.second;
      }
      id[label] = text;
    }
  }
  for (const auto& input : InputHashes(graph))
  {
    id["the contents of " + input.first + ":"] = input.second;
  }
  return id;
}

std::string DifferenceOf(const RunIdentity& before, const RunIdentity& now)
{
  const auto value = [](const std::string& v) { return v.empty() ? std::string("\"\"") : v; };
  for (const auto& b : before)
  {
    const auto n = now.find(b.first);
    if (n == now.end())
    {
      return Told(b.first + " was " + value(b.second) + " and is no more");
    }
    if (n->second != b.second)
    {
      return Told(b.first + " was " + value(b.second) + " and is " + value(n->second));
    }
  }
  for (const auto& n : now)
  {
    if (!before.count(n.first))
    {
      return Told(n.first + " is " + value(n.second) + " and was not there");
    }
  }
  return std::string();
}

bool IsCheckpoint(const std::string& file)
{
  std::error_code code;
  if (!fs::is_regular_file(file, code))
  {
    return false;
  }
  char head[sizeof Magic] = {};
  return std::ifstream(file, std::ios::binary).read(head, sizeof head) && std::memcmp(head, Magic, sizeof head) == 0;
}

void WriteCheckpoint(const std::string& file, const Checkpoint& checkpoint)
{
  std::error_code code;
  if (fs::exists(fs::symlink_status(file, code)) && !IsCheckpoint(file))
  {
    throw StageError("checkpoint " + file + ": what is there is no checkpoint, and is not written over");
  }
  const std::string directory = DirectoryOf(file);
  if (!directory.empty())
  {
    fs::create_directories(directory, code);
  }
  TemporaryFile temporary(file);
  try
  {
    Writer w(temporary);
    // The size is known when all is written; the hash covers it, so it is computed before.
    std::uint64_t size = HeadBytes + 4 + HashBytes;
    const auto strings = [](const std::string& s) { return std::uint64_t(4 + s.size()); };
    size += 4 + 4;
    for (const auto& i : checkpoint.Identity)
    {
      size += strings(i.first) + strings(i.second);
    }
    for (const auto& i : checkpoint.Frame)
    {
      size += strings(i.first) + 16 + 48 + 4 + 4;
      for (int a = 0; a < i.second->GetPointData()->GetNumberOfArrays(); ++a)
      {
        vtkAbstractArray* array = i.second->GetPointData()->GetAbstractArray(a);
        size += strings(array->GetName() ? array->GetName() : "") + 4 +
                std::uint64_t(array->GetNumberOfValues()) * sizeof(float);
      }
      for (int a = 0; a < i.second->GetFieldData()->GetNumberOfArrays(); ++a)
      {
        vtkAbstractArray* array = i.second->GetFieldData()->GetAbstractArray(a);
        vtkStringArray* text = vtkStringArray::SafeDownCast(array);
        if (!array->GetName() ||
            (!text && !vtkDoubleArray::SafeDownCast(array) && !vtkLongLongArray::SafeDownCast(array)))
        {
          continue;
        }
        size += strings(array->GetName()) + 1 + 4 + (text ? 0 : 8 * std::uint64_t(array->GetNumberOfValues()));
        for (vtkIdType v = 0; text && v < text->GetNumberOfValues(); ++v)
        {
          size += strings(text->GetValue(v));
        }
      }
    }
    size += 4 + 4;
    for (const auto& i : checkpoint.Work)
    {
      size += strings(i.first) + 8 + i.second.size();
    }
    size += 4 + 4 * std::uint64_t(checkpoint.Unfinished.size());
    w.Bytes(Magic, sizeof Magic);
    w.Number(FormatVersion);
    w.Number(size);
    w.Number(std::int32_t(checkpoint.Tick));
    w.Number(std::uint32_t(checkpoint.Identity.size()));
    for (const auto& i : checkpoint.Identity)
    {
      w.String(i.first);
      w.String(i.second);
    }
    w.Number(std::uint32_t(checkpoint.Frame.size()));
    for (const auto& i : checkpoint.Frame)
    {
      WriteImage(w, i.second, i.first);
    }
    w.Number(std::int32_t(checkpoint.WorkTick));
    w.Number(std::uint32_t(checkpoint.Work.size()));
    for (const auto& i : checkpoint.Work)
    {
      w.String(i.first);
      w.Number(std::uint64_t(i.second.size()));
      w.Bytes(i.second.data(), i.second.size());
    }
    w.Number(std::uint32_t(checkpoint.Unfinished.size()));
    for (const int tick : checkpoint.Unfinished)
    {
      w.Number(std::int32_t(tick));
    }
    w.Number(w.Hash.Value());
    if (const int error = temporary.Rename())
    {
      throw StageError(std::strerror(error));
    }
  }
  catch (const StageError& e)
  {
    throw StageError("checkpoint " + file + " cannot be written: " + e.what());
  }
}

Checkpoint ReadCheckpoint(const std::string& file)
{
  try
  {
    Reader r(file);
    char magic[8] = {};
    if (r.Size >= HeadBytes + HashBytes)
    {
      r.Bytes(magic, sizeof magic);
    }
    if (std::memcmp(magic, Magic, sizeof Magic) != 0)
    {
      throw StageError("not a checkpoint");
    }
    const std::uint32_t version = r.Number<std::uint32_t>();
    if (version != FormatVersion)
    {
      throw StageError(
        "of format version " + std::to_string(version) + ", this program reads " + std::to_string(FormatVersion));
    }
    const std::uint64_t size = r.Number<std::uint64_t>();
    if (size != r.Size)
    {
      throw StageError(
        "damaged or truncated: it has " + std::to_string(r.Size) + " bytes and should have " + std::to_string(size));
    }
    Checkpoint checkpoint;
    checkpoint.Tick = r.Number<std::int32_t>();
    for (std::uint32_t i = r.Count(8); i > 0; --i)
    {
      const std::string label = r.String();
      checkpoint.Identity[label] = r.String();
    }
    for (std::uint32_t i = r.Count(76); i > 0; --i)
    {
      const std::string producer = r.String();
      checkpoint.Frame[producer] = ReadImage(r);
    }
    checkpoint.WorkTick = r.Number<std::int32_t>();
    for (std::uint32_t i = r.Count(12); i > 0; --i)
    {
      const std::string node = r.String();
      const std::uint64_t bytes = r.Number<std::uint64_t>();
      r.Need(bytes);
      std::string& work = checkpoint.Work[node];
      work.resize(std::size_t(bytes));
      r.Bytes(&work[0], work.size());
    }
    for (std::uint32_t i = r.Count(4); i > 0; --i)
    {
      checkpoint.Unfinished.insert(r.Number<std::int32_t>());
    }
    const std::uint64_t expected = r.Hash.Value();
    if (r.Number<std::uint64_t>() != expected || r.Left != 0)
    {
      throw StageError("damaged: its contents do not have its hash");
    }
    return checkpoint;
  }
  catch (const StageError& e)
  {
    throw StageError("checkpoint " + file + ": " + e.what());
  }
}

bool Restore(PipelineExecutor& executor, const Checkpoint& checkpoint, std::string& error)
{
  for (const auto& kept : executor.KeptArrays())
  {
    const std::string& path = executor.GetGraph().Nodes[std::size_t(kept.first)].Path;
    const auto image = checkpoint.Frame.find(path);
    int width = 0, height = 0;
    if (!executor.FrameSize(path, width, height, error))
    {
      return false;
    }
    for (const std::string& array : kept.second)
    {
      if (image == checkpoint.Frame.end() || !image->second->GetPointData()->GetArray(array.c_str()))
      {
        error = Quoted(path + ":" + array) + " is not in it";
        return false;
      }
    }
    const int* e = image->second->GetExtent();
    if (e[0] != 0 || e[2] != 0 || e[1] + 1 != width || e[3] + 1 != height)
    {
      error = Quoted(path) + " is not of " + std::to_string(width) + " x " + std::to_string(height) + " pixels in it";
      return false;
    }
  }
  executor.SetHistory(checkpoint.Tick, checkpoint.Frame);
  return true;
}

std::string CheckpointPath(const PipelineExecutor& executor)
{
  const Graph& graph = executor.GetGraph();
  std::string directory = graph.Options.OutputDirectory;
  for (const PipelineExecutor::Target& t : executor.Targets())
  {
    const vtkQuellStage* stage = executor.GetStage(graph.Nodes[std::size_t(t.Node)].Path);
    const Property* file = stage ? stage->GetDescription().FindProperty("File") : nullptr;
    if (file && !file->GetText(stage).empty())
    {
      directory = DirectoryOf(file->GetText(stage));
      break;
    }
  }
  return JoinPath(directory, fs::path(graph.Document->File).stem().string() + ".checkpoint");
}
}
