// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellAovSplit_h
#define quellAovSplit_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// Passes of another renderer; all but `combined` may be absent (black). 3 channels, linear.
struct AovPasses
{
  enum Lobe
  {
    Diffuse,
    Glossy,
    Transmission,
    Volume, ///< has no colour pass
    Lobes
  };
  ImageIn combined;
  ImageIn direct[Lobes], indirect[Lobes];
  ImageIn color[Volume];
  ImageIn emission, environment;
  ImageIn albedo; ///< where there is no colour pass (OIDN's auxiliary image)
  bool demodulated = true;
};

/// Our layers; each may be absent.
struct AovLayers
{
  ImageOut radiance, emission, direct, indirect;
  ImageOut directDiffuse, directSpecular, indirectDiffuse, indirectSpecular;
  ImageOut albedo, albedoDiffuse, albedoSpecular;
  ImageOut residual;
};

struct AovCheck
{
  std::int64_t NonFinite = 0; ///< pixels with a non-finite value in any pass
  std::int64_t Over = 0;      ///< pixels whose sum is off by more than the tolerance
  double Worst = 0;           ///< largest relative difference, at (WorstX, WorstY)
  int WorstX = -1, WorstY = -1;
};

/// Makes our layers from foreign passes.
///
///   layer(lobe)      = pass * color   (demodulated passes: Blender's DiffDir is light already divided by DiffCol)
///                    = pass           (radiance passes, and volume)
///   directDiffuse    = layer(diffuse direct);      indirectDiffuse likewise
///   directSpecular   = layers of glossy + transmission + volume, direct;  indirectSpecular likewise
///   direct, indirect = diffuse + specular
///   emission         = emission + environment
///   radiance         = combined;   residual = radiance - (emission + direct + indirect)
///   albedoDiffuse    = diffuse color, albedoSpecular = glossy + transmission color, albedo = their sum, each limited
///   to
///                      [0, 1]; all three are 1 where the colours are 0 together (background, lamps)
///
/// Without any light pass all light counts as directDiffuse: combined - emission - environment, and the residual is 0
/// to rounding. Without any colour pass the albedos are `albedo`, or 1. Float, added in the order written here; what
/// overflows stays at FLT_MAX. The check is
/// max |residual| / (max |radiance| + 1e-3) over channels against `tolerance` (1e-2 allows for half-float files).
/// A non-finite pixel of a pass is replaced by the mean of its finite neighbours in that pass (0: none), and its
/// residual is 0. Pixelwise, halo 1 for that rule. Source: how Blender documents that its light passes recombine
/// (Combined = sum of (direct + indirect) color + ...).
QUELLKERNELS_EXPORT AovCheck AovSplit(
  const AovPasses& passes, float tolerance, const AovLayers& layers, const Rect& tile) noexcept;
}

#endif
