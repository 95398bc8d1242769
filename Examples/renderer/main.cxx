// SPDX-License-Identifier: BSD-3-Clause
// A whole vtkRenderer, path-traced and denoised, for a few frames in which an actor and the camera move:
//   quell-renderer [file.exr [width height [vtk.ppm]]]
// The last argument also asks VTK for its picture of the first frame (needs OpenGL and a display).
#include "vtkActor.h"
#include "vtkCamera.h"
#include "vtkConeSource.h"
#include "vtkElevationFilter.h"
#include "vtkLight.h"
#include "vtkLookupTable.h"
#include "vtkNew.h"
#include "vtkPlaneSource.h"
#include "vtkPointData.h"
#include "vtkPolyDataMapper.h"
#include "vtkProperty.h"
#include "vtkQuellATrousFilter.h"
#include "vtkQuellDataPathTraceSource.h"
#include "vtkQuellImageWriter.h"
#include "vtkRenderWindow.h"
#include "vtkRenderer.h"
#include "vtkSphereSource.h"
#include "vtkUnsignedCharArray.h"
#ifdef QUELL_EXAMPLE_OPENGL
#include "vtkCompositeDataDisplayAttributes.h"
#include "vtkCompositePolyDataMapper2.h"
#endif

#include <cstdio>
#include <cstdlib>

namespace
{
vtkSmartPointer<vtkActor> Add(vtkRenderer* renderer, vtkAlgorithm* data)
{
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputConnection(data->GetOutputPort());
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  renderer->AddActor(actor);
  return actor;
}

#ifdef QUELL_EXAMPLE_OPENGL
int SaveVtksPicture(vtkRenderer* renderer, int width, int height, const char* file)
{
  vtkNew<vtkRenderWindow> window;
  window->SetOffScreenRendering(1);
  window->SetSize(width, height);
  window->AddRenderer(renderer);
  window->Render();
  vtkNew<vtkUnsignedCharArray> rgb;
  window->GetPixelData(0, 0, width - 1, height - 1, 0, rgb);
  std::FILE* out = std::fopen(file, "wb");
  if (!out)
    return 1;
  std::fprintf(out, "P6 %d %d 255\n", width, height);
  for (int y = height - 1; y >= 0; --y)
    std::fwrite(rgb->GetPointer(vtkIdType(3) * width * y), 3, std::size_t(width), out);
  std::fclose(out);
  window->RemoveRenderer(renderer);
  return 0;
}
#endif
}

int main(int argc, char* argv[])
{
  const int width = argc > 3 ? std::atoi(argv[2]) : 640, height = argc > 3 ? std::atoi(argv[3]) : 480;
  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(0.25, 0.3, 0.4);
  renderer->SetBackground2(0.7, 0.75, 0.85);
  renderer->GradientBackgroundOn();

  vtkNew<vtkPlaneSource> plane;
  plane->SetOrigin(-4, 0, -4);
  plane->SetPoint1(-4, 0, 4);
  plane->SetPoint2(4, 0, -4);
  Add(renderer, plane)->GetProperty()->SetColor(0.8, 0.8, 0.8);

  vtkNew<vtkSphereSource> sphere;
  sphere->SetThetaResolution(48);
  sphere->SetPhiResolution(32);
  sphere->SetRadius(1);
  vtkNew<vtkElevationFilter> elevation;
  elevation->SetInputConnection(sphere->GetOutputPort());
  elevation->SetLowPoint(0, -1, 0);
  elevation->SetHighPoint(0, 1, 0);
  auto ball = Add(renderer, elevation);
  ball->SetPosition(-1.2, 1, 0);

  vtkNew<vtkConeSource> cone;
  cone->SetResolution(40);
  cone->SetDirection(0, 1, 0);
  cone->SetHeight(2);
  cone->SetRadius(0.8);
  auto red = Add(renderer, cone);
  red->SetPosition(1.2, 1, 0.4);
  red->GetProperty()->SetColor(0.9, 0.2, 0.15);
  red->GetProperty()->SetSpecular(0.5);
  red->GetProperty()->SetSpecularPower(30);
  red->GetProperty()->SetInterpolationToPhong();

  auto small = Add(renderer, sphere);
  small->SetScale(0.45);
  small->SetPosition(0.2, 0.45, 1.8);
  small->GetProperty()->SetInterpolationToPBR();
  small->GetProperty()->SetMetallic(1);
  small->GetProperty()->SetRoughness(0.25);
  small->GetProperty()->SetColor(1, 0.85, 0.5);

  vtkNew<vtkLight> key;
  key->SetPosition(3, 6, 4);
  key->SetFocalPoint(0, 0, 0);
  key->SetIntensity(0.9);
  renderer->AddLight(key);
  vtkNew<vtkLight> fill;
  fill->SetLightTypeToHeadlight();
  fill->SetIntensity(0.3);
  renderer->AddLight(fill);
  vtkCamera* camera = renderer->GetActiveCamera();
  camera->SetPosition(0, 3, 8);
  camera->SetFocalPoint(0, 0.8, 0);

#ifdef QUELL_EXAMPLE_OPENGL
  if (argc > 4 && SaveVtksPicture(renderer, width, height, argv[4]) != 0)
    return 1;
#endif

  vtkNew<vtkQuellDataPathTraceSource> tracer;
  tracer->SetRenderer(renderer);
  tracer->SetWidth(width);
  tracer->SetHeight(height);
  tracer->SetSamplesPerPixel(16);

#ifdef QUELL_EXAMPLE_OPENGL
  quell::RendererOptions options;
  options.BlockAttributes = [](vtkMapper* mapper)
  {
    auto composite = vtkCompositePolyDataMapper2::SafeDownCast(mapper);
    return composite ? composite->GetCompositeDataDisplayAttributes() : nullptr;
  };
  tracer->SetRendererOptions(options);
#endif

  vtkNew<vtkQuellATrousFilter> denoise;
  for (const char* array : { "radiance", "variance", "depth", "normal", "id" })
    denoise->ConnectInput(array, tracer);
  vtkNew<vtkQuellImageWriter> writer;
  writer->SetFile(argc > 1 ? argv[1] : "renderer.exr");
  writer->ConnectInput("layer", denoise, "radiance");
  writer->ConnectInput("layer", tracer, "albedo");
  writer->ConnectInput("layer", tracer, "motion");

  quell::Timeline frames;
  frames.Count = 3;
  tracer->SetTimeline(frames);
  for (int frame = 0; frame < frames.Count; ++frame)
  {
    red->RotateZ(2);
    camera->Azimuth(0.5);
    writer->UpdateTimeStep(frame);
    for (const std::string& warning : tracer->GetWarnings())
      std::fprintf(stderr, "frame %d: %s\n", frame, warning.c_str());
    if (!tracer->GetErrorText().empty() || !writer->GetErrorText().empty())
      return 1;
  }
  return 0;
}
