// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellVary_h
#define quellVary_h

#include "vtkQuellTradeoffModule.h"

#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// One thing that a sweep varies, and its values as texts.
struct VaryAxis
{
  std::string What; ///< "node.Property" ("instance/node.Property"), a variable, or a node with the values on and off
  std::vector<std::string> Values;
};

/// "atrous.SigmaLuminance=1,2,4"; "x=1..4/7": 7 values in equal steps from 1 to 4; "x=1..64*7": 7 values in equal
/// ratios, ends above 0; "clamp=on,off". Values and ranges may be mixed; the same value twice counts once. Integers in,
/// integers out where the steps are whole. Throws std::invalid_argument with a sentence.
VTKQUELLTRADEOFF_EXPORT VaryAxis ParseVary(const std::string& text);

/// The number with so many significant digits, as people write it: 0.25, 1000000.
VTKQUELLTRADEOFF_EXPORT std::string RoundedText(double value, int digits);

/// What was chosen on each axis.
using VaryChoice = std::vector<std::pair<std::string, std::string>>;
/// All combinations, the last axis fastest; one empty choice without axes. Throws std::invalid_argument beyond `limit`.
VTKQUELLTRADEOFF_EXPORT std::vector<VaryChoice> Combinations(
  const std::vector<VaryAxis>& axes, std::size_t limit = 100000);
/// "atrous.SigmaLuminance=2 clamp=off"; "as in the file" for an empty choice.
VTKQUELLTRADEOFF_EXPORT std::string ChoiceText(const VaryChoice& choice);
}

#endif
