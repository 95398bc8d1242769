// SPDX-License-Identifier: BSD-3-Clause
// What every hit reads, laid out for it.
#include "quellEmbreeScene.h"
#include "quellMaterial.h"
#include "quellWavefront.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

namespace quell
{
void EmbreeScene::LayOutTexels()
{
  const Scene& s = *this->Source;
  this->TexelsOf.assign(s.Materials.size(), -1);
  std::map<std::array<int, 3>, int> known;
  std::int64_t bytes = 0;
  for (std::size_t i = 0; i < s.Materials.size(); ++i)
  {
    const Material& m = s.Materials[i];
    const TextureUse* const uses[] = { &m.BaseColorTexture, &m.MetallicRoughnessTexture, &m.NormalTexture };
    const Texture* textures[3] = {};
    std::array<int, 3> key{ -1, -1, -1 };
    const TextureUse* first = nullptr;
    bool together = true;
    for (std::size_t k = 0; k < 3; ++k)
    {
      const TextureUse& use = *uses[k];
      if (use.Texture < 0)
        continue;
      if (use.Texture >= int(s.Textures.size()))
      {
        together = false;
        break;
      }
      key[k] = use.Texture;
      textures[k] = &s.Textures[std::size_t(use.Texture)];
      first = first ? first : &use;
      together &= (use.TexCoord == 1) == (first->TexCoord == 1) &&
                  std::memcmp(use.Transform, first->Transform, sizeof use.Transform) == 0;
    }
    if (!together || !TexelTable::CanHold(textures[0], textures[1], textures[2]))
      continue;
    const auto found = known.find(key);
    if (found != known.end())
    {
      this->TexelsOf[i] = found->second;
      continue;
    }
    const std::int64_t more =
      std::int64_t(TexelTable::BytesOf(s.Textures[std::size_t(first->Texture)], !textures[1] && !textures[2]));
    if (more > this->Settings.TexelBytes - bytes)
      continue;
    bytes += more;
    this->TexelsOf[i] = known[key] = int(this->TexelTables.size());
    this->TexelTables.push_back(std::make_unique<TexelTable>(textures[0], textures[1], textures[2]));
  }
}

void EmbreeScene::LookAtParts()
{
  using Access = WavefrontAccess;
  this->Glances.assign(this->Parts.size(), Glance());
  for (std::size_t i = 0; i < this->Parts.size(); ++i)
  {
    const Part& part = this->Parts[i];
    const Material& m = this->Source->Materials[std::size_t(part.Material)];
    const Surface& surface = this->Surfaces[std::size_t(part.Material)];
    const bool still = part.InPlace;
    Glance& g = this->Glances[i];
    g.Points = part.Points;
    g.Corners = part.Corners;
    g.Normals = still ? part.Normals : nullptr;
    g.TexCoords = part.Geometry->TexCoords[0].empty() ? nullptr : part.Geometry->TexCoords[0].data();
    std::copy_n(&part.ToNormal[0][0], 9, &g.ToNormal[0][0]);
    const auto flag = [&g](bool condition, std::uint32_t bits) { g.Flags |= condition ? bits : 0u; };
    flag(part.Mirrored, Access::Mirrored);
    flag(m.NormalTexture.Texture >= 0, Access::Bent);
    flag(!still, Access::Elsewhere | Access::Bent);
    flag(g.Normals != nullptr, Access::Smooth);
    flag(!part.Plain, Access::Varies);
    flag(MayBeLayered(m) || m.Volume, Access::Layered);
    flag(m.Unlit, Access::Unlit);
    flag(!m.MultipleScattering, Access::Single);
    flag(!part.LightIndex.empty() || m.Unlit || MaxComponent(this->Emissions[std::size_t(part.Material)]) > 0,
      Access::Emits);
    if (part.Plain)
      g.Diffuse = surface.Diffuse;
    g.Base = m.BaseColor;
    g.Tint = m.SpecularColor;
    g.Metallic = m.Metallic;
    g.Roughness = m.Roughness;
    g.Specular = m.Specular;
    g.Ior = m.Ior;
    g.NormalScale = m.NormalScale;
    g.Others = !part.Plain;
    const int table = this->TexelsOf[std::size_t(part.Material)];
    if (table < 0)
      continue;
    g.Use = m.BaseColorTexture.Texture >= 0           ? &m.BaseColorTexture
            : m.MetallicRoughnessTexture.Texture >= 0 ? &m.MetallicRoughnessTexture
                                                      : &m.NormalTexture;
    const std::vector<Vec2f>& coordinates = part.Geometry->TexCoords[g.Use->TexCoord == 1 ? 1 : 0];
    if (coordinates.size() < part.Geometry->Positions.size())
      continue;
    g.Texels = this->TexelTables[std::size_t(table)].get();
    g.Coordinates = coordinates.data();
    g.Color = m.BaseColorTexture.Texture >= 0;
    g.Metal = m.MetallicRoughnessTexture.Texture >= 0;
    g.Bump = m.NormalTexture.Texture >= 0;
    g.Bends = g.Bump && still && !part.Tangents;
    g.Others = !part.Geometry->Colors.empty() || m.SpecularTexture.Texture >= 0 || m.SpecularColorTexture.Texture >= 0;
  }
}

void EmbreeScene::ListTriangles()
{
  this->Few.Clear();
  bool all = this->Settings.TestAll && this->TriangleCount <= SmallScene::MostTriangles;
  for (std::size_t i = 0; i < this->Parts.size() && all; ++i)
  {
    const Part& part = this->Parts[i];
    if (part.Triangles == 0 || (part.Moves && !part.Shown))
      continue;
    // what filters decide is Embree's
    all = part.InPlace && !part.AlphaTested && !part.OneSided && !part.Pane;
    for (std::size_t k = 0; k < part.Triangles && all; ++k)
    {
      const std::uint32_t* v = &part.Corners[3 * k];
      all = this->Few.Add(this->Corner(part, v[0]), this->Corner(part, v[1]), this->Corner(part, v[2]),
        std::uint32_t(i), std::uint32_t(k));
    }
  }
  if (!all || !this->Few.IsWorthIt())
    this->Few.Clear();
}
}
