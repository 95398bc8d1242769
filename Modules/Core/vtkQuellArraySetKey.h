// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellArraySetKey
 * @brief   information key that holds a set of array names and travels upstream as a union
 *
 * VTK's own request keys keep the last writer's value where several consumers share a producer; this one unites. The
 * empty name is a marker: the key is present although nothing is wanted (an input that this pass does not need).
 */
#ifndef vtkQuellArraySetKey_h
#define vtkQuellArraySetKey_h

#include "vtkInformationStringVectorKey.h"
#include "vtkQuellCoreModule.h"

#include <set>
#include <string>

class VTKQUELLCORE_EXPORT vtkQuellArraySetKey : public vtkInformationStringVectorKey
{
public:
  vtkTypeMacro(vtkQuellArraySetKey, vtkInformationStringVectorKey);
  vtkQuellArraySetKey(const char* name, const char* location);
  ~vtkQuellArraySetKey() override;

  std::set<std::string> Read(vtkInformation* info);
  void Write(vtkInformation* info, const std::set<std::string>& names);
  void Unite(vtkInformation* info, const std::set<std::string>& names);

  /// True when something requested was not provided by the last execution.
  bool NeedToExecute(vtkInformation* pipelineInfo, vtkInformation* dataInfo) override;
  /// Records what a stock VTK filter was asked for as provided; Quell stages write that themselves.
  void StoreMetaData(vtkInformation* request, vtkInformation* pipelineInfo, vtkInformation* dataInfo) override;
  /// Through stock VTK filters only, and only while extents are requested: Quell stages add per port themselves.
  void CopyDefaultInformation(vtkInformation* request, vtkInformation* fromInfo, vtkInformation* toInfo) override;

private:
  vtkQuellArraySetKey(const vtkQuellArraySetKey&) = delete;
  void operator=(const vtkQuellArraySetKey&) = delete;
};

#endif
