// SPDX-License-Identifier: BSD-3-Clause
#ifndef BsdfTesting_h
#define BsdfTesting_h

#include "quellBsdf.h"
#include "quellMaterial.h"
#include "quellSampler.h"

#include <cmath>
#include <string>
#include <vector>

/// Materials and directions that the tests of the scattering functions share.
namespace bsdf
{
using quell::Material;
using quell::ShadingNormals;
using quell::Surface;
using quell::Vec2f;
using quell::Vec3f;

const Vec3f Up(0, 0, 1);

inline ShadingNormals Upright(bool front = true)
{
  return { Up, Up, front };
}
/// The same surface seen from below.
inline ShadingNormals Upended(bool front = true)
{
  return { -Up, -Up, !front };
}
inline Vec3f Direction(float mu, float phi = 0)
{
  const float r = std::sqrt(std::max(0.f, 1 - mu * mu));
  return { r * std::cos(phi), r * std::sin(phi), mu };
}

inline Surface Make(const Material& m)
{
  return quell::MakeSurface(m, quell::MaterialValues(m));
}
inline Material Metal(float roughness)
{
  Material m;
  m.Roughness = roughness;
  return m;
}
inline Material Plastic(float roughness)
{
  Material m = Metal(roughness);
  m.Metallic = 0;
  return m;
}
inline Material ThinGlass(float roughness, float ior = 1.5f)
{
  Material m = Plastic(roughness);
  m.Transmission = 1;
  m.Ior = ior;
  return m;
}
inline Material ThickGlass(float roughness, float ior = 1.5f)
{
  Material m = ThinGlass(roughness, ior);
  m.Volume = true;
  return m;
}
inline Material Coated(Material m, float roughness, float weight = 1)
{
  m.Clearcoat = weight;
  m.ClearcoatRoughness = roughness;
  return m;
}

struct Case
{
  std::string Name;
  Material Is;
  bool Front = true;
};
/// One of every kind of lobe and mixture, all of them white.
inline std::vector<Case> Kinds(float roughness)
{
  Material lambert = Plastic(roughness), half = Metal(roughness), mixed = ThickGlass(roughness), tinted = mixed;
  lambert.Specular = 0;
  half.Metallic = .5f;
  mixed.Transmission = .5f;
  mixed.Metallic = .3f;
  tinted.SpecularColor = Vec3f(4, 1, .25f);
  tinted.Specular = .7f;
  return { { "lambert", lambert }, { "metal", Metal(roughness) }, { "plastic", Plastic(roughness) },
    { "half metal", half }, { "thin glass", ThinGlass(roughness) }, { "glass", ThickGlass(roughness) },
    { "glass from inside", ThickGlass(roughness), false }, { "mixture", mixed },
    { "mixture from inside", mixed, false }, { "tinted glass", tinted },
    { "coated plastic", Coated(Plastic(roughness), .4f) }, { "varnished metal", Coated(Metal(roughness), 0, .6f) },
    { "coated metal", Coated(Metal(roughness), .7f, .5f) }, { "coated glass", Coated(ThickGlass(roughness), .3f) },
    { "coated glass from inside", Coated(ThickGlass(roughness), .3f), false },
    { "coated thin glass", Coated(ThinGlass(roughness), .5f) } };
}

/// What comes back of uniform light of radiance 1, both sides together: the mean weight of samples, without the
/// compression of radiance by refraction.
inline double Returned(Surface s, float mu, int n, bool front = true)
{
  const Vec3f wo = Direction(mu);
  const ShadingNormals normals = Upright(front);
  s.Prepare(mu);
  double sum = 0;
  for (int i = 0; i < n; ++i)
  {
    const quell::PixelSampler random(3, 0, 0, std::uint32_t(i));
    const Vec2f u = random.Pair(0), l = random.Pair(1);
    const Surface::Sampled r = s.Sample(normals, wo, u.x, u.y, l.x, l.y);
    if (r.Pdf > 0)
      sum += double(r.Diffuse.x + r.Specular.x) * r.Eta2;
  }
  return sum / n;
}
}

#endif
