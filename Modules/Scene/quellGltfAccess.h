// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGltfAccess_h
#define quellGltfAccess_h

#include "quellJsonValue.h"
#include "quellSceneFiles.h"

#include <cstdint>
#include <string>
#include <vector>

namespace quell
{
namespace detail
{
/// The JSON text and binary chunk of a .gltf or .glb.
struct GltfContainer
{
  nlohmann::json Document;
  Bytes Binary;
  bool HasBinary = false;
};
GltfContainer OpenGltf(const std::string& file, const Bytes& content);

/// Checked reading of accessors. Buffers are loaded when first used; a range is compared with the bytes that are
/// really there, in arithmetic that cannot overflow (all operands are below 2^53).
class GltfAccess
{
public:
  GltfAccess(const JsonValue& root, const std::string& file, const GltfContainer& container, ContentHash& hash);

  /// Checks every bufferView and accessor of the file, used or not.
  void CheckAll();

  /// Elements of accessor `index` as floats, normalized integers mapped to [0, 1] or [-1, 1]. `types` lists the
  /// allowed ones ("VEC3" or "VEC3 VEC4"). `where` is who asks. Integers are normalized in any case with `force`.
  struct Array
  {
    std::size_t Count = 0;
    int Components = 0;
    std::vector<float> Values;
  };
  Array Floats(const JsonValue& index, const char* types, bool force = false);
  /// A SCALAR or VEC4 of unsigned integers.
  std::vector<std::uint32_t> Integers(const JsonValue& index, const char* types);
  /// True where the accessor has data of its own (a bufferView or sparse values).
  bool HasData(const JsonValue& index) const;
  /// The bytes of a bufferView, for images.
  Bytes View(const JsonValue& index);

private:
  struct Range
  {
    const std::uint8_t* Data = nullptr;
    std::uint64_t Size = 0, Stride = 0;
  };
  struct Element
  {
    int ComponentType = 0, Components = 0;
    bool Normalized = false;
    std::uint64_t Count = 0, Size = 0;
  };
  const Bytes& Buffer(std::size_t index, const JsonValue& who);
  JsonValue ViewAt(const JsonValue& index) const;
  Range BufferView(const JsonValue& view);
  Range Slice(const JsonValue& owner, std::uint64_t count, std::uint64_t size, bool strided);
  JsonValue Accessor(const JsonValue& index) const;
  Element Describe(const JsonValue& accessor, const char* types) const;
  template <class T, class Convert>
  void Read(const JsonValue& accessor, const Element& element, std::vector<T>& out, Convert convert);

  JsonValue Root;
  const std::string& File;
  const GltfContainer& Container;
  ContentHash& Hash;
  std::vector<Bytes> Buffers;
  std::vector<char> Loaded;
};
}
}

#endif
