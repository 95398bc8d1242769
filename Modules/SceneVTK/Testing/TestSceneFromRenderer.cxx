// SPDX-License-Identifier: BSD-3-Clause
// No display: VTK's abstract classes are enough, nothing is rendered by VTK.
#include "SceneTesting.h"
#include "quellCamera.h"
#include "vtkActor.h"
#include "vtkActor2D.h"
#include "vtkAssembly.h"
#include "vtkCamera.h"
#include "vtkCompositeDataDisplayAttributes.h"
#include "vtkInformation.h"
#include "vtkLight.h"
#include "vtkLightCollection.h"
#include "vtkLookupTable.h"
#include "vtkMatrix4x4.h"
#include "vtkMultiBlockDataSet.h"
#include "vtkPlane.h"
#include "vtkPolyDataMapper.h"
#include "vtkProperty.h"
#include "vtkRenderWindow.h"
#include "vtkRenderer.h"
#include "vtkSphereSource.h"
#include "vtkTexture.h"
#include "vtkTransform.h"
#include "vtkTrivialProducer.h"
#include "vtkVolume.h"

#include <gtest/gtest.h>

using namespace testing_scene;
using quell::RendererOptions;
using quell::SceneFromRenderer;
using quell::Vec3d;

namespace
{
constexpr double Pi = 3.14159265358979323846;

vtkSmartPointer<vtkActor> ActorOf(vtkDataObject* data)
{
  auto actor = vtkSmartPointer<vtkActor>::New();
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputDataObject(data);
  actor->SetMapper(mapper);
  return actor;
}

quell::Mat4 WorldOf(const quell::Scene& scene, int instance, double time = 0)
{
  return scene.WorldMatrices(time).at(std::size_t(scene.Instances.at(std::size_t(instance)).Node));
}

struct Stage
{
  vtkNew<vtkRenderer> Renderer;
  vtkNew<vtkCamera> Camera;
  Stage()
  {
    this->Camera->SetPosition(0, 0, 5);
    this->Camera->SetFocalPoint(0, 0, 0);
    this->Camera->SetViewUp(0, 1, 0);
    this->Renderer->SetActiveCamera(this->Camera);
  }
};
}

TEST(SceneFromRenderer, VisibleActorsWithTheirMatrices)
{
  Stage s;
  auto a = ActorOf(Square()), hidden = ActorOf(Square()), clear = ActorOf(Square());
  a->SetPosition(1, 2, 3);
  a->RotateZ(90);
  a->SetScale(2, 1, 1);
  vtkNew<vtkMatrix4x4> user;
  user->SetElement(0, 1, 0.5); // a shear
  a->SetUserMatrix(user);
  a->GetProperty()->SetColor(1, 0.5, 0);
  hidden->VisibilityOff();
  clear->GetProperty()->SetOpacity(0);
  s.Renderer->AddActor(hidden);
  s.Renderer->AddActor(a);
  s.Renderer->AddActor(clear);
  s.Renderer->AddActor(vtkNew<vtkActor>()); // no mapper
  const auto scene = SceneFromRenderer(s.Renderer);
  ASSERT_EQ(scene->Instances.size(), 1u);
  const quell::Mat4 m = WorldOf(*scene, 0);
  const double in[4] = { 0.25, -0.5, 0.125, 1 };
  double out[4];
  a->GetMatrix()->MultiplyPoint(in, out);
  const Vec3d p = m.Point({ in[0], in[1], in[2] });
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(p[i], out[i], 1e-12);
  EXPECT_EQ(scene->Meshes[0].Name, "actor 1");
  EXPECT_NEAR(scene->Materials.at(0).BaseColor.y, SrgbToLinear(0.5), 1e-6);
  EXPECT_TRUE(scene->Warnings.empty());
}

TEST(SceneFromRenderer, AssembliesConcatenateMatrices)
{
  Stage s;
  auto part = ActorOf(Square());
  part->SetPosition(1, 0, 0);
  vtkNew<vtkAssembly> inner, outer;
  inner->AddPart(part);
  inner->RotateZ(90);
  outer->AddPart(inner);
  outer->SetPosition(0, 0, 7);
  s.Renderer->AddActor(outer);
  const auto scene = SceneFromRenderer(s.Renderer);
  ASSERT_EQ(scene->Instances.size(), 1u);
  const Vec3d p = WorldOf(*scene, 0).Point({ 0, 0, 0 });
  EXPECT_NEAR(p.x, 0, 1e-12);
  EXPECT_NEAR(p.y, 1, 1e-12);
  EXPECT_NEAR(p.z, 7, 1e-12);
  part->VisibilityOff();
  EXPECT_TRUE(SceneFromRenderer(s.Renderer)->Instances.empty());
}

TEST(SceneFromRenderer, WhatCannotBeTracedIsNamed)
{
  Stage s;
  vtkNew<vtkVolume> volume;
  vtkNew<vtkActor2D> text;
  auto wire = ActorOf(Square()), cut = ActorOf(Square()), none = vtkSmartPointer<vtkActor>::New();
  wire->GetProperty()->SetRepresentationToWireframe();
  vtkNew<vtkPlane> plane;
  cut->GetMapper()->AddClippingPlane(plane);
  none->SetMapper(vtkNew<vtkPolyDataMapper>());
  s.Renderer->AddVolume(volume);
  s.Renderer->AddActor2D(text);
  s.Renderer->AddActor(wire);
  s.Renderer->AddActor(cut);
  s.Renderer->AddActor(none);
  const auto scene = SceneFromRenderer(s.Renderer);
  EXPECT_EQ(scene->Instances.size(), 1u);
  EXPECT_TRUE(Mentions(scene->Warnings, "actor 0 (vtkVolume): left out"));
  EXPECT_TRUE(Mentions(scene->Warnings, "actor 1 (vtkActor2D): left out"));
  EXPECT_TRUE(Mentions(scene->Warnings, "actor 2: left out: drawn as wireframe"));
  EXPECT_TRUE(Mentions(scene->Warnings, "actor 3: clipping planes"));
  EXPECT_TRUE(Mentions(scene->Warnings, "actor 4: left out: its mapper has no input"));
  EXPECT_THROW(SceneFromRenderer(nullptr), quell::SceneError);
}

TEST(SceneFromRenderer, MapperColoursAndTheProgramsMapperStaysAsItWas)
{
  Stage s;
  auto data = Square();
  data->GetPointData()->SetScalars(Values<vtkFloatArray>("s", 1, { 0, 1, 0, 1 }));
  auto actor = ActorOf(data);
  vtkNew<vtkLookupTable> table;
  table->SetNumberOfTableValues(2);
  table->SetTableValue(0, 1, 0, 0);
  table->SetTableValue(1, 0, 0, 1);
  actor->GetMapper()->SetLookupTable(table);
  actor->GetMapper()->SetScalarRange(0, 1);
  s.Renderer->AddActor(actor);
  const auto scene = SceneFromRenderer(s.Renderer);
  ASSERT_EQ(scene->Meshes.at(0).Colors.size(), 4u);
  EXPECT_EQ(scene->Meshes[0].Colors[0].x, 1);
  EXPECT_EQ(scene->Meshes[0].Colors[1].z, 1);
  const vtkMTimeType before = actor->GetMapper()->GetMTime();
  SceneFromRenderer(s.Renderer);
  EXPECT_EQ(actor->GetMapper()->GetMTime(), before);
  actor->GetMapper()->ScalarVisibilityOff();
  EXPECT_TRUE(SceneFromRenderer(s.Renderer)->Meshes.at(0).Colors.empty());
}

TEST(SceneFromRenderer, BlockAttributes)
{
  Stage s;
  vtkNew<vtkMultiBlockDataSet> blocks;
  auto red = Square(0), half = Square(1), gone = Square(2);
  red->GetPointData()->SetScalars(Values<vtkFloatArray>("s", 1, { 0, 1, 0, 1 }));
  blocks->SetBlock(0, red);
  blocks->SetBlock(1, half);
  blocks->SetBlock(2, gone);
  // The abstract mapper refuses composite data, OpenGL's take it; the walk is the same.
  vtkNew<vtkActor> actor;
  class AnyMapper : public vtkPolyDataMapper
  {
  public:
    static AnyMapper* New()
    {
      auto made = new AnyMapper;
      made->InitializeObjectBase();
      return made;
    }
    int FillInputPortInformation(int, vtkInformation* info) override
    {
      info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), "vtkDataObject");
      return 1;
    }
    void Update() override { this->GetInputAlgorithm()->Update(); }
    void Update(int) override { this->Update(); }
  };
  vtkNew<AnyMapper> mapper;
  mapper->SetInputDataObject(blocks);
  actor->SetMapper(mapper);
  s.Renderer->AddActor(actor);
  EXPECT_EQ(SceneFromRenderer(s.Renderer)->Instances.size(), 3u);
  vtkNew<vtkCompositeDataDisplayAttributes> attributes;
  const double color[3] = { 1, 0, 0 };
  attributes->SetBlockColor(red, color);
  attributes->SetBlockOpacity(half, 0.5);
  attributes->SetBlockVisibility(gone, false);
  RendererOptions options;
  options.BlockAttributes = [&](vtkMapper* m) { return m == mapper ? attributes.Get() : nullptr; };
  const auto scene = SceneFromRenderer(s.Renderer, options);
  ASSERT_EQ(scene->Instances.size(), 2u);
  const quell::Material& first = scene->Materials.at(std::size_t(scene->Meshes[0].Material));
  EXPECT_EQ(first.BaseColor, quell::Vec3f(1, 0, 0));
  EXPECT_TRUE(scene->Meshes[0].Colors.empty()) << "a block's colour goes before scalars";
  EXPECT_EQ(scene->Materials.at(std::size_t(scene->Meshes[1].Material)).Alpha, 0.5f);
}

TEST(SceneFromRenderer, TexturesOfActorsAndProperties)
{
  Stage s;
  vtkNew<vtkImageData> image;
  image->SetDimensions(1, 1, 1);
  image->GetPointData()->SetScalars(Values<vtkUnsignedCharArray>("rgb", 3, { 128, 255, 0 }));
  vtkNew<vtkTexture> texture;
  texture->SetInputData(image);
  texture->RepeatOff();
  auto data = Square();
  data->GetPointData()->SetTCoords(Values<vtkFloatArray>("uv", 2, { 0, 0, 1, 0, 1, 1, 0, 1 }));
  auto painted = ActorOf(data), pbr = ActorOf(data);
  painted->SetTexture(texture);
  pbr->GetProperty()->SetInterpolationToPBR();
  pbr->GetProperty()->SetORMTexture(texture);
  vtkNew<vtkTexture> glow; // VTK wants it marked
  glow->SetInputData(image);
  glow->UseSRGBColorSpaceOn();
  pbr->GetProperty()->SetEmissiveTexture(glow);
  pbr->GetProperty()->SetEmissiveFactor(2, 2, 2);
  s.Renderer->AddActor(painted);
  s.Renderer->AddActor(pbr);
  const auto scene = SceneFromRenderer(s.Renderer);
  ASSERT_EQ(scene->Materials.size(), 2u);
  const quell::TextureUse use = scene->Materials[0].BaseColorTexture;
  ASSERT_GE(use.Texture, 0);
  EXPECT_EQ(scene->Textures[std::size_t(use.Texture)].WrapS, quell::Wrap::Clamp);
  EXPECT_NEAR(scene->Textures[std::size_t(use.Texture)].Sample(0.5f, 0.5f).x, SrgbToLinear(128 / 255.), 1e-6);
  const quell::Material& m = scene->Materials[1];
  ASSERT_GE(m.MetallicRoughnessTexture.Texture, 0);
  EXPECT_NEAR(scene->Textures[std::size_t(m.MetallicRoughnessTexture.Texture)].Sample(0, 0).x, 128 / 255., 1e-6)
    << "numbers are not decoded";
  EXPECT_GE(m.EmissiveTexture.Texture, 0);
  EXPECT_EQ(m.Emission.x, 2);
}

namespace
{
/// Where our camera sees a point and where VTK's own matrix puts it.
void ExpectSameView(vtkRenderer* renderer, vtkCamera* camera, int width, int height)
{
  RendererOptions options;
  options.Width = width;
  options.Height = height;
  const auto scene = SceneFromRenderer(renderer, options);
  ASSERT_EQ(scene->Cameras.size(), 1u);
  const quell::CameraModel& model = scene->Cameras[0];
  const quell::Camera ours(model, scene->WorldMatrices(0).at(std::size_t(model.Node)), Vec3d(), width, height);
  vtkMatrix4x4* vtks = camera->GetCompositeProjectionTransformMatrix(double(width) / height, -1, 1);
  int seen = 0;
  for (const Vec3d& p : { Vec3d(0, 0, 0), Vec3d(1, 0, 0), Vec3d(0, 1, 0), Vec3d(0.3, -0.7, 0.9), Vec3d(-1, 0.5, -2) })
  {
    const double in[4] = { p.x, p.y, p.z, 1 };
    double out[4];
    vtks->MultiplyPoint(in, out);
    quell::Vec2<double> pixel;
    ASSERT_TRUE(ours.Project(p, 1, pixel));
    EXPECT_NEAR(pixel.x, (out[0] / out[3] + 1) / 2 * width, 1e-6 * width);
    EXPECT_NEAR(pixel.y, (out[1] / out[3] + 1) / 2 * height, 1e-6 * height);
    seen += pixel.x > 0 && pixel.x < width && pixel.y > 0 && pixel.y < height;
  }
  EXPECT_GT(seen, 0);
}
}

TEST(SceneFromRenderer, CameraProjectsAsVtkDoes)
{
  Stage s;
  s.Camera->SetPosition(3, 2, 6);
  s.Camera->SetFocalPoint(0.2, -0.1, 0.3);
  s.Camera->SetViewUp(0.3, 1, 0.1);
  s.Camera->SetViewAngle(41);
  ExpectSameView(s.Renderer, s.Camera, 320, 200);
  s.Camera->UseHorizontalViewAngleOn();
  ExpectSameView(s.Renderer, s.Camera, 320, 200);
  s.Camera->UseHorizontalViewAngleOff();
  s.Camera->Roll(30);
  ExpectSameView(s.Renderer, s.Camera, 200, 320);
  s.Camera->ParallelProjectionOn();
  s.Camera->SetParallelScale(2.5);
  ExpectSameView(s.Renderer, s.Camera, 320, 200);
}

TEST(SceneFromRenderer, SizeOfTheWindowAndOfTheViewport)
{
  Stage s;
  vtkNew<vtkRenderWindow> window;
  window->SetSize(320, 200);
  window->AddRenderer(s.Renderer);
  s.Renderer->SetViewport(0.5, 0, 1, 1);
  const auto scene = SceneFromRenderer(s.Renderer);
  EXPECT_EQ(scene->Resolution[0], 160);
  EXPECT_EQ(scene->Resolution[1], 200);
  s.Camera->SetWindowCenter(0.5, 0);
  EXPECT_TRUE(Mentions(SceneFromRenderer(s.Renderer)->Warnings, "WindowCenter"));
}

TEST(SceneFromRenderer, ARendererWithoutCameraSeesEverything)
{
  vtkNew<vtkRenderer> renderer;
  auto actor = ActorOf(Square());
  actor->SetPosition(100, 0, 0);
  renderer->AddActor(actor);
  const auto scene = SceneFromRenderer(renderer);
  ASSERT_EQ(scene->Cameras.size(), 1u);
  const quell::CameraModel& model = scene->Cameras[0];
  const quell::Camera camera(model, scene->WorldMatrices(0).at(std::size_t(model.Node)), Vec3d(), 100, 100);
  quell::Vec2<double> pixel;
  ASSERT_TRUE(camera.Project({ 100, 0, 0 }, 1, pixel));
  EXPECT_NEAR(pixel.x, 50, 1e-6);
}

TEST(SceneFromRenderer, LightsKeepTheirPlaceAndPower)
{
  Stage s;
  const auto only = [&]()
  {
    const auto scene = SceneFromRenderer(s.Renderer);
    EXPECT_EQ(scene->Lights.size(), 1u);
    return std::make_pair(scene->Lights.at(0), scene->WorldMatrices(0).at(std::size_t(scene->Lights.at(0).Node)));
  };
  const auto headlight = only();
  EXPECT_EQ(headlight.first.Type, quell::LightType::Directional);
  EXPECT_NEAR(headlight.first.Intensity.x, Pi, 1e-5);
  EXPECT_NEAR(headlight.second.Direction({ 0, 0, -1 }).z, -1, 1e-12);
  EXPECT_EQ(s.Renderer->GetLights()->GetNumberOfItems(), 0) << "none is added to the program's renderer";

  vtkNew<vtkLight> lamp;
  lamp->SetPosition(0, 4, 0);
  lamp->SetFocalPoint(0, 0, 0);
  lamp->SetPositional(1);
  lamp->SetConeAngle(90);
  lamp->SetIntensity(0.5);
  lamp->SetColor(1, 0.5, 0);
  s.Renderer->AddLight(lamp);
  const auto point = only();
  EXPECT_EQ(point.first.Type, quell::LightType::Point);
  EXPECT_NEAR(point.first.Intensity.x, 0.5 * Pi * 16, 1e-4) << "as bright at 4 as VTK's, which does not fall off";
  EXPECT_NEAR(point.first.Intensity.y, 0.5 * Pi * 16 * SrgbToLinear(0.5), 1e-4);
  EXPECT_NEAR(point.second.Point({ 0, 0, 0 }).y, 4, 1e-12);
  EXPECT_NEAR(point.second.Direction({ 0, 0, -1 }).y, -1, 1e-12);
  lamp->SetAttenuationValues(0, 0, 2);
  EXPECT_NEAR(only().first.Intensity.x, 0.5 * Pi / 2, 1e-5);
  lamp->SetConeAngle(20);
  const auto spot = only();
  EXPECT_EQ(spot.first.Type, quell::LightType::Spot);
  EXPECT_NEAR(spot.first.OuterCone, 20 * Pi / 180, 1e-6);
  EXPECT_NEAR(spot.first.InnerCone, 20 * Pi / 180, 1e-6) << "a hard edge, as in VTK";
  lamp->SetConeAngle(40);
  lamp->SetExponent(50);
  const auto narrow = only();
  const double half = std::acos(std::pow(0.5, 1. / 50)), c = std::cos(half), o = std::cos(narrow.first.OuterCone);
  EXPECT_EQ(narrow.first.InnerCone, 0);
  EXPECT_LT(narrow.first.OuterCone, 39 * Pi / 180);
  EXPECT_NEAR(std::pow((c - o) / (1 - o), 2), 0.5, 1e-4) << "the same half width";

  lamp->SetPositional(0);
  lamp->SetLightTypeToCameraLight();
  lamp->SetPosition(0, 0, 1); // the camera's own place
  lamp->SetFocalPoint(0, 0, 0);
  s.Camera->SetPosition(5, 0, 0);
  const auto camera = only();
  EXPECT_NEAR(camera.second.Direction({ 0, 0, -1 }).x, -1, 1e-12);
  lamp->SetSwitch(0);
  EXPECT_NEAR(only().first.Intensity.x, Pi, 1e-5) << "no light is on: a headlight, as VTK makes it";
  s.Renderer->AutomaticLightCreationOff();
  EXPECT_TRUE(SceneFromRenderer(s.Renderer)->Lights.empty());
}

TEST(SceneFromRenderer, BackgroundsAreBlackOrASky)
{
  Stage s;
  s.Renderer->SetBackground(1, 0, 0);
  s.Renderer->SetBackground2(0, 0, 1);
  EXPECT_FALSE(SceneFromRenderer(s.Renderer)->Sky.Present);
  RendererOptions options;
  options.Background = RendererOptions::Backdrop::Sky;
  const auto plain = SceneFromRenderer(s.Renderer, options);
  EXPECT_TRUE(plain->Sky.Present);
  EXPECT_EQ(plain->Sky.Color, quell::Vec3f(1, 0, 0));
  s.Renderer->GradientBackgroundOn();
  const auto gradient = SceneFromRenderer(s.Renderer, options);
  ASSERT_GE(gradient->Sky.Texture, 0);
  const quell::Texture& t = gradient->Textures[std::size_t(gradient->Sky.Texture)];
  EXPECT_GT(t.Sample(0.5f, 0.01f).z, 0.9) << "Background2 is above";
  EXPECT_GT(t.Sample(0.5f, 0.99f).x, 0.9);
}

TEST(SceneFromRenderer, EnvironmentTexturesTurnToOurAxes)
{
  // Columns of VTK's image look along -x (edge), -z, +x, +z (quarters): u = atan2(z, x) / 2 pi + 1/2.
  Stage s;
  vtkNew<vtkImageData> image;
  image->SetDimensions(8, 2, 1);
  vtkNew<vtkFloatArray> rgb;
  rgb->SetNumberOfComponents(3);
  for (int y = 0; y < 2; ++y)
    for (int x = 0; x < 8; ++x)
      rgb->InsertNextTuple3(x, y, 0);
  image->GetPointData()->SetScalars(rgb);
  vtkNew<vtkTexture> texture;
  texture->SetInputData(image);
  texture->SetColorModeToDirectScalars();
  s.Renderer->SetEnvironmentTexture(texture);
  EXPECT_FALSE(SceneFromRenderer(s.Renderer)->Sky.Present) << "image-based lighting is off";
  s.Renderer->UseImageBasedLightingOn();
  const auto scene = SceneFromRenderer(s.Renderer);
  ASSERT_GE(scene->Sky.Texture, 0);
  const quell::Texture& sky = scene->Textures[std::size_t(scene->Sky.Texture)];
  ASSERT_EQ(sky.Width, 8);
  // Our column x + 1/2 of 8 is VTK's two to the left: the centre looks along -z, a quarter of VTK's width.
  for (int x = 0; x < 8; ++x)
    EXPECT_NEAR(sky.Floats[4 * std::size_t(x)], (x + 6) % 8, 1e-3) << x;
  EXPECT_NEAR(sky.Floats[1], 1, 1e-3) << "VTK's row 1 is the upper one";
  EXPECT_NEAR(sky.Floats[4 * 8 + 1], 0, 1e-3);
}

TEST(SceneRecorder, MovedActorsHaveTheirFormerPoseOneTickAgo)
{
  Stage s;
  auto actor = ActorOf(Square()), still = ActorOf(Square());
  s.Renderer->AddActor(actor);
  s.Renderer->AddActor(still);
  quell::SceneRecorder recorder;
  const auto record = [&](int tick)
  {
    recorder.Begin(tick, 30);
    recorder.AddRenderer(s.Renderer);
    return recorder.Finish();
  };
  actor->SetPosition(1000, 0, 0);
  actor->SetScale(1, 2, 1);
  const auto first = record(4);
  EXPECT_FALSE(first->Animated());
  quell::Mat4 before = WorldOf(*first, 0);
  const auto expect = [](const quell::Mat4& a, const quell::Mat4& b, double tolerance)
  {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 4; ++j)
        EXPECT_NEAR(a.m[i][j], b.m[i][j], tolerance) << i << j;
  };
  // Rotation under a scale: the way from there to here is a shear too.
  actor->SetPosition(1001, 0.5, 0);
  actor->RotateZ(20);
  actor->SetScale(1, 2, 1.5);
  const auto second = record(5);
  EXPECT_TRUE(second->Animated());
  expect(WorldOf(*second, 0, 4 / 30.), before, 2e-5);
  expect(WorldOf(*second, 0, 5 / 30.), quell::Mat4(WorldOf(*record(5), 0, 5 / 30.)), 1e-12);
  double out[4];
  const double in[4] = { 1, 1, 0, 1 };
  actor->GetMatrix()->MultiplyPoint(in, out);
  EXPECT_NEAR(WorldOf(*second, 0, 5 / 30.).Point({ 1, 1, 0 }).x, out[0], 1e-9) << "this frame is exact";
  EXPECT_FALSE(second->Moves(second->Instances[1]));
  EXPECT_EQ(second->Instances[0].Id, first->Instances[0].Id);

  // The same tick again: still relative to tick 4.
  const auto again = record(5);
  expect(WorldOf(*again, 0, 4 / 30.), before, 2e-5);
  // Nothing moved since; and after a jump nothing moves.
  EXPECT_FALSE(record(6)->Animated());
  actor->SetPosition(0, 0, 0);
  EXPECT_FALSE(record(9)->Animated());
  // A frame in which nothing was recorded anew counts.
  before = WorldOf(*record(10), 0);
  recorder.Repeat(11);
  actor->SetPosition(0, 1, 0);
  const auto later = record(12);
  EXPECT_TRUE(later->Animated());
  expect(WorldOf(*later, 0, 11 / 30.), before, 1e-6);
}

TEST(SceneRecorder, IdsBelongToActorsForLife)
{
  Stage s;
  auto a = ActorOf(Square()), b = ActorOf(Square());
  s.Renderer->AddActor(a);
  s.Renderer->AddActor(b);
  quell::SceneRecorder recorder;
  recorder.Begin(0);
  recorder.AddRenderer(s.Renderer);
  EXPECT_EQ(recorder.Finish()->Instances.at(1).Id, 2);
  s.Renderer->RemoveActor(a);
  auto c = ActorOf(Square());
  s.Renderer->AddActor(c);
  recorder.Begin(1);
  recorder.AddRenderer(s.Renderer);
  const auto scene = recorder.Finish();
  ASSERT_EQ(scene->Instances.size(), 2u);
  EXPECT_EQ(scene->Instances[0].Id, 2);
  EXPECT_EQ(scene->Instances[1].Id, 3);
}

TEST(SceneRecorder, DataThatDeformsIsAMorph)
{
  auto data = Square();
  quell::SceneRecorder recorder;
  const auto record = [&](int tick)
  {
    recorder.Begin(tick, 1);
    recorder.AddData(data);
    return recorder.Finish();
  };
  record(0);
  data = Square();
  data->GetPoints()->SetPoint(2, 1, 1, 3);
  const auto scene = record(1);
  ASSERT_EQ(scene->Meshes.at(0).Targets.size(), 1u);
  EXPECT_TRUE(scene->Deforms(scene->Instances[0]));
  std::vector<quell::Vec3f> now, before;
  scene->Deform(scene->Instances[0], scene->PoseAt(1), Vec3d(), now, nullptr, nullptr);
  scene->Deform(scene->Instances[0], scene->PoseAt(0), Vec3d(), before, nullptr, nullptr);
  float highest = 0, former = 0;
  for (std::size_t i = 0; i < now.size(); ++i)
  {
    highest = std::max(highest, now[i].z);
    former = std::max(former, before[i].z);
  }
  EXPECT_EQ(highest, 3);
  EXPECT_EQ(former, 0);
  // Other triangles: another surface, without motion.
  data = Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 } }, { { 0, 1, 2 } });
  EXPECT_FALSE(record(2)->Animated());
}
