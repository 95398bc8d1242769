// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFuzzFiles_h
#define quellFuzzFiles_h

#include "quellFuzzTools.h"

#include <string>
#include <vector>

/// Images and scenes that files are mutated from, all made here: every format and layout that the project writes, and
/// scenes that use every feature of the readers. Written into `directory`; an OBJ and its MTL are one seed (see
/// FuzzSplit).
void WriteFuzzSeeds(const std::string& directory);

/// Files made to break something, and words of the message that must come instead (empty: a good file).
struct FuzzFileBomb
{
  std::string Name, Text, Message;
};
std::vector<FuzzFileBomb> FuzzFileBombs();

/// Between the OBJ and the MTL part of one document.
extern const char* const FuzzSplit;

/// Mutates by what the file is: chunks and attributes of images, the JSON of a glTF and its buffers, lines of an OBJ or
/// of a colour configuration.
/// Document n is a function of (seed, n) alone.
class FileMutator
{
public:
  FileMutator(std::vector<FuzzCase> seeds, std::uint64_t seed)
    : Seeds(std::move(seeds))
    , Random(seed)
  {
  }
  const std::vector<FuzzCase>& All() const { return this->Seeds; }
  FuzzCase Make(std::uint64_t n);

private:
  std::size_t Below(std::size_t n) { return this->Random.Below(n); }
  std::uint64_t Number();
  void MutateBytes(std::string& text, const std::vector<std::string>& dictionary, std::size_t from);
  void MutateExr(std::string& text);
  void MutateJson(std::string& text);
  void MutateGlb(std::string& text);
  void MutateLines(std::string& text, const std::vector<std::string>& dictionary);

  std::vector<FuzzCase> Seeds;
  FuzzRandom Random;
};

#endif
