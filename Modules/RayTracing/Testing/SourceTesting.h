// SPDX-License-Identifier: BSD-3-Clause
#ifndef SourceTesting_h
#define SourceTesting_h

#include "SceneBuilder.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"
#include "vtkQuellPathTraceSource.h"

#include <memory>
#include <string>
#include <vector>

/// What tests of vtkQuellPathTraceSource share.
namespace sourcetesting
{
/// A room with a lamp, a metal sphere (id 4) and a mirror (id 2), open to a grey sky.
inline std::shared_ptr<quell::Scene> Room()
{
  SceneBuilder b;
  const int white = b.Add(SceneBuilder::Lambert(.7f)), lamp = b.Add(SceneBuilder::Lambert(0, 8)),
            metal = b.Add(SceneBuilder::Metal(.8f, .4f)), mirror = b.Add(SceneBuilder::Metal(.9f, 0));
  b.Quad(white, { -2, 0, 2 }, { 4, 0, 0 }, { 0, 0, -4 });
  b.Quad(mirror, { -2, 0, -2 }, { 4, 0, 0 }, { 0, 1.5f, 0 });
  b.Quad(lamp, { -.4f, 2, -.4f }, { .8f, 0, 0 }, { 0, 0, .8f });
  b.Sphere(metal, { .5f, .5f, 0 }, .5f, 16);
  b.Sky(.2f);
  b.Camera({ 0, 1, 4 }, .7, .1);
  b.Scene->Hash = "0123456789abcdef";
  return b.Scene;
}

inline void Configure(
  vtkQuellPathTraceSource* s, std::shared_ptr<const quell::Scene> scene, int width = 40, int height = 32, int spp = 2)
{
  s->SetScene(scene);
  s->SetWidth(width);
  s->SetHeight(height);
  s->SetSamplesPerPixel(spp);
  s->SetMaximumBounces(4);
}

inline vtkFloatArray* Array(vtkQuellPathTraceSource* s, const std::string& name)
{
  return vtkFloatArray::SafeDownCast(s->GetOutput()->GetPointData()->GetArray(name.c_str()));
}

inline std::vector<float> Copy(vtkQuellPathTraceSource* s, const std::string& name)
{
  vtkFloatArray* a = Array(s, name);
  return a ? std::vector<float>(a->GetPointer(0), a->GetPointer(0) + a->GetNumberOfValues()) : std::vector<float>();
}

/// Exactly these arrays of a tick; an Update() would want radiance too.
inline bool Ask(vtkQuellPathTraceSource* s, const quell::ArraySet& names, int tick = 0, quell::Rect region = {})
{
  vtkNew<vtkQuellCollector> collector;
  collector->AddRequest(s, names, region);
  return collector->UpdateTick(tick);
}
}

#endif
