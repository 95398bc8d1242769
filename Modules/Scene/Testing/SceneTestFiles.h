// SPDX-License-Identifier: BSD-3-Clause
#ifndef SceneTestFiles_h
#define SceneTestFiles_h

#include "quellScene.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <unistd.h>
#include <vector>

namespace scenetest
{
using Json = nlohmann::json;

/// A name in the temporary directory that no other test process uses.
inline std::string TempName(const std::string& suffix)
{
  static int counter = 0;
  return testing::TempDir() + "quellScene" + std::to_string(getpid()) + "_" + std::to_string(counter++) + suffix;
}

inline std::string WriteFile(const std::string& name, const std::string& content)
{
  std::ofstream(name, std::ios::binary) << content;
  return name;
}

/// Loads and deletes; the message of the SceneError, or "" where none was thrown.
inline std::string ErrorOf(const std::string& file)
{
  std::string what;
  try
  {
    quell::LoadScene(file);
  }
  catch (const quell::SceneError& e)
  {
    what = e.what();
  }
  std::remove(file.c_str());
  return what;
}

inline std::shared_ptr<const quell::Scene> LoadOnce(const std::string& file)
{
  auto scene = quell::LoadScene(file);
  std::remove(file.c_str());
  return scene;
}

/// "file: place: what; remedy", each of which must be there.
inline void ExpectError(const std::string& error, const std::string& file, const std::string& place,
  const std::string& what, const std::string& remedy)
{
  EXPECT_EQ(error.compare(0, file.size() + 2, file + ": "), 0) << error;
  EXPECT_NE(error.find(": " + place + ": "), std::string::npos) << error;
  EXPECT_NE(error.find(what), std::string::npos) << error;
  EXPECT_NE(error.find("; "), std::string::npos) << error;
  EXPECT_NE(error.find(remedy), std::string::npos) << error;
}

inline bool HasWarning(const quell::Scene& scene, const std::string& part)
{
  for (const std::string& w : scene.Warnings)
    if (w.find(part) != std::string::npos && w.compare(0, scene.File.size(), scene.File) == 0)
      return true;
  return false;
}

inline std::string Base64(const std::vector<std::uint8_t>& in)
{
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < in.size(); i += 3)
  {
    const std::uint32_t b =
      in[i] << 16 | (i + 1 < in.size() ? in[i + 1] << 8 : 0) | (i + 2 < in.size() ? in[i + 2] : 0);
    for (int k = 0; k < 4; ++k)
      out += i + std::size_t(k) <= in.size() ? digits[(b >> (18 - 6 * k)) & 63] : '=';
  }
  return out;
}

/// Makes small glTF documents: one node with one mesh of one triangle, to be changed by the test.
struct Gltf
{
  Json Doc = { { "asset", { { "version", "2.0" } } }, { "scene", 0 }, { "scenes", { { { "nodes", { 0 } } } } },
    { "nodes", { { { "mesh", 0 } } } }, { "meshes", { { { "primitives", Json::array() } } } },
    { "accessors", Json::array() }, { "bufferViews", Json::array() } };
  std::vector<std::uint8_t> Binary;

  Gltf()
  {
    this->Primitive() = { { "attributes",
      { { "POSITION", this->Floats({ 0, 0, 0, 1, 0, 0, 0, 1, 0 }, "VEC3", 3) } } } };
  }

  Json& Primitive() { return this->Doc["meshes"][0]["primitives"][0]; }
  int View(const void* data, std::size_t size)
  {
    while (this->Binary.size() % 4)
      this->Binary.push_back(0);
    const std::size_t at = this->Binary.size();
    const auto* p = static_cast<const std::uint8_t*>(data);
    this->Binary.insert(this->Binary.end(), p, p + size);
    this->Doc["bufferViews"].push_back({ { "buffer", 0 }, { "byteOffset", at }, { "byteLength", size } });
    return int(this->Doc["bufferViews"].size()) - 1;
  }
  template <class T>
  int Accessor(const std::vector<T>& values, int componentType, const char* type, int components)
  {
    this->Doc["accessors"].push_back({ { "bufferView", this->View(values.data(), values.size() * sizeof(T)) },
      { "componentType", componentType }, { "type", type }, { "count", values.size() / std::size_t(components) } });
    return int(this->Doc["accessors"].size()) - 1;
  }
  int Floats(const std::vector<float>& v, const char* type, int components)
  {
    return this->Accessor(v, 5126, type, components);
  }
  int Indices(const std::vector<std::uint16_t>& v) { return this->Accessor(v, 5123, "SCALAR", 1); }

  /// Adds an animation of node 0.
  void Animate(const char* path, const char* mode, const std::vector<float>& times, const std::vector<float>& values,
    int components)
  {
    const int in = this->Floats(times, "SCALAR", 1),
              out = this->Floats(values, components == 4 ? "VEC4" : "VEC3", components);
    this->Doc["animations"].push_back(
      { { "samplers", { { { "input", in }, { "output", out }, { "interpolation", mode } } } },
        { "channels", { { { "sampler", 0 }, { "target", { { "node", 0 }, { "path", path } } } } } } });
  }

  std::string WriteGltf()
  {
    if (!this->Doc.contains("buffers"))
      this->Doc["buffers"] = { { { "byteLength", this->Binary.size() },
        { "uri", "data:application/octet-stream;base64," + Base64(this->Binary) } } };
    return WriteFile(TempName(".gltf"), this->Doc.dump());
  }
  std::string GlbBytes()
  {
    if (!this->Doc.contains("buffers"))
      this->Doc["buffers"] = { { { "byteLength", this->Binary.size() } } };
    std::string json = this->Doc.dump();
    json.resize((json.size() + 3) / 4 * 4, ' ');
    std::string bin(this->Binary.begin(), this->Binary.end());
    bin.resize((bin.size() + 3) / 4 * 4, '\0');
    const auto word = [](std::size_t v) {
      return std::string{ char(v & 255), char(v >> 8 & 255), char(v >> 16 & 255), char(v >> 24 & 255) };
    };
    return "glTF" + word(2) + word(12 + 8 + json.size() + 8 + bin.size()) + word(json.size()) + "JSON" + json +
           word(bin.size()) + std::string("BIN\0", 4) + bin;
  }
  std::string WriteGlb() { return WriteFile(TempName(".glb"), this->GlbBytes()); }
};

/// A 2 x 1 RGB PNG: sRGB (255, 0, 0) and (0, 188, 255).
inline std::vector<std::uint8_t> SmallPng()
{
  return { 0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0, 0, 0, 0x0d, 0x49, 0x48, 0x44, 0x52, 0, 0, 0, 2, 0, 0, 0,
    1, 8, 2, 0, 0, 0, 123, 64, 232, 221, 0, 0, 0, 15, 73, 68, 65, 84, 120, 218, 99, 248, 207, 192, 192, 176, 231, 63, 0,
    8, 120, 2, 187, 150, 235, 196, 133, 0, 0, 0, 0, 73, 69, 78, 68, 174, 66, 96, 130 };
}
}

#endif
