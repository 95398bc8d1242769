// SPDX-License-Identifier: BSD-3-Clause
#include "quellTradeoffReport.h"

#include "quellImageFile.h"
#include "quellJsonText.h"
#include "quellMetrics.h"
#include "quellXmlDocument.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
std::string Number(double v, int digits = 4)
{
  if (!std::isfinite(v))
  {
    return "";
  }
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, v);
  return text;
}

/// Milliseconds and the like: three digits, no exponent.
std::string Plain(double v)
{
  if (!std::isfinite(v))
  {
    return "";
  }
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", v >= 100 ? 0 : v >= 10 ? 1 : v >= 1 ? 2 : 3, v);
  return text;
}

double Value(const SettingResult& s, const std::string& metric)
{
  const auto at = s.Metrics.find(metric);
  return at == s.Metrics.end() ? std::numeric_limits<double>::quiet_NaN() : at->second.Mean;
}
double Error(const SettingResult& s, const std::string& metric)
{
  const auto at = s.Metrics.find(metric);
  return at == s.Metrics.end() ? std::numeric_limits<double>::quiet_NaN() : at->second.StandardError;
}

std::string Csv(const std::string& text)
{
  if (text.find_first_of(",\"\n\r") == std::string::npos)
  {
    return text;
  }
  std::string out = "\"";
  for (char c : text)
  {
    out += c == '"' ? std::string("\"\"") : std::string(1, c);
  }
  return out + "\"";
}

/// What may stand between tags and in attributes.
std::string Html(const std::string& text)
{
  return EscapeXml(text);
}

std::string Name(const SettingResult& s)
{
  return s.Left.empty() ? ChoiceText(s.Choice) : "without " + s.Left;
}

std::vector<std::string> NodesOf(const TradeoffReport& report)
{
  std::vector<std::string> nodes = report.NodeOrder;
  for (const auto* list : { &report.Settings, &report.Ledger })
  {
    for (const SettingResult& s : *list)
    {
      for (const auto& n : s.Nodes)
      {
        if (std::find(nodes.begin(), nodes.end(), n.first) == nodes.end())
        {
          nodes.push_back(n.first);
        }
      }
    }
  }
  return nodes;
}

/// Pareto settings from the fastest on.
std::vector<const SettingResult*> ParetoOf(const TradeoffReport& report)
{
  std::vector<const SettingResult*> set;
  for (const SettingResult& s : report.Settings)
  {
    if (s.Pareto)
    {
      set.push_back(&s);
    }
  }
  std::sort(set.begin(), set.end(),
    [](const SettingResult* a, const SettingResult* b) { return a->Milliseconds.Middle < b->Milliseconds.Middle; });
  return set;
}

/// What a node bought: the error that there is without it, less the one with it; and the time that the filters take
/// less without it (what a source takes is noise of many times that).
struct Bought
{
  double Error = 0, Milliseconds = 0;
  double PerMillisecond() const
  {
    return this->Milliseconds > 0 ? this->Error / this->Milliseconds : std::numeric_limits<double>::quiet_NaN();
  }
};
Bought BoughtBy(const TradeoffReport& report, const SettingResult& row)
{
  const SettingResult& base = report.Settings[std::size_t(report.LedgerOf)];
  const std::string& m = report.Metrics.front();
  const double sign = HigherIsBetter(m) ? -1 : 1;
  return { sign * (Value(row, m) - Value(base, m)), base.FilterMilliseconds.Middle - row.FilterMilliseconds.Middle };
}

std::string Base64(const std::string& bytes)
{
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3)
  {
    unsigned v = 0;
    for (std::size_t k = 0; k < 3; ++k)
    {
      v = v << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (std::size_t k = 0; k < 4; ++k)
    {
      out += i + k > bytes.size() ? '=' : digits[v >> (18 - 6 * k) & 63];
    }
  }
  return out;
}

/// The picture at most `width` wide (a box filter on linear values), as a data URI; empty where it cannot be read.
std::string Thumbnail(const std::string& file, const std::string& array, const std::string& directory, int width)
{
  try
  {
    ReadOptions options;
    options.Arrays = { array };
    options.PlainArray = array;
    const auto image = ReadImageFile(file, nullptr, options);
    auto pixels = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array.c_str()));
    int e[6];
    image->GetExtent(e);
    const int w = e[1] - e[0] + 1, h = e[3] - e[2] + 1, n = pixels->GetNumberOfComponents();
    const int step = std::max(1, (w + width - 1) / width), ow = std::max(1, w / step), oh = std::max(1, h / step);
    vtkNew<vtkImageData> small;
    small->SetExtent(0, ow - 1, 0, oh - 1, 0, 0);
    vtkNew<vtkFloatArray> out;
    out->SetName("radiance");
    out->SetNumberOfComponents(3);
    out->SetNumberOfTuples(vtkIdType(ow) * oh);
    for (int y = 0; y < oh; ++y)
    {
      for (int x = 0; x < ow; ++x)
      {
        for (int c = 0; c < 3; ++c)
        {
          double sum = 0;
          int count = 0;
          for (int j = y * step; j < std::min(h, (y + 1) * step); ++j)
          {
            for (int i = x * step; i < std::min(w, (x + 1) * step); ++i)
            {
              const float v = pixels->GetPointer(
                0)[(std::size_t(j) * std::size_t(w) + std::size_t(i)) * std::size_t(n) + std::size_t(n >= 3 ? c : 0)];
              sum += std::isfinite(v) ? double(std::min(1.f, v)) : 0.;
              ++count;
            }
          }
          out->GetPointer(0)[3 * (std::size_t(y) * std::size_t(ow) + std::size_t(x)) + std::size_t(c)] =
            float(sum / std::max(1, count));
        }
      }
    }
    small->GetPointData()->AddArray(out);
    const std::string place = (fs::path(directory) / "state" / "thumbnail.png").string();
    WriteImageFile(place, small);
    std::ifstream stream(place, std::ios::binary);
    const std::string bytes{ std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>() };
    stream.close();
    std::error_code ec;
    fs::remove(place, ec);
    return "data:image/png;base64," + Base64(bytes);
  }
  catch (const std::exception&)
  {
    return std::string();
  }
}

/// A logarithmic axis with ticks at 1, 2 and 5.
struct LogAxis
{
  double Low = 1, High = 10;
  double From = 0, To = 1; ///< where the ends are drawn

  void Fit(const std::vector<double>& values)
  {
    this->Low = *std::min_element(values.begin(), values.end());
    this->High = *std::max_element(values.begin(), values.end());
    const double margin = std::max(1.15, std::pow(this->High / this->Low, 0.06));
    this->Low /= margin;
    this->High *= margin;
  }
  double At(double v) const
  {
    return this->From + (std::log(v / this->Low) / std::log(this->High / this->Low)) * (this->To - this->From);
  }
  std::vector<double> Ticks() const
  {
    std::vector<double> ticks;
    const bool wide = this->High / this->Low > 300;
    for (int decade = int(std::floor(std::log10(this->Low))); decade <= int(std::ceil(std::log10(this->High)));
         ++decade)
    {
      for (double m : { 1., 1.5, 2., 3., 5., 7. })
      {
        const double v = m * std::pow(10., decade);
        const bool fine = this->High / this->Low < 6;
        if (v >= this->Low && v <= this->High && (m == 1 || (!wide && (m == 2 || m == 5)) || fine))
        {
          ticks.push_back(v);
        }
      }
    }
    return ticks;
  }
};

std::string TickText(double v)
{
  char text[40];
  std::snprintf(text, sizeof text, v >= 1000 && v < 1e7 ? "%.0f" : "%.3g", v);
  return text;
}

std::string F(double v)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", v);
  return text;
}

std::string Plot(const TradeoffReport& report)
{
  const std::string& metric = report.Metrics.front();
  const bool higher = HigherIsBetter(metric);
  std::vector<const SettingResult*> shown;
  std::vector<double> xs, ys;
  for (const SettingResult& s : report.Settings)
  {
    const double v = Value(s, metric);
    if (s.Runs > 0 && s.Error.empty() && std::isfinite(v) && v > 0 && s.Milliseconds.Middle > 0)
    {
      shown.push_back(&s);
      xs.push_back(s.Milliseconds.Middle);
      ys.push_back(v);
    }
  }
  if (shown.empty())
  {
    return "<p>Nothing was measured.</p>\n";
  }
  LogAxis x, y;
  x.Fit(xs);
  y.Fit(ys);
  const double w = 860, h = 470;
  x.From = 76;
  x.To = w - 16;
  y.From = h - 52;
  y.To = 14;
  std::string out = "<svg viewBox=\"0 0 860 470\" role=\"img\" aria-label=\"error over time\">\n";
  for (double t : x.Ticks())
  {
    const std::string at = F(x.At(t));
    out += "<line class=\"grid\" x1=\"" + at + "\" x2=\"" + at + "\" y1=\"14\" y2=\"" + F(y.From) + "\"/><text x=\"" +
           at + "\" y=\"" + F(y.From + 18) + "\" class=\"tick\">" + TickText(t) + "</text>\n";
  }
  for (double t : y.Ticks())
  {
    const std::string at = F(y.At(t));
    out += "<line class=\"grid\" x1=\"76\" x2=\"" + F(x.To) + "\" y1=\"" + at + "\" y2=\"" + at +
           "\"/><text x=\"70\" y=\"" + F(y.At(t) + 4) + "\" class=\"tick end\">" + TickText(t) + "</text>\n";
  }
  out += "<text x=\"" + F((x.From + x.To) / 2) + "\" y=\"" + F(h - 10) +
         "\" class=\"tick\">milliseconds a frame (median)</text>\n<text transform=\"translate(16 " +
         F((y.From + y.To) / 2) + ") rotate(-90)\" class=\"tick\">" + Html(metric) +
         (higher ? ", higher is better" : ", lower is better") + "</text>\n";
  std::string line;
  const std::vector<const SettingResult*> set = ParetoOf(report);
  for (const SettingResult* s : set)
  {
    line += (line.empty() ? "" : " ") + F(x.At(s->Milliseconds.Middle)) + "," + F(y.At(Value(*s, metric)));
  }
  out += "<polyline class=\"front\" points=\"" + line + "\"/>\n";
  for (const SettingResult* s : shown)
  {
    const double v = Value(*s, metric), e = Error(*s, metric), px = x.At(s->Milliseconds.Middle), py = y.At(v);
    if (std::isfinite(e) && v - e > 0)
    {
      out += "<line class=\"bar\" x1=\"" + F(px) + "\" x2=\"" + F(px) + "\" y1=\"" + F(y.At(v - e)) + "\" y2=\"" +
             F(y.At(v + e)) + "\"/>";
    }
    out += "<line class=\"bar\" x1=\"" + F(x.At(std::max(s->Milliseconds.Low, x.Low))) + "\" x2=\"" +
           F(x.At(std::min(s->Milliseconds.High, x.High))) + "\" y1=\"" + F(py) + "\" y2=\"" + F(py) + "\"/>";
    const bool chosen = report.Chosen >= 0 && s == &report.Settings[std::size_t(report.Chosen)];
    out += "<circle class=\"" +
           std::string(chosen      ? "chosen"
                       : s->Pareto ? "pareto"
                                   : "dot") +
           "\" cx=\"" + F(px) + "\" cy=\"" + F(py) + "\" r=\"" +
           (chosen       ? "7"
             : s->Pareto ? "5"
                         : "4") +
           "\"><title>" + Html(Name(*s)) + "\n" + Plain(s->Milliseconds.Middle) + " ms, " + Html(metric) + " " +
           Number(v) + "</title></circle>\n";
    if (s->Pareto)
    {
      // Numbers as in the table of the Pareto set.
      const auto number = std::find(set.begin(), set.end(), s) - set.begin() + 1;
      out +=
        "<text class=\"label\" x=\"" + F(px + 8) + "\" y=\"" + F(py - 7) + "\">" + std::to_string(number) + "</text>\n";
    }
  }
  return out + "</svg>\n";
}

/// Bias and variance of the Pareto set as stacked bars.
std::string Split(const TradeoffReport& report)
{
  std::vector<const SettingResult*> set;
  double largest = 0;
  for (const SettingResult* s : ParetoOf(report))
  {
    if (std::isfinite(s->Variance))
    {
      set.push_back(s);
      largest = std::max(largest, std::max(0., s->BiasSquared) + s->Variance);
    }
  }
  if (set.empty() || !(largest > 0))
  {
    return std::string();
  }
  std::string out = "<h2>Bias and variance</h2>\n<p>relMSE of the last frame over " + std::to_string(report.Seeds) +
                    " seeds: what stays whatever the seed (bias squared, the reference's own noise in it) and what "
                    "differs from seed to seed (variance).</p>\n<table class=\"split\">\n";
  int number = 0;
  for (const SettingResult* s : ParetoOf(report))
  {
    ++number;
    if (!std::isfinite(s->Variance))
    {
      continue;
    }
    const double b = std::max(0., s->BiasSquared);
    out += "<tr><td class=\"num\">" + std::to_string(number) + "</td><td>" + Html(Name(*s)) +
           "</td><td><span class=\"bias\" style=\"width:" + F(300 * b / largest) +
           "px\"></span><span class=\"variance\" style=\"width:" + F(300 * s->Variance / largest) +
           "px\"></span></td><td class=\"num\">" + Number(s->BiasSquared, 3) + "</td><td class=\"num\">" +
           Number(s->Variance, 3) + "</td></tr>\n";
  }
  return out + "</table>\n<p class=\"key\"><span class=\"bias\" style=\"width:14px\"></span> bias squared <span "
               "class=\"variance\" style=\"width:14px\"></span> variance</p>\n";
}

std::string Cell(const SettingResult& s, const std::string& metric)
{
  const double e = Error(s, metric);
  return Number(Value(s, metric)) + (std::isfinite(e) ? " <small>&plusmn; " + Number(e, 2) + "</small>" : "");
}

std::string Table(const TradeoffReport& report)
{
  std::string out = "<h2>All settings</h2>\n<table class=\"sortable\"><thead><tr>";
  std::vector<std::string> axes;
  if (!report.Settings.empty())
  {
    for (const auto& c : report.Settings.front().Choice)
    {
      axes.push_back(c.first);
    }
  }
  if (axes.empty())
  {
    out += "<th>setting</th>";
  }
  for (const std::string& a : axes)
  {
    out += "<th>" + Html(a) + "</th>";
  }
  out += "<th>ms</th><th>ms of filters</th>";
  for (const std::string& m : report.Metrics)
  {
    out += "<th>" + Html(m) + "</th>";
  }
  out += "<th>bias&sup2;</th><th>variance</th><th>Pareto</th></tr></thead><tbody>\n";
  const auto set = ParetoOf(report);
  for (std::size_t i = 0; i < report.Settings.size(); ++i)
  {
    const SettingResult& s = report.Settings[i];
    out += int(i) == report.Chosen ? "<tr class=\"chosen\">" : s.Pareto ? "<tr class=\"pareto\">" : "<tr>";
    if (axes.empty())
    {
      out += "<td>as in the file</td>";
    }
    for (const auto& c : s.Choice)
    {
      out += "<td>" + Html(c.second) + "</td>";
    }
    if (!s.Error.empty() || s.Runs == 0)
    {
      out += "<td colspan=\"" + std::to_string(5 + report.Metrics.size()) + "\">" +
             Html(s.Error.empty() ? "not run" : s.Error) + "</td></tr>\n";
      continue;
    }
    out += "<td class=\"num\">" + Plain(s.Milliseconds.Middle) + " <small>" + Plain(s.Milliseconds.Low) + " to " +
           Plain(s.Milliseconds.High) + "</small></td><td class=\"num\">" + Plain(s.FilterMilliseconds.Middle) +
           "</td>";
    for (const std::string& m : report.Metrics)
    {
      out += "<td class=\"num\">" + Cell(s, m) + "</td>";
    }
    const auto at = std::find(set.begin(), set.end(), &s);
    out += "<td class=\"num\">" + Number(s.BiasSquared, 3) + "</td><td class=\"num\">" + Number(s.Variance, 3) +
           "</td><td class=\"num\">" + (s.Pareto ? std::to_string(at - set.begin() + 1) : std::string()) +
           "</td></tr>\n";
  }
  return out + "</tbody></table>\n";
}

std::string LedgerTable(const TradeoffReport& report)
{
  if (report.Ledger.empty() || report.Settings.empty())
  {
    return std::string();
  }
  const std::string& m = report.Metrics.front();
  const SettingResult& base = report.Settings[std::size_t(report.LedgerOf)];
  std::string out =
    "<h2>What each node bought</h2>\n<p>Setting: " + Html(Name(base)) + " (" + Plain(base.Milliseconds.Middle) +
    " ms, " + Html(m) + " " + Number(Value(base, m)) +
    "). Each row leaves one node out: whoever read it reads what it read. The time is what all filters together "
    "take less then; a node that belongs to another one (demodulate and modulate) buys nothing alone.</p>\n<table "
    "class=\"sortable\"><thead><tr><th>left "
    "out</th><th>" +
    Html(m) +
    " without it</th><th>error removed</th><th>its own ms</th><th>ms saved without it</th><th>error "
    "removed per ms</th></tr></thead><tbody>\n";
  for (const SettingResult& row : report.Ledger)
  {
    out += "<tr><td>" + Html(row.Left) + "</td>";
    if (!row.Error.empty() || row.Runs == 0)
    {
      out += "<td colspan=\"5\">" + Html(row.Error.empty() ? "not run" : row.Error) + "</td></tr>\n";
      continue;
    }
    const Bought b = BoughtBy(report, row);
    const auto own = base.Nodes.find(row.Left);
    out += "<td class=\"num\">" + Cell(row, m) + "</td><td class=\"num" + (b.Error < 0 ? " worse" : "") + "\">" +
           Number(b.Error, 3) + "</td><td class=\"num\">" +
           (own == base.Nodes.end() ? std::string() : Plain(own->second.Middle)) + "</td><td class=\"num\">" +
           Plain(b.Milliseconds) + "</td><td class=\"num\">" + Number(b.PerMillisecond(), 3) + "</td></tr>\n";
  }
  return out + "</tbody></table>\n";
}

std::string Pictures(const TradeoffReport& report, const std::string& directory)
{
  std::string out = "<h2>Pictures</h2>\n<div class=\"pictures\">\n";
  const auto add = [&](const std::string& uri, const std::string& caption)
  {
    if (!uri.empty())
    {
      out += "<figure><img alt=\"" + Html(caption) + "\" src=\"" + uri + "\"/><figcaption>" + Html(caption) +
             "</figcaption></figure>\n";
    }
  };
  add(Thumbnail(SequencePath(report.Reference, report.EndFrame - 1), "radiance", directory, 320), "reference");
  std::vector<const SettingResult*> set = ParetoOf(report);
  const std::size_t most = 11;
  for (std::size_t i = 0; i < set.size(); ++i)
  {
    // Of a long front the ends and an even choice between them.
    const bool kept = set.size() <= most ||
                      i * (most - 1) / (set.size() - 1) != (i + 1) * (most - 1) / (set.size() - 1) ||
                      i + 1 == set.size();
    if (kept && !set[i]->Picture.empty())
    {
      add(Thumbnail((fs::path(directory) / set[i]->Picture).string(), "radiance", directory, 320),
        std::to_string(i + 1) + ": " + Plain(set[i]->Milliseconds.Middle) + " ms, " + report.Metrics.front() + " " +
          Number(Value(*set[i], report.Metrics.front()), 3));
    }
  }
  return out + "</div>\n";
}

const char* const Style = R"css(
:root{color-scheme:light dark;--ink:#1b1f24;--soft:#57606a;--line:#d0d7de;--paper:#fff;--front:#b35900;--dot:#5b7fa6;--mark:#fff3df}
@media (prefers-color-scheme:dark){:root{--ink:#e6edf3;--soft:#9aa4af;--line:#30363d;--paper:#0d1117;--front:#f0883e;--dot:#79a8d8;--mark:#3a2a12}}
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:1120px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin:0 0 .2em}h2{font-size:1.15em;margin:2em 0 .4em}p{margin:.4em 0;max-width:75ch}
.facts{color:var(--soft)}small{color:var(--soft)}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;font-size:.9em}
th,td{padding:.25em .7em;border-bottom:1px solid var(--line);text-align:left;vertical-align:top}
th{color:var(--soft);font-weight:600}.sortable th{cursor:pointer}td.num{text-align:right;white-space:nowrap}
tr.pareto td:first-child{border-left:3px solid var(--front)}tr.chosen td{background:var(--mark)}.worse{color:#c2352b}
svg{width:100%;height:auto}.grid{stroke:var(--line)}.tick{font-size:12px;fill:var(--soft);text-anchor:middle}.tick.end{text-anchor:end}
.front{fill:none;stroke:var(--front);stroke-width:1.5;stroke-dasharray:5 4}.bar{stroke:var(--soft);stroke-width:1;opacity:.6}
.dot{fill:var(--dot);opacity:.65}.pareto{fill:var(--front)}.label{font-size:12px;fill:var(--ink)}circle.chosen{fill:var(--front);stroke:var(--ink);stroke-width:2}
.bias,.variance{display:inline-block;height:12px;vertical-align:middle}.bias{background:var(--front)}.variance{background:var(--dot)}
.pictures{display:flex;flex-wrap:wrap;gap:1em}figure{margin:0}figure img{max-width:320px;display:block;image-rendering:auto}figcaption{font-size:.85em;color:var(--soft)}
.choice{border-left:4px solid var(--front);background:var(--mark);padding:.5em .9em}
)css";

const char* const Script = R"js(
document.querySelectorAll('table.sortable').forEach(t=>t.querySelectorAll('th').forEach((h,i)=>h.addEventListener('click',()=>{
const b=t.tBodies[0],up=h.dataset.up!=='1';t.querySelectorAll('th').forEach(o=>delete o.dataset.up);h.dataset.up=up?'1':'0';
const v=r=>{const s=(r.cells[i]||{}).textContent||'';const n=parseFloat(s);return isNaN(n)?s:n};
[...b.rows].sort((p,q)=>{const x=v(p),y=v(q);return (x<y?-1:x>y?1:0)*(up?1:-1)}).forEach(r=>b.append(r))})));
)js";
}

std::string TradeoffCsv(const TradeoffReport& report)
{
  std::vector<std::string> axes;
  if (!report.Settings.empty())
  {
    for (const auto& c : report.Settings.front().Choice)
    {
      axes.push_back(c.first);
    }
  }
  const std::vector<std::string> nodes = NodesOf(report);
  std::string out;
  for (const std::string& a : axes)
  {
    out += Csv(a) + ",";
  }
  out += "left out,runs,seeds,ms,ms low quartile,ms high quartile,ms of filters";
  for (const std::string& m : report.Metrics)
  {
    out += "," + Csv(m) + "," + Csv(m + " standard error");
  }
  out += ",bias squared,variance,Pareto,error";
  for (const std::string& n : nodes)
  {
    out += "," + Csv("ms of " + n);
  }
  out += "\r\n";
  const auto row = [&](const SettingResult& s)
  {
    for (const auto& c : s.Choice)
    {
      out += Csv(c.second) + ",";
    }
    out += Csv(s.Left) + "," + std::to_string(s.Runs) + "," + std::to_string(s.Seeds) + "," +
           Number(s.Milliseconds.Middle, 6) + "," + Number(s.Milliseconds.Low, 6) + "," +
           Number(s.Milliseconds.High, 6) + "," + Number(s.FilterMilliseconds.Middle, 6);
    for (const std::string& m : report.Metrics)
    {
      out += "," + Number(Value(s, m), 9) + "," + Number(Error(s, m), 6);
    }
    out +=
      "," + Number(s.BiasSquared, 9) + "," + Number(s.Variance, 9) + "," + (s.Pareto ? "1" : "0") + "," + Csv(s.Error);
    for (const std::string& n : nodes)
    {
      const auto at = s.Nodes.find(n);
      out += "," + (at == s.Nodes.end() ? std::string() : Number(at->second.Middle, 6));
    }
    out += "\r\n";
  };
  for (const SettingResult& s : report.Settings)
  {
    row(s);
  }
  for (const SettingResult& s : report.Ledger)
  {
    row(s);
  }
  return out;
}

std::string TradeoffJson(const TradeoffReport& report)
{
  using nlohmann::json;
  const auto number = [](double v) { return std::isfinite(v) ? json(v) : json(nullptr); };
  const auto spread = [&](const Spread& s) {
    return json{ { "median", number(s.Middle) }, { "low", number(s.Low) }, { "high", number(s.High) } };
  };
  const auto setting = [&](const SettingResult& s)
  {
    json out = { { "runs", s.Runs }, { "seeds", s.Seeds }, { "ms", spread(s.Milliseconds) },
      { "filterMs", spread(s.FilterMilliseconds) }, { "biasSquared", number(s.BiasSquared) },
      { "variance", number(s.Variance) }, { "pareto", s.Pareto }, { "picture", s.Picture } };
    out["choice"] = json::object();
    for (const auto& c : s.Choice)
    {
      out["choice"][c.first] = c.second;
    }
    out["metrics"] = json::object();
    for (const auto& m : s.Metrics)
    {
      out["metrics"][m.first] = { { "mean", number(m.second.Mean) },
        { "standardError", number(m.second.StandardError) } };
    }
    out["nodes"] = json::object();
    for (const auto& n : s.Nodes)
    {
      out["nodes"][n.first] = spread(n.second);
    }
    if (!s.Left.empty())
    {
      out["leftOut"] = s.Left;
    }
    if (!s.Error.empty())
    {
      out["error"] = s.Error;
    }
    return out;
  };
  json out = { { "pipeline", report.Pipeline }, { "reference", report.Reference }, { "output", report.Output },
    { "machine", report.Machine }, { "version", report.Version }, { "metrics", report.Metrics },
    { "frames", { report.FirstFrame, report.EndFrame } }, { "width", report.Width }, { "height", report.Height },
    { "firstSeed", report.FirstSeed }, { "seeds", report.Seeds }, { "rounds", report.Rounds },
    { "notes", report.Notes }, { "chosen", report.Chosen }, { "chosenBy", report.ChosenText },
    { "ledgerOf", report.LedgerOf } };
  out["settings"] = json::array();
  for (const SettingResult& s : report.Settings)
  {
    out["settings"].push_back(setting(s));
  }
  out["ledger"] = json::array();
  for (const SettingResult& s : report.Ledger)
  {
    json row = setting(s);
    if (s.Error.empty() && s.Runs > 0)
    {
      const Bought b = BoughtBy(report, s);
      row["errorRemoved"] = number(b.Error);
      row["msSaved"] = number(b.Milliseconds);
      row["errorRemovedPerMs"] = number(b.PerMillisecond());
    }
    out["ledger"].push_back(row);
  }
  return JsonText(out) + "\n";
}

std::string TradeoffHtml(const TradeoffReport& report, const std::string& directory)
{
  const std::string frames = report.EndFrame - report.FirstFrame == 1 ? "frame " + std::to_string(report.FirstFrame)
                                                                      : "frames " + std::to_string(report.FirstFrame) +
                                                                          " to " + std::to_string(report.EndFrame - 1);
  std::string out = "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
                    "content=\"width=device-width\"><title>Speed and accuracy of " +
                    Html(fs::path(report.Pipeline).filename().string()) + "</title>\n<style>" + Style +
                    "</style></head><body>\n";
  out += "<h1>Speed and accuracy of " + Html(fs::path(report.Pipeline).filename().string()) +
         "</h1>\n<p class=\"facts\">" + "output " + Html(report.Output) + ", " + frames + ", " +
         std::to_string(report.Width) + " &times; " + std::to_string(report.Height) + " pixels, against " +
         Html(fs::path(report.Reference).filename().string()) + "; " + std::to_string(report.Settings.size()) +
         (report.Settings.size() == 1 ? " setting, " : " settings, ") + std::to_string(report.Rounds) +
         " runs each with " + std::to_string(report.Seeds) + (report.Seeds == 1 ? " seed" : " seeds") + " (from " +
         std::to_string(report.FirstSeed) + ")<br>" + Html(report.Machine) +
         (report.Version.empty() ? "" : "; quell " + Html(report.Version)) + "</p>\n";
  for (const std::string& note : report.Notes)
  {
    out += "<p class=\"facts\">" + Html(note) + "</p>\n";
  }
  if (!report.ChosenText.empty())
  {
    out += "<p class=\"choice\">";
    if (report.Chosen >= 0)
    {
      const SettingResult& s = report.Settings[std::size_t(report.Chosen)];
      out += "<b>" + Html(Name(s)) + "</b>: " + Html(report.ChosenText) + " (" + Plain(s.Milliseconds.Middle) +
             " ms, " + Html(report.Metrics.front()) + " " + Number(Value(s, report.Metrics.front())) +
             "), written as best.xml";
    }
    else
    {
      out += Html(report.ChosenText);
    }
    out += "</p>\n";
  }
  out += "<h2>Error over time</h2>\n<p>Crosses: quartiles of the time, standard error of the error. The line joins the "
         "settings that no other one beats in both.</p>\n" +
         Plot(report) + Split(report) + LedgerTable(report) + Table(report) + Pictures(report, directory);
  return out + "<script>" + Script + "</script>\n</body></html>\n";
}

std::string TradeoffText(const TradeoffReport& report)
{
  const std::string& m = report.Metrics.front();
  std::string out;
  char line[256];
  const auto set = ParetoOf(report);
  out += "Pareto set (" + std::to_string(set.size()) + " of " + std::to_string(report.Settings.size()) + "):\n";
  for (std::size_t i = 0; i < set.size(); ++i)
  {
    std::snprintf(line, sizeof line, "  %2d  %9s ms  %s %-9s ", int(i + 1), Plain(set[i]->Milliseconds.Middle).c_str(),
      m.c_str(), Number(Value(*set[i], m)).c_str());
    out += line + Name(*set[i]) + "\n";
  }
  if (!report.Ledger.empty())
  {
    out += "what each node bought, of " + Name(report.Settings[std::size_t(report.LedgerOf)]) + ":\n";
    for (const SettingResult& row : report.Ledger)
    {
      if (!row.Error.empty() || row.Runs == 0)
      {
        out += "  " + row.Left + ": " + (row.Error.empty() ? "not run" : row.Error) + "\n";
        continue;
      }
      const Bought b = BoughtBy(report, row);
      std::snprintf(line, sizeof line, "  %-20s %s %+.3g, %s ms", row.Left.c_str(), m.c_str(), -b.Error,
        Plain(b.Milliseconds).c_str());
      out += line;
      out += b.Milliseconds > 0 ? ", " + Number(b.PerMillisecond(), 3) + " a ms\n" : "\n";
    }
  }
  if (!report.ChosenText.empty())
  {
    out +=
      (report.Chosen >= 0 ? "chosen: " + Name(report.Settings[std::size_t(report.Chosen)]) + ", " : std::string()) +
      report.ChosenText + "\n";
  }
  return out;
}
}
