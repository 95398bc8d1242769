// SPDX-License-Identifier: BSD-3-Clause
#include "quellReproject.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellReproject.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellReproject_once
#define quellReproject_once
namespace quell
{
/// A ViewGeometry as plain numbers, for loops that the compiler vectorises.
struct ViewCoefficients
{
  double rows[3][3], shift[3], inverse[3][3], w;
  bool parallel;
  explicit ViewCoefficients(const ViewGeometry& v) noexcept
    : w(v.W)
    , parallel(v.Parallel)
  {
    for (int i = 0; i < 3; ++i)
    {
      this->shift[i] = v.Shift[i];
      for (int j = 0; j < 3; ++j)
      {
        this->rows[i][j] = v.Rows[i][j];
        this->inverse[i][j] = v.Inverse[i][j];
      }
    }
  }
};

namespace
{
/// A part of a row of the current frame in planes, columns from c0 - 1 on, and what is expected of its history.
struct ReprojectRow
{
  static constexpr int Columns = 128, Size = Columns + 2 + 64;
  alignas(64) float motion[2][Size], normal[3][Size], expected[Size], slack[Size];
};
/// Depth and id of a row and its neighbours; +inf and NaN where there is none.
struct SurfaceRow
{
  alignas(64) float depth[ReprojectRow::Size], id[ReprojectRow::Size];
};
/// What a row of vectors leaves: results, and a 1 in `again` for pixels that the scalar code must do.
struct ReprojectResult
{
  alignas(64) float color[3 * ReprojectRow::Size], moments[2 * ReprojectRow::Size], history[ReprojectRow::Size],
    mask[ReprojectRow::Size], again[ReprojectRow::Size], meanRest[ReprojectRow::Size] = {};
};
constexpr float LargestHistory = 1e18f; // its square is a float
}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
/// Depth in the previous camera and slack of `count` pixels from (c0, y) on, as Predict says; in double.
void ExpectImpl(const ReprojectInputs& in, const ReprojectParameters& par, const ViewCoefficients* now,
  const ViewCoefficients* then, int y, int c0, int count, const float* HWY_RESTRICT depth, const float* HWY_RESTRICT mx,
  const float* HWY_RESTRICT my, const float* HWY_RESTRICT position, float* HWY_RESTRICT expected,
  float* HWY_RESTRICT slack)
{
  const double width = in.frame.width(), height = in.frame.height();
  if (!now)
  {
    for (int i = 0; i < count; ++i)
    {
      expected[i] = depth[i];
      slack[i] = float(par.movingDepthTolerance * std::fabs(double(depth[i])));
    }
    return;
  }
  const ViewCoefficients a = *now, b = *then;
  const double ndcY = 2 * (y - in.frame.y0 + 0.5) / height - 1;
  const double tolerance = par.motionTolerance * par.motionTolerance;
  const bool ids = in.id && in.previousId;
  for (int i = 0; i < count; ++i)
  {
    const double z = std::fabs(depth[i]) <= std::numeric_limits<float>::max() ? depth[i] : 1.;
    const double ndcX = 2 * (c0 + i - in.frame.x0 + 0.5) / width - 1;
    const double wz = a.parallel ? a.w : z;
    double q[3];
    if (position)
      for (int k = 0; k < 3; ++k)
        q[k] = position[3 * i + k];
    else
    {
      const double v[3] = { ndcX * wz - a.shift[0], ndcY * wz - a.shift[1], z - a.shift[2] };
      for (int k = 0; k < 3; ++k)
        q[k] = a.inverse[k][0] * v[0] + a.inverse[k][1] * v[1] + a.inverse[k][2] * v[2];
    }
    double h0[3], h1[3];
    for (int k = 0; k < 3; ++k)
    {
      h0[k] = a.rows[k][0] * q[0] + a.rows[k][1] * q[1] + a.rows[k][2] * q[2] + a.shift[k];
      h1[k] = b.rows[k][0] * q[0] + b.rows[k][1] * q[1] + b.rows[k][2] * q[2] + b.shift[k];
    }
    const double w0 = a.parallel ? a.w : h0[2], w1 = b.parallel ? b.w : h1[2];
    const double m0 = std::max(std::fabs(h0[0]), std::fabs(h0[1])), m1 = std::max(std::fabs(h1[0]), std::fabs(h1[1]));
    const bool projected = (h0[2] > 0) & (std::fabs(w0) > 1e-6 * m0) & (h1[2] > 0) & (std::fabs(w1) > 1e-6 * m1);
    const double dx = mx[i] - 0.5 * width * (h1[0] / w1 - h0[0] / w0);
    const double dy = my[i] - 0.5 * height * (h1[1] / w1 - h0[1] / w0);
    const bool moved = dx * dx + dy * dy > tolerance;
    // The length of Unproject(ndc + 2 d / size) - Unproject(ndc).
    const double ax = 2 * dx / width * wz, ay = 2 * dy / height * wz;
    double square = 0;
    for (int k = 0; k < 3; ++k)
    {
      const double v = a.inverse[k][0] * ax + a.inverse[k][1] * ay;
      square += v * v;
    }
    const double loose = par.movingDepthTolerance * std::fabs(z);
    expected[i] = float(projected ? h1[2] : z);
    slack[i] = float(!projected ? loose : !moved ? 0. : ids ? loose : std::sqrt(square));
  }
}

/// Pixels c0 .. c0 + count of row y; surface[0..2]: rows y - 1 .. y + 1.
template <bool TwoFloats>
void ReprojectRowOf(const ReprojectInputs& in, const ReprojectParameters& par, const SurfaceRow* const* surface,
  const ReprojectRow& row, int y, int c0, int count, ReprojectResult& out)
{
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  using I = hn::Vec<decltype(di)>;
  const int lanes = int(hn::Lanes(d));
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), inf = hn::Set(d, std::numeric_limits<float>::infinity());
  const V largest = hn::Set(d, LargestHistory), threshold = hn::Set(d, float(par.normalThreshold));
  const V depthTolerance = hn::Set(d, float(par.depthTolerance)), depthEpsilon = hn::Set(d, float(par.depthEpsilon));
  const V minimumWeight = hn::Set(d, float(par.minimumWeight));
  const Rect e = in.frame;
  const int width = e.width();
  const bool normals = in.normal && in.previousNormal, ids = in.id && in.previousId;
  const auto fine = [&](V v) HWY_ATTR { return hn::Lt(hn::Abs(v), largest); };

  for (int i = 0; i < count; i += lanes)
  {
    const V z = hn::LoadU(d, surface[1]->depth + i + 1);
    const auto hit = hn::Lt(hn::Abs(z), inf);
    if (!par.backgroundHistory && hn::AllFalse(d, hit))
    {
      hn::StoreInterleaved3(zero, zero, zero, d, out.color + 3 * i);
      hn::StoreInterleaved2(zero, zero, d, out.moments + 2 * i);
      hn::StoreU(zero, d, out.history + i);
      if (TwoFloats)
        hn::StoreU(zero, d, out.meanRest + i);
      hn::StoreU(hn::Set(d, float(int(ReprojectMask::Background))), d, out.mask + i);
      hn::StoreU(zero, d, out.again + i);
      continue;
    }
    const V id = hn::LoadU(d, surface[1]->id + i + 1);
    const auto slope = [&](const SurfaceRow& ra, const SurfaceRow& rb, int oa, int ob) HWY_ATTR
    {
      V best = inf;
      const V za = hn::LoadU(d, ra.depth + i + oa), zb = hn::LoadU(d, rb.depth + i + ob);
      auto useA = hn::Lt(hn::Abs(za), inf), useB = hn::Lt(hn::Abs(zb), inf);
      if (in.id)
      {
        useA = hn::And(useA, hn::Eq(id, hn::LoadU(d, ra.id + i + oa)));
        useB = hn::And(useB, hn::Eq(id, hn::LoadU(d, rb.id + i + ob)));
      }
      best = hn::IfThenElse(useA, hn::Abs(hn::Sub(za, z)), best);
      best = hn::IfThenElse(useB, hn::Min(best, hn::Abs(hn::Sub(zb, z))), best);
      return hn::IfThenElseZero(hn::Lt(best, inf), best);
    };
    const V steepest = hn::Max(slope(*surface[1], *surface[1], 0, 2), slope(*surface[0], *surface[2], 1, 1));
    const V expected = hn::LoadU(d, row.expected + i + 1);
    const V tolerance =
      hn::MulAdd(depthTolerance, hn::MulAdd(depthEpsilon, hn::Abs(z), steepest), hn::LoadU(d, row.slack + i + 1));
    V n[3] = { zero, zero, zero }, nn = zero;
    if (normals)
    {
      for (int q = 0; q < 3; ++q)
        n[q] = hn::LoadU(d, row.normal[q] + i + 1);
      nn = hn::MulAdd(n[2], n[2], hn::MulAdd(n[1], n[1], hn::Mul(n[0], n[0])));
    }

    // Relative to the pixel; exact comparisons, false for NaN.
    V mx = hn::LoadU(d, row.motion[0] + i + 1), my = hn::LoadU(d, row.motion[1] + i + 1);
    const V px = hn::Add(hn::Set(d, float(c0 + i)), hn::Iota(d, 0.f)), py = hn::Set(d, float(y));
    const auto on = hn::And(
      hn::And(hn::Gt(mx, hn::Sub(hn::Set(d, float(e.x0 - 1)), px)), hn::Lt(mx, hn::Sub(hn::Set(d, float(e.x1)), px))),
      hn::And(hn::Gt(my, hn::Sub(hn::Set(d, float(e.y0 - 1)), py)), hn::Lt(my, hn::Sub(hn::Set(d, float(e.y1)), py))));
    mx = hn::IfThenElseZero(on, mx), my = hn::IfThenElseZero(on, my);
    const V fx = hn::Floor(mx), fy = hn::Floor(my);
    const V tx = hn::Sub(mx, fx), ty = hn::Sub(my, fy);
    const I left = hn::Add(hn::ConvertTo(di, fx), hn::Add(hn::Set(di, c0 + i - e.x0), hn::Iota(di, 0)));
    const I below = hn::Add(hn::ConvertTo(di, fy), hn::Set(di, y - e.y0));
    // Where all lanes move by the same whole pixels, their taps lie side by side.
    const int sx = int(hn::GetLane(fx)), sy = int(hn::GetLane(fy));
    const int firstX = c0 + i + sx - e.x0, firstY = y + sy - e.y0;
    const bool together =
      hn::AllTrue(d, hn::And(hn::Eq(fx, hn::Set(d, float(sx))), hn::Eq(fy, hn::Set(d, float(sy))))) && firstX >= 0 &&
      firstX + lanes + 1 <= width && firstY >= 0 && firstY + 2 <= e.height();

    V total = zero, heaviest = zero, ref[6] = { zero, zero, zero, zero, zero, zero };
    V weight[4], value[4][6], spread[4], rest[4] = { zero, zero, zero, zero }, refRest = zero;
    auto rejected = hn::Lt(one, zero), huge = rejected;
    for (int k = 0; k < 4; ++k)
    {
      const int dx = k & 1, dy = k >> 1;
      const V w = hn::Mul(dx ? tx : hn::Sub(one, tx), dy ? ty : hn::Sub(one, ty));
      const I u = hn::Add(left, hn::Set(di, dx)), v = hn::Add(below, hn::Set(di, dy));
      const I cu = hn::Min(hn::Max(u, hn::Zero(di)), hn::Set(di, width - 1));
      const I cv = hn::Min(hn::Max(v, hn::Zero(di)), hn::Set(di, e.height() - 1));
      const I index = hn::Add(hn::Mul(cv, hn::Set(di, width)), cu);
      const std::ptrdiff_t start = std::ptrdiff_t(firstY + dy) * width + firstX + dx;
      const auto scalarAt = [&](const ImageIn& image) HWY_ATTR
      { return together ? hn::LoadU(d, image.data + start) : hn::GatherIndex(d, image.data, index); };
      const auto vectorAt = [&](const ImageIn& image, V* t) HWY_ATTR
      {
        if (together)
          hn::LoadInterleaved3(d, image.data + 3 * start, t[0], t[1], t[2]);
        else
        {
          const I three = hn::Add(index, hn::Add(index, index));
          for (int q = 0; q < 3; ++q)
            t[q] = hn::GatherIndex(d, image.data + q, three);
        }
      };

      auto good = hn::And(hn::RebindMask(d, hn::Eq(u, cu)), hn::RebindMask(d, hn::Eq(v, cv)));
      if (in.previousDepth)
      {
        const V zt = scalarAt(in.previousDepth);
        const auto hitThen = hn::Lt(hn::Abs(zt), inf);
        const auto near = hn::Le(hn::Abs(hn::Sub(expected, zt)), tolerance);
        good = hn::And(good, hn::Or(hn::And(hit, hn::And(hitThen, near)), hn::Not(hn::Or(hit, hitThen))));
      }
      if (ids)
        good = hn::And(good, hn::Eq(id, scalarAt(in.previousId)));
      if (normals)
      {
        V t[3];
        vectorAt(in.previousNormal, t);
        const V tt = hn::MulAdd(t[2], t[2], hn::MulAdd(t[1], t[1], hn::Mul(t[0], t[0])));
        const V dot = hn::MulAdd(t[2], n[2], hn::MulAdd(t[1], n[1], hn::Mul(t[0], n[0])));
        const auto agree = hn::Gt(dot, hn::Mul(threshold, hn::Sqrt(hn::Mul(tt, nn))));
        const auto none = hn::And(hn::Eq(tt, zero), hn::Eq(nn, zero));
        good = hn::And(good, hn::Or(hn::Not(hit), hn::Or(none, agree)));
      }
      V* t = value[k];
      vectorAt(in.history, t);
      auto finite =
        hn::And(hn::Lt(hn::Abs(t[0]), inf), hn::And(hn::Lt(hn::Abs(t[1]), inf), hn::Lt(hn::Abs(t[2]), inf)));
      auto normalSize = hn::And(fine(t[0]), hn::And(fine(t[1]), fine(t[2])));
      t[3] = t[4] = zero;
      t[5] = one;
      if (in.moments)
      {
        if (together)
          hn::LoadInterleaved2(d, in.moments.data + 2 * start, t[3], t[4]);
        else
        {
          const I two = hn::Add(index, index);
          t[3] = hn::GatherIndex(d, in.moments.data, two);
          t[4] = hn::GatherIndex(d, in.moments.data + 1, two);
        }
        finite = hn::And(finite, hn::And(hn::Lt(hn::Abs(t[3]), inf), hn::Lt(hn::Abs(t[4]), inf)));
        normalSize = hn::And(normalSize, hn::And(fine(t[3]), fine(t[4])));
        if (TwoFloats)
        {
          rest[k] = scalarAt(in.meanRest);
          finite = hn::And(finite, hn::Lt(hn::Abs(rest[k]), inf));
          normalSize = hn::And(normalSize, fine(rest[k]));
        }
      }
      if (in.length)
      {
        t[5] = scalarAt(in.length);
        finite = hn::And(finite, hn::And(hn::Gt(t[5], zero), hn::Lt(t[5], inf)));
        normalSize = hn::And(normalSize, fine(t[5]));
      }
      good = hn::And(good, finite);
      const auto counts = hn::Gt(w, zero);
      const auto used = hn::And(counts, good);
      rejected = hn::Or(rejected, hn::AndNot(good, counts));
      huge = hn::Or(huge, hn::AndNot(normalSize, used));
      weight[k] = hn::IfThenElseZero(used, w);
      total = hn::Add(total, weight[k]);
      const auto heavier = hn::Gt(weight[k], heaviest);
      heaviest = hn::IfThenElse(heavier, weight[k], heaviest);
      for (int q = 0; q < 6; ++q)
      {
        t[q] = hn::IfThenElseZero(used, t[q]);
        ref[q] = hn::IfThenElse(heavier, t[q], ref[q]);
      }
      if (TwoFloats)
      {
        rest[k] = hn::IfThenElseZero(used, rest[k]);
        refRest = hn::IfThenElse(heavier, rest[k], refRest);
      }
    }
    // Differences to the heaviest tap: constants stay what they are, and nothing cancels.
    const auto enough = hn::And(hn::Ge(total, minimumWeight), hn::Gt(total, zero));
    const V inverse = hn::Div(one, hn::IfThenElse(enough, total, one));
    V mix[6];
    for (int q = 0; q < 6; ++q)
    {
      V sum = zero;
      for (int k = 0; k < 4; ++k)
        sum = hn::MulAdd(weight[k], hn::Sub(value[k][q], ref[q]), sum);
      mix[q] = hn::MulAdd(sum, inverse, ref[q]);
    }
    // The second moment grows by the spread of the means.
    V spreadSum = zero, low = zero;
    if (TwoFloats)
    {
      // Means as differences to the heaviest tap's, both floats of them.
      V offset = zero;
      for (int k = 0; k < 4; ++k)
      {
        spread[k] = hn::Add(hn::Sub(value[k][3], ref[3]), hn::Sub(rest[k], refRest));
        offset = hn::MulAdd(weight[k], spread[k], offset);
      }
      offset = hn::Mul(offset, inverse);
      const V step = hn::Add(refRest, offset);
      mix[3] = hn::Add(ref[3], step); // and what that rounds off (Knuth)
      const V there = hn::Sub(mix[3], ref[3]);
      low = hn::Add(hn::Sub(ref[3], hn::Sub(mix[3], there)), hn::Sub(step, there));
      for (int k = 0; k < 4; ++k)
        spread[k] = hn::Sub(spread[k], offset);
    }
    else
      for (int k = 0; k < 4; ++k)
        spread[k] = hn::Sub(value[k][3], mix[3]);
    for (int k = 0; k < 4; ++k)
    {
      spreadSum = hn::MulAdd(weight[k], hn::Mul(spread[k], spread[k]), spreadSum);
    }
    mix[4] = hn::MulAdd(spreadSum, inverse, mix[4]);
    if (!in.moments)
      mix[3] = mix[4] = low = zero;
    hn::StoreInterleaved3(mix[0], mix[1], mix[2], d, out.color + 3 * i);
    hn::StoreInterleaved2(mix[3], mix[4], d, out.moments + 2 * i);
    hn::StoreU(mix[5], d, out.history + i);
    if (TwoFloats)
      hn::StoreU(low, d, out.meanRest + i);
    hn::StoreU(hn::IfThenElseZero(rejected, one), d, out.mask + i);
    auto again = hn::Or(huge, hn::Not(hn::And(on, enough)));
    if (!par.backgroundHistory) // a few pixels at the edges of surfaces: cleared one by one
      again = hn::Or(again, hn::Not(hit));
    hn::StoreU(hn::IfThenElseZero(again, one), d, out.again + i);
  }
}

void ReprojectRowImpl(const ReprojectInputs& in, const ReprojectParameters& par, const SurfaceRow* const* surface,
  const ReprojectRow& row, int y, int c0, int count, ReprojectResult& out)
{
  if (in.meanRest)
    ReprojectRowOf<true>(in, par, surface, row, y, c0, count, out);
  else
    ReprojectRowOf<false>(in, par, surface, row, y, c0, count, out);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(ExpectImpl);
HWY_EXPORT(ReprojectRowImpl);

namespace
{
Vec3d RowOf(const Mat4& m, int i)
{
  return { m.m[i][0], m.m[i][1], m.m[i][2] };
}

Vec3d VectorAt(const ImageIn& v, int x, int y)
{
  const float* p = v.at(x, y);
  return { p[0], p[1], p[2] };
}
}

ViewGeometry::ViewGeometry(const Mat4& worldToNdc, const Mat4& worldToCamera, const Vec3d& offset) noexcept
{
  const Vec3d wRow = RowOf(worldToNdc, 3);
  this->Parallel = Dot(wRow, wRow) == 0;
  this->W = worldToNdc.m[3][3];
  this->Rows[0] = RowOf(worldToNdc, 0);
  this->Rows[1] = RowOf(worldToNdc, 1);
  this->Shift[0] = worldToNdc.m[0][3];
  this->Shift[1] = worldToNdc.m[1][3];
  if (this->Parallel)
  {
    this->Rows[2] = -RowOf(worldToCamera, 2);
    this->Shift[2] = -worldToCamera.m[2][3];
    if (!(std::fabs(this->W) > 0))
      return;
  }
  else
  {
    this->Rows[2] = wRow;
    this->Shift[2] = this->W;
  }
  for (int i = 0; i < 3; ++i)
    this->Shift[i] += Dot(this->Rows[i], offset);

  const Vec3d c0 = Cross(this->Rows[1], this->Rows[2]), c1 = Cross(this->Rows[2], this->Rows[0]),
              c2 = Cross(this->Rows[0], this->Rows[1]);
  const double det = Dot(this->Rows[0], c0);
  const double scale = Length(this->Rows[0]) * Length(this->Rows[1]) * Length(this->Rows[2]);
  const double shift = this->Shift[0] + this->Shift[1] + this->Shift[2];
  // Written so that NaN and infinite entries fail as well.
  if (!(std::fabs(det) > 1e-12 * scale) || !std::isfinite(scale) || !std::isfinite(shift))
    return;
  this->Inverse[0] = Vec3d(c0.x, c1.x, c2.x) / det;
  this->Inverse[1] = Vec3d(c0.y, c1.y, c2.y) / det;
  this->Inverse[2] = Vec3d(c0.z, c1.z, c2.z) / det;
  this->Valid = IsFinite(this->Inverse[0]) && IsFinite(this->Inverse[1]) && IsFinite(this->Inverse[2]);
}

bool ViewGeometry::Project(const Vec3d& p, double& ndcX, double& ndcY, double& depth) const noexcept
{
  const double x = Dot(this->Rows[0], p) + this->Shift[0];
  const double y = Dot(this->Rows[1], p) + this->Shift[1];
  depth = Dot(this->Rows[2], p) + this->Shift[2];
  const double w = this->Parallel ? this->W : depth;
  if (!(depth > 0) || !(std::fabs(w) > 1e-6 * std::max(std::fabs(x), std::fabs(y))))
    return false;
  ndcX = x / w;
  ndcY = y / w;
  return true;
}

bool ViewGeometry::ProjectDirection(const Vec3d& d, double& ndcX, double& ndcY) const noexcept
{
  if (this->Parallel)
  {
    ndcX = ndcY = 0;
    return true;
  }
  const double x = Dot(this->Rows[0], d), y = Dot(this->Rows[1], d), w = Dot(this->Rows[2], d);
  if (!(w > 1e-6 * std::max(std::fabs(x), std::fabs(y))))
    return false;
  ndcX = x / w;
  ndcY = y / w;
  return true;
}

Vec3d ViewGeometry::Unproject(double ndcX, double ndcY, double depth) const noexcept
{
  const double w = this->Parallel ? this->W : depth;
  const Vec3d v{ ndcX * w - this->Shift[0], ndcY * w - this->Shift[1], depth - this->Shift[2] };
  return { Dot(this->Inverse[0], v), Dot(this->Inverse[1], v), Dot(this->Inverse[2], v) };
}

Vec3d ViewGeometry::Direction(double ndcX, double ndcY) const noexcept
{
  const Vec3d v = this->Parallel ? Vec3d(0, 0, 1) : Vec3d(ndcX, ndcY, 1);
  return { Dot(this->Inverse[0], v), Dot(this->Inverse[1], v), Dot(this->Inverse[2], v) };
}

namespace
{
/// What the current pixel looks like to the tests, and where its point was.
struct Target
{
  bool hit = false;
  double depth = 0; ///< expected in the previous camera
  double tolerance = 0;
  Vec3d normal;
  double normalSquared = 0;
  float id = 0;
};

struct Tap
{
  int x = 0, y = 0;
  double weight = 0;
};

/// Slope of depth along one axis, in scene units per pixel: the smaller of the differences that stay on the surface.
double AxisSlope(const ReprojectInputs& in, int x, int y, int dx, int dy) noexcept
{
  const float z = *in.depth.at(x, y);
  double best = std::numeric_limits<double>::infinity();
  for (int s = -1; s <= 1; s += 2)
  {
    const int nx = x + s * dx, ny = y + s * dy;
    if (!in.depth.inside(nx, ny) || !in.frame.contains(nx, ny))
      continue;
    const float zn = *in.depth.at(nx, ny);
    if (!std::isfinite(zn) || (in.id && in.id.inside(nx, ny) && *in.id.at(nx, ny) != *in.id.at(x, y)))
      continue;
    best = std::min(best, std::fabs(double(zn) - z));
  }
  return std::isfinite(best) ? best : 0;
}

ReprojectMask Test(const ReprojectInputs& in, const ReprojectParameters& par, const Target& t, int x, int y) noexcept
{
  if (!in.frame.contains(x, y) || !in.history.inside(x, y))
    return ReprojectMask::OffScreen;
  if (in.previousDepth)
  {
    const float z = *in.previousDepth.at(x, y);
    if (std::isfinite(z) != t.hit)
      return ReprojectMask::HitDiffers;
    if (in.id && in.previousId && *in.previousId.at(x, y) != t.id)
      return ReprojectMask::IdDiffers;
    if (t.hit && !(std::fabs(t.depth - z) <= t.tolerance))
      return ReprojectMask::DepthDiffers;
  }
  else if (in.id && in.previousId && *in.previousId.at(x, y) != t.id)
    return ReprojectMask::IdDiffers;
  if (t.hit && in.normal && in.previousNormal)
  {
    const Vec3d n = VectorAt(in.previousNormal, x, y);
    const double nn = Dot(n, n);
    const bool bothZero = nn == 0 && t.normalSquared == 0;
    if (!bothZero && !(Dot(n, t.normal) > par.normalThreshold * std::sqrt(nn * t.normalSquared)))
      return ReprojectMask::NormalDiffers;
  }
  const float* c = in.history.at(x, y);
  for (int i = 0; i < in.history.components; ++i)
    if (!std::isfinite(c[i]))
      return ReprojectMask::BadHistory;
  if (in.moments)
  {
    const float* m = in.moments.at(x, y);
    if (!std::isfinite(m[0]) || !std::isfinite(m[1]) || (in.meanRest && !std::isfinite(*in.meanRest.at(x, y))))
      return ReprojectMask::BadHistory;
  }
  if (in.length)
  {
    const float h = *in.length.at(x, y);
    if (!(h > 0) || !std::isfinite(h))
      return ReprojectMask::BadHistory;
  }
  return ReprojectMask::Used;
}

/// Where the pixel's point was: motion in pixels; false: `reason` says why not. Fills the expected depth.
bool Predict(const ReprojectInputs& in, const ReprojectParameters& par, int x, int y, Target& t, double& mx, double& my,
  ReprojectMask& reason) noexcept
{
  const double width = in.frame.width(), height = in.frame.height();
  const double z = *in.depth.at(x, y);
  t.hit = std::isfinite(z);

  const bool cameras = in.current.IsValid() && in.previous.IsValid();
  bool projected = false;
  double cameraX = 0, cameraY = 0, expected = z;
  const double ndcX = 2 * (x - in.frame.x0 + 0.5) / width - 1, ndcY = 2 * (y - in.frame.y0 + 0.5) / height - 1;
  if (cameras)
  {
    double x0 = 0, y0 = 0, x1 = 0, y1 = 0, depth0 = 0;
    if (t.hit)
    {
      const bool stored = bool(in.position);
      const Vec3d p = stored ? VectorAt(in.position, x, y) : in.current.Unproject(ndcX, ndcY, z);
      projected = in.current.Project(p, x0, y0, depth0) && in.previous.Project(p, x1, y1, expected);
    }
    else
    {
      const Vec3d d = in.current.Direction(ndcX, ndcY);
      projected = in.current.ProjectDirection(d, x0, y0) && in.previous.ProjectDirection(d, x1, y1);
    }
    if (projected)
    {
      cameraX = 0.5 * width * (x1 - x0);
      cameraY = 0.5 * height * (y1 - y0);
    }
    else
      expected = z;
  }

  if (in.motion)
  {
    const float* m = in.motion.at(x, y);
    mx = m[0];
    my = m[1];
    reason = ReprojectMask::OffScreen;
    if (!std::isfinite(mx) || !std::isfinite(my))
      return false;
  }
  else if (projected)
  {
    mx = cameraX;
    my = cameraY;
  }
  else if (in.stillCamera)
    mx = my = 0;
  else
  {
    reason = ReprojectMask::NoProjection;
    return false;
  }

  if (!t.hit)
    return true;
  const double slope = std::max(AxisSlope(in, x, y, 1, 0), AxisSlope(in, x, y, 0, 1));
  t.depth = expected;
  t.tolerance = par.depthTolerance * (slope + par.depthEpsilon * std::fabs(z));
  if (in.motion && projected)
  {
    const double dx = mx - cameraX, dy = my - cameraY;
    if (std::hypot(dx, dy) > par.motionTolerance)
    {
      if (in.id && in.previousId)
        t.tolerance += par.movingDepthTolerance * std::fabs(z);
      else
        t.tolerance += Length(
          in.current.Unproject(ndcX + 2 * dx / width, ndcY + 2 * dy / height, z) - in.current.Unproject(ndcX, ndcY, z));
    }
  }
  else if (in.motion)
    t.tolerance += par.movingDepthTolerance * std::fabs(z);
  return true;
}

void Store(const ReprojectOutputs& out, int x, int y, ReprojectMask mask) noexcept
{
  if (out.mask)
    *out.mask.at(x, y) = float(int(mask));
}

void Clear(const ReprojectOutputs& out, int x, int y, ReprojectMask mask) noexcept
{
  if (out.radiance)
    for (int c = 0; c < out.radiance.components; ++c)
      out.radiance.at(x, y)[c] = 0;
  if (out.moments)
    out.moments.at(x, y)[0] = out.moments.at(x, y)[1] = 0;
  if (out.history)
    *out.history.at(x, y) = 0;
  if (out.meanRest)
    *out.meanRest.at(x, y) = 0;
  Store(out, x, y, mask);
}

/// False where an outer tap does not exist or is not finite.
bool FetchCatmullRom(
  const ReprojectInputs& in, int x0, int y0, double tx, double ty, int channel, double& value) noexcept
{
  double wx[4], wy[4];
  CatmullRomWeights(tx, wx);
  CatmullRomWeights(ty, wy);
  double sum = 0, lo = std::numeric_limits<double>::infinity(), hi = -lo;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i)
    {
      if (wx[i] == 0 || wy[j] == 0)
        continue;
      const int x = x0 - 1 + i, y = y0 - 1 + j;
      if (!in.history.inside(x, y))
        return false;
      const float v = in.history.at(x, y)[channel];
      if (!std::isfinite(v))
        return false;
      sum += wx[i] * wy[j] * v;
      if ((i == 1 || i == 2) && (j == 1 || j == 2))
      {
        lo = std::min<double>(lo, v);
        hi = std::max<double>(hi, v);
      }
    }
  value = std::min(std::max(sum, lo), hi);
  return true;
}

/// The formula in double, for any pixel.
void ReprojectPixel(
  const ReprojectInputs& in, const ReprojectParameters& par, const ReprojectOutputs& out, int x, int y) noexcept
{
  if (!in.history)
  {
    Clear(out, x, y, ReprojectMask::NoHistory);
    return;
  }
  if (!par.backgroundHistory && !std::isfinite(*in.depth.at(x, y)))
  {
    Clear(out, x, y, ReprojectMask::Background);
    return;
  }
  Target target;
  double mx = 0, my = 0;
  ReprojectMask reason = ReprojectMask::OffScreen;
  if (!Predict(in, par, x, y, target, mx, my, reason))
  {
    Clear(out, x, y, reason);
    return;
  }
  const double qx = x + mx, qy = y + my;
  // Before any conversion to int: a motion of 1e9 must not overflow.
  if (!(qx > in.frame.x0 - 1 && qx < in.frame.x1 && qy > in.frame.y0 - 1 && qy < in.frame.y1))
  {
    Clear(out, x, y, ReprojectMask::OffScreen);
    return;
  }
  if (in.normal)
  {
    target.normal = VectorAt(in.normal, x, y);
    target.normalSquared = Dot(target.normal, target.normal);
  }
  if (in.id)
    target.id = *in.id.at(x, y);

  const double fx = std::floor(qx), fy = std::floor(qy), tx = qx - fx, ty = qy - fy;
  const int x0 = int(fx), y0 = int(fy);
  Tap taps[9];
  int count = 0, rejected = 0;
  double total = 0, heaviest = 0;
  for (int k = 0; k < 4; ++k)
  {
    const double w = ((k & 1) ? tx : 1 - tx) * ((k & 2) ? ty : 1 - ty);
    if (!(w > 0))
      continue;
    const Tap tap{ x0 + (k & 1), y0 + (k >> 1), w };
    const ReprojectMask test = Test(in, par, target, tap.x, tap.y);
    if (test == ReprojectMask::Used)
    {
      taps[count++] = tap;
      total += w;
    }
    else
    {
      ++rejected;
      if (w > heaviest)
      {
        heaviest = w;
        reason = test;
      }
    }
  }
  ReprojectMask mask = rejected ? ReprojectMask::SomeTaps : ReprojectMask::Used;
  if (!(total >= par.minimumWeight) || count == 0)
  {
    count = 0;
    const int cx = int(std::floor(qx + 0.5)), cy = int(std::floor(qy + 0.5));
    for (int j = -1; j <= 1; ++j)
      for (int i = -1; i <= 1; ++i)
        if (Test(in, par, target, cx + i, cy + j) == ReprojectMask::Used)
          taps[count++] = { cx + i, cy + j, 1 };
    if (count == 0)
    {
      Clear(out, x, y, reason);
      return;
    }
    total = count;
    mask = ReprojectMask::Neighbourhood;
  }

  Store(out, x, y, mask);
  if (out.radiance)
    for (int c = 0; c < out.radiance.components; ++c)
    {
      double v = 0;
      if (!(par.catmullRom && mask == ReprojectMask::Used && FetchCatmullRom(in, x0, y0, tx, ty, c, v)))
      {
        v = 0;
        for (int k = 0; k < count; ++k)
          v += taps[k].weight * in.history.at(taps[k].x, taps[k].y)[c];
        v /= total;
      }
      out.radiance.at(x, y)[c] = float(v);
    }
  if (out.moments || out.meanRest)
  {
    double mean = 0, second = 0;
    if (in.moments)
    {
      const auto meanOf = [&](const Tap& t)
      { return double(in.moments.at(t.x, t.y)[0]) + (in.meanRest ? double(*in.meanRest.at(t.x, t.y)) : 0.); };
      for (int k = 0; k < count; ++k)
        mean += taps[k].weight * meanOf(taps[k]);
      mean /= total;
      for (int k = 0; k < count; ++k)
      {
        const float* m = in.moments.at(taps[k].x, taps[k].y);
        const double d = meanOf(taps[k]) - mean;
        second += taps[k].weight * (m[1] + d * d);
      }
      second = std::min<double>(second / total, std::numeric_limits<float>::max());
    }
    const double limit = std::numeric_limits<float>::max();
    mean = std::min(std::max(mean, -limit), limit); // two floats may reach beyond
    if (out.moments)
    {
      out.moments.at(x, y)[0] = float(mean);
      out.moments.at(x, y)[1] = float(second);
    }
    if (out.meanRest)
      *out.meanRest.at(x, y) = in.meanRest ? float(mean - float(mean)) : 0.f;
  }
  if (out.history)
  {
    double h = 0;
    for (int k = 0; k < count; ++k)
      h += taps[k].weight * (in.length ? *in.length.at(taps[k].x, taps[k].y) : 1.f);
    *out.history.at(x, y) = float(h / total);
  }
}

/// `count` values of a one-component image from column x of row y on; `none` where it or the frame has none.
void FillSome(const ImageIn& image, const Rect& frame, int x, int y, int count, float none, float* out) noexcept
{
  const Rect there = image ? image.extent.clipped(frame) : Rect();
  if (y < there.y0 || y >= there.y1)
  {
    std::fill(out, out + count, none);
    return;
  }
  const int first = std::min(std::max(there.x0 - x, 0), count), last = std::max(std::min(there.x1 - x, count), first);
  std::fill(out, out + first, none);
  if (first < last)
    std::copy_n(image.at(x + first, y), last - first, out + first);
  std::fill(out + last, out + count, none);
}

void FillSurface(const ReprojectInputs& in, SurfaceRow& row, int y, int c0, int count) noexcept
{
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  FillSome(in.depth, in.frame, c0 - 1, y, count + 2, inf, row.depth);
  FillSome(in.id, in.frame, c0 - 1, y, count + 2, nan, row.id);
  // what lanes right of the row read
  std::fill(row.depth + count + 2, row.depth + ReprojectRow::Size, inf);
  std::fill(row.id + count + 2, row.id + ReprojectRow::Size, nan);
}

void FillRow(const ReprojectInputs& in, ReprojectRow& row, int y, int c0, int count) noexcept
{
  const float* motion = in.motion.at(c0, y);
  for (int i = 0; i < count; ++i)
  {
    row.motion[0][i + 1] = motion[2 * i];
    row.motion[1][i + 1] = motion[2 * i + 1];
  }
  if (in.normal)
  {
    const float* normal = in.normal.at(c0, y);
    for (int i = 0; i < count; ++i)
      for (int q = 0; q < 3; ++q)
        row.normal[q][i + 1] = normal[3 * i + q];
  }
  for (float* plane : { row.motion[0], row.motion[1], row.normal[0], row.normal[1], row.normal[2] })
    std::fill(plane + count + 1, plane + ReprojectRow::Size, 0.f);
  for (float* plane : { row.expected, row.slack })
    std::fill(plane + count + 1, plane + ReprojectRow::Size, 0.f);
}

/// Whether the vector code knows the case.
bool Vectorised(const ReprojectInputs& in, const ReprojectParameters& par) noexcept
{
  if (!in.history || !in.motion || par.catmullRom || in.history.components != 3)
    return false;
  // Indices are of 32 bits, and the same for all previous views.
  if (std::int64_t(in.frame.area()) * 3 > std::numeric_limits<int>::max() - 16)
    return false;
  for (const ImageIn* view :
    { &in.history, &in.moments, &in.length, &in.meanRest, &in.previousDepth, &in.previousNormal, &in.previousId })
    if (*view && (view->extent != in.frame || view->rowStride != std::ptrdiff_t(in.frame.width()) * view->components))
      return false;
  return true;
}
}

void ReprojectScalar(
  const ReprojectInputs& in, const ReprojectParameters& par, const ReprojectOutputs& out, const Rect& tile) noexcept
{
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
      ReprojectPixel(in, par, out, x, y);
}

void Reproject(
  const ReprojectInputs& in, const ReprojectParameters& par, const ReprojectOutputs& out, const Rect& tile) noexcept
{
  if (!Vectorised(in, par))
    return ReprojectScalar(in, par, out, tile);
  const bool cameras = in.current.IsValid() && in.previous.IsValid();
  const ViewCoefficients now(in.current), then(in.previous);
  SurfaceRow memory[3];
  ReprojectRow row;
  ReprojectResult result;
  for (int c0 = tile.x0; c0 < tile.x1; c0 += ReprojectRow::Columns)
  {
    const int count = std::min(ReprojectRow::Columns, tile.x1 - c0);
    for (int v = tile.y0 - 1; v <= tile.y1; ++v)
    {
      FillSurface(in, memory[(v - tile.y0 + 1) % 3], v, c0, count);
      if (v < tile.y0 + 1)
        continue;
      const int y = v - 1, at = y - tile.y0;
      const SurfaceRow* const surface[3] = { &memory[at % 3], &memory[(at + 1) % 3], &memory[(at + 2) % 3] };
      FillRow(in, row, y, c0, count);
      HWY_DYNAMIC_DISPATCH(ExpectImpl)
      (in, par, cameras ? &now : nullptr, &then, y, c0, count, surface[1]->depth + 1, row.motion[0] + 1,
        row.motion[1] + 1, in.position ? in.position.at(c0, y) : nullptr, row.expected + 1, row.slack + 1);
      HWY_DYNAMIC_DISPATCH(ReprojectRowImpl)(in, par, surface, row, y, c0, count, result);
      if (out.radiance)
        std::copy(result.color, result.color + 3 * count, out.radiance.at(c0, y));
      if (out.moments)
        std::copy(result.moments, result.moments + 2 * count, out.moments.at(c0, y));
      if (out.history)
        std::copy(result.history, result.history + count, out.history.at(c0, y));
      if (out.meanRest)
        std::copy(result.meanRest, result.meanRest + count, out.meanRest.at(c0, y));
      if (out.mask)
        std::copy(result.mask, result.mask + count, out.mask.at(c0, y));
      for (int i = 0; i < count; ++i)
        if (result.again[i] != 0)
          ReprojectPixel(in, par, out, c0 + i, y);
    }
  }
}
}
#endif
