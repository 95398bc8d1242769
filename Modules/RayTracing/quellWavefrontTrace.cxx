// SPDX-License-Identifier: BSD-3-Clause
// Rays of wavefronts: Embree answers ray by ray, so that no answer depends on the company a ray is in (packets may
// break ties between coplanar triangles differently).
#include "quellWavefront.h"

#include "quellBsdf.h"

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
}

void WavefrontAccess::Intersect(const EmbreeScene& scene, EmbreeScene::Context& context, Wavefront& w,
  const std::uint32_t* keys, std::vector<RecordedRay>* record) noexcept
{
  const Wavefront::State& s = w.Live;
  RTCRayHit r;
  for (int i = 0; i < w.Count; ++i)
  {
    SetRay(r.ray, s.Ox[i], s.Oy[i], s.Oz[i], s.Dx[i], s.Dy[i], s.Dz[i], Infinity, s.Time[i]);
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    if (keys)
      context.Key = keys[i];
    rtcIntersect1(scene.Rtc, &context.Rtc, &r);
    if (scene.Moving)
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
      __builtin_prefetch(&scene.Parts[part].Corners[3 * std::size_t(r.hit.primID)]);
    if (record)
      record->push_back(
        { { s.Ox[i], s.Oy[i], s.Oz[i] }, { s.Dx[i], s.Dy[i], s.Dz[i] }, Infinity, 0, keys ? keys[i] : 0 });
  }
}

void WavefrontAccess::Fetch(const EmbreeScene& scene, Wavefront& w) noexcept
{
  constexpr int ahead = 6;
  const auto vertices = [&](int i)
  {
    const EmbreeScene::Part& part = scene.Parts[w.Geometry[i]];
    const std::uint32_t* v = &part.Corners[3 * std::size_t(w.Primitive[i])];
    for (int k = 0; k < 3; ++k)
      __builtin_prefetch(&part.Points[3 * std::size_t(v[k])]);
    if (part.Normals)
      for (int k = 0; k < 3; ++k)
        __builtin_prefetch(&part.Normals[v[k]]);
    if (!part.Geometry->TexCoords[0].empty())
      for (int k = 0; k < 3; ++k)
        __builtin_prefetch(part.Geometry->TexCoords[0].data() + v[k]);
  };
  w.Bent = false;
  w.Elsewhere = false;
  w.Varies = false;
  w.Emitters = 0;
  for (int i = 0; i < ahead && i < w.Count; ++i)
    if (w.Alive[i])
      vertices(i);
  for (int i = 0; i < w.Count; ++i)
  {
    if (i + ahead < w.Count && w.Alive[i + ahead])
      vertices(i + ahead);
    w.Material[i] = 0;
    w.Ar[i] = w.Ag[i] = w.Ab[i] = 0;
    if (!w.Alive[i])
    {
      for (int k = 0; k < 9; ++k)
        w.Corner[k][i] = 0;
      continue;
    }
    const EmbreeScene::Part& part = scene.Parts[w.Geometry[i]];
    const std::uint32_t* v = &part.Corners[3 * std::size_t(w.Primitive[i])];
    for (int k = 0; k < 3; ++k)
    {
      const float* p = &part.Points[3 * std::size_t(v[k])];
      w.Corner[3 * k][i] = p[0];
      w.Corner[3 * k + 1][i] = p[1];
      w.Corner[3 * k + 2][i] = p[2];
    }
    const Material& m = scene.Source->Materials[std::size_t(part.Material)];
    std::uint32_t flags = 0;
    if (part.Mirrored)
      flags |= Mirrored;
    if (part.Normals || m.NormalTexture.Texture >= 0)
    {
      flags |= Bent;
      w.Bent = true;
    }
    if (part.Kind != EmbreeScene::Placement::Flat)
    {
      flags |= Elsewhere | Bent;
      w.Elsewhere = w.Bent = true;
    }
    if (!part.LightIndex.empty() || m.Unlit || MaxComponent(scene.Emissions[std::size_t(part.Material)]) > 0)
      w.Emitter[w.Emitters++] = std::uint32_t(i);
    w.Material[i] = flags;
    if (part.Plain)
    {
      const Vec3f& a = scene.Surfaces[std::size_t(part.Material)].Diffuse;
      w.Ar[i] = a.x;
      w.Ag[i] = a.y;
      w.Ab[i] = a.z;
    }
    else
    {
      w.Material[i] |= Varies;
      w.Varies = true;
    }
  }
}

void WavefrontAccess::Straighten(const EmbreeScene& scene, Wavefront& w) noexcept
{
  if (!w.Elsewhere)
    return;
  for (int i = 0; i < w.Count; ++i)
  {
    if (!(w.Material[i] & Elsewhere))
      continue;
    SurfaceHit hit;
    hit.Geometry = w.Geometry[i];
    hit.Primitive = w.Primitive[i];
    hit.U = w.U[i];
    hit.V = w.V[i];
    hit.T = w.T[i];
    hit.Time = w.Live.Time[i];
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
  hit.Geometry = w.Geometry[i];
  hit.Primitive = w.Primitive[i];
  hit.U = w.U[i];
  hit.V = w.V[i];
  hit.T = w.T[i];
  hit.Time = w.Live.Time[i];
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
  const std::uint32_t* keys, std::vector<RecordedRay>* record) noexcept
{
  RTCRay r;
  std::int64_t count = 0;
  for (int i = 0; i < w.Count; ++i)
  {
    if (!w.Lit[i])
      continue;
    ++count;
    SetRay(r, w.Kx[i], w.Ky[i], w.Kz[i], w.Jx[i], w.Jy[i], w.Jz[i], w.Far[i], w.Live.Time[i]);
    if (keys)
      context.Key = keys[i];
    rtcOccluded1(scene.Rtc, &context.Rtc, &r);
    if (scene.Moving && !(r.tfar < 0))
      rtcOccluded1(scene.Moving, &context.Rtc, &r);
    if (r.tfar < 0)
      w.Lit[i] = 0;
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
  return !scene.Has.SeeThrough;
}

bool WavefrontAccess::OnlyOpaque(const EmbreeScene& scene) noexcept
{
  for (const Surface& s : scene.Surfaces)
    if (s.Layered())
      return false;
  return !scene.Has.SeeThrough;
}

bool WavefrontAccess::CanPickTriangles(const EmbreeScene& scene) noexcept
{
  const LightSampler& l = scene.LightSource;
  if (l.GetTriangles().empty() || l.GetTriangles().size() > 16)
    return false;
  for (const LightTriangle& t : l.GetTriangles())
    if (t.Textured)
      return false;
  return !scene.Has.MovingLights && !l.UsesTree() && l.GetPunctual().empty() && !(l.LocalShare() < 1) &&
         l.GetTriangles().size() == l.GetLocalCdf().size();
}

void WavefrontAccess::PickTriangles(const EmbreeScene& scene, Wavefront& w) noexcept
{
  const LightSampler& l = scene.LightSource;
  const double* cdf = l.GetLocalCdf().data();
  const std::size_t last = l.GetLocalCdf().size() - 1;
  const LightTriangle* triangles = l.GetTriangles().data();
  for (int i = 0; i < w.Count; ++i)
  {
    const double x = double(w.Random[2 * PairLightPick][i]);
    std::size_t k = 0;
    while (k < last && !(cdf[k] > x))
      ++k;
    const LightTriangle& t = triangles[k];
    const float place[9] = { t.V0.x, t.V0.y, t.V0.z, t.E1.x, t.E1.y, t.E1.z, t.E2.x, t.E2.y, t.E2.z };
    for (int c = 0; c < 9; ++c)
      w.Corner[c][i] = place[c];
    w.Jx[i] = t.N.x;
    w.Jy[i] = t.N.y;
    w.Jz[i] = t.N.z;
    w.Far[i] = t.Offset;
    w.Kx[i] = t.TwoSided ? 1.f : 0.f;
    w.LightPdf[i] = t.PdfArea;
    w.Er[i] = t.Emission.x;
    w.Eg[i] = t.Emission.y;
    w.Eb[i] = t.Emission.z;
    w.LightFlags[i] = w.Alive[i] ? Wavefront::LightDrawn | Wavefront::LightHittable : 0u;
    w.LightIndex[i] = std::uint32_t(k);
  }
}

std::int64_t WavefrontAccess::Replay(const EmbreeScene& scene, const std::vector<RecordedRay>& rays) noexcept
{
  EmbreeScene::Context context; // see-through surfaces read what lies behind Embree's own
  scene.Begin(context);
  std::int64_t met = 0;
  RTCRayHit r;
  for (const RecordedRay& o : rays)
  {
    context.Key = o.Key;
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
