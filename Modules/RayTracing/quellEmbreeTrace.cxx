// SPDX-License-Identifier: BSD-3-Clause
// Rays against the scene.
#include "quellEmbreeScene.h"
#include "quellSampler.h"
#include "quellWavefront.h"

#include <algorithm>
#include <cmath>
#include <tuple>

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
  if (!part.InPlace)
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
  context.Panes.Count = 0;
  rtcOccluded1(this->Rtc, &context.Rtc, &r);
  if (this->Moving && !(r.tfar < 0))
    rtcOccluded1(this->Moving, &context.Rtc, &r);
  return r.tfar < 0;
}

namespace
{
/// The part that was hit; a body's geometry belongs to many.
std::size_t PartOf(const RTCFilterFunctionNArguments* args) noexcept
{
  const unsigned instance = args->context->instID[0];
  return instance != RTC_INVALID_GEOMETRY_ID ? std::size_t(instance)
                                             : reinterpret_cast<std::size_t>(args->geometryUserPtr);
}
}

void EmbreeScene::PassBackFaces(const Part& part, const RTCFilterFunctionNArguments* args) noexcept
{
  // An instance's ray and normal are its mesh's, where the front is what the corners say; baked corners are mirrored.
  const bool local = args->context->instID[0] != RTC_INVALID_GEOMETRY_ID;
  const float sign = part.Mirrored && !local ? -1.f : 1.f;
  for (unsigned i = 0; i < args->N; ++i)
  {
    const float cosine = RTCHitN_Ng_x(args->hit, args->N, i) * RTCRayN_dir_x(args->ray, args->N, i) +
                         RTCHitN_Ng_y(args->hit, args->N, i) * RTCRayN_dir_y(args->ray, args->N, i) +
                         RTCHitN_Ng_z(args->hit, args->N, i) * RTCRayN_dir_z(args->ray, args->N, i);
    if (args->valid[i] == -1 && sign * cosine > 0)
      args->valid[i] = 0;
  }
}

void EmbreeScene::SeeThrough(const RTCFilterFunctionNArguments* args)
{
  const Context* context = reinterpret_cast<const Context*>(args->context);
  const EmbreeScene& self = *context->Self;
  const std::size_t index = PartOf(args);
  const Part& part = self.Parts[index];
  if (part.OneSided)
    PassBackFaces(part, args);
  if (!part.AlphaTested)
    return;
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

void EmbreeScene::PassPanes(const RTCFilterFunctionNArguments* args)
{
  Context* context = reinterpret_cast<Context*>(args->context);
  const EmbreeScene& self = *context->Self;
  const std::size_t index = PartOf(args);
  const Part& part = self.Parts[index];
  if (part.AlphaTested)
    SeeThrough(args); // glass is never one-sided
  PanesMet& panes = context->Panes;
  for (unsigned i = 0; i < args->N; ++i)
  {
    if (args->valid[i] != -1 || panes.Allowed == 0)
      continue;
    PanesMet::One met;
    met.T = RTCRayN_tfar(args->ray, args->N, i);
    met.U = RTCHitN_u(args->hit, args->N, i);
    met.V = RTCHitN_v(args->hit, args->N, i);
    met.Geometry = std::uint32_t(index);
    met.Primitive = RTCHitN_primID(args->hit, args->N, i);
    SurfaceHit hit;
    hit.Geometry = met.Geometry;
    hit.Primitive = met.Primitive;
    hit.U = met.U;
    hit.V = met.V;
    Vec3f unlit;
    float roughness;
    const bool pane = part.Plain ? self.Surfaces[std::size_t(part.Material)].IsPane()
                                 : WavefrontAccess::Resolve(self, hit, roughness, unlit).IsPane();
    if (!pane)
      continue;
    // A hierarchy may ask twice about one triangle, and a ray through an edge meets both of its triangles.
    bool known = false;
    for (int k = 0; k < panes.Count; ++k)
    {
      const PanesMet::One& other = panes.Met[k];
      known |= other.Geometry == met.Geometry &&
               (other.Primitive == met.Primitive || std::fabs(other.T - met.T) <= 1e-6f * met.T);
    }
    if (!known && panes.Count == panes.Allowed)
      continue;
    if (!known)
      panes.Met[panes.Count++] = met;
    args->valid[i] = 0;
  }
}

Vec3f EmbreeScene::PassedBy(PanesMet& panes, const Vec3f& direction, float time) const noexcept
{
  std::sort(panes.Met, panes.Met + panes.Count,
    [](const PanesMet::One& a, const PanesMet::One& b)
    { return std::tie(a.T, a.Geometry, a.Primitive) < std::tie(b.T, b.Geometry, b.Primitive); });
  const Vec3f along = Normalized(direction);
  Vec3f passed(1.f);
  for (int k = 0; k < panes.Count; ++k)
  {
    const PanesMet::One& met = panes.Met[k];
    SurfaceHit hit;
    hit.Geometry = met.Geometry;
    hit.Primitive = met.Primitive;
    hit.U = met.U;
    hit.V = met.V;
    hit.Time = time;
    this->Locate(this->Parts[hit.Geometry], hit, along);
    SurfacePoint point;
    this->Shade(hit, along, point);
    passed *= point.Material.StraightThrough(point.Normals, -along);
  }
  return passed;
}
}
