// SPDX-License-Identifier: BSD-3-Clause
// Where a hit is: corners, positions, normals and tangents at the time of the ray, and one frame before.
#include "quellEmbreeParts.h"
#include "quellMaterial.h"

namespace quell
{
using namespace parts;

void EmbreeScene::CornersAt(const Part& part, std::uint32_t primitive, float time, Vec3d (&p)[3]) const noexcept
{
  const std::uint32_t* v = &part.Corners[3 * std::size_t(primitive)];
  const bool blurred = time >= 0 && part.Open.Segments > 0;
  double f = 0;
  const std::size_t k = blurred ? std::size_t(Segment(time, part.Open.Segments, f)) : 0;
  if (part.Kind == Placement::Baked && blurred)
  {
    const Vec3f *a = part.Open.Points[k].data(), *b = part.Open.Points[k + 1].data();
    for (int c = 0; c < 3; ++c)
      p[c] = Vec3d(a[v[c]]) + (Vec3d(b[v[c]]) - Vec3d(a[v[c]])) * f;
    return;
  }
  for (int c = 0; c < 3; ++c)
    p[c] = Vec3d(Corner(part, v[c]));
  if (part.Kind != Placement::Rigid)
    return;
  if (blurred)
  {
    const Mat4 m = Mix(part.Open.Place[k], part.Open.Place[k + 1], f);
    for (int c = 0; c < 3; ++c)
      p[c] = m.Point(p[c]);
  }
  else
    for (int c = 0; c < 3; ++c)
      p[c] = part.Place.Point(p[c]);
}

void EmbreeScene::Locate(const Part& part, SurfaceHit& hit, const Vec3f& direction) const noexcept
{
  Vec3d p[3];
  this->CornersAt(part, hit, p);
  const Vec3d e1 = p[1] - p[0], e2 = p[2] - p[0];
  hit.P = p[0] + e1 * double(hit.U) + e2 * double(hit.V);
  hit.Pf = Vec3f(hit.P);
  const Vec3d n = Normalized(Cross(e1, e2) * (part.Mirrored ? -1. : 1.));
  hit.Ng = n == Vec3d() ? -direction : Vec3f(n); // a triangle that lost its area just now
  hit.Front = Dot(hit.Ng, direction) < 0;
  float largest = 0;
  for (const Vec3d& corner : p)
    for (int c = 0; c < 3; ++c)
      largest = std::max(largest, float(std::fabs(corner[c])));
  if (part.Kind == Placement::Rigid)
    for (int c = 0; c < 3; ++c)
      largest = std::max(largest, float(std::fabs(part.Place.m[c][3])));
  hit.Offset = largest * OffsetScale;
}

bool EmbreeScene::NormalAt(const Part& part, const SurfaceHit& hit, Vec3f& n) const noexcept
{
  if (!part.Normals)
    return false;
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  const float w = 1 - hit.U - hit.V;
  const auto between = [&](const Vec3f* list) { return list[v[0]] * w + list[v[1]] * hit.U + list[v[2]] * hit.V; };
  if (part.Open.Segments == 0)
  {
    const Vec3f m = between(part.Normals);
    for (int i = 0; i < 3; ++i)
      n[i] = part.ToNormal[i][0] * m.x + part.ToNormal[i][1] * m.y + part.ToNormal[i][2] * m.z;
  }
  else
  {
    double f;
    const std::size_t k = std::size_t(Segment(hit.Time, part.Open.Segments, f));
    if (part.Kind == Placement::Baked)
      n = between(part.Open.Normals[k].data()) * float(1 - f) + between(part.Open.Normals[k + 1].data()) * float(f);
    else
      n = Vec3f(Normalized(Mix(part.Open.Place[k], part.Open.Place[k + 1], f).Normal(Vec3d(between(part.Normals)))));
  }
  return n != Vec3f() && quell::IsFinite(n);
}

bool EmbreeScene::TangentAt(const Part& part, const SurfaceHit& hit, Vec3d& t, double& handed) const noexcept
{
  if (!part.Tangents)
    return false;
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  const float w = 1 - hit.U - hit.V;
  const auto between = [&](const Vec4f* list)
  { return list[v[0]].xyz() * w + list[v[1]].xyz() * hit.U + list[v[2]].xyz() * hit.V; };
  handed = (part.Tangents[v[0]].w < 0) != part.FlipTangents ? -1 : 1;
  if (part.Open.Segments == 0)
    t = part.World.Direction(Vec3d(between(part.Tangents)));
  else
  {
    double f;
    const std::size_t k = std::size_t(Segment(hit.Time, part.Open.Segments, f));
    if (part.Kind == Placement::Baked)
      t = Vec3d(between(part.Open.Tangents[k].data())) * (1 - f) + Vec3d(between(part.Open.Tangents[k + 1].data())) * f;
    else
      t = Mix(part.Open.Place[k], part.Open.Place[k + 1], f).Direction(Vec3d(between(part.Tangents)));
  }
  return true;
}

bool EmbreeScene::PreviousPosition(const SurfaceHit& hit, Vec3d& p) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  if (!part.Moved)
    return false;
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  Vec3d c[3];
  for (int k = 0; k < 3; ++k)
    c[k] =
      part.Kind == Placement::Baked ? Vec3d(part.PreviousPoints[v[k]]) : part.Previous.Point(Vec3d(Corner(part, v[k])));
  p = c[0] + (c[1] - c[0]) * double(hit.U) + (c[2] - c[0]) * double(hit.V);
  return true;
}

Vec3d EmbreeScene::ReferencePosition(const SurfaceHit& hit) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  if (part.Open.Segments == 0)
    return hit.P;
  Vec3d c[3];
  this->CornersAt(part, hit.Primitive, -1, c);
  return c[0] + (c[1] - c[0]) * double(hit.U) + (c[2] - c[0]) * double(hit.V);
}
}
