// SPDX-License-Identifier: BSD-3-Clause
// quell-bench [--json FILE] [--seconds S] [--list] [NAME...]: runs the benchmarks whose names begin with a NAME (none:
// all), prints a table and writes bench.json.
#include "quellBench.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>

namespace quell
{
std::vector<BenchEntry>& BenchEntries()
{
  static std::vector<BenchEntry> entries;
  return entries;
}

namespace
{
double Now()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
}

std::vector<BenchTime> Bench::CompareFigures(const std::vector<std::function<double()>>& subjects) const
{
  std::vector<std::vector<double>> times(subjects.size());
  const double end = Now() + this->SecondsPerSubject * double(subjects.size());
  for (const auto& s : subjects)
    s();
  // interleaved, so that a slow moment of the machine hits all subjects alike
  for (int round = 0; round < 5 || (Now() < end && round < 1000); ++round)
    for (std::size_t i = 0; i < subjects.size(); ++i)
      times[i].push_back(subjects[i]());
  std::vector<BenchTime> out;
  for (std::vector<double>& t : times)
  {
    std::sort(t.begin(), t.end());
    BenchTime b;
    b.Seconds = t[t.size() / 2];
    b.Least = t.front();
    b.Spread = b.Seconds > 0 ? (t[t.size() * 3 / 4] - t[t.size() / 4]) / b.Seconds : 0;
    out.push_back(b);
  }
  return out;
}

std::vector<BenchTime> Bench::Compare(const std::vector<Subject>& subjects) const
{
  std::vector<std::function<double()>> figures;
  for (const Subject& s : subjects)
    figures.push_back(
      [&s]
      {
        const double start = Now();
        s.Run();
        return Now() - start;
      });
  return this->CompareFigures(figures);
}

void Bench::Report(const std::string& name, double value, const std::string& unit, const std::string& against,
  double ratio, double spread, const std::string& note)
{
  this->Results.push_back({ name, value, unit, against, ratio, spread, note });
  std::printf("%-52s %10.4g %-12s", name.c_str(), value, unit.c_str());
  if (!against.empty())
    std::printf(" %6.3f of %s", ratio, against.c_str());
  if (spread > 0)
    std::printf("  (+-%.0f %%)", 50 * spread);
  if (!note.empty())
    std::printf("  %s", note.c_str());
  std::printf("\n");
  std::fflush(stdout);
}

void Bench::Say(const std::string& text) const
{
  std::printf("%s\n", text.c_str());
  std::fflush(stdout);
}
}

int main(int argc, char** argv)
{
  using namespace quell;
  std::string json = "bench.json";
  std::vector<std::string> names;
  Bench bench;
  std::vector<BenchEntry> entries = BenchEntries();
  std::sort(entries.begin(), entries.end(), [](const BenchEntry& a, const BenchEntry& b) { return a.Name < b.Name; });
  for (int i = 1; i < argc; ++i)
  {
    if (!std::strcmp(argv[i], "--json") && i + 1 < argc)
      json = argv[++i];
    else if (!std::strcmp(argv[i], "--seconds") && i + 1 < argc)
      bench.SecondsPerSubject = std::atof(argv[++i]);
    else if (!std::strcmp(argv[i], "--list"))
    {
      for (const BenchEntry& e : entries)
        std::printf("%-30s %s\n", e.Name.c_str(), e.Brief.c_str());
      return 0;
    }
    else if (argv[i][0] == '-')
    {
      std::fprintf(stderr, "usage: quell-bench [--json FILE] [--seconds S] [--list] [NAME...]\n");
      return 2;
    }
    else
      names.push_back(argv[i]);
  }
  bool any = false, failed = false;
  for (const BenchEntry& e : entries)
  {
    bool wanted = names.empty();
    for (const std::string& n : names)
      wanted |= e.Name.compare(0, n.size(), n) == 0;
    if (!wanted)
      continue;
    any = true;
    std::printf("\n%s: %s\n", e.Name.c_str(), e.Brief.c_str());
    try
    {
      e.Run(bench);
    }
    catch (const std::exception& x)
    {
      std::fprintf(stderr, "%s failed: %s\n", e.Name.c_str(), x.what());
      failed = true;
    }
  }
  if (!any)
  {
    std::fprintf(stderr, "no benchmark of that name; --list shows them\n");
    return 2;
  }
  nlohmann::json list = nlohmann::json::array();
  for (const Bench::Row& r : bench.Rows())
  {
    nlohmann::json row = { { "name", r.Name }, { "value", r.Value }, { "unit", r.Unit } };
    if (!r.Against.empty())
    {
      row["against"] = r.Against;
      row["ratio"] = r.Ratio;
    }
    if (r.Spread > 0)
      row["spread"] = r.Spread;
    if (!r.Note.empty())
      row["note"] = r.Note;
    list.push_back(row);
  }
  std::ofstream file(json);
  file << list.dump(2) << "\n";
  if (!file)
  {
    std::fprintf(stderr, "cannot write %s\n", json.c_str());
    return 1;
  }
  return failed ? 1 : 0;
}
