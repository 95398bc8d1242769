// SPDX-License-Identifier: BSD-3-Clause
#include "quellStageRegistry.h"

#include "vtkQuellStage.h"

namespace quell
{
void StageRegistry::AddFactory(Factory factory)
{
  this->Factories[factory()->GetDescription().Type] = factory;
}

vtkSmartPointer<vtkQuellStage> StageRegistry::Create(const std::string& type) const
{
  const auto found = this->Factories.find(type);
  return found == this->Factories.end() ? nullptr : found->second();
}

const StageDescription* StageRegistry::Describe(const std::string& type) const
{
  const auto found = this->Factories.find(type);
  return found == this->Factories.end() ? nullptr : &found->second()->GetDescription();
}

std::vector<std::string> StageRegistry::Types() const
{
  std::vector<std::string> names;
  for (const auto& entry : this->Factories)
    names.push_back(entry.first);
  return names;
}
}
