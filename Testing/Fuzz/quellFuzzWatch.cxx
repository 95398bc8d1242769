// SPDX-License-Identifier: BSD-3-Clause
#include "quellFuzzWatch.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <poll.h>
#include <stdexcept>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace
{
/// Resident memory has no number of its own but its highest; of this process, in megabytes.
double Peak()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return double(usage.ru_maxrss) / 1024;
}

/// What the worker tells; in a pipe, a line each.
struct Report
{
  std::uint64_t Number = 0;
  char Kind = ' '; ///< 's'tarted, 'a'ccepted, 'r'efused, 'f'inding
  char Text[480] = {};
};

/// Documents from `first` on, until the memory is used up.
[[noreturn]] void Work(const FuzzOptions& a, FuzzTarget& target, std::uint64_t first, std::uint64_t end, int pipe)
{
  target.Begin();
  Report report;
  const auto tell = [&](char kind, const std::string& text)
  {
    report.Kind = kind;
    std::memset(report.Text, 0, sizeof report.Text);
    text.copy(report.Text, sizeof report.Text - 1);
    if (write(pipe, &report, sizeof report) != ssize_t(sizeof report))
      _exit(3);
  };
  for (std::uint64_t n = first; n < end; ++n)
  {
    const FuzzCase document = target.Make(n);
    report.Number = n;
    tell('s', "");
    const double before = Peak();
    try
    {
      const bool good = target.Check(document, n);
      // The worker's own peak grows slowly with the heap; a document that doubles it is another matter.
      if (Peak() - before > a.Megabytes)
        tell('f', "memory: " + std::to_string(int(Peak() - before)) + " MB");
      else
        tell(good ? 'a' : 'r', "");
    }
    catch (const std::exception& e)
    {
      tell('f', std::string("promise: ") + e.what());
    }
    if (Peak() > 2 * a.Megabytes)
      break; // a fresh worker goes on
  }
  _exit(0);
}

/// Processor seconds that a process has used: a busy machine is no finding.
double ProcessorSeconds(pid_t process)
{
  clockid_t clock;
  timespec time{};
  if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &time) != 0)
    return 0;
  return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

std::string KindOf(const std::string& what)
{
  return what.substr(0, what.find(':'));
}

}

int ParseFuzzOptions(int argc, char** argv, const char* program, FuzzOptions& a)
{
  for (int i = 1; i < argc; ++i)
  {
    const std::string name = argv[i];
    if (name.compare(0, 2, "--") != 0)
    {
      a.Paths.push_back(name);
      continue;
    }
    const char* value = ++i < argc ? argv[i] : nullptr;
    if (!value)
    {
      std::cerr << program << ": " << name << " wants a value\n";
      return 2;
    }
    if (name == "--documents")
      a.Documents = std::strtoull(value, nullptr, 10);
    else if (name == "--seed")
      a.Seed = std::strtoull(value, nullptr, 10);
    else if (name == "--only")
      a.Only = std::strtoull(value, nullptr, 10);
    else if (name == "--seconds")
      a.Seconds = std::strtod(value, nullptr);
    else if (name == "--megabytes")
      a.Megabytes = std::strtod(value, nullptr);
    else if (name == "--keep")
      a.Keep = value;
    else
    {
      std::cerr << program << ": no option " << name << "\n";
      return 2;
    }
  }
  return 0;
}

int WatchFuzz(const FuzzOptions& a, FuzzTarget& target)
{
  std::uint64_t next = 0, end = target.Fixed() + a.Documents;
  if (a.Only != std::uint64_t(-1))
  {
    next = a.Only;
    end = a.Only + 1;
  }
  const std::uint64_t total = end - next;
  std::uint64_t accepted = 0, refused = 0, findings = 0, told = 0;
  double slowest = 0;
  std::uint64_t slowestNumber = 0;
  const auto finding = [&](std::uint64_t n, const std::string& what)
  {
    ++findings;
    const FuzzCase document = target.Make(n);
    const std::size_t slash = document.Name.find_last_of('/'), dot = document.Name.find_last_of('.');
    const std::string extension =
      dot == std::string::npos || (slash != std::string::npos && dot < slash) ? "" : document.Name.substr(dot);
    const std::string file = a.Keep + "/finding-" + KindOf(what) + "-" + std::to_string(n) + extension;
    std::ofstream(file, std::ios::binary) << document.Text;
    std::cout << "document " << n << " (" << document.Name << "): " << what << "\n  kept as " << file << "\n";
  };
  const auto begin = std::chrono::steady_clock::now();
  while (next < end)
  {
    int ends[2];
    if (pipe(ends) != 0)
      throw std::runtime_error("no pipe");
    std::cout.flush();
    const pid_t child = fork();
    if (child < 0)
      throw std::runtime_error("no process");
    if (child == 0)
    {
      close(ends[0]);
      Work(a, target, next, end, ends[1]);
    }
    close(ends[1]);
    bool busy = false; // with document `next`
    double started = 0;
    auto startedAt = std::chrono::steady_clock::now();
    for (;;)
    {
      pollfd wait{ ends[0], POLLIN, 0 };
      const int ready = poll(&wait, 1, 1000);
      if (ready == 0)
      {
        // The first document waits for the program itself as well; a process that sleeps for ever hangs too.
        const double slept =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - startedAt).count() / (busy ? 20 : 100);
        if (std::max(slept, ProcessorSeconds(child) - started) < a.Seconds + (busy ? 0 : 60))
          continue;
      }
      Report report;
      if (ready > 0 && read(ends[0], &report, sizeof report) == ssize_t(sizeof report))
      {
        const double then = ProcessorSeconds(child);
        if (report.Kind == 's')
          busy = true;
        else
        {
          const double seconds = then - started;
          if (seconds > slowest && busy)
          {
            slowest = seconds;
            slowestNumber = report.Number;
          }
          accepted += report.Kind == 'a';
          refused += report.Kind == 'r';
          if (report.Kind == 'f')
            finding(report.Number, report.Text);
          next = report.Number + 1;
          busy = false;
        }
        started = then;
        startedAt = std::chrono::steady_clock::now();
        const std::uint64_t done = total - (end - next);
        if (done * 20 / total > told)
        {
          told = done * 20 / total;
          std::cout << done << " of " << total << ": " << accepted << " load, " << refused << " are refused, "
                    << findings << " findings" << std::endl;
        }
        continue;
      }
      const bool slow = ready == 0;
      if (slow)
        kill(child, SIGKILL);
      int status = 0;
      waitpid(child, &status, 0);
      if (slow || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
      {
        finding(next, slow                  ? "hang: more than " + std::to_string(int(a.Seconds)) + " processor seconds"
                      : WIFSIGNALED(status) ? "crash: signal " + std::to_string(WTERMSIG(status))
                                            : "crash: exit status " + std::to_string(WEXITSTATUS(status)));
        ++next;
      }
      break;
    }
    close(ends[0]);
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::cout << total << " documents of seed " << a.Seed << " in " << int(seconds) << " s: " << accepted << " load, "
            << refused << " are refused, " << findings << " findings; the slowest, " << slowestNumber << ", took "
            << slowest << " s" << std::endl;
  return findings ? 1 : 0;
}
