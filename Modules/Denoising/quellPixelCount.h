// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPixelCount_h
#define quellPixelCount_h

#include "quellCountedRows.h"
#include "quellPixelMemory.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

#include <algorithm>
#include <atomic>
#include <memory>

namespace quell
{
/// Non-finite pixels met in a frame; tiles add concurrently. A frame made in bands is counted once, each of its pixels.
class VTKQUELLDENOISING_EXPORT PixelCount
{
public:
  /// Before the tiles of an execution over `region`.
  void Begin(const Rect& region, int tick);
  /// The rows of this execution that count.
  const Rect& CountedRegion() const { return this->Counted; }
  /// What `tile`, which lies within them or apart from them, had.
  void Add(const Rect& tile, std::int64_t pixels) const
  {
    if (tile.y0 >= this->Counted.y0 && tile.y1 <= this->Counted.y1)
      this->Pixels += pixels;
  }
  /// body(part), which returns what the part had, for the parts of a tile that count and those that do not.
  template <class Body>
  void Count(const Rect& tile, const Body& body) const
  {
    const int y0 = std::clamp(this->Counted.y0, tile.y0, tile.y1), y1 = std::clamp(this->Counted.y1, y0, tile.y1);
    const int rows[] = { tile.y0, y0, y1, tile.y1 };
    for (int k = 0; k < 3; ++k)
      if (rows[k] < rows[k + 1])
      {
        const Rect part{ tile.x0, rows[k], tile.x1, rows[k + 1] };
        this->Add(part, body(part));
      }
  }
  /// Count with that body, for ForEachTile.
  template <class Body>
  auto Counting(const Body& body) const
  {
    return [this, body](const Rect& tile) { this->Count(tile, body); };
  }
  /// Adds to the stage's counters, and one sentence about the frame so far to its warnings where there were any.
  void Report(
    StageCounters& counters, std::vector<std::string>& warnings, std::string& countedWarning, const char* what);
  /// The same for those who count on their own: `pixels` in this execution, `all` in the frame.
  static void Report(std::int64_t pixels, std::int64_t all, StageCounters& counters, std::vector<std::string>& warnings,
    std::string& countedWarning, const char* what);

private:
  CountedRows Rows;
  Rect Counted;
  mutable std::atomic<std::int64_t> Pixels{ 0 }; ///< of this execution
  std::int64_t All = 0;                          ///< of the frame, without them
};

/// Bytes of `planes` planes over tiles of `width` x `height` pixels grown by `halo`, of every thread: for ScratchBytes.
VTKQUELLDENOISING_EXPORT double TileScratchBytes(int width, int height, int halo, double planes);

/// Uninitialised floats (TakePixelMemory) that grow and are kept: fresh memory costs more than a filter pass (its pages
/// are touched twice).
class VTKQUELLDENOISING_EXPORT Scratch
{
public:
  float* Take(std::size_t count)
  {
    if (count > this->Size)
    {
      this->Data.reset(); // not both at the same time
      this->Size = 0;
      this->Data.reset(TakePixelMemory(count));
      this->Size = count;
    }
    return this->Data.get();
  }

private:
  struct Free
  {
    void operator()(float* data) const { GivePixelMemory(data); }
  };
  std::unique_ptr<float[], Free> Data;
  std::size_t Size = 0;
};
}

#endif
