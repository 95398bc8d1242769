// SPDX-License-Identifier: BSD-3-Clause
#ifndef RenderScene_h
#define RenderScene_h

#include "SceneBuilder.h"
#include "Statistics.h"
#include "quellIntegrator.h"

#include <cstdlib>
#include <map>
#include <set>
#include <string>

/// Renders scenes in memory on one thread, through the integrator alone.
namespace trust
{
/// QUELL_LONG_TESTS=1 multiplies the samples; Documentation/trust.md says what that printed.
inline bool LongTests()
{
  const char* v = std::getenv("QUELL_LONG_TESTS");
  return v && *v && *v != '0';
}

inline int Components(const std::string& array)
{
  static const std::set<std::string> one{ "roughness", "depth", "id", "material", "hitDistance", "variance",
    "varianceAlbedo", "varianceNormal", "samples", "alpha" };
  return one.count(array) ? 1 : array == "motion" || array == "moments" ? 2 : 3;
}

struct Settings
{
  int Width = 32, Height = 32, Samples = 16, Bounces = 4;
  int Roulette = 1000; ///< none
  std::uint64_t Seed = 1;
  quell::Integrator::Strategy Sampling = quell::Integrator::Strategy::Mis;
  quell::Integrator::Jitter PixelJitter = quell::Integrator::Jitter::PerSample;
  double Time = 0, Previous = 0;
  double ShutterOpen = 0, ShutterClose = 0; ///< seconds; equal: no motion blur
  double LensRadius = 0, FocusDistance = 1;
  int CameraIndex = 0;
  quell::Integrator::Variant Force = quell::Integrator::Variant::Auto;
  quell::SamplePattern Pattern = quell::SamplePattern::Sobol;
};

struct Shot
{
  std::map<std::string, statistics::Picture> Arrays;
  quell::TraceCounters Counters;
  quell::Camera View, PreviousView;
  quell::Vec3d Origin;
  const statistics::Picture& operator[](const std::string& name) const { return this->Arrays.at(name); }
};

inline quell::Camera CameraOf(const quell::EmbreeScene& scene, int index, int width, int height, bool previous)
{
  const quell::CameraModel& model = scene.GetScene().Cameras.at(std::size_t(index));
  return quell::Camera(model, model.Node >= 0 ? scene.NodeMatrix(model.Node, previous) : model.WorldFromCamera,
    scene.Origin(), width, height);
}

inline Shot Shoot(
  const std::shared_ptr<const quell::Scene>& scene, const Settings& settings, const std::set<std::string>& arrays)
{
  quell::EmbreeScene built(scene);
  built.SetShutter(settings.ShutterOpen, settings.ShutterClose);
  built.SetTime(settings.Time, settings.Previous);
  quell::Integrator i;
  i.Scene = &built;
  i.View = CameraOf(built, settings.CameraIndex, settings.Width, settings.Height, false);
  i.PreviousView = CameraOf(built, settings.CameraIndex, settings.Width, settings.Height, true);
  i.View.LensRadius = i.PreviousView.LensRadius = settings.LensRadius;
  i.View.FocusDistance = i.PreviousView.FocusDistance = settings.FocusDistance;
  i.Shutter = settings.ShutterClose > settings.ShutterOpen;
  i.Force = settings.Force;
  i.Pattern = settings.Pattern;
  i.MaximumBounces = settings.Bounces;
  i.RouletteStart = settings.Roulette;
  i.Seed = settings.Seed;
  i.SamplesPerPixel = settings.Samples;
  i.Sampling = settings.Sampling;
  i.PixelJitter = settings.PixelJitter;
  const quell::Rect all{ 0, 0, settings.Width, settings.Height };
  quell::Film film(all, arrays);
  Shot shot;
  i.Render(film, all, 0, settings.Samples, shot.Counters);
  for (const std::string& name : arrays)
  {
    statistics::Picture& p = shot.Arrays[name];
    p.Width = settings.Width;
    p.Height = settings.Height;
    p.Channels = Components(name);
    p.Pixels.assign(std::size_t(p.Channels) * std::size_t(all.area()), 0);
    film.Develop(name, all, settings.Samples, quell::ImageOut(p.Pixels.data(), p.Channels, all));
  }
  shot.View = i.View;
  shot.PreviousView = i.PreviousView;
  shot.Origin = built.Origin();
  return shot;
}

/// Mean and standard error of the luminance of the middle pixel of a 1 x 1 image.
struct Estimate
{
  double Mean = 0, Error = 0;
  quell::TraceCounters Counters;
};
inline Estimate Centre(const std::shared_ptr<const quell::Scene>& scene, Settings settings)
{
  settings.Width = settings.Height = 1;
  settings.PixelJitter = quell::Integrator::Jitter::None;
  const Shot shot = Shoot(scene, settings, { "moments" });
  Estimate e;
  e.Mean = shot["moments"].At(0, 0, 0);
  e.Error = std::sqrt(shot["moments"].At(0, 0, 1) / std::max(1, settings.Samples - 1));
  e.Counters = shot.Counters;
  return e;
}
}

#endif
