// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellGraphModel_h
#define quellGraphModel_h

#include "quellEditDocument.h"
#include "quellRenderSession.h"
#include "quellStageRegistry.h"
#include "vtkQuellViewModule.h"

#include <map>
#include <set>
#include <string>
#include <vector>

namespace quell
{
struct GraphPin
{
  std::string Name; ///< port of an input, array of an output
  ArrayKind Kind = ArrayKind::Any;
  int Components = 0;
  std::string Doc, DefaultArray;
  bool Optional = false, Repeatable = false, Delayed = false;
  int Links = 0;
  bool First = false; ///< the stage's first input: gives size and time, cannot be delayed
};

enum class BoxKind
{
  Stage,
  Instance,
  Output, ///< of the pipeline
  TemplateInputs,
  TemplateOutput
};

struct GraphBox
{
  std::string Id, Title, Type, Doc;
  BoxKind Kind = BoxKind::Stage;
  bool Known = true; ///< false: no such type
  std::vector<GraphPin> Inputs, Outputs;
  const StageDescription* Description = nullptr;

  int FindInput(const std::string& name) const;
  int FindOutput(const std::string& name) const;
};

struct GraphLink
{
  int From = -1, FromPin = -1; ///< box and output pin; -1: what it names is not there
  int To = -1, ToPin = -1;
  int Index = 0; ///< of the input in its box, as EditDocument counts
  bool Delayed = false;
  std::string Text; ///< as written
};

/// May a link be drawn, and if not, why.
struct LinkVerdict
{
  bool Ok = false;
  bool Delay = false; ///< it has to read the previous frame
  bool Replaces = false;
  std::string Reason; ///< one sentence; also when it is fine but special
};

/// A scope of a document as boxes and links, for drawing and for judging edits.
class VTKQUELLVIEW_EXPORT GraphModel
{
public:
  /// `arrays`: what nodes can be asked for as far as a session found out (ViewFrame::Arrays).
  static GraphModel Build(const EditDocument& document, const std::string& scope, const StageRegistry& registry,
    const std::map<std::string, std::vector<OutputArray>>* arrays = nullptr);

  std::vector<GraphBox> Boxes;
  std::vector<GraphLink> Links;

  int Find(const std::string& id) const;
  /// How the array of a box is written in `from`.
  std::string Reference(int box, int pin) const;
  /// What BuildGraph would say to the link, before it is drawn. An input that takes one connection is replaced.
  LinkVerdict Judge(int from, int fromPin, int to, int toPin) const;
  /// The input pins of a type that take an array of this kind, -1: none. Prefers a port that has the array's name.
  static int BestInput(const StageDescription& type, const std::string& array, ArrayKind kind, int components);
  /// Whether the box can stand on the link: its first fitting input and an output that fits the reader. `inPort` and
  /// `outArray` are for EditDocument::InsertOnLink.
  bool FitsOnLink(
    const StageDescription& type, const GraphLink& link, int& inPort, std::string& outArray, std::string& reason) const;
  /// Box `a` is needed by `b` over links of the same frame.
  bool LeadsTo(int a, int b) const;
};

/// Whether a port of kind `wanted` takes an array; BuildGraph's rule.
VTKQUELLVIEW_EXPORT bool KindFits(ArrayKind wanted, ArrayKind kind, int components);

struct BoxSize
{
  double Width = 160, Height = 60;
};
/// Places for all boxes: producers left of readers, few crossings, no two boxes over each other. In the order of
/// `model.Boxes`; sizes likewise.
VTKQUELLVIEW_EXPORT std::vector<std::pair<double, double>> ArrangeGraph(
  const GraphModel& model, const std::vector<BoxSize>& sizes);

/// What a shown thing really is: an instance's output is an inner node's array. Unchanged when it is none.
VTKQUELLVIEW_EXPORT ViewTarget ResolveTarget(const PipelineDocument& document, const ViewTarget& target);
}

#endif
