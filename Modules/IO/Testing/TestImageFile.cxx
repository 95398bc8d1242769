// SPDX-License-Identifier: BSD-3-Clause
#include "IOTestTools.h"

#include <OpenImageIO/imageio.h>

using namespace quell;

TEST(ImageFile, EveryKnownArrayComesBackBitForBit)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 7, 5 });
  for (const ArrayType& type : KnownArrays())
    AddArray(image, type.Name, type.Components, &WildValue);
  WriteImageFile(dir / "all.exr", image);
  ReadReport report;
  auto back = ReadImageFile(dir / "all.exr", &report);
  EXPECT_EQ(report.Width, 7);
  EXPECT_EQ(report.Height, 5);
  for (const ArrayType& type : KnownArrays())
  {
    EXPECT_TRUE(SameBits(image, back, type.Name)) << type.Name;
    const auto entry =
      std::find_if(report.Arrays.begin(), report.Arrays.end(), [&](const FileArray& a) { return a.Name == type.Name; });
    ASSERT_NE(entry, report.Arrays.end()) << type.Name;
    EXPECT_EQ(entry->Kind, type.Kind) << type.Name;
  }
  EXPECT_EQ(report.Arrays.size(), KnownArrays().size());
}

TEST(ImageFile, LosslessCompressionsAgree)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 67, 41 });
  AddArray(image, "radiance", 3, &WildValue);
  for (auto c :
    { FileCompression::None, FileCompression::Rle, FileCompression::Zips, FileCompression::Zip, FileCompression::Piz })
  {
    WriteOptions options;
    options.Compression = c;
    WriteImageFile(dir / "c.exr", image, {}, options);
    EXPECT_TRUE(SameBits(image, ReadImageFile(dir / "c.exr"), "radiance")) << int(c);
  }
}

TEST(ImageFile, RowZeroIsTheFilesLastRowAndMotionTurnsWithIt)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 4, 3 });
  AddArray(image, "radiance", 3, [](int x, int y, int c) { return float(100 * y + 10 * x + c); });
  AddArray(image, "motion", 2, [](int x, int y, int c) { return c == 0 ? 1.5f : 2.25f + y; });
  WriteImageFile(dir / "o.exr", image);

  auto in = OIIO::ImageInput::open(dir / "o.exr");
  ASSERT_TRUE(in);
  const auto spec = in->spec();
  std::vector<float> raw(size_t(4) * 3 * spec.nchannels);
  ASSERT_TRUE(in->read_image(0, 0, 0, spec.nchannels, OIIO::TypeFloat, raw.data()));
  const auto at = [&](int x, int row, const char* channel)
  { return raw[(size_t(row) * 4 + x) * spec.nchannels + spec.channelindex(channel)]; };
  EXPECT_EQ(at(0, 2, "R"), 0.f) << "VTK's (0, 0) is the bottom left";
  EXPECT_EQ(at(3, 0, "B"), 232.f) << "and (3, 2) the top right";
  EXPECT_EQ(at(1, 2, "motion.X"), 1.5f);
  EXPECT_EQ(at(1, 2, "motion.Y"), -2.25f) << "in the file y points down";
  auto back = ReadImageFile(dir / "o.exr");
  EXPECT_EQ(Value(back, "motion", 0, 0, 1), 2.25f);
  EXPECT_EQ(Value(back, "radiance", 3, 2, 2), 232.f);
}

TEST(ImageFile, RegionIsTheDataWindow)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 2, 1, 5, 4 });
  AddArray(image, "radiance", 3, [](int x, int y, int c) { return float(100 * y + 10 * x + c); });
  AddArray(image, "albedo", 3, [](int, int, int) { return 0.25f; });
  AddArray(image, "depth", 1, [](int x, int, int) { return float(x); });
  WriteOptions options;
  options.Width = 10;
  options.Height = 6;
  WriteImageFile(dir / "crop.exr", image, {}, options);
  auto in = OIIO::ImageInput::open(dir / "crop.exr");
  ASSERT_TRUE(in);
  EXPECT_EQ(in->spec().x, 2);
  EXPECT_EQ(in->spec().y, 2) << "rows 1..3 from the bottom of 6 are rows 2..4 from the top";
  EXPECT_EQ(in->spec().width, 3);
  EXPECT_EQ(in->spec().height, 3);
  EXPECT_EQ(in->spec().full_width, 10);
  EXPECT_EQ(in->spec().full_height, 6);
  in->close();

  ReadReport report;
  auto back = ReadImageFile(dir / "crop.exr", &report);
  EXPECT_EQ(report.DataWindow, (Rect{ 2, 1, 5, 4 }));
  EXPECT_EQ(report.Width, 10);
  EXPECT_EQ(Value(back, "radiance", 4, 3, 1), 341.f);
  EXPECT_EQ(Value(back, "radiance", 5, 3, 1), 0.f);
  EXPECT_EQ(Value(back, "albedo", 0, 0, 2), 1.f) << "background, not 0";
  EXPECT_TRUE(std::isinf(Value(back, "depth", 9, 5, 0)));
  EXPECT_EQ(Value(back, "depth", 2, 1, 0), 2.f);

  ReadOptions part;
  part.Region = { 4, 3, 7, 6 };
  part.Arrays = { "radiance" };
  auto piece = ReadImageFile(dir / "crop.exr", nullptr, part);
  EXPECT_EQ(piece->GetPointData()->GetNumberOfArrays(), 1);
  EXPECT_EQ(Value(piece, "radiance", 4, 3, 1), 341.f);
  EXPECT_EQ(Value(piece, "radiance", 6, 5, 1), 0.f);
  part.Region = { 4, 3, 12, 6 };
  EXPECT_THROW(ReadImageFile(dir / "crop.exr", nullptr, part), StageError);
}

TEST(ImageFile, AnyRegionEqualsTheCrop)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 37, 600 }); // several blocks of rows
  AddArray(image, "radiance", 3, &WildValue);
  AddArray(image, "motion", 2, &WildValue);
  WriteImageFile(dir / "r.exr", image);
  auto whole = ReadImageFile(dir / "r.exr");
  for (const Rect& region :
    { Rect{ 0, 0, 37, 1 }, Rect{ 5, 599, 6, 600 }, Rect{ 3, 100, 30, 420 }, Rect{ 0, 255, 37, 257 } })
  {
    ReadOptions options;
    options.Region = region;
    auto piece = ReadImageFile(dir / "r.exr", nullptr, options);
    for (const char* name : { "radiance", "motion" })
      EXPECT_TRUE(SameBits(whole, piece, name)) << name << " from row " << region.y0;
  }
}

TEST(ImageFile, TiledPartsOfDifferentTypesAndIntegers)
{
  TemporaryDirectory dir;
  // A tiled file with half colours, a float depth and an integer id, as other programs write it.
  const int w = 50, h = 40;
  OIIO::ImageSpec spec(w, h, 5, OIIO::TypeFloat);
  spec.channelnames = { "R", "G", "B", "Z", "id" };
  spec.channelformats = { OIIO::TypeHalf, OIIO::TypeHalf, OIIO::TypeHalf, OIIO::TypeFloat, OIIO::TypeUInt32 };
  spec.tile_width = spec.tile_height = 16;
  auto out = OIIO::ImageOutput::create("openexr");
  ASSERT_TRUE(out->open(dir / "t.exr", spec)) << out->geterror();
  struct Pixel
  {
    std::uint16_t rgb[3];
    char z[4];
    char id[4];
  } __attribute__((packed));
  static_assert(sizeof(Pixel) == 14, "native layout");
  std::vector<Pixel> pixels(size_t(w) * h);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      Pixel& p = pixels[size_t(y) * w + x];
      p.rgb[0] = p.rgb[1] = p.rgb[2] = 0x3800; // 0.5
      const float z = float(x + 1000 * y);
      const std::uint32_t id = 3000000 + std::uint32_t(y);
      std::memcpy(p.z, &z, 4);
      std::memcpy(p.id, &id, 4);
    }
  ASSERT_TRUE(out->write_image(OIIO::TypeUnknown, pixels.data())) << out->geterror();
  ASSERT_TRUE(out->close());
  ReadReport report;
  auto image = ReadImageFile(dir / "t.exr", &report);
  EXPECT_EQ(Value(image, "radiance", 49, 0, 1), 0.5f);
  EXPECT_EQ(Value(image, "depth", 7, 0, 0), 7.f + 39000.f);
  EXPECT_EQ(Value(image, "id", 0, 39, 0), 3000000.f) << "an id is not scaled to [0, 1]";
  EXPECT_EQ(Value(image, "id", 49, 0, 0), 3000039.f);
  ReadOptions options;
  options.Region = { 17, 3, 35, 9 };
  auto piece = ReadImageFile(dir / "t.exr", nullptr, options);
  for (const char* name : { "radiance", "depth", "id" })
    EXPECT_TRUE(SameBits(image, piece, name)) << name;
}

TEST(ImageFile, FactsComeBackExactly)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 2, 2 });
  AddArray(image, "radiance", 3, &WildValue);
  FrameFacts f;
  f.HasCamera = true;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
    {
      f.WorldToCamera.m[i][j] = 0.1 * (i + 1) + 1e-13 * j;
      f.WorldToNdc.m[i][j] = 1. / (3 + i * 4 + j);
    }
  f.Origin = { 1e6 + 0.1, -2, 3e-5 };
  f.Tick = 41;
  f.Time = 41. / 24;
  f.Seed = 123456789012345LL;
  f.SamplesPerPixel = 17;
  f.Scene = "sha256:00ff";
  f.Write(image->GetFieldData());
  WriteOptions options;
  options.Metadata = { { "pipeline", "<pipeline version=\"1\"/>" }, { "tick", "7" } };
  WriteImageFile(dir / "f.exr", image, {}, options);
  ReadReport report;
  auto back = ReadImageFile(dir / "f.exr", &report);
  const FrameFacts g = FrameFacts::Read(back->GetFieldData());
  EXPECT_TRUE(g.HasCamera);
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
    {
      EXPECT_EQ(f.WorldToCamera.m[i][j], g.WorldToCamera.m[i][j]);
      EXPECT_EQ(f.WorldToNdc.m[i][j], g.WorldToNdc.m[i][j]);
    }
  EXPECT_EQ(f.Origin, g.Origin);
  EXPECT_EQ(f.Tick, g.Tick) << "an entry of the caller must not replace a fact";
  EXPECT_EQ(f.Time, g.Time);
  EXPECT_EQ(f.Seed, g.Seed);
  EXPECT_EQ(f.SamplesPerPixel, g.SamplesPerPixel);
  EXPECT_EQ(f.Scene, g.Scene);
  EXPECT_EQ(report.Metadata, (std::map<std::string, std::string>{ { "pipeline", "<pipeline version=\"1\"/>" } }));
}

TEST(ImageFile, StandardMatricesFollowTheFormatsConvention)
{
  // A camera at (1, 2, 5) that looks along -z with a 90 degree field: the point (1, 3, 3) is half way up.
  FrameFacts f;
  f.HasCamera = true;
  f.WorldToCamera.m[0][3] = -1;
  f.WorldToCamera.m[1][3] = -2;
  f.WorldToCamera.m[2][3] = -5;
  Mat4 perspective;
  perspective.m[2][2] = 0;
  perspective.m[2][3] = 0;
  perspective.m[3][2] = -1;
  perspective.m[3][3] = 0;
  f.WorldToNdc = perspective * f.WorldToCamera;
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 2, 2 });
  AddArray(image, "radiance", 3, &WildValue);
  f.Write(image->GetFieldData());
  WriteImageFile(dir / "m.exr", image);

  auto in = OIIO::ImageInput::open(dir / "m.exr");
  const auto* c = in->spec().find_attribute("worldToCamera", OIIO::TypeMatrix);
  const auto* n = in->spec().find_attribute("worldToNDC", OIIO::TypeMatrix);
  ASSERT_TRUE(c && n);
  const auto transform = [](const OIIO::ParamValue* a, const double(&p)[4], double(&q)[4])
  {
    const float* m = static_cast<const float*>(a->data());
    for (int j = 0; j < 4; ++j)
      q[j] = p[0] * m[j] + p[1] * m[4 + j] + p[2] * m[8 + j] + p[3] * m[12 + j]; // row vector times matrix
  };
  double q[4];
  transform(c, { 1, 3, 3, 1 }, q);
  EXPECT_EQ(q[0], 0.);
  EXPECT_EQ(q[1], 1.);
  EXPECT_EQ(q[2], 2.) << "in front of the camera is +z in the file";
  transform(n, { 1, 3, 3, 1 }, q);
  EXPECT_DOUBLE_EQ(q[0] / q[3], 0.5);
  EXPECT_DOUBLE_EQ(q[1] / q[3], 0.25) << "y points down from the top left corner";

  // Somebody else's file, with the standard attributes only, in either convention.
  for (const bool transposed : { false, true })
  {
    float camera[16], ndc[16];
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
      {
        // The transposed layout is pbrt's, whose raster has y up.
        const int from = 4 * i + j, to = transposed ? 4 * j + i : from;
        const float* m = static_cast<const float*>(n->data());
        camera[to] = static_cast<const float*>(c->data())[from];
        ndc[to] = transposed && j == 1 ? m[4 * i + 3] - m[from] : m[from];
      }
    OIIO::ImageSpec spec(2, 2, 3, OIIO::TypeFloat);
    spec.attribute("worldToCamera", OIIO::TypeMatrix, camera);
    spec.attribute("worldToNDC", OIIO::TypeMatrix, ndc);
    auto out = OIIO::ImageOutput::create("openexr");
    ASSERT_TRUE(out->open(dir / "x.exr", spec));
    const std::vector<float> grey(12, .5f);
    ASSERT_TRUE(out->write_image(OIIO::TypeFloat, grey.data()) && out->close());
    const FrameFacts g = ReadImageHeader(dir / "x.exr").Facts;
    ASSERT_TRUE(g.HasCamera);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
      {
        EXPECT_NEAR(g.WorldToCamera.m[i][j], f.WorldToCamera.m[i][j], 1e-6) << transposed << i << j;
        EXPECT_NEAR(g.WorldToNdc.m[i][j], f.WorldToNdc.m[i][j], 1e-6) << transposed << i << j;
      }
  }
}

TEST(ImageFile, HalfClampsAndKeepsWhatMustStayFloat)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 3, 1 });
  const float inf = std::numeric_limits<float>::infinity();
  AddArray(image, "radiance", 3,
    [=](int x, int, int c)
    {
      const float v[9] = { 65504.f, 65520.f, 1e30f, inf, -70000.f, NAN, 1e-8f, 0.1f, 1.f };
      return v[3 * x + c];
    });
  AddArray(image, "id", 1, [](int, int, int) { return 16777215.f; });
  AddArray(image, "depth", 1, [](int, int, int) { return 1e6f; });
  AddArray(image, "motion", 2, [](int, int, int) { return 0.1f; });
  AddArray(image, "position", 3, [](int, int, int) { return 123456.7f; });
  WriteOptions options;
  options.Half = true;
  WriteReport written;
  WriteImageFile(dir / "h.exr", image, {}, options, &written);
  EXPECT_EQ(written.Clamped, 3);
  ASSERT_EQ(written.Warnings.size(), 1u);
  EXPECT_NE(written.Warnings[0].find("h.exr"), std::string::npos);
  ReadReport report;
  auto back = ReadImageFile(dir / "h.exr", &report);
  EXPECT_EQ(Value(back, "radiance", 0, 0, 0), 65504.f);
  EXPECT_EQ(Value(back, "radiance", 0, 0, 1), 65504.f) << "65520 would round to infinity";
  EXPECT_EQ(Value(back, "radiance", 0, 0, 2), 65504.f);
  EXPECT_EQ(Value(back, "radiance", 1, 0, 0), inf) << "an infinity is not hidden";
  EXPECT_EQ(Value(back, "radiance", 1, 0, 1), -65504.f);
  EXPECT_TRUE(std::isnan(Value(back, "radiance", 1, 0, 2)));
  EXPECT_EQ(Value(back, "radiance", 2, 0, 0), 0.f);
  EXPECT_NEAR(Value(back, "radiance", 2, 0, 1), 0.1f, 1e-4);
  for (const FileArray& a : report.Arrays)
    EXPECT_EQ(a.Type, a.Name == "radiance" ? "half" : "float") << a.Name;
  for (const char* name : { "id", "depth", "motion", "position" })
    EXPECT_TRUE(SameBits(image, back, name)) << name;
}

TEST(ImageFile, EightBitValues)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 8, 1 });
  const float inf = std::numeric_limits<float>::infinity();
  const float values[8] = { 0.f, 0.18f, 1.f, 7.f, -1.f, NAN, inf, 0.0031308f };
  AddArray(image, "radiance", 3, [&](int x, int, int) { return values[x]; });
  AddArray(image, "display", 3, [&](int x, int, int) { return values[x]; });
  WriteReport report;
  WriteImageFile(dir / "l.png", image, { { "radiance", "" } }, {}, &report);
  EXPECT_EQ(report.NonFinite, 6);
  WriteImageFile(dir / "d.png", image, { { "display", "" } });
  const auto bytes = [&](const char* name)
  {
    auto in = OIIO::ImageInput::open(dir / name);
    std::vector<unsigned char> b(24);
    EXPECT_TRUE(in->read_image(0, 0, 0, 3, OIIO::TypeUInt8, b.data()));
    std::vector<int> red;
    for (int x = 0; x < 8; ++x)
      red.push_back(b[3 * x]);
    return red;
  };
  // sRGB of 0.18 is 0.46136: 117.6; of 0.0031308 0.04045: 10.3.
  EXPECT_EQ(bytes("l.png"), (std::vector<int>{ 0, 118, 255, 255, 0, 0, 0, 10 }));
  EXPECT_EQ(bytes("d.png"), (std::vector<int>{ 0, 46, 255, 255, 0, 0, 0, 1 }));
  // And back: 8-bit files are decoded to linear.
  EXPECT_NEAR(Value(ReadImageFile(dir / "l.png"), "radiance", 1, 0, 0), 0.18f, 2e-3);
  ReadOptions raw;
  raw.Transfer = FileTransfer::Linear;
  EXPECT_NEAR(Value(ReadImageFile(dir / "l.png", nullptr, raw), "radiance", 1, 0, 0), 118 / 255.f, 1e-6);
}

TEST(ImageFile, PngAlphaStaysStraight)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 2, 2 });
  AddArray(image, "display", 3, [](int, int, int) { return 0.8f; });
  AddArray(image, "alpha", 1, [](int x, int, int) { return x ? 0.2f : 1.f; });
  WriteImageFile(dir / "a.png", image);
  ReadOptions raw;
  raw.Transfer = FileTransfer::Linear;
  auto back = ReadImageFile(dir / "a.png", nullptr, raw);
  EXPECT_NEAR(Value(back, "radiance", 1, 0, 0), 0.8f, 1e-6) << "not multiplied by alpha";
  EXPECT_NEAR(Value(back, "alpha", 1, 0, 0), 0.2f, 1e-6);
}

TEST(ImageFile, OtherFormatsRoundTrip)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 16, 9 });
  AddArray(image, "radiance", 3, [](int x, int y, int c) { return (x + 16.f * y) / 144.f + 0.1f * c; });
  for (const char* name : { "i.jpg", "i.hdr", "i.png" })
  {
    SCOPED_TRACE(name);
    WriteImageFile(dir / name, image);
    auto back = ReadImageFile(dir / name);
    EXPECT_NEAR(Value(back, "radiance", 0, 8, 0), 128 / 144.f, 0.03) << "top left";
    EXPECT_NEAR(Value(back, "radiance", 15, 0, 0), 15 / 144.f, 0.03) << "bottom right";
  }
}

TEST(ImageFile, WriteOnlyFormatsHoldThePixels)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 5, 4 });
  AddArray(image, "display", 3, [](int x, int y, int c) { return (x + 5 * y + 20 * c) / 255.f; });
  for (const char* name : { "i.tif", "i.bmp", "i.tga" })
  {
    SCOPED_TRACE(name);
    WriteImageFile(dir / name, image);
    auto in = OIIO::ImageInput::open(dir / name);
    ASSERT_TRUE(in);
    std::vector<unsigned char> b(60);
    ASSERT_TRUE(in->read_image(0, 0, 0, 3, OIIO::TypeUInt8, b.data()));
    EXPECT_EQ(int(b[0]), 15) << "top left";
    EXPECT_EQ(int(b[59]), 44) << "bottom right, blue";
  }
}

TEST(ImageFile, LayersNamesAndCollisions)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 2, 2 });
  AddArray(image, "radiance", 3, &WildValue);
  AddArray(image, "albedo", 3, &WildValue);
  AddArray(image, "motion", 2, &WildValue);
  WriteImageFile(
    dir / "n.exr", image, { { "albedo", "" }, { "radiance", "noisy" }, { "radiance", "" }, { "motion", "mv" } });
  ReadReport r = ReadImageHeader(dir / "n.exr");
  std::map<std::string, ArrayKind> kinds;
  for (const FileArray& a : r.Arrays)
    kinds[a.Name] = a.Kind;
  EXPECT_EQ(kinds, (std::map<std::string, ArrayKind>{ { "albedo", ArrayKind::Albedo }, { "noisy", ArrayKind::Color },
                     { "radiance", ArrayKind::Color }, { "mv", ArrayKind::Motion } }));
  auto back = ReadImageFile(dir / "n.exr");
  auto copy = NewImage({ 0, 0, 2, 2 });
  AddArray(copy, "mv", 2, &WildValue);
  EXPECT_TRUE(SameBits(copy, back, "mv")) << "the recorded kind turns y back";
  EXPECT_THROW(WriteImageFile(dir / "n.exr", image, { { "albedo", "" }, { "albedo", "" } }), StageError);
  EXPECT_THROW(WriteImageFile(dir / "n.exr", image, { { "albedo", "bad name" } }), StageError);
  EXPECT_THROW(WriteImageFile(dir / "n.exr", image, { { "nothing", "" } }), StageError);
  EXPECT_THROW(WriteImageFile(dir / "n.png", image, { { "radiance", "" }, { "albedo", "" } }), StageError);
  EXPECT_THROW(WriteImageFile(dir / "n.xyz", image), StageError);
  EXPECT_EQ(dir.List(), std::vector<std::string>{ "n.exr" }) << "a refused write leaves nothing";
}

TEST(ImageFile, AppearsWholeOrNotAtAll)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 4, 4 });
  AddArray(image, "radiance", 3, &WildValue);
  // The target's name is taken by a directory: everything is written, the rename fails.
  std::filesystem::create_directory(dir / "taken.exr");
  const std::string text = ErrorOf([&] { WriteImageFile(dir / "taken.exr", image); });
  EXPECT_NE(text.find("taken.exr"), std::string::npos) << text;
  EXPECT_EQ(dir.List(), std::vector<std::string>{ "taken.exr" });
  // A directory that cannot be: its parent is a file.
  WriteImageFile(dir / "deep/er/file.exr", image);
  EXPECT_TRUE(std::filesystem::exists(dir / "deep/er/file.exr"));
  const std::string other = ErrorOf([&] { WriteImageFile(dir / "deep/er/file.exr/x.exr", image); });
  EXPECT_NE(other.find("directory"), std::string::npos) << other;
  EXPECT_NE(other.find("x.exr"), std::string::npos) << other;
  // Overwriting replaces; writing twice gives the same bytes.
  WriteImageFile(dir / "a.exr", image);
  WriteImageFile(dir / "b.exr", image);
  EXPECT_EQ(FileText(dir / "a.exr"), FileText(dir / "b.exr"));
  WriteImageFile(dir / "a.exr", image);
  EXPECT_EQ(FileText(dir / "a.exr"), FileText(dir / "b.exr"));
}

TEST(ImageFile, HdrTakesWhatItCanHold)
{
  TemporaryDirectory dir;
  const float values[] = { 0, 1e-30f, 0.18f, 65504, 1e30f, 1.6e38f, 1.72e38f, 3.4e38f, -1,
    std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN(), 1 };
  auto image = NewImage({ 0, 0, 12, 1 });
  AddArray(image, "radiance", 3, [&values](int x, int, int) { return values[x]; });
  WriteReport report;
  WriteImageFile(dir / "a.hdr", image, {}, {}, &report);
  EXPECT_EQ(report.Clamped, 3 * 3);
  EXPECT_EQ(report.NonFinite, 2 * 3);
  ASSERT_EQ(report.Warnings.size(), 2u);
  EXPECT_NE(report.Warnings[0].find("outside [0, 1.69e38] were clamped for .hdr"), std::string::npos);
  const auto again = ReadImageFile(dir / "a.hdr");
  auto read = vtkFloatArray::SafeDownCast(again->GetPointData()->GetArray("radiance"));
  for (int x = 0; x < 12; ++x)
  {
    const float wanted = std::isfinite(values[x]) ? std::min(1.69e38f, std::max(0.f, values[x])) : 0;
    EXPECT_NEAR(read->GetComponent(x, 1), wanted, 0.01 * double(wanted)) << values[x];
  }
}

TEST(ImageFile, CancelledAfterSomeRowsLeavesTheOldFile)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 3, 1000 });
  AddArray(image, "radiance", 3, &WildValue);
  WriteOptions writing;
  int asked = 0;
  writing.Cancelled = [&asked] { return ++asked == 3; };
  EXPECT_EQ(ErrorOf([&] { WriteImageFile(dir / "a.exr", image, {}, writing); }), "cancelled");
  EXPECT_EQ(asked, 3);
  EXPECT_EQ(dir.List(), std::vector<std::string>());
  WriteImageFile(dir / "a.exr", image);
  const std::string whole = FileText(dir / "a.exr");
  asked = 0;
  EXPECT_EQ(ErrorOf([&] { WriteImageFile(dir / "a.exr", image, {}, writing); }), "cancelled");
  EXPECT_EQ(FileText(dir / "a.exr"), whole);
  EXPECT_EQ(dir.List(), std::vector<std::string>{ "a.exr" });

  ReadOptions reading;
  asked = 0;
  reading.Cancelled = writing.Cancelled;
  EXPECT_EQ(ErrorOf([&] { ReadImageFile(dir / "a.exr", nullptr, reading); }), "cancelled");
  EXPECT_EQ(asked, 3);
}

TEST(ImageFile, SequenceNames)
{
  EXPECT_EQ(SequencePath("a/b.####.exr", 7), "a/b.0007.exr");
  EXPECT_EQ(SequencePath("a#/b.exr", 7), "a#/b.exr") << "only in the file's name";
  EXPECT_EQ(SequencePath("b.#.exr", 12345), "b.12345.exr");
  EXPECT_EQ(SequencePath("b##.exr", 123), "b123.exr");
  EXPECT_EQ(SequencePath("plain.exr", 3), "plain.exr");
}
