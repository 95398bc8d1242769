// SPDX-License-Identifier: BSD-3-Clause
#include "quellSampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <vector>

using namespace quell;
using namespace quell::sampling;

TEST(Sampler, Mix64Golden)
{
  EXPECT_EQ(Mix64(0), 0u);
  EXPECT_EQ(Mix64(1), 0xccde22c1faa4d20full);
  EXPECT_EQ(Mix64(2), 0x99bc45837549a41full);
  EXPECT_EQ(Mix64(3), 0xf0b342aa2aab95d4ull);
}

TEST(Sampler, SobolGolden)
{
  const std::uint32_t d0[] = { 0, 0x80000000, 0x40000000, 0xc0000000, 0x20000000, 0xa0000000, 0x60000000, 0xe0000000 };
  const std::uint32_t d1[] = { 0, 0x80000000, 0xc0000000, 0x40000000, 0xa0000000, 0x20000000, 0x60000000, 0xe0000000 };
  for (std::uint32_t i = 0; i < 8; ++i)
  {
    EXPECT_EQ(Sobol0(i), d0[i]);
    EXPECT_EQ(Sobol1(i), d1[i]);
  }
}

TEST(Sampler, OwenGolden)
{
  const std::uint32_t v[] = { 0, 0x40000000, 0x80000000, 0xc0000000 };
  const std::uint32_t s1[] = { 0xd5a1fe3d, 0x9eb2548c, 0x2d0e2f36, 0x40b55a18 };
  const std::uint32_t sd[] = { 0xa792495e, 0xd2afd17f, 0x6607918a, 0x23ff6d4e };
  const std::uint32_t low[] = { 0xd5a1fe3d, 0xd5a1fe3c, 0xd5a1fe3f, 0xd5a1fe3e };
  for (int i = 0; i < 4; ++i)
  {
    EXPECT_EQ(Owen(v[i], 1), s1[i]);
    EXPECT_EQ(Owen(v[i], 0xdeadbeef), sd[i]);
    EXPECT_EQ(Owen(std::uint32_t(i), 1), low[i]);
  }
  const std::uint32_t points[4][2] = { { 0x2c65899d, 0xec380f31 }, { 0x89d62303, 0x45503510 },
    { 0x747c9826, 0x2b38a279 }, { 0xc9cd31b9, 0x8efc1d5e } };
  for (std::uint32_t i = 0; i < 4; ++i)
  {
    const std::uint32_t k = Owen(i, 0x12345);
    EXPECT_EQ(Owen(Sobol0(k), 0x9e3779b9), points[i][0]);
    EXPECT_EQ(Owen(Sobol1(k), 0x85ebca6b), points[i][1]);
  }
}

TEST(Sampler, PairsAreNets)
{
  // 16 points of any pair put one into every elementary interval of area 1/16
  for (std::uint32_t pair : { 0u, 3u, 6u, 41u })
    for (std::uint32_t first : { 0u, 16u, 4096u })
      for (int k = 0; k <= 4; ++k)
      {
        std::vector<int> count(16);
        for (std::uint32_t i = 0; i < 16; ++i)
        {
          const Vec2f u = PixelSampler(7, 12, 34, first + i).Pair(pair);
          ++count[std::size_t(int(u.x * (1 << k)) * (1 << (4 - k)) + int(u.y * (1 << (4 - k))))];
        }
        for (int c : count)
          EXPECT_EQ(c, 1) << "pair " << pair << " k " << k;
      }
}

TEST(Sampler, HaltonGolden)
{
  const double g[8][2] = { { 0, -.166667 }, { -.25, .166667 }, { .25, -.388889 }, { -.375, -.055556 },
    { .125, .277778 }, { -.125, -.277778 }, { .375, .055556 }, { -.4375, .388889 } };
  for (std::uint32_t i = 0; i < 8; ++i)
  {
    EXPECT_NEAR(HaltonOffset(i + 1).x, g[i][0], 1e-6);
    EXPECT_NEAR(HaltonOffset(i + 1).y, g[i][1], 1e-6);
  }
}

TEST(Sampler, NeighboursSeedsAndFramesAreUncorrelated)
{
  const auto correlation = [](const PixelSampler& a, const PixelSampler& b)
  {
    double sum = 0;
    for (std::uint32_t p = 0; p < 512; ++p)
    {
      const Vec2f u = a.Pair(p), v = b.Pair(p);
      sum += (u.x - .5) * (v.x - .5) + (u.y - .5) * (v.y - .5);
    }
    return sum / 1024 * 12;
  };
  const PixelSampler base(0, 0, 0, 0);
  EXPECT_NEAR(correlation(base, base), 1, 0.15);
  for (const PixelSampler& other : { PixelSampler(0, 1, 0, 0), PixelSampler(0, 0, 1, 0), PixelSampler(1, 0, 0, 0),
         PixelSampler(1, 1, 0, 0), PixelSampler(0, 61, 0, 0) })
    EXPECT_LT(std::fabs(correlation(base, other)), 0.15);
}

TEST(Sampler, UnitFloatStaysBelowOne)
{
  EXPECT_EQ(UnitFloat(0), 0.f);
  EXPECT_LT(UnitFloat(0xffffffffu), 1.f);
}

TEST(Sampler, Pcg32Golden)
{
  Pcg32 random(42, 54);
  for (std::uint32_t v : { 0xa15c02b7u, 0x7b47f409u, 0xba1d3330u, 0x83d2f293u, 0xbfa4784bu, 0xcbed606eu })
    EXPECT_EQ(random.Next(), v);
}

TEST(Sampler, ZSobolIndexGoldenAndBijection)
{
  EXPECT_EQ(Morton(3, 5), 39u);
  EXPECT_EQ(Morton(0xffff, 0), 0x55555555u);
  const std::uint32_t first[] = { 149, 150, 151, 148 }, third[] = { 10976, 10977, 10978, 10979 };
  const std::uint64_t key = std::uint64_t(0x55555555u * 2);
  for (std::uint32_t s = 0; s < 4; ++s)
  {
    EXPECT_EQ(ZSobolIndex(39 << 2 | s, 14, 0), first[s]);
    EXPECT_EQ(ZSobolIndex(39 << 2 | s, 14, key), third[s]);
  }
  for (int bits : { 1, 2, 13, 14 })
    for (std::uint64_t k : { std::uint64_t(0), key, std::uint64_t(0x123456789abcdefull) })
    {
      std::vector<char> seen(std::size_t(1) << bits);
      for (std::uint32_t i = 0; i < seen.size(); ++i)
      {
        const std::uint32_t j = ZSobolIndex(i, bits, k);
        ASSERT_LT(j, seen.size());
        ASSERT_FALSE(seen[j]);
        seen[j] = 1;
        // blocks of 4 (above the single bit) stay together
        ASSERT_EQ(j >> (2 + (bits & 1)), ZSobolIndex(i | 3u << (bits & 1), bits, k) >> (2 + (bits & 1)));
      }
    }
  int used[24] = {};
  for (int p = 0; p < 24; ++p)
  {
    int digits = 0;
    for (int d = 0; d < 4; ++d)
      digits |= 1 << ((Permutations4[p] >> (2 * d)) & 3);
    EXPECT_EQ(digits, 15);
    for (int q = 0; q < p; ++q)
      used[p] += Permutations4[p] == Permutations4[q];
    EXPECT_EQ(used[p], 0);
  }
}

namespace
{
constexpr SamplePattern Patterns[] = { SamplePattern::Sobol, SamplePattern::BlueNoise, SamplePattern::Random };
constexpr const char* Names[] = { "Sobol", "BlueNoise", "Random" };

/// One of every elementary interval of area 1 / n (n a power of two) for each shape.
void ExpectNet(const std::vector<Vec2f>& points, const char* what)
{
  int log2 = 0;
  while ((std::size_t(1) << log2) < points.size())
    ++log2;
  for (int k = 0; k <= log2; ++k)
  {
    std::vector<int> count(points.size());
    for (const Vec2f& u : points)
      ++count[(std::size_t(u.x * float(1 << k)) << (log2 - k)) + std::size_t(u.y * float(1 << (log2 - k)))];
    for (int c : count)
      ASSERT_EQ(c, 1) << what << ", " << points.size() << " points, 2^" << k << " columns";
  }
}
}

TEST(Sampler, FirstSamplesOfEveryDecisionAreNets)
{
  for (std::uint32_t pair : { std::uint32_t(PairPixel), std::uint32_t(PairLens), std::uint32_t(PairTime),
         std::uint32_t(PairFirstBounce + PairBsdf), std::uint32_t(PairFirstBounce + 5 * PairsPerBounce + PairLobe) })
    for (int log2 = 0; log2 <= 10; ++log2)
      for (std::uint32_t block : { 0u, 3u })
      {
        const std::uint32_t n = 1u << log2;
        std::vector<Vec2f> points;
        for (std::uint32_t i = 0; i < n; ++i)
          points.push_back(PixelSampler(5, 37, 81, block * n + i).Pair(pair));
        ExpectNet(points, "Sobol");
      }
}

TEST(Sampler, BlueNoiseIsStratifiedInPixelsBlocksAndTime)
{
  const int x = 24, y = 40, tick = 5;
  for (std::uint32_t pair : { 0u, 1u, 6u, 30u })
    for (int spp : { 1, 2, 4, 8, 64 })
    {
      std::vector<Vec2f> pixel, block, time;
      for (int s = 0; s < spp; ++s)
        pixel.push_back(PixelSampler(SamplePattern::BlueNoise, 9, x, y, tick, std::uint32_t(s), spp).Pair(pair));
      ExpectNet(pixel, "the samples of a pixel");
      for (int j = 0; j < 8; ++j)
        for (int i = 0; i < 8; ++i)
          for (int s = 0; s < spp; ++s)
            block.push_back(
              PixelSampler(SamplePattern::BlueNoise, 9, x + i, y + j, tick, std::uint32_t(s), spp).Pair(pair));
      ExpectNet(block, "an aligned block of a frame");
      // one sample per frame: a net over frames, too
      for (int f = 0; f < 16 && spp == 1; ++f)
        for (int s = 0; s < spp; ++s)
          time.push_back(PixelSampler(SamplePattern::BlueNoise, 9, x, y, 16 + f, std::uint32_t(s), spp).Pair(pair));
      if (spp == 1)
        ExpectNet(time, "a pixel over frames");
    }
}

TEST(Sampler, PatternsArePureFunctions)
{
  for (SamplePattern p : Patterns)
    for (int k = 0; k < 50; ++k)
    {
      const int x = k * 37 % 4000, y = k * 91 % 3000, tick = k % 7;
      const PixelSampler a(p, 3, x, y, tick, std::uint32_t(k % 4), 4), b(p, 3, x, y, tick, std::uint32_t(k % 4), 4);
      const Vec2f later = a.Pair(40), first = a.Pair(2);
      EXPECT_EQ(b.Pair(2).x, first.x);
      EXPECT_EQ(b.Pair(40).y, later.y);
      EXPECT_GE(first.x, 0.f);
      EXPECT_LT(first.x, 1.f);
      // the plain constructor is Sobol with frame * samples + sample
      const PixelSampler plain(3, x, y, std::uint32_t(tick * 4 + k % 4));
      EXPECT_EQ(plain.Pair(2).x == first.x, p == SamplePattern::Sobol);
      EXPECT_EQ(plain.RayKey(5), a.RayKey(5));
      // everything counts: seed, pixel, frame, sample
      EXPECT_NE(PixelSampler(p, 4, x, y, tick, std::uint32_t(k % 4), 4).Pair(2).x, first.x);
      EXPECT_NE(PixelSampler(p, 3, x + 1, y, tick, std::uint32_t(k % 4), 4).Pair(2).x, first.x);
      EXPECT_NE(PixelSampler(p, 3, x, y + 1, tick, std::uint32_t(k % 4), 4).Pair(2).x, first.x);
      EXPECT_NE(PixelSampler(p, 3, x + 256, y, tick, std::uint32_t(k % 4), 4).Pair(2).x, first.x);
      EXPECT_NE(PixelSampler(p, 3, x, y, tick + 1, std::uint32_t(k % 4), 4).Pair(2).x, first.x);
      EXPECT_NE(PixelSampler(p, 3, x, y, tick, std::uint32_t(k % 4) ^ 1u, 4).Pair(2).x, first.x);
    }
  // any number of samples, many frames, places far off: still in range
  for (int spp : { 1, 3, 5, 1000, 1 << 16, 1 << 20 })
    for (std::uint32_t s : { 0u, 2u, 70000u, 0xffffffffu })
    {
      const Vec2f u = PixelSampler(SamplePattern::BlueNoise, 1, 1 << 20, -3, -1, s, spp).Pair(7);
      EXPECT_TRUE(u.x >= 0 && u.x < 1 && u.y >= 0 && u.y < 1);
    }
}

TEST(Sampler, DecisionsAreIndependent)
{
  // 16 x 16 cells of (a number of one pair, a number of another) over pixels: chi-squared. Between pixels the points
  // are independent for Sobol and Random; the blue ones of one frame are stratified (the statistic only falls).
  const std::uint32_t pairs[] = { PairPixel, PairLens, PairTime, PairFirstBounce + PairLightPick,
    PairFirstBounce + PairLightPoint, PairFirstBounce + PairBsdf, PairFirstBounce + PairLobe,
    PairFirstBounce + PairsPerBounce + PairLightPick, PairFirstBounce + PairsPerBounce + PairBsdf };
  constexpr int Count = 9, Side = 64, Cells = 16;
  for (int p = 0; p < 3; ++p)
    for (const bool oneFrame : { true, false })
    {
      std::vector<float> value[2 * Count];
      // one frame of many pixels, or many frames of four pixels
      for (int i = 0; i < Side * Side; ++i)
      {
        const PixelSampler r = oneFrame ? PixelSampler(Patterns[p], 2, i % Side, i / Side, 3, 0, 1)
                                        : PixelSampler(Patterns[p], 2, 40 + i % 2, 50 + i / 2 % 2, i / 4, 0, 1);
        for (int k = 0; k < Count; ++k)
        {
          const Vec2f u = r.Pair(pairs[k]);
          value[2 * k].push_back(u.x);
          value[2 * k + 1].push_back(u.y);
        }
      }
      double worst = 0, mean = 0;
      int tests = 0;
      for (int a = 0; a < 2 * Count; ++a)
        for (int b = a / 2 * 2 + 2; b < 2 * Count; ++b, ++tests)
        {
          std::vector<int> count(Cells * Cells);
          for (std::size_t i = 0; i < value[a].size(); ++i)
            ++count[std::size_t(int(value[a][i] * Cells) * Cells + int(value[b][i] * Cells))];
          double chi2 = 0;
          const double expected = double(Side * Side) / (Cells * Cells);
          for (int c : count)
            chi2 += (c - expected) * (c - expected) / expected;
          worst = std::max(worst, chi2);
          mean += chi2 / 144;
        }
      // 255 degrees of freedom, standard deviation 22.6
      EXPECT_EQ(tests, 144);
      EXPECT_LT(mean, 255 + 5 * 22.6 / 12) << Names[p] << (oneFrame ? ", one frame" : ", many frames");
      // The pixels of BlueNoise go through the frames in one order: what one has by chance they all have.
      const bool shared = Patterns[p] == SamplePattern::BlueNoise && !oneFrame;
      EXPECT_LT(worst, shared ? 3 * 255 : 255 + 5 * 22.6) << Names[p] << (oneFrame ? ", one frame" : ", many frames");
    }
}

namespace
{
constexpr int ImageSide = 64;

/// Error of a smooth integrand, exp(y) sin(3 x), over an image.
std::vector<double> ErrorImage(SamplePattern pattern, std::uint64_t seed, int firstFrame, int frames)
{
  const double exact = (std::exp(1.) - 1) * (1 - std::cos(3.)) / 3;
  std::vector<double> e;
  for (int y = 0; y < ImageSide; ++y)
    for (int x = 0; x < ImageSide; ++x)
    {
      double sum = 0;
      for (int f = 0; f < frames; ++f)
      {
        const Vec2f u = PixelSampler(pattern, seed, x, y, firstFrame + f, 0, 1).Pair(PairFirstBounce + PairLightPoint);
        sum += std::exp(double(u.y)) * std::sin(3 * double(u.x));
      }
      e.push_back(sum / frames - exact);
    }
  return e;
}
double RootMeanSquare(const std::vector<double>& e)
{
  double s = 0;
  for (double v : e)
    s += v * v;
  return std::sqrt(s / double(e.size()));
}
/// Gaussian blur of 2 pixels, periodic.
std::vector<double> Blurred(const std::vector<double>& e)
{
  const int n = ImageSide, r = 7;
  double k[2 * r + 1], sum = 0;
  for (int i = -r; i <= r; ++i)
    sum += k[i + r] = std::exp(-i * i / 8.);
  std::vector<double> a(e.size()), b(e.size());
  for (int pass = 0; pass < 2; ++pass)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x)
      {
        double v = 0;
        for (int i = -r; i <= r; ++i)
          v += k[i + r] / sum *
               (pass == 0 ? e[std::size_t(y * n + (x + i + n) % n)] : a[std::size_t((y + i + n) % n * n + x)]);
        (pass == 0 ? a : b)[std::size_t(y * n + x)] = v;
      }
  return b;
}
/// Radially averaged power, by whole frequencies up to 32 per image.
std::vector<double> Spectrum(const std::vector<double>& e)
{
  const int n = ImageSide;
  std::vector<std::complex<double>> rows(e.size());
  std::vector<double> power(n / 2 + 1), count(n / 2 + 1);
  const auto turn = [](int k) { return std::polar(1., -2 * M_PI * (k % ImageSide) / ImageSide); };
  for (int y = 0; y < n; ++y)
    for (int kx = 0; kx < n; ++kx)
      for (int x = 0; x < n; ++x)
        rows[std::size_t(y * n + kx)] += e[std::size_t(y * n + x)] * turn(kx * x);
  for (int ky = -n / 2; ky < n / 2; ++ky)
    for (int kx = -n / 2; kx < n / 2; ++kx)
    {
      const int radius = int(std::lround(std::hypot(kx, ky)));
      if (radius > n / 2)
        continue;
      std::complex<double> s = 0;
      for (int y = 0; y < n; ++y)
        s += rows[std::size_t(y * n + (kx + n) % n)] * turn((ky + n) * y);
      power[std::size_t(radius)] += std::norm(s);
      ++count[std::size_t(radius)];
    }
  for (std::size_t i = 0; i < power.size(); ++i)
    power[i] /= count[i] * n * n;
  return power;
}
}

TEST(Sampler, BlueNoiseLacksLowFrequencies)
{
  const int seeds = 4;
  double low[3] = {}, high[3] = {}, blurred[3] = {}, plain[3] = {};
  for (int p = 0; p < 3; ++p)
    for (int s = 0; s < seeds; ++s)
    {
      const std::vector<double> e = ErrorImage(Patterns[p], std::uint64_t(s), s, 1);
      const std::vector<double> power = Spectrum(e);
      for (std::size_t r = 1; r <= 8; ++r)
        low[p] += power[r] / (8 * seeds);
      for (std::size_t r = 25; r <= 32; ++r)
        high[p] += power[r] / (8 * seeds);
      blurred[p] += RootMeanSquare(Blurred(e)) / seeds;
      plain[p] += RootMeanSquare(e) / seeds;
    }
  for (int p = 0; p < 3; ++p)
    std::printf("%-9s power below 1/8 %.3f, above 3/8 %.3f; error %.3f, blurred %.4f\n", Names[p], low[p], high[p],
      plain[p], blurred[p]);
  EXPECT_LT(low[1], low[0] / 4);
  EXPECT_LT(low[1], low[2] / 4);
  EXPECT_GT(high[1], .9 * high[0]); // what is missing is somewhere else
  EXPECT_NEAR(plain[1], plain[0], .1 * plain[0]);
  EXPECT_LT(blurred[1], blurred[0] / 1.4);
  EXPECT_LT(blurred[1], blurred[2] / 1.4);
}

TEST(Sampler, BlueNoiseIsGoodOverTime)
{
  double error[3];
  for (int p = 0; p < 3; ++p)
    error[p] = RootMeanSquare(ErrorImage(Patterns[p], 1, 7, 32));
  std::printf("error after 32 frames: Sobol %.4f, BlueNoise %.4f, Random %.4f\n", error[0], error[1], error[2]);
  EXPECT_LT(error[1], error[2] / 2.2);
  // frames do not repeat each other: neighbours in time are rather opposed
  const std::vector<double> a = ErrorImage(SamplePattern::BlueNoise, 1, 0, 1);
  double mean = 0;
  for (int f = 1; f < 16; ++f)
  {
    const std::vector<double> b = ErrorImage(SamplePattern::BlueNoise, 1, f, 1);
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
      sum += a[i] * b[i];
    const double c = sum / double(a.size()) / (RootMeanSquare(a) * RootMeanSquare(b));
    EXPECT_TRUE(f > 1 || c < 0) << c;
    mean += c / 15;
  }
  EXPECT_LT(mean, 0);
}
