// SPDX-License-Identifier: BSD-3-Clause
#include "Threads.h"
#include "quellRegisterTemporal.h"
#include "quellStageRegistry.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellReproject.h"
#include "vtkQuellTemporalAccumulate.h"
#include "vtkQuellTemporalAntialias.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

using namespace quell;

namespace
{
constexpr int W = 96, H = 80;

/// Every array a temporal stage reads, as a function of (pixel, tick) alone, made for exactly the region asked: a stage
/// that reads beyond its declared halo finds nothing there.
class vtkQuellTestFrames : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestFrames);

  int Frame = 0;
  double Amplitude = 0.5, Base = 1; ///< noise, uniform in +-Amplitude around Base
  int SpotX = -1, SpotY = -1;       ///< a pixel that is 1
  double ShiftX = 0, ShiftY = 0;
  int BadX = -1, BadY = -1; ///< a NaN pixel
  void SetFrame(int frame)
  {
    this->Frame = frame;
    this->Modified();
  }
  static float Noise(int x, int y, int tick, int c)
  {
    std::uint32_t v = std::uint32_t(x) * 73856093u ^ std::uint32_t(y) * 19349663u ^
                      (std::uint32_t(tick) * 83492791u + std::uint32_t(c) * 2654435u);
    v = (v ^ 61u) ^ (v >> 16);
    v *= 9;
    v ^= v >> 4;
    v *= 0x27d4eb2du;
    v ^= v >> 15;
    return float((v >> 8) / 16777216.);
  }

protected:
  vtkQuellTestFrames() { this->InitializePorts(); }
  ~vtkQuellTestFrames() override = default;
  void DescribeSource(int& width, int& height) override
  {
    width = W;
    height = H;
  }
  void Execute(StageFrame& frame) override
  {
    const Rect r = frame.Region();
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
      {
        const bool hit = (x - 60) * (x - 60) + (y - 50) * (y - 50) > 64;
        if (ImageOut o = frame.Output("radiance"))
          for (int c = 0; c < 3; ++c)
            o.at(x, y)[c] = x == this->BadX && y == this->BadY ? std::numeric_limits<float>::quiet_NaN()
                            : x == this->SpotX && y == this->SpotY
                              ? 1.f
                              : float(this->Base + this->Amplitude * (2 * Noise(x, y, this->Frame, c) - 1));
        const int surface = (x / 23 + y / 17) % 3;
        if (ImageOut o = frame.Output("depth"))
          *o.at(x, y) = hit ? 4 + surface + 0.01f * x : std::numeric_limits<float>::infinity();
        if (ImageOut o = frame.Output("normal"))
          o.at(x, y)[surface] = hit ? 1.f : 0.f;
        if (ImageOut o = frame.Output("id"))
          *o.at(x, y) = hit ? float(1 + surface) : 0.f;
        if (ImageOut o = frame.Output("motion"))
        {
          o.at(x, y)[0] = float(this->ShiftX);
          o.at(x, y)[1] = float(this->ShiftY);
        }
      }
  }
};
vtkStandardNewMacro(vtkQuellTestFrames);
QUELL_STAGE_DESCRIPTION(vtkQuellTestFrames)
void vtkQuellTestFrames::Describe(StageDescription& d)
{
  d.Category = "Test";
  d.Output("radiance", ArrayKind::Color, "");
  d.Output("depth", ArrayKind::Depth, "");
  d.Output("normal", ArrayKind::Normal, "");
  d.Output("id", ArrayKind::Id, "");
  d.Output("motion", ArrayKind::Motion, "");
}

vtkSmartPointer<vtkImageData> Copy(vtkImageData* image)
{
  auto copy = vtkSmartPointer<vtkImageData>::New();
  copy->DeepCopy(image);
  return copy;
}

/// frames -> reproject -> accumulate -> antialias, with the executor's part (whole history, committed after a frame) by
/// hand.
struct Chain
{
  vtkNew<vtkQuellTestFrames> frames;
  vtkNew<vtkQuellReproject> reproject;
  vtkNew<vtkQuellTemporalAccumulate> accumulate;
  vtkNew<vtkQuellTemporalAntialias> antialias;
  vtkSmartPointer<vtkImageData> lastFrames, lastAccumulate, lastAntialias;

  explicit Chain(bool motion = true)
  {
    reproject->ConnectInput("depth", frames);
    reproject->ConnectInput("normal", frames);
    reproject->ConnectInput("id", frames);
    if (motion)
      reproject->ConnectInput("motion", frames);
    accumulate->ConnectInput("radiance", frames);
    accumulate->ConnectInput("history", reproject);
    accumulate->ConnectInput("moments", reproject);
    accumulate->ConnectInput("length", reproject);
    antialias->ConnectInput("radiance", accumulate);
    antialias->ConnectInput("motion", frames);
    antialias->ConnectInput("depth", frames);
    frames->SetAlwaysMake({ "radiance", "depth", "normal", "id", "motion" });
    accumulate->SetAlwaysMake({ "radiance", "moments", "history" });
    reproject->SetAlwaysMake({ "radiance", "moments", "history", "mask" });
    this->SetHistory(nullptr, nullptr, nullptr);
  }
  /// The mean of the moments goes around the loop as two floats.
  void CarryTwoFloats()
  {
    accumulate->ConnectInput("meanRest", reproject);
    accumulate->SetAlwaysMake({ "radiance", "moments", "history", "meanRest" });
    reproject->SetAlwaysMake({ "radiance", "moments", "history", "mask", "meanRest" });
    twoFloats = true;
  }
  bool twoFloats = false;
  void SetHistory(vtkImageData* f, vtkImageData* a, vtkImageData* t)
  {
    const auto set = [&](const char* name, vtkImageData* image)
    { reproject->SetHistory(reproject->GetDescription().InputIndex(name), image); };
    set("previousDepth", f);
    set("previousNormal", f);
    set("previousId", f);
    set("history", a);
    set("moments", a);
    set("length", a);
    if (twoFloats)
      set("meanRest", a);
    antialias->SetHistory(antialias->GetDescription().InputIndex("history"), t);
  }
  void run(int frame, const Rect& r = { 0, 0, W, H })
  {
    frames->SetFrame(frame);
    const int e[6] = { r.x0, r.x1 - 1, r.y0, r.y1 - 1, 0, 0 };
    antialias->UpdateInformation();
    ASSERT_TRUE(antialias->UpdateExtent(e));
    ASSERT_EQ(antialias->GetErrorText(), "");
  }
  void commit()
  {
    lastFrames = Copy(frames->GetOutput());
    lastAccumulate = Copy(accumulate->GetOutput());
    lastAntialias = Copy(antialias->GetOutput());
    this->SetHistory(lastFrames, lastAccumulate, lastAntialias);
  }
};

float Value(vtkImageData* image, const char* array, int x, int y, int c = 0)
{
  const int* e = image->GetExtent();
  const vtkIdType i = vtkIdType(y - e[2]) * (e[1] - e[0] + 1) + (x - e[0]);
  return float(image->GetPointData()->GetArray(array)->GetComponent(i, c));
}

/// The number of values in `r` that differ in a bit.
int Differences(vtkImageData* a, vtkImageData* b, const char* array, const Rect& r)
{
  int n = 0;
  const int components = a->GetPointData()->GetArray(array)->GetNumberOfComponents();
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x)
      for (int c = 0; c < components; ++c)
      {
        const float u = Value(a, array, x, y, c), v = Value(b, array, x, y, c);
        n += std::memcmp(&u, &v, sizeof u) != 0;
      }
  return n;
}
}

TEST(TemporalStages, AreRegistered)
{
  StageRegistry registry;
  RegisterTemporalStages(registry);
  EXPECT_EQ(registry.Types(), (std::vector<std::string>{ "Reproject", "TemporalAccumulate", "TemporalAntialias" }));
  for (const std::string& type : registry.Types())
  {
    auto stage = registry.Create(type);
    ASSERT_NE(stage, nullptr);
    for (const Property& p : stage->GetDescription().Properties)
    {
      std::string error;
      EXPECT_TRUE(stage->SetPropertyText(p.Name, p.DefaultText, error)) << p.Name << ": " << error;
      EXPECT_EQ(stage->GetPropertyText(p.Name), p.DefaultText);
      EXPECT_FALSE(stage->SetPropertyText(p.Name, "nan", error)) << p.Name;
    }
  }
}

TEST(TemporalStages, FirstFramePassesThrough)
{
  Chain c;
  c.run(0);
  EXPECT_EQ(Differences(c.antialias->GetOutput(), c.frames->GetOutput(), "radiance", { 0, 0, W, H }), 0);
  for (int y = 0; y < H; y += 7)
    for (int x = 0; x < W; x += 7)
    {
      EXPECT_EQ(Value(c.reproject->GetOutput(), "mask", x, y), 3);
      EXPECT_EQ(Value(c.accumulate->GetOutput(), "history", x, y), 1);
    }
}

TEST(TemporalStages, StillCameraGrowsHistoryAndTheErrorFallsAsPredicted)
{
  for (bool motion : { true, false })
  {
    Chain c(motion);
    c.accumulate->SetAlpha(0.05);
    c.reproject->SetBackgroundHistory(true); // its noise is that of the surfaces here
    double predicted = 1;
    const double first = 0.5 * 0.5 / 3; // variance of a uniform number in +-0.5
    for (int frame = 0; frame < 40; ++frame)
    {
      c.run(frame);
      vtkImageData* out = c.accumulate->GetOutput();
      const int h = std::min(frame + 1, 32);
      double error = 0;
      for (int y = 0; y < H; ++y)
        for (int x = 0; x < W; ++x)
        {
          ASSERT_EQ(Value(out, "history", x, y), h);
          for (int k = 0; k < 3; ++k)
          {
            const double d = Value(out, "radiance", x, y, k) - 1;
            error += d * d / (3. * W * H);
          }
        }
      const double a = std::max(0.05, 1. / h);
      predicted = frame == 0 ? 1 : (1 - a) * (1 - a) * predicted + a * a;
      // 23040 independent values: the estimate's relative deviation is 1 %.
      EXPECT_NEAR(error / first, predicted, 0.04 * predicted) << frame;
      c.commit();
    }
    EXPECT_LT(predicted, 0.03);
    // Neither motion nor cameras: the camera is taken to stand still, and the user is told.
    EXPECT_EQ(c.reproject->GetWarnings().size(), motion ? 0u : 1u);
  }
}

// The camera passes a lit wall: at its edge a pixel of background is partly covered in one frame. That light is gone
// with the wall; a history of the background keeps a part of it for ever (1 / n of it after n frames).
TEST(TemporalStages, PartlyCoveredBackgroundLeavesNoSpecks)
{
  const int x = 60, y = 50; // in the hole of the test's surfaces
  for (bool kept : { false, true })
  {
    Chain c;
    c.accumulate->SetAlpha(0.05);
    c.reproject->SetBackgroundHistory(kept);
    c.frames->Amplitude = 0;
    c.frames->Base = 0;
    c.frames->SpotX = x, c.frames->SpotY = y;
    for (int frame = 0; frame < 6; ++frame)
    {
      c.run(frame);
      vtkImageData* out = c.accumulate->GetOutput();
      EXPECT_NEAR(Value(out, "radiance", x, y), frame == 0 ? 1. : kept ? 1. / (frame + 1) : 0., 1e-6) << frame;
      EXPECT_EQ(Value(out, "history", x, y), kept ? frame + 1 : 1) << frame;
      c.commit();
      c.frames->SpotX = -1;
      c.frames->Modified();
    }
  }
}

// Light of a million deviations: as one float the mean stands still and the variance is anything.
TEST(TemporalStages, VarianceFarFromZeroWithTwoFloats)
{
  const int frames = 60;
  double error[2] = {};
  for (const bool two : { true, false })
  {
    Chain c;
    if (two)
      c.CarryTwoFloats();
    c.frames->Base = 1e6;
    c.frames->Amplitude = std::sqrt(3.);
    c.accumulate->SetMaximumHistory(1000);
    c.accumulate->SetMomentsAlpha(0);
    for (int frame = 0; frame < frames; ++frame)
    {
      c.run(frame);
      c.commit();
    }
    double sum = 0, exact = 0;
    int pixels = 0;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x)
      {
        if (Value(c.accumulate->GetOutput(), "history", x, y) != frames)
          continue; // background
        double mean = 0, second = 0;
        for (int frame = 0; frame < frames; ++frame)
        {
          float s[3];
          for (int i = 0; i < 3; ++i)
            s[i] = float(1e6 + std::sqrt(3.) * (2 * vtkQuellTestFrames::Noise(x, y, frame, i) - 1));
          const double l = 0.2126 * s[0] + 0.7152 * s[1] + 0.0722 * s[2], d = l - mean;
          mean += d / (frame + 1);
          second += d * (l - mean);
        }
        sum += Value(c.accumulate->GetOutput(), "moments", x, y, 1);
        exact += second / frames;
        if (two)
        {
          EXPECT_NEAR(double(Value(c.accumulate->GetOutput(), "moments", x, y)) +
                        Value(c.accumulate->GetOutput(), "meanRest", x, y),
            mean, 1e-4);
        }
        ++pixels;
      }
    ASSERT_GT(pixels, 5000);
    error[two] = std::fabs(sum / exact - 1);
  }
  EXPECT_LE(error[1], 1e-3);
  EXPECT_GT(error[0], 3e-3) << "one float would do as well";
}

TEST(TemporalStages, RegionIsTheCropBitForBit)
{
  Chain c;
  c.frames->ShiftX = 0.37;
  c.frames->ShiftY = -1.61;
  for (int frame = 0; frame < 4; ++frame)
  {
    c.run(frame);
    c.commit();
  }
  c.run(4);
  const auto full = Copy(c.antialias->GetOutput()), accumulated = Copy(c.accumulate->GetOutput()),
             reprojected = Copy(c.reproject->GetOutput());
  int used = 0;
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x)
      used += Value(accumulated, "history", x, y) > 2;
  EXPECT_GT(used, W * H / 2);
  for (const Rect& r : { Rect{ 0, 0, 1, 1 }, Rect{ 17, 9, 70, 66 }, Rect{ 90, 70, W, H }, Rect{ 40, 0, 41, H } })
  {
    Chain crop;
    crop.frames->ShiftX = 0.37;
    crop.frames->ShiftY = -1.61;
    crop.SetHistory(c.lastFrames, c.lastAccumulate, c.lastAntialias);
    crop.run(4, r);
    EXPECT_EQ(Differences(crop.antialias->GetOutput(), full, "radiance", r), 0);
    EXPECT_EQ(Differences(crop.accumulate->GetOutput(), accumulated, "moments", r), 0);
    EXPECT_EQ(Differences(crop.reproject->GetOutput(), reprojected, "mask", r), 0);
    // Only the region and the declared halos were made: 1 for the neighbourhood of anti-aliasing, 1 for slopes and
    // filling.
    EXPECT_EQ(crop.frames->GetCounters().Pixels, r.grown(2).clipped({ 0, 0, W, H }).area());
  }
}

TEST(TemporalStages, SameBitsForAnyNumberOfThreads)
{
  vtkSmartPointer<vtkImageData> one;
  for (int threads : { 1, 2, 3, 7 })
  {
    Chain c;
    c.frames->ShiftX = -0.43;
    c.frames->ShiftY = 0.21;
    quelltest::WithThreads(threads,
      [&]()
      {
        for (int frame = 0; frame < 3; ++frame)
        {
          c.run(frame);
          c.commit();
        }
      });
    if (threads == 1)
      one = c.lastAntialias;
    EXPECT_EQ(Differences(one, c.lastAntialias, "radiance", { 0, 0, W, H }), 0) << threads;
  }
}

TEST(TemporalStages, SameFrameTwiceExecutesNothing)
{
  Chain c;
  c.run(0);
  c.commit();
  c.run(1);
  const auto before = c.antialias->GetCounters().Executions;
  c.antialias->Update();
  EXPECT_EQ(c.antialias->GetCounters().Executions, before);
  // The same history again is no change either.
  c.SetHistory(c.lastFrames, c.lastAccumulate, c.lastAntialias);
  c.antialias->Update();
  EXPECT_EQ(c.antialias->GetCounters().Executions, before);
}

TEST(TemporalStages, ANonFinitePixelIsGoneInTheNextFrame)
{
  Chain c;
  c.run(0);
  c.commit();
  c.frames->BadX = 20;
  c.frames->BadY = 30;
  c.run(1);
  EXPECT_EQ(c.accumulate->GetCounters().NonFinite, 1);
  EXPECT_EQ(c.accumulate->GetWarnings().size(), 1u);
  EXPECT_EQ(Value(c.accumulate->GetOutput(), "history", 20, 30), 1);
  // It kept what frame 0 had there, and nobody else noticed.
  EXPECT_EQ(Value(c.accumulate->GetOutput(), "radiance", 20, 30), Value(c.lastAccumulate, "radiance", 20, 30));
  EXPECT_EQ(Value(c.accumulate->GetOutput(), "history", 21, 30), 2);
  c.commit();
  c.frames->BadX = -1;
  c.run(2);
  EXPECT_EQ(Value(c.accumulate->GetOutput(), "history", 20, 30), 2);

  // Injected into the kept history.
  auto spoilt = Copy(c.lastAccumulate);
  spoilt->GetPointData()->GetArray("radiance")->SetComponent(30 * W + 20, 1, std::numeric_limits<double>::quiet_NaN());
  auto spoiltTaa = Copy(c.lastAntialias);
  spoiltTaa->GetPointData()
    ->GetArray("radiance")
    ->SetComponent(30 * W + 20, 1, std::numeric_limits<double>::quiet_NaN());
  c.SetHistory(c.lastFrames, spoilt, spoiltTaa);
  c.run(2);
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x)
      for (int k = 0; k < 3; ++k)
      {
        ASSERT_TRUE(std::isfinite(Value(c.accumulate->GetOutput(), "radiance", x, y, k)));
        ASSERT_TRUE(std::isfinite(Value(c.antialias->GetOutput(), "radiance", x, y, k)));
      }
}

TEST(TemporalStages, HistoryOfAnotherSizeIsNotUsed)
{
  Chain c;
  c.run(0);
  vtkNew<vtkImageData> small;
  small->SetExtent(0, 9, 0, 9, 0, 0);
  for (const auto& array : { std::make_pair("radiance", 3), std::make_pair("moments", 2), std::make_pair("history", 1),
         std::make_pair("depth", 1), std::make_pair("normal", 3), std::make_pair("id", 1) })
  {
    vtkNew<vtkFloatArray> values;
    values->SetName(array.first);
    values->SetNumberOfComponents(array.second);
    values->SetNumberOfTuples(100);
    values->FillValue(1);
    small->GetPointData()->AddArray(values);
  }
  c.SetHistory(small, small, small);
  c.run(1);
  EXPECT_EQ(Value(c.reproject->GetOutput(), "mask", 3, 3), 3);
  EXPECT_EQ(c.reproject->GetWarnings(),
    std::vector<std::string>{ "history of another size is not used: it is 10 x 10, the frame 96 x 80" });
  EXPECT_EQ(Differences(c.antialias->GetOutput(), c.frames->GetOutput(), "radiance", { 0, 0, W, H }), 0);
}

TEST(TemporalStages, MissingInputsAreNamed)
{
  vtkNew<vtkQuellReproject> stage;
  vtkNew<vtkQuellTestFrames> frames;
  stage->ConnectInput("depth", frames);
  stage->ConnectInput("normal", frames);
  stage->GlobalWarningDisplayOff();
  EXPECT_FALSE(stage->GetExecutive()->Update());
  stage->GlobalWarningDisplayOn();
  EXPECT_EQ(stage->GetErrorText(), "required input \"history\" is not connected");
}

TEST(TemporalStages, ExplainSaysWhatIsLeftOut)
{
  Chain with(true), without(false);
  EXPECT_EQ(with.reproject->Explain().size(), 1u);
  EXPECT_EQ(without.reproject->Explain().size(), 2u);
}
