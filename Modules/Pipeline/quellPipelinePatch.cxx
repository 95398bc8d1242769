// SPDX-License-Identifier: BSD-3-Clause
#include "quellPipelinePatch.h"

#include "quellPipelineReader.h"
#include "quellPipelineWriter.h"
#include "quellXmlDocument.h"

#include "vtk_expat.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <locale>
#include <sstream>
#include <vector>

namespace quell
{
namespace
{
const char* const Target = "quell-view";

/// An element and where it is in the text.
struct Span
{
  std::string Name;
  std::vector<std::pair<std::string, std::string>> Attributes;
  std::size_t Tag = 0, TagEnd = 0; ///< of the start tag
  std::size_t Inner = 0;           ///< where the end tag begins; TagEnd of an empty-element tag
  std::size_t End = 0;
  std::vector<Span> Children;

  bool Empty(const std::string& text) const
  {
    return this->TagEnd >= 2 && text[this->TagEnd - 2] == '/' && this->End == this->TagEnd;
  }
  std::string Get(const std::string& name) const
  {
    for (const auto& a : this->Attributes)
    {
      if (a.first == name)
      {
        return a.second;
      }
    }
    return {};
  }
};

struct Parse
{
  XML_Parser Parser = nullptr;
  Span Top;
  std::vector<Span*> Open;
  struct Instruction
  {
    std::size_t Start = 0, End = 0;
    std::string Data;
  };
  std::vector<Instruction> Instructions; ///< ours
  bool Good = false;

  explicit Parse(const std::string& text)
  {
    this->Open.push_back(&this->Top);
    this->Parser = XML_ParserCreate(nullptr);
    if (!this->Parser)
    {
      return;
    }
    XML_SetUserData(this->Parser, this);
    XML_SetElementHandler(this->Parser, Start, End);
    XML_SetProcessingInstructionHandler(this->Parser, Instruct);
    this->Good = text.size() < (16u << 20) &&
                 XML_Parse(this->Parser, text.data(), int(text.size()), 1) == XML_STATUS_OK &&
                 this->Top.Children.size() == 1;
    XML_ParserFree(this->Parser);
  }
  const Span& Root() const { return this->Top.Children.front(); }

  static std::size_t At(XML_Parser p) { return std::size_t(std::max<XML_Index>(0, XML_GetCurrentByteIndex(p))); }

  static void Start(void* data, const XML_Char* name, const XML_Char** attributes)
  {
    Parse& self = *static_cast<Parse*>(data);
    if (self.Open.size() > 64)
    {
      XML_StopParser(self.Parser, XML_FALSE);
      return;
    }
    Span s;
    s.Name = name;
    for (; attributes[0]; attributes += 2)
    {
      s.Attributes.emplace_back(attributes[0], attributes[1]);
    }
    s.Tag = At(self.Parser);
    s.TagEnd = s.Tag + std::size_t(XML_GetCurrentByteCount(self.Parser));
    self.Open.back()->Children.push_back(std::move(s));
    self.Open.push_back(&self.Open.back()->Children.back());
  }
  static void End(void* data, const XML_Char*)
  {
    Parse& self = *static_cast<Parse*>(data);
    Span& s = *self.Open.back();
    s.Inner = At(self.Parser);
    s.End = s.Inner + std::size_t(XML_GetCurrentByteCount(self.Parser));
    if (s.Inner <= s.TagEnd && s.End <= s.TagEnd)
    {
      s.Inner = s.End = s.TagEnd; // <a/>
    }
    self.Open.pop_back();
  }
  static void Instruct(void* data, const XML_Char* target, const XML_Char* text)
  {
    Parse& self = *static_cast<Parse*>(data);
    if (target == std::string(Target))
    {
      const std::size_t at = At(self.Parser);
      self.Instructions.push_back({ at, at + std::size_t(XML_GetCurrentByteCount(self.Parser)), text });
    }
  }
};

bool IsBlank(char c)
{
  return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

/// What tells siblings apart.
std::string Key(const Span& s)
{
  for (const char* name : { "id", "port", "name", "file", "from" })
  {
    const std::string value = s.Get(name);
    if (!value.empty())
    {
      return s.Name + ' ' + name + ' ' + value;
    }
  }
  return s.Name;
}

bool SameContent(const Span& a, const Span& b)
{
  if (a.Name != b.Name || a.Attributes.size() != b.Attributes.size() || a.Children.size() != b.Children.size())
  {
    return false;
  }
  for (const auto& x : a.Attributes)
  {
    if (std::find(b.Attributes.begin(), b.Attributes.end(), x) == b.Attributes.end())
    {
      return false;
    }
  }
  return std::equal(a.Children.begin(), a.Children.end(), b.Children.begin(), SameContent);
}

class Patcher
{
public:
  Patcher(const std::string& oldText, const std::string& newText)
    : Old(oldText)
    , New(newText)
  {
  }

  std::string Element(const Span& a, const Span& b) const
  {
    std::string out = this->Tag(a, b);
    if (a.Children.empty() && b.Children.empty())
    {
      return out + this->Old.substr(a.TagEnd, a.End - a.TagEnd);
    }
    const std::vector<int> partner = Match(a.Children, b.Children); // of b's children, index in a's
    std::vector<bool> kept(a.Children.size(), false);
    for (int i : partner)
    {
      if (i >= 0)
      {
        kept[std::size_t(i)] = true;
      }
    }
    // Behind which of the old children (-1: before all) each new one goes.
    std::vector<std::vector<std::size_t>> after(a.Children.size() + 1);
    int last = -1;
    for (std::size_t j = 0; j < b.Children.size(); ++j)
    {
      if (partner[j] >= 0)
      {
        last = partner[j];
        continue;
      }
      int place = last;
      if (place < 0)
      {
        // Before the first of its kind, else at the end.
        for (std::size_t k = j + 1; k < b.Children.size() && place < 0; ++k)
        {
          if (partner[k] >= 0)
          {
            place = partner[k] - 1;
            break;
          }
        }
        if (place < 0 && std::none_of(partner.begin() + std::ptrdiff_t(j), partner.end(), [](int p) { return p >= 0; }))
        {
          place = int(a.Children.size()) - 1;
        }
      }
      after[std::size_t(place + 1)].push_back(j);
    }

    const std::string indent = this->Indent(a);
    const std::string childIndent = a.Children.empty() ? indent + "  " : this->Indent(a.Children.front());
    std::string body;
    const auto insert = [&](std::size_t place)
    {
      for (std::size_t j : after[place])
      {
        body += this->Written(b, j, childIndent);
      }
    };
    insert(0);
    std::size_t at = a.TagEnd;
    for (std::size_t i = 0; i < a.Children.size(); ++i)
    {
      const Span& child = a.Children[i];
      if (kept[i])
      {
        const std::size_t j = std::size_t(std::find(partner.begin(), partner.end(), int(i)) - partner.begin());
        body += this->Old.substr(at, child.Tag - at) + this->Element(child, b.Children[j]);
      }
      at = child.End;
      insert(i + 1);
    }
    const std::string tail = this->Old.substr(at, a.Inner - at);
    if (a.Empty(this->Old))
    {
      std::size_t end = out.size() - 2; // "/>"
      while (end > 0 && IsBlank(out[end - 1]))
      {
        --end;
      }
      return out.substr(0, end) + ">" + body + "\n" + indent + "</" + a.Name + ">";
    }
    const std::string close = this->Old.substr(a.Inner, a.End - a.Inner);
    return out + body +
           (tail.find('\n') == std::string::npos && !body.empty() && a.Children.empty() ? "\n" + indent : tail) + close;
  }

private:
  /// Text of b's new child j with the comments before it, indented as its new neighbours are.
  std::string Written(const Span& b, std::size_t j, const std::string& indent) const
  {
    const std::size_t from = j == 0 ? b.TagEnd : b.Children[j - 1].End;
    std::string text = this->New.substr(from, b.Children[j].End - from);
    const std::string theirs = "\n" + Before(this->New, b.Children[j].Tag);
    std::string out;
    for (std::size_t i = 0; i < text.size();)
    {
      if (text.compare(i, theirs.size(), theirs) == 0)
      {
        out += "\n" + indent;
        i += theirs.size();
      }
      else
      {
        out += text[i++];
      }
    }
    return out;
  }

  /// The blanks between the line's begin and `at`.
  static std::string Before(const std::string& text, std::size_t at)
  {
    std::size_t from = at;
    while (from > 0 && (text[from - 1] == ' ' || text[from - 1] == '\t'))
    {
      --from;
    }
    return text.substr(from, at - from);
  }
  std::string Indent(const Span& s) const { return Before(this->Old, s.Tag); }

  std::string Tag(const Span& a, const Span& b) const
  {
    std::string tag = this->Old.substr(a.Tag, a.TagEnd - a.Tag);
    if (a.Attributes == b.Attributes)
    {
      return tag;
    }
    struct Range
    {
      std::string Name;
      std::size_t Begin, Value, ValueEnd;
    };
    std::vector<Range> ranges;
    std::size_t p = 1 + a.Name.size();
    while (p < tag.size())
    {
      const std::size_t begin = p;
      while (p < tag.size() && IsBlank(tag[p]))
      {
        ++p;
      }
      if (p >= tag.size() || tag[p] == '/' || tag[p] == '>')
      {
        break;
      }
      const std::size_t name = p;
      while (p < tag.size() && tag[p] != '=' && !IsBlank(tag[p]))
      {
        ++p;
      }
      Range r{ tag.substr(name, p - name), begin, 0, 0 };
      while (p < tag.size() && tag[p] != '"' && tag[p] != '\'')
      {
        ++p;
      }
      if (p >= tag.size())
      {
        break;
      }
      const char quote = tag[p++];
      r.Value = p;
      while (p < tag.size() && tag[p] != quote)
      {
        ++p;
      }
      r.ValueEnd = p++;
      ranges.push_back(r);
    }
    for (auto r = ranges.rbegin(); r != ranges.rend(); ++r)
    {
      const auto has = [&r](const std::pair<std::string, std::string>& x) { return x.first == r->Name; };
      const auto now = std::find_if(b.Attributes.begin(), b.Attributes.end(), has);
      if (now == b.Attributes.end())
      {
        tag.erase(r->Begin, r->ValueEnd + 1 - r->Begin);
      }
      else if (now->second != a.Get(r->Name))
      {
        std::string value = EscapeXml(now->second);
        if (tag[r->Value - 1] == '\'')
        {
          for (std::size_t q = 0; (q = value.find('\'', q)) != std::string::npos;)
          {
            value.replace(q, 1, "&apos;");
          }
        }
        tag.replace(r->Value, r->ValueEnd - r->Value, value);
      }
    }
    for (const auto& x : b.Attributes)
    {
      const auto has = [&x](const std::pair<std::string, std::string>& y) { return x.first == y.first; };
      if (std::none_of(a.Attributes.begin(), a.Attributes.end(), has))
      {
        std::size_t end = tag.size() - (tag.size() >= 2 && tag[tag.size() - 2] == '/' ? 2 : 1);
        while (end > 0 && IsBlank(tag[end - 1]))
        {
          --end;
        }
        tag.insert(end, " " + x.first + "=\"" + EscapeXml(x.second) + "\"");
      }
    }
    return tag;
  }

  /// For each of b's children the index of a's that it was, or -1. Equal ones first, then the same key, then what was
  /// renamed: the same element with the same content, then the same type.
  static std::vector<int> Match(const std::vector<Span>& a, const std::vector<Span>& b)
  {
    std::vector<int> partner(b.size(), -1);
    std::vector<bool> taken(a.size(), false);
    const auto pass = [&](auto same)
    {
      for (std::size_t j = 0; j < b.size(); ++j)
      {
        for (std::size_t i = 0; partner[j] < 0 && i < a.size(); ++i)
        {
          if (!taken[i] && same(a[i], b[j]))
          {
            partner[j] = int(i);
            taken[i] = true;
          }
        }
      }
    };
    pass([](const Span& x, const Span& y) { return Key(x) == Key(y) && SameContent(x, y); });
    pass([](const Span& x, const Span& y) { return Key(x) == Key(y); });
    pass(
      [](const Span& x, const Span& y)
      {
        return x.Name == y.Name && !x.Children.empty() && x.Children.size() == y.Children.size() &&
               std::equal(x.Children.begin(), x.Children.end(), y.Children.begin(), SameContent);
      });
    pass([](const Span& x, const Span& y)
      { return x.Name == y.Name && !x.Get("type").empty() && x.Get("type") == y.Get("type") && !x.Get("id").empty(); });
    return partner;
  }

  const std::string &Old, &New;
};
}

std::string PatchPipelineText(const std::string& original, const PipelineDocument& edited)
{
  const std::string fresh = WritePipelineText(edited);
  const Parse a(original), b(fresh);
  if (a.Good && b.Good && a.Root().Name == b.Root().Name)
  {
    const Span& root = a.Root();
    const std::string text =
      original.substr(0, root.Tag) + Patcher(original, fresh).Element(root, b.Root()) + original.substr(root.End);
    Diagnostics ignored;
    if (*ReadPipelineText(text, edited.File, ignored) == edited)
    {
      return text;
    }
  }
  return WithPipelinePositions(fresh, ReadPipelinePositions(original));
}

PipelinePositions ReadPipelinePositions(const std::string& text)
{
  PipelinePositions positions;
  const Parse parse(text);
  for (const Parse::Instruction& i : parse.Instructions)
  {
    std::istringstream lines(i.Data);
    lines.imbue(std::locale::classic());
    std::string line;
    while (std::getline(lines, line))
    {
      std::istringstream words(line);
      words.imbue(std::locale::classic());
      std::string name;
      double x = 0, y = 0;
      if (words >> name >> x >> y && std::fabs(x) < 1e6 && std::fabs(y) < 1e6)
      {
        positions[name] = { x, y };
      }
    }
  }
  return positions;
}

std::string WithPipelinePositions(const std::string& text, const PipelinePositions& positions)
{
  const Parse parse(text);
  if (!parse.Good)
  {
    return text;
  }
  std::string out = text;
  for (auto i = parse.Instructions.rbegin(); i != parse.Instructions.rend(); ++i)
  {
    std::size_t from = i->Start;
    while (from > 0 && IsBlank(out[from - 1]))
    {
      --from;
    }
    out.erase(from, i->End - from);
  }
  if (positions.empty())
  {
    return out;
  }
  std::string block = "\n  <?" + std::string(Target);
  for (const auto& p : positions)
  {
    char numbers[64];
    std::snprintf(numbers, sizeof numbers, " %.0f %.0f", p.second.first, p.second.second);
    block += "\n    " + p.first + numbers;
  }
  block += "\n  ?>";
  const Parse again(out);
  const Span& root = again.Root();
  if (root.Empty(out))
  {
    out.replace(root.TagEnd - 2, 2, ">" + block + "\n</" + root.Name + ">");
    return out;
  }
  std::size_t at = root.Inner;
  while (at > root.TagEnd && IsBlank(out[at - 1]))
  {
    --at;
  }
  out.insert(at, block);
  if (out.compare(at + block.size(), 1, "\n") != 0 && out.compare(at + block.size(), 2, "\r\n") != 0)
  {
    out.insert(at + block.size(), "\n");
  }
  return out;
}
}
