// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellMaterial_h
#define quellMaterial_h

#include "quellBsdf.h"
#include "quellScene.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace quell
{
/// v in [0, 1]; not a number: 0.
inline float Unit(float v) noexcept
{
  return v > 0 ? std::min(1.f, v) : 0;
}
inline Vec3f Unit(const Vec3f& v) noexcept
{
  return { Unit(v.x), Unit(v.y), Unit(v.z) };
}
/// A usable amount of light: not negative, not infinite, a number.
inline float Radiance(float v) noexcept
{
  return std::isfinite(v) && v > 0 ? v : 0;
}
inline Vec3f Radiance(const Vec3f& v) noexcept
{
  return { Radiance(v.x), Radiance(v.y), Radiance(v.z) };
}

/// Every texture that the path tracer reads of a material.
inline std::array<const TextureUse*, 11> TexturesOf(const Material& m) noexcept
{
  return { &m.BaseColorTexture, &m.MetallicRoughnessTexture, &m.NormalTexture, &m.EmissiveTexture,
    &m.TransmissionTexture, &m.SpecularTexture, &m.SpecularColorTexture, &m.ThicknessTexture, &m.ClearcoatTexture,
    &m.ClearcoatRoughnessTexture, &m.ClearcoatNormalTexture };
}

/// What textures and vertex colours may change of a material, at one point.
struct MaterialValues
{
  MaterialValues() = default;
  /// The material's own factors.
  explicit MaterialValues(const Material& m) noexcept
    : BaseColor(m.BaseColor)
    , SpecularColor(m.SpecularColor)
    , Metallic(m.Metallic)
    , Roughness(m.Roughness)
    , Transmission(m.Transmission)
    , Specular(m.Specular)
    , Clearcoat(m.Clearcoat)
    , ClearcoatRoughness(m.ClearcoatRoughness)
    , Thickness(m.Volume ? 1.f : 0.f)
  {
  }
  Vec3f BaseColor, SpecularColor;
  float Metallic = 1, Roughness = 1, Transmission = 0, Specular = 1, Clearcoat = 0, ClearcoatRoughness = 0;
  float Thickness = 0; ///< of the volume, as a factor; 0: thin
};

/// Some point of `m` may transmit, or have a clearcoat: textures lower factors, and a metal's transmission is 0.
inline bool MayTransmit(const Material& m) noexcept
{
  return m.Transmission > 0 && !m.Unlit && (!(m.Metallic >= 1) || m.MetallicRoughnessTexture.Texture >= 0);
}
/// Some point of `m`, whose factors make the surface `s`, may be a pane that light passes straight.
inline bool MayBePane(const Material& m, const Surface& s) noexcept
{
  return MayTransmit(m) && (!m.Volume || m.ThicknessTexture.Texture >= 0) &&
         (s.GlassIsDelta || m.MetallicRoughnessTexture.Texture >= 0);
}
inline bool MayBeLayered(const Material& m) noexcept
{
  return MayTransmit(m) || (m.Clearcoat > 0 && !m.Unlit);
}

/// The lobes of material `m` where textures give it the values `v`, after the formulas of glTF 2.0 (appendix B) and
/// KHR_materials_ior, _specular, _transmission, _volume and _clearcoat:
///
///   dielectric   F0 = specular min(1, ((ior - 1) / (ior + 1))^2 specularColor), F90 = specular
///   opaque       metallic: F0 = baseColor, F90 = 1; else diffuse baseColor below the dielectric reflection
///   transmission baseColor tints what passes; specular and specularColor act on its reflection
///
/// mixed linearly, with (1 - metallic) (1 - transmission) of the diffuse kind and (1 - metallic) transmission of glass.
/// Below an index of 1.35, F90 falls below glTF's 1, to 0 at 1: no interface is left to reflect. Any input is safe:
/// numbers outside of their range, infinite or not numbers.
VTKQUELLRAYTRACING_EXPORT Surface MakeSurface(const Material& m, const MaterialValues& v) noexcept;
}

#endif
