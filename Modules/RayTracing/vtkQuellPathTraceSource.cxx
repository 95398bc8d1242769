// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellPathTraceSource.h"

#include "quellIntegrator.h"
#include "quellScene.h"
#include "vtkInformation.h"
#include "vtkObjectFactory.h"
#include "vtkQuellArraySetKey.h"

#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <system_error>

vtkStandardNewMacro(vtkQuellPathTraceSource);
QUELL_STAGE_DESCRIPTION(vtkQuellPathTraceSource)

struct vtkQuellPathTraceSource::Internals
{
  std::shared_ptr<const quell::Scene> Given;  ///< by SetScene
  std::shared_ptr<const quell::Scene> Loaded; ///< from files, or Given with another environment
  std::string LoadedFrom;                     ///< files and their times
  bool Studio = false;                        ///< the sky is ours, because the scene has no light
  bool WarnedOfDarkness = false;
  int Generation = 0; ///< counts scenes
  std::unique_ptr<quell::EmbreeScene> Built;
  int BuiltGeneration = -1;

  // The arrays traced last, and for what.
  std::string Key;
  quell::Rect Region;
  std::map<std::string, std::vector<float>> Arrays;
};

vtkQuellPathTraceSource::vtkQuellPathTraceSource()
  : Internal(new Internals)
{
  this->InitializePorts();
}
vtkQuellPathTraceSource::~vtkQuellPathTraceSource() = default;

void vtkQuellPathTraceSource::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellPathTraceSource;
  using quell::ArrayKind;
  d.Category = "RayTracing";
  d.Brief = "Path-traces a scene: noisy radiance, its layers, guide features and statistics";
  d.Details =
    "Unidirectional path tracing; one light sample and one BSDF sample per vertex, combined by the power heuristic "
    "(Veach 1997); Owen-scrambled Sobol points; box pixel filter. `emission + direct + indirect = radiance`: light "
    "after "
    "no, one, more non-delta scatterings.\n\n"
    "Materials: glTF metallic-roughness with GGX, height-correlated Smith masking and Schlick's Fresnel term; the "
    "diffuse "
    "lobe is (1 - F(o)) (1 - F(i)) / (1 - F_avg) Lambert, which, unlike 1 - F(o.h), creates no energy. Reflection is a "
    "perfect mirror below roughness 0.032. Transmission is smooth: refraction with the exact Fresnel equations where "
    "the "
    "material bounds a volume, straight through elsewhere. Shadow rays take glass for opaque and see through alpha. "
    "Back faces are rendered; single-sided emission shines from the front only.\n\n"
    "Features are means over the samples (`depth`, `position`, `motion`, `normalGeometric` over those that hit), ids "
    "come "
    "from the first sample that hit. With PixelJitter PerSample and one sample per pixel they belong to the jittered "
    "point.\n\n"
    "Samples that are not finite are dropped from their layer and counted. Border rule: none, every pixel stands "
    "alone.";
  d.Output("radiance", ArrayKind::Color, "linear, scene units; the sum of the three layers");
  d.Output("emission", ArrayKind::Color, "light seen directly and through perfect mirrors and glass");
  d.Output("direct", ArrayKind::Color, "light after one non-delta scattering");
  d.Output("indirect", ArrayKind::Color, "light after two or more");
  d.Output("albedo", ArrayKind::Albedo, "reflectance at the first vertex that is not perfect mirror or glass");
  d.Output("normal", ArrayKind::Normal, "shading normal there, on the viewer's side");
  d.Output("roughness", ArrayKind::Scalar, "glTF roughness there, [0, 1]");
  d.Output("depth", ArrayKind::Depth, "along the view axis, of the primary hit");
  d.Output("position", ArrayKind::Position, "of the primary hit, relative to the facts' origin");
  d.Output("normalGeometric", ArrayKind::Normal, "of the primary hit, on the viewer's side");
  d.Output("motion", ArrayKind::Motion, "to where the primary hit was on the previous tick, pixels");
  d.Output("id", ArrayKind::Id, "node of the primary hit, 1 ...");
  d.Output("material", ArrayKind::Id, "material of the primary hit, 1 ...");
  d.Output("hitDistance", ArrayKind::Scalar, "length of the first segment after the first non-delta scattering");
  d.Output("variance", ArrayKind::Variance, "of the pixel's mean luminance");
  d.Output("halfA", ArrayKind::Color, "radiance of the even samples");
  d.Output("halfB", ArrayKind::Color, "radiance of the odd samples");
  d.Output("samples", ArrayKind::Scalar, "samples spent");
  d.Output("alpha", ArrayKind::Scalar, "part of the samples that hit something");

  QUELL_PATH(d, Scene, "glTF 2.0 (.gltf, .glb) or OBJ file");
  QUELL_STRING(d, Camera, "name or number of a camera; empty: the first, or one that frames the whole scene");
  QUELL_PATH(d, Environment, "latitude-longitude image that replaces the scene's environment");
  QUELL_ENUM(d, DefaultSky,
    "whether a studio sky lights a scene without environment: where it has no light at all, always, never", "WhenDark",
    "Always", "Never");
  QUELL_INT(d, Width, "pixels", "frame width; 0: the scene's resolution, else 256");
  QUELL_INT(d, Height, "pixels", "frame height; 0: the scene's resolution, else 256");
  QUELL_INT(d, SamplesPerPixel, "samples", "camera paths per pixel and frame");
  QUELL_INT(d, FirstSample, "samples", "samples of the sequence to skip, to continue an earlier image");
  QUELL_INT(d, MaximumBounces, "scatterings",
    "0: emission only, 1: direct light, 2: one indirect bounce ...; -1: the scene's max_depth - 1, else 6");
  QUELL_INT(d, RussianRouletteStart, "scatterings", "scatterings before paths end by chance");
  QUELL_INT(d, Seed, "", "other seeds give independent noise");
  QUELL_DOUBLE(d, SampleClamp, "radiance",
    "longest RGB length of one sample's direct and of its indirect light; 0: off. Darkens: a bias");
  QUELL_ENUM(d, PixelJitter, "where in the pixel samples lie: anywhere, at one Halton offset per frame, at the centre",
    "PerSample", "PerFrame", "None");
}

void vtkQuellPathTraceSource::SetScene(const std::string& file)
{
  if (this->Scene != file || this->Internal->Given)
  {
    this->Scene = file;
    this->Internal->Given = nullptr;
    this->Internal->Loaded = nullptr;
    this->Modified();
  }
}

void vtkQuellPathTraceSource::SetScene(std::shared_ptr<const quell::Scene> scene)
{
  if (this->Internal->Given != scene)
  {
    this->Internal->Given = std::move(scene);
    this->Internal->Loaded = nullptr;
    this->Modified();
  }
}

void vtkQuellPathTraceSource::SetCamera(const std::string& name)
{
  if (this->Camera != name)
  {
    this->Camera = name;
    this->Modified();
  }
}

void vtkQuellPathTraceSource::SetEnvironment(const std::string& file)
{
  if (this->Environment != file)
  {
    this->Environment = file;
    this->Internal->Loaded = nullptr;
    this->Modified();
  }
}

void vtkQuellPathTraceSource::SetDefaultSky(int mode)
{
  mode = std::min(2, std::max(0, mode));
  if (this->DefaultSky != mode)
  {
    this->DefaultSky = mode;
    this->Internal->Loaded = nullptr;
    this->Modified();
  }
}

namespace
{
/// A file and when it was written; a missing file has no time and fails when it is read.
const char* const NoScene = "no scene: set Scene to a glTF or OBJ file";

std::string FileStamp(const std::string& file)
{
  std::error_code error;
  const auto time = std::filesystem::last_write_time(file, error);
  return file + '\n' + (error ? std::string() : std::to_string(time.time_since_epoch().count())) + '\n';
}
}

void vtkQuellPathTraceSource::CheckSettings()
{
  if (this->Internal->Given)
    return;
  if (this->Scene.empty())
    throw quell::StageError(NoScene);
  std::error_code error;
  for (const std::string* file : { &this->Scene, &this->Environment })
    if (!file->empty() && !std::filesystem::is_regular_file(*file, error))
      throw quell::StageError(
        "\"" + *file + "\" is not a file; it must be " +
        (file == &this->Scene ? "a glTF (.gltf, .glb) or OBJ scene" : "a latitude-longitude image"));
}

const quell::Scene& vtkQuellPathTraceSource::LoadedScene()
{
  Internals& in = *this->Internal;
  std::string stamp = in.Given ? std::string() : FileStamp(this->Scene);
  if (!this->Environment.empty())
    stamp += FileStamp(this->Environment);
  if (in.Loaded && stamp == in.LoadedFrom)
    return *in.Loaded;
  if (!in.Given && this->Scene.empty())
    throw quell::StageError(NoScene);
  in.Loaded = nullptr;
  try
  {
    std::shared_ptr<const quell::Scene> scene = in.Given ? in.Given : quell::LoadScene(this->Scene);
    if (!this->Environment.empty())
    {
      auto lit = std::make_shared<quell::Scene>(*scene);
      quell::LoadEnvironment(*lit, this->Environment);
      scene = lit;
    }
    in.WarnedOfDarkness = false;
    in.Studio = this->DefaultSky == WhenDark && !scene->HasLight();
    if (in.Studio || (this->DefaultSky == Always && !scene->Sky.Present))
    {
      auto lit = std::make_shared<quell::Scene>(*scene);
      quell::AddStudioSky(*lit);
      scene = lit;
    }
    in.Loaded = scene;
  }
  catch (const std::exception& e)
  {
    throw quell::StageError(e.what());
  }
  in.LoadedFrom = stamp;
  ++in.Generation;
  return *in.Loaded;
}

int vtkQuellPathTraceSource::Bounces()
{
  if (this->MaximumBounces >= 0)
    return this->MaximumBounces;
  const int depth = this->LoadedScene().MaximumDepth;
  return depth >= 0 ? std::max(0, depth - 1) : 6;
}

void vtkQuellPathTraceSource::DescribeSource(int& width, int& height)
{
  const quell::Scene& scene = this->LoadedScene();
  try
  {
    quell::Camera::Find(scene, this->Camera);
  }
  catch (const std::exception& e)
  {
    throw quell::StageError(e.what());
  }
  const auto size = [](int own, int scenes) { return own > 0 ? own : scenes > 0 ? std::min(scenes, 32768) : 256; };
  width = size(this->Width, scene.Resolution[0]);
  height = size(this->Height, scene.Resolution[1]);
}

void vtkQuellPathTraceSource::Execute(quell::StageFrame& frame)
{
  Internals& in = *this->Internal;
  const quell::Scene& scene = this->LoadedScene();
  this->Warnings.insert(this->Warnings.end(), scene.Warnings.begin(), scene.Warnings.end());
  const quell::Rect region = frame.Region(), whole = frame.Whole();
  const int tick = frame.Tick();
  const double rate = this->Ticks.Rate > 0 ? this->Ticks.Rate : 1;

  try
  {
    if (!in.Built || in.BuiltGeneration != in.Generation)
    {
      in.Built.reset();
      in.Built.reset(new quell::EmbreeScene(in.Loaded));
      in.BuiltGeneration = in.Generation;
    }
    in.Built->SetTime(tick / rate, (tick - 1) / rate);
  }
  catch (const std::exception& e)
  {
    in.Built.reset();
    throw quell::StageError(e.what());
  }
  quell::EmbreeScene& built = *in.Built;
  if (built.DroppedTriangles > 0)
    this->Warnings.push_back(
      std::to_string(built.DroppedTriangles) + " triangles left out (no area, or corners that are not finite)");

  quell::Integrator integrator;
  integrator.Scene = &built;
  const int index = quell::Camera::Find(scene, this->Camera);
  if (index < 0)
    integrator.View = integrator.PreviousView =
      quell::Camera::Framing(built.RestLower, built.RestUpper, built.Origin(), whole.width(), whole.height());
  else
  {
    const quell::CameraModel& model = scene.Cameras[index];
    const auto at = [&](bool previous)
    {
      return quell::Camera(model, model.Node >= 0 ? built.NodeMatrix(model.Node, previous) : model.WorldFromCamera,
        built.Origin(), whole.width(), whole.height());
    };
    integrator.View = at(false);
    integrator.PreviousView = at(true);
  }
  integrator.MaximumBounces = this->Bounces();
  integrator.RouletteStart = this->RussianRouletteStart;
  integrator.Seed = std::uint64_t(this->Seed);
  integrator.Tick = tick;
  integrator.SamplesPerPixel = this->SamplesPerPixel;
  integrator.FirstSample = this->FirstSample;
  integrator.SampleClamp = float(this->SampleClamp);
  integrator.PixelJitter = quell::Integrator::Jitter(this->PixelJitter);

  quell::FrameFacts& facts = frame.OutputFacts;
  facts.HasCamera = true;
  facts.WorldToCamera = integrator.View.WorldToCamera();
  facts.WorldToNdc = integrator.View.WorldToNdc();
  facts.Origin = built.Origin();
  facts.Tick = tick;
  facts.Time = tick / rate;
  facts.Seed = this->Seed;
  facts.SamplesPerPixel = this->SamplesPerPixel;
  facts.Scene = scene.Hash;

  // Everything the pixels depend on.
  std::string key = std::to_string(in.Generation) + ' ' + std::to_string(tick) + ' ' + std::to_string(rate) + ' ' +
                    std::to_string(whole.width()) + 'x' + std::to_string(whole.height());
  for (const quell::Property& p : this->GetDescription().Properties)
    key += '\n' + p.GetText(this);
  if (in.Key != key || !in.Region.contains(region))
  {
    in.Arrays.clear();
    in.Key.clear();
    in.Region = region;
  }
  else if (in.Region != region)
  {
    const quell::Rect from = in.Region;
    for (auto& entry : in.Arrays)
    {
      const std::size_t n = entry.second.size() / std::size_t(from.area());
      std::vector<float> crop(std::size_t(region.area()) * n);
      for (int y = region.y0; y < region.y1; ++y)
        std::copy_n(
          entry.second.begin() + std::ptrdiff_t(n) * (std::ptrdiff_t(y - from.y0) * from.width() + region.x0 - from.x0),
          std::size_t(region.width()) * n,
          crop.begin() + std::ptrdiff_t(n) * std::ptrdiff_t(y - region.y0) * region.width());
      entry.second = std::move(crop);
    }
    in.Region = region;
  }

  quell::ArraySet missing;
  for (const quell::OutputArray& output : this->GetDescription().Outputs)
    if (frame.Wants(output.Name) && !in.Arrays.count(output.Name))
      missing.insert(output.Name);

  if (!missing.empty())
  {
    const auto misses = [&](const char* name) { return missing.count(name) != 0; };
    // Views of the arrays to trace; absent ones stay untouched.
    const auto view = [&](const char* name) { return misses(name) ? frame.Output(name) : quell::ImageOut(); };
    const quell::ImageOut radiance = view("radiance"), emission = view("emission"), direct = view("direct"),
                          indirect = view("indirect"), albedo = view("albedo"), normal = view("normal"),
                          roughness = view("roughness"), depth = view("depth"), position = view("position"),
                          normalGeometric = view("normalGeometric"), motion = view("motion"), id = view("id"),
                          material = view("material"), hitDistance = view("hitDistance"), variance = view("variance"),
                          halfA = view("halfA"), halfB = view("halfB"), samples = view("samples"),
                          alpha = view("alpha");
    const bool all = radiance || variance || halfA || halfB;
    quell::PixelWants& wants = integrator.Wants;
    wants.Emission = all || emission;
    wants.Direct = all || direct;
    wants.Indirect = all || indirect;
    wants.Guides = albedo || normal || roughness;
    wants.Motion = bool(motion);
    wants.Primary = depth || position || normalGeometric || motion || id || material || alpha;
    wants.HitDistance = bool(hitDistance);
    const bool traces =
      wants.Emission || wants.Direct || wants.Indirect || wants.Guides || wants.Primary || hitDistance;
    if (wants.Direct || wants.Indirect)
    {
      if (in.Studio)
        this->Warnings.push_back(
          "the scene has no light: a studio sky lights it; set Environment, or DefaultSky to Never");
      else if (!scene.HasLight())
        this->Warnings.push_back("the scene has no light: set Environment, or give a material an emission");
    }
    if ((halfA || halfB) && this->SamplesPerPixel == 1)
      this->Warnings.push_back("one sample per pixel makes no two halves: halfA and halfB are the same");

    std::atomic<std::int64_t> rays{ 0 }, paths{ 0 }, nonFinite{ 0 }, lit{ 0 };
    const auto put = [](const quell::ImageOut& image, int x, int y, const quell::Vec3d& v, double scale)
    {
      if (!image)
        return;
      float* p = image.at(x, y);
      for (int c = 0; c < 3; ++c)
        p[c] = float(v[c] * scale);
    };
    const auto put1 = [](const quell::ImageOut& image, int x, int y, double v)
    {
      if (image)
        *image.at(x, y) = float(v);
    };
    const auto unit = [](const quell::Vec3d& v) { return quell::Normalized(v); };
    if (!traces)
      for (int y = region.y0; y < region.y1; ++y)
        for (int x = region.x0; x < region.x1; ++x)
          put1(samples, x, y, this->SamplesPerPixel);
    else
      this->ForEachTile(region, 16,
        [&](const quell::Rect& tile)
        {
          quell::TraceCounters counters;
          for (int y = tile.y0; y < tile.y1; ++y)
          {
            if (this->IsCancelled())
              return;
            for (int x = tile.x0; x < tile.x1; ++x)
            {
              quell::PixelResult r;
              integrator.Pixel(x, y, r, counters);
              const double n = 1. / r.Samples, hits = r.Hits > 0 ? 1. / r.Hits : 0;
              const quell::Vec3d sum = r.Emission + r.Direct + r.Indirect;
              counters.Lit += quell::MaxComponent(sum) * n > 1e-3;
              put(radiance, x, y, sum, n);
              put(emission, x, y, r.Emission, n);
              put(direct, x, y, r.Direct, n);
              put(indirect, x, y, r.Indirect, n);
              put(albedo, x, y, r.Albedo, n);
              put(normal, x, y, unit(r.Normal), 1);
              put1(roughness, x, y, r.Roughness * n);
              put1(depth, x, y, r.Hits > 0 ? r.Depth * hits : std::numeric_limits<double>::infinity());
              put(position, x, y, r.Position, hits);
              put(normalGeometric, x, y, unit(r.NormalGeometric), 1);
              if (motion)
              {
                const quell::Vec2<double> m = r.Hits > 0 ? r.Motion : r.SkyMotion;
                const double k = r.Hits > 0 ? hits : n;
                motion.at(x, y)[0] = float(m.x * k);
                motion.at(x, y)[1] = float(m.y * k);
              }
              put1(id, x, y, r.Id);
              put1(material, x, y, r.Material);
              put1(hitDistance, x, y,
                r.HitDistances > 0 ? r.HitDistance / r.HitDistances : std::numeric_limits<double>::infinity());
              put1(variance, x, y, r.Samples > 1 ? r.SquareLuminance * n / (r.Samples - 1) : 0);
              const int odd = (r.Samples + this->FirstSample % 2) / 2, even = r.Samples - odd;
              put(halfA, x, y, even > 0 ? r.HalfA : r.HalfB, 1. / (even > 0 ? even : odd));
              put(halfB, x, y, odd > 0 ? r.HalfB : r.HalfA, 1. / (odd > 0 ? odd : even));
              put1(samples, x, y, r.Samples);
              put1(alpha, x, y, r.Hits * n);
            }
          }
          rays += counters.Rays;
          paths += counters.Paths;
          nonFinite += counters.NonFinite;
          lit += counters.Lit;
        });
    this->Counters.Rays += rays;
    this->Counters.Paths += paths;
    this->Counters.NonFinite += nonFinite;
    if (nonFinite > 0)
      this->Warnings.push_back(std::to_string(nonFinite) + " samples were not finite and were dropped");
    if (wants.Emission && wants.Direct && wants.Indirect && integrator.MaximumBounces > 0 && region == whole &&
        100 * lit < region.area() && !this->IsCancelled() && scene.HasLight() && !in.WarnedOfDarkness)
    {
      in.WarnedOfDarkness = true;
      this->Warnings.push_back(
        "almost every pixel is black (below 0.001): little light reaches what the camera sees; set "
        "Environment, DefaultSky to Always, or another Camera");
    }
  }

  for (const quell::OutputArray& output : this->GetDescription().Outputs)
  {
    const quell::ImageOut out = frame.Output(output.Name);
    if (!out)
      continue;
    std::vector<float>& kept = in.Arrays[output.Name];
    const std::size_t count = std::size_t(region.area()) * std::size_t(out.components);
    if (missing.count(output.Name))
      kept.assign(out.data, out.data + count);
    else
      std::memcpy(out.data, kept.data(), count * sizeof(float));
  }
  in.Key = key;
}

std::vector<std::string> vtkQuellPathTraceSource::Explain()
{
  std::vector<std::string> lines;
  try
  {
    const quell::Scene& scene = this->LoadedScene();
    bool glossy = false, glass = false, seeThrough = false, textures = false, emissive = false;
    for (const quell::Material& m : scene.Materials)
    {
      glossy |= !m.Unlit && (m.Metallic > 0 || m.Specular > 0);
      glass |= m.Transmission > 0;
      seeThrough |= m.Mode != quell::AlphaMode::Opaque;
      emissive |= quell::MaxComponent(m.Emission) > 0;
      for (const quell::TextureUse* use : { &m.BaseColorTexture, &m.MetallicRoughnessTexture, &m.NormalTexture,
             &m.EmissiveTexture, &m.TransmissionTexture })
        textures |= use->Texture >= 0;
    }
    const auto out = [&](bool has, const char* text)
    {
      if (!has)
        lines.push_back(text);
    };
    out(glossy, "no glossy material: no specular branch");
    out(glass, "no transmission: no refraction");
    out(seeThrough, "no alpha: rays stop at the first surface");
    out(textures, "no textures: no look-ups");
    out(scene.Sky.Present, "no environment: rays that leave the scene are black");
    out(emissive, "no emissive material: no area lights");
    out(!scene.Lights.empty(), "no punctual lights");
    out(scene.Animated(), "nothing moves: geometry is built once, motion is zero");
    if (this->Internal->Studio)
      lines.push_back("no light in the scene: a studio sky lights it");
    if (!scene.HasLight())
      lines.push_back("no light at all: the image is black");
    const int bounces = this->Bounces();
    lines.push_back(
      "paths end after " + std::to_string(bounces) + " scatterings" +
      (this->MaximumBounces < 0 ? (scene.MaximumDepth >= 0 ? " (the scene's max_depth)" : " (default)") : ""));
    if (bounces <= this->RussianRouletteStart)
      lines.push_back("no Russian roulette: paths are shorter than RussianRouletteStart");
    quell::ArraySet asked = REQUESTED_ARRAYS()->Read(this->GetOutputInformation(0));
    asked.erase(std::string());
    if (asked.count("@primary"))
      asked.insert(this->GetDescription().Outputs.front().Name);
    if (!asked.empty())
    {
      std::string unread;
      for (const quell::OutputArray& output : this->GetDescription().Outputs)
        if (!asked.count(output.Name))
          unread += (unread.empty() ? "" : ", ") + output.Name;
      if (!unread.empty())
        lines.push_back("not traced because nobody reads it: " + unread);
      bool light = false;
      for (const char* name : { "radiance", "direct", "indirect", "variance", "halfA", "halfB" })
        light |= asked.count(name) != 0;
      if (!light)
        lines.push_back("no light is read: no light samples");
    }
  }
  catch (const std::exception& e)
  {
    lines.push_back(e.what());
  }
  return lines;
}
