// SPDX-License-Identifier: BSD-3-Clause
#include "quellGuideVariances.h"

#include "quellStageDescription.h"

#include <algorithm>
#include <cctype>

namespace quell
{
namespace
{
std::string Lower(std::string text)
{
  for (char& c : text)
  {
    c = char(std::tolower((unsigned char)c));
  }
  return text;
}
std::string Quote(const std::string& text)
{
  return "\"" + text + "\"";
}
std::string Count(int components)
{
  return std::to_string(components) + (components == 1 ? " component" : " components");
}
}

int GuideOfVariance(const std::vector<std::string>& guides, const std::string& name, const std::string& array)
{
  if (name.empty() && guides.size() == 1)
  {
    return 0;
  }
  int found = -1;
  for (std::size_t k = 0; k < guides.size(); ++k)
  {
    if (name.empty() ? Lower(array) == "variance" + Lower(guides[k]) : guides[k] == name)
    {
      found = found == -1 ? int(k) : -2;
    }
  }
  return found;
}

std::vector<int> CheckGuideVariances(ConnectionCheck& check, int guidePort, const std::vector<std::string>& guides,
  int variancePort, const std::vector<std::string>& names)
{
  std::vector<int> found;
  std::string list;
  for (const std::string& g : guides)
  {
    list += (list.empty() ? "guides: " : ", ") + g;
  }
  for (int c = 0; c < check.Count(variancePort); ++c)
  {
    const std::string& name = names[std::size_t(c)];
    const ConnectionCheck::Connection& variance = check.At(variancePort, c);
    int guide = GuideOfVariance(guides, name, variance.Array);
    if (guides.empty())
    {
      check.Error(variancePort, c, "no guide is connected whose variance it could be");
    }
    else if (guide == -1 && name.empty())
    {
      check.Error(variancePort, c, Quote(variance.Array) + " does not say of which guide it is",
        "say it with guide=\"" + guides.front() + "\"; " + list);
    }
    else if (guide == -1)
    {
      const std::string near = NearestName(name, guides);
      check.Error(
        variancePort, c, "there is no guide " + Quote(name), near.empty() ? list : "did you mean " + Quote(near) + "?");
    }
    else if (guide == -2)
    {
      check.Error(variancePort, c,
        "several guides are called " +
          Quote(name.empty() ? variance.Array.substr(std::string("variance").size()) : name),
        "give each a name=\"...\" of its own");
    }
    else if (std::find(found.begin(), found.end(), guide) != found.end())
    {
      check.Error(variancePort, c, "guide " + Quote(guides[std::size_t(guide)]) + " has a variance already");
      guide = -1;
    }
    else
    {
      const int own = variance.Components, of = check.At(guidePort, guide).Components;
      if (own > 1 && of > 0 && own != of)
      {
        check.Error(variancePort, c,
          Quote(variance.Array) + " has " + Count(own) + ", guide " + Quote(guides[std::size_t(guide)]) + " has " +
            Count(of),
          of == 1 ? "wanted is 1" : "wanted are 1 or " + std::to_string(of));
      }
    }
    found.push_back(guide);
  }
  return found;
}
}
