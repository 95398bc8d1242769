// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFuzz_h
#define quellFuzz_h

#include "quellFuzzTools.h"

#include <cstdint>
#include <string>
#include <vector>

/// Makes document after document from seeds, under the seed's name: what it includes is found beside the seed. Document
/// n is a function of (seed, n) alone.
class FuzzMutator
{
public:
  FuzzMutator(const std::vector<FuzzCase>& seeds, std::uint64_t seed)
    : Seeds(seeds)
    , Random(seed)
  {
  }
  FuzzCase Make(std::uint64_t n);

private:
  std::size_t Below(std::size_t n) { return this->Random.Below(n); }
  const std::string& Piece();
  std::string Value();
  void MutateBytes(std::string& text);
  void MutateAttribute(std::string& text);
  void MutateElement(std::string& text);
  void AddBlock(std::string& text);
  void Encode(std::string& text);

  const std::vector<FuzzCase>& Seeds;
  FuzzRandom Random;
};

/// A document made to break something, and words of the message that must come instead.
struct FuzzBomb
{
  const char* Name;
  std::string Text;
  std::string Message; ///< empty: it is a good file
};
std::vector<FuzzBomb> FuzzBombs();

#endif
