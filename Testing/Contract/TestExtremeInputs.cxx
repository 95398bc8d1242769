// SPDX-License-Identifier: BSD-3-Clause
// Every type of the registry at the extremes: values in each array in turn, sizes, settings, cameras, wrong inputs,
// and what is left of poison in its history. A type is tested here by being registered; what its outputs keep to is
// read from its table (OutputBound).
#include "PortBench.h"
#include "quellMemoryLimits.h"
#include "quellPixelMemory.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkTrivialProducer.h"
#include "vtkUnsignedCharArray.h"

#include <gtest/gtest.h>

#include <cfloat>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <malloc.h>
#include <set>

namespace
{
std::vector<std::string> TypesWithInputs()
{
  std::vector<std::string> types;
  for (const std::string& type : Registry().Types())
    if (!Registry().Describe(type)->Inputs.empty())
      types.push_back(type);
  return types;
}

bool IsFinite(const std::vector<float>& values)
{
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

float SignallingNaN()
{
  const std::uint32_t bits = 0x7fa00000u;
  float v;
  std::memcpy(&v, &bits, sizeof v);
  return v;
}

struct Extreme
{
  const char* Name;
  std::function<float(float usual)> Value;
};
const Extreme extremes[] = {
  { "0", [](float) { return 0.f; } },
  { "-0", [](float) { return -0.f; } },
  { "denormal", [](float) { return 1e-42f; } },
  { "1e-30", [](float) { return 1e-30f; } },
  { "1e30", [](float) { return 1e30f; } },
  { "65504", [](float) { return 65504.f; } },
  { "largest", [](float) { return FLT_MAX; } },
  { "least", [](float) { return -FLT_MAX; } },
  { "-1", [](float) { return -1.f; } },
  { "1", [](float) { return 1.f; } },
  { "a percent more", [](float v) { return 1.01f * v; } }, // normals and albedos a little too long
  { "+inf", [](float) { return std::numeric_limits<float>::infinity(); } },
  { "-inf", [](float) { return -std::numeric_limits<float>::infinity(); } },
  { "NaN", [](float) { return std::numeric_limits<float>::quiet_NaN(); } },
  { "signalling NaN", [](float) { return SignallingNaN(); } },
};

enum class Place
{
  OnePixel,
  OneComponent,
  Cluster,
  Checkerboard,
  Opposite, ///< the same with the sign of every other pixel turned
  Everywhere
};
const std::pair<Place, const char*> places[] = { { Place::OnePixel, "one pixel" },
  { Place::OneComponent, "one component" }, { Place::Cluster, "5 x 4 pixels" }, { Place::Checkerboard, "checkerboard" },
  { Place::Opposite, "opposite signs" }, { Place::Everywhere, "everywhere" } };

constexpr int W = 29, H = 23, X0 = 12, Y0 = 9;

bool Spoils(Place place, int x, int y)
{
  switch (place)
  {
    case Place::OnePixel:
    case Place::OneComponent:
      return x == X0 && y == Y0;
    case Place::Cluster:
      return x >= X0 && x < X0 + 5 && y >= Y0 && y < Y0 + 4;
    case Place::Checkerboard:
      return (x + y) % 2 == 0;
    default:
      return true;
  }
}
int Distance(Place place, int x, int y)
{
  const int x1 = place == Place::Cluster ? X0 + 4 : X0, y1 = place == Place::Cluster ? Y0 + 3 : Y0;
  return std::max({ X0 - x, x - x1, Y0 - y, y - y1, 0 });
}
quellChange Spoil(Place place, const Extreme& e)
{
  return [place, &e](int x, int y, float* value, int n)
  {
    if (Spoils(place, x, y))
      for (int c = 0; c < (place == Place::OneComponent ? 1 : n); ++c)
        value[c] = place == Place::Opposite && (x + y) % 2 ? -e.Value(value[c]) : e.Value(value[c]);
  };
}

class Extremes : public testing::TestWithParam<std::string>
{
protected:
  void SetUp() override { vtkObject::SetGlobalWarningDisplay(0); }
  void TearDown() override { vtkObject::SetGlobalWarningDisplay(1); }
  const quell::StageDescription& Table() const { return *Registry().Describe(this->GetParam()); }
  /// Sinks that compare may refuse what is not finite, with a sentence.
  bool MayRefuse() const { return this->Table().Sink; }

  /// Runs, and says why it failed; sinks may go on and say it in a warning.
  std::string Refusal(PortBench& bench) const
  {
    if (!bench.Run())
      return bench.Stage->GetErrorText();
    std::string text;
    for (const std::string& warning : bench.Stage->GetWarnings())
      text += this->MayRefuse() ? warning : std::string();
    return text;
  }

  /// Everything that the contract says of spoilt feeds. `clean`: what comes out unspoilt.
  void Check(
    PortBench& bench, const std::vector<PortBench::Feed*>& feeds, Place place, const Extreme& e, const Pixels& clean)
  {
    int reach = 0;
    for (PortBench::Feed* feed : feeds)
    {
      bench.Change(*feed, Spoil(place, e));
      reach = std::max(reach, bench.Reach(*feed));
    }
    const std::int64_t before = bench.Stage->GetCounters().NonFinite;
    const bool ran = bench.Run();
    ASSERT_TRUE(ran || (this->MayRefuse() && !bench.Stage->GetErrorText().empty())) << bench.Stage->GetErrorText();
    if (!ran)
      return;
    const Pixels out = bench.Read();
    ASSERT_EQ(bench.Broken(out), "");

    // Contained: what lies beyond the reach has the bits that it has without.
    if (place < Place::Checkerboard && !this->Table().Sink)
      for (const auto& entry : out)
      {
        const int n = int(entry.second.size() / (W * H));
        for (std::size_t i = 0; i < entry.second.size(); ++i)
        {
          const int x = int(i / n) % W, y = int(i / n) / W;
          ASSERT_TRUE(Distance(place, x, y) <= reach ||
                      std::memcmp(&entry.second[i], &clean.at(entry.first)[i], sizeof(float)) == 0)
            << entry.first << " at " << x << " " << y << " changed, farther than " << reach << " pixels away";
        }
      }

    // Counted: a live colour's pixels that are not finite, each once.
    if (feeds.size() > 1)
      return;
    const PortBench::Feed& feed = *feeds[0];
    const quell::InputPort& port = this->Table().Inputs[feed.Port];
    const bool counted = port.Kind == quell::ArrayKind::Color && !port.Delayed && port.Uncounted.empty() &&
                         !this->Table().Sink && bench.Stage->HistoryWeight(feed.Port) == 1 &&
                         bench.Stage->NeedsInput(feed.Port, bench.Outputs);
    if (counted && !std::isfinite(e.Value(1)))
    {
      std::int64_t spoilt = 0;
      for (int y = 0; y < H; ++y)
        for (int x = 0; x < W; ++x)
          spoilt += Spoils(place, x, y);
      ASSERT_EQ(bench.Stage->GetCounters().NonFinite - before, spoilt) << "non-finite pixels counted";
      ASSERT_FALSE(bench.Stage->GetWarnings().empty()) << "and told";
    }
  }

  void CheckAll(PortBench& bench, const std::vector<const Extreme*>& values, const std::vector<Place>& where)
  {
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    const Pixels clean = bench.Read();
    ASSERT_EQ(bench.Broken(clean), "");
    for (PortBench::Feed& feed : bench.Feeds)
    {
      for (const Extreme* e : values)
        for (const Place place : where)
        {
          SCOPED_TRACE(std::string(e->Name) + ", " + places[int(place)].second + ", in " + feed.Name);
          this->Check(bench, { &feed }, place, *e, clean);
          if (this->HasFatalFailure())
            return;
        }
      bench.Change(feed, nullptr);
    }
  }
};
const Extreme& Named(const std::string& name)
{
  for (const Extreme& e : extremes)
    if (e.Name == name)
      return e;
  throw std::runtime_error(name);
}
}

TEST_P(Extremes, ValuesInEachArray)
{
  std::vector<const Extreme*> values;
  for (const Extreme& e : extremes)
    values.push_back(&e);
  PortBench bench(this->GetParam(), W, H);
  bench.Narrow();
  this->CheckAll(bench, values,
    { Place::OnePixel, Place::OneComponent, Place::Cluster, Place::Checkerboard, Place::Opposite, Place::Everywhere });
}

// What breaks one array of a renderer's pixel often breaks all of them; and everywhere, no feature tells pixels apart.
TEST_P(Extremes, ValuesInAllArraysAtOnce)
{
  PortBench bench(this->GetParam(), W, H);
  bench.Narrow();
  ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
  const Pixels clean = bench.Read();
  std::vector<PortBench::Feed*> all;
  for (PortBench::Feed& feed : bench.Feeds)
    all.push_back(&feed);
  for (const Extreme& e : extremes)
    for (const Place place : { Place::OnePixel, Place::Cluster, Place::Everywhere })
    {
      SCOPED_TRACE(std::string(e.Name) + ", " + places[int(place)].second);
      this->Check(bench, all, place, e, clean);
      if (this->HasFatalFailure())
        return;
    }
}

// The same with every switch thrown once, for the worst values alone.
TEST_P(Extremes, ValuesWithEverySwitch)
{
  for (const quell::Property& p : this->Table().Properties)
  {
    std::vector<std::string> texts = p.Enumerators;
    if (p.Kind == quell::Property::Type::Bool)
      texts = { "false", "true" };
    for (const std::string& text : texts)
    {
      if (text == p.DefaultText)
        continue;
      SCOPED_TRACE(p.Name + "=" + text);
      PortBench bench(this->GetParam(), W, H);
      bench.Narrow();
      std::string error;
      ASSERT_TRUE(bench.Stage->SetPropertyText(p.Name, text, error)) << error;
      if (!bench.Run())
      {
        EXPECT_FALSE(bench.Stage->GetErrorText().empty()) << "a setting that makes no sense alone says so";
        continue;
      }
      this->CheckAll(bench, { &Named("NaN"), &Named("-inf"), &Named("largest"), &Named("0") },
        { Place::Cluster, Place::Opposite, Place::Everywhere });
      if (this->HasFatalFailure())
        return;
    }
  }
}

// Each number at its least, next to it, and its largest; then all of them together.
TEST_P(Extremes, Settings)
{
  using Type = quell::Property::Type;
  std::vector<std::vector<std::pair<std::string, std::string>>> settings;
  std::vector<std::pair<std::string, std::string>> least, most;
  for (const quell::Property& p : this->Table().Properties)
  {
    if (p.Kind == Type::Int)
    {
      settings.push_back({ { p.Name, std::to_string((long long)p.Minimum) } });
      least.push_back(settings.back()[0]);
      continue; // their largest: LargestCounts
    }
    if (p.Kind == Type::Vector)
      for (const double end : { p.Minimum, p.Maximum })
      {
        std::string text;
        for (int c = 0; c < p.Components; ++c)
          text += (c ? " " : "") + quell::detail::FormatDouble(end);
        settings.push_back({ { p.Name, text } });
      }
    if (p.Kind != Type::Double)
      continue;
    const std::string lo = quell::detail::FormatDouble(p.Minimum), hi = quell::detail::FormatDouble(p.Maximum);
    settings.push_back({ { p.Name, lo } });
    least.push_back({ p.Name, lo });
    if (p.Minimum <= 1e-38)
      settings.push_back({ { p.Name, "1e-38" } });
    settings.push_back({ { p.Name, hi } });
    most.push_back({ p.Name, hi });
  }
  settings.push_back(least);
  settings.push_back(most);
  for (const auto& setting : settings)
  {
    if (setting.empty())
      continue;
    std::string name;
    for (const auto& s : setting)
      name += s.first + "=" + s.second + " ";
    SCOPED_TRACE(name);
    PortBench bench(this->GetParam(), W, H);
    bench.Narrow();
    std::string error;
    for (const auto& s : setting)
      ASSERT_TRUE(bench.Stage->SetPropertyText(s.first, s.second, error)) << error;
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    ASSERT_EQ(bench.Broken(bench.Read()), "");
    for (PortBench::Feed& feed : bench.Feeds)
    {
      // Identical features, and the extremes that a tolerance of 0 or without end meets.
      for (const char* value : { "0", "largest", "NaN", "+inf" })
        for (const Place place : { Place::Cluster, Place::Everywhere })
        {
          SCOPED_TRACE(std::string(value) + ", " + places[int(place)].second + ", in " + feed.Name);
          bench.Change(feed, Spoil(place, Named(value)));
          const bool ran = bench.Run();
          ASSERT_TRUE(ran || (this->MayRefuse() && !bench.Stage->GetErrorText().empty()));
          if (ran)
          {
            ASSERT_EQ(bench.Broken(bench.Read()), "");
          }
        }
      bench.Change(feed, nullptr);
    }
  }
}

// Each count at its largest, then all of them, then all numbers: ends, on a small frame, with what the stage said
// before that it needs of memory.
TEST_P(Extremes, LargestCounts)
{
  using Type = quell::Property::Type;
  const int w = 13, h = 11;
  using Settings = std::vector<std::pair<std::string, std::string>>;
  std::vector<Settings> settings;
  Settings counts, all;
  for (const quell::Property& p : this->Table().Properties)
    if (p.Kind == Type::Int)
    {
      settings.push_back({ { p.Name, std::to_string((long long)p.Maximum) } });
      counts.push_back(settings.back()[0]);
      all.push_back(settings.back()[0]);
    }
    else if (p.Kind == Type::Double)
      all.push_back({ p.Name, quell::detail::FormatDouble(p.Maximum) });
  if (counts.empty())
    GTEST_SKIP() << "counts nothing";
  settings.push_back(counts);
  settings.push_back(all);
  for (const Settings& setting : settings)
  {
    std::string name;
    for (const auto& s : setting)
      name += s.first + "=" + s.second + " ";
    SCOPED_TRACE(name);
    PortBench bench(this->GetParam(), w, h);
    std::string error;
    for (const auto& s : setting)
      ASSERT_TRUE(bench.Stage->SetPropertyText(s.first, s.second, error)) << error;
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    ASSERT_EQ(bench.Broken(bench.Read()), "");
    const double scratch = bench.Stage->ScratchBytes({ 0, 0, w, h }, { 0, 0, w, h }, bench.Outputs);
    ASSERT_TRUE(scratch >= 0 && scratch < 1e12) << scratch;
    // Inputs and outputs stay; what is taken besides is what was declared (blocks are whole lines of memory).
    bench.Stage->Modified();
    quell::SetPixelMemoryLimit(quell::PixelMemoryInUse() + std::uint64_t(scratch) + 4096 * (2 + bench.Outputs.size()) +
                               std::uint64_t(w * h * 4) * 16 * (bench.Outputs.size() + 1));
    const bool ran = bench.Run();
    quell::SetPixelMemoryLimit(0);
    EXPECT_TRUE(ran) << "with " << scratch << " bytes of scratch: " << bench.Stage->GetErrorText();
    for (PortBench::Feed& feed : bench.Feeds)
    {
      for (const char* value : { "0", "largest", "NaN" })
      {
        SCOPED_TRACE(std::string(value) + " in " + feed.Name);
        bench.Change(feed, Spoil(Place::Checkerboard, Named(value)));
        const bool went = bench.Run();
        ASSERT_TRUE(went || (this->MayRefuse() && !bench.Stage->GetErrorText().empty()));
        if (went)
        {
          ASSERT_EQ(bench.Broken(bench.Read()), "");
        }
      }
      bench.Change(feed, nullptr);
    }
  }
}

TEST_P(Extremes, Sizes)
{
  const int sizes[][2] = { { 1, 1 }, { 1, 2 }, { 2, 1 }, { 1, 67 }, { 67, 1 }, { 2, 2 }, { 3, 3 }, { 13, 97 },
    { 97, 13 }, { 131, 3 } };
  for (const auto& size : sizes)
  {
    SCOPED_TRACE(std::to_string(size[0]) + " x " + std::to_string(size[1]));
    PortBench bench(this->GetParam(), size[0], size[1]);
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    const Pixels plain = bench.Read();
    ASSERT_EQ(bench.Broken(plain), "");
    bench.Narrow();
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    const Pixels clean = bench.Read();
    // One bad pixel in the middle of each array: a single row has nobody else to hide behind.
    const int mx = size[0] / 2, my = size[1] / 2;
    for (PortBench::Feed& feed : bench.Feeds)
    {
      for (const char* value : { "NaN", "largest" })
      {
        SCOPED_TRACE(std::string(value) + " in " + feed.Name);
        bench.Change(feed,
          [=, &e = Named(value)](int x, int y, float* v, int n)
          {
            for (int c = 0; c < n && x == mx && y == my; ++c)
              v[c] = e.Value(v[c]);
          });
        if (!bench.Run())
        {
          EXPECT_TRUE(this->MayRefuse()) << bench.Stage->GetErrorText();
          continue;
        }
        const Pixels out = bench.Read();
        ASSERT_EQ(bench.Broken(out), "");
        const int reach = bench.Reach(feed);
        for (const auto& entry : this->Table().Sink ? Pixels() : out)
        {
          const std::size_t n = entry.second.size() / std::size_t(size[0] * size[1]);
          for (std::size_t i = 0; i < entry.second.size(); ++i)
          {
            const int x = int(i / n) % size[0], y = int(i / n) / size[0];
            ASSERT_TRUE(std::max(std::abs(x - mx), std::abs(y - my)) <= reach ||
                        std::memcmp(&entry.second[i], &clean.at(entry.first)[i], sizeof(float)) == 0)
              << entry.first << " at " << x << " " << y << " changed, farther than " << reach << " pixels away";
          }
        }
      }
      bench.Change(feed, nullptr);
    }
    int checked = 0;
    EXPECT_EQ(bench.ChangedConstants(checked), "");
    if (this->Table().Sink)
      continue; // takes whole frames
    const quell::Rect part{ size[0] / 3, size[1] / 3, std::max(size[0] / 3 + 1, size[0] * 2 / 3),
      std::max(size[1] / 3 + 1, size[1] * 2 / 3) };
    ASSERT_TRUE(bench.Run());
    const Pixels cropped = bench.Read(part);
    ASSERT_TRUE(bench.RunAnew(part));
    std::string where;
    EXPECT_TRUE(SameBits(cropped, bench.Read(part), where)) << where << " of a region";
  }
}

// Memory comes as it is, full of anything: what a stage does not write must not be seen, nor read before it is written.
TEST_P(Extremes, WhatMemoryHeldBeforeIsNotRead)
{
  const std::size_t kept = quell::KeepPixelMemory(0);
  Pixels first;
  for (const int content : { 0x00, 0x7f, 0xfe }) // 0, 3.4e38, -1.7e38
  {
    SCOPED_TRACE(content);
    mallopt(M_PERTURB, content ^ 0xff);
    PortBench bench(this->GetParam(), 37, 19);
    const bool ran = bench.Run();
    mallopt(M_PERTURB, 0);
    EXPECT_TRUE(ran) << bench.Stage->GetErrorText();
    const Pixels out = ran ? ReadArrays(bench.Stage->GetOutput(), bench.Outputs, { 0, 0, 37, 19 }) : Pixels();
    if (first.empty())
      first = out;
    std::string where;
    EXPECT_TRUE(SameBits(first, out, where)) << where;
  }
  quell::KeepPixelMemory(kept);
}

TEST_P(Extremes, NothingAtAllIsRefused)
{
  const int sizes[][2] = { { 0, 0 }, { 0, 5 }, { 5, 0 } };
  for (const auto& size : sizes)
  {
    SCOPED_TRACE(std::to_string(size[0]) + " x " + std::to_string(size[1]));
    auto stage = Registry().Create(this->GetParam());
    vtkNew<vtkImageData> image;
    image->SetExtent(0, size[0] - 1, 0, size[1] - 1, 0, 0);
    vtkNew<vtkTrivialProducer> producer;
    producer->SetOutput(image);
    for (const quell::InputPort& port : this->Table().Inputs)
      if (port.Delayed)
        stage->SetHistory(this->Table().InputIndex(port.Name), nullptr);
      else
        stage->ConnectInput(port.Name, producer);
    EXPECT_FALSE(stage->GetExecutive()->Update(0));
    EXPECT_NE(stage->GetErrorText().find("not an image"), std::string::npos) << stage->GetErrorText();
  }
}

// A frame of 4096 x 2160 pixels, whole; wide filters narrow, and what is required alone.
TEST_P(Extremes, FourThousandPixelsWide)
{
  const int w = 4096, h = 2160;
  PortBench bench(this->GetParam(), w, h, "optional");
  bench.Narrow();
  for (PortBench::Feed& feed : bench.Feeds)
  {
    feed.Source->Period = 64;
    feed.Source->Modified();
  }
  bench.Past();
  ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
  EXPECT_EQ(bench.Stage->GetCounters().Pixels, std::int64_t(w) * h);
  if (this->Table().Outputs.empty())
    return;
  // The content repeats itself every 64 pixels, so what is made of it does, however far from the origin (the fraction
  // of a column beyond 2048 has 12 bits).
  const auto block = [&](int x, int y) { return bench.Read({ x + 16, y + 16, x + 48, y + 48 }); };
  const Pixels here = block(128, 128), there = block(w - 256, 2048 - 64);
  for (const auto& entry : here)
  {
    const std::vector<float>&a = entry.second, &b = there.at(entry.first);
    float largest = 0, worst = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
    {
      largest = std::max(largest, std::fabs(a[i]));
      worst = std::max(worst, std::fabs(a[i] - b[i]));
    }
    EXPECT_LE(worst, 1e-3f * largest) << entry.first << " depends on the place";
  }
  std::string where;
  // The last pixels of the frame are those of the same content computed alone.
  const quell::Rect corner{ w - 9, h - 5, w, h };
  const Pixels whole = bench.Read(corner);
  for (const auto& entry : whole)
    EXPECT_TRUE(IsFinite(entry.second)) << entry.first;
  if (this->Table().Sink)
    return; // compares whole frames
  ASSERT_TRUE(bench.RunAnew(corner));
  EXPECT_TRUE(SameBits(whole, bench.Read(corner), where)) << where;
}

// The far corner of a frame that has more pixels than an int counts.
TEST_P(Extremes, MoreThanTwoToThe31Pixels)
{
  const int w = 65521, h = 40009;
  bool delayed = false;
  for (const quell::InputPort& port : this->Table().Inputs)
    delayed = delayed || port.Delayed;
  if (this->Table().Sink || delayed)
    GTEST_SKIP() << "needs the whole frame at once: 10 GB an array";
  PortBench bench(this->GetParam(), w, h);
  bench.Narrow();
  if (bench.Stage->HaloFor(0) > 1000)
    GTEST_SKIP() << "needs the whole frame at once: 10 GB an array";
  const quell::Rect corner{ w - 21, h - 17, w, h };
  ASSERT_TRUE(bench.Run(corner)) << bench.Stage->GetErrorText();
  const Pixels far = bench.Read(corner);
  for (const auto& entry : far)
    EXPECT_TRUE(IsFinite(entry.second)) << entry.first;
  // Pixel by pixel the same as for that corner cut differently.
  const quell::Rect last{ w - 2, h - 2, w, h };
  const Pixels part = ReadArrays(bench.Stage->GetOutput(), bench.Outputs, last);
  ASSERT_TRUE(bench.RunAnew(last));
  std::string where;
  EXPECT_TRUE(SameBits(part, bench.Read(last), where)) << where;
}

namespace
{
/// A stock VTK image that holds one array of another type or shape.
template <class Array>
vtkSmartPointer<vtkImageData> Holding(
  const std::string& name, int w, int h, int components, const std::vector<float>& values)
{
  vtkNew<Array> array;
  array->SetName(name.c_str());
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(vtkIdType(w) * h);
  for (std::size_t i = 0; i < std::size_t(w) * h * components; ++i)
    array->SetValue(vtkIdType(i), typename Array::ValueType(values[i % values.size()]));
  vtkNew<vtkImageData> image;
  image->SetExtent(0, w - 1, 0, h - 1, 0, 0);
  image->GetPointData()->SetScalars(array);
  return image;
}
void Give(PortBench& bench, const PortBench::Feed& feed, vtkImageData* image)
{
  if (bench.IsDelayed(feed))
  {
    bench.Stage->SetHistory(feed.Port, image);
    return;
  }
  vtkNew<vtkTrivialProducer> producer;
  producer->SetOutput(image);
  std::vector<vtkAlgorithmOutput*> connections;
  for (int c = 0; c < bench.Stage->GetNumberOfInputConnections(feed.Port); ++c)
    connections.push_back(
      c == feed.Connection ? producer->GetOutputPort() : bench.Stage->GetInputConnection(feed.Port, c));
  bench.Stage->RemoveAllInputConnections(feed.Port);
  for (vtkAlgorithmOutput* connection : connections)
    bench.Stage->AddInputConnection(feed.Port, connection);
}
}

TEST_P(Extremes, DoublesAndBytesAreTheNumbersThatTheyHold)
{
  const std::size_t feeds = PortBench(this->GetParam(), W, H).Feeds.size();
  for (std::size_t f = 0; f < feeds; ++f)
  {
    PortBench bench(this->GetParam(), W, H);
    bench.Narrow();
    PortBench::Feed& feed = bench.Feeds[f];
    SCOPED_TRACE(feed.Name);
    if (!bench.Stage->NeedsInput(feed.Port, bench.Outputs))
      continue;
    const int n = quell::FindArray(feed.Array)->Components;
    ASSERT_TRUE(bench.Run());
    const Pixels floats = bench.Read();
    std::string where;
    Give(bench, feed, Holding<vtkDoubleArray>(feed.Array, W, H, n, feed.Source->Values(feed.Array)));
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    EXPECT_TRUE(SameBits(floats, bench.Read(), where)) << "double, " << where;

    std::vector<float> whole = feed.Source->Values(feed.Array);
    for (float& v : whole)
      v = std::isfinite(v) ? std::floor(std::min(255.f, std::max(0.f, std::fabs(v) * 40))) : 255.f;
    Give(bench, feed, Holding<vtkFloatArray>(feed.Array, W, H, n, whole));
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    const Pixels rounded = bench.Read();
    Give(bench, feed, Holding<vtkUnsignedCharArray>(feed.Array, W, H, n, whole));
    ASSERT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
    EXPECT_TRUE(SameBits(rounded, bench.Read(), where)) << "bytes, " << where;

    // A double that no float holds is not finite to a stage.
    auto huge = Holding<vtkDoubleArray>(feed.Array, W, H, n, feed.Source->Values(feed.Array));
    vtkDoubleArray::SafeDownCast(huge->GetPointData()->GetScalars())->SetValue(vtkIdType(Y0 * W + X0) * n, 1e300);
    Give(bench, feed, huge);
    if (bench.Run())
    {
      for (const auto& entry : bench.Read())
        EXPECT_TRUE(IsFinite(entry.second)) << "1e300, " << entry.first;
    }
    else
    {
      EXPECT_TRUE(this->MayRefuse() && !bench.Stage->GetErrorText().empty());
    }
  }
}

TEST_P(Extremes, MissingAndWrongArraysAreNamed)
{
  const std::size_t feeds = PortBench(this->GetParam(), W, H).Feeds.size();
  for (std::size_t f = 0; f < feeds; ++f)
  {
    PortBench bench(this->GetParam(), W, H);
    PortBench::Feed& feed = bench.Feeds[f];
    SCOPED_TRACE(feed.Name);
    const quell::InputPort& port = this->Table().Inputs[feed.Port];
    const int n = quell::KindComponents(port.Kind);
    const bool needed = bench.Stage->NeedsInput(feed.Port, bench.Outputs);
    for (int components : { n - 1, n + 1, 4 })
    {
      if (n == 0 || components < 1 || components == n || !needed)
        continue;
      Give(bench, feed, Holding<vtkFloatArray>(feed.Array, W, H, components, { 0.5f }));
      const std::string text = this->Refusal(bench);
      ASSERT_NE(text, "") << components << " components are taken for " << n;
      for (const std::string& part :
        { port.Name, feed.Array, std::to_string(components) + " components", std::string(quell::KindName(port.Kind)) })
        EXPECT_NE(text.find(part), std::string::npos) << text << " does not say " << part;
      EXPECT_TRUE(this->MayRefuse() || bench.Stage->GetOutput()->GetPointData()->GetNumberOfArrays() == 0)
        << "a failure leaves nothing";
    }
    PortBench missing(this->GetParam(), W, H);
    missing.Stage->SetInputArray(feed.Port, feed.Connection, "nonsense");
    if (!needed)
      continue;
    const std::string text = this->Refusal(missing) + missing.Feeds[f].Source->GetErrorText();
    EXPECT_NE(text.find("nonsense"), std::string::npos) << text;
    missing.Stage->SetInputArray(feed.Port, feed.Connection, feed.Array);
    EXPECT_TRUE(missing.Run()) << "recovers: " << missing.Stage->GetErrorText();
  }
  for (const quell::InputPort& port : this->Table().Inputs)
  {
    SCOPED_TRACE("without " + port.Name);
    PortBench bench(this->GetParam(), W, H, port.Name);
    bench.Narrow();
    if (bench.Run())
    {
      EXPECT_TRUE(port.Optional || port.Delayed) << "is required";
      EXPECT_EQ(bench.Broken(bench.Read()), "");
    }
    else
      EXPECT_NE(bench.Stage->GetErrorText().find(port.Name), std::string::npos) << bench.Stage->GetErrorText();
  }
}

// Matrices that cannot be inverted, are not finite, or have everything behind the camera; with and without motion.
TEST_P(Extremes, Cameras)
{
  const float inf = std::numeric_limits<float>::infinity();
  quell::FrameFacts good;
  good.HasCamera = true;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c)
      good.WorldToNdc.m[r][c] = good.WorldToCamera.m[r][c] = r == c;
  good.WorldToNdc.m[3][2] = -1; // w = -z: looks along -z
  good.WorldToNdc.m[3][3] = 0;
  std::vector<std::pair<std::string, quell::FrameFacts>> cameras;
  const auto add = [&](const char* name, const std::function<void(quell::FrameFacts&)>& change)
  {
    cameras.emplace_back(name, good);
    change(cameras.back().second);
  };
  add("good", [](quell::FrameFacts&) {});
  add("all zero",
    [](quell::FrameFacts& f)
    {
      for (int i = 0; i < 4; ++i)
        f.WorldToNdc.m[i][i] = f.WorldToCamera.m[i][i] = 0;
    });
  add("field of view 0", [=](quell::FrameFacts& f) { f.WorldToNdc.m[0][0] = f.WorldToNdc.m[1][1] = inf; });
  add("field of view 180", [](quell::FrameFacts& f) { f.WorldToNdc.m[0][0] = f.WorldToNdc.m[1][1] = 0; });
  add("aspect 0", [](quell::FrameFacts& f) { f.WorldToNdc.m[0][0] = 0; });
  add("not a number",
    [](quell::FrameFacts& f) { f.WorldToNdc.m[2][3] = f.WorldToNdc.m[3][2] = f.WorldToCamera.m[0][0] = std::nan(""); });
  add("behind", [](quell::FrameFacts& f) { f.WorldToNdc.m[3][2] = 1; });
  add("huge",
    [](quell::FrameFacts& f)
    {
      for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 4; ++k)
          f.WorldToNdc.m[i][k] = 1e300 * (i + 2 * k + 1);
    });
  add("far away", [](quell::FrameFacts& f) { f.Origin = { 1e30, -1e30, 1e300 }; });
  for (const std::string& without : { std::string(), std::string("motion") })
  {
    if (!without.empty() && this->Table().InputIndex(without) < 0)
      continue;
    for (std::size_t now = 0; now < cameras.size(); ++now)
      for (std::size_t then = 0; then < cameras.size(); ++then)
      {
        if (now != then && now != 0 && then != 0)
          continue;
        SCOPED_TRACE((without.empty() ? "" : "without motion, ") + cameras[now].first + " now, " + cameras[then].first +
                     " before");
        PortBench bench(this->GetParam(), W, H, without);
        bench.Narrow();
        for (PortBench::Feed& feed : bench.Feeds)
          feed.Source->Facts = [&, old = bench.IsDelayed(feed)](quell::FrameFacts& f)
          { f = cameras[old ? then : now].second; };
        bench.Past();
        const bool ran = bench.Run();
        ASSERT_TRUE(ran || (this->MayRefuse() && !bench.Stage->GetErrorText().empty())) << bench.Stage->GetErrorText();
        if (ran)
        {
          ASSERT_EQ(bench.Broken(bench.Read()), "");
        }
      }
  }
}

// Poison on one frame; a hundred frames later nothing of it is left. Outputs go back into the inputs that stand for
// the past, as in a pipeline.
TEST_P(Extremes, PoisonLeavesTheHistory)
{
  struct Loop
  {
    std::size_t Feed;
    std::string Output;
  };
  const auto loops = [](PortBench& bench)
  {
    std::vector<Loop> found;
    for (std::size_t f = 0; f < bench.Feeds.size(); ++f)
      if (bench.IsDelayed(bench.Feeds[f]) || bench.Stage->HistoryWeight(bench.Feeds[f].Port) < 1)
      {
        // What has the input's name comes back in it, else what is of its kind.
        const std::vector<quell::OutputArray>& outputs = bench.Stage->GetDescription().Outputs;
        auto back = std::find_if(outputs.begin(), outputs.end(),
          [&](const quell::OutputArray& o) { return o.Name == bench.Feeds[f].Name && o.Kind == bench.Feeds[f].Kind; });
        if (back == outputs.end())
          back = std::find_if(
            outputs.begin(), outputs.end(), [&](const quell::OutputArray& o) { return o.Kind == bench.Feeds[f].Kind; });
        if (back != outputs.end())
          found.push_back({ f, back->Name });
      }
    return found;
  };
  PortBench shape(this->GetParam(), 19, 15);
  if (loops(shape).empty())
    GTEST_SKIP() << "has no past of its own";
  const auto play = [&](int spoilt, const std::vector<const Extreme*>& values)
  {
    PortBench bench(this->GetParam(), 19, 15);
    const std::vector<Loop> back = loops(bench);
    Pixels out;
    for (int frame = 0; frame <= 100; ++frame)
    {
      for (std::size_t f = 0; f < bench.Feeds.size(); ++f)
      {
        PortBench::Feed& feed = bench.Feeds[f];
        quellChange base;
        for (const Loop& loop : back)
          if (loop.Feed == f && frame > 0)
            base = [data = out.at(loop.Output)](int x, int y, float* v, int n)
            {
              // An input of any kind may be wider than what there is to come back.
              const int has = int(data.size() / (19 * 15));
              std::copy_n(&data[std::size_t(y * 19 + x) * std::size_t(has)], std::min(n, has), v);
            };
        const bool poison = int(f) == spoilt && frame == 3;
        feed.Source->Salt = std::uint32_t(frame * 101 + f);
        feed.Source->Change = [=](int x, int y, float* v, int n)
        {
          if (base)
            base(x, y, v, n);
          if (poison && x >= 6 && x < 11 && y >= 5 && y < 9)
            for (int c = 0; c < n; ++c)
              v[c] = values[std::size_t(x + 2 * y) % values.size()]->Value(v[c]);
        };
        feed.Source->Modified();
      }
      bench.Past();
      EXPECT_TRUE(bench.Run()) << bench.Stage->GetErrorText();
      out = bench.Stage->GetErrorText().empty() ? ReadArrays(bench.Stage->GetOutput(), bench.Outputs, { 0, 0, 19, 15 })
                                                : Pixels();
      for (const auto& entry : out)
        EXPECT_TRUE(IsFinite(entry.second)) << entry.first << " on frame " << frame;
      if (testing::Test::HasFailure())
        return out;
    }
    return out;
  };
  const Pixels clean = play(-1, {});
  double weight = 0;
  for (const Loop& loop : loops(shape))
    weight = std::max(weight, shape.Stage->HistoryWeight(shape.Feeds[loop.Feed].Port));
  const std::pair<const char*, std::vector<const Extreme*>> poisons[] = {
    { "not finite", { &Named("NaN"), &Named("+inf"), &Named("-inf"), &Named("signalling NaN") } },
    { "huge", { &Named("1e30"), &Named("largest"), &Named("least"), &Named("65504") } },
  };
  for (std::size_t f = 0; f < shape.Feeds.size(); ++f)
    for (const auto& poison : poisons)
    {
      SCOPED_TRACE(std::string(poison.first) + " in " + shape.Feeds[f].Name);
      const Pixels out = play(int(f), poison.second);
      ASSERT_FALSE(this->HasFailure());
      if (weight >= 1)
        continue; // keeps what it is given for ever: that it is finite is all
      // A finite colour is light, and fades as light does (meanRest is the second float of its mean); all else is gone.
      const PortBench::Feed& feed = shape.Feeds[f];
      const bool light =
        poison.second[0] == &Named("1e30") &&
        (feed.Kind == quell::ArrayKind::Color || feed.Kind == quell::ArrayKind::Moments || feed.Name == "meanRest");
      for (const auto& entry : out)
      {
        // Of 3.4e38 the second moment is beyond every float for as long as the mean is beyond 1e19.
        if (light && (entry.first == "moments" || entry.first == "meanRest"))
          continue;
        double largest = 0, worst = 0;
        for (std::size_t i = 0; i < entry.second.size(); ++i)
        {
          largest = std::max(largest, std::fabs(double(clean.at(entry.first)[i])));
          worst = std::max(worst, std::fabs(double(entry.second[i]) - clean.at(entry.first)[i]));
        }
        EXPECT_LE(worst, (light ? double(FLT_MAX) : largest) * 2 * std::pow(weight, 97) + 1e-5 * largest)
          << entry.first;
      }
    }
}

INSTANTIATE_TEST_SUITE_P(All, Extremes, testing::ValuesIn(TypesWithInputs()),
  [](const testing::TestParamInfo<std::string>& type) { return type.param; });

// A stage that no registry knows would be tested nowhere: every table in the sources of the modules is registered.
TEST(ExtremesOfStages, AreThoseOfEveryTableInTheSources)
{
  const std::set<std::string> elsewhere = {
    "vtkQuellDataPathTraceSource", // for programs, of VTK data: SceneVTK's tests
  };
  const std::string macro = "QUELL_STAGE_DESCRIPTION(vtkQuell";
  int found = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(QUELL_SOURCE_DIR "/Modules"))
  {
    const std::string path = entry.path().string();
    if (entry.path().extension() != ".cxx" || path.find("/Testing/") != std::string::npos)
      continue;
    std::ifstream in(path);
    const std::string text{ std::istreambuf_iterator<char>(in), {} };
    for (std::size_t at = text.find(macro); at != std::string::npos; at = text.find(macro, at + 1))
    {
      const std::size_t name = at + macro.size();
      const std::string type = text.substr(name, text.find(')', name) - name);
      ++found;
      EXPECT_TRUE(Registry().Describe(type) || elsewhere.count("vtkQuell" + type))
        << type << " of " << path << " is in no registry";
    }
  }
  EXPECT_GE(found, int(Registry().Types().size())) << "stages that are described in another way";
}

// What has no inputs cannot be fed extremes here: its sizes and settings are swept by SourceExtremes. What it reads has
// tests of its own, or none: then this one fails.
TEST(ExtremesOfSources, AreTestedWhereTheyAreRead)
{
  const std::map<std::string, const char*> elsewhere = {
    { "ImageReader", "values pass as they are in the file: BadImages.*, ForeignFiles.*, ImageFile.*" },
    { "PathTraceSource", "scenes, sizes and cameras: GeometryExtremes.*, PathTraceExtremes.*, BsdfSampling.*, "
                         "LightSampler.ExtremesStayNumbers" },
  };
  for (const std::string& type : Registry().Types())
  {
    const bool source = Registry().Describe(type)->Inputs.empty();
    EXPECT_EQ(source, elsewhere.count(type) != 0) << type << " has no inputs and no reason, or a reason too many";
  }
}
