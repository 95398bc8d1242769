// SPDX-License-Identifier: BSD-3-Clause
// Posing, deformation, motion blur and unusable geometry.
#include "SceneBuilder.h"
#include "quellEmbreeScene.h"
#include "quellIntegrator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <set>

using namespace quell;

namespace
{
constexpr double Turn = 6.283185307179586;

/// Adds a channel that moves `node`.
void Animate(Scene& s, int node, AnimatedPath path, std::vector<float> times, std::vector<float> values)
{
  AnimationChannel c;
  c.Node = node;
  c.Path = path;
  c.Times = std::move(times);
  c.Values = std::move(values);
  s.Animation.push_back(c);
}

std::vector<float> AboutZ(double angle)
{
  return { 0, 0, float(std::sin(angle / 2)), float(std::cos(angle / 2)) };
}

std::vector<float> Join(std::vector<float> a, const std::vector<float>& b)
{
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// A wavy sheet in z = 0 over [-1, 1]^2.
void Sheet(SceneBuilder& b, int material, int n, Vec3f shift = {})
{
  std::vector<Vec3f> p, normals;
  std::vector<std::uint32_t> t;
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i)
    {
      const float x = 2.f * float(i) / float(n) - 1, y = 2.f * float(j) / float(n) - 1;
      p.push_back(Vec3f{ x, y, 0.05f * std::sin(7 * x) * std::cos(5 * y) } + shift);
      normals.push_back({ 0, 0, 1 });
    }
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i)
    {
      const auto at = [&](int a, int c) { return std::uint32_t(c * (n + 1) + a); };
      t.insert(t.end(), { at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j), at(i + 1, j + 1), at(i, j + 1) });
    }
  b.AddMesh(material, p, t).Normals = normals;
}

/// A sheet with two targets, whose weights change.
SceneBuilder Morphing(int n = 12)
{
  SceneBuilder b;
  Sheet(b, b.Add(SceneBuilder::Lambert(.5f)), n);
  Mesh& mesh = b.Scene->Meshes.back();
  for (int k = 0; k < 2; ++k)
  {
    MorphTarget t;
    for (const Vec3f& p : mesh.Positions)
    {
      t.Positions.push_back(k == 0 ? Vec3f{ 0.2f * p.y, 0, 0.3f * p.x * p.x } : Vec3f{ 0, 0.2f, -0.2f * p.y });
      t.Normals.push_back(k == 0 ? Vec3f{ -0.4f * p.x, 0, 0 } : Vec3f{ 0, 0.1f, 0 });
    }
    mesh.Targets.push_back(t);
  }
  b.Scene->Nodes.back().Weights = { 0, 0 };
  Animate(*b.Scene, 0, AnimatedPath::Weights, { 0, 4, 8 }, { 0, 0, 1, .5f, -.5f, 1 });
  return b;
}

/// A sheet whose right half bends with a joint.
SceneBuilder Skinned(int n = 12)
{
  SceneBuilder b;
  Sheet(b, b.Add(SceneBuilder::Lambert(.5f)), n);
  Mesh& mesh = b.Scene->Meshes.back();
  mesh.Influences = 4;
  for (const Vec3f& p : mesh.Positions)
  {
    const float w = std::min(1.f, std::max(0.f, p.x + .5f));
    mesh.Joints.insert(mesh.Joints.end(), { 0, 1, 0, 0 });
    mesh.JointWeights.insert(mesh.JointWeights.end(), { 1 - w, w, 0, 0 });
  }
  Scene& s = *b.Scene;
  for (int k = 0; k < 2; ++k)
  {
    s.Nodes.emplace_back();
    s.Nodes.back().Name = k == 0 ? "root" : "elbow";
  }
  s.Nodes[2].Parent = 1;
  s.Nodes[1].Children = { 2 };
  Skin skin;
  skin.Joints = { 1, 2 };
  skin.InverseBind.resize(2);
  s.Skins.push_back(skin);
  s.Nodes[0].Skin = 0;
  Animate(s, 2, AnimatedPath::Rotation, { 0, 8 }, { 0, 0, 0, 1, 0, float(std::sin(.6)), 0, float(std::cos(.6)) });
  Animate(s, 1, AnimatedPath::Translation, { 0, 8 }, { 0, 0, 0, .3f, .2f, .1f });
  return b;
}

/// A small box that goes from x = 0 to 8 in 8 seconds and turns once.
SceneBuilder Rigid()
{
  SceneBuilder b;
  b.Box(b.Add(SceneBuilder::Lambert(.5f)), { -.5f, -.4f, -.3f }, { .5f, .4f, .3f });
  Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 8 }, { 0, 0, 0, 1, .5f, 0 });
  Animate(*b.Scene, 0, AnimatedPath::Rotation, { 0, 4, 8 }, Join(Join(AboutZ(0), AboutZ(2)), AboutZ(4)));
  return b;
}

struct Eye
{
  Vec3d At{ .3, .2, 4 };
  /// Ray through the plane z = 0 at (x, y), scaled to distance 1 there.
  TraceRay To(const EmbreeScene& scene, const Vec3d& target, float time = 0) const
  {
    TraceRay r;
    r.Origin = Vec3f(this->At - scene.Origin());
    r.Direction = Vec3f(Normalized(target - this->At));
    r.Time = time;
    return r;
  }
};

/// The hit of every ray to a grid over [-1.5, 1.5]^2 in z = 0.
void ForEachHit(
  const EmbreeScene& scene, int n, const std::function<void(const TraceRay&, const SurfaceHit&)>& f, float time = 0)
{
  EmbreeScene::Context context;
  scene.Begin(context);
  const Eye eye;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i)
    {
      const TraceRay ray = eye.To(scene, { 3. * (i + .37) / n - 1.5, 3. * (j + .61) / n - 1.5, 0 }, time);
      SurfaceHit hit;
      if (scene.Intersect(context, ray, hit))
        f(ray, hit);
    }
}

/// Nearest hit of a ray among triangles, in double.
bool BruteForce(const std::vector<Vec3f>& p, const std::vector<std::uint32_t>& index, const TraceRay& ray, Vec3d& at)
{
  double best = 1e300;
  const Vec3d o(ray.Origin), d(ray.Direction);
  for (std::size_t t = 0; t + 2 < index.size(); t += 3)
  {
    const Vec3d a(p[index[t]]), e1 = Vec3d(p[index[t + 1]]) - a, e2 = Vec3d(p[index[t + 2]]) - a, q = Cross(d, e2);
    const double det = Dot(e1, q);
    if (det == 0)
      continue;
    const Vec3d s = o - a, r = Cross(s, e1);
    const double u = Dot(s, q) / det, v = Dot(d, r) / det, k = Dot(e2, r) / det;
    if (u >= 0 && v >= 0 && u + v <= 1 && k > 0 && k < best)
      best = k;
  }
  at = o + d * best;
  return best < 1e300;
}

struct Picture
{
  std::vector<std::uint32_t> Bits;
  int Hits = 0;
};
/// Everything about the hits of rays to a grid, and of rays exactly at corners and edges of triangles, where two hits
/// are equal.
Picture Hits(const EmbreeScene& scene)
{
  Picture out;
  const auto keep = [&](const SurfaceHit& h)
  {
    const float f[] = { h.Pf.x, h.Pf.y, h.Pf.z, h.Ng.x, h.Ng.y, h.Ng.z, h.T, h.U, h.V, h.Offset };
    for (float x : f)
    {
      std::uint32_t bits;
      std::memcpy(&bits, &x, 4);
      out.Bits.push_back(bits);
    }
    out.Bits.push_back(h.Geometry);
    out.Bits.push_back(h.Primitive);
    SurfacePoint point;
    scene.Shade(h, Vec3f{ 0, 0, -1 }, point);
    for (int c = 0; c < 3; ++c)
    {
      const float x = point.Normals.Shading[c];
      std::uint32_t bits;
      std::memcpy(&bits, &x, 4);
      out.Bits.push_back(bits);
    }
    ++out.Hits;
  };
  ForEachHit(scene, 150, [&](const TraceRay&, const SurfaceHit& h) { keep(h); });
  EmbreeScene::Context context;
  scene.Begin(context);
  const Scene& s = scene.GetScene();
  for (const Mesh& mesh : s.Meshes)
    for (std::size_t i = 0; i + 1 < mesh.Positions.size(); ++i)
      for (int half = 0; half < 2; ++half)
      {
        TraceRay ray;
        const Vec3f to = half ? (mesh.Positions[i] + mesh.Positions[i + 1]) * .5f : mesh.Positions[i];
        ray.Origin = Vec3f{ 0, 0, 4 };
        ray.Direction = to - ray.Origin;
        SurfaceHit hit;
        if (scene.Intersect(context, ray, hit))
          keep(hit);
      }
  return out;
}
}

TEST(Geometry, DeformedHitsAreWhereDeformPutsTheVertices)
{
  for (const SceneBuilder& b : { Morphing(), Skinned(), Rigid() })
    for (double time : { 0., 2.5, 6. })
    {
      EmbreeScene scene(b.Scene);
      scene.SetTime(time, time - 1);
      std::vector<Vec3f> p, normals;
      b.Scene->Deform(b.Scene->Instances[0], b.Scene->PoseAt(time), scene.Origin(), p, &normals, nullptr);
      int hits = 0;
      ForEachHit(scene, 40,
        [&](const TraceRay& ray, const SurfaceHit& hit)
        {
          Vec3d at;
          if (!BruteForce(p, b.Scene->Meshes[0].Indices, ray, at))
            return; // a ray along the rim
          ++hits;
          EXPECT_LT(Length(at - hit.P), 2e-6);
          if (normals.empty())
            return;
          const std::uint32_t* v = &b.Scene->Meshes[0].Indices[3 * hit.Primitive];
          const Vec3f n =
            Normalized(normals[v[0]] * (1 - hit.U - hit.V) + normals[v[1]] * hit.U + normals[v[2]] * hit.V);
          SurfacePoint point;
          scene.Shade(hit, ray.Direction, point);
          const float side = Dot(n, point.Normals.Geometric) < 0 ? -1.f : 1.f;
          EXPECT_LT(Length(n * side - point.Normals.Shading), 1e-5);
        });
      EXPECT_GT(hits, 100);
    }
}

TEST(Geometry, MotionLeadsToThePreviousPicture)
{
  int k = 0;
  for (const SceneBuilder& b : { Rigid(), Skinned(), Morphing() })
  {
    const double time = 5, frame = 0.25;
    EmbreeScene now(b.Scene), then(b.Scene);
    now.SetTime(time, time - frame);
    then.SetTime(time - frame, time - 2 * frame);
    const Eye eye;
    EmbreeScene::Context context;
    then.Begin(context);
    int checked = 0, hidden = 0;
    double longest = 0;
    ForEachHit(now, 60,
      [&](const TraceRay&, const SurfaceHit& hit)
      {
        Vec3d before;
        ASSERT_TRUE(now.PreviousPosition(hit, before));
        longest = std::max(longest, Length(before - hit.P));
        SurfaceHit old;
        if (!then.Intersect(context, eye.To(then, before + then.Origin()), old))
          return;
        // the same place, unless something else hid it or float missed the edge
        if (old.Primitive == hit.Primitive)
        {
          EXPECT_LT(Length(old.P - before), 5e-6);
          EXPECT_NEAR(old.U, hit.U, 2e-4);
          ++checked;
        }
        else
          ++hidden;
      });
    EXPECT_GT(checked, 200) << k;
    EXPECT_LT(hidden, checked / 4) << k;
    EXPECT_GT(longest, 0.01) << k;
    ++k;
  }
}

TEST(Geometry, WhatStandsStillHasNoPreviousPosition)
{
  SceneBuilder b = Rigid();
  EmbreeScene scene(b.Scene);
  scene.SetTime(20, 19); // after the last key
  ForEachHit(scene, 20,
    [&](const TraceRay&, const SurfaceHit& hit)
    {
      Vec3d p;
      EXPECT_FALSE(scene.PreviousPosition(hit, p));
    });
}

TEST(Geometry, OnlyWhatMovedIsBuilt)
{
  SceneBuilder b = Skinned();
  const int grey = b.Add(SceneBuilder::Lambert(.5f));
  for (int i = 0; i < 20; ++i)
    b.Quad(grey, { float(i), -2, 0 }, { 1, 0, 0 }, { 0, 0, -1 });
  b.Box(grey, { -1, -1, -1 }, { 1, 1, 1 });
  Animate(*b.Scene, int(b.Scene->Nodes.size()) - 1, AnimatedPath::Translation, { 0, 2 }, { 0, 0, 0, 1, 0, 0 });
  const std::int64_t vertices = std::int64_t(b.Scene->Meshes[0].Positions.size());
  EmbreeScene::Options apart;
  apart.RebuiltTriangles = 0;
  EmbreeScene scene(b.Scene, apart);
  scene.SetTime(0, -1);
  EmbreeScene::Statistics w = scene.GetStatistics();
  EXPECT_EQ(w.StillParts, 20);
  EXPECT_EQ(w.RigidParts, 1);
  EXPECT_EQ(w.DeformingParts, 1);
  scene.SetTime(1, 0);
  w = scene.GetStatistics();
  EXPECT_EQ(w.Placed, 1);
  EXPECT_EQ(w.Baked, 1);
  EXPECT_EQ(w.Committed, 2);
  EXPECT_EQ(w.BakedVertices, vertices); // the previous time's are kept from the frame before
  EXPECT_EQ(w.LightBuilds, 0);
  scene.SetTime(3, 2.5); // the box has arrived
  scene.SetTime(4, 3);
  w = scene.GetStatistics();
  EXPECT_EQ(w.Placed, 0);
  EXPECT_EQ(w.Committed, 1);
  scene.SetTime(9, 8.5);
  scene.SetTime(10, 9); // and all is over
  w = scene.GetStatistics();
  EXPECT_EQ(w.Committed, 0);
}

TEST(Geometry, FewTrianglesAreTracedInPlaceAsThroughAMatrix)
{
  // one hierarchy of all, against one of what stands still and one of what moves
  SceneBuilder b = Rigid();
  const int grey = b.Add(SceneBuilder::Lambert(.5f));
  b.Quad(grey, { -3, -1, 2 }, { 6, 0, 0 }, { 0, 0, -5 });
  EmbreeScene::Options apart;
  apart.RebuiltTriangles = 0;
  EmbreeScene whole(b.Scene), two(b.Scene, apart);
  for (double time : { 0., 1., 5., 2., 20. })
  {
    whole.SetTime(time, time - 1);
    two.SetTime(time, time - 1);
    EXPECT_EQ(whole.GetStatistics().Placed, 0);
    EmbreeScene::Context context;
    two.Begin(context);
    int hits = 0, moved = 0;
    ForEachHit(whole, 60,
      [&](const TraceRay& ray, const SurfaceHit& hit)
      {
        SurfaceHit other;
        ASSERT_TRUE(two.Intersect(context, ray, other));
        if (other.Geometry != hit.Geometry || other.Primitive != hit.Primitive)
          return; // on an edge
        ++hits;
        EXPECT_LT(Length(hit.P - other.P), 2e-6);
        EXPECT_LT(Length(hit.Ng - other.Ng), 2e-6);
        EXPECT_EQ(hit.Front, other.Front);
        SurfacePoint p, q;
        whole.Shade(hit, ray.Direction, p);
        two.Shade(other, ray.Direction, q);
        EXPECT_LT(Length(p.Normals.Shading - q.Normals.Shading), 2e-6);
        Vec3d before, old;
        const bool goes = whole.PreviousPosition(hit, before);
        ASSERT_EQ(goes, two.PreviousPosition(other, old));
        moved += goes;
        if (goes)
        {
          EXPECT_LT(Length(before - old), 2e-6);
        }
      });
    EXPECT_GT(hits, 500);
    EXPECT_EQ(moved > 50, time > 0 && time < 9) << time;
  }
}

TEST(Geometry, EmbreeBuildsOnlyWhatMoved)
{
  // Many deforming parts, one of which moves on: Embree must not build a hierarchy of all of them again, whatever its
  // flags promise. The progress that it reports tells.
  SceneBuilder b;
  const int grey = b.Add(SceneBuilder::Lambert(.5f));
  for (int i = 0; i < 8; ++i)
  {
    Sheet(b, grey, 60, { 3.f * float(i), 0, 0 });
    Mesh& mesh = b.Scene->Meshes.back();
    MorphTarget t;
    t.Positions = mesh.Normals;
    mesh.Targets.push_back(t);
    b.Scene->Nodes.back().Weights = { 0 };
    Animate(*b.Scene, i, AnimatedPath::Weights, { 0, i == 3 ? 10.f : 1.f }, { 0, 1 });
  }
  EmbreeScene scene(b.Scene);
  scene.SetTime(5, 4);
  const std::int64_t first = scene.GetStatistics().BuildSteps;
  scene.SetTime(6, 5);
  const EmbreeScene::Statistics w = scene.GetStatistics();
  EXPECT_EQ(w.Committed, 1);
  EXPECT_GT(first, 50);
  EXPECT_LT(w.BuildSteps, 5);
}

TEST(Geometry, APoseDoesNotDependOnThePosesBeforeIt)
{
  SceneBuilder b = Morphing(24);
  {
    // one scene of all kinds: the skin's and the box's nodes and meshes move in
    for (const SceneBuilder& other : { Skinned(24), Rigid() })
    {
      const int nodes = int(b.Scene->Nodes.size()), meshes = int(b.Scene->Meshes.size()),
                skins = int(b.Scene->Skins.size());
      for (Node n : other.Scene->Nodes)
      {
        n.Parent += n.Parent >= 0 ? nodes : 0;
        n.Skin += n.Skin >= 0 ? skins : 0;
        for (int& c : n.Children)
          c += nodes;
        b.Scene->Nodes.push_back(n);
      }
      for (Skin skin : other.Scene->Skins)
      {
        for (int& j : skin.Joints)
          j += nodes;
        b.Scene->Skins.push_back(skin);
      }
      for (const Mesh& m : other.Scene->Meshes)
        b.Scene->Meshes.push_back(m);
      for (Instance i : other.Scene->Instances)
      {
        i.Mesh += meshes;
        i.Node += nodes;
        b.Scene->Instances.push_back(i);
      }
      for (AnimationChannel c : other.Scene->Animation)
      {
        c.Node += nodes;
        b.Scene->Animation.push_back(c);
      }
    }
    const int lamp = b.Add(SceneBuilder::Lambert(0, 5));
    b.Quad(lamp, { -1, 1.2f, 0 }, { 2, 0, 0 }, { 0, .2f, 0 });
    Animate(*b.Scene, int(b.Scene->Nodes.size()) - 1, AnimatedPath::Translation, { 0, 4 }, { 0, 0, 0, .1f, .1f, 0 });
  }
  EmbreeScene direct(b.Scene), sequence(b.Scene), backwards(b.Scene), blurred(b.Scene);
  direct.SetTime(5, 4);
  for (int t = 0; t <= 5; ++t)
    sequence.SetTime(t, t - 1);
  for (double t : { 8., 2., 7.5 })
    backwards.SetTime(t, t - .5);
  backwards.SetTime(5, 4);
  // through an open shutter and back
  blurred.SetShutter(0, 1);
  blurred.SetTime(1, 0);
  blurred.SetShutter(0, 0);
  blurred.SetTime(5, 4);
  const Picture expected = Hits(direct);
  EXPECT_GT(expected.Hits, 8000);
  for (const EmbreeScene* scene : { &sequence, &backwards, &blurred })
  {
    const Picture other = Hits(*scene);
    EXPECT_EQ(other.Hits, expected.Hits);
    EXPECT_TRUE(other.Bits == expected.Bits);
    for (int i = 0; i < 20; ++i)
    {
      LightSampler::Sample x, y;
      const Receiver at{ { 0, 0, 3 }, { 0, 0, 0 }, true };
      const float u = (float(i) + .5f) / 20;
      ASSERT_EQ(direct.DrawLight(at, 0, u, u, .3f, x), scene->DrawLight(at, 0, u, u, .3f, y));
      EXPECT_EQ(x.Wi, y.Wi);
      EXPECT_EQ(x.Pdf, y.Pdf);
    }
  }
  // and the test can see a difference
  sequence.SetTime(4.999, 4);
  EXPECT_FALSE(Hits(sequence).Bits == expected.Bits);
}

TEST(Geometry, SharedMeshesAreHitWhereCopiesAre)
{
  SceneBuilder b;
  const int grey = b.Add(SceneBuilder::Lambert(.5f));
  b.Sphere(grey, { 100, 50, -80 }, .3f, 24); // off its mesh's origin: it is re-based
  for (int i = 1; i < 9; ++i)
  {
    Node node;
    node.Translation = { -100 + .5 * (i % 3) - .5, -50 + .5 * (i / 3) - .5, 80 };
    node.Scale = i == 4 ? Vec3d(-1, 1, 1) : Vec3d(1, 1, 1);
    if (i == 4)
      node.Translation.x = 101; // a mirrored one, beside the others
    b.Scene->Nodes.push_back(node);
    Instance instance = b.Scene->Instances[0];
    instance.Node = i;
    instance.Id = i + 1;
    b.Scene->Instances.push_back(instance);
  }
  b.Scene->Nodes[0].Translation = { -100, -50, 80 };
  EmbreeScene::Options options;
  EmbreeScene copies(b.Scene, options);
  options.RepeatedTriangles = 0;
  EmbreeScene shared(b.Scene, options);
  copies.SetTime(0, 0);
  shared.SetTime(0, 0);
  EXPECT_EQ(copies.GetStatistics().RigidParts, 0);
  EXPECT_EQ(shared.GetStatistics().RigidParts, 9);
  EXPECT_EQ(shared.TriangleCount, copies.TriangleCount);
  EXPECT_LT(shared.GetStatistics().Bytes, copies.GetStatistics().Bytes / 3);
  EmbreeScene::Context context;
  shared.Begin(context);
  int hits = 0, other = 0;
  ForEachHit(copies, 100,
    [&](const TraceRay& ray, const SurfaceHit& hit)
    {
      SurfaceHit h;
      ++hits;
      if (!shared.Intersect(context, ray, h) || h.Primitive != hit.Primitive || h.Geometry != hit.Geometry)
      {
        ++other;
        return;
      }
      EXPECT_LT(Length(h.P - hit.P), 2e-5); // copies are rounded at 100
      EXPECT_EQ(h.Front, hit.Front);
      SurfacePoint x, y;
      copies.Shade(hit, ray.Direction, x);
      shared.Shade(h, ray.Direction, y);
      EXPECT_LT(Length(x.Normals.Shading - y.Normals.Shading), 2e-4f);
    });
  EXPECT_GT(hits, 2000);
  EXPECT_LT(other, hits / 500);
}

TEST(Geometry, MirroredPartsKeepTheirOutside)
{
  // Still and moving, copied and as an instance: the front of a box is its outside.
  for (int moving = 0; moving < 2; ++moving)
    for (double x : { 1., -1. })
    {
      SceneBuilder b;
      b.Box(b.Add(SceneBuilder::Lambert(.5f)), { -.5f, -.5f, -.5f }, { .5f, .5f, .5f });
      b.Scene->Nodes[0].Scale = { x, 1, 1 };
      if (moving)
        Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 1 }, { 0, 0, 0, .1f, 0, 0 });
      EmbreeScene scene(b.Scene);
      scene.SetTime(.5, 0);
      int hits = 0;
      ForEachHit(scene, 20,
        [&](const TraceRay& ray, const SurfaceHit& hit)
        {
          ++hits;
          EXPECT_TRUE(hit.Front);
          EXPECT_LT(Dot(hit.Ng, ray.Direction), 0);
        });
      EXPECT_GT(hits, 20);
    }
}

TEST(Geometry, HiddenBackFacesLetRaysPassFromBehindOnly)
{
  // A box, seen from outside and from within: still and moving, mirrored or not, repeated, double-sided, of glass.
  for (int moving = 0; moving < 2; ++moving)
    for (double x : { 1., -1. })
      for (const char* kind : { "plain", "double-sided", "glass", "repeated" })
      {
        SCOPED_TRACE(std::string(kind) + (moving ? " moving" : " still") + (x < 0 ? " mirrored" : ""));
        SceneBuilder b;
        const int m = b.Add(SceneBuilder::Lambert(.5f));
        b.Scene->Materials[std::size_t(m)].DoubleSided = kind[0] == 'd';
        b.Scene->Materials[std::size_t(m)].Transmission = kind[0] == 'g' ? 1.f : 0.f;
        b.Box(m, { -.5f, -.5f, -.5f }, { .5f, .5f, .5f });
        b.Scene->Nodes[0].Scale = { x, 1, 1 };
        if (kind[0] == 'r')
        {
          Node far = b.Scene->Nodes[0];
          far.Translation = { 0, 0, 50 };
          b.Scene->Nodes.push_back(far);
          Instance again = b.Scene->Instances[0];
          again.Node = int(b.Scene->Nodes.size()) - 1;
          again.Id = 2;
          b.Scene->Instances.push_back(again);
        }
        if (moving)
          Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 1 }, { 0, 0, 0, .1f, 0, 0 });
        EmbreeScene::Options options;
        options.HideBackFaces = true;
        options.RepeatedTriangles = 0;
        EmbreeScene scene(b.Scene, options);
        scene.SetTime(.5, 0);
        EmbreeScene::Context context;
        scene.Begin(context);
        const bool passes = kind[0] == 'p' || kind[0] == 'r';
        for (const Vec3f& d : { Vec3f(1, .2f, .1f), Vec3f(-.3f, 1, .2f), Vec3f(.1f, -.2f, -1) })
        {
          TraceRay within;
          within.Origin = Vec3f(.05f, 0, 0) - Vec3f(scene.Origin());
          within.Direction = Normalized(d);
          within.Far = 20;
          SurfaceHit hit;
          EXPECT_EQ(scene.Intersect(context, within, hit), !passes);
          EXPECT_EQ(scene.Occluded(context, within), !passes);
          TraceRay outside = within;
          outside.Origin = within.Origin - within.Direction * 3.f;
          ASSERT_TRUE(scene.Intersect(context, outside, hit));
          EXPECT_TRUE(hit.Front);
          EXPECT_TRUE(scene.Occluded(context, outside));
        }
      }
}

TEST(Geometry, RestBoundsFollowSkinsAndMorphs)
{
  SceneBuilder b = Skinned();
  b.Scene->Nodes[1].Translation = { 10, 0, 0 };
  b.Scene->Animation.clear();
  EmbreeScene skinned(b.Scene);
  EXPECT_NEAR(skinned.RestLower.x, 9, 1e-5);
  EXPECT_NEAR(skinned.RestUpper.x, 11, 1e-5);
  SceneBuilder m = Morphing();
  m.Scene->Animation.clear();
  m.Scene->Nodes[0].Weights = { 0, 10 };
  EmbreeScene morphed(m.Scene);
  EXPECT_NEAR(morphed.RestLower.y, 1, 1e-5);
  EXPECT_NEAR(morphed.RestUpper.y, 3, 1e-5);
  // what is seen is what was framed
  morphed.SetTime(0, 0);
  EXPECT_NEAR(morphed.Lower.y, 1, 1e-5);
}

TEST(MotionBlur, CoverageOfATranslatingBox)
{
  // The box [-.5, .5] moves by 2 in x while the shutter is open, evenly: a ray at x is covered for clamp((x + .5) / 2)
  // - clamp((x - .5) / 2) of the time.
  SceneBuilder b;
  b.Box(b.Add(SceneBuilder::Lambert(.5f)), { -.5f, -.5f, -.5f }, { .5f, .5f, .5f });
  Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 4 }, { 0, 0, 0, 8, 0, 0 });
  EmbreeScene scene(b.Scene);
  scene.SetShutter(0, 1);
  scene.SetTime(1, 0);
  EXPECT_TRUE(scene.Has.MotionBlur);
  EXPECT_EQ(scene.GetStatistics().Segments, 1);
  EmbreeScene::Context context;
  scene.Begin(context);
  const int n = 2000;
  for (double x : { -.6, -.4, 0., .3, .9, 1.7, 2.2, 2.6 })
  {
    int covered = 0;
    for (int i = 0; i < n; ++i)
    {
      TraceRay ray;
      ray.Origin = Vec3f(Vec3d(x + 2, .1, 5) - scene.Origin());
      ray.Direction = { 0, 0, -1 };
      ray.Time = (float(i) + .5f) / n;
      SurfaceHit hit;
      if (scene.Intersect(context, ray, hit))
      {
        ++covered;
        EXPECT_NEAR(hit.P.z + scene.Origin().z, .5, 1e-6);
        EXPECT_NEAR(hit.P.x + scene.Origin().x, x + 2, 1e-6);
        // the same spot of the box at the tick's own time, and a second before
        const Vec3d reference = scene.ReferencePosition(hit) + scene.Origin();
        EXPECT_NEAR(reference.x, x + 2 - 2 * double(ray.Time), 1e-5);
        Vec3d before;
        ASSERT_TRUE(scene.PreviousPosition(hit, before));
        EXPECT_NEAR(before.x + scene.Origin().x, reference.x - 2, 1e-5);
      }
      EXPECT_EQ(scene.Occluded(context, ray), hit.T > 0);
    }
    const auto part = [](double v) { return std::min(1., std::max(0., v)); };
    EXPECT_NEAR(double(covered) / n, part((x + .5) / 2) - part((x - .5) / 2), 1.5 / n) << x;
  }
}

TEST(MotionBlur, PicturesShowTheCoverage)
{
  // The same in a picture: its alpha, to the noise of its samples; sharp without the shutter.
  SceneBuilder b;
  b.Box(b.Add(SceneBuilder::Lambert(.5f)), { -.5f, -1, -.5f }, { .5f, 1, .5f });
  Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 1 }, { 0, 0, 0, 2, 0, 0 });
  CameraModel camera;
  camera.Orthographic = true;
  camera.YMag = .1; // 64 pixels of .05: x from -1.6 to 1.6, around 1
  camera.WorldFromCamera.m[0][3] = 1;
  camera.WorldFromCamera.m[2][3] = 5;
  const int width = 64, samples = 400;
  EmbreeScene scene(b.Scene);
  for (int open = 0; open < 2; ++open)
  {
    scene.SetShutter(0, open);
    scene.SetTime(0, -1);
    Integrator i;
    i.Scene = &scene;
    i.View = i.PreviousView = Camera(camera, camera.WorldFromCamera, scene.Origin(), width, 4);
    i.SamplesPerPixel = samples;
    i.Shutter = scene.Has.MotionBlur;
    EXPECT_EQ(i.Shutter, open == 1);
    Film film({ 0, 0, width, 1 }, { std::string("alpha") });
    TraceCounters counters;
    i.Render(film, film.Region(), 0, samples, counters);
    std::vector<float> alpha(width);
    film.Develop("alpha", film.Region(), samples, ImageOut(alpha.data(), 1, film.Region()));
    const auto part = [](double v) { return std::min(1., std::max(0., v)); };
    for (int x = 0; x < width; ++x)
    {
      const double at = 1 + (x + .5 - width / 2) * .05;
      double expected = open ? part((at + .5) / 2) - part((at - .5) / 2) : std::fabs(at) < .5 ? 1 : 0;
      if (open == 0 && std::fabs(std::fabs(at) - .5) < .025 + 1e-9)
        expected = alpha[std::size_t(x)]; // the rim lies in this pixel
      EXPECT_NEAR(alpha[std::size_t(x)], expected, 4.5 * std::sqrt(expected * (1 - expected) / samples) + .01) << at;
    }
  }
}

TEST(MotionBlur, CoverageOfARotatingBox)
{
  // A bar of half width .1 turns by a quarter about z: at radius r it covers the angles up to asin(.1 / r) on both
  // sides of itself.
  SceneBuilder b;
  b.Box(b.Add(SceneBuilder::Lambert(.5f)), { 0, -.1f, -.1f }, { 1, .1f, .1f });
  Animate(*b.Scene, 0, AnimatedPath::Rotation, { 0, 1 }, Join(AboutZ(0), AboutZ(Turn / 4)));
  EmbreeScene scene(b.Scene);
  scene.SetShutter(0, 1);
  scene.SetTime(0, -1);
  EXPECT_GE(scene.GetStatistics().Segments, 16);
  EmbreeScene::Context context;
  scene.Begin(context);
  const int n = 4000;
  for (double r : { .3, .6, .9 })
    for (double angle : { 0., .2, .8, 1.5 })
    {
      int covered = 0;
      for (int i = 0; i < n; ++i)
      {
        TraceRay ray;
        ray.Origin = Vec3f(float(r * std::cos(angle)), float(r * std::sin(angle)), 5);
        ray.Direction = { 0, 0, -1 };
        ray.Time = (float(i) + .5f) / n;
        SurfaceHit hit;
        covered += scene.Intersect(context, ray, hit);
      }
      const double half = std::asin(.1 / r), from = std::max(0., angle - half), to = std::min(Turn / 4, angle + half);
      EXPECT_NEAR(double(covered) / n, (to - from) / (Turn / 4), 1e-3) << r << ' ' << angle;
    }
  // a ray at the bar's end meets it where it is at the ray's time, and its normal with it
  for (float time : { .1f, .37f, .93f })
  {
    const double angle = Turn / 4 * double(time);
    TraceRay ray;
    ray.Origin = Vec3f(float(3 * std::cos(angle)), float(3 * std::sin(angle)), 0);
    ray.Direction = Vec3f(-float(std::cos(angle)), -float(std::sin(angle)), 0);
    ray.Time = time;
    SurfaceHit hit;
    ASSERT_TRUE(scene.Intersect(context, ray, hit));
    EXPECT_NEAR(hit.T, 2, 1e-3);
    EXPECT_NEAR(hit.Ng.x, std::cos(angle), 1e-3);
    EXPECT_NEAR(hit.Ng.y, std::sin(angle), 1e-3);
  }
}

TEST(MotionBlur, DeformingMeshesAreBetweenTheirPoses)
{
  for (const SceneBuilder& b : { Morphing(), Skinned() })
  {
    EmbreeScene scene(b.Scene);
    scene.SetShutter(-.5, .5);
    scene.SetTime(5, 4);
    EXPECT_TRUE(scene.Has.MotionBlur);
    for (float time : { 0.f, .3f, 1.f })
    {
      EmbreeScene sharp(b.Scene);
      sharp.SetTime(4.5 + double(time), 4);
      EmbreeScene::Context context;
      sharp.Begin(context);
      int hits = 0, missed = 0;
      ForEachHit(
        scene, 30,
        [&](const TraceRay& ray, const SurfaceHit& hit)
        {
          SurfaceHit other;
          if (!sharp.Intersect(context, ray, other))
          {
            ++missed;
            return;
          }
          ++hits;
          EXPECT_LT(Length(hit.P - other.P), 2e-3);
          SurfacePoint x, y;
          scene.Shade(hit, ray.Direction, x);
          sharp.Shade(other, ray.Direction, y);
          EXPECT_LT(Length(x.Normals.Shading - y.Normals.Shading), 2e-2f);
        },
        time);
      EXPECT_GT(hits, 100);
      EXPECT_LT(missed, 5);
    }
  }
}

TEST(MotionBlur, AClosedShutterAndAStillSceneHaveNone)
{
  SceneBuilder b = Rigid();
  EmbreeScene scene(b.Scene);
  scene.SetShutter(0, 0);
  scene.SetTime(1, 0);
  EXPECT_FALSE(scene.Has.MotionBlur);
  const Picture sharp = Hits(scene);
  for (const double wrong : { -1., std::nan(""), double(INFINITY) })
  {
    scene.SetShutter(0, wrong);
    scene.SetTime(1, 0);
    EXPECT_FALSE(scene.Has.MotionBlur);
    EXPECT_TRUE(Hits(scene).Bits == sharp.Bits);
  }
  scene.SetShutter(0, .5);
  scene.SetTime(20, 19);
  EXPECT_FALSE(scene.Has.MotionBlur);
}

TEST(MotionBlur, MovingLightsAreSampledWhereTheyAre)
{
  // A lamp in y = 1 passes over a point on the floor, and one that keeps still shines from the side.
  SceneBuilder b;
  const int lamp = b.Add(SceneBuilder::Lambert(0, 4));
  b.Quad(lamp, { -.25f, 1, -.25f }, { .5f, 0, 0 }, { 0, 0, .5f }); // e1 x e2 looks down
  Animate(*b.Scene, 0, AnimatedPath::Translation, { 0, 1 }, { -1, 0, 0, 1, 0, 0 });
  b.Quad(lamp, { 2, .5f, -.25f }, { 0, .5f, 0 }, { 0, 0, .5f });
  EmbreeScene scene(b.Scene);
  scene.SetShutter(0, 1);
  scene.SetTime(0, -1);
  EXPECT_TRUE(scene.Has.MovingLights);
  EmbreeScene::Context context;
  scene.Begin(context);
  const Receiver at{ Vec3f{ 0, 0, 0 } - Vec3f(scene.Origin()), { 0, 1, 0 }, false };

  const int n = 64;
  double sum = 0, seenSum = 0;
  std::int64_t count = 0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k)
      {
        LightSampler::Sample s;
        const float time = (float((i * 37 + j * 11 + k * 5) % n) + .5f) / n;
        ++count;
        if (!scene.DrawLight(at, time, (float(i) + .5f) / n, (float(j) + .5f) / n, (float(k) + .5f) / n, s))
          continue;
        sum += double(Dot(s.Wi, at.Normal)) * double(s.Emission.x) / double(s.Pdf);
        if (i % 7 == 0 && j % 13 == 0 && k % 11 == 0)
        {
          TraceRay ray;
          ray.Origin = at.Position;
          ray.Direction = s.Wi;
          ray.Time = time;
          SurfaceHit hit;
          ASSERT_TRUE(scene.Intersect(context, ray, hit));
          ASSERT_GE(scene.LightAt(hit), 0);
          EXPECT_EQ(hit.Geometry, s.Geometry);
          const Vec3f d = hit.Pf - at.Position;
          const float pdf = scene.LightPdf(scene.LightAt(hit), hit, at, Dot(d, d), std::fabs(Dot(hit.Ng, s.Wi)));
          EXPECT_NEAR(pdf / s.Pdf, 1, 1e-4);
          seenSum += 1;
        }
      }
  EXPECT_GT(seenSum, 100);
  // irradiance by a fine sum over lamp and time
  double expected = 0;
  const int m = 100;
  for (int t = 0; t < m; ++t)
    for (int i = 0; i < m / 4; ++i)
      for (int j = 0; j < m / 4; ++j)
      {
        const double u = 4 * (i + .5) / m, v = 4 * (j + .5) / m, time = (t + .5) / m;
        const Vec3d p{ -1.25 + .5 * u + 2 * time, 1, -.25 + .5 * v }, q{ 2, .5 + .5 * v, -.25 + .5 * u };
        expected += 4 * .25 * p.y * p.y / (Dot(p, p) * Dot(p, p)) / (m * m / 16. * m);
        expected += 4 * .25 * q.y * q.x / (Dot(q, q) * Dot(q, q)) / (m * m / 16. * m);
      }
  EXPECT_NEAR(sum / double(count) / expected, 1, .01);
}

TEST(MotionBlur, MovingLampsShineFromWhereTheyAre)
{
  SceneBuilder b;
  b.Quad(b.Add(SceneBuilder::Lambert(.5f)), { -1, 0, 1 }, { 2, 0, 0 }, { 0, 0, -2 });
  b.Scene->Nodes.emplace_back();
  PunctualLight l;
  l.Node = 1;
  b.Scene->Lights.push_back(l);
  Animate(*b.Scene, 1, AnimatedPath::Translation, { 0, 1 }, { 0, 1, 0, 4, 1, 0 });
  EmbreeScene scene(b.Scene);
  scene.SetShutter(0, 1);
  scene.SetTime(0, -1);
  EXPECT_TRUE(scene.Has.MovingLights);
  for (float time : { 0.f, .3f, .99f })
  {
    LightSampler::Sample s;
    ASSERT_TRUE(scene.DrawLight({ { 0, 0, 0 }, { 0, 1, 0 }, false }, time, .5f, .5f, .5f, s));
    EXPECT_NEAR(s.Target.x + scene.Origin().x, 4 * time, 1e-4);
    EXPECT_NEAR(s.Pdf, 1, 1e-6);
    EXPECT_NEAR(s.Emission.x, 1 / (1 + 16 * time * time), 1e-4);
  }
  scene.SetShutter(0, 0);
  scene.SetTime(.5, 0);
  EXPECT_FALSE(scene.Has.MovingLights);
}

namespace
{
bool Mentions(const EmbreeScene& scene, const std::string& a, const std::string& b)
{
  for (const std::string& w : scene.Warnings)
    if (w.find(a) != std::string::npos && w.find(b) != std::string::npos)
      return true;
  return false;
}

/// All arrays of a small picture.
std::map<std::string, std::vector<float>> Render(const EmbreeScene& scene, const CameraModel& camera, int size = 8)
{
  Integrator i;
  i.Scene = &scene;
  i.View = i.PreviousView = Camera(camera, camera.WorldFromCamera, scene.Origin(), size, size);
  i.SamplesPerPixel = 4;
  const std::pair<const char*, int> names[] = { { "radiance", 3 }, { "albedo", 3 }, { "normal", 3 }, { "position", 3 },
    { "normalGeometric", 3 }, { "motion", 2 }, { "variance", 1 }, { "alpha", 1 } };
  std::set<std::string> wanted;
  for (const auto& n : names)
    wanted.insert(n.first);
  Film film({ 0, 0, size, size }, wanted);
  TraceCounters counters;
  i.Render(film, film.Region(), 0, 4, counters);
  std::map<std::string, std::vector<float>> out;
  for (const auto& n : names)
  {
    std::vector<float>& v = out[n.first];
    v.resize(std::size_t(size * size * n.second));
    film.Develop(n.first, film.Region(), 4, ImageOut(v.data(), n.second, film.Region()));
  }
  return out;
}

double ExpectFinite(const EmbreeScene& scene, const CameraModel& camera)
{
  double sum = 0;
  for (const auto& array : Render(scene, camera))
    for (float v : array.second)
    {
      EXPECT_TRUE(std::isfinite(v)) << array.first;
      if (array.first == "radiance")
        sum += v;
    }
  return sum;
}

/// A lit quad and sphere of a given size somewhere, and a camera that looks at them.
SceneBuilder Still(double size, Vec3d place)
{
  SceneBuilder b;
  const int grey = b.Add(SceneBuilder::Lambert(.5f)), lamp = b.Add(SceneBuilder::Lambert(0, 5));
  b.Quad(grey, { -2, -1, 2 }, { 4, 0, 0 }, { 0, 0, -4 });
  b.Sphere(grey, { 0, 0, 0 }, 1, 16);
  b.Quad(lamp, { -1, 3, -1 }, { 2, 0, 0 }, { 0, 0, 2 });
  for (Node& n : b.Scene->Nodes)
  {
    n.Scale = Vec3d(size);
    n.Translation = place;
  }
  b.Camera(place + Vec3d(0, 0, 6) * size, .7);
  return b;
}
}

TEST(GeometryExtremes, PicturesDoNotDependOnSizeAndPlace)
{
  const SceneBuilder one = Still(1, {});
  EmbreeScene scene(one.Scene);
  scene.SetTime(0, 0);
  const auto expected = Render(scene, one.Scene->Cameras[0], 16);
  struct Case
  {
    double Size;
    Vec3d Place;
  };
  for (const Case& c : { Case{ 1e-6, {} }, Case{ 1e6, {} }, Case{ 1, { 1e6, -1e6, 1e6 } }, Case{ 1e-3, { 1e3, 0, 0 } },
         Case{ 1e-3, { 1e6, -1e6, 1e6 } } })
  {
    const SceneBuilder b = Still(c.Size, c.Place);
    EmbreeScene other(b.Scene);
    other.SetTime(0, 0);
    EXPECT_EQ(other.Warnings, scene.Warnings); // the sphere's poles
    const auto got = Render(other, b.Scene->Cameras[0], 16);
    for (const char* name : { "radiance", "alpha", "albedo", "normal" })
    {
      const std::vector<float>&x = expected.at(name), &y = got.at(name);
      double error = 0, sum = 0;
      for (std::size_t i = 0; i < x.size(); ++i)
      {
        error += std::fabs(double(x[i]) - double(y[i]));
        sum += std::fabs(double(x[i]));
      }
      // a pixel may see another triangle at an edge, or a path another bounce
      EXPECT_LT(error / sum, 0.02) << name << " at size " << c.Size << ", " << c.Place.x;
    }
  }
}

TEST(GeometryExtremes, UnusableGeometryIsLeftOutAndNamed)
{
  SceneBuilder b;
  const float inf = INFINITY, nan = NAN;
  const int grey = b.Add(SceneBuilder::Lambert(.5f));
  const auto name = [&](const char* text) { b.Scene->Meshes.back().Name = text; };
  b.Quad(grey, { -1, -1, 0 }, { 2, 0, 0 }, { 0, 2, 0 });
  b.AddMesh(grey, { { 0, 0, 1 }, { 1, 0, 1 }, { nan, 1, 1 }, { 0, 1, 1 } }, { 0, 1, 2, 0, 1, 3 });
  name("holed");
  b.AddMesh(grey, { { 0, 0, 1 }, { inf, 0, 1 }, { 0, 1, 1 } }, { 0, 1, 2 });
  name("endless");
  b.AddMesh(grey, { { 0, 0, 1 }, { 3e18f, 0, 1 }, { 0, 1, 1 } }, { 0, 1, 2 });
  name("huge");
  b.AddMesh(grey, { { 0, 0, 1 }, { 1, 1, 1 }, { 2, 2, 1 } }, { 0, 1, 2 });
  name("needle");
  b.AddMesh(grey, { { 0, 0, 1 }, { 1, 1, 1 }, { 2, 2, 1 } }, { 0, 1, 7 });
  name("lost");
  b.AddMesh(grey, {}, {});
  name("empty");
  const int lamp = b.Add(SceneBuilder::Lambert(0, 1));
  b.AddMesh(lamp, { { 0, 0, 2 }, { 1, 0, 2 }, { 0, 1, 2 } }, { 0, 1, 2, 1, 2, 0, 2, 1, 0 });
  name("twice");
  b.AddMesh(lamp, { { 0, 0, 3 }, { 1, 0, 3 }, { 2, 0, 3 } }, { 0, 1, 2 });
  name("dark lamp");
  b.Box(grey, { 0, 0, 0 }, { 1, 1, 1 });
  name("stuck");
  b.Scene->Nodes.back().Name = "bad node";
  b.Scene->Nodes.back().HasMatrix = true;
  b.Scene->Nodes.back().Matrix.m[0][0] = double(nan);
  b.Box(grey, { 0, 0, 0 }, { 1, 1, 1 });
  name("gone");
  b.Scene->Nodes.back().Scale = { 0, 0, 0 };
  b.Camera({ 0, 0, 5 }, .7);
  EmbreeScene scene(b.Scene);
  scene.SetTime(0, 0);
  for (const auto& text :
    { std::make_pair("holed", "1 of 2"), std::make_pair("endless", "not finite"), std::make_pair("huge", "1e18"),
      std::make_pair("needle", "no area"), std::make_pair("lost", "no vertex"), std::make_pair("empty", "no triangles"),
      std::make_pair("twice", "2 of 3"), std::make_pair("dark lamp", "no area"),
      std::make_pair("bad node", "not finite"), std::make_pair("gone", "no area") })
    EXPECT_TRUE(Mentions(scene, text.first, text.second)) << text.first;
  EXPECT_EQ(scene.Warnings.size(), 10u);
  EXPECT_EQ(scene.DroppedTriangles, 1 + 1 + 1 + 1 + 1 + 2 + 1 + 12 + 12);
  EXPECT_EQ(scene.TriangleCount, 2 + 1 + 1);
  EXPECT_EQ(scene.Lights().GetTriangles().size(), 1u);
  EXPECT_LT(scene.Upper.x, 3);
  ExpectFinite(scene, b.Scene->Cameras[0]);
}

TEST(GeometryExtremes, UnusableEmissionIsNamed)
{
  for (float emission : { 65504.f, 1e30f, 3.4e38f, float(NAN), float(INFINITY), -1.f })
  {
    SceneBuilder b = Still(1, {});
    b.Scene->Materials[1].Name = "the lamp";
    b.Scene->Materials[1].Emission = { emission, emission, emission };
    EmbreeScene scene(b.Scene);
    scene.SetTime(0, 0);
    EXPECT_EQ(Mentions(scene, "material \"the lamp\"", "emission"), emission != 65504.f) << emission;
    const double light = ExpectFinite(scene, b.Scene->Cameras[0]);
    EXPECT_EQ(light > 0, emission > 0 && std::isfinite(emission)) << emission;
  }
  SceneBuilder b = Still(1, {});
  PunctualLight l;
  l.Name = "broken bulb";
  l.Intensity = { NAN, 1, 1 };
  b.Scene->Lights.push_back(l);
  EmbreeScene scene(b.Scene);
  scene.SetTime(0, 0);
  EXPECT_TRUE(Mentions(scene, "light \"broken bulb\"", "intensity"));
  ExpectFinite(scene, b.Scene->Cameras[0]);
}

TEST(GeometryExtremes, EmptyScenesAndHugeOnesAreTraced)
{
  SceneBuilder empty;
  empty.Camera({ 0, 0, 5 }, .7);
  EmbreeScene nothing(empty.Scene);
  nothing.SetTime(0, 0);
  EXPECT_FALSE(nothing.Has.Geometry);
  EXPECT_GT(nothing.Lower.x, nothing.Upper.x);
  EXPECT_EQ(ExpectFinite(nothing, empty.Scene->Cameras[0]), 0);

  empty.Sky(2);
  EmbreeScene sky(empty.Scene);
  sky.SetTime(0, 0);
  const auto white = Render(sky, empty.Scene->Cameras[0]);
  for (const float v : white.at("radiance"))
    ASSERT_EQ(v, 2.f);

  SceneBuilder b = Still(1, {});
  b.Quad(0, { -9e17f, -1, 9e17f }, { 1.8e18f, 0, 0 }, { 0, 0, -1.8e18f });
  EmbreeScene huge(b.Scene);
  huge.SetTime(0, 0);
  EXPECT_EQ(huge.Warnings.size(), 1u); // of the sphere's poles
  EXPECT_GT(ExpectFinite(huge, b.Scene->Cameras[0]), 0);
}

TEST(GeometryExtremes, MovingNodesMayCollapseAndComeBack)
{
  // Scale 1, (1, 1, 0), 0, then a mirrored one, then not a number: each time as if nothing else had been.
  SceneBuilder b = Rigid();
  b.Scene->Nodes[0].Name = "unstable";
  b.Scene->Animation.clear();
  Animate(*b.Scene, 0, AnimatedPath::Scale, { 0, 1, 2, 3, 4 }, { 1, 1, 1, 1, 1, 0, 0, 0, 0, -1, 1, 1, NAN, 1, 1 });
  b.Scene->Animation.back().Mode = Interpolation::Step;
  b.Camera({ .3, .2, 4 }, .7);
  EmbreeScene scene(b.Scene);
  const int expected[] = { 1, 1, 0, 1, 0 };
  std::vector<Picture> first;
  for (int round = 0; round < 2; ++round)
    for (int t = 0; t < 5; ++t)
    {
      scene.SetTime(t, t - 1);
      const Picture p = Hits(scene);
      EXPECT_EQ(p.Hits > 0, expected[t] != 0) << t;
      if (round == 0)
        first.push_back(p);
      else
        EXPECT_TRUE(p.Bits == first[std::size_t(t)].Bits) << t;
      ExpectFinite(scene, b.Scene->Cameras[0]);
      scene.SetShutter(-.75, 0);
      scene.SetTime(t, t - 1);
      ExpectFinite(scene, b.Scene->Cameras[0]);
      scene.SetShutter(0, 0);
    }
  EXPECT_TRUE(Mentions(scene, "unstable", "not finite"));
}

TEST(Geometry, VerticesThatNeedNoCopyAreNotCopied)
{
  SceneBuilder b;
  b.Sphere(b.Add(SceneBuilder::Lambert(.5f)), { 0, 0, 0 }, 1, 100);
  Mesh& mesh = b.Scene->Meshes[0];
  const std::size_t n = mesh.Positions.size();
  mesh.Positions.shrink_to_fit();
  EmbreeScene tight(b.Scene);
  mesh.Positions.reserve(n + 1);
  EmbreeScene padded(b.Scene);
  EXPECT_EQ(tight.GetStatistics().Bytes - padded.GetStatistics().Bytes, std::int64_t(12 * (n + 1)));
  tight.SetTime(0, 0);
  padded.SetTime(0, 0);
  EXPECT_TRUE(Hits(tight).Bits == Hits(padded).Bits);
  EXPECT_LT(double(padded.GetStatistics().Bytes) / double(padded.TriangleCount), 110);
}

namespace
{
std::string Find(const std::string& name)
{
  for (const char* form : { "glTF", "glTF-Binary", "" })
    for (const char* extension : { ".gltf", ".glb" })
    {
      std::error_code error;
      const std::filesystem::path file =
        std::filesystem::path(QUELL_SHARED_DATA) / "khronos-core" / name / form / (name + extension);
      if (std::filesystem::is_regular_file(file, error))
        return file.string();
    }
  return {};
}
}

TEST(Geometry, AnimatedFilesAreHitWhereDeformPutsThem)
{
  int found = 0;
  for (const char* name : { "Fox", "RiggedSimple", "SimpleSkin", "AnimatedMorphCube", "MorphPrimitivesTest",
         "SimpleMorph", "AnimatedCube", "BoxAnimated", "InterpolationTest" })
  {
    const std::string file = Find(name);
    if (file.empty())
      continue;
    ++found;
    const std::shared_ptr<const Scene> s = LoadScene(file);
    EmbreeScene scene(s);
    for (double part : { 0., .3, .8 })
    {
      const double time = part * s->Duration();
      scene.SetTime(time, time - .04);
      ASSERT_TRUE(scene.Has.Geometry) << name;
      const ScenePose pose = s->PoseAt(time);
      std::vector<std::vector<Vec3f>> p(s->Instances.size());
      for (std::size_t i = 0; i < p.size(); ++i)
        s->Deform(s->Instances[i], pose, scene.Origin(), p[i], nullptr, nullptr);
      EmbreeScene::Context context;
      scene.Begin(context);
      const Vec3d middle = (scene.Lower + scene.Upper) * .5 - scene.Origin(), size = scene.Upper - scene.Lower;
      int hits = 0;
      for (int j = 0; j < 24; ++j)
        for (int i = 0; i < 24; ++i)
        {
          TraceRay ray;
          const Vec3d from = middle + Vec3d(.4, .3, 2) * Length(size);
          ray.Origin = Vec3f(from);
          ray.Direction =
            Vec3f(Normalized(middle + Vec3d((i + .37) / 24.1 - .5, (j + .61) / 24.3 - .5, 0) * size - from));
          SurfaceHit hit;
          if (!scene.Intersect(context, ray, hit))
            continue;
          ++hits;
          // the nearest of all triangles by Deform
          double best = 1e300;
          for (std::size_t k = 0; k < p.size(); ++k)
          {
            Vec3d at;
            if (BruteForce(p[k], s->Meshes[std::size_t(s->Instances[k].Mesh)].Indices, ray, at))
              best = std::min(best, Length(at - from));
          }
          EXPECT_NEAR(best, Length(hit.P - from), 1e-5 * Length(size)) << name << ' ' << time;
        }
      EXPECT_GT(hits, 10) << name << ' ' << time;
    }
  }
  if (found == 0)
    GTEST_SKIP() << "no scenes";
}
