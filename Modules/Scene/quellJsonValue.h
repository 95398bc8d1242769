// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellJsonValue_h
#define quellJsonValue_h

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace quell
{
namespace detail
{
/// A JSON value that knows where it stands ("meshes[2].primitives[0].indices"), so that every mistake can be reported
/// with its place. Reading a value of another type or range throws SceneError; nothing is converted silently.
class JsonValue
{
public:
  JsonValue(const nlohmann::json& json, const std::string& file, std::string place)
    : Json(&json)
    , File(&file)
    , Place(std::move(place))
  {
  }

  const std::string& Where() const { return this->Place; }
  [[noreturn]] void Fail(const std::string& what, const std::string& remedy) const;

  bool Has(const char* key) const;      ///< also checks that this is an object
  JsonValue Get(const char* key) const; ///< required member
  std::size_t Size() const;             ///< of an array
  JsonValue At(std::size_t i) const;    ///< element of an array
  bool IsObject() const { return this->Json->is_object(); }
  bool IsArray() const { return this->Json->is_array(); }
  bool IsString() const { return this->Json->is_string(); }

  std::uint64_t Unsigned(std::uint64_t maximum = (std::uint64_t(1) << 53)) const;
  /// An index into a list of `count` things called `what` ("accessor").
  std::size_t Index(std::size_t count, const char* what) const;
  double Number() const; ///< finite
  float Float() const;   ///< finite as float
  bool Bool() const;
  const std::string& String() const;
  std::vector<double> Numbers(std::size_t count) const;

  double NumberOr(const char* key, double otherwise) const;
  float FloatOr(const char* key, float otherwise) const;
  bool BoolOr(const char* key, bool otherwise) const;
  std::string StringOr(const char* key, const char* otherwise) const;
  std::uint64_t UnsignedOr(const char* key, std::uint64_t otherwise) const;

  /// The member array `key` of the document, or an empty one.
  std::size_t CountOf(const char* key) const { return this->Has(key) ? this->Get(key).Size() : 0; }
  /// Object "extensions" has member `name`.
  bool HasExtension(const char* name) const;
  JsonValue Extension(const char* name) const { return this->Get("extensions").Get(name); }

private:
  const nlohmann::json* Json;
  const std::string* File;
  std::string Place;
};
}
}

#endif
