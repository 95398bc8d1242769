// SPDX-License-Identifier: BSD-3-Clause
#include "quellDisplayMapping.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellDisplayTransform.h"
#include "vtkTrivialProducer.h"

#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace OCIO = OCIO_NAMESPACE;

namespace quell
{
namespace
{
struct Rgb
{
  double r, g, b;
};

// Knots at equal distances; the shape of the usual perceptually even maps.
const std::vector<Rgb> Inferno{ { 0, 0, 4 }, { 31, 12, 72 }, { 85, 15, 109 }, { 136, 34, 106 }, { 186, 54, 85 },
  { 227, 89, 51 }, { 249, 140, 10 }, { 249, 201, 50 }, { 252, 255, 164 } };
const std::vector<Rgb> Viridis{ { 68, 1, 84 }, { 71, 44, 122 }, { 59, 81, 139 }, { 44, 113, 142 }, { 33, 144, 141 },
  { 39, 173, 129 }, { 92, 200, 99 }, { 170, 220, 50 }, { 253, 231, 37 } };
const std::vector<Rgb> Magma{ { 0, 0, 4 }, { 28, 16, 68 }, { 79, 18, 123 }, { 129, 37, 129 }, { 181, 54, 122 },
  { 229, 80, 100 }, { 251, 135, 97 }, { 254, 194, 135 }, { 252, 253, 191 } };
const std::vector<Rgb> Diverging{ { 33, 80, 196 }, { 120, 158, 240 }, { 225, 225, 225 }, { 240, 140, 110 },
  { 190, 20, 40 } };

Rgb Interpolate(const std::vector<Rgb>& knots, double t)
{
  const double x = std::min(1., std::max(0., t)) * double(knots.size() - 1);
  const std::size_t i = std::min(knots.size() - 2, std::size_t(x));
  const double f = x - double(i);
  const Rgb &a = knots[i], &b = knots[i + 1];
  return { a.r + f * (b.r - a.r), a.g + f * (b.g - a.g), a.b + f * (b.b - a.b) };
}

Rgb Hue(double h, double saturation, double value)
{
  const auto channel = [&](double shift)
  {
    const double k = std::fabs(std::fmod(h * 6 + shift, 6.) - 3) - 1;
    return 255 * value * (1 - saturation * (1 - std::min(1., std::max(0., k))));
  };
  return { channel(0), channel(4), channel(2) };
}

double Luminance(const float* v, int components)
{
  return components >= 3 ? 0.2126 * double(v[0]) + 0.7152 * double(v[1]) + 0.0722 * double(v[2]) : double(v[0]);
}

std::uint8_t Byte(double v)
{
  return std::uint8_t(std::min(255., std::max(0., v + 0.5)));
}

struct Scale
{
  double Low = 0, High = 1;
  bool Logarithmic = false;
  double operator()(double v) const
  {
    if (this->Logarithmic)
    {
      return v > 0 ? (std::log(v) - std::log(this->Low)) / (std::log(this->High) - std::log(this->Low)) : 0.;
    }
    return (v - this->Low) / (this->High - this->Low);
  }
};
}

const std::vector<std::pair<DisplayStyle, const char*>>& DisplayStyleNames()
{
  static const std::vector<std::pair<DisplayStyle, const char*>> names{ { DisplayStyle::Automatic, "Automatic" },
    { DisplayStyle::View, "Colour view" }, { DisplayStyle::Heat, "Heat map" },
    { DisplayStyle::LogHeat, "Heat map, log" }, { DisplayStyle::Gray, "Gray" }, { DisplayStyle::Red, "Red" },
    { DisplayStyle::Green, "Green" }, { DisplayStyle::Blue, "Blue" }, { DisplayStyle::Direction, "Direction" },
    { DisplayStyle::Flow, "Flow" }, { DisplayStyle::Labels, "Labels" }, { DisplayStyle::Error, "Error map" },
    { DisplayStyle::Signed, "Signed" } };
  return names;
}

bool DisplaySettings::operator==(const DisplaySettings& o) const
{
  return this->View == o.View && this->Exposure == o.Exposure && this->Style == o.Style &&
         this->AutoRange == o.AutoRange && this->Low == o.Low && this->High == o.High &&
         this->FlagNonFinite == o.FlagNonFinite;
}

ArrayKind KindOf(const std::string& array, int components)
{
  if (const ArrayType* type = FindArray(array))
  {
    return type->Kind;
  }
  return components >= 3 ? ArrayKind::Color : components == 2 ? ArrayKind::Motion : ArrayKind::Scalar;
}

DisplayStyle StyleOf(ArrayKind kind, int components)
{
  switch (kind)
  {
    case ArrayKind::Normal:
      return DisplayStyle::Direction;
    case ArrayKind::Depth:
    case ArrayKind::Variance:
      return DisplayStyle::LogHeat;
    case ArrayKind::Motion:
      return DisplayStyle::Flow;
    case ArrayKind::Id:
      return DisplayStyle::Labels;
    case ArrayKind::History:
    case ArrayKind::Moments:
      return DisplayStyle::Heat;
    case ArrayKind::Scalar:
      return DisplayStyle::Gray;
    case ArrayKind::Position:
    case ArrayKind::Display:
      return DisplayStyle::View; // shown as it is, see Map
    default:
      return components >= 3 ? DisplayStyle::View : DisplayStyle::Gray;
  }
}

bool InfinityIsValue(ArrayKind kind, const std::string& array)
{
  return kind == ArrayKind::Depth || array == "hitDistance";
}

void MapColor(DisplayStyle style, double t, std::uint8_t rgb[3])
{
  Rgb c{ 255 * t, 255 * t, 255 * t };
  switch (style)
  {
    case DisplayStyle::Heat:
    case DisplayStyle::LogHeat:
      c = Interpolate(Viridis, t);
      break;
    case DisplayStyle::Error:
      c = Interpolate(Magma, t);
      break;
    case DisplayStyle::Signed:
      c = Interpolate(Diverging, t);
      break;
    case DisplayStyle::Red:
      c = { 255 * t, 40 * t, 40 * t };
      break;
    case DisplayStyle::Green:
      c = { 40 * t, 255 * t, 40 * t };
      break;
    case DisplayStyle::Blue:
      c = { 60 * t, 60 * t, 255 * t };
      break;
    default:
      break;
  }
  rgb[0] = Byte(c.r);
  rgb[1] = Byte(c.g);
  rgb[2] = Byte(c.b);
}

ImageIn ArrayView(vtkImageData* image, const std::string& array)
{
  if (!image)
  {
    return {};
  }
  vtkFloatArray* values = array.empty() ? vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(0))
                                        : vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array.c_str()));
  int e[6];
  image->GetExtent(e);
  const Rect extent{ e[0], e[2], e[1] + 1, e[3] + 1 };
  if (!values || values->GetNumberOfTuples() != extent.area() || extent.empty())
  {
    return {};
  }
  return ImageIn(values->GetPointer(0), values->GetNumberOfComponents(), extent);
}

struct DisplayMapper::Internals
{
  vtkNew<vtkTrivialProducer> Source;
  vtkNew<vtkQuellDisplayTransform> Transform;
  bool Connected = false;
};

DisplayMapper::DisplayMapper()
  : Internal(new Internals)
{
}
DisplayMapper::~DisplayMapper() = default;

std::vector<std::string> DisplayMapper::Views()
{
  std::vector<std::string> views;
  try
  {
    const OCIO::ConstConfigRcPtr config =
      OCIO::Config::CreateFromFile(vtkQuellDisplayTransform::ShippedConfig().c_str());
    const char* display = config->getDefaultDisplay();
    for (int i = 0; i < config->getNumViews(display); ++i)
    {
      views.push_back(config->getView(display, i));
    }
  }
  catch (const std::exception&)
  {
    // The mapper says so when it is asked for a picture.
  }
  return views;
}

DisplayImage DisplayMapper::Map(
  vtkImageData* image, const std::string& array, ArrayKind kind, const DisplaySettings& settings)
{
  DisplayImage out;
  const ImageIn in = ArrayView(image, array);
  if (!in)
  {
    out.Error = array.empty() ? std::string("there is no image") : "the frame has no array \"" + array + "\"";
    return out;
  }
  const int w = in.extent.width(), h = in.extent.height(), n = in.components;
  out.Width = w;
  out.Height = h;
  out.Rgba.assign(std::size_t(w) * std::size_t(h) * 4, 255);
  const bool automatic = settings.Style == DisplayStyle::Automatic;
  out.Style = automatic ? StyleOf(kind, n) : settings.Style;
  if (out.Style == DisplayStyle::View && n < 3)
  {
    out.Style = DisplayStyle::Gray;
  }
  if ((out.Style == DisplayStyle::Direction && n < 3) || (out.Style == DisplayStyle::Flow && n < 2))
  {
    out.Style = DisplayStyle::Gray;
  }
  const bool infinityIsValue = InfinityIsValue(kind, array);
  const double gain = std::exp2(settings.Exposure);

  // What is not finite, and the values that a range is made from.
  const auto value = [&](const float* v)
  {
    switch (out.Style)
    {
      case DisplayStyle::Red:
        return double(v[0]);
      case DisplayStyle::Green:
        return double(v[std::min(1, n - 1)]);
      case DisplayStyle::Blue:
        return double(v[std::min(2, n - 1)]);
      case DisplayStyle::Flow:
        return std::hypot(double(v[0]), double(v[1]));
      default:
        return Luminance(v, n);
    }
  };
  std::vector<double> sample;
  const std::ptrdiff_t stride = std::max<std::ptrdiff_t>(1, in.extent.area() / 65536);
  std::ptrdiff_t at = 0;
  double smallest[3] = { 0, 0, 0 }, largest[3] = { 0, 0, 0 };
  bool any = false;
  for (int y = in.extent.y0; y < in.extent.y1; ++y)
  {
    for (int x = in.extent.x0; x < in.extent.x1; ++x, ++at)
    {
      const float* v = in.at(x, y);
      bool finite = true;
      for (int c = 0; c < n; ++c)
      {
        finite = finite && std::isfinite(v[c]);
      }
      if (!finite && !(infinityIsValue && !std::isnan(v[0]) && v[0] > 0))
      {
        if (out.NonFinite++ == 0)
        {
          out.FirstX = x;
          out.FirstY = y;
        }
      }
      if (finite && at % stride == 0)
      {
        sample.push_back(value(v));
        for (int c = 0; c < std::min(3, n); ++c)
        {
          smallest[c] = any ? std::min(smallest[c], double(v[c])) : double(v[c]);
          largest[c] = any ? std::max(largest[c], double(v[c])) : double(v[c]);
        }
        any = true;
      }
    }
  }

  Scale scale;
  scale.Logarithmic = out.Style == DisplayStyle::LogHeat;
  if (!settings.AutoRange && out.Style != DisplayStyle::Direction)
  {
    scale.Low = settings.Low;
    scale.High = settings.High;
  }
  else if (out.Style == DisplayStyle::Error)
  {
    scale.Low = 0;
    scale.High = 1;
  }
  else if (!sample.empty())
  {
    if (scale.Logarithmic)
    {
      sample.erase(std::remove_if(sample.begin(), sample.end(), [](double v) { return !(v > 0); }), sample.end());
    }
    std::sort(sample.begin(), sample.end());
    const auto quantile = [&](double q) { return sample[std::size_t(q * double(sample.size() - 1))]; };
    if (!sample.empty())
    {
      scale.Low = quantile(0.002);
      scale.High = quantile(0.998);
      // Gray shows [0, 1] as it is, and black is black.
      if (out.Style == DisplayStyle::Gray || out.Style == DisplayStyle::Heat || out.Style == DisplayStyle::Red ||
          out.Style == DisplayStyle::Green || out.Style == DisplayStyle::Blue || out.Style == DisplayStyle::Flow)
      {
        scale.Low = std::min(0., scale.Low);
        if (out.Style == DisplayStyle::Gray && scale.Low >= 0 && scale.High <= 1)
        {
          scale.Low = 0;
          scale.High = 1;
        }
      }
      if (out.Style == DisplayStyle::Signed)
      {
        scale.High = std::max(std::fabs(scale.Low), std::fabs(scale.High));
        scale.Low = -scale.High;
      }
    }
  }
  if (scale.Logarithmic && !(scale.Low > 0))
  {
    scale.Low = scale.High > 0 ? scale.High * 1e-6 : 1e-6;
  }
  if (!(scale.High > scale.Low))
  {
    const double room = std::max(1e-12, 1e-3 * std::fabs(scale.Low));
    scale.High = scale.Low + room;
  }
  out.Low = scale.Low;
  out.High = scale.High;
  out.Logarithmic = scale.Logarithmic;

  ImageIn shown; // display values that are already encoded
  if (out.Style == DisplayStyle::View && kind != ArrayKind::Position && kind != ArrayKind::Display)
  {
    Internals& self = *this->Internal;
    vtkNew<vtkImageData> one;
    one->ShallowCopy(image);
    one->GetPointData()->SetActiveScalars(array.c_str());
    self.Source->SetOutput(one);
    if (self.Connected)
    {
      self.Transform->SetInputArray(0, 0, array);
    }
    else
    {
      self.Transform->ConnectInput("radiance", self.Source, array);
      self.Connected = true;
    }
    // Reflectances are shown as they are.
    self.Transform->SetView(kind == ArrayKind::Albedo && automatic ? std::string("sRGB") : settings.View);
    self.Transform->SetExposure(kind == ArrayKind::Albedo && automatic ? 0. : settings.Exposure);
    self.Transform->SetAlwaysMake({ "display" });
    self.Transform->Update();
    shown = ArrayView(self.Transform->GetOutput(), "display");
    if (!shown)
    {
      out.Error = self.Transform->GetErrorText();
      out.Rgba.assign(out.Rgba.size(), 0);
      return out;
    }
  }

  for (int row = 0; row < h; ++row)
  {
    const int y = in.extent.y1 - 1 - row;
    std::uint8_t* to = &out.Rgba[std::size_t(row) * std::size_t(w) * 4];
    for (int x = in.extent.x0; x < in.extent.x1; ++x, to += 4)
    {
      const float* v = in.at(x, y);
      bool finite = true;
      for (int c = 0; c < n; ++c)
      {
        finite = finite && std::isfinite(v[c]);
      }
      if (!finite)
      {
        const bool flagged = settings.FlagNonFinite && !(infinityIsValue && !std::isnan(v[0]) && v[0] > 0);
        // Pink and black, which no picture has of itself.
        const bool dark = ((x / 2 + row / 2) & 1) != 0;
        if (flagged)
        {
          to[0] = dark ? 60 : 255;
          to[1] = 0;
          to[2] = dark ? 40 : 200;
          continue;
        }
        if (out.Style != DisplayStyle::View)
        {
          to[0] = 18;
          to[1] = 20;
          to[2] = 24;
          continue;
        }
      }
      switch (out.Style)
      {
        case DisplayStyle::View:
          if (shown)
          {
            const float* d = shown.at(x, y);
            for (int c = 0; c < 3; ++c)
            {
              to[c] = Byte(255. * double(d[c]));
            }
          }
          else
          {
            for (int c = 0; c < 3; ++c)
            {
              const double range = largest[c] - smallest[c];
              const double t = kind == ArrayKind::Display ? double(v[c])
                               : range > 0                ? (double(v[c]) - smallest[c]) / range
                                                          : 0.5;
              to[c] = Byte(255 * t);
            }
          }
          break;
        case DisplayStyle::Direction:
        {
          const bool none = v[0] == 0 && v[1] == 0 && v[2] == 0;
          for (int c = 0; c < 3; ++c)
          {
            to[c] = none ? std::uint8_t(18 + 3 * c) : Byte(127.5 * (1 + double(v[c])));
          }
          break;
        }
        case DisplayStyle::Flow:
        {
          const double length = std::hypot(double(v[0]), double(v[1]));
          const double strength = std::min(1., length / scale.High);
          const Rgb c =
            Hue(std::atan2(double(v[1]), double(v[0])) / 6.283185307179586 + 0.5, strength, 0.25 + 0.75 * strength);
          to[0] = Byte(c.r);
          to[1] = Byte(c.g);
          to[2] = Byte(c.b);
          break;
        }
        case DisplayStyle::Labels:
        {
          const std::int64_t label = std::int64_t(v[0]);
          if (label == 0)
          {
            to[0] = 18;
            to[1] = 20;
            to[2] = 24;
            break;
          }
          // Golden-ratio hues: neighbours in number are far apart in colour.
          const double hue = std::fmod(0.11 + 0.618033988749895 * double(label & 0xffffff), 1.);
          const Rgb c = Hue(hue, 0.45 + 0.2 * double(label % 3), 0.95 - 0.15 * double(label % 2));
          to[0] = Byte(c.r);
          to[1] = Byte(c.g);
          to[2] = Byte(c.b);
          break;
        }
        case DisplayStyle::Gray:
          MapColor(out.Style, std::min(1., std::max(0., scale(value(v)) * gain)), to);
          break;
        default:
          MapColor(out.Style, std::min(1., std::max(0., scale(value(v)))), to);
      }
    }
  }
  return out;
}
}
