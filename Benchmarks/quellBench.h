// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellBench_h
#define quellBench_h

#include <functional>
#include <string>
#include <vector>

/// Small benchmarks that compare things within one run. A file Bench*.cxx in this folder writes
///
///   QUELL_BENCHMARK("box-blur", "box filter of one megapixel against a copy")
///   {
///     const auto t = bench.Compare({ { "filter", [&] { ... } }, { "copy", [&] { ... } } });
///     bench.Report("box-blur 1 Mpixel", 1 / t[0].Seconds, "Mpixel/s", "copy", t[1].Seconds / t[0].Seconds);
///   }
namespace quell
{
struct BenchTime
{
  double Seconds = 0; ///< median of the wall-clock times
  double Least = 0;
  double Spread = 0; ///< (third quartile - first quartile) / median
};

class Bench
{
public:
  struct Row
  {
    std::string Name;
    double Value = 0;
    std::string Unit, Against;
    double Ratio = 0;  ///< value / that of `Against`, measured in the same run; 0: none
    double Spread = 0; ///< of the value; 0: not a time
    std::string Note;
  };
  struct Subject
  {
    std::string Name;
    std::function<void()> Run;
  };

  double SecondsPerSubject = 1.5; ///< measuring time spent on each subject of Compare

  /// Runs the subjects in turn, again and again (first round: warm-up, not counted).
  std::vector<BenchTime> Compare(const std::vector<Subject>& subjects) const;
  /// The same over figures that the subjects return (seconds): for subjects that time a part of what they do.
  std::vector<BenchTime> CompareFigures(const std::vector<std::function<double()>>& subjects) const;

  void Report(const std::string& name, double value, const std::string& unit, const std::string& against = "",
    double ratio = 0, double spread = 0, const std::string& note = "");
  /// A line for readers, not for bench.json.
  void Say(const std::string& text) const;
  const std::vector<Row>& Rows() const { return this->Results; }

private:
  std::vector<Row> Results;
};

struct BenchEntry
{
  std::string Name, Brief;
  void (*Run)(Bench&);
};
std::vector<BenchEntry>& BenchEntries();
struct BenchRegistration
{
  BenchRegistration(const char* name, const char* brief, void (*run)(Bench&))
  {
    BenchEntries().push_back({ name, brief, run });
  }
};
}

#define QUELL_BENCH_JOIN2(a, b) a##b
#define QUELL_BENCH_JOIN(a, b) QUELL_BENCH_JOIN2(a, b)
#define QUELL_BENCHMARK(name, brief)                                            \
  static void QUELL_BENCH_JOIN(BenchBody, __LINE__)(quell::Bench & bench);      \
  static const quell::BenchRegistration QUELL_BENCH_JOIN(BenchEntry, __LINE__)( \
    name, brief, &QUELL_BENCH_JOIN(BenchBody, __LINE__));                       \
  static void QUELL_BENCH_JOIN(BenchBody, __LINE__)(quell::Bench & bench)

#endif
