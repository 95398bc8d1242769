// SPDX-License-Identifier: BSD-3-Clause
// The pipeline file's XML Schema in the hands of somebody else's validator.
#ifndef SchemaTools_h
#define SchemaTools_h

#include <cstdarg>
#include <cstdio>
#include <libxml/parser.h>
#include <libxml/xmlschemas.h>
#include <string>

/// A compiled schema; Error() is empty when it is one.
class SchemaValidator
{
public:
  explicit SchemaValidator(const std::string& xsd)
  {
    xmlSchemaParserCtxtPtr parser = xmlSchemaNewMemParserCtxt(xsd.data(), int(xsd.size()));
    xmlSchemaSetParserErrors(parser, Collect, Collect, &this->Text);
    this->Schema = xmlSchemaParse(parser);
    xmlSchemaFreeParserCtxt(parser);
  }
  ~SchemaValidator() { xmlSchemaFree(this->Schema); }
  SchemaValidator(const SchemaValidator&) = delete;
  SchemaValidator& operator=(const SchemaValidator&) = delete;

  const std::string& Error() const { return this->Text; }
  explicit operator bool() const { return this->Schema != nullptr; }

  /// Empty when the document is valid, else what is wrong with it.
  std::string Check(const std::string& document) const
  {
    std::string text;
    xmlDocPtr doc = xmlReadMemory(document.data(), int(document.size()), "document.xml", nullptr,
      XML_PARSE_NONET | XML_PARSE_NOERROR | XML_PARSE_NOWARNING);
    if (!doc)
      return "not well-formed";
    xmlSchemaValidCtxtPtr context = xmlSchemaNewValidCtxt(this->Schema);
    xmlSchemaSetValidErrors(context, Collect, Collect, &text);
    const int result = xmlSchemaValidateDoc(context, doc);
    if (result != 0 && text.empty())
      text = "error " + std::to_string(result);
    xmlSchemaFreeValidCtxt(context);
    xmlFreeDoc(doc);
    return text;
  }

private:
  static void Collect(void* text, const char* format, ...)
  {
    char line[2000];
    va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    *static_cast<std::string*>(text) += line;
  }

  xmlSchemaPtr Schema = nullptr;
  std::string Text;
};

#endif
