// SPDX-License-Identifier: BSD-3-Clause
#include "quellFuzzFiles.h"
#include "quellFuzzTools.h"
#include "quellImageFile.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <OpenImageIO/imageio.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <stdexcept>

using namespace quell;
using Json = nlohmann::json;
namespace fs = std::filesystem;

namespace
{
/// Smooth and a little noisy, so that every codec has something to do.
float Pixel(int x, int y, int c)
{
  const std::uint32_t h =
    (std::uint32_t(x) * 73856093u ^ std::uint32_t(y) * 19349663u ^ std::uint32_t(c) * 83492791u) * 2654435761u;
  return 0.3f + 0.2f * std::sin(0.3f * float(x + 2 * c)) + 0.2f * std::cos(0.2f * float(y)) + float(h >> 24) / 2560.f;
}

void AddArray(vtkImageData* image, const char* name, int components)
{
  vtkNew<vtkFloatArray> array;
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(image->GetNumberOfPoints());
  int e[6];
  image->GetExtent(e);
  float* v = array->GetPointer(0);
  for (int y = e[2]; y <= e[3]; ++y)
    for (int x = e[0]; x <= e[1]; ++x)
      for (int c = 0; c < components; ++c)
        *v++ = Pixel(x, y, c);
  image->GetPointData()->AddArray(array);
}

/// Straight through the library, for what our writer does not make.
void WriteWith(const fs::path& file, int width, int height, std::vector<std::string> channels, OIIO::TypeDesc type,
  int tile, const char* compression)
{
  OIIO::ImageSpec spec(width, height, int(channels.size()), type);
  spec.channelnames = std::move(channels);
  spec.tile_width = spec.tile_height = tile;
  if (*compression)
    spec.attribute("compression", compression);
  auto out = OIIO::ImageOutput::create(file.string());
  if (!out || !out->open(file.string(), spec))
  {
    OIIO::geterror();
    return; // a library without this format has no reader of it either
  }
  std::vector<float> pixels(std::size_t(width) * std::size_t(height) * std::size_t(spec.nchannels));
  for (std::size_t i = 0; i < pixels.size(); ++i)
    pixels[i] = Pixel(int(i) % width, int(i) / width, 0);
  if (!out->write_image(OIIO::TypeFloat, pixels.data()) || !out->close())
    throw std::runtime_error("cannot write " + file.string() + ": " + out->geterror());
}

/// The library writes when an OpenEXR file was made. Documents are functions of the seed alone: all at one time.
void SetDate(const fs::path& file)
{
  std::string bytes = Contents(file);
  const std::string name("capDate\0string\0", 15), date = "2000:01:01 00:00:00";
  const std::size_t at = bytes.find(name);
  if (at == std::string::npos) // not every version of the library does
    return;
  bytes.replace(at + name.size() + 4, date.size(), date); // after the string's size
  Save(file, bytes);
}

void WriteImages(const fs::path& directory)
{
  vtkNew<vtkImageData> plain;
  plain->SetExtent(0, 23, 0, 15, 0, 0);
  AddArray(plain, "radiance", 3);
  vtkNew<vtkImageData> layers;
  layers->SetExtent(0, 23, 0, 15, 0, 0);
  for (const char* name : { "radiance", "albedo", "normal" })
    AddArray(layers, name, 3);
  AddArray(layers, "depth", 1);
  AddArray(layers, "motion", 2);
  WriteOptions options;
  options.Metadata = { { "pipeline", "<pipeline version=\"1\"/>" }, { "inputs", "0 x" } };
  const char* const names[] = { "none", "rle", "zips", "zip", "piz", "pxr24", "dwaa", "dwab" };
  for (int c = 0; c < 8; ++c)
    for (const bool half : { false, true })
    {
      options.Compression = FileCompression(c);
      options.Half = half;
      WriteImageFile(
        (directory / (std::string("plain-") + names[c] + (half ? "-half" : "") + ".exr")).string(), plain, {}, options);
    }
  options.Compression = FileCompression::Zip;
  options.Half = false;
  WriteImageFile((directory / "layers.exr").string(), layers, {}, options);
  options.Width = 40;
  options.Height = 30;
  options.Region = { 4, 3, 20, 12 };
  WriteImageFile((directory / "window.exr").string(), layers, {}, options);
  WriteWith(directory / "tiled.exr", 40, 24, { "R", "G", "B", "A" }, OIIO::TypeHalf, 16, "zip");
  WriteWith(directory / "tiled-piz.exr", 40, 24, { "Y", "Z" }, OIIO::TypeFloat, 8, "piz");
  WriteWith(directory / "ids.exr", 16, 16, { "id", "R" }, OIIO::TypeUInt32, 0, "zips");
  for (const char* name : { "plain.png", "plain.jpg", "plain.hdr" })
    WriteImageFile((directory / name).string(), plain);
  WriteWith(directory / "deep.png", 20, 12, { "R", "G", "B", "A" }, OIIO::TypeUInt16, 0, "");
  WriteWith(directory / "grey.png", 20, 12, { "Y" }, OIIO::TypeUInt8, 0, "");
  WriteWith(directory / "grey.jpg", 20, 12, { "Y" }, OIIO::TypeUInt8, 0, "");
  WriteWith(directory / "plain.ppm", 20, 12, { "R", "G", "B" }, OIIO::TypeUInt8, 0, "");
  WriteWith(directory / "float.pfm", 20, 12, { "R", "G", "B" }, OIIO::TypeFloat, 0, "");
  WriteWith(directory / "plain.webp", 24, 16, { "R", "G", "B", "A" }, OIIO::TypeUInt8, 0, "");
  for (const fs::path& file : SeedFiles({ directory.string() }, ".exr"))
    SetDate(file);
}

std::string Base64(const std::string& in)
{
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto byte = [&](std::size_t i)
  { return i < in.size() ? std::uint32_t(static_cast<unsigned char>(in[i])) : 0u; };
  std::string out;
  for (std::size_t i = 0; i < in.size(); i += 3)
  {
    const std::uint32_t b = byte(i) << 16 | byte(i + 1) << 8 | byte(i + 2);
    for (std::size_t k = 0; k < 4; ++k)
      out += i + k <= in.size() ? digits[b >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

/// A glTF with its buffer.
struct Model
{
  Json Doc;
  std::string Binary;

  int View(const void* data, std::size_t size)
  {
    this->Binary.resize((this->Binary.size() + 3) / 4 * 4);
    Json& views = this->Doc["bufferViews"];
    views.push_back({ { "buffer", 0 }, { "byteOffset", this->Binary.size() }, { "byteLength", size } });
    this->Binary.append(static_cast<const char*>(data), size);
    return int(views.size()) - 1;
  }
  template <class T>
  int Add(int componentType, const char* type, int components, const std::vector<T>& values, bool normalized = false)
  {
    Json accessor = { { "bufferView", this->View(values.data(), values.size() * sizeof(T)) },
      { "componentType", componentType }, { "type", type }, { "count", values.size() / std::size_t(components) } };
    if (normalized)
      accessor["normalized"] = true;
    this->Doc["accessors"].push_back(accessor);
    return int(this->Doc["accessors"].size()) - 1;
  }
  int Floats(const char* type, int components, const std::vector<float>& values)
  {
    return this->Add(5126, type, components, values);
  }
  std::string Text() const
  {
    Json out = this->Doc;
    out["buffers"] = { { { "byteLength", this->Binary.size() },
      { "uri", "data:application/octet-stream;base64," + Base64(this->Binary) } } };
    return out.dump(1);
  }
  std::string Glb() const
  {
    Json out = this->Doc;
    out["buffers"] = { { { "byteLength", this->Binary.size() } } };
    std::string json = out.dump(), binary = this->Binary;
    json.resize((json.size() + 3) / 4 * 4, ' ');
    binary.resize((binary.size() + 3) / 4 * 4);
    const auto number = [](std::uint32_t v) { return std::string(reinterpret_cast<const char*>(&v), 4); };
    return "glTF" + number(2) + number(std::uint32_t(28 + json.size() + binary.size())) +
           number(std::uint32_t(json.size())) + "JSON" + json + number(std::uint32_t(binary.size())) +
           std::string("BIN\0", 4) + binary;
  }
};

Json Triangle(Model& m)
{
  return { { "POSITION", m.Floats("VEC3", 3, { -1, 0, 0, 1, 0, 0, 1, 2, 0, -1, 2, 0 }) },
    { "NORMAL", m.Floats("VEC3", 3, { 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1 }) },
    { "TEXCOORD_0", m.Floats("VEC2", 2, { 0, 0, 1, 0, 1, 1, 0, 1 }) } };
}

Model Start()
{
  Model m;
  m.Doc = { { "asset", { { "version", "2.0" } } }, { "scene", 0 }, { "scenes", { { { "nodes", { 0 } } } } },
    { "accessors", Json::array() }, { "bufferViews", Json::array() } };
  return m;
}

/// Materials with every extension and textures, cameras, lights, instances, a sky.
Model Gallery(const fs::path& images)
{
  Model m = Start();
  const Json index = m.Add(5123, "SCALAR", 1, std::vector<std::uint16_t>{ 0, 1, 2, 0, 2, 3 });
  Json attributes = Triangle(m);
  attributes["TANGENT"] = m.Floats("VEC4", 4, { 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, -1 });
  attributes["COLOR_0"] = m.Add(5121, "VEC4", 4, std::vector<std::uint8_t>(16, 200), true);
  attributes["TEXCOORD_1"] =
    m.Add(5123, "VEC2", 2, std::vector<std::uint16_t>{ 0, 0, 65535, 0, 65535, 65535, 0, 9 }, true);
  m.Doc["images"] = Json::array();
  for (const char* name : { "plain.png", "grey.png", "plain.jpg" })
  {
    const std::string bytes = Contents(images / name);
    m.Doc["images"].push_back({ { "bufferView", m.View(bytes.data(), bytes.size()) },
      { "mimeType", name[6] == 'j' ? "image/jpeg" : "image/png" } });
  }
  m.Doc["images"].push_back({ { "uri", "data:image/png;base64," + Base64(Contents(images / "deep.png")) } });
  m.Doc["samplers"] = { { { "magFilter", 9728 }, { "minFilter", 9987 }, { "wrapS", 33071 }, { "wrapT", 33648 } } };
  m.Doc["textures"] = { { { "source", 0 }, { "sampler", 0 } }, { { "source", 1 } }, { { "source", 2 } },
    { { "source", 3 }, { "extensions", { { "EXT_texture_webp", { { "source", 0 } } } } } } };
  const auto texture = [](int i) { return Json{ { "index", i } }; };
  Json turned = texture(0);
  turned["texCoord"] = 1;
  turned["extensions"] = { { "KHR_texture_transform",
    { { "offset", { 0.1, 0.2 } }, { "rotation", 0.5 }, { "scale", { 2, 2 } } } } };
  m.Doc["materials"] = {
    { { "name", "all" }, { "doubleSided", true }, { "alphaMode", "MASK" }, { "alphaCutoff", 0.3 },
      { "pbrMetallicRoughness",
        { { "baseColorFactor", { 1, 0.5, 0.2, 1 } }, { "metallicFactor", 0.5 }, { "roughnessFactor", 0.4 },
          { "baseColorTexture", turned }, { "metallicRoughnessTexture", texture(1) } } },
      { "normalTexture", { { "index", 2 }, { "scale", 0.5 } } }, { "occlusionTexture", texture(1) },
      { "emissiveTexture", texture(3) }, { "emissiveFactor", { 1, 1, 1 } },
      { "extensions",
        { { "KHR_materials_emissive_strength", { { "emissiveStrength", 4 } } },
          { "KHR_materials_ior", { { "ior", 1.4 } } },
          { "KHR_materials_specular", { { "specularFactor", 0.8 }, { "specularColorFactor", { 1, 0.9, 0.8 } },
                                        { "specularTexture", texture(0) } } },
          { "KHR_materials_clearcoat", { { "clearcoatFactor", 0.5 }, { "clearcoatRoughnessFactor", 0.1 },
                                         { "clearcoatNormalTexture", texture(2) } } } } } },
    { { "name", "glass" },
      { "extensions",
        { { "KHR_materials_transmission", { { "transmissionFactor", 1 }, { "transmissionTexture", texture(1) } } },
          { "KHR_materials_volume", { { "thicknessFactor", 1 }, { "attenuationDistance", 0.5 },
                                      { "attenuationColor", { 1, 0.5, 0.5 } } } } } } },
    { { "name", "flat" }, { "alphaMode", "BLEND" }, { "extensions", { { "KHR_materials_unlit", Json::object() } } } }
  };
  m.Doc["meshes"] = { { { "name", "quad" },
    { "primitives", { { { "attributes", attributes }, { "indices", index }, { "material", 0 } },
                      { { "attributes", attributes }, { "mode", 5 }, { "material", 1 } },
                      { { "attributes", attributes }, { "mode", 6 }, { "material", 2 } } } } } };
  m.Doc["cameras"] = { { { "type", "perspective" }, { "perspective", { { "yfov", 0.7 }, { "znear", 0.1 } } } },
    { { "type", "orthographic" },
      { "orthographic", { { "xmag", 1 }, { "ymag", 1 }, { "znear", 0.1 }, { "zfar", 9 } } } } };
  m.Doc["extensions"]["KHR_lights_punctual"]["lights"] = { { { "type", "point" }, { "intensity", 10 }, { "range", 5 } },
    { { "type", "spot" }, { "color", { 1, 0.5, 0.2 } },
      { "spot", { { "innerConeAngle", 0.1 }, { "outerConeAngle", 0.4 } } } },
    { { "type", "directional" } } };
  const int places = m.Floats("VEC3", 3, { 0, 0, -1, 1, 0, -1, 2, 0, -2 });
  m.Doc["nodes"] = { { { "children", { 1, 2, 3, 4, 5 } } }, { { "mesh", 0 }, { "rotation", { 0, 0, 0.1, 0.9 } } },
    { { "camera", 0 }, { "translation", { 0, 1, 4 } } }, { { "camera", 1 } },
    { { "mesh", 0 },
      { "extensions", { { "EXT_mesh_gpu_instancing", { { "attributes", { { "TRANSLATION", places } } } } } } } },
    { { "children", { 6, 7 } }, { "matrix", { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 3, 1, 1 } },
      { "extensions", { { "KHR_lights_punctual", { { "light", 0 } } } } } },
    { { "extensions", { { "KHR_lights_punctual", { { "light", 1 } } } } } },
    { { "extensions", { { "KHR_lights_punctual", { { "light", 2 } } } } } } };
  m.Doc["scenes"][0]["extras"] = { { "resolution", { 8, 6 } }, { "max_depth", 3 },
    { "environment", { { "type", "constant" }, { "radiance", { 0.2, 0.3, 0.4 } } } } };
  m.Doc["extensionsUsed"] = { "KHR_lights_punctual", "KHR_texture_transform", "EXT_mesh_gpu_instancing" };
  return m;
}

/// A skin, morph targets, animations of every kind, a sparse accessor.
Model Moving()
{
  Model m = Start();
  Json attributes = Triangle(m);
  attributes["JOINTS_0"] =
    m.Add(5121, "VEC4", 4, std::vector<std::uint8_t>{ 0, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0 });
  attributes["WEIGHTS_0"] = m.Floats("VEC4", 4, { 1, 0, 0, 0, 0.5, 0.5, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0 });
  const int target = m.Floats("VEC3", 3, { 0, 0.5f, 0, 0, 0, 0, 0, 0, 0.5f, 0, 0, 0 });
  const std::vector<std::uint16_t> places{ 1, 3 };
  const std::vector<float> values{ 0, 1, 0, 1, 0, 0 };
  m.Doc["accessors"].push_back({ { "componentType", 5126 }, { "type", "VEC3" }, { "count", 4 },
    { "sparse",
      { { "count", 2 }, { "indices", { { "bufferView", m.View(places.data(), 4) }, { "componentType", 5123 } } },
        { "values", { { "bufferView", m.View(values.data(), 24) } } } } } });
  const int sparse = int(m.Doc["accessors"].size()) - 1;
  const int index = m.Add(5125, "SCALAR", 1, std::vector<std::uint32_t>{ 0, 1, 2, 0, 2, 3 });
  m.Doc["meshes"] = { { { "weights", { 0.25, 0.5 } },
    { "primitives", { { { "attributes", attributes }, { "indices", index },
                      { "targets", { { { "POSITION", target } }, { { "POSITION", sparse } } } } } } } } };
  std::vector<float> bind;
  for (int j = 0; j < 2; ++j)
    for (int k = 0; k < 16; ++k)
      bind.push_back(k % 5 == 0 ? 1.f : 0.f);
  m.Doc["skins"] = { { { "joints", { 1, 2 } }, { "skeleton", 1 },
    { "inverseBindMatrices", m.Floats("MAT4", 16, bind) } } };
  m.Doc["nodes"] = { { { "mesh", 0 }, { "skin", 0 } }, { { "children", { 2 } } }, { { "translation", { 0, 1, 0 } } } };
  m.Doc["scenes"][0]["nodes"] = { 0, 1 };
  const int times = m.Floats("SCALAR", 1, { 0, 0.5, 1 });
  const auto channel = [](int sampler, int node, const char* path) {
    return Json{ { "sampler", sampler }, { "target", { { "node", node }, { "path", path } } } };
  };
  m.Doc["animations"] = { { { "name", "all" },
    { "samplers", { { { "input", times }, { "output", m.Floats("VEC3", 3, { 0, 0, 0, 0, 1, 0, 0, 0, 0 }) } },
                    { { "input", times }, { "interpolation", "STEP" },
                      { "output", m.Floats("VEC4", 4, { 0, 0, 0, 1, 0, 0, 0.7f, 0.7f, 0, 0, 0, 1 }) } },
                    { { "input", times }, { "interpolation", "CUBICSPLINE" },
                      { "output", m.Floats("VEC3", 3, std::vector<float>(27, 1.f)) } },
                    { { "input", times }, { "output", m.Floats("SCALAR", 1, { 0, 0, 1, 0, 0, 1 }) } } } },
    { "channels", { channel(0, 1, "translation"), channel(1, 2, "rotation"), channel(2, 2, "scale"),
                    channel(3, 0, "weights") } } } };
  return m;
}

const char* const Obj = "mtllib model.mtl\no box\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1 0.2 0.3 0.4\nvt 0 0\n"
                        "vt 1 0\nvt 1 1\nvn 0 0 1\ng floor\ns 1\nusemtl red\nf 1/1/1 2/2/1 3/3/1 4/1/1\nusemtl lamp\n"
                        "f -1 -2 -3\ng roof\nusemtl glass\nf 1//1 2//1 5//1\nf 2/1 3/2 5/3\nl 1 2 3\np 4\n";
const char* const Mtl =
  "newmtl red\nKd 0.8 0.1 0.1\nKs 0.04 0.04 0.04\nNs 50\nillum 2\nmap_Kd -s 2 2 1 -o 0.1 0 0 "
  "-clamp on plain.png\nnorm grey.png\nnewmtl lamp\nKd 0 0 0\nKe 5 5 4\nmap_Ke plain.jpg\nnewmtl "
  "glass\nKd 0 0 0\nKs 1 1 1\nNi 1.5\nTf 0.9 1 0.9\nillum 7\nd 0.5\nmap_d grey.png\nPr 0.2\nPm 0.1\n";
}

void WriteFuzzSeeds(const std::string& directory)
{
  const fs::path to(directory);
  fs::create_directories(to);
  WriteImages(to);
  const Model gallery = Gallery(to), moving = Moving();
  Save(to / "gallery.gltf", gallery.Text());
  Save(to / "gallery.glb", gallery.Glb());
  Save(to / "moving.gltf", moving.Text());
  Save(to / "moving.glb", moving.Glb());
  Save(to / "model.obj", std::string(Obj) + FuzzSplit + Mtl);
}

std::vector<FuzzFileBomb> FuzzFileBombs()
{
  std::vector<FuzzFileBomb> bombs;
  const auto json = [&](const char* name, const Model& model, const char* message) {
    bombs.push_back({ name, model.Text(), message });
  };
  const char* const tooLarge = "that a scene may have";
  const auto repeat = [](const std::string& text, std::size_t times)
  {
    std::string out;
    out.reserve(text.size() * times);
    for (std::size_t i = 0; i < times; ++i)
      out += text;
    return out;
  };
  const auto quad = []
  {
    Model m = Start();
    m.Doc["meshes"] = { { { "primitives", { { { "attributes", Triangle(m) } } } } } };
    m.Doc["nodes"] = { { { "mesh", 0 } } };
    return m;
  };
  const auto zeros = [](Model& m, const char* type, std::uint64_t count)
  {
    m.Doc["accessors"].push_back({ { "componentType", 5126 }, { "type", type }, { "count", count } });
    return int(m.Doc["accessors"].size()) - 1;
  };
  {
    Model m = quad();
    const int places = zeros(m, "VEC3", 1 << 24);
    m.Doc["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] = places;
    json("sixteen-million-instances.gltf", m, tooLarge);
  }
  {
    Model m = quad();
    const int all = zeros(m, "VEC3", 1 << 22);
    m.Doc["meshes"][0]["primitives"][0]["attributes"] = { { "POSITION", all } };
    for (int i = 0; i < 3000; ++i)
      m.Doc["meshes"][0]["primitives"][0]["targets"].push_back({ { "POSITION", all } });
    json("morph-targets-of-nothing.gltf", m, tooLarge);
  }
  {
    Model m = quad();
    const Json one = m.Doc["meshes"][0]["primitives"][0];
    for (int i = 0; i < 3000; ++i)
      m.Doc["meshes"][0]["primitives"].push_back(one);
    for (int i = 0; i < 3000; ++i)
    {
      m.Doc["nodes"].push_back({ { "mesh", 0 } });
      m.Doc["scenes"][0]["nodes"].push_back(i + 1);
    }
    json("nodes-times-primitives.gltf", m, tooLarge);
  }
  {
    Model m = quad();
    for (int i = 1; i < 60000; ++i)
    {
      m.Doc["nodes"][std::size_t(i) - 1]["children"] = { i };
      m.Doc["nodes"].push_back({ { "translation", { 0, 0, 0.001 } } });
    }
    json("sixty-thousand-generations.gltf", m, "");
  }
  bombs.push_back({ "brackets.gltf",
    "{\"asset\":{\"version\":\"2.0\"},\"x\":" + repeat("[", 1000000) + repeat("]", 1000000) + "}", "" });
  bombs.push_back({ "open-brackets.gltf", repeat("[", 4000000), "" });
  bombs.push_back(
    { "many-values.gltf", "{\"asset\":{\"version\":\"2.0\"},\"x\":[" + repeat("0,", 20000000) + "0]}", tooLarge });
  {
    Model m = quad();
    std::string png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x3f\xff\0\0\x3f\xff\x08\x06\0\0\0", 29);
    png += repeat(std::string(1, '\0'), 70000);
    m.Doc["images"] = { { { "bufferView", m.View(png.data(), png.size()) } } };
    m.Doc["materials"] = Json::array();
    for (int i = 0; i < 300; ++i)
    {
      m.Doc["textures"].push_back({ { "source", 0 } });
      m.Doc["materials"].push_back({ { "pbrMetallicRoughness", { { "baseColorTexture", { { "index", i } } } } } });
      Json one = m.Doc["meshes"][0]["primitives"][0];
      one["material"] = i;
      m.Doc["meshes"][0]["primitives"].push_back(one);
    }
    json("three-hundred-large-textures.gltf", m, "");
  }
  {
    Model m = quad();
    const int times = zeros(m, "SCALAR", 1 << 22), values = zeros(m, "VEC3", 1 << 22);
    Json channels = Json::array();
    for (int i = 0; i < 200; ++i)
      channels.push_back({ { "sampler", 0 }, { "target", { { "node", 0 }, { "path", "translation" } } } });
    m.Doc["animations"] = { { { "samplers", { { { "input", times }, { "output", values } } } },
      { "channels", channels } } };
    json("animations-of-nothing.gltf", m, tooLarge);
  }
  std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + repeat(" 1 2 3", 100000) + "\n";
  bombs.push_back({ "long-face.obj", obj, "" });
  bombs.push_back({ "many-groups.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + repeat("g a\nf 1 2 3\n", 50000), "" });
  bombs.push_back({ "many-libraries.obj",
    repeat("mtllib model.mtl\n", 20000) + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" + FuzzSplit + "newmtl a\n", "" });
  // Images: sizes that a few bytes declare.
  const auto number = [](std::int32_t v) { return std::string(reinterpret_cast<const char*>(&v), 4); };
  const auto attribute = [&](const char* name, const char* type, const std::string& value)
  { return std::string(name) + '\0' + type + '\0' + number(std::int32_t(value.size())) + value; };
  const auto exr = [&](int width, int height, int channels, const std::string& more, char flags)
  {
    std::string list;
    for (int c = 0; c < channels; ++c)
      list += "c" + std::to_string(c) + std::string("\0\2\0\0\0\0\0\0\0\1\0\0\0\1\0\0\0", 17);
    const std::string box = number(0) + number(0) + number(width - 1) + number(height - 1);
    const float one = 1, none[2] = { 0, 0 };
    return std::string("\x76\x2f\x31\x01\x02", 5) + flags + std::string("\0\0", 2) +
           attribute("channels", "chlist", list + '\0') + attribute("compression", "compression", "\3") +
           attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box) +
           attribute("lineOrder", "lineOrder", std::string(1, '\0')) +
           attribute("pixelAspectRatio", "float", std::string(reinterpret_cast<const char*>(&one), 4)) +
           attribute("screenWindowCenter", "v2f", std::string(reinterpret_cast<const char*>(none), 8)) +
           attribute("screenWindowWidth", "float", std::string(reinterpret_cast<const char*>(&one), 4)) + more + '\0' +
           std::string(64, '\0');
  };
  {
    // Runs of 128 grey pixels in two bytes each.
    const auto targa = [&](int width, int height, std::size_t packets)
    {
      std::string text(18, '\0');
      text[2] = 11, text[16] = 8;
      for (std::size_t i = 0; i < 2; ++i)
        text[12 + i] = char(width >> 8 * i), text[14 + i] = char(height >> 8 * i);
      return text + repeat("\xff\x55", packets);
    };
    bombs.push_back({ "runs-of-nothing.tga", targa(65535, 65535, 1000), "more than" });
    bombs.push_back({ "runs-too-few.tga", targa(16000, 16000, 1000), "the file holds" });
    bombs.push_back({ "runs.tga", targa(16384, 8192, 16384 * 8192 / 128), tooLarge });
    std::string bmp(54, '\0');
    bmp[0] = 'B', bmp[1] = 'M', bmp[10] = 54, bmp[14] = 40, bmp[26] = 1, bmp[28] = 1;
    bmp[20] = 1, bmp[22] = char(0x80), bmp[25] = char(0xff); // 65536 x -16777088
    bombs.push_back({ "deep.bmp", bmp, "more than" });
  }
  bombs.push_back({ "wide.exr", exr(2147483647, 1, 3, "", 0), "!" });
  bombs.push_back({ "tall.exr", exr(1, 2147483647, 3, "", 0), "!" });
  bombs.push_back({ "large.exr", exr(16384, 16384, 3, "", 0), "!" });
  bombs.push_back({ "channels.exr", exr(64, 64, 60000, "", 0), "!" });
  bombs.push_back({ "tiles.exr",
    exr(64, 64, 3, attribute("tiles", "tiledesc", number(2147483647) + number(2147483647) + '\0'), 2), "!" });
  bombs.push_back(
    { "small-tiles.exr", exr(16384, 16384, 1, attribute("tiles", "tiledesc", number(1) + number(1) + '\0'), 2), "!" });
  bombs.push_back({ "large.png",
    std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x08\x06\0\0\0", 29), "more than" });
  bombs.push_back({ "large.jpg",
    std::string("\xff\xd8\xff\xc2\0\x11\x08\xff\xff\xff\xff\x03\1\x22\0\2\x11\1\3\x11\1", 21), "more than" });
  bombs.push_back({ "large.ppm", "P6\n60000 60000\n255\nabc", "more than" });
  bombs.push_back({ "large.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16000 +X 16000\n", "the file holds" });
  bombs.push_back({ "exposures.hdr", "#?RADIANCE\n" + repeat("EXPOSURE=1\n", 200000) + "\n-Y 4 +X 4\n", "" });
  return bombs;
}
