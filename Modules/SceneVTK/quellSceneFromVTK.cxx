// SPDX-License-Identifier: BSD-3-Clause
#include "quellSceneFromVTK.h"

#include "quellVtkMaterial.h"
#include "quellVtkSurface.h"
#include "vtkActor.h"
#include "vtkAssemblyNode.h"
#include "vtkAssemblyPath.h"
#include "vtkCamera.h"
#include "vtkDataSet.h"
#include "vtkLight.h"
#include "vtkLightCollection.h"
#include "vtkMath.h"
#include "vtkMatrix4x4.h"
#include "vtkPropCollection.h"
#include "vtkProperty.h"
#include "vtkRenderWindow.h"
#include "vtkRenderer.h"
#include "vtkTexture.h"
#include "vtkWeakPointer.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <map>
#include <set>

namespace quell
{
namespace
{
constexpr double Pi = 3.14159265358979323846;

Mat4 From(vtkMatrix4x4* matrix)
{
  Mat4 m;
  if (matrix)
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        m.m[i][j] = matrix->GetElement(i, j);
  return m;
}

Mat4 Moved(const Vec3d& by)
{
  Mat4 m;
  for (int i = 0; i < 3; ++i)
    m.m[i][3] = by[i];
  return m;
}

bool Same(const Mat4& a, const Mat4& b)
{
  return std::memcmp(a.m, b.m, sizeof a.m) == 0;
}
bool Finite(const Mat4& m)
{
  for (const auto& row : m.m)
    for (const double v : row)
      if (!std::isfinite(v))
        return false;
  return true;
}

/// Pose at `from` whose -z axis points at `to`.
Mat4 Aimed(const Vec3d& from, const Vec3d& to)
{
  Vec3d back = Normalized(from - to);
  if (back == Vec3d())
    back = { 0, 0, 1 };
  const Vec3d right = Normalized(Cross(std::fabs(back.y) < 0.9 ? Vec3d(0, 1, 0) : Vec3d(1, 0, 0), back));
  const Vec3d up = Cross(back, right);
  Mat4 m = Moved(from);
  for (int i = 0; i < 3; ++i)
  {
    m.m[i][0] = right[i];
    m.m[i][1] = up[i];
    m.m[i][2] = back[i];
  }
  return m;
}

void QuaternionOf(const double r[3][3], double out[4])
{
  double q[4];
  vtkMath::Matrix3x3ToQuaternion(r, q); // w x y z
  out[0] = q[1];
  out[1] = q[2];
  out[2] = q[3];
  out[3] = q[0];
}

/// FNV-1a over whole words: says that two scenes differ, not more.
class Digest
{
public:
  void Add(const void* data, std::size_t size)
  {
    const char* p = static_cast<const char*>(data);
    for (; size >= 8; size -= 8, p += 8)
    {
      std::uint64_t word;
      std::memcpy(&word, p, 8);
      this->Mix(word);
    }
    std::uint64_t rest = size;
    std::memcpy(&rest, p, size);
    this->Mix(rest);
  }
  template <class T>
  void Add(const std::vector<T>& v)
  {
    const std::size_t n = v.size();
    this->Add(&n, sizeof n);
    if (n > 0)
      this->Add(v.data(), n * sizeof(T));
  }
  std::string Hexadecimal() const
  {
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(this->State));
    return text;
  }

private:
  void Mix(std::uint64_t word)
  {
    this->State = (this->State ^ word) * 1099511628211ull;
    this->State ^= this->State >> 29;
  }
  std::uint64_t State = 14695981039346656037ull;
};
}

struct SceneRecorder::Internals
{
  /// An object of one frame, as the next frame needs to know it.
  struct Kept
  {
    Mat4 Pose;
    int Mesh = -1;
    Vec3d Offset;
  };
  struct Identity
  {
    vtkWeakPointer<vtkObject> Owner;
    bool Owned = false;
    int Id = 0;
  };

  std::shared_ptr<Scene> Building;
  std::unique_ptr<detail::MaterialWriter> Materials;
  std::map<std::string, int> KnownMaterials; ///< of this frame
  std::set<std::string> Names;               ///< of data, in this frame
  std::map<std::string, Kept> Current, Previous;
  std::shared_ptr<const Scene> CurrentScene, PreviousScene;
  std::map<std::string, Identity> Identities;
  int NextId = 1;
  int Tick = 0;
  bool Recorded = false; ///< Current is the frame at Tick, finished
  float Times[2] = { 0, 0 };
  bool Moves = false;
  int Renderers = 0;

  void Warn(const std::string& text)
  {
    std::vector<std::string>& all = this->Building->Warnings;
    if (std::find(all.begin(), all.end(), text) == all.end())
      all.push_back(text);
  }

  int AddNode(const std::string& name, int parent)
  {
    const int index = int(this->Building->Nodes.size());
    this->Building->Nodes.emplace_back();
    this->Building->Nodes.back().Name = name;
    this->Building->Nodes.back().Parent = parent;
    if (parent >= 0)
      this->Building->Nodes[std::size_t(parent)].Children.push_back(index);
    return index;
  }

  void Animate(int node, AnimatedPath path, const std::vector<double>& before, const std::vector<double>& now)
  {
    AnimationChannel channel;
    channel.Node = node;
    channel.Path = path;
    channel.Times = { this->Times[0], this->Times[1] };
    for (const std::vector<double>* key : { &before, &now })
      for (const double v : *key)
        channel.Values.push_back(float(v));
    this->Building->Animation.push_back(std::move(channel));
  }

  /// A node at `now` that was at `before` (null: the same) one tick ago. The pose of this frame is exact; the way from
  /// the last one is kept in floats below it, relative to it, as T R V S V^T (polar decomposition).
  int Place(const std::string& name, const Mat4& now, const Mat4* before)
  {
    const int root = this->AddNode(name, -1);
    this->Building->Nodes[std::size_t(root)].HasMatrix = true;
    this->Building->Nodes[std::size_t(root)].Matrix = now;
    Mat4 inverse;
    if (!this->Moves || !before || Same(now, *before) || !Finite(*before) || !now.Inverse(inverse))
      return root;
    const Mat4 delta = inverse * *before;
    if (!Finite(delta))
      return root;
    double a[3][3], u[3][3], w[3], vt[3][3], v[3][3], r[3][3], q[4];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        a[i][j] = delta.m[i][j];
    vtkMath::SingularValueDecomposition3x3(a, u, w, vt);
    vtkMath::Multiply3x3(u, vt, r);
    vtkMath::Transpose3x3(vt, v);
    const int moved = this->AddNode(name, root);
    this->Animate(moved, AnimatedPath::Translation, { delta.m[0][3], delta.m[1][3], delta.m[2][3] }, { 0., 0., 0. });
    QuaternionOf(r, q);
    this->Animate(moved, AnimatedPath::Rotation, { q[0], q[1], q[2], q[3] }, { 0., 0., 0., 1. });
    bool rigid = true;
    for (const double s : w)
      rigid &= std::fabs(s - 1) < 1e-9;
    if (rigid)
      return moved;
    const int scaled = this->AddNode(name, moved), turned = this->AddNode(name, scaled);
    QuaternionOf(v, this->Building->Nodes[std::size_t(scaled)].Rotation);
    this->Animate(scaled, AnimatedPath::Scale, { w[0], w[1], w[2] }, { 1., 1., 1. });
    QuaternionOf(vt, this->Building->Nodes[std::size_t(turned)].Rotation);
    return turned;
  }

  int IdOf(const std::string& key, vtkObject* owner)
  {
    Identity& identity = this->Identities[key];
    // Another object at the address of one that is gone is another object.
    if (identity.Id == 0 || (identity.Owned && identity.Owner != owner))
    {
      identity.Id = this->NextId++;
      identity.Owner = owner;
      identity.Owned = owner != nullptr;
      this->Previous.erase(key);
    }
    return identity.Id;
  }

  void AddSurface(const std::string& key, vtkObject* owner, const std::string& name, const Mat4& pose,
    detail::Surface& surface, int material)
  {
    const int id = this->IdOf(key, owner);
    const auto found = this->Previous.find(key);
    const Kept* before = found == this->Previous.end() ? nullptr : &found->second;
    int node = this->Place(name, pose, before ? &before->Pose : nullptr);
    if (surface.Offset != Vec3d())
    {
      const int inner = this->AddNode(name, node);
      this->Building->Nodes[std::size_t(inner)].HasMatrix = true;
      this->Building->Nodes[std::size_t(inner)].Matrix = Moved(surface.Offset);
      node = inner;
    }
    Mesh& mesh = surface.Triangles;
    mesh.Name = name;
    mesh.Material = material;
    if (this->Moves && before && this->PreviousScene)
      this->Deform(mesh, surface.Offset, this->PreviousScene->Meshes[std::size_t(before->Mesh)], before->Offset, node);
    Instance instance;
    instance.Mesh = int(this->Building->Meshes.size());
    instance.Node = node;
    instance.Id = id;
    this->Current[key] = { pose, instance.Mesh, surface.Offset };
    this->Building->Meshes.push_back(std::move(mesh));
    this->Building->Instances.push_back(instance);
  }

  /// Points that moved while the triangles stayed: the frame before is a morph target.
  void Deform(Mesh& mesh, const Vec3d& offset, const Mesh& before, const Vec3d& offsetBefore, int node)
  {
    if (before.Positions.size() != mesh.Positions.size() || before.Indices != mesh.Indices)
      return;
    const Vec3d shift = offsetBefore - offset;
    MorphTarget target;
    target.Positions.resize(mesh.Positions.size());
    bool moves = false;
    for (std::size_t i = 0; i < mesh.Positions.size(); ++i)
    {
      const Vec3f d(Vec3d(before.Positions[i]) - Vec3d(mesh.Positions[i]) + shift);
      if (!IsFinite(d))
        return;
      target.Positions[i] = d;
      moves |= d != Vec3f();
    }
    if (!moves)
      return;
    if (before.Normals.size() == mesh.Normals.size())
      for (std::size_t i = 0; i < mesh.Normals.size(); ++i)
        target.Normals.push_back(before.Normals[i] - mesh.Normals[i]);
    mesh.Targets.push_back(std::move(target));
    this->Building->Nodes[std::size_t(node)].Weights = { 0 };
    this->Animate(node, AnimatedPath::Weights, { 1 }, { 0 });
  }

  /// All blocks of `data` as objects. True where at least one has a triangle.
  bool AddBlocks(const std::string& key, vtkObject* owner, const std::string& name, vtkDataObject* data,
    const DataMaterial& material, const std::string& materialKey, vtkMapper* mapper, const Mat4& pose,
    vtkCompositeDataDisplayAttributes* attributes)
  {
    bool any = false;
    std::vector<std::string> warnings;
    for (const detail::Block& block : detail::LeavesOf(data, attributes, name, warnings))
    {
      const std::string place = block.Name.empty() ? name : name + "/" + block.Name;
      DataMaterial own = material;
      vtkSmartPointer<vtkMapper> coloring = mapper;
      if (!coloring)
        coloring = detail::MapperFor(material, block.Data);
      std::string known = materialKey;
      if (block.Style.HasColor)
      {
        const double* c = block.Style.Color;
        own.DiffuseColor = own.AmbientColor = { c[0], c[1], c[2] };
        coloring = nullptr; // a block's colour goes before scalars
        known += " color " + std::to_string(c[0]) + " " + std::to_string(c[1]) + " " + std::to_string(c[2]);
      }
      if (block.Style.HasOpacity)
      {
        own.Opacity = block.Style.Opacity;
        known += " opacity " + std::to_string(own.Opacity);
      }
      if (own.Opacity <= 0)
        continue;
      detail::Surface surface;
      if (!detail::MakeSurface(block.Data, own, coloring, place, surface, warnings))
        continue;
      detail::Coloring colors;
      colors.Colored = surface.Colored;
      colors.SeeThrough = surface.SeeThrough;
      if (surface.HasColorMap)
      {
        colors.ColorMap = int(this->Building->Textures.size());
        colors.ColorMapSet = surface.ColorMapSet;
        this->Building->Textures.push_back(std::move(surface.ColorMap));
        known += " map " + std::to_string(colors.ColorMap);
      }
      known += colors.Colored ? colors.SeeThrough ? " scalars, see-through" : " scalars" : "";
      const auto entry = this->KnownMaterials.find(known);
      int index = entry == this->KnownMaterials.end() ? -1 : entry->second;
      if (index < 0)
      {
        if (own.Name.empty())
          own.Name = place;
        index = this->KnownMaterials[known] = this->Materials->Add(own, colors, place);
      }
      this->AddSurface(key + "#" + std::to_string(block.Number), owner, place, pose, surface, index);
      any = true;
    }
    for (const std::string& text : warnings)
      this->Warn(text);
    return any;
  }

  void AddActor(
    vtkActor* actor, const std::string& key, const std::string& name, const Mat4& pose, const RendererOptions& options);
  void AddLights(vtkRenderer* renderer, vtkCamera* camera, const RendererOptions& options);
  void AddLight(vtkLight* light, vtkCamera* camera, const std::string& name, const RendererOptions& options);
  void AddCamera(vtkRenderer* renderer, vtkCamera* camera, const std::string& key);
  void AddSky(vtkRenderer* renderer, const RendererOptions& options);
};

SceneRecorder::SceneRecorder()
  : Internal(new Internals)
{
}
SceneRecorder::~SceneRecorder() = default;

void SceneRecorder::Begin(int tick, double rate)
{
  Internals& in = *this->Internal;
  if (in.Recorded && tick != in.Tick)
  {
    const bool next = std::int64_t(tick) == std::int64_t(in.Tick) + 1;
    in.Previous.clear();
    if (next)
      in.Previous.swap(in.Current);
    in.PreviousScene = next ? in.CurrentScene : nullptr;
  }
  in.Current.clear();
  in.CurrentScene = nullptr;
  in.Recorded = false;
  in.Tick = tick;
  in.Building = std::make_shared<Scene>();
  in.Building->File = "VTK data";
  in.Materials.reset(new detail::MaterialWriter(*in.Building));
  in.KnownMaterials.clear();
  in.Names.clear();
  in.Renderers = 0;
  // Rounded inwards, so that both ticks lie at or beyond a key and read exactly its value.
  const double perSecond = rate > 0 && std::isfinite(rate) ? rate : 24;
  const double t0 = (tick - 1.) / perSecond, t1 = tick / perSecond;
  in.Times[0] = float(t0);
  if (double(in.Times[0]) < t0)
    in.Times[0] = std::nextafter(in.Times[0], std::numeric_limits<float>::infinity());
  in.Times[1] = float(t1);
  if (double(in.Times[1]) > t1)
    in.Times[1] = std::nextafter(in.Times[1], -std::numeric_limits<float>::infinity());
  in.Moves = in.Times[0] < in.Times[1];
  if (!in.Moves && !in.Previous.empty())
    in.Warn(
      "tick " + std::to_string(tick) + " is too late for motion: scene time in float no longer tells ticks apart");
}

void SceneRecorder::AddData(
  vtkDataObject* data, const DataMaterial& material, const std::string& name, const Mat4& pose)
{
  Internals& in = *this->Internal;
  if (!in.Building)
    this->Begin();
  if (!data)
    throw SceneError(name + ": no data (null); give it the output of a filter that was updated");
  std::string unique = name;
  for (int i = 2; !in.Names.insert(unique).second; ++i)
    unique = name + " " + std::to_string(i);
  const std::size_t before = in.Building->Warnings.size();
  if (!in.AddBlocks("data " + unique, nullptr, unique, data, material, "data " + unique, nullptr, pose, nullptr))
  {
    std::string why;
    for (std::size_t i = before; i < in.Building->Warnings.size(); ++i)
      why += "; " + in.Building->Warnings[i];
    throw SceneError(unique + ": no polygon in this " + data->GetClassName() + why);
  }
}

void SceneRecorder::Internals::AddActor(
  vtkActor* actor, const std::string& key, const std::string& name, const Mat4& pose, const RendererOptions& options)
{
  vtkMapper* mapper = actor->GetMapper();
  if (!mapper)
    return; // VTK draws nothing either
  vtkProperty* property = actor->GetProperty();
  if (property->GetRepresentation() != VTK_SURFACE)
  {
    this->Warn(name + ": left out: drawn as " + (property->GetRepresentation() == VTK_POINTS ? "points" : "wireframe"));
    return;
  }
  if (mapper->IsA("vtkGlyph3DMapper"))
  {
    this->Warn(name + ": left out: " + mapper->GetClassName() + "; vtkGlyph3D makes glyphs that have a surface");
    return;
  }
  if (property->GetOpacity() <= 0)
    return;
  if (!Finite(pose))
  {
    this->Warn(name + ": left out: its matrix is not finite");
    return;
  }
  if (mapper->GetNumberOfClippingPlanes() > 0)
    this->Warn(name + ": clipping planes of the mapper are not applied; vtkClipPolyData cuts the data");
  if (mapper->GetNumberOfInputConnections(0) > 0)
    mapper->Update();
  vtkDataObject* data = mapper->GetNumberOfInputConnections(0) > 0 ? mapper->GetInputDataObject(0, 0) : nullptr;
  if (!data)
  {
    this->Warn(name + ": left out: its mapper has no input");
    return;
  }
  DataMaterial material = MaterialFromProperty(property);
  material.DisplayColors = options.DisplayColors;
  material.AmbientEmits = options.AmbientEmits;
  if (actor->GetTexture() && !material.ColorTexture.Image)
  {
    material.ColorTexture = TextureFrom(actor->GetTexture());
    material.ColorTexture.SRGB = options.DisplayColors;
  }
  char materialKey[64];
  std::snprintf(materialKey, sizeof materialKey, "property %p texture %p", static_cast<void*>(property),
    static_cast<void*>(actor->GetTexture()));
  vtkCompositeDataDisplayAttributes* attributes = options.BlockAttributes ? options.BlockAttributes(mapper) : nullptr;
  this->AddBlocks(key, actor, name, data, material, materialKey, mapper, pose, attributes);
}

void SceneRecorder::Internals::AddLight(
  vtkLight* light, vtkCamera* camera, const std::string& name, const RendererOptions& options)
{
  double p[3], f[3];
  if (light->LightTypeIsHeadlight())
  {
    camera->GetPosition(p);
    camera->GetFocalPoint(f);
  }
  else if (light->LightTypeIsCameraLight())
  {
    const Mat4 toWorld = From(camera->GetCameraLightTransformMatrix());
    const double *lp = light->GetPosition(), *lf = light->GetFocalPoint();
    const Vec3d wp = toWorld.Point({ lp[0], lp[1], lp[2] }), wf = toWorld.Point({ lf[0], lf[1], lf[2] });
    for (int i = 0; i < 3; ++i)
    {
      p[i] = wp[i];
      f[i] = wf[i];
    }
  }
  else
  {
    light->GetTransformedPosition(p);
    light->GetTransformedFocalPoint(f);
  }
  const Vec3d position(p[0], p[1], p[2]), focus(f[0], f[1], f[2]);
  const double* color = light->GetDiffuseColor();
  const Vec3d linear = detail::LinearFromDisplay({ color[0], color[1], color[2] }, options.DisplayColors);
  double power = Pi * light->GetIntensity();
  PunctualLight out;
  out.Name = name;
  if (light->GetPositional())
  {
    const double* a = light->GetAttenuationValues();
    const double distance = Length(focus - position), d = distance > 0 ? distance : 1;
    const double attenuation = a[0] + a[1] * d + a[2] * d * d;
    power *= d * d / attenuation;
    out.Type = LightType::Point;
    if (light->GetConeAngle() < 90)
    {
      out.Type = LightType::Spot;
      double cone = light->GetConeAngle() * Pi / 180;
      out.InnerCone = float(cone);
      // glTF's falloff ((c - co) / (1 - co))^2 from the axis and c^n are both 1/2 at c = 0.5^(1/n).
      const double half = std::pow(0.5, 1 / std::max(light->GetExponent(), 1e-3)), root = std::sqrt(0.5);
      if (half > root)
      {
        cone = std::min(cone, std::acos((half - root) / (1 - root)));
        out.InnerCone = 0;
      }
      out.OuterCone = float(cone);
    }
  }
  else
    out.Type = LightType::Directional;
  out.Intensity = Vec3f(linear * power);
  if (!IsFinite(out.Intensity) || !IsFinite(position) || !IsFinite(focus) || power < 0)
  {
    this->Warn(name + ": left out: negative, not finite, or without attenuation");
    return;
  }
  if (!(MaxComponent(out.Intensity) > 0))
    return;
  out.Node = this->AddNode(name, -1);
  this->Building->Nodes.back().HasMatrix = true;
  this->Building->Nodes.back().Matrix = Aimed(position, focus);
  this->Building->Lights.push_back(out);
}

void SceneRecorder::Internals::AddLights(vtkRenderer* renderer, vtkCamera* camera, const RendererOptions& options)
{
  int index = 0, on = 0;
  vtkLightCollection* lights = renderer->GetLights();
  vtkCollectionSimpleIterator at;
  lights->InitTraversal(at);
  while (vtkLight* light = lights->GetNextLight(at))
  {
    const std::string name = "light " + std::to_string(index++);
    if (!light->GetSwitch())
      continue;
    ++on;
    this->AddLight(light, camera, name, options);
  }
  if (on == 0 && renderer->GetAutomaticLightCreation())
  {
    auto headlight = vtkSmartPointer<vtkLight>::New();
    headlight->SetLightTypeToHeadlight();
    this->AddLight(headlight, camera, "headlight", options);
  }
}

void SceneRecorder::Internals::AddCamera(vtkRenderer* renderer, vtkCamera* camera, const std::string& key)
{
  CameraModel model;
  model.Name = key;
  vtkMatrix4x4* view = camera->GetViewTransformMatrix();
  Mat4 pose;
  if (!view || !From(view).Inverse(pose) || !Finite(pose))
  {
    this->Warn("camera: its position, focal point and view-up give no view; the whole scene is framed");
    return;
  }
  const double* center = camera->GetWindowCenter();
  if (center[0] != 0 || center[1] != 0)
    this->Warn("camera: WindowCenter is not applied: the view is the one around its axis");
  if (camera->GetUseExplicitProjectionTransformMatrix())
    this->Warn("camera: the explicit projection matrix is not applied; ViewAngle and ParallelScale are");
  if (camera->GetViewShear()[0] != 0 || camera->GetViewShear()[1] != 0)
    this->Warn("camera: ViewShear is not applied");
  model.Orthographic = camera->GetParallelProjection() != 0;
  model.YMag = camera->GetParallelScale();
  model.YFov = camera->GetViewAngle() * Pi / 180;
  if (camera->GetUseHorizontalViewAngle())
  {
    const int* size = this->Building->Resolution;
    const double aspect = size[0] > 0 && size[1] > 0 ? double(size[0]) / size[1] : 1;
    model.YFov = 2 * std::atan(std::tan(model.YFov / 2) / aspect);
  }
  const auto found = this->Previous.find(key);
  model.Node = this->Place(key, pose, found == this->Previous.end() ? nullptr : &found->second.Pose);
  this->Current[key].Pose = pose;
  this->Building->Cameras.push_back(model);
}

void SceneRecorder::Internals::AddSky(vtkRenderer* renderer, const RendererOptions& options)
{
  Scene& scene = *this->Building;
  vtkTexture* map = renderer->GetUseImageBasedLighting() ? renderer->GetEnvironmentTexture() : nullptr;
  if (map)
  {
    Texture from;
    std::string reason = "is a cube map; give the renderer a latitude-longitude image";
    const DataTexture texture = map->GetCubeMap() ? DataTexture() : TextureFrom(map);
    if (texture.Image && detail::ToTexture(texture.Image, texture.SRGB, from, reason))
    {
      // VTK: u = atan2(z, x) / 2 pi + 1/2, v = asin(y) / pi + 1/2 of the direction in (right, up, right x up).
      const double *r = renderer->GetEnvironmentRight(), *u = renderer->GetEnvironmentUp();
      const Vec3d right(r[0], r[1], r[2]), up(u[0], u[1], u[2]), front = Cross(right, up);
      from.WrapS = Wrap::Repeat;
      from.WrapT = Wrap::Clamp;
      Texture sky;
      sky.Name = "environment";
      sky.Width = from.Width;
      sky.Height = from.Height;
      sky.Floats.resize(4 * std::size_t(sky.Width) * std::size_t(sky.Height));
      for (int y = 0; y < sky.Height; ++y)
        for (int x = 0; x < sky.Width; ++x)
        {
          const double phi = 2 * Pi * ((x + 0.5) / sky.Width - 0.5), theta = Pi * (y + 0.5) / sky.Height;
          const Vec3d d(std::sin(phi) * std::sin(theta), std::cos(theta), -std::cos(phi) * std::sin(theta));
          const double height = std::max(-1., std::min(1., Dot(up, d)));
          const Vec4f c = from.Sample(
            float(std::atan2(Dot(front, d), Dot(right, d)) / (2 * Pi) + 0.5), float(0.5 - std::asin(height) / Pi));
          float* to = &sky.Floats[4 * (std::size_t(y) * std::size_t(sky.Width) + std::size_t(x))];
          to[0] = std::max(0.f, c.x);
          to[1] = std::max(0.f, c.y);
          to[2] = std::max(0.f, c.z);
          to[3] = 1;
        }
      scene.Sky.Present = true;
      scene.Sky.Color = { 1, 1, 1 };
      scene.Sky.Texture = int(scene.Textures.size());
      scene.Textures.push_back(std::move(sky));
      return;
    }
    this->Warn("environment texture " + (map->GetCubeMap() || texture.Image ? reason : "has no input") + "; left out");
  }
  if (options.Background != RendererOptions::Backdrop::Sky)
    return;
  const auto color = [&](const double* c) {
    return detail::LinearFromDisplay({ c[0], c[1], c[2] }, options.DisplayColors);
  };
  const Vec3d bottom = color(renderer->GetBackground()), top = color(renderer->GetBackground2());
  scene.Sky.Present = true;
  scene.Sky.Color = Vec3f(bottom);
  if (!renderer->GetGradientBackground())
    return;
  Texture sky;
  sky.Name = "background";
  sky.Width = 4;
  sky.Height = 64;
  sky.WrapT = Wrap::Clamp;
  for (int y = 0; y < sky.Height; ++y)
  {
    const double t = 1 - (y + 0.5) / sky.Height;
    const Vec3f c(bottom * (1 - t) + top * t);
    for (int x = 0; x < sky.Width; ++x)
      sky.Floats.insert(sky.Floats.end(), { c.x, c.y, c.z, 1.f });
  }
  scene.Sky.Color = { 1, 1, 1 };
  scene.Sky.Texture = int(scene.Textures.size());
  scene.Textures.push_back(std::move(sky));
}

void SceneRecorder::AddRenderer(vtkRenderer* renderer, const RendererOptions& options)
{
  Internals& in = *this->Internal;
  if (!in.Building)
    this->Begin();
  if (!renderer)
    throw SceneError("renderer: null");
  const std::string prefix = in.Renderers > 0 ? "renderer " + std::to_string(in.Renderers + 1) + " " : "";
  ++in.Renderers;
  int* size = in.Building->Resolution;
  if (options.Width > 0 && options.Height > 0)
  {
    size[0] = options.Width;
    size[1] = options.Height;
  }
  else if (vtkWindow* window = renderer->GetVTKWindow())
  {
    const int* whole = window->GetSize();
    const double* part = renderer->GetViewport();
    for (int i = 0; i < 2; ++i)
      size[i] = int(std::lround(whole[i] * std::max(0., std::min(1., part[i + 2] - part[i]))));
  }

  int index = 0;
  vtkPropCollection* props = renderer->GetViewProps();
  vtkCollectionSimpleIterator at;
  props->InitTraversal(at);
  while (vtkProp* prop = props->GetNextProp(at))
  {
    const std::string name = prefix + "actor " + std::to_string(index++);
    if (!prop->GetVisibility())
      continue;
    char address[32];
    std::snprintf(address, sizeof address, "%p", static_cast<void*>(prop));
    const std::string key = prefix + address;
    int part = 0;
    prop->InitPathTraversal();
    while (vtkAssemblyPath* path = prop->GetNextPath())
    {
      vtkAssemblyNode* node = path->GetLastNode();
      vtkProp* leaf = node ? node->GetViewProp() : nullptr;
      const int number = part++;
      const std::string own = leaf == prop ? name : name + "/part " + std::to_string(number);
      if (!leaf || !leaf->GetVisibility())
        continue;
      auto actor = vtkActor::SafeDownCast(leaf);
      if (!actor || actor->IsA("vtkSkybox"))
      {
        in.Warn(own + " (" + leaf->GetClassName() + "): left out: it has no surface to trace");
        continue;
      }
      vtkMatrix4x4* matrix = node->GetMatrix();
      in.AddActor(actor, leaf == prop ? key : key + "/" + std::to_string(number), own,
        From(matrix ? matrix : actor->GetMatrix()), options);
    }
  }
  // After the actors are updated: as VTK's first rendering does, a camera is made that sees all of them.
  const bool hasCamera = renderer->IsActiveCameraCreated() != 0;
  vtkCamera* camera = renderer->GetActiveCamera();
  if (!hasCamera)
    renderer->ResetCamera();
  if (options.Lights)
    in.AddLights(renderer, camera, options);
  in.AddCamera(renderer, camera, prefix + "camera");
  in.AddSky(renderer, options);
}

std::shared_ptr<const Scene> SceneRecorder::Finish()
{
  Internals& in = *this->Internal;
  if (!in.Building)
    this->Begin();
  Scene& scene = *in.Building;
  Digest digest;
  for (const Mesh& mesh : scene.Meshes)
  {
    digest.Add(mesh.Positions);
    digest.Add(mesh.Normals);
    digest.Add(mesh.TexCoords[0]);
    digest.Add(mesh.TexCoords[1]);
    digest.Add(mesh.Colors);
    digest.Add(mesh.Indices);
    digest.Add(&mesh.Material, sizeof mesh.Material);
  }
  for (const Texture& texture : scene.Textures)
  {
    digest.Add(texture.Bytes);
    digest.Add(texture.Floats);
  }
  for (const Material& m : scene.Materials)
  {
    const float numbers[] = { m.BaseColor.x, m.BaseColor.y, m.BaseColor.z, m.Alpha, m.Metallic, m.Roughness,
      m.Emission.x, m.Emission.y, m.Emission.z, m.Specular, m.SpecularColor.x, m.SpecularColor.y, m.SpecularColor.z,
      m.Ior, m.Transmission, m.Clearcoat, m.ClearcoatRoughness, m.Unlit ? 1.f : 0.f };
    digest.Add(numbers, sizeof numbers);
  }
  for (const Node& node : scene.Nodes)
    digest.Add(node.Matrix.m, sizeof node.Matrix.m);
  for (const PunctualLight& light : scene.Lights)
    digest.Add(&light.Intensity, sizeof light.Intensity);
  scene.Hash = digest.Hexadecimal();

  std::shared_ptr<const Scene> done = in.Building;
  in.Materials.reset();
  in.Building.reset();
  in.CurrentScene = done;
  in.Recorded = true;
  return done;
}

void SceneRecorder::Repeat(int tick)
{
  Internals& in = *this->Internal;
  if (!in.Recorded || tick == in.Tick)
    return;
  const bool next = std::int64_t(tick) == std::int64_t(in.Tick) + 1;
  in.Previous.clear();
  if (next)
    in.Previous = in.Current;
  in.PreviousScene = next ? in.CurrentScene : nullptr;
  in.Tick = tick;
}

std::shared_ptr<const Scene> SceneFromData(vtkDataObject* data, const DataMaterial& material)
{
  SceneRecorder recorder;
  recorder.Begin();
  recorder.AddData(data, material);
  return recorder.Finish();
}

std::shared_ptr<const Scene> SceneFromRenderer(vtkRenderer* renderer, const RendererOptions& options)
{
  SceneRecorder recorder;
  recorder.Begin();
  recorder.AddRenderer(renderer, options);
  return recorder.Finish();
}
}
