// SPDX-License-Identifier: BSD-3-Clause
#include "quellRedistribute.h"

#include "quellGuards.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
constexpr double NoTerm = 1e30;
constexpr double LargestTerm = 80; // exp of less is 0
constexpr int KeptWeights = 33 * 33;

double Square(double v) noexcept
{
  return v * v;
}

/// Exponent of (delta / sigma)^2 / 2; a sigma of 0 lets only equal values pass.
double Term(double square, double sigma) noexcept
{
  if (square == 0)
    return 0;
  return sigma > 1e-17 ? square / (2 * sigma * sigma) : 1e300;
}

/// What one source gives to pixel (x, y), before the division by the sum of its weights.
class Source
{
public:
  Source(const RedistributeInputs& in, const RedistributeParameters& p, int x, int y) noexcept
    : In(in)
    , P(p)
    , X(x)
    , Y(y)
  {
    const float* r = in.residual.at(x, y);
    const double length = std::sqrt(Square(r[0]) + Square(r[1]) + Square(r[2]));
    const double wide = p.threshold > 0 ? length / p.threshold : 1e300;
    const double sigma = p.sigma * std::sqrt(std::max(1., wide));
    this->Hit = !in.depth || Finite(*in.depth.at(x, y));
    // Narrower, the weight of the next pixel is 0 (Weight), and the window is the pixel itself.
    const bool wider = 0.5 <= LargestTerm * sigma * sigma;
    this->Reach = this->Hit && wider ? int(std::min(double(std::max(0, p.radius)), std::ceil(2.5 * sigma))) : 0;
    this->PerSquare = wider ? 0.5 / (sigma * sigma) : 0;
  }
  int Reach = 0;

  double Weight(int x, int y) const noexcept
  {
    if (x == this->X && y == this->Y)
      return 1;
    double e = this->PerSquare * (Square(x - this->X) + Square(y - this->Y));
    if (this->In.id && *this->In.id.at(x, y) != *this->In.id.at(this->X, this->Y))
      return 0;
    if (this->In.depth)
    {
      const float a = *this->In.depth.at(this->X, this->Y), b = *this->In.depth.at(x, y);
      if (!Finite(b))
        return 0;
      if (this->P.sigmaDepth < NoTerm)
        e += Term(Square(std::log(std::max(1e-30, double(b)) / std::max(1e-30, double(a)))), this->P.sigmaDepth);
    }
    if (this->In.normal && this->P.sigmaNormal < NoTerm)
    {
      const float *a = this->In.normal.at(this->X, this->Y), *b = this->In.normal.at(x, y);
      if (Finite3(a) && Finite3(b))
        e += Term(
          Square(double(a[0]) - b[0]) + Square(double(a[1]) - b[1]) + Square(double(a[2]) - b[2]), this->P.sigmaNormal);
    }
    return e <= LargestTerm ? std::exp(-e) : 0;
  }

private:
  const RedistributeInputs& In;
  const RedistributeParameters& P;
  int X, Y;
  double PerSquare = 0;
  bool Hit = true;
};

float ToFloat(double v) noexcept
{
  return float(std::max(-3.402823466e38, std::min(3.402823466e38, v)));
}
}

std::size_t RedistributeScratch(const Rect& tile) noexcept
{
  return std::size_t(tile.area()) * 3;
}

std::int64_t Redistribute(const RedistributeInputs& in, const RedistributeParameters& parameters, const ImageOut& out,
  const Rect& tile, double* scratch) noexcept
{
  const Rect& frame = in.radiance.extent;
  const int width = tile.width();
  double weights[KeptWeights];
  std::fill(scratch, scratch + RedistributeScratch(tile), 0.);
  // Sources in row-major order: every pixel's sum has the same order in any tiling.
  const Rect sources = tile.grown(std::max(0, parameters.radius)).clipped(in.residual.extent).clipped(frame);
  for (int y = sources.y0; y < sources.y1; ++y)
    for (int x = sources.x0; x < sources.x1; ++x)
    {
      const float* r = in.residual.at(x, y);
      if ((r[0] == 0 && r[1] == 0 && r[2] == 0) || !Finite3(r))
        continue;
      const Source source(in, parameters, x, y);
      const Rect window = Rect{ x, y, x + 1, y + 1 }.grown(source.Reach).clipped(frame);
      const Rect mine = window.clipped(tile);
      if (mine.empty())
        continue;
      // Weights are dear: those of the sum are kept for the giving where they fit.
      const bool kept = window.area() <= KeptWeights;
      double sum = 0, *next = weights;
      for (int qy = window.y0; qy < window.y1; ++qy)
        for (int qx = window.x0; qx < window.x1; ++qx)
        {
          const double w = source.Weight(qx, qy);
          sum += w;
          if (kept)
            *next++ = w;
        }
      for (int qy = mine.y0; qy < mine.y1; ++qy)
        for (int qx = mine.x0; qx < mine.x1; ++qx)
        {
          const std::ptrdiff_t at = std::ptrdiff_t(qy - window.y0) * window.width() + qx - window.x0;
          const double w = (kept ? weights[at] : source.Weight(qx, qy)) / sum;
          double* s = scratch + 3 * (std::ptrdiff_t(qy - tile.y0) * width + qx - tile.x0);
          for (int k = 0; k < 3; ++k)
            s[k] += w * r[k];
        }
    }
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x, scratch += 3)
    {
      float c[3];
      const bool good = ReadFilled(in.radiance, x, y, c);
      bad += !good || !Finite3(in.residual.at(x, y));
      for (int k = 0; k < 3; ++k)
        out.at(x, y)[k] = scratch[k] == 0 ? c[k] : ToFloat(double(c[k]) + scratch[k]);
    }
  return bad;
}

ImageEnergy SumEnergy(const ImageIn& radiance, const ImageIn& residual, const Rect& rows) noexcept
{
  ImageEnergy e;
  for (int y = rows.y0; y < rows.y1; ++y)
    for (int x = rows.x0; x < rows.x1; ++x)
    {
      const float* r = residual.at(x, y);
      if (Finite3(r))
        for (int k = 0; k < 3; ++k)
          e.Residual[k] += r[k];
      const float* c = radiance.at(x, y);
      if (!Finite3(c))
        continue;
      e.Pixels += 1;
      e.Luminance += std::max(0., 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]);
    }
  return e;
}

std::int64_t RedistributeEvenly(const ImageIn& radiance, const ImageIn& residual, const ImageEnergy& energy,
  const ImageOut& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  const bool any = energy.Residual[0] != 0 || energy.Residual[1] != 0 || energy.Residual[2] != 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[3];
      const bool good = ReadFilled(radiance, x, y, c);
      bad += !good || !Finite3(residual.at(x, y));
      double part = 0;
      if (any && good) // a pixel that was made up gets nothing, so that the sum stays
        part = energy.Luminance > 0 ? std::max(0., 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]) / energy.Luminance
                                    : 1 / energy.Pixels;
      for (int k = 0; k < 3; ++k)
        out.at(x, y)[k] = part > 0 ? ToFloat(double(c[k]) + part * energy.Residual[k]) : c[k];
    }
  return bad;
}
}
