// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellStageDescription_h
#define quellStageDescription_h

#include "vtkQuellCoreModule.h"

#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

class vtkQuellStage;

namespace quell
{
/// Why a stage could not do its work; `what()` is one sentence for the user, without the stage's name.
struct VTKQUELLCORE_EXPORT StageError : std::runtime_error
{
  using std::runtime_error::runtime_error;
};

/// What an array means. Ports accept arrays of their own kind; `Any` accepts every kind.
enum class ArrayKind
{
  Color,    ///< 3 x float, linear RGB, >= 0: radiance, emission, direct, indirect, illumination ...
  Albedo,   ///< 3 x float in [0, 1]
  Normal,   ///< 3 x float, unit, world; 0 where nothing was hit
  Position, ///< 3 x float, scene units
  Depth,    ///< 1 x float along the view axis; +inf where nothing was hit
  Motion,   ///< 2 x float, pixels, previous - current
  Id,       ///< 1 x float, exact integers below 2^24, never averaged
  Scalar,   ///< 1 x float: roughness, hitDistance, alpha, mask
  Variance, ///< 1 x float
  Moments,  ///< 2 x float: mean, central second moment
  History,  ///< 1 x float: frames
  Display,  ///< 3 x float in [0, 1], encoded for a display
  Any
};

/// A name that the project knows, from the table in Documentation/aov.md.
struct ArrayType
{
  const char* Name;
  ArrayKind Kind;
  int Components;
  float Background; ///< where nothing was hit
  const char* Doc;
};
/// All known arrays, in the order of the design's table.
VTKQUELLCORE_EXPORT const std::vector<ArrayType>& KnownArrays();
/// nullptr for a name that is not in the table.
VTKQUELLCORE_EXPORT const ArrayType* FindArray(const std::string& name);
VTKQUELLCORE_EXPORT const char* KindName(ArrayKind kind); ///< "color", "albedo", ...
VTKQUELLCORE_EXPORT const char* KindDoc(ArrayKind kind);  ///< "3 x float, linear RGB, >= 0", ...
VTKQUELLCORE_EXPORT int KindComponents(ArrayKind kind);   ///< 0 for Any

/// An attribute of its own that a connection may have in the file: `<input port="guide" from="..." sigma="0.1"/>`.
struct InputAttribute
{
  std::string Name, Doc;
  std::vector<std::string> Values; ///< all that it may be; empty: free
};

struct InputPort
{
  std::string Name;
  ArrayKind Kind = ArrayKind::Any;
  std::string Array; ///< array read where the connection names none
  std::string Doc;
  bool Optional = false;
  bool Repeatable = false;
  bool Delayed = false;  ///< meant for the previous frame (delay="1"); then it covers the whole frame
  int Halo = -1;         ///< -1: the stage's HaloFor(port) decides
  int Reach = -1;        ///< delayed: how many pixels around x + motion are read
  std::string Uncounted; ///< why its non-finite pixels are not in StageCounters::NonFinite; empty: a live colour's are
  std::vector<InputAttribute> Attributes;
};

/// What the values of an output array keep to, whatever comes in and whatever the properties are. Every type declares
/// it (StageDescription::Mean and so on); Testing/Contract holds it to that at every extreme.
struct VTKQUELLCORE_EXPORT OutputBound
{
  enum class Law
  {
    Finite,   ///< finite; Reason says why nothing more can be said
    Mean,     ///< between the least and the largest finite value of the ports `Of`, channel by channel (where OrZero:
              ///< or 0); what is the same in every pixel stays so to the last bit
    Constant, ///< the latter alone
    Part,     ///< all outputs with this law add up to the first of `Of` in every bit, and none is larger than it
    Total,    ///< summed over the whole frame, channel by channel, what the ports `Of` add up to (rounding apart)
    AtMost,   ///< magnitude at most Factor times the sum of the largest magnitudes of the connections of `Of`
    Within,   ///< in [Low, High]
    Anything  ///< may be non-finite; Reason says why
  };
  Law Kind = Law::Finite;
  std::vector<std::string> Of;
  double Factor = 1, Low = 0, High = 0;
  bool OrZero = false;
  std::string Divisor; ///< AtMost: a property that Factor is divided by
  /// Mean: what comes in beyond counts as this.
  double LeastIn = -3.5e38, LargestIn = 3.5e38;
  std::string Reason;
  /// Property values (as text) with which the bound does not hold.
  std::vector<std::pair<std::string, std::string>> Except;
  std::string Text() const; ///< "between the least and the largest of `radiance`"; empty for Finite and Anything
};

struct OutputArray
{
  std::string Name;
  ArrayKind Kind = ArrayKind::Any;
  int Components = 0;
  std::string Doc;
  std::vector<OutputBound> Bounds = {}; ///< all of them hold
};

/// One parameter, reflected from its VTK accessors. Values travel as text, so that XML, command line, reference and
/// viewer share one reader: numbers with std::from_chars, true/false, enumerators by name, vectors with blanks.
struct VTKQUELLCORE_EXPORT Property
{
  enum class Type
  {
    Int,
    Double,
    Bool,
    Enum,
    String,
    Path,  ///< input file, relative to the pipeline file
    Vector ///< fixed number of doubles
  };
  std::string Name, Unit, Doc;
  Type Kind = Type::Double;
  double Minimum = 0, Maximum = 0;      ///< Int, Double, Vector
  std::vector<std::string> Enumerators; ///< Enum, in the order of their int values from 0
  int Components = 1;                   ///< Vector
  std::function<std::string(const vtkQuellStage*)> GetText;
  /// Parses, checks type and range, then calls the setter. On failure leaves the stage alone, returns false and
  /// fills `error` with e.g. `"1.4" is outside [0, 1] (default 0.2)`.
  std::function<bool(vtkQuellStage*, const std::string& text, std::string& error)> SetText;
  std::string DefaultText; ///< of a fresh object; filled in by StageDescription::Find / the registry

  const char* TypeName() const; ///< "int", "double", "bool", "enum", "string", "path", "vector"
};

/// Everything about a stage type that is data: ports, arrays, parameters, prose.
struct VTKQUELLCORE_EXPORT StageDescription
{
  std::string Type;     ///< class name without vtkQuell: "ATrousFilter"
  std::string Category; ///< module: "Denoising"
  std::string Brief;    ///< one sentence
  std::string Details;  ///< Markdown: formula, border rule, NaN rule, source
  bool Sink = false;    ///< runs on every frame even when no output needs it (ImageWriter, CompareImages)
  std::vector<InputPort> Inputs;
  std::vector<OutputArray> Outputs; ///< the first is the primary one
  std::vector<Property> Properties;

  int InputIndex(const std::string& name) const; ///< -1: none
  const OutputArray* FindOutput(const std::string& name) const;
  const Property* FindProperty(const std::string& name) const;

  // Builders, so that a stage's table reads as a table.
  StageDescription& Input(const char* name, ArrayKind kind, const char* array, const char* doc);
  StageDescription& OptionalInput(const char* name, ArrayKind kind, const char* array, const char* doc);
  /// Optional, and meant to be connected with delay="1".
  StageDescription& DelayedInput(const char* name, ArrayKind kind, const char* array, const char* doc);
  StageDescription& RepeatableInput(const char* name, ArrayKind kind, const char* array, const char* doc);
  /// Of the input described last.
  StageDescription& Attribute(const char* name, const char* doc, std::vector<std::string> values = {});
  StageDescription& Output(const char* name, ArrayKind kind, const char* doc, int components = 0);

  ///@{ A bound of the output described last; see OutputBound.
  StageDescription& Mean(std::vector<std::string> ports);
  StageDescription& KeepsConstants(std::vector<std::string> ports, const char* reason);
  StageDescription& Part(const char* port);
  StageDescription& Total(std::vector<std::string> ports);
  StageDescription& AtMost(double factor, std::vector<std::string> ports);
  StageDescription& Within(double low, double high);
  StageDescription& Finite(const char* reason);
  StageDescription& Anything(const char* reason);
  ///@}
  ///@{ Of the bound declared last.
  StageDescription& OrZero();
  StageDescription& DividedBy(const char* property);
  StageDescription& Limited(double least, double largest);
  StageDescription& Except(const char* property, const char* value);
  ///@}
  /// Non-finite pixels of the input described last are not counted.
  StageDescription& Uncounted(const char* reason);
};

namespace detail
{
VTKQUELLCORE_EXPORT bool ParseInt(const std::string&, long long lo, long long hi, long long& out, std::string& error);
VTKQUELLCORE_EXPORT bool ParseDouble(const std::string&, double lo, double hi, double& out, std::string& error);
VTKQUELLCORE_EXPORT bool ParseBool(const std::string&, bool& out, std::string& error);
VTKQUELLCORE_EXPORT bool ParseEnum(
  const std::string&, const std::vector<std::string>& names, int& out, std::string& error);
VTKQUELLCORE_EXPORT bool ParseVector(const std::string&, int n, double lo, double hi, double* out, std::string& error);
VTKQUELLCORE_EXPORT std::string FormatDouble(double v); ///< shortest text that reads back to the same double
}
/// The names nearest to `name` (Levenshtein, at most 1/3 of its length, best first); for "did you mean".
VTKQUELLCORE_EXPORT std::string NearestName(const std::string& name, const std::vector<std::string>& names);
}

// Rows of the parameter table. `Self` must name the class; accessors are those of vtkSetClampMacro/vtkSetMacro.
#define QUELL_INT(d, name, unit, doc)                                                                             \
  (d).Properties.push_back(::quell::detail::IntRow<Self>(                                                         \
    #name, unit, doc, [](const Self* s) { return (long long)const_cast<Self*>(s)->Get##name(); },                 \
    [](Self* s, long long v) { s->Set##name((int)v); }, [](Self* s) { return (double)s->Get##name##MinValue(); }, \
    [](Self* s) { return (double)s->Get##name##MaxValue(); }))
#define QUELL_DOUBLE(d, name, unit, doc)                                                                  \
  (d).Properties.push_back(::quell::detail::DoubleRow<Self>(                                              \
    #name, unit, doc, [](const Self* s) { return (double)const_cast<Self*>(s)->Get##name(); },            \
    [](Self* s, double v) { s->Set##name(v); }, [](Self* s) { return (double)s->Get##name##MinValue(); }, \
    [](Self* s) { return (double)s->Get##name##MaxValue(); }))
#define QUELL_BOOL(d, name, doc)                                                       \
  (d).Properties.push_back(::quell::detail::BoolRow<Self>(                             \
    #name, doc, [](const Self* s) { return (bool)const_cast<Self*>(s)->Get##name(); }, \
    [](Self* s, bool v) { s->Set##name(v); }))
/// `names`: the enumerators in order, e.g. QUELL_ENUM(d, Mode, "doc", "Scale", "Drop")
#define QUELL_ENUM(d, name, doc, ...)                                                                  \
  (d).Properties.push_back(::quell::detail::EnumRow<Self>(                                             \
    #name, doc, { __VA_ARGS__ }, [](const Self* s) { return (int)const_cast<Self*>(s)->Get##name(); }, \
    [](Self* s, int v) { s->Set##name(v); }))
/// std::string accessors: `const std::string& GetX() const` / `void SetX(const std::string&)`.
#define QUELL_STRING(d, name, doc)                                                                          \
  (d).Properties.push_back(::quell::detail::StringRow<Self>(                                                \
    ::quell::Property::Type::String, #name, doc, [](const Self* s) { return std::string(s->Get##name()); }, \
    [](Self* s, const std::string& v) { s->Set##name(v); }))
#define QUELL_PATH(d, name, doc)                                                                          \
  (d).Properties.push_back(::quell::detail::StringRow<Self>(                                              \
    ::quell::Property::Type::Path, #name, doc, [](const Self* s) { return std::string(s->Get##name()); }, \
    [](Self* s, const std::string& v) { s->Set##name(v); }))
/// `count` doubles in [lo, hi]; accessors `const double* GetX()` / `void SetX(const double*)`
/// (vtkSetVectorMacro/vtkGetVectorMacro).
#define QUELL_VECTOR(d, name, count, lo, hi, unit, doc)                                                              \
  (d).Properties.push_back(::quell::detail::VectorRow<Self>(                                                         \
    #name, count, lo, hi, unit, doc, [](const Self* s) { return (const double*)const_cast<Self*>(s)->Get##name(); }, \
    [](Self* s, const double* v) { s->Set##name(v); }))

namespace quell
{
namespace detail
{
// A class's range accessors are not static, so rows keep functions and the registry asks a fresh object once.
template <class S>
Property IntRow(const char* n, const char* unit, const char* doc, long long (*get)(const S*),
  void (*set)(S*, long long), double (*lo)(S*), double (*hi)(S*));
template <class S>
Property DoubleRow(const char* n, const char* unit, const char* doc, double (*get)(const S*), void (*set)(S*, double),
  double (*lo)(S*), double (*hi)(S*));
template <class S>
Property BoolRow(const char* n, const char* doc, bool (*get)(const S*), void (*set)(S*, bool));
template <class S>
Property EnumRow(
  const char* n, const char* doc, std::vector<std::string> names, int (*get)(const S*), void (*set)(S*, int));
template <class S>
Property StringRow(
  Property::Type t, const char* n, const char* doc, std::string (*get)(const S*), void (*set)(S*, const std::string&));
template <class S>
Property VectorRow(const char* n, int count, double lo, double hi, const char* unit, const char* doc,
  const double* (*get)(const S*), void (*set)(S*, const double*));
}
}

#include "quellStageDescription.txx"
#endif
