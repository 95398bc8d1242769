// SPDX-License-Identifier: BSD-3-Clause
#include "TestPlanes.h"
#include "quellSnapNormals.h"

#include <gtest/gtest.h>

using namespace quelltest;

namespace
{
/// A floor (y up) that meets a wall (z towards the viewer) at column `edge`; the pixels of that column show a `part` of
/// the wall and are by depth, position and id on the floor or, `onWall`, on the wall.
struct Corner
{
  Image normal, depth, position, id;
  explicit Corner(float part, bool onWall, int edge = 7)
  {
    const quell::Rect e{ 0, 0, 15, 9 };
    normal = Image(e, 3), depth = Image(e, 1), position = Image(e, 3), id = Image(e, 1, 1);
    for (int y = 0; y < 9; ++y)
      for (int x = 0; x < 15; ++x)
      {
        const bool wall = x > edge || (x == edge && onWall);
        const float share = x == edge ? part : wall ? 1.f : 0.f;
        normal.at(x, y)[1] = 1 - share;
        normal.at(x, y)[2] = share;
        // The floor comes nearer to the left, the wall stays 5 away.
        *depth.at(x, y) = wall ? 5.f : 5.f - 0.1f * float(edge - x);
        position.at(x, y)[0] = 0.1f * float(y);
        position.at(x, y)[1] = wall ? 0.1f * float(x - edge) : 0.f;
        position.at(x, y)[2] = wall ? 0.f : 0.1f * float(edge - x);
      }
  }
  quell::SnapNormalsInputs inputs(bool withDepth = true, bool withPosition = true) const
  {
    quell::SnapNormalsInputs in;
    in.normal = normal;
    if (withDepth)
      in.depth = depth;
    if (withPosition)
      in.position = position;
    in.id = id;
    return in;
  }
};
Image Snapped(const quell::SnapNormalsInputs& in, std::int64_t* bad = nullptr)
{
  Image out(in.normal.extent, 3, NaN);
  const std::int64_t n = quell::SnapNormals(in, {}, out, in.normal.extent);
  if (bad)
    *bad = n;
  return out;
}
}

// In a crease depth and position fit both surfaces: the one that the pixel shows more of.
TEST(SnapNormals, ACreaseGoesToTheLargerPart)
{
  for (const bool positions : { false, true })
    for (const float part : { 0.3f, 0.7f })
    {
      const Corner corner(part, part > 0.5f);
      const Image out = Snapped(corner.inputs(true, positions));
      for (int y = 0; y < 9; ++y)
      {
        EXPECT_EQ(out.at(7, y)[1], part < 0.5f ? 1.f : 0.f) << part << " " << positions;
        EXPECT_EQ(out.at(7, y)[2], part > 0.5f ? 1.f : 0.f) << part << " " << positions;
        EXPECT_EQ(0, std::memcmp(out.at(3, y), corner.normal.at(3, y), 12)) << "others stay";
      }
    }
}

// At a silhouette depth decides, however much of the pixel the other surface takes; so does the id where depths agree.
TEST(SnapNormals, DepthAndIdSayWhoseItIs)
{
  for (const bool byId : { false, true })
    for (const bool near : { false, true })
    {
      Corner corner(0.8f, false);
      for (int y = 0; y < 9; ++y)
        for (int x = 0; x < 15; ++x)
        {
          const bool second = x > 7 || (x == 7 && !near);
          *corner.depth.at(x, y) = byId ? 3.f : second ? 5.f : 3.f;
          *corner.id.at(x, y) = byId && second ? 2.f : 1.f;
        }
      const Image out = Snapped(corner.inputs(true, false));
      EXPECT_EQ(out.at(7, 4)[1], near ? 1.f : 0.f) << byId;
      EXPECT_EQ(out.at(7, 4)[2], near ? 0.f : 1.f) << byId;
    }
}

// Against the background the mean is short but right; without neighbours it is made unit; lengths of 1 stay.
TEST(SnapNormals, SilhouettesAgainstNothingAndTheLonely)
{
  Image normal({ 0, 0, 5, 5 }, 3), depth({ 0, 0, 5, 5 }, 1, Inf);
  normal.at(2, 2)[0] = 0.3f, normal.at(2, 2)[2] = 0.4f;
  *depth.at(2, 2) = 2;
  normal.at(4, 4)[0] = 0.5f; // nothing hit: stays
  quell::SnapNormalsInputs in;
  in.normal = normal, in.depth = depth;
  Image out = Snapped(in);
  EXPECT_FLOAT_EQ(out.at(2, 2)[0], 0.6f);
  EXPECT_FLOAT_EQ(out.at(2, 2)[2], 0.8f);
  EXPECT_EQ(out.at(4, 4)[0], 0.5f);
  EXPECT_EQ(out.at(0, 0)[0], 0.f);
  // One pixel next to it is whole: its normal, to the last bit.
  normal.at(1, 2)[0] = 0.6f, normal.at(1, 2)[1] = 0.1f, normal.at(1, 2)[2] = 0.7937254f;
  *depth.at(1, 2) = 2.01f;
  out = Snapped(in);
  EXPECT_EQ(0, std::memcmp(out.at(1, 2), normal.at(1, 2), 12));
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(out.at(2, 2)[c], normal.at(1, 2)[c], 1e-6);
  in.depth = {}; // all that it needs is normals
  EXPECT_GT(Snapped(in).at(2, 2)[1], 0.05f);
}

TEST(SnapNormals, ExtremesAndTiles)
{
  Scene s(41, 37);
  Random u(4);
  for (int y = 0; y < 37; ++y)
    for (int x = 0; x < 41; ++x)
      if (u() < 0.3f)
        for (int c = 0; c < 3; ++c)
          s.normal.at(x, y)[c] *= u();
  s.normal.at(5, 5)[1] = NaN;
  s.normal.at(6, 5)[0] = 3e38f, s.normal.at(6, 5)[1] = -3e38f;
  s.normal.at(7, 7)[0] = 1e-42f, s.normal.at(7, 7)[1] = s.normal.at(7, 7)[2] = 0;
  *s.depth.at(9, 9) = 0;
  *s.depth.at(10, 9) = NaN;
  s.position.at(12, 12)[0] = Inf;
  for (const bool positions : { false, true })
  {
    quell::SnapNormalsInputs in;
    in.normal = s.normal, in.depth = s.depth, in.id = s.id;
    if (positions)
      in.position = s.position;
    std::int64_t bad = 0;
    const Image whole = Snapped(in, &bad);
    EXPECT_EQ(bad, 1);
    for (float v : whole.data)
      ASSERT_TRUE(std::isfinite(v));
    Image parts(s.normal.extent, 3, NaN);
    for (int y = 0; y < 37; y += 11)
      for (int x = 0; x < 41; x += 7)
        quell::SnapNormals(in, {}, parts, { x, y, std::min(41, x + 7), std::min(37, y + 11) });
    EXPECT_TRUE(parts == whole);
  }
}

// A source that makes its means unit tells by their variance which are means of unlike normals.
TEST(SnapNormals, VarianceTellsWhereNormalsAreUnit)
{
  Corner corner(0.3f, false);
  Image variance(corner.normal.extent, 3);
  for (int y = 0; y < 9; ++y)
  {
    float* const n = corner.normal.at(7, y);
    const float length = std::sqrt(n[1] * n[1] + n[2] * n[2]);
    n[1] /= length, n[2] /= length;
    variance.fill(7, y, y == 0 ? NaN : 0.02f);
  }
  quell::SnapNormalsInputs in = corner.inputs();
  EXPECT_TRUE(Snapped(in) == corner.normal) << "unit normals tell nothing";
  in.variance = variance;
  const Image out = Snapped(in);
  EXPECT_EQ(out.at(7, 0)[1], corner.normal.at(7, 0)[1]) << "not a number: not known to be mixed";
  for (int y = 3; y < 9; ++y) // beyond the reach of that one
    EXPECT_EQ(out.at(7, y)[1], 1.f) << y;
  quell::SnapNormalsParameters loose;
  loose.mixedVariance = 0.1;
  Image same(corner.normal.extent, 3);
  quell::SnapNormals(in, loose, same, same.extent);
  EXPECT_TRUE(same == corner.normal);
}
