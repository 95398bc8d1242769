// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPixelCount_h
#define quellPixelCount_h

#include "quellPixelMemory.h"
#include "vtkQuellDenoisingModule.h"
#include "vtkQuellStage.h"

#include <atomic>
#include <memory>

namespace quell
{
/// Non-finite pixels met by one execution; tiles add concurrently.
class VTKQUELLDENOISING_EXPORT PixelCount
{
public:
  void Reset() { this->Pixels = 0; }
  void Add(std::int64_t pixels) const { this->Pixels += pixels; }
  /// Adds to the stage's counters, and one sentence to its warnings when there were any.
  void Report(StageCounters& counters, std::vector<std::string>& warnings, const char* what) const;

private:
  mutable std::atomic<std::int64_t> Pixels{ 0 };
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
