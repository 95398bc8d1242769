// SPDX-License-Identifier: BSD-3-Clause
#include "quellScript.h"

#include "quellStageDescription.h"
#include "quellViewer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

namespace quell
{
namespace
{
bool Number(const std::string& text, double& v)
{
  std::string error;
  return detail::ParseDouble(text, -1e6, 1e6, v, error);
}

bool Pair(const std::string& text, double& x, double& y)
{
  const std::size_t comma = text.find(',');
  return comma != std::string::npos && Number(text.substr(0, comma), x) && Number(text.substr(comma + 1), y);
}

bool Has(const std::vector<std::string>& words, const char* word)
{
  return std::find(words.begin(), words.end(), word) != words.end();
}

int ButtonNamed(const std::vector<std::string>& words)
{
  return Has(words, "right") ? 1 : Has(words, "middle") ? 2 : 0;
}
}

bool Script::Load(const std::string& file, std::string& error)
{
  std::ifstream stream(file);
  if (!stream)
  {
    error = "cannot read " + file;
    return false;
  }
  std::stringstream text;
  text << stream.rdbuf();
  this->Directory = std::filesystem::path(file).parent_path().string();
  return this->Parse(text.str(), file, error);
}

bool Script::Parse(const std::string& text, const std::string& name, std::string& error)
{
  static const char* const actions[] = { "size", "move", "click", "drag", "press", "release", "wheel", "key", "type",
    "drop", "wait", "frames", "screenshot" };
  static const std::size_t least[] = { 2, 1, 1, 2, 1, 1, 2, 1, 1, 1, 0, 1, 1 };
  this->Name = name;
  std::istringstream lines(text);
  std::string raw;
  for (int number = 1; std::getline(lines, raw); ++number)
  {
    std::istringstream words(raw);
    Line line;
    line.Number = number;
    if (!(words >> line.Action) || line.Action[0] == '#')
    {
      continue;
    }
    std::getline(words >> std::ws, line.Rest);
    std::istringstream rest(line.Rest);
    for (std::string word; rest >> word;)
    {
      line.Words.push_back(word);
    }
    const auto at = std::find(std::begin(actions), std::end(actions), line.Action);
    if (at == std::end(actions) || line.Words.size() < least[at - std::begin(actions)])
    {
      error = name + ":" + std::to_string(number) + ": " +
              (at == std::end(actions) ? "unknown action " : "too few words for ") + line.Action;
      return false;
    }
    if (line.Action == "size")
    {
      this->Width = std::atoi(line.Words[0].c_str());
      this->Height = std::atoi(line.Words[1].c_str());
      continue;
    }
    this->Lines.push_back(line);
  }
  return true;
}

void ScriptRunner::Draw()
{
  // What was sent is over: places are looked up in what it led to.
  do
  {
    this->Win.Frame([this] { this->View.Ui(); });
  } while (this->Win.HasEvents());
}

bool ScriptRunner::Settle()
{
  const auto start = std::chrono::steady_clock::now();
  for (int calm = 0; calm < 4;)
  {
    this->Draw();
    calm = this->View.IsIdle() && !this->Win.HasEvents() ? calm + 1 : 0;
    if (calm == 0)
    {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    if (std::chrono::steady_clock::now() - start > std::chrono::minutes(5))
    {
      return false;
    }
  }
  return true;
}

bool ScriptRunner::Find(const std::string& place, ImVec2& at, std::string& error)
{
  double x = 0, y = 0;
  if (Pair(place, x, y))
  {
    at = ImVec2(float(x), float(y));
    return true;
  }
  std::string name = place;
  double fx = 0.5, fy = 0.5;
  const std::size_t part = place.rfind('@');
  if (part != std::string::npos && Pair(place.substr(part + 1), fx, fy))
  {
    name = place.substr(0, part);
  }
  // Where it is when it stays there: what was just opened may still find its place.
  ImVec4 before(-1, -1, -1, -1);
  for (int frame = 0; frame < 40; ++frame)
  {
    const Marks& marks = this->View.GetMarks();
    const auto mark = marks.find(name);
    if (mark != marks.end())
    {
      const ImVec4& r = mark->second;
      if (r.x == before.x && r.y == before.y && r.z == before.z && r.w == before.w)
      {
        at = ImVec2(std::floor(r.x + float(fx) * (r.z - r.x)), std::floor(r.y + float(fy) * (r.w - r.y)));
        return true;
      }
      before = r;
    }
    this->Draw();
  }
  error = "there is no " + name + " on the screen";
  return false;
}

void ScriptRunner::MoveTo(const ImVec2& to, bool slowly)
{
  const ImVec2 from = this->Mouse;
  const int steps = slowly ? 6 : 1;
  for (int i = 1; i <= steps; ++i)
  {
    WindowEvent e;
    e.X = std::floor(double(from.x) + (double(to.x) - double(from.x)) * i / steps);
    e.Y = std::floor(double(from.y) + (double(to.y) - double(from.y)) * i / steps);
    e.Control = this->Control;
    e.Shift = this->Shift;
    e.Alt = this->Alt;
    this->Win.Send(e);
    this->Draw();
  }
  this->Mouse = to;
}

bool ScriptRunner::Do(const std::string& text, std::string& error)
{
  Script one;
  if (!one.Parse(text, "script", error))
  {
    return false;
  }
  for (const Script::Line& l : one.Lines)
  {
    if (!this->Do(l, error))
    {
      error = text + ": " + error;
      return false;
    }
  }
  return true;
}

bool ScriptRunner::Do(const Script::Line& line, std::string& error)
{
  const std::string& a = line.Action;
  const std::vector<std::string>& w = line.Words;
  this->Control = a != "type" && Has(w, "ctrl");
  this->Shift = a != "type" && Has(w, "shift");
  this->Alt = a != "type" && Has(w, "alt");
  WindowEvent e;
  e.Control = this->Control;
  e.Shift = this->Shift;
  e.Alt = this->Alt;
  const auto button = [&](int b, bool down)
  {
    WindowEvent press = e;
    press.What = WindowEvent::Kind::Button;
    press.Button = b;
    press.Down = down;
    press.X = double(this->Mouse.x);
    press.Y = double(this->Mouse.y);
    this->Win.Send(press);
    this->Draw();
  };
  ImVec2 at, to;
  if (a == "move")
  {
    if (!this->Find(w[0], at, error))
    {
      return false;
    }
    this->MoveTo(at, false);
    this->Draw();
  }
  else if (a == "click")
  {
    if (!this->Find(w[0], at, error))
    {
      return false;
    }
    this->MoveTo(at, false);
    this->Draw();
    for (int i = 0; i < (Has(w, "double") ? 2 : 1); ++i)
    {
      button(ButtonNamed(w), true);
      button(ButtonNamed(w), false);
    }
    this->Draw();
    this->Draw();
  }
  else if (a == "drag")
  {
    if (!this->Find(w[0], at, error))
    {
      return false;
    }
    this->MoveTo(at, false);
    this->Draw();
    button(ButtonNamed(w), true);
    if (!this->Find(w[1], to, error))
    {
      button(ButtonNamed(w), false);
      return false;
    }
    this->MoveTo(to, true);
    this->Draw();
    button(ButtonNamed(w), false);
    this->Draw();
  }
  else if (a == "press" || a == "release")
  {
    button(ButtonNamed(w), a == "press");
  }
  else if (a == "wheel")
  {
    double n = 0;
    if (!this->Find(w[0], at, error) || !Number(w[1], n))
    {
      return false;
    }
    this->MoveTo(at, false);
    this->Draw();
    e.What = WindowEvent::Kind::Wheel;
    e.Amount = n;
    e.X = double(at.x);
    e.Y = double(at.y);
    this->Win.Send(e);
    this->Draw();
  }
  else if (a == "key")
  {
    e.What = WindowEvent::Kind::Key;
    e.Sym = w[0];
    e.X = double(this->Mouse.x);
    e.Y = double(this->Mouse.y);
    e.Down = true;
    this->Win.Send(e);
    this->Draw();
    e.Down = false;
    this->Win.Send(e);
    this->Draw();
    this->Draw();
  }
  else if (a == "type")
  {
    for (std::size_t i = 0; i < line.Rest.size(); ++i)
    {
      // The script is UTF-8; VTK's keys are of one byte, Latin-1.
      unsigned int c = static_cast<unsigned char>(line.Rest[i]);
      if ((c == 0xC2 || c == 0xC3) && i + 1 < line.Rest.size())
      {
        c = ((c & 3u) << 6) | (static_cast<unsigned char>(line.Rest[++i]) & 0x3Fu);
      }
      else if (c >= 0x80)
      {
        error = "a keyboard event holds a character up to U+00FF";
        return false;
      }
      e.What = WindowEvent::Kind::Text;
      e.Character = c;
      e.Sym = std::string(1, char(c));
      e.X = double(this->Mouse.x);
      e.Y = double(this->Mouse.y);
      this->Win.Send(e);
      this->Draw();
    }
    this->Draw();
  }
  else if (a == "drop")
  {
    e.What = WindowEvent::Kind::Drop;
    const std::filesystem::path file = line.Rest;
    e.Files = { file.is_absolute() || this->Text.Directory.empty()
                  ? file.string()
                  : (std::filesystem::path(this->Text.Directory) / file).string() };
    this->Win.Send(e);
    this->Draw();
  }
  else if (a == "wait")
  {
    if (!this->Settle())
    {
      error = "the viewer does not come to rest";
      return false;
    }
  }
  else if (a == "frames")
  {
    for (int i = std::atoi(w[0].c_str()); i > 0; --i)
    {
      this->Draw();
    }
  }
  else if (a == "screenshot")
  {
    this->Draw();
    this->Win.Screenshot(line.Rest);
  }
  return true;
}

bool ScriptRunner::Run(std::string& error)
{
  this->Draw();
  this->Draw();
  for (const Script::Line& line : this->Text.Lines)
  {
    if (!this->Do(line, error))
    {
      error = this->Text.Name + ":" + std::to_string(line.Number) + ": " + line.Action + " " + line.Rest + ": " + error;
      return false;
    }
  }
  return true;
}

Recorder::Recorder(const std::string& file)
{
  if (!file.empty())
  {
    this->File = std::fopen(file.c_str(), "w");
    if (!this->File)
    {
      throw StageError("cannot write " + file);
    }
  }
}

Recorder::~Recorder()
{
  if (this->File)
  {
    std::fclose(this->File);
  }
}

void Recorder::Take(const WindowEvent& e, const Window& window)
{
  if (!this->File)
  {
    return;
  }
  if (!this->Begun)
  {
    std::fprintf(this->File, "size %d %d\nwait\n", window.Width(), window.Height());
    this->Begun = true;
  }
  static const char* const buttons[] = { "left", "right", "middle" };
  const std::string modifiers =
    std::string(e.Control ? " ctrl" : "") + (e.Shift ? " shift" : "") + (e.Alt ? " alt" : "");
  const auto place = [&]
  {
    if (e.X != this->X || e.Y != this->Y)
    {
      std::fprintf(this->File, "move %.0f,%.0f%s\n", e.X, e.Y, modifiers.c_str());
      this->X = e.X;
      this->Y = e.Y;
    }
  };
  switch (e.What)
  {
    case WindowEvent::Kind::Move:
      place();
      break;
    case WindowEvent::Kind::Button:
      place();
      std::fprintf(this->File, "%s %s%s\n", e.Down ? "press" : "release", buttons[e.Button], modifiers.c_str());
      if (!e.Down)
      {
        std::fputs("wait\n", this->File); // what a click started is over when the next one comes
      }
      break;
    case WindowEvent::Kind::Wheel:
      std::fprintf(this->File, "wheel %.0f,%.0f %.0f%s\n", e.X, e.Y, e.Amount, modifiers.c_str());
      break;
    case WindowEvent::Kind::Key:
      if (e.Down && (e.Sym.size() > 1 || e.Control || e.Alt) && e.Sym.find("Control") == std::string::npos &&
          e.Sym.find("Shift") == std::string::npos && e.Sym.find("Alt") == std::string::npos)
      {
        std::fprintf(this->File, "key %s%s\n", e.Sym.c_str(), modifiers.c_str());
      }
      break;
    case WindowEvent::Kind::Text:
      if (e.Character != ' ')
      {
        if (e.Character < 0x80)
        {
          std::fprintf(this->File, "type %c\n", char(e.Character));
        }
        else
        {
          std::fprintf(
            this->File, "type %c%c\n", char(0xC0 | ((e.Character >> 6) & 3)), char(0x80 | (e.Character & 0x3F)));
        }
      }
      break;
    case WindowEvent::Kind::Drop:
      for (const std::string& f : e.Files)
      {
        std::fprintf(this->File, "drop %s\n", f.c_str());
      }
      break;
  }
}
}
