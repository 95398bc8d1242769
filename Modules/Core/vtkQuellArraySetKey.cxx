// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellArraySetKey.h"

#include "vtkInformation.h"
#include "vtkQuellStage.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <algorithm>

vtkQuellArraySetKey::vtkQuellArraySetKey(const char* name, const char* location)
  : vtkInformationStringVectorKey(name, location)
{
}

vtkQuellArraySetKey::~vtkQuellArraySetKey() = default;

std::set<std::string> vtkQuellArraySetKey::Read(vtkInformation* info)
{
  std::set<std::string> names;
  const int n = this->Length(info);
  for (int i = 0; i < n; ++i)
    names.insert(this->Get(info, i));
  return names;
}

void vtkQuellArraySetKey::Write(vtkInformation* info, const std::set<std::string>& names)
{
  info->Remove(this);
  for (const std::string& name : names)
    this->Append(info, name.c_str());
}

void vtkQuellArraySetKey::Unite(vtkInformation* info, const std::set<std::string>& names)
{
  std::set<std::string> all = this->Read(info);
  const size_t before = all.size();
  all.insert(names.begin(), names.end());
  if (all.size() != before)
    this->Write(info, all);
}

bool vtkQuellArraySetKey::NeedToExecute(vtkInformation* pipelineInfo, vtkInformation* dataInfo)
{
  if (this != vtkQuellStage::REQUESTED_ARRAYS())
    return false;
  std::set<std::string> asked = this->Read(pipelineInfo);
  asked.erase(std::string());
  const std::set<std::string> provided = vtkQuellStage::PROVIDED_ARRAYS()->Read(dataInfo);
  return !std::includes(provided.begin(), provided.end(), asked.begin(), asked.end());
}

void vtkQuellArraySetKey::CopyDefaultInformation(
  vtkInformation* request, vtkInformation* fromInfo, vtkInformation* toInfo)
{
  if (this != vtkQuellStage::REQUESTED_ARRAYS() ||
      !request->Has(vtkStreamingDemandDrivenPipeline::REQUEST_UPDATE_EXTENT()))
    return;
  if (fromInfo->Has(vtkQuellStage::IS_QUELL_STAGE()))
    return;
  this->Unite(toInfo, this->Read(fromInfo));
}

void vtkQuellArraySetKey::StoreMetaData(vtkInformation*, vtkInformation* pipelineInfo, vtkInformation* dataInfo)
{
  if (this == vtkQuellStage::REQUESTED_ARRAYS() && !pipelineInfo->Has(vtkQuellStage::IS_QUELL_STAGE()))
    vtkQuellStage::PROVIDED_ARRAYS()->Write(dataInfo, this->Read(pipelineInfo));
}
