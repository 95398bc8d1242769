// SPDX-License-Identifier: BSD-3-Clause
// How exact every stage is, for each type in the registry and each way its settings can be switched: the same bits
// however the frame is cut and for any number of threads, the same values (1e-5) for every instruction set of this
// machine, and constant images that stay what they are.
#include "Threads.h"
#include "PortBench.h"
#include "quellSimd.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace
{
struct Setting
{
  std::string Name, Value;
};

/// The defaults, and every switch (enumeration, bool) thrown once; wide filters also once narrow, so that tiles of a
/// small frame do not need all of it.
std::vector<Setting> Variants(const std::string& type)
{
  std::vector<Setting> variants = { {} };
  for (const quell::Property& p : Registry().Describe(type)->Properties)
  {
    if (p.Kind == quell::Property::Type::Bool)
      variants.push_back({ p.Name, p.DefaultText == "0" || p.DefaultText == "false" ? "1" : "0" });
    for (const std::string& e : p.Enumerators)
      if (e != p.DefaultText)
        variants.push_back({ p.Name, e });
    if (p.Name == "Radius" || p.Name == "Iterations" || p.Name == "Scales")
      variants.push_back({ p.Name, "2" });
  }
  return variants;
}

std::string Text(const Setting& s)
{
  return s.Name.empty() ? "defaults" : s.Name + "=" + s.Value;
}

class Exactness : public testing::TestWithParam<std::string>
{
protected:
  void SetUp() override { vtkObject::SetGlobalWarningDisplay(0); }
  void TearDown() override
  {
    quell::ForceSimdTarget(0);
    vtkObject::SetGlobalWarningDisplay(1);
  }
  /// A bench of the parameter's type, or none where this setting alone makes no sense to the stage (it says why).
  std::unique_ptr<Bench> Make(const Setting& s, int w, int h, Content what = Content::Plain)
  {
    auto bench = std::make_unique<Bench>(this->GetParam(), w, h, what);
    std::string error;
    if (!s.Name.empty())
    {
      EXPECT_TRUE(bench->stage->SetPropertyText(s.Name, s.Value, error)) << error;
    }
    if (bench->Run())
      return bench;
    EXPECT_FALSE(bench->stage->GetErrorText().empty());
    EXPECT_FALSE(s.Name.empty()) << "the defaults run: " << bench->stage->GetErrorText();
    return nullptr;
  }
};

/// Filters: what has inputs and makes pixels.
std::vector<std::string> FilterTypes()
{
  std::vector<std::string> types;
  for (const std::string& type : Registry().Types())
  {
    const quell::StageDescription& d = *Registry().Describe(type);
    if (!d.Inputs.empty() && !d.Outputs.empty() && !d.Sink)
      types.push_back(type);
  }
  return types;
}

std::vector<quell::Rect> Cut(int w, int h, int dx, int dy)
{
  std::vector<quell::Rect> tiles;
  for (int y = 0; y < h; y += dy)
    for (int x = 0; x < w; x += dx)
      tiles.push_back({ x, y, std::min(w, x + dx), std::min(h, y + dy) });
  return tiles;
}
}

TEST_P(Exactness, SameBitsHoweverTheFrameIsCut)
{
  const int w = 53, h = 47;
  const std::pair<const char*, std::vector<quell::Rect>> tilings[] = { { "bands of 7 rows", Cut(w, h, w, 7) },
    { "halves", Cut(w, h, 27, h) }, { "odd tiles", Cut(w, h, 23, 19) } };
  for (const Setting& s : Variants(this->GetParam()))
  {
    SCOPED_TRACE(Text(s));
    const auto whole = this->Make(s, w, h);
    if (!whole)
      continue;
    for (const auto& tiling : tilings)
    {
      // A stage keeps nothing from tile to tile: the last one first.
      const auto parts = this->Make(s, w, h);
      ASSERT_TRUE(parts);
      for (auto tile = tiling.second.rbegin(); tile != tiling.second.rend(); ++tile)
      {
        ASSERT_TRUE(parts->Run(*tile)) << parts->stage->GetErrorText();
        std::string where;
        ASSERT_TRUE(SameBits(whole->Read(*tile), parts->Read(*tile), where))
          << where << ", " << tiling.first << ", tile at " << tile->x0 << " " << tile->y0;
      }
    }
  }
}

TEST_P(Exactness, SameBitsForAnyThreadsAndSettings)
{
  const int w = 131, h = 67; // three columns, two rows of tiles
  for (const Setting& s : Variants(this->GetParam()))
  {
    SCOPED_TRACE(Text(s));
    Pixels first;
    for (int threads : { 1, 2, 3, 7 })
    {
      std::unique_ptr<Bench> bench;
      quelltest::WithThreads(threads, [&] { bench = this->Make(s, w, h); });
      if (!bench)
        break;
      const Pixels out = bench->Read({ 0, 0, w, h });
      if (first.empty())
        first = out;
      std::string where;
      ASSERT_TRUE(SameBits(first, out, where)) << where << " with " << threads << " threads";
    }
  }
}

// 1e-5 of the value (and of 1e-3 of the image's largest, for what is a difference of such values), 1e-6 in the mean.
TEST_P(Exactness, EveryInstructionSetAgrees)
{
  const int w = 61, h = 43;
  for (const Setting& s : Variants(this->GetParam()))
  {
    SCOPED_TRACE(Text(s));
    Pixels best;
    for (const quell::SimdTarget& target : quell::SimdTargets())
    {
      quell::ForceSimdTarget(target.Id);
      const auto bench = this->Make(s, w, h);
      if (!bench)
        break;
      const Pixels out = bench->Read({ 0, 0, w, h });
      if (best.empty())
        best = out;
      for (const auto& entry : out)
      {
        const std::vector<float>&a = best[entry.first], &b = entry.second;
        ASSERT_EQ(a.size(), b.size()) << entry.first;
        double largest = 0, worst = 0, smape = 0;
        for (float v : a)
          largest = std::max(largest, std::isfinite(v) ? std::fabs(double(v)) : 0.);
        // The second float of a mean: where one code rounds the first one up and another down, it is the opposite.
        const bool rest = entry.first == "meanRest";
        for (size_t i = 0; rest && i < a.size(); ++i)
          largest = std::max(largest, 1e3 * std::fabs(best["moments"][2 * i]));
        for (size_t i = 0; i < a.size(); ++i)
        {
          if (std::memcmp(&a[i], &b[i], sizeof(float)) == 0)
            continue;
          const double e = std::fabs(double(a[i]) - b[i]), m = std::fabs(double(a[i])) + std::fabs(double(b[i]));
          ASSERT_TRUE(e >= 0) << entry.first << " " << target.Name << ": only one is a number";
          worst = std::max(worst, e / (0.5 * m + 1e-3 * largest));
          smape += 2 * e / (m + 1e-3 * largest) / double(a.size());
        }
        EXPECT_LE(worst, 1e-5) << entry.first << " " << target.Name;
        EXPECT_LE(smape, 1e-6) << entry.first << " " << target.Name;
      }
    }
  }
}

// What is declared to be a mean, or a part, of an input that is the same in every pixel stays so to the last bit,
// whatever the guides do.
TEST_P(Exactness, ConstantsAreFixedPoints)
{
  const int w = 49, h = 41;
  int checked = 0;
  for (const Setting& s : Variants(this->GetParam()))
  {
    SCOPED_TRACE(Text(s));
    for (const quell::SimdTarget& target : quell::SimdTargets())
    {
      quell::ForceSimdTarget(target.Id);
      PortBench bench(this->GetParam(), w, h);
      std::string error;
      if (!s.Name.empty())
      {
        ASSERT_TRUE(bench.Stage->SetPropertyText(s.Name, s.Value, error)) << error;
        if (!bench.Run())
          continue; // this setting wants others with it: it says so, see above
      }
      EXPECT_EQ(bench.ChangedConstants(checked), "") << target.Name;
    }
  }
  if (checked == 0)
    GTEST_SKIP() << "declares no mean and no part";
}

INSTANTIATE_TEST_SUITE_P(Filters, Exactness, testing::ValuesIn(FilterTypes()),
  [](const testing::TestParamInfo<std::string>& type) { return type.param; });
