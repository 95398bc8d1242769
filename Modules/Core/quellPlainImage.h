// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPlainImage_h
#define quellPlainImage_h

#include "vtkQuellCoreModule.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

/// Targa and BMP, decoded here: OpenImageIO 2.4's readers of them end the process on damaged files, and scenes have
/// such textures.
namespace quell
{
/// Eight bits a channel, the top row first. Alpha is not multiplied into the colours.
struct PlainImage
{
  int Width = 0, Height = 0;
  int Channels = 0; ///< 1: grey; 2: grey, alpha; 3: RGB; 4: RGBA
  std::vector<std::uint8_t> Pixels;
};

/// "bmp" or "targa", or empty. A Targa has no mark at its beginning: it is told by the footer of its second version,
/// or by `name` (.tga, .targa, .vda, .icb, .vst, in any case).
VTKQUELLCORE_EXPORT std::string SniffPlainImage(const std::uint8_t* bytes, std::size_t size, const std::string& name);

/// Decodes a whole file. Nothing is read outside of `bytes`, and nothing allocated that the file cannot fill:
/// `take(bytes)` is called with the size of the pixels first and may throw. False: `reason` says what is wrong and what
/// to do.
///
/// Targa: colour map (types 1 and 9), colour (2, 10) and grey (3, 11), raw or in runs, which may cross rows; 15, 16, 24
/// and 32 bits, in pixels as in colour maps, indices of 8 or 16 bits; all four origins. There is alpha where the
/// descriptor counts bits of it and the second version's extension does not say that they mean nothing; colours that
/// it calls premultiplied are divided by it.
/// BMP: headers of 12, 40, 52, 56, 64, 108 and 124 bytes, bottom-up and top-down; 1, 4 and 8 bits with a palette, 16,
/// 24 and 32 bits, with masks (BITFIELDS) or without; alpha where a mask says so. Runs (RLE) and embedded JPEG or PNG
/// are refused.
/// An index outside of the map or palette is an error.
VTKQUELLCORE_EXPORT bool DecodePlainImage(const std::string& format, const std::uint8_t* bytes, std::size_t size,
  const std::function<void(std::uint64_t)>& take, PlainImage& image, std::string& reason);
}

#endif
