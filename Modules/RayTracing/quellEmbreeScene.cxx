// SPDX-License-Identifier: BSD-3-Clause
#include "quellEmbreeScene.h"

#include "quellSampler.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace quell
{
namespace
{
/// Embree's own limit on coordinates is near 1.8e18.
constexpr float LargestCoordinate = 1e18f;
/// New rays start this fraction of the largest coordinate at hand (64 ulp) off the surface.
constexpr float OffsetScale = 0x1p-17f;

float Unit(float v)
{
  return v > 0 ? std::min(1.f, v) : 0; // NaN: 0
}
Vec3f Unit(const Vec3f& v)
{
  return { Unit(v.x), Unit(v.y), Unit(v.z) };
}
float Radiance(float v)
{
  return std::isfinite(v) && v > 0 ? v : 0;
}

struct MaterialValues
{
  Vec3f BaseColor;
  float Metallic, Roughness, Transmission;
};

Surface MakeSurface(const Material& m, const MaterialValues& v)
{
  Surface s;
  const Vec3f base = Unit(v.BaseColor);
  const float metallic = Unit(v.Metallic), transmission = Unit(v.Transmission), roughness = Unit(v.Roughness);
  const float specular = Unit(m.Specular);
  const float ior = std::isfinite(m.Ior) && m.Ior >= 0 ? m.Ior : 1.5f;
  const float r = (ior - 1) / (ior + 1), r0 = r * r;
  const Vec3f tint{ Radiance(m.SpecularColor.x), Radiance(m.SpecularColor.y), Radiance(m.SpecularColor.z) };
  const Vec3f f0 = Unit(tint * r0) * specular;
  // No interface, no reflection: F90 fades where the index nears 1.
  const float f90 = specular * std::min(1.f, 50 * r0);
  const float opaque = (1 - metallic) * (1 - transmission);
  s.Diffuse = m.Unlit ? Vec3f() : base * opaque;
  s.DiffuseF0 = MaxComponent(f0);
  s.DiffuseF90 = f90;
  s.Alpha = roughness * roughness;
  if (!m.Unlit)
  {
    s.F0 = f0 * opaque + base * metallic;
    s.F90 = Vec3f(f90 * opaque + metallic);
    s.Glass = (1 - metallic) * transmission;
  }
  s.GlassTint = base;
  s.GlassIor = ior;
  s.GlassSpecular = specular;
  s.Thin = !m.Volume;
  s.Finish();
  return s;
}

void Check(RTCDevice device)
{
  const RTCError error = rtcGetDeviceError(device);
  if (error != RTC_ERROR_NONE)
    throw std::runtime_error(error == RTC_ERROR_OUT_OF_MEMORY ? "the scene does not fit into memory"
                             : error == RTC_ERROR_UNSUPPORTED_CPU
                               ? "this CPU is not supported by Embree"
                               : "Embree failed (error " + std::to_string(int(error)) + ")");
}
}

EmbreeScene::EmbreeScene(std::shared_ptr<const Scene> scene)
  : Source(std::move(scene))
{
  const Scene& s = *this->Source;
  this->Device = rtcNewDevice(nullptr);
  if (!this->Device)
    throw std::runtime_error("Embree cannot start on this machine");

  for (const Material& m : s.Materials)
    this->Surfaces.push_back(MakeSurface(m, { m.BaseColor, m.Metallic, m.Roughness, m.Transmission }));

  // A node moves when it or one above it is animated.
  std::vector<char> animated(s.Nodes.size(), 0);
  for (const AnimationChannel& c : s.Animation)
    if (c.Node >= 0 && c.Node < int(animated.size()))
      animated[c.Node] = 1;
  const auto moves = [&](int node)
  {
    for (std::size_t guard = 0; node >= 0 && guard <= s.Nodes.size(); ++guard, node = s.Nodes[node].Parent)
      if (animated[node])
        return true;
    return false;
  };

  this->Parts.reserve(s.Instances.size());
  for (const Instance& i : s.Instances)
  {
    if (i.Mesh < 0 || i.Mesh >= int(s.Meshes.size()))
      continue;
    const Mesh& mesh = s.Meshes[i.Mesh];
    if (mesh.Material < 0 || mesh.Material >= int(s.Materials.size()))
      throw std::runtime_error("mesh \"" + mesh.Name + "\" uses a material that does not exist");
    const Material& m = s.Materials[mesh.Material];
    Part part;
    part.Geometry = &mesh;
    part.Node = i.Node;
    part.Id = i.Id;
    part.Material = mesh.Material;
    part.Animated = moves(i.Node);
    part.AlphaTested = m.Mode != AlphaMode::Opaque;
    const auto used = [&](const TextureUse& u) { return u.Texture >= 0 && u.Texture < int(s.Textures.size()); };
    part.Textured = used(m.BaseColorTexture) || used(m.MetallicRoughnessTexture) || used(m.NormalTexture) ||
                    used(m.EmissiveTexture) || used(m.TransmissionTexture);
    part.Plain = !part.Textured && mesh.Colors.empty();
    const Surface& surface = this->Surfaces[mesh.Material];
    this->Has.Textures |= part.Textured;
    this->Has.Glossy |= surface.HasSpecular;
    this->Has.Glass |= surface.Glass > 0;
    this->Has.Volumes |= m.Volume && surface.Glass > 0;
    this->Has.SeeThrough |= part.AlphaTested;
    this->Parts.push_back(std::move(part));
  }
  this->Has.Animated = s.Animated();

  // The origin: world's own, unless that is so far off that float positions would lose digits.
  const std::vector<Mat4> world = s.WorldMatrices(0);
  Vec3d lo(1e300), hi(-1e300);
  for (const Part& part : this->Parts)
    for (const Vec3f& p : part.Geometry->Positions)
    {
      const Vec3d q = part.Node >= 0 ? world[part.Node].Point(Vec3d(p)) : Vec3d(p);
      if (!IsFinite(q))
        continue;
      lo = { std::min(lo.x, q.x), std::min(lo.y, q.y), std::min(lo.z, q.z) };
      hi = { std::max(hi.x, q.x), std::max(hi.y, q.y), std::max(hi.z, q.z) };
    }
  this->RestLower = lo;
  this->RestUpper = hi;
  if (lo.x <= hi.x)
  {
    const Vec3d centre = (lo + hi) * 0.5;
    if (Length(centre) > 2 * Length(hi - lo))
      this->Center = centre;
  }
  else if (!s.Cameras.empty())
  {
    const CameraModel& c = s.Cameras.front();
    const Mat4 m = c.Node >= 0 ? world[c.Node] : c.WorldFromCamera;
    const Vec3d at{ m.m[0][3], m.m[1][3], m.m[2][3] };
    if (IsFinite(at))
      this->Center = at;
  }

  this->Rtc = rtcNewScene(this->Device);
  // With moving parts a two-level hierarchy is kept, so that only what moved is built again.
  rtcSetSceneFlags(this->Rtc,
    this->Has.Animated ? RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC) : RTC_SCENE_FLAG_ROBUST);
  for (std::size_t i = 0; i < this->Parts.size(); ++i)
  {
    Part& part = this->Parts[i];
    part.Handle = rtcNewGeometry(this->Device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryUserData(part.Handle, reinterpret_cast<void*>(i));
    if (part.AlphaTested)
    {
      rtcSetGeometryIntersectFilterFunction(part.Handle, &EmbreeScene::SeeThrough);
      rtcSetGeometryOccludedFilterFunction(part.Handle, &EmbreeScene::SeeThrough);
    }
    rtcAttachGeometryByID(this->Rtc, part.Handle, unsigned(i));
  }
  Check(this->Device);
}

EmbreeScene::~EmbreeScene()
{
  for (Part& part : this->Parts)
    if (part.Handle)
      rtcReleaseGeometry(part.Handle);
  if (this->Rtc)
    rtcReleaseScene(this->Rtc);
  rtcReleaseDevice(this->Device);
}

Mat4 EmbreeScene::NodeMatrix(int node, bool previous) const
{
  return node >= 0 ? (previous ? this->PreviousNodes : this->Nodes)[std::size_t(node)] : Mat4();
}

void EmbreeScene::SetTime(double time, double previous)
{
  if (this->Posed && !this->Has.Animated)
    return;
  this->Nodes = this->Source->WorldMatrices(time);
  this->PreviousNodes = this->Has.Animated ? this->Source->WorldMatrices(previous) : this->Nodes;
  if (!this->Posed || time != this->Time)
  {
    this->DroppedTriangles = 0;
    for (Part& part : this->Parts)
    {
      if (!this->Posed || part.Animated)
      {
        Mat4 m = this->NodeMatrix(part.Node, false);
        m.m[0][3] -= this->Center.x;
        m.m[1][3] -= this->Center.y;
        m.m[2][3] -= this->Center.z;
        part.World = m;
        this->Bake(part);
      }
    }
    rtcCommitScene(this->Rtc);
    Check(this->Device);
  }
  Vec3d lo(1e300), hi(-1e300);
  this->TriangleCount = 0;
  for (Part& part : this->Parts)
  {
    Mat4 m = this->NodeMatrix(part.Node, true);
    m.m[0][3] -= this->Center.x;
    m.m[1][3] -= this->Center.y;
    m.m[2][3] -= this->Center.z;
    part.Previous = m;
    part.Moved = false;
    for (int i = 0; i < 3 && part.Animated; ++i)
      for (int j = 0; j < 4; ++j)
        part.Moved |= part.World.m[i][j] != part.Previous.m[i][j];
    const std::size_t triangles = part.Triangles.size() / 3;
    this->TriangleCount += std::int64_t(triangles);
    this->DroppedTriangles += std::int64_t(part.Geometry->Indices.size() / 3 - triangles);
    for (std::uint32_t v : part.Triangles)
      for (int c = 0; c < 3; ++c)
      {
        const double x = part.Positions[3 * std::size_t(v) + std::size_t(c)];
        lo[c] = std::min(lo[c], x);
        hi[c] = std::max(hi[c], x);
      }
  }
  this->Has.Geometry = this->TriangleCount > 0;
  this->Lower = lo + this->Center;
  this->Upper = hi + this->Center;
  if (!this->Posed || time != this->Time)
    this->BuildLights();
  this->Time = time;
  this->Posed = true;
}

void EmbreeScene::Bake(Part& part)
{
  const Mesh& mesh = *part.Geometry;
  part.Mirrored = part.World.Determinant3() < 0;
  part.Positions.resize(3 * mesh.Positions.size() + 4);
  for (std::size_t i = 0; i < mesh.Positions.size(); ++i)
  {
    const Vec3d p = part.World.Point(Vec3d(mesh.Positions[i]));
    for (int c = 0; c < 3; ++c)
      part.Positions[3 * i + std::size_t(c)] = float(p[c]);
  }
  part.Triangles.clear();
  const std::uint32_t count = std::uint32_t(mesh.Positions.size());
  for (std::size_t t = 0; t + 2 < mesh.Indices.size(); t += 3)
  {
    const std::uint32_t* v = &mesh.Indices[t];
    bool usable = v[0] < count && v[1] < count && v[2] < count;
    for (int k = 0; k < 3 && usable; ++k)
    {
      const Vec3f p = this->Corner(part, v[k]);
      for (int c = 0; c < 3; ++c)
        usable &= std::fabs(p[c]) <= LargestCoordinate; // false for NaN
    }
    if (usable)
    {
      const Vec3d a(this->Corner(part, v[0])), b(this->Corner(part, v[1])), c(this->Corner(part, v[2]));
      usable = Length(Cross(b - a, c - a)) > 0;
    }
    if (usable)
    {
      // A mirroring node turns triangles inside out: turn them back, so that winding always tells the outside.
      const std::uint32_t w[3] = { v[0], part.Mirrored ? v[2] : v[1], part.Mirrored ? v[1] : v[2] };
      part.Triangles.insert(part.Triangles.end(), w, w + 3);
    }
  }
  // Vertices that no triangle uses may hold anything; Embree reads only indexed ones.
  const std::size_t triangles = part.Triangles.size() / 3;
  if (triangles == 0)
  {
    rtcDisableGeometry(part.Handle);
    rtcCommitGeometry(part.Handle);
    return;
  }
  rtcEnableGeometry(part.Handle);
  rtcSetSharedGeometryBuffer(part.Handle, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, part.Positions.data(), 0,
    3 * sizeof(float), mesh.Positions.size());
  rtcSetSharedGeometryBuffer(part.Handle, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, part.Triangles.data(), 0,
    3 * sizeof(std::uint32_t), triangles);
  rtcCommitGeometry(part.Handle);
}

void EmbreeScene::BuildLights()
{
  const Scene& s = *this->Source;
  std::vector<LightTriangle> triangles;
  std::vector<Vec3f> average;
  for (std::size_t g = 0; g < this->Parts.size(); ++g)
  {
    Part& part = this->Parts[g];
    part.LightIndex.clear();
    const Material& m = s.Materials[std::size_t(part.Material)];
    const Vec3f factor{ Radiance(m.Emission.x), Radiance(m.Emission.y), Radiance(m.Emission.z) };
    if (!(MaxComponent(factor) > 0) || m.Unlit)
      continue;
    const bool textured = m.EmissiveTexture.Texture >= 0 || part.AlphaTested;
    const std::size_t count = part.Triangles.size() / 3;
    part.LightIndex.assign(count, -1);
    for (std::size_t t = 0; t < count; ++t)
    {
      const Vec3f a = this->Corner(part, part.Triangles[3 * t]), b = this->Corner(part, part.Triangles[3 * t + 1]),
                  c = this->Corner(part, part.Triangles[3 * t + 2]);
      LightTriangle l;
      l.V0 = a;
      l.E1 = b - a;
      l.E2 = c - a;
      l.N = Vec3f(Normalized(Cross(Vec3d(b) - Vec3d(a), Vec3d(c) - Vec3d(a))));
      float largest = 0;
      for (int i = 0; i < 3; ++i)
        largest = std::max({ largest, std::fabs(a[i]), std::fabs(b[i]), std::fabs(c[i]) });
      l.Offset = largest * OffsetScale;
      l.Emission = factor;
      l.TwoSided = m.DoubleSided;
      l.Textured = textured;
      l.Geometry = std::uint32_t(g);
      l.Primitive = std::uint32_t(t);
      Vec3f mean = factor;
      if (textured)
      {
        // The mean over 16 points, and never 0: what is not seen at the points may still shine between them.
        mean = factor * 0.05f;
        for (int i = 0; i < 4; ++i)
          for (int j = 0; j < 4; ++j)
          {
            const float r = std::sqrt((i + 0.5f) / 4), u = 1 - r, v = (j + 0.5f) / 4 * r;
            mean += this->EmissionAt(part, l.Primitive, u, v) * (1.f / 16);
          }
      }
      part.LightIndex[t] = std::int32_t(triangles.size());
      triangles.push_back(l);
      average.push_back(mean);
    }
  }
  std::vector<PlacedLight> lights;
  for (const PunctualLight& p : s.Lights)
  {
    const Mat4 m = this->NodeMatrix(p.Node, false);
    PlacedLight l;
    l.Type = p.Type;
    l.Position = Vec3f(Vec3d(m.m[0][3], m.m[1][3], m.m[2][3]) - this->Center);
    l.Direction = Vec3f(Normalized(m.Direction({ 0, 0, -1 })));
    l.Intensity = { Radiance(p.Intensity.x), Radiance(p.Intensity.y), Radiance(p.Intensity.z) };
    l.Range = std::isfinite(p.Range) && p.Range > 0 ? p.Range : 0;
    l.CosInner = std::cos(p.InnerCone);
    l.CosOuter = std::cos(p.OuterCone);
    if (IsFinite(l.Position) && l.Direction != Vec3f())
      lights.push_back(l);
  }
  const double radius = this->Has.Geometry ? Length(this->Upper - this->Lower) / 2 : 1;
  const std::size_t before = triangles.size();
  this->LightSource.Build(std::move(triangles), average, std::move(lights), s, float(radius));
  if (this->LightSource.GetTriangles().size() != before)
    for (Part& part : this->Parts)
      part.LightIndex.clear();
}

bool EmbreeScene::Intersect(Context& context, const TraceRay& ray, SurfaceHit& hit) const noexcept
{
  RTCRayHit r;
  r.ray.org_x = ray.Origin.x;
  r.ray.org_y = ray.Origin.y;
  r.ray.org_z = ray.Origin.z;
  r.ray.dir_x = ray.Direction.x;
  r.ray.dir_y = ray.Direction.y;
  r.ray.dir_z = ray.Direction.z;
  r.ray.tnear = 0;
  r.ray.tfar = ray.Far;
  r.ray.time = 0;
  r.ray.mask = ~0u;
  r.ray.id = 0;
  r.ray.flags = 0;
  r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  context.Key = ray.Key;
  rtcIntersect1(this->Rtc, &context.Rtc, &r);
  if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID || !std::isfinite(r.ray.tfar))
    return false;
  hit.Geometry = r.hit.geomID;
  hit.Primitive = r.hit.primID;
  hit.U = r.hit.u;
  hit.V = r.hit.v;
  hit.T = r.ray.tfar;
  const Part& part = this->Parts[hit.Geometry];
  const std::uint32_t* v = &part.Triangles[3 * std::size_t(hit.Primitive)];
  const Vec3f a = this->Corner(part, v[0]), b = this->Corner(part, v[1]), c = this->Corner(part, v[2]);
  const Vec3d origin(a), e1 = Vec3d(b) - origin, e2 = Vec3d(c) - origin;
  hit.P = origin + e1 * double(hit.U) + e2 * double(hit.V);
  hit.Pf = Vec3f(hit.P);
  const Vec3d n = Cross(e1, e2);
  hit.Ng = Vec3f(n * (1 / std::sqrt(Dot(n, n))));
  hit.Front = Dot(hit.Ng, ray.Direction) < 0;
  float largest = 0;
  for (int i = 0; i < 3; ++i)
    largest = std::max(largest, std::max(std::fabs(a[i]), std::max(std::fabs(b[i]), std::fabs(c[i]))));
  hit.Offset = largest * OffsetScale;
  return true;
}

bool EmbreeScene::Occluded(Context& context, const TraceRay& ray) const noexcept
{
  RTCRay r;
  r.org_x = ray.Origin.x;
  r.org_y = ray.Origin.y;
  r.org_z = ray.Origin.z;
  r.dir_x = ray.Direction.x;
  r.dir_y = ray.Direction.y;
  r.dir_z = ray.Direction.z;
  r.tnear = 0;
  r.tfar = ray.Far;
  r.time = 0;
  r.mask = ~0u;
  r.id = 0;
  r.flags = 0;
  context.Key = ray.Key;
  rtcOccluded1(this->Rtc, &context.Rtc, &r);
  return r.tfar < 0;
}

void EmbreeScene::SeeThrough(const RTCFilterFunctionNArguments* args)
{
  const Context* context = reinterpret_cast<const Context*>(args->context);
  const std::size_t index = reinterpret_cast<std::size_t>(args->geometryUserPtr);
  const EmbreeScene& self = *context->Self;
  const Part& part = self.Parts[index];
  for (unsigned i = 0; i < args->N; ++i)
  {
    if (args->valid[i] != -1)
      continue;
    const std::uint32_t primitive = RTCHitN_primID(args->hit, args->N, i);
    const float u = RTCHitN_u(args->hit, args->N, i), v = RTCHitN_v(args->hit, args->N, i);
    const float alpha = self.AlphaAt(part, primitive, u, v);
    if (alpha < 1 && !(SurfaceRandom(context->Key, std::uint32_t(index), primitive) < alpha))
      args->valid[i] = 0;
  }
}

Vec2f EmbreeScene::TexCoord(const Part& part, std::uint32_t primitive, float u, float v, int set) const noexcept
{
  const std::vector<Vec2f>& t = part.Geometry->TexCoords[set == 1 ? 1 : 0];
  const std::uint32_t* i = &part.Triangles[3 * std::size_t(primitive)];
  if (i[0] >= t.size() || i[1] >= t.size() || i[2] >= t.size())
    return {};
  const Vec2f &a = t[i[0]], &b = t[i[1]], &c = t[i[2]];
  const float w = 1 - u - v;
  return { w * a.x + u * b.x + v * c.x, w * a.y + u * b.y + v * c.y };
}

Vec4f EmbreeScene::Lookup(
  const Part& part, std::uint32_t primitive, float u, float v, const TextureUse& use) const noexcept
{
  const Vec2f t = this->TexCoord(part, primitive, u, v, use.TexCoord);
  const float x = use.Transform[0][0] * t.x + use.Transform[0][1] * t.y + use.Transform[0][2];
  const float y = use.Transform[1][0] * t.x + use.Transform[1][1] * t.y + use.Transform[1][2];
  return this->Source->Textures[std::size_t(use.Texture)].Sample(x, y);
}

Vec4f EmbreeScene::VertexColor(const Part& part, std::uint32_t primitive, float u, float v) const noexcept
{
  const std::vector<Vec4f>& c = part.Geometry->Colors;
  const std::uint32_t* i = &part.Triangles[3 * std::size_t(primitive)];
  if (i[0] >= c.size() || i[1] >= c.size() || i[2] >= c.size())
    return { 1, 1, 1, 1 };
  const Vec4f &a = c[i[0]], &b = c[i[1]], &d = c[i[2]];
  const float w = 1 - u - v;
  return { w * a.x + u * b.x + v * d.x, w * a.y + u * b.y + v * d.y, w * a.z + u * b.z + v * d.z,
    w * a.w + u * b.w + v * d.w };
}

float EmbreeScene::AlphaAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept
{
  const Material& m = this->Source->Materials[std::size_t(part.Material)];
  if (m.Mode == AlphaMode::Opaque)
    return 1;
  float alpha = m.Alpha;
  if (m.BaseColorTexture.Texture >= 0)
    alpha *= this->Lookup(part, primitive, u, v, m.BaseColorTexture).w;
  if (!part.Geometry->Colors.empty())
    alpha *= this->VertexColor(part, primitive, u, v).w;
  return m.Mode == AlphaMode::Mask ? (alpha >= m.AlphaCutoff ? 1.f : 0.f) : Unit(alpha);
}

Vec3f EmbreeScene::EmissionAt(const Part& part, std::uint32_t primitive, float u, float v) const noexcept
{
  const Material& m = this->Source->Materials[std::size_t(part.Material)];
  Vec3f e{ Radiance(m.Emission.x), Radiance(m.Emission.y), Radiance(m.Emission.z) };
  if (m.EmissiveTexture.Texture >= 0)
  {
    const Vec3f t = this->Lookup(part, primitive, u, v, m.EmissiveTexture).xyz();
    e *= Vec3f(Radiance(t.x), Radiance(t.y), Radiance(t.z));
  }
  return e;
}

Vec3f EmbreeScene::LightEmission(const LightSampler::Sample& s) const noexcept
{
  const Part& part = this->Parts[s.Geometry];
  return this->EmissionAt(part, s.Primitive, s.U, s.V) * this->AlphaAt(part, s.Primitive, s.U, s.V);
}

bool EmbreeScene::Attenuation(const SurfaceHit& hit, Vec3f& color, float& distance) const noexcept
{
  const Material& m = this->Source->Materials[std::size_t(this->Parts[hit.Geometry].Material)];
  color = Unit(m.AttenuationColor);
  distance = m.AttenuationDistance;
  return m.Volume && std::isfinite(distance) && distance > 0;
}

bool EmbreeScene::PreviousPosition(const SurfaceHit& hit, Vec3d& p) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  if (!part.Moved)
    return false;
  const std::uint32_t* v = &part.Triangles[3 * std::size_t(hit.Primitive)];
  const Vec3d a(part.Geometry->Positions[v[0]]), b(part.Geometry->Positions[v[1]]), c(part.Geometry->Positions[v[2]]);
  p = part.Previous.Point(a + (b - a) * double(hit.U) + (c - a) * double(hit.V));
  return true;
}

void EmbreeScene::Shade(const SurfaceHit& hit, const Vec3f& direction, SurfacePoint& point) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  const Mesh& mesh = *part.Geometry;
  const Material& m = this->Source->Materials[std::size_t(part.Material)];
  point.Ng = hit.Front ? hit.Ng : -hit.Ng;
  point.Ns = point.Ng;
  const std::uint32_t* i = &part.Triangles[3 * std::size_t(hit.Primitive)];
  const Vec3f wo = -direction;
  if (!mesh.Normals.empty() && i[0] < mesh.Normals.size() && i[1] < mesh.Normals.size() && i[2] < mesh.Normals.size())
  {
    const Vec3f n = mesh.Normals[i[0]] * (1 - hit.U - hit.V) + mesh.Normals[i[1]] * hit.U + mesh.Normals[i[2]] * hit.V;
    const Vec3f w = Vec3f(Normalized(part.World.Normal(Vec3d(n))));
    if (w != Vec3f())
      point.Ns = Dot(w, point.Ng) < 0 ? -w : w;
  }
  if (part.Textured && m.NormalTexture.Texture >= 0)
  {
    const Vec4f s = this->Lookup(part, hit.Primitive, hit.U, hit.V, m.NormalTexture);
    Vec3f local{ (2 * s.x - 1) * m.NormalScale, (2 * s.y - 1) * m.NormalScale, 2 * s.z - 1 };
    Vec3d t;
    double handed = 1;
    if (i[0] < mesh.Tangents.size() && i[1] < mesh.Tangents.size() && i[2] < mesh.Tangents.size())
    {
      const Vec4f &a = mesh.Tangents[i[0]], &b = mesh.Tangents[i[1]], &c = mesh.Tangents[i[2]];
      t = part.World.Direction(Vec3d(a.xyz() * (1 - hit.U - hit.V) + b.xyz() * hit.U + c.xyz() * hit.V));
      handed = (a.w < 0) != part.Mirrored ? -1 : 1;
    }
    else
    {
      // along growing u, from the triangle's texture coordinates
      const Vec2f a = this->TexCoord(part, hit.Primitive, 0, 0, m.NormalTexture.TexCoord),
                  b = this->TexCoord(part, hit.Primitive, 1, 0, m.NormalTexture.TexCoord),
                  c = this->TexCoord(part, hit.Primitive, 0, 1, m.NormalTexture.TexCoord);
      const double du1 = b.x - a.x, dv1 = b.y - a.y, du2 = c.x - a.x, dv2 = c.y - a.y;
      const double det = du1 * dv2 - du2 * dv1;
      const Vec3d p0(this->Corner(part, i[0])), e1 = Vec3d(this->Corner(part, i[1])) - p0,
                                                e2 = Vec3d(this->Corner(part, i[2])) - p0;
      if (det != 0 && std::isfinite(det))
      {
        t = (e1 * dv2 - e2 * dv1) * (1 / det);
        // texture v grows downwards in glTF, the map's green upwards
        handed = det < 0 ? 1 : -1;
      }
    }
    const Vec3d n(point.Ns);
    t = Normalized(t - n * Dot(t, n));
    if (t != Vec3d() && IsFinite(local))
    {
      // The back side sees the same bumps from behind: tangents stay, only the normal was turned.
      const Vec3d bitangent = Cross(hit.Front ? n : -n, t) * handed;
      const Vec3d bent = t * double(local.x) + bitangent * double(local.y) + n * double(local.z);
      const Vec3f w = Vec3f(Normalized(bent));
      if (w != Vec3f())
        point.Ns = w;
    }
  }
  // A shading normal that looks away from the ray would be black; bend it until it just faces the ray.
  const float facing = Dot(point.Ns, wo);
  if (facing < 0.01f && point.Ns != point.Ng)
  {
    const Vec3f bent = Normalized(point.Ns + wo * (0.01f - facing));
    point.Ns = Dot(bent, point.Ng) > 0 ? bent : point.Ng;
  }

  if (part.Plain)
  {
    point.Material = this->Surfaces[std::size_t(part.Material)];
    point.Roughness = Unit(m.Roughness);
    if (m.Unlit)
      point.DisplayOnly = Unit(m.BaseColor);
  }
  else
  {
    MaterialValues v{ m.BaseColor, m.Metallic, m.Roughness, m.Transmission };
    if (m.BaseColorTexture.Texture >= 0)
      v.BaseColor *= this->Lookup(part, hit.Primitive, hit.U, hit.V, m.BaseColorTexture).xyz();
    if (!mesh.Colors.empty())
      v.BaseColor *= this->VertexColor(part, hit.Primitive, hit.U, hit.V).xyz();
    if (m.MetallicRoughnessTexture.Texture >= 0)
    {
      const Vec4f t = this->Lookup(part, hit.Primitive, hit.U, hit.V, m.MetallicRoughnessTexture);
      v.Roughness *= t.y;
      v.Metallic *= t.z;
    }
    if (m.TransmissionTexture.Texture >= 0)
      v.Transmission *= this->Lookup(part, hit.Primitive, hit.U, hit.V, m.TransmissionTexture).x;
    point.Material = MakeSurface(m, v);
    point.Roughness = Unit(v.Roughness);
    if (m.Unlit)
      point.DisplayOnly = Unit(v.BaseColor);
  }
  point.Emission = Vec3f();
  if (hit.Front || m.DoubleSided)
    point.Emission = m.Unlit ? Vec3f() : this->EmissionAt(part, hit.Primitive, hit.U, hit.V);
}
}
