// SPDX-License-Identifier: BSD-3-Clause
// Parts that move: poses, the shutter, refitting.
#include "quellEmbreeParts.h"
#include "quellMaterial.h"

namespace quell
{
using namespace parts;

void EmbreeScene::SetShutter(double open, double close)
{
  const bool blurs = close > open && std::isfinite(open) && std::isfinite(close);
  this->ShutterOpen = blurs ? open : 0;
  this->ShutterClose = blurs ? close : 0;
}

void EmbreeScene::SetTime(double time, double previous)
{
  const bool first = !this->HasPose;
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
  this->LookAtParts();
  this->ListTriangles();
  this->PosedOpen = this->ShutterOpen;
  this->PosedClose = this->ShutterClose;
  this->HasPose = true;
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
    rtcDetachGeometry(this->Posed, unsigned(index));
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
    SetFilters(part.Handle, part);
    rtcSetGeometryBuildQuality(
      part.Handle, form == Part::Built::Refitted ? RTC_BUILD_QUALITY_REFIT : RTC_BUILD_QUALITY_MEDIUM);
  }
  rtcAttachGeometryByID(this->Posed, part.Handle, unsigned(index));
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
  part.InPlace = false;
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
      part.Normals = mesh.Normals.size() == n ? mesh.Normals.data() : nullptr;
      part.Tangents = mesh.Tangents.size() == n ? mesh.Tangents.data() : nullptr;
      part.FlipTangents = part.Mirrored;
      NormalMatrix(part.World, part.ToNormal);
      for (int c = 0; c < 8; ++c)
        Extend(place.Point(BoxCorner(body.Lower, body.Upper, c)), part.Lower, part.Upper);
      part.InPlace = this->BakesRigid && segments == 0 && !Rounded(part.Lower, part.Upper);
      part.Kind = part.InPlace ? Placement::Baked : Placement::Rigid;
      change.Any |= before != part.Kind;
      if (!part.InPlace)
      {
        part.Points = &body.Points->x;
        return;
      }
      const auto bake = [&](const Mat4& m, std::vector<Vec3f>& points)
      {
        points.resize(n + 1);
        for (std::size_t i = 0; i < n; ++i)
          points[i] = Vec3f(m.Point(Vec3d(body.Points[i])));
      };
      bake(place, change.Now);
      part.Open.Points.clear();
      if (part.Moved)
        bake(then, part.PreviousPoints);
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
  const bool wasBaked = part.Deforms && before == Placement::Baked && !first;
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
    rtcCommitScene(this->Posed);

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
    rtcCommitScene(this->Posed);
  if (this->Moving && (changed || fresh))
  {
    rtcGetSceneBounds(this->Moving, &this->MovingBox);
    // Wider by more than what rounding can do to slabs, and never flat.
    const auto widen = [](float& low, float& high)
    {
      if (!(low <= high))
        return;
      const float margin = 1e-5f * std::max({ high - low, std::fabs(low), std::fabs(high) }) + 1e-30f;
      low -= margin;
      high += margin;
    };
    widen(this->MovingBox.lower_x, this->MovingBox.upper_x);
    widen(this->MovingBox.lower_y, this->MovingBox.upper_y);
    widen(this->MovingBox.lower_z, this->MovingBox.upper_z);
  }
  Check(this->Device);
  return lights;
}
}
