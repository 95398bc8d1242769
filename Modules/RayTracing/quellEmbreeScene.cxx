// SPDX-License-Identifier: BSD-3-Clause
#include "quellEmbreeScene.h"

#include "quellMaterial.h"
#include "vtkSMPTools.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <unordered_map>

namespace quell
{
namespace
{
constexpr std::size_t MostWarnings = 40;
/// Times within the shutter are multiples of 1 / this of it.
constexpr int ShutterGrid = 128;
/// Pieces of a moving lamp's way.
constexpr int LampSegments = 16;
/// An instance is traced in its mesh's space, in float. Matrices that stretch directions more differently than this
/// would lose digits there.
constexpr double WorstCondition = 8;
constexpr std::size_t VerticesPerTask = 8192;

double Seconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
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

std::string Quoted(const char* what, const std::string& name, int index)
{
  return std::string(what) + (name.empty() ? ' ' + std::to_string(index) : " \"" + name + '"');
}

bool Usable(const Vec3f& p)
{
  return std::fabs(p.x) <= LargestCoordinate && std::fabs(p.y) <= LargestCoordinate &&
         std::fabs(p.z) <= LargestCoordinate; // false for NaN
}
bool Usable(const Vec3d& p)
{
  return std::fabs(p.x) <= LargestCoordinate && std::fabs(p.y) <= LargestCoordinate &&
         std::fabs(p.z) <= LargestCoordinate;
}

bool IsFinite(const Mat4& m)
{
  bool finite = true;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      finite &= std::isfinite(m.m[i][j]);
  return finite;
}
bool Same(const Mat4& a, const Mat4& b)
{
  bool same = true;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      same &= a.m[i][j] == b.m[i][j];
  return same;
}
bool IsIdentity(const Mat4& m)
{
  return Same(m, Mat4());
}
bool Same(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b)
{
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Vec3f)) == 0);
}

Mat4 Mix(const Mat4& a, const Mat4& b, double f)
{
  Mat4 m;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      m.m[i][j] = a.m[i][j] + (b.m[i][j] - a.m[i][j]) * f;
  return m;
}

/// How differently a matrix stretches directions: 1 for rotations and uniform scales, infinite for a singular one.
double Condition(const Mat4& m)
{
  const Vec3d a{ m.m[0][0], m.m[1][0], m.m[2][0] }, b{ m.m[0][1], m.m[1][1], m.m[2][1] },
    c{ m.m[0][2], m.m[1][2], m.m[2][2] };
  const Vec3d p = Cross(b, c), q = Cross(c, a), r = Cross(a, b);
  const double determinant = std::fabs(Dot(a, p));
  const double condition =
    std::sqrt((Dot(a, a) + Dot(b, b) + Dot(c, c)) * (Dot(p, p) + Dot(q, q) + Dot(r, r))) / (3 * determinant);
  return determinant > 0 && std::isfinite(condition) ? condition : std::numeric_limits<double>::infinity();
}

/// Cofactors, in units that keep them near 1 whatever the scale of the matrix; the sign makes normals of mirrored parts
/// point outside.
void NormalMatrix(const Mat4& m, float (&out)[3][3])
{
  Mat4 unit;
  double largest = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      largest = std::max(largest, std::fabs(m.m[i][j]));
  const double scale = largest > 0 && std::isfinite(largest) ? 1 / largest : 1;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      unit.m[i][j] = m.m[i][j] * scale;
  double n[3][3];
  largest = 0;
  for (int j = 0; j < 3; ++j)
  {
    const Vec3d column = unit.Normal({ j == 0 ? 1. : 0., j == 1 ? 1. : 0., j == 2 ? 1. : 0. });
    for (int i = 0; i < 3; ++i)
    {
      n[i][j] = column[i];
      largest = std::max(largest, std::fabs(column[i]));
    }
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out[i][j] = largest > 0 && std::isfinite(largest) ? float(n[i][j] / largest) : 0.f;
}

/// Which segment a time in [0, 1] falls into, and how far: as Embree does it.
int Segment(float time, int segments, double& f)
{
  const float scaled = time * float(segments);
  const int i = int(std::max(0.f, std::min(std::floor(scaled), float(segments - 1))));
  f = double(scaled - float(i));
  return i;
}

struct Counted
{
  std::size_t Broken = 0, Flat = 0, Index = 0, Repeated = 0;
  std::string Text(std::size_t total) const
  {
    const std::size_t all = this->Broken + this->Flat + this->Index + this->Repeated;
    if (all == 0)
      return {};
    std::string why;
    const auto add = [&](std::size_t count, const char* text)
    {
      if (count > 0)
        why += (why.empty() ? "" : ", ") + (count == all ? std::string() : std::to_string(count) + ' ') + text;
    };
    add(this->Broken, "corners that are not finite or beyond 1e18");
    add(this->Flat, "no area");
    add(this->Index, "indices of no vertex");
    add(this->Repeated, "in the place of another, which would shine twice");
    return std::to_string(all) + " of " + std::to_string(total) + " triangles left out (" + why + ")";
  }
};

/// Triangles of a mesh that can be traced, by positions of their vertices. `own` stays empty and `corners` points to
/// the mesh where that is all of them.
Counted SelectTriangles(const Mesh& mesh, const Vec3f* points, bool dropFlat, bool dropRepeated, bool twoSided,
  std::vector<std::uint32_t>& own, const std::uint32_t*& corners, std::size_t& triangles)
{
  Counted out;
  const std::size_t total = mesh.Indices.size() / 3;
  const std::uint32_t count = std::uint32_t(mesh.Positions.size());
  own.clear();
  bool all = true;
  std::unordered_multimap<std::uint64_t, std::uint32_t> seen;
  const auto key = [&](const std::uint32_t* v)
  {
    // the same for any order of the corners
    std::uint64_t sum = 0;
    for (int k = 0; k < 3; ++k)
    {
      std::uint64_t h = 0x9e3779b97f4a7c15u;
      for (int c = 0; c < 3; ++c)
      {
        const float x = points[v[k]][c] + 0.f; // -0 becomes 0
        std::uint32_t bits;
        std::memcpy(&bits, &x, sizeof bits);
        h = (h ^ bits) * 0xff51afd7ed558ccdu;
        h ^= h >> 29;
      }
      sum += h;
    }
    return sum;
  };
  const auto repeats = [&](const std::uint32_t* a, const std::uint32_t* b)
  {
    for (int r = 0; r < 3; ++r)
      for (int turn = 1; turn <= (twoSided ? 2 : 1); ++turn)
        if (points[a[0]] == points[b[r]] && points[a[1]] == points[b[(r + turn) % 3]] &&
            points[a[2]] == points[b[(r + 2 * turn) % 3]])
          return true;
    return false;
  };
  for (std::size_t t = 0; t < total; ++t)
  {
    const std::uint32_t* v = &mesh.Indices[3 * t];
    bool usable = false;
    if (!(v[0] < count && v[1] < count && v[2] < count))
      ++out.Index;
    else if (!Usable(points[v[0]]) || !Usable(points[v[1]]) || !Usable(points[v[2]]))
      ++out.Broken;
    else
    {
      usable = true;
      if (dropFlat)
      {
        const Vec3d a(points[v[0]]), b(points[v[1]]), c(points[v[2]]);
        usable = Length(Cross(b - a, c - a)) > 0;
        out.Flat += !usable;
      }
      if (usable && dropRepeated)
      {
        const std::uint64_t k = key(v);
        const auto range = seen.equal_range(k);
        for (auto i = range.first; i != range.second && usable; ++i)
          usable = !repeats(&mesh.Indices[3 * std::size_t(i->second)], v);
        if (usable)
          seen.emplace(k, std::uint32_t(t));
        out.Repeated += !usable;
      }
    }
    if (all && !usable)
    {
      all = false;
      own.assign(mesh.Indices.begin(), mesh.Indices.begin() + std::ptrdiff_t(3 * t));
    }
    else if (!all && usable)
      own.insert(own.end(), v, v + 3);
  }
  own.shrink_to_fit();
  corners = all ? mesh.Indices.data() : own.data();
  triangles = all ? total : own.size() / 3;
  return out;
}

void Extend(const Vec3d& p, Vec3d& lower, Vec3d& upper)
{
  for (int c = 0; c < 3; ++c)
  {
    lower[c] = std::min(lower[c], p[c]);
    upper[c] = std::max(upper[c], p[c]);
  }
}

/// Box of the triangles' corners; lower > upper: none.
void Enclose(const Vec3f* points, const std::uint32_t* corners, std::size_t triangles, Vec3d& lower, Vec3d& upper)
{
  Vec3f lo(std::numeric_limits<float>::infinity()), hi(-std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < 3 * triangles; ++i)
  {
    const Vec3f& p = points[corners[i]];
    lo = { std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z) };
    hi = { std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z) };
  }
  lower = Vec3d(lo);
  upper = Vec3d(hi);
}

Vec3d BoxCorner(const Vec3d& lower, const Vec3d& upper, int i)
{
  return { i & 1 ? upper.x : lower.x, i & 2 ? upper.y : lower.y, i & 4 ? upper.z : lower.z };
}

bool Far(const Vec3d& lower, const Vec3d& upper)
{
  return Length(lower + upper) * 0.5 > 2 * Length(upper - lower);
}

/// Embree reads 16 bytes where a vertex has 12: the last one needs something behind it.
const Vec3f* Padded(const std::vector<Vec3f>& positions)
{
  return positions.capacity() > positions.size() ? positions.data() : nullptr;
}

void SetBuffers(RTCGeometry geometry, const std::vector<const Vec3f*>& points, std::size_t vertices,
  const std::uint32_t* corners, std::size_t triangles)
{
  rtcSetGeometryTimeStepCount(geometry, unsigned(points.size()));
  for (std::size_t k = 0; k < points.size(); ++k)
    rtcSetSharedGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, unsigned(k), RTC_FORMAT_FLOAT3, points[k], 0, sizeof(Vec3f), vertices);
  rtcSetSharedGeometryBuffer(
    geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, corners, 0, 3 * sizeof(std::uint32_t), triangles);
}

void SetPlace(RTCGeometry geometry, unsigned step, const Mat4& m)
{
  float rows[12];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      rows[4 * i + j] = float(m.m[i][j]);
  rtcSetGeometryTransform(geometry, step, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, rows);
}
}

EmbreeScene::EmbreeScene(std::shared_ptr<const Scene> scene, const Options& options)
  : Source(std::move(scene))
  , Settings(options)
{
  const double start = Seconds();
  const Scene& s = *this->Source;
  this->LightSource.SetSelection(options.Lights);
  const auto power = [](int segments)
  {
    int n = 1;
    while (2 * n <= std::min(segments, ShutterGrid / 2))
      n *= 2;
    return n;
  };
  this->Settings.RigidSegments = power(options.RigidSegments);
  this->Settings.DeformingSegments = power(options.DeformingSegments);

  for (std::size_t i = 0; i < s.Materials.size(); ++i)
  {
    const Material& m = s.Materials[i];
    this->Surfaces.push_back(MakeSurface(m, MaterialValues(m)));
    Vec3f e;
    bool broken = false, large = false;
    for (int c = 0; c < 3; ++c)
    {
      broken |= !std::isfinite(m.Emission[c]) || m.Emission[c] < 0;
      large |= m.Emission[c] > LargestEmission;
      e[c] = std::min(LargestEmission, Radiance(m.Emission[c]));
    }
    this->Emissions.push_back(e);
    const std::string name = Quoted("material", m.Name, int(i));
    if (broken)
      this->Warn(name + ": its emission is negative or not a number; taken as 0");
    else if (large)
      this->Warn(name + ": its emission is above 1e14; taken as 1e14");
  }

  const std::vector<char> moving = s.MovingInstances();
  this->BodyOf.assign(s.Meshes.size(), -1);
  std::vector<std::int64_t> uses(s.Meshes.size(), 0);
  this->Parts.reserve(s.Instances.size());
  for (std::size_t k = 0; k < s.Instances.size(); ++k)
  {
    const Instance& i = s.Instances[k];
    if (i.Mesh < 0 || i.Mesh >= int(s.Meshes.size()))
      continue;
    const Mesh& mesh = s.Meshes[std::size_t(i.Mesh)];
    if (mesh.Material < 0 || mesh.Material >= int(s.Materials.size()))
      throw std::runtime_error("mesh \"" + mesh.Name + "\" uses a material that does not exist");
    if (i.Node >= int(s.Nodes.size()))
      throw std::runtime_error("mesh \"" + mesh.Name + "\" is placed by a node that does not exist");
    const Material& m = s.Materials[std::size_t(mesh.Material)];
    Part part;
    part.Geometry = &mesh;
    part.Instance = int(k);
    part.Node = i.Node;
    part.Id = i.Id;
    part.Material = mesh.Material;
    part.Moves = moving[k] != 0;
    part.Deforms = s.Deforms(i);
    part.AlphaTested = m.Mode != AlphaMode::Opaque;
    const auto used = [&](const TextureUse& u) { return u.Texture >= 0 && u.Texture < int(s.Textures.size()); };
    part.Textured = used(m.BaseColorTexture) || used(m.MetallicRoughnessTexture) || used(m.NormalTexture) ||
                    used(m.EmissiveTexture) || used(m.TransmissionTexture);
    part.Plain = !part.Textured && mesh.Colors.empty();
    const Surface& surface = this->Surfaces[std::size_t(mesh.Material)];
    this->Has.Textures |= part.Textured;
    this->Has.Glossy |= surface.HasSpecular;
    this->Has.Glass |= surface.Glass > 0;
    this->Has.Volumes |= m.Volume && surface.Glass > 0;
    this->Has.SeeThrough |= part.AlphaTested;
    if (!part.Moves && !part.Deforms)
      ++uses[std::size_t(i.Mesh)];
    this->Parts.push_back(std::move(part));
  }
  for (std::size_t i = 0; i < s.Lights.size(); ++i)
    if (s.Lights[i].Node >= int(s.Nodes.size()))
      throw std::runtime_error(Quoted("light", s.Lights[i].Name, int(i)) + " is placed by a node that does not exist");
  this->Has.Animated = s.Animated();

  // The origin: world's own, unless that is so far off that float positions would lose digits.
  const ScenePose rest = s.PoseAt(0);
  this->FindBounds(rest, this->RestLower, this->RestUpper);
  if (this->RestLower.x <= this->RestUpper.x)
  {
    if (Far(this->RestLower, this->RestUpper))
      this->Center = (this->RestLower + this->RestUpper) * 0.5;
    const double radius = Length(this->RestUpper - this->RestLower) / 2;
    this->Radius = radius > 0 ? radius : 1;
  }
  else if (!s.Cameras.empty())
  {
    const CameraModel& c = s.Cameras.front();
    const Mat4 m = c.Node >= 0 ? rest.World[std::size_t(c.Node)] : c.WorldFromCamera;
    const Vec3d at{ m.m[0][3], m.m[1][3], m.m[2][3] };
    if (quell::IsFinite(at))
      this->Center = at;
  }

  this->Device = rtcNewDevice(nullptr);
  if (!this->Device)
    throw std::runtime_error("Embree cannot start on this machine");
  rtcSetDeviceMemoryMonitorFunction(
    this->Device,
    [](void* self, ssize_t bytes, bool)
    {
      static_cast<EmbreeScene*>(self)->EmbreeBytes += bytes;
      return true;
    },
    this);
  this->Rtc = rtcNewScene(this->Device);
  rtcSetSceneFlags(this->Rtc, RTC_SCENE_FLAG_ROBUST);

  // Meshes whose copies would cost too much memory.
  std::int64_t repeated = 0;
  for (std::size_t i = 0; i < uses.size(); ++i)
    repeated += std::max<std::int64_t>(0, uses[i] - 1) * std::int64_t(s.Meshes[i].Indices.size() / 3);
  const bool share = repeated > this->Settings.RepeatedTriangles;

  for (std::size_t i = 0; i < this->Parts.size(); ++i)
  {
    Part& part = this->Parts[i];
    const int mesh = s.Instances[std::size_t(part.Instance)].Mesh;
    if (part.Moves)
    {
      this->Movers.push_back(i);
      ++(part.Deforms ? this->Work.DeformingParts : this->Work.RigidParts);
      part.World = this->Relative(part.Node >= 0 ? rest.World[std::size_t(part.Node)] : Mat4());
      if (!part.Deforms)
      {
        part.Body = this->MakeBody(mesh, part.AlphaTested);
        continue;
      }
      // A hierarchy that is refitted needs the same triangles at all times: those without area at one time stay.
      const Counted left = SelectTriangles(*part.Geometry, part.Geometry->Positions.data(), false, false, false,
        part.OwnCorners, part.Corners, part.Triangles);
      const std::string text = left.Text(part.Geometry->Indices.size() / 3);
      if (!text.empty())
        this->Warn(this->NameOf(part) + ": " + text);
      continue;
    }
    ++this->Work.StillParts;
    const Mat4 place = this->Relative(part.Node >= 0 ? rest.World[std::size_t(part.Node)] : Mat4());
    if (share && !part.Deforms && uses[std::size_t(mesh)] > 1)
    {
      part.World = place;
      part.Body = this->MakeBody(mesh, part.AlphaTested);
      const Body& body = this->Bodies[std::size_t(part.Body)];
      Mat4 base = place;
      const Vec3d at = place.Point(body.Base);
      for (int c = 0; c < 3; ++c)
        base.m[c][3] = at[c];
      if (this->CanPlace(part, base))
      {
        ++this->Work.RigidParts;
        --this->Work.StillParts;
        part.Kind = Placement::Rigid;
        part.Place = part.Previous = base;
        part.Points = &body.Points->x;
        part.Corners = body.Corners;
        part.Triangles = body.Triangles;
        part.Normals =
          part.Geometry->Normals.size() == part.Geometry->Positions.size() ? part.Geometry->Normals.data() : nullptr;
        part.Tangents =
          part.Geometry->Tangents.size() == part.Geometry->Positions.size() ? part.Geometry->Tangents.data() : nullptr;
        part.Mirrored = part.FlipTangents = place.Determinant3() < 0;
        NormalMatrix(place, part.ToNormal);
        part.Lower = Vec3d(1e300);
        part.Upper = Vec3d(-1e300);
        for (int c = 0; c < 8; ++c)
          Extend(base.Point(BoxCorner(body.Lower, body.Upper, c)), part.Lower, part.Upper);
        part.Handle = rtcNewGeometry(this->Device, RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(part.Handle, body.Rtc);
        SetPlace(part.Handle, 0, base);
        part.Form = Part::Built::Instance;
        rtcCommitGeometry(part.Handle);
        rtcAttachGeometryByID(this->Rtc, part.Handle, unsigned(i));
        continue;
      }
      part.Body = -1;
    }
    this->BakeStill(part, i, rest);
  }
  rtcCommitScene(this->Rtc);
  if (!this->Movers.empty())
  {
    this->Moving = rtcNewScene(this->Device);
    rtcSetSceneFlags(this->Moving, RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC));
    // Embree keeps a hierarchy per geometry, and looks at its own quality, in scenes of low quality only; in others it
    // builds one of all triangles at every commit, dynamic or not.
    rtcSetSceneBuildQuality(this->Moving, RTC_BUILD_QUALITY_LOW);
    rtcSetSceneProgressMonitorFunction(
      this->Moving,
      [](void* self, double)
      {
        ++static_cast<EmbreeScene*>(self)->MovingSteps;
        return true;
      },
      this);
  }
  Check(this->Device);
  this->Work.BuildSeconds = Seconds() - start;
}

EmbreeScene::~EmbreeScene()
{
  for (Part& part : this->Parts)
    if (part.Handle)
      rtcReleaseGeometry(part.Handle);
  for (RTCScene scene : { this->Rtc, this->Moving })
    if (scene)
      rtcReleaseScene(scene);
  for (Body& body : this->Bodies)
    rtcReleaseScene(body.Rtc);
  if (this->Device)
    rtcReleaseDevice(this->Device);
}

void EmbreeScene::Warn(const std::string& text)
{
  if (this->Warnings.size() < MostWarnings)
    this->Warnings.push_back(text);
  else if (++this->HiddenWarnings == 1)
    this->Warnings.push_back("one more of this kind");
  else
    this->Warnings.back() = std::to_string(this->HiddenWarnings) + " more of this kind";
}

std::string EmbreeScene::NameOf(const Part& part) const
{
  const int mesh = this->Source->Instances[std::size_t(part.Instance)].Mesh;
  std::string name = Quoted("mesh", part.Geometry->Name, mesh);
  if (part.Node >= 0 && !this->Source->Nodes[std::size_t(part.Node)].Name.empty() &&
      this->Source->Nodes[std::size_t(part.Node)].Name != part.Geometry->Name)
    name += " at node \"" + this->Source->Nodes[std::size_t(part.Node)].Name + '"';
  return name;
}

Mat4 EmbreeScene::NodeMatrix(int node, bool previous) const
{
  return node >= 0 ? (previous ? this->PreviousNodes : this->Nodes)[std::size_t(node)] : Mat4();
}

Mat4 EmbreeScene::NodeMatrix(int node, double time) const
{
  return node >= 0 ? this->Source->PoseAt(time).World[std::size_t(node)] : Mat4();
}

EmbreeScene::Statistics EmbreeScene::GetStatistics() const
{
  Statistics out = this->Work;
  out.Bytes = this->EmbreeBytes;
  const auto add = [&out](const auto& list) { out.Bytes += std::int64_t(list.capacity() * sizeof(list[0])); };
  for (const Part& part : this->Parts)
  {
    add(part.OwnPoints);
    add(part.PreviousPoints);
    add(part.OwnCorners);
    add(part.OwnNormals);
    add(part.OwnTangents);
    add(part.LightIndex);
    for (std::size_t k = 0; k < part.Open.Points.size(); ++k)
      add(part.Open.Points[k]);
    for (std::size_t k = 0; k < part.Open.Normals.size(); ++k)
      add(part.Open.Normals[k]);
    for (std::size_t k = 0; k < part.Open.Tangents.size(); ++k)
      add(part.Open.Tangents[k]);
  }
  for (const Body& body : this->Bodies)
  {
    add(body.OwnPoints);
    add(body.OwnCorners);
  }
  add(this->Parts);
  return out;
}

/// World box of the corners of all triangles that can be traced; lower > upper: none.
void EmbreeScene::FindBounds(const ScenePose& pose, Vec3d& lower, Vec3d& upper) const
{
  lower = Vec3d(1e300);
  upper = Vec3d(-1e300);
  std::vector<char> used;
  std::vector<Vec3f> deformed;
  for (const Part& part : this->Parts)
  {
    const Mesh& mesh = *part.Geometry;
    const std::size_t n = mesh.Positions.size();
    Mat4 world = part.Node >= 0 ? pose.World[std::size_t(part.Node)] : Mat4();
    const Vec3f* points = mesh.Positions.data();
    Vec3d origin;
    if (part.Deforms)
    {
      // Relative to a place on the object, so that float has digits left.
      const Skin* skin = nullptr;
      const int index = part.Node >= 0 ? this->Source->Nodes[std::size_t(part.Node)].Skin : -1;
      if (mesh.Influences > 0 && index >= 0 && std::size_t(index) < this->Source->Skins.size())
        skin = &this->Source->Skins[std::size_t(index)];
      const int joint = skin && !skin->Joints.empty() ? skin->Joints.front() : -1;
      if (joint >= 0 && std::size_t(joint) < pose.World.size())
        world = pose.World[std::size_t(joint)];
      origin = world.Point(Vec3d());
      if (!Usable(origin))
        origin = Vec3d();
      this->Source->Deform(
        this->Source->Instances[std::size_t(part.Instance)], pose, origin, deformed, nullptr, nullptr);
      points = deformed.data();
      world = Mat4();
    }
    used.assign(n, 0);
    for (std::size_t t = 0; t + 2 < mesh.Indices.size(); t += 3)
    {
      const std::uint32_t* v = &mesh.Indices[t];
      if (v[0] < n && v[1] < n && v[2] < n && Usable(mesh.Positions[v[0]]) && Usable(mesh.Positions[v[1]]) &&
          Usable(mesh.Positions[v[2]]))
        used[v[0]] = used[v[1]] = used[v[2]] = 1;
    }
    for (std::size_t i = 0; i < n; ++i)
    {
      if (!used[i])
        continue;
      const Vec3d p = world.Point(Vec3d(points[i])) + origin;
      if (Usable(p))
        Extend(p, lower, upper);
    }
  }
}

int EmbreeScene::MakeBody(int mesh, bool seeThrough)
{
  int& index = this->BodyOf[std::size_t(mesh)];
  if (index >= 0)
    return index;
  index = int(this->Bodies.size());
  this->Bodies.emplace_back();
  Body& body = this->Bodies.back();
  const Mesh& m = this->Source->Meshes[std::size_t(mesh)];
  const std::size_t n = m.Positions.size();
  const Material& material = this->Source->Materials[std::size_t(m.Material)];
  const bool emits = MaxComponent(this->Emissions[std::size_t(m.Material)]) > 0 && !material.Unlit;
  const Counted left = SelectTriangles(
    m, m.Positions.data(), true, emits, material.DoubleSided, body.OwnCorners, body.Corners, body.Triangles);
  const std::string text = left.Text(m.Indices.size() / 3);
  if (!text.empty())
    this->Warn(Quoted("mesh", m.Name, mesh) + ": " + text);
  body.Rtc = rtcNewScene(this->Device);
  rtcSetSceneFlags(body.Rtc, RTC_SCENE_FLAG_ROBUST);
  if (body.Triangles == 0)
  {
    body.OwnPoints.resize(1);
    body.Points = body.OwnPoints.data();
    rtcCommitScene(body.Rtc);
    return index;
  }
  Enclose(m.Positions.data(), body.Corners, body.Triangles, body.Lower, body.Upper);
  if (Far(body.Lower, body.Upper))
    body.Base = (body.Lower + body.Upper) * 0.5;
  body.Lower -= body.Base;
  body.Upper -= body.Base;
  body.Points = body.Base == Vec3d() ? Padded(m.Positions) : nullptr;
  if (!body.Points)
  {
    body.OwnPoints.resize(n + 1);
    for (std::size_t i = 0; i < n; ++i)
      body.OwnPoints[i] = Vec3f(Vec3d(m.Positions[i]) - body.Base);
    body.Points = body.OwnPoints.data();
  }
  RTCGeometry geometry = rtcNewGeometry(this->Device, RTC_GEOMETRY_TYPE_TRIANGLE);
  SetBuffers(geometry, { body.Points }, n, body.Corners, body.Triangles);
  if (seeThrough)
  {
    rtcSetGeometryIntersectFilterFunction(geometry, &EmbreeScene::SeeThrough);
    rtcSetGeometryOccludedFilterFunction(geometry, &EmbreeScene::SeeThrough);
  }
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(body.Rtc, geometry, 0);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(body.Rtc);
  return index;
}

/// Whether Embree can trace the part through the matrix without losing digits.
bool EmbreeScene::CanPlace(const Part& part, const Mat4& place) const
{
  if (part.Body < 0 || !(Condition(place) <= WorstCondition))
    return false;
  const Body& body = this->Bodies[std::size_t(part.Body)];
  bool usable = true;
  for (int c = 0; c < 8; ++c)
    usable &= Usable(place.Point(BoxCorner(body.Lower, body.Upper, c)));
  return usable;
}

/// Points of a body to world, relative to the origin.
Mat4 EmbreeScene::PlaceOf(const Part& part, const ScenePose& pose) const
{
  Mat4 m = this->Relative(part.Node >= 0 ? pose.World[std::size_t(part.Node)] : Mat4());
  const Vec3d at = m.Point(this->Bodies[std::size_t(part.Body)].Base);
  for (int c = 0; c < 3; ++c)
    m.m[c][3] = at[c];
  return m;
}

/// World vertices of a part, in float around the origin, usable whatever the pose; one more than there are.
void EmbreeScene::BakeVertices(const Part& part, const ScenePose& pose, std::vector<Vec3f>& points,
  std::vector<Vec3f>* normals, std::vector<Vec4f>* tangents) const
{
  const std::size_t n = part.Geometry->Positions.size();
  points.reserve(n + 1);
  this->Source->Deform(
    this->Source->Instances[std::size_t(part.Instance)], pose, this->Center, points, normals, tangents);
  points.resize(n + 1);
  for (Vec3f& p : points)
    if (!Usable(p))
      for (int c = 0; c < 3; ++c)
        p[c] = std::isnan(p[c]) ? 0 : std::max(-LargestCoordinate, std::min(LargestCoordinate, p[c]));
}

void EmbreeScene::BakeStill(Part& part, std::size_t index, const ScenePose& pose)
{
  const Mesh& mesh = *part.Geometry;
  const std::size_t n = mesh.Positions.size(), total = mesh.Indices.size() / 3;
  const Material& material = this->Source->Materials[std::size_t(part.Material)];
  if (part.Deforms)
  {
    this->BakeVertices(part, pose, part.OwnPoints, &part.OwnNormals, &part.OwnTangents);
    // what Deform clamps away is not there
    for (std::size_t i = 0; i < n; ++i)
      if (!Usable(mesh.Positions[i]))
        part.OwnPoints[i].x = std::numeric_limits<float>::quiet_NaN();
    part.Mirrored = this->Source->Mirrors(this->Source->Instances[std::size_t(part.Instance)], pose);
    part.Normals = part.OwnNormals.empty() ? nullptr : part.OwnNormals.data();
    part.Tangents = part.OwnTangents.empty() ? nullptr : part.OwnTangents.data();
  }
  else
  {
    part.World = this->Relative(part.Node >= 0 ? pose.World[std::size_t(part.Node)] : Mat4());
    if (!IsFinite(part.World))
    {
      this->Warn(this->NameOf(part) + " is left out: its matrix is not finite");
      part.World = Mat4();
      this->DroppedTriangles += std::int64_t(total);
      part.Lower = Vec3d(1e300);
      part.Upper = Vec3d(-1e300);
      return;
    }
    part.Mirrored = part.FlipTangents = part.World.Determinant3() < 0;
    NormalMatrix(part.World, part.ToNormal);
    part.Normals = mesh.Normals.size() == n && n > 0 ? mesh.Normals.data() : nullptr;
    part.Tangents = mesh.Tangents.size() == n && n > 0 ? mesh.Tangents.data() : nullptr;
    const Vec3f* shared = IsIdentity(part.World) ? Padded(mesh.Positions) : nullptr;
    if (shared)
      part.Points = &shared->x;
    else
    {
      part.OwnPoints.resize(n + 1);
      const auto bake = [&](vtkIdType from, vtkIdType to)
      {
        for (vtkIdType i = from; i < to; ++i)
          part.OwnPoints[std::size_t(i)] = Vec3f(part.World.Point(Vec3d(mesh.Positions[std::size_t(i)])));
      };
      if (n > 2 * VerticesPerTask)
        vtkSMPTools::For(0, vtkIdType(n), vtkIdType(VerticesPerTask), bake);
      else
        bake(0, vtkIdType(n));
    }
  }
  if (!part.Points)
    part.Points = &part.OwnPoints[0].x;
  const Vec3f* points = part.OwnPoints.empty() ? mesh.Positions.data() : part.OwnPoints.data();
  const bool emits = MaxComponent(this->Emissions[std::size_t(part.Material)]) > 0 && !material.Unlit;
  const Counted left =
    SelectTriangles(mesh, points, true, emits, material.DoubleSided, part.OwnCorners, part.Corners, part.Triangles);
  this->DroppedTriangles += std::int64_t(total - part.Triangles);
  const std::string text = left.Text(total);
  if (total == 0)
    this->Warn(this->NameOf(part) + " has no triangles");
  else if (!text.empty())
    this->Warn(this->NameOf(part) + ": " + text);
  part.Lower = Vec3d(1e300);
  part.Upper = Vec3d(-1e300);
  if (part.Triangles == 0)
    return;
  Enclose(points, part.Corners, part.Triangles, part.Lower, part.Upper);
  part.Handle = rtcNewGeometry(this->Device, RTC_GEOMETRY_TYPE_TRIANGLE);
  part.Form = Part::Built::Rebuilt;
  SetBuffers(part.Handle, { points }, n, part.Corners, part.Triangles);
  rtcSetGeometryUserData(part.Handle, reinterpret_cast<void*>(index));
  if (part.AlphaTested)
  {
    rtcSetGeometryIntersectFilterFunction(part.Handle, &EmbreeScene::SeeThrough);
    rtcSetGeometryOccludedFilterFunction(part.Handle, &EmbreeScene::SeeThrough);
  }
  rtcCommitGeometry(part.Handle);
  rtcAttachGeometryByID(this->Rtc, part.Handle, unsigned(index));
}

void EmbreeScene::SetShutter(double open, double close)
{
  const bool blurs = close > open && std::isfinite(open) && std::isfinite(close);
  this->ShutterOpen = blurs ? open : 0;
  this->ShutterClose = blurs ? close : 0;
}

void EmbreeScene::SetTime(double time, double previous)
{
  const bool first = !this->Posed;
  if (!first && !this->Has.Animated)
    return;
  const double start = Seconds();
  Statistics& w = this->Work;
  w.Placed = w.Baked = w.Committed = w.LightBuilds = w.Segments = 0;
  w.BakedVertices = 0;
  this->MovingSteps = 0;

  const ScenePose pose = this->Source->PoseAt(time);
  const ScenePose before = this->Has.Animated ? this->Source->PoseAt(previous) : ScenePose();
  const bool sameShutter = this->PosedOpen == this->ShutterOpen && this->PosedClose == this->ShutterClose;
  // Lights stay as they are where nothing that shines is elsewhere: what Build makes of them is the same.
  bool lights = first || !sameShutter || (this->Blurs() && time != this->Time);
  for (const PunctualLight& l : this->Source->Lights)
    lights |= first || (l.Node >= 0 && !Same(this->Nodes[std::size_t(l.Node)], pose.World[std::size_t(l.Node)]));
  this->Nodes = pose.World;
  this->PreviousNodes = this->Has.Animated ? before.World : pose.World;

  const double last = this->Time;
  this->Time = time;
  Poses poses;
  const bool blurred = this->Has.MotionBlur;
  this->Has.MotionBlur = false;
  if (!this->Movers.empty())
    lights |= this->PoseMoving(pose, before, !first && sameShutter && previous == last, poses);
  lights |= blurred != this->Has.MotionBlur;

  Vec3d lo(1e300), hi(-1e300);
  this->TriangleCount = 0;
  for (const Part& part : this->Parts)
  {
    if (part.Triangles == 0 || (part.Moves && !part.Shown))
      continue;
    this->TriangleCount += std::int64_t(part.Triangles);
    Extend(part.Lower, lo, hi);
    Extend(part.Upper, lo, hi);
  }
  this->Has.Geometry = this->TriangleCount > 0;
  this->Lower = lo + this->Center;
  this->Upper = hi + this->Center;
  if (lights)
    this->BuildLights(poses);
  this->PosedOpen = this->ShutterOpen;
  this->PosedClose = this->ShutterClose;
  this->Posed = true;
  w.PoseSeconds = Seconds() - start;
  w.BuildSteps = this->MovingSteps;
  if (first)
    w.BuildSeconds += w.PoseSeconds;
}

const ScenePose& EmbreeScene::ShutterPose(Poses& poses, int k) const
{
  const auto found = poses.find(k);
  if (found != poses.end())
    return found->second;
  const double f = double(k) / ShutterGrid;
  return poses
    .emplace(k, this->Source->PoseAt(this->Time + this->ShutterOpen + (this->ShutterClose - this->ShutterOpen) * f))
    .first->second;
}

/// Finds the number of straight segments that follow the part's motion within the shutter; 0 where it keeps still.
void EmbreeScene::PlanShutter(Part& part, const ScenePose& now, Poses& poses) const
{
  const bool deforms = part.Deforms;
  std::map<int, std::vector<Vec3f>> baked;
  const auto vertices = [&](int k) -> const std::vector<Vec3f>&
  {
    std::vector<Vec3f>& v = baked[k];
    if (v.empty())
      this->BakeVertices(part, this->ShutterPose(poses, k), v);
    return v;
  };
  std::map<int, std::array<Vec3d, 8>> boxes;
  const auto box = [&](int k) -> const std::array<Vec3d, 8>&
  {
    const auto found = boxes.find(k);
    if (found != boxes.end())
      return found->second;
    const Body& body = this->Bodies[std::size_t(part.Body)];
    const Mat4 m = this->PlaceOf(part, this->ShutterPose(poses, k));
    std::array<Vec3d, 8>& out = boxes[k];
    for (int c = 0; c < 8; ++c)
      out[std::size_t(c)] = m.Point(BoxCorner(body.Lower, body.Upper, c));
    return out;
  };

  bool still = true;
  std::vector<Vec3f> reference;
  if (deforms)
    this->BakeVertices(part, now, reference);
  for (int k = 0; k <= ShutterGrid && still; k += ShutterGrid / 4)
    still = deforms ? Same(reference, vertices(k))
                    : Same(this->PlaceOf(part, now), this->PlaceOf(part, this->ShutterPose(poses, k)));
  part.Open.Segments = 0;
  if (still)
    return;

  // Largest distance of what is at k from the middle between a and b; `size` grows to the part's largest extent.
  double size = 0;
  const auto chord = [&](int a, int k, int b)
  {
    double worst = 0;
    Vec3d lo(1e300), hi(-1e300);
    const auto look = [&](const Vec3d& p, const Vec3d& q, const Vec3d& r)
    {
      const Vec3d d = q - (p + r) * 0.5;
      const double error = Dot(d, d);
      worst = std::max(worst, std::isfinite(error) ? error : 0.);
      if (quell::IsFinite(q))
        Extend(q, lo, hi);
    };
    if (deforms)
    {
      const std::vector<Vec3f>&p = vertices(a), &q = vertices(k), &r = vertices(b);
      for (std::size_t i = 0; i + 1 < p.size(); ++i)
        look(Vec3d(p[i]), Vec3d(q[i]), Vec3d(r[i]));
    }
    else
    {
      const std::array<Vec3d, 8>&p = box(a), &q = box(k), &r = box(b);
      for (std::size_t i = 0; i < 8; ++i)
        look(p[i], q[i], r[i]);
    }
    if (lo.x <= hi.x)
      size = std::max(size, Length(hi - lo));
    return std::sqrt(worst);
  };
  const int most = deforms ? this->Settings.DeformingSegments : this->Settings.RigidSegments;
  int segments = 1;
  for (;; segments *= 2)
  {
    const int step = ShutterGrid / segments;
    double worst = 0;
    for (int k = 0; k < ShutterGrid; k += step)
      worst = std::max(worst, chord(k, k + step / 2, k + step));
    if (segments == 1) // a motion that returns may look straight from its ends and its middle
      for (int k : { 0, ShutterGrid / 2 })
        worst = std::max(worst, chord(k, k + ShutterGrid / 4, k + ShutterGrid / 2));
    if (segments >= most || worst <= this->Settings.ChordError * size)
      break;
  }
  part.Open.Segments = segments;
  for (int k = 0; k <= ShutterGrid; k += ShutterGrid / segments)
    this->ShutterPose(poses, k);
}

void EmbreeScene::Show(Part& part, bool shown)
{
  if (!part.Handle || part.Shown == shown)
    return;
  part.Shown = shown;
  if (shown)
    rtcEnableGeometry(part.Handle);
  else
    rtcDisableGeometry(part.Handle);
}

/// Makes the part's Embree geometry one of the given form.
void EmbreeScene::Attach(Part& part, std::size_t index, Part::Built form, int steps)
{
  if (part.Form == form && part.BuiltSteps == steps)
    return;
  if (part.Handle)
  {
    rtcDetachGeometry(this->Moving, unsigned(index));
    rtcReleaseGeometry(part.Handle);
  }
  part.Form = form;
  part.BuiltSteps = steps;
  part.Handle = rtcNewGeometry(
    this->Device, form == Part::Built::Instance ? RTC_GEOMETRY_TYPE_INSTANCE : RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetGeometryUserData(part.Handle, reinterpret_cast<void*>(index));
  if (form == Part::Built::Instance)
  {
    rtcSetGeometryInstancedScene(part.Handle, this->Bodies[std::size_t(part.Body)].Rtc);
    rtcSetGeometryTimeStepCount(part.Handle, unsigned(steps));
  }
  else
  {
    if (part.AlphaTested)
    {
      rtcSetGeometryIntersectFilterFunction(part.Handle, &EmbreeScene::SeeThrough);
      rtcSetGeometryOccludedFilterFunction(part.Handle, &EmbreeScene::SeeThrough);
    }
    rtcSetGeometryBuildQuality(
      part.Handle, form == Part::Built::Refitted ? RTC_BUILD_QUALITY_REFIT : RTC_BUILD_QUALITY_MEDIUM);
  }
  rtcAttachGeometryByID(this->Moving, part.Handle, unsigned(index));
  part.Shown = true;
}

struct EmbreeScene::Change
{
  bool Any = false, Broken = false;
  int Bakes = 0;
  std::vector<Vec3f> Now; ///< world vertices; empty for rigid parts
};

/// Everything about a moving part at a time but its Embree geometry and OwnPoints, which that may be reading.
void EmbreeScene::PosePart(Part& part, const ScenePose& pose, const ScenePose& previous, bool continues,
  const Poses& poses, Change& change) const
{
  const Mesh& mesh = *part.Geometry;
  const std::size_t n = mesh.Positions.size();
  const int segments = part.Open.Segments, step = segments > 0 ? ShutterGrid / segments : 0;
  const Placement before = part.Kind;
  const bool first = part.Form == Part::Built::Nothing;
  std::vector<Mat4> places;
  if (!part.Deforms)
  {
    const Body& body = this->Bodies[std::size_t(part.Body)];
    const Mat4 place = this->PlaceOf(part, pose), then = this->PlaceOf(part, previous);
    bool usable = this->CanPlace(part, place), finite = IsFinite(place);
    for (int q = 0; q <= segments && segments > 0; ++q)
    {
      places.push_back(this->PlaceOf(part, poses.at(q * step)));
      usable &= this->CanPlace(part, places.back());
      finite &= IsFinite(places.back());
    }
    change.Any = first || places.size() != part.Open.Place.size() || !Same(place, part.Place);
    for (std::size_t q = 0; q < places.size() && !change.Any; ++q)
      change.Any = !Same(places[q], part.Open.Place[q]);
    change.Broken = !finite;
    part.Place = place;
    part.Previous = then;
    part.Moved = finite && IsFinite(then) && !Same(place, then);
    part.Corners = body.Corners;
    const std::size_t triangles = finite ? body.Triangles : 0;
    change.Any |= triangles != part.Triangles;
    part.Triangles = triangles;
    part.Open.Place.swap(places);
    part.World = finite ? this->Relative(part.Node >= 0 ? pose.World[std::size_t(part.Node)] : Mat4()) : Mat4();
    part.Mirrored = part.World.Determinant3() < 0;
    part.Lower = Vec3d(1e300);
    part.Upper = Vec3d(-1e300);
    if (part.Triangles == 0)
      return;
    if (usable)
    {
      change.Any |= before != Placement::Rigid;
      part.Kind = Placement::Rigid;
      part.Points = &body.Points->x;
      part.Normals = mesh.Normals.size() == n ? mesh.Normals.data() : nullptr;
      part.Tangents = mesh.Tangents.size() == n ? mesh.Tangents.data() : nullptr;
      part.FlipTangents = part.Mirrored;
      NormalMatrix(part.World, part.ToNormal);
      for (int c = 0; c < 8; ++c)
        Extend(place.Point(BoxCorner(body.Lower, body.Upper, c)), part.Lower, part.Upper);
      return;
    }
  }
  else
    part.Mirrored = this->Source->Mirrors(this->Source->Instances[std::size_t(part.Instance)], pose);
  if (part.Triangles == 0)
    return;

  part.Kind = Placement::Baked;
  part.World = Mat4();
  part.FlipTangents = false;
  NormalMatrix(part.World, part.ToNormal);
  const bool wasBaked = before == Placement::Baked && !first;
  if (continues && wasBaked)
    part.PreviousPoints = part.OwnPoints;
  else
  {
    this->BakeVertices(part, previous, part.PreviousPoints);
    ++change.Bakes;
  }
  this->BakeVertices(part, pose, change.Now, &part.OwnNormals, &part.OwnTangents);
  ++change.Bakes;
  part.Moved = !Same(change.Now, part.PreviousPoints);
  change.Any |= !wasBaked || segments > 0 || part.BuiltSteps != 1 || !Same(change.Now, part.OwnPoints);
  part.Normals = part.OwnNormals.empty() ? nullptr : part.OwnNormals.data();
  part.Tangents = part.OwnTangents.empty() ? nullptr : part.OwnTangents.data();
  Enclose(change.Now.data(), part.Corners, part.Triangles, part.Lower, part.Upper);
  Shutter& open = part.Open;
  const std::size_t steps = segments > 0 ? std::size_t(segments) + 1 : 0;
  open.Points.resize(steps);
  open.Normals.resize(steps);
  open.Tangents.resize(steps);
  for (std::size_t q = 0; q < steps; ++q)
  {
    this->BakeVertices(part, poses.at(int(q) * step), open.Points[q], &open.Normals[q], &open.Tangents[q]);
    ++change.Bakes;
  }
}

/// Poses what moves; true when something that shines is elsewhere now.
bool EmbreeScene::PoseMoving(const ScenePose& pose, const ScenePose& previous, bool continues, Poses& poses)
{
  Statistics& w = this->Work;
  for (const std::size_t index : this->Movers)
  {
    Part& part = this->Parts[index];
    part.Open.Segments = 0;
    if (this->Blurs() && (part.Deforms ? part.Triangles : this->Bodies[std::size_t(part.Body)].Triangles) > 0)
      this->PlanShutter(part, pose, poses);
    this->Has.MotionBlur |= part.Open.Segments > 0;
    w.Segments = std::max(w.Segments, part.Open.Segments);
  }
  std::vector<Change> changes(this->Movers.size());
  const auto compute = [&](vtkIdType from, vtkIdType to)
  {
    for (vtkIdType k = from; k < to; ++k)
      this->PosePart(
        this->Parts[this->Movers[std::size_t(k)]], pose, previous, continues, poses, changes[std::size_t(k)]);
  };
  vtkSMPTools::For(0, vtkIdType(changes.size()), 1, compute);

  // Hierarchies that are refitted are built once, at the pose of time 0: what comes of them then depends on the present
  // pose alone.
  bool fresh = false;
  ScenePose rest;
  for (std::size_t k = 0; k < changes.size(); ++k)
  {
    Part& part = this->Parts[this->Movers[k]];
    if (!part.Deforms || part.Triangles == 0 || part.Open.Segments > 0 || part.Form == Part::Built::Refitted)
      continue;
    if (!fresh)
      rest = this->Source->PoseAt(0);
    fresh = true;
    this->Attach(part, this->Movers[k], Part::Built::Refitted, 1);
    this->BakeVertices(part, rest, part.OwnPoints);
    ++changes[k].Bakes;
    SetBuffers(part.Handle, { part.OwnPoints.data() }, part.Geometry->Positions.size(), part.Corners, part.Triangles);
    rtcCommitGeometry(part.Handle);
    ++w.Committed;
    changes[k].Any = true;
  }
  if (fresh)
    rtcCommitScene(this->Moving);

  bool changed = false, lights = false;
  for (std::size_t k = 0; k < changes.size(); ++k)
  {
    const std::size_t index = this->Movers[k];
    Part& part = this->Parts[index];
    Change& change = changes[k];
    if (change.Broken && !part.Warned)
    {
      part.Warned = true;
      this->Warn(this->NameOf(part) + " is left out at " + std::to_string(this->Time) + " s: its matrix is not finite");
    }
    w.Baked += change.Bakes > 0;
    w.BakedVertices += std::int64_t(change.Bakes) * std::int64_t(part.Geometry->Positions.size());
    if (!change.Any)
      continue;
    changed = true;
    lights |= MaxComponent(this->Emissions[std::size_t(part.Material)]) > 0;
    if (part.Triangles == 0)
    {
      this->Show(part, false);
      continue;
    }
    const int steps = std::max(1, part.Open.Segments + 1);
    if (part.Kind == Placement::Rigid)
    {
      this->Attach(part, index, Part::Built::Instance, steps);
      if (part.Open.Segments == 0)
        SetPlace(part.Handle, 0, part.Place);
      for (std::size_t q = 0; q < part.Open.Place.size(); ++q)
        SetPlace(part.Handle, unsigned(q), part.Open.Place[q]);
      part.OwnPoints = std::vector<Vec3f>();
      part.PreviousPoints = std::vector<Vec3f>();
      part.Open.Points.clear();
      ++w.Placed;
    }
    else
    {
      const bool refit = part.Deforms && part.Open.Segments == 0;
      if (!refit)
        this->Attach(part, index, Part::Built::Rebuilt, steps);
      if (part.OwnPoints.size() == change.Now.size())
        std::copy(change.Now.begin(), change.Now.end(), part.OwnPoints.begin());
      else
        part.OwnPoints = change.Now;
      part.Points = &part.OwnPoints[0].x;
      if (refit)
        rtcUpdateGeometryBuffer(part.Handle, RTC_BUFFER_TYPE_VERTEX, 0);
      else
      {
        std::vector<const Vec3f*> buffers;
        for (const std::vector<Vec3f>& points : part.Open.Points)
          buffers.push_back(points.data());
        if (buffers.empty())
          buffers.push_back(part.OwnPoints.data());
        SetBuffers(part.Handle, buffers, part.Geometry->Positions.size(), part.Corners, part.Triangles);
      }
    }
    this->Show(part, true);
    rtcCommitGeometry(part.Handle);
    ++w.Committed;
  }
  if (changed || fresh)
    rtcCommitScene(this->Moving);
  Check(this->Device);
  return lights;
}

PlacedLight EmbreeScene::PlaceLamp(const PunctualLight& p, const Mat4& m) const
{
  PlacedLight l;
  l.Type = p.Type;
  l.Position = Vec3f(Vec3d(m.m[0][3], m.m[1][3], m.m[2][3]) - this->Center);
  l.Direction = Vec3f(Normalized(m.Direction({ 0, 0, -1 })));
  l.Intensity = Radiance(p.Intensity);
  l.Range = std::isfinite(p.Range) && p.Range > 0 ? p.Range : 0;
  l.CosInner = std::cos(p.InnerCone);
  l.CosOuter = std::cos(p.OuterCone);
  return l;
}

void EmbreeScene::BuildLights(Poses& poses)
{
  const Scene& s = *this->Source;
  ++this->Work.LightBuilds;
  std::vector<LightTriangle> triangles;
  std::vector<Vec3f> average;
  std::vector<double> weights; // of what moves within the shutter
  this->BlurredTriangles.clear();
  this->BlurredLamps.clear();
  for (std::size_t g = 0; g < this->Parts.size(); ++g)
  {
    Part& part = this->Parts[g];
    part.LightIndex.clear();
    const Material& m = s.Materials[std::size_t(part.Material)];
    const Vec3f factor = this->Emissions[std::size_t(part.Material)];
    if (!(MaxComponent(factor) > 0) || m.Unlit || (part.Moves && !part.Shown))
      continue;
    const bool textured = m.EmissiveTexture.Texture >= 0 || part.AlphaTested;
    part.LightIndex.assign(part.Triangles, -1);
    for (std::size_t t = 0; t < part.Triangles; ++t)
    {
      const std::uint32_t primitive = std::uint32_t(t);
      Vec3f mean = factor;
      if (textured)
      {
        // The mean over 16 points, and never 0: what is not seen at the points may still shine between them.
        mean = factor * 0.05f;
        for (int i = 0; i < 4; ++i)
          for (int j = 0; j < 4; ++j)
          {
            const float r = std::sqrt((i + 0.5f) / 4), u = 1 - r, v = (j + 0.5f) / 4 * r;
            mean += this->EmissionAt(part, primitive, u, v) * (1.f / 16);
          }
      }
      Vec3d p[3];
      this->CornersAt(part, primitive, -1, p);
      const Vec3d cross = Cross(p[1] - p[0], p[2] - p[0]) * (part.Mirrored ? -1. : 1.);
      float largest = 0;
      for (const Vec3d& corner : p)
        for (int c = 0; c < 3; ++c)
          largest = std::max(largest, float(std::fabs(corner[c])));
      if (part.Open.Segments > 0)
      {
        MovingTriangle l;
        l.Geometry = std::uint32_t(g);
        l.Primitive = primitive;
        l.Emission = factor;
        l.Offset = largest * OffsetScale;
        l.TwoSided = m.DoubleSided;
        l.Textured = textured;
        const double weight = Length(cross) / 2 * Luminance(Vec3d(mean)) * (m.DoubleSided ? 2 : 1);
        part.LightIndex[t] = std::int32_t(this->BlurredTriangles.size()); // behind the others, see below
        this->BlurredTriangles.push_back(l);
        weights.push_back(std::isfinite(weight) ? weight : 0);
        continue;
      }
      LightTriangle l;
      l.V0 = Vec3f(p[0]);
      l.E1 = Vec3f(p[1]) - l.V0;
      l.E2 = Vec3f(p[2]) - l.V0;
      l.N = Vec3f(Normalized(cross));
      if (l.N == Vec3f()) // no area now: it is found by no ray, but the index is kept simple
        continue;
      l.Offset = largest * OffsetScale;
      l.Emission = factor;
      l.TwoSided = m.DoubleSided;
      l.Textured = textured;
      l.Geometry = std::uint32_t(g);
      l.Primitive = primitive;
      part.LightIndex[t] = std::int32_t(triangles.size());
      triangles.push_back(l);
      average.push_back(mean);
    }
  }

  std::vector<PlacedLight> lights;
  std::vector<double> lampWeights;
  for (std::size_t i = 0; i < s.Lights.size(); ++i)
  {
    const PunctualLight& p = s.Lights[i];
    const PlacedLight l = this->PlaceLamp(p, this->NodeMatrix(p.Node, false));
    const std::string name = Quoted("light", p.Name, int(i));
    if (!quell::IsFinite(l.Position) || l.Direction == Vec3f() || l.Intensity != p.Intensity)
    {
      const std::string text = l.Intensity != p.Intensity
                                 ? name + ": its intensity is negative or not a number; taken as 0"
                                 : name + " is left out: its place or direction is not finite";
      if (std::find(this->Warnings.begin(), this->Warnings.end(), text) == this->Warnings.end())
        this->Warn(text);
    }
    if (!quell::IsFinite(l.Position) || l.Direction == Vec3f())
      continue;
    bool still = true;
    if (this->Blurs() && p.Node >= 0)
      for (int q = 0; q <= ShutterGrid && still; q += ShutterGrid / 4)
        still = Same(this->Nodes[std::size_t(p.Node)], this->ShutterPose(poses, q).World[std::size_t(p.Node)]);
    if (still)
    {
      lights.push_back(l);
      continue;
    }
    MovingLamp lamp;
    for (int q = 0; q <= LampSegments; ++q)
    {
      const PlacedLight at =
        this->PlaceLamp(p, this->ShutterPose(poses, q * (ShutterGrid / LampSegments)).World[std::size_t(p.Node)]);
      lamp.At.push_back(quell::IsFinite(at.Position) && at.Direction != Vec3f() ? at : l);
    }
    const double power = Luminance(Vec3d(l.Intensity)) / Pi;
    const double weight = power * (l.Type == LightType::Directional ? Pi * this->Radius * this->Radius
                                    : l.Type == LightType::Spot     ? 2 * Pi * (1 - double(l.CosOuter))
                                                                    : 4 * Pi);
    this->BlurredLamps.push_back(lamp);
    lampWeights.push_back(std::isfinite(weight) ? weight : 0);
    this->Has.MotionBlur = true;
  }
  const std::size_t before = triangles.size();
  this->LightSource.Build(std::move(triangles), average, std::move(lights), s, float(this->Radius));
  const std::size_t still = this->LightSource.GetTriangles().size();

  weights.insert(weights.end(), lampWeights.begin(), lampWeights.end());
  double total = 0;
  for (const double weight : weights)
    total += weight;
  const bool any = total > 0 && std::isfinite(total);
  if (!any)
  {
    this->BlurredTriangles.clear();
    this->BlurredLamps.clear();
    weights.clear();
  }
  this->BlurredCdf.clear();
  double sum = 0;
  for (const double weight : weights)
    this->BlurredCdf.push_back((sum += weight) / total);
  if (any)
    this->BlurredCdf.back() = 1;
  this->Has.MovingLights = any;
  this->MovingShare = any ? (this->LightSource.Empty() ? 1.f : 0.5f) : 0.f;
  for (Part& part : this->Parts)
  {
    if (part.LightIndex.empty())
      continue;
    if (part.Open.Segments > 0 && any)
      for (std::int32_t& index : part.LightIndex)
        index += std::int32_t(still);
    else if (part.Open.Segments > 0 || still != before)
      part.LightIndex.clear();
  }
}

bool EmbreeScene::DrawMoving(
  const Receiver& at, float time, float pick, float u, float v, LightSampler::Sample& out) const noexcept
{
  if (pick >= this->MovingShare)
  {
    const float rest = 1 - this->MovingShare;
    if (!this->LightSource.Draw(at, std::min(0x1.fffffep-1f, (pick - this->MovingShare) / rest), u, v, out))
      return false;
    out.Pdf *= rest;
    return out.Pdf > 0;
  }
  const double scaled = double(pick) / double(this->MovingShare);
  const std::size_t i = std::min(this->BlurredCdf.size() - 1,
    std::size_t(std::upper_bound(this->BlurredCdf.begin(), this->BlurredCdf.end(), scaled) - this->BlurredCdf.begin()));
  const double chance = this->BlurredCdf[i] - (i > 0 ? this->BlurredCdf[i - 1] : 0.);
  const float share = float(this->MovingShare * chance);
  if (i >= this->BlurredTriangles.size())
  {
    const MovingLamp& lamp = this->BlurredLamps[i - this->BlurredTriangles.size()];
    double f;
    const int k = Segment(time, LampSegments, f);
    const PlacedLight &a = lamp.At[std::size_t(k)], &b = lamp.At[std::size_t(k) + 1];
    PlacedLight l = a;
    l.Position = Vec3f(Vec3d(a.Position) + (Vec3d(b.Position) - Vec3d(a.Position)) * f);
    const Vec3d direction = Normalized(Vec3d(a.Direction) * (1 - f) + Vec3d(b.Direction) * f);
    l.Direction = direction == Vec3d() ? a.Direction : Vec3f(direction);
    return this->LightSource.DrawPunctual(l, at.Position, share, out);
  }
  const MovingTriangle& t = this->BlurredTriangles[i];
  const Part& part = this->Parts[t.Geometry];
  Vec3d p[3];
  this->CornersAt(part, t.Primitive, time, p);
  const float b0 = u < v ? u / 2 : u - v / 2, b1 = u < v ? v - u / 2 : v / 2; // Heitz (2019): uniform
  const Vec3d e1 = p[1] - p[0], e2 = p[2] - p[0], cross = Cross(e1, e2) * (part.Mirrored ? -1. : 1.);
  const double twice = Length(cross);
  const Vec3d y = p[0] + e1 * double(b0) + e2 * double(b1);
  const Vec3d d = y - Vec3d(at.Position);
  const double distance2 = Dot(d, d);
  if (!(twice > 0) || !(distance2 > 0) || !std::isfinite(distance2))
    return false;
  const Vec3f normal(cross / twice);
  out.Wi = Vec3f(d / std::sqrt(distance2));
  const float cosine = -Dot(normal, out.Wi);
  if (!(std::fabs(cosine) > 1e-6f) || (cosine < 0 && !t.TwoSided))
    return false;
  out.Kind = LightSampler::Sample::From::Triangle;
  out.AtInfinity = false;
  out.Target = Vec3f(y) + normal * (cosine < 0 ? -t.Offset : t.Offset);
  out.Emission = t.Emission;
  out.Textured = t.Textured;
  out.Geometry = t.Geometry;
  out.Primitive = t.Primitive;
  out.U = b0;
  out.V = b1;
  out.Pdf = float(double(share) * 2 / twice * distance2) / std::fabs(cosine);
  return out.Pdf > 0 && std::isfinite(out.Pdf);
}

float EmbreeScene::MovingPdf(
  int light, const SurfaceHit& hit, const Receiver& from, float distance2, float cosine) const noexcept
{
  const std::size_t still = this->LightSource.GetTriangles().size();
  if (std::size_t(light) < still)
    return this->LightSource.TrianglePdf(std::uint32_t(light), from, distance2, cosine) * (1 - this->MovingShare);
  const std::size_t i = std::size_t(light) - still;
  const double chance = this->BlurredCdf[i] - (i > 0 ? this->BlurredCdf[i - 1] : 0.);
  Vec3d p[3];
  this->CornersAt(this->Parts[hit.Geometry], hit, p);
  const double twice = Length(Cross(p[1] - p[0], p[2] - p[0]));
  if (!(cosine > 1e-6f) || !(twice > 0))
    return 0;
  return float(double(float(this->MovingShare * chance)) * 2 / twice * double(distance2)) / cosine;
}

void EmbreeScene::CornersAt(const Part& part, std::uint32_t primitive, float time, Vec3d (&p)[3]) const noexcept
{
  const std::uint32_t* v = &part.Corners[3 * std::size_t(primitive)];
  const bool blurred = time >= 0 && part.Open.Segments > 0;
  double f = 0;
  const std::size_t k = blurred ? std::size_t(Segment(time, part.Open.Segments, f)) : 0;
  if (part.Kind == Placement::Baked && blurred)
  {
    const Vec3f *a = part.Open.Points[k].data(), *b = part.Open.Points[k + 1].data();
    for (int c = 0; c < 3; ++c)
      p[c] = Vec3d(a[v[c]]) + (Vec3d(b[v[c]]) - Vec3d(a[v[c]])) * f;
    return;
  }
  for (int c = 0; c < 3; ++c)
    p[c] = Vec3d(Corner(part, v[c]));
  if (part.Kind != Placement::Rigid)
    return;
  if (blurred)
  {
    const Mat4 m = Mix(part.Open.Place[k], part.Open.Place[k + 1], f);
    for (int c = 0; c < 3; ++c)
      p[c] = m.Point(p[c]);
  }
  else
    for (int c = 0; c < 3; ++c)
      p[c] = part.Place.Point(p[c]);
}

void EmbreeScene::Locate(const Part& part, SurfaceHit& hit, const Vec3f& direction) const noexcept
{
  Vec3d p[3];
  this->CornersAt(part, hit, p);
  const Vec3d e1 = p[1] - p[0], e2 = p[2] - p[0];
  hit.P = p[0] + e1 * double(hit.U) + e2 * double(hit.V);
  hit.Pf = Vec3f(hit.P);
  const Vec3d n = Normalized(Cross(e1, e2) * (part.Mirrored ? -1. : 1.));
  hit.Ng = n == Vec3d() ? -direction : Vec3f(n); // a triangle that lost its area just now
  hit.Front = Dot(hit.Ng, direction) < 0;
  float largest = 0;
  for (const Vec3d& corner : p)
    for (int c = 0; c < 3; ++c)
      largest = std::max(largest, float(std::fabs(corner[c])));
  if (part.Kind == Placement::Rigid)
    for (int c = 0; c < 3; ++c)
      largest = std::max(largest, float(std::fabs(part.Place.m[c][3])));
  hit.Offset = largest * OffsetScale;
}

bool EmbreeScene::NormalAt(const Part& part, const SurfaceHit& hit, Vec3f& n) const noexcept
{
  if (!part.Normals)
    return false;
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  const float w = 1 - hit.U - hit.V;
  const auto between = [&](const Vec3f* list) { return list[v[0]] * w + list[v[1]] * hit.U + list[v[2]] * hit.V; };
  if (part.Open.Segments == 0)
  {
    const Vec3f m = between(part.Normals);
    for (int i = 0; i < 3; ++i)
      n[i] = part.ToNormal[i][0] * m.x + part.ToNormal[i][1] * m.y + part.ToNormal[i][2] * m.z;
  }
  else
  {
    double f;
    const std::size_t k = std::size_t(Segment(hit.Time, part.Open.Segments, f));
    if (part.Kind == Placement::Baked)
      n = between(part.Open.Normals[k].data()) * float(1 - f) + between(part.Open.Normals[k + 1].data()) * float(f);
    else
      n = Vec3f(Normalized(Mix(part.Open.Place[k], part.Open.Place[k + 1], f).Normal(Vec3d(between(part.Normals)))));
  }
  return n != Vec3f() && quell::IsFinite(n);
}

bool EmbreeScene::TangentAt(const Part& part, const SurfaceHit& hit, Vec3d& t, double& handed) const noexcept
{
  if (!part.Tangents)
    return false;
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  const float w = 1 - hit.U - hit.V;
  const auto between = [&](const Vec4f* list)
  { return list[v[0]].xyz() * w + list[v[1]].xyz() * hit.U + list[v[2]].xyz() * hit.V; };
  handed = (part.Tangents[v[0]].w < 0) != part.FlipTangents ? -1 : 1;
  if (part.Open.Segments == 0)
    t = part.World.Direction(Vec3d(between(part.Tangents)));
  else
  {
    double f;
    const std::size_t k = std::size_t(Segment(hit.Time, part.Open.Segments, f));
    if (part.Kind == Placement::Baked)
      t = Vec3d(between(part.Open.Tangents[k].data())) * (1 - f) + Vec3d(between(part.Open.Tangents[k + 1].data())) * f;
    else
      t = Mix(part.Open.Place[k], part.Open.Place[k + 1], f).Direction(Vec3d(between(part.Tangents)));
  }
  return true;
}

bool EmbreeScene::PreviousPosition(const SurfaceHit& hit, Vec3d& p) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  if (!part.Moved)
    return false;
  const std::uint32_t* v = &part.Corners[3 * std::size_t(hit.Primitive)];
  Vec3d c[3];
  for (int k = 0; k < 3; ++k)
    c[k] =
      part.Kind == Placement::Baked ? Vec3d(part.PreviousPoints[v[k]]) : part.Previous.Point(Vec3d(Corner(part, v[k])));
  p = c[0] + (c[1] - c[0]) * double(hit.U) + (c[2] - c[0]) * double(hit.V);
  return true;
}

Vec3d EmbreeScene::ReferencePosition(const SurfaceHit& hit) const noexcept
{
  const Part& part = this->Parts[hit.Geometry];
  if (part.Open.Segments == 0)
    return hit.P;
  Vec3d c[3];
  this->CornersAt(part, hit.Primitive, -1, c);
  return c[0] + (c[1] - c[0]) * double(hit.U) + (c[2] - c[0]) * double(hit.V);
}
}
