// SPDX-License-Identifier: BSD-3-Clause
// One stage of any type, every input fed, for tests over the whole registry.
#ifndef StageBench_h
#define StageBench_h

#include "../AllStages.h"
#include "vtkDataArray.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"
#include "vtkQuellStage.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

namespace
{
enum class Content
{
  Plain,
  Zero,
  NotANumber, ///< one NaN pixel in every colour
  Infinite,   ///< one +inf pixel in every colour
  Huge,       ///< 1e30 everywhere
  Peak,       ///< 2 x 2 pixels of 3e38 among small ones
  Denormal,   ///< 1e-42 everywhere
  Constant    ///< the same colour everywhere, background included, under varied guides
};

/// What every pixel holds with Content::Constant.
const float ConstantColor[4] = { 0.7f, 2.3f, 0.11f, 1.f };

inline float Noise(std::uint32_t x, std::uint32_t y, std::uint32_t c)
{
  std::uint32_t h = x * 0x9e3779b9u ^ y * 0x85ebca6bu ^ c * 0xc2b2ae35u;
  h ^= h >> 16;
  h *= 0x7feb352du;
  h ^= h >> 15;
  h *= 0x846ca68bu;
  h ^= h >> 16;
  return float(h >> 8) * 0x1p-24f;
}

/// What a test makes of a pixel of an array: `value` holds `n` components of the usual content.
using quellChange = std::function<void(int x, int y, float* value, int n)>;

/// A tilted plane with a step in depth, a second object and a corner of background.
class vtkQuellContractSource : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellContractSource);
  int Width = 17, Height = 13;
  Content What = Content::Plain;
  std::uint32_t Salt = 0; ///< other noise
  int Period = 0;         ///< > 0: the content of so many rows and columns over and over, for frames that are large
  quellChange Change;
  std::function<void(quell::FrameFacts&)> Facts;

  /// The whole array as it would be made.
  std::vector<float> Values(const std::string& name) const
  {
    const quell::ArrayType& type = *quell::FindArray(name);
    std::vector<float> values(std::size_t(this->Width) * this->Height * type.Components);
    float* v = values.data();
    for (int y = 0; y < this->Height; ++y)
      for (int x = 0; x < this->Width; ++x, v += type.Components)
        this->Make(type, x, y, v, type.Components);
    return values;
  }

protected:
  vtkQuellContractSource() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    w = this->Width;
    h = this->Height;
  }
  void Execute(quell::StageFrame& frame) override
  {
    const quell::Rect r = frame.Region();
    if (this->Facts)
      this->Facts(frame.OutputFacts);
    for (const std::string& name : frame.WantedArrays())
    {
      const quell::ImageOut out = frame.Output(name);
      if (!out)
        continue;
      const quell::ArrayType* type = quell::FindArray(name);
      const int n = out.components;
      if (this->Period > 0)
      {
        std::vector<float> tile(std::size_t(this->Period) * this->Period * n);
        for (int i = 0; i < this->Period * this->Period; ++i)
          this->Make(*type, i % this->Period, i / this->Period, &tile[std::size_t(i) * n], n);
        for (int y = r.y0; y < r.y1; ++y)
          for (int x = r.x0; x < r.x1;)
          {
            const int from = x % this->Period, count = std::min(r.x1 - x, this->Period - from);
            std::copy_n(
              &tile[(std::size_t(y % this->Period) * this->Period + from) * n], std::size_t(count) * n, out.at(x, y));
            x += count;
          }
        continue;
      }
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
          this->Make(*type, x, y, out.at(x, y), n);
    }
  }

private:
  void Make(const quell::ArrayType& type, int x, int y, float* value, int n) const
  {
    const bool background = x + y > this->Width + this->Height - 8 && this->Width > 8;
    for (int c = 0; c < n; ++c)
      value[c] = this->What == Content::Constant && type.Kind == quell::ArrayKind::Color ? ConstantColor[c]
                 : background                                                            ? type.Background
                              : this->Pixel(type.Kind, x, y, c);
    if (this->Change)
      this->Change(x, y, value, n);
  }
  float Pixel(quell::ArrayKind kind, int x, int y, int c) const
  {
    const bool second = x > this->Width / 2;
    switch (kind)
    {
      case quell::ArrayKind::Color:
        if (this->What == Content::Zero)
          return 0;
        if (this->What == Content::Huge)
          return 1e30f;
        if (this->What == Content::Denormal)
          return 1e-42f;
        if (this->What == Content::Peak && x / 2 == this->Width / 6 && y / 2 == this->Height / 6)
          return 3e38f;
        if (x == this->Width / 3 && y == this->Height / 3)
        {
          if (this->What == Content::NotANumber)
            return std::nanf("");
          if (this->What == Content::Infinite)
            return std::numeric_limits<float>::infinity();
        }
        return 4 * Noise(x, y, c + this->Salt) * Noise(x, y, c + 7 + this->Salt);
      case quell::ArrayKind::Albedo:
        return second && c == 1 ? 0.f : 0.2f + 0.6f * Noise(x / 4, y / 4, c);
      case quell::ArrayKind::Normal:
        return c == 2 ? (second ? 0.8f : 1.f) : c == 0 && second ? 0.6f : 0.f;
      case quell::ArrayKind::Position:
        return c == 0 ? 0.1f * x : c == 1 ? 0.1f * y : second ? -1.f : 0.f;
      case quell::ArrayKind::Depth:
        return (second ? 5.f : 3.f) + 0.01f * x;
      case quell::ArrayKind::Motion:
        return c == 0 ? 0.3f : -0.2f;
      case quell::ArrayKind::Id:
        return second ? 2.f : 1.f;
      case quell::ArrayKind::Variance:
        return 0.1f;
      case quell::ArrayKind::Moments:
        return c == 0 ? 0.5f : 0.1f;
      case quell::ArrayKind::History:
        return float(1 + x % 6);
      case quell::ArrayKind::Display:
        return Noise(x, y, c);
      default:
        return Noise(x, y, c);
    }
  }
};
vtkStandardNewMacro(vtkQuellContractSource);
QUELL_STAGE_DESCRIPTION(vtkQuellContractSource)
void vtkQuellContractSource::Describe(quell::StageDescription& d)
{
  for (const quell::ArrayType& a : quell::KnownArrays())
    d.Output(a.Name, a.Kind, a.Doc);
}

inline std::string ArrayFor(quell::ArrayKind kind)
{
  switch (kind)
  {
    case quell::ArrayKind::Scalar:
      return "roughness";
    case quell::ArrayKind::Any:
    case quell::ArrayKind::Color:
      return "radiance";
    default:
      for (const quell::ArrayType& a : quell::KnownArrays())
        if (a.Kind == kind)
          return a.Name;
  }
  return "radiance";
}

using Pixels = std::map<std::string, std::vector<float>>;

inline Pixels ReadArrays(vtkImageData* image, const quell::ArraySet& names, const quell::Rect& region)
{
  Pixels pixels;
  const int* e = image->GetExtent();
  for (const std::string& name : names)
  {
    auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name.c_str()));
    if (!array)
      continue;
    const int n = array->GetNumberOfComponents();
    std::vector<float>& out = pixels[name];
    for (int y = region.y0; y < region.y1; ++y)
    {
      const float* row =
        array->GetPointer(0) + ((vtkIdType(y) - e[2]) * (vtkIdType(e[1]) - e[0] + 1) + region.x0 - e[0]) * n;
      out.insert(out.end(), row, row + std::size_t(region.width()) * n);
    }
  }
  return pixels;
}

/// One stage with every input connected to a contract source; delayed inputs read the same source as their past.
struct Bench
{
  vtkNew<vtkQuellContractSource> source, past;
  vtkSmartPointer<vtkQuellStage> stage;
  vtkNew<vtkQuellCollector> sink;
  quell::ArraySet outputs;

  Bench(const std::string& type, int width, int height, Content what)
  {
    source->Width = past->Width = width;
    source->Height = past->Height = height;
    source->What = past->What = what;
    stage = Registry().Create(type);
    const quell::StageDescription& d = stage->GetDescription();
    quell::ArraySet pastArrays;
    for (const quell::InputPort& port : d.Inputs)
      if (port.Delayed)
        pastArrays.insert(ArrayFor(port.Kind));
    if (!pastArrays.empty())
    {
      past->SetAlwaysMake(pastArrays);
      past->Update();
    }
    for (size_t p = 0; p < d.Inputs.size(); ++p)
    {
      if (d.Inputs[p].Delayed)
      {
        stage->SetHistory(int(p), past->GetOutput());
        stage->SetInputArray(int(p), 0, ArrayFor(d.Inputs[p].Kind));
      }
      else
        stage->ConnectInput(d.Inputs[p].Name, source, ArrayFor(d.Inputs[p].Kind));
    }
    for (const quell::OutputArray& o : d.Outputs)
      outputs.insert(o.Name);
  }

  bool Run(const quell::Rect& region = quell::Rect())
  {
    sink->ClearRequests();
    sink->AddRequest(stage, outputs, region);
    return sink->UpdateTick(0);
  }
  Pixels Read(const quell::Rect& region) { return ReadArrays(stage->GetOutput(), outputs, region); }
};

inline bool SameBits(const Pixels& a, const Pixels& b, std::string& where)
{
  for (const auto& entry : a)
  {
    const auto other = b.find(entry.first);
    if (other == b.end() || other->second.size() != entry.second.size() ||
        std::memcmp(other->second.data(), entry.second.data(), entry.second.size() * 4) != 0)
    {
      where = entry.first;
      return false;
    }
  }
  return a.size() == b.size();
}
}

#endif
