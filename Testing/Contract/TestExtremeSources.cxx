// SPDX-License-Identifier: BSD-3-Clause
// Every type of the registry that has no inputs, at its extremes: sizes, each number at both ends of its range, every
// switch, a frame of 4096 x 2160. What such a type reads from files is given here by name; one that is not named runs
// without, or fails and says what it wants.
#include "StageBench.h"

#include <gtest/gtest.h>

#include <cfloat>
#include <fstream>

namespace
{
std::vector<std::string> TypesWithoutInputs()
{
  std::vector<std::string> types;
  for (const std::string& type : Registry().Types())
    if (Registry().Describe(type)->Inputs.empty())
      types.push_back(type);
  return types;
}

/// Writes what `make` says of each pixel with ImageWriter, whole floats.
std::string ImageOf(const std::string& name, int w, int h, int period, const quellChange& make)
{
  const std::string file = testing::TempDir() + "quell-extreme-" + name + ".exr";
  vtkNew<vtkQuellContractSource> source;
  source->Width = w;
  source->Height = h;
  source->Period = period;
  source->Change = make;
  auto writer = Registry().Create("ImageWriter");
  std::string error;
  EXPECT_TRUE(writer->SetPropertyText("File", file, error)) << error;
  writer->ConnectInput("layer", source, "radiance");
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(writer, {}, quell::Rect());
  EXPECT_TRUE(sink->UpdateTick(0)) << writer->GetErrorText();
  return file;
}

/// Two triangles in the way of a camera that frames them.
std::string Scene()
{
  const std::string file = testing::TempDir() + "quell-extreme.obj";
  std::ofstream(file) << "v -1 -1 0\nv 1 -1 0\nv 0 1 0.5\nv -3 -2 -2\nv 3 -2 -2\nv 0 4 -2\nf 1 2 3\nf 4 5 6\n";
  return file;
}

class SourceExtremes : public testing::TestWithParam<std::string>
{
protected:
  void SetUp() override { vtkObject::SetGlobalWarningDisplay(0); }
  void TearDown() override { vtkObject::SetGlobalWarningDisplay(1); }
  const quell::StageDescription& Table() const { return *Registry().Describe(this->GetParam()); }
  bool Has(const std::string& property) const { return this->Table().FindProperty(property) != nullptr; }

  /// One that makes w x h pixels.
  vtkSmartPointer<vtkQuellStage> Make(int w, int h)
  {
    auto stage = Registry().Create(this->GetParam());
    std::string error;
    if (this->Has("Width") && this->Has("Height"))
    {
      EXPECT_TRUE(stage->SetPropertyText("Width", std::to_string(w), error)) << error;
      EXPECT_TRUE(stage->SetPropertyText("Height", std::to_string(h), error)) << error;
    }
    if (this->GetParam() == "ImageReader")
    {
      EXPECT_TRUE(stage->SetPropertyText("File", this->Image(w, h), error)) << error;
    }
    if (this->GetParam() == "PathTraceSource")
    {
      EXPECT_TRUE(stage->SetPropertyText("Scene", Scene(), error)) << error;
    }
    return stage;
  }
  bool Run(vtkQuellStage* stage, const quell::ArraySet& arrays, const quell::Rect& region = quell::Rect())
  {
    this->Sink->ClearRequests();
    this->Sink->AddRequest(stage, arrays, region);
    return this->Sink->UpdateTick(0);
  }
  quell::ArraySet Outputs() const
  {
    quell::ArraySet names;
    for (const quell::OutputArray& o : this->Table().Outputs)
      names.insert(o.Name);
    return names;
  }
  /// Whether each value is a number that its kind allows; else which is not.
  std::string Broken(const Pixels& pixels, std::size_t count) const
  {
    for (const quell::OutputArray& o : this->Table().Outputs)
    {
      const auto found = pixels.find(o.Name);
      if (found == pixels.end() || found->second.size() != count * std::size_t(o.Components))
        return o.Name + " is not made whole";
      const quell::ArrayType* type = quell::FindArray(o.Name);
      const bool endless = type && std::isinf(type->Background); // where nothing was hit
      for (const float v : found->second)
        if (!std::isfinite(v) && !(endless && v > 0))
          return o.Name + " holds " + std::to_string(v);
    }
    return {};
  }
  void Try(const std::vector<std::pair<std::string, std::string>>& settings)
  {
    std::string name;
    for (const auto& s : settings)
      name += s.first + "=" + s.second + " ";
    SCOPED_TRACE(name);
    auto stage = this->Make(1, 1);
    std::string error;
    for (const auto& s : settings)
      ASSERT_TRUE(stage->SetPropertyText(s.first, s.second, error)) << error;
    const quell::Rect whole{ 0, 0, 1, 1 };
    const double scratch = stage->ScratchBytes(whole, whole, this->Outputs());
    EXPECT_TRUE(scratch >= 0 && scratch < 1e18) << scratch;
    if (!this->Run(stage, this->Outputs()))
    {
      EXPECT_FALSE(stage->GetErrorText().empty()) << "a setting that makes no sense alone says so";
      return;
    }
    const int* e = stage->GetOutput()->GetExtent();
    const quell::Rect made{ e[0], e[2], e[1] + 1, e[3] + 1 };
    EXPECT_EQ(this->Broken(ReadArrays(stage->GetOutput(), this->Outputs(), made), std::size_t(made.area())), "");
  }
  /// Written once a size: the same 64 rows and columns over and over.
  const std::string& Image(int w, int h)
  {
    std::string& file = this->Images[{ w, h }];
    if (file.empty())
      file = ImageOf(std::to_string(w) + "x" + std::to_string(h), w, h, 64, {});
    return file;
  }
  std::map<std::pair<int, int>, std::string> Images;
  vtkNew<vtkQuellCollector> Sink;
};
}

// Every number at its least, next to it and its largest, alone, on one pixel (so that the largest counts end); every
// switch; then all reals together.
TEST_P(SourceExtremes, Settings)
{
  using Type = quell::Property::Type;
  ASSERT_TRUE(this->Run(this->Make(1, 1), this->Outputs())) << "give it here the file that it wants";
  std::vector<std::pair<std::string, std::string>> least, most;
  for (const quell::Property& p : this->Table().Properties)
  {
    for (const std::string& e : p.Enumerators)
      this->Try({ { p.Name, e } });
    if (p.Kind == Type::Bool)
      this->Try({ { p.Name, p.DefaultText == "true" ? "false" : "true" } });
    if (p.Kind == Type::Int)
      for (const double end : { p.Minimum, p.Maximum })
        this->Try({ { p.Name, std::to_string((long long)end) } });
    if (p.Kind == Type::Double)
    {
      least.push_back({ p.Name, quell::detail::FormatDouble(p.Minimum) });
      most.push_back({ p.Name, quell::detail::FormatDouble(p.Maximum) });
      this->Try({ least.back() });
      this->Try({ most.back() });
      if (p.Minimum <= 1e-38)
        this->Try({ { p.Name, "1e-38" } });
    }
    if (p.Kind == Type::Vector)
      for (const double end : { p.Minimum, p.Maximum })
      {
        std::string text;
        for (int c = 0; c < p.Components; ++c)
          text += (c ? " " : "") + quell::detail::FormatDouble(end);
        this->Try({ { p.Name, text } });
      }
    if (this->HasFatalFailure())
      return;
  }
  this->Try(least);
  this->Try(most);
}

TEST_P(SourceExtremes, Sizes)
{
  const int sizes[][2] = { { 1, 1 }, { 1, 67 }, { 67, 1 }, { 2, 2 }, { 13, 97 }, { 131, 3 } };
  for (const auto& size : sizes)
  {
    const int w = size[0], h = size[1];
    SCOPED_TRACE(std::to_string(w) + " x " + std::to_string(h));
    auto stage = this->Make(w, h);
    ASSERT_TRUE(this->Run(stage, this->Outputs())) << stage->GetErrorText();
    const quell::Rect whole{ 0, 0, w, h }, part{ w / 3, h / 3, w / 3 + (w + 2) / 3, h / 3 + (h + 2) / 3 };
    EXPECT_EQ(this->Broken(ReadArrays(stage->GetOutput(), this->Outputs(), whole), std::size_t(w) * h), "");
    const Pixels cropped = ReadArrays(stage->GetOutput(), this->Outputs(), part);
    auto again = this->Make(w, h);
    ASSERT_TRUE(this->Run(again, this->Outputs(), part)) << again->GetErrorText();
    std::string where;
    EXPECT_TRUE(SameBits(cropped, ReadArrays(again->GetOutput(), this->Outputs(), part), where)) << where;
  }
}

// The first output of a frame of 4096 x 2160 pixels; its far corner alone has the same bits.
TEST_P(SourceExtremes, FourThousandPixelsWide)
{
  const int w = 4096, h = 2160;
  auto stage = this->Make(w, h);
  const quell::ArraySet first{ this->Table().Outputs.at(0).Name };
  ASSERT_TRUE(this->Run(stage, first)) << stage->GetErrorText();
  EXPECT_EQ(stage->GetCounters().Pixels, std::int64_t(w) * h);
  const quell::Rect corner{ w - 19, h - 11, w, h };
  const Pixels whole = ReadArrays(stage->GetOutput(), first, corner);
  ASSERT_EQ(whole.size(), 1u);
  const std::vector<float>& values = whole.begin()->second;
  EXPECT_TRUE(std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); }));
  EXPECT_GT(*std::max_element(values.begin(), values.end()), 0) << "nothing is there";
  auto again = this->Make(w, h);
  ASSERT_TRUE(this->Run(again, first, corner)) << again->GetErrorText();
  std::string where;
  EXPECT_TRUE(SameBits(whole, ReadArrays(again->GetOutput(), first, corner), where)) << where;
}

INSTANTIATE_TEST_SUITE_P(All, SourceExtremes, testing::ValuesIn(TypesWithoutInputs()),
  [](const testing::TestParamInfo<std::string>& type) { return type.param; });

// A reader changes no value, whatever it is: what a filter is owed to see is what the file holds.
TEST(ExtremesOfSources, AReaderPassesEveryValue)
{
  const float values[] = { 0.f, -0.f, 1e-42f, 1e-30f, 1e30f, 65504.f, FLT_MAX, -FLT_MAX, -1.f,
    std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(), std::nanf("") };
  const int w = 12, h = 5;
  auto reader = Registry().Create("ImageReader");
  std::string error;
  ASSERT_TRUE(reader->SetPropertyText("File",
    ImageOf("values", w, h, 0, [&](int x, int y, float* v, int n) { std::fill_n(v, n, values[(x + y) % 12]); }),
    error));
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(reader, { "radiance" }, quell::Rect());
  ASSERT_TRUE(sink->UpdateTick(0)) << reader->GetErrorText();
  const std::vector<float> read = ReadArrays(reader->GetOutput(), { "radiance" }, { 0, 0, w, h }).at("radiance");
  ASSERT_EQ(read.size(), std::size_t(w * h * 3));
  for (std::size_t i = 0; i < read.size(); ++i)
  {
    const float v = values[(i / 3 % w + i / 3 / w) % 12];
    EXPECT_TRUE(std::isnan(v) ? std::isnan(read[i]) : std::memcmp(&v, &read[i], sizeof v) == 0) << i << " " << v;
  }
}
