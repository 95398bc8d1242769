// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellVector_h
#define quellVector_h

#include "quellKernelsModule.h"

#include <cmath>

namespace quell
{
template <class T>
struct Vec2
{
  T x{}, y{};
};

/// Three components; position, direction or linear RGB.
template <class T>
struct Vec3
{
  T x{}, y{}, z{};

  constexpr Vec3() = default;
  constexpr Vec3(T a, T b, T c)
    : x(a)
    , y(b)
    , z(c)
  {
  }
  constexpr explicit Vec3(T a)
    : x(a)
    , y(a)
    , z(a)
  {
  }
  template <class U>
  constexpr explicit Vec3(const Vec3<U>& o)
    : x(T(o.x))
    , y(T(o.y))
    , z(T(o.z))
  {
  }
  T& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
  const T& operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  constexpr Vec3 operator+(const Vec3& o) const { return { x + o.x, y + o.y, z + o.z }; }
  constexpr Vec3 operator-(const Vec3& o) const { return { x - o.x, y - o.y, z - o.z }; }
  constexpr Vec3 operator*(const Vec3& o) const { return { x * o.x, y * o.y, z * o.z }; }
  constexpr Vec3 operator/(const Vec3& o) const { return { x / o.x, y / o.y, z / o.z }; }
  constexpr Vec3 operator*(T s) const { return { x * s, y * s, z * s }; }
  constexpr Vec3 operator/(T s) const { return { x / s, y / s, z / s }; }
  constexpr Vec3 operator-() const { return { -x, -y, -z }; }
  Vec3& operator+=(const Vec3& o) { return *this = *this + o; }
  Vec3& operator-=(const Vec3& o) { return *this = *this - o; }
  Vec3& operator*=(const Vec3& o) { return *this = *this * o; }
  Vec3& operator*=(T s) { return *this = *this * s; }
  Vec3& operator/=(T s) { return *this = *this / s; }
  constexpr bool operator==(const Vec3& o) const { return x == o.x && y == o.y && z == o.z; }
  constexpr bool operator!=(const Vec3& o) const { return !(*this == o); }
};
template <class T>
constexpr Vec3<T> operator*(T s, const Vec3<T>& v)
{
  return v * s;
}
template <class T>
constexpr T Dot(const Vec3<T>& a, const Vec3<T>& b)
{
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
constexpr Vec3<T> Cross(const Vec3<T>& a, const Vec3<T>& b)
{
  return { a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}
template <class T>
T Length(const Vec3<T>& v)
{
  return std::sqrt(Dot(v, v));
}
/// Unit vector, or zero where the length is zero or not finite.
template <class T>
Vec3<T> Normalized(const Vec3<T>& v)
{
  const T l = Length(v);
  return l > T(0) && std::isfinite(l) ? v / l : Vec3<T>();
}
template <class T>
T MaxComponent(const Vec3<T>& v)
{
  return v.x > v.y ? (v.x > v.z ? v.x : v.z) : (v.y > v.z ? v.y : v.z);
}
template <class T>
bool IsFinite(const Vec3<T>& v)
{
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
/// Relative luminance of linear Rec. 709 RGB.
template <class T>
constexpr T Luminance(const Vec3<T>& c)
{
  return T(0.2126) * c.x + T(0.7152) * c.y + T(0.0722) * c.z;
}

using Vec2f = Vec2<float>;
using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;
struct Vec4f
{
  float x = 0, y = 0, z = 0, w = 0;
  Vec3f xyz() const { return { x, y, z }; }
};

/// 4 x 4 matrix, row-major, column vectors (p' = M p), in double.
struct Mat4
{
  double m[4][4] = { { 1, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 }, { 0, 0, 0, 1 } };

  Mat4 operator*(const Mat4& o) const
  {
    Mat4 r;
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
      {
        double s = 0;
        for (int k = 0; k < 4; ++k)
          s += m[i][k] * o.m[k][j];
        r.m[i][j] = s;
      }
    return r;
  }
  Vec3d Point(const Vec3d& p) const
  {
    return { m[0][0] * p.x + m[0][1] * p.y + m[0][2] * p.z + m[0][3],
      m[1][0] * p.x + m[1][1] * p.y + m[1][2] * p.z + m[1][3],
      m[2][0] * p.x + m[2][1] * p.y + m[2][2] * p.z + m[2][3] };
  }
  Vec3d Direction(const Vec3d& d) const
  {
    return { m[0][0] * d.x + m[0][1] * d.y + m[0][2] * d.z, m[1][0] * d.x + m[1][1] * d.y + m[1][2] * d.z,
      m[2][0] * d.x + m[2][1] * d.y + m[2][2] * d.z };
  }
  /// A normal goes with the cofactors of the upper 3 x 3 part: right for non-uniform and mirroring scales.
  Vec3d Normal(const Vec3d& n) const
  {
    const Vec3d a{ m[0][0], m[1][0], m[2][0] }, b{ m[0][1], m[1][1], m[2][1] }, c{ m[0][2], m[1][2], m[2][2] };
    const double s = Dot(a, Cross(b, c)) < 0 ? -1. : 1.;
    return (Cross(b, c) * n.x + Cross(c, a) * n.y + Cross(a, b) * n.z) * s;
  }
  double Determinant3() const
  {
    const Vec3d a{ m[0][0], m[1][0], m[2][0] }, b{ m[0][1], m[1][1], m[2][1] }, c{ m[0][2], m[1][2], m[2][2] };
    return Dot(a, Cross(b, c));
  }
  /// Inverse by Gauss-Jordan with pivoting; false (and `out` untouched) where the matrix is singular.
  QUELLKERNELS_EXPORT bool Inverse(Mat4& out) const;
};
}

#endif
