// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellScene_h
#define quellScene_h

#include "quellVector.h"
#include "vtkQuellSceneModule.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace quell
{
/// What a scene file cannot be read for: `what()` names file, place and remedy.
struct VTKQUELLSCENE_EXPORT SceneError : std::runtime_error
{
  using std::runtime_error::runtime_error;
};

enum class Wrap : std::uint8_t
{
  Repeat,
  Mirror,
  Clamp
};

/// A decoded image; 8-bit RGBA as stored in the file or float RGBA (HDR). sRGB decoding happens on lookup.
struct VTKQUELLSCENE_EXPORT Texture
{
  std::string Name;
  int Width = 0, Height = 0;
  std::vector<std::uint8_t> Bytes; ///< 4 per pixel, row 0 at the top (glTF's v = 0)
  std::vector<float> Floats;       ///< 4 per pixel, used instead of Bytes when not empty
  bool SRGB = false;               ///< decode RGB (not A) from sRGB to linear
  bool Nearest = false;
  Wrap WrapS = Wrap::Repeat, WrapT = Wrap::Repeat;

  /// Linear RGBA at (u, v), bilinear unless Nearest; wraps first; a non-finite coordinate reads 0.
  Vec4f Sample(float u, float v) const noexcept;
};

/// Use of a texture by a material: which, which texture coordinates, and KHR_texture_transform (u' = M (u, v, 1)).
struct TextureUse
{
  int Texture = -1; ///< index into Scene::Textures; -1: none
  int TexCoord = 0; ///< 0 or 1
  float Transform[2][3] = { { 1, 0, 0 }, { 0, 1, 0 } };
};

enum class AlphaMode : std::uint8_t
{
  Opaque,
  Mask,
  Blend
};

/// glTF 2.0 metallic-roughness material and the extensions we read.
struct Material
{
  std::string Name;
  Vec3f BaseColor{ 1, 1, 1 };
  float Alpha = 1, Metallic = 1, Roughness = 1;
  Vec3f Emission; ///< radiance, W/(m^2 sr) relative; emissiveFactor x emissiveStrength
  bool DoubleSided = false;
  AlphaMode Mode = AlphaMode::Opaque;
  float AlphaCutoff = 0.5f;
  float Specular = 1; ///< KHR_materials_specular; 0 makes a dielectric pure Lambert
  Vec3f SpecularColor{ 1, 1, 1 };
  float Ior = 1.5f;
  float Transmission = 0;                                             ///< KHR_materials_transmission
  Vec3f AttenuationColor{ 1, 1, 1 };                                  ///< KHR_materials_volume
  float AttenuationDistance = std::numeric_limits<float>::infinity(); ///< scene units
  bool Volume = false; ///< the surface bounds a volume (thickness > 0): rays refract
  bool Unlit = false;
  float NormalScale = 1;
  TextureUse BaseColorTexture, MetallicRoughnessTexture, NormalTexture, EmissiveTexture, TransmissionTexture;
};

/// One glTF primitive: an indexed triangle list in its node's space. Every index is checked at load; triangles
/// that touch a non-finite position are dropped and counted.
struct Mesh
{
  std::string Name;
  int Material = 0; ///< always valid: a default material is appended where none is given
  std::vector<Vec3f> Positions;
  std::vector<Vec3f> Normals;  ///< empty: use the geometric normal
  std::vector<Vec4f> Tangents; ///< empty: derived from texture coordinates
  std::vector<Vec2f> TexCoords[2];
  std::vector<Vec4f> Colors;          ///< linear RGBA factors; empty: white
  std::vector<std::uint32_t> Indices; ///< 3 per triangle
};

struct Node
{
  std::string Name;
  int Parent = -1;
  std::vector<int> Children;
  bool HasMatrix = false;
  Mat4 Matrix; ///< used when HasMatrix
  Vec3d Translation;
  double Rotation[4] = { 0, 0, 0, 1 }; ///< x y z w
  Vec3d Scale{ 1, 1, 1 };
};

enum class Interpolation : std::uint8_t
{
  Linear,
  Step,
  CubicSpline
};
enum class AnimatedPath : std::uint8_t
{
  Translation,
  Rotation,
  Scale
};
struct AnimationChannel
{
  int Node = -1;
  AnimatedPath Path = AnimatedPath::Translation;
  Interpolation Mode = Interpolation::Linear;
  std::vector<float> Times;  ///< seconds, ascending
  std::vector<float> Values; ///< 3 or 4 per key (x3 for cubic spline: in-tangent, value, out-tangent)
};

/// A mesh placed by a node. `Id` (1, 2, ...) is what the `id` AOV holds: one per node, so that the primitives of one
/// object share it; stable over time.
struct Instance
{
  int Mesh = -1, Node = -1;
  int Id = 0;
};

struct CameraModel
{
  std::string Name;
  int Node = -1;        ///< -1: WorldFromCamera holds the pose
  Mat4 WorldFromCamera; ///< looks along -z, y up; used when Node is -1
  bool Orthographic = false;
  double YFov = 0.7853981633974483; ///< radians, vertical
  double YMag = 1;                  ///< orthographic half height, scene units
};

enum class LightType : std::uint8_t
{
  Point,      ///< Intensity in W/sr
  Spot,       ///< Intensity in W/sr
  Directional ///< Intensity in W/m^2 (irradiance on a facing plane)
};
/// KHR_lights_punctual; shines along the node's -z axis.
struct PunctualLight
{
  std::string Name;
  LightType Type = LightType::Point;
  int Node = -1;
  Vec3f Intensity{ 1, 1, 1 }; ///< color x intensity
  float Range = std::numeric_limits<float>::infinity();
  float InnerCone = 0, OuterCone = 0.7853981633974483f; ///< half angles, radians
};

/// Light from infinity: `Color` everywhere, times the latitude-longitude image when there is one. Direction (0, 1, 0)
/// is the image's top row; the centre column looks along -z, u grows towards +x.
struct Environment
{
  bool Present = false;
  Vec3f Color{ 0, 0, 0 };
  int Texture = -1;
};

/// A scene as a path tracer needs it: flat lists, every reference checked.
struct VTKQUELLSCENE_EXPORT Scene
{
  std::string File;
  std::string Hash; ///< FNV-1a (64 bit) of the scene file, its buffers, material libraries and images, hexadecimal
  std::vector<Texture> Textures;
  std::vector<Material> Materials;
  std::vector<Mesh> Meshes;
  std::vector<Node> Nodes;
  std::vector<Instance> Instances;
  std::vector<CameraModel> Cameras;
  std::vector<PunctualLight> Lights;
  std::vector<AnimationChannel> Animation;
  Environment Sky;
  int Resolution[2] = { 0, 0 }; ///< scene.extras.resolution; 0: not given
  int MaximumDepth = -1;        ///< scene.extras.max_depth; -1: not given
  std::vector<std::string> Warnings;

  /// World matrix of every node at `time` seconds (animation clamps at its ends; node transforms in double).
  std::vector<Mat4> WorldMatrices(double time) const;
  bool Animated() const { return !Animation.empty(); }
  /// False where something is to be lit and nothing gives light: no sky, no lamp, no emission, and not all is unlit.
  bool HasLight() const;
  double Duration() const; ///< seconds; 0 where nothing is animated
};

/// Reads .gltf, .glb or .obj. Throws SceneError ("file: place: what; remedy"); recoverable trouble goes into Warnings
/// in the same form: a missing image (white; black where it is the picture of an emission), triangles with positions
/// that are not finite (dropped), points and lines (skipped), values outside of their range (clamped), extensions we do
/// not know (ignored). Compressed meshes and other extensions that a file *requires* are errors.
///
/// glTF: the default scene (or the first) is instanced; all nodes and materials keep their place in the file. Animation
/// clips that move different things play together. Skins and morph targets keep the pose of the file at rest.
///
/// OBJ has no camera and none is made. One node per group or object, all double-sided, v flipped to point down.
/// MTL -> Material:
///   Ks = 0                        Lambert of reflectance Kd (Specular 0)
///   Ks > 0, max Kd <= max Ks / 10 metal of reflectance Ks (and no map_Kd)
///   Ks > 0 otherwise              diffuse Kd below a reflection of Ks at normal incidence: SpecularColor = Ks /
///   F0(Ni),
///                                 which may exceed 1; clamp F0 x SpecularColor to 1 as KHR_materials_specular says
///   illum 4, 6, 7, 9              glass: Transmission 1, Ior Ni, Volume, BaseColor sqrt(Tf) (two surfaces make Tf),
///   smooth Ns                            Roughness = sqrt(alpha), alpha^2 = 2 / (Ns + 2) (width of a Phong lobe); 0 (a
///   mirror)
///                                 where illum 3 to 7 asks for reflected rays and Ns >= 200
///   Ke, map_Ke                    Emission, EmissiveTexture
///   d or Tr                       Alpha, Blend; map_d goes into the alpha of the base colour, Mask where it is only 0
///   or 1 map_Kd, norm, -s, -o, -clamp  BaseColorTexture, NormalTexture, Transform, Wrap; Pr and Pm override
VTKQUELLSCENE_EXPORT std::shared_ptr<const Scene> LoadScene(const std::string& file);

/// Reads a latitude-longitude image (any format OpenImageIO reads) into `scene` as its environment, scaled by `scale`.
VTKQUELLSCENE_EXPORT void LoadEnvironment(Scene& scene, const std::string& file, float scale = 1);

/// Gives `scene` a studio as its environment: grey, brighter towards the zenith, with a soft key light in front, above
/// and to the right. A white horizontal plane below it has radiance 1.
VTKQUELLSCENE_EXPORT void AddStudioSky(Scene& scene);
}

#endif
