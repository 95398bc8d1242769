// SPDX-License-Identifier: BSD-3-Clause
#include "quellInterrupt.h"

#include "quellCancelToken.h"

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
  if (!interruptedToken->IsFinishing())
  {
    interruptedToken->Finish();
    if (write(STDERR_FILENO, "\n", 1) < 0 || write(STDERR_FILENO, interruptedText, std::strlen(interruptedText)) < 0 ||
        write(STDERR_FILENO, "\n", 1) < 0)
    {
      return; // nobody reads it
    }
  }
  else
  {
    interruptedToken->Cancel();
    std::signal(signal, SIG_DFL);
  }
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
