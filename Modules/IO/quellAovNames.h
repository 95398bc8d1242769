// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellAovNames_h
#define quellAovNames_h

#include "quellStageDescription.h"
#include "vtkQuellIOModule.h"

#include <map>
#include <string>
#include <vector>

/// Which channels of a file are which array. The tables are explained in Documentation/aov.md.
namespace quell
{
/// Who wrote a file decides what its layer names mean.
enum class ChannelDialect
{
  Quell,   ///< the exact inverse of what the writer does
  Blender, ///< Cycles and Eevee passes, `<view layer>.<pass>.<channel>`
  Pbrt,    ///< pbrt-v4's gbuffer film
  Other    ///< Arnold, Mitsuba, OIDN's tools and everybody else
};

/// What happens to values between a foreign file and our conventions.
enum class ChannelConversion
{
  None,
  FlipY,         ///< the second component changes its sign with the direction of rows
  FarIsInfinite, ///< values of 1e10 and more stand for "nothing was hit"
  ZeroIsInfinite ///< zero stands for "nothing was hit"
};

/// One flat part of a file: its name and the full names of its channels.
struct FilePart
{
  std::string Name;
  std::vector<std::string> Channels;
};

/// An array and the channels it is read from, one per component (a grey channel may serve three).
struct NamedChannels
{
  std::string Array;
  ArrayKind Kind = ArrayKind::Any;
  int Part = 0;
  std::vector<int> Channels;
  ChannelConversion Conversion = ChannelConversion::None;
};

/// The EXR layer of an array; empty for `radiance`, whose channels are plain R G B. Unknown arrays keep their name.
VTKQUELLIO_EXPORT std::string StandardLayer(const std::string& array);

/// Full channel names of a layer: `R G B`, `albedo.R albedo.G albedo.B`, `N.X N.Y N.Z`, `Z`. One component: the layer's
/// name itself. 1 to 4 components.
VTKQUELLIO_EXPORT std::vector<std::string> ChannelNames(const std::string& layer, ArrayKind kind, int components);

/// Names every channel of a file. `plain` is the array that unnamed R G B channels make, `kinds` the recorded kind per
/// layer of a file by Quell. Array names are unique; channels that stand for two things (a `Combined` pass is the
/// radiance) appear twice.
VTKQUELLIO_EXPORT std::vector<NamedChannels> NameArrays(const std::vector<FilePart>& parts, ChannelDialect dialect,
  const std::string& plain = "radiance", const std::map<std::string, ArrayKind>& kinds = {});
}

#endif
