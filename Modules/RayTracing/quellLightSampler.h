// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellLightSampler_h
#define quellLightSampler_h

#include "quellBsdf.h"
#include "quellScene.h"
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
  float PdfArea = 0;   ///< chance of being picked (groups included) per area
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
  float Pick = 0; ///< chance of being picked, groups included
};

/// Everything that light can be sampled from: emissive triangles (picked by power = pi A lum(Le), twice that when
/// two-sided), punctual lights (by power), the environment (by luminance x solid angle of its texels, uniform where it
/// is constant). Groups that exist share the picks equally. The pdf is a pure function of the light and the two points,
/// the same for light samples and for BSDF samples that happen to hit the light.
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

  bool Empty() const noexcept { return this->Triangles.empty() && this->Punctual.empty() && !this->SkyPick; }
  bool HasSky() const noexcept { return this->SkyPresent; }
  /// Lights that a BSDF sample can hit.
  bool HasHittable() const noexcept { return this->SkyPresent || !this->Triangles.empty(); }

  /// Lights seen from `x`. False: nothing (also for a light seen edge-on or from behind).
  bool Draw(const Vec3f& x, float pick, float u, float v, Sample& out) const noexcept;

  /// Per solid angle, pick included; `distance2` and the cosine at the light (>= 0).
  float TrianglePdf(std::uint32_t light, float distance2, float cosine) const noexcept
  {
    return cosine > 1e-6f ? this->Triangles[light].PdfArea * distance2 / cosine : 0;
  }
  float SkyPdf(const Vec3f& direction) const noexcept;
  Vec3f Sky(const Vec3f& direction) const noexcept;

  const std::vector<LightTriangle>& GetTriangles() const { return this->Triangles; }
  const std::vector<PlacedLight>& GetPunctual() const { return this->Punctual; }

private:
  void BuildSky(const Scene& scene);
  Vec3f Texel(int x, int y) const noexcept
  {
    const float* t = &this->Image[3 * (std::size_t(y) * this->ImageWidth + x)];
    return { t[0], t[1], t[2] };
  }

  std::vector<LightTriangle> Triangles;
  std::vector<double> TriangleCdf; ///< upper ends, the last one is 1
  std::vector<PlacedLight> Punctual;
  std::vector<double> PunctualCdf;
  float TriangleEnd = 0, PunctualEnd = 0; ///< group ends on [0, 1]
  float SkyPick = 0;

  bool SkyPresent = false;
  Vec3f SkyColor;
  int ImageWidth = 0, ImageHeight = 0; ///< 0: constant
  std::vector<float> Image;
  std::vector<float> RowCdf, ColumnCdf; ///< upper ends; rows, then columns of each row
};
}

#endif
