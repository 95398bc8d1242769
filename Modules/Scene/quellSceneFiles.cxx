// SPDX-License-Identifier: BSD-3-Clause
#include "quellSceneFiles.h"

#include "quellImageGuard.h"
#include "quellMemoryLimits.h"
#include "quellPlainImage.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <new>
#include <sstream>
#include <streambuf>

namespace quell
{
namespace detail
{
/// Names and values of a file may hold anything: messages stay one line of readable text, not too long.
static std::string Readable(std::string text, std::size_t longest)
{
  std::replace_if(
    text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, ' ');
  if (text.size() > longest)
    text = text.substr(0, longest - 3) + "...";
  return text;
}

std::string Message(
  const std::string& file, const std::string& where, const std::string& what, const std::string& remedy)
{
  std::string text = Readable(file, 4096) + ": ";
  if (!where.empty())
    text += Readable(where, 600) + ": ";
  text += Readable(what, 1200);
  if (!remedy.empty())
    text += "; " + Readable(remedy, 600);
  return text;
}

void Fail(const std::string& file, const std::string& where, const std::string& what, const std::string& remedy)
{
  throw SceneError(Message(file, where, what, remedy));
}

void Warn(Scene& scene, const std::string& where, const std::string& what, const std::string& remedy)
{
  std::string text = Message(scene.File, where, what, remedy);
  if (std::find(scene.Warnings.begin(), scene.Warnings.end(), text) == scene.Warnings.end())
    scene.Warnings.push_back(std::move(text));
}

static thread_local SceneMemory* theSceneMemory = nullptr;

SceneMemory::SceneMemory(const std::string& file)
  : Outer(theSceneMemory)
  , File(file)
{
  if (!this->Outer)
    theSceneMemory = this;
}

SceneMemory::~SceneMemory()
{
  if (!this->Outer)
    theSceneMemory = nullptr;
}

void SceneMemory::Take(std::uint64_t bytes)
{
  SceneMemory* const self = theSceneMemory;
  if (!self)
    return;
  const std::uint64_t limit = SceneMemoryLimit();
  if (bytes > limit || self->Taken > limit - bytes)
  {
    std::ostringstream megabytes;
    megabytes << double(limit) / 1e6;
    Fail(self->File, "",
      "vertices, textures and instances take more than the " + megabytes.str() + " MB that a scene may have",
      "use a smaller scene, or allow more with --scene-memory MB");
  }
  self->Taken += bytes;
}

void ContentHash::Add(const void* data, std::size_t size) noexcept
{
  const auto* p = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i)
    this->State = (this->State ^ p[i]) * 1099511628211ull;
}

std::string ContentHash::Hexadecimal() const
{
  std::string text(16, '0');
  for (int i = 0; i < 16; ++i)
    text[i] = "0123456789abcdef"[(this->State >> (60 - 4 * i)) & 15];
  return text;
}

bool ReadFile(const std::string& file, Bytes& content, std::string& reason)
{
  std::error_code error;
  const auto status = std::filesystem::status(std::filesystem::u8path(file), error);
  if (!std::filesystem::exists(status))
    return reason = "the file does not exist", false;
  if (!std::filesystem::is_regular_file(status))
    return reason = "this is not a regular file", false;
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  const std::streamoff size = in ? std::streamoff(in.tellg()) : -1;
  if (size < 0)
    return reason = "the file cannot be opened", false;
  SceneMemory::Take(std::uint64_t(size));
  content.resize(std::size_t(size));
  in.seekg(0);
  if (size > 0 && !in.read(reinterpret_cast<char*>(content.data()), size))
    return reason = "the file cannot be read to its end", false;
  return true;
}

std::string Beside(const std::string& file, const std::string& name)
{
  const std::filesystem::path path(name);
  return path.is_absolute() ? name : (std::filesystem::path(file).parent_path() / path).string();
}

bool IsDataUri(const std::string& uri)
{
  return uri.compare(0, 5, "data:") == 0;
}

bool IsRemoteUri(const std::string& uri)
{
  const std::size_t colon = uri.find("://");
  return colon != std::string::npos && colon > 0 &&
         std::all_of(uri.begin(), uri.begin() + std::ptrdiff_t(colon),
           [](unsigned char c) { return std::isalnum(c) || c == '+' || c == '-' || c == '.'; });
}

static int HexDigit(char c)
{
  return c >= '0' && c <= '9'   ? c - '0'
         : c >= 'a' && c <= 'f' ? c - 'a' + 10
         : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                : -1;
}

std::string DecodePercent(const std::string& text)
{
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i)
  {
    if (text[i] == '%' && text.size() - i > 2 && HexDigit(text[i + 1]) >= 0 && HexDigit(text[i + 2]) >= 0)
    {
      out += char(HexDigit(text[i + 1]) * 16 + HexDigit(text[i + 2]));
      i += 2;
    }
    else
      out += text[i];
  }
  return out;
}

static bool DecodeBase64(const char* text, std::size_t size, Bytes& content, std::string& reason)
{
  content.clear();
  content.reserve(size / 4 * 3);
  std::uint32_t bits = 0;
  int count = 0;
  std::size_t i = 0;
  for (; i < size && text[i] != '='; ++i)
  {
    const char c = text[i];
    const int v = c >= 'A' && c <= 'Z'   ? c - 'A'
                  : c >= 'a' && c <= 'z' ? c - 'a' + 26
                  : c >= '0' && c <= '9' ? c - '0' + 52
                  : c == '+' || c == '-' ? 62
                  : c == '/' || c == '_' ? 63
                                         : -1;
    if (v < 0)
      return reason = "invalid base64 character at offset " + std::to_string(i), false;
    bits = (bits << 6) | std::uint32_t(v);
    if (++count == 4)
    {
      content.push_back(std::uint8_t(bits >> 16));
      content.push_back(std::uint8_t(bits >> 8));
      content.push_back(std::uint8_t(bits));
      bits = 0;
      count = 0;
    }
  }
  for (; i < size; ++i)
    if (text[i] != '=')
      return reason = "base64 data goes on after its padding", false;
  if (count == 1)
    return reason = "the base64 data is cut off", false;
  if (count == 2)
    content.push_back(std::uint8_t(bits >> 4));
  if (count == 3)
  {
    content.push_back(std::uint8_t(bits >> 10));
    content.push_back(std::uint8_t(bits >> 2));
  }
  return true;
}

bool DecodeDataUri(const std::string& uri, Bytes& content, std::string& reason)
{
  const std::size_t comma = uri.find(',');
  if (!IsDataUri(uri) || comma == std::string::npos)
    return reason = "the data URI has no ','", false;
  const std::string type = uri.substr(5, comma - 5);
  if (type.size() >= 7 && type.compare(type.size() - 7, 7, ";base64") == 0)
    return DecodeBase64(uri.data() + comma + 1, uri.size() - comma - 1, content, reason);
  const std::string plain = DecodePercent(uri.substr(comma + 1));
  content.assign(plain.begin(), plain.end());
  return true;
}

// Any channel count to RGBA: grey is replicated, missing alpha is 1.
template <class T>
static std::vector<T> ToRgba(const std::vector<T>& in, std::size_t pixels, int channels, T one)
{
  std::vector<T> out(pixels * 4);
  for (std::size_t i = 0; i < pixels; ++i)
  {
    const T* p = in.data() + i * std::size_t(channels);
    T* q = out.data() + i * 4;
    q[0] = p[0];
    q[1] = channels >= 3 ? p[1] : p[0];
    q[2] = channels >= 3 ? p[2] : p[0];
    q[3] = channels == 2 ? p[1] : channels >= 4 ? p[3] : one;
  }
  return out;
}

static bool ReadOpened(OIIO::ImageInput& input, std::int64_t fileBytes, Texture& texture, std::string& reason)
{
  const OIIO::ImageSpec spec = input.spec();
  if (spec.nchannels > 64 || spec.deep)
    return reason = "the image has no usable pixels", false;
  for (const ImageFault& fault : { CheckImageSpec(spec, fileBytes), CheckImageRows(spec) })
    if (fault)
      return reason = fault.Cause + "; " + fault.Remedy, false;
  const std::uint64_t pixels = std::uint64_t(spec.width) * std::uint64_t(spec.height);
  const int channels = std::min(spec.nchannels, 4);
  const bool bytes = spec.format.basetype == OIIO::TypeDesc::UINT8;
  SceneMemory::Take(pixels * 4 * (bytes ? 1 : sizeof(float)));
  std::vector<std::uint8_t> b(bytes ? pixels * std::size_t(channels) : 0);
  std::vector<float> f(bytes ? 0 : pixels * std::size_t(channels));
  const bool ok = bytes ? input.read_image(0, 0, 0, channels, OIIO::TypeDesc::UINT8, b.data())
                        : input.read_image(0, 0, 0, channels, OIIO::TypeDesc::FLOAT, f.data());
  if (!ok)
    return reason = "decoding fails: " + OneLine(input.geterror()), false;
  texture.Width = spec.width;
  texture.Height = spec.height;
  texture.Bytes = bytes ? ToRgba<std::uint8_t>(b, pixels, channels, 255) : std::vector<std::uint8_t>();
  texture.Floats = bytes ? std::vector<float>() : ToRgba<float>(f, pixels, channels, 1.f);
  return true;
}

static OIIO::ImageSpec OpenConfiguration()
{
  OIIO::ImageSpec config;
  config.attribute("oiio:UnassociatedAlpha", 1); // glTF and MTL colours are not multiplied by alpha
  return config;
}

/// Bytes of memory as a stream.
struct ByteStream : std::streambuf
{
  explicit ByteStream(const Bytes& content)
  {
    char* begin = reinterpret_cast<char*>(const_cast<std::uint8_t*>(content.data()));
    this->setg(begin, begin, begin + content.size());
  }
  pos_type seekoff(off_type offset, std::ios_base::seekdir from, std::ios_base::openmode) override
  {
    if (from != std::ios_base::beg || offset < 0 || offset > this->egptr() - this->eback())
      return pos_type(off_type(-1));
    this->setg(this->eback(), this->eback() + offset, this->egptr());
    return pos_type(offset);
  }
  pos_type seekpos(pos_type position, std::ios_base::openmode which) override
  {
    return this->seekoff(off_type(position), std::ios_base::beg, which);
  }
};

static bool DecodeAs(const std::string& format, const Bytes& content, Texture& texture, std::string& reason)
{
  ByteStream bytes(content);
  std::istream head(&bytes);
  if (const ImageFault fault = CheckImageHead(head, format, std::int64_t(content.size())))
    return reason = fault.Cause + "; " + fault.Remedy, false;
  try
  {
    OIIO::Filesystem::IOMemReader memory(const_cast<void*>(static_cast<const void*>(content.data())), content.size());
    const OIIO::ImageSpec config = OpenConfiguration();
    auto input = OIIO::ImageInput::create(format);
    if (!input || !input->set_ioproxy(&memory))
      return reason = "OpenImageIO lacks the format", false;
    OIIO::ImageSpec spec;
    if (!input->open("memory." + (format == "openexr" ? "exr" : format), spec, config))
      return reason = "decoding fails: " + OneLine(input->geterror()), false;
    return ReadOpened(*input, std::int64_t(content.size()), texture, reason);
  }
  catch (const SceneError&)
  {
    throw; // too large is no fault of the image alone
  }
  catch (const std::exception& e)
  {
    return reason = "decoding fails: " + OneLine(e.what()), false;
  }
}

/// Targa and BMP, by our own code.
static bool DecodePlain(const std::string& format, const Bytes& content, Texture& texture, std::string& reason)
{
  PlainImage image;
  // As RGBA, beside the pixels as decoded.
  const auto take = [](std::uint64_t bytes) { SceneMemory::Take(bytes * 4); };
  if (!DecodePlainImage(format, content.data(), content.size(), take, image, reason))
    return false;
  texture.Width = image.Width;
  texture.Height = image.Height;
  texture.Bytes = ToRgba<std::uint8_t>(
    image.Pixels, std::size_t(image.Width) * std::size_t(image.Height), image.Channels, std::uint8_t(255));
  texture.Floats.clear();
  return true;
}

bool DecodeImage(const Bytes& content, Texture& texture, std::string& reason)
{
  const std::string format = SniffImage(content.data(), content.size());
  if (format != "png" && format != "jpeg" && format != "webp")
    return reason = "this is neither PNG nor JPEG nor WebP, the formats that glTF allows", false;
  return DecodeAs(format, content, texture, reason);
}

bool LoadImage(const std::string& file, Texture& texture, std::string& reason)
{
  texture.SRGB = true;
  Bytes content;
  if (!ReadFile(file, content, reason))
    return false;
  const std::string format = SniffImage(content.data(), content.size());
  if (format.empty())
  {
    const std::string plain = SniffPlainImage(content.data(), content.size(), file);
    if (!plain.empty())
      return DecodePlain(plain, content, texture, reason);
    const bool tiff = content.size() > 4 &&
                      (std::memcmp(content.data(), "II*", 4) == 0 || std::memcmp(content.data(), "MM\0*", 4) == 0);
    return reason = std::string(tiff ? "TIFF is not read" : "this is no image format that Quell reads") +
                    "; convert it to PNG",
           false;
  }
  if (format == "png" || format == "jpeg" || format == "webp")
    return DecodeAs(format, content, texture, reason);
  ByteStream bytes(content);
  std::istream head(&bytes);
  if (const ImageFault fault = CheckImageHead(head, format, std::int64_t(content.size())))
    return reason = fault.Cause + "; " + fault.Remedy, false;
  // Readers of the other formats want a file.
  try
  {
    const OIIO::ImageSpec config = OpenConfiguration();
    auto input = OIIO::ImageInput::create(format);
    if (!input)
      return reason = "OpenImageIO lacks the format", false;
    OIIO::ImageSpec spec;
    if (!input->open(file, spec, config))
      return reason = "it cannot be opened: " + OneLine(input->geterror()), false;
    texture.SRGB = !spec.format.is_floating_point();
    return ReadOpened(*input, std::int64_t(content.size()), texture, reason);
  }
  catch (const SceneError&)
  {
    throw;
  }
  catch (const std::exception& e)
  {
    return reason = "decoding fails: " + OneLine(e.what()), false;
  }
}

bool LoadSky(const std::string& file, Texture& texture, std::string& repairs, std::string& reason)
{
  if (!LoadImage(file, texture, reason))
    return false;
  // A weighted sum of such values is still a number.
  const float largest = 1e37f;
  std::size_t dark = 0, bright = 0;
  for (float& v : texture.Floats)
    if (!(v >= 0) || !std::isfinite(v))
    {
      v = 0;
      ++dark;
    }
    else if (v > largest)
    {
      v = largest;
      ++bright;
    }
  repairs.clear();
  if (dark > 0)
    repairs = std::to_string(dark) + " value(s) are negative or not finite and became 0";
  if (bright > 0)
    repairs += (dark > 0 ? ", " : "") + std::to_string(bright) + " value(s) above 1e37 became that";
  texture.Name = file;
  texture.WrapS = Wrap::Repeat;
  texture.WrapT = Wrap::Clamp;
  return true;
}

static void FillNormals(Mesh& mesh, std::size_t& replaced)
{
  std::vector<char> bad(mesh.Normals.size());
  replaced = 0;
  for (std::size_t i = 0; i < mesh.Normals.size(); ++i)
  {
    const Vec3d n(mesh.Normals[i]);
    const double l2 = Dot(n, n);
    bad[i] = !(l2 > 1e-12) || !std::isfinite(l2);
    replaced += bad[i];
  }
  if (replaced == 0)
    return;
  std::vector<Vec3d> sums(mesh.Normals.size());
  for (std::size_t t = 0; t + 2 < mesh.Indices.size(); t += 3)
  {
    const std::uint32_t* v = &mesh.Indices[t];
    const Vec3d a(mesh.Positions[v[0]]), b(mesh.Positions[v[1]]), c(mesh.Positions[v[2]]);
    const Vec3d n = Cross(b - a, c - a);
    for (int k = 0; k < 3; ++k)
      if (bad[v[k]])
        sums[v[k]] += n;
  }
  for (std::size_t i = 0; i < bad.size(); ++i)
    if (bad[i])
    {
      const Vec3d n = Normalized(sums[i]);
      mesh.Normals[i] = Dot(n, n) > 0 ? Vec3f(n) : Vec3f(0, 1, 0); // only degenerate triangles use the latter
    }
}

template <class T>
static void Compact(std::vector<T>& values, const std::vector<std::uint32_t>& kept, std::size_t each = 1)
{
  if (values.empty())
    return;
  std::vector<T> out(kept.size() * each);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = values[kept[i / each] * each + i % each];
  values.swap(out);
}

/// For each of n things the first one that equals it. `hash` and `equal` act on indices.
template <class Hash, class Equal>
static std::vector<std::uint32_t> FirstEqual(std::size_t n, Hash hash, Equal equal)
{
  constexpr std::uint32_t empty = 0xffffffffu;
  std::size_t size = 16;
  while (size < 2 * n)
    size *= 2;
  std::vector<std::uint32_t> table(size, empty), first(n);
  for (std::size_t i = 0; i < n; ++i)
  {
    std::size_t slot = std::size_t(hash(i)) & (size - 1);
    while (table[slot] != empty && !equal(table[slot], i))
      slot = (slot + 1) & (size - 1);
    if (table[slot] == empty)
      table[slot] = std::uint32_t(i);
    first[i] = table[slot];
  }
  return first;
}

static std::uint64_t Mix(std::uint64_t h, std::uint32_t v)
{
  h = (h ^ v) * 0x9e3779b97f4a7c15ull;
  return h ^ (h >> 29);
}

/// Triangles without area and repeated ones. Vertices of a mesh that deforms are told apart by their number, as equal
/// ones may part; of any other mesh by their place.
static void DropUseless(Mesh& mesh, bool doubleSided, std::size_t& flat, std::size_t& repeated)
{
  flat = repeated = 0;
  const bool deforms = mesh.Influences > 0 || !mesh.Targets.empty();
  const std::vector<Vec3f>& p = mesh.Positions;
  std::vector<std::uint32_t> place;
  if (!deforms)
    place = FirstEqual(
      p.size(),
      [&](std::size_t i)
      {
        std::uint64_t h = 0;
        for (int c = 0; c < 3; ++c)
        {
          const float v = p[i][c] + 0.f; // -0 is 0
          std::uint32_t bits;
          std::memcpy(&bits, &v, sizeof bits);
          h = Mix(h, bits);
        }
        return h;
      },
      [&](std::size_t a, std::size_t b) { return p[a] == p[b]; });
  std::vector<std::array<std::uint32_t, 3>> corners;
  std::size_t write = 0;
  corners.reserve(mesh.Indices.size() / 3);
  for (std::size_t t = 0; t + 2 < mesh.Indices.size(); t += 3)
  {
    const std::uint32_t v[3] = { mesh.Indices[t], mesh.Indices[t + 1], mesh.Indices[t + 2] };
    std::array<std::uint32_t, 3> key{ v[0], v[1], v[2] };
    if (!deforms)
      key = { place[v[0]], place[v[1]], place[v[2]] };
    bool useless = key[0] == key[1] || key[1] == key[2] || key[2] == key[0];
    if (!useless && !deforms)
    {
      // Corners in one line up to the rounding of this very computation.
      const Vec3d a(p[v[0]]), e(Vec3d(p[v[1]]) - a), f(Vec3d(p[v[2]]) - a);
      useless = Length(Cross(e, f)) <= 1e-14 * Length(e) * Length(f);
    }
    if (useless)
    {
      ++flat;
      continue;
    }
    if (doubleSided)
      std::sort(key.begin(), key.end());
    else
      std::rotate(key.begin(), std::min_element(key.begin(), key.end()), key.end());
    corners.push_back(key);
    for (int k = 0; k < 3; ++k)
      mesh.Indices[write++] = v[k];
  }
  mesh.Indices.resize(write);
  const std::vector<std::uint32_t> first = FirstEqual(
    corners.size(), [&](std::size_t i) { return Mix(Mix(Mix(0, corners[i][0]), corners[i][1]), corners[i][2]); },
    [&](std::size_t a, std::size_t b) { return corners[a] == corners[b]; });
  write = 0;
  for (std::size_t i = 0; i < first.size(); ++i)
  {
    if (first[i] != i)
    {
      ++repeated;
      continue;
    }
    for (std::size_t k = 0; k < 3; ++k)
      mesh.Indices[write++] = mesh.Indices[3 * i + k];
  }
  mesh.Indices.resize(write);
}

std::string Names(const std::vector<std::string>& list)
{
  std::string text;
  for (std::size_t i = 0; i < list.size() && i < 3; ++i)
    text += (i > 0 ? ", " : "") + list[i];
  return list.size() > 3 ? text + " and " + std::to_string(list.size() - 3) + " more" : text;
}

void MeshFaults::Warn(Scene& scene) const
{
  const char* const remedy = "clean the mesh in the program that made it where this is not intended";
  if (this->Flat.Count > 0)
    detail::Warn(scene, Names(this->Flat.Meshes),
      std::to_string(this->Flat.Count) + " triangle(s) without area were dropped", remedy);
  if (this->Repeated.Count > 0)
    detail::Warn(scene, Names(this->Repeated.Meshes),
      std::to_string(this->Repeated.Count) + " triangle(s) at the place of another one were dropped", remedy);
}

void CleanMesh(Scene& scene, Mesh& mesh, const std::string& where, const Material& material, MeshFaults& faults)
{
  std::size_t dropped = 0, write = 0;
  for (std::size_t t = 0; t + 2 < mesh.Indices.size(); t += 3)
  {
    const std::uint32_t v[3] = { mesh.Indices[t], mesh.Indices[t + 1], mesh.Indices[t + 2] };
    if (IsFinite(mesh.Positions[v[0]]) && IsFinite(mesh.Positions[v[1]]) && IsFinite(mesh.Positions[v[2]]))
    {
      for (int k = 0; k < 3; ++k)
        mesh.Indices[write++] = v[k];
    }
    else
      ++dropped;
  }
  mesh.Indices.resize(write);
  const bool stray =
    std::any_of(mesh.Positions.begin(), mesh.Positions.end(), [](const Vec3f& p) { return !IsFinite(p); });
  if (stray)
  {
    constexpr std::uint32_t unused = 0xffffffffu;
    std::vector<std::uint32_t> to(mesh.Positions.size(), unused), kept;
    for (std::uint32_t& v : mesh.Indices)
    {
      if (to[v] == unused)
      {
        to[v] = std::uint32_t(kept.size());
        kept.push_back(v);
      }
      v = to[v];
    }
    Compact(mesh.Positions, kept);
    Compact(mesh.Normals, kept);
    Compact(mesh.Tangents, kept);
    Compact(mesh.TexCoords[0], kept);
    Compact(mesh.TexCoords[1], kept);
    Compact(mesh.Colors, kept);
    Compact(mesh.Joints, kept, std::size_t(mesh.Influences));
    Compact(mesh.JointWeights, kept, std::size_t(mesh.Influences));
    for (MorphTarget& target : mesh.Targets)
      for (std::vector<Vec3f>* list : { &target.Positions, &target.Normals, &target.Tangents })
        Compact(*list, kept);
  }
  const std::string who = where + (mesh.Name.empty() ? "" : " \"" + mesh.Name + "\"");
  if (dropped > 0)
    Warn(scene, who, std::to_string(dropped) + " triangle(s) with a position that is not finite were dropped",
      "repair the mesh in the program that made it");
  std::size_t flat = 0, repeated = 0;
  DropUseless(mesh, material.DoubleSided, flat, repeated);
  const auto count = [&](MeshFaults::Kind& kind, std::size_t triangles)
  {
    kind.Count += triangles;
    if (triangles > 0)
      kind.Meshes.push_back(who);
  };
  count(faults.Flat, flat);
  count(faults.Repeated, repeated);
  if (mesh.Indices.empty() && dropped + flat > 0)
    Warn(scene, who,
      "nothing is left of the mesh" + (MaxComponent(material.Emission) > 0
                                          ? "; material \"" + material.Name + "\" gives no light there"
                                          : std::string()),
      "repair it in the program that made it");
  std::size_t replaced = 0;
  FillNormals(mesh, replaced);
  if (replaced > 0)
    Warn(scene, who,
      std::to_string(replaced) + " normal(s) of no length or not finite were replaced by those of the faces",
      "re-export the mesh with normals");
  std::size_t colors = 0;
  for (Vec4f& c : mesh.Colors)
    for (float* p : { &c.x, &c.y, &c.z, &c.w })
      if (!(*p >= 0) || !std::isfinite(*p))
      {
        *p = 0;
        ++colors;
      }
  if (colors > 0)
    Warn(scene, who, std::to_string(colors) + " vertex colour value(s) negative or not finite became 0", "");
}

void CheckLights(Scene& scene)
{
  constexpr float largestHalf = 65504, largestPower = 1e18f;
  const auto number = [](float v)
  {
    std::ostringstream text;
    text << v;
    return text.str();
  };
  for (std::size_t i = 0; i < scene.Lights.size(); ++i)
  {
    const PunctualLight& light = scene.Lights[i];
    if (MaxComponent(light.Intensity) > largestPower)
      Warn(scene, light.Name.empty() ? "light " + std::to_string(i) : "light \"" + light.Name + "\"",
        "the intensity of " + number(MaxComponent(light.Intensity)) +
          " is beyond what sums in single precision can hold",
        "lower it and the exposure");
  }
  const bool any = std::any_of(
    scene.Materials.begin(), scene.Materials.end(), [](const Material& m) { return MaxComponent(m.Emission) > 0; });
  if (!any)
    return;
  const ScenePose pose = scene.PoseAt(0);
  const std::vector<char> moves = scene.MovingInstances();
  std::vector<Vec3f> positions;
  for (std::size_t i = 0; i < scene.Instances.size(); ++i)
  {
    const Instance& instance = scene.Instances[i];
    const Mesh& mesh = scene.Meshes[std::size_t(instance.Mesh)];
    const Material& material = scene.Materials[std::size_t(mesh.Material)];
    if (!(MaxComponent(material.Emission) > 0))
      continue;
    if (MaxComponent(material.Emission) > largestHalf)
      Warn(scene, "material \"" + material.Name + "\"",
        "the emission of " + number(MaxComponent(material.Emission)) +
          " is beyond what images of half precision can hold (65504)",
        "lower it and the exposure");
    if (moves[i])
      continue;
    const Mat4& world = pose.World[std::size_t(instance.Node)];
    scene.Deform(instance, pose, world.Point(Vec3d()), positions, nullptr, nullptr);
    bool area = false;
    for (std::size_t t = 0; t + 2 < mesh.Indices.size() && !area; t += 3)
    {
      const Vec3d a(positions[mesh.Indices[t]]), b(positions[mesh.Indices[t + 1]]), c(positions[mesh.Indices[t + 2]]);
      area = Length(Cross(b - a, c - a)) > 0;
    }
    if (!area)
      Warn(scene, "node \"" + scene.Nodes[std::size_t(instance.Node)].Name + "\"",
        "the lamp of mesh \"" + mesh.Name + "\" and material \"" + material.Name + "\" has no area and gives no light",
        "correct the scale of the node");
  }
}
}
}
