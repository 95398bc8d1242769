// SPDX-License-Identifier: BSD-3-Clause
#include "quellMaterial.h"

namespace quell
{
namespace
{
/// F90 for which Schlick's formula has the cosine average of the exact Fresnel equations (within 2 %); 1 from an index
/// of 1.35 on, and 0 at 1, where no interface is left to reflect.
float GrazingReflection(float r) noexcept
{
  return std::min(1.f, 13.5f * std::fabs(r) / (1 + 6.8f * std::fabs(r)));
}
}

Surface MakeSurface(const Material& m, const MaterialValues& v) noexcept
{
  Surface s;
  const Vec3f base = Unit(v.BaseColor);
  const float metallic = Unit(v.Metallic), transmission = Unit(v.Transmission), roughness = Unit(v.Roughness);
  const float specular = Unit(v.Specular);
  // 0 stands for a reflection of 1 (KHR_materials_ior); far from 1 nothing changes any more
  const float ior = m.Ior == 0 ? 0 : m.Ior > 0 && std::isfinite(m.Ior) ? std::min(1e6f, std::max(1e-6f, m.Ior)) : 1.5f;
  const float r = (ior - 1) / (ior + 1), r0 = r * r;
  const Vec3f tint = Radiance(v.SpecularColor);
  const Vec3f unweighted = Unit(tint * r0), f0 = unweighted * specular;
  const float f90 = specular * GrazingReflection(r);
  const float opaque = (1 - metallic) * (1 - transmission);
  s.Alpha = roughness * roughness;
  s.Multiple = m.MultipleScattering;
  if (!m.Unlit)
  {
    s.Diffuse = base * opaque;
    s.DiffuseF0 = MaxComponent(f0);
    s.DiffuseF90 = f90;
    s.F0 = f0 * opaque + base * metallic;
    s.F90 = Vec3f(f90 * opaque + metallic);
    s.Glass = (1 - metallic) * transmission;
    s.Coat = Unit(v.Clearcoat);
    const float rough = Unit(v.ClearcoatRoughness);
    s.CoatAlpha = rough * rough;
  }
  s.GlassTint = base;
  s.GlassIor = ior;
  s.GlassSpecular = specular;
  s.GlassF0 = unweighted;
  s.GlassTinted = ior > 0 && r0 > 0 && (tint.x != 1 || tint.y != 1 || tint.z != 1);
  s.Thin = !(m.Volume && v.Thickness > 0);
  s.Finish();
  if (metallic > 0 && opaque > 0 && s.MultiScale > 0)
  {
    // light scattered several times stays within one of the two: their colours mix, not their Fresnel factors
    const float average = EnergyTables::Get().Average(s.Alpha).E;
    for (int c = 0; c < 3; ++c)
      s.Fms[c] =
        opaque * ggx::MultipleFresnel(f0[c], f90, average) + metallic * ggx::MultipleFresnel(base[c], 1, average);
    s.LumFms = Luminance(s.Fms);
  }
  return s;
}
}
