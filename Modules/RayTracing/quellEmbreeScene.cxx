// SPDX-License-Identifier: BSD-3-Clause
// From a scene to its parts: placement, bodies that are shared, what never moves.
#include "quellEmbreeParts.h"
#include "quellMaterial.h"

namespace quell
{
using namespace parts;

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

  this->LayOutTexels();

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
    part.OneSided = options.HideBackFaces && !m.DoubleSided && !MayTransmit(m);
    const auto used = [&](const TextureUse& u) { return u.Texture >= 0 && u.Texture < int(s.Textures.size()); };
    for (const TextureUse* use : TexturesOf(m))
      part.Textured |= used(*use);
    part.Plain = !part.Textured && mesh.Colors.empty();
    const Surface& surface = this->Surfaces[std::size_t(mesh.Material)];
    this->Has.Textures |= part.Textured;
    this->Has.Glossy |= surface.HasSpecular || surface.NeedsChoice();
    this->Has.Glass |= MayTransmit(m);
    this->Has.Volumes |= m.Volume && MayTransmit(m);
    this->Has.SeeThrough |= part.AlphaTested;
    part.Pane = MayBePane(m, surface);
    this->Has.Panes |= part.Pane;
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

#if defined(__SANITIZE_THREAD__)
  // Embree hands work to TBB's threads unseen by ThreadSanitizer: there it builds on the calling thread.
  this->Device = rtcNewDevice("threads=1");
#else
  this->Device = rtcNewDevice(nullptr);
#endif
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
        part.Body = this->MakeBody(mesh, part);
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
      part.Body = this->MakeBody(mesh, part);
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
  this->HouseMovers();
  rtcCommitScene(this->Rtc);
  Check(this->Device);
  this->Work.BuildSeconds = Seconds() - start;
}

/// Where the parts that move will live.
void EmbreeScene::HouseMovers()
{
  if (this->Movers.empty())
    return;
  std::int64_t rigid = 0, all = 0;
  for (const Part& part : this->Parts)
  {
    const std::int64_t own =
      std::int64_t(part.Moves && !part.Deforms ? this->Bodies[std::size_t(part.Body)].Triangles : part.Triangles);
    rigid += part.Moves && !part.Deforms ? own : 0;
    all += own;
  }
  this->BakesRigid = rigid <= this->Settings.RebuiltTriangles;
  this->Posed = this->Rtc;
  if (all > this->Settings.RebuiltTriangles)
  {
    this->Posed = this->Moving = rtcNewScene(this->Device);
    rtcSetSceneFlags(this->Moving, RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC));
    // Embree keeps a hierarchy per geometry, and looks at its own quality, in scenes of low quality only; in others it
    // builds one of all triangles at every commit, dynamic or not.
    rtcSetSceneBuildQuality(this->Moving, RTC_BUILD_QUALITY_LOW);
  }
  rtcSetSceneProgressMonitorFunction(
    this->Posed,
    [](void* self, double)
    {
      ++static_cast<EmbreeScene*>(self)->MovingSteps;
      return true;
    },
    this);
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
  for (const auto& table : this->TexelTables)
    out.Bytes += std::int64_t(table->Bytes());
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

void EmbreeScene::SetFilters(RTCGeometry geometry, const Part& part)
{
  if (part.AlphaTested || part.OneSided)
    rtcSetGeometryIntersectFilterFunction(geometry, &EmbreeScene::SeeThrough);
  if (part.AlphaTested || part.OneSided || part.Pane)
    rtcSetGeometryOccludedFilterFunction(geometry, part.Pane ? &EmbreeScene::PassPanes : &EmbreeScene::SeeThrough);
}

int EmbreeScene::MakeBody(int mesh, const Part& part)
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
  SetFilters(geometry, part);
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
  part.InPlace = true;
  Enclose(points, part.Corners, part.Triangles, part.Lower, part.Upper);
  part.Handle = rtcNewGeometry(this->Device, RTC_GEOMETRY_TYPE_TRIANGLE);
  part.Form = Part::Built::Rebuilt;
  SetBuffers(part.Handle, { points }, n, part.Corners, part.Triangles);
  rtcSetGeometryUserData(part.Handle, reinterpret_cast<void*>(index));
  SetFilters(part.Handle, part);
  rtcCommitGeometry(part.Handle);
  rtcAttachGeometryByID(this->Rtc, part.Handle, unsigned(index));
}
}
