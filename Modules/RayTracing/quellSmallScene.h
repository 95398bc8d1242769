// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSmallScene_h
#define quellSmallScene_h

#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <cstdint>

namespace quell
{
struct Wavefront;

/// A scene of so few triangles that rays are tested against all of them, many rays at a time, instead of asking a
/// hierarchy ray by ray.
///
/// A ray o + t d passes the edge from a to b on the side whose sign is that of
///   (b - a) . (d x (a - o)),
/// which is computed once for all triangles that share the edge: no ray slips through between them. It is inside of a
/// triangle where the sides of its three edges agree (up to 2^-23 of their sum, for edges that meet without sharing
/// corners); they are its barycentrics, not divided by their sum (Kensler, Shirley: Optimizing ray-triangle
/// intersection via automated search, IEEE Symposium on Interactive Ray Tracing 2006, section 2). Then
/// t = n . (a - o) / n . d. Of hits at the same t the first triangle's counts.
struct VTKQUELLRAYTRACING_EXPORT SmallScene
{
  static constexpr int MostTriangles = 64, MostVertices = 128, MostEdges = 160;

  struct Edge
  {
    float X, Y, Z;
    std::int32_t From; ///< vertex
  };
  struct Triangle
  {
    float Nx, Ny, Nz;       ///< unit
    std::int32_t Corner;    ///< vertex
    std::int32_t Edges[3];  ///< opposite of the corners
    std::uint32_t Flips[3]; ///< the sign bit where the edge is stored the other way round
    std::uint32_t Part, Primitive;
  };
  int Vertices = 0, Edges = 0, Triangles = 0;
  float VertexX[MostVertices], VertexY[MostVertices], VertexZ[MostVertices];
  Edge EdgeOf[MostEdges];
  Triangle TriangleOf[MostTriangles];

  void Clear() noexcept { this->Vertices = this->Edges = this->Triangles = 0; }
  /// False: there is no place for it, its numbers are too large or too small for products of three, or it has no area;
  /// then the scene must not be used.
  bool Add(const Vec3f& a, const Vec3f& b, const Vec3f& c, std::uint32_t part, std::uint32_t primitive) noexcept;
  /// Whether testing all of it is faster than a hierarchy.
  bool IsWorthIt() const noexcept;

private:
  int VertexAt(const Vec3f& p) noexcept;
  bool EdgeBetween(int a, int b, std::int32_t& edge, std::uint32_t& flip) noexcept;
};

namespace lanes
{
/// What WavefrontAccess::Intersect says of the rows: Alive, Geometry, Primitive, U, V, T.
VTKQUELLRAYTRACING_EXPORT void Meet(const SmallScene& scene, Wavefront& w) noexcept;
/// Lit becomes 0 where the row's shadow ray meets anything.
VTKQUELLRAYTRACING_EXPORT void Block(const SmallScene& scene, Wavefront& w) noexcept;
}
}

#endif
