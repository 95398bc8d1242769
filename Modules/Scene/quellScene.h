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
  bool Nearest = false;            ///< the sampler's magnification filter
  bool MipMap = true; ///< the sampler's minification filter asks for mipmaps (also where the file leaves it open)
  Wrap WrapS = Wrap::Repeat, WrapT = Wrap::Repeat;

  /// Linear RGBA at (u, v), bilinear unless Nearest; wraps first; a non-finite coordinate reads 0.
  Vec4f Sample(float u, float v) const noexcept;

  /// The texels that a look-up reads, and how it weighs them.
  struct Footprint
  {
    std::size_t At[4]; ///< of their first channels
    float Weight[4];
  };
  /// Sample(u, v) is Read(Place(u, v)), for a texture that IsUsable.
  bool IsUsable() const noexcept
  {
    return this->Width > 0 && this->Height > 0 && !(this->Bytes.empty() && this->Floats.empty());
  }
  Footprint Place(float u, float v) const noexcept;
  Vec4f Read(const Footprint& place) const noexcept;
  /// Asks the memory for texels that Read will need soon.
  void Prefetch(const Footprint& place) const noexcept;
  /// Place gives the same for both.
  bool SharesPlaces(const Texture& other) const noexcept
  {
    return this->Width == other.Width && this->Height == other.Height && this->Nearest == other.Nearest &&
           this->WrapS == other.WrapS && this->WrapT == other.WrapT;
  }
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

/// glTF 2.0 metallic-roughness material and the extensions we read. A texture multiplies the factor of the same name;
/// the comment names its channel. Occlusion textures are checked but not kept: a path tracer finds the occlusion.
struct Material
{
  std::string Name;
  Vec3f BaseColor{ 1, 1, 1 };
  float Alpha = 1, Metallic = 1, Roughness = 1;
  Vec3f Emission; ///< radiance, W/(m^2 sr) relative; emissiveFactor x emissiveStrength
  bool DoubleSided = false;
  AlphaMode Mode = AlphaMode::Opaque;
  float AlphaCutoff = 0.5f;
  float Specular = 1;             ///< KHR_materials_specular, 0 to 1; 0 makes a dielectric pure Lambert
  Vec3f SpecularColor{ 1, 1, 1 }; ///< tints F0 of the dielectric; may exceed 1 (F0 x SpecularColor is clamped to 1)
  float Ior = 1.5f;
  float Transmission = 0;                                             ///< KHR_materials_transmission, 0 to 1
  Vec3f AttenuationColor{ 1, 1, 1 };                                  ///< KHR_materials_volume
  float AttenuationDistance = std::numeric_limits<float>::infinity(); ///< scene units
  bool Volume = false; ///< the surface bounds a volume (Thickness > 0): rays refract
  float Thickness = 0; ///< KHR_materials_volume, in the mesh's own units; only its being 0 matters to a path tracer
  float Clearcoat = 0; ///< KHR_materials_clearcoat, 0 to 1: weight of a dielectric layer of ior 1.5 on top; 0: none
  float ClearcoatRoughness = 0; ///< 0 to 1; alpha is its square, as for Roughness
  bool Unlit = false;
  /// Rough surfaces give back what one scattering between their microfacets loses. Not in glTF: false only to compare
  /// with renderers that leave it out.
  bool MultipleScattering = true;
  float NormalScale = 1;
  float ClearcoatNormalScale = 1;
  TextureUse BaseColorTexture;          ///< sRGB colour; alpha
  TextureUse MetallicRoughnessTexture;  ///< G: roughness, B: metallic
  TextureUse NormalTexture;             ///< RGB: tangent-space normal, 0.5 is 0
  TextureUse EmissiveTexture;           ///< sRGB colour
  TextureUse TransmissionTexture;       ///< R
  TextureUse SpecularTexture;           ///< A (its colour is of no meaning)
  TextureUse SpecularColorTexture;      ///< sRGB colour
  TextureUse ThicknessTexture;          ///< G; where it is 0 the surface is thin: no refraction, no absorption
  TextureUse ClearcoatTexture;          ///< R
  TextureUse ClearcoatRoughnessTexture; ///< G
  TextureUse ClearcoatNormalTexture; ///< RGB as NormalTexture; without one the coat has the *geometric* (interpolated)
                                     ///< normal, not that of NormalTexture
};

/// What one morph target adds to the vertices of its mesh at weight 1; each list as long as the mesh's own, or empty
/// where the target leaves that attribute alone. Every number is finite.
struct MorphTarget
{
  std::vector<Vec3f> Positions, Normals, Tangents;
};

/// One glTF primitive: an indexed triangle list in its node's space (with a skin: in the skin's bind space). Every
/// index is checked at load, joints against every skin that the mesh is used with. Dropped with a warning: triangles
/// that touch a non-finite position; those without area; and all but one of several at the same place that face the
/// same way, or any way with a double-sided material (a light would count twice). In a mesh that deforms only corners
/// that are the same vertex count as the same place.
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
  int Influences = 0;                 ///< joints per vertex: 0 (no skin), 4 or 8
  std::vector<std::uint16_t> Joints;  ///< Influences per vertex: indices into Skin::Joints
  std::vector<float> JointWeights;    ///< Influences per vertex, not negative, of sum 1
  std::vector<MorphTarget> Targets;   ///< empty: no morphing
};

/// Joints that move a mesh: a vertex goes to  sum_j weight_j World(Joints[j]) InverseBind[j] p.
struct Skin
{
  std::string Name;
  std::vector<int> Joints;       ///< nodes
  std::vector<Mat4> InverseBind; ///< one per joint; identity where the file has none
  int Skeleton = -1;             ///< common root node; carries no transform of its own; -1: not given
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
  int Skin = -1;              ///< index into Scene::Skins for the node's meshes that have joints
  std::vector<float> Weights; ///< morph weights at rest, one per target of the node's mesh (its own or its mesh's)
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
  Scale,
  Weights
};
struct AnimationChannel
{
  int Node = -1;
  AnimatedPath Path = AnimatedPath::Translation;
  Interpolation Mode = Interpolation::Linear;
  std::vector<float> Times;  ///< seconds, ascending
  std::vector<float> Values; ///< 3, 4 or (Weights) one per morph target and key (x3 for cubic spline: all in-tangents,
                             ///< values, out-tangents of a key)

  /// Numbers per key.
  std::size_t Width() const
  {
    const std::size_t keys = this->Times.size() * (this->Mode == Interpolation::CubicSpline ? 3 : 1);
    return keys > 0 ? this->Values.size() / keys : 0;
  }
  /// False where all keys hold the same value (exporters write many such channels).
  VTKQUELLSCENE_EXPORT bool Changes() const;
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

/// Everything that moves, at one time.
struct ScenePose
{
  std::vector<Mat4> World;                 ///< world matrix per node
  std::vector<std::vector<float>> Weights; ///< morph weights per node; empty where the node's mesh has no targets
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
  std::vector<Skin> Skins;
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
  /// World matrices and morph weights at `time` seconds.
  ScenePose PoseAt(double time) const;
  /// True where the vertices of the instance's mesh move against each other (a skin or morph targets with any effect):
  /// a node matrix does not place them, Deform does. A property of the scene's structure, the same at all times.
  bool Deforms(const Instance& instance) const;
  /// True where vertices of the instance can be elsewhere at another time: a channel that Changes() drives its node or
  /// an ancestor, one of its joints or their ancestors, or its morph weights.
  bool Moves(const Instance& instance) const;
  /// Moves() of all instances in one pass, for scenes with many.
  std::vector<char> MovingInstances() const;
  /// The vertices of the instance at `pose`, deformed and in *world* space, for any instance (one that does not deform
  /// is only transformed): position = float(p - origin), p in double; normals and tangents of unit length, tangent.w
  /// already negated where the vertex is mirrored (bitangent = cross(normal, tangent) w). A skinned mesh ignores its
  /// node's matrix. Morph targets act before the skin. Lists are resized, `normals` and `tangents` (may be null) to 0
  /// where the mesh has none. A position that overflows float is clamped to its range; never NaN. Reads nothing but
  /// the scene and the pose: may run for several instances at once.
  void Deform(const Instance& instance, const ScenePose& pose, const Vec3d& origin, std::vector<Vec3f>& positions,
    std::vector<Vec3f>* normals, std::vector<Vec4f>* tangents) const;
  /// True where `pose` mirrors the instance (negative determinant of its node; with a skin: of most joint matrices):
  /// the front of a triangle of Deform's positions is then the side from which it appears clockwise (glTF 2.0, 3.7.4).
  bool Mirrors(const Instance& instance, const ScenePose& pose) const;
  /// World-space box of all triangles' vertices at `pose`, deformed; false where there are none.
  bool Bounds(const ScenePose& pose, Vec3d& low, Vec3d& high) const;
  /// False where something is to be lit and nothing gives light: no sky, no lamp, no emission, and not all is unlit.
  bool HasLight() const;
  double Duration() const; ///< seconds; 0 where nothing is animated
};

struct SceneOptions
{
  /// Name or number (0 ...) of the one animation clip of a glTF file to play; empty: all that move different things.
  std::string Animation;
};

/// Reads .gltf, .glb or .obj. Throws SceneError ("file: place: what; remedy"); recoverable trouble goes into Warnings
/// in the same form: a missing image (white; black where it is the picture of an emission), triangles with positions
/// that are not finite (dropped), points and lines (skipped), values outside of their range (clamped), extensions we do
/// not know (ignored). Compressed meshes and other extensions that a file *requires* are errors.
///
/// glTF: the default scene (or the first) is instanced; all nodes and materials keep their place in the file. Animation
/// clips that move different things play together, unless one is chosen. A node with EXT_mesh_gpu_instancing gets one
/// child node per instance, behind the nodes of the file. WebP images are read where OpenImageIO can.
///
/// Images of OBJ are read in the formats of LoadEnvironment.
///
/// OBJ has no camera and none is made. One node per group or object, all double-sided, v flipped to point down.
/// MTL -> Material:
///   Ks = 0                        Lambert of reflectance Kd (Specular 0)
///   Ks > 0, max Kd <= max Ks / 10 metal of reflectance Ks (and no map_Kd)
///   Ks > 0 otherwise              diffuse Kd below a reflection of Ks at normal incidence: SpecularColor =
///                                 Ks / F0(Ni), which may exceed 1; clamp F0 x SpecularColor to 1 as
///                                 KHR_materials_specular says
///   illum 4, 6, 7, 9              smooth glass: Transmission 1, Ior Ni, Volume, BaseColor sqrt(Tf) (two surfaces make
///                                 Tf; then without map_Kd); but not where d, Tr or map_d makes the surface dissolve
///   Ns                            Roughness = sqrt(alpha), alpha^2 = 2 / (Ns + 2) (width of a Phong lobe); 0
///                                 (a mirror) where illum 3 to 7 asks for reflected rays and Ns >= 200
///   Ke, map_Ke                    Emission, EmissiveTexture
///   d or Tr                       Alpha, Blend; map_d goes into the alpha of the base colour, Mask where it is only 0
///                                 or 1
///   map_Kd, norm, -s, -o, -clamp  BaseColorTexture, NormalTexture, Transform, Wrap; Pr and Pm override
VTKQUELLSCENE_EXPORT std::shared_ptr<const Scene> LoadScene(const std::string& file, const SceneOptions& options = {});

/// Reads a latitude-longitude image into `scene` as its environment, scaled by `scale`: HDR, OpenEXR, PNG, JPEG, WebP
/// (where OpenImageIO can), Targa, BMP or PNM, told by what the file holds; 8 bits are taken as sRGB.
VTKQUELLSCENE_EXPORT void LoadEnvironment(Scene& scene, const std::string& file, float scale = 1);

/// Gives `scene` a studio as its environment: grey, brighter towards the zenith, with a soft key light in front, above
/// and to the right. A white horizontal plane below it has radiance 1.
VTKQUELLSCENE_EXPORT void AddStudioSky(Scene& scene);
}

#endif
