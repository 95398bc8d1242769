// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellXmlDocument_h
#define quellXmlDocument_h

#include "quellDiagnostic.h"
#include "vtkQuellPipelineModule.h"

#include <string>
#include <vector>

namespace quell
{
struct XmlAttribute
{
  std::string Name, Value;
  SourceLocation Place; ///< of the attribute's name
};

struct VTKQUELLPIPELINE_EXPORT XmlElement
{
  std::string Name;
  SourceLocation Place; ///< of the start tag's '<'
  std::vector<XmlAttribute> Attributes;
  std::vector<XmlElement> Children;
  std::vector<std::string> Comments;         ///< comments before the start tag
  std::vector<std::string> TrailingComments; ///< comments after the last child
  std::string Text;                          ///< character data that is not white space
  SourceLocation TextPlace;

  const XmlAttribute* Find(const std::string& name) const;
};

/// What a document may be at most; beyond, parsing stops with an error.
struct XmlLimits
{
  std::size_t Bytes = 16u << 20;
  std::size_t Name = 256;    ///< characters of an element's or attribute's name
  std::size_t Value = 65536; ///< characters of an attribute's value
  int Depth = 64;
  int Elements = 100000; ///< elements and comments
  int Attributes = 64;   ///< of one element
};

/// Parses a whole document with expat. Document type declarations are refused (and with them entity bombs and external
/// entities). False after an error, which is in `diagnostics` with its position.
VTKQUELLPIPELINE_EXPORT bool ParseXml(const std::string& text, const std::string& file, XmlElement& root,
  Diagnostics& diagnostics, const XmlLimits& limits = XmlLimits());

/// Attribute and text escaping, so that what ParseXml reads back is `text`.
VTKQUELLPIPELINE_EXPORT std::string EscapeXml(const std::string& text);
}

#endif
