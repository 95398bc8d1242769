// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellVtkSurface_h
#define quellVtkSurface_h

#include "quellSceneFromVTK.h"
#include "vtkMapper.h"

class vtkDataSet;

namespace quell
{
namespace detail
{
/// vtkMapper's colouring of scalars without a window: what it does not override needs none. Settings come from
/// ShallowCopy of a program's mapper, whose caches stay untouched.
class ScalarMapper : public vtkMapper
{
public:
  static ScalarMapper* New();
  vtkTypeMacro(ScalarMapper, vtkMapper);
  void Render(vtkRenderer*, vtkActor*) override {}

protected:
  ScalarMapper() = default;

private:
  ScalarMapper(const ScalarMapper&) = delete;
  void operator=(const ScalarMapper&) = delete;
};
/// A mapper that colours as `material` says.
vtkSmartPointer<ScalarMapper> MapperFor(const DataMaterial& material, vtkDataSet* data);

/// One leaf's triangles, ready for a Mesh.
struct Surface
{
  Mesh Triangles;
  Vec3d Offset; ///< positions are relative to it
  bool Colored = false, SeeThrough = false;
  bool HasColorMap = false;
  Texture ColorMap; ///< of scalars that are interpolated before mapping
  int ColorMapSet = 0;
};

/// False where `data` has no triangle at all. `mapper` may be null: no colours. Warnings name `place`.
bool MakeSurface(vtkDataSet* data, const DataMaterial& material, vtkMapper* mapper, const std::string& place,
  Surface& surface, std::vector<std::string>& warnings);

/// What composite mappers say of a block, inherited from its parents.
struct BlockStyle
{
  bool Visible = true, HasColor = false, HasOpacity = false;
  double Color[3] = { 1, 1, 1 }, Opacity = 1;
};
struct Block
{
  vtkDataSet* Data;
  std::string Name; ///< path of block names; empty where the data is no composite
  unsigned Number;  ///< place in the tree, counting every node
  BlockStyle Style;
};
/// All leaves with data, in order. Adds a warning for leaves that are no data sets.
std::vector<Block> LeavesOf(vtkDataObject* data, vtkCompositeDataDisplayAttributes* attributes,
  const std::string& place, std::vector<std::string>& warnings);
}
}

#endif
