// SPDX-License-Identifier: BSD-3-Clause
// Passes, refinement, work that is finished early and goes on elsewhere; memory; extremes of size and depth.
#include "SourceTesting.h"
#include "quellCancelToken.h"
#include "quellFilm.h"
#include "quellFrameFacts.h"
#include "vtkCallbackCommand.h"
#include "vtkFieldData.h"
#include "vtkInformation.h"
#include "vtkQuellArraySetKey.h"
#include "vtkSMPTools.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>

using namespace quell;
using namespace sourcetesting;

namespace
{
const ArraySet Many = { "radiance", "emission", "direct", "indirect", "directDiffuse", "directSpecular",
  "indirectDiffuse", "indirectSpecular", "albedo", "albedoDiffuse", "albedoSpecular", "normal", "roughness", "depth",
  "position", "normalGeometric", "motion", "id", "material", "hitDistance", "variance", "varianceAlbedo",
  "varianceNormal", "moments", "halfA", "halfB", "samples", "alpha", "bounce1", "bounce2", "bounce3", "bounce4" };

FrameFacts Facts(vtkQuellPathTraceSource* s)
{
  return FrameFacts::Read(s->GetOutput()->GetFieldData());
}

/// Calls `body` with the progress of every report, on the thread that updates.
struct ProgressObserver
{
  std::function<void(double)> Body;
  vtkNew<vtkCallbackCommand> Command;
  ProgressObserver(vtkQuellPathTraceSource* s, std::function<void(double)> body)
    : Body(std::move(body))
  {
    this->Command->SetClientData(this);
    this->Command->SetCallback([](vtkObject*, unsigned long, void* self, void* data)
      { static_cast<ProgressObserver*>(self)->Body(*static_cast<double*>(data)); });
    s->AddObserver(vtkCommand::ProgressEvent, this->Command);
  }
};

bool Warned(vtkQuellPathTraceSource* s, const char* text)
{
  for (const std::string& warning : s->GetWarnings())
    if (warning.find(text) != std::string::npos)
      return true;
  return false;
}

/// Renders all of `names`, and finishes after the pass in which `samples` were reached.
void FinishAt(vtkQuellPathTraceSource* s, const ArraySet& names, int samples)
{
  auto token = std::make_shared<CancelToken>();
  s->SetCancelToken(token);
  ProgressObserver watch(s,
    [&](double)
    {
      if (s->GetSamplingStatus().Samples >= samples)
        token->Finish();
    });
  EXPECT_TRUE(Ask(s, names)) << s->GetErrorText();
  s->RemoveObserver(watch.Command);
  token->Reset();
}
}

TEST(PathTraceLayers, SplitsSumToTheirLayers)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 40, 32, 8);
  ASSERT_TRUE(Ask(s, Many)) << s->GetErrorText();
  std::map<std::string, std::vector<float>> a;
  for (const std::string& name : Many)
  {
    a[name] = Copy(s, name);
    ASSERT_FALSE(a[name].empty()) << name;
  }
  const auto sum = [&](std::vector<const char*> parts, const char* whole)
  {
    double all = 0;
    for (std::size_t i = 0; i < a[whole].size(); ++i)
    {
      double v = 0;
      for (const char* part : parts)
      {
        EXPECT_GE(a[part][i], 0);
        v += a[part][i];
      }
      all += v;
      ASSERT_NEAR(v, a[whole][i], 1e-6 * (1 + a[whole][i])) << whole << ' ' << i;
    }
    EXPECT_GT(all, 1) << whole;
  };
  sum({ "directDiffuse", "directSpecular" }, "direct");
  sum({ "indirectDiffuse", "indirectSpecular" }, "indirect");
  sum({ "bounce1" }, "direct");
  sum({ "bounce2", "bounce3", "bounce4" }, "indirect");
  sum({ "emission", "bounce1", "bounce2", "bounce3", "bounce4" }, "radiance");
  sum({ "albedoDiffuse", "albedoSpecular" }, "albedo");
  for (const char* part : { "directDiffuse", "directSpecular", "indirectDiffuse", "indirectSpecular", "bounce3" })
  {
    double all = 0;
    for (float v : a[part])
      all += v;
    EXPECT_GT(all, 1) << part;
  }
  // moments are the samples' own: mean luminance of radiance, and what variance says of the mean
  for (std::size_t p = 0; p < a["variance"].size(); ++p)
  {
    const float* c = &a["radiance"][3 * p];
    ASSERT_NEAR(a["moments"][2 * p], .2126 * c[0] + .7152 * c[1] + .0722 * c[2], 1e-5 * (1 + c[1]));
    ASSERT_NEAR(a["variance"][p], a["moments"][2 * p + 1] / 7, 1e-6 * (1e-6 + a["variance"][p]));
  }
}

TEST(PathTraceLayers, BouncesAreListedAndMadeOnDemand)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room());
  EXPECT_EQ(s->ListDynamicOutputs().size(), 4u);
  EXPECT_EQ(s->ListDynamicOutputs()[3].Name, "bounce4");
  s->SetMaximumBounces(1000);
  EXPECT_EQ(s->ListDynamicOutputs().size(), 64u);
  s->SetMaximumBounces(0);
  EXPECT_TRUE(s->ListDynamicOutputs().empty());
  s->SetMaximumBounces(4);
  // the first bounce costs what direct light costs, the others the whole paths
  const auto rays = [](const char* name)
  {
    vtkNew<vtkQuellPathTraceSource> one;
    Configure(one, Room());
    EXPECT_TRUE(Ask(one, { name }));
    EXPECT_EQ(one->GetOutput()->GetPointData()->GetNumberOfArrays(), 1);
    return one->GetCounters().Rays;
  };
  EXPECT_EQ(rays("bounce1"), rays("direct"));
  EXPECT_EQ(rays("bounce2"), rays("indirect"));
  EXPECT_EQ(rays("bounce3"), rays("indirect"));
  EXPECT_EQ(rays("directDiffuse"), rays("direct"));
  EXPECT_EQ(rays("varianceAlbedo"), rays("albedo"));
  vtkObject::GlobalWarningDisplayOff();
  EXPECT_FALSE(Ask(s, { "bounce5" }));
  EXPECT_NE(s->GetErrorText().find("no array \"bounce5\""), std::string::npos) << s->GetErrorText();
  vtkObject::GlobalWarningDisplayOn();
}

TEST(PathTraceMemory, RadianceAloneStaysBelow64BytesPerPixel)
{
  const auto held = [](bool watched, std::size_t film)
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Room(), 64, 48, 20);
    s->SetWatched(watched);
    s->SetFilmMemory(film);
    EXPECT_TRUE(Ask(s, { "radiance" }));
    return double(s->GetCounters().Held) / (64 * 48);
  };
  EXPECT_EQ(held(false, 1 << 28), 36) << "the sums and the picture";
  EXPECT_EQ(held(false, 0), 24) << "the picture and a copy";
  EXPECT_LT(held(true, 1 << 28), 64) << "with noise";
  EXPECT_GT(held(true, 1 << 28), held(false, 1 << 28));
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 64, 48);
  ASSERT_TRUE(Ask(s, { "depth" }));
  EXPECT_EQ(double(s->GetCounters().Held) / (64 * 48), 20);
}

TEST(PathTraceRefinement, MoreSamplesContinueTheSequence)
{
  vtkNew<vtkQuellPathTraceSource> whole, steps;
  Configure(whole, Room(), 40, 32, 24);
  Configure(steps, Room(), 40, 32, 3);
  ASSERT_TRUE(Ask(whole, Many));
  const auto all = whole->GetCounters().Paths;
  EXPECT_EQ(all, 40 * 32 * 24);
  ASSERT_TRUE(Ask(steps, Many));
  for (int spp : { 4, 11, 24 })
  {
    steps->SetSamplesPerPixel(spp);
    ASSERT_TRUE(Ask(steps, Many));
    EXPECT_EQ(Facts(steps).SamplesPerPixel, spp);
    EXPECT_EQ(steps->GetCounters().Paths, 40 * 32 * spp) << "only what is missing";
  }
  for (const std::string& name : Many)
    EXPECT_EQ(Copy(whole, name), Copy(steps, name)) << name;
  // fewer again cannot be taken out of the sums
  steps->SetSamplesPerPixel(8);
  ASSERT_TRUE(Ask(steps, { "radiance" }));
  vtkNew<vtkQuellPathTraceSource> eight;
  Configure(eight, Room(), 40, 32, 8);
  ASSERT_TRUE(Ask(eight, { "radiance" }));
  EXPECT_EQ(Copy(eight, "radiance"), Copy(steps, "radiance"));
}

TEST(PathTraceRefinement, OtherSequencesAreTracedAnew)
{
  // Sample s of tick 1 is number spp + s: another spp, another sequence.
  const auto render = [](vtkQuellPathTraceSource* s, int spp, int first)
  {
    s->SetSamplesPerPixel(spp);
    s->SetFirstSample(first);
    EXPECT_TRUE(Ask(s, { "radiance" }, 1));
    return Copy(s, "radiance");
  };
  vtkNew<vtkQuellPathTraceSource> kept, one, two;
  for (vtkQuellPathTraceSource* s : { kept.Get(), one.Get(), two.Get() })
  {
    Configure(s, Room());
    s->SetTimeline({ 0, 4, 24 });
  }
  render(kept, 8, 0);
  const auto before = kept->GetCounters().Paths;
  EXPECT_EQ(render(kept, 12, 0), render(one, 12, 0));
  EXPECT_EQ(kept->GetCounters().Paths - before, 40 * 32 * 12);
  // 4 + 12 = 12 + 4: this one is the same sequence
  render(kept, 4, 12);
  const auto paths = kept->GetCounters().Paths;
  EXPECT_EQ(render(kept, 12, 4), render(two, 12, 4));
  EXPECT_EQ(kept->GetCounters().Paths - paths, 40 * 32 * 8);
}

TEST(PathTraceRefinement, LightsParametersLeaveThePrimaryHit)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room());
  const ArraySet names{ "radiance", "depth", "id", "normal" };
  ASSERT_TRUE(Ask(s, names));
  const auto depth = Copy(s, "depth");
  s->SetMaximumBounces(2);
  auto rays = s->GetCounters().Rays;
  ASSERT_TRUE(Ask(s, { "depth", "id" }));
  EXPECT_EQ(s->GetCounters().Rays, rays);
  EXPECT_EQ(Copy(s, "depth"), depth);
  ASSERT_TRUE(Ask(s, names));
  EXPECT_GT(s->GetCounters().Rays, rays);
  vtkNew<vtkQuellPathTraceSource> fresh;
  Configure(fresh, Room());
  fresh->SetMaximumBounces(2);
  ASSERT_TRUE(Ask(fresh, names));
  for (const std::string& name : names)
    EXPECT_EQ(Copy(s, name), Copy(fresh, name)) << name;
  // the seed moves every ray
  s->SetSeed(9);
  rays = s->GetCounters().Rays;
  ASSERT_TRUE(Ask(s, { "depth" }));
  EXPECT_EQ(s->GetCounters().Rays - rays, 40 * 32 * 2);
}

TEST(PathTraceRefinement, SmallerRegionsAndMoreArraysComeOutOfTheFilm)
{
  for (std::size_t film : { std::size_t(0), std::size_t(1) << 28 })
  {
    vtkNew<vtkQuellPathTraceSource> s, part;
    Configure(s, Room());
    Configure(part, Room());
    s->SetFilmMemory(film);
    ASSERT_TRUE(Ask(s, { "radiance" }));
    const auto rays = s->GetCounters().Rays;
    s->Modified(); // else there is nothing to execute
    ASSERT_TRUE(Ask(s, { "radiance" }, 0, { 3, 4, 20, 18 }));
    EXPECT_EQ(s->GetCounters().Rays, rays);
    ASSERT_TRUE(Ask(part, { "radiance" }, 0, { 3, 4, 20, 18 }));
    EXPECT_EQ(Copy(s, "radiance"), Copy(part, "radiance"));
    // and back: the whole frame is still there
    ASSERT_TRUE(Ask(s, { "radiance", "depth" }));
    EXPECT_EQ(s->GetCounters().Rays, rays + 40 * 32 * 2);
  }
}

TEST(PathTraceFinish, EveryPixelHasTheSameSamplesAndTheRestFollows)
{
  vtkNew<vtkQuellPathTraceSource> s, whole;
  Configure(s, Room(), 40, 32, 4096);
  FinishAt(s, Many, 5);
  const FrameFacts facts = Facts(s);
  ASSERT_GE(facts.SamplesPerPixel, 5);
  ASSERT_LT(facts.SamplesPerPixel, 4096);
  EXPECT_EQ(facts.Partial, std::to_string(facts.SamplesPerPixel) + " of 4096 samples");
  for (float v : Copy(s, "samples"))
    ASSERT_EQ(v, facts.SamplesPerPixel);
  EXPECT_EQ(s->GetCounters().Paths, std::int64_t(40) * 32 * facts.SamplesPerPixel);
  // it is the picture of that many samples ...
  Configure(whole, Room(), 40, 32, facts.SamplesPerPixel);
  ASSERT_TRUE(Ask(whole, Many));
  EXPECT_EQ(Facts(whole).Partial, "");
  for (const std::string& name : Many)
    EXPECT_EQ(Copy(s, name), Copy(whole, name)) << name;
  // ... and goes on from there
  const int target = facts.SamplesPerPixel + 7;
  s->SetSamplesPerPixel(target);
  whole->SetSamplesPerPixel(target);
  ASSERT_TRUE(Ask(s, Many));
  ASSERT_TRUE(Ask(whole, Many));
  EXPECT_EQ(s->GetCounters().Paths, std::int64_t(40) * 32 * target);
  EXPECT_EQ(Facts(s).Partial, "");
  for (const std::string& name : Many)
    EXPECT_EQ(Copy(s, name), Copy(whole, name)) << name;
}

TEST(PathTraceFinish, TheNextUpdateGoesOnByItself)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 16, 16, 300);
  FinishAt(s, { "radiance" }, 2);
  ASSERT_FALSE(Facts(s).Partial.empty());
  EXPECT_EQ(s->GetCounters().Executions, 1);
  ASSERT_TRUE(Ask(s, { "radiance" }));
  EXPECT_TRUE(Facts(s).Partial.empty());
  EXPECT_EQ(s->GetCounters().Executions, 2);
  EXPECT_EQ(s->GetCounters().Paths, 16 * 16 * 300);
  ASSERT_TRUE(Ask(s, { "radiance" }));
  EXPECT_EQ(s->GetCounters().Executions, 2) << "a whole frame is asked for once";
}

TEST(PathTraceFinish, BeforeTheFirstPassThereIsOneSample)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 16, 16, 64);
  auto token = std::make_shared<CancelToken>();
  token->Finish();
  s->SetCancelToken(token);
  ASSERT_TRUE(Ask(s, { "radiance", "samples" }));
  EXPECT_EQ(Facts(s).Partial, "1 of 64 samples");
  // Cancel throws the frame away
  token->Cancel();
  s->SetSeed(3);
  vtkObject::GlobalWarningDisplayOff();
  EXPECT_FALSE(Ask(s, { "radiance" }));
  vtkObject::GlobalWarningDisplayOn();
  EXPECT_EQ(s->GetErrorText(), "cancelled");
}

TEST(PathTraceFinish, SavedWorkGoesOnInAnotherObject)
{
  vtkNew<vtkQuellPathTraceSource> first, second, whole;
  const ArraySet names{ "radiance", "albedo", "variance", "bounce2" };
  Configure(first, Room(), 24, 20, 2000);
  EXPECT_EQ(first->SaveWork(), "");
  FinishAt(first, names, 9);
  const int had = Facts(first).SamplesPerPixel;
  const std::string bytes = first->SaveWork();
  ASSERT_GT(bytes.size(), 24u * 20u * 24u);

  Configure(second, Room(), 24, 20, had + 5);
  std::string error;
  ASSERT_TRUE(second->LoadWork(bytes, error)) << error;
  ASSERT_TRUE(Ask(second, names));
  EXPECT_FALSE(Warned(second, "traced anew"));
  EXPECT_EQ(second->GetCounters().Paths, 24 * 20 * 5);
  Configure(whole, Room(), 24, 20, had + 5);
  ASSERT_TRUE(Ask(whole, names));
  for (const std::string& name : names)
    EXPECT_EQ(Copy(second, name), Copy(whole, name)) << name;
  EXPECT_EQ(second->SaveWork(), "") << "complete";

  // of something else: left aside, and said
  vtkNew<vtkQuellPathTraceSource> other;
  Configure(other, Room(), 24, 20, had + 5);
  other->SetSeed(4);
  ASSERT_TRUE(other->LoadWork(bytes, error));
  ASSERT_TRUE(Ask(other, names));
  EXPECT_TRUE(Warned(other, "traced anew"));
  EXPECT_EQ(other->GetCounters().Paths, 24 * 20 * (had + 5));
  // damaged at any place: refused or left aside, never read beyond
  for (std::size_t length : { std::size_t(0), std::size_t(3), std::size_t(40), bytes.size() - 1 })
    EXPECT_FALSE(other->LoadWork(bytes.substr(0, length), error)) << length;
  EXPECT_FALSE(other->LoadWork(bytes + "x", error));
}

TEST(PathTraceFinish, NoiseFallsWithTheSamples)
{
  // Reported only to those who look, and true: the median of sqrt(variance) / mean.
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room(), 40, 32, 256);
  ASSERT_TRUE(Ask(s, { "radiance" }));
  EXPECT_LT(s->GetSamplingStatus().Noise, 0);
  s->SetWatched(true);
  s->SetSeed(1);
  double last = -1, progress = 0;
  bool rises = true;
  ProgressObserver watch(s,
    [&](double p)
    {
      rises = rises && p >= progress - 1e-12;
      progress = p;
    });
  ASSERT_TRUE(Ask(s, { "radiance" }));
  s->RemoveObserver(watch.Command);
  EXPECT_TRUE(rises) << "progress never steps back";
  last = s->GetSamplingStatus().Noise;
  EXPECT_EQ(s->GetSamplingStatus().Samples, 256);
  EXPECT_GT(s->GetSamplingStatus().SamplesPerSecond, 0);
  vtkNew<vtkQuellPathTraceSource> check;
  Configure(check, Room(), 40, 32, 256);
  check->SetSeed(1);
  ASSERT_TRUE(Ask(check, { "variance", "moments" }));
  std::vector<double> ratios;
  for (vtkIdType p = 0; p < 40 * 32; ++p)
    if (Array(check, "variance")->GetValue(p) > 0)
      ratios.push_back(
        std::sqrt(double(Array(check, "variance")->GetValue(p))) / Array(check, "moments")->GetComponent(p, 0));
  std::nth_element(ratios.begin(), ratios.begin() + std::ptrdiff_t(ratios.size() / 2), ratios.end());
  EXPECT_NEAR(last / ratios[ratios.size() / 2], 1, 1e-4);
}

TEST(PathTraceScene, TheFactsNameWhatLightsTheScene)
{
  const std::string file = testing::TempDir() + "/quell-sky.ppm";
  const auto write = [&](char value)
  {
    std::ofstream stream(file, std::ios::binary);
    stream << "P6\n4 2\n255\n";
    for (int i = 0; i < 24; ++i)
      stream.put(value);
  };
  write('\x40');
  vtkNew<vtkQuellPathTraceSource> s;
  auto room = Room();
  Configure(s, room, 8, 8, 1);
  ASSERT_TRUE(Ask(s, { "radiance" }));
  EXPECT_EQ(Facts(s).Scene, room->Hash);
  s->SetEnvironment(file);
  ASSERT_TRUE(Ask(s, { "radiance" })) << s->GetErrorText();
  const std::string lit = Facts(s).Scene;
  EXPECT_NE(lit, room->Hash);
  vtkNew<vtkQuellPathTraceSource> other;
  write('\x41');
  Configure(other, room, 8, 8, 1);
  other->SetEnvironment(file);
  ASSERT_TRUE(Ask(other, { "radiance" }));
  EXPECT_NE(Facts(other).Scene, lit) << "another picture under the same name";
  std::remove(file.c_str());

  auto dark = Room();
  dark->Sky = Environment();
  vtkNew<vtkQuellPathTraceSource> studio;
  Configure(studio, dark, 8, 8, 1);
  ASSERT_TRUE(Ask(studio, { "radiance" }));
  EXPECT_EQ(Facts(studio).Scene, dark->Hash) << "it has a lamp";
  studio->SetDefaultSky(vtkQuellPathTraceSource::Always);
  ASSERT_TRUE(Ask(studio, { "radiance" }));
  EXPECT_NE(Facts(studio).Scene, dark->Hash);
}

TEST(PathTraceScene, ExplainSaysWhatIsNotTraced)
{
  vtkNew<vtkQuellPathTraceSource> s;
  Configure(s, Room());
  s->UpdateInformation();
  const auto explain = [&](const ArraySet& asked)
  {
    vtkQuellStage::REQUESTED_ARRAYS()->Write(s->GetOutputInformation(0), asked);
    std::string text;
    for (const std::string& line : s->Explain())
      text += line + "\n";
    vtkQuellStage::REQUESTED_ARRAYS()->Write(s->GetOutputInformation(0), {});
    return text;
  };
  EXPECT_NE(explain({ "depth", "id" }).find("no scattering is traced"), std::string::npos);
  for (const char* word : { "variant", "scatterings", "lamps", "textures" })
    EXPECT_EQ(explain({ "depth", "id" }).find(word), std::string::npos) << "the primary hit knows nothing of " << word;
  EXPECT_NE(explain({ "radiance" }).find("picked by power (LightSelection Auto)"), std::string::npos);
  s->SetLightSelection(2);
  EXPECT_NE(explain({ "radiance" }).find("picked by the light tree"), std::string::npos);
  s->SetLightSelection(0);
  s->SetPixelFilter(vtkQuellPathTraceSource::Tent);
  s->SetSamplePattern(1);
  EXPECT_NE(explain({ "depth" }).find("pixel filter Tent of radius 1 pixels"), std::string::npos);
  EXPECT_NE(explain({ "depth" }).find("points of the paths: BlueNoise"), std::string::npos);
  EXPECT_NE(explain({ "albedo" }).find("no light is asked for"), std::string::npos);
  EXPECT_NE(explain({ "direct" }).find("no indirect light is asked for"), std::string::npos);
  EXPECT_NE(explain({ "bounce1" }).find("no indirect light is asked for"), std::string::npos);
  for (const ArraySet& all : { ArraySet{ "radiance" }, ArraySet{ vtkQuellStage::PrimaryArray() } })
  {
    EXPECT_EQ(explain(all).find("is asked for"), std::string::npos) << explain(all);
    EXPECT_NE(explain(all).find("no textures"), std::string::npos);
    EXPECT_NE(explain(all).find("integrator variant \"opaque\""), std::string::npos) << explain(all);
  }
}

TEST(PathTraceScene, GuideSamplesMakeTheGuidesAlone)
{
  vtkNew<vtkQuellPathTraceSource> s, plain;
  Configure(s, Room(), 40, 32, 1);
  Configure(plain, Room(), 40, 32, 1);
  s->SetGuideSamples(64);
  const ArraySet names{ "radiance", "normal", "varianceNormal", "depth" };
  ASSERT_TRUE(Ask(s, names));
  ASSERT_TRUE(Ask(plain, names));
  EXPECT_EQ(Copy(s, "radiance"), Copy(plain, "radiance")) << "the light has its own numbers";
  EXPECT_EQ(Copy(s, "depth"), Copy(plain, "depth"));
  EXPECT_NE(Copy(s, "normal"), Copy(plain, "normal"));
  double noisy = 0;
  for (float v : Copy(s, "varianceNormal"))
    noisy += v > 0;
  EXPECT_GT(noisy, 20) << "edges";
  for (float v : Copy(plain, "varianceNormal"))
    ASSERT_EQ(v, 0) << "one sample has no spread";
  // more light samples leave them
  const auto normal = Copy(s, "normal");
  s->SetSamplesPerPixel(3);
  ASSERT_TRUE(Ask(s, names));
  EXPECT_EQ(Copy(s, "normal"), normal);
}

TEST(PathTraceExtremes, SizesAndDepths)
{
  const auto finite = [](vtkQuellPathTraceSource* s, const char* what)
  {
    for (const char* name : { "radiance", "albedo", "normal", "variance" })
      for (float v : Copy(s, name))
        ASSERT_TRUE(std::isfinite(v)) << what << ' ' << name;
  };
  const ArraySet names{ "radiance", "albedo", "normal", "variance" };
  for (const auto& size : { std::pair<int, int>(32768, 1), { 1, 32768 }, { 1, 1 }, { 32768, 2 } })
  {
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, Room(), size.first, size.second, 1);
    ASSERT_TRUE(Ask(s, names)) << s->GetErrorText();
    EXPECT_EQ(Array(s, "radiance")->GetNumberOfTuples(), vtkIdType(size.first) * size.second);
    finite(s, "size");
  }
  {
    // A closed white room: nothing is lost, and after 1024 scatterings it ends.
    SceneBuilder b;
    b.Box(b.Add(SceneBuilder::Lambert(1, .001f)), { -1, -1, -1 }, { 1, 1, 1 });
    b.Camera({ 0, 0, .5f }, .7);
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, b.Scene, 8, 8, 2);
    s->SetMaximumBounces(1024);
    ASSERT_TRUE(Ask(s, names));
    finite(s, "furnace");
    EXPECT_LE(s->GetCounters().Rays, 8 * 8 * 2 * (2 * 1024 + 1));
    double mean = 0;
    for (float v : Copy(s, "radiance"))
      mean += v / (8 * 8 * 3);
    EXPECT_NEAR(mean, .001 * 1025, .05) << "one unit of light per scattering";
    s->SetMaximumBounces(0);
    ASSERT_TRUE(Ask(s, names));
    for (float v : Copy(s, "radiance"))
      ASSERT_EQ(v, .001f);
  }
  for (float light : { 65504.f, 1e30f })
  {
    auto room = Room();
    room->Materials[1].Emission = Vec3f(light);
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, room, 16, 16, 8);
    ASSERT_TRUE(Ask(s, names));
    finite(s, "bright");
  }
  {
    // The camera is inside of a ball of glass.
    SceneBuilder b;
    Material glass;
    glass.Metallic = 0;
    glass.Roughness = 0;
    glass.Transmission = 1;
    glass.Volume = true;
    b.Sphere(b.Add(glass), { 0, 0, 0 }, 1, 24);
    b.Sky(1);
    b.Camera({ 0, 0, .3f }, 1.2);
    vtkNew<vtkQuellPathTraceSource> s;
    Configure(s, b.Scene, 16, 16, 4);
    s->SetMaximumBounces(64);
    ASSERT_TRUE(Ask(s, names));
    finite(s, "in glass");
    double mean = 0;
    for (float v : Copy(s, "radiance"))
      mean += v / (16 * 16 * 3);
    EXPECT_NEAR(mean, 1.5 * 1.5, .03) << "a white world seen in glass of ior 1.5: radiance grows by its square";
  }
  {
    vtkNew<vtkQuellPathTraceSource> s, whole;
    Configure(s, Room());
    Configure(whole, Room());
    ASSERT_TRUE(Ask(s, { "radiance" }, 0, { 17, 9, 18, 10 }));
    ASSERT_TRUE(Ask(whole, { "radiance" }));
    ASSERT_EQ(Array(s, "radiance")->GetNumberOfTuples(), 1);
    EXPECT_EQ(s->GetCounters().Paths, 2);
    for (int c = 0; c < 3; ++c)
      EXPECT_EQ(Array(s, "radiance")->GetComponent(0, c), Array(whole, "radiance")->GetComponent(9 * 40 + 17, c));
  }
}

// The samples' moments, kept in double: noise that is a millionth of its mean, over 100,000 samples.
TEST(PathTraceStatistics, VarianceOfNoiseFarBelowItsMean)
{
  for (const double ratio : { 1., 1e3, 1e4, 1e5, 1e6 })
  {
    Film film({ 0, 0, 1, 1 }, { "radiance", "variance", "moments" });
    const int n = 100000;
    std::uint64_t state = 88172645463325252ull;
    std::vector<double> seen;
    double mean = 0;
    for (int i = 0; i < n; ++i)
    {
      state ^= state << 13, state ^= state >> 7, state ^= state << 17;
      const float v = float(ratio + std::sqrt(12.) * (double(state >> 11) * 0x1p-53 - 0.5));
      PathSample sample;
      sample.Emission = { v, v, v };
      film.Add(0, 0, i, sample);
      seen.push_back(v);
      mean += v;
    }
    mean /= n;
    double exact = 0;
    for (double v : seen)
      exact += (v - mean) * (v - mean) / n;
    const Rect e{ 0, 0, 1, 1 };
    float moments[2], variance[1], radiance[3];
    film.Develop("moments", e, n, ImageOut(moments, 2, e));
    film.Develop("variance", e, n, ImageOut(variance, 1, e));
    film.Develop("radiance", e, n, ImageOut(radiance, 3, e));
    EXPECT_NEAR(radiance[1] / mean, 1, 1e-7) << ratio;
    EXPECT_NEAR(moments[0] / mean, 1, 1e-7) << ratio;
    EXPECT_NEAR(moments[1] / exact, 1, 1e-3) << ratio;
    EXPECT_NEAR(double(variance[0]) * (n - 1) / exact, 1, 1e-3) << ratio;
    EXPECT_NEAR(exact, 1, 0.02) << ratio << ": the noise is what it should be";
  }
}
