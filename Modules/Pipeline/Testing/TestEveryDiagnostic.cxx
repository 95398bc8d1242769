// SPDX-License-Identifier: BSD-3-Clause
// The rarer mistakes and the limits, with the exact text that a user sees; and that no message is without such a test.
#include "PipelineTestStages.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"
#include "quellXmlDocument.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>
#include <sys/stat.h>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
std::string MessagesOf(
  const std::string& text, const StageRegistry& registry = pipelinetest::Registry(), const GraphOptions& options = {})
{
  Diagnostics messages;
  const auto document = ReadPipelineText(text, "p.xml", messages);
  if (document->Place.Line > 0)
    BuildGraph(document, registry, options, messages);
  messages.Sort();
  return messages.ToText();
}
/// Of a pipeline whose second line is `body`.
std::string Messages(const std::string& body)
{
  return MessagesOf("<pipeline version=\"1\">\n" + body + "\n</pipeline>");
}
const std::string Pt = "<node id=\"pt\" type=\"TestSource\"/>";
const std::string Out = "<output name=\"o\" from=\"pt\"/>";
const std::string Soft =
  "<template name=\"soft\"><parameter name=\"radius\" type=\"int\" default=\"1\"/><port name=\"in\"/>"
  "<node id=\"box\" type=\"TestBox\"><input port=\"radiance\" from=\"@in\"/></node>"
  "<port name=\"out\" from=\"box\"/></template>\n";

std::string Repeat(const std::string& text, int n)
{
  std::string out;
  for (int i = 0; i < n; ++i)
    out += text;
  return out;
}

class EveryDiagnosticFiles : public ::testing::Test
{
protected:
  void SetUp() override
  {
    std::string name = (fs::temp_directory_path() / "quell-diagnostic-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    this->Before = fs::current_path();
    fs::current_path(name);
  }
  void TearDown() override
  {
    const fs::path here = fs::current_path();
    fs::current_path(this->Before);
    fs::remove_all(here);
  }
  static std::string Of(const std::string& file)
  {
    Diagnostics messages;
    LoadPipeline(file, pipelinetest::Registry(), {}, messages);
    return messages.ToText();
  }
  static void Write(const std::string& file, const std::string& text) { std::ofstream(file) << text; }
  fs::path Before;
};
}

TEST(EveryDiagnostic, Grammar)
{
  EXPECT_EQ(Messages("<include file=\"\"/>"), "p.xml:2:10: error: include \"\": the name is empty\n");
  EXPECT_EQ(Messages("<time count=\"2\"/>\n<time count=\"3\"/>"),
    "p.xml:3:1: error: <time>: the time is already given at p.xml:2:1\n");
  EXPECT_EQ(Messages("<time><node/></time>"),
    "p.xml:2:7: error: <time>: element <node> does not belong here; it holds no elements\n");
  EXPECT_EQ(MessagesOf("<?xml version=\"2.0\"?>\n<pipeline version=\"1\"/>"),
    "p.xml:1:1: error: the XML version is \"2.0\", not \"1.0\"\n");
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\" xsi:noNamespaceSchemaLocation=\"p.xsd\"/>"),
    "p.xml:1:23: error: <pipeline>: no attribute \"xsi:noNamespaceSchemaLocation\"; the schema is named in <pipeline>, "
    "with xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\"\n");
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\" xmlns=\"urn:other\"/>"),
    "p.xml:1:23: error: <pipeline>: no attribute \"xmlns\"; it may have version, doc\n");
}

TEST(EveryDiagnostic, LimitsOfTheText)
{
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\">\n" + Repeat(" ", 16 << 20)),
    "p.xml: error: the file has 16777239 bytes, more than the 16777216 allowed\n");
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\">\n<" + std::string(300, 'x') + "/></pipeline>"),
    "p.xml:2:1: error: a name of more than 256 characters: "
    "\"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
    "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...\"\n");
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\">\n<time " + std::string(300, 'x') + "=\"\"/></pipeline>"),
    "p.xml:2:1: error: a name of more than 256 characters: "
    "\"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
    "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...\"\n");
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\" doc=\"" + std::string(65537, 'x') + "\"/>"),
    "p.xml:1:1: error: the value of attribute \"doc\" has more than 65536 characters\n");
  std::string many = "<pipeline version=\"1\"";
  for (int i = 0; i < 64; ++i)
    many += " a" + std::to_string(i) + "=\"\"";
  EXPECT_EQ(MessagesOf(many + "/>"), "p.xml:1:1: error: the element has more than 64 attributes\n");
  EXPECT_EQ(Messages(Repeat("<!---->", 100000)), "p.xml:2:699994: error: more than 100000 elements and comments\n");
  EXPECT_EQ(Messages(Repeat("<a>", 65)), "p.xml:2:190: error: elements are nested more than 64 deep\n");
}

TEST(EveryDiagnostic, Variables)
{
  EXPECT_EQ(Messages("<variable name=\"a b\" type=\"int\" default=\"1\"/>"),
    "p.xml:2:11: error: variable \"a b\": not a name; a name starts with a letter or _ and goes on with letters, "
    "digits, _ and -\n");
  EXPECT_EQ(
    Messages("<variable name=\"a\" type=\"int\" default=\"1\"/>\n<variable name=\"a\" type=\"int\" default=\"1\"/>"),
    "p.xml:3:11: error: variable \"a\": already declared at p.xml:2:1\n");
  EXPECT_EQ(Messages("<variable name=\"a\" type=\"itn\" default=\"1\"/>"),
    "p.xml:2:20: error: variable \"a\": unknown type \"itn\"; did you mean \"int\"?\n");
  EXPECT_EQ(Messages("<variable name=\"a\" type=\"colour\" default=\"1\"/>"),
    "p.xml:2:20: error: variable \"a\": unknown type \"colour\"; types: int, double, bool, string, path\n");
  EXPECT_EQ(Messages("<variable name=\"a\" type=\"double\" default=\"1e999\"/>"),
    "p.xml:2:34: error: variable \"a\": default = \"1e999\" is too large or too small for a number in double "
    "precision\n");
  EXPECT_EQ(Messages("<variable name=\"a\" type=\"int\" default=\"99999999999999999999\"/>"),
    "p.xml:2:31: error: variable \"a\": default = \"99999999999999999999\" is outside [-9007199254740992, "
    "9007199254740992]\n");
  EXPECT_EQ(Messages("<variable name=\"a\" type=\"bool\" default=\"ye\x7Fs\"/>"),
    "p.xml:2:32: error: variable \"a\": default = \"ye\\x7Fs\" is neither true nor false\n");
  EXPECT_EQ(
    Messages(
      "<variable name=\"a\" type=\"int\" default=\"$(b)\"/><variable name=\"b\" type=\"int\" default=\"$(a)\"/>"),
    "p.xml:2:31: error: variable \"a\": the value depends on itself: a <- b <- a\n");
  std::string chain;
  for (int i = 0; i < 1500; ++i)
    chain +=
      "<variable name=\"v" + std::to_string(i) + "\" type=\"string\" default=\"$(v" + std::to_string(i + 1) + ")\"/>";
  EXPECT_EQ(Messages(chain + "<variable name=\"v1500\" type=\"string\" default=\"\"/>"),
    "p.xml:2:54878: error: variable \"v1001\": variables refer to each other more than 1000 deep\n");
}

TEST(EveryDiagnostic, Templates)
{
  EXPECT_EQ(Messages("<template name=\"a b\"/>"), "p.xml:2:11: error: template \"a b\": not a name; a name starts with "
                                                  "a letter or _ and goes on with letters, digits, _ and -\n");
  EXPECT_EQ(Messages("<template name=\"a\"/><template name=\"a\"/>"),
    "p.xml:2:31: error: template \"a\": already defined at p.xml:2:1\n");
  EXPECT_EQ(Messages("<template name=\"a\"><port name=\"x\"/><port name=\"x\"/></template>"),
    "p.xml:2:42: error: template \"a\": input port \"x\" is already declared at p.xml:2:26\n");
  EXPECT_EQ(Messages("<template name=\"a\"><parameter name=\"1\" type=\"int\" default=\"1\"/></template>"),
    "p.xml:2:31: error: template \"a\": parameter \"1\": not a name; a name starts with a letter or _ and goes on with "
    "letters, digits, _ and -\n");
  EXPECT_EQ(Messages("<template name=\"a\"><parameter name=\"p\" type=\"int\" default=\"x\"/></template>"),
    "p.xml:2:51: error: template \"a\": p = \"x\" is not a whole number\n");
  EXPECT_EQ(Messages(Soft + "<instance id=\"i\" template=\"zzzzz\"/>"),
    "p.xml:3:18: error: instance \"i\": unknown template \"zzzzz\"; templates: soft\n");
  EXPECT_EQ(Messages(Soft + Pt +
                     "<instance id=\"i\" template=\"soft\"><parameter name=\"zzzzz\" value=\"1\"/><input port=\"in\" "
                     "from=\"pt\"/></instance>"),
    "p.xml:3:78: error: instance \"i\" (template \"soft\"): no parameter \"zzzzz\"; parameters: radius\n");
  EXPECT_EQ(Messages(Soft + Pt +
                     "<instance id=\"i\" template=\"soft\"><parameter name=\"radius\" value=\"1\"/><parameter "
                     "name=\"radius\" value=\"2\"/><input port=\"in\" from=\"pt\"/></instance>"),
    "p.xml:3:114: error: instance \"i\" (template \"soft\"): parameter \"radius\" is already set at p.xml:3:67\n");
  EXPECT_EQ(Messages(Soft + Pt +
                     "<instance id=\"i\" template=\"soft\"><input port=\"zzzzz\" from=\"pt\"/><input port=\"in\" "
                     "from=\"pt\"/></instance>"),
    "p.xml:3:74: error: instance \"i\" (template \"soft\"): no input \"zzzzz\"; inputs: in\n");
  EXPECT_EQ(Messages(Soft + Pt +
                     "<instance id=\"i\" template=\"soft\"><input port=\"in\" from=\"pt\"/></instance><output "
                     "name=\"o\" from=\"i:zzzzz\"/>"),
    "p.xml:3:123: error: output \"o\": instance \"i\" (template \"soft\") has no output \"zzzzz\"; it has out\n");
  EXPECT_EQ(Messages(Soft + Pt +
                     "<instance id=\"i\" template=\"soft\"><input port=\"in\" from=\"pt:radiance\"/><input port=\"in\" "
                     "from=\"pt:albedo\"/></instance><output name=\"o\" from=\"i\"/>"),
    "p.xml:2:119: error: node \"box\" (TestBox): input \"radiance\": \"@in\" is connected 2 times; it takes one "
    "connection\n  in instance \"i\" at p.xml:3:34, from template \"soft\" at p.xml:2:1\n");
  EXPECT_EQ(Messages("<template name=\"t\"><port name=\"in\"/><port name=\"out\" from=\"@zzzzz\"/></template>"),
    "p.xml:2:54: error: template \"t\": port \"out\": template \"t\" has no input port \"zzzzz\"; ports: in\n  in "
    "template \"t\" at p.xml:2:1\n");
  EXPECT_EQ(Messages("<template name=\"t\"><instance id=\"i\" template=\"u\"/></template><template "
                     "name=\"u\"/><instance id=\"i\" template=\"t\"/>" +
                     Pt + "<output name=\"o\" from=\"i\"/>"),
    "p.xml:2:163: error: output \"o\": instance \"i\" (template \"t\") has no output; it has none\n");
  const std::string pass = "<template name=\"p\"><port name=\"in\"/><port name=\"out\" from=\"@in\"/></template>\n";
  EXPECT_EQ(Messages(pass + "<instance id=\"a\" template=\"p\"><input port=\"in\" from=\"b\"/></instance><instance "
                            "id=\"b\" template=\"p\"><input port=\"in\" from=\"a\"/></instance>"),
    "p.xml:2:54: error: template \"p\": port \"out\": \"@in\" leads back to itself through template ports\n  in "
    "instance \"a\" at p.xml:3:1, from template \"p\" at p.xml:2:1\np.xml:3:48: error: instance \"a\" (template "
    "\"p\"): input \"in\": \"b\" leads back to itself through template ports\np.xml:3:116: error: instance \"b\" "
    "(template \"p\"): input \"in\": \"a\" leads back to itself through template ports\n");
  std::string chain = pass + Pt;
  for (int i = 0; i < 200; ++i)
    chain += "\n<instance id=\"a" + std::to_string(i) + "\" template=\"p\"><input port=\"in\" from=\"" +
             (i ? "a" + std::to_string(i - 1) : "pt") + "\"/></instance>";
  EXPECT_EQ(Messages(chain + "\n<output name=\"o\" from=\"a199\"/>").substr(0, 400),
    "p.xml:4:49: error: instance \"a0\" (template \"p\"): input \"in\": \"pt\" leads through more than 256 template "
    "ports\n");
  std::string deep;
  for (int i = 0; i < 17; ++i)
    deep += "<template name=\"t" + std::to_string(i) + "\"><instance id=\"i\" template=\"t" + std::to_string(i + 1) +
            "\"/></template>\n";
  const std::string nested = Messages(deep + "<template name=\"t17\"/><instance id=\"a\" template=\"t0\"/>");
  EXPECT_EQ(
    nested.substr(0, nested.find('\n')), "p.xml:17:22: error: instance \"i\": instances are nested more than 16 deep");
}

TEST(EveryDiagnostic, Expansion)
{
  const auto firstLine = [](const std::string& text) { return text.substr(0, text.find('\n')); };
  std::string many;
  for (int i = 0; i < 5001; ++i)
    many += "<node id=\"n" + std::to_string(i) + "\" type=\"TestSource\"/>\n";
  EXPECT_EQ(firstLine(Messages(many)), "p.xml:5002:1: error: the pipeline expands to more than 5000 nodes");
  many = Pt;
  for (int i = 0; i < 5001; ++i)
    many += "<output name=\"o" + std::to_string(i) + "\" from=\"pt\" file=\"" + std::to_string(i) + ".exr\"/>\n";
  EXPECT_EQ(
    firstLine(Messages(many)), "p.xml:5002:1: error: output \"o5000\": the pipeline expands to more than 5000 nodes");
  const std::string pass = "<template name=\"p\"><port name=\"in\"/><port name=\"out\" from=\"@in\"/></template>";
  many = pass + Pt;
  for (int i = 0; i < 30; ++i)
    many += "\n<instance id=\"a" + std::to_string(i) + "\" template=\"p\">" +
            Repeat("<input port=\"in\" from=\"" + (i ? "a" + std::to_string(i - 1) : "pt") + "\"/>", 2) + "</instance>";
  const std::string expanded = Messages(many);
  EXPECT_EQ(firstLine(expanded), "p.xml:5:49: error: instance \"a2\" (template \"p\"): input \"in\": the pipeline "
                                 "expands to more than this program takes");
  std::string ring;
  for (int i = 0; i < 50; ++i)
    ring += "<node id=\"n" + std::to_string(i) + "\" type=\"TestBox\"><input port=\"radiance\" from=\"n" +
            std::to_string((i + 49) % 50) + "\"/></node>\n";
  EXPECT_EQ(Messages(ring),
    "p.xml:3:30: error: cycle: n0 <- n49 <- n48 <- n47 <- n46 <- n45 <- n44 <- n43 <- n42 <- n41 <- n40 <- n39 <- n38 "
    "<- n37 <- n36 <- n35 <- n34 <- n33 <- n32 <- n31 <- n30 <- ... (9 more) <- n20 <- n19 <- n18 <- n17 <- n16 <- n15 "
    "<- n14 <- n13 <- n12 <- n11 <- n10 <- n9 <- n8 <- n7 <- n6 <- n5 <- n4 <- n3 <- n2 <- n1 <- n0; say delay=\"1\" "
    "on the input that should read the previous frame\n");
}

TEST(EveryDiagnostic, Connections)
{
  EXPECT_EQ(Messages(Pt + "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"\"/></node>" + Out),
    "p.xml:2:85: error: node \"b\" (TestBox): input \"radiance\": from is empty; write node:array\n");
  EXPECT_EQ(Messages(Pt + "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"pt\"/><input port=\"zzzzz\" "
                          "from=\"pt\"/></node><output name=\"o\" from=\"b\"/>"),
    "p.xml:2:103: error: node \"b\" (TestBox): no input \"zzzzz\"; inputs: radiance, normal\n");
  const std::string w = Pt + "<node id=\"w\" type=\"ImageWriter\"><property name=\"File\" value=\"w.exr\"/>";
  EXPECT_EQ(Messages(w + "<input port=\"layer\" from=\"pt\" nmae=\"x\"/></node>"),
    "p.xml:2:133: error: node \"w\" (ImageWriter): input \"layer\": has no attribute \"nmae\"; did you mean "
    "\"name\"?\n");
  EXPECT_EQ(Messages(w + "<input port=\"layer\" from=\"pt\" formt=\"x\"/></node>"),
    "p.xml:2:133: error: node \"w\" (ImageWriter): input \"layer\": has no attribute \"formt\"; did you mean "
    "\"port\"?\n");
}

TEST(EveryDiagnostic, Outputs)
{
  EXPECT_EQ(Messages(Pt + "<output name=\"a b\" from=\"pt\"/>"),
    "p.xml:2:42: error: output \"a b\": not a name; a name starts with a letter or _ and goes on with letters, digits, "
    "_ and -\n");
  EXPECT_EQ(
    Messages(Pt + "<output name=\"o\" from=\"pt\" file=\"o.exr\"><property name=\"Half\" value=\"1\"/></output>"),
    "p.xml:2:84: error: output \"o\": no property \"Half\"; properties: none\n");
  // A program may have none of the stages that outputs are made of.
  StageRegistry few;
  few.Add<pipelinetest::vtkQuellTestSource>();
  EXPECT_EQ(
    MessagesOf(
      "<pipeline version=\"1\">" + Pt + "<output name=\"o\" from=\"pt\" file=\"o.exr\" view=\"v\"/></pipeline>", few),
    "p.xml:1:56: error: output \"o\": this program has no stage DisplayTransform\np.xml:1:56: error: output \"o\": "
    "this program has no stage ImageWriter\n");
}

TEST(EveryDiagnostic, CommandLine)
{
  GraphOptions o;
  o.Seed = 3;
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\"><node id=\"r\" type=\"TestReader\"><property name=\"File\" "
                       "value=\"f\"/></node><output name=\"o\" from=\"r:foreign\"/></pipeline>",
              pipelinetest::Registry(), o),
    "command line: warning: --seed: no node has a property Seed\n");
  o = {};
  o.Outputs = { { "o", "a.exr" }, { "o", "b.exr" } };
  EXPECT_EQ(MessagesOf("<pipeline version=\"1\">" + Pt + Out + "</pipeline>", pipelinetest::Registry(), o),
    "command line: error: --output o: is given twice: a.exr and b.exr\n");
}

TEST(EveryDiagnostic, Warnings)
{
  EXPECT_EQ(Messages(Soft + Pt + Out), "p.xml:2:1: warning: template \"soft\": is never instantiated\n");
  EXPECT_EQ(
    Messages(Soft + Pt + "<instance id=\"i\" template=\"soft\"><input port=\"in\" from=\"pt\"/></instance>" + Out),
    "p.xml:3:34: warning: instance \"i\": feeds no output and will not run\n");
}

// Found by mutating files: a message is one line whatever a file is called.
TEST_F(EveryDiagnosticFiles, NamesWithLineEnds)
{
  this->Write("p.xml", "<pipeline version=\"1\">\n<include file=\"a&#10;b\"/></pipeline>");
  EXPECT_EQ(this->Of("p.xml"), "p.xml:2:10: error: include \"a\\x0Ab\": no such file: a\\x0Ab\n");
}

// Found by mutating files: 65536 characters of a value came back in full.
TEST(EveryDiagnostic, IsNotTooLong)
{
  const std::string long1 = std::string(30000, 'x'), long2 = std::string(60000, 'y');
  for (const std::string& text :
    { Messages("<node id=\"a\" type=\"TestSource\"><property name=\"Scene\" value=\"" + long1 + "\"/></node>"),
      Messages(Pt + "<output name=\"o\" from=\"pt\" file=\"" + long2 + "\"/><output name=\"p\" from=\"pt\" file=\"" +
               long2 + "\"/>"),
      Messages(Pt + "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"" + long2 + ":\"/></node>") })
  {
    EXPECT_FALSE(text.empty());
    EXPECT_LT(text.size(), 9000u);
  }
}

TEST_F(EveryDiagnosticFiles, Files)
{
  EXPECT_EQ(this->Of("nowhere.xml"), "nowhere.xml: error: no such file\n");
  EXPECT_EQ(this->Of("."), ".: error: not a file\n");
  ASSERT_EQ(mkfifo("pipe.xml", 0600), 0); // opening it would wait for ever
  EXPECT_EQ(this->Of("pipe.xml"), "pipe.xml: error: not a file\n");
  this->Write("p.xml", "<pipeline version=\"1\">\n<include file=\".\"/>\n<include file=\"no.xml\"/>\n<include "
                       "file=\"a$(b).xml\"/>\n<include file=\"" +
                         std::string(4097, 'x') + "\"/></pipeline>");
  EXPECT_EQ(this->Of("p.xml"), "p.xml:2:10: error: include \".\": not a file: .\np.xml:3:10: error: include "
                               "\"no.xml\": no such file: no.xml\np.xml:4:10: error: include \"a$(b).xml\": the name "
                               "of an included file cannot hold variables\np.xml:5:10: error: include "
                               "\"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
                               "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
                               "xxxxxxxxxxxxxxxxxxxxxxxxxxxx...\": the name has more than 4096 characters\n");
  this->Write("large.xml", std::string((16 << 20) + 1, ' '));
  EXPECT_EQ(this->Of("large.xml"), "large.xml: error: the file has 16777217 bytes, more than the 16777216 allowed\n");
  this->Write("p.xml", "<pipeline version=\"1\">\n<include file=\"large.xml\"/></pipeline>");
  EXPECT_EQ(this->Of("p.xml"),
    "p.xml:2:10: error: include \"large.xml\": the file has 16777217 bytes, more than the 16777216 allowed\n");
  for (int i = 0; i < 18; ++i)
    this->Write("d" + std::to_string(i) + ".xml",
      "<pipeline version=\"1\">\n<include file=\"d" + std::to_string(i + 1) + ".xml\"/></pipeline>");
  EXPECT_EQ(this->Of("d0.xml"), "d16.xml:2:10: error: include \"d17.xml\": files are included more than 16 deep\n");
  fs::create_directory("sub");
  this->Write("sub/p.xml", "<pipeline version=\"1\">\n<node id=\"a\" type=\"TestSource\"><property name=\"Scene\" "
                           "value=\"no.gltf\"/></node></pipeline>");
  EXPECT_EQ(this->Of("sub/p.xml"),
    "sub/p.xml:2:55: error: node \"a\" (TestSource): Scene = \"no.gltf\": no such file; looked for sub/no.gltf\n");
}

// ---- that there is a test for each ----------------------------------------------------------------------------------

namespace
{
std::string Contents(const fs::path& file)
{
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

/// The string literals of a piece of C++, without their escapes; those that follow each other are one.
std::vector<std::string> Literals(const std::string& code)
{
  std::vector<std::string> literals;
  std::size_t lastEnd = std::string::npos;
  for (std::size_t i = 0; i < code.size(); ++i)
  {
    if (code.compare(i, 2, "//") == 0)
    {
      i = std::min(code.find('\n', i), code.size());
      continue;
    }
    if (code[i] == '\'')
    {
      i += code[i + 1] == '\\' ? 3 : 2;
      continue;
    }
    if (code[i] != '"')
      continue;
    std::string text;
    const std::size_t begin = i;
    for (++i; i < code.size() && code[i] != '"'; ++i)
    {
      if (code[i] == '\\')
        ++i;
      text += code[i];
    }
    const bool follows =
      lastEnd != std::string::npos && code.find_first_not_of(" \t\r\n", lastEnd) == begin && !literals.empty();
    if (follows)
      literals.back() += text;
    else
      literals.push_back(text);
    lastEnd = i + 1;
  }
  return literals;
}

/// Literals of every call that makes a message.
std::vector<std::string> MessagesIn(const std::string& code)
{
  std::vector<std::string> all;
  for (const char* call : { "Error(", "Stop(", "Say(", "Overfill(", "return \"the " })
  {
    for (std::size_t at = 0; (at = code.find(call, at)) != std::string::npos; ++at)
    {
      std::size_t end = at;
      for (bool quoted = false; end < code.size() && (quoted || code[end] != ';'); ++end)
      {
        if (code[end] == '"' && code[end - 1] != '\\' && code[end - 1] != '\'')
          quoted = !quoted;
      }
      for (const std::string& text : Literals(code.substr(at, end - at)))
        all.push_back(text);
    }
  }
  return all;
}
}

TEST(EveryDiagnostic, OutputsOutsideOfTheirDirectory)
{
  GraphOptions refused;
  refused.Outside = OutsideOutputs::Refused;
  refused.OutputDirectory = "/nowhere/out";
  const std::string text =
    "<pipeline version=\"1\">\n" + Pt + "<output name=\"o\" from=\"pt\" file=\"../x.exr\"/>\n</pipeline>";
  const std::string all = MessagesOf(text, pipelinetest::Registry(), refused);
  EXPECT_NE(
    all.find("error: output \"o\": File = \"../x.exr\" lies outside of the directory for output files, "
             "/nowhere/out; "
             "choose that directory with --out DIR, or let this pipeline write anywhere with --allow-outside\n"),
    std::string::npos)
    << all;
  const std::string longName(252, 'x');
  const std::string named = Messages("<output name=\"o\" from=\"pt\" file=\"" + longName + ".exr\"/>\n" + Pt);
  EXPECT_NE(named.find("error: output \"o\": File = \"" + longName.substr(0, 40) +
                       "...\": a name of 256 bytes, more than the 255 that a file's may have\n"),
    std::string::npos)
    << named;
  const std::string numbered = Messages("<output name=\"o\" from=\"pt\" file=\"f####/x.exr\"/>\n" + Pt);
  EXPECT_NE(numbered.find("error: output \"o\": File = \"f####/x.exr\": the number of a frame stands in the name of a "
                          "file, not of a directory; write the #### behind the last /\n"),
    std::string::npos)
    << numbered;
}

TEST(EveryDiagnostic, IsTestedWithItsExactText)
{
  const fs::path top = QUELL_SOURCE_DIR;
  std::string golden;
  for (const char* name : { "TestDiagnostics.cxx", "TestEveryDiagnostic.cxx", "TestPipelineReader.cxx" })
    for (const std::string& text : Literals(Contents(top / "Modules/Pipeline/Testing" / name)))
      golden += text + "\n";
  for (const auto& entry : fs::directory_iterator(top / "Testing/BadInput"))
    if (entry.path().extension() == ".txt" && entry.path().filename() != "CMakeLists.txt")
      golden += Contents(entry.path());
  // What a test cannot bring about: no memory for the parser, and as root a file that nobody may read.
  const std::vector<std::string> beyond = { "out of memory", "cannot be opened" };
  int checked = 0;
  for (const char* name : { "quellXmlDocument.cxx", "quellPipelineReader.cxx", "quellGraph.cxx" })
  {
    for (const std::string& text : MessagesIn(Contents(top / "Modules/Pipeline" / name)))
    {
      const std::size_t letters =
        std::size_t(std::count_if(text.begin(), text.end(), [](unsigned char c) { return std::isalpha(c) != 0; }));
      const bool exempt = std::any_of(
        beyond.begin(), beyond.end(), [&](const std::string& b) { return text.find(b) != std::string::npos; });
      if (letters < 5 || exempt)
        continue;
      ++checked;
      EXPECT_NE(golden.find(text), std::string::npos) << name << " says \"" << text << "\", and no test expects it";
    }
  }
  EXPECT_GT(checked, 120);
}
