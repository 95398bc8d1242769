// SPDX-License-Identifier: BSD-3-Clause
#include "quellStageReference.h"

#include "quellDiagnostic.h"
#include "vtkQuellStage.h"

#include <algorithm>
#include <limits>
#include <map>

namespace quell
{
namespace
{
std::string NumberText(double v, bool whole)
{
  return whole ? std::to_string((long long)v) : detail::FormatDouble(v);
}

/// Bounds of the number type itself say nothing to a reader.
bool IsOpen(double v)
{
  return v >= 2147483647. || v <= -2147483648.;
}

std::string Cell(const std::string& text)
{
  std::string out;
  for (char c : text)
  {
    if (c == '|')
    {
      out += "\\|";
    }
    else
    {
      out += c == '\n' ? ' ' : c;
    }
  }
  return out;
}

std::string Wrapped(const std::string& text, const std::string& indent, std::size_t width = 100)
{
  std::string out, line;
  std::size_t at = 0;
  while (at < text.size())
  {
    std::size_t end = text.find_first_of(" \n", at);
    end = end == std::string::npos ? text.size() : end;
    const std::string word = text.substr(at, end - at);
    if (!line.empty() && indent.size() + line.size() + 1 + word.size() > width)
    {
      out += indent + line + "\n";
      line.clear();
    }
    line += (line.empty() || word.empty() ? "" : " ") + word;
    at = end + 1;
  }
  return line.empty() ? out : out + indent + line + "\n";
}

std::string AttributeText(const InputAttribute& a, const std::string& name)
{
  return name + ": " + a.Doc + (a.Values.empty() ? "" : "; " + Listed(a.Values));
}

std::string PortNotes(const InputPort& p)
{
  std::string notes;
  if (p.Optional)
  {
    notes += ", optional";
  }
  if (p.Repeatable)
  {
    notes += ", repeatable";
  }
  return notes;
}
}

/// What the output is, and what its values keep to.
std::string OutputNotes(const OutputArray& o)
{
  std::string notes = o.Doc;
  for (const OutputBound& b : o.Bounds)
  {
    const std::string text = b.Text();
    notes += text.empty() || notes.find(text) != std::string::npos ? "" : "; " + text;
  }
  return notes;
}

std::string RangeText(const Property& p)
{
  switch (p.Kind)
  {
    case Property::Type::Enum:
      return Listed(p.Enumerators);
    case Property::Type::Int:
    case Property::Type::Double:
    case Property::Type::Vector:
    {
      const bool whole = p.Kind == Property::Type::Int;
      const bool noLow = IsOpen(p.Minimum), noHigh = IsOpen(p.Maximum);
      if (noLow && noHigh)
      {
        return {};
      }
      if (noHigh)
      {
        return NumberText(p.Minimum, whole) + " or more";
      }
      if (noLow)
      {
        return NumberText(p.Maximum, whole) + " or less";
      }
      return "[" + NumberText(p.Minimum, whole) + ", " + NumberText(p.Maximum, whole) + "]";
    }
    default:
      return {};
  }
}

std::string StageList(const StageRegistry& registry)
{
  std::map<std::string, std::vector<const StageDescription*>> categories;
  std::size_t width = 0;
  for (const std::string& type : registry.Types())
  {
    const StageDescription* d = registry.Describe(type);
    categories[d->Category].push_back(d);
    width = std::max(width, type.size());
  }
  std::string out;
  for (const auto& c : categories)
  {
    out += c.first + "\n";
    for (const StageDescription* d : c.second)
    {
      out += "  " + d->Type + std::string(width - d->Type.size() + 2, ' ') + d->Brief + "\n";
    }
  }
  return out;
}

std::string StageText(const StageDescription& d)
{
  std::string out = d.Type + " (" + d.Category + ")\n" + Wrapped(d.Brief, "  ");
  if (!d.Inputs.empty())
  {
    out += "inputs\n";
    for (const InputPort& p : d.Inputs)
    {
      out += "  " + p.Name + ": " + KindName(p.Kind) + " (" + KindDoc(p.Kind) + ")" + PortNotes(p) + "\n" +
             Wrapped(p.Doc, "      ");
      for (const InputAttribute& a : p.Attributes)
      {
        out += Wrapped(AttributeText(a, a.Name + "=\"...\""), "      ");
      }
    }
  }
  if (!d.Outputs.empty())
  {
    out += "outputs\n";
    for (const OutputArray& o : d.Outputs)
    {
      out += "  " + o.Name + ": " + KindName(o.Kind) + "\n" + Wrapped(OutputNotes(o), "      ");
    }
  }
  if (!d.Properties.empty())
  {
    out += "properties\n";
    for (const Property& p : d.Properties)
    {
      out += "  " + p.Name + " = " + (p.DefaultText.empty() ? "\"\"" : p.DefaultText) +
             (p.Unit.empty() ? "" : " " + p.Unit) + " (" + p.TypeName();
      const std::string range = RangeText(p);
      out += (range.empty() ? "" : ", " + range) + ")\n" + Wrapped(p.Doc, "      ");
    }
  }
  if (!d.Details.empty())
  {
    out += "\n" + d.Details + "\n";
  }
  return out;
}

std::string StageMarkdown(const StageRegistry& registry, const std::vector<std::string>& types)
{
  std::map<std::string, std::vector<const StageDescription*>> categories;
  for (const std::string& type : types)
  {
    if (const StageDescription* d = registry.Describe(type))
    {
      categories[d->Category].push_back(d);
    }
  }
  std::string out = "# Stage reference\n\nMade by `quell nodes --markdown` from the stages' own tables. Bias, variance "
                    "and cost of the filters, measured: [filters.md](filters.md).\n";
  if (types.size() > 1)
  {
    for (const auto& c : categories)
    {
      out += "\n**" + c.first + "**:";
      for (std::size_t i = 0; i < c.second.size(); ++i)
      {
        std::string anchor = c.second[i]->Type;
        std::transform(anchor.begin(), anchor.end(), anchor.begin(),
          [](char l) { return l >= 'A' && l <= 'Z' ? char(l - 'A' + 'a') : l; });
        out += (i ? ", [" : " [") + c.second[i]->Type + "](#" + anchor + ")";
      }
      out += "\n";
    }
  }
  for (const auto& c : categories)
  {
    for (const StageDescription* d : c.second)
    {
      out += "\n## " + d->Type + "\n\n" + d->Brief + "\n";
      if (!d->Details.empty())
      {
        out += "\n" + d->Details + "\n";
      }
      if (!d->Inputs.empty())
      {
        out += "\n| input | kind | |\n|---|---|---|\n";
        for (const InputPort& p : d->Inputs)
        {
          std::string doc = p.Doc;
          for (const InputAttribute& a : p.Attributes)
          {
            doc += "; " + AttributeText(a, "`" + a.Name + "`");
          }
          out += "| `" + p.Name + "` | " + KindName(p.Kind) + PortNotes(p) + " | " + Cell(doc) + " |\n";
        }
      }
      if (!d->Outputs.empty())
      {
        out += "\n| output | kind | |\n|---|---|---|\n";
        for (const OutputArray& o : d->Outputs)
        {
          out += "| `" + o.Name + "` | " + KindName(o.Kind) + " | " + Cell(OutputNotes(o)) + " |\n";
        }
      }
      if (!d->Properties.empty())
      {
        out += "\n| property | type | default | range | |\n|---|---|---|---|---|\n";
        for (const Property& p : d->Properties)
        {
          out += "| `" + p.Name + "` | " + p.TypeName() + " | " +
                 (p.DefaultText.empty() ? "" : "`" + Cell(p.DefaultText) + "`") +
                 (p.Unit.empty() ? "" : " " + Cell(p.Unit)) + " | " + Cell(RangeText(p)) + " | " + Cell(p.Doc) + " |\n";
        }
      }
    }
  }
  return out;
}
}
