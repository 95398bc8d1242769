// SPDX-License-Identifier: BSD-3-Clause
#include "quellInterrupt.h"

#include "quellCancelToken.h"

#include <cerrno>
#include <csignal>
#include <cstring>
#include <unistd.h>

namespace quell
{
namespace
{
CancelToken* interruptedToken = nullptr;
const char* interruptedText = "";

extern "C" void HandleInterrupt(int signal)
{
  if (!interruptedToken)
  {
    return;
  }
  const int before = errno; // of what it came in between
  if (!interruptedToken->IsFinishing())
  {
    interruptedToken->Finish();
    // Where nobody reads it there is nothing to do about it.
    const bool told = write(STDERR_FILENO, "\n", 1) > 0 &&
                      write(STDERR_FILENO, interruptedText, std::strlen(interruptedText)) > 0 &&
                      write(STDERR_FILENO, "\n", 1) > 0;
    static_cast<void>(told);
  }
  else
  {
    interruptedToken->Cancel();
    std::signal(signal, SIG_DFL);
  }
  errno = before;
}
}

InterruptScope::InterruptScope(CancelToken* token, const char* message)
{
  interruptedText = message;
  interruptedToken = token;
  std::signal(SIGINT, HandleInterrupt);
  std::signal(SIGTERM, HandleInterrupt);
}

InterruptScope::~InterruptScope()
{
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  interruptedToken = nullptr;
}
}
