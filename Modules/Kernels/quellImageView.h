// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellImageView_h
#define quellImageView_h

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace quell
{
/// A half-open rectangle of pixels, [x0, x1) x [y0, y1), in the coordinates of the whole frame.
/// Row 0 is the bottom row, as in vtkImageData.
struct Rect
{
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  int width() const noexcept { return std::max(0, x1 - x0); }
  int height() const noexcept { return std::max(0, y1 - y0); }
  std::ptrdiff_t area() const noexcept { return std::ptrdiff_t(width()) * height(); }
  bool empty() const noexcept { return x1 <= x0 || y1 <= y0; }
  bool contains(int x, int y) const noexcept { return x >= x0 && x < x1 && y >= y0 && y < y1; }
  bool contains(const Rect& r) const noexcept
  {
    return r.empty() || (r.x0 >= x0 && r.x1 <= x1 && r.y0 >= y0 && r.y1 <= y1);
  }
  Rect grown(int halo) const noexcept { return { x0 - halo, y0 - halo, x1 + halo, y1 + halo }; }
  Rect clipped(const Rect& r) const noexcept
  {
    return { std::max(x0, r.x0), std::max(y0, r.y0), std::min(x1, r.x1), std::min(y1, r.y1) };
  }
  Rect united(const Rect& r) const noexcept
  {
    if (empty())
      return r;
    if (r.empty())
      return *this;
    return { std::min(x0, r.x0), std::min(y0, r.y0), std::max(x1, r.x1), std::max(y1, r.y1) };
  }
  bool operator==(const Rect& r) const noexcept { return x0 == r.x0 && y0 == r.y0 && x1 == r.x1 && y1 == r.y1; }
  bool operator!=(const Rect& r) const noexcept { return !(*this == r); }
};

/// A non-owning view of an interleaved image that covers `extent` of the frame. All coordinates are the
/// frame's: a kernel that is handed a crop addresses the same pixel with the same (x, y).
/// A default-constructed view is "absent" (an optional input that is not connected, an output nobody asked for).
template <class T>
struct ImageView
{
  T* data = nullptr;            ///< pixel (extent.x0, extent.y0)
  int components = 0;           ///< interleaved channels per pixel
  Rect extent;                  ///< the pixels that exist; a tap outside has weight 0
  std::ptrdiff_t rowStride = 0; ///< elements from one row to the next

  ImageView() = default;
  ImageView(T* d, int c, const Rect& e) noexcept
    : data(d)
    , components(c)
    , extent(e)
    , rowStride(std::ptrdiff_t(e.width()) * c)
  {
  }
  ImageView(T* d, int c, const Rect& e, std::ptrdiff_t stride) noexcept
    : data(d)
    , components(c)
    , extent(e)
    , rowStride(stride)
  {
  }
  template <class U, class = std::enable_if_t<std::is_same<const U, T>::value && !std::is_const<U>::value>>
  ImageView(const ImageView<U>& o) noexcept
    : data(o.data)
    , components(o.components)
    , extent(o.extent)
    , rowStride(o.rowStride)
  {
  }

  explicit operator bool() const noexcept { return data != nullptr; }
  bool inside(int x, int y) const noexcept { return extent.contains(x, y); }
  T* at(int x, int y) const noexcept
  {
    return data + (y - extent.y0) * rowStride + std::ptrdiff_t(x - extent.x0) * components;
  }
};

using ImageIn = ImageView<const float>;
using ImageOut = ImageView<float>;
}

#endif
