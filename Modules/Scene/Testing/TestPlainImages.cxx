// SPDX-License-Identifier: BSD-3-Clause
// Targa and BMP, which textures of OBJ scenes are: files of three other programs against what ImageMagick and
// OpenImageIO make of them; damaged ones; and as textures of a scene.
#include "SceneTestFiles.h"
#include "quellPlainImage.h"

#include <OpenImageIO/imageio.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <random>
#include <sstream>

using namespace quell;
using namespace scenetest;
namespace fs = std::filesystem;

namespace
{
const fs::path images = fs::path(QUELL_SOURCE_DIR) / "Modules/Scene/Testing/Images";

std::vector<std::uint8_t> Contents(const fs::path& file)
{
  std::ifstream in(file, std::ios::binary);
  return { std::istreambuf_iterator<char>(in), {} };
}

std::vector<std::uint8_t> Rgba(const std::vector<std::uint8_t>& pixels, int channels)
{
  std::vector<std::uint8_t> out;
  for (std::size_t i = 0; i + std::size_t(channels) <= pixels.size(); i += std::size_t(channels))
    for (int c = 0; c < 4; ++c)
      out.push_back(c == 3 ? (channels == 4    ? pixels[i + 3]
                               : channels == 2 ? pixels[i + 1]
                                               : 255)
                           : pixels[i + (channels >= 3 ? std::size_t(c) : 0)]);
  return out;
}

struct Decoded
{
  bool Ok = false;
  PlainImage Image;
  std::string Reason, Format;
  std::uint64_t Taken = 0;
  std::vector<std::uint8_t> Pixels() const { return Rgba(this->Image.Pixels, this->Image.Channels); }
};
Decoded Decode(const std::vector<std::uint8_t>& bytes, const std::string& name)
{
  Decoded d;
  d.Format = SniffPlainImage(bytes.data(), bytes.size(), name);
  // Exactly as large as the file: reading beyond it shows under the address sanitizer.
  const std::vector<std::uint8_t> exact(bytes.begin(), bytes.end());
  d.Ok = DecodePlainImage(
    d.Format, exact.data(), exact.size(), [&](std::uint64_t n) { d.Taken += n; }, d.Image, d.Reason);
  return d;
}

std::vector<std::uint8_t> ByOpenImageIO(const fs::path& file, int& width, int& height)
{
  OIIO::ImageSpec config;
  config.attribute("oiio:UnassociatedAlpha", 1);
  auto input = OIIO::ImageInput::open(file.string(), &config);
  if (!input)
    return {};
  width = input->spec().width;
  height = input->spec().height;
  const int channels = input->spec().nchannels;
  std::vector<std::uint8_t> pixels(std::size_t(width * height * channels));
  if (!input->read_image(0, 0, 0, channels, OIIO::TypeDesc::UINT8, pixels.data()))
    return {};
  return Rgba(pixels, channels);
}

std::string Hash(const std::vector<std::uint8_t>& bytes)
{
  std::uint64_t h = 14695981039346656037ull;
  for (const std::uint8_t b : bytes)
    h = (h ^ b) * 1099511628211ull;
  std::ostringstream text;
  text << std::hex;
  text.width(16);
  text.fill('0');
  text << h;
  return text.str();
}
}

TEST(PlainImages, FilesOfOtherProgramsAsImageMagickAndOpenImageIODecodeThem)
{
  std::ifstream list(images.parent_path() / "decoded-by-imagemagick.txt");
  int files = 0;
  for (std::string line; std::getline(list, line);)
  {
    if (line.empty() || line[0] == '#')
      continue;
    std::istringstream columns(line);
    std::string name, hash, alphaHash;
    columns >> name >> hash >> alphaHash;
    SCOPED_TRACE(name);
    ++files;
    const Decoded d = Decode(Contents(images / name), name);
    if (name == "im-palette-rle.bmp")
    {
      EXPECT_FALSE(d.Ok);
      EXPECT_NE(d.Reason.find("convert it to PNG"), std::string::npos) << d.Reason;
      continue;
    }
    EXPECT_TRUE(d.Ok) << d.Reason;
    EXPECT_EQ(d.Image.Width, 13);
    EXPECT_EQ(d.Image.Height, 7);
    EXPECT_EQ(d.Taken, d.Image.Pixels.size());
    const auto has = [&](const char* part) { return name.find(part) != std::string::npos; };
    const std::vector<std::uint8_t> ours = d.Pixels();
    std::vector<std::uint8_t> alpha;
    for (std::size_t i = 3; i < ours.size(); i += 4)
      alpha.push_back(ours[i]);
    // Both make eight bits of five or four in ways of their own; OpenImageIO's repeats the bits, as ours.
    const bool few = has("555") || has("565") || has("4444") || has("own-1") || has("cmap16");
    if (!few && !has("map-wide")) // indices of 16 bits are nothing that ImageMagick reads
    {
      EXPECT_EQ(Hash(ours), hash) << "ImageMagick";
    }
    if (!has("ARGB")) // ImageMagick gives one bit no alpha, and repeats none of four
    {
      EXPECT_EQ(Hash(alpha), alphaHash) << "ImageMagick, alpha";
    }
    // OpenImageIO 2.4 does not know that a colour map may begin at another number than 0.
    if (has("map32"))
      continue;
    int w = 0, h = 0;
    std::vector<std::uint8_t> theirs = ByOpenImageIO(images / name, w, h);
    EXPECT_EQ(w, d.Image.Width);
    EXPECT_EQ(h, d.Image.Height);
    ASSERT_EQ(theirs.size(), ours.size());
    // Nor alpha in 16 bits.
    for (std::size_t i = 3; i < ours.size() && (has("ARGB") || has("alpha")); i += 4)
      theirs[i] = ours[i];
    EXPECT_TRUE(ours == theirs) << "OpenImageIO";
  }
  EXPECT_GT(files, 35);
}

TEST(PlainImages, MasksCutChannelsOut)
{
  // 1 x 1 pixels of 32 bits: red 10 bits on top, green 3, blue 1 bit, alpha 8 at the bottom.
  const auto bmp = [](std::uint32_t pixel, std::uint32_t r, std::uint32_t g, std::uint32_t b, std::uint32_t a)
  {
    std::vector<std::uint8_t> bytes(14 + 56 + 4, 0);
    const auto put = [&](std::size_t at, std::uint32_t v)
    {
      for (int i = 0; i < 4; ++i)
        bytes[at + std::size_t(i)] = std::uint8_t(v >> (8 * i));
    };
    bytes[0] = 'B', bytes[1] = 'M';
    put(10, 14 + 56), put(14, 56), put(18, 1), put(22, 1);
    bytes[26] = 1, bytes[28] = 32;
    put(30, 3), put(54, r), put(58, g), put(62, b), put(66, a), put(70, pixel);
    return bytes;
  };
  const Decoded d = Decode(bmp(0xb6d000f0u, 0xffc00000u, 0x380000u, 0x40000u, 0xffu), "x.bmp");
  ASSERT_TRUE(d.Ok) << d.Reason;
  // 1011011011 -> 10110110; 010 -> 01001001; 0 -> 0.
  EXPECT_EQ(d.Image.Pixels, (std::vector<std::uint8_t>{ 0xb6, 0x49, 0, 0xf0 }));
  EXPECT_EQ(Decode(bmp(0xffffffffu, 0xffc00000u, 0x380000u, 0x40000u, 0xffu), "x.bmp").Image.Pixels,
    std::vector<std::uint8_t>(4, 255));
  for (const std::uint32_t red : { 0x00010100u, 0xff00ffffu }) // with a hole; over another channel
  {
    const Decoded bad = Decode(bmp(0, red, 0xff00u, 0xffu, 0), "x.bmp");
    EXPECT_FALSE(bad.Ok);
    EXPECT_NE(bad.Reason.find("masks"), std::string::npos) << bad.Reason;
  }
  // One bit of alpha is none or all.
  const std::vector<std::uint8_t> words = Contents(images / "im-ARGB1555.bmp");
  int opaque = 0, expected = 0;
  for (int row = 0; row < 7; ++row)
    for (int x = 0; x < 13; ++x)
      expected += words[138 + std::size_t(28 * row + 2 * x + 1)] >> 7;
  const std::vector<std::uint8_t> pixels = Decode(words, "x").Pixels();
  for (std::size_t i = 3; i < pixels.size(); i += 4)
  {
    EXPECT_TRUE(pixels[i] == 0 || pixels[i] == 255);
    opaque += pixels[i] == 255;
  }
  EXPECT_EQ(opaque, expected);
}

TEST(PlainImages, WhatAlphaMeansStandsInTheExtension)
{
  // 1 x 1, 32 bits, 8 of alpha; with the second version's extension and footer.
  const auto targa = [](int meaning, int declared)
  {
    std::vector<std::uint8_t> bytes{ 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1, 0, 32, std::uint8_t(declared), 10, 50,
      100, 128 };
    const std::size_t extension = bytes.size();
    bytes.resize(extension + 495);
    bytes[extension] = 495 & 255, bytes[extension + 1] = 495 >> 8;
    bytes[extension + 494] = std::uint8_t(meaning);
    bytes.insert(bytes.end(), { std::uint8_t(extension), 0, 0, 0, 0, 0, 0, 0 });
    const char* const mark = "TRUEVISION-XFILE.";
    bytes.insert(bytes.end(), mark, mark + 18);
    return bytes;
  };
  using Bytes = std::vector<std::uint8_t>;
  EXPECT_EQ(Decode(targa(3, 8), "x").Image.Pixels, (Bytes{ 100, 50, 10, 128 }));
  EXPECT_EQ(Decode(targa(4, 8), "x").Image.Pixels, (Bytes{ 199, 100, 20, 128 })) << "premultiplied";
  for (const int none : { 0, 1, 2 })
    EXPECT_EQ(Decode(targa(none, 8), "x").Image.Pixels, (Bytes{ 100, 50, 10 })) << none;
  EXPECT_EQ(Decode(targa(3, 0), "x").Image.Pixels, (Bytes{ 100, 50, 10 })) << "the descriptor counts no alpha";
}

TEST(PlainImages, CutOffAtEveryByteIsAnError)
{
  int cut = 0;
  for (const auto& entry : fs::directory_iterator(images))
  {
    SCOPED_TRACE(entry.path().filename().string());
    const std::vector<std::uint8_t> whole = Contents(entry.path());
    const Decoded all = Decode(whole, entry.path().string());
    if (!all.Ok)
      continue;
    const bool bmp = all.Format == "bmp";
    for (std::size_t n = 0; n < whole.size(); ++n)
    {
      PlainImage image;
      std::string reason;
      const std::vector<std::uint8_t> part(whole.begin(), whole.begin() + std::ptrdiff_t(n));
      const bool ok = DecodePlainImage(
        all.Format, part.data(), n, [](std::uint64_t) {}, image, reason);
      // What lies behind the pixels may go: padding of a BMP's last row, areas of a Targa's second version.
      if (ok)
      {
        EXPECT_TRUE(image.Pixels == all.Image.Pixels) << n;
      }
      else
      {
        EXPECT_NE(reason.find("; "), std::string::npos) << reason;
        ++cut;
      }
      const std::size_t behind = bmp ? 3 : whole.size() > 600 ? 495 + 26 : 26;
      if (n + behind + 1 < whole.size())
      {
        ASSERT_FALSE(ok) << n << " of " << whole.size();
      }
    }
  }
  EXPECT_GT(cut, 5000);
}

TEST(PlainImages, WhateverBytesTheyHold)
{
  std::mt19937 random(5);
  int read = 0, refused = 0;
  for (const auto& entry : fs::directory_iterator(images))
  {
    const std::vector<std::uint8_t> whole = Contents(entry.path());
    const std::string name = entry.path().string();
    for (int k = 0; k < 400; ++k)
    {
      std::vector<std::uint8_t> bytes = whole;
      const std::size_t head = std::min<std::size_t>(bytes.size(), k % 2 ? 70 : bytes.size());
      for (int flips = 1 + k % 4; flips-- > 0;)
        bytes[random() % head] = std::uint8_t(k % 3 == 0 ? 255 : k % 3 == 1 ? 0 : random());
      const Decoded d = Decode(bytes, name);
      const std::size_t pixels = std::size_t(d.Image.Width) * std::size_t(d.Image.Height);
      ASSERT_LE(d.Taken, 128 * 4 * bytes.size()) << "more than the file can fill";
      if (d.Ok)
      {
        ++read;
        ASSERT_GT(pixels, 0u);
        ASSERT_EQ(d.Image.Pixels.size(), pixels * std::size_t(d.Image.Channels));
      }
      else
      {
        ++refused;
        ASSERT_NE(d.Reason.find("; "), std::string::npos) << d.Reason;
      }
    }
  }
  EXPECT_GT(read, 3000);
  EXPECT_GT(refused, 3000);
}

TEST(PlainImages, LiesInHeadersAreRefusedBeforeAllocating)
{
  std::vector<std::uint8_t> huge = Contents(images / "im-rgb.tga");
  huge[12] = huge[13] = huge[14] = huge[15] = 255;
  for (const std::uint8_t type : { 2, 10 })
  {
    huge[2] = type;
    const Decoded d = Decode(huge, "x.tga");
    EXPECT_FALSE(d.Ok);
    EXPECT_EQ(d.Taken, 0u);
    EXPECT_NE(d.Reason.find("65535 x 65535"), std::string::npos) << d.Reason;
  }
  std::vector<std::uint8_t> map = Contents(images / "netpbm-cmap.tga");
  map.back() = 200;
  EXPECT_NE(Decode(map, "x.tga").Reason.find("outside of its colour map"), std::string::npos);
  std::vector<std::uint8_t> bmp = Contents(images / "netpbm-win24.bmp");
  for (std::size_t i = 18; i < 26; ++i)
    bmp[i] = i % 4 == 1 ? 0x7f : 0xff;
  const Decoded d = Decode(bmp, "x");
  EXPECT_FALSE(d.Ok);
  EXPECT_EQ(d.Taken, 0u);
  std::vector<std::uint8_t> palette = Contents(images / "im-palette.bmp");
  palette[46] = 255, palette[47] = 255;
  EXPECT_NE(Decode(palette, "x").Reason.find("its palette has"), std::string::npos) << Decode(palette, "x").Reason;
  for (const std::size_t at : { 10, 14 }) // where pixels begin; the size of the header
    for (const int v : { 0, 255 })
    {
      bmp = Contents(images / "netpbm-win24.bmp");
      std::fill_n(bmp.begin() + std::ptrdiff_t(at), 4, std::uint8_t(v));
      EXPECT_FALSE(Decode(bmp, "x.bmp").Ok) << at << " " << v;
    }
}

TEST(PlainImages, HostileFilesOfOthers)
{
  int files = 0;
  for (const char* folder : { "oiio-targa", "oiio-bmp" })
  {
    const fs::path dir = fs::path(QUELL_SHARED_DATA) / "image-bad" / folder;
    if (!fs::exists(dir))
      GTEST_SKIP() << dir << " is not here";
    for (const auto& entry : fs::directory_iterator(dir))
    {
      const std::string extension = entry.path().extension().string();
      if (extension != ".tga" && extension != ".bmp")
        continue;
      SCOPED_TRACE(entry.path().string());
      const std::vector<std::uint8_t> bytes = Contents(entry.path());
      const Decoded d = Decode(bytes, entry.path().string());
      EXPECT_TRUE(d.Ok || d.Reason.find("; ") != std::string::npos) << d.Reason;
      EXPECT_LE(d.Taken, 512 * bytes.size());
      ++files;
    }
  }
  EXPECT_GT(files, 8);
}

TEST(PlainImages, AsTexturesOfAnObj)
{
  const std::string place = TempName("-plain");
  fs::create_directories(place);
  for (const char* name : { "im-rgb.tga", "netpbm-win24.bmp", "im-rgba.tga" })
    fs::copy_file(images / name, fs::path(place) / name);
  // The extension says nothing: what OBJ exporters call things.
  fs::copy_file(images / "netpbm-win24.bmp", fs::path(place) / "renamed.tga");
  WriteFile(place + "/scan.tif", std::string("II*\0\10\0\0\0", 8));
  WriteFile(place + "/cut.TGA", std::string(10, '\0'));
  WriteFile(place + "/m.mtl", "newmtl a\nmap_Kd im-rgb.tga\nnewmtl b\nmap_Kd netpbm-win24.bmp\nnewmtl c\nmap_Kd "
                              "im-rgba.tga\nnewmtl d\nmap_Kd renamed.tga\nnewmtl e\nmap_Kd scan.tif\nnewmtl f\nmap_Kd "
                              "cut.TGA\n");
  std::string obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
  for (const char* m : { "a", "b", "c", "d", "e", "f" })
    obj += std::string("usemtl ") + m + "\nf 1/1 2/2 3/3\n";
  WriteFile(place + "/s.obj", obj);
  const auto scene = LoadScene(place + "/s.obj");
  fs::remove_all(place);
  std::map<std::string, const Texture*> textures;
  for (const Texture& t : scene->Textures)
    textures[t.Name] = &t;
  for (const char* name : { "im-rgb.tga", "netpbm-win24.bmp", "im-rgba.tga", "renamed.tga" })
  {
    ASSERT_EQ(textures.count(name), 1u) << name;
    EXPECT_EQ(textures[name]->Width, 13);
    EXPECT_TRUE(textures[name]->SRGB);
  }
  EXPECT_EQ(textures["netpbm-win24.bmp"]->Bytes, Decode(Contents(images / "netpbm-win24.bmp"), "x").Pixels());
  EXPECT_EQ(textures["renamed.tga"]->Bytes, textures["netpbm-win24.bmp"]->Bytes);
  EXPECT_EQ(textures["im-rgba.tga"]->Bytes, Decode(Contents(images / "im-rgba.tga"), "x.tga").Pixels());
  EXPECT_TRUE(HasWarning(*scene, "scan.tif")) << "named";
  EXPECT_TRUE(HasWarning(*scene, "TIFF is not read; convert it to PNG"));
  EXPECT_TRUE(HasWarning(*scene, "it ends inside its header"));
}
