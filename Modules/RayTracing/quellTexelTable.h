// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTexelTable_h
#define quellTexelTable_h

#include "quellScene.h"
#include "quellTable.h"
#include "vtkQuellRayTracingModule.h"

#include <cstdint>

namespace quell
{
/// The textures of a material that are read at one place, side by side: what three textures keep in six or more cache
/// lines is in one or two. Base colour, roughness and metalness, normal; eight bytes a texel in tiles of 4 x 2, or
/// colour alone, four bytes in tiles of 4 x 4. Reading gives the bits that the textures themselves give.
class VTKQUELLRAYTRACING_EXPORT TexelTable
{
public:
  /// Base colour, metallic-roughness, normal; null: not used. False: this table cannot stand for them.
  static bool CanHold(const Texture* color, const Texture* metal, const Texture* normal) noexcept;
  static std::size_t BytesOf(const Texture& texture, bool colorAlone) noexcept;

  TexelTable(const Texture* color, const Texture* metal, const Texture* normal);
  std::size_t Bytes() const noexcept { return this->Texels.size(); }

  /// Bytes of the table where the four texels of a look-up begin, and their weights.
  struct Footprint
  {
    std::size_t At[4];
    float Weight[4];
  };
  /// As Texture::Place.
  Footprint Place(float u, float v) const noexcept;
  void Prefetch(const Footprint& place) const noexcept
  {
    for (const std::size_t at : place.At)
      __builtin_prefetch(this->Texels.data() + at);
  }
  /// Colour (3), roughness, metalness, normal (3) in [0, 1]; the last four are left alone where it is colour alone.
  void Read(const Footprint& place, float (&out)[8]) const noexcept;

private:
  Table<std::uint8_t> Texels;
  float Decoded[256]; ///< of the colour's bytes
  int Width = 0, Height = 0, Tiles = 0;
  bool Nearest = false, ColorAlone = false;
  Wrap WrapS = Wrap::Repeat, WrapT = Wrap::Repeat;
};
}

#endif
