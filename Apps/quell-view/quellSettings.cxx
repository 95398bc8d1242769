// SPDX-License-Identifier: BSD-3-Clause
#include "quellSettings.h"

#include "quellStageDescription.h"
#include "quellTemporaryFile.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
const int RecentCount = 10;
}

std::string Settings::DefaultFile()
{
  if (const char* config = std::getenv("XDG_CONFIG_HOME"); config && *config)
  {
    return std::string(config) + "/quell/view.ini";
  }
  const char* home = std::getenv("HOME");
  return home && *home ? std::string(home) + "/.config/quell/view.ini" : std::string();
}

void Settings::Load(const std::string& file)
{
  this->File = file;
  this->Values.clear();
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line) && this->Values.size() < 1000)
  {
    const std::size_t at = line.find(" = ");
    if (at != std::string::npos && line.size() < 8192)
    {
      this->Values[line.substr(0, at)] = line.substr(at + 3);
    }
  }
}

bool Settings::Save() const
{
  if (this->File.empty())
  {
    return true;
  }
  std::error_code ec;
  fs::create_directories(fs::path(this->File).parent_path(), ec);
  TemporaryFile temporary(this->File);
  for (const auto& v : this->Values)
  {
    if (v.second.find('\n') == std::string::npos)
    {
      temporary.Write(v.first + " = " + v.second + "\n");
    }
  }
  return temporary.Rename() == 0;
}

double Settings::Number(const std::string& name, double fallback, double low, double high) const
{
  const auto at = this->Values.find(name);
  double v = 0;
  std::string error;
  return at != this->Values.end() && detail::ParseDouble(at->second, low, high, v, error) ? v : fallback;
}

std::string Settings::Text(const std::string& name, const std::string& fallback) const
{
  const auto at = this->Values.find(name);
  return at == this->Values.end() ? fallback : at->second;
}

void Settings::Set(const std::string& name, const std::string& value)
{
  this->Values[name] = value;
}

void Settings::Set(const std::string& name, double value)
{
  this->Values[name] = detail::FormatDouble(value);
}

std::vector<std::string> Settings::Recent() const
{
  std::vector<std::string> files;
  for (int i = 0; i < RecentCount; ++i)
  {
    const std::string file = this->Text("recent" + std::to_string(i));
    if (!file.empty())
    {
      files.push_back(file);
    }
  }
  return files;
}

void Settings::AddRecent(const std::string& file)
{
  std::error_code ec;
  const fs::path path = fs::absolute(file, ec);
  const std::string full = ec ? file : path.lexically_normal().string();
  std::vector<std::string> files = this->Recent();
  files.erase(std::remove(files.begin(), files.end(), full), files.end());
  files.insert(files.begin(), full);
  for (int i = 0; i < RecentCount; ++i)
  {
    if (i < int(files.size()))
    {
      this->Values["recent" + std::to_string(i)] = files[std::size_t(i)];
    }
    else
    {
      this->Values.erase("recent" + std::to_string(i));
    }
  }
}

void Settings::RemoveRecent(const std::string& file)
{
  std::vector<std::string> files = this->Recent();
  files.erase(std::remove(files.begin(), files.end(), file), files.end());
  for (int i = 0; i < RecentCount; ++i)
  {
    this->Values.erase("recent" + std::to_string(i));
  }
  for (std::size_t i = 0; i < files.size(); ++i)
  {
    this->Values["recent" + std::to_string(i)] = files[i];
  }
}
}
