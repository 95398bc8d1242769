// SPDX-License-Identifier: BSD-3-Clause
// glTF 2.0 reader.
//
// The JSON is read with nlohmann-json directly and not through tinygltf: of the 17 broken files this reader is tried
// on, tinygltf 2.7 ends the process on one (an image URI of rubbish), accepts four that are wrong (bufferViews outside
// of the buffer; an array, a string and a negative number where an object or an index belongs) and loses the place of
// every mistake. All checks would have to be repeated on its model, and what would be left to it is the JSON parser
// that we then use ourselves. Images are decoded by OpenImageIO, which the project needs anyway.
#include "quellGltfAccess.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <utility>

namespace quell
{
namespace detail
{
namespace
{
const char* const Reexport = "export the file again";

/// What an instance takes here and in a renderer's tables.
constexpr std::uint64_t BytesPerInstance = 512;

/// Extensions whose meaning we honour.
const char* const Understood[] = { "EXT_mesh_gpu_instancing", "EXT_texture_webp", "KHR_lights_punctual",
  "KHR_materials_clearcoat", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_specular",
  "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_volume", "KHR_mesh_quantization",
  "KHR_texture_transform" };
/// Extensions of materials that are left out; the warning names the materials.
const char* const IgnoredOfMaterials[] = { "KHR_materials_anisotropy", "KHR_materials_diffuse_transmission",
  "KHR_materials_dispersion", "KHR_materials_iridescence", "KHR_materials_pbrSpecularGlossiness",
  "KHR_materials_sheen" };
/// Extensions that change nothing in the picture, or only alternatives to what the file shows by default.
const char* const Harmless[] = { "KHR_materials_variants", "KHR_xmp", "KHR_xmp_json_ld", "MSFT_lod",
  "KHR_draco_mesh_compression", "EXT_meshopt_compression" };

template <std::size_t N>
bool Contains(const char* const (&list)[N], const std::string& name)
{
  return std::any_of(list, list + N, [&](const char* s) { return name == s; });
}

class GltfReader
{
public:
  GltfReader(Scene& scene, const GltfContainer& container, ContentHash& hash, const std::string& animation)
    : Out(scene)
    , Animation(animation)
    , Root(container.Document, scene.File, "")
    , Access(Root, scene.File, container, hash)
    , Hash(hash)
  {
  }

  void Read()
  {
    this->CheckHeader();
    this->ReadNodes();
    this->ReadDefaultScene();
    this->Access.CheckAll();
    this->ReadMaterials();
    this->ReadSkins();
    this->ReadInstances();
    this->Faults.Warn(this->Out);
    this->DropUnusedTextures();
    this->ReadAnimations();
  }

private:
  void CheckHeader();
  void ReadNodes();
  void ReadDefaultScene();
  void ReadExtras(const JsonValue& extras);
  void ReadEnvironment(const JsonValue& entry);
  void ReadMaterials();
  void ReadMaterial(const JsonValue& json, Material& material);
  void ResolveTextures(std::size_t material);
  void DropUnusedTextures();
  void ReadInstances();
  void ReadCamera(const JsonValue& node, int index);
  void ReadLight(const JsonValue& node, int index);
  void ReadMesh(const JsonValue& node, int index);
  int ReadPrimitive(const JsonValue& primitive, const JsonValue& mesh, int index);
  void ReadInfluences(const JsonValue& attributes, const std::string& who, Mesh& out);
  void ReadTargets(const JsonValue& primitive, const std::string& who, Mesh& out);
  void ReadWeights(const JsonValue& owner, std::size_t targets, std::vector<float>& weights);
  void CheckJoints(const JsonValue& primitive, int mesh, const Skin& skin);
  void MultiplyInstances(const JsonValue& node, int index, std::size_t before, int& id);
  std::size_t TargetsOf(const JsonValue& mesh) const;
  void ReadSkins();
  void ReadAnimations();
  std::size_t FindAnimation(const std::string& name) const;
  bool ReadChannel(const JsonValue& animation, const JsonValue& channel, AnimationChannel& out);
  TextureUse ReadTextureUse(const JsonValue& info);
  const Texture& ReadImage(std::size_t source);
  int ReadTexture(const JsonValue& use, bool srgb);
  int UsedMaterial(const JsonValue& primitive);

  void Warn(const JsonValue& where, const std::string& what, const std::string& remedy)
  {
    detail::Warn(this->Out, where.Where(), what, remedy);
  }
  float Clamped(const JsonValue& json, const char* key, float otherwise, float low, float high);
  Vec3f Color(const JsonValue& json, const char* key, const Vec3f& otherwise, float high);
  std::string NameOf(const JsonValue& json, const std::string& otherwise)
  {
    const std::string name = json.StringOr("name", "");
    return name.empty() ? otherwise : name;
  }

  Scene& Out;
  const std::string& Animation;
  JsonValue Root;
  GltfAccess Access;
  ContentHash& Hash;
  std::vector<char> Reached;                                ///< node belongs to the scene that is shown
  std::map<std::pair<std::size_t, bool>, int> TextureCache; ///< (texture, sRGB) -> Scene::Textures or -1
  std::map<std::size_t, Texture> ImageCache;
  std::map<std::pair<std::size_t, std::size_t>, int> MeshCache; ///< (mesh, primitive) -> Scene::Meshes or -1
  std::vector<char> TexturesResolved;
  int DefaultMaterial = -1;
  MeshFaults Faults;
  std::vector<char> Drives; ///< node places something that is shown: Reached, a joint or an ancestor of one
  std::map<int, std::pair<int, int>> Multiplied; ///< node of EXT_mesh_gpu_instancing -> its new children [first, end)
  std::map<int, std::pair<std::uint32_t, std::string>> LargestJoint; ///< Scene::Meshes -> (joint in use, attribute)
  std::map<std::string, std::vector<std::string>> Ignored;           ///< extension -> materials that have it
};

float GltfReader::Clamped(const JsonValue& json, const char* key, float otherwise, float low, float high)
{
  const float v = json.FloatOr(key, otherwise);
  const float c = std::min(std::max(v, low), high);
  if (c != v)
    this->Warn(json.Get(key), "the value is outside of its range and was clamped", "correct it");
  return c;
}

Vec3f GltfReader::Color(const JsonValue& json, const char* key, const Vec3f& otherwise, float high)
{
  if (!json.Has(key))
    return otherwise;
  const JsonValue value = json.Get(key);
  if (value.Size() < 3)
    value.Fail("a colour needs three numbers", Reexport);
  Vec3f color;
  for (int i = 0; i < 3; ++i)
  {
    const float v = value.At(std::size_t(i)).Float();
    color[i] = std::min(std::max(v, 0.f), high);
    if (color[i] != v)
      this->Warn(value, "the colour is outside of its range and was clamped", "correct it");
  }
  return color;
}

void GltfReader::CheckHeader()
{
  if (!this->Root.IsObject())
    this->Root.Fail("the document is not a JSON object", "this is not a glTF file");
  const JsonValue version = this->Root.Get("asset").Get("version");
  const std::string& text = version.String();
  if (text.compare(0, 2, "2.") != 0)
    version.Fail("glTF version \"" + text + "\" is not supported", "export glTF 2.0");
  const std::size_t required = this->Root.CountOf("extensionsRequired");
  for (std::size_t i = 0; i < required; ++i)
  {
    const JsonValue item = this->Root.Get("extensionsRequired").At(i);
    const std::string& name = item.String();
    if (name == "KHR_draco_mesh_compression" || name == "EXT_meshopt_compression")
      item.Fail("the file requires " + name + ", which is not supported", "export it without mesh compression");
    if (!Contains(Understood, name) && name != "KHR_materials_variants")
      item.Fail("the file requires " + name + ", which is not supported", "export it without this extension");
  }
  const std::size_t used = this->Root.CountOf("extensionsUsed");
  for (std::size_t i = 0; i < used; ++i)
  {
    const JsonValue item = this->Root.Get("extensionsUsed").At(i);
    const std::string& name = item.String();
    if (!Contains(Understood, name) && !Contains(Harmless, name) && !Contains(IgnoredOfMaterials, name))
      this->Warn(
        item, "extension " + name + " is not supported and ignored", "the picture may differ from the author's");
  }
}

void GltfReader::ReadNodes()
{
  const std::size_t count = this->Root.CountOf("nodes");
  this->Out.Nodes.resize(count);
  for (std::size_t i = 0; i < count; ++i)
  {
    const JsonValue json = this->Root.Get("nodes").At(i);
    Node& node = this->Out.Nodes[i];
    node.Name = json.StringOr("name", "");
    if (json.Has("matrix"))
    {
      const std::vector<double> m = json.Get("matrix").Numbers(16);
      for (std::size_t k = 0; k < 16; ++k)
        node.Matrix.m[k % 4][k / 4] = m[k]; // glTF stores columns
      node.HasMatrix = true;
      if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1)
        this->Warn(json.Get("matrix"), "the last row is not 0 0 0 1 and is ignored", "use an affine matrix");
      node.Matrix.m[3][0] = node.Matrix.m[3][1] = node.Matrix.m[3][2] = 0;
      node.Matrix.m[3][3] = 1;
    }
    for (const char* key : { "translation", "scale" })
      if (json.Has(key))
      {
        const std::vector<double> v = json.Get(key).Numbers(3);
        (key[0] == 't' ? node.Translation : node.Scale) = { v[0], v[1], v[2] };
      }
    if (json.Has("rotation"))
    {
      const std::vector<double> q = json.Get("rotation").Numbers(4);
      const double l = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
      if (l > 0 && std::isfinite(l))
        for (std::size_t k = 0; k < 4; ++k)
          node.Rotation[k] = q[k] / l;
      else
        this->Warn(json.Get("rotation"), "the quaternion has no usable length; no rotation is applied", Reexport);
    }
    const std::size_t children = json.CountOf("children");
    for (std::size_t k = 0; k < children; ++k)
      node.Children.push_back(int(json.Get("children").At(k).Index(count, "node")));
  }
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < this->Out.Nodes[i].Children.size(); ++k)
    {
      Node& child = this->Out.Nodes[std::size_t(this->Out.Nodes[i].Children[k])];
      if (child.Parent >= 0)
        this->Root.Get("nodes")
          .At(i)
          .Get("children")
          .At(k)
          .Fail("node " + std::to_string(this->Out.Nodes[i].Children[k]) + " is already a child of node " +
                  std::to_string(child.Parent),
            "give every node one parent");
      child.Parent = int(i);
    }
  // With one parent each, whatever no root reaches is a cycle.
  std::vector<char> seen(count, 0);
  std::vector<int> stack;
  for (std::size_t i = 0; i < count; ++i)
    if (this->Out.Nodes[i].Parent < 0)
      stack.push_back(int(i));
  while (!stack.empty())
  {
    const std::size_t i = std::size_t(stack.back());
    stack.pop_back();
    seen[i] = 1;
    stack.insert(stack.end(), this->Out.Nodes[i].Children.begin(), this->Out.Nodes[i].Children.end());
  }
  for (std::size_t i = 0; i < count; ++i)
    if (!seen[i])
      this->Root.Get("nodes").At(i).Fail(
        "the node is its own descendant (a cycle of nodes)", "remove the cycle from \"children\"");
}

void GltfReader::ReadDefaultScene()
{
  const std::size_t scenes = this->Root.CountOf("scenes");
  std::vector<int> stack;
  if (scenes > 0)
  {
    const std::size_t shown = this->Root.Has("scene") ? this->Root.Get("scene").Index(scenes, "scene") : 0;
    const JsonValue scene = this->Root.Get("scenes").At(shown);
    const std::size_t roots = scene.CountOf("nodes");
    for (std::size_t k = 0; k < roots; ++k)
      stack.push_back(int(scene.Get("nodes").At(k).Index(this->Out.Nodes.size(), "node")));
    if (scene.Has("extras") && scene.Get("extras").IsObject())
      this->ReadExtras(scene.Get("extras"));
  }
  else
  {
    if (this->Root.Has("scene"))
      this->Root.Get("scene").Index(0, "scene");
    for (std::size_t i = 0; i < this->Out.Nodes.size(); ++i)
      if (this->Out.Nodes[i].Parent < 0)
        stack.push_back(int(i));
  }
  this->Reached.assign(this->Out.Nodes.size(), 0);
  while (!stack.empty())
  {
    const std::size_t i = std::size_t(stack.back());
    stack.pop_back();
    if (this->Reached[i])
      continue;
    this->Reached[i] = 1;
    stack.insert(stack.end(), this->Out.Nodes[i].Children.begin(), this->Out.Nodes[i].Children.end());
  }
}

/// extras belong to whoever writes them, so that nothing in there is an error.
void GltfReader::ReadExtras(const JsonValue& extras)
{
  try
  {
    if (extras.Has("resolution"))
    {
      const std::vector<double> r = extras.Get("resolution").Numbers(2);
      if (r[0] >= 1 && r[1] >= 1 && r[0] <= 65536 && r[1] <= 65536)
      {
        this->Out.Resolution[0] = int(r[0]);
        this->Out.Resolution[1] = int(r[1]);
      }
      else
        this->Warn(extras.Get("resolution"), "not a resolution from 1 to 65536; ignored", "write [width, height]");
    }
    if (extras.Has("max_depth"))
      this->Out.MaximumDepth = int(extras.Get("max_depth").Unsigned(1000000));
    if (extras.Has("environment"))
    {
      const JsonValue environment = extras.Get("environment");
      if (!environment.IsArray())
        this->ReadEnvironment(environment);
      else if (environment.Size() > 0)
      {
        this->ReadEnvironment(environment.At(0));
        if (environment.Size() > 1)
          this->Warn(environment, "only the first environment is used", "merge them into one image");
      }
    }
  }
  catch (const SceneError& e)
  {
    const std::string text = e.what();
    this->Out.Warnings.push_back(text + " (ignored)");
  }
}

/// {"type": "constant", "radiance": [r, g, b]}, {"type": "envmap", "filename": ..., "scale": 1, "toWorld": rows of a
/// 4 x 4 matrix}, or the name of an image. With "envmap" the image is oriented as Mitsuba's is (its left edge looks
/// along -z, u grows towards +x) and then turned by toWorld; our own convention has -z in the centre column. The image
/// is resampled once, so that a renderer need not know.
void GltfReader::ReadEnvironment(const JsonValue& entry)
{
  Environment& sky = this->Out.Sky;
  const std::string type = entry.IsString() ? "image" : entry.StringOr("type", "envmap");
  if (type == "constant")
  {
    sky.Color = this->Color(entry, "radiance", Vec3f(1), std::numeric_limits<float>::max());
    sky.Present = true;
    return;
  }
  if (type != "envmap" && type != "image")
  {
    this->Warn(entry, "environment type \"" + type + "\" is unknown and ignored", "use \"constant\" or \"envmap\"");
    return;
  }
  const std::string name = entry.IsString() ? entry.String() : entry.Get("filename").String();
  const std::string path = Beside(this->Out.File, name);
  Texture image;
  std::string reason;
  std::string repairs;
  if (!LoadSky(path, image, repairs, reason))
  {
    this->Warn(entry, "environment \"" + path + "\" cannot be read (" + reason + "); there is no sky",
      "put the file there or correct the name");
    return;
  }
  if (!repairs.empty())
    this->Warn(entry, "of the environment, " + repairs, "");
  Bytes content;
  if (ReadFile(path, content, reason))
    this->Hash.Add(content.data(), content.size());
  const float scale = entry.IsString() ? 1.f : this->Clamped(entry, "scale", 1, 0, std::numeric_limits<float>::max());
  if (type == "envmap")
  {
    Mat4 toWorld, toLocal;
    if (entry.Has("toWorld"))
    {
      const JsonValue rows = entry.Get("toWorld");
      for (std::size_t i = 0; i < 4; ++i)
      {
        const std::vector<double> row = rows.At(i).Numbers(4);
        for (std::size_t j = 0; j < 3; ++j)
          if (i < 3)
            toWorld.m[i][j] = row[j];
      }
    }
    if (!toWorld.Inverse(toLocal))
    {
      this->Warn(entry.Get("toWorld"), "the matrix is singular and ignored", "write a rotation");
      toLocal = Mat4();
    }
    const double pi = 3.14159265358979323846;
    SceneMemory::Take(std::uint64_t(image.Width) * std::uint64_t(image.Height) * 4 * sizeof(float));
    std::vector<float> turned(std::size_t(image.Width) * std::size_t(image.Height) * 4);
    for (int y = 0; y < image.Height; ++y)
      for (int x = 0; x < image.Width; ++x)
      {
        const double theta = pi * (y + 0.5) / image.Height, phi = 2 * pi * ((x + 0.5) / image.Width - 0.5);
        const Vec3d d = Normalized(
          toLocal.Direction({ std::sin(theta) * std::sin(phi), std::cos(theta), -std::sin(theta) * std::cos(phi) }));
        const double u = std::atan2(d.x, -d.z) / (2 * pi), v = std::acos(std::min(std::max(d.y, -1.), 1.)) / pi;
        const Vec4f c = image.Sample(float(u), float(v));
        float* p = &turned[(std::size_t(y) * std::size_t(image.Width) + std::size_t(x)) * 4];
        p[0] = c.x;
        p[1] = c.y;
        p[2] = c.z;
        p[3] = 1;
      }
    image.Floats.swap(turned);
    image.Bytes.clear();
    image.SRGB = false;
  }
  sky.Texture = int(this->Out.Textures.size());
  sky.Color = Vec3f(scale);
  sky.Present = true;
  this->Out.Textures.push_back(std::move(image));
}

TextureUse GltfReader::ReadTextureUse(const JsonValue& info)
{
  TextureUse use;
  use.Texture = int(info.Get("index").Index(this->Root.CountOf("textures"), "texture"));
  std::uint64_t set = info.UnsignedOr("texCoord", 0);
  if (info.HasExtension("KHR_texture_transform"))
  {
    const JsonValue t = info.Extension("KHR_texture_transform");
    set = t.UnsignedOr("texCoord", set);
    const std::vector<double> offset = t.Has("offset") ? t.Get("offset").Numbers(2) : std::vector<double>{ 0, 0 };
    const std::vector<double> scale = t.Has("scale") ? t.Get("scale").Numbers(2) : std::vector<double>{ 1, 1 };
    const double angle = t.NumberOr("rotation", 0), c = std::cos(angle), s = std::sin(angle);
    // Scale, then rotate counter-clockwise as seen with v pointing down, then move.
    use.Transform[0][0] = float(c * scale[0]);
    use.Transform[0][1] = float(s * scale[1]);
    use.Transform[0][2] = float(offset[0]);
    use.Transform[1][0] = float(-s * scale[0]);
    use.Transform[1][1] = float(c * scale[1]);
    use.Transform[1][2] = float(offset[1]);
  }
  if (set > 1)
    this->Warn(
      info, "texture coordinates " + std::to_string(set) + " are not supported; set 0 is used", "use two sets at most");
  use.TexCoord = set == 1 ? 1 : 0;
  return use;
}

void GltfReader::ReadMaterials()
{
  const std::size_t count = this->Root.CountOf("materials");
  this->Out.Materials.resize(count);
  this->TexturesResolved.assign(count, 0);
  for (std::size_t i = 0; i < count; ++i)
    this->ReadMaterial(this->Root.Get("materials").At(i), this->Out.Materials[i]);
  for (const auto& ignored : this->Ignored)
  {
    detail::Warn(this->Out, Names(ignored.second), ignored.first + " is not supported and ignored",
      "the picture may differ from the author's");
  }
}

void GltfReader::ReadMaterial(const JsonValue& json, Material& m)
{
  const float huge = std::numeric_limits<float>::max();
  m.Name = json.StringOr("name", "");
  if (json.Has("pbrMetallicRoughness"))
  {
    const JsonValue pbr = json.Get("pbrMetallicRoughness");
    if (pbr.Has("baseColorFactor"))
    {
      const JsonValue factor = pbr.Get("baseColorFactor");
      factor.Numbers(4);
      m.BaseColor = this->Color(pbr, "baseColorFactor", Vec3f(1), 1);
      m.Alpha = std::min(std::max(factor.At(3).Float(), 0.f), 1.f);
    }
    m.Metallic = this->Clamped(pbr, "metallicFactor", 1, 0, 1);
    m.Roughness = this->Clamped(pbr, "roughnessFactor", 1, 0, 1);
    if (pbr.Has("baseColorTexture"))
      m.BaseColorTexture = this->ReadTextureUse(pbr.Get("baseColorTexture"));
    if (pbr.Has("metallicRoughnessTexture"))
      m.MetallicRoughnessTexture = this->ReadTextureUse(pbr.Get("metallicRoughnessTexture"));
  }
  if (json.Has("normalTexture"))
  {
    m.NormalTexture = this->ReadTextureUse(json.Get("normalTexture"));
    m.NormalScale = json.Get("normalTexture").FloatOr("scale", 1);
  }
  if (json.Has("occlusionTexture")) // only checked: light transport darkens corners by itself
    this->ReadTextureUse(json.Get("occlusionTexture"));
  m.Emission = this->Color(json, "emissiveFactor", Vec3f(0), huge);
  if (json.Has("emissiveTexture"))
    m.EmissiveTexture = this->ReadTextureUse(json.Get("emissiveTexture"));
  m.DoubleSided = json.BoolOr("doubleSided", false);
  const std::string mode = json.StringOr("alphaMode", "OPAQUE");
  m.Mode = mode == "MASK" ? AlphaMode::Mask : mode == "BLEND" ? AlphaMode::Blend : AlphaMode::Opaque;
  if (m.Mode == AlphaMode::Opaque && mode != "OPAQUE")
    this->Warn(json.Get("alphaMode"), "unknown mode \"" + mode + "\"; OPAQUE is used", "use OPAQUE, MASK or BLEND");
  m.AlphaCutoff = this->Clamped(json, "alphaCutoff", 0.5f, 0, huge);

  if (json.HasExtension("KHR_materials_emissive_strength"))
  {
    const float s = this->Clamped(json.Extension("KHR_materials_emissive_strength"), "emissiveStrength", 1, 0, huge);
    for (int i = 0; i < 3; ++i)
      m.Emission[i] = std::min(m.Emission[i] * s, huge);
  }
  if (json.HasExtension("KHR_materials_specular"))
  {
    const JsonValue e = json.Extension("KHR_materials_specular");
    m.Specular = this->Clamped(e, "specularFactor", 1, 0, 1);
    m.SpecularColor = this->Color(e, "specularColorFactor", Vec3f(1), huge);
    if (e.Has("specularTexture"))
      m.SpecularTexture = this->ReadTextureUse(e.Get("specularTexture"));
    if (e.Has("specularColorTexture"))
      m.SpecularColorTexture = this->ReadTextureUse(e.Get("specularColorTexture"));
  }
  if (json.HasExtension("KHR_materials_ior"))
  {
    const JsonValue e = json.Extension("KHR_materials_ior");
    m.Ior = e.FloatOr("ior", 1.5f);
    if (m.Ior == 0) // the extension's way to say "reflect everything"; an index of 1e4 does that
      m.Ior = 1e4f;
    else
      m.Ior = this->Clamped(e, "ior", 1.5f, 1, 1e4f);
  }
  if (json.HasExtension("KHR_materials_transmission"))
  {
    const JsonValue e = json.Extension("KHR_materials_transmission");
    m.Transmission = this->Clamped(e, "transmissionFactor", 0, 0, 1);
    if (e.Has("transmissionTexture"))
      m.TransmissionTexture = this->ReadTextureUse(e.Get("transmissionTexture"));
  }
  if (json.HasExtension("KHR_materials_volume"))
  {
    const JsonValue e = json.Extension("KHR_materials_volume");
    m.Thickness = this->Clamped(e, "thicknessFactor", 0, 0, huge);
    m.Volume = m.Thickness > 0;
    if (e.Has("thicknessTexture"))
      m.ThicknessTexture = this->ReadTextureUse(e.Get("thicknessTexture"));
    m.AttenuationColor = this->Color(e, "attenuationColor", Vec3f(1), 1);
    m.AttenuationDistance = e.FloatOr("attenuationDistance", std::numeric_limits<float>::infinity());
    if (!(m.AttenuationDistance > 0))
    {
      this->Warn(e.Get("attenuationDistance"), "the distance must be positive; no attenuation is used", "correct it");
      m.AttenuationDistance = std::numeric_limits<float>::infinity();
    }
  }
  if (json.HasExtension("KHR_materials_clearcoat"))
  {
    const JsonValue e = json.Extension("KHR_materials_clearcoat");
    m.Clearcoat = this->Clamped(e, "clearcoatFactor", 0, 0, 1);
    m.ClearcoatRoughness = this->Clamped(e, "clearcoatRoughnessFactor", 0, 0, 1);
    if (e.Has("clearcoatTexture"))
      m.ClearcoatTexture = this->ReadTextureUse(e.Get("clearcoatTexture"));
    if (e.Has("clearcoatRoughnessTexture"))
      m.ClearcoatRoughnessTexture = this->ReadTextureUse(e.Get("clearcoatRoughnessTexture"));
    if (e.Has("clearcoatNormalTexture"))
    {
      m.ClearcoatNormalTexture = this->ReadTextureUse(e.Get("clearcoatNormalTexture"));
      m.ClearcoatNormalScale = e.Get("clearcoatNormalTexture").FloatOr("scale", 1);
    }
  }
  m.Unlit = json.HasExtension("KHR_materials_unlit");
  for (const char* extension : IgnoredOfMaterials)
    if (json.HasExtension(extension))
      this->Ignored[extension].push_back(json.Where() + (m.Name.empty() ? "" : " \"" + m.Name + "\""));
}

const Texture& GltfReader::ReadImage(std::size_t source)
{
  const auto known = this->ImageCache.find(source);
  if (known != this->ImageCache.end())
    return known->second;
  const JsonValue image = this->Root.Get("images").At(source);
  Texture decoded;
  Bytes content;
  std::string reason, name = "image " + std::to_string(source);
  bool ok = true;
  if (image.Has("uri"))
  {
    const std::string& uri = image.Get("uri").String();
    if (IsDataUri(uri))
      ok = DecodeDataUri(uri, content, reason);
    else if (IsRemoteUri(uri))
    {
      ok = false;
      name = uri;
      reason = "images are not fetched";
    }
    else
    {
      name = Beside(this->Out.File, DecodePercent(uri));
      ok = ReadFile(name, content, reason) || ReadFile(Beside(this->Out.File, uri), content, reason);
      this->Hash.Add(content.data(), content.size());
    }
  }
  else
    content = this->Access.View(image.Get("bufferView"));
  if (!ok || !DecodeImage(content, decoded, reason))
  {
    decoded = Texture();
    this->Warn(image, "image \"" + name + "\" cannot be used (" + reason + "); it is replaced by a neutral value",
      "put the image there or correct the uri");
  }
  decoded.Name = this->NameOf(image, name);
  return this->ImageCache.emplace(source, std::move(decoded)).first->second;
}

int GltfReader::ReadTexture(const JsonValue& json, bool srgb)
{
  const std::size_t images = this->Root.CountOf("images");
  const Texture* image = nullptr;
  if (json.HasExtension("EXT_texture_webp"))
    image = &this->ReadImage(json.Extension("EXT_texture_webp").Get("source").Index(images, "image"));
  if ((!image || image->Width == 0) && json.Has("source"))
    image = &this->ReadImage(json.Get("source").Index(images, "image"));
  if (!image)
  {
    this->Warn(json,
      json.HasExtension("KHR_texture_basisu")
        ? "the texture exists only as KTX2 (KHR_texture_basisu), which is not supported, and is ignored"
        : "the texture has no PNG or JPEG source and is ignored",
      "export with PNG or JPEG images");
    return -1;
  }
  if (image->Width == 0)
    return -1;
  SceneMemory::Take(image->Bytes.size() + image->Floats.size() * sizeof(float));
  Texture texture = *image;
  texture.SRGB = srgb;
  if (json.Has("sampler"))
  {
    const JsonValue sampler =
      this->Root.Get("samplers").At(json.Get("sampler").Index(this->Root.CountOf("samplers"), "sampler"));
    texture.Nearest = sampler.UnsignedOr("magFilter", 9729) == 9728;
    const std::uint64_t minification = sampler.UnsignedOr("minFilter", 9987);
    texture.MipMap = minification != 9728 && minification != 9729;
    for (const char* key : { "wrapS", "wrapT" })
    {
      const std::uint64_t code = sampler.UnsignedOr(key, 10497);
      if (code != 10497 && code != 33071 && code != 33648)
        this->Warn(sampler.Get(key), "unknown wrap mode " + std::to_string(code) + "; repeat is used", "");
      (key[4] == 'S' ? texture.WrapS : texture.WrapT) = code == 33071   ? Wrap::Clamp
                                                        : code == 33648 ? Wrap::Mirror
                                                                        : Wrap::Repeat;
    }
  }
  this->Out.Textures.push_back(std::move(texture));
  return int(this->Out.Textures.size()) - 1;
}

/// Images are decoded for materials that are used, once per (texture, colour space).
void GltfReader::ResolveTextures(std::size_t index)
{
  if (this->TexturesResolved[index])
    return;
  this->TexturesResolved[index] = 1;
  Material& m = this->Out.Materials[index];
  const auto resolve = [&](TextureUse& use, bool srgb)
  {
    if (use.Texture < 0)
      return;
    const std::pair<std::size_t, bool> key(std::size_t(use.Texture), srgb);
    auto found = this->TextureCache.find(key);
    if (found == this->TextureCache.end())
      found = this->TextureCache.emplace(key, this->ReadTexture(this->Root.Get("textures").At(key.first), srgb)).first;
    use.Texture = found->second;
  };
  resolve(m.BaseColorTexture, true);
  resolve(m.MetallicRoughnessTexture, false);
  resolve(m.NormalTexture, false);
  resolve(m.TransmissionTexture, false);
  resolve(m.SpecularTexture, true); // only its alpha counts: files use one image for this and the next
  resolve(m.SpecularColorTexture, true);
  resolve(m.ThicknessTexture, false);
  resolve(m.ClearcoatTexture, false);
  resolve(m.ClearcoatRoughnessTexture, false);
  resolve(m.ClearcoatNormalTexture, false);
  const bool hadEmissive = m.EmissiveTexture.Texture >= 0;
  resolve(m.EmissiveTexture, true);
  if (hadEmissive && m.EmissiveTexture.Texture < 0)
    m.Emission = Vec3f(0); // a lost picture of a lamp's glow must not make the whole object a lamp
}

/// Materials that nothing uses have no images: what was a number of the file's must not become one of the scene's.
void GltfReader::DropUnusedTextures()
{
  for (std::size_t i = 0; i < this->TexturesResolved.size(); ++i)
  {
    if (this->TexturesResolved[i])
      continue;
    Material& m = this->Out.Materials[i];
    for (TextureUse* use : { &m.BaseColorTexture, &m.MetallicRoughnessTexture, &m.NormalTexture, &m.TransmissionTexture,
           &m.SpecularTexture, &m.SpecularColorTexture, &m.ThicknessTexture, &m.ClearcoatTexture,
           &m.ClearcoatRoughnessTexture, &m.ClearcoatNormalTexture, &m.EmissiveTexture })
      use->Texture = -1;
  }
}

int GltfReader::UsedMaterial(const JsonValue& primitive)
{
  if (primitive.Has("material"))
  {
    const std::size_t i = primitive.Get("material").Index(this->TexturesResolved.size(), "material");
    this->ResolveTextures(i);
    return int(i);
  }
  if (this->DefaultMaterial < 0)
  {
    this->DefaultMaterial = int(this->Out.Materials.size());
    this->Out.Materials.emplace_back();
    this->Out.Materials.back().Name = "default";
  }
  return this->DefaultMaterial;
}

void GltfReader::ReadInstances()
{
  int id = 0;
  for (std::size_t i = 0; i < this->Reached.size(); ++i) // MultiplyInstances adds nodes behind these
  {
    if (!this->Reached[i])
      continue;
    const JsonValue node = this->Root.Get("nodes").At(i);
    if (node.Has("camera"))
      this->ReadCamera(node, int(i));
    if (node.HasExtension("KHR_lights_punctual"))
      this->ReadLight(node, int(i));
    if (node.Has("mesh"))
    {
      const std::size_t before = this->Out.Instances.size();
      this->ReadMesh(node, int(i));
      if (this->Out.Instances.size() > before)
      {
        ++id;
        for (std::size_t k = before; k < this->Out.Instances.size(); ++k)
          this->Out.Instances[k].Id = id;
        if (node.HasExtension("EXT_mesh_gpu_instancing"))
          this->MultiplyInstances(node, int(i), before, id);
      }
    }
  }
}

void GltfReader::ReadCamera(const JsonValue& node, int index)
{
  const JsonValue json =
    this->Root.Get("cameras").At(node.Get("camera").Index(this->Root.CountOf("cameras"), "camera"));
  CameraModel camera;
  camera.Name = this->NameOf(json, this->Out.Nodes[std::size_t(index)].Name);
  camera.Node = index;
  const JsonValue typeValue = json.Get("type");
  const std::string& type = typeValue.String();
  if (type == "perspective")
  {
    camera.YFov = json.Get(type.c_str()).Get("yfov").Number();
    if (!(camera.YFov > 0 && camera.YFov < 3.14159))
      json.Get(type.c_str()).Get("yfov").Fail("the field of view must lie between 0 and pi radians", "correct it");
  }
  else if (type == "orthographic")
  {
    camera.Orthographic = true;
    camera.YMag = std::fabs(json.Get(type.c_str()).Get("ymag").Number());
    if (!(camera.YMag > 0))
      json.Get(type.c_str()).Get("ymag").Fail("the magnification must not be 0", "correct it");
  }
  else
    typeValue.Fail("unknown camera type \"" + type + "\"", "use perspective or orthographic");
  this->Out.Cameras.push_back(camera);
}

void GltfReader::ReadLight(const JsonValue& node, int index)
{
  const JsonValue reference = node.Extension("KHR_lights_punctual").Get("light");
  if (!this->Root.HasExtension("KHR_lights_punctual"))
    reference.Fail("the file has no list of lights (extensions.KHR_lights_punctual.lights)", Reexport);
  const JsonValue list = this->Root.Extension("KHR_lights_punctual");
  const JsonValue json = list.Get("lights").At(reference.Index(list.CountOf("lights"), "light"));
  const float huge = std::numeric_limits<float>::max();
  PunctualLight light;
  light.Name = this->NameOf(json, this->Out.Nodes[std::size_t(index)].Name);
  light.Node = index;
  const JsonValue typeValue = json.Get("type");
  const std::string& type = typeValue.String();
  if (type == "spot")
    light.Type = LightType::Spot;
  else if (type == "directional")
    light.Type = LightType::Directional;
  else if (type != "point")
    typeValue.Fail("unknown light type \"" + type + "\"", "use point, spot or directional");
  const float intensity = this->Clamped(json, "intensity", 1, 0, huge);
  light.Intensity = this->Color(json, "color", Vec3f(1), huge);
  for (int i = 0; i < 3; ++i)
    light.Intensity[i] = std::min(light.Intensity[i] * intensity, huge);
  if (json.Has("range"))
  {
    light.Range = json.Get("range").Float();
    if (!(light.Range > 0))
    {
      this->Warn(json.Get("range"), "the range must be positive; it is not limited", "correct it");
      light.Range = std::numeric_limits<float>::infinity();
    }
  }
  if (light.Type == LightType::Spot && json.Has("spot"))
  {
    const JsonValue spot = json.Get("spot");
    light.OuterCone = this->Clamped(spot, "outerConeAngle", light.OuterCone, 1e-4f, 1.57079633f);
    light.InnerCone = this->Clamped(spot, "innerConeAngle", 0, 0, light.OuterCone);
  }
  this->Out.Lights.push_back(light);
}

void GltfReader::ReadSkins()
{
  this->Drives = this->Reached;
  const std::size_t count = this->Root.CountOf("skins"), nodes = this->Out.Nodes.size();
  this->Out.Skins.resize(count);
  for (std::size_t i = 0; i < count; ++i)
  {
    const JsonValue json = this->Root.Get("skins").At(i);
    Skin& skin = this->Out.Skins[i];
    skin.Name = json.StringOr("name", "");
    const JsonValue joints = json.Get("joints");
    const std::size_t size = joints.Size();
    if (size == 0 || size > 65536) // JOINTS_n holds 16 bits at most
      joints.Fail("a skin has 1 to 65536 joints, found " + std::to_string(size), Reexport);
    for (std::size_t j = 0; j < size; ++j)
      skin.Joints.push_back(int(joints.At(j).Index(nodes, "node")));
    if (json.Has("skeleton"))
      skin.Skeleton = int(json.Get("skeleton").Index(nodes, "node"));
    skin.InverseBind.resize(size);
    if (!json.Has("inverseBindMatrices"))
      continue;
    const JsonValue where = json.Get("inverseBindMatrices");
    const GltfAccess::Array inverse = this->Access.Floats(where, "MAT4");
    if (inverse.Count < size)
      where.Fail(std::to_string(inverse.Count) + " matrices for " + std::to_string(size) + " joints", Reexport);
    for (std::size_t j = 0; j < size; ++j)
      for (std::size_t k = 0; k < 16; ++k)
        if (k % 4 != 3) // the last row is 0 0 0 1
        {
          const float v = inverse.Values[16 * j + k];
          if (!std::isfinite(v))
            where.Fail("the matrix of joint " + std::to_string(j) + " is not finite", Reexport);
          skin.InverseBind[j].m[k % 4][k / 4] = v;
        }
  }
}

/// Morph targets of a mesh: as many in each of its primitives (3.7.2.2).
std::size_t GltfReader::TargetsOf(const JsonValue& mesh) const
{
  const JsonValue primitives = mesh.Get("primitives");
  return primitives.Size() > 0 ? primitives.At(0).CountOf("targets") : 0;
}

void GltfReader::ReadWeights(const JsonValue& owner, std::size_t targets, std::vector<float>& weights)
{
  const JsonValue list = owner.Get("weights");
  const std::size_t size = list.Size();
  if (size != targets)
    this->Warn(list,
      std::to_string(size) + " weight(s) for " + std::to_string(targets) +
        " morph target(s); missing ones are 0, others ignored",
      Reexport);
  for (std::size_t t = 0; t < size; ++t)
  {
    const float w = list.At(t).Float();
    if (t < targets)
      weights[t] = w;
  }
}

void GltfReader::ReadMesh(const JsonValue& node, int index)
{
  const std::size_t m = node.Get("mesh").Index(this->Root.CountOf("meshes"), "mesh");
  const JsonValue mesh = this->Root.Get("meshes").At(m);
  const JsonValue primitives = mesh.Get("primitives");
  const std::size_t count = primitives.Size(), targets = this->TargetsOf(mesh);
  Node& placed = this->Out.Nodes[std::size_t(index)];
  placed.Weights.assign(targets, 0.f);
  for (const JsonValue* owner : { &mesh, &node })
    if (owner->Has("weights") && (targets > 0 || owner == &mesh))
      this->ReadWeights(*owner, targets, placed.Weights);
  if (node.Has("skin"))
    placed.Skin = int(node.Get("skin").Index(this->Out.Skins.size(), "skin"));
  bool jointed = false;
  for (std::size_t p = 0; p < count; ++p)
  {
    const JsonValue primitive = primitives.At(p);
    if (primitive.CountOf("targets") != targets)
      primitive.Fail("the primitive has " + std::to_string(primitive.CountOf("targets")) +
                       " morph target(s), the first one of the mesh has " + std::to_string(targets),
        Reexport);
    const auto key = std::make_pair(m, p);
    const auto found = this->MeshCache.find(key);
    const int at = found != this->MeshCache.end() ? found->second : this->ReadPrimitive(primitive, mesh, index);
    this->MeshCache[key] = at;
    if (at < 0)
      continue;
    if (placed.Skin >= 0 && this->Out.Meshes[std::size_t(at)].Influences > 0)
    {
      this->CheckJoints(primitive, at, this->Out.Skins[std::size_t(placed.Skin)]);
      jointed = true;
    }
    SceneMemory::Take(BytesPerInstance);
    this->Out.Instances.push_back({ at, index, 0 });
  }
  if (placed.Skin >= 0 && !jointed && count > 0)
    this->Warn(node.Get("skin"),
      "the skin moves nothing: mesh \"" + this->NameOf(mesh, placed.Name) + "\" has no joints and weights",
      "export the mesh with JOINTS_0 and WEIGHTS_0");
  if (jointed)
    for (int joint : this->Out.Skins[std::size_t(placed.Skin)].Joints)
      for (; joint >= 0 && !this->Drives[std::size_t(joint)]; joint = this->Out.Nodes[std::size_t(joint)].Parent)
        this->Drives[std::size_t(joint)] = 1;
}

/// A mesh may be used with several skins, each of which must have all of its joints.
void GltfReader::CheckJoints(const JsonValue& primitive, int mesh, const Skin& skin)
{
  const auto& largest = this->LargestJoint[mesh];
  if (largest.first >= skin.Joints.size())
    primitive.Get("attributes")
      .Get(largest.second.c_str())
      .Fail("joint " + std::to_string(largest.first) + " does not exist (the skin has " +
              std::to_string(skin.Joints.size()) + ")",
        Reexport);
}

/// EXT_mesh_gpu_instancing: the node's instances move to new children, one per place.
void GltfReader::MultiplyInstances(const JsonValue& node, int index, std::size_t before, int& id)
{
  const JsonValue extension = node.Extension("EXT_mesh_gpu_instancing");
  const JsonValue attributes = extension.Get("attributes");
  if (this->Out.Nodes[std::size_t(index)].Skin >= 0)
  {
    this->Warn(extension, "instances of a skinned mesh are all at the same place; one is shown", Reexport);
    return;
  }
  static const char* const keys[3] = { "TRANSLATION", "ROTATION", "SCALE" };
  GltfAccess::Array lists[3];
  std::size_t count = 0;
  for (int k = 0; k < 3; ++k)
  {
    if (!attributes.Has(keys[k]))
      continue;
    const JsonValue where = attributes.Get(keys[k]);
    lists[k] = this->Access.Floats(where, k == 1 ? "VEC4" : "VEC3");
    if (count > 0 && lists[k].Count != count)
      where.Fail(
        "the attribute has " + std::to_string(lists[k].Count) + " elements, others have " + std::to_string(count),
        Reexport);
    count = lists[k].Count;
    for (std::size_t i = 0; i < lists[k].Values.size(); ++i)
      if (!std::isfinite(lists[k].Values[i]))
        where.Fail("value " + std::to_string(i) + " is not finite", Reexport);
  }
  if (count == 0)
  {
    this->Warn(extension, "the extension places nothing and is ignored", Reexport);
    return;
  }
  const std::vector<Instance> originals(
    this->Out.Instances.begin() + std::ptrdiff_t(before), this->Out.Instances.end());
  SceneMemory::Take(std::uint64_t(count) *
                    (sizeof(Node) + sizeof(int) + this->Out.Nodes[std::size_t(index)].Weights.size() * sizeof(float) +
                      originals.size() * BytesPerInstance));
  this->Out.Instances.resize(before);
  const int first = int(this->Out.Nodes.size());
  --id;
  for (std::size_t i = 0; i < count; ++i)
  {
    Node child;
    child.Name = this->Out.Nodes[std::size_t(index)].Name;
    child.Weights = this->Out.Nodes[std::size_t(index)].Weights;
    child.Parent = index;
    if (lists[0].Count > 0)
      child.Translation = { lists[0].Values[3 * i], lists[0].Values[3 * i + 1], lists[0].Values[3 * i + 2] };
    for (std::size_t k = 0; k < 4 && lists[1].Count > 0; ++k)
      child.Rotation[k] = lists[1].Values[4 * i + k];
    if (lists[2].Count > 0)
      child.Scale = { lists[2].Values[3 * i], lists[2].Values[3 * i + 1], lists[2].Values[3 * i + 2] };
    ++id;
    for (const Instance& original : originals)
      this->Out.Instances.push_back({ original.Mesh, first + int(i), id });
    this->Out.Nodes[std::size_t(index)].Children.push_back(first + int(i));
    this->Out.Nodes.push_back(std::move(child));
  }
  this->Multiplied[index] = { first, first + int(count) };
}

int GltfReader::ReadPrimitive(const JsonValue& primitive, const JsonValue& mesh, int index)
{
  const std::uint64_t mode = primitive.UnsignedOr("mode", 4);
  if (mode > 6)
    primitive.Get("mode").Fail("primitive mode " + std::to_string(mode) + " does not exist", "use 0 to 6");
  if (mode < 4)
  {
    this->Warn(
      primitive, mode == 0 ? "points are not rendered" : "lines are not rendered", "convert them to triangles");
    return -1;
  }
  const JsonValue attributes = primitive.Get("attributes");
  if (!attributes.Has("POSITION"))
  {
    this->Warn(primitive, "the primitive has no POSITION and is skipped", "export the file with positions");
    return -1;
  }
  if (primitive.HasExtension("KHR_draco_mesh_compression") && !this->Access.HasData(attributes.Get("POSITION")))
    primitive.Fail("the vertices exist only as KHR_draco_mesh_compression, which is not supported",
      "export the file without mesh compression");
  Mesh out;
  out.Name = this->NameOf(mesh, this->Out.Nodes[std::size_t(index)].Name);
  const GltfAccess::Array positions = this->Access.Floats(attributes.Get("POSITION"), "VEC3");
  const std::size_t n = positions.Count;
  const auto same = [&](const char* key, const GltfAccess::Array& array)
  {
    if (array.Count != n)
      attributes.Get(key).Fail(
        "the attribute has " + std::to_string(array.Count) + " elements, POSITION has " + std::to_string(n), Reexport);
  };
  const auto vectors = [](const GltfAccess::Array& array)
  {
    std::vector<Vec3f> v(array.Count);
    for (std::size_t i = 0; i < v.size(); ++i)
      v[i] = { array.Values[3 * i], array.Values[3 * i + 1], array.Values[3 * i + 2] };
    return v;
  };
  out.Positions = vectors(positions);
  if (attributes.Has("NORMAL"))
  {
    const GltfAccess::Array a = this->Access.Floats(attributes.Get("NORMAL"), "VEC3");
    same("NORMAL", a);
    out.Normals = vectors(a);
  }
  if (attributes.Has("TANGENT") && !out.Normals.empty()) // without normals tangents are to be ignored (3.7.2.1)
  {
    const GltfAccess::Array a = this->Access.Floats(attributes.Get("TANGENT"), "VEC4");
    same("TANGENT", a);
    out.Tangents.resize(n);
    for (std::size_t i = 0; i < n; ++i)
      out.Tangents[i] = { a.Values[4 * i], a.Values[4 * i + 1], a.Values[4 * i + 2], a.Values[4 * i + 3] };
  }
  for (int set = 0; set < 2; ++set)
  {
    const char* key = set == 0 ? "TEXCOORD_0" : "TEXCOORD_1";
    if (!attributes.Has(key))
      continue;
    const GltfAccess::Array a = this->Access.Floats(attributes.Get(key), "VEC2");
    same(key, a);
    out.TexCoords[set].resize(n);
    for (std::size_t i = 0; i < n; ++i)
      out.TexCoords[set][i] = { a.Values[2 * i], a.Values[2 * i + 1] };
  }
  if (attributes.Has("COLOR_0"))
  {
    const GltfAccess::Array a = this->Access.Floats(attributes.Get("COLOR_0"), "VEC3 VEC4", true);
    same("COLOR_0", a);
    out.Colors.resize(n);
    const std::size_t c = std::size_t(a.Components);
    for (std::size_t i = 0; i < n; ++i)
      out.Colors[i] = { a.Values[c * i], a.Values[c * i + 1], a.Values[c * i + 2], c == 4 ? a.Values[c * i + 3] : 1.f };
  }

  std::vector<std::uint32_t> list;
  if (primitive.Has("indices"))
  {
    list = this->Access.Integers(primitive.Get("indices"), "SCALAR");
    for (std::size_t i = 0; i < list.size(); ++i)
      if (list[i] >= n)
        primitive.Get("indices").Fail("index " + std::to_string(list[i]) + " at place " + std::to_string(i) +
                                        " lies outside the " + std::to_string(n) + " vertices",
          Reexport);
  }
  else
  {
    list.resize(n);
    for (std::size_t i = 0; i < n; ++i)
      list[i] = std::uint32_t(i);
  }
  SceneMemory::Take(3 * list.size() * sizeof(std::uint32_t));
  if (mode == 4)
  {
    if (list.size() % 3 != 0)
      this->Warn(primitive, "the number of indices is no multiple of 3; the rest is ignored", Reexport);
    list.resize(list.size() / 3 * 3);
    out.Indices.swap(list);
  }
  else if (list.size() < 3)
    this->Warn(primitive, "a strip or fan needs three vertices; the primitive is empty", Reexport);
  else
    for (std::size_t i = 0; i + 2 < list.size(); ++i)
    {
      // glTF 3.7.2.1: strips keep their winding by swapping every other triangle; fans turn about the first vertex.
      const std::size_t a = mode == 5 ? i : i + 1, b = mode == 5 ? i + 1 + i % 2 : i + 2,
                        c = mode == 5 ? i + 2 - i % 2 : 0;
      for (const std::size_t k : { a, b, c })
        out.Indices.push_back(list[k]);
    }

  const std::string who = primitive.Where() + (out.Name.empty() ? "" : " \"" + out.Name + "\"");
  this->ReadInfluences(attributes, who, out);
  this->ReadTargets(primitive, who, out);
  const Material plain;
  const bool has = primitive.Has("material");
  CleanMesh(this->Out, out, primitive.Where(),
    has ? this->Out.Materials[primitive.Get("material").Index(this->TexturesResolved.size(), "material")] : plain,
    this->Faults);
  if (out.Indices.empty())
  {
    this->LargestJoint.erase(int(this->Out.Meshes.size()));
    return -1;
  }
  out.Material = this->UsedMaterial(primitive);
  this->Out.Meshes.push_back(std::move(out));
  return int(this->Out.Meshes.size()) - 1;
}

/// JOINTS_n and WEIGHTS_n. Joints of no weight become 0; which joints exist is checked with the skin.
void GltfReader::ReadInfluences(const JsonValue& attributes, const std::string& who, Mesh& out)
{
  const std::size_t n = out.Positions.size();
  std::vector<std::uint32_t> joints[2];
  GltfAccess::Array weights[2];
  std::size_t sets = 0;
  const char* const jointKeys[3] = { "JOINTS_0", "JOINTS_1", "JOINTS_2" };
  const char* const weightKeys[3] = { "WEIGHTS_0", "WEIGHTS_1", "WEIGHTS_2" };
  for (; sets < 2; ++sets)
  {
    const char *jointKey = jointKeys[sets], *weightKey = weightKeys[sets];
    if (attributes.Has(jointKey) != attributes.Has(weightKey))
      detail::Warn(this->Out, who,
        std::string(attributes.Has(jointKey) ? jointKey : weightKey) + " without " +
          (attributes.Has(jointKey) ? weightKey : jointKey) + " is ignored",
        Reexport);
    if (!attributes.Has(jointKey) || !attributes.Has(weightKey))
      break;
    joints[sets] = this->Access.Integers(attributes.Get(jointKey), "VEC4");
    weights[sets] = this->Access.Floats(attributes.Get(weightKey), "VEC4", true);
    if (joints[sets].size() != 4 * n)
      attributes.Get(jointKey).Fail(
        "the attribute has " + std::to_string(joints[sets].size() / 4) + " elements, POSITION has " + std::to_string(n),
        Reexport);
    if (weights[sets].Count != n)
      attributes.Get(weightKey).Fail(
        "the attribute has " + std::to_string(weights[sets].Count) + " elements, POSITION has " + std::to_string(n),
        Reexport);
  }
  if (sets == 0)
    return;
  if (attributes.Has(jointKeys[2]))
    detail::Warn(
      this->Out, who, "more than eight joints per vertex; the others are ignored", "export with eight joints");
  out.Influences = int(4 * sets);
  out.Joints.assign(4 * sets * n, 0);
  out.JointWeights.assign(4 * sets * n, 0.f);
  std::size_t unusable = 0, idle = 0, unbalanced = 0;
  auto& largest = this->LargestJoint[int(this->Out.Meshes.size())];
  largest = { 0, jointKeys[0] };
  for (std::size_t i = 0; i < n; ++i)
  {
    double sum = 0;
    float* to = &out.JointWeights[4 * sets * i];
    std::uint16_t* joint = &out.Joints[4 * sets * i];
    for (std::size_t k = 0; k < 4 * sets; ++k)
    {
      const float w = weights[k / 4].Values[4 * i + k % 4];
      const bool ok = w >= 0 && std::isfinite(w);
      unusable += !ok;
      if (!ok || w == 0)
        continue;
      const std::uint32_t j = joints[k / 4][4 * i + k % 4];
      if (j > largest.first)
        largest = { j, jointKeys[k / 4] };
      to[k] = w;
      joint[k] = std::uint16_t(j); // one that does not fit is not among the skin's 65536
      sum += double(w);
    }
    if (!(sum > 0))
    {
      ++idle;
      to[0] = 1;
      joint[0] = 0;
      continue;
    }
    unbalanced += std::fabs(sum - 1) > 0.02; // rounded bytes are off by 4 / 255 at most
    for (std::size_t k = 0; k < 4 * sets; ++k)
      to[k] = float(double(to[k]) / sum);
  }
  const char* const remedy = "normalise the weights in the program that made the mesh";
  if (unusable > 0)
    detail::Warn(this->Out, who, std::to_string(unusable) + " joint weight(s) negative or not finite became 0", remedy);
  if (idle > 0)
    detail::Warn(this->Out, who,
      std::to_string(idle) + " vertices have no joint weight and follow the first joint of the skin", remedy);
  if (unbalanced > 0)
    detail::Warn(this->Out, who,
      "the joint weights of " + std::to_string(unbalanced) + " vertices do not sum to 1; they are scaled", remedy);
}

void GltfReader::ReadTargets(const JsonValue& primitive, const std::string& who, Mesh& out)
{
  const std::size_t count = primitive.CountOf("targets"), n = out.Positions.size();
  std::size_t unusable = 0;
  out.Targets.resize(count);
  for (std::size_t t = 0; t < count; ++t)
  {
    const JsonValue target = primitive.Get("targets").At(t);
    const struct
    {
      const char* Key;
      bool Used;
      std::vector<Vec3f>& List;
    } attributes[] = { { "POSITION", true, out.Targets[t].Positions },
      { "NORMAL", !out.Normals.empty(), out.Targets[t].Normals },
      { "TANGENT", !out.Tangents.empty(), out.Targets[t].Tangents } };
    for (const auto& attribute : attributes)
    {
      if (!target.Has(attribute.Key))
        continue;
      const JsonValue where = target.Get(attribute.Key);
      const GltfAccess::Array a = this->Access.Floats(where, "VEC3");
      if (a.Count != n)
        where.Fail(
          "the morph target has " + std::to_string(a.Count) + " elements, POSITION has " + std::to_string(n), Reexport);
      if (!attribute.Used)
        continue;
      bool any = false;
      attribute.List.resize(n);
      for (std::size_t i = 0; i < n; ++i)
        for (int c = 0; c < 3; ++c)
        {
          const float v = a.Values[3 * i + std::size_t(c)];
          const bool ok = std::isfinite(v);
          unusable += !ok;
          attribute.List[i][c] = ok ? v : 0;
          any = any || (ok && v != 0);
        }
      if (!any)
        std::vector<Vec3f>().swap(attribute.List);
    }
  }
  if (unusable > 0)
    detail::Warn(this->Out, who, std::to_string(unusable) + " value(s) of morph targets are not finite and became 0",
      "repair the mesh in the program that made it");
}

bool GltfReader::ReadChannel(const JsonValue& animation, const JsonValue& channel, AnimationChannel& out)
{
  const JsonValue target = channel.Get("target");
  const JsonValue samplers = animation.Get("samplers");
  const JsonValue sampler = samplers.At(channel.Get("sampler").Index(samplers.Size(), "animation sampler"));
  const std::string path = target.Get("path").String();
  if (!target.Has("node"))
    return false; // to be ignored, says the specification; CheckHeader warns of KHR_animation_pointer
  out.Node = int(target.Get("node").Index(this->Reached.size(), "node"));
  std::size_t width = path == "rotation" ? 4 : 3;
  if (path == "weights")
  {
    const JsonValue node = this->Root.Get("nodes").At(std::size_t(out.Node));
    width =
      node.Has("mesh")
        ? this->TargetsOf(this->Root.Get("meshes").At(node.Get("mesh").Index(this->Root.CountOf("meshes"), "mesh")))
        : 0;
    if (width == 0)
    {
      this->Warn(target.Get("node"), "morph weights of a node without morph targets are animated; ignored", Reexport);
      return false;
    }
    out.Path = AnimatedPath::Weights;
  }
  else if (path == "translation")
    out.Path = AnimatedPath::Translation;
  else if (path == "rotation")
    out.Path = AnimatedPath::Rotation;
  else if (path == "scale")
    out.Path = AnimatedPath::Scale;
  else
  {
    this->Warn(target.Get("path"), "animation of \"" + path + "\" is not supported and ignored", "");
    return false;
  }
  if (out.Path != AnimatedPath::Weights && this->Out.Nodes[std::size_t(out.Node)].HasMatrix)
  {
    this->Warn(target.Get("node"), "the animated node has a matrix; the channel is ignored",
      "give the node translation, rotation and scale");
    return false;
  }
  const std::string mode = sampler.StringOr("interpolation", "LINEAR");
  if (mode == "STEP")
    out.Mode = Interpolation::Step;
  else if (mode == "CUBICSPLINE")
    out.Mode = Interpolation::CubicSpline;
  else if (mode != "LINEAR")
    sampler.Get("interpolation").Fail("unknown interpolation \"" + mode + "\"", "use LINEAR, STEP or CUBICSPLINE");
  GltfAccess::Array input = this->Access.Floats(sampler.Get("input"), "SCALAR");
  const bool weights = out.Path == AnimatedPath::Weights;
  GltfAccess::Array output = this->Access.Floats(sampler.Get("output"), weights      ? "SCALAR"
                                                                        : width == 4 ? "VEC4"
                                                                                     : "VEC3");
  const std::size_t expected = input.Count * (out.Mode == Interpolation::CubicSpline ? 3 : 1) * (weights ? width : 1);
  if (output.Count != expected)
    sampler.Get("output").Fail(std::to_string(output.Count) + " values for " + std::to_string(input.Count) + " times" +
                                 (weights ? " and " + std::to_string(width) + " morph target(s)" : "") + " where " +
                                 std::to_string(expected) + " are expected",
      Reexport);
  for (std::size_t i = 0; i < input.Count; ++i)
    if (!std::isfinite(input.Values[i]) || (i > 0 && input.Values[i] < input.Values[i - 1]))
      sampler.Get("input").Fail("the times do not ascend at key " + std::to_string(i), Reexport);
  for (std::size_t i = 0; i < output.Values.size(); ++i)
    if (!std::isfinite(output.Values[i]))
      sampler.Get("output").Fail("value " + std::to_string(i) + " is not finite", Reexport);
  out.Times.swap(input.Values);
  out.Values.swap(output.Values);
  return true;
}

std::size_t GltfReader::FindAnimation(const std::string& name) const
{
  const std::size_t count = this->Root.CountOf("animations");
  std::string known;
  for (std::size_t a = 0; a < count; ++a)
  {
    const std::string one = this->Root.Get("animations").At(a).StringOr("name", "");
    if (one == name)
      return a;
    known += (a > 0 ? ", " : "") + std::to_string(a) + (one.empty() ? "" : " \"" + one + "\"");
  }
  std::size_t index = 0;
  const char* const end = name.data() + name.size();
  const auto parsed = std::from_chars(name.data(), end, index);
  if (parsed.ec == std::errc() && parsed.ptr == end && index < count)
    return index;
  Fail(this->Out.File, "", "no animation \"" + name + "\"; the scene has " + (count > 0 ? known : "none"),
    "name one of them, or none to play all that move different things");
}

/// Clips that move different things play together; a clip that would move what an earlier one moves is left out.
void GltfReader::ReadAnimations()
{
  const std::size_t count = this->Root.CountOf("animations");
  std::vector<std::pair<int, AnimatedPath>> taken;
  std::vector<AnimationChannel> all;
  const bool one = !this->Animation.empty();
  const std::size_t first = one ? this->FindAnimation(this->Animation) : 0;
  for (std::size_t a = first; a < (one ? first + 1 : count); ++a)
  {
    const JsonValue animation = this->Root.Get("animations").At(a);
    const std::size_t channels = animation.Get("channels").Size();
    std::vector<AnimationChannel> clip;
    bool clash = false;
    for (std::size_t c = 0; c < channels; ++c)
    {
      AnimationChannel channel;
      if (!this->ReadChannel(animation, animation.Get("channels").At(c), channel))
        continue;
      clash = clash || std::binary_search(taken.begin(), taken.end(), std::make_pair(channel.Node, channel.Path));
      clip.push_back(std::move(channel));
    }
    if (clash)
    {
      this->Warn(animation,
        "the animation \"" + animation.StringOr("name", "") + "\" moves what an earlier one moves and is left out",
        "choose the clip to play (Animation), or keep one of them in the file");
      continue;
    }
    for (AnimationChannel& channel : clip)
    {
      taken.emplace_back(channel.Node, channel.Path);
      all.push_back(std::move(channel));
    }
    std::sort(taken.begin(), taken.end());
  }
  // Channels of nodes that are not shown would only make a static scene look animated; ancestors are
  // shown too, and joints elsewhere place what is shown.
  for (AnimationChannel& channel : all)
  {
    if (!this->Drives[std::size_t(channel.Node)])
      continue;
    const auto multiplied = this->Multiplied.find(channel.Node);
    if (channel.Path == AnimatedPath::Weights && multiplied != this->Multiplied.end())
      for (int child = multiplied->second.first; child < multiplied->second.second; ++child)
      {
        SceneMemory::Take((channel.Times.size() + channel.Values.size()) * sizeof(float));
        this->Out.Animation.push_back(channel);
        this->Out.Animation.back().Node = child;
      }
    this->Out.Animation.push_back(std::move(channel));
  }
}
}

void ReadGltf(Scene& scene, const Bytes& content, ContentHash& hash, const std::string& animation)
{
  const GltfContainer container = OpenGltf(scene.File, content);
  GltfReader(scene, container, hash, animation).Read();
}
}
}
