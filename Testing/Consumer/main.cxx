// SPDX-License-Identifier: BSD-3-Clause
// A Quell stage as a plain VTK filter: no pipeline file, no other module.
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellBilateralFilter.h"
#include "vtkTrivialProducer.h"

#include <cmath>
#include <cstdio>

int main()
{
  vtkNew<vtkImageData> image;
  image->SetDimensions(32, 16, 1);
  vtkNew<vtkFloatArray> radiance;
  radiance->SetName("radiance");
  radiance->SetNumberOfComponents(3);
  radiance->SetNumberOfTuples(32 * 16);
  radiance->Fill(0.5);
  image->GetPointData()->SetScalars(radiance);
  vtkNew<vtkTrivialProducer> producer;
  producer->SetOutput(image);

  vtkNew<vtkQuellBilateralFilter> filter;
  filter->SetInputConnection(producer->GetOutputPort());
  filter->Update();
  vtkDataArray* out = filter->GetOutput()->GetPointData()->GetArray("radiance");
  if (!out || out->GetNumberOfTuples() != 32 * 16 || std::fabs(out->GetComponent(100, 1) - 0.5) > 1e-6)
  {
    std::puts("the filter did not keep a constant image");
    return 1;
  }
  std::puts("ok");
  return 0;
}
