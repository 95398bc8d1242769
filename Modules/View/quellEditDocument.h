// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellEditDocument_h
#define quellEditDocument_h

#include "quellPipelineDocument.h"
#include "quellPipelinePatch.h"
#include "quellStageRegistry.h"
#include "vtkQuellViewModule.h"

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// A pipeline being edited: every change is a step that can be undone, and saving touches nothing else in the file.
/// A scope is "" (the pipeline itself) or the name of a template of this file. Functions that return bool or an id
/// leave the document alone when they refuse, and say why in `error`.
///
/// Boxes of a scope are named by the id of a node or instance, "output:NAME" for a pipeline's outputs, "@" for a
/// template's input ports and "port:NAME" for its output ports.
class VTKQUELLVIEW_EXPORT EditDocument
{
public:
  /// `registry` says which properties are paths: saved to another directory, relative ones are rewritten.
  explicit EditDocument(const StageRegistry* registry = nullptr);

  ///@{ Whole documents; each forgets the undo steps.
  void Clear();
  /// False when the file cannot be read or is no XML; then nothing changes. Mistakes in a readable file are the
  /// session's to show.
  bool Open(const std::string& file, std::vector<Diagnostic>& messages);
  /// A document that was made elsewhere (read from an image); it has no file yet.
  void Set(std::shared_ptr<const PipelineDocument> document);
  /// Writes under a temporary name and renames; what a symbolic link leads to is written, not the link. The first save
  /// of a document without a file needs a name. Saved into another directory, relative paths are changed so that they
  /// lead to the same files, in the states that can be undone and redone as well.
  bool Save(const std::string& file, std::string& error);
  /// Whether the file is no longer what was opened or saved here: saving would write over somebody else's work.
  bool ChangedOnDisk() const;
  ///@}

  const std::shared_ptr<const PipelineDocument>& Get() const { return this->Now.Document; }
  const PipelinePositions& Positions() const { return this->Now.Positions; }
  const std::string& File() const { return this->Path; }
  bool HasFile() const { return !this->Path.empty(); }
  /// The document, or where its boxes are, differs from the file.
  bool IsDirty() const;
  /// What saving would write.
  std::string Text() const;

  ///@{ Undo
  bool CanUndo() const { return !this->Undone.empty(); }
  bool CanRedo() const { return !this->Redone.empty(); }
  std::string UndoLabel() const { return this->Undone.empty() ? std::string() : this->Undone.back().Label; }
  std::string RedoLabel() const { return this->Redone.empty() ? std::string() : this->Redone.back().Label; }
  void Undo();
  void Redo();
  /// Ends a series of changes that count as one step (a slider that is dragged).
  void EndMerge() { this->MergeKey.clear(); }
  /// Puts a whole document in place, as a step: what a point of the trade-off panel returns to.
  void Replace(const std::string& label, std::shared_ptr<const PipelineDocument> document);
  ///@}

  ///@{ Nodes
  std::string AddNode(
    const std::string& scope, const std::string& type, double x, double y, const std::string& idHint = std::string());
  std::string AddInstance(const std::string& scope, const std::string& templateName, double x, double y);
  /// With links to them. `reconnect`: whoever read a node reads what its first port read; all of it where the reader
  /// takes several connections. `unread`: one sentence about what of the same kind was lost by that; empty: nothing.
  bool Remove(const std::string& scope, const std::vector<std::string>& boxes, bool reconnect = false,
    std::string* unread = nullptr);
  std::vector<std::string> Duplicate(
    const std::string& scope, const std::vector<std::string>& boxes, double dx, double dy);
  /// Every reference in the scope follows.
  bool Rename(const std::string& scope, const std::string& box, const std::string& name, std::string& error);
  void Move(const std::string& scope, const std::vector<std::pair<std::string, std::pair<double, double>>>& to);
  /// Where boxes without a place of their own are drawn, by PositionKey. When boxes come, go or get another name, they
  /// stay there: the file then says so, too.
  void SetShownPlaces(const PipelinePositions& places);
  /// Of all boxes of a scope at once, as one step.
  void Arrange(const std::string& scope, const std::vector<std::pair<std::string, std::pair<double, double>>>& to);
  /// Nodes, instances and the pipeline's outputs, with the variables they read; `count`: how many of the boxes these
  /// are.
  std::string CopyXml(
    const std::string& scope, const std::vector<std::string>& boxes, std::size_t* count = nullptr) const;
  /// Nodes, instances and, into a pipeline, outputs of a pipeline text; names that exist get a number, references among
  /// them follow. Variables that there are not yet come along.
  std::vector<std::string> PasteXml(
    const std::string& scope, const std::string& text, double x, double y, std::string& error);
  ///@}

  ///@{ Links. `from` is "node:array" or "@port".
  /// Replaces what a port that takes one connection had.
  bool Connect(const std::string& scope, const std::string& from, const std::string& box, const std::string& port,
    bool delayed, bool repeatable, std::string& error);
  /// The `index`-th input of the box, in the order of the document.
  bool Disconnect(const std::string& scope, const std::string& box, int index);
  /// Reads the input `index` of `box` anew from `from`.
  bool Reconnect(const std::string& scope, const std::string& box, int index, const std::string& from);
  bool SetDelay(const std::string& scope, const std::string& box, int index, bool delayed);
  /// One step: `type` between a link's producer and its reader.
  std::string InsertOnLink(const std::string& scope, const std::string& box, int index, const StageDescription& type,
    int inPort, const std::string& outArray, double x, double y);
  /// The same with a node that is there already.
  bool PutOnLink(const std::string& scope, const std::string& box, int index, const std::string& node,
    const StageDescription& type, int inPort, const std::string& outArray);
  ///@}

  ///@{ Values. `mergeKey`: changes with the same key in a row are one step, until EndMerge.
  void SetProperty(const std::string& scope, const std::string& box, const std::string& name, const std::string& value,
    bool merge = false);
  void ResetProperty(const std::string& scope, const std::string& box, const std::string& name);
  /// As written in the file; null where it is not.
  const PipelineText* FindProperty(const std::string& scope, const std::string& box, const std::string& name) const;
  void SetDoc(const std::string& scope, const std::string& box, const std::string& doc);
  void SetPipelineDoc(const std::string& doc);
  bool SetVariable(const std::string& name, const std::string& value, bool merge = false);
  bool AddVariable(const std::string& name, const std::string& type, const std::string& value, std::string& error);
  bool RemoveVariable(const std::string& name);
  /// A variable of that type with the property's value, which the property then reads; in a template a parameter of
  /// it. Returns its name.
  std::string MakeVariable(
    const std::string& scope, const std::string& box, const Property& row, const std::string& value);
  /// The templates of another file; a path is seen from this one's directory. True when it is included already.
  bool AddInclude(const std::string& file, std::string& error);
  ///@{ Templates of this file
  /// Puts nodes of the pipeline into a template of their own with an instance in their place; links that cross become
  /// ports. `typeOf(from)`: the kind of what a link reads, empty where it is not known. Returns the instance's name.
  std::string MakeTemplate(const std::vector<std::string>& boxes, const std::string& name,
    const std::function<std::string(const std::string&)>& typeOf, std::string& error);
  /// A copy of a template of an included file, in this one, where it can be edited; all instances become its. Returns
  /// its name.
  std::string AdoptTemplate(const std::string& name, std::string& error);
  bool AddTemplateInput(const std::string& scope, const std::string& name, const std::string& type, std::string& error);
  /// Without `from` the port is to be connected.
  bool AddTemplateOutput(
    const std::string& scope, const std::string& name, const std::string& from, std::string& error);
  /// With the links that use it, in the template and at its instances.
  bool RemoveTemplatePort(const std::string& scope, const std::string& name);
  /// Links in the template and at its instances follow.
  bool RenameTemplatePort(
    const std::string& scope, const std::string& port, const std::string& name, std::string& error);
  ///@}
  void SetTime(const std::string& first, const std::string& count, const std::string& rate);
  std::string AddOutput(const std::string& from, double x, double y);
  /// Attributes "file", "view", "display", "from".
  bool SetOutput(const std::string& name, const std::string& attribute, const std::string& value, bool merge = false);
  ///@}

  ///@{ Looking things up
  const PipelineNode* FindNode(const std::string& scope, const std::string& id) const;
  const std::vector<PipelineNode>& Nodes(const std::string& scope) const;
  const PipelineTemplate* FindTemplate(const std::string& name) const; ///< in this file and those it includes
  bool IsEditable(const std::string& scope) const;                     ///< false for templates of included files
  /// A name that is not taken yet in the scope: "blur", "blur2" ...
  std::string FreeName(const std::string& scope, const std::string& hint) const;
  ///@}

  /// Grows with every change.
  std::uint64_t Revision() const { return this->Count; }

private:
  struct State
  {
    std::shared_ptr<const PipelineDocument> Document;
    PipelinePositions Positions;
  };
  struct Step
  {
    State Before;
    std::string Label;
  };
  PipelineDocument& Begin(); ///< a copy to be changed
  void Commit(const std::string& label, const std::string& mergeKey = std::string());
  std::vector<PipelineNode>* EditNodes(PipelineDocument& d, const std::string& scope) const;
  PipelineNode* EditNode(PipelineDocument& d, const std::string& scope, const std::string& id) const;
  PipelineTemplate* EditTemplate(PipelineDocument& d, const std::string& name) const;
  std::string FreeTemplateName(const std::string& hint) const;
  void Locate();
  void Place(const std::string& scope, const std::string& box, double x, double y);
  void KeepPlaces();
  void MovePaths(PipelineDocument& d, const std::string& directory) const;

  const StageRegistry* Registry = nullptr;
  State Now;
  std::shared_ptr<PipelineDocument> Draft;
  PipelinePositions DraftPositions;
  PipelinePositions ShownPlaces;
  std::vector<Step> Undone, Redone; ///< Redone holds what Redo puts back
  std::string MergeKey;
  std::string Path, SavedText; ///< as it is on disk
  std::shared_ptr<const PipelineDocument> SavedDocument;
  PipelinePositions SavedPositions;
  std::uint64_t Count = 0;
};

/// `svgf/atrous`: how a box is called in the file's positions.
VTKQUELLVIEW_EXPORT std::string PositionKey(const std::string& scope, const std::string& box);
/// Letters, digits, _ and -, beginning with a letter or _.
VTKQUELLVIEW_EXPORT bool IsPipelineName(const std::string& name);
}

#endif
