// SPDX-License-Identifier: BSD-3-Clause
#include "quellNonLocal.h"

#include "quellFilledWeights.h"
#include "quellGuards.h"
#include "quellPlanes.h"

#include <algorithm>
#include <cmath>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellNonLocal.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellNonLocal_once
#define quellNonLocal_once
namespace quell
{
namespace
{
constexpr int MostUnknowns = NonLocalInputs::MostRegressors + 3; ///< 1, dx, dy, features
constexpr float LargestDistance = 1e4f;
/// Guides and features count up to this, variances up to its square, so that squares and their sums stay finite.
constexpr float LargestValue = 1e18f, LargestVariance = 1e36f;
/// Squared length of a column, relative to the constant's, below which a feature is flat.
constexpr float LeastColumn = 1e-12f;

struct NonLocalTile
{
  PlaneLayout layout;
  Rect centres;              ///< pixels whose weights are needed
  int radius = 0, patch = 0; ///< of the window and the patches
  float *guide[3], *variance[3], *target[3];
  float* valid; ///< 1: is a tap
  float k2, epsilon;
  int features = 0;
  struct Weighing
  {
    int components;
    float *value[3], *variance, *scale; ///< variance summed; log2(e) / (kFeature^2 max(tau, V, |grad|^2))
  } feature[NonLocalInputs::MostFeatures];
  int regressors = 0;
  float* regressor[NonLocalInputs::MostRegressors];
  float ridge = 0;

  // Rows are blocks of lanes that begin at multiples of the lanes in the frame, so that what a pixel gets is summed in
  // the same order in every tile.
  int rowBegin = 0;                              ///< column of the first lane; at most centres.x0
  std::ptrdiff_t rowStride = 0;                  ///< floats
  float *distances = nullptr, *counts = nullptr; ///< horizontal patch sums: ring of 2 patch + 1 rows per offset
  float *delta = nullptr, *pairs = nullptr;      ///< one row
  float* weights = nullptr;                      ///< one row per offset
  float *sums[3], *sumOfWeights = nullptr;       ///< planes of the regression

  int offsets() const noexcept { return (2 * this->radius + 1) * (2 * this->radius + 1); }
  std::ptrdiff_t ring(int offset, int y) const noexcept
  {
    const int rows = 2 * this->patch + 1, slot = ((y % rows) + rows) % rows;
    return (std::ptrdiff_t(offset) * rows + slot) * this->rowStride;
  }
};
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
using NonLocalD = hn::ScalableTag<float>;
using NonLocalV = hn::Vec<NonLocalD>;

int NonLocalLanesImpl()
{
  return int(hn::Lanes(NonLocalD()));
}

/// Sums over 2 patch + 1 columns of row y's distances to the pixels at (dx, dy).
void DistanceRowImpl(const NonLocalTile& t, int offset, int dx, int dy, int y)
{
  using V = NonLocalV;
  const NonLocalD d;
  const int lanes = int(hn::Lanes(d)), f = t.patch;
  const V zero = hn::Zero(d);
  float *const h = t.distances + t.ring(offset, y), *const n = t.counts + t.ring(offset, y);
  const int count = t.centres.x1 - t.rowBegin;
  if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
  {
    std::fill(h, h + t.rowStride, 0.f);
    std::fill(n, n + t.rowStride, 0.f);
    return;
  }
  const V k2 = hn::Set(d, t.k2), epsilon = hn::Set(d, t.epsilon), most = hn::Set(d, LargestDistance);
  const V third = hn::Set(d, 1 / 3.f);
  const auto first = t.layout.at(t.rowBegin - f, y);
  for (int i = 0; i < count + 2 * f; i += lanes)
  {
    const auto p = first + i, q = p + dy * t.layout.stride + dx;
    V sum = zero;
    for (int c = 0; c < 3; ++c)
    {
      const V a = hn::Sub(hn::LoadU(d, t.guide[c] + p), hn::LoadU(d, t.guide[c] + q));
      const V vp = hn::LoadU(d, t.variance[c] + p), vq = hn::LoadU(d, t.variance[c] + q);
      const V noise = hn::Add(vp, hn::Min(vp, vq));
      const V scale = hn::MulAdd(k2, hn::Add(vp, vq), epsilon);
      sum = hn::Add(sum, hn::Min(hn::Div(hn::Sub(hn::Mul(a, a), noise), scale), most));
    }
    const V m = hn::Mul(hn::LoadU(d, t.valid + p), hn::LoadU(d, t.valid + q));
    hn::StoreU(hn::IfThenElseZero(hn::Gt(m, zero), hn::Mul(sum, third)), d, t.delta + i);
    hn::StoreU(m, d, t.pairs + i);
  }
  for (int i = 0; i < count; i += lanes)
  {
    V sum = zero, pairs = zero;
    for (int j = 0; j <= 2 * f; ++j)
    {
      sum = hn::Add(sum, hn::LoadU(d, t.delta + i + j));
      pairs = hn::Add(pairs, hn::LoadU(d, t.pairs + i + j));
    }
    hn::StoreU(sum, d, h + i);
    hn::StoreU(pairs, d, n + i);
  }
}

/// Weights of row y's pixels with those at (dx, dy).
void WeightRowImpl(const NonLocalTile& t, int offset, int dx, int dy, int y)
{
  using V = NonLocalV;
  const NonLocalD d;
  const int lanes = int(hn::Lanes(d));
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), log2e = hn::Set(d, Log2E);
  float* const out = t.weights + offset * t.rowStride;
  if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
  {
    std::fill(out, out + t.rowStride, 0.f);
    return;
  }
  const int low = std::max(-t.patch, t.layout.extent.y0 - y), high = std::min(t.patch, t.layout.extent.y1 - 1 - y);
  const auto first = t.layout.at(t.rowBegin, y);
  for (int i = 0; i < t.centres.x1 - t.rowBegin; i += lanes)
  {
    const auto p = first + i, q = p + dy * t.layout.stride + dx;
    V sum = zero, pairs = zero;
    for (int j = low; j <= high; ++j)
    {
      const auto r = t.ring(offset, y + j) + i;
      sum = hn::Add(sum, hn::LoadU(d, t.distances + r));
      pairs = hn::Add(pairs, hn::LoadU(d, t.counts + r));
    }
    V e = hn::Max(zero, hn::Mul(log2e, hn::Div(sum, hn::Max(pairs, one))));
    for (int k = 0; k < t.features; ++k)
    {
      const NonLocalTile::Weighing& f = t.feature[k];
      V square = zero;
      for (int c = 0; c < f.components; ++c)
      {
        const V a = hn::Sub(hn::LoadU(d, f.value[c] + p), hn::LoadU(d, f.value[c] + q));
        square = hn::MulAdd(a, a, square);
      }
      const V v = hn::LoadU(d, f.variance + p);
      const V excess = hn::Sub(square, hn::Add(v, hn::Min(v, hn::LoadU(d, f.variance + q))));
      e = hn::Max(e, hn::Mul(excess, hn::LoadU(d, f.scale + p)));
    }
    hn::StoreU(hn::Mul(NegExp2(d, e), hn::LoadU(d, t.valid + q)), d, out + i);
  }
}

/// Weighted means of row y; results at the columns of the sums' planes.
void MeanRowImpl(const NonLocalTile& t, int y)
{
  using V = NonLocalV;
  const NonLocalD d;
  const int lanes = int(hn::Lanes(d));
  const auto first = t.layout.at(t.rowBegin, y);
  for (int i = 0; i < t.centres.x1 - t.rowBegin; i += lanes)
  {
    const auto p = first + i;
    V sw = hn::Zero(d), sums[3], centre[3];
    for (int c = 0; c < 3; ++c)
    {
      sums[c] = hn::Zero(d);
      centre[c] = hn::LoadU(d, t.target[c] + p);
    }
    const float* w = t.weights + i;
    for (int dy = -t.radius; dy <= t.radius; ++dy)
      for (int dx = -t.radius; dx <= t.radius; ++dx, w += t.rowStride)
      {
        if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
          continue;
        const auto q = p + dy * t.layout.stride + dx;
        const V weight = hn::LoadU(d, w);
        sw = hn::Add(sw, weight);
        for (int c = 0; c < 3; ++c)
          sums[c] = hn::MulAdd(weight, hn::Sub(hn::LoadU(d, t.target[c] + q), centre[c]), sums[c]);
      }
    for (int c = 0; c < 3; ++c)
      hn::StoreU(sums[c], d, t.sums[c] + p);
    hn::StoreU(sw, d, t.sumOfWeights + p);
  }
}

using SolverD = hn::ScalableTag<double>;
/// Normal equations of a vector of pixels, and what SolveModels makes of them. In double: with features of the
/// condition 1 / ridge the rounding of float sums would show in the fifth digit.
struct Solver
{
  double Gram[MostUnknowns][MostUnknowns][PlaneLayout::Lanes];
  double Right[MostUnknowns][3][PlaneLayout::Lanes];
  float Coefficients[MostUnknowns][3][PlaneLayout::Lanes];
};

/// N products of column `a` with the columns from `a` on and with the three colours, over the window.
template <int N>
void GramRow(const NonLocalTile& t, int a, int y, int i, int lane, Solver& solver)
{
  using V = hn::Vec<SolverD>;
  const SolverD d;
  const hn::Rebind<float, SolverD> df;
  const auto p = t.layout.at(t.rowBegin, y) + i + lane;
  const auto difference = [&](const float* plane, std::ptrdiff_t q) HWY_ATTR
  { return hn::PromoteTo(d, hn::Sub(hn::LoadU(df, plane + q), hn::LoadU(df, plane + p))); };
  const V inverse = hn::Set(d, t.radius ? 1. / t.radius : 1.);
  V products[N], colors[3];
  for (int k = 0; k < N; ++k)
    products[k] = hn::Zero(d);
  for (int c = 0; c < 3; ++c)
    colors[c] = hn::Zero(d);
  const float* w = t.weights + i + lane;
  for (int dy = -t.radius; dy <= t.radius; ++dy)
    for (int dx = -t.radius; dx <= t.radius; ++dx, w += t.rowStride)
    {
      if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
        continue;
      const auto q = p + dy * t.layout.stride + dx;
      const auto column = [&](int k) HWY_ATTR
      {
        if (k >= 3)
          return difference(t.regressor[k - 3], q);
        return k == 0 ? hn::Set(d, 1.) : hn::Mul(inverse, hn::Set(d, double(k == 1 ? dx : dy)));
      };
      const V wa = hn::Mul(hn::PromoteTo(d, hn::LoadU(df, w)), column(a));
      for (int k = 0; k < N; ++k)
        products[k] = hn::MulAdd(wa, column(a + k), products[k]);
      for (int c = 0; c < 3; ++c)
        colors[c] = hn::MulAdd(wa, difference(t.target[c], q), colors[c]);
    }
  for (int k = 0; k < N; ++k)
    hn::StoreU(products[k], d, solver.Gram[a][k] + lane);
  for (int c = 0; c < 3; ++c)
    hn::StoreU(colors[c], d, solver.Right[a][c] + lane);
}

void AnyGramRow(const NonLocalTile& t, int n, int a, int y, int i, int lane, Solver& solver)
{
  switch (n)
  {
    case 1:
      return GramRow<1>(t, a, y, i, lane, solver);
    case 2:
      return GramRow<2>(t, a, y, i, lane, solver);
    case 3:
      return GramRow<3>(t, a, y, i, lane, solver);
    case 4:
      return GramRow<4>(t, a, y, i, lane, solver);
    case 5:
      return GramRow<5>(t, a, y, i, lane, solver);
    case 6:
      return GramRow<6>(t, a, y, i, lane, solver);
    case 7:
      return GramRow<7>(t, a, y, i, lane, solver);
    case 8:
      return GramRow<8>(t, a, y, i, lane, solver);
    case 9:
      return GramRow<9>(t, a, y, i, lane, solver);
    case 10:
      return GramRow<10>(t, a, y, i, lane, solver);
    case 11:
      return GramRow<11>(t, a, y, i, lane, solver);
    case 12:
      return GramRow<12>(t, a, y, i, lane, solver);
    default:
      return GramRow<13>(t, a, y, i, lane, solver);
  }
}

/// The models of the lanes from `lane` on.
void SolveModels(Solver& solver, int m, double ridgeValue, int lane)
{
  const SolverD d;
  const hn::Rebind<float, SolverD> df;
  using V = hn::Vec<SolverD>;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.);
  V gram[MostUnknowns][MostUnknowns], b[MostUnknowns][3], scale[MostUnknowns];
  for (int a = 0; a < m; ++a)
  {
    for (int k = 0; k < m - a; ++k)
      gram[a][k] = hn::LoadU(d, solver.Gram[a][k] + lane);
    for (int c = 0; c < 3; ++c)
      b[a][c] = hn::LoadU(d, solver.Right[a][c] + lane);
  }
  const V weight = hn::LoadU(d, solver.Gram[0][0] + lane);
  for (int a = 0; a < m; ++a)
  {
    const auto flat = hn::Le(gram[a][0], hn::Mul(hn::Set(d, LeastColumn), weight));
    scale[a] = hn::IfThenZeroElse(flat, hn::Div(one, hn::Sqrt(hn::IfThenElse(flat, one, gram[a][0]))));
  }
  for (int a = 0; a < m; ++a)
  {
    for (int k = 0; k < m - a; ++k)
      gram[a][k] = hn::Mul(gram[a][k], hn::Mul(scale[a], scale[a + k]));
    for (int c = 0; c < 3; ++c)
      b[a][c] = hn::Mul(b[a][c], scale[a]);
    // A flat column has a pivot of 1 and nothing else: its coefficient is 0.
    const V ridge = hn::Set(d, a ? ridgeValue : 0.);
    gram[a][0] = hn::Add(hn::IfThenElse(hn::Gt(scale[a], zero), gram[a][0], one), ridge);
  }
  // Cholesky in place, then both substitutions.
  for (int a = 0; a < m; ++a)
  {
    const V pivot = hn::Max(gram[a][0], hn::Set(d, 1e-7));
    const V root = hn::Div(one, hn::Sqrt(pivot));
    gram[a][0] = root; // of the reciprocal
    for (int k = 1; k < m - a; ++k)
      gram[a][k] = hn::Mul(gram[a][k], root);
    for (int j = 1; j < m - a; ++j)
      for (int k = j; k < m - a; ++k)
        gram[a + j][k - j] = hn::NegMulAdd(gram[a][j], gram[a][k], gram[a + j][k - j]);
  }
  for (int c = 0; c < 3; ++c)
  {
    for (int a = 0; a < m; ++a)
    {
      b[a][c] = hn::Mul(b[a][c], gram[a][0]);
      for (int k = 1; k < m - a; ++k)
        b[a + k][c] = hn::NegMulAdd(gram[a][k], b[a][c], b[a + k][c]);
    }
    for (int a = m - 1; a >= 0; --a)
    {
      V v = b[a][c];
      for (int k = 1; k < m - a; ++k)
        v = hn::NegMulAdd(gram[a][k], b[a + k][c], v);
      b[a][c] = hn::Mul(v, gram[a][0]);
    }
    for (int a = 0; a < m; ++a)
      hn::StoreU(hn::DemoteTo(df, hn::Mul(b[a][c], scale[a])), df, solver.Coefficients[a][c] + lane);
  }
}

/// Models of row y's pixels, and what they predict added to the sums' planes.
void RegressRowImpl(const NonLocalTile& t, int y)
{
  using V = NonLocalV;
  const NonLocalD d;
  Solver solver;
  const int lanes = int(hn::Lanes(d)), m = 3 + t.regressors;
  const V zero = hn::Zero(d);
  const V inverse = hn::Set(d, t.radius ? 1.f / float(t.radius) : 1.f);
  for (int i = 0; i < t.centres.x1 - t.rowBegin; i += lanes)
  {
    const auto p = t.layout.at(t.rowBegin, y) + i;
    // Lanes that are no centre have no say.
    const V x = hn::Iota(d, float(t.rowBegin + i));
    const auto isCentre =
      hn::And(hn::And(hn::Ge(x, hn::Set(d, float(t.centres.x0))), hn::Lt(x, hn::Set(d, float(t.centres.x1)))),
        hn::Gt(hn::LoadU(d, t.valid + p), zero));
    if (hn::AllFalse(d, isCentre))
      continue;
    // Lower triangle by columns: gram[a][k] is row a + k of column a.
    V b[MostUnknowns][3];
    for (int lane = 0; lane < lanes; lane += int(hn::Lanes(SolverD())))
    {
      for (int a = 0; a < m; ++a)
        AnyGramRow(t, m - a, a, y, i, lane, solver);
      SolveModels(solver, m, t.ridge, lane);
    }
    for (int a = 0; a < m; ++a)
      for (int c = 0; c < 3; ++c)
        b[a][c] = hn::LoadU(d, solver.Coefficients[a][c]);
    V centre[3];
    for (int c = 0; c < 3; ++c)
      centre[c] = hn::LoadU(d, t.target[c] + p);
    const float* w = t.weights + i;
    for (int dy = -t.radius; dy <= t.radius; ++dy)
      for (int dx = -t.radius; dx <= t.radius; ++dx, w += t.rowStride)
      {
        if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
          continue;
        const auto q = p + dy * t.layout.stride + dx;
        const V weighs = hn::IfThenElseZero(isCentre, hn::LoadU(d, w));
        V prediction[3];
        for (int c = 0; c < 3; ++c)
        {
          // Relative to the pixel's own value, so that constants stay to the last bit.
          prediction[c] = hn::Add(hn::Sub(centre[c], hn::LoadU(d, t.target[c] + q)), b[0][c]);
          prediction[c] = hn::MulAdd(b[1][c], hn::Mul(inverse, hn::Set(d, float(dx))), prediction[c]);
          prediction[c] = hn::MulAdd(b[2][c], hn::Mul(inverse, hn::Set(d, float(dy))), prediction[c]);
        }
        for (int k = 0; k < t.regressors; ++k)
        {
          const V feature = hn::Sub(hn::LoadU(d, t.regressor[k] + q), hn::LoadU(d, t.regressor[k] + p));
          for (int c = 0; c < 3; ++c)
            prediction[c] = hn::MulAdd(b[3 + k][c], feature, prediction[c]);
        }
        for (int c = 0; c < 3; ++c)
        {
          prediction[c] = hn::IfThenElseZero(isCentre, prediction[c]); // else it may be no number
          hn::StoreU(hn::MulAdd(weighs, prediction[c], hn::LoadU(d, t.sums[c] + q)), d, t.sums[c] + q);
        }
        hn::StoreU(hn::Add(weighs, hn::LoadU(d, t.sumOfWeights + q)), d, t.sumOfWeights + q);
      }
  }
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(NonLocalLanesImpl);
HWY_EXPORT(DistanceRowImpl);
HWY_EXPORT(WeightRowImpl);
HWY_EXPORT(MeanRowImpl);
HWY_EXPORT(RegressRowImpl);

namespace
{
Rect Centres(const NonLocalInputs& in, const NonLocalParameters& p, const Rect& tile) noexcept
{
  return (p.regress ? tile.grown(p.radius) : tile).clipped(in.target.extent);
}
PlaneLayout TileLayout(const NonLocalInputs& in, const NonLocalParameters& p, const Rect& tile) noexcept
{
  const int reach = p.radius + p.patch;
  return PlaneLayout(Centres(in, p, tile).grown(reach).clipped(in.target.extent), reach + 2 * PlaneLayout::Lanes);
}
std::ptrdiff_t RowStride(const Rect& centres, int patch) noexcept
{
  return centres.width() + 2 * patch + 2 * PlaneLayout::Lanes;
}
int RegressorComponents(const NonLocalInputs& in) noexcept
{
  int n = 0;
  for (int k = 0; k < in.regressorCount; ++k)
    n += in.regressors[k].value.components;
  return n;
}
int WeighingPlanes(const NonLocalInputs& in) noexcept
{
  int n = 0;
  for (int k = 0; k < in.weighingCount; ++k)
    n += in.weighing[k].value.components + 2;
  return n;
}
float Sane(float v) noexcept
{
  return !Finite(v) ? 0.f : v > LargestValue ? LargestValue : v < -LargestValue ? -LargestValue : v;
}
float SaneVariance(float v) noexcept
{
  return v > 0 && Finite(v) ? std::min(v, LargestVariance) : 0.f;
}
double SummedVariance(const NonLocalFeature& f, int x, int y) noexcept
{
  if (!f.variance)
    return 0;
  double sum = 0;
  for (int k = 0; k < f.variance.components; ++k)
    sum += SaneVariance(f.variance.at(x, y)[k]);
  return f.variance.components == 1 ? sum * f.value.components : sum;
}
/// Squared central differences, one-sided at the edge of the frame, summed over the components.
double SquaredGradient(const NonLocalFeature& f, int x, int y) noexcept
{
  double sum = 0;
  const Rect& e = f.value.extent;
  const auto difference = [&](int ax, int ay, int bx, int by)
  {
    const bool a = e.contains(ax, ay), b = e.contains(bx, by);
    double s = 0;
    for (int k = 0; k < f.value.components; ++k)
    {
      const double v = (b ? Sane(f.value.at(bx, by)[k]) : Sane(f.value.at(x, y)[k])) -
                       (a ? Sane(f.value.at(ax, ay)[k]) : Sane(f.value.at(x, y)[k]));
      s += v * v;
    }
    return a && b ? 0.25 * s : s;
  };
  sum += difference(x - 1, y, x + 1, y);
  sum += difference(x, y - 1, x, y + 1);
  return sum;
}
bool IsTap(const NonLocalInputs& in, int x, int y) noexcept
{
  return Finite3(in.target.at(x, y)) && Finite3(in.guide.at(x, y)) && (!in.depth || Finite(*in.depth.at(x, y)));
}
/// V of the guide's channel c.
float GuideVariance(const NonLocalInputs& in, int x, int y, int c) noexcept
{
  return in.variance ? SaneVariance(in.variance.at(x, y)[in.variance.components == 3 ? c : 0]) : 0.f;
}
/// F(p, q) of one feature, before it is kept above 0; `gradient` is SquaredGradient(f, px, py).
double FeatureExponent(
  const NonLocalFeature& f, double kFeature, int px, int py, int qx, int qy, double gradient) noexcept
{
  double square = 0;
  for (int c = 0; c < f.value.components; ++c)
  {
    const double d = double(Sane(f.value.at(px, py)[c])) - Sane(f.value.at(qx, qy)[c]);
    square += d * d;
  }
  const double v = SummedVariance(f, px, py), w = SummedVariance(f, qx, qy);
  return (square - (v + std::min(v, w))) /
         (std::max(1e-30, kFeature * kFeature) * std::max({ f.least, 1e-30, v, gradient }));
}
/// What a model at p knows of q: 3 + RegressorComponents(in) columns.
void ModelColumns(const NonLocalInputs& in, int radius, int px, int py, int qx, int qy, double* x) noexcept
{
  x[0] = 1;
  x[1] = radius ? double(qx - px) / radius : 0;
  x[2] = radius ? double(qy - py) / radius : 0;
  int n = 3;
  for (int k = 0; k < in.regressorCount; ++k)
    for (int c = 0; c < in.regressors[k].value.components; ++c)
      x[n++] = double(Sane(in.regressors[k].value.at(qx, qy)[c])) - Sane(in.regressors[k].value.at(px, py)[c]);
}
}

double NonLocalDistance(double up, double uq, double vp, double vq, double k, double epsilon)
{
  const double d = ((up - uq) * (up - uq) - (vp + std::min(vp, vq))) / (epsilon + k * k * (vp + vq));
  return std::min(d, double(LargestDistance));
}

std::size_t NonLocalScratch(const NonLocalInputs& in, const NonLocalParameters& p, const Rect& tile) noexcept
{
  const PlaneLayout layout = TileLayout(in, p, tile);
  const std::ptrdiff_t stride = RowStride(Centres(in, p, tile), p.patch);
  const std::size_t offsets = std::size_t(2 * p.radius + 1) * std::size_t(2 * p.radius + 1);
  const int planes = 3 + 3 + 3 + 1 + WeighingPlanes(in) + RegressorComponents(in) + 4;
  return layout.size() * planes + offsets * stride * (2 * (2 * p.patch + 1) + 1) + 2 * stride;
}

std::int64_t NonLocal(
  const NonLocalInputs& in, const NonLocalParameters& p, const ImageOut& out, const Rect& tile, float* scratch) noexcept
{
  NonLocalTile t;
  t.layout = TileLayout(in, p, tile);
  t.centres = Centres(in, p, tile);
  t.radius = p.radius;
  t.patch = p.patch;
  t.k2 = float(p.kColor * p.kColor < 1e30 ? p.kColor * p.kColor : 1e30);
  t.epsilon = float(p.epsilon);
  t.ridge = float(p.ridge);
  const Rect& e = t.layout.extent;
  const auto plane = [&]
  {
    float* made = scratch;
    scratch += t.layout.size();
    std::fill(made, scratch, 0.f); // what is outside is no tap, and a number
    return made;
  };
  const auto forEach = [&](auto&& body)
  {
    for (int y = e.y0; y < e.y1; ++y)
      for (int x = e.x0; x < e.x1; ++x)
        body(x, y, t.layout.at(x, y));
  };
  for (int c = 0; c < 3; ++c)
  {
    t.guide[c] = plane();
    t.variance[c] = plane();
    t.target[c] = plane();
    t.sums[c] = plane();
  }
  t.sumOfWeights = plane();
  t.valid = plane();
  std::int64_t bad = 0;
  forEach(
    [&](int x, int y, std::ptrdiff_t i)
    {
      float color[3], guide[3];
      bad += !ReadFilled(in.target, x, y, color) && tile.contains(x, y);
      ReadFilled(in.guide, x, y, guide);
      for (int c = 0; c < 3; ++c)
      {
        t.target[c][i] = color[c];
        t.guide[c][i] = Sane(guide[c]);
        t.variance[c][i] = GuideVariance(in, x, y, c);
      }
      t.valid[i] = IsTap(in, x, y) ? 1.f : 0.f;
    });
  for (int k = 0; k < in.weighingCount; ++k)
  {
    const NonLocalFeature& f = in.weighing[k];
    NonLocalTile::Weighing& made = t.feature[t.features++];
    made.components = f.value.components;
    for (int c = 0; c < made.components; ++c)
      made.value[c] = plane();
    made.variance = plane();
    made.scale = plane();
    const double k2 = std::max(1e-30, p.kFeature * p.kFeature);
    forEach(
      [&](int x, int y, std::ptrdiff_t i)
      {
        for (int c = 0; c < made.components; ++c)
          made.value[c][i] = Sane(f.value.at(x, y)[c]);
        const double v = SummedVariance(f, x, y);
        made.variance[i] = float(v);
        made.scale[i] =
          float(std::min(1e30, 1.4426950408889634 / (k2 * std::max({ f.least, 1e-30, v, SquaredGradient(f, x, y) }))));
      });
  }
  for (int k = 0; k < in.regressorCount && p.regress; ++k)
    for (int c = 0; c < in.regressors[k].value.components && t.regressors < NonLocalInputs::MostRegressors; ++c)
    {
      float* const value = t.regressor[t.regressors++] = plane();
      forEach([&](int x, int y, std::ptrdiff_t i) { value[i] = Sane(in.regressors[k].value.at(x, y)[c]); });
    }

  const int lanes = HWY_DYNAMIC_DISPATCH(NonLocalLanesImpl)();
  t.rowBegin = t.centres.x0 - ((t.centres.x0 % lanes) + lanes) % lanes;
  t.rowStride = RowStride(t.centres, p.patch);
  const auto rows = [&](std::size_t n)
  {
    float* made = scratch;
    scratch += n * std::size_t(t.rowStride);
    return made;
  };
  const std::size_t offsets = std::size_t(t.offsets()), ring = 2 * std::size_t(p.patch) + 1;
  t.distances = rows(offsets * ring);
  t.counts = rows(offsets * ring);
  t.weights = rows(offsets);
  t.delta = rows(1);
  t.pairs = rows(1);

  const auto distances = [&](int y)
  {
    if (y < e.y0 || y >= e.y1)
      return;
    int offset = 0;
    for (int dy = -p.radius; dy <= p.radius; ++dy)
      for (int dx = -p.radius; dx <= p.radius; ++dx)
        HWY_DYNAMIC_DISPATCH(DistanceRowImpl)(t, offset++, dx, dy, y);
  };
  for (int y = t.centres.y0 - p.patch; y < t.centres.y0 + p.patch; ++y)
    distances(y);
  for (int y = t.centres.y0; y < t.centres.y1; ++y)
  {
    distances(y + p.patch);
    int offset = 0;
    for (int dy = -p.radius; dy <= p.radius; ++dy)
      for (int dx = -p.radius; dx <= p.radius; ++dx)
        HWY_DYNAMIC_DISPATCH(WeightRowImpl)(t, offset++, dx, dy, y);
    if (p.regress)
      HWY_DYNAMIC_DISPATCH(RegressRowImpl)(t, y);
    else
      HWY_DYNAMIC_DISPATCH(MeanRowImpl)(t, y);
  }
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      const auto i = t.layout.at(x, y);
      const bool hit = !in.depth || Finite(*in.depth.at(x, y));
      const float sw = t.sumOfWeights[i];
      for (int c = 0; c < 3; ++c)
      {
        const float own = t.target[c][i];
        float v = hit && sw > 1e-30f ? own + t.sums[c][i] / sw : own;
        if (p.regress)
          v = std::max(v, std::min(0.f, own));
        out.at(x, y)[c] = Finite(v) ? v : own;
      }
    }
  return bad;
}

void NonLocalRegressionWeights(
  const NonLocalInputs& in, const NonLocalParameters& p, int x, int y, const ImageOut& weights)
{
  const Rect& e = in.target.extent;
  const int r = p.radius, side = 2 * r + 1, offsets = side * side, m = 3 + RegressorComponents(in);
  for (int qy = weights.extent.y0; qy < weights.extent.y1; ++qy)
    for (int qx = weights.extent.x0; qx < weights.extent.x1; ++qx)
      *weights.at(qx, qy) = 0;
  const Rect pixel{ x, y, x + 1, y + 1 }, centres = pixel.grown(r).clipped(e),
                                          compared = centres.grown(p.patch).clipped(e);
  const auto isTap = [&](int qx, int qy) { return e.contains(qx, qy) && IsTap(in, qx, qy); };
  // w(p, p + o) of every centre p: per offset, distances of pairs and their sums over the patch.
  std::vector<double> pair(std::size_t(centres.area()) * std::size_t(offsets), 0.);
  const auto weight = [&](int px, int py, int dx, int dy) -> double&
  {
    const std::size_t centre =
      std::size_t(py - centres.y0) * std::size_t(centres.width()) + std::size_t(px - centres.x0);
    return pair[centre * std::size_t(offsets) + std::size_t((dy + r) * side + dx + r)];
  };
  std::vector<double> gradients(std::size_t(centres.area()) * std::size_t(std::max(1, in.weighingCount)));
  for (int k = 0; k < in.weighingCount; ++k)
    for (int py = centres.y0; py < centres.y1; ++py)
      for (int px = centres.x0; px < centres.x1; ++px)
        gradients[std::size_t(k) * std::size_t(centres.area()) +
                  std::size_t((py - centres.y0) * centres.width() + px - centres.x0)] =
          SquaredGradient(in.weighing[k], px, py);
  std::vector<double> distance(std::size_t(compared.area()));
  std::vector<char> counts(distance.size());
  for (int dy = -r; dy <= r; ++dy)
    for (int dx = -r; dx <= r; ++dx)
    {
      std::size_t i = 0;
      for (int ay = compared.y0; ay < compared.y1; ++ay)
        for (int ax = compared.x0; ax < compared.x1; ++ax, ++i)
        {
          const int bx = ax + dx, by = ay + dy;
          counts[i] = isTap(ax, ay) && isTap(bx, by);
          distance[i] = 0;
          for (int c = 0; c < 3 && counts[i]; ++c)
            distance[i] += NonLocalDistance(Sane(in.guide.at(ax, ay)[c]), Sane(in.guide.at(bx, by)[c]),
                             GuideVariance(in, ax, ay, c), GuideVariance(in, bx, by, c), p.kColor, p.epsilon) /
                           3;
        }
      for (int py = centres.y0; py < centres.y1; ++py)
        for (int px = centres.x0; px < centres.x1; ++px)
        {
          const int qx = px + dx, qy = py + dy;
          if (!isTap(px, py) || !isTap(qx, qy))
            continue;
          double sum = 0;
          int n = 0;
          for (int ay = std::max(py - p.patch, compared.y0); ay <= std::min(py + p.patch, compared.y1 - 1); ++ay)
            for (int ax = std::max(px - p.patch, compared.x0); ax <= std::min(px + p.patch, compared.x1 - 1); ++ax)
            {
              const std::size_t a =
                std::size_t(ay - compared.y0) * std::size_t(compared.width()) + std::size_t(ax - compared.x0);
              sum += distance[a];
              n += counts[a];
            }
          double exponent = std::max(0., sum / std::max(1, n));
          const std::size_t centre = std::size_t((py - centres.y0) * centres.width() + px - centres.x0);
          for (int k = 0; k < in.weighingCount; ++k)
            exponent = std::max(exponent, FeatureExponent(in.weighing[k], p.kFeature, px, py, qx, qy,
                                            gradients[std::size_t(k) * std::size_t(centres.area()) + centre]));
          weight(px, py, dx, dy) = exponent <= 80 ? std::exp(-exponent) : 0.;
        }
    }
  // Each model around says C(p) + x(q) b, and b is a sum over its taps: one system solved gives all of their parts.
  std::vector<double> gram(std::size_t(m) * std::size_t(m)), scale(m), h(m), a(m), own(m);
  std::vector<double> sums(std::size_t(weights.extent.area()), 0.);
  const auto at = [&](int qx, int qy) -> double&
  {
    return sums[std::size_t(qy - weights.extent.y0) * std::size_t(weights.extent.width()) +
                std::size_t(qx - weights.extent.x0)];
  };
  double total = 0;
  for (int py = centres.y0; py < centres.y1; ++py)
    for (int px = centres.x0; px < centres.x1; ++px)
    {
      const double says = weight(px, py, x - px, y - py);
      if (!(says > 0))
        continue;
      const auto forTaps = [&](auto&& body)
      {
        for (int dy = -r; dy <= r; ++dy)
          for (int dx = -r; dx <= r; ++dx)
            if (const double w = weight(px, py, dx, dy))
              body(px + dx, py + dy, w);
      };
      std::fill(gram.begin(), gram.end(), 0.);
      forTaps(
        [&](int qx, int qy, double w)
        {
          ModelColumns(in, r, px, py, qx, qy, a.data());
          for (int i = 0; i < m; ++i)
            for (int j = 0; j < m; ++j)
              gram[std::size_t(i * m + j)] += w * a[std::size_t(i)] * a[std::size_t(j)];
        });
      for (int i = 0; i < m; ++i)
      {
        const double length = gram[std::size_t(i * m + i)];
        scale[std::size_t(i)] = length > double(LeastColumn) * gram[0] ? 1 / std::sqrt(length) : 0;
      }
      for (int i = 0; i < m; ++i)
        for (int j = 0; j < m; ++j)
          gram[std::size_t(i * m + j)] *= scale[std::size_t(i)] * scale[std::size_t(j)];
      ModelColumns(in, r, px, py, x, y, own.data());
      for (int i = 0; i < m; ++i)
      {
        double& pivot = gram[std::size_t(i * m + i)];
        pivot = (scale[std::size_t(i)] > 0 ? pivot : 1) + (i ? p.ridge : 0);
        h[std::size_t(i)] = scale[std::size_t(i)] * own[std::size_t(i)];
      }
      for (int k = 0; k < m; ++k)
        for (int i = k + 1; i < m; ++i)
        {
          const double factor = gram[std::size_t(i * m + k)] / gram[std::size_t(k * m + k)];
          for (int j = k; j < m; ++j)
            gram[std::size_t(i * m + j)] -= factor * gram[std::size_t(k * m + j)];
          h[std::size_t(i)] -= factor * h[std::size_t(k)];
        }
      for (int i = m - 1; i >= 0; --i)
      {
        for (int j = i + 1; j < m; ++j)
          h[std::size_t(i)] -= gram[std::size_t(i * m + j)] * h[std::size_t(j)];
        h[std::size_t(i)] /= gram[std::size_t(i * m + i)];
      }
      double given = 0;
      forTaps(
        [&](int qx, int qy, double w)
        {
          ModelColumns(in, r, px, py, qx, qy, a.data());
          double part = 0;
          for (int i = 0; i < m; ++i)
            part += h[std::size_t(i)] * scale[std::size_t(i)] * a[std::size_t(i)];
          at(qx, qy) += says * w * part;
          given += w * part;
        });
      at(px, py) += says * (1 - given);
      total += says;
    }
  if (total > 1e-30)
  {
    std::size_t i = 0;
    for (int qy = weights.extent.y0; qy < weights.extent.y1; ++qy)
      for (int qx = weights.extent.x0; qx < weights.extent.x1; ++qx, ++i)
        *weights.at(qx, qy) = float(sums[i] / total);
    return;
  }
  // No model: the pixel itself, or the neighbours that stand in for it.
  AddFilledWeight(in.target, x, y, 1, weights);
}

void NonLocalScalar(const NonLocalInputs& in, const NonLocalParameters& p, const ImageOut& out, const Rect& tile)
{
  const Rect& e = in.target.extent;
  const int r = p.radius;
  const auto weight = [&](int px, int py, int qx, int qy)
  {
    if (!e.contains(qx, qy) || !IsTap(in, qx, qy))
      return 0.;
    double sum = 0;
    int n = 0;
    for (int oy = -p.patch; oy <= p.patch; ++oy)
      for (int ox = -p.patch; ox <= p.patch; ++ox)
      {
        const int ax = px + ox, ay = py + oy, bx = qx + ox, by = qy + oy;
        if (!e.contains(ax, ay) || !e.contains(bx, by) || !IsTap(in, ax, ay) || !IsTap(in, bx, by))
          continue;
        for (int c = 0; c < 3; ++c)
          sum += NonLocalDistance(Sane(in.guide.at(ax, ay)[c]), Sane(in.guide.at(bx, by)[c]),
                   GuideVariance(in, ax, ay, c), GuideVariance(in, bx, by, c), p.kColor, p.epsilon) /
                 3;
        ++n;
      }
    double exponent = std::max(0., sum / std::max(1, n));
    for (int k = 0; k < in.weighingCount; ++k)
      exponent = std::max(
        exponent, FeatureExponent(in.weighing[k], p.kFeature, px, py, qx, qy, SquaredGradient(in.weighing[k], px, py)));
    return exponent <= 80 ? std::exp(-exponent) : 0.;
  };
  const auto read = [&](int x, int y, double* c)
  {
    float v[3];
    ReadFilled(in.target, x, y, v);
    for (int k = 0; k < 3; ++k)
      c[k] = v[k];
  };
  const int m = p.regress ? 3 + RegressorComponents(in) : 1;
  const Rect centres = Centres(in, p, tile);
  std::vector<double> sums(std::size_t(centres.area()) * 4, 0.);
  for (int y = centres.y0; y < centres.y1; ++y)
    for (int x = centres.x0; x < centres.x1; ++x)
    {
      double own[3];
      read(x, y, own);
      std::vector<double> gram(std::size_t(m) * m, 0.), right(std::size_t(m) * 3, 0.);
      const auto forTaps = [&](auto&& body)
      {
        for (int qy = std::max(y - r, e.y0); qy <= std::min(y + r, e.y1 - 1); ++qy)
          for (int qx = std::max(x - r, e.x0); qx <= std::min(x + r, e.x1 - 1); ++qx)
            if (const double w = weight(x, y, qx, qy))
              body(qx, qy, w);
      };
      if (!p.regress)
      {
        double* sum = &sums[(std::size_t(y - centres.y0) * centres.width() + x - centres.x0) * 4];
        forTaps(
          [&](int qx, int qy, double w)
          {
            double q[3];
            read(qx, qy, q);
            for (int c = 0; c < 3; ++c)
              sum[c] += w * (q[c] - own[c]);
            sum[3] += w;
          });
        continue;
      }
      if (!IsTap(in, x, y))
        continue;
      std::vector<double> a(m);
      forTaps(
        [&](int qx, int qy, double w)
        {
          double q[3];
          read(qx, qy, q);
          ModelColumns(in, r, x, y, qx, qy, a.data());
          for (int i = 0; i < m; ++i)
          {
            for (int j = 0; j < m; ++j)
              gram[std::size_t(i) * m + j] += w * a[i] * a[j];
            for (int c = 0; c < 3; ++c)
              right[std::size_t(i) * 3 + c] += w * a[i] * (q[c] - own[c]);
          }
        });
      std::vector<double> scale(m);
      for (int i = 0; i < m; ++i)
        scale[i] =
          gram[std::size_t(i) * m + i] > LeastColumn * gram[0] ? 1 / std::sqrt(gram[std::size_t(i) * m + i]) : 0;
      for (int i = 0; i < m; ++i)
      {
        for (int j = 0; j < m; ++j)
          gram[std::size_t(i) * m + j] *= scale[i] * scale[j];
        for (int c = 0; c < 3; ++c)
          right[std::size_t(i) * 3 + c] *= scale[i];
        gram[std::size_t(i) * m + i] = (scale[i] > 0 ? gram[std::size_t(i) * m + i] : 1) + (i ? p.ridge : 0);
      }
      // Gauss with pivots on the diagonal: the matrix is positive definite.
      for (int k = 0; k < m; ++k)
        for (int i = k + 1; i < m; ++i)
        {
          const double factor = gram[std::size_t(i) * m + k] / gram[std::size_t(k) * m + k];
          for (int j = k; j < m; ++j)
            gram[std::size_t(i) * m + j] -= factor * gram[std::size_t(k) * m + j];
          for (int c = 0; c < 3; ++c)
            right[std::size_t(i) * 3 + c] -= factor * right[std::size_t(k) * 3 + c];
        }
      for (int i = m - 1; i >= 0; --i)
        for (int c = 0; c < 3; ++c)
        {
          for (int j = i + 1; j < m; ++j)
            right[std::size_t(i) * 3 + c] -= gram[std::size_t(i) * m + j] * right[std::size_t(j) * 3 + c];
          right[std::size_t(i) * 3 + c] /= gram[std::size_t(i) * m + i];
        }
      forTaps(
        [&](int qx, int qy, double w)
        {
          if (!centres.contains(qx, qy))
            return;
          double q[3];
          read(qx, qy, q);
          ModelColumns(in, r, x, y, qx, qy, a.data());
          double* sum = &sums[(std::size_t(qy - centres.y0) * centres.width() + qx - centres.x0) * 4];
          for (int c = 0; c < 3; ++c)
          {
            double prediction = own[c] - q[c];
            for (int i = 0; i < m; ++i)
              prediction += right[std::size_t(i) * 3 + c] * scale[i] * a[i];
            sum[c] += w * prediction;
          }
          sum[3] += w;
        });
    }
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      double own[3];
      read(x, y, own);
      const double* sum = &sums[(std::size_t(y - centres.y0) * centres.width() + x - centres.x0) * 4];
      const bool hit = !in.depth || Finite(*in.depth.at(x, y));
      for (int c = 0; c < 3; ++c)
      {
        double v = hit && sum[3] > 1e-30 ? own[c] + sum[c] / sum[3] : own[c];
        if (p.regress)
          v = std::max(v, std::min(0., own[c]));
        out.at(x, y)[c] = float(v);
      }
    }
}
}
#endif
