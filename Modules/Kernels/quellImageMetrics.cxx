// SPDX-License-Identifier: BSD-3-Clause
#include "quellImageMetrics.h"

#include <cmath>

namespace quell
{
namespace
{
double Value(PixelError kind, double t, double r)
{
  const double d = t - r;
  switch (kind)
  {
    case PixelError::Squared:
      return d * d;
    case PixelError::Absolute:
      return std::fabs(d);
    case PixelError::RelativeSquared:
      return d * d / (r * r + 0.01);
    case PixelError::Mrse:
      return d == 0 ? 0 : d * d / ((r + 0.01) * (r + 0.01));
    case PixelError::Smape:
      return std::fabs(d) / (std::fabs(t) + std::fabs(r) + 0.01);
    case PixelError::SquaredToned:
    {
      const double e = ToneForMetrics(t) - ToneForMetrics(r);
      return e * e;
    }
    case PixelError::SquaredClamped:
    {
      const double e = ClampForMetrics(t) - ClampForMetrics(r);
      return e * e;
    }
  }
  return 0;
}
}

double ClampForMetrics(double c) noexcept
{
  return std::min(std::max(c, 0.), 1.);
}

double ToneForMetrics(double c) noexcept
{
  const double x = c > 0 ? c / (1 + c) : 0;
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

double PixelErrorAt(PixelError kind, const ImageIn& test, const ImageIn& reference, int x, int y) noexcept
{
  const float* t = test.at(test.extent.x0 + x, test.extent.y0 + y);
  const float* r = reference.at(reference.extent.x0 + x, reference.extent.y0 + y);
  double sum = 0;
  for (int c = 0; c < test.components; ++c)
    sum += Value(kind, t[c], r[c]);
  return sum / test.components;
}

double ErrorRowSum(PixelError kind, const ImageIn& test, const ImageIn& reference, int y) noexcept
{
  double sum = 0;
  for (int x = 0; x < test.extent.width(); ++x)
    sum += PixelErrorAt(kind, test, reference, x, y);
  return sum;
}

double TrimmedSum(const double* errors, double* scratch, std::int64_t count, std::int64_t leftOut) noexcept
{
  double sum = 0;
  if (leftOut >= count)
    return sum;
  if (leftOut <= 0)
  {
    for (std::int64_t i = 0; i < count; ++i)
      sum += errors[i];
    return sum;
  }
  std::copy(errors, errors + count, scratch);
  const std::int64_t kept = count - leftOut;
  std::nth_element(scratch, scratch + (kept - 1), scratch + count);
  // Everything below the largest kept value, in pixel order, and as many of its equals as fit.
  const double limit = scratch[kept - 1];
  std::int64_t below = 0;
  for (std::int64_t i = 0; i < count; ++i)
    if (errors[i] < limit)
    {
      sum += errors[i];
      ++below;
    }
  return sum + limit * double(kept - below);
}

std::int64_t CountNonFinite(const ImageIn& image, int& firstX, int& firstY) noexcept
{
  std::int64_t count = 0;
  for (int y = 0; y < image.extent.height(); ++y)
    for (int x = 0; x < image.extent.width(); ++x)
    {
      const float* p = image.at(image.extent.x0 + x, image.extent.y0 + y);
      bool finite = true;
      for (int c = 0; c < image.components; ++c)
        finite = finite && std::isfinite(p[c]);
      if (finite)
        continue;
      if (count++ == 0)
      {
        firstX = x;
        firstY = y;
      }
    }
  return count;
}
}
