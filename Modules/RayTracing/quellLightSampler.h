// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellLightSampler_h
#define quellLightSampler_h

#include "quellBsdf.h"
#include "quellLightTree.h"
#include "quellScene.h"
#include "quellTable.h"
#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <cstdint>
#include <cstddef>
#include <vector>

namespace quell
{
/// A triangle that emits; positions relative to the recentred origin.
struct LightTriangle
{
  Vec3f V0, E1, E2, N; ///< N: unit, the emitting side
  Vec3f Emission;      ///< the whole emission, or the factor of a textured one
  float PdfArea = 0;   ///< chance of being picked by power (groups included) per area
  float TreeArea = 0;  ///< the same factor for the chance that the tree gives; 0 without a tree
  float Offset = 0;    ///< how far off the surface shadow rays end
  std::uint32_t Geometry = 0, Primitive = 0;
  bool TwoSided = false, Textured = false;
};

/// A punctual light in place.
struct PlacedLight
{
  LightType Type = LightType::Point;
  Vec3f Position, Direction; ///< Direction: the way it shines
  Vec3f Intensity;
  float Range = 0; ///< 0: no limit
  float CosInner = 1, CosOuter = 0;
  float Pick = 0;     ///< chance of being picked by power, groups included
  float TreePick = 0; ///< factor of the tree's chance
};

/// How one of the lights at a place (emissive triangles, point and spot lights) is picked.
enum class LightSelection
{
  Auto,  ///< Power below LightSampler::TreeFrom lights, Tree from there
  Power, ///< by power alone: one table for all points
  Tree   ///< by what each could send to the point (LightTree), every tenth one by power
};

/// Everything that light can be sampled from, in three groups on the axis of `pick`:
///
///  - lights at a place: emissive triangles (power pi A lum(Le), twice that when two-sided), point lights (4 pi I) and
///    spot lights (2 pi (1 - cos outer) I). One is picked by power, or by the tree with a tenth by power: even where
///    rounding or a strange normal makes the tree see nothing, no light that shines on a point has the chance 0.
///  - directional lights (pi R^2 E, R the scene's radius), by power;
///  - the environment (pi R^2 times the integral of its luminance): uniform where it is constant; else by texel, in
///    proportion to luminance x solid angle with 1/32 uniform, so that what is dark next to a sun of 1e30 is met, too.
///    A row by v, then a column by u, by indexed search (Chen & Asau 1974): monotone in both, so that stratified
///    numbers stay stratified on the sphere. Directions below the horizon of a receiver are not returned.
///
/// Groups share the picks evenly, except that an environment with less than a hundredth of all power gets less, down to
/// a tenth of its part. Power knows no walls: shared by power, a lamp in a room would lose most of its picks to the sky
/// outside, and out of doors BSDF samples find the sky anyway.
///
/// All densities are pure functions of the light, the receiver and the point on the light: the same for light samples
/// and for BSDF samples that happen to hit the light, bit for bit. Nothing here is NaN for any input; a receiver that
/// is not finite gets no sample.
class VTKQUELLRAYTRACING_EXPORT LightSampler
{
public:
  struct Sample
  {
    enum class From : std::uint8_t
    {
      None,
      Triangle,
      Punctual,
      Sky
    } Kind = From::None;
    Vec3f Wi;       ///< unit, towards the light
    Vec3f Target;   ///< end of the shadow ray (Triangle, Point and Spot); direction when AtInfinity
    Vec3f Emission; ///< radiance, or irradiance on a facing plane for punctual lights; factor when Textured
    float Pdf = 0;  ///< solid angle x pick; pick alone for punctual lights
    bool AtInfinity = false, Textured = false;
    std::uint32_t Geometry = 0, Primitive = 0;
    float U = 0, V = 0; ///< barycentrics
  };

  /// `average`: mean emission over each triangle (for its power); the same as Emission where nothing is textured.
  void Build(std::vector<LightTriangle> triangles, const std::vector<Vec3f>& average, std::vector<PlacedLight> lights,
    const Scene& scene, float sceneRadius);

  /// Takes effect at the next Build.
  void SetSelection(LightSelection s) noexcept { this->Selection = s; }
  LightSelection GetSelection() const noexcept { return this->Selection; }
  /// Lights at a place from which Auto uses the tree.
  static constexpr std::size_t TreeFrom = 8;
  /// Part of the picks that ignore the tree.
  static constexpr float DefensiveShare = 0.1f;
  bool UsesTree() const noexcept { return !this->Tree.Empty(); }

  bool Empty() const noexcept { return this->Triangles.empty() && this->Punctual.empty() && !this->SkyPick; }
  bool HasSky() const noexcept { return this->SkyPresent; }
  /// Lights that a BSDF sample can hit.
  bool HasHittable() const noexcept { return this->SkyPresent || !this->Triangles.empty(); }

  /// A light sample for `at`. False: nothing (also for a light seen edge-on or from behind, and for a direction to the
  /// environment from behind `at`).
  bool Draw(const Receiver& at, float pick, float u, float v, Sample& out) const noexcept;

  /// Density with which Draw makes a direction from `at` to a point of the light `distance2` away that is seen under
  /// `cosine` (>= 0): per solid angle, pick included.
  float TrianglePdf(std::uint32_t light, const Receiver& at, float distance2, float cosine) const noexcept
  {
    const LightTriangle& t = this->Triangles[light];
    float area = t.PdfArea;
    if (this->UsesTree())
      area += t.TreeArea * this->Tree.Chance(at, light);
    const float pdf = cosine > 1e-6f ? area * distance2 / cosine : 0;
    return pdf > 0 ? pdf : 0; // also for NaN
  }
  float SkyPdf(const Vec3f& direction) const noexcept;
  /// Radiance of the environment, bilinear. Longitude and latitude are exact to 1e-7 turns.
  Vec3f Sky(const Vec3f& direction) const noexcept;
  /// Sky(direction), and SkyPdf(direction) in `pdf`: the same bits for the price of one.
  Vec3f SkyAndPdf(const Vec3f& direction, float& pdf) const noexcept;

  const std::vector<LightTriangle>& GetTriangles() const { return this->Triangles; }
  /// Those at a place first, then the directional ones.
  const std::vector<PlacedLight>& GetPunctual() const { return this->Punctual; }
  /// Upper ends of the chances by power of the lights at a place, triangles first; the last end is 1. Applies to
  /// pick / LocalShare() below 1.
  const std::vector<double>& GetLocalCdf() const { return this->LocalCdf; }
  /// Part of the picks that go to lights at a place, to directional ones, and to the environment.
  float LocalShare() const noexcept { return this->LocalEnd; }
  float DistantShare() const noexcept { return this->DistantEnd - this->LocalEnd; }
  float SkyShare() const noexcept { return this->SkyPick; }
  const LightTree& GetTree() const { return this->Tree; }
  /// A sample of a lamp that was picked with chance `pdf`; also of one that is none of ours.
  bool DrawPunctual(const PlacedLight& light, const Vec3f& at, float pdf, Sample& out) const noexcept;

private:
  friend struct WavefrontAccess; // does DrawSky and SkyAndPdf step by step for many at once
  /// Directions this far below a horizon still count: for other ways of rounding.
  static constexpr float BehindMargin = 1e-4f;
  double BuildSky(const Scene& scene);
  bool DrawLocal(const Receiver& at, float pick, float u, float v, Sample& out) const noexcept;
  bool DrawSky(const Receiver& at, float pick, float u, float v, Sample& out) const noexcept;
  Vec3f SkyLookup(std::size_t place, float tx, float ty, float& density) const noexcept;
  std::size_t PickRow(double v) const noexcept;
  void PickPlace(std::size_t row, double s, double t, double& cosTheta, float& turn) const noexcept;

  LightSelection Selection = LightSelection::Auto;
  std::vector<LightTriangle> Triangles;
  std::vector<PlacedLight> Punctual;
  std::size_t LocalPunctual = 0;            ///< so many of them are at a place
  std::vector<double> LocalCdf, DistantCdf; ///< upper ends, the last one is 1
  LightTree Tree;                           ///< of triangles, then lights at a place; empty: not used
  float LocalEnd = 0, DistantEnd = 0;       ///< group ends on [0, 1]
  float SkyPick = 0;

  bool SkyPresent = false;
  Vec3f SkyColor;
  int ImageWidth = 0, ImageHeight = 0; ///< 0: constant
  /// One read yields radiance and density, and neighbours share cache lines.
  struct alignas(16) SkyTexel
  {
    float Radiance[3] = {};
    float Density = 0; ///< per solid angle, among all picks of the environment
  };
  Table<SkyTexel> Image; ///< with a border: columns go around, rows repeat
  /// Rows by chance. Each has an end of its own besides, rows have one more.
  struct SkyRow
  {
    double Lower = 0; ///< lower end of the chances
    double Top = 0;   ///< cosine at the upper edge
    double Band = 0;  ///< what the cosine loses down to the lower edge
  };
  std::vector<SkyRow> Rows; ///< empty: black
  /// Lower ends of the columns' chances in their row, and the last one's upper end, in steps of 1 / ColumnSteps.
  /// Whatever is lost by rounding, all have a step at least, and the densities are those of the steps.
  Table<std::uint32_t> Columns;
  static constexpr std::uint32_t ColumnSteps = 0xffffffffu;
  /// Where to begin the search, for equal parts of [0, 1]: the last row that starts at or before it; one entry more,
  /// the last row.
  std::vector<std::uint32_t> RowGuide;
  /// The same for columns, 2^(32 - ColumnShift) parts and one more for each row. A copy of the first ends makes
  /// the second read rare.
  struct alignas(32) ColumnPart
  {
    std::uint32_t First = 0;
    std::uint32_t Ends[7] = {}; ///< of columns First, First + 1, ...; beyond the row's end its last again
  };
  Table<ColumnPart> ColumnGuide;
  int RowParts = 0, ColumnShift = 0;
  const ColumnPart* PartOf(std::size_t row, std::uint32_t step) const noexcept
  {
    const std::size_t parts = std::size_t(std::uint64_t(1) << (32 - this->ColumnShift)) + 1;
    return &this->ColumnGuide[row * parts + std::size_t(std::uint64_t(step) >> this->ColumnShift)];
  }
};
}

#endif
