// SPDX-License-Identifier: BSD-3-Clause
#include "quellStageDescription.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace quell
{
const std::vector<ArrayType>& KnownArrays()
{
  static const float inf = std::numeric_limits<float>::infinity();
  static const std::vector<ArrayType> table = {
    { "radiance", ArrayKind::Color, 3, 0, "linear HDR radiance, the sum of the layers below" },
    { "emission", ArrayKind::Color, 3, 0, "light seen directly and through perfect mirrors or glass; never filtered" },
    { "direct", ArrayKind::Color, 3, 0, "light after one scattering" },
    { "indirect", ArrayKind::Color, 3, 0, "light after two or more scatterings" },
    { "directDiffuse", ArrayKind::Color, 3, 0, "diffuse part of direct" },
    { "directSpecular", ArrayKind::Color, 3, 0, "specular part of direct" },
    { "indirectDiffuse", ArrayKind::Color, 3, 0, "diffuse part of indirect" },
    { "indirectSpecular", ArrayKind::Color, 3, 0, "specular part of indirect" },
    { "illumination", ArrayKind::Color, 3, 0, "a layer divided by its albedo" },
    { "residual", ArrayKind::Color, 3, 0, "what a stage took out or could not explain; signed" },
    { "feedback", ArrayKind::Color, 3, 0, "what the next frame should read as history" },
    { "albedo", ArrayKind::Albedo, 3, 1, "reflectance at the first non-delta hit" },
    { "albedoDiffuse", ArrayKind::Albedo, 3, 1, "reflectance of the diffuse lobe" },
    { "albedoSpecular", ArrayKind::Albedo, 3, 1, "reflectance of the specular lobe" },
    { "normal", ArrayKind::Normal, 3, 0, "shading normal of the first non-delta hit" },
    { "normalGeometric", ArrayKind::Normal, 3, 0, "geometric normal of the primary hit" },
    { "depth", ArrayKind::Depth, 1, inf, "distance along the view axis of the primary hit, scene units" },
    { "position", ArrayKind::Position, 3, 0, "world position of the primary hit, relative to the recentred origin" },
    { "motion", ArrayKind::Motion, 2, 0, "pixels from this frame to where the primary hit was in the previous one" },
    { "id", ArrayKind::Id, 1, 0, "object of the primary hit, 1 ..." },
    { "material", ArrayKind::Id, 1, 0, "material of the primary hit, 1 ..." },
    { "roughness", ArrayKind::Scalar, 1, 0, "roughness at the albedo's vertex" },
    { "hitDistance", ArrayKind::Scalar, 1, inf, "length of the first indirect segment" },
    { "variance", ArrayKind::Variance, 1, 0, "variance of the pixel's mean luminance" },
    { "varianceAlbedo", ArrayKind::Variance, 1, 0, "variance of the pixel's mean albedo" },
    { "varianceNormal", ArrayKind::Variance, 1, 0, "variance of the pixel's mean normal" },
    { "halfA", ArrayKind::Color, 3, 0, "mean of the even samples' radiance" },
    { "halfB", ArrayKind::Color, 3, 0, "mean of the odd samples' radiance" },
    { "moments", ArrayKind::Moments, 2, 0, "mean and central second moment of luminance" },
    { "meanRest", ArrayKind::Scalar, 1, 0, "what the mean in `moments` has beyond a float" },
    { "history", ArrayKind::History, 1, 0, "frames of history" },
    { "samples", ArrayKind::Scalar, 1, 0, "samples spent" },
    { "alpha", ArrayKind::Scalar, 1, 0, "coverage" },
    { "mask", ArrayKind::Scalar, 1, 0, "reasons (disocclusion, clamp, non-finite) as small integers" },
    { "error", ArrayKind::Scalar, 1, 0, "per-pixel error" },
    { "display", ArrayKind::Display, 3, 0, "encoded for a display" },
  };
  return table;
}

const ArrayType* FindArray(const std::string& name)
{
  for (const ArrayType& type : KnownArrays())
    if (name == type.Name)
      return &type;
  return nullptr;
}

namespace
{
struct KindRow
{
  ArrayKind Kind;
  const char* Name;
  const char* Doc;
  int Components;
};
const KindRow kindRows[] = {
  { ArrayKind::Color, "color", "3 x float, linear RGB", 3 },
  { ArrayKind::Albedo, "albedo", "3 x float in [0, 1]", 3 },
  { ArrayKind::Normal, "normal", "3 x float, unit, world", 3 },
  { ArrayKind::Position, "position", "3 x float, scene units", 3 },
  { ArrayKind::Depth, "depth", "1 x float along the view axis", 1 },
  { ArrayKind::Motion, "motion", "2 x float, pixels", 2 },
  { ArrayKind::Id, "id", "1 x float, exact integers", 1 },
  { ArrayKind::Scalar, "scalar", "1 x float", 1 },
  { ArrayKind::Variance, "variance", "1 x float, variance", 1 },
  { ArrayKind::Moments, "moments", "2 x float, mean and central second moment", 2 },
  { ArrayKind::History, "history", "1 x float, frames", 1 },
  { ArrayKind::Display, "display", "3 x float in [0, 1], encoded", 3 },
  { ArrayKind::Any, "any", "any number of floats", 0 },
};
const KindRow& Row(ArrayKind kind)
{
  for (const KindRow& row : kindRows)
    if (row.Kind == kind)
      return row;
  return kindRows[sizeof(kindRows) / sizeof(kindRows[0]) - 1];
}
}

const char* KindName(ArrayKind kind)
{
  return Row(kind).Name;
}
const char* KindDoc(ArrayKind kind)
{
  return Row(kind).Doc;
}
int KindComponents(ArrayKind kind)
{
  return Row(kind).Components;
}

const char* Property::TypeName() const
{
  switch (this->Kind)
  {
    case Type::Int:
      return "int";
    case Type::Double:
      return "double";
    case Type::Bool:
      return "bool";
    case Type::Enum:
      return "enum";
    case Type::String:
      return "string";
    case Type::Path:
      return "path";
    case Type::Vector:
      return "vector";
  }
  return "string";
}

int StageDescription::InputIndex(const std::string& name) const
{
  for (size_t i = 0; i < this->Inputs.size(); ++i)
    if (this->Inputs[i].Name == name)
      return int(i);
  return -1;
}
const OutputArray* StageDescription::FindOutput(const std::string& name) const
{
  for (const OutputArray& o : this->Outputs)
    if (o.Name == name)
      return &o;
  return nullptr;
}
const Property* StageDescription::FindProperty(const std::string& name) const
{
  for (const Property& p : this->Properties)
    if (p.Name == name)
      return &p;
  return nullptr;
}

StageDescription& StageDescription::Input(const char* name, ArrayKind kind, const char* array, const char* doc)
{
  InputPort p;
  p.Name = name;
  p.Kind = kind;
  p.Array = array;
  p.Doc = doc;
  this->Inputs.push_back(p);
  return *this;
}
StageDescription& StageDescription::OptionalInput(const char* name, ArrayKind kind, const char* array, const char* doc)
{
  this->Input(name, kind, array, doc);
  this->Inputs.back().Optional = true;
  return *this;
}
StageDescription& StageDescription::DelayedInput(const char* name, ArrayKind kind, const char* array, const char* doc)
{
  this->OptionalInput(name, kind, array, doc);
  this->Inputs.back().Delayed = true;
  return *this;
}
StageDescription& StageDescription::RepeatableInput(
  const char* name, ArrayKind kind, const char* array, const char* doc)
{
  this->Input(name, kind, array, doc);
  this->Inputs.back().Repeatable = true;
  return *this;
}
StageDescription& StageDescription::Attribute(const char* name, const char* doc, std::vector<std::string> values)
{
  this->Inputs.back().Attributes.push_back({ name, doc, std::move(values) });
  return *this;
}
StageDescription& StageDescription::Output(const char* name, ArrayKind kind, const char* doc, int components)
{
  OutputArray o;
  o.Name = name;
  o.Kind = kind;
  o.Components = components ? components : KindComponents(kind);
  o.Doc = doc;
  this->Outputs.push_back(o);
  return *this;
}

StageDescription& StageDescription::Mean(std::vector<std::string> ports)
{
  OutputBound b;
  b.Kind = OutputBound::Law::Mean;
  b.Of = std::move(ports);
  this->Outputs.back().Bounds.push_back(b);
  return *this;
}
StageDescription& StageDescription::KeepsConstants(std::vector<std::string> ports, const char* reason)
{
  this->Mean(std::move(ports));
  this->Outputs.back().Bounds.back().Kind = OutputBound::Law::Constant;
  this->Outputs.back().Bounds.back().Reason = reason;
  return *this;
}
StageDescription& StageDescription::Part(const char* port)
{
  OutputBound b;
  b.Kind = OutputBound::Law::Part;
  b.Of = { port };
  this->Outputs.back().Bounds.push_back(b);
  return *this;
}
StageDescription& StageDescription::Total(std::vector<std::string> ports)
{
  this->Mean(std::move(ports));
  this->Outputs.back().Bounds.back().Kind = OutputBound::Law::Total;
  return *this;
}
StageDescription& StageDescription::AtMost(double factor, std::vector<std::string> ports)
{
  OutputBound b;
  b.Kind = OutputBound::Law::AtMost;
  b.Factor = factor;
  b.Of = std::move(ports);
  this->Outputs.back().Bounds.push_back(b);
  return *this;
}
StageDescription& StageDescription::Within(double low, double high)
{
  OutputBound b;
  b.Kind = OutputBound::Law::Within;
  b.Low = low;
  b.High = high;
  this->Outputs.back().Bounds.push_back(b);
  return *this;
}
StageDescription& StageDescription::Finite(const char* reason)
{
  OutputBound b;
  b.Reason = reason;
  this->Outputs.back().Bounds.push_back(b);
  return *this;
}
StageDescription& StageDescription::Anything(const char* reason)
{
  OutputBound b;
  b.Kind = OutputBound::Law::Anything;
  b.Reason = reason;
  this->Outputs.back().Bounds.push_back(b);
  return *this;
}
StageDescription& StageDescription::OrZero()
{
  this->Outputs.back().Bounds.back().OrZero = true;
  return *this;
}
StageDescription& StageDescription::DividedBy(const char* property)
{
  this->Outputs.back().Bounds.back().Divisor = property;
  return *this;
}
StageDescription& StageDescription::Limited(double least, double largest)
{
  this->Outputs.back().Bounds.back().LeastIn = least;
  this->Outputs.back().Bounds.back().LargestIn = largest;
  return *this;
}
StageDescription& StageDescription::Except(const char* property, const char* value)
{
  this->Outputs.back().Bounds.back().Except.emplace_back(property, value);
  return *this;
}
StageDescription& StageDescription::Uncounted(const char* reason)
{
  this->Inputs.back().Uncounted = reason;
  return *this;
}

std::string OutputBound::Text() const
{
  std::string ports;
  for (const std::string& port : this->Of)
    ports += (ports.empty() ? "`" : this->Of.back() == port ? " and `" : ", `") + port + "`";
  std::string text;
  switch (this->Kind)
  {
    case Law::Mean:
      text =
        "between the least and the largest of " + ports + (this->OrZero ? ", or 0" : "") +
        (this->LargestIn < 3.5e38 || this->LeastIn > -3.5e38 ? ", limited to [" + detail::FormatDouble(this->LeastIn) +
                                                                 ", " + detail::FormatDouble(this->LargestIn) + "]"
                                                             : "");
      break;
    case Law::Constant:
      text = "constants stay";
      break;
    case Law::Part:
      text = "a part of " + ports;
      break;
    case Law::Total:
      text = "over the frame as much as " + ports + (this->Of.size() > 1 ? " together" : "");
      break;
    case Law::AtMost:
      text = "at most " + (this->Factor == 1 ? std::string() : detail::FormatDouble(this->Factor) + " times ") +
             (this->Of.size() > 1 ? "the largest of " : "the largest ") + ports +
             (this->Of.size() > 1 ? " together" : "") + (this->Divisor.empty() ? std::string() : " / " + this->Divisor);
      break;
    case Law::Within:
      text = "in [" + detail::FormatDouble(this->Low) + ", " + detail::FormatDouble(this->High) + "]";
      break;
    default:
      return text;
  }
  for (const auto& e : this->Except)
    text += ", not with " + e.first + " " + e.second;
  return text;
}

std::string NearestName(const std::string& name, const std::vector<std::string>& names)
{
  const auto lower = [](std::string s)
  {
    for (char& c : s)
      c = (c >= 'A' && c <= 'Z') ? char(c - 'A' + 'a') : c;
    return s;
  };
  // The distance costs the product of the lengths; no name of ours comes near this one.
  if (name.size() > 128)
    return {};
  const std::string a = lower(name);
  std::string best;
  size_t bestDistance = std::max<size_t>(2, name.size() / 3) + 1;
  for (const std::string& candidate : names)
  {
    const std::string b = lower(candidate);
    std::vector<size_t> row(b.size() + 1);
    for (size_t j = 0; j <= b.size(); ++j)
      row[j] = j;
    for (size_t i = 1; i <= a.size(); ++i)
    {
      size_t diagonal = row[0];
      row[0] = i;
      for (size_t j = 1; j <= b.size(); ++j)
      {
        const size_t above = row[j];
        row[j] = std::min({ row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1]) });
        diagonal = above;
      }
    }
    if (row[b.size()] < bestDistance)
    {
      bestDistance = row[b.size()];
      best = candidate;
    }
  }
  return best;
}

namespace detail
{
bool& BuildingPrototype()
{
  static thread_local bool flag = false;
  return flag;
}

namespace
{
std::string Trimmed(const std::string& s)
{
  const char* blanks = " \t\r\n";
  const size_t a = s.find_first_not_of(blanks);
  return a == std::string::npos ? std::string() : s.substr(a, s.find_last_not_of(blanks) - a + 1);
}
template <class T>
bool FromChars(const std::string& text, T& out, bool& tooLarge)
{
  const std::string t = Trimmed(text);
  const char* first = t.data();
  if (t.size() > 1 && t[0] == '+' && t[1] != '-')
    ++first;
  const auto r = std::from_chars(first, t.data() + t.size(), out);
  // A number that the type cannot hold is a number all the same: tell it apart from a word.
  tooLarge = r.ec == std::errc::result_out_of_range && r.ptr == t.data() + t.size();
  return !t.empty() && r.ec == std::errc() && r.ptr == t.data() + t.size();
}
/// A value as messages quote it: control characters as \xNN, the end of a long one cut.
std::string Shown(const std::string& text)
{
  std::string out = "\"";
  for (unsigned char c : text)
  {
    if (out.size() > 100 && (c & 0xC0) != 0x80) // never inside a UTF-8 sequence
    {
      out += "...";
      break;
    }
    if (c >= 0x20 && c != 0x7F)
    {
      out += char(c);
      continue;
    }
    const char* hex = "0123456789ABCDEF";
    out += std::string("\\x") + hex[c >> 4] + hex[c & 15];
  }
  return out + "\"";
}
}

std::string FormatDouble(double v)
{
  char buffer[64];
  const auto r = std::to_chars(buffer, buffer + sizeof buffer, v);
  return std::string(buffer, r.ptr);
}

bool ParseInt(const std::string& text, long long lo, long long hi, long long& out, std::string& error)
{
  long long v = 0;
  bool tooLarge = false;
  if (!FromChars(text, v, tooLarge) && !tooLarge)
  {
    error = Shown(text) + " is not a whole number";
    return false;
  }
  if (tooLarge || v < lo || v > hi)
  {
    error =
      (tooLarge ? Shown(text) : Trimmed(text)) + " is outside [" + std::to_string(lo) + ", " + std::to_string(hi) + "]";
    return false;
  }
  out = v;
  return true;
}

bool ParseDouble(const std::string& text, double lo, double hi, double& out, std::string& error)
{
  double v = 0;
  bool tooLarge = false;
  if (!FromChars(text, v, tooLarge))
  {
    error =
      Shown(text) + (tooLarge ? " is too large or too small for a number in double precision" : " is not a number");
    return false;
  }
  if (!std::isfinite(v))
  {
    error = Shown(text) + " is not finite";
    return false;
  }
  if (v < lo || v > hi)
  {
    error = Trimmed(text) + " is outside [" + FormatDouble(lo) + ", " + FormatDouble(hi) + "]";
    return false;
  }
  out = v;
  return true;
}

bool ParseBool(const std::string& text, bool& out, std::string& error)
{
  const std::string t = Trimmed(text);
  if (t == "true" || t == "1")
    out = true;
  else if (t == "false" || t == "0")
    out = false;
  else
  {
    error = Shown(text) + " is neither true nor false";
    return false;
  }
  return true;
}

bool ParseEnum(const std::string& text, const std::vector<std::string>& names, int& out, std::string& error)
{
  const std::string t = Trimmed(text);
  for (size_t i = 0; i < names.size(); ++i)
    if (names[i] == t)
    {
      out = int(i);
      return true;
    }
  error = Shown(text) + " is none of ";
  for (size_t i = 0; i < names.size(); ++i)
    error += (i ? ", " : "") + names[i];
  const std::string near = NearestName(t, names);
  if (!near.empty())
    error += "; did you mean \"" + near + "\"?";
  return false;
}

bool ParseVector(const std::string& text, int n, double lo, double hi, double* out, std::string& error)
{
  std::vector<double> values;
  values.reserve(size_t(n) + 1);
  size_t at = 0, count = 0;
  while ((at = text.find_first_not_of(" \t\r\n", at)) != std::string::npos)
  {
    size_t end = text.find_first_of(" \t\r\n", at);
    if (end == std::string::npos)
      end = text.size();
    double v = 0;
    if (!ParseDouble(text.substr(at, end - at), lo, hi, v, error))
      return false;
    if (count++ < size_t(n))
      values.push_back(v);
    at = end;
  }
  if (count != size_t(n))
  {
    error = Shown(text) + " has " + std::to_string(count) + " numbers where " + std::to_string(n) + " are wanted";
    return false;
  }
  std::copy(values.begin(), values.end(), out);
  return true;
}
}
}
