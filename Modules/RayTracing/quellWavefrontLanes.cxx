// SPDX-License-Identifier: BSD-3-Clause
// The arithmetic of wavefronts. Loops are written so that the compiler turns them into vectors, once per instruction
// set; sums and products stand in the order of the scalar code that they mirror.
#include "quellWavefront.h"

#include "quellSinCos.h"

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

/// LightSampler::DrawLocal on triangles whose data lie in Corner (V0, E1, E2), S... (see DrawTriangles).
void DrawTrianglesImpl(Wavefront& w)
{
  const unsigned n = Rows(w);
  for (unsigned i = 0; i < n; ++i)
  {
    const float u = w.Random[2 * PairLightPoint][i], v = w.Random[2 * PairLightPoint + 1][i];
    const float half0 = u / 2, half1 = v / 2;
    const float b0 = u < v ? half0 : u - half1, b1 = u < v ? v - half0 : half1;
    const float yx = w.Corner[0][i] + w.Corner[3][i] * b0 + w.Corner[6][i] * b1;
    const float yy = w.Corner[1][i] + w.Corner[4][i] * b0 + w.Corner[7][i] * b1;
    const float yz = w.Corner[2][i] + w.Corner[5][i] * b0 + w.Corner[8][i] * b1;
    const float dx = yx - w.Px[i], dy = yy - w.Py[i], dz = yz - w.Pz[i];
    const float d2 = Dot3(dx, dy, dz, dx, dy, dz);
    const float inverse = 1 / std::sqrt(d2);
    const float wx = dx * inverse, wy = dy * inverse, wz = dz * inverse;
    // Jx... hold the light's normal, Far its offset, Kx whether both sides shine
    float cosine = -Dot3(w.Jx[i], w.Jy[i], w.Jz[i], wx, wy, wz);
    const bool behind = cosine < 0;
    const float side = behind ? -1.f : 1.f;
    const float offset = side * w.Far[i];
    cosine = behind ? -cosine : cosine;
    const float pdf = w.LightPdf[i] * d2 / cosine;
    const std::uint32_t good = std::uint32_t(d2 > 0) & std::uint32_t(d2 < std::numeric_limits<float>::infinity()) &
                               (std::uint32_t(!behind) | std::uint32_t(w.Kx[i] > 0)) & std::uint32_t(cosine > 1e-6f) &
                               std::uint32_t(pdf > 0) & std::uint32_t(pdf < std::numeric_limits<float>::infinity());
    w.Wx[i] = wx;
    w.Wy[i] = wy;
    w.Wz[i] = wz;
    w.Lx[i] = yx + w.Jx[i] * offset;
    w.Ly[i] = yy + w.Jy[i] * offset;
    w.Lz[i] = yz + w.Jz[i] * offset;
    w.LightPdf[i] = pdf;
    w.LightFlags[i] &= 0u - good;
  }
}

void LightDiffuseImpl(Wavefront& w, bool mis)
{
  const unsigned n = Rows(w);
  const Wavefront::State& live = w.Live;
  const std::uint32_t weighed = mis ? Wavefront::LightHittable : 0u;
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
    w.Kx[i] = ox;
    w.Ky[i] = oy;
    w.Kz[i] = oz;
    w.Jx[i] = w.Lx[i] - ox;
    w.Jy[i] = w.Ly[i] - oy;
    w.Jz[i] = w.Lz[i] - oz;
    const float pdf = w.LightPdf[i], r = (ci / Pi) / pdf;
    const float one = 1 / pdf;
    // both weights: a choice here would be a branch to the compiler
    w.Cr[i] = vr * w.Er[i];
    w.Cg[i] = vg * w.Eg[i];
    w.Cb[i] = vb * w.Eb[i];
    w.Br[i] = one;
    w.Bg[i] = one * (1 / (1 + r * r));
    w.Lit[i] = flags & (0u - lit); // 0 where no sample was drawn
  }
  for (unsigned i = 0; i < n; ++i)
  {
    const std::uint32_t flags = w.LightFlags[i];
    const bool infinite = (flags & Wavefront::LightAtInfinity) != 0;
    const float one = w.Br[i], power = w.Bg[i], jx = w.Jx[i], jy = w.Jy[i], jz = w.Jz[i], wx = w.Wx[i], wy = w.Wy[i],
                wz = w.Wz[i];
    const float weight = (flags & weighed) != 0 ? power : one;
    w.Cr[i] *= weight;
    w.Cg[i] *= weight;
    w.Cb[i] *= weight;
    w.Jx[i] = infinite ? wx : jx;
    w.Jy[i] = infinite ? wy : jy;
    w.Jz[i] = infinite ? wz : jz;
    w.Far[i] = infinite ? std::numeric_limits<float>::infinity() : 0.9999f;
  }
}

void ScatterDiffuseImpl(Wavefront& w, bool roulette)
{
  const unsigned n = Rows(w);
  Wavefront::State& live = w.Live;
  const float least = roulette ? 1.f : -1.f; // throughput below which paths may end
  for (unsigned i = 0; i < n; ++i)
  {
    const float a = 2 * w.Random[2 * PairBsdf][i] - 1, b = 2 * w.Random[2 * PairBsdf + 1][i] - 1;
    const bool wide = std::fabs(a) > std::fabs(b);
    const float radius = wide ? a : b, other = wide ? b : a;
    const float ratio = radius == 0 ? 0.f : other / radius;
    float s, c;
    SinCosEighth(Pi / 4 * ratio, s, c);
    const float x = radius * (wide ? c : s), y = radius * (wide ? s : c);
    const float z = std::sqrt(Larger(1 - x * x - y * y, 0.f));
    const float nx = w.Sx[i], ny = w.Sy[i], nz = w.Sz[i];
    const float sign = std::copysign(1.f, nz), f = -1 / (sign + nz), g = nx * ny * f;
    const float wx = (1 + sign * nx * nx * f) * x + g * y + nx * z;
    const float wy = (sign * g) * x + (sign + ny * ny * f) * y + ny * z;
    const float wz = (-sign * nx) * x + (-ny) * y + nz * z;
    const float co = Dot3(nx, ny, nz, -live.Dx[i], -live.Dy[i], -live.Dz[i]);
    const float gi = Dot3(w.Gx[i], w.Gy[i], w.Gz[i], wx, wy, wz);
    const float pdf = z / Pi;
    float tr = live.Tr[i] * w.Ar[i], tg = live.Tg[i] * w.Ag[i], tb = live.Tb[i] * w.Ab[i];
    const float q = Largest(tr, tg, tb);
    const float p = Smaller(Larger(q, 0.05f), 0.99f);
    const bool gamble = q < least;
    const float scale = gamble ? 1 / p : 1.f;
    const std::uint32_t goes = std::uint32_t(z > 0) & std::uint32_t(gi > 0) & std::uint32_t(co > 0) &
                               std::uint32_t(pdf > 0) & std::uint32_t(q > 0) &
                               (std::uint32_t(!gamble) | std::uint32_t(w.Random[2 * PairLightPick + 1][i] < p));
    w.Alive[i] &= 0u - goes;
    live.Tr[i] = tr * scale;
    live.Tg[i] = tg * scale;
    live.Tb[i] = tb * scale;
    live.Pdf[i] = pdf;
    live.Dx[i] = wx;
    live.Dy[i] = wy;
    live.Dz[i] = wz;
  }
  for (unsigned i = 0; i < n; ++i)
  {
    live.Fx[i] = w.Px[i];
    live.Fy[i] = w.Py[i];
    live.Fz[i] = w.Pz[i];
    live.Nx[i] = w.Sx[i];
    live.Ny[i] = w.Sy[i];
    live.Nz[i] = w.Sz[i];
    live.Ox[i] = w.Px[i] + w.Gx[i] * w.Offset[i];
    live.Oy[i] = w.Py[i] + w.Gy[i] * w.Offset[i];
    live.Oz[i] = w.Pz[i] + w.Gz[i] * w.Offset[i];
    live.Flags[i] = (live.Flags[i] + 1) & ~(Wavefront::DeltaBit | Wavefront::BothSidesBit | Wavefront::GuidesBit);
  }
}

void BendImpl(Wavefront& w)
{
  const unsigned n = Rows(w);
  constexpr double most = std::numeric_limits<double>::max();
  constexpr float least = 0.01f, mostFloat = std::numeric_limits<float>::max();
  const Wavefront::State& live = w.Live;
  const Wavefront::OpaqueColumns& o = w.Opaque;
  Wavefront::Column<float>&x = w.Kx, &y = w.Ky, &z = w.Kz; // not in use yet
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
    const double sx = double(w.Sx[i]), sy = double(w.Sy[i]), sz = double(w.Sz[i]);
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
    const std::uint32_t good = std::uint32_t(!flat) & std::uint32_t(l > 0) & std::uint32_t(l <= most) &
                               std::uint32_t(m > 0) & std::uint32_t(m <= most) &
                               std::uint32_t(std::fabs(lx) <= mostFloat) & std::uint32_t(std::fabs(ly) <= mostFloat) &
                               std::uint32_t(std::fabs(lz) <= mostFloat);
    x[i] = good ? gx : w.Sx[i];
    y[i] = good ? gy : w.Sy[i];
    z[i] = good ? gz : w.Sz[i];
  }
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
    const bool gone = low & !(Dot3(ax, ay, az, gx, gy, gz) > 0);
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
    const bool same = (nx == gx) & (ny == gy) & (nz == gz);
    const float rx = lift ? ex : bx, ry = lift ? ey : by, rz = lift ? ez : bz;
    const bool plain = same | gone;
    const bool bumped = (w.Material[i] & WavefrontAccess::Bumped) != 0;
    const float vx = plain ? gx : rx, vy = plain ? gy : ry, vz = plain ? gz : rz;
    w.Sx[i] = bumped ? vx : w.Sx[i];
    w.Sy[i] = bumped ? vy : w.Sy[i];
    w.Sz[i] = bumped ? vz : w.Sz[i];
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
HWY_EXPORT(DrawTrianglesImpl);
HWY_EXPORT(LightDiffuseImpl);
HWY_EXPORT(ScatterDiffuseImpl);
HWY_EXPORT(BendImpl);
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
void DrawTriangles(Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(DrawTrianglesImpl)(w);
}
void LightDiffuse(Wavefront& w, bool mis) noexcept
{
  HWY_DYNAMIC_DISPATCH(LightDiffuseImpl)(w, mis);
}
void ScatterDiffuse(Wavefront& w, bool roulette) noexcept
{
  HWY_DYNAMIC_DISPATCH(ScatterDiffuseImpl)(w, roulette);
}
void Bend(Wavefront& w) noexcept
{
  HWY_DYNAMIC_DISPATCH(BendImpl)(w);
}
void Close(Wavefront& w, int rows) noexcept
{
  HWY_DYNAMIC_DISPATCH(CloseImpl)(w, rows);
}
}
}
#endif
