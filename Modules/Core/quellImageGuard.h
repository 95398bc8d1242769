// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellImageGuard_h
#define quellImageGuard_h

#include "vtkQuellCoreModule.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <string>

/// What stands between image files and the libraries that decode them. OpenImageIO picks its plug-in by extension and
/// then tries all of them; version 2.4's readers of BMP, Targa, TIFF, PSD and more end the process on damaged files,
/// and those of other formats ask for whatever a header declares. So the first bytes decide, among formats that hold,
/// and sizes are checked before a library allocates.
namespace quell
{
/// Frames beyond this are a damaged header, not a picture: 16384 x 16384.
constexpr std::int64_t MaximumImagePixels = std::int64_t(1) << 28;
/// No codec here packs more than this many bytes of pixels into one byte of file; small files may declare a little.
constexpr std::int64_t MaximumPackingRatio = 16384, FreeImageBytes = std::int64_t(64) << 20;

/// Format that the first bytes of a file tell: "openexr", "png", "jpeg", "hdr", "pnm", "webp"; empty: none of these.
/// 16 bytes are enough.
VTKQUELLCORE_EXPORT std::string SniffImage(const void* bytes, std::size_t size);
extern VTKQUELLCORE_EXPORT const char* const ImageFormatRemedy; ///< what to do with a file that is none of them

struct ImageFault
{
  std::string Cause, Remedy; ///< no cause: no fault
  explicit operator bool() const { return !this->Cause.empty(); }
};

/// A library's or a file's words as one line of readable text that is not too long.
VTKQUELLCORE_EXPORT std::string OneLine(const std::string& text, std::size_t longest = 300);

/// Before a library opens the file, `fileBytes` long: sizes in the headers of OpenEXR, PNG, JPEG and WebP; blocks of
/// an OpenEXR; the segments of a JPEG up to its first scan, whose damaged colour profiles the library overruns.
VTKQUELLCORE_EXPORT ImageFault CheckImageHead(std::istream& file, const std::string& format, std::int64_t fileBytes);

/// After a library has opened the file and before it decodes: `spec` is an OIIO::ImageSpec (a template, so that this
/// module needs no OpenImageIO).
template <class Spec>
ImageFault CheckImageSpec(const Spec& spec, std::int64_t fileBytes)
{
  const char* const damaged = "the file is damaged: write it again";
  if (spec.width <= 0 || spec.height <= 0 || spec.full_width <= 0 || spec.full_height <= 0 || spec.nchannels <= 0)
    return { "its header declares no pixels", damaged };
  if (spec.depth > 1 || spec.full_depth > 1)
    return { "it is a volume", "write one image per slice" };
  const std::int64_t pixels = std::int64_t(spec.width) * spec.height;
  const std::int64_t whole = std::int64_t(spec.full_width) * spec.full_height;
  const std::string size = std::to_string(spec.width) + " x " + std::to_string(spec.height) + " pixels in " +
                           std::to_string(spec.nchannels) + " channels";
  if (pixels > MaximumImagePixels || whole > MaximumImagePixels)
    return { "its header declares " + size + " (frame " + std::to_string(spec.full_width) + " x " +
               std::to_string(spec.full_height) + "), more than " + std::to_string(MaximumImagePixels),
      "the file is damaged, or must be scaled down or cut first" };
  if (pixels * spec.nchannels > std::max(FreeImageBytes, fileBytes * MaximumPackingRatio) / 2)
    return { "its header declares " + size + " but the file holds " + std::to_string(fileBytes) + " bytes", damaged };
  if (spec.tile_width > 0 && (spec.tile_width > 16384 || spec.tile_height > 16384))
    return { "its header declares tiles of " + std::to_string(spec.tile_width) + " x " +
               std::to_string(spec.tile_height) + " pixels",
      damaged };
  return {};
}

/// The library unpacks all channels of at least 256 rows at once, however few rows there are: a few bytes of header may
/// claim more than there is memory.
template <class Spec>
ImageFault CheckImageRows(const Spec& spec)
{
  const std::uint64_t unpacked = std::uint64_t(spec.scanline_bytes(true)), limit = std::uint64_t(16) << 20;
  if (spec.tile_width > 0 || unpacked <= limit)
    return {};
  return { "one row of it takes " + std::to_string(unpacked >> 20) + " MiB, more than the limit of " +
             std::to_string(limit >> 20) + " MiB",
    "write it with fewer channels or in tiles" };
}
}

#endif
