// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBsdf_h
#define quellBsdf_h

#include "quellVector.h"

#include <algorithm>
#include <cmath>

namespace quell
{
constexpr float Pi = 3.14159265358979323846f;

/// Concentric map of the unit square to the unit disc (Shirley, Chiu 1997); keeps strata together.
inline Vec2f ConcentricDisc(float u, float v) noexcept
{
  const float a = 2 * u - 1, b = 2 * v - 1;
  if (a == 0 && b == 0)
    return {};
  float r, t;
  if (std::fabs(a) > std::fabs(b))
  {
    r = a;
    t = Pi / 4 * (b / a);
  }
  else
  {
    r = b;
    t = Pi / 2 - Pi / 4 * (a / b);
  }
  return { r * std::cos(t), r * std::sin(t) };
}

/// Orthonormal frame around a unit normal, valid everywhere (Duff et al. 2017).
struct Frame
{
  Vec3f t, b, n;

  Frame() = default;
  explicit Frame(const Vec3f& normal) noexcept
    : n(normal)
  {
    const float s = std::copysign(1.f, n.z), a = -1 / (s + n.z), c = n.x * n.y * a;
    t = { 1 + s * n.x * n.x * a, s * c, -s * n.x };
    b = { c, s + n.y * n.y * a, -n.y };
  }
  Vec3f ToWorld(const Vec3f& v) const noexcept { return t * v.x + b * v.y + n * v.z; }
  Vec3f ToLocal(const Vec3f& v) const noexcept { return { Dot(t, v), Dot(b, v), Dot(n, v) }; }
};

/// Cosine-weighted direction about +z; pdf = z / pi.
inline Vec3f CosineHemisphere(float u, float v) noexcept
{
  const Vec2f d = ConcentricDisc(u, v);
  return { d.x, d.y, std::sqrt(std::max(0.f, 1 - d.x * d.x - d.y * d.y)) };
}

/// Power heuristic (exponent 2) for one sample of each strategy: a^2 / (a^2 + b^2) without squaring large numbers.
inline float PowerHeuristic(float a, float b) noexcept
{
  if (!(a > 0))
    return 0;
  if (std::isinf(a))
    return 1;
  const float r = b / a;
  return 1 / (1 + r * r);
}
inline float BalanceHeuristic(float a, float b) noexcept
{
  return !(a > 0) ? 0 : std::isinf(a) ? 1 : 1 / (1 + b / a);
}

/// GGX (Trowbridge-Reitz), isotropic, alpha = roughness^2.
namespace ggx
{
/// From the squared sine and the cosine of the angle between normal and half vector: near a mirror 1 - cos^2 has no
/// digits left in float.
inline float D(float sin2, float cosine, float alpha) noexcept
{
  const float c2 = cosine * cosine, a2 = alpha * alpha;
  const float k = c2 * a2 + sin2; // = alpha^2 cos^2 (1 + tan^2 / alpha^2)
  return cosine > 0 && k > 0 ? a2 / (Pi * k * k) : 0;
}
inline float Lambda(float cosine, float alpha) noexcept
{
  const float c = std::max(std::fabs(cosine), 1e-6f);
  const float tan2 = std::max(0.f, 1 - c * c) / (c * c);
  return (std::sqrt(1 + alpha * alpha * tan2) - 1) / 2;
}
inline float G1(float cosine, float alpha) noexcept
{
  return 1 / (1 + Lambda(cosine, alpha));
}
inline float G2(float co, float ci, float alpha) noexcept
{
  return 1 / (1 + Lambda(co, alpha) + Lambda(ci, alpha));
}

/// Visible half vector for `wo` (local, wo.z > 0), by the projected hemisphere (Heitz 2018).
inline Vec3f SampleVisibleNormal(const Vec3f& wo, float alpha, float u, float v) noexcept
{
  Vec3f w = Normalized(Vec3f(alpha * wo.x, alpha * wo.y, wo.z));
  if (w.z < 0)
    w = -w;
  const Vec3f t1 = w.z < 0.99999f ? Normalized(Vec3f(-w.y, w.x, 0)) : Vec3f(1, 0, 0);
  const Vec3f t2 = Cross(w, t1);
  const float r = std::sqrt(u), phi = 2 * Pi * v;
  const float px = r * std::cos(phi);
  float py = r * std::sin(phi);
  const float h = std::sqrt(std::max(0.f, 1 - px * px)), s = (1 + w.z) / 2;
  py = h * (1 - s) + py * s;
  const float pz = std::sqrt(std::max(0.f, 1 - px * px - py * py));
  const Vec3f m = t1 * px + t2 * py + w * pz;
  return Normalized(Vec3f(alpha * m.x, alpha * m.y, std::max(1e-6f, m.z)));
}
}

/// Fresnel reflectance of a smooth dielectric for the cosine on the incident side (>= 0); eta = n_transmitted /
/// n_incident. `cosTransmitted` is 0 at total internal reflection.
inline float FresnelDielectric(float cosine, float eta, float& cosTransmitted) noexcept
{
  const float c = std::min(1.f, std::max(0.f, cosine));
  const float sin2 = (1 - c * c) / (eta * eta);
  if (sin2 >= 1)
  {
    cosTransmitted = 0;
    return 1;
  }
  const float ct = cosTransmitted = std::sqrt(1 - sin2);
  const float rp = (eta * c - ct) / (eta * c + ct), rs = (c - eta * ct) / (c + eta * ct);
  return (rp * rp + rs * rs) / 2;
}

inline float FifthPower(float x) noexcept
{
  const float x2 = x * x;
  return x2 * x2 * x;
}
/// Schlick's (1 - cos)^5.
inline float SchlickWeight(float cosine) noexcept
{
  return FifthPower(std::min(1.f, std::max(0.f, 1 - cosine)));
}

/// A material at one point, all textures resolved. Reflection is the glTF metallic-roughness model,
///
///   f = D G F / (4 cos_o cos_i) + diffuse (1 - Fd(cos_o)) (1 - Fd(cos_i)) / ((1 - Fd_avg) pi),
///
/// F Schlick's with F0 and F90 of the mix of metal and dielectric, Fd its dielectric part (largest channel), Fd_avg its
/// cosine average F0 + (F90 - F0) / 21. glTF's own suggestion for the diffuse factor, 1 - Fd(o.h), creates energy (a
/// white smooth dielectric reflects 1.7 at 87 degrees); this one is reciprocal, sums to at most 1 and is exactly
/// Lambert when the material has no dielectric reflection. Below alpha = 1e-3 the reflection is a perfect mirror of
/// weight F(cos_o). `Glass` is the part of the surface that transmits: a smooth dielectric with the exact Fresnel
/// equations, refracting when `Eta` is not 0 and straight through (infinitely thin) else.
struct Surface
{
  static constexpr float MirrorAlpha = 1e-3f;

  Vec3f Diffuse; ///< albedo of the diffuse lobe
  Vec3f F0;      ///< of the opaque reflection
  Vec3f F90;
  float DiffuseF0 = 0, DiffuseF90 = 0;
  float Alpha = 1;
  float Glass = 0; ///< in [0, 1]
  Vec3f GlassTint{ 1, 1, 1 };
  float GlassIor = 1.5f, GlassSpecular = 1;
  bool Thin = true;
  bool HasDiffuse = false, HasSpecular = false, SpecularIsDelta = false;

  /// Chances of the lobes for the outgoing direction; set by Prepare.
  float PDiffuse = 0, PSpecular = 0, PGlass = 0;
  float DiffuseScale = 0; ///< 1 / (1 - Fd_avg), 0 where the diffuse lobe vanishes

  /// Sets the lobes from their parameters; call after the members above.
  void Finish() noexcept
  {
    const float average = DiffuseF0 + (DiffuseF90 - DiffuseF0) / 21;
    DiffuseScale = average < 0.9999f ? 1 / (1 - average) : 0;
    HasDiffuse = DiffuseScale > 0 && MaxComponent(Diffuse) > 0;
    HasSpecular = MaxComponent(F0) > 0 || MaxComponent(F90) > 0;
    SpecularIsDelta = Alpha < MirrorAlpha;
  }
  bool HasSmooth() const noexcept { return HasDiffuse || (HasSpecular && !SpecularIsDelta); }
  bool HasDelta() const noexcept { return Glass > 0 || (HasSpecular && SpecularIsDelta); }
  /// Only perfect reflection and transmission: guides (albedo, normal) look through.
  bool IsPureDelta() const noexcept { return this->HasDelta() && !this->HasSmooth(); }

  Vec3f Fresnel(float cosine) const noexcept { return F0 + (F90 - F0) * SchlickWeight(cosine); }
  float DiffuseFresnel(float cosine) const noexcept
  {
    return DiffuseF0 + (DiffuseF90 - DiffuseF0) * SchlickWeight(cosine);
  }

  /// Reflectance as guides use it, in [0, 1]: diffuse albedo under the reflection at normal incidence, plus that.
  Vec3f Albedo() const noexcept
  {
    const Vec3f a = Diffuse * (HasDiffuse ? 1 - DiffuseF0 : 0.f) + F0;
    return { std::min(1.f, a.x), std::min(1.f, a.y), std::min(1.f, a.z) };
  }

  void Prepare(float cosOut) noexcept
  {
    float d = 0, s = 0;
    if (HasDiffuse)
      d = HasSpecular ? Luminance(Diffuse) * (1 - this->DiffuseFresnel(cosOut)) : 1.f;
    if (HasSpecular)
      s = HasDiffuse || Glass > 0 ? Luminance(this->Fresnel(cosOut)) : 1.f;
    if (!HasSpecular && Glass == 0)
    {
      PDiffuse = HasDiffuse ? 1.f : 0.f;
      PSpecular = PGlass = 0;
      return;
    }
    // No lobe that exists is picked less than one time in ten (or so, after the sum is 1 again).
    const float g = Glass, floor = 0.1f * (d + s + g);
    d = HasDiffuse ? std::max(d, floor) : 0;
    s = HasSpecular ? std::max(s, floor) : 0;
    const float e = g > 0 ? std::max(g, floor) : 0, sum = d + s + e;
    const float scale = sum > 0 ? 1 / sum : 0;
    PDiffuse = d * scale;
    PSpecular = s * scale;
    PGlass = e * scale;
  }

  /// The non-delta lobes for both directions (unit, world), `n` the shading normal: diffuse and specular values without
  /// the cosine, and the pdf (per solid angle) with which Sample makes `wi` by them.
  void Evaluate(
    const Vec3f& n, const Vec3f& wo, const Vec3f& wi, Vec3f& diffuse, Vec3f& specular, float& pdf) const noexcept
  {
    diffuse = specular = Vec3f();
    pdf = 0;
    const float ci = Dot(n, wi), co = Dot(n, wo);
    if (!(ci > 0) || !(co > 0))
      return;
    if (HasDiffuse)
    {
      float k = 1 / Pi;
      if (DiffuseF90 > 0 || DiffuseF0 > 0)
        k *= (1 - this->DiffuseFresnel(co)) * (1 - this->DiffuseFresnel(ci)) * DiffuseScale;
      diffuse = Diffuse * k;
      pdf = PDiffuse * ci / Pi;
    }
    if (HasSpecular && !SpecularIsDelta)
    {
      const Vec3f h = Normalized(wo + wi), x = Cross(n, h);
      const float oh = Dot(wo, h);
      if (oh > 0)
      {
        const float d = ggx::D(Dot(x, x), Dot(n, h), Alpha);
        const float lo = ggx::Lambda(co, Alpha), li = ggx::Lambda(ci, Alpha);
        const float c = std::max(co, 1e-6f);
        specular = this->Fresnel(oh) * (d / ((1 + lo + li) * 4 * c * std::max(ci, 1e-6f)));
        pdf += PSpecular * d / ((1 + lo) * 4 * c); // G1 D (o.h) / cos_o / (4 o.h)
      }
    }
  }

  struct Sampled
  {
    Vec3f Wi;
    Vec3f Weight;  ///< f cos / pdf (delta: lobe weight / chance)
    float Pdf = 0; ///< of the non-delta lobes; 0: nothing sampled
    bool Delta = false, Transmitted = false;
    float Eta2 = 1; ///< squared relative index after refraction
  };

  /// `ng`: geometric normal on wo's side; `front`: wo is on the outside. uLobe, uSide pick the lobe; u, v the
  /// direction.
  Sampled Sample(const Vec3f& n, const Vec3f& ng, const Vec3f& wo, bool front, float u, float v, float uLobe,
    float uSide) const noexcept
  {
    Sampled out;
    const float co = Dot(n, wo);
    if (uLobe < PDiffuse || (HasSpecular && !SpecularIsDelta && uLobe < PDiffuse + PSpecular))
    {
      const Frame frame(n);
      if (uLobe < PDiffuse)
        out.Wi = frame.ToWorld(CosineHemisphere(u, v));
      else
      {
        const Vec3f m = frame.ToWorld(ggx::SampleVisibleNormal(frame.ToLocal(wo), Alpha, u, v));
        out.Wi = Normalized(m * (2 * Dot(wo, m)) - wo);
      }
      if (!HasSpecular && DiffuseF90 == 0 && DiffuseF0 == 0)
      {
        // Lambert: the cosine cancels
        const float ci = Dot(n, out.Wi);
        out.Pdf = ci > 0 && Dot(ng, out.Wi) > 0 ? PDiffuse * ci / Pi : 0;
        out.Weight = Diffuse / PDiffuse;
        return out;
      }
      Vec3f d, s;
      this->Evaluate(n, wo, out.Wi, d, s, out.Pdf);
      if (Dot(ng, out.Wi) > 0 && out.Pdf > 0)
        out.Weight = (d + s) * (Dot(n, out.Wi) / out.Pdf);
      else
        out.Pdf = 0;
      return out;
    }
    out.Delta = true;
    out.Pdf = 1;
    if (HasSpecular && SpecularIsDelta && uLobe < PDiffuse + PSpecular)
    {
      out.Wi = Normalized(n * (2 * co) - wo);
      out.Weight = this->Fresnel(co) / PSpecular;
      if (!(Dot(ng, out.Wi) > 0))
        out.Pdf = 0;
      return out;
    }
    if (!(PGlass > 0))
    {
      out.Pdf = 0;
      return out;
    }
    const float eta = !(GlassIor > 0) ? 1.f : Thin || front ? GlassIor : 1 / GlassIor;
    float ct = 0, f = FresnelDielectric(co, eta, ct);
    if (!(GlassIor > 0))
      f = 1;
    else if (ct > 0)
      f *= GlassSpecular;
    const float part = Glass / PGlass;
    if (uSide < f)
    {
      out.Wi = Normalized(n * (2 * co) - wo);
      out.Weight = Vec3f(part);
      if (!(Dot(ng, out.Wi) > 0))
        out.Pdf = 0;
      return out;
    }
    out.Transmitted = true;
    out.Weight = GlassTint * part;
    if (Thin)
    {
      out.Wi = -wo;
      return out;
    }
    out.Wi = Normalized(wo * (-1 / eta) + n * (co / eta - ct));
    out.Eta2 = eta * eta;
    out.Weight *= 1 / out.Eta2; // radiance is compressed into a smaller cone inside
    if (!(Dot(ng, out.Wi) < 0))
      out.Pdf = 0;
    return out;
  }
};
}

#endif
