// SPDX-License-Identifier: BSD-3-Clause
#include "quellBenchFrame.h"

#include "quellVector.h"

#include <cmath>
#include <cstdint>
#include <limits>

namespace quell
{
namespace
{
constexpr int Balls = 12;

float Draw(int x, int y, int tick, int dimension)
{
  std::uint32_t v =
    std::uint32_t(x) * 73856093u ^ std::uint32_t(y) * 19349663u ^ std::uint32_t(tick * 16 + dimension) * 83492791u;
  v = (v ^ (v >> 16)) * 0x7feb352du;
  v = (v ^ (v >> 15)) * 0x846ca68bu;
  v ^= v >> 16;
  return float(v >> 8) * 0x1p-24f;
}

struct Hit
{
  double Distance = std::numeric_limits<double>::infinity();
  Vec3d Point, Normal;
  int Id = 0;
};

Vec3d Center(int i)
{
  return { -3. + 0.55 * i, -1.5 + 0.35 * ((i * 5) % 4), -5. - 0.7 * ((i * 7) % 6) };
}

/// Room: x in [-4, 4], y in [-2, 2.2], back wall at z = -11 with a window.
Hit Cast(const Vec3d& eye, const Vec3d& d)
{
  Hit h;
  const auto wall = [&](double t, const Vec3d& n, int id)
  {
    if (t > 1e-6 && t < h.Distance)
    {
      h.Distance = t;
      h.Point = eye + d * t;
      h.Normal = n;
      h.Id = id;
    }
  };
  wall((-2 - eye.y) / d.y, { 0, 1, 0 }, 1);
  wall((2.2 - eye.y) / d.y, { 0, -1, 0 }, 2);
  wall((-4 - eye.x) / d.x, { 1, 0, 0 }, 3);
  wall((4 - eye.x) / d.x, { -1, 0, 0 }, 4);
  wall((-11 - eye.z) / d.z, { 0, 0, 1 }, 5);
  if (h.Id == 5 && std::fabs(h.Point.x) < 2.4 && h.Point.y > -0.6 && h.Point.y < 1.8)
    h = Hit();
  for (int i = 0; i < Balls; ++i)
  {
    const Vec3d o = eye - Center(i);
    const double r = 0.35 + 0.03 * i, b = Dot(o, d), c = Dot(o, o) - r * r, a = Dot(d, d), q = b * b - a * c;
    if (q <= 0)
      continue;
    const double t = (-b - std::sqrt(q)) / a;
    if (t > 1e-6 && t < h.Distance)
    {
      h.Distance = t;
      h.Point = eye + d * t;
      h.Normal = (h.Point - Center(i)) / r;
      h.Id = 10 + i;
    }
  }
  return h;
}
}

BenchFrame::BenchFrame(int w, int h, int tick)
  : Direct(w, h, 3)
  , Indirect(w, h, 3)
  , Emission(w, h, 3)
  , Illumination(w, h, 3)
  , Variance(w, h, 1)
  , Albedo(w, h, 3)
  , Normal(w, h, 3)
  , Depth(w, h, 1)
  , Id(w, h, 1)
  , Motion(w, h, 2)
  , Position(w, h, 3)
{
  const auto eyeAt = [](int t) { return Vec3d(0.3 * std::sin(0.05 * t), 0.1 * std::cos(0.05 * t), 0); };
  const Vec3d eye = eyeAt(tick), before = eyeAt(tick - 1);
  const double focal = h; // pixels
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const Vec3d d{ (x + 0.5 - 0.5 * w) / focal, (y + 0.5 - 0.5 * h) / focal, -1 };
      const Hit hit = Cast(eye, d);
      *this->Id.at(x, y) = float(hit.Id);
      *this->Depth.at(x, y) = hit.Id ? float(hit.Distance) : std::numeric_limits<float>::infinity();
      if (!hit.Id)
      {
        for (int c = 0; c < 3; ++c)
        {
          this->Albedo.at(x, y)[c] = 1;
          this->Emission.at(x, y)[c] = 2.f + 0.5f * float(c) + 2.f * float(d.y);
        }
        continue;
      }
      const Vec3d& p = hit.Point;
      const bool tile = (int(std::floor(2 * p.x)) + int(std::floor(2 * p.z))) & 1;
      const double falloff = 1 / (1 + 0.05 * (p.z + 8) * (p.z + 8) + 0.1 * p.x * p.x);
      const double lit = std::max(0.05, Dot(hit.Normal, Normalized(Vec3d(0.5, 1.8, -6) - p))) * falloff;
      double luminance = 0;
      for (int c = 0; c < 3; ++c)
      {
        this->Normal.at(x, y)[c] = float(hit.Normal[c]);
        this->Position.at(x, y)[c] = float(p[c]);
        const float albedo = hit.Id == 1 ? (tile ? 0.75f : 0.2f) : 0.3f + 0.5f * float((hit.Id * (c + 3)) % 7) / 6.f;
        this->Albedo.at(x, y)[c] = albedo;
        const float light = float(2 * lit) * -std::log(1 - 0.999f * Draw(x, y, tick, 0)) *
                            (Draw(x, y, tick, 1) < 0.002f ? 30.f : 1.f) * (1.f - 0.1f * float(c));
        const float bounced = 0.5f * -std::log(1 - 0.999f * Draw(x, y, tick, 2)) * (0.8f + 0.1f * float(c));
        this->Illumination.at(x, y)[c] = light;
        this->Direct.at(x, y)[c] = light * albedo;
        this->Indirect.at(x, y)[c] = bounced * albedo;
        luminance += (c == 1 ? .7152 : c ? .0722 : .2126) * 2 * lit;
      }
      *this->Variance.at(x, y) = float(luminance * luminance * (0.5 + Draw(x, y, tick, 3)));
      const double z = before.z - p.z;
      this->Motion.at(x, y)[0] = float((p.x - before.x) / z * focal + 0.5 * w - 0.5 - x);
      this->Motion.at(x, y)[1] = float((p.y - before.y) / z * focal + 0.5 * h - 0.5 - y);
    }
}
}
