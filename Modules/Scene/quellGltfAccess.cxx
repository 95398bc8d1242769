// SPDX-License-Identifier: BSD-3-Clause
#include "quellGltfAccess.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace quell
{
namespace detail
{
static const char* const Reexport = "export the file again";

static std::uint32_t Little32(const std::uint8_t* p)
{
  return std::uint32_t(p[0]) | std::uint32_t(p[1]) << 8 | std::uint32_t(p[2]) << 16 | std::uint32_t(p[3]) << 24;
}

GltfContainer OpenGltf(const std::string& file, const Bytes& content)
{
  GltfContainer out;
  const char* text = reinterpret_cast<const char*>(content.data());
  std::size_t size = content.size();
  if (size >= 4 && std::memcmp(text, "glTF", 4) == 0)
  {
    const char* const truncated = "the file was cut off; copy or export it again";
    if (size < 12)
      Fail(file, "header", "the binary glTF ends inside its header", truncated);
    const std::uint32_t version = Little32(content.data() + 4), length = Little32(content.data() + 8);
    if (version != 2)
      Fail(file, "header", "binary glTF version " + std::to_string(version) + " is not supported", "export glTF 2.0");
    if (length > size)
      Fail(file, "header",
        "the header announces " + std::to_string(length) + " bytes, the file has " + std::to_string(size), truncated);
    bool json = false;
    for (std::uint64_t at = 12; at < length;)
    {
      if (length - at < 8)
        Fail(file, "chunk at byte " + std::to_string(at), "the chunk ends inside its header", truncated);
      const std::uint64_t bytes = Little32(content.data() + at);
      const std::uint32_t type = Little32(content.data() + at + 4);
      if (bytes > length - at - 8)
        Fail(file, "chunk at byte " + std::to_string(at),
          "the chunk announces " + std::to_string(bytes) + " bytes, " + std::to_string(length - at - 8) + " are left",
          truncated);
      const std::uint8_t* data = content.data() + at + 8;
      if (!json)
      {
        if (type != 0x4E4F534Au)
          Fail(file, "chunk at byte 12", "the first chunk is not JSON", Reexport);
        text = reinterpret_cast<const char*>(data);
        size = std::size_t(bytes);
        json = true;
      }
      else if (type == 0x004E4942u && !out.HasBinary)
      {
        out.Binary.assign(data, data + bytes);
        out.HasBinary = true;
      }
      at += 8 + bytes;
    }
    if (!json)
      Fail(file, "header", "the binary glTF has no JSON chunk", truncated);
  }
  // Brackets and commas make values of 16 bytes and more; long strings, such as embedded data, stay as long as they
  // are.
  SceneMemory::Take(64 * std::uint64_t(std::count_if(
                           text, text + size, [](char c) { return c == ',' || c == '[' || c == '{' || c == ':'; })) +
                    size);
  try
  {
    out.Document = nlohmann::json::parse(text, text + size);
  }
  catch (const nlohmann::json::exception& e)
  {
    std::string what = e.what(); // "[json.exception...] parse error at line 1, column 2: ..."
    const std::size_t bracket = what.find("] ");
    Fail(file, "JSON", bracket == std::string::npos ? what : what.substr(bracket + 2),
      "this is not a glTF file, or it was cut off");
  }
  return out;
}

GltfAccess::GltfAccess(
  const JsonValue& root, const std::string& file, const GltfContainer& container, ContentHash& hash)
  : Root(root)
  , File(file)
  , Container(container)
  , Hash(hash)
  , Buffers(root.CountOf("buffers"))
  , Loaded(this->Buffers.size(), 0)
{
}

const Bytes& GltfAccess::Buffer(std::size_t index, const JsonValue& who)
{
  Bytes& bytes = this->Buffers[index];
  if (this->Loaded[index])
    return bytes;
  const JsonValue buffer = this->Root.Get("buffers").At(index);
  const std::uint64_t length = buffer.Get("byteLength").Unsigned();
  if (!buffer.Has("uri"))
  {
    if (index != 0 || !this->Container.HasBinary)
    {
      const bool meshopt =
        who.HasExtension("EXT_meshopt_compression") || buffer.HasExtension("EXT_meshopt_compression");
      buffer.Fail(meshopt ? "the buffer exists only as EXT_meshopt_compression, which is not supported"
                          : "the buffer has neither a uri nor a binary chunk",
        meshopt ? "export the file without mesh compression" : Reexport);
    }
    bytes = this->Container.Binary;
  }
  else
  {
    const JsonValue uriValue = buffer.Get("uri");
    const std::string& uri = uriValue.String();
    std::string reason;
    if (IsDataUri(uri))
    {
      if (!DecodeDataUri(uri, bytes, reason))
        uriValue.Fail("the embedded buffer cannot be decoded: " + reason, Reexport);
    }
    else if (IsRemoteUri(uri))
      uriValue.Fail("buffers are not fetched from \"" + uri + "\"", "download it and refer to the local file");
    else
    {
      const std::string path = Beside(this->File, DecodePercent(uri));
      if (!ReadFile(path, bytes, reason) && !ReadFile(Beside(this->File, uri), bytes, reason))
        uriValue.Fail("buffer \"" + path + "\" cannot be read: " + reason, "put the file there or correct the uri");
      this->Hash.Add(bytes.data(), bytes.size());
    }
  }
  if (bytes.size() < length)
    buffer.Fail(
      "byteLength is " + std::to_string(length) + ", but only " + std::to_string(bytes.size()) + " bytes are there",
      "the buffer was cut off; copy or export it again");
  // Padding after byteLength is no data; a length of 0 is caught by the ranges.
  bytes.resize(std::size_t(length));
  this->Loaded[index] = 1;
  return bytes;
}

JsonValue GltfAccess::ViewAt(const JsonValue& index) const
{
  const std::size_t i = index.Index(this->Root.CountOf("bufferViews"), "bufferView");
  return this->Root.Get("bufferViews").At(i);
}

GltfAccess::Range GltfAccess::BufferView(const JsonValue& view)
{
  const std::size_t b = view.Get("buffer").Index(this->Buffers.size(), "buffer");
  const Bytes& bytes = this->Buffer(b, view);
  const std::uint64_t offset = view.UnsignedOr("byteOffset", 0), length = view.Get("byteLength").Unsigned();
  if (offset > bytes.size() || length > bytes.size() - offset)
    view.Fail("bytes " + std::to_string(offset) + " to " + std::to_string(offset + length) + " lie outside buffer " +
                std::to_string(b) + " of " + std::to_string(bytes.size()) + " bytes",
      "correct byteOffset and byteLength or export the file again");
  Range range{ bytes.data() + offset, length, 0 };
  if (view.Has("byteStride"))
  {
    range.Stride = view.Get("byteStride").Unsigned();
    if (range.Stride < 4 || range.Stride > 252 || range.Stride % 4 != 0)
      view.Get("byteStride")
        .Fail("byteStride " + std::to_string(range.Stride) + " is not a multiple of 4 from 4 to 252", Reexport);
  }
  return range;
}

Bytes GltfAccess::View(const JsonValue& index)
{
  const Range range = this->BufferView(this->ViewAt(index));
  return Bytes(range.Data, range.Data + range.Size);
}

GltfAccess::Range GltfAccess::Slice(const JsonValue& owner, std::uint64_t count, std::uint64_t size, bool strided)
{
  Range range = this->BufferView(this->ViewAt(owner.Get("bufferView")));
  const std::uint64_t offset = owner.UnsignedOr("byteOffset", 0);
  const std::uint64_t stride = strided && range.Stride ? range.Stride : size;
  if (stride < size)
    owner.Fail(
      "byteStride " + std::to_string(stride) + " is smaller than an element of " + std::to_string(size) + " bytes",
      Reexport);
  // offset + (count - 1) stride + size <= Size, without a product that could overflow.
  if (count > 0 &&
      (offset > range.Size || size > range.Size - offset || (count - 1) > (range.Size - offset - size) / stride))
    owner.Fail(std::to_string(count) + " elements of " + std::to_string(size) + " bytes from byte " +
                 std::to_string(offset) + " do not fit the bufferView of " + std::to_string(range.Size) + " bytes",
      "correct count and byteOffset or export the file again");
  return { range.Data + (count > 0 ? offset : 0), count * size, stride };
}

JsonValue GltfAccess::Accessor(const JsonValue& index) const
{
  const std::size_t i = index.Index(this->Root.CountOf("accessors"), "accessor");
  return this->Root.Get("accessors").At(i);
}

static std::uint64_t ComponentSize(int type)
{
  switch (type)
  {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

GltfAccess::Element GltfAccess::Describe(const JsonValue& accessor, const char* types) const
{
  Element e;
  const JsonValue component = accessor.Get("componentType");
  e.ComponentType = int(component.Unsigned(0xffff));
  if (ComponentSize(e.ComponentType) == 0)
    component.Fail(
      "componentType " + std::to_string(e.ComponentType) + " is none of 5120, 5121, 5122, 5123, 5125, 5126", Reexport);
  const JsonValue typeValue = accessor.Get("type");
  const std::string& type = typeValue.String();
  static const struct
  {
    const char* Name;
    int Components;
  } known[] = { { "SCALAR", 1 }, { "VEC2", 2 }, { "VEC3", 3 }, { "VEC4", 4 }, { "MAT2", 4 }, { "MAT3", 9 },
    { "MAT4", 16 } };
  for (const auto& k : known)
    if (type == k.Name && std::string(types).find(type) != std::string::npos)
      e.Components = k.Components;
  if (e.Components == 0)
    typeValue.Fail("type \"" + type + "\" where " + types + " is expected", Reexport);
  const JsonValue count = accessor.Get("count");
  e.Count = count.Unsigned(0xffffffffu);
  if (e.Count == 0)
    count.Fail("an accessor needs at least one element", "remove what is empty or export the file again");
  e.Normalized = accessor.BoolOr("normalized", false);
  e.Size = ComponentSize(e.ComponentType) * std::uint64_t(e.Components);
  return e;
}

template <class T, class Convert>
void GltfAccess::Read(const JsonValue& accessor, const Element& e, std::vector<T>& out, Convert convert)
{
  const std::uint64_t width = ComponentSize(e.ComponentType);
  const auto element = [&](const std::uint8_t* from, std::uint64_t to)
  {
    for (int k = 0; k < e.Components; ++k)
      out[std::size_t(to) * std::size_t(e.Components) + std::size_t(k)] = convert(from + std::uint64_t(k) * width);
  };
  const bool view = accessor.Has("bufferView");
  if (!view && e.Count > (1u << 24))
    accessor.Get("count").Fail("an accessor without a bufferView may have at most 2^24 elements (all zero)", Reexport);
  Range range;
  if (view)
    range = this->Slice(accessor, e.Count, e.Size, true);
  // Here and where it is kept in another form: any number of attributes may name one accessor.
  SceneMemory::Take(2 * e.Count * std::uint64_t(e.Components) * sizeof(T));
  out.assign(std::size_t(e.Count) * std::size_t(e.Components), T(0));
  if (view)
    for (std::uint64_t i = 0; i < e.Count; ++i)
      element(range.Data + i * range.Stride, i);
  if (!accessor.Has("sparse"))
    return;
  const JsonValue sparse = accessor.Get("sparse");
  const std::uint64_t count = sparse.Get("count").Unsigned(e.Count);
  const JsonValue indices = sparse.Get("indices"), values = sparse.Get("values");
  const int type = int(indices.Get("componentType").Unsigned(0xffff));
  if (type != 5121 && type != 5123 && type != 5125)
    indices.Get("componentType").Fail("sparse indices must be 5121, 5123 or 5125", Reexport);
  const std::uint64_t indexSize = ComponentSize(type);
  const Range at = this->Slice(indices, count, indexSize, false), from = this->Slice(values, count, e.Size, false);
  for (std::uint64_t i = 0; i < count; ++i)
  {
    std::uint32_t index = 0;
    for (std::uint64_t k = 0; k < indexSize; ++k)
      index |= std::uint32_t(at.Data[i * indexSize + k]) << (8 * k);
    if (index >= e.Count)
      indices.Fail("sparse index " + std::to_string(index) + " lies outside the accessor of " +
                     std::to_string(e.Count) + " elements",
        Reexport);
    element(from.Data + i * e.Size, index);
  }
}

void GltfAccess::CheckAll()
{
  const std::size_t views = this->Root.CountOf("bufferViews"), accessors = this->Root.CountOf("accessors");
  for (std::size_t i = 0; i < views; ++i)
    this->BufferView(this->Root.Get("bufferViews").At(i));
  for (std::size_t i = 0; i < accessors; ++i)
  {
    const JsonValue accessor = this->Root.Get("accessors").At(i);
    const Element e = this->Describe(accessor, "SCALAR VEC2 VEC3 VEC4 MAT2 MAT3 MAT4");
    if (accessor.Has("bufferView"))
      this->Slice(accessor, e.Count, e.Size, true);
  }
}

GltfAccess::Array GltfAccess::Floats(const JsonValue& index, const char* types, bool force)
{
  const JsonValue accessor = this->Accessor(index);
  const Element e = this->Describe(accessor, types);
  const bool normalized = e.Normalized || force;
  Array out;
  out.Count = std::size_t(e.Count);
  out.Components = e.Components;
  switch (e.ComponentType)
  {
    case 5120:
      this->Read(accessor, e, out.Values,
        [=](const std::uint8_t* p)
        {
          const float v = float(std::int8_t(*p));
          return normalized ? std::max(v / 127.f, -1.f) : v;
        });
      break;
    case 5121:
      this->Read(
        accessor, e, out.Values, [=](const std::uint8_t* p) { return normalized ? float(*p) / 255.f : float(*p); });
      break;
    case 5122:
      this->Read(accessor, e, out.Values,
        [=](const std::uint8_t* p)
        {
          const float v = float(std::int16_t(std::uint16_t(p[0] | p[1] << 8)));
          return normalized ? std::max(v / 32767.f, -1.f) : v;
        });
      break;
    case 5123:
      this->Read(accessor, e, out.Values,
        [=](const std::uint8_t* p)
        {
          const float v = float(p[0] | p[1] << 8);
          return normalized ? v / 65535.f : v;
        });
      break;
    case 5125:
      this->Read(accessor, e, out.Values, [=](const std::uint8_t* p) { return float(Little32(p)); });
      break;
    default:
      this->Read(accessor, e, out.Values,
        [](const std::uint8_t* p)
        {
          const std::uint32_t bits = Little32(p);
          float v;
          std::memcpy(&v, &bits, sizeof v);
          return v;
        });
  }
  return out;
}

std::vector<std::uint32_t> GltfAccess::Integers(const JsonValue& index, const char* types)
{
  const JsonValue accessor = this->Accessor(index);
  const Element e = this->Describe(accessor, types);
  std::vector<std::uint32_t> out;
  switch (e.ComponentType)
  {
    case 5121:
      this->Read(accessor, e, out, [](const std::uint8_t* p) { return std::uint32_t(*p); });
      break;
    case 5123:
      this->Read(accessor, e, out, [](const std::uint8_t* p) { return std::uint32_t(p[0] | p[1] << 8); });
      break;
    case 5125:
      this->Read(accessor, e, out, [](const std::uint8_t* p) { return Little32(p); });
      break;
    default:
      accessor.Get("componentType")
        .Fail(
          "indices must be unsigned integers (5121, 5123 or 5125), found " + std::to_string(e.ComponentType), Reexport);
  }
  return out;
}

bool GltfAccess::HasData(const JsonValue& index) const
{
  const JsonValue accessor = this->Accessor(index);
  return accessor.Has("bufferView") || accessor.Has("sparse");
}
}
}
