// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPipelineDocument_h
#define quellPipelineDocument_h

#include "quellDiagnostic.h"
#include "vtkQuellPipelineModule.h"

#include <memory>
#include <string>
#include <vector>

namespace quell
{
/// An attribute's value exactly as written, `$(name)` unexpanded. Given is false when the attribute is missing.
struct PipelineText
{
  std::string Value;
  SourceLocation Place;
  bool Given = false;

  PipelineText() = default;
  PipelineText(const std::string& value)
    : Value(value)
    , Given(true)
  {
  }
  PipelineText(const char* value)
    : Value(value)
    , Given(true)
  {
  }
};

/// What every element of the file has.
struct PipelineItem
{
  SourceLocation Place;
  std::vector<std::string> Comments;         ///< before the element
  std::vector<std::string> TrailingComments; ///< before its end tag
};

/// <variable> and a template's <parameter>.
struct PipelineVariable : PipelineItem
{
  PipelineText Name, Type, Default, Doc;
};

/// <property> and an instance's <parameter>.
struct PipelineProperty : PipelineItem
{
  PipelineText Name, Value;
};

struct PipelineAttribute
{
  std::string Name;
  PipelineText Value;
};

/// <input port= from= [delay=] [optional=] [attributes of the stage's own]>
struct PipelineInput : PipelineItem
{
  using Attribute = PipelineAttribute;
  PipelineText Port, From, Delay, Optional;
  std::vector<Attribute> Attributes;
};

/// <node> or <instance>; for an instance Type is the template's name and Properties are its parameters.
struct PipelineNode : PipelineItem
{
  bool IsInstance = false;
  PipelineText Id, Type, Doc;
  std::vector<PipelineProperty> Properties;
  std::vector<PipelineInput> Inputs;
};

/// <port> of a template; with From it is an output.
struct PipelinePort : PipelineItem
{
  PipelineText Name, Type, From, Doc;
};

struct PipelineTemplate : PipelineItem
{
  PipelineText Name, Doc;
  std::vector<PipelineVariable> Parameters;
  std::vector<PipelinePort> Inputs, Outputs;
  std::vector<PipelineNode> Nodes;
};

/// <layer from= [name=] [optional=]> of an output.
struct PipelineLayer : PipelineItem
{
  PipelineText From, Name, Optional;
};

struct PipelineOutput : PipelineItem
{
  PipelineText Name, From, File, View, Display, Doc;
  std::vector<PipelineProperty> Properties; ///< of the writer, else of the view's transform
  std::vector<PipelineLayer> Layers;
};

struct PipelineDocument;

struct PipelineInclude : PipelineItem
{
  PipelineText File;
  std::shared_ptr<const PipelineDocument> Content; ///< null: could not be read, or included before
};

struct PipelineTime : PipelineItem
{
  bool Given = false;
  PipelineText First, Count, Rate;
};

/// A pipeline file as written, before variables and templates are expanded. Equality ignores places and contents of
/// included files: two documents are equal when they write the same file.
struct VTKQUELLPIPELINE_EXPORT PipelineDocument : PipelineItem
{
  std::string File;      ///< as given; messages say it
  std::string Directory; ///< of File; "" is the working directory
  PipelineText Version, Doc;
  /// xmlns:P and P:noNamespaceSchemaLocation of the root, by which editors find the schema; kept as they are.
  std::vector<PipelineAttribute> Schema;
  std::vector<PipelineInclude> Includes;
  std::vector<PipelineVariable> Variables;
  PipelineTime Time;
  std::vector<PipelineTemplate> Templates;
  std::vector<PipelineNode> Nodes;
  std::vector<PipelineOutput> Outputs;

  bool operator==(const PipelineDocument& other) const;
  bool operator!=(const PipelineDocument& other) const { return !(*this == other); }
};

/// Visits every attribute of these nodes that may hold variables.
template <class F>
void EachText(const std::vector<PipelineNode>& nodes, const F& visit)
{
  for (const PipelineNode& n : nodes)
  {
    visit(n.Id);
    visit(n.Type);
    for (const PipelineProperty& p : n.Properties)
    {
      visit(p.Name);
      visit(p.Value);
    }
    for (const PipelineInput& i : n.Inputs)
    {
      visit(i.Port);
      visit(i.From);
      visit(i.Delay);
      visit(i.Optional);
      for (const PipelineInput::Attribute& a : i.Attributes)
      {
        visit(a.Value);
      }
    }
  }
}

/// Visits every attribute of one file that may refer to variables, other than the variables' own defaults.
template <class F>
void EachText(const PipelineDocument& d, const F& visit)
{
  for (const PipelineText* t : { &d.Time.First, &d.Time.Count, &d.Time.Rate })
  {
    visit(*t);
  }
  for (const PipelineTemplate& t : d.Templates)
  {
    for (const PipelineVariable& v : t.Parameters)
    {
      visit(v.Default);
    }
    for (const PipelinePort& p : t.Outputs)
    {
      visit(p.From);
    }
    EachText(t.Nodes, visit);
  }
  EachText(d.Nodes, visit);
  for (const PipelineOutput& o : d.Outputs)
  {
    for (const PipelineText* t : { &o.From, &o.File, &o.View, &o.Display })
    {
      visit(*t);
    }
    for (const PipelineProperty& p : o.Properties)
    {
      visit(p.Name);
      visit(p.Value);
    }
    for (const PipelineLayer& l : o.Layers)
    {
      visit(l.From);
      visit(l.Name);
      visit(l.Optional);
    }
  }
}
}

#endif
