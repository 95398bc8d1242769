// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTesting.h"
#include "vtkActor.h"
#include "vtkCamera.h"
#include "vtkContourFilter.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkLight.h"
#include "vtkLookupTable.h"
#include "vtkMultiBlockDataSet.h"
#include "vtkObjectFactory.h"
#include "vtkPolyDataAlgorithm.h"
#include "vtkPolyDataMapper.h"
#include "vtkProperty.h"
#include "vtkRTAnalyticSource.h"
#include "vtkRenderWindow.h"
#include "vtkRenderer.h"
#include "vtkSphereSource.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkTrivialProducer.h"

#include <gtest/gtest.h>

using namespace testing_scene;
using quell::DataMaterial;
using SDDP = vtkStreamingDemandDrivenPipeline;

namespace
{
/// A tracer of 32 x 32 pixels over a renderer with one white square that fills the view of a camera at z = 5.
struct Scene
{
  vtkNew<vtkRenderer> Renderer;
  vtkNew<vtkCamera> Camera;
  vtkNew<vtkSphereSource> Sphere;
  vtkNew<vtkPolyDataMapper> Mapper;
  vtkNew<vtkActor> Actor;
  vtkNew<vtkQuellDataPathTraceSource> Tracer;

  Scene()
  {
    this->Camera->SetPosition(0, 0, 5);
    this->Camera->SetFocalPoint(0, 0, 0);
    this->Camera->SetViewUp(0, 1, 0);
    this->Camera->SetViewAngle(20); // sees +-0.88 at the origin
    this->Renderer->SetActiveCamera(this->Camera);
    this->Mapper->SetInputDataObject(Square());
    this->Actor->SetMapper(this->Mapper);
    this->Renderer->AddActor(this->Actor);
    this->Tracer->SetRenderer(this->Renderer);
    this->Tracer->SetWidth(32);
    this->Tracer->SetHeight(32);
    this->Tracer->SetSamplesPerPixel(4);
  }
};

/// A square at z = the time it is asked for.
class TimedSquare : public vtkPolyDataAlgorithm
{
public:
  static TimedSquare* New();
  vtkTypeMacro(TimedSquare, vtkPolyDataAlgorithm);
  double Asked = -1;
  int Executions = 0;

protected:
  TimedSquare() { this->SetNumberOfInputPorts(0); }
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector* out) override
  {
    const double steps[3] = { 0, 0.5, 1 }, range[2] = { 0, 1 };
    out->GetInformationObject(0)->Set(SDDP::TIME_STEPS(), steps, 3);
    out->GetInformationObject(0)->Set(SDDP::TIME_RANGE(), range, 2);
    return 1;
  }
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* out) override
  {
    vtkInformation* info = out->GetInformationObject(0);
    this->Asked = info->Has(SDDP::UPDATE_TIME_STEP()) ? info->Get(SDDP::UPDATE_TIME_STEP()) : -1;
    ++this->Executions;
    vtkPolyData::GetData(info)->ShallowCopy(Square(this->Asked));
    vtkPolyData::GetData(info)->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), this->Asked);
    return 1;
  }
};
vtkStandardNewMacro(TimedSquare);
}

TEST(DataPathTraceSource, AWhiteSurfaceThatFacesTheHeadlightIsOne)
{
  Scene s;
  s.Tracer->SetAlwaysMake({ "alpha", "albedo" });
  s.Tracer->Update();
  ASSERT_EQ(s.Tracer->GetErrorText(), "");
  for (int c = 0; c < 3; ++c)
  {
    EXPECT_NEAR(Pixel(s.Tracer, "radiance", 5, 20).at(std::size_t(c)), 1, 1e-4);
    EXPECT_NEAR(Pixel(s.Tracer, "albedo", 5, 20).at(std::size_t(c)), 1, 1e-4);
  }
  s.Actor->GetProperty()->SetColor(0.5, 1, 0);
  s.Tracer->Update();
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 5, 20).at(0), SrgbToLinear(0.5), 1e-4);
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 5, 20).at(2), 0, 1e-6);
  // Turned by 60 degrees it has the cosine; half the intensity is half the light.
  s.Actor->GetProperty()->SetColor(1, 1, 1);
  s.Actor->RotateY(60);
  s.Tracer->Update();
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 16, 16).at(0), 0.5, 1e-3);
  vtkNew<vtkLight> light;
  light->SetLightTypeToHeadlight();
  light->SetIntensity(0.5);
  s.Renderer->AddLight(light);
  s.Tracer->Update();
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 16, 16).at(0), 0.25, 1e-3);
}

TEST(DataPathTraceSource, LampsAreAsBrightAtTheirFocalPointAsInVtk)
{
  Scene s;
  s.Tracer->SetSamplesPerPixel(16);
  vtkNew<vtkLight> lamp;
  lamp->SetPositional(1);
  lamp->SetConeAngle(90);
  lamp->SetPosition(0, 0, 3);
  lamp->SetFocalPoint(0, 0, 0);
  s.Renderer->AddLight(lamp);
  s.Camera->SetViewAngle(1);
  s.Tracer->Update();
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 16, 16).at(0), 1, 2e-3);
  lamp->SetConeAngle(30);
  s.Tracer->Update();
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 16, 16).at(0), 1, 2e-3) << "on the axis of a cone";
}

TEST(DataPathTraceSource, TableColoursReachTheAlbedo)
{
  Scene s;
  auto data = Square();
  data->GetPointData()->SetScalars(Values<vtkFloatArray>("s", 1, { 0, 1, 1, 0 })); // grows with x
  s.Mapper->SetInputDataObject(data);
  vtkNew<vtkLookupTable> table;
  table->SetNumberOfTableValues(2);
  table->SetTableValue(0, 1, 0, 0);
  table->SetTableValue(1, 0, 0, 1);
  s.Mapper->SetLookupTable(table);
  s.Tracer->SetAlwaysMake({ "alpha", "albedo" });
  s.Tracer->Update();
  const auto left = Pixel(s.Tracer, "albedo", 1, 16), right = Pixel(s.Tracer, "albedo", 30, 16);
  EXPECT_GT(left.at(0), 0.85);
  EXPECT_GT(right.at(2), 0.85);
  EXPECT_NEAR(left.at(0) + left.at(2), 1, 1e-3) << "interpolated colours";
  s.Mapper->InterpolateScalarsBeforeMappingOn();
  s.Tracer->Update();
  const auto sharp = Pixel(s.Tracer, "albedo", 13, 16);
  EXPECT_NEAR(sharp.at(0), 1, 1e-3) << "two colours and nothing between";
  table->SetTableValue(0, 0, 1, 0);
  s.Tracer->Update();
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 13, 16).at(1), 1, 1e-3) << "a changed table is seen";
}

TEST(DataPathTraceSource, TexturesStandUpright)
{
  vtkNew<vtkImageData> image;
  image->SetDimensions(2, 2, 1);
  image->GetPointData()->SetScalars(
    Values<vtkUnsignedCharArray>("rgb", 3, { 255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255 }));
  auto data = Square();
  data->GetPointData()->SetTCoords(Values<vtkFloatArray>("uv", 2, { 0, 0, 1, 0, 1, 1, 0, 1 }));
  Scene s;
  s.Renderer->RemoveActor(s.Actor);
  vtkNew<vtkTrivialProducer> producer;
  producer->SetOutput(data);
  s.Tracer->SetInputConnection(producer->GetOutputPort());
  DataMaterial m;
  m.ColorTexture.Image = image.Get();
  m.ColorTexture.Interpolate = false;
  s.Tracer->SetMaterial(m);
  s.Tracer->SetAlwaysMake({ "albedo", "alpha" });
  s.Tracer->Update();
  ASSERT_EQ(s.Tracer->GetErrorText(), "");
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 6, 6).at(0), 1, 1e-3) << "bottom left is red";
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 6, 6).at(1), 0, 1e-3);
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 25, 6).at(1), 1, 1e-3) << "bottom right is green";
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 25, 6).at(2), 0, 1e-3);
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 6, 25).at(2), 1, 1e-3) << "top left is blue";
  EXPECT_NEAR(Pixel(s.Tracer, "albedo", 6, 25).at(0), 0, 1e-3);
}

TEST(DataPathTraceSource, IdsAndNormalsOfBlocks)
{
  vtkNew<vtkMultiBlockDataSet> blocks;
  auto left = Polygons({ { -1, -1, 0 }, { 0, -1, 0 }, { 0, 1, 0 }, { -1, 1, 0 } }, { { 0, 1, 2, 3 } });
  auto right = Polygons({ { 0, -1, 0 }, { 1, -1, 0 }, { 1, 1, 0 }, { 0, 1, 0 } }, { { 0, 1, 2, 3 } });
  right->GetPointData()->SetNormals(
    Values<vtkFloatArray>("n", 3, { 0, 0.6, 0.8, 0, 0.6, 0.8, 0, 0.6, 0.8, 0, 0.6, 0.8 }));
  blocks->SetBlock(0, left);
  blocks->SetBlock(1, right);
  Scene s;
  s.Actor->VisibilityOff();
  vtkNew<vtkTrivialProducer> producer;
  producer->SetOutput(blocks);
  s.Tracer->SetInputConnection(producer->GetOutputPort());
  s.Tracer->SetAlwaysMake({ "id", "normal", "alpha" });
  s.Tracer->Update();
  ASSERT_EQ(s.Tracer->GetErrorText(), "");
  EXPECT_EQ(Pixel(s.Tracer, "id", 4, 16).at(0), 1);
  EXPECT_EQ(Pixel(s.Tracer, "id", 28, 16).at(0), 2);
  EXPECT_NEAR(Pixel(s.Tracer, "normal", 4, 16).at(2), 1, 1e-4);
  EXPECT_NEAR(Pixel(s.Tracer, "normal", 28, 16).at(1), 0.6, 1e-4);
}

TEST(DataPathTraceSource, AContourIsTracedAgainOnlyWhenItChanges)
{
  vtkNew<vtkRTAnalyticSource> wavelet;
  wavelet->SetWholeExtent(-8, 8, -8, 8, -8, 8);
  vtkNew<vtkContourFilter> contour;
  contour->SetInputConnection(wavelet->GetOutputPort());
  contour->SetValue(0, 150);
  vtkNew<vtkQuellDataPathTraceSource> tracer;
  tracer->SetInputConnection(contour->GetOutputPort());
  tracer->SetWidth(16);
  tracer->SetHeight(16);
  tracer->Update();
  ASSERT_EQ(tracer->GetErrorText(), "");
  EXPECT_EQ(tracer->GetNumberOfScenes(), 1);
  EXPECT_EQ(tracer->GetCounters().Executions, 1);
  EXPECT_GT(Pixel(tracer, "radiance", 8, 8).at(0), 0) << "a studio sky lights what has no light";
  tracer->Update();
  EXPECT_EQ(tracer->GetCounters().Executions, 1);
  contour->SetValue(0, 200);
  tracer->Update();
  EXPECT_EQ(tracer->GetNumberOfScenes(), 2);
  EXPECT_EQ(tracer->GetCounters().Executions, 2);
  // A parameter of the tracer makes another picture of the same scene.
  tracer->SetSamplesPerPixel(2);
  tracer->Update();
  EXPECT_EQ(tracer->GetNumberOfScenes(), 2);
  EXPECT_EQ(tracer->GetCounters().Executions, 3);
  DataMaterial m;
  m.DiffuseColor = { 1, 0, 0 };
  m.ScalarVisibility = false;
  tracer->SetMaterial(m);
  tracer->Update();
  EXPECT_EQ(tracer->GetNumberOfScenes(), 3);
  EXPECT_EQ(Pixel(tracer, "radiance", 8, 8).at(2), 0);
}

TEST(DataPathTraceSource, PartsOfThePictureNeedAllOfTheData)
{
  vtkNew<vtkRTAnalyticSource> wavelet; // structured: it would be asked for the picture's extent
  wavelet->SetWholeExtent(-8, 8, -8, 8, -8, 8);
  vtkNew<vtkContourFilter> contour;
  contour->SetInputConnection(wavelet->GetOutputPort());
  contour->SetValue(0, 150);
  vtkNew<vtkQuellDataPathTraceSource> tracer;
  tracer->SetInputConnection(contour->GetOutputPort());
  tracer->SetWidth(24);
  tracer->SetHeight(24);
  tracer->Update();
  const vtkIdType cells = contour->GetOutput()->GetNumberOfCells();
  const auto whole = Pixel(tracer, "radiance", 14, 12);
  vtkNew<vtkQuellDataPathTraceSource> part;
  part->SetInputConnection(contour->GetOutputPort());
  part->SetWidth(24);
  part->SetHeight(24);
  const int extent[6] = { 12, 15, 10, 13, 0, 0 };
  part->UpdateExtent(extent);
  ASSERT_EQ(part->GetErrorText(), "");
  EXPECT_EQ(contour->GetOutput()->GetNumberOfCells(), cells);
  int got[6];
  part->GetOutput()->GetExtent(got);
  ASSERT_EQ(got[1] - got[0], 3);
  double v[3];
  part->GetOutput()->GetPointData()->GetArray("radiance")->GetTuple((12 - got[2]) * 4 + 14 - got[0], v);
  EXPECT_EQ(v[0], whole[0]) << "the same bits";
}

TEST(DataPathTraceSource, WatchesEverythingThatARendererShows)
{
  Scene s;
  s.Mapper->SetInputConnection(s.Sphere->GetOutputPort());
  int scenes = 0;
  const auto makes = [&](const char* what, bool another)
  {
    s.Tracer->Update();
    EXPECT_EQ(s.Tracer->GetErrorText(), "") << what;
    EXPECT_EQ(s.Tracer->GetNumberOfScenes(), scenes + another) << what;
    scenes = s.Tracer->GetNumberOfScenes();
  };
  makes("first", true);
  makes("nothing", false);
  s.Sphere->SetThetaResolution(20);
  makes("the pipeline of a mapper", true);
  s.Actor->GetProperty()->SetDiffuse(0.5);
  makes("a property", true);
  s.Actor->SetPosition(0.1, 0, 0);
  makes("a place", true);
  s.Camera->Azimuth(10);
  makes("the camera", true);
  vtkNew<vtkLight> light;
  s.Renderer->AddLight(light);
  makes("a new light", true);
  light->SetIntensity(2);
  makes("a light", true);
  s.Mapper->SetScalarRange(2, 3);
  makes("a mapper", true);
  s.Mapper->GetLookupTable()->SetRange(4, 5);
  makes("a table", true);
  makes("nothing again", false);
  s.Actor->VisibilityOff();
  makes("visibility", true);
  s.Renderer->RemoveActor(s.Actor);
  makes("the list of actors", true);
  makes("still nothing", false);
}

TEST(DataPathTraceSource, FollowsTheWindowsSize)
{
  Scene s;
  s.Tracer->SetWidth(0);
  s.Tracer->SetHeight(0);
  vtkNew<vtkRenderWindow> window;
  window->SetSize(20, 10);
  window->AddRenderer(s.Renderer);
  s.Tracer->Update();
  int size[3];
  s.Tracer->GetOutput()->GetDimensions(size);
  EXPECT_EQ(size[0], 20);
  EXPECT_EQ(size[1], 10);
  window->SetSize(12, 14);
  s.Tracer->Update();
  s.Tracer->GetOutput()->GetDimensions(size);
  EXPECT_EQ(size[0], 12);
  EXPECT_EQ(size[1], 14);
}

TEST(DataPathTraceSource, BackgroundIsBehindAndLightsNothing)
{
  Scene s;
  s.Renderer->SetBackground(1, 0.5, 0);
  s.Actor->SetScale(0.5); // covers the middle
  s.Tracer->SetAlwaysMake({ "alpha", "emission", "direct", "indirect" });
  s.Tracer->Update();
  const auto empty = Pixel(s.Tracer, "radiance", 1, 1), middle = Pixel(s.Tracer, "radiance", 16, 16);
  EXPECT_NEAR(empty.at(0), 1, 1e-6);
  EXPECT_NEAR(empty.at(1), SrgbToLinear(0.5), 1e-6);
  EXPECT_NEAR(middle.at(0), 1, 1e-4) << "no orange light on white";
  EXPECT_NEAR(middle.at(2), 1, 1e-4);
  EXPECT_NEAR(Pixel(s.Tracer, "emission", 1, 1).at(0), 1, 1e-6) << "the layers still sum up";
  s.Renderer->GradientBackgroundOn();
  s.Renderer->SetBackground2(0, 0, 1);
  s.Tracer->Update();
  EXPECT_GT(Pixel(s.Tracer, "radiance", 1, 30).at(2), 0.9) << "Background2 is above";
  EXPECT_GT(Pixel(s.Tracer, "radiance", 1, 1).at(0), 0.9);
  // Where the same arrays are asked for again, it is not painted twice.
  s.Tracer->Modified();
  s.Tracer->Update();
  EXPECT_LT(Pixel(s.Tracer, "radiance", 1, 30).at(2), 1.0001);
  quell::RendererOptions options;
  options.Background = quell::RendererOptions::Backdrop::Sky;
  s.Tracer->SetRendererOptions(options);
  s.Tracer->Update();
  EXPECT_GT(Pixel(s.Tracer, "radiance", 16, 16).at(0), 1.1) << "a sky lights";
}

TEST(DataPathTraceSource, MotionOfActorsAndOfTheCamera)
{
  Scene s;
  s.Tracer->SetAlwaysMake({ "alpha", "motion" });
  quell::Timeline ticks;
  ticks.Count = 20;
  s.Tracer->SetTimeline(ticks);
  const auto at = [&](int tick)
  {
    s.Tracer->UpdateTimeStep(tick);
    EXPECT_EQ(s.Tracer->GetErrorText(), "");
    return Pixel(s.Tracer, "motion", 16, 16);
  };
  EXPECT_EQ(at(0), (std::vector<double>{ 0, 0 }));
  // The square is 5 away: half of the 32 pixels are tan(10 degrees) x 5.
  const double perUnit = 16 / (5 * std::tan(10 * 3.14159265358979 / 180));
  s.Actor->SetPosition(0.1, -0.05, 0);
  auto m = at(1);
  EXPECT_NEAR(m.at(0), -0.1 * perUnit, 2e-3) << "previous - current";
  EXPECT_NEAR(m.at(1), 0.05 * perUnit, 2e-3);
  EXPECT_EQ(at(2), (std::vector<double>{ 0, 0 })) << "at rest";
  s.Camera->SetPosition(0.2, 0, 5);
  s.Camera->SetFocalPoint(0.2, 0, 0);
  m = at(3);
  EXPECT_NEAR(m.at(0), 0.2 * perUnit, 2e-3);
  EXPECT_NEAR(m.at(1), 0, 2e-3);
  const int scenes = s.Tracer->GetNumberOfScenes();
  EXPECT_EQ(at(4), (std::vector<double>{ 0, 0 }));
  EXPECT_EQ(s.Tracer->GetNumberOfScenes(), scenes) << "the recorded motion has ended by itself";
  s.Actor->SetPosition(0.3, -0.05, 0);
  EXPECT_NEAR(at(5).at(0), -0.2 * perUnit, 2e-3) << "relative to a tick that was not recorded anew";
  s.Actor->SetPosition(0, 0, 0);
  EXPECT_EQ(at(9), (std::vector<double>{ 0, 0 })) << "after a jump nothing moves";
}

TEST(DataPathTraceSource, MotionOfPointsOnThePort)
{
  vtkNew<TimedSquare> square;
  Scene s;
  s.Actor->VisibilityOff();
  s.Tracer->SetInputConnection(square->GetOutputPort());
  s.Tracer->SetAlwaysMake({ "alpha", "motion", "depth" });
  quell::Timeline ticks;
  ticks.Count = 3;
  ticks.Rate = 2;
  s.Tracer->SetTimeline(ticks);
  s.Tracer->UpdateTimeStep(0);
  EXPECT_EQ(square->Asked, 0);
  EXPECT_NEAR(Pixel(s.Tracer, "depth", 20, 16).at(0), 5, 1e-4);
  s.Tracer->UpdateTimeStep(1);
  ASSERT_EQ(s.Tracer->GetErrorText(), "");
  EXPECT_EQ(square->Asked, 0.5) << "seconds";
  EXPECT_NEAR(Pixel(s.Tracer, "depth", 20, 16).at(0), 4.5, 1e-4);
  // A point seen at pixel offset d from the centre was farther away, and seen nearer to the centre.
  const double d = 24.5 - 16;
  EXPECT_NEAR(Pixel(s.Tracer, "motion", 24, 16).at(0), d * (4.5 / 5 - 1), 0.06);
  s.Tracer->UpdateTimeStep(1);
  EXPECT_EQ(square->Executions, 2);
}

TEST(DataPathTraceSource, ErrorsSayWhatIsMissing)
{
  vtkObject::GlobalWarningDisplayOff();
  vtkNew<vtkQuellDataPathTraceSource> tracer;
  tracer->Update();
  EXPECT_NE(tracer->GetErrorText().find("scene"), std::string::npos) << tracer->GetErrorText();
  vtkNew<vtkTrivialProducer> producer;
  vtkNew<vtkPolyData> empty;
  producer->SetOutput(empty);
  tracer->SetInputConnection(producer->GetOutputPort());
  EXPECT_NO_THROW(tracer->CheckSettings());
  tracer->Update();
  EXPECT_NE(tracer->GetErrorText().find("data: no polygon in this vtkPolyData"), std::string::npos)
    << tracer->GetErrorText();
  producer->SetOutput(Square());
  tracer->SetCamera("nobody");
  tracer->Update();
  EXPECT_NE(tracer->GetErrorText().find("nobody"), std::string::npos) << tracer->GetErrorText();
  tracer->SetCamera("");
  tracer->SetWidth(8);
  tracer->SetHeight(8);
  tracer->Update();
  EXPECT_EQ(tracer->GetErrorText(), "") << "and it recovers";
  vtkObject::GlobalWarningDisplayOn();

  // An empty renderer is a picture of its background.
  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(0, 1, 0);
  vtkNew<vtkQuellDataPathTraceSource> nothing;
  nothing->SetRenderer(renderer);
  nothing->SetWidth(8);
  nothing->SetHeight(8);
  nothing->Update();
  EXPECT_EQ(nothing->GetErrorText(), "");
  EXPECT_EQ(Pixel(nothing, "radiance", 4, 4).at(1), 1);
}

TEST(DataPathTraceSource, SeveralConnectionsSeveralMaterials)
{
  vtkNew<vtkTrivialProducer> a, b;
  a->SetOutput(Polygons({ { -1, -1, 0 }, { 0, -1, 0 }, { 0, 1, 0 }, { -1, 1, 0 } }, { { 0, 1, 2, 3 } }));
  b->SetOutput(Polygons({ { 0, -1, 0 }, { 1, -1, 0 }, { 1, 1, 0 }, { 0, 1, 0 } }, { { 0, 1, 2, 3 } }));
  Scene s;
  s.Actor->VisibilityOff();
  s.Tracer->AddInputConnection(0, a->GetOutputPort());
  s.Tracer->AddInputConnection(0, b->GetOutputPort());
  DataMaterial red, shine;
  red.DiffuseColor = { 1, 0, 0 };
  shine.DiffuseColor = { 0, 0, 0 };
  shine.Emission = { 0, 0, 3 };
  s.Tracer->SetMaterial(0, red);
  s.Tracer->SetMaterial(1, shine);
  s.Tracer->SetSamplesPerPixel(16);
  s.Tracer->Update();
  ASSERT_EQ(s.Tracer->GetErrorText(), "");
  // A light is picked by chance for every sample: the mean over the left half is what is known.
  double sum = 0;
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 14; ++x)
    {
      sum += Pixel(s.Tracer, "radiance", x, y).at(0);
      EXPECT_EQ(Pixel(s.Tracer, "radiance", x, y).at(1), 0);
    }
  EXPECT_NEAR(sum / (32 * 14), 1, 0.05);
  EXPECT_NEAR(Pixel(s.Tracer, "radiance", 28, 16).at(2), 3, 1e-3);
}
