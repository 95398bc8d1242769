// SPDX-License-Identifier: BSD-3-Clause
#include "quellLightSampler.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
/// Upper ends of a running sum, scaled to 1; false where the sum is 0. Summed in double: 1e6 small lights add up.
template <class T>
bool MakeCdf(const std::vector<double>& weights, std::vector<T>& cdf, double& total)
{
  total = 0;
  for (double w : weights)
    total += w;
  cdf.resize(weights.size());
  if (!(total > 0) || !std::isfinite(total))
    return false;
  double sum = 0;
  std::size_t last = 0;
  for (std::size_t i = 0; i < weights.size(); ++i)
  {
    sum += weights[i];
    cdf[i] = T(sum / total);
    if (weights[i] > 0)
      last = i;
  }
  for (std::size_t i = last; i < cdf.size(); ++i)
    cdf[i] = 1; // u < 1 never lands on a trailing zero
  return true;
}

/// First entry whose upper end is above u; the remainder of u, rescaled to [0, 1).
template <class T>
std::size_t Pick(const T* cdf, std::size_t n, float u, float& rest) noexcept
{
  const std::size_t i = std::min<std::size_t>(std::size_t(std::upper_bound(cdf, cdf + n, T(u)) - cdf), n - 1);
  const T lo = i > 0 ? cdf[i - 1] : T(0), width = cdf[i] - lo;
  rest = width > 0 ? std::min(0x1.fffffep-1f, float((u - lo) / width)) : 0.5f;
  return i;
}

float Sanitized(float v)
{
  return std::isfinite(v) && v > 0 ? v : 0;
}

/// Solid angle of a row of texels over 2 pi: the difference of the cosines of its edges, without cancellation.
float RowBand(int y, int h)
{
  return 2 * std::sin(Pi * (y + 0.5f) / h) * std::sin(Pi / (2 * h));
}

/// KHR_lights_punctual's window: (1 - (d / range)^4), at most 1, over d^2.
float RangeWindow(float distance, float range)
{
  if (!(range > 0))
    return 1;
  const float r = distance / range, r2 = r * r;
  return std::max(0.f, std::min(1.f, 1 - r2 * r2));
}
}

void LightSampler::Build(std::vector<LightTriangle> triangles, const std::vector<Vec3f>& average,
  std::vector<PlacedLight> lights, const Scene& scene, float sceneRadius)
{
  this->BuildSky(scene);

  std::vector<double> power(triangles.size());
  double total = 0;
  for (std::size_t i = 0; i < triangles.size(); ++i)
  {
    const LightTriangle& t = triangles[i];
    const double area = Length(Cross(Vec3d(t.E1), Vec3d(t.E2))) / 2;
    power[i] = area * Luminance(Vec3d(average[i])) * (t.TwoSided ? 2 : 1);
    if (!std::isfinite(power[i]) || power[i] < 0)
      power[i] = 0;
  }
  this->Triangles = std::move(triangles);
  const bool haveTriangles = !this->Triangles.empty() && MakeCdf(power, this->TriangleCdf, total);
  if (!haveTriangles)
    this->Triangles.clear();

  this->Punctual.clear();
  std::vector<double> punctualPower;
  for (PlacedLight& l : lights)
  {
    const double i = Luminance(Vec3d(l.Intensity));
    const double p = l.Type == LightType::Directional ? Pi * double(sceneRadius) * sceneRadius * i
                     : l.Type == LightType::Spot      ? 2 * Pi * (1 - l.CosOuter) * i
                                                      : 4 * Pi * i;
    if (p > 0 && std::isfinite(p))
    {
      this->Punctual.push_back(l);
      punctualPower.push_back(p);
    }
  }
  double punctualTotal = 0;
  const bool havePunctual = !this->Punctual.empty() && MakeCdf(punctualPower, this->PunctualCdf, punctualTotal);
  if (!havePunctual)
    this->Punctual.clear();

  const bool haveSky =
    this->SkyPresent && Luminance(this->SkyColor) > 0 && (this->ImageWidth == 0 || !this->RowCdf.empty());
  const int groups = int(haveTriangles) + int(havePunctual) + int(haveSky);
  const float share = groups > 0 ? 1.f / groups : 0;
  this->TriangleEnd = haveTriangles ? (havePunctual || haveSky ? share : 1.f) : 0.f;
  this->PunctualEnd = haveSky ? this->TriangleEnd + (havePunctual ? share : 0.f) : 1.f;
  this->SkyPick = haveSky ? 1 - this->PunctualEnd : 0;

  for (std::size_t i = 0; i < this->Triangles.size(); ++i)
  {
    LightTriangle& t = this->Triangles[i];
    const double area = Length(Cross(Vec3d(t.E1), Vec3d(t.E2))) / 2;
    t.PdfArea = float(this->TriangleEnd * power[i] / total / area);
  }
  for (std::size_t i = 0; i < this->Punctual.size(); ++i)
    this->Punctual[i].Pick = float((this->PunctualEnd - this->TriangleEnd) * punctualPower[i] / punctualTotal);
}

void LightSampler::BuildSky(const Scene& scene)
{
  this->SkyPresent = scene.Sky.Present;
  this->SkyColor = { Sanitized(scene.Sky.Color.x), Sanitized(scene.Sky.Color.y), Sanitized(scene.Sky.Color.z) };
  if (!(MaxComponent(this->SkyColor) > 0))
    this->SkyPresent = false;
  this->ImageWidth = this->ImageHeight = 0;
  this->Image.clear();
  this->RowCdf.clear();
  this->ColumnCdf.clear();
  const int index = scene.Sky.Texture;
  if (!this->SkyPresent || index < 0 || index >= int(scene.Textures.size()))
    return;
  const Texture& t = scene.Textures[index];
  const std::size_t count = std::size_t(std::max(0, t.Width)) * std::max(0, t.Height);
  if (count == 0 || (t.Floats.size() < 4 * count && t.Bytes.size() < 4 * count))
    return;
  this->ImageWidth = t.Width;
  this->ImageHeight = t.Height;
  this->Image.resize(3 * count);
  for (std::size_t i = 0; i < count; ++i)
    for (int c = 0; c < 3; ++c)
    {
      float v;
      if (!t.Floats.empty())
        v = t.Floats[4 * i + c];
      else
      {
        v = t.Bytes[4 * i + c] / 255.f;
        if (t.SRGB)
          v = v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
      }
      this->Image[3 * i + c] = Sanitized(v);
    }
  // Weights: texel luminance with a little of its neighbours', which the bilinear lookup sees, times the row's solid
  // angle.
  const int w = t.Width, h = t.Height;
  std::vector<double> row(w), rows(h);
  std::vector<float> rowCdf;
  this->ColumnCdf.resize(count);
  for (int y = 0; y < h; ++y)
  {
    for (int x = 0; x < w; ++x)
    {
      double around = 0;
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
          around += Luminance(Vec3d(this->Texel((x + i + w) % w, std::min(h - 1, std::max(0, y + j)))));
      row[x] = 0.75 * Luminance(Vec3d(this->Texel(x, y))) + 0.25 / 9 * around;
    }
    double total = 0;
    if (!MakeCdf(row, rowCdf, total))
    {
      total = 0;
      std::fill(rowCdf.begin(), rowCdf.end(), 1.f);
    }
    std::copy(rowCdf.begin(), rowCdf.end(), this->ColumnCdf.begin() + std::size_t(y) * w);
    rows[y] = total * (std::cos(M_PI * y / h) - std::cos(M_PI * (y + 1) / h));
  }
  double total = 0;
  if (!MakeCdf(rows, this->RowCdf, total))
    this->RowCdf.clear();
}

Vec3f LightSampler::Sky(const Vec3f& d) const noexcept
{
  if (!this->SkyPresent)
    return {};
  if (this->ImageWidth == 0)
    return this->SkyColor;
  const float u = 0.5f + std::atan2(d.x, -d.z) / (2 * Pi);
  const float v = std::acos(std::max(-1.f, std::min(1.f, d.y))) / Pi;
  const float x = u * this->ImageWidth - 0.5f, y = v * this->ImageHeight - 0.5f;
  const float fx = std::floor(x), fy = std::floor(y), tx = x - fx, ty = y - fy;
  const int w = this->ImageWidth, h = this->ImageHeight;
  const int x0 = ((int(fx) % w) + w) % w, x1 = (x0 + 1) % w;
  const int y0 = std::max(0, std::min(h - 1, int(fy))), y1 = std::max(0, std::min(h - 1, int(fy) + 1));
  const Vec3f a = this->Texel(x0, y0) * (1 - tx) + this->Texel(x1, y0) * tx;
  const Vec3f b = this->Texel(x0, y1) * (1 - tx) + this->Texel(x1, y1) * tx;
  return this->SkyColor * (a * (1 - ty) + b * ty);
}

float LightSampler::SkyPdf(const Vec3f& d) const noexcept
{
  if (!(this->SkyPick > 0))
    return 0;
  if (this->ImageWidth == 0)
    return this->SkyPick / (4 * Pi);
  const int w = this->ImageWidth, h = this->ImageHeight;
  const float u = 0.5f + std::atan2(d.x, -d.z) / (2 * Pi);
  const float v = std::acos(std::max(-1.f, std::min(1.f, d.y))) / Pi;
  const int x = std::max(0, std::min(w - 1, int(u * w))), y = std::max(0, std::min(h - 1, int(v * h)));
  const float row = this->RowCdf[y] - (y > 0 ? this->RowCdf[y - 1] : 0);
  const float* c = &this->ColumnCdf[std::size_t(y) * w];
  const float column = c[x] - (x > 0 ? c[x - 1] : 0);
  const float band = RowBand(y, h);
  return this->SkyPick * row * column * w / (2 * Pi * band);
}

bool LightSampler::Draw(const Vec3f& x, float pick, float u, float v, Sample& out) const noexcept
{
  if (pick < this->TriangleEnd)
  {
    float rest;
    const float scaled = std::min(0x1.fffffep-1f, pick / this->TriangleEnd);
    const std::size_t i = Pick(this->TriangleCdf.data(), this->TriangleCdf.size(), scaled, rest);
    const LightTriangle& t = this->Triangles[i];
    float b0, b1; // uniform on the triangle, by the low-distortion map of Heitz (2019)
    if (u < v)
    {
      b0 = u / 2;
      b1 = v - b0;
    }
    else
    {
      b1 = v / 2;
      b0 = u - b1;
    }
    const Vec3f y = t.V0 + t.E1 * b0 + t.E2 * b1;
    const Vec3f d = y - x;
    const float d2 = Dot(d, d);
    if (!(d2 > 0) || std::isinf(d2))
      return false;
    out.Wi = d * (1 / std::sqrt(d2));
    float cosine = -Dot(t.N, out.Wi);
    float side = 1;
    if (cosine < 0)
    {
      if (!t.TwoSided)
        return false;
      cosine = -cosine;
      side = -1;
    }
    if (!(cosine > 1e-6f))
      return false;
    out.Kind = Sample::From::Triangle;
    out.AtInfinity = false;
    out.Target = y + t.N * (side * t.Offset);
    out.Emission = t.Emission;
    out.Textured = t.Textured;
    out.Geometry = t.Geometry;
    out.Primitive = t.Primitive;
    out.U = b0;
    out.V = b1;
    out.Pdf = t.PdfArea * d2 / cosine;
    return out.Pdf > 0;
  }
  if (pick < this->PunctualEnd && !this->Punctual.empty())
  {
    float rest;
    const float scaled = std::min(0x1.fffffep-1f, (pick - this->TriangleEnd) / (this->PunctualEnd - this->TriangleEnd));
    const PlacedLight& l = this->Punctual[Pick(this->PunctualCdf.data(), this->PunctualCdf.size(), scaled, rest)];
    out.Kind = Sample::From::Punctual;
    out.Textured = false;
    out.Pdf = l.Pick;
    if (l.Type == LightType::Directional)
    {
      out.AtInfinity = true;
      out.Wi = out.Target = -l.Direction;
      out.Emission = l.Intensity;
      return true;
    }
    const Vec3f d = l.Position - x;
    const float d2 = Dot(d, d);
    if (!(d2 > 0) || std::isinf(d2))
      return false;
    const float distance = std::sqrt(d2);
    out.AtInfinity = false;
    out.Wi = d / distance;
    out.Target = l.Position;
    float k = RangeWindow(distance, l.Range) / d2;
    if (l.Type == LightType::Spot)
    {
      const float c = -Dot(l.Direction, out.Wi);
      const float s = (c - l.CosOuter) / std::max(1e-4f, l.CosInner - l.CosOuter);
      const float a = std::max(0.f, std::min(1.f, s));
      k *= a * a;
    }
    out.Emission = l.Intensity * k;
    return k > 0;
  }
  if (!(this->SkyPick > 0))
    return false;
  out.Kind = Sample::From::Sky;
  out.AtInfinity = true;
  out.Textured = false;
  if (this->ImageWidth == 0)
  {
    const float z = 1 - 2 * u, r = std::sqrt(std::max(0.f, 1 - z * z)), phi = 2 * Pi * v;
    out.Wi = { r * std::cos(phi), z, r * std::sin(phi) };
    out.Emission = this->SkyColor;
    out.Pdf = this->SkyPick / (4 * Pi);
  }
  else
  {
    const int w = this->ImageWidth, h = this->ImageHeight;
    float ru, rv;
    const std::size_t y = Pick(this->RowCdf.data(), std::size_t(h), v, rv);
    const std::size_t i = Pick(&this->ColumnCdf[y * w], std::size_t(w), u, ru);
    // uniform in solid angle within the texel
    const float cosTheta = std::cos(Pi * y / h) - RowBand(int(y), h) * rv,
                sinTheta = std::sqrt(std::max(0.f, 1 - cosTheta * cosTheta));
    const float phi = 2 * Pi * ((i + ru) / w - 0.5f);
    out.Wi = { sinTheta * std::sin(phi), cosTheta, -sinTheta * std::cos(phi) };
    out.Emission = this->Sky(out.Wi);
    out.Pdf = this->SkyPdf(out.Wi);
  }
  out.Target = out.Wi;
  return out.Pdf > 0;
}
}
