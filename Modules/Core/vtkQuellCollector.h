// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellCollector
 * @brief   the one sink of a frame: updates any number of stages in one pass, each with its arrays and region
 *
 * Six outputs asked one after the other would run a shared source again whenever arrays or extents widen; asked
 * together it runs once. Before each pass the demand of the last one is removed from everything upstream, so that a
 * request does not survive the click that made it.
 */
#ifndef vtkQuellCollector_h
#define vtkQuellCollector_h

#include "vtkImageAlgorithm.h"
#include "vtkQuellCoreModule.h"
#include "vtkQuellStage.h"

#include <vector>

class VTKQUELLCORE_EXPORT vtkQuellCollector : public vtkImageAlgorithm
{
public:
  static vtkQuellCollector* New();
  vtkTypeMacro(vtkQuellCollector, vtkImageAlgorithm);

  void ClearRequests();
  /// Ask `producer` for `arrays` over `region`; an empty region means the whole frame.
  void AddRequest(vtkAlgorithm* producer, const quell::ArraySet& arrays, const quell::Rect& region = quell::Rect());

  /// Updates everything requested for `tick`. False when any stage failed; then FailedStage() says which failed first.
  bool UpdateTick(int tick);
  vtkQuellStage* FailedStage() const { return this->Failed; }

protected:
  vtkQuellCollector();
  ~vtkQuellCollector() override;
  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

private:
  struct Request
  {
    vtkAlgorithm* Producer;
    quell::ArraySet Arrays;
    quell::Rect Region;
  };
  std::vector<Request> Requests;
  vtkQuellStage* Failed = nullptr;

  vtkQuellCollector(const vtkQuellCollector&) = delete;
  void operator=(const vtkQuellCollector&) = delete;
};

#endif
