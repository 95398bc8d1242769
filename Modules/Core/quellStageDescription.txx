// SPDX-License-Identifier: BSD-3-Clause
// Row makers of quellStageDescription.h. A row is made inside the stage's Describe(), which runs once on a fresh
// object of the class (see QUELL_STAGE_DESCRIPTION in vtkQuellStage.h), so ranges are asked of that object.
#ifndef quellStageDescription_txx
#define quellStageDescription_txx

#include "vtkSmartPointer.h"

namespace quell
{
namespace detail
{
template <class S>
S* As(vtkQuellStage* s)
{
  return static_cast<S*>(s);
}
template <class S>
const S* As(const vtkQuellStage* s)
{
  return static_cast<const S*>(s);
}
/// True on this thread while a prototype is made: its constructor must not ask for the table that is being built.
VTKQUELLCORE_EXPORT bool& BuildingPrototype();
template <class S>
S* Fresh()
{
  static vtkSmartPointer<S> prototype = []
  {
    BuildingPrototype() = true;
    auto made = vtkSmartPointer<S>::New();
    BuildingPrototype() = false;
    return made;
  }();
  return prototype;
}

template <class S>
Property IntRow(const char* n, const char* unit, const char* doc, long long (*get)(const S*),
  void (*set)(S*, long long), double (*lo)(S*), double (*hi)(S*))
{
  Property p;
  p.Name = n;
  p.Unit = unit;
  p.Doc = doc;
  p.Kind = Property::Type::Int;
  p.Minimum = lo(Fresh<S>());
  p.Maximum = hi(Fresh<S>());
  p.DefaultText = std::to_string(get(Fresh<S>()));
  p.GetText = [get](const vtkQuellStage* s) { return std::to_string(get(As<S>(s))); };
  p.SetText = [set, l = p.Minimum, h = p.Maximum, d = p.DefaultText](
                vtkQuellStage* s, const std::string& text, std::string& error)
  {
    long long v = 0;
    if (!ParseInt(text, (long long)l, (long long)h, v, error))
    {
      error += " (default " + d + ")";
      return false;
    }
    set(As<S>(s), v);
    return true;
  };
  return p;
}

template <class S>
Property DoubleRow(const char* n, const char* unit, const char* doc, double (*get)(const S*), void (*set)(S*, double),
  double (*lo)(S*), double (*hi)(S*))
{
  Property p;
  p.Name = n;
  p.Unit = unit;
  p.Doc = doc;
  p.Kind = Property::Type::Double;
  p.Minimum = lo(Fresh<S>());
  p.Maximum = hi(Fresh<S>());
  p.DefaultText = FormatDouble(get(Fresh<S>()));
  p.GetText = [get](const vtkQuellStage* s) { return FormatDouble(get(As<S>(s))); };
  p.SetText = [set, l = p.Minimum, h = p.Maximum, d = p.DefaultText](
                vtkQuellStage* s, const std::string& text, std::string& error)
  {
    double v = 0;
    if (!ParseDouble(text, l, h, v, error))
    {
      error += " (default " + d + ")";
      return false;
    }
    set(As<S>(s), v);
    return true;
  };
  return p;
}

template <class S>
Property BoolRow(const char* n, const char* doc, bool (*get)(const S*), void (*set)(S*, bool))
{
  Property p;
  p.Name = n;
  p.Doc = doc;
  p.Kind = Property::Type::Bool;
  p.Maximum = 1;
  p.DefaultText = get(Fresh<S>()) ? "true" : "false";
  p.GetText = [get](const vtkQuellStage* s) { return std::string(get(As<S>(s)) ? "true" : "false"); };
  p.SetText = [set](vtkQuellStage* s, const std::string& text, std::string& error)
  {
    bool v = false;
    if (!ParseBool(text, v, error))
      return false;
    set(As<S>(s), v);
    return true;
  };
  return p;
}

template <class S>
Property EnumRow(
  const char* n, const char* doc, std::vector<std::string> names, int (*get)(const S*), void (*set)(S*, int))
{
  Property p;
  p.Name = n;
  p.Doc = doc;
  p.Kind = Property::Type::Enum;
  p.Maximum = double(names.size()) - 1;
  p.Enumerators = names;
  p.DefaultText = names.at(get(Fresh<S>()));
  p.GetText = [get, names](const vtkQuellStage* s) { return names.at(get(As<S>(s))); };
  p.SetText = [set, names](vtkQuellStage* s, const std::string& text, std::string& error)
  {
    int v = 0;
    if (!ParseEnum(text, names, v, error))
      return false;
    set(As<S>(s), v);
    return true;
  };
  return p;
}

template <class S>
Property StringRow(
  Property::Type t, const char* n, const char* doc, std::string (*get)(const S*), void (*set)(S*, const std::string&))
{
  Property p;
  p.Name = n;
  p.Doc = doc;
  p.Kind = t;
  p.DefaultText = get(Fresh<S>());
  p.GetText = [get](const vtkQuellStage* s) { return get(As<S>(s)); };
  p.SetText = [set](vtkQuellStage* s, const std::string& text, std::string&)
  {
    set(As<S>(s), text);
    return true;
  };
  return p;
}

template <class S>
Property VectorRow(const char* n, int count, double lo, double hi, const char* unit, const char* doc,
  const double* (*get)(const S*), void (*set)(S*, const double*))
{
  Property p;
  p.Name = n;
  p.Unit = unit;
  p.Doc = doc;
  p.Kind = Property::Type::Vector;
  p.Components = count;
  p.Minimum = lo;
  p.Maximum = hi;
  p.GetText = [get, count](const vtkQuellStage* s)
  {
    const double* v = get(As<S>(s));
    std::string t;
    for (int i = 0; i < count; ++i)
      t += (i ? " " : "") + FormatDouble(v[i]);
    return t;
  };
  p.DefaultText = p.GetText(Fresh<S>());
  p.SetText = [set, count, lo, hi](vtkQuellStage* s, const std::string& text, std::string& error)
  {
    std::vector<double> v(count);
    if (!ParseVector(text, count, lo, hi, v.data(), error))
      return false;
    set(As<S>(s), v.data());
    return true;
  };
  return p;
}
}
}
#endif
