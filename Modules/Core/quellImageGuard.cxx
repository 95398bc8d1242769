// SPDX-License-Identifier: BSD-3-Clause
#include "quellImageGuard.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <istream>

namespace quell
{
const char* const ImageFormatRemedy = "convert it to OpenEXR (also read: HDR, PNG, JPEG, PNM)";

namespace
{
const char* const Damaged = "the file is damaged: write it again";

std::uint32_t BigEndian(const std::string& b, std::size_t at, int bytes)
{
  std::uint32_t v = 0;
  for (int i = 0; i < bytes; ++i)
    v = v << 8 | static_cast<unsigned char>(b[at + std::size_t(i)]);
  return v;
}

std::uint32_t LittleEndian(const std::string& b, std::size_t at, int bytes)
{
  std::uint32_t v = 0;
  for (int i = bytes; i-- > 0;)
    v = v << 8 | static_cast<unsigned char>(b[at + std::size_t(i)]);
  return v;
}

ImageFault CheckSize(std::int64_t width, std::int64_t height, std::int64_t fileBytes)
{
  if (width > MaximumImagePixels || height > MaximumImagePixels || width * height > MaximumImagePixels)
    return { "its header declares more than " + std::to_string(MaximumImagePixels) + " pixels", Damaged };
  if (width * height > std::max(FreeImageBytes, fileBytes * MaximumPackingRatio) / 2)
    return { "its header declares " + std::to_string(width) + " x " + std::to_string(height) +
               " pixels but the file holds " + std::to_string(fileBytes) + " bytes",
      Damaged };
  return {};
}

/// A string that ends with 0; false beyond `longest`.
bool ReadName(std::istream& in, std::string& name, std::size_t longest)
{
  name.clear();
  for (int c = in.get(); c != std::istream::traits_type::eof(); c = in.get())
  {
    if (c == 0)
      return true;
    if (name.size() == longest)
      return false;
    name += char(c);
  }
  return false;
}

/// Headers of all parts: attributes (name, type, size, value) up to an empty name. The library allocates a table with a
/// place for every block while it opens the file, whatever the size of the file.
ImageFault CheckExr(std::istream& in, std::int64_t fileBytes)
{
  const ImageFault broken{ "its OpenEXR header is broken", Damaged };
  std::string head(8, '\0');
  if (!in.read(&head[0], 8))
    return { "it ends inside its header", Damaged };
  const bool parts = (static_cast<unsigned char>(head[5]) & 0x10) != 0;
  std::int64_t blocks = 0;
  for (int part = 0; part < 10000; ++part)
  {
    std::int64_t data[4] = { 0, 0, 0, 0 }, tile[2] = { 0, 0 };
    int attributes = 0, compression = -1, levels = 0;
    bool window = false, tiled = false;
    for (std::string name, type; attributes < 100000; ++attributes)
    {
      if (!ReadName(in, name, 255))
        return broken;
      if (name.empty())
        break;
      std::string size(4, '\0');
      if (!ReadName(in, type, 255) || !in.read(&size[0], 4))
        return broken;
      const std::int64_t bytes = LittleEndian(size, 0, 4);
      if (bytes > fileBytes)
        return broken;
      const bool box = type == "box2i" && bytes == 16,
                 known = box || (name == "tiles" && bytes == 9) || (name == "compression" && bytes == 1);
      if (!known)
      {
        if (!in.ignore(bytes) || in.gcount() != bytes)
          return broken;
        continue;
      }
      std::string value(std::size_t(bytes), '\0');
      if (!in.read(&value[0], bytes))
        return broken;
      if (box && (name == "dataWindow" || name == "displayWindow"))
      {
        std::int64_t corner[4];
        for (std::size_t c = 0; c < 4; ++c)
          corner[c] = std::int32_t(LittleEndian(value, 4 * c, 4));
        const std::int64_t width = corner[2] - corner[0] + 1, height = corner[3] - corner[1] + 1;
        if (width < 1 || height < 1)
          return { "its header declares no pixels", Damaged };
        if (width > MaximumImagePixels || height > MaximumImagePixels || width * height > MaximumImagePixels)
          return { "its header declares " + std::to_string(width) + " x " + std::to_string(height) +
                     " pixels, more than " + std::to_string(MaximumImagePixels),
            "the file is damaged, or must be scaled down or cut first" };
        if (name == "dataWindow")
        {
          window = true;
          std::copy(corner, corner + 4, data);
        }
      }
      else if (name == "compression")
        compression = static_cast<unsigned char>(value[0]);
      else if (name == "tiles")
      {
        tiled = true;
        tile[0] = LittleEndian(value, 0, 4);
        tile[1] = LittleEndian(value, 4, 4);
        levels = static_cast<unsigned char>(value[8]) & 15;
      }
    }
    if (attributes == 0 && part > 0)
      break; // behind the last part
    if (!window)
      return { "its header declares no pixels", Damaged };
    const std::int64_t width = data[2] - data[0] + 1, height = data[3] - data[1] + 1;
    if (tiled && (tile[0] < 1 || tile[1] < 1))
      return broken;
    // None, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB.
    static const int rows[] = { 1, 1, 1, 16, 32, 16, 32, 32, 32, 256 };
    const auto count = [](std::int64_t n, std::int64_t each) { return (n + each - 1) / each; };
    blocks += tiled ? count(width, tile[0]) * count(height, tile[1])
                    : count(height, compression >= 0 && compression < 10 ? rows[compression] : 1);
    if (tiled && levels > 0) // smaller copies: a row of tiles at least for each
      blocks += count(width, tile[0]) + count(height, tile[1]);
    // A place in the table and the head of a block take 8 bytes each.
    if (blocks > fileBytes / 16)
      return { "its header declares " + std::to_string(blocks) + " blocks of pixels but the file holds " +
                 std::to_string(fileBytes) + " bytes",
        "it was cut off or is damaged: write it again" };
    if (!parts)
      break;
  }
  return {};
}

/// The signature, then the chunk IHDR: length, name, width, height.
ImageFault CheckPng(std::istream& in, std::int64_t fileBytes)
{
  std::string head(24, '\0');
  if (!in.read(&head[0], 24) || head.compare(12, 4, "IHDR") != 0)
    return { "its PNG header is broken", Damaged };
  return CheckSize(BigEndian(head, 16, 4), BigEndian(head, 20, 4), fileBytes);
}

/// The first chunk is the picture or, of the extended format, its canvas.
ImageFault CheckWebp(std::istream& in, std::int64_t fileBytes)
{
  std::string head(30, '\0');
  if (!in.read(&head[0], 30))
    return { "it ends inside its header", Damaged };
  const std::string kind = head.substr(12, 4);
  if (kind == "VP8X")
    return CheckSize(LittleEndian(head, 24, 3) + 1, LittleEndian(head, 27, 3) + 1, fileBytes);
  if (kind == "VP8L")
  {
    const std::uint32_t bits = LittleEndian(head, 21, 4);
    return CheckSize((bits & 16383) + 1, (bits >> 14 & 16383) + 1, fileBytes);
  }
  if (kind == "VP8 ")
    return CheckSize(LittleEndian(head, 26, 2) & 16383, LittleEndian(head, 28, 2) & 16383, fileBytes);
  return { "its WebP header is broken", Damaged };
}

/// Walks the segments before the first scan: the plug-in overruns a damaged colour profile and, where a file is
/// progressive, allocates the declared size while it is being opened.
ImageFault CheckJpeg(std::istream& in, std::int64_t fileBytes)
{
  in.seekg(2);
  std::string profile;
  for (int segments = 0; segments < 100000; ++segments)
  {
    int marker = in.get();
    if (marker != 0xff)
      return { "its JPEG segments are broken", Damaged };
    while (marker == 0xff)
      marker = in.get();
    if (marker == 0xda || marker == 0xd9)
      break;
    if (marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8))
      continue;
    std::string head(2, '\0');
    if (!in.read(&head[0], 2) || BigEndian(head, 0, 2) < 2)
      return { "its JPEG segments are broken", Damaged };
    std::string body(BigEndian(head, 0, 2) - 2, '\0');
    if (!body.empty() && !in.read(&body[0], std::streamsize(body.size())))
      return { "it ends inside its header", Damaged };
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame && body.size() < 6)
      return { "its JPEG segments are broken", Damaged };
    if (frame)
      if (const ImageFault fault = CheckSize(BigEndian(body, 3, 2), BigEndian(body, 1, 2), fileBytes))
        return fault;
    if (marker == 0xe2 && body.size() > 14 && body.compare(0, 12, "ICC_PROFILE", 12) == 0)
      profile += body.substr(14);
  }
  if (profile.empty())
    return {};
  bool good = profile.size() >= 132 && BigEndian(profile, 0, 4) == profile.size();
  const std::uint64_t tags = good ? BigEndian(profile, 128, 4) : 0;
  good = good && 132 + 12 * tags <= profile.size();
  for (std::uint64_t t = 0; good && t < tags; ++t)
  {
    const std::uint64_t offset = BigEndian(profile, 136 + 12 * t, 4), size = BigEndian(profile, 140 + 12 * t, 4);
    good = size >= 12 && offset >= 132 && offset + size <= profile.size();
    // Localised texts have a table of their own inside.
    if (good && profile.compare(offset, 4, "mluc") == 0)
    {
      good = size >= 16;
      const std::uint64_t records = good ? BigEndian(profile, offset + 8, 4) : 0;
      good = good && 16 + 12 * records <= size;
      for (std::uint64_t r = 0; good && r < records; ++r)
      {
        const std::uint64_t at = offset + 16 + 12 * r;
        good = std::uint64_t(BigEndian(profile, at + 8, 4)) + BigEndian(profile, at + 4, 4) <= size;
      }
    }
    if (good && profile.compare(offset, 4, "desc") == 0)
      good = std::uint64_t(BigEndian(profile, offset + 8, 4)) + 12 <= size;
  }
  if (!good)
    return { "its ICC colour profile is damaged", "save it again without the profile" };
  return {};
}
}

std::string SniffImage(const void* bytes, std::size_t size)
{
  const std::string head(static_cast<const char*>(bytes), std::min<std::size_t>(size, 16));
  const auto starts = [&](const char* s, std::size_t length) { return head.compare(0, length, s, length) == 0; };
  if (starts("\x76\x2f\x31\x01", 4))
    return "openexr";
  if (starts("\x89PNG", 4))
    return "png";
  if (starts("\xff\xd8\xff", 3))
    return "jpeg";
  if (starts("#?", 2))
    return "hdr";
  if (starts("RIFF", 4) && head.size() >= 12 && head.compare(8, 4, "WEBP") == 0)
    return "webp";
  if (head.size() > 2 && head[0] == 'P' && (std::strchr("123456", head[1]) || head[1] == 'F' || head[1] == 'f') &&
      std::isspace(static_cast<unsigned char>(head[2])))
    return "pnm";
  return std::string();
}

std::string OneLine(const std::string& text, std::size_t longest)
{
  std::string line;
  for (char c : text)
  {
    const bool space = static_cast<unsigned char>(c) <= 0x20 || c == 0x7f;
    if (!space || (!line.empty() && line.back() != ' '))
      line += space ? ' ' : c;
  }
  while (!line.empty() && (line.back() == ' ' || line.back() == '.'))
    line.pop_back();
  if (line.size() > longest)
    line = line.substr(0, longest - 3) + "...";
  return line.empty() ? "the file is damaged" : line;
}

ImageFault CheckImageHead(std::istream& file, const std::string& format, std::int64_t fileBytes)
{
  return format == "jpeg"      ? CheckJpeg(file, fileBytes)
         : format == "png"     ? CheckPng(file, fileBytes)
         : format == "webp"    ? CheckWebp(file, fileBytes)
         : format == "openexr" ? CheckExr(file, fileBytes)
                               : ImageFault();
}
}
