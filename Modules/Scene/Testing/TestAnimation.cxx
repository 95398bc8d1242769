// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTestFiles.h"

#include <cmath>

using namespace quell;
using namespace scenetest;

namespace
{
constexpr double Pi = 3.14159265358979323846;
float F(double v)
{
  return float(v);
}
}

TEST(Animation, LinearTranslationHoldsItsEnds)
{
  Gltf g;
  g.Animate("translation", "LINEAR", { 1, 3 }, { 0, 0, 0, 4, -2, 8 }, 3);
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(scene->Animated());
  EXPECT_DOUBLE_EQ(scene->Duration(), 3);
  const double at[][2] = { { -1, 0 }, { 0, 0 }, { 1, 0 }, { 1.5, 0.25 }, { 2, 0.5 }, { 3, 1 }, { 100, 1 } };
  for (const auto& a : at)
  {
    const Mat4 m = scene->WorldMatrices(a[0])[0];
    EXPECT_NEAR(m.m[0][3], 4 * a[1], 1e-12) << a[0];
    EXPECT_NEAR(m.m[1][3], -2 * a[1], 1e-12);
    EXPECT_NEAR(m.m[2][3], 8 * a[1], 1e-12);
  }
}

TEST(Animation, LinearRotationIsSlerpAlongTheShorterArc)
{
  const double s = std::sin(Pi / 3), c = std::cos(Pi / 3); // 120 degrees about y
  for (const double sign : { 1., -1. })                    // q and -q are the same rotation
  {
    Gltf g;
    g.Animate("rotation", "LINEAR", { 0, 1 }, { 0, 0, 0, 1, 0, F(sign * s), 0, F(sign * c) }, 4);
    const auto scene = LoadOnce(g.WriteGltf());
    for (const double t : { 0., 0.1, 0.25, 0.5, 0.9, 1. })
    {
      const Mat4 m = scene->WorldMatrices(t)[0];
      const double angle = t * 2 * Pi / 3; // constant speed: a blend of matrices or quaternions would lag
      EXPECT_NEAR(m.m[0][0], std::cos(angle), 1e-6) << t;
      EXPECT_NEAR(m.m[0][2], std::sin(angle), 1e-6) << t;
      EXPECT_NEAR(m.m[2][0], -std::sin(angle), 1e-6) << t;
      EXPECT_NEAR(m.m[1][1], 1, 1e-12);
      EXPECT_NEAR(m.Determinant3(), 1, 1e-12);
    }
  }
}

TEST(Animation, StepKeepsTheKeyUntilTheNext)
{
  Gltf g;
  g.Animate("scale", "STEP", { 0, 1, 2 }, { 1, 1, 1, 2, 3, 4, 5, 5, 5 }, 3);
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_DOUBLE_EQ(scene->WorldMatrices(0.999)[0].m[1][1], 1);
  EXPECT_DOUBLE_EQ(scene->WorldMatrices(1)[0].m[1][1], 3);
  EXPECT_DOUBLE_EQ(scene->WorldMatrices(1.999)[0].m[2][2], 4);
  EXPECT_DOUBLE_EQ(scene->WorldMatrices(2)[0].m[2][2], 5);
}

TEST(Animation, CubicSplineIsHermiteWithTangentsPerSecond)
{
  Gltf g;
  // Keys at 1 and 3: (in tangent, value, out tangent) each.
  g.Animate("translation", "CUBICSPLINE", { 1, 3 }, { 9, 9, 9, 0, 1, 2, 1, 0, -1, -1, 2, 0, 4, 1, 2, 7, 7, 7 }, 3);
  const auto scene = LoadOnce(g.WriteGltf());
  const double value[2][3] = { { 0, 1, 2 }, { 4, 1, 2 } }, out[3] = { 1, 0, -1 }, in[3] = { -1, 2, 0 };
  for (const double time : { 0., 1., 1.5, 2., 2.7, 3., 4. })
  {
    const double t = std::min(std::max((time - 1) / 2, 0.), 1.);
    const Mat4 m = scene->WorldMatrices(time)[0];
    for (int i = 0; i < 3; ++i)
    {
      const double expected = (2 * t * t * t - 3 * t * t + 1) * value[0][i] + 2 * (t * t * t - 2 * t * t + t) * out[i] +
                              (3 * t * t - 2 * t * t * t) * value[1][i] + 2 * (t * t * t - t * t) * in[i];
      EXPECT_NEAR(m.m[i][3], expected, 1e-12) << time << " " << i;
    }
  }
  EXPECT_NEAR(scene->WorldMatrices(2)[0].m[0][3], 2.5, 1e-12);
}

TEST(Animation, CubicSplineRotationIsNormalized)
{
  Gltf g;
  const float h = F(std::sqrt(0.5));
  g.Animate(
    "rotation", "CUBICSPLINE", { 0, 1 }, { 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, h, 0, h, 0, 0, 0, 0 }, 4);
  const Mat4 m = LoadOnce(g.WriteGltf())->WorldMatrices(0.5)[0];
  EXPECT_NEAR(m.Determinant3(), 1, 1e-12);
  EXPECT_NEAR(m.m[0][0], std::cos(Pi / 4), 1e-6); // halfway by symmetry
  EXPECT_NEAR(m.m[0][2], std::sin(Pi / 4), 1e-6);
}

TEST(Animation, HierarchyMatrixAndMirror)
{
  Gltf g;
  g.Doc["nodes"] = { { { "children", { 1 } }, { "translation", { 10, 0, 0 } }, { "scale", { -1, 1, 1 } } },
    { { "mesh", 0 }, { "matrix", { 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1 } } } };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_FALSE(scene->Animated());
  const Mat4 world = scene->WorldMatrices(0)[1];
  const Vec3d p = world.Point({ 1, 0, 0 }); // matrix (column-major): (1, 0, 0) -> (1, 3, 3); then mirrored and moved
  EXPECT_NEAR(p.x, 9, 1e-12);
  EXPECT_NEAR(p.y, 3, 1e-12);
  EXPECT_NEAR(p.z, 3, 1e-12);
  EXPECT_LT(world.Determinant3(), 0);
}

TEST(Animation, DeepChainsNeedNoStack)
{
  Gltf g;
  Json nodes = Json::array();
  const int n = 100000;
  for (int i = 0; i < n; ++i)
    nodes.push_back({ { "translation", { 1, 0, 0 } }, { "children", { i + 1 } } });
  nodes.push_back({ { "mesh", 0 } });
  g.Doc["nodes"] = nodes;
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Instances.size(), 1u);
  EXPECT_NEAR(scene->WorldMatrices(0).back().m[0][3], n, 1e-6);
}

TEST(Animation, ClipsThatMoveTheSameNodeAreLeftOut)
{
  Gltf g;
  g.Animate("translation", "LINEAR", { 0, 1 }, { 0, 0, 0, 1, 0, 0 }, 3);
  g.Animate("scale", "LINEAR", { 0, 1 }, { 1, 1, 1, 2, 2, 2 }, 3);
  g.Animate("translation", "LINEAR", { 0, 9 }, { 5, 5, 5, 6, 6, 6 }, 3);
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Animation.size(), 2u);
  EXPECT_DOUBLE_EQ(scene->Duration(), 1);
  EXPECT_TRUE(HasWarning(*scene, "animations[2]"));
}

TEST(Animation, OneClipCanBeChosenByNameOrNumber)
{
  Gltf g;
  g.Animate("translation", "LINEAR", { 0, 1 }, { 0, 0, 0, 1, 0, 0 }, 3);
  g.Animate("translation", "LINEAR", { 0, 9 }, { 5, 5, 5, 6, 6, 6 }, 3);
  g.Doc["animations"][0]["name"] = "walk";
  g.Doc["animations"][1]["name"] = "run";
  const std::string file = g.WriteGltf();
  const auto choose = [&](const char* name)
  {
    SceneOptions options;
    options.Animation = name;
    return LoadScene(file, options);
  };
  for (const char* name : { "run", "1" })
  {
    EXPECT_DOUBLE_EQ(choose(name)->Duration(), 9) << name;
    EXPECT_TRUE(choose(name)->Warnings.empty()) << name;
  }
  EXPECT_DOUBLE_EQ(choose("walk")->Duration(), 1);
  const auto refusal = [&](const char* name) -> std::string
  {
    try
    {
      choose(name);
    }
    catch (const SceneError& e)
    {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(refusal("fly").find("no animation \"fly\"; the scene has 0 \"walk\", 1 \"run\""), std::string::npos);
  EXPECT_NE(refusal("2").find("no animation \"2\""), std::string::npos);
  EXPECT_NE(refusal("-1").find("no animation"), std::string::npos);
  const std::string still = Gltf().WriteGltf();
  SceneOptions options;
  options.Animation = "walk";
  try
  {
    LoadScene(still, options);
    ADD_FAILURE() << "it has none";
  }
  catch (const SceneError& e)
  {
    EXPECT_NE(std::string(e.what()).find("no animation \"walk\"; the scene has none"), std::string::npos) << e.what();
  }
  std::remove(still.c_str());
  std::remove(file.c_str());
}

TEST(Animation, Errors)
{
  {
    Gltf g;
    g.Animate("translation", "LINEAR", { 1, 0 }, { 0, 0, 0, 1, 0, 0 }, 3);
    const std::string file = g.WriteGltf();
    ExpectError(ErrorOf(file), file, "animations[0].samplers[0].input", "do not ascend at key 1", "export");
  }
  {
    Gltf g;
    g.Animate("translation", "CUBICSPLINE", { 0, 1 }, { 0, 0, 0, 1, 0, 0 }, 3);
    const std::string file = g.WriteGltf();
    ExpectError(ErrorOf(file), file, "animations[0].samplers[0].output", "2 values for 2 times where 6", "export");
  }
  {
    Gltf g;
    g.Animate("scale", "LINEAR", { 0, 1 }, { 0, 0, NAN, 1, 0, 0 }, 3);
    const std::string file = g.WriteGltf();
    ExpectError(ErrorOf(file), file, "animations[0].samplers[0].output", "not finite", "export");
  }
  {
    Gltf g;
    g.Animate("scale", "BEZIER", { 0, 1 }, { 0, 0, 0, 1, 0, 0 }, 3);
    const std::string file = g.WriteGltf();
    ExpectError(ErrorOf(file), file, "animations[0].samplers[0].interpolation", "BEZIER", "CUBICSPLINE");
  }
}
