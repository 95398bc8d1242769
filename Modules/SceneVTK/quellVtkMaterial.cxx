// SPDX-License-Identifier: BSD-3-Clause
#include "quellVtkMaterial.h"

#include "vtkDataArray.h"
#include "vtkMatrix4x4.h"
#include "vtkPointData.h"
#include "vtkProperty.h"
#include "vtkTexture.h"
#include "vtkTransform.h"
#include "vtkUnsignedCharArray.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace detail
{
double LinearFromDisplay(double v) noexcept
{
  if (!(v > 0))
    return 0;
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

Vec3d LinearFromDisplay(const Vec3d& v, bool displayColors) noexcept
{
  if (displayColors)
    return { LinearFromDisplay(v.x), LinearFromDisplay(v.y), LinearFromDisplay(v.z) };
  const auto positive = [](double c) { return c > 0 ? c : 0; };
  return { positive(v.x), positive(v.y), positive(v.z) };
}

bool ToTexture(vtkImageData* image, bool srgb, Texture& texture, std::string& reason)
{
  int size[3];
  image->GetDimensions(size);
  vtkDataArray* scalars = image->GetPointData() ? image->GetPointData()->GetScalars() : nullptr;
  if (size[0] < 1 || size[1] < 1 || size[2] != 1 || !scalars)
  {
    reason = size[2] > 1 ? "is a volume, not a picture" : "has no pixels";
    return false;
  }
  const int n = scalars->GetNumberOfComponents();
  const vtkIdType count = vtkIdType(size[0]) * size[1];
  if (n < 1 || n > 4 || scalars->GetNumberOfTuples() != count)
  {
    reason = n < 1 || n > 4
               ? "has " + std::to_string(n) + " components per pixel"
               : "has " + std::to_string(scalars->GetNumberOfTuples()) + " pixels instead of " + std::to_string(count);
    return false;
  }
  const int type = scalars->GetDataType();
  if (type != VTK_UNSIGNED_CHAR && type != VTK_UNSIGNED_SHORT && type != VTK_FLOAT && type != VTK_DOUBLE)
  {
    reason = std::string("is of type ") + scalars->GetDataTypeAsString() +
             ": neither unsigned char or short nor float or double";
    return false;
  }
  texture.Width = size[0];
  texture.Height = size[1];
  const bool bytes = type == VTK_UNSIGNED_CHAR;
  texture.SRGB = srgb && (bytes || type == VTK_UNSIGNED_SHORT);
  if (bytes)
    texture.Bytes.resize(std::size_t(count) * 4);
  else
    texture.Floats.resize(std::size_t(count) * 4);
  const double scale = type == VTK_UNSIGNED_SHORT ? 1. / 65535 : 1;
  double pixel[4];
  for (int y = 0; y < size[1]; ++y)
    for (int x = 0; x < size[0]; ++x)
    {
      scalars->GetTuple(vtkIdType(y) * size[0] + x, pixel);
      const double grey = pixel[0], opaque = bytes ? 255 : 1 / scale;
      const double rgba[4] = { grey, n > 2 ? pixel[1] : grey, n > 2 ? pixel[2] : grey,
        n == 4   ? pixel[3]
        : n == 2 ? pixel[1]
                 : opaque };
      const std::size_t at = 4 * (std::size_t(size[1] - 1 - y) * std::size_t(size[0]) + std::size_t(x));
      for (int c = 0; c < 4; ++c)
        if (bytes)
          texture.Bytes[at + c] = std::uint8_t(rgba[c]);
        else
        {
          const float v = float(rgba[c] * scale);
          texture.Floats[at + c] = std::isfinite(v) ? v : 0;
        }
    }
  return true;
}

TextureUse MaterialWriter::Use(const DataTexture& texture, bool color, const std::string& place, const char* what)
{
  TextureUse use;
  if (!texture.Image)
    return use;
  const bool srgb = color && texture.SRGB;
  for (const Known& k : this->Textures)
    if (k.Image == texture.Image && k.SRGB == srgb && k.Interpolate == texture.Interpolate &&
        k.Wrapping == texture.Wrapping)
      use.Texture = k.Index;
  if (use.Texture < 0)
  {
    Texture made;
    std::string reason;
    if (!ToTexture(texture.Image, srgb, made, reason))
    {
      this->Target.Warnings.push_back(place + ": " + what + " texture " + reason + "; left out");
      return use;
    }
    made.Name = what;
    made.Nearest = !texture.Interpolate;
    made.WrapS = made.WrapT = texture.Wrapping;
    use.Texture = int(this->Target.Textures.size());
    this->Target.Textures.push_back(std::move(made));
    this->Textures.push_back({ texture.Image, srgb, texture.Interpolate, texture.Wrapping, use.Texture });
  }
  // Our v is 1 - VTK's, before and after the transform.
  const auto& t = texture.Transform;
  const double flipped[2][3] = { { t[0][0], -t[0][1], t[0][1] + t[0][2] },
    { -t[1][0], t[1][1], 1 - t[1][1] - t[1][2] } };
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 3; ++j)
      use.Transform[i][j] = float(flipped[i][j]);
  return use;
}

int MaterialWriter::Add(const DataMaterial& m, const Coloring& coloring, const std::string& place)
{
  std::vector<std::string> changed;
  const auto number = [&](double v, double low, double high, double otherwise, const char* name)
  {
    if (v >= low && v <= high)
      return v;
    changed.push_back(name);
    return v > high ? high : v < low ? low : otherwise;
  };
  const double diffuse = number(m.Diffuse, 0, 1, 1, "Diffuse"), ambient = number(m.Ambient, 0, 1, 0, "Ambient"),
               specular = number(m.Specular, 0, 1, 0, "Specular"),
               power = number(m.SpecularPower, 0, 1e6, 1, "SpecularPower"),
               opacity = number(m.Opacity, 0, 1, 1, "Opacity");
  const auto factor = [](const Vec3d& v) { return Vec3f(float(v.x), float(v.y), float(v.z)); };
  const auto within = [](const Vec3d& v) { return Vec3d(std::min(1., v.x), std::min(1., v.y), std::min(1., v.z)); };
  // Where colours come with the data they take the place of the material's own.
  const Vec3d white(1, 1, 1), own = coloring.Colored ? white : m.DiffuseColor;
  const bool unlit = !m.Lighting || (ambient >= 1 && diffuse <= 0 && specular <= 0);

  Material out;
  out.Name = m.Name;
  out.DoubleSided = true;
  out.Alpha = float(opacity);
  out.Mode = opacity < 1 || coloring.SeeThrough ? AlphaMode::Blend : AlphaMode::Opaque;
  out.Metallic = 0;
  out.Roughness = 1;
  out.Specular = 0;
  out.Emission = factor(LinearFromDisplay(m.Emission, false));
  out.BaseColor = factor(within(LinearFromDisplay(own * diffuse, m.DisplayColors)));
  if (unlit)
  {
    const Vec3d glow = coloring.Colored ? white : m.AmbientColor;
    out.Unlit = true;
    out.BaseColor = factor(within(LinearFromDisplay(glow * ambient + own * diffuse, m.DisplayColors)));
  }
  else if (m.Interpolation == DataMaterial::PBR)
  {
    out.Metallic = float(number(m.Metallic, 0, 1, 0, "Metallic"));
    out.Roughness = float(number(m.Roughness, 0, 1, 0.5, "Roughness"));
    out.Ior = float(number(m.BaseIOR, 1, 1e3, 1.5, "BaseIOR"));
    out.Specular = 1;
    out.Clearcoat = float(number(m.CoatStrength, 0, 1, 0, "CoatStrength"));
    out.ClearcoatRoughness = float(number(m.CoatRoughness, 0, 1, 0, "CoatRoughness"));
  }
  else if (specular > 0)
  {
    const double peak = specular * std::min(1., 8 / (power + 2)), dielectric = 0.04; // F0 of ior 1.5
    out.Specular = 1;
    out.SpecularColor = factor(LinearFromDisplay(m.SpecularColor, m.DisplayColors) * (peak / dielectric));
    out.Roughness = float(std::pow(2 / (power + 2), 0.25));
  }
  if (m.AmbientEmits && !unlit && ambient > 0)
  {
    if (coloring.Colored)
      this->Target.Warnings.push_back(place + ": scalars cannot colour ambient light; left out");
    else
      out.Emission = out.Emission + factor(LinearFromDisplay(m.AmbientColor * ambient, m.DisplayColors));
  }
  if (m.Transmission > 0)
  {
    out.Transmission = float(number(m.Transmission, 0, 1, 0, "Transmission"));
    out.Volume = true;
    out.Thickness = 1;
    out.Ior = float(number(m.BaseIOR, 1, 1e3, 1.5, "BaseIOR"));
    out.Specular = 1;
    out.SpecularColor = { 1, 1, 1 };
    if (m.Interpolation != DataMaterial::PBR)
      out.Roughness = 0;
    for (int c = 0; c < 3; ++c)
      out.BaseColor[c] = std::sqrt(out.BaseColor[c]);
  }

  out.BaseColorTexture = this->Use(m.ColorTexture, true, place, "colour");
  if (coloring.ColorMap >= 0)
  {
    out.BaseColorTexture = TextureUse();
    out.BaseColorTexture.Texture = coloring.ColorMap;
    out.BaseColorTexture.TexCoord = coloring.ColorMapSet;
  }
  if (out.BaseColorTexture.Texture >= 0 && out.Mode == AlphaMode::Opaque)
  {
    const Texture& t = this->Target.Textures[std::size_t(out.BaseColorTexture.Texture)];
    bool through = false;
    for (std::size_t i = 3; i < t.Bytes.size(); i += 4)
      through |= t.Bytes[i] < 255;
    for (std::size_t i = 3; i < t.Floats.size(); i += 4)
      through |= t.Floats[i] < 1;
    if (through)
      out.Mode = AlphaMode::Blend;
  }
  if (m.Interpolation == DataMaterial::PBR)
    out.MetallicRoughnessTexture = this->Use(m.OrmTexture, false, place, "ORM");
  out.NormalTexture = this->Use(m.NormalTexture, false, place, "normal");
  out.NormalScale = float(std::isfinite(m.NormalScale) ? m.NormalScale : 1);
  out.EmissiveTexture = this->Use(m.EmissiveTexture, true, place, "emissive");
  if (out.EmissiveTexture.Texture >= 0)
    out.Emission = factor(LinearFromDisplay(m.EmissiveFactor, false));
  for (Vec3f* v : { &out.BaseColor, &out.Emission, &out.SpecularColor })
    if (!IsFinite(*v))
    {
      changed.push_back("a colour");
      *v = Vec3f();
    }
  if (!changed.empty())
  {
    std::string names;
    for (const std::string& name : changed)
      names += (names.empty() ? "" : ", ") + name;
    this->Target.Warnings.push_back(place + ": material: " + names + " out of range; clamped");
  }
  this->Target.Materials.push_back(std::move(out));
  return int(this->Target.Materials.size()) - 1;
}
}

DataTexture TextureFrom(vtkTexture* texture)
{
  DataTexture out;
  if (!texture)
    return out;
  texture->Update();
  vtkImageData* image = texture->GetInput();
  vtkDataArray* scalars = image ? image->GetPointData()->GetScalars() : nullptr;
  if (!scalars)
    return out;
  out.Image = image;
  const int mode = texture->GetColorMode();
  if (mode == VTK_COLOR_MODE_MAP_SCALARS ||
      (mode == VTK_COLOR_MODE_DEFAULT && !vtkUnsignedCharArray::SafeDownCast(scalars)))
  {
    texture->MapScalarsToColors(scalars);
    out.Image = vtkSmartPointer<vtkImageData>::New();
    out.Image->SetExtent(image->GetExtent());
    // A copy: the texture uses its own array again.
    auto colors = vtkSmartPointer<vtkUnsignedCharArray>::New();
    if (texture->GetMappedScalars())
      colors->DeepCopy(texture->GetMappedScalars());
    out.Image->GetPointData()->SetScalars(colors);
  }
  out.Interpolate = texture->GetInterpolate() != 0;
  out.SRGB = texture->GetUseSRGBColorSpace();
  out.Wrapping = texture->GetWrap() == vtkTexture::Repeat           ? Wrap::Repeat
                 : texture->GetWrap() == vtkTexture::MirroredRepeat ? Wrap::Mirror
                                                                    : Wrap::Clamp;
  if (vtkTransform* transform = texture->GetTransform())
    for (int i = 0; i < 2; ++i)
    {
      out.Transform[i][0] = transform->GetMatrix()->GetElement(i, 0);
      out.Transform[i][1] = transform->GetMatrix()->GetElement(i, 1);
      out.Transform[i][2] = transform->GetMatrix()->GetElement(i, 3);
    }
  return out;
}

DataMaterial MaterialFromProperty(vtkProperty* property)
{
  DataMaterial m;
  if (!property)
    return m;
  const auto vector = [](const double* v) { return Vec3d(v[0], v[1], v[2]); };
  if (property->GetMaterialName())
    m.Name = property->GetMaterialName();
  m.Interpolation = DataMaterial::Shading(property->GetInterpolation());
  m.Lighting = property->GetLighting();
  m.AmbientColor = vector(property->GetAmbientColor());
  m.DiffuseColor = vector(property->GetDiffuseColor());
  m.SpecularColor = vector(property->GetSpecularColor());
  m.Ambient = property->GetAmbient();
  m.Diffuse = property->GetDiffuse();
  m.Specular = property->GetSpecular();
  m.SpecularPower = property->GetSpecularPower();
  m.Opacity = property->GetOpacity();
  m.Metallic = property->GetMetallic();
  m.Roughness = property->GetRoughness();
  m.BaseIOR = property->GetBaseIOR();
  m.CoatStrength = property->GetCoatStrength();
  m.CoatRoughness = property->GetCoatRoughness();
  m.NormalScale = property->GetNormalScale();
  m.EmissiveFactor = vector(property->GetEmissiveFactor());
  m.NormalTexture = TextureFrom(property->GetTexture("normalTex"));
  if (m.Interpolation == DataMaterial::PBR)
  {
    m.ColorTexture = TextureFrom(property->GetTexture("albedoTex"));
    m.OrmTexture = TextureFrom(property->GetTexture("materialTex"));
    m.EmissiveTexture = TextureFrom(property->GetTexture("emissiveTex"));
  }
  return m;
}
}
