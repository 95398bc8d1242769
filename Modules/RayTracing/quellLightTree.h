// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellLightTree_h
#define quellLightTree_h

#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace quell
{
/// A point that wants light, and the side of it that light must come from.
struct Receiver
{
  Vec3f Position;
  Vec3f Normal;           ///< shading normal, unit; 0: light from anywhere counts
  bool BothSides = false; ///< the surface also transmits
};

/// Where a light is, where it shines and how much; what a LightTree sorts.
struct LightBounds
{
  Vec3f Lower, Upper;
  Vec3f Axis{ 0, 0, 1 };                                ///< unit, middle of the emitting normals
  float CosSpread = 1;                                  ///< half angle of the cone of normals around Axis
  float CosExtent = 0;                                  ///< how far off a normal light still goes (0: a hemisphere)
  float Intensity = 0;                                  ///< W/sr along the normals
  float Power = 0;                                      ///< W
  float Reach = std::numeric_limits<float>::infinity(); ///< nothing arrives from farther away
  bool TwoSided = false;                                ///< shines along -Axis as well
};

/// Measure of the directions that a cone of normals (half angle `spread`) with emission up to `extent` off each of them
/// covers, both in radians (Conty Estevez, Kulla 2018, equation 1): (0, pi/2) gives pi, (pi, pi/2) 4 pi.
VTKQUELLRAYTRACING_EXPORT double LightConeMeasure(double spread, double extent) noexcept;

/// Picks one of many lights for a point, about in proportion to what it could send there (Conty Estevez and Kulla,
/// "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018).
///
/// A node is a box with a cone of normals and an intensity I (the sum of those below). Seen from a point at distance d
/// of its centre it counts for
///
///   importance = I cos(t') cos(i') / max(d^2, r^2),  t' = max(0, t - spread - b),  i' = max(0, i - b),
///
/// r half the box's diagonal, b the angle of the sphere of radius r seen from the point, t the angle between the axis
/// and the direction to the point, i the one at the receiver; 0 where t' reaches the extent, where i' reaches 90
/// degrees or beyond the reach. Inside the sphere both cosines are 1. At two-sided lights and at receivers that
/// transmit, |cos| replaces cos. So a light that can reach the point never counts 0, up to rounding.
///
/// The binary tree, split by 12 bins of the surface area and orientation heuristic on each axis, is stored four wide:
/// a visit weighs the four grandchildren at once and picks among them in proportion. Chance and Pick evaluate the same
/// expressions in the same order, so both give the same bits. Costs of a build: about 1 us per light; 120 bytes each.
class VTKQUELLRAYTRACING_EXPORT LightTree
{
public:
  static constexpr int Width = 4;
  static constexpr int DeepestBinary = 62; ///< levels of the binary tree; two of them make one of the stored tree

  /// Lights without intensity, or whose bounds are not finite, are never picked.
  void Build(const std::vector<LightBounds>& lights);
  bool Empty() const noexcept { return this->Nodes.empty(); }

  /// Light for `u` in [0, 1) and its chance. False: nothing below counts at this point (or it is not finite).
  bool Pick(const Receiver& at, double u, std::uint32_t& light, float& chance) const noexcept;
  /// The chance with which Pick picks `light`; 0 where it never does.
  float Chance(const Receiver& at, std::uint32_t light) const noexcept;

  /// Levels of the stored tree, and its size in bytes.
  int Depth() const noexcept { return this->Levels; }
  std::size_t Bytes() const noexcept;

private:
  struct alignas(16) Node
  {
    float X[Width] = {}, Y[Width] = {}, Z[Width] = {}; ///< centre, in units of the tree
    float Radius[Width] = {};                          ///< half diagonal
    float AxisX[Width] = {}, AxisY[Width] = {}, AxisZ[Width] = {};
    float CosSpread[Width] = {}, SinSpread[Width] = {}, CosExtent[Width] = {};
    float TwoSided[Width] = {};      ///< 1 or 0
    float Reach2[Width] = {};        ///< squared, from the centre
    float Intensity[Width] = {};     ///< of all that is 1; 0: nothing there
    std::uint32_t Child[Width] = {}; ///< node, or light with LeafBit
  };
  static constexpr std::uint32_t LeafBit = 0x80000000u;
  static constexpr std::uint64_t Absent = ~std::uint64_t(0); // DeepestBinary leaves the last bits 0

  struct Local
  {
    float X, Y, Z, Nx, Ny, Nz;
    bool BothSides, AnyDirection;
  };
  bool Enter(const Receiver& at, Local& local) const noexcept;
  static void Weigh(const Node& node, const Local& at, float* importance) noexcept;
  static bool Weights(const Node& node, const Local& at, bool root, float* weights, float& sum) noexcept;
  struct Builder;

  std::vector<Node> Nodes;
  std::vector<std::uint64_t> Trails; ///< per light: its slot on every level, two bits each; Absent: not in the tree
  Vec3f Centre;
  float Scale = 1;
  int Levels = 0;
};
}

#endif
