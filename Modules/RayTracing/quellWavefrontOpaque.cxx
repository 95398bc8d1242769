// SPDX-License-Identifier: BSD-3-Clause
// Opaque surfaces of whole wavefronts: what MakeSurface (quellMaterial.cxx), Surface::Finish (quellBsdf.cxx) and
// Surface::Prepare, Evaluate and Sample (quellBsdf.h) do for one surface without glass and clearcoat, and LightSampler
// for one of few triangles, operation by operation, so that the bits are theirs. Choices are made by selection after
// both sides have been computed.
#include "quellWavefront.h"

#include "quellSinCos.h"

#include <cmath>
#include <limits>

// Vectors whose length only the machine knows cannot be held in structures.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellWavefrontOpaque.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
using Ints = hn::ScalableTag<std::int32_t>;
using Words = hn::ScalableTag<std::uint32_t>;
using V = hn::Vec<Floats>;
using I = hn::Vec<Ints>;
using W = hn::Vec<Words>;
using M = decltype(hn::Lt(V(), V()));

HWY_INLINE V Set(float v)
{
  return hn::Set(Floats(), v);
}
HWY_INLINE V Load(const float* column)
{
  return hn::LoadU(Floats(), column);
}
HWY_INLINE void Store(V v, float* column)
{
  hn::StoreU(v, Floats(), column);
}
HWY_INLINE W LoadWords(const std::uint32_t* column)
{
  return hn::LoadU(Words(), column);
}
HWY_INLINE void StoreWords(W v, std::uint32_t* column)
{
  hn::StoreU(v, Words(), column);
}
HWY_INLINE M HasBits(W v, std::uint32_t bits)
{
  return hn::RebindMask(Floats(), hn::Ne(hn::And(v, hn::Set(Words(), bits)), hn::Zero(Words())));
}
HWY_INLINE W Bits(M mask, std::uint32_t bits)
{
  return hn::IfThenElseZero(hn::RebindMask(Words(), mask), hn::Set(Words(), bits));
}
HWY_INLINE V Choose(M mask, V yes, V no)
{
  return hn::IfThenElse(mask, yes, no);
}
// std::max and std::min, whatever the arguments.
HWY_INLINE V Larger(V a, V b)
{
  return hn::IfThenElse(hn::Lt(a, b), b, a);
}
HWY_INLINE V Smaller(V a, V b)
{
  return hn::IfThenElse(hn::Lt(b, a), b, a);
}
HWY_INLINE M Positive(V v)
{
  return hn::Gt(v, hn::Zero(Floats()));
}
HWY_INLINE M Finite(V v) // of v >= 0
{
  return hn::Le(v, Set(std::numeric_limits<float>::max()));
}
HWY_INLINE V ToUnit(V v)
{
  return hn::IfThenElseZero(Positive(v), Smaller(Set(1), v));
}

struct V3
{
  V x, y, z;
};
HWY_INLINE V3 operator+(const V3& a, const V3& b)
{
  return { a.x + b.x, a.y + b.y, a.z + b.z };
}
HWY_INLINE V3 operator-(const V3& a, const V3& b)
{
  return { a.x - b.x, a.y - b.y, a.z - b.z };
}
HWY_INLINE V3 operator*(const V3& a, const V3& b)
{
  return { a.x * b.x, a.y * b.y, a.z * b.z };
}
HWY_INLINE V3 operator*(const V3& a, V s)
{
  return { a.x * s, a.y * s, a.z * s };
}
HWY_INLINE V3 operator/(const V3& a, V s)
{
  return { a.x / s, a.y / s, a.z / s };
}
HWY_INLINE V3 Choose(M mask, const V3& yes, const V3& no)
{
  return { Choose(mask, yes.x, no.x), Choose(mask, yes.y, no.y), Choose(mask, yes.z, no.z) };
}
HWY_INLINE V3 OrZero(M mask, const V3& v)
{
  return { hn::IfThenElseZero(mask, v.x), hn::IfThenElseZero(mask, v.y), hn::IfThenElseZero(mask, v.z) };
}
HWY_INLINE V3 ToUnit(const V3& v)
{
  return { ToUnit(v.x), ToUnit(v.y), ToUnit(v.z) };
}
HWY_INLINE V Dot(const V3& a, const V3& b)
{
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
HWY_INLINE V3 Cross(const V3& a, const V3& b)
{
  return { a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}
HWY_INLINE V3 Normalized(const V3& v)
{
  const V l = hn::Sqrt(Dot(v, v));
  return OrZero(hn::And(Positive(l), Finite(l)), v / l);
}
HWY_INLINE V Largest(const V3& v)
{
  return Choose(hn::Gt(v.x, v.y), Choose(hn::Gt(v.x, v.z), v.x, v.z), Choose(hn::Gt(v.y, v.z), v.y, v.z));
}
HWY_INLINE V Luminance(const V3& c)
{
  return Set(0.2126f) * c.x + Set(0.7152f) * c.y + Set(0.0722f) * c.z;
}
HWY_INLINE V3 Load(const float* x, const float* y, const float* z)
{
  return { Load(x), Load(y), Load(z) };
}
HWY_INLINE void Store(const V3& v, float* x, float* y, float* z)
{
  Store(v.x, x);
  Store(v.y, y);
  Store(v.z, z);
}

HWY_INLINE V Schlick(V cosine)
{
  const V x = Smaller(Set(1), Larger(Set(0), Set(1) - cosine)), x2 = x * x;
  return x2 * x2 * x;
}
HWY_INLINE V Smith(V cosine, V alpha2)
{
  const V c2 = cosine * cosine;
  return hn::Sqrt(c2 + alpha2 * Larger(Set(0), Set(1) - c2));
}
HWY_INLINE V MultipleFresnel(V f0, V f90, V average)
{
  const V f = f0 + (f90 - f0) / Set(21);
  return f * f * average / (Set(1) - f * (Set(1) - average));
}
HWY_INLINE void SinCosEighth(V x, V& s, V& c)
{
  using namespace sincos;
  const V z = x * x;
  s = ((Set(S7) * z + Set(S5)) * z + Set(S3)) * z * x + x;
  c = ((Set(C8) * z + Set(C6)) * z + Set(C4)) * z * z - Set(0.5f) * z + Set(1);
}
HWY_INLINE void SinCosTurn(V u, V& s, V& c)
{
  const V k = hn::Floor(Set(4) * u + Set(0.5f));
  V a, b;
  SinCosEighth((u - Set(0.25f) * k) * Set(6.28318530717958647692f), a, b);
  const I quadrant = hn::And(hn::ConvertTo(Ints(), k), hn::Set(Ints(), 3));
  const auto is = [&](int q) { return hn::RebindMask(Floats(), hn::Eq(quadrant, hn::Set(Ints(), q))); };
  s = Choose(is(0), a, Choose(is(1), b, Choose(is(2), hn::Neg(a), hn::Neg(b))));
  c = Choose(is(0), b, Choose(is(1), hn::Neg(a), Choose(is(2), hn::Neg(b), a)));
}

/// An index into the tables: any `x` is safe, rows without a surface hold anything.
HWY_INLINE I Index(V x)
{
  return hn::Min(hn::Set(Ints(), EnergyTables::Size - 2), hn::Max(hn::Zero(Ints()), hn::ConvertTo(Ints(), x)));
}
struct Energies
{
  V E, B;
};
HWY_INLINE Energies Energy(const float* table, I row, V fraction, V alpha, V cosine)
{
  const V mu = Smaller(Set(1), Larger(Set(1e-6f), cosine)), w = Schlick(mu);
  const V x = hn::Sqrt(mu * (Set(1) + alpha) / (mu + alpha)) * Set(EnergyTables::Size - 1);
  const I k = Index(x);
  const V f = x - hn::ConvertTo(Floats(), k), g = fraction;
  const I at = row + k + k;
  const Floats d;
  const V a0 = hn::GatherIndex(d, table, at), a1 = hn::GatherIndex(d, table + 1, at),
          a2 = hn::GatherIndex(d, table + 2, at), a3 = hn::GatherIndex(d, table + 3, at);
  const float* below = table + 2 * EnergyTables::Size;
  const V b0 = hn::GatherIndex(d, below, at), b1 = hn::GatherIndex(d, below + 1, at),
          b2 = hn::GatherIndex(d, below + 2, at), b3 = hn::GatherIndex(d, below + 3, at);
  const V e0 = a0 + (a2 - a0) * f, s0 = a1 + (a3 - a1) * f;
  const V e1 = b0 + (b2 - b0) * f, s1 = b1 + (b3 - b1) * f;
  const V e = Smaller(Set(1), e0 + (e1 - e0) * g), s = s0 + (s1 - s0) * g;
  const M mirror = hn::Lt(alpha, Set(Surface::MirrorAlpha));
  return { Choose(mirror, Set(1), e), Choose(mirror, w, Smaller(e, Larger(Set(0), s + e * w))) };
}

void PrepareOpaqueImpl(Wavefront& w, const EnergyTables& tables)
{
  const Floats d;
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  const V zero = hn::Zero(d), one = Set(1);
  Wavefront::OpaqueColumns& o = w.Opaque;
  for (unsigned i = 0; i < n; i += unsigned(hn::Lanes(d)))
  {
    // MakeSurface
    const W bits = LoadWords(w.Material + i);
    const M lit = hn::Not(HasBits(bits, WavefrontAccess::Unlit));
    const V3 base = ToUnit(Load(o.Base[0] + i, o.Base[1] + i, o.Base[2] + i));
    const V metallic = ToUnit(Load(o.Metallic + i)), roughness = ToUnit(Load(o.Roughness + i)),
            weight = ToUnit(Load(o.Specular + i));
    const V given = Load(o.Ior + i);
    const V ior = Choose(hn::Eq(given, zero), zero,
      Choose(hn::And(Positive(given), Finite(given)), Smaller(Set(1e6f), Larger(Set(1e-6f), given)), Set(1.5f)));
    const V r = (ior - one) / (ior + one), r0 = r * r;
    const auto radiance = [](V v) { return hn::IfThenElseZero(hn::And(Positive(v), Finite(v)), v); };
    const V3 tint{ radiance(Load(o.Tint[0] + i)), radiance(Load(o.Tint[1] + i)), radiance(Load(o.Tint[2] + i)) };
    const V3 f0 = ToUnit(tint * r0) * weight;
    const V size = hn::Abs(r);
    const V f90 = weight * Smaller(one, Set(13.5f) * size / (one + Set(6.8f) * size));
    const V opaque = one - metallic;
    const V alpha = roughness * roughness;
    const V3 diffuse = OrZero(lit, base * opaque);
    V under0 = zero, diffuseF0 = hn::IfThenElseZero(lit, Largest(f0)), diffuseF90 = hn::IfThenElseZero(lit, f90);
    const V3 F0 = OrZero(lit, f0 * opaque + base * metallic);
    const V F90 = hn::IfThenElseZero(lit, f90 * opaque + metallic);

    // Finish
    const M hasSpecular = hn::Or(Positive(Largest(F0)), Positive(F90));
    const M smooth = hn::Lt(alpha, Set(Surface::MirrorAlpha));
    diffuseF0 = hn::IfThenElseZero(hasSpecular, diffuseF0);
    diffuseF90 = hn::IfThenElseZero(hasSpecular, diffuseF90);
    const M rough = hn::And(hn::Ge(alpha, Set(Surface::MirrorAlpha)), hasSpecular);
    const M multiple = hn::And(rough, hn::Not(HasBits(bits, WavefrontAccess::Single)));
    const V y = hn::Sqrt(alpha) * Set(EnergyTables::Size - 1);
    const I k = Index(y);
    const V fraction = Smaller(one, y - hn::ConvertTo(d, k));
    const I pair = k + k;
    const V a0 = hn::GatherIndex(d, tables.GgxAverage, pair), a1 = hn::GatherIndex(d, tables.GgxAverage + 1, pair),
            b0 = hn::GatherIndex(d, tables.GgxAverage + 2, pair), b1 = hn::GatherIndex(d, tables.GgxAverage + 3, pair);
    const V averageE = a0 + (b0 - a0) * fraction, averageB = a1 + (b1 - a1) * fraction;
    const V multiScale = hn::IfThenElseZero(multiple, one / (Set(Pi) * Larger(Set(1e-6f), one - averageE)));
    const V multiF = hn::IfThenElseZero(multiple, MultipleFresnel(diffuseF0, diffuseF90, averageE));
    const V under2 = diffuseF90 - diffuseF0;
    V under1 = diffuseF0, reflected = diffuseF0 + under2 / Set(21);
    under0 = hn::IfThenElseZero(rough, multiF);
    under1 = Choose(rough, diffuseF0 - multiF, under1);
    reflected = Choose(rough, multiF + under1 * averageE + under2 * averageB, reflected);
    const V diffuseScale = hn::IfThenElseZero(hn::Lt(reflected, Set(0.9999f)), one / (one - reflected));
    const M hasDiffuse = hn::And(Positive(diffuseScale), Positive(Largest(diffuse)));
    const M mixed = hn::And(hn::And(Positive(metallic), Positive(opaque)), Positive(multiScale));
    const V3 alone{ MultipleFresnel(F0.x, F90, averageE), MultipleFresnel(F0.y, F90, averageE),
      MultipleFresnel(F0.z, F90, averageE) };
    const auto mix = [&](V f, V b)
    { return opaque * MultipleFresnel(f, f90, averageE) + metallic * MultipleFresnel(b, one, averageE); };
    const V3 both{ mix(f0.x, base.x), mix(f0.y, base.y), mix(f0.z, base.z) };
    const V3 fms = OrZero(multiple, Choose(mixed, both, alone));

    // Prepare
    const V3 normal = Load(w.Sx + i, w.Sy + i, w.Sz + i);
    const V3 wo{ hn::Neg(Load(w.Live.Dx + i)), hn::Neg(Load(w.Live.Dy + i)), hn::Neg(Load(w.Live.Dz + i)) };
    const V co = Dot(normal, wo);
    const I row = hn::ShiftLeft<6>(k);
    static_assert(2 * EnergyTables::Size == 64, "a row");
    const Energies e = Energy(tables.Ggx, row, fraction, alpha, co);
    const V lumF90 = Luminance({ F90, F90, F90 });
    const V loss = one - e.E;
    const V outUnder = Larger(zero, one - (under0 + under1 * e.E + under2 * e.B));
    const V outSmith = Smith(Smaller(one, co), alpha * alpha);
    V cosine = hn::IfThenElseZero(hasDiffuse, Luminance(diffuse)) * outUnder;
    const V multi = hn::IfThenElseZero(Positive(multiScale), Larger(Luminance(fms) * loss, Set(0.01f) * lumF90));
    V specular = Luminance(F0) * (e.E - e.B) + lumF90 * e.B;
    const V floor = Set(0.1f) * (cosine + specular) + Set(1e-20f);
    cosine = hn::IfThenElseZero(hasDiffuse, Larger(cosine, floor)) + multi;
    specular = Larger(specular, floor);
    const V scale = one / (cosine + specular);
    const V pSpecular = hn::IfThenElseZero(hasSpecular, specular * scale);

    Store(diffuse, w.Ar + i, w.Ag + i, w.Ab + i);
    Store(F0, o.F0[0] + i, o.F0[1] + i, o.F0[2] + i);
    Store(F90, o.F90 + i);
    Store(alpha, o.Alpha + i);
    Store(fms, o.Fms[0] + i, o.Fms[1] + i, o.Fms[2] + i);
    Store(multiScale, o.MultiScale + i);
    Store(under0, o.Under[0] + i);
    Store(under1, o.Under[1] + i);
    Store(under2, o.Under[2] + i);
    Store(diffuseScale, o.DiffuseScale + i);
    hn::StoreU(row, Ints(), o.Row + i);
    Store(fraction, o.Fraction + i);
    Store(co, o.Co + i);
    Store(loss, o.OutLoss + i);
    Store(outUnder, o.OutUnder + i);
    Store(outSmith, o.OutSmith + i);
    Store(pSpecular * (one / (Set(2) * (co + outSmith))), o.OutPdf + i);
    Store(Choose(hasSpecular, cosine * scale, hn::IfThenElseZero(hasDiffuse, one)), o.PCosine + i);
    Store(pSpecular, o.PSpecular + i);
    StoreWords(hn::Or(Bits(hasDiffuse, Wavefront::HasDiffuse),
                 hn::Or(Bits(hasSpecular, Wavefront::HasSpecular), Bits(smooth, Wavefront::SpecularIsDelta))),
      o.Lobes + i);
  }
}

/// The rows of a vector, as EvaluateOpaque reads them.
struct Rows
{
  V3 Diffuse, F0, Fms;
  V F90, Alpha, Co, OutSmith, PCosine;
  M HasDiffuse, HasSpecular, Rough;
};
HWY_INLINE Rows RowsAt(const Wavefront& w, unsigned i)
{
  const Wavefront::OpaqueColumns& o = w.Opaque;
  const W lobes = LoadWords(o.Lobes + i);
  const M specular = HasBits(lobes, Wavefront::HasSpecular);
  return { Load(w.Ar + i, w.Ag + i, w.Ab + i), Load(o.F0[0] + i, o.F0[1] + i, o.F0[2] + i),
    Load(o.Fms[0] + i, o.Fms[1] + i, o.Fms[2] + i), Load(o.F90 + i), Load(o.Alpha + i), Load(o.Co + i),
    Load(o.OutSmith + i), Load(o.PCosine + i), HasBits(lobes, Wavefront::HasDiffuse), specular,
    hn::And(specular, hn::Not(HasBits(lobes, Wavefront::SpecularIsDelta))) };
}
struct HalfVectors
{
  V Sin2, Cosine, Out;
};
HWY_INLINE HalfVectors Between(const V3& n, const V3& wo, const V3& wi)
{
  const V3 h = Normalized(wo + wi), x = Cross(n, h);
  return { Dot(x, x), Dot(n, h), Dot(wo, h) };
}
HWY_INLINE V3 Fresnel(const Rows& s, V cosine)
{
  const V3 f90{ s.F90, s.F90, s.F90 };
  return s.F0 + (f90 - s.F0) * Schlick(cosine);
}
HWY_INLINE void Evaluate(const Wavefront& w, const EnergyTables& tables, unsigned i, const Rows& s, V ci,
  const HalfVectors& half, V3& diffuse, V3& specular, V& pdf)
{
  const Wavefront::OpaqueColumns& o = w.Opaque;
  const V zero = hn::Zero(Floats()), one = Set(1), pi = Set(Pi);
  const Energies e = Energy(tables.Ggx, hn::LoadU(Ints(), o.Row + i), Load(o.Fraction + i), s.Alpha, ci);
  const V under = Larger(zero, one - (Load(o.Under[0] + i) + Load(o.Under[1] + i) * e.E + Load(o.Under[2] + i) * e.B));
  const V below = Load(o.OutUnder + i) * under * Load(o.DiffuseScale + i) * (ci / pi);
  diffuse = s.Diffuse * Choose(s.HasSpecular, hn::IfThenElseZero(s.HasDiffuse, below), Set(1 / Pi) * ci);
  const V3 multi = s.Fms * (Load(o.OutLoss + i) * (one - e.E) * Load(o.MultiScale + i) * ci);
  const V c2 = half.Cosine * half.Cosine, a2 = s.Alpha * s.Alpha, k = c2 * a2 + half.Sin2;
  const V density = hn::IfThenElseZero(hn::And(Positive(half.Cosine), Positive(k)), a2 / (pi * k * k));
  const V si = Smith(Smaller(one, ci), a2);
  const V reflection =
    density * ci / Larger(Set(2) * (s.OutSmith * ci + si * s.Co), Set(std::numeric_limits<float>::min()));
  const M seen = hn::And(s.Rough, Positive(half.Out));
  specular = OrZero(s.Rough, OrZero(seen, Fresnel(s, half.Out) * reflection) + multi);
  pdf = s.PCosine * ci / pi;
  pdf = Choose(seen, pdf + density * Load(o.OutPdf + i), pdf);
}

void AimOpaqueImpl(Wavefront& w, const EnergyTables& tables)
{
  const Floats d;
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  const Wavefront::State& live = w.Live;
  const V infinity = Set(std::numeric_limits<float>::infinity());
  for (unsigned i = 0; i < n; i += unsigned(hn::Lanes(d)))
  {
    const W flags = LoadWords(w.LightFlags + i);
    const Rows s = RowsAt(w, i);
    const V3 wi = Load(w.Wx + i, w.Wy + i, w.Wz + i), normal = Load(w.Sx + i, w.Sy + i, w.Sz + i),
             geometric = Load(w.Gx + i, w.Gy + i, w.Gz + i);
    const V3 wo{ hn::Neg(Load(live.Dx + i)), hn::Neg(Load(live.Dy + i)), hn::Neg(Load(live.Dz + i)) };
    const V ci = Dot(normal, wi);
    V3 diffuse, specular;
    V scatterPdf;
    Evaluate(w, tables, i, s, ci, Between(normal, wo, wi), diffuse, specular, scatterPdf);
    const V3 throughput = Load(live.Tr + i, live.Tg + i, live.Tb + i), value = throughput * (diffuse + specular);
    const V3 emission = Load(w.Er + i, w.Eg + i, w.Eb + i);
    const M good = hn::And(hn::And(Positive(s.Co), hn::And(Positive(ci), Positive(Dot(geometric, wi)))),
      hn::And(Positive(Largest(value)), Positive(Largest(emission))));
    const V offset = Load(w.Offset + i);
    const V3 origin = Load(w.Px + i, w.Py + i, w.Pz + i) + geometric * offset;
    const M infinite = HasBits(flags, Wavefront::LightAtInfinity);
    const V3 along = Choose(infinite, wi, Load(w.Lx + i, w.Ly + i, w.Lz + i) - origin);
    Store(origin, w.Kx + i, w.Ky + i, w.Kz + i);
    Store(along, w.Jx + i, w.Jy + i, w.Jz + i);
    Store(Choose(infinite, infinity, Set(ShadowEnd)), w.Far + i);
    Store(value, w.Cr + i, w.Cg + i, w.Cb + i);
    Store(throughput * diffuse, w.Br + i, w.Bg + i, w.Bb + i);
    Store(scatterPdf, w.ScatterPdf + i);
    StoreWords(hn::And(flags, Bits(good, ~0u)), w.Lit + i);
  }
}

void ShineImpl(Wavefront& w, bool mis, bool parts)
{
  const Floats d;
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  const Wavefront::State& live = w.Live;
  const V one = Set(1);
  for (unsigned i = 0; i < n; i += unsigned(hn::Lanes(d)))
  {
    const V3 emission = Load(w.Er + i, w.Eg + i, w.Eb + i);
    const V pdf = Load(w.LightPdf + i), ratio = Load(w.ScatterPdf + i) / pdf;
    V weight = one / pdf;
    if (mis)
      weight = Choose(
        HasBits(LoadWords(w.LightFlags + i), Wavefront::LightHittable), weight * (one / (one + ratio * ratio)), weight);
    const V3 lit = Load(w.Cr + i, w.Cg + i, w.Cb + i) * emission * weight;
    Store(lit, w.Cr + i, w.Cg + i, w.Cb + i);
    if (!parts)
      continue;
    const M first = hn::Not(HasBits(LoadWords(live.Flags + i), Wavefront::SmoothMask));
    Store(Choose(first, Load(w.Br + i, w.Bg + i, w.Bb + i) * emission * weight,
            lit * Load(live.Sr + i, live.Sg + i, live.Sb + i)),
      w.Br + i, w.Bg + i, w.Bb + i);
  }
}

/// The frame around a normal, and directions about it.
struct Around
{
  V3 Tangent, Bitangent, Normal;
  HWY_INLINE V3 World(const V3& q) const { return Tangent * q.x + Bitangent * q.y + Normal * q.z; }
};
HWY_INLINE Around FrameOf(const V3& n)
{
  const V one = Set(1), sign = hn::CopySign(one, n.z), a = Set(-1) / (sign + n.z), c = n.x * n.y * a;
  return { { one + sign * n.x * n.x * a, sign * c, hn::Neg(sign) * n.x }, { c, sign + n.y * n.y * a, hn::Neg(n.y) },
    n };
}
HWY_INLINE V3 CosineHemisphere(V u, V v)
{
  const V zero = hn::Zero(Floats()), one = Set(1), p = Set(2) * u - one, q = Set(2) * v - one;
  const M wide = hn::Gt(hn::Abs(p), hn::Abs(q));
  const V radius = Choose(wide, p, q), other = Choose(wide, q, p);
  V sine, cosine;
  SinCosEighth(Set(Pi / 4) * hn::IfThenZeroElse(hn::Eq(radius, zero), other / radius), sine, cosine);
  const V x = radius * Choose(wide, cosine, sine), y = radius * Choose(wide, sine, cosine);
  return { x, y, hn::Sqrt(Larger(zero, one - x * x - y * y)) };
}
/// Russian roulette: whether paths go on, and their throughput then.
HWY_INLINE M Gamble(const Wavefront& w, unsigned i, V chance, V3& throughput)
{
  const V one = Set(1), kept = Smaller(Set(0.99f), Larger(Set(0.05f), chance));
  const M gamble = hn::Lt(chance, one);
  throughput = Choose(gamble, throughput * (one / kept), throughput);
  return hn::Not(hn::And(gamble, hn::Ge(Load(w.Random[2 * PairLightPick + 1] + i), kept)));
}

void ScatterDiffuseImpl(Wavefront& w, bool roulette)
{
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  Wavefront::State& live = w.Live;
  const W kept = hn::Set(Words(), ~(Wavefront::DeltaBit | Wavefront::BothSidesBit | Wavefront::GuidesBit));
  for (unsigned i = 0; i < n; i += unsigned(hn::Lanes(Floats())))
  {
    const V3 normal = Load(w.Sx + i, w.Sy + i, w.Sz + i), geometric = Load(w.Gx + i, w.Gy + i, w.Gz + i);
    const V3 wo{ hn::Neg(Load(live.Dx + i)), hn::Neg(Load(live.Dy + i)), hn::Neg(Load(live.Dz + i)) };
    const V3 up = CosineHemisphere(Load(w.Random[2 * PairBsdf] + i), Load(w.Random[2 * PairBsdf + 1] + i));
    const V3 wi = FrameOf(normal).World(up);
    const V pdf = up.z / Set(Pi);
    V3 throughput = Load(live.Tr + i, live.Tg + i, live.Tb + i) * Load(w.Ar + i, w.Ag + i, w.Ab + i);
    const V largest = Largest(throughput);
    M goes = hn::And(hn::And(Positive(up.z), Positive(Dot(geometric, wi))), Positive(Dot(normal, wo)));
    goes = hn::And(goes, hn::And(Positive(pdf), Positive(largest)));
    if (roulette)
      goes = hn::And(goes, Gamble(w, i, largest, throughput));
    const V3 at = Load(w.Px + i, w.Py + i, w.Pz + i);
    Store(at, live.Fx + i, live.Fy + i, live.Fz + i);
    Store(normal, live.Nx + i, live.Ny + i, live.Nz + i);
    Store(at + geometric * Load(w.Offset + i), live.Ox + i, live.Oy + i, live.Oz + i);
    Store(wi, live.Dx + i, live.Dy + i, live.Dz + i);
    Store(throughput, live.Tr + i, live.Tg + i, live.Tb + i);
    Store(pdf, live.Pdf + i);
    StoreWords(hn::And(LoadWords(live.Flags + i) + hn::Set(Words(), 1), kept), live.Flags + i);
    StoreWords(hn::And(LoadWords(w.Alive + i), Bits(goes, ~0u)), w.Alive + i);
  }
}

/// LightSampler::DrawLocal.
void DrawTrianglesImpl(Wavefront& w, const FewTriangles& lights)
{
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  const V zero = hn::Zero(Floats()), one = Set(1), two = Set(2);
  for (unsigned i = 0; i < n; i += unsigned(hn::Lanes(Floats())))
  {
    const V pick = Load(w.Random[2 * PairLightPick] + i);
    V t[FewTriangles::Numbers];
    for (int c = 0; c < FewTriangles::Numbers; ++c)
      t[c] = Set(lights.Of[0][c]);
    for (int k = 1; k < lights.Count; ++k)
    {
      const M later = hn::Ge(pick, Set(lights.From[k]));
      for (int c = 0; c < FewTriangles::Numbers; ++c)
        t[c] = Choose(later, Set(lights.Of[k][c]), t[c]);
    }
    const V3 v0{ t[0], t[1], t[2] }, e1{ t[3], t[4], t[5] }, e2{ t[6], t[7], t[8] }, normal{ t[9], t[10], t[11] };
    const V u = Load(w.Random[2 * PairLightPoint] + i), v = Load(w.Random[2 * PairLightPoint + 1] + i);
    const V half0 = u / two, half1 = v / two;
    const M low = hn::Lt(u, v);
    const V b0 = Choose(low, half0, u - half1), b1 = Choose(low, v - half0, half1);
    const V3 y = v0 + e1 * b0 + e2 * b1, way = y - Load(w.Px + i, w.Py + i, w.Pz + i);
    const V d2 = Dot(way, way);
    const V3 wi = way * (one / hn::Sqrt(d2));
    const V facing = hn::Neg(Dot(normal, wi));
    const M behind = hn::Lt(facing, zero);
    const V offset = Choose(behind, Set(-1), one) * t[12], cosine = Choose(behind, hn::Neg(facing), facing);
    const V pdf = t[14] * d2 / cosine, infinity = Set(std::numeric_limits<float>::infinity());
    M good = hn::And(Positive(d2), hn::Lt(d2, infinity));
    good = hn::And(good, hn::And(hn::Or(hn::Not(behind), Positive(t[13])), hn::Gt(cosine, Set(1e-6f))));
    good = hn::And(good, hn::And(Positive(pdf), hn::Lt(pdf, infinity)));
    Store(wi, w.Wx + i, w.Wy + i, w.Wz + i);
    Store(y + normal * offset, w.Lx + i, w.Ly + i, w.Lz + i);
    Store({ t[15], t[16], t[17] }, w.Er + i, w.Eg + i, w.Eb + i);
    Store(pdf, w.LightPdf + i);
    StoreWords(
      hn::And(LoadWords(w.Alive + i), Bits(good, Wavefront::LightDrawn | Wavefront::LightHittable)), w.LightFlags + i);
  }
}

void ScatterOpaqueImpl(Wavefront& w, const EnergyTables& tables, int deepest, bool roulette, bool last)
{
  const Floats d;
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  Wavefront::State& live = w.Live;
  const V zero = hn::Zero(d), one = Set(1);
  for (unsigned i = 0; i < n; i += unsigned(hn::Lanes(d)))
  {
    const Rows s = RowsAt(w, i);
    const V3 normal = Load(w.Sx + i, w.Sy + i, w.Sz + i), geometric = Load(w.Gx + i, w.Gy + i, w.Gz + i);
    const V3 wo{ hn::Neg(Load(live.Dx + i)), hn::Neg(Load(live.Dy + i)), hn::Neg(Load(live.Dz + i)) };
    const V u = Load(w.Random[2 * PairBsdf] + i), v = Load(w.Random[2 * PairBsdf + 1] + i);
    const M byCosine = hn::Lt(Load(w.Random[2 * PairLobe] + i), s.PCosine);
    const V pSpecular = Load(w.Opaque.PSpecular + i);
    const M mirror = hn::AndNot(hn::Or(byCosine, s.Rough), Positive(pSpecular));

    const Around frame = FrameOf(normal);
    const V3 up = CosineHemisphere(u, v);
    const V3 wiCosine = frame.World(up);

    // SampleVisibleNormal
    const V3 local{ Dot(frame.Tangent, wo), Dot(frame.Bitangent, wo), Dot(normal, wo) };
    const V across = hn::Sqrt(local.x * local.x + local.y * local.y);
    const M tilted = Positive(across);
    const V turn = hn::IfThenElseZero(tilted, one / across), cx = local.x * turn,
            cy = Choose(tilted, local.y * turn, Set(-1));
    const V stretch = one / hn::Sqrt(s.Alpha * s.Alpha * (across * across) + local.z * local.z);
    const V wx = s.Alpha * across * stretch, wz = local.z * stretch;
    V sinPhi, cosPhi;
    SinCosTurn(v, sinPhi, cosPhi);
    const V r = hn::Sqrt(u), px = r * cosPhi, h2 = Larger(zero, one - px * px), split = (one + wz) / Set(2);
    const V py = hn::Sqrt(h2) * (one - split) + r * sinPhi * split;
    const V pz = hn::Sqrt(Larger(zero, h2 - py * py));
    const V mx = s.Alpha * (pz * wx - py * wz), my = s.Alpha * px, mz = Larger(Set(1e-6f), py * wx + pz * wz);
    const V unit = one / hn::Sqrt(mx * mx + my * my + mz * mz);
    const V3 m{ (mx * cx - my * cy) * unit, (mx * cy + my * cx) * unit, mz * unit };
    const V out = Dot(local, m);
    const V3 wiGgx = Normalized(frame.World(m * (Set(2) * out) - local));

    const V3 wiMirror = Normalized(normal * (Set(2) * s.Co) - wo);
    const V3 wi = Choose(byCosine, wiCosine, Choose(s.Rough, wiGgx, wiMirror));
    const V ci = Choose(byCosine, up.z, Dot(normal, wi));
    const HalfVectors between = Between(normal, wo, wi);
    const HalfVectors half{ Choose(byCosine, between.Sin2, m.x * m.x + m.y * m.y),
      Choose(byCosine, between.Cosine, m.z), Choose(byCosine, between.Out, out) };
    V3 diffuse, specular;
    V pdf;
    Evaluate(w, tables, i, s, ci, half, diffuse, specular, pdf);
    const V scale = hn::IfThenElseZero(Positive(pdf), one / pdf);
    diffuse = Choose(s.HasSpecular, diffuse * scale, s.Diffuse / s.PCosine);
    specular = specular * scale;
    // a perfect mirror
    diffuse = Choose(mirror, V3{ zero, zero, zero }, diffuse);
    specular = Choose(mirror, Fresnel(s, s.Co) / pSpecular, specular);
    const M above = Positive(Dot(geometric, wi));
    pdf = Choose(mirror, one, pdf);
    const V3 weight = diffuse + specular;
    V3 throughput = Load(live.Tr + i, live.Tg + i, live.Tb + i) * weight;
    M goes = hn::And(hn::And(Positive(s.Co), above), hn::And(hn::Or(mirror, Positive(ci)), Positive(pdf)));
    goes = hn::And(goes, hn::Or(hn::Or(byCosine, s.Rough), mirror));
    goes = hn::And(goes, Positive(Largest(throughput)));

    const W flags = LoadWords(live.Flags + i);
    const M first = hn::AndNot(mirror, hn::Not(HasBits(flags, Wavefront::SmoothMask)));
    const V3 share{ hn::IfThenElseZero(Positive(weight.x), diffuse.x / weight.x),
      hn::IfThenElseZero(Positive(weight.y), diffuse.y / weight.y),
      hn::IfThenElseZero(Positive(weight.z), diffuse.z / weight.z) };
    Store(Choose(first, share, Load(live.Sr + i, live.Sg + i, live.Sb + i)), live.Sr + i, live.Sg + i, live.Sb + i);
    const W scattered =
      hn::AndNot(hn::Set(Words(), Wavefront::DeltaBit | Wavefront::BothSidesBit), flags) + hn::Set(Words(), 1);
    const W next =
      hn::IfThenElse(hn::RebindMask(Words(), mirror), hn::Or(flags, hn::Set(Words(), Wavefront::DeltaBit)), scattered);
    const M deep = hn::RebindMask(
      d, hn::Gt(hn::BitCast(Ints(), hn::And(next, hn::Set(Words(), Wavefront::SmoothMask))), hn::Set(Ints(), deepest)));
    goes = hn::AndNot(hn::AndNot(mirror, deep), goes);
    // nothing left to meet: only those who look for the first hit after a mirror or for guides go on
    if (last)
      goes = hn::And(goes, HasBits(flags, Wavefront::GuidesBit | Wavefront::DistanceBit));
    if (roulette)
      goes = hn::And(goes, Gamble(w, i, Largest(throughput) * Load(live.EtaScale + i), throughput));
    const V3 at = Load(w.Px + i, w.Py + i, w.Pz + i);
    Store(Choose(mirror, Load(live.Fx + i, live.Fy + i, live.Fz + i), at), live.Fx + i, live.Fy + i, live.Fz + i);
    Store(Choose(mirror, Load(live.Nx + i, live.Ny + i, live.Nz + i), normal), live.Nx + i, live.Ny + i, live.Nz + i);
    const V offset = Load(w.Offset + i);
    Store(at + geometric * offset, live.Ox + i, live.Oy + i, live.Oz + i);
    Store(offset / Larger(hn::Abs(Dot(geometric, wi)), Set(1.f / 64)), live.Skipped + i);
    Store(wi, live.Dx + i, live.Dy + i, live.Dz + i);
    Store(throughput, live.Tr + i, live.Tg + i, live.Tb + i);
    Store(pdf, live.Pdf + i);
    StoreWords(next, live.Flags + i);
    StoreWords(hn::And(LoadWords(w.Alive + i), Bits(goes, ~0u)), w.Alive + i);
  }
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(PrepareOpaqueImpl);
HWY_EXPORT(AimOpaqueImpl);
HWY_EXPORT(ShineImpl);
HWY_EXPORT(ScatterOpaqueImpl);
HWY_EXPORT(ScatterDiffuseImpl);
HWY_EXPORT(DrawTrianglesImpl);

namespace lanes
{
void PrepareOpaque(Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(PrepareOpaqueImpl)(w, EnergyTables::Get());
}
void AimOpaque(Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(AimOpaqueImpl)(w, EnergyTables::Get());
}
void ScatterDiffuse(Wavefront& w, bool roulette) noexcept
{
  HWY_DYNAMIC_DISPATCH(ScatterDiffuseImpl)(w, roulette);
}
void DrawTriangles(Wavefront& w, const FewTriangles& lights) noexcept
{
  HWY_DYNAMIC_DISPATCH(DrawTrianglesImpl)(w, lights);
}
void Shine(Wavefront& w, bool mis, bool parts) noexcept
{
  HWY_DYNAMIC_DISPATCH(ShineImpl)(w, mis, parts);
}
void ScatterOpaque(Wavefront& w, int deepest, bool roulette, bool last) noexcept
{
  HWY_DYNAMIC_DISPATCH(ScatterOpaqueImpl)(w, EnergyTables::Get(), deepest, roulette, last);
}
}
}
#endif
