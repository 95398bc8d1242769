// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTestFiles.h"

#include <cmath>
#include <random>

using namespace quell;
using namespace scenetest;

namespace
{
/// Writes an OBJ that uses `mtl` with one material "m".
std::shared_ptr<const Scene> WithMaterial(const std::string& mtl)
{
  const std::string library = WriteFile(TempName(".mtl"), "newmtl m\n" + mtl + "\n");
  const std::string name = library.substr(library.find_last_of('/') + 1);
  const auto scene = LoadOnce(WriteFile(
    TempName(".obj"), "mtllib " + name + "\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.25\nusemtl m\nf 1/1 2/1 3/1\n"));
  std::remove(library.c_str());
  return scene;
}
}

TEST(Obj, NegativeIndicesCountBackFromWhereTheyStand)
{
  const auto scene = LoadOnce(WriteFile(TempName(".obj"),
    "o first\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0.25\nvn 0 0 1\nf -4/-2/-1 -3/-1/-1 -2/1/1 -1/2/1\n"
    "g second\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"));
  ASSERT_EQ(scene->Meshes.size(), 2u);
  EXPECT_EQ(scene->Nodes[0].Name, "first");
  EXPECT_EQ(scene->Nodes[1].Name, "second");
  EXPECT_EQ(scene->Instances[1].Id, 2);
  EXPECT_TRUE(scene->Cameras.empty());
  const Mesh& quad = scene->Meshes[0];
  ASSERT_EQ(quad.Indices.size(), 6u);
  const Vec3f expected[6] = { { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 } };
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_EQ(quad.Positions[quad.Indices[i]], expected[i]) << i;
  EXPECT_EQ(quad.Normals[0], Vec3f(0, 0, 1));
  EXPECT_FLOAT_EQ(quad.TexCoords[0][quad.Indices[1]].y, 0.75f) << "v points down here";
  EXPECT_TRUE(scene->Meshes[1].Normals.empty());
  EXPECT_EQ(scene->Meshes[1].Positions[0], Vec3f(5, 0, 0));
}

TEST(Obj, IndicesOutsideAreRefused)
{
  const auto refuse = [](const char* face, const char* what)
  {
    const std::string file =
      WriteFile(TempName(".obj"), std::string("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1 2 3\n") + face);
    ExpectError(ErrorOf(file), file, "face 2", what, "correct the index");
  };
  refuse("f 1 2 4\n", "vertex index 4 does not exist (the file has 3)");
  refuse("f 1 2 -4\n", "vertex index -4 does not exist (3 so far)");
  refuse("f 0 1 2\n", "vertex index 0 does not exist");
  refuse("f 1/1 2/2 3/1\n", "texture coordinate index 2 does not exist (the file has 1)");
  refuse("f 1//1 2//1 3//1\n", "normal index 1 does not exist (the file has 0)");
  refuse("f 2147483647 1 2\n", "vertex index 2147483647");
}

TEST(Obj, ConcaveAndLargePolygons)
{
  // An arrow head: the fan from corner 0 would leave the outline.
  const auto arrow = LoadOnce(WriteFile(TempName(".obj"), "v 2 1 0\nv 0 2 0\nv 1 1 0\nv 0 0 0\nf 4 1 2 3\n"));
  const Mesh& m = arrow->Meshes[0];
  ASSERT_EQ(m.Indices.size(), 6u);
  double area = 0;
  for (std::size_t t = 0; t < 6; t += 3)
  {
    const Vec3f a = m.Positions[m.Indices[t]], b = m.Positions[m.Indices[t + 1]], c = m.Positions[m.Indices[t + 2]];
    const float z = Cross(b - a, c - a).z;
    EXPECT_GT(z, 0) << "every triangle keeps the winding";
    area += z / 2;
  }
  EXPECT_NEAR(area, 1, 1e-6);

  std::string text, face = "f";
  const int n = 300; // more corners than one byte counts
  for (int i = 0; i < n; ++i)
  {
    text += "v " + std::to_string(std::cos(i * 6.283185307 / n)) + " " + std::to_string(std::sin(i * 6.283185307 / n)) +
            " 0\n";
    face += " " + std::to_string(i + 1);
  }
  const auto disc = LoadOnce(WriteFile(TempName(".obj"), text + face + "\n"));
  EXPECT_EQ(disc->Meshes[0].Indices.size(), std::size_t(3 * (n - 2)));
}

TEST(Obj, MaterialMapping)
{
  {
    const Material m = WithMaterial("Kd 0.5 0.6 0.7\nKs 0 0 0\nNs 10\nillum 2\nTf 1 1 1\nKe 17 12 4")->Materials[0];
    EXPECT_EQ(m.BaseColor, Vec3f(0.5f, 0.6f, 0.7f));
    EXPECT_EQ(m.Specular, 0);
    EXPECT_EQ(m.Metallic, 0);
    EXPECT_EQ(m.Roughness, 1);
    EXPECT_EQ(m.Transmission, 0) << "Tf alone makes no glass";
    EXPECT_EQ(m.Emission, Vec3f(17, 12, 4));
    EXPECT_TRUE(m.DoubleSided);
  }
  {
    const Material m = WithMaterial("Kd 0.01 0.01 0.01\nKs 0.95 0.9 0.85\nNs 1000\nillum 5")->Materials[0];
    EXPECT_EQ(m.Metallic, 1);
    EXPECT_EQ(m.BaseColor, Vec3f(0.95f, 0.9f, 0.85f));
    EXPECT_EQ(m.Roughness, 0);
  }
  {
    const Material m = WithMaterial("Kd 0.5 0.5 0.5\nKs 0.2 0.2 0.2\nNs 30\nNi 1.5\nillum 2")->Materials[0];
    EXPECT_EQ(m.Metallic, 0);
    EXPECT_EQ(m.Specular, 1);
    EXPECT_NEAR(m.SpecularColor.x * 0.04f, 0.2f, 1e-6) << "F0 is Ks";
    EXPECT_NEAR(m.Roughness, std::sqrt(std::sqrt(2. / 32.)), 1e-6);
  }
  {
    const Material m =
      WithMaterial("Kd 0.01 0.01 0.01\nKs 0.3 0.3 0.3\nTf 0.25 0.25 1\nNs 200\nNi 2.5\nillum 7")->Materials[0];
    EXPECT_EQ(m.Transmission, 1);
    EXPECT_TRUE(m.Volume);
    EXPECT_FLOAT_EQ(m.Ior, 2.5f);
    EXPECT_EQ(m.Roughness, 0);
    EXPECT_EQ(m.BaseColor, Vec3f(0.5f, 0.5f, 1)) << "two surfaces make Tf";
  }
  {
    const Material m = WithMaterial("Kd 1 1 1\nd 0.25")->Materials[0];
    EXPECT_EQ(m.Mode, AlphaMode::Blend);
    EXPECT_FLOAT_EQ(m.Alpha, 0.25f);
  }
}

TEST(Obj, WhatDissolvesIsNoGlass)
{
  const Material water = WithMaterial("Kd 0.2 0.4 1\nKs 0 0 0\nd 0.5\nillum 4\nTf 0.9 0.8 0.5")->Materials[0];
  EXPECT_EQ(water.Transmission, 0);
  EXPECT_EQ(water.BaseColor, Vec3f(0.2f, 0.4f, 1));
  EXPECT_EQ(water.Mode, AlphaMode::Blend);
  const Material glass =
    WithMaterial("Kd 0.2 0.4 1\nmap_Kd gone.png\nillum 4\nTf 0.25 0.25 0.25\nNi 1.4")->Materials[0];
  EXPECT_EQ(glass.Transmission, 1);
  EXPECT_EQ(glass.BaseColor, Vec3f(0.5f));
  EXPECT_GT(glass.Thickness, 0);
  EXPECT_FLOAT_EQ(glass.Ior, 1.4f);
}

TEST(Obj, FacesTwiceAreKeptOnce)
{
  const auto scene = LoadOnce(WriteFile(TempName(".obj"),
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0\ng wall\nf 1 2 3 4\nf 3 2 5 4\ng thread\nf 1 2 2\nf 1 2 3\n"));
  EXPECT_TRUE(HasWarning(*scene, "group \"wall\": 2 triangle(s) at the place of another one were dropped"));
  EXPECT_TRUE(HasWarning(*scene, "group \"thread\": 1 triangle(s) without area were dropped"));
  std::size_t triangles = 0;
  for (const Mesh& m : scene->Meshes)
    triangles += m.Indices.size() / 3;
  EXPECT_EQ(triangles, 3u) << "OBJ surfaces have two sides: one facing back is the same";
}

TEST(Obj, MapsAndTheirTransform)
{
  const std::string image = TempName(".png");
  const std::vector<std::uint8_t> png = SmallPng();
  WriteFile(image, std::string(png.begin(), png.end()));
  const std::string name = image.substr(image.find_last_of('/') + 1);
  const auto scene = WithMaterial("Kd 1 1 1\nmap_Kd -s 2 3 1 -o 0.5 0.25 0 " + name + "\nmap_d " + name);
  std::remove(image.c_str());
  const Material& m = scene->Materials[0];
  ASSERT_GE(m.BaseColorTexture.Texture, 0);
  const Texture& t = scene->Textures[std::size_t(m.BaseColorTexture.Texture)];
  EXPECT_TRUE(t.SRGB);
  EXPECT_EQ(t.Bytes, (std::vector<std::uint8_t>{ 255, 0, 0, 255, 0, 188, 255, 0 })) << "alpha is the red of map_d";
  EXPECT_EQ(m.Mode, AlphaMode::Mask);
  // OBJ: u = 2 * .25 + .5, v = 3 * .25 + .25 pointing up; in the file's vt (.25, .25) is (.25, .75) here.
  const float(*x)[3] = m.BaseColorTexture.Transform;
  EXPECT_FLOAT_EQ(x[0][0] * 0.25f + x[0][1] * 0.75f + x[0][2], 1.f);
  EXPECT_FLOAT_EQ(x[1][0] * 0.25f + x[1][1] * 0.75f + x[1][2], 0.f);
}

TEST(Obj, MapsOfFloatsAreLinear)
{
  const std::string image = TempName(".hdr");
  // 2 x 1 pixels of RGBE: 0.5 (128 2^(128 - 136)) and 0.25.
  WriteFile(image, std::string("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x80\x80\x80\x80\x7f"));
  const auto scene = WithMaterial("Kd 1 1 1\nmap_Kd " + image.substr(image.find_last_of('/') + 1));
  std::remove(image.c_str());
  ASSERT_GE(scene->Materials[0].BaseColorTexture.Texture, 0);
  const Texture& t = scene->Textures[std::size_t(scene->Materials[0].BaseColorTexture.Texture)];
  EXPECT_FALSE(t.SRGB);
  ASSERT_EQ(t.Floats.size(), 8u);
  EXPECT_FLOAT_EQ(t.Sample(0.25f, 0.5f).x, 0.5f);
  EXPECT_FLOAT_EQ(t.Sample(0.75f, 0.5f).y, 0.25f);
}

TEST(Obj, MissingLibraryImageAndMaterialWarn)
{
  const auto scene =
    LoadOnce(WriteFile(TempName(".obj"), "mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl nobody\nf 1 2 3\n"));
  EXPECT_TRUE(HasWarning(*scene, "gone.mtl\" cannot be read"));
  EXPECT_TRUE(HasWarning(*scene, "usemtl nobody: the material is not defined"));
  EXPECT_EQ(scene->Materials[std::size_t(scene->Meshes[0].Material)].BaseColor, Vec3f(0.8f));
  EXPECT_TRUE(HasWarning(*WithMaterial("map_Kd gone.png"), "gone.png\" cannot be used"));
}

TEST(Obj, WhatIsNoNumberIsToldAndNeverBecomesZero)
{
  const std::string faces = "v 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n";
  for (const char* bad : { "nan 0 0", "0 inf 0", "0 0 1,5", "one 0 0", "0 0", "0 1e 0", "0 . 0", "0 0 # 0" })
  {
    SCOPED_TRACE(bad);
    const auto scene = LoadOnce(WriteFile(TempName(".obj"), "# a comment\r\n v " + std::string(bad) + "\r\n" + faces));
    EXPECT_TRUE(HasWarning(*scene, "line 2: "));
    EXPECT_TRUE(HasWarning(*scene, "1 triangle(s) with a position that is not finite were dropped"));
    ASSERT_EQ(scene->Meshes.size(), 1u);
    EXPECT_EQ(scene->Meshes[0].Indices.size(), 3u);
  }
  for (const char* good : { "0 0 0", "-.5 +1. 1e-3", "1E+2\t0 0 0.5 0.5 0.5", "0 0 0 # corner" })
  {
    SCOPED_TRACE(good);
    const auto scene = LoadOnce(WriteFile(TempName(".obj"), "v " + std::string(good) + "\n" + faces));
    EXPECT_TRUE(scene->Warnings.empty()) << scene->Warnings.front();
    EXPECT_EQ(scene->Meshes[0].Indices.size(), 6u);
  }
  EXPECT_TRUE(
    HasWarning(*WithMaterial("Kd 0.5 o.5 0.5"), ".mtl\": line 2: \"o.5\" after Kd is no number; the default is taken"));
  EXPECT_TRUE(HasWarning(*WithMaterial("Ns"), "line 2: too few numbers after Ns"));
}

TEST(Obj, ByteOrderMarksContinuationsAndComments)
{
  const auto scene =
    LoadOnce(WriteFile(TempName(".obj"), "\xef\xbb\xbfv 0 0 0 # the corner\nv 1 0 \\\n 0\r\nv 0 1 0 \\\r\n\nf 1 2 "
                                         "\\\n3 # a face\n#f 9 9 9\nv 2 2 x\nf 1 3 4\n"));
  ASSERT_EQ(scene->Meshes.size(), 1u);
  EXPECT_EQ(scene->Meshes[0].Indices.size(), 3u);
  EXPECT_EQ(scene->Meshes[0].Positions[1], Vec3f(1, 0, 0));
  EXPECT_TRUE(HasWarning(*scene, "line 9: \"x\" after v")) << scene->Warnings.front();
  const auto refuse = [](const char* face)
  {
    const std::string file = WriteFile(TempName(".obj"), std::string("v 0 0 0\nv 1 0 0\nv 0 1 0\n") + face);
    ExpectError(ErrorOf(file), file, "line 4", "is no corner of a face", "write vertex");
  };
  for (const char* face :
    { "f 1.9 2 3\n", "f 1abc 2 3\n", "f 1 2 3junk\n", "f 4294967297 2 3\n", "f a b c\n", "f 1/1/1/1 2 3\n" })
    refuse(face);
  // what a bad line would have set stays what it was
  EXPECT_EQ(WithMaterial("d x")->Materials[0].Alpha, 1);
  EXPECT_EQ(WithMaterial("d x")->Materials[0].Mode, AlphaMode::Opaque);
}

TEST(Obj, ValuesOutsideOfTheirRangeAreTold)
{
  const auto scene = WithMaterial("Kd 1.5 0.5 -1\nKe -1 0 0\nNi -2\nd 3\nPr 7");
  const Material& m = scene->Materials[0];
  EXPECT_EQ(m.BaseColor, Vec3f(1, 0.5f, 0));
  EXPECT_EQ(m.Emission, Vec3f(0));
  EXPECT_EQ(m.Roughness, 1);
  EXPECT_TRUE(HasWarning(*scene, "material \"m\": Kd 1.5 is outside of [0, 1]; 1 is taken"));
  EXPECT_TRUE(HasWarning(*scene, "Kd -1 is outside of [0, 1]; 0 is taken"));
  EXPECT_TRUE(HasWarning(*scene, "Ke -1 is outside of [0, ..); 0 is taken"));
  EXPECT_TRUE(HasWarning(*scene, "Ni -2"));
  EXPECT_TRUE(HasWarning(*scene, "d 3 is outside of [0, 1]; 1 is taken"));
  EXPECT_TRUE(HasWarning(*scene, "Pr 7 is outside"));
  EXPECT_TRUE(WithMaterial("Kd 1 1 1\nKs 0.2 0.3 0.4\nNs 1000\nNi 1.45\nd 1\nTf 1 1 1")->Warnings.empty());
}

TEST(Obj, MutationsOnlyThrowSceneErrors)
{
  const std::string original = "mtllib a.mtl\no x\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nusemtl m\ng a "
                               "b\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -4 -3 -1\nl 1 2\np 1\ns off\n";
  std::mt19937 random(7);
  const std::string file = TempName(".obj");
  int good = 0, refused = 0;
  for (int round = 0; round < 1500; ++round)
  {
    std::string text = original;
    for (int k = 0; k < 3; ++k)
      text[random() % text.size()] = "0123456789-/ .fvneglustmtl\n\t\\x"[random() % 31];
    if (random() % 5 == 0)
      text.resize(random() % text.size());
    WriteFile(file, text);
    try
    {
      const auto scene = LoadScene(file);
      for (const Mesh& m : scene->Meshes)
        for (const std::uint32_t i : m.Indices)
          ASSERT_LT(i, m.Positions.size());
      ++good;
    }
    catch (const SceneError&)
    {
      ++refused;
    }
  }
  std::remove(file.c_str());
  EXPECT_GT(good, 100);
  EXPECT_GT(refused, 100);
}
