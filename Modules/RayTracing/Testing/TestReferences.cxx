// SPDX-License-Identifier: BSD-3-Clause
// Against other renderers' converged images, where they are at hand.
#include "quellScene.h"
#include "vtkQuellPathTraceSource.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

using namespace quell;

namespace
{
struct Image
{
  int Width = 0, Height = 0;
  std::vector<float> Pixels; ///< RGB, row 0 at the bottom
};

bool Read(const std::string& file, Image& image)
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

struct Comparison
{
  int Blocks = 0, Bad = 0;
  double MeanRatio[3] = {}, Worst = 0;
};

/// Means of 16 x 16 blocks; a block is bad when it is further off than 5 standard errors and `relative` of the
/// reference.
Comparison Compare(
  const std::shared_ptr<const Scene>& scene, const Image& reference, int spp, int bounces, double relative)
{
  vtkNew<vtkQuellPathTraceSource> s;
  s->SetScene(scene);
  s->SetWidth(reference.Width);
  s->SetHeight(reference.Height);
  s->SetSamplesPerPixel(spp);
  if (bounces >= 0)
    s->SetMaximumBounces(bounces);
  s->SetAlwaysMake({ "radiance", "variance" });
  s->Update();
  EXPECT_EQ(s->GetErrorText(), "");
  Comparison out;
  auto image = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray("radiance"));
  auto variance = vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray("variance"));
  const int n = 16;
  double sum[2][3] = {};
  for (int by = 0; by + n <= reference.Height; by += n)
    for (int bx = 0; bx + n <= reference.Width; bx += n)
    {
      double a = 0, r = 0, v = 0;
      for (int y = by; y < by + n; ++y)
        for (int x = bx; x < bx + n; ++x)
        {
          const int k = y * reference.Width + x;
          const double w[3] = { .2126, .7152, .0722 };
          for (int c = 0; c < 3; ++c)
          {
            a += w[c] * image->GetTypedComponent(k, c);
            r += w[c] * reference.Pixels[std::size_t(3 * k + c)];
            sum[0][c] += image->GetTypedComponent(k, c);
            sum[1][c] += reference.Pixels[std::size_t(3 * k + c)];
          }
          v += variance->GetValue(k);
        }
      a /= n * n;
      r /= n * n;
      // the reference has noise of its own
      const double sigma = std::sqrt(v * (1 + spp / 4096.)) / (n * n);
      ++out.Blocks;
      out.Worst = std::max(out.Worst, std::fabs(a - r) / std::max(1e-3, r));
      if (std::fabs(a - r) > 5 * sigma + relative * r + 1e-5)
        ++out.Bad;
    }
  for (int c = 0; c < 3; ++c)
    out.MeanRatio[c] = sum[0][c] / sum[1][c];
  return out;
}

void Room(const char* name, int spp, double relative, int allowed, double mean)
{
  const std::string folder = std::string(QUELL_SHARED_DATA) + "/cornell-reference/" + name;
  Image reference;
  if (!std::filesystem::exists(folder + "/scene.gltf") || !Read(folder + "/reference.exr", reference))
    GTEST_SKIP() << "no " << folder;
  const Comparison c = Compare(LoadScene(folder + "/scene.gltf"), reference, spp, 64, relative);
  EXPECT_LE(c.Bad, allowed) << "of " << c.Blocks << ", worst " << c.Worst;
  for (double r : c.MeanRatio)
    EXPECT_NEAR(r, 1, mean);
  testing::Test::RecordProperty("worst", std::to_string(c.Worst));
}

void Radiometric(const char* name, const char* image, int spp, double relative)
{
  const std::string folder = std::string(QUELL_SHARED_DATA) + "/radiometric-refs";
  const std::string file = folder + "/" + name + "/" + name + ".gltf";
  Image reference;
  if (!std::filesystem::exists(file) || !Read(folder + "/references/" + image, reference))
    GTEST_SKIP() << "no " << file;
  // the references' surfaces are pure Lambert
  auto scene = std::make_shared<Scene>(*LoadScene(file));
  for (Material& m : scene->Materials)
    m.Specular = 0;
  const Comparison c = Compare(scene, reference, spp, -1, relative);
  EXPECT_EQ(c.Bad, 0) << "of " << c.Blocks << ", worst " << c.Worst;
  for (double r : c.MeanRatio)
    EXPECT_NEAR(r, 1, .01);
}
}

TEST(References, DiffuseRoom)
{
  Room("diffuse", 24, .005, 0, .01);
}
// Cycles interpolates its metal's Fresnel differently: blocks on the metal box and in its light may differ by per cents
TEST(References, GlossyRoom)
{
  Room("glossy", 24, .02, 10, .015);
}
TEST(References, EmissivePlane)
{
  Radiometric("emissive-plane", "ref-emissive-plane-4096.exr", 4, .005);
}
TEST(References, PointLight)
{
  Radiometric("point", "ref-point-4096.exr", 4, .005);
}
TEST(References, PlaneUnderSky)
{
  Radiometric("plane-d6", "ref-plane-d6-4096.exr", 4, .005);
}
TEST(References, PlaneEmissionOnly)
{
  Radiometric("plane-d1", "ref-plane-d1-4096.exr", 4, .005);
}
TEST(References, CornellEmissionOnly)
{
  Radiometric("cbox-d1", "ref-cbox-d1-4096.exr", 4, .005);
}
