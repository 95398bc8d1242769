// SPDX-License-Identifier: BSD-3-Clause
#include "quellXmlDocument.h"

#include "vtk_expat.h"

#include <algorithm>
#include <cstring>

namespace quell
{
namespace
{
bool IsBlank(char c)
{
  return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

/// expat callbacks; exceptions must not cross expat's C frames, and none is thrown but for lack of memory.
struct Builder
{
  XML_Parser Parser = nullptr;
  const std::string* Source = nullptr;
  std::string File;
  XmlLimits Limits;
  Diagnostics* Messages = nullptr;
  XmlElement Top; // holds the root as its only child
  std::vector<XmlElement*> Open;
  std::vector<std::string> Comments;
  int Elements = 0;
  bool Stopped = false;

  SourceLocation Here() const
  {
    SourceLocation place;
    place.File = this->File;
    place.Line = int(XML_GetCurrentLineNumber(this->Parser));
    place.Column = int(XML_GetCurrentColumnNumber(this->Parser)) + 1;
    return place;
  }

  void Stop(const std::string& what, const std::string& hint = {}) { this->Stop(this->Here(), what, hint); }
  void Stop(const SourceLocation& place, const std::string& what, const std::string& hint)
  {
    if (!this->Stopped)
    {
      this->Stopped = true;
      this->Messages->Error(place, {}, what, hint);
      XML_StopParser(this->Parser, XML_FALSE);
    }
  }

  bool Count()
  {
    if (++this->Elements > this->Limits.Elements)
    {
      this->Stop("more than " + std::to_string(this->Limits.Elements) + " elements and comments");
    }
    return !this->Stopped;
  }

  bool CheckName(const char* name)
  {
    if (std::strlen(name) > this->Limits.Name)
    {
      this->Stop("a name of more than " + std::to_string(this->Limits.Name) + " characters: " + Quoted(name));
    }
    return !this->Stopped;
  }

  // expat says where a tag starts, not where its attributes are: walk through the start tag's own bytes. In other
  // encodings than UTF-8 the byte at the index is no '<' or the names do not match; then the tag's place has to do.
  void PlaceAttributes(XmlElement& element) const
  {
    const XML_Index index = XML_GetCurrentByteIndex(this->Parser);
    if (index < 0 || std::size_t(index) >= this->Source->size())
    {
      return;
    }
    const char* p = this->Source->data() + index;
    const char* const end = this->Source->data() + this->Source->size();
    int line = element.Place.Line, column = element.Place.Column;
    const auto step = [&]()
    {
      if (*p == '\n')
      {
        ++line;
        column = 1;
      }
      else if ((static_cast<unsigned char>(*p) & 0xC0) != 0x80)
      {
        ++column;
      }
      ++p;
    };
    if (*p != '<')
    {
      return;
    }
    while (p != end && !IsBlank(*p) && *p != '>')
    {
      step();
    }
    for (XmlAttribute& attribute : element.Attributes)
    {
      while (p != end && IsBlank(*p))
      {
        step();
      }
      const std::size_t length = attribute.Name.size();
      if (std::size_t(end - p) <= length || std::memcmp(p, attribute.Name.data(), length) != 0)
      {
        return;
      }
      attribute.Place.Line = line;
      attribute.Place.Column = column;
      while (p != end && *p != '"' && *p != '\'')
      {
        step();
      }
      if (p == end)
      {
        return;
      }
      const char quote = *p;
      step();
      while (p != end && *p != quote)
      {
        step();
      }
      if (p == end)
      {
        return;
      }
      step();
    }
  }

  static void Start(void* data, const XML_Char* name, const XML_Char** attributes)
  {
    Builder& b = *static_cast<Builder*>(data);
    if (b.Stopped)
    {
      return;
    }
    if (int(b.Open.size()) > b.Limits.Depth)
    {
      b.Stop("elements are nested more than " + std::to_string(b.Limits.Depth) + " deep");
      return;
    }
    if (!b.Count() || !b.CheckName(name))
    {
      return;
    }
    int count = 0;
    for (const XML_Char** a = attributes; a[0]; a += 2)
    {
      if (++count > b.Limits.Attributes)
      {
        b.Stop("the element has more than " + std::to_string(b.Limits.Attributes) + " attributes");
        return;
      }
      if (!b.CheckName(a[0]))
      {
        return;
      }
      if (std::strlen(a[1]) > b.Limits.Value)
      {
        b.Stop("the value of attribute " + Quoted(a[0]) + " has more than " + std::to_string(b.Limits.Value) +
               " characters");
        return;
      }
    }
    XmlElement element;
    element.Name = name;
    element.Place = b.Here();
    element.Comments.swap(b.Comments);
    for (; attributes[0]; attributes += 2)
    {
      element.Attributes.push_back({ attributes[0], attributes[1], element.Place });
    }
    b.PlaceAttributes(element);
    // Only the innermost open element grows, so pointers to the others stay valid.
    XmlElement* parent = b.Open.back();
    parent->Children.push_back(std::move(element));
    b.Open.push_back(&parent->Children.back());
  }

  static void End(void* data, const XML_Char*)
  {
    Builder& b = *static_cast<Builder*>(data);
    if (!b.Stopped)
    {
      std::string& text = b.Open.back()->Text;
      text.erase(text.find_last_not_of(" \t\n\r") + 1);
      b.Open.back()->TrailingComments.swap(b.Comments);
      b.Comments.clear();
      b.Open.pop_back();
    }
  }

  static void Characters(void* data, const XML_Char* text, int length)
  {
    Builder& b = *static_cast<Builder*>(data);
    if (b.Stopped)
    {
      return;
    }
    XmlElement& element = *b.Open.back();
    if (element.Text.empty())
    {
      const char* end = text + length;
      const char* p = std::find_if_not(text, end, IsBlank);
      if (p == end)
      {
        return;
      }
      element.TextPlace = b.Here();
      element.TextPlace.Column += int(p - text);
      element.Text.assign(p, end);
    }
    else if (element.Text.size() < 200)
    {
      element.Text.append(text, std::size_t(length));
    }
  }

  // expat takes any word for a version; other parsers refuse such a file.
  static void Declaration(void* data, const XML_Char* version, const XML_Char*, int)
  {
    Builder& b = *static_cast<Builder*>(data);
    if (version && std::strcmp(version, "1.0") != 0)
    {
      b.Stop("the XML version is " + Quoted(version) + ", not \"1.0\"");
    }
  }

  static void Comment(void* data, const XML_Char* text)
  {
    Builder& b = *static_cast<Builder*>(data);
    if (!b.Stopped && b.Count())
    {
      b.Comments.push_back(text);
    }
  }

  static void Doctype(void* data, const XML_Char*, const XML_Char*, const XML_Char*, int)
  {
    // expat calls from within the declaration; its begin is what people look for.
    Builder& b = *static_cast<Builder*>(data);
    const XML_Index index = XML_GetCurrentByteIndex(b.Parser);
    const std::size_t start = index < 0 ? std::string::npos : b.Source->rfind("<!DOCTYPE", std::size_t(index));
    SourceLocation place = b.Here();
    if (start != std::string::npos)
    {
      place.Line = 1 + int(std::count(b.Source->begin(), b.Source->begin() + std::ptrdiff_t(start), '\n'));
      const std::size_t line = start == 0 ? std::string::npos : b.Source->rfind('\n', start - 1);
      place.Column = int(start - (line == std::string::npos ? 0 : line + 1)) + 1;
    }
    b.Stop(place, "document type declarations are not allowed",
      "pipelines need no DTD and no entities; use <variable> and <include>");
  }
};
}

const XmlAttribute* XmlElement::Find(const std::string& name) const
{
  for (const XmlAttribute& a : this->Attributes)
  {
    if (a.Name == name)
    {
      return &a;
    }
  }
  return nullptr;
}

bool ParseXml(
  const std::string& text, const std::string& file, XmlElement& root, Diagnostics& diagnostics, const XmlLimits& limits)
{
  SourceLocation whole;
  whole.File = file;
  if (text.size() > limits.Bytes)
  {
    diagnostics.Error(whole, {},
      "the file has " + std::to_string(text.size()) + " bytes, more than the " + std::to_string(limits.Bytes) +
        " allowed");
    return false;
  }
  Builder builder;
  builder.Source = &text;
  builder.File = file;
  builder.Limits = limits;
  builder.Messages = &diagnostics;
  builder.Open.push_back(&builder.Top);
  builder.Parser = XML_ParserCreate(nullptr);
  if (!builder.Parser)
  {
    diagnostics.Error(whole, {}, "the XML parser could not be made: out of memory");
    return false;
  }
  XML_SetUserData(builder.Parser, &builder);
  XML_SetElementHandler(builder.Parser, Builder::Start, Builder::End);
  XML_SetCharacterDataHandler(builder.Parser, Builder::Characters);
  XML_SetXmlDeclHandler(builder.Parser, Builder::Declaration);
  XML_SetCommentHandler(builder.Parser, Builder::Comment);
  XML_SetStartDoctypeDeclHandler(builder.Parser, Builder::Doctype);
  const XML_Status status = XML_Parse(builder.Parser, text.data(), int(text.size()), 1);
  if (status != XML_STATUS_OK && !builder.Stopped)
  {
    diagnostics.Error(
      builder.Here(), {}, std::string("not well-formed XML: ") + XML_ErrorString(XML_GetErrorCode(builder.Parser)));
  }
  XML_ParserFree(builder.Parser);
  if (status != XML_STATUS_OK || builder.Top.Children.empty())
  {
    return false;
  }
  root = std::move(builder.Top.Children.front());
  // Comments after the root element belong to its end.
  root.TrailingComments.insert(root.TrailingComments.end(), builder.Comments.begin(), builder.Comments.end());
  return true;
}

std::string EscapeXml(const std::string& text)
{
  std::string out;
  out.reserve(text.size());
  for (char c : text)
  {
    switch (c)
    {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\n':
        out += "&#10;";
        break; // attribute values are normalised: a plain newline would become a blank
      case '\r':
        out += "&#13;";
        break;
      case '\t':
        out += "&#9;";
        break;
      default:
        out += c;
    }
  }
  return out;
}
}
