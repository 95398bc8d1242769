// SPDX-License-Identifier: BSD-3-Clause
// Small images and the planar set-up of the SVGF kernels, as stages do it.
#ifndef TestPlanes_h
#define TestPlanes_h

#include "quellATrous.h"
#include "quellSimd.h"
#include "quellVariance.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

namespace quelltest
{
constexpr float Inf = std::numeric_limits<float>::infinity();
constexpr float NaN = std::numeric_limits<float>::quiet_NaN();

/// An owning image over any rectangle of the frame.
struct Image
{
  quell::Rect extent;
  int components = 0;
  std::vector<float> data;

  Image() = default;
  Image(const quell::Rect& e, int c, float v = 0)
    : extent(e)
    , components(c)
    , data(e.area() * c, v)
  {
  }
  float* at(int x, int y) { return quell::ImageOut(*this).at(x, y); }
  const float* at(int x, int y) const { return quell::ImageIn(*this).at(x, y); }
  void fill(int x, int y, float v)
  {
    for (int c = 0; c < this->components; ++c)
      this->at(x, y)[c] = v;
  }
  operator quell::ImageOut()
  {
    return this->data.empty() ? quell::ImageOut() : quell::ImageOut(this->data.data(), this->components, this->extent);
  }
  operator quell::ImageIn() const
  {
    return this->data.empty() ? quell::ImageIn() : quell::ImageIn(this->data.data(), this->components, this->extent);
  }
  bool operator==(const Image& o) const
  {
    return this->extent == o.extent && this->data.size() == o.data.size() &&
           std::memcmp(this->data.data(), o.data.data(), this->data.size() * sizeof(float)) == 0;
  }
};

/// Random floats in [0, 1) that depend on the seed alone.
struct Random
{
  std::uint32_t state;
  explicit Random(std::uint32_t seed)
    : state(seed * 747796405u + 2891336453u)
  {
  }
  float operator()()
  {
    this->state = this->state * 747796405u + 2891336453u;
    const std::uint32_t w = ((this->state >> ((this->state >> 28) + 4)) ^ this->state) * 277803737u;
    return float(((w >> 22) ^ w) >> 8) * 0x1p-24f;
  }
};

/// A noisy scene with everything in it: background, depth and normal edges, slopes, ids, fireflies.
struct Scene
{
  Image color, variance, depth, normal, id, moments, history, albedo, position;
  explicit Scene(int w, int h, std::uint32_t seed = 1)
  {
    const quell::Rect e{ 0, 0, w, h };
    color = Image(e, 3), variance = Image(e, 1), depth = Image(e, 1), normal = Image(e, 3), id = Image(e, 1);
    moments = Image(e, 2), history = Image(e, 1), albedo = Image(e, 3), position = Image(e, 3);
    Random u(seed);
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x)
      {
        const bool sky = x > w * 3 / 4 && y > h * 2 / 3, second = x > w / 2;
        const float base = second ? 3.f : 0.4f;
        for (int c = 0; c < 3; ++c)
          color.at(x, y)[c] = base * (0.2f + 1.6f * u()) * (u() < 0.01f ? 50.f : 1.f);
        *variance.at(x, y) = base * base * 0.2f * u();
        *depth.at(x, y) = sky ? Inf : second ? 9.f + 0.02f * y : 4.f + 0.01f * x + 0.03f * y;
        const float a = second ? 0.6f + 0.002f * y : 0.1f * std::sin(0.2f * x);
        normal.at(x, y)[0] = sky ? 0.f : std::sin(a);
        normal.at(x, y)[2] = sky ? 0.f : std::cos(a);
        *id.at(x, y) = sky ? 0.f : second ? 2.f : 1.f;
        moments.at(x, y)[0] = base * (0.5f + u());
        moments.at(x, y)[1] = base * base * 0.3f * u();
        *history.at(x, y) = float(int(u() * 9));
        for (int c = 0; c < 3; ++c)
          albedo.at(x, y)[c] = ((x / 4 + y / 4) & 1) ? 0.8f : 0.1f + 0.2f * c;
        for (int c = 0; c < 3 && !sky; ++c)
          position.at(x, y)[c] = c == 2 ? -*depth.at(x, y) : 0.01f * (c ? y : x) * *depth.at(x, y);
      }
  }
};

/// Planes for a-trous or variance, filled from images as a stage fills them.
struct Planes
{
  quell::GuidePlanes guides;
  quell::ColorPlanes in, out;
  quell::MomentPlanes moments;
  std::int64_t bad = 0;
  std::vector<float> memory;

  Planes(const quell::Rect& e, int reach, const quell::ImageIn& color, const quell::ImageIn& variance,
    const quell::ImageIn& depth = {}, const quell::ImageIn& normal = {}, const quell::ImageIn& id = {},
    const quell::ImageIn& momentImage = {}, const quell::ImageIn& history = {}, const quell::ImageIn& meanRest = {})
  {
    guides.layout = quell::PlaneLayout(e, reach);
    // Not-a-number everywhere: whatever nobody filled shows.
    memory.assign(guides.layout.size() * 23, NaN);
    float* next = memory.data();
    const auto plane = [&](bool used)
    {
      float* p = used ? next : nullptr;
      next += used ? guides.layout.size() : 0;
      return p;
    };
    guides.depth = plane(true), guides.slopeX = plane(true), guides.slopeY = plane(true);
    for (float*& p : guides.normal)
      p = plane(bool(normal));
    guides.id = plane(bool(id));
    for (quell::ColorPlanes* c : { &in, &out })
    {
      for (float*& p : c->color)
        p = plane(true);
      c->luminance = plane(true);
      c->variance = plane(bool(variance));
    }
    quell::CopyGuides(depth, normal, id, guides, e.y0, e.y1);
    quell::CopySlopes(guides, e.y0, e.y1);
    bad = quell::CopyColor(color, variance, guides, in, e.y0, e.y1, e);
    quell::ClearPadding(guides.layout, out, e.y0, e.y1);
    if (momentImage || history)
    {
      moments.mean = plane(bool(momentImage)), moments.central = plane(bool(momentImage)),
      moments.history = plane(true);
      moments.rest = plane(bool(meanRest));
      quell::CopyMoments(momentImage, history, meanRest, guides.layout, in, moments, 4, e.y0, e.y1);
    }
    if (!out.variance)
      out.variance = plane(true);
    if (!variance)
      atrousOut = out, atrousOut.variance = nullptr;
    else
      atrousOut = out;
  }
  quell::ColorPlanes atrousOut;

  quell::ATrousPass pass(int step) const
  {
    quell::ATrousPass p;
    p.guides = guides, p.in = in, p.out = atrousOut, p.step = step;
    return p;
  }
  quell::VariancePass variancePass() const
  {
    quell::VariancePass p;
    p.guides = guides, p.in = in, p.out = out, p.moments = moments;
    return p;
  }
};

/// Every target in turn, then back to the best.
template <class F>
void ForEachTarget(F&& body)
{
  for (const quell::SimdTarget& target : quell::SimdTargets())
  {
    quell::ForceSimdTarget(target.Id);
    body(target.Name);
  }
  quell::ForceSimdTarget(0);
}

/// Largest relative difference (to the larger magnitude plus `floor`) and mean of 2|a-b|/(|a|+|b|).
struct Difference
{
  double relative = 0, smape = 0;
};
inline Difference Compare(const std::vector<float>& a, const std::vector<float>& b, double floor = 1e-20)
{
  Difference d;
  for (size_t i = 0; i < a.size(); ++i)
  {
    if (std::memcmp(&a[i], &b[i], sizeof(float)) == 0)
      continue;
    const double e = std::fabs(double(a[i]) - b[i]), m = std::fabs(double(a[i])) + std::fabs(double(b[i]));
    if (!(e >= 0)) // only one of them is a number
      return { 1e300, 1e300 };
    d.relative = std::max(d.relative, e / (0.5 * m + floor));
    d.smape += 2 * e / (m + floor);
  }
  d.smape /= double(a.size() ? a.size() : 1);
  return d;
}
}

#endif
