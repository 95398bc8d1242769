// SPDX-License-Identifier: BSD-3-Clause
#include "quellDiagnostic.h"

#include "quellStageDescription.h"

#include <algorithm>
#include <cstdio>
#include <map>

namespace quell
{
std::string SourceLocation::ToText() const
{
  if (this->Line <= 0)
  {
    return this->File;
  }
  return this->File + ":" + std::to_string(this->Line) + ":" + std::to_string(this->Column);
}

std::string Diagnostic::ToText() const
{
  std::string text = this->Place.ToText();
  text += this->Level == Severity::Error ? ": error: " : ": warning: ";
  if (!this->Where.empty())
  {
    text += this->Where + ": ";
  }
  text += this->What;
  if (!this->Hint.empty())
  {
    text += "; " + this->Hint;
  }
  for (const std::string& line : this->Context)
  {
    text += "\n  " + line;
  }
  return text;
}

namespace
{
/// Control characters as \xNN: names of files and words of stages come as they are, and a message is one line; what is
/// beyond all reading is cut.
std::string Visible(const std::string& text)
{
  const std::size_t limit = 4000;
  std::string out;
  for (unsigned char c : text)
  {
    if (out.size() > limit && (c & 0xC0) != 0x80) // never inside a UTF-8 sequence
    {
      return out + "...";
    }
    if (c >= 0x20 && c != 0x7F)
    {
      out += char(c);
      continue;
    }
    char code[8];
    std::snprintf(code, sizeof code, "\\x%02X", unsigned(c));
    out += code;
  }
  return out;
}
}

void Diagnostics::Add(Diagnostic d)
{
  for (std::string* text : { &d.Where, &d.What, &d.Hint })
  {
    *text = Visible(*text);
  }
  for (const Diagnostic& known : this->Messages)
  {
    if (known.Level == d.Level && known.Place.Line == d.Place.Line && known.Place.Column == d.Place.Column &&
        known.What == d.What && known.Where == d.Where && known.Place.File == d.Place.File)
    {
      return;
    }
  }
  // A hostile file may hold a mistake per byte; nobody reads more than this.
  const std::size_t limit = 1000;
  this->Errors += d.Level == Severity::Error;
  if (this->Messages.size() < limit)
  {
    this->Messages.push_back(std::move(d));
  }
  else
  {
    this->Errors = std::min(this->Errors, int(limit));
  }
}

void Diagnostics::Error(
  const SourceLocation& place, const std::string& where, const std::string& what, const std::string& hint)
{
  Diagnostic d;
  d.Place = place;
  d.Where = where;
  d.What = what;
  d.Hint = hint;
  this->Add(std::move(d));
}

void Diagnostics::Warning(
  const SourceLocation& place, const std::string& where, const std::string& what, const std::string& hint)
{
  Diagnostic d;
  d.Level = Severity::Warning;
  d.Place = place;
  d.Where = where;
  d.What = what;
  d.Hint = hint;
  this->Add(std::move(d));
}

void Diagnostics::Sort()
{
  std::map<std::string, int> order;
  for (const Diagnostic& d : this->Messages)
  {
    order.emplace(d.Place.File, int(order.size()));
  }
  std::stable_sort(this->Messages.begin(), this->Messages.end(),
    [&order](const Diagnostic& a, const Diagnostic& b)
    {
      const int fa = order[a.Place.File], fb = order[b.Place.File];
      if (fa != fb)
      {
        return fa < fb;
      }
      return a.Place.Line != b.Place.Line ? a.Place.Line < b.Place.Line : a.Place.Column < b.Place.Column;
    });
}

std::string Diagnostics::ToText() const
{
  std::string text;
  for (const Diagnostic& d : this->Messages)
  {
    text += d.ToText() + "\n";
  }
  return text;
}

std::string Quoted(const std::string& text)
{
  const std::size_t limit = 200;
  std::string out = "\"";
  for (unsigned char c : text)
  {
    if (out.size() > limit && (c & 0xC0) != 0x80) // never inside a UTF-8 sequence
    {
      out += "...";
      break;
    }
    out += Visible(std::string(1, char(c)));
  }
  return out + "\"";
}

std::string DidYouMean(const std::string& name, const std::vector<std::string>& names)
{
  // The distance is quadratic in the length; no name of ours is longer than this.
  if (name.size() > 128)
  {
    return {};
  }
  const std::string nearest = NearestName(name, names);
  // Any two names of a letter or two are near; then only one that contains the other is worth saying.
  if (nearest.empty() ||
      (name.size() <= 2 && nearest.find(name) == std::string::npos && name.find(nearest) == std::string::npos))
  {
    return {};
  }
  return "did you mean " + Quoted(nearest) + "?";
}

std::string Listed(const std::vector<std::string>& names, std::size_t limit)
{
  if (names.empty())
  {
    return "none";
  }
  std::string text;
  for (std::size_t i = 0; i < names.size() && i < limit; ++i)
  {
    text += (i ? ", " : "") + names[i];
  }
  if (names.size() > limit)
  {
    text += " ... (" + std::to_string(names.size() - limit) + " more)";
  }
  return text;
}
}
