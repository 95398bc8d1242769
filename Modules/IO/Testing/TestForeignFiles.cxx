// SPDX-License-Identifier: BSD-3-Clause
#include "IOTestTools.h"

using namespace quell;

namespace
{
std::string Shared(const std::string& name)
{
  return std::string(QUELL_SHARED_DATA) + "/" + name;
}
#define NEED(path)                    \
  if (!std::filesystem::exists(path)) \
  GTEST_SKIP() << path << " is not here"
}

TEST(ForeignFiles, BlenderPassesAddUpToTheCombined)
{
  const std::string path = Shared("denoise-cycles-room/noisy.0004.exr");
  NEED(path);
  auto image = ReadImageFile(path);
  double worst = 0;
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 256; ++x)
      for (int c = 0; c < 3; ++c)
      {
        const auto v = [&](const char* name) { return double(Value(image, name, x, y, c)); };
        const double sum = (v("diffuseDirect") + v("diffuseIndirect")) * v("diffuseColor") +
                           (v("glossyDirect") + v("glossyIndirect")) * v("glossyColor") + v("emission");
        worst = std::max(worst, std::fabs(sum - v("combined")) / (std::fabs(v("combined")) + 0.01));
        ASSERT_EQ(Value(image, "radiance", x, y, c), Value(image, "combined", x, y, c));
      }
  EXPECT_LT(worst, 1e-4);
  int infinite = 0;
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 256; ++x)
    {
      const float z = Value(image, "depth", x, y, 0);
      ASSERT_TRUE(std::isinf(z) || (z > 0 && z < 1000));
      infinite += std::isinf(z);
    }
  EXPECT_GT(infinite, 0) << "Blender's 1e10 is our infinity";
  EXPECT_EQ(View(image, "id").components, 1);
  EXPECT_EQ(View(image, "denoisingNormal").components, 3);
}

TEST(ForeignFiles, BlenderColoursAreAlbedos)
{
  const std::string path = Shared("denoise-cycles-room/noisy.0004.exr");
  NEED(path);
  int found = 0;
  for (const FileArray& array : ReadImageHeader(path).Arrays)
    if (array.Name == "diffuseColor" || array.Name == "glossyColor")
    {
      EXPECT_EQ(array.Kind, ArrayKind::Albedo) << array.Name;
      ++found;
    }
  EXPECT_EQ(found, 2);
}

TEST(ForeignFiles, BlenderMotionPointsToThePreviousFrame)
{
  const std::string now = Shared("denoise-cycles-room/noisy.0004.exr"),
                    before = Shared("denoise-cycles-room/noisy.0003.exr");
  NEED(now);
  auto image = ReadImageFile(now), previous = ReadImageFile(before);
  // Where the point was: with the right sign the previous frame shows the same world position there. The error of every
  // other choice of signs must be larger; the scene moves 7 pixels in x and a fifth of one in y.
  std::map<std::pair<int, int>, double> error;
  for (const int sx : { -1, 1 })
    for (const int sy : { -1, 1 })
    {
      double sum = 0;
      int n = 0;
      for (int y = 0; y < 256; ++y)
        for (int x = 0; x < 256; ++x)
        {
          const int px = int(std::lround(x + sx * Value(image, "motion", x, y, 0)));
          const int py = int(std::lround(y + sy * Value(image, "motion", x, y, 1)));
          if (px < 0 || py < 0 || px > 255 || py > 255)
            continue;
          double d = 0;
          for (int c = 0; c < 3; ++c)
          {
            const double e = Value(previous, "position", px, py, c) - Value(image, "position", x, y, c);
            d += e * e;
          }
          sum += std::min(0.5, std::sqrt(d));
          ++n;
        }
      error[{ sx, sy }] = sum / n;
    }
  const double right = error[std::make_pair(1, 1)];
  EXPECT_LT(right, 0.012);
  EXPECT_GT(error[std::make_pair(1, -1)], 1.3 * right);
  EXPECT_GT(error[std::make_pair(-1, 1)], 10 * right);
  EXPECT_GT(error[std::make_pair(-1, -1)], 10 * right);
}

TEST(ForeignFiles, PbrtGbufferFilm)
{
  const std::string path = Shared("denoise-pbrt-gbuffer/gbuffer-8spp.exr");
  NEED(path);
  ReadReport report;
  auto image = ReadImageFile(path, &report);
  EXPECT_EQ(report.Facts.SamplesPerPixel, 8);
  ASSERT_TRUE(report.Facts.HasCamera);
  // Positions are in camera space, so camera -> world -> NDC must land on the pixel they came from.
  Mat4 cameraToWorld;
  ASSERT_TRUE(report.Facts.WorldToCamera.Inverse(cameraToWorld));
  int tested = 0;
  for (int y = 3; y < 256; y += 11)
    for (int x = 3; x < 256; x += 11)
    {
      if (!std::isfinite(Value(image, "depth", x, y, 0)))
        continue;
      // Ours looks along -z, pbrt's camera along +z.
      const Vec3d p = cameraToWorld.Point({ Value(image, "position", x, y, 0), Value(image, "position", x, y, 1),
        -double(Value(image, "position", x, y, 2)) });
      const auto& m = report.Facts.WorldToNdc.m;
      const auto row = [&](int i) { return m[i][0] * p.x + m[i][1] * p.y + m[i][2] * p.z + m[i][3]; };
      EXPECT_NEAR((row(0) / row(3) + 1) * 128, x + 0.5, 1.) << x << " " << y;
      EXPECT_NEAR((row(1) / row(3) + 1) * 128, y + 0.5, 1.) << x << " " << y;
      EXPECT_NEAR(row(3), Value(image, "depth", x, y, 0), 1e-4 * row(3));
      ++tested;
    }
  EXPECT_GT(tested, 300);
  for (const char* name : { "albedo", "normal", "normalGeometric", "varianceColor", "dzdx" })
    EXPECT_NO_THROW(View(image, name)) << name;
}

TEST(ForeignFiles, SeparateFilesPerArray)
{
  const std::string path = Shared("denoise-games202-3frames/input/depth_0.exr");
  NEED(path);
  ReadOptions options;
  options.PlainArray = "depth";
  auto image = ReadImageFile(path, nullptr, options);
  EXPECT_EQ(View(image, "depth").components, 1);
}

TEST(ForeignFiles, EveryValidExrReadsOrSaysWhyNot)
{
  const std::string dir = Shared("exr-valid");
  NEED(dir);
  int read = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(dir))
  {
    if (entry.path().extension() != ".exr")
      continue;
    const std::string path = entry.path().string();
    SCOPED_TRACE(path);
    if (path.find("Balls.exr") != std::string::npos)
      EXPECT_NE(ErrorOf([&] { ReadImageFile(path); }).find("deep"), std::string::npos);
    else if (path.find("Rec709_YC") != std::string::npos)
      EXPECT_NE(ErrorOf([&] { ReadImageFile(path); }).find("ubsampled"), std::string::npos);
    else
    {
      ReadReport report;
      EXPECT_NO_THROW(ReadImageFile(path, &report));
      EXPECT_FALSE(report.Arrays.empty());
      ++read;
    }
  }
  EXPECT_GT(read, 25);
}

TEST(ForeignFiles, WindowsOfEveryKind)
{
  const std::string dir = Shared("exr-valid/DisplayWindow");
  NEED(dir);
  // Data and display windows as oiiotool prints them; the data window from the display window's bottom left corner.
  struct
  {
    const char* Name;
    int Width, Height;
    Rect Data;
  } const expected[] = { { "t01", 400, 300, { 0, 0, 400, 300 } }, { "t02", 400, 300, { -1, 1, 399, 301 } },
    { "t03", 370, 280, { -30, 0, 370, 300 } }, { "t04", 370, 280, { 0, -20, 400, 280 } },
    { "t06", 402, 302, { 1, 1, 401, 301 } }, { "t08", 501, 401, { 30, 61, 430, 361 } } };
  for (const auto& e : expected)
  {
    SCOPED_TRACE(e.Name);
    ReadReport r;
    auto image = ReadImageFile(dir + "/" + e.Name + ".exr", &r);
    EXPECT_EQ(r.Width, e.Width);
    EXPECT_EQ(r.Height, e.Height);
    EXPECT_EQ(r.DataWindow, e.Data);
    EXPECT_EQ(image->GetDimensions()[0], e.Width);
  }
}
