// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellVtkMaterial_h
#define quellVtkMaterial_h

#include "quellSceneFromVTK.h"

namespace quell
{
namespace detail
{
/// sRGB -> linear (IEC 61966-2-1) of a display value; negative values and NaN give 0.
double LinearFromDisplay(double v) noexcept;
Vec3d LinearFromDisplay(const Vec3d& v, bool displayColors) noexcept;

/// What the data adds to a material.
struct Coloring
{
  bool Colored = false;    ///< vertex colours or a colour map replace the diffuse colour
  bool SeeThrough = false; ///< some of their alphas are below 1
  int ColorMap = -1;       ///< index into Scene::Textures
  int ColorMapSet = 0;     ///< its texture coordinates
};

/// False with a reason where the image is no picture. The texture's row 0 is the top one.
bool ToTexture(vtkImageData* image, bool srgb, Texture& texture, std::string& reason);

/// Appends the material, and its textures, to the scene; its index. Textures already there are shared.
class MaterialWriter
{
public:
  explicit MaterialWriter(Scene& scene)
    : Target(scene)
  {
  }
  int Add(const DataMaterial& material, const Coloring& coloring, const std::string& place);

private:
  TextureUse Use(const DataTexture& texture, bool color, const std::string& place, const char* what);
  Scene& Target;
  struct Known
  {
    vtkImageData* Image;
    bool SRGB, Interpolate;
    Wrap Wrapping;
    int Index;
  };
  std::vector<Known> Textures;
};
}
}

#endif
