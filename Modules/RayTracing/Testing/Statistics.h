// SPDX-License-Identifier: BSD-3-Clause
#ifndef Statistics_h
#define Statistics_h

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

/// Tests of hypotheses about noisy images. Every threshold is a chance of a false alarm, none is a tolerance in the
/// units of the image.
namespace statistics
{
/// Chance that a standard normal number is further from 0 than |z|.
inline double NormalTail(double z)
{
  return std::erfc(std::fabs(z) / std::sqrt(2.));
}

/// Regularised incomplete beta function I_x(a, b), by its continued fraction (Lentz).
inline double BetaRatio(double a, double b, double x)
{
  if (!(x > 0))
    return 0;
  if (x >= 1)
    return 1;
  // converges fast below the mean only
  if (x > (a + 1) / (a + b + 2))
    return 1 - BetaRatio(b, a, 1 - x);
  const double front =
    std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x)) / a;
  const double tiny = 1e-300;
  double c = 1, d = 1 - (a + b) * x / (a + 1);
  d = 1 / (std::fabs(d) < tiny ? tiny : d);
  double f = d;
  for (int m = 1; m < 1000; ++m)
  {
    double change = 1;
    for (int odd = 0; odd < 2; ++odd)
    {
      const double k = odd ? -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
                           : m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
      d = 1 + k * d;
      c = 1 + k / c;
      d = 1 / (std::fabs(d) < tiny ? tiny : d);
      c = std::fabs(c) < tiny ? tiny : c;
      change = c * d;
      f *= change;
    }
    if (std::fabs(change - 1) < 1e-15)
      break;
  }
  return front * f;
}

/// Chance that Student's t with `dof` degrees of freedom is further from 0 than |t|.
inline double StudentTail(double t, double dof)
{
  return std::isfinite(t) ? BetaRatio(dof / 2, .5, dof / (dof + t * t)) : 0;
}

/// Chance that chi-squared with `dof` degrees of freedom exceeds x: the upper regularised incomplete gamma function.
inline double ChiSquaredTail(double x, double dof)
{
  if (!(x > 0))
    return 1;
  const double a = dof / 2, z = x / 2, front = std::exp(a * std::log(z) - z - std::lgamma(a));
  if (z < a + 1)
  {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 100000 && term > sum * 1e-16; ++n)
      sum += term *= z / (a + n);
    return 1 - front * sum;
  }
  double b = z + 1 - a, c = 1e300, d = 1 / b, f = d;
  for (int n = 1; n < 100000; ++n)
  {
    const double k = -n * (n - a);
    b += 2;
    d = 1 / (k * d + b);
    c = b + k / c;
    f *= c * d;
    if (std::fabs(c * d - 1) < 1e-15)
      break;
  }
  return front * f;
}

/// Level of one of `count` independent tests, so that they raise a false alarm together with chance `alpha` (Sidak).
inline double SidakLevel(double alpha, double count)
{
  return -std::expm1(std::log1p(-alpha) / count);
}

/// |t| at which Student's test has this two-sided level.
inline double StudentThreshold(double level, double dof)
{
  double lo = 0, hi = 1e6;
  for (int i = 0; i < 200; ++i)
    (StudentTail((lo + hi) / 2, dof) > level ? lo : hi) = (lo + hi) / 2;
  return hi;
}
inline double NormalThreshold(double level)
{
  double lo = 0, hi = 40;
  for (int i = 0; i < 200; ++i)
    (NormalTail((lo + hi) / 2) > level ? lo : hi) = (lo + hi) / 2;
  return hi;
}

/// p-value of Pearson's test of counts against expected counts; neighbouring cells are pooled until they expect 5.
inline double ChiSquaredTest(const std::vector<double>& observed, const std::vector<double>& expected)
{
  double x = 0, o = 0, e = 0;
  int cells = 0;
  for (std::size_t i = 0; i < observed.size(); ++i)
  {
    o += observed[i];
    e += expected[i];
    if (e >= 5)
    {
      x += (o - e) * (o - e) / e;
      ++cells;
      o = e = 0;
    }
  }
  // what is left belongs to no cell of its own
  if (e > 0)
    x += (o - e) * (o - e) / std::max(e, 1.);
  return cells > 1 ? ChiSquaredTail(x, cells - 1 + (e > 0)) : 1;
}

/// An image of interleaved channels.
struct Picture
{
  int Width = 0, Height = 0, Channels = 1;
  std::vector<float> Pixels;
  double At(int x, int y, int c) const
  {
    return double(
      this->Pixels[std::size_t(this->Channels) * (std::size_t(y) * std::size_t(this->Width) + std::size_t(x)) +
                   std::size_t(c)]);
  }
};

/// What a test on block means found.
struct BlockTest
{
  int Count = 0;        ///< blocks times channels
  int Bad = 0;          ///< beyond the threshold
  double Threshold = 0; ///< of |z| of a block
  double Worst = 0;     ///< largest |z|
  int WorstX = 0, WorstY = 0, WorstChannel = 0;
  double WorstRatio = 1;  ///< of the two means of that block
  double Rms = 0;         ///< root mean square of z; 1 where nothing but noise differs
  double Whole = 0;       ///< largest |z| of the channels' means over the whole image
  double WholeRatio = 1;  ///< the ratio of means of that channel
  double Sensitivity = 0; ///< median over the blocks of Threshold * (standard error) / mean: the bias that is found
  double WholeError = 0;  ///< largest relative standard error of the channels' means
  bool Agrees(double share = .9975) const { return this->Count > 0 && this->Bad <= (1 - share) * this->Count; }
  std::string Text() const
  {
    std::ostringstream s;
    s.precision(3);
    s << this->Bad << " of " << this->Count << " beyond " << this->Threshold << ", worst " << this->Worst
      << " at block " << this->WorstX << ',' << this->WorstY << " channel " << this->WorstChannel << " (ratio ";
    s.precision(5);
    s << this->WorstRatio << "), rms ";
    s.precision(3);
    s << this->Rms << ", whole " << this->Whole << " (ratio ";
    s.precision(6);
    s << this->WholeRatio << " +- ";
    s.precision(2);
    s << this->WholeError << "), finds " << this->Sensitivity;
    return s.str();
  }
};

namespace detail
{
/// |z| of a difference of which rounding may explain `floor`; not a number never agrees.
inline double Score(double difference, double floor, double error)
{
  if (!std::isfinite(difference) || !std::isfinite(error))
    return std::numeric_limits<double>::infinity();
  const double rest = std::max(0., std::fabs(difference) - floor);
  return rest == 0 ? 0 : error > 0 ? rest / error : std::numeric_limits<double>::infinity();
}

/// `measure(x0, y0, c, difference, a, b, error, floor)`: for one block sums of a - b, of a and of b, the standard error
/// of the first, and what rounding can add to it.
template <class Block>
BlockTest Walk(int width, int height, int channels, int block, double alpha, double dof, Block&& measure)
{
  BlockTest out;
  const int across = width / block, up = height / block;
  std::vector<double> found;
  struct Total
  {
    double Difference = 0, A = 0, B = 0, Variance = 0, Floor = 0;
  };
  std::vector<Total> totals(static_cast<std::size_t>(channels));
  double squares = 0;
  out.Count = across * up * channels;
  const double level = SidakLevel(alpha, std::max(1, out.Count));
  out.Threshold = dof > 0 ? StudentThreshold(level, dof) : NormalThreshold(level);
  for (int by = 0; by < up; ++by)
    for (int bx = 0; bx < across; ++bx)
      for (int c = 0; c < channels; ++c)
      {
        double difference = 0, a = 0, b = 0, error = 0, floor = 0;
        measure(bx * block, by * block, c, difference, a, b, error, floor);
        const double z = Score(difference, floor, error);
        squares += z * z;
        out.Bad += z > out.Threshold;
        if (z > out.Worst)
        {
          out.Worst = z;
          out.WorstX = bx;
          out.WorstY = by;
          out.WorstChannel = c;
          out.WorstRatio = b != 0 ? a / b : 0;
        }
        if (b > 0)
          found.push_back((out.Threshold * error + floor) / b);
        Total& t = totals[static_cast<std::size_t>(c)];
        t.Difference += difference;
        t.A += a;
        t.B += b;
        t.Variance += error * error;
        t.Floor += floor;
      }
  out.Rms = out.Count > 0 ? std::sqrt(squares / out.Count) : 0;
  for (const Total& t : totals)
  {
    const double z = Score(t.Difference, t.Floor, std::sqrt(t.Variance));
    if (z >= out.Whole)
    {
      out.Whole = z;
      out.WholeRatio = t.B != 0 ? t.A / t.B : 1;
    }
    if (t.B > 0)
      out.WholeError = std::max(out.WholeError, std::sqrt(t.Variance) / t.B);
  }
  if (!found.empty())
  {
    std::nth_element(found.begin(), found.begin() + std::ptrdiff_t(found.size() / 2), found.end());
    out.Sensitivity = found[found.size() / 2];
  }
  return out;
}
}

/// Half the distance of neighbouring half-floats around v: what storing v as one can change.
inline double HalfRounding(double v)
{
  int e = 0;
  std::frexp(std::fabs(v), &e);
  return std::ldexp(1., std::max(e, -13) - 12);
}

/// Do two independent renders have the same mean? For every block of block x block pixels and every channel, with
/// d = a - b at its n pixels,
///
///   t = mean(d) / (s / sqrt n),    s^2 = sum (d - mean d)^2 / (n - 1),
///
/// which is Student's t with n - 1 degrees of freedom when the means are equal. s is the noise of both images as it
/// is in them (a reference's too), so nothing has to be known about their samples. A block is bad where |t| is beyond
/// the two-sided level 1 - (1 - alpha)^(1 / count). Rounding: float's; with `half` also what storing `b` as half can do
/// where there is less noise than one step (more noise than that makes the roundings average out).
inline BlockTest BySpread(const Picture& a, const Picture& b, int block = 8, double alpha = .01, bool half = false)
{
  const int n = block * block;
  return detail::Walk(a.Width, a.Height, std::min(a.Channels, 3), block, alpha, n - 1.,
    [&](int x0, int y0, int c, double& difference, double& sumA, double& sumB, double& error, double& floor)
    {
      double steps = 0;
      for (int y = y0; y < y0 + block; ++y)
        for (int x = x0; x < x0 + block; ++x)
        {
          sumA += a.At(x, y, c);
          sumB += b.At(x, y, c);
          steps += HalfRounding(b.At(x, y, c));
        }
      difference = sumA - sumB;
      double squares = 0;
      for (int y = y0; y < y0 + block; ++y)
        for (int x = x0; x < x0 + block; ++x)
        {
          const double d = a.At(x, y, c) - b.At(x, y, c) - difference / n;
          squares += d * d;
        }
      error = std::sqrt(squares / (n - 1) * n);
      floor = 1e-6 * std::fabs(sumB);
      if (half && error / std::sqrt(double(n)) < 2 * steps / n)
        floor += steps;
    });
}

/// The same with the variances of the pixels' means that the renders claim themselves (one channel; `b` without
/// variance: exact). For samples that are better spread than random ones the claim is too large and the test milder.
inline BlockTest ByVariance(const Picture& a, const Picture& varianceA, const Picture& b, const Picture* varianceB,
  int block = 8, double alpha = .01)
{
  return detail::Walk(a.Width, a.Height, 1, block, alpha, 0,
    [&](int x0, int y0, int, double& difference, double& sumA, double& sumB, double& error, double& floor)
    {
      const auto luminance = [](const Picture& p, int x, int y) {
        return p.Channels == 1 ? p.At(x, y, 0) : .2126 * p.At(x, y, 0) + .7152 * p.At(x, y, 1) + .0722 * p.At(x, y, 2);
      };
      double variance = 0;
      for (int y = y0; y < y0 + block; ++y)
        for (int x = x0; x < x0 + block; ++x)
        {
          sumA += luminance(a, x, y);
          sumB += luminance(b, x, y);
          variance += varianceA.At(x, y, 0) + (varianceB ? varianceB->At(x, y, 0) : 0);
        }
      difference = sumA - sumB;
      error = std::sqrt(variance);
      floor = 1e-6 * std::fabs(sumB);
    });
}
}

#endif
