// SPDX-License-Identifier: BSD-3-Clause
/// Helpers of the module's tests.
#ifndef SceneTesting_h
#define SceneTesting_h

#include "quellScene.h"
#include "quellSceneFromVTK.h"
#include "vtkCellArray.h"
#include "vtkDoubleArray.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkQuellDataPathTraceSource.h"
#include "vtkUnsignedCharArray.h"

#include <cmath>
#include <initializer_list>
#include <string>
#include <vector>

namespace testing_scene
{
inline vtkSmartPointer<vtkPolyData> Polygons(const std::vector<std::vector<double>>& points,
  const std::vector<std::vector<vtkIdType>>& cells, bool doubles = false)
{
  auto data = vtkSmartPointer<vtkPolyData>::New();
  vtkNew<vtkPoints> p;
  p->SetDataType(doubles ? VTK_DOUBLE : VTK_FLOAT);
  for (const auto& at : points)
    p->InsertNextPoint(at.data());
  vtkNew<vtkCellArray> polys;
  for (const auto& cell : cells)
    polys->InsertNextCell(vtkIdType(cell.size()), cell.data());
  data->SetPoints(p);
  data->SetPolys(polys);
  return data;
}

/// The square [-1, 1]^2 in the plane z, facing +z.
inline vtkSmartPointer<vtkPolyData> Square(double z = 0)
{
  return Polygons({ { -1, -1, z }, { 1, -1, z }, { 1, 1, z }, { -1, 1, z } }, { { 0, 1, 2, 3 } });
}

template <class Array>
vtkSmartPointer<Array> Values(const char* name, int components, std::initializer_list<double> values)
{
  auto array = vtkSmartPointer<Array>::New();
  array->SetName(name);
  array->SetNumberOfComponents(components);
  for (const double v : values)
    array->InsertNextValue(typename Array::ValueType(v));
  return array;
}

inline double SrgbToLinear(double v)
{
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

inline bool Mentions(const std::vector<std::string>& warnings, const std::string& text)
{
  for (const std::string& w : warnings)
    if (w.find(text) != std::string::npos)
      return true;
  return false;
}

/// Area of a mesh's triangles.
inline double Area(const quell::Mesh& mesh)
{
  double sum = 0;
  for (std::size_t i = 0; i + 2 < mesh.Indices.size(); i += 3)
  {
    const quell::Vec3f a = mesh.Positions[mesh.Indices[i]];
    sum += 0.5 * quell::Length(quell::Cross(quell::Vec3d(mesh.Positions[mesh.Indices[i + 1]] - a),
                   quell::Vec3d(mesh.Positions[mesh.Indices[i + 2]] - a)));
  }
  return sum;
}

/// One pixel of an array of the stage's output.
inline std::vector<double> Pixel(vtkQuellDataPathTraceSource* tracer, const char* name, int x, int y)
{
  vtkImageData* image = tracer->GetOutput();
  vtkDataArray* array = image->GetPointData()->GetArray(name);
  if (!array)
    return {};
  std::vector<double> v(std::size_t(array->GetNumberOfComponents()));
  array->GetTuple(vtkIdType(y) * image->GetDimensions()[0] + x, v.data());
  return v;
}
}

#endif
