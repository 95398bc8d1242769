// SPDX-License-Identifier: BSD-3-Clause
// Several sources that each take one sample of the same pixels, over several frames.
#include "SourceTesting.h"

#include <gtest/gtest.h>

#include <cmath>

using namespace sourcetesting;

namespace
{
std::vector<float> Sample(int first, int perTick, int tick, int spp = 1)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 24, 20, spp);
  s->SetFirstSample(first);
  s->SetSamplesPerTick(perTick);
  EXPECT_TRUE(Ask(s, { "radiance" }, tick));
  return Copy(s, "radiance");
}
}

// Source i of four takes point 4 t + i of a pixel's sequence in frame t: together, frame by frame, they are the source
// of four samples.
TEST(SampleSequence, SingleSamplesOfEveryFrameAreThoseOfThePixel)
{
  for (int tick : { 0, 1, 5 })
  {
    const std::vector<float> together = Sample(0, 0, tick, 4);
    std::vector<double> mean(together.size(), 0.);
    for (int i = 0; i < 4; ++i)
    {
      const std::vector<float> one = Sample(i, 4, tick);
      ASSERT_EQ(one.size(), together.size());
      for (std::size_t k = 0; k < one.size(); ++k)
        mean[k] += one[k] / 4;
    }
    for (std::size_t k = 0; k < mean.size(); ++k)
      ASSERT_NEAR(mean[k], together[k], 1e-5 * std::fabs(together[k]) + 1e-7) << tick << " " << k;
  }
}

// Left at 0, every frame goes on by one: source 0 repeats what source 1 had the frame before. With a stride nothing is
// seen twice.
TEST(SampleSequence, FramesOverlapWithoutAStrideOnly)
{
  EXPECT_EQ(Sample(0, 0, 1), Sample(1, 0, 0));
  std::vector<std::vector<float>> seen;
  for (int tick = 0; tick < 3; ++tick)
    for (int i = 0; i < 4; ++i)
      seen.push_back(Sample(i, 4, tick));
  for (std::size_t a = 0; a < seen.size(); ++a)
    for (std::size_t b = 0; b < a; ++b)
      EXPECT_NE(seen[a], seen[b]) << a << " " << b;
  // A source of several samples may have one too.
  EXPECT_EQ(Sample(2, 6, 1, 2), Sample(0, 0, 4, 2));
}
