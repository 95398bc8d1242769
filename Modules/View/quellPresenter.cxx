// SPDX-License-Identifier: BSD-3-Clause
#include "quellPresenter.h"

#include "quellMetrics.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace quell
{
namespace
{
ImageIn View(const Picture& p)
{
  return ArrayView(p.Image, p.Array);
}

std::string SizeText(const ImageIn& v)
{
  return std::to_string(v.extent.width()) + " x " + std::to_string(v.extent.height());
}

Picture NewPicture(vtkImageData* like, const std::string& name, int components, ArrayKind kind, ImageOut& out)
{
  Picture p;
  p.Image = vtkSmartPointer<vtkImageData>::New();
  p.Image->CopyStructure(like);
  vtkNew<vtkFloatArray> values;
  values->SetName(name.c_str());
  values->SetNumberOfComponents(components);
  values->SetNumberOfTuples(p.Image->GetNumberOfPoints());
  p.Image->GetPointData()->AddArray(values);
  p.Array = name;
  p.Kind = kind;
  int e[6];
  p.Image->GetExtent(e);
  out = ImageOut(values->GetPointer(0), components, Rect{ e[0], e[2], e[1] + 1, e[3] + 1 });
  return p;
}

/// Metrics refuse what is not finite; a picture that has some is compared all the same, with those pixels black.
Picture Finite(const Picture& p)
{
  const ImageIn in = View(p);
  bool good = true;
  for (int y = in.extent.y0; y < in.extent.y1 && good; ++y)
  {
    const float* row = in.at(in.extent.x0, y);
    good = std::all_of(row, row + in.extent.width() * in.components, [](float v) { return std::isfinite(v); });
  }
  if (good)
  {
    return p;
  }
  ImageOut out;
  Picture q = NewPicture(p.Image, p.Array, in.components, p.Kind, out);
  for (int y = in.extent.y0; y < in.extent.y1; ++y)
  {
    const float* row = in.at(in.extent.x0, y);
    float* to = out.at(in.extent.x0, y);
    for (int i = 0; i < in.extent.width() * in.components; ++i)
    {
      to[i] = std::isfinite(row[i]) ? row[i] : 0.f;
    }
  }
  return q;
}
}

Histogram HistogramOf(const Picture& picture, bool logarithmic)
{
  Histogram h;
  h.Logarithmic = logarithmic;
  const ImageIn in = View(picture);
  if (!in)
  {
    return h;
  }
  h.Channels = std::min(3, in.components);
  std::vector<float> sample;
  std::array<double, 3> sum{};
  std::int64_t finite = 0;
  const std::ptrdiff_t stride = std::max<std::ptrdiff_t>(1, in.extent.area() / 32768);
  std::ptrdiff_t at = 0;
  for (int y = in.extent.y0; y < in.extent.y1; ++y)
  {
    for (int x = in.extent.x0; x < in.extent.x1; ++x, ++at)
    {
      const float* v = in.at(x, y);
      ++h.Pixels;
      if (!std::all_of(v, v + h.Channels, [](float f) { return std::isfinite(f); }))
      {
        ++h.NonFinite;
        continue;
      }
      for (int c = 0; c < h.Channels; ++c)
      {
        const std::size_t i = std::size_t(c);
        sum[i] += double(v[c]);
        h.Minimum[i] = finite == 0 ? double(v[c]) : std::min(h.Minimum[i], double(v[c]));
        h.Maximum[i] = finite == 0 ? double(v[c]) : std::max(h.Maximum[i], double(v[c]));
        if (at % stride == 0 && (!logarithmic || v[c] > 0))
        {
          sample.push_back(v[c]);
        }
      }
      ++finite;
    }
  }
  if (sample.empty())
  {
    return h;
  }
  for (std::size_t c = 0; c < std::size_t(h.Channels); ++c)
  {
    h.Mean[c] = sum[c] / double(finite);
  }
  std::sort(sample.begin(), sample.end());
  const double low = double(sample[sample.size() / 500]),
               high = double(sample[sample.size() - 1 - sample.size() / 500]);
  h.Low = std::min(0., low);
  h.High = high;
  if (logarithmic)
  {
    h.High = std::log10(*std::max_element(h.Maximum.begin(), h.Maximum.begin() + h.Channels));
    h.Low = std::max(std::log10(low), h.High - 6);
  }
  if (!(h.High > h.Low))
  {
    h.High = h.Low + 1;
  }
  for (int y = in.extent.y0; y < in.extent.y1; ++y)
  {
    for (int x = in.extent.x0; x < in.extent.x1; ++x)
    {
      const float* v = in.at(x, y);
      for (int c = 0; c < h.Channels; ++c)
      {
        if (!std::isfinite(v[c]))
        {
          continue;
        }
        const double value = logarithmic ? (v[c] > 0 ? std::log10(double(v[c])) : -1e30) : double(v[c]);
        const double t = (value - h.Low) / (h.High - h.Low);
        if (t < 0)
        {
          ++h.Below;
        }
        else if (t > 1)
        {
          ++h.Above;
        }
        else
        {
          ++h.Counts[std::size_t(c)][std::size_t(std::min(Histogram::Bins - 1, int(t * Histogram::Bins)))];
        }
      }
    }
  }
  return h;
}

DifferenceFigures DifferenceOf(const Picture& a, const Picture& b)
{
  DifferenceFigures d;
  const ImageIn x = View(a), y = View(b);
  if (!x || !y || x.extent.width() != y.extent.width() || x.extent.height() != y.extent.height() ||
      x.components != y.components)
  {
    return d;
  }
  std::int64_t count = 0;
  double sum = 0;
  for (int row = 0; row < x.extent.height(); ++row)
  {
    for (int column = 0; column < x.extent.width(); ++column)
    {
      const float* u = x.at(x.extent.x0 + column, x.extent.y0 + row);
      const float* v = y.at(y.extent.x0 + column, y.extent.y0 + row);
      bool one = false;
      for (int c = 0; c < x.components; ++c)
      {
        const bool finite = std::isfinite(u[c]) && std::isfinite(v[c]);
        one = one || std::isfinite(u[c]) != std::isfinite(v[c]);
        if (!finite)
        {
          continue;
        }
        const double e = std::fabs(double(u[c]) - double(v[c]));
        sum += e;
        ++count;
        if (e > d.Largest)
        {
          d.Largest = e;
          d.LargestX = column;
          d.LargestY = row;
        }
      }
      d.OnlyOneFinite += one ? 1 : 0;
    }
  }
  d.Known = true;
  d.Mean = count > 0 ? sum / double(count) : 0;
  return d;
}

Picture Compare(const Picture& a, const Picture& b, CompareMap map, double gain, std::string& error)
{
  const ImageIn x = View(a), y = View(b);
  if (!x || !y)
  {
    error = !x ? "there is no picture A" : "there is no picture B to compare with";
    return {};
  }
  if (x.extent.width() != y.extent.width() || x.extent.height() != y.extent.height())
  {
    error = "A has " + SizeText(x) + " pixels and B " + SizeText(y);
    return {};
  }
  if (x.components != y.components)
  {
    error = "A has " + std::to_string(x.components) + " channels and B " + std::to_string(y.components);
    return {};
  }
  ImageOut out;
  if (map == CompareMap::RelativeError || map == CompareMap::Flip)
  {
    Picture p = NewPicture(a.Image, map == CompareMap::Flip ? "FLIP" : "relMSE", 1, ArrayKind::Scalar, out);
    const Picture fa = Finite(a), fb = Finite(b);
    ImageIn va = View(fa), vb = View(fb);
    vb.extent = va.extent;
    try
    {
      ComputeErrorMap(map == CompareMap::Flip ? "FLIP" : "relMSE", va, vb, out);
    }
    catch (const std::exception& e)
    {
      error = e.what();
      return {};
    }
    return p;
  }
  const bool colour = map == CompareMap::Difference && x.components >= 3;
  Picture p = NewPicture(a.Image, "difference", colour ? 3 : 1, colour ? ArrayKind::Color : ArrayKind::Scalar, out);
  for (int row = 0; row < x.extent.height(); ++row)
  {
    for (int column = 0; column < x.extent.width(); ++column)
    {
      const float* u = x.at(x.extent.x0 + column, x.extent.y0 + row);
      const float* v = y.at(y.extent.x0 + column, y.extent.y0 + row);
      float* to = out.at(x.extent.x0 + column, x.extent.y0 + row);
      const auto minus = [&](int c) { return u[c] == v[c] ? 0. : double(u[c]) - double(v[c]); };
      if (colour)
      {
        for (int c = 0; c < 3; ++c)
        {
          to[c] = float(gain * std::fabs(minus(c)));
        }
      }
      else
      {
        const double d = x.components >= 3 ? 0.2126 * minus(0) + 0.7152 * minus(1) + 0.0722 * minus(2) : minus(0);
        to[0] = float(gain * (map == CompareMap::SignedDifference ? d : std::fabs(d)));
      }
    }
  }
  return p;
}

bool PresentWish::operator==(const PresentWish& o) const
{
  return this->A == o.A && this->B == o.B && this->Display == o.Display && this->Map == o.Map && this->Gain == o.Gain &&
         this->WantHistogram == o.WantHistogram && this->LogHistogram == o.LogHistogram && this->Metrics == o.Metrics &&
         this->Reference == o.Reference;
}

struct Presenter::Internals
{
  mutable std::mutex Mutex;
  mutable std::condition_variable Changed;
  bool Quit = false, Busy = false;
  PresentWish Wanted;
  std::uint64_t Serial = 0, DoneSerial = 0;
  std::shared_ptr<const Presentation> Last;
  std::function<void()> Notify;
  std::thread Thread;

  DisplayMapper MapperA, MapperB;

  bool Superseded(std::uint64_t serial) const
  {
    std::lock_guard<std::mutex> lock(this->Mutex);
    return this->Quit || this->Serial != serial;
  }

  void Publish(const Presentation& p)
  {
    std::function<void()> notify;
    {
      std::lock_guard<std::mutex> lock(this->Mutex);
      this->Last = std::make_shared<Presentation>(p);
      notify = this->Notify;
    }
    if (notify)
    {
      notify();
    }
  }

  void Serve(const PresentWish& wish, std::uint64_t serial, const Presentation* before)
  {
    Presentation p;
    const bool sameDisplay = before && before->Complete && before->Wish.Display == wish.Display;
    p.Serial = serial;
    p.Wish = wish;
    // Until they are made anew, what was there is better than nothing.
    if (before)
    {
      p.Map = before->Map;
      p.MapError = before->MapError;
      p.Difference = before->Difference;
      p.Bars = before->Bars;
      p.Errors = before->Errors;
      p.ErrorsText = before->ErrorsText;
    }
    if (wish.A)
    {
      p.A = sameDisplay && before->Wish.A == wish.A
              ? before->A
              : this->MapperA.Map(wish.A.Image, wish.A.Array, wish.A.Kind, wish.Display);
    }
    if (wish.B)
    {
      // The same scale for both: else equal values would look different.
      DisplaySettings settings = wish.Display;
      if (wish.A && p.A.Error.empty() && wish.Map == CompareMap::None && p.A.Style != DisplayStyle::View &&
          wish.A.Kind == wish.B.Kind)
      {
        settings.AutoRange = false;
        settings.Low = p.A.Low;
        settings.High = p.A.High;
      }
      p.B = this->MapperB.Map(wish.B.Image, wish.B.Array, wish.B.Kind, settings);
    }
    this->Publish(p);
    p.Map = DisplayImage();
    p.MapError.clear();
    p.Difference = wish.Map != CompareMap::None ? DifferenceOf(wish.A, wish.B) : DifferenceFigures();
    if (wish.Map != CompareMap::None)
    {
      const Picture map = Compare(wish.A, wish.B, wish.Map, wish.Gain, p.MapError);
      if (map)
      {
        DisplaySettings settings = wish.Display;
        settings.Style = wish.Map == CompareMap::Difference         ? DisplayStyle::Automatic
                         : wish.Map == CompareMap::SignedDifference ? DisplayStyle::Signed
                         : wish.Map == CompareMap::Flip             ? DisplayStyle::Error
                                                                    : DisplayStyle::LogHeat;
        settings.AutoRange = wish.Map == CompareMap::RelativeError;
        settings.Low = wish.Map == CompareMap::SignedDifference ? -1 : 0;
        settings.High = 1;
        settings.Exposure = 0;
        p.Map = this->MapperA.Map(map.Image, map.Array, map.Kind, settings);
      }
    }
    p.Bars = wish.WantHistogram ? HistogramOf(wish.A, wish.LogHistogram) : Histogram();
    if (this->Superseded(serial))
    {
      this->Publish(p);
      return;
    }
    const bool sameErrors = before && before->Complete && before->Wish.A == wish.A &&
                            before->Wish.Reference == wish.Reference && before->Wish.Metrics == wish.Metrics;
    if (!sameErrors)
    {
      p.Errors.clear();
      p.ErrorsText.clear();
      const ImageIn a = View(wish.A), r = View(wish.Reference);
      if (a && r && !wish.Metrics.empty())
      {
        if (a.components != r.components || a.extent.width() != r.extent.width() ||
            a.extent.height() != r.extent.height())
        {
          p.ErrorsText = "the picture has " + SizeText(a) + " pixels of " + std::to_string(a.components) +
                         " channels, the reference " + SizeText(r) + " of " + std::to_string(r.components);
        }
        else
        {
          const Picture fa = Finite(wish.A), fr = Finite(wish.Reference);
          const ImageIn va = View(fa);
          ImageIn vr = View(fr);
          vr.extent = va.extent;
          for (const std::string& metric : wish.Metrics)
          {
            if (this->Superseded(serial))
            {
              return;
            }
            try
            {
              p.Errors.emplace_back(metric, ComputeMetric(metric, va, vr));
            }
            catch (const std::exception& e)
            {
              p.ErrorsText = e.what();
            }
          }
        }
      }
    }
    p.Complete = true;
    this->Publish(p);
  }

  void Loop()
  {
    for (;;)
    {
      PresentWish wish;
      std::uint64_t serial = 0;
      std::shared_ptr<const Presentation> before;
      {
        std::unique_lock<std::mutex> lock(this->Mutex);
        this->Busy = false;
        this->Changed.notify_all();
        this->Changed.wait(lock, [this] { return this->Quit || this->Serial != this->DoneSerial; });
        if (this->Quit)
        {
          return;
        }
        wish = this->Wanted;
        serial = this->Serial;
        before = this->Last;
        this->Busy = true;
      }
      this->Serve(wish, serial, before.get());
      {
        std::lock_guard<std::mutex> lock(this->Mutex);
        this->DoneSerial = serial;
      }
    }
  }
};

Presenter::Presenter()
  : Internal(new Internals)
{
  this->Internal->Thread = std::thread([this] { this->Internal->Loop(); });
}

Presenter::~Presenter()
{
  {
    std::lock_guard<std::mutex> lock(this->Internal->Mutex);
    this->Internal->Quit = true;
    this->Internal->Notify = nullptr;
  }
  this->Internal->Changed.notify_all();
  this->Internal->Thread.join();
}

std::uint64_t Presenter::Wish(const PresentWish& wish)
{
  std::uint64_t serial = 0;
  {
    std::lock_guard<std::mutex> lock(this->Internal->Mutex);
    Internals& in = *this->Internal;
    if (in.Serial > 0 && in.Wanted == wish)
    {
      return in.Serial;
    }
    in.Wanted = wish;
    serial = ++in.Serial;
  }
  this->Internal->Changed.notify_all();
  return serial;
}

std::shared_ptr<const Presentation> Presenter::Latest() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return this->Internal->Last;
}

bool Presenter::Idle() const
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  return !this->Internal->Busy && this->Internal->Serial == this->Internal->DoneSerial;
}

bool Presenter::WaitIdle(double seconds) const
{
  std::unique_lock<std::mutex> lock(this->Internal->Mutex);
  const Internals& in = *this->Internal;
  return in.Changed.wait_for(
    lock, std::chrono::duration<double>(seconds), [&in] { return !in.Busy && in.Serial == in.DoneSerial; });
}

void Presenter::SetNotify(std::function<void()> notify)
{
  std::lock_guard<std::mutex> lock(this->Internal->Mutex);
  this->Internal->Notify = std::move(notify);
}
}
