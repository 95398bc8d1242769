// SPDX-License-Identifier: BSD-3-Clause
// An isosurface from a VTK pipeline, path-traced, denoised and written: quell-isosurface [file.exr [width height]]
#include "vtkContourFilter.h"
#include "vtkNew.h"
#include "vtkQuellATrousFilter.h"
#include "vtkQuellDataPathTraceSource.h"
#include "vtkQuellImageWriter.h"
#include "vtkRTAnalyticSource.h"

#include <cstdio>
#include <cstdlib>

int main(int argc, char* argv[])
{
  vtkNew<vtkRTAnalyticSource> wavelet;
  wavelet->SetWholeExtent(-20, 20, -20, 20, -20, 20);
  vtkNew<vtkContourFilter> contour;
  contour->SetInputConnection(wavelet->GetOutputPort());
  contour->SetValue(0, 157);

  vtkNew<vtkQuellDataPathTraceSource> tracer;
  tracer->SetInputConnection(contour->GetOutputPort());
  vtkNew<vtkQuellATrousFilter> denoise;
  for (const char* array : { "radiance", "variance", "depth", "normal" })
    denoise->ConnectInput(array, tracer);

  // The surface in one colour instead of its (constant) scalars.
  quell::DataMaterial clay;
  clay.ScalarVisibility = false;
  clay.DiffuseColor = { 0.9, 0.55, 0.4 };
  clay.Specular = 0.3;
  clay.SpecularPower = 40;
  tracer->SetMaterial(clay);
  tracer->SetSamplesPerPixel(16);
  tracer->SetWidth(argc > 3 ? std::atoi(argv[2]) : 640);
  tracer->SetHeight(argc > 3 ? std::atoi(argv[3]) : 480);

  vtkNew<vtkQuellImageWriter> writer;
  writer->SetFile(argc > 1 ? argv[1] : "isosurface.exr");
  writer->ConnectInput("layer", denoise, "radiance");
  writer->Update();
  for (const vtkQuellStage* stage : { static_cast<vtkQuellStage*>(tracer), static_cast<vtkQuellStage*>(writer) })
  {
    for (const std::string& warning : stage->GetWarnings())
      std::fprintf(stderr, "warning: %s\n", warning.c_str());
    if (!stage->GetErrorText().empty())
      return 1;
  }
  return writer->GetFilesWritten().empty() ? 1 : 0;
}
