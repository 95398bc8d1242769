// SPDX-License-Identifier: BSD-3-Clause
#include "quellFuzzFiles.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstring>
#include <set>

using Json = nlohmann::json;

const char* const FuzzSplit = "\n#### the MTL begins here\n";

namespace
{
std::string ExtensionOf(const std::string& name)
{
  return name.substr(name.find_last_of('.'));
}

void PutNumber(std::string& text, std::size_t at, std::uint64_t value, int bytes, bool big)
{
  for (int i = 0; i < bytes && at + std::size_t(i) < text.size(); ++i)
    text[at + std::size_t(i)] = char(value >> 8 * (big ? bytes - 1 - i : i) & 0xFF);
}

std::uint32_t Little32(const std::string& text, std::size_t at)
{
  std::uint32_t v = 0;
  for (int i = 4; i-- > 0;)
    v = v << 8 | static_cast<unsigned char>(text[at + std::size_t(i)]);
  return v;
}

const std::vector<std::string> ImageWords = { "dataWindow", "displayWindow", "box2i", "channels", "chlist",
  "compression", "lineOrder", "tiles", "tiledesc", "type", "deepscanline", "scanlineimage", "tiledimage", "deeptile",
  "chunkCount", "multiView", "preview", "name", "string", "version", "int", "float", "double", "m44f", "v2f",
  "timecode", "pixelAspectRatio", "screenWindowWidth", "chromaticities", "worldToCamera", "quell:layers",
  "quell:format", "R", "G", "B", "A", "Z", "N.X", "albedo.R", std::string("R\0\2\0\0\0", 6), std::string("\0\0", 2),
  "IHDR", "PLTE", "IDAT", "IEND", "tRNS", "iCCP", "zTXt", "iTXt", "gAMA", "cHRM", "acTL", "fcTL", "\xff\xd8",
  "\xff\xd9", "\xff\xc0", "\xff\xc2", "\xff\xc4", "\xff\xda", "\xff\xdb", "\xff\xe1", "\xff\xe2", "\xff\xed",
  "ICC_PROFILE", std::string("Exif\0\0II*\0", 10), "mluc", "desc", "#?RADIANCE", "FORMAT=32-bit_rle_rgbe",
  "-Y 16 +X 24", "+X 24 -Y 16", "EXPOSURE=", "P1", "P6", "PF", "Pf", "65535", "RIFF", "WEBP", "VP8X", "VP8L", "VP8 ",
  "ALPH", "ANIM", "ANMF", "EXIF" };
const std::vector<std::string> ObjWords = { "v ", "vt ", "vn ", "vp ", "f ", "f 1/1/1 2//2 3/3", "f -1 -2 -3",
  "f 1 1 1", "f 4294967295 1 2", "f 0 0 0", "l 1 2 3", "p 1", "g ", "o ", "s ", "s off", "usemtl ", "mtllib ",
  "mtllib model.mtl", "newmtl ", "Ka ", "Kd ", "Ks 0.04 0.04 0.04", "Ke 1 1 1", "Tf 1 0 0", "Ns 1e9", "Ni 0", "Ni 1.5",
  "d 0", "Tr 1", "illum 7", "illum -1", "map_Kd ", "map_Ks ", "map_d ", "map_Ke ", "norm ", "bump ", "disp ", "refl ",
  "-s 1 1 1", "-o 1 1 1", "-t 1 1 1", "-clamp on", "-bm 1", "-imfchan r", "-mm 0 1", "-blendu on", "-texres 4",
  "Pr 0.5", "Pm 1", "nan", "inf", "1e39", "-1e39", "1e-46", "\\\n", "\r\n", "\t", "#", "  ", "t 1/1/1", "xyzrgb",
  "vw 1 1", "t a 1/0/0 5" };
const std::vector<std::string> JsonKeys = { "accessors", "animations", "asset", "attributes", "baseColorTexture",
  "buffer", "bufferView", "buffers", "byteLength", "byteOffset", "byteStride", "camera", "cameras", "channels",
  "children", "componentType", "count", "extensions", "extensionsRequired", "extensionsUsed", "extras", "images",
  "index", "indices", "input", "inverseBindMatrices", "interpolation", "joints", "light", "lights", "material",
  "materials", "matrix", "max", "mesh", "meshes", "min", "mode", "node", "nodes", "normalized", "output", "path",
  "primitives", "rotation", "sampler", "samplers", "scale", "scene", "scenes", "skeleton", "skin", "skins", "source",
  "sparse", "target", "targets", "texCoord", "texture", "textures", "translation", "type", "uri", "values", "weights",
  "KHR_texture_transform", "KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_materials_emissive_strength",
  "KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_clearcoat", "KHR_materials_specular",
  "KHR_materials_ior", "KHR_materials_unlit", "KHR_draco_mesh_compression", "EXT_meshopt_compression",
  "EXT_texture_webp", "POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0", "JOINTS_0", "WEIGHTS_0",
  "JOINTS_1", "WEIGHTS_1", "TRANSLATION", "ROTATION", "SCALE", "environment", "resolution", "max_depth", "" };

const std::vector<std::string> StateWords = { "pt", "taa", "acc", "radiance", "depth", "normal", "history", "moments",
  "sampleCount", "QUELLCKP", std::string("\x01\0\0\0", 4), std::string("\0\0\xc0\x7f", 4),
  std::string("\0\0\x80\x7f", 4), std::string("\0\0\x80\xff", 4), std::string("\xff\xff\x7f\x7f", 4),
  std::string("\0\0\0\0\0\0\xf0\x7f", 8), std::string("\0\0\0\0\0\0\xf8\x7f", 8), "\x1b[2J", "\n",
  std::string(8, '\xff'), std::string(8, '\0') };
const std::vector<std::string> ColourWords = { "!<ColorSpace>", "!<GroupTransform>", "!<FileTransform>", "!<View>",
  "!<Look>", "!<CDLTransform>", "!<MatrixTransform>", "!<ColorSpaceTransform> {src: lin, dst: graded}",
  "!<FileTransform> {src: case.ocio}", "!<FileTransform> {src: /dev/zero}", "!<FileTransform> {src: .}",
  "children:", "name: ", "src: ", "direction: inverse", "interpolation: cubic",
  "matrix: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]", "gamma: 0", "base: 1", "base: -2",
  "from_scene_reference: ", "to_scene_reference: ", "ocio_profile_version: 1", "search_path: /", "$SHOT", "$(SHOT)",
  "%SHOT%", "<USE_DISPLAY_NAME>", "[", "]", "{", "}", ": ", "- ", "&a ", "*a", "!!binary ", "|\n", "LUT_1D_SIZE 65536",
  "LUT_1D_SIZE 0", "LUT_3D_SIZE 129", "LUT_3D_SIZE 1", "LUT_3D_SIZE -2", "DOMAIN_MIN 1 1 1", "DOMAIN_MAX 0 0 0",
  "TITLE \"", "Length 1000000000", "Components 4", "Version 2", "From 1 1", "Length 0", "CSPLUTV100", "1D", "3D",
  "BEGIN METADATA", "SPILUT 1.0", "nan", "-nan", "inf", "-inf", "1e39", "1e400", "-1", "0", "2147483648", "-2147483649",
  "<ProcessList", "<LUT1D", "<LUT3D", "<Array dim=\"2 2 2 3\">", "<Array dim=\"1000000000 3\">", "<Matrix", "<Range",
  "<Log", "<Exponent", "<ASC_CDL", "inBitDepth=\"16f\"", "outBitDepth=\"8i\"", "halfDomain=\"true\"",
  "rawHalfs=\"true\"", "interpolation=\"1D_cubic\"", "style=\"", "/>", "</Array>",
  "<IndexMap dim=\"2\">0@0 1@1</IndexMap>", "<!DOCTYPE a [<!ENTITY b \"c\">]>", "&b;", "<![CDATA[", "]]>" };

/// Every value of a document.
void Collect(Json& json, std::vector<Json*>& all)
{
  all.push_back(&json);
  if (json.is_structured())
    for (Json& inner : json)
      Collect(inner, all);
}
}

std::uint64_t FileMutator::Number()
{
  static const std::uint64_t values[] = { 0, 1, 2, 3, 4, 7, 8, 15, 16, 17, 31, 32, 63, 64, 100, 127, 128, 255, 256, 257,
    1000, 1023, 1024, 4095, 4096, 32767, 32768, 65535, 65536, 65537, 1000000, 16777215, 16777216, 2147483646,
    2147483647, 2147483648u, 2147483649u, 4294967294u, 4294967295u, 0x7ff0000000000000u, 0x7fffffffffffffffu,
    ~std::uint64_t(0) };
  return this->Below(4) ? values[this->Below(std::size(values))] : this->Random.Any() >> this->Below(64);
}

void FileMutator::MutateBytes(std::string& text, const std::vector<std::string>& dictionary, std::size_t from)
{
  if (text.size() <= from)
    return;
  const std::size_t at = from + this->Below(text.size() - from);
  switch (this->Below(12))
  {
    case 0:
      text[at] = char(this->Random.Any() & 0xFF);
      break;
    case 1:
      text[at] = char(text[at] ^ (1 << this->Below(8)));
      break;
    case 2:
    case 3:
    {
      const int bytes = 1 << this->Below(4);
      PutNumber(text, at, this->Number(), bytes, this->Below(2) != 0);
      break;
    }
    case 4:
      text.erase(at, 1 + this->Below(this->Below(2) ? 4 : 200));
      break;
    case 5:
      text.insert(at, text.substr(from + this->Below(text.size() - from), 1 + this->Below(100)));
      break;
    case 6:
    {
      const std::string& word = dictionary[this->Below(dictionary.size())];
      if (this->Below(2))
        text.insert(at, word);
      else
        text.replace(at, std::min(word.size(), text.size() - at), word);
      break;
    }
    case 7:
      std::swap(text[at], text[from + this->Below(text.size() - from)]);
      break;
    case 8:
      if (this->Below(4) == 0)
        text.resize(at);
      break;
    case 9: // a run of one byte
      for (std::size_t i = at, end = std::min(text.size(), at + 1 + this->Below(64)); i < end; ++i)
        text[i] = this->Below(2) ? '\xff' : '\0';
      break;
    case 10: // of another file
    {
      const std::string& other = this->Seeds[this->Below(this->Seeds.size())].Text;
      const std::size_t begin = this->Below(other.size());
      text.replace(at, this->Below(64), other.substr(begin, this->Below(200)));
      break;
    }
    default:
      PutNumber(text, at, this->Number(), 4, false);
      break;
  }
}

/// An attribute: name, 0, type, 0, size, value.
void FileMutator::MutateExr(std::string& text)
{
  struct Attribute
  {
    std::size_t Name, Type, Size, Value;
    std::uint32_t Bytes;
  };
  std::vector<Attribute> all;
  for (std::size_t at = 8; at < text.size() && text[at] != '\0';)
  {
    Attribute a{ at, 0, 0, 0, 0 };
    a.Type = text.find('\0', at) + 1;
    a.Size = a.Type ? text.find('\0', a.Type) + 1 : 0;
    if (a.Type == 0 || a.Size == 0 || a.Size + 4 > text.size())
      break;
    a.Bytes = Little32(text, a.Size);
    a.Value = a.Size + 4;
    if (a.Bytes > text.size() - a.Value)
      break;
    all.push_back(a);
    at = a.Value + a.Bytes;
  }
  if (all.empty())
    return this->MutateBytes(text, ImageWords, 0);
  const Attribute a = all[this->Below(all.size())], b = all[this->Below(all.size())];
  const std::string whole = text.substr(a.Name, a.Value + a.Bytes - a.Name);
  switch (this->Below(7))
  {
    case 0: // a number in its value
    case 1:
    case 2:
      if (a.Bytes > 0)
        PutNumber(text, a.Value + (a.Bytes > 4 ? this->Below(a.Bytes / 4) * 4 : 0), this->Number(),
          int(std::min<std::uint32_t>(4, a.Bytes)), false);
      break;
    case 3:
      text.erase(a.Name, whole.size());
      break;
    case 4:
      text.insert(b.Name, whole);
      break;
    case 5:
      PutNumber(text, a.Size, this->Number(), 4, false);
      break;
    default: // flags: tiled, long names, deep, parts
      text[5] = char(text[5] ^ (2 << this->Below(4)));
      break;
  }
}

void FileMutator::MutateJson(std::string& text)
{
  Json document = Json::parse(text, nullptr, false);
  if (document.is_discarded())
    return this->MutateBytes(text, JsonKeys, 0);
  std::vector<Json*> all;
  Collect(document, all);
  Json& chosen = *all[this->Below(all.size())];
  switch (this->Below(10))
  {
    case 0: // another number
    case 1:
    case 2:
    {
      std::vector<Json*> numbers;
      for (Json* j : all)
        if (j->is_number())
          numbers.push_back(j);
      if (numbers.empty())
        break;
      Json& number = *numbers[this->Below(numbers.size())];
      switch (this->Below(6))
      {
        case 0:
          number = this->Number();
          break;
        case 1:
          number = -1 - std::int64_t(this->Below(3));
          break;
        case 2:
          number = this->Below(2) ? 1e308 : 1e-320;
          break;
        case 3:
          number = double(this->Below(1000)) / 7;
          break;
        default:
          number = this->Below(12);
          break;
      }
      break;
    }
    case 3: // of another type
    {
      const Json values[] = { nullptr, true, 0, -1, 0.5, "", "x", Json::array(), Json::object(), Json::array({ 0 }),
        Json::object({ { "index", 0 } }), Json::array({ nullptr, 1, "a" }) };
      chosen = values[this->Below(std::size(values))];
      break;
    }
    case 4: // less
      if (chosen.is_array() && !chosen.empty())
        chosen.erase(this->Below(chosen.size()));
      else if (chosen.is_object() && !chosen.empty())
        chosen.erase(std::next(chosen.begin(), std::ptrdiff_t(this->Below(chosen.size()))));
      break;
    case 5: // more of the same
      if (chosen.is_array() && !chosen.empty())
        for (std::size_t i = 1 + this->Below(this->Below(20) ? 4 : 2000); i > 0; --i)
          chosen.push_back(chosen[this->Below(chosen.size())]);
      break;
    case 6: // what stands elsewhere
    {
      const Json copy = *all[this->Below(all.size())];
      if (copy.dump().size() < 20000)
        chosen = copy;
      break;
    }
    case 7: // a key of the dictionary
      if (chosen.is_object())
      {
        const Json copy = *all[this->Below(all.size())];
        if (copy.dump().size() < 20000)
          chosen[JsonKeys[this->Below(JsonKeys.size())]] = copy;
      }
      break;
    case 8: // another word
      if (chosen.is_string())
      {
        static const char* const words[] = { "SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT4", "LINEAR", "STEP",
          "CUBICSPLINE", "rotation", "weights", "scale", "MASK", "BLEND", "point", "spot", "perspective",
          "orthographic", "data:,", "data:image/png;base64,", "data:;base64,AAAA", "%00", "../../../../etc/passwd",
          "/dev/zero", ".", "2.1", "constant", "envmap", "image/png" };
        chosen = words[this->Below(std::size(words))];
      }
      break;
    default: // deeper
      chosen = this->Below(2) ? Json::array({ chosen }) : Json::object({ { "extensions", chosen } });
      break;
  }
  text = document.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void FileMutator::MutateGlb(std::string& text)
{
  if (text.size() < 28 || this->Below(4) == 0)
    return this->MutateBytes(text, JsonKeys, 0);
  const std::size_t length = std::min<std::size_t>(Little32(text, 12), text.size() - 20);
  std::string json = text.substr(20, length), rest = text.substr(20 + length);
  if (this->Below(3))
    this->MutateJson(json);
  else
    this->MutateBytes(rest, JsonKeys, 0);
  json.resize((json.size() + 3) / 4 * 4, ' ');
  text.resize(20);
  PutNumber(text, 8, 20 + json.size() + rest.size(), 4, false);
  PutNumber(text, 12, json.size(), 4, false);
  text += json + rest;
}

void FileMutator::MutateLines(std::string& text, const std::vector<std::string>& dictionary)
{
  std::vector<std::size_t> lines{ 0 };
  for (std::size_t i = 0; i < text.size(); ++i)
    if (text[i] == '\n')
      lines.push_back(i + 1);
  const auto line = [&](std::size_t i) { return text.substr(lines[i], text.find('\n', lines[i]) - lines[i]) + "\n"; };
  const std::size_t a = this->Below(lines.size()), b = this->Below(lines.size());
  switch (this->Below(6))
  {
    case 0:
      text.erase(lines[a], line(a).size());
      break;
    case 1:
      text.insert(lines[b], line(a));
      break;
    case 2: // many times
    {
      const std::string one = line(a);
      std::string many;
      for (std::size_t i = this->Below(this->Below(20) ? 5 : 3000); i > 0; --i)
        many += one;
      text.insert(lines[b], many);
      break;
    }
    case 3: // one long line
    {
      std::string many;
      for (std::size_t i = this->Below(this->Below(20) ? 20 : 5000); i > 0; --i)
        many += " " + std::to_string(this->Below(30));
      text.insert(std::min(text.size(), lines[a] + line(a).size() - 1), many);
      break;
    }
    case 4:
      text.insert(lines[a], dictionary[this->Below(dictionary.size())]);
      break;
    default:
    {
      const std::size_t digit = text.find_first_of("0123456789", lines[a]);
      if (digit != std::string::npos)
        text.replace(digit, 1 + this->Below(4), std::to_string(std::int64_t(this->Number())));
      break;
    }
  }
}

FuzzCase FileMutator::Make(std::uint64_t n)
{
  this->Random.Begin(n);
  FuzzCase document = this->Seeds[this->Below(this->Seeds.size())];
  std::string& text = document.Text;
  const std::string kind = ExtensionOf(document.Name);
  const bool exr = kind == ".exr", gltf = kind == ".gltf" || kind == ".json", glb = kind == ".glb",
             obj = kind == ".obj";
  static const std::set<std::string> images{ ".exr", ".png", ".jpg", ".hdr", ".ppm", ".pfm", ".webp", ".tga", ".bmp" };
  const bool state = kind == ".checkpoint", colour = !exr && !gltf && !glb && !obj && !state && !images.count(kind);
  const bool plain = kind == ".tga" || kind == ".bmp"; // a head of fixed fields
  // One change finds what many would hide.
  for (std::size_t edits = 1 + this->Below(this->Below(3) ? 2 : 10); edits > 0 && !text.empty(); --edits)
  {
    // The head of an image says more than its pixels.
    const std::size_t what = this->Below(4);
    if (exr && what < 2)
      this->MutateExr(text);
    else if (gltf && what < 3)
      this->MutateJson(text);
    else if (glb)
      this->MutateGlb(text);
    else if (obj && what < 3)
      this->MutateLines(text, ObjWords);
    else if (colour && what < 3)
      this->MutateLines(text, ColourWords);
    else if (colour || state)
      this->MutateBytes(text, state ? StateWords : ColourWords, 0);
    else if (plain && what < 2)
    {
      const std::size_t bytes = std::size_t(1) << this->Below(3);
      if (text.size() > bytes)
        PutNumber(text, this->Below(std::min<std::size_t>(text.size() - bytes, 72)), this->Number(), int(bytes), false);
    }
    else if (!gltf && !obj && what == 2)
    {
      std::string head = text.substr(0, 400);
      this->MutateBytes(head, ImageWords, 0);
      text.replace(0, std::min<std::size_t>(400, text.size()), head);
    }
    else
      this->MutateBytes(text, gltf ? JsonKeys : obj ? ObjWords : ImageWords, 0);
  }
  return document;
}
