// SPDX-License-Identifier: BSD-3-Clause
#include "quellMedianOfMeans.h"

#include "quellGuards.h"

#include <algorithm>

namespace quell
{
double GiniOfSorted(const double* values, int count) noexcept
{
  double sum = 0, ranked = 0;
  for (int j = 0; j < count; ++j)
  {
    const double v = std::max(0., values[j]);
    sum += v;
    ranked += (j + 1) * v;
  }
  if (!(sum > 0))
    return 0;
  return std::max(0., 2 * ranked / (count * sum) - (count + 1.) / count);
}

ClampLedger MedianOfMeans(const ImageIn* buffers, int count, const MedianOfMeansParameters& parameters,
  const MedianOfMeansOutputs& out, const Rect& tile) noexcept
{
  ClampLedger ledger;
  count = std::min(count, MedianOfMeansParameters::MostBuffers);
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      const float* c[MedianOfMeansParameters::MostBuffers];
      int n = 0;
      for (int b = 0; b < count; ++b)
        if (Finite3(buffers[b].at(x, y)))
          c[n++] = buffers[b].at(x, y);
      ledger.NonFinite += n < count;
      float f[3] = {}, m[3] = {}, r[3] = {};
      double gini = 0;
      if (n == 0)
      {
        FillFromNeighbours<3>(buffers[0].extent, x, y, m,
          [buffers, count](int qx, int qy, float* v)
          {
            double sum[3] = {};
            int finite = 0;
            for (int b = 0; b < count; ++b)
              if (Finite3(buffers[b].at(qx, qy)))
              {
                for (int k = 0; k < 3; ++k)
                  sum[k] += buffers[b].at(qx, qy)[k];
                ++finite;
              }
            for (int k = 0; k < 3; ++k)
              v[k] = float(sum[k] / std::max(1, finite));
            return finite > 0;
          });
        std::copy(m, m + 3, f);
      }
      else
      {
        // By luminance, equal ones in their order, so that the sums are the same everywhere.
        double l[MedianOfMeansParameters::MostBuffers];
        for (int b = 0; b < n; ++b)
        {
          const float* v = c[b];
          const double key = 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2];
          int at = b;
          for (; at > 0 && l[at - 1] > key; --at)
          {
            l[at] = l[at - 1];
            c[at] = c[at - 1];
          }
          l[at] = key;
          c[at] = v;
        }
        gini = GiniOfSorted(l, n);
        const auto mean = [&c](int from, int to, float* result)
        {
          for (int k = 0; k < 3; ++k)
          {
            double sum = 0;
            for (int b = from; b < to; ++b)
              sum += c[b][k];
            result[k] = float(sum / (to - from));
          }
        };
        int trim = 0;
        bool middle = parameters.estimator == MeansEstimator::Median;
        if (parameters.estimator == MeansEstimator::Binary)
          middle = gini > parameters.giniThreshold;
        else if (parameters.estimator == MeansEstimator::Gini)
          trim = std::min((n - 1) / 2, int(gini * (n / 2)));
        mean(0, n, m);
        if (middle)
          std::copy(c[(n - 1) / 2], c[(n - 1) / 2] + 3, f);
        else
          mean(trim, n - trim, f);
        for (int k = 0; k < 3; ++k)
        {
          r[k] = Limited(m[k] - f[k]);
          m[k] = f[k] + r[k];
        }
        if (n == count)
          Book(ledger, m, r, r[0] != 0 || r[1] != 0 || r[2] != 0);
      }
      StoreColor(out.radiance, x, y, f);
      StoreColor(out.residual, x, y, r);
      StoreColor(out.mean, x, y, m);
      if (out.gini)
        *out.gini.at(x, y) = float(gini);
    }
  return ledger;
}
}
