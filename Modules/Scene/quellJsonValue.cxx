// SPDX-License-Identifier: BSD-3-Clause
#include "quellJsonValue.h"

#include "quellSceneFiles.h"

#include <cmath>
#include <limits>

namespace quell
{
namespace detail
{
static const char* const Reexport = "correct the value or export the file again";

void JsonValue::Fail(const std::string& what, const std::string& remedy) const
{
  detail::Fail(*this->File, this->Place, what, remedy);
}

static std::string Found(const nlohmann::json& json)
{
  return std::string(", found ") + json.type_name();
}

bool JsonValue::Has(const char* key) const
{
  if (!this->Json->is_object())
    this->Fail("expected an object" + Found(*this->Json), Reexport);
  return this->Json->contains(key);
}

JsonValue JsonValue::Get(const char* key) const
{
  const std::string place = this->Place.empty() ? key : this->Place + "." + key;
  if (!this->Has(key))
    detail::Fail(*this->File, place, "this required property is missing", "add it or export the file again");
  return { this->Json->at(key), *this->File, place };
}

std::size_t JsonValue::Size() const
{
  if (!this->Json->is_array())
    this->Fail("expected an array" + Found(*this->Json), Reexport);
  return this->Json->size();
}

JsonValue JsonValue::At(std::size_t i) const
{
  if (i >= this->Size())
    this->Fail("element " + std::to_string(i) + " does not exist", Reexport);
  return { (*this->Json)[i], *this->File, this->Place + "[" + std::to_string(i) + "]" };
}

std::uint64_t JsonValue::Unsigned(std::uint64_t maximum) const
{
  std::uint64_t value = 0;
  bool ok = false;
  if (this->Json->is_number_unsigned())
  {
    value = this->Json->get<std::uint64_t>();
    ok = value <= maximum;
  }
  else if (this->Json->is_number_float()) // some exporters write 3.0
  {
    const double d = this->Json->get<double>();
    ok = d >= 0 && d <= 9007199254740992. && d == std::floor(d) && d <= double(maximum);
    value = ok ? std::uint64_t(d) : 0;
  }
  if (!ok)
    this->Fail("expected a whole number" +
                 (maximum < (std::uint64_t(1) << 53) ? " from 0 to " + std::to_string(maximum) : std::string(" >= 0")) +
                 ", found " + (this->Json->is_number() ? this->Json->dump() : std::string(this->Json->type_name())),
      Reexport);
  return value;
}

std::size_t JsonValue::Index(std::size_t count, const char* what) const
{
  const std::uint64_t i = this->Unsigned();
  if (i >= count)
    this->Fail(
      std::string(what) + " " + std::to_string(i) + " does not exist (the file has " + std::to_string(count) + ")",
      "correct the index or export the file again");
  return std::size_t(i);
}

double JsonValue::Number() const
{
  if (!this->Json->is_number())
    this->Fail("expected a number" + Found(*this->Json), Reexport);
  return this->Json->get<double>(); // JSON has no NaN, and the parser refuses what overflows
}

float JsonValue::Float() const
{
  const double v = this->Number();
  if (std::fabs(v) > double(std::numeric_limits<float>::max()))
    this->Fail("the number does not fit a 32-bit float", Reexport);
  return float(v);
}

bool JsonValue::Bool() const
{
  if (!this->Json->is_boolean())
    this->Fail("expected true or false" + Found(*this->Json), Reexport);
  return this->Json->get<bool>();
}

const std::string& JsonValue::String() const
{
  if (!this->Json->is_string())
    this->Fail("expected a string" + Found(*this->Json), Reexport);
  return this->Json->get_ref<const std::string&>();
}

std::vector<double> JsonValue::Numbers(std::size_t count) const
{
  if (this->Size() != count)
    this->Fail("expected " + std::to_string(count) + " numbers, found " + std::to_string(this->Size()), Reexport);
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i)
    values.push_back(this->At(i).Number());
  return values;
}

double JsonValue::NumberOr(const char* key, double otherwise) const
{
  return this->Has(key) ? this->Get(key).Number() : otherwise;
}

float JsonValue::FloatOr(const char* key, float otherwise) const
{
  return this->Has(key) ? this->Get(key).Float() : otherwise;
}

bool JsonValue::BoolOr(const char* key, bool otherwise) const
{
  return this->Has(key) ? this->Get(key).Bool() : otherwise;
}

std::string JsonValue::StringOr(const char* key, const char* otherwise) const
{
  return this->Has(key) ? this->Get(key).String() : otherwise;
}

std::uint64_t JsonValue::UnsignedOr(const char* key, std::uint64_t otherwise) const
{
  return this->Has(key) ? this->Get(key).Unsigned() : otherwise;
}

bool JsonValue::HasExtension(const char* name) const
{
  return this->Has("extensions") && this->Get("extensions").Has(name);
}
}
}
