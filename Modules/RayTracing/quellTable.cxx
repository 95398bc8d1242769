// SPDX-License-Identifier: BSD-3-Clause
#include "quellTable.h"

#include <limits>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace quell
{
namespace
{
constexpr std::size_t LargePage = std::size_t(1) << 21;
std::size_t TableAlignment(std::size_t bytes) noexcept
{
  return bytes < LargePage ? 64 : LargePage;
}
}

void* AllocateTable(std::size_t count, std::size_t size)
{
  if (count > (std::numeric_limits<std::size_t>::max() - LargePage) / size)
    throw std::bad_alloc();
  const std::size_t bytes = count * size, alignment = TableAlignment(bytes);
  const std::size_t whole = (bytes + alignment - 1) / alignment * alignment;
  void* table = ::operator new(whole, std::align_val_t(alignment));
#if defined(__linux__)
  if (alignment == LargePage)
    (void)madvise(table, whole, MADV_HUGEPAGE); // may fail: slower, nothing else
#endif
  return table;
}

void FreeTable(void* table, std::size_t bytes) noexcept
{
  ::operator delete(table, std::align_val_t(TableAlignment(bytes)));
}
}
