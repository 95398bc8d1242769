// SPDX-License-Identifier: BSD-3-Clause
// The cross-bilateral filter at 1280 x 720 against OpenCV's joint bilateral filter, which takes one guide of three
// channels. One-thread figures are CPU time (least of several), so that other work on the machine does not count.
#include "quellBench.h"
#include "quellBenchFrame.h"
#include "quellBenchMachine.h"

#include "quellBilateral.h"
#include "quellSimd.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellBilateralFilter.h"
#include "vtkSMPTools.h"
#include "vtkTrivialProducer.h"

#ifdef QUELL_OPENCV_XIMGPROC
#include <opencv2/core.hpp>
#include <opencv2/ximgproc.hpp>
#endif

#include <chrono>
#include <cstdio>
#include <stdexcept>

using namespace quell;

namespace
{
constexpr int Width = 1280, Height = 720, Radius = 5;

const BenchFrame& Frame()
{
  static const BenchFrame frame(Width, Height, 8);
  return frame;
}

/// The stage with guides colour, albedo, normal and depth.
struct CrossBilateral
{
  vtkNew<vtkImageData> Image;
  vtkNew<vtkTrivialProducer> Producer;
  vtkNew<vtkQuellBilateralFilter> Stage;

  CrossBilateral(const BenchFrame& f, int radius)
  {
    const auto add = [this](const char* name, const BenchImage& source)
    {
      this->Image->SetExtent(0, source.Extent.x1 - 1, 0, source.Extent.y1 - 1, 0, 0);
      vtkNew<vtkFloatArray> array;
      array->SetName(name);
      array->SetNumberOfComponents(source.Components);
      array->SetArray(const_cast<float*>(source.Data.data()), vtkIdType(source.Data.size()), 1);
      this->Image->GetPointData()->AddArray(array);
    };
    add("illumination", f.Illumination);
    add("albedo", f.Albedo);
    add("normal", f.Normal);
    add("depth", f.Depth);
    this->Producer->SetOutput(this->Image);
    this->Stage->SetRadius(radius);
    this->Stage->ConnectInput("radiance", this->Producer, "illumination");
    for (const char* guide : { "albedo", "normal", "depth" })
      this->Stage->ConnectInput(guide, this->Producer, guide);
  }
  void operator()()
  {
    this->Stage->Modified();
    this->Stage->Update();
    if (!this->Stage->GetErrorText().empty())
      throw std::runtime_error(this->Stage->GetErrorText());
  }
  /// CPU seconds with one thread, or wall seconds with two.
  double Seconds(int threads)
  {
    double seconds = 0;
    vtkSMPTools::LocalScope(vtkSMPTools::Config{ threads },
      [&]
      {
        const auto start = std::chrono::steady_clock::now();
        const double cpu = ProcessSeconds();
        (*this)();
        seconds = threads == 1 ? ProcessSeconds() - cpu
                               : std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      });
    return seconds;
  }
};

std::string Text(const char* format, double a, double b = 0, double c = 0)
{
  char buffer[240];
  std::snprintf(buffer, sizeof buffer, format, a, b, c);
  return buffer;
}

/// Of one tap, counted in the kernel's order, as multiply-adds of one lane: each weight serves two taps (10 features of
/// a difference and a square, 11 for the exponential, 2 for the rest), 3 channels of a difference and a sum, 1 weight.
constexpr double OperationsPerTap = (10 * 2 + 11 + 2) / 2. + 3 * 2 + 1;
}

QUELL_BENCHMARK("crossbilateral11-vs-opencv-joint11",
  "cross-bilateral filter of radius 5 with four guides, 1280x720, against cv::ximgproc::jointBilateralFilter d=11")
{
  CrossBilateral filter(Frame(), Radius);
  const MachinePeak peak = MachinePeak::Measure();
  std::vector<std::function<double()>> subjects{ [&] { return filter.Seconds(1); }, [&] { return filter.Seconds(2); } };
#ifdef QUELL_OPENCV_XIMGPROC
  const auto mat = [](const BenchImage& image)
  { return cv::Mat(Height, Width, CV_32FC3, const_cast<float*>(image.Data.data()), Width * 3 * sizeof(float)); };
  const cv::Mat source = mat(Frame().Illumination), guide = mat(Frame().Albedo);
  cv::Mat result;
  subjects.push_back(
    [&]
    {
      cv::setNumThreads(1);
      const double start = ProcessSeconds();
      cv::ximgproc::jointBilateralFilter(guide, source, result, 2 * Radius + 1, 0.5, 2.);
      return ProcessSeconds() - start;
    });
  subjects.push_back(
    [&]
    {
      cv::setNumThreads(2);
      const auto start = std::chrono::steady_clock::now();
      cv::ximgproc::jointBilateralFilter(guide, source, result, 2 * Radius + 1, 0.5, 2.);
      return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    });
#else
  bench.Say("OpenCV's ximgproc was not found when this was built (Debian: libopencv-contrib-dev)");
#endif
  const auto t = bench.CompareFigures(subjects);
#ifdef QUELL_OPENCV_XIMGPROC
  bench.Report("crossbilateral11-vs-opencv-joint11", 1e3 * t[0].Least, "ms", "cv jointBilateralFilter d=11",
    t[0].Least / t[2].Least, t[0].Spread, Text("1 thread; OpenCV %.1f ms; goal 0.333", 1e3 * t[2].Least));
  bench.Report("crossbilateral11, 2 threads", 1e3 * t[1].Least, "ms", "cv jointBilateralFilter d=11",
    t[1].Least / t[3].Least, t[1].Spread, Text("wall, best; OpenCV %.1f ms", 1e3 * t[3].Least));
#else
  bench.Report("crossbilateral11-vs-opencv-joint11", 1e3 * t[0].Least, "ms", "", 0, t[0].Spread, "1 thread; no OpenCV");
  bench.Report("crossbilateral11, 2 threads", 1e3 * t[1].Least, "ms", "", 0, t[1].Spread, "wall, best");
#endif
  const double pixels = double(Width) * Height, side = 2 * Radius + 1;
  const double adds = pixels * side * side * OperationsPerTap / t[0].Least;
  const double bytes = pixels * 4 * (3 + 3 + 3 + 1 + 3) / t[0].Least;
  bench.Report("crossbilateral11, multiply-adds", adds / 1e9, "Gmadd/s", "one thread's peak", adds / peak.MultiplyAdds,
    0, Text("peak %.1f Gmadd/s, ", peak.MultiplyAdds / 1e9) + peak.Target);
  bench.Report("crossbilateral11, memory", bytes / 1e9, "GB/s", "one thread's copy", bytes / peak.Bandwidth, 0,
    Text("copy %.1f GB/s", peak.Bandwidth / 1e9));
}

QUELL_BENCHMARK("crossbilateral-growth", "how the cost of the cross-bilateral filter grows with size and radius")
{
  const double seconds = bench.SecondsPerSubject;
  bench.SecondsPerSubject = std::min(seconds, 0.4);
  const std::pair<int, int> sizes[] = { { 320, 180 }, { 640, 360 }, { 1280, 720 }, { 1920, 1080 } };
  double first = 0;
  for (const auto& size : sizes)
  {
    const BenchFrame frame(size.first, size.second, 8);
    CrossBilateral filter(frame, Radius);
    const auto t = bench.CompareFigures({ [&] { return filter.Seconds(1); } });
    const double perPixel = 1e9 * t[0].Least / size.first / size.second;
    first = first > 0 ? first : perPixel;
    bench.Report("crossbilateral11, " + std::to_string(size.first) + "x" + std::to_string(size.second), perPixel,
      "ns/pixel", "320x180", perPixel / first, t[0].Spread);
  }
  double one = 0;
  for (const int radius : { 1, 3, 5, 8, 9, 12, 16 })
  {
    CrossBilateral filter(Frame(), radius);
    const auto t = bench.CompareFigures({ [&] { return filter.Seconds(1); } });
    const double side = 2. * radius + 1, perTap = 1e9 * t[0].Least / Width / Height / side / side;
    one = one > 0 ? one : t[0].Least;
    bench.Report("cross-bilateral, radius " + std::to_string(radius), 1e3 * t[0].Least, "ms", "radius 1",
      t[0].Least / one, t[0].Spread,
      Text("%.2f ns a tap", perTap) + (radius <= BilateralParameters::MostSharedRadius ? "" : ", weights not shared"));
  }
  bench.SecondsPerSubject = seconds;
}
