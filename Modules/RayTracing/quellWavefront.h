// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellWavefront_h
#define quellWavefront_h

#include "quellEmbreeScene.h"
#include "quellSampler.h"
#include "vtkQuellRayTracingModule.h"

#include <cstdint>
#include <vector>

namespace quell
{
class Camera;

/// A ray as it went to Embree.
/// Where shadow rays to a lamp end, as a part of the way: short of 1 by what rounding can move the end. Targets on area
/// lamps stand off the lamp by more than that.
constexpr float ShadowEnd = 0.999999f;

struct RecordedRay
{
  Vec3f Origin, Direction;
  float Far = 0;
  std::uint32_t Shadow = 0; ///< asked for any hit
  std::uint32_t Key = 0;    ///< of see-through surfaces
};

/// Paths that are traced side by side, one scattering at a time: column by column, so that what is plain arithmetic
/// runs in vectors. Every row is computed by itself, by the same operations as in scalar code (quellBsdf.h,
/// quellLightSampler.cxx, quellSampler.h): no result depends on the rows that happen to share a wavefront, nor on the
/// width of the vectors. Some 250 KB, that live on the stack of the thread that renders.
struct Wavefront
{
  static constexpr int Width = 256; ///< a multiple of every vector's length
  /// Columns start 64 bytes off multiples of 4096 from each other: stores would stall loads that look alike.
  static constexpr int Stride = Width + 16;
  template <class T>
  using Column = T[Stride];

  /// What a path takes from one scattering to the next: rows 0 to Count - 1, closed up when paths end.
  struct alignas(64) State
  {
    Column<float> Ox, Oy, Oz, Dx, Dy, Dz;         ///< the ray
    Column<float> Tr, Tg, Tb;                     ///< throughput
    Column<float> Pdf;                            ///< of the direction; not used after a delta scattering
    Column<float> Fx, Fy, Fz, Nx, Ny, Nz;         ///< Receiver of the last non-delta vertex
    Column<std::uint32_t> KeyLo, KeyHi, Reversed; ///< PixelSampler's
    Column<std::uint32_t> Path;                   ///< index into the samples
    Column<float> Time;
    Column<std::uint32_t> Flags; ///< bits: see below
    // only for paths that can be anything but diffuse
    Column<float> Sr, Sg, Sb; ///< share of the first diffuse lobe
    Column<float> EtaScale;
    Column<float> Skipped; ///< of the ray, between the surface and its origin, which lies off it
  } Live;
  static constexpr int DiffuseRows = 22, AllRows = 27;
  static_assert(sizeof(State) == AllRows * sizeof(Column<float>), "rows are closed up one after the other");

  // Flags
  static constexpr std::uint32_t SmoothMask = 0xffffu;    ///< non-delta scatterings so far
  static constexpr std::uint32_t DeltaBit = 1u << 16;     ///< the last scattering was a delta, or there was none
  static constexpr std::uint32_t GuidesBit = 1u << 17;    ///< guides still wanted
  static constexpr std::uint32_t DistanceBit = 1u << 18;  ///< hit distance still wanted
  static constexpr std::uint32_t BothSidesBit = 1u << 19; ///< of the receiver

  int Count = 0;

  // The hit of each row.
  alignas(64) Column<std::uint32_t> Geometry, Primitive;
  alignas(64) Column<std::uint32_t> Alive; ///< all ones: goes on; 0: ended
  alignas(64) Column<float> U, V, T;
  alignas(64) Column<float> Corner[9];                      ///< of the triangle: a, b, c
  alignas(64) Column<float> Px, Py, Pz, Gx, Gy, Gz, Offset; ///< point, unit geometric normal by winding
  alignas(64) Column<std::uint32_t> Front;
  alignas(64) Column<float> Sx, Sy, Sz;       ///< shading normal, on the side of the ray
  alignas(64) Column<float> Ar, Ag, Ab;       ///< diffuse albedo
  alignas(64) Column<float> Nx, Ny, Nz;       ///< interpolated normal, not unit, of Smooth rows
  alignas(64) Column<std::uint32_t> Material; ///< bits, see WavefrontAccess
  std::uint32_t Any = 0;                      ///< bits that some row has
  int Emitters = 0;
  alignas(64) Column<std::uint32_t> Emitter; ///< rows whose material emits or is unlit

  // Random numbers.
  alignas(64) Column<float> Random[8]; ///< 2 * SamplePair of a vertex
  alignas(64) Column<std::uint32_t> Hash[3];

  // Light samples, then shadow rays.
  alignas(64) Column<float> Wx, Wy, Wz, Lx, Ly, Lz; ///< direction; target
  alignas(64) Column<float> Er, Eg, Eb, LightPdf;
  alignas(64) Column<std::uint32_t> LightFlags;
  alignas(64) Column<std::uint32_t> Lit;                 ///< a shadow ray to trace
  alignas(64) Column<float> Kx, Ky, Kz, Jx, Jy, Jz, Far; ///< its origin and direction
  alignas(64) Column<float> Cr, Cg, Cb; ///< throughput and what the surface scatters, then the light that arrives
  alignas(64) Column<float> Br, Bg, Bb; ///< the part of it through the first diffuse lobe
  alignas(64) Column<float> ScatterPdf; ///< of the light's direction

  /// Of image skies.
  struct alignas(64) SkyColumns
  {
    Column<double> S, T; ///< random numbers
    Column<double> CosTheta;
    Column<float> Turn;
    Column<std::uint32_t> Texel; ///< the first of four
    Column<float> X, Y;          ///< between them
  } Sky;

  /// Of opaque surfaces: first what textures leave of the material, then what Surface (quellBsdf.h) calls the same; the
  /// albedo of its diffuse lobe is Ar, Ag, Ab.
  struct alignas(64) OpaqueColumns
  {
    Column<float> Base[3], Metallic, Roughness, Specular, Tint[3], Ior; ///< as in MaterialValues and Material
    Column<float> Bump[3], Slope[4]; ///< of the normal map: normal; texture coordinates along the triangle's two edges
    Column<float> F0[3], F90, Alpha, Fms[3], MultiScale, Under[3], DiffuseScale;
    Column<std::int32_t> Row; ///< of the energy table: place of its first number
    Column<float> Fraction;
    Column<float> Co, OutLoss, OutUnder, OutSmith, OutPdf, PCosine, PSpecular; ///< Co: Dot(normal, direction back)
    Column<std::uint32_t> Lobes;
  } Opaque;
  // Lobes
  static constexpr std::uint32_t HasDiffuse = 1, HasSpecular = 2, SpecularIsDelta = 4;

  static constexpr std::uint32_t LightDrawn = 1, LightAtInfinity = 2, LightHittable = 4; ///< BSDF samples may meet it
  static constexpr std::uint32_t LightFromSky =
    8; ///< of an image: E and LightPdf are looked up for what is not blocked
};

/// The light triangles of a scene that has few.
struct FewTriangles
{
  static constexpr int Most = 16;
  /// V0, E1, E2, N (3 each), Offset, whether TwoSided, PdfArea, Emission (3).
  static constexpr int Numbers = 18;
  int Count = 0;
  float From[Most] = {}; ///< least pick of each
  float Of[Most][Numbers];
};

/// Loops over a wavefront's rows, in vectors of the best instruction set at hand. Rows up to the next multiple of 64
/// are computed too (and hold garbage).
namespace lanes
{
/// PixelSampler::Pair(pair) of every row into Random[2 slot], Random[2 slot + 1], of Sobol points.
VTKQUELLRAYTRACING_EXPORT void DrawRandom(Wavefront& w, std::uint32_t pair, int slot) noexcept;
/// P, G, Offset, Front from Corner, U, V; S becomes the geometric normal on the ray's side.
VTKQUELLRAYTRACING_EXPORT void Locate(Wavefront& w) noexcept;
/// Rays of a camera without a lens that keeps still, through points in pixels, into O and D.
VTKQUELLRAYTRACING_EXPORT void CameraRays(
  Wavefront& w, const double* px, const double* py, const Camera& camera) noexcept;
/// Samples of light triangles, as LightSampler makes them from PairLightPick and PairLightPoint: W, L, E, LightPdf,
/// LightFlags.
VTKQUELLRAYTRACING_EXPORT void DrawTriangles(Wavefront& w, const FewTriangles& lights) noexcept;
/// Shadow rays at diffuse surfaces, what is scattered there and with which pdf: C, ScatterPdf.
VTKQUELLRAYTRACING_EXPORT void AimDiffuse(Wavefront& w) noexcept;
/// The next directions of diffuse surfaces, with Russian roulette if `roulette`; ends paths in Alive.
VTKQUELLRAYTRACING_EXPORT void ScatterDiffuse(Wavefront& w, bool roulette) noexcept;
/// Bends S of the rows that are Smooth or Bumped, as WavefrontAccess::Normals does; `bumped`: some are.
VTKQUELLRAYTRACING_EXPORT void Bend(Wavefront& w, bool bumped) noexcept;
/// PixelSampler::RayKey(which) of every row.
VTKQUELLRAYTRACING_EXPORT void RayKeys(const Wavefront& w, std::uint32_t which, std::uint32_t* keys) noexcept;
/// The opaque surfaces of WavefrontAccess::Values, and the chances of their lobes for the rows' directions.
VTKQUELLRAYTRACING_EXPORT void PrepareOpaque(Wavefront& w) noexcept;
/// As AimDiffuse, of opaque surfaces; B becomes the part through the diffuse lobe.
VTKQUELLRAYTRACING_EXPORT void AimOpaque(Wavefront& w) noexcept;
/// C becomes the light that arrives, by E and LightPdf; `mis`: power heuristic against ScatterPdf. `parts`: B becomes
/// the part of it through the first diffuse lobe.
VTKQUELLRAYTRACING_EXPORT void Shine(Wavefront& w, bool mis, bool parts) noexcept;
/// The next directions of opaque surfaces, with Russian roulette if `roulette`; ends paths in Alive, also those that
/// have then scattered more than `deepest` times (mirrors do not count), and with `last` those that look for nothing
/// but light.
VTKQUELLRAYTRACING_EXPORT void ScatterOpaque(Wavefront& w, int deepest, bool roulette, bool last) noexcept;
/// Closes the gaps of ended paths in the first `rows` rows of the state.
VTKQUELLRAYTRACING_EXPORT void Close(Wavefront& w, int rows) noexcept;
}

/// Rays of whole wavefronts against a scene.
struct VTKQUELLRAYTRACING_EXPORT WavefrontAccess
{
  /// Traces the rows' rays: Geometry, Primitive, U, V, T; Alive is 0 for those that met nothing. `keys` (null: no
  /// see-through surfaces): one per row.
  static void Intersect(const EmbreeScene& scene, EmbreeScene::Context& context, Wavefront& w,
    const std::uint32_t* keys, std::vector<RecordedRay>* record) noexcept;
  /// Corner of the rows that hit, and what of the material can be looked up by the part alone. `normals`: N as well.
  static void Fetch(const EmbreeScene& scene, Wavefront& w, bool normals) noexcept;
  /// What lanes::Locate makes of parts that are not baked into place, made again with their matrices.
  static void Straighten(const EmbreeScene& scene, Wavefront& w) noexcept;
  /// The hit of row `i` (P is left out unless `position`).
  static void Hit(const EmbreeScene& scene, const Wavefront& w, int i, bool position, SurfaceHit& hit) noexcept;
  /// Shadow rays of the rows with Lit; Lit becomes 0 where they are blocked, and C and B less where they pass panes, of
  /// which more than `panes` block as well.
  static std::int64_t Occlude(const EmbreeScene& scene, EmbreeScene::Context& context, Wavefront& w,
    const std::uint32_t* keys, int panes, std::vector<RecordedRay>* record) noexcept;
  /// False: not all light there is comes from a few triangles.
  static bool FindTriangles(const EmbreeScene& scene, FewTriangles& lights) noexcept;
  /// Light comes from an image of the sky, too.
  static bool HasSkyImage(const EmbreeScene& scene) noexcept;
  /// Picks from here on go to the sky.
  static float SkyFrom(const EmbreeScene& scene) noexcept;
  /// Light samples of the rows that are alive, `wanted`, and pick the image of the sky: W, LightFlags; E and LightPdf
  /// are 1 until LightOfSky. LightFlags becomes 0 for the others.
  static void DrawSky(const EmbreeScene& scene, Wavefront& w, const bool* wanted) noexcept;
  /// E and LightPdf of the rows that are still Lit by the image of the sky.
  static void LightOfSky(const EmbreeScene& scene, Wavefront& w) noexcept;
  /// Where the rays that met nothing meet the image of the sky; then SkyAt is EmbreeScene::SkyAndPdf of such a row.
  static void FindSky(const EmbreeScene& scene, Wavefront& w) noexcept;
  static Vec3f SkyAt(const EmbreeScene& scene, const Wavefront& w, int i, float& pdf) noexcept;
  /// The bare loop that speed is measured against: number of rays that met something.
  static std::int64_t Replay(const EmbreeScene& scene, const std::vector<RecordedRay>& rays) noexcept;

  static void Prefetch(const LightSampler& sky, const Wavefront& w, const int* rows, int count) noexcept;
  /// Base to Ior, the bit Bumped, and the shading normals of the rows that are alive.
  static void Values(const EmbreeScene& scene, Wavefront& w) noexcept;
  class TexCoords;
  // A hit's parts of EmbreeScene::Shade.
  /// `bump`: what the normal map holds there, where that is known.
  static void Normals(const EmbreeScene& scene, const SurfaceHit& hit, const Vec3f& wo, ShadingNormals& normals,
    const Vec4f* bump = nullptr) noexcept;
  /// Where textures or vertex colours say what the material is.
  static Surface Resolve(const EmbreeScene& scene, const SurfaceHit& hit, float& roughness, Vec3f& unlit) noexcept;
  static Vec3f Emission(const EmbreeScene& scene, const SurfaceHit& hit) noexcept;
  /// Every surface is Lambert's, whatever its textures say.
  static bool OnlyDiffuse(const EmbreeScene& scene) noexcept;
  /// No glass, no clearcoat, nothing see-through.
  static bool OnlyOpaque(const EmbreeScene& scene) noexcept;

  // What Fetch says about a row in Wavefront::Material.
  static constexpr std::uint32_t Varies = 1;     ///< textures or vertex colours
  static constexpr std::uint32_t Bent = 4;       ///< a normal map, or not baked into place
  static constexpr std::uint32_t Mirrored = 8;   ///< inside out by its winding
  static constexpr std::uint32_t Elsewhere = 16; ///< not baked into place
  static constexpr std::uint32_t Unlit = 32;     ///< without light of its own accord
  static constexpr std::uint32_t Single = 64;    ///< without several scatterings between microfacets
  static constexpr std::uint32_t Smooth = 128;   ///< N is there to be S
  static constexpr std::uint32_t Layered = 256;  ///< may be glass or have a clearcoat
  static constexpr std::uint32_t Emits = 512;    ///< may emit or be unlit
  // What Values says there: a normal map whose tangents come from the triangle; Bump and Slope say how to bend S.
  static constexpr std::uint32_t Bumped = 1024;
};
}

#endif
