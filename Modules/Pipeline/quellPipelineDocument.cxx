// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelineDocument.h"

#include <algorithm>

namespace quell
{
namespace
{
bool Same(const PipelineText& a, const PipelineText& b)
{
  return a.Given == b.Given && a.Value == b.Value;
}
bool SameItem(const PipelineItem& a, const PipelineItem& b)
{
  return a.Comments == b.Comments && a.TrailingComments == b.TrailingComments;
}
bool Same(const PipelineVariable& a, const PipelineVariable& b)
{
  return SameItem(a, b) && Same(a.Name, b.Name) && Same(a.Type, b.Type) && Same(a.Default, b.Default) &&
         Same(a.Doc, b.Doc);
}
bool Same(const PipelineProperty& a, const PipelineProperty& b)
{
  return SameItem(a, b) && Same(a.Name, b.Name) && Same(a.Value, b.Value);
}
bool Same(const PipelineAttribute& a, const PipelineAttribute& b)
{
  return a.Name == b.Name && Same(a.Value, b.Value);
}
bool Same(const PipelinePort& a, const PipelinePort& b)
{
  return SameItem(a, b) && Same(a.Name, b.Name) && Same(a.Type, b.Type) && Same(a.From, b.From) && Same(a.Doc, b.Doc);
}
bool Same(const PipelineLayer& a, const PipelineLayer& b)
{
  return SameItem(a, b) && Same(a.From, b.From) && Same(a.Name, b.Name) && Same(a.Optional, b.Optional);
}
bool Same(const PipelineInclude& a, const PipelineInclude& b)
{
  return SameItem(a, b) && Same(a.File, b.File);
}
// The vector comparison below finds these by declaration only.
bool Same(const PipelineInput& a, const PipelineInput& b);
bool Same(const PipelineNode& a, const PipelineNode& b);
bool Same(const PipelineTemplate& a, const PipelineTemplate& b);
bool Same(const PipelineOutput& a, const PipelineOutput& b);

template <class T>
bool Same(const std::vector<T>& a, const std::vector<T>& b)
{
  return a.size() == b.size() &&
         std::equal(a.begin(), a.end(), b.begin(), [](const T& x, const T& y) { return Same(x, y); });
}
bool Same(const PipelineInput& a, const PipelineInput& b)
{
  return SameItem(a, b) && Same(a.Port, b.Port) && Same(a.From, b.From) && Same(a.Delay, b.Delay) &&
         Same(a.Optional, b.Optional) && Same(a.Attributes, b.Attributes);
}
bool Same(const PipelineNode& a, const PipelineNode& b)
{
  return SameItem(a, b) && a.IsInstance == b.IsInstance && Same(a.Id, b.Id) && Same(a.Type, b.Type) &&
         Same(a.Doc, b.Doc) && Same(a.Properties, b.Properties) && Same(a.Inputs, b.Inputs);
}
bool Same(const PipelineTemplate& a, const PipelineTemplate& b)
{
  return SameItem(a, b) && Same(a.Name, b.Name) && Same(a.Doc, b.Doc) && Same(a.Parameters, b.Parameters) &&
         Same(a.Inputs, b.Inputs) && Same(a.Outputs, b.Outputs) && Same(a.Nodes, b.Nodes);
}
bool Same(const PipelineOutput& a, const PipelineOutput& b)
{
  return SameItem(a, b) && Same(a.Name, b.Name) && Same(a.From, b.From) && Same(a.File, b.File) &&
         Same(a.View, b.View) && Same(a.Display, b.Display) && Same(a.Doc, b.Doc) && Same(a.Properties, b.Properties) &&
         Same(a.Layers, b.Layers);
}
bool Same(const PipelineTime& a, const PipelineTime& b)
{
  return SameItem(a, b) && a.Given == b.Given && Same(a.First, b.First) && Same(a.Count, b.Count) &&
         Same(a.Rate, b.Rate);
}
}

bool PipelineDocument::operator==(const PipelineDocument& o) const
{
  return SameItem(*this, o) && Same(this->Version, o.Version) && Same(this->Doc, o.Doc) &&
         Same(this->Schema, o.Schema) && Same(this->Includes, o.Includes) && Same(this->Variables, o.Variables) && Same(this->Time, o.Time) &&
         Same(this->Templates, o.Templates) && Same(this->Nodes, o.Nodes) && Same(this->Outputs, o.Outputs);
}
}
