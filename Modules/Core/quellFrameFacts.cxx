// SPDX-License-Identifier: BSD-3-Clause
#include "quellFrameFacts.h"

#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkLongLongArray.h"
#include "vtkNew.h"
#include "vtkStringArray.h"

namespace quell
{
namespace
{
bool ReadDoubles(vtkFieldData* data, const char* name, double* out, int n)
{
  auto array = vtkDoubleArray::SafeDownCast(data->GetAbstractArray(name));
  if (!array || array->GetNumberOfValues() != n)
    return false;
  for (int i = 0; i < n; ++i)
    out[i] = array->GetValue(i);
  return true;
}
void WriteDoubles(vtkFieldData* data, const char* name, const double* v, int n)
{
  vtkNew<vtkDoubleArray> array;
  array->SetName(name);
  array->SetNumberOfValues(n);
  for (int i = 0; i < n; ++i)
    array->SetValue(i, v[i]);
  data->AddArray(array);
}
bool ReadInteger(vtkFieldData* data, const char* name, long long& out)
{
  auto array = vtkLongLongArray::SafeDownCast(data->GetAbstractArray(name));
  if (!array || array->GetNumberOfValues() != 1)
    return false;
  out = array->GetValue(0);
  return true;
}
void WriteInteger(vtkFieldData* data, const char* name, long long v)
{
  vtkNew<vtkLongLongArray> array;
  array->SetName(name);
  array->InsertNextValue(v);
  data->AddArray(array);
}
std::string ReadText(vtkFieldData* data, const char* name)
{
  auto array = vtkStringArray::SafeDownCast(data->GetAbstractArray(name));
  return array && array->GetNumberOfValues() == 1 ? std::string(array->GetValue(0)) : std::string();
}
/// An empty text is not written.
void WriteText(vtkFieldData* data, const char* name, const std::string& text)
{
  if (text.empty())
    return;
  vtkNew<vtkStringArray> array;
  array->SetName(name);
  array->InsertNextValue(text);
  data->AddArray(array);
}
}

FrameFacts FrameFacts::Read(vtkFieldData* data)
{
  FrameFacts f;
  if (!data)
    return f;
  f.HasCamera = ReadDoubles(data, "worldToCamera", &f.WorldToCamera.m[0][0], 16) &&
                ReadDoubles(data, "worldToNDC", &f.WorldToNdc.m[0][0], 16);
  double origin[3] = { 0, 0, 0 };
  if (ReadDoubles(data, "origin", origin, 3))
    f.Origin = { origin[0], origin[1], origin[2] };
  ReadDoubles(data, "time", &f.Time, 1);
  long long v = 0;
  if (ReadInteger(data, "tick", v))
    f.Tick = int(v);
  if (ReadInteger(data, "samplesPerPixel", v))
    f.SamplesPerPixel = int(v);
  ReadInteger(data, "seed", f.Seed);
  f.Scene = ReadText(data, "scene");
  f.Partial = ReadText(data, "partial");
  return f;
}

void FrameFacts::Write(vtkFieldData* data) const
{
  if (this->HasCamera)
  {
    WriteDoubles(data, "worldToCamera", &this->WorldToCamera.m[0][0], 16);
    WriteDoubles(data, "worldToNDC", &this->WorldToNdc.m[0][0], 16);
    const double origin[3] = { this->Origin.x, this->Origin.y, this->Origin.z };
    WriteDoubles(data, "origin", origin, 3);
  }
  WriteDoubles(data, "time", &this->Time, 1);
  WriteInteger(data, "tick", this->Tick);
  WriteInteger(data, "seed", this->Seed);
  WriteInteger(data, "samplesPerPixel", this->SamplesPerPixel);
  WriteText(data, "scene", this->Scene);
  WriteText(data, "partial", this->Partial);
}
}
