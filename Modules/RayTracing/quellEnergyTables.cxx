// SPDX-License-Identifier: BSD-3-Clause
#include "quellEnergyTables.h"

#include "quellBsdf.h"

#include <mutex>

namespace quell
{
namespace
{
/// Below this alpha a surface is a mirror; the first rows stand for it.
constexpr float SmallestAlpha = Surface::MirrorAlpha;

float Cosine(float x, float alpha) noexcept
{
  const float t = x * x;
  return std::min(1.f, std::max(1e-6f, t * alpha / (1 + alpha - t)));
}

/// Nodes on the half disc p_x >= 0 (the other half mirrors it): Gauss-Legendre along the radius, equidistant angles.
/// With squared radius 1 - (1 - v)^2 nodes crowd at the rim, where the long tail of the distribution is.
template <int Radii, int Angles>
struct HalfDisc
{
  static constexpr int Count = Radii * Angles;
  float X[Count], Y[Count], Weight[Count];

  HalfDisc() noexcept
  {
    const double pi = 3.14159265358979323846;
    for (int i = 0; i < Radii; ++i)
    {
      // root of the Legendre polynomial by Newton's method
      double z = std::cos(pi * (i + .75) / (Radii + .5)), slope = 1;
      for (int step = 0; step < 20; ++step)
      {
        double p = 1, before = 0;
        for (int j = 0; j < Radii; ++j)
        {
          const double next = ((2 * j + 1) * z * p - j * before) / (j + 1);
          before = p;
          p = next;
        }
        slope = Radii * (z * p - before) / (z * z - 1);
        z -= p / slope;
      }
      const double q = (1 + z) / 2, r = std::sqrt(1 - q * q);
      for (int j = 0; j < Angles; ++j)
      {
        const double phi = pi * ((j + .5) / Angles - .5);
        X[i * Angles + j] = float(r * std::cos(phi));
        Y[i * Angles + j] = float(r * std::sin(phi));
        Weight[i * Angles + j] = float(2 * q / ((1 - z * z) * slope * slope) / Angles);
      }
    }
  }
};

/// The frame of the visible normals of wo = (sqrt(1 - mu^2), 0, mu), as ggx::SampleVisibleNormal makes them. No
/// branches: the compiler makes vectors of the loops below.
struct View
{
  float X, Z, Alpha, Smith, Wx, Wz, Shear;

  View(float mu, float alpha) noexcept
    : X(std::sqrt(std::max(0.f, 1 - mu * mu)))
    , Z(mu)
    , Alpha(alpha)
    , Smith(ggx::Smith(mu, alpha * alpha))
  {
    const float l = std::sqrt(alpha * alpha * X * X + Z * Z);
    Wx = alpha * X / l;
    Wz = Z / l;
    Shear = (1 + Wz) / 2;
  }
  /// Cosine of the half vector at (px, py), and of it with wo.
  void Half(float px, float py, float& cosine, float& oh) const noexcept
  {
    const float h2 = 1 - px * px;
    py = std::sqrt(h2) * (1 - Shear) + py * Shear;
    const float pz = std::sqrt(std::max(0.f, h2 - py * py));
    const float x = Alpha * (pz * Wx - py * Wz), y = Alpha * px, z = std::max(1e-6f, py * Wx + pz * Wz);
    const float scale = 1 / std::sqrt(x * x + y * y + z * z);
    cosine = z * scale;
    oh = std::min(1.f, (X * x + Z * z) * scale);
  }
  /// G2 / G1 for a direction with that cosine; 0 for one below.
  float Masking(float ci) const noexcept
  {
    const float c = std::min(1.f, std::max(0.f, ci)), c2 = c * c;
    const float s = std::sqrt(c2 + Alpha * Alpha * (1 - c2));
    return c * (Z + Smith) / (Smith * c + s * Z);
  }
};
}

EnergyTables::EnergyTables() noexcept
{
  const HalfDisc<32, 8> nodes;
  for (int r = 0; r < Size; ++r)
  {
    const float rough = float(r) / (Size - 1), alpha = std::max(SmallestAlpha, rough * rough);
    for (int c = 0; c < Size; ++c)
    {
      const float mu = Cosine(float(c) / (Size - 1), alpha);
      const View view(mu, alpha);
      float single[nodes.Count], schlick[nodes.Count];
      for (int i = 0; i < nodes.Count; ++i)
      {
        float h, oh;
        view.Half(nodes.X[i], nodes.Y[i], h, oh);
        single[i] = view.Masking(2 * oh * h - mu) * nodes.Weight[i];
        schlick[i] = single[i] * SchlickWeight(oh);
      }
      float e = 0, b = 0;
      for (int i = 0; i < nodes.Count; ++i)
      {
        e += single[i];
        b += schlick[i];
      }
      float* out = this->Ggx + 2 * (Size * r + c);
      out[0] = std::min(1.f, e);
      out[1] = b - out[0] * SchlickWeight(mu);
    }
  }
  for (int r = 0; r < Size; ++r)
  {
    const float rough = float(r) / (Size - 1), alpha = std::max(SmallestAlpha, rough * rough);
    // exactly on the row
    const Row row{ this->Ggx + 2 * Size * std::min(r, Size - 2), r == Size - 1 ? 1.f : 0.f, alpha };
    const int n = 512;
    double e = 0, b = 0;
    for (int i = 0; i < n; ++i)
    {
      // mu = q^2: more of them where E bends
      const double q = (i + .5) / n, mu = q * q, weight = 4 * q * mu / n;
      const Pair p = Look(row, float(mu), SchlickWeight(float(mu)));
      e += p.E * weight;
      b += p.B * weight;
    }
    this->GgxAverage[2 * r] = float(e);
    this->GgxAverage[2 * r + 1] = float(b);
  }
}

const EnergyTables& EnergyTables::Get() noexcept
{
  static const EnergyTables tables;
  return tables;
}

namespace
{
constexpr int Half = EnergyTables::GlassIndices / 2;

/// r of a node: square roots crowd the nodes at an index of 1, where everything changes fast.
float IndexOf(int k) noexcept
{
  const float z = float(k - Half) / Half;
  return z * std::fabs(z);
}
int NodeOf(float eta) noexcept
{
  const float r = (eta - 1) / (eta + 1), z = std::copysign(std::sqrt(std::fabs(r)), r);
  return std::min(2 * Half, std::max(0, int(std::lround((z + 1) * Half))));
}

void MakeGlass(int node, EnergyTables::Glass& out) noexcept
{
  constexpr int N = EnergyTables::GlassSize;
  static const HalfDisc<32, 8> nodes;
  const float r = IndexOf(node);
  // ends of the axis: everything is reflected
  const bool mirror = node == 0 || node == 2 * Half;
  const float eta = mirror ? 1 : (1 + r) / (1 - r), inverse = 1 / eta;
  for (int row = 0; row < N; ++row)
  {
    const float rough = float(row) / (N - 1), alpha = std::max(SmallestAlpha, rough * rough);
    for (int c = 0; c < N; ++c)
    {
      const float mu = Cosine(float(c) / (N - 1), alpha);
      const View view(mu, alpha);
      float full[nodes.Count], none[nodes.Count];
      for (int i = 0; i < nodes.Count; ++i)
      {
        float h, oh;
        view.Half(nodes.X[i], nodes.Y[i], h, oh);
        const float up = view.Masking(2 * oh * h - mu);
        const float cos2 = 1 - (1 - oh * oh) * (inverse * inverse);
        const float ct = std::sqrt(std::max(0.f, cos2));
        const float down = view.Masking(mu * inverse - (oh * inverse - ct) * h);
        const float p = (eta * oh - ct) / (eta * oh + ct + 1e-20f), q = (oh - eta * ct) / (oh + eta * ct + 1e-20f);
        const float f = (p * p + q * q) / 2;
        const float least = mirror || cos2 <= 0 ? up : down, most = mirror || cos2 <= 0 ? up : f * up + (1 - f) * down;
        none[i] = (1 - least) * nodes.Weight[i];
        full[i] = (1 - most) * nodes.Weight[i];
      }
      float lost[2] = { 0, 0 };
      for (int i = 0; i < nodes.Count; ++i)
      {
        lost[0] += none[i];
        lost[1] += full[i];
      }
      for (int w = 0; w < 2; ++w)
        out.Loss[row][c][w] = std::min(1.f, std::max(0.f, lost[w]));
    }
    double average[2] = { 0, 0 };
    const int n = 256;
    for (int i = 0; i < n; ++i)
    {
      const double q = (i + .5) / n, mu = q * q, weight = 4 * q * mu / n;
      const float x = EnergyTables::Column(float(mu), alpha) * (N - 1);
      const int j = std::min(N - 2, int(x));
      const float f = x - float(j);
      for (int w = 0; w < 2; ++w)
      {
        const float a = out.Loss[row][j][w], b = out.Loss[row][j + 1][w];
        average[w] += weight * (a + (b - a) * f);
      }
    }
    out.Average[row][0] = float(average[0]);
    out.Average[row][1] = float(average[1]);
  }
}

/// Cell and fraction on an axis of `n` nodes.
int Cell(float x, int n, float& fraction) noexcept
{
  const int k = std::min(n - 2, std::max(0, int(x)));
  fraction = std::min(1.f, std::max(0.f, x - float(k)));
  return k;
}
float Mix(float a, float b, float f) noexcept
{
  return a + (b - a) * f;
}
}

const EnergyTables::Glass& EnergyTables::GetGlass(float eta) noexcept
{
  struct Slot
  {
    std::once_flag Once;
    Glass Table;
  };
  static Slot slots[GlassIndices]; // untouched pages take no memory
  const int k = NodeOf(eta);
  std::call_once(slots[k].Once, [k]() { MakeGlass(k, slots[k].Table); });
  return slots[k].Table;
}

float EnergyTables::Glass::At(float mu, float alpha, float specular) const noexcept
{
  float fx, fy;
  const int y = Cell(std::sqrt(alpha) * (GlassSize - 1), GlassSize, fy);
  const int x = Cell(Column(mu, alpha) * (GlassSize - 1), GlassSize, fx);
  const auto at = [&](int j, int i) { return Mix(this->Loss[j][i][0], this->Loss[j][i][1], specular); };
  return Mix(Mix(at(y, x), at(y, x + 1), fx), Mix(at(y + 1, x), at(y + 1, x + 1), fx), fy);
}

float EnergyTables::Glass::AverageAt(float alpha, float specular) const noexcept
{
  float f;
  const int y = Cell(std::sqrt(alpha) * (GlassSize - 1), GlassSize, f);
  const auto at = [&](int j) { return Mix(this->Average[j][0], this->Average[j][1], specular); };
  return Mix(at(y), at(y + 1), f);
}
}
