// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSettings_h
#define quellSettings_h

#include <map>
#include <string>
#include <vector>

namespace quell
{
/// What the viewer remembers between runs: `name = value` lines.
class Settings
{
public:
  void Load(const std::string& file); ///< a missing or broken file: nothing is remembered
  bool Save() const;                  ///< false when it cannot be written
  double Number(const std::string& name, double fallback, double low, double high) const;
  std::string Text(const std::string& name, const std::string& fallback = std::string()) const;
  void Set(const std::string& name, const std::string& value);
  void Set(const std::string& name, double value);

  std::vector<std::string> Recent() const;
  void AddRecent(const std::string& file);
  void RemoveRecent(const std::string& file);

  /// $XDG_CONFIG_HOME/quell/view.ini, else ~/.config/quell/view.ini; empty where there is no home.
  static std::string DefaultFile();

private:
  std::string File;
  std::map<std::string, std::string> Values;
};
}

#endif
