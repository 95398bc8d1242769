// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellDiagnostic_h
#define quellDiagnostic_h

#include "vtkQuellPipelineModule.h"

#include <string>
#include <vector>

namespace quell
{
/// A place in a pipeline file; lines and columns count from 1, columns in characters. Line 0: the file as a whole.
struct VTKQUELLPIPELINE_EXPORT SourceLocation
{
  std::string File;
  int Line = 0;
  int Column = 0;

  std::string ToText() const; ///< `file:line:col`, or `file` where there is no line
};

enum class Severity
{
  Error,
  Warning
};

/// One message about a pipeline, a plain record that a terminal prints and a viewer lists.
struct VTKQUELLPIPELINE_EXPORT Diagnostic
{
  Severity Level = Severity::Error;
  SourceLocation Place;
  std::string Where; ///< `node "atrous" (ATrousFilter)`; may be empty
  std::string What;
  std::string Hint;                 ///< may be empty
  std::vector<std::string> Context; ///< `in instance ...` lines, innermost first
  std::string Node;                 ///< path of the node concerned, for viewers; may be empty

  /// `file:line:col: error: where: what; hint` and one indented line per context; no newline at the end.
  std::string ToText() const;
};

/// All messages of one load. The same mistake of a template that is instantiated twice is kept once.
class VTKQUELLPIPELINE_EXPORT Diagnostics
{
public:
  void Add(Diagnostic d);
  void Error(
    const SourceLocation& place, const std::string& where, const std::string& what, const std::string& hint = {});
  void Warning(
    const SourceLocation& place, const std::string& where, const std::string& what, const std::string& hint = {});

  bool HasErrors() const { return this->Errors > 0; }
  int ErrorCount() const { return this->Errors; }
  int WarningCount() const { return int(this->Messages.size()) - this->Errors; }
  const std::vector<Diagnostic>& All() const { return this->Messages; }
  /// By file in order of first appearance, then line and column; equal places keep their order.
  void Sort();
  /// One message after the other, each line ended by a newline.
  std::string ToText() const;

private:
  std::vector<Diagnostic> Messages;
  int Errors = 0;
};

/// `"name"`: how diagnostics quote; control characters are shown as \xNN and long texts are cut.
VTKQUELLPIPELINE_EXPORT std::string Quoted(const std::string& text);
/// `did you mean "x"?`, or an empty text when nothing is near.
VTKQUELLPIPELINE_EXPORT std::string DidYouMean(const std::string& name, const std::vector<std::string>& names);
/// `a, b, c` with at most `limit` names, then `... (n more)`; "none" when there are none.
VTKQUELLPIPELINE_EXPORT std::string Listed(const std::vector<std::string>& names, std::size_t limit = 24);
}

#endif
