// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterMetrics.h"
#include "quellStageRegistry.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellCompareImages.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkTrivialProducer.h"

#include <gtest/gtest.h>

#include <limits>

using namespace quell;

namespace
{
struct Source
{
  vtkNew<vtkImageData> image;
  vtkNew<vtkTrivialProducer> producer;

  Source(int w, int h, float value, const FrameFacts& facts = FrameFacts())
  {
    image->SetExtent(0, w - 1, 0, h - 1, 0, 0);
    vtkNew<vtkFloatArray> array;
    array->SetName("radiance");
    array->SetNumberOfComponents(3);
    array->SetNumberOfTuples(w * h);
    array->FillValue(value);
    image->GetPointData()->AddArray(array);
    facts.Write(image->GetFieldData());
    producer->SetOutput(image);
  }
  void set(vtkIdType i, float v) { image->GetPointData()->GetArray("radiance")->SetComponent(i, 0, v); }
};

struct Comparison
{
  vtkNew<vtkQuellCompareImages> stage;
  Comparison(Source& image, Source& reference, Source* baseline = nullptr)
  {
    stage->SetLabel("beauty");
    stage->ConnectInput("image", image.producer);
    stage->ConnectInput("reference", reference.producer);
    if (baseline)
      stage->ConnectInput("baseline", baseline->producer);
  }
  std::string report()
  {
    EXPECT_TRUE(stage->GetExecutive()->Update());
    EXPECT_EQ(stage->GetErrorText(), "");
    return stage->GetReport();
  }
};

FrameFacts WithCamera(double focal, const char* scene)
{
  FrameFacts f;
  f.HasCamera = true;
  f.WorldToNdc.m[0][0] = f.WorldToNdc.m[1][1] = focal;
  f.WorldToNdc.m[3][2] = -1;
  f.WorldToNdc.m[3][3] = 0;
  f.Scene = scene;
  return f;
}
}

TEST(CompareImages, IsRegisteredAsASink)
{
  StageRegistry registry;
  RegisterMetricsStages(registry);
  const StageDescription* d = registry.Describe("CompareImages");
  ASSERT_NE(d, nullptr);
  EXPECT_TRUE(d->Sink);
  EXPECT_NE(registry.Create("CompareImages"), nullptr);
}

TEST(CompareImages, ReportsHowMuchBetterThanTheBaseline)
{
  // r = 1: relMSE = d^2 / 1.01.
  Source image(16, 16, 1.1f), reference(16, 16, 1), noisy(16, 16, 2);
  Comparison c(image, reference, &noisy);
  EXPECT_EQ(c.report(), "beauty: relMSE 0.0099, 100 times lower than the noisy input's 0.99");
  c.stage->SetMetrics("MSE PSNR-linear SSIM");
  EXPECT_EQ(c.report(), "beauty: MSE 0.01, 100 times lower than the noisy input's 1; PSNR-linear 200.00 dB, 0.00 dB "
                        "above the noisy input's "
                        "200.00 dB; SSIM 1, above the noisy input's 0.992");
  Comparison worse(noisy, reference, &image);
  EXPECT_EQ(worse.report(), "beauty: relMSE 0.99, 100 times higher than the noisy input's 0.0099");
  Comparison alone(image, reference);
  EXPECT_EQ(alone.report(), "beauty: relMSE 0.0099");
  Comparison perfect(reference, reference, &noisy);
  EXPECT_EQ(perfect.report(), "beauty: relMSE 0, lower than the noisy input's 0.99");
}

TEST(CompareImages, MakesTheErrorImage)
{
  Source image(16, 16, 1), reference(16, 16, 1);
  image.set(3, 2);
  Comparison c(image, reference);
  c.report();
  vtkDataArray* error = c.stage->GetOutput()->GetPointData()->GetArray("error");
  ASSERT_NE(error, nullptr);
  EXPECT_FLOAT_EQ(error->GetComponent(3, 0), 1 / 1.01f / 3);
  EXPECT_EQ(error->GetComponent(4, 0), 0);
}

TEST(CompareImages, DoesNotCompareWhatDiffers)
{
  Source image(16, 16, 1), large(32, 24, 1);
  Comparison size(image, large);
  EXPECT_EQ(size.report(), "beauty: not compared: the reference is 32 x 24, the image 16 x 16");
  EXPECT_EQ(size.stage->GetWarnings().size(), 1u);

  Source a(16, 16, 1, WithCamera(2, "abc")), same(16, 16, 1, WithCamera(2 + 1e-6, "abc")),
    camera(16, 16, 1, WithCamera(2.01, "abc")), scene(16, 16, 1, WithCamera(2, "def")), plain(16, 16, 1);
  EXPECT_EQ(Comparison(a, same).report(), "beauty: relMSE 0");
  EXPECT_EQ(Comparison(a, plain).report(), "beauty: relMSE 0");
  EXPECT_EQ(Comparison(a, camera).report(), "beauty: not compared: the reference is of another camera");
  EXPECT_EQ(Comparison(a, scene).report(), "beauty: not compared: the reference is of another scene");

  Source nan(16, 16, 1);
  nan.set(16 * 2 + 5, std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(Comparison(nan, a).report(),
    "beauty: not compared: the image has 1 non-finite pixel, the first at column 5, row 2 from the bottom");
  // It works again once the image does.
  Comparison c(nan, plain);
  c.report();
  nan.set(16 * 2 + 5, 1);
  nan.image->Modified();
  nan.image->GetPointData()->GetArray("radiance")->Modified();
  nan.producer->Modified();
  EXPECT_EQ(c.report(), "beauty: relMSE 0");
  EXPECT_TRUE(c.stage->GetWarnings().empty());
}

TEST(CompareImages, UnknownMetricsFailBeforeAnythingRuns)
{
  Source image(16, 16, 1), reference(16, 16, 1);
  Comparison c(image, reference);
  c.stage->SetMetrics("relMSE SSSIM");
  c.stage->GlobalWarningDisplayOff();
  EXPECT_FALSE(c.stage->GetExecutive()->Update());
  c.stage->GlobalWarningDisplayOn();
  EXPECT_EQ(c.stage->GetErrorText(), "unknown metric \"SSSIM\"; did you mean SSIM?");
  EXPECT_EQ(c.stage->GetCounters().Executions, 0);
}

TEST(CompareImages, WaitsForItsTick)
{
  Source image(16, 16, 1), reference(16, 16, 1);
  Comparison c(image, reference);
  c.stage->SetTick(5);
  EXPECT_EQ(c.report(), "beauty: not compared: tick 5 was not among the frames");
  c.stage->SetTick(0);
  EXPECT_EQ(c.report(), "beauty: relMSE 0");
}

TEST(CompareImages, ComparesTheRegionOnly)
{
  Source image(32, 32, 1), reference(32, 32, 1);
  image.set(0, 100);
  Comparison c(image, reference);
  const int region[6] = { 8, 23, 8, 19, 0, 0 };
  c.stage->UpdateExtent(region);
  EXPECT_EQ(c.stage->GetReport(), "beauty: relMSE 0");
  const int corner[6] = { 0, 9, 0, 9, 0, 0 };
  c.stage->UpdateExtent(corner);
  EXPECT_EQ(c.stage->GetReport(), "beauty: relMSE 32.3"); // 99^2 / 1.01 / 3 / 100
}

// What the memory planner hears: FLIP holds 32 planes of doubles, a mean nothing.
TEST(CompareImages, TellsWhatItsMetricsTake)
{
  vtkNew<vtkQuellCompareImages> compare;
  const quell::Rect r{ 0, 0, 100, 10 };
  const auto bytes = [&](const char* names)
  {
    compare->SetMetrics(names);
    return compare->ScratchBytes(r, r, {});
  };
  EXPECT_EQ(bytes("relMSE"), 0);
  EXPECT_EQ(bytes("relMSE SSIM"), 1000 * 6 * 8.);
  EXPECT_EQ(bytes("HDR-FLIP SSIM"), 1000 * 32 * 8.);
  EXPECT_EQ(bytes("nonsense"), 0) << "refused elsewhere";
}
