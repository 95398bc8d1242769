// SPDX-License-Identifier: BSD-3-Clause
#include "quellFuzz.h"

#include <algorithm>

namespace
{
/// [begin, end) of a start tag or of an attribute's value.
struct Span
{
  std::size_t Begin = 0, End = 0;
  std::size_t Size() const { return this->End - this->Begin; }
};

std::vector<Span> AttributeValues(const std::string& text)
{
  std::vector<Span> spans;
  for (std::size_t at = 0; (at = text.find("=\"", at)) != std::string::npos;)
  {
    at += 2;
    const std::size_t end = text.find('"', at);
    if (end == std::string::npos)
      break;
    spans.push_back({ at, end });
    at = end + 1;
  }
  return spans;
}

/// Elements with all that is in them, found by counting tags; good enough for documents that were well-formed.
std::vector<Span> Elements(const std::string& text)
{
  std::vector<Span> spans;
  std::vector<std::size_t> open;
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;)
  {
    const std::size_t end = text.find('>', at);
    if (end == std::string::npos)
      break;
    const char next = at + 1 < text.size() ? text[at + 1] : '\0';
    if (next == '/')
    {
      if (!open.empty())
      {
        spans.push_back({ open.back(), end + 1 });
        open.pop_back();
      }
    }
    else if (next != '!' && next != '?')
    {
      if (text[end - 1] == '/')
        spans.push_back({ at, end + 1 });
      else
        open.push_back(at);
    }
    at = end + 1;
  }
  return spans;
}
}

const std::string& FuzzMutator::Piece()
{
  static const std::vector<std::string> pieces = { "\"", "'", "<", ">", "/>", "/", "=", "$(", "$$(", "$", ")", "@",
    "@in", ":", "pt:", "pt:radiance", " delay=\"1\"", " optional=\"1\"", " sigma=\"0.1\"", "&amp;", "&#x41;", "&#0;",
    "&", "<!--", "-->", "--", "<![CDATA[", "]]>", "<?x y?>", std::string("\0", 1), "\xFF", "\xC3\xA4", "\xEF\xBB\xBF",
    "\x01", "\n", "\r", "\t", " ", "####", "../", "$(spp)", "$(scene)", "<node id=\"q\" type=\"Sum\">", "</node>",
    "<instance id=\"q\" template=\"svgf\">", "</instance>", "<template name=\"q\">", "</template>",
    "<include file=\"library.xml\"/>", "<include file=\"svgf.xml\"/>", "<include file=\"library-cycle.xml\"/>",
    "<variable name=\"q\" type=\"int\" default=\"1\"/>", "<time count=\"3\"/>",
    "<output name=\"q\" from=\"pt\" file=\"q.exr\"/>", "<layer from=\"pt:depth\"/>", "<!DOCTYPE p [<!ENTITY a \"b\">]>",
    "&a;", " xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\"", " xsi:noNamespaceSchemaLocation=\"p.xsd\"",
    " xmlns=\"urn:x\"" };
  return pieces[this->Below(pieces.size())];
}

/// What somebody might write, or try, as an attribute's value.
std::string FuzzMutator::Value()
{
  static const std::vector<std::string> values = { "", " ", "0", "1", "-1", "2", "1e30", "1e309", "1e-400", "-0", "+1",
    "+-1", "nan", "inf", "-inf", "0x10", "2147483647", "2147483648", "-2147483649", "9007199254740993",
    "9223372036854775808", "99999999999999999999999999999999999", "1.5", "1,5", "true", "false", "yes", "pt",
    "pt:", ":radiance", "pt:radiance", "pt:depth", "pt:normal", "pt:nothing", "pt:radiance:x", "a/b/c:radiance", "/",
    "direct/atrous:radiance", "direct:out", "@radiance", "@", "@@", "$(spp)", "$(", "$()", "$($(spp))", "$$(spp)",
    "$(spp", "$(scene)$(scene)", "$(q)", "..", ".", "/", "/dev/null", "/dev/zero", "/etc/passwd", "nowhere.xml",
    "library.xml", "../Scenes/cornell-box.gltf", "../Scenes", "####", "../Images/####.exr", "a.####.exr", "file://x",
    "int", "double", "string", "path", "color", "depth", "Sum", "BilateralFilter", "ImageReader", "ImageWriter",
    "DisplayTransform", "PathTraceSource", "CompareImages", "KernelFilter", "Matrix", "Radius", "File", "Scene", "View",
    "Arrays", "Seed", "1 2 3 4 5 6 7 8 9", "0 0 0", "ACES-like", "sRGB", "svgf", "demodulated-bilateral", "in", "out",
    "guide", "layer", "a\xC3\xA4", "con", "x y", "&lt;&gt;&quot;", "&#10;", "&#x10FFFF;" };
  switch (this->Below(12))
  {
    case 0:
      return std::string(1 + this->Below(300), char('a' + this->Below(26)));
    case 1:
      return this->Below(20) ? values[this->Below(values.size())] : std::string(60000 + this->Below(12000), '$');
    case 2:
    {
      std::string many;
      const std::string one = this->Below(2) ? "$(spp)" : "$(scene)";
      for (std::size_t i = this->Below(this->Below(10) ? 20 : 3000); i > 0; --i)
        many += one;
      return many;
    }
    case 3:
      return std::to_string(std::int64_t(this->Random.Any() >> this->Below(64)) - 1000);
    default:
      return values[this->Below(values.size())];
  }
}

void FuzzMutator::MutateBytes(std::string& text)
{
  const std::size_t at = this->Below(text.size()), length = std::min(text.size() - at, this->Below(24));
  switch (this->Below(8))
  {
    case 0:
      text[at] = char(this->Random.Any() & 0xFF);
      break;
    case 1:
      text.erase(at, length);
      break;
    case 2:
    case 3:
      text.insert(at, this->Piece());
      break;
    case 4:
      text.replace(at, length, this->Piece());
      break;
    case 5:
      text.insert(at, text.substr(this->Below(text.size()), this->Below(400)));
      break;
    case 6:
      std::swap(text[at], text[this->Below(text.size())]);
      break;
    default:
      if (this->Below(4) == 0)
        text.resize(at);
      break;
  }
}

void FuzzMutator::MutateAttribute(std::string& text)
{
  const std::vector<Span> spans = AttributeValues(text);
  if (spans.empty())
    return;
  const Span a = spans[this->Below(spans.size())], b = spans[this->Below(spans.size())];
  switch (this->Below(6))
  {
    case 0: // another attribute's value
      text.replace(a.Begin, a.Size(), text.substr(b.Begin, b.Size()));
      break;
    case 1:
    {
      const std::size_t name = text.find_last_of(" \n\t", a.Begin); // the attribute goes
      if (name != std::string::npos)
        text.erase(name, a.End + 1 - name);
      break;
    }
    case 2:
    case 3: // another number, another size: most files are still good
    {
      std::vector<Span> numbers;
      for (const Span& s : spans)
        if (s.Size() && s.Size() < 8 && text.find_first_not_of("0123456789.-", s.Begin) >= s.End)
          numbers.push_back(s);
      if (!numbers.empty())
      {
        const Span n = numbers[this->Below(numbers.size())];
        text.replace(n.Begin, n.Size(), std::to_string(this->Below(this->Below(4) ? 10 : 5000)));
      }
      break;
    }
    default:
      text.replace(a.Begin, a.Size(), this->Value());
      break;
  }
}

void FuzzMutator::MutateElement(std::string& text)
{
  const std::vector<Span> spans = Elements(text);
  if (spans.empty())
    return;
  const Span a = spans[this->Below(spans.size())], b = spans[this->Below(spans.size())];
  const std::string element = text.substr(a.Begin, a.Size());
  switch (this->Below(6))
  {
    case 0:
      text.erase(a.Begin, a.Size());
      break;
    case 1: // somewhere else, or inside of itself
      text.insert(b.End, element);
      break;
    case 2:
      text.insert(text.find('>', b.Begin) + 1, element);
      break;
    case 3: // many times
      for (std::size_t i = this->Below(this->Below(30) ? 8 : 800); i > 0 && text.size() < 400000; --i)
        text.insert(a.End, element);
      break;
    case 4: // wrapped
    {
      const std::string name = element.substr(1, element.find_first_of(" \n/>", 1) - 1);
      for (std::size_t i = this->Below(this->Below(10) ? 4 : 80); i > 0; --i)
      {
        text.insert(a.Begin + a.Size(), "</" + name + ">");
        text.insert(a.Begin, "<" + name + ">");
      }
      break;
    }
    default: // of another file
    {
      const std::string& other = this->Seeds[this->Below(this->Seeds.size())].Text;
      const std::vector<Span> theirs = Elements(other);
      if (!theirs.empty())
      {
        const Span c = theirs[this->Below(theirs.size())];
        text.insert(b.Begin, other.substr(c.Begin, c.Size()));
      }
      break;
    }
  }
}

/// Constructions that multiply: chains of variables, templates in templates, nodes that read each other.
void FuzzMutator::AddBlock(std::string& text)
{
  const std::size_t at = text.find("</pipeline>");
  if (at == std::string::npos)
    return;
  // Mostly few: what multiplies until the program refuses takes a hundred times as long as any other document.
  const std::size_t n = 1 + this->Below(this->Below(500) ? 5 : 300), ways = 1 + this->Below(2);
  std::string block;
  const auto name = [](const char* stem, std::size_t i) { return stem + std::to_string(i); };
  switch (this->Below(4))
  {
    case 0: // values made of values, perhaps in a circle
      for (std::size_t i = 0; i < n; ++i)
      {
        block += "<variable name=\"" + name("v", i) + "\" type=\"string\" default=\"";
        for (std::size_t w = 0; w < ways; ++w)
          block += i + 1 < n ? "$(" + name("v", i + 1) + ")" : this->Below(3) ? "x" : "$(v0)";
        block += "\"/>";
      }
      block += "<time count=\"$(v0)\"/>";
      break;
    case 1: // templates made of templates
      for (std::size_t i = 0; i < n; ++i)
      {
        block += "<template name=\"" + name("t", i) + "\"><port name=\"in\"/>";
        for (std::size_t w = 0; w < ways; ++w)
          block += i + 1 < n || this->Below(4) == 0
                     ? "<instance id=\"" + name("i", w) + "\" template=\"" + name("t", (i + 1) % n) +
                         "\"><input port=\"in\" from=\"@in\"/></instance>"
                     : "<node id=\"" + name("i", w) + "\" type=\"Sum\"><input port=\"radiance\" from=\"@in\"/></node>";
        block += "<port name=\"out\" from=\"i0\"/></template>";
      }
      block += "<instance id=\"fz\" template=\"t0\"><input port=\"in\" from=\"pt\"/></instance>";
      break;
    case 2: // ports that pass on what they get several times
      block += "<template name=\"pass\"><port name=\"in\"/><port name=\"out\" from=\"@in\"/></template>";
      for (std::size_t i = 0; i < n; ++i)
      {
        block += "<instance id=\"" + name("p", i) + "\" template=\"pass\">";
        for (std::size_t w = 0; w < ways; ++w)
          block += "<input port=\"in\" from=\"" +
                   (i                 ? name("p", i - 1) + ":out"
                     : this->Below(4) ? "pt"
                                      : name("p", n - 1)) +
                   "\"/>";
        block += "</instance>";
      }
      block += "<node id=\"fz\" type=\"Sum\"><input port=\"radiance\" from=\"" + name("p", n - 1) + ":out\"/></node>";
      break;
    default: // a chain, or a ring, of nodes
      for (std::size_t i = 0; i < n; ++i)
        block += "<node id=\"" + name("c", i) + "\" type=\"Sum\"><input port=\"radiance\" from=\"" +
                 (i                 ? name("c", i - 1)
                   : this->Below(3) ? "pt"
                                    : name("c", n - 1)) +
                 "\"/></node>";
      block += "<output name=\"fz\" from=\"" + name("c", n - 1) + "\" file=\"fz.exr\"/>";
      break;
  }
  text.insert(at, block);
}

void FuzzMutator::Encode(std::string& text)
{
  std::string out;
  switch (this->Below(3))
  {
    case 0:
      out = "\xEF\xBB\xBF" + text;
      break;
    case 1: // UTF-16, the ASCII part of the text
    {
      const bool big = this->Below(2) != 0;
      out = big ? "\xFE\xFF" : "\xFF\xFE";
      for (char c : text)
      {
        out += big ? '\0' : c;
        out += big ? c : '\0';
      }
      break;
    }
    default:
      out = "<?xml version=\"1.0\" encoding=\"" + std::string(this->Below(2) ? "ISO-8859-1" : "EBCDIC") + "\"?>" +
            text.substr(text.compare(0, 5, "<?xml") == 0 ? std::min(text.find('>'), text.size() - 1) + 1 : 0);
      break;
  }
  text = out;
}

FuzzCase FuzzMutator::Make(std::uint64_t n)
{
  this->Random.Begin(n);
  // Files with mistakes have most of the rare things, good ones most of what lies behind the checks.
  FuzzCase document = this->Seeds[this->Below(this->Seeds.size())];
  for (int i = 0; i < 2 && document.Name.find("BadInput") != std::string::npos; ++i)
    document = this->Seeds[this->Below(this->Seeds.size())];
  std::string& text = document.Text;
  // A colour configuration is loaded for every view: most of a document's time, and always the same.
  const std::string view = " view=\"ACES-like\"";
  for (std::size_t at = this->Below(10) ? text.find(view) : std::string::npos; at != std::string::npos;
       at = text.find(view))
    text.erase(at, view.size());
  if (this->Below(12) == 0)
    this->AddBlock(text);
  // Every kind of mutation alone as well as mixed: one change finds what many would hide.
  const std::size_t kinds = this->Below(4);
  for (std::size_t edits = 1 + this->Below(this->Below(3) ? 1 : 8); edits > 0 && !text.empty(); --edits)
  {
    const std::size_t kind = kinds == 3 ? this->Below(3) : kinds;
    kind == 0 ? this->MutateBytes(text) : kind == 1 ? this->MutateAttribute(text) : this->MutateElement(text);
  }
  if (this->Below(60) == 0 && !text.empty())
    this->Encode(text);
  return document;
}
