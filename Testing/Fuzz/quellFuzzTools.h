// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFuzzTools_h
#define quellFuzzTools_h

#include "quellFuzzWatch.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

/// A file's bytes; none of a file that cannot be read.
std::string Contents(const std::filesystem::path& file);
/// Throws where the file cannot be written.
void Save(const std::filesystem::path& file, const std::string& text);

/// Throws `what` where the promise was not kept.
void Promise(bool kept, const std::string& what);
/// No control characters: fit for one line of a terminal.
bool IsReadable(const std::string& text);
/// Promises of a message to the user: readable, not too long, and `word`, mostly the file's name, is in it.
void CheckMessage(const std::string& text, const std::string& word);

/// The files named, and those of the directories named (not of the ones within), in an order that does not depend on
/// the file system. Of directories: the files with that extension ("": with any).
std::vector<std::filesystem::path> SeedFiles(const std::vector<std::string>& paths, const std::string& extension = "");

/// The random numbers that document n is made with: functions of (seed, n) alone.
class FuzzRandom
{
public:
  explicit FuzzRandom(std::uint64_t seed)
    : Seed(seed)
  {
  }
  /// Before document n.
  void Begin(std::uint64_t n);
  std::uint64_t Any() { return this->Numbers(); }
  /// In [0, n); 0 where n is.
  std::size_t Below(std::size_t n) { return n ? std::size_t(this->Numbers() % n) : 0; }

private:
  std::uint64_t Seed;
  std::mt19937_64 Numbers;
};

/// The whole of a program that makes seeds: reads the command line, has `write` write the seeds into a directory that
/// is gone afterwards, and watches the target made from them and from the files named. `write` is run in a process of
/// its own, so that the libraries' threads end before workers are forked. Seeds are called by their file's name without
/// the directory; empty ones are left out. Returns the exit status: 1 with findings, 2 where there is nothing to run.
using MakeFuzzTarget = std::function<std::unique_ptr<FuzzTarget>(
  const std::filesystem::path& directory, std::vector<FuzzCase> seeds, std::uint64_t seed)>;
int RunFuzz(int argc, char** argv, const char* program, const std::function<void(const std::filesystem::path&)>& write,
  const MakeFuzzTarget& make);

#endif
