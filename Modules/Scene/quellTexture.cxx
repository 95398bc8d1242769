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

/// Index of the texel that `i` stands for, -1 <= i <= the largest that Reduce leaves (n; 2 n where mirrored).
int WrapTexel(int i, int n, Wrap wrap) noexcept
{
  switch (wrap)
  {
    case Wrap::Repeat:
      return i < 0 ? i + n : i >= n ? i - n : i;
    case Wrap::Mirror:
    {
      const int period = 2 * n;
      i = i < 0 ? i + period : i >= period ? i - period : i;
      return i < n ? i : period - 1 - i;
    }
    default:
      return i < 0 ? 0 : i >= n ? n - 1 : i;
  }
}

// Values of texels by the way they are stored.
struct LinearBytes
{
  const std::uint8_t* Data;
  Vec4f operator()(std::size_t at) const noexcept
  {
    constexpr float s = 1.f / 255.f;
    const std::uint8_t* p = this->Data + at;
    return { p[0] * s, p[1] * s, p[2] * s, p[3] * s };
  }
};
struct SRGBBytes
{
  const std::uint8_t* Data;
  const float* Table;
  Vec4f operator()(std::size_t at) const noexcept
  {
    const std::uint8_t* p = this->Data + at;
    return { this->Table[p[0]], this->Table[p[1]], this->Table[p[2]], p[3] * (1.f / 255.f) };
  }
};
struct AnyFloats
{
  const float* Data;
  bool SRGB;
  Vec4f operator()(std::size_t at) const noexcept
  {
    const float* p = this->Data + at;
    return this->SRGB ? Vec4f{ LinearFromSRGB(p[0]), LinearFromSRGB(p[1]), LinearFromSRGB(p[2]), p[3] }
                      : Vec4f{ p[0], p[1], p[2], p[3] };
  }
};

/// `x`, `y`: in texels, reduced. Colours are decoded before they are mixed.
template <class Texels>
Vec4f Look(const Texture& t, double x, double y, const Texels& texels) noexcept
{
  const auto at = [&t](int column, int row)
  { return (std::size_t(row) * std::size_t(t.Width) + std::size_t(column)) * 4; };
  if (t.Nearest)
    return texels(
      at(WrapTexel(int(std::floor(x)), t.Width, t.WrapS), WrapTexel(int(std::floor(y)), t.Height, t.WrapT)));
  // Texel centres lie at half-integers.
  const double xf = std::floor(x - 0.5), yf = std::floor(y - 0.5);
  const float fx = float(x - 0.5 - xf), fy = float(y - 0.5 - yf);
  const int x0 = WrapTexel(int(xf), t.Width, t.WrapS), x1 = WrapTexel(int(xf) + 1, t.Width, t.WrapS);
  const int y0 = WrapTexel(int(yf), t.Height, t.WrapT), y1 = WrapTexel(int(yf) + 1, t.Height, t.WrapT);
  const Vec4f a = texels(at(x0, y0)), b = texels(at(x1, y0)), c = texels(at(x0, y1)), d = texels(at(x1, y1));
  const float wa = (1 - fx) * (1 - fy), wb = fx * (1 - fy), wc = (1 - fx) * fy, wd = fx * fy;
  return { wa * a.x + wb * b.x + wc * c.x + wd * d.x, wa * a.y + wb * b.y + wc * c.y + wd * d.y,
    wa * a.z + wb * b.z + wc * c.z + wd * d.z, wa * a.w + wb * b.w + wc * c.w + wd * d.w };
}
}

Vec4f Texture::Sample(float u, float v) const noexcept
{
  if (this->Width < 1 || this->Height < 1 || (this->Bytes.empty() && this->Floats.empty()))
    return {};
  const double x = (std::isfinite(u) ? Reduce(u, this->WrapS) : 0.) * this->Width;
  const double y = (std::isfinite(v) ? Reduce(v, this->WrapT) : 0.) * this->Height;
  if (!this->Floats.empty())
    return Look(*this, x, y, AnyFloats{ this->Floats.data(), this->SRGB });
  if (!this->SRGB)
    return Look(*this, x, y, LinearBytes{ this->Bytes.data() });
  static const float* const table = SRGBTable().data();
  return Look(*this, x, y, SRGBBytes{ this->Bytes.data(), table });
}

void Texture::Prefetch(float u, float v) const noexcept
{
  if (this->Bytes.empty() || this->Width < 1 || this->Height < 1 || !std::isfinite(u) || !std::isfinite(v))
    return;
  const double x = Reduce(u, this->WrapS) * this->Width, y = Reduce(v, this->WrapT) * this->Height;
  const int column = WrapTexel(int(x), this->Width, this->WrapS);
  const int row = int(y - 0.5);
  for (int i : { row, row + 1 })
    __builtin_prefetch(
      this->Bytes.data() +
      (std::size_t(WrapTexel(i, this->Height, this->WrapT)) * std::size_t(this->Width) + std::size_t(column)) * 4);
}
}
