// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPixelFilter_h
#define quellPixelFilter_h

#include "quellVector.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace quell
{
/// Positions of samples around a pixel's centre whose density is a reconstruction filter, the same along x and y
/// (Ernst, Stamminger and Greiner 2006): every sample belongs to one pixel and has weight 1, so a pixel needs no
/// neighbour and noise stays uncorrelated between pixels. Filters with negative lobes cannot be done this way.
class PixelFilter
{
public:
  enum class Shape
  {
    Box,           ///< 1
    Tent,          ///< 1 - |x| / r
    Gaussian,      ///< exp(-x^2 / (2 s^2)) - exp(-r^2 / (2 s^2)), s = r / 3
    BlackmanHarris ///< .35875 + .48829 cos(pi x / r) + .14128 cos(2 pi x / r) + .01168 cos(3 pi x / r)
  };

  PixelFilter() = default;
  /// `radius` in pixels: half of the filter's width.
  PixelFilter(Shape shape, double radius)
    : Kind(shape)
    , Radius(radius)
  {
    if (shape == Shape::Gaussian || shape == Shape::BlackmanHarris)
    {
      // The inverse of the distribution function by a table of the function itself: its steps are summed in order.
      this->Cumulated.assign(Steps + 1, 0);
      for (int i = 0; i < Steps; ++i)
        this->Cumulated[std::size_t(i) + 1] =
          this->Cumulated[std::size_t(i)] + std::max(0., this->Value(2 * (i + 0.5) / Steps - 1));
      for (double& c : this->Cumulated)
        c /= this->Cumulated.back();
    }
  }

  /// From the pixel's centre, pixels; u in [0, 1)^2.
  Vec2<double> Offset(const Vec2f& u) const noexcept
  {
    return { this->Warp(double(u.x)) * this->Radius, this->Warp(double(u.y)) * this->Radius };
  }

  /// The filter at x radii from the centre, not normalised.
  double Value(double x) const noexcept
  {
    constexpr double pi = 3.14159265358979323846;
    switch (this->Kind)
    {
      case Shape::Tent:
        return 1 - std::fabs(x);
      case Shape::Gaussian:
        return std::exp(-4.5 * x * x) - std::exp(-4.5);
      case Shape::BlackmanHarris:
        return 0.35875 + 0.48829 * std::cos(pi * x) + 0.14128 * std::cos(2 * pi * x) + 0.01168 * std::cos(3 * pi * x);
      default:
        return 1;
    }
  }

private:
  static constexpr int Steps = 512;

  double Warp(double u) const noexcept
  {
    if (this->Kind == Shape::Box)
      return 2 * u - 1;
    if (this->Kind == Shape::Tent)
      return u < 0.5 ? std::sqrt(2 * u) - 1 : 1 - std::sqrt(2 * (1 - u));
    const auto above = std::upper_bound(this->Cumulated.begin(), this->Cumulated.end(), u);
    const int i = std::max(0, std::min(Steps - 1, int(above - this->Cumulated.begin()) - 1));
    const double low = this->Cumulated[std::size_t(i)], high = this->Cumulated[std::size_t(i) + 1];
    return 2 * (i + (high > low ? (u - low) / (high - low) : 0)) / Steps - 1;
  }

  Shape Kind = Shape::Box;
  double Radius = 0.5;
  std::vector<double> Cumulated;
};
}

#endif
