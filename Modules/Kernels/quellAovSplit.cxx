// SPDX-License-Identifier: BSD-3-Clause
#include "quellAovSplit.h"

#include "quellGuards.h"
#include "quellVector.h"

namespace quell
{
namespace
{
float Unit(float v) noexcept
{
  return v > 0 ? (v < 1 ? v : 1.f) : 0.f;
}
Vec3f Unit(const Vec3f& v) noexcept
{
  return { Unit(v.x), Unit(v.y), Unit(v.z) };
}
Vec3f Limit(const Vec3f& v) noexcept
{
  return { Limited(v.x), Limited(v.y), Limited(v.z) };
}
float Largest(const Vec3f& v) noexcept
{
  return std::max(std::fabs(v.x), std::max(std::fabs(v.y), std::fabs(v.z)));
}
void Store(const ImageOut& out, int x, int y, const Vec3f& v) noexcept
{
  if (!out)
    return;
  float* o = out.at(x, y);
  o[0] = v.x, o[1] = v.y, o[2] = v.z;
}
}

AovCheck AovSplit(const AovPasses& passes, float tolerance, const AovLayers& layers, const Rect& tile) noexcept
{
  AovCheck check;
  bool anyLight = false, anyColor = false;
  for (int k = 0; k < AovPasses::Lobes; ++k)
    anyLight |= passes.direct[k] || passes.indirect[k];
  for (const ImageIn& color : passes.color)
    anyColor |= bool(color);

  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      bool good = true;
      const auto read = [&](const ImageIn& image)
      {
        if (!image)
          return Vec3f();
        float c[3];
        good &= ReadFilled(image, x, y, c);
        return Vec3f(c[0], c[1], c[2]);
      };
      const Vec3f radiance = read(passes.combined);
      const Vec3f emission = Limit(read(passes.emission) + read(passes.environment));
      Vec3f color[AovPasses::Lobes];
      for (int k = 0; k < AovPasses::Volume; ++k)
        color[k] = read(passes.color[k]);
      color[AovPasses::Volume] = Vec3f(1.f);
      // [0] direct, [1] indirect
      Vec3f diffuse[2], specular[2];
      for (int bounce = 0; bounce < 2; ++bounce)
        for (int k = 0; k < AovPasses::Lobes; ++k)
        {
          Vec3f light = read(bounce ? passes.indirect[k] : passes.direct[k]);
          if (passes.demodulated)
            light = Limit(light * color[k]);
          Vec3f& layer = (k == AovPasses::Diffuse ? diffuse : specular)[bounce];
          layer = Limit(layer + light);
        }
      if (!anyLight)
        diffuse[0] = Limit(radiance - emission);
      const Vec3f direct = Limit(diffuse[0] + specular[0]), indirect = Limit(diffuse[1] + specular[1]);

      Vec3f albedoDiffuse = color[AovPasses::Diffuse];
      Vec3f albedoSpecular = color[AovPasses::Glossy] + color[AovPasses::Transmission];
      if (!anyColor)
        albedoDiffuse = albedoSpecular = passes.albedo ? read(passes.albedo) : Vec3f(1.f);
      Vec3f albedo = anyColor ? albedoDiffuse + albedoSpecular : albedoDiffuse;
      if (albedo == Vec3f())
        albedo = albedoDiffuse = albedoSpecular = Vec3f(1.f);

      Vec3f residual = Limit(radiance - Limit(emission + direct + indirect));
      if (!good)
      {
        residual = Vec3f();
        ++check.NonFinite;
      }
      const double off = double(Largest(residual)) / (double(Largest(radiance)) + 1e-3);
      check.Over += off > tolerance;
      if (off > check.Worst)
      {
        check.Worst = off;
        check.WorstX = x;
        check.WorstY = y;
      }
      Store(layers.radiance, x, y, radiance);
      Store(layers.emission, x, y, emission);
      Store(layers.direct, x, y, direct);
      Store(layers.indirect, x, y, indirect);
      Store(layers.directDiffuse, x, y, diffuse[0]);
      Store(layers.directSpecular, x, y, specular[0]);
      Store(layers.indirectDiffuse, x, y, diffuse[1]);
      Store(layers.indirectSpecular, x, y, specular[1]);
      Store(layers.albedo, x, y, Unit(albedo));
      Store(layers.albedoDiffuse, x, y, Unit(albedoDiffuse));
      Store(layers.albedoSpecular, x, y, Unit(albedoSpecular));
      Store(layers.residual, x, y, residual);
    }
  return check;
}
}
