// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellPathTraceSource
 * @brief   path-traces a scene: noisy radiance, its layers, guide features and statistics
 *
 * Unidirectional path tracing with light and BSDF samples combined by the power heuristic (Veach 1997), Owen-scrambled
 * Sobol points and a box pixel filter. Every random number is a function of (seed, tick, sample, pixel of the whole
 * frame, decision), so an image does not depend on region, tiles or threads. Sample s of tick t uses point
 * t * SamplesPerPixel + FirstSample + s of the pixel's sequence: frames accumulated over time stay stratified.
 *
 * **Outputs** (row 0 at the bottom). Means over the pixel's samples, unless said otherwise:
 * - radiance = emission + direct + indirect: light after 0, 1, more non-delta scatterings.
 * - albedo, normal, roughness (glTF's, perceptual): at the first vertex that is not a perfect mirror or clear glass;
 *   1, 0, 0 where there is none. The normal is the shading normal on the viewer's side, renormalised.
 * - depth (along the view axis), position (relative to the facts' origin), normalGeometric: of the primary hit, means
 * over the samples that hit; +inf, 0, 0 where none did. id and material: of the first sample that hit (never mixed), 0:
 * none.
 * - motion: pixels from here to where the primary hit was on tick - 1, without jitter: object and camera motion for
 *   hits; where nothing was hit, camera rotation. Exactly 0 where nothing moved; 1e6 where the point was behind the
 * camera.
 * - hitDistance: length of the first segment after the first non-delta scattering, mean over the samples that hit
 * there.
 * - variance: of the pixel's mean luminance, from the spread of its samples (0 for one sample); halfA, halfB: radiance
 *   of even and odd samples (with one sample both are that sample); samples; alpha: part of the samples that hit.
 *
 * With PixelJitter PerSample and one sample per pixel all features belong to the same jittered point in the pixel:
 * consistent with each other and with the colour, but not the pixel centre's. Use PerFrame for temporal anti-aliasing.
 *
 * **Demand.** Only wanted arrays are traced: depth, id, motion ... shoot camera rays; albedo and normal follow mirrors;
 * emission stops at the first non-delta surface; direct after one scattering. What was traced is kept: the same
 * tick, parameters and scene asked again cost nothing, further arrays cost only themselves, a smaller region is a crop.
 *
 * **Samples that are not finite** (overflow of an extreme emission) are dropped from their layer and counted.
 */
#ifndef vtkQuellPathTraceSource_h
#define vtkQuellPathTraceSource_h

#include "vtkQuellRayTracingModule.h"
#include "vtkQuellStage.h"

#include <memory>
#include <string>

namespace quell
{
struct Scene;
}

class VTKQUELLRAYTRACING_EXPORT vtkQuellPathTraceSource : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellPathTraceSource);

  enum JitterMode
  {
    PerSample,
    PerFrame,
    None
  };
  enum SkyMode
  {
    WhenDark,
    Always,
    Never
  };

  ///@{
  /// glTF or OBJ file. A scene in memory, given to the second form, wins over a file.
  void SetScene(const std::string& file);
  const std::string& GetScene() const { return this->Scene; }
  void SetScene(std::shared_ptr<const quell::Scene> scene);
  ///@}
  ///@{
  /// Name or number (0 ...) of a camera; empty: the first, or one that frames everything where the scene has none.
  void SetCamera(const std::string& name);
  const std::string& GetCamera() const { return this->Camera; }
  ///@}
  ///@{
  /// Latitude-longitude image, instead of the scene's environment.
  void SetEnvironment(const std::string& file);
  const std::string& GetEnvironment() const { return this->Environment; }
  ///@}
  ///@{
  /// Whether a studio sky (quell::AddStudioSky) lights a scene without environment. WhenDark (default): where the scene
  /// has no light at all; a warning says so.
  void SetDefaultSky(int mode);
  int GetDefaultSky() const { return this->DefaultSky; }
  ///@}
  ///@{
  /// Frame size; 0: the scene's extras.resolution, else 256. [0, 32768]
  vtkSetClampMacro(Width, int, 0, 32768);
  vtkGetMacro(Width, int);
  vtkSetClampMacro(Height, int, 0, 32768);
  vtkGetMacro(Height, int);
  ///@}
  ///@{
  /// Default 1, [1, 1048576].
  vtkSetClampMacro(SamplesPerPixel, int, 1, 1 << 20);
  vtkGetMacro(SamplesPerPixel, int);
  ///@}
  ///@{
  /// Samples of the sequence to skip: continues an earlier image with the same SamplesPerPixel. Default 0.
  vtkSetClampMacro(FirstSample, int, 0, 1 << 30);
  vtkGetMacro(FirstSample, int);
  ///@}
  ///@{
  /// Scatterings of a path: 0 emission only, 1 direct light, 2 one indirect bounce ... Mirrors and glass count. -1
  /// (default): the scene's extras.max_depth - 1, else 6. [-1, 1024]
  vtkSetClampMacro(MaximumBounces, int, -1, 1024);
  vtkGetMacro(MaximumBounces, int);
  ///@}
  ///@{
  /// Scatterings before paths end by chance. Default 3, [0, 1024].
  vtkSetClampMacro(RussianRouletteStart, int, 0, 1024);
  vtkGetMacro(RussianRouletteStart, int);
  ///@}
  ///@{
  /// Default 0, [0, 2147483647].
  vtkSetClampMacro(Seed, int, 0, 2147483647);
  vtkGetMacro(Seed, int);
  ///@}
  ///@{
  /// Longest RGB length of one sample's direct and of its indirect light; longer ones are scaled down, which darkens. 0
  /// (default): off. [0, 1e30]
  vtkSetClampMacro(SampleClamp, double, 0., 1e30);
  vtkGetMacro(SampleClamp, double);
  ///@}
  ///@{
  /// PerSample (default): anywhere in the pixel. PerFrame: one Halton(2, 3) - 1/2 offset per tick. None: pixel centres.
  vtkSetClampMacro(PixelJitter, int, 0, 2);
  vtkGetMacro(PixelJitter, int);
  ///@}

  void CheckSettings() override;
  std::vector<std::string> Explain() override;

protected:
  vtkQuellPathTraceSource();
  ~vtkQuellPathTraceSource() override;

  void DescribeSource(int& width, int& height) override;
  void Execute(quell::StageFrame& frame) override;

private:
  struct Internals;
  const quell::Scene& LoadedScene();
  int Bounces();

  std::string Scene, Camera, Environment;
  int Width = 0, Height = 0, SamplesPerPixel = 1, FirstSample = 0, MaximumBounces = -1, RussianRouletteStart = 3;
  int Seed = 0, PixelJitter = PerSample, DefaultSky = WhenDark;
  double SampleClamp = 0;
  std::unique_ptr<Internals> Internal;
};

#endif
