// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellInterrupt_h
#define quellInterrupt_h

namespace quell
{
class CancelToken;

/// While it lives, SIGINT and SIGTERM act on a token: the first one finishes what is at work and prints `message`, the
/// second one cancels it, the third one ends the program. One at a time.
class InterruptScope
{
public:
  InterruptScope(CancelToken* token, const char* message);
  ~InterruptScope();
  InterruptScope(const InterruptScope&) = delete;
  void operator=(const InterruptScope&) = delete;
};
}

#endif
