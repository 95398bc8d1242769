// SPDX-License-Identifier: BSD-3-Clause
#include "quellPixelMemory.h"

#include "quellMemoryLimits.h"
#include "quellStageDescription.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstdlib>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

namespace quell
{
namespace
{
constexpr std::size_t Line = 64, Page = 4096, LargePage = std::size_t(2) << 20;
constexpr int Window = 2048; // blocks given back while a peak of use is remembered, at least: 50 frames of SVGF

/// Before the floats of each block.
struct Header
{
  void* Start = nullptr;
  std::size_t Size = 0; ///< bytes of floats
};
static_assert(sizeof(Header) <= Line);

Header& HeaderOf(float* floats)
{
  return *reinterpret_cast<Header*>(reinterpret_cast<char*>(floats) - Line);
}

struct Pool
{
  std::mutex Mutex;
  std::vector<float*> Free;   ///< oldest first
  std::size_t Bytes = 0;      ///< of Free
  std::size_t Used = 0;       ///< bytes that somebody has
  std::size_t Most = 0;       ///< of Used, in this window of blocks given back
  std::size_t MostBefore = 0; ///< in the window before
  int Given = 0;
  std::size_t Made = 0;
  std::size_t Kept = PixelMemoryKept;

  void Take(std::size_t size)
  {
    this->Used += size;
    this->Most = std::max(this->Most, this->Used);
    this->Trim();
  }
  /// Gives back to the system what is above the limit. The blocks that waited longest go first.
  void Trim() noexcept
  {
    const std::size_t limit = std::max(this->Kept, std::max(this->Most, this->MostBefore) - this->Used);
    while (this->Bytes > limit)
    {
      this->Bytes -= HeaderOf(this->Free.front()).Size;
      std::free(HeaderOf(this->Free.front()).Start);
      this->Free.erase(this->Free.begin());
    }
  }
};

/// Never destroyed: arrays may outlive static objects.
Pool& ThePool()
{
  static Pool* pool = new Pool;
  return *pool;
}

/// `number`: of the block.
float* NewBlock(std::size_t size, std::size_t number)
{
  const bool large = size >= LargePage;
  // Large blocks begin at different places of a large page: the same pixel of many arrays would else fall into the same
  // few lines of every cache.
  const std::size_t offset = Line + (large ? number % 16 * (Page + Line) : 0);
  const std::size_t bytes = offset + size;
  // aligned_alloc would want a size that is a multiple of the alignment.
  void* memory = nullptr;
  char* start = posix_memalign(&memory, large ? LargePage : Line, bytes) == 0 ? static_cast<char*>(memory) : nullptr;
  if (!start)
    throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
  // A wish: where the system does not grant it, small pages do.
  if (large)
    madvise(start, bytes / Page * Page, MADV_HUGEPAGE);
#endif
  float* floats = reinterpret_cast<float*>(start + offset);
  HeaderOf(floats) = { start, size };
  return floats;
}
}

float* TakePixelMemory(std::size_t floats)
{
  if (floats > std::size_t(-1) / sizeof(float) - 2 * LargePage)
    throw std::bad_alloc();
  const std::size_t size = (floats * sizeof(float) + Line - 1) / Line * Line;
  if (!detail::ClaimPixels(size))
    throw StageError(detail::PixelLimitText(size, "an array"));
  std::size_t number = 0;
  try
  {
    {
      Pool& pool = ThePool();
      std::lock_guard<std::mutex> lock(pool.Mutex);
      for (std::size_t i = pool.Free.size(); i-- > 0;)
        if (HeaderOf(pool.Free[i]).Size == size)
        {
          float* block = pool.Free[i];
          pool.Free.erase(pool.Free.begin() + std::ptrdiff_t(i));
          pool.Bytes -= size;
          pool.Take(size);
          return block;
        }
      number = pool.Made++;
    }
    float* block = NewBlock(size, number);
    Pool& pool = ThePool();
    std::lock_guard<std::mutex> lock(pool.Mutex);
    pool.Take(size);
    return block;
  }
  catch (...)
  {
    detail::ReleasePixels(size);
    throw;
  }
}

void GivePixelMemory(void* memory) noexcept
{
  if (!memory)
    return;
  float* block = static_cast<float*>(memory);
  Pool& pool = ThePool();
  std::lock_guard<std::mutex> lock(pool.Mutex);
  const std::size_t size = HeaderOf(block).Size;
  detail::ReleasePixels(size);
  pool.Used -= size;
  if (++pool.Given == Window)
  {
    pool.Given = 0;
    pool.MostBefore = pool.Most;
    pool.Most = pool.Used;
  }
  // Small blocks are malloc's business.
  if (size < 65536)
  {
    std::free(HeaderOf(block).Start);
    return;
  }
  try
  {
    pool.Free.push_back(block);
  }
  catch (...)
  {
    std::free(HeaderOf(block).Start);
    return;
  }
  pool.Bytes += size;
  pool.Trim();
}

std::size_t KeepPixelMemory(std::size_t bytes) noexcept
{
  Pool& pool = ThePool();
  std::lock_guard<std::mutex> lock(pool.Mutex);
  std::swap(pool.Kept, bytes);
  pool.Trim();
  return bytes;
}

std::size_t PixelMemoryWaiting() noexcept
{
  Pool& pool = ThePool();
  std::lock_guard<std::mutex> lock(pool.Mutex);
  return pool.Bytes;
}
}
