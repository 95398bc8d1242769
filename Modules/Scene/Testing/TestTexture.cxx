// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTestFiles.h"

#include <cmath>
#include <limits>

using namespace quell;
using namespace scenetest;

namespace
{
/// 4 x 2 greys, value = 10 x + 100 y (y from the top).
Texture Ramp()
{
  Texture t;
  t.Width = 4;
  t.Height = 2;
  for (int y = 0; y < 2; ++y)
    for (int x = 0; x < 4; ++x)
      for (int c = 0; c < 4; ++c)
        t.Floats.push_back(float(10 * x + 100 * y));
  return t;
}
}

TEST(Texture, TexelCentresAreExactAndBetweenThemIsLinear)
{
  const Texture t = Ramp();
  for (int y = 0; y < 2; ++y)
    for (int x = 0; x < 4; ++x)
      EXPECT_FLOAT_EQ(t.Sample((float(x) + 0.5f) / 4, (float(y) + 0.5f) / 2).x, float(10 * x + 100 * y));
  EXPECT_FLOAT_EQ(t.Sample(0.5f, 0.25f).x, 15.f);  // halfway between texels 1 and 2
  EXPECT_FLOAT_EQ(t.Sample(0.375f, 0.5f).x, 60.f); // halfway between rows: v = 0 is the top
}

TEST(Texture, WrapModes)
{
  Texture t = Ramp();
  EXPECT_FLOAT_EQ(t.Sample(0, 0.25f).x, 15.f) << "repeat: between texels 3 and 0";
  EXPECT_FLOAT_EQ(t.Sample(1.375f, 0.25f).x, 10.f);
  EXPECT_FLOAT_EQ(t.Sample(-0.625f, -1.75f).x, 10.f);
  t.WrapS = t.WrapT = Wrap::Clamp;
  EXPECT_FLOAT_EQ(t.Sample(-3, 0.25f).x, 0.f);
  EXPECT_FLOAT_EQ(t.Sample(1e30f, 7).x, 130.f);
  t.WrapS = t.WrapT = Wrap::Mirror;
  EXPECT_FLOAT_EQ(t.Sample(0, 0.25f).x, 0.f) << "mirror: texel 0 beside itself";
  EXPECT_FLOAT_EQ(t.Sample(1.125f, 0.25f).x, 30.f) << "first texel behind the right edge is the last";
  EXPECT_FLOAT_EQ(t.Sample(-0.375f, 0.25f).x, 10.f);
  EXPECT_FLOAT_EQ(t.Sample(2.375f, 0.25f).x, 10.f);
}

TEST(Texture, Nearest)
{
  Texture t = Ramp();
  t.Nearest = true;
  EXPECT_FLOAT_EQ(t.Sample(0.49f, 0.49f).x, 10.f);
  EXPECT_FLOAT_EQ(t.Sample(0.51f, 0.51f).x, 120.f);
  EXPECT_FLOAT_EQ(t.Sample(1, 1).x, 0.f) << "repeat: 1 is 0";
  t.WrapS = t.WrapT = Wrap::Clamp;
  EXPECT_FLOAT_EQ(t.Sample(1, 1).x, 130.f);
}

TEST(Texture, NonFiniteCoordinatesReadZero)
{
  const float bad[] = { std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
    -std::numeric_limits<float>::infinity() };
  const Texture t = Ramp();
  for (const float b : bad)
  {
    EXPECT_EQ(t.Sample(b, 0.25f).x, t.Sample(0, 0.25f).x);
    EXPECT_EQ(t.Sample(0.375f, b).x, t.Sample(0.375f, 0).x);
  }
  EXPECT_EQ(Texture().Sample(0.5f, 0.5f).x, 0);
}

TEST(Texture, SRGBIsDecodedBeforeFilteringAndAlphaIsNot)
{
  Texture t;
  t.Width = 2;
  t.Height = 1;
  t.WrapS = t.WrapT = Wrap::Clamp;
  t.Bytes = { 0, 10, 128, 128, 255, 11, 188, 255 };
  t.SRGB = true;
  const Vec4f a = t.Sample(0.25f, 0.5f);
  EXPECT_FLOAT_EQ(a.x, 0);
  EXPECT_NEAR(a.y, 10 / 255. / 12.92, 1e-8); // linear part
  EXPECT_NEAR(a.z, 0.2158605, 1e-6);         // ((128/255 + .055) / 1.055)^2.4
  EXPECT_NEAR(a.w, 128 / 255., 1e-7);
  EXPECT_NEAR(t.Sample(0.5f, 0.5f).x, 0.5, 1e-7) << "the mean of light, not of codes";
  EXPECT_NEAR(t.Sample(0.75f, 0.5f).z, 0.5028865, 1e-6);
  t.SRGB = false;
  EXPECT_NEAR(t.Sample(0.25f, 0.5f).z, 128 / 255., 1e-7);
}

TEST(Texture, PngIsDecodedFromTheFileWithItsSampler)
{
  Gltf g;
  const std::vector<std::uint8_t> png = SmallPng();
  g.Doc["images"] = { { { "bufferView", g.View(png.data(), png.size()) }, { "mimeType", "image/png" } } };
  g.Doc["samplers"] = { { { "magFilter", 9728 }, { "wrapS", 33071 }, { "wrapT", 33648 } } };
  g.Doc["textures"] = { { { "source", 0 }, { "sampler", 0 } } };
  g.Doc["materials"] = { { { "pbrMetallicRoughness",
    { { "baseColorTexture", { { "index", 0 } } }, { "metallicRoughnessTexture", { { "index", 0 } } } } } } };
  g.Primitive()["material"] = 0;
  const auto scene = LoadOnce(g.WriteGlb());
  ASSERT_TRUE(scene->Warnings.empty()) << scene->Warnings[0];
  ASSERT_EQ(scene->Textures.size(), 2u) << "one per colour space";
  const Texture& color = scene->Textures[std::size_t(scene->Materials[0].BaseColorTexture.Texture)];
  const Texture& data = scene->Textures[std::size_t(scene->Materials[0].MetallicRoughnessTexture.Texture)];
  EXPECT_TRUE(color.SRGB && !data.SRGB && color.Nearest);
  EXPECT_EQ(color.WrapS, Wrap::Clamp);
  EXPECT_EQ(color.WrapT, Wrap::Mirror);
  EXPECT_EQ(color.Width, 2);
  EXPECT_EQ(color.Height, 1);
  EXPECT_EQ(color.Bytes, (std::vector<std::uint8_t>{ 255, 0, 0, 255, 0, 188, 255, 255 }));
  EXPECT_NEAR(color.Sample(0.75f, 0.5f).y, 0.5028865, 1e-6);
  EXPECT_NEAR(data.Sample(0.75f, 0.5f).y, 188 / 255., 1e-6);
}

TEST(Texture, WebPWhereItCanBeReadAndKtxWithAWarning)
{
  // 4 x 4 of sRGB (204, 103, 50).
  const std::vector<std::uint8_t> webp = { 82, 73, 70, 70, 66, 0, 0, 0, 87, 69, 66, 80, 86, 80, 56, 32, 54, 0, 0, 0, 80,
    2, 0, 157, 1, 42, 4, 0, 4, 0, 0, 0, 0, 37, 160, 2, 116, 186, 1, 248, 1, 250, 1, 252, 0, 9, 208, 0, 254, 223, 128,
    63, 252, 176, 252, 127, 82, 121, 255, 203, 16, 255, 251, 82, 126, 188, 193, 202, 255, 237, 50, 0, 0, 0 };
  Gltf g;
  const std::vector<std::uint8_t> png = SmallPng();
  g.Doc["images"] = { { { "bufferView", g.View(webp.data(), webp.size()) }, { "mimeType", "image/webp" } },
    { { "bufferView", g.View(png.data(), png.size()) }, { "mimeType", "image/png" } } };
  g.Doc["textures"] = { { { "extensions", { { "EXT_texture_webp", { { "source", 0 } } } } } },
    { { "source", 1 }, { "extensions", { { "KHR_texture_basisu", { { "source", 0 } } } } } },
    { { "extensions", { { "KHR_texture_basisu", { { "source", 0 } } } } } } };
  g.Doc["materials"] = { { { "normalTexture", { { "index", 1 } } }, { "emissiveTexture", { { "index", 2 } } },
    { "emissiveFactor", { 1, 1, 1 } }, { "pbrMetallicRoughness", { { "baseColorTexture", { { "index", 0 } } } } } } };
  g.Doc["extensionsUsed"] = { "EXT_texture_webp" };
  g.Primitive()["material"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  const Material& m = scene->Materials[0];
  if (m.BaseColorTexture.Texture < 0)
    EXPECT_TRUE(HasWarning(*scene, "OpenImageIO lacks the format"));
  else
  {
    const Texture& t = scene->Textures[std::size_t(m.BaseColorTexture.Texture)];
    EXPECT_EQ(t.Width, 4);
    EXPECT_EQ(t.Height, 4);
    ASSERT_EQ(t.Bytes.size(), 64u);
    EXPECT_NEAR(t.Bytes[0], 204, 2);
    EXPECT_NEAR(t.Bytes[61], 103, 2);
    EXPECT_NEAR(t.Bytes[62], 50, 2);
  }
  ASSERT_GE(m.NormalTexture.Texture, 0) << "the PNG beside the KTX2";
  EXPECT_EQ(scene->Textures[std::size_t(m.NormalTexture.Texture)].Width, 2);
  EXPECT_TRUE(HasWarning(*scene, "textures[2]: the texture exists only as KTX2"));
  EXPECT_EQ(m.Emission, Vec3f(0, 0, 0)) << "a lost glow must not become a lamp";
}

TEST(Texture, TransformScalesThenRotatesThenMoves)
{
  Gltf g;
  const std::vector<std::uint8_t> png = SmallPng();
  g.Doc["images"] = { { { "uri", "data:image/png;base64," + Base64(png) } } };
  g.Doc["textures"] = { { { "source", 0 } } };
  g.Doc["materials"] = { { { "pbrMetallicRoughness",
    { { "baseColorTexture",
      { { "index", 0 }, { "texCoord", 0 },
        { "extensions", { { "KHR_texture_transform", { { "offset", { 0.25, -0.5 } }, { "rotation", 1.5707963267948966 },
                                                       { "scale", { 2, 3 } }, { "texCoord", 1 } } } } } } } } } } };
  g.Primitive()["material"] = 0;
  const auto scene = LoadOnce(g.WriteGltf());
  const TextureUse& use = scene->Materials[0].BaseColorTexture;
  EXPECT_EQ(use.TexCoord, 1);
  // A quarter turn counter-clockwise, v down: (u, v) -> (3 v, -2 u), then the offset.
  const double expected[2][3] = { { 0, 3, 0.25 }, { -2, 0, -0.5 } };
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 3; ++j)
      EXPECT_NEAR(use.Transform[i][j], expected[i][j], 1e-6);
}

TEST(Environment, LoadsScalesAndRefuses)
{
  Scene scene;
  EXPECT_THROW(LoadEnvironment(scene, "no-such-file.hdr"), SceneError);
  EXPECT_FALSE(scene.Sky.Present);
  const std::string file = TempName(".png");
  const std::vector<std::uint8_t> png = SmallPng();
  WriteFile(file, std::string(png.begin(), png.end()));
  EXPECT_THROW(LoadEnvironment(scene, file, -1), SceneError);
  EXPECT_THROW(LoadEnvironment(scene, file, std::numeric_limits<float>::quiet_NaN()), SceneError);
  LoadEnvironment(scene, file, 2.5f);
  std::remove(file.c_str());
  ASSERT_TRUE(scene.Sky.Present);
  ASSERT_EQ(scene.Sky.Texture, 0);
  EXPECT_FLOAT_EQ(scene.Sky.Color.y, 2.5f);
  EXPECT_EQ(scene.Textures[0].WrapS, Wrap::Repeat);
  EXPECT_EQ(scene.Textures[0].WrapT, Wrap::Clamp);
  EXPECT_NEAR(scene.Textures[0].Sample(0.75f, 0.5f).y, 0.5028865, 1e-6);
}

TEST(Environment, TellsWhatItCuts)
{
  // Mantissas of 128 and a shared exponent: 2^126 and 1.
  const std::string file = TempName(".hdr");
  WriteFile(file, std::string("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\xff\x80\x80\x80\x81"));
  Scene scene;
  LoadEnvironment(scene, file);
  std::remove(file.c_str());
  EXPECT_TRUE(HasWarning(scene, "3 value(s) above 1e37 became that"));
  ASSERT_EQ(scene.Textures[0].Floats.size(), 8u);
  EXPECT_EQ(scene.Textures[0].Floats[0], 1e37f);
  EXPECT_EQ(scene.Textures[0].Floats[4], 1.f);
}

TEST(Environment, ConstantAndTurnedImageInExtras)
{
  Gltf g;
  g.Doc["scenes"][0]["extras"] = { { "environment", { { { "type", "constant" }, { "radiance", { 1, 2, 3 } } } } },
    { "resolution", { 640, 360 } }, { "max_depth", 5 } };
  const auto constant = LoadOnce(g.WriteGltf());
  EXPECT_TRUE(constant->Sky.Present);
  EXPECT_EQ(constant->Sky.Texture, -1);
  EXPECT_EQ(constant->Sky.Color, Vec3f(1, 2, 3));
  EXPECT_EQ(constant->Resolution[0], 640);
  EXPECT_EQ(constant->Resolution[1], 360);
  EXPECT_EQ(constant->MaximumDepth, 5);

  // 2 x 1 picture: its left half is red. Mitsuba's orientation: u in [0, 1/2] looks to +x; ours: +x is the right half.
  const std::string image = TempName(".png");
  const std::vector<std::uint8_t> png = SmallPng();
  WriteFile(image, std::string(png.begin(), png.end()));
  g.Doc["scenes"][0]["extras"]["environment"] = { { { "type", "envmap" }, { "filename", image } } };
  const auto plain = LoadOnce(g.WriteGltf());
  ASSERT_EQ(plain->Sky.Texture, 0);
  EXPECT_NEAR(plain->Textures[0].Sample(0.75f, 0.5f).x, 1, 1e-5);
  EXPECT_NEAR(plain->Textures[0].Sample(0.25f, 0.5f).x, 0, 1e-5);
  // Half a turn about y swaps them.
  g.Doc["scenes"][0]["extras"]["environment"][0]["toWorld"] = { { -1, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, -1, 0 },
    { 0, 0, 0, 1 } };
  const auto turned = LoadOnce(g.WriteGltf());
  EXPECT_NEAR(turned->Textures[0].Sample(0.25f, 0.5f).x, 1, 1e-5);
  std::remove(image.c_str());

  g.Doc["scenes"][0]["extras"] = { { "environment", { { { "type", "envmap" }, { "filename", "gone.hdr" } } } },
    { "resolution", "large" }, { "max_depth", -1 } };
  const auto gone = LoadOnce(g.WriteGltf());
  EXPECT_FALSE(gone->Sky.Present);
  EXPECT_TRUE(HasWarning(*gone, "resolution")) << "extras never refuse a file";
}
