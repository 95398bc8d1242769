// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellPathTraceSource
 * @brief   path-traces a scene: noisy radiance, its layers, guide features and statistics
 *
 * Unidirectional path tracing with light and BSDF samples combined by the power heuristic (Veach 1997) and
 * Owen-scrambled Sobol points. Every random number is a function of (seed, tick, sample, pixel of the whole frame,
 * decision), so an image does not depend on region, tiles, threads or passes. Sample s of tick t uses point t *
 * SamplesPerPixel + FirstSample + s of the pixel's sequence: frames accumulated over time stay stratified. Where
 * several sources take single samples of one pixel (FirstSample 0, 1 ...), SamplesPerTick replaces SamplesPerPixel
 * there.
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
 * - directDiffuse + directSpecular = direct, indirectDiffuse + indirectSpecular = indirect, by the lobe of the first
 *   non-delta scattering; bounce1, bounce2 ... bounce64: light after that many non-delta scatterings, bounce1 = direct,
 *   and with MaximumBounces up to 64 the others sum to indirect. They are made on demand and are dynamic outputs.
 *
 * **Camera.** A pinhole, a box filter and a shutter that opens for no time, unless LensRadius, PixelFilter and
 * ShutterTime say otherwise. The open shutter is centred on the frame's time. Under a lens or an open shutter all
 * features are means over the samples, like the light; motion is that of the point hit, from the frame's own time to
 * the previous frame's, as the pinhole in the middle of the lens sees it; the facts' matrices are that pinhole's.
 *
 * With PixelJitter PerSample and one sample per pixel all features belong to the same jittered point in the pixel:
 * consistent with each other and with the colour, but not the pixel centre's. Use PerFrame for temporal anti-aliasing.
 *
 * **Demand.** Only wanted arrays are traced: depth, id, motion ... shoot camera rays; albedo and normal follow mirrors;
 * emission stops at the first non-delta surface; direct after one scattering. What was traced is kept: the same
 * tick, parameters and scene asked again cost nothing, further arrays cost only themselves, a smaller region is a crop,
 * and a parameter of light alone (MaximumBounces, SampleClamp ...) leaves the primary hit's arrays.
 *
 * **Refinement.** The sums of all samples are kept as long as they fit GetFilmMemory(). Asked for more SamplesPerPixel,
 * the source then traces only the samples that are missing, where they belong to the same sequence: at tick 0, or
 * wherever tick * SamplesPerPixel + FirstSample stays the same. The bits are those of one go. Of one sample nothing is
 * kept: to trace it again costs less than to keep the sums of every frame.
 *
 * **Long renders** run in passes over the whole region, of half a second or one sample. CancelToken::Finish ends one
 * after the pass at work: every pixel of an array has the same number of samples, `samples` and the facts say how many,
 * and the facts' Partial is set. The next update goes on with what there is; SaveWork and LoadWork carry it over to
 * another process.
 *
 * **Samples that are not finite** (overflow of an extreme emission) are dropped from their layer and counted.
 */
#ifndef vtkQuellPathTraceSource_h
#define vtkQuellPathTraceSource_h

#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"
#include "vtkQuellStage.h"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace quell
{
class Integrator;
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
  enum FilterShape
  {
    Box,
    Tent,
    Gaussian,
    BlackmanHarris
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
  /// Name or number (0 ...) of the glTF animation to play; empty: all that move different things.
  void SetAnimation(const std::string& name);
  const std::string& GetAnimation() const { return this->Animation; }
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
  /// Surfaces that glTF does not call double-sided are invisible from behind, to the camera and to light. Glass is not
  /// among them. Default off: they are rendered.
  vtkSetMacro(HideBackFaces, bool);
  vtkGetMacro(HideBackFaces, bool);
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
  /// Samples of the sequence from one tick to the next: as many as all sources that share a pixel's sequence take
  /// together, so that the frames of none overlap the others'. Default 0: SamplesPerPixel.
  vtkSetClampMacro(SamplesPerTick, int, 0, 1 << 20);
  vtkGetMacro(SamplesPerTick, int);
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

  ///@{
  /// Points that paths are made of (quellSampler.h): Owen-scrambled Sobol (default), least noise per pixel; BlueNoise,
  /// whose error at few samples has little low frequency, good below a filter; Random, independent numbers (PCG).
  vtkSetClampMacro(SamplePattern, int, 0, 2);
  vtkGetMacro(SamplePattern, int);
  ///@}
  ///@{
  /// How lamps are picked (quellLightSampler.h): Power, by power alone; Tree, by what they bring to the point at hand;
  /// Auto (default), the tree from 8 lamps on.
  vtkSetClampMacro(LightSelection, int, 0, 2);
  vtkGetMacro(LightSelection, int);
  ///@}
  ///@{
  /// Camera rays per pixel that make albedo, normal, roughness and their variances alone, in place of the light
  /// samples, and end at the guides' vertex: clean guides of textures, edges and blur next to one light sample. 0
  /// (default): the light samples make them, and they belong to the same points. [0, 65536]
  vtkSetClampMacro(GuideSamples, int, 0, 65536);
  vtkGetMacro(GuideSamples, int);
  ///@}
  ///@{
  /// Radius of the thin lens in scene units: focal length / (2 f-number). Default 0: a pinhole, everything is sharp.
  /// [0, 1e9]
  vtkSetClampMacro(LensRadius, double, 0., 1e9);
  vtkGetMacro(LensRadius, double);
  ///@}
  ///@{
  /// Depth of what is sharp, scene units. Default 0: of what the middle of the frame sees. [0, 1e30]
  vtkSetClampMacro(FocusDistance, double, 0., 1e30);
  vtkGetMacro(FocusDistance, double);
  ///@}
  ///@{
  /// Corners of the lens's opening, one of them up; below 3: round. Default 0, [0, 64].
  vtkSetClampMacro(LensBlades, int, 0, 64);
  vtkGetMacro(LensBlades, int);
  ///@}
  ///@{
  /// Part of the time between two frames that the shutter is open, centred on the frame's time. Default 0: no motion
  /// blur; 0.5 is film's half-open shutter. [0, 1]
  vtkSetClampMacro(ShutterTime, double, 0., 1.);
  vtkGetMacro(ShutterTime, double);
  ///@}
  ///@{
  /// Where PixelJitter PerSample puts the samples of a pixel: their density around its centre is the filter, so pixels
  /// stay independent and all samples have the same weight. Box (default); Tent; Gaussian of standard deviation
  /// FilterRadius / 3; BlackmanHarris, its four-term minimum side lobe window.
  vtkSetClampMacro(PixelFilter, int, 0, 3);
  vtkGetMacro(PixelFilter, int);
  ///@}
  ///@{
  /// Half of the filter's width, pixels; 0 (default): 0.5 for Box, 1 for Tent, 1.5 for the others. [0, 16]
  vtkSetClampMacro(FilterRadius, double, 0., 16.);
  vtkGetMacro(FilterRadius, double);
  ///@}

  ///@{
  /// A camera from outside, a viewer's: world from camera, looks along -z, with the opening of the chosen one. The
  /// scene stands still at the time of `Tick`, whatever tick is asked, and motion is that from Before to Camera alone.
  struct Viewpoint
  {
    quell::Mat4 Camera, Before;
    int Tick = 0;
    bool FromScene = false; ///< the previous frame's was the scene's own camera; Before is not used
  };
  void SetViewpoint(const Viewpoint& viewpoint);
  void ClearViewpoint();
  ///@}

  ///@{
  /// Bytes that the sums of all samples may take to be kept after an execution, for refinement; above, the arrays alone
  /// are kept. Changes no bit. Default 2^28.
  void SetFilmMemory(std::size_t bytes) { this->FilmMemory = bytes; }
  std::size_t GetFilmMemory() const { return this->FilmMemory; }
  ///@}

  void CheckSettings() override;
  std::vector<quell::OutputArray> ListDynamicOutputs() override;
  std::vector<std::string> Explain() override;
  double CostPerPixel() const override;
  /// The sums over samples; the scene is not in it.
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;
  quell::SamplingStatus GetSamplingStatus() const override;
  std::string HashOfContents() override;
  std::string SaveWork() const override;
  bool LoadWork(const std::string& bytes, std::string& error) override;
  int ComputePipelineMTime(vtkInformation* request, vtkInformationVector** inInfo, vtkInformationVector* outInfo,
    int port, vtkMTimeType* mtime) override;

protected:
  vtkQuellPathTraceSource();
  ~vtkQuellPathTraceSource() override;

  void DescribeSource(int& width, int& height) override;
  bool FillsOutputs() const override { return true; }
  void Execute(quell::StageFrame& frame) override;

private:
  struct Traced;
  struct Internals;
  const quell::Scene& LoadedScene();
  int Bounces();
  double Radius() const;
  void Sample(
    quell::StageFrame& frame, std::vector<std::unique_ptr<Traced>>& work, const quell::Integrator& integrator);
  /// One sample a pixel, from the rays to the frame's arrays tile by tile: nothing is kept to go on from.
  void SampleOnce(quell::StageFrame& frame, const quell::ArraySet& names, const quell::Integrator& integrator);
  /// Adds to the counters; warns of samples that were dropped.
  void Count(std::int64_t rays, std::int64_t paths, std::int64_t nonFinite);

  std::string Scene, Camera, Animation, Environment;
  int Width = 0, Height = 0, SamplesPerPixel = 1, FirstSample = 0, SamplesPerTick = 0, MaximumBounces = -1,
      RussianRouletteStart = 3;
  int Seed = 0, PixelJitter = PerSample, DefaultSky = WhenDark, LensBlades = 0, PixelFilter = Box, GuideSamples = 0,
      SamplePattern = 0, LightSelection = 0;
  bool HideBackFaces = false;
  double SampleClamp = 0, LensRadius = 0, FocusDistance = 0, ShutterTime = 0, FilterRadius = 0;
  std::size_t FilmMemory = std::size_t(1) << 28;
  std::unique_ptr<Viewpoint> Outside;
  std::unique_ptr<Internals> Internal;
};

#endif
