// SPDX-License-Identifier: BSD-3-Clause
// Image skies for whole wavefronts: what LightSampler::DrawSky and SkyAndPdf do for one direction, in steps, so that
// arithmetic runs in vectors and the memory is asked for all rows before the first one is waited for.
#include "quellWavefront.h"

#include "quellSkyMap.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellWavefrontSky.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
void SkyNumbersImpl(Wavefront& w)
{
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  const float *pick = w.Random[2 * PairLightPick], *u = w.Random[2 * PairLightPoint],
              *v = w.Random[2 * PairLightPoint + 1];
  for (unsigned i = 0; i < n; ++i)
    skymap::Extend(pick[i], u[i], v[i], w.Sky.S[i], w.Sky.T[i]);
}

void SkyDirectionsImpl(Wavefront& w, float margin)
{
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  for (unsigned i = 0; i < n; ++i)
  {
    float x, y, z;
    skymap::Direction(w.Sky.CosTheta[i], w.Sky.Turn[i], x, y, z);
    const bool behind = w.Sx[i] * x + w.Sy[i] * y + w.Sz[i] * z < -margin;
    w.Wx[i] = x;
    w.Wy[i] = y;
    w.Wz[i] = z;
    w.LightFlags[i] = behind ? 0u : w.LightFlags[i];
    w.Er[i] = w.Eg[i] = w.Eb[i] = w.LightPdf[i] = 1;
  }
}

void SkyPlacesImpl(Wavefront& w, const float* x, const float* y, const float* z, int width, int height)
{
  const unsigned n = (unsigned(w.Count) + 15u) & ~15u;
  for (unsigned i = 0; i < n; ++i)
    w.Sky.Texel[i] = skymap::Place(x[i], y[i], z[i], width, height, w.Sky.X[i], w.Sky.Y[i]);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(SkyNumbersImpl);
HWY_EXPORT(SkyDirectionsImpl);
HWY_EXPORT(SkyPlacesImpl);

bool WavefrontAccess::HasSkyImage(const EmbreeScene& scene) noexcept
{
  const LightSampler& l = scene.LightSource;
  return l.SkyPick > 0 && l.ImageWidth > 0;
}

float WavefrontAccess::SkyFrom(const EmbreeScene& scene) noexcept
{
  return scene.LightSource.DistantEnd;
}

void WavefrontAccess::DrawSky(const EmbreeScene& scene, Wavefront& w, const bool* wanted) noexcept
{
  const LightSampler& l = scene.LightSource;
  constexpr std::uint32_t flags =
    Wavefront::LightDrawn | Wavefront::LightAtInfinity | Wavefront::LightHittable | Wavefront::LightFromSky;
  const float* pick = w.Random[2 * PairLightPick];
  HWY_DYNAMIC_DISPATCH(SkyNumbersImpl)(w);
  int rows[Wavefront::Width + 1], count = 0;
  for (int i = 0; i < w.Count; ++i)
  {
    const bool mine = w.Alive[i] && wanted[i] && !(pick[i] < l.DistantEnd);
    w.LightFlags[i] = mine ? flags : 0u;
    rows[count] = i;
    count += mine;
  }
  for (int k = 0; k < count; ++k)
  {
    const int i = rows[k];
    const std::size_t row = l.PickRow(w.Sky.T[i]);
    w.Sky.Texel[i] = std::uint32_t(row);
    __builtin_prefetch(l.PartOf(row, std::uint32_t(w.Sky.S[i] * double(LightSampler::ColumnSteps))));
  }
  for (int k = 0; k < count; ++k)
  {
    const int i = rows[k];
    l.PickPlace(w.Sky.Texel[i], w.Sky.S[i], w.Sky.T[i], w.Sky.CosTheta[i], w.Sky.Turn[i]);
  }
  HWY_DYNAMIC_DISPATCH(SkyDirectionsImpl)(w, LightSampler::BehindMargin);
}

void WavefrontAccess::LightOfSky(const EmbreeScene& scene, Wavefront& w) noexcept
{
  const LightSampler& l = scene.LightSource;
  int rows[Wavefront::Width + 1], count = 0;
  for (int i = 0; i < w.Count; ++i)
  {
    rows[count] = i;
    count += w.Lit[i] && (w.LightFlags[i] & Wavefront::LightFromSky);
  }
  if (count == 0)
    return;
  HWY_DYNAMIC_DISPATCH(SkyPlacesImpl)(w, w.Wx, w.Wy, w.Wz, l.ImageWidth, l.ImageHeight);
  Prefetch(l, w, rows, count);
  for (int k = 0; k < count; ++k)
  {
    const int i = rows[k];
    float pdf;
    const Vec3f sky = l.SkyLookup(w.Sky.Texel[i], w.Sky.X[i], w.Sky.Y[i], pdf);
    w.Er[i] = sky.x;
    w.Eg[i] = sky.y;
    w.Eb[i] = sky.z;
    w.LightPdf[i] = pdf * l.SkyPick;
    w.Lit[i] = w.LightPdf[i] > 0 ? w.Lit[i] : 0u;
  }
}

void WavefrontAccess::FindSky(const EmbreeScene& scene, Wavefront& w) noexcept
{
  const LightSampler& l = scene.LightSource;
  int rows[Wavefront::Width + 1], count = 0;
  for (int i = 0; i < w.Count; ++i)
  {
    rows[count] = i;
    count += !w.Alive[i];
  }
  if (count == 0)
    return;
  HWY_DYNAMIC_DISPATCH(SkyPlacesImpl)(w, w.Live.Dx, w.Live.Dy, w.Live.Dz, l.ImageWidth, l.ImageHeight);
  Prefetch(l, w, rows, count);
}

Vec3f WavefrontAccess::SkyAt(const EmbreeScene& scene, const Wavefront& w, int i, float& pdf) noexcept
{
  const Vec3f sky = scene.LightSource.SkyLookup(w.Sky.Texel[i], w.Sky.X[i], w.Sky.Y[i], pdf);
  pdf *= scene.LightSource.SkyPick;
  pdf *= 1 - scene.MovingShare;
  return sky;
}

void WavefrontAccess::Prefetch(const LightSampler& l, const Wavefront& w, const int* rows, int count) noexcept
{
  const LightSampler::SkyTexel* image = l.Image.data();
  const std::size_t stride = std::size_t(l.ImageWidth) + 2;
  for (int k = 0; k < count; ++k)
  {
    const LightSampler::SkyTexel* texel = image + w.Sky.Texel[rows[k]];
    __builtin_prefetch(texel);
    __builtin_prefetch(texel + stride);
  }
}
}
#endif
