// SPDX-License-Identifier: BSD-3-Clause
#include "quellMetrics.h"
#include "quellPresenter.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

using namespace quell;

namespace
{
Picture Make(const char* name, ArrayKind kind, int w, int h, int components, const std::vector<float>& values)
{
  Picture p;
  p.Image = vtkSmartPointer<vtkImageData>::New();
  p.Image->SetDimensions(w, h, 1);
  vtkNew<vtkFloatArray> a;
  a->SetName(name);
  a->SetNumberOfComponents(components);
  for (float v : values)
  {
    a->InsertNextValue(v);
  }
  p.Image->GetPointData()->AddArray(a);
  p.Array = name;
  p.Kind = kind;
  return p;
}

std::array<int, 3> At(const DisplayImage& d, int x, int y)
{
  const std::uint8_t* p = &d.Rgba[std::size_t(4 * (y * d.Width + x))];
  return { p[0], p[1], p[2] };
}

DisplayImage Map(const Picture& p, const DisplaySettings& s = {})
{
  DisplayMapper mapper;
  return mapper.Map(p.Image, p.Array, p.Kind, s);
}
}

TEST(DisplayMapper, RowsAreTurnedAndColoursGoThroughTheView)
{
  const Picture p = Make("radiance", ArrayKind::Color, 1, 2, 3, { 0.f, 0.f, 0.f, 1.f, 0.2158605f, 0.f });
  DisplaySettings s;
  s.View = "sRGB";
  const DisplayImage d = Map(p, s);
  ASSERT_EQ(d.Error, "");
  EXPECT_EQ(At(d, 0, 0), (std::array<int, 3>{ 255, 128, 0 })) << "the last row is on top";
  EXPECT_EQ(At(d, 0, 1), (std::array<int, 3>{ 0, 0, 0 }));
  s.Exposure = -1;
  EXPECT_EQ(At(Map(p, s), 0, 0)[0], 188);
}

TEST(DisplayMapper, EachKindHasItsPicture)
{
  const float inf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(
    At(Map(Make("normal", ArrayKind::Normal, 1, 1, 3, { 1, 0, -1 })), 0, 0), (std::array<int, 3>{ 255, 128, 0 }));
  const DisplayImage depth = Map(Make("depth", ArrayKind::Depth, 3, 1, 1, { 1, 100, inf }));
  EXPECT_TRUE(depth.Logarithmic);
  EXPECT_EQ(depth.NonFinite, 0) << "infinity is the depth where nothing was hit";
  EXPECT_DOUBLE_EQ(depth.Low, 1);
  EXPECT_EQ(At(depth, 2, 0), (std::array<int, 3>{ 18, 20, 24 }));
  EXPECT_NE(At(depth, 0, 0), At(depth, 1, 0));
  const DisplayImage id = Map(Make("id", ArrayKind::Id, 3, 1, 1, { 1, 2, 1 }));
  EXPECT_EQ(At(id, 0, 0), At(id, 2, 0));
  EXPECT_NE(At(id, 0, 0), At(id, 1, 0));
  // Opposite motions have opposite hues; none is dark.
  const DisplayImage flow = Map(Make("motion", ArrayKind::Motion, 3, 1, 2, { 2, 0, -2, 0, 0, 0 }));
  EXPECT_NE(At(flow, 0, 0), At(flow, 1, 0));
  EXPECT_EQ(At(flow, 2, 0)[0], At(flow, 2, 0)[1]);
}

TEST(DisplayMapper, WhatIsNotFiniteIsCountedPlacedAndFlagged)
{
  const float nan = std::nanf("");
  const Picture p = Make("radiance", ArrayKind::Color, 2, 2, 3, { 0, 0, 0, 1, 1, 1, 1, nan, 1, 0, 0, 0 });
  DisplaySettings s;
  const DisplayImage d = Map(p, s);
  EXPECT_EQ(d.NonFinite, 1);
  EXPECT_EQ(d.FirstX, 0);
  EXPECT_EQ(d.FirstY, 1);
  EXPECT_EQ(At(d, 0, 0), (std::array<int, 3>{ 255, 0, 200 }));
  s.FlagNonFinite = false;
  EXPECT_NE(At(Map(p, s), 0, 0), (std::array<int, 3>{ 255, 0, 200 }));
  EXPECT_EQ(Map(Make("depth", ArrayKind::Depth, 1, 1, 1, { nan })).NonFinite, 1);
  EXPECT_EQ(Map(Make("variance", ArrayKind::Variance, 2, 1, 1, { nan, nan })).NonFinite, 2);
}

TEST(DisplayMapper, MissingArraysAreSentences)
{
  Picture p = Make("radiance", ArrayKind::Color, 1, 1, 3, { 0, 0, 0 });
  p.Array = "albedo";
  EXPECT_NE(Map(p).Error.find("albedo"), std::string::npos);
  EXPECT_NE(Map(Picture()).Error, "");
}

TEST(Compare, MapsAreWhatTheySay)
{
  const Picture a = Make("radiance", ArrayKind::Color, 2, 1, 3, { 1, 1, 1, 0.5f, 0, 0 });
  const Picture b = Make("radiance", ArrayKind::Color, 2, 1, 3, { 1, 1, 1, 0, 0.25f, 0 });
  std::string error;
  const Picture difference = Compare(a, b, CompareMap::Difference, 4, error);
  ASSERT_TRUE(difference) << error;
  const ImageIn v = ArrayView(difference.Image, difference.Array);
  EXPECT_EQ(v.at(0, 0)[0], 0.f);
  EXPECT_EQ(v.at(1, 0)[0], 2.f);
  EXPECT_EQ(v.at(1, 0)[1], 1.f);
  const Picture sign = Compare(b, a, CompareMap::SignedDifference, 1, error);
  EXPECT_LT(ArrayView(sign.Image, sign.Array).at(1, 0)[0], 0.1f);
  const Picture flip = Compare(a, b, CompareMap::Flip, 1, error);
  ASSERT_TRUE(flip) << error;
  const ImageIn f = ArrayView(flip.Image, flip.Array);
  EXPECT_NEAR((double(f.at(0, 0)[0]) + double(f.at(1, 0)[0])) / 2,
    ComputeMetric("FLIP", ArrayView(a.Image, a.Array), ArrayView(b.Image, b.Array)), 1e-6);
  EXPECT_FALSE(Compare(a, Make("depth", ArrayKind::Depth, 2, 1, 1, { 1, 2 }), CompareMap::Flip, 1, error));
  EXPECT_NE(error, "");
  EXPECT_FALSE(Compare(a, Make("radiance", ArrayKind::Color, 1, 1, 3, { 1, 1, 1 }), CompareMap::Difference, 1, error));
  EXPECT_NE(error.find("1 x 1"), std::string::npos) << error;
}

TEST(Histogram, CountsEveryFiniteValueOnce)
{
  const Picture p = Make("depth", ArrayKind::Depth, 5, 1, 1, { 0, 1, 2, 4, std::numeric_limits<float>::infinity() });
  const Histogram h = HistogramOf(p, false);
  int sum = 0;
  for (int c : h.Counts[0])
  {
    sum += c;
  }
  EXPECT_EQ(sum + h.Below + h.Above, 4);
  EXPECT_EQ(h.NonFinite, 1);
  EXPECT_EQ(h.Pixels, 5);
  EXPECT_DOUBLE_EQ(h.Mean[0], 1.75);
  EXPECT_DOUBLE_EQ(h.Maximum[0], 4);
}

TEST(Histogram, TheLogarithmicAxisReachesFromTheSmallToTheLargest)
{
  // A lamp of 1000 over a wall of 0.1, and a pixel that got nothing.
  std::vector<float> values(1000, 0.1f);
  values[0] = 1000;
  values[1] = 0;
  values[2] = 1e-9f;
  const Picture p = Make("depth", ArrayKind::Depth, 1000, 1, 1, values);
  const Histogram h = HistogramOf(p, true);
  EXPECT_TRUE(h.Logarithmic);
  EXPECT_NEAR(h.High, 3, 1e-6);
  EXPECT_GE(h.Low, -3);
  EXPECT_LE(h.Low, -0.99);
  EXPECT_EQ(h.Counts[0][Histogram::Bins - 1], 1) << "the lamp is on the axis";
  EXPECT_EQ(h.Below, 2) << "nothing, and next to nothing";
  EXPECT_EQ(h.Above, 0);
  const Histogram linear = HistogramOf(p, false);
  EXPECT_LT(linear.High, 1);
  EXPECT_EQ(linear.Above, 1);
}

TEST(Compare, FiguresOfTheDifference)
{
  const float nan = std::nanf("");
  const Picture a = Make("radiance", ArrayKind::Color, 2, 2, 3, { 1, 1, 1, 2, 2, 2, 3, 3, 3, nan, 0, 0 });
  const Picture b = Make("radiance", ArrayKind::Color, 2, 2, 3, { 1, 1, 1, 2, 2.5f, 2, 3, 3, 1, 0, 0, 0 });
  const DifferenceFigures d = DifferenceOf(a, b);
  EXPECT_TRUE(d.Known);
  EXPECT_DOUBLE_EQ(d.Largest, 2);
  EXPECT_EQ(d.LargestX, 0);
  EXPECT_EQ(d.LargestY, 1);
  EXPECT_DOUBLE_EQ(d.Mean, 2.5 / 11) << "of the eleven pairs of numbers";
  EXPECT_EQ(d.OnlyOneFinite, 1);
  EXPECT_EQ(DifferenceOf(a, a).Largest, 0);
  EXPECT_EQ(DifferenceOf(a, a).OnlyOneFinite, 0);
  EXPECT_FALSE(DifferenceOf(a, Make("radiance", ArrayKind::Color, 1, 1, 3, { 1, 1, 1 })).Known);
}

TEST(Presenter, GivesPicturesMapsAndErrors)
{
  Presenter presenter;
  PresentWish wish;
  wish.A = Make("radiance", ArrayKind::Color, 2, 1, 3, { 1, 1, 1, 0.5f, 0, 0 });
  wish.B = wish.Reference = Make("radiance", ArrayKind::Color, 2, 1, 3, { 1, 1, 1, 0, 0.25f, 0 });
  wish.Map = CompareMap::Difference;
  wish.WantHistogram = true;
  wish.Metrics = { "relMSE", "MAE" };
  presenter.Wish(wish);
  ASSERT_TRUE(presenter.WaitIdle(10));
  const auto p = presenter.Latest();
  ASSERT_TRUE(p && p->Complete);
  EXPECT_EQ(p->A.Width, 2);
  EXPECT_EQ(p->Map.Width, 2);
  EXPECT_EQ(p->Bars.Channels, 3);
  ASSERT_EQ(p->Errors.size(), 2u);
  EXPECT_EQ(p->Errors[1].first, "MAE");
  EXPECT_NEAR(p->Errors[1].second, 0.75 / 6, 1e-7);
  wish.Reference = Make("radiance", ArrayKind::Color, 1, 1, 3, { 1, 1, 1 });
  presenter.Wish(wish);
  ASSERT_TRUE(presenter.WaitIdle(10));
  EXPECT_TRUE(presenter.Latest()->Errors.empty());
  EXPECT_NE(presenter.Latest()->ErrorsText.find("1 x 1"), std::string::npos);
}
