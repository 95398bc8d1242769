// SPDX-License-Identifier: BSD-3-Clause
// What Surface does once or rarely: set-up, glass and clearcoat.
#include "quellBsdf.h"

namespace quell
{
namespace
{
/// Schlick's Fresnel factor averaged over the cosine.
float SchlickAverage(float f0, float f90) noexcept
{
  return f0 + (f90 - f0) / 21;
}
Vec3f Mirrored(const Vec3f& v, const Vec3f& n) noexcept
{
  return v - n * (2 * Dot(n, v));
}
/// The smaller of the indices on the two sides over the larger one differs from 1 so little that no lobe can be told
/// from a straight ray.
bool Matched(float ior, float alpha) noexcept
{
  const float d = std::fabs(ior - 1);
  return d < 1e-3f || d * alpha < 1e-5f;
}
}

/// The glass as seen from one side.
struct Surface::GlassSide
{
  float Eta = 1;       ///< index beyond over index here
  bool Inside = false; ///< of a volume
};
void Surface::Finish() noexcept
{
  HasSpecular = MaxComponent(F0) > 0 || MaxComponent(F90) > 0;
  SpecularIsDelta = Alpha < MirrorAlpha;
  GlassIsDelta = Alpha < MirrorAlpha || (GlassIor > 0 && Matched(GlassIor, Alpha));
  CoatIsDelta = CoatAlpha < MirrorAlpha;
  if (!HasSpecular)
    DiffuseF0 = DiffuseF90 = 0;

  float reflected = SchlickAverage(DiffuseF0, DiffuseF90); // by what lies above the diffuse lobe
  Row = {};
  Fms = Vec3f();
  MultiScale = 0;
  Under[0] = 0;
  Under[1] = DiffuseF0;
  if (Alpha >= MirrorAlpha && HasSpecular)
  {
    const EnergyTables& tables = EnergyTables::Get();
    Row = tables.At(Alpha);
    const EnergyTables::Pair average = tables.Average(Alpha);
    float multi = 0;
    if (Multiple)
    {
      for (int c = 0; c < 3; ++c)
        Fms[c] = ggx::MultipleFresnel(F0[c], F90[c], average.E);
      MultiScale = 1 / (Pi * std::max(1e-6f, 1 - average.E));
      multi = ggx::MultipleFresnel(DiffuseF0, DiffuseF90, average.E);
    }
    Under[0] = multi;
    Under[1] = DiffuseF0 - multi;
    reflected = multi + Under[1] * average.E + (DiffuseF90 - DiffuseF0) * average.B;
  }
  Under[2] = DiffuseF90 - DiffuseF0;
  DiffuseScale = reflected < 0.9999f ? 1 / (1 - reflected) : 0;
  HasDiffuse = DiffuseScale > 0 && MaxComponent(Diffuse) > 0;
  LumDiffuse = Luminance(Diffuse);
  LumF0 = Luminance(F0);
  LumF90 = Luminance(F90);
  LumFms = Luminance(Fms);

  GlassTables[0] = GlassTables[1] = nullptr;
  if (this->ScattersBelow() && !Thin && Multiple)
    for (bool inside : { false, true })
      GlassTables[inside] = &EnergyTables::GetGlass(this->SideOf(!inside).Eta);

  CoatRow = {};
  if (Coat > 0)
  {
    float e = SchlickAverage(CoatF0, 1);
    if (!CoatIsDelta)
    {
      const EnergyTables& tables = EnergyTables::Get();
      CoatRow = tables.At(CoatAlpha);
      const EnergyTables::Pair average = tables.Average(CoatAlpha);
      e = CoatF0 * (average.E - average.B) + average.B;
    }
    CoatAverage = 1 - Coat * e;
  }
}

struct Surface::GlassFresnel
{
  Vec3f Reflected;
  float Chance = 1;  ///< of reflection
  float Through = 0; ///< what the interface itself transmits; less than 1 - Chance where a coat sends some back
  float CosTransmitted = 0;
};
/// Of what single scattering loses.
struct Surface::GlassMulti
{
  float Loss = 0;            ///< L(cos_o)
  float Chance = 0;          ///< that Sample uses this lobe: the loss, but 1 % at least, as in Prepare
  float Here = 0, There = 0; ///< 1 / (pi L_avg) on this and on the other side
  float Up = 1;              ///< share that is reflected
};

Surface::GlassSide Surface::SideOf(bool front) const noexcept
{
  GlassSide side;
  side.Inside = !Thin && !front && Glass > 0;
  const float ior = GlassIor > 0 ? GlassIor : 1e6f;
  side.Eta = side.Inside ? 1 / ior : ior;
  return side;
}

/// Light that comes from within glass meets the coat from below.
bool Surface::CoatOutside(const GlassSide& side) const noexcept
{
  return Coat > 0 && !side.Inside;
}

Surface::GlassFresnel Surface::FresnelOfGlass(const GlassSide& side, float cosine) const noexcept
{
  GlassFresnel out;
  const float f = FresnelDielectric(cosine, side.Eta, out.CosTransmitted);
  if (!(GlassIor > 0) || !(out.CosTransmitted > 0))
  {
    out.Reflected = Vec3f(1.f);
    return out;
  }
  if (GlassTinted)
  {
    // the exact curve, stretched from its own value at normal incidence to that of each colour
    const float r = (side.Eta - 1) / (side.Eta + 1), r0 = r * r;
    const float s = r0 < 1 ? std::min(1.f, std::max(0.f, (f - r0) / (1 - r0))) : 1;
    out.Reflected = (GlassF0 + (Vec3f(1.f) - GlassF0) * s) * GlassSpecular;
    out.Chance = MaxComponent(out.Reflected);
  }
  else
  {
    out.Chance = f * GlassSpecular;
    out.Reflected = Vec3f(out.Chance);
  }
  out.Through = 1 - out.Chance;
  if (side.Inside && Coat > 0)
  {
    const float back = out.Through * this->CoatReflection(out.CosTransmitted);
    out.Reflected += Vec3f(back);
    out.Chance += back;
  }
  return out;
}

Surface::GlassMulti Surface::MultiOfGlass(const GlassSide& side, float co) const noexcept
{
  GlassMulti out;
  if (!Multiple)
    return out;
  // hemispherical reflectance of a dielectric from outside, fitted by Kulla and Conty (2017)
  const float index = std::max(side.Eta, 1 / side.Eta);
  const float reflected =
    GlassIor > 0 ? GlassSpecular * std::min(1.f, (index - 1) / (4.08567f + 1.00071f * index)) : 1.f;
  if (Thin)
  {
    const EnergyTables& tables = EnergyTables::Get();
    const float lost = std::max(1e-6f, 1 - tables.Average(Alpha).E);
    out.Loss = 1 - Energy(tables.At(Alpha), co).E;
    out.Here = out.There = 1 / (Pi * lost);
    out.Up = reflected;
    out.Chance = std::max(out.Loss, 0.01f);
    return out;
  }
  const EnergyTables::Glass &table = *GlassTables[side.Inside], &other = *GlassTables[!side.Inside];
  const float here = table.AverageAt(Alpha, GlassSpecular), there = other.AverageAt(Alpha, GlassSpecular);
  if (!(here > 1e-6f) || !(there > 1e-6f))
    return out;
  out.Loss = table.At(Guarded(co), Alpha, GlassSpecular);
  out.Chance = std::max(out.Loss, 0.01f);
  out.Here = 1 / (Pi * here);
  out.There = 1 / (Pi * there);
  const float back = there * side.Eta * side.Eta;
  out.Up = 1 - (1 - reflected) * back / std::max(here, back);
  return out;
}

float Surface::CoatReflection(float cosine) const noexcept
{
  const EnergyTables::Pair e = Energy(CoatRow, cosine);
  return Coat * (CoatF0 * (e.E - e.B) + e.B);
}

/// s(mu): near the mirror direction of a smooth base both cosines are one, so that s is the root of T; light that a
/// rough or a grazing view spreads out sees the average of T. What lies between was fitted to white furnaces (E + Fms
/// bases of any roughness below coats of any roughness): off by 1.4 % (root mean square), 5 % at most from mu = .05 on.
float Surface::CoatFactor(float cosine) const noexcept
{
  const float t = std::max(0.f, 1 - this->CoatReflection(cosine)), root = std::sqrt(t);
  const float v = Alpha / (4 * Guarded(cosine) + Alpha);
  const float spread = v * ((1.2f + 0.1f * Alpha) * (1.7f - 0.7f * v) - 0.4f * v * v);
  return std::max(0.f, root + (t / std::sqrt(CoatAverage) - root) * spread);
}

void Surface::EvaluateAbove(const ShadingNormals& normals, const Vec3f& wo, const Vec3f& wi, float co, float ci,
  Vec3f& diffuse, Vec3f& specular, float& pdf) const noexcept
{
  const GlassSide side = this->SideOf(normals.Front);
  const Vec3f h = Normalized(wo + wi);
  const auto about = [&](const Vec3f& n)
  {
    const Vec3f x = Cross(n, h);
    return HalfVector{ Dot(x, x), Dot(n, h), Dot(wo, h) };
  };
  const HalfVector half = about(normals.Shading);
  Opaque o;
  this->EvaluateOpaque(co, ci, half, o);
  if (this->ScattersBelow())
  {
    const float a2 = Alpha * Alpha, so = ggx::Smith(std::min(1.f, co), a2), si = ggx::Smith(std::min(1.f, ci), a2);
    const float chance = side.Inside ? PGlass + PCoat : PGlass;
    const GlassMulti multi = this->MultiOfGlass(side, co);
    if (half.Out > 0)
    {
      const float d = ggx::D(half.Sin2, half.Cosine, Alpha);
      const GlassFresnel f = this->FresnelOfGlass(side, half.Out);
      o.Single += f.Reflected * (Glass * ggx::Reflection(d, co, ci, so, si));
      o.Pdf += chance * (1 - multi.Chance) * f.Chance * ggx::ReflectionPdf(d, co, so);
    }
    if (multi.Chance > 0)
    {
      const float loss = Thin ? 1 - Energy(EnergyTables::Get().At(Alpha), ci).E
                              : GlassTables[side.Inside]->At(Guarded(ci), Alpha, GlassSpecular);
      o.Multi += Vec3f(Glass * multi.Up * multi.Loss * loss * multi.Here * ci);
      o.Pdf += chance * multi.Chance * multi.Up * ci / Pi;
    }
  }
  diffuse = o.Diffuse;
  if (!this->CoatOutside(side))
  {
    specular = o.Single + o.Multi;
    pdf = o.Pdf;
    return;
  }
  const Vec3f& n = normals.Coat == Vec3f() ? normals.Shading : normals.Coat;
  const float no = Dot(n, wo), ni = Dot(n, wi);
  const float to = 1 - this->CoatReflection(std::fabs(no)), ti = 1 - this->CoatReflection(std::fabs(ni));
  const float flat = to * ti / CoatAverage;
  diffuse *= flat;
  specular = o.Single * (this->CoatFactor(std::fabs(no)) * this->CoatFactor(std::fabs(ni))) + o.Multi * flat;
  pdf = o.Pdf;
  if (!CoatIsDelta && no > 0 && ni > 0)
  {
    const HalfVector top = about(n);
    if (top.Out > 0)
    {
      const float a2 = CoatAlpha * CoatAlpha;
      const float so = ggx::Smith(std::min(1.f, no), a2), si = ggx::Smith(std::min(1.f, ni), a2);
      const float d = ggx::D(top.Sin2, top.Cosine, CoatAlpha);
      // the layer's own cosine: it would not conserve energy with that of the normal below
      const float f = CoatF0 + (1 - CoatF0) * SchlickWeight(top.Out);
      specular += Vec3f(Coat * f * ggx::Reflection(d, no, ni, so, si));
      pdf += PCoat * ggx::ReflectionPdf(d, no, so);
    }
  }
}

void Surface::EvaluateBelow(const ShadingNormals& normals, const Vec3f& wo, const Vec3f& wi, float co, float ci,
  Vec3f& specular, float& pdf) const noexcept
{
  const GlassSide side = this->SideOf(normals.Front);
  const Vec3f& n = normals.Shading;
  const float a2 = Alpha * Alpha, so = ggx::Smith(std::min(1.f, co), a2), si = ggx::Smith(std::min(1.f, ci), a2);
  const float chance = side.Inside ? PGlass + PCoat : PGlass;
  const GlassMulti multi = this->MultiOfGlass(side, co);
  const float compression = Thin ? 1 : 1 / (side.Eta * side.Eta);
  float value = 0;
  if (Thin)
  {
    const HalfVector half = Between(n, wo, Mirrored(wi, n));
    if (half.Out > 0)
    {
      const GlassFresnel f = this->FresnelOfGlass(side, half.Out);
      const float d = ggx::D(half.Sin2, half.Cosine, Alpha);
      value = f.Through * ggx::Reflection(d, co, ci, so, si);
      pdf = chance * (1 - multi.Chance) * (1 - f.Chance) * ggx::ReflectionPdf(d, co, so);
    }
  }
  else
  {
    Vec3f h = wo + wi * side.Eta;
    const float length2 = Dot(h, h);
    h = Normalized(h);
    if (Dot(n, h) < 0)
      h = -h;
    const float oh = Dot(wo, h), ih = -Dot(wi, h);
    // a microfacet is seen from its front by wo and from behind by wi
    if (oh > 0 && ih > 0 && length2 > 0)
    {
      const Vec3f x = Cross(n, h);
      const GlassFresnel f = this->FresnelOfGlass(side, oh);
      const float d = ggx::D(Dot(x, x), Dot(n, h), Alpha);
      const float jacobian = 4 * ih * oh / length2; // |h'|^2 = (eta (i.h) + (o.h))^2
      value = f.Through * ggx::Reflection(d, co, ci, so, si) * jacobian;
      pdf =
        chance * (1 - multi.Chance) * (1 - f.Chance) * ggx::ReflectionPdf(d, co, so) * jacobian * side.Eta * side.Eta;
    }
  }
  if (multi.Chance > 0)
  {
    const float loss = Thin ? 1 - Energy(EnergyTables::Get().At(Alpha), ci).E
                            : GlassTables[!side.Inside]->At(Guarded(ci), Alpha, GlassSpecular);
    value += (1 - multi.Up) * multi.Loss * loss * multi.There * ci * compression;
    pdf += chance * multi.Chance * (1 - multi.Up) * ci / Pi;
  }
  if (Coat > 0)
  {
    const Vec3f& top = normals.Coat == Vec3f() ? n : normals.Coat;
    const float no = std::fabs(Dot(top, wo)), ni = std::fabs(Dot(top, wi));
    value *= Thin ? this->CoatFactor(no) * this->CoatFactor(ni) : 1 - this->CoatReflection(side.Inside ? ni : no);
  }
  specular = GlassTint * (Glass * value);
}

Surface::Sampled Surface::SampleLayered(
  const ShadingNormals& normals, const Vec3f& wo, float u, float v, float uLobe, float uSide) const noexcept
{
  Sampled out;
  const Vec3f &n = normals.Shading, &ng = normals.Geometric;
  const Vec3f& top = normals.Coat == Vec3f() ? n : normals.Coat;
  const float co = Dot(n, wo);
  if (!(co > 0))
    return out;
  const GlassSide side = this->SideOf(normals.Front);
  const bool coated = this->CoatOutside(side);
  const float chanceCoat = coated ? PCoat : 0, chanceGlass = coated ? PGlass : PGlass + PCoat;
  // Attenuation by the coat for two directions on this side.
  const auto attenuation = [&](const Vec3f& wi)
  { return coated ? this->CoatFactor(std::fabs(Dot(top, wo))) * this->CoatFactor(std::fabs(Dot(top, wi))) : 1.f; };
  const auto perfect = [&](const Vec3f& wi, const Vec3f& weight)
  {
    out.Wi = wi;
    out.Specular = weight;
    out.Delta = true;
    out.Pdf = (Dot(ng, wi) > 0) == !out.Transmitted ? 1.f : 0.f;
  };
  if (uLobe < PCosine)
    out.Wi = Frame(n).ToWorld(CosineHemisphere(u, v));
  else if (uLobe < PCosine + PSpecular)
  {
    if (SpecularIsDelta)
    {
      const Vec3f wi = Normalized(n * (2 * co) - wo);
      perfect(wi, this->Fresnel(co) * (attenuation(wi) / PSpecular));
      return out;
    }
    const Frame frame(n);
    const Vec3f m = frame.ToWorld(ggx::SampleVisibleNormal(frame.ToLocal(wo), Alpha, u, v));
    out.Wi = Normalized(m * (2 * Dot(wo, m)) - wo);
  }
  else if (uLobe < PCosine + PSpecular + chanceCoat)
  {
    const float no = Dot(top, wo);
    if (!(no > 0))
      return out;
    if (CoatIsDelta)
    {
      perfect(Normalized(top * (2 * no) - wo), Vec3f(Coat * (CoatF0 + (1 - CoatF0) * SchlickWeight(no)) / chanceCoat));
      if (!(Dot(n, out.Wi) > 0))
        out.Pdf = 0;
      return out;
    }
    const Frame frame(top);
    const Vec3f m = frame.ToWorld(ggx::SampleVisibleNormal(frame.ToLocal(wo), CoatAlpha, u, v));
    out.Wi = Normalized(m * (2 * Dot(wo, m)) - wo);
  }
  else
  {
    if (!(chanceGlass > 0))
      return out;
    const float part = Glass / chanceGlass;
    if (GlassIsDelta)
    {
      const GlassFresnel f = this->FresnelOfGlass(side, co);
      if (uSide < f.Chance)
      {
        const Vec3f wi = Normalized(n * (2 * co) - wo);
        perfect(wi, f.Reflected * (part * attenuation(wi) / f.Chance));
        return out;
      }
      out.Transmitted = true;
      if (Thin)
      {
        perfect(-wo, GlassTint * (part * attenuation(-wo)));
        out.Straight = true;
        return out;
      }
      const float eta = side.Eta;
      out.Eta2 = eta * eta;
      const Vec3f wi = Normalized(wo * (-1 / eta) + n * (co / eta - f.CosTransmitted));
      // from inside the coat's share is in f already
      const float through = coated ? 1 - this->CoatReflection(std::fabs(Dot(top, wo))) : 1;
      perfect(wi, GlassTint * (part * through / out.Eta2));
      return out;
    }
    const GlassMulti multi = this->MultiOfGlass(side, co);
    const float again = (uLobe - (PCosine + PSpecular + chanceCoat)) / chanceGlass;
    const Frame frame(n);
    if (again < multi.Chance)
    {
      Vec3f local = CosineHemisphere(u, v);
      if (!(uSide < multi.Up))
        local.z = -local.z;
      out.Wi = frame.ToWorld(local);
    }
    else
    {
      const Vec3f m = frame.ToWorld(ggx::SampleVisibleNormal(frame.ToLocal(wo), Alpha, u, v));
      const float oh = Dot(wo, m);
      if (!(oh > 0))
        return out;
      const GlassFresnel f = this->FresnelOfGlass(side, oh);
      if (uSide < f.Chance)
        out.Wi = Normalized(m * (2 * oh) - wo);
      else if (Thin)
        out.Wi = Mirrored(Normalized(m * (2 * oh) - wo), n);
      else
        out.Wi = Normalized(wo * (-1 / side.Eta) + m * (oh / side.Eta - f.CosTransmitted));
      // a microfacet that sends reflection below, or refraction above, is blocked by others
      if ((Dot(n, out.Wi) > 0) != (uSide < f.Chance))
        return out;
    }
    out.Transmitted = Dot(n, out.Wi) < 0;
    if (out.Transmitted && !Thin)
      out.Eta2 = side.Eta * side.Eta;
  }
  // what the other lobes send below is absorbed: Evaluate would take it for glass
  if (!out.Transmitted && !(Dot(n, out.Wi) > 0))
    return out;
  this->Evaluate(normals, wo, out.Wi, out.Diffuse, out.Specular, out.Pdf);
  const float scale = out.Pdf > 0 ? 1 / out.Pdf : 0;
  out.Diffuse *= scale;
  out.Specular *= scale;
  return out;
}

Vec3f Surface::StraightThrough(const ShadingNormals& normals, const Vec3f& wo) const noexcept
{
  const float co = Dot(normals.Shading, wo);
  if (!this->IsPane() || !(co > 0))
    return {};
  const GlassSide side = this->SideOf(normals.Front);
  float coat = 1;
  if (this->CoatOutside(side))
  {
    const Vec3f& top = normals.Coat == Vec3f() ? normals.Shading : normals.Coat;
    coat = this->CoatFactor(std::fabs(Dot(top, wo)));
  }
  return GlassTint * (Glass * (1 - this->FresnelOfGlass(side, co).Chance) * coat * coat);
}

Vec3f Surface::AlbedoDiffuse(float cosOut) const noexcept
{
  if (!HasDiffuse)
    return {};
  const EnergyTables::Pair e = Energy(Row, cosOut);
  float under = std::max(0.f, 1 - (Under[0] + Under[1] * e.E + Under[2] * e.B));
  if (Coat > 0)
    under *= 1 - this->CoatReflection(cosOut);
  return Clipped(Diffuse * under);
}

Vec3f Surface::AlbedoSpecular(float cosOut) const noexcept
{
  Vec3f out;
  if (HasSpecular)
  {
    const EnergyTables::Pair e = Energy(Row, cosOut);
    out = F0 * (e.E - e.B) + F90 * e.B + Fms * (1 - e.E);
  }
  if (Glass > 0)
  {
    // microfacets that a grazing view sees are tilted towards it
    const GlassFresnel f = this->FresnelOfGlass(this->SideOf(true), cosOut + (1 - cosOut) * 0.4f * Alpha);
    out += (f.Reflected + GlassTint * (1 - f.Chance)) * Glass;
  }
  if (Coat > 0)
  {
    const float coat = this->CoatReflection(cosOut);
    out = out * (1 - coat) + Vec3f(coat);
  }
  return Clipped(out);
}
}
