// SPDX-License-Identifier: BSD-3-Clause
#include "quellAccumulate.h"

#include "quellVector.h"

#include <limits>

namespace quell
{
namespace
{
Vec3d ColorAt(const ImageIn& v, int x, int y)
{
  const float* p = v.at(x, y);
  return { p[0], p[1], p[2] };
}

float Finite(double v)
{
  const double limit = std::numeric_limits<float>::max();
  return float(std::min(std::max(v, -limit), limit));
}
}

std::int64_t Accumulate(
  const AccumulateInputs& in, const AccumulateParameters& par, const AccumulateOutputs& out, const Rect& tile) noexcept
{
  std::int64_t bad = 0;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      const Vec3d sample = ColorAt(in.radiance, x, y);
      const bool usable = IsFinite(sample);
      Vec3d color;
      double mean = 0, second = 0, length = 0;
      if (in.history && in.length)
      {
        const double h = *in.length.at(x, y);
        color = ColorAt(in.history, x, y);
        if (in.moments)
        {
          mean = in.moments.at(x, y)[0];
          second = in.moments.at(x, y)[1];
        }
        if (h > 0 && std::isfinite(h) && IsFinite(color) && std::isfinite(mean) && std::isfinite(second))
          length = h;
      }

      if (usable)
      {
        const double luminance = Luminance(sample);
        if (length > 0)
        {
          length = std::min(length + 1, par.maximumHistory);
          const double a = std::min(1., std::max(par.alpha, 1 / length));
          color = a < 1 ? color + (sample - color) * a : sample; // a weight of 1 is exact
          const double am = std::min(1., std::max(par.momentsAlpha, 1 / length));
          const double d = luminance - mean;
          mean += am * d;
          second = (1 - am) * (second + am * d * d);
        }
        else
        {
          length = 1;
          color = sample;
          mean = luminance;
          second = 0;
        }
      }
      else
      {
        ++bad;
        if (!(length > 0))
        {
          color = Vec3d();
          int n = 0;
          for (int j = -1; j <= 1; ++j)
            for (int i = -1; i <= 1; ++i)
              if (in.radiance.inside(x + i, y + j) && IsFinite(ColorAt(in.radiance, x + i, y + j)))
              {
                color += ColorAt(in.radiance, x + i, y + j);
                ++n;
              }
          if (n > 0)
            color *= 1. / n;
          mean = Luminance(color);
          second = 0;
        }
      }

      if (out.radiance)
        for (int c = 0; c < 3; ++c)
          out.radiance.at(x, y)[c] = Finite(color[c]);
      if (out.moments)
      {
        out.moments.at(x, y)[0] = Finite(mean);
        out.moments.at(x, y)[1] = Finite(second);
      }
      if (out.history)
        *out.history.at(x, y) = float(length);
    }
  return bad;
}
}
