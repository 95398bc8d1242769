// SPDX-License-Identifier: BSD-3-Clause
// OBJ + MTL reader. tinyobjloader splits the lines; indices are resolved, checked and triangulated here, because its
// mesh interface keeps polygons of at most 255 corners and passes indices on that point outside of the lists.
#include "quellSceneFiles.h"

#include <tiny_obj_loader.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <map>
#include <sstream>
#include <tuple>
#include <unordered_map>

namespace quell
{
namespace detail
{
namespace
{
using Color = Vec3f;

struct Corner
{
  int V, T, N;
  bool operator==(const Corner& o) const { return V == o.V && T == o.T && N == o.N; }
};
struct CornerHash
{
  std::size_t operator()(const Corner& c) const
  {
    std::uint64_t h = 14695981039346656037ull;
    for (const int i : { c.V, c.T, c.N })
      h = (h ^ std::uint64_t(std::uint32_t(i))) * 1099511628211ull;
    return std::size_t(h);
  }
};
struct Polygon
{
  std::size_t First; ///< into Corners
  int Count;
};
/// What one (group, material) pair collects.
struct Part
{
  int Group = 0, Material = -1;
  std::vector<Corner> Corners;
  std::vector<Polygon> Polygons;
};

std::string Trimmed(const std::string& s)
{
  const std::size_t a = s.find_first_not_of(" \t\r"), b = s.find_last_not_of(" \t\r");
  return a == std::string::npos ? std::string() : s.substr(a, b - a + 1);
}

/// [sign] digits [. digits] [e [sign] digits], a digit at least before the e.
bool IsNumber(const char* at, const char* end)
{
  const auto sign = [&] { at += at < end && (*at == '+' || *at == '-'); };
  const auto digits = [&]
  {
    const char* const begin = at;
    while (at < end && *at >= '0' && *at <= '9')
      ++at;
    return at - begin;
  };
  sign();
  auto count = digits();
  if (at < end && *at == '.')
  {
    ++at;
    count += digits();
  }
  if (count == 0)
    return false;
  if (at < end && (*at == 'e' || *at == 'E'))
  {
    ++at;
    sign();
    if (digits() == 0)
      return false;
  }
  return at == end;
}

/// Lines that begin with one of `keys` and whose next `count` words are not all numbers, `required` of them at least:
/// tinyobjloader reads such a word as 0 and says nothing.
struct NumberRule
{
  const char* Key;
  int Count, Required;
};
struct BadNumber
{
  std::size_t Line;  ///< from 1
  std::size_t Index; ///< of the line among those with this key, from 0
  const NumberRule* Rule;
  std::string Word; ///< empty: too few words
};
template <std::size_t N>
std::vector<BadNumber> FindBadNumbers(const Bytes& content, const NumberRule (&rules)[N])
{
  std::vector<BadNumber> bad;
  std::size_t counts[N] = {}, line = 1;
  const char *at = reinterpret_cast<const char*>(content.data()), *const end = at + content.size();
  const auto isSpace = [](char c) { return c == ' ' || c == '\t'; };
  const auto isEnd = [](char c) { return c == '\n' || c == '\r' || c == '\0'; };
  const auto word = [&]
  {
    while (at < end && isSpace(*at))
      ++at;
    const char* const begin = at;
    while (at < end && !isSpace(*at) && !isEnd(*at))
      ++at;
    return begin;
  };
  while (at < end)
  {
    const char* const key = word();
    const std::size_t length = std::size_t(at - key);
    for (std::size_t r = 0; r < N && length > 0; ++r)
      if (length == std::strlen(rules[r].Key) && std::memcmp(key, rules[r].Key, length) == 0)
      {
        const std::size_t index = counts[r]++;
        for (int i = 0; i < rules[r].Count; ++i)
        {
          const char* const begin = word();
          const bool missing = begin == at || *begin == '#';
          if (missing ? i < rules[r].Required : !IsNumber(begin, at))
            bad.push_back({ line, index, &rules[r], missing ? std::string() : std::string(begin, at) });
          if (missing || (!bad.empty() && bad.back().Line == line))
            break;
        }
      }
    while (at < end && !isEnd(*at))
      ++at;
    if (at < end)
    {
      const bool two = *at == '\r' && at + 1 < end && at[1] == '\n';
      at += two ? 2 : 1;
      ++line;
    }
  }
  return bad;
}
/// Lines with a bad number say nothing then.
void BlankLines(Bytes& content, const std::vector<BadNumber>& bad)
{
  std::size_t line = 1, next = 0;
  for (std::uint8_t& c : content)
  {
    if (c == '\n')
      ++line;
    while (next < bad.size() && bad[next].Line < line)
      ++next;
    if (next < bad.size() && bad[next].Line == line && c != '\n')
      c = ' ';
  }
}
/// "3 lines with what is no number, the first is line 7: v nan 0 0"
std::string Describe(const std::vector<BadNumber>& bad)
{
  const BadNumber& first = bad.front();
  const std::string what = "line " + std::to_string(first.Line) + ": " +
                           (first.Word.empty() ? std::string("too few numbers after ") + first.Rule->Key
                                               : "\"" + first.Word + "\" after " + first.Rule->Key + " is no number");
  return what + (bad.size() > 1 ? " (and " + std::to_string(bad.size() - 1) + " lines more of the kind)" : "");
}

/// What tinyobjloader does not know of: a byte order mark, lines that go on after a backslash, comments behind words.
/// Lines keep their numbers.
Bytes Cleaned(const Bytes& content)
{
  Bytes out;
  out.reserve(content.size() + 1);
  std::size_t at = content.size() >= 3 && content[0] == 0xef && content[1] == 0xbb && content[2] == 0xbf ? 3 : 0;
  std::size_t owed = 0; // line ends swallowed by continuations
  bool comment = false;
  for (; at < content.size(); ++at)
  {
    const std::uint8_t c = content[at];
    const bool crlf = c == '\r' && at + 1 < content.size() && content[at + 1] == '\n';
    if (c == '\\' && !comment && at + 1 < content.size() && (content[at + 1] == '\n' || content[at + 1] == '\r'))
    {
      ++at;
      at += content[at] == '\r' && at + 1 < content.size() && content[at + 1] == '\n';
      ++owed;
      out.push_back(' ');
    }
    else if (c == '\n' || c == '\r')
    {
      at += crlf;
      out.insert(out.end(), owed + 1, '\n');
      owed = 0;
      comment = false;
    }
    else
    {
      comment = comment || (c == '#' && (out.empty() || out.back() == ' ' || out.back() == '\t' || out.back() == '\n'));
      if (!comment)
        out.push_back(c);
    }
  }
  return out;
}

/// A face's corner: numbers with at most two slashes between them, within what an index can be.
bool IsCorner(const std::string& word)
{
  int slashes = 0;
  std::size_t digits = 0;
  for (std::size_t i = 0; i < word.size(); ++i)
  {
    const char c = word[i];
    if (c == '/')
    {
      ++slashes;
      digits = 0;
    }
    else if (c == '-')
    {
      if (i > 0 && word[i - 1] != '/')
        return false;
    }
    else if (c < '0' || c > '9' || ++digits > 10)
      return false;
  }
  // ten digits may still be beyond an index; the first number decides what cannot be told later
  return slashes <= 2 && !word.empty() && word[0] != '/' && std::atoll(word.c_str()) == int(std::atoll(word.c_str()));
}

class ObjReader : public tinyobj::MaterialReader
{
public:
  ObjReader(Scene& scene, ContentHash& hash)
    : Out(scene)
    , Hash(hash)
  {
  }

  void Read(const Bytes& content);
  void CheckFaces(const Bytes& content) const;

  bool operator()(const std::string& name, std::vector<tinyobj::material_t>* materials,
    std::map<std::string, int>* index, std::string* warning, std::string* error) override;

private:
  void AddFace(const tinyobj::index_t* raw, int count);
  void SetGroup(const std::string& name);
  void UseMaterial(const std::string& name);
  int Resolve(int raw, std::size_t count, const char* what);
  void ConvertMaterial(const tinyobj::material_t& in, Material& out);
  TextureUse Map(
    const std::string& name, const tinyobj::texture_option_t& options, bool srgb, const std::string& alpha);
  int LoadTexture(const std::string& name, bool srgb, bool clamp, const std::string& alpha, bool& binary);
  void BuildMesh(const Part& part);
  void Triangulate(const Part& part, const Polygon& polygon, std::vector<int>& triangles);
  std::string Face() const { return "face " + std::to_string(this->Faces); }

  Scene& Out;
  ContentHash& Hash;
  std::vector<Vec3f> Positions, Normals;
  std::vector<Vec2f> TexCoords;
  std::vector<tinyobj::material_t> Materials;
  std::map<std::string, int> MaterialIndex, GroupIndex;
  std::vector<std::string> Groups;
  std::map<std::pair<int, int>, std::size_t> PartIndex;
  std::vector<Part> Parts;
  std::map<std::tuple<std::string, std::string, bool, bool>, std::pair<int, bool>> Textures;
  int Group = -1, Material_ = -1;
  std::size_t Faces = 0;
  int MaximumIndex[3] = { -1, -1, -1 };
  std::size_t MaximumFace[3] = { 0, 0, 0 };
  bool LastAlphaBinary = false;
  MeshFaults Faults;
};

bool ObjReader::operator()(const std::string& name, std::vector<tinyobj::material_t>*, std::map<std::string, int>*,
  std::string* warning, std::string*)
{
  const std::string path = Beside(this->Out.File, name);
  Bytes content;
  std::string reason;
  if (!ReadFile(path, content, reason))
  {
    Warn(this->Out, "mtllib", "material library \"" + path + "\" cannot be read (" + reason + "); surfaces become grey",
      "put the file there or correct the name");
    return false;
  }
  this->Hash.Add(content.data(), content.size());
  static const NumberRule rules[] = { { "Kd", 3, 1 }, { "Ks", 3, 1 }, { "Ke", 3, 1 }, { "Tf", 3, 1 }, { "Ns", 1, 1 },
    { "Ni", 1, 1 }, { "d", 1, 1 }, { "Tr", 1, 1 }, { "Pr", 1, 1 }, { "Pm", 1, 1 }, { "illum", 1, 1 } };
  content = Cleaned(content);
  const std::vector<BadNumber> bad = FindBadNumbers(content, rules);
  if (!bad.empty())
    Warn(this->Out, "\"" + path + "\"", Describe(bad) + "; the default is taken", "correct the file");
  BlankLines(content, bad);
  std::istringstream in(std::string(content.begin(), content.end()));
  std::vector<tinyobj::material_t> read;
  std::map<std::string, int> unused;
  std::string trouble;
  tinyobj::LoadMtl(&unused, &read, &in, warning, &trouble);
  for (tinyobj::material_t& m : read)
  {
    m.name = Trimmed(m.name);
    if (this->MaterialIndex.emplace(m.name, int(this->Materials.size())).second)
      this->Materials.push_back(std::move(m));
  }
  return true;
}

void ObjReader::SetGroup(const std::string& name)
{
  const auto it = this->GroupIndex.emplace(name, int(this->Groups.size()));
  if (it.second)
    this->Groups.push_back(name);
  this->Group = it.first->second;
}

void ObjReader::UseMaterial(const std::string& name)
{
  const std::string trimmed = Trimmed(name);
  const auto it = this->MaterialIndex.find(trimmed);
  this->Material_ = it == this->MaterialIndex.end() ? -1 : it->second;
  if (this->Material_ < 0)
    Warn(this->Out, "usemtl " + trimmed, "the material is not defined; its surfaces become grey",
      "define it in the material library");
}

/// OBJ counts from 1; negative numbers count back from the last element so far. 0 means absent for vt and vn.
int ObjReader::Resolve(int raw, std::size_t count, const char* what)
{
  const std::int64_t i = raw > 0 ? std::int64_t(raw) - 1 : std::int64_t(count) + raw;
  if (raw == 0 || i < 0)
    Fail(this->Out.File, this->Face(),
      std::string(what) + " index " + std::to_string(raw) + " does not exist (" + std::to_string(count) + " so far)",
      "correct the index or export the file again");
  return int(i);
}

void ObjReader::AddFace(const tinyobj::index_t* raw, int count)
{
  ++this->Faces;
  if (count < 3)
  {
    Warn(this->Out, "", "faces of fewer than three corners are skipped", "");
    return;
  }
  if (this->Group < 0)
    this->SetGroup("");
  const auto it = this->PartIndex.emplace(std::make_pair(this->Group, this->Material_), this->Parts.size());
  if (it.second)
  {
    this->Parts.emplace_back();
    this->Parts.back().Group = this->Group;
    this->Parts.back().Material = this->Material_;
  }
  Part& part = this->Parts[it.first->second];
  part.Polygons.push_back({ part.Corners.size(), count });
  for (int k = 0; k < count; ++k)
  {
    Corner c;
    c.V = this->Resolve(raw[k].vertex_index, this->Positions.size(), "vertex");
    c.T = raw[k].texcoord_index == 0
            ? -1
            : this->Resolve(raw[k].texcoord_index, this->TexCoords.size(), "texture coordinate");
    c.N = raw[k].normal_index == 0 ? -1 : this->Resolve(raw[k].normal_index, this->Normals.size(), "normal");
    part.Corners.push_back(c);
    const int all[3] = { c.V, c.T, c.N };
    for (int j = 0; j < 3; ++j) // lists may go on after the face: checked at the end
      if (all[j] > this->MaximumIndex[j])
      {
        this->MaximumIndex[j] = all[j];
        this->MaximumFace[j] = this->Faces;
      }
  }
}

/// Ear clipping in the plane of the polygon's area vector; convex polygons (nearly all) come out as a fan.
void ObjReader::Triangulate(const Part& part, const Polygon& polygon, std::vector<int>& triangles)
{
  const int n = polygon.Count;
  const Corner* corners = part.Corners.data() + polygon.First;
  triangles.clear();
  const auto fan = [&]
  {
    triangles.clear();
    for (int i = 1; i + 1 < n; ++i)
      triangles.insert(triangles.end(), { 0, i, i + 1 });
  };
  if (n == 3)
    return fan();
  std::vector<Vec3d> p(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i)
    p[std::size_t(i)] = Vec3d(this->Positions[std::size_t(corners[i].V)]);
  const Vec3d origin = p[0];
  Vec3d area;
  for (int i = 0; i < n; ++i)
    area += Cross(p[std::size_t(i)] - origin, p[std::size_t((i + 1) % n)] - origin);
  area = Normalized(area);
  const auto turn = [&](int a, int b, int c)
  { return Dot(area, Cross(p[std::size_t(b)] - p[std::size_t(a)], p[std::size_t(c)] - p[std::size_t(a)])); };
  bool convex = true;
  for (int i = 0; i < n && convex; ++i)
    convex = turn(i, (i + 1) % n, (i + 2) % n) >= 0;
  if (convex || n > 4096 || !IsFinite(area))
    return fan();
  std::vector<int> left(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i)
    left[std::size_t(i)] = i;
  while (left.size() > 3)
  {
    const std::size_t m = left.size();
    std::size_t ear = m;
    for (std::size_t i = 0; i < m && ear == m; ++i)
    {
      const int a = left[(i + m - 1) % m], b = left[i], c = left[(i + 1) % m];
      if (turn(a, b, c) <= 0)
        continue;
      bool free = true;
      for (std::size_t k = 0; k < m && free; ++k)
      {
        const int q = left[k];
        if (q != a && q != b && q != c)
          free = turn(a, b, q) < 0 || turn(b, c, q) < 0 || turn(c, a, q) < 0;
      }
      if (free)
        ear = i;
    }
    if (ear == m)
      ear = 0; // self-intersecting: anything will do
    triangles.insert(triangles.end(), { left[(ear + m - 1) % m], left[ear], left[(ear + 1) % m] });
    left.erase(left.begin() + std::ptrdiff_t(ear));
  }
  triangles.insert(triangles.end(), { left[0], left[1], left[2] });
}

int ObjReader::LoadTexture(const std::string& name, bool srgb, bool clamp, const std::string& alphaName, bool& binary)
{
  const auto key = std::make_tuple(name, alphaName, srgb, clamp);
  const auto found = this->Textures.find(key);
  if (found != this->Textures.end())
  {
    binary = found->second.second;
    return found->second.first;
  }
  binary = false;
  const auto load = [this](const std::string& file, Texture& texture)
  {
    std::string path = Beside(this->Out.File, file), reason;
    std::replace(path.begin(), path.end(), '\\', '/');
    if (!LoadImage(path, texture, reason))
    {
      Warn(this->Out, "map",
        "image \"" + path + "\" cannot be used (" + reason + "); it is replaced by a neutral value",
        "put a usable image there or correct the name");
      return false;
    }
    Bytes content;
    if (ReadFile(path, content, reason))
      this->Hash.Add(content.data(), content.size());
    return true;
  };
  Texture texture, alpha;
  bool ok = name.empty() ? false : load(name, texture);
  if (!alphaName.empty() && load(alphaName, alpha))
  {
    if (!ok)
    {
      SceneMemory::Take(std::uint64_t(alpha.Width) * std::uint64_t(alpha.Height) * 4);
      texture.Width = alpha.Width;
      texture.Height = alpha.Height;
      texture.Bytes.assign(std::size_t(alpha.Width) * std::size_t(alpha.Height) * 4, 255);
      ok = true;
    }
    alpha.Nearest = alpha.Width == texture.Width && alpha.Height == texture.Height;
    alpha.WrapS = alpha.WrapT = Wrap::Clamp;
    binary = true;
    for (int y = 0; y < texture.Height; ++y)
      for (int x = 0; x < texture.Width; ++x)
      {
        const float a =
          alpha.Sample((float(x) + 0.5f) / float(texture.Width), (float(y) + 0.5f) / float(texture.Height)).x;
        const std::size_t at = (std::size_t(y) * std::size_t(texture.Width) + std::size_t(x)) * 4 + 3;
        if (texture.Floats.empty())
          texture.Bytes[at] = std::uint8_t(std::lround(std::min(std::max(a, 0.f), 1.f) * 255.f));
        else
          texture.Floats[at] = a;
        binary = binary && (a < 0.02f || a > 0.98f);
      }
  }
  int index = -1;
  if (ok)
  {
    texture.Name = name.empty() ? alphaName : name;
    texture.SRGB = srgb && texture.SRGB;
    std::size_t repaired = 0;
    for (float& v : texture.Floats)
      if (!std::isfinite(v) || (srgb && v < 0))
      {
        v = 0;
        ++repaired;
      }
    if (repaired > 0)
      Warn(this->Out, "map",
        "image \"" + texture.Name + "\": " + std::to_string(repaired) + " values that are not finite" +
          (srgb ? " or below 0" : "") + " count as 0",
        "write it again");
    if (clamp)
      texture.WrapS = texture.WrapT = Wrap::Clamp;
    index = int(this->Out.Textures.size());
    this->Out.Textures.push_back(std::move(texture));
  }
  this->Textures[key] = { index, binary };
  return index;
}

TextureUse ObjReader::Map(
  const std::string& name, const tinyobj::texture_option_t& o, bool srgb, const std::string& alpha)
{
  TextureUse use;
  use.Texture = this->LoadTexture(name, srgb, o.clamp, alpha, this->LastAlphaBinary);
  // -s and -o act on v that points up; ours points down, v' = 1 - v.
  use.Transform[0][0] = float(o.scale[0]);
  use.Transform[0][2] = float(o.origin_offset[0]);
  use.Transform[1][1] = float(o.scale[1]);
  use.Transform[1][2] = 1.f - float(o.scale[1]) - float(o.origin_offset[1]);
  return use;
}

// The mapping is described at LoadScene.
void ObjReader::ConvertMaterial(const tinyobj::material_t& in, Material& out)
{
  constexpr float largest = std::numeric_limits<float>::max();
  const auto inRange = [&](const char* key, double value, float low, float high)
  {
    const float taken = value >= double(low) ? float(std::min(value, double(high))) : low; // NaN becomes low
    if (double(taken) != value && !(std::fabs(double(taken) - value) < 1e-6))
    {
      std::ostringstream text;
      text << key << ' ' << value << " is outside of [" << low << ", ";
      high < largest ? text << high << "]; " : text << "..); ";
      text << taken << " is taken";
      Warn(this->Out, "material \"" + in.name + "\"", text.str(), "correct the material library");
    }
    return taken;
  };
  const auto color = [&](const char* key, const tinyobj::real_t* c, float high)
  { return Color(inRange(key, c[0], 0, high), inRange(key, c[1], 0, high), inRange(key, c[2], 0, high)); };
  const Color kd = color("Kd", in.diffuse, 1), ks = color("Ks", in.specular, 1), tf = color("Tf", in.transmittance, 1);
  const float d = inRange("d", in.dissolve, 0, 1);
  const float ns = inRange("Ns", in.shininess, 0, 1e6f);
  const float index = inRange("Ni", in.ior, 0, 100);
  const float ni = index > 1.0001f ? index : 0.f;
  const bool raytraced = in.illum == 3 || (in.illum >= 4 && in.illum <= 7);
  const bool dissolves = d < 1 || !in.alpha_texname.empty();
  const bool glass = !dissolves && (in.illum == 4 || in.illum == 6 || in.illum == 7 || in.illum == 9);
  out.Name = in.name;
  out.DoubleSided = true; // OBJ promises nothing about winding
  out.Metallic = 0;
  out.BaseColor = kd;
  out.Alpha = d;
  if (d < 1)
    out.Mode = AlphaMode::Blend;
  const float polish = std::sqrt(std::sqrt(2.f / (ns + 2.f))); // sqrt(alpha), alpha^2 = 2 / (Ns + 2)
  out.Roughness = raytraced && ns >= 200 ? 0.f : polish;
  out.Ior = ni > 0 ? ni : 1.5f;
  const float f0 = (out.Ior - 1) * (out.Ior - 1) / ((out.Ior + 1) * (out.Ior + 1));
  if (glass)
  {
    const bool given = MaxComponent(tf) > 0;
    out.Transmission = 1;
    out.Volume = true;
    out.Thickness = 1;
    for (int i = 0; i < 3; ++i)
      out.BaseColor[i] = given ? std::sqrt(tf[i]) : 1.f;
    if (ni == 0)
      out.Ior = 1.f + 1e-3f;
    out.Roughness = 0;
  }
  else if (!(MaxComponent(ks) > 0))
  {
    out.Specular = 0;
    out.Roughness = 1;
  }
  else if (MaxComponent(kd) <= 0.1f * MaxComponent(ks) && in.diffuse_texname.empty())
  {
    out.Metallic = 1;
    out.BaseColor = ks;
  }
  else
    out.SpecularColor = ks * (1.f / f0); // reflectance Ks at normal incidence, whatever Ni is
  out.Emission = color("Ke", in.emission, largest);
  if (in.roughness != 0)
    out.Roughness = inRange("Pr", in.roughness, 0, 1);
  if (in.metallic != 0)
    out.Metallic = inRange("Pm", in.metallic, 0, 1);

  const bool filtered = glass && MaxComponent(tf) > 0; // Tf is the colour of the glass, not what Kd says
  if ((!in.diffuse_texname.empty() && !filtered) || !in.alpha_texname.empty())
  {
    out.BaseColorTexture = this->Map(in.diffuse_texname, in.diffuse_texopt, true, in.alpha_texname);
    if (!in.alpha_texname.empty() && out.BaseColorTexture.Texture >= 0)
      out.Mode = this->LastAlphaBinary && d >= 1 ? AlphaMode::Mask : AlphaMode::Blend;
  }
  if (!in.emissive_texname.empty())
  {
    out.EmissiveTexture = this->Map(in.emissive_texname, in.emissive_texopt, true, "");
    if (out.EmissiveTexture.Texture < 0)
      out.Emission = Color(0);
    else if (!(MaxComponent(out.Emission) > 0))
      out.Emission = Color(1);
  }
  if (!in.normal_texname.empty())
    out.NormalTexture = this->Map(in.normal_texname, in.normal_texopt, false, "");
  for (const std::string* map : { &in.specular_texname, &in.specular_highlight_texname, &in.bump_texname })
    if (!map->empty())
      Warn(this->Out, "material " + in.name,
        "map \"" + *map + "\" is not supported and ignored (read: map_Kd, map_d, map_Ke, norm)", "");
}

void ObjReader::BuildMesh(const Part& part)
{
  Mesh mesh;
  const std::string& group = this->Groups[std::size_t(part.Group)];
  mesh.Name = group;
  mesh.Material = part.Material >= 0 ? part.Material : int(this->Out.Materials.size()) - 1;
  const bool normals = std::all_of(part.Corners.begin(), part.Corners.end(), [](const Corner& c) { return c.N >= 0; });
  const bool coordinates =
    std::any_of(part.Corners.begin(), part.Corners.end(), [](const Corner& c) { return c.T >= 0; });
  std::unordered_map<Corner, std::uint32_t, CornerHash> known;
  known.reserve(part.Corners.size());
  std::vector<int> triangles;
  for (const Polygon& polygon : part.Polygons)
  {
    this->Triangulate(part, polygon, triangles);
    for (const int k : triangles)
    {
      Corner c = part.Corners[polygon.First + std::size_t(k)];
      if (!normals)
        c.N = -1;
      const auto it = known.emplace(c, std::uint32_t(mesh.Positions.size()));
      if (it.second)
      {
        mesh.Positions.push_back(this->Positions[std::size_t(c.V)]);
        if (normals)
          mesh.Normals.push_back(this->Normals[std::size_t(c.N)]);
        if (coordinates)
          mesh.TexCoords[0].push_back(c.T >= 0 ? this->TexCoords[std::size_t(c.T)] : Vec2f());
      }
      mesh.Indices.push_back(it.first->second);
    }
  }
  CleanMesh(this->Out, mesh, "group", this->Out.Materials[std::size_t(mesh.Material)], this->Faults);
  if (mesh.Indices.empty())
    return;
  this->Out.Instances.push_back({ int(this->Out.Meshes.size()), part.Group, part.Group + 1 });
  this->Out.Meshes.push_back(std::move(mesh));
}

/// Throws for the first face with a word that is no corner.
void ObjReader::CheckFaces(const Bytes& content) const
{
  const char* at = reinterpret_cast<const char*>(content.data());
  const char* const end = at + content.size();
  const auto isSpace = [](char c) { return c == ' ' || c == '\t'; };
  for (std::size_t line = 1; at < end; ++line)
  {
    const char* const stop = std::find(at, end, '\n');
    while (at < stop && isSpace(*at))
      ++at;
    if (stop - at > 1 && *at == 'f' && isSpace(at[1]))
      for (++at; at < stop;)
      {
        while (at < stop && isSpace(*at))
          ++at;
        const char* const begin = at;
        while (at < stop && !isSpace(*at))
          ++at;
        const std::string word(begin, at);
        if (!word.empty() && !IsCorner(word))
          Fail(this->Out.File, "line " + std::to_string(line), "\"" + word + "\" is no corner of a face",
            "write vertex, vertex/texture or vertex/texture/normal numbers");
      }
    at = stop < end ? stop + 1 : end;
  }
}

void ObjReader::Read(const Bytes& original)
{
  const Bytes content = Cleaned(original);
  this->CheckFaces(content);
  std::istringstream in(std::string(content.begin(), content.end()));
  tinyobj::callback_t callbacks;
  callbacks.vertex_cb = [](void* data, tinyobj::real_t x, tinyobj::real_t y, tinyobj::real_t z, tinyobj::real_t) {
    static_cast<ObjReader*>(data)->Positions.push_back({ float(x), float(y), float(z) });
  };
  callbacks.normal_cb = [](void* data, tinyobj::real_t x, tinyobj::real_t y, tinyobj::real_t z) {
    static_cast<ObjReader*>(data)->Normals.push_back({ float(x), float(y), float(z) });
  };
  callbacks.texcoord_cb = [](void* data, tinyobj::real_t u, tinyobj::real_t v, tinyobj::real_t) {
    static_cast<ObjReader*>(data)->TexCoords.push_back({ float(u), 1.f - float(v) });
  };
  callbacks.index_cb = [](void* data, tinyobj::index_t* raw, int count)
  { static_cast<ObjReader*>(data)->AddFace(raw, count); };
  callbacks.usemtl_cb = [](void* data, const char* name, int) { static_cast<ObjReader*>(data)->UseMaterial(name); };
  callbacks.group_cb = [](void* data, const char** names, int count)
  {
    std::string name;
    for (int i = 0; i < count; ++i)
      name += (i > 0 ? " " : "") + std::string(names[i]);
    static_cast<ObjReader*>(data)->SetGroup(name);
  };
  callbacks.object_cb = [](void* data, const char* name) { static_cast<ObjReader*>(data)->SetGroup(Trimmed(name)); };
  std::string warning, error;
  if (!tinyobj::LoadObjWithCallback(in, callbacks, this, this, &warning, &error))
    Fail(this->Out.File, "", "the OBJ file cannot be parsed: " + Trimmed(error), "export the file again");
  static const NumberRule rules[] = { { "v", 3, 3 }, { "vn", 3, 3 }, { "vt", 2, 1 } };
  const std::vector<BadNumber> bad = FindBadNumbers(content, rules);
  if (!bad.empty())
    Warn(this->Out, "\"" + this->Out.File + "\"", Describe(bad), "export the file again");
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const BadNumber& b : bad) // what stands on it goes, with a warning of its own
    if (b.Rule == &rules[0] && b.Index < this->Positions.size())
      this->Positions[b.Index] = Vec3f(nan);
    else if (b.Rule == &rules[1] && b.Index < this->Normals.size())
      this->Normals[b.Index] = Vec3f(nan);

  const std::size_t sizes[3] = { this->Positions.size(), this->TexCoords.size(), this->Normals.size() };
  static const char* const names[3] = { "vertex", "texture coordinate", "normal" };
  for (int j = 0; j < 3; ++j)
    if (this->MaximumIndex[j] >= 0 && std::size_t(this->MaximumIndex[j]) >= sizes[j])
      Fail(this->Out.File, "face " + std::to_string(this->MaximumFace[j]),
        std::string(names[j]) + " index " + std::to_string(this->MaximumIndex[j] + 1) +
          " does not exist (the file has " + std::to_string(sizes[j]) + ")",
        "correct the index or export the file again");

  this->Out.Nodes.resize(this->Groups.size());
  for (std::size_t i = 0; i < this->Groups.size(); ++i)
    this->Out.Nodes[i].Name = this->Groups[i];
  std::vector<char> used(this->Materials.size(), 0);
  bool grey = false;
  for (const Part& part : this->Parts)
    if (part.Material >= 0)
      used[std::size_t(part.Material)] = 1;
    else
      grey = true;
  this->Out.Materials.resize(this->Materials.size());
  for (std::size_t i = 0; i < used.size(); ++i)
    if (used[i])
      this->ConvertMaterial(this->Materials[i], this->Out.Materials[i]);
    else
      this->Out.Materials[i].Name = this->Materials[i].name;
  if (grey)
  {
    Material m;
    m.Name = "default";
    m.BaseColor = Color(0.8f);
    m.Metallic = 0;
    m.Specular = 0;
    m.DoubleSided = true;
    this->Out.Materials.push_back(m);
  }
  for (const Part& part : this->Parts)
    this->BuildMesh(part);
  this->Faults.Warn(this->Out);
}
}

void ReadObj(Scene& scene, const Bytes& content, ContentHash& hash)
{
  ObjReader(scene, hash).Read(content);
}
}
}
