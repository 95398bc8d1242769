// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBsdf_h
#define quellBsdf_h

#include "quellEnergyTables.h"
#include "quellSinCos.h"
#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace quell
{
constexpr float Pi = 3.14159265358979323846f;

/// Concentric map of the unit square to the unit disc (Shirley, Chiu 1997); keeps strata together.
inline Vec2f ConcentricDisc(float u, float v) noexcept
{
  const float a = 2 * u - 1, b = 2 * v - 1;
  if (a == 0 && b == 0)
    return {};
  float sine, cosine;
  if (std::fabs(a) > std::fabs(b))
  {
    SinCosEighth(Pi / 4 * (b / a), sine, cosine);
    return { a * cosine, a * sine };
  }
  SinCosEighth(Pi / 4 * (a / b), sine, cosine);
  return { b * sine, b * cosine };
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

/// GGX (Trowbridge-Reitz), isotropic, alpha = roughness^2, height-correlated Smith masking-shadowing:
///
///   D = 1 / (pi alpha^2 cos^4 (1 + tan^2 / alpha^2)^2)          Walter et al. 2007, eq. 33
///   Lambda = (sqrt(1 + alpha^2 tan^2) - 1) / 2                  Heitz 2014, eq. 72
///   G1 = 1 / (1 + Lambda),  G2 = 1 / (1 + Lambda_o + Lambda_i)  Heitz 2014, eqs. 43, 99
///
/// With s(cos) = sqrt(cos^2 + alpha^2 sin^2) (`Smith`), 1 + 2 Lambda = s / cos and nothing is divided by a cosine:
///
///   G2 / (4 cos_o cos_i) = 1 / (2 (s_o cos_i + s_i cos_o)),   G1 / cos = 2 / (cos + s)
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
inline float Smith(float cosine, float alpha2) noexcept
{
  const float c2 = cosine * cosine;
  return std::sqrt(c2 + alpha2 * std::max(0.f, 1 - c2));
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
/// D G2 cos_i / (4 cos_o cos_i): reflection for F = 1, times the cosine. Never divides by 0 where the cosines are not
/// negative.
inline float Reflection(float d, float co, float ci, float so, float si) noexcept
{
  return d * ci / std::max(2 * (so * ci + si * co), std::numeric_limits<float>::min());
}
/// D G1 / (4 cos_o): the pdf of reflection about visible normals, per solid angle (Heitz 2018).
inline float ReflectionPdf(float d, float co, float so) noexcept
{
  return d / (2 * (co + so));
}
/// G2 / G1(o): the weight of a sampled visible normal (Heitz 2018).
inline float MaskingRatio(float co, float ci, float so, float si) noexcept
{
  return ci > 0 ? ci * (co + so) / std::max(so * ci + si * co, std::numeric_limits<float>::min()) : 0;
}

/// Visible half vector for `wo` (local, wo.z > 0), by the projected hemisphere (Heitz 2018, "Sampling the GGX
/// distribution of visible normals").
inline Vec3f SampleVisibleNormal(const Vec3f& wo, float alpha, float u, float v) noexcept
{
  // in the frame of the plane through wo and the normal: first axis in it, second across
  const float sine = std::sqrt(wo.x * wo.x + wo.y * wo.y);
  const float turn = sine > 0 ? 1 / sine : 0, cx = wo.x * turn, cy = sine > 0 ? wo.y * turn : -1;
  const float length = std::sqrt(alpha * alpha * (sine * sine) + wo.z * wo.z), scale = 1 / length;
  const float wx = alpha * sine * scale, wz = wo.z * scale; // of the stretched wo
  float sinPhi, cosPhi;
  SinCosTurn(v, sinPhi, cosPhi);
  const float r = std::sqrt(u), px = r * cosPhi, h2 = std::max(0.f, 1 - px * px), s = (1 + wz) / 2;
  const float py = std::sqrt(h2) * (1 - s) + r * sinPhi * s;
  const float pz = std::sqrt(std::max(0.f, h2 - py * py));
  const float x = alpha * (pz * wx - py * wz), y = alpha * px, z = std::max(1e-6f, py * wx + pz * wz);
  const float unit = 1 / std::sqrt(x * x + y * y + z * z);
  return { (x * cx - y * cy) * unit, (x * cy + y * cx) * unit, z * unit };
}

/// The colour of light that was scattered several times, as a fraction of what single scattering lost: averages of the
/// Fresnel factor over every scattering but the last ones, F^2 E / (1 - F (1 - E)) with F = F0 + (F90 - F0) / 21 and E
/// the averages over the cosine (Fdez-Aguera 2019; Kulla, Conty 2017 with the first reflection counted too).
/// 1 for F = 1.
inline float MultipleFresnel(float f0, float f90, float average) noexcept
{
  const float f = f0 + (f90 - f0) / 21;
  return f * f * average / (1 - f * (1 - average));
}
}

/// Fresnel reflectance of a smooth dielectric for the cosine on the incident side (>= 0); eta = n_transmitted /
/// n_incident > 0. `cosTransmitted` is 0 at total internal reflection.
inline float FresnelDielectric(float cosine, float eta, float& cosTransmitted) noexcept
{
  const float c = std::min(1.f, std::max(0.f, cosine));
  if (eta == 1)
  {
    cosTransmitted = c;
    return 0;
  }
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

/// The normals of a point, unit, on the side that `wo` is on, and which side that is.
struct ShadingNormals
{
  Vec3f Geometric, Shading;
  bool Front = true;     ///< wo is on the outside
  Vec3f Coat{ 0, 0, 0 }; ///< of the clearcoat; zero: Shading
};

/// A material at one point, all textures resolved. Cosines are those with the shading normal, o the direction to the
/// viewer, i to the light; f is for radiance arriving from i. All lobes share one roughness but the coat's.
///
/// Opaque part, the glTF metallic-roughness model with its energy balance closed:
///
///   f = D G2 F / (4 cos_o cos_i)                                                      F = F0 + (F90 - F0) (1 - o.h)^5
///     + Fms (1 - E(cos_o)) (1 - E(cos_i)) / (pi (1 - E_avg))                          several scatterings
///     + diffuse (1 - Ed(cos_o)) (1 - Ed(cos_i)) / (pi (1 - Ed_avg))                   under the reflection
///
/// E is the directional albedo of the first term for F = 1 (EnergyTables), Fms its colour (ggx::MultipleFresnel); the
/// second term is Kulla and Conty's. Ed is the albedo of both for the dielectric's largest F0, so that white stays
/// white: every white material reflects exactly what arrives (within 1 %, the error of the tables). The form is
/// reciprocal, and Lambert where there is no reflection. (glTF's suggestion for the diffuse term, times 1 - F(o.h),
/// makes a white smooth dielectric reflect 1.7 at 87 degrees.) F0, F90 are those of the mix of metal and dielectric.
///
/// `Glass` is the part that transmits, with exact Fresnel equations. Below, eta is the index on the side of the light
/// over that on the side of the viewer:
///
///   reflected    D G2 F / (4 cos_o cos_i)
///   transmitted  (o.h) |i.h| / (cos_o |cos_i|) D G2 (1 - F) / (eta (i.h) + (o.h))^2,  h along o + eta i
///                                                                                     Walter 2007, eq. 21
///   both         what single scattering loses, L = 1 - E_reflected - E_transmitted:
///                (1 - t) L(cos_o) L(cos_i) / (pi L_avg)  and  t L(cos_o) L'(cos_i) / (pi L'_avg eta^2)
///
/// L' is that of the other side, t such that f / eta^2 is symmetric. Transmission has the factor 1 / eta^2 of radiance
/// (it is compressed into a smaller cone inside). `Thin` glass is a wall without thickness: what is transmitted is the
/// mirror image, at the plane, of a reflection with 1 - F (KHR_materials_transmission), so that rays pass straight
/// through a smooth one and none is bent on average through a rough one; F is that of a single interface. With
/// index 1 there is no interface at all: rays pass straight at any roughness. An index of 0 stands for F = 1.
/// The radiometrically exact reciprocity is f(o, i) / n_o^2 = f(i, o) / n_i^2.
///
/// `Coat` in [0, 1] is the weight of a dielectric layer (index 1.5) on top with a roughness and a normal of its own:
///
///   Coat D G2 F / (4 cos_o cos_i) + base x attenuation
///
/// With T = 1 - Coat Ec, Ec the layer's directional albedo, the attenuation is T(o) T(i) / T_avg for the terms of the
/// base that are flat in i, and s(o) s(i), s between sqrt(T) for a smooth and T / sqrt(T_avg) for a rough base, for
/// the others: reciprocal, and a white base stays white within 2 % (5 % at cosines below .2). Light that leaves
/// refracting glass passes it once, and what it would hold back is reflected inside.
///
/// Below alpha = 1e-3 a reflection is a perfect mirror of weight F(cos_o), and refraction perfect as well.
struct VTKQUELLRAYTRACING_EXPORT Surface
{
  static constexpr float MirrorAlpha = 1e-3f;
  static constexpr float CoatF0 = 0.04f;

  Vec3f Diffuse; ///< albedo of the diffuse lobe
  Vec3f F0;      ///< of the opaque reflection
  Vec3f F90;
  float DiffuseF0 = 0, DiffuseF90 = 0; ///< of the reflection above the diffuse lobe
  float Alpha = 1;
  float Glass = 0; ///< in [0, 1]
  Vec3f GlassTint{ 1, 1, 1 };
  float GlassIor = 1.5f, GlassSpecular = 1;
  Vec3f GlassF0; ///< at normal incidence, where GlassTinted; else the index says
  bool GlassTinted = false;
  bool Thin = true;
  float Coat = 0, CoatAlpha = 1;
  bool Multiple = true; ///< with the terms of several scatterings

  // Of Finish.
  bool HasDiffuse = false, HasSpecular = false, SpecularIsDelta = false, GlassIsDelta = true, CoatIsDelta = false;
  Vec3f Fms;              ///< colour of light scattered several times by the opaque reflection
  float MultiScale = 0;   ///< 1 / (pi (1 - E_avg)); 0 for a mirror
  float Under[3] = {};    ///< Ed = Under[0] + Under[1] E + Under[2] B
  float DiffuseScale = 0; ///< 1 / (1 - Ed_avg), 0 where the diffuse lobe vanishes
  float LumDiffuse = 0, LumF0 = 0, LumF90 = 0, LumFms = 0;
  EnergyTables::Row Row, CoatRow;                 ///< no table: a mirror
  const EnergyTables::Glass* GlassTables[2] = {}; ///< of rough refracting glass from outside and from inside
  float CoatAverage = 1;                          ///< T_avg

  // Of Prepare: chances of the lobes for the outgoing direction, and terms of its cosine.
  float PCosine = 0, PSpecular = 0, PGlass = 0, PCoat = 0; ///< PCosine: diffuse and several scatterings
  float OutLoss = 0;                                       ///< 1 - E
  float OutUnder = 1;                                      ///< 1 - Ed
  float OutSmith = 1;
  float OutPdf = 0; ///< of D in the pdf of the reflection, PSpecular / (2 (cos + OutSmith))

  /// Sets the lobes from their parameters; call after the members above.
  void Finish() noexcept;

  bool HasSmooth() const noexcept
  {
    return HasDiffuse || (HasSpecular && !SpecularIsDelta) || this->ScattersBelow() || (Coat > 0 && !CoatIsDelta);
  }
  bool HasDelta() const noexcept
  {
    return (Glass > 0 && GlassIsDelta) || (HasSpecular && SpecularIsDelta) || (Coat > 0 && CoatIsDelta);
  }
  /// Only perfect reflection and transmission: guides (albedo, normal) look through.
  bool IsPureDelta() const noexcept { return this->HasDelta() && !this->HasSmooth(); }
  /// Light from below can be seen by a light sample: rough glass.
  bool ScattersBelow() const noexcept { return Glass > 0 && !GlassIsDelta; }
  /// A thin smooth wall: part of the light passes straight.
  bool IsPane() const noexcept { return Glass > 0 && Thin && GlassIsDelta; }
  /// What a pane lets pass straight on, seen from `wo`: the mean of what Sample does so. Without Prepare.
  Vec3f StraightThrough(const ShadingNormals& normals, const Vec3f& wo) const noexcept;
  /// Sample reads uLobe or uSide.
  bool NeedsChoice() const noexcept { return HasSpecular || this->Layered(); }
  /// More than the opaque part.
  bool Layered() const noexcept { return Glass > 0 || Coat > 0; }

  Vec3f Fresnel(float cosine) const noexcept { return F0 + (F90 - F0) * SchlickWeight(cosine); }

  /// Directional albedos for guides, in [0, 1]: what the diffuse lobe, the rest, and both give back of uniform light
  /// (from below as well, for glass), seen under the cosine `cosOut` with the shading normal. Without Prepare.
  Vec3f AlbedoDiffuse(float cosOut) const noexcept;
  Vec3f AlbedoSpecular(float cosOut) const noexcept;
  Vec3f Albedo(float cosOut) const noexcept
  {
    return Clipped(this->AlbedoDiffuse(cosOut) + this->AlbedoSpecular(cosOut));
  }
  static Vec3f Clipped(const Vec3f& a) noexcept
  {
    return { std::min(1.f, a.x), std::min(1.f, a.y), std::min(1.f, a.z) };
  }

  /// Cosines below this count as it where the tables are read.
  static float Guarded(float cosine) noexcept { return std::min(1.f, std::max(1e-6f, cosine)); }
  static EnergyTables::Pair Energy(const EnergyTables::Row& row, float cosine) noexcept
  {
    const float mu = Guarded(cosine), w = SchlickWeight(mu);
    return row.Table ? EnergyTables::Look(row, mu, w) : EnergyTables::Pair{ 1, w };
  }

  /// Chances of the lobes for a viewer under `cosOut` = Dot(Shading, wo) > 0; before Evaluate and Sample of that wo.
  void Prepare(float cosOut) noexcept
  {
    if (!this->NeedsChoice())
    {
      PCosine = HasDiffuse ? 1.f : 0.f;
      return;
    }
    if (Glass > 0 && !HasDiffuse && !HasSpecular && !(Coat > 0))
    {
      PGlass = 1;
      return;
    }
    float diffuse = HasDiffuse ? LumDiffuse : 0, multi = 0, specular = 0;
    if (HasSpecular)
    {
      const EnergyTables::Pair e = Energy(Row, cosOut);
      OutLoss = 1 - e.E;
      OutUnder = std::max(0.f, 1 - (Under[0] + Under[1] * e.E + Under[2] * e.B));
      OutSmith = ggx::Smith(std::min(1.f, cosOut), Alpha * Alpha);
      diffuse *= OutUnder;
      // no less than 1 %: a nearly smooth surface sends little this way, but nearly all of it to grazing angles
      multi = MultiScale > 0 ? std::max(LumFms * OutLoss, 0.01f * LumF90) : 0;
      specular = LumF0 * (e.E - e.B) + LumF90 * e.B;
    }
    float glass = Glass, coat = 0;
    if (Coat > 0)
    {
      const EnergyTables::Pair c = Energy(CoatRow, cosOut);
      coat = Coat * (CoatF0 * (c.E - c.B) + c.B);
      diffuse *= 1 - coat;
      multi *= 1 - coat;
      specular *= 1 - coat;
      glass *= 1 - coat;
    }
    // No lobe that exists is picked less than one time in ten (or so, after the sum is 1 again); several scatterings
    // share the cosine lobe.
    const float floor = 0.1f * (diffuse + specular + glass + coat) + 1e-20f;
    diffuse = (HasDiffuse ? std::max(diffuse, floor) : 0) + multi;
    specular = HasSpecular ? std::max(specular, floor) : 0;
    glass = Glass > 0 ? std::max(glass, floor) : 0;
    coat = Coat > 0 ? std::max(coat, floor) : 0;
    const float scale = 1 / (diffuse + specular + glass + coat);
    PCosine = diffuse * scale;
    PSpecular = specular * scale;
    OutPdf = PSpecular * ggx::ReflectionPdf(1, cosOut, OutSmith);
    PGlass = glass * scale;
    PCoat = coat * scale;
  }

  /// The non-delta lobes between `wo` and `wi` (unit, world): value times |cos(Shading, wi)| of the diffuse lobe and of
  /// the others, and the pdf (per solid angle) with which Sample makes `wi` by them. `wi` may be on either side. 0
  /// where the two normals disagree about the side of `wi`.
  void Evaluate(const ShadingNormals& normals, const Vec3f& wo, const Vec3f& wi, Vec3f& diffuse, Vec3f& specular,
    float& pdf) const noexcept
  {
    diffuse = specular = Vec3f();
    pdf = 0;
    const Vec3f& n = normals.Shading;
    const float ci = Dot(n, wi), co = Dot(n, wo), side = Dot(normals.Geometric, wi);
    if (!(co > 0))
      return;
    if (this->Layered())
    {
      if (ci > 0 && side > 0)
        this->EvaluateAbove(normals, wo, wi, co, ci, diffuse, specular, pdf);
      else if (ci < 0 && side < 0 && this->ScattersBelow())
        this->EvaluateBelow(normals, wo, wi, co, -ci, specular, pdf);
      return;
    }
    if (!(ci > 0) || !(side > 0))
      return;
    Opaque o;
    if (HasSpecular && !SpecularIsDelta)
      this->EvaluateOpaque(co, ci, Between(n, wo, wi), o);
    else
      this->EvaluateOpaque(co, ci, {}, o);
    diffuse = o.Diffuse;
    specular = o.Single + o.Multi;
    pdf = o.Pdf;
  }

  struct Sampled
  {
    Vec3f Wi;
    Vec3f Diffuse, Specular; ///< f cos / pdf of the diffuse lobe and of the others (delta: lobe weight / chance)
    float Pdf = 0;           ///< of the non-delta lobes; 0: nothing sampled
    bool Delta = false, Transmitted = false;
    bool Straight = false; ///< passed a pane, as StraightThrough says
    float Eta2 = 1;        ///< squared relative index after refraction
  };

  /// uLobe, uSide pick the lobe; u, v the direction.
  Sampled Sample(
    const ShadingNormals& normals, const Vec3f& wo, float u, float v, float uLobe, float uSide) const noexcept
  {
    if (this->Layered())
      return this->SampleLayered(normals, wo, u, v, uLobe, uSide);
    Sampled out;
    const Vec3f &n = normals.Shading, &ng = normals.Geometric;
    const float co = Dot(n, wo);
    if (!(co > 0))
      return out;
    const bool rough = HasSpecular && !SpecularIsDelta;
    HalfVector half;
    float ci;
    if (uLobe < PCosine)
    {
      const Vec3f local = CosineHemisphere(u, v);
      out.Wi = Frame(n).ToWorld(local);
      ci = local.z;
      if (!(ci > 0) || !(Dot(ng, out.Wi) > 0))
        return out;
      if (!HasSpecular)
      {
        // Lambert: the cosine cancels
        out.Pdf = PCosine * ci / Pi;
        out.Diffuse = Diffuse / PCosine;
        return out;
      }
      if (rough)
        half = Between(n, wo, out.Wi);
    }
    else if (rough)
    {
      const Frame frame(n);
      const Vec3f local = frame.ToLocal(wo), m = ggx::SampleVisibleNormal(local, Alpha, u, v);
      half = { m.x * m.x + m.y * m.y, m.z, Dot(local, m) };
      out.Wi = Normalized(frame.ToWorld(m * (2 * half.Out) - local));
      ci = Dot(n, out.Wi);
      if (!(ci > 0) || !(Dot(ng, out.Wi) > 0))
        return out;
    }
    else
    {
      if (!(PSpecular > 0))
        return out;
      out.Wi = Normalized(n * (2 * co) - wo);
      out.Specular = this->Fresnel(co) / PSpecular;
      out.Delta = true;
      out.Pdf = Dot(ng, out.Wi) > 0 ? 1.f : 0.f;
      return out;
    }
    Opaque o;
    this->EvaluateOpaque(co, ci, half, o);
    out.Pdf = o.Pdf;
    const float scale = o.Pdf > 0 ? 1 / o.Pdf : 0;
    out.Diffuse = o.Diffuse * scale;
    out.Specular = (o.Single + o.Multi) * scale;
    return out;
  }

private:
  struct HalfVector
  {
    float Sin2 = 0, Cosine = 1, Out = 1; ///< with the normal, and with wo
  };
  static HalfVector Between(const Vec3f& n, const Vec3f& wo, const Vec3f& wi) noexcept
  {
    const Vec3f h = Normalized(wo + wi), x = Cross(n, h);
    return { Dot(x, x), Dot(n, h), Dot(wo, h) };
  }
  /// The opaque lobes, times cos_i, and the pdf by which they are sampled.
  struct Opaque
  {
    Vec3f Diffuse, Single, Multi;
    float Pdf = 0;
  };
  void EvaluateOpaque(float co, float ci, const HalfVector& half, Opaque& out) const noexcept
  {
    out.Pdf = PCosine * ci / Pi;
    if (!HasSpecular)
    {
      out.Diffuse = Diffuse * ((1 / Pi) * ci);
      return;
    }
    const EnergyTables::Pair e = Energy(Row, ci);
    if (HasDiffuse)
    {
      const float under = std::max(0.f, 1 - (Under[0] + Under[1] * e.E + Under[2] * e.B));
      out.Diffuse = Diffuse * (OutUnder * under * DiffuseScale * (ci / Pi));
    }
    if (SpecularIsDelta)
      return;
    out.Multi = Fms * (OutLoss * (1 - e.E) * MultiScale * ci);
    if (half.Out > 0)
    {
      const float d = ggx::D(half.Sin2, half.Cosine, Alpha), si = ggx::Smith(std::min(1.f, ci), Alpha * Alpha);
      out.Single = this->Fresnel(half.Out) * ggx::Reflection(d, co, ci, OutSmith, si);
      out.Pdf += d * OutPdf;
    }
  }

  struct GlassSide;
  GlassSide SideOf(bool front) const noexcept;
  struct GlassFresnel;
  GlassFresnel FresnelOfGlass(const GlassSide& side, float cosine) const noexcept;
  struct GlassMulti;
  GlassMulti MultiOfGlass(const GlassSide& side, float co) const noexcept;
  bool CoatOutside(const GlassSide& side) const noexcept;
  float CoatReflection(float cosine) const noexcept;
  float CoatFactor(float cosine) const noexcept;
  void EvaluateAbove(const ShadingNormals& normals, const Vec3f& wo, const Vec3f& wi, float co, float ci,
    Vec3f& diffuse, Vec3f& specular, float& pdf) const noexcept;
  void EvaluateBelow(const ShadingNormals& normals, const Vec3f& wo, const Vec3f& wi, float co, float ci,
    Vec3f& specular, float& pdf) const noexcept;
  Sampled SampleLayered(
    const ShadingNormals& normals, const Vec3f& wo, float u, float v, float uLobe, float uSide) const noexcept;
};
}

#endif
