// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellAovSplit.h"

#include "quellAovSplit.h"
#include "vtkObjectFactory.h"

#include <cstdio>

vtkStandardNewMacro(vtkQuellAovSplit);
QUELL_STAGE_DESCRIPTION(vtkQuellAovSplit)

namespace
{
enum Ports
{
  Combined,
  DiffuseDirect,
  DiffuseIndirect,
  DiffuseColor,
  GlossyDirect,
  GlossyIndirect,
  GlossyColor,
  TransmissionDirect,
  TransmissionIndirect,
  TransmissionColor,
  VolumeDirect,
  VolumeIndirect,
  Emission,
  Environment,
  Albedo
};
constexpr int RowsPerTask = 16;

// By lobe.
constexpr int direct[] = { DiffuseDirect, GlossyDirect, TransmissionDirect, VolumeDirect };
constexpr int indirect[] = { DiffuseIndirect, GlossyIndirect, TransmissionIndirect, VolumeIndirect };
constexpr int color[] = { DiffuseColor, GlossyColor, TransmissionColor };
}

void vtkQuellAovSplit::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellAovSplit;
  using quell::ArrayKind;
  d.Category = "Denoising";
  d.Brief = "Makes Quell's layers from another renderer's passes, and checks that they add up to the beauty.";
  d.Details = "A layer is `pass * color` for demodulated passes (Blender's DiffDir is light already divided by "
              "DiffCol) or the pass "
              "itself. `direct` and `indirect` are diffuse + specular; specular holds glossy, transmission and volume; "
              "`emission` holds "
              "the environment too. `residual = radiance - (emission + direct + indirect)`, and pixels where it "
              "exceeds `Tolerance` are "
              "reported. Without light passes all light is `directDiffuse` and the residual is 0. Without colour "
              "passes the albedos are "
              "input `albedo`, or 1. Albedos are limited to [0, 1] and are 1 where all colours are 0. A non-finite "
              "pixel of a pass is "
              "replaced by the mean of its finite neighbours (0 if there are none); its residual is 0.";
  d.Input("combined", ArrayKind::Color, "radiance", "the beauty");
  d.OptionalInput("diffuseDirect", ArrayKind::Color, "diffuseDirect", "Blender DiffDir");
  d.OptionalInput("diffuseIndirect", ArrayKind::Color, "diffuseIndirect", "Blender DiffInd");
  d.OptionalInput("diffuseColor", ArrayKind::Albedo, "diffuseColor", "Blender DiffCol");
  d.OptionalInput("glossyDirect", ArrayKind::Color, "glossyDirect", "Blender GlossDir");
  d.OptionalInput("glossyIndirect", ArrayKind::Color, "glossyIndirect", "Blender GlossInd");
  d.OptionalInput("glossyColor", ArrayKind::Albedo, "glossyColor", "Blender GlossCol");
  d.OptionalInput("transmissionDirect", ArrayKind::Color, "transmissionDirect", "Blender TransDir");
  d.OptionalInput("transmissionIndirect", ArrayKind::Color, "transmissionIndirect", "Blender TransInd");
  d.OptionalInput("transmissionColor", ArrayKind::Albedo, "transmissionColor", "Blender TransCol");
  d.OptionalInput("volumeDirect", ArrayKind::Color, "volumeDirect", "Blender VolumeDir; never demodulated");
  d.OptionalInput("volumeIndirect", ArrayKind::Color, "volumeIndirect", "Blender VolumeInd; never demodulated");
  d.OptionalInput("emission", ArrayKind::Color, "emission", "Blender Emit");
  d.OptionalInput("environment", ArrayKind::Color, "environment", "Blender Env");
  d.OptionalInput("albedo", ArrayKind::Albedo, "albedo", "where there are no colour passes");
  const char* const product = "light times colour, and other renderers' colours may exceed 1";
  d.Output("radiance", ArrayKind::Color, "combined").Mean({ "combined" });
  d.Output("emission", ArrayKind::Color, "emission + environment").AtMost(1, { "emission", "environment" });
  d.Output("direct", ArrayKind::Color, "light after one scattering").Finite(product);
  d.Output("indirect", ArrayKind::Color, "light after two or more scatterings").Finite(product);
  d.Output("directDiffuse", ArrayKind::Color, "diffuse part of direct").Finite(product);
  d.Output("directSpecular", ArrayKind::Color, "the rest of direct").Finite(product);
  d.Output("indirectDiffuse", ArrayKind::Color, "diffuse part of indirect").Finite(product);
  d.Output("indirectSpecular", ArrayKind::Color, "the rest of indirect").Finite(product);
  d.Output("albedo", ArrayKind::Albedo, "sum of all colours").Within(0, 1);
  d.Output("albedoDiffuse", ArrayKind::Albedo, "diffuse colour").Within(0, 1);
  d.Output("albedoSpecular", ArrayKind::Albedo, "glossy + transmission colour").Within(0, 1);
  d.Output("residual", ArrayKind::Color, "radiance minus the layers; signed").Finite(product);
  QUELL_ENUM(d, Convention, "what light passes hold: light divided by colour, or radiance", "Demodulated", "Radiance");
  QUELL_DOUBLE(d, Tolerance, "", "largest |residual| / (radiance + 1e-3) that is not warned of");
}

vtkQuellAovSplit::vtkQuellAovSplit()
{
  this->InitializePorts();
}

int vtkQuellAovSplit::HaloFor(int) const
{
  return 1; // a non-finite pixel is filled from its neighbours
}

void vtkQuellAovSplit::CheckConnections(quell::ConnectionCheck& check) const
{
  for (int k = 0; this->Convention == 0 && k < quell::AovPasses::Volume; ++k)
    for (int port : { direct[k], indirect[k] })
      if (check.Count(port) > 0 && check.Count(color[k]) == 0)
        check.Error(port, 0,
          "a demodulated light pass needs its colour, and input \"" + this->GetDescription().Inputs[color[k]].Name +
            "\" is not connected",
          "if the pass is radiance, set Convention to Radiance");
}

void vtkQuellAovSplit::Execute(quell::StageFrame& frame)
{
  quell::AovPasses in;
  in.combined = frame.Input(Combined);
  for (int k = 0; k < quell::AovPasses::Lobes; ++k)
  {
    in.direct[k] = frame.Input(direct[k]);
    in.indirect[k] = frame.Input(indirect[k]);
    if (k != quell::AovPasses::Volume)
      in.color[k] = frame.Input(color[k]);
  }
  in.emission = frame.Input(Emission);
  in.environment = frame.Input(Environment);
  in.albedo = frame.Input(Albedo);
  in.demodulated = this->Convention == 0;
  this->HasPasses = false;
  for (int p = DiffuseDirect; p < Albedo; ++p)
    this->HasPasses |= frame.Has(p);

  quell::AovLayers out;
  out.radiance = frame.Output("radiance");
  out.emission = frame.Output("emission");
  out.direct = frame.Output("direct");
  out.indirect = frame.Output("indirect");
  out.directDiffuse = frame.Output("directDiffuse");
  out.directSpecular = frame.Output("directSpecular");
  out.indirectDiffuse = frame.Output("indirectDiffuse");
  out.indirectSpecular = frame.Output("indirectSpecular");
  out.albedo = frame.Output("albedo");
  out.albedoDiffuse = frame.Output("albedoDiffuse");
  out.albedoSpecular = frame.Output("albedoSpecular");
  out.residual = frame.Output("residual");

  const quell::Rect region = frame.Region();
  std::vector<quell::AovCheck> rows(region.height());
  this->ForEachTile({ 0, region.y0, 1, region.y1 }, RowsPerTask,
    [&](const quell::Rect& strip)
    {
      for (int y = strip.y0; y < strip.y1; ++y)
        rows[y - region.y0] = quell::AovSplit(in, float(this->Tolerance), out, { region.x0, y, region.x1, y + 1 });
    });
  quell::AovCheck sum;
  this->NonFinite.Begin(region, frame.Tick());
  for (const quell::AovCheck& row : rows)
  {
    const int y = region.y0 + int(&row - rows.data());
    this->NonFinite.Add({ region.x0, y, region.x1, y + 1 }, row.NonFinite);
    sum.Over += row.Over;
    if (row.Worst > sum.Worst)
    {
      sum.Worst = row.Worst;
      sum.WorstX = row.WorstX;
      sum.WorstY = row.WorstY;
    }
  }
  this->PixelsOver = sum.Over;
  this->Worst = sum.Worst;
  if (sum.Over > 0)
  {
    char text[256];
    std::snprintf(text, sizeof text,
      "the layers do not add up to the beauty: %lld of %lld pixels are off by more than %g, the worst by %.3g at (%d, "
      "%d)",
      (long long)sum.Over, (long long)region.area(), this->Tolerance, sum.Worst, sum.WorstX, sum.WorstY);
    this->Warnings.push_back(text);
  }
  this->NonFinite.Report(this->Counters, this->Warnings, this->CountedWarning, "the passes");
}

std::string vtkQuellAovSplit::GetReport() const
{
  if (!this->HasPasses)
    return std::string();
  char text[160];
  std::snprintf(text, sizeof text, "largest |radiance - sum of layers| / radiance is %.3g, %lld pixels beyond %g",
    this->Worst, this->PixelsOver, this->Tolerance);
  return text;
}
