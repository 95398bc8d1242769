// SPDX-License-Identifier: BSD-3-Clause
#include "quellAovNames.h"

#include <gtest/gtest.h>

using namespace quell;

namespace
{
std::map<std::string, std::string> Mapped(const std::vector<FilePart>& parts, ChannelDialect dialect)
{
  std::map<std::string, std::string> out;
  for (const NamedChannels& a : NameArrays(parts, dialect))
  {
    EXPECT_EQ(out.count(a.Array), 0u) << a.Array << " appears twice";
    std::string text;
    for (int c : a.Channels)
      text += (text.empty() ? "" : " ") + parts[a.Part].Channels[c];
    out[a.Array] = text;
  }
  return out;
}
using Names = std::map<std::string, std::string>;
}

TEST(AovNames, EveryKnownArrayComesBackFromItsOwnChannels)
{
  std::set<std::string> all;
  FilePart part;
  for (const ArrayType& type : KnownArrays())
    for (const std::string& channel : ChannelNames(StandardLayer(type.Name), type.Kind, type.Components))
    {
      EXPECT_TRUE(all.insert(channel).second) << channel << " is used by two arrays";
      part.Channels.push_back(channel);
    }
  std::set<std::string> back;
  for (const NamedChannels& a : NameArrays({ part }, ChannelDialect::Quell))
  {
    const ArrayType* type = FindArray(a.Array);
    ASSERT_NE(type, nullptr) << a.Array;
    EXPECT_EQ(a.Kind, type->Kind) << a.Array;
    std::vector<std::string> channels;
    for (int c : a.Channels)
      channels.push_back(part.Channels[c]);
    EXPECT_EQ(channels, ChannelNames(StandardLayer(type->Name), type->Kind, type->Components)) << a.Array;
    back.insert(a.Array);
  }
  EXPECT_EQ(back.size(), KnownArrays().size());
}

TEST(AovNames, FieldNames)
{
  using V = std::vector<std::string>;
  EXPECT_EQ(ChannelNames(StandardLayer("radiance"), ArrayKind::Color, 3), (V{ "R", "G", "B" }));
  EXPECT_EQ(ChannelNames(StandardLayer("albedo"), ArrayKind::Albedo, 3), (V{ "albedo.R", "albedo.G", "albedo.B" }));
  EXPECT_EQ(ChannelNames(StandardLayer("normal"), ArrayKind::Normal, 3), (V{ "N.X", "N.Y", "N.Z" }));
  EXPECT_EQ(ChannelNames(StandardLayer("depth"), ArrayKind::Depth, 1), (V{ "Z" }));
  EXPECT_EQ(ChannelNames(StandardLayer("motion"), ArrayKind::Motion, 2), (V{ "motion.X", "motion.Y" }));
}

TEST(AovNames, BlenderPassesKeepTheirMeaning)
{
  FilePart part{ "", { "ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B", "ViewLayer.Combined.A",
                       "ViewLayer.Denoising Albedo.R", "ViewLayer.Denoising Albedo.G", "ViewLayer.Denoising Albedo.B",
                       "ViewLayer.Depth.Z", "ViewLayer.DiffDir.R", "ViewLayer.DiffDir.G", "ViewLayer.DiffDir.B",
                       "ViewLayer.IndexOB.X", "ViewLayer.Normal.X", "ViewLayer.Normal.Y", "ViewLayer.Normal.Z",
                       "ViewLayer.Denoising Normal.X", "ViewLayer.Denoising Normal.Y", "ViewLayer.Denoising Normal.Z",
                       "ViewLayer.Vector.X", "ViewLayer.Vector.Y", "ViewLayer.Vector.Z", "ViewLayer.Vector.W",
                       "ViewLayer.CryptoObject00.R", "ViewLayer.CryptoObject00.G", "ViewLayer.CryptoObject00.B" } };
  const Names m = Mapped({ part }, ChannelDialect::Blender);
  const Names expected{ { "radiance", "ViewLayer.Combined.R ViewLayer.Combined.G ViewLayer.Combined.B" },
    { "combined", "ViewLayer.Combined.R ViewLayer.Combined.G ViewLayer.Combined.B" },
    { "alpha", "ViewLayer.Combined.A" },
    { "albedo", "ViewLayer.Denoising Albedo.R ViewLayer.Denoising Albedo.G ViewLayer.Denoising Albedo.B" },
    { "depth", "ViewLayer.Depth.Z" },
    { "diffuseDirect", "ViewLayer.DiffDir.R ViewLayer.DiffDir.G ViewLayer.DiffDir.B" }, { "id", "ViewLayer.IndexOB.X" },
    { "normal", "ViewLayer.Normal.X ViewLayer.Normal.Y ViewLayer.Normal.Z" },
    { "denoisingNormal", "ViewLayer.Denoising Normal.X ViewLayer.Denoising Normal.Y ViewLayer.Denoising Normal.Z" },
    { "motion", "ViewLayer.Vector.X ViewLayer.Vector.Y" },
    { "CryptoObject00", "ViewLayer.CryptoObject00.R ViewLayer.CryptoObject00.G ViewLayer.CryptoObject00.B" } };
  EXPECT_EQ(m, expected);
}

TEST(AovNames, PbrtGbufferFilm)
{
  FilePart part{ "", { "R", "G", "B", "dzdx", "dzdy", "u", "Albedo.R", "Albedo.G", "Albedo.B", "N.X", "N.Y", "N.Z",
                       "Ns.X", "Ns.Y", "Ns.Z", "P.X", "P.Y", "P.Z", "Variance.R", "Variance.G", "Variance.B" } };
  Names m = Mapped({ part }, ChannelDialect::Pbrt);
  EXPECT_EQ(m["radiance"], "R G B");
  EXPECT_EQ(m["normal"], "Ns.X Ns.Y Ns.Z");
  EXPECT_EQ(m["normalGeometric"], "N.X N.Y N.Z");
  EXPECT_EQ(m["position"], "P.X P.Y P.Z");
  EXPECT_EQ(m["depth"], "P.Z");
  EXPECT_EQ(m["dzdx"], "dzdx");
  EXPECT_EQ(m["varianceColor"], "Variance.R Variance.G Variance.B");
  EXPECT_EQ(m.count("variance"), 0u) << "a variance of three channels is not the contract's";
}

TEST(AovNames, ArnoldMitsubaAndStrangers)
{
  FilePart part{ "", { "R", "G", "B", "A", "Z", "diffuse_direct.R", "diffuse_direct.G", "diffuse_direct.B", "depth.T",
                       "sh_normal.X", "sh_normal.Y", "sh_normal.Z", "motion.X", "motion.Y", "left.R", "left.G",
                       "left.B", "left.Z", "spectrum.450nm", "spectrum.550nm", "emission" } };
  Names m = Mapped({ part }, ChannelDialect::Other);
  EXPECT_EQ(m["directDiffuse"], "diffuse_direct.R diffuse_direct.G diffuse_direct.B");
  EXPECT_EQ(m["depth"], "Z");
  EXPECT_EQ(m["rayDistance"], "depth.T") << "a distance along the ray is no depth";
  EXPECT_EQ(m["normal"], "sh_normal.X sh_normal.Y sh_normal.Z");
  EXPECT_EQ(m.count("motion"), 0u) << "nobody knows a stranger's sign";
  EXPECT_EQ(m["left"], "left.R left.G left.B");
  EXPECT_EQ(m["left_Z"], "left.Z");
  EXPECT_EQ(m["_450nm"], "spectrum.450nm");
  EXPECT_EQ(m["emissionRaw"], "emission") << "one component is not the contract's emission";
}

TEST(AovNames, GreyAndPlainArray)
{
  const FilePart grey{ "", { "Y" } }, colour{ "", { "R", "G", "B" } };
  auto a = NameArrays({ grey }, ChannelDialect::Other);
  ASSERT_EQ(a.size(), 1u);
  EXPECT_EQ(a[0].Array, "radiance");
  EXPECT_EQ(a[0].Channels, (std::vector<int>{ 0, 0, 0 }));
  a = NameArrays({ colour }, ChannelDialect::Other, "depth");
  ASSERT_EQ(a.size(), 1u);
  EXPECT_EQ(a[0].Array, "depth");
  EXPECT_EQ(a[0].Kind, ArrayKind::Depth);
  EXPECT_EQ(a[0].Channels, (std::vector<int>{ 0 }));
}

TEST(AovNames, PartsArePrefixes)
{
  const std::vector<FilePart> parts{ { "rgba", { "R", "G", "B" } }, { "albedo", { "R", "G", "B" } },
    { "depth", { "Z" } }, { "beauty2", { "R", "G", "B" } } };
  Names m = Mapped(parts, ChannelDialect::Other);
  EXPECT_EQ(m.size(), 4u);
  EXPECT_EQ(m.count("radiance") + m.count("albedo") + m.count("depth") + m.count("beauty2"), 4u);
}
