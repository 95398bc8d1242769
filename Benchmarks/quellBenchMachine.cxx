// SPDX-License-Identifier: BSD-3-Clause
#include "quellBenchMachine.h"

#include <algorithm>
#include <cstring>
#include <ctime>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellBenchMachine.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
namespace hn = hwy::HWY_NAMESPACE;

/// `rounds` times 12 independent chains of multiply-adds; returns their number.
double Chains(int rounds, float* sink)
{
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const V a = hn::Set(d, 0.9999f), b = hn::Set(d, 1e-4f);
  const auto start = [&](int i) HWY_ATTR
  { return hn::Set(d, 0.5f + 0.01f * float(i)); }; // all different, or they would be merged
  V c0 = start(0), c1 = start(1), c2 = start(2), c3 = start(3), c4 = start(4), c5 = start(5);
  V c6 = start(6), c7 = start(7), c8 = start(8), c9 = start(9), c10 = start(10), c11 = start(11);
  for (int i = 0; i < rounds; ++i)
  {
    c0 = hn::MulAdd(c0, a, b), c1 = hn::MulAdd(c1, a, b), c2 = hn::MulAdd(c2, a, b);
    c3 = hn::MulAdd(c3, a, b), c4 = hn::MulAdd(c4, a, b), c5 = hn::MulAdd(c5, a, b);
    c6 = hn::MulAdd(c6, a, b), c7 = hn::MulAdd(c7, a, b), c8 = hn::MulAdd(c8, a, b);
    c9 = hn::MulAdd(c9, a, b), c10 = hn::MulAdd(c10, a, b), c11 = hn::MulAdd(c11, a, b);
  }
  const V s0 = hn::Add(hn::Add(c0, c1), hn::Add(c2, c3)), s1 = hn::Add(hn::Add(c4, c5), hn::Add(c6, c7));
  hn::StoreU(hn::Add(hn::Add(s0, s1), hn::Add(hn::Add(c8, c9), hn::Add(c10, c11))), d, sink);
  return 12. * rounds * double(hn::Lanes(d));
}

const char* MachineTargetName()
{
  return hwy::TargetName(HWY_TARGET);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(Chains);
HWY_EXPORT(MachineTargetName);

namespace
{
double SecondsOf(clockid_t clock)
{
  timespec t;
  clock_gettime(clock, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}
}

double ThreadSeconds()
{
  return SecondsOf(CLOCK_THREAD_CPUTIME_ID);
}

double ProcessSeconds()
{
  return SecondsOf(CLOCK_PROCESS_CPUTIME_ID);
}

MachinePeak MachinePeak::Measure()
{
  MachinePeak peak;
  peak.Target = HWY_DYNAMIC_DISPATCH(MachineTargetName)();
  float sink[64];
  for (int i = 0; i < 20; ++i)
  {
    const double start = ThreadSeconds();
    const double n = HWY_DYNAMIC_DISPATCH(Chains)(200000, sink);
    peak.MultiplyAdds = std::max(peak.MultiplyAdds, n / (ThreadSeconds() - start));
  }
  const std::size_t bytes = std::size_t(96) << 20;
  std::vector<char> from(bytes, 1), to(bytes, 2);
  for (int i = 0; i < 6; ++i)
  {
    const double start = ThreadSeconds();
    std::memcpy(to.data(), from.data(), bytes);
    peak.Bandwidth = std::max(peak.Bandwidth, 2. * double(bytes) / (ThreadSeconds() - start));
  }
  return peak;
}
}
#endif
