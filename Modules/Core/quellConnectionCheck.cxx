// SPDX-License-Identifier: BSD-3-Clause
#include "quellConnectionCheck.h"

#include <algorithm>

namespace quell
{
void ConnectionCheck::Error(int port, int connection, const std::string& text, const std::string& hint)
{
  this->Said.push_back({ port, connection, text, hint, false });
}

void ConnectionCheck::Warn(int port, int connection, const std::string& text, const std::string& hint)
{
  this->Said.push_back({ port, connection, text, hint, true });
}

std::string ConnectionCheck::Text(const StageDescription& description, const Message& message)
{
  std::string text = message.Text + (message.Hint.empty() ? "" : "; " + message.Hint);
  if (message.Port >= 0)
  {
    text = "input \"" + description.Inputs.at(std::size_t(message.Port)).Name + "\": " + text;
  }
  return text;
}

void ConnectionCheck::WantComponents(int port, int connection, const std::vector<int>& numbers)
{
  const Connection& c = this->At(port, connection);
  if (c.Components <= 0 || std::find(numbers.begin(), numbers.end(), c.Components) != numbers.end())
  {
    return;
  }
  std::string wanted;
  for (std::size_t k = 0; k < numbers.size(); ++k)
  {
    wanted += (k == 0 ? "" : k + 1 == numbers.size() ? " or " : ", ") + std::to_string(numbers[k]);
  }
  this->Error(port, connection,
    "\"" + c.Array + "\" has " + std::to_string(c.Components) + (c.Components == 1 ? " component" : " components") +
      ", wanted are " + wanted);
}

void ConnectionCheck::WantAtMost(int port, int most, const std::string& why)
{
  if (this->Count(port) > most)
  {
    this->Error(port, most,
      std::to_string(this->Count(port)) + " connections, at most " + std::to_string(most) + " are possible", why);
  }
}
}
