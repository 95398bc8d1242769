// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellJsonText_h
#define quellJsonText_h

#include <nlohmann/json.hpp>

#include <string>

namespace quell
{
/// For files and standard output. File names are bytes: what is no UTF-8 in them becomes U+FFFD.
inline std::string JsonText(const nlohmann::json& json, int indent = 2)
{
  return json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}
}

#endif
