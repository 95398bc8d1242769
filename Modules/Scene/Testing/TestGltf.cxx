// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTestFiles.h"

#include <cmath>
#include <functional>
#include <ostream>
#include <random>
#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/lsan_interface.h>
#endif

using namespace quell;
using namespace scenetest;

namespace
{
/// Every pixel of a triangle list, for comparison.
std::vector<std::uint32_t> IndicesOf(Gltf& g)
{
  const auto scene = LoadOnce(g.WriteGltf());
  return scene->Meshes.empty() ? std::vector<std::uint32_t>() : scene->Meshes[0].Indices;
}

Gltf Pentagon()
{
  Gltf g;
  g.Primitive()["attributes"]["POSITION"] = g.Floats({ 0, 0, 0, 1, 0, 0, 2, 1, 0, 1, 2, 0, 0, 1, 0 }, "VEC3", 3);
  return g;
}
}

TEST(Gltf, TriangleStripAndFanKeepTheWindingOfTheSpecification)
{
  Gltf g = Pentagon();
  g.Primitive()["mode"] = 5;
  EXPECT_EQ(IndicesOf(g), (std::vector<std::uint32_t>{ 0, 1, 2, 1, 3, 2, 2, 3, 4 }));
  g.Primitive()["mode"] = 6;
  EXPECT_EQ(IndicesOf(g), (std::vector<std::uint32_t>{ 1, 2, 0, 2, 3, 0, 3, 4, 0 }));
  Gltf h = Pentagon();
  h.Primitive()["indices"] = h.Indices({ 4, 3, 2, 1 });
  h.Primitive()["mode"] = 5;
  EXPECT_EQ(IndicesOf(h), (std::vector<std::uint32_t>{ 4, 3, 2, 3, 1, 2 }));
}

TEST(Gltf, PointsAndLinesAreSkippedWithAWarning)
{
  for (const int mode : { 0, 1, 2, 3 })
  {
    Gltf g;
    g.Primitive()["mode"] = mode;
    const auto scene = LoadOnce(g.WriteGltf());
    EXPECT_TRUE(scene->Instances.empty());
    EXPECT_TRUE(HasWarning(*scene, mode == 0 ? "points are not rendered" : "lines are not rendered"));
    EXPECT_TRUE(HasWarning(*scene, "no triangles"));
  }
}

TEST(Gltf, SparseAccessorReplacesValues)
{
  Gltf g;
  const std::vector<std::uint16_t> where{ 2 };
  const std::vector<float> what{ 7, 8, 9 };
  const int indices = g.View(where.data(), 2), values = g.View(what.data(), 12);
  g.Doc["accessors"][0]["sparse"] = { { "count", 1 },
    { "indices", { { "bufferView", indices }, { "componentType", 5123 } } },
    { "values", { { "bufferView", values } } } };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Meshes[0].Positions[1], Vec3f(1, 0, 0));
  EXPECT_EQ(scene->Meshes[0].Positions[2], Vec3f(7, 8, 9));

  Gltf empty; // zeros below
  const std::vector<std::uint16_t> two{ 0, 2 };
  const std::vector<float> corners{ 7, 8, 9, 1, 0, 0 };
  const int from = empty.View(two.data(), 4), to = empty.View(corners.data(), 24);
  empty.Doc["accessors"][0].erase("bufferView");
  empty.Doc["accessors"][0]["sparse"] = { { "count", 2 },
    { "indices", { { "bufferView", from }, { "componentType", 5123 } } }, { "values", { { "bufferView", to } } } };
  const auto zeros = LoadOnce(empty.WriteGltf());
  EXPECT_EQ(zeros->Meshes[0].Positions[0], Vec3f(7, 8, 9));
  EXPECT_EQ(zeros->Meshes[0].Positions[1], Vec3f(0, 0, 0));
  EXPECT_EQ(zeros->Meshes[0].Positions[2], Vec3f(1, 0, 0));

  Gltf bad;
  const std::vector<std::uint16_t> beyond{ 3 };
  const int i = bad.View(beyond.data(), 2), v = bad.View(what.data(), 12);
  bad.Doc["accessors"][0]["sparse"] = { { "count", 1 },
    { "indices", { { "bufferView", i }, { "componentType", 5123 } } }, { "values", { { "bufferView", v } } } };
  const std::string file = bad.WriteGltf();
  ExpectError(ErrorOf(file), file, "accessors[0].sparse.indices", "sparse index 3 lies outside", "export");
}

TEST(Gltf, StridesAndNormalizedIntegers)
{
  Gltf g;
  // Interleaved: 3 floats of position, 4 bytes of colour, 2 unsigned shorts of texture coordinate; stride 20.
  std::vector<std::uint8_t> data;
  for (int i = 0; i < 3; ++i)
  {
    const float p[3] = { float(i), float(i == 1), 0 };
    const std::uint8_t c[4] = { 255, 51, 0, 128 };
    const std::uint16_t t[2] = { 65535, 0 };
    data.insert(data.end(), reinterpret_cast<const std::uint8_t*>(p), reinterpret_cast<const std::uint8_t*>(p) + 12);
    data.insert(data.end(), c, c + 4);
    data.insert(data.end(), reinterpret_cast<const std::uint8_t*>(t), reinterpret_cast<const std::uint8_t*>(t) + 4);
  }
  const int view = g.View(data.data(), data.size());
  g.Doc["bufferViews"][std::size_t(view)]["byteStride"] = 20;
  const auto add = [&](int offset, int type, const char* kind, bool normalized)
  {
    g.Doc["accessors"].push_back({ { "bufferView", view }, { "byteOffset", offset }, { "componentType", type },
      { "type", kind }, { "count", 3 }, { "normalized", normalized } });
    return int(g.Doc["accessors"].size()) - 1;
  };
  g.Primitive()["attributes"] = { { "POSITION", add(0, 5126, "VEC3", false) },
    { "COLOR_0", add(12, 5121, "VEC4", true) }, { "TEXCOORD_0", add(16, 5123, "VEC2", true) } };
  const auto scene = LoadOnce(g.WriteGltf());
  const Mesh& m = scene->Meshes[0];
  EXPECT_EQ(m.Positions[1], Vec3f(1, 1, 0));
  EXPECT_EQ(m.Positions[2], Vec3f(2, 0, 0));
  EXPECT_FLOAT_EQ(m.Colors[2].x, 1);
  EXPECT_FLOAT_EQ(m.Colors[2].y, 0.2f);
  EXPECT_FLOAT_EQ(m.Colors[2].w, 128 / 255.f);
  EXPECT_FLOAT_EQ(m.TexCoords[0][1].x, 1);
  EXPECT_FLOAT_EQ(m.TexCoords[0][1].y, 0);
  EXPECT_TRUE(m.TexCoords[1].empty());
}

TEST(Gltf, IndexOfRefraction)
{
  const std::pair<double, float> indices[] = { { 1, 1.f }, { 2.4, 2.4f }, { 0, 1e4f }, { 0.5, 1.f }, { -3, 1.f },
    { 1e30, 1e4f } };
  for (const auto& index : indices)
  {
    Gltf g;
    g.Doc["materials"] = { { { "extensions", { { "KHR_materials_ior", { { "ior", index.first } } } } } } };
    const auto scene = LoadOnce(g.WriteGltf());
    EXPECT_FLOAT_EQ(scene->Materials[0].Ior, index.second) << index.first;
    EXPECT_EQ(HasWarning(*scene, "ior: the value is outside of its range"),
      index.first != 0 && index.first != double(index.second) && index.first != 2.4)
      << index.first;
  }
}

TEST(Gltf, MaterialAndExtensions)
{
  Gltf g;
  g.Doc["materials"] = { { { "name", "m" }, { "emissiveFactor", { 1, 0.5, 0 } }, { "doubleSided", true },
    { "alphaMode", "MASK" }, { "alphaCutoff", 0.25 },
    { "pbrMetallicRoughness",
      { { "baseColorFactor", { 0.1, 0.2, 0.3, 0.4 } }, { "metallicFactor", 0.5 }, { "roughnessFactor", 0.6 } } },
    { "extensions",
      { { "KHR_materials_emissive_strength", { { "emissiveStrength", 10 } } },
        { "KHR_materials_specular", { { "specularFactor", 0.25 }, { "specularColorFactor", { 1, 2, 3 } } } },
        { "KHR_materials_ior", { { "ior", 1.33 } } },
        { "KHR_materials_transmission", { { "transmissionFactor", 0.75 } } },
        { "KHR_materials_volume",
          { { "thicknessFactor", 1 }, { "attenuationColor", { 0.5, 0.6, 0.7 } }, { "attenuationDistance", 2 } } },
        { "KHR_materials_unlit", Json::object() } } } } };
  const auto scene = LoadOnce(g.WriteGltf());
  ASSERT_EQ(scene->Materials.size(), 2u) << "the primitive has none: a default is appended";
  EXPECT_EQ(scene->Meshes[0].Material, 1);
  EXPECT_EQ(scene->Materials[1].BaseColor, Vec3f(1, 1, 1));
  EXPECT_EQ(scene->Materials[1].Metallic, 1);
  const Material& m = scene->Materials[0];
  EXPECT_EQ(m.BaseColor, Vec3f(0.1f, 0.2f, 0.3f));
  EXPECT_FLOAT_EQ(m.Alpha, 0.4f);
  EXPECT_FLOAT_EQ(m.Metallic, 0.5f);
  EXPECT_FLOAT_EQ(m.Roughness, 0.6f);
  EXPECT_EQ(m.Emission, Vec3f(10, 5, 0));
  EXPECT_TRUE(m.DoubleSided && m.Unlit && m.Volume);
  EXPECT_EQ(m.Mode, AlphaMode::Mask);
  EXPECT_FLOAT_EQ(m.AlphaCutoff, 0.25f);
  EXPECT_FLOAT_EQ(m.Specular, 0.25f);
  EXPECT_EQ(m.SpecularColor, Vec3f(1, 2, 3));
  EXPECT_FLOAT_EQ(m.Ior, 1.33f);
  EXPECT_FLOAT_EQ(m.Transmission, 0.75f);
  EXPECT_EQ(m.AttenuationColor, Vec3f(0.5f, 0.6f, 0.7f));
  EXPECT_FLOAT_EQ(m.AttenuationDistance, 2);
}

TEST(Gltf, TexturesOfTheExtensions)
{
  Gltf g;
  const std::vector<std::uint8_t> png = SmallPng();
  g.Doc["images"] = { { { "bufferView", g.View(png.data(), png.size()) }, { "mimeType", "image/png" } } };
  g.Doc["samplers"] = { { { "minFilter", 9729 } }, { { "minFilter", 9985 } }, Json::object() };
  g.Doc["textures"] = Json::array();
  for (int i = 0; i < 8; ++i)
    g.Doc["textures"].push_back({ { "source", 0 }, { "sampler", i % 3 } });
  const auto use = [](int i) { return Json{ { "index", i } }; };
  Json coatNormal = use(5);
  coatNormal["scale"] = 0.25;
  coatNormal["texCoord"] = 1;
  g.Doc["materials"] = { { { "name", "car" }, { "occlusionTexture", use(7) },
    { "extensions",
      { { "KHR_materials_specular", { { "specularTexture", use(0) }, { "specularColorTexture", use(0) } } },
        { "KHR_materials_volume", { { "thicknessFactor", 0.5 }, { "thicknessTexture", use(2) } } },
        { "KHR_materials_transmission", { { "transmissionTexture", use(6) } } },
        { "KHR_materials_clearcoat",
          { { "clearcoatFactor", 0.75 }, { "clearcoatRoughnessFactor", 0.125 }, { "clearcoatTexture", use(3) },
            { "clearcoatRoughnessTexture", use(4) }, { "clearcoatNormalTexture", coatNormal } } } } } } };
  g.Doc["extensionsRequired"] = { "KHR_materials_clearcoat" };
  g.Primitive()["material"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(scene->Warnings.empty());
  const Material& m = scene->Materials[0];
  EXPECT_FLOAT_EQ(m.Clearcoat, 0.75f);
  EXPECT_FLOAT_EQ(m.ClearcoatRoughness, 0.125f);
  EXPECT_FLOAT_EQ(m.ClearcoatNormalScale, 0.25f);
  EXPECT_EQ(m.ClearcoatNormalTexture.TexCoord, 1);
  EXPECT_FLOAT_EQ(m.Thickness, 0.5f);
  EXPECT_TRUE(m.Volume);
  EXPECT_EQ(m.SpecularTexture.Texture, m.SpecularColorTexture.Texture) << "one image, decoded once";
  EXPECT_EQ(scene->Textures.size(), 6u) << "occlusion is not decoded";
  const struct
  {
    const TextureUse& Use;
    bool SRGB, MipMap;
  } expected[] = { { m.SpecularColorTexture, true, false }, { m.ThicknessTexture, false, true },
    { m.ClearcoatTexture, false, false }, { m.ClearcoatRoughnessTexture, false, true },
    { m.ClearcoatNormalTexture, false, true }, { m.TransmissionTexture, false, false } };
  for (const auto& e : expected)
  {
    ASSERT_GE(e.Use.Texture, 0);
    const Texture& t = scene->Textures[std::size_t(e.Use.Texture)];
    EXPECT_EQ(t.SRGB, e.SRGB);
    EXPECT_EQ(t.MipMap, e.MipMap);
    EXPECT_EQ(t.Width, 2);
  }
  const Material plain;
  EXPECT_EQ(plain.Clearcoat, 0);
  EXPECT_EQ(plain.ClearcoatTexture.Texture, -1);

  Gltf bad = g;
  bad.Doc.erase("buffers");
  bad.Doc["materials"][0]["occlusionTexture"]["index"] = 8;
  const std::string file = bad.WriteGltf();
  ExpectError(ErrorOf(file), file, "materials[0].occlusionTexture.index", "texture 8 does not exist", "correct");
}

TEST(Gltf, ClearcoatIsClampedToItsRange)
{
  Gltf g;
  g.Doc["materials"] = { { { "extensions",
    { { "KHR_materials_clearcoat", { { "clearcoatFactor", 2 }, { "clearcoatRoughnessFactor", -1 } } } } } } };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Materials[0].Clearcoat, 1);
  EXPECT_EQ(scene->Materials[0].ClearcoatRoughness, 0);
  EXPECT_TRUE(HasWarning(*scene, "KHR_materials_clearcoat.clearcoatFactor: the value is outside of its range"));
  EXPECT_TRUE(HasWarning(*scene, "KHR_materials_clearcoat.clearcoatRoughnessFactor: the value is outside"));
}

TEST(Gltf, IgnoredExtensionsNameTheirMaterials)
{
  Gltf g;
  g.Doc["extensionsUsed"] = { "KHR_materials_sheen", "KHR_materials_iridescence", "KHR_animation_pointer" };
  g.Doc["materials"] = Json::array();
  for (const char* name : { "velvet", "silk", "felt", "moss", "wool" })
    g.Doc["materials"].push_back({ { "name", name }, { "extensions", { { "KHR_materials_sheen", Json::object() } } } });
  g.Doc["materials"][1]["extensions"]["KHR_materials_iridescence"] = Json::object();
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Warnings.size(), 3u) << "one each";
  EXPECT_TRUE(HasWarning(*scene,
    "materials[0] \"velvet\", materials[1] \"silk\", materials[2] \"felt\" and 2 more: KHR_materials_sheen is not"));
  EXPECT_TRUE(HasWarning(*scene, "materials[1] \"silk\": KHR_materials_iridescence is not supported"));
  EXPECT_TRUE(HasWarning(*scene, "KHR_animation_pointer is not supported and ignored"));
}

TEST(Gltf, AnimationPointersAreLeftOut)
{
  Gltf g;
  g.Animate("pointer", "LINEAR", { 0, 1 }, { 0, 0, 0, 1, 1, 1 }, 3);
  Json& target = g.Doc["animations"][0]["channels"][0]["target"];
  target.erase("node");
  target["extensions"]["KHR_animation_pointer"]["pointer"] = "/materials/0/emissiveFactor";
  g.Doc["extensionsUsed"] = { "KHR_animation_pointer" };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_FALSE(scene->Animated());
  EXPECT_TRUE(HasWarning(*scene, "KHR_animation_pointer"));
}

TEST(Gltf, CamerasLightsAndTheDefaultScene)
{
  Gltf g;
  g.Doc["cameras"] = { { { "type", "perspective" }, { "perspective", { { "yfov", 0.7 } } } },
    { { "type", "orthographic" }, { "name", "flat" }, { "orthographic", { { "ymag", 2 } } } } };
  g.Doc["extensions"]["KHR_lights_punctual"]["lights"] = { { { "type", "spot" }, { "color", { 1, 0.5, 0 } },
    { "intensity", 4 }, { "range", 3 }, { "spot", { { "innerConeAngle", 0.1 }, { "outerConeAngle", 0.2 } } } } };
  g.Doc["nodes"] = { { { "mesh", 0 } }, { { "name", "eye" }, { "camera", 0 } }, { { "camera", 1 } },
    { { "extensions", { { "KHR_lights_punctual", { { "light", 0 } } } } } }, { { "mesh", 0 } } };
  g.Doc["scenes"] = { { { "nodes", { 0 } } }, { { "nodes", { 4, 3, 2, 1 } } } };
  g.Doc["scene"] = 1;
  const auto scene = LoadOnce(g.WriteGltf());
  ASSERT_EQ(scene->Cameras.size(), 2u);
  EXPECT_EQ(scene->Cameras[0].Name, "eye");
  EXPECT_EQ(scene->Cameras[0].Node, 1);
  EXPECT_DOUBLE_EQ(scene->Cameras[0].YFov, 0.7);
  EXPECT_EQ(scene->Cameras[1].Name, "flat");
  EXPECT_TRUE(scene->Cameras[1].Orthographic);
  EXPECT_DOUBLE_EQ(scene->Cameras[1].YMag, 2);
  ASSERT_EQ(scene->Lights.size(), 1u);
  EXPECT_EQ(scene->Lights[0].Type, LightType::Spot);
  EXPECT_EQ(scene->Lights[0].Intensity, Vec3f(4, 2, 0));
  EXPECT_FLOAT_EQ(scene->Lights[0].Range, 3);
  EXPECT_FLOAT_EQ(scene->Lights[0].InnerCone, 0.1f);
  EXPECT_FLOAT_EQ(scene->Lights[0].OuterCone, 0.2f);
  ASSERT_EQ(scene->Instances.size(), 1u) << "node 0 belongs to the other scene";
  EXPECT_EQ(scene->Instances[0].Node, 4);
  EXPECT_EQ(scene->Instances[0].Id, 1);
}

TEST(Gltf, NodesShareMeshesAndPrimitivesShareIds)
{
  Gltf g;
  g.Doc["meshes"][0]["primitives"].push_back(g.Primitive());
  g.Doc["nodes"] = { { { "mesh", 0 } }, { { "mesh", 0 } } };
  g.Doc["scenes"][0]["nodes"] = { 0, 1 };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Meshes.size(), 2u);
  ASSERT_EQ(scene->Instances.size(), 4u);
  const int expected[4][3] = { { 0, 0, 1 }, { 1, 0, 1 }, { 0, 1, 2 }, { 1, 1, 2 } };
  for (std::size_t i = 0; i < 4; ++i)
  {
    EXPECT_EQ(scene->Instances[i].Mesh, expected[i][0]);
    EXPECT_EQ(scene->Instances[i].Node, expected[i][1]);
    EXPECT_EQ(scene->Instances[i].Id, expected[i][2]);
  }
}

TEST(Gltf, TrianglesWithPositionsThatAreNotFiniteAreDroppedAndCounted)
{
  Gltf g;
  g.Doc["meshes"][0]["name"] = "torn";
  g.Primitive()["attributes"]["POSITION"] =
    g.Floats({ 0, 0, 0, 1, 0, 0, NAN, 1, 0, 1, 1, 0, 0, 1, INFINITY, 5, 5, 5 }, "VEC3", 3);
  g.Primitive()["indices"] = g.Indices({ 0, 1, 2, 0, 1, 3, 3, 4, 5, 1, 5, 3 });
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "\"torn\": 2 triangle(s)"));
  const Mesh& m = scene->Meshes[0];
  ASSERT_EQ(m.Indices.size(), 6u);
  ASSERT_EQ(m.Positions.size(), 4u);
  for (const Vec3f& p : m.Positions)
    EXPECT_TRUE(IsFinite(p));
  EXPECT_EQ(m.Positions[m.Indices[3]], Vec3f(1, 0, 0));
  EXPECT_EQ(m.Positions[m.Indices[4]], Vec3f(5, 5, 5));
  EXPECT_EQ(m.Positions[m.Indices[5]], Vec3f(1, 1, 0));
}

TEST(Gltf, UnusableNormalsBecomeThoseOfTheFaces)
{
  Gltf g;
  g.Primitive()["attributes"]["NORMAL"] = g.Floats({ 0, 1, 0, 0, 0, 0, NAN, 0, 0 }, "VEC3", 3);
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "2 normal(s)"));
  EXPECT_EQ(scene->Meshes[0].Normals[0], Vec3f(0, 1, 0));
  EXPECT_EQ(scene->Meshes[0].Normals[1], Vec3f(0, 0, 1));
  EXPECT_EQ(scene->Meshes[0].Normals[2], Vec3f(0, 0, 1));
}

TEST(Gltf, TrianglesWithoutAreaAndRepeatedOnesAreDropped)
{
  Gltf g;
  g.Doc["meshes"][0]["name"] = "messy";
  // 3 is where 0 is; 4 lies between 0 and 1.
  g.Primitive()["attributes"]["POSITION"] = g.Floats({ 0, 0, 0, 1, 0, 0, 0, 1, 0, -0.f, 0, 0, 0.25f, 0, 0 }, "VEC3", 3);
  g.Primitive()["indices"] = g.Indices({ 0, 1, 2, 1, 2, 3, 0, 0, 1, 0, 4, 1, 0, 3, 2, 2, 1, 0, 4, 1, 2 });
  g.Primitive()["material"] = 0;
  for (const bool doubleSided : { false, true })
  {
    g.Doc["materials"] = { { { "doubleSided", doubleSided } } };
    const auto scene = LoadOnce(g.WriteGltf());
    EXPECT_TRUE(HasWarning(*scene, "\"messy\": 3 triangle(s) without area were dropped"));
    EXPECT_TRUE(HasWarning(
      *scene, doubleSided ? "\"messy\": 2 triangle(s) at the place of another" : "\"messy\": 1 triangle(s) at the"));
    const std::vector<std::uint32_t> left = doubleSided ? std::vector<std::uint32_t>{ 0, 1, 2, 4, 1, 2 }
                                                        : std::vector<std::uint32_t>{ 0, 1, 2, 2, 1, 0, 4, 1, 2 };
    EXPECT_EQ(scene->Meshes[0].Indices, left) << "the back of a single-sided surface is another one";
  }
  // What deforms may open: only corners that are the same vertex count.
  g.Doc["meshes"][0]["primitives"][0]["targets"] = { Json::object() };
  EXPECT_EQ(LoadOnce(g.WriteGltf())->Meshes[0].Indices.size(), 3u * 5);
}

TEST(Gltf, NothingLeftOfALampIsSaid)
{
  Gltf g;
  g.Doc["meshes"][0]["name"] = "thread";
  g.Doc["materials"] = { { { "name", "glow" }, { "emissiveFactor", { 1, 1, 1 } } } };
  g.Primitive()["material"] = 0;
  g.Primitive()["indices"] = g.Indices({ 0, 1, 1 });
  auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "\"thread\": nothing is left of the mesh; material \"glow\" gives no light there"));
  EXPECT_TRUE(HasWarning(*scene, "no triangles"));
  EXPECT_TRUE(scene->Instances.empty());

  g = Gltf();
  g.Doc["meshes"][0]["name"] = "panel";
  g.Doc["nodes"][0]["name"] = "shrunk";
  g.Doc["nodes"][0]["scale"] = { 1, 0, 1 };
  g.Doc["materials"] = { { { "name", "glow" }, { "emissiveFactor", { 1, 1, 1 } } } };
  g.Primitive()["material"] = 0;
  scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "node \"shrunk\": the lamp of mesh \"panel\" and material \"glow\" has no area"));
  g.Doc["nodes"][0]["scale"] = { 1, 1, 0 }; // flat the way it is anyway
  EXPECT_TRUE(LoadOnce(g.WriteGltf())->Warnings.empty());
}

TEST(Gltf, EmissionThatNoImageHolds)
{
  Gltf g;
  g.Doc["materials"] = { { { "name", "sun" }, { "emissiveFactor", { 1, 1, 1 } },
    { "extensions", { { "KHR_materials_emissive_strength", { { "emissiveStrength", 65504 } } } } } } };
  g.Primitive()["material"] = 0;
  EXPECT_TRUE(LoadOnce(g.WriteGltf())->Warnings.empty());
  g.Doc["materials"][0]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = 1e30;
  g.Doc["extensions"]["KHR_lights_punctual"]["lights"] = { { { "type", "point" }, { "name", "star" },
    { "intensity", 1e30 } } };
  g.Doc["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "material \"sun\": the emission of 1e+30 is beyond"));
  EXPECT_TRUE(HasWarning(*scene, "light \"star\": the intensity of 1e+30 is beyond"));
}

TEST(Gltf, MissingImageBecomesNeutralWithAWarning)
{
  Gltf g;
  g.Doc["images"] = { { { "uri", "gone%20away.png" } }, { { "uri", "https://example.org/x.png" } } };
  g.Doc["textures"] = { { { "source", 0 } }, { { "source", 1 } } };
  g.Doc["materials"] = { { { "emissiveFactor", { 1, 1, 1 } }, { "emissiveTexture", { { "index", 1 } } },
    { "pbrMetallicRoughness", { { "baseColorTexture", { { "index", 0 } } } } } } };
  g.Primitive()["material"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(HasWarning(*scene, "gone away.png"));
  EXPECT_TRUE(HasWarning(*scene, "images are not fetched"));
  EXPECT_EQ(scene->Materials[0].BaseColorTexture.Texture, -1);
  EXPECT_EQ(scene->Materials[0].BaseColor, Vec3f(1, 1, 1));
  EXPECT_EQ(scene->Materials[0].EmissiveTexture.Texture, -1);
  EXPECT_EQ(scene->Materials[0].Emission, Vec3f(0, 0, 0)) << "a lost glow must not become a lamp";
}

TEST(Gltf, ExternalBufferWithAnEscapedName)
{
  Gltf g;
  const std::string name = TempName(" with spaces.bin");
  WriteFile(name, std::string(g.Binary.begin(), g.Binary.end()));
  std::string uri = name.substr(name.find_last_of('/') + 1);
  for (std::size_t at; (at = uri.find(' ')) != std::string::npos;)
    uri.replace(at, 1, "%20");
  g.Doc["buffers"] = { { { "byteLength", g.Binary.size() }, { "uri", uri } } };
  const auto scene = LoadOnce(g.WriteGltf());
  EXPECT_EQ(scene->Meshes[0].Positions[1], Vec3f(1, 0, 0));
  const std::string hash = scene->Hash;
  EXPECT_EQ(hash.size(), 16u);
  EXPECT_EQ(LoadOnce(g.WriteGltf())->Hash, hash) << "content, not name or time";
  g.Binary[3] ^= 1;
  WriteFile(name, std::string(g.Binary.begin(), g.Binary.end()));
  EXPECT_NE(LoadOnce(g.WriteGltf())->Hash, hash) << "the buffer belongs to the content";
  std::remove(name.c_str());
}

struct BadCase
{
  const char* Name;
  std::function<void(Gltf&)> Break;
  const char* Place;
  const char* What;
  const char* Remedy;
};
std::ostream& operator<<(std::ostream& out, const BadCase& c)
{
  return out << c.Name;
}
class BadGltf : public testing::TestWithParam<BadCase>
{
};
TEST_P(BadGltf, IsRefusedWithPlaceCauseAndRemedy)
{
  const BadCase& c = GetParam();
  Gltf g;
  c.Break(g);
  const std::string file = g.WriteGltf();
  ExpectError(ErrorOf(file), file, c.Place, c.What, c.Remedy);
}
INSTANTIATE_TEST_SUITE_P(All, BadGltf,
  testing::Values(BadCase{ "Version", [](Gltf& g) { g.Doc["asset"]["version"] = "1.0"; }, "asset.version",
                    "version \"1.0\" is not supported", "export glTF 2.0" },
    BadCase{ "NoAsset", [](Gltf& g) { g.Doc.erase("asset"); }, "asset", "required property is missing", "add it" },
    BadCase{ "Draco", [](Gltf& g) { g.Doc["extensionsRequired"] = { "KHR_draco_mesh_compression" }; },
      "extensionsRequired[0]", "requires KHR_draco_mesh_compression", "without mesh compression" },
    BadCase{ "Meshopt", [](Gltf& g) { g.Doc["extensionsRequired"] = { "EXT_meshopt_compression" }; },
      "extensionsRequired[0]", "requires EXT_meshopt_compression", "without mesh compression" },
    BadCase{ "UnknownRequired", [](Gltf& g) { g.Doc["extensionsRequired"] = { "XX_new" }; }, "extensionsRequired[0]",
      "requires XX_new", "without this extension" },
    BadCase{ "DracoWithoutFallback",
      [](Gltf& g)
      {
        g.Doc["accessors"][0].erase("bufferView");
        g.Primitive()["extensions"] = { { "KHR_draco_mesh_compression", Json::object() } };
      },
      "meshes[0].primitives[0]", "KHR_draco_mesh_compression", "without mesh compression" },
    BadCase{ "SceneIndex", [](Gltf& g) { g.Doc["scene"] = 3; }, "scene", "scene 3 does not exist (the file has 1)",
      "correct the index" },
    BadCase{ "SceneType", [](Gltf& g) { g.Doc["scene"] = "first"; }, "scene",
      "expected a whole number >= 0, found string", "correct" },
    BadCase{ "NodeIndex", [](Gltf& g) { g.Doc["scenes"][0]["nodes"] = { 7 }; }, "scenes[0].nodes[0]",
      "node 7 does not exist", "correct" },
    BadCase{ "NegativeIndex", [](Gltf& g) { g.Doc["nodes"][0]["mesh"] = -1; }, "nodes[0].mesh", "found -1", "correct" },
    BadCase{
      "FractionIndex", [](Gltf& g) { g.Doc["nodes"][0]["mesh"] = 0.5; }, "nodes[0].mesh", "found 0.5", "correct" },
    BadCase{ "HugeIndex", [](Gltf& g) { g.Doc["nodes"][0]["mesh"] = 18446744073709551615ull; }, "nodes[0].mesh",
      "whole number", "correct" },
    BadCase{ "SelfCycle",
      [](Gltf& g) {
        g.Doc["nodes"].push_back({ { "children", { 1 } } });
      },
      "nodes[1]", "cycle of nodes", "remove the cycle" },
    BadCase{ "LongCycle",
      [](Gltf& g)
      {
        g.Doc["nodes"] = { { { "mesh", 0 }, { "children", { 1 } } }, { { "children", { 2 } } },
          { { "children", { 0 } } } };
      },
      "nodes[0]", "cycle of nodes", "remove the cycle" },
    BadCase{ "TwoParents",
      [](Gltf& g) {
        g.Doc["nodes"] = { { { "children", { 2 } } }, { { "children", { 2 } } }, { { "mesh", 0 } } };
      },
      "nodes[1].children[0]", "node 2 is already a child of node 0", "one parent" },
    BadCase{ "MatrixSize",
      [](Gltf& g) {
        g.Doc["nodes"][0]["matrix"] = { 1, 2 };
      },
      "nodes[0].matrix", "expected 16 numbers, found 2", "correct" },
    BadCase{ "TranslationType",
      [](Gltf& g) {
        g.Doc["nodes"][0]["translation"] = { 1, "2", 3 };
      },
      "nodes[0].translation[1]", "expected a number, found string", "correct" },
    BadCase{ "AccessorIndex", [](Gltf& g) { g.Primitive()["attributes"]["POSITION"] = 9; },
      "meshes[0].primitives[0].attributes.POSITION", "accessor 9 does not exist (the file has 1)", "correct" },
    BadCase{ "ViewIndex", [](Gltf& g) { g.Doc["accessors"][0]["bufferView"] = 4; }, "accessors[0].bufferView",
      "bufferView 4 does not exist", "correct" },
    BadCase{ "AccessorTooLong", [](Gltf& g) { g.Doc["accessors"][0]["count"] = 4; }, "accessors[0]",
      "4 elements of 12 bytes from byte 0 do not fit the bufferView of 36 bytes", "correct count" },
    BadCase{ "AccessorOverflow", [](Gltf& g) { g.Doc["accessors"][0]["byteOffset"] = 9007199254740991ull; },
      "accessors[0]", "do not fit", "byteOffset" },
    BadCase{ "CountOverflow", [](Gltf& g) { g.Doc["accessors"][0]["count"] = 4294967295u; }, "accessors[0]",
      "do not fit", "correct count" },
    BadCase{ "CountZero", [](Gltf& g) { g.Doc["accessors"][0]["count"] = 0; }, "accessors[0].count",
      "at least one element", "remove" },
    BadCase{ "CountWithoutData",
      [](Gltf& g)
      {
        g.Doc["accessors"][0].erase("bufferView");
        g.Doc["accessors"][0]["count"] = 4000000000u;
      },
      "accessors[0].count", "2^24", "export" },
    BadCase{ "ComponentType", [](Gltf& g) { g.Doc["accessors"][0]["componentType"] = 5124; },
      "accessors[0].componentType", "5124 is none of", "export" },
    BadCase{ "ElementType", [](Gltf& g) { g.Doc["accessors"][0]["type"] = "VEC2"; }, "accessors[0].type",
      "\"VEC2\" where VEC3 is expected", "export" },
    BadCase{ "ViewOutside", [](Gltf& g) { g.Doc["bufferViews"][0]["byteLength"] = 48; }, "bufferViews[0]",
      "bytes 0 to 48 lie outside buffer 0 of 36 bytes", "byteLength" },
    BadCase{ "ViewOverflow", [](Gltf& g) { g.Doc["bufferViews"][0]["byteOffset"] = 9007199254740992ull; },
      "bufferViews[0]", "lie outside buffer", "byteOffset" },
    BadCase{ "StrideOdd", [](Gltf& g) { g.Doc["bufferViews"][0]["byteStride"] = 13; }, "bufferViews[0].byteStride",
      "not a multiple of 4", "export" },
    BadCase{ "StrideSmall", [](Gltf& g) { g.Doc["bufferViews"][0]["byteStride"] = 8; }, "accessors[0]",
      "byteStride 8 is smaller than an element of 12", "export" },
    BadCase{ "BufferIndex", [](Gltf& g) { g.Doc["bufferViews"][0]["buffer"] = 1; }, "bufferViews[0].buffer",
      "buffer 1 does not exist", "correct" },
    BadCase{ "BufferMissing",
      [](Gltf& g) {
        g.Doc["buffers"] = { { { "byteLength", 36 }, { "uri", "gone.bin" } } };
      },
      "buffers[0].uri", "gone.bin\" cannot be read: the file does not exist", "put the file there" },
    BadCase{ "BufferRemote",
      [](Gltf& g) {
        g.Doc["buffers"] = { { { "byteLength", 36 }, { "uri", "http://x.org/a.bin" } } };
      },
      "buffers[0].uri", "not fetched", "download" },
    BadCase{ "BufferWithoutUri",
      [](Gltf& g) {
        g.Doc["buffers"] = { { { "byteLength", 36 } } };
      },
      "buffers[0]", "neither a uri nor a binary chunk", "export" },
    BadCase{ "BufferShort",
      [](Gltf& g) {
        g.Doc["buffers"] = { { { "byteLength", 36 }, { "uri", "data:;base64,AAAA" } } };
      },
      "buffers[0]", "byteLength is 36, but only 3 bytes", "cut off" },
    BadCase{ "Base64",
      [](Gltf& g) {
        g.Doc["buffers"] = { { { "byteLength", 36 }, { "uri", "data:;base64,AA*A" } } };
      },
      "buffers[0].uri", "invalid base64 character at offset 2", "export" },
    BadCase{ "IndexOutside",
      [](Gltf& g) {
        g.Primitive()["indices"] = g.Indices({ 0, 1, 3 });
      },
      "meshes[0].primitives[0].indices", "index 3 at place 2 lies outside the 3 vertices", "export" },
    BadCase{ "IndexFloat",
      [](Gltf& g) {
        g.Primitive()["indices"] = g.Floats({ 0, 1, 2 }, "SCALAR", 1);
      },
      "accessors[1].componentType", "indices must be unsigned integers", "export" },
    BadCase{ "AttributeCount",
      [](Gltf& g) {
        g.Primitive()["attributes"]["NORMAL"] = g.Floats({ 0, 0, 1 }, "VEC3", 3);
      },
      "meshes[0].primitives[0].attributes.NORMAL", "has 1 elements, POSITION has 3", "export" },
    BadCase{ "Mode", [](Gltf& g) { g.Primitive()["mode"] = 7; }, "meshes[0].primitives[0].mode",
      "mode 7 does not exist", "use 0 to 6" },
    BadCase{ "MaterialIndex", [](Gltf& g) { g.Primitive()["material"] = 0; }, "meshes[0].primitives[0].material",
      "material 0 does not exist (the file has 0)", "correct" },
    BadCase{ "TextureIndex",
      [](Gltf& g) {
        g.Doc["materials"] = { { { "normalTexture", { { "index", 2 } } } } };
      },
      "materials[0].normalTexture.index", "texture 2 does not exist", "correct" },
    BadCase{ "CameraFov",
      [](Gltf& g)
      {
        g.Doc["cameras"] = { { { "type", "perspective" }, { "perspective", { { "yfov", 4 } } } } };
        g.Doc["nodes"][0]["camera"] = 0;
      },
      "cameras[0].perspective.yfov", "between 0 and pi", "correct" },
    BadCase{ "LightIndex", [](Gltf& g) { g.Doc["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = 0; },
      "nodes[0].extensions.KHR_lights_punctual.light", "no list of lights", "export" },
    BadCase{ "JointIndex",
      [](Gltf& g)
      {
        g.Primitive()["attributes"]["JOINTS_0"] =
          g.Accessor<std::uint8_t>({ 5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }, 5121, "VEC4", 4);
        g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats({ 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0 }, "VEC4", 4);
        g.Doc["skins"] = { { { "joints", { 0 } } } };
        g.Doc["nodes"][0]["skin"] = 0;
      },
      "meshes[0].primitives[0].attributes.JOINTS_0", "joint 5 does not exist", "export" }),
  [](const testing::TestParamInfo<BadCase>& tested) { return std::string(tested.param.Name); });

TEST(Gltf, ContainersThatAreBroken)
{
  const auto refuse =
    [](const std::string& suffix, const std::string& content, const char* place, const char* what, const char* remedy)
  {
    const std::string file = WriteFile(TempName(suffix), content);
    ExpectError(ErrorOf(file), file, place, what, remedy);
  };
  Gltf g;
  const std::string glb = g.GlbBytes();
  refuse(".glb", glb.substr(0, 10), "header", "ends inside its header", "cut off");
  refuse(".glb", glb.substr(0, glb.size() - 4), "header", "announces", "cut off");
  std::string version = glb;
  version[4] = 1;
  refuse(".glb", version, "header", "version 1 is not supported", "glTF 2.0");
  std::string chunk = glb;
  chunk[13] = '\x7f';
  refuse(".glb", chunk, "chunk at byte 12", "announces", "cut off");
  std::string kind = glb;
  kind[16] = 'X';
  refuse(".glb", kind, "chunk at byte 12", "first chunk is not JSON", "export");
  refuse(".gltf", "{ \"asset\": ", "JSON", "parse error", "cut off");
  refuse(".gltf", "", "JSON", "parse error", "not a glTF file");
  refuse(".gltf", std::string(200000, '['), "JSON", "parse error", "cut off");
  const std::string none = testing::TempDir() + "quellNoSuchFile.gltf";
  EXPECT_EQ(ErrorOf(none), none + ": the scene cannot be read: the file does not exist; correct the path");
  const std::string other = WriteFile(TempName(".fbx"), "x");
  EXPECT_NE(ErrorOf(other).find("use .gltf, .glb or .obj"), std::string::npos);
}

namespace
{
/// A file that visits most of the reader.
Gltf Rich()
{
  Gltf g;
  g.Primitive()["attributes"]["NORMAL"] = g.Floats({ 0, 0, 1, 0, 0, 1, 0, 0, 1 }, "VEC3", 3);
  g.Primitive()["attributes"]["TEXCOORD_0"] = g.Floats({ 0, 0, 1, 0, 0, 1 }, "VEC2", 2);
  g.Primitive()["attributes"]["JOINTS_0"] =
    g.Accessor<std::uint8_t>({ 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0 }, 5121, "VEC4", 4);
  g.Primitive()["attributes"]["WEIGHTS_0"] = g.Floats({ 1, 0, 0, 0, 1, 0, 0, 0, 0.5f, 0.5f, 0, 0 }, "VEC4", 4);
  g.Primitive()["indices"] = g.Indices({ 0, 1, 2 });
  g.Primitive()["targets"] = { { { "POSITION", g.Floats({ 0, 0, 2, 0, 0, 4, 0, 0, 6 }, "VEC3", 3) } } };
  g.Doc["meshes"][0]["weights"] = { 0.5 };
  g.Doc["skins"] = { { { "joints", { 1, 2 } } } };
  g.Doc["nodes"] = { { { "mesh", 0 }, { "skin", 0 } },
    { { "children", { 2 } }, { "matrix", { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1 } } },
    { { "rotation", { 0, 0, 0, 1 } }, { "camera", 0 },
      { "extensions", { { "KHR_lights_punctual", { { "light", 0 } } } } } } };
  g.Doc["scenes"][0]["nodes"] = { 0, 1 };
  g.Doc["cameras"] = { { { "type", "perspective" }, { "perspective", { { "yfov", 0.7 } } } } };
  g.Doc["extensions"]["KHR_lights_punctual"]["lights"] = { { { "type", "spot" },
    { "spot", { { "innerConeAngle", 0.1 } } } } };
  const std::vector<std::uint8_t> png = SmallPng();
  g.Doc["images"] = { { { "bufferView", g.View(png.data(), png.size()) }, { "mimeType", "image/png" } } };
  g.Doc["samplers"] = { { { "wrapS", 33071 } } };
  g.Doc["textures"] = { { { "source", 0 }, { "sampler", 0 } } };
  g.Doc["materials"] = { { { "emissiveFactor", { 1, 1, 1 } }, { "normalTexture", { { "index", 0 }, { "scale", 0.5 } } },
    { "pbrMetallicRoughness",
      { { "baseColorTexture",
        { { "index", 0 }, { "extensions", { { "KHR_texture_transform", { { "scale", { 2, 3 } } } } } } } } } },
    { "extensions", { { "KHR_materials_volume", { { "thicknessFactor", 1 } } } } } } };
  g.Primitive()["material"] = 0;
  g.Doc["materials"][0]["extensions"]["KHR_materials_clearcoat"] = { { "clearcoatFactor", 1 },
    { "clearcoatTexture", { { "index", 0 } } } };
  g.Animate("translation", "LINEAR", { 0, 1 }, { 0, 0, 0, 1, 1, 1 }, 3);
  g.Doc["animations"][0]["channels"][0]["target"]["node"] = 2; // a joint
  const int times = g.Floats({ 0, 1 }, "SCALAR", 1), weights = g.Floats({ 0, 1 }, "SCALAR", 1);
  g.Doc["animations"].push_back({ { "samplers", { { { "input", times }, { "output", weights } } } },
    { "channels", { { { "sampler", 0 }, { "target", { { "node", 0 }, { "path", "weights" } } } } } } });
  g.Doc["nodes"].push_back({ { "mesh", 0 },
    { "extensions", { { "EXT_mesh_gpu_instancing",
                      { { "attributes", { { "TRANSLATION", g.Floats({ 0, 0, 0, 1, 2, 3 }, "VEC3", 3) } } } } } } } });
  g.Doc["scenes"][0]["nodes"] = { 0, 1, 3 };
  const std::vector<std::uint16_t> where{ 2 };
  const std::vector<float> what{ 7, 8, 9 };
  const int indices = g.View(where.data(), 2), values = g.View(what.data(), 12);
  g.Doc["accessors"][0]["sparse"] = { { "count", 1 },
    { "indices", { { "bufferView", indices }, { "componentType", 5123 } } },
    { "values", { { "bufferView", values } } } };
  g.Doc["scenes"][0]["extras"] = { { "resolution", { 64, 64 } },
    { "environment", { { { "type", "constant" }, { "radiance", { 1, 1, 1 } } } } } };
  return g;
}

/// Loads, and where that works walks through everything an integrator would.
bool Survives(const std::string& file)
{
  try
  {
    const auto scene = LoadScene(file);
    const ScenePose pose = scene->PoseAt(0.3);
    const std::vector<Mat4>& world = pose.World;
    scene->MovingInstances();
    std::vector<Vec3f> positions, normals;
    for (const Instance& i : scene->Instances)
    {
      scene->Deform(i, pose, Vec3d(), positions, &normals, nullptr);
      EXPECT_EQ(positions.size(), scene->Meshes.at(std::size_t(i.Mesh)).Positions.size());
      for (const Vec3f& p : positions)
        EXPECT_TRUE(IsFinite(p));
      for (const Vec3f& n : normals)
        EXPECT_NEAR(Length(n), 1, 1e-4);
      const Mesh& m = scene->Meshes.at(std::size_t(i.Mesh));
      world.at(std::size_t(i.Node));
      scene->Materials.at(std::size_t(m.Material));
      for (const std::uint32_t k : m.Indices)
        EXPECT_TRUE(IsFinite(m.Positions.at(k)));
      EXPECT_TRUE(m.Normals.empty() || m.Normals.size() == m.Positions.size());
      EXPECT_TRUE(m.TexCoords[0].empty() || m.TexCoords[0].size() == m.Positions.size());
    }
    for (const Material& m : scene->Materials)
      EXPECT_LT(m.BaseColorTexture.Texture, int(std::max<std::size_t>(scene->Textures.size(), 1)));
    return true;
  }
  catch (const SceneError& e)
  {
    const std::string what = e.what();
    EXPECT_EQ(what.compare(0, file.size() + 2, file + ": "), 0) << what;
    return false;
  }
}

void Values(Json& json, std::vector<Json*>& all)
{
  all.push_back(&json);
  if (json.is_structured())
    for (Json& child : json)
      Values(child, all);
}

#if defined(__SANITIZE_ADDRESS__)
/// libpng leaves OpenImageIO's reader of a truncated PNG by longjmp, past the destructor of a string. The library's
/// stack cannot be told from others in a report (no frame pointers): no leaks are looked for in that one test.
struct NoLeaks
{
  __lsan::ScopedDisabler Off;
};
#else
struct NoLeaks
{
};
#endif
}

TEST(GltfMutation, TheOriginalIsFine)
{
  Gltf g = Rich();
  const auto scene = LoadOnce(g.WriteGlb());
  EXPECT_TRUE(scene->Warnings.empty());
  EXPECT_EQ(scene->Instances.size(), 3u);
  EXPECT_EQ(scene->Textures.size(), 2u);
  EXPECT_EQ(scene->Lights.size() + scene->Cameras.size() + scene->Animation.size(), 4u);
}

TEST(GltfMutation, FlippedBytesAndTruncation)
{
  [[maybe_unused]] NoLeaks libpng;
  Gltf g = Rich();
  const std::string original = g.GlbBytes();
  std::mt19937 random(1234);
  const std::string file = TempName(".glb");
  int good = 0, refused = 0;
  for (int round = 0; round < 2000; ++round)
  {
    std::string bytes = original;
    const int changes = 1 + int(random() % 3);
    for (int k = 0; k < changes; ++k)
      bytes[random() % bytes.size()] = char(random());
    if (random() % 4 == 0)
      bytes.resize(random() % bytes.size());
    WriteFile(file, bytes);
    ++(Survives(file) ? good : refused);
    if (HasFailure())
      break;
  }
  std::remove(file.c_str());
  EXPECT_GT(good, 100);
  EXPECT_GT(refused, 500);
}

TEST(GltfMutation, ReplacedJsonValues)
{
  Gltf g = Rich();
  g.GlbBytes();
  const Json original = g.Doc;
  const Json hostile[] = { -1, 0, 1, 2, 3, 255, 4294967295u, 9007199254740991ull, 18446744073709551615ull, 0.5, -1e300,
    1e300, "", "x", nullptr, true, Json::array(), Json::object(), { 0, 1, 2 }, { { "index", 0 } } };
  std::mt19937 random(99);
  const std::string file = TempName(".glb");
  int good = 0, refused = 0;
  for (int round = 0; round < 3000; ++round)
  {
    g.Doc = original;
    std::vector<Json*> all;
    Values(g.Doc, all);
    *all[random() % all.size()] = hostile[random() % (sizeof hostile / sizeof *hostile)];
    if (!g.Doc.is_object())
      continue;
    WriteFile(file, g.GlbBytes());
    ++(Survives(file) ? good : refused);
    if (HasFailure())
      break;
  }
  std::remove(file.c_str());
  EXPECT_GT(good, 100);
  EXPECT_GT(refused, 1000);
}
