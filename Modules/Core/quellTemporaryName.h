// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTemporaryName_h
#define quellTemporaryName_h

#include <atomic>
#include <filesystem>
#include <string>
#include <unistd.h>

namespace quell
{
/// Under what a file is written before it is renamed to `target`: `.NAME.PID-N.part` in the same directory, hidden, and
/// another one at every call. NAME is cut to 200 bytes: with all of a long one no file could be made.
inline std::string TemporaryName(const std::string& target)
{
  static std::atomic<unsigned> counter{ 0 };
  const std::filesystem::path path(target);
  const std::string name = "." + path.filename().string().substr(0, 200) + "." + std::to_string(getpid()) + "-" +
                           std::to_string(counter++) + ".part";
  return (path.parent_path() / name).string();
}
}

#endif
