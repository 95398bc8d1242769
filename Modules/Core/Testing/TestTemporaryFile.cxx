// SPDX-License-Identifier: BSD-3-Clause
#include "quellTemporaryFile.h"

#include <gtest/gtest.h>

#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

namespace fs = std::filesystem;
using quell::TemporaryFile;

namespace
{
class TemporaryFiles : public testing::Test
{
protected:
  TemporaryFiles()
  {
    std::string pattern = (fs::temp_directory_path() / "quell-temporary-XXXXXX").string();
    this->Directory = mkdtemp(pattern.data());
  }
  ~TemporaryFiles() override { fs::remove_all(this->Directory); }

  void Put(const std::string& name, const std::string& text) const { std::ofstream(this->Directory / name) << text; }
  std::string Get(const std::string& name) const
  {
    std::ifstream file(this->Directory / name, std::ios::binary);
    return { std::istreambuf_iterator<char>(file), {} };
  }
  long Count() const { return std::distance(fs::directory_iterator(this->Directory), {}); }
  std::string Target(const std::string& name = "x") const { return (this->Directory / name).string(); }

  fs::path Directory;
};

TEST_F(TemporaryFiles, TheTargetChangesAtTheRename)
{
  this->Put("x", "of before");
  {
    TemporaryFile file(this->Target());
    EXPECT_EQ(file.Write("half of "), 0);
    EXPECT_EQ(file.Write("it"), 0);
    EXPECT_EQ(this->Count(), 2);
    EXPECT_EQ(this->Get("x"), "of before");
    EXPECT_EQ(file.Rename(), 0);
    EXPECT_EQ(this->Get("x"), "half of it");
    EXPECT_EQ(this->Count(), 1);
    this->Put("x", "of later");
  }
  EXPECT_EQ(this->Get("x"), "of later");
}

TEST_F(TemporaryFiles, NothingIsLeftWithoutARename)
{
  this->Put("x", "of before");
  {
    TemporaryFile file(this->Target());
    EXPECT_EQ(file.Write(std::string(100000, 'a')), 0);
    EXPECT_EQ(file.Close(), 0);
    EXPECT_EQ(this->Count(), 2);
  }
  EXPECT_EQ(this->Count(), 1);
  EXPECT_EQ(this->Get("x"), "of before");
}

// Below, at and above the size of the buffer, in pieces of every kind.
TEST_F(TemporaryFiles, PiecesArriveInTheirOrder)
{
  std::string all;
  TemporaryFile file(this->Target());
  for (const std::size_t bytes : { 1u, 65535u, 0u, 65536u, 7u, 65537u, 300000u, 1u, 40000u, 40000u })
  {
    const std::string piece(bytes, char('a' + all.size() % 23));
    all += piece;
    EXPECT_EQ(file.Write(piece), 0);
  }
  EXPECT_EQ(file.Rename(), 0);
  EXPECT_TRUE(this->Get("x") == all);
}

TEST_F(TemporaryFiles, ALinkThatWaitsIsNotFollowed)
{
  this->Put("theirs", "of before");
  const TemporaryFile first(this->Target());
  const std::string name = first.Path(), end = ".part";
  const std::size_t dash = name.rfind('-');
  const int number = std::stoi(name.substr(dash + 1));
  const auto next = [&](int k) { return name.substr(0, dash + 1) + std::to_string(number + k) + end; };
  fs::create_symlink("theirs", next(1));
  this->Put(fs::path(next(2)).filename().string(), "of one that was killed");
  {
    TemporaryFile file(this->Target());
    ASSERT_EQ(file.Path(), next(3));
    EXPECT_EQ(file.Write("ours"), 0);
    EXPECT_EQ(file.Rename(), 0);
  }
  EXPECT_EQ(this->Get("theirs"), "of before");
  EXPECT_TRUE(fs::is_symlink(next(1)));
  EXPECT_TRUE(fs::is_regular_file(next(2)));
  EXPECT_EQ(this->Get("x"), "ours");
}

TEST_F(TemporaryFiles, WhatIsNoFileStaysAndRightsAreKept)
{
  ASSERT_EQ(mkfifo(this->Target().c_str(), 0600), 0);
  {
    TemporaryFile file(this->Target());
    EXPECT_EQ(file.Error(), EEXIST);
    EXPECT_EQ(file.Rename(), EEXIST);
  }
  EXPECT_TRUE(fs::is_fifo(this->Target()));
  this->Put("y", "of before");
  // Fewer and more than a new file has.
  for (const mode_t rights : { 0600, 0777 })
  {
    fs::permissions(this->Directory / "y", fs::perms(rights));
    TemporaryFile file(this->Target("y"));
    EXPECT_EQ(file.Rename(), 0);
    EXPECT_EQ(fs::status(this->Directory / "y").permissions(), fs::perms(rights));
  }
}

TEST_F(TemporaryFiles, WhatIsProtectedStays)
{
  this->Put("y", "of before");
  fs::permissions(this->Directory / "y", fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read);
  fs::permissions(this->Directory, fs::perms::all); // a file could be made beside it
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0)
  {
    // Root may write everything.
    const bool nobody = getuid() != 0 || (setgid(65534) == 0 && setuid(65534) == 0);
    _exit(!nobody ? 126 : TemporaryFile(this->Target("z")).Error() ? 125 : TemporaryFile(this->Target("y")).Error());
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), EACCES);
}

TEST_F(TemporaryFiles, FailuresAreTold)
{
  EXPECT_EQ(TemporaryFile(this->Target("no/x")).Error(), ENOENT);
  fs::create_directory(this->Directory / "x");
  {
    TemporaryFile file(this->Target());
    EXPECT_EQ(file.Write("text"), 0);
    EXPECT_EQ(file.Rename(), EISDIR);
  }
  EXPECT_EQ(this->Count(), 1);
  // No room, in the buffer's last part and beyond it.
  const auto before = std::signal(SIGXFSZ, SIG_IGN);
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  const rlimit limit{ 1000, old.rlim_max };
  setrlimit(RLIMIT_FSIZE, &limit);
  int small = 0, large = 0;
  {
    TemporaryFile file(this->Target("y"));
    file.Write(std::string(1001, 'a'));
    small = file.Rename();
    TemporaryFile other(this->Target("z"));
    large = other.Write(std::string(100000, 'a'));
  }
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, before);
  EXPECT_EQ(small, EFBIG);
  EXPECT_EQ(large, EFBIG);
  EXPECT_EQ(this->Count(), 1);
}

TEST_F(TemporaryFiles, LongNamesHaveRoom)
{
  const std::string name(255, 'n');
  TemporaryFile file(this->Target(name));
  EXPECT_EQ(file.Write("text"), 0);
  EXPECT_EQ(file.Rename(), 0);
  EXPECT_EQ(this->Get(name), "text");
}
}
