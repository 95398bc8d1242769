// SPDX-License-Identifier: BSD-3-Clause
#include "quellScene.h"

#include <array>
#include <cmath>

namespace quell
{
namespace
{
/// IEC 61966-2-1.
float LinearFromSRGB(float v) noexcept
{
  return v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
}

const std::array<float, 256>& SRGBTable()
{
  static const std::array<float, 256> table = []
  {
    std::array<float, 256> t{};
    for (int i = 0; i < 256; ++i)
      t[std::size_t(i)] = LinearFromSRGB(float(i) / 255.f);
    return t;
  }();
  return table;
}

/// Brings a finite coordinate near [0, 1], so that the texel arithmetic below stays in the range of int.
double Reduce(double t, Wrap wrap) noexcept
{
  switch (wrap)
  {
    case Wrap::Repeat:
      return t - std::floor(t);
    case Wrap::Mirror:
      return t - 2 * std::floor(t / 2);
    default:
      return t < 0 ? 0 : t > 1 ? 1 : t;
  }
}

int WrapTexel(int i, int n, Wrap wrap) noexcept
{
  switch (wrap)
  {
    case Wrap::Repeat:
      i %= n;
      return i < 0 ? i + n : i;
    case Wrap::Mirror:
    {
      const int period = 2 * n;
      i %= period;
      i = i < 0 ? i + period : i;
      return i < n ? i : period - 1 - i;
    }
    default:
      return i < 0 ? 0 : i >= n ? n - 1 : i;
  }
}

Vec4f Texel(const Texture& t, int x, int y) noexcept
{
  const std::size_t at = (std::size_t(y) * std::size_t(t.Width) + std::size_t(x)) * 4;
  if (!t.Floats.empty())
  {
    const float* p = t.Floats.data() + at;
    return t.SRGB ? Vec4f{ LinearFromSRGB(p[0]), LinearFromSRGB(p[1]), LinearFromSRGB(p[2]), p[3] }
                  : Vec4f{ p[0], p[1], p[2], p[3] };
  }
  const std::uint8_t* p = t.Bytes.data() + at;
  constexpr float s = 1.f / 255.f;
  if (!t.SRGB)
    return { p[0] * s, p[1] * s, p[2] * s, p[3] * s };
  static const std::array<float, 256>& table = SRGBTable();
  return { table[p[0]], table[p[1]], table[p[2]], p[3] * s };
}
}

Vec4f Texture::Sample(float u, float v) const noexcept
{
  if (this->Width < 1 || this->Height < 1 || (this->Bytes.empty() && this->Floats.empty()))
    return {};
  const double x = (std::isfinite(u) ? Reduce(u, this->WrapS) : 0.) * this->Width;
  const double y = (std::isfinite(v) ? Reduce(v, this->WrapT) : 0.) * this->Height;
  if (this->Nearest)
    return Texel(*this, WrapTexel(int(std::floor(x)), this->Width, this->WrapS),
      WrapTexel(int(std::floor(y)), this->Height, this->WrapT));
  // Texel centres lie at half-integers.
  const double xf = std::floor(x - 0.5), yf = std::floor(y - 0.5);
  const float fx = float(x - 0.5 - xf), fy = float(y - 0.5 - yf);
  const int x0 = WrapTexel(int(xf), this->Width, this->WrapS), x1 = WrapTexel(int(xf) + 1, this->Width, this->WrapS);
  const int y0 = WrapTexel(int(yf), this->Height, this->WrapT), y1 = WrapTexel(int(yf) + 1, this->Height, this->WrapT);
  const Vec4f a = Texel(*this, x0, y0), b = Texel(*this, x1, y0), c = Texel(*this, x0, y1), d = Texel(*this, x1, y1);
  const float wa = (1 - fx) * (1 - fy), wb = fx * (1 - fy), wc = (1 - fx) * fy, wd = fx * fy;
  return { wa * a.x + wb * b.x + wc * c.x + wd * d.x, wa * a.y + wb * b.y + wc * c.y + wd * d.y,
    wa * a.z + wb * b.z + wc * c.z + wd * d.z, wa * a.w + wb * b.w + wc * c.w + wd * d.w };
}
}
