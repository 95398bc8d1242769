// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTemporaryFile_h
#define quellTemporaryFile_h

#include "vtkQuellCoreModule.h"

#include <cstddef>
#include <string>

namespace quell
{
/// A file that is whole or absent: written under `.NAME.PID-N.part` in the directory of `target`, hidden, and renamed at
/// the end. NAME is cut to 200 bytes: with all of a long one no file could be made. The file is made anew, so that no
/// link that waits under this name is followed; where something does, the next N is taken. Gone with the object unless
/// Rename() succeeded. A target that may not be written (EACCES), a device or a pipe (EEXIST) is not replaced; a file
/// keeps its rights, a link does not stay.
///
/// Functions that can fail give errno of the first failure, 0 without one; after it they do nothing.
class VTKQUELLCORE_EXPORT TemporaryFile
{
public:
  explicit TemporaryFile(const std::string& target);
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  void operator=(const TemporaryFile&) = delete;

  const std::string& Path() const { return this->Name; }
  /// To write to directly; what Write() was given before may come later.
  int Descriptor() const { return this->File; }
  int Error() const { return this->Failure; }

  int Write(const void* data, std::size_t bytes);
  int Write(const std::string& text) { return this->Write(text.data(), text.size()); }
  int Close();
  int Rename();

private:
  void Send(const char* data, std::size_t bytes);

  std::string Target;
  std::string Name;
  std::string Waiting;
  int File = -1;
  int Failure = 0;
  bool Done = false;
};
}

#endif
