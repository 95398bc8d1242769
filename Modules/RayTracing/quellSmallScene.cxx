// SPDX-License-Identifier: BSD-3-Clause
#include "quellSmallScene.h"

#include "quellWavefront.h"

#include <algorithm>
#include <cmath>
#include <limits>

// Vectors whose length only the machine knows cannot be held in structures.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellSmallScene.cxx"
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
using M = decltype(hn::Lt(V(), V()));

HWY_INLINE V Set(float v)
{
  return hn::Set(Floats(), v);
}
/// A float's negative where `flip` is the sign bit.
HWY_INLINE V Turned(const float* side, std::uint32_t flip)
{
  return hn::Xor(hn::Load(Floats(), side), hn::BitCast(Floats(), hn::Set(Words(), flip)));
}

/// On which side of every edge some rays pass.
struct Sides
{
  static constexpr unsigned Lanes = HWY_MAX_BYTES / sizeof(float);
  alignas(64) float Of[SmallScene::MostEdges * Lanes];
  V Ox, Oy, Oz, Dx, Dy, Dz;

  HWY_INLINE void Find(const SmallScene& s)
  {
    const Floats d;
    alignas(64) float moment[3 * SmallScene::MostVertices * Lanes];
    for (int v = 0; v < s.Vertices; ++v)
    {
      const V x = Set(s.VertexX[v]) - this->Ox, y = Set(s.VertexY[v]) - this->Oy, z = Set(s.VertexZ[v]) - this->Oz;
      float* m = moment + 3 * Lanes * unsigned(v);
      hn::Store(this->Dy * z - this->Dz * y, d, m);
      hn::Store(this->Dz * x - this->Dx * z, d, m + Lanes);
      hn::Store(this->Dx * y - this->Dy * x, d, m + 2 * Lanes);
    }
    for (int e = 0; e < s.Edges; ++e)
    {
      const SmallScene::Edge& edge = s.EdgeOf[e];
      const float* m = moment + 3 * Lanes * unsigned(edge.From);
      hn::Store(
        Set(edge.X) * hn::Load(d, m) + Set(edge.Y) * hn::Load(d, m + Lanes) + Set(edge.Z) * hn::Load(d, m + 2 * Lanes),
        d, this->Of + Lanes * unsigned(e));
    }
  }
  /// The rays that pass a triangle inside; its corners' weights.
  HWY_INLINE M Inside(const SmallScene::Triangle& t, V& a, V& b, V& c) const
  {
    a = Turned(this->Of + Lanes * unsigned(t.Edges[0]), t.Flips[0]);
    b = Turned(this->Of + Lanes * unsigned(t.Edges[1]), t.Flips[1]);
    c = Turned(this->Of + Lanes * unsigned(t.Edges[2]), t.Flips[2]);
    const V slack = Set(0x1p-23f) * hn::Abs(a + b + c);
    return hn::Or(hn::Ge(hn::Min(hn::Min(a, b), c), hn::Neg(slack)), hn::Le(hn::Max(hn::Max(a, b), c), slack));
  }
  /// n . (a - o), n . d
  HWY_INLINE void Plane(const SmallScene& s, const SmallScene::Triangle& t, V& way, V& speed) const
  {
    const V x = Set(t.Nx), y = Set(t.Ny), z = Set(t.Nz);
    way = x * (Set(s.VertexX[t.Corner]) - this->Ox) + y * (Set(s.VertexY[t.Corner]) - this->Oy) +
          z * (Set(s.VertexZ[t.Corner]) - this->Oz);
    speed = x * this->Dx + y * this->Dy + z * this->Dz;
  }
};

void MeetImpl(const SmallScene& s, Wavefront& w)
{
  const Floats d;
  const Words words;
  const V zero = hn::Zero(d), infinity = Set(std::numeric_limits<float>::infinity());
  const Wavefront::State& live = w.Live;
  static_assert(Sides::Lanes <= 16, "rows behind the last are room for one vector");
  Sides sides;
  for (unsigned i = 0; i < unsigned(w.Count); i += unsigned(hn::Lanes(d)))
  {
    sides.Ox = hn::LoadU(d, live.Ox + i);
    sides.Oy = hn::LoadU(d, live.Oy + i);
    sides.Oz = hn::LoadU(d, live.Oz + i);
    sides.Dx = hn::LoadU(d, live.Dx + i);
    sides.Dy = hn::LoadU(d, live.Dy + i);
    sides.Dz = hn::LoadU(d, live.Dz + i);
    sides.Find(s);
    V nearest = infinity, weightB = zero, weightC = zero, all = Set(1);
    hn::Vec<Words> part = hn::Zero(words), primitive = hn::Zero(words);
    for (int k = 0; k < s.Triangles; ++k)
    {
      const SmallScene::Triangle& t = s.TriangleOf[k];
      V a, b, c;
      M in = sides.Inside(t, a, b, c);
      if (hn::AllFalse(d, in))
        continue;
      V way, speed;
      sides.Plane(s, t, way, speed);
      const V at = way / speed;
      in = hn::And(in, hn::And(hn::Gt(at, zero), hn::Lt(at, nearest)));
      nearest = hn::IfThenElse(in, at, nearest);
      weightB = hn::IfThenElse(in, b, weightB);
      weightC = hn::IfThenElse(in, c, weightC);
      all = hn::IfThenElse(in, a + b + c, all);
      const auto here = hn::RebindMask(words, in);
      part = hn::IfThenElse(here, hn::Set(words, t.Part), part);
      primitive = hn::IfThenElse(here, hn::Set(words, t.Primitive), primitive);
    }
    const auto found = hn::RebindMask(words, hn::Lt(nearest, infinity));
    hn::StoreU(hn::IfThenElseZero(found, hn::Set(words, ~0u)), words, w.Alive + i);
    hn::StoreU(part, words, w.Geometry + i);
    hn::StoreU(primitive, words, w.Primitive + i);
    hn::StoreU(weightB / all, d, w.U + i);
    hn::StoreU(weightC / all, d, w.V + i);
    hn::StoreU(nearest, d, w.T + i);
  }
}

void BlockImpl(const SmallScene& s, Wavefront& w)
{
  const Floats d;
  const Words words;
  const V zero = hn::Zero(d);
  Sides sides;
  for (unsigned i = 0; i < unsigned(w.Count); i += unsigned(hn::Lanes(d)))
  {
    // rows behind the last may say anything
    const auto lit = hn::LoadU(words, w.Lit + i);
    M open = hn::RebindMask(d, hn::Ne(lit, hn::Zero(words)));
    if (hn::AllFalse(d, open))
      continue;
    sides.Ox = hn::LoadU(d, w.Kx + i);
    sides.Oy = hn::LoadU(d, w.Ky + i);
    sides.Oz = hn::LoadU(d, w.Kz + i);
    sides.Dx = hn::LoadU(d, w.Jx + i);
    sides.Dy = hn::LoadU(d, w.Jy + i);
    sides.Dz = hn::LoadU(d, w.Jz + i);
    const V far = hn::LoadU(d, w.Far + i);
    sides.Find(s);
    for (int k = 0; k < s.Triangles; ++k)
    {
      const SmallScene::Triangle& t = s.TriangleOf[k];
      V a, b, c;
      const M in = hn::And(open, sides.Inside(t, a, b, c));
      if (hn::AllFalse(d, in))
        continue;
      V way, speed;
      sides.Plane(s, t, way, speed);
      const V at = way / speed;
      open = hn::AndNot(hn::And(in, hn::And(hn::Gt(at, zero), hn::Lt(at, far))), open);
      if (hn::AllFalse(d, open))
        break;
    }
    hn::StoreU(hn::IfThenElseZero(hn::RebindMask(words, open), lit), words, w.Lit + i);
  }
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(MeetImpl);
HWY_EXPORT(BlockImpl);

namespace lanes
{
void Meet(const SmallScene& scene, Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(MeetImpl)(scene, w);
}
void Block(const SmallScene& scene, Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(BlockImpl)(scene, w);
}
}

int SmallScene::VertexAt(const Vec3f& p) noexcept
{
  for (int i = 0; i < this->Vertices; ++i)
    if (this->VertexX[i] == p.x && this->VertexY[i] == p.y && this->VertexZ[i] == p.z)
      return i;
  if (this->Vertices == MostVertices)
    return -1;
  const int i = this->Vertices++;
  this->VertexX[i] = p.x;
  this->VertexY[i] = p.y;
  this->VertexZ[i] = p.z;
  return i;
}

bool SmallScene::EdgeBetween(int a, int b, std::int32_t& edge, std::uint32_t& flip) noexcept
{
  const int from = std::min(a, b), to = std::max(a, b);
  flip = a == from ? 0 : 0x80000000u;
  const float x = this->VertexX[to] - this->VertexX[from], y = this->VertexY[to] - this->VertexY[from],
              z = this->VertexZ[to] - this->VertexZ[from];
  for (edge = 0; edge < this->Edges; ++edge)
  {
    const Edge& e = this->EdgeOf[edge];
    if (e.From == from && e.X == x && e.Y == y && e.Z == z)
      return true;
  }
  if (this->Edges == MostEdges)
    return false;
  this->EdgeOf[this->Edges++] = { x, y, z, from };
  return true;
}

bool SmallScene::Add(
  const Vec3f& a, const Vec3f& b, const Vec3f& c, std::uint32_t part, std::uint32_t primitive) noexcept
{
  const Vec3d e1 = Vec3d(b) - Vec3d(a), e2 = Vec3d(c) - Vec3d(a), e3 = Vec3d(c) - Vec3d(b), n = Cross(e1, e2);
  for (const Vec3f& p : { a, b, c })
    for (int k = 0; k < 3; ++k)
      if (!(std::fabs(p[k]) <= 1e9f))
        return false;
  for (const Vec3d& e : { e1, e2, e3 })
    if (!(Length(e) >= 1e-9))
      return false;
  const double area = Length(n);
  const int v[3] = { this->VertexAt(a), this->VertexAt(b), this->VertexAt(c) };
  if (!(area > 0) || this->Triangles == MostTriangles || v[0] < 0 || v[1] < 0 || v[2] < 0)
    return false;
  Triangle& t = this->TriangleOf[this->Triangles];
  t.Nx = float(n.x / area);
  t.Ny = float(n.y / area);
  t.Nz = float(n.z / area);
  t.Corner = v[0];
  t.Part = part;
  t.Primitive = primitive;
  for (int k = 0; k < 3; ++k)
    if (!this->EdgeBetween(v[(k + 1) % 3], v[(k + 2) % 3], t.Edges[k], t.Flips[k]))
      return false;
  ++this->Triangles;
  return true;
}

bool SmallScene::IsWorthIt() const noexcept
{
  // Steps of a vector, against what a hierarchy takes for as many rays.
  return this->Triangles > 0 && 6 * this->Vertices + 3 * this->Edges + 12 * this->Triangles <= 1400;
}
}
#endif
