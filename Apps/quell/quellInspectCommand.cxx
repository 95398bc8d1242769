// SPDX-License-Identifier: BSD-3-Clause
#include "quellCommands.h"
#include "quellDiagnostic.h"
#include "quellImageFile.h"
#include "quellImageGuard.h"
#include "quellJsonText.h"

#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
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

/// An array of the file as pixels; null where it has none of that name and width.
const float* Find(vtkImageData* image, const char* name, int components)
{
  auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name));
  return array && array->GetNumberOfComponents() == components ? array->GetPointer(0) : nullptr;
}

/// One promise between arrays, and how many pixels keep it.
struct Relation
{
  std::string What;
  std::int64_t Pixels = 0, Kept = 0;
  double Enough = 0.999; ///< part of the pixels; edges under jitter or a lens may break some

  bool Holds() const { return double(this->Kept) >= this->Enough * double(this->Pixels); }
  void Count(bool kept)
  {
    ++this->Pixels;
    this->Kept += kept;
  }
};

/// Layers that sum to others, as far as the file has them all: within 1e-4 of the sum of magnitudes, 2e-3 in half.
void CheckSums(vtkImageData* image, bool half, std::vector<Relation>& relations)
{
  static const std::vector<std::vector<const char*>> sums = { { "radiance", "emission", "direct", "indirect" },
    { "direct", "directDiffuse", "directSpecular" }, { "indirect", "indirectDiffuse", "indirectSpecular" },
    { "albedo", "albedoDiffuse", "albedoSpecular" } };
  const std::int64_t pixels = image->GetNumberOfPoints();
  for (const auto& names : sums)
  {
    std::vector<const float*> arrays;
    Relation r;
    for (const char* name : names)
    {
      arrays.push_back(Find(image, name, 3));
      r.What += (arrays.size() == 1 ? "" : arrays.size() == 2 ? " = " : " + ") + std::string(name);
    }
    if (std::find(arrays.begin(), arrays.end(), nullptr) != arrays.end())
    {
      continue;
    }
    for (std::int64_t p = 0; p < pixels; ++p)
    {
      bool kept = true;
      for (int c = 0; c < 3; ++c)
      {
        double sum = 0, size = std::fabs(double(arrays[0][3 * p + c]));
        for (std::size_t k = 1; k < arrays.size(); ++k)
        {
          sum += double(arrays[k][3 * p + c]);
          size += std::fabs(double(arrays[k][3 * p + c]));
        }
        kept = kept && std::fabs(sum - double(arrays[0][3 * p + c])) <= (half ? 2e-3 : 1e-4) * size + 1e-6;
      }
      r.Count(kept);
    }
    relations.push_back(r);
  }
}

/// Where `m` puts a position, in pixels of the frame; false behind the camera.
bool Project(const Mat4& m, const float* position, int width, int height, double* pixel)
{
  double c[4];
  for (int i : { 0, 1, 3 })
  {
    c[i] =
      m.m[i][0] * double(position[0]) + m.m[i][1] * double(position[1]) + m.m[i][2] * double(position[2]) + m.m[i][3];
  }
  pixel[0] = (c[0] / c[3] + 1) / 2 * width;
  pixel[1] = (c[1] / c[3] + 1) / 2 * height;
  return c[3] > 0 && std::isfinite(pixel[0]) && std::isfinite(pixel[1]);
}

/// Positions against pixels and depth, and motion against the camera of the frame before.
void CheckGeometry(
  vtkImageData* image, const ReadReport& report, const FrameFacts* before, std::vector<Relation>& relations)
{
  const float *position = Find(image, "position", 3), *depth = Find(image, "depth", 1),
              *motion = Find(image, "motion", 2);
  const FrameFacts& facts = report.Facts;
  if (!facts.HasCamera || !position)
  {
    return;
  }
  int e[6];
  image->GetExtent(e);
  Relation own, distance, moved;
  own.What = "position is seen in its own pixel (within 1.5)";
  own.Enough = distance.Enough = 0.95;
  distance.What = "depth is that of position (within 1 %)";
  moved.What =
    "motion is that of position under the camera of the frame before (within half a pixel; the rest moves itself)";
  moved.Enough = 0;
  std::int64_t p = 0;
  for (int y = e[2]; y <= e[3]; ++y)
  {
    for (int x = e[0]; x <= e[1]; ++x, ++p)
    {
      const float* q = position + 3 * p;
      const bool hit = depth ? std::isfinite(depth[p]) && depth[p] > 0 : q[0] != 0 || q[1] != 0 || q[2] != 0;
      if (!hit)
      {
        continue;
      }
      double now[2], then[2];
      const bool seen = Project(facts.WorldToNdc, q, report.Width, report.Height, now);
      own.Count(seen && std::hypot(now[0] - x - 0.5, now[1] - y - 0.5) <= 1.5);
      if (depth)
      {
        double z = facts.WorldToCamera.m[2][3];
        for (int i = 0; i < 3; ++i)
        {
          z += facts.WorldToCamera.m[2][i] * double(q[i]);
        }
        distance.Count(std::fabs(-z - double(depth[p])) <= 0.01 * double(depth[p]));
      }
      if (before && motion && seen && Project(before->WorldToNdc, q, report.Width, report.Height, then))
      {
        moved.Count(
          std::hypot(then[0] - now[0] - double(motion[2 * p]), then[1] - now[1] - double(motion[2 * p + 1])) <= 0.5);
      }
    }
  }
  for (const Relation& r : { own, distance, moved })
  {
    if (r.Pixels > 0)
    {
      relations.push_back(r);
    }
  }
}

/// The file of the same sequence with the number before: "a.0004.exr" for "a.0005.exr"; empty where there is none.
std::string FileBefore(const std::string& file)
{
  const std::size_t last = file.find_last_of("0123456789"), slash = file.find_last_of('/');
  if (last == std::string::npos || (slash != std::string::npos && last < slash))
  {
    return std::string();
  }
  std::size_t first = last;
  while (first > 0 && file[first - 1] >= '0' && file[first - 1] <= '9')
  {
    --first;
  }
  const std::string digits = file.substr(first, last + 1 - first);
  long long n = 0;
  std::string error;
  if (!detail::ParseInt(digits, 1, 1000000000, n, error))
  {
    return std::string();
  }
  std::string before = std::to_string(n - 1);
  before.insert(0, digits.size() - std::min(digits.size(), before.size()), '0');
  const std::string name = file.substr(0, first) + before + file.substr(last + 1);
  std::error_code ec;
  return std::filesystem::is_regular_file(name, ec) ? name : std::string();
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
  const ReadReport header = ReadImageHeader(file);
  ReadOptions held; // what the file holds, not what it leaves empty
  held.Region = Rect{ 0, 0, header.Width, header.Height }.clipped(header.DataWindow);
  const vtkSmartPointer<vtkImageData> image =
    held.Region.empty() ? ReadImageFile(file, &report) : ReadImageFile(file, &report, held);
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
    text += "  " + OneLine(a.Name) + ": " + KindName(a.Kind) + ", " + a.Type + " [" + OneLine(Joined(a.Channels)) +
            "], " + range;
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
  std::vector<Relation> relations;
  const bool half =
    std::any_of(report.Arrays.begin(), report.Arrays.end(), [](const FileArray& a) { return a.Type == "half"; });
  CheckSums(image, half, relations);
  FrameFacts before;
  const std::string fileBefore = FileBefore(file);
  try
  {
    before = fileBefore.empty() ? before : ReadImageHeader(fileBefore).Facts;
  }
  catch (const StageError&)
  {
    before = FrameFacts(); // motion goes unchecked
  }
  // The frame before may have another origin: its matrix acts on this frame's positions.
  const Vec3d shift = report.Facts.Origin - before.Origin;
  for (int i = 0; i < 4; ++i)
  {
    double* row = before.WorldToNdc.m[i];
    row[3] += row[0] * shift.x + row[1] * shift.y + row[2] * shift.z;
  }
  const bool previous = before.HasCamera && before.Tick == report.Facts.Tick - 1;
  CheckGeometry(image, report, previous ? &before : nullptr, relations);
  out["relations"] = nlohmann::json::array();
  for (const Relation& r : relations)
  {
    char line[64];
    std::snprintf(line, sizeof line, ": %.4g %% of %lld pixels", 100. * double(r.Kept) / double(r.Pixels),
      static_cast<long long>(r.Pixels));
    text += std::string(r.Holds() ? "  " : "  against the contract: ") + r.What + line + "\n";
    out["relations"].push_back(
      { { "what", r.What }, { "pixels", r.Pixels }, { "kept", r.Kept }, { "holds", r.Holds() } });
  }
  out["metadata"] = report.Metadata;
  for (const auto& m : report.Metadata)
  {
    const std::size_t lines = std::size_t(std::count(m.second.begin(), m.second.end(), '\n'));
    text += "  quell:" + OneLine(m.first) + " = " +
            (lines > 1 || m.second.size() > 100 ? std::to_string(m.second.size()) + " characters" : OneLine(m.second)) +
            "\n";
  }
  for (const std::string& warning : report.Warnings)
  {
    std::fprintf(stderr, "quell: warning: %s: %s\n", OneLine(file).c_str(), OneLine(warning, 2000).c_str());
  }
  std::fputs((asJson ? JsonText(out) + "\n" : text).c_str(), stdout);
  return ExitDone;
}
}
