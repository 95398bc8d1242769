// SPDX-License-Identifier: BSD-3-Clause
// One stage of any type with a source of its own on every connection, so that each array can be spoilt alone, and the
// promises of the stage's table (OutputBound) as a check.
#ifndef PortBench_h
#define PortBench_h

#include "StageBench.h"

#include "vtkInformation.h"
#include "vtkQuellArraySetKey.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

namespace
{
struct PortBench
{
  struct Feed
  {
    int Port, Connection;
    std::string Name; ///< "normal", "radiance 2"
    std::string Array;
    vtkSmartPointer<vtkQuellContractSource> Source;
    quell::ArrayKind Kind = quell::ArrayKind::Any;
  };
  int Width, Height;
  vtkSmartPointer<vtkQuellStage> Stage;
  std::vector<Feed> Feeds;
  quell::ArraySet Outputs;
  vtkNew<vtkQuellCollector> Sink;

  /// `leaveOut`: ports that stay unconnected, by blanks; "optional": all that may.
  PortBench(const std::string& type, int width, int height, const std::string& leaveOut = std::string())
    : Width(width)
    , Height(height)
    , Stage(Registry().Create(type))
  {
    const quell::StageDescription& d = this->Stage->GetDescription();
    if (d.Sink && d.FindProperty("File")) // a writer wants to know where
    {
      std::string error;
      this->Stage->SetPropertyText("File", testing::TempDir() + "contract-" + type + ".exr", error);
    }
    for (std::size_t p = 0; p < d.Inputs.size(); ++p)
    {
      const quell::InputPort& port = d.Inputs[p];
      if ((" " + leaveOut + " ").find(" " + port.Name + " ") != std::string::npos ||
          (leaveOut == "optional" && port.Optional))
        continue;
      const int connections = port.Repeatable && port.Kind != quell::ArrayKind::Any ? 2 : 1;
      for (int c = 0; c < connections; ++c)
      {
        Feed feed;
        feed.Port = int(p);
        feed.Connection = c;
        feed.Name = port.Name + (connections > 1 ? " " + std::to_string(c + 1) : std::string());
        feed.Kind = port.Kind;
        // What takes any array takes its usual one where that is known.
        const quell::ArrayType* usual = quell::FindArray(port.Array);
        feed.Array = port.Kind == quell::ArrayKind::Any && usual ? usual->Name : ArrayFor(port.Kind);
        if (const quell::ArrayType* array = quell::FindArray(feed.Array))
          feed.Kind = array->Kind;
        feed.Source = vtkSmartPointer<vtkQuellContractSource>::New();
        feed.Source->Width = width;
        feed.Source->Height = height;
        feed.Source->Salt = 0x51u * std::uint32_t(this->Feeds.size());
        if (!port.Delayed)
          this->Stage->ConnectInput(port.Name, feed.Source, feed.Array);
        this->Feeds.push_back(feed);
      }
    }
    this->Past();
    for (const quell::OutputArray& o : d.Outputs)
      this->Outputs.insert(o.Name);
  }
  /// Takes what the sources of delayed inputs make now as the previous frame.
  void Past()
  {
    for (Feed& feed : this->Feeds)
      if (this->IsDelayed(feed))
      {
        feed.Source->SetAlwaysMake({ feed.Array });
        feed.Source->Update();
        vtkNew<vtkImageData> image;
        image->ShallowCopy(feed.Source->GetOutput());
        vtkQuellStage::PROVIDED_ARRAYS()->Write(image->GetInformation(), { feed.Array });
        this->Stage->SetHistory(feed.Port, image);
        this->Stage->SetInputArray(feed.Port, 0, feed.Array);
      }
  }
  bool IsDelayed(const Feed& feed) const { return this->Stage->GetDescription().Inputs[feed.Port].Delayed; }
  void Change(Feed& feed, quellChange change)
  {
    feed.Source->Change = std::move(change);
    feed.Source->Modified();
    if (this->IsDelayed(feed))
      this->Past();
  }
  bool Run(const quell::Rect& region = quell::Rect())
  {
    this->Sink->ClearRequests();
    this->Sink->AddRequest(this->Stage, this->Outputs, region);
    return this->Sink->UpdateTick(0);
  }
  /// Computes the region although what is there may hold it.
  bool RunAnew(const quell::Rect& region)
  {
    this->Stage->Modified();
    const std::int64_t before = this->Stage->GetCounters().Executions;
    return this->Run(region) && this->Stage->GetCounters().Executions == before + 1;
  }
  Pixels Read() { return ReadArrays(this->Stage->GetOutput(), this->Outputs, { 0, 0, this->Width, this->Height }); }
  Pixels Read(const quell::Rect& region) { return ReadArrays(this->Stage->GetOutput(), this->Outputs, region); }
  /// How far what comes in through a feed may be seen: the region that the stage asks for, or its reach around x +
  /// motion.
  int Reach(const Feed& feed) const
  {
    const quell::InputPort& port = this->Stage->GetDescription().Inputs[feed.Port];
    return port.Delayed ? (port.Reach < 0 ? 1 << 20 : port.Reach + 1) : this->Stage->HaloFor(feed.Port);
  }
  /// Turns every int property down to 1 that makes the region smaller.
  void Narrow()
  {
    for (const quell::Property& p : this->Stage->GetDescription().Properties)
    {
      if (p.Kind != quell::Property::Type::Int || p.Minimum > 1 || p.Maximum < 1)
        continue;
      const std::string before = p.GetText(this->Stage);
      const int halo = this->Stage->HaloFor(0);
      std::string error;
      p.SetText(this->Stage, "1", error);
      if (this->Stage->HaloFor(0) >= halo)
        p.SetText(this->Stage, before, error);
    }
  }
  /// The arrays of a port as they are now.
  std::vector<std::vector<float>> Inputs(const std::string& port)
  {
    std::vector<std::vector<float>> all;
    for (Feed& feed : this->Feeds)
      if (this->Stage->GetDescription().Inputs[feed.Port].Name == port)
        all.push_back(feed.Source->Values(feed.Array));
    return all;
  }

  /// Empty where the output keeps to its bounds; else what is wrong.
  std::string Broken(const Pixels& out)
  {
    const quell::StageDescription& d = this->Stage->GetDescription();
    for (const quell::OutputArray& o : d.Outputs)
    {
      const auto found = out.find(o.Name);
      if (found == out.end())
        return o.Name + ": not made";
      const std::vector<float>& v = found->second;
      if (o.Bounds.empty() && !d.Inputs.empty())
        return o.Name + ": its table declares no bound (StageDescription::Mean ... Finite)";
      for (const quell::OutputBound& b : o.Bounds)
      {
        const std::string broken =
          b.Kind == quell::OutputBound::Law::Anything ? std::string() : this->Broken(b, v, out);
        if (!broken.empty())
          return o.Name + ": " + broken + (b.Text().empty() ? "" : " (declared: " + b.Text() + ")");
      }
    }
    return {};
  }

  /// Gives one colour in every pixel to what each output is declared to be a mean, or a part, of, and says what does
  /// not come out to the last bit. `checked` counts the declarations.
  std::string ChangedConstants(int& checked)
  {
    using Law = quell::OutputBound::Law;
    const quellChange constant = [](int, int, float* value, int n) { std::copy_n(ConstantColor, n, value); };
    const quell::StageDescription& d = this->Stage->GetDescription();
    for (const quell::OutputArray& o : d.Outputs)
      for (const quell::OutputBound& b : o.Bounds)
      {
        if (b.Kind != Law::Mean && b.Kind != Law::Constant && b.Kind != Law::Part)
          continue;
        if (std::any_of(b.Except.begin(), b.Except.end(),
              [&](const auto& e) { return this->Stage->GetPropertyText(e.first) == e.second; }))
          continue;
        for (Feed& feed : this->Feeds)
        {
          const bool of = std::count(b.Of.begin(), b.Of.end(), d.Inputs[feed.Port].Name) != 0;
          feed.Source->Change = of ? constant : quellChange();
          feed.Source->Modified();
        }
        this->Past();
        if (!this->Run())
          return this->Stage->GetErrorText();
        const std::vector<float> out = this->Read().at(o.Name);
        const bool zeros = b.OrZero || b.Kind == Law::Part;
        std::size_t wrong = 0, kept = 0;
        for (std::size_t i = 0; i < out.size(); ++i)
        {
          wrong += out[i] != ConstantColor[i % o.Components] && !(zeros && out[i] == 0);
          kept += out[i] == ConstantColor[i % o.Components];
        }
        if (wrong > 0 || (kept <= out.size() / 2 && b.Kind != Law::Part))
          return o.Name + ": " + std::to_string(wrong) + " of " + std::to_string(out.size()) + " values changed, " +
                 std::to_string(kept) + " kept";
        ++checked;
      }
    for (Feed& feed : this->Feeds)
      this->Change(feed, nullptr);
    return {};
  }

private:
  std::string Broken(const quell::OutputBound& b, const std::vector<float>& v, const Pixels& out)
  {
    using Law = quell::OutputBound::Law;
    const int n = int(v.size() / (std::size_t(this->Width) * this->Height));
    const auto at = [&](std::size_t i)
    {
      const std::size_t pixel = i / n;
      return " at " + std::to_string(pixel % this->Width) + " " + std::to_string(pixel / this->Width) + ", component " +
             std::to_string(i % n) + ": " + quell::detail::FormatDouble(v[i]);
    };
    for (std::size_t i = 0; i < v.size(); ++i)
      if (!std::isfinite(v[i]))
        return "not finite" + at(i);
    for (const auto& e : b.Except)
      if (this->Stage->GetPropertyText(e.first) == e.second)
        return {};
    const double largest = std::numeric_limits<float>::max();
    std::vector<std::vector<float>> inputs;
    for (const std::string& port : b.Of)
      for (std::vector<float>& array : this->Inputs(port))
        inputs.push_back(std::move(array));
    if (inputs.empty() && !b.Of.empty())
      return {}; // of optional inputs that are not connected
    if (b.Kind == Law::Within)
    {
      for (std::size_t i = 0; i < v.size(); ++i)
        if (!(v[i] >= b.Low && v[i] <= b.High))
          return "outside" + at(i);
    }
    else if (b.Kind == Law::AtMost)
    {
      double most = 0;
      for (const std::vector<float>& array : inputs)
      {
        double m = 0;
        for (float x : array)
          m = std::isfinite(x) ? std::max(m, std::fabs(double(x))) : m;
        most += m;
      }
      most *= b.Factor / (b.Divisor.empty() ? 1 : std::stod(this->Stage->GetPropertyText(b.Divisor)));
      for (std::size_t i = 0; i < v.size(); ++i)
        if (std::fabs(double(v[i])) > std::min(largest, most * (1 + 1e-5) + 1e-44))
          return "larger than " + quell::detail::FormatDouble(most) + at(i);
    }
    else if (b.Kind == Law::Total)
    {
      // What is not finite is left out by the stage's own rule; what exceeds the largest float cannot be kept.
      const auto countable = [&](const std::vector<float>& array)
      { return std::all_of(array.begin(), array.end(), [&](float x) { return std::fabs(x) < 0.5 * largest; }); };
      if (!countable(v) || !std::all_of(inputs.begin(), inputs.end(), countable))
        return {};
      for (int c = 0; c < n; ++c)
      {
        double in = 0, made = 0, size = 0;
        for (const std::vector<float>& array : inputs)
          for (std::size_t i = c; i < array.size(); i += n)
            in += array[i], size += std::fabs(double(array[i]));
        for (std::size_t i = c; i < v.size(); i += n)
          made += v[i];
        if (!(std::fabs(in - made) <= 1e-5 * size + 1e-42 * double(v.size())))
          return "adds up to " + quell::detail::FormatDouble(made) + " in component " + std::to_string(c) + ", not " +
                 quell::detail::FormatDouble(in);
      }
    }
    else if (b.Kind == Law::Mean)
      for (int c = 0; c < n; ++c)
      {
        double least = b.OrZero ? 0 : largest, most = b.OrZero ? 0 : -largest;
        bool some = b.OrZero;
        for (const std::vector<float>& array : inputs)
          for (std::size_t i = c; i < array.size(); i += n)
            if (std::isfinite(array[i]))
            {
              // A pixel is left out whole where one of its channels is not finite; its range may only be smaller.
              // What passes through keeps its value.
              const double in = array[i], limited = std::min(std::max(in, b.LeastIn), b.LargestIn);
              least = std::min({ least, in, limited });
              most = std::max({ most, in, limited });
              some = true;
            }
        if (!some)
          least = most = 0;
        const double slack = 4e-6 * std::max(std::fabs(least), std::fabs(most)) + 1e-44;
        for (std::size_t i = c; i < v.size(); i += n)
          // A pixel without any finite neighbour is 0.
          if ((v[i] < least - slack || v[i] > most + slack) && v[i] != 0)
            return "outside [" + quell::detail::FormatDouble(least) + ", " + quell::detail::FormatDouble(most) + "]" +
                   at(i);
      }
    else if (b.Kind == Law::Part)
    {
      const std::vector<float>& whole = inputs.at(0);
      for (std::size_t p = 0; p + n <= v.size(); p += n)
      {
        bool finite = true;
        for (int c = 0; c < n; ++c)
          finite = finite && std::isfinite(whole[p + c]);
        for (int c = 0; c < n && finite; ++c)
        {
          float sum = 0;
          for (const quell::OutputArray& o : this->Stage->GetDescription().Outputs)
            if (std::any_of(o.Bounds.begin(), o.Bounds.end(),
                  [](const quell::OutputBound& other) { return other.Kind == Law::Part; }))
              sum += out.at(o.Name)[p + c];
          if (sum != whole[p + c])
            return "the parts add up to " + quell::detail::FormatDouble(sum) + ", not " +
                   quell::detail::FormatDouble(whole[p + c]) + at(p + c);
          if (std::fabs(v[p + c]) > std::fabs(whole[p + c]) || v[p + c] * double(whole[p + c]) < 0)
            return "larger than the whole" + at(p + c);
        }
      }
    }
    return {};
  }
};
}

#endif
