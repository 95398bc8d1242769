// SPDX-License-Identifier: BSD-3-Clause
// The program itself, told to stop in the middle of a long render: SIGINT when its first progress line shows.
#include "RunProgram.h"
#include "quellFrameFacts.h"
#include "quellCheckpoint.h"
#include "quellImageFile.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <unistd.h>
#include <vector>

namespace fs = std::filesystem;

namespace
{
/// Runs quell in `directory`; sends `signals` interrupts, the first one at the first line that holds `trigger`, each
/// further one at the program's answer to the one before.
Outcome Start(
  const fs::path& directory, std::vector<std::string> arguments, const char* trigger = nullptr, int signals = 0)
{
  std::size_t from = 0;
  std::string awaited = trigger ? trigger : "";
  return RunQuell(directory, std::move(arguments), {},
    [&](pid_t child, const std::string& said)
    {
      const std::size_t at = signals > 0 ? said.find(awaited, from) : std::string::npos;
      if (at != std::string::npos)
      {
        kill(child, SIGINT);
        --signals;
        from = at + 1;
        awaited = "finishing this frame";
      }
    });
}

class Interrupt : public testing::Test
{
protected:
  void SetUp() override
  {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    this->Directory = fs::path(testing::TempDir()) / (std::string("quell-interrupt-") + test->name());
    fs::remove_all(this->Directory);
    fs::create_directories(this->Directory);
    this->Write("box.xml", "", "pt:radiance", "beauty.exr");
  }
  void TearDown() override { fs::remove_all(this->Directory); }

  /// A box in so many samples that nobody waits for their end.
  void Write(const std::string& name, const std::string& nodes, const std::string& beauty, const std::string& file,
    int frames = 1)
  {
    std::ofstream stream(this->Directory / name);
    stream << "<pipeline version=\"1\">\n<variable name=\"spp\" type=\"int\" default=\"1000000\"/>\n<time count=\""
           << frames
           << "\"/>\n<node id=\"pt\" type=\"PathTraceSource\"><property name=\"Scene\" value=\"" QUELL_SOURCE_DIR
              "/Data/Scenes/cornell-box.gltf\"/><property name=\"Width\" value=\"24\"/><property name=\"Height\" "
              "value=\"16\"/><property name=\"SamplesPerPixel\" value=\"$(spp)\"/></node>\n"
           << nodes << "<output name=\"beauty\" from=\"" << beauty << "\" file=\"" << file
           << "\"><layer from=\"pt:samples\"/></output>\n</pipeline>\n";
  }
  std::vector<float> Layer(const std::string& file, const char* array)
  {
    auto image = quell::ReadImageFile((this->Directory / file).string());
    auto values = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array));
    return values ? std::vector<float>(values->GetPointer(0), values->GetPointer(0) + values->GetNumberOfValues())
                  : std::vector<float>();
  }
  std::string Metadata(const std::string& file, const char* key)
  {
    auto all = quell::ReadImageHeader((this->Directory / file).string()).Metadata;
    return all[key];
  }
  bool NothingTemporary() const
  {
    for (const auto& entry : fs::recursive_directory_iterator(this->Directory))
      if (entry.path().extension() == ".part")
        return false;
    return true;
  }

  fs::path Directory;
};
const char* const Progress = "samples/s"; // of the first progress line
}

TEST_F(Interrupt, WhatIsSampledIsWrittenAndGoesOn)
{
  const Outcome first = Start(this->Directory, { "run", "box.xml" }, Progress, 1);
  ASSERT_EQ(first.Status, 130) << first.Said;
  EXPECT_NE(first.Said.find("left, pt: "), std::string::npos) << first.Said;
  EXPECT_NE(first.Said.find("noise "), std::string::npos) << first.Said;
  EXPECT_NE(first.Said.find("of 1000000 samples, it is written to beauty.exr"), std::string::npos) << first.Said;
  EXPECT_NE(first.Said.find("--resume goes on with the samples of frame 0"), std::string::npos) << first.Said;
  ASSERT_TRUE(fs::exists(this->Directory / "beauty.exr"));
  EXPECT_TRUE(NothingTemporary());
  const std::vector<float> samples = this->Layer("beauty.exr", "samples");
  ASSERT_EQ(samples.size(), 24u * 16u);
  for (float v : samples)
    ASSERT_EQ(v, samples[0]);
  const int had = int(samples[0]);
  EXPECT_GE(had, 1);
  EXPECT_LT(had, 1000000);
  EXPECT_EQ(this->Metadata("beauty.exr", "partial"), std::to_string(had) + " of 1000000 samples");
  const auto image = quell::ReadImageFile((this->Directory / "beauty.exr").string());
  EXPECT_EQ(quell::FrameFacts::Read(image->GetFieldData()).SamplesPerPixel, had);
  EXPECT_EQ(quell::FrameFacts::Read(image->GetFieldData()).Partial, this->Metadata("beauty.exr", "partial"));
  ASSERT_TRUE(fs::exists(this->Directory / "box.checkpoint"));

  // another pipeline's samples are refused
  const Outcome other = Start(this->Directory, { "run", "box.xml", "--resume", "--seed", "7" });
  EXPECT_EQ(other.Status, 2) << other.Said;
  EXPECT_NE(other.Said.find("Seed was 0 and is 7"), std::string::npos) << other.Said;

  // the same run goes on, and may be interrupted again
  const Outcome second = Start(this->Directory, { "run", "box.xml", "--resume" }, Progress, 1);
  ASSERT_EQ(second.Status, 130) << second.Said;
  EXPECT_NE(second.Said.find("going on with the samples of frame 0"), std::string::npos) << second.Said;
  const int more = int(this->Layer("beauty.exr", "samples")[0]);
  EXPECT_GT(more, had);

  // what both runs made is the picture of that many samples, bit for bit
  const Outcome whole = Start(this->Directory, { "run", "box.xml", "-D", "spp=" + std::to_string(more), "--output",
                                                 "beauty=whole.exr", "--out", "other", "--quiet" });
  ASSERT_EQ(whole.Status, 0) << whole.Said;
  const std::vector<float> a = this->Layer("beauty.exr", "radiance"), b = this->Layer("other/whole.exr", "radiance");
  ASSERT_EQ(a.size(), 24u * 16u * 3u);
  EXPECT_EQ(a, b);
  EXPECT_EQ(this->Metadata("other/whole.exr", "partial"), "");
}

// A PNG cannot say that it is unfinished: the checkpoint knows of each one.
TEST_F(Interrupt, PicturesWithoutWordsStayUnfinished)
{
  std::ofstream(this->Directory / "png.xml")
    << "<pipeline version=\"1\">\n<time count=\"4\"/>\n<node id=\"pt\" type=\"PathTraceSource\"><property "
       "name=\"Scene\" value=\"" QUELL_SOURCE_DIR
       "/Data/Scenes/cornell-box.gltf\"/><property name=\"Width\" value=\"24\"/><property name=\"Height\" "
       "value=\"16\"/><property name=\"SamplesPerPixel\" value=\"1000000\"/></node>\n<node id=\"eye\" "
       "type=\"DisplayTransform\"><input port=\"radiance\" from=\"pt:radiance\"/></node>\n<output name=\"o\" "
       "from=\"eye\" file=\"o.####.png\"/>\n</pipeline>\n";
  const std::string file = (this->Directory / "png.checkpoint").string();
  std::set<int> expected;
  std::string frames;
  for (const int tick : { 1, 0, 3 })
  {
    expected.insert(tick);
    std::vector<std::string> arguments = { "run", "png.xml", "--frames", std::to_string(tick) };
    if (tick == 0) // goes on with the list, too
      arguments.push_back("--resume");
    const Outcome outcome = Start(this->Directory, arguments, Progress, 1);
    ASSERT_EQ(outcome.Status, 130) << outcome.Said;
    EXPECT_TRUE(fs::exists(this->Directory / ("o.000" + std::to_string(tick) + ".png")));
    EXPECT_EQ(quell::ReadCheckpoint(file).Unfinished, expected);
    EXPECT_EQ(quell::ReadCheckpoint(file).WorkTick, tick);
  }
  // None of them counts as there.
  const Outcome again = Start(this->Directory, { "run", "png.xml", "--resume", "--frames", "1" }, Progress, 1);
  EXPECT_EQ(again.Status, 130) << again.Said;
  EXPECT_EQ(again.Said.find("nothing to do"), std::string::npos) << again.Said;
  EXPECT_EQ(quell::ReadCheckpoint(file).Unfinished, expected);
}

TEST_F(Interrupt, TheSecondOneGivesTheFrameUp)
{
  // A file of before stays as it is.
  std::ofstream(this->Directory / "beauty.exr") << "of before";
  // One sample of a large picture takes a while, so that the second signal meets the pass at work.
  const Outcome outcome = Start(this->Directory,
    { "run", "box.xml", "--set", "pt.Width=4096", "--set", "pt.Height=2048" }, "of 1000000 samples", 2);
  EXPECT_EQ(outcome.Status, 130) << outcome.Said;
  EXPECT_NE(outcome.Said.find("interrupted in frame 0; 0 of 1 frames are whole"), std::string::npos) << outcome.Said;
  EXPECT_TRUE(NothingTemporary());
  std::ifstream stream(this->Directory / "beauty.exr");
  std::string text;
  std::getline(stream, text);
  EXPECT_EQ(text, "of before");
}

TEST_F(Interrupt, DownstreamOfAPartialFrameIsPartial)
{
  this->Write("blur.xml",
    "<node id=\"blur\" type=\"BilateralFilter\"><input port=\"radiance\" from=\"pt:radiance\"/><input port=\"normal\" "
    "from=\"pt:normal\"/></node>\n",
    "blur:radiance", "blur.exr");
  const Outcome outcome = Start(this->Directory, { "run", "blur.xml" }, Progress, 1);
  ASSERT_EQ(outcome.Status, 130) << outcome.Said;
  EXPECT_NE(this->Metadata("blur.exr", "partial"), "");
  EXPECT_EQ(this->Layer("blur.exr", "radiance").size(), 24u * 16u * 3u);
}

TEST_F(Interrupt, SequencesResumeInThePartialFrame)
{
  // With history: nothing of the partial frame may get into it.
  this->Write("seq.xml",
    "<node id=\"taa\" type=\"TemporalAntialias\"><input port=\"radiance\" from=\"pt:radiance\"/><input "
    "port=\"history\" from=\"taa:radiance\" delay=\"1\"/></node>\n",
    "taa:radiance", "seq.####.exr", 3);
  const Outcome first = Start(this->Directory, { "run", "seq.xml" }, Progress, 1);
  ASSERT_EQ(first.Status, 130) << first.Said;
  EXPECT_NE(this->Metadata("seq.0000.exr", "partial"), "");
  EXPECT_FALSE(fs::exists(this->Directory / "seq.0001.exr"));
  const int had = int(this->Layer("seq.0000.exr", "samples")[0]);
  const Outcome second = Start(this->Directory, { "run", "seq.xml", "--resume" }, Progress, 1);
  ASSERT_EQ(second.Status, 130) << second.Said;
  EXPECT_NE(second.Said.find("going on with the samples of frame 0"), std::string::npos) << second.Said;
  EXPECT_GT(int(this->Layer("seq.0000.exr", "samples")[0]), had);
}
