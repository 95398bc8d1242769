// SPDX-License-Identifier: BSD-3-Clause
// Rays of wavefronts: Embree answers ray by ray, so that no answer depends on the company a ray is in (packets may
// break ties between coplanar triangles differently).
#include "quellWavefront.h"

#include "quellMaterial.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace quell
{
namespace
{
void SetRay(RTCRay& r, float ox, float oy, float oz, float dx, float dy, float dz, float far, float time) noexcept
{
  r.org_x = ox;
  r.org_y = oy;
  r.org_z = oz;
  r.tnear = 0;
  r.dir_x = dx;
  r.dir_y = dy;
  r.dir_z = dz;
  r.time = time;
  r.tfar = far;
  r.mask = ~0u;
  r.id = 0;
  r.flags = 0;
}
constexpr float Infinity = std::numeric_limits<float>::infinity();

/// Whether a ray can meet anything in the box before its end; true where that is not sure.
bool MayMeet(const RTCBounds& box, const RTCRay& r) noexcept
{
  const auto inverse = [](float d) { return 1 / (std::fabs(d) < 1e-30f ? std::copysign(1e-30f, d) : d); };
  const float ix = inverse(r.dir_x), iy = inverse(r.dir_y), iz = inverse(r.dir_z);
  const float ax = (box.lower_x - r.org_x) * ix, bx = (box.upper_x - r.org_x) * ix;
  const float ay = (box.lower_y - r.org_y) * iy, by = (box.upper_y - r.org_y) * iy;
  const float az = (box.lower_z - r.org_z) * iz, bz = (box.upper_z - r.org_z) * iz;
  const float enter = std::max(std::max(std::min(ax, bx), std::min(ay, by)), std::min(az, bz));
  const float leave = std::min(std::min(std::max(ax, bx), std::max(ay, by)), std::max(az, bz));
  // Each of them is off by a few roundings of itself.
  constexpr float slack = 1e-6f;
  return !(enter - leave > slack * (std::fabs(enter) + std::fabs(leave)) || leave < 0 ||
           enter - slack * std::fabs(enter) > r.tfar);
}

/// What Embree says of the hit of row `i`.
void Copy(const Wavefront& w, int i, SurfaceHit& hit) noexcept
{
  hit.Geometry = w.Geometry[i];
  hit.Primitive = w.Primitive[i];
  hit.U = w.U[i];
  hit.V = w.V[i];
  hit.T = w.T[i];
  hit.Time = w.Live.Time[i];
}
}

void WavefrontAccess::Intersect(const EmbreeScene& scene, EmbreeScene::Context& context, Wavefront& w,
  const std::uint32_t* keys, std::vector<RecordedRay>* record) noexcept
{
  const Wavefront::State& s = w.Live;
  if (scene.Few.Triangles > 0)
  {
    lanes::Meet(scene.Few, w);
    for (int i = 0; record && i < w.Count; ++i)
      record->push_back({ { s.Ox[i], s.Oy[i], s.Oz[i] }, { s.Dx[i], s.Dy[i], s.Dz[i] }, Infinity, 0, 0 });
    return;
  }
  RTCRayHit r;
  for (int i = 0; i < w.Count; ++i)
  {
    SetRay(r.ray, s.Ox[i], s.Oy[i], s.Oz[i], s.Dx[i], s.Dy[i], s.Dz[i], Infinity, s.Time[i]);
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    if (keys)
      context.Key = keys[i];
    rtcIntersect1(scene.Rtc, &context.Rtc, &r);
    if (scene.Moving && MayMeet(scene.MovingBox, r.ray))
      rtcIntersect1(scene.Moving, &context.Rtc, &r);
    const bool found = r.hit.geomID != RTC_INVALID_GEOMETRY_ID && r.ray.tfar < Infinity;
    const std::uint32_t part = r.hit.instID[0] != RTC_INVALID_GEOMETRY_ID ? r.hit.instID[0] : r.hit.geomID;
    w.Alive[i] = found ? ~0u : 0u;
    w.Geometry[i] = found ? part : 0;
    w.Primitive[i] = found ? r.hit.primID : 0;
    w.U[i] = r.hit.u;
    w.V[i] = r.hit.v;
    w.T[i] = r.ray.tfar;
    if (found)
      __builtin_prefetch(&scene.Glances[part].Corners[3 * std::size_t(r.hit.primID)]);
    if (record)
      record->push_back(
        { { s.Ox[i], s.Oy[i], s.Oz[i] }, { s.Dx[i], s.Dy[i], s.Dz[i] }, Infinity, 0, keys ? keys[i] : 0 });
  }
}

void WavefrontAccess::Fetch(const EmbreeScene& scene, Wavefront& w, bool normals) noexcept
{
  constexpr int ahead = 6;
  const EmbreeScene::Glance* glances = scene.Glances.data();
  const auto vertices = [&](int i)
  {
    const EmbreeScene::Glance& part = glances[w.Geometry[i]];
    const std::uint32_t* v = &part.Corners[3 * std::size_t(w.Primitive[i])];
    for (int k = 0; k < 3; ++k)
      __builtin_prefetch(&part.Points[3 * std::size_t(v[k])]);
    if (part.Normals && normals)
      for (int k = 0; k < 3; ++k)
        __builtin_prefetch(&part.Normals[v[k]]);
    if (part.TexCoords && (part.Flags & Varies) != 0)
      for (int k = 0; k < 3; ++k)
        __builtin_prefetch(&part.TexCoords[v[k]]);
  };
  std::uint32_t any = 0;
  w.Emitters = 0;
  for (int i = 0; i < ahead && i < w.Count; ++i)
    if (w.Alive[i])
      vertices(i);
  for (int i = 0; i < w.Count; ++i)
  {
    if (i + ahead < w.Count && w.Alive[i + ahead])
      vertices(i + ahead);
    if (!w.Alive[i])
    {
      w.Material[i] = 0;
      w.Ar[i] = w.Ag[i] = w.Ab[i] = 0;
      for (int k = 0; k < 9; ++k)
        w.Corner[k][i] = 0;
      continue;
    }
    const EmbreeScene::Glance& part = glances[w.Geometry[i]];
    const std::uint32_t* v = &part.Corners[3 * std::size_t(w.Primitive[i])];
    for (int k = 0; k < 3; ++k)
    {
      const float* p = &part.Points[3 * std::size_t(v[k])];
      w.Corner[3 * k][i] = p[0];
      w.Corner[3 * k + 1][i] = p[1];
      w.Corner[3 * k + 2][i] = p[2];
    }
    if (part.Normals && normals)
    {
      // as EmbreeScene::NormalAt
      const Vec3f *a = part.Normals + v[0], *b = part.Normals + v[1], *c = part.Normals + v[2];
      const float s = w.U[i], t = w.V[i], r = 1 - s - t;
      const float x = a->x * r + b->x * s + c->x * t, y = a->y * r + b->y * s + c->y * t,
                  z = a->z * r + b->z * s + c->z * t;
      const float(&m)[3][3] = part.ToNormal;
      w.Nx[i] = m[0][0] * x + m[0][1] * y + m[0][2] * z;
      w.Ny[i] = m[1][0] * x + m[1][1] * y + m[1][2] * z;
      w.Nz[i] = m[2][0] * x + m[2][1] * y + m[2][2] * z;
    }
    w.Emitter[w.Emitters] = std::uint32_t(i);
    w.Emitters += (part.Flags & Emits) != 0;
    w.Material[i] = part.Flags;
    any |= part.Flags;
    w.Ar[i] = part.Diffuse.x;
    w.Ag[i] = part.Diffuse.y;
    w.Ab[i] = part.Diffuse.z;
  }
  w.Any = any;
}

void WavefrontAccess::Straighten(const EmbreeScene& scene, Wavefront& w) noexcept
{
  if (!(w.Any & Elsewhere))
    return;
  for (int i = 0; i < w.Count; ++i)
  {
    if (!(w.Material[i] & Elsewhere))
      continue;
    SurfaceHit hit;
    Copy(w, i, hit);
    scene.Locate(scene.Parts[hit.Geometry], hit, { w.Live.Dx[i], w.Live.Dy[i], w.Live.Dz[i] });
    const Vec3f n = hit.Front ? hit.Ng : -hit.Ng;
    w.Px[i] = hit.Pf.x;
    w.Py[i] = hit.Pf.y;
    w.Pz[i] = hit.Pf.z;
    w.Gx[i] = w.Sx[i] = n.x;
    w.Gy[i] = w.Sy[i] = n.y;
    w.Gz[i] = w.Sz[i] = n.z;
    w.Offset[i] = hit.Offset;
    w.Front[i] = hit.Front ? ~0u : 0u;
  }
}

void WavefrontAccess::Hit(const EmbreeScene& scene, const Wavefront& w, int i, bool position, SurfaceHit& hit) noexcept
{
  Copy(w, i, hit);
  hit.Pf = { w.Px[i], w.Py[i], w.Pz[i] };
  hit.Front = w.Front[i] != 0;
  hit.Ng = { w.Gx[i], w.Gy[i], w.Gz[i] };
  if (!hit.Front)
    hit.Ng = -hit.Ng;
  hit.Offset = w.Offset[i];
  if (position)
  {
    Vec3d p[3];
    scene.CornersAt(scene.Parts[hit.Geometry], hit, p);
    hit.P = p[0] + (p[1] - p[0]) * double(hit.U) + (p[2] - p[0]) * double(hit.V);
  }
}

std::int64_t WavefrontAccess::Occlude(const EmbreeScene& scene, EmbreeScene::Context& context, Wavefront& w,
  const std::uint32_t* keys, int panes, std::vector<RecordedRay>* record) noexcept
{
  std::int64_t count = 0;
  if (scene.Few.Triangles > 0)
  {
    for (int i = 0; i < w.Count; ++i)
    {
      if (!w.Lit[i])
        continue;
      ++count;
      if (record)
        record->push_back({ { w.Kx[i], w.Ky[i], w.Kz[i] }, { w.Jx[i], w.Jy[i], w.Jz[i] }, w.Far[i], 1, 0 });
    }
    lanes::Block(scene.Few, w);
    return count;
  }
  context.Panes.Allowed = scene.Has.Panes ? std::min(panes, EmbreeScene::PanesMet::Most) : 0;
  RTCRay r;
  for (int i = 0; i < w.Count; ++i)
  {
    if (!w.Lit[i])
      continue;
    ++count;
    SetRay(r, w.Kx[i], w.Ky[i], w.Kz[i], w.Jx[i], w.Jy[i], w.Jz[i], w.Far[i], w.Live.Time[i]);
    if (keys)
      context.Key = keys[i];
    context.Panes.Count = 0;
    rtcOccluded1(scene.Rtc, &context.Rtc, &r);
    if (scene.Moving && !(r.tfar < 0) && MayMeet(scene.MovingBox, r))
      rtcOccluded1(scene.Moving, &context.Rtc, &r);
    if (r.tfar < 0)
      w.Lit[i] = 0;
    else if (context.Panes.Count > 0)
    {
      const Vec3f passed = scene.PassedBy(context.Panes, { w.Jx[i], w.Jy[i], w.Jz[i] }, w.Live.Time[i]);
      w.Cr[i] *= passed.x;
      w.Cg[i] *= passed.y;
      w.Cb[i] *= passed.z;
      w.Br[i] *= passed.x;
      w.Bg[i] *= passed.y;
      w.Bb[i] *= passed.z;
    }
    if (record)
      record->push_back(
        { { w.Kx[i], w.Ky[i], w.Kz[i] }, { w.Jx[i], w.Jy[i], w.Jz[i] }, w.Far[i], 1, keys ? keys[i] : 0 });
  }
  return count;
}

bool WavefrontAccess::OnlyDiffuse(const EmbreeScene& scene) noexcept
{
  for (const Surface& s : scene.Surfaces)
    if (s.NeedsChoice())
      return false;
  return OnlyOpaque(scene);
}

bool WavefrontAccess::OnlyOpaque(const EmbreeScene& scene) noexcept
{
  for (const Material& m : scene.Source->Materials)
    if (MayBeLayered(m) || m.Volume)
      return false;
  return !scene.Has.SeeThrough;
}

bool WavefrontAccess::FindTriangles(const EmbreeScene& scene, FewTriangles& lights) noexcept
{
  const LightSampler& l = scene.LightSource;
  const std::vector<LightTriangle>& triangles = l.GetTriangles();
  const std::vector<double>& cdf = l.GetLocalCdf();
  if (triangles.empty() || triangles.size() > std::size_t(FewTriangles::Most) || triangles.size() != cdf.size() ||
      scene.Has.MovingLights || l.UsesTree() || !l.GetPunctual().empty() || l.LocalShare() < 1)
    return false;
  lights.Count = 0;
  for (const LightTriangle& t : triangles)
  {
    if (t.Textured)
      return false;
    const int k = lights.Count++;
    // the first float that is not below the end of the one before
    const double end = k > 0 ? cdf[std::size_t(k) - 1] : 0;
    lights.From[k] = float(end);
    if (double(lights.From[k]) < end)
      lights.From[k] = std::nextafter(lights.From[k], 2.f);
    const float numbers[FewTriangles::Numbers] = { t.V0.x, t.V0.y, t.V0.z, t.E1.x, t.E1.y, t.E1.z, t.E2.x, t.E2.y,
      t.E2.z, t.N.x, t.N.y, t.N.z, t.Offset, t.TwoSided ? 1.f : 0.f, t.PdfArea, t.Emission.x, t.Emission.y,
      t.Emission.z };
    std::copy_n(numbers, FewTriangles::Numbers, lights.Of[k]);
  }
  return true;
}

std::int64_t WavefrontAccess::Replay(const EmbreeScene& scene, const std::vector<RecordedRay>& rays) noexcept
{
  EmbreeScene::Context context; // see-through surfaces read what lies behind Embree's own
  scene.Begin(context);
  context.Panes.Allowed = scene.Has.Panes ? EmbreeScene::PanesMet::Most : 0;
  std::int64_t met = 0;
  RTCRayHit r;
  for (const RecordedRay& o : rays)
  {
    context.Key = o.Key;
    context.Panes.Count = 0;
    SetRay(r.ray, o.Origin.x, o.Origin.y, o.Origin.z, o.Direction.x, o.Direction.y, o.Direction.z, o.Far, 0);
    if (o.Shadow)
    {
      rtcOccluded1(scene.Rtc, &context.Rtc, &r.ray);
      met += r.ray.tfar < 0;
    }
    else
    {
      r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      rtcIntersect1(scene.Rtc, &context.Rtc, &r);
      met += r.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
  }
  return met;
}
}
