// SPDX-License-Identifier: BSD-3-Clause
#include "IOTestTools.h"

#include <chrono>
#include <sys/resource.h>

using namespace quell;

namespace
{
long PeakKilobytes()
{
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}
void WriteText(const std::string& path, const std::string& text)
{
  std::ofstream(path, std::ios::binary) << text;
}
}

TEST(BadImages, CutOffExrIsAnErrorAtEveryLength)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 64, 64 });
  AddArray(image, "radiance", 3, &WildValue);
  AddArray(image, "depth", 1, &WildValue);
  WriteImageFile(dir / "whole.exr", image);
  const std::string bytes = FileText(dir / "whole.exr");
  ASSERT_GT(bytes.size(), 2000u);
  for (size_t n = 0; n < bytes.size(); n += 1 + bytes.size() / 97)
  {
    WriteText(dir / "cut.exr", bytes.substr(0, n));
    const std::string text = ErrorOf([&] { ReadImageFile(dir / "cut.exr"); });
    EXPECT_NE(text.find("cut.exr"), std::string::npos) << n << ": " << text;
    EXPECT_NE(text.find("; "), std::string::npos) << "no remedy: " << text;
  }
  WriteText(dir / "cut.exr", bytes.substr(0, bytes.size() - 1));
  ErrorOf([&] { ReadImageFile(dir / "cut.exr"); });
}

TEST(BadImages, FlippedBytesNeverCrash)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 16, 16 });
  AddArray(image, "radiance", 3, [](int x, int y, int) { return float(x * y); });
  WriteImageFile(dir / "whole.exr", image);
  const std::string bytes = FileText(dir / "whole.exr");
  const long before = PeakKilobytes();
  int refused = 0;
  for (size_t i = 0; i < bytes.size(); i += 2)
  {
    std::string bad = bytes;
    bad[i] = char(bad[i] ^ (i % 3 == 0 ? 0x80 : i % 3 == 1 ? 0xff : 0x01));
    WriteText(dir / "flip.exr", bad);
    try
    {
      ReadImageFile(dir / "flip.exr");
    }
    catch (const StageError& e)
    {
      ++refused;
      EXPECT_NE(std::string(e.what()).find("flip.exr"), std::string::npos) << e.what();
    }
  }
  EXPECT_GT(refused, 20);
  EXPECT_LT(PeakKilobytes() - before, 2000000) << "a damaged header must not allocate gigabytes";
}

TEST(BadImages, NotAFileNotAnImage)
{
  TemporaryDirectory dir;
  WriteText(dir / "text.exr", "this is no picture");
  WriteText(dir / "empty.exr", "");
  for (const char* name : { "text.exr", "empty.exr", "missing.exr", "" })
  {
    const std::string text = ErrorOf([&] { ReadImageFile(dir / name); });
    EXPECT_NE(text.find(dir / name), std::string::npos) << text;
  }
}

TEST(BadImages, HugeHeadersAreRefusedBeforeAllocating)
{
  TemporaryDirectory dir;
  // A PNM header is text: easy to lie in.
  WriteText(dir / "huge.ppm", "P6\n60000 60000\n255\nabc");
  WriteText(dir / "large.ppm", "P6\n11000 11000\n255\nabc");
  const long before = PeakKilobytes();
  EXPECT_NE(ErrorOf([&] { ReadImageFile(dir / "huge.ppm"); }).find("more than"), std::string::npos);
  EXPECT_NE(ErrorOf([&] { ReadImageFile(dir / "large.ppm"); }).find("the file holds"), std::string::npos);
  EXPECT_LT(PeakKilobytes() - before, 100000);
  auto image = NewImage({ 0, 0, 64, 64 });
  AddArray(image, "radiance", 3, &WildValue);
  WriteImageFile(dir / "ok.exr", image);
  ReadOptions options;
  options.MaximumBytes = 64 * 64 * 12 - 1;
  EXPECT_NE(ErrorOf([&] { ReadImageFile(dir / "ok.exr", nullptr, options); }).find("limit"), std::string::npos);
}

TEST(BadImages, EveryHostileFileIsReadOrRefusedByName)
{
  const std::string dir = std::string(QUELL_SHARED_DATA) + "/image-bad";
  if (!std::filesystem::exists(dir))
    GTEST_SKIP() << dir << " is not here";
  int read = 0, refused = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(dir))
  {
    const std::string path = entry.path().string();
    const std::string name = entry.path().filename().string();
    if (!entry.is_regular_file() || name == "ATTRIBUTION.md" || name == "EXPECTED.tsv" ||
        name.compare(0, 7, "LICENSE") == 0)
      continue;
    SCOPED_TRACE(path);
    const auto start = std::chrono::steady_clock::now();
    try
    {
      ReadReport report;
      auto image = ReadImageFile(path, &report);
      EXPECT_GT(image->GetPointData()->GetNumberOfArrays(), 0);
      ++read;
    }
    catch (const StageError& e)
    {
      ++refused;
      EXPECT_NE(std::string(e.what()).find(path), std::string::npos) << e.what();
    }
    EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), 20.);
  }
  RecordProperty("read", read);
  RecordProperty("refused", refused);
  EXPECT_GT(refused, 60);
  EXPECT_GT(read, 10);
  EXPECT_LT(PeakKilobytes(), 3000000);
}
