// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellCollector.h"

#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationIntegerKey.h"
#include "vtkInformationIntegerVectorKey.h"
#include "vtkInformationVector.h"
#include "vtkObjectFactory.h"
#include "vtkQuellArraySetKey.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <functional>
#include <map>
#include <set>

using SDDP = vtkStreamingDemandDrivenPipeline;

vtkStandardNewMacro(vtkQuellCollector);

vtkQuellCollector::vtkQuellCollector() = default;
vtkQuellCollector::~vtkQuellCollector() = default;

namespace
{
/// Visits everything upstream of `last`, producers before consumers.
void VisitUpstream(vtkAlgorithm* last, std::set<vtkAlgorithm*>& seen, const std::function<void(vtkAlgorithm*)>& visit)
{
  if (!last || !seen.insert(last).second)
    return;
  for (int p = 0; p < last->GetNumberOfInputPorts(); ++p)
    for (int c = 0; c < last->GetNumberOfInputConnections(p); ++c)
      VisitUpstream(last->GetInputAlgorithm(p, c), seen, visit);
  visit(last);
}
}

void vtkQuellCollector::ClearRequests()
{
  this->Requests.clear();
  this->RemoveAllInputs();
}

void vtkQuellCollector::AddRequest(vtkAlgorithm* producer, const quell::ArraySet& arrays, const quell::Rect& region)
{
  this->Requests.push_back({ producer, arrays, region });
  this->AddInputConnection(0, producer->GetOutputPort());
}

bool vtkQuellCollector::UpdateTick(int tick)
{
  this->Failed = nullptr;
  if (this->Requests.empty())
    return true;
  std::set<vtkAlgorithm*> seen;
  VisitUpstream(this, seen,
    [](vtkAlgorithm* a)
    {
      for (int p = 0; p < a->GetNumberOfOutputPorts(); ++p)
      {
        vtkInformation* info = a->GetOutputInformation(p);
        info->Remove(vtkQuellStage::REQUESTED_ARRAYS());
        info->Remove(SDDP::COMBINED_UPDATE_EXTENT());
        const int nothing[4] = { 0, 0, 0, 0 };
        info->Set(vtkQuellStage::PASS_REGION(), nothing, 4);
      }
    });
  const bool done = this->UpdateTimeStep(double(tick)) != 0;
  seen.clear();
  VisitUpstream(this, seen,
    [](vtkAlgorithm* a)
    {
      for (int p = 0; p < a->GetNumberOfOutputPorts(); ++p)
        a->GetOutputInformation(p)->Remove(vtkQuellStage::PASS_REGION());
    });
  if (done)
    return true;
  seen.clear();
  VisitUpstream(this, seen,
    [this](vtkAlgorithm* a)
    {
      auto stage = vtkQuellStage::SafeDownCast(a);
      if (stage && !this->Failed && !stage->GetErrorText().empty())
        this->Failed = stage;
    });
  return false;
}

int vtkQuellCollector::FillInputPortInformation(int, vtkInformation* info)
{
  info->Set(INPUT_REQUIRED_DATA_TYPE(), "vtkImageData");
  info->Set(INPUT_IS_REPEATABLE(), 1);
  info->Set(INPUT_IS_OPTIONAL(), 1);
  return 1;
}

int vtkQuellCollector::RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputVector)
{
  vtkInformation* info = outputVector->GetInformationObject(0);
  const int extent[6] = { 0, 0, 0, 0, 0, 0 };
  info->Set(SDDP::WHOLE_EXTENT(), extent, 6);
  info->Set(vtkQuellStage::IS_QUELL_STAGE(), 1);
  return 1;
}

int vtkQuellCollector::RequestUpdateExtent(vtkInformation*, vtkInformationVector** inputVector, vtkInformationVector*)
{
  std::map<vtkInformation*, quell::Rect> regions;
  for (int c = 0; c < inputVector[0]->GetNumberOfInformationObjects(); ++c)
  {
    vtkInformation* info = inputVector[0]->GetInformationObject(c);
    const Request& request = this->Requests.at(c);
    int w[6];
    info->Get(SDDP::WHOLE_EXTENT(), w);
    const quell::Rect whole{ w[0], w[2], w[1] + 1, w[3] + 1 };
    const quell::Rect region = request.Region.empty() ? whole : request.Region.clipped(whole);
    const auto found = regions.find(info);
    if (found == regions.end())
      regions[info] = region;
    else
      found->second = found->second.united(region);
    quell::ArraySet names = request.Arrays;
    names.insert(std::string());
    vtkQuellStage::REQUESTED_ARRAYS()->Unite(info, names);
  }
  for (const auto& entry : regions)
    vtkQuellStage::RequestRegion(entry.first, entry.second);
  return 1;
}

int vtkQuellCollector::RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputVector)
{
  vtkImageData* output = vtkImageData::GetData(outputVector);
  output->Initialize();
  output->SetExtent(0, 0, 0, 0, 0, 0);
  return 1;
}
