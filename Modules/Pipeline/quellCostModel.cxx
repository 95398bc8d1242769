// SPDX-License-Identifier: BSD-3-Clause
#include "quellCostModel.h"

#include "quellImageGuard.h"
#include "quellJsonText.h"
#include "quellTemporaryFile.h"
#include "vtkQuellStage.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
/// The file name of what a stage renders; empty for filters.
std::string SceneOf(const vtkQuellStage& stage)
{
  return stage.GetDescription().FindProperty("Scene") ? fs::path(stage.GetPropertyText("Scene")).filename().string()
                                                      : std::string();
}

double Median(std::vector<double> values)
{
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}
}

CostModel CostModel::BuiltIn()
{
  CostModel model;
  // quell calibrate svgf.xml quick.xml still.xml denoise-*.xml layers-diffuse-specular.xml
  model.Costs = { { "ATrousFilter", 150 }, { "AlbedoDemodulate", 140 }, { "AlbedoModulate", 120 }, { "AovSplit", 4300 },
    { "BilateralFilter", 150 }, { "EmissionSplit", 490 }, { "FeaturePrefilter", 1050 }, { "FireflyClamp", 370 },
    { "ImageReader", 214 }, { "NormalSnap", 22 }, { "PathTraceSource", 67 }, { "RegressionFilter", 800 },
    { "Reproject", 30 }, { "Sum", 170 }, { "TemporalAccumulate", 9 }, { "TemporalAntialias", 25 },
    { "VarianceEstimate", 1000 } };
  return model;
}

std::string CostModel::DefaultFile()
{
  if (const char* file = std::getenv("QUELL_COSTS"))
  {
    return file;
  }
  const char* cache = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  return cache && *cache ? (fs::path(cache) / "quell" / "costs.json").string()
         : home && *home ? (fs::path(home) / ".cache" / "quell" / "costs.json").string()
                         : std::string();
}

CostModel CostModel::Load(const std::string& file, std::string& problem)
{
  CostModel model = BuiltIn();
  std::error_code code;
  const fs::file_status status = fs::status(file, code);
  if (file.empty() || !fs::exists(status))
  {
    return model;
  }
  std::ifstream stream;
  if (fs::is_regular_file(status)) // opening a pipe would wait for ever
  {
    stream.open(file);
  }
  if (!stream.is_open())
  {
    problem = file + " is no file that can be read: it is ignored";
    return model;
  }
  const nlohmann::json json = nlohmann::json::parse(stream, nullptr, false);
  if (!json.is_object() || !json.contains("machine") || !json["machine"].is_string() || !json.contains("nanoseconds") ||
      !json["nanoseconds"].is_object())
  {
    problem = file + " is not what quell calibrate writes: it is ignored";
    return model;
  }
  if (json["machine"].get<std::string>() != MachineText())
  {
    problem = file + " is of another machine (" + OneLine(json["machine"].get<std::string>()) + "): it is ignored";
    return model;
  }
  for (const auto& entry : json["nanoseconds"].items())
  {
    const double ns = entry.value().is_number() ? entry.value().get<double>() : 0.;
    if (std::isfinite(ns) && ns > 0)
    {
      model.Costs[entry.key()] = ns;
      model.Own.insert(entry.key());
    }
    else
    {
      problem = file + ": what it says of " + OneLine(entry.key()) + " is no time: it is ignored";
    }
  }
  return model;
}

std::string CostModel::KeyOf(const vtkQuellStage& stage, const std::string& type) const
{
  const std::string scene = SceneOf(stage);
  return !scene.empty() && this->Costs.count(type + " " + scene) ? type + " " + scene : type;
}

bool CostModel::IsOfThisMachine(const vtkQuellStage& stage, const std::string& type) const
{
  return this->Own.count(this->KeyOf(stage, type)) > 0;
}

double CostModel::Seconds(const vtkQuellStage& stage, const std::string& type, double pixels, int threads) const
{
  const auto at = this->Costs.find(this->KeyOf(stage, type));
  return at == this->Costs.end() ? -1. : pixels * stage.CostPerPixel() * at->second * 1e-9 / std::max(1, threads);
}

void CostModel::Measure(const vtkQuellStage& stage, const std::string& type, double pixels, int threads, double seconds)
{
  const double units = pixels * stage.CostPerPixel();
  if (!(units > 0) || !(seconds > 0))
  {
    return;
  }
  const double ns = seconds * std::max(1, threads) * 1e9 / units;
  const std::string scene = SceneOf(stage);
  this->Samples[type].push_back(ns);
  if (!scene.empty())
  {
    this->Samples[type + " " + scene].push_back(ns);
  }
}

int CostModel::Settle()
{
  const int count = int(this->Samples.size());
  for (const auto& s : this->Samples)
  {
    this->Costs[s.first] = Median(s.second);
    this->Own.insert(s.first);
  }
  this->Samples.clear();
  return count;
}

void CostModel::Save(const std::string& file) const
{
  std::error_code ec;
  fs::create_directories(fs::path(file).parent_path(), ec);
  nlohmann::json json = { { "machine", MachineText() }, { "nanoseconds", nlohmann::json::object() } };
  for (const auto& c : this->Costs)
  {
    if (this->Own.count(c.first))
    {
      json["nanoseconds"][c.first] = c.second;
    }
  }
  TemporaryFile temporary(file);
  temporary.Write(JsonText(json) + "\n");
  if (const int error = temporary.Rename())
  {
    throw StageError("cannot write \"" + file + "\": " + std::strerror(error));
  }
}

std::string MachineText()
{
  std::ifstream file("/proc/cpuinfo");
  std::string line, name = "unknown processor";
  while (std::getline(file, line))
  {
    if (line.compare(0, 10, "model name") == 0 && line.find(':') != std::string::npos)
    {
      name = line.substr(line.find(':') + 2);
      break;
    }
  }
  return name + ", " + std::to_string(std::max(1u, std::thread::hardware_concurrency())) + " processors";
}

std::string SecondsText(double seconds)
{
  char text[48];
  if (seconds < 1e-4)
  {
    std::snprintf(text, sizeof text, "%.1f us", 1e6 * seconds);
  }
  else if (seconds < 1)
  {
    std::snprintf(text, sizeof text, seconds < 0.01 ? "%.2f ms" : seconds < 0.1 ? "%.1f ms" : "%.0f ms", 1e3 * seconds);
  }
  else
  {
    std::snprintf(text, sizeof text, seconds < 100 ? "%.2f s" : "%.0f s", seconds);
  }
  return text;
}
}
