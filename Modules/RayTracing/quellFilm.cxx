// SPDX-License-Identifier: BSD-3-Clause
#include "quellFilm.h"

#include "quellEmbreeScene.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace quell
{
namespace
{
/// n of "bouncen"; 0: another name.
int BounceOf(const std::string& array)
{
  if (array.compare(0, 6, "bounce") != 0 || array.size() < 7 || array.size() > 8 || array[6] == '0')
    return 0;
  int n = 0;
  for (std::size_t i = 6; i < array.size(); ++i)
  {
    if (array[i] < '0' || array[i] > '9')
      return 0;
    n = 10 * n + (array[i] - '0');
  }
  return n <= PathSample::MaximumBounceLayers ? n : 0;
}

void Sum(double* to, const Vec3f& v) noexcept
{
  to[0] += double(v.x);
  to[1] += double(v.y);
  to[2] += double(v.z);
}
void Sum(double* to, const Vec3d& v) noexcept
{
  to[0] += v.x;
  to[1] += v.y;
  to[2] += v.z;
}
/// Squares of extreme light that a float cannot hold stay finite.
float Largest(double v) noexcept
{
  return float(std::min(v, double(std::numeric_limits<float>::max())));
}
/// Welford's update of the mean (3) and the summed squared deviation (1) of a triple.
void Spread(double* to, const Vec3f& v, int count) noexcept
{
  double squares = 0;
  for (int c = 0; c < 3; ++c)
  {
    const double delta = double(v[c]) - to[c];
    to[c] += delta / count;
    squares += delta * (double(v[c]) - to[c]);
  }
  to[3] += squares;
}
}

Film::Film(const Rect& region, const std::set<std::string>& arrays, std::vector<double> memory)
  : Area(region)
{
  int next = 0;
  const auto take = [&next](int& slot, int count)
  {
    if (slot < 0)
    {
      slot = next;
      next += count;
    }
  };
  Slots& o = this->Offsets;
  const auto light = [this](bool emission, bool direct, bool indirect)
  {
    this->Lights[0] |= emission;
    this->Lights[1] |= direct;
    this->Lights[2] |= indirect;
  };
  for (const std::string& a : arrays)
    this->Bounces = std::max(this->Bounces, BounceOf(a));
  for (const std::string& a : arrays)
  {
    if (a == "radiance")
      take(o.Radiance, 3), light(true, true, true);
    else if (a == "emission")
      take(o.Emission, 3), light(true, false, false);
    else if (a == "direct")
      take(o.Direct, 3), light(false, true, false);
    else if (a == "indirect")
      take(o.Indirect, 3), light(false, false, true);
    else if (a == "directDiffuse" || a == "directSpecular")
    {
      if (a == "directSpecular")
        take(o.Direct, 3);
      take(o.DirectDiffuse, 3), light(false, true, false);
    }
    else if (a == "indirectDiffuse" || a == "indirectSpecular")
    {
      if (a == "indirectSpecular")
        take(o.Indirect, 3);
      take(o.IndirectDiffuse, 3), light(false, false, true);
    }
    else if (const int n = BounceOf(a))
      take(o.Bounces, 3 * this->Bounces), light(false, n == 1, n > 1);
    else if (a == "halfA")
      take(o.HalfA, 3), take(o.HalfB, 3), light(true, true, true);
    else if (a == "halfB")
      take(o.HalfB, 3), take(o.HalfA, 3), light(true, true, true);
    else if (a == "variance" || a == "moments")
      take(o.Luminance, 2), light(true, true, true);
    else if (a == "albedo")
      take(o.Albedo, 3);
    else if (a == "albedoDiffuse")
      take(o.AlbedoDiffuse, 3);
    else if (a == "albedoSpecular")
      take(o.AlbedoSpecular, 3);
    else if (a == "normal")
      take(o.Normal, 3);
    else if (a == "roughness")
      take(o.Roughness, 1);
    else if (a == "varianceAlbedo")
      take(o.AlbedoSpread, 4);
    else if (a == "varianceNormal")
      take(o.NormalSpread, 4);
    else if (a == "depth")
      take(o.Hits, 1), take(o.Depth, 1);
    else if (a == "position")
      take(o.Hits, 1), take(o.Position, 3);
    else if (a == "normalGeometric")
      take(o.Hits, 1), take(o.NormalGeometric, 3);
    else if (a == "motion")
      take(o.Hits, 1), take(o.Motion, 4);
    else if (a == "id")
      take(o.Hits, 1), take(o.Id, 1);
    else if (a == "material")
      take(o.Hits, 1), take(o.Material, 1);
    else if (a == "alpha")
      take(o.Hits, 1);
    else if (a == "hitDistance")
      take(o.HitDistance, 2);
    else if (a != "samples")
      throw std::invalid_argument("the film keeps no array \"" + a + "\"");
  }
  this->Stride = next;
  const std::size_t size = std::size_t(region.area()) * std::size_t(next);
  this->Claim = PixelMemoryClaim(std::uint64_t(size) * sizeof(double), "sums of the path tracer");
  if (memory.size() != size)
  {
    memory = std::vector<double>(); // goes before more is taken
    memory.resize(size);
  }
  this->Sums = std::move(memory);
}

void Film::Clear(const Rect& part) noexcept
{
  for (int y = part.y0; y<part.y1&& this->Stride> 0; ++y)
    std::fill_n(this->Record(part.x0, y), std::size_t(part.width()) * std::size_t(this->Stride), 0.);
}

bool Film::WantsLight() const
{
  return this->Lights[0] || this->Lights[1] || this->Lights[2];
}

bool Film::WantsGuides() const
{
  const Slots& o = this->Offsets;
  return o.Albedo >= 0 || o.AlbedoDiffuse >= 0 || o.AlbedoSpecular >= 0 || o.Normal >= 0 || o.Roughness >= 0 ||
         o.AlbedoSpread >= 0 || o.NormalSpread >= 0;
}

void Film::Add(int x, int y, int index, const PathSample& s, bool guides) noexcept
{
  if (this->Stride == 0)
    return;
  double* r = this->Record(x, y);
  const Slots& o = this->Offsets;
  if (o.Radiance >= 0 || o.HalfA >= 0 || o.Luminance >= 0)
  {
    const Vec3d sum = Vec3d(s.Emission) + Vec3d(s.Direct) + Vec3d(s.Indirect);
    if (o.Radiance >= 0)
      Sum(r + o.Radiance, sum);
    if (o.HalfA >= 0)
      Sum(r + (index % 2 == 0 ? o.HalfA : o.HalfB), sum);
    if (o.Luminance >= 0)
    {
      const double luminance = Luminance(sum), delta = luminance - r[o.Luminance];
      r[o.Luminance] += delta / (index + 1);
      r[o.Luminance + 1] += delta * (luminance - r[o.Luminance]);
    }
  }
  if (o.Emission >= 0)
    Sum(r + o.Emission, s.Emission);
  if (o.Direct >= 0)
    Sum(r + o.Direct, s.Direct);
  if (o.Indirect >= 0)
    Sum(r + o.Indirect, s.Indirect);
  if (o.DirectDiffuse >= 0)
    Sum(r + o.DirectDiffuse, s.DirectDiffuse);
  if (o.IndirectDiffuse >= 0)
    Sum(r + o.IndirectDiffuse, s.IndirectDiffuse);
  for (int b = 0; o.Bounces >= 0 && b < this->Bounces; ++b)
    Sum(r + o.Bounces + 3 * b, s.Bounces[b]);
  if (o.HitDistance >= 0 && s.HitDistance >= 0)
  {
    r[o.HitDistance] += double(s.HitDistance);
    r[o.HitDistance + 1] += 1;
  }
  if (guides)
    this->AddGuides(x, y, index, s);
  if (o.Hits < 0)
    return;
  if (o.Motion >= 0)
  {
    r[o.Motion + (s.Hit ? 0 : 2)] += s.Motion.x;
    r[o.Motion + (s.Hit ? 1 : 3)] += s.Motion.y;
  }
  if (!s.Hit)
    return;
  if (r[o.Hits] == 0)
  {
    if (o.Id >= 0)
      r[o.Id] = s.Id;
    if (o.Material >= 0)
      r[o.Material] = s.Material;
  }
  r[o.Hits] += 1;
  if (o.Depth >= 0)
    r[o.Depth] += s.Depth;
  if (o.Position >= 0)
    Sum(r + o.Position, s.Position);
  if (o.NormalGeometric >= 0)
    Sum(r + o.NormalGeometric, s.NormalGeometric);
}

void Film::AddGuides(int x, int y, int index, const PathSample& s) noexcept
{
  if (!this->WantsGuides())
    return;
  double* r = this->Record(x, y);
  const Slots& o = this->Offsets;
  if (o.Albedo >= 0)
    Sum(r + o.Albedo, s.Albedo);
  if (o.AlbedoDiffuse >= 0)
    Sum(r + o.AlbedoDiffuse, s.AlbedoDiffuse);
  if (o.AlbedoSpecular >= 0)
    Sum(r + o.AlbedoSpecular, s.AlbedoSpecular);
  if (o.Normal >= 0)
    Sum(r + o.Normal, s.Normal);
  if (o.Roughness >= 0)
    r[o.Roughness] += double(s.Roughness);
  if (o.AlbedoSpread >= 0)
    Spread(r + o.AlbedoSpread, s.Albedo, index + 1);
  if (o.NormalSpread >= 0)
    Spread(r + o.NormalSpread, s.Normal, index + 1);
}

void PathSample::Guide(const SurfacePoint& point, float cosine) noexcept
{
  if (MaxComponent(point.DisplayOnly) > 0)
  {
    this->Albedo = this->AlbedoDiffuse = point.DisplayOnly;
    this->AlbedoSpecular = Vec3f();
  }
  else
  {
    this->Albedo = point.Material.Albedo(cosine);
    this->AlbedoDiffuse = point.Material.AlbedoDiffuse(cosine);
    this->AlbedoSpecular = point.Material.AlbedoSpecular(cosine);
  }
  this->Normal = point.Normals.Shading;
  this->Roughness = point.Roughness;
}

void Film::Develop(const std::string& array, const Rect& part, int samples, const ImageOut& out, int guideSamples) const
{
  if (guideSamples > 0)
    for (const char* guide :
      { "albedo", "albedoDiffuse", "albedoSpecular", "normal", "roughness", "varianceAlbedo", "varianceNormal" })
      if (array == guide)
        samples = guideSamples;

  const Slots& o = this->Offsets;
  const double n = samples > 0 ? 1. / samples : 0;
  const auto each = [&](auto&& pixel)
  {
    for (int y = part.y0; y < part.y1; ++y)
      for (int x = part.x0; x < part.x1; ++x)
        pixel(out.at(x, y), this->Record(x, y));
  };
  const auto mean3 = [&](int slot)
  {
    each(
      [&](float* p, const double* r)
      {
        for (int c = 0; c < 3; ++c)
          p[c] = float(r[slot + c] * n);
      });
  };
  const auto mean1 = [&](int slot) { each([&](float* p, const double* r) { *p = float(r[slot] * n); }); };
  const auto unit = [&](int slot)
  {
    each(
      [&](float* p, const double* r)
      {
        const Vec3d v = Normalized(Vec3d(r[slot], r[slot + 1], r[slot + 2]));
        for (int c = 0; c < 3; ++c)
          p[c] = float(v[c]);
      });
  };
  // the part of `whole` that is not diffuse: what is left, never below 0 by rounding
  const auto rest = [&](int whole, int diffuse)
  {
    each(
      [&](float* p, const double* r)
      {
        for (int c = 0; c < 3; ++c)
          p[c] = float(std::max(0., r[whole + c] - r[diffuse + c]) * n);
      });
  };
  const auto half = [&](int slot, int other, int count, int others)
  {
    // with one sample both halves are that sample
    const int from = count > 0 ? slot : other;
    const double scale = 1. / std::max(1, count > 0 ? count : others);
    each(
      [&](float* p, const double* r)
      {
        for (int c = 0; c < 3; ++c)
          p[c] = float(r[from + c] * scale);
      });
  };
  const double variance = samples > 1 ? n / (samples - 1) : 0;
  const int odd = samples / 2, even = samples - odd;
  if (array == "radiance")
    mean3(o.Radiance);
  else if (array == "emission")
    mean3(o.Emission);
  else if (array == "direct")
    mean3(o.Direct);
  else if (array == "indirect")
    mean3(o.Indirect);
  else if (array == "directDiffuse")
    mean3(o.DirectDiffuse);
  else if (array == "indirectDiffuse")
    mean3(o.IndirectDiffuse);
  else if (array == "directSpecular")
    rest(o.Direct, o.DirectDiffuse);
  else if (array == "indirectSpecular")
    rest(o.Indirect, o.IndirectDiffuse);
  else if (const int b = BounceOf(array))
    mean3(o.Bounces + 3 * (b - 1));
  else if (array == "halfA")
    half(o.HalfA, o.HalfB, even, odd);
  else if (array == "halfB")
    half(o.HalfB, o.HalfA, odd, even);
  else if (array == "variance")
    each([&](float* p, const double* r) { *p = Largest(r[o.Luminance + 1] * variance); });
  else if (array == "moments")
    each(
      [&](float* p, const double* r)
      {
        p[0] = float(r[o.Luminance]);
        p[1] = Largest(r[o.Luminance + 1] * n);
      });
  else if (array == "albedo")
    mean3(o.Albedo);
  else if (array == "albedoDiffuse")
    mean3(o.AlbedoDiffuse);
  else if (array == "albedoSpecular")
    mean3(o.AlbedoSpecular);
  else if (array == "normal")
    unit(o.Normal);
  else if (array == "roughness")
    mean1(o.Roughness);
  else if (array == "varianceAlbedo")
    each([&](float* p, const double* r) { *p = float(r[o.AlbedoSpread + 3] / 3 * variance); });
  else if (array == "varianceNormal")
    each([&](float* p, const double* r) { *p = float(r[o.NormalSpread + 3] / 3 * variance); });
  else if (array == "samples")
    each([&](float* p, const double*) { *p = float(samples); });
  else if (array == "alpha")
    mean1(o.Hits);
  else if (array == "depth")
    each([&](float* p, const double* r)
      { *p = r[o.Hits] > 0 ? float(r[o.Depth] / r[o.Hits]) : std::numeric_limits<float>::infinity(); });
  else if (array == "position")
    each(
      [&](float* p, const double* r)
      {
        for (int c = 0; c < 3; ++c)
          p[c] = r[o.Hits] > 0 ? float(r[o.Position + c] / r[o.Hits]) : 0;
      });
  else if (array == "normalGeometric")
    unit(o.NormalGeometric);
  else if (array == "motion")
    each(
      [&](float* p, const double* r)
      {
        const bool hit = r[o.Hits] > 0;
        const double scale = hit ? 1 / r[o.Hits] : n;
        p[0] = float(r[o.Motion + (hit ? 0 : 2)] * scale);
        p[1] = float(r[o.Motion + (hit ? 1 : 3)] * scale);
      });
  else if (array == "id")
    each([&](float* p, const double* r) { *p = float(r[o.Id]); });
  else if (array == "material")
    each([&](float* p, const double* r) { *p = float(r[o.Material]); });
  else if (array == "hitDistance")
    each(
      [&](float* p, const double* r)
      {
        const double count = r[o.HitDistance + 1];
        *p = count > 0 ? float(r[o.HitDistance] / count) : std::numeric_limits<float>::infinity();
      });
  else
    throw std::invalid_argument("the film keeps no array \"" + array + "\"");
}
}
