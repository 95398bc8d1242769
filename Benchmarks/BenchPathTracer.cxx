// SPDX-License-Identifier: BSD-3-Clause
// The path tracer against a bare loop over Embree that replays the very rays it traced, in the same order, on the same
// tiles and threads. Records are kept per tile; writing them is not timed.
#include "quellBench.h"

#include "quellIntegrator.h"
#include "quellWavefront.h"

#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <memory>
#include <thread>

using namespace quell;

namespace
{
constexpr int TileSize = 32;

double ThreadSeconds()
{
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// A quad mesh of n x n cells with waves of height `amplitude` (0 at the border); front along e1 x e2.
void Sheet(Scene& scene, int material, Vec3f a, Vec3f e1, Vec3f e2, int n, float amplitude)
{
  Mesh mesh;
  mesh.Material = material;
  const Vec3f up = Normalized(Cross(e1, e2));
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j)
    {
      const float u = float(i) / float(n), v = float(j) / float(n);
      const float h = amplitude * std::sin(Pi * u) * std::sin(Pi * v) * std::sin(23 * u + 5 * v) * std::cos(29 * v);
      mesh.Positions.push_back(a + e1 * u + e2 * v + up * h);
      mesh.TexCoords[0].push_back({ 2 * u, 2 * v });
    }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
    {
      const std::uint32_t q = std::uint32_t(i * (n + 1) + j), r = q + std::uint32_t(n) + 1;
      mesh.Indices.insert(mesh.Indices.end(), { q, r, q + 1, q + 1, r, r + 1 });
    }
  Instance instance;
  instance.Mesh = int(scene.Meshes.size());
  instance.Id = int(scene.Instances.size()) + 1;
  scene.Meshes.push_back(std::move(mesh));
  scene.Nodes.emplace_back();
  instance.Node = int(scene.Nodes.size()) - 1;
  scene.Instances.push_back(instance);
}

/// Five faces (no bottom) of a block turned about y; fronts outside.
void Block(Scene& scene, int material, Vec3f centre, float half, float height, float turn, int n, bool bottom)
{
  const float c = half * std::cos(turn), s = half * std::sin(turn);
  const Vec3f x{ c, 0, -s }, z{ s, 0, c }, y{ 0, height, 0 };
  Sheet(scene, material, centre - x - z + y, z * 2.f, x * 2.f, n, 0);
  Sheet(scene, material, centre - x + z, x * 2.f, y, n, 0);
  Sheet(scene, material, centre + x - z, x * -2.f, y, n, 0);
  Sheet(scene, material, centre + x + z, z * -2.f, y, n, 0);
  Sheet(scene, material, centre - x - z, z * 2.f, y, n, 0);
  if (bottom)
    Sheet(scene, material, centre - x - z, x * 2.f, z * 2.f, n, 0);
}

Texture Noise(bool srgb, int seed, int low, int high)
{
  Texture t;
  t.Width = t.Height = 1024;
  t.SRGB = srgb;
  t.Bytes.resize(4u * 1024 * 1024);
  std::uint32_t state = std::uint32_t(seed);
  for (std::size_t i = 0; i < t.Bytes.size(); ++i)
  {
    state = state * 1664525u + 1013904223u;
    t.Bytes[i] = std::uint8_t(low + int((state >> 24) * std::uint32_t(high - low) / 255));
  }
  return t;
}

/// The classic box, 36 triangles when `n` is 1; open towards the camera. Every face has n x n cells; `rough` sheets
/// wave.
std::shared_ptr<Scene> Box(int n, bool rough, bool full)
{
  auto scene = std::make_shared<Scene>();
  const auto add = [&](Vec3f color, Vec3f emission)
  {
    Material m;
    m.BaseColor = color;
    m.Metallic = 0;
    m.Specular = 0;
    m.Emission = emission;
    m.DoubleSided = true;
    if (full && !(MaxComponent(emission) > 0))
    {
      const int i = int(scene->Materials.size());
      m.Specular = 1;
      m.Metallic = i == 3 ? 1.f : 0.f;
      m.Roughness = 0.3f + 0.1f * float(i);
      m.BaseColorTexture.Texture = 0;
      m.MetallicRoughnessTexture.Texture = 1;
      m.NormalTexture.Texture = 2;
    }
    scene->Materials.push_back(m);
    return int(scene->Materials.size()) - 1;
  };
  if (full)
  {
    scene->Textures.push_back(Noise(true, 1, 100, 255));
    scene->Textures.push_back(Noise(false, 2, 100, 255));
    scene->Textures.push_back(Noise(false, 3, 110, 146));
    scene->Textures.back().Bytes[2] = 255;
    for (std::size_t i = 2; i < scene->Textures.back().Bytes.size(); i += 4)
      scene->Textures.back().Bytes[i] = 255;
  }
  const int white = add({ .73f, .73f, .73f }, {}), red = add({ .65f, .05f, .05f }, {}),
            green = add({ .12f, .45f, .15f }, {}), blocks = add({ .73f, .73f, .73f }, {}),
            lamp = add({ 0, 0, 0 }, { 17, 12, 4 });
  const float a = rough ? .04f : 0;
  Sheet(*scene, white, { -1, 0, -1 }, { 0, 0, 2 }, { 2, 0, 0 }, n, a);
  Sheet(*scene, white, { -1, 2, -1 }, { 2, 0, 0 }, { 0, 0, 2 }, n, a);
  Sheet(*scene, white, { -1, 0, -1 }, { 2, 0, 0 }, { 0, 2, 0 }, n, a);
  Sheet(*scene, red, { -1, 0, -1 }, { 0, 2, 0 }, { 0, 0, 2 }, n, a);
  Sheet(*scene, green, { 1, 0, -1 }, { 0, 0, 2 }, { 0, 2, 0 }, n, a);
  Block(*scene, blocks, { .35f, 0, .35f }, .3f, .6f, .3f, n, true);
  Block(*scene, blocks, { -.35f, 0, -.3f }, .3f, 1.2f, -.3f, n, true);
  Sheet(*scene, lamp, { -.25f, 1.95f, -.2f }, { .5f, 0, 0 }, { 0, 0, .4f }, 1, 0);
  CameraModel camera;
  camera.YFov = 0.69;
  camera.WorldFromCamera.m[1][3] = 1;
  camera.WorldFromCamera.m[2][3] = 3.8;
  scene->Cameras.push_back(camera);
  return scene;
}

struct Stage
{
  std::shared_ptr<const Scene> Source;
  std::unique_ptr<EmbreeScene> Built;
  Integrator Tracer;
  Rect Area;
  int Samples = 1;
};

Stage Prepare(std::shared_ptr<const Scene> scene, int size, int samples, int bounces,
  const EmbreeScene::Options& options = EmbreeScene::Options())
{
  Stage s;
  s.Source = std::move(scene);
  s.Built = std::make_unique<EmbreeScene>(s.Source, options);
  s.Built->SetTime(0, 0);
  s.Area = { 0, 0, size, size };
  s.Samples = samples;
  s.Tracer.Scene = s.Built.get();
  if (s.Source->Cameras.empty())
    s.Tracer.View = Camera::Framing(s.Built->Lower, s.Built->Upper, s.Built->Origin(), size, size);
  else
  {
    const CameraModel& c = s.Source->Cameras.front();
    const Mat4 m = c.Node >= 0 ? s.Built->NodeMatrix(c.Node, false) : c.WorldFromCamera;
    s.Tracer.View = Camera(c, m, s.Built->Origin(), size, size);
  }
  s.Tracer.PreviousView = s.Tracer.View;
  s.Tracer.MaximumBounces = bounces;
  s.Tracer.SamplesPerPixel = samples;
  return s;
}

struct Seconds
{
  double Wall = 0, Cpu = 0;
};

/// body(tile index) for all tiles, on `threads` threads that take the next tile.
template <class Body>
Seconds OverTiles(int count, int threads, const Body& body)
{
  std::atomic<int> next{ 0 };
  std::atomic<std::int64_t> cpu{ 0 };
  const auto work = [&]
  {
    const double start = ThreadSeconds();
    for (int i = next++; i < count; i = next++)
      body(i);
    cpu += std::int64_t(1e9 * (ThreadSeconds() - start));
  };
  timespec t0, t1;
  clock_gettime(CLOCK_MONOTONIC, &t0);
  std::vector<std::thread> pool;
  for (int t = 1; t < threads; ++t)
    pool.emplace_back(work);
  work();
  for (std::thread& t : pool)
    t.join();
  clock_gettime(CLOCK_MONOTONIC, &t1);
  return { double(t1.tv_sec - t0.tv_sec) + 1e-9 * double(t1.tv_nsec - t0.tv_nsec), 1e-9 * double(cpu) };
}

struct Measured
{
  double Traced = 0, Replayed = 0;       ///< seconds of wall clock, medians
  double TracedCpu = 0, ReplayedCpu = 0; ///< seconds of all threads
  double Spread = 0;
  std::int64_t Rays = 0, Paths = 0;
};

Rect Tile(const Stage& s, int i)
{
  const int columns = (s.Area.width() + TileSize - 1) / TileSize;
  const int x = i % columns * TileSize, y = i / columns * TileSize;
  return { x, y, std::min(s.Area.x1, x + TileSize), std::min(s.Area.y1, y + TileSize) };
}
int Tiles(const Stage& s)
{
  return (s.Area.width() + TileSize - 1) / TileSize * ((s.Area.height() + TileSize - 1) / TileSize);
}

Seconds Trace(const Stage& s, const std::set<std::string>& wanted, int threads, TraceCounters* sum = nullptr)
{
  Film film(s.Area, wanted);
  std::vector<TraceCounters> counters(std::size_t(Tiles(s)));
  const Seconds t = OverTiles(
    Tiles(s), threads, [&](int i) { s.Tracer.Render(film, Tile(s, i), 0, s.Samples, counters[std::size_t(i)]); });
  if (sum)
    for (const TraceCounters& c : counters)
    {
      sum->Rays += c.Rays;
      sum->Paths += c.Paths;
    }
  return t;
}

/// The arrays that a filter of one frame reads, traced with one sample a pixel.
struct Developed
{
  explicit Developed(const Rect& area)
  {
    for (const auto& [name, components] : { std::make_pair("direct", 3), { "indirect", 3 }, { "emission", 3 },
           { "albedo", 3 }, { "normal", 3 }, { "depth", 1 }, { "motion", 2 }, { "id", 1 } })
    {
      this->Pixels.emplace_back(std::size_t(area.area()) * std::size_t(components));
      this->Arrays.emplace_back(name, ImageOut(this->Pixels.back().data(), components, area));
      this->Names.insert(name);
    }
  }
  void Develop(const Film& film, const Rect& tile) const
  {
    for (const auto& array : this->Arrays)
      film.Develop(array.first, tile, 1, array.second);
  }
  Seconds ByTiles(const Stage& s, int threads) const
  {
    return OverTiles(Tiles(s), threads,
      [&](int i)
      {
        static thread_local Film film({ 0, 0, TileSize, TileSize }, this->Names);
        TraceCounters counters;
        film.MoveTo(Tile(s, i));
        film.Clear(film.Region());
        s.Tracer.Render(film, film.Region(), 0, 1, counters);
        this->Develop(film, film.Region());
      });
  }
  /// `memory` is kept from frame to frame.
  Seconds ByFrame(const Stage& s, int threads, std::vector<double>& memory) const
  {
    Film film(s.Area, this->Names, std::move(memory));
    Seconds t = OverTiles(Tiles(s), threads,
      [&](int i)
      {
        TraceCounters counters;
        film.Clear(Tile(s, i));
        s.Tracer.Render(film, Tile(s, i), 0, 1, counters);
      });
    const Seconds developed = OverTiles(Tiles(s), threads, [&](int i) { this->Develop(film, Tile(s, i)); });
    t.Wall += developed.Wall;
    t.Cpu += developed.Cpu;
    memory = film.TakeMemory();
    return t;
  }

  std::vector<std::vector<float>> Pixels;
  std::vector<std::pair<std::string, ImageOut>> Arrays;
  std::set<std::string> Names;
};

Measured AgainstEmbree(const Bench& bench, const Stage& s, int threads)
{
  Measured m;
  const int tiles = Tiles(s);
  std::vector<std::vector<RecordedRay>> records(static_cast<std::size_t>(tiles));
  {
    Film film(s.Area, { "radiance" });
    for (int i = 0; i < tiles; ++i)
    {
      TraceCounters c;
      c.Record = &records[std::size_t(i)];
      s.Tracer.Render(film, Tile(s, i), 0, s.Samples, c);
      records[std::size_t(i)].shrink_to_fit();
    }
  }
  TraceCounters sum;
  Trace(s, { "radiance" }, threads, &sum);
  m.Rays = sum.Rays;
  m.Paths = sum.Paths;
  std::int64_t recorded = 0;
  for (const auto& r : records)
    recorded += std::int64_t(r.size());
  if (recorded != sum.Rays)
    throw std::runtime_error("recorded " + std::to_string(recorded) + " rays of " + std::to_string(sum.Rays));
  std::vector<double> tracedCpu, replayedCpu;
  std::atomic<std::int64_t> sink{ 0 };
  const auto times = bench.CompareFigures({ [&]
    {
      const Seconds t = Trace(s, { "radiance" }, threads);
      tracedCpu.push_back(t.Cpu);
      return t.Wall;
    },
    [&]
    {
      const Seconds t =
        OverTiles(tiles, threads, [&](int i) { sink += WavefrontAccess::Replay(*s.Built, records[std::size_t(i)]); });
      replayedCpu.push_back(t.Cpu);
      return t.Wall;
    } });
  const auto median = [](std::vector<double> v)
  {
    std::sort(v.begin(), v.end());
    return v[v.size() / 2];
  };
  m.Traced = times[0].Seconds;
  m.Replayed = times[1].Seconds;
  m.Spread = times[0].Spread;
  m.TracedCpu = median(tracedCpu);
  m.ReplayedCpu = median(replayedCpu);
  return m;
}

/// QUELL_BENCH_SCENE: only scenes whose name contains it.
bool Skipped(const std::string& name)
{
  const char* only = std::getenv("QUELL_BENCH_SCENE");
  return only && name.find(only) == std::string::npos;
}

void ReportAgainstEmbree(Bench& bench, const std::string& name, const std::function<Stage()>& prepare, double goal)
{
  if (Skipped(name))
    return;
  const Stage s = prepare();
  for (int threads : { 2, 1 })
  {
    const Measured m = AgainstEmbree(bench, s, threads);
    char note[160];
    std::snprintf(note, sizeof note,
      "%lld triangles, %.1f rays/path, %.2f Mpaths/s, bare %.1f Mrays/s, by thread time %.3f%s",
      static_cast<long long>(s.Built->TriangleCount), double(m.Rays) / double(m.Paths),
      double(m.Paths) / m.Traced / 1e6, double(m.Rays) / m.Replayed / 1e6, m.ReplayedCpu / m.TracedCpu,
      threads == 2 ? (", goal " + std::to_string(goal).substr(0, 4)).c_str() : "");
    bench.Report(name + (threads == 2 ? ", 2 threads" : ", 1 thread"), double(m.Rays) / m.Traced / 1e6, "Mrays/s",
      "bare Embree loop", m.Replayed / m.Traced, m.Spread, note);
  }
}

std::shared_ptr<Scene> Shared(const std::string& file)
{
  const std::string path = std::string(QUELL_SHARED_DATA) + "/" + file;
  return std::filesystem::exists(path) ? std::make_shared<Scene>(*LoadScene(path)) : nullptr;
}

/// The same geometry with plain diffuse materials and a sky where there is no light.
void MakeDiffuse(Scene& scene)
{
  for (Material& m : scene.Materials)
  {
    Material plain;
    plain.BaseColor = { .6f, .6f, .6f };
    plain.Metallic = plain.Specular = 0;
    plain.Emission = m.Emission;
    plain.DoubleSided = true;
    m = plain;
  }
}
}

QUELL_BENCHMARK("pathtrace-diffuse-vs-embree", "diffuse materials: traced rays/s against replaying them through Embree")
{
  ReportAgainstEmbree(
    bench, "diffuse box, 36", [&] { return Prepare(Box(1, false, false), 256, 4, 6); }, .5);
  ReportAgainstEmbree(
    bench, "diffuse box, 870", [&] { return Prepare(Box(5, false, false), 256, 4, 6); }, .5);
  ReportAgainstEmbree(
    bench, "diffuse waves, 110k", [&] { return Prepare(Box(57, true, false), 256, 4, 6); }, .6);
  ReportAgainstEmbree(
    bench, "diffuse waves, 510k", [&] { return Prepare(Box(122, true, false), 256, 4, 6); }, .6);
  if (auto scene = Shared("interior-living-room/living-room.gltf"))
  {
    MakeDiffuse(*scene);
    ReportAgainstEmbree(
      bench, "diffuse living room", [&] { return Prepare(scene, 256, 2, 6); }, .6);
  }
  if (auto scene = Shared("khronos-core/MetalRoughSpheresNoTextures/glTF/MetalRoughSpheresNoTextures.gltf"))
  {
    MakeDiffuse(*scene);
    scene->Sky.Present = true;
    scene->Sky.Color = Vec3f(1.f);
    ReportAgainstEmbree(
      bench, "diffuse spheres under a sky", [&] { return Prepare(scene, 256, 4, 6); }, .6);
  }
}

QUELL_BENCHMARK("pathtrace-full-vs-embree", "textures and GGX: traced rays/s against replaying them through Embree")
{
  ReportAgainstEmbree(
    bench, "textured GGX box, 36", [&] { return Prepare(Box(1, false, true), 256, 4, 6); }, .4);
  ReportAgainstEmbree(
    bench, "textured GGX waves, 110k", [&] { return Prepare(Box(57, true, true), 256, 4, 6); }, .4);
  ReportAgainstEmbree(
    bench, "textured GGX waves, 510k", [&] { return Prepare(Box(122, true, true), 256, 4, 6); }, .4);
  if (auto scene = Shared("interior-living-room/living-room.gltf"))
    ReportAgainstEmbree(
      bench, "living room as it is", [&] { return Prepare(scene, 256, 2, 6); }, .4);
  if (auto scene = Shared("khronos-core/MetalRoughSpheresNoTextures/glTF/MetalRoughSpheresNoTextures.gltf"))
  {
    scene->Sky.Present = true;
    scene->Sky.Color = Vec3f(1.f);
    ReportAgainstEmbree(
      bench, "metal-rough spheres under a sky", [&] { return Prepare(scene, 256, 4, 6); }, .4);
  }
}

QUELL_BENCHMARK("cornell-mpaths", "camera paths per second in a Cornell box of 36 triangles, up to 6 scatterings")
{
  std::vector<std::pair<std::string, std::shared_ptr<Scene>>> scenes{ { "Cornell box", Box(1, false, false) } };
  if (auto scene = Shared("cornell-mcguire/CornellBox-Original.obj"))
    scenes.push_back({ "CornellBox-Original.obj", scene });
  for (const auto& s : scenes)
  {
    const Stage stage = Prepare(s.second, 256, 16, 6);
    const double paths = 256. * 256 * 16;
    std::vector<double> cpu[2];
    const auto traced = [&](int threads)
    {
      const Seconds t = Trace(stage, { "radiance" }, threads);
      cpu[threads - 1].push_back(t.Cpu);
      return t.Wall;
    };
    const auto times = bench.CompareFigures({ [&] { return traced(2); }, [&] { return traced(1); } });
    // thread time leaves out what others take of the machine
    const auto note = [&](int threads)
    {
      std::vector<double>& c = cpu[threads - 1];
      std::sort(c.begin(), c.end());
      char text[80];
      std::snprintf(text, sizeof text, "by thread time %.3f Mpaths/s, at best %.3f",
        paths * threads / c[c.size() / 2] / 1e6, paths * threads / c.front() / 1e6);
      return std::string(text);
    };
    bench.Report(s.first + ", depth 6, 2 threads", paths / times[0].Seconds / 1e6, "Mpaths/s", "1.67 Mpaths/s",
      paths / times[0].Seconds / 1e6 / 1.67, times[0].Spread, note(2));
    bench.Report(
      s.first + ", depth 6, 1 thread", paths / times[1].Seconds / 1e6, "Mpaths/s", "", 0, times[1].Spread, note(1));
  }
}

QUELL_BENCHMARK("pathtrace-omissions", "what each omission buys: the same picture, traced with and without it")
{
  using Variant = Integrator::Variant;
  using Run = std::function<Seconds()>;
  const auto compare =
    [&](const std::string& name, double paths, const Run& lean, const std::string& other, const Run& full)
  {
    std::vector<double> cpu[2];
    const auto timed = [](const Run& run, std::vector<double>& sum)
    {
      return [&run, &sum]
      {
        const Seconds t = run();
        sum.push_back(t.Cpu);
        return t.Wall;
      };
    };
    const auto times = bench.CompareFigures({ timed(lean, cpu[0]), timed(full, cpu[1]) });
    for (auto& c : cpu)
      std::sort(c.begin(), c.end());
    bench.Report(name, paths / times[0].Seconds / 1e6, "Mpaths/s", other, times[1].Seconds / times[0].Seconds,
      times[0].Spread,
      "by thread time " + std::to_string(cpu[1][cpu[1].size() / 2] / cpu[0][cpu[0].size() / 2]).substr(0, 5));
  };
  const auto against = [&](const std::string& name, const Stage& lean, const std::set<std::string>& leanWants,
                         const std::string& other, const Stage& full, const std::set<std::string>& fullWants)
  {
    compare(
      name, double(lean.Area.area()) * lean.Samples, [&] { return Trace(lean, leanWants, 2); }, other,
      [&] { return Trace(full, fullWants, 2); });
  };
  const std::set<std::string> radiance{ "radiance" };
  const auto forced = [](const std::shared_ptr<Scene>& scene, Variant variant)
  {
    Stage s = Prepare(scene, 192, 4, 6);
    s.Tracer.Force = variant;
    return s;
  };
  const auto diffuse = Box(1, false, false), full = Box(1, false, true), many = Box(57, true, false);
  const Stage lean = forced(diffuse, Variant::Auto);
  against("diffuse box, variant diffuse", lean, radiance, "variant opaque", forced(diffuse, Variant::Opaque), radiance);
  against(
    "diffuse box, variant diffuse", lean, radiance, "variant general", forced(diffuse, Variant::General), radiance);
  against("diffuse waves 110k, variant diffuse", forced(many, Variant::Auto), radiance, "variant general",
    forced(many, Variant::General), radiance);
  against("textured GGX box, variant opaque", forced(full, Variant::Auto), radiance, "variant general",
    forced(full, Variant::General), radiance);
  against("textured GGX box, in vectors", forced(full, Variant::Auto), radiance, "vertex by vertex",
    forced(full, Variant::OneByOne), radiance);
  // glass and clearcoats are shaded one by one
  auto coated = std::make_shared<Scene>(*full);
  coated->Materials[1].Clearcoat = 1;
  against("textured GGX box, no clearcoat", forced(full, Variant::Auto), radiance, "one of five faces coated",
    forced(coated, Variant::Auto), radiance);
  auto open = std::make_shared<Scene>(*diffuse), image = std::make_shared<Scene>(*diffuse);
  for (Material& m : open->Materials)
    m.Emission = Vec3f();
  open->Sky.Present = true;
  open->Sky.Color = Vec3f(1.f);
  *image = *open;
  image->Sky.Texture = int(image->Textures.size());
  image->Textures.push_back(Noise(true, 5, 20, 255));
  against("diffuse box, no sky but a lamp", lean, radiance, "a constant sky", forced(open, Variant::Auto), radiance);
  against("diffuse box, constant sky", forced(open, Variant::Auto), radiance, "an image of the sky",
    forced(image, Variant::Auto), radiance);
  // a see-through material on one face asks for a filter in Embree and for keys
  auto sheet = std::make_shared<Scene>(*full);
  sheet->Materials[1].Mode = AlphaMode::Mask;
  against("textured GGX box, nothing see-through", forced(full, Variant::Auto), radiance, "one face alpha-tested",
    forced(sheet, Variant::Auto), radiance);
  auto plain = std::make_shared<Scene>(*full);
  for (Material& m : plain->Materials)
    m.BaseColorTexture.Texture = m.MetallicRoughnessTexture.Texture = m.NormalTexture.Texture = -1;
  against("GGX box, no textures", forced(plain, Variant::Auto), radiance, "three textures", forced(full, Variant::Auto),
    radiance);
  against("diffuse box, no glossy material", lean, radiance, "GGX", forced(plain, Variant::Auto), radiance);
  against("direct light alone", lean, { "direct" }, "radiance", lean, radiance);
  against("guides alone", lean, { "albedo", "normal" }, "radiance", lean, radiance);
  against("primary hits alone", lean, { "depth", "motion", "id" }, "radiance", lean, radiance);
  against("radiance alone", lean, radiance, "every layer and guide", lean,
    { "radiance", "emission", "direct", "indirect", "directDiffuse", "indirectDiffuse", "bounce1", "bounce2", "albedo",
      "normal", "depth", "position", "motion", "variance" });
  Stage guided = Prepare(full, 192, 1, 6);
  Stage clean = Prepare(full, 192, 1, 6);
  clean.Tracer.GuideSamples = 16;
  against("guides of 1 light sample", guided, { "radiance", "albedo", "normal" }, "16 guide samples", clean,
    { "radiance", "albedo", "normal" });

  // Small scenes and what moves: no hierarchy, one, or a second one for the block that moves.
  EmbreeScene::Options asks, instances;
  asks.TestAll = instances.TestAll = false;
  instances.RebuiltTriangles = 0;
  const auto hierarchies = [&](const std::string& name, const std::shared_ptr<const Scene>& scene)
  {
    const Stage all = Prepare(scene, 192, 4, 6);
    if (all.Built->TestedTriangles() == 0)
      throw std::runtime_error(name + " is too large to test all its triangles");
    against(name + ", all " + std::to_string(all.Built->TestedTriangles()) + " triangles tested", all, radiance,
      "a hierarchy asked", Prepare(scene, 192, 4, 6, asks), radiance);
  };
  hierarchies("diffuse box", diffuse);
  if (auto scene = Shared("cornell-mcguire/CornellBox-Original.obj"))
    hierarchies("CornellBox-Original.obj", scene);
  const std::shared_ptr<const Scene> moving = LoadScene(QUELL_SOURCE_DIR "/Data/Scenes/cornell-box-moving.gltf");
  hierarchies("moving Cornell box", moving);
  const Stage rebuilt = Prepare(moving, 192, 4, 6, asks);
  against("moving Cornell box, one hierarchy for each pose", rebuilt, radiance, "what moves in a second one",
    Prepare(moving, 192, 4, 6, instances), radiance);
  // A frame of one sample: what its arrays take goes through sums of a tile, or of the frame.
  const Stage frame = Prepare(moving, 512, 1, 6), slow = Prepare(moving, 512, 1, 6, instances);
  const Developed made(frame.Area);
  std::vector<double> memory;
  const auto byTiles = [&] { return made.ByTiles(frame, 2); };
  compare("moving Cornell box, 1 sample, sums of a tile", double(frame.Area.area()), byTiles, "sums of the frame",
    [&] { return made.ByFrame(frame, 2, memory); });
  compare("moving Cornell box, 1 sample, all three", double(frame.Area.area()), byTiles, "none of them",
    [&] { return made.ByFrame(slow, 2, memory); });
}

QUELL_BENCHMARK("pathtrace-memory", "bytes per pixel of the film")
{
  const Rect area{ 0, 0, 64, 64 };
  const auto bytes = [&](const std::set<std::string>& wanted) { return double(Film(area, wanted).BytesPerPixel()); };
  const double radiance = bytes({ "radiance" });
  bench.Report("film, radiance alone", radiance, "bytes/pixel", "64 bytes", radiance / 64);
  bench.Report("film, radiance, albedo, normal, depth, motion",
    bytes({ "radiance", "albedo", "normal", "depth", "motion" }), "bytes/pixel");
  bench.Report("wavefront of a thread, on its stack", double(Integrator::ScratchBytes()) / 1024, "KiB");
}
