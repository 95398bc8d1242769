// SPDX-License-Identifier: BSD-3-Clause
// quell-numerics-report SOURCE_DIRECTORY           writes the made parts of Documentation/numerics.md
// quell-numerics-report SOURCE_DIRECTORY --check   exit status 1 where they are stale: another list of cases, a stage
//                                                  without a row, errors larger than those that stand there
#include "../Threads.h"
#include "References.h"
#include "quellSimd.h"
#include "vtkQuellImageReader.h"
#include "vtkQuellImageWriter.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace
{
using quelltest::Case;
using quelltest::Plane;

double CpuSeconds()
{
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

std::string Number(double v, const char* format = "%.1e")
{
  char text[32];
  std::snprintf(text, sizeof text, format, v);
  return v == 0 ? "0" : text;
}

std::unique_ptr<PortBench> Prepare(const Case& c, int w, int h)
{
  auto bench = std::make_unique<PortBench>(c.Type, w, h, c.LeaveOut);
  std::istringstream settings(c.Settings);
  for (std::string s; settings >> s;)
  {
    std::string error;
    const auto equals = s.find('=');
    if (!bench->Stage->SetPropertyText(s.substr(0, equals), s.substr(equals + 1), error))
      throw std::runtime_error(c.Type + ": " + error);
  }
  bench->Outputs = { c.Output };
  // Samples of one pixel have features of their own, not the same ones.
  for (PortBench::Feed& feed : bench->Feeds)
    if (feed.Kind == quell::ArrayKind::Normal && c.Type == "NormalSnap")
      feed.Source->Change = [](int x, int, float* v, int n)
      {
        for (int k = 0; k < n; ++k)
          v[k] *= x % 7 == 3 ? 0.8f : 1.f; // mixed pixels
      };
  return bench;
}

struct Measured
{
  double Worst = 0;       ///< |a - b| / (|b| + a thousandth of the image's largest)
  double Smape = 0;       ///< mean of |a - b| / (|a| + |b| + 0.01)
  double Nanoseconds = 0; ///< a pixel, one thread
  double Slower = 0;      ///< the reference takes so many times as long
  double Bytes = 0;       ///< a pixel: outputs
};

Measured Errors(const Case& c, int w, int h)
{
  const auto bench = Prepare(c, w, h);
  if (!bench->Run())
    throw std::runtime_error(c.Type + ": " + bench->Stage->GetErrorText());
  const std::vector<float> a = bench->Read().at(c.Output);
  const double start = CpuSeconds();
  const Plane b = c.Reference(*bench);
  Measured m;
  m.Slower = (CpuSeconds() - start) / (double(w) * h);
  if (a.size() != b.v.size())
    throw std::runtime_error(c.Type + ": the reference has another shape");
  double largest = 0;
  for (double v : b.v)
    largest = std::max(largest, std::fabs(v));
  for (std::size_t i = 0; i < a.size(); ++i)
  {
    const double d = std::fabs(a[i] - b.v[i]);
    if (!(d >= 0))
      throw std::runtime_error(c.Type + ": not a number");
    if (d / (std::fabs(b.v[i]) + 1e-3 * largest) > m.Worst && std::getenv("QUELL_WORST"))
      std::cerr << c.Type << " " << i / (a.size() / (std::size_t(w) * h)) % w << " "
                << i / (a.size() / (std::size_t(w) * h)) / w << ": " << a[i] << " " << b.v[i] << "\n";
    m.Worst = std::max(m.Worst, d / (std::fabs(b.v[i]) + 1e-3 * largest));
    m.Smape += d / (std::fabs(double(a[i])) + std::fabs(b.v[i]) + 0.01) / double(a.size());
  }
  return m;
}

Measured Measure(const Case& c)
{
  Measured m = Errors(c, 67, 53);
  const int w = 320, h = 240;
  ::quelltest::WithThreads(1,
    [&]
    {
      const auto bench = Prepare(c, w, h);
      double best = 1e300;
      for (int k = 0; k < 5; ++k)
      {
        bench->Stage->Modified();
        const double before = CpuSeconds();
        if (!bench->Run())
          throw std::runtime_error(bench->Stage->GetErrorText());
        if (k > 0) // the first one makes its memory
          best = std::min(best, CpuSeconds() - before);
      }
      m.Nanoseconds = best * 1e9 / (double(w) * h);
      vtkImageData* image = bench->Stage->GetOutput();
      m.Bytes = 4. * image->GetPointData()->GetArray(c.Output.c_str())->GetNumberOfComponents();
    });
  m.Slower = m.Slower * 1e9 / m.Nanoseconds;
  return m;
}

std::string StageTable()
{
  std::ostringstream out;
  out << "Noise on two surfaces with features and background, " << quell::SimdTargetName()
      << ", one thread. *largest error*: over pixels and channels, relative to the value plus a thousandth of the "
         "image's largest; *SMAPE*: the mean, as the metric. *double*: the same formula in double, a value at a time, "
         "takes so many times as long; its arrays take twice the memory.\n\n"
      << "| stage | output | largest error | SMAPE | ns a pixel | double | bytes a pixel "
         "|\n|---|---|---:|---:|---:|---:|---:|\n";
  for (const Case& c : quelltest::Cases())
  {
    std::cerr << c.Type << "\n";
    if (!c.Reference)
    {
      out << "| " << c.Type << " | | | | | | " << c.Reason << " |\n";
      continue;
    }
    const Measured m = Measure(c);
    out << "| " << c.Type << " | " << c.Output << " | " << Number(m.Worst) << " | " << Number(m.Smape) << " | "
        << Number(m.Nanoseconds, m.Nanoseconds < 10 ? "%.1f" : "%.0f") << " | "
        << Number(m.Slower, m.Slower < 10 ? "%.1f" : "%.0f") << " x | " << Number(m.Bytes, "%.0f") << " |\n";
  }
  return out.str();
}

/// As half precision has it, for values in its normal range.
float Half(float v)
{
  std::uint32_t bits;
  std::memcpy(&bits, &v, 4);
  bits = (bits + 0xfffu + (bits >> 13 & 1u)) & ~0x1fffu;
  std::memcpy(&v, &bits, 4);
  return std::fabs(v) < 0x1p-14f ? std::nearbyint(v * 0x1p24f) * 0x1p-24f : v;
}

std::string StorageTable()
{
  std::ostringstream out;
  out << "A picture of 512 x 384 noisy pixels, radiance and normals, written and read again.\n\n"
      << "| file | largest error | SMAPE | bytes a pixel | write, ms | read, ms |\n|---|---:|---:|---:|---:|---:|\n";
  const int w = 512, h = 384;
  vtkNew<vtkQuellContractSource> source;
  source->Width = w;
  source->Height = h;
  const std::vector<float> truth = source->Values("radiance");
  const std::string file = (std::filesystem::temp_directory_path() / "quell-numerics.exr").string();
  for (const auto& [half, compression] : std::vector<std::pair<bool, const char*>>{ { false, "None" }, { false, "Zip" },
         { false, "Piz" }, { false, "Pxr24" }, { true, "None" }, { true, "Zip" }, { true, "Piz" }, { true, "Dwaa" } })
  {
    vtkNew<vtkQuellImageWriter> writer;
    std::string error;
    writer->ConnectInput("layer", source, "radiance");
    writer->ConnectInput("layer", source, "normal");
    writer->SetPropertyText("File", file, error);
    writer->SetPropertyText("Compression", compression, error);
    writer->SetPropertyText("Half", half ? "true" : "false", error);
    vtkNew<vtkQuellCollector> sink;
    double write = 1e300, read = 1e300;
    for (int k = 0; k < 3; ++k)
    {
      writer->Modified();
      sink->ClearRequests();
      sink->AddRequest(writer, {}, {});
      if (!sink->UpdateTick(0))
        throw std::runtime_error(writer->GetErrorText());
      write = std::min(write, writer->GetCounters().Seconds);
      writer->ResetCounters();
    }
    std::vector<float> values;
    for (int k = 0; k < 3; ++k)
    {
      vtkNew<vtkQuellImageReader> reader;
      reader->SetPropertyText("File", file, error);
      sink->ClearRequests();
      sink->AddRequest(reader, { "radiance", "normal" }, {});
      if (!sink->UpdateTick(0))
        throw std::runtime_error(reader->GetErrorText());
      read = std::min(read, reader->GetCounters().Seconds);
      values = ReadArrays(reader->GetOutput(), { "radiance" }, { 0, 0, w, h }).at("radiance");
    }
    double worst = 0, smape = 0, largest = *std::max_element(truth.begin(), truth.end());
    for (std::size_t i = 0; i < truth.size(); ++i)
    {
      const double d = std::fabs(double(truth[i]) - values[i]);
      worst = std::max(worst, d / (std::fabs(truth[i]) + 1e-3 * largest));
      smape += d / (std::fabs(truth[i]) + std::fabs(values[i]) + 0.01) / double(truth.size());
    }
    out << "| " << (half ? "half" : "float") << ", " << compression << " | " << Number(worst) << " | " << Number(smape)
        << " | " << Number(double(std::filesystem::file_size(file)) / (w * h), "%.1f") << " | "
        << Number(1e3 * write, "%.0f") << " | " << Number(1e3 * read, "%.0f") << " |\n";
  }
  std::filesystem::remove(file);
  return out.str();
}

/// Why histories are float: what an average in half would be after 2000 frames of noise, and after a light went from 1
/// to 0.9.
std::string HistoryTable()
{
  std::ostringstream out;
  out
    << "Histories are float32. In half an average with weight alpha stands still where alpha (x - mean) is below half "
       "a step: 2000 frames that go from 1 to 0.9.\n\n"
    << "| alpha | error in float | error in half | variance of noise 0.01 lost in half |\n|---:|---:|---:|---:|\n";
  for (const double alpha : { 0.2, 0.05, 0.02, 0.005 })
  {
    float full = 1, half = 1, a = float(alpha);
    for (int n = 0; n < 2000; ++n)
    {
      full += a * (0.9f - full);
      half = Half(half + a * (0.9f - half));
    }
    double mean = 0.9, second = 0, exact = 0;
    float hm = 0.9f;
    std::uint32_t state = 1;
    for (int n = 0; n < 20000; ++n)
    {
      state = state * 1664525u + 1013904223u;
      const float x = 0.9f + 0.01f * 3.4641f * (float(state >> 8) * 0x1p-24f - 0.5f);
      hm = Half(hm + a * (x - hm));
      mean += alpha * (x - mean);
      second += (hm - 0.9) * (hm - 0.9);
      exact += (mean - 0.9) * (mean - 0.9);
    }
    out << "| " << alpha << " | " << Number(std::fabs(full / 0.9 - 1)) << " | " << Number(std::fabs(half / 0.9 - 1))
        << " | " << Number(100 * (second / exact - 1), "%+.0f") << " % |\n";
  }
  return out.str();
}

/// Light times 2^exponent: a variance is multiplied by the square, as far as a float goes.
void Brighten(PortBench& bench, int exponent)
{
  const auto square = [exponent](float v)
  { return float(std::min(std::ldexp(double(v), 2 * exponent), double(std::numeric_limits<float>::max()))); };
  for (PortBench::Feed& feed : bench.Feeds)
    if (feed.Kind == quell::ArrayKind::Color)
      bench.Change(feed,
        [exponent](int, int, float* v, int n)
        {
          for (int k = 0; k < n; ++k)
            v[k] = std::ldexp(v[k], exponent);
        });
    else if (feed.Array == "variance") // not that of a guide
      bench.Change(feed,
        [square](int, int, float* v, int) { *v = square(*v); });
    else if (feed.Kind == quell::ArrayKind::Moments)
      bench.Change(feed,
        [exponent, square](int, int, float* v, int)
        {
          v[0] = std::ldexp(v[0], exponent);
          v[1] = square(v[1]);
        });
}

/// How far a stage is from f(s x) = s f(x). Powers of two leave no rounding: what is seen are floors, limits and the
/// range of floats.
/// Their parameters are in units of light, or a curve is for the eye.
const std::set<std::string> InUnitsOfLight = { "BilateralFilter", "DisplayTransform", "EmissionSplit", "FireflyClamp",
  "Redistribute", "TemporalAntialias" };

bool IsScaled(const Case& c)
{
  const quell::ArrayType* const array = quell::FindArray(c.Output);
  return c.Reference && array && array->Kind == quell::ArrayKind::Color && !InUnitsOfLight.count(c.Type);
}

std::string ScaleTable()
{
  const std::vector<int> exponents = { -110, -33, -17, -10, 10, 56, 63, 100, 120, 123 };
  std::ostringstream out;
  out << "The same picture, its light times s (a power of two next to the number), its variance times s^2 as far as a "
         "float goes: largest error of the output over s against the output of s = 1, relative as above; *light*: that "
         "much of the whole frame's is there, where it is not 100 %. Not of stages whose parameters are in units of light: ";
  for (const std::string& type : InUnitsOfLight)
    out << (type == *InUnitsOfLight.begin() ? "" : ", ") << type;
  out << ".\n\n| stage |";
  for (const int e : exponents)
    out << " " << Number(std::ldexp(1., e), "%.0e") << " |";
  out << "\n|---|";
  for (std::size_t i = 0; i < exponents.size(); ++i)
    out << "---:|";
  out << "\n";
  const int w = 67, h = 53;
  for (const Case& c : quelltest::Cases())
  {
    if (!IsScaled(c))
      continue;
    const auto output = [&c](int exponent)
    {
      const auto bench = Prepare(c, w, h);
      Brighten(*bench, exponent);
      if (!bench->Run())
        throw std::runtime_error(c.Type + ": " + bench->Stage->GetErrorText());
      return bench->Read().at(c.Output);
    };
    const std::vector<float> one = output(0);
    double largest = 0, light = 0;
    for (const float v : one)
    {
      largest = std::max(largest, std::fabs(double(v)));
      light += v;
    }
    out << "| " << c.Type << " |";
    for (const int e : exponents)
    {
      const std::vector<float> other = output(e);
      double worst = 0, sum = 0;
      for (std::size_t i = 0; i < one.size(); ++i)
      {
        const double v = std::ldexp(double(other[i]), -e);
        worst = std::max(worst, std::fabs(v - one[i]) / (std::fabs(one[i]) + 1e-3 * largest));
        sum += v;
      }
      out << " " << Number(worst, "%.0e");
      if (std::fabs(sum / light - 1) > 5e-3)
        out << ", light " << Number(100 * sum / light, "%.0f") << " %";
      out << " |";
    }
    out << "\n";
  }
  return out.str();
}

std::string CaseTable(const std::string& file)
{
  std::ifstream in(file);
  std::ostringstream out;
  out << "| | case | expected | shown by |\n|---:|---|---|---|\n";
  int tests = 0, reasons = 0;
  for (std::string line; std::getline(in, line);)
  {
    if (line.empty() || line[0] == '#')
      continue;
    std::vector<std::string> cells(1);
    for (std::size_t i = 0; i < line.size(); ++i)
      if (line.compare(i, 3, " | ") == 0)
      {
        cells.emplace_back();
        i += 2;
      }
      else
        cells.back() += line[i];
    if (cells.size() != 4)
      throw std::runtime_error(file + ": " + line);
    std::string shown;
    if (cells[3].compare(0, 2, "- ") == 0)
    {
      shown = "not tested: " + cells[3].substr(2);
      ++reasons;
    }
    else
    {
      std::istringstream names(cells[3]);
      for (std::string name; names >> name;)
        shown += (shown.empty() ? "`" : ", `") + name + "`";
      ++tests;
    }
    out << "| " << cells[0] << " | " << cells[1] << " | " << cells[2] << " | " << shown << " |\n";
  }
  out << "\n" << tests << " cases are tested, " << reasons << " cannot occur.\n";
  return out.str();
}

std::string Slurp(const std::string& file)
{
  std::ifstream in(file);
  if (!in)
    throw std::runtime_error("cannot read " + file);
  return { std::istreambuf_iterator<char>(in), {} };
}

/// The text between the marks of a part.
struct Part
{
  std::size_t Begin, End;
};
Part Find(const std::string& page, const std::string& name)
{
  const std::string open = "<!-- " + name + ": made by ./bootstrap.sh report numerics -->\n",
                    close = "<!-- end of " + name + " -->";
  const std::size_t begin = page.find(open), end = page.find(close);
  if (begin == std::string::npos || end == std::string::npos)
    throw std::runtime_error("Documentation/numerics.md has no part \"" + name + "\"");
  return { begin + open.size(), end };
}

int Check(const std::string& top)
{
  const std::string page = Slurp(top + "/Documentation/numerics.md");
  int wrong = 0;
  const auto say = [&wrong](const std::string& text)
  {
    std::cerr << "numerics.md is stale: " << text << "; ./bootstrap.sh report numerics\n";
    ++wrong;
  };
  const Part cases = Find(page, "cases");
  if (page.substr(cases.Begin, cases.End - cases.Begin) != CaseTable(top + "/Testing/Numerics/cases.txt"))
    say("Testing/Numerics/cases.txt says something else");
  const Part part = Find(page, "stages");
  const std::string table = page.substr(part.Begin, part.End - part.Begin);
  std::set<std::string> known;
  for (const Case& c : quelltest::Cases())
    known.insert(c.Type);
  for (const std::string& type : Registry().Types())
    if (!known.count(type))
      say("stage " + type + " has no reference and no reason (Testing/Numerics/References.h)");
  for (const Case& c : quelltest::Cases())
  {
    const std::size_t at = table.find("| " + c.Type + " | ");
    if (at == std::string::npos)
    {
      say("no row of " + c.Type);
      continue;
    }
    if (!c.Reference)
      continue;
    std::istringstream row(table.substr(at, table.find('\n', at) - at));
    std::string cell[5];
    for (std::string& text : cell)
      std::getline(row, text, '|');
    const double worst = std::stod(cell[3]), smape = std::stod(cell[4]);
    const Measured now = Errors(c, 67, 53);
    // Other instruction sets round in other places.
    if (now.Worst > 4 * worst + 2e-7 || now.Smape > 4 * smape + 1e-8)
      say(c.Type + ": errors " + Number(now.Worst) + ", " + Number(now.Smape));
    if (worst > 1e-3 || now.Worst > 1e-3)
      say(c.Type + " is further than 1e-3 from its formula");
  }
  for (const char* name : { "storage", "history" })
    Find(page, name);
  const Part scale = Find(page, "scale");
  const std::string scaled = page.substr(scale.Begin, scale.End - scale.Begin);
  for (const Case& c : quelltest::Cases())
    if ((scaled.find("| " + c.Type + " |") != std::string::npos) != IsScaled(c))
      say("light of any size: row of " + c.Type);
  return wrong ? 1 : 0;
}

void Replace(std::string& page, const std::string& name, const std::string& text)
{
  const Part part = Find(page, name);
  page.replace(part.Begin, part.End - part.Begin, text);
}
}

int main(int argc, char** argv)
{
  if (argc < 2)
  {
    std::cerr << "quell-numerics-report SOURCE_DIRECTORY [--check]\n";
    return 2;
  }
  const std::string top = argv[1];
  try
  {
    if (argc > 2 && std::string(argv[2]) == "--check")
      return Check(top);
    std::string page = Slurp(top + "/Documentation/numerics.md");
    Replace(page, "stages", StageTable());
    Replace(page, "storage", StorageTable());
    Replace(page, "history", HistoryTable());
    Replace(page, "scale", ScaleTable());
    Replace(page, "cases", CaseTable(top + "/Testing/Numerics/cases.txt"));
    std::ofstream(top + "/Documentation/numerics.md") << page;
  }
  catch (const std::exception& error)
  {
    std::cerr << error.what() << "\n";
    return 1;
  }
  return 0;
}
