// SPDX-License-Identifier: BSD-3-Clause
#include "AllStages.h"
#include "quellDisplayMapping.h"
#include "quellEditDocument.h"
#include "quellImageFile.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"
#include "quellRenderSession.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <mutex>
#include <set>
#include <thread>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
std::string Pipeline(const char* name)
{
  return std::string(QUELL_SOURCE_DIR) + "/Data/Pipelines/" + name;
}

std::shared_ptr<PipelineDocument> Read(const char* name)
{
  Diagnostics messages;
  auto document = ReadPipelineFile(Pipeline(name), messages);
  EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
  return document;
}

GraphOptions Small(int frames = 4)
{
  GraphOptions o;
  o.Defines = { { "width", "40" }, { "height", "32" }, { "frames", std::to_string(frames) } };
  return o;
}

std::vector<float> Values(vtkImageData* image, const std::string& array)
{
  vtkFloatArray* a = image ? vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array.c_str())) : nullptr;
  if (!a)
  {
    ADD_FAILURE() << "no array " << array;
    return {};
  }
  return std::vector<float>(a->GetPointer(0), a->GetPointer(0) + a->GetNumberOfValues());
}

bool SameBits(const std::vector<float>& a, const std::vector<float>& b)
{
  return a.size() == b.size() && !a.empty() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

/// What `quell run` would have after `tick`, all frames from the first.
std::vector<float> Expected(
  std::shared_ptr<const PipelineDocument> document, const GraphOptions& options, int tick, const ViewTarget& target)
{
  Diagnostics messages;
  auto graph = BuildGraph(document, Registry(), options, messages);
  EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
  PipelineExecutor executor(graph, Registry());
  executor.SetWriteOutputs(false);
  executor.Request(target.Node, { target.Array });
  for (int t = graph->Ticks.First; t <= tick; ++t)
  {
    EXPECT_TRUE(executor.RunTick(t).Ok);
  }
  return Values(executor.GetImage(target.Node), target.Array);
}

struct Fixture
{
  RenderSession Session{ Registry() };
  ViewWish Wish;
  std::shared_ptr<const ViewFrame> Run()
  {
    this->Session.Wish(this->Wish);
    EXPECT_TRUE(this->Session.WaitIdle(60));
    auto frame = this->Session.Latest();
    EXPECT_TRUE(frame);
    return frame;
  }
};
}

TEST(RenderSession, HoldsTheBitsOfARunWithHistory)
{
  Fixture f;
  f.Wish.Document = Read("svgf.xml");
  f.Wish.Options = Small();
  f.Wish.Tick = 3;
  f.Wish.Targets = { { "taa", "radiance" } };
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  EXPECT_EQ(frame->Tick, 3);
  EXPECT_TRUE(
    SameBits(Values(frame->Image("taa"), "radiance"), Expected(f.Wish.Document, f.Wish.Options, 3, f.Wish.Targets[0])));
}

TEST(RenderSession, ShowsManySamplesOnTheWayAndEndsWithTheBitsOfOneGo)
{
  Fixture f;
  f.Wish.Document = Read("quick.xml");
  f.Wish.Options = Small(3);
  f.Wish.Options.Defines.emplace_back("spp", "20");
  f.Wish.Targets = { { "sum", "radiance" } };
  std::vector<int> samples;
  std::mutex mutex;
  f.Session.SetNotify(
    [&]
    {
      const auto frame = f.Session.Latest();
      std::lock_guard<std::mutex> lock(mutex);
      if (frame && frame->Ok && (samples.empty() || samples.back() != frame->Samples))
      {
        samples.push_back(frame->Samples);
      }
    });
  for (int tick : { 0, 2 })
  {
    f.Wish.Tick = tick;
    const auto frame = f.Run();
    ASSERT_TRUE(frame->Ok) << frame->Error;
    EXPECT_TRUE(frame->Final);
    EXPECT_EQ(frame->Samples, 20);
    EXPECT_TRUE(SameBits(
      Values(frame->Image("sum"), "radiance"), Expected(f.Wish.Document, f.Wish.Options, tick, f.Wish.Targets[0])));
  }
  f.Session.SetNotify(nullptr);
  std::lock_guard<std::mutex> lock(mutex);
  ASSERT_GE(samples.size(), 2u);
  EXPECT_EQ(samples.front(), 1);
  EXPECT_EQ(samples.back(), 20);
}

TEST(RenderSession, AFilterParameterLeavesThePathTracerAlone)
{
  Fixture f;
  auto document = Read("quick.xml");
  f.Wish.Document = document;
  f.Wish.Options = Small(1);
  f.Wish.Targets = { { "sum", "radiance" } };
  ASSERT_TRUE(f.Run()->Ok);
  auto edited = std::make_shared<PipelineDocument>(*document);
  for (PipelineNode& n : edited->Nodes)
  {
    if (n.Id.Value == "blur")
    {
      PipelineProperty p;
      p.Name = "SigmaSpatial";
      p.Value = "1.25";
      n.Properties.push_back(p);
    }
  }
  f.Wish.Document = edited;
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  std::map<std::string, std::int64_t> executions, rays;
  for (const ViewFrame::Node& n : frame->Nodes)
  {
    executions[n.Path] = n.Counters.Executions;
    rays[n.Path] = n.Counters.Rays;
  }
  EXPECT_EQ(executions["pt"], 0);
  EXPECT_EQ(rays["pt"], 0);
  EXPECT_EQ(executions["demodulate"], 0);
  EXPECT_EQ(executions["blur"], 1);
  EXPECT_EQ(executions["modulate"], 1);
  EXPECT_TRUE(
    SameBits(Values(frame->Image("sum"), "radiance"), Expected(edited, f.Wish.Options, 0, f.Wish.Targets[0])));

  // Taking the edit back resets the property of the stage that stayed.
  f.Wish.Document = document;
  EXPECT_TRUE(
    SameBits(Values(f.Run()->Image("sum"), "radiance"), Expected(document, f.Wish.Options, 0, f.Wish.Targets[0])));
}

TEST(RenderSession, ANodeInsertedOnALinkKeepsWhatIsAboveIt)
{
  Fixture f;
  auto document = Read("quick.xml");
  f.Wish.Document = document;
  f.Wish.Options = Small(1);
  f.Wish.Targets = { { "sum", "radiance" } };
  f.Wish.Progressive = false;
  ASSERT_TRUE(f.Run()->Ok);
  auto edited = std::make_shared<PipelineDocument>(*document);
  PipelineNode clamp;
  clamp.Id = "clamp";
  clamp.Type = "FireflyClamp";
  PipelineInput in;
  in.Port = "radiance";
  in.From = "scattered:radiance";
  clamp.Inputs.push_back(in);
  for (PipelineNode& n : edited->Nodes)
  {
    if (n.Id.Value == "demodulate")
    {
      n.Inputs[0].From = "clamp:radiance";
    }
  }
  edited->Nodes.push_back(clamp);
  f.Wish.Document = edited;
  auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  for (const ViewFrame::Node& n : frame->Nodes)
  {
    EXPECT_EQ(n.Counters.Executions, n.Path == "pt" || n.Path == "scattered" ? 0 : 1) << n.Path;
  }
  EXPECT_TRUE(
    SameBits(Values(frame->Image("sum"), "radiance"), Expected(edited, f.Wish.Options, 0, f.Wish.Targets[0])));
  f.Wish.Document = document;
  frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  EXPECT_TRUE(
    SameBits(Values(frame->Image("sum"), "radiance"), Expected(document, f.Wish.Options, 0, f.Wish.Targets[0])));
}

TEST(RenderSession, WhatIsShownRunsWhileTheRestHasMistakes)
{
  Fixture f;
  auto document = Read("quick.xml");
  PipelineNode loose;
  loose.Id = "loose";
  loose.Type = "AlbedoModulate";
  document->Nodes.push_back(loose);
  f.Wish.Document = document;
  f.Wish.Options = Small(1);
  f.Wish.Targets = { { "demodulate", "illumination" } };
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  EXPECT_TRUE(frame->Pruned);
  const auto check = f.Session.Checked();
  ASSERT_TRUE(check);
  ASSERT_GE(check->Errors, 1);
  EXPECT_EQ(check->Messages.front().Node, "loose");

  f.Wish.Targets = { { "loose", "radiance" } };
  const auto failed = f.Run();
  EXPECT_FALSE(failed->Ok);
  EXPECT_NE(failed->Error.find("loose"), std::string::npos) << failed->Error;
}

TEST(RenderSession, UnknownTargetsAreSentences)
{
  Fixture f;
  f.Wish.Document = Read("quick.xml");
  f.Wish.Options = Small(1);
  f.Wish.Targets = { { "nobody", "radiance" } };
  EXPECT_NE(f.Run()->Error.find("\"nobody\""), std::string::npos);
  f.Wish.Targets = { { "blur", "nothing" } };
  EXPECT_NE(f.Run()->Error.find("\"nothing\""), std::string::npos);
  f.Wish.Targets = {};
  const auto frame = f.Run();
  EXPECT_FALSE(frame->Ok);
  EXPECT_EQ(frame->Error, "");
}

TEST(RenderSession, AnotherFrameSizeStartsWithoutHistory)
{
  Fixture f;
  f.Wish.Document = Read("svgf.xml");
  f.Wish.Options = Small();
  f.Wish.Tick = 2;
  f.Wish.Targets = { { "taa", "radiance" } };
  ASSERT_TRUE(f.Run()->Ok);
  f.Wish.Options.Defines[0].second = "24";
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  EXPECT_EQ(frame->Image("taa")->GetDimensions()[0], 24);
  EXPECT_TRUE(
    SameBits(Values(frame->Image("taa"), "radiance"), Expected(f.Wish.Document, f.Wish.Options, 2, f.Wish.Targets[0])));
}

TEST(RenderSession, ALiveCameraKeepsTheHistory)
{
  Fixture f;
  f.Wish.Document = Read("svgf.xml");
  f.Wish.Options = Small(2);
  f.Wish.Targets = { { "direct/accumulate", "history" } };
  ASSERT_TRUE(f.Run()->Ok);
  const FrameFacts facts = FrameFacts::Read(f.Session.Latest()->Image("direct/accumulate")->GetFieldData());
  ASSERT_TRUE(facts.HasCamera);
  Mat4 worldFromCamera;
  ASSERT_TRUE(facts.WorldToCamera.Inverse(worldFromCamera));
  for (int i = 0; i < 3; ++i)
  {
    worldFromCamera.m[i][3] += i == 0 ? facts.Origin.x : i == 1 ? facts.Origin.y : facts.Origin.z;
  }
  // Standing still, and more frames than the pipeline has: every pixel that is hit has been seen in all of them.
  std::shared_ptr<const ViewFrame> frame;
  for (int i = 1; i <= 6; ++i)
  {
    f.Wish.Camera = worldFromCamera;
    f.Wish.CameraSerial = i;
    frame = f.Run();
    ASSERT_TRUE(frame->Ok) << frame->Error;
  }
  EXPECT_EQ(frame->LiveTicks, 6);
  const std::vector<float> still = Values(frame->Image("direct/accumulate"), "history");
  const float longest = *std::max_element(still.begin(), still.end());
  EXPECT_EQ(longest, 7.f);
  // A step aside: most pixels find themselves again.
  worldFromCamera.m[0][3] += 0.02;
  f.Wish.Camera = worldFromCamera;
  f.Wish.CameraSerial = 7;
  frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  const std::vector<float> moved = Values(frame->Image("direct/accumulate"), "history");
  EXPECT_GT(std::count(moved.begin(), moved.end(), 8.f), std::ptrdiff_t(moved.size() / 2));
  // Back to the scene's own camera: the frame of a run.
  f.Wish.Camera.reset();
  f.Wish.Targets = { { "taa", "radiance" } };
  frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  EXPECT_TRUE(
    SameBits(Values(frame->Image("taa"), "radiance"), Expected(f.Wish.Document, f.Wish.Options, 0, f.Wish.Targets[0])));
}

TEST(RenderSession, CancelEndsAFrameThatWouldTakeMinutes)
{
  Fixture f;
  f.Wish.Document = Read("quick.xml");
  f.Wish.Options = Small(1);
  f.Wish.Options.Defines = { { "width", "1024" }, { "height", "1024" }, { "spp", "100000" } };
  f.Wish.Targets = { { "sum", "radiance" } };
  f.Wish.Progressive = false;
  f.Session.Wish(f.Wish);
  while (f.Session.Progress().Node.empty())
  {
    std::this_thread::yield();
  }
  f.Session.Cancel();
  EXPECT_TRUE(f.Session.WaitIdle(20));
  EXPECT_TRUE(f.Session.Latest() == nullptr);
  // The same wish again, as every paint of a viewer has it, does not start it again.
  for (int i = 0; i < 3; ++i)
  {
    f.Session.Wish(f.Wish);
    EXPECT_TRUE(f.Session.WaitIdle(0));
  }
  f.Wish.Paused = true;
  f.Session.Wish(f.Wish);
  EXPECT_TRUE(f.Session.WaitIdle(0));
  f.Wish.Paused = false;
  // And the next wish is served.
  f.Wish.Options = Small(1);
  EXPECT_TRUE(f.Run()->Ok);
}

TEST(RenderSession, PlaysThroughTheTimelineInOrder)
{
  Fixture f;
  f.Wish.Document = Read("svgf.xml");
  f.Wish.Options = Small(5);
  f.Wish.Targets = { { "taa", "radiance" } };
  f.Wish.Play = true;
  f.Wish.Loop = false;
  std::vector<int> ticks;
  std::mutex mutex;
  f.Session.SetNotify(
    [&]
    {
      const auto frame = f.Session.Latest();
      std::lock_guard<std::mutex> lock(mutex);
      if (frame && frame->Ok && (ticks.empty() || ticks.back() != frame->Tick))
      {
        ticks.push_back(frame->Tick);
      }
    });
  const auto frame = f.Run();
  f.Session.SetNotify(nullptr);
  EXPECT_TRUE(
    SameBits(Values(frame->Image("taa"), "radiance"), Expected(f.Wish.Document, f.Wish.Options, 4, f.Wish.Targets[0])));
  std::lock_guard<std::mutex> lock(mutex);
  EXPECT_EQ(ticks, (std::vector<int>{ 0, 1, 2, 3, 4 }));
}

// What is on the screen is what `quell run` writes: the floats of the EXR, the bytes of the PNG.
TEST(RenderSession, ShowsWhatARunWrites)
{
  const fs::path dir = fs::path(testing::TempDir()) / "quell-view-run";
  fs::remove_all(dir);
  GraphOptions options = Small(1);
  options.OutputDirectory = dir.string();
  auto document = Read("quick.xml");
  {
    Diagnostics messages;
    PipelineExecutor executor(BuildGraph(document, Registry(), options, messages), Registry());
    ASSERT_TRUE(executor.RunTick(0).Ok);
  }
  Fixture f;
  f.Wish.Document = document;
  f.Wish.Options = Small(1);
  f.Wish.Targets = { { "sum", "radiance" } };
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  const auto written = ReadImageFile((dir / "out/quick.exr").string());
  EXPECT_TRUE(SameBits(Values(frame->Image("sum"), "radiance"), Values(written, "radiance")));

  DisplayMapper mapper;
  DisplaySettings settings;
  settings.View = "ACES-like";
  const DisplayImage shown = mapper.Map(frame->Image("sum"), "radiance", ArrayKind::Color, settings);
  ReadOptions plain;
  plain.Transfer = FileTransfer::Linear;
  const auto png = ReadImageFile((dir / "out/quick.png").string(), nullptr, plain);
  const std::vector<float> values = Values(png, "radiance");
  ASSERT_EQ(values.size(), std::size_t(shown.Width * shown.Height * 3));
  int different = 0;
  for (int y = 0; y < shown.Height; ++y)
  {
    for (int x = 0; x < shown.Width; ++x)
    {
      for (int c = 0; c < 3; ++c)
      {
        const float file = values[std::size_t(3 * ((shown.Height - 1 - y) * shown.Width + x) + c)] * 255.f;
        different += int(file + 0.5f) != int(shown.Rgba[std::size_t(4 * (y * shown.Width + x) + c)]);
      }
    }
  }
  EXPECT_EQ(different, 0);
  fs::remove_all(dir);
}

TEST(RenderSession, SaysWhatAPixelIsMadeOf)
{
  Fixture f;
  f.Wish.Document = Read("quick.xml");
  f.Wish.Options = Small(1);
  f.Wish.Targets = { { "blur", "radiance" }, { "demodulate", "illumination" } };
  f.Session.Weigh("blur", 12, 9);
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  const auto check = [&](const std::shared_ptr<const ViewFrame>& of)
  {
    const auto w = f.Session.Weights();
    ASSERT_TRUE(w && w->Error.empty()) << (w ? w->Error : "none");
    EXPECT_EQ(w->Frame, of->Number);
    ASSERT_EQ(w->Weights.Parts.size(), 1u);
    const std::vector<float> in = Values(of->Image("demodulate"), "illumination");
    const std::vector<float> out = Values(of->Image("blur"), "radiance");
    for (std::size_t c = 0; c < 3; ++c)
    {
      double sum = 0;
      for (int y = 0; y < 32; ++y)
      {
        for (int x = 0; x < 40; ++x)
        {
          sum += double(w->Weights.Parts[0].At(x, y)) * double(in[std::size_t(3 * (40 * y + x)) + c]);
        }
      }
      const double made = double(out[std::size_t(3 * (40 * w->Y + w->X)) + c]);
      EXPECT_NEAR(sum, made, 1e-5 * std::max(1e-3, std::fabs(made)));
    }
  };
  check(frame);
  f.Session.Weigh("blur", 30, 2);
  ASSERT_TRUE(f.Session.WaitIdle(20));
  EXPECT_EQ(f.Session.Weights()->X, 30);
  check(frame);
  // A newer frame has newer weights, unasked.
  auto edited = std::make_shared<PipelineDocument>(*f.Wish.Document);
  for (PipelineNode& n : edited->Nodes)
  {
    for (PipelineProperty& p : n.Properties)
    {
      p.Value = n.Id.Value == "blur" && p.Name.Value == "SigmaSpatial" ? PipelineText("1") : p.Value;
    }
  }
  f.Wish.Document = edited;
  const auto after = f.Run();
  ASSERT_TRUE(after->Ok) << after->Error;
  check(after);
  f.Session.Weigh("pt", 1, 1);
  ASSERT_TRUE(f.Session.WaitIdle(20));
  EXPECT_NE(f.Session.Weights()->Error.find("no filter"), std::string::npos);
  const bool any = std::any_of(
    after->Nodes.begin(), after->Nodes.end(), [](const ViewFrame::Node& n) { return n.Path == "blur" && n.Weighs; });
  EXPECT_TRUE(any);
}

// The average over time: how much of the pixel is new, and from which pixels of the frame before the rest is.
TEST(RenderSession, SaysWhatAPixelsHistoryIsMadeOf)
{
  Fixture f;
  f.Wish.Document = Read("svgf.xml");
  f.Wish.Options = Small(8);
  f.Wish.Tick = 5;
  const std::string reproject = "direct/reproject", accumulate = "direct/accumulate";
  f.Wish.Targets = { { "direct/atrous", "feedback" } };
  const auto before = f.Run();
  ASSERT_TRUE(before->Ok) << before->Error;
  const std::vector<float> kept = Values(before->Image("direct/atrous"), "feedback");
  f.Wish.Tick = 6;
  f.Wish.Targets = { { reproject, "mask" }, { reproject, "radiance" } };
  const auto alone = f.Run();
  ASSERT_TRUE(alone->Ok) << alone->Error;
  const std::vector<float> mask = Values(alone->Image(reproject), "mask");
  const std::vector<float> fetched = Values(alone->Image(reproject), "radiance");
  f.Wish.Targets = { { accumulate, "radiance" }, { "direct/clamp", "radiance" } };
  const auto frame = f.Run();
  ASSERT_TRUE(frame->Ok) << frame->Error;
  const std::vector<float> mixed = Values(frame->Image(accumulate), "radiance");
  const std::vector<float> fresh = Values(frame->Image("direct/clamp"), "radiance");
  const int width = frame->Image(accumulate)->GetDimensions()[0], height = frame->Image(accumulate)->GetDimensions()[1];
  const auto near = [](double a, double b) { EXPECT_NEAR(a, b, 2e-5 * std::max(1e-2, std::fabs(b))); };
  int with = 0, without = 0, several = 0;
  for (int y = 1; y < height; y += 5)
  {
    for (int x = 1; x < width; x += 6)
    {
      const std::size_t i = std::size_t(y * width + x);
      f.Session.Weigh(reproject, x, y);
      ASSERT_TRUE(f.Session.WaitIdle(20));
      const auto taps = f.Session.Weights();
      ASSERT_TRUE(taps && taps->Node == reproject && taps->X == x && taps->Y == y);
      if (mask[i] >= 3)
      {
        EXPECT_NE(taps->Error.find("no history here: "), std::string::npos) << taps->Error;
        ++without;
      }
      else
      {
        ASSERT_EQ(taps->Error, "");
        const PixelWeights::Part& part = taps->Weights.Parts.at(0);
        EXPECT_EQ(part.Input, "history");
        double sums[4] = {};
        int count = 0;
        for (int qy = 0; qy < height; ++qy)
        {
          for (int qx = 0; qx < width; ++qx)
          {
            const double w = double(part.At(qx, qy));
            count += w != 0 ? 1 : 0;
            sums[3] += w;
            for (int c = 0; c < 3 && w != 0; ++c)
            {
              sums[c] += w * double(kept[std::size_t(3 * (qy * width + qx) + c)]);
            }
          }
        }
        near(sums[3], 1);
        for (int c = 0; c < 3; ++c)
        {
          near(sums[c], double(fetched[3 * i + std::size_t(c)]));
        }
        several += count > 1 ? 1 : 0;
        ++with;
      }
      f.Session.Weigh(accumulate, x, y);
      ASSERT_TRUE(f.Session.WaitIdle(20));
      const auto parts = f.Session.Weights();
      ASSERT_EQ(parts->Error, "");
      ASSERT_EQ(parts->Weights.Parts.size(), 2u);
      const double a = double(parts->Weights.Parts[0].At(x, y)), rest = double(parts->Weights.Parts[1].At(x, y));
      near(a + rest, 1);
      EXPECT_EQ(mask[i] >= 3, rest == 0) << "no history weighs nothing";
      for (std::size_t c = 0; c < 3; ++c)
      {
        near(a * double(fresh[3 * i + c]) + rest * double(fetched[3 * i + c]), double(mixed[3 * i + c]));
      }
    }
  }
  EXPECT_GT(with, 10);
  EXPECT_GT(without, 0);
  EXPECT_GT(several, 0) << "the scene moves";
}

TEST(RenderSession, ATemplateMadeOfASelectionHasTheSameBits)
{
  EditDocument d(&Registry());
  std::vector<Diagnostic> messages;
  ASSERT_TRUE(d.Open(Pipeline("quick.xml"), messages));
  const auto before = Expected(d.Get(), Small(2), 1, { "sum", "radiance" });
  std::string error;
  ASSERT_NE(d.MakeTemplate({ "demodulate", "blur", "modulate" }, "soft", nullptr, error), "") << error;
  EXPECT_TRUE(SameBits(before, Expected(d.Get(), Small(2), 1, { "sum", "radiance" })));
}

// A hand that moves faster than frames are made must not keep them from their end.
TEST(RenderSession, AStreamOfWishesStillShowsFrames)
{
  Fixture f;
  f.Wish.Document = Read("quick.xml");
  f.Wish.Options = Small(1);
  f.Wish.Options.Defines.emplace_back("spp", "400");
  f.Wish.Targets = { { "sum", "radiance" } };
  f.Wish.Hurry = false;
  Mat4 camera;
  camera.m[2][3] = 3;
  std::set<std::uint64_t> shown;
  int serial = 0;
  for (int i = 0; i < 100000 && shown.size() < 3; ++i)
  {
    // A new pose long before a frame can be done.
    camera.m[0][3] = 1e-4 * ++serial;
    f.Wish.Camera = camera;
    f.Wish.CameraSerial = serial;
    f.Session.Wish(f.Wish);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    if (const auto frame = f.Session.Latest())
    {
      ASSERT_TRUE(frame->Ok) << frame->Error;
      shown.insert(frame->Number);
    }
  }
  EXPECT_EQ(shown.size(), 3u);
  f.Session.Cancel();
}
