// SPDX-License-Identifier: BSD-3-Clause
#include "quellFlip.h"

#include "quellVector.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
constexpr double Pi = 3.14159265358979323846;
constexpr double PixelsPerDegree = 67.020645;
constexpr int ColorRadius = 10;  // ceil(3 sqrt(.04 / (2 pi^2)) ppd)
constexpr int FeatureRadius = 9; // ceil(3 * .5 * .082 ppd)
constexpr double WhiteX = 0.950428545, WhiteZ = 1.088900371;

const double ToXyz[3][3] = { { 10135552 / 24577794., 8788810 / 24577794., 4435075 / 24577794. },
  { 2613072 / 12288897., 8788810 / 12288897., 887015 / 12288897. },
  { 1425312 / 73733382., 8788810 / 73733382., 70074185 / 73733382. } };

Vec3d Times(const double m[3][3], const Vec3d& v)
{
  return { m[0][0] * v.x + m[0][1] * v.y + m[0][2] * v.z, m[1][0] * v.x + m[1][1] * v.y + m[1][2] * v.z,
    m[2][0] * v.x + m[2][1] * v.y + m[2][2] * v.z };
}

double LabCurve(double t)
{
  const double d = 6 / 29.;
  return t > d * d * d ? std::cbrt(t) : t / (3 * d * d) + 4 / 29.;
}

/// L*a*b* with a and b scaled by 0.01 L (Hunt effect).
Vec3d HuntLab(const Vec3d& rgb)
{
  const Vec3d v = Times(ToXyz, rgb);
  const double x = LabCurve(v.x / WhiteX), y = LabCurve(v.y), z = LabCurve(v.z / WhiteZ);
  const double l = 116 * y - 16;
  return { l, 0.01 * l * 500 * (x - y), 0.01 * l * 200 * (y - z) };
}

double HyAb(const Vec3d& a, const Vec3d& b)
{
  return std::fabs(a.x - b.x) + std::hypot(a.y - b.y, a.z - b.z);
}

struct Tables
{
  double fromXyz[3][3];
  // Separable contrast-sensitivity Gaussians: luminance, red-green, and the two of blue-yellow with their shares.
  double csf[4][2 * ColorRadius + 1];
  double share[2];
  double smooth[2 * FeatureRadius + 1], first[2 * FeatureRadius + 1], second[2 * FeatureRadius + 1];
  double largest;

  Tables() noexcept
  {
    const Vec3d r[3] = { { ToXyz[0][0], ToXyz[0][1], ToXyz[0][2] }, { ToXyz[1][0], ToXyz[1][1], ToXyz[1][2] },
      { ToXyz[2][0], ToXyz[2][1], ToXyz[2][2] } };
    const Vec3d c[3] = { Cross(r[1], r[2]), Cross(r[2], r[0]), Cross(r[0], r[1]) };
    const double det = Dot(r[0], c[0]);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        fromXyz[i][j] = c[j][i] / det;

    // a sqrt(pi / b) exp(-pi^2 d^2 / b), d in degrees: a product of two rows, so only the sum of two needs its weights.
    const double b[4] = { 0.0047, 0.0053, 0.04, 0.025 }, a[2] = { 34.1, 13.5 };
    double total[4];
    for (int k = 0; k < 4; ++k)
    {
      total[k] = 0;
      for (int i = -ColorRadius; i <= ColorRadius; ++i)
      {
        const double d = i / PixelsPerDegree;
        total[k] += csf[k][i + ColorRadius] = std::exp(-Pi * Pi * d * d / b[k]);
      }
      for (double& v : csf[k])
        v /= total[k];
    }
    double mass[2];
    for (int k = 0; k < 2; ++k)
      mass[k] = a[k] * std::sqrt(Pi / b[k + 2]) * total[k + 2] * total[k + 2];
    for (int k = 0; k < 2; ++k)
      share[k] = mass[k] / (mass[0] + mass[1]);

    const double sigma = 0.5 * 0.082 * PixelsPerDegree;
    double sum = 0, firstUp = 0, firstDown = 0, secondUp = 0, secondDown = 0;
    for (int i = -FeatureRadius; i <= FeatureRadius; ++i)
    {
      const double g = std::exp(-i * i / (2 * sigma * sigma));
      const int k = i + FeatureRadius;
      sum += smooth[k] = g;
      first[k] = -i * g;
      (first[k] > 0 ? firstUp : firstDown) += std::fabs(first[k]);
      second[k] = (i * i / (sigma * sigma) - 1) * g;
      (second[k] > 0 ? secondUp : secondDown) += std::fabs(second[k]);
    }
    for (int k = 0; k <= 2 * FeatureRadius; ++k)
    {
      smooth[k] /= sum;
      first[k] /= first[k] > 0 ? firstUp : firstDown;
      second[k] /= second[k] > 0 ? secondUp : secondDown;
    }
    largest = std::pow(HyAb(HuntLab({ 0, 1, 0 }), HuntLab({ 0, 0, 1 })), 0.7);
  }
};

const Tables& Constants() noexcept
{
  static const Tables tables;
  return tables;
}

double Unit(double v)
{
  return std::min(std::max(v, 0.), 1.);
}

double Tone(double x)
{
  x = std::max(x, 0.);
  // Far up the curve has reached its limit; x^2 must not overflow on the way.
  return x > 1e12 ? 1. : (0.9036 * x * x + 0.018 * x) / (0.8748 * x * x + 0.354 * x + 0.14);
}
}

void FlipDecode(const ImageIn& image, bool tone, double exposure, const FlipImage& out, int y0, int y1) noexcept
{
  const std::size_t plane = out.planeSize();
  const double scale = tone ? std::exp2(exposure) : 1.;
  for (int y = y0; y < y1; ++y)
    for (int x = 0; x < out.width; ++x)
    {
      const float* p = image.at(image.extent.x0 + x, image.extent.y0 + y);
      Vec3d c;
      for (int k = 0; k < 3; ++k)
        c[k] = Unit(tone ? Tone(scale * p[k]) : p[k]);
      Vec3d v = Times(ToXyz, c);
      v.x /= WhiteX;
      v.z /= WhiteZ;
      const std::size_t i = std::size_t(y) * out.width + x;
      out.decoded[i] = 116 * v.y - 16;
      out.decoded[i + plane] = 500 * (v.x - v.y);
      out.decoded[i + 2 * plane] = 200 * (v.y - v.z);
    }
}

void FlipRow(const FlipImage& image, int y0, int y1) noexcept
{
  const Tables& t = Constants();
  const std::size_t plane = image.planeSize();
  const int source[4] = { 0, 1, 2, 2 };
  for (int y = y0; y < y1; ++y)
    for (int x = 0; x < image.width; ++x)
    {
      const std::size_t row = std::size_t(y) * image.width, i = row + x;
      double s[FlipImage::Rows] = { 0, 0, 0, 0, 0, 0, 0 };
      for (int d = -ColorRadius; d <= ColorRadius; ++d)
      {
        const int u = std::min(std::max(x + d, 0), image.width - 1);
        for (int k = 0; k < 4; ++k)
          s[k] += t.csf[k][d + ColorRadius] * image.decoded[source[k] * plane + row + u];
      }
      for (int d = -FeatureRadius; d <= FeatureRadius; ++d)
      {
        const int u = std::min(std::max(x + d, 0), image.width - 1);
        const double v = (image.decoded[row + u] + 16) / 116;
        s[4] += t.smooth[d + FeatureRadius] * v;
        s[5] += t.first[d + FeatureRadius] * v;
        s[6] += t.second[d + FeatureRadius] * v;
      }
      for (int k = 0; k < FlipImage::Rows; ++k)
        image.rows[k * plane + i] = s[k];
    }
}

void FlipColumn(const FlipImage& image, int y0, int y1) noexcept
{
  const Tables& t = Constants();
  const std::size_t plane = image.planeSize();
  for (int y = y0; y < y1; ++y)
    for (int x = 0; x < image.width; ++x)
    {
      double s[4] = { 0, 0, 0, 0 }, dx = 0, dy = 0, dxx = 0, dyy = 0;
      for (int d = -ColorRadius; d <= ColorRadius; ++d)
      {
        const std::size_t i = std::size_t(std::min(std::max(y + d, 0), image.height - 1)) * image.width + x;
        for (int k = 0; k < 4; ++k)
          s[k] += t.csf[k][d + ColorRadius] * image.rows[k * plane + i];
      }
      for (int d = -FeatureRadius; d <= FeatureRadius; ++d)
      {
        const std::size_t i = std::size_t(std::min(std::max(y + d, 0), image.height - 1)) * image.width + x;
        const int k = d + FeatureRadius;
        dx += t.smooth[k] * image.rows[5 * plane + i];
        dy += t.first[k] * image.rows[4 * plane + i];
        dxx += t.smooth[k] * image.rows[6 * plane + i];
        dyy += t.second[k] * image.rows[4 * plane + i];
      }
      const double cz = t.share[0] * s[2] + t.share[1] * s[3];
      const double fy = (s[0] + 16) / 116;
      const Vec3d xyz{ (fy + s[1] / 500) * WhiteX, fy, (fy - cz / 200) * WhiteZ };
      Vec3d rgb = Times(t.fromXyz, xyz);
      rgb = { Unit(rgb.x), Unit(rgb.y), Unit(rgb.z) };
      const Vec3d lab = HuntLab(rgb);
      const std::size_t i = std::size_t(y) * image.width + x;
      image.final[i] = lab.x;
      image.final[plane + i] = lab.y;
      image.final[2 * plane + i] = lab.z;
      image.final[3 * plane + i] = std::hypot(dx, dy);
      image.final[4 * plane + i] = std::hypot(dxx, dyy);
    }
}

double FlipPixel(const FlipImage& test, const FlipImage& reference, int x, int y) noexcept
{
  const Tables& t = Constants();
  const std::size_t plane = test.planeSize(), i = std::size_t(y) * test.width + x;
  const double* a = test.final + i;
  const double* b = reference.final + i;
  double color = std::pow(HyAb({ a[0], a[plane], a[2 * plane] }, { b[0], b[plane], b[2 * plane] }), 0.7);
  const double knee = 0.4 * t.largest;
  color = color < knee ? color * 0.95 / knee : 0.95 + (color - knee) / (0.6 * t.largest) * 0.05;
  const double feature =
    std::sqrt(std::max(std::fabs(a[3 * plane] - b[3 * plane]), std::fabs(a[4 * plane] - b[4 * plane])) / std::sqrt(2.));
  return Unit(std::pow(Unit(color), 1 - Unit(feature)));
}

FlipExposures FlipExposureRange(double largest, double median, double smallest) noexcept
{
  FlipExposures e;
  if (!(largest > 0))
    return e;
  // The x where the tone curve gives 0.85: the positive root of A x^2 + B x + C.
  const double a = 0.9036 - 0.85 * 0.8748, b = 0.018 - 0.85 * 0.354, c = -0.85 * 0.14;
  const double x = -0.5 * b / a + std::sqrt(0.25 * b * b / (a * a) - c / a);
  e.start = std::log2(x / largest);
  e.stop = std::log2(x / (median > 0 ? median : smallest));
  e.count = int(std::max(2., std::min(std::ceil(e.stop - e.start), 64.)));
  return e;
}
}
