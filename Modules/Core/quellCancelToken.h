// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCancelToken_h
#define quellCancelToken_h

#include <atomic>
#include <memory>

namespace quell
{
/// A request to stop that any thread (or a signal handler) may make. Cancel throws the frame away: stages poll it once
/// per tile. Finish keeps it: stages that sample stop after the pass at work and hand on what they have, all others
/// complete the frame as usual.
class CancelToken
{
public:
  void Cancel() noexcept { this->Cancelled.store(true, std::memory_order_relaxed); }
  void Finish() noexcept { this->Finishing.store(true, std::memory_order_relaxed); }
  /// Takes both back.
  void Reset() noexcept
  {
    this->Cancelled.store(false, std::memory_order_relaxed);
    this->Finishing.store(false, std::memory_order_relaxed);
  }
  /// Takes Cancel back.
  void ResetCancel() noexcept { this->Cancelled.store(false, std::memory_order_relaxed); }
  bool IsCancelled() const noexcept { return this->Cancelled.load(std::memory_order_relaxed); }
  bool IsFinishing() const noexcept { return this->Finishing.load(std::memory_order_relaxed); }

private:
  std::atomic<bool> Cancelled{ false }, Finishing{ false };
  static_assert(std::atomic<bool>::is_always_lock_free, "signal handlers set it");
};
}

#endif
