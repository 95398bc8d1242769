// SPDX-License-Identifier: BSD-3-Clause
// Every mistake that a pipeline can have, with the exact text that a user sees.
#include "PipelineTestStages.h"
#include "quellGraph.h"
#include "quellPipelineReader.h"

#include <gtest/gtest.h>

using namespace quell;

namespace
{
/// Messages for a pipeline whose second line is `body`.
std::string Messages(const std::string& body, const GraphOptions& options = {})
{
  Diagnostics messages;
  const auto document = ReadPipelineText("<pipeline version=\"1\">\n" + body + "\n</pipeline>", "p.xml", messages);
  if (document->Place.Line > 0)
    BuildGraph(document, pipelinetest::Registry(), options, messages);
  messages.Sort();
  return messages.ToText();
}

const std::string Pt = "<node id=\"pt\" type=\"TestSource\"/>";
const std::string Out = "\n<output name=\"o\" from=\"b\"/>";
std::string Box(const std::string& inside, const std::string& from = "pt:radiance")
{
  return Pt + "\n<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"" + from + "\"/>" + inside +
         "</node>" + Out;
}
}

TEST(Diagnostics, Nothing)
{
  EXPECT_EQ(Messages(Box("")), "");
}

TEST(Diagnostics, Grammar)
{
  EXPECT_EQ(Messages("<nod id=\"a\"/>"),
    "p.xml:2:1: error: <pipeline>: element <nod> does not belong here; did you mean \"node\"?\n");
  EXPECT_EQ(Messages(Box("<layer from=\"x\"/>")),
    "p.xml:3:72: error: <node> \"b\": element <layer> does not belong here; it may hold <property>, <input>\n");
  EXPECT_EQ(Messages("<node idd=\"pt\" type=\"TestSource\"/>"),
    "p.xml:2:1: error: <node>: attribute \"id\" is missing\n"
    "p.xml:2:7: error: <node>: no attribute \"idd\"; did you mean \"id\"?\n");
  EXPECT_EQ(Messages(Pt + "text"),
    "p.xml:2:34: error: <pipeline>: text \"text\" does not belong here; values are written as attributes\n");
}

TEST(Diagnostics, Version)
{
  const auto version = [](const std::string& text)
  {
    Diagnostics messages;
    ReadPipelineText(text, "p.xml", messages);
    return messages.ToText();
  };
  EXPECT_EQ(version("<pipeline version=\"2\"><unknown/></pipeline>"),
    "p.xml:1:11: error: pipeline version 2 is newer than this program understands (1)\n");
  EXPECT_EQ(version("<pipeline version=\"one\"/>"),
    "p.xml:1:11: error: <pipeline>: version = \"one\" is not a whole number; this program reads version 1\n");
  EXPECT_EQ(version("<pipeline/>"), "p.xml:1:1: error: <pipeline>: attribute \"version\" is missing\n");
  EXPECT_EQ(version("<graph version=\"1\"/>"), "p.xml:1:1: error: the root element is <graph>, not <pipeline>\n");
}

TEST(Diagnostics, TypesAndProperties)
{
  EXPECT_EQ(Messages("<node id=\"a\" type=\"TestBoks\"/>"),
    "p.xml:2:14: error: node \"a\": unknown type \"TestBoks\"; did you mean \"TestBox\"?\n");
  EXPECT_EQ(Messages(Box("<property name=\"Radios\" value=\"1\"/>")),
    "p.xml:3:82: error: node \"b\" (TestBox): no property \"Radios\"; did you mean \"Radius\"?\n");
  EXPECT_EQ(Messages(Box("<property name=\"Sharpness\" value=\"1\"/>")),
    "p.xml:3:82: error: node \"b\" (TestBox): no property \"Sharpness\"; properties: Radius, Gain, Mode, Quiet\n");
  EXPECT_EQ(Messages(Box("<property name=\"Radius\" value=\"17\"/>")),
    "p.xml:3:96: error: node \"b\" (TestBox): Radius = 17 is outside [0, 16] (default 1)\n");
  EXPECT_EQ(Messages(Box("<property name=\"Gain\" value=\"1.4\"/>")),
    "p.xml:3:94: error: node \"b\" (TestBox): Gain = 1.4 is outside [0, 1] (default 1)\n");
  EXPECT_EQ(Messages(Box("<property name=\"Gain\" value=\"0,05\"/>")),
    "p.xml:3:94: error: node \"b\" (TestBox): Gain = \"0,05\" is not a number (default 1)\n");
  EXPECT_EQ(Messages(Box("<property name=\"Gain\" value=\"nan\"/>")),
    "p.xml:3:94: error: node \"b\" (TestBox): Gain = \"nan\" is not finite (default 1)\n");
  EXPECT_EQ(Messages(Box("<property name=\"Radius\" value=\"1.5\"/>")),
    "p.xml:3:96: error: node \"b\" (TestBox): Radius = \"1.5\" is not a whole number (default 1)\n");
  EXPECT_EQ(Messages(Box("<property name=\"Mode\" value=\"Scael\"/>")),
    "p.xml:3:94: error: node \"b\" (TestBox): Mode = \"Scael\" is none of Scale, Drop; did you mean \"Scale\"?\n");
  EXPECT_EQ(Messages(Box("<property name=\"Quiet\" value=\"yes\"/>")),
    "p.xml:3:95: error: node \"b\" (TestBox): Quiet = \"yes\" is neither true nor false\n");
  EXPECT_EQ(Messages(Box("<property name=\"Gain\" value=\"1\"/><property name=\"Gain\" value=\"0\"/>")),
    "p.xml:3:115: error: node \"b\" (TestBox): property \"Gain\" is already set at p.xml:3:72\n");
  EXPECT_EQ(Messages("<node id=\"pt\" type=\"TestSource\"><property name=\"Scene\" value=\"no.gltf\"/></node><output "
                     "name=\"o\" from=\"pt\"/>"),
    "p.xml:2:56: error: node \"pt\" (TestSource): Scene = \"no.gltf\": no such file\n");
}

TEST(Diagnostics, Connections)
{
  EXPECT_EQ(Messages(Box("<input port=\"normals\" from=\"pt:normal\"/>")),
    "p.xml:3:79: error: node \"b\" (TestBox): no input \"normals\"; did you mean \"normal\"?\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"ptt:normal\"/>")),
    "p.xml:3:93: error: node \"b\" (TestBox): input \"normal\": no node \"ptt\"; did you mean \"pt\"?\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:normals\"/>")),
    "p.xml:3:93: error: node \"b\" (TestBox): input \"normal\": node \"pt\" has no output \"normals\"; did you mean "
    "\"normal\"?\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:velocity\"/>")),
    "p.xml:3:93: error: node \"b\" (TestBox): input \"normal\": node \"pt\" has no output \"velocity\"; it has "
    "radiance, albedo, normal, depth\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:depth\"/>")),
    "p.xml:3:93: error: node \"b\" (TestBox): input \"normal\": wants normal (3 x float, unit, world), but "
    "\"pt:depth\" is depth "
    "(1 x float along the view axis)\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:\"/>")),
    "p.xml:3:93: error: node \"b\" (TestBox): input \"normal\": \"pt:\" is not of the form node:array\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"@n\"/>")),
    "p.xml:3:93: error: node \"b\" (TestBox): input \"normal\": \"@n\" is a template's port, but this is no template; "
    "write node:array\n");
  EXPECT_EQ(Messages(Box("<input port=\"radiance\" from=\"pt:radiance\"/>")),
    "p.xml:3:72: error: node \"b\" (TestBox): input \"radiance\": is already connected at p.xml:3:29; it takes one "
    "connection\n");
  EXPECT_EQ(Messages(Pt + "<node id=\"b\" type=\"TestBox\"/>" + Out),
    "p.xml:2:34: error: node \"b\" (TestBox): required input \"radiance\" is not connected; it wants color (3 x float, "
    "linear RGB)\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:normal\" sigma=\"3\"/>")),
    "p.xml:3:110: error: node \"b\" (TestBox): input \"normal\": has no attribute \"sigma\"\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:normal\" delay=\"2\"/>")),
    "p.xml:3:110: error: node \"b\" (TestBox): input \"normal\": delay = \"2\" is neither 0 nor 1; delay=\"1\" reads "
    "the previous frame\n");
  EXPECT_EQ(
    Messages(Pt + "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"pt\" delay=\"1\"/></node>" + Out),
    "p.xml:2:95: error: node \"b\" (TestBox): input \"radiance\": a stage's first input (\"radiance\" of TestBox) "
    "cannot be delayed; it gives the frame its "
    "size; every other input may read the previous frame\n");
  // Optional connections are left out where there is no such array; required ones cannot be.
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:velocity\" optional=\"1\"/>")),
    "p.xml:2:1: warning: node \"pt\" (TestSource): has no velocity: b does without\n");
  EXPECT_EQ(Messages(Box("<input port=\"normal\" from=\"pt:normal\" optional=\"yes\"/>")),
    "p.xml:3:110: error: node \"b\" (TestBox): input \"normal\": optional = \"yes\" is neither 0 nor 1; optional=\"1\" "
    "leaves the input "
    "out where there is no such array\n");
  EXPECT_EQ(Messages(Pt +
                     "<node id=\"b\" type=\"TestAccumulate\"><input port=\"radiance\" from=\"pt\"/>"
                     "<input port=\"history\" from=\"pt:velocity\" optional=\"1\"/></node>" +
                     Out),
    "p.xml:2:125: error: node \"b\" (TestAccumulate): input \"history\": is required, but node \"pt\" has no array "
    "\"velocity\"; "
    "optional=\"1\" is for inputs that the stage can do without\n");
  // Foreign arrays are accepted where their components fit.
  const std::string reader = "<node id=\"r\" type=\"TestReader\"><property name=\"File\" value=\"f\"/></node>";
  EXPECT_EQ(
    Messages(reader + "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"r:foreign\"/></node>" + Out),
    "");
  EXPECT_EQ(
    Messages(reader + "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"r:weight\"/></node>" + Out),
    "p.xml:2:123: error: node \"b\" (TestBox): input \"radiance\": wants color (3 x float, linear RGB), but "
    "\"r:weight\" is an array of 1 "
    "component\n");
  EXPECT_EQ(Messages("<node id=\"r\" type=\"TestReader\"/><output name=\"o\" from=\"r:foreign\"/>"),
    "p.xml:2:1: error: node \"r\" (TestReader): File is not set\n");
}

TEST(Diagnostics, Identifiers)
{
  EXPECT_EQ(Messages(Pt + "\n" + Pt + "<output name=\"o\" from=\"pt\"/>"),
    "p.xml:3:7: error: id \"pt\" is already used at p.xml:2:1\n");
  EXPECT_EQ(Messages("<node id=\"a b\" type=\"TestSource\"/>"),
    "p.xml:2:7: error: node: id \"a b\" is not a name; a name starts with a letter or _ and goes on with letters, "
    "digits, _ and -\n");
}

TEST(Diagnostics, Cycles)
{
  const std::string loop = "<node id=\"x\" type=\"TestBox\"><input port=\"radiance\" from=\"z:radiance\"/></node>\n"
                           "<node id=\"y\" type=\"TestBox\"><input port=\"radiance\" from=\"x:radiance\"/></node>\n"
                           "<node id=\"z\" type=\"TestBox\"><input port=\"radiance\" from=\"y:radiance\"/></node>\n"
                           "<output name=\"o\" from=\"z:radiance\"/>";
  EXPECT_EQ(Messages(loop),
    "p.xml:3:29: error: cycle: x <- z <- y <- x; say delay=\"1\" on the input that should read the previous frame\n");
  EXPECT_EQ(
    Messages(
      "<node id=\"x\" type=\"TestSum\"><input port=\"radiance\" from=\"x\"/></node><output name=\"o\" from=\"x\"/>"),
    "p.xml:2:29: error: cycle: x <- x; say delay=\"1\" on the input that should read the previous frame\n");
  // A delayed edge closes a loop legally.
  EXPECT_EQ(Messages(Pt +
                     "<node id=\"b\" type=\"TestAccumulate\"><input port=\"radiance\" from=\"pt\"/>"
                     "<input port=\"history\" from=\"b:radiance\" delay=\"1\"/></node>" +
                     Out),
    "");
}

TEST(Diagnostics, Variables)
{
  EXPECT_EQ(Messages("<variable name=\"frames\" type=\"int\" default=\"2\"/><time count=\"$(frmaes)\"/>" + Box("")),
    "p.xml:2:55: error: <time>: $(frmaes): no such variable; did you mean \"frames\"?\n");
  EXPECT_EQ(Messages("<time count=\"$(zzzzzz)\"/>" + Box("")),
    "p.xml:2:7: error: <time>: $(zzzzzz): no such variable; variables: none\n");
  EXPECT_EQ(Messages("<time count=\"$(n\"/>" + Box("")),
    "p.xml:2:7: error: <time>: \"$(n\" has no \")\" after \"$(\"; write $$( for a plain $(\n");
  EXPECT_EQ(Messages("<time count=\"0\" first=\"x\" rate=\"0\"/>" + Box("")),
    "p.xml:2:7: error: <time>: count = 0 is outside [1, 10000000]\n"
    "p.xml:2:17: error: <time>: first = \"x\" is not a whole number\n"
    "p.xml:2:27: error: <time>: rate = 0 is outside [1e-06, 1e+06]\n");
  EXPECT_EQ(Messages("<variable name=\"n\" type=\"itn\" default=\"2\"/><time count=\"$(n)\"/>" + Box("")),
    "p.xml:2:20: error: variable \"n\": unknown type \"itn\"; did you mean \"int\"?\n");
  EXPECT_EQ(Messages("<variable name=\"n\" type=\"int\" default=\"two\"/><time count=\"$(n)\"/>" + Box("")),
    "p.xml:2:31: error: variable \"n\": default = \"two\" is not a whole number\n");
  EXPECT_EQ(Messages("<variable name=\"n\" type=\"int\" default=\"2\"/><variable name=\"n\" type=\"int\" "
                     "default=\"3\"/><time count=\"$(n)\"/>" +
                     Box("")),
    "p.xml:2:54: error: variable \"n\": already declared at p.xml:2:1\n");
  EXPECT_EQ(Messages("<variable name=\"a\" type=\"int\" default=\"$(b)\"/><variable name=\"b\" type=\"int\" "
                     "default=\"$(a)\"/><time count=\"$(a)\"/>" +
                     Box("")),
    "p.xml:2:31: error: variable \"a\": the value depends on itself: a <- b <- a\n");
  std::string bomb = "<variable name=\"v0\" type=\"string\" default=\"0123456789\"/>";
  for (int i = 1; i < 40; ++i)
  {
    const std::string before = "$(v" + std::to_string(i - 1) + ")";
    bomb += "<variable name=\"v" + std::to_string(i) + "\" type=\"string\" default=\"" + before + before + "\"/>";
  }
  EXPECT_NE(Messages(bomb + Box("")).find("error: variable \"v13\": the value grows beyond 65536 characters\n"),
    std::string::npos);
}

TEST(Diagnostics, Templates)
{
  const std::string t = "<template name=\"soft\"><parameter name=\"radius\" type=\"int\" default=\"1\"/><port "
                        "name=\"in\" type=\"color\"/>\n"
                        "<node id=\"box\" type=\"TestBox\"><property name=\"Radius\" value=\"$(radius)\"/><input "
                        "port=\"radiance\" from=\"@in\"/></node>\n"
                        "<port name=\"out\" from=\"box:radiance\"/></template>" +
                        Pt + "\n";
  const auto use = [&](const std::string& instance)
  { return Messages(t + instance + "\n<output name=\"o\" from=\"a:out\"/>"); };
  const std::string in = "<input port=\"in\" from=\"pt:radiance\"/>";
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\">" + in + "</instance>"), "");
  EXPECT_EQ(use("<instance id=\"a\" template=\"sotf\">" + in + "</instance>"),
    "p.xml:5:18: error: instance \"a\": unknown template \"sotf\"; did you mean \"soft\"?\n");
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\"/>"),
    "p.xml:5:1: error: instance \"a\" (template \"soft\"): required input \"in\" is not connected\n");
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\">" + in + "<input port=\"inn\" from=\"pt\"/></instance>"),
    "p.xml:5:78: error: instance \"a\" (template \"soft\"): no input \"inn\"; did you mean \"in\"?\n");
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\"><parameter name=\"radios\" value=\"1\"/>" + in + "</instance>"),
    "p.xml:5:45: error: instance \"a\" (template \"soft\"): no parameter \"radios\"; did you mean \"radius\"?\n");
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\"><parameter name=\"radius\" value=\"x\"/>" + in + "</instance>"),
    "p.xml:5:59: error: instance \"a\" (template \"soft\"): radius = \"x\" is not a whole number; default \"1\"\n");
  // A value that only the inner node can judge: reported there, with the instance that brought it.
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\"><parameter name=\"radius\" value=\"99\"/>" + in + "</instance>"),
    "p.xml:3:55: error: node \"box\" (TestBox): Radius = 99 is outside [0, 16] (default 1)\n"
    "  in instance \"a\" at p.xml:5:1, from template \"soft\" at p.xml:2:1\n");
  EXPECT_EQ(use("<instance id=\"a\" template=\"soft\"><input port=\"in\" from=\"pt:depth\"/></instance>"),
    "p.xml:5:51: error: instance \"a\" (template \"soft\"): input \"in\": wants color (3 x float, linear RGB), but "
    "\"pt:depth\" is depth "
    "(1 x float along the view axis)\n");
  EXPECT_EQ(
    Messages(t + "<instance id=\"a\" template=\"soft\">" + in + "</instance><output name=\"o\" from=\"a:outt\"/>"),
    "p.xml:5:99: error: output \"o\": instance \"a\" (template \"soft\") has no output \"outt\"; did you mean "
    "\"out\"?\n");
  // Twice instantiated, once told; not instantiated, told as well.
  const std::string bad =
    "<template name=\"t\"><node id=\"n\" type=\"TestSource\"><property name=\"Widht\" value=\"3\"/></node>"
    "<port name=\"out\" from=\"n\"/></template>";
  const std::string told =
    "p.xml:2:61: error: node \"n\" (TestSource): no property \"Widht\"; did you mean \"Width\"?\n";
  EXPECT_EQ(Messages(bad + "\n<instance id=\"a\" template=\"t\"/>\n<instance id=\"b\" template=\"t\"/>\n<output "
                           "name=\"o\" from=\"a:out\"/>"),
    told + "  in instance \"a\" at p.xml:3:1, from template \"t\" at p.xml:2:1\n");
  EXPECT_EQ(Messages(bad), told + "  in template \"t\" at p.xml:2:1\n");
  EXPECT_EQ(Messages("<template name=\"t\"><instance id=\"i\" template=\"u\"/></template><template "
                     "name=\"u\"><instance id=\"i\" template=\"t\"/></template>"
                     "<instance id=\"a\" template=\"t\"/>"),
    "p.xml:2:81: error: instance \"i\": templates instantiate each other without end: t -> u -> t\n"
    "  in instance \"i\" at p.xml:2:20, from template \"u\" at p.xml:2:62\n"
    "  in instance \"a\" at p.xml:2:123, from template \"t\" at p.xml:2:1\n");
  EXPECT_EQ(Messages("<template name=\"t\"><port name=\"in\" type=\"colour\"/></template>"),
    "p.xml:2:36: error: template \"t\": port \"in\": unknown type \"colour\"; did you mean \"color\"?\n");
  EXPECT_EQ(Messages("<template name=\"t\"><port name=\"in\"/><node id=\"n\" type=\"TestBox\"><input port=\"radiance\" "
                     "from=\"@inn\"/></node></template>"),
    "p.xml:2:88: error: node \"n\" (TestBox): input \"radiance\": template \"t\" has no input port \"inn\"; did you "
    "mean \"in\"?\n"
    "  in template \"t\" at p.xml:2:1\n");
  const std::string pass = "<template name=\"p\"><port name=\"in\"/><port name=\"out\" from=\"@in\"/></template>";
  EXPECT_NE(Messages(pass + "<instance id=\"a\" template=\"p\"><input port=\"in\" from=\"b:out\"/></instance>"
                            "<instance id=\"b\" template=\"p\"><input port=\"in\" from=\"a:out\"/></instance><output "
                            "name=\"o\" from=\"a:out\"/>")
              .find("leads back to itself through template ports"),
    std::string::npos);
}

TEST(Diagnostics, Outputs)
{
  EXPECT_EQ(Messages(Pt + "<output name=\"o\"/>"),
    "p.xml:2:34: error: <output> \"o\": attribute \"from\" is missing; say what to write, or give <layer>s\n");
  EXPECT_EQ(Messages(Pt + "<output name=\"o\" from=\"pt:radianse\" file=\"a.exr\"/>"),
    "p.xml:2:51: error: output \"o\": node \"pt\" has no output \"radianse\"; did you mean \"radiance\"?\n");
  EXPECT_EQ(Messages(Pt + "<output name=\"o\" from=\"pt\"/><output name=\"o\" from=\"pt\"/>"),
    "p.xml:2:70: error: output \"o\": the name is already used at p.xml:2:34\n");
  EXPECT_EQ(
    Messages(Pt + "<output name=\"o\" from=\"pt\" file=\"a.exr\"/><output name=\"p\" from=\"pt\" file=\"a.exr\"/>"),
    "p.xml:2:102: error: output \"p\": \"a.exr\" is already written by the output at p.xml:2:34\n");
  EXPECT_EQ(Messages(Pt + "<output name=\"o\" from=\"pt:depth\" file=\"a.png\" view=\"v\"/>"),
    "p.xml:2:51: error: output \"o\": wants color (3 x float, linear RGB), but \"pt:depth\" is depth (1 x float along "
    "the view axis)\n");
  EXPECT_EQ(Messages(Pt + "<output name=\"o\" from=\"pt\" file=\"a.png\" display=\"d\"/>"),
    "p.xml:2:74: error: output \"o\": display is given without view\n");
  EXPECT_EQ(
    Messages(Pt + "<output name=\"o\" from=\"pt\" file=\"a.png\" view=\"d\"><layer from=\"pt:depth\"/></output>"),
    "p.xml:2:74: error: output \"o\": a view shows one image, but there are 2 layers\n");
  EXPECT_EQ(Messages(Pt + "<output name=\"o\" from=\"pt\" file=\"\"/>"),
    "p.xml:2:61: error: output \"o\": the file's name is empty\n");
}

TEST(Diagnostics, Warnings)
{
  EXPECT_EQ(Messages(Box("") + "\n<node id=\"dbg\" type=\"TestBox\"><input port=\"radiance\" from=\"pt\"/></node>"),
    "p.xml:5:1: warning: node \"dbg\": feeds no output and will not run\n");
  EXPECT_EQ(Messages("<variable name=\"n\" type=\"int\" default=\"1\"/>" + Box("")),
    "p.xml:2:1: warning: variable \"n\": is never used\n");
}

TEST(Diagnostics, CommandLine)
{
  const std::string good =
    "<variable name=\"frames\" type=\"int\" default=\"1\"/><time count=\"$(frames)\"/>" + Box("");
  GraphOptions o;
  o.Defines = { { "frmaes", "3" }, { "frames", "x" } };
  EXPECT_EQ(Messages(good, o),
    "command line: error: -D frmaes: no such variable; did you mean \"frames\"?\n"
    "command line: error: -D frames: \"x\" is not a whole number; the variable is int, default \"1\"\n");
  o = {};
  o.Properties = { { "bb.Radius", "1" }, { "b.Radios", "1" }, { "b.Radius", "99" }, { "b", "1" } };
  EXPECT_EQ(Messages(good, o),
    "command line: error: --set bb.Radius: no node \"bb\"; did you mean \"b\"?\n"
    "command line: error: --set b.Radios: node \"b\" (TestBox) has no property \"Radios\"; did you mean \"Radius\"?\n"
    "command line: error: --set b: not of the form node.Property=value\n"
    "command line: error: --set b: Radius = 99 is outside [0, 16] (default 1)\n");
  o = {};
  o.Outputs = { { "beauty", "x.exr" }, { "pt:normalz", "n.exr" } };
  EXPECT_EQ(Messages(good, o),
    "command line: error: --output beauty: no such output; outputs: o; or name an array as NODE:ARRAY\n"
    "command line: error: output \"pt:normalz\": node \"pt\" has no output \"normalz\"; did you mean \"normal\"?\n");
  o = {};
  o.Seed = -1;
  EXPECT_EQ(Messages(good, o), "command line: error: --set pt: Seed = -1 is outside [0, 1000000] (default 1)\n");
}

TEST(Diagnostics, AllMistakesAtOnceAndNoCascades)
{
  // One mistake each in five places; what depends on them says nothing.
  EXPECT_EQ(Messages("<node id=\"pt\" type=\"TestSorce\"/>\n"
                     "<node id=\"x\" type=\"TestBox\"><input port=\"radiance\" from=\"pt:whatever\"/><property "
                     "name=\"Radius\" value=\"-1\"/></node>\n"
                     "<node id=\"y\" type=\"TestBox\"><input port=\"radiance\" from=\"x:anything\"/><input "
                     "port=\"normal\" from=\"q:normal\"/></node>\n"
                     "<node id=\"z\" type=\"TestBox\"><input port=\"radiance\" from=\"y:mask\"/></node>\n"
                     "<output name=\"o\" from=\"w:radiance\"/>"),
    "p.xml:2:15: error: node \"pt\": unknown type \"TestSorce\"; did you mean \"TestSource\"?\n"
    "p.xml:3:96: error: node \"x\" (TestBox): Radius = -1 is outside [0, 16] (default 1)\n"
    "p.xml:4:92: error: node \"y\" (TestBox): input \"normal\": no node \"q\"; nodes: pt, x, y, z\n"
    "p.xml:5:52: error: node \"z\" (TestBox): input \"radiance\": wants color (3 x float, linear RGB), but \"y:mask\" "
    "is scalar (1 x float)\n"
    "p.xml:6:18: error: output \"o\": no node \"w\"; nodes: pt, x, y, z\n");
}

TEST(Diagnostics, AnInstanceInputMayBeDelayed)
{
  const std::string mix =
    "<template name=\"mix\"><port name=\"now\"/><port name=\"past\"/>"
    "<node id=\"m\" type=\"TestAccumulate\"><input port=\"radiance\" from=\"@now\"/>"
    "<input port=\"history\" from=\"@past\"/></node><port name=\"out\" from=\"m:radiance\"/></template>";
  const auto use = [&](const std::string& delay)
  {
    return Messages(mix + Pt +
                    "<instance id=\"b\" template=\"mix\"><input port=\"now\" from=\"pt:radiance\"/>"
                    "<input port=\"past\" from=\"b:out\"" +
                    delay + "/></instance><output name=\"o\" from=\"b:out\"/>");
  };
  EXPECT_EQ(use(" delay=\"1\""), "");
  EXPECT_NE(use("").find("cycle"), std::string::npos);
  const std::string bad = use(" delay=\"2\"");
  EXPECT_NE(bad.find("delay = \"2\" is neither 0 nor 1"), std::string::npos);
  EXPECT_EQ(bad.find("cycle"), std::string::npos) << bad;
}

TEST(Diagnostics, WhatAFileLacks)
{
  // A file that has radiance, foreign and weight: what the pipeline does without is one warning, the rest is told where
  // it is asked for, with all that there is once.
  const std::string r = "<node id=\"r\" type=\"TestReader\"><property name=\"File\" value=\"f\"/></node>\n";
  const std::string box =
    "<template name=\"t\"><port name=\"in\"/><port name=\"n\"/><node id=\"b\" type=\"TestBox\"><input "
    "port=\"radiance\" from=\"@in\"/><input port=\"normal\" from=\"@n\"/></node><port name=\"out\" "
    "from=\"b\"/></template>\n";
  const auto use = [&](const std::string& in, const std::string& n)
  {
    return Messages(r + box + "<instance id=\"i\" template=\"t\"><input port=\"in\" from=\"r:" + in +
                    "/><input port=\"n\" from=\"r:" + n + "/></instance>\n<output name=\"o\" from=\"i\"/>");
  };
  EXPECT_EQ(use("radiance\"", "surface\" optional=\"1\""),
    "p.xml:2:1: warning: node \"r\" (TestReader): has no surface: i/b does without\n");
  EXPECT_EQ(use("radiance\"", "surface\""), "p.xml:4:83: error: instance \"i\" (template \"t\"): input \"n\": node "
                                            "\"r\" has no output \"surface\"; it has radiance, foreign, weight\n");
  EXPECT_EQ(use("radiance\"", "surface\" optional=\"perhaps\""),
    "p.xml:4:83: error: instance \"i\" (template \"t\"): input \"n\": node \"r\" has no output \"surface\"; it has "
    "radiance, foreign, weight\np.xml:4:100: error: instance \"i\" (template \"t\"): input \"n\": optional = "
    "\"perhaps\" is neither 0 nor 1; optional=\"1\" leaves the input out where there is no such array\n");
  // The template's node needs it.
  EXPECT_EQ(use("colour\" optional=\"1\"", "surface\" optional=\"1\""),
    "p.xml:3:104: error: node \"b\" (TestBox): input \"radiance\": is required, but node \"r\" has no array "
    "\"colour\"; optional=\"1\" is for inputs that the stage can do without\n  in instance \"i\" at p.xml:4:1, from "
    "template \"t\" at p.xml:3:1\n");
  EXPECT_EQ(Messages(r + "<node id=\"a\" type=\"TestBox\"><input port=\"radiance\" from=\"r\"/><input port=\"normal\" "
                         "from=\"r:surface\"/></node>\n"
                         "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"r:colour\"/><input "
                         "port=\"normal\" from=\"r:surface\"/></node>\n"
                         "<output name=\"o\" from=\"a\"/><output name=\"p\" from=\"b\"/>"),
    "p.xml:3:83: error: node \"a\" (TestBox): input \"normal\": node \"r\" has no output \"surface\"; it has radiance, "
    "foreign, weight; with optional=\"1\" the stage does without\np.xml:4:52: error: node \"b\" (TestBox): input "
    "\"radiance\": node \"r\" has no output \"colour\"\np.xml:4:90: error: node \"b\" (TestBox): input \"normal\": "
    "node \"r\" has no output \"surface\"; with optional=\"1\" the stage does without\n");
  EXPECT_EQ(
    Messages(r + "<node id=\"a\" type=\"TestBox\"><input port=\"radiance\" from=\"r\"/><input port=\"normal\" "
                 "from=\"r:surface\" optional=\"1\"/></node>\n"
                 "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"r\"/><input port=\"normal\" "
                 "from=\"r:surface\" optional=\"1\"/></node>\n"
                 "<node id=\"c\" type=\"TestBox\"><input port=\"radiance\" from=\"r\"/><input port=\"normal\" "
                 "from=\"r:up\" optional=\"1\"/></node>\n"
                 "<output name=\"o\" from=\"a\"/><output name=\"p\" from=\"b\"/><output name=\"q\" from=\"c\"/>"),
    "p.xml:2:1: warning: node \"r\" (TestReader): has no surface: a, b do without; no up: c does without\n");
}

TEST(Diagnostics, ABadPropertyDoesNotHideOtherMistakes)
{
  const std::string text =
    Messages("<node id=\"pt\" type=\"TestSource\"><property name=\"Bogus\" value=\"1\"/></node>"
             "<node id=\"b\" type=\"TestBox\"><input port=\"radiance\" from=\"pt:radianse\"/></node>" +
             Out);
  EXPECT_NE(text.find("no property \"Bogus\""), std::string::npos) << text;
  EXPECT_NE(text.find("did you mean \"radiance\"?"), std::string::npos) << text;
}

TEST(Diagnostics, StagesJudgeTheirConnectionsTogether)
{
  const std::string r = "<node id=\"r\" type=\"TestReader\"><property name=\"File\" value=\"x\"/></node>\n";
  const auto guided = [&r](const std::string& guides, const std::string& from = "r:radiance")
  {
    return Messages(r + "<node id=\"g\" type=\"TestGuided\"><input port=\"radiance\" from=\"" + from + "\"/>\n" +
                    guides + "</node>\n<output name=\"o\" from=\"g\"/>");
  };
  const std::string good = "<input port=\"guide\" from=\"r:weight\" name=\"good\"/>\n";
  EXPECT_EQ(guided(good), "");
  // All mistakes, each at its connection; those left out are not among the connections.
  EXPECT_EQ(guided("<input port=\"guide\" from=\"r:surface\" name=\"bad\" optional=\"1\"/>\n" + good),
    "p.xml:2:1: warning: node \"r\" (TestReader): has no surface: g does without\n");
  EXPECT_EQ(guided("<input port=\"guide\" from=\"r:surface\" name=\"bad\" optional=\"1\"/>\n" + good +
                   "<input port=\"guide\" from=\"r:foreign\" name=\"bad\"/>\n<input port=\"guide\" from=\"r:weight\" "
                   "name=\"bad\"/>\n"),
    "p.xml:6:1: error: node \"g\" (TestGuided): input \"guide\": guide 1 (foreign, 3) is bad; be good\n"
    "p.xml:7:1: error: node \"g\" (TestGuided): input \"guide\": guide 2 (weight, 1) is bad; be good\n");
  // What may follow from another mistake is not told.
  EXPECT_EQ(guided("<input port=\"guide\" from=\"r:nothing\"/>\n<input port=\"guide\" from=\"r\" name=\"bad\"/>\n"),
    "p.xml:4:21: error: node \"g\" (TestGuided): input \"guide\": node \"r\" has no output \"nothing\"; it has "
    "radiance, foreign, weight; with optional=\"1\" the stage does without\n");
  // About the stage as a whole, and in a template.
  const std::string pt = "<node id=\"pt\" type=\"TestSource\"/>\n";
  EXPECT_EQ(Messages(pt + "<node id=\"g\" type=\"TestGuided\"><input port=\"radiance\" from=\"pt\"/></node>\n"
                          "<output name=\"o\" from=\"g\"/>"),
    "p.xml:3:1: warning: node \"g\" (TestGuided): there is no weight\n");
  EXPECT_EQ(
    Messages(r + "<template name=\"t\"><port name=\"in\"/><node id=\"g\" type=\"TestGuided\"><input "
                 "port=\"radiance\" from=\"@in\"/>\n<input port=\"guide\" from=\"@in\" name=\"bad\"/></node><port "
                 "name=\"out\" from=\"g\"/></template>\n<instance id=\"i\" template=\"t\"><input port=\"in\" "
                 "from=\"r:foreign\"/></instance>\n<output name=\"o\" from=\"i\"/>"),
    "p.xml:4:1: error: node \"g\" (TestGuided): input \"guide\": guide 0 (foreign, 3) is bad; be good\n"
    "  in instance \"i\" at p.xml:5:1, from template \"t\" at p.xml:3:1\n");
}
