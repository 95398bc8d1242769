// SPDX-License-Identifier: BSD-3-Clause
// The filters of the SVGF family at 1280 x 720 against OpenCV's bilateral filter, our own scalar code and the machine's
// limits. One-thread figures are CPU time (least of several), so that other work on the machine does not count.
#include "quellBench.h"
#include "quellBenchFrame.h"
#include "quellBenchMachine.h"

#include "quellATrous.h"
#include "quellSimd.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellATrousFilter.h"
#include "vtkQuellAlbedoDemodulate.h"
#include "vtkQuellAlbedoModulate.h"
#include "vtkQuellReproject.h"
#include "vtkQuellSum.h"
#include "vtkQuellTemporalAccumulate.h"
#include "vtkQuellTemporalAntialias.h"
#include "vtkQuellVarianceEstimate.h"
#include "vtkSMPTools.h"
#include "vtkTrivialProducer.h"

#ifdef QUELL_OPENCV
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#endif

#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <stdexcept>

using namespace quell;

namespace
{
constexpr int Width = 1280, Height = 720, Passes = 5;

const BenchFrame& Frame()
{
  static const BenchFrame frame(Width, Height, 8);
  return frame;
}

double WallSeconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// CPU seconds of `run` with one thread.
double OneThread(const std::function<void()>& run)
{
  double seconds = 0;
  vtkSMPTools::LocalScope(vtkSMPTools::Config{ 1 },
    [&]
    {
      const double start = ProcessSeconds();
      run();
      seconds = ProcessSeconds() - start;
    });
  return seconds;
}
/// Wall seconds of `run` with two threads.
double TwoThreads(const std::function<void()>& run)
{
  double seconds = 0;
  vtkSMPTools::LocalScope(vtkSMPTools::Config{ 2 },
    [&]
    {
      const double start = WallSeconds();
      run();
      seconds = WallSeconds() - start;
    });
  return seconds;
}

std::string Text(const char* format, double a, double b = 0, double c = 0)
{
  char buffer[240];
  std::snprintf(buffer, sizeof buffer, format, a, b, c);
  return buffer;
}

/// Arrays of a frame as one image that stages read; pixels are not copied.
vtkSmartPointer<vtkImageData> ImageOf(const std::map<std::string, const BenchImage*>& arrays)
{
  auto image = vtkSmartPointer<vtkImageData>::New();
  for (const auto& entry : arrays)
  {
    const BenchImage& source = *entry.second;
    image->SetExtent(0, source.Extent.x1 - 1, 0, source.Extent.y1 - 1, 0, 0);
    vtkNew<vtkFloatArray> array;
    array->SetName(entry.first.c_str());
    array->SetNumberOfComponents(source.Components);
    array->SetArray(const_cast<float*>(source.Data.data()), vtkIdType(source.Data.size()), 1);
    image->GetPointData()->AddArray(array);
  }
  return image;
}

vtkSmartPointer<vtkTrivialProducer> ProducerOf(vtkImageData* image)
{
  auto producer = vtkSmartPointer<vtkTrivialProducer>::New();
  producer->SetOutput(image);
  return producer;
}

void Check(vtkQuellStage* stage)
{
  if (!stage->GetErrorText().empty())
    throw std::runtime_error(stage->GetErrorText());
}

/// The stage alone on a frame, executed again at every call.
struct ATrousStage
{
  vtkSmartPointer<vtkImageData> Image;
  vtkSmartPointer<vtkTrivialProducer> Producer;
  vtkNew<vtkQuellATrousFilter> Stage;

  ATrousStage(const BenchFrame& f, int passes, bool variance)
    : Image(ImageOf({ { "illumination", &f.Illumination }, { "variance", &f.Variance }, { "depth", &f.Depth },
        { "normal", &f.Normal } }))
    , Producer(ProducerOf(this->Image))
  {
    this->Stage->SetIterations(passes);
    this->Stage->ConnectInput("radiance", this->Producer, "illumination");
    if (variance)
      this->Stage->ConnectInput("variance", this->Producer, "variance");
    this->Stage->ConnectInput("depth", this->Producer, "depth");
    this->Stage->ConnectInput("normal", this->Producer, "normal");
  }
  void operator()()
  {
    this->Stage->Modified();
    this->Stage->Update();
    Check(this->Stage);
  }
};

/// The passes alone, on planes that are there.
struct ATrousPasses
{
  std::vector<float> Memory;
  ATrousPass First;

  explicit ATrousPasses(const BenchFrame& f)
  {
    const Rect e = f.Depth.Extent;
    PlaneLayout& layout = this->First.guides.layout;
    layout = PlaneLayout(e, 2 << (Passes - 1));
    this->Memory.resize(layout.size() * 17 + 16);
    float* next = this->Memory.data();
    while (reinterpret_cast<std::uintptr_t>(next) % 64)
      ++next;
    const auto plane = [&] { return (next += layout.size()) - layout.size(); };
    GuidePlanes& g = this->First.guides;
    for (float** p : { &g.depth, &g.slopeX, &g.slopeY, &g.normal[0], &g.normal[1], &g.normal[2] })
      *p = plane();
    for (ColorPlanes* c : { &this->First.in, &this->First.out })
      for (float** p : { &c->color[0], &c->color[1], &c->color[2], &c->luminance, &c->variance })
        *p = plane();
    CopyGuides(f.Depth, f.Normal, ImageIn(), g, e.y0, e.y1);
    CopySlopes(g, e.y0, e.y1);
    CopyColor(f.Illumination, f.Variance, g, this->First.in, e.y0, e.y1, e);
    ClearPadding(layout, this->First.out, e.y0, e.y1);
  }
  template <class Rows>
  void Run(Rows&& rows)
  {
    ATrousPass pass = this->First;
    const Rect e = pass.guides.layout.extent;
    for (int k = 0; k < Passes; ++k)
    {
      pass.step = 1 << k;
      // as the stage does it: rows of one phase after the other
      for (int phase = 0; phase < pass.step; ++phase)
        for (int y = e.y0 + phase; y < e.y1; y += 48 * pass.step)
          rows(pass, y, std::min(48, (e.y1 - y + pass.step - 1) / pass.step), e.x0, e.x1);
      // Start from the same input in every run: the second buffer is scratch from the second pass on.
      if (k == 0)
        pass.in = pass.out, pass.out = this->Other();
      else
        std::swap(pass.in, pass.out);
    }
  }

private:
  ColorPlanes Other()
  {
    if (this->Spare.empty())
    {
      const PlaneLayout& layout = this->First.guides.layout;
      this->Spare.resize(layout.size() * 5 + 16);
      float* next = this->Spare.data();
      while (reinterpret_cast<std::uintptr_t>(next) % 64)
        ++next;
      for (float** p : { &this->Third.color[0], &this->Third.color[1], &this->Third.color[2], &this->Third.luminance,
             &this->Third.variance })
        *p = (next += layout.size()) - layout.size();
      ClearPadding(layout, this->Third, layout.extent.y0, layout.extent.y1);
    }
    return this->Third;
  }
  std::vector<float> Spare;
  ColorPlanes Third;
};

/// Of the five passes with variance. Arithmetic: what goes through the multipliers for a tap (depth 1, luminance 1,
/// exponential 4, weight 1, colour 3, variance 2, and half of the 11 of a pair's normal weight). Traffic: every plane
/// that a pass reads or writes, once.
constexpr double MultiplyAddsPerTap = 17.5, BytesPerPixelAndPass = 4. * (5 + 1 + 2 + 3 + 5);

void ReportLimits(Bench& bench, const std::string& name, double seconds, double pixels, const MachinePeak& peak)
{
  const double adds = pixels * Passes * 24 * MultiplyAddsPerTap / seconds;
  const double bytes = pixels * Passes * BytesPerPixelAndPass / seconds;
  bench.Report(name + ", multiply-adds", adds / 1e9, "Gmadd/s", "one thread's peak", adds / peak.MultiplyAdds, 0,
    Text("peak %.1f Gmadd/s, ", peak.MultiplyAdds / 1e9) + peak.Target);
  bench.Report(name + ", memory", bytes / 1e9, "GB/s", "one thread's copy", bytes / peak.Bandwidth, 0,
    Text("copy %.1f GB/s", peak.Bandwidth / 1e9));
}
}

QUELL_BENCHMARK(
  "atrous5-vs-opencv-bilateral5", "five a-trous passes, 1280x720, against five of cv::bilateralFilter d=5")
{
  ATrousStage full(Frame(), Passes, true), lean(Frame(), Passes, false);
  const MachinePeak peak = MachinePeak::Measure();
  std::vector<std::function<double()>> subjects{ [&] { return OneThread([&] { full(); }); },
    [&] { return TwoThreads([&] { full(); }); }, [&] { return OneThread([&] { lean(); }); } };
#ifdef QUELL_OPENCV
  const cv::Mat source(
    Height, Width, CV_32FC3, const_cast<float*>(Frame().Illumination.Data.data()), Width * 3 * sizeof(float));
  cv::Mat ping, pong;
  const auto bilateral = [&]
  {
    cv::bilateralFilter(source, ping, 5, 1., 2.);
    for (int i = 1; i < 5; ++i)
    {
      cv::bilateralFilter(ping, pong, 5, 1., 2.);
      cv::swap(ping, pong);
    }
  };
  subjects.push_back(
    [&]
    {
      cv::setNumThreads(1);
      const double start = ProcessSeconds();
      bilateral();
      return ProcessSeconds() - start;
    });
  subjects.push_back(
    [&]
    {
      cv::setNumThreads(2);
      const double start = WallSeconds();
      bilateral();
      return WallSeconds() - start;
    });
#else
  bench.Say("OpenCV was not found when this was built (Debian: libopencv-dev): nothing to compare with");
#endif
  const auto t = bench.CompareFigures(subjects);
#ifdef QUELL_OPENCV
  bench.Report("atrous5-vs-opencv-bilateral5", 1e3 * t[0].Least, "ms", "cv::bilateralFilter d=5 x 5",
    t[0].Least / t[3].Least, t[0].Spread, Text("1 thread; OpenCV %.1f ms; goal 0.6", 1e3 * t[3].Least));
  bench.Report("atrous5, 2 threads", 1e3 * t[1].Least, "ms", "cv::bilateralFilter d=5 x 5", t[1].Least / t[4].Least,
    t[1].Spread, Text("wall, best; OpenCV %.1f ms", 1e3 * t[4].Least));
  bench.Report("atrous5 without variance, 1 thread", 1e3 * t[2].Least, "ms", "cv::bilateralFilter d=5 x 5",
    t[2].Least / t[3].Least, t[2].Spread);
#else
  bench.Report("atrous5-vs-opencv-bilateral5", 1e3 * t[0].Least, "ms", "", 0, t[0].Spread, "1 thread; no OpenCV");
  bench.Report("atrous5, 2 threads", 1e3 * t[1].Least, "ms", "", 0, t[1].Spread, "wall, best");
  bench.Report("atrous5 without variance, 1 thread", 1e3 * t[2].Least, "ms", "", 0, t[2].Spread);
#endif
  ReportLimits(bench, "atrous5 stage", t[0].Least, double(Width) * Height, peak);
}

QUELL_BENCHMARK("atrous5-vs-scalar", "five a-trous passes, 1280x720, vectors against the scalar reference")
{
  ATrousPasses passes(Frame());
  const MachinePeak peak = MachinePeak::Measure();
  std::vector<SimdTarget> targets = SimdTargets();
  std::vector<std::function<double()>> subjects;
  const auto timed = [&passes](auto rows)
  {
    const double start = ThreadSeconds();
    passes.Run(rows);
    return ThreadSeconds() - start;
  };
  subjects.push_back([&] { return timed(ATrousRowsScalar); });
  for (const SimdTarget& target : targets)
    subjects.push_back(
      [&timed, target]
      {
        ForceSimdTarget(target.Id);
        const double seconds = timed(ATrousRows);
        ForceSimdTarget(0);
        return seconds;
      });
  const auto t = bench.CompareFigures(subjects);
  bench.Report("atrous5-vs-scalar", 1e3 * t[1].Least, "ms", "scalar reference", t[1].Least / t[0].Least, t[1].Spread,
    Text("scalar %.0f ms, %.1f times faster; goal 6", 1e3 * t[0].Least, t[0].Least / t[1].Least));
  for (std::size_t i = 0; i < targets.size(); ++i)
    bench.Report(std::string("atrous5 passes, ") + targets[i].Name, 1e3 * t[i + 1].Least, "ms", "scalar reference",
      t[i + 1].Least / t[0].Least, t[i + 1].Spread);
  ReportLimits(bench, "atrous5 passes", t[1].Least, double(Width) * Height, peak);
}

QUELL_BENCHMARK("atrous-growth", "how the cost of a-trous grows with size and radius, one thread")
{
  const double seconds = bench.SecondsPerSubject;
  bench.SecondsPerSubject = std::min(seconds, 0.4);
  const std::pair<int, int> sizes[] = { { 320, 180 }, { 640, 360 }, { 1280, 720 }, { 1920, 1080 }, { 2560, 1440 } };
  double first = 0;
  for (const auto& size : sizes)
  {
    const BenchFrame frame(size.first, size.second, 8);
    ATrousStage stage(frame, Passes, true);
    const auto t = bench.CompareFigures({ [&] { return OneThread([&] { stage(); }); } });
    const double perPixel = 1e9 * t[0].Least / size.first / size.second;
    first = first > 0 ? first : perPixel;
    bench.Report("atrous5, " + std::to_string(size.first) + "x" + std::to_string(size.second), perPixel, "ns/pixel",
      "320x180", perPixel / first, t[0].Spread);
  }
  double before = 0, one = 0;
  for (int passes = 1; passes <= 7; ++passes)
  {
    ATrousStage stage(Frame(), passes, true);
    const auto t = bench.CompareFigures({ [&] { return OneThread([&] { stage(); }); } });
    one = one > 0 ? one : t[0].Least;
    bench.Report("a-trous, " + std::to_string(passes) + " passes, radius " + std::to_string(ATrousHalo(passes)),
      1e3 * t[0].Least, "ms", "1 pass", t[0].Least / one, t[0].Spread,
      Text("%+.1f ms for the last", 1e3 * (t[0].Least - before)));
    before = t[0].Least;
  }
  bench.SecondsPerSubject = seconds;
}

namespace
{
/// Two layers, demodulate to anti-alias, wired as Data/Pipelines/svgf.xml, with the executor's part done by hand.
struct SvgfChain
{
  struct Layer
  {
    vtkNew<vtkQuellAlbedoDemodulate> Demodulate;
    vtkNew<vtkQuellReproject> Reproject;
    vtkNew<vtkQuellTemporalAccumulate> Accumulate;
    vtkNew<vtkQuellVarianceEstimate> Variance;
    vtkNew<vtkQuellATrousFilter> ATrous;
    vtkNew<vtkQuellAlbedoModulate> Modulate;

    Layer(vtkAlgorithm* source, const char* layer, double alpha)
    {
      this->Demodulate->ConnectInput("radiance", source, layer);
      this->Demodulate->ConnectInput("albedo", source, "albedo");
      for (const char* guide : { "depth", "normal", "id", "motion" })
        this->Reproject->ConnectInput(guide, source, guide);
      this->Accumulate->ConnectInput("radiance", this->Demodulate, "illumination");
      this->Accumulate->ConnectInput("history", this->Reproject, "radiance");
      this->Accumulate->ConnectInput("moments", this->Reproject, "moments");
      this->Accumulate->ConnectInput("length", this->Reproject, "history");
      this->Accumulate->SetAlpha(alpha);
      this->Variance->ConnectInput("radiance", this->Accumulate, "radiance");
      this->Variance->ConnectInput("moments", this->Accumulate, "moments");
      this->Variance->ConnectInput("length", this->Accumulate, "history");
      this->Variance->ConnectInput("depth", source, "depth");
      this->Variance->ConnectInput("normal", source, "normal");
      this->ATrous->ConnectInput("radiance", this->Variance, "radiance");
      this->ATrous->ConnectInput("variance", this->Variance, "variance");
      for (const char* guide : { "depth", "normal", "id" })
        this->ATrous->ConnectInput(guide, source, guide);
      this->ATrous->SetSigmaLuminance(2);
      this->Modulate->ConnectInput("illumination", this->ATrous, "radiance");
      this->Modulate->ConnectInput("albedo", source, "albedo");
      this->ATrous->SetAlwaysMake({ "feedback" });
      this->Accumulate->SetAlwaysMake({ "radiance", "moments", "history" });
    }
    std::vector<vtkQuellStage*> Stages()
    {
      return { this->Demodulate, this->Reproject, this->Accumulate, this->Variance, this->ATrous, this->Modulate };
    }
    /// `source`: the frame that was; nullptr: there is none.
    void KeepHistory(vtkImageData* source)
    {
      const auto set = [this](const char* name, vtkImageData* image)
      { this->Reproject->SetHistory(this->Reproject->GetDescription().InputIndex(name), image); };
      set("previousDepth", source);
      set("previousNormal", source);
      set("previousId", source);
      this->History = source ? Keep(this->ATrous->GetOutput(), { "feedback" }) : nullptr;
      this->Statistics = source ? Keep(this->Accumulate->GetOutput(), { "moments", "history" }) : nullptr;
      set("history", this->History);
      this->Reproject->SetInputArray(this->Reproject->GetDescription().InputIndex("history"), 0, "feedback");
      set("moments", this->Statistics);
      set("length", this->Statistics);
    }
    /// What the executor keeps: the arrays that are read, by reference.
    static vtkSmartPointer<vtkImageData> Keep(vtkImageData* image, const std::vector<const char*>& names)
    {
      auto copy = vtkSmartPointer<vtkImageData>::New();
      copy->CopyStructure(image);
      copy->GetFieldData()->ShallowCopy(image->GetFieldData());
      for (const char* name : names)
        copy->GetPointData()->AddArray(image->GetPointData()->GetArray(name));
      return copy;
    }
    vtkSmartPointer<vtkImageData> History, Statistics;
  };

  std::vector<std::unique_ptr<BenchFrame>> Frames;
  std::vector<vtkSmartPointer<vtkImageData>> Images;
  vtkSmartPointer<vtkTrivialProducer> Source;
  std::unique_ptr<Layer> Direct, Indirect;
  vtkNew<vtkQuellSum> Sum;
  vtkNew<vtkQuellTemporalAntialias> Antialias;
  vtkSmartPointer<vtkImageData> LastAntialias;
  int Tick = 0;

  SvgfChain(int width, int height)
  {
    for (int tick = 0; tick < 4; ++tick)
    {
      this->Frames.push_back(std::make_unique<BenchFrame>(width, height, tick));
      const BenchFrame& f = *this->Frames.back();
      this->Images.push_back(ImageOf(
        { { "direct", &f.Direct }, { "indirect", &f.Indirect }, { "emission", &f.Emission }, { "albedo", &f.Albedo },
          { "normal", &f.Normal }, { "depth", &f.Depth }, { "id", &f.Id }, { "motion", &f.Motion } }));
    }
    this->Source = ProducerOf(this->Images[0]);
    this->Direct = std::make_unique<Layer>(this->Source, "direct", 0.3);
    this->Indirect = std::make_unique<Layer>(this->Source, "indirect", 0.2);
    this->Sum->ConnectInput("radiance", this->Direct->Modulate, "radiance");
    this->Sum->ConnectInput("radiance", this->Indirect->Modulate, "radiance");
    this->Sum->ConnectInput("radiance", this->Source, "emission");
    this->Antialias->ConnectInput("radiance", this->Sum, "radiance");
    this->Antialias->ConnectInput("motion", this->Source, "motion");
    this->Antialias->ConnectInput("depth", this->Source, "depth");
    this->Antialias->SetAlpha(0.2);
    this->KeepHistory(nullptr);
  }
  void KeepHistory(vtkImageData* source)
  {
    this->Direct->KeepHistory(source);
    this->Indirect->KeepHistory(source);
    this->LastAntialias = source ? Layer::Keep(this->Antialias->GetOutput(), { "radiance" }) : nullptr;
    this->Antialias->SetHistory(this->Antialias->GetDescription().InputIndex("history"), this->LastAntialias);
  }
  /// Forth and back through the four frames, so that motion vectors lead to the frame before in half of the steps; in
  /// the other half the surfaces still agree.
  void Step()
  {
    const int k = this->Tick % 6, now = k < 4 ? k : 6 - k;
    this->Source->SetOutput(this->Images[std::size_t(now)]);
    this->Antialias->Update();
    Check(this->Antialias);
    this->KeepHistory(this->Images[std::size_t(now)]);
    ++this->Tick;
  }
  std::vector<std::pair<std::string, double>> StageSeconds()
  {
    std::map<std::string, double> sum;
    std::vector<std::string> order;
    const auto add = [&](vtkQuellStage* stage)
    {
      const std::string& type = stage->GetDescription().Type;
      if (!sum.count(type))
        order.push_back(type);
      sum[type] += stage->GetCounters().Seconds;
      stage->ResetCounters();
    };
    for (Layer* layer : { this->Direct.get(), this->Indirect.get() })
      for (vtkQuellStage* stage : layer->Stages())
        add(stage);
    add(this->Sum);
    add(this->Antialias);
    std::vector<std::pair<std::string, double>> out;
    for (const std::string& type : order)
      out.emplace_back(type, sum[type]);
    return out;
  }
  /// Part of the pixels with four or more frames of history.
  double Settled()
  {
    vtkDataArray* length = this->Direct->Statistics->GetPointData()->GetArray("history");
    vtkIdType n = 0;
    for (vtkIdType i = 0; i < length->GetNumberOfTuples(); ++i)
      n += length->GetComponent(i, 0) >= 4;
    return double(n) / double(length->GetNumberOfTuples());
  }
};
}

QUELL_BENCHMARK("svgf-chain", "SVGF after tracing: two layers, demodulate to anti-alias, 1280x720, steady state")
{
  SvgfChain chain(Width, Height);
  for (int i = 0; i < 10; ++i)
    chain.Step();
  const double settled = chain.Settled();
  const auto t = bench.CompareFigures(
    { [&] { return TwoThreads([&] { chain.Step(); }); }, [&] { return OneThread([&] { chain.Step(); }); } });
  bench.Report("svgf-chain", 1e3 * t[0].Least, "ms", "", 0, t[0].Spread,
    Text("2 threads, wall, best (median %.1f); goal 130; history >= 4 in %.1f %% of pixels", 1e3 * t[0].Seconds,
      100 * settled));
  bench.Report("svgf-chain, 1 thread", 1e3 * t[1].Least, "ms", "", 0, t[1].Spread, "CPU time");
  std::map<std::string, double> least;
  std::vector<std::string> order;
  for (int i = 0; i < 6; ++i)
  {
    chain.StageSeconds();
    OneThread([&] { chain.Step(); });
    for (const auto& s : chain.StageSeconds())
    {
      if (!least.count(s.first))
        order.push_back(s.first);
      least[s.first] = least.count(s.first) ? std::min(least[s.first], s.second) : s.second;
    }
  }
  for (const std::string& type : order)
    bench.Report(
      "svgf-chain, 1 thread, " + type, 1e3 * least[type], "ms", "svgf-chain, 1 thread", least[type] / t[1].Least);
}
