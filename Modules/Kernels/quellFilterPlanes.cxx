// SPDX-License-Identifier: BSD-3-Clause
#include "quellFilterPlanes.h"

#include "quellGuards.h"

#include <limits>

namespace quell
{
namespace
{
constexpr float Inf = std::numeric_limits<float>::infinity();
constexpr float LargestVariance = 1e38f; // Sum w^2 v stays below FLT_MAX

/// Fills the padding of row y, and the pad rows beside the first and last row.
void Pad(const PlaneLayout& layout, float* plane, int y, float value) noexcept
{
  if (!plane)
    return;
  const Rect& e = layout.extent;
  float* row = plane + layout.at(e.x0, y) - layout.pad;
  std::fill(row, row + layout.pad, value);
  std::fill(row + layout.pad + e.width(), row + layout.stride, value);
  if (y == e.y0)
    std::fill(row - layout.stride, row, value);
  if (y == e.y1 - 1)
    std::fill(row + layout.stride, row + 2 * layout.stride, value);
}

float CleanVariance(float v) noexcept
{
  return v > 0 ? (v < LargestVariance ? v : LargestVariance) : 0.f;
}

float ReadVariance(const ImageIn& image, int x, int y) noexcept
{
  const float v = *image.at(x, y);
  if (v == v)
    return CleanVariance(v);
  float mean = 0;
  FillFromNeighbours<1>(image.extent, x, y, &mean,
    [&image](int qx, int qy, float* out)
    {
      const float q = *image.at(qx, qy);
      *out = CleanVariance(q);
      return q == q;
    });
  return mean;
}
}

void CopyGuides(
  const ImageIn& depth, const ImageIn& normal, const ImageIn& id, const GuidePlanes& planes, int y0, int y1) noexcept
{
  const PlaneLayout& layout = planes.layout;
  const Rect& e = layout.extent;
  const int w = e.width();
  for (int y = y0; y < y1; ++y)
  {
    const std::ptrdiff_t row = layout.at(e.x0, y);
    Pad(layout, planes.depth, y, Inf);
    float* z = planes.depth + row;
    if (depth)
    {
      const float* in = depth.at(e.x0, y);
      for (int i = 0; i < w; ++i)
        z[i] = std::fabs(in[i]) < Inf ? in[i] : Inf;
    }
    else
      std::fill(z, z + w, 1.f);
    if (planes.normal[0])
    {
      float *nx = planes.normal[0] + row, *ny = planes.normal[1] + row, *nz = planes.normal[2] + row;
      for (int c = 0; c < 3; ++c)
        Pad(layout, planes.normal[c], y, 0.f);
      const float* in = normal.at(e.x0, y);
      for (int i = 0; i < w; ++i, in += 3)
      {
        // Longer than any normal: not a direction (and its dot product may overflow).
        const bool good = std::fabs(in[0]) < 1e6f && std::fabs(in[1]) < 1e6f && std::fabs(in[2]) < 1e6f;
        nx[i] = good ? in[0] : 0.f;
        ny[i] = good ? in[1] : 0.f;
        nz[i] = good ? in[2] : 0.f;
      }
    }
    if (planes.id)
    {
      Pad(layout, planes.id, y, 0.f);
      const float* in = id.at(e.x0, y);
      std::copy(in, in + w, planes.id + row);
    }
  }
}

void CopySlopes(const GuidePlanes& planes, int y0, int y1) noexcept
{
  const PlaneLayout& layout = planes.layout;
  const Rect& e = layout.extent;
  const auto slope = [&planes](std::ptrdiff_t i, std::ptrdiff_t step) noexcept
  {
    const float* z = planes.depth + i;
    float forward = std::fabs(z[step]) < Inf ? z[step] - z[0] : Inf;
    float backward = std::fabs(z[-step]) < Inf ? z[0] - z[-step] : Inf;
    if (planes.id)
    {
      const float* id = planes.id + i;
      forward = id[step] == id[0] ? forward : Inf;
      backward = id[-step] == id[0] ? backward : Inf;
    }
    const float s = std::fabs(forward) <= std::fabs(backward) ? forward : backward;
    return std::fabs(s) < Inf ? s : 0.f; // also where the pixel itself is background
  };
  for (int y = y0; y < y1; ++y)
  {
    Pad(layout, planes.slopeX, y, 0.f);
    Pad(layout, planes.slopeY, y, 0.f);
    const std::ptrdiff_t row = layout.at(e.x0, y);
    for (int i = 0; i < e.width(); ++i)
    {
      planes.slopeX[row + i] = slope(row + i, 1);
      planes.slopeY[row + i] = slope(row + i, layout.stride);
    }
  }
}

void ClearPadding(const PlaneLayout& layout, const ColorPlanes& planes, int y0, int y1) noexcept
{
  for (int y = y0; y < y1; ++y)
  {
    for (float* plane : planes.color)
      Pad(layout, plane, y, 0.f);
    Pad(layout, planes.luminance, y, Inf);
    Pad(layout, planes.variance, y, -1.f);
  }
}

std::int64_t CopyColor(const ImageIn& color, const ImageIn& variance, const GuidePlanes& guides,
  const ColorPlanes& planes, int y0, int y1, const Rect& counted) noexcept
{
  const PlaneLayout& layout = guides.layout;
  const Rect& e = layout.extent;
  const int w = e.width();
  std::int64_t bad = 0;
  ClearPadding(layout, planes, y0, y1);
  for (int y = y0; y < y1; ++y)
  {
    const std::ptrdiff_t row = layout.at(e.x0, y);
    float *r = planes.color[0] + row, *g = planes.color[1] + row, *b = planes.color[2] + row;
    float* l = planes.luminance + row;
    const float* z = guides.depth + row;
    const float* in = color.at(e.x0, y);
    int badInRow = 0;
    for (int i = 0; i < w; ++i)
    {
      const float cr = in[3 * i], cg = in[3 * i + 1], cb = in[3 * i + 2];
      const bool good = Finite(cr) & Finite(cg) & Finite(cb);
      r[i] = cr, g[i] = cg, b[i] = cb;
      l[i] = good ? FilterLuminance(cr, cg, cb) : Inf;
      badInRow += !good;
    }
    if (planes.variance)
    {
      float* v = planes.variance + row;
      for (int i = 0; i < w; ++i)
        v[i] = l[i] < Inf && z[i] < Inf ? ReadVariance(variance, e.x0 + i, y) : -1.f;
    }
    if (badInRow)
      for (int i = 0; i < w; ++i)
        if (!(l[i] < Inf))
        {
          float c[3];
          ReadFilled(color, e.x0 + i, y, c);
          r[i] = c[0], g[i] = c[1], b[i] = c[2];
          bad += counted.contains(e.x0 + i, y);
        }
  }
  return bad;
}

void StoreFiltered(const GuidePlanes& guides, const ColorPlanes& planes, const ImageIn& inputColor,
  const ImageIn& inputVariance, const ImageOut& color, const ImageOut& variance, const Rect& tile) noexcept
{
  const PlaneLayout& layout = guides.layout;
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    const std::ptrdiff_t row = layout.at(tile.x0, y);
    const float* z = guides.depth + row;
    for (int i = 0; i < tile.width(); ++i)
    {
      const bool hit = z[i] < Inf;
      const int x = tile.x0 + i;
      if (color)
      {
        float* o = color.at(x, y);
        if (hit)
          for (int c = 0; c < 3; ++c)
            o[c] = planes.color[c][row + i];
        else
          ReadFilled(inputColor, x, y, o);
      }
      if (variance)
      {
        float v = 0;
        if (!hit)
          v = inputVariance ? ReadVariance(inputVariance, x, y) : 0.f;
        else if (planes.variance)
          v = planes.variance[row + i] > 0 ? planes.variance[row + i] : 0.f;
        *variance.at(x, y) = v;
      }
    }
  }
}
}
