// SPDX-License-Identifier: BSD-3-Clause
// Real scenes by others (skipped where they are not there) and the scenes that the project ships.
#include "SceneTestFiles.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

using namespace quell;
using namespace scenetest;
namespace fs = std::filesystem;

namespace
{
std::vector<std::string> ScenesBelow(const std::string& folder)
{
  std::vector<std::string> files;
  if (fs::is_directory(folder))
    for (const auto& entry : fs::recursive_directory_iterator(folder))
    {
      const std::string e = entry.path().extension().string();
      if (e == ".gltf" || e == ".glb" || e == ".obj")
        files.push_back(entry.path().string());
    }
  std::sort(files.begin(), files.end());
  return files;
}

std::size_t Triangles(const Scene& scene)
{
  std::size_t n = 0;
  for (const Instance& i : scene.Instances)
    n += scene.Meshes[std::size_t(i.Mesh)].Indices.size() / 3;
  return n;
}

std::string Shared(const char* path)
{
  return std::string(QUELL_SHARED_DATA) + "/" + path;
}
}

class SharedScenes : public testing::TestWithParam<const char*>
{
};
TEST_P(SharedScenes, Load)
{
  const std::vector<std::string> files = ScenesBelow(Shared(GetParam()));
  if (files.empty())
    GTEST_SKIP() << "no " << Shared(GetParam());
  for (const std::string& file : files)
  {
    SCOPED_TRACE(file);
    std::shared_ptr<const Scene> scene;
    ASSERT_NO_THROW(scene = LoadScene(file));
    EXPECT_GT(Triangles(*scene), 0u);
    for (const std::string& w : scene->Warnings)
      EXPECT_EQ(w.find("image"), std::string::npos) << w;
    const ScenePose pose = scene->PoseAt(0.5 * scene->Duration());
    std::vector<Vec3f> positions, normals;
    for (const Instance& i : scene->Instances)
    {
      EXPECT_TRUE(IsFinite(pose.World[std::size_t(i.Node)].Point({ 0, 0, 0 })));
      if (!scene->Deforms(i))
        continue;
      scene->Deform(i, pose, Vec3d(), positions, &normals, nullptr);
      for (const Vec3f& p : positions)
        ASSERT_LT(Length(p), 1e4f);
      for (const Vec3f& n : normals)
        ASSERT_NEAR(Length(n), 1, 1e-5);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(All, SharedScenes,
  testing::Values("khronos-core", "khronos-scenes", "interior-living-room", "cornell-mcguire", "obj",
    "cornell-reference", "radiometric-refs"),
  [](const testing::TestParamInfo<const char*>& tested)
  {
    std::string name = tested.param;
    std::replace(name.begin(), name.end(), '-', '_');
    return name;
  });

TEST(SharedScene, BrokenFilesAreRefusedOrWarnedOf)
{
  std::ifstream table(Shared("gltf-bad/EXPECTED.tsv"));
  if (!table)
    GTEST_SKIP() << "no " << Shared("gltf-bad");
  // What must not load at all, and a word of the reason.
  const std::map<std::string, std::string> refused = { { "Cube.gltf", "lie outside buffer" },
    { "assimp-MissingBin", "BoxTextured0.bin" }, { "sceneWrongType.gltf", "scene: expected a whole number" },
    { "badExtension.gltf", "KHR_texture_transform: expected an object" },
    { "badObject.gltf", "pbrMetallicRoughness: expected an object" }, { "badUint.gltf", "found -1" },
    { "ABeautifulGame.gltf", "ABeautifulGame.bin" }, { "required-draco-Box", "KHR_draco_mesh_compression" },
    { "japanese-bridge", "EXT_meshopt_compression" }, { "integer-out-of-bounds", "simpleTriangle.bin" },
    { "invalid-buffer-view-index", "bufferView" }, { "issue-416", "asset.version" } };
  std::string line;
  int files = 0;
  while (std::getline(table, line))
  {
    if (line.empty() || line[0] == '#')
      continue;
    ++files;
    const std::string name = line.substr(0, line.find('\t'));
    SCOPED_TRACE(name);
    const auto expected = std::find_if(
      refused.begin(), refused.end(), [&](const auto& r) { return name.find(r.first) != std::string::npos; });
    try
    {
      const auto scene = LoadScene(Shared(name.c_str()));
      EXPECT_TRUE(expected == refused.end());
      if (name.find("texcoord_crash") != std::string::npos) // unusual, but valid
      {
        EXPECT_EQ(Triangles(*scene), 10u);
      }
      else if (name.find("unassigned-skeleton") != std::string::npos) // valid: "skeleton" may be missing
      {
        ASSERT_EQ(scene->Skins.size(), 1u);
        EXPECT_EQ(scene->Skins[0].Skeleton, -1);
        EXPECT_TRUE(scene->Deforms(scene->Instances[0]));
      }
      else
      {
        EXPECT_FALSE(scene->Warnings.empty());
      }
    }
    catch (const SceneError& e)
    {
      ASSERT_TRUE(expected != refused.end()) << e.what();
      EXPECT_NE(std::string(e.what()).find(expected->second), std::string::npos) << e.what();
    }
  }
  EXPECT_EQ(files, 17);
}

TEST(SharedScene, LivingRoomHasItsCameraGlassAndTurnedSky)
{
  const std::string file = Shared("interior-living-room/living-room.gltf");
  if (!fs::exists(file))
    GTEST_SKIP() << "no " << file;
  const auto scene = LoadScene(file);
  EXPECT_EQ(Triangles(*scene), 142973u) << "143163 in the file, 190 of them without area";
  EXPECT_EQ(scene->Cameras.size(), 1u);
  EXPECT_EQ(scene->Resolution[0], 1280);
  EXPECT_EQ(scene->Resolution[1], 720);
  EXPECT_TRUE(std::any_of(
    scene->Materials.begin(), scene->Materials.end(), [](const Material& m) { return m.Transmission > 0; }));
  ASSERT_TRUE(scene->Sky.Present);
  ASSERT_GE(scene->Sky.Texture, 0);
  // toWorld takes local -z to world -x, so that the picture's left edge (local -z) is where world -x is: u = 1/4.
  Scene plain;
  LoadEnvironment(plain, Shared("hdri/spiaggia_di_mondello_1k.hdr"));
  const Texture &turned = scene->Textures[std::size_t(scene->Sky.Texture)], &image = plain.Textures[0];
  for (const float u : { 0.1f, 0.35f, 0.6f, 0.85f })
    for (const float v : { 0.2f, 0.45f, 0.7f })
    {
      const float x = (std::floor(u * float(image.Width)) + 0.5f) / float(image.Width),
                  y = (std::floor(v * float(image.Height)) + 0.5f) / float(image.Height);
      const Vec4f a = image.Sample(x, y), b = turned.Sample(x + 0.25f, y);
      EXPECT_NEAR(a.x, b.x, 2e-3f * (1 + a.x));
      EXPECT_NEAR(a.z, b.z, 2e-3f * (1 + a.z));
    }
}

namespace
{
std::shared_ptr<const Scene> Khronos(const std::string& name)
{
  const std::string file = Shared(("khronos-core/" + name + "/glTF/" + name + ".gltf").c_str());
  return fs::exists(file) ? LoadScene(file) : nullptr;
}
void ExpectBox(const Scene& scene, double time, const Vec3d& low, const Vec3d& high, double tolerance)
{
  Vec3d a, b;
  ASSERT_TRUE(scene.Bounds(scene.PoseAt(time), a, b));
  for (int c = 0; c < 3; ++c)
  {
    EXPECT_NEAR(a[c], low[c], tolerance) << time << " low " << c;
    EXPECT_NEAR(b[c], high[c], tolerance) << time << " high " << c;
  }
}
}

/// The sample is described number by number in its tutorial: a strip of 1 x 2, whose second joint (at y = 1) is turned
/// about z by 90 degrees at 1 s; the weights rise by a quarter per row of 0.5 (two rows at either end are whole).
TEST(SharedScene, SimpleSkinBends)
{
  const auto scene = Khronos("SimpleSkin");
  if (!scene)
    GTEST_SKIP() << "no khronos-core";
  EXPECT_TRUE(scene->Warnings.empty());
  ASSERT_EQ(scene->Instances.size(), 1u);
  EXPECT_TRUE(scene->Deforms(scene->Instances[0]) && scene->Moves(scene->Instances[0]));
  ExpectBox(*scene, 0, { -0.5, 0, 0 }, { 0.5, 2, 0 }, 1e-6);
  const Mesh& mesh = scene->Meshes[0];
  const ScenePose pose = scene->PoseAt(1);
  const Mat4& turned = pose.World[std::size_t(scene->Skins[0].Joints[1])];
  EXPECT_NEAR(std::fabs(turned.m[1][0]), 1, 1e-3);
  std::vector<Vec3f> p;
  scene->Deform(scene->Instances[0], pose, Vec3d(), p, nullptr, nullptr);
  const double s = turned.m[1][0];
  for (std::size_t i = 0; i < p.size(); ++i)
  {
    const Vec3f& rest = mesh.Positions[i];
    const double w = double(mesh.JointWeights[4 * i + 1]);
    const double bent[2] = { -s * (rest.y - 1), s * rest.x + 1 }; // about (0, 1)
    EXPECT_NEAR(p[i].x, (1 - w) * rest.x + w * bent[0], 2e-3) << i;
    EXPECT_NEAR(p[i].y, (1 - w) * rest.y + w * bent[1], 2e-3) << i;
  }
}

TEST(SharedScene, RiggedFoxAndMorphsMove)
{
  const auto rigged = Khronos("RiggedSimple"), fox = Khronos("Fox"), cube = Khronos("AnimatedMorphCube"),
             simple = Khronos("SimpleMorph");
  if (!rigged || !fox || !cube || !simple)
    GTEST_SKIP() << "no khronos-core";
  for (const auto& scene : { rigged, fox, cube, simple })
  {
    EXPECT_TRUE(scene->Deforms(scene->Instances[0])) << scene->File;
    EXPECT_TRUE(scene->Moves(scene->Instances[0])) << scene->File;
  }
  // At its first key the rigged cylinder stands as it was modelled: 9.15 high, 2 wide.
  ExpectBox(*rigged, 0, { -1, -4.575, -1 }, { 1, 4.575, 1 }, 1e-3);
  Vec3d low, high;
  ASSERT_TRUE(rigged->Bounds(rigged->PoseAt(rigged->Duration() / 2), low, high));
  EXPECT_GT(high.x, 2) << "bent";
  EXPECT_EQ(fox->Skins.at(0).Joints.size(), 24u);
  ASSERT_TRUE(fox->Bounds(fox->PoseAt(1), low, high));
  EXPECT_GT(high.y - low.y, 60);
  EXPECT_LT(high.y - low.y, 100);
  // The one triangle: its apex goes from (0.5, 0.5) by (0, 2) at weight 1, which the middle of the animation has.
  ExpectBox(*simple, 2, { 0, 0, 0 }, { 1, 2.5, 0 }, 1e-6);
  ExpectBox(*cube, 0, Vec3d(-1), Vec3d(1), 1e-5);
  ASSERT_TRUE(cube->Bounds(cube->PoseAt(cube->Duration() / 2), low, high));
  EXPECT_LT(high.z - low.z, 1) << "pressed flat";
}

/// One of the two halves of the plane is morphed at rest, the mesh's weights being the same for both.
TEST(SharedScene, MorphPrimitivesShareTheirWeights)
{
  const auto scene = Khronos("MorphPrimitivesTest");
  if (!scene)
    GTEST_SKIP() << "no khronos-core";
  ASSERT_EQ(scene->Instances.size(), 2u);
  for (const Instance& i : scene->Instances)
  {
    EXPECT_TRUE(scene->Deforms(i));
    EXPECT_FALSE(scene->Moves(i));
  }
  Vec3d low, high;
  ASSERT_TRUE(scene->Bounds(scene->PoseAt(0), low, high));
  EXPECT_GT(high.y, 0.05) << "raised in the middle";
}

TEST(SharedScene, CornellBoxesKeepKeNiAndTf)
{
  if (!fs::exists(Shared("cornell-mcguire")))
    GTEST_SKIP() << "no " << Shared("cornell-mcguire");
  const std::pair<const char*, Vec3f> lamps[] = { { "Original", { 17, 12, 4 } }, { "Empty-RG", { 17, 12, 4 } },
    { "Empty-CO", { 10, 10, 10 } }, { "Sphere", { 10, 10, 10 } } };
  for (const auto& lamp : lamps)
  {
    const auto scene = LoadScene(Shared((std::string("cornell-mcguire/CornellBox-") + lamp.first + ".obj").c_str()));
    int lit = 0;
    for (const Instance& i : scene->Instances)
    {
      const Material& m = scene->Materials[std::size_t(scene->Meshes[std::size_t(i.Mesh)].Material)];
      if (!(MaxComponent(m.Emission) > 0))
        continue;
      ++lit;
      EXPECT_EQ(m.Emission, lamp.second) << lamp.first;
      EXPECT_EQ(m.Name, "light");
    }
    EXPECT_EQ(lit, 1) << lamp.first;
  }
  const auto glossy = LoadScene(Shared("cornell-mcguire/CornellBox-Glossy.obj"));
  EXPECT_FALSE(glossy->HasLight()) << "its library has no material of that name";
  EXPECT_NE(
    std::find_if(glossy->Warnings.begin(), glossy->Warnings.end(),
      [](const std::string& w) { return w.find("usemtl light: the material is not defined") != std::string::npos; }),
    glossy->Warnings.end());
  const auto spheres = LoadScene(Shared("cornell-mcguire/CornellBox-Sphere.obj"));
  for (const Material& m : spheres->Materials)
    if (m.Name == "rightSphere")
    {
      EXPECT_FLOAT_EQ(m.Ior, 2.5f);
      EXPECT_NEAR(m.BaseColor.x, std::sqrt(0.1), 1e-6);
      EXPECT_TRUE(m.Volume);
    }
}

TEST(SharedScene, SphereBoxMaterials)
{
  const std::string file = Shared("cornell-mcguire/CornellBox-Sphere.obj");
  if (!fs::exists(file))
    GTEST_SKIP() << "no " << file;
  const auto scene = LoadScene(file);
  std::map<std::string, Material> by;
  for (const Material& m : scene->Materials)
    by[m.Name] = m;
  EXPECT_EQ(by["leftSphere"].Metallic, 1);
  EXPECT_EQ(by["rightSphere"].Transmission, 1);
  EXPECT_EQ(by["light"].Emission, Vec3f(10, 10, 10));
  EXPECT_EQ(by["rightWall"].Specular, 0);
}

TEST(ShippedScenes, LoadWithoutWarnings)
{
  const std::vector<std::string> files = ScenesBelow(std::string(QUELL_SOURCE_DIR) + "/Data/Scenes");
  EXPECT_GE(files.size(), 3u);
  for (const std::string& file : files)
  {
    const auto scene = LoadScene(file);
    EXPECT_TRUE(scene->Warnings.empty()) << scene->Warnings[0];
    EXPECT_EQ(scene->Cameras.size(), 1u) << file;
    EXPECT_GT(scene->Resolution[0], 0) << file;
    EXPECT_LE(fs::file_size(file), 200u * 1024) << file;
  }
}

TEST(ShippedScenes, CornellBoxIsTheMeasuredOne)
{
  const auto scene = LoadScene(std::string(QUELL_SOURCE_DIR) + "/Data/Scenes/cornell-box.gltf");
  EXPECT_EQ(Triangles(*scene), 38u);
  const std::vector<Mat4> world = scene->WorldMatrices(0);
  const CameraModel& camera = scene->Cameras[0];
  EXPECT_NEAR(camera.YFov * 180 / 3.14159265358979, 39.3077, 1e-4);
  const Mat4& pose = world[std::size_t(camera.Node)];
  EXPECT_NEAR(Length(pose.Point({ 0, 0, 0 }) - Vec3d(0.278, 0.273, -0.8)), 0, 1e-9);
  EXPECT_NEAR(Length(pose.Direction({ 0, 0, -1 }) - Vec3d(0, 0, 1)), 0, 1e-9);
  EXPECT_NEAR(Length(pose.Direction({ 1, 0, 0 }) - Vec3d(-1, 0, 0)), 0, 1e-9) << "+x is on the left";
  const Vec3d middle{ 0.278, 0.2744, 0.2796 };
  for (const Instance& i : scene->Instances)
  {
    const Mesh& m = scene->Meshes[std::size_t(i.Mesh)];
    const std::string& name = scene->Nodes[std::size_t(i.Node)].Name;
    const bool block = name.find("block") != std::string::npos;
    const Material& material = scene->Materials[std::size_t(m.Material)];
    EXPECT_EQ(material.Specular, 0);
    EXPECT_EQ(MaxComponent(material.Emission) > 0, name == "light");
    Vec3d centre = middle;
    if (block)
    {
      centre = {};
      for (const Vec3f& p : m.Positions)
        centre += world[std::size_t(i.Node)].Point(Vec3d(p)) / double(m.Positions.size());
    }
    for (std::size_t t = 0; t < m.Indices.size(); t += 3)
    {
      Vec3d p[3];
      for (std::size_t k = 0; k < 3; ++k)
        p[k] = world[std::size_t(i.Node)].Point(Vec3d(m.Positions[m.Indices[t + k]]));
      const Vec3d n = Cross(p[1] - p[0], p[2] - p[0]);
      EXPECT_GT(Dot(n, centre - p[0]) * (block ? -1 : 1), 0) << name << ": walls face the room, blocks face it too";
      EXPECT_GT(Dot(Normalized(n), Vec3d(m.Normals[m.Indices[t]])), 0.9999);
    }
    if (name == "left wall")
    {
      EXPECT_GT(material.BaseColor.x, 5 * material.BaseColor.y);
    }
  }
}

TEST(ShippedScenes, MovingBoxStartsAtTheStillOneAndMoves)
{
  const std::string folder = std::string(QUELL_SOURCE_DIR) + "/Data/Scenes/";
  const auto still = LoadScene(folder + "cornell-box.gltf"), moving = LoadScene(folder + "cornell-box-moving.gltf");
  ASSERT_EQ(still->Nodes.size(), moving->Nodes.size());
  EXPECT_DOUBLE_EQ(moving->Duration(), 2);
  const std::vector<Mat4> a = still->WorldMatrices(0), b = moving->WorldMatrices(0),
                          c = moving->WorldMatrices(31 / 24.);
  int moved = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
  {
    double start = 0, later = 0;
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k < 4; ++k)
      {
        start = std::max(start, std::fabs(a[i].m[r][k] - b[i].m[r][k]));
        later = std::max(later, std::fabs(a[i].m[r][k] - c[i].m[r][k]));
      }
    // The still camera looks straight ahead from (278, 273), the moving one at (278, 273, 280): the same direction.
    EXPECT_LT(start, 1e-6) << moving->Nodes[i].Name;
    moved += later > 0.02;
  }
  EXPECT_EQ(moved, 2) << "the short block and the camera";
}
