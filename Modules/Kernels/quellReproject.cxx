// SPDX-License-Identifier: BSD-3-Clause
#include "quellReproject.h"

#include <limits>

namespace quell
{
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
    if (!std::isfinite(m[0]) || !std::isfinite(m[1]))
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
}

void Reproject(
  const ReprojectInputs& in, const ReprojectParameters& par, const ReprojectOutputs& out, const Rect& tile) noexcept
{
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      if (!in.history)
      {
        Clear(out, x, y, ReprojectMask::NoHistory);
        continue;
      }
      Target target;
      double mx = 0, my = 0;
      ReprojectMask reason = ReprojectMask::OffScreen;
      if (!Predict(in, par, x, y, target, mx, my, reason))
      {
        Clear(out, x, y, reason);
        continue;
      }
      const double qx = x + mx, qy = y + my;
      // Before any conversion to int: a motion of 1e9 must not overflow.
      if (!(qx > in.frame.x0 - 1 && qx < in.frame.x1 && qy > in.frame.y0 - 1 && qy < in.frame.y1))
      {
        Clear(out, x, y, ReprojectMask::OffScreen);
        continue;
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
          continue;
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
      if (out.moments)
      {
        double mean = 0, second = 0;
        if (in.moments)
        {
          for (int k = 0; k < count; ++k)
            mean += taps[k].weight * in.moments.at(taps[k].x, taps[k].y)[0];
          mean /= total;
          for (int k = 0; k < count; ++k)
          {
            const float* m = in.moments.at(taps[k].x, taps[k].y);
            const double d = m[0] - mean;
            second += taps[k].weight * (m[1] + d * d);
          }
          second = std::min<double>(second / total, std::numeric_limits<float>::max());
        }
        out.moments.at(x, y)[0] = float(mean);
        out.moments.at(x, y)[1] = float(second);
      }
      if (out.history)
      {
        double h = 0;
        for (int k = 0; k < count; ++k)
          h += taps[k].weight * (in.length ? *in.length.at(taps[k].x, taps[k].y) : 1.f);
        *out.history.at(x, y) = float(h / total);
      }
    }
}
}
