// SPDX-License-Identifier: BSD-3-Clause
#ifndef IOTestTools_h
#define IOTestTools_h

#include "quellImageFile.h"

#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <sstream>
#include <unistd.h>

/// A directory of the test's own, removed afterwards.
class TemporaryDirectory
{
public:
  TemporaryDirectory()
  {
    std::string pattern = (std::filesystem::temp_directory_path() / "quell-io-XXXXXX").string();
    this->Path = mkdtemp(&pattern[0]);
  }
  ~TemporaryDirectory()
  {
    std::error_code ec;
    std::filesystem::remove_all(this->Path, ec);
  }
  std::string operator/(const std::string& name) const { return this->Path + "/" + name; }
  std::vector<std::string> List() const
  {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(this->Path))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  }

private:
  std::string Path;
};

inline vtkSmartPointer<vtkImageData> NewImage(const quell::Rect& r)
{
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetExtent(r.x0, r.x1 - 1, r.y0, r.y1 - 1, 0, 0);
  return image;
}

inline quell::ImageOut View(vtkImageData* image, const std::string& name)
{
  auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(name.c_str()));
  if (!array)
    throw std::runtime_error("no array " + name);
  int e[6];
  image->GetExtent(e);
  return { array->GetPointer(0), array->GetNumberOfComponents(), { e[0], e[2], e[1] + 1, e[3] + 1 } };
}

inline void AddArray(
  vtkImageData* image, const std::string& name, int components, const std::function<float(int, int, int)>& value)
{
  auto array = vtkSmartPointer<vtkFloatArray>::New();
  array->SetName(name.c_str());
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(image->GetNumberOfPoints());
  image->GetPointData()->AddArray(array);
  const quell::ImageOut v = View(image, name);
  for (int y = v.extent.y0; y < v.extent.y1; ++y)
    for (int x = v.extent.x0; x < v.extent.x1; ++x)
      for (int c = 0; c < components; ++c)
        v.at(x, y)[c] = value(x, y, c);
}

inline float Value(vtkImageData* image, const std::string& name, int x, int y, int c)
{
  const quell::ImageOut v = View(image, name);
  if (!v.inside(x, y) || c >= v.components)
    throw std::runtime_error("outside");
  return v.at(x, y)[c];
}

/// Everything float32 can be: NaN with a payload, infinities, denormals, negative zero, 1e30, the largest.
inline float WildValue(int x, int y, int c)
{
  const std::uint32_t h =
    (std::uint32_t(x) * 73856093u) ^ (std::uint32_t(y) * 19349663u) ^ (std::uint32_t(c) * 83492791u);
  const float inf = std::numeric_limits<float>::infinity();
  switch (h % 11)
  {
    case 0:
    {
      const std::uint32_t bits = 0x7fc12345u + h % 16;
      float v;
      std::memcpy(&v, &bits, 4);
      return v;
    }
    case 1:
      return inf;
    case 2:
      return -inf;
    case 3:
      return 1e-42f;
    case 4:
      return -0.f;
    case 5:
      return 1e30f;
    case 6:
      return std::numeric_limits<float>::max();
    default:
      return float(h % 100003) * 1e-3f;
  }
}

/// Equal bits over b's extent.
inline bool SameBits(vtkImageData* a, vtkImageData* b, const std::string& name)
{
  const quell::ImageOut u = View(a, name), v = View(b, name);
  if (u.components != v.components || !u.extent.contains(v.extent))
    return false;
  for (int y = v.extent.y0; y < v.extent.y1; ++y)
    for (int x = v.extent.x0; x < v.extent.x1; ++x)
      if (std::memcmp(u.at(x, y), v.at(x, y), sizeof(float) * size_t(u.components)) != 0)
        return false;
  return true;
}

inline std::string FileText(const std::string& path)
{
  std::ifstream in(path, std::ios::binary);
  std::stringstream s;
  s << in.rdbuf();
  return s.str();
}

/// The StageError's text; fails when there is none.
inline std::string ErrorOf(const std::function<void()>& work)
{
  try
  {
    work();
  }
  catch (const quell::StageError& e)
  {
    return e.what();
  }
  ADD_FAILURE() << "no StageError";
  return std::string();
}

#endif
