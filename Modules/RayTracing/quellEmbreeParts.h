// SPDX-License-Identifier: BSD-3-Clause
// What quellEmbreeScene.cxx, quellEmbreePose.cxx and quellEmbreeLights.cxx share.
#ifndef quellEmbreeParts_h
#define quellEmbreeParts_h

#include "quellEmbreeScene.h"
#include "vtkSMPTools.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <unordered_map>

namespace quell
{
namespace parts
{
constexpr std::size_t MostWarnings = 40;
/// Times within the shutter are multiples of 1 / this of it.
constexpr int ShutterGrid = 128;
/// Pieces of a moving lamp's way.
constexpr int LampSegments = 16;
/// An instance is traced in its mesh's space, in float. Matrices that stretch directions more differently than this
/// would lose digits there.
constexpr double WorstCondition = 8;
constexpr std::size_t VerticesPerTask = 8192;

inline double Seconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

inline void Check(RTCDevice device)
{
  const RTCError error = rtcGetDeviceError(device);
  if (error != RTC_ERROR_NONE)
    throw std::runtime_error(error == RTC_ERROR_OUT_OF_MEMORY ? "the scene does not fit into memory"
                             : error == RTC_ERROR_UNSUPPORTED_CPU
                               ? "this CPU is not supported by Embree"
                               : "Embree failed (error " + std::to_string(int(error)) + ")");
}

inline std::string Quoted(const char* what, const std::string& name, int index)
{
  return std::string(what) + (name.empty() ? ' ' + std::to_string(index) : " \"" + name + '"');
}

inline bool Usable(const Vec3f& p)
{
  return std::fabs(p.x) <= LargestCoordinate && std::fabs(p.y) <= LargestCoordinate &&
         std::fabs(p.z) <= LargestCoordinate; // false for NaN
}
inline bool Usable(const Vec3d& p)
{
  return std::fabs(p.x) <= LargestCoordinate && std::fabs(p.y) <= LargestCoordinate &&
         std::fabs(p.z) <= LargestCoordinate;
}

inline bool IsFinite(const Mat4& m)
{
  bool finite = true;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      finite &= std::isfinite(m.m[i][j]);
  return finite;
}
inline bool Same(const Mat4& a, const Mat4& b)
{
  bool same = true;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      same &= a.m[i][j] == b.m[i][j];
  return same;
}
inline bool IsIdentity(const Mat4& m)
{
  return Same(m, Mat4());
}
inline bool Same(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b)
{
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Vec3f)) == 0);
}

inline Mat4 Mix(const Mat4& a, const Mat4& b, double f)
{
  Mat4 m;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      m.m[i][j] = a.m[i][j] + (b.m[i][j] - a.m[i][j]) * f;
  return m;
}

/// How differently a matrix stretches directions: 1 for rotations and uniform scales, infinite for a singular one.
inline double Condition(const Mat4& m)
{
  const Vec3d a{ m.m[0][0], m.m[1][0], m.m[2][0] }, b{ m.m[0][1], m.m[1][1], m.m[2][1] },
    c{ m.m[0][2], m.m[1][2], m.m[2][2] };
  const Vec3d p = Cross(b, c), q = Cross(c, a), r = Cross(a, b);
  const double determinant = std::fabs(Dot(a, p));
  const double condition =
    std::sqrt((Dot(a, a) + Dot(b, b) + Dot(c, c)) * (Dot(p, p) + Dot(q, q) + Dot(r, r))) / (3 * determinant);
  return determinant > 0 && std::isfinite(condition) ? condition : std::numeric_limits<double>::infinity();
}

/// Cofactors, in units that keep them near 1 whatever the scale of the matrix; the sign makes normals of mirrored parts
/// point outside.
inline void NormalMatrix(const Mat4& m, float (&out)[3][3])
{
  Mat4 unit;
  double largest = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      largest = std::max(largest, std::fabs(m.m[i][j]));
  const double scale = largest > 0 && std::isfinite(largest) ? 1 / largest : 1;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      unit.m[i][j] = m.m[i][j] * scale;
  double n[3][3];
  largest = 0;
  for (int j = 0; j < 3; ++j)
  {
    const Vec3d column = unit.Normal({ j == 0 ? 1. : 0., j == 1 ? 1. : 0., j == 2 ? 1. : 0. });
    for (int i = 0; i < 3; ++i)
    {
      n[i][j] = column[i];
      largest = std::max(largest, std::fabs(column[i]));
    }
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out[i][j] = largest > 0 && std::isfinite(largest) ? float(n[i][j] / largest) : 0.f;
}

/// Which segment a time in [0, 1] falls into, and how far: as Embree does it.
inline int Segment(float time, int segments, double& f)
{
  const float scaled = time * float(segments);
  const int i = int(std::max(0.f, std::min(std::floor(scaled), float(segments - 1))));
  f = double(scaled - float(i));
  return i;
}

struct Counted
{
  std::size_t Broken = 0, Flat = 0, Index = 0, Repeated = 0;
  std::string Text(std::size_t total) const
  {
    const std::size_t all = this->Broken + this->Flat + this->Index + this->Repeated;
    if (all == 0)
      return {};
    std::string why;
    const auto add = [&](std::size_t count, const char* text)
    {
      if (count > 0)
        why += (why.empty() ? "" : ", ") + (count == all ? std::string() : std::to_string(count) + ' ') + text;
    };
    add(this->Broken, "corners that are not finite or beyond 1e18");
    add(this->Flat, "no area");
    add(this->Index, "indices of no vertex");
    add(this->Repeated, "in the place of another, which would shine twice");
    return std::to_string(all) + " of " + std::to_string(total) + " triangles left out (" + why + ")";
  }
};

/// Triangles of a mesh that can be traced, by positions of their vertices. `own` stays empty and `corners` points to
/// the mesh where that is all of them.
inline Counted SelectTriangles(const Mesh& mesh, const Vec3f* points, bool dropFlat, bool dropRepeated, bool twoSided,
  std::vector<std::uint32_t>& own, const std::uint32_t*& corners, std::size_t& triangles)
{
  Counted out;
  const std::size_t total = mesh.Indices.size() / 3;
  const std::uint32_t count = std::uint32_t(mesh.Positions.size());
  own.clear();
  bool all = true;
  std::unordered_multimap<std::uint64_t, std::uint32_t> seen;
  const auto key = [&](const std::uint32_t* v)
  {
    // the same for any order of the corners
    std::uint64_t sum = 0;
    for (int k = 0; k < 3; ++k)
    {
      std::uint64_t h = 0x9e3779b97f4a7c15u;
      for (int c = 0; c < 3; ++c)
      {
        const float x = points[v[k]][c] + 0.f; // -0 becomes 0
        std::uint32_t bits;
        std::memcpy(&bits, &x, sizeof bits);
        h = (h ^ bits) * 0xff51afd7ed558ccdu;
        h ^= h >> 29;
      }
      sum += h;
    }
    return sum;
  };
  const auto repeats = [&](const std::uint32_t* a, const std::uint32_t* b)
  {
    for (int r = 0; r < 3; ++r)
      for (int turn = 1; turn <= (twoSided ? 2 : 1); ++turn)
        if (points[a[0]] == points[b[r]] && points[a[1]] == points[b[(r + turn) % 3]] &&
            points[a[2]] == points[b[(r + 2 * turn) % 3]])
          return true;
    return false;
  };
  for (std::size_t t = 0; t < total; ++t)
  {
    const std::uint32_t* v = &mesh.Indices[3 * t];
    bool usable = false;
    if (!(v[0] < count && v[1] < count && v[2] < count))
      ++out.Index;
    else if (!Usable(points[v[0]]) || !Usable(points[v[1]]) || !Usable(points[v[2]]))
      ++out.Broken;
    else
    {
      usable = true;
      if (dropFlat)
      {
        const Vec3d a(points[v[0]]), b(points[v[1]]), c(points[v[2]]);
        usable = Length(Cross(b - a, c - a)) > 0;
        out.Flat += !usable;
      }
      if (usable && dropRepeated)
      {
        const std::uint64_t k = key(v);
        const auto range = seen.equal_range(k);
        for (auto i = range.first; i != range.second && usable; ++i)
          usable = !repeats(&mesh.Indices[3 * std::size_t(i->second)], v);
        if (usable)
          seen.emplace(k, std::uint32_t(t));
        out.Repeated += !usable;
      }
    }
    if (all && !usable)
    {
      all = false;
      own.assign(mesh.Indices.begin(), mesh.Indices.begin() + std::ptrdiff_t(3 * t));
    }
    else if (!all && usable)
      own.insert(own.end(), v, v + 3);
  }
  own.shrink_to_fit();
  corners = all ? mesh.Indices.data() : own.data();
  triangles = all ? total : own.size() / 3;
  return out;
}

inline void Extend(const Vec3d& p, Vec3d& lower, Vec3d& upper)
{
  for (int c = 0; c < 3; ++c)
  {
    lower[c] = std::min(lower[c], p[c]);
    upper[c] = std::max(upper[c], p[c]);
  }
}

/// Box of the triangles' corners; lower > upper: none.
inline void Enclose(
  const Vec3f* points, const std::uint32_t* corners, std::size_t triangles, Vec3d& lower, Vec3d& upper)
{
  Vec3f lo(std::numeric_limits<float>::infinity()), hi(-std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < 3 * triangles; ++i)
  {
    const Vec3f& p = points[corners[i]];
    lo = { std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z) };
    hi = { std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z) };
  }
  lower = Vec3d(lo);
  upper = Vec3d(hi);
}

inline Vec3d BoxCorner(const Vec3d& lower, const Vec3d& upper, int i)
{
  return { i & 1 ? upper.x : lower.x, i & 2 ? upper.y : lower.y, i & 4 ? upper.z : lower.z };
}

inline bool Far(const Vec3d& lower, const Vec3d& upper)
{
  return Length(lower + upper) * 0.5 > 2 * Length(upper - lower);
}

/// Whether positions rounded to float change the shape of what is in the box by more than 1e-4.
inline bool Rounded(const Vec3d& lower, const Vec3d& upper)
{
  return Length(lower + upper) * 0.5 > 1000 * Length(upper - lower);
}

/// Embree reads 16 bytes where a vertex has 12: the last one needs something behind it.
inline const Vec3f* Padded(const std::vector<Vec3f>& positions)
{
  return positions.capacity() > positions.size() ? positions.data() : nullptr;
}

inline void SetBuffers(RTCGeometry geometry, const std::vector<const Vec3f*>& points, std::size_t vertices,
  const std::uint32_t* corners, std::size_t triangles)
{
  rtcSetGeometryTimeStepCount(geometry, unsigned(points.size()));
  for (std::size_t k = 0; k < points.size(); ++k)
    rtcSetSharedGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, unsigned(k), RTC_FORMAT_FLOAT3, points[k], 0, sizeof(Vec3f), vertices);
  rtcSetSharedGeometryBuffer(
    geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, corners, 0, 3 * sizeof(std::uint32_t), triangles);
}

inline void SetPlace(RTCGeometry geometry, unsigned step, const Mat4& m)
{
  float rows[12];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      rows[4 * i + j] = float(m.m[i][j]);
  rtcSetGeometryTransform(geometry, step, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, rows);
}
}
}

#endif
