// SPDX-License-Identifier: BSD-3-Clause
// Stages straight from their formulas, in double: what float costs is measured against these.
#ifndef References_h
#define References_h

#include "../Contract/PortBench.h"
#include "quellAccumulate.h"
#include "quellBilateral.h"
#include "quellKernelFilter.h"
#include "quellNonLocal.h"
#include "quellReproject.h"
#include "quellSampleFilter.h"
#include "quellTemporalAntialias.h"
#include "quellVarianceSteered.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace
{
namespace quelltest
{
/// An array in double that is read with frame coordinates.
struct Plane
{
  int w = 0, h = 0, n = 0;
  std::vector<double> v;

  Plane() = default;
  Plane(int width, int height, int components)
    : w(width)
    , h(height)
    , n(components)
    , v(std::size_t(width) * height * components)
  {
  }
  double* at(int x, int y) { return &this->v[(std::size_t(y) * this->w + x) * this->n]; }
  const double* at(int x, int y) const { return &this->v[(std::size_t(y) * this->w + x) * this->n]; }
  bool inside(int x, int y) const { return x >= 0 && y >= 0 && x < this->w && y < this->h; }
  explicit operator bool() const { return this->n > 0; }
};

/// What a stage is measured with.
struct Case
{
  std::string Type, Settings; ///< "Property=value ..." that differ from the defaults
  std::string LeaveOut;       ///< a port, or "optional"
  std::string Output;         ///< judged
  /// Fills the output's plane from the bench's inputs; null: `Reason` says why there is no reference.
  std::function<Plane(PortBench&)> Reference;
  std::string Reason;
};

double Lum(const double* c)
{
  return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
}

/// All inputs of a bench, in float for the project's own references and in double for those here.
struct Inputs
{
  PortBench& Bench;
  std::map<std::string, std::vector<float>> Floats;

  explicit Inputs(PortBench& bench)
    : Bench(bench)
  {
    for (PortBench::Feed& feed : bench.Feeds)
      this->Floats[feed.Name] = feed.Source->Values(feed.Array);
  }
  int Components(const std::string& name) const
  {
    return int(this->Floats.at(name).size() / (std::size_t(this->Bench.Width) * this->Bench.Height));
  }
  /// Absent where the port is not connected.
  quell::ImageIn In(const std::string& name) const
  {
    const auto found = this->Floats.find(name);
    if (found == this->Floats.end())
      return {};
    return { found->second.data(), this->Components(name), { 0, 0, this->Bench.Width, this->Bench.Height } };
  }
  Plane Get(const std::string& name) const
  {
    if (!this->Floats.count(name))
      return {};
    Plane p(this->Bench.Width, this->Bench.Height, this->Components(name));
    std::copy(this->Floats.at(name).begin(), this->Floats.at(name).end(), p.v.begin());
    return p;
  }
  /// Of a property; kept by the address of its name, which is a literal.
  double Number(const char* property) const
  {
    for (const auto& known : this->Numbers)
      if (known.first == property)
        return known.second;
    this->Numbers.emplace_back(property, std::stod(this->Bench.Stage->GetPropertyText(property)));
    return this->Numbers.back().second;
  }

private:
  mutable std::vector<std::pair<const char*, double>> Numbers;
};

/// The plane that a reference which writes floats makes.
struct Target
{
  std::vector<float> data;
  quell::Rect extent;
  int n;
  Target(const Inputs& in, int components)
    : data(std::size_t(in.Bench.Width) * in.Bench.Height * components)
    , extent{ 0, 0, in.Bench.Width, in.Bench.Height }
    , n(components)
  {
  }
  operator quell::ImageOut() { return { this->data.data(), this->n, this->extent }; }
  Plane Take() const
  {
    Plane p(this->extent.width(), this->extent.height(), this->n);
    std::copy(this->data.begin(), this->data.end(), p.v.begin());
    return p;
  }
};

template <class F>
Plane Pixelwise(const Plane& like, int components, F&& body)
{
  Plane out(like.w, like.h, components);
  for (int y = 0; y < like.h; ++y)
    for (int x = 0; x < like.w; ++x)
      body(x, y, out.at(x, y));
  return out;
}

double Divisor(const Inputs& in, const Plane& albedo, int x, int y, int c)
{
  return std::min(1., std::max(in.Number("Floor"), albedo.at(x, y)[c]));
}

Plane Demodulate(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance"), a = in.Get("albedo");
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      for (int k = 0; k < 3; ++k)
        o[k] = c.at(x, y)[k] / Divisor(in, a, x, y, k);
    });
}
Plane Modulate(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("illumination"), a = in.Get("albedo");
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      for (int k = 0; k < 3; ++k)
        o[k] = c.at(x, y)[k] * Divisor(in, a, x, y, k);
    });
}
Plane Add(PortBench& bench)
{
  const Inputs in(bench);
  const Plane a = in.Get("radiance 1"), b = in.Get("radiance 2");
  return Pixelwise(a, 3,
    [&](int x, int y, double* o)
    {
      for (int k = 0; k < 3; ++k)
        o[k] = a.at(x, y)[k] + b.at(x, y)[k];
    });
}
Plane AovDirect(PortBench& bench)
{
  const Inputs in(bench);
  const char* const pairs[][2] = { { "diffuseDirect", "diffuseColor" }, { "glossyDirect", "glossyColor" },
    { "transmissionDirect", "transmissionColor" } };
  Plane out = in.Get("volumeDirect");
  for (const auto& pair : pairs)
  {
    const Plane light = in.Get(pair[0]), color = in.Get(pair[1]);
    for (std::size_t i = 0; i < out.v.size(); ++i)
      out.v[i] += light.v[i] * color.v[i];
  }
  return out;
}
Plane Firefly(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance"), count = in.Get("count");
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      const double* v = c.at(x, y);
      const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
      const double limit = in.Number("Threshold") * std::pow(std::max(1., *count.at(x, y)), in.Number("Growth"));
      for (int k = 0; k < 3; ++k)
        o[k] = length > limit ? v[k] * (limit / length) : v[k];
    });
}
Plane Rank(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance"), id = in.Get("id");
  const int r = int(in.Number("Radius")), rank = int(in.Number("Rank"));
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      std::vector<double> around;
      for (int dy = -r; dy <= r; ++dy)
        for (int dx = -r; dx <= r; ++dx)
          if ((dx || dy) && c.inside(x + dx, y + dy) && *id.at(x, y) == *id.at(x + dx, y + dy))
            around.push_back(Lum(c.at(x + dx, y + dy)));
      std::sort(around.rbegin(), around.rend());
      const double own = Lum(c.at(x, y));
      const double limit =
        around.empty() ? 1e300 : in.Number("Factor") * around[std::size_t(std::min(rank, int(around.size())) - 1)];
      for (int k = 0; k < 3; ++k)
        o[k] = own > limit ? c.at(x, y)[k] * (limit / own) : c.at(x, y)[k];
    });
}
Plane MeansMean(PortBench& bench)
{
  const Inputs in(bench);
  const Plane a = in.Get("radiance 1"), b = in.Get("radiance 2");
  return Pixelwise(a, 3,
    [&](int x, int y, double* o)
    {
      for (int k = 0; k < 3; ++k)
        o[k] = 0.5 * (a.at(x, y)[k] + b.at(x, y)[k]);
    });
}
Plane Lamps(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance");
  const double threshold = in.Number("Threshold"), part = in.Number("EdgePart");
  const int least = int(in.Number("Neighbours")), grow = int(in.Number("Grow"));
  const auto above = [&](int x, int y) { return c.inside(x, y) && Lum(c.at(x, y)) > threshold; };
  const auto bright = [&](int x, int y)
  {
    int n = 0;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        n += (dx || dy) && above(x + dx, y + dy);
    return above(x, y) && n >= least;
  };
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      bool lamp = bright(x, y);
      if (!lamp && Lum(c.at(x, y)) >= part * threshold)
        for (int dy = -grow; dy <= grow; ++dy)
          for (int dx = -grow; dx <= grow; ++dx)
            lamp = lamp || bright(x + dx, y + dy);
      for (int k = 0; k < 3; ++k)
        o[k] = lamp ? 0 : c.at(x, y)[k];
    });
}
Plane Fixed(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance");
  const double s = in.Number("Sigma");
  const int r = int(std::ceil(3 * s));
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      double sw = 0, sum[3] = {};
      for (int dy = -r; dy <= r; ++dy)
        for (int dx = -r; dx <= r; ++dx)
          if (c.inside(x + dx, y + dy))
          {
            const double w = std::exp(-(dx * dx + dy * dy) / (2 * s * s));
            sw += w;
            for (int k = 0; k < 3; ++k)
              sum[k] += w * c.at(x + dx, y + dy)[k];
          }
      for (int k = 0; k < 3; ++k)
        o[k] = sum[k] / sw;
    });
}

/// The smaller one-sided difference on the same object, per axis.
double Slope(const Plane& z, const Plane& id, int x, int y, int dx, int dy)
{
  double best = 1e300;
  for (int side : { -1, 1 })
  {
    const int qx = x + side * dx, qy = y + side * dy;
    if (!z.inside(qx, qy) || !std::isfinite(*z.at(qx, qy)) || (id && *id.at(qx, qy) != *id.at(x, y)))
      continue;
    const double d = side * (*z.at(qx, qy) - *z.at(x, y));
    if (std::fabs(d) < std::fabs(best))
      best = d;
  }
  return best < 1e300 ? best : 0;
}
struct Surfaces
{
  Plane z, normal, id;
  double sigmaDepth, sigmaNormal, epsilon;
  explicit Surfaces(const Inputs& in)
    : z(in.Get("depth"))
    , normal(in.Get("normal"))
    , id(in.Get("id"))
    , sigmaDepth(in.Number("SigmaDepth"))
    , sigmaNormal(in.Number("SigmaNormal"))
    , epsilon(in.Number("DepthEpsilon"))
  {
  }
  /// Weight of depth, normal and id between p and q = p + (dx, dy); 0 where q does not count.
  double operator()(int x, int y, int dx, int dy) const
  {
    const int qx = x + dx, qy = y + dy;
    if (!this->z.inside(qx, qy) || !std::isfinite(*this->z.at(qx, qy)) || *this->id.at(qx, qy) != *this->id.at(x, y))
      return 0;
    const double along = Slope(this->z, this->id, x, y, 1, 0) * dx + Slope(this->z, this->id, x, y, 0, 1) * dy;
    const double d = std::fabs(*this->z.at(x, y) - *this->z.at(qx, qy));
    const double *a = this->normal.at(x, y), *b = this->normal.at(qx, qy);
    const double cosine = std::min(1., std::max(0., a[0] * b[0] + a[1] * b[1] + a[2] * b[2]));
    return std::exp(-d / (this->sigmaDepth * std::fabs(along) + this->epsilon * std::fabs(*this->z.at(x, y)))) *
           std::pow(cosine, this->sigmaNormal);
  }
};

Plane Wavelet(PortBench& bench)
{
  const Inputs in(bench);
  Plane c = in.Get("radiance"), v = in.Get("variance");
  const Surfaces surfaces(in);
  const double h[3] = { 3. / 8, 1. / 4, 1. / 16 }, g[2] = { 0.5, 0.25 };
  for (int pass = 0; pass < int(in.Number("Iterations")); ++pass)
  {
    Plane nc = c, nv = v;
    const int step = 1 << pass;
    for (int y = 0; y < c.h; ++y)
      for (int x = 0; x < c.w; ++x)
      {
        if (!std::isfinite(*surfaces.z.at(x, y)))
          continue;
        double blurred = 0, sg = 0;
        for (int dy = -1; dy <= 1; ++dy)
          for (int dx = -1; dx <= 1; ++dx)
            if (c.inside(x + dx, y + dy) && std::isfinite(*surfaces.z.at(x + dx, y + dy)))
            {
              const double w = g[std::abs(dx)] * g[std::abs(dy)];
              blurred += w * *v.at(x + dx, y + dy), sg += w;
            }
        const double l = Lum(c.at(x, y));
        const double sigma = in.Number("SigmaLuminance") * std::sqrt(std::max(0., blurred / sg)) +
                             in.Number("LuminanceEpsilon") * (1 + std::fabs(l));
        double sw = 0, sv = 0, sc[3] = {};
        for (int dy = -2; dy <= 2; ++dy)
          for (int dx = -2; dx <= 2; ++dx)
          {
            const int qx = x + step * dx, qy = y + step * dy;
            const double kernel = h[std::abs(dx)] * h[std::abs(dy)];
            const double geometry = dx || dy ? surfaces(x, y, step * dx, step * dy) : 1;
            if (geometry == 0)
              continue;
            const double w = kernel * geometry * std::exp(-std::fabs(l - Lum(c.at(qx, qy))) / sigma);
            sw += w, sv += w * w * *v.at(qx, qy);
            for (int k = 0; k < 3; ++k)
              sc[k] += w * (c.at(qx, qy)[k] - c.at(x, y)[k]);
          }
        for (int k = 0; k < 3; ++k)
          nc.at(x, y)[k] = c.at(x, y)[k] + sc[k] / sw;
        *nv.at(x, y) = sv / (sw * sw);
      }
    std::swap(c, nc);
    std::swap(v, nv);
  }
  return c;
}

Plane SpatialVariance(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance");
  const Surfaces surfaces(in);
  const Plane length = in.Get("length");
  return Pixelwise(c, 1,
    [&](int x, int y, double* o)
    {
      *o = 0;
      if (!std::isfinite(*surfaces.z.at(x, y)))
        return;
      double sw = 0, sm = 0, sv = 0, others = 0;
      std::vector<std::array<double, 2>> taps;
      for (int dy = -3; dy <= 3; ++dy)
        for (int dx = -3; dx <= 3; ++dx)
        {
          const double w = dx || dy ? surfaces(x, y, dx, dy) : 1;
          if (w == 0)
            continue;
          taps.push_back({ w, Lum(c.at(x + dx, y + dy)) });
          sw += w, sm += w * taps.back()[1], others += dx || dy ? w : 0;
        }
      for (const auto& t : taps)
        sv += t[0] * (t[1] - sm / sw) * (t[1] - sm / sw);
      const double l = Lum(c.at(x, y));
      // Without moments there is no length either: one frame.
      *o = others < 0.01 ? l * l : sv / sw * std::max(1., in.Number("MinimumHistory"));
    });
}

Plane Spread(PortBench& bench)
{
  const Inputs in(bench);
  const Plane residual = in.Get("residual"), z = in.Get("depth"), n = in.Get("normal"), id = in.Get("id");
  Plane out = in.Get("radiance");
  const double sn = in.Number("SigmaNormal"), sd = in.Number("SigmaDepth");
  for (int y = 0; y < out.h; ++y)
    for (int x = 0; x < out.w; ++x)
    {
      const double* r = residual.at(x, y);
      const double length = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
      const double s = in.Number("Sigma") * std::sqrt(std::max(1., length / in.Number("Threshold")));
      const int window = std::min(int(in.Number("Radius")), int(std::ceil(2.5 * s)));
      const bool hit = std::isfinite(*z.at(x, y));
      double total = 0;
      for (int pass = 0; pass < 2; ++pass)
      {
        for (int dy = -window; dy <= window; ++dy)
          for (int dx = -window; dx <= window; ++dx)
          {
            const int qx = x + dx, qy = y + dy;
            if (!out.inside(qx, qy) ||
                ((dx || dy) && (!hit || !std::isfinite(*z.at(qx, qy)) || *id.at(x, y) != *id.at(qx, qy))))
              continue;
            double e = (dx * dx + dy * dy) / (2 * s * s);
            if (dx || dy)
            {
              for (int k = 0; k < 3; ++k)
                e += std::pow(n.at(x, y)[k] - n.at(qx, qy)[k], 2) / (2 * sn * sn);
              e += std::pow(std::log(*z.at(x, y) / *z.at(qx, qy)), 2) / (2 * sd * sd);
            }
            const double w = std::exp(-e);
            if (pass == 0)
              total += w;
            else
              for (int k = 0; k < 3; ++k)
                out.at(qx, qy)[k] += r[k] * w / total;
          }
      }
    }
  return out;
}

Plane Snap(PortBench& bench)
{
  const Inputs in(bench);
  const Plane n = in.Get("normal"), z = in.Get("depth"), p = in.Get("position"), id = in.Get("id");
  const Plane variance = in.Get("varianceNormal");
  const auto length = [&](int x, int y)
  {
    const double* v = n.at(x, y);
    return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  };
  const auto mixed = [&](int x, int y)
  {
    double v = 0;
    for (int k = 0; k < variance.n; ++k)
      v += variance.at(x, y)[k] / variance.n;
    return length(x, y) < 0.99f || v > in.Number("MixedVariance");
  };
  return Pixelwise(n, 3,
    [&](int x, int y, double* o)
    {
      std::copy_n(n.at(x, y), 3, o);
      if (length(x, y) == 0 || !mixed(x, y) || !std::isfinite(*z.at(x, y)))
        return;
      double best = 0;
      int bx = x, by = y;
      for (int dy = -2; dy <= 2; ++dy)
        for (int dx = -2; dx <= 2; ++dx)
        {
          const int qx = x + dx, qy = y + dy;
          if (!n.inside(qx, qy) || !std::isfinite(*z.at(qx, qy)) || *id.at(x, y) != *id.at(qx, qy) || mixed(qx, qy) ||
              length(qx, qy) == 0)
            continue;
          double cosine = 0, d = 0;
          for (int k = 0; k < 3; ++k)
          {
            cosine += n.at(x, y)[k] * n.at(qx, qy)[k] / length(qx, qy);
            d += n.at(qx, qy)[k] * (p.at(qx, qy)[k] - p.at(x, y)[k]);
          }
          d /= *z.at(x, y);
          const double e = d * d / (2 * in.Number("SigmaDepth") * in.Number("SigmaDepth")) + 0.5 * (dx * dx + dy * dy);
          if (cosine > 0 && e < 8 && std::exp(-e) * cosine > best)
            best = std::exp(-e) * cosine, bx = qx, by = qy;
        }
      for (int k = 0; k < 3; ++k)
        o[k] = n.at(bx, by)[k] / length(bx, by);
    });
}

Plane Srgb(PortBench& bench)
{
  const Inputs in(bench);
  const Plane c = in.Get("radiance");
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      for (int k = 0; k < 3; ++k)
      {
        const double v = c.at(x, y)[k];
        o[k] = std::min(1., std::max(0., v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055));
      }
    });
}

// References that the kernels' tests have: the formula in double, rounded once.
Plane Joint(PortBench& bench)
{
  const Inputs in(bench);
  quell::BilateralInputs i;
  i.radiance = in.In("radiance"), i.depth = in.In("depth"), i.normal = in.In("normal"), i.albedo = in.In("albedo");
  i.position = in.In("position"), i.id = in.In("id");
  Target out(in, 3);
  quell::BilateralScalar(i, {}, { out, {} }, out.extent);
  return out.Take();
}
Plane Features(PortBench& bench)
{
  const Inputs in(bench);
  quell::BilateralInputs i;
  i.radiance = in.In("albedo"), i.depth = in.In("depth"), i.normal = in.In("normal");
  i.position = in.In("position"), i.id = in.In("id");
  i.guides[0].value = in.In("albedo"), i.guides[0].sigma = in.Number("SigmaFeature");
  i.guides[0].variance = in.In("varianceAlbedo");
  i.guides[1].value = in.In("normal"), i.guides[1].sigma = in.Number("SigmaNormal");
  i.guides[1].distance = quell::GuideDistance::Normal;
  i.guideCount = 2;
  quell::BilateralParameters p;
  p.radius = int(in.Number("Radius"));
  p.sigmaSpatial = p.sigmaRange = p.sigmaAlbedo = p.sigmaNormal = 1e30;
  p.sigmaDepth = in.Number("SigmaDepth");
  Target out(in, 3);
  quell::BilateralScalar(i, p, { out, {} }, out.extent);
  return out.Take();
}
Plane NonLocal(PortBench& bench, bool regress)
{
  const Inputs in(bench);
  // The stage's variance is that of the pixel; the kernel's that of what gives the weights, so it takes twice as much
  // of halves. Here there are none.
  quell::NonLocalInputs i;
  i.target = i.guide = in.In("radiance");
  i.variance = in.In("variance");
  i.depth = in.In("depth");
  i.weighing[0].value = in.In("guide"), i.weighing[0].variance = in.In("guideVariance");
  i.weighingCount = 1;
  quell::NonLocalParameters p;
  p.radius = int(in.Number("Radius")), p.patch = int(in.Number("PatchRadius"));
  p.kColor = in.Number("KColor"), p.kFeature = in.Number("KGuide"), p.epsilon = in.Number("Epsilon");
  p.regress = regress;
  if (regress)
  {
    p.ridge = in.Number("Ridge");
    i.regressors[0].value = in.In("feature");
    i.regressorCount = 1;
  }
  Target out(in, 3);
  quell::NonLocalScalar(i, p, out, out.extent);
  return out.Take();
}
Plane Samples(PortBench& bench)
{
  const Inputs in(bench);
  const quell::ImageIn radiance[] = { in.In("radiance 1"), in.In("radiance 2") };
  const quell::ImageIn depth[] = { in.In("depth 1"), in.In("depth 2") };
  const quell::ImageIn normal[] = { in.In("normal 1"), in.In("normal 2") };
  const quell::ImageIn albedo[] = { in.In("albedo 1"), in.In("albedo 2") };
  const quell::ImageIn id[] = { in.In("id 1"), in.In("id 2") };
  quell::SampleFilterInputs i;
  i.count = 2;
  i.radiance = radiance, i.depth = depth, i.normal = normal, i.albedo = albedo, i.id = id;
  Target out(in, 3);
  quell::SampleFilterParameters p;
  p.demodulate = true;
  quell::SampleFilterScalar(i, p, out, out.extent);
  return out.Take();
}
Plane Steered(PortBench& bench)
{
  const Inputs in(bench);
  quell::VarianceSteeredInputs i;
  i.radiance = in.In("radiance"), i.variance = in.In("variance"), i.depth = in.In("depth");
  i.normal = in.In("normal"), i.albedo = in.In("albedo"), i.id = in.In("id");
  const quell::VarianceSteeredParameters p;
  const Plane c = in.Get("radiance"), v = in.Get("variance"), z = in.Get("depth");
  std::vector<Plane> color(1, c), error(1, v);
  for (int s = 1; s <= p.scales; ++s)
  {
    color.emplace_back(c.w, c.h, 3);
    error.emplace_back(c.w, c.h, 1);
    for (int y = 0; y < c.h; ++y)
      for (int x = 0; x < c.w; ++x)
      {
        const quell::VarianceSteeredPixel pixel = quell::VarianceSteeredScalar(i, p, s, x, y);
        for (int k = 0; k < 3; ++k)
          color.back().at(x, y)[k] = pixel.Color[k];
        const double d = Lum(color.back().at(x, y)) - Lum(c.at(x, y));
        *error.back().at(x, y) = d * d + *v.at(x, y) * (2 * pixel.Centre - 1);
      }
  }
  const auto hit = [&](int x, int y) { return c.inside(x, y) && std::isfinite(*z.at(x, y)); };
  const auto choose = [&](int x, int y)
  {
    int best = 0;
    double least = 1e300;
    for (int s = 0; s <= p.scales; ++s)
    {
      double sum = 0;
      for (int dy = -3; dy <= 3; ++dy)
        for (int dx = -3; dx <= 3; ++dx)
          sum += hit(x + dx, y + dy) ? *error[std::size_t(s)].at(x + dx, y + dy) : 0;
      if (sum < least)
        least = sum, best = s;
    }
    return best;
  };
  return Pixelwise(c, 3,
    [&](int x, int y, double* o)
    {
      std::copy_n(c.at(x, y), 3, o);
      if (!hit(x, y))
        return;
      int voters = 0;
      double sum[3] = {};
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          if (hit(x + dx, y + dy))
          {
            const Plane& f = color[std::size_t(choose(x + dx, y + dy))];
            for (int k = 0; k < 3; ++k)
              sum[k] += f.at(x, y)[k];
            ++voters;
          }
      for (int k = 0; k < 3; ++k)
        o[k] = sum[k] / voters;
    });
}
Plane Average(PortBench& bench)
{
  const Inputs in(bench);
  Target color(in, 3), moments(in, 2), length(in, 1);
  quell::AccumulateScalar({ in.In("radiance"), in.In("history"), in.In("moments"), in.In("length") },
    { in.Number("Alpha"), in.Number("MomentsAlpha"), in.Number("MaximumHistory") }, { color, moments, length },
    color.extent);
  return color.Take();
}
Plane Antialias(PortBench& bench)
{
  const Inputs in(bench);
  quell::AntialiasInputs i;
  i.radiance = in.In("radiance"), i.motion = in.In("motion"), i.depth = in.In("depth"), i.history = in.In("history");
  Target out(in, 3);
  i.frame = out.extent;
  quell::TemporalAntialiasScalar(i, {}, out, out.extent);
  return out.Take();
}
Plane Fetch(PortBench& bench)
{
  const Inputs in(bench);
  quell::ReprojectInputs i;
  i.depth = in.In("depth"), i.normal = in.In("normal"), i.id = in.In("id"), i.motion = in.In("motion");
  i.history = in.In("history"), i.moments = in.In("moments"), i.length = in.In("length");
  i.previousDepth = in.In("previousDepth"), i.previousNormal = in.In("previousNormal"),
  i.previousId = in.In("previousId");
  Target color(in, 3), moments(in, 2), length(in, 1), mask(in, 1);
  i.frame = color.extent;
  quell::ReprojectScalar(i, {}, { color, moments, length, mask }, color.extent);
  return color.Take();
}

const std::vector<Case>& Cases()
{
  static const std::vector<Case> cases = {
    { "ATrousFilter", "", "", "radiance", Wavelet, "" },
    { "AlbedoDemodulate", "", "", "illumination", Demodulate, "" },
    { "AlbedoModulate", "", "", "radiance", Modulate, "" },
    { "AovSplit", "", "", "direct", AovDirect, "" },
    { "BilateralFilter", "", "guide guideVariance", "radiance", Joint, "" },
    { "CompareFrames", "", "", "", nullptr, "metrics are summed in double" },
    { "CompareImages", "", "", "", nullptr, "metrics are summed in double" },
    { "DisplayTransform", "View=sRGB", "", "display", Srgb, "" },
    { "EmissionSplit", "", "", "radiance", Lamps, "" },
    { "FeaturePrefilter", "", "", "albedo", Features, "" },
    { "FireflyClamp", "Threshold=1", "", "radiance", Firefly, "" },
    { "ImageReader", "", "", "", nullptr, "computes nothing; storage below" },
    { "ImageWriter", "", "", "", nullptr, "computes nothing; storage below" },
    { "KernelFilter", "", "", "radiance", Fixed, "" },
    { "MedianOfMeans", "", "", "mean", MeansMean, "" },
    { "NonLocalMeans", "KColor=3", "halfA halfB", "radiance", [](PortBench& b) { return NonLocal(b, false); }, "" },
    { "NormalSnap", "", "", "normal", Snap, "" },
    { "PathTraceSource", "", "", "", nullptr,
      "samples are summed in double; a path's own rounding is far below its noise (tests References.*)" },
    { "RankClamp", "", "", "radiance", Rank, "" },
    { "Redistribute", "", "", "radiance", Spread, "" },
    { "RegressionFilter", "", "halfA halfB", "radiance", [](PortBench& b) { return NonLocal(b, true); }, "" },
    { "Reproject", "", "", "radiance", Fetch, "" },
    { "SampleFilter", "", "", "radiance", Samples, "" },
    { "Sum", "", "", "radiance", Add, "" },
    { "TemporalAccumulate", "", "", "radiance", Average, "" },
    { "TemporalAntialias", "", "", "radiance", Antialias, "" },
    { "VarianceEstimate", "", "moments length", "variance", SpatialVariance, "" },
    { "VarianceSteeredFilter", "", "", "radiance", Steered, "" },
  };
  return cases;
}
}
}

#endif
