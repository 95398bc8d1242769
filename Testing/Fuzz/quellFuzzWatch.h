// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFuzzWatch_h
#define quellFuzzWatch_h

#include <cstdint>
#include <string>
#include <vector>

/// What a document may take: processor seconds, and memory. Sanitizers take four times the time, and more on a busy
/// machine; the thread sanitizer remembers several bytes for each one.
#if defined(__SANITIZE_THREAD__)
constexpr double FuzzSeconds = 60, FuzzMegabytes = 8192;
#elif defined(__SANITIZE_ADDRESS__)
constexpr double FuzzSeconds = 60, FuzzMegabytes = 1024;
#else
constexpr double FuzzSeconds = 10, FuzzMegabytes = 1024;
#endif

/// What a fuzz program is told: [--documents N] [--seed S] [--only N] [--seconds T] [--megabytes M] [--keep DIR]
/// PATH...
struct FuzzOptions
{
  std::uint64_t Documents = 10000, Seed = 1, Only = std::uint64_t(-1);
  double Seconds = FuzzSeconds, Megabytes = FuzzMegabytes;
  std::string Keep = ".";
  std::vector<std::string> Paths;
};
/// Exit status where the command line is wrong, else 0.
int ParseFuzzOptions(int argc, char** argv, const char* program, FuzzOptions& options);

/// A document, to be read under that name.
struct FuzzCase
{
  std::string Name, Text;
};

/// What is read, and the promises that hold.
class FuzzTarget
{
public:
  virtual ~FuzzTarget() = default;
  /// Documents that come first whatever their number: bombs and seeds.
  virtual std::uint64_t Fixed() const = 0;
  /// A function of n alone.
  virtual FuzzCase Make(std::uint64_t n) = 0;
  /// In the worker, before its first document.
  virtual void Begin() {}
  /// True: the document is good. Throws what promise was broken.
  virtual bool Check(const FuzzCase& document, std::uint64_t n) = 0;
};

/// A worker process reads document after document; this one watches it. A document is a finding when the worker crashes
/// on it (sanitizers end it too), takes longer than T seconds (processor seconds; twenty times as many of sleep count
/// as well) or more than M megabytes, or breaks a promise. Findings are written to DIR and made again by --only N.
/// Returns the exit status: 1 with findings.
int WatchFuzz(const FuzzOptions& options, FuzzTarget& target);

#endif
