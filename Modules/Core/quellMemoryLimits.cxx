// SPDX-License-Identifier: BSD-3-Clause
#include "quellMemoryLimits.h"

#include "quellStageDescription.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <fstream>
#include <limits>
#include <utility>

namespace quell
{
namespace
{
std::atomic<std::uint64_t> inUse{ 0 }, pixelLimit{ 0 }, sceneLimit{ 0 };

std::string Gigabytes(std::uint64_t bytes)
{
  char text[32];
  std::snprintf(
    text, sizeof text, bytes < 1000000000u ? "%.1f MB" : "%.1f GB", double(bytes) / (bytes < 1000000000u ? 1e6 : 1e9));
  return text;
}

std::uint64_t ReadMachineMemory()
{
  const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
  std::uint64_t bytes = pages > 0 && page > 0 ? std::uint64_t(pages) * std::uint64_t(page) : std::uint64_t(4) << 30;
  for (const char* file : { "/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes" })
  {
    std::ifstream stream(file);
    std::uint64_t limit = 0;
    if (stream >> limit && limit > 0) // "max" is no number
      bytes = std::min(bytes, limit);
  }
  rlimit space{};
  if (getrlimit(RLIMIT_AS, &space) == 0 && space.rlim_cur != RLIM_INFINITY)
    bytes = std::min<std::uint64_t>(bytes, space.rlim_cur);
  return bytes;
}
}

std::uint64_t MachineMemory()
{
  static const std::uint64_t bytes = ReadMachineMemory();
  return bytes;
}

std::uint64_t PixelMemoryLimit()
{
  const std::uint64_t set = pixelLimit;
  return set ? set : MachineMemory() / 4 * 3;
}

void SetPixelMemoryLimit(std::uint64_t bytes)
{
  pixelLimit = bytes;
}

std::uint64_t SceneMemoryLimit()
{
  const std::uint64_t set = sceneLimit;
  return set ? set : MachineMemory() / 2;
}

void SetSceneMemoryLimit(std::uint64_t bytes)
{
  sceneLimit = bytes;
}

std::uint64_t PixelMemoryInUse()
{
  return inUse;
}

namespace detail
{
bool ClaimPixels(std::uint64_t bytes) noexcept
{
  const std::uint64_t limit = PixelMemoryLimit();
  std::uint64_t now = inUse;
  do
  {
    if (bytes > limit || now > limit - bytes)
      return false;
  } while (!inUse.compare_exchange_weak(now, now + bytes));
  return true;
}

void ReleasePixels(std::uint64_t bytes) noexcept
{
  inUse -= bytes;
}

std::string PixelLimitText(std::uint64_t bytes, const std::string& what)
{
  return "pixels would take more memory than allowed: " + Gigabytes(bytes) + " for " + what + " on top of " +
         Gigabytes(inUse) + ", the limit is " + Gigabytes(PixelMemoryLimit()) +
         "; make the frame smaller, render it in regions, or allow more with --memory MB";
}
}

PixelMemoryClaim::PixelMemoryClaim(std::uint64_t bytes, const std::string& what)
{
  if (!detail::ClaimPixels(bytes))
    throw StageError(detail::PixelLimitText(bytes, what));
  this->Claimed = bytes;
}

PixelMemoryClaim::~PixelMemoryClaim()
{
  detail::ReleasePixels(this->Claimed);
}

PixelMemoryClaim::PixelMemoryClaim(PixelMemoryClaim&& other) noexcept
  : Claimed(std::exchange(other.Claimed, 0))
{
}

PixelMemoryClaim& PixelMemoryClaim::operator=(PixelMemoryClaim&& other) noexcept
{
  std::swap(this->Claimed, other.Claimed);
  return *this;
}
}
