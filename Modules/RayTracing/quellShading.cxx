// SPDX-License-Identifier: BSD-3-Clause
// From a hit to its material: normals, textures, emission.
#include "quellEmbreeScene.h"
#include "quellMaterial.h"
#include "quellWavefront.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace quell
{
namespace
{
/// Where a texture is read.
Vec2f Placed(const TextureUse& use, const Vec2f& t) noexcept
{
  return { use.Transform[0][0] * t.x + use.Transform[0][1] * t.y + use.Transform[0][2],
    use.Transform[1][0] * t.x + use.Transform[1][1] * t.y + use.Transform[1][2] };
}

/// A shading normal that can be used: it faces `wo`, and the mirror image of `wo` about it leaves the surface. Without
/// that, reflections off bumps seen at a grazing angle would go below the surface and be lost: a dark rim. What is too
/// low is raised to just above the horizon (Keller et al. 2017, section A.3).
Vec3f Adapted(Vec3f n, const Vec3f& ng, const Vec3f& wo) noexcept
{
  constexpr float least = 0.01f;
  if (n == ng)
    return n;
  const float facing = Dot(n, wo);
  if (facing < least)
  {
    n = Normalized(n + wo * (least - facing));
    if (!(Dot(n, ng) > 0))
      return ng;
  }
  const Vec3f mirrored = n * (2 * Dot(n, wo)) - wo;
  // no higher than the mirror image about the geometric normal itself
  const float height = Dot(ng, mirrored), wanted = std::min(least, Dot(ng, wo));
  if (height < wanted)
  {
    const Vec3f raised = Normalized(Normalized(mirrored + ng * (wanted - height)) + wo);
    n = raised == Vec3f() ? ng : raised;
  }
  return n;
}
}

Vec2f EmbreeScene::TexCoord(const Part& part, std::uint32_t primitive, float u, float v, int set) const noexcept
{
  const std::vector<Vec2f>& t = part.Geometry->TexCoords[set == 1 ? 1 : 0];
  const std::uint32_t* i = &part.Corners[3 * std::size_t(primitive)];
  if (i[0] >= t.size() || i[1] >= t.size() || i[2] >= t.size())
    return {};
  const Vec2f &a = t[i[0]], &b = t[i[1]], &c = t[i[2]];
  const float w = 1 - u - v;
  return { w * a.x + u * b.x + v * c.x, w * a.y + u * b.y + v * c.y };
}

Vec4f EmbreeScene::Lookup(
  const Part& part, std::uint32_t primitive, float u, float v, const TextureUse& use) const noexcept
{
  const Vec2f t = Placed(use, this->TexCoord(part, primitive, u, v, use.TexCoord));
  return this->Source->Textures[std::size_t(use.Texture)].Sample(t.x, t.y);
}

Vec4f EmbreeScene::VertexColor(const Part& part, std::uint32_t primitive, float u, float v) const noexcept
{
  const std::vector<Vec4f>& c = part.Geometry->Colors;
  const std::uint32_t* i = &part.Corners[3 * std::size_t(primitive)];
  if (i[0] >= c.size() || i[1] >= c.size() || i[2] >= c.size())
    return { 1, 1, 1, 1 };
  const Vec4f &a = c[i[0]], &b = c[i[1]], &d = c[i[2]];
  const float w = 1 - u - v;
  return { w * a.x + u * b.x + v * d.x, w * a.y + u * b.y + v * d.y, w * a.z + u * b.z + v * d.z,
    w * a.w + u * b.w + v * d.w };
}

float EmbreeScene::AlphaAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept
{
  const Material& m = this->Source->Materials[std::size_t(part.Material)];
  if (m.Mode == AlphaMode::Opaque)
    return 1;
  float alpha = m.Alpha;
  if (m.BaseColorTexture.Texture >= 0)
    alpha *= this->Lookup(part, primitive, u, v, m.BaseColorTexture).w;
  if (!part.Geometry->Colors.empty())
    alpha *= this->VertexColor(part, primitive, u, v).w;
  return m.Mode == AlphaMode::Mask ? (alpha >= m.AlphaCutoff ? 1.f : 0.f) : Unit(alpha);
}

Vec3f EmbreeScene::EmissionAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept
{
  const Material& m = this->Source->Materials[std::size_t(part.Material)];
  Vec3f e = this->Emissions[std::size_t(part.Material)];
  if (m.EmissiveTexture.Texture >= 0)
  {
    const Vec3f t = this->Lookup(part, primitive, u, v, m.EmissiveTexture).xyz();
    e *= Vec3f(Radiance(t.x), Radiance(t.y), Radiance(t.z));
  }
  return e;
}

Vec3f EmbreeScene::LightEmission(const LightSampler::Sample& s) const noexcept
{
  const Part& part = this->Parts[s.Geometry];
  return this->EmissionAt(part, s.Primitive, s.U, s.V) * this->AlphaAt(part, s.Primitive, s.U, s.V);
}

bool EmbreeScene::Attenuation(const SurfaceHit& hit, Vec3f& color, float& distance) const noexcept
{
  const Material& m = this->Source->Materials[std::size_t(this->Parts[hit.Geometry].Material)];
  color = Unit(m.AttenuationColor);
  distance = m.AttenuationDistance;
  return m.Volume && std::isfinite(distance) && distance > 0;
}

void WavefrontAccess::Normals(
  const EmbreeScene& scene, const SurfaceHit& hit, const Vec3f& wo, ShadingNormals& normals, const Vec4f* bump) noexcept
{
  const EmbreeScene::Part& part = scene.Parts[hit.Geometry];
  const Material& m = scene.Source->Materials[std::size_t(part.Material)];
  const Vec3f ng = hit.Front ? hit.Ng : -hit.Ng;
  Vec3f smooth = ng;
  Vec3f interpolated;
  if (scene.NormalAt(part, hit, interpolated))
  {
    const Vec3f w = Normalized(interpolated);
    if (w != Vec3f())
      smooth = Dot(w, ng) < 0 ? -w : w;
  }
  // The tangent-space normal of a map, around `n`.
  const auto mapped = [&](const Vec3f& around, const TextureUse& use, float scale, const Vec4f* known)
  {
    const Vec4f s = known ? *known : scene.Lookup(part, hit.Primitive, hit.U, hit.V, use);
    const Vec3f local{ (2 * s.x - 1) * scale, (2 * s.y - 1) * scale, 2 * s.z - 1 };
    Vec3d t;
    double handed = 1;
    if (!scene.TangentAt(part, hit, t, handed))
    {
      // along growing u, from the triangle's texture coordinates
      const Vec2f a = scene.TexCoord(part, hit.Primitive, 0, 0, use.TexCoord),
                  b = scene.TexCoord(part, hit.Primitive, 1, 0, use.TexCoord),
                  c = scene.TexCoord(part, hit.Primitive, 0, 1, use.TexCoord);
      const double du1 = b.x - a.x, dv1 = b.y - a.y, du2 = c.x - a.x, dv2 = c.y - a.y;
      const double det = du1 * dv2 - du2 * dv1;
      Vec3d p[3];
      scene.CornersAt(part, hit, p);
      const Vec3d e1 = p[1] - p[0], e2 = p[2] - p[0];
      if (det != 0 && std::isfinite(det))
      {
        t = (e1 * dv2 - e2 * dv1) * (1 / det);
        // texture v grows downwards in glTF, the map's green upwards
        handed = (det < 0) != part.Mirrored ? 1 : -1;
      }
    }
    const Vec3d n(around);
    t = Normalized(t - n * Dot(t, n));
    if (t == Vec3d() || !IsFinite(t) || !IsFinite(local))
      return around;
    // The back side sees the same bumps from behind: tangents stay, only the normal was turned.
    const Vec3d bitangent = Cross(hit.Front ? n : -n, t) * handed;
    const Vec3f w = Vec3f(Normalized(t * double(local.x) + bitangent * double(local.y) + n * double(local.z)));
    return w == Vec3f() ? around : w;
  };
  normals.Front = hit.Front;
  normals.Geometric = ng;
  const bool map = part.Textured && m.NormalTexture.Texture >= 0;
  normals.Shading = Adapted(map ? mapped(smooth, m.NormalTexture, m.NormalScale, bump) : smooth, ng, wo);
  normals.Coat = Vec3f();
  if (m.Clearcoat > 0 && (map || m.ClearcoatNormalTexture.Texture >= 0))
    normals.Coat = Adapted(m.ClearcoatNormalTexture.Texture >= 0
                             ? mapped(smooth, m.ClearcoatNormalTexture, m.ClearcoatNormalScale, nullptr)
                             : smooth,
      ng, wo);
}

/// Textures at one point: coordinates are made once, and the place in the texture for all textures of one kind.
class WavefrontAccess::TexCoords
{
public:
  TexCoords() = default;
  TexCoords(const EmbreeScene& scene, std::uint32_t geometry, std::uint32_t primitive, float u, float v) noexcept
    : Scene(&scene)
    , Part(&scene.Parts[geometry])
    , Primitive(primitive)
    , U(u)
    , V(v)
  {
  }
  Vec4f Look(const TextureUse& use) noexcept
  {
    const Texture& texture = this->Scene->Source->Textures[std::size_t(use.Texture)];
    return texture.IsUsable() ? texture.Read(this->Place(texture, use)) : Vec4f();
  }
  void Prefetch(const TextureUse& use) noexcept
  {
    if (use.Texture < 0)
      return;
    const Texture& texture = this->Scene->Source->Textures[std::size_t(use.Texture)];
    if (texture.IsUsable())
      texture.Prefetch(this->Place(texture, use));
  }

private:
  const Texture::Footprint& Place(const Texture& texture, const TextureUse& use) noexcept
  {
    if (this->Known && this->Known->SharesPlaces(texture) && this->KnownUse->TexCoord == use.TexCoord &&
        std::memcmp(this->KnownUse->Transform, use.Transform, sizeof use.Transform) == 0)
      return this->Print;
    const int set = use.TexCoord == 1 ? 1 : 0;
    if (!this->Made[set])
    {
      this->At[set] = this->Scene->TexCoord(*this->Part, this->Primitive, this->U, this->V, set);
      this->Made[set] = true;
    }
    const Vec2f t = Placed(use, this->At[set]);
    this->Print = texture.Place(t.x, t.y);
    this->Known = &texture;
    this->KnownUse = &use;
    return this->Print;
  }

  const EmbreeScene* Scene = nullptr;
  const EmbreeScene::Part* Part = nullptr;
  std::uint32_t Primitive = 0;
  float U = 0, V = 0;
  Vec2f At[2];
  bool Made[2] = { false, false };
  const Texture* Known = nullptr;
  const TextureUse* KnownUse = nullptr;
  Texture::Footprint Print;
};

void WavefrontAccess::Values(const EmbreeScene& scene, Wavefront& w) noexcept
{
  constexpr int ahead = 16; // rows between asking for texels and reading them
  struct
  {
    TexelTable::Footprint Print;
    Vec2f A, B, C; ///< texture coordinates of the corners
  } tables[ahead];
  TexCoords places[ahead];
  const EmbreeScene::Glance* glances = scene.Glances.data();
  const bool varies = (w.Any & Varies) != 0;
  const auto announce = [&](int i)
  {
    if (!w.Alive[i] || !(w.Material[i] & Varies))
      return;
    const EmbreeScene::Glance& part = glances[w.Geometry[i]];
    if (part.Texels)
    {
      const std::uint32_t* v = &part.Corners[3 * std::size_t(w.Primitive[i])];
      auto& at = tables[i % ahead];
      at.A = part.Coordinates[v[0]];
      at.B = part.Coordinates[v[1]];
      at.C = part.Coordinates[v[2]];
      const float s = w.U[i], t = w.V[i], r = 1 - s - t;
      const Vec2f place = Placed(
        *part.Use, { r * at.A.x + s * at.B.x + t * at.C.x, r * at.A.y + s * at.B.y + t * at.C.y }); // as TexCoord
      at.Print = part.Texels->Place(place.x, place.y);
      part.Texels->Prefetch(at.Print);
    }
    if (!part.Others)
      return;
    TexCoords& at = places[i % ahead];
    at = TexCoords(scene, w.Geometry[i], w.Primitive[i], w.U[i], w.V[i]);
    if (part.Texels)
      return;
    const Material& m = scene.Source->Materials[std::size_t(scene.Parts[w.Geometry[i]].Material)];
    for (const TextureUse* use : { &m.BaseColorTexture, &m.MetallicRoughnessTexture, &m.NormalTexture })
      at.Prefetch(*use);
  };
  for (int i = 0; varies && i < ahead && i < w.Count; ++i)
    announce(i);
  Wavefront::OpaqueColumns& o = w.Opaque;
  SurfaceHit hit;
  bool bends = false;
  for (int i = 0; i < w.Count; ++i)
  {
    if (w.Alive[i])
    {
      const EmbreeScene::Glance& part = glances[w.Geometry[i]];
      Vec3f base = part.Base, tint = part.Tint;
      float metallic = part.Metallic, roughness = part.Roughness, specular = part.Specular;
      Vec4f bump;
      bool bumps = part.Bump;
      if (part.Texels)
      {
        float texel[8];
        part.Texels->Read(tables[i % ahead].Print, texel);
        if (part.Color)
          base *= Vec3f(texel[0], texel[1], texel[2]);
        if (part.Metal)
        {
          roughness *= texel[3];
          metallic *= texel[4];
        }
        bump = { texel[5], texel[6], texel[7], 1 };
      }
      if (part.Others)
      {
        const EmbreeScene::Part& whole = scene.Parts[w.Geometry[i]];
        const Material& m = scene.Source->Materials[std::size_t(whole.Material)];
        TexCoords& at = places[i % ahead];
        if (!part.Texels && m.BaseColorTexture.Texture >= 0)
          base *= at.Look(m.BaseColorTexture).xyz();
        if (!whole.Geometry->Colors.empty())
          base *= scene.VertexColor(whole, w.Primitive[i], w.U[i], w.V[i]).xyz();
        if (!part.Texels && m.MetallicRoughnessTexture.Texture >= 0)
        {
          const Vec4f t = at.Look(m.MetallicRoughnessTexture);
          roughness *= t.y;
          metallic *= t.z;
        }
        if (!part.Texels && whole.Textured && m.NormalTexture.Texture >= 0)
        {
          bump = at.Look(m.NormalTexture);
          bumps = true;
        }
        if (m.SpecularTexture.Texture >= 0)
          specular *= at.Look(m.SpecularTexture).w;
        if (m.SpecularColorTexture.Texture >= 0)
          tint *= at.Look(m.SpecularColorTexture).xyz();
      }
      o.Base[0][i] = base.x;
      o.Base[1][i] = base.y;
      o.Base[2][i] = base.z;
      o.Metallic[i] = metallic;
      o.Roughness[i] = roughness;
      o.Specular[i] = specular;
      o.Tint[0][i] = tint.x;
      o.Tint[1][i] = tint.y;
      o.Tint[2][i] = tint.z;
      o.Ior[i] = part.Ior;
      if (part.Bends)
      {
        const Vec2f &a = tables[i % ahead].A, &b = tables[i % ahead].B, &c = tables[i % ahead].C;
        w.Material[i] |= Bumped;
        o.Bump[0][i] = (2 * bump.x - 1) * part.NormalScale;
        o.Bump[1][i] = (2 * bump.y - 1) * part.NormalScale;
        o.Bump[2][i] = 2 * bump.z - 1;
        // sums with 0, as TexCoord makes them
        o.Slope[0][i] = (b.x + 0.f) - (a.x + 0.f);
        o.Slope[1][i] = (b.y + 0.f) - (a.y + 0.f);
        o.Slope[2][i] = (c.x + 0.f) - (a.x + 0.f);
        o.Slope[3][i] = (c.y + 0.f) - (a.y + 0.f);
        bends = true;
      }
      else if (w.Material[i] & Bent)
      {
        ShadingNormals normals;
        Hit(scene, w, i, false, hit);
        Normals(scene, hit, { -w.Live.Dx[i], -w.Live.Dy[i], -w.Live.Dz[i] }, normals, bumps ? &bump : nullptr);
        w.Sx[i] = normals.Shading.x;
        w.Sy[i] = normals.Shading.y;
        w.Sz[i] = normals.Shading.z;
        w.Material[i] &= ~Smooth;
      }
    }
    if (varies && i + ahead < w.Count)
      announce(i + ahead);
  }
  if (bends || (w.Any & Smooth) != 0)
    lanes::Bend(w, bends);
}

Surface WavefrontAccess::Resolve(
  const EmbreeScene& scene, const SurfaceHit& hit, float& roughness, Vec3f& unlit) noexcept
{
  const EmbreeScene::Part& part = scene.Parts[hit.Geometry];
  const Material& m = scene.Source->Materials[std::size_t(part.Material)];
  MaterialValues v(m);
  TexCoords at(scene, hit.Geometry, hit.Primitive, hit.U, hit.V);
  if (m.BaseColorTexture.Texture >= 0)
    v.BaseColor *= at.Look(m.BaseColorTexture).xyz();
  if (!part.Geometry->Colors.empty())
    v.BaseColor *= scene.VertexColor(part, hit.Primitive, hit.U, hit.V).xyz();
  if (m.MetallicRoughnessTexture.Texture >= 0)
  {
    const Vec4f t = at.Look(m.MetallicRoughnessTexture);
    v.Roughness *= t.y;
    v.Metallic *= t.z;
  }
  if (m.TransmissionTexture.Texture >= 0)
    v.Transmission *= at.Look(m.TransmissionTexture).x;
  if (m.SpecularTexture.Texture >= 0)
    v.Specular *= at.Look(m.SpecularTexture).w;
  if (m.SpecularColorTexture.Texture >= 0)
    v.SpecularColor *= at.Look(m.SpecularColorTexture).xyz();
  if (m.ThicknessTexture.Texture >= 0)
    v.Thickness *= at.Look(m.ThicknessTexture).y;
  if (m.ClearcoatTexture.Texture >= 0)
    v.Clearcoat *= at.Look(m.ClearcoatTexture).x;
  if (m.ClearcoatRoughnessTexture.Texture >= 0)
    v.ClearcoatRoughness *= at.Look(m.ClearcoatRoughnessTexture).y;
  roughness = Unit(v.Roughness);
  if (m.Unlit)
    unlit = Unit(v.BaseColor);
  return MakeSurface(m, v);
}

Vec3f WavefrontAccess::Emission(const EmbreeScene& scene, const SurfaceHit& hit) noexcept
{
  const EmbreeScene::Part& part = scene.Parts[hit.Geometry];
  const Material& m = scene.Source->Materials[std::size_t(part.Material)];
  return (hit.Front || m.DoubleSided) && !m.Unlit ? scene.EmissionAt(part, hit.Primitive, hit.U, hit.V) : Vec3f();
}

void EmbreeScene::Shade(const SurfaceHit& hit, const Vec3f& direction, SurfacePoint& point) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  const Material& m = this->Source->Materials[std::size_t(part.Material)];
  WavefrontAccess::Normals(*this, hit, -direction, point.Normals);
  if (part.Plain)
  {
    point.Material = this->Surfaces[std::size_t(part.Material)];
    point.Roughness = Unit(m.Roughness);
    if (m.Unlit)
      point.DisplayOnly = Unit(m.BaseColor);
  }
  else
    point.Material = WavefrontAccess::Resolve(*this, hit, point.Roughness, point.DisplayOnly);
  point.Emission = WavefrontAccess::Emission(*this, hit);
}
}
