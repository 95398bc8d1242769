// SPDX-License-Identifier: BSD-3-Clause
#include "quellMetrics.h"

#include "quellFlip.h"
#include "quellImageMetrics.h"
#include "quellSsim.h"
#include "quellVector.h"
#include "vtkSMPTools.h"

#include <cmath>
#include <limits>
#include <functional>
#include <memory>

namespace quell
{
namespace
{
enum class Method
{
  Mean,
  Root,
  Trimmed,
  Psnr,
  Ssim,
  Flip,
  HdrFlip
};

struct Metric
{
  const char* Name;
  Method How;
  PixelError Kind;
};

const Metric Metrics[] = {
  { "MSE", Method::Mean, PixelError::Squared },
  { "RMSE", Method::Root, PixelError::Squared },
  { "MAE", Method::Mean, PixelError::Absolute },
  { "relMSE", Method::Mean, PixelError::RelativeSquared },
  { "relMSE@0.1%", Method::Trimmed, PixelError::RelativeSquared },
  { "MRSE", Method::Mean, PixelError::Mrse },
  { "SMAPE", Method::Mean, PixelError::Smape },
  { "PSNR", Method::Psnr, PixelError::SquaredToned },
  { "PSNR-linear", Method::Psnr, PixelError::SquaredClamped },
  { "SSIM", Method::Ssim, PixelError::SquaredToned },
  { "SSIM-linear", Method::Ssim, PixelError::SquaredClamped },
  { "FLIP", Method::Flip, PixelError::Squared },
  { "HDR-FLIP", Method::HdrFlip, PixelError::Squared },
};
constexpr double PsnrOfEqualImages = 200;

std::string SizeText(const ImageIn& v)
{
  return std::to_string(v.extent.width()) + " x " + std::to_string(v.extent.height());
}

const Metric& Find(const std::string& name)
{
  for (const Metric& m : Metrics)
    if (name == m.Name)
      return m;
  const std::string nearest = NearestName(name, MetricNames());
  std::string text = "unknown metric \"" + name + "\"";
  if (!nearest.empty())
    text += "; did you mean " + nearest + "?";
  else
  {
    text += "; there are";
    for (const Metric& m : Metrics)
      text += std::string(" ") + m.Name;
  }
  throw StageError(text);
}

void CheckFinite(const ImageIn& image, const char* what)
{
  int x = 0, y = 0;
  const std::int64_t bad = CountNonFinite(image, x, y);
  if (bad > 0)
    throw StageError("the " + std::string(what) + " has " + std::to_string(bad) + " non-finite pixel" +
                     (bad == 1 ? "" : "s") + ", the first at column " + std::to_string(x) + ", row " +
                     std::to_string(y) + " from the bottom");
}

void Check(const Metric& metric, const ImageIn& test, const ImageIn& reference)
{
  if (!test || !reference || test.extent.empty() || reference.extent.empty())
    throw StageError(std::string(metric.Name) + " of an empty image");
  if (test.extent.width() != reference.extent.width() || test.extent.height() != reference.extent.height())
    throw StageError("the image is " + SizeText(test) + ", the reference " + SizeText(reference));
  if (test.components != reference.components)
    throw StageError("the image has " + std::to_string(test.components) + " channels, the reference " +
                     std::to_string(reference.components));
  if (metric.How == Method::Ssim && std::min(test.extent.width(), test.extent.height()) < 2 * SsimRadius + 1)
    throw StageError(std::string(metric.Name) + " needs at least 11 x 11 pixels, the image is " + SizeText(test));
  if ((metric.How == Method::Flip || metric.How == Method::HdrFlip) && test.components != 3)
    throw StageError(std::string(metric.Name) + " needs 3 channels, the image has " + std::to_string(test.components));
  CheckFinite(test, "image");
  CheckFinite(reference, "reference");
}

void ForRows(int height, const std::function<void(int, int)>& body)
{
  auto loop = [&](vtkIdType begin, vtkIdType end) { body(int(begin), int(end)); };
  vtkSMPTools::For(0, height, 4, loop);
}

/// Row sums in parallel, added in order.
double SumOfRows(int height, const std::function<double(int)>& row)
{
  std::vector<double> sums(height);
  ForRows(height,
    [&](int begin, int end)
    {
      for (int y = begin; y < end; ++y)
        sums[y] = row(y);
    });
  double sum = 0;
  for (double s : sums)
    sum += s;
  return sum;
}

/// Per-pixel SSIM, mean over channels; borders repeat the outermost pixels.
std::vector<double> SsimMap(const ImageIn& test, const ImageIn& reference, bool tone)
{
  const int w = test.extent.width(), h = test.extent.height(), channels = test.components;
  const std::size_t plane = std::size_t(w) * h;
  std::vector<double> rows(5 * plane), map(plane, 0.);
  const auto value = tone ? ToneForMetrics : ClampForMetrics;
  for (int c = 0; c < channels; ++c)
  {
    ForRows(h,
      [&](int begin, int end)
      {
        std::vector<double> a(w), b(w);
        for (int y = begin; y < end; ++y)
        {
          for (int x = 0; x < w; ++x)
          {
            a[x] = value(test.at(test.extent.x0 + x, test.extent.y0 + y)[c]);
            b[x] = value(reference.at(reference.extent.x0 + x, reference.extent.y0 + y)[c]);
          }
          SsimRow(a.data(), b.data(), w, &rows[5 * (std::size_t(y) * w)]);
        }
      });
    ForRows(h,
      [&](int begin, int end)
      {
        for (int y = begin; y < end; ++y)
          for (int x = 0; x < w; ++x)
          {
            const double* around[2 * SsimRadius + 1];
            for (int j = -SsimRadius; j <= SsimRadius; ++j)
            {
              const int v = std::min(std::max(y + j, 0), h - 1);
              around[j + SsimRadius] = &rows[5 * (std::size_t(v) * w + x)];
            }
            map[std::size_t(y) * w + x] += SsimAt(around, 1.) / channels;
          }
      });
  }
  return map;
}

class FlipPlanes
{
public:
  FlipPlanes(int w, int h)
  {
    this->Image.width = w;
    this->Image.height = h;
    const std::size_t plane = this->Image.planeSize();
    this->Memory.resize(plane * (FlipImage::Decoded + FlipImage::Rows + FlipImage::Final));
    this->Image.decoded = this->Memory.data();
    this->Image.rows = this->Image.decoded + FlipImage::Decoded * plane;
    this->Image.final = this->Image.rows + FlipImage::Rows * plane;
  }
  void Fill(const ImageIn& image, bool tone, double exposure)
  {
    const int h = this->Image.height;
    ForRows(h, [&](int a, int b) { FlipDecode(image, tone, exposure, this->Image, a, b); });
    ForRows(h, [&](int a, int b) { FlipRow(this->Image, a, b); });
    ForRows(h, [&](int a, int b) { FlipColumn(this->Image, a, b); });
  }
  FlipImage Image;

private:
  std::vector<double> Memory;
};

FlipExposures ExposuresOf(const ImageIn& reference)
{
  std::vector<double> luminance;
  luminance.reserve(reference.extent.area());
  double smallest = 0;
  for (int y = reference.extent.y0; y < reference.extent.y1; ++y)
    for (int x = reference.extent.x0; x < reference.extent.x1; ++x)
    {
      const float* p = reference.at(x, y);
      const double l = Luminance(Vec3d(p[0], p[1], p[2]));
      luminance.push_back(l);
      if (l > 0 && (smallest == 0 || l < smallest))
        smallest = l;
    }
  const auto middle = luminance.begin() + std::ptrdiff_t(luminance.size() / 2);
  std::nth_element(luminance.begin(), middle, luminance.end());
  return FlipExposureRange(*std::max_element(middle, luminance.end()), *middle, smallest);
}

std::vector<double> FlipMap(const ImageIn& test, const ImageIn& reference, bool hdr)
{
  const int w = test.extent.width(), h = test.extent.height();
  FlipPlanes a(w, h), b(w, h);
  std::vector<double> map(std::size_t(w) * h, 0.);
  const FlipExposures exposures = hdr ? ExposuresOf(reference) : FlipExposures{ 0, 0, 1 };
  for (int i = 0; i < exposures.count; ++i)
  {
    a.Fill(test, hdr, exposures.at(i));
    b.Fill(reference, hdr, exposures.at(i));
    ForRows(h,
      [&](int begin, int end)
      {
        for (int y = begin; y < end; ++y)
          for (int x = 0; x < w; ++x)
          {
            double& v = map[std::size_t(y) * w + x];
            v = std::max(v, FlipPixel(a.Image, b.Image, x, y));
          }
      });
  }
  return map;
}

double Mean(const std::vector<double>& values)
{
  double sum = 0;
  for (double v : values)
    sum += v;
  return sum / double(values.size());
}

double Psnr(double mse)
{
  return mse > 0 ? std::min(-10 * std::log10(mse), PsnrOfEqualImages) : PsnrOfEqualImages;
}
}

std::vector<std::string> MetricNames()
{
  std::vector<std::string> names;
  for (const Metric& m : Metrics)
    names.push_back(m.Name);
  return names;
}

bool HigherIsBetter(const std::string& name)
{
  const Method how = Find(name).How;
  return how == Method::Psnr || how == Method::Ssim;
}

double MetricScratchBytes(const std::string& name)
{
  switch (Find(name).How)
  {
    case Method::Trimmed:
      return 2 * sizeof(double);
    case Method::Ssim:
      return 6 * sizeof(double); // SsimMap: rows and map
    case Method::Flip:
      return (2 * (FlipImage::Decoded + FlipImage::Rows + FlipImage::Final) + 1) * sizeof(double);
    case Method::HdrFlip:
      return (2 * (FlipImage::Decoded + FlipImage::Rows + FlipImage::Final) + 2) * sizeof(double);
    default:
      return 0;
  }
}

double ComputeMetric(const std::string& name, const ImageIn& test, const ImageIn& reference)
{
  const Metric& metric = Find(name);
  Check(metric, test, reference);
  const int w = test.extent.width(), h = test.extent.height();
  const std::int64_t pixels = std::int64_t(w) * h;
  switch (metric.How)
  {
    case Method::Mean:
    case Method::Root:
    case Method::Psnr:
    {
      const double mean =
        SumOfRows(h, [&](int y) { return ErrorRowSum(metric.Kind, test, reference, y); }) / double(pixels);
      return metric.How == Method::Mean ? mean : metric.How == Method::Root ? std::sqrt(mean) : Psnr(mean);
    }
    case Method::Trimmed:
    {
      std::vector<double> errors(pixels), scratch(pixels);
      ForRows(h,
        [&](int begin, int end)
        {
          for (int y = begin; y < end; ++y)
            for (int x = 0; x < w; ++x)
              errors[std::size_t(y) * w + x] = PixelErrorAt(metric.Kind, test, reference, x, y);
        });
      const std::int64_t leftOut = pixels / 1000;
      return TrimmedSum(errors.data(), scratch.data(), pixels, leftOut) / double(pixels - leftOut);
    }
    case Method::Ssim:
    {
      const std::vector<double> map = SsimMap(test, reference, metric.Kind == PixelError::SquaredToned);
      double sum = 0;
      for (int y = SsimRadius; y < h - SsimRadius; ++y)
        for (int x = SsimRadius; x < w - SsimRadius; ++x)
          sum += map[std::size_t(y) * w + x];
      return sum / (double(w - 2 * SsimRadius) * (h - 2 * SsimRadius));
    }
    case Method::Flip:
    case Method::HdrFlip:
      return Mean(FlipMap(test, reference, metric.How == Method::HdrFlip));
  }
  return 0;
}

void ComputeErrorMap(const std::string& name, const ImageIn& test, const ImageIn& reference, const ImageOut& map)
{
  const Metric& metric = Find(name);
  Check(metric, test, reference);
  const int w = test.extent.width(), h = test.extent.height();
  if (!map || map.components != 1 || map.extent.width() != w || map.extent.height() != h)
    throw StageError("the error map must have one channel and the image's size");
  std::vector<double> values;
  if (metric.How == Method::Ssim)
  {
    values = SsimMap(test, reference, metric.Kind == PixelError::SquaredToned);
    for (double& v : values)
      v = 1 - v;
  }
  else if (metric.How == Method::Flip || metric.How == Method::HdrFlip)
    values = FlipMap(test, reference, metric.How == Method::HdrFlip);
  ForRows(h,
    [&](int begin, int end)
    {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < w; ++x)
          *map.at(map.extent.x0 + x, map.extent.y0 + y) = float(std::min(double(std::numeric_limits<float>::max()),
            values.empty() ? PixelErrorAt(metric.Kind, test, reference, x, y) : values[std::size_t(y) * w + x]));
    });
}
}
