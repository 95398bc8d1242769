// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBenchMachine_h
#define quellBenchMachine_h

namespace quell
{
/// CPU time of the calling thread, in seconds.
double ThreadSeconds();
/// CPU time of all threads together, in seconds.
double ProcessSeconds();

/// What one thread of this machine can do, measured now (a tenth of a second).
struct MachinePeak
{
  double MultiplyAdds = 0; ///< float multiply-adds a second, in the widest vectors there are
  double Bandwidth = 0;    ///< bytes read and written a second by a copy far larger than the caches
  const char* Target = ""; ///< instruction set
  static MachinePeak Measure();
};
}

#endif
