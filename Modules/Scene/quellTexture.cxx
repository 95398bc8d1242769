// SPDX-License-Identifier: BSD-3-Clause
#include "quellScene.h"

#include <array>
#include <cmath>
#include <cstring>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

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
#ifndef __SSE2__
struct LinearBytes
{
  const std::uint8_t* Data;
  void operator()(std::size_t at, float (&out)[4]) const noexcept
  {
    for (int c = 0; c < 4; ++c)
      out[c] = float(this->Data[at + std::size_t(c)]) * (1.f / 255.f);
  }
};
struct SRGBBytes
{
  const std::uint8_t* Data;
  const float* Table;
  void operator()(std::size_t at, float (&out)[4]) const noexcept
  {
    const std::uint8_t* p = this->Data + at;
    for (int c = 0; c < 3; ++c)
      out[c] = this->Table[p[c]];
    out[3] = float(p[3]) * (1.f / 255.f);
  }
};
#endif
struct AnyFloats
{
  const float* Data;
  bool SRGB;
  void operator()(std::size_t at, float (&out)[4]) const noexcept
  {
    const float* p = this->Data + at;
    for (int c = 0; c < 3; ++c)
      out[c] = this->SRGB ? LinearFromSRGB(p[c]) : p[c];
    out[3] = p[3];
  }
};

/// Colours are decoded before they are mixed.
template <class Texels>
Vec4f Mix(const Texture& t, const Texture::Footprint& place, const Texels& texels) noexcept
{
  float a[4], b[4], c[4], d[4];
  texels(place.At[0], a);
  if (t.Nearest)
    return { a[0], a[1], a[2], a[3] };
  texels(place.At[1], b);
  texels(place.At[2], c);
  texels(place.At[3], d);
  const float wa = place.Weight[0], wb = place.Weight[1], wc = place.Weight[2], wd = place.Weight[3];
  for (int k = 0; k < 4; ++k)
    a[k] = wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k];
  return { a[0], a[1], a[2], a[3] };
}

#ifdef __SSE2__
// Four channels at once; the same operations as below.
__m128 Channels(const std::uint8_t* p) noexcept
{
  int raw;
  std::memcpy(&raw, p, sizeof raw);
  const __m128i zero = _mm_setzero_si128();
  const __m128i bytes = _mm_unpacklo_epi16(_mm_unpacklo_epi8(_mm_cvtsi32_si128(raw), zero), zero);
  return _mm_mul_ps(_mm_cvtepi32_ps(bytes), _mm_set1_ps(1.f / 255.f));
}
__m128 Channels(const std::uint8_t* p, const float* table) noexcept
{
  return _mm_setr_ps(table[p[0]], table[p[1]], table[p[2]], float(p[3]) * (1.f / 255.f));
}
template <class... Table>
Vec4f MixBytes(const Texture& t, const Texture::Footprint& place, const Table*... table) noexcept
{
  const std::uint8_t* data = t.Bytes.data();
  __m128 sum = Channels(data + place.At[0], table...);
  if (!t.Nearest)
  {
    sum = _mm_mul_ps(_mm_set1_ps(place.Weight[0]), sum);
    for (int k = 1; k < 4; ++k)
      sum = _mm_add_ps(sum, _mm_mul_ps(_mm_set1_ps(place.Weight[k]), Channels(data + place.At[k], table...)));
  }
  Vec4f out;
  _mm_storeu_ps(&out.x, sum);
  return out;
}
#else
Vec4f MixBytes(const Texture& t, const Texture::Footprint& place) noexcept
{
  return Mix(t, place, LinearBytes{ t.Bytes.data() });
}
Vec4f MixBytes(const Texture& t, const Texture::Footprint& place, const float* table) noexcept
{
  return Mix(t, place, SRGBBytes{ t.Bytes.data(), table });
}
#endif
}

Texture::Footprint Texture::Place(float u, float v) const noexcept
{
  const double x = (std::isfinite(u) ? Reduce(u, this->WrapS) : 0.) * this->Width;
  const double y = (std::isfinite(v) ? Reduce(v, this->WrapT) : 0.) * this->Height;
  const auto at = [this](int column, int row)
  { return (std::size_t(row) * std::size_t(this->Width) + std::size_t(column)) * 4; };
  if (this->Nearest)
  {
    const std::size_t only =
      at(WrapTexel(int(x), this->Width, this->WrapS), WrapTexel(int(y), this->Height, this->WrapT));
    return { { only, only, only, only }, { 1, 0, 0, 0 } };
  }
  // Texel centres lie at half-integers; x, y are not negative: the truncation after the shift by 1 rounds down.
  const int xi = int(x + 0.5) - 1, yi = int(y + 0.5) - 1;
  const float fx = float(x - 0.5 - xi), fy = float(y - 0.5 - yi);
  const int x0 = WrapTexel(xi, this->Width, this->WrapS), x1 = WrapTexel(xi + 1, this->Width, this->WrapS);
  const int y0 = WrapTexel(yi, this->Height, this->WrapT), y1 = WrapTexel(yi + 1, this->Height, this->WrapT);
  return { { at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1) },
    { (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy } };
}

Vec4f Texture::Read(const Footprint& place) const noexcept
{
  if (!this->Floats.empty())
    return Mix(*this, place, AnyFloats{ this->Floats.data(), this->SRGB });
  if (!this->SRGB)
    return MixBytes(*this, place);
  static const float* const table = SRGBTable().data();
  return MixBytes(*this, place, table);
}

Vec4f Texture::Sample(float u, float v) const noexcept
{
  return this->IsUsable() ? this->Read(this->Place(u, v)) : Vec4f();
}

void Texture::Prefetch(const Footprint& place) const noexcept
{
  const char* base = this->Floats.empty() ? reinterpret_cast<const char*>(this->Bytes.data())
                                          : reinterpret_cast<const char*>(this->Floats.data());
  const std::size_t size = this->Floats.empty() ? 1 : sizeof(float);
  __builtin_prefetch(base + place.At[0] * size);
  __builtin_prefetch(base + place.At[3] * size);
}
}
