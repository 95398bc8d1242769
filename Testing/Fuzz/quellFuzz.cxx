// SPDX-License-Identifier: BSD-3-Clause
// quell-fuzz [--documents N] [--seed S] [--only N] [--seconds T] [--megabytes M] [--keep DIR] FILE|DIRECTORY...
//
// Reads mutated pipeline files with every stage type in place. A worker process does it; this one watches. A document
// is a finding when the worker crashes on it (sanitizers end it too), takes longer than T seconds or more than M
// megabytes, or breaks a promise:
// (processor seconds; ten times as many of sleep count as well)
// - loading ends with a graph or with an error that says where; messages are one line of readable text each, not too
// long;
// - what was read can be written, and reads back as the same document;
// - a file that loads is valid for the schema; its self-contained form loads as well; a plan of it can be made.
// Findings are written to DIR and made again by --only N.
#include "../AllStages.h"
#include "../Graphs/SchemaTools.h"
#include "quellExplain.h"
#include "quellFuzz.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"
#include "quellPipelineSchema.h"
#include "quellPipelineWriter.h"
#include "quellProvenance.h"
#include "quellXmlDocument.h"
#include "vtkObject.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <poll.h>
#include <sstream>
#include <stdexcept>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
struct Arguments
{
  std::uint64_t Documents = 10000, Seed = 1, Only = std::uint64_t(-1);
  double Seconds = 10, Megabytes = 1024;
  std::string Keep = ".";
  std::vector<std::string> Paths;
};

std::string Contents(const fs::path& file)
{
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

std::vector<FuzzSeed> ReadSeeds(const std::vector<std::string>& paths)
{
  std::vector<fs::path> files;
  for (const std::string& path : paths)
  {
    if (!fs::is_directory(path))
      files.push_back(path);
    else
      for (const auto& entry : fs::directory_iterator(path))
        if (entry.path().extension() == ".xml")
          files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end()); // directories have no order of their own
  std::vector<FuzzSeed> seeds;
  for (const fs::path& file : files)
    seeds.push_back({ file.string(), Contents(file) });
  return seeds;
}

/// Resident memory has no number of its own but its highest; of this process, in megabytes.
double Peak()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return double(usage.ru_maxrss) / 1024;
}

/// Throws what promise was broken. True: the file loads.
bool CheckDocument(const FuzzSeed& document, const SchemaValidator& schema, const std::string& wanted)
{
  const auto promise = [](bool kept, const std::string& what)
  {
    if (!kept)
      throw std::runtime_error(what);
  };
  Diagnostics messages;
  const auto read = ReadPipelineText(document.Text, document.File, messages);
  promise(read != nullptr, "no document");
  const bool parsed = read->Place.Line > 0;
  promise(parsed || messages.HasErrors(), "neither a document nor an error");
  Diagnostics grammar = messages;
  std::shared_ptr<Graph> graph;
  if (parsed)
    graph = BuildGraph(read, Registry(), {}, messages);
  messages.Sort();
  std::size_t length = 0;
  for (const Diagnostic& d : messages.All())
  {
    const std::string text = d.ToText();
    length = std::max(length, text.size());
    promise(!d.What.empty() && !d.Place.File.empty(), "an error without words or file");
    promise(d.Place.Line > 0 || document.Text.size() > XmlLimits().Bytes, "an error without a line: " + text);
    for (char c : d.Where + d.What + d.Hint)
      promise((unsigned char)c >= 0x20 && c != 0x7F, "an error with control characters: " + text);
  }
  promise(length < 20000, "an error of " + std::to_string(length) + " characters");
  promise(wanted.empty() || messages.ToText().find(wanted) != std::string::npos,
    "no message \"" + wanted + "\" in\n" + messages.ToText().substr(0, 2000));
  if (parsed && !grammar.HasErrors())
  {
    const std::string text = WritePipelineText(*read);
    Diagnostics again;
    const auto second = ReadPipelineText(text, document.File, again);
    // Escapes and indentation make the text longer: past the limit there is nothing to compare.
    promise(
      *second == *read || text.size() > XmlLimits().Bytes, "what was written reads differently\n" + again.ToText());
  }
  if (messages.HasErrors())
    return false;
  promise(graph != nullptr, "no graph and no error");
  promise(graph->Order.size() == graph->Nodes.size(), "nodes without a place in the order");
  const std::string invalid = schema.Check(document.Text);
  promise(invalid.empty(), "loads, but is not valid for the schema: " + invalid);
  Diagnostics own;
  const auto record = SelfContained(*graph, Registry(), own);
  promise(!own.HasErrors(), "no self-contained form: " + own.ToText());
  const auto reread = ReadPipelineText(WritePipelineText(*record), "/elsewhere/x.exr", own);
  const auto rebuilt = BuildGraph(reread, Registry(), {}, own);
  promise(!own.HasErrors(), "the self-contained form has mistakes: " + own.ToText());
  // Plans open files and walk the graph from node to node: one document in four, and not the longest chains.
  if (graph->Nodes.size() < 1000 && document.Text.size() % 4 == 0)
  {
    PipelineExecutor executor(graph, Registry());
    PlanText(MakePlan(executor, {}, graph->Ticks.First, graph->Ticks.First + 1));
  }
  return true;
}

/// What the worker tells; in a pipe, a line each.
struct Report
{
  std::uint64_t Number = 0;
  char Kind = ' '; ///< 's'tarted, 'a'ccepted, 'r'efused, 'f'inding
  char Text[480] = {};
};

const std::vector<FuzzBomb>& Bombs()
{
  static const std::vector<FuzzBomb> bombs = FuzzBombs();
  return bombs;
}

FuzzSeed Document(std::uint64_t n, FuzzMutator& mutator, const std::vector<FuzzSeed>& seeds, std::string& wanted)
{
  wanted.clear();
  if (n < Bombs().size())
  {
    const FuzzBomb& bomb = Bombs()[n];
    wanted = bomb.Message;
    return { (fs::path(seeds.front().File).parent_path() / "bomb.xml").string(), bomb.Text };
  }
  n -= Bombs().size();
  return n < seeds.size() ? seeds[n] : mutator.Make(n);
}

/// Documents from `first` on, until the memory is used up.
[[noreturn]] void Work(
  const Arguments& a, const std::vector<FuzzSeed>& seeds, std::uint64_t first, std::uint64_t end, int pipe)
{
  vtkObject::GlobalWarningDisplayOff();
  const SchemaValidator schema(PipelineXsd(Registry()));
  FuzzMutator mutator(seeds, a.Seed);
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
    std::string wanted;
    const FuzzSeed document = Document(n, mutator, seeds, wanted);
    report.Number = n;
    tell('s', "");
    const double before = Peak();
    try
    {
      const bool good = CheckDocument(document, schema, wanted);
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

int Run(const Arguments& a)
{
  const std::vector<FuzzSeed> seeds = ReadSeeds(a.Paths);
  if (seeds.empty())
  {
    std::cerr << "quell-fuzz: no seeds\n";
    return 2;
  }
  FuzzMutator mutator(seeds, a.Seed);
  std::uint64_t next = 0, end = Bombs().size() + seeds.size() + a.Documents;
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
    std::string wanted;
    const FuzzSeed document = Document(n, mutator, seeds, wanted);
    const std::string file = a.Keep + "/finding-" + KindOf(what) + "-" + std::to_string(n) + ".xml";
    std::ofstream(file, std::ios::binary) << document.Text;
    std::cout << "document " << n << " (" << (n < Bombs().size() ? Bombs()[n].Name : document.File) << "): " << what
              << "\n  kept as " << file << "\n";
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
      Work(a, seeds, next, end, ends[1]);
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
}

int main(int argc, char** argv)
{
  Arguments a;
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
      std::cerr << "quell-fuzz: " << name << " wants a value\n";
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
      std::cerr << "quell-fuzz: no option " << name << "\n";
      return 2;
    }
  }
  try
  {
    return Run(a);
  }
  catch (const std::exception& e)
  {
    std::cerr << "quell-fuzz: " << e.what() << "\n";
    return 2;
  }
}
