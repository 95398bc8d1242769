// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellImageFile.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace quell
{
namespace
{
struct Statistics
{
  std::int64_t Pixels = 0, NaN = 0, Infinite = 0, Negative = 0;
  double Minimum = std::numeric_limits<double>::infinity(), Maximum = -Minimum, Mean = 0; ///< of finite values
  std::vector<std::string> Contract; ///< what the array's kind promises and these pixels do not keep
};

void Break(Statistics& s, std::int64_t count, const char* what)
{
  if (count > 0)
  {
    s.Contract.push_back(std::to_string(count) + " of " + std::to_string(s.Pixels) + " pixels " + what);
  }
}

Statistics Measure(const float* data, std::int64_t pixels, int components, ArrayKind kind)
{
  Statistics s;
  s.Pixels = pixels;
  double sum = 0;
  std::int64_t finite = 0, above = 0, longNormals = 0, notWhole = 0;
  for (std::int64_t i = 0; i < pixels; ++i)
  {
    bool nan = false, infinite = false, negative = false, big = false, fraction = false;
    double square = 0;
    for (int c = 0; c < components; ++c)
    {
      const double v = double(data[i * components + c]);
      nan = nan || std::isnan(v);
      infinite = infinite || std::isinf(v);
      negative = negative || v < 0;
      big = big || v > 1.0001;
      fraction = fraction || (std::isfinite(v) && v != std::floor(v));
      square += v * v;
      if (std::isfinite(v))
      {
        ++finite;
        sum += v;
        s.Minimum = std::min(s.Minimum, v);
        s.Maximum = std::max(s.Maximum, v);
      }
    }
    s.NaN += nan;
    s.Infinite += infinite;
    s.Negative += negative;
    above += big;
    notWhole += fraction;
    longNormals += square > 0 && std::abs(std::sqrt(square) - 1) > 0.01;
  }
  s.Mean = finite ? sum / double(finite) : 0;
  Break(s, s.NaN, "are not a number");
  const bool mayBeInfinite = kind == ArrayKind::Depth || kind == ArrayKind::Scalar;
  Break(s, mayBeInfinite ? 0 : s.Infinite, "are infinite");
  const bool maySign = kind == ArrayKind::Normal || kind == ArrayKind::Position || kind == ArrayKind::Motion ||
                       kind == ArrayKind::Any || kind == ArrayKind::Scalar;
  Break(s, maySign ? 0 : s.Negative, "are negative");
  Break(s, kind == ArrayKind::Albedo || kind == ArrayKind::Display ? above : 0, "are above 1");
  Break(s, kind == ArrayKind::Normal ? longNormals : 0, "are neither unit normals nor 0");
  Break(s, kind == ArrayKind::Id ? notWhole : 0, "are no whole numbers");
  return s;
}

std::string Joined(const std::vector<std::string>& names)
{
  std::string text;
  for (const std::string& n : names)
  {
    text += (text.empty() ? "" : " ") + n;
  }
  return text;
}
}

int InspectCommand(const std::string& file, bool asJson)
{
  ReadReport report;
  const vtkSmartPointer<vtkImageData> image = ReadImageFile(file, &report);
  nlohmann::json out = { { "file", file }, { "format", report.Format }, { "width", report.Width },
    { "height", report.Height } };
  const Rect& w = report.DataWindow;
  out["dataWindow"] = { w.x0, report.Height - w.y1, w.x1, report.Height - w.y0 };
  out["arrays"] = nlohmann::json::array();
  std::string text = file + ": " + report.Format + ", " + std::to_string(report.Width) + " x " +
                     std::to_string(report.Height) + " pixels";
  if (w != Rect{ 0, 0, report.Width, report.Height })
  {
    text += ", holds " + std::to_string(w.x0) + "," + std::to_string(report.Height - w.y1) + "," +
            std::to_string(w.x1) + "," + std::to_string(report.Height - w.y0);
  }
  text += "\n";
  for (const FileArray& a : report.Arrays)
  {
    vtkFloatArray* array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(a.Name.c_str()));
    if (!array)
    {
      continue;
    }
    const Statistics s =
      Measure(array->GetPointer(0), std::int64_t(array->GetNumberOfTuples()), array->GetNumberOfComponents(), a.Kind);
    const bool any = s.Minimum <= s.Maximum;
    char range[128] = "no finite value";
    if (any)
    {
      std::snprintf(range, sizeof range, "%.6g to %.6g, mean %.6g", s.Minimum, s.Maximum, s.Mean);
    }
    text += "  " + a.Name + ": " + KindName(a.Kind) + ", " + a.Type + " [" + Joined(a.Channels) + "], " + range;
    if (s.NaN > 0 || s.Infinite > 0)
    {
      text += ", " + std::to_string(s.NaN) + " NaN and " + std::to_string(s.Infinite) + " infinite pixels";
    }
    text += "\n";
    for (const std::string& line : s.Contract)
    {
      text += "    against its contract: " + line + "\n";
    }
    nlohmann::json entry = { { "name", a.Name }, { "kind", KindName(a.Kind) }, { "type", a.Type },
      { "channels", a.Channels }, { "nan", s.NaN }, { "infinite", s.Infinite }, { "negative", s.Negative },
      { "contract", s.Contract } };
    if (any)
    {
      entry["minimum"] = s.Minimum;
      entry["maximum"] = s.Maximum;
      entry["mean"] = s.Mean;
    }
    out["arrays"].push_back(entry);
  }
  out["metadata"] = report.Metadata;
  for (const auto& m : report.Metadata)
  {
    const std::size_t lines = std::size_t(std::count(m.second.begin(), m.second.end(), '\n'));
    text += "  quell:" + m.first + " = " +
            (lines > 1 || m.second.size() > 100 ? std::to_string(m.second.size()) + " characters" : m.second) + "\n";
  }
  for (const std::string& warning : report.Warnings)
  {
    std::fprintf(stderr, "quell: warning: %s: %s\n", file.c_str(), warning.c_str());
  }
  std::fputs((asJson ? out.dump(2) + "\n" : text).c_str(), stdout);
  return ExitDone;
}
}
