// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellDisplayMapping_h
#define quellDisplayMapping_h

#include "quellImageView.h"
#include "quellStageDescription.h"
#include "vtkQuellViewModule.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

class vtkImageData;

namespace quell
{
/// How an array becomes a picture.
enum class DisplayStyle
{
  Automatic, ///< by the kind of the array
  View,      ///< through OpenColorIO
  Heat,      ///< luminance (or the only channel) in a colour map
  LogHeat,   ///< the same on a logarithmic scale
  Gray,
  Red,
  Green,
  Blue,
  Direction, ///< (v + 1) / 2
  Flow,      ///< hue is direction, strength is length
  Labels,    ///< a colour for each integer
  Error,     ///< [0, 1] in the colours of FLIP maps
  Signed     ///< blue below 0, red above
};
VTKQUELLVIEW_EXPORT const std::vector<std::pair<DisplayStyle, const char*>>& DisplayStyleNames();

struct DisplaySettings
{
  std::string View; ///< of the shipped configuration; empty: its default
  double Exposure = 0;
  DisplayStyle Style = DisplayStyle::Automatic;
  bool AutoRange = true;
  double Low = 0, High = 1; ///< without AutoRange
  bool FlagNonFinite = true;

  bool operator==(const DisplaySettings& o) const;
  bool operator!=(const DisplaySettings& o) const { return !(*this == o); }
};

/// A picture for the screen, row 0 at the TOP, 4 bytes a pixel.
struct DisplayImage
{
  int Width = 0, Height = 0;
  std::vector<std::uint8_t> Rgba;
  DisplayStyle Style = DisplayStyle::View; ///< never Automatic
  double Low = 0, High = 1;                ///< range in use, of the styles that have one
  bool Logarithmic = false;
  std::int64_t NonFinite = 0; ///< pixels with a component that is not finite, where that is no value of the array
  int FirstX = 0, FirstY = 0; ///< of the first of them, from the bottom left
  std::string Error;          ///< why there is no picture
};

/// The style that Automatic stands for.
VTKQUELLVIEW_EXPORT DisplayStyle StyleOf(ArrayKind kind, int components);
/// Whether infinity is a value of such arrays (depth where nothing was hit).
VTKQUELLVIEW_EXPORT bool InfinityIsValue(ArrayKind kind, const std::string& array);

/// The kind of an array by its name, else by its number of components.
VTKQUELLVIEW_EXPORT ArrayKind KindOf(const std::string& array, int components);

/// One place in [0, 1] of a style's colour map, as RGB in [0, 255]; for legends.
VTKQUELLVIEW_EXPORT void MapColor(DisplayStyle style, double t, std::uint8_t rgb[3]);

/// Makes pictures of arrays. Not to be used by two threads at once.
class VTKQUELLVIEW_EXPORT DisplayMapper
{
public:
  DisplayMapper();
  ~DisplayMapper();
  DisplayMapper(const DisplayMapper&) = delete;
  void operator=(const DisplayMapper&) = delete;

  DisplayImage Map(vtkImageData* image, const std::string& array, ArrayKind kind, const DisplaySettings& settings);
  /// Views of the shipped configuration's default display.
  static std::vector<std::string> Views();

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};

/// The float array as a view in frame coordinates; absent when it is missing or of another type. `image` owns it.
VTKQUELLVIEW_EXPORT ImageIn ArrayView(vtkImageData* image, const std::string& array);
}

#endif
