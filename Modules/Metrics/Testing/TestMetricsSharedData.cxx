// SPDX-License-Identifier: BSD-3-Clause
// Against numbers by other programs, where the shared test data lie beside the checkout.
#include "quellMetrics.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>
#include <vector>

using namespace quell;

namespace
{
const std::string Shared = QUELL_SHARED_DATA;

struct Picture
{
  int w = 0, h = 0;
  std::vector<float> data; // 3 channels
  ImageIn in() const { return { data.data(), 3, { 0, 0, w, h } }; }
  ImageIn channel(int c, std::vector<float>& store) const
  {
    store.resize(std::size_t(w) * h);
    for (std::size_t i = 0; i < store.size(); ++i)
      store[i] = data[3 * i + c];
    return { store.data(), 1, { 0, 0, w, h } };
  }
};

bool Load(const std::string& name, Picture& p)
{
  auto in = OIIO::ImageInput::open(Shared + "/" + name);
  if (!in)
    return false;
  p.w = in->spec().width;
  p.h = in->spec().height;
  const int n = in->spec().nchannels;
  std::vector<float> all(std::size_t(p.w) * p.h * n);
  if (n < 3 || !in->read_image(0, 0, 0, n, OIIO::TypeDesc::FLOAT, all.data()))
    return false;
  p.data.resize(std::size_t(p.w) * p.h * 3);
  for (std::size_t i = 0; i < std::size_t(p.w) * p.h; ++i)
    std::copy_n(&all[i * n], 3, &p.data[3 * i]);
  return true;
}

Picture Linear(Picture p)
{
  for (float& v : p.data)
    v = float(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
  return p;
}

/// Fields of the tab-separated lines of a file that are no comments.
std::vector<std::vector<std::string>> Table(const std::string& name)
{
  std::vector<std::vector<std::string>> rows;
  std::ifstream file(Shared + "/" + name);
  for (std::string line; std::getline(file, line);)
  {
    if (line.empty() || line[0] == '#')
      continue;
    std::vector<std::string> fields;
    std::istringstream text(line);
    for (std::string f; std::getline(text, f, '\t');)
      fields.push_back(f);
    rows.push_back(fields);
  }
  return rows;
}
}

TEST(MetricsSharedData, FlipOfNvidia)
{
  const auto rows = Table("metrics/EXPECTED-flip-nvidia.tsv");
  if (rows.empty())
    GTEST_SKIP() << "no shared data";
  int compared = 0;
  for (const auto& row : rows)
  {
    ASSERT_GE(row.size(), 14u);
    // The large pair takes a minute and tells nothing new.
    if (row[0].find("cornell_64spp") != std::string::npos || row[1].find("spp2.") != std::string::npos ||
        row[1].find("spp8.") != std::string::npos)
      continue;
    Picture reference, test;
    ASSERT_TRUE(Load(row[0], reference)) << row[0];
    ASSERT_TRUE(Load(row[1], test)) << row[1];
    EXPECT_NEAR(ComputeMetric("MSE", test.in(), reference.in()), std::stod(row[11]), 1e-5 * std::stod(row[11]))
      << row[1];
    EXPECT_NEAR(ComputeMetric("relMSE", test.in(), reference.in()), std::stod(row[12]), 1e-5 * std::stod(row[12]))
      << row[1];
    const bool png = row[0].find(".png") != std::string::npos;
    if (png)
    {
      EXPECT_NEAR(ComputeMetric("PSNR-linear", test.in(), reference.in()), std::stod(row[13]), 1e-4) << row[1];
    }
    const double flip = png ? ComputeMetric("FLIP", Linear(test).in(), Linear(reference).in())
                            : ComputeMetric("HDR-FLIP", test.in(), reference.in());
    EXPECT_NEAR(flip, std::stod(row[2]), 1e-4) << row[1];
    ++compared;
  }
  EXPECT_GE(compared, 3);
}

TEST(MetricsSharedData, SsimOfRomigrou)
{
  const auto rows = Table("metrics/EXPECTED-ssim.tsv");
  if (rows.empty())
    GTEST_SKIP() << "no shared data";
  for (const auto& row : rows)
  {
    if (row[1].find("_00.") == std::string::npos && row[1].find("_50.") == std::string::npos &&
        row[1].find("_100.") == std::string::npos)
      continue;
    Picture reference, test;
    ASSERT_TRUE(Load("metrics/" + row[0], reference));
    ASSERT_TRUE(Load("metrics/" + row[1], test));
    for (int c = 0; c < 3; ++c)
    {
      // Their borders repeat the outermost pixels, as our map does.
      std::vector<float> a, b, map(std::size_t(test.w) * test.h);
      ComputeErrorMap(
        "SSIM-linear", test.channel(c, a), reference.channel(c, b), ImageOut(map.data(), 1, { 0, 0, test.w, test.h }));
      double sum = 0;
      for (float v : map)
        sum += 1 - double(v);
      EXPECT_NEAR(sum / double(map.size()), std::stod(row[2 + c]), 3e-5) << row[1] << " " << c;
    }
  }
}
