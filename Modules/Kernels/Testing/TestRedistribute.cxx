// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellRedistribute.h"

#include <gtest/gtest.h>

#include <cfloat>

using namespace quelltest;

namespace
{
Image Apply(const quell::RedistributeInputs& in, const quell::RedistributeParameters& p, std::int64_t* bad = nullptr)
{
  Image out(in.radiance.extent, 3);
  std::vector<double> scratch(quell::RedistributeScratch(out.extent));
  const std::int64_t n = quell::Redistribute(in, p, out, out.extent, scratch.data());
  if (bad)
    *bad = n;
  return out;
}
double Sum(const Image& image, int channel)
{
  double s = 0;
  for (size_t i = size_t(channel); i < image.data.size(); i += 3)
    s += image.data[i];
  return s;
}
/// A clamped scene: what is beyond 5 lies in the residual, which is signed in places.
struct Clamped
{
  Scene scene;
  Image left, residual;
  Clamped(int w, int h)
    : scene(w, h, 3)
    , left(scene.color)
    , residual(scene.color.extent, 3)
  {
    Random u(8);
    for (size_t i = 0; i < left.data.size(); ++i)
      if (left.data[i] > 5)
      {
        residual.data[i] = left.data[i] - 5;
        left.data[i] = 5;
      }
      else if (u() < .01f)
        residual.data[i] = -.2f;
  }
  quell::RedistributeInputs inputs(bool guides) const
  {
    quell::RedistributeInputs in;
    in.radiance = left, in.residual = residual;
    if (guides)
      in.depth = scene.depth, in.normal = scene.normal, in.id = scene.id;
    return in;
  }
};
}

TEST(Redistribute, TheSumOfTheImageIsThatOfBothInputs)
{
  const Clamped c(67, 53);
  quell::RedistributeParameters p;
  for (const bool guides : { false, true })
    for (const int radius : { 0, 1, 8, 32 })
      for (const double threshold : { 1e-3, 5., 1e30 })
      {
        p.radius = radius, p.threshold = threshold;
        const Image out = Apply(c.inputs(guides), p);
        for (int k = 0; k < 3; ++k)
        {
          const double before = Sum(c.left, k) + Sum(c.residual, k);
          EXPECT_NEAR(Sum(out, k) / before, 1, 2e-7) << guides << radius << threshold;
          EXPECT_GT(Sum(c.residual, k), .05 * before);
        }
      }
}

TEST(Redistribute, OneSourceIsAGaussianCutAtTheBorder)
{
  const quell::Rect e{ 0, 0, 12, 9 };
  Image left(e, 3), residual(e, 3);
  residual.at(1, 2)[0] = 3, residual.at(1, 2)[1] = 4; // length 5: just not wider
  quell::RedistributeInputs in;
  in.radiance = left, in.residual = residual;
  quell::RedistributeParameters p;
  p.sigma = 1.2;
  const Image out = Apply(in, p);
  double total = 0;
  const int reach = 3; // ceil(2.5 * 1.2)
  const auto w = [&](int x, int y)
  {
    return std::abs(x - 1) > reach || std::abs(y - 2) > reach
             ? 0.
             : std::exp(-((x - 1) * (x - 1) + (y - 2) * (y - 2)) / (2 * 1.2 * 1.2));
  };
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 12; ++x)
      total += w(x, y);
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 12; ++x)
    {
      EXPECT_NEAR(out.at(x, y)[0], 3 * w(x, y) / total, 1e-6);
      EXPECT_NEAR(out.at(x, y)[1], 4 * w(x, y) / total, 1e-6);
      EXPECT_EQ(out.at(x, y)[2], 0);
    }
}

// A window narrower than a pixel is the pixel itself, however narrow.
TEST(Redistribute, NarrowWindowsKeepTheirEnergy)
{
  const quell::Rect e{ 0, 0, 9, 9 };
  Image left(e, 3), residual(e, 3);
  residual.at(4, 4)[1] = 3;
  quell::RedistributeInputs in;
  in.radiance = left, in.residual = residual;
  quell::RedistributeParameters p;
  for (const double sigma : { 0., 1e-300, 1e-20, 1e-17, 1e-16, 1e-5, .07, .08 })
  {
    p.sigma = sigma;
    const Image out = Apply(in, p);
    EXPECT_EQ(out.at(4, 4)[1], 3.f) << sigma;
    EXPECT_LT(out.at(5, 4)[1], 1e-30f) << sigma;
  }
}

TEST(Redistribute, PeaksStayBelowAFourteenthOfTheThreshold)
{
  const quell::Rect e{ 0, 0, 129, 129 };
  Image left(e, 3), residual(e, 3);
  quell::RedistributeInputs in;
  in.radiance = left, in.residual = residual;
  quell::RedistributeParameters p;
  p.radius = 32;
  for (const float energy : { 1.f, 20.f, 100.f, 300.f })
  {
    residual.at(64, 64)[1] = energy;
    const Image out = Apply(in, p);
    const float peak = *std::max_element(out.data.begin(), out.data.end());
    EXPECT_EQ(peak, out.at(64, 64)[1]);
    EXPECT_LE(peak, 5. / 14 * 1.06) << energy; // 1.06: the kernel is cut at 2.5 sigma
    if (energy >= 20)
    {
      EXPECT_GE(peak, 5. / 14 * .98) << energy;
    }
  }
}

TEST(Redistribute, EdgesOfGuidesHold)
{
  const quell::Rect e{ 0, 0, 20, 20 };
  Image left(e, 3), residual(e, 3), id(e, 1), depth(e, 1, 3.f), normal(e, 3);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 20; ++x)
    {
      *id.at(x, y) = x < 10 ? 1.f : 2.f;
      *depth.at(x, y) = y < 10 ? 3.f : 9.f;
      normal.at(x, y)[x + y < 20 ? 0 : 1] = 1;
    }
  *depth.at(0, 0) = Inf;
  residual.fill(8, 8, 100);
  residual.fill(0, 0, 7); // background keeps its own
  quell::RedistributeInputs in;
  in.radiance = left, in.residual = residual, in.id = id, in.depth = depth, in.normal = normal;
  const Image out = Apply(in, quell::RedistributeParameters());
  EXPECT_FLOAT_EQ(out.at(0, 0)[0], 7);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 20; ++x)
      if (x >= 10 || y >= 10)
      {
        EXPECT_LT(out.at(x, y)[0], 1e-20) << x << " " << y;
      }
  EXPECT_NEAR(Sum(out, 0), 107, 1e-4);
}

TEST(Redistribute, NoResidualIsTheIdentityAndExtremesAreContained)
{
  Clamped c(30, 20);
  Image none(c.left.extent, 3);
  auto in = c.inputs(true);
  in.residual = none;
  EXPECT_TRUE(Apply(in, {}) == c.left);
  none.fill(5, 5, NaN);
  none.fill(6, 6, Inf);
  std::int64_t bad = 0;
  EXPECT_TRUE(Apply(in, {}, &bad) == c.left);
  EXPECT_EQ(bad, 2);
  none = Image(c.left.extent, 3, FLT_MAX); // more than a float can hold stays at the largest
  in.residual = none;                      // the old pixels are gone
  for (float v : Apply(in, {}).data)
    EXPECT_TRUE(v == FLT_MAX || (v > 0 && v < FLT_MAX));
  Image left(c.left);
  left.fill(4, 4, NaN);
  none = Image(c.left.extent, 3);
  in.residual = none;
  in.radiance = left;
  const Image out = Apply(in, {}, &bad);
  EXPECT_EQ(bad, 1);
  for (float v : out.data)
    EXPECT_TRUE(std::isfinite(v));
}

TEST(Redistribute, TilesMakeNoDifference)
{
  const Clamped c(61, 47);
  quell::RedistributeParameters p;
  p.radius = 6;
  const auto in = c.inputs(true);
  const Image whole = Apply(in, p);
  Image tiled(whole.extent, 3);
  for (int y = 0; y < 47; y += 9)
    for (int x = 0; x < 61; x += 13)
    {
      const quell::Rect tile{ x, y, std::min(61, x + 13), std::min(47, y + 9) };
      std::vector<double> scratch(quell::RedistributeScratch(tile));
      quell::Redistribute(in, p, tiled, tile, scratch.data());
    }
  EXPECT_TRUE(tiled == whole);
}

TEST(Redistribute, OverTheImageInProportionToLuminance)
{
  const Clamped c(33, 21);
  quell::ImageEnergy energy;
  for (int y = 0; y < 21; ++y)
    energy += quell::SumEnergy(c.left, c.residual, { 0, y, 33, y + 1 });
  Image out(c.left.extent, 3);
  EXPECT_EQ(quell::RedistributeEvenly(c.left, c.residual, energy, out, out.extent), 0);
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(Sum(out, k) / (Sum(c.left, k) + Sum(c.residual, k)), 1, 2e-7);
  const auto share = [&](int x, int y) { return (out.at(x, y)[0] - c.left.at(x, y)[0]); };
  const auto l = [&](int x, int y)
  { return .2126 * c.left.at(x, y)[0] + .7152 * c.left.at(x, y)[1] + .0722 * c.left.at(x, y)[2]; };
  EXPECT_NEAR(share(3, 3) / share(20, 5), l(3, 3) / l(20, 5), 1e-3 * l(3, 3) / l(20, 5));
  // Black: evenly. No residual: the identity.
  Image black(c.left.extent, 3), rest(c.left.extent, 3);
  rest.fill(4, 4, 693);
  energy = quell::SumEnergy(black, rest, out.extent);
  quell::RedistributeEvenly(black, rest, energy, out, out.extent);
  for (float v : out.data)
    EXPECT_FLOAT_EQ(v, 1);
  rest = Image(c.left.extent, 3);
  quell::RedistributeEvenly(c.left, rest, quell::SumEnergy(c.left, rest, out.extent), out, out.extent);
  EXPECT_TRUE(out == c.left);
}
