// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellSampleFilter.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
/// `count` scenes as the samples of one image.
struct Samples
{
  std::vector<Scene> scenes;
  std::vector<quell::ImageIn> radiance, depth, normal, albedo, id;
  Samples(int count, int w, int h, bool same = false)
  {
    for (int s = 0; s < count; ++s)
      scenes.emplace_back(w, h, same ? 1u : std::uint32_t(s + 1));
    this->Refresh();
  }
  void Refresh()
  {
    radiance.clear(), depth.clear(), normal.clear(), albedo.clear(), id.clear();
    for (const Scene& s : scenes)
    {
      radiance.push_back(s.color), depth.push_back(s.depth), normal.push_back(s.normal), albedo.push_back(s.albedo);
      id.push_back(s.id);
    }
  }
  quell::SampleFilterInputs inputs(bool guides = true) const
  {
    quell::SampleFilterInputs in;
    in.count = int(scenes.size());
    in.radiance = radiance.data();
    if (guides)
      in.depth = depth.data(), in.normal = normal.data(), in.albedo = albedo.data(), in.id = id.data();
    return in;
  }
};

Image Apply(const quell::SampleFilterInputs& in, const quell::SampleFilterParameters& p, std::int64_t* bad = nullptr)
{
  Image out(in.radiance[0].extent, 3);
  std::vector<float> scratch(quell::SampleFilterScratch(in, p, out.extent), NaN);
  const std::int64_t n = quell::SampleFilter(in, p, out, out.extent, scratch.data());
  if (bad)
    *bad = n;
  return out;
}
using quell::SamplePairs;
}

TEST(SampleFilter, AgreesWithTheFormula)
{
  Samples samples(3, 26, 22);
  samples.scenes[1].color.fill(4, 5, NaN);
  samples.scenes[2].normal.at(9, 9)[0] = NaN;
  samples.scenes[0].id.fill(6, 6, 2); // another object in one of three samples
  *samples.scenes[0].depth.at(6, 6) = 9;
  *samples.scenes[1].depth.at(20, 20) = 5; // one sample hits where the others see the background
  samples.Refresh();
  for (const auto pairs : { SamplePairs::Same, SamplePairs::All })
    for (const bool demodulate : { false, true })
      for (const bool guides : { false, true })
      {
        quell::SampleFilterParameters p;
        p.radius = 4, p.sigmaSpatial = 1.7, p.pairs = pairs, p.demodulate = demodulate;
        const auto in = samples.inputs(guides);
        Image expected(samples.scenes[0].color.extent, 3);
        quell::SampleFilterScalar(in, p, expected, expected.extent);
        ForEachTarget(
          [&](const char* target)
          {
            std::int64_t bad = 0;
            const Difference d = Compare(Apply(in, p, &bad).data, expected.data, 1e-2);
            EXPECT_LT(d.relative, 1e-5) << target << int(pairs) << demodulate << guides;
            EXPECT_LT(d.smape, 1e-6) << target;
            EXPECT_EQ(bad, 1);
          });
      }
}

TEST(SampleFilter, OneSampleIsThePixelFilterWhateverThePairs)
{
  const Samples samples(1, 30, 24);
  quell::SampleFilterParameters p;
  p.pairs = SamplePairs::Same;
  const Image same = Apply(samples.inputs(), p);
  p.pairs = SamplePairs::All;
  EXPECT_TRUE(Apply(samples.inputs(), p) == same);
  EXPECT_FALSE(same == samples.scenes[0].color);
  // Copies of one sample change nothing but rounding.
  const Samples copies(4, 30, 24, true);
  for (const auto pairs : { SamplePairs::Same, SamplePairs::All })
  {
    p.pairs = pairs;
    EXPECT_LT(Compare(Apply(copies.inputs(), p).data, same.data, 1e-6).relative, 1e-5);
  }
  // Radius or sigma 0, one pair: the mean of the samples.
  const Samples three(3, 30, 24);
  p.pairs = SamplePairs::Same;
  p.radius = 0;
  const Image mean = Apply(three.inputs(), p);
  for (size_t i = 0; i < mean.data.size(); ++i)
    ASSERT_NEAR(mean.data[i],
      (three.scenes[0].color.data[i] + double(three.scenes[1].color.data[i]) + three.scenes[2].color.data[i]) / 3,
      1e-6 * mean.data[i]);
}

// A column of pixels that each see a dark wall in three of four samples and a bright one in the fourth. From means per
// pixel nothing tells the surfaces apart; from samples each is averaged with its own kind, and the parts stay.
TEST(SampleFilter, MixedPixelsKeepTheirParts)
{
  const quell::Rect e{ 0, 0, 21, 21 };
  const int n = 4;
  std::vector<Image> color(n, Image(e, 3)), depth(n, Image(e, 1)), normal(n, Image(e, 3));
  Image meanColor(e, 3), meanDepth(e, 1), meanNormal(e, 3), truth(e, 3);
  Random u(31);
  for (int y = 0; y < 21; ++y)
    for (int x = 0; x < 21; ++x)
    {
      for (int s = 0; s < n; ++s)
      {
        const bool right = x > 10 || (x == 10 && s == 3);
        const float noise = .5f + u();
        color[s].fill(x, y, (right ? 10.f : 1.f) * noise);
        *depth[s].at(x, y) = right ? 2.f : 5.f;
        normal[s].at(x, y)[right ? 0 : 2] = 1;
        for (int k = 0; k < 3; ++k)
        {
          meanColor.at(x, y)[k] += color[s].at(x, y)[k] / n;
          meanNormal.at(x, y)[k] += normal[s].at(x, y)[k] / n;
          truth.at(x, y)[k] += (right ? 10.f : 1.f) / n;
        }
        *meanDepth.at(x, y) += *depth[s].at(x, y) / n;
      }
    }
  const auto views = [](const std::vector<Image>& images)
  { return std::vector<quell::ImageIn>(images.begin(), images.end()); };
  const auto c = views(color), z = views(depth), nn = views(normal);
  quell::SampleFilterInputs in;
  in.count = n, in.radiance = c.data(), in.depth = z.data(), in.normal = nn.data();
  quell::SampleFilterParameters p;
  p.radius = 5, p.sigmaSpatial = 3;
  const auto error = [&](const Image& image)
  {
    double sum = 0;
    for (int y = 0; y < 21; ++y)
      sum += std::pow((image.at(10, y)[0] - truth.at(10, y)[0]) / truth.at(10, y)[0], 2) / 21;
    return std::sqrt(sum);
  };
  double sampled[2];
  for (const auto pairs : { SamplePairs::Same, SamplePairs::All })
  {
    p.pairs = pairs;
    sampled[int(pairs)] = error(Apply(in, p));
  }
  const quell::ImageIn mc = meanColor, mz = meanDepth, mn = meanNormal;
  quell::SampleFilterInputs pixels;
  pixels.count = 1, pixels.radiance = &mc, pixels.depth = &mz, pixels.normal = &mn;
  const double filtered = error(Apply(pixels, p)), unfiltered = error(meanColor);
  EXPECT_LT(sampled[0], .6 * filtered); // the pixel finds its like in its column only
  EXPECT_LT(sampled[1], .6 * filtered);
  EXPECT_LT(filtered, unfiltered);
}

TEST(SampleFilter, ConstantsAndExtremes)
{
  for (const float v : { 0.f, 1e-42f, .3f, 1e30f })
    for (const auto pairs : { SamplePairs::Same, SamplePairs::All })
    {
      Samples samples(2, 12, 9);
      for (Scene& s : samples.scenes)
        s.color = Image(s.color.extent, 3, v);
      samples.Refresh();
      quell::SampleFilterParameters p;
      p.pairs = pairs;
      EXPECT_TRUE(Apply(samples.inputs(), p) == samples.scenes[0].color) << v;
    }
  Samples samples(3, 12, 9);
  for (Scene& s : samples.scenes)
    s.color = Image(s.color.extent, 3, FLT_MAX);
  samples.scenes[1].color = Image(samples.scenes[1].color.extent, 3, NaN);
  samples.Refresh();
  quell::SampleFilterParameters p;
  for (p.demodulate = false;; p.demodulate = true)
  {
    std::int64_t bad = 0;
    for (float v : Apply(samples.inputs(), p, &bad).data)
      ASSERT_TRUE(std::isfinite(v) && v > 0);
    EXPECT_EQ(bad, 108);
    if (p.demodulate)
      break;
  }
}

TEST(SampleFilter, TilesMakeNoDifference)
{
  const Samples samples(3, 61, 47);
  quell::SampleFilterParameters p;
  p.demodulate = true;
  const auto in = samples.inputs();
  const Image whole = Apply(in, p);
  Image tiled(whole.extent, 3);
  for (int y = 0; y < 47; y += 9)
    for (int x = 0; x < 61; x += 13)
    {
      const quell::Rect tile{ x, y, std::min(61, x + 13), std::min(47, y + 9) };
      std::vector<float> scratch(quell::SampleFilterScratch(in, p, tile), NaN);
      quell::SampleFilter(in, p, tiled, tile, scratch.data());
    }
  EXPECT_TRUE(tiled == whole);
}
