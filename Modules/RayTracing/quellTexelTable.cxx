// SPDX-License-Identifier: BSD-3-Clause
#include "quellTexelTable.h"

#include "vtkSMPTools.h"

#include <cmath>
#include <cstring>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace quell
{
namespace
{
/// The coordinate in texels, from 0 to `size` (2 `size` where mirrored), wrapped as Texture::Place does.
double Texels(float t, int size, Wrap wrap) noexcept
{
  // floor, without a call for what fits into an integer
  const auto whole = [](double x)
  {
    if (!(std::fabs(x) < 2e9))
      return std::floor(x);
    const double i = double(int(x));
    return i > x ? i - 1 : i;
  };
  const double x = std::isfinite(t) ? double(t) : 0.;
  switch (wrap)
  {
    case Wrap::Repeat:
      return (x - whole(x)) * size;
    case Wrap::Mirror:
      return (x - 2 * whole(x / 2)) * size;
    default:
      return (x < 0 ? 0 : x > 1 ? 1 : x) * size;
  }
}

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
}

bool TexelTable::CanHold(const Texture* color, const Texture* metal, const Texture* normal) noexcept
{
  const Texture* first = color ? color : metal ? metal : normal;
  if (!first)
    return false;
  for (const Texture* t : { color, metal, normal })
    if (t && (!t->IsUsable() || !t->Floats.empty() || !t->SharesPlaces(*first)))
      return false;
  return !(metal && metal->SRGB) && !(normal && normal->SRGB);
}

std::size_t TexelTable::BytesOf(const Texture& t, bool colorAlone) noexcept
{
  const std::size_t rows = colorAlone ? 4 : 2;
  return (std::size_t(t.Width) + 3) / 4 * ((std::size_t(t.Height) + rows - 1) / rows) * 64;
}

TexelTable::TexelTable(const Texture* color, const Texture* metal, const Texture* normal)
{
  const Texture& first = color ? *color : metal ? *metal : *normal;
  this->Width = first.Width;
  this->Height = first.Height;
  this->Nearest = first.Nearest;
  this->WrapS = first.WrapS;
  this->WrapT = first.WrapT;
  this->ColorAlone = !metal && !normal;
  this->Tiles = (this->Width + 3) / 4;
  Texture all; // decodes every byte as the textures do
  all.Width = 256;
  all.Height = 1;
  all.SRGB = color && color->SRGB;
  for (int i = 0; i < 256; ++i)
    all.Bytes.insert(all.Bytes.end(), 4, std::uint8_t(i));
  for (std::size_t i = 0; i < 256; ++i)
    this->Decoded[i] = all.Read({ { 4 * i, 4 * i, 4 * i, 4 * i }, { 1, 0, 0, 0 } }).x;
  this->Texels.assign(BytesOf(first, this->ColorAlone), 255);
  const int rows = this->ColorAlone ? 4 : 2;
  const auto fill = [&](vtkIdType from, vtkIdType to)
  {
    for (int y = int(from); y < int(to); ++y)
      for (int x = 0; x < this->Width; ++x)
      {
        const std::size_t source = 4 * (std::size_t(y) * std::size_t(this->Width) + std::size_t(x));
        const std::size_t tile = std::size_t(y / rows) * std::size_t(this->Tiles) + std::size_t(x / 4);
        const std::size_t texel = std::size_t(4 * (y % rows) + x % 4);
        std::uint8_t* p = &this->Texels[64 * tile + texel * (this->ColorAlone ? 4u : 8u)];
        if (color)
          std::memcpy(p, &color->Bytes[source], 3);
        if (metal)
          std::memcpy(p + 3, &metal->Bytes[source + 1], 2);
        if (normal)
          std::memcpy(p + 5, &normal->Bytes[source], 3);
      }
  };
  if (this->Texels.size() > (1u << 20))
    vtkSMPTools::For(0, this->Height, 64, fill);
  else
    fill(0, this->Height);
}

TexelTable::Footprint TexelTable::Place(float u, float v) const noexcept
{
  const double x = quell::Texels(u, this->Width, this->WrapS), y = quell::Texels(v, this->Height, this->WrapT);
  const int down = this->ColorAlone ? 2 : 1, size = this->ColorAlone ? 2 : 3;
  const auto column = [size](int i) { return std::size_t(i >> 2) * 64 + std::size_t((i & 3) << size); };
  const auto row = [this, down, size](int i) {
    return std::size_t(i >> down) * std::size_t(this->Tiles) * 64 + (std::size_t(i & ((1 << down) - 1)) << (2 + size));
  };
  if (this->Nearest)
  {
    const std::size_t only =
      column(WrapTexel(int(x), this->Width, this->WrapS)) + row(WrapTexel(int(y), this->Height, this->WrapT));
    return { { only, only, only, only }, { 1, 0, 0, 0 } };
  }
  // Texel centres lie at half-integers; x, y are not negative: the truncation after the shift by 1 rounds down.
  const int xi = int(x + 0.5) - 1, yi = int(y + 0.5) - 1;
  const float fx = float(x - 0.5 - xi), fy = float(y - 0.5 - yi);
  const std::size_t x0 = column(WrapTexel(xi, this->Width, this->WrapS)),
                    x1 = column(WrapTexel(xi + 1, this->Width, this->WrapS));
  const std::size_t y0 = row(WrapTexel(yi, this->Height, this->WrapT)),
                    y1 = row(WrapTexel(yi + 1, this->Height, this->WrapT));
  return { { x0 + y0, x1 + y0, x0 + y1, x1 + y1 }, { (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy } };
}

void TexelTable::Read(const Footprint& place, float (&out)[8]) const noexcept
{
  const std::uint8_t* const texels = this->Texels.data();
  constexpr float unit = 1.f / 255.f;
#ifdef __SSE2__
  const auto color = [&](const std::uint8_t* p, float rough)
  { return _mm_setr_ps(this->Decoded[p[0]], this->Decoded[p[1]], this->Decoded[p[2]], rough); };
  const auto others = [](const std::uint8_t* p)
  {
    std::int32_t raw;
    std::memcpy(&raw, p + 4, sizeof raw);
    const __m128i zero = _mm_setzero_si128();
    const __m128i bytes = _mm_unpacklo_epi16(_mm_unpacklo_epi8(_mm_cvtsi32_si128(raw), zero), zero);
    return _mm_mul_ps(_mm_cvtepi32_ps(bytes), _mm_set1_ps(unit));
  };
  const int count = this->Nearest ? 1 : 4;
  __m128 a = _mm_setzero_ps(), b = a;
  for (int k = 0; k < count; ++k)
  {
    const std::uint8_t* p = texels + place.At[k];
    const __m128 weight = _mm_set1_ps(place.Weight[k]), c = _mm_mul_ps(weight, color(p, float(p[3]) * unit));
    a = k == 0 ? c : _mm_add_ps(a, c);
    if (this->ColorAlone)
      continue;
    const __m128 o = _mm_mul_ps(weight, others(p));
    b = k == 0 ? o : _mm_add_ps(b, o);
  }
  _mm_storeu_ps(out, a);
  if (!this->ColorAlone)
    _mm_storeu_ps(out + 4, b);
#else
  const int channels = this->ColorAlone ? 4 : 8;
  for (int c = 0; c < channels; ++c)
  {
    const auto value = [&](int k)
    {
      const std::uint8_t byte = texels[place.At[k] + std::size_t(c)];
      return c < 3 ? this->Decoded[byte] : float(byte) * unit;
    };
    out[c] = place.Weight[0] * value(0);
    for (int k = 1; k < 4 && !this->Nearest; ++k)
      out[c] += place.Weight[k] * value(k);
  }
#endif
}
}
