// SPDX-License-Identifier: BSD-3-Clause
/// VTK data and whole renderers as scenes of the path tracer. Nothing is rendered and nothing needs OpenGL.
#ifndef quellSceneFromVTK_h
#define quellSceneFromVTK_h

#include "quellScene.h"
#include "vtkImageData.h"
#include "vtkQuellSceneVTKModule.h"
#include "vtkScalarsToColors.h"
#include "vtkSmartPointer.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

class vtkCompositeDataDisplayAttributes;
class vtkDataObject;
class vtkMapper;
class vtkProperty;
class vtkRenderer;
class vtkTexture;

namespace quell
{
/// An image as a texture. VTK's coordinates: v grows upwards, row 0 of the image is the bottom one.
struct DataTexture
{
  vtkSmartPointer<vtkImageData> Image; ///< 1 to 4 components; unsigned char, unsigned short, float or double
  bool SRGB = true;                    ///< decode 8 and 16 bit colour from sRGB to linear
  bool Interpolate = true;
  Wrap Wrapping = Wrap::Repeat;
  double Transform[2][3] = { { 1, 0, 0 }, { 0, 1, 0 } }; ///< (u, v)' = Transform (u, v, 1)
};

/// How data looks: the words of vtkProperty and vtkMapper, with their defaults. The path tracer's material is
///
///   Gouraud, Phong, Flat   base colour Diffuse x DiffuseColor; a reflection at normal incidence of
///                          F0 = Specular min(1, 8 / (n + 2)) SpecularColor, n = SpecularPower, of roughness
///                          sqrt(alpha), alpha^2 = 2 / (n + 2). That is a GGX lobe as wide as Phong's and, under a
///                          light of intensity 1, as bright at its peak as VTK's (D(0) F0 pi / 4 = F0 (n + 2) / 8), but
///                          never more reflecting than Specular. Specular 0, VTK's default, is Lambert.
///   PBR                    base colour, Metallic, Roughness, BaseIOR, coat; as glTF
///   Opacity < 1            Alpha, blended: rays go straight on
///   Lighting off           Unlit, of colour Ambient AmbientColor + Diffuse DiffuseColor
///   Ambient                stands for the indirect light that the path tracer computes, and is left out; AmbientEmits
///                          makes the surface shine by it. Ambient 1, Diffuse 0, Specular 0 is Unlit.
///
/// All surfaces are double-sided. Flat leaves point normals out, as VTK does.
struct VTKQUELLSCENEVTK_EXPORT DataMaterial
{
  enum Shading
  {
    Flat,
    Gouraud,
    Phong,
    PBR
  };
  std::string Name;
  Shading Interpolation = Gouraud;
  bool Lighting = true;
  Vec3d AmbientColor{ 1, 1, 1 }, DiffuseColor{ 1, 1, 1 }, SpecularColor{ 1, 1, 1 };
  double Ambient = 0, Diffuse = 1, Specular = 0, SpecularPower = 1, Opacity = 1;
  bool AmbientEmits = false;
  double Metallic = 0, Roughness = 0.5, BaseIOR = 1.5, CoatStrength = 0, CoatRoughness = 0, NormalScale = 1;
  Vec3d EmissiveFactor{ 1, 1, 1 }; ///< multiplies EmissiveTexture; no emission without one
  DataTexture ColorTexture, OrmTexture, NormalTexture, EmissiveTexture; ///< ORM: G roughness, B metallic
  // What vtkProperty has no word for.
  Vec3d Emission;          ///< radiance, linear
  double Transmission = 0; ///< 1: clear glass of BaseIOR, whose colour is what two surfaces let through

  /// Colours (not radiances) are as on a display and are decoded from sRGB to linear: VTK's Phong shading works in
  /// display values, so that a picture encoded for a display shows the colours of VTK. False: they are linear already.
  bool DisplayColors = true;

  ///@{
  /// As vtkMapper: scalars replace the colour (and its alpha multiplies Opacity). Point scalars are interpolated as
  /// colours, or, with InterpolateScalarsBeforeMapping, as scalars; cell scalars colour whole cells. Arrays of unsigned
  /// char with 1 to 4 components are colours themselves unless MapAllScalars.
  bool ScalarVisibility = true;
  std::string ScalarArray;                         ///< point or cell array; empty: the active scalars, points first
  int ScalarComponent = 0;                         ///< of a vector; -1: its magnitude (only with a lookup table)
  vtkSmartPointer<vtkScalarsToColors> LookupTable; ///< null: VTK's default, blue to red
  double ScalarRange[2] = { 0, -1 };               ///< empty: the table's own, or without a table the data's
  bool MapAllScalars = false, InterpolateScalarsBeforeMapping = false;
  ///@}
};

/// Everything that vtkProperty says, textures included; null: the defaults.
VTKQUELLSCENEVTK_EXPORT DataMaterial MaterialFromProperty(vtkProperty* property);
/// The texture's image, through its lookup table where it has one; updates it. Null or without input: no image.
VTKQUELLSCENEVTK_EXPORT DataTexture TextureFrom(vtkTexture* texture);

struct RendererOptions
{
  /// VTK's background lights nothing; a path tracer's sky does.
  enum class Backdrop
  {
    Black, ///< nothing: the radiance of rays that leave is 0 (vtkQuellDataPathTraceSource paints the background behind)
    Sky    ///< the background (with its gradient, by elevation) is a sky that lights the scene
  };
  Backdrop Background = Backdrop::Black;
  int Width = 0, Height = 0; ///< of the frame; 0: the renderer's part of its window
  bool Lights = true;        ///< false: leave VTK's lights out
  bool DisplayColors = true; ///< see DataMaterial; also for lights and background
  bool AmbientEmits = false; ///< see DataMaterial
  /// Colours, opacities and visibilities per block belong to vtkCompositePolyDataMapper2, which is OpenGL's. Programs
  /// that link it give [](vtkMapper* m) { auto c = vtkCompositePolyDataMapper2::SafeDownCast(m);
  /// return c ? c->GetCompositeDataDisplayAttributes() : nullptr; }
  std::function<vtkCompositeDataDisplayAttributes*(vtkMapper*)> BlockAttributes;
};

/// Makes scenes of VTK's data as it is now, frame after frame, and remembers the frame before, so that motion is right:
/// of actors (any affine matrix), of the camera, of data whose points moved while its triangles stayed.
///
/// A frame is Begin, any number of Add..., Finish. The frame at `tick` moves relative to what was recorded for
/// tick - 1: recording a tick again replaces it, and after any other tick nothing moves. Scene time is tick / rate, as
/// in vtkQuellStage; motion is an animation between the two ticks. Objects keep their number (the `id` array) for life.
///
/// Of data: polygons (concave ones too) and strips; other data sets by their surface; composite data block by block,
/// each with its own number. Lines, points and what else cannot be traced are left out with a warning in
/// Scene::Warnings. Positions in double far from their origin keep their digits.
class VTKQUELLSCENEVTK_EXPORT SceneRecorder
{
public:
  SceneRecorder();
  ~SceneRecorder();

  void Begin(int tick = 0, double rate = 24);
  /// Throws SceneError where `data` is null or holds nothing that has a surface. `name` tells data apart between
  /// frames; it is made unique by order.
  void AddData(vtkDataObject* data, const DataMaterial& material = {}, const std::string& name = "data",
    const Mat4& pose = Mat4());
  /// Visible actors (also in assemblies), lights that are on (a headlight where there are none, as VTK makes it), the
  /// active camera, the environment texture where image-based lighting is on, the size of the window.
  ///
  /// Lights: intensity 1 makes a white diffuse surface that faces it as bright as VTK shows it, radiance 1.
  /// Directional: irradiance pi x intensity x colour. Positional: falls off with the square of the distance, as light
  /// does, and is as bright as VTK shows it at its focal point (VTK's attenuation counts there; the purely quadratic
  /// one is the same everywhere). Cone: the same half angle; an exponent of 2 and more narrows it to the angle of the
  /// same half width.
  /// Throws SceneError where `renderer` is null.
  void AddRenderer(vtkRenderer* renderer, const RendererOptions& options = {});
  std::shared_ptr<const Scene> Finish();
  /// The frame at `tick` is the one recorded last: nothing changed, and the scene need not be made again.
  void Repeat(int tick);

private:
  SceneRecorder(const SceneRecorder&) = delete;
  void operator=(const SceneRecorder&) = delete;
  struct Internals;
  std::unique_ptr<Internals> Internal;
};

///@{
/// One frame without history.
VTKQUELLSCENEVTK_EXPORT std::shared_ptr<const Scene> SceneFromData(
  vtkDataObject* data, const DataMaterial& material = {});
VTKQUELLSCENEVTK_EXPORT std::shared_ptr<const Scene> SceneFromRenderer(
  vtkRenderer* renderer, const RendererOptions& options = {});
///@}
}

#endif
