// SPDX-License-Identifier: BSD-3-Clause
// The arithmetic of wavefronts. Loops are written so that the compiler turns them into vectors, once per instruction
// set; sums and products stand in the order of the scalar code that they mirror.
#include "quellWavefront.h"

#include "quellCamera.h"

#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellWavefrontLanes.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
namespace hn = hwy::HWY_NAMESPACE;

/// Rows to compute: whole vectors, so that loops need no rest.
HWY_INLINE unsigned Rows(const Wavefront& w)
{
  return (unsigned(w.Count) + 15u) & ~15u;
}
HWY_INLINE float Larger(float a, float b)
{
  return a > b ? a : b;
}
HWY_INLINE float Smaller(float a, float b)
{
  return a < b ? a : b;
}
HWY_INLINE float Largest(float x, float y, float z)
{
  return x > y ? (x > z ? x : z) : (y > z ? y : z);
}
HWY_INLINE float Dot3(float ax, float ay, float az, float bx, float by, float bz)
{
  return ax * bx + ay * by + az * bz;
}
HWY_INLINE std::uint32_t Reverse(std::uint32_t v)
{
  v = (v >> 24) | ((v >> 8) & 0xff00u) | ((v << 8) & 0xff0000u) | (v << 24);
  v = ((v & 0x0f0f0f0fu) << 4) | ((v >> 4) & 0x0f0f0f0fu);
  v = ((v & 0x33333333u) << 2) | ((v >> 2) & 0x33333333u);
  return ((v & 0x55555555u) << 1) | ((v >> 1) & 0x55555555u);
}
HWY_INLINE float ToUnit(std::uint32_t v)
{
  return float(std::int32_t(v >> 8)) * 0x1p-24f;
}

void DrawRandomImpl(Wavefront& w, std::uint32_t which, int slot)
{
  using namespace sampling;
  const unsigned n = Rows(w);
  const std::uint64_t pair = std::uint64_t(which) << 40;
  const Wavefront::State& live = w.Live;
  for (unsigned i = 0; i < n; ++i)
  {
    const std::uint64_t key = std::uint64_t(live.KeyHi[i]) << 32 | live.KeyLo[i];
    const std::uint64_t h = Mix64((key ^ pair) + 0x9e3779b97f4a7c15ull), s = Mix64(h);
    w.Hash[0][i] = std::uint32_t(h);
    w.Hash[1][i] = std::uint32_t(s);
    w.Hash[2][i] = std::uint32_t(s >> 32);
  }
  Wavefront::Column<float>&x = w.Random[2 * slot], &y = w.Random[2 * slot + 1];
  for (unsigned i = 0; i < n; ++i)
  {
    const std::uint32_t v = Reverse(ScrambleReversed(live.Reversed[i], w.Hash[0][i]));
    x[i] = ToUnit(Reverse(ScrambleReversed(v, w.Hash[1][i])));
    y[i] = ToUnit(Reverse(ScrambleReversed(PascalReversed(v), w.Hash[2][i])));
  }
}

void LocateImpl(Wavefront& w)
{
  const unsigned n = Rows(w);
  for (unsigned i = 0; i < n; ++i)
  {
    const double ax = double(w.Corner[0][i]), ay = double(w.Corner[1][i]), az = double(w.Corner[2][i]);
    const double bx = double(w.Corner[3][i]) - ax, by = double(w.Corner[4][i]) - ay, bz = double(w.Corner[5][i]) - az;
    const double cx = double(w.Corner[6][i]) - ax, cy = double(w.Corner[7][i]) - ay, cz = double(w.Corner[8][i]) - az;
    const double u = double(w.U[i]), v = double(w.V[i]);
    w.Px[i] = float(ax + bx * u + cx * v);
    w.Py[i] = float(ay + by * u + cy * v);
    w.Pz[i] = float(az + bz * u + cz * v);
    const double nx = by * cz - bz * cy, ny = bz * cx - bx * cz, nz = bx * cy - by * cx;
    const double scale = 1 / std::sqrt(nx * nx + ny * ny + nz * nz);
    w.Gx[i] = float(nx * scale);
    w.Gy[i] = float(ny * scale);
    w.Gz[i] = float(nz * scale);
  }
  for (unsigned i = 0; i < n; ++i)
  {
    float largest = 0;
    for (int k = 0; k < 9; ++k)
      largest = Larger(std::fabs(w.Corner[k][i]), largest);
    w.Offset[i] = largest * OffsetScale;
  }
  const Wavefront::State& live = w.Live;
  for (unsigned i = 0; i < n; ++i)
  {
    const float facing = Dot3(w.Gx[i], w.Gy[i], w.Gz[i], live.Dx[i], live.Dy[i], live.Dz[i]);
    // the winding of a mirrored part tells the inside
    const bool before = facing < 0;
    const bool mirrored = (w.Material[i] & WavefrontAccess::Mirrored) != 0;
    w.Front[i] = before != mirrored ? ~0u : 0u;
    w.Sx[i] = w.Gx[i] = before ? w.Gx[i] : -w.Gx[i];
    w.Sy[i] = w.Gy[i] = before ? w.Gy[i] : -w.Gy[i];
    w.Sz[i] = w.Gz[i] = before ? w.Gz[i] : -w.Gz[i];
  }
}

void AimDiffuseImpl(Wavefront& w)
{
  const unsigned n = Rows(w);
  const Wavefront::State& live = w.Live;
  for (unsigned i = 0; i < n; ++i)
  {
    const float wx = w.Wx[i], wy = w.Wy[i], wz = w.Wz[i];
    const float ci = Dot3(w.Sx[i], w.Sy[i], w.Sz[i], wx, wy, wz);
    const float co = Dot3(w.Sx[i], w.Sy[i], w.Sz[i], -live.Dx[i], -live.Dy[i], -live.Dz[i]);
    const float gi = Dot3(w.Gx[i], w.Gy[i], w.Gz[i], wx, wy, wz);
    const float k = (1 / Pi) * ci;
    const float vr = live.Tr[i] * (w.Ar[i] * k), vg = live.Tg[i] * (w.Ag[i] * k), vb = live.Tb[i] * (w.Ab[i] * k);
    const std::uint32_t flags = w.LightFlags[i];
    const std::uint32_t lit = std::uint32_t(ci > 0) & std::uint32_t(co > 0) & std::uint32_t(gi > 0) &
                              (std::uint32_t(vr > 0) | std::uint32_t(vg > 0) | std::uint32_t(vb > 0)) &
                              (std::uint32_t(w.Er[i] > 0) | std::uint32_t(w.Eg[i] > 0) | std::uint32_t(w.Eb[i] > 0));
    const float ox = w.Px[i] + w.Gx[i] * w.Offset[i], oy = w.Py[i] + w.Gy[i] * w.Offset[i],
                oz = w.Pz[i] + w.Gz[i] * w.Offset[i];
    const float jx = w.Lx[i] - ox, jy = w.Ly[i] - oy, jz = w.Lz[i] - oz;
    const bool infinite = (flags & Wavefront::LightAtInfinity) != 0;
    w.Kx[i] = ox;
    w.Ky[i] = oy;
    w.Kz[i] = oz;
    w.Jx[i] = infinite ? wx : jx;
    w.Jy[i] = infinite ? wy : jy;
    w.Jz[i] = infinite ? wz : jz;
    w.Far[i] = infinite ? std::numeric_limits<float>::infinity() : ShadowEnd;
    w.Cr[i] = vr;
    w.Cg[i] = vg;
    w.Cb[i] = vb;
    w.ScatterPdf[i] = ci / Pi;
    w.Lit[i] = flags & (0u - lit); // 0 where no sample was drawn
  }
}

void CameraRaysImpl(Wavefront& w, const double* px, const double* py, const Camera& camera)
{
  constexpr double most = std::numeric_limits<double>::max();
  const unsigned n = Rows(w);
  Wavefront::State& live = w.Live;
  const Vec3d right = camera.Right, up = camera.Up, forward = camera.Forward, from = camera.Position;
  const double width = camera.Width, height = camera.Height, halfX = camera.HalfX, halfY = camera.HalfY;
  for (unsigned i = 0; i < n; ++i)
  {
    const double x = (2 * px[i] / width - 1) * halfX, y = (2 * py[i] / height - 1) * halfY;
    const double dx = forward.x + right.x * x + up.x * y, dy = forward.y + right.y * x + up.y * y,
                 dz = forward.z + right.z * x + up.z * y;
    const double l = std::sqrt(dx * dx + dy * dy + dz * dz);
    const bool good = (l > 0) & (l <= most);
    const double ux = dx / l, uy = dy / l, uz = dz / l;
    live.Dx[i] = float(good ? ux : 0.);
    live.Dy[i] = float(good ? uy : 0.);
    live.Dz[i] = float(good ? uz : 0.);
    live.Ox[i] = float(from.x);
    live.Oy[i] = float(from.y);
    live.Oz[i] = float(from.z);
  }
}

/// The interpolated normal on the side of the ray, into Kx, Ky, Kz (not in use yet).
HWY_INLINE void Smoothen(Wavefront& w, unsigned n)
{
  constexpr float most = std::numeric_limits<float>::max();
  for (unsigned i = 0; i < n; ++i)
  {
    const float x = w.Nx[i], y = w.Ny[i], z = w.Nz[i], l = std::sqrt(Dot3(x, y, z, x, y, z));
    const std::uint32_t good =
      std::uint32_t((w.Material[i] & WavefrontAccess::Smooth) != 0) & std::uint32_t(l > 0) & std::uint32_t(l <= most);
    const float ux = x / l, uy = y / l, uz = z / l;
    const bool behind = Dot3(ux, uy, uz, w.Gx[i], w.Gy[i], w.Gz[i]) < 0;
    const float nx = behind ? -ux : ux, ny = behind ? -uy : uy, nz = behind ? -uz : uz;
    w.Kx[i] = good ? nx : w.Gx[i];
    w.Ky[i] = good ? ny : w.Gy[i];
    w.Kz[i] = good ? nz : w.Gz[i];
  }
}

/// Normal maps around Kx, Ky, Kz.
HWY_INLINE void Bump(Wavefront& w, unsigned n)
{
  constexpr double most = std::numeric_limits<double>::max();
  constexpr float mostFloat = std::numeric_limits<float>::max();
  const Wavefront::OpaqueColumns& o = w.Opaque;
  Wavefront::Column<float>&x = w.Kx, &y = w.Ky, &z = w.Kz;
  for (unsigned i = 0; i < n; ++i)
  {
    const double ax = double(w.Corner[0][i]), ay = double(w.Corner[1][i]), az = double(w.Corner[2][i]);
    const double bx = double(w.Corner[3][i]) - ax, by = double(w.Corner[4][i]) - ay, bz = double(w.Corner[5][i]) - az;
    const double cx = double(w.Corner[6][i]) - ax, cy = double(w.Corner[7][i]) - ay, cz = double(w.Corner[8][i]) - az;
    const double du1 = double(o.Slope[0][i]), dv1 = double(o.Slope[1][i]), du2 = double(o.Slope[2][i]),
                 dv2 = double(o.Slope[3][i]);
    const double det = du1 * dv2 - du2 * dv1, inverse = 1 / det;
    const bool flat = !(std::fabs(det) > 0 && std::fabs(det) <= most);
    const bool right = (det < 0) != ((w.Material[i] & WavefrontAccess::Mirrored) != 0);
    const double handed = right ? 1. : -1.;
    const double sx = double(x[i]), sy = double(y[i]), sz = double(z[i]);
    const double px = (bx * dv2 - cx * dv1) * inverse, py = (by * dv2 - cy * dv1) * inverse,
                 pz = (bz * dv2 - cz * dv1) * inverse;
    const double along = px * sx + py * sy + pz * sz;
    const double qx = px - sx * along, qy = py - sy * along, qz = pz - sz * along;
    const double l = std::sqrt(qx * qx + qy * qy + qz * qz);
    const double tx = qx / l, ty = qy / l, tz = qz / l;
    const double side = w.Front[i] ? 1. : -1.;
    const double nx = side * sx, ny = side * sy, nz = side * sz;
    const double ux = (ny * tz - nz * ty) * handed, uy = (nz * tx - nx * tz) * handed,
                 uz = (nx * ty - ny * tx) * handed;
    const float lx = o.Bump[0][i], ly = o.Bump[1][i], lz = o.Bump[2][i];
    const double fx = tx * double(lx) + ux * double(ly) + sx * double(lz),
                 fy = ty * double(lx) + uy * double(ly) + sy * double(lz),
                 fz = tz * double(lx) + uz * double(ly) + sz * double(lz);
    const double m = std::sqrt(fx * fx + fy * fy + fz * fz);
    const float gx = float(fx / m), gy = float(fy / m), gz = float(fz / m);
    const std::uint32_t good = std::uint32_t((w.Material[i] & WavefrontAccess::Bumped) != 0) & std::uint32_t(!flat) &
                               std::uint32_t(l > 0) & std::uint32_t(l <= most) & std::uint32_t(m > 0) &
                               std::uint32_t(m <= most) & std::uint32_t(std::fabs(lx) <= mostFloat) &
                               std::uint32_t(std::fabs(ly) <= mostFloat) & std::uint32_t(std::fabs(lz) <= mostFloat);
    x[i] = good ? gx : x[i];
    y[i] = good ? gy : y[i];
    z[i] = good ? gz : z[i];
  }
}

void BendImpl(Wavefront& w, bool bumped)
{
  const unsigned n = Rows(w);
  Smoothen(w, n);
  if (bumped)
    Bump(w, n);
  constexpr float least = 0.01f, mostFloat = std::numeric_limits<float>::max();
  const Wavefront::State& live = w.Live;
  const Wavefront::Column<float>&x = w.Kx, &y = w.Ky, &z = w.Kz;
  // Adapted (quellShading.cxx)
  for (unsigned i = 0; i < n; ++i)
  {
    const float ox = -live.Dx[i], oy = -live.Dy[i], oz = -live.Dz[i], gx = w.Gx[i], gy = w.Gy[i], gz = w.Gz[i];
    const float nx = x[i], ny = y[i], nz = z[i];
    const float facing = Dot3(nx, ny, nz, ox, oy, oz);
    const bool low = facing < least;
    const float d = least - facing;
    float ax = nx + ox * d, ay = ny + oy * d, az = nz + oz * d;
    const float la = std::sqrt(Dot3(ax, ay, az, ax, ay, az));
    const bool fine = (la > 0) & (la <= mostFloat);
    ax = fine ? ax / la : 0.f;
    ay = fine ? ay / la : 0.f;
    az = fine ? az / la : 0.f;
    const bool same = (nx == gx) & (ny == gy) & (nz == gz);
    const bool gone = low & !same & !(Dot3(ax, ay, az, gx, gy, gz) > 0);
    const float bx = low ? ax : nx, by = low ? ay : ny, bz = low ? az : nz;
    const float twice = 2 * Dot3(bx, by, bz, ox, oy, oz);
    const float mx = bx * twice - ox, my = by * twice - oy, mz = bz * twice - oz;
    const float height = Dot3(gx, gy, gz, mx, my, mz), up = Dot3(gx, gy, gz, ox, oy, oz);
    const float wanted = up < least ? up : least;
    const bool lift = height < wanted;
    const float h = wanted - height;
    float cx = mx + gx * h, cy = my + gy * h, cz = mz + gz * h;
    const float lc = std::sqrt(Dot3(cx, cy, cz, cx, cy, cz));
    const bool some = (lc > 0) & (lc <= mostFloat);
    cx = (some ? cx / lc : 0.f) + ox;
    cy = (some ? cy / lc : 0.f) + oy;
    cz = (some ? cz / lc : 0.f) + oz;
    const float le = std::sqrt(Dot3(cx, cy, cz, cx, cy, cz));
    const bool raised = (le > 0) & (le <= mostFloat);
    const float ex = raised ? cx / le : gx, ey = raised ? cy / le : gy, ez = raised ? cz / le : gz;
    const float rx = lift ? ex : bx, ry = lift ? ey : by, rz = lift ? ez : bz;
    const bool bent = (w.Material[i] & (WavefrontAccess::Smooth | WavefrontAccess::Bumped)) != 0;
    const float vx = gone ? gx : same ? nx : rx, vy = gone ? gy : same ? ny : ry, vz = gone ? gz : same ? nz : rz;
    w.Sx[i] = bent ? vx : w.Sx[i];
    w.Sy[i] = bent ? vy : w.Sy[i];
    w.Sz[i] = bent ? vz : w.Sz[i];
  }
}

void RayKeysImpl(const Wavefront& w, std::uint32_t which, std::uint32_t* keys)
{
  const unsigned n = Rows(w);
  const std::uint64_t ray = 0xd1b54a32d192ed03ull * (which + 1);
  const Wavefront::State& live = w.Live;
  for (unsigned i = 0; i < n; ++i)
  {
    const std::uint64_t key = std::uint64_t(live.KeyHi[i]) << 32 | live.KeyLo[i];
    keys[i] = std::uint32_t(sampling::Mix64(sampling::Mix64(key + ray) ^ live.Reversed[i]) >> 32);
  }
}

void CloseImpl(Wavefront& w, int rows)
{
  const hn::ScalableTag<std::uint32_t> d;
  const unsigned lanes = unsigned(hn::Lanes(d)), n = unsigned(w.Count);
  int left = 0;
  for (unsigned i = 0; i < n; ++i)
    left += int(w.Alive[i] & 1u);
  if (left == w.Count)
    return;
  std::uint32_t* state = reinterpret_cast<std::uint32_t*>(&w.Live);
  for (int row = 0; row < rows; ++row)
  {
    std::uint32_t* column = state + std::size_t(row) * Wavefront::Stride;
    unsigned to = 0;
    for (unsigned i = 0; i < n; i += lanes)
    {
      // rows past the end may say anything
      const auto mask =
        hn::And(hn::Ne(hn::LoadU(d, w.Alive + i), hn::Zero(d)), hn::FirstN(d, n - i < lanes ? n - i : lanes));
      hn::StoreU(hn::Compress(hn::LoadU(d, column + i), mask), d, column + to);
      to += unsigned(hn::CountTrue(d, mask));
    }
  }
  w.Count = left;
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(DrawRandomImpl);
HWY_EXPORT(LocateImpl);
HWY_EXPORT(CameraRaysImpl);
HWY_EXPORT(AimDiffuseImpl);
HWY_EXPORT(BendImpl);
HWY_EXPORT(RayKeysImpl);
HWY_EXPORT(CloseImpl);

namespace lanes
{
void DrawRandom(Wavefront& w, std::uint32_t pair, int slot) noexcept
{
  HWY_DYNAMIC_DISPATCH(DrawRandomImpl)(w, pair, slot);
}
void Locate(Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(LocateImpl)(w);
}
void CameraRays(Wavefront& w, const double* px, const double* py, const Camera& camera) noexcept
{
  HWY_DYNAMIC_DISPATCH(CameraRaysImpl)(w, px, py, camera);
}
void AimDiffuse(Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(AimDiffuseImpl)(w);
}
void Bend(Wavefront& w, bool bumped) noexcept
{
  HWY_DYNAMIC_DISPATCH(BendImpl)(w, bumped);
}
void RayKeys(const Wavefront& w, std::uint32_t which, std::uint32_t* keys) noexcept
{
  HWY_DYNAMIC_DISPATCH(RayKeysImpl)(w, which, keys);
}
void Close(Wavefront& w, int rows) noexcept
{
  HWY_DYNAMIC_DISPATCH(CloseImpl)(w, rows);
}
}
}
#endif
