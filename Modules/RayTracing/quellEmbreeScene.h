// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEmbreeScene_h
#define quellEmbreeScene_h

#include "quellBsdf.h"
#include "quellLightSampler.h"
#include "quellScene.h"
#include "quellSmallScene.h"
#include "quellTexelTable.h"
#include "vtkQuellRayTracingModule.h"

#include <embree3/rtcore.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace quell
{
/// New rays start this fraction of the largest coordinate at hand (64 ulp) off the surface.
constexpr float OffsetScale = 0x1p-17f;
/// Triangles with larger coordinates are left out; Embree's own limit is near 1.8e18.
constexpr float LargestCoordinate = 1e18f;
/// Scenes of another size are told: areas and squares of distances come near the ends of float's range.
constexpr double SmallestScene = 2e-9, LargestScene = 1e12;
/// Emission above this is taken as this: its square, times the 1e4 that a light sample may be weighed with, stays far
/// inside of float.
constexpr float LargestEmission = 1e14f;

/// A ray in units of the scene, relative to the recentred origin. `Far` may be a fraction when the direction is not
/// unit.
struct TraceRay
{
  Vec3f Origin, Direction;
  float Far = std::numeric_limits<float>::infinity();
  std::uint32_t Key = 0; ///< randomness of see-through surfaces
  float Time = 0;        ///< in [0, 1] over the time that the shutter is open
};

/// Where a ray met the scene. Barycentrics are Embree's; the position is made of them in double.
struct SurfaceHit
{
  Vec3d P; ///< relative to the recentred origin
  Vec3f Pf;
  Vec3f Ng; ///< unit, outside by the triangle's winding
  float T = 0, U = 0, V = 0;
  float Time = 0;   ///< the ray's
  float Offset = 0; ///< distance that keeps new rays off this surface
  std::uint32_t Geometry = 0, Primitive = 0;
  bool Front = true; ///< the ray came from outside
};

/// A hit with its material resolved.
struct SurfacePoint
{
  ShadingNormals Normals;
  Surface Material;
  Vec3f Emission;      ///< towards the ray (0 from the dark side)
  Vec3f DisplayOnly;   ///< unlit colour: seen by the camera, lights nothing
  float Roughness = 1; ///< perceptual, as in the file
};

/// A scene at one moment, or over the time that a shutter is open, ready for rays.
///
/// What never moves is baked into world space around a nearby origin and built once, as one hierarchy. What moves lives
/// in a second one of two levels: rigid parts are instances of their mesh's own hierarchy, so that a new pose costs a
/// matrix; parts that deform (skins, morph targets) are baked anew and their hierarchy, built at the pose of time 0,
/// is refitted. Few triangles are baked and built anew instead (Options::RebuiltTriangles). Every picture is a function
/// of the scene and the time: not of the poses before it.
class VTKQUELLRAYTRACING_EXPORT EmbreeScene
{
public:
  struct Options
  {
    /// Meshes placed more than once by nodes that keep still are baked for every node, which is the fastest to trace,
    /// until these repetitions have more triangles than this in all; then they share one hierarchy each.
    std::int64_t RepeatedTriangles = 4000000;
    /// Rigid parts that move, but not while the shutter is open, are baked for every pose where they have no more
    /// triangles than this in all: rays then need no second space. A scene that has no more in all, still or not, is
    /// built anew as one hierarchy for every pose: rays then need not ask two.
    std::int64_t RebuiltTriangles = 16384;
    /// Rays of wavefronts are tested against all triangles of scenes that are small enough (SmallScene).
    bool TestAll = true;
    /// Chords of motion within the shutter stay within this fraction of the size of the part...
    double ChordError = 1e-4;
    /// ... as far as so many straight segments allow (powers of 2; at most 64).
    int RigidSegments = 64, DeformingSegments = 16;
    /// Copies of textures that are laid out for reading (TexelTable) may take so much memory in all.
    std::int64_t TexelBytes = std::int64_t(1) << 30;
    LightSelection Lights = LightSelection::Auto;
    /// Rays of all kinds pass single-sided surfaces from behind; glass is never one-sided.
    bool HideBackFaces = false;
  };

  explicit EmbreeScene(std::shared_ptr<const Scene> scene)
    : EmbreeScene(std::move(scene), Options())
  {
  }
  EmbreeScene(std::shared_ptr<const Scene> scene, const Options& options);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  /// The shutter is open from `open` to `close`, seconds of the scene relative to the time of SetTime, from its next
  /// call on; equal (the default), reversed or not finite: no motion blur.
  void SetShutter(double open, double close);
  /// Poses the scene at `time`; `previous` is the time of the frame before, for motion.
  void SetTime(double time, double previous);

  /// Panes (Surface::IsPane) that a shadow ray has met so far. They are kept and not multiplied at once: a hierarchy
  /// visits them in an order of its own.
  struct PanesMet
  {
    static constexpr int Most = 16;
    int Allowed = 0; ///< one more blocks the ray
    int Count = 0;
    struct One
    {
      float T, U, V;
      std::uint32_t Geometry, Primitive;
    } Met[Most];
  };
  /// `context` is rtcInitIntersectContext's with the ray key behind it, see Context.
  struct Context
  {
    RTCIntersectContext Rtc;
    std::uint32_t Key = 0;
    const EmbreeScene* Self = nullptr;
    PanesMet Panes;
  };
  void Begin(Context& context) const noexcept
  {
    rtcInitIntersectContext(&context.Rtc);
    context.Self = this;
  }
  bool Intersect(Context& context, const TraceRay& ray, SurfaceHit& hit) const noexcept;
  /// Panes that it meets are in context.Panes, as many as are Allowed there; any more block the ray.
  bool Occluded(Context& context, const TraceRay& ray) const noexcept;
  /// What they let pass, one after the other.
  Vec3f PassedBy(PanesMet& panes, const Vec3f& direction, float time) const noexcept;

  void Shade(const SurfaceHit& hit, const Vec3f& direction, SurfacePoint& point) const noexcept;
  /// Where the hit's material point was at the previous time; false when it did not move.
  bool PreviousPosition(const SurfaceHit& hit, Vec3d& p) const noexcept;
  /// Where the hit's material point is at the time of SetTime: the hit itself, unless it moves within the shutter.
  Vec3d ReferencePosition(const SurfaceHit& hit) const noexcept;
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

  /// Triangles that rays of wavefronts are all tested against; 0: hierarchies are asked.
  int TestedTriangles() const noexcept { return this->Few.Triangles; }

  /// Lights that keep still while the shutter is open. DrawLight and the densities below know all.
  const LightSampler& Lights() const { return this->LightSource; }
  bool NoLights() const noexcept { return this->LightSource.Empty() && !this->Has.MovingLights; }
  /// Lights that a BSDF sample can hit.
  bool HasHittable() const noexcept { return this->LightSource.HasHittable() || !this->BlurredTriangles.empty(); }
  /// A light sample for `at` at the ray's time, see LightSampler::Draw. Emitters that move while the shutter is open
  /// are picked by their power at its reference time, whatever the ray's time, and sampled where they are at that time.
  bool DrawLight(const Receiver& at, float time, float pick, float u, float v, LightSampler::Sample& out) const noexcept
  {
    return this->Has.MovingLights ? this->DrawMoving(at, time, pick, u, v, out)
                                  : this->LightSource.Draw(at, pick, u, v, out);
  }
  /// Density (solid angle) with which DrawLight makes the direction to `hit`, a point of light triangle `light` =
  /// LightAt(hit), seen from `from` in the distance sqrt(distance2) under `cosine`.
  float LightPdf(int light, const SurfaceHit& hit, const Receiver& from, float distance2, float cosine) const noexcept
  {
    return this->Has.MovingLights ? this->MovingPdf(light, hit, from, distance2, cosine)
                                  : this->LightSource.TrianglePdf(std::uint32_t(light), from, distance2, cosine);
  }
  Vec3f SkyAndPdf(const Vec3f& direction, float& pdf) const noexcept
  {
    const Vec3f sky = this->LightSource.SkyAndPdf(direction, pdf);
    pdf *= 1 - this->MovingShare;
    return sky;
  }

  const Scene& GetScene() const { return *this->Source; }
  const Vec3d& Origin() const { return this->Center; }
  Mat4 NodeMatrix(int node, bool previous) const;
  /// At any time, absolute, seconds of the scene; evaluates the animation: not for every ray.
  Mat4 NodeMatrix(int node, double time) const;
  /// World bounds (absolute) of what can be seen; lower > upper: nothing.
  Vec3d Lower, Upper;
  /// The same at time 0, for a camera that frames everything and keeps still.
  Vec3d RestLower, RestUpper;

  // What the scene holds: what it lacks is not looked up.
  struct Features
  {
    bool Geometry = false, Textures = false, Glossy = false, Glass = false, SeeThrough = false, Animated = false;
    bool Volumes = false;
    bool Panes = false;        ///< that shadow rays pass
    bool MotionBlur = false;   ///< something moves while the shutter is open (cameras aside)
    bool MovingLights = false; ///< emitters among it
  } Has;
  std::int64_t DroppedTriangles = 0;
  std::int64_t TriangleCount = 0;
  /// What of the scene cannot be used as it is, by the name of mesh, node, material or light.
  std::vector<std::string> Warnings;

  /// What was built, and at what cost.
  struct Statistics
  {
    double BuildSeconds = 0; ///< constructor and first SetTime
    double PoseSeconds = 0;  ///< last SetTime
    std::int64_t Bytes = 0;  ///< hierarchies and vertices, without the scene itself
    int StillParts = 0, RigidParts = 0, DeformingParts = 0;
    // of the last SetTime:
    int Placed = 0; ///< rigid parts that got another matrix
    int Baked = 0;  ///< parts whose vertices were computed
    std::int64_t BakedVertices = 0;
    int Committed = 0;           ///< geometries that Embree built, refitted or placed
    std::int64_t BuildSteps = 0; ///< progress that Embree reported: some 100 triangles built each; refits report none
    int LightBuilds = 0;
    int Segments = 0; ///< most straight segments of motion of a part
  };
  Statistics GetStatistics() const;

private:
  friend struct WavefrontAccess;
  enum class Placement : std::uint8_t
  {
    Flat,  ///< Points are world positions and keep still
    Rigid, ///< Points are the mesh's, around Body::Base; Place[...] turns them into world positions
    Baked  ///< Points are world positions of one time
  };
  /// A mesh that instances share.
  struct Body
  {
    Vec3d Base; ///< mesh position of what Points call the origin
    const Vec3f* Points = nullptr;
    const std::uint32_t* Corners = nullptr;
    std::size_t Triangles = 0;
    std::vector<Vec3f> OwnPoints;
    std::vector<std::uint32_t> OwnCorners;
    Vec3d Lower, Upper; ///< of usable triangles, around Base
    RTCScene Rtc = nullptr;
    std::string Trouble; ///< what was left out
  };
  /// Motion while the shutter is open: `Segments` straight pieces of equal duration; 0: keeps still.
  struct Shutter
  {
    int Segments = 0;
    std::vector<Mat4> Place;                         ///< Rigid
    std::vector<std::vector<Vec3f>> Points, Normals; ///< Baked
    std::vector<std::vector<Vec4f>> Tangents;
  };
  struct Part
  {
    const Mesh* Geometry = nullptr;
    int Instance = 0, Node = -1, Id = 0, Material = 0;
    Placement Kind = Placement::Flat;
    bool Moves = false;    ///< may be elsewhere at another time
    bool Deforms = false;  ///< a matrix does not place it
    bool Moved = false;    ///< between the previous and this time
    bool InPlace = false;  ///< Points are world positions at the time of every ray, and no triangle is without area
    bool Mirrored = false; ///< triangles are inside out: the cross product of their edges points inside
    bool AlphaTested = false, Pane = false, Textured = false, Plain = false;
    bool OneSided = false; ///< rays from behind pass
    // What shading reads. For Rigid and Flat normals and tangents are the mesh's (null: none, or not one per vertex).
    const float* Points = nullptr;          ///< 3 per vertex
    const std::uint32_t* Corners = nullptr; ///< 3 per triangle, usable ones only
    std::size_t Triangles = 0;
    const Vec3f* Normals = nullptr;
    const Vec4f* Tangents = nullptr;
    float ToNormal[3][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }; ///< Normals to world, not unit
    bool FlipTangents = false;                                        ///< negate Tangents' w
    Mat4 World;                           ///< mesh to world, relative to the origin; identity for deforming parts
    Mat4 Place, Previous;                 ///< Points to world for Rigid: now, at the previous time
    std::vector<std::int32_t> LightIndex; ///< per triangle; empty: emits nothing

    int Body = -1;
    std::vector<Vec3f> OwnPoints; ///< world; one more than there are, for Embree reads 16 bytes
    std::vector<Vec3f> PreviousPoints;
    std::vector<std::uint32_t> OwnCorners;
    std::vector<Vec3f> OwnNormals;
    std::vector<Vec4f> OwnTangents;
    Shutter Open;
    Vec3d Lower, Upper; ///< of Points' corners (Rigid: see Body), world
    RTCGeometry Handle = nullptr;
    enum class Built : std::uint8_t
    {
      Nothing,
      Instance,
      Refitted,
      Rebuilt
    } Form = Built::Nothing; ///< what Handle is
    int BuiltSteps = 0;
    bool Shown = false;  ///< Handle takes part
    bool Warned = false; ///< of a matrix that is not finite
  };
  /// What every hit reads of its part, side by side.
  struct alignas(64) Glance
  {
    const float* Points = nullptr;
    const std::uint32_t* Corners = nullptr;
    const Vec3f* Normals = nullptr;   ///< of still parts whose normals are interpolated
    const Vec2f* TexCoords = nullptr; ///< of the first set; null: none
    std::uint32_t Flags = 0;          ///< WavefrontAccess's
    Vec3f Diffuse;                    ///< albedo where nothing varies
    float ToNormal[3][3];
    // of the material
    Vec3f Base, Tint;
    float Metallic = 0, Roughness = 0, Specular = 0, Ior = 0, NormalScale = 1;
    const TexelTable* Texels = nullptr;
    const Vec2f* Coordinates = nullptr;              ///< for Texels
    const TextureUse* Use = nullptr;                 ///< places the coordinates
    bool Color = false, Metal = false, Bump = false; ///< what Texels holds
    bool Bends = false;                              ///< its normals go into WavefrontAccess::Bumped
    bool Others = false; ///< the material has textures beside it, or there are vertex colours
  };
  void LookAtParts();
  void ListTriangles();
  void LayOutTexels();
  /// An emitting triangle or punctual light that moves while the shutter is open.
  struct MovingTriangle
  {
    std::uint32_t Geometry = 0, Primitive = 0;
    Vec3f Emission;
    float Offset = 0;
    bool TwoSided = false, Textured = false;
  };
  struct MovingLamp
  {
    std::vector<PlacedLight> At; ///< at the ends of equal pieces of the time; only position and direction differ
  };

  /// Poses within the shutter, by 128ths of it.
  using Poses = std::map<int, ScenePose>;
  void FindBounds(const ScenePose& pose, Vec3d& lower, Vec3d& upper) const;
  int MakeBody(int mesh, const Part& part);
  static void SetFilters(RTCGeometry geometry, const Part& part);
  void BakeStill(Part& part, std::size_t index, const ScenePose& pose);
  void HouseMovers();
  struct Change; ///< what SetTime finds out about a moving part before Embree is told
  bool PoseMoving(const ScenePose& pose, const ScenePose& previous, bool continues, Poses& poses);
  void PosePart(Part& part, const ScenePose& pose, const ScenePose& previous, bool continues, const Poses& poses,
    Change& change) const;
  const ScenePose& ShutterPose(Poses& poses, int k) const;
  bool Blurs() const { return this->ShutterClose > this->ShutterOpen; }
  void PlanShutter(Part& part, const ScenePose& now, Poses& poses) const;
  bool CanPlace(const Part& part, const Mat4& place) const;
  Mat4 PlaceOf(const Part& part, const ScenePose& pose) const;
  void BakeVertices(const Part& part, const ScenePose& pose, std::vector<Vec3f>& points,
    std::vector<Vec3f>* normals = nullptr, std::vector<Vec4f>* tangents = nullptr) const;
  void Attach(Part& part, std::size_t index, Part::Built form, int steps);
  void Show(Part& part, bool shown);
  void Warn(const std::string& text);
  std::string NameOf(const Part& part) const;
  void BuildLights(Poses& poses);
  PlacedLight PlaceLamp(const PunctualLight& light, const Mat4& world) const;
  bool DrawMoving(
    const Receiver& at, float time, float pick, float u, float v, LightSampler::Sample& out) const noexcept;
  float MovingPdf(int light, const SurfaceHit& hit, const Receiver& from, float distance2, float cosine) const noexcept;

  Mat4 Relative(Mat4 m) const
  {
    m.m[0][3] -= this->Center.x;
    m.m[1][3] -= this->Center.y;
    m.m[2][3] -= this->Center.z;
    return m;
  }
  /// Corner of a triangle as Points holds it.
  static Vec3f Corner(const Part& part, std::uint32_t vertex) noexcept
  {
    const float* p = &part.Points[3 * std::size_t(vertex)];
    return { p[0], p[1], p[2] };
  }
  /// Corners of a triangle in world space (relative to the origin); `time` in [0, 1], below 0: the reference time.
  void CornersAt(const Part& part, std::uint32_t primitive, float time, Vec3d (&p)[3]) const noexcept;
  void CornersAt(const Part& part, const SurfaceHit& hit, Vec3d (&p)[3]) const noexcept
  {
    this->CornersAt(part, hit.Primitive, hit.Time, p);
  }
  /// Position, normal, side and offset of a hit whose part, triangle, barycentrics and time are known.
  void Locate(const Part& part, SurfaceHit& hit, const Vec3f& direction) const noexcept;
  /// Interpolated normal in world space, not unit; false: the mesh has none, or it is 0 here.
  bool NormalAt(const Part& part, const SurfaceHit& hit, Vec3f& n) const noexcept;
  /// Interpolated tangent in world space, not unit, and the sign of the bitangent; false: the mesh has none.
  bool TangentAt(const Part& part, const SurfaceHit& hit, Vec3d& t, double& handed) const noexcept;

  Vec2f TexCoord(const Part& part, std::uint32_t primitive, float u, float v, int set) const noexcept;
  Vec4f Lookup(const Part& part, std::uint32_t primitive, float u, float v, const TextureUse& use) const noexcept;
  Vec4f VertexColor(const Part& part, std::uint32_t primitive, float u, float v) const noexcept;
  float AlphaAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept;
  Vec3f EmissionAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept;
  static void SeeThrough(const RTCFilterFunctionNArguments* args);
  static void PassBackFaces(const Part& part, const RTCFilterFunctionNArguments* args) noexcept;
  static void PassPanes(const RTCFilterFunctionNArguments* args);

  std::shared_ptr<const Scene> Source;
  Options Settings;
  Vec3d Center;
  double Radius = 1; ///< of the scene at rest
  std::vector<Part> Parts;
  std::vector<Glance> Glances; ///< one per part
  std::vector<std::unique_ptr<TexelTable>> TexelTables;
  std::vector<int> TexelsOf; ///< per material, -1: none
  std::vector<Body> Bodies;
  std::vector<int> BodyOf;         ///< per mesh, -1: none
  std::vector<std::size_t> Movers; ///< indices of parts that move
  std::vector<Surface> Surfaces;   ///< of materials without textures
  std::vector<Vec3f> Emissions;    ///< per material, usable
  std::vector<Mat4> Nodes, PreviousNodes;
  LightSampler LightSource;
  std::vector<MovingTriangle> BlurredTriangles;
  std::vector<MovingLamp> BlurredLamps;
  std::vector<double> BlurredCdf; ///< triangles, then lamps; upper ends, the last is 1
  float MovingShare = 0;          ///< of the picks that go to the blurred ones

  RTCDevice Device = nullptr;
  RTCScene Rtc = nullptr;    ///< what keeps still
  RTCScene Moving = nullptr; ///< what moves, if it is not in Rtc; null: nothing is there
  RTCScene Posed = nullptr;  ///< of these two the one that moving parts are in; null: nothing moves
  bool BakesRigid = false;   ///< Options::RebuiltTriangles
  SmallScene Few;            ///< all that is in them, if it is little; empty: ask them
  /// Around all of it while the shutter is open, and a little more: most rays pass by and need not ask Embree. Empty
  /// (lower above upper) where there is nothing.
  RTCBounds MovingBox = {};
  std::atomic<std::int64_t> EmbreeBytes{ 0 }, MovingSteps{ 0 };
  Statistics Work;
  std::size_t HiddenWarnings = 0;
  bool HasPose = false;
  double Time = 0;
  double ShutterOpen = 0, ShutterClose = 0;
  double PosedOpen = 0, PosedClose = 0; ///< the shutter of the last SetTime
};
}

#endif
