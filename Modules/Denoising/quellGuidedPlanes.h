// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGuidedPlanes_h
#define quellGuidedPlanes_h

#include "quellFilterPlanes.h"
#include "quellPixelCount.h"

namespace quell
{
/// The planes in which stages of the SVGF family (ATrousFilter, VarianceEstimate) work: hands them out of one block
/// that is kept between frames, and fills the guides.
class GuidedPlanes
{
public:
  /// Planes that Begin makes room for.
  static constexpr int Most(int planes) { return planes + 7; }
  /// Lays out planes over `read` with taps up to `reach` away, makes room for `planes` of them (guides not counted) and
  /// takes the guides' own; guides whose input is absent are absent.
  void Begin(const Rect& read, int reach, int planes, const ImageIn& depth, const ImageIn& normal, const ImageIn& id)
  {
    this->Depth = depth, this->Normal = normal, this->Id = id;
    this->Guides = GuidePlanes();
    this->Guides.layout = PlaneLayout(read, reach);
    this->Next = this->Memory.Take(this->Guides.layout.size() * std::size_t(Most(planes)));
    for (float** p : { &this->Guides.depth, &this->Guides.slopeX, &this->Guides.slopeY })
      *p = this->Take();
    for (float*& p : this->Guides.normal)
      p = this->Take(bool(normal));
    this->Guides.id = this->Take(bool(id));
  }
  /// One plane; nullptr where it is not used.
  float* Take(bool used = true)
  {
    float* plane = used ? this->Next : nullptr;
    this->Next += used ? this->Guides.layout.size() : 0;
    return plane;
  }
  /// Colour, luminance and, if used, variance: up to 5 planes.
  ColorPlanes TakeColor(bool color, bool luminance, bool variance)
  {
    ColorPlanes planes;
    for (float*& p : planes.color)
      p = this->Take(color);
    planes.luminance = this->Take(luminance);
    planes.variance = this->Take(variance);
    return planes;
  }
  /// Fills the guides, and with `copy(y0, y1)` what else is read of these rows. `rows(rect, body)` runs
  /// body(y0, y1) over strips of rows.
  template <class Rows, class Copy>
  void Fill(Rows&& rows, Copy&& copy)
  {
    const Rect& read = this->Guides.layout.extent;
    rows(read,
      [&](int y0, int y1)
      {
        CopyGuides(this->Depth, this->Normal, this->Id, this->Guides, y0, y1);
        copy(y0, y1);
      });
    // A slope reads the rows beside it.
    rows(read, [&](int y0, int y1) { CopySlopes(this->Guides, y0, y1); });
  }

  GuidePlanes Guides;

private:
  Scratch Memory;
  float* Next = nullptr;
  ImageIn Depth, Normal, Id;
};
}

#endif
