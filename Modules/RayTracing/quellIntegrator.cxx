// SPDX-License-Identifier: BSD-3-Clause
#include "quellIntegrator.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
/// A point behind the previous camera, or a motion no image can hold: far outside, for every reader off-screen.
constexpr double OffScreen = 1e6;

Vec2<double> Motion(const Camera& previous, const Vec3d& p, double w, const Vec2<double>& now) noexcept
{
  Vec2<double> then;
  if (!previous.Project(p, w, then))
    return { OffScreen, OffScreen };
  return { std::max(-OffScreen, std::min(OffScreen, then.x - now.x)),
    std::max(-OffScreen, std::min(OffScreen, then.y - now.y)) };
}

/// Scales v down to length `limit`; the square of a large v overflows, so it is measured in units of its largest part.
void ClampLength(Vec3f& v, float limit) noexcept
{
  const float m = MaxComponent(v);
  if (!(m > 0) || !std::isfinite(m))
    return;
  const Vec3f u = v / m;
  const float ratio = limit / m / std::sqrt(Dot(u, u));
  if (ratio < 1)
    v = u * (m * ratio);
}
}

void Integrator::Pixel(int x, int y, PixelResult& result, TraceCounters& counters) const noexcept
{
  EmbreeScene::Context context;
  this->Scene->Begin(context);
  Vec2<double> offset{ 0.5, 0.5 };
  if (this->PixelJitter == Jitter::PerFrame)
  {
    const Vec2<double> h = sampling::HaltonOffset(1 + (std::uint32_t(this->Tick) & 4095u));
    offset = { 0.5 + h.x, 0.5 + h.y };
  }
  for (int s = 0; s < this->SamplesPerPixel; ++s)
  {
    const std::uint32_t index =
      std::uint32_t(this->Tick) * std::uint32_t(this->SamplesPerPixel) + std::uint32_t(this->FirstSample + s);
    const PixelSampler random(this->Seed, x, y, index);
    if (this->PixelJitter == Jitter::PerSample)
    {
      const Vec2f u = random.Pair(PairPixel);
      offset = { u.x, u.y };
    }
    Layers layers;
    this->TracePath(random, x + offset.x, y + offset.y, context, layers, result, counters);
    ++counters.Paths;
    ++result.Samples;
    bool bad = false;
    for (Vec3f& l : layers.Of)
      if (!IsFinite(l))
      {
        l = Vec3f();
        bad = true;
      }
    counters.NonFinite += bad;
    if (this->SampleClamp > 0)
    {
      ClampLength(layers.Of[1], this->SampleClamp);
      ClampLength(layers.Of[2], this->SampleClamp);
    }
    const Vec3d e(layers.Of[0]), d(layers.Of[1]), i(layers.Of[2]), sum = e + d + i;
    result.Emission += e;
    result.Direct += d;
    result.Indirect += i;
    ((this->FirstSample + s) % 2 == 0 ? result.HalfA : result.HalfB) += sum;
    const double luminance = Luminance(sum), delta = luminance - result.MeanLuminance;
    result.MeanLuminance += delta / result.Samples;
    result.SquareLuminance += delta * (luminance - result.MeanLuminance);
  }
}

void Integrator::TracePath(const PixelSampler& random, double px, double py, EmbreeScene::Context& context,
  Layers& layers, PixelResult& result, TraceCounters& counters) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  const LightSampler& lights = scene.Lights();
  const bool seeThrough = scene.Has.SeeThrough;
  const bool wanted[3] = { this->Wants.Emission, this->Wants.Direct, this->Wants.Indirect };
  // Non-delta scatterings after which nothing wanted can follow.
  const int deepest = wanted[2] ? this->MaximumBounces : wanted[1] || this->Wants.HitDistance ? 1 : 0;
  const bool anyLight = wanted[0] || wanted[1] || wanted[2];

  Vec3d start, forward;
  this->View.Ray(px, py, start, forward);
  TraceRay ray;
  ray.Origin = Vec3f(start);
  ray.Direction = Vec3f(forward);

  Vec3f throughput(1.f);
  Vec3f from; // the last non-delta vertex's position, for the pdf of its light sample
  float pdf = 0, etaScale = 1;
  bool delta = true, guides = this->Wants.Guides, distance = this->Wants.HitDistance;
  int smooth = 0; // non-delta scatterings so far
  Vec3f guideAlbedo(1.f), guideNormal;
  float guideRoughness = 0;

  for (int depth = 0;; ++depth)
  {
    if (seeThrough)
      ray.Key = random.RayKey(2 * std::uint32_t(depth));
    SurfaceHit hit;
    ++counters.Rays;
    const bool found = scene.Intersect(context, ray, hit);
    const int layer = std::min(smooth, 2);

    if (depth == 0 && this->Wants.Primary)
    {
      if (found)
      {
        if (result.Hits++ == 0)
        {
          result.Id = scene.ObjectId(hit);
          result.Material = scene.MaterialId(hit);
        }
        result.Depth += this->View.Depth(hit.P);
        result.Position += hit.P;
        result.NormalGeometric += Vec3d(hit.Front ? hit.Ng : -hit.Ng);
      }
      if (this->Wants.Motion)
      {
        Vec3d before;
        const bool moved = found && scene.PreviousPosition(hit, before);
        if (moved || !(this->View == this->PreviousView))
        {
          Vec2<double> now{ px, py };
          if (found)
          {
            this->View.Project(hit.P, 1, now);
            const Vec2<double> m = Motion(this->PreviousView, moved ? before : hit.P, 1, now);
            result.Motion = { result.Motion.x + m.x, result.Motion.y + m.y };
          }
          else if (!this->View.Orthographic)
          {
            const Vec2<double> m = Motion(this->PreviousView, forward, 0, now);
            result.SkyMotion = { result.SkyMotion.x + m.x, result.SkyMotion.y + m.y };
          }
        }
      }
    }
    if (!found)
    {
      if (guides)
      {
        guideAlbedo = Vec3f(1.f);
        guideNormal = Vec3f();
        guideRoughness = 0;
      }
      if (wanted[layer] && lights.HasSky())
      {
        float w = 1;
        if (!delta && this->Sampling != Strategy::BsdfOnly)
          w = this->Sampling == Strategy::LightOnly ? 0 : PowerHeuristic(pdf, lights.SkyPdf(ray.Direction));
        layers.Of[layer] += throughput * lights.Sky(ray.Direction) * w;
      }
      break;
    }
    if (distance && smooth == 1)
    {
      result.HitDistance += hit.T;
      ++result.HitDistances;
      distance = false;
    }
    // At the end of the path only emission counts.
    const int light = scene.LightAt(hit);
    if (depth == this->MaximumBounces && !guides && light < 0 && smooth > 0)
      break;
    if (scene.Has.Volumes && !hit.Front)
    {
      Vec3f color;
      float length;
      if (scene.Attenuation(hit, color, length))
        for (int c = 0; c < 3; ++c)
          throughput[c] *= color[c] > 0 ? std::pow(color[c], hit.T / length) : 0;
    }

    SurfacePoint point;
    scene.Shade(hit, ray.Direction, point);
    if (wanted[layer] && MaxComponent(point.Emission) > 0)
    {
      float w = 1;
      if (!delta && light >= 0 && this->Sampling != Strategy::BsdfOnly)
      {
        const Vec3f d = hit.Pf - from;
        w = this->Sampling == Strategy::LightOnly
              ? 0
              : PowerHeuristic(
                  pdf, lights.TrianglePdf(std::uint32_t(light), Dot(d, d), std::fabs(Dot(hit.Ng, ray.Direction))));
      }
      layers.Of[layer] += throughput * point.Emission * w;
    }
    if (smooth == 0 && wanted[0])
      layers.Of[0] += throughput * point.DisplayOnly;

    Surface& material = point.Material;
    if (guides)
    {
      // the last vertex seen so far stays, should the chain of mirrors end early
      guideAlbedo = MaxComponent(point.DisplayOnly) > 0 ? point.DisplayOnly : material.Albedo();
      guideNormal = point.Ns;
      guideRoughness = point.Roughness;
      guides = material.IsPureDelta();
    }
    const bool more = (anyLight && smooth <= deepest) || guides || distance;
    if (!more || depth == this->MaximumBounces)
      break;

    const Vec3f wo = -ray.Direction;
    material.Prepare(Dot(point.Ns, wo));

    const int next = std::min(smooth + 1, 2);
    if (wanted[next] && material.HasSmooth() && !lights.Empty() && this->Sampling != Strategy::BsdfOnly)
    {
      const Vec2f pick = random.Bounce(depth, PairLightPick), uv = random.Bounce(depth, PairLightPoint);
      LightSampler::Sample s;
      if (lights.Draw(hit.Pf, pick.x, uv.x, uv.y, s) && Dot(point.Ng, s.Wi) > 0)
      {
        Vec3f diffuse, specular;
        float scatterPdf;
        material.Evaluate(point.Ns, wo, s.Wi, diffuse, specular, scatterPdf);
        const Vec3f value = throughput * (diffuse + specular) * Dot(point.Ns, s.Wi);
        if (MaxComponent(value) > 0)
        {
          const Vec3f emission = s.Textured ? scene.LightEmission(s) : s.Emission;
          if (MaxComponent(emission) > 0)
          {
            TraceRay shadow;
            shadow.Origin = hit.Pf + point.Ng * hit.Offset;
            shadow.Direction = s.AtInfinity ? s.Wi : s.Target - shadow.Origin;
            if (!s.AtInfinity)
              shadow.Far = 0.9999f;
            if (seeThrough)
              shadow.Key = random.RayKey(2 * std::uint32_t(depth) + 1);
            ++counters.Rays;
            if (!scene.Occluded(context, shadow))
            {
              float w = 1 / s.Pdf;
              if (s.Kind != LightSampler::Sample::From::Punctual && this->Sampling == Strategy::Mis)
                w *= PowerHeuristic(s.Pdf, scatterPdf);
              layers.Of[next] += value * emission * w;
            }
          }
        }
      }
    }

    const Vec2f uv = random.Bounce(depth, PairBsdf);
    Vec2f lobe{ 0, 0 };
    if (scene.Has.Glossy || scene.Has.Glass)
      lobe = random.Bounce(depth, PairLobe);
    const Surface::Sampled s = material.Sample(point.Ns, point.Ng, wo, hit.Front, uv.x, uv.y, lobe.x, lobe.y);
    if (!(s.Pdf > 0))
      break;
    throughput *= s.Weight;
    if (!(MaxComponent(throughput) > 0))
      break;
    if (s.Transmitted)
      etaScale *= s.Eta2;
    delta = s.Delta;
    pdf = s.Pdf;
    if (!s.Delta)
    {
      if (++smooth > deepest)
        break;
      from = hit.Pf;
    }
    // Nothing left to meet: the last segment finds emitters only.
    if (depth + 1 == this->MaximumBounces && !guides && !distance && !lights.HasHittable())
      break;
    if (depth >= this->RouletteStart)
    {
      const float q = MaxComponent(throughput) * etaScale;
      if (q < 1)
      {
        const float p = std::min(0.99f, std::max(0.05f, q));
        if (random.Bounce(depth, PairLightPick).y >= p)
          break;
        throughput *= 1 / p;
      }
    }
    ray.Origin = hit.Pf + point.Ng * (s.Transmitted ? -hit.Offset : hit.Offset);
    ray.Direction = s.Wi;
  }
  if (this->Wants.Guides)
  {
    result.Albedo += Vec3d(guideAlbedo);
    result.Normal += Vec3d(guideNormal);
    result.Roughness += guideRoughness;
  }
}
}
