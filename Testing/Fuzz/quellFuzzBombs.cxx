// SPDX-License-Identifier: BSD-3-Clause
// Small texts that would be large, deep or endless. The limits are those of Documentation/pipeline-format.md.
#include "quellFuzz.h"

namespace
{
std::string Repeat(const std::string& text, std::size_t n)
{
  std::string out;
  out.reserve(text.size() * n);
  for (std::size_t i = 0; i < n; ++i)
    out += text;
  return out;
}

/// make(0) + make(1) + ... + make(n - 1)
template <class F>
std::string Each(std::size_t n, const F& make)
{
  std::string out;
  for (std::size_t i = 0; i < n; ++i)
    out += make(i);
  return out;
}

std::string S(std::size_t i)
{
  return std::to_string(i);
}

std::string Pipeline(const std::string& body)
{
  return "<pipeline version=\"1\">" + body + "</pipeline>";
}

// Reads a picture that the project has: real pipelines around it need no scene.
const char* const Source =
  "<node id=\"pt\" type=\"ImageReader\"><property name=\"File\" value=\"../Images/noisy.exr\"/></node>";
const char* const Pass = "<template name=\"pass\"><port name=\"in\"/><port name=\"out\" from=\"@in\"/></template>";
const char* const TooLarge = "the pipeline expands to more than this program takes";
}

std::vector<FuzzBomb> FuzzBombs()
{
  std::vector<FuzzBomb> bombs;
  const auto add = [&bombs](const char* name, const std::string& text, const char* message) {
    bombs.push_back({ name, text, message });
  };
  add("entities that hold entities",
    "<!DOCTYPE p [<!ENTITY a0 \"x\">" +
      Each(40, [](std::size_t i) { return "<!ENTITY a" + S(i + 1) + " \"" + Repeat("&a" + S(i) + ";", 10) + "\">"; }) +
      "]><pipeline version=\"1\" doc=\"&a40;\"/>",
    "document type declarations are not allowed");
  add("one long entity used often",
    "<!DOCTYPE p [<!ENTITY a \"" + std::string(100000, 'x') + "\">]><pipeline version=\"1\" doc=\"" +
      Repeat("&a;", 100000) + "\"/>",
    "document type declarations are not allowed");
  add("an external entity",
    "<!DOCTYPE p [<!ENTITY a SYSTEM \"file:///dev/zero\">]><pipeline version=\"1\" doc=\"&a;\"/>",
    "document type declarations are not allowed");
  add("deep", Pipeline(Repeat("<node>", 100000)), "elements are nested more than 64 deep");
  add("wide", Pipeline(Repeat("<time/>", 200000)), "more than 100000 elements and comments");
  add("comments", Pipeline(Repeat("<!---->", 200000)), "more than 100000 elements and comments");
  add("large", Pipeline(std::string(std::size_t(17) << 20, ' ')), "bytes, more than the 16777216 allowed");
  add("a long value", "<pipeline version=\"1\" doc=\"" + std::string(70000, 'x') + "\"/>",
    "has more than 65536 characters");
  add("a long name", "<" + std::string(1000000, 'x') + "/>", "a name of more than 256 characters");
  add("a long attribute name", "<pipeline " + std::string(1000000, 'x') + "=\"\"/>",
    "a name of more than 256 characters");
  add("many attributes",
    "<pipeline version=\"1\" " + Each(500000, [](std::size_t i) { return "a" + S(i) + "=\"\" "; }) + "/>",
    "the element has more than 64 attributes");
  add("long text", Pipeline(std::string(std::size_t(15) << 20, 'x')), "does not belong here");
  add("not closed", "<pipeline version=\"1\" doc=\"" + std::string(std::size_t(15) << 20, '<'), "not well-formed XML");
  add("values that double",
    Pipeline(Each(64,
      [](std::size_t i)
      {
        return "<variable name=\"v" + S(i) + "\" type=\"string\" default=\"" +
               (i < 63 ? Repeat("$(v" + S(i + 1) + ")", 2) : "x") + "\"/>";
      })),
    "grows beyond 65536 characters");
  add("many long values",
    Pipeline(
      "<variable name=\"a\" type=\"string\" default=\"" + std::string(60000, 'x') + "\"/>" +
      Each(50000, [](std::size_t i) { return "<variable name=\"v" + S(i) + "\" type=\"string\" default=\"$(a)\"/>"; })),
    TooLarge);
  add("a long chain of values",
    Pipeline(Each(5000, [](std::size_t i)
               { return "<variable name=\"v" + S(i) + "\" type=\"string\" default=\"$(v" + S(i + 1) + ")\"/>"; }) +
             "<variable name=\"v5000\" type=\"string\" default=\"\"/>"),
    "variables refer to each other more than 1000 deep");
  add("expressions in expressions", Pipeline("<time count=\"" + Repeat("$(", 30000) + "\"/>"),
    "has no \")\" after \"$(\"");
  add(
    "a number without end", Pipeline("<time count=\"" + std::string(60000, '9') + "\"/>"), "is outside [1, 10000000]");
  add("templates that multiply",
    Pipeline(Each(15,
               [](std::size_t i)
               {
                 return "<template name=\"t" + S(i) + "\">" +
                        Each(10, [i](std::size_t w)
                          { return "<instance id=\"i" + S(w) + "\" template=\"t" + S(i + 1) + "\"/>"; }) +
                        "</template>";
               }) +
             "<template name=\"t15\"/><instance id=\"a\" template=\"t0\"/>"),
    "expands to more than 5000 nodes");
  add("templates that nobody instantiates multiply",
    Pipeline(Each(14,
               [](std::size_t i)
               {
                 return "<template name=\"t" + S(i) + "\">" +
                        Each(10, [i](std::size_t w)
                          { return "<instance id=\"i" + S(w) + "\" template=\"t" + S(i + 1) + "\"/>"; }) +
                        "</template>";
               }) +
             "<template name=\"t14\"/>"),
    "expands to more than 5000 nodes");
  add("templates in templates",
    Pipeline(
      Each(100, [](std::size_t i)
        { return "<template name=\"t" + S(i) + "\"><instance id=\"i\" template=\"t" + S(i + 1) + "\"/></template>"; }) +
      "<template name=\"t100\"/><instance id=\"a\" template=\"t0\"/>"),
    "instances are nested more than 16 deep");
  add("a template of itself",
    Pipeline("<template name=\"t\"><instance id=\"i\" template=\"t\"/></template><instance id=\"a\" template=\"t\"/>"),
    "templates instantiate each other without end");
  add("parameters of many instances",
    Pipeline(
      "<template name=\"t\">" +
      Each(50000, [](std::size_t i) { return "<parameter name=\"p" + S(i) + "\" type=\"int\" default=\"1\"/>"; }) +
      "</template>" + Each(4000, [](std::size_t i) { return "<instance id=\"i" + S(i) + "\" template=\"t\"/>"; })),
    TooLarge);
  add("ports that multiply",
    Pipeline(
      Source + std::string(Pass) +
      Each(60,
        [](std::size_t i)
        {
          return "<instance id=\"p" + S(i) + "\" template=\"pass\">" +
                 Repeat("<input port=\"in\" from=\"" + (i ? "p" + S(i - 1) : std::string("pt")) + "\"/>", 2) +
                 "</instance>";
        }) +
      "<node id=\"s\" type=\"Sum\"><input port=\"radiance\" from=\"p59\"/></node><output name=\"o\" from=\"s\"/>"),
    TooLarge);
  add("a long way through ports",
    Pipeline(Source + std::string(Pass) +
             Each(1000,
               [](std::size_t i)
               {
                 return "<instance id=\"p" + S(i) + "\" template=\"pass\"><input port=\"in\" from=\"" +
                        (i ? "p" + S(i - 1) : std::string("pt")) + "\"/></instance>";
               }) +
             "<output name=\"o\" from=\"p999\"/>"),
    "leads through more than 256 template ports");
  add("ports in a circle",
    Pipeline(std::string(Pass) +
             "<instance id=\"a\" template=\"pass\"><input port=\"in\" from=\"b\"/></instance><instance "
             "id=\"b\" template=\"pass\"><input port=\"in\" from=\"a\"/></instance>"),
    "leads back to itself through template ports");
  add("many connections of one input",
    Pipeline(Source + std::string("<node id=\"s\" type=\"Sum\">") +
             Repeat("<input port=\"radiance\" from=\"pt\"/>", 90000) + "</node><output name=\"o\" from=\"s\"/>"),
    "");
  add("many inputs of one instance",
    Pipeline("<template name=\"t\">" + Each(45000, [](std::size_t i) { return "<port name=\"p" + S(i) + "\"/>"; }) +
             "</template>" + Source + "<instance id=\"i\" template=\"t\">" +
             Each(45000, [](std::size_t i) { return "<input port=\"p" + S(i) + "\" from=\"pt\"/>"; }) + "</instance>"),
    "");
  add("as many nodes as there may be, in a row",
    Pipeline(Source +
             Each(4900,
               [](std::size_t i)
               {
                 return "<node id=\"n" + S(i) + "\" type=\"Sum\"><input port=\"radiance\" from=\"" +
                        (i ? "n" + S(i - 1) : std::string("pt")) + "\"/></node>";
               }) +
             "<output name=\"o\" from=\"n4899\"/>"),
    "");
  add("as many nodes as there may be, in a ring",
    Pipeline(Each(4900,
               [](std::size_t i)
               {
                 return "<node id=\"n" + S(i) + "\" type=\"Sum\"><input port=\"radiance\" from=\"n" +
                        S((i + 4899) % 4900) + "\"/></node>";
               }) +
             "<output name=\"o\" from=\"n4899\"/>"),
    "cycle: ");
  add("many outputs",
    Pipeline(Source + Each(30000, [](std::size_t i)
                        { return "<output name=\"o" + S(i) + "\" from=\"pt\" file=\"" + S(i) + ".exr\"/>"; })),
    "expands to more than 5000 nodes");
  add("many layers",
    Pipeline(Source + std::string("<output name=\"o\" from=\"pt\" file=\"o.exr\">") +
             Repeat("<layer from=\"pt\"/>", 90000) + "</output>"),
    "");
  add("many misspelt names, all alike",
    Pipeline(Each(4000,
      [](std::size_t i)
      {
        return "<node id=\"" + std::string(120, 'n') + S(i) + "\" type=\"Sum\"><input port=\"radiance\" from=\"" +
               std::string(121, 'n') + S(i) + "\"/></node>";
      })),
    "no node ");
  add("a mistake in every element", Pipeline(Each(90000, [](std::size_t i) { return "<x" + S(i) + "/>"; })),
    "does not belong here");
  add("names of twenty thousand variables",
    Pipeline(Each(20000,
      [](std::size_t i) { return "<variable name=\"v" + S(i) + "\" type=\"string\" default=\"$(w" + S(i) + ")\"/>"; })),
    "no such variable");
  add("a matrix without end",
    Pipeline(Source +
             std::string("<node id=\"k\" type=\"KernelFilter\"><input port=\"radiance\" from=\"pt\"/><property "
                         "name=\"Kernel\" value=\"Matrix\"/><property name=\"Matrix\" value=\"") +
             Repeat("1 ", 30000) + "\"/></node><output name=\"o\" from=\"k\"/>"),
    "Matrix: ");
  return bombs;
}
