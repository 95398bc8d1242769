// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellConnectionCheck_h
#define quellConnectionCheck_h

#include "quellStageDescription.h"
#include "vtkQuellCoreModule.h"

#include <functional>
#include <string>
#include <vector>

namespace quell
{
/// What is known of a stage's connections without a pixel, and what the stage has to say about them: filled by the
/// graph builder, which points at the line, and by the stage itself before it executes.
class VTKQUELLCORE_EXPORT ConnectionCheck
{
public:
  struct Connection
  {
    std::string Array;  ///< that it reads
    int Components = 0; ///< of that array; 0: not known yet
    /// Adds all arrays that the producer can be asked for; false: not known. May be empty.
    std::function<bool(std::vector<OutputArray>&)> Holds;
  };
  struct Message
  {
    int Port, Connection; ///< Port -1: about the stage
    std::string Text, Hint;
    bool Warning;
  };

  /// By port. A delayed input is connected, whether or not there is history.
  std::vector<std::vector<Connection>> Ports;

  int Count(int port) const { return int(this->Ports.at(std::size_t(port)).size()); }
  const Connection& At(int port, int connection) const
  {
    return this->Ports.at(std::size_t(port)).at(std::size_t(connection));
  }

  ///@{
  /// Texts are sentences of their own, without the names of stage and port. An error is one mistake of the pipeline
  /// and ends its run; all of them are told.
  void Error(int port, int connection, const std::string& text, const std::string& hint = {});
  void Warn(int port, int connection, const std::string& text, const std::string& hint = {});
  ///@}
  const std::vector<Message>& Messages() const { return this->Said; }
  /// The message with the name of its port, for those who have no line to point at.
  static std::string Text(const StageDescription& description, const Message& message);

  ///@{ What several stages ask.
  /// The array has one of these numbers of components, as far as is known.
  void WantComponents(int port, int connection, const std::vector<int>& numbers);
  /// At most `most` connections.
  void WantAtMost(int port, int most, const std::string& why = {});
  ///@}

private:
  std::vector<Message> Said;
};
}

#endif
