// SPDX-License-Identifier: BSD-3-Clause
#include "quellAovNames.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <set>

namespace quell
{
namespace
{
/// Layers whose EXR name is not the array's own.
const std::map<std::string, std::string>& LayerNames()
{
  static const std::map<std::string, std::string> names{ { "radiance", "" }, { "alpha", "A" }, { "depth", "Z" },
    { "normal", "N" }, { "normalGeometric", "Ng" }, { "position", "P" } };
  return names;
}

/// Pass names of other programs, lower case, letters and digits only.
const std::map<std::string, std::string>& CommonRoles()
{
  static const std::map<std::string, std::string> roles{ { "combined", "radiance" }, { "beauty", "radiance" },
    { "rgba", "radiance" }, { "rgb", "radiance" }, { "color", "radiance" }, { "a", "alpha" }, { "alpha", "alpha" },
    { "albedo", "albedo" }, { "denoisingalbedo", "albedo" }, { "n", "normal" }, { "normal", "normal" },
    { "normals", "normal" }, { "shnormal", "normal" }, { "nn", "normal" }, { "ng", "normalGeometric" },
    { "geonormal", "normalGeometric" }, { "denoisingnormal", "denoisingNormal" },
    { "denoisingdepth", "denoisingDepth" }, { "p", "position" }, { "pos", "position" }, { "position", "position" },
    { "worldposition", "position" }, { "z", "depth" }, { "depth", "depth" },
    // Whose sign and unit? Only Quell's own files and Blender's are known.
    { "motion", "foreignMotion" }, { "id", "id" }, { "indexob", "id" }, { "objectid", "id" }, { "shapeindex", "id" },
    { "material", "material" }, { "indexma", "material" }, { "materialid", "material" }, { "emission", "emission" },
    { "emit", "emission" }, { "background", "environment" }, { "env", "environment" }, { "environment", "environment" },
    { "direct", "direct" }, { "indirect", "indirect" }, { "diffusedirect", "directDiffuse" },
    { "diffuseindirect", "indirectDiffuse" }, { "diffusealbedo", "albedoDiffuse" },
    { "speculardirect", "directSpecular" }, { "specularindirect", "indirectSpecular" },
    { "specularalbedo", "albedoSpecular" }, { "roughness", "roughness" }, { "uv", "uv" } };
  return roles;
}

/// Cycles' light passes hold light before the colour pass multiplies it, so they must not take the names of our layers.
const std::map<std::string, std::string>& BlenderRoles()
{
  static const std::map<std::string, std::string> roles{ { "diffdir", "diffuseDirect" },
    { "diffind", "diffuseIndirect" }, { "diffcol", "diffuseColor" }, { "glossdir", "glossyDirect" },
    { "glossind", "glossyIndirect" }, { "glosscol", "glossyColor" }, { "transdir", "transmissionDirect" },
    { "transind", "transmissionIndirect" }, { "transcol", "transmissionColor" },
    { "subsurfacedir", "subsurfaceDirect" }, { "subsurfaceind", "subsurfaceIndirect" },
    { "subsurfacecol", "subsurfaceColor" }, { "volumedir", "volumeDirect" }, { "volumeind", "volumeIndirect" },
    { "ao", "ambientOcclusion" }, { "shadow", "shadow" }, { "mist", "mist" }, { "vector", "motion" },
    { "noisyimage", "noisy" }, { "debugsamplecount", "samples" } };
  return roles;
}

/// Those of them that are albedos: what their light passes are multiplied by.
const std::set<std::string>& ReflectanceRoles()
{
  static const std::set<std::string> roles{ "diffuseColor", "glossyColor", "transmissionColor", "subsurfaceColor" };
  return roles;
}

const std::map<std::string, std::string>& PbrtRoles()
{
  static const std::map<std::string, std::string> roles{ { "n", "normalGeometric" }, { "ns", "normal" } };
  return roles;
}

std::string Normalised(const std::string& text)
{
  std::string out;
  for (unsigned char c : text)
    if (std::isalnum(c))
      out += char(std::tolower(c));
  return out;
}

std::string Sanitised(const std::string& text)
{
  std::string out;
  for (unsigned char c : text)
    out += std::isalnum(c) ? char(c) : '_';
  if (out.empty() || std::isdigit(static_cast<unsigned char>(out[0])))
    out.insert(0, "_");
  return out;
}

std::string LastPart(const std::string& path)
{
  const size_t dot = path.rfind('.');
  return dot == std::string::npos ? path : path.substr(dot + 1);
}

/// Channels that belong together: R G B A, X Y Z W, U V W, or one alone.
struct Group
{
  int Part = 0;
  std::string Path; ///< the layer; empty for plain R G B or Y
  bool Colour = false;
  bool Distance = false; ///< suffix T: along the ray, not along the view axis
  std::vector<int> Channels;
  int Alpha = -1;
};

std::vector<Group> GroupChannels(const std::vector<FilePart>& parts)
{
  std::vector<Group> groups;
  for (int part = 0; part < int(parts.size()); ++part)
  {
    const FilePart& file = parts[part];
    std::vector<std::string> order;
    std::map<std::string, std::vector<int>> layers;
    for (int c = 0; c < int(file.Channels.size()); ++c)
    {
      const std::string& name = file.Channels[c];
      const size_t dot = name.rfind('.');
      const std::string layer = dot == std::string::npos ? std::string() : name.substr(0, dot);
      if (!layers.count(layer))
        order.push_back(layer);
      layers[layer].push_back(c);
    }
    for (const std::string& layer : order)
    {
      std::vector<int> rest = layers[layer];
      const bool alone = rest.size() == 1;
      auto suffix = [&](int c)
      {
        const std::string s = layer.empty() ? file.Channels[c] : file.Channels[c].substr(layer.size() + 1);
        std::string upper;
        for (unsigned char ch : s)
          upper += char(std::toupper(ch));
        return layer.empty() ? s : upper;
      };
      auto take = [&](const char* s)
      {
        const auto found = std::find_if(rest.begin(), rest.end(), [&](int c) { return suffix(c) == s; });
        if (found == rest.end())
          return -1;
        const int c = *found;
        rest.erase(found);
        return c;
      };
      auto count = [&](const std::vector<const char*>& set)
      {
        return std::count_if(set.begin(), set.end(),
          [&](const char* s) { return std::any_of(rest.begin(), rest.end(), [&](int c) { return suffix(c) == s; }); });
      };
      std::string prefix;
      if (parts.size() > 1 && !file.Name.empty() && layer.compare(0, file.Name.size(), file.Name) != 0)
        prefix = file.Name;
      const std::string path = prefix.empty() ? layer : layer.empty() ? prefix : prefix + "." + layer;
      auto add = [&](const std::string& where, std::vector<int> channels, bool colour) -> Group&
      {
        Group g;
        g.Part = part;
        g.Path = where;
        g.Colour = colour;
        g.Channels = std::move(channels);
        groups.push_back(g);
        return groups.back();
      };
      // In the unnamed layer only R, G and B belong together: X, Y and Z there are luminance and depth.
      if (count({ "R", "G", "B" }) >= 2)
      {
        std::vector<int> channels;
        for (const char* s : { "R", "G", "B" })
        {
          const int c = take(s);
          if (c >= 0)
            channels.push_back(c);
        }
        Group& g = add(layer.empty() && part == 0 ? std::string() : path, channels, true);
        g.Alpha = take("A");
      }
      if (!layer.empty())
      {
        for (const auto& set : { std::vector<const char*>{ "X", "Y", "Z", "W" }, { "U", "V", "W" } })
          if (count(set) >= 2)
          {
            std::vector<int> channels;
            for (const char* s : set)
            {
              const int c = take(s);
              if (c >= 0)
                channels.push_back(c);
            }
            add(path, channels, false);
          }
      }
      else if (part == 0 && count({ "Y" }) == 1)
      {
        Group& g = add(std::string(), { take("Y") }, true);
        g.Alpha = take("A");
      }
      for (int c : rest)
      {
        const std::string s = suffix(c);
        // "Depth.Z" is the layer Depth; the Z of "left.R left.G left.B left.Z" is a depth of the layer left.
        std::string name = layer.empty() ? file.Channels[c] : file.Channels[c].substr(layer.size() + 1);
        const bool named = alone && (s.size() == 1 || layer.empty());
        if (layer.empty())
          name = prefix.empty() ? name : named ? prefix : prefix + "." + name;
        else
          name = named ? path : path + "." + name;
        add(name, { c }, false).Distance = !layer.empty() && s == "T";
      }
    }
  }
  // Plain channels get their names first; Blender's "Composite" layer is a processed copy, so it comes last.
  auto rank = [](const Group& g) { return g.Path.empty() ? 0 : g.Path.compare(0, 10, "Composite.") == 0 ? 2 : 1; };
  std::stable_sort(groups.begin(), groups.end(), [&](const Group& a, const Group& b) { return rank(a) < rank(b); });
  return groups;
}

/// Our array for a foreign layer; empty: not known.
std::string RoleOf(const Group& g, ChannelDialect dialect)
{
  const std::string pass = Normalised(LastPart(g.Path));
  if (g.Distance)
    return pass == "depth" ? "rayDistance" : std::string();
  if (pass == "variance" || pass == "relativevariance")
    return g.Channels.size() == 3 ? (pass == "variance" ? "varianceColor" : "relativeVarianceColor")
                                  : (pass == "variance" ? "variance" : "relativeVariance");
  const auto find = [&](const std::map<std::string, std::string>& roles)
  {
    const auto found = roles.find(pass);
    return found == roles.end() ? std::string() : found->second;
  };
  std::string role;
  if (dialect == ChannelDialect::Blender)
    role = find(BlenderRoles());
  if (dialect == ChannelDialect::Pbrt)
    role = find(PbrtRoles());
  return role.empty() ? find(CommonRoles()) : role;
}
}

std::string StandardLayer(const std::string& array)
{
  const auto found = LayerNames().find(array);
  return found == LayerNames().end() ? array : found->second;
}

std::vector<std::string> ChannelNames(const std::string& layer, ArrayKind kind, int components)
{
  if (components == 1)
    return { layer.empty() ? std::string("Y") : layer };
  const bool vector = kind == ArrayKind::Normal || kind == ArrayKind::Position || kind == ArrayKind::Motion ||
                      kind == ArrayKind::Moments || components == 2;
  std::vector<std::string> names;
  for (int c = 0; c < std::min(components, 4); ++c)
    names.push_back((layer.empty() ? "" : layer + ".") + std::string(1, (vector ? "XYZW" : "RGBA")[c]));
  return names;
}

std::vector<NamedChannels> NameArrays(const std::vector<FilePart>& parts, ChannelDialect dialect,
  const std::string& plain, const std::map<std::string, ArrayKind>& kinds)
{
  std::vector<NamedChannels> out;
  std::set<std::string> taken;
  const auto unique = [&](std::string name, const std::string& path)
  {
    if (taken.count(name))
      name = Sanitised(path);
    for (int n = 2; taken.count(name); ++n)
      name = Sanitised(path) + "_" + std::to_string(n);
    taken.insert(name);
    return name;
  };
  for (const Group& g : GroupChannels(parts))
  {
    NamedChannels array;
    array.Part = g.Part;
    array.Channels = g.Channels;
    array.Kind = g.Channels.size() == 1 ? ArrayKind::Scalar : g.Colour ? ArrayKind::Color : ArrayKind::Any;
    std::string name;
    if (g.Path.empty())
      name = plain;
    else if (dialect == ChannelDialect::Quell)
    {
      name = Sanitised(g.Path);
      for (const auto& layer : LayerNames())
        if (layer.second == g.Path)
          name = layer.first;
    }
    else
      name = RoleOf(g, dialect);

    // What the file says of its plain channels is not true of the array that the user takes them for.
    const bool renamed = g.Path.empty() && plain != "radiance";
    const auto recorded = dialect == ChannelDialect::Quell && !renamed ? kinds.find(g.Path) : kinds.end();
    const ArrayType* known = FindArray(name);
    if (g.Path.empty() && recorded == kinds.end() && !known)
      array.Kind = ArrayKind::Color;
    if (dialect == ChannelDialect::Blender && g.Channels.size() == 3 && ReflectanceRoles().count(name))
      array.Kind = ArrayKind::Albedo;
    if (known)
    {
      const int wanted = known->Components;
      const int have = int(array.Channels.size());
      if (have > wanted && (wanted == 1 || name == "motion" || g.Path.empty()))
        array.Channels.resize(wanted);
      else if (g.Path.empty() && have == 1)
        array.Channels.assign(wanted, array.Channels[0]);
      if (int(array.Channels.size()) != wanted)
      {
        // The name is ours but the shape is not: it must not be taken for the array of the contract.
        name = Sanitised(LastPart(g.Path.empty() ? plain : g.Path)) + "Raw";
        known = nullptr;
      }
    }
    else if (g.Path.empty() && array.Channels.size() == 1)
      array.Channels.assign(3, array.Channels[0]);
    if (name.empty())
    {
      name = Sanitised(LastPart(g.Path));
      if (FindArray(name) && dialect != ChannelDialect::Quell)
        known = FindArray(name)->Components == int(array.Channels.size()) ? FindArray(name) : nullptr;
      if (FindArray(name) && !known)
        name += "Raw";
    }
    if (known)
      array.Kind = known->Kind;
    if (recorded != kinds.end() &&
        (KindComponents(recorded->second) == int(array.Channels.size()) || !KindComponents(recorded->second)))
      array.Kind = recorded->second;
    if (name == "denoisingNormal" && array.Channels.size() == 3)
      array.Kind = ArrayKind::Normal;
    if (dialect == ChannelDialect::Quell)
      array.Conversion = array.Kind == ArrayKind::Motion ? ChannelConversion::FlipY : ChannelConversion::None;
    else if (name == "depth")
      array.Conversion = ChannelConversion::FarIsInfinite;
    const std::string path = g.Path.empty() ? plain : g.Path;
    array.Array = unique(name, path);
    out.push_back(array);
    if (g.Alpha >= 0)
    {
      NamedChannels alpha;
      alpha.Part = g.Part;
      alpha.Kind = ArrayKind::Scalar;
      alpha.Channels = { g.Alpha };
      const bool first = g.Path.empty() || array.Array == "radiance";
      alpha.Array = unique(first ? "alpha" : array.Array + "Alpha", path + ".A");
      out.push_back(alpha);
    }
    if (dialect == ChannelDialect::Blender && array.Array == "radiance" && !taken.count("combined"))
    {
      array.Array = unique("combined", "combined");
      out.push_back(array);
    }
    // The gbuffer film has no depth, but its positions are in camera space, which looks along +z.
    if (dialect == ChannelDialect::Pbrt && array.Array == "position" && !taken.count("depth"))
    {
      array.Array = unique("depth", "depth");
      array.Kind = ArrayKind::Depth;
      array.Channels = { array.Channels[2] };
      array.Conversion = ChannelConversion::ZeroIsInfinite;
      out.push_back(array);
    }
  }
  return out;
}
}
