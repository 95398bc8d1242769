// SPDX-License-Identifier: BSD-3-Clause
#include "quellVector.h"

namespace quell
{
bool Mat4::Inverse(Mat4& out) const
{
  double a[4][8];
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
    {
      a[i][j] = m[i][j];
      a[i][j + 4] = i == j;
    }
  for (int c = 0; c < 4; ++c)
  {
    int p = c;
    for (int i = c + 1; i < 4; ++i)
      if (std::fabs(a[i][c]) > std::fabs(a[p][c]))
        p = i;
    if (!(std::fabs(a[p][c]) > 1e-300))
      return false;
    for (int j = 0; j < 8; ++j)
    {
      const double t = a[p][j];
      a[p][j] = a[c][j];
      a[c][j] = t;
    }
    const double d = a[c][c];
    for (int j = 0; j < 8; ++j)
      a[c][j] /= d;
    for (int i = 0; i < 4; ++i)
      if (i != c)
      {
        const double f = a[i][c];
        for (int j = 0; j < 8; ++j)
          a[i][j] -= f * a[c][j];
      }
  }
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      out.m[i][j] = a[i][j + 4];
  return true;
}
}
