// SPDX-License-Identifier: BSD-3-Clause
// The program when the world fails it: no room, no permission, signals, files that vanish. Whatever happens: finished
// frames are whole and stay, nothing half-written is left, the exit status and the message are right. Needs no root and
// no mount; a limit on the size of files stands for the full disk.
#include "RunProgram.h"

#include "quellImageFile.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <cstring>
#include <fcntl.h>
#include <random>

using namespace quell;
namespace fs = std::filesystem;

namespace
{
std::function<void()> FileLimit(rlim_t bytes)
{
  return [bytes]
  {
    const rlimit limit{ bytes, bytes };
    setrlimit(RLIMIT_FSIZE, &limit);
#ifdef __SANITIZE_THREAD__
    // The thread sanitizer writes a file of its own there before main, and the limit would end it by SIGXFSZ; a
    // directory that it cannot write to it goes without.
    setenv("TMPDIR", "/nonexistent", 1);
#endif
  };
}

/// What binds everybody but root.
void BeNobody()
{
  if (getuid() == 0 && (setgid(65534) != 0 || setuid(65534) != 0))
    _exit(126);
}

class Faults : public InDirectory
{
protected:
  /// Nobody may run the program (its folder may be root's alone).
  bool NobodyCanRun() const
  {
    fs::permissions(this->Directory, fs::perms::all);
    return RunQuell(this->Directory, { "--version" }, &BeNobody).Status == 0;
  }
};

class FullDisk
  : public Faults
  , public testing::WithParamInterface<const char*>
{
};
}

TEST_P(FullDisk, NothingIsHalfWritten)
{
  const std::string extension = GetParam(), file = "x." + extension;
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x." + extension + "\"/>"));
  ASSERT_EQ(RunQuell(this->Directory, { "run", "p.xml", "--quiet" }).Status, 0);
  const std::uintmax_t size = fs::file_size(this->Directory / file);
  ASSERT_GT(size, 200u);
  // Times in the file make it a few bytes longer or shorter.
  for (const std::uintmax_t limit : { std::uintmax_t(0), size / 3, size - 100 })
  {
    SCOPED_TRACE(limit);
    this->Write(file, "of before");
    const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet" }, FileLimit(limit));
    EXPECT_EQ(outcome.Status, 1) << outcome.Said;
    EXPECT_NE(outcome.Said.find("cannot write \"" + file + "\": " + std::strerror(EFBIG)), std::string::npos)
      << outcome.Said;
    EXPECT_EQ(this->Read(file), "of before");
    EXPECT_EQ(this->List(), (std::vector<std::string>{ "p.xml", file }));
  }
}
INSTANTIATE_TEST_SUITE_P(Formats, FullDisk, testing::Values("exr", "png", "jpg", "tif", "bmp", "tga", "hdr"),
  [](const testing::TestParamInfo<const char*>& tested) { return std::string(tested.param); });

TEST_F(Faults, AFullDiskInASequenceKeepsTheFramesBefore)
{
  // The second output grows from frame to frame: its name does.
  this->Write(
    "p.xml", Box("<node id=\"t\" type=\"TemporalAntialias\"><input port=\"radiance\" from=\"pt:radiance\"/><input "
                 "port=\"history\" from=\"t:radiance\" delay=\"1\"/></node><output name=\"o\" from=\"t:radiance\" "
                 "file=\"o/x.####.exr\"/>",
               4));
  ASSERT_EQ(RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "whole" }).Status, 0);
  // A directory in the place of frame 2: a failure in the middle of the sequence.
  fs::create_directories(this->Directory / "cut/o/x.0002.exr");
  const Outcome cut = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "cut" });
  EXPECT_EQ(cut.Status, 1) << cut.Said;
  EXPECT_NE(cut.Said.find("error: frame 2: node \"o:write\" (ImageWriter): cannot write \"cut/o/x.0002.exr\""),
    std::string::npos)
    << cut.Said;
  EXPECT_NE(cut.Said.find("--resume goes on after frame 1"), std::string::npos) << cut.Said;
  EXPECT_TRUE(this->Temporary().empty());
  fs::remove(this->Directory / "cut/o/x.0002.exr");
  // No room for the checkpoint alone is a warning.
  const Outcome resumed = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "cut", "--resume" });
  EXPECT_EQ(resumed.Status, 0) << resumed.Said;
  for (int frame = 0; frame < 4; ++frame)
  {
    const std::string name = "o/x.000" + std::to_string(frame) + ".exr";
    const Outcome same =
      RunQuell(this->Directory, { "compare", "cut/" + name, "whole/" + name, "--metric", "RMSE", "--max", "RMSE=0" });
    EXPECT_EQ(same.Status, 0) << name << same.Said;
  }
}

TEST_F(Faults, NoRoomForStatisticsIsAFailure)
{
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x.png\"/>"));
  this->Write("s.json", "of before");
  ASSERT_EQ(RunQuell(this->Directory, { "run", "p.xml", "--quiet" }).Status, 0);
  // Many nodes make the statistics longer than the picture.
  std::string nodes;
  for (int i = 0; i < 30; ++i)
    nodes += "<node id=\"n" + std::to_string(i) + "\" type=\"Sum\"><input port=\"radiance\" from=\"" +
             (i ? "n" + std::to_string(i - 1) : std::string("pt")) + "\"/></node>";
  this->Write("p.xml", Box(nodes + "<output name=\"o\" from=\"n29\" file=\"x.png\"/>"));
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--stats", "s.json" },
    FileLimit(fs::file_size(this->Directory / "x.png") + 500));
  EXPECT_EQ(outcome.Status, 1) << outcome.Said;
  EXPECT_NE(outcome.Said.find("--stats s.json cannot be written"), std::string::npos) << outcome.Said;
  EXPECT_EQ(this->Read("s.json"), "of before");
  EXPECT_TRUE(this->Temporary().empty());
}

TEST_F(Faults, PipesAreNotReplaced)
{
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x.png\"/>"));
  const std::string pipe = (this->Directory / "pipe").string(), picture = (this->Directory / "x.png").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const int reader = open(pipe.c_str(), O_RDWR | O_NONBLOCK);
  ASSERT_GE(reader, 0);
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--stats", "pipe" });
  EXPECT_EQ(outcome.Status, 0) << outcome.Said;
  EXPECT_TRUE(fs::is_fifo(pipe));
  std::string text(65536, ' ');
  const ssize_t got = read(reader, text.data(), text.size());
  close(reader);
  ASSERT_GT(got, 0);
  EXPECT_NE(text.find("\"nodes\""), std::string::npos);
  fs::remove(picture);
  ASSERT_EQ(mkfifo(picture.c_str(), 0600), 0);
  const Outcome refused = RunQuell(this->Directory, { "run", "p.xml", "--quiet" });
  EXPECT_EQ(refused.Status, 2) << refused.Said;
  EXPECT_NE(refused.Said.find("it is a device or a pipe"), std::string::npos) << refused.Said;
  EXPECT_TRUE(fs::is_fifo(picture));
}

TEST_F(Faults, StandardOutputThatIsGone)
{
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x.####.exr\"/>", 3));
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml" },
    []
    {
      int ends[2];
      if (pipe(ends) == 0)
      {
        dup2(ends[1], STDOUT_FILENO);
        dup2(ends[1], STDERR_FILENO);
        close(ends[0]);
        close(ends[1]);
      }
    });
  EXPECT_EQ(outcome.Status, 1) << "no signal, and not silently done";
  EXPECT_TRUE(this->Exists("x.0000.exr") && this->Exists("x.0001.exr") && this->Exists("x.0002.exr"));
  EXPECT_TRUE(this->Temporary().empty());
}

TEST_F(Faults, ADirectoryThatMayNotBeWritten)
{
  if (!this->NobodyCanRun())
    GTEST_SKIP() << "a user without rights cannot run the program here";
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x.exr\"/>"));
  fs::create_directories(this->Directory / "mine");
  fs::permissions(this->Directory / "mine", fs::perms::owner_read | fs::perms::owner_exec | fs::perms::others_read |
                                              fs::perms::others_exec | fs::perms::group_read | fs::perms::group_exec);
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "mine" }, &BeNobody);
  EXPECT_TRUE(outcome.Status == 2 || outcome.Status == 1) << outcome.Said;
  EXPECT_NE(outcome.Said.find("no files can be made in"), std::string::npos) << outcome.Said;
  EXPECT_NE(outcome.Said.find("; choose another place"), std::string::npos) << outcome.Said;
  EXPECT_TRUE(fs::is_empty(this->Directory / "mine"));
}

TEST_F(Faults, AFileThatMayNotBeWritten)
{
  if (!this->NobodyCanRun())
    GTEST_SKIP() << "a user without rights cannot run the program here";
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x.####.png\"/>", 2));
  this->Write("x.0001.png", "of before");
  fs::permissions(this->Directory / "x.0001.png", fs::perms::owner_read | fs::perms::others_read);
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet" }, &BeNobody);
  EXPECT_EQ(outcome.Status, 1) << outcome.Said;
  EXPECT_NE(
    outcome.Said.find("cannot write \"x.0001.png\": the file that is there may not be written"), std::string::npos)
    << outcome.Said;
  EXPECT_EQ(this->Read("x.0001.png"), "of before");
  EXPECT_TRUE(this->Exists("x.0000.png"));
  EXPECT_TRUE(this->Temporary().empty());
}

/// Where nobody, not even root, makes files.
TEST_F(Faults, APlaceWithoutFiles)
{
  if (!fs::is_directory("/proc/self"))
    GTEST_SKIP() << "no /proc";
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"x.exr\"/>"));
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "/proc/self" });
  EXPECT_TRUE(outcome.Status == 1 || outcome.Status == 2) << outcome.Said;
  EXPECT_NE(outcome.Said.find("/proc/self"), std::string::npos) << outcome.Said;
  EXPECT_NE(outcome.Said.find("; choose another place"), std::string::npos) << outcome.Said;
}

TEST_F(Faults, AnInputFrameThatVanishes)
{
  this->Write("make.xml", Box("<output name=\"o\" from=\"pt\" file=\"in.####.exr\"/>", 4));
  ASSERT_EQ(RunQuell(this->Directory, { "run", "make.xml", "--quiet" }).Status, 0);
  this->Write("p.xml",
    "<pipeline version=\"1\"><time count=\"4\"/><node id=\"r\" type=\"ImageReader\"><property name=\"File\" "
    "value=\"in.####.exr\"/></node><output name=\"o\" from=\"r\" file=\"out.####.exr\"/></pipeline>");
  // When frame 0 is told of, frame 3 is removed under the program's eyes.
  bool removed = false;
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml" }, {},
    [&](pid_t, const std::string& said)
    {
      if (!removed && said.find("frame 0") != std::string::npos)
        removed = fs::remove(this->Directory / "in.0003.exr");
    });
  ASSERT_TRUE(removed) << outcome.Said;
  // The program may have read it already; then it has all four.
  if (outcome.Status != 0)
  {
    EXPECT_EQ(outcome.Status, 1) << outcome.Said;
    EXPECT_NE(outcome.Said.find("frame 3"), std::string::npos) << outcome.Said;
    EXPECT_NE(outcome.Said.find("in.0003.exr"), std::string::npos) << outcome.Said;
    EXPECT_FALSE(this->Exists("out.0003.exr"));
  }
  for (int frame = 0; frame < 3; ++frame)
    EXPECT_NO_THROW(ReadImageFile((this->Directory / ("out.000" + std::to_string(frame) + ".exr")).string()));
  EXPECT_TRUE(this->Temporary().empty());
}

TEST_F(Faults, AnOutputDirectoryThatVanishesIsMadeAgain)
{
  this->Write("p.xml", Box("<output name=\"o\" from=\"pt\" file=\"o/x.####.exr\"/>", 4));
  bool removed = false;
  const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml" }, {},
    [&](pid_t, const std::string& said)
    {
      if (!removed && said.find("frame 0") != std::string::npos)
      {
        std::error_code code;
        removed = fs::remove_all(this->Directory / "o", code) > 0;
      }
    });
  ASSERT_TRUE(removed) << outcome.Said;
  // A frame that was being written just then is an error that says so; all others are there or went with the directory.
  EXPECT_TRUE(
    outcome.Status == 0 || (outcome.Status == 1 && outcome.Said.find("cannot write \"o/x.000") != std::string::npos))
    << outcome.Said;
  EXPECT_TRUE(this->Temporary().empty());
  const Outcome again = RunQuell(this->Directory, { "run", "p.xml", "--resume" });
  EXPECT_EQ(again.Status, 0) << again.Said;
  for (int frame = 0; frame < 4; ++frame)
    EXPECT_NO_THROW(ReadImageFile((this->Directory / ("o/x.000" + std::to_string(frame) + ".exr")).string()));
}

namespace
{
/// The shim raises `signal` at the k-th call that writes, renames or makes a frame's file; or fails that call.
std::function<void()> Shim(const std::string& what, int k)
{
  return [what, k]
  {
    setenv("LD_PRELOAD", QUELL_FAULT_SHIM, 1);
    setenv("QUELL_FAULT", (what + ":" + std::to_string(k)).c_str(), 1);
  };
}
}

class Moments : public Faults
{
protected:
  void SetUp() override
  {
    this->Faults::SetUp();
    this->Write(
      "p.xml", Box("<node id=\"t\" type=\"TemporalAntialias\"><input port=\"radiance\" from=\"pt:radiance\"/><input "
                   "port=\"history\" from=\"t:radiance\" delay=\"1\"/></node><output name=\"o\" from=\"t:radiance\" "
                   "file=\"x.####.exr\"/><output name=\"p\" from=\"pt:radiance\" file=\"y.####.png\"/>",
                 5));
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "the sanitizer must be preloaded first";
#endif
    this->Reference = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "whole" });
    ASSERT_EQ(this->Reference.Status, 0) << this->Reference.Said;
  }
  /// Whole files only, and a resumed run ends with the frames of one that was not disturbed.
  void ExpectGood(const Outcome& outcome, const std::string& out)
  {
    EXPECT_TRUE(this->Temporary().empty()) << outcome.Said;
    for (int frame = 0; frame < 5; ++frame)
    {
      const std::string name = out + "/x.000" + std::to_string(frame) + ".exr";
      if (this->Exists(name))
      {
        EXPECT_NO_THROW(ReadImageFile((this->Directory / name).string())) << outcome.Said;
      }
    }
    const Outcome resumed = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--resume", "--out", out });
    EXPECT_EQ(resumed.Status, 0) << outcome.Said << resumed.Said;
    for (int frame = 0; frame < 5; ++frame)
    {
      const std::string name = "/x.000" + std::to_string(frame) + ".exr";
      auto read = [&](const std::string& file)
      {
        const auto image = ReadImageFile((this->Directory / file).string());
        auto a = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray("radiance"));
        return std::vector<float>(a->GetPointer(0), a->GetPointer(0) + a->GetNumberOfValues());
      };
      EXPECT_TRUE(read(out + name) == read("whole" + name)) << name << outcome.Said << resumed.Said;
    }
  }
  Outcome Reference;
};

TEST_F(Moments, SignalsAtAnyMoment)
{
  std::mt19937 random(20261122);
  std::uniform_int_distribution<int> at(1, 45);
  int interrupted = 0;
  for (const int signal : { SIGINT, SIGTERM })
    for (int i = 0; i < 3; ++i)
    {
      const int k = at(random);
      const std::string out = "s" + std::to_string(signal) + "-" + std::to_string(i);
      SCOPED_TRACE("signal " + std::to_string(signal) + " at event " + std::to_string(k));
      const Outcome outcome = RunQuell(
        this->Directory, { "run", "p.xml", "--quiet", "--out", out }, Shim("signal" + std::to_string(signal), k));
      interrupted += outcome.Status == 130;
      // A run that was as good as done has no reason to stop.
      EXPECT_TRUE(outcome.Status == 130 || outcome.Status == 0) << outcome.Said;
      EXPECT_EQ(outcome.Status == 130, outcome.Said.find("interrupted") != std::string::npos) << outcome.Said;
      this->ExpectGood(outcome, out);
    }
  EXPECT_GT(interrupted, 2) << "the signals miss the run";
}

// Not only where files are made: before any allocation between the moment that signals are caught and the end, on any
// thread; every second time the user insists.
TEST_F(Moments, SignalsBeforeAnyAllocation)
{
  const Outcome counted = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", "counted" },
    []
    {
      setenv("LD_PRELOAD", QUELL_FAULT_SHIM, 1);
      setenv("QUELL_FAULT_COUNT", "allocations", 1);
    });
  ASSERT_EQ(counted.Status, 0) << counted.Said;
  const long allocations = std::strtol(this->Read("allocations").c_str(), nullptr, 10);
  ASSERT_GT(allocations, 1000);
  std::mt19937 random(7112026);
  int interrupted = 0;
  for (int i = 0; i < 6; ++i)
  {
    const int signal = i % 4 < 2 ? SIGINT : SIGTERM;
    const long k = 1 + long(random() % std::uint32_t(allocations)), again = k + 1 + long(random() % 2000);
    const std::string what = std::to_string(k) + (i % 2 ? ":" + std::to_string(again) : std::string());
    const std::string out = "m" + std::to_string(i);
    SCOPED_TRACE("signal " + std::to_string(signal) + " at allocation " + what);
    const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", out },
      [&]
      {
        setenv("LD_PRELOAD", QUELL_FAULT_SHIM, 1);
        setenv("QUELL_FAULT", ("moment" + std::to_string(signal) + ":" + what).c_str(), 1);
      });
    interrupted += outcome.Status == 130;
    EXPECT_TRUE(outcome.Status == 130 || outcome.Status == 0) << outcome.Signal << outcome.Said;
    EXPECT_EQ(outcome.Status == 130, outcome.Said.find("interrupted") != std::string::npos) << outcome.Said;
    this->ExpectGood(outcome, out);
  }
  EXPECT_GT(interrupted, 2) << "the signals miss the run";
}

TEST_F(Moments, WritesThatFail)
{
  std::mt19937 random(7);
  std::uniform_int_distribution<int> at(1, 30);
  int failed = 0;
  for (const char* what : { "nospace", "rename" })
    for (int i = 0; i < 3; ++i)
    {
      const int k = std::string(what) == "rename" ? 1 + i * 2 : at(random);
      const std::string out = std::string(what) + std::to_string(i);
      SCOPED_TRACE(what + std::string(" at event ") + std::to_string(k));
      const Outcome outcome = RunQuell(this->Directory, { "run", "p.xml", "--quiet", "--out", out }, Shim(what, k));
      EXPECT_TRUE(outcome.Status == 1 || outcome.Status == 0) << outcome.Said;
      failed += outcome.Status == 1;
      if (outcome.Status == 1)
      {
        EXPECT_NE(outcome.Said.find(std::strerror(ENOSPC)), std::string::npos) << outcome.Said;
      }
      this->ExpectGood(outcome, out);
    }
  EXPECT_GT(failed, 2) << "nothing fails";
}
