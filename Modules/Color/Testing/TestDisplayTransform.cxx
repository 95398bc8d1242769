// SPDX-License-Identifier: BSD-3-Clause
#include "quellRegisterColor.h"
#include "vtkQuellDisplayTransform.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObject.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"
#include "vtkTrivialProducer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>

using namespace quell;

namespace
{
double EncodeSrgb(double v)
{
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
}
double AcesLike(double x)
{
  const double v = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
  return EncodeSrgb(std::min(1., std::max(0., v)));
}

struct Bench
{
  vtkNew<vtkImageData> Image;
  vtkNew<vtkTrivialProducer> Producer;
  vtkNew<vtkQuellDisplayTransform> Stage;
  vtkNew<vtkQuellCollector> Collector;

  Bench(int w, int h, const std::function<float(int, int, int)>& value)
  {
    this->Image->SetExtent(0, w - 1, 0, h - 1, 0, 0);
    vtkNew<vtkFloatArray> array;
    array->SetName("radiance");
    array->SetNumberOfComponents(3);
    array->SetNumberOfTuples(w * h);
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x)
        for (int c = 0; c < 3; ++c)
          array->SetValue((y * w + x) * 3 + c, value(x, y, c));
    this->Image->GetPointData()->SetScalars(array);
    this->Producer->SetOutput(this->Image);
    this->Stage->ConnectInput("radiance", this->Producer);
  }
  bool Run(const Rect& region = Rect())
  {
    this->Collector->ClearRequests();
    this->Collector->AddRequest(this->Stage, { "display" }, region);
    return this->Collector->UpdateTick(0);
  }
  float At(int x, int y, int c)
  {
    vtkImageData* out = this->Stage->GetOutput();
    auto array = vtkFloatArray::SafeDownCast(out->GetPointData()->GetArray("display"));
    if (!array)
      throw std::runtime_error("no display");
    int ijk[3] = { x, y, 0 };
    return array->GetComponent(out->ComputePointId(ijk), c);
  }
};

/// 0 to 16, dense near zero.
float Ramp(int x, int y, int)
{
  const double t = (x + 256. * y) / 1023.;
  return float(16 * t * t * t);
}
}

TEST(DisplayTransform, SrgbViewIsTheEncoding)
{
  Bench s(256, 4, Ramp);
  s.Stage->SetView("sRGB");
  ASSERT_TRUE(s.Run()) << s.Stage->GetErrorText();
  double worst = 0;
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 256; ++x)
      worst = std::max(worst, std::fabs(s.At(x, y, 1) - EncodeSrgb(std::min(1.f, Ramp(x, y, 1)))));
  EXPECT_LT(worst, 1e-4);
}

TEST(DisplayTransform, AcesLikeViewIsItsFormulaAndMonotone)
{
  Bench s(256, 4, Ramp);
  s.Stage->SetView("ACES-like");
  ASSERT_TRUE(s.Run()) << s.Stage->GetErrorText();
  double worst = 0;
  float last = -1;
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 256; ++x)
    {
      worst = std::max(worst, std::fabs(s.At(x, y, 0) - AcesLike(Ramp(x, y, 0))));
      EXPECT_GE(s.At(x, y, 0), last) << x << " " << y;
      last = s.At(x, y, 0);
    }
  EXPECT_LT(worst, 1e-3);
}

TEST(DisplayTransform, MiddleGreyExposureAndDefaults)
{
  Bench s(2, 1, [](int x, int, int) { return x ? 0.09f : 0.18f; });
  ASSERT_TRUE(s.Run()) << s.Stage->GetErrorText();
  // f(0.18) = 0.0867240 / 0.3249320 = 0.2668989; encoded 0.5536.
  EXPECT_NEAR(s.At(0, 0, 0), 0.5536, 1e-3) << "the default view is the ACES-like one";
  s.Stage->SetView("sRGB");
  s.Stage->SetExposure(1);
  ASSERT_TRUE(s.Run());
  EXPECT_NEAR(s.At(1, 0, 2), 0.46136, 1e-4) << "0.09 one stop up is 0.18";
  s.Stage->SetView("Raw");
  s.Stage->SetDisplay("sRGB");
  s.Stage->SetExposure(0);
  ASSERT_TRUE(s.Run());
  EXPECT_EQ(s.At(1, 0, 0), 0.09f);
}

TEST(DisplayTransform, ExtremesStayFiniteAndInRange)
{
  const float inf = std::numeric_limits<float>::infinity();
  const float values[8] = { NAN, inf, -inf, 3.4e38f, -3.4e38f, 1e-42f, 65520.f, -1.f };
  for (const char* view : { "ACES-like", "sRGB", "Raw" })
  {
    SCOPED_TRACE(view);
    // Every extreme alone among grey neighbours.
    Bench s(32, 3, [&](int x, int y, int c) { return y == 1 && x % 4 == 1 && c == 1 ? values[x / 4] : 0.5f; });
    s.Stage->SetView(view);
    ASSERT_TRUE(s.Run()) << s.Stage->GetErrorText();
    for (int y = 0; y < 3; ++y)
      for (int x = 0; x < 32; ++x)
        for (int c = 0; c < 3; ++c)
        {
          ASSERT_TRUE(std::isfinite(s.At(x, y, c))) << x;
          ASSERT_GE(s.At(x, y, c), 0.f);
          ASSERT_LE(s.At(x, y, c), 1.f);
        }
    for (int i = 0; i < 3; ++i)
      EXPECT_EQ(s.At(4 * i + 1, 1, 1), s.At(0, 0, 1)) << "filled from the grey around";
    EXPECT_GT(s.At(4 * 3 + 1, 1, 1), 0.99f) << "the largest float is white";
    EXPECT_EQ(s.At(4 * 4 + 1, 1, 1), 0.f);
    EXPECT_GT(s.At(4 * 6 + 1, 1, 1), 0.99f);
    EXPECT_EQ(s.Stage->GetCounters().NonFinite, 3);
    ASSERT_EQ(s.Stage->GetWarnings().size(), 1u);
    EXPECT_NE(s.Stage->GetWarnings()[0].find("(1, 1)"), std::string::npos) << s.Stage->GetWarnings()[0];
  }
  Bench all(3, 3, [](int, int, int) { return std::numeric_limits<float>::quiet_NaN(); });
  ASSERT_TRUE(all.Run());
  EXPECT_NEAR(all.At(1, 1, 0), 0.f, 1e-6) << "no finite neighbour: 0";
}

TEST(DisplayTransform, RegionIsTheCropInEveryBit)
{
  const auto value = [](int x, int y, int c)
  {
    return (x * 31 + y * 17) % 23 == 0 ? std::numeric_limits<float>::quiet_NaN()
                                       : float((x * 7 + y * 13 + c) % 97) * 0.05f;
  };
  Bench whole(150, 90, value), part(150, 90, value);
  ASSERT_TRUE(whole.Run());
  for (const Rect& r : { Rect{ 1, 1, 2, 2 }, Rect{ 60, 30, 133, 71 }, Rect{ 23, 0, 24, 90 } })
  {
    ASSERT_TRUE(part.Run(r));
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        for (int c = 0; c < 3; ++c)
          ASSERT_EQ(whole.At(x, y, c), part.At(x, y, c)) << x << " " << y;
  }
}

TEST(DisplayTransform, MistakesAreExplained)
{
  vtkObject::GlobalWarningDisplayOff();
  Bench s(2, 2, [](int, int, int) { return 0.5f; });
  s.Stage->SetView("ACES-lik");
  EXPECT_FALSE(s.Run());
  EXPECT_NE(s.Stage->GetErrorText().find("did you mean \"ACES-like\""), std::string::npos) << s.Stage->GetErrorText();
  s.Stage->SetView("");
  s.Stage->SetDisplay("Projector");
  EXPECT_FALSE(s.Run());
  EXPECT_NE(s.Stage->GetErrorText().find("it has \"sRGB\""), std::string::npos) << s.Stage->GetErrorText();
  s.Stage->SetDisplay("");
  s.Stage->SetConfig("/no/such/config.ocio");
  EXPECT_FALSE(s.Run());
  EXPECT_NE(s.Stage->GetErrorText().find("/no/such/config.ocio"), std::string::npos);
  EXPECT_EQ(s.Stage->GetOutput()->GetPointData()->GetNumberOfArrays(), 0);
  s.Stage->SetConfig("");
  EXPECT_TRUE(s.Run()) << s.Stage->GetErrorText();
  vtkObject::GlobalWarningDisplayOn();
}

TEST(DisplayTransform, ConfigurationsOfOthers)
{
  const std::string dir = std::string(QUELL_SHARED_DATA) + "/ocio/";
  if (!std::filesystem::exists(dir))
    GTEST_SKIP() << dir << " is not here";
  vtkObject::GlobalWarningDisplayOff();
  Bench s(2, 2, [](int, int, int) { return 0.18f; });
  s.Stage->SetConfig(dir + "cg-config-v2.1.0_aces-v1.3_ocio-v2.3.ocio");
  EXPECT_FALSE(s.Run());
  EXPECT_NE(s.Stage->GetErrorText().find("cg-config-v2.1.0"), std::string::npos);
  EXPECT_NE(s.Stage->GetErrorText().find("2.3"), std::string::npos) << s.Stage->GetErrorText();
  vtkObject::GlobalWarningDisplayOn();
  s.Stage->SetConfig(dir + "cg-config-v1.0.0_aces-v1.3_ocio-v2.1.ocio");
  ASSERT_TRUE(s.Run()) << s.Stage->GetErrorText();
  EXPECT_GT(s.At(0, 0, 0), 0.3f);
  EXPECT_LT(s.At(0, 0, 0), 0.5f) << "ACES 1.0 SDR shows middle grey near 0.36 to 0.4";
}

TEST(DisplayTransform, Registered)
{
  StageRegistry registry;
  RegisterColorStages(registry);
  EXPECT_EQ(registry.Types(), std::vector<std::string>{ "DisplayTransform" });
}
