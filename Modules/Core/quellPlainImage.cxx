// SPDX-License-Identifier: BSD-3-Clause
#include "quellPlainImage.h"

#include "quellImageGuard.h"

#include <algorithm>
#include <cctype>
#include <cstring>

namespace quell
{
namespace
{
const char* const Damaged = "; the file is damaged: write it again";

/// Bytes of a file; reading beyond them gives 0 and is remembered.
class Reader
{
public:
  Reader(const std::uint8_t* bytes, std::size_t size)
    : Bytes(bytes)
    , Size(size)
  {
  }
  std::size_t Left() const { return this->Size - this->At; }
  std::size_t Position() const { return this->At; }
  bool Ended() const { return this->Beyond; }
  void Seek(std::size_t at)
  {
    this->Beyond = this->Beyond || at > this->Size;
    this->At = std::min(at, this->Size);
  }
  void Skip(std::size_t count)
  {
    this->Beyond = this->Beyond || count > this->Left();
    this->At += std::min(count, this->Left());
  }
  std::uint32_t Take(int count)
  {
    std::uint32_t value = 0;
    for (int i = 0; i < count; ++i)
    {
      this->Beyond = this->Beyond || this->At == this->Size;
      value |= this->At < this->Size ? std::uint32_t(this->Bytes[this->At++]) << (8 * i) : 0u;
    }
    return value;
  }

private:
  const std::uint8_t* Bytes;
  std::size_t Size, At = 0;
  bool Beyond = false;
};

struct Rgba
{
  std::uint8_t R = 0, G = 0, B = 0, A = 255;
};

/// Five bits as eight: 31 becomes 255.
std::uint8_t Five(std::uint32_t v)
{
  v &= 31;
  return std::uint8_t(v << 3 | v >> 2);
}

bool CheckSize(std::int64_t width, std::int64_t height, std::string& reason)
{
  if (width <= 0 || height <= 0)
    return reason = std::string("its header declares no pixels") + Damaged, false;
  if (width > MaximumImagePixels || height > MaximumImagePixels || width * height > MaximumImagePixels)
    return reason = "its header declares " + std::to_string(width) + " x " + std::to_string(height) +
                    " pixels, more than " + std::to_string(MaximumImagePixels) + Damaged,
           false;
  return true;
}

bool TooShort(std::int64_t width, std::int64_t height, std::size_t size, std::string& reason)
{
  reason = "its header declares " + std::to_string(width) + " x " + std::to_string(height) +
           " pixels but the file holds " + std::to_string(size) + " bytes" + Damaged;
  return false;
}

void Store(const Rgba& p, int channels, std::uint8_t* out)
{
  out[0] = p.R;
  if (channels >= 3)
  {
    out[1] = p.G;
    out[2] = p.B;
  }
  if (channels == 2 || channels == 4)
    out[channels - 1] = p.A;
}

/// A Targa of the second version has an extension area, whose last byte says what its alpha means.
enum class TargaAlpha
{
  AsDeclared,
  None,
  Premultiplied
};
TargaAlpha AlphaOfExtension(const std::uint8_t* bytes, std::size_t size)
{
  if (size < 26 + 18 || std::memcmp(bytes + size - 18, "TRUEVISION-XFILE.", 18) != 0)
    return TargaAlpha::AsDeclared;
  Reader footer(bytes, size);
  footer.Seek(size - 26);
  const std::size_t extension = footer.Take(4);
  footer.Seek(extension);
  if (extension == 0 || footer.Left() < 495 || footer.Take(2) < 495)
    return TargaAlpha::AsDeclared;
  const std::uint8_t type = bytes[extension + 494];
  return type == 4 ? TargaAlpha::Premultiplied : type == 3 ? TargaAlpha::AsDeclared : TargaAlpha::None;
}

std::uint8_t Divided(std::uint8_t color, std::uint8_t alpha)
{
  return alpha == 0 ? color : std::uint8_t(std::min(255, (color * 255 + alpha / 2) / alpha));
}

bool DecodeTarga(const std::uint8_t* bytes, std::size_t size, const std::function<void(std::uint64_t)>& take,
  PlainImage& image, std::string& reason)
{
  Reader in(bytes, size);
  const std::size_t comment = in.Take(1);
  const std::uint32_t mapped = in.Take(1), type = in.Take(1);
  const std::uint32_t mapFirst = in.Take(2), mapLength = in.Take(2), mapBits = in.Take(1);
  in.Skip(4);
  const std::int64_t width = in.Take(2), height = in.Take(2);
  const std::uint32_t bits = in.Take(1), descriptor = in.Take(1);
  if (in.Ended())
    return reason = std::string("it ends inside its header") + Damaged, false;
  const bool runs = type >= 9;
  const std::uint32_t kind = runs ? type - 8 : type; // 1: colour map, 2: colour, 3: grey
  if (kind < 1 || kind > 3 || type > 11 || mapped > 1 || (descriptor & 0xc0) != 0)
    return reason = "this is no Targa image (type " + std::to_string(type) + ", colour map " + std::to_string(mapped) +
                    "); convert it to PNG",
           false;
  const auto colorBits = [](std::uint32_t b) { return b == 15 || b == 16 || b == 24 || b == 32; };
  if ((kind == 1 && (mapped != 1 || (bits != 8 && bits != 16) || !colorBits(mapBits) || mapLength == 0)) ||
      (kind == 2 && !colorBits(bits)) || (kind == 3 && bits != 8 && bits != 16))
    return reason = "it is a Targa of type " + std::to_string(type) + " with " + std::to_string(bits) +
                    " bits a pixel and a colour map of " + std::to_string(mapBits) + "; convert it to PNG",
           false;
  if (!CheckSize(width, height, reason))
    return false;

  in.Skip(comment);
  const auto color = [&in](std::uint32_t colorSize)
  {
    Rgba p;
    if (colorSize <= 16)
    {
      const std::uint32_t v = in.Take(2);
      p.R = Five(v >> 10), p.G = Five(v >> 5), p.B = Five(v);
      p.A = v & 0x8000 ? 255 : 0;
      return p;
    }
    p.B = std::uint8_t(in.Take(1)), p.G = std::uint8_t(in.Take(1)), p.R = std::uint8_t(in.Take(1));
    p.A = colorSize == 32 ? std::uint8_t(in.Take(1)) : 255;
    return p;
  };
  std::vector<Rgba> map;
  if (mapped == 1 && !colorBits(mapBits))
    return reason = "its colour map has entries of " + std::to_string(mapBits) + " bits; convert it to PNG", false;
  if (mapped == 1)
  {
    // Colour images may have a map, too; it is skipped.
    const std::size_t entry = (mapBits + 7) / 8;
    if (in.Left() < entry * mapLength)
      return reason = std::string("it ends inside its colour map") + Damaged, false;
    if (kind != 1)
      in.Skip(entry * mapLength);
    for (std::uint32_t i = 0; kind == 1 && i < mapLength; ++i)
      map.push_back(color(mapBits));
  }

  const std::uint32_t colorSize = kind == 1 ? mapBits : bits, declared = descriptor & 15;
  const TargaAlpha meaning = AlphaOfExtension(bytes, size);
  const bool alpha = meaning != TargaAlpha::None &&
                     (kind == 3 ? bits == 16 && declared == 8
                                : (colorSize == 32 && declared == 8) || (colorSize == 16 && declared == 1));
  const std::size_t pixelBytes = (bits + 7) / 8;
  const std::uint64_t pixels = std::uint64_t(width) * std::uint64_t(height);
  // A packet of at most 128 pixels has a byte for their number and one pixel at least.
  const std::uint64_t least = runs ? (pixels + 127) / 128 * (1 + pixelBytes) : pixels * pixelBytes;
  if (in.Left() < least)
    return TooShort(width, height, size, reason);

  image.Width = int(width);
  image.Height = int(height);
  image.Channels = (kind == 3 ? 1 : 3) + (alpha ? 1 : 0);
  take(pixels * std::uint64_t(image.Channels));
  image.Pixels.resize(std::size_t(pixels) * std::size_t(image.Channels));
  const bool rightToLeft = descriptor & 0x10, topDown = descriptor & 0x20;
  bool outside = false;
  const auto pixel = [&]
  {
    Rgba p;
    if (kind == 1)
    {
      const std::uint32_t index = in.Take(int(pixelBytes));
      if (index >= mapFirst && index - mapFirst < map.size())
        p = map[index - mapFirst];
      else
        outside = true;
    }
    else if (kind == 3)
    {
      p.R = std::uint8_t(in.Take(1));
      p.A = pixelBytes == 2 ? std::uint8_t(in.Take(1)) : 255;
    }
    else
      p = color(bits);
    if (alpha && meaning == TargaAlpha::Premultiplied)
      p.R = Divided(p.R, p.A), p.G = Divided(p.G, p.A), p.B = Divided(p.B, p.A);
    return p;
  };
  int left = 0;
  bool repeated = false;
  Rgba p;
  for (std::int64_t row = 0; row < height; ++row)
  {
    std::uint8_t* const out =
      image.Pixels.data() + std::size_t((topDown ? row : height - 1 - row) * width) * std::size_t(image.Channels);
    for (std::int64_t i = 0; i < width; ++i)
    {
      if (runs && left == 0)
      {
        const std::uint32_t packet = in.Take(1);
        left = int(packet & 127) + 1;
        repeated = (packet & 128) != 0;
        p = pixel();
      }
      else if (!runs || !repeated)
        p = pixel();
      left -= runs;
      Store(p, image.Channels, out + std::size_t(rightToLeft ? width - 1 - i : i) * std::size_t(image.Channels));
    }
    if (in.Ended())
      return reason = std::string("it ends inside its pixels") + Damaged, false;
    if (outside)
      return reason = std::string("a pixel has a colour outside of its colour map") + Damaged, false;
  }
  return true;
}

/// A channel of a pixel as a mask cuts it out.
struct Mask
{
  std::uint32_t Bits = 0;
  int Shift = 0, Width = 0;

  /// False unless the ones are side by side.
  bool Set(std::uint32_t bits)
  {
    this->Bits = bits;
    this->Shift = 0;
    for (; bits && !(bits & 1); bits >>= 1)
      ++this->Shift;
    for (this->Width = 0; this->Width < 32 && (bits >> this->Width) != 0; ++this->Width)
      ;
    return (bits & (bits + 1)) == 0;
  }
  std::uint8_t Of(std::uint32_t pixel) const
  {
    if (this->Width == 0)
      return 0;
    // Eight bits by repeating those there are: the largest value becomes 255.
    const std::uint32_t v = (pixel & this->Bits) >> this->Shift;
    std::uint32_t eight = 0;
    for (int at = 8 - this->Width; at > -this->Width; at -= this->Width)
      eight |= at >= 0 ? v << at : v >> -at;
    return std::uint8_t(eight);
  }
};

bool DecodeBmp(const std::uint8_t* bytes, std::size_t size, const std::function<void(std::uint64_t)>& take,
  PlainImage& image, std::string& reason)
{
  Reader in(bytes, size);
  in.Skip(10);
  const std::size_t offset = in.Take(4), header = in.Take(4);
  const bool core = header == 12, known = core || header == 40 || header == 52 || header == 56 || header == 64 ||
                                          header == 108 || header == 124;
  if (!in.Ended() && !known)
    return reason =
             "its header of " + std::to_string(header) + " bytes is of no BMP that Quell knows; convert it to PNG",
           false;
  const std::int64_t width = core ? in.Take(2) : std::int64_t(std::int32_t(in.Take(4)));
  const std::int64_t rows = core ? in.Take(2) : std::int64_t(std::int32_t(in.Take(4)));
  const std::int64_t height = rows < 0 ? -rows : rows;
  in.Skip(2); // planes
  const std::uint32_t bits = in.Take(2);
  std::uint32_t compression = 0, used = 0;
  Mask r, g, b, a;
  bool contiguous = true;
  if (!core)
  {
    compression = in.Take(4);
    in.Skip(12);
    used = in.Take(4);
    in.Skip(4);
    // The header's own masks from its second version on; behind the first version's where it says so. OS/2 has none.
    const bool masks = header != 64 && (compression == 3 || compression == 6);
    if (masks)
    {
      contiguous = r.Set(in.Take(4));
      contiguous = g.Set(in.Take(4)) && contiguous;
      contiguous = b.Set(in.Take(4)) && contiguous;
      if (compression == 6 || header >= 56)
        contiguous = a.Set(in.Take(4)) && contiguous;
    }
  }
  const std::size_t paletteAt = std::max<std::size_t>(14 + header, in.Position());
  if (in.Ended())
    return reason = std::string("it ends inside its header") + Damaged, false;
  const bool masked = compression == 3 || compression == 6, indexed = bits == 1 || bits == 4 || bits == 8;
  if (compression == 1 || compression == 2 || compression == 4 || compression == 5)
    return reason = "it is a BMP packed in runs, or with a JPEG or PNG inside; convert it to PNG", false;
  if (compression > 6 || (header == 64 && masked) || (!indexed && bits != 16 && bits != 24 && bits != 32) ||
      (masked && bits != 16 && bits != 32))
    return reason = "it is a BMP of " + std::to_string(bits) + " bits a pixel with compression " +
                    std::to_string(compression) + "; convert it to PNG",
           false;
  const std::uint32_t overlap =
    (r.Bits & g.Bits) | (r.Bits & b.Bits) | (g.Bits & b.Bits) | (a.Bits & (r.Bits | g.Bits | b.Bits));
  if (masked && (!contiguous || overlap || (bits == 16 && (r.Bits | g.Bits | b.Bits | a.Bits) > 0xffff) ||
                  (r.Bits | g.Bits | b.Bits) == 0))
    return reason = std::string("its colour masks make no sense") + Damaged, false;
  if (!masked && bits == 16)
    r.Set(0x7c00), g.Set(0x3e0), b.Set(0x1f);
  if (!masked && bits == 32)
    r.Set(0xff0000), g.Set(0xff00), b.Set(0xff);
  if (!CheckSize(width, height, reason))
    return false;

  std::vector<Rgba> palette;
  if (indexed)
  {
    const std::size_t most = std::size_t(1) << bits, count = used == 0 ? most : used;
    if (count > most)
      return reason = "its palette has " + std::to_string(count) + " colours" + Damaged, false;
    in.Seek(paletteAt);
    for (std::size_t i = 0; i < count; ++i)
    {
      Rgba p;
      p.B = std::uint8_t(in.Take(1)), p.G = std::uint8_t(in.Take(1)), p.R = std::uint8_t(in.Take(1));
      in.Skip(core ? 0 : 1);
      palette.push_back(p);
    }
    if (in.Ended())
      return reason = std::string("it ends inside its palette") + Damaged, false;
  }
  if (offset < paletteAt)
    return reason = std::string("its pixels begin inside its header") + Damaged, false;
  in.Seek(offset);
  const std::uint64_t rowBytes = (std::uint64_t(width) * bits + 7) / 8, stride = (rowBytes + 3) / 4 * 4;
  // The padding of the last row may be missing.
  if (in.Ended() || in.Left() < stride * std::uint64_t(height - 1) + rowBytes)
    return TooShort(width, height, size, reason);

  image.Width = int(width);
  image.Height = int(height);
  image.Channels = a.Bits ? 4 : 3;
  const std::uint64_t pixels = std::uint64_t(width) * std::uint64_t(height);
  take(pixels * std::uint64_t(image.Channels));
  image.Pixels.resize(std::size_t(pixels) * std::size_t(image.Channels));
  for (std::int64_t row = 0; row < height; ++row)
  {
    std::uint8_t* out =
      image.Pixels.data() + std::size_t((rows < 0 ? row : height - 1 - row) * width) * std::size_t(image.Channels);
    in.Seek(offset + std::size_t(stride) * std::size_t(row));
    std::uint32_t byte = 0;
    for (std::int64_t i = 0; i < width; ++i, out += image.Channels)
    {
      Rgba p;
      if (indexed)
      {
        const int perByte = int(8 / bits), k = int(i % perByte);
        if (k == 0)
          byte = in.Take(1);
        const std::uint32_t index = byte >> (8 - int(bits) * (k + 1)) & ((1u << bits) - 1);
        if (index >= palette.size())
          return reason = std::string("a pixel has a colour outside of its palette") + Damaged, false;
        p = palette[index];
      }
      else if (bits == 24)
        p.B = std::uint8_t(in.Take(1)), p.G = std::uint8_t(in.Take(1)), p.R = std::uint8_t(in.Take(1));
      else
      {
        const std::uint32_t v = in.Take(int(bits / 8));
        p.R = r.Of(v), p.G = g.Of(v), p.B = b.Of(v), p.A = a.Bits ? a.Of(v) : 255;
      }
      Store(p, image.Channels, out);
    }
  }
  return true;
}
}

std::string SniffPlainImage(const std::uint8_t* bytes, std::size_t size, const std::string& name)
{
  if (size >= 26 && bytes[0] == 'B' && bytes[1] == 'M' && bytes[15] == 0 && bytes[16] == 0 && bytes[17] == 0)
    return "bmp";
  if (size >= 18 + 26 && std::memcmp(bytes + size - 18, "TRUEVISION-XFILE.", 18) == 0)
    return "targa";
  std::string extension = name.substr(std::min(name.size(), name.find_last_of('.')));
  std::transform(
    extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  for (const char* known : { ".tga", ".targa", ".vda", ".icb", ".vst" })
    if (extension == known)
      return "targa";
  return std::string();
}

bool DecodePlainImage(const std::string& format, const std::uint8_t* bytes, std::size_t size,
  const std::function<void(std::uint64_t)>& take, PlainImage& image, std::string& reason)
{
  return format == "bmp" ? DecodeBmp(bytes, size, take, image, reason) : DecodeTarga(bytes, size, take, image, reason);
}
}
