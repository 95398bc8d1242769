// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellAovSplit.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
const quell::Rect E{ 0, 0, 3, 3 };
struct Layers
{
  Image images[12];
  quell::AovLayers views;
  Layers()
  {
    quell::ImageOut* all[12] = { &views.radiance, &views.emission, &views.direct, &views.indirect, &views.directDiffuse,
      &views.directSpecular, &views.indirectDiffuse, &views.indirectSpecular, &views.albedo, &views.albedoDiffuse,
      &views.albedoSpecular, &views.residual };
    for (int i = 0; i < 12; ++i)
    {
      images[i] = Image(E, 3, NaN);
      *all[i] = images[i];
    }
  }
};
float V(const quell::ImageOut& view)
{
  return view.at(1, 1)[1];
}
}

TEST(AovSplit, DemodulatedPasses)
{
  const Image dd(E, 3, 2.f), di(E, 3, 3.f), dc(E, 3, .5f), gd(E, 3, 4.f), gi(E, 3, 8.f), gc(E, 3, .25f), td(E, 3, 1.f),
    ti(E, 3, 2.f), tc(E, 3, .125f), vd(E, 3, .5f), vi(E, 3, .25f), em(E, 3, 7.f), env(E, 3, 1.f);
  const Image combined(E, 3, 1 + 1.5f + 1 + 2 + .125f + .25f + .5f + .25f + 8);
  quell::AovPasses p;
  p.combined = combined;
  p.direct[0] = dd, p.direct[1] = gd, p.direct[2] = td, p.direct[3] = vd;
  p.indirect[0] = di, p.indirect[1] = gi, p.indirect[2] = ti, p.indirect[3] = vi;
  p.color[0] = dc, p.color[1] = gc, p.color[2] = tc;
  p.emission = em, p.environment = env;
  Layers l;
  const auto check = quell::AovSplit(p, 1e-6f, l.views, E);
  EXPECT_EQ(V(l.views.radiance), combined.data[0]);
  EXPECT_EQ(V(l.views.emission), 8.f);
  EXPECT_EQ(V(l.views.directDiffuse), 1.f);
  EXPECT_EQ(V(l.views.indirectDiffuse), 1.5f);
  EXPECT_EQ(V(l.views.directSpecular), 1.625f);
  EXPECT_EQ(V(l.views.indirectSpecular), 2.5f);
  EXPECT_EQ(V(l.views.direct), 2.625f);
  EXPECT_EQ(V(l.views.indirect), 4.f);
  EXPECT_EQ(V(l.views.albedo), .875f);
  EXPECT_EQ(V(l.views.albedoDiffuse), .5f);
  EXPECT_EQ(V(l.views.albedoSpecular), .375f);
  EXPECT_EQ(V(l.views.residual), 0.f);
  EXPECT_EQ(check.Over, 0);
  EXPECT_EQ(check.Worst, 0);
  // The other convention takes the passes as they are: now the sum is wrong, and the residual says by how much.
  p.demodulated = false;
  const auto wrong = quell::AovSplit(p, 0.01f, l.views, E);
  EXPECT_EQ(V(l.views.directDiffuse), 2.f);
  EXPECT_EQ(wrong.Over, 9);
  EXPECT_NEAR(V(l.views.residual), combined.data[0] - (8 + 2 + 4 + 1 + .5 + 3 + 8 + 2 + .25), 1e-5);
  EXPECT_NEAR(wrong.Worst, std::fabs(V(l.views.residual)) / (combined.data[0] + 1e-3), 1e-6);
}

TEST(AovSplit, CombinedAlone)
{
  Image combined(E, 3, 2.5f), emission(E, 3, .5f), albedo(E, 3, .3f);
  quell::AovPasses p;
  p.combined = combined;
  Layers l;
  quell::AovCheck check = quell::AovSplit(p, 0, l.views, E);
  EXPECT_EQ(check.Over, 0);
  EXPECT_EQ(V(l.views.direct), 2.5f);
  EXPECT_EQ(V(l.views.directDiffuse), 2.5f);
  EXPECT_EQ(V(l.views.indirect), 0.f);
  EXPECT_EQ(V(l.views.albedo), 1.f);
  EXPECT_EQ(V(l.views.residual), 0.f);
  p.emission = emission;
  p.albedo = albedo;
  check = quell::AovSplit(p, 0, l.views, E);
  EXPECT_EQ(V(l.views.direct), 2.f);
  EXPECT_EQ(V(l.views.albedo), .3f);
  EXPECT_EQ(V(l.views.residual), 0.f);
}

TEST(AovSplit, NonFinitePassesAndBlackColours)
{
  Image combined(E, 3, 1.f), dd(E, 3, 2.f), dc(E, 3, .5f);
  dd.at(1, 1)[0] = NaN;
  combined.at(0, 2)[1] = Inf;
  dc.fill(2, 0, 0.f);
  quell::AovPasses p;
  p.combined = combined;
  p.direct[0] = dd;
  p.color[0] = dc;
  Layers l;
  const auto check = quell::AovSplit(p, 0.01f, l.views, E);
  EXPECT_EQ(check.NonFinite, 2);
  for (const Image& image : l.images)
    for (float v : image.data)
      ASSERT_TRUE(std::isfinite(v));
  EXPECT_EQ(l.views.direct.at(1, 1)[0], 1.f);
  EXPECT_EQ(l.views.residual.at(1, 1)[0], 0.f);
  EXPECT_EQ(l.views.residual.at(0, 2)[1], 0.f);
  EXPECT_EQ(l.views.albedo.at(2, 0)[0], 1.f); // background
  EXPECT_EQ(check.Over, 1);                   // light that has no colour there
  EXPECT_EQ(check.WorstX, 2);
  EXPECT_EQ(check.WorstY, 0);
}
