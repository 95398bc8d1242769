// SPDX-License-Identifier: BSD-3-Clause
#include "quellVary.h"

#include "quellDiagnostic.h"
#include "quellStageDescription.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace quell
{
namespace
{
[[noreturn]] void Refuse(const std::string& text, const std::string& why)
{
  throw std::invalid_argument(
    "--vary " + text + ": " + why + "; write NODE.PROPERTY=1,2,4 or =FROM..TO/COUNT or =FROM..TO*COUNT or NODE=on,off");
}

double Number(const std::string& text, const std::string& part)
{
  double v = 0;
  std::string error;
  if (!detail::ParseDouble(part, -1e300, 1e300, v, error))
  {
    Refuse(text, Quoted(part) + " is no number");
  }
  return v;
}

/// `part` is FROM..TO/COUNT or FROM..TO*COUNT.
void AddRange(const std::string& text, const std::string& part, std::vector<std::string>& values)
{
  const std::size_t dots = part.find(".."), mark = part.find_first_of("/*", dots);
  if (mark == std::string::npos)
  {
    Refuse(text, Quoted(part) + " does not say how many values");
  }
  const double from = Number(text, part.substr(0, dots)), to = Number(text, part.substr(dots + 2, mark - dots - 2));
  long long count = 0;
  std::string error;
  if (!detail::ParseInt(part.substr(mark + 1), 2, 1000, count, error))
  {
    Refuse(text, Quoted(part.substr(mark + 1)) + " is no number of values from 2 to 1000");
  }
  const bool ratio = part[mark] == '*';
  if (ratio && !(from > 0 && to > 0))
  {
    Refuse(text, "equal ratios need ends above 0");
  }
  for (long long i = 0; i < count; ++i)
  {
    const double t = double(i) / double(count - 1);
    double v = ratio ? from * std::pow(to / from, t) : from + t * (to - from);
    v = i + 1 == count ? to : v;
    // Six digits are enough to tell settings apart, and people read them; whole numbers have all of theirs.
    const bool whole = v == std::floor(v) && std::fabs(v) < 1e15;
    values.push_back(whole ? std::to_string(static_cast<long long>(v)) : RoundedText(v, 6));
  }
}
}

std::string RoundedText(double value, int digits)
{
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return detail::FormatDouble(std::strtod(text, nullptr));
}

VaryAxis ParseVary(const std::string& text)
{
  const std::size_t equal = text.find('=');
  if (equal == std::string::npos || equal == 0 || equal + 1 == text.size())
  {
    Refuse(text, "not of the form what=values");
  }
  VaryAxis axis;
  axis.What = text.substr(0, equal);
  std::vector<std::string> values;
  for (std::size_t at = equal + 1; at <= text.size();)
  {
    const std::size_t comma = std::min(text.find(',', at), text.size());
    const std::string part = text.substr(at, comma - at);
    if (part.empty())
    {
      Refuse(text, "a value is missing");
    }
    const std::size_t dots = part.find("..");
    // A path may hold two dots; a range begins with a number.
    const bool range = dots != std::string::npos && dots > 0 && part.find_first_not_of("0123456789+-.eE") > dots;
    if (range)
    {
      AddRange(text, part, values);
    }
    else
    {
      values.push_back(part);
    }
    at = comma + 1;
  }
  for (const std::string& v : values)
  {
    if (std::find(axis.Values.begin(), axis.Values.end(), v) == axis.Values.end())
    {
      axis.Values.push_back(v);
    }
  }
  return axis;
}

std::vector<VaryChoice> Combinations(const std::vector<VaryAxis>& axes, std::size_t limit)
{
  std::size_t count = 1;
  for (std::size_t i = 0; i < axes.size(); ++i)
  {
    for (std::size_t j = 0; j < i; ++j)
    {
      if (axes[i].What == axes[j].What)
      {
        throw std::invalid_argument("--vary " + axes[i].What + " is given twice");
      }
    }
    count *= axes[i].Values.size();
    if (count > limit)
    {
      throw std::invalid_argument(
        "the values of --vary make more than " + std::to_string(limit) + " settings; vary less at a time");
    }
  }
  std::vector<VaryChoice> all(count);
  for (std::size_t n = 0; n < count; ++n)
  {
    std::size_t rest = n;
    all[n].resize(axes.size());
    for (std::size_t i = axes.size(); i-- > 0;)
    {
      all[n][i] = { axes[i].What, axes[i].Values[rest % axes[i].Values.size()] };
      rest /= axes[i].Values.size();
    }
  }
  return all;
}

std::string ChoiceText(const VaryChoice& choice)
{
  std::string text;
  for (const auto& c : choice)
  {
    text += (text.empty() ? "" : " ") + c.first + "=" + c.second;
  }
  return text.empty() ? "as in the file" : text;
}
}
