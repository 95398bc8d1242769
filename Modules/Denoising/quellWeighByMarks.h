// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellWeighByMarks_h
#define quellWeighByMarks_h

#include "quellImageView.h"
#include "vtkQuellStage.h"

#include <algorithm>
#include <string>
#include <vector>

namespace quell
{
/// Finds the weights with which a filter that is linear in `marks` takes the pixels of `window` into one pixel: four of
/// them at a time are 1 in a channel of their own, all others are 0, and what comes out is their weight.
/// `filter(marks, out)` filters images of 4 components. `like`: what the marks stand for; the marks are as large and,
/// where the filter looks `halo` pixels further than its window, at least that large.
template <class Filter>
void WeighByMarks(PixelWeights& weights, const std::string& input, const ImageIn& like, const Rect& window, int halo,
  const Filter& filter)
{
  PixelWeights::Part part;
  part.Input = input;
  part.Window = window.clipped(like.extent);
  const Rect around = part.Window.grown(halo).clipped(like.extent);
  std::vector<float> values(4 * std::size_t(around.area()), 0.f);
  const ImageOut marks(values.data(), 4, around);
  part.Weights.resize(std::size_t(part.Window.area()));
  const std::size_t count = part.Weights.size();
  const int width = part.Window.width();
  const auto mark = [&](std::size_t i, float value)
  { marks.at(part.Window.x0 + int(i) % width, part.Window.y0 + int(i) / width)[i % 4] = value; };
  for (std::size_t i = 0; i < count; i += 4)
  {
    const std::size_t end = std::min(count, i + 4);
    float result[4] = {};
    for (std::size_t k = i; k < end; ++k)
      mark(k, 1);
    // The middle of the window, whatever was clipped.
    const int x = (window.x0 + window.x1 - 1) / 2, y = (window.y0 + window.y1 - 1) / 2;
    filter(ImageIn(marks), ImageOut(result, 4, Rect{ x, y, x + 1, y + 1 }));
    for (std::size_t k = i; k < end; ++k)
    {
      part.Weights[k] = result[k % 4];
      mark(k, 0);
    }
  }
  weights.Parts.push_back(std::move(part));
}
}

#endif
