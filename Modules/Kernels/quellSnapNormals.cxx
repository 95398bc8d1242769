// SPDX-License-Identifier: BSD-3-Clause
#include "quellSnapNormals.h"

#include "quellGuards.h"

#include <cmath>

namespace quell
{
namespace
{
double LengthOf(const float* n) noexcept
{
  return std::sqrt(double(n[0]) * n[0] + double(n[1]) * n[1] + double(n[2]) * n[2]);
}

bool IsMixed(const SnapNormalsInputs& in, const SnapNormalsParameters& p, int x, int y, double length) noexcept
{
  if (!(length >= MixedNormalLength && length < 1e18))
    return true;
  if (!in.variance)
    return false;
  const float* const v = in.variance.at(x, y);
  double sum = 0;
  for (int c = 0; c < in.variance.components; ++c)
    sum += v[c];
  return sum / in.variance.components > p.mixedVariance; // not a number: not mixed
}

/// The normal to take, or null.
const float* BestAround(const SnapNormalsInputs& in, const SnapNormalsParameters& p, int x, int y) noexcept
{
  const float* const n = in.normal.at(x, y);
  const double z = in.depth ? std::fabs(*in.depth.at(x, y)) : 1;
  const float* taken = nullptr;
  double best = 0;
  for (int dy = -SnapNormalsReach; dy <= SnapNormalsReach; ++dy)
    for (int dx = -SnapNormalsReach; dx <= SnapNormalsReach; ++dx)
    {
      const int qx = x + dx, qy = y + dy;
      if (!in.normal.inside(qx, qy) || (in.depth && !Finite(*in.depth.at(qx, qy))) ||
          (in.id && *in.id.at(qx, qy) != *in.id.at(x, y)))
        continue;
      const float* const q = in.normal.at(qx, qy);
      const double length = LengthOf(q);
      if (IsMixed(in, p, qx, qy, length))
        continue;
      const double along = (double(n[0]) * q[0] + double(n[1]) * q[1] + double(n[2]) * q[2]) / length;
      double apart = 0;
      if (in.depth && in.position)
      {
        const float *const a = in.position.at(x, y), *const b = in.position.at(qx, qy);
        for (int c = 0; c < 3; ++c)
          apart += q[c] / length * (double(b[c]) - a[c]);
        apart /= z > 0 ? z : 1;
      }
      else if (in.depth)
        apart = z > 0 && *in.depth.at(qx, qy) != 0 ? std::log(std::fabs(*in.depth.at(qx, qy)) / z) : 0;
      const double scaled = apart == 0 ? 0 : apart / p.sigmaDepth;
      const double e = 0.5 * (scaled * scaled + dx * dx + dy * dy);
      const double value = e < 8 ? std::exp(-e) * along : 0;
      if (value > best)
      {
        best = value;
        taken = q;
      }
    }
  return taken;
}
}

std::int64_t SnapNormals(
  const SnapNormalsInputs& in, const SnapNormalsParameters& p, const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      const float* const n = in.normal.at(x, y);
      float* const made = out.at(x, y);
      const double length = LengthOf(n);
      const bool finite = Finite3(n);
      bad += !finite;
      for (int c = 0; c < 3; ++c)
        made[c] = finite ? n[c] : 0.f;
      if (!finite || length == 0 || length >= 1e18 || !IsMixed(in, p, x, y, length) ||
          (in.depth && !Finite(*in.depth.at(x, y))))
        continue;
      const float* const taken = BestAround(in, p, x, y);
      const double scale = 1 / (taken ? LengthOf(taken) : length);
      for (int c = 0; c < 3; ++c)
        made[c] = float((taken ? taken : n)[c] * scale);
    }
  return bad;
}
}
