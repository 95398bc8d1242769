// SPDX-License-Identifier: BSD-3-Clause
// What a pipeline file cannot do: every claim of Documentation/security.md.
#include "AllStages.h"
#include "RunProgram.h"

#include "quellImageFile.h"
#include "quellMemoryLimits.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"
#include "vtkQuellStage.h"

#include <cstddef>
#include <cstring>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <set>
#include <sys/prctl.h>
#include <sys/syscall.h>

using namespace quell;
namespace fs = std::filesystem;

namespace
{
class Security : public InDirectory
{
protected:
  void SetUp() override
  {
    this->InDirectory::SetUp();
    fs::create_directories(this->Directory / "work/sub");
    fs::create_directories(this->Directory / "elsewhere");
    this->Work = this->Directory / "work";
  }
  /// A run in work/ that has to be refused and to leave everything as it was.
  void ExpectRefused(const std::string& pipeline, std::vector<std::string> more = {})
  {
    this->Write("work/p.xml", pipeline);
    const std::vector<std::string> before = this->List();
    std::vector<std::string> arguments{ "run", "p.xml", "--quiet" };
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = RunQuell(this->Work, arguments);
    EXPECT_EQ(outcome.Status, 2) << outcome.Said;
    EXPECT_NE(outcome.Said.find("lies outside of the directory for output files, "), std::string::npos) << outcome.Said;
    EXPECT_NE(outcome.Said.find("--allow-outside"), std::string::npos) << outcome.Said;
    EXPECT_NE(outcome.Said.find("p.xml:"), std::string::npos) << outcome.Said;
    EXPECT_EQ(this->List(), before);
  }
  static std::string Output(const std::string& file)
  {
    return Box("<output name=\"x\" from=\"pt\" file=\"" + file + "\"/>", 1, 8);
  }
  std::string Elsewhere() const { return (this->Directory / "elsewhere").string(); }

  fs::path Work;
};
}

TEST_F(Security, OutputsStayInTheOutputDirectory)
{
  for (const std::string& file : { this->Elsewhere() + "/x.exr", std::string("../elsewhere/x.exr"),
         std::string("sub/../../elsewhere/x.exr"), std::string("new/../../elsewhere/x.exr"), std::string("../x.exr"),
         std::string("////") + this->Elsewhere() + "//x.####.exr" })
  {
    SCOPED_TRACE(file);
    this->ExpectRefused(Output(file));
    this->ExpectRefused(Output(file), { "--out", "sub" });
  }
  // The same below the directory is no crime.
  this->Write("work/p.xml", Output("sub/../new/x.exr"));
  EXPECT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet" }).Status, 0);
  EXPECT_TRUE(this->Exists("work/new/x.exr"));
}

TEST_F(Security, VariablesBuildNoWayOut)
{
  this->ExpectRefused(
    "<pipeline version=\"1\"><variable name=\"up\" type=\"string\" default=\"..\"/><variable name=\"to\" "
    "type=\"string\" default=\"$(up)/elsewhere\"/>" +
    Output("$(to)/x.exr").substr(std::strlen("<pipeline version=\"1\">")));
  this->ExpectRefused(Output("$(name)/x.exr"), { "-D", "name=../elsewhere" });
}

TEST_F(Security, TemplatesAndIncludesBuildNoWayOut)
{
  this->Write("work/library.xml", "<library version=\"1\"/>");
  this->Write("work/t.xml",
    "<pipeline version=\"1\"><template name=\"t\"><parameter name=\"to\" type=\"string\" default=\"..\"/><port "
    "name=\"in\"/><node id=\"w\" type=\"ImageWriter\"><input port=\"layer\" from=\"@in\"/><property name=\"File\" "
    "value=\"$(to)/elsewhere/x.exr\"/></node><port name=\"out\" from=\"w:radiance\"/></template></pipeline>");
  this->ExpectRefused("<pipeline version=\"1\"><include file=\"t.xml\"/>" +
                      Box("<instance id=\"i\" template=\"t\"><input port=\"in\" from=\"pt\"/></instance>", 1, 8)
                        .substr(std::strlen("<pipeline version=\"1\">")));
}

TEST_F(Security, WriterNodesStayInTheOutputDirectoryToo)
{
  this->ExpectRefused(
    Box("<node id=\"w\" type=\"ImageWriter\"><input port=\"layer\" from=\"pt\"/><property name=\"File\" "
        "value=\"../elsewhere/x.exr\"/></node>",
      1, 8));
}

TEST_F(Security, SymbolicLinksLeadNowhere)
{
  fs::create_directory_symlink("../elsewhere", this->Work / "link");
  this->ExpectRefused(Output("link/x.exr"));
  this->ExpectRefused(Output("sub/../link/new/x.exr"));
  // A link in the place of the file is replaced, not followed.
  this->Write("elsewhere/precious", "mine");
  fs::create_symlink("../elsewhere/precious", this->Work / "x.exr");
  this->Write("work/p.xml", Output("x.exr"));
  EXPECT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet" }).Status, 0);
  EXPECT_EQ(this->Read("elsewhere/precious"), "mine");
  EXPECT_FALSE(fs::is_symlink(this->Work / "x.exr"));
}

TEST_F(Security, WhatTheUserSaysIsObeyed)
{
  this->Write("work/p.xml", Output(this->Elsewhere() + "/x.exr"));
  EXPECT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet", "--allow-outside" }).Status, 0);
  EXPECT_TRUE(this->Exists("elsewhere/x.exr"));
  EXPECT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet", "--output", "x=../elsewhere/y.exr" }).Status, 0);
  EXPECT_TRUE(this->Exists("elsewhere/y.exr"));
  EXPECT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet", "--out", "../elsewhere" }).Status, 0)
    << "told to write there, by whatever name";
  EXPECT_EQ(RunQuell(this->Work, { "check", "p.xml" }).Status, 2);
  EXPECT_EQ(RunQuell(this->Work, { "check", "p.xml", "--allow-outside" }).Status, 0);
  EXPECT_EQ(RunQuell(this->Work, { "explain", "p.xml" }).Status, 2);
}

TEST_F(Security, APipelineInAnImageIsNoBetter)
{
  this->Write("work/p.xml", Output(this->Elsewhere() + "/x.exr"));
  ASSERT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet", "--allow-outside" }).Status, 0);
  fs::rename(this->Directory / "elsewhere/x.exr", this->Work / "given.exr");
  const Outcome outcome = RunQuell(this->Work, { "run", "given.exr", "--quiet" });
  EXPECT_EQ(outcome.Status, 2) << outcome.Said;
  EXPECT_FALSE(this->Exists("elsewhere/x.exr"));
  // Verifying makes the picture again, but nowhere that lasts.
  const std::vector<std::string> before = this->List();
  const Outcome verified = RunQuell(this->Work, { "verify", "given.exr", "--quiet" });
  EXPECT_EQ(verified.Status, 0) << verified.Said;
  EXPECT_EQ(this->List(), before);
}

TEST_F(Security, CheckpointsStayWithTheOutputs)
{
  this->Write(
    "work/p.xml", Box("<node id=\"t\" type=\"TemporalAntialias\"><input port=\"radiance\" from=\"pt:radiance\"/><input "
                      "port=\"history\" from=\"t:radiance\" delay=\"1\"/></node><output name=\"o\" from=\"t:radiance\" "
                      "file=\"sub/x.####.exr\"/>",
                    3, 8));
  // A directory where frame 2 should be ends the run, which leaves a checkpoint.
  fs::create_directories(this->Work / "sub/x.0002.exr");
  EXPECT_EQ(RunQuell(this->Work, { "run", "p.xml", "--quiet" }).Status, 1);
  EXPECT_EQ(
    this->List(), (std::vector<std::string>{ "elsewhere", "work", "work/p.xml", "work/sub", "work/sub/p.checkpoint",
                    "work/sub/x.0000.exr", "work/sub/x.0001.exr", "work/sub/x.0002.exr" }));
}

TEST_F(Security, OnlyTheWriterWrites)
{
  // A new stage that takes a file to write must be added to the checks of outputs, and here.
  std::set<std::string> sinks;
  for (const std::string& type : Registry().Types())
  {
    const auto stage = Registry().Create(type);
    const StageDescription& d = stage->GetDescription();
    if (d.Sink)
      sinks.insert(type);
    if (!d.Sink)
    {
      EXPECT_FALSE(d.FindProperty("File") && d.FindProperty("File")->Kind == Property::Type::String) << type;
    }
  }
  EXPECT_EQ(sinks, (std::set<std::string>{ "CompareFrames", "CompareImages", "ImageWriter" }));
}

namespace
{
/// From here on the process ends when it, or a thread of it, starts a program or opens a connection.
bool ForbidProgramsAndNetwork()
{
#if defined(__x86_64__)
  std::vector<sock_filter> filter{ BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)) };
  for (const int call :
    { SYS_execve, SYS_execveat, SYS_socket, SYS_connect, SYS_bind, SYS_ptrace, SYS_fork, SYS_vfork })
  {
    filter.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, unsigned(call), 0, 1));
    filter.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS));
  }
  filter.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog program{ static_cast<unsigned short>(filter.size()), filter.data() };
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
#else
  return false;
#endif
}

/// Exit status of a child that does `work` without the right to start programs; 1000 + signal where it was ended.
template <class F>
int Confined(F work)
{
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0)
    _exit(ForbidProgramsAndNetwork() ? work() : 77);
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}
}

TEST_F(Security, NoPipelineStartsAProgram)
{
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers start programs of their own";
#endif
  const int control = Confined(
    []
    {
      execl("/bin/true", "true", static_cast<char*>(nullptr));
      return 0;
    });
  if (control == 77)
    GTEST_SKIP() << "this system has no such filter";
  ASSERT_EQ(control, 1000 + SIGSYS) << "the filter holds nothing back";
  int ran = 0;
  for (const auto& entry : fs::directory_iterator(QUELL_SOURCE_DIR "/Data/Pipelines"))
  {
    const std::string name = entry.path().filename().string();
    if (entry.path().extension() != ".xml" || name == "library.xml")
      continue;
    SCOPED_TRACE(name);
    const std::string out = (this->Directory / name).string();
    EXPECT_EQ(Confined(
                [&]
                {
                  GraphOptions options;
                  options.OutputDirectory = out;
                  Diagnostics messages;
                  const std::string file = entry.path().string();
                  const auto document = ReadPipelineFile(file, messages);
                  for (const PipelineVariable& v : document->Variables)
                    for (const char* size : { "width", "height", "spp" })
                      if (v.Name.Value == size)
                        options.Defines.push_back({ size, size[0] == 's' ? "1" : "16" });
                  const auto graph = LoadPipeline(file, Registry(), options, messages);
                  if (!graph)
                    return 3;
                  PipelineExecutor executor(graph, Registry());
                  const TickResult result = executor.RunTick(graph->Ticks.First);
                  if (!result.Ok)
                    std::fprintf(stderr, "%s\n", result.Error.c_str());
                  return result.Ok ? 0 : 4;
                }),
      0);
    ++ran;
  }
  EXPECT_GT(ran, 8);
}

TEST_F(Security, SizesAloneDoNotFillTheMemory)
{
  // Address space far below what is asked for: only a check before asking makes a sentence of it. (Sanitizers need
  // terabytes of addresses.)
  const auto small = []
  {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    const rlimit limit{ rlim_t(3) << 30, rlim_t(3) << 30 };
    setrlimit(RLIMIT_AS, &limit);
#endif
  };
  const auto refuse = [&](const std::string& pipeline, std::vector<std::string> more, int status, const char* words)
  {
    this->Write("work/p.xml", pipeline);
    std::vector<std::string> arguments{ "run", "p.xml", "--quiet" };
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = RunQuell(this->Work, arguments, small);
    EXPECT_EQ(outcome.Status, status) << outcome.Said;
    EXPECT_NE(outcome.Said.find(words), std::string::npos) << outcome.Said;
    EXPECT_FALSE(this->Exists("work/x.exr"));
  };
  const std::string size = "32768";
  // With history no bands help.
  const std::string history =
    Box("<node id=\"t\" type=\"TemporalAntialias\"><input port=\"radiance\" from=\"pt:radiance\"/>"
        "<input port=\"history\" from=\"t:radiance\" delay=\"1\"/></node><output name=\"o\" "
        "from=\"t:radiance\" file=\"x.exr\"/>");
  refuse(history, { "--set", "pt.Width=" + size, "--set", "pt.Height=" + size }, 2, "--memory MB allows more");
  refuse(history, { "--set", "pt.Width=2048", "--set", "pt.Height=2048", "--memory", "50" }, 2,
    "--memory 50: the run needs ");
  // Many arrays of a large frame.
  std::string layers = "<output name=\"o\" from=\"pt\" file=\"x.exr\">";
  for (int i = 1; i <= 64; ++i)
    layers += "<layer from=\"pt:bounce" + std::to_string(i) + "\"/>";
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) // it would take what the machine has
  refuse(Box(layers + "</output>"), { "--set", "pt.Width=" + size, "--set", "pt.Height=" + size, "--memory", "1e9" }, 1,
    "memory");
#endif
  // Beyond the range of the property: the sentence names the range.
  refuse(Box("<output name=\"o\" from=\"pt\" file=\"x.exr\"/>"), { "--set", "pt.Width=100000" }, 2, "32768");
  // A scene that is larger than allowed.
  refuse(Box("<output name=\"o\" from=\"pt\" file=\"x.exr\"/>"), { "--scene-memory", "0.002" }, 1,
    "more than the 0.002 MB that a scene may have; use a smaller scene, or allow more with --scene-memory MB");
}

TEST_F(Security, LimitsHoldForPixelsAndClaims)
{
  const std::uint64_t before = PixelMemoryInUse();
  SetPixelMemoryLimit(before + 1000000);
  {
    const PixelMemoryClaim claim(900000, "a test");
    EXPECT_EQ(PixelMemoryInUse(), before + 900000);
    try
    {
      const PixelMemoryClaim more(200000, "a large film");
      ADD_FAILURE() << "the limit does not hold";
    }
    catch (const StageError& e)
    {
      EXPECT_NE(std::string(e.what()).find("a large film"), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find("--memory MB"), std::string::npos) << e.what();
    }
    EXPECT_THROW(PixelMemoryClaim(~std::uint64_t(0), "everything"), StageError);
  }
  EXPECT_EQ(PixelMemoryInUse(), before);
  SetPixelMemoryLimit(0);
  EXPECT_EQ(PixelMemoryLimit(), MachineMemory() / 4 * 3);
}

TEST_F(Security, DevicesAndPipesAreNotRead)
{
  for (const char* device : { "/dev/zero", "/dev/tty", "/dev/stdin" })
  {
    if (!fs::exists(device))
      continue;
    this->Write(
      "work/p.xml", "<pipeline version=\"1\"><node id=\"r\" type=\"ImageReader\"><property name=\"File\" value=\"" +
                      std::string(device) + "\"/></node><output name=\"o\" from=\"r\" file=\"x.exr\"/></pipeline>");
    const Outcome outcome = RunQuell(this->Work, { "run", "p.xml", "--quiet" });
    EXPECT_EQ(outcome.Status, 2) << outcome.Said;
    EXPECT_NE(outcome.Said.find(device), std::string::npos) << outcome.Said;
    EXPECT_FALSE(this->Exists("work/x.exr"));
  }
}
