// SPDX-License-Identifier: BSD-3-Clause
#include "quellLightSampler.h"

#include "quellSampler.h"
#include "quellSinCos.h"
#include "quellSkyMap.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

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
using skymap::BelowOne;

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

/// Guide tables: calls put(k, last entry whose lower end is not above k / parts) for k = 0 ... parts - 1, then
/// put(parts, last entry).
template <class LowerEnd, class Put>
void MakeGuide(std::uint32_t entries, std::uint32_t parts, const LowerEnd& lowerEnd, const Put& put)
{
  std::uint32_t i = 0;
  for (std::uint32_t k = 0; k < parts; ++k)
  {
    while (i + 1 < entries && lowerEnd(i + 1) <= double(k) / parts)
      ++i;
    put(k, i);
  }
  put(parts, entries - 1);
}

/// Last entry in [first, last] whose lower end is not above what is searched; `first`'s is not.
template <class NotAbove>
std::uint32_t FindGuided(std::uint32_t first, std::uint32_t last, const NotAbove& notAbove) noexcept
{
  while (last - first > 8)
  {
    const std::uint32_t middle = first + (last - first) / 2;
    if (notAbove(middle))
      first = middle;
    else
      last = middle - 1;
  }
  while (first < last && notAbove(first + 1))
    ++first;
  return first;
}

float Sanitized(float v)
{
  return std::isfinite(v) && v > 0 ? v : 0;
}

/// Solid angle of a row of texels over 2 pi: the difference of the cosines of its edges, without cancellation.
double RowBand(int y, int h)
{
  return 2 * std::sin(M_PI * (y + 0.5) / h) * std::sin(M_PI / (2. * h));
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
    this->SkyPresent && Luminance(this->SkyColor) > 0 && (this->ImageWidth == 0 || !this->Rows.empty());

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
  this->Rows.clear();
  this->Columns.clear();
  this->RowGuide.clear();
  this->ColumnGuide.clear();
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
  const std::size_t stride = std::size_t(w) + 2;
  this->Image.resize(stride * (std::size_t(h) + 2));
  std::vector<double> luminance(count);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
    {
      const std::size_t i = std::size_t(y) * std::size_t(w) + std::size_t(x);
      Vec3f radiance;
      for (int c = 0; c < 3; ++c)
      {
        float v = t.Floats.empty() ? t.Bytes[4 * i + std::size_t(c)] / 255.f : t.Floats[4 * i + std::size_t(c)];
        if (t.SRGB)
          v = v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
        // the product with the colour has to be a number, too
        v = Sanitized(v);
        const float largest = 1e37f / std::max(1.f, this->SkyColor[c]);
        radiance[c] = this->SkyColor[c] * std::min(v, largest);
        this->Image[(std::size_t(y) + 1) * stride + std::size_t(x) + 1].Radiance[c] = radiance[c];
      }
      luminance[i] = Luminance(Vec3d(radiance));
    }
  // Weights: texel luminance with a little of its neighbours', which the bilinear lookup sees, times solid angle.
  std::vector<double> weight(count);
  double total = 0, integral = 0;
  for (int y = 0; y < h; ++y)
  {
    const double solid = 2 * M_PI / w * RowBand(y, h);
    const double* rows[3];
    for (int j = 0; j < 3; ++j)
      rows[j] = &luminance[std::size_t(std::min(h - 1, std::max(0, y + j - 1))) * std::size_t(w)];
    for (int x = 0; x < w; ++x)
    {
      const int before = x > 0 ? x - 1 : w - 1, after = x + 1 < w ? x + 1 : 0;
      double around = 0;
      for (const double* r : rows)
        around += r[before] + r[x] + r[after];
      const double here = rows[1][x];
      const double v = (0.75 * here + 0.25 / 9 * around) * solid;
      weight[std::size_t(y) * std::size_t(w) + std::size_t(x)] = v;
      total += v;
      integral += here * solid;
    }
  }
  const bool lit = total > 0 && std::isfinite(total);
  if (lit)
  {
    this->Rows.resize(std::size_t(h) + 1);
    const std::size_t ends = std::size_t(w) + 1;
    this->Columns.resize(ends * std::size_t(h));
    // One part for four columns: the guide stays small, and what is left to search is one cache line.
    std::uint32_t parts = 1;
    this->ColumnShift = 32;
    while (parts < std::uint32_t(w) / 4)
    {
      parts *= 2;
      --this->ColumnShift;
    }
    this->ColumnGuide.resize((std::size_t(parts) + 1) * std::size_t(h));
    double sum = 0;
    for (int y = 0; y < h; ++y)
    {
      double* row = &weight[std::size_t(y) * std::size_t(w)];
      SkyRow& r = this->Rows[std::size_t(y)];
      r.Lower = sum;
      r.Top = std::cos(M_PI * y / h);
      r.Band = RowBand(y, h);
      double chance = 0;
      for (int x = 0; x < w; ++x)
      {
        row[x] = (1 - UniformSky) * row[x] / total + UniformSky * r.Band / (2. * w);
        chance += row[x];
      }
      sum += chance;
      std::uint32_t* columns = &this->Columns[std::size_t(y) * ends];
      double before = 0;
      for (int x = 0; x < w; ++x)
      {
        columns[x] = std::uint32_t(x) + std::uint32_t(std::min(1., before / chance) * (double(ColumnSteps) - w));
        before += row[x];
      }
      columns[w] = ColumnSteps;
      ColumnPart* guide = &this->ColumnGuide[std::size_t(y) * (std::size_t(parts) + 1)];
      MakeGuide(
        std::uint32_t(w), parts, [columns](std::uint32_t i) { return double(columns[i]) * 0x1p-32; },
        [columns, guide, w](std::uint32_t k, std::uint32_t first)
        {
          guide[k].First = first;
          for (std::uint32_t i = 0; i < 7; ++i)
            guide[k].Ends[i] = columns[std::min(std::uint32_t(w), first + i)];
        });
    }
    for (SkyRow& r : this->Rows)
      r.Lower /= sum;
    this->Rows.back().Lower = 1;
    for (this->RowParts = 1; this->RowParts < h; this->RowParts *= 2)
      continue;
    this->RowGuide.resize(std::size_t(this->RowParts) + 1);
    MakeGuide(
      std::uint32_t(h), std::uint32_t(this->RowParts), [this](std::uint32_t i) { return this->Rows[i].Lower; },
      [this](std::uint32_t k, std::uint32_t i) { this->RowGuide[k] = i; });
    for (int y = 0; y < h; ++y)
    {
      const double perSolidAngle =
        (this->Rows[std::size_t(y) + 1].Lower - this->Rows[std::size_t(y)].Lower) * w / (2 * M_PI * RowBand(y, h));
      const std::uint32_t* columns = &this->Columns[std::size_t(y) * ends];
      for (int x = 0; x < w; ++x)
        this->Image[(std::size_t(y) + 1) * stride + std::size_t(x) + 1].Density =
          float(double(columns[x + 1] - columns[x]) / double(ColumnSteps) * perSolidAngle);
    }
  }
  for (std::size_t y = 1; y <= std::size_t(h); ++y)
  {
    SkyTexel* row = &this->Image[y * stride];
    row[0] = row[w];
    row[w + 1] = row[1];
  }
  std::copy_n(&this->Image[stride], stride, &this->Image[0]);
  std::copy_n(&this->Image[std::size_t(h) * stride], stride, &this->Image[(std::size_t(h) + 1) * stride]);
  return lit ? integral : 0;
}

/// Radiance, and density among the picks of the environment, at a place in its image (skymap::Place).
Vec3f LightSampler::SkyLookup(std::size_t place, float tx, float ty, float& density) const noexcept
{
  const SkyTexel* a = &this->Image[place];
  const SkyTexel* b = a + this->ImageWidth + 2;
  density = (ty < 0.5f ? a : b)[tx < 0.5f ? 0 : 1].Density; // the nearest of the four
  const float wa = (1 - tx) * (1 - ty), wb = tx * (1 - ty), wc = (1 - tx) * ty, wd = tx * ty;
  Vec3f sum;
  for (int c = 0; c < 3; ++c)
    sum[c] = (a[0].Radiance[c] * wa + a[1].Radiance[c] * wb) + (b[0].Radiance[c] * wc + b[1].Radiance[c] * wd);
  return sum;
}

Vec3f LightSampler::SkyAndPdf(const Vec3f& d, float& pdf) const noexcept
{
  pdf = 0;
  if (!this->SkyPresent)
    return {};
  if (this->ImageWidth == 0)
  {
    pdf = this->SkyPick / (4 * Pi);
    return this->SkyColor;
  }
  if (!IsFinite(d))
    return {};
  float tx, ty;
  const std::size_t place = skymap::Place(d.x, d.y, d.z, this->ImageWidth, this->ImageHeight, tx, ty);
  const Vec3f radiance = this->SkyLookup(place, tx, ty, pdf);
  pdf *= this->SkyPick;
  return radiance;
}

Vec3f LightSampler::Sky(const Vec3f& d) const noexcept
{
  float pdf;
  return this->SkyAndPdf(d, pdf);
}

float LightSampler::SkyPdf(const Vec3f& d) const noexcept
{
  float pdf;
  this->SkyAndPdf(d, pdf);
  return pdf;
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
  return this->SkyPick > 0 && this->DrawSky(at, pick, u, v, out);
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

std::size_t LightSampler::PickRow(double v) const noexcept
{
  const std::uint32_t* rows = &this->RowGuide[std::size_t(v * this->RowParts)];
  return FindGuided(rows[0], rows[1], [this, v](std::uint32_t i) { return this->Rows[i].Lower <= v; });
}

/// The texel that two numbers pick, and where in it: cosine of the distance from the pole, longitude in turns.
void LightSampler::PickPlace(std::size_t y, double s, double t, double& cosTheta, float& turn) const noexcept
{
  const SkyRow& row = this->Rows[y];
  t = (t - row.Lower) / (this->Rows[y + 1].Lower - row.Lower);
  const std::size_t w = std::size_t(this->ImageWidth);
  s *= double(ColumnSteps);
  const std::uint32_t step = std::uint32_t(s);
  const ColumnPart& part = *this->PartOf(y, step);
  std::size_t x = part.First;
  const std::uint32_t* ends = part.Ends;
  if (step < part.Ends[6])
  {
    unsigned i = 0;
    for (int k = 1; k < 6; ++k)
      i += unsigned(part.Ends[k] <= step);
    ends += i;
    x += i;
  }
  else
  {
    const std::uint32_t* columns = &this->Columns[y * (w + 1)];
    x = FindGuided(
      std::uint32_t(x) + 6, (&part)[1].First, [columns, step](std::uint32_t i) { return columns[i] <= step; });
    ends = columns + x;
  }
  s = (s - double(ends[0])) / double(ends[1] - ends[0]);
  // uniform in solid angle within the texel
  cosTheta = row.Top - row.Band * t;
  turn = float((double(x) + s) / double(w));
}

bool LightSampler::DrawSky(const Receiver& at, float pick, float u, float v, Sample& out) const noexcept
{
  out.Kind = Sample::From::Sky;
  out.AtInfinity = true;
  out.Textured = false;
  if (this->ImageWidth == 0)
  {
    const float z = 1 - 2 * u, r = std::sqrt(std::max(0.f, 1 - z * z));
    float sine, cosine;
    SinCosTurn(v, sine, cosine);
    out.Wi = { r * cosine, z, r * sine };
  }
  else
  {
    double s, t, cosTheta;
    float turn;
    skymap::Extend(pick, u, v, s, t);
    this->PickPlace(this->PickRow(t), s, t, cosTheta, turn);
    skymap::Direction(cosTheta, turn, out.Wi.x, out.Wi.y, out.Wi.z);
  }
  // Light from behind is of no use; the margin is for other ways of rounding.
  if (!at.BothSides && Dot(at.Normal, out.Wi) < -BehindMargin)
    return false;
  out.Target = out.Wi;
  out.Emission = this->SkyAndPdf(out.Wi, out.Pdf);
  return out.Pdf > 0;
}
}
