// SPDX-License-Identifier: BSD-3-Clause
#ifndef RunProgram_h
#define RunProgram_h

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

struct Outcome
{
  int Status = -1; ///< exit status; -1: ended by a signal
  int Signal = 0;
  std::string Said; ///< standard output and error
};

/// Runs quell in `directory`; `before` in the child, before the program. `watch` gets the child and all that it said so
/// far, whenever it says something.
inline Outcome RunQuell(const std::filesystem::path& directory, std::vector<std::string> arguments,
  const std::function<void()>& before = {}, const std::function<void(pid_t, const std::string&)>& watch = {})
{
  int ends[2];
  if (pipe(ends) != 0)
    return {};
  arguments.insert(arguments.begin(), QUELL_PROGRAM);
  std::vector<char*> argv;
  for (std::string& a : arguments)
    argv.push_back(&a[0]);
  argv.push_back(nullptr);
  const pid_t child = fork();
  if (child == 0)
  {
    dup2(ends[1], STDOUT_FILENO);
    dup2(ends[1], STDERR_FILENO);
    close(ends[0]);
    close(ends[1]);
    if (chdir(directory.c_str()) == 0)
    {
      if (before)
        before();
      execv(argv[0], argv.data());
    }
    _exit(127);
  }
  close(ends[1]);
  Outcome outcome;
  std::array<char, 4096> buffer;
  ssize_t n;
  while ((n = read(ends[0], buffer.data(), buffer.size())) > 0)
  {
    outcome.Said.append(buffer.data(), std::size_t(n));
    if (watch)
      watch(child, outcome.Said);
  }
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  outcome.Status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  outcome.Signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  return outcome;
}

/// A directory of the test's own.
class InDirectory : public testing::Test
{
protected:
  void SetUp() override
  {
    std::string pattern = (std::filesystem::temp_directory_path() / "quell-fault-XXXXXX").string();
    ASSERT_NE(mkdtemp(&pattern[0]), nullptr);
    this->Directory = pattern;
  }
  void TearDown() override
  {
    std::error_code code;
    std::filesystem::permissions(this->Directory, std::filesystem::perms::owner_all, code);
    std::filesystem::remove_all(this->Directory, code);
  }

  void Write(const std::string& name, const std::string& text) const
  {
    std::filesystem::create_directories((this->Directory / name).parent_path());
    std::ofstream(this->Directory / name, std::ios::binary) << text;
  }
  std::string Read(const std::string& name) const
  {
    std::ifstream in(this->Directory / name, std::ios::binary);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
  }
  bool Exists(const std::string& name) const { return std::filesystem::exists(this->Directory / name); }
  /// Whatever is there, sorted; directories too.
  std::vector<std::string> List() const
  {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(this->Directory))
      names.push_back(std::filesystem::relative(entry.path(), this->Directory).string());
    std::sort(names.begin(), names.end());
    return names;
  }
  std::vector<std::string> Temporary() const
  {
    std::vector<std::string> names;
    for (const std::string& name : this->List())
      if (std::filesystem::path(name).extension() == ".part")
        names.push_back(name);
    return names;
  }
  /// A box, traced; `more` are nodes and outputs.
  static std::string Box(const std::string& more, int frames = 1, int size = 24)
  {
    const std::string s = std::to_string(size);
    return "<pipeline version=\"1\">\n<variable name=\"name\" type=\"string\" default=\"x\"/>\n<time count=\"" +
           std::to_string(frames) +
           "\"/>\n<node id=\"pt\" type=\"PathTraceSource\"><property name=\"Scene\" value=\"" QUELL_SOURCE_DIR
           "/Data/Scenes/cornell-box.gltf\"/><property name=\"Width\" value=\"" +
           s + "\"/><property name=\"Height\" value=\"" + s + "\"/></node>\n" + more + "</pipeline>\n";
  }

  std::filesystem::path Directory;
};

#endif
