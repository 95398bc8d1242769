// SPDX-License-Identifier: BSD-3-Clause
// Rays against the scene.
#include "quellEmbreeScene.h"
#include "quellSampler.h"

#include <algorithm>
#include <cmath>

namespace quell
{
bool EmbreeScene::Intersect(Context& context, const TraceRay& ray, SurfaceHit& hit) const noexcept
{
  RTCRayHit r;
  r.ray.org_x = ray.Origin.x;
  r.ray.org_y = ray.Origin.y;
  r.ray.org_z = ray.Origin.z;
  r.ray.dir_x = ray.Direction.x;
  r.ray.dir_y = ray.Direction.y;
  r.ray.dir_z = ray.Direction.z;
  r.ray.tnear = 0;
  r.ray.tfar = ray.Far;
  r.ray.time = ray.Time;
  r.ray.mask = ~0u;
  r.ray.id = 0;
  r.ray.flags = 0;
  r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  context.Key = ray.Key;
  rtcIntersect1(this->Rtc, &context.Rtc, &r);
  if (this->Moving)
    rtcIntersect1(this->Moving, &context.Rtc, &r);
  if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID || !std::isfinite(r.ray.tfar))
    return false;
  hit.Geometry = r.hit.instID[0] != RTC_INVALID_GEOMETRY_ID ? r.hit.instID[0] : r.hit.geomID;
  hit.Primitive = r.hit.primID;
  hit.U = r.hit.u;
  hit.V = r.hit.v;
  hit.T = r.ray.tfar;
  hit.Time = ray.Time;
  const Part& part = this->Parts[hit.Geometry];
  if (part.Kind != Placement::Flat)
  {
    this->Locate(part, hit, ray.Direction);
    return true;
  }
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  const Vec3f a = this->Corner(part, v[0]), b = this->Corner(part, v[1]), c = this->Corner(part, v[2]);
  const Vec3d origin(a), e1 = Vec3d(b) - origin, e2 = Vec3d(c) - origin;
  hit.P = origin + e1 * double(hit.U) + e2 * double(hit.V);
  hit.Pf = Vec3f(hit.P);
  const Vec3d n = Cross(e1, e2);
  hit.Ng = Vec3f(n * ((part.Mirrored ? -1 : 1) / std::sqrt(Dot(n, n))));
  hit.Front = Dot(hit.Ng, ray.Direction) < 0;
  float largest = 0;
  for (int i = 0; i < 3; ++i)
    largest = std::max(largest, std::max(std::fabs(a[i]), std::max(std::fabs(b[i]), std::fabs(c[i]))));
  hit.Offset = largest * OffsetScale;
  return true;
}

bool EmbreeScene::Occluded(Context& context, const TraceRay& ray) const noexcept
{
  RTCRay r;
  r.org_x = ray.Origin.x;
  r.org_y = ray.Origin.y;
  r.org_z = ray.Origin.z;
  r.dir_x = ray.Direction.x;
  r.dir_y = ray.Direction.y;
  r.dir_z = ray.Direction.z;
  r.tnear = 0;
  r.tfar = ray.Far;
  r.time = ray.Time;
  r.mask = ~0u;
  r.id = 0;
  r.flags = 0;
  context.Key = ray.Key;
  rtcOccluded1(this->Rtc, &context.Rtc, &r);
  if (this->Moving && !(r.tfar < 0))
    rtcOccluded1(this->Moving, &context.Rtc, &r);
  return r.tfar < 0;
}

void EmbreeScene::SeeThrough(const RTCFilterFunctionNArguments* args)
{
  const Context* context = reinterpret_cast<const Context*>(args->context);
  const EmbreeScene& self = *context->Self;
  const unsigned instance = context->Rtc.instID[0]; // a body's geometry belongs to many parts
  const std::size_t index =
    instance != RTC_INVALID_GEOMETRY_ID ? std::size_t(instance) : reinterpret_cast<std::size_t>(args->geometryUserPtr);
  const Part& part = self.Parts[index];
  for (unsigned i = 0; i < args->N; ++i)
  {
    if (args->valid[i] != -1)
      continue;
    const std::uint32_t primitive = RTCHitN_primID(args->hit, args->N, i);
    const float u = RTCHitN_u(args->hit, args->N, i), v = RTCHitN_v(args->hit, args->N, i);
    const float alpha = self.AlphaAt(part, primitive, u, v);
    if (alpha < 1 && !(SurfaceRandom(context->Key, std::uint32_t(index), primitive) < alpha))
      args->valid[i] = 0;
  }
}
}
