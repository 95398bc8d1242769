// SPDX-License-Identifier: BSD-3-Clause
#include "Threads.h"
#include "quellMetrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

using namespace quell;

namespace
{
constexpr int W = 64, H = 48;

struct Picture
{
  int w, h, c;
  std::vector<float> data;
  Picture(int width, int height, int channels, float v = 0)
    : w(width)
    , h(height)
    , c(channels)
    , data(std::size_t(width) * height * channels, v)
  {
  }
  explicit Picture(const std::function<void(int, int, float*)>& f)
    : Picture(W, H, 3)
  {
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x)
        f(x, y, &data[3 * (y * W + x)]);
  }
  ImageIn in() const { return { data.data(), c, { 0, 0, w, h } }; }
  ImageOut out() { return { data.data(), c, { 0, 0, w, h } }; }
};

Picture Gray(float v)
{
  return Picture(W, H, 3, v);
}
Picture Color(float r, float g, float b)
{
  return Picture(
    [=](int, int, float* p)
    {
      p[0] = r;
      p[1] = g;
      p[2] = b;
    });
}
Picture Gradient(bool flipped)
{
  return Picture(
    [=](int x, int y, float* p)
    {
      const double u = (x + 0.5) / W;
      p[0] = float(flipped ? 1 - u : u);
      p[1] = float((y + 0.5) / H);
      p[2] = 0.25f;
    });
}
Picture Ramp(double scale)
{
  return Picture(
    [=](int x, int y, float* p)
    {
      const double u = (x + 0.5) / W, v = (y + 0.5) / H;
      p[0] = float(scale * 8 * u * u);
      p[1] = float(scale * 4 * v);
      p[2] = float(scale * (0.1 + 2 * u * v));
    });
}
Picture WithPixel(Picture p, float v)
{
  for (int c = 0; c < 3; ++c)
    p.data[3 * (24 * W + 32) + c] = v;
  return p;
}

double PixelOf(const std::string& metric, const Picture& test, const Picture& reference, int x, int y)
{
  Picture map(W, H, 1, -1);
  ComputeErrorMap(metric, test.in(), reference.in(), map.out());
  return map.data[y * W + x];
}
std::string ErrorOf(const std::function<void()>& f)
{
  try
  {
    f();
  }
  catch (const StageError& e)
  {
    return e.what();
  }
  return "no error";
}
}

TEST(Metrics, GoldenScalars)
{
  const struct
  {
    Picture test, reference;
    double mse, relMse, mrse, smape, psnr, ssim, psnrLinear, ssimLinear;
  } rows[] = {
    { Gradient(true), Gradient(false), .111083984, 2.96282589, 25.0563878, .165016502, 15.573875, .847620538, 9.543486,
      .645072386 },
    { Ramp(1.2), Ramp(1), .249126929, .0364124741, .0378255872, .089190054, 31.787501, .998698107, 24.544383,
      .941705254 },
    { WithPixel(Ramp(1), 100), Ramp(1), 3.15366725, 3.2242198, 3.20354002, .000315427498, 47.409625, .990925792,
      48.013074, .997128218 },
  };
  for (const auto& r : rows)
  {
    const auto metric = [&](const char* name) { return ComputeMetric(name, r.test.in(), r.reference.in()); };
    EXPECT_NEAR(metric("MSE"), r.mse, 2e-7 * r.mse);
    EXPECT_NEAR(metric("RMSE"), std::sqrt(r.mse), 1e-6);
    EXPECT_NEAR(metric("relMSE"), r.relMse, 1e-6 * r.relMse);
    EXPECT_NEAR(metric("MRSE"), r.mrse, 1e-6 * r.mrse);
    EXPECT_NEAR(metric("SMAPE"), r.smape, 1e-6 * r.smape);
    EXPECT_NEAR(metric("PSNR"), r.psnr, 1e-5);
    EXPECT_NEAR(metric("SSIM"), r.ssim, 1e-7);
    EXPECT_NEAR(metric("PSNR-linear"), r.psnrLinear, 1e-5);
    EXPECT_NEAR(metric("SSIM-linear"), r.ssimLinear, 1e-7);
  }
  EXPECT_NEAR(ComputeMetric("MAE", Gray(0.25f).in(), Gray(0.75f).in()), 0.5, 1e-12);
}

TEST(Metrics, TrimmedRelMseForgetsAFirefly)
{
  // 3072 pixels: the three worst are left out, so one firefly counts for nothing and four make themselves felt.
  const Picture ramp = Ramp(1);
  EXPECT_EQ(ComputeMetric("relMSE@0.1%", WithPixel(ramp, 100).in(), ramp.in()), 0);
  Picture four = Gray(1), reference = Gray(1);
  for (int i = 0; i < 4; ++i)
    four.data[300 * i] = 11 + float(i);
  const double one = 100 / 1.01 / 3; // the smallest of the four: (11 - 1)^2
  EXPECT_NEAR(ComputeMetric("relMSE@0.1%", four.in(), reference.in()), one / (3072 - 3), 1e-9);
  EXPECT_GT(ComputeMetric("relMSE", four.in(), reference.in()), 4 * one / 3072);
}

TEST(Metrics, GoldenFlip)
{
  const auto flip = [](const Picture& a, const Picture& b) { return ComputeMetric("FLIP", a.in(), b.in()); };
  EXPECT_NEAR(flip(Gray(0.6f), Gray(0.5f)), .196255, 1e-4);
  EXPECT_NEAR(flip(Gray(1), Gray(0)), .967388, 1e-4);
  EXPECT_NEAR(flip(Color(0, 1, 0), Color(1, 0, 0)), .986665, 1e-4);
  EXPECT_NEAR(flip(Color(0, 0, 1), Color(0, 1, 0)), 1, 1e-4);
  EXPECT_NEAR(flip(Gradient(true), Gradient(false)), .623115, 1e-4);
  EXPECT_NEAR(PixelOf("FLIP", Gradient(true), Gradient(false), 0, 0), .958038, 1e-4);
  EXPECT_NEAR(PixelOf("FLIP", Gradient(true), Gradient(false), 32, 24), .057876, 1e-4);
  EXPECT_NEAR(PixelOf("FLIP", Gradient(true), Gradient(false), 63, 47), .952728, 1e-4);
  EXPECT_NEAR(flip(WithPixel(Gray(0.5f), 1), Gray(0.5f)), .000724, 1e-4);
  EXPECT_NEAR(PixelOf("FLIP", WithPixel(Gray(0.5f), 1), Gray(0.5f), 32, 24), .210963, 1e-4);
  EXPECT_EQ(flip(Gray(0), Gray(0)), 0);
}

TEST(Metrics, GoldenHdrFlip)
{
  const auto flip = [](const Picture& a, const Picture& b) { return ComputeMetric("HDR-FLIP", a.in(), b.in()); };
  EXPECT_NEAR(flip(Ramp(1.2), Ramp(1)), .208266, 1e-4);
  EXPECT_NEAR(PixelOf("HDR-FLIP", Ramp(1.2), Ramp(1), 0, 0), .215876, 1e-4);
  EXPECT_NEAR(PixelOf("HDR-FLIP", Ramp(1.2), Ramp(1), 32, 24), .178753, 1e-4);
  EXPECT_NEAR(PixelOf("HDR-FLIP", Ramp(1.2), Ramp(1), 63, 47), .136324, 1e-4);
  EXPECT_NEAR(flip(WithPixel(Ramp(1), 100), Ramp(1)), .001917, 1e-4);
  EXPECT_NEAR(PixelOf("HDR-FLIP", WithPixel(Ramp(1), 100), Ramp(1), 32, 24), .233227, 1e-4);
  // A reference with a black median, and an entirely black one.
  Picture mostlyBlack = Gray(0);
  for (int i = 0; i < 300; ++i)
    mostlyBlack.data[i] = 1;
  EXPECT_TRUE(std::isfinite(flip(Gray(0.5f), mostlyBlack)));
  EXPECT_EQ(flip(mostlyBlack, mostlyBlack), 0);
  EXPECT_EQ(flip(Gray(0), Gray(0)), 0);
  EXPECT_GT(flip(Gray(1e30f), Gray(0)), 0.9);
}

TEST(Metrics, EqualImagesAreBest)
{
  for (const std::string& name : MetricNames())
  {
    const double v = ComputeMetric(name, Ramp(1).in(), Ramp(1).in());
    EXPECT_NEAR(v, name.compare(0, 4, "PSNR") == 0 ? 200. : name.compare(0, 4, "SSIM") == 0 ? 1. : 0., 1e-12) << name;
    const double worse = ComputeMetric(name, Ramp(1.5).in(), Ramp(1).in()),
                 bad = ComputeMetric(name, Ramp(3).in(), Ramp(1).in());
    EXPECT_TRUE(HigherIsBetter(name) ? v > worse && worse > bad : v < worse && worse < bad) << name;
  }
}

TEST(Metrics, ExtremesGiveNumbers)
{
  for (const std::string& name : MetricNames())
  {
    for (float v : { 0.f, 1e-42f, -1e-6f, 1e30f })
      EXPECT_TRUE(std::isfinite(ComputeMetric(name, Gray(v).in(), Ramp(1).in()))) << name << " " << v;
    // Black is like black, and unlike anything else.
    const double black = ComputeMetric(name, Gray(0).in(), Gray(0).in()),
                 grey = ComputeMetric(name, Gray(.5f).in(), Gray(0).in());
    EXPECT_NEAR(black,
      name.compare(0, 4, "PSNR") == 0   ? 200.
      : name.compare(0, 4, "SSIM") == 0 ? 1.
                                        : 0.,
      1e-12)
      << name;
    EXPECT_TRUE(std::isfinite(grey) && (HigherIsBetter(name) ? grey < black : grey > black)) << name << " " << grey;
  }
}

TEST(Metrics, ErrorMapAveragesToTheMetric)
{
  for (const std::string name : { "MSE", "MAE", "relMSE", "MRSE", "SMAPE", "FLIP", "HDR-FLIP" })
  {
    Picture map(W, H, 1);
    ComputeErrorMap(name, Gradient(true).in(), Gradient(false).in(), map.out());
    double sum = 0;
    for (float v : map.data)
      sum += v;
    const double metric = ComputeMetric(name, Gradient(true).in(), Gradient(false).in());
    EXPECT_NEAR(sum / (W * H), metric, 1e-6 * metric) << name;
  }
  EXPECT_NEAR(PixelOf("SSIM", Ramp(1), Ramp(1), 0, 0), 0, 1e-6);
  EXPECT_NE(ErrorOf(
              []
              {
                Picture small(3, 3, 1);
                ComputeErrorMap("MSE", Gray(0).in(), Gray(0).in(), small.out());
              }),
    "no error");
}

TEST(Metrics, SameBitsForAnyNumberOfThreads)
{
  const Picture a = WithPixel(Ramp(1.2), 7), b = Ramp(1);
  for (const std::string& name : MetricNames())
  {
    double one = 0;
    for (int threads : { 1, 2, 3, 7 })
    {
      double value = 0;
      quelltest::WithThreads(threads, [&]() { value = ComputeMetric(name, a.in(), b.in()); });
      one = threads == 1 ? value : one;
      EXPECT_EQ(value, one) << name << " " << threads;
    }
  }
}

TEST(Metrics, MistakesAreExplained)
{
  Picture nan = Ramp(1);
  nan.data[3 * (5 * W + 7) + 1] = std::numeric_limits<float>::quiet_NaN();
  nan.data[3 * (9 * W + 2) + 2] = std::numeric_limits<float>::infinity();
  for (const std::string& name : MetricNames())
  {
    EXPECT_EQ(ErrorOf([&] { ComputeMetric(name, nan.in(), Ramp(1).in()); }),
      "the image has 2 non-finite pixels, the first at column 7, row 5 from the bottom");
    EXPECT_NE(
      ErrorOf([&] { ComputeMetric(name, Ramp(1).in(), nan.in()); }).find("the reference has 2"), std::string::npos);
    EXPECT_EQ(ErrorOf([&] { ComputeMetric(name, Picture(4, 3, 3).in(), Ramp(1).in()); }),
      "the image is 4 x 3, the reference 64 x 48");
  }
  const Picture small(10, 40, 3);
  EXPECT_EQ(ErrorOf([&] { ComputeMetric("SSIM", small.in(), small.in()); }),
    "SSIM needs at least 11 x 11 pixels, the image is 10 x 40");
  EXPECT_EQ(ComputeMetric("MSE", Picture(1, 1, 3, 2).in(), Picture(1, 1, 3, 3).in()), 1);
  const Picture gray(20, 20, 1);
  EXPECT_EQ(ErrorOf([&] { ComputeMetric("FLIP", gray.in(), gray.in()); }), "FLIP needs 3 channels, the image has 1");
  EXPECT_EQ(
    ErrorOf([&] { ComputeMetric("relMES", gray.in(), gray.in()); }), "unknown metric \"relMES\"; did you mean relMSE?");
  EXPECT_NE(
    ErrorOf([&] { ComputeMetric("beauty contest", gray.in(), gray.in()); }).find("there are MSE"), std::string::npos);
  EXPECT_NE(ErrorOf([&] { ComputeMetric("MSE", ImageIn(), ImageIn()); }).find("empty"), std::string::npos);
}
