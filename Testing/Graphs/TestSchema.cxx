// SPDX-License-Identifier: BSD-3-Clause
// The XML Schema says what the reader says: it accepts what is accepted, and refuses every kind of mistake that a
// schema can express. What it cannot is marked so here, and listed in Documentation/pipeline-format.md.
#include "../AllStages.h"
#include "SchemaTools.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"
#include "quellPipelineSchema.h"
#include "quellPipelineWriter.h"

#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
const SchemaValidator& Schema()
{
  static const SchemaValidator schema(PipelineXsd(Registry()));
  return schema;
}

std::string Messages(const std::string& text, const std::string& file)
{
  Diagnostics messages;
  const auto document = ReadPipelineText(text, file, messages);
  if (document->Place.Line > 0)
    BuildGraph(document, Registry(), {}, messages);
  std::string errors;
  for (const Diagnostic& d : messages.All())
    if (d.Level == Severity::Error)
      errors += d.ToText() + "\n";
  return errors;
}

std::string Contents(const fs::path& file)
{
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

// A source that needs no file, for short documents.
const std::string Pt = "<node id=\"pt\" type=\"PathTraceSource\"><property name=\"Scene\" value=\"" QUELL_SOURCE_DIR
                       "/Data/Scenes/cornell-box.gltf\"/></node>";
const std::string Out = "<output name=\"o\" from=\"pt:radiance\"/>";
const std::string Template =
  "<template name=\"t\"><parameter name=\"r\" type=\"int\" default=\"2\"/><port name=\"in\" "
  "type=\"color\"/><node id=\"b\" type=\"BilateralFilter\"><input port=\"radiance\" from=\"@in\"/>"
  "<property name=\"Radius\" value=\"$(r)\"/></node><port name=\"out\" from=\"b:radiance\"/></template>";

std::string Pipeline(const std::string& body)
{
  return "<pipeline version=\"1\">" + body + "</pipeline>";
}
std::string Node(const std::string& inside, const std::string& attributes = "id=\"b\" type=\"BilateralFilter\"")
{
  return Pipeline(Pt + "<node " + attributes + "><input port=\"radiance\" from=\"pt:radiance\"/>" + inside + "</node>" +
                  "<output name=\"o\" from=\"b:radiance\"/>");
}
std::string Instance(const std::string& inside, const std::string& attributes = "id=\"i\" template=\"t\"")
{
  return Pipeline(Template + Pt + "<instance " + attributes + "><input port=\"in\" from=\"pt:radiance\"/>" + inside +
                  "</instance><output name=\"o\" from=\"i:out\"/>");
}

struct Case
{
  const char* Name;
  std::string Document;
};
}

TEST(Schema, IsASchema)
{
  ASSERT_TRUE(Schema()) << Schema().Error();
  EXPECT_EQ(Schema().Error(), "");
  EXPECT_EQ(Contents(QUELL_SOURCE_DIR "/Documentation/pipeline.xsd"), PipelineXsd(Registry()));
}

TEST(Schema, AcceptsEveryFileOfThisProject)
{
  int files = 0;
  for (const char* folder : { "Data/Pipelines", "Testing/FilterStudy" })
  {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(QUELL_SOURCE_DIR) / folder))
    {
      if (entry.path().extension() == ".xml")
      {
        EXPECT_EQ(Schema().Check(Contents(entry.path())), "") << entry.path();
        ++files;
        // What the program writes is valid too.
        Diagnostics messages;
        const auto document = ReadPipelineFile(entry.path().string(), messages);
        EXPECT_EQ(messages.ToText(), "");
        EXPECT_EQ(Schema().Check(WritePipelineText(*document)), "") << entry.path();
      }
    }
  }
  EXPECT_GE(files, 15);
}

TEST(Schema, AcceptsWhatTheReaderAccepts)
{
  const std::string xsi = "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\"";
  const std::vector<Case> cases = {
    { "nothing but a version", "<pipeline version=\"1\"/>" },
    { "schema location", "<pipeline version=\"1\" " + xsi + " xsi:noNamespaceSchemaLocation=\"pipeline.xsd\"/>" },
    { "another prefix and a schemaLocation", "<pipeline xmlns:s=\"http://www.w3.org/2001/XMLSchema-instance\" "
                                             "xmlns:other=\"urn:x\" s:schemaLocation=\"urn:x x.xsd\" version=\"1\"/>" },
    { "numbers with blanks and a sign", Pipeline("<time first=\" -3 \" count=\"+2\" rate=\" 2.5e1\"/>" + Pt + Out) },
    { "version with blanks", "<pipeline version=\" 1 \"/>" },
    { "time between other things, computed", Pipeline("<variable name=\"n\" type=\"int\" default=\"3\"/>" + Pt +
                                                      "<time count=\"$(n)\" rate=\"1e-6\"/>" + Out) },
    { "variables of every type",
      Pipeline("<variable name=\"a\" type=\"int\" default=\" 7 \"/><variable name=\"b\" "
               "type=\"double\" default=\"1e-3\"/><variable name=\"_c-2\" type=\"bool\" "
               "default=\"true\" doc=\"d\"/><variable name=\"d\" type=\"string\" default=\"$$(x)\"/>"
               "<variable name=\"e\" type=\"path\" default=\"\"/>") },
    { "type, id, port and property computed",
      Pipeline("<variable name=\"t\" type=\"string\" default=\"BilateralFilter\"/><variable name=\"p\" type=\"string\" "
               "default=\"radiance\"/><variable name=\"r\" type=\"string\" default=\"Radius\"/>" +
               Pt +
               "<node id=\"x$(r)\" type=\"$(t)\"><input port=\"$(p)\" from=\"pt:$(p)\"/><property name=\"$(r)\" "
               "value=\"2\"/></node><output name=\"o\" from=\"xRadius\"/>") },
    { "attributes of guides",
      Node("<input port=\"guide\" from=\"pt:albedo\" distance=\"euclidean\" sigma=\"0.1\" name=\"g\"/>"
           "<input port=\"guideVariance\" from=\"pt:varianceAlbedo\" guide=\"g\"/>") },
    { "delay and optional", Node("<input port=\"depth\" from=\"pt:depth\" delay=\"true\"/><input port=\"albedo\" "
                                 "from=\"pt:albedo\" optional=\" 1 \"/>") },
    { "template and instance", Instance("<parameter name=\"r\" value=\"3\"/>") },
    { "a delay of an instance that is none",
      Pipeline(
        Template + Pt +
        "<instance id=\"i\" template=\"t\"><input port=\"in\" from=\"pt\" delay=\" 0 \" optional=\"1\"/></instance>" +
        "<output name=\"o\" from=\"i\"/>") },
    { "templates in templates, links into them",
      Pipeline(
        Template +
        "<template name=\"u\" doc=\"d\"><port name=\"in\"/><instance id=\"x\" template=\"t\"><input port=\"in\" "
        "from=\"@in\"/></instance><port name=\"out\" from=\"x:out\"/><port name=\"raw\" from=\"@in\"/></template>" +
        Pt +
        "<instance id=\"i\" template=\"u\"><input port=\"in\" from=\"pt\"/></instance><output name=\"o\" "
        "from=\"i/x/b:radiance\"/>") },
    { "one name for a port in and a port out",
      Pipeline("<template name=\"u\"><port name=\"x\"/><port name=\"x\" from=\"@x\"/></template>") },
    { "outputs",
      Pipeline(Pt + "<output name=\"a\" from=\"pt:radiance\" file=\"a.####.exr\" doc=\"d\"><property name=\"Half\" "
                    "value=\"true\"/><layer from=\"pt:depth\" name=\"z\"/></output><output name=\"b\" from=\"pt\" "
                    "file=\"$(v).png\" view=\"sRGB\"><property name=\"Exposure\" value=\"1\"/></output><output "
                    "name=\"c\"><layer from=\"pt:albedo\"/></output><variable name=\"v\" type=\"string\" "
                    "default=\"x\"/>") },
    { "comments and processing instructions",
      "<?xml version=\"1.0\"?><!-- a --><?editor folded?><pipeline version=\"1\"><!-- b --></pipeline><!-- c -->" },
  };
  for (const Case& c : cases)
  {
    EXPECT_EQ(Messages(c.Document, "p.xml"), "") << c.Name;
    EXPECT_EQ(Schema().Check(c.Document), "") << c.Name;
  }
}

TEST(Schema, RefusesWhatTheReaderRefuses)
{
  const std::string longName(129, 'a');
  const std::vector<Case> cases = {
    { "malformed", "<pipeline version=\"1\"><node></pipeline>" },
    { "root", "<graph version=\"1\"/>" },
    { "namespace", "<pipeline xmlns=\"urn:x\" version=\"1\"/>" },
    { "no version", "<pipeline/>" },
    { "newer version", "<pipeline version=\"2\"/>" },
    { "version 0", "<pipeline version=\"0\"/>" },
    { "version is no number", "<pipeline version=\"one\"/>" },
    { "root attribute", "<pipeline version=\"1\" name=\"x\"/>" },
    { "unknown element", Pipeline("<nodes/>") },
    { "element in the wrong place", Pipeline("<property name=\"Radius\" value=\"1\"/>") },
    { "property in an instance", Instance("<property name=\"Radius\" value=\"1\"/>") },
    { "parameter in a node", Node("<parameter name=\"Radius\" value=\"1\"/>") },
    { "text", Pipeline("text") },
    { "text in a node", Node("text") },
    { "include without file", Pipeline("<include/>") },
    { "include of nothing", Pipeline("<include file=\"\"/>") },
    { "include with a variable", Pipeline("<include file=\"$(x).xml\"/>") },
    { "time twice", Pipeline("<time/><time/>") },
    { "time count", Pipeline("<time count=\"0\"/>") },
    { "time count is no number", Pipeline("<time count=\"many\"/>") },
    { "time first", Pipeline("<time first=\"1.5\"/>") },
    { "time rate", Pipeline("<time rate=\"0\"/>") },
    { "time rate not finite", Pipeline("<time rate=\"NaN\"/>") },
    { "time is endless", Pipeline("<time count=\"99999999999999999999\"/>") },
    { "variable without default", Pipeline("<variable name=\"a\" type=\"int\"/>") },
    { "variable type", Pipeline("<variable name=\"a\" type=\"integer\" default=\"1\"/>") },
    { "variable name", Pipeline("<variable name=\"1a\" type=\"int\" default=\"1\"/>") },
    { "variable name too long", Pipeline("<variable name=\"" + longName + "\" type=\"int\" default=\"1\"/>") },
    { "variable twice",
      Pipeline("<variable name=\"a\" type=\"int\" default=\"1\"/><variable name=\"a\" type=\"int\" default=\"1\"/>") },
    { "node without id", Node("", "type=\"BilateralFilter\"") },
    { "node without type", Node("", "id=\"b\"") },
    { "node type", Node("", "id=\"b\" type=\"BilateralFiltre\"") },
    { "node id", Node("", "id=\"b b\" type=\"BilateralFilter\"") },
    { "id twice", Pipeline(Pt + Pt + Out) },
    { "id of node and instance",
      Pipeline(
        Template + Pt + "<instance id=\"pt\" template=\"t\"><input port=\"in\" from=\"pt\"/></instance>" + Out) },
    { "id twice in a template", Pipeline("<template name=\"u\">" + Pt + Pt + "</template>") },
    { "node attribute", Node("", "id=\"b\" type=\"BilateralFilter\" color=\"red\"") },
    { "property nobody has", Node("<property name=\"Radios\" value=\"1\"/>") },
    { "property without value", Node("<property name=\"Radius\"/>") },
    { "property twice", Node("<property name=\"Radius\" value=\"1\"/><property name=\"Radius\" value=\"2\"/>") },
    { "property of an output",
      Pipeline(Pt + "<output name=\"o\" from=\"pt\" file=\"x.exr\"><property name=\"Radius\" value=\"1\"/></output>") },
    { "property of an output twice",
      Pipeline(Pt + "<output name=\"o\" from=\"pt\" file=\"x.exr\"><property name=\"Half\" value=\"1\"/><property "
                    "name=\"Half\" value=\"0\"/></output>") },
    { "input nobody has", Node("<input port=\"normals\" from=\"pt:normal\"/>") },
    { "input without port", Node("<input from=\"pt:normal\"/>") },
    { "input without from", Node("<input port=\"normal\"/>") },
    { "from empty", Node("<input port=\"normal\" from=\"\"/>") },
    { "from without array", Node("<input port=\"normal\" from=\"pt:\"/>") },
    { "from without node", Node("<input port=\"normal\" from=\":normal\"/>") },
    { "from with a blank", Node("<input port=\"normal\" from=\"p t:normal\"/>") },
    { "port outside of a template", Node("<input port=\"normal\" from=\"@n\"/>") },
    { "delay", Node("<input port=\"normal\" from=\"pt:normal\" delay=\"2\"/>") },
    { "optional", Node("<input port=\"normal\" from=\"pt:normal\" optional=\"maybe\"/>") },
    { "input attribute nobody has", Node("<input port=\"guide\" from=\"pt:normal\" sgima=\"1\"/>") },
    { "instance without template", Instance("", "id=\"i\"") },
    { "instance's template is no name", Instance("", "id=\"i\" template=\"a b\"") },
    { "optional of an instance", Instance("<input port=\"in\" from=\"pt\" optional=\"maybe\"/>") },
    { "parameter twice", Instance("<parameter name=\"r\" value=\"1\"/><parameter name=\"r\" value=\"2\"/>") },
    { "template twice", Pipeline(Template + Template) },
    { "template name", Pipeline("<template name=\"a/b\"/>") },
    { "template parameter twice",
      Pipeline("<template name=\"u\"><parameter name=\"a\" type=\"int\" default=\"1\"/><parameter name=\"a\" "
               "type=\"int\" default=\"1\"/></template>") },
    { "template parameter type",
      Pipeline("<template name=\"u\"><parameter name=\"a\" type=\"float\" default=\"1\"/></template>") },
    { "template port name", Pipeline("<template name=\"u\"><port name=\"a:b\"/></template>") },
    { "template port type", Pipeline("<template name=\"u\"><port name=\"a\" type=\"colour\"/></template>") },
    { "template port from", Pipeline("<template name=\"u\"><port name=\"a\" from=\"@\"/></template>") },
    { "template in a template", Pipeline("<template name=\"u\"><template name=\"v\"/></template>") },
    { "output without name", Pipeline(Pt + "<output from=\"pt\"/>") },
    { "output name",
      Pipeline(Pt + "<output name=\"$(x)\" from=\"pt\"/><variable name=\"x\" type=\"string\" default=\"y\"/>") },
    { "output twice", Pipeline(Pt + Out + Out) },
    { "output file empty", Pipeline(Pt + "<output name=\"o\" from=\"pt\" file=\"\"/>") },
    { "output from a port", Pipeline(Pt + "<output name=\"o\" from=\"@pt\"/>") },
    { "layer without from", Pipeline(Pt + "<output name=\"o\" from=\"pt\"><layer name=\"x\"/></output>") },
  };
  for (const Case& c : cases)
  {
    EXPECT_NE(Messages(c.Document, "p.xml"), "") << "the reader takes: " << c.Name;
    EXPECT_NE(Schema().Check(c.Document), "") << "the schema takes: " << c.Name;
  }
}

// When one of these is refused by the schema after all: strike it from here and from the list in the documentation.
TEST(Schema, CannotExpress)
{
  const std::vector<Case> cases = {
    { "a document type", "<!DOCTYPE pipeline><pipeline version=\"1\"/>" },
    { "a property that another type has", Node("<property name=\"Scene\" value=\"x\"/>") },
    { "a port that another type has", Node("<input port=\"illumination\" from=\"pt:direct\"/>") },
    { "an attribute that another port has", Node("<input port=\"depth\" from=\"pt:depth\" sigma=\"1\"/>") },
    { "a value's type and range", Node("<property name=\"Radius\" value=\"-7\"/>") },
    { "a default's type", Pipeline("<variable name=\"a\" type=\"int\" default=\"x\"/>") },
    { "an unknown variable", Node("<property name=\"Radius\" value=\"$(r)\"/>") },
    { "an unknown node", Pipeline(Pt + "<output name=\"o\" from=\"ptt\"/>") },
    { "an unknown array", Pipeline(Pt + "<output name=\"o\" from=\"pt:radianse\"/>") },
    { "kinds", Node("<input port=\"normal\" from=\"pt:depth\"/>") },
    { "required inputs", Pipeline("<node id=\"b\" type=\"BilateralFilter\"/><output name=\"o\" from=\"b\"/>") },
    { "an input connected twice",
      Node("<input port=\"normal\" from=\"pt:normal\"/><input port=\"normal\" from=\"pt:normal\"/>") },
    { "a first input that is delayed",
      Pipeline(Pt + "<node id=\"b\" type=\"BilateralFilter\"><input port=\"radiance\" from=\"pt\" "
                    "delay=\"1\"/></node><output name=\"o\" from=\"b\"/>") },
    { "a cycle", Pipeline("<node id=\"b\" type=\"BilateralFilter\"><input port=\"radiance\" from=\"b\"/></node><output "
                          "name=\"o\" from=\"b\"/>") },
    { "an unknown template", Instance("", "id=\"i\" template=\"tt\"") },
    { "an unknown parameter", Instance("<parameter name=\"s\" value=\"1\"/>") },
    { "a template port twice", Pipeline("<template name=\"u\"><port name=\"x\"/><port name=\"x\"/></template>") },
    { "templates that instantiate each other",
      Pipeline("<template name=\"u\"><instance id=\"a\" template=\"u\"/></template>" + Pt +
               "<instance id=\"i\" template=\"u\"/>" + Out) },
    { "an output of nothing", Pipeline(Pt + "<output name=\"o\"/>") },
    { "a display without a view", Pipeline(Pt + "<output name=\"o\" from=\"pt\" file=\"x.png\" display=\"sRGB\"/>") },
    { "two outputs of one file",
      Pipeline(Pt + "<output name=\"o\" from=\"pt\" file=\"x.exr\"/><output name=\"p\" from=\"pt\" file=\"x.exr\"/>") },
    { "a file that is not there", Pipeline("<include file=\"nowhere.xml\"/>") },
    { "an unfinished expression", Pipeline("<time count=\"$(n\"/>") },
  };
  for (const Case& c : cases)
  {
    EXPECT_NE(Messages(c.Document, "p.xml"), "") << "the reader takes: " << c.Name;
    EXPECT_EQ(Schema().Check(c.Document), "") << "the schema refuses: " << c.Name;
  }
}
