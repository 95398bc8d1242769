// SPDX-License-Identifier: BSD-3-Clause
// The k-th allocation of a frame fails: the frame fails with a sentence, or is right all the same; nothing half-written
// is left, and the same executor makes the same frame afterwards.
#include "AllStages.h"
#include "RunProgram.h"

#include "quellImageFile.h"
#include "quellMemoryLimits.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkObject.h"
#include "vtkPointData.h"

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <map>
#include <new>
#include <set>
#include <sys/mman.h>

using namespace quell;
namespace fs = std::filesystem;

namespace
{
std::atomic<long> allocations{ 0 }, failing{ -1 };
std::atomic<bool> armed{ false };
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
namespace
{
bool Fails()
{
  if (!armed.load(std::memory_order_relaxed))
    return false;
  return allocations.fetch_add(1) + 1 == failing.load(std::memory_order_relaxed);
}

void* Allocate(std::size_t size)
{
  if (Fails())
    throw std::bad_alloc();
  if (void* p = std::malloc(size ? size : 1))
    return p;
  throw std::bad_alloc();
}
void* Allocate(std::size_t size, std::align_val_t alignment)
{
  const std::size_t a = std::size_t(alignment);
  if (Fails())
    throw std::bad_alloc();
  if (void* p = std::aligned_alloc(a, (size + a - 1) / a * a))
    return p;
  throw std::bad_alloc();
}
}

void* operator new(std::size_t size)
{
  return Allocate(size);
}
void* operator new[](std::size_t size)
{
  return Allocate(size);
}
void* operator new(std::size_t size, std::align_val_t alignment)
{
  return Allocate(size, alignment);
}
void* operator new[](std::size_t size, std::align_val_t alignment)
{
  return Allocate(size, alignment);
}
void operator delete(void* p) noexcept
{
  std::free(p);
}
void operator delete[](void* p) noexcept
{
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept
{
  std::free(p);
}
void operator delete[](void* p, std::size_t) noexcept
{
  std::free(p);
}
void operator delete(void* p, std::align_val_t) noexcept
{
  std::free(p);
}
void operator delete[](void* p, std::align_val_t) noexcept
{
  std::free(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept
{
  std::free(p);
}
void operator delete[](void* p, std::size_t, std::align_val_t) noexcept
{
  std::free(p);
}
#endif

namespace
{
/// What the child found out, in memory that both processes see.
struct Finding
{
  long Allocations = 0;
  int Failed = 0;               ///< the frame did
  std::uint64_t Frames[2] = {}; ///< hashes of the frame's pixels and of the next one's
  char Text[600] = {};
};

class Allocation : public InDirectory
{
protected:
  void SetUp() override
  {
    this->InDirectory::SetUp();
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "the sanitizer's allocator is in place";
#endif
    this->Shared =
      static_cast<Finding*>(mmap(nullptr, sizeof(Finding), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
    ASSERT_NE(this->Shared, MAP_FAILED);
    this->Write("p.xml",
      Box("<node id=\"b\" type=\"BilateralFilter\"><input port=\"radiance\" from=\"pt:radiance\"/><input "
          "port=\"normal\" from=\"pt:normal\"/></node><node id=\"t\" type=\"TemporalAntialias\"><input "
          "port=\"radiance\" from=\"b:radiance\"/><input port=\"history\" from=\"t:radiance\" delay=\"1\"/></node>"
          "<output name=\"o\" from=\"t:radiance\" file=\"" +
            this->Directory.string() +
            "/x.####.exr\"><layer from=\"pt:depth\"/></output><output name=\"p\" from=\"t\" "
            "file=\"" +
            this->Directory.string() + "/x.####.png\"/>",
        3, 12));
  }
  void TearDown() override
  {
    if (this->Shared && this->Shared != MAP_FAILED)
      munmap(this->Shared, sizeof(Finding));
    this->InDirectory::TearDown();
  }

  static std::uint64_t HashOf(const std::string& file)
  {
    const auto image = ReadImageFile(file);
    auto a = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray("radiance"));
    std::uint64_t hash = 14695981039346656037ull;
    const auto* bytes = reinterpret_cast<const unsigned char*>(a->GetPointer(0));
    for (std::size_t i = 0; i < std::size_t(a->GetNumberOfValues()) * sizeof(float); ++i)
      hash = (hash ^ bytes[i]) * 1099511628211ull;
    return hash;
  }

  void PixelsFail()
  {
    Diagnostics messages;
    const auto graph = LoadPipeline((this->Directory / "p.xml").string(), Registry(), {}, messages);
    ASSERT_TRUE(graph) << messages.ToText();
    const auto frames = [this]
    {
      return std::make_pair(
        HashOf((this->Directory / "x.0000.exr").string()), HashOf((this->Directory / "x.0001.exr").string()));
    };
    std::pair<std::uint64_t, std::uint64_t> clean;
    {
      PipelineExecutor executor(graph, Registry());
      for (int t : { 0, 1 })
        ASSERT_TRUE(executor.RunTick(t, TickMode::Frame).Ok);
      clean = frames();
    }
    const std::uint64_t before = PixelMemoryInUse(), step = 12 * 12 * sizeof(float) / 2;
    int failed = 0, tried = 0;
    std::set<std::string> nodes;
    for (const int tick : { 0, 1 })
      for (std::uint64_t bytes = 1, good = 0; good < 2; bytes += step)
      {
        SCOPED_TRACE(std::to_string(bytes) + " bytes in frame " + std::to_string(tick));
        PipelineExecutor executor(graph, Registry());
        if (tick == 1)
        {
          ASSERT_TRUE(executor.RunTick(0, TickMode::Frame).Ok);
        }
        SetPixelMemoryLimit((tick == 1 ? PixelMemoryInUse() : before) + bytes);
        const TickResult result = executor.RunTick(tick, TickMode::Frame);
        SetPixelMemoryLimit(0);
        ++tried;
        failed += !result.Ok;
        good = result.Ok ? good + 1 : 0;
        ASSERT_LT(tried, 1000) << "no frame is ever made";
        if (!result.Ok)
        {
          EXPECT_FALSE(result.Cancelled);
          EXPECT_NE(result.Error.find("--memory"), std::string::npos) << result.Error;
          nodes.insert(result.Error.substr(0, result.Error.find(')')));
        }
        ASSERT_TRUE(this->Temporary().empty());
        for (int t = tick; t < 2; ++t)
        {
          const TickResult again = executor.RunTick(t, TickMode::Frame);
          ASSERT_TRUE(again.Ok) << again.Error;
        }
        ASSERT_EQ(frames(), clean);
      }
    // The path tracer's are the most; so again with no more pixels from the moment on that a stage begins.
    std::set<std::string> begun;
    {
      PipelineExecutor executor(graph, Registry());
      executor.SetProgress([&](const std::string& node, double) { begun.insert(node); });
      ASSERT_TRUE(executor.RunTick(0, TickMode::Frame).Ok);
    }
    for (const std::string& where : begun)
    {
      SCOPED_TRACE("from " + where + " on");
      PipelineExecutor executor(graph, Registry());
      executor.SetProgress(
        [&](const std::string& node, double)
        {
          if (node == where)
            SetPixelMemoryLimit(1);
        });
      const TickResult result = executor.RunTick(0, TickMode::Frame);
      SetPixelMemoryLimit(0);
      executor.SetProgress({});
      if (!result.Ok)
      {
        EXPECT_NE(result.Error.find("--memory"), std::string::npos) << result.Error;
        nodes.insert(result.Error.substr(0, result.Error.find(')')));
      }
      ASSERT_TRUE(this->Temporary().empty());
      for (int t = 0; t < 2; ++t)
      {
        const TickResult again = executor.RunTick(t, TickMode::Frame);
        ASSERT_TRUE(again.Ok) << again.Error;
      }
      ASSERT_EQ(frames(), clean);
    }
    EXPECT_GT(failed, 10) << tried;
    EXPECT_GE(nodes.size(), 3u) << "whichever stage it is that finds nothing";
  }

  /// In a child: frame 0, then frame `tick` with the k-th allocation failing (0: none), then again without.
  int Child(long k, int tick)
  {
    std::memset(static_cast<void*>(this->Shared), 0, sizeof(Finding));
    std::fflush(nullptr);
    const pid_t child = fork();
    if (child == 0)
    {
      vtkObject::GlobalWarningDisplayOff();
      Diagnostics messages;
      const auto graph = LoadPipeline((this->Directory / "p.xml").string(), Registry(), {}, messages);
      if (!graph)
        _exit(20);
      const auto fail = [this](int status, const std::string& text)
      {
        text.copy(this->Shared->Text, sizeof this->Shared->Text - 1);
        _exit(status);
      };
      PipelineExecutor executor(graph, Registry());
      for (int t = 0; t < tick; ++t)
        if (!executor.RunTick(t, TickMode::Frame).Ok)
          _exit(21);
      allocations = 0;
      failing = k;
      TickResult result;
      try
      {
        armed = true;
        result = executor.RunTick(tick, TickMode::Frame);
        armed = false;
      }
      catch (const std::bad_alloc&)
      {
        armed = false;
        // Outside of any stage there is nobody to blame; whoever runs the frame says it.
        result.Error = "out of memory";
      }
      this->Shared->Allocations = allocations;
      if (!result.Ok)
      {
        this->Shared->Failed = 1;
        result.Error.copy(this->Shared->Text, sizeof this->Shared->Text - 1);
        if (result.Error.empty())
          fail(22, "a failure without words");
        if (result.Cancelled)
          fail(23, "a failure that calls itself cancelled: " + result.Error);
      }
      for (const auto& entry : fs::directory_iterator(this->Directory))
        if (entry.path().extension() == ".part")
          fail(24, "left behind: " + entry.path().string());
      const TickResult again = executor.RunTick(tick, TickMode::Frame);
      if (!again.Ok)
        fail(25, "afterwards: " + again.Error);
      if (!executor.RunTick(tick + 1, TickMode::Frame).Ok)
        fail(26, "the frame behind");
      // Here and not in the parent: libraries keep threads, which a child does not have.
      for (int t : { 0, 1 })
        this->Shared->Frames[t] = HashOf((this->Directory / ("x.000" + std::to_string(tick + t) + ".exr")).string());
      _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
  }

  Finding* Shared = nullptr;
};
}

// Pixels have an allocator of their own (arrays between stages, scratch, sums of the path tracer): whatever is asked
// for when the limit is reached fails, for limits that grow by less than the smallest array. The frame is an error that
// says so, and is made afterwards with the bits that it has without.
TEST_F(Allocation, ThePixelsOfAFrameFail)
{
  // In a child: other tests fork, and must find no threads here.
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0)
  {
    this->PixelsFail();
    std::fflush(nullptr);
    _exit(testing::Test::HasFailure() ? 1 : 0);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0) << "see above";
}

TEST_F(Allocation, TheKthOfAFrameFails)
{
  std::map<std::string, int> words;
  int failed = 0, tried = 0;
  for (const int tick : { 0, 1 })
  {
    ASSERT_EQ(this->Child(0, tick), 0) << this->Shared->Text;
    const long all = this->Shared->Allocations;
    ASSERT_GT(all, 100) << "the hook counts nothing";
    const std::uint64_t frames[2] = { this->Shared->Frames[0], this->Shared->Frames[1] };
    // The first ones one by one, then further and further apart: about fifty a frame.
    for (long k = 1; k <= all; k += 1 + k / 6)
    {
      SCOPED_TRACE(
        "allocation " + std::to_string(k) + " of " + std::to_string(all) + " in frame " + std::to_string(tick));
      ++tried;
      ASSERT_EQ(this->Child(k, tick), 0) << this->Shared->Text;
      failed += this->Shared->Failed;
      if (this->Shared->Failed)
        ++words[this->Shared->Text];
      ASSERT_EQ(this->Shared->Frames[0], frames[0]);
      ASSERT_EQ(this->Shared->Frames[1], frames[1]);
    }
  }
  EXPECT_GT(failed, tried / 2) << "most allocations matter";
  for (const auto& w : words)
  {
    EXPECT_NE(w.first.find("memory"), std::string::npos) << w.second << " times: " << w.first;
  }
}
