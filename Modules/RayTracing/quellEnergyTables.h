// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEnergyTables_h
#define quellEnergyTables_h

#include "vtkQuellRayTracingModule.h"

#include <algorithm>
#include <cmath>

namespace quell
{
/// How much light one bounce on a GGX surface (isotropic, height-correlated Smith masking) gives back: directional
/// albedos, for the part that single scattering loses (Kulla, Conty, "Revisiting physically based shading at
/// Imageworks", SIGGRAPH 2017 course). Made once, on first use, by quadrature over the visible normals; the same bits
/// on every thread.
///
/// Reflection, for a Fresnel factor of 1 and for Schlick's weight w = (1 - o.h)^5:
///
///   E(mu, alpha) = integral of  D G2 / (4 mu mu_i) mu_i       B(mu, alpha) = integral of  D G2 w / (4 mu mu_i) mu_i
///
/// so that F0 + (F90 - F0) w reflects F0 (E - B) + F90 B (Karis, "Real shading in Unreal Engine 4", 2013). `Ggx` holds
/// pairs {E, S} with S = B - E w(mu), which is smooth where B is not: rows at roughness = sqrt(alpha) = k / 31, columns
/// at x = sqrt(mu (1 + alpha) / (mu + alpha)) = k / 31 (a function of mu / alpha spreads out the dip near mu = alpha of
/// nearly smooth surfaces), to be read bilinearly. Error below .0025 in E, .004 in B.
///
/// Rough glass of relative index eta = n_transmitted / n_incident with Walter's (2007) transmission: what is lost,
/// 1 - E_reflected - E_transmitted, for a factor of 0 and of 1 on F (except of total reflection), between which the
/// loss is linear; rows at roughness = k / 23, columns at x = k / 23; error below .015. One table per index and side,
/// at the nearest of 257 nodes of sign(r) sqrt|r|, r = (eta - 1) / (eta + 1), between -1 (total internal reflection)
/// and 1 (F = 1).
class VTKQUELLRAYTRACING_EXPORT EnergyTables
{
public:
  static constexpr int Size = 32;
  static constexpr int GlassSize = 24, GlassIndices = 257;

  /// The reflection tables; filled on the first call (under 10 ms).
  static const EnergyTables& Get() noexcept;

  struct Pair
  {
    float E, B;
  };
  /// The place of a roughness in the tables.
  struct Row
  {
    const float* Table = nullptr; ///< row below
    float Fraction = 0;           ///< of the way to the next
    float Alpha = 1;
  };
  Row At(float alpha) const noexcept
  {
    const float y = std::sqrt(alpha) * (Size - 1);
    const int k = std::min(Size - 2, std::max(0, int(y)));
    return { this->Ggx + 2 * Size * k, std::min(1.f, y - float(k)), alpha };
  }
  static float Column(float mu, float alpha) noexcept { return std::sqrt(mu * (1 + alpha) / (mu + alpha)); }
  /// E and B at a cosine in (0, 1] whose Schlick weight is `schlick`.
  static Pair Look(const Row& row, float mu, float schlick) noexcept
  {
    const float x = Column(mu, row.Alpha) * (Size - 1);
    const int k = std::min(Size - 2, int(x));
    const float f = x - float(k), g = row.Fraction;
    const float *a = row.Table + 2 * k, *b = a + 2 * Size;
    const float e0 = a[0] + (a[2] - a[0]) * f, s0 = a[1] + (a[3] - a[1]) * f;
    const float e1 = b[0] + (b[2] - b[0]) * f, s1 = b[1] + (b[3] - b[1]) * f;
    const float e = std::min(1.f, e0 + (e1 - e0) * g), s = s0 + (s1 - s0) * g;
    return { e, std::min(e, std::max(0.f, s + e * schlick)) };
  }
  /// Cosine averages, 2 int E mu dmu and 2 int B mu dmu.
  Pair Average(float alpha) const noexcept
  {
    const float y = std::sqrt(alpha) * (Size - 1);
    const int k = std::min(Size - 2, std::max(0, int(y)));
    const float g = std::min(1.f, y - float(k));
    const float *a = this->GgxAverage + 2 * k, *b = a + 2;
    return { a[0] + (b[0] - a[0]) * g, a[1] + (b[1] - a[1]) * g };
  }

  struct VTKQUELLRAYTRACING_EXPORT Glass
  {
    float Loss[GlassSize][GlassSize][2]; ///< [roughness][x][factor of F]
    float Average[GlassSize][2];         ///< 2 int Loss mu dmu

    float At(float mu, float alpha, float specular) const noexcept;
    float AverageAt(float alpha, float specular) const noexcept;
  };
  /// Filled on the first call for an index (some 3 ms), which only rough glass with refraction makes.
  static const Glass& GetGlass(float eta) noexcept;

  float Ggx[2 * Size * Size];
  float GgxAverage[2 * Size];

private:
  EnergyTables() noexcept;
};
}

#endif
