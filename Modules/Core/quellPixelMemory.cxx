// SPDX-License-Identifier: BSD-3-Clause
#include "quellPixelMemory.h"

#include <cstdlib>
#include <mutex>
#include <new>
#include <vector>

namespace quell
{
namespace
{
constexpr std::size_t Header = 64; // before each block: its size

struct Pool
{
  std::mutex Mutex;
  std::vector<char*> Free; ///< oldest first
  std::size_t Bytes = 0;
};

/// Never destroyed: arrays may outlive static objects.
Pool& ThePool()
{
  static Pool* pool = new Pool;
  return *pool;
}

std::size_t& SizeOf(char* block)
{
  return *reinterpret_cast<std::size_t*>(block);
}
}

float* TakePixelMemory(std::size_t floats)
{
  const std::size_t size = Header + (floats * sizeof(float) + 63) / 64 * 64;
  {
    Pool& pool = ThePool();
    std::lock_guard<std::mutex> lock(pool.Mutex);
    for (std::size_t i = pool.Free.size(); i-- > 0;)
      if (SizeOf(pool.Free[i]) == size)
      {
        char* block = pool.Free[i];
        pool.Free.erase(pool.Free.begin() + std::ptrdiff_t(i));
        pool.Bytes -= size;
        return reinterpret_cast<float*>(block + Header);
      }
  }
  char* block = static_cast<char*>(std::aligned_alloc(64, size));
  if (!block)
    throw std::bad_alloc();
  SizeOf(block) = size;
  return reinterpret_cast<float*>(block + Header);
}

void GivePixelMemory(void* memory) noexcept
{
  if (!memory)
    return;
  char* block = static_cast<char*>(memory) - Header;
  Pool& pool = ThePool();
  std::lock_guard<std::mutex> lock(pool.Mutex);
  const std::size_t size = SizeOf(block);
  // Small blocks are malloc's business.
  if (size < 65536 || size > PixelMemoryKept)
  {
    std::free(block);
    return;
  }
  try
  {
    pool.Free.push_back(block);
  }
  catch (...)
  {
    std::free(block);
    return;
  }
  pool.Bytes += size;
  while (pool.Bytes > PixelMemoryKept)
  {
    pool.Bytes -= SizeOf(pool.Free.front());
    std::free(pool.Free.front());
    pool.Free.erase(pool.Free.begin());
  }
}
}
