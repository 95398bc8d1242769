// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTestFiles.h"

#include <cmath>
#include <functional>
#include <ostream>

using namespace quell;
using namespace scenetest;

namespace
{
constexpr float Half = 0.70710678f; // sin 45 degrees

void ExpectAt(const Vec3f& found, const Vec3d& expected, double tolerance, const char* what, std::size_t i)
{
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(found[c], expected[c], tolerance) << what << " " << i << " component " << c;
}

/// A bar of three rows along y at x = -1/2 and 1/2 with normals +x and tangents +y. Joint 0 (node 1) holds the lower
/// end, joint 1 (node 2, at y = 1) the upper one, both the middle; in one second joint 1 turns by 90 degrees about z.
Gltf Bar(bool bytes)
{
  Gltf g;
  Json& attributes = g.Primitive()["attributes"];
  attributes["POSITION"] =
    g.Floats({ -0.5f, 0, 0, 0.5f, 0, 0, -0.5f, 1, 0, 0.5f, 1, 0, -0.5f, 2, 0, 0.5f, 2, 0 }, "VEC3", 3);
  attributes["NORMAL"] = g.Floats({ 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0 }, "VEC3", 3);
  attributes["TANGENT"] =
    g.Floats({ 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, -1, 0, 1, 0, 1, 0, 1, 0, 1 }, "VEC4", 4);
  std::vector<std::uint16_t> joints;
  std::vector<float> weights;
  std::vector<std::uint8_t> rounded;
  for (int row = 0; row < 3; ++row)
    for (int side = 0; side < 2; ++side)
    {
      joints.insert(joints.end(), { 0, 1, 0, 0 });
      const float w[4] = { row == 0 ? 1.f : row == 1 ? 0.5f : 0.f, row == 0 ? 0.f : row == 1 ? 0.5f : 1.f, 0, 0 };
      weights.insert(weights.end(), w, w + 4);
      for (const float v : w)
        rounded.push_back(std::uint8_t(v == 0.5f ? 100 : v * 255)); // 100 + 100: to be normalised
    }
  if (bytes)
  {
    attributes["JOINTS_0"] = g.Accessor(std::vector<std::uint8_t>(joints.begin(), joints.end()), 5121, "VEC4", 4);
    attributes["WEIGHTS_0"] = g.Accessor(rounded, 5121, "VEC4", 4);
    g.Doc["accessors"].back()["normalized"] = true;
  }
  else
  {
    attributes["JOINTS_0"] = g.Accessor(joints, 5123, "VEC4", 4);
    attributes["WEIGHTS_0"] = g.Floats(weights, "VEC4", 4);
  }
  g.Primitive()["indices"] = g.Indices({ 0, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4 });
  g.Doc["meshes"][0]["name"] = "bar";
  const int bind = g.Floats(
    { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1 }, "MAT4", 16);
  g.Doc["skins"] = { { { "name", "bones" }, { "joints", { 1, 2 } }, { "skeleton", 1 },
    { "inverseBindMatrices", bind } } };
  // The mesh's own node is far off and mirrored, which must not matter.
  g.Doc["nodes"] = { { { "mesh", 0 }, { "skin", 0 }, { "translation", { 100, 0, 0 } }, { "scale", { -1, 2, 1 } } },
    { { "children", { 2 } } }, { { "translation", { 0, 1, 0 } } } };
  g.Doc["scenes"][0]["nodes"] = { 0, 1 };
  g.Animate("rotation", "LINEAR", { 0, 1 }, { 0, 0, 0, 1, 0, 0, Half, Half }, 4);
  g.Doc["animations"][0]["channels"][0]["target"]["node"] = 2;
  return g;
}

struct Deformed
{
  std::vector<Vec3f> P, N;
  std::vector<Vec4f> T;
};
Deformed At(const Scene& scene, double time, const Vec3d& origin = Vec3d(), std::size_t instance = 0)
{
  Deformed d;
  scene.Deform(scene.Instances.at(instance), scene.PoseAt(time), origin, d.P, &d.N, &d.T);
  return d;
}

/// One triangle with two morph targets: +2z at corner 2 (with a normal), and -x at corners 1 and 2 as a sparse
/// accessor.
Gltf Morph()
{
  Gltf g;
  g.Primitive()["attributes"]["NORMAL"] = g.Floats({ 0, 0, 1, 0, 0, 1, 0, 0, 1 }, "VEC3", 3);
  g.Primitive()["attributes"]["TANGENT"] = g.Floats({ 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, -1 }, "VEC4", 4);
  const int up = g.Floats({ 0, 0, 0, 0, 0, 0, 0, 0, 2 }, "VEC3", 3),
            normal = g.Floats({ 0, 0, 0, 0, 0, 0, 0, -2, 0 }, "VEC3", 3),
            tangent = g.Floats({ 0, 0, 0, 0, 0, 0, 0, 0, 2 }, "VEC3", 3);
  const std::vector<std::uint8_t> where{ 1, 2 };
  const std::vector<float> what{ -1, 0, 0, -1, 0, 0 };
  const int indices = g.View(where.data(), 2), values = g.View(what.data(), 24);
  g.Doc["accessors"].push_back({ { "componentType", 5126 }, { "type", "VEC3" }, { "count", 3 },
    { "sparse", { { "count", 2 }, { "indices", { { "bufferView", indices }, { "componentType", 5121 } } },
                  { "values", { { "bufferView", values } } } } } });
  const int left = int(g.Doc["accessors"].size()) - 1;
  g.Primitive()["targets"] = { { { "POSITION", up }, { "NORMAL", normal }, { "TANGENT", tangent } },
    { { "POSITION", left } } };
  g.Doc["meshes"][0]["name"] = "face";
  return g;
}

void AnimateWeights(Gltf& g, const char* mode, const std::vector<float>& times, const std::vector<float>& values)
{
  g.Animate("weights", mode, times, values, 3);
  Json& accessor = g.Doc["accessors"].back();
  accessor["type"] = "SCALAR";
  accessor["count"] = values.size();
}
}

class Skinning : public testing::TestWithParam<bool>
{
};
TEST_P(Skinning, BarBentByARightAngle)
{
  const auto scene = LoadOnce(Bar(GetParam()).WriteGltf());
  EXPECT_EQ(scene->Warnings.size(), GetParam() ? 1u : 0u);
  EXPECT_EQ(HasWarning(*scene, "\"bar\": the joint weights of 2 vertices do not sum to 1"), GetParam());
  ASSERT_EQ(scene->Skins.size(), 1u);
  EXPECT_EQ(scene->Skins[0].Name, "bones");
  EXPECT_EQ(scene->Skins[0].Skeleton, 1);
  EXPECT_EQ(scene->Skins[0].Joints, (std::vector<int>{ 1, 2 }));
  EXPECT_EQ(scene->Skins[0].InverseBind[1].m[1][3], -1);
  EXPECT_EQ(scene->Nodes[0].Skin, 0);
  EXPECT_EQ(scene->Meshes[0].Influences, 4);
  EXPECT_TRUE(scene->Deforms(scene->Instances[0]));
  EXPECT_TRUE(scene->Moves(scene->Instances[0]));
  for (const double time : { 0., 1., 0.5, 7. })
  {
    const double a = std::min(time, 1.) * 1.5707963267948966, c = std::cos(a), s = std::sin(a);
    const Vec3d origin(3, -4, 5);
    const Deformed d = At(*scene, time, origin);
    ASSERT_EQ(d.P.size(), 6u);
    for (std::size_t i = 0; i < 6; ++i)
    {
      const double x = i % 2 ? 0.5 : -0.5, y = double(i / 2), w = y / 2;
      // Blended: (1 - w) (x, y) + w (R (x, y - 1) + (0, 1)); the matrix is (1 - w) I + w R.
      const Vec3d p((1 - w) * x + w * (c * x - s * (y - 1)), (1 - w) * y + w * (s * x + c * (y - 1) + 1), 0);
      const double mc = 1 - w + w * c, ms = w * s, l = std::sqrt(mc * mc + ms * ms);
      ExpectAt(d.P[i], p - origin, 2e-6, "position", i);
      ExpectAt(d.N[i], Vec3d(mc / l, ms / l, 0), 2e-6, "normal", i);
      ExpectAt(d.T[i].xyz(), Vec3d(-ms / l, mc / l, 0), 2e-6, "tangent", i);
      EXPECT_EQ(d.T[i].w, i == 3 ? -1 : 1) << "the joints do not mirror";
    }
    EXPECT_FALSE(scene->Mirrors(scene->Instances[0], scene->PoseAt(time)));
  }
  // At 90 degrees the far end points to -x: corners (-1, 0.5) and (-1, 1.5).
  Vec3d low, high;
  ASSERT_TRUE(scene->Bounds(scene->PoseAt(1), low, high));
  EXPECT_NEAR(low.x, -1, 1e-6);
  EXPECT_NEAR(low.y, 0, 1e-6);
  EXPECT_NEAR(high.x, 0.5, 1e-6);
  EXPECT_NEAR(high.y, 1.5, 1e-6);
}
INSTANTIATE_TEST_SUITE_P(Weights, Skinning, testing::Bool(),
  [](const testing::TestParamInfo<bool>& tested) { return tested.param ? "Bytes" : "Floats"; });

TEST(Deform, EightJointsPerVertex)
{
  Gltf g;
  std::vector<std::uint8_t> low, high;
  std::vector<float> some;
  for (int i = 0; i < 3; ++i)
  {
    low.insert(low.end(), { 0, 1, 2, 3 });
    high.insert(high.end(), { 4, 5, 6, 7 });
    some.insert(some.end(), { 0.125f, 0.125f, 0.125f, 0.125f });
  }
  g.Primitive()["attributes"]["JOINTS_0"] = g.Accessor(low, 5121, "VEC4", 4);
  g.Primitive()["attributes"]["JOINTS_1"] = g.Accessor(high, 5121, "VEC4", 4);
  g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats(some, "VEC4", 4);
  g.Primitive()["attributes"]["WEIGHTS_1"] = g.Floats(some, "VEC4", 4);
  Json joints = Json::array();
  for (int k = 1; k <= 8; ++k)
  {
    joints.push_back(k);
    g.Doc["nodes"].push_back({ { "translation", { 0, 0, k } } });
    g.Doc["scenes"][0]["nodes"].push_back(k);
  }
  g.Doc["skins"] = { { { "joints", joints } } };
  g.Doc["nodes"][0]["skin"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(scene->Warnings.empty());
  EXPECT_EQ(scene->Meshes[0].Influences, 8);
  const Deformed d = At(*scene, 0);
  ExpectAt(d.P[1], Vec3d(1, 0, 4.5), 1e-6, "mean of 1 to 8", 1);
  EXPECT_TRUE(d.N.empty());
  EXPECT_FALSE(scene->Moves(scene->Instances[0]));
}

TEST(Deform, SkinsFarFromTheOriginKeepTheirDigits)
{
  Gltf g;
  const float third = 1.f / 3;
  std::vector<float> weights;
  std::vector<std::uint8_t> joints;
  for (int i = 0; i < 3; ++i)
  {
    weights.insert(weights.end(), { third, third, third, 0 });
    joints.insert(joints.end(), { 0, 1, 2, 0 });
  }
  g.Primitive()["attributes"]["JOINTS_0"] = g.Accessor(joints, 5121, "VEC4", 4);
  g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats(weights, "VEC4", 4);
  g.Doc["skins"] = { { { "joints", { 1, 2, 3 } } } };
  g.Doc["nodes"] = { { { "mesh", 0 }, { "skin", 0 } }, { { "translation", { 3e6, -1e6, 2e6 } } },
    { { "translation", { 3e6, -1e6, 2e6 } } }, { { "translation", { 3e6, -1e6, 2e6 } } } };
  g.Doc["scenes"][0]["nodes"] = { 0, 1, 2, 3 };
  const auto scene = LoadOnce(g.WriteGltf());
  const Deformed d = At(*scene, 0, Vec3d(3e6, -1e6, 2e6));
  ExpectAt(d.P[1], Vec3d(1, 0, 0), 1e-8, "position", 1);
  ExpectAt(d.P[2], Vec3d(0, 1, 0), 1e-8, "position", 2);
}

TEST(Deform, MeshWithSeveralSkinsAndNone)
{
  Gltf g = Bar(false);
  // Node 3: the same mesh without a skin; node 4: with another skin, whose only two joints mirror and move.
  g.Doc["nodes"].push_back({ { "mesh", 0 }, { "scale", { -1, 1, 1 } } });
  g.Doc["nodes"].push_back({ { "mesh", 0 }, { "skin", 1 } });
  g.Doc["nodes"].push_back({ { "scale", { 1, 1, -1 } }, { "translation", { 0, 0, 9 } } });
  g.Doc["skins"].push_back({ { "joints", { 5, 5 } } });
  g.Doc["scenes"][0]["nodes"] = { 0, 1, 3, 4, 5 };
  const auto scene = LoadOnce(g.WriteGltf());
  ASSERT_EQ(scene->Meshes.size(), 1u) << "vertices are shared";
  ASSERT_EQ(scene->Instances.size(), 3u);
  EXPECT_EQ(scene->MovingInstances(), (std::vector<char>{ 1, 0, 0 }));
  EXPECT_FALSE(scene->Deforms(scene->Instances[1]));
  EXPECT_TRUE(scene->Deforms(scene->Instances[2]));
  const ScenePose pose = scene->PoseAt(1);
  EXPECT_TRUE(scene->Mirrors(scene->Instances[1], pose));
  EXPECT_TRUE(scene->Mirrors(scene->Instances[2], pose));
  const Deformed plain = At(*scene, 1, Vec3d(), 1), other = At(*scene, 1, Vec3d(), 2);
  ExpectAt(plain.P[5], Vec3d(-0.5, 2, 0), 1e-6, "only transformed", 5);
  ExpectAt(plain.N[5], Vec3d(-1, 0, 0), 1e-6, "only transformed", 5);
  EXPECT_EQ(plain.T[5].w, -1) << "mirrored";
  EXPECT_EQ(plain.T[3].w, 1) << "-1 in the file, mirrored";
  ExpectAt(other.P[5], Vec3d(0.5, 2, 9), 1e-6, "mirrored by the joint", 5);
  EXPECT_EQ(other.T[5].w, -1);
}

TEST(Deform, JointsOutsideOfTheShownSceneMoveTheMesh)
{
  Gltf g = Bar(false);
  g.Doc["scenes"][0]["nodes"] = { 0 };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Animation.size(), 1u);
  ExpectAt(At(*scene, 1).P[5], Vec3d(-1, 1.5, 0), 1e-6, "position", 5);
}

TEST(Deform, UnusableJointWeights)
{
  Gltf g;
  g.Doc["meshes"][0]["name"] = "rag";
  g.Primitive()["attributes"]["JOINTS_0"] =
    g.Accessor<std::uint8_t>({ 1, 0, 0, 0, 1, 1, 0, 0, 99, 1, 0, 0 }, 5121, "VEC4", 4);
  g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats({ NAN, 0, 0, 0, -1, 3, 0, 0, 0, 1, 0, 0 }, "VEC4", 4);
  g.Doc["skins"] = { { { "joints", { 1, 2 } } } };
  g.Doc["nodes"] = { { { "mesh", 0 }, { "skin", 0 } }, { { "translation", { 0, 0, 1 } } },
    { { "translation", { 0, 0, 2 } } } };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "\"rag\": 2 joint weight(s) negative or not finite became 0"));
  EXPECT_TRUE(HasWarning(*scene, "\"rag\": 1 vertices have no joint weight and follow the first joint"));
  const Deformed d = At(*scene, 0);
  ExpectAt(d.P[0], Vec3d(0, 0, 1), 1e-6, "first joint", 0);
  ExpectAt(d.P[1], Vec3d(1, 0, 2), 1e-6, "what is left", 1);
  ExpectAt(d.P[2], Vec3d(0, 1, 2), 1e-6, "a joint of weight 0 need not exist", 2);
}

TEST(Deform, SkinWithoutJointsInTheMesh)
{
  Gltf g;
  g.Doc["meshes"][0]["name"] = "stiff";
  g.Doc["skins"] = { { { "joints", { 0 } } } };
  g.Doc["nodes"][0]["skin"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "the skin moves nothing: mesh \"stiff\""));
  EXPECT_FALSE(scene->Deforms(scene->Instances[0]));
  Gltf half;
  half.Primitive()["attributes"]["JOINTS_0"] =
    half.Accessor<std::uint8_t>({ 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }, 5121, "VEC4", 4);
  EXPECT_TRUE(HasWarning(*LoadOnce(half.WriteGltf()), "JOINTS_0 without WEIGHTS_0 is ignored"));
}

TEST(Deform, MorphTargetsAtRest)
{
  Gltf g = Morph();
  g.Doc["meshes"][0]["weights"] = { 0.5, 0.25 };
  g.Doc["nodes"] = { { { "mesh", 0 } }, { { "mesh", 0 }, { "weights", { 0, 1 } }, { "translation", { 0, 5, 0 } } } };
  g.Doc["scenes"][0]["nodes"] = { 0, 1 };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(scene->Warnings.empty());
  ASSERT_EQ(scene->Meshes.size(), 1u);
  ASSERT_EQ(scene->Meshes[0].Targets.size(), 2u);
  EXPECT_TRUE(scene->Meshes[0].Targets[1].Normals.empty());
  EXPECT_EQ(scene->Nodes[0].Weights, (std::vector<float>{ 0.5f, 0.25f }));
  EXPECT_EQ(scene->Nodes[1].Weights, (std::vector<float>{ 0, 1 })) << "the node's own go first";
  EXPECT_TRUE(scene->Deforms(scene->Instances[0]));
  EXPECT_FALSE(scene->Moves(scene->Instances[0]));
  const Deformed a = At(*scene, 0, Vec3d(), 0), b = At(*scene, 0, Vec3d(), 1);
  ExpectAt(a.P[0], Vec3d(0, 0, 0), 1e-7, "position", 0);
  ExpectAt(a.P[1], Vec3d(0.75, 0, 0), 1e-7, "position", 1);
  ExpectAt(a.P[2], Vec3d(-0.25, 1, 1), 1e-7, "position", 2);
  ExpectAt(a.N[2], Vec3d(0, -1, 1) / std::sqrt(2.), 1e-6, "normal (0, 0, 1) + (0, -2, 0) / 2", 2);
  ExpectAt(a.T[2].xyz(), Vec3d(1, 0, 1) / std::sqrt(2.), 1e-6, "tangent", 2);
  EXPECT_EQ(a.T[2].w, -1);
  ExpectAt(b.P[2], Vec3d(-1, 6, 0), 1e-7, "position", 2);
  ExpectAt(b.N[2], Vec3d(0, 0, 1), 1e-7, "normal", 2);
  std::vector<Vec3f> only;
  scene->Deform(scene->Instances[0], scene->PoseAt(0), Vec3d(), only, nullptr, nullptr);
  EXPECT_EQ(only[2], a.P[2]);
}

TEST(Deform, MorphWeightsLinearAndStep)
{
  for (const bool step : { false, true })
  {
    Gltf g = Morph();
    AnimateWeights(g, step ? "STEP" : "LINEAR", { 0, 2, 4 }, { 0, 0, 1, 0.5f, 0, 2 });
    const auto scene = LoadOnce(g.WriteGltf());
    EXPECT_EQ(scene->Animation.at(0).Width(), 2u);
    EXPECT_TRUE(scene->Moves(scene->Instances[0]));
    EXPECT_DOUBLE_EQ(scene->Duration(), 4);
    const double expected[][3] = { { -1, 0, 0 }, { 0.5, 0.25, 0.125 }, { 2, 1, 0.5 }, { 3, 0.5, 1.25 }, { 9, 0, 2 } };
    const double held[][3] = { { -1, 0, 0 }, { 0.5, 0, 0 }, { 2, 1, 0.5 }, { 3, 1, 0.5 }, { 9, 0, 2 } };
    for (const auto& e : step ? held : expected)
    {
      const ScenePose pose = scene->PoseAt(e[0]);
      ASSERT_EQ(pose.Weights.at(0).size(), 2u);
      EXPECT_NEAR(pose.Weights[0][0], e[1], 1e-7) << e[0];
      EXPECT_NEAR(pose.Weights[0][1], e[2], 1e-7) << e[0];
      ExpectAt(At(*scene, e[0]).P[2], Vec3d(-e[2], 1, 2 * e[1]), 1e-6, "position", 2);
    }
  }
}

TEST(Deform, MorphWeightsCubicSpline)
{
  Gltf g = Morph();
  // Keys at 1 and 3; each has in-tangents, values and out-tangents of both targets.
  AnimateWeights(g, "CUBICSPLINE", { 1, 3 }, { 9, 9, 0, 1, 2, -1, -3, 0.5f, 1, 0, 7, 7 });
  const auto scene = LoadOnce(g.WriteGltf());
  const double from[2] = { 0, 1 }, out[2] = { 2, -1 }, in[2] = { -3, 0.5 }, to[2] = { 1, 0 };
  for (const double time : { 0., 1., 1.5, 2., 2.9, 3., 5. })
  {
    const double t = std::min(std::max((time - 1) / 2, 0.), 1.), t2 = t * t, t3 = t2 * t;
    double w[2];
    for (int k = 0; k < 2; ++k)
      w[k] = (2 * t3 - 3 * t2 + 1) * from[k] + 2 * (t3 - 2 * t2 + t) * out[k] + (3 * t2 - 2 * t3) * to[k] +
             2 * (t3 - t2) * in[k];
    ExpectAt(At(*scene, time).P[2], Vec3d(-w[1], 1, 2 * w[0]), 1e-6, "position", 2);
  }
}

TEST(Deform, MorphingComesBeforeTheSkin)
{
  Gltf g = Bar(false);
  std::vector<float> out(18, 0.f);
  out[15] = 1; // vertex 5 moves by +x
  g.Primitive()["targets"] = { { { "POSITION", g.Floats(out, "VEC3", 3) } } };
  g.Doc["meshes"][0]["weights"] = { 2 };
  const auto scene = LoadOnce(g.WriteGltf());
  ExpectAt(At(*scene, 0).P[5], Vec3d(2.5, 2, 0), 1e-6, "position", 5);
  ExpectAt(At(*scene, 1).P[5], Vec3d(-1, 3.5, 0), 2e-6, "turned with the joint", 5);
}

TEST(Deform, QuantizedTargets)
{
  Gltf g;
  g.Doc["extensionsRequired"] = { "KHR_mesh_quantization" };
  g.Primitive()["attributes"]["POSITION"] =
    g.Accessor<std::int16_t>({ 0, 0, 0, 300, 0, 0, 0, 300, 0 }, 5122, "VEC3", 3);
  g.Primitive()["targets"] = {
    { { "POSITION", g.Accessor<std::int8_t>({ 0, 0, 127, 0, 0, -127, 0, 0, 0 }, 5120, "VEC3", 3) } }
  };
  g.Doc["accessors"].back()["normalized"] = true;
  g.Doc["nodes"][0]["scale"] = { 0.01, 0.01, 1 };
  g.Doc["nodes"][0]["weights"] = { 1 };
  const auto scene = LoadOnce(g.WriteGltf());
  const Deformed d = At(*scene, 0);
  ExpectAt(d.P[0], Vec3d(0, 0, 1), 1e-6, "position", 0);
  ExpectAt(d.P[1], Vec3d(3, 0, -1), 1e-6, "position", 1);
}

TEST(Deform, MoreOrFewerWeightsThanTargets)
{
  Gltf g = Morph();
  g.Doc["nodes"][0]["weights"] = { 1 };
  auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "nodes[0].weights: 1 weight(s) for 2 morph target(s)"));
  EXPECT_EQ(scene->Nodes[0].Weights, (std::vector<float>{ 1, 0 }));
  g.Doc["nodes"][0]["weights"] = { 1, 0.5, 7 };
  scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "3 weight(s) for 2"));
  EXPECT_EQ(scene->Nodes[0].Weights, (std::vector<float>{ 1, 0.5f }));
}

TEST(Deform, TargetsThatAreNotFinite)
{
  Gltf g;
  g.Doc["meshes"][0]["name"] = "torn";
  g.Primitive()["targets"] = { { { "POSITION", g.Floats({ 0, 0, NAN, 0, INFINITY, 4, 0, 0, 6 }, "VEC3", 3) } } };
  g.Doc["meshes"][0]["weights"] = { 1 };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "\"torn\": 2 value(s) of morph targets are not finite and became 0"));
  ExpectAt(At(*scene, 0).P[1], Vec3d(1, 0, 4), 1e-6, "position", 1);
}

TEST(Deform, DroppedVerticesTakeTheirJointsAndTargetsAlong)
{
  Gltf g;
  g.Primitive()["attributes"]["POSITION"] = g.Floats({ NAN, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0 }, "VEC3", 3);
  g.Primitive()["indices"] = g.Indices({ 1, 2, 3, 0, 1, 2 });
  g.Primitive()["targets"] = { { { "POSITION", g.Floats({ 0, 0, 9, 0, 0, 1, 0, 0, 2, 0, 0, 3 }, "VEC3", 3) } } };
  g.Doc["meshes"][0]["weights"] = { 1 };
  g.Primitive()["attributes"]["JOINTS_0"] =
    g.Accessor<std::uint8_t>({ 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0 }, 5121, "VEC4", 4);
  g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats({ 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0 }, "VEC4", 4);
  g.Doc["skins"] = { { { "joints", { 1, 2 } } } };
  g.Doc["nodes"] = { { { "mesh", 0 }, { "skin", 0 } }, Json::object(), { { "translation", { 0, 0, 100 } } } };
  const auto scene = LoadOnce(g.WriteGltf());
  const Deformed d = At(*scene, 0);
  ASSERT_EQ(d.P.size(), 3u);
  ExpectAt(d.P[0], Vec3d(0, 0, 101), 1e-5, "position", 0);
  ExpectAt(d.P[1], Vec3d(1, 0, 2), 1e-5, "position", 1);
  ExpectAt(d.P[2], Vec3d(0, 1, 103), 1e-5, "position", 2);
}

TEST(Deform, OverflowStaysInRangeAndNormalsStayUnit)
{
  Gltf g;
  g.Primitive()["attributes"]["NORMAL"] = g.Floats({ 0, 0, 1, 0, 0, 1, 0, 0, 1 }, "VEC3", 3);
  g.Primitive()["targets"] = { { { "POSITION", g.Floats({ 3e38f, 0, 0, 0, -3e38f, 0, 0, 0, 0 }, "VEC3", 3) },
    { "NORMAL", g.Floats({ 0, 0, -1, 0, 0, 0, 0, 0, 0 }, "VEC3", 3) } } };
  AnimateWeights(g, "LINEAR", { 0, 1 }, { 1, 3e38f });
  g.Doc["nodes"][0]["scale"] = { 1e30, 1e30, 1e30 };
  const auto scene = LoadOnce(g.WriteGltf());
  for (const double time : { 0., 0.5, 1. })
  {
    const Deformed d = At(*scene, time);
    EXPECT_EQ(d.P[0].x, std::numeric_limits<float>::max());
    EXPECT_EQ(d.P[1].y, -std::numeric_limits<float>::max());
    for (const Vec3f& n : d.N)
      EXPECT_NEAR(Length(n), 1, 1e-6);
  }
}

TEST(Deform, ChannelsThatHoldStillMoveNothing)
{
  Gltf g;
  g.Animate("translation", "LINEAR", { 0, 1, 2 }, { 1, 2, 3, 1, 2, 3, 1, 2, 3 }, 3);
  const auto still = LoadOnce(g.WriteGltf());
  EXPECT_FALSE(still->Animation.at(0).Changes());
  EXPECT_FALSE(still->Moves(still->Instances[0]));
  EXPECT_DOUBLE_EQ(still->WorldMatrices(1)[0].m[1][3], 2) << "but it places the node";

  Gltf spline; // the same value at both keys, but the path swings out between them
  spline.Animate("translation", "CUBICSPLINE", { 0, 1 }, { 0, 0, 0, 1, 1, 1, 0, 4, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0 }, 3);
  const auto swings = LoadOnce(spline.WriteGltf());
  EXPECT_TRUE(swings->Moves(swings->Instances[0]));

  Gltf once;
  once.Animate("scale", "LINEAR", { 0.5 }, { 2, 2, 2 }, 3);
  const auto one = LoadOnce(once.WriteGltf());
  EXPECT_FALSE(one->Moves(one->Instances[0]));

  // An ancestor moves a rigid mesh, but a skinned one only through its joints.
  Gltf bar = Bar(false);
  bar.Doc["nodes"].push_back({ { "children", { 0 } } });
  bar.Doc["scenes"][0]["nodes"] = { 1, 3 };
  bar.Doc["animations"][0]["channels"][0]["target"]["node"] = 3;
  const auto above = LoadOnce(bar.WriteGltf());
  EXPECT_FALSE(above->Moves(above->Instances[0]));
  bar.Doc["nodes"][0].erase("skin");
  const auto rigid = LoadOnce(bar.WriteGltf());
  EXPECT_TRUE(rigid->Moves(rigid->Instances[0]));
}

TEST(Deform, WeightsOfNodesWithoutTargetsAreIgnored)
{
  Gltf g;
  AnimateWeights(g, "LINEAR", { 0, 1 }, { 0, 1 });
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "morph weights of a node without morph targets"));
  EXPECT_FALSE(scene->Animated());
}

TEST(Deform, InstancingGivesNodesOfTheirOwn)
{
  Gltf g = Morph();
  AnimateWeights(g, "LINEAR", { 0, 1 }, { 0, 0, 0, 1 });
  g.Doc["extensionsUsed"] = { "EXT_mesh_gpu_instancing" };
  g.Doc["extensionsRequired"] = { "EXT_mesh_gpu_instancing" };
  const int t = g.Floats({ 0, 0, 0, 5, 0, 0, 0, 6, 0 }, "VEC3", 3),
            r = g.Accessor<std::int16_t>({ 0, 0, 0, 32767, 0, 0, 23170, 23170, 0, 0, 0, 32767 }, 5122, "VEC4", 4),
            s = g.Floats({ 1, 1, 1, 1, 1, 1, 2, 3, 4 }, "VEC3", 3);
  g.Doc["accessors"][std::size_t(r)]["normalized"] = true;
  g.Doc["nodes"] = {
    { { "mesh", 0 }, { "translation", { 0, 0, 10 } },
      { "extensions", { { "EXT_mesh_gpu_instancing",
                        { { "attributes", { { "TRANSLATION", t }, { "ROTATION", r }, { "SCALE", s } } } } } } } },
    { { "mesh", 0 } }
  };
  g.Doc["scenes"][0]["nodes"] = { 0, 1 };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(scene->Warnings.empty());
  ASSERT_EQ(scene->Instances.size(), 4u);
  ASSERT_EQ(scene->Nodes.size(), 5u);
  for (int i = 0; i < 4; ++i)
  {
    EXPECT_EQ(scene->Instances[std::size_t(i)].Id, i + 1);
    EXPECT_EQ(scene->Instances[std::size_t(i)].Node, i < 3 ? 2 + i : 1);
  }
  ExpectAt(At(*scene, 0, Vec3d(), 1).P[1], Vec3d(5, 1, 10), 1e-4, "turned by 90 degrees", 1);
  ExpectAt(At(*scene, 0, Vec3d(), 2).P[2], Vec3d(0, 9, 10), 1e-6, "scaled", 2);
  ExpectAt(At(*scene, 1, Vec3d(), 0).P[2], Vec3d(-1, 1, 10), 1e-6, "morphed with its node", 2);
  ExpectAt(At(*scene, 1, Vec3d(), 3).P[2], Vec3d(0, 1, 0), 1e-6, "not animated", 2);

  g.Doc["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = g.Floats({ 1, 1, 1 }, "VEC3", 3);
  g.Doc.erase("buffers");
  const std::string file = g.WriteGltf();
  ExpectError(ErrorOf(file), file, "nodes[0].extensions.EXT_mesh_gpu_instancing.attributes.SCALE",
    "has 1 elements, others have 3", "export");
}

namespace
{
struct BadDeform
{
  const char* Name;
  std::function<void(Gltf&)> Break;
  const char* Place;
  const char* What;
};
std::ostream& operator<<(std::ostream& out, const BadDeform& c)
{
  return out << c.Name;
}

/// Bar with a morph target and animated weights.
Gltf Everything()
{
  Gltf g = Bar(false);
  g.Primitive()["targets"] = { { { "POSITION", g.Floats(std::vector<float>(18, 1.f), "VEC3", 3) } } };
  g.Doc["nodes"][0]["weights"] = { 0.5 };
  AnimateWeights(g, "LINEAR", { 0, 1 }, { 0, 1 });
  return g;
}
}

class DeformErrors : public testing::TestWithParam<BadDeform>
{
};
TEST_P(DeformErrors, AreRefusedWithPlaceAndCause)
{
  Gltf good = Everything();
  EXPECT_EQ(ErrorOf(good.WriteGltf()), "");
  Gltf g = Everything();
  GetParam().Break(g);
  const std::string file = g.WriteGltf();
  ExpectError(ErrorOf(file), file, GetParam().Place, GetParam().What, "");
}
INSTANTIATE_TEST_SUITE_P(All, DeformErrors,
  testing::Values(BadDeform{ "SecondSetOfJoints",
                    [](Gltf& g)
                    {
                      std::vector<std::uint8_t> joints(24, 0);
                      joints[9] = 2;
                      g.Primitive()["attributes"]["JOINTS_1"] = g.Accessor(joints, 5121, "VEC4", 4);
                      g.Primitive()["attributes"]["WEIGHTS_1"] = g.Floats(std::vector<float>(24, 0.1f), "VEC4", 4);
                    },
                    "meshes[0].primitives[0].attributes.JOINTS_1", "joint 2 does not exist (the skin has 2)" },
    BadDeform{ "JointOfTheSmallerSkin",
      [](Gltf& g)
      {
        g.Doc["skins"].push_back({ { "joints", { 1 } } });
        g.Doc["nodes"].push_back({ { "mesh", 0 }, { "skin", 1 } });
        g.Doc["scenes"][0]["nodes"] = { 0, 1, 3 };
      },
      "meshes[0].primitives[0].attributes.JOINTS_0", "joint 1 does not exist (the skin has 1)" },
    BadDeform{ "JointsCount",
      [](Gltf& g) {
        g.Primitive()["attributes"]["JOINTS_0"] = g.Accessor<std::uint8_t>({ 0, 0, 0, 0 }, 5121, "VEC4", 4);
      },
      "meshes[0].primitives[0].attributes.JOINTS_0", "has 1 elements, POSITION has 6" },
    BadDeform{ "WeightsCount",
      [](Gltf& g) {
        g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats({ 1, 0, 0, 0, 1, 0, 0, 0 }, "VEC4", 4);
      },
      "meshes[0].primitives[0].attributes.WEIGHTS_0", "has 2 elements, POSITION has 6" },
    BadDeform{ "FloatJoints",
      [](Gltf& g) { g.Primitive()["attributes"]["JOINTS_0"] = g.Floats(std::vector<float>(24, 0.f), "VEC4", 4); },
      "accessors[13].componentType", "unsigned integers" },
    BadDeform{ "SkinIndex", [](Gltf& g) { g.Doc["nodes"][0]["skin"] = 1; }, "nodes[0].skin", "skin 1 does not exist" },
    BadDeform{ "JointNode",
      [](Gltf& g) {
        g.Doc["skins"][0]["joints"] = { 1, 9 };
      },
      "skins[0].joints[1]", "node 9 does not exist" },
    BadDeform{ "SkeletonNode", [](Gltf& g) { g.Doc["skins"][0]["skeleton"] = 3; }, "skins[0].skeleton",
      "node 3 does not exist" },
    BadDeform{ "NoJoints", [](Gltf& g) { g.Doc["skins"][0]["joints"] = Json::array(); }, "skins[0].joints",
      "1 to 65536 joints, found 0" },
    BadDeform{ "FewMatrices",
      [](Gltf& g) {
        g.Doc["skins"][0]["joints"] = { 1, 2, 1 };
      },
      "skins[0].inverseBindMatrices", "2 matrices for 3 joints" },
    BadDeform{ "MatrixNotFinite",
      [](Gltf& g)
      {
        std::vector<float> m(32, 0.f);
        m[20] = NAN;
        g.Doc["skins"][0]["inverseBindMatrices"] = g.Floats(m, "MAT4", 16);
      },
      "skins[0].inverseBindMatrices", "the matrix of joint 1 is not finite" },
    BadDeform{ "TargetCount",
      [](Gltf& g) {
        g.Primitive()["targets"][0]["POSITION"] = g.Floats({ 1, 2, 3 }, "VEC3", 3);
      },
      "meshes[0].primitives[0].targets[0].POSITION", "the morph target has 1 elements, POSITION has 6" },
    BadDeform{ "TargetType",
      [](Gltf& g) { g.Primitive()["targets"][0]["POSITION"] = g.Floats(std::vector<float>(24, 0.f), "VEC4", 4); },
      "accessors[13].type", "\"VEC4\" where VEC3 is expected" },
    BadDeform{ "TargetsPerPrimitive",
      [](Gltf& g)
      {
        Json second = g.Primitive();
        second["targets"].push_back(second["targets"][0]);
        g.Doc["meshes"][0]["primitives"].push_back(second);
      },
      "meshes[0].primitives[1]", "2 morph target(s), the first one of the mesh has 1" },
    BadDeform{ "WeightIsNoNumber", [](Gltf& g) { g.Doc["nodes"][0]["weights"] = { nullptr }; }, "nodes[0].weights[0]",
      "expected a number, found null" },
    BadDeform{ "AnimatedWeightsCount",
      [](Gltf& g) {
        AnimateWeights(g, "LINEAR", { 0, 1 }, { 0, 1, 2 });
      },
      "animations[2].samplers[0].output", "3 values for 2 times and 1 morph target(s) where 2 are expected" },
    BadDeform{ "AnimatedWeightsSplineCount",
      [](Gltf& g) {
        AnimateWeights(g, "CUBICSPLINE", { 0, 1 }, { 0, 1 });
      },
      "animations[2].samplers[0].output", "where 6 are expected" },
    BadDeform{ "AnimatedWeightsNotFinite",
      [](Gltf& g) {
        AnimateWeights(g, "LINEAR", { 0, 1 }, { 0, NAN });
      },
      "animations[2].samplers[0].output", "value 1 is not finite" }),
  [](const testing::TestParamInfo<BadDeform>& tested) { return std::string(tested.param.Name); });

/// A scene made by hand, with references that lead nowhere, must not crash.
TEST(Deform, HandMadeScenesMayBeIncomplete)
{
  Scene scene;
  Instance nowhere{ 3, 5, 1 };
  EXPECT_FALSE(scene.Deforms(nowhere) || scene.Moves(nowhere));
  std::vector<Vec3f> p(7), n(7);
  std::vector<Vec4f> t(7);
  scene.Deform(nowhere, scene.PoseAt(0), Vec3d(), p, &n, &t);
  EXPECT_EQ(p.size() + n.size() + t.size(), 0u);
  Vec3d low, high;
  EXPECT_FALSE(scene.Bounds(scene.PoseAt(0), low, high));

  Mesh mesh;
  mesh.Positions = { { 1, 2, 3 }, { 4, 5, 6 } };
  mesh.Influences = 4;
  mesh.Joints = { 9, 0, 0, 0, 9, 0, 0, 0 };
  mesh.JointWeights = { 1, 0, 0, 0, 1, 0, 0, 0 };
  mesh.Targets.resize(1);
  mesh.Targets[0].Positions = { { 1, 1, 1 } };
  scene.Meshes.push_back(mesh);
  scene.Skins.resize(1);
  scene.Skins[0].Joints = { 77 };
  scene.Nodes.resize(1);
  scene.Nodes[0].Skin = 0;
  AnimationChannel broken;
  broken.Node = 0;
  broken.Path = AnimatedPath::Rotation;
  broken.Times = { 0, 1 };
  broken.Values = { 1, 2, 3 };
  scene.Animation.push_back(broken);
  const Instance instance{ 0, 0, 1 };
  scene.Deform(instance, scene.PoseAt(0.5), Vec3d(), p, nullptr, nullptr);
  ASSERT_EQ(p.size(), 2u);
  ExpectAt(p[1], Vec3d(4, 5, 6), 0, "left where it is", 1);
}
