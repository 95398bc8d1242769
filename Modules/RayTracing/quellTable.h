// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTable_h
#define quellTable_h

#include "vtkQuellRayTracingModule.h"

#include <cstddef>
#include <vector>

namespace quell
{
/// Memory for tables; whole cache lines, and large pages for large ones where the system has any.
VTKQUELLRAYTRACING_EXPORT void* AllocateTable(std::size_t count, std::size_t size);
VTKQUELLRAYTRACING_EXPORT void FreeTable(void* table, std::size_t bytes) noexcept;

/// Large tables are read all over, and looking up the page costs as much as the read.
template <class T>
struct TableAllocator
{
  using value_type = T;
  TableAllocator() = default;
  template <class U>
  TableAllocator(const TableAllocator<U>&) noexcept
  {
  }
  T* allocate(std::size_t n) { return static_cast<T*>(AllocateTable(n, sizeof(T))); }
  void deallocate(T* p, std::size_t n) noexcept { FreeTable(p, n * sizeof(T)); }
  bool operator==(const TableAllocator&) const noexcept { return true; }
  bool operator!=(const TableAllocator&) const noexcept { return false; }
};
template <class T>
using Table = std::vector<T, TableAllocator<T>>;
}

#endif
