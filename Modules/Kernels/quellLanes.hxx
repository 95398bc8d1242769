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
}
}
HWY_AFTER_NAMESPACE();
#endif
