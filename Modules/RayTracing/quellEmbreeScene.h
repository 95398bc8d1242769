// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEmbreeScene_h
#define quellEmbreeScene_h

#include "quellBsdf.h"
#include "quellLightSampler.h"
#include "quellScene.h"
#include "vtkQuellRayTracingModule.h"

#include <embree3/rtcore.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace quell
{
/// A ray in units of the scene, relative to the recentred origin. `Far` may be a fraction when the direction is not
/// unit.
struct TraceRay
{
  Vec3f Origin, Direction;
  float Far = std::numeric_limits<float>::infinity();
  std::uint32_t Key = 0; ///< randomness of see-through surfaces
};

/// Where a ray met the scene. Barycentrics are Embree's; the position is made of them in double.
struct SurfaceHit
{
  Vec3d P; ///< relative to the recentred origin
  Vec3f Pf;
  Vec3f Ng; ///< unit, outside by the triangle's winding
  float T = 0, U = 0, V = 0;
  float Offset = 0; ///< distance that keeps new rays off this surface
  std::uint32_t Geometry = 0, Primitive = 0;
  bool Front = true; ///< the ray came from outside
};

/// A hit with its material resolved.
struct SurfacePoint
{
  Vec3f Ng, Ns; ///< geometric and shading normal on the ray's side
  Surface Material;
  Vec3f Emission;      ///< towards the ray (0 from the dark side)
  Vec3f DisplayOnly;   ///< unlit colour: seen by the camera, lights nothing
  float Roughness = 1; ///< perceptual, as in the file
};

/// A scene at one moment, ready for rays: geometry of every instance baked into world space around a nearby origin.
/// Only geometry whose node moved is baked again for another moment.
class VTKQUELLRAYTRACING_EXPORT EmbreeScene
{
public:
  explicit EmbreeScene(std::shared_ptr<const Scene> scene);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  /// Poses the scene at `time`; `previous` is the time of the frame before, for motion.
  void SetTime(double time, double previous);

  /// `context` is rtcInitIntersectContext's with the ray key behind it, see Context.
  struct Context
  {
    RTCIntersectContext Rtc;
    std::uint32_t Key = 0;
    const EmbreeScene* Self = nullptr;
  };
  void Begin(Context& context) const noexcept
  {
    rtcInitIntersectContext(&context.Rtc);
    context.Self = this;
  }
  bool Intersect(Context& context, const TraceRay& ray, SurfaceHit& hit) const noexcept;
  bool Occluded(Context& context, const TraceRay& ray) const noexcept;

  void Shade(const SurfaceHit& hit, const Vec3f& direction, SurfacePoint& point) const noexcept;
  /// Where the hit's material point was at the previous time; false when it did not move.
  bool PreviousPosition(const SurfaceHit& hit, Vec3d& p) const noexcept;
  int ObjectId(const SurfaceHit& hit) const noexcept { return this->Parts[hit.Geometry].Id; }
  int MaterialId(const SurfaceHit& hit) const noexcept { return this->Parts[hit.Geometry].Material + 1; }
  /// Index of the light triangle hit, -1: none.
  int LightAt(const SurfaceHit& hit) const noexcept
  {
    const Part& part = this->Parts[hit.Geometry];
    return part.LightIndex.empty() ? -1 : part.LightIndex[hit.Primitive];
  }
  /// Emission of a textured light at barycentrics, seen-through part taken out.
  Vec3f LightEmission(const LightSampler::Sample& s) const noexcept;
  /// Attenuation colour and distance of the volume that the hit surface bounds.
  bool Attenuation(const SurfaceHit& hit, Vec3f& color, float& distance) const noexcept;

  const LightSampler& Lights() const { return this->LightSource; }
  const Scene& GetScene() const { return *this->Source; }
  const Vec3d& Origin() const { return this->Center; }
  Mat4 NodeMatrix(int node, bool previous) const;
  /// World bounds (absolute) of what can be seen; lower > upper: nothing.
  Vec3d Lower, Upper;
  /// The same at time 0, for a camera that frames everything and keeps still.
  Vec3d RestLower, RestUpper;

  // What the scene holds: what it lacks is not looked up.
  struct Features
  {
    bool Geometry = false, Textures = false, Glossy = false, Glass = false, SeeThrough = false, Animated = false;
    bool Volumes = false;
  } Has;
  std::int64_t DroppedTriangles = 0;
  std::int64_t TriangleCount = 0;

private:
  struct Part
  {
    const Mesh* Geometry = nullptr;
    int Node = -1, Id = 0, Material = 0;
    bool Animated = false; ///< by its node or one above it
    bool Moved = false;    ///< between the previous and this time
    bool Mirrored = false; ///< the node turns triangles inside out
    bool AlphaTested = false, Textured = false, Plain = false;
    Mat4 World, Previous;                 ///< relative to the origin
    std::vector<float> Positions;         ///< baked, 3 per vertex and padding
    std::vector<std::uint32_t> Triangles; ///< usable ones only
    std::vector<std::int32_t> LightIndex; ///< per triangle; empty: emits nothing
    RTCGeometry Handle = nullptr;
  };
  void Bake(Part& part);
  void BuildLights();
  Vec3f Corner(const Part& part, std::uint32_t vertex) const noexcept
  {
    const float* p = &part.Positions[3 * std::size_t(vertex)];
    return { p[0], p[1], p[2] };
  }
  Vec2f TexCoord(const Part& part, std::uint32_t primitive, float u, float v, int set) const noexcept;
  Vec4f Lookup(const Part& part, std::uint32_t primitive, float u, float v, const TextureUse& use) const noexcept;
  Vec4f VertexColor(const Part& part, std::uint32_t primitive, float u, float v) const noexcept;
  float AlphaAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept;
  Vec3f EmissionAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept;
  static void SeeThrough(const RTCFilterFunctionNArguments* args);

  std::shared_ptr<const Scene> Source;
  Vec3d Center;
  std::vector<Part> Parts;
  std::vector<Surface> Surfaces; ///< of materials without textures
  std::vector<Mat4> Nodes, PreviousNodes;
  LightSampler LightSource;
  RTCDevice Device = nullptr;
  RTCScene Rtc = nullptr;
  bool Posed = false;
  double Time = 0;
};
}

#endif
