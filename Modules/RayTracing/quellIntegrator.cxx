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

/// Drops a layer that is not finite, with all its parts, and clamps the others; true when something was dropped.
bool Finish(PathSample& s, int bounceLayers, float clamp) noexcept
{
  const auto drop = [](Vec3f& v)
  {
    const bool bad = !IsFinite(v);
    if (bad)
      v = Vec3f();
    return bad;
  };
  const auto ratio = [clamp](const Vec3f& v)
  {
    const float m = MaxComponent(v);
    if (!(clamp > 0) || !(m > 0))
      return 1.f;
    // the square of a large length overflows: in units of the largest part
    const Vec3f u = v / m;
    return std::min(1.f, clamp / m / std::sqrt(Dot(u, u)));
  };
  bool bad = drop(s.Emission);
  if (drop(s.Direct))
  {
    bad = true;
    s.DirectDiffuse = Vec3f();
    if (bounceLayers > 0)
      s.Bounces[0] = Vec3f();
  }
  if (drop(s.Indirect))
  {
    bad = true;
    s.IndirectDiffuse = Vec3f();
    for (int b = 1; b < bounceLayers; ++b)
      s.Bounces[b] = Vec3f();
  }
  // From a lens of 1e8 scene units a hit may have no place in float.
  if (s.Hit && !(std::isfinite(s.Depth) && IsFinite(s.Position) && IsFinite(s.NormalGeometric)))
  {
    bad = true;
    s.Hit = false;
  }
  if (!std::isfinite(s.Motion.x) || !std::isfinite(s.Motion.y) || !IsFinite(s.Normal))
  {
    bad = true;
    s.Motion = {};
    s.Normal = Vec3f();
  }
  if (!(clamp > 0))
    return bad;
  const float direct = ratio(s.Direct), indirect = ratio(s.Indirect);
  if (direct < 1)
  {
    s.Direct *= direct;
    s.DirectDiffuse *= direct;
    if (bounceLayers > 0)
      s.Bounces[0] *= direct;
  }
  if (indirect < 1)
  {
    s.Indirect *= indirect;
    s.IndirectDiffuse *= indirect;
    for (int b = 1; b < bounceLayers; ++b)
      s.Bounces[b] *= indirect;
  }
  return bad;
}

constexpr int BouncePool = 2048;
}

/// Paths side by side, and what is asked of them.
struct Integrator::Batch
{
  Wavefront W;
  PathSample Samples[Wavefront::Width];
  struct Start
  {
    int X, Y, Sample; ///< pixel; sample, counted from the first of its tick
  } Starts[Wavefront::Width];
  Vec3f Bounces[BouncePool];
  std::uint32_t Keys[Wavefront::Width];
  int Apart[Wavefront::Width];                              ///< rows that are shaded one by one,
  std::uint32_t Kept[Wavefront::AllRows][Wavefront::Width]; ///< and their state
  bool Lightable[Wavefront::Width];                         ///< rows that light samples may be of use to
  EmbreeScene::Context Context;
  TraceCounters* Counters = nullptr;

  SamplePattern Pattern = SamplePattern::Sobol;
  std::uint64_t Seed = 0;
  int Tick = 0, SamplesPerPixel = 1;
  bool Wanted[3] = { false, false, false }, AnyLight = false;
  bool Guides = false, PrimaryHit = false, MotionVectors = false, Distance = false;
  int BounceLayers = 0;
  int Deepest = 0; ///< non-delta scatterings after which nothing wanted can follow
  FewTriangles Few;
  double Px[Wavefront::Width], Py[Wavefront::Width]; ///< where the camera rays go through, pixels
  bool PickTriangles = false, SkyImage = false;
  bool Keyed = false; ///< something is see-through
  bool OneByOne = false;
  bool Drawn = false; ///< the random numbers of the vertex are there

  /// Of the rays of all rows, null where no ray needs one.
  const std::uint32_t* RayKeys(std::uint32_t which) noexcept
  {
    if (!this->Keyed)
      return nullptr;
    lanes::RayKeys(this->W, which, this->Keys);
    return this->Keys;
  }
  /// Light after `bounce` non-delta scatterings, `diffuse` of it by the diffuse lobe of the first of them.
  void Add(std::uint32_t path, int bounce, const Vec3f& light, const Vec3f& diffuse) noexcept
  {
    PathSample& out = this->Samples[path];
    if (bounce == 0)
    {
      out.Emission += light;
      return;
    }
    (bounce == 1 ? out.Direct : out.Indirect) += light;
    (bounce == 1 ? out.DirectDiffuse : out.IndirectDiffuse) += diffuse;
    if (bounce <= this->BounceLayers)
      out.Bounces[bounce - 1] += light;
  }
  Vec3f Direction(int i) const noexcept { return { this->W.Live.Dx[i], this->W.Live.Dy[i], this->W.Live.Dz[i] }; }
  Vec3f Throughput(int i) const noexcept { return { this->W.Live.Tr[i], this->W.Live.Tg[i], this->W.Live.Tb[i] }; }
  Vec3f Share(int i) const noexcept { return { this->W.Live.Sr[i], this->W.Live.Sg[i], this->W.Live.Sb[i] }; }
  PixelSampler Random(std::uint32_t path) const noexcept
  {
    const Start& s = this->Starts[path];
    return PixelSampler(
      this->Pattern, this->Seed, s.X, s.Y, this->Tick, std::uint32_t(s.Sample), this->SamplesPerPixel);
  }
};

std::size_t Integrator::ScratchBytes() noexcept
{
  return sizeof(Batch);
}

Integrator::Variant Integrator::Chosen() const noexcept
{
  if (this->Force != Variant::Auto)
    return this->Force;
  if (WavefrontAccess::OnlyDiffuse(*this->Scene))
    return Variant::Diffuse;
  return WavefrontAccess::OnlyOpaque(*this->Scene) ? Variant::Opaque : Variant::General;
}

std::vector<std::string> Integrator::ExplainVariant(const Film& film) const
{
  std::vector<std::string> lines;
  const EmbreeScene::Features& has = this->Scene->Has;
  const bool light = film.WantsLight();
  if (light || film.WantsGuides())
    switch (this->Chosen())
    {
      case Variant::Diffuse:
        lines.push_back(
          "integrator variant \"diffuse\": no glossy material, no glass, nothing see-through; all in vectors");
        break;
      case Variant::Opaque:
        lines.push_back(
          "integrator variant \"opaque\": glossy materials, but no glass or clearcoat and nothing see-through");
        break;
      default:
        lines.push_back(std::string("integrator variant \"general\": the scene has ") +
                        (has.SeeThrough ? "see-through surfaces"
                          : has.Glass   ? "glass"
                                        : "clearcoat or a volume") +
                        "; glass and clearcoat vertex by vertex, all else in vectors");
    }
  const bool scattered = film.WantsDirect() || film.WantsIndirect();
  if (FewTriangles few; scattered && WavefrontAccess::FindTriangles(*this->Scene, few))
    lines.push_back("a few light triangles are all the light: light samples in vectors");
  if (scattered && has.Panes)
    lines.push_back("light samples pass thin clear glass");
  if (light && !film.WantsIndirect())
    lines.push_back(
      film.WantsDirect()
        ? "no indirect light is asked for: light ends after one scattering that is no mirror or clear glass"
        : "only emission is asked for: no light samples");
  if (!light)
    lines.push_back(film.WantsHitDistance() ? "no light is asked for: paths end where the first scattering leads"
                    : film.WantsGuides()    ? "no light is asked for: paths end where the guides are"
                                            : "only primary hits are asked for: no scattering is traced");
  if (light && this->MaximumBounces > 0 && !this->Scene->HasHittable())
    lines.push_back("no light that a ray can hit: the last segment of a path is not traced");
  if (this->GuideSamples > 0 && film.WantsGuides())
    lines.push_back("guides from " + std::to_string(this->GuideSamples) + " camera rays of their own per pixel");
  return lines;
}

void Integrator::Render(Film& film, const Rect& part, int first, int count, TraceCounters& counters) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  Batch b;
  if (first == 0)
    film.Clear(part);
  scene.Begin(b.Context);
  b.Counters = &counters;
  b.Pattern = this->Pattern;
  b.Tick = this->Tick;
  b.PickTriangles = WavefrontAccess::FindTriangles(scene, b.Few);
  b.SkyImage = WavefrontAccess::HasSkyImage(scene);
  const Variant variant = this->Chosen();
  b.Keyed = variant >= Variant::General && scene.Has.SeeThrough;
  b.OneByOne = variant == Variant::OneByOne;
  Vec2<double> fixed{ 0.5, 0.5 };
  if (this->PixelJitter == Jitter::PerFrame)
  {
    const Vec2<double> h = sampling::HaltonOffset(1 + (std::uint32_t(this->Tick) & 4095u));
    fixed = { 0.5 + h.x, 0.5 + h.y };
  }
  const bool apart = this->GuideSamples > 0 && film.WantsGuides();
  for (bool guidesOnly : { false, true })
  {
    if (guidesOnly && (!apart || first != 0))
      break;
    const int begin = guidesOnly ? 0 : first, end = guidesOnly ? this->GuideSamples : first + count;
    b.SamplesPerPixel = guidesOnly ? this->GuideSamples : this->SamplesPerPixel;
    const int before = guidesOnly ? 0 : this->FirstSample;
    const int stride = guidesOnly || this->SamplesPerTick == 0 ? b.SamplesPerPixel : this->SamplesPerTick;
    const std::uint32_t base = std::uint32_t(this->Tick) * std::uint32_t(stride) + std::uint32_t(before);
    b.Seed = guidesOnly ? sampling::Mix64(this->Seed ^ 0x6a09e667f3bcc909ull) : this->Seed;
    b.Wanted[0] = !guidesOnly && film.WantsEmission();
    b.Wanted[1] = !guidesOnly && film.WantsDirect();
    b.Wanted[2] = !guidesOnly && film.WantsIndirect();
    b.AnyLight = b.Wanted[0] || b.Wanted[1] || b.Wanted[2];
    b.Guides = film.WantsGuides() && apart == guidesOnly;
    b.PrimaryHit = !guidesOnly && film.WantsPrimary();
    b.MotionVectors = !guidesOnly && film.WantsMotion();
    b.Distance = !guidesOnly && film.WantsHitDistance();
    b.BounceLayers = guidesOnly ? 0 : film.BounceLayers();
    b.Deepest = b.Wanted[2] ? this->MaximumBounces : b.Wanted[1] || b.Distance ? 1 : 0;
    if (!b.AnyLight && !b.Guides && !b.PrimaryHit && !b.Distance)
      continue;
    const int width = b.BounceLayers > 0 ? std::min(Wavefront::Width, BouncePool / b.BounceLayers) : Wavefront::Width;
    const std::uint64_t key = PixelSampler::SeedKey(b.Seed);

    int x = part.x0, y = part.y0, s = begin;
    while (y < part.y1 && x < part.x1 && s < end)
    {
      // the next paths, by pixel, then by sample
      Wavefront& w = b.W;
      Wavefront::State& live = w.Live;
      int n = 0;
      for (; n < width && y < part.y1; ++n)
      {
        const std::uint32_t index = base + std::uint32_t(s);
        b.Starts[n] = { x, y, before + s };
        b.W.Live.Path[n] = std::uint32_t(n);
        const std::uint64_t pixel = key ^ (std::uint64_t(std::uint32_t(y)) << 20 ^ std::uint64_t(std::uint32_t(x)));
        live.KeyLo[n] = std::uint32_t(pixel);
        live.KeyHi[n] = std::uint32_t(pixel >> 32);
        live.Reversed[n] = sampling::ReverseBits(index);
        if (++s == end)
        {
          s = begin;
          if (++x == part.x1)
          {
            x = part.x0;
            ++y;
          }
        }
      }
      w.Count = n;
      const bool jittered = this->PixelJitter == Jitter::PerSample, lens = this->View.HasLens();
      const bool painted = lens || this->View.MovesInShutter();
      if (jittered)
        this->DrawRandom(b, PairPixel, 0);
      if (this->Shutter)
        this->DrawRandom(b, PairTime, 1);
      if (lens)
        this->DrawRandom(b, PairLens, 2);
      for (int i = 0; i < n; ++i)
      {
        const Batch::Start& start = b.Starts[i];
        Vec2<double> offset = fixed;
        if (jittered)
        {
          const Vec2<double> o = this->Filter.Offset({ w.Random[0][i], w.Random[1][i] });
          offset = { 0.5 + o.x, 0.5 + o.y };
        }
        b.Px[i] = start.X + offset.x;
        b.Py[i] = start.Y + offset.y;
        live.Time[i] = this->Shutter ? w.Random[2][i] : 0.f;
        live.Tr[i] = live.Tg[i] = live.Tb[i] = 1;
        live.Sr[i] = live.Sg[i] = live.Sb[i] = 1;
        live.EtaScale[i] = 1;
        live.Skipped[i] = 0;
        live.Flags[i] =
          Wavefront::DeltaBit | (b.Guides ? Wavefront::GuidesBit : 0) | (b.Distance ? Wavefront::DistanceBit : 0);
        // light alone touches nothing else of a sample
        if (b.Guides || b.PrimaryHit)
          b.Samples[i] = PathSample();
        else
          b.Samples[i].Darken();
        if (b.BounceLayers > 0)
        {
          b.Samples[i].Bounces = b.Bounces + std::size_t(i) * std::size_t(b.BounceLayers);
          std::fill_n(b.Samples[i].Bounces, b.BounceLayers, Vec3f());
        }
      }
      if (!painted && !this->View.Orthographic)
        lanes::CameraRays(w, b.Px, b.Py, this->View);
      else
        for (int i = 0; i < n; ++i)
        {
          Vec3d from, direction;
          if (painted)
            this->View.Ray(b.Px[i], b.Py[i], lens ? Vec2f{ w.Random[4][i], w.Random[5][i] } : Vec2f{ 0.5f, 0.5f },
              double(live.Time[i]), from, direction);
          else
            this->View.Ray(b.Px[i], b.Py[i], from, direction);
          live.Ox[i] = float(from.x);
          live.Oy[i] = float(from.y);
          live.Oz[i] = float(from.z);
          live.Dx[i] = float(direction.x);
          live.Dy[i] = float(direction.y);
          live.Dz[i] = float(direction.z);
        }
      switch (variant)
      {
        case Variant::Diffuse:
          this->Run<Variant::Diffuse>(b);
          break;
        case Variant::Opaque:
          this->Run<Variant::Opaque>(b);
          break;
        default:
          this->Run<Variant::General>(b);
      }
      for (int i = 0; i < n; ++i)
      {
        const Batch::Start& start = b.Starts[i];
        const int sample = start.Sample - before;
        if (guidesOnly)
        {
          film.AddGuides(start.X, start.Y, sample, b.Samples[i]);
          continue;
        }
        ++counters.Paths;
        counters.NonFinite += Finish(b.Samples[i], b.BounceLayers, this->SampleClamp);
        film.Add(start.X, start.Y, sample, b.Samples[i], !apart);
      }
    }
  }
}

void Integrator::DrawRandom(Batch& b, std::uint32_t pair, int slot) const noexcept
{
  if (this->Pattern == SamplePattern::Sobol)
  {
    lanes::DrawRandom(b.W, pair, slot);
    return;
  }
  for (int i = 0; i < b.W.Count; ++i)
  {
    const Vec2f u = b.Random(b.W.Live.Path[i]).Pair(pair);
    b.W.Random[2 * slot][i] = u.x;
    b.W.Random[2 * slot + 1][i] = u.y;
  }
}

void Integrator::DrawBounce(Batch& b, int depth, SamplePair pair) const noexcept
{
  this->DrawRandom(b, PairFirstBounce + PairsPerBounce * std::uint32_t(depth) + std::uint32_t(pair), int(pair));
}

/// What the first hit tells beyond light.
void Integrator::Primary(Batch& b) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  const Wavefront& w = b.W;
  const bool still = this->View == this->PreviousView;
  for (int i = 0; i < w.Count; ++i)
  {
    const std::uint32_t path = w.Live.Path[i];
    PathSample& out = b.Samples[path];
    const bool found = w.Alive[i] != 0;
    SurfaceHit hit;
    Vec3d position;
    out.Hit = found;
    if (found)
    {
      WavefrontAccess::Hit(scene, w, i, true, hit);
      position = scene.ReferencePosition(hit);
      out.Id = scene.ObjectId(hit);
      out.Material = scene.MaterialId(hit);
      out.Depth = this->View.Depth(position);
      out.Position = position;
      out.NormalGeometric = Vec3d(hit.Front ? hit.Ng : -hit.Ng);
    }
    if (!b.MotionVectors)
      continue;
    Vec3d before;
    const bool moved = found && scene.PreviousPosition(hit, before);
    if (!moved && still)
      continue;
    Vec2<double> now{ b.Px[path], b.Py[path] };
    if (found)
    {
      this->View.Project(position, 1, now);
      out.Motion = Motion(this->PreviousView, moved ? before : position, 1, now);
    }
    else if (!this->View.Orthographic)
    {
      Vec3d from, forward;
      this->View.Ray(now.x, now.y, from, forward);
      out.Motion = Motion(this->PreviousView, forward, 0, now);
    }
  }
}

/// A ray that left the scene.
void Integrator::Sky(Batch& b, int i) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  const Wavefront& w = b.W;
  const std::uint32_t flags = w.Live.Flags[i], path = w.Live.Path[i];
  const int smooth = int(flags & Wavefront::SmoothMask);
  if (flags & Wavefront::GuidesBit)
  {
    PathSample& out = b.Samples[path];
    out.Albedo = out.AlbedoDiffuse = Vec3f(1.f);
    out.AlbedoSpecular = out.Normal = Vec3f();
    out.Roughness = 0;
  }
  if (!b.Wanted[std::min(smooth, 2)] || !scene.Lights().HasSky())
    return;
  const Vec3f direction = b.Direction(i);
  float weight = 1, skyPdf;
  const Vec3f sky = b.SkyImage && IsFinite(direction) ? WavefrontAccess::SkyAt(scene, w, i, skyPdf)
                                                      : scene.SkyAndPdf(direction, skyPdf);
  if (!(flags & Wavefront::DeltaBit) && this->Sampling != Strategy::BsdfOnly)
    weight = this->Sampling == Strategy::LightOnly ? 0 : PowerHeuristic(w.Live.Pdf[i], skyPdf);
  const Vec3f light = b.Throughput(i) * sky * weight;
  b.Add(path, smooth, light, light * b.Share(i));
}

/// Light that the hit surface itself sends back along the ray.
void Integrator::Emit(Batch& b, int i, const SurfaceHit& hit, const Vec3f& emission, const Vec3f& unlit) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  const Wavefront& w = b.W;
  const std::uint32_t flags = w.Live.Flags[i], path = w.Live.Path[i];
  const int smooth = int(flags & Wavefront::SmoothMask);
  if (b.Wanted[std::min(smooth, 2)] && MaxComponent(emission) > 0)
  {
    const int light = scene.LightAt(hit);
    float weight = 1;
    if (!(flags & Wavefront::DeltaBit) && light >= 0 && this->Sampling != Strategy::BsdfOnly)
    {
      const Receiver from{ { w.Live.Fx[i], w.Live.Fy[i], w.Live.Fz[i] }, { w.Live.Nx[i], w.Live.Ny[i], w.Live.Nz[i] },
        (flags & Wavefront::BothSidesBit) != 0 };
      const Vec3f d = hit.Pf - from.Position;
      weight = this->Sampling == Strategy::LightOnly
                 ? 0
                 : PowerHeuristic(w.Live.Pdf[i],
                     scene.LightPdf(light, hit, from, Dot(d, d), std::fabs(Dot(hit.Ng, b.Direction(i)))));
    }
    const Vec3f emitted = b.Throughput(i) * emission * weight;
    b.Add(path, smooth, emitted, emitted * b.Share(i));
  }
  if (smooth == 0 && b.Wanted[0])
    b.Samples[path].Emission += b.Throughput(i) * unlit;
}

/// Light samples of the rows that are alive and reflect anything.
void Integrator::DrawLights(Batch& b) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  Wavefront& w = b.W;
  if (b.PickTriangles)
  {
    lanes::DrawTriangles(w, b.Few);
    return;
  }
  // lights that move take part of the picks
  const float distant = b.SkyImage && !scene.Has.MovingLights ? WavefrontAccess::SkyFrom(scene) : 1.f;
  if (distant < 1)
    WavefrontAccess::DrawSky(scene, w, b.Lightable);
  else
    std::fill_n(w.LightFlags, w.Count, 0u);
  if (distant > 0)
    for (int i = 0; i < w.Count; ++i)
    {
      if (!w.Alive[i] || !b.Lightable[i] || !(w.Random[2 * PairLightPick][i] < distant))
        continue;
      const Receiver here{ { w.Px[i], w.Py[i], w.Pz[i] }, { w.Sx[i], w.Sy[i], w.Sz[i] }, false };
      LightSampler::Sample s;
      if (!scene.DrawLight(here, w.Live.Time[i], w.Random[2 * PairLightPick][i], w.Random[2 * PairLightPoint][i],
            w.Random[2 * PairLightPoint + 1][i], s))
        continue;
      const Vec3f emission = s.Textured ? scene.LightEmission(s) : s.Emission;
      w.Wx[i] = s.Wi.x;
      w.Wy[i] = s.Wi.y;
      w.Wz[i] = s.Wi.z;
      w.Lx[i] = s.Target.x;
      w.Ly[i] = s.Target.y;
      w.Lz[i] = s.Target.z;
      w.Er[i] = emission.x;
      w.Eg[i] = emission.y;
      w.Eb[i] = emission.z;
      w.LightPdf[i] = s.Pdf;
      w.LightFlags[i] = Wavefront::LightDrawn | (s.AtInfinity ? Wavefront::LightAtInfinity : 0) |
                        (s.Kind != LightSampler::Sample::From::Punctual ? Wavefront::LightHittable : 0);
    }
}

/// Everything between two segments for paths among diffuse surfaces. All have scattered `depth` times.
void Integrator::DiffuseVertices(Batch& b, int depth) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  Wavefront& w = b.W;
  SurfaceHit hit;
  if (b.Distance && depth == 1)
    for (int i = 0; i < w.Count; ++i)
      if (w.Alive[i])
        b.Samples[w.Live.Path[i]].HitDistance = w.T[i];
  if (b.Guides && depth == 0)
    for (int i = 0; i < w.Count; ++i)
      if (w.Alive[i])
      {
        WavefrontAccess::Hit(scene, w, i, false, hit);
        SurfacePoint point;
        scene.Shade(hit, b.Direction(i), point);
        b.Samples[w.Live.Path[i]].Guide(point, Dot(point.Normals.Shading, -b.Direction(i)));
      }
  for (int e = 0; e < w.Emitters && b.AnyLight; ++e)
  {
    const int i = int(w.Emitter[e]);
    WavefrontAccess::Hit(scene, w, i, false, hit);
    Vec3f unlit;
    if (depth == 0)
    {
      float roughness;
      WavefrontAccess::Resolve(scene, hit, roughness, unlit);
    }
    this->Emit(b, i, hit, WavefrontAccess::Emission(scene, hit), unlit);
  }
  const bool more = (b.AnyLight && depth <= b.Deepest) || (b.Distance && depth == 0);
  if (!more || depth == this->MaximumBounces)
  {
    w.Count = 0;
    return;
  }
  if (w.Any & (WavefrontAccess::Varies | WavefrontAccess::Bent))
  {
    WavefrontAccess::Values(scene, w);
    lanes::PrepareOpaque(w); // makes the albedo, and more
  }
  else if (w.Any & WavefrontAccess::Smooth)
    lanes::Bend(w, false);

  const bool goesOn =
    depth + 1 <= b.Deepest && (depth + 1 < this->MaximumBounces || (b.Distance && depth == 0) || scene.HasHittable());
  const bool gambles = goesOn && depth >= this->RouletteStart;
  const bool lights = b.Wanted[std::min(depth + 1, 2)] && !scene.NoLights() && this->Sampling != Strategy::BsdfOnly;
  if (lights || gambles)
    this->DrawBounce(b, depth, PairLightPick);
  if (lights)
  {
    this->DrawBounce(b, depth, PairLightPoint);
    for (int i = 0; i < w.Count && !b.PickTriangles; ++i)
      b.Lightable[i] = w.Ar[i] > 0 || w.Ag[i] > 0 || w.Ab[i] > 0;
    this->DrawLights(b);
    lanes::AimDiffuse(w);
    b.Counters->Rays += WavefrontAccess::Occlude(scene, b.Context, w, nullptr, 0, b.Counters->Record);
    if (b.SkyImage)
      WavefrontAccess::LightOfSky(scene, w);
    lanes::Shine(w, this->Sampling == Strategy::Mis, false);
    for (int i = 0; i < w.Count; ++i)
      if (w.Lit[i])
      {
        const Vec3f light{ w.Cr[i], w.Cg[i], w.Cb[i] };
        b.Add(w.Live.Path[i], depth + 1, light, light);
      }
  }
  if (!goesOn)
  {
    w.Count = 0;
    return;
  }
  this->DrawBounce(b, depth, PairBsdf);
  lanes::ScatterDiffuse(w, gambles);
  lanes::Close(w, Wavefront::DiffuseRows);
}

/// Everything between two segments for paths among opaque surfaces, `depth` scatterings (perfect mirrors count) on, but
/// closing up.
void Integrator::OpaqueVertices(Batch& b, int depth) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  Wavefront& w = b.W;
  Wavefront::State& live = w.Live;
  const bool last = depth == this->MaximumBounces;
  SurfaceHit hit;
  for (int e = 0; e < w.Emitters && b.AnyLight; ++e)
  {
    const int i = int(w.Emitter[e]);
    if (!w.Alive[i])
      continue;
    WavefrontAccess::Hit(scene, w, i, false, hit);
    Vec3f unlit;
    if ((live.Flags[i] & Wavefront::SmoothMask) == 0)
    {
      float roughness;
      WavefrontAccess::Resolve(scene, hit, roughness, unlit);
    }
    this->Emit(b, i, hit, WavefrontAccess::Emission(scene, hit), unlit);
  }
  bool lights = false, any = false;
  const bool sampled = !scene.NoLights() && this->Sampling != Strategy::BsdfOnly;
  for (int i = 0; i < w.Count; ++i)
  {
    if (!w.Alive[i])
      continue;
    std::uint32_t flags = live.Flags[i];
    const int smooth = int(flags & Wavefront::SmoothMask);
    PathSample& out = b.Samples[live.Path[i]];
    if ((flags & Wavefront::DistanceBit) && smooth == 1)
    {
      out.HitDistance = w.T[i];
      flags &= ~Wavefront::DistanceBit;
    }
    const Vec3f wo = -b.Direction(i);
    if (flags & Wavefront::GuidesBit)
    {
      WavefrontAccess::Hit(scene, w, i, false, hit);
      SurfacePoint point;
      scene.Shade(hit, -wo, point);
      // the last vertex seen so far stays, should the chain of mirrors end early
      out.Guide(point, Dot(point.Normals.Shading, wo));
      if (!point.Material.IsPureDelta())
        flags &= ~Wavefront::GuidesBit;
    }
    live.Flags[i] = flags;
    const bool pending = (flags & (Wavefront::GuidesBit | Wavefront::DistanceBit)) != 0;
    if (last || !((b.AnyLight && smooth <= b.Deepest) || pending))
    {
      w.Alive[i] = 0;
      continue;
    }
    any = true;
    b.Lightable[i] = sampled && b.Wanted[std::min(smooth + 1, 2)];
    lights = lights || b.Lightable[i];
  }
  if (!any)
    return;
  WavefrontAccess::Values(scene, w);
  lanes::PrepareOpaque(w);
  const bool gambles = depth >= this->RouletteStart;
  if ((lights || gambles) && !b.Drawn)
    this->DrawBounce(b, depth, PairLightPick);
  if (lights)
  {
    if (!b.Drawn)
      this->DrawBounce(b, depth, PairLightPoint);
    for (int i = 0; i < w.Count; ++i)
    {
      const std::uint32_t lobes = w.Opaque.Lobes[i];
      b.Lightable[i] = w.Alive[i] && b.Lightable[i] &&
                       ((lobes & Wavefront::HasDiffuse) ||
                         (lobes & (Wavefront::HasSpecular | Wavefront::SpecularIsDelta)) == Wavefront::HasSpecular);
    }
    this->DrawLights(b);
    if (b.PickTriangles)
      for (int i = 0; i < w.Count; ++i)
        if (!w.Alive[i] || !b.Lightable[i])
          w.LightFlags[i] = 0;
    lanes::AimOpaque(w);
    b.Counters->Rays += WavefrontAccess::Occlude(scene, b.Context, w, b.RayKeys(2 * std::uint32_t(depth) + 1),
      this->MaximumBounces - depth - 1, b.Counters->Record);
    if (b.SkyImage)
      WavefrontAccess::LightOfSky(scene, w);
    lanes::Shine(w, this->Sampling == Strategy::Mis, true);
    for (int i = 0; i < w.Count; ++i)
      if (w.Lit[i])
        b.Add(live.Path[i], int(live.Flags[i] & Wavefront::SmoothMask) + 1, { w.Cr[i], w.Cg[i], w.Cb[i] },
          { w.Br[i], w.Bg[i], w.Bb[i] });
  }
  if (!b.Drawn)
    for (SamplePair pair : { PairBsdf, PairLobe })
      this->DrawBounce(b, depth, pair);
  lanes::ScatterOpaque(w, b.Deepest, gambles, depth + 1 == this->MaximumBounces && !scene.HasHittable());
}

/// Everything at the vertex of one path but the shadow ray, which is left in the row's columns; false: the path ends.
bool Integrator::Scatter(Batch& b, int i, int depth) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  Wavefront& w = b.W;
  Wavefront::State& live = w.Live;
  std::uint32_t flags = live.Flags[i];
  const std::uint32_t path = live.Path[i];
  PathSample& out = b.Samples[path];
  int smooth = int(flags & Wavefront::SmoothMask);
  if ((flags & Wavefront::DistanceBit) && smooth == 1)
  {
    out.HitDistance = w.T[i];
    flags &= ~Wavefront::DistanceBit;
  }
  SurfaceHit hit;
  WavefrontAccess::Hit(scene, w, i, false, hit);
  Vec3f throughput = b.Throughput(i);
  const Vec3f direction = b.Direction(i);
  if (scene.Has.Volumes && !hit.Front)
  {
    Vec3f color;
    float length;
    if (scene.Attenuation(hit, color, length))
    {
      const float inside = hit.T + live.Skipped[i];
      for (int c = 0; c < 3; ++c)
        throughput[c] *= color[c] > 0 ? std::pow(color[c], inside / length) : 0;
      live.Tr[i] = throughput.x;
      live.Tg[i] = throughput.y;
      live.Tb[i] = throughput.z;
    }
  }
  const bool last = depth == this->MaximumBounces;
  // At the end of the path only emission counts.
  if (last && !(flags & Wavefront::GuidesBit) && smooth > 0)
  {
    this->Emit(b, i, hit, WavefrontAccess::Emission(scene, hit), Vec3f());
    return false;
  }

  SurfacePoint point;
  scene.Shade(hit, direction, point);
  this->Emit(b, i, hit, point.Emission, point.DisplayOnly);
  Surface& material = point.Material;
  const Vec3f wo = -direction;
  const ShadingNormals& normals = point.Normals;
  const float facing = Dot(normals.Shading, wo);
  if (flags & Wavefront::GuidesBit)
  {
    // the last vertex seen so far stays, should the chain of mirrors end early
    out.Guide(point, facing);
    if (!material.IsPureDelta())
      flags &= ~Wavefront::GuidesBit;
  }
  const std::uint32_t pending = flags & (Wavefront::GuidesBit | Wavefront::DistanceBit);
  if (last || !((b.AnyLight && smooth <= b.Deepest) || pending))
    return false;

  const Receiver here{ hit.Pf, normals.Shading, material.ScattersBelow() };
  material.Prepare(facing);
  const int next = std::min(smooth + 1, 2);
  if (b.Wanted[next] && material.HasSmooth() && !scene.NoLights() && this->Sampling != Strategy::BsdfOnly)
  {
    LightSampler::Sample s;
    if (scene.DrawLight(here, live.Time[i], w.Random[2 * PairLightPick][i], w.Random[2 * PairLightPoint][i],
          w.Random[2 * PairLightPoint + 1][i], s))
    {
      Vec3f diffuse, specular;
      float scatterPdf;
      material.Evaluate(normals, wo, s.Wi, diffuse, specular, scatterPdf);
      const Vec3f value = throughput * (diffuse + specular);
      if (MaxComponent(value) > 0)
      {
        const Vec3f emission = s.Textured ? scene.LightEmission(s) : s.Emission;
        if (MaxComponent(emission) > 0)
        {
          const bool above = Dot(normals.Geometric, s.Wi) > 0;
          const Vec3f origin = hit.Pf + normals.Geometric * (above ? hit.Offset : -hit.Offset);
          const Vec3f along = s.AtInfinity ? s.Wi : s.Target - origin;
          float weight = 1 / s.Pdf;
          if (s.Kind != LightSampler::Sample::From::Punctual && this->Sampling == Strategy::Mis)
            weight *= PowerHeuristic(s.Pdf, scatterPdf);
          const Vec3f lit = value * emission * weight;
          const Vec3f part = smooth == 0 ? throughput * diffuse * emission * weight : lit * b.Share(i);
          w.Kx[i] = origin.x;
          w.Ky[i] = origin.y;
          w.Kz[i] = origin.z;
          w.Jx[i] = along.x;
          w.Jy[i] = along.y;
          w.Jz[i] = along.z;
          w.Far[i] = s.AtInfinity ? std::numeric_limits<float>::infinity() : ShadowEnd;
          w.Cr[i] = lit.x;
          w.Cg[i] = lit.y;
          w.Cb[i] = lit.z;
          w.Br[i] = part.x;
          w.Bg[i] = part.y;
          w.Bb[i] = part.z;
          w.LightFlags[i] = std::uint32_t(smooth + 1);
          w.Lit[i] = ~0u;
        }
      }
    }
  }

  const Surface::Sampled s = material.Sample(normals, wo, w.Random[2 * PairBsdf][i], w.Random[2 * PairBsdf + 1][i],
    w.Random[2 * PairLobe][i], w.Random[2 * PairLobe + 1][i]);
  if (!(s.Pdf > 0))
    return false;
  const Vec3f weight = s.Diffuse + s.Specular;
  throughput *= weight;
  if (!(MaxComponent(throughput) > 0))
    return false;
  if (s.Transmitted)
    live.EtaScale[i] *= s.Eta2;
  // Shadow rays pass panes straight, too: what lies behind is weighed as the vertex before the pane would.
  if (!s.Straight)
  {
    flags = s.Delta ? flags | Wavefront::DeltaBit : flags & ~Wavefront::DeltaBit;
    live.Pdf[i] = s.Pdf;
  }
  if (!s.Delta)
  {
    if (smooth == 0)
    {
      live.Sr[i] = weight.x > 0 ? s.Diffuse.x / weight.x : 0;
      live.Sg[i] = weight.y > 0 ? s.Diffuse.y / weight.y : 0;
      live.Sb[i] = weight.z > 0 ? s.Diffuse.z / weight.z : 0;
    }
    if (++smooth > b.Deepest)
      return false;
    live.Fx[i] = here.Position.x;
    live.Fy[i] = here.Position.y;
    live.Fz[i] = here.Position.z;
    live.Nx[i] = here.Normal.x;
    live.Ny[i] = here.Normal.y;
    live.Nz[i] = here.Normal.z;
    flags = here.BothSides ? flags | Wavefront::BothSidesBit : flags & ~Wavefront::BothSidesBit;
  }
  // Nothing left to meet: the last segment finds emitters only.
  if (depth + 1 == this->MaximumBounces && !pending && !scene.HasHittable())
    return false;
  if (depth >= this->RouletteStart)
  {
    const float q = MaxComponent(throughput) * live.EtaScale[i];
    if (q < 1)
    {
      const float p = std::min(0.99f, std::max(0.05f, q));
      if (w.Random[2 * PairLightPick + 1][i] >= p)
        return false;
      throughput *= 1 / p;
    }
  }
  const Vec3f origin = hit.Pf + normals.Geometric * (s.Transmitted ? -hit.Offset : hit.Offset);
  live.Ox[i] = origin.x;
  live.Oy[i] = origin.y;
  live.Oz[i] = origin.z;
  live.Dx[i] = s.Wi.x;
  live.Dy[i] = s.Wi.y;
  live.Dz[i] = s.Wi.z;
  // no more than 64 offsets, for rays that graze
  live.Skipped[i] = hit.Offset / std::max(std::fabs(Dot(normals.Geometric, s.Wi)), 1.f / 64);
  live.Tr[i] = throughput.x;
  live.Tg[i] = throughput.y;
  live.Tb[i] = throughput.z;
  live.Flags[i] = (flags & ~Wavefront::SmoothMask) | std::uint32_t(smooth);
  return true;
}

/// Everything between two segments for any paths: opaque surfaces in vectors, glass and clearcoats one by one.
void Integrator::GeneralVertices(Batch& b, int depth) const noexcept
{
  Wavefront& w = b.W;
  int apart = 0, others = 0;
  for (int i = 0; i < w.Count; ++i)
  {
    const bool alive = w.Alive[i] != 0, layered = b.OneByOne || (w.Material[i] & WavefrontAccess::Layered) != 0;
    b.Apart[apart] = i;
    apart += alive && layered;
    others += alive && !layered;
  }
  b.Drawn = apart > 0 && depth < this->MaximumBounces && (b.AnyLight || b.Guides || b.Distance);
  if (b.Drawn)
    for (SamplePair pair : { PairLightPick, PairLightPoint, PairBsdf, PairLobe })
      this->DrawBounce(b, depth, pair);
  if (others > 0)
  {
    // vectors overwrite the state of every row
    std::uint32_t* state = reinterpret_cast<std::uint32_t*>(&w.Live);
    for (int row = 0; apart > 0 && row < Wavefront::AllRows; ++row)
      for (int k = 0; k < apart; ++k)
        b.Kept[row][k] = state[row * Wavefront::Stride + b.Apart[k]];
    for (int k = 0; k < apart; ++k)
      w.Alive[b.Apart[k]] = 0;
    this->OpaqueVertices(b, depth);
    for (int row = 0; apart > 0 && row < Wavefront::AllRows; ++row)
      for (int k = 0; k < apart; ++k)
        state[row * Wavefront::Stride + b.Apart[k]] = b.Kept[row][k];
    for (int k = 0; k < apart; ++k)
      w.Alive[b.Apart[k]] = ~0u;
  }
  b.Drawn = false;
  if (apart > 0)
  {
    for (int i = 0; i < w.Count; ++i)
      w.Lit[i] = 0;
    for (int k = 0; k < apart; ++k)
      if (!this->Scatter(b, b.Apart[k], depth))
        w.Alive[b.Apart[k]] = 0;
    b.Counters->Rays += WavefrontAccess::Occlude(*this->Scene, b.Context, w, b.RayKeys(2 * std::uint32_t(depth) + 1),
      this->MaximumBounces - depth - 1, b.Counters->Record);
    for (int k = 0; k < apart; ++k)
      if (const int i = b.Apart[k]; w.Lit[i])
        b.Add(w.Live.Path[i], int(w.LightFlags[i]), { w.Cr[i], w.Cg[i], w.Cb[i] }, { w.Br[i], w.Bg[i], w.Bb[i] });
  }
}

template <Integrator::Variant variant>
void Integrator::Run(Batch& b) const noexcept
{
  const EmbreeScene& scene = *this->Scene;
  Wavefront& w = b.W;
  TraceCounters& counters = *b.Counters;
  for (int depth = 0; w.Count > 0; ++depth)
  {
    const bool more = depth < this->MaximumBounces && (b.AnyLight || b.Distance);
    WavefrontAccess::Intersect(scene, b.Context, w, b.RayKeys(2 * std::uint32_t(depth)), counters.Record);
    counters.Rays += w.Count;
    WavefrontAccess::Fetch(scene, w, b.Guides || more);
    lanes::Locate(w);
    WavefrontAccess::Straighten(scene, w);
    if (depth == 0 && b.PrimaryHit)
      this->Primary(b);
    if (b.SkyImage && b.AnyLight)
      WavefrontAccess::FindSky(scene, w);
    for (int i = 0; i < w.Count; ++i)
      if (!w.Alive[i])
        this->Sky(b, i);
    if constexpr (variant == Variant::Diffuse)
      this->DiffuseVertices(b, depth);
    else
    {
      if constexpr (variant == Variant::Opaque)
        this->OpaqueVertices(b, depth);
      else
        this->GeneralVertices(b, depth);
      lanes::Close(w, Wavefront::AllRows);
    }
  }
}
}
