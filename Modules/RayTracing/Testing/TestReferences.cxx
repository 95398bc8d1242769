// SPDX-License-Identifier: BSD-3-Clause
// Against other renderers' converged images, where they are at hand: t-test on the means of blocks (Statistics.h),
// alpha 1 %, Sidak, 99.75 % of the blocks. The noise of the references is in the differences, so it is accounted for
// without having to be known.
#include "RenderScene.h"
#include "quellScene.h"
#include "vtkQuellPathTraceSource.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>

using namespace quell;
using statistics::BlockTest;
using statistics::Picture;

namespace
{
struct Reference : Picture
{
  bool Half = false; ///< stored so
};

bool Read(const std::string& file, Reference& image)
{
  auto in = OIIO::ImageInput::open(file);
  if (!in)
    return false;
  const OIIO::ImageSpec spec = in->spec();
  std::vector<float> p(std::size_t(spec.width) * spec.height * spec.nchannels);
  if (!in->read_image(0, 0, 0, -1, OIIO::TypeDesc::FLOAT, p.data()))
    return false;
  image.Width = spec.width;
  image.Height = spec.height;
  image.Channels = 3;
  image.Half = spec.format == OIIO::TypeDesc::HALF;
  image.Pixels.resize(std::size_t(3) * spec.width * spec.height);
  int channel[3] = { 0, 1, 2 };
  for (int c = 0; c < 3; ++c)
    for (int k = 0; k < spec.nchannels; ++k)
      if (spec.channelnames[std::size_t(k)] == std::string(1, "RGB"[c]))
        channel[c] = k;
  for (int y = 0; y < spec.height; ++y)
    for (int x = 0; x < spec.width; ++x)
      for (int c = 0; c < 3; ++c)
        image.Pixels[std::size_t(3 * ((spec.height - 1 - y) * spec.width + x) + c)] =
          p[std::size_t((y * spec.width + x) * spec.nchannels + channel[c])];
  return true;
}

/// What the stage makes of the scene.
Picture Make(const std::shared_ptr<const Scene>& scene, int width, int height, int spp, int bounces,
  const char* array = "radiance")
{
  vtkNew<vtkQuellPathTraceSource> s;
  s->SetScene(scene);
  s->SetWidth(width);
  s->SetHeight(height);
  s->SetSamplesPerPixel(spp);
  s->SetMaximumBounces(bounces);
  s->SetAlwaysMake({ array });
  s->Update();
  EXPECT_EQ(s->GetErrorText(), "");
  Picture p;
  p.Width = width;
  p.Height = height;
  auto a = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray(array));
  if (a)
  {
    p.Channels = a->GetNumberOfComponents();
    p.Pixels.assign(a->GetPointer(0), a->GetPointer(0) + a->GetNumberOfValues());
  }
  return p;
}

void Report(const char* what, int spp, const BlockTest& t)
{
  std::printf("  %s, %d spp: %s\n", what, spp, t.Text().c_str());
}

/// Samples of the short and of the long test.
int Samples(int few, int many)
{
  return trust::LongTests() ? many : few;
}

/// For the means of three channels: a false alarm in a thousand.
double WholeThreshold()
{
  return statistics::NormalThreshold(statistics::SidakLevel(.001, 3));
}

void Radiometric(const char* name, const char* image, int few, int many, double spectral = 2e-4)
{
  const std::string folder = std::string(QUELL_SHARED_DATA) + "/radiometric-refs";
  const std::string file = folder + "/" + name + "/" + name + ".gltf";
  Reference reference;
  if (!std::filesystem::exists(file) || !Read(folder + "/references/" + image, reference))
    GTEST_SKIP() << "no " << file;
  // the references' surfaces are pure Lambert
  auto scene = std::make_shared<Scene>(*LoadScene(file));
  for (Material& m : scene->Materials)
    m.Specular = 0;
  const int spp = Samples(few, many);
  // the file's max_depth N is MaximumBounces N - 1
  const BlockTest t = statistics::BySpread(
    Make(scene, reference.Width, reference.Height, spp, scene->MaximumDepth - 1), reference, 8, .01, reference.Half);
  Report(name, spp, t);
  EXPECT_TRUE(t.Agrees()) << t.Text();
  // All blocks together. These references were rendered in spectra, whose sums are not exactly the RGB that they stand
  // for: their skies of radiance 1 have means of .99989, .99987, .99990 (and noise), their lamp of 10.9873
  // reads 10.978.
  EXPECT_LT(std::fabs(t.WholeRatio - 1), WholeThreshold() * t.WholeError + spectral) << t.Text();
}

struct RoomData
{
  std::shared_ptr<const Scene> World;
  Reference Image;
};
bool Room(const char* name, RoomData& room)
{
  const std::string folder = std::string(QUELL_SHARED_DATA) + "/cornell-reference/" + name;
  if (!std::filesystem::exists(folder + "/scene.gltf") || !Read(folder + "/reference.exr", room.Image))
    return false;
  room.World = LoadScene(folder + "/scene.gltf");
  return true;
}
}

TEST(References, DiffuseRoom)
{
  RoomData room;
  if (!Room("diffuse", room))
    GTEST_SKIP();
  const int spp = Samples(24, 1024);
  const BlockTest t = statistics::BySpread(Make(room.World, room.Image.Width, room.Image.Height, spp, 64), room.Image);
  Report("diffuse room", spp, t);
  EXPECT_TRUE(t.Agrees()) << t.Text();
  // .03 % brighter as a whole, by the back wall (.13 %): see Documentation/trust.md
  EXPECT_LT(std::fabs(t.WholeRatio - 1), WholeThreshold() * t.WholeError + 5e-4) << t.Text();
}
// The metal of this reference scatters once (GGX without energy compensation): so does ours here, and the whole room
// must agree.
TEST(References, GlossyRoom)
{
  RoomData room;
  if (!Room("glossy", room))
    GTEST_SKIP();
  auto once = std::make_shared<Scene>(*room.World);
  for (Material& m : once->Materials)
    m.MultipleScattering = false;
  const int spp = Samples(24, 1024);
  const BlockTest t = statistics::BySpread(Make(once, room.Image.Width, room.Image.Height, spp, 64), room.Image);
  Report("glossy room, one scattering", spp, t);
  // The metal throws light at the walls that few paths find: with few samples more blocks are darker than their
  // standard error admits, because it has not seen that light either.
  EXPECT_TRUE(t.Agrees(trust::LongTests() ? .9975 : .99)) << t.Text();
  EXPECT_LT(std::fabs(t.WholeRatio - 1), WholeThreshold() * t.WholeError + 5e-4) << t.Text();
}

// With energy compensation, the default, the metal may be brighter by what single scattering loses, and nothing darker.
TEST(References, GlossyRoomWithCompensation)
{
  RoomData room;
  if (!Room("glossy", room))
    GTEST_SKIP();
  const int spp = Samples(24, 1024), width = room.Image.Width, height = room.Image.Height;
  const Picture ours = Make(room.World, width, height, spp, 64), ids = Make(room.World, width, height, 1, 0, "id");
  int metal = 0;
  for (const Instance& i : room.World->Instances)
    if (room.World->Materials[std::size_t(room.World->Meshes[std::size_t(i.Mesh)].Material)].Metallic > 0)
      metal = i.Id;
  ASSERT_GT(metal, 0);
  double sum[2][3] = {}, off[2][3] = {}, square[2][3] = {}; // elsewhere, on the metal
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
    {
      const int part = int(ids.At(x, y, 0)) == metal;
      for (int c = 0; c < 3; ++c)
      {
        const double r = room.Image.At(x, y, c), d = ours.At(x, y, c) - r;
        sum[part][c] += r;
        off[part][c] += d;
        square[part][c] += d * d;
      }
    }
  for (int c = 0; c < 3; ++c)
  {
    const double elsewhere = off[0][c] / sum[0][c], error = std::sqrt(square[0][c]) / sum[0][c];
    const double onMetal = off[1][c] / sum[1][c], metalError = std::sqrt(square[1][c]) / sum[1][c];
    std::printf("  channel %d: elsewhere %.5f +- %.5f, on the metal %.4f +- %.4f\n", c, 1 + elsewhere, error,
      1 + onMetal, metalError);
    EXPECT_GT(elsewhere, -WholeThreshold() * error);
    EXPECT_LT(elsewhere, WholeThreshold() * error + .01);
    EXPECT_GT(onMetal, -WholeThreshold() * metalError);
    EXPECT_LT(onMetal, WholeThreshold() * metalError + .08);
  }
}

TEST(References, EmissivePlane)
{
  Radiometric("emissive-plane", "ref-emissive-plane-4096.exr", 16, 1024);
}
TEST(References, PointLight)
{
  Radiometric("point", "ref-point-4096.exr", 16, 1024);
}
TEST(References, PlaneUnderSky)
{
  Radiometric("plane-d6", "ref-plane-d6-4096.exr", 16, 1024);
}
TEST(References, PlaneEmissionOnly)
{
  Radiometric("plane-d1", "ref-plane-d1-4096.exr", 16, 1024);
}
TEST(References, CornellEmissionOnly)
{
  Radiometric("cbox-d1", "ref-cbox-d1-4096.exr", 16, 1024, 3e-3);
}
