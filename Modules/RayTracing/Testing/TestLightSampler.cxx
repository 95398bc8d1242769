// SPDX-License-Identifier: BSD-3-Clause
#include "quellLightSampler.h"
#include "quellSampler.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <limits>
#include <random>

using namespace quell;

namespace
{
constexpr float NaN = std::numeric_limits<float>::quiet_NaN();
constexpr float Infinity = std::numeric_limits<float>::infinity();

/// Repeatable numbers with 24 bits, as the path tracer's.
struct Numbers
{
  std::mt19937 Twister;
  explicit Numbers(unsigned seed)
    : Twister(seed)
  {
  }
  float operator()() { return float(this->Twister() >> 8) * 0x1p-24f; }
  float operator()(float lo, float hi) { return lo + (hi - lo) * (*this)(); }
  Vec3f Point(float half) { return { (*this)(-half, half), (*this)(-half, half), (*this)(-half, half) }; }
  Vec3f Direction()
  {
    for (;;)
    {
      const Vec3f d = this->Point(1);
      const float l = Length(d);
      if (l <= 1 && l > .01f)
        return d / l;
    }
  }
};

LightTriangle Triangle(const Vec3f& a, const Vec3f& b, const Vec3f& c, float emission, bool twoSided = false)
{
  LightTriangle t;
  t.V0 = a;
  t.E1 = b - a;
  t.E2 = c - a;
  t.N = Normalized(Cross(t.E1, t.E2));
  t.Emission = Vec3f(emission);
  t.TwoSided = twoSided;
  return t;
}
PlacedLight Point(const Vec3f& p, float intensity, float range = 0)
{
  PlacedLight l;
  l.Position = p;
  l.Direction = Vec3f(0, 0, -1);
  l.Intensity = Vec3f(intensity);
  l.Range = range;
  return l;
}
PlacedLight Spot(const Vec3f& p, const Vec3f& d, float intensity, float inner, float outer)
{
  PlacedLight l = Point(p, intensity);
  l.Type = LightType::Spot;
  l.Direction = d;
  l.CosInner = std::cos(inner);
  l.CosOuter = std::cos(outer);
  return l;
}
PlacedLight Sun(const Vec3f& d, float irradiance)
{
  PlacedLight l = Point({}, irradiance);
  l.Type = LightType::Directional;
  l.Direction = d;
  return l;
}

struct Lamps
{
  std::vector<LightTriangle> Triangles;
  std::vector<PlacedLight> Punctual;
  quell::Scene Scene;

  LightSampler Make(LightSelection how, float radius = 1) const
  {
    std::vector<Vec3f> average;
    for (const LightTriangle& t : this->Triangles)
      average.push_back(t.Emission);
    LightSampler s;
    s.SetSelection(how);
    s.Build(this->Triangles, average, this->Punctual, this->Scene, radius);
    return s;
  }
  void Sky(float radiance)
  {
    this->Scene.Sky.Present = true;
    this->Scene.Sky.Color = Vec3f(radiance);
  }
  Texture& SkyImage(int w, int h, float value)
  {
    this->Sky(1);
    Texture t;
    t.Width = w;
    t.Height = h;
    t.Floats.assign(4 * std::size_t(w) * std::size_t(h), value);
    this->Scene.Textures.assign(1, t);
    this->Scene.Sky.Texture = 0;
    return this->Scene.Textures[0];
  }
};

/// `n` small triangles with power over two decades, all over a cube with sides of 2; a few of them two-sided.
Lamps Cloud(int n, unsigned seed, const Vec3f& at = {})
{
  Numbers u(seed);
  Lamps lamps;
  const float size = .3f / std::cbrt(float(n));
  for (int i = 0; i < n; ++i)
  {
    const Vec3f a = at + u.Point(1);
    lamps.Triangles.push_back(Triangle(a, a + u.Point(size), a + u.Point(size), std::exp(4 * u() - 2), u() < .2f));
  }
  return lamps;
}
/// Chance of light `i` at a place, among those at a place.
double LocalChance(const LightSampler& s, const Receiver& at, std::size_t i)
{
  const double tree = s.UsesTree() ? double(s.GetTree().Chance(at, std::uint32_t(i))) : 0;
  if (i < s.GetTriangles().size())
  {
    const LightTriangle& t = s.GetTriangles()[i];
    const double area = Length(Cross(Vec3d(t.E1), Vec3d(t.E2))) / 2;
    return (t.PdfArea + t.TreeArea * tree) * area;
  }
  const PlacedLight& l = s.GetPunctual()[i - s.GetTriangles().size()];
  return l.Pick + l.TreePick * tree;
}

/// Upper bound of a chi-squared number of `cells` - 1 degrees of freedom, for a family of `tests` at 1 % (Sidak), by
/// the cube-root approximation of Wilson and Hilferty.
double ChiLimit(int cells, int tests)
{
  // the normal quantile by bisection
  const double alpha = 1 - std::pow(.99, 1. / tests);
  double lo = 0, hi = 10;
  for (int i = 0; i < 60; ++i)
    (std::erfc((lo + hi) / 2 / std::sqrt(2.)) / 2 > alpha ? lo : hi) = (lo + hi) / 2;
  const double k = cells - 1, c = 1 - 2 / (9 * k) + lo * std::sqrt(2 / (9 * k));
  return k * c * c * c;
}
/// Chi-squared of counts against expectations; what is expected less than 8 times is one cell together.
void ExpectCounts(const std::vector<double>& counted, const std::vector<double>& expected, int tests, const char* what)
{
  double chi2 = 0, rare = 0, rarely = 0;
  int cells = 0;
  for (std::size_t i = 0; i < expected.size(); ++i)
    if (expected[i] >= 8)
    {
      chi2 += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
      ++cells;
    }
    else
    {
      rare += counted[i];
      rarely += expected[i];
    }
  if (rarely >= 8)
  {
    chi2 += (rare - rarely) * (rare - rarely) / rarely;
    ++cells;
  }
  else
    EXPECT_LT(rare, 40) << what;
  ASSERT_GT(cells, 1) << what;
  EXPECT_LT(chi2, ChiLimit(cells, tests)) << what << ", " << cells << " cells";
}
double Seconds(std::chrono::steady_clock::time_point since)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}
}

TEST(LightTree, ConeMeasureGolden)
{
  EXPECT_NEAR(LightConeMeasure(0, Pi / 2.), Pi, 1e-6);
  EXPECT_NEAR(LightConeMeasure(Pi / 4., Pi / 2.), 7.5511759, 1e-6);
  EXPECT_NEAR(LightConeMeasure(Pi, Pi / 2.), 4 * Pi, 1e-5);
}

TEST(LightTree, ChancesSumToOne)
{
  for (int n : { 1, 2, 3, 4, 5, 6, 17, 300, 5000 })
  {
    Lamps lamps = Cloud(n, unsigned(n));
    if (n == 300)
      for (int i = 0; i < 40; ++i)
        lamps.Punctual.push_back(i % 2 ? Point(lamps.Triangles[std::size_t(i)].V0, .1f, i % 4 == 1 ? .5f : 0.f)
                                       : Spot(lamps.Triangles[std::size_t(i)].V0, Vec3f(0, 0, 1), .2f, .1f, .6f));
    const LightSampler s = lamps.Make(LightSelection::Tree);
    ASSERT_TRUE(s.UsesTree());
    Numbers u(5);
    int lit = 0;
    for (int k = 0; k < 40; ++k)
    {
      Receiver at{ u.Point(k < 20 ? 1.f : 10.f), u.Direction(), k % 3 == 0 };
      if (k % 7 == 0)
        at.Normal = Vec3f();
      double sum = 0;
      for (std::size_t i = 0; i < lamps.Triangles.size() + lamps.Punctual.size(); ++i)
        sum += double(s.GetTree().Chance(at, std::uint32_t(i)));
      if (sum == 0) // nothing in sight: a single lamp from behind
        continue;
      ++lit;
      EXPECT_NEAR(sum, 1, 1e-4) << n << " lights, point " << k;
    }
    EXPECT_GT(lit, 8);
  }
}

TEST(LightTree, NoLightInSightHasNoChance)
{
  // wherever a lamp of its own would send light, the tree of many gives it a chance: the bounds are bounds
  const Lamps lamps = Cloud(400, 9);
  const LightSampler s = lamps.Make(LightSelection::Tree);
  Numbers u(6);
  int seen = 0;
  for (int k = 0; k < 200; ++k)
  {
    const Receiver at{ u.Point(1.5f), u.Direction(), false };
    for (std::size_t i = 0; i < lamps.Triangles.size(); ++i)
    {
      const LightTriangle& t = lamps.Triangles[i];
      const Vec3f d = t.V0 + (t.E1 + t.E2) * (1 / 3.f) - at.Position;
      const float l = Length(d), emitted = -Dot(t.N, d) / l, received = Dot(at.Normal, d) / l;
      if (received > .01f && (t.TwoSided ? std::fabs(emitted) : emitted) > .01f)
      {
        ++seen;
        ASSERT_GT(s.GetTree().Chance(at, std::uint32_t(i)), 0.f) << "point " << k << " light " << i;
      }
    }
  }
  EXPECT_GT(seen, 10000);
}

TEST(LightTree, PicksFollowTheChancesBitForBit)
{
  const int n = 300;
  const Lamps lamps = Cloud(n, 3);
  const LightSampler s = lamps.Make(LightSelection::Tree);
  Numbers u(8);
  const int points = 4, draws = 250000;
  for (int k = 0; k < points; ++k)
  {
    const Receiver at{ u.Point(1), u.Direction(), k == 3 };
    std::vector<double> counted(n), expected(n);
    std::vector<float> chances(n);
    for (int i = 0; i < n; ++i)
      expected[std::size_t(i)] = double(chances[std::size_t(i)] = s.GetTree().Chance(at, std::uint32_t(i))) * draws;
    for (int i = 0; i < draws; ++i)
    {
      std::uint32_t light;
      float chance;
      ASSERT_TRUE(s.GetTree().Pick(at, double(u()), light, chance));
      ASSERT_EQ(chance, chances[light]);
      ++counted[light];
    }
    ExpectCounts(counted, expected, points, "picks of the tree");
  }
}

TEST(LightTree, DepthIsBoundedAndLightsInOnePlaceAreSplit)
{
  // positions in a geometric row make the most lopsided tree that splits by position can give
  std::vector<LightBounds> bounds;
  for (int i = 0; i < 60; ++i)
  {
    LightBounds b;
    b.Lower = b.Upper = Vec3f(std::ldexp(1.f, i - 30), 0, 0);
    b.CosSpread = -1;
    b.Intensity = b.Power = 1;
    bounds.push_back(b);
  }
  for (int i = 0; i < 1000; ++i)
    bounds.push_back(bounds[40]);
  LightTree tree;
  tree.Build(bounds);
  EXPECT_LE(tree.Depth(), 32);
  double sum = 0;
  const Receiver at{ Vec3f(1, 1, 0), Vec3f(), false };
  for (std::uint32_t i = 0; i < bounds.size(); ++i)
    sum += double(tree.Chance(at, i));
  EXPECT_NEAR(sum, 1, 1e-4);
  EXPECT_NEAR(tree.Chance(at, 300) / tree.Chance(at, 40), 1, 1e-5);
  EXPECT_GT(tree.Chance(at, 300), 0.f);
  EXPECT_EQ(tree.Chance(at, std::uint32_t(bounds.size())), 0.f); // no such light
}

TEST(LightSampler, DirectionsAndPicksMatchTheDensity)
{
  // near triangles, a point light, a spot light, a sun and a sky, by power and by the tree
  Lamps lamps;
  lamps.Triangles.push_back(Triangle({ -1, 1, -1 }, { 1, 1, -1 }, { -1, 1, 1 }, 2));
  lamps.Triangles.push_back(Triangle({ .5f, .2f, 0 }, { .5f, .2f, .5f }, { .5f, .9f, 0 }, 3, true));
  lamps.Triangles.push_back(Triangle({ 4, 4, 0 }, { 4, 5, 0 }, { 4, 4, 1 }, 10, true));
  lamps.Punctual.push_back(Sun(Vec3f(0, -1, 0), 1));
  lamps.Punctual.push_back(Point({ 1, 2, 3 }, 2));
  lamps.Punctual.push_back(Spot({ 0, 3, 0 }, Vec3f(0, -1, 0), 5, .2f, .5f));
  lamps.Sky(.5f);
  const Receiver at{ Vec3f(.1f, 0, .05f), Vec3f(0, 1, 0), false };
  for (LightSelection how : { LightSelection::Power, LightSelection::Tree })
  {
    const LightSampler s = lamps.Make(how, 5);
    const int n = 24, draws = 400000, sub = 16;
    // cells: triangles by their barycentrics' quarter, then the punctual ones, then the sky's octants
    (void)n;
    std::vector<double> expected, counted;
    const auto cell = [](const LightTriangle&, float b0, float b1) {
      return b0 + b1 < .5f ? 0 : b0 > .5f ? 1 : b1 > .5f ? 2 : 3;
    };
    for (std::size_t t = 0; t < 3; ++t)
    {
      // expectation by quadrature of the density over the triangle: pdf cos / d^2 per area
      const LightTriangle& l = s.GetTriangles()[t];
      const float area = Length(Cross(l.E1, l.E2)) / 2;
      double part[4] = {};
      for (int a = 0; a < sub; ++a)
        for (int b = 0; b < sub - a; ++b)
          for (int half = 0; half < (b < sub - a - 1 ? 2 : 1); ++half)
          {
            const float b0 = (float(a) + (half ? 2.f : 1.f) / 3) / sub, b1 = (float(b) + (half ? 2.f : 1.f) / 3) / sub;
            const Vec3f d = l.V0 + l.E1 * b0 + l.E2 * b1 - at.Position;
            const float d2 = Dot(d, d), c = -Dot(l.N, d) / std::sqrt(d2);
            const float cosine = l.TwoSided ? std::fabs(c) : std::max(0.f, c);
            if (cosine > 1e-6f)
              part[cell(l, b0, b1)] +=
                double(s.TrianglePdf(std::uint32_t(t), at, d2, cosine) * cosine / d2 * area / (sub * sub));
          }
      for (double p : part)
        expected.push_back(p * draws);
    }
    for (std::size_t i = 0; i < 2; ++i)
      expected.push_back(LocalChance(s, at, 3 + i) * draws);
    expected.push_back(double(s.GetPunctual()[2].Pick) * draws);
    // of the sky what is above the receiver, as of all the others
    for (int o = 0; o < 8; ++o)
      expected.push_back(o & 2 ? double(s.SkyShare()) / 8 * draws : 0);
    double sum = double(s.SkyShare()) / 2;
    for (double e : expected)
      sum += e / draws;
    EXPECT_NEAR(sum, 1, 2e-3);
    counted.assign(expected.size(), 0);
    Numbers u(4);
    for (int i = 0; i < draws; ++i)
    {
      LightSampler::Sample d;
      if (!s.Draw(at, u(), u(), u(), d))
        continue;
      ASSERT_NEAR(Length(d.Wi), 1, 1e-5);
      std::size_t c;
      if (d.Kind == LightSampler::Sample::From::Triangle)
      {
        std::size_t t = 0;
        while (s.GetTriangles()[t].V0 != (d.Target - s.GetTriangles()[t].E1 * d.U - s.GetTriangles()[t].E2 * d.V) &&
               Length(s.GetTriangles()[t].V0 -
                      (d.Target - s.GetTriangles()[t].E1 * d.U - s.GetTriangles()[t].E2 * d.V)) > 1e-4f)
          ++t;
        ASSERT_LT(t, 3u);
        const LightTriangle& l = s.GetTriangles()[t];
        const Vec3f to = l.V0 + l.E1 * d.U + l.E2 * d.V - at.Position;
        const float d2 = Dot(to, to);
        // the same function as for hits, to the last bit
        const float cosine = std::fabs(Dot(l.N, to * (1 / std::sqrt(d2))));
        ASSERT_EQ(d.Pdf, s.TrianglePdf(std::uint32_t(t), at, d2, cosine));
        c = 4 * t + std::size_t(cell(l, d.U, d.V));
      }
      else if (d.Kind == LightSampler::Sample::From::Punctual)
        c = d.AtInfinity ? 14 : d.Target == Vec3f(1, 2, 3) ? 12 : 13;
      else
      {
        ASSERT_EQ(d.Pdf, s.SkyPdf(d.Wi));
        if (d.Wi.y <= 0) // within the margin
          continue;
        c = 15 + std::size_t((d.Wi.x > 0) + 2 * (d.Wi.y > 0) + 4 * (d.Wi.z > 0));
      }
      ++counted[c];
    }
    ExpectCounts(counted, expected, 2, how == LightSelection::Tree ? "tree" : "power");
  }
}

TEST(LightSampler, TreeAgreesWithPowerAndBeatsIt)
{
  const int n = 10000, points = 60, draws = 2000;
  const Lamps lamps = Cloud(n, 11);
  const LightSampler power = lamps.Make(LightSelection::Power), tree = lamps.Make(LightSelection::Tree);
  EXPECT_TRUE(lamps.Make(LightSelection::Auto).UsesTree());
  double variance[2] = {}, worst = 0;
  Numbers u(2);
  double z2 = 0;
  int dark = 0;
  for (int k = 0; k < points; ++k)
  {
    const Receiver at{ u.Point(1.2f), u.Direction(), false };
    double mean[2], error2[2];
    for (int m = 0; m < 2; ++m)
    {
      const LightSampler& s = m ? tree : power;
      double sum = 0, sum2 = 0;
      const int count = m ? draws : 10 * draws;
      for (int i = 0; i < count; ++i)
      {
        LightSampler::Sample d;
        double value = 0;
        if (s.Draw(at, u(), u(), u(), d))
          value = double(d.Emission.x) * double(std::max(0.f, Dot(at.Normal, d.Wi))) / double(d.Pdf);
        sum += value;
        sum2 += value * value;
      }
      mean[m] = sum / count;
      const double v = sum2 / count - mean[m] * mean[m];
      variance[m] += v;
      error2[m] = v / count;
    }
    if (!(error2[0] + error2[1] > 0))
    {
      ++dark; // the point sees the back of everything
      continue;
    }
    const double z = (mean[1] - mean[0]) / std::sqrt(error2[0] + error2[1]);
    z2 += z * z;
    worst = std::max(worst, std::fabs(z));
  }
  std::printf("variance of one light sample among %d lights, power / tree: %.1f\n", n, variance[0] / variance[1]);
  EXPECT_LT(dark, points / 4);
  EXPECT_LT(worst, 5);
  EXPECT_LT(z2, ChiLimit(points + 1, 1));
  EXPECT_GT(variance[0], 2 * variance[1]);
}

TEST(LightSampler, TreeFindsTheLampNextDoor)
{
  // two far rooms with a thousand lamps each: nothing from the other room
  Lamps lamps = Cloud(1000, 21);
  const Lamps other = Cloud(1000, 22, Vec3f(1000, 0, 0));
  lamps.Triangles.insert(lamps.Triangles.end(), other.Triangles.begin(), other.Triangles.end());
  const LightSampler s = lamps.Make(LightSelection::Tree, 500);
  Numbers u(1);
  int here = 0;
  const int draws = 4000;
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample d;
    if (s.Draw({ Vec3f(0, 0, 0), Vec3f(), false }, u(), u(), u(), d))
      here += d.Target.x < 500;
  }
  int there = 0;
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample d;
    if (s.Draw({ Vec3f(1000, 0, 0), Vec3f(), false }, u(), u(), u(), d))
      there += d.Target.x > 500;
  }
  // the wrong room gets no more than half of the picks by power; many draws see a lamp from behind
  EXPECT_GT(here, .3 * draws);
  EXPECT_GT(there, .3 * draws);
  int byPower = 0;
  const LightSampler p = lamps.Make(LightSelection::Power, 500);
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample d;
    if (p.Draw({ Vec3f(0, 0, 0), Vec3f(), false }, u(), u(), u(), d))
      byPower += d.Target.x < 500;
  }
  EXPECT_GT(here, 1.5 * byPower);
}

TEST(LightSampler, SelectionAndGroups)
{
  const Lamps few = Cloud(int(LightSampler::TreeFrom) - 1, 1), many = Cloud(int(LightSampler::TreeFrom), 1);
  EXPECT_FALSE(few.Make(LightSelection::Auto).UsesTree());
  EXPECT_TRUE(few.Make(LightSelection::Tree).UsesTree());
  EXPECT_TRUE(many.Make(LightSelection::Auto).UsesTree());
  EXPECT_FALSE(many.Make(LightSelection::Power).UsesTree());
  EXPECT_EQ(few.Make(LightSelection::Auto).LocalShare(), 1.f);
  EXPECT_EQ(many.Make(LightSelection::Auto).SkyShare(), 0.f);

  // no group starves; only a sky that is nearly black gives most of its part away
  Lamps both = few;
  both.Sky(1);
  EXPECT_NEAR(both.Make(LightSelection::Auto).SkyShare(), .5f, 1e-6f);
  both.Sky(1e20f);
  EXPECT_NEAR(both.Make(LightSelection::Auto).LocalShare(), .5f, 1e-6f);
  both.Sky(1e-20f);
  EXPECT_NEAR(both.Make(LightSelection::Auto).SkyShare(), .1f / 1.1f, 1e-4f);
  both.Punctual.push_back(Sun(Vec3f(0, -1, 0), 1e-20f));
  EXPECT_NEAR(both.Make(LightSelection::Auto).DistantShare(), 1 / 2.1f, 1e-4f);
  both.Punctual.clear();
  both.Sky(0);
  EXPECT_EQ(both.Make(LightSelection::Auto).SkyShare(), 0.f);
  // no power at all: nothing
  Lamps none;
  none.Triangles.push_back(Triangle({ 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 }, 0));
  none.Punctual.push_back(Point({ 1, 1, 1 }, 0));
  const LightSampler s = none.Make(LightSelection::Tree);
  EXPECT_TRUE(s.Empty());
  EXPECT_FALSE(s.HasHittable());
  LightSampler::Sample d;
  EXPECT_FALSE(s.Draw({ Vec3f(0, 0, 1), Vec3f(), false }, .5f, .5f, .5f, d));
}

TEST(LightSampler, ALampFromBehindOrEdgeOnGivesNothing)
{
  for (LightSelection how : { LightSelection::Power, LightSelection::Tree })
  {
    Lamps lamps; // shines down
    lamps.Triangles.push_back(Triangle({ 0, 1, 0 }, { 1, 1, 0 }, { 0, 1, 1 }, 3));
    const LightSampler s = lamps.Make(how);
    Numbers u(8);
    const auto light = [&](const Receiver& at)
    {
      double sum = 0;
      for (int i = 0; i < 500; ++i)
      {
        LightSampler::Sample d;
        if (!s.Draw(at, u(), u(), u(), d))
          continue;
        EXPECT_TRUE(d.Pdf > 0 && IsFinite(d.Emission));
        sum += double(d.Emission.x);
      }
      return sum;
    };
    EXPECT_GT(light({ Vec3f(.2f, 0, .2f), Vec3f(0, 1, 0), false }), 0);
    EXPECT_EQ(light({ Vec3f(.2f, 2, .2f), Vec3f(0, -1, 0), false }), 0) << "from behind";
    EXPECT_EQ(light({ Vec3f(5, 1, .2f), Vec3f(-1, 0, 0), false }), 0) << "edge-on";
    EXPECT_EQ(light({ Vec3f(.2f, 1, .2f), Vec3f(0, 1, 0), false }), 0) << "on it";
  }
}

TEST(LightSampler, ExtremesStayNumbers)
{
  for (LightSelection how : { LightSelection::Power, LightSelection::Tree })
    for (const Vec3f& at : { Vec3f(), Vec3f(1e6f, -1e6f, 1e6f) })
      for (float scale : { 1.f, 1e-6f, 1e6f })
      {
        Lamps lamps;
        const auto add = [&](const Vec3f& a, const Vec3f& b, const Vec3f& c, float e, bool two)
        { lamps.Triangles.push_back(Triangle(at + a * scale, at + b * scale, at + c * scale, e, two)); };
        add({ 0, 1, 0 }, { 1, 1, 0 }, { 0, 1, 1 }, 1, false);
        add({ 0, 1, 0 }, { 1, 1, 0 }, { 0, 1, 1 }, 1, true); // in the same place
        add({ 0, 1, 0 }, { 1, 1, 0 }, { 0, 1, 1 }, 1, true);
        add({ 0, 2, 0 }, { 1, 2, 0 }, { 2, 2, 0 }, 1, false); // no area
        add({ 0, 2, 0 }, { 0, 2, 0 }, { 0, 2, 0 }, 1e30f, true);
        add({ 0, 3, 0 }, { 1, 3, 0 }, { 0, 3, 1 }, 0, false);
        add({ 0, 4, 0 }, { 1, 4, 0 }, { 0, 4, 1 }, 65504, true);
        add({ 0, 5, 0 }, { 1, 5, 0 }, { 0, 5, 1 }, 1e30f, true);
        add({ 0, 6, 0 }, { 1, 6, 0 }, { 0, 6, 1 }, NaN, true);
        add({ 0, 7, 0 }, { 1, 7, 0 }, { 0, 7, 1 }, Infinity, true);
        lamps.Punctual.push_back(Point(at, 1e30f));
        lamps.Punctual.push_back(Point(at + Vec3f(0, scale, 0), 1, scale));
        lamps.Punctual.push_back(Spot(at, Vec3f(0, 1, 0), 65504, 0, 0)); // a cone without inside
        lamps.Punctual.push_back(Spot(at, Vec3f(0, 1, 0), 1, .5f, .5f));
        lamps.Punctual.push_back(Point(at, NaN));
        lamps.Punctual.push_back(Sun(Vec3f(0, -1, 0), 1e30f));
        lamps.Sky(1e30f);
        const LightSampler s = lamps.Make(how, 10 * scale);
        Numbers u(3);
        int drawn = 0;
        for (int i = 0; i < 3000; ++i)
        {
          Receiver r;
          r.Normal = i % 5 ? u.Direction() : Vec3f();
          r.BothSides = i % 2;
          // on a light, at a lamp, anywhere, far away
          r.Position = i % 4 == 0   ? at + Vec3f(u(), 1, 0) * scale
                       : i % 4 == 1 ? at
                       : i % 4 == 2 ? at + u.Point(10) * scale
                                    : at + u.Point(1e7f) * scale;
          LightSampler::Sample d;
          if (s.Draw(r, u(), u(), u(), d))
          {
            ++drawn;
            ASSERT_TRUE(d.Pdf > 0 && std::isfinite(d.Pdf)) << i;
            ASSERT_TRUE(IsFinite(d.Wi) && IsFinite(d.Emission) && IsFinite(d.Target)) << i;
          }
          for (std::uint32_t t = 0; t < s.GetTriangles().size(); ++t)
            for (float d2 : { 0.f, 1e-30f, 1.f, 1e30f })
              for (float c : { 0.f, 1e-7f, 1.f })
              {
                const float p = s.TrianglePdf(t, r, d2, c);
                ASSERT_FALSE(std::isnan(p));
                ASSERT_GE(p, 0);
              }
        }
        EXPECT_GT(drawn, 500);
        for (const Vec3f& bad : { Vec3f(NaN, 0, 0), Vec3f(0, Infinity, 0), Vec3f(0, 0, -Infinity) })
        {
          LightSampler::Sample d;
          for (int i = 0; i < 50; ++i)
            EXPECT_FALSE(s.Draw({ bad, Vec3f(0, 1, 0), false }, u(), u(), u(), d));
          EXPECT_FALSE(std::isnan(s.TrianglePdf(0, { bad, Vec3f(0, 1, 0), false }, NaN, 1)));
        }
        // a normal that is not a number may cost picks, never give a density that is none
        for (int i = 0; i < 50; ++i)
        {
          const Receiver r{ at + u.Point(1) * scale, Vec3f(NaN), false };
          LightSampler::Sample d;
          EXPECT_TRUE(!s.Draw(r, u(), u(), u(), d) || (d.Pdf > 0 && std::isfinite(d.Pdf)));
          EXPECT_FALSE(std::isnan(s.TrianglePdf(0, r, 1, 1)));
        }
      }
}

TEST(LightSampler, MillionsOfLightsAllGetTheirShare)
{
  // by power among 10^5 equal ones with 24 bits of `pick`: each region of the list is met as often as it should
  Lamps lamps;
  const int n = 100000;
  Numbers u(12);
  for (int i = 0; i < n; ++i)
  {
    const Vec3f a = u.Point(1);
    lamps.Triangles.push_back(Triangle(a, a + Vec3f(.001f, 0, 0), a + Vec3f(0, .001f, 0), 1, true));
  }
  auto start = std::chrono::steady_clock::now();
  const LightSampler tree = lamps.Make(LightSelection::Tree);
  std::printf("light tree of %d lights: %.0f ms, %d levels, %.0f bytes per light\n", n, 1e3 * Seconds(start),
    tree.GetTree().Depth(), double(tree.GetTree().Bytes()) / n);
  const LightSampler power = lamps.Make(LightSelection::Power);
  EXPECT_EQ(power.GetLocalCdf().back(), 1.);
  const int draws = 200000, blocks = 1000;
  std::vector<double> counted(blocks), expected(blocks, double(draws) / blocks);
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample d;
    if (!power.Draw({ Vec3f(0, 0, 9), Vec3f(), false }, u(), u(), u(), d))
      continue;
    // recognized by its place
    ++counted[std::size_t(std::min(blocks - 1, int((d.Target.x + 1) / 2 * blocks)))];
  }
  std::fill(expected.begin(), expected.end(), 0.);
  for (const LightTriangle& t : lamps.Triangles)
    expected[std::size_t(std::min(blocks - 1, int((t.V0.x + t.E1.x / 3 + 1) / 2 * blocks)))] += double(draws) / n;
  double difference = 0;
  for (int b = 0; b < blocks; ++b)
    difference += std::fabs(counted[std::size_t(b)] - expected[std::size_t(b)]);
  EXPECT_LT(difference / draws, .08); // 200 per block: 0.8 / sqrt(200) = 0.056 by chance
  // Below 2^-24 of the picks: every light can be met. One far weaker than the step, next to strong ones.
  double sum = 0;
  const Receiver at{ Vec3f(.3f, 0, .2f), Vec3f(0, 0, 1), false };
  for (std::uint32_t i = 0; i < n; ++i)
    sum += double(tree.GetTree().Chance(at, i));
  EXPECT_NEAR(sum, 1, 1e-4);
}

TEST(LightSampler, RangeAndConesAreKnownToTheTree)
{
  // lamps whose range ends before the point and spots that look away: few of the picks go to them
  Lamps lamps;
  Numbers u(31);
  for (int i = 0; i < 500; ++i)
    lamps.Punctual.push_back(i % 2 ? Point(u.Point(1), 1, .3f) : Spot(u.Point(1), u.Direction(), 1, .1f, .4f));
  const LightSampler s = lamps.Make(LightSelection::Tree);
  double useful = 0, byChance = 0;
  int lit = 0;
  for (int k = 0; k < 100; ++k)
  {
    const Receiver at{ u.Point(1), Vec3f(), false };
    int reaching = 0;
    for (std::size_t i = 0; i < s.GetPunctual().size(); ++i)
    {
      const PlacedLight& l = s.GetPunctual()[i];
      const Vec3f d = at.Position - l.Position;
      const float distance = Length(d);
      const bool reaches =
        l.Type == LightType::Point ? distance < l.Range : Dot(d, l.Direction) / distance > l.CosOuter;
      const float chance = s.GetTree().Chance(at, std::uint32_t(i));
      if (reaches)
      {
        EXPECT_GT(chance, 0.f);
        useful += double(chance);
        ++reaching;
      }
    }
    lit += reaching > 0;
    byChance += double(reaching) / double(s.GetPunctual().size());
  }
  std::printf("useful picks: %.1f %% by the tree, %.1f %% blindly\n", 100 * useful / lit, 100 * byChance / lit);
  EXPECT_GT(lit, 50);
  EXPECT_GT(useful, 3 * byChance);
}

TEST(LightSampler, CostOfADraw)
{
  for (int n : { 10, 1000, 100000 })
  {
    const Lamps lamps = Cloud(n, 5);
    for (LightSelection how : { LightSelection::Power, LightSelection::Tree })
    {
      const LightSampler s = lamps.Make(how);
      Numbers u(1);
      std::vector<Receiver> at(1000);
      for (Receiver& r : at)
        r = { u.Point(1), u.Direction(), false };
      const int draws = 20000;
      std::vector<float> numbers(3 * 4096);
      for (float& v : numbers)
        v = u();
      const auto start = std::chrono::steady_clock::now();
      int drawn = 0;
      for (int i = 0; i < draws; ++i)
      {
        LightSampler::Sample d;
        const float* q = &numbers[3 * std::size_t(i % 4096)];
        drawn += s.Draw(at[std::size_t(i % 1000)], q[0], q[1], q[2], d);
      }
      std::printf("%6d lights by %s: %.0f ns per draw\n", n, how == LightSelection::Tree ? "tree" : "power",
        1e9 * Seconds(start) / draws);
      EXPECT_GT(drawn, draws / 8);
    }
  }
}

namespace
{
double SkyIntegral(const LightSampler& s, int n)
{
  // midpoint rule in equal areas
  double sum = 0;
  for (int a = 0; a < n; ++a)
    for (int b = 0; b < 2 * n; ++b)
    {
      const double z = 2 * (a + .5) / n - 1, r = std::sqrt(1 - z * z), p = Pi * (b + .5) / n;
      sum += double(s.SkyPdf(Vec3f(float(r * std::cos(p)), float(z), float(r * std::sin(p)))));
    }
  return sum * 4 * Pi / (2. * n * n);
}
}

TEST(LightSampler, SkyDensityIntegratesToOne)
{
  Lamps constant;
  constant.Sky(3);
  EXPECT_NEAR(SkyIntegral(constant.Make(LightSelection::Auto), 64), 1, 1e-5);

  for (const auto& size :
    { Vec2<int>{ 1, 1 }, Vec2<int>{ 2, 1 }, Vec2<int>{ 1, 3 }, Vec2<int>{ 7, 5 }, Vec2<int>{ 16, 8 } })
  {
    Lamps lamps;
    Texture& t = lamps.SkyImage(size.x, size.y, 0);
    Numbers u(unsigned(size.x));
    for (float& v : t.Floats)
      v = u();
    EXPECT_NEAR(SkyIntegral(lamps.Make(LightSelection::Auto), 250), 1, 5e-3) << size.x << " x " << size.y;
  }
  // a sun of one texel at the pole, at the seam, in the middle
  for (int sun : { 0, 15, 16 * 7, 16 * 3 + 8 })
    for (float value : { 65504.f, 1e30f, Infinity })
    {
      Lamps lamps;
      Texture& t = lamps.SkyImage(16, 8, 1);
      for (int c = 0; c < 3; ++c)
        t.Floats[std::size_t(4 * sun + c)] = value;
      EXPECT_NEAR(SkyIntegral(lamps.Make(LightSelection::Auto), 320), 1, 2e-2) << sun << " " << value;
    }
  Lamps black;
  black.SkyImage(8, 4, 0);
  const LightSampler s = black.Make(LightSelection::Auto);
  EXPECT_EQ(s.SkyShare(), 0.f);
  EXPECT_EQ(s.SkyPdf(Vec3f(0, 1, 0)), 0.f);
  EXPECT_EQ(s.Sky(Vec3f(0, 1, 0)), Vec3f());
  LightSampler::Sample d;
  EXPECT_FALSE(s.Draw({}, .5f, .5f, .5f, d));
}

TEST(LightSampler, LightNextToASunIsNotLost)
{
  // Light samples alone give the right integral of each half of the sky: of the half with a sun of 65504 or 1e30, and
  // of the other one, whose texels are 1e-31 of all.
  for (float sun : { 65504.f, 1e30f })
  {
    Lamps lamps;
    Texture& t = lamps.SkyImage(64, 32, 1);
    const int at = 64 * 8 + 20;
    for (int c = 0; c < 3; ++c)
    {
      t.Floats[std::size_t(4 * at + c)] = sun;
      t.Floats[std::size_t(4 * (64 * 20 + 5) + c)] = c == 1 ? -5.f : NaN; // dark
    }
    const LightSampler s = lamps.Make(LightSelection::Auto);
    Numbers u(77);
    const int draws = 200000;
    double dark = 0, dark2 = 0, bright = 0;
    for (int i = 0; i < draws; ++i)
    {
      LightSampler::Sample d;
      ASSERT_TRUE(s.Draw({}, u(), u(), u(), d));
      ASSERT_TRUE(std::isfinite(d.Emission.x) && std::isfinite(d.Pdf));
      const double v = double(d.Emission.x) / double(d.Pdf);
      if (d.Wi.y < 0)
      {
        dark += v / draws;
        dark2 += v * v / draws;
      }
      else
        bright += v / draws;
    }
    double darkExact = 0, brightExact = 0;
    const int n = 800;
    for (int a = 0; a < n; ++a)
      for (int b = 0; b < 2 * n; ++b)
      {
        const double z = 2 * (a + .5) / n - 1, r = std::sqrt(1 - z * z), p = Pi * (b + .5) / n;
        const double v = double(s.Sky(Vec3f(float(r * std::cos(p)), float(z), float(r * std::sin(p)))).x);
        (z < 0 ? darkExact : brightExact) += v * 4 * Pi / (2. * n * n);
      }
    EXPECT_NEAR(dark, darkExact, 4 * std::sqrt(dark2 / draws)) << sun;
    EXPECT_LT(std::sqrt(dark2 / draws), .05 * darkExact);
    EXPECT_NEAR(bright / brightExact, 1, .03) << sun;
  }
}

TEST(LightSampler, BothPolesAreSampledEvenly)
{
  // density times frequency over caps too small for the digits of a height
  Lamps lamps;
  lamps.SkyImage(1024, 512, 1);
  const LightSampler s = lamps.Make(LightSelection::Auto);
  Numbers u(13);
  const double cap = std::cos(.05);
  int up = 0, down = 0;
  const int draws = 300000;
  double row[6] = {};
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample d;
    ASSERT_TRUE(s.Draw({}, u(), u(), u(), d));
    ASSERT_NEAR(d.Pdf * 4 * Pi, 1, 1e-3);
    if (std::fabs(double(d.Wi.y)) > cap)
    {
      ++(d.Wi.y > 0 ? up : down);
      if (d.Wi.y > 0)
        ++row[std::min(5, int(std::hypot(d.Wi.x, d.Wi.z) / .05 * 6))];
    }
  }
  const double expected = draws * (1 - cap) / 2;
  EXPECT_NEAR(up, expected, 4 * std::sqrt(expected));
  EXPECT_NEAR(down, expected, 4 * std::sqrt(expected));
  for (int r = 0; r < 6; ++r)
    EXPECT_NEAR(row[r], expected * (2 * r + 1) / 36, 4 * std::sqrt(expected * (2 * r + 1) / 36) + 1);
}

TEST(LightSampler, SkyPdfMatchesTheSampler)
{
  // a sky of 8 x 4 texels, one of them hot, and two triangles: every direction's density against counts
  Scene scene;
  Texture t;
  t.Width = 8;
  t.Height = 4;
  t.Floats.assign(4 * 32, 1);
  t.Floats[4 * 11] = t.Floats[4 * 11 + 1] = t.Floats[4 * 11 + 2] = 50;
  t.Floats[4 * 20] = std::numeric_limits<float>::quiet_NaN();
  scene.Textures.push_back(t);
  scene.Sky.Present = true;
  scene.Sky.Color = Vec3f(1.f);
  scene.Sky.Texture = 0;
  LightSampler lights;
  lights.Build({}, {}, {}, scene, 1);
  const int nz = 16, np = 32, draws = 60000, sub = 16;
  std::vector<double> expected(nz * np), counted(nz * np);
  double total = 0;
  for (int a = 0; a < nz * sub; ++a)
    for (int b = 0; b < np * sub; ++b)
    {
      const float z = 2 * (a + .5f) / (nz * sub) - 1, r = std::sqrt(1 - z * z), p = 2 * Pi * (b + .5f) / (np * sub);
      const double q =
        lights.SkyPdf(Vec3f(r * std::cos(p), z, r * std::sin(p))) * 4 * Pi / (double(nz * sub) * np * sub);
      expected[a / sub * np + b / sub] += q * draws;
      total += q;
    }
  EXPECT_NEAR(total, 1, 5e-3);
  std::mt19937 twister(2);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (int i = 0; i < draws; ++i)
  {
    LightSampler::Sample s;
    if (!lights.Draw(Receiver(), std::min(uniform(twister), .9999999f), std::min(uniform(twister), .9999999f),
          std::min(uniform(twister), .9999999f), s))
      continue;
    const float phi = std::atan2(s.Wi.z, s.Wi.x) / (2 * Pi);
    ++counted[std::min(nz - 1, int((s.Wi.y + 1) / 2 * nz)) * np +
              std::min(np - 1, int((phi < 0 ? phi + 1 : phi) * np))];
  }
  double chi2 = 0;
  int cells = 0;
  for (std::size_t i = 0; i < expected.size(); ++i)
    if (expected[i] > 8)
    {
      chi2 += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
      ++cells;
    }
  // texel borders cross cells: the quadrature of the expectation allows a little more than pure chance
  EXPECT_LT(chi2, 1.3 * cells + 5 * std::sqrt(2. * cells));
  EXPECT_GT(cells, 100);
}

TEST(LightSampler, SkyLookupIsBilinearInLongitudeAndLatitude)
{
  for (const auto& size : { Vec2<int>{ 1, 1 }, Vec2<int>{ 3, 2 }, Vec2<int>{ 64, 33 } })
  {
    Lamps lamps;
    Texture& t = lamps.SkyImage(size.x, size.y, 0);
    Numbers u(unsigned(size.x));
    for (float& v : t.Floats)
      v = u();
    lamps.Scene.Sky.Color = Vec3f(.5f, 1, 2);
    const LightSampler s = lamps.Make(LightSelection::Auto);
    std::vector<Vec3f> directions{ { 0, 1, 0 }, { 0, -1, 0 }, { 0, 0, 1 }, { 0, 0, -1 }, { 1, 0, 0 }, { -1, 0, 0 },
      { 1e-4f, 1, 0 }, { 0, -1, 1e-7f }, { -1e-7f, 0, 1 }, { 3, 4, -5 }, { 1e15f, -1e15f, 1e15f } };
    for (int i = 0; i < 2000; ++i)
      directions.push_back(u.Direction());
    for (const Vec3f& d : directions)
    {
      float pdf = -1;
      const Vec3f both = s.SkyAndPdf(d, pdf);
      ASSERT_EQ(both, s.Sky(d));
      ASSERT_EQ(pdf, s.SkyPdf(d));
      ASSERT_GT(pdf, 0.f);
      const double x = (.5 + std::atan2(double(d.x), -double(d.z)) / (2 * M_PI)) * size.x - .5,
                   y = std::atan2(std::hypot(double(d.x), double(d.z)), double(d.y)) / M_PI * size.y - .5;
      const double fx = std::floor(x), fy = std::floor(y);
      for (int c = 0; c < 3; ++c)
      {
        double expected = 0;
        for (int j = 0; j < 2; ++j)
          for (int i = 0; i < 2; ++i)
          {
            const int column = (int(fx) + i + 2 * size.x) % size.x,
                      row = std::min(size.y - 1, std::max(0, int(fy) + j));
            expected += double(t.Floats[std::size_t(4 * (row * size.x + column) + c)]) * (i ? x - fx : 1 - x + fx) *
                        (j ? y - fy : 1 - y + fy);
          }
        // 64 columns times an error of 1e-7 turns
        ASSERT_NEAR(both[c] / lamps.Scene.Sky.Color[c], expected, 1.5e-5) << d.x << " " << d.y << " " << d.z;
      }
    }
    for (const Vec3f& d : { Vec3f(NaN, 0, 0), Vec3f(0, Infinity, 0), Vec3f(-Infinity, NaN, 1) })
    {
      float pdf = -1;
      EXPECT_EQ(s.SkyAndPdf(d, pdf), Vec3f());
      EXPECT_EQ(pdf, 0.f);
    }
    float pdf = 0;
    EXPECT_TRUE(IsFinite(s.SkyAndPdf(Vec3f(), pdf)) && std::isfinite(pdf));
  }
}

TEST(LightSampler, TexelsAreMetAsOftenAsTheyShould)
{
  // Chances over eight decades: parts of the guide with one texel, and with hundreds of them. Columns that are no power
  // of 2, fewer than the guide has entries, a single row.
  const Vec2<int> sizes[] = { { 700, 3 }, { 5, 90 }, { 128, 64 }, { 2, 2 }, { 300, 1 } };
  for (const Vec2<int>& size : sizes)
  {
    Lamps lamps;
    Texture& t = lamps.SkyImage(size.x, size.y, 0);
    Numbers u(unsigned(size.x));
    for (int i = 0; i < size.x * size.y; ++i)
    {
      const float value = std::exp(18.f * u() * (i % 3 ? 1.f : .1f));
      for (int c = 0; c < 3; ++c)
        t.Floats[std::size_t(4 * i + c)] = value;
    }
    const LightSampler s = lamps.Make(LightSelection::Auto);
    const int draws = 300000;
    std::vector<double> expected, counted(std::size_t(size.x) * std::size_t(size.y));
    double sum = 0;
    for (int y = 0; y < size.y; ++y)
      for (int x = 0; x < size.x; ++x)
      {
        const double theta = M_PI * (y + .5) / size.y, phi = 2 * M_PI * ((x + .5) / size.x - .5);
        const Vec3f d(
          float(std::sin(theta) * std::sin(phi)), float(std::cos(theta)), float(-std::sin(theta) * std::cos(phi)));
        const double solid = 2 * M_PI / size.x * (std::cos(M_PI * y / size.y) - std::cos(M_PI * (y + 1) / size.y));
        expected.push_back(double(s.SkyPdf(d)) * solid * draws);
        sum += expected.back() / draws;
      }
    EXPECT_NEAR(sum, 1, 1e-5);
    for (int i = 0; i < draws; ++i)
    {
      const float pick = u(), a = u(), b = u();
      LightSampler::Sample d;
      ASSERT_TRUE(s.Draw({}, pick, a, b, d));
      float pdf;
      ASSERT_EQ(d.Emission, s.SkyAndPdf(d.Wi, pdf));
      ASSERT_EQ(d.Pdf, pdf);
      const double x = (.5 + std::atan2(double(d.Wi.x), -double(d.Wi.z)) / (2 * M_PI)) * size.x,
                   y = std::atan2(std::hypot(double(d.Wi.x), double(d.Wi.z)), double(d.Wi.y)) / M_PI * size.y;
      ++counted[std::size_t(std::min(size.y - 1, int(y)) * size.x + std::min(size.x - 1, int(x)))];
    }
    ExpectCounts(counted, expected, 5, (std::to_string(size.x) + " x " + std::to_string(size.y)).c_str());
  }
}

TEST(LightSampler, SkyFromBehindIsLeftOut)
{
  Lamps image, constant;
  image.SkyImage(32, 16, 1);
  constant.Sky(1);
  for (const Lamps* lamps : { &image, &constant })
  {
    const LightSampler s = lamps->Make(LightSelection::Auto);
    Numbers u(3);
    const Vec3f n = u.Direction();
    const int draws = 20000;
    int front = 0, both = 0, none = 0;
    for (int i = 0; i < draws; ++i)
    {
      const float pick = u(), a = u(), b = u();
      LightSampler::Sample d;
      if (s.Draw({ {}, n, false }, pick, a, b, d))
      {
        ++front;
        ASSERT_GT(Dot(n, d.Wi), -2e-4f);
      }
      both += s.Draw({ {}, n, true }, pick, a, b, d);
      none += s.Draw({ {}, Vec3f(), false }, pick, a, b, d);
    }
    EXPECT_NEAR(front, draws / 2, 4 * std::sqrt(draws / 4.));
    EXPECT_EQ(both, draws);
    EXPECT_EQ(none, draws);
  }
}
