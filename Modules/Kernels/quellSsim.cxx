// SPDX-License-Identifier: BSD-3-Clause
#include "quellSsim.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
struct Window
{
  double w[2 * SsimRadius + 1];

  Window() noexcept
  {
    double sum = 0;
    for (int i = -SsimRadius; i <= SsimRadius; ++i)
      sum += w[i + SsimRadius] = std::exp(-i * i / (2 * 1.5 * 1.5));
    for (double& v : w)
      v /= sum;
  }
};

const Window& Gaussian() noexcept
{
  static const Window window;
  return window;
}
}

void SsimRow(const double* a, const double* b, int width, double* out) noexcept
{
  const Window& g = Gaussian();
  for (int x = 0; x < width; ++x)
  {
    double s[5] = { 0, 0, 0, 0, 0 };
    for (int i = -SsimRadius; i <= SsimRadius; ++i)
    {
      const int u = std::min(std::max(x + i, 0), width - 1);
      const double w = g.w[i + SsimRadius];
      s[0] += w * a[u];
      s[1] += w * b[u];
      s[2] += w * a[u] * a[u];
      s[3] += w * b[u] * b[u];
      s[4] += w * a[u] * b[u];
    }
    std::copy(s, s + 5, out + 5 * x);
  }
}

double SsimAt(const double* const rows[2 * SsimRadius + 1], double range) noexcept
{
  const Window& g = Gaussian();
  double s[5] = { 0, 0, 0, 0, 0 };
  for (int j = 0; j <= 2 * SsimRadius; ++j)
    for (int k = 0; k < 5; ++k)
      s[k] += g.w[j] * rows[j][k];
  const double c1 = 0.01 * 0.01 * range * range, c2 = 0.03 * 0.03 * range * range;
  const double va = s[2] - s[0] * s[0], vb = s[3] - s[1] * s[1], cov = s[4] - s[0] * s[1];
  return (2 * s[0] * s[1] + c1) * (2 * cov + c2) / ((s[0] * s[0] + s[1] * s[1] + c1) * (va + vb + c2));
}
}
