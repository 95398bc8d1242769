// SPDX-License-Identifier: BSD-3-Clause
// Small stages with exactly known behaviour, for the tests of demand, history and failure.
#ifndef TestStages_h
#define TestStages_h

#include "vtkObjectFactory.h"
#include "vtkQuellStage.h"

#include <cmath>
#include <limits>

namespace quelltest
{
/// Every array of the table it is asked for, as a function of (tick, array, pixel of the whole frame).
class vtkQuellTestSource : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestSource);
  vtkSetClampMacro(Width, int, 0, 4096);
  vtkGetMacro(Width, int);
  vtkSetClampMacro(Height, int, 1, 4096);
  vtkGetMacro(Height, int);
  bool FailOnce = false;
  quell::ArraySet LastWanted;
  quell::Rect LastRegion;

  static float Value(int tick, char first, int x, int y, int c)
  {
    return float(tick * 1000 + first) + 0.25f * x + 3.f * y + 0.5f * c;
  }

protected:
  vtkQuellTestSource() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    if (this->Width == 0)
      throw quell::StageError("no such scene");
    w = this->Width;
    h = this->Height;
  }
  void Execute(quell::StageFrame& frame) override
  {
    this->LastWanted = frame.WantedArrays();
    this->LastRegion = frame.Region();
    for (const std::string& name : frame.WantedArrays())
    {
      const quell::ImageOut out = frame.Output(name);
      if (!out)
        continue;
      const quell::Rect r = frame.Region();
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
          for (int c = 0; c < out.components; ++c)
            out.at(x, y)[c] = Value(frame.Tick(), name[0], x, y, c);
    }
    if (this->FailOnce)
    {
      this->FailOnce = false;
      throw quell::StageError("the source broke");
    }
  }

private:
  int Width = 40;
  int Height = 24;
};

/// Mean of the (2 Radius + 1)^2 pixels that exist.
class vtkQuellTestBox : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestBox);
  vtkSetClampMacro(Radius, int, 0, 16);
  vtkGetMacro(Radius, int);
  vtkSetClampMacro(Gain, double, 0., 10.);
  vtkGetMacro(Gain, double);
  int HaloFor(int port) const override { return port == 0 ? this->Radius : 0; }
  bool NeedsInput(int port, const quell::ArraySet& asked) const override
  {
    return port == 0 ? asked.count("radiance") != 0 : asked.count("mask") != 0;
  }

protected:
  vtkQuellTestBox() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageIn in = frame.Input(0), depth = frame.Input(1);
    const quell::ImageOut out = frame.Output("radiance"), mask = frame.Output("mask");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        for (int c = 0; c < 3 && out; ++c)
        {
          double sum = 0;
          int n = 0;
          for (int j = -this->Radius; j <= this->Radius; ++j)
            for (int i = -this->Radius; i <= this->Radius; ++i)
              if (in.inside(x + i, y + j))
              {
                sum += in.at(x + i, y + j)[c];
                ++n;
              }
          out.at(x, y)[c] = float(this->Gain * sum / n);
        }
        if (mask)
          mask.at(x, y)[0] = depth ? depth.at(x, y)[0] : -1.f;
      }
  }

private:
  int Radius = 1;
  double Gain = 1;
};

/// radiance + 0.5 history(x + 1): reads its own past one pixel to the right.
class vtkQuellTestFeedback : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestFeedback);

protected:
  vtkQuellTestFeedback() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageIn in = frame.Input(0), history = frame.Input(1);
    const quell::ImageOut out = frame.Output("radiance");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        for (int c = 0; c < 3; ++c)
          out.at(x, y)[c] =
            in.at(x, y)[c] + (history && history.inside(x + 1, y) ? 0.5f * history.at(x + 1, y)[c] : 0.f);
  }
};

inline vtkStandardNewMacro(vtkQuellTestSource);
inline vtkStandardNewMacro(vtkQuellTestBox);
inline vtkStandardNewMacro(vtkQuellTestFeedback);
inline QUELL_STAGE_DESCRIPTION(vtkQuellTestSource) inline QUELL_STAGE_DESCRIPTION(
  vtkQuellTestBox) inline QUELL_STAGE_DESCRIPTION(vtkQuellTestFeedback)

  inline void vtkQuellTestSource::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTestSource;
  d.Category = "Test";
  for (const quell::ArrayType& a : quell::KnownArrays())
    d.Output(a.Name, a.Kind, a.Doc);
  QUELL_INT(d, Width, "pixels", "width");
  QUELL_INT(d, Height, "pixels", "height");
}
inline void vtkQuellTestBox::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTestBox;
  d.Category = "Test";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "image");
  d.OptionalInput("depth", quell::ArrayKind::Depth, "depth", "copied to mask");
  d.Output("radiance", quell::ArrayKind::Color, "mean");
  d.Output("mask", quell::ArrayKind::Scalar, "depth");
  QUELL_INT(d, Radius, "pixels", "radius");
  QUELL_DOUBLE(d, Gain, "", "factor");
}
inline void vtkQuellTestFeedback::Describe(quell::StageDescription& d)
{
  d.Category = "Test";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "image");
  d.OptionalInput("history", quell::ArrayKind::Color, "radiance", "own past");
  d.Output("radiance", quell::ArrayKind::Color, "sum");
}
}

#endif
