// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPixelMemory_h
#define quellPixelMemory_h

#include "vtkQuellCoreModule.h"

#include <cstddef>

namespace quell
{
/// Memory of output arrays and of scratch planes, used again: frame after frame the same sizes are asked for, and fresh
/// pages from the system cost as much as a cheap stage (they are cleared before a stage fills them). Blocks begin at 64
/// bytes. Large ones ask for large pages: a filter reads dozens of rows at once, each on a page of its own, and with
/// small pages a fifth of its time goes into finding them. Safe from any thread.
///
/// What nobody uses is kept while there are PixelMemoryKept bytes of it or less, or while it and what is in use are no
/// more than was in use at once before; a peak is forgotten after some thousand blocks were given back.
constexpr std::size_t PixelMemoryKept = std::size_t(64) << 20;
/// Contents are arbitrary. Throws std::bad_alloc, and StageError beyond PixelMemoryLimit() (quellMemoryLimits.h).
VTKQUELLCORE_EXPORT float* TakePixelMemory(std::size_t floats);
VTKQUELLCORE_EXPORT void GivePixelMemory(void* memory) noexcept;
/// Bytes that are kept and used by nobody.
VTKQUELLCORE_EXPORT std::size_t PixelMemoryWaiting() noexcept;
/// Another number than PixelMemoryKept: where memory is short, 0. Returns the one before.
VTKQUELLCORE_EXPORT std::size_t KeepPixelMemory(std::size_t bytes) noexcept;
}

#endif
