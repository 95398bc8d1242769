// SPDX-License-Identifier: BSD-3-Clause
// What shines: emissive triangles and lamps, also those that move while the shutter is open.
#include "quellEmbreeParts.h"
#include "quellMaterial.h"

namespace quell
{
using namespace parts;

PlacedLight EmbreeScene::PlaceLamp(const PunctualLight& p, const Mat4& m) const
{
  PlacedLight l;
  l.Type = p.Type;
  l.Position = Vec3f(Vec3d(m.m[0][3], m.m[1][3], m.m[2][3]) - this->Center);
  l.Direction = Vec3f(Normalized(m.Direction({ 0, 0, -1 })));
  l.Intensity = Radiance(p.Intensity);
  for (int c = 0; c < 3; ++c)
    l.Intensity[c] = std::min(LargestEmission, l.Intensity[c]);
  l.Range = std::isfinite(p.Range) && p.Range > 0 ? p.Range : 0;
  l.CosInner = std::cos(p.InnerCone);
  l.CosOuter = std::cos(p.OuterCone);
  return l;
}

void EmbreeScene::BuildLights(Poses& poses)
{
  const Scene& s = *this->Source;
  ++this->Work.LightBuilds;
  std::vector<LightTriangle> triangles;
  std::vector<Vec3f> average;
  std::vector<double> weights; // of what moves within the shutter
  this->BlurredTriangles.clear();
  this->BlurredLamps.clear();
  for (std::size_t g = 0; g < this->Parts.size(); ++g)
  {
    Part& part = this->Parts[g];
    part.LightIndex.clear();
    const Material& m = s.Materials[std::size_t(part.Material)];
    const Vec3f factor = this->Emissions[std::size_t(part.Material)];
    if (!(MaxComponent(factor) > 0) || m.Unlit || (part.Moves && !part.Shown))
      continue;
    const bool textured = m.EmissiveTexture.Texture >= 0 || part.AlphaTested;
    part.LightIndex.assign(part.Triangles, -1);
    for (std::size_t t = 0; t < part.Triangles; ++t)
    {
      const std::uint32_t primitive = std::uint32_t(t);
      Vec3f mean = factor;
      if (textured)
      {
        // The mean over 16 points, and never 0: what is not seen at the points may still shine between them.
        mean = factor * 0.05f;
        for (int i = 0; i < 4; ++i)
          for (int j = 0; j < 4; ++j)
          {
            const float r = std::sqrt((i + 0.5f) / 4), u = 1 - r, v = (j + 0.5f) / 4 * r;
            mean += this->EmissionAt(part, primitive, u, v) * (1.f / 16);
          }
      }
      Vec3d p[3];
      this->CornersAt(part, primitive, -1, p);
      const Vec3d cross = Cross(p[1] - p[0], p[2] - p[0]) * (part.Mirrored ? -1. : 1.);
      float largest = 0;
      for (const Vec3d& corner : p)
        for (int c = 0; c < 3; ++c)
          largest = std::max(largest, float(std::fabs(corner[c])));
      if (part.Open.Segments > 0)
      {
        MovingTriangle l;
        l.Geometry = std::uint32_t(g);
        l.Primitive = primitive;
        l.Emission = factor;
        l.Offset = largest * OffsetScale;
        l.TwoSided = m.DoubleSided;
        l.Textured = textured;
        const double weight = Length(cross) / 2 * Luminance(Vec3d(mean)) * (m.DoubleSided ? 2 : 1);
        part.LightIndex[t] = std::int32_t(this->BlurredTriangles.size()); // behind the others, see below
        this->BlurredTriangles.push_back(l);
        weights.push_back(std::isfinite(weight) ? weight : 0);
        continue;
      }
      LightTriangle l;
      l.V0 = Vec3f(p[0]);
      l.E1 = Vec3f(p[1]) - l.V0;
      l.E2 = Vec3f(p[2]) - l.V0;
      l.N = Vec3f(Normalized(cross));
      if (l.N == Vec3f()) // no area now: it is found by no ray, but the index is kept simple
        continue;
      l.Offset = largest * OffsetScale;
      l.Emission = factor;
      l.TwoSided = m.DoubleSided;
      l.Textured = textured;
      l.Geometry = std::uint32_t(g);
      l.Primitive = primitive;
      part.LightIndex[t] = std::int32_t(triangles.size());
      triangles.push_back(l);
      average.push_back(mean);
    }
  }

  std::vector<PlacedLight> lights;
  std::vector<double> lampWeights;
  for (std::size_t i = 0; i < s.Lights.size(); ++i)
  {
    const PunctualLight& p = s.Lights[i];
    const PlacedLight l = this->PlaceLamp(p, this->NodeMatrix(p.Node, false));
    const std::string name = Quoted("light", p.Name, int(i));
    if (!quell::IsFinite(l.Position) || l.Direction == Vec3f() || l.Intensity != p.Intensity)
    {
      const bool strong = MaxComponent(p.Intensity) > LargestEmission;
      const std::string text = strong ? name + ": its intensity is above 1e14; taken as 1e14"
                               : l.Intensity != p.Intensity
                                 ? name + ": its intensity is negative or not a number; taken as 0"
                                 : name + " is left out: its place or direction is not finite";
      if (std::find(this->Warnings.begin(), this->Warnings.end(), text) == this->Warnings.end())
        this->Warn(text);
    }
    if (!quell::IsFinite(l.Position) || l.Direction == Vec3f())
      continue;
    bool still = true;
    if (this->Blurs() && p.Node >= 0)
      for (int q = 0; q <= ShutterGrid && still; q += ShutterGrid / 4)
        still = Same(this->Nodes[std::size_t(p.Node)], this->ShutterPose(poses, q).World[std::size_t(p.Node)]);
    if (still)
    {
      lights.push_back(l);
      continue;
    }
    MovingLamp lamp;
    for (int q = 0; q <= LampSegments; ++q)
    {
      const PlacedLight at =
        this->PlaceLamp(p, this->ShutterPose(poses, q * (ShutterGrid / LampSegments)).World[std::size_t(p.Node)]);
      lamp.At.push_back(quell::IsFinite(at.Position) && at.Direction != Vec3f() ? at : l);
    }
    const double power = Luminance(Vec3d(l.Intensity)) / Pi;
    const double weight = power * (l.Type == LightType::Directional ? Pi * this->Radius * this->Radius
                                    : l.Type == LightType::Spot     ? 2 * Pi * (1 - double(l.CosOuter))
                                                                    : 4 * Pi);
    this->BlurredLamps.push_back(lamp);
    lampWeights.push_back(std::isfinite(weight) ? weight : 0);
    this->Has.MotionBlur = true;
  }
  const std::size_t before = triangles.size();
  this->LightSource.Build(std::move(triangles), average, std::move(lights), s, float(this->Radius));
  const std::size_t still = this->LightSource.GetTriangles().size();

  weights.insert(weights.end(), lampWeights.begin(), lampWeights.end());
  double total = 0;
  for (const double weight : weights)
    total += weight;
  const bool any = total > 0 && std::isfinite(total);
  if (!any)
  {
    this->BlurredTriangles.clear();
    this->BlurredLamps.clear();
    weights.clear();
  }
  this->BlurredCdf.clear();
  double sum = 0;
  for (const double weight : weights)
    this->BlurredCdf.push_back((sum += weight) / total);
  if (any)
    this->BlurredCdf.back() = 1;
  this->Has.MovingLights = any;
  this->MovingShare = any ? (this->LightSource.Empty() ? 1.f : 0.5f) : 0.f;
  for (Part& part : this->Parts)
  {
    if (part.LightIndex.empty())
      continue;
    if (part.Open.Segments > 0 && any)
      for (std::int32_t& index : part.LightIndex)
        index += std::int32_t(still);
    else if (part.Open.Segments > 0 || still != before)
      part.LightIndex.clear();
  }
}

bool EmbreeScene::DrawMoving(
  const Receiver& at, float time, float pick, float u, float v, LightSampler::Sample& out) const noexcept
{
  if (pick >= this->MovingShare)
  {
    const float rest = 1 - this->MovingShare;
    if (!this->LightSource.Draw(at, std::min(0x1.fffffep-1f, (pick - this->MovingShare) / rest), u, v, out))
      return false;
    out.Pdf *= rest;
    return out.Pdf > 0;
  }
  const double scaled = double(pick) / double(this->MovingShare);
  const std::size_t i = std::min(this->BlurredCdf.size() - 1,
    std::size_t(std::upper_bound(this->BlurredCdf.begin(), this->BlurredCdf.end(), scaled) - this->BlurredCdf.begin()));
  const double chance = this->BlurredCdf[i] - (i > 0 ? this->BlurredCdf[i - 1] : 0.);
  const float share = float(this->MovingShare * chance);
  if (i >= this->BlurredTriangles.size())
  {
    const MovingLamp& lamp = this->BlurredLamps[i - this->BlurredTriangles.size()];
    double f;
    const int k = Segment(time, LampSegments, f);
    const PlacedLight &a = lamp.At[std::size_t(k)], &b = lamp.At[std::size_t(k) + 1];
    PlacedLight l = a;
    l.Position = Vec3f(Vec3d(a.Position) + (Vec3d(b.Position) - Vec3d(a.Position)) * f);
    const Vec3d direction = Normalized(Vec3d(a.Direction) * (1 - f) + Vec3d(b.Direction) * f);
    l.Direction = direction == Vec3d() ? a.Direction : Vec3f(direction);
    return this->LightSource.DrawPunctual(l, at.Position, share, out);
  }
  const MovingTriangle& t = this->BlurredTriangles[i];
  const Part& part = this->Parts[t.Geometry];
  Vec3d p[3];
  this->CornersAt(part, t.Primitive, time, p);
  const float b0 = u < v ? u / 2 : u - v / 2, b1 = u < v ? v - u / 2 : v / 2; // Heitz (2019): uniform
  const Vec3d e1 = p[1] - p[0], e2 = p[2] - p[0], cross = Cross(e1, e2) * (part.Mirrored ? -1. : 1.);
  const double twice = Length(cross);
  const Vec3d y = p[0] + e1 * double(b0) + e2 * double(b1);
  const Vec3d d = y - Vec3d(at.Position);
  const double distance2 = Dot(d, d);
  if (!(twice > 0) || !(distance2 > 0) || !std::isfinite(distance2))
    return false;
  const Vec3f normal(cross / twice);
  out.Wi = Vec3f(d / std::sqrt(distance2));
  const float cosine = -Dot(normal, out.Wi);
  if (!(std::fabs(cosine) > 1e-6f) || (cosine < 0 && !t.TwoSided))
    return false;
  out.Kind = LightSampler::Sample::From::Triangle;
  out.AtInfinity = false;
  out.Target = Vec3f(y) + normal * (cosine < 0 ? -t.Offset : t.Offset);
  out.Emission = t.Emission;
  out.Textured = t.Textured;
  out.Geometry = t.Geometry;
  out.Primitive = t.Primitive;
  out.U = b0;
  out.V = b1;
  out.Pdf = float(double(share) * 2 / twice * distance2) / std::fabs(cosine);
  return out.Pdf > 0 && std::isfinite(out.Pdf);
}

float EmbreeScene::MovingPdf(
  int light, const SurfaceHit& hit, const Receiver& from, float distance2, float cosine) const noexcept
{
  const std::size_t still = this->LightSource.GetTriangles().size();
  if (std::size_t(light) < still)
    return this->LightSource.TrianglePdf(std::uint32_t(light), from, distance2, cosine) * (1 - this->MovingShare);
  const std::size_t i = std::size_t(light) - still;
  const double chance = this->BlurredCdf[i] - (i > 0 ? this->BlurredCdf[i - 1] : 0.);
  Vec3d p[3];
  this->CornersAt(this->Parts[hit.Geometry], hit, p);
  const double twice = Length(Cross(p[1] - p[0], p[2] - p[0]));
  if (!(cosine > 1e-6f) || !(twice > 0))
    return 0;
  return float(double(float(this->MovingShare * chance)) * 2 / twice * double(distance2)) / cosine;
}
}
