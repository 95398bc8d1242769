// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellMemoryLimits_h
#define quellMemoryLimits_h

#include "vtkQuellCoreModule.h"

#include <cstdint>
#include <string>

/// What pixels and scenes may take of the machine's memory. Numbers in a file (a width, a texture's size, a count of
/// instances) decide how much is asked for: without a limit a few bytes of text bring a machine to a halt. Limits hold
/// for the process, may be set at any time from any thread, and are checked before memory is asked for.
namespace quell
{
/// Bytes that this process can have: the machine's memory, or less where the system says so (cgroup, RLIMIT_AS).
VTKQUELLCORE_EXPORT std::uint64_t MachineMemory();

///@{ Bytes of pixels held at one time: arrays between stages, scratch planes, sums of the path tracer. Default three
/// quarters of MachineMemory(). 0 sets the default again.
VTKQUELLCORE_EXPORT std::uint64_t PixelMemoryLimit();
VTKQUELLCORE_EXPORT void SetPixelMemoryLimit(std::uint64_t bytes);
///@}

///@{ Bytes that reading one scene may make: vertices, textures, instances. Default half of MachineMemory(). 0 sets the
/// default again.
VTKQUELLCORE_EXPORT std::uint64_t SceneMemoryLimit();
VTKQUELLCORE_EXPORT void SetSceneMemoryLimit(std::uint64_t bytes);
///@}

/// Pixel memory that is not TakePixelMemory's, counted with it while this lives. Throws StageError where it would
/// exceed the limit; `what` needs it ("the sums of the path tracer").
class VTKQUELLCORE_EXPORT PixelMemoryClaim
{
public:
  PixelMemoryClaim() = default;
  PixelMemoryClaim(std::uint64_t bytes, const std::string& what);
  ~PixelMemoryClaim();
  PixelMemoryClaim(PixelMemoryClaim&& other) noexcept;
  PixelMemoryClaim& operator=(PixelMemoryClaim&& other) noexcept;
  std::uint64_t Bytes() const { return this->Claimed; }

private:
  std::uint64_t Claimed = 0;
};

/// Bytes in use by all claims and TakePixelMemory.
VTKQUELLCORE_EXPORT std::uint64_t PixelMemoryInUse();

namespace detail
{
/// False, and nothing is counted, where the limit would be exceeded.
bool ClaimPixels(std::uint64_t bytes) noexcept;
void ReleasePixels(std::uint64_t bytes) noexcept;
/// "12.9 GB more for `what` ... --memory".
std::string PixelLimitText(std::uint64_t bytes, const std::string& what);
}
}

#endif
