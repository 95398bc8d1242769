// SPDX-License-Identifier: BSD-3-Clause
// Rays against all triangles of a small scene: Embree's answers, no gaps, and no dependence on the company of a ray.
#include "RenderScene.h"
#include "quellEmbreeScene.h"
#include "quellSimd.h"
#include "quellSmallScene.h"
#include "quellWavefront.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <random>

using namespace quell;

namespace
{
constexpr float Infinity = std::numeric_limits<float>::infinity();

/// Some boxes and a wall.
SceneBuilder Boxes()
{
  SceneBuilder b;
  const int grey = b.Add(SceneBuilder::Lambert(.5f));
  b.Box(grey, { -1, -.8f, -.7f }, { .3f, .4f, .2f });
  b.Box(grey, { .2f, -.5f, .1f }, { .9f, .6f, .6f });
  b.Quad(grey, { -3, -1, 2 }, { 6, 0, 0 }, { 0, 0, -5 });
  return b;
}

/// All triangles of a scene, in the order of its parts.
SmallScene Listed(const Scene& scene)
{
  SmallScene out;
  for (std::size_t m = 0; m < scene.Meshes.size(); ++m)
  {
    const Mesh& mesh = scene.Meshes[m];
    for (std::size_t t = 0; t + 2 < mesh.Indices.size(); t += 3)
      EXPECT_TRUE(out.Add(mesh.Positions[mesh.Indices[t]], mesh.Positions[mesh.Indices[t + 1]],
        mesh.Positions[mesh.Indices[t + 2]], std::uint32_t(m), std::uint32_t(t / 3)));
  }
  return out;
}

struct Rays
{
  std::unique_ptr<Wavefront> W = std::make_unique<Wavefront>();
  int Add(const Vec3f& from, const Vec3f& along, float far = Infinity)
  {
    Wavefront& w = *this->W;
    const int i = w.Count++;
    w.Live.Ox[i] = w.Kx[i] = from.x;
    w.Live.Oy[i] = w.Ky[i] = from.y;
    w.Live.Oz[i] = w.Kz[i] = from.z;
    w.Live.Dx[i] = w.Jx[i] = along.x;
    w.Live.Dy[i] = w.Jy[i] = along.y;
    w.Live.Dz[i] = w.Jz[i] = along.z;
    w.Far[i] = far;
    w.Lit[i] = ~0u;
    return i;
  }
};

Vec3f Somewhere(std::mt19937& random)
{
  std::uniform_real_distribution<float> u(-1, 1);
  const float x = u(random), y = u(random);
  return { x, y, u(random) };
}
}

TEST(SmallScene, HitsAreEmbrees)
{
  const SceneBuilder b = Boxes();
  const SmallScene few = Listed(*b.Scene);
  EXPECT_EQ(few.Triangles, 26);
  EXPECT_EQ(few.Vertices, 20); // every corner once
  EXPECT_EQ(few.Edges, 41);    // and every edge
  EXPECT_TRUE(few.IsWorthIt());
  EmbreeScene scene(b.Scene);
  scene.SetTime(0, 0);
  EXPECT_EQ(scene.TestedTriangles(), 26);
  EmbreeScene::Context context;
  scene.Begin(context);
  std::mt19937 random(5);
  int met = 0, blocked = 0, ties = 0;
  for (int round = 0; round < 200; ++round)
  {
    Rays rays;
    for (int i = 0; i < 100; ++i)
      rays.Add(Somewhere(random) * 3.f, Somewhere(random), i % 2 ? Infinity : 1.5f);
    Wavefront& w = *rays.W;
    lanes::Meet(few, w);
    lanes::Block(few, w);
    for (int i = 0; i < w.Count; ++i)
    {
      TraceRay ray;
      ray.Origin = { w.Live.Ox[i], w.Live.Oy[i], w.Live.Oz[i] };
      ray.Direction = { w.Live.Dx[i], w.Live.Dy[i], w.Live.Dz[i] };
      SurfaceHit hit;
      const bool found = scene.Intersect(context, ray, hit);
      ASSERT_EQ(w.Alive[i] != 0, found);
      met += found;
      if (found)
      {
        EXPECT_NEAR(w.T[i], hit.T, 2e-6f * (1 + hit.T));
        if (w.Geometry[i] == hit.Geometry && w.Primitive[i] == hit.Primitive)
        {
          EXPECT_NEAR(w.U[i], hit.U, 1e-5f);
          EXPECT_NEAR(w.V[i], hit.V, 1e-5f);
        }
        else
          ++ties; // where boxes lie within another, or on an edge
      }
      else
        EXPECT_EQ(w.T[i], Infinity);
      ray.Far = w.Far[i];
      EXPECT_EQ(w.Lit[i] == 0, scene.Occluded(context, ray)) << w.T[i];
      blocked += w.Lit[i] == 0;
    }
  }
  EXPECT_GT(met, 4000);
  EXPECT_GT(blocked, 3000);
  EXPECT_LT(ties, 5);
}

TEST(SmallScene, NoRaySlipsThroughEdgesAndCorners)
{
  // An icosahedron seen from inside: rays to its corners, along its edges, and a hair beside them.
  const float g = 1.6180340f;
  const Vec3f p[12] = { { -1, g, 0 }, { 1, g, 0 }, { -1, -g, 0 }, { 1, -g, 0 }, { 0, -1, g }, { 0, 1, g },
    { 0, -1, -g }, { 0, 1, -g }, { g, 0, -1 }, { g, 0, 1 }, { -g, 0, -1 }, { -g, 0, 1 } };
  const int t[20][3] = { { 0, 11, 5 }, { 0, 5, 1 }, { 0, 1, 7 }, { 0, 7, 10 }, { 0, 10, 11 }, { 1, 5, 9 }, { 5, 11, 4 },
    { 11, 10, 2 }, { 10, 7, 6 }, { 7, 1, 8 }, { 3, 9, 4 }, { 3, 4, 2 }, { 3, 2, 6 }, { 3, 6, 8 }, { 3, 8, 9 },
    { 4, 9, 5 }, { 2, 4, 11 }, { 6, 2, 10 }, { 8, 6, 7 }, { 9, 8, 1 } };
  SmallScene few;
  std::mt19937 random(9);
  for (int k = 0; k < 20; ++k)
  {
    // whichever way round they are written, and with whichever corner first
    const int turn = int(random() % 3), flip = int(random() % 2);
    const int a = t[k][turn], b = t[k][(turn + 1 + flip) % 3], c = t[k][(turn + 2 - flip) % 3];
    ASSERT_TRUE(few.Add(p[a], p[b], p[c], 0, std::uint32_t(k)));
  }
  EXPECT_EQ(few.Edges, 30);
  std::uniform_real_distribution<float> u(0, 1);
  for (int round = 0; round < 1000; ++round)
  {
    Rays rays;
    for (int i = 0; i < 240; ++i)
    {
      const int* corner = t[random() % 20];
      const Vec3f from = Somewhere(random) * .8f, a = p[corner[0]], b = p[corner[1]];
      const float f = i % 3 == 0 ? 0 : u(random);
      Vec3f to = a + (b - a) * f;
      if (i % 2)
        to += Somewhere(random) * 1e-7f;
      rays.Add(from, to - from);
    }
    lanes::Meet(few, *rays.W);
    for (int i = 0; i < rays.W->Count; ++i)
    {
      ASSERT_NE(rays.W->Alive[i], 0u) << round << ' ' << i;
      ASSERT_NEAR(rays.W->T[i], 1, 3e-5f);
    }
  }
}

TEST(SmallScene, ARaysAnswerDoesNotDependOnItsCompany)
{
  const SceneBuilder b = Boxes();
  const SmallScene few = Listed(*b.Scene);
  std::mt19937 random(3);
  Rays all;
  for (int i = 0; i < 250; ++i)
    all.Add(Somewhere(random) * 3.f, Somewhere(random));
  lanes::Meet(few, *all.W);
  lanes::Block(few, *all.W);
  for (int i = 0; i < all.W->Count; ++i)
  {
    Rays alone;
    alone.W->Count = 0;
    const Wavefront& w = *all.W;
    const int k = alone.Add({ w.Live.Ox[i], w.Live.Oy[i], w.Live.Oz[i] }, { w.Live.Dx[i], w.Live.Dy[i], w.Live.Dz[i] });
    lanes::Meet(few, *alone.W);
    lanes::Block(few, *alone.W);
    EXPECT_EQ(std::memcmp(&alone.W->T[k], &w.T[i], 4), 0);
    EXPECT_EQ(alone.W->Alive[k], w.Alive[i]);
    EXPECT_EQ(alone.W->Geometry[k], w.Geometry[i]);
    EXPECT_EQ(alone.W->Primitive[k], w.Primitive[i]);
    EXPECT_EQ(alone.W->Lit[k], w.Lit[i]);
    if (w.Alive[i])
    {
      EXPECT_EQ(std::memcmp(&alone.W->U[k], &w.U[i], 4), 0);
      EXPECT_EQ(std::memcmp(&alone.W->V[k], &w.V[i], 4), 0);
    }
  }
}

TEST(SmallScene, EveryInstructionSetFindsTheSameBits)
{
  const SceneBuilder b = Boxes();
  const SmallScene few = Listed(*b.Scene);
  const auto find = [&]
  {
    std::mt19937 random(4);
    std::vector<std::uint32_t> bits;
    for (int round = 0; round < 20; ++round)
    {
      Rays rays;
      for (int i = 0; i < 250; ++i)
        rays.Add(Somewhere(random) * 3.f, Somewhere(random), 2);
      lanes::Meet(few, *rays.W);
      lanes::Block(few, *rays.W);
      const Wavefront& w = *rays.W;
      for (int i = 0; i < w.Count; ++i)
      {
        const float numbers[] = { w.Alive[i] ? w.U[i] : 0, w.Alive[i] ? w.V[i] : 0, w.T[i] };
        std::uint32_t words[3];
        std::memcpy(words, numbers, sizeof words);
        bits.insert(bits.end(), { words[0], words[1], words[2], w.Alive[i], w.Geometry[i], w.Primitive[i], w.Lit[i] });
      }
    }
    return bits;
  };
  const std::vector<std::uint32_t> best = find();
  for (const SimdTarget& target : SimdTargets())
  {
    ForceSimdTarget(target.Id);
    EXPECT_TRUE(find() == best) << target.Name;
  }
  ForceSimdTarget(0);
}

TEST(SmallScene, UnusableRaysMeetNothing)
{
  const SmallScene few = Listed(*Boxes().Scene);
  Rays rays;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  rays.Add({ 0, 0, 3 }, { nan, 0, -1 });
  rays.Add({ nan, 0, 3 }, { 0, 0, -1 });
  rays.Add({ 0, 0, 3 }, { 0, 0, 0 });
  rays.Add({ 0, 0, Infinity }, { 0, 0, -1 });
  const int good = rays.Add({ 0, 0, 3 }, { 0, 0, -1 });
  lanes::Meet(few, *rays.W);
  lanes::Block(few, *rays.W);
  for (int i = 0; i < good; ++i)
  {
    EXPECT_EQ(rays.W->Alive[i], 0u) << i;
    EXPECT_NE(rays.W->Lit[i], 0u) << i;
  }
  EXPECT_NE(rays.W->Alive[good], 0u);
  EXPECT_EQ(rays.W->Lit[good], 0u);
}

TEST(SmallScene, TakesWhatItHasPlaceForAndNothingElse)
{
  SmallScene few;
  EXPECT_FALSE(few.IsWorthIt());
  EXPECT_FALSE(few.Add({ 0, 0, 0 }, { 1, 0, 0 }, { 2, 0, 0 }, 0, 0)); // no area
  EXPECT_FALSE(few.Add({ 0, 0, 0 }, { 2e9f, 0, 0 }, { 0, 1, 0 }, 0, 0));
  EXPECT_FALSE(few.Add({ 0, 0, 0 }, { 1e-12f, 0, 0 }, { 0, 1e-12f, 0 }, 0, 0));
  few.Clear();
  std::mt19937 random(1);
  int taken = 0;
  while (taken < 1000 && few.Add(Somewhere(random), Somewhere(random), Somewhere(random), 0, 0))
    ++taken;
  EXPECT_EQ(taken, SmallScene::MostVertices / 3);
  EXPECT_FALSE(few.IsWorthIt()); // triangles that share nothing

  // Embree goes on where there is more, and where filters decide.
  SceneBuilder b = Boxes();
  for (int i = 0; i < 4; ++i)
    b.Box(0, { float(i), 2, 0 }, { float(i) + .5f, 3, 1 });
  EmbreeScene larger(b.Scene);
  larger.SetTime(0, 0);
  EXPECT_EQ(larger.TestedTriangles(), 0);
  SceneBuilder c = Boxes();
  c.Scene->Materials[0].Mode = AlphaMode::Mask;
  EmbreeScene seeThrough(c.Scene);
  seeThrough.SetTime(0, 0);
  EXPECT_EQ(seeThrough.TestedTriangles(), 0);
  EmbreeScene::Options asked;
  asked.TestAll = false;
  EmbreeScene never(Boxes().Scene, asked);
  never.SetTime(0, 0);
  EXPECT_EQ(never.TestedTriangles(), 0);
}
