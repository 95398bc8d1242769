// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCarriedArrays_h
#define quellCarriedArrays_h

#include "quellConnectionCheck.h"
#include "vtkQuellDenoisingModule.h"

#include <string>
#include <vector>

namespace quell
{
/// The names in a property Arrays, but for "radiance".
VTKQUELLDENOISING_EXPORT std::vector<std::string> CarriedArrays(const std::string& text);
VTKQUELLDENOISING_EXPORT bool IsCarriedArray(const std::string& text, const std::string& name);

/// Warns of names that the first input does not have, and refuses arrays of more than `most` components, each, or with
/// `together` all of them; as far as is known.
VTKQUELLDENOISING_EXPORT void CheckCarriedArrays(
  ConnectionCheck& check, const std::string& text, int most, bool together);
}

#endif
