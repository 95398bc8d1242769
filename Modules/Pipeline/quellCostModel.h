// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCostModel_h
#define quellCostModel_h

#include "quellPipelineExecutor.h"
#include "vtkQuellPipelineModule.h"

#include <map>
#include <set>
#include <string>
#include <vector>

class vtkQuellStage;

namespace quell
{
/// What stages cost on this machine:
///
///   seconds = pixels * CostPerPixel(properties) * nanoseconds(type) * 1e-9 / threads
///
/// pixels: of the output, as planned; CostPerPixel: what the stage says its radius, passes or samples cost relative to
/// each other; nanoseconds: of one thread, measured of the type. A type that reads a scene is measured for each scene
/// (`PathTraceSource cornell-box.gltf`) and for scenes never met (their mean). Without scene loading, and of frames
/// with history: a first frame costs more. Threads are taken to share the work evenly. Expect a factor of 1.3 for
/// filters of a calibrated machine, 3 for scenes it has not met.
class VTKQUELLPIPELINE_EXPORT CostModel
{
public:
  /// Measured on the machine that the project is developed on.
  static CostModel BuiltIn();
  /// BuiltIn with what `file` says of this machine. A file that is not there is no mistake; of one that cannot be read
  /// `problem` tells, and BuiltIn stays.
  static CostModel Load(const std::string& file, std::string& problem);
  /// $QUELL_COSTS, else quell/costs.json in $XDG_CACHE_HOME or ~/.cache; empty where none of them is set.
  static std::string DefaultFile();

  /// Seconds of one execution over so many pixels; negative where the type was never measured.
  double Seconds(const vtkQuellStage& stage, const std::string& type, double pixels, int threads) const;
  /// Learns from one execution.
  void Measure(const vtkQuellStage& stage, const std::string& type, double pixels, int threads, double seconds);
  /// Makes medians of what was measured since the last call. Returns how many types.
  int Settle();
  /// What was measured on this machine. The file appears whole or not at all. Throws StageError.
  void Save(const std::string& file) const;

  /// Whether what Seconds says of the stage was measured here.
  bool IsOfThisMachine(const vtkQuellStage& stage, const std::string& type) const;
  const std::map<std::string, double>& Nanoseconds() const { return this->Costs; }

private:
  std::map<std::string, double> Costs;                ///< type, or type and scene -> ns
  std::map<std::string, std::vector<double>> Samples; ///< not yet settled
  std::set<std::string> Own;                          ///< of Costs, those of this machine

  std::string KeyOf(const vtkQuellStage& stage, const std::string& type) const;
};

/// "AMD EPYC, 2 processors".
VTKQUELLPIPELINE_EXPORT std::string MachineText();
/// "1.9 us", "12.3 ms", "1.20 s".
VTKQUELLPIPELINE_EXPORT std::string SecondsText(double seconds);
}

#endif
