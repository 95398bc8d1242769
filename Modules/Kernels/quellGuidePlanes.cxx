// SPDX-License-Identifier: BSD-3-Clause
#include "quellGuidePlanes.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
constexpr float Inf = std::numeric_limits<float>::infinity();
constexpr float LargestVariance = 1e36f;

/// sqrt(log2(e) / 2) / sigma; 0 turns into 2^60: exact, so that only equal values have a difference of 0.
double FeatureScale(double sigma) noexcept
{
  return sigma > 1e-17 ? std::sqrt(0.5 * 1.4426950408889634) / sigma : 1152921504606846976.;
}

float Scaled(double v, double scale) noexcept
{
  v *= scale;
  return float(v > 1e38 ? 1e38 : v < -1e38 ? -1e38 : v); // NaN stays
}

double LogDepth(float z) noexcept
{
  return std::log(z > 1e-30f ? double(z) : 1e-30);
}

float Clean(float v) noexcept
{
  return v > 0 ? std::min(v, LargestVariance) : 0.f;
}
}

float ReadCleanVariance(const ImageIn& image, int x, int y) noexcept
{
  const float v = *image.at(x, y);
  if (Finite(v))
    return Clean(v);
  float mean = 0;
  FillFromNeighbours<1>(image.extent, x, y, &mean,
    [&image](int qx, int qy, float* out)
    {
      const float q = *image.at(qx, qy);
      *out = Clean(q);
      return Finite(q);
    });
  return mean;
}

bool GuideCounts(const GuidedInputs& in, int qx, int qy) noexcept
{
  return in.color.inside(qx, qy) && Finite3(in.color.at(qx, qy)) && (!in.depth || Finite(*in.depth.at(qx, qy)));
}

double GuideExponentBetween(const GuidedInputs& in, int x, int y, const GuidedInputs& other, int qx, int qy) noexcept
{
  double e = 0;
  const auto add = [&e](double a, double b, double sigma)
  {
    if (std::isfinite(a) && std::isfinite(b) && a != b)
      e += sigma > 1e-17 ? (a - b) * (a - b) / (2 * sigma * sigma) : 1e300;
  };
  for (int k = 0; k < 3; ++k)
  {
    if (in.normal && in.sigmaNormal < GuidedInputs::Off)
      add(in.normal.at(x, y)[k], other.normal.at(qx, qy)[k], in.sigmaNormal);
    if (in.albedo && in.sigmaAlbedo < GuidedInputs::Off)
      add(in.albedo.at(x, y)[k], other.albedo.at(qx, qy)[k], in.sigmaAlbedo);
  }
  if (in.depth && in.sigmaDepth < GuidedInputs::Off)
    add(LogDepth(*in.depth.at(x, y)), LogDepth(*other.depth.at(qx, qy)), in.sigmaDepth);
  if (in.id)
    add(*in.id.at(x, y), *other.id.at(qx, qy), 0);
  return e;
}

float* FillGuidedTile(
  const GuidedInputs& in, GuidedTile& t, float* scratch, const Rect& counted, std::int64_t& bad) noexcept
{
  const Rect& e = t.layout.extent;
  const std::size_t size = t.layout.size();
  const auto next = [&scratch, size](float fill)
  {
    float* plane = scratch;
    std::fill(plane, plane + size, fill);
    scratch += size;
    return plane;
  };
  const auto forEach = [&](auto&& body)
  {
    for (int y = e.y0; y < e.y1; ++y)
    {
      const auto row = t.layout.at(e.x0, y);
      for (int x = e.x0; x < e.x1; ++x)
        body(x, y, row + (x - e.x0));
    }
  };
  // Lanes right of the last pixel and taps beyond the frame read padding: no weight, and numbers.
  for (float*& plane : t.color)
    plane = next(0.f);
  t.penalty = next(Inf);
  t.variance = in.variance ? next(0.f) : nullptr;
  t.features = 0;
  t.gaps = false;
  forEach(
    [&](int x, int y, std::ptrdiff_t i)
    {
      float c[3];
      const bool good = ReadFilled(in.color, x, y, c);
      for (int k = 0; k < 3; ++k)
        t.color[k][i] = c[k];
      bad += !good && counted.contains(x, y);
      t.penalty[i] = good && (!in.depth || Finite(*in.depth.at(x, y))) ? 0.f : Inf;
      if (in.variance)
        t.variance[i] = ReadCleanVariance(in.variance, x, y);
    });
  // One plane per component of a guide; `value` returns what is compared, NaN for "no data".
  const auto addFeature = [&](double sigma, auto&& value)
  {
    float* plane = t.feature[t.features++] = next(0.f);
    const double scale = FeatureScale(sigma);
    forEach(
      [&](int x, int y, std::ptrdiff_t i)
      {
        plane[i] = Scaled(value(x, y), scale);
        t.gaps |= plane[i] != plane[i];
      });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto component = [nan](const ImageIn& image, int k)
  {
    return [&image, k, nan](int x, int y)
    {
      const float v = image.at(x, y)[k];
      return Finite(v) ? double(v) : nan;
    };
  };
  if (in.normal && in.sigmaNormal < GuidedInputs::Off)
    for (int k = 0; k < 3; ++k)
      addFeature(in.sigmaNormal, component(in.normal, k));
  if (in.albedo && in.sigmaAlbedo < GuidedInputs::Off)
    for (int k = 0; k < 3; ++k)
      addFeature(in.sigmaAlbedo, component(in.albedo, k));
  if (in.depth && in.sigmaDepth < GuidedInputs::Off)
    addFeature(in.sigmaDepth,
      [&](int x, int y)
      {
        const float z = *in.depth.at(x, y);
        if (!Finite(z))
          return nan;
        // "Only equal" is asked of the depths themselves: different ones may share a logarithm in float.
        return in.sigmaDepth > 0 ? LogDepth(z) : double(z);
      });
  if (in.id)
    addFeature(0, component(in.id, 0));
  return scratch;
}
}
