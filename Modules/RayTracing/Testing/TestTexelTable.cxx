// SPDX-License-Identifier: BSD-3-Clause
#include "quellTexelTable.h"

#include "gtest/gtest.h"

#include <cstring>
#include <limits>

using namespace quell;

namespace
{
Texture Random(int width, int height, unsigned seed, bool srgb)
{
  Texture t;
  t.Width = width;
  t.Height = height;
  t.SRGB = srgb;
  for (int i = 0; i < 4 * width * height; ++i)
  {
    seed = seed * 1664525u + 1013904223u;
    t.Bytes.push_back(std::uint8_t(seed >> 24));
  }
  return t;
}
}

// The bits of Texture::Sample for every way to wrap, sizes that are no multiples of a tile, and coordinates far
// outside.
TEST(TexelTable, ReadsWhatTheTexturesHold)
{
  const Vec2<int> sizes[] = { { 1, 1 }, { 2, 3 }, { 13, 7 }, { 64, 32 } };
  for (const Vec2<int>& size : sizes)
    for (int kind = 0; kind < 2 * 9 * 2; ++kind)
    {
      Texture color = Random(size.x, size.y, 1, kind % 2), metal = Random(size.x, size.y, 2, false),
              normal = Random(size.x, size.y, 3, false);
      for (Texture* t : { &color, &metal, &normal })
      {
        t->WrapS = Wrap(kind / 2 % 3);
        t->WrapT = Wrap(kind / 6 % 3);
        t->Nearest = kind >= 18;
      }
      ASSERT_TRUE(TexelTable::CanHold(&color, &metal, &normal));
      const TexelTable all(&color, &metal, &normal), one(&color, nullptr, nullptr), two(nullptr, &metal, nullptr);
      unsigned state = 7;
      const auto next = [&state](float scale)
      {
        state = state * 1664525u + 1013904223u;
        return (float(state >> 8) * 0x1p-24f - .5f) * scale;
      };
      for (int i = 0; i < 300; ++i)
      {
        const float scale = i < 100 ? 1.2f : i < 200 ? 9.f : 3e10f;
        float u = next(scale), v = next(scale);
        if (i == 0)
          u = std::numeric_limits<float>::quiet_NaN();
        if (i == 1)
          v = -std::numeric_limits<float>::infinity();
        if (i < 8 && i > 1)
          u = float(i - 5), v = float(i & 1);
        const Vec4f c = color.Sample(u, v), m = metal.Sample(u, v), n = normal.Sample(u, v);
        const float expected[8] = { c.x, c.y, c.z, m.y, m.z, n.x, n.y, n.z };
        float read[8];
        all.Read(all.Place(u, v), read);
        ASSERT_EQ(std::memcmp(read, expected, sizeof read), 0) << u << ' ' << v << " kind " << kind;
        one.Read(one.Place(u, v), read);
        ASSERT_EQ(std::memcmp(read, expected, 3 * sizeof *read), 0) << u << ' ' << v << " kind " << kind;
        two.Read(two.Place(u, v), read);
        ASSERT_EQ(std::memcmp(read + 3, expected + 3, 2 * sizeof *read), 0) << u << ' ' << v << " kind " << kind;
      }
    }
}

TEST(TexelTable, HoldsOnlyWhatItCan)
{
  const Texture a = Random(8, 8, 1, true), b = Random(8, 8, 2, false), c = Random(8, 4, 3, false);
  Texture clamped = b, floats = b, empty;
  clamped.WrapS = Wrap::Clamp;
  floats.Floats.assign(4 * 64, 0.5f);
  EXPECT_TRUE(TexelTable::CanHold(&a, &b, &b));
  EXPECT_TRUE(TexelTable::CanHold(nullptr, nullptr, &b));
  EXPECT_FALSE(TexelTable::CanHold(nullptr, nullptr, nullptr));
  EXPECT_FALSE(TexelTable::CanHold(&a, &c, nullptr)) << "of another size";
  EXPECT_FALSE(TexelTable::CanHold(&a, &clamped, nullptr)) << "wrapped otherwise";
  EXPECT_FALSE(TexelTable::CanHold(&b, &a, nullptr)) << "metalness in sRGB";
  EXPECT_FALSE(TexelTable::CanHold(&a, &a, nullptr)) << "metalness in sRGB";
  EXPECT_FALSE(TexelTable::CanHold(&floats, nullptr, nullptr));
  EXPECT_FALSE(TexelTable::CanHold(&empty, nullptr, nullptr));
  EXPECT_EQ(TexelTable(&a, nullptr, nullptr).Bytes(), 8u * 8 * 4);
  EXPECT_EQ(TexelTable(&a, &b, nullptr).Bytes(), 8u * 8 * 8);
}
