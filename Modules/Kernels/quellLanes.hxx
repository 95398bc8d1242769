// SPDX-License-Identifier: BSD-3-Clause
// Vector helpers, compiled once per instruction set (include after hwy/foreach_target.h and hwy/highway.h).
#if defined(quellLanes_hxx) == defined(HWY_TARGET_TOGGLE)
#ifdef quellLanes_hxx
#undef quellLanes_hxx
#else
#define quellLanes_hxx
#endif

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
namespace hn = hwy::HWY_NAMESPACE;

constexpr float Log2E = 1.44269504f;
/// Weights below 2^-115 (e^-80) are 0.
constexpr float LargestExponent = 115.f;

/// exp2(-x), x >= 0; 0 beyond LargestExponent and for NaN. n = round(-x) is found by adding 1.5 * 2^23, whose low bits
/// then hold n; 2^f on [-1/2, 1/2] is a minimax polynomial of degree 5 that is exactly 1 at 0 (error 1.1e-7); n is
/// added to the exponent bits.
template <class D, class V>
HWY_INLINE V NegExp2(D d, V x)
{
  const hn::RebindToSigned<D> di;
  const auto magic = hn::Set(d, 12582912.f);
  const auto t = hn::Sub(magic, x);
  const auto f = hn::Sub(hn::Sub(magic, t), x);
  auto p = hn::MulAdd(hn::Set(d, 1.326472615e-03f), f, hn::Set(d, 9.671512991e-03f));
  p = hn::MulAdd(p, f, hn::Set(d, 5.550733581e-02f));
  p = hn::MulAdd(p, f, hn::Set(d, 2.402224243e-01f));
  p = hn::MulAdd(p, f, hn::Set(d, 6.931470037e-01f));
  p = hn::MulAdd(p, f, hn::Set(d, 1.f));
  const auto n = hn::ShiftLeft<23>(hn::BitCast(di, t));
  const auto w = hn::BitCast(d, hn::Add(hn::BitCast(di, p), n));
  return hn::IfThenElseZero(hn::Le(x, hn::Set(d, LargestExponent)), w);
}

/// exp2(-x) is exactly 0 here: callers of NegExp2InStep limit x to it (which also catches NaN: Min(x, this)).
constexpr float VanishingExponent = 127.f;

#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
/// 2^(j / 16) less j / 16 in exponent steps, so that adding a number's own sixteenths to the exponent bits gives both.
alignas(64) static const
  float Sixteenths[16] = { 1.000000000e+00f, 9.908868670e-01f, 9.827538729e-01f, 9.756442904e-01f, 9.696035385e-01f,
    9.646788836e-01f, 9.609197974e-01f, 9.583777785e-01f, 9.571067691e-01f, 9.571630955e-01f, 9.586054087e-01f,
    9.614951611e-01f, 9.658964276e-01f, 9.718760848e-01f, 9.795040488e-01f, 9.888532758e-01f };
#endif

/// w = exp2(-x) of N vectors, 0 <= x <= VanishingExponent, operation by operation so that the N chains overlap. With
/// 512 bits 2^(j/16) comes from a register, and a polynomial of degree 2 (exactly 1 at 0) does the rest (error 4e-7).
template <class D, class V, int N>
HWY_INLINE void NegExp2InStep(D d, const V (&x)[N], V (&w)[N])
{
  const hn::RebindToSigned<D> di;
  V t[N], f[N];
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  const V magic = hn::Set(d, 786432.f); // 1.5 * 2^19: the last bit of a sum is 1/16
#else
  const V magic = hn::Set(d, 12582912.f);
#endif
  for (int j = 0; j < N; ++j)
    t[j] = hn::Sub(magic, x[j]);
  for (int j = 0; j < N; ++j)
    f[j] = hn::Sub(magic, t[j]);
  for (int j = 0; j < N; ++j)
    f[j] = hn::Sub(f[j], x[j]);
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  const V table = hn::Load(d, Sixteenths);
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(hn::Set(d, 2.4022651e-01f), f[j], hn::Set(d, 6.9314718e-01f));
  V power[N];
  for (int j = 0; j < N; ++j)
    power[j] = V{ _mm512_permutexvar_ps(_mm512_castps_si512(t[j].raw), table.raw) };
  for (int j = 0; j < N; ++j)
    t[j] = hn::BitCast(d, hn::ShiftLeft<19>(hn::BitCast(di, t[j])));
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(w[j], f[j], hn::Set(d, 1.f));
  for (int j = 0; j < N; ++j)
    t[j] = hn::BitCast(d, hn::Add(hn::BitCast(di, power[j]), hn::BitCast(di, t[j])));
  for (int j = 0; j < N; ++j)
    w[j] = hn::Mul(w[j], t[j]);
#else
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(hn::Set(d, 1.326472615e-03f), f[j], hn::Set(d, 9.671512991e-03f));
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(w[j], f[j], hn::Set(d, 5.550733581e-02f));
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(w[j], f[j], hn::Set(d, 2.402224243e-01f));
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(w[j], f[j], hn::Set(d, 6.931470037e-01f));
  for (int j = 0; j < N; ++j)
    w[j] = hn::MulAdd(w[j], f[j], hn::Set(d, 1.f));
  for (int j = 0; j < N; ++j)
    t[j] = hn::BitCast(d, hn::ShiftLeft<23>(hn::BitCast(di, t[j])));
  for (int j = 0; j < N; ++j)
    w[j] = hn::BitCast(d, hn::Add(hn::BitCast(di, w[j]), hn::BitCast(di, t[j])));
#endif
}
}
}
HWY_AFTER_NAMESPACE();
#endif
