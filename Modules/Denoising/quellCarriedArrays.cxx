// SPDX-License-Identifier: BSD-3-Clause
#include "quellCarriedArrays.h"

#include <algorithm>
#include <sstream>

namespace quell
{
std::vector<std::string> CarriedArrays(const std::string& text)
{
  std::istringstream in(text);
  std::vector<std::string> names;
  for (std::string name; in >> name;)
  {
    if (name != "radiance")
    {
      names.push_back(name);
    }
  }
  return names;
}

bool IsCarriedArray(const std::string& text, const std::string& name)
{
  const std::vector<std::string> names = CarriedArrays(text);
  return std::find(names.begin(), names.end(), name) != names.end();
}

void CheckCarriedArrays(ConnectionCheck& check, const std::string& text, int most, bool together)
{
  std::vector<OutputArray> arrays;
  const std::vector<std::string> wanted = CarriedArrays(text);
  if (wanted.empty() || check.Count(0) == 0 || !check.At(0, 0).Holds || !check.At(0, 0).Holds(arrays))
  {
    return;
  }
  std::vector<std::string> names;
  std::string list;
  for (const OutputArray& a : arrays)
  {
    if (std::find(names.begin(), names.end(), a.Name) == names.end())
    {
      names.push_back(a.Name);
      list += (list.empty() ? "it has " : ", ") + a.Name;
    }
  }
  int components = 0;
  for (const std::string& name : wanted)
  {
    const auto found =
      std::find_if(arrays.begin(), arrays.end(), [&name](const OutputArray& a) { return a.Name == name; });
    if (found == arrays.end())
    {
      const std::string near = NearestName(name, names);
      check.Warn(0, 0, "Arrays names \"" + name + "\", which is not there",
        near.empty() ? list : "did you mean \"" + near + "\"?");
      continue;
    }
    const int own = found->Components > 0 ? found->Components : KindComponents(found->Kind);
    components = together ? components + own : own;
    if (components > most)
    {
      check.Error(0, 0,
        "Arrays: \"" + name + "\" has " + std::to_string(own) + (own == 1 ? " component, " : " components, ") +
          (together ? "with those before " + std::to_string(components) + ", " : std::string()) + "at most " +
          std::to_string(most) + " are possible");
      return;
    }
  }
}
}
