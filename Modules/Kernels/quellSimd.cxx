// SPDX-License-Identifier: BSD-3-Clause
#include "quellSimd.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellSimd.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
const char* TargetNameImpl()
{
  return hwy::TargetName(HWY_TARGET);
}

void NegativeExp2Impl(const float* in, float* out, std::size_t count)
{
  const hn::ScalableTag<float> d;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d))
    hn::StoreU(NegExp2(d, hn::LoadU(d, in + i)), d, out + i);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(TargetNameImpl);
HWY_EXPORT(NegativeExp2Impl);

std::vector<SimdTarget> SimdTargets()
{
  hwy::SetSupportedTargetsForTest(0);
  std::vector<SimdTarget> targets;
  // Lower bits are better targets.
  for (std::int64_t mask = hwy::SupportedTargets() & HWY_TARGETS; mask; mask &= mask - 1)
  {
    const std::int64_t id = mask & -mask;
    targets.push_back({ id, hwy::TargetName(id) });
  }
  hwy::GetChosenTarget().DeInit();
  return targets;
}

void ForceSimdTarget(std::int64_t id)
{
  hwy::SetSupportedTargetsForTest(id);
  hwy::GetChosenTarget().DeInit();
}

const char* SimdTargetName()
{
  return HWY_DYNAMIC_DISPATCH(TargetNameImpl)();
}

void NegativeExp2(const float* in, float* out, std::size_t count) noexcept
{
  HWY_DYNAMIC_DISPATCH(NegativeExp2Impl)(in, out, count);
}
}
#endif
