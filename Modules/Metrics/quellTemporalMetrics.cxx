// SPDX-License-Identifier: BSD-3-Clause
#include "quellTemporalMetrics.h"

#include "quellImageMetrics.h"
#include "quellStageDescription.h"
#include "vtkSMPTools.h"

#include <algorithm>
#include <cmath>
#include <functional>

namespace quell
{
namespace
{
constexpr int GhostReach = 8;
constexpr double GhostPart = 0.1, GhostStep = 0.01, GhostRest = 0.25;

/// Row sums in parallel, added in order.
double SumOfRows(int height, const std::function<double(int)>& row)
{
  std::vector<double> sums(std::size_t(height), 0.);
  auto loop = [&](vtkIdType begin, vtkIdType end)
  {
    for (vtkIdType y = begin; y < end; ++y)
      sums[std::size_t(y)] = row(int(y));
  };
  vtkSMPTools::For(0, height, 4, loop);
  double sum = 0;
  for (double s : sums)
    sum += s;
  return sum;
}

void CheckFinite(const ImageIn& image, const char* what, int frame)
{
  int x = 0, y = 0;
  const std::int64_t bad = CountNonFinite(image, x, y);
  if (bad > 0)
    throw StageError(std::string(what) + " " + std::to_string(frame) + " of the sequence has " + std::to_string(bad) +
                     " non-finite pixel" + (bad == 1 ? "" : "s") + ", the first at column " + std::to_string(x) +
                     ", row " + std::to_string(y) + " from the bottom");
}
}

const std::vector<std::string>& TemporalMetrics::Names()
{
  static const std::vector<std::string> names{ "flicker", "warp", "lag", "ghost" };
  return names;
}

void TemporalMetrics::Keep(const ImageIn& view, std::vector<Pixels>& list, std::size_t kept)
{
  Pixels pixels;
  pixels.reserve(std::size_t(view.extent.area()) * std::size_t(view.components));
  for (int y = view.extent.y0; y < view.extent.y1; ++y)
  {
    const float* row = view.at(view.extent.x0, y);
    pixels.insert(pixels.end(), row, row + std::ptrdiff_t(view.extent.width()) * view.components);
  }
  list.push_back(std::move(pixels));
  if (list.size() > kept)
    list.erase(list.begin());
}

void TemporalMetrics::Add(const ImageIn& test, const ImageIn& reference, const ImageIn& motion, const ImageIn& id)
{
  const auto fits = [&](const ImageIn& v, int channels, const char* what)
  {
    if (!v || v.extent.width() != this->Width || v.extent.height() != this->Height || v.components != channels)
      throw StageError(std::string(what) + " " + std::to_string(this->Count) + " of the sequence " +
                       (v ? "has another size" : "is missing"));
  };
  if (!test || test.extent.empty())
    throw StageError("a sequence of empty images");
  if (this->Count == 0)
  {
    this->Width = test.extent.width(), this->Height = test.extent.height(), this->Channels = test.components;
    this->HasReference = bool(reference), this->HasMotion = bool(motion), this->HasId = bool(id);
  }
  fits(test, this->Channels, "image");
  CheckFinite(test, "image", this->Count);
  if (this->HasReference)
  {
    fits(reference, this->Channels, "reference");
    CheckFinite(reference, "reference", this->Count);
  }
  if (this->HasMotion)
    fits(motion, 2, "motion");
  if (this->HasId)
    fits(id, 1, "id");

  this->Keep(test, this->Tests, 2);
  if (this->HasReference)
    this->Keep(reference, this->References, GhostReach + 1);
  if (this->HasId)
    this->Keep(id, this->Ids, 2);
  const int w = this->Width, h = this->Height, channels = this->Channels;
  const std::size_t row = std::size_t(w) * std::size_t(channels), values = row * std::size_t(h);
  const int n = this->Count++;
  if (n == 0)
  {
    return;
  }
  const Pixels &now = this->Tests.back(), &then = this->Tests.front();
  const Pixels* r = this->HasReference ? &this->References.back() : nullptr;
  const Pixels* rThen = r ? &this->References[this->References.size() - 2] : nullptr;

  this->Flicker += SumOfRows(h,
                     [&](int y)
                     {
                       double sum = 0;
                       for (std::size_t i = std::size_t(y) * row; i < (std::size_t(y) + 1) * row; ++i)
                       {
                         double d = double(now[i]) - double(then[i]);
                         d -= r ? double((*r)[i]) - double((*rThen)[i]) : 0.;
                         sum += d * d;
                       }
                       return sum;
                     }) /
                   (2. * double(values));

  if (this->HasMotion)
  {
    std::vector<double> counts(std::size_t(h), 0.), ofReference(std::size_t(h), 0.);
    this->Warp += SumOfRows(h,
      [&](int y)
      {
        double sum = 0;
        for (int x = 0; x < w; ++x)
        {
          const float* m = motion.at(motion.extent.x0 + x, motion.extent.y0 + y);
          const double px = x + double(m[0]), py = y + double(m[1]);
          if (!(px >= 0 && py >= 0 && px <= w - 1 && py <= h - 1))
            continue;
          const int x0 = std::min(int(px), std::max(0, w - 2)), y0 = std::min(int(py), std::max(0, h - 2));
          const int x1 = std::min(x0 + 1, w - 1), y1 = std::min(y0 + 1, h - 1);
          const std::size_t taps[4] = { std::size_t(y0) * w + x0, std::size_t(y0) * w + x1, std::size_t(y1) * w + x0,
            std::size_t(y1) * w + x1 };
          const std::size_t p = std::size_t(y) * w + x;
          const double fx = px - x0, fy = py - y0;
          const double weights[4] = { (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy };
          bool same = true;
          for (int k = 0; k < 4 && this->HasId; ++k)
            same = same && (weights[k] == 0 || this->Ids.front()[taps[k]] == this->Ids.back()[p]);
          if (!same)
            continue;
          counts[std::size_t(y)] += 1;
          for (int c = 0; c < channels; ++c)
          {
            const auto at = [&](const Pixels& image, std::size_t q) { return double(image[q * channels + c]); };
            const auto moved = [&](const Pixels& image)
            {
              double v = 0;
              for (int k = 0; k < 4; ++k)
                v += weights[k] * at(image, taps[k]);
              return v;
            };
            const double d = at(now, p) - moved(then);
            sum += d * d / channels;
            if (r)
            {
              const double e = at(*r, p) - moved(*rThen);
              ofReference[std::size_t(y)] += e * e / channels;
            }
          }
        }
        return sum;
      });
    for (int y = 0; y < h; ++y)
    {
      this->WarpPixels += counts[std::size_t(y)];
      this->WarpReference += ofReference[std::size_t(y)];
    }
  }
  if (!r)
    return;

  const double step = SumOfRows(h,
    [&](int y)
    {
      double sum = 0;
      for (std::size_t i = std::size_t(y) * row; i < (std::size_t(y) + 1) * row; ++i)
        sum += (double((*r)[i]) - double((*rThen)[i])) * (double((*r)[i]) - double((*rThen)[i]));
      return sum;
    });
  if (step > this->Step)
  {
    // What was summed belongs to a smaller step.
    this->StepAt = n, this->Step = step, this->Lag = 0;
    this->Before = *rThen;
  }
  if (this->StepAt >= 0)
  {
    const auto along = [&](bool error)
    {
      return SumOfRows(h,
        [&](int y)
        {
          double sum = 0;
          for (std::size_t i = std::size_t(y) * row; i < (std::size_t(y) + 1) * row; ++i)
          {
            const double d = double(this->Before[i]) - double((*r)[i]);
            sum += d * (error ? double(now[i]) - double((*r)[i]) : d);
          }
          return sum;
        });
    };
    const double whole = along(false);
    this->Lag += whole > 0 ? along(true) / whole : 0;
  }

  this->Ghost += SumOfRows(h,
                   [&](int y)
                   {
                     double ghosts = 0;
                     for (std::size_t p = std::size_t(y) * w; p < (std::size_t(y) + 1) * w; ++p)
                     {
                       double own = 0, error = 0;
                       for (int c = 0; c < channels; ++c)
                       {
                         const double v = (*r)[p * channels + c], e = double(now[p * channels + c]) - v;
                         own += v * v, error += e * e;
                       }
                       for (std::size_t k = 1; k < this->References.size() && error > 0; ++k)
                       {
                         const Pixels& old = this->References[this->References.size() - 1 - k];
                         double dd = 0, ed = 0;
                         for (int c = 0; c < channels; ++c)
                         {
                           const double v = (*r)[p * channels + c], d = double(old[p * channels + c]) - v;
                           dd += d * d, ed += d * (double(now[p * channels + c]) - v);
                         }
                         // |e - g d|^2 = |e|^2 - <e, d>^2 / |d|^2 for the best g.
                         if (dd > GhostStep * (own + GhostStep * channels) && ed >= GhostPart * dd &&
                             error - ed * ed / dd <= GhostRest * error)
                         {
                           ghosts += 1;
                           break;
                         }
                       }
                     }
                     return ghosts;
                   }) /
                 (double(w) * h);
  ++this->GhostFrames;
}

int TemporalMetrics::StepFrame() const
{
  return this->StepAt;
}

std::vector<std::pair<std::string, double>> TemporalMetrics::Values() const
{
  std::vector<std::pair<std::string, double>> out;
  if (this->Count < 2)
    return out;
  out.emplace_back("flicker", std::sqrt(this->Flicker / (this->Count - 1)));
  if (this->WarpPixels > 0)
  {
    out.emplace_back("warp", std::sqrt(this->Warp / this->WarpPixels));
    if (this->HasReference)
      out.emplace_back("warp of the reference", std::sqrt(this->WarpReference / this->WarpPixels));
  }
  if (this->StepAt >= 0)
  {
    out.emplace_back("lag", this->Lag);
    out.emplace_back("ghost", this->Ghost / this->GhostFrames);
  }
  return out;
}
}
