// SPDX-License-Identifier: BSD-3-Clause
#include "quellLightSampler.h"

#include "quellSampler.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace quell
{
namespace
{
/// Upper ends of a running sum, scaled to 1; false where the sum is 0. Summed in double: 1e6 small lights add up.
bool MakeCdf(const std::vector<double>& weights, std::vector<double>& cdf, double& total)
{
  total = 0;
  for (double w : weights)
    total += w;
  cdf.clear();
  if (!(total > 0) || !std::isfinite(total))
    return false;
  cdf.resize(weights.size());
  double sum = 0;
  std::size_t last = 0;
  for (std::size_t i = 0; i < weights.size(); ++i)
  {
    sum += weights[i];
    cdf[i] = sum / total;
    if (weights[i] > 0)
      last = i;
  }
  for (std::size_t i = last; i < cdf.size(); ++i)
    cdf[i] = 1; // u < 1 never lands on a trailing zero
  return true;
}

/// First entry whose upper end is above u.
std::size_t Find(const std::vector<double>& cdf, double u) noexcept
{
  const std::size_t n = cdf.size();
  return std::min<std::size_t>(std::size_t(std::upper_bound(cdf.data(), cdf.data() + n, u) - cdf.data()), n - 1);
}

constexpr double WeakSky = 0.01;        ///< part of all power below which an environment gets less than its even share,
constexpr double LeastSky = 0.1;        ///< of which this much remains
constexpr double UniformSky = 1. / 32;  ///< of the picks of an environment image
constexpr std::size_t ManyLights = 256; ///< from here on 24 bits are too few
constexpr double BelowOne = 0x1.fffffffffffffp-1;

/// A number below one step of `pick` (2^-24) made of the other two. Random numbers with 24 bits cannot tell more
/// than 2^24 chances apart: with a million lights each would have a few of the steps, or none.
double Fraction(float a, float b) noexcept
{
  std::uint32_t x, y;
  std::memcpy(&x, &a, sizeof x);
  std::memcpy(&y, &b, sizeof y);
  const std::uint64_t h = sampling::Mix64((std::uint64_t(x) << 32 | y) + 0x9e3779b97f4a7c15ull);
  return double(h >> 11) * 0x1p-77;
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
  const double radius2 = std::isfinite(sceneRadius) ? double(sceneRadius) * sceneRadius : 0;
  const double skyPower = Pi * radius2 * this->BuildSky(scene);
  const bool haveSky =
    this->SkyPresent && Luminance(this->SkyColor) > 0 && (this->ImageWidth == 0 || !this->Levels.empty());

  // Lights at a place: triangles, then points and spots.
  this->Triangles = std::move(triangles);
  std::vector<LightBounds> bounds(this->Triangles.size());
  std::vector<double> power(this->Triangles.size()), areas(this->Triangles.size());
  double ofTriangles = 0;
  for (std::size_t i = 0; i < this->Triangles.size(); ++i)
  {
    const LightTriangle& t = this->Triangles[i];
    const double area = areas[i] = Length(Cross(Vec3d(t.E1), Vec3d(t.E2))) / 2;
    const double intensity = area * Luminance(Vec3d(average[i]));
    // The density per area has to be a number.
    power[i] = area >= 1e-30 && std::isfinite(intensity) && intensity > 0 ? Pi * intensity * (t.TwoSided ? 2 : 1) : 0;
    ofTriangles += power[i];
    LightBounds& b = bounds[i];
    for (int c = 0; c < 3; ++c)
    {
      const float p = t.V0[c], q = p + t.E1[c], r = p + t.E2[c];
      b.Lower[c] = std::min({ p, q, r });
      b.Upper[c] = std::max({ p, q, r });
    }
    b.Axis = t.N;
    b.Intensity = power[i] > 0 ? float(intensity) : 0;
    b.Power = float(power[i]);
    b.TwoSided = t.TwoSided;
  }
  if (!(ofTriangles > 0))
  {
    this->Triangles.clear();
    bounds.clear();
    power.clear();
  }
  this->Punctual.clear();
  std::vector<double> distantPower;
  for (bool distant : { false, true })
  {
    for (const PlacedLight& l : lights)
    {
      if ((l.Type == LightType::Directional) != distant)
        continue;
      const double i = Luminance(Vec3d(l.Intensity));
      const double p = distant                     ? Pi * radius2 * i
                       : l.Type == LightType::Spot ? 2 * Pi * (1 - l.CosOuter) * i
                                                   : 4 * Pi * i;
      if (!(i > 0) || !(p >= 0) || !std::isfinite(p) || (!distant && !(p > 0)))
        continue;
      this->Punctual.push_back(l);
      if (distant)
      {
        distantPower.push_back(i);
        continue;
      }
      power.push_back(p);
      LightBounds b;
      b.Lower = b.Upper = l.Position;
      b.Intensity = float(i);
      b.Power = float(p);
      if (l.Type == LightType::Point)
        b.CosSpread = -1;
      else
      {
        const float inner = std::acos(std::max(-1.f, std::min(1.f, l.CosInner))),
                    outer = std::acos(std::max(-1.f, std::min(1.f, l.CosOuter)));
        b.Axis = l.Direction;
        b.CosSpread = std::cos(std::min(inner, outer));
        b.CosExtent = std::cos(std::max(0.f, outer - inner) + 1e-3f); // a hard edge is no empty cone
      }
      if (l.Range > 0)
        b.Reach = l.Range;
      bounds.push_back(b);
    }
    if (!distant)
      this->LocalPunctual = this->Punctual.size();
  }
  double localTotal = 0, distantTotal = 0;
  const bool haveLocal = MakeCdf(power, this->LocalCdf, localTotal);
  const bool haveDistant = MakeCdf(distantPower, this->DistantCdf, distantTotal);

  const bool tree = haveLocal && (this->Selection == LightSelection::Tree ||
                                   (this->Selection == LightSelection::Auto && power.size() >= TreeFrom));
  this->Tree.Build(tree ? bounds : std::vector<LightBounds>());

  const bool have[3] = { haveLocal, haveDistant, haveSky };
  const double of[3] = { haveLocal ? localTotal : 0, haveDistant ? Pi * radius2 * distantTotal : 0,
    haveSky ? skyPower : 0 };
  const double sum = of[0] + of[1] + of[2];
  const int groups = int(haveLocal) + int(haveDistant) + int(haveSky);
  const double brightness = std::isfinite(sum) && sum > 0 ? std::min(1., of[2] / sum / WeakSky) : 1;
  const double weight[3] = { have[0] ? 1. : 0, have[1] ? 1. : 0,
    have[2] ? groups > 1 ? LeastSky + (1 - LeastSky) * brightness : 1. : 0 };
  const double weights = weight[0] + weight[1] + weight[2];
  double share[3];
  for (int g = 0; g < 3; ++g)
    share[g] = weights > 0 ? weight[g] / weights : 0;
  this->LocalEnd = haveDistant || haveSky ? float(share[0]) : haveLocal ? 1.f : 0.f;
  this->DistantEnd = haveSky ? float(share[0] + share[1]) : haveDistant ? 1.f : this->LocalEnd;
  this->SkyPick = haveSky ? 1 - this->DistantEnd : 0;

  const double byPower = this->UsesTree() ? double(DefensiveShare) : 1., byTree = 1 - byPower;
  for (std::size_t i = 0; i < this->Triangles.size(); ++i)
  {
    LightTriangle& t = this->Triangles[i];
    t.PdfArea = power[i] > 0 ? float(this->LocalEnd * byPower * (power[i] / localTotal) / areas[i]) : 0;
    t.TreeArea = power[i] > 0 ? float(this->LocalEnd * byTree / areas[i]) : 0;
  }
  for (std::size_t i = 0; i < this->Punctual.size(); ++i)
  {
    PlacedLight& l = this->Punctual[i];
    const bool local = i < this->LocalPunctual;
    l.Pick = local ? float(this->LocalEnd * byPower * (power[this->Triangles.size() + i] / localTotal))
                   : float((this->DistantEnd - this->LocalEnd) * distantPower[i - this->LocalPunctual] / distantTotal);
    l.TreePick = local ? float(this->LocalEnd * byTree) : 0;
  }
}

/// Returns the integral of the luminance over all directions.
double LightSampler::BuildSky(const Scene& scene)
{
  this->SkyPresent = scene.Sky.Present;
  this->SkyColor = { Sanitized(scene.Sky.Color.x), Sanitized(scene.Sky.Color.y), Sanitized(scene.Sky.Color.z) };
  if (!(MaxComponent(this->SkyColor) > 0))
    this->SkyPresent = false;
  this->ImageWidth = this->ImageHeight = 0;
  this->Image.clear();
  this->Levels.clear();
  if (!this->SkyPresent)
    return 0;
  const double color = Luminance(Vec3d(this->SkyColor));
  const int index = scene.Sky.Texture;
  if (index < 0 || index >= int(scene.Textures.size()))
    return 4 * Pi * color;
  const Texture& t = scene.Textures[index];
  const std::size_t count = std::size_t(std::max(0, t.Width)) * std::size_t(std::max(0, t.Height));
  if (count == 0 || (t.Floats.size() < 4 * count && t.Bytes.size() < 4 * count))
    return 4 * Pi * color;
  const int w = this->ImageWidth = t.Width, h = this->ImageHeight = t.Height;
  this->Image.resize(3 * count);
  for (std::size_t i = 0; i < count; ++i)
    for (int c = 0; c < 3; ++c)
    {
      float v;
      if (!t.Floats.empty())
        v = t.Floats[4 * i + std::size_t(c)];
      else
      {
        v = t.Bytes[4 * i + std::size_t(c)] / 255.f;
        if (t.SRGB)
          v = v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
      }
      // the product with the colour has to be a number, too
      v = Sanitized(v);
      const float largest = 1e37f / std::max(1.f, this->SkyColor[c]);
      this->Image[3 * i + std::size_t(c)] = std::min(v, largest);
    }
  // Weights: texel luminance with a little of its neighbours', which the bilinear lookup sees, times solid angle.
  const auto luminance = [this](int x, int y) { return Luminance(Vec3d(this->SkyColor * this->Texel(x, y))); };
  std::vector<double> weight(count);
  double total = 0, integral = 0;
  for (int y = 0; y < h; ++y)
  {
    const double solid = 2 * M_PI / w * double(RowBand(y, h));
    for (int x = 0; x < w; ++x)
    {
      double around = 0;
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
          around += luminance((x + i + w) % w, std::min(h - 1, std::max(0, y + j)));
      const double here = luminance(x, y);
      const double v = (0.75 * here + 0.25 / 9 * around) * solid;
      weight[std::size_t(y) * std::size_t(w) + std::size_t(x)] = v;
      total += v;
      integral += here * solid;
    }
  }
  if (!(total > 0) || !std::isfinite(total))
    return 0;
  Level level;
  level.Width = w;
  level.Height = h;
  level.Chance.resize(count);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const std::size_t i = std::size_t(y) * std::size_t(w) + std::size_t(x);
      level.Chance[i] =
        float((1 - UniformSky) * weight[i] / total + UniformSky * double(RowBand(y, h)) / (2 * double(w)));
    }
  while (level.Width > 1 || level.Height > 1)
  {
    Level next;
    next.Width = (level.Width + 1) / 2;
    next.Height = (level.Height + 1) / 2;
    next.Chance.assign(std::size_t(next.Width) * std::size_t(next.Height), 0.f);
    for (int y = 0; y < next.Height; ++y)
      for (int x = 0; x < next.Width; ++x)
      {
        double sum = 0;
        for (int j = 2 * y; j < std::min(level.Height, 2 * y + 2); ++j)
          for (int i = 2 * x; i < std::min(level.Width, 2 * x + 2); ++i)
            sum += double(level.Chance[std::size_t(j) * std::size_t(level.Width) + std::size_t(i)]);
        next.Chance[std::size_t(y) * std::size_t(next.Width) + std::size_t(x)] = float(sum);
      }
    this->Levels.push_back(std::move(level));
    level = std::move(next);
  }
  this->Levels.push_back(std::move(level));
  return integral;
}

void LightSampler::SkyTexture(const Vec3f& d, float& u, float& v) const noexcept
{
  // atan2 rather than acos: near the poles the height alone has no digits left
  u = 0.5f + std::atan2(d.x, -d.z) / (2 * Pi);
  v = std::atan2(std::sqrt(d.x * d.x + d.z * d.z), d.y) / Pi;
}

Vec3f LightSampler::SkyAt(float u, float v) const noexcept
{
  const float x = u * float(this->ImageWidth) - 0.5f, y = v * float(this->ImageHeight) - 0.5f;
  const float fx = std::floor(x), fy = std::floor(y), tx = x - fx, ty = y - fy;
  const int w = this->ImageWidth, h = this->ImageHeight;
  const int x0 = ((int(fx) % w) + w) % w, x1 = (x0 + 1) % w;
  const int y0 = std::max(0, std::min(h - 1, int(fy))), y1 = std::max(0, std::min(h - 1, int(fy) + 1));
  const Vec3f a = this->Texel(x0, y0) * (1 - tx) + this->Texel(x1, y0) * tx;
  const Vec3f b = this->Texel(x0, y1) * (1 - tx) + this->Texel(x1, y1) * tx;
  return this->SkyColor * (a * (1 - ty) + b * ty);
}

float LightSampler::SkyPdfAt(float u, float v) const noexcept
{
  const int w = this->ImageWidth, h = this->ImageHeight;
  const int x = std::max(0, std::min(w - 1, int(u * float(w)))), y = std::max(0, std::min(h - 1, int(v * float(h))));
  const float chance = this->Levels[0].Chance[std::size_t(y) * std::size_t(w) + std::size_t(x)];
  return this->SkyPick * chance * float(w) / (2 * Pi * RowBand(y, h));
}

Vec3f LightSampler::Sky(const Vec3f& d) const noexcept
{
  if (!this->SkyPresent)
    return {};
  if (this->ImageWidth == 0)
    return this->SkyColor;
  if (!IsFinite(d))
    return {};
  float u, v;
  this->SkyTexture(d, u, v);
  return this->SkyAt(u, v);
}

float LightSampler::SkyPdf(const Vec3f& d) const noexcept
{
  if (!(this->SkyPick > 0))
    return 0;
  if (this->ImageWidth == 0)
    return this->SkyPick / (4 * Pi);
  if (!IsFinite(d))
    return 0;
  float u, v;
  this->SkyTexture(d, u, v);
  return this->SkyPdfAt(u, v);
}

bool LightSampler::Draw(const Receiver& at, float pick, float u, float v, Sample& out) const noexcept
{
  if (!IsFinite(at.Position))
    return false;
  if (pick < this->LocalEnd)
    return this->DrawLocal(at, pick, u, v, out);
  if (pick < this->DistantEnd)
  {
    const double x = (double(pick) - double(this->LocalEnd)) / (double(this->DistantEnd) - double(this->LocalEnd));
    const PlacedLight& l = this->Punctual[this->LocalPunctual + Find(this->DistantCdf, x)];
    return this->DrawPunctual(l, at.Position, l.Pick, out);
  }
  return this->SkyPick > 0 && this->DrawSky(pick, u, v, out);
}

bool LightSampler::DrawLocal(const Receiver& at, float pick, float u, float v, Sample& out) const noexcept
{
  double x = double(pick);
  if (this->LocalCdf.size() > ManyLights)
    x += Fraction(u, v);
  x = std::min(BelowOne, x / double(this->LocalEnd));
  std::uint32_t i;
  float chance = 0;
  if (!this->UsesTree())
    i = std::uint32_t(Find(this->LocalCdf, x));
  else if (x < double(DefensiveShare))
  {
    i = std::uint32_t(Find(this->LocalCdf, x / double(DefensiveShare)));
    chance = this->Tree.Chance(at, i);
  }
  else if (!this->Tree.Pick(
             at, std::min(BelowOne, (x - double(DefensiveShare)) / (1 - double(DefensiveShare))), i, chance))
    return false;

  if (i >= this->Triangles.size())
  {
    const PlacedLight& l = this->Punctual[i - this->Triangles.size()];
    return this->DrawPunctual(l, at.Position, this->UsesTree() ? l.Pick + l.TreePick * chance : l.Pick, out);
  }
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
  const Vec3f d = y - at.Position;
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
  // as in TrianglePdf
  float area = t.PdfArea;
  if (this->UsesTree())
    area += t.TreeArea * chance;
  out.Pdf = area * d2 / cosine;
  return out.Pdf > 0 && std::isfinite(out.Pdf);
}

bool LightSampler::DrawPunctual(const PlacedLight& l, const Vec3f& at, float pdf, Sample& out) const noexcept
{
  out.Kind = Sample::From::Punctual;
  out.Textured = false;
  out.Pdf = pdf;
  if (l.Type == LightType::Directional)
  {
    out.AtInfinity = true;
    out.Wi = out.Target = -l.Direction;
    out.Emission = l.Intensity;
    return pdf > 0;
  }
  const Vec3f d = l.Position - at;
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
  return pdf > 0 && k > 0 && IsFinite(out.Emission);
}

bool LightSampler::DrawSky(float pick, float u, float v, Sample& out) const noexcept
{
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
    // Down the pyramid: first the half, then the column (Clarberg et al. 2005).
    double s = double(u) + Fraction(pick, v), t = double(v) + Fraction(pick, u);
    std::size_t x = 0, y = 0;
    for (std::size_t l = this->Levels.size() - 1; l-- > 0;)
    {
      const Level& level = this->Levels[l];
      const std::size_t w = std::size_t(level.Width), h = std::size_t(level.Height);
      x *= 2;
      y *= 2;
      const bool right = x + 1 < w, below = y + 1 < h;
      const float* c = &level.Chance[y * w + x];
      const double a = double(c[0]), b = right ? double(c[1]) : 0., d = below ? double(c[w]) : 0.,
                   e = right && below ? double(c[w + 1]) : 0.;
      const double top = (a + b) / ((a + b) + (d + e));
      double left;
      if (t < top)
      {
        t /= top;
        left = a / (a + b);
      }
      else
      {
        t = (t - top) / (1 - top);
        ++y;
        left = d / (d + e);
      }
      t = std::min(BelowOne, t);
      if (s < left)
        s /= left;
      else
      {
        s = (s - left) / (1 - left);
        ++x;
      }
      s = std::min(BelowOne, s);
    }
    // uniform in solid angle within the texel
    const double w = this->ImageWidth, h = this->ImageHeight;
    const double cosTheta = std::cos(M_PI * double(y) / h) - double(RowBand(int(y), this->ImageHeight)) * t;
    const double sinTheta = std::sqrt(std::max(0., (1 - cosTheta) * (1 + cosTheta)));
    const float phi = 2 * Pi * (float((double(x) + s) / w) - 0.5f);
    out.Wi = { float(sinTheta) * std::sin(phi), float(cosTheta), -float(sinTheta) * std::cos(phi) };
    float tu, tv;
    this->SkyTexture(out.Wi, tu, tv);
    out.Emission = this->SkyAt(tu, tv);
    out.Pdf = this->SkyPdfAt(tu, tv);
  }
  out.Target = out.Wi;
  return out.Pdf > 0;
}
}
