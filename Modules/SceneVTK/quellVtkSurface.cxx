// SPDX-License-Identifier: BSD-3-Clause
#include "quellVtkSurface.h"

#include "quellVtkMaterial.h"
#include "vtkCellArray.h"
#include "vtkCellArrayIterator.h"
#include "vtkCellData.h"
#include "vtkCompositeDataDisplayAttributes.h"
#include "vtkCompositeDataIterator.h"
#include "vtkCompositeDataSet.h"
#include "vtkDataObjectTree.h"
#include "vtkDataObjectTreeIterator.h"
#include "vtkDataSetSurfaceFilter.h"
#include "vtkFloatArray.h"
#include "vtkIdList.h"
#include "vtkInformation.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"
#include "vtkPolygon.h"
#include "vtkUnsignedCharArray.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace quell
{
namespace detail
{
vtkStandardNewMacro(ScalarMapper);

namespace
{
constexpr std::uint32_t Unused = 0xffffffffu;

std::string Count(vtkIdType n, const char* what)
{
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

/// The array when it has a value for each of `count` things, of `low` to `high` components.
vtkDataArray* Fitting(vtkDataArray* array, vtkIdType count, int low, int high, const std::string& place,
  const char* what, std::vector<std::string>& warnings)
{
  if (!array)
    return nullptr;
  if (array->GetNumberOfTuples() == count && array->GetNumberOfComponents() >= low &&
      array->GetNumberOfComponents() <= high)
    return array;
  warnings.push_back(place + ": " + what + " left out: " + std::to_string(array->GetNumberOfTuples()) + " tuples of " +
                     Count(array->GetNumberOfComponents(), "component") + " where " + std::to_string(count) +
                     " are needed");
  return nullptr;
}

/// Splits cells into triangles of point ids.
class Triangulator
{
public:
  explicit Triangulator(vtkPoints* points)
    : Points(points)
  {
  }
  vtkIdType Failed = 0, BadIds = 0;

  /// Calls emit(a, b, c) for each triangle of the polygon.
  template <class Emit>
  void Polygon(vtkIdType n, const vtkIdType* ids, const Emit& emit)
  {
    if (!this->Valid(n, ids))
      return;
    if (n < 3)
    {
      ++this->Failed;
      return;
    }
    if (n == 3)
    {
      emit(ids[0], ids[1], ids[2]);
      return;
    }
    if (n == 4 && this->Quad(ids, emit))
      return;
    this->Cell->PointIds->SetNumberOfIds(n);
    this->Cell->Points->SetNumberOfPoints(n);
    for (vtkIdType i = 0; i < n; ++i)
    {
      double p[3];
      this->Points->GetPoint(ids[i], p);
      if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2]))
      {
        ++this->NonFinite;
        return;
      }
      this->Cell->PointIds->SetId(i, ids[i]);
      this->Cell->Points->SetPoint(i, p);
    }
    // Without an area there is nothing to see, and VTK would complain on the console.
    double normal[3];
    vtkPolygon::ComputeNormal(this->Cell->Points, normal);
    this->Triangles->Reset();
    if ((normal[0] == 0 && normal[1] == 0 && normal[2] == 0) || !this->Cell->Triangulate(this->Triangles) ||
        this->Triangles->GetNumberOfIds() < 3)
    {
      ++this->Failed;
      return;
    }
    for (vtkIdType t = 0; t + 2 < this->Triangles->GetNumberOfIds(); t += 3)
      emit(ids[this->Triangles->GetId(t)], ids[this->Triangles->GetId(t + 1)], ids[this->Triangles->GetId(t + 2)]);
  }

  template <class Emit>
  void Strip(vtkIdType n, const vtkIdType* ids, const Emit& emit)
  {
    if (!this->Valid(n, ids))
      return;
    if (n < 3)
      ++this->Failed;
    for (vtkIdType i = 0; i + 2 < n; ++i)
      if (i % 2)
        emit(ids[i + 1], ids[i], ids[i + 2]);
      else
        emit(ids[i], ids[i + 1], ids[i + 2]);
  }

  vtkIdType NonFinite = 0;

private:
  bool Valid(vtkIdType n, const vtkIdType* ids)
  {
    const vtkIdType count = this->Points->GetNumberOfPoints();
    for (vtkIdType i = 0; i < n; ++i)
      if (ids[i] < 0 || ids[i] >= count)
      {
        ++this->BadIds;
        return false;
      }
    return true;
  }
  /// Along the diagonal 0-2, as a fan, unless only the other one lies inside: a choice that stays while points move.
  /// False where none does.
  template <class Emit>
  bool Quad(const vtkIdType* ids, const Emit& emit)
  {
    Vec3d p[4];
    for (int i = 0; i < 4; ++i)
    {
      double at[3];
      this->Points->GetPoint(ids[i], at);
      p[i] = { at[0], at[1], at[2] };
      if (!IsFinite(p[i]))
        return false;
    }
    const auto inside = [&](int a, int b, int c, int d)
    { return Dot(Cross(p[b] - p[a], p[c] - p[a]), Cross(p[c] - p[a], p[d] - p[a])) > 0; };
    if (inside(0, 1, 2, 3))
    {
      emit(ids[0], ids[1], ids[2]);
      emit(ids[0], ids[2], ids[3]);
    }
    else if (inside(1, 2, 3, 0))
    {
      emit(ids[0], ids[1], ids[3]);
      emit(ids[1], ids[2], ids[3]);
    }
    else
      return false;
    return true;
  }

  vtkPoints* Points;
  vtkNew<vtkPolygon> Cell;
  vtkNew<vtkIdList> Triangles;
};

/// A point's or cell's own attributes, read as they are needed.
struct Attributes
{
  vtkDataArray* PointNormals = nullptr;
  vtkDataArray* CellNormals = nullptr;
  vtkDataArray* TexCoords = nullptr;
  vtkFloatArray* ColorCoordinates = nullptr;
  vtkUnsignedCharArray* Colors = nullptr;
  bool CellColors = false;
  const float* Linear = nullptr; ///< 256 decoded values
  int ColorMapSet = 0;
};

class MeshWriter
{
public:
  MeshWriter(vtkPoints* points, const Attributes& attributes, Surface& surface)
    : Points(points)
    , From(attributes)
    , Out(surface)
    , Split(attributes.CellNormals || attributes.CellColors)
  {
    if (!this->Split)
      this->Index.assign(std::size_t(points->GetNumberOfPoints()), Unused);
  }

  vtkIdType NonFinite = 0;

  void Triangle(vtkIdType cell, vtkIdType a, vtkIdType b, vtkIdType c)
  {
    const vtkIdType ids[3] = { a, b, c };
    Vec3f corners[3];
    for (int k = 0; k < 3; ++k)
    {
      double p[3];
      this->Points->GetPoint(ids[k], p);
      corners[k] = Vec3f(Vec3d(p[0], p[1], p[2]) - this->Out.Offset);
      if (!IsFinite(corners[k]))
      {
        ++this->NonFinite;
        return;
      }
    }
    std::uint32_t index[3];
    for (int k = 0; k < 3; ++k)
      index[k] = this->Vertex(cell, ids[k], corners, k);
    this->Out.Triangles.Indices.insert(this->Out.Triangles.Indices.end(), index, index + 3);
  }

private:
  std::uint32_t Vertex(vtkIdType cell, vtkIdType point, const Vec3f* corners, int k)
  {
    if (!this->Split && this->Index[std::size_t(point)] != Unused)
      return this->Index[std::size_t(point)];
    Mesh& mesh = this->Out.Triangles;
    if (mesh.Positions.size() >= Unused)
      throw SceneError(mesh.Name + ": more than 4294967294 vertices; split the data into blocks");
    const std::uint32_t index = std::uint32_t(mesh.Positions.size());
    if (!this->Split)
      this->Index[std::size_t(point)] = index;
    mesh.Positions.push_back(corners[k]);
    vtkDataArray* normals = this->From.CellNormals ? this->From.CellNormals : this->From.PointNormals;
    if (normals)
    {
      double n[3];
      normals->GetTuple(this->From.CellNormals ? cell : point, n);
      Vec3d unit = Normalized(Vec3d(n[0], n[1], n[2]));
      if (!IsFinite(unit) || unit == Vec3d())
        unit = Normalized(Vec3d(Cross(corners[1] - corners[0], corners[2] - corners[0])));
      mesh.Normals.push_back(Vec3f(unit));
    }
    const auto coordinate = [](double v) { return std::isfinite(float(v)) ? float(v) : 0.f; };
    if (this->From.TexCoords)
    {
      double uv[3] = { 0, 0, 0 };
      this->From.TexCoords->GetTuple(point, uv);
      mesh.TexCoords[0].push_back({ coordinate(uv[0]), coordinate(1 - uv[1]) });
    }
    if (this->From.ColorCoordinates)
    {
      double uv[3] = { 0, 0, 0 };
      this->From.ColorCoordinates->GetTuple(point, uv);
      mesh.TexCoords[this->From.ColorMapSet].push_back({ coordinate(uv[0]), coordinate(1 - uv[1]) });
    }
    if (this->From.Colors)
    {
      const unsigned char* rgba = this->From.Colors->GetPointer(4 * (this->From.CellColors ? cell : point));
      mesh.Colors.push_back(
        { this->From.Linear[rgba[0]], this->From.Linear[rgba[1]], this->From.Linear[rgba[2]], float(rgba[3]) / 255 });
      this->Out.SeeThrough |= rgba[3] < 255;
    }
    return index;
  }

  vtkPoints* Points;
  const Attributes& From;
  Surface& Out;
  bool Split;
  std::vector<std::uint32_t> Index;
};

const float* DisplayTable(bool displayColors)
{
  const auto make = [](bool decode)
  {
    std::array<float, 256> t;
    for (int i = 0; i < 256; ++i)
      t[std::size_t(i)] = decode ? float(LinearFromDisplay(i / 255.)) : float(i) / 255;
    return t;
  };
  static const std::array<float, 256> decoded = make(true), plain = make(false);
  return displayColors ? decoded.data() : plain.data();
}

/// Scalars -> colours, or coordinates of a colour map. `one` keeps alive what a mapper of its own makes.
void Colorize(vtkPolyData* data, const DataMaterial& material, vtkMapper* user, const std::string& place,
  Attributes& attributes, vtkSmartPointer<vtkObject>& owner, Surface& surface, std::vector<std::string>& warnings)
{
  if (!user || !user->GetScalarVisibility())
    return;
  vtkNew<ScalarMapper> mapper;
  mapper->ShallowCopy(user);
  mapper->SetStatic(1);
  // A surface has one base colour texture.
  if (material.ColorTexture.Image)
    mapper->SetInterpolateScalarsBeforeMapping(0);
  // The mapper itself trusts the array; a wrong one is refused before it is read.
  int flag = 0;
  vtkAbstractArray* scalars = vtkAbstractMapper::GetAbstractScalars(
    data, mapper->GetScalarMode(), mapper->GetArrayAccessMode(), mapper->GetArrayId(), mapper->GetArrayName(), flag);
  if (!scalars || scalars->GetNumberOfTuples() == 0)
    return;
  const bool cells = flag == 1;
  const vtkIdType wanted = flag == 0 ? data->GetNumberOfPoints() : data->GetNumberOfCells();
  if (flag != 2 && scalars->GetNumberOfTuples() != wanted)
  {
    warnings.push_back(place + ": scalars left out: " + std::to_string(scalars->GetNumberOfTuples()) + " values for " +
                       Count(wanted, cells ? "cell" : "point"));
    return;
  }
  mapper->ClearColorArrays();
  vtkUnsignedCharArray* colors = mapper->MapScalars(data, 1, flag);
  vtkFloatArray* coordinates = mapper->GetColorCoordinates();
  vtkImageData* map = mapper->GetColorTextureMap();
  owner = mapper.Get();
  if (!colors && coordinates && map && coordinates->GetNumberOfTuples() == data->GetNumberOfPoints())
  {
    std::string reason;
    if (!ToTexture(map, material.DisplayColors, surface.ColorMap, reason))
    {
      warnings.push_back(place + ": scalars left out: the colour map " + reason);
      return;
    }
    surface.ColorMap.Name = "colour map";
    surface.ColorMap.Nearest = true;
    surface.ColorMap.MipMap = false;
    surface.ColorMap.WrapS = surface.ColorMap.WrapT = Wrap::Clamp;
    for (std::size_t i = 3; i < surface.ColorMap.Bytes.size(); i += 4)
      surface.SeeThrough |= surface.ColorMap.Bytes[i] < 255;
    surface.HasColorMap = surface.Colored = true;
    attributes.ColorCoordinates = coordinates;
    return;
  }
  if (!colors || colors->GetNumberOfComponents() != 4)
    return;
  if (flag == 2)
  {
    // Field data: one tuple for the whole, where the program names it; otherwise one per cell.
    const vtkIdType tuple = mapper->GetFieldDataTupleId();
    if (tuple >= 0 && tuple < colors->GetNumberOfTuples())
    {
      vtkNew<vtkUnsignedCharArray> all;
      all->SetNumberOfComponents(4);
      all->SetNumberOfTuples(data->GetNumberOfPoints());
      for (vtkIdType i = 0; i < all->GetNumberOfTuples(); ++i)
        std::copy_n(colors->GetPointer(4 * tuple), 4, all->GetPointer(4 * i));
      owner = all.Get();
      attributes.Colors = all;
      surface.Colored = true;
      return;
    }
    if (colors->GetNumberOfTuples() != data->GetNumberOfCells())
    {
      warnings.push_back(place + ": scalars left out: field data with " + Count(colors->GetNumberOfTuples(), "value") +
                         " for " + Count(data->GetNumberOfCells(), "cell"));
      return;
    }
  }
  attributes.Colors = colors;
  attributes.CellColors = flag != 0;
  surface.Colored = true;
}
}

vtkSmartPointer<ScalarMapper> MapperFor(const DataMaterial& m, vtkDataSet* data)
{
  auto mapper = vtkSmartPointer<ScalarMapper>::New();
  mapper->SetScalarVisibility(m.ScalarVisibility);
  mapper->SetInterpolateScalarsBeforeMapping(m.InterpolateScalarsBeforeMapping);
  mapper->SetColorMode(m.MapAllScalars ? VTK_COLOR_MODE_MAP_SCALARS : VTK_COLOR_MODE_DEFAULT);
  vtkDataArray* scalars = nullptr;
  if (m.ScalarArray.empty())
  {
    scalars = data->GetPointData()->GetScalars();
    if (!scalars)
      scalars = data->GetCellData()->GetScalars();
  }
  else
  {
    scalars = data->GetPointData()->GetArray(m.ScalarArray.c_str());
    const bool points = scalars != nullptr;
    if (!points)
      scalars = data->GetCellData()->GetArray(m.ScalarArray.c_str());
    mapper->SetScalarMode(points ? VTK_SCALAR_MODE_USE_POINT_FIELD_DATA : VTK_SCALAR_MODE_USE_CELL_FIELD_DATA);
    mapper->SelectColorArray(m.ScalarArray.c_str());
  }
  if (m.LookupTable)
  {
    mapper->SetLookupTable(m.LookupTable);
    if (m.ScalarComponent < 0)
      m.LookupTable->SetVectorModeToMagnitude();
    else
    {
      m.LookupTable->SetVectorModeToComponent();
      m.LookupTable->SetVectorComponent(m.ScalarComponent);
    }
  }
  const bool given = m.ScalarRange[0] <= m.ScalarRange[1];
  if (given)
    mapper->SetScalarRange(m.ScalarRange[0], m.ScalarRange[1]);
  else if (m.LookupTable)
    mapper->UseLookupTableScalarRangeOn();
  else if (scalars)
  {
    double range[2] = { 0, 1 };
    if (scalars->GetNumberOfTuples() > 0)
      scalars->GetFiniteRange(range, std::max(0, std::min(m.ScalarComponent, scalars->GetNumberOfComponents() - 1)));
    if (range[0] <= range[1])
      mapper->SetScalarRange(range);
  }
  return mapper;
}

bool MakeSurface(vtkDataSet* data, const DataMaterial& material, vtkMapper* mapper, const std::string& place,
  Surface& surface, std::vector<std::string>& warnings)
{
  vtkSmartPointer<vtkPolyData> poly = vtkPolyData::SafeDownCast(data);
  if (!poly)
  {
    // The filter gets a copy: connecting the original would change its pipeline.
    auto copy = vtkSmartPointer<vtkDataSet>::Take(data->NewInstance());
    copy->ShallowCopy(data);
    vtkNew<vtkDataSetSurfaceFilter> filter;
    filter->SetInputData(copy);
    filter->Update();
    poly = filter->GetOutput();
  }
  surface.Triangles.Name = place;
  const vtkIdType lines = poly->GetNumberOfLines(), verts = poly->GetNumberOfVerts();
  if (lines > 0 || verts > 0)
    warnings.push_back(place + ": " + (lines > 0 ? Count(lines, "line") : "") +
                       (lines > 0 && verts > 0 ? " and " : "") + (verts > 0 ? Count(verts, "vertex cell") : "") +
                       " left out: they have no surface; vtkTubeFilter or vtkGlyph3D give them one");
  vtkPoints* points = poly->GetPoints();
  if (!points || poly->GetNumberOfPolys() + poly->GetNumberOfStrips() == 0)
    return false;
  const vtkIdType cellCount = poly->GetNumberOfCells(), pointCount = poly->GetNumberOfPoints();

  Attributes attributes;
  attributes.Linear = DisplayTable(material.DisplayColors);
  if (material.Interpolation != DataMaterial::Flat)
    attributes.PointNormals =
      Fitting(poly->GetPointData()->GetNormals(), pointCount, 3, 3, place, "point normals", warnings);
  if (!attributes.PointNormals)
    attributes.CellNormals =
      Fitting(poly->GetCellData()->GetNormals(), cellCount, 3, 3, place, "cell normals", warnings);
  const bool textured = material.ColorTexture.Image || material.OrmTexture.Image || material.NormalTexture.Image ||
                        material.EmissiveTexture.Image;
  attributes.TexCoords =
    Fitting(poly->GetPointData()->GetTCoords(), pointCount, 1, 3, place, "texture coordinates", warnings);
  if (textured && !attributes.TexCoords)
    warnings.push_back(place + ": has textures but no texture coordinates");
  vtkSmartPointer<vtkObject> owner;
  Colorize(poly, material, mapper, place, attributes, owner, surface, warnings);
  if (attributes.ColorCoordinates)
    attributes.ColorMapSet = surface.ColorMapSet = attributes.TexCoords ? 1 : 0;

  // Floats lose digits far from the origin, which doubles had: keep them relative to the middle.
  double b[6];
  poly->GetBounds(b);
  const Vec3d low(b[0], b[2], b[4]), high(b[1], b[3], b[5]), middle = (low + high) * 0.5;
  if (points->GetDataType() == VTK_DOUBLE && IsFinite(middle) && Length(middle) > Length(high - low))
    surface.Offset = middle;

  MeshWriter writer(points, attributes, surface);
  Triangulator triangulator(points);
  // VTK numbers cells: vertices, lines, polygons, strips.
  vtkIdType cell = verts + lines;
  const auto walk = [&](vtkCellArray* cells, bool strips)
  {
    if (!cells)
      return;
    auto it = vtk::TakeSmartPointer(cells->NewIterator());
    for (it->GoToFirstCell(); !it->IsDoneWithTraversal(); it->GoToNextCell(), ++cell)
    {
      vtkIdType n;
      const vtkIdType* ids;
      it->GetCurrentCell(n, ids);
      const auto emit = [&](vtkIdType p, vtkIdType q, vtkIdType r) { writer.Triangle(cell, p, q, r); };
      if (strips)
        triangulator.Strip(n, ids, emit);
      else
        triangulator.Polygon(n, ids, emit);
    }
  };
  walk(poly->GetPolys(), false);
  walk(poly->GetStrips(), true);
  const vtkIdType nonFinite = writer.NonFinite + triangulator.NonFinite;
  if (nonFinite > 0)
    warnings.push_back(
      place + ": " + Count(nonFinite, "cell") + " left out: points that are not finite, or too far for a float");
  if (triangulator.BadIds > 0)
    warnings.push_back(place + ": " + Count(triangulator.BadIds, "cell") + " left out: point numbers outside of the " +
                       Count(pointCount, "point"));
  if (triangulator.Failed > 0)
    warnings.push_back(place + ": " + Count(triangulator.Failed, "cell") +
                       " left out: fewer than three points, no area, or an outline that crosses itself");
  return !surface.Triangles.Indices.empty();
}

namespace
{
class LeafWalk
{
public:
  LeafWalk(vtkCompositeDataDisplayAttributes* attributes, const std::string& place, std::vector<Block>& found,
    std::vector<std::string>& warnings)
    : Attributes(attributes)
    , Place(place)
    , Found(found)
    , Warnings(warnings)
  {
  }

  void Visit(vtkDataObject* data, const std::string& name, BlockStyle style)
  {
    const unsigned number = this->Number++;
    if (!data)
      return;
    if (vtkCompositeDataDisplayAttributes* a = this->Attributes)
    {
      if (a->HasBlockVisibility(data))
        style.Visible = a->GetBlockVisibility(data);
      if (a->HasBlockColor(data))
      {
        style.HasColor = true;
        a->GetBlockColor(data, style.Color);
      }
      if (a->HasBlockOpacity(data))
      {
        style.HasOpacity = true;
        style.Opacity = a->GetBlockOpacity(data);
      }
    }
    if (auto tree = vtkDataObjectTree::SafeDownCast(data))
    {
      auto it = vtk::TakeSmartPointer(tree->NewTreeIterator());
      it->TraverseSubTreeOff();
      it->VisitOnlyLeavesOff();
      it->SkipEmptyNodesOff();
      int child = 0;
      for (it->InitTraversal(); !it->IsDoneWithTraversal(); it->GoToNextItem(), ++child)
      {
        const char* given =
          it->HasCurrentMetaData() ? it->GetCurrentMetaData()->Get(vtkCompositeDataSet::NAME()) : nullptr;
        this->Visit(it->GetCurrentDataObject(),
          (name.empty() ? "" : name + "/") + (given && *given ? given : "block " + std::to_string(child)), style);
      }
    }
    else if (auto composite = vtkCompositeDataSet::SafeDownCast(data))
    {
      auto it = vtk::TakeSmartPointer(composite->NewIterator());
      int child = 0;
      for (it->InitTraversal(); !it->IsDoneWithTraversal(); it->GoToNextItem(), ++child)
        this->Visit(
          it->GetCurrentDataObject(), (name.empty() ? "" : name + "/") + "block " + std::to_string(child), style);
    }
    else if (auto leaf = vtkDataSet::SafeDownCast(data))
    {
      if (style.Visible)
        this->Found.push_back({ leaf, name, number, style });
    }
    else
      this->Warnings.push_back(
        this->Place + (name.empty() ? "" : "/" + name) + ": " + data->GetClassName() + " left out: it has no surface");
  }

private:
  vtkCompositeDataDisplayAttributes* Attributes;
  const std::string& Place;
  std::vector<Block>& Found;
  std::vector<std::string>& Warnings;
  unsigned Number = 0;
};
}

std::vector<Block> LeavesOf(vtkDataObject* data, vtkCompositeDataDisplayAttributes* attributes,
  const std::string& place, std::vector<std::string>& warnings)
{
  std::vector<Block> found;
  LeafWalk(attributes, place, found, warnings).Visit(data, std::string(), BlockStyle());
  return found;
}
}
}
