// SPDX-License-Identifier: BSD-3-Clause
#include "quellFuzzTools.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <sys/wait.h>
#include <unistd.h>

namespace fs = std::filesystem;

namespace
{
struct TemporaryDirectory
{
  TemporaryDirectory()
  {
    std::string pattern = (fs::temp_directory_path() / "quell-fuzz-XXXXXX").string();
    if (!mkdtemp(&pattern[0]))
      throw std::runtime_error("no temporary directory");
    this->Path = pattern;
  }
  ~TemporaryDirectory()
  {
    std::error_code code;
    fs::remove_all(this->Path, code);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  fs::path Path;
};

void WriteApart(const char* program, const std::function<void(const fs::path&)>& write, const fs::path& directory)
{
  std::cout.flush();
  const pid_t child = fork();
  if (child == 0)
  {
    try
    {
      write(directory);
      _exit(0);
    }
    catch (const std::exception& e)
    {
      std::cerr << program << ": seeds: " << e.what() << std::endl;
      _exit(1);
    }
  }
  int status = 1;
  if (child < 0 || waitpid(child, &status, 0) != child || status != 0)
    throw std::runtime_error("no seeds");
}
}

std::string Contents(const fs::path& file)
{
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

void Save(const fs::path& file, const std::string& text)
{
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << text;
  if (!out.flush())
    throw std::runtime_error("cannot write " + file.string());
}

void Promise(bool kept, const std::string& what)
{
  if (!kept)
    throw std::runtime_error(what);
}

bool IsReadable(const std::string& text)
{
  return std::all_of(text.begin(), text.end(), [](char c) { return (unsigned char)c >= 0x20 && c != 0x7F; });
}

void CheckMessage(const std::string& text, const std::string& word)
{
  Promise(text.find(word) != std::string::npos, "a message without \"" + word + "\": " + text);
  Promise(text.size() < 4000, "a message of " + std::to_string(text.size()) + " characters: " + text.substr(0, 300));
  Promise(IsReadable(text), "a message with control characters: " + text);
}

std::vector<fs::path> SeedFiles(const std::vector<std::string>& paths, const std::string& extension)
{
  std::vector<fs::path> files;
  for (const std::string& path : paths)
    if (!fs::is_directory(path))
      files.push_back(path);
    else
      for (const auto& entry : fs::directory_iterator(path))
        if (entry.is_regular_file() && entry.path().has_extension() &&
            (extension.empty() || entry.path().extension() == extension))
          files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

void FuzzRandom::Begin(std::uint64_t n)
{
  std::seed_seq sequence{ std::uint32_t(this->Seed), std::uint32_t(this->Seed >> 32), std::uint32_t(n),
    std::uint32_t(n >> 32) };
  this->Numbers.seed(sequence);
}

int RunFuzz(int argc, char** argv, const char* program, const std::function<void(const fs::path&)>& write,
  const MakeFuzzTarget& make)
{
  FuzzOptions options;
  if (const int status = ParseFuzzOptions(argc, argv, program, options))
    return status;
  try
  {
    const TemporaryDirectory directory;
    WriteApart(program, write, directory.Path);
    std::vector<std::string> paths = options.Paths;
    paths.push_back(directory.Path.string());
    std::vector<FuzzCase> seeds;
    for (const fs::path& file : SeedFiles(paths))
      if (std::string text = Contents(file); !text.empty())
        seeds.push_back({ file.filename().string(), std::move(text) });
    const std::unique_ptr<FuzzTarget> target = make(directory.Path, std::move(seeds), options.Seed);
    return WatchFuzz(options, *target);
  }
  catch (const std::exception& e)
  {
    std::cerr << program << ": " << e.what() << "\n";
    return 2;
  }
}
