// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellStageRegistry_h
#define quellStageRegistry_h

#include "quellStageDescription.h"
#include "vtkQuellCoreModule.h"
#include "vtkSmartPointer.h"

#include <map>
#include <string>
#include <vector>

namespace quell
{
/// Stage types by name. Each stage module offers one function, `void quell::RegisterDenoisingStages(StageRegistry&)`
/// and so on, that adds its types; nothing registers itself behind the program's back.
class VTKQUELLCORE_EXPORT StageRegistry
{
public:
  using Factory = vtkSmartPointer<vtkQuellStage> (*)();

  template <class S>
  void Add()
  {
    this->AddFactory([]() -> vtkSmartPointer<vtkQuellStage> { return vtkSmartPointer<S>::New(); });
  }
  /// nullptr for an unknown type.
  vtkSmartPointer<vtkQuellStage> Create(const std::string& type) const;
  const StageDescription* Describe(const std::string& type) const;
  std::vector<std::string> Types() const; ///< sorted

private:
  void AddFactory(Factory factory);
  std::map<std::string, Factory> Factories;
};
}

#endif
