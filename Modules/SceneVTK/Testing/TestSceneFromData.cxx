// SPDX-License-Identifier: BSD-3-Clause
#include "SceneTesting.h"
#include "vtkCellData.h"
#include "vtkCellTypes.h"
#include "vtkColorTransferFunction.h"
#include "vtkCompositeDataSet.h"
#include "vtkInformation.h"
#include "vtkLookupTable.h"
#include "vtkMultiBlockDataSet.h"
#include "vtkPartitionedDataSet.h"
#include "vtkPartitionedDataSetCollection.h"
#include "vtkSphereSource.h"
#include "vtkStripper.h"
#include "vtkTable.h"
#include "vtkUnstructuredGrid.h"

#include <gtest/gtest.h>

#include <limits>

using namespace testing_scene;
using quell::DataMaterial;
using quell::SceneFromData;

TEST(SceneFromData, KeepsTrianglesAndSharesPoints)
{
  auto data =
    Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 }, { 9, 9, 9 } }, { { 0, 1, 2 }, { 0, 2, 3 } });
  const auto scene = SceneFromData(data);
  ASSERT_EQ(scene->Meshes.size(), 1u);
  EXPECT_EQ(scene->Meshes[0].Positions.size(), 4u) << "the point that no cell uses is not carried";
  EXPECT_EQ(scene->Meshes[0].Indices, (std::vector<std::uint32_t>{ 0, 1, 2, 0, 2, 3 }));
  EXPECT_TRUE(scene->Materials.at(scene->Meshes[0].Material).DoubleSided);
  EXPECT_EQ(scene->Materials[0].Specular, 0) << "VTK's default is Lambert";
  EXPECT_TRUE(scene->Warnings.empty());
}

TEST(SceneFromData, ConcavePolygonsAndQuadsKeepTheirArea)
{
  // An L of area 3, and a dart of area 1 whose diagonal 1-3 lies outside.
  auto corner = Polygons(
    { { 0, 0, 0 }, { 2, 0, 0 }, { 2, 1, 0 }, { 1, 1, 0 }, { 1, 2, 0 }, { 0, 2, 0 } }, { { 0, 1, 2, 3, 4, 5 } });
  EXPECT_NEAR(Area(SceneFromData(corner)->Meshes.at(0)), 3, 1e-6);
  for (int turn = 0; turn < 4; ++turn)
  {
    const std::vector<vtkIdType> ids{ turn % 4, (turn + 1) % 4, (turn + 2) % 4, (turn + 3) % 4 };
    auto dart = Polygons({ { 0, 0, 0 }, { 2, -1, 0 }, { 1, 0, 0 }, { 2, 1, 0 } }, { ids });
    EXPECT_NEAR(Area(SceneFromData(dart)->Meshes.at(0)), 1, 1e-6) << turn;
  }
}

TEST(SceneFromData, StripsKeepOrientation)
{
  vtkNew<vtkSphereSource> sphere;
  sphere->SetThetaResolution(12);
  sphere->SetPhiResolution(9);
  vtkNew<vtkStripper> stripper;
  stripper->SetInputConnection(sphere->GetOutputPort());
  stripper->Update();
  ASSERT_GT(stripper->GetOutput()->GetNumberOfStrips(), 0);
  sphere->Update();
  const auto strips = SceneFromData(stripper->GetOutput()), triangles = SceneFromData(sphere->GetOutput());
  const quell::Mesh &a = strips->Meshes.at(0), &b = triangles->Meshes.at(0);
  EXPECT_EQ(a.Indices.size(), b.Indices.size());
  EXPECT_NEAR(Area(a), Area(b), 1e-5);
  for (std::size_t i = 0; i + 2 < a.Indices.size(); i += 3)
  {
    const quell::Vec3f p = a.Positions[a.Indices[i]];
    EXPECT_GT(Dot(Cross(a.Positions[a.Indices[i + 1]] - p, a.Positions[a.Indices[i + 2]] - p), p), 0);
  }
}

TEST(SceneFromData, NormalsOfPointsAndCells)
{
  auto data = Square();
  data->GetPointData()->SetNormals(Values<vtkFloatArray>("n", 3, { 0, 0, 2, 1, 0, 1, 0, 0, 0, 0, 1, 1 }));
  const auto smooth = SceneFromData(data);
  ASSERT_EQ(smooth->Meshes[0].Normals.size(), 4u);
  EXPECT_FLOAT_EQ(smooth->Meshes[0].Normals[0].z, 1) << "unit length";
  for (const quell::Vec3f& n : smooth->Meshes[0].Normals)
    EXPECT_NEAR(Length(n), 1, 1e-6) << "a normal without length is the triangle's own";

  DataMaterial flat;
  flat.Interpolation = DataMaterial::Flat;
  EXPECT_TRUE(SceneFromData(data, flat)->Meshes[0].Normals.empty());

  auto cells = Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 } }, { { 0, 1, 2 }, { 0, 2, 3 } });
  cells->GetCellData()->SetNormals(Values<vtkFloatArray>("n", 3, { 0, 0, 1, 0, 0, -1 }));
  const auto split = SceneFromData(cells);
  ASSERT_EQ(split->Meshes[0].Normals.size(), 6u);
  EXPECT_EQ(split->Meshes[0].Normals[0].z, 1);
  EXPECT_EQ(split->Meshes[0].Normals[5].z, -1);
}

TEST(SceneFromData, TextureCoordinatesPointDown)
{
  auto data = Square();
  data->GetPointData()->SetTCoords(Values<vtkFloatArray>("uv", 2, { 0, 0, 1, 0, 1, 0.75, 0, 1 }));
  const auto scene = SceneFromData(data);
  ASSERT_EQ(scene->Meshes[0].TexCoords[0].size(), 4u);
  EXPECT_FLOAT_EQ(scene->Meshes[0].TexCoords[0][0].y, 1);
  EXPECT_FLOAT_EQ(scene->Meshes[0].TexCoords[0][2].y, 0.25f);
}

TEST(SceneFromData, PointScalarsThroughATable)
{
  auto data = Square();
  data->GetPointData()->SetScalars(Values<vtkDoubleArray>("s", 1, { 0, 1, 2, 3 }));
  DataMaterial m;
  vtkNew<vtkLookupTable> table;
  table->SetNumberOfTableValues(4);
  table->SetTableValue(0, 1, 0, 0, 1);
  table->SetTableValue(1, 0, 1, 0, 1);
  table->SetTableValue(2, 0, 0, 0.5, 1);
  table->SetTableValue(3, 1, 1, 1, 0.25);
  table->SetTableRange(0, 3);
  m.LookupTable = table;
  m.DiffuseColor = { 0.1, 0.2, 0.3 };
  const auto scene = SceneFromData(data, m);
  const auto& c = scene->Meshes[0].Colors;
  ASSERT_EQ(c.size(), 4u);
  EXPECT_FLOAT_EQ(c[0].x, 1);
  EXPECT_FLOAT_EQ(c[0].y, 0);
  EXPECT_FLOAT_EQ(c[1].y, 1);
  EXPECT_NEAR(c[2].z, SrgbToLinear(127 / 255.), 0.005) << "decoded from display";
  EXPECT_NEAR(c[3].w, 0.25, 0.005);
  EXPECT_EQ(scene->Materials[0].BaseColor.x, 1) << "scalars replace the colour";
  EXPECT_EQ(scene->Materials[0].Mode, quell::AlphaMode::Blend) << "some are see-through";

  m.ScalarRange[0] = 3;
  m.ScalarRange[1] = 6; // everything is at or below the first colour
  const auto low = SceneFromData(data, m);
  ASSERT_EQ(low->Meshes[0].Colors.size(), 4u);
  for (const auto& l : low->Meshes[0].Colors)
    EXPECT_FLOAT_EQ(l.x, 1);

  m.ScalarVisibility = false;
  const auto plain = SceneFromData(data, m);
  EXPECT_TRUE(plain->Meshes[0].Colors.empty());
  EXPECT_NEAR(plain->Materials[0].BaseColor.y, SrgbToLinear(0.2), 1e-6);
  m.DisplayColors = false;
  EXPECT_FLOAT_EQ(SceneFromData(data, m)->Materials[0].BaseColor.y, 0.2f);
}

TEST(SceneFromData, ScalarsWithoutATableSpanTheirRange)
{
  auto data = Square();
  data->GetPointData()->SetScalars(Values<vtkFloatArray>("s", 1, { -5, 5, 5, 5 }));
  const auto scene = SceneFromData(data);
  const auto& c = scene->Meshes[0].Colors;
  ASSERT_EQ(c.size(), 4u);
  EXPECT_GT(c[0].x, 0.99) << "VTK's default table: red first";
  EXPECT_LT(c[0].z, 0.01);
  EXPECT_GT(c[1].z, 0.99) << "blue last";
  EXPECT_LT(c[1].x, 0.01);
}

TEST(SceneFromData, NamedVectorArraysByComponent)
{
  auto data = Square();
  data->GetPointData()->AddArray(Values<vtkFloatArray>("v", 3, { 0, 9, 0, 1, 9, 0, 0, 9, 0, 1, 9, 0 }));
  DataMaterial m;
  vtkNew<vtkColorTransferFunction> black2white;
  black2white->AddRGBPoint(0, 0, 0, 0);
  black2white->AddRGBPoint(1, 1, 1, 1);
  m.LookupTable = black2white;
  EXPECT_TRUE(SceneFromData(data, m)->Meshes[0].Colors.empty()) << "no active scalars";
  m.ScalarArray = "v";
  const auto scene = SceneFromData(data, m);
  ASSERT_EQ(scene->Meshes[0].Colors.size(), 4u);
  EXPECT_FLOAT_EQ(scene->Meshes[0].Colors[0].x, 0);
  EXPECT_FLOAT_EQ(scene->Meshes[0].Colors[1].x, 1);
  m.ScalarComponent = 1;
  const auto second = SceneFromData(data, m);
  ASSERT_EQ(second->Meshes[0].Colors.size(), 4u);
  for (const auto& c : second->Meshes[0].Colors)
    EXPECT_FLOAT_EQ(c.x, 1);
}

TEST(SceneFromData, CellScalarsColourWholeCells)
{
  auto data =
    Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 }, { 0.5, 2, 0 } }, { { 0, 1, 2, 3 }, { 3, 2, 4 } });
  vtkNew<vtkCellArray> lines; // numbered before polygons
  const vtkIdType line[2] = { 0, 1 };
  lines->InsertNextCell(2, line);
  data->SetLines(lines);
  data->GetCellData()->SetScalars(Values<vtkUnsignedCharArray>("rgb", 3, { 0, 0, 0, 255, 0, 0, 0, 255, 0 }));
  const auto scene = SceneFromData(data);
  const quell::Mesh& mesh = scene->Meshes[0];
  ASSERT_EQ(mesh.Colors.size(), 9u) << "three triangles of their own corners";
  for (int i = 0; i < 6; ++i)
    EXPECT_EQ(mesh.Colors[std::size_t(i)].x, 1);
  for (int i = 6; i < 9; ++i)
    EXPECT_EQ(mesh.Colors[std::size_t(i)].y, 1);
  EXPECT_TRUE(Mentions(scene->Warnings, "1 line left out"));
}

TEST(SceneFromData, ByteColoursAreDisplayValues)
{
  auto data = Square();
  data->GetPointData()->SetScalars(
    Values<vtkUnsignedCharArray>("rgba", 4, { 128, 0, 0, 255, 0, 128, 0, 255, 0, 0, 128, 255, 255, 255, 255, 51 }));
  const auto scene = SceneFromData(data);
  const auto& c = scene->Meshes[0].Colors;
  ASSERT_EQ(c.size(), 4u);
  EXPECT_NEAR(c[0].x, SrgbToLinear(128 / 255.), 1e-6);
  EXPECT_NEAR(c[1].y, SrgbToLinear(128 / 255.), 1e-6);
  EXPECT_NEAR(c[3].w, 0.2, 1e-6) << "alpha is linear";
  EXPECT_EQ(scene->Materials[0].Mode, quell::AlphaMode::Blend);
}

TEST(SceneFromData, ScalarsInterpolatedBeforeMappingBecomeATexture)
{
  auto data = Square();
  data->GetPointData()->SetScalars(Values<vtkFloatArray>("s", 1, { 0, 1, 1, 0 }));
  data->GetPointData()->SetTCoords(Values<vtkFloatArray>("uv", 2, { 0, 0, 1, 0, 1, 1, 0, 1 }));
  DataMaterial m;
  m.InterpolateScalarsBeforeMapping = true;
  vtkNew<vtkLookupTable> table; // red, then green in the middle, then blue
  table->SetNumberOfTableValues(3);
  table->SetTableValue(0, 1, 0, 0);
  table->SetTableValue(1, 0, 1, 0);
  table->SetTableValue(2, 0, 0, 1);
  table->SetTableRange(0, 1);
  m.LookupTable = table;
  const auto scene = SceneFromData(data, m);
  const quell::Mesh& mesh = scene->Meshes[0];
  const quell::Material& material = scene->Materials[0];
  EXPECT_TRUE(mesh.Colors.empty());
  ASSERT_GE(material.BaseColorTexture.Texture, 0);
  EXPECT_EQ(material.BaseColorTexture.TexCoord, 1) << "the data's own coordinates stay";
  ASSERT_EQ(mesh.TexCoords[1].size(), 4u);
  const quell::Texture& map = scene->Textures[std::size_t(material.BaseColorTexture.Texture)];
  const quell::Vec2f a = mesh.TexCoords[1][0], b = mesh.TexCoords[1][1];
  const quell::Vec4f middle = map.Sample((a.x + b.x) / 2, (a.y + b.y) / 2);
  EXPECT_GT(middle.y, 0.9) << "the middle is green, not a mixture of red and blue";
  EXPECT_GT(map.Sample(a.x, a.y).x, 0.9);
  EXPECT_GT(map.Sample(b.x, b.y).z, 0.9);
}

TEST(SceneFromData, PhongBecomesALobeOfTheSameWidthAndPeak)
{
  DataMaterial m;
  m.Interpolation = DataMaterial::Phong;
  m.Specular = 0.5;
  m.SpecularPower = 30;
  const auto phong = SceneFromData(Square(), m);
  const quell::Material& out = phong->Materials[0];
  const double alpha2 = 2. / 32;
  EXPECT_NEAR(out.Roughness * out.Roughness, std::sqrt(alpha2), 1e-6);
  EXPECT_EQ(out.Specular, 1);
  EXPECT_NEAR(0.04 * out.SpecularColor.x / (4 * alpha2), 0.5, 1e-6) << "peak under a light of intensity 1";
  m.Specular = 1;
  m.SpecularPower = 1;
  EXPECT_NEAR(0.04 * SceneFromData(Square(), m)->Materials[0].SpecularColor.x, 1, 1e-6) << "never above Specular";

  m = DataMaterial();
  m.Lighting = false;
  m.DiffuseColor = { 0.5, 0.5, 0.5 };
  EXPECT_TRUE(SceneFromData(Square(), m)->Materials[0].Unlit);
  EXPECT_NEAR(SceneFromData(Square(), m)->Materials[0].BaseColor.x, SrgbToLinear(0.5), 1e-6);

  m = DataMaterial();
  m.Ambient = 0.5;
  EXPECT_EQ(SceneFromData(Square(), m)->Materials[0].Emission, quell::Vec3f());
  m.AmbientEmits = true;
  EXPECT_NEAR(SceneFromData(Square(), m)->Materials[0].Emission.y, SrgbToLinear(0.5), 1e-6);

  m = DataMaterial();
  m.Interpolation = DataMaterial::PBR;
  m.Metallic = 0.75;
  m.Roughness = 0.25;
  m.BaseIOR = 1.7;
  m.CoatStrength = 0.5;
  m.CoatRoughness = 0.125;
  m.Opacity = 0.5;
  const auto pbr = SceneFromData(Square(), m);
  const quell::Material& p = pbr->Materials[0];
  EXPECT_EQ(p.Metallic, 0.75f);
  EXPECT_EQ(p.Roughness, 0.25f);
  EXPECT_EQ(p.Ior, 1.7f);
  EXPECT_EQ(p.Clearcoat, 0.5f);
  EXPECT_EQ(p.ClearcoatRoughness, 0.125f);
  EXPECT_EQ(p.Alpha, 0.5f);
  EXPECT_EQ(p.Mode, quell::AlphaMode::Blend);

  m.Metallic = 7;
  m.Roughness = std::nan("");
  const auto odd = SceneFromData(Square(), m);
  EXPECT_EQ(odd->Materials[0].Metallic, 1);
  EXPECT_TRUE(Mentions(odd->Warnings, "Metallic, Roughness out of range"));
}

TEST(SceneFromData, TexturesTurnUpright)
{
  // Bottom row red and green, top row blue and white.
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetDimensions(2, 2, 1);
  image->GetPointData()->SetScalars(
    Values<vtkUnsignedCharArray>("rgb", 3, { 255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255 }));
  auto data = Square();
  data->GetPointData()->SetTCoords(Values<vtkFloatArray>("uv", 2, { 0, 0, 1, 0, 1, 1, 0, 1 }));
  DataMaterial m;
  m.ColorTexture.Image = image;
  m.ColorTexture.Interpolate = false;
  m.ColorTexture.Wrapping = quell::Wrap::Clamp;
  const auto colour = [&](double u, double v)
  {
    const auto scene = SceneFromData(data, m);
    const quell::TextureUse& use = scene->Materials[0].BaseColorTexture;
    const float x = float(u), y = float(1 - v);
    return scene->Textures.at(std::size_t(use.Texture))
      .Sample(use.Transform[0][0] * x + use.Transform[0][1] * y + use.Transform[0][2],
        use.Transform[1][0] * x + use.Transform[1][1] * y + use.Transform[1][2]);
  };
  EXPECT_EQ(colour(0.1, 0.1).x, 1);
  EXPECT_EQ(colour(0.1, 0.1).y, 0);
  EXPECT_EQ(colour(0.9, 0.1).y, 1);
  EXPECT_EQ(colour(0.1, 0.9).z, 1);
  EXPECT_EQ(colour(0.1, 0.9).x, 0);
  // A quarter turn in VTK's coordinates: (u, v) -> (v, 1 - u).
  const double turn[2][3] = { { 0, 1, 0 }, { -1, 0, 1 } };
  std::copy_n(&turn[0][0], 6, &m.ColorTexture.Transform[0][0]);
  EXPECT_EQ(colour(0.1, 0.1).z, 1) << "reads (0.1, 0.9)";
  EXPECT_EQ(colour(0.1, 0.1).x, 0);
}

TEST(SceneFromData, CompositeBlocksHaveNamesAndNumbers)
{
  vtkNew<vtkMultiBlockDataSet> inner, outer;
  inner->SetBlock(0, Square(1));
  inner->GetMetaData(0u)->Set(vtkCompositeDataSet::NAME(), "lid");
  inner->SetBlock(2, Square(2)); // block 1 is empty
  outer->SetBlock(0, Square(0));
  outer->SetBlock(1, inner);
  outer->GetMetaData(1u)->Set(vtkCompositeDataSet::NAME(), "box");
  const auto scene = SceneFromData(outer);
  ASSERT_EQ(scene->Instances.size(), 3u);
  EXPECT_EQ(scene->Meshes[0].Name, "data/block 0");
  EXPECT_EQ(scene->Meshes[1].Name, "data/box/lid");
  EXPECT_EQ(scene->Meshes[2].Name, "data/box/block 2");
  EXPECT_EQ(scene->Instances[0].Id, 1);
  EXPECT_EQ(scene->Instances[1].Id, 2);
  EXPECT_EQ(scene->Instances[2].Id, 3);
  EXPECT_EQ(scene->Materials.size(), 1u) << "one material for all";
  EXPECT_EQ(scene->Meshes[2].Positions[0].z, 2);

  vtkNew<vtkPartitionedDataSet> part;
  part->SetPartition(0, Square(3));
  part->SetPartition(1, Square(4));
  vtkNew<vtkPartitionedDataSetCollection> collection;
  collection->SetPartitionedDataSet(0, part);
  collection->GetMetaData(0u)->Set(vtkCompositeDataSet::NAME(), "parts");
  const auto parts = SceneFromData(collection);
  ASSERT_EQ(parts->Instances.size(), 2u);
  EXPECT_EQ(parts->Meshes[1].Name.rfind("data/parts/", 0), 0u) << parts->Meshes[1].Name;
}

TEST(SceneFromData, SurfacesOfOtherDataSets)
{
  vtkNew<vtkUnstructuredGrid> grid;
  vtkNew<vtkPoints> points;
  for (const auto& p : { std::array<double, 3>{ 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } })
    points->InsertNextPoint(p.data());
  grid->SetPoints(points);
  const vtkIdType tetra[4] = { 0, 1, 2, 3 };
  grid->InsertNextCell(VTK_TETRA, 4, tetra);
  grid->GetCellData()->SetScalars(Values<vtkUnsignedCharArray>("rgb", 3, { 0, 255, 0 }));
  const auto scene = SceneFromData(grid);
  EXPECT_EQ(scene->Meshes.at(0).Indices.size(), 12u);
  EXPECT_EQ(scene->Meshes[0].Colors.at(0).y, 1) << "cell colours come along";
  vtkNew<vtkImageData> box;
  box->SetDimensions(3, 3, 3);
  EXPECT_NEAR(Area(SceneFromData(box)->Meshes.at(0)), 24, 1e-5);
}

TEST(SceneFromData, DoublesFarAwayKeepTheirDigits)
{
  const double far = 1e7;
  auto data = Polygons({ { far, 0, 0 }, { far + 0.01, 0, 0 }, { far, 0.01, 0 } }, { { 0, 1, 2 } }, true);
  const auto scene = SceneFromData(data);
  EXPECT_NEAR(Area(scene->Meshes.at(0)), 0.5e-4, 1e-9);
  const quell::Mat4 world = scene->WorldMatrices(0).at(std::size_t(scene->Instances[0].Node));
  EXPECT_NEAR(world.Point(quell::Vec3d(scene->Meshes[0].Positions[1])).x, far + 0.01, 1e-8);
}

TEST(SceneFromData, BadInputIsNamed)
{
  try
  {
    SceneFromData(nullptr);
    FAIL();
  }
  catch (const quell::SceneError& e)
  {
    EXPECT_NE(std::string(e.what()).find("no data (null)"), std::string::npos) << e.what();
  }
  vtkNew<vtkPolyData> empty;
  EXPECT_THROW(SceneFromData(empty), quell::SceneError);
  vtkNew<vtkTable> table;
  try
  {
    SceneFromData(table);
    FAIL();
  }
  catch (const quell::SceneError& e)
  {
    EXPECT_NE(std::string(e.what()).find("vtkTable left out"), std::string::npos) << e.what();
  }

  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  auto points = Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 }, { nan, 0, 0 }, { 0, inf, 0 }, { 1e300, 0, 0 } },
    { { 0, 1, 2 }, { 0, 1, 3 }, { 0, 1, 4 }, { 0, 1, 5 }, { 0, 1, 2, 3 } }, true);
  const auto scene = SceneFromData(points);
  EXPECT_EQ(scene->Meshes.at(0).Indices.size(), 3u);
  EXPECT_TRUE(Mentions(scene->Warnings, "data: 4 cells left out: points that are not finite"));
  for (const quell::Vec3f& p : scene->Meshes[0].Positions)
    EXPECT_TRUE(IsFinite(p));

  auto ids = Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 } }, { { 0, 1, 2 }, { 0, 1, 3 }, { 0, -1, 2, 1 } });
  const auto bad = SceneFromData(ids);
  EXPECT_EQ(bad->Meshes.at(0).Indices.size(), 3u);
  EXPECT_TRUE(Mentions(bad->Warnings, "2 cells left out: point numbers outside of the 3 points"));

  auto shapes = Polygons({ { 0, 0, 0 }, { 1, 0, 0 }, { 2, 0, 0 }, { 3, 0, 0 }, { 4, 0, 0 }, { 0, 1, 0 } },
    { { 0, 1 }, { 0, 1, 2, 3, 4 }, { 0, 1, 5 } });
  const auto flat = SceneFromData(shapes);
  EXPECT_EQ(flat->Meshes.at(0).Indices.size(), 3u);
  EXPECT_TRUE(Mentions(flat->Warnings, "2 cells left out: fewer than three points")) << flat->Warnings.size();
}

TEST(SceneFromData, ArraysOfTheWrongSizeAreLeftOut)
{
  auto data = Square();
  data->GetPointData()->SetScalars(Values<vtkFloatArray>("s", 1, { 0, 1 }));
  data->GetPointData()->SetNormals(Values<vtkFloatArray>("n", 3, { 0, 0, 1 }));
  data->GetPointData()->SetTCoords(Values<vtkFloatArray>("uv", 2, { 0, 0, 1, 1, 2, 2, 3, 3, 4, 4 }));
  const auto scene = SceneFromData(data);
  const quell::Mesh& mesh = scene->Meshes.at(0);
  EXPECT_TRUE(mesh.Colors.empty());
  EXPECT_TRUE(mesh.Normals.empty());
  EXPECT_TRUE(mesh.TexCoords[0].empty());
  EXPECT_TRUE(Mentions(scene->Warnings, "scalars left out: 2 values for 4 points"));
  EXPECT_TRUE(Mentions(scene->Warnings, "point normals left out: 1 tuples of 3 components where 4 are needed"));
  EXPECT_TRUE(Mentions(scene->Warnings, "texture coordinates left out"));
  DataMaterial m;
  vtkNew<vtkImageData> volume;
  volume->SetDimensions(2, 2, 2);
  volume->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
  m.ColorTexture.Image = volume.Get();
  const auto odd = SceneFromData(Square(), m);
  EXPECT_EQ(odd->Materials[0].BaseColorTexture.Texture, -1);
  EXPECT_TRUE(Mentions(odd->Warnings, "colour texture is a volume"));
}

TEST(SceneFromData, HashTellsDataApart)
{
  const auto a = SceneFromData(Square(0)), b = SceneFromData(Square(0)), c = SceneFromData(Square(1));
  EXPECT_EQ(a->Hash, b->Hash);
  EXPECT_NE(a->Hash, c->Hash);
  EXPECT_EQ(a->Hash.size(), 16u);
}
