// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellPathTraceSource.h"

#include "quellIntegrator.h"
#include "quellMaterial.h"
#include "quellScene.h"
#include "vtkInformation.h"
#include "vtkObjectFactory.h"
#include "vtkQuellArraySetKey.h"
#include "vtkSMPThreadLocal.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <new>
#include <set>
#include <sstream>
#include <system_error>
#include <type_traits>

vtkStandardNewMacro(vtkQuellPathTraceSource);
QUELL_STAGE_DESCRIPTION(vtkQuellPathTraceSource)

/// Arrays traced together: as sums over samples while the film is kept, else as they are.
struct vtkQuellPathTraceSource::Traced
{
  std::string PrimaryKey, Key; ///< what decides the bits of the primary hit's arrays, of all arrays
  quell::Rect Region;
  int Samples = 0, GuideSamples = 0; ///< of every pixel
  quell::ArraySet Names;
  std::unique_ptr<quell::Film> Film;
  std::map<std::string, std::vector<float>> Arrays;
  double SecondsPerSample = 0;

  std::size_t FilmBytes() const { return this->Film ? this->Film->Data().size() * sizeof(double) : 0; }
  /// Turns the film into the arrays of these names and lets go of it.
  void Keep(const quell::ArraySet& names)
  {
    std::map<std::string, std::vector<float>> kept;
    for (const std::string& name : names)
    {
      if (!this->Film)
      {
        kept[name] = std::move(this->Arrays[name]);
        continue;
      }
      const quell::ArrayType* type = quell::FindArray(name);
      const int components = type ? type->Components : 3; // bounce layers are not in the table
      std::vector<float>& values = kept[name];
      values.resize(std::size_t(this->Region.area()) * std::size_t(components));
      this->Film->Develop(name, this->Region, this->Samples, quell::ImageOut(values.data(), components, this->Region),
        this->GuideSamples);
    }
    this->Arrays = std::move(kept);
    this->Names = names;
    this->Film.reset();
  }
  void Get(const std::string& name, const quell::Rect& part, const quell::ImageOut& out) const
  {
    if (this->Film)
    {
      this->Film->Develop(name, part, this->Samples, out, this->GuideSamples);
      return;
    }
    const std::vector<float>& from = this->Arrays.at(name);
    const std::size_t n = std::size_t(out.components);
    for (int y = part.y0; y < part.y1; ++y)
      std::memcpy(out.at(part.x0, y),
        &from[n * (std::size_t(y - this->Region.y0) * std::size_t(this->Region.width()) +
                    std::size_t(part.x0 - this->Region.x0))],
        std::size_t(part.width()) * n * sizeof(float));
  }
};

struct vtkQuellPathTraceSource::Internals
{
  std::shared_ptr<const quell::Scene> Given;  ///< by SetScene
  std::shared_ptr<const quell::Scene> Loaded; ///< from files, or Given with another environment
  std::string LoadedFrom;                     ///< files and their times
  std::string Hash;                           ///< of scene and environment; empty: unknown
  bool Studio = false;                        ///< the sky is ours, because the scene has no light
  bool WarnedOfDarkness = false;
  int Generation = 0; ///< counts scenes
  std::unique_ptr<quell::EmbreeScene> Built;
  int BuiltGeneration = -1, BuiltSelection = -1;
  bool BuiltOneSided = false;

  bool IsBuilt(const vtkQuellPathTraceSource& s) const
  {
    return this->Built && this->BuiltGeneration == this->Generation && this->BuiltSelection == s.LightSelection &&
           this->BuiltOneSided == s.HideBackFaces;
  }

  static quell::EmbreeScene::Options Options(const vtkQuellPathTraceSource& source);

  std::vector<std::unique_ptr<Traced>> Kept;
  bool Partial = false;      ///< the last execution was finished early
  std::string PersistentKey; ///< of that execution: Key, with contents in place of names and counts
  std::string Pending;       ///< work given to LoadWork
  quell::SamplingStatus Status;
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
    "(Veach 1997). `emission + direct + indirect = radiance`: light after no, one, more non-delta scatterings. "
    "`bounce1` ... `bounce64`, light after that many, are made as well.\n\n"
    "Materials: glTF metallic-roughness with GGX, height-correlated Smith masking, Schlick's Fresnel term and energy "
    "compensation (white stays white at every roughness); rough and smooth transmission with the exact Fresnel "
    "equations, refracting where the material bounds a volume, straight through thin walls elsewhere; clearcoat. "
    "Reflection and transmission are perfectly sharp below roughness 0.032. Shadow rays see through "
    "alpha and pass thin, smooth glass straight; other glass blocks them. "
    "Back faces are rendered unless HideBackFaces; single-sided emission shines from the front only.\n\n"
    "Features are means over the samples (`depth`, `position`, `motion`, `normalGeometric` over those that hit), ids "
    "come "
    "from the first sample that hit. With PixelJitter PerSample and one sample per pixel they belong to the jittered "
    "point. Under a lens or an open shutter they are means as well; `motion` is that of the point hit, between the two "
    "frames' own times, as a pinhole sees it.\n\n"
    "Long renders go in passes over the whole region; interrupted ones are written with the samples they have. What "
    "was "
    "traced is kept: more samples of the same sequence continue it.\n\n"
    "Samples that are not finite are dropped from their layer and counted. Border rule: none, every pixel stands "
    "alone.";
  d.Output("radiance", ArrayKind::Color, "linear, scene units; the sum of the three layers");
  d.Output("emission", ArrayKind::Color, "light seen directly and through perfect mirrors and glass");
  d.Output("direct", ArrayKind::Color, "light after one non-delta scattering");
  d.Output("indirect", ArrayKind::Color, "light after two or more");
  d.Output("directDiffuse", ArrayKind::Color, "the part of `direct` that the diffuse lobe made");
  d.Output("directSpecular", ArrayKind::Color, "the rest of it");
  d.Output("indirectDiffuse", ArrayKind::Color,
    "the part of `indirect` that went through the diffuse lobe of the first non-delta vertex");
  d.Output("indirectSpecular", ArrayKind::Color, "the rest of it");
  d.Output("albedo", ArrayKind::Albedo, "reflectance at the first vertex that is not perfect mirror or glass");
  d.Output("albedoDiffuse", ArrayKind::Albedo, "the part of `albedo` of the diffuse lobe");
  d.Output("albedoSpecular", ArrayKind::Albedo, "the part of the other lobes");
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
  d.Output("varianceAlbedo", ArrayKind::Variance, "of the pixel's mean albedo, averaged over the channels");
  d.Output(
    "varianceNormal", ArrayKind::Variance, "of the pixel's mean normal before it is made unit, averaged likewise");
  d.Output("moments", ArrayKind::Moments, "mean and central second moment of the samples' luminance");
  d.Output("halfA", ArrayKind::Color, "radiance of the even samples");
  d.Output("halfB", ArrayKind::Color, "radiance of the odd samples");
  d.Output("samples", ArrayKind::Scalar, "samples spent");
  d.Output("alpha", ArrayKind::Scalar, "part of the samples that hit something");

  QUELL_PATH(d, Scene, "glTF 2.0 (.gltf, .glb) or OBJ file");
  QUELL_STRING(d, Camera, "name or number of a camera; empty: the first, or one that frames the whole scene");
  QUELL_STRING(d, Animation, "name or number of a glTF animation; empty: all that move different things");
  QUELL_PATH(d, Environment, "latitude-longitude image that replaces the scene's environment");
  QUELL_ENUM(d, DefaultSky,
    "whether a studio sky lights a scene without environment: where it has no light at all, always, never", "WhenDark",
    "Always", "Never");
  QUELL_BOOL(d, HideBackFaces, "surfaces that are not double-sided are invisible from behind; glass is not among them");
  QUELL_INT(d, Width, "pixels", "frame width; 0: the scene's resolution, else 256");
  QUELL_INT(d, Height, "pixels", "frame height; 0: the scene's resolution, else 256");
  QUELL_INT(d, SamplesPerPixel, "samples", "camera paths per pixel and frame");
  QUELL_INT(d, FirstSample, "samples", "samples of the sequence to skip, to continue an earlier image");
  QUELL_INT(d, SamplesPerTick, "samples",
    "of the sequence from one frame to the next; 0: SamplesPerPixel. N sources of one sample (FirstSample 0 to N - 1) "
    "want N");
  QUELL_INT(d, MaximumBounces, "scatterings",
    "0: emission only, 1: direct light, 2: one indirect bounce ...; -1: the scene's max_depth - 1, else 6");
  QUELL_INT(d, RussianRouletteStart, "scatterings", "scatterings before paths end by chance");
  QUELL_INT(d, Seed, "", "other seeds give independent noise");
  QUELL_DOUBLE(d, SampleClamp, "radiance",
    "longest RGB length of one sample's direct and of its indirect light; 0: off. Darkens: a bias");
  QUELL_ENUM(d, PixelJitter, "where in the pixel samples lie: anywhere, at one Halton offset per frame, at the centre",
    "PerSample", "PerFrame", "None");
  QUELL_ENUM(d, SamplePattern,
    "points of the paths: Owen-scrambled Sobol; blue noise on the screen, for few samples below a filter; independent",
    "Sobol", "BlueNoise", "Random");
  QUELL_ENUM(d, LightSelection,
    "how lamps are picked: Auto (a light tree from 8 lamps on), by power alone, by the tree", "Auto", "Power", "Tree");
  QUELL_INT(d, GuideSamples, "samples",
    "camera rays that make albedo, normal and roughness alone, in place of the light samples; 0: light samples make "
    "them");
  QUELL_ENUM(d, PixelFilter, "density of the samples around the pixel's centre, with PixelJitter PerSample", "Box",
    "Tent", "Gaussian", "BlackmanHarris");
  QUELL_DOUBLE(d, FilterRadius, "pixels", "half of the filter's width; 0: 0.5 for Box, 1 for Tent, 1.5 for the others");
  QUELL_DOUBLE(d, LensRadius, "scene units", "of a thin lens, focal length / (2 f-number); 0: a pinhole, all is sharp");
  QUELL_DOUBLE(d, FocusDistance, "scene units", "depth of what is sharp; 0: of what the middle of the frame sees");
  QUELL_INT(d, LensBlades, "corners", "of the lens's opening; below 3: round");
  QUELL_DOUBLE(d, ShutterTime, "frames",
    "part of the time between two frames that the shutter is open, centred on the frame's time; 0: no motion blur");
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

void vtkQuellPathTraceSource::SetViewpoint(const Viewpoint& viewpoint)
{
  const auto same = [](const quell::Mat4& a, const quell::Mat4& b) { return std::memcmp(a.m, b.m, sizeof a.m) == 0; };
  if (!this->Outside || !same(this->Outside->Camera, viewpoint.Camera) ||
      !same(this->Outside->Before, viewpoint.Before) || this->Outside->Tick != viewpoint.Tick ||
      this->Outside->FromScene != viewpoint.FromScene)
  {
    this->Outside.reset(new Viewpoint(viewpoint));
    this->Modified();
  }
}

void vtkQuellPathTraceSource::ClearViewpoint()
{
  if (this->Outside)
  {
    this->Outside.reset();
    this->Modified();
  }
}

void vtkQuellPathTraceSource::SetAnimation(const std::string& name)
{
  if (this->Animation != name)
  {
    this->Animation = name;
    this->Internal->Loaded = nullptr;
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
const char* const NoScene = "no scene: set Scene to a glTF or OBJ file";

/// Arrays of the primary hit: no parameter of light changes them.
bool IsPrimary(const std::string& array)
{
  static const std::set<std::string> names{ "depth", "position", "normalGeometric", "motion", "id", "material", "alpha",
    "samples" };
  return names.count(array) != 0;
}
/// Parameters that arrays of the primary hit do not depend on.
bool IsOfLight(const std::string& property)
{
  static const std::set<std::string> names{ "MaximumBounces", "RussianRouletteStart", "SampleClamp", "LightSelection",
    "GuideSamples" };
  return names.count(property) != 0;
}

/// FNV-1a (64 bit) of a file's bytes, going on from `hash`.
std::uint64_t HashFile(const std::string& file, std::uint64_t hash)
{
  std::ifstream stream(file, std::ios::binary);
  char buffer[1 << 14];
  while (stream.read(buffer, sizeof buffer) || stream.gcount() > 0)
    for (std::streamsize i = 0; i < stream.gcount(); ++i)
      hash = (hash ^ std::uint64_t(static_cast<unsigned char>(buffer[i]))) * 1099511628211ull;
  return hash;
}

std::string Counted(std::int64_t n, const char* what)
{
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

/// A file and when it was written; a missing file has no time and fails when it is read.
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
  quell::SceneOptions options;
  options.Animation = this->Animation;
  try
  {
    std::shared_ptr<const quell::Scene> scene = in.Given ? in.Given : quell::LoadScene(this->Scene, options);
    if (!this->Environment.empty())
    {
      auto lit = std::make_shared<quell::Scene>(*scene);
      quell::LoadEnvironment(*lit, this->Environment);
      scene = lit;
    }
    in.WarnedOfDarkness = false;
    const std::shared_ptr<const quell::Scene> base = scene;
    in.Studio = this->DefaultSky == WhenDark && !scene->HasLight();
    if (in.Studio || (this->DefaultSky == Always && !scene->Sky.Present))
    {
      auto lit = std::make_shared<quell::Scene>(*scene);
      quell::AddStudioSky(*lit);
      scene = lit;
    }
    in.Loaded = scene;
    // What the pixels show is the scene and what lights it.
    in.Hash = scene->Hash;
    const bool sky = in.Studio || (this->DefaultSky == Always && !base->Sky.Present);
    if (!in.Hash.empty() && (sky || !this->Environment.empty()))
    {
      std::uint64_t hash = 14695981039346656037ull;
      for (char c : in.Hash + (sky ? " studio" : ""))
        hash = (hash ^ std::uint64_t(static_cast<unsigned char>(c))) * 1099511628211ull;
      if (!this->Environment.empty())
        hash = HashFile(this->Environment, hash);
      char text[24];
      std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
      in.Hash = text;
    }
  }
  catch (const std::exception& e)
  {
    throw quell::StageError(e.what());
  }
  in.LoadedFrom = stamp;
  ++in.Generation;
  return *in.Loaded;
}

quell::EmbreeScene::Options vtkQuellPathTraceSource::Internals::Options(const vtkQuellPathTraceSource& s)
{
  quell::EmbreeScene::Options options;
  options.Lights = quell::LightSelection(s.LightSelection);
  options.HideBackFaces = s.HideBackFaces;
  return options;
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

std::vector<quell::OutputArray> vtkQuellPathTraceSource::ListDynamicOutputs()
{
  // Without a number of our own the scene decides, which is not opened for this.
  const int layers = this->MaximumBounces < 0 ? quell::PathSample::MaximumBounceLayers
                                              : std::min(this->MaximumBounces, quell::PathSample::MaximumBounceLayers);
  std::vector<quell::OutputArray> list;
  for (int n = 1; n <= layers; ++n)
    list.push_back({ "bounce" + std::to_string(n), quell::ArrayKind::Color, 3,
      "light after " + Counted(n, "non-delta scattering") });
  return list;
}

double vtkQuellPathTraceSource::Radius() const
{
  return this->FilterRadius > 0      ? this->FilterRadius
         : this->PixelFilter == Box  ? 0.5
         : this->PixelFilter == Tent ? 1
                                     : 1.5;
}

double vtkQuellPathTraceSource::ScratchBytes(
  const quell::Rect& region, const quell::Rect&, const quell::ArraySet& asked)
{
  return this->SamplesPerPixel == 1
           ? 0
           : double(quell::Film({ 0, 0, 1, 1 }, asked).BytesPerPixel()) * double(region.area());
}

double vtkQuellPathTraceSource::CostPerPixel() const
{
  return 20. * this->SamplesPerPixel;
}

quell::SamplingStatus vtkQuellPathTraceSource::GetSamplingStatus() const
{
  return this->Internal->Status;
}

namespace
{
/// Little-endian numbers and texts in a string of bytes.
struct WorkWriter
{
  std::string Bytes;
  template <class T>
  void Number(T value)
  {
    this->Bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void Text(const std::string& text)
  {
    this->Number(std::uint64_t(text.size()));
    this->Bytes += text;
  }
};
struct WorkReader
{
  const std::string& Bytes;
  std::size_t At = 0;
  bool Good = true;

  template <class T>
  T Number()
  {
    T value{};
    this->Good = this->Good && this->Bytes.size() - this->At >= sizeof value;
    if (this->Good)
    {
      std::memcpy(&value, &this->Bytes[this->At], sizeof value);
      this->At += sizeof value;
    }
    return value;
  }
  std::string Text()
  {
    const std::uint64_t size = this->Number<std::uint64_t>();
    this->Good = this->Good && this->Bytes.size() - this->At >= size;
    if (!this->Good)
      return std::string();
    this->At += std::size_t(size);
    return this->Bytes.substr(this->At - std::size_t(size), std::size_t(size));
  }
};
const char* const WorkMagic = "path tracer's sums 1";

/// One film of a saved work, before it is known whether it fits.
struct SavedFilm
{
  quell::Rect Region;
  int Samples = 0;
  quell::ArraySet Names;
  std::vector<double> Sums;
};
bool ReadWork(const std::string& bytes, std::string& key, std::vector<SavedFilm>& films)
{
  WorkReader r{ bytes };
  if (r.Text() != WorkMagic)
    return false;
  key = r.Text();
  for (std::uint32_t n = r.Number<std::uint32_t>(); n > 0 && r.Good; --n)
  {
    SavedFilm film;
    for (int* v : { &film.Region.x0, &film.Region.y0, &film.Region.x1, &film.Region.y1, &film.Samples })
      *v = r.Number<std::int32_t>();
    for (std::uint32_t a = r.Number<std::uint32_t>(); a > 0 && r.Good; --a)
      film.Names.insert(r.Text());
    const std::uint64_t count = r.Number<std::uint64_t>();
    r.Good = r.Good && film.Samples > 0 && !film.Region.empty() && count <= (bytes.size() - r.At) / sizeof(double);
    if (!r.Good)
      return false;
    film.Sums.resize(std::size_t(count));
    if (count > 0)
      std::memcpy(film.Sums.data(), &bytes[r.At], std::size_t(count) * sizeof(double));
    r.At += std::size_t(count) * sizeof(double);
    films.push_back(std::move(film));
  }
  return r.Good && r.At == bytes.size();
}
}

std::string vtkQuellPathTraceSource::SaveWork() const
{
  const Internals& in = *this->Internal;
  if (!in.Partial || in.PersistentKey.empty())
    return std::string();
  WorkWriter w;
  w.Text(WorkMagic);
  w.Text(in.PersistentKey);
  std::uint32_t films = 0;
  for (const auto& t : in.Kept)
    films += t->Film && t->Samples > 0;
  w.Number(films);
  for (const auto& t : in.Kept)
  {
    if (!t->Film || t->Samples == 0)
      continue;
    for (int v : { t->Region.x0, t->Region.y0, t->Region.x1, t->Region.y1, t->Samples })
      w.Number(std::int32_t(v));
    w.Number(std::uint32_t(t->Names.size()));
    for (const std::string& name : t->Names)
      w.Text(name);
    const std::vector<double>& sums = t->Film->Data();
    w.Number(std::uint64_t(sums.size()));
    w.Bytes.append(reinterpret_cast<const char*>(sums.data()), sums.size() * sizeof(double));
  }
  return w.Bytes;
}

std::string vtkQuellPathTraceSource::HashOfContents()
{
  this->LoadedScene();
  return this->Internal->Hash;
}

bool vtkQuellPathTraceSource::LoadWork(const std::string& bytes, std::string& error)
{
  std::string key;
  std::vector<SavedFilm> films;
  if (!ReadWork(bytes, key, films))
  {
    error = "the saved samples are damaged";
    return false;
  }
  this->Internal->Pending = bytes;
  this->Modified();
  return true;
}

namespace
{
/// Median over the pixels that have noise of the standard error of luminance divided by its mean; -1: cannot be told.
double NoiseOf(const quell::Film& film, const quell::Rect& region, int samples)
{
  if (samples < 2 || film.At().Luminance < 0 || region.empty())
    return -1;
  // Some 10^5 pixels tell it well: every k-th row.
  const int step = int(1 + std::int64_t(region.area()) / 100000);
  std::vector<float> row(2 * std::size_t(region.width())), ratios;
  for (int y = region.y0; y < region.y1; y += step)
  {
    const quell::Rect part{ region.x0, y, region.x1, y + 1 };
    film.Develop("moments", part, samples, quell::ImageOut(row.data(), 2, part));
    for (std::size_t x = 0; x < row.size(); x += 2)
      if (row[x] > 0 && row[x + 1] > 0)
        ratios.push_back(std::sqrt(row[x + 1] / float(samples - 1)) / row[x]);
  }
  if (ratios.empty())
    return -1;
  const auto middle = ratios.begin() + std::ptrdiff_t(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  return double(*middle);
}
}

void vtkQuellPathTraceSource::Sample(
  quell::StageFrame& frame, std::vector<std::unique_ptr<Traced>>& work, const quell::Integrator& integrator)
{
  using Clock = std::chrono::steady_clock;
  constexpr double PassSeconds = 0.5;
  const quell::Rect region = frame.Region();
  const int target = this->SamplesPerPixel;
  quell::SamplingStatus& status = this->Internal->Status;
  status = quell::SamplingStatus();
  status.Target = target;
  const auto before = [](const std::unique_ptr<Traced>& a, const std::unique_ptr<Traced>& b)
  { return a->Samples < b->Samples; };
  std::atomic<std::int64_t> rays{ 0 }, paths{ 0 }, nonFinite{ 0 };
  double seconds = 0, noiseAt = 0;
  std::vector<int> made(work.size(), 0);
  status.Begun = (*std::min_element(work.begin(), work.end(), before))->Samples;
  for (;;)
  {
    // Who lags behind goes first, so that all arrays have the same samples when the render is finished early.
    const std::size_t at = std::size_t(std::min_element(work.begin(), work.end(), before) - work.begin());
    Traced& next = *work[at];
    status.Samples = next.Samples;
    if (next.Samples >= target || (this->IsFinishing() && next.Samples > 0))
      break;
    int limit = target;
    for (const auto& t : work)
      if (t->Samples > next.Samples)
        limit = std::min(limit, t->Samples);
    int count = 1;
    if (next.Film->BytesPerPixel() == 0)
      count = limit - next.Samples;
    else if (next.SecondsPerSample > 0)
      count = int(std::max(1., std::min(PassSeconds / next.SecondsPerSample, std::max(1., 8. * made[at]))));
    count = std::min(count, limit - next.Samples);

    double done = 0;
    for (const auto& t : work)
      done += t->Samples;
    const double all = double(target) * double(work.size());
    const Clock::time_point start = Clock::now();
    if (next.Film->BytesPerPixel() > 0)
      this->ForEachTile(
        region, 16,
        [&](const quell::Rect& tile)
        {
          quell::TraceCounters counters;
          integrator.Render(*next.Film, tile, next.Samples, count, counters);
          rays += counters.Rays;
          paths += counters.Paths;
          nonFinite += counters.NonFinite;
        },
        done / all, (done + count) / all);
    const double took = std::chrono::duration<double>(Clock::now() - start).count();
    next.Samples += count;
    made[at] += count;
    next.SecondsPerSample = took / count;
    seconds += took;
    status.Samples = (*std::min_element(work.begin(), work.end(), before))->Samples;
    status.SamplesPerSecond = seconds > 0 ? double(paths) / seconds : 0;
    // Every pass to begin with, then seldom enough to cost nothing, and at the end.
    if (this->IsWatched() && next.Film->At().Luminance >= 0 &&
        (seconds < 2 || seconds > 1.2 * noiseAt || next.Samples >= target))
    {
      status.Noise = NoiseOf(*next.Film, region, next.Samples);
      noiseAt = seconds;
    }
    if (next.Samples < target)
      this->UpdateProgress((done + count) / all);
  }
  this->Count(rays, paths, nonFinite);
}

void vtkQuellPathTraceSource::SampleOnce(
  quell::StageFrame& frame, const quell::ArraySet& names, const quell::Integrator& integrator)
{
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::pair<std::string, quell::ImageOut>> outputs;
  for (const std::string& name : names)
    outputs.push_back({ name, frame.Output(name) });
  std::atomic<std::int64_t> rays{ 0 }, paths{ 0 }, nonFinite{ 0 };
  // A tile's sums fit a cache.
  constexpr int size = 16;
  vtkSMPThreadLocal<std::shared_ptr<quell::Film>> films;
  this->ForEachTile(frame.Region(), size,
    [&](const quell::Rect& tile)
    {
      std::shared_ptr<quell::Film>& film = films.Local();
      if (!film)
        film = std::make_shared<quell::Film>(quell::Rect{ 0, 0, size, size }, names);
      film->MoveTo(tile);
      quell::TraceCounters counters;
      integrator.Render(*film, tile, 0, 1, counters);
      for (const auto& o : outputs)
        film->Develop(o.first, tile, 1, o.second, this->GuideSamples);
      rays += counters.Rays;
      paths += counters.Paths;
      nonFinite += counters.NonFinite;
    });
  quell::SamplingStatus& status = this->Internal->Status;
  status = quell::SamplingStatus();
  status.Target = status.Samples = 1;
  const double took = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  status.SamplesPerSecond = took > 0 ? double(paths) / took : 0;
  this->Count(rays, paths, nonFinite);
}

void vtkQuellPathTraceSource::Count(std::int64_t rays, std::int64_t paths, std::int64_t nonFinite)
{
  this->Counters.Rays += rays;
  this->Counters.Paths += paths;
  this->Counters.NonFinite += nonFinite;
  if (nonFinite > 0)
    this->Warnings.push_back(std::to_string(nonFinite) + " samples were not finite and were dropped");
}

void vtkQuellPathTraceSource::Execute(quell::StageFrame& frame)
{
  Internals& in = *this->Internal;
  const quell::Scene& scene = this->LoadedScene();
  this->Warnings.insert(this->Warnings.end(), scene.Warnings.begin(), scene.Warnings.end());
  const quell::Rect region = frame.Region(), whole = frame.Whole();
  const int tick = frame.Tick(), target = this->SamplesPerPixel;
  const double rate = this->Ticks.Rate > 0 ? this->Ticks.Rate : 1;
  const double time = (this->Outside ? this->Outside->Tick : tick) / rate, shutter = this->ShutterTime / rate;

  try
  {
    if (!in.IsBuilt(*this))
    {
      in.Built.reset();
      in.Built.reset(new quell::EmbreeScene(in.Loaded, Internals::Options(*this)));
      in.BuiltGeneration = in.Generation;
      in.BuiltSelection = this->LightSelection;
      in.BuiltOneSided = this->HideBackFaces;
    }
    in.Built->SetShutter(-shutter / 2, shutter / 2);
    in.Built->SetTime(time, this->Outside ? time : (tick - 1) / rate);
  }
  catch (const std::exception& e)
  {
    in.Built.reset();
    throw quell::StageError(e.what());
  }
  quell::EmbreeScene& built = *in.Built;
  this->Warnings.insert(this->Warnings.end(), built.Warnings.begin(), built.Warnings.end());

  const quell::Vec3d across = built.RestUpper - built.RestLower;
  const double size = std::max({ across.x, across.y, across.z });
  if (size > 0 && (size < quell::SmallestScene || size > quell::LargestScene))
  {
    char text[200];
    std::snprintf(text, sizeof text,
      "the scene is %.3g across: below 2e-9 and above 1e12 areas and distances leave float's range, and light is wrong "
      "or missing; choose another unit of length",
      size);
    this->Warnings.push_back(text);
  }

  quell::Integrator integrator;
  integrator.Scene = &built;
  const int index = quell::Camera::Find(scene, this->Camera);
  if (index < 0)
    integrator.View = integrator.PreviousView =
      quell::Camera::Framing(built.RestLower, built.RestUpper, built.Origin(), whole.width(), whole.height());
  else
  {
    const quell::CameraModel& model = scene.Cameras[index];
    const auto pose = [&](const quell::Mat4& matrix)
    { return quell::Camera(model, matrix, built.Origin(), whole.width(), whole.height()); };
    const auto at = [&](bool previous)
    { return model.Node >= 0 ? built.NodeMatrix(model.Node, previous) : model.WorldFromCamera; };
    const std::string named = "camera " + (model.Name.empty() ? std::to_string(index) : '"' + model.Name + '"');
    if (!quell::Camera::HasDirection(at(false)))
      throw quell::StageError(
        named + " shows in no direction: its matrix, or one above it, cannot be inverted (a scale of 0?)");
    integrator.View = pose(at(false));
    integrator.PreviousView = quell::Camera::HasDirection(at(true)) ? pose(at(true)) : integrator.View;
    const quell::Vec3d& eye = integrator.View.Position;
    if (!(std::max({ std::fabs(eye.x), std::fabs(eye.y), std::fabs(eye.z) }) < double(quell::LargestCoordinate)))
      throw quell::StageError(named + " is farther than 1e18 from the scene; rays have no digits there");
    if (shutter > 0 && model.Node >= 0 && scene.Animated())
      integrator.View.MoveInShutter(
        pose(built.NodeMatrix(model.Node, time - shutter / 2)), pose(built.NodeMatrix(model.Node, time + shutter / 2)));
  }
  if (this->Outside)
  {
    const quell::CameraModel model = index < 0 ? quell::CameraModel() : scene.Cameras[index];
    const auto pose = [&](const quell::Mat4& matrix)
    { return quell::Camera(model, matrix, built.Origin(), whole.width(), whole.height()); };
    integrator.PreviousView = this->Outside->FromScene ? integrator.View : pose(this->Outside->Before);
    integrator.View = pose(this->Outside->Camera);
  }
  integrator.Shutter = shutter > 0 && (built.Has.MotionBlur || integrator.View.MovesInShutter());
  if (this->LensRadius > 0)
  {
    quell::Camera& view = integrator.View;
    view.LensRadius = this->LensRadius;
    view.LensBlades = this->LensBlades;
    view.FocusDistance = this->FocusDistance;
    if (!(view.FocusDistance > 0))
    {
      quell::Vec3d start, forward;
      view.Ray(0.5 * whole.width(), 0.5 * whole.height(), start, forward);
      quell::EmbreeScene::Context context;
      built.Begin(context);
      quell::TraceRay ray;
      ray.Origin = quell::Vec3f(start);
      ray.Direction = quell::Vec3f(forward);
      ray.Time = integrator.Shutter ? 0.5f : 0.f;
      quell::SurfaceHit hit;
      const quell::Vec3d middle = (built.RestLower + built.RestUpper) * 0.5 - built.Origin();
      const double depth = view.Depth(built.Intersect(context, ray, hit) ? hit.P : middle);
      view.FocusDistance = std::isfinite(depth) && depth > 0 ? depth : 1;
    }
  }
  integrator.MaximumBounces = this->Bounces();
  integrator.RouletteStart = this->RussianRouletteStart;
  integrator.GuideSamples = this->GuideSamples;
  integrator.Seed = std::uint64_t(this->Seed);
  integrator.Tick = tick;
  integrator.SamplesPerPixel = target;
  integrator.FirstSample = this->FirstSample;
  integrator.SamplesPerTick = this->SamplesPerTick;
  integrator.SampleClamp = float(this->SampleClamp);
  integrator.Pattern = quell::SamplePattern(this->SamplePattern);
  integrator.PixelJitter = quell::Integrator::Jitter(this->PixelJitter);
  integrator.Filter = quell::PixelFilter(quell::PixelFilter::Shape(this->PixelFilter), this->Radius());

  quell::FrameFacts& facts = frame.OutputFacts;
  facts.HasCamera = true;
  facts.WorldToCamera = integrator.View.WorldToCamera();
  facts.WorldToNdc = integrator.View.WorldToNdc();
  facts.Origin = built.Origin();
  facts.Tick = tick;
  facts.Time = time;
  facts.Seed = this->Seed;
  facts.Scene = in.Hash;

  // Everything the pixels depend on. Of the numbers of samples only where the sequence begins: how far it goes is
  // Traced::Samples.
  const int stride = this->SamplesPerTick ? this->SamplesPerTick : target;
  const std::uint32_t first = std::uint32_t(tick) * std::uint32_t(stride) + std::uint32_t(this->FirstSample);
  std::string shared = std::to_string(tick) + ' ' + std::to_string(rate) + ' ' + std::to_string(whole.width()) + 'x' +
                       std::to_string(whole.height()) + ' ' + std::to_string(first);
  if (integrator.Pattern == quell::SamplePattern::BlueNoise)
    shared += " of " + std::to_string(target); // its points depend on how many there are
  if (this->Outside)
  {
    shared += this->Outside->FromScene ? " seen from" : " then seen from";
    for (const quell::Mat4* m : { &this->Outside->Camera, &this->Outside->Before })
      for (const auto& row : m->m)
        for (const double v : row)
          shared += ' ' + quell::detail::FormatDouble(v);
    shared += " at " + std::to_string(this->Outside->Tick);
  }
  std::string primaryKey = std::to_string(in.Generation) + ' ' + shared, key = primaryKey;
  std::string persistentKey = in.Hash + ' ' + shared;
  for (const quell::Property& p : this->GetDescription().Properties)
  {
    if (p.Name == "SamplesPerPixel" || p.Name == "FirstSample" || p.Name == "SamplesPerTick")
      continue;
    const std::string text = '\n' + p.GetText(this);
    key += text;
    if (!IsOfLight(p.Name))
      primaryKey += text;
    if (p.Kind != quell::Property::Type::Path)
      persistentKey += text;
  }
  in.PersistentKey = in.Hash.empty() ? std::string() : persistentKey;

  if (!in.Pending.empty())
  {
    std::string theirs;
    std::vector<SavedFilm> films;
    bool fits = ReadWork(in.Pending, theirs, films) && theirs == in.PersistentKey;
    in.Pending.clear();
    if (fits)
      in.Kept.clear();
    for (SavedFilm& film : films)
    {
      fits = fits && film.Region == region && film.Samples <= target;
      if (!fits)
        break;
      auto t = std::make_unique<Traced>();
      t->PrimaryKey = primaryKey;
      t->Key = key;
      t->Region = film.Region;
      t->Samples = film.Samples;
      t->GuideSamples = this->GuideSamples;
      t->Names = film.Names;
      try
      {
        t->Film = std::make_unique<quell::Film>(region, film.Names);
        fits = t->Film->SetData(std::move(film.Sums));
      }
      catch (const std::invalid_argument&)
      {
        fits = false;
      }
      if (fits)
        in.Kept.push_back(std::move(t));
    }
    if (!fits)
      this->Warnings.push_back("the saved samples are of another frame or scene: all are traced anew");
  }

  // What is of no use any more goes before more memory is taken; a film's memory serves the next one.
  std::vector<double> spare;
  for (auto& t : in.Kept)
  {
    bool keep = t->Region.contains(region) && t->PrimaryKey == primaryKey &&
                (t->Samples == target || (t->Film && t->Samples < target && t->Region == region));
    if (keep && t->Key != key)
    {
      quell::ArraySet names;
      for (const std::string& name : t->Names)
        if (IsPrimary(name))
          names.insert(name);
      keep = !names.empty() && t->Samples == target;
      if (keep)
      {
        t->Keep(names);
        t->Key = key;
      }
    }
    if (!keep)
    {
      if (t->Film && t->Film->Data().size() > spare.size())
        spare = t->Film->TakeMemory();
      t.reset();
    }
  }
  in.Kept.erase(std::remove(in.Kept.begin(), in.Kept.end(), nullptr), in.Kept.end());

  quell::ArraySet wanted;
  for (const quell::OutputArray& output : this->GetDescription().Outputs)
    if (frame.Wants(output.Name))
      wanted.insert(output.Name);
  for (const quell::OutputArray& output : this->ListDynamicOutputs())
    if (frame.Wants(output.Name))
    {
      wanted.insert(output.Name);
      frame.AddOutput(output.Name, output.Components);
    }
  // Who has what: complete, to be continued, or nobody. Light is not continued for the primary hit's arrays.
  quell::ArraySet missing;
  std::set<const Traced*> continued;
  const auto holder = [&](const std::string& name, bool complete) -> Traced*
  {
    for (const auto& t : in.Kept)
      if (t->Names.count(name) && (t->Samples == target) == complete &&
          (complete || !t->Film->WantsLight() || continued.count(t.get()) || !IsPrimary(name)))
        return t.get();
    return nullptr;
  };
  for (int pass = 0; pass < 2; ++pass) // light decides what is continued, the primary hit goes along
    for (const std::string& name : wanted)
      if (IsPrimary(name) == (pass == 1) && !holder(name, true))
      {
        if (const Traced* t = holder(name, false))
          continued.insert(t);
        else
          missing.insert(name);
      }

  // Until they are complete again they are nobody's: a cancelled pass leaves them in pieces.
  std::vector<std::unique_ptr<Traced>> work;
  for (auto& t : in.Kept)
    if (t->Samples < target)
    {
      if (continued.count(t.get()))
        work.push_back(std::move(t));
      t.reset();
    }
  in.Kept.erase(std::remove(in.Kept.begin(), in.Kept.end(), nullptr), in.Kept.end());
  in.Partial = false;
  if (!missing.empty())
  {
    quell::Rect one = region;
    one.x1 = one.x0 + 1;
    one.y1 = one.y0 + 1;
    const quell::Film probe(one, missing);
    if (probe.WantsDirect() || probe.WantsIndirect())
    {
      if (in.Studio)
        this->Warnings.push_back(
          "the scene has no light: a studio sky lights it; set Environment, or DefaultSky to Never");
      else if (!scene.HasLight())
        this->Warnings.push_back("the scene has no light: set Environment, or give a material an emission");
    }
    if (target == 1 && (missing.count("halfA") || missing.count("halfB")))
      this->Warnings.push_back("one sample per pixel makes no two halves: halfA and halfB are the same");
    if (target > 1)
    {
      auto t = std::make_unique<Traced>();
      t->PrimaryKey = primaryKey;
      t->Key = key;
      t->Region = region;
      t->GuideSamples = this->GuideSamples;
      t->Names = missing;
      // Noise is reported of renders that take a while and make all light anyway.
      if (this->IsWatched() && target >= 16 && probe.WantsEmission() && probe.WantsDirect() && probe.WantsIndirect())
        t->Names.insert("moments");
      try
      {
        t->Film = std::make_unique<quell::Film>(region, t->Names, std::move(spare));
      }
      catch (const std::bad_alloc&)
      {
        throw quell::StageError("there is no memory for the sums of " + std::to_string(region.width()) + " x " +
                                std::to_string(region.height()) + " pixels, " +
                                std::to_string(quell::Film(one, t->Names).BytesPerPixel()) +
                                " bytes each; render it in regions, or ask for fewer arrays at once");
      }
      work.push_back(std::move(t));
    }
    else
      this->SampleOnce(frame, missing, integrator);
  }

  int samples = target;
  if (!work.empty())
  {
    this->Sample(frame, work, integrator);
    for (auto& t : work)
    {
      samples = std::min(samples, t->Samples);
      in.Kept.push_back(std::move(t));
    }
  }
  in.Partial = samples < target;
  facts.SamplesPerPixel = samples;
  if (in.Partial)
    facts.Partial = std::to_string(samples) + " of " + std::to_string(target) + " samples";

  std::vector<std::pair<const Traced*, std::pair<std::string, quell::ImageOut>>> outputs;
  std::size_t held = 0;
  for (const std::string& name : wanted)
  {
    const quell::ImageOut out = frame.Output(name);
    const Traced* from = nullptr;
    for (const auto& t : in.Kept)
      if (t->Names.count(name) && (!from || t->Samples > from->Samples))
        from = t.get();
    if (from)
      outputs.push_back({ from, { name, out } });
    held += std::size_t(region.area()) * std::size_t(out.components) * sizeof(float);
  }
  // A tile's sums fit a cache: every array reads all of them.
  if (!outputs.empty())
    this->ForEachTile(
      region, 32,
      [&](const quell::Rect& tile)
      {
        for (const auto& o : outputs)
          o.first->Get(o.second.first, tile, o.second.second);
      },
      1, 1);

  std::vector<quell::ImageOut> seen;
  for (const char* name : { "emission", "direct", "indirect" })
    if (missing.count(name))
      seen.push_back(frame.Output(name));
  if (missing.count("radiance"))
    seen = { frame.Output("radiance") };
  if ((missing.count("radiance") || seen.size() == 3) && integrator.MaximumBounces > 0 && region == whole &&
      scene.HasLight() && !in.WarnedOfDarkness)
  {
    std::ptrdiff_t lit = 0;
    for (std::ptrdiff_t p = 0; p < region.area(); ++p)
    {
      float sum[3] = {};
      for (const quell::ImageOut& image : seen)
        for (int c = 0; c < 3; ++c)
          sum[c] += image.data[3 * p + c];
      lit += std::max({ sum[0], sum[1], sum[2] }) > 1e-3f;
    }
    if (100 * lit < region.area())
    {
      in.WarnedOfDarkness = true;
      this->Warnings.push_back(
        "almost every pixel is black (below 0.001): little light reaches what the camera sees; set "
        "Environment, DefaultSky to Always, or another Camera");
    }
  }

  std::size_t films = 0;
  for (const auto& t : in.Kept)
    films += t->FilmBytes();
  for (auto& t : in.Kept)
  {
    // The work in a partial frame stays: it is to be saved or continued.
    if (films > this->FilmMemory && t->Film && !in.Partial)
    {
      films -= t->FilmBytes();
      t->Keep(t->Names);
    }
    held += t->FilmBytes();
    for (const auto& array : t->Arrays)
      held += array.second.size() * sizeof(float);
  }
  this->Counters.Held = std::int64_t(held);
}

int vtkQuellPathTraceSource::ComputePipelineMTime(
  vtkInformation* request, vtkInformationVector** in, vtkInformationVector* out, int port, vtkMTimeType* mtime)
{
  if (this->Internal->Partial)
    this->Modified(); // the next update goes on
  return this->Superclass::ComputePipelineMTime(request, in, out, port, mtime);
}

std::vector<std::string> vtkQuellPathTraceSource::Explain()
{
  std::vector<std::string> lines;
  try
  {
    const quell::Scene& scene = this->LoadedScene();
    quell::ArraySet asked = REQUESTED_ARRAYS()->Read(this->GetOutputInformation(0)), traced;
    if (asked.count(PrimaryArray()))
      asked.insert(this->GetDescription().Outputs.front().Name);
    for (const std::string& name : asked)
      if (this->GetDescription().FindOutput(name) || name.compare(0, 6, "bounce") == 0)
        traced.insert(name);
    const quell::Film film({ 0, 0, 1, 1 }, traced);
    const bool light = traced.empty() || film.WantsLight();
    const bool indirect = traced.empty() || film.WantsIndirect(), scattered = indirect || film.WantsDirect();

    bool glossy = false, glass = false, seeThrough = false, textures = false, emissive = false;
    for (const quell::Material& m : scene.Materials)
    {
      glossy |= !m.Unlit && (m.Metallic > 0 || m.Specular > 0);
      glass |= m.Transmission > 0;
      seeThrough |= m.Mode != quell::AlphaMode::Opaque;
      emissive |= quell::MaxComponent(m.Emission) > 0;
      for (const quell::TextureUse* use : quell::TexturesOf(m))
        textures |= use->Texture >= 0;
    }
    const auto out = [&](bool has, const char* text)
    {
      if (!has)
        lines.push_back(text);
    };
    out(seeThrough, "no alpha: no coverage is tested where a ray hits");
    out(scene.Animated(), "nothing moves: geometry is built once, motion is zero");
    if (light || film.WantsGuides())
    {
      out(glossy, "no glossy material: no specular branch");
      out(glass, "no transmission: no refraction");
      out(textures, "no textures: no look-ups");
    }
    const int bounces = this->Bounces();
    if (light)
    {
      out(scene.Sky.Present, "no environment: rays that leave the scene are black");
      out(emissive, "no emissive material: no area lights");
      out(!scene.Lights.empty(), "no punctual lights");
      if (this->Internal->Studio)
        lines.push_back("no light in the scene: a studio sky lights it");
      if (!scene.HasLight())
        lines.push_back("no light at all: the image is black");
      if (indirect)
        lines.push_back(
          "paths end after " + Counted(bounces, "scattering") +
          (this->MaximumBounces < 0 ? (scene.MaximumDepth >= 0 ? " (the scene's max_depth)" : " (default)") : ""));
      if (indirect && bounces <= this->RussianRouletteStart)
        lines.push_back("no Russian roulette: paths are shorter than RussianRouletteStart");
      if (film.BounceLayers() > bounces)
        lines.push_back("bounce" + std::to_string(bounces + 1) + " and beyond are 0: paths are shorter");
    }
    if (this->LensRadius > 0)
      lines.push_back("a lens: two random numbers more a sample");
    if (this->ShutterTime > 0 && !scene.Animated())
      lines.push_back("an open shutter, but nothing moves: no ray has a time");
    const auto choice = [&](const char* property)
    { return this->GetDescription().FindProperty(property)->GetText(this); };
    if (this->PixelFilter != Box || this->FilterRadius > 0)
    {
      std::ostringstream text;
      text << "pixel filter " << choice("PixelFilter") << " of radius " << this->Radius() << " pixels: ";
      if (this->PixelJitter == PerSample)
        text << "samples are spread by its density";
      else
        text << "without effect, PixelJitter is " << choice("PixelJitter");
      lines.push_back(text.str());
    }
    if (this->SamplePattern != 0)
      lines.push_back("points of the paths: " + choice("SamplePattern"));

    // Which integrator and which choice of lamps that means is known when the scene is ready for rays; what takes long
    // is not done for a plan.
    std::size_t triangles = 0;
    for (const quell::Instance& instance : scene.Instances)
      triangles += scene.Meshes[std::size_t(instance.Mesh)].Indices.size() / 3;
    Internals& in = *this->Internal;
    const bool ready = in.IsBuilt(*this);
    if (!traced.empty() && (ready || triangles < 1000000))
    {
      std::unique_ptr<quell::EmbreeScene> made;
      if (!ready)
      {
        made.reset(new quell::EmbreeScene(in.Loaded, Internals::Options(*this)));
        made->SetTime(0, 0);
      }
      const quell::EmbreeScene& built = ready ? *in.Built : *made;
      if (built.TestedTriangles() > 0)
        lines.push_back("so few triangles that no hierarchy is asked: rays are tested against all " +
                        std::to_string(built.TestedTriangles()));
      const quell::LightSampler& lamps = built.Lights();
      const std::size_t count = lamps.GetTriangles().size() + lamps.GetPunctual().size();
      if (scattered && count > 1)
        lines.push_back(Counted(std::int64_t(count), "lamp") + " (triangles and punctual): picked by " +
                        (lamps.UsesTree() ? "the light tree" : "power") +
                        (this->LightSelection == 0 ? " (LightSelection Auto)" : ""));
      quell::Integrator integrator;
      integrator.Scene = &built;
      integrator.MaximumBounces = bounces;
      integrator.GuideSamples = this->GuideSamples;
      integrator.Pattern = quell::SamplePattern(this->SamplePattern);
      for (std::string& line : integrator.ExplainVariant(film))
        lines.push_back(std::move(line));
    }
  }
  catch (const std::exception& e)
  {
    lines.push_back(e.what());
  }
  return lines;
}
