// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCancelToken_h
#define quellCancelToken_h

#include <atomic>
#include <memory>

namespace quell
{
/// A request to stop that any thread (or a signal handler) may make; stages poll it once per tile.
class CancelToken
{
public:
  void Cancel() noexcept { this->Flag.store(true, std::memory_order_relaxed); }
  void Reset() noexcept { this->Flag.store(false, std::memory_order_relaxed); }
  bool IsCancelled() const noexcept { return this->Flag.load(std::memory_order_relaxed); }

private:
  std::atomic<bool> Flag{ false };
};
}

#endif
