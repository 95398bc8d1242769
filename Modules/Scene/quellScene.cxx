// SPDX-License-Identifier: BSD-3-Clause
#include "quellScene.h"

#include "quellSceneFiles.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <new>

namespace quell
{
static std::string Extension(const std::string& file)
{
  const std::size_t dot = file.find_last_of('.'), slash = file.find_last_of('/');
  if (dot == std::string::npos || (slash != std::string::npos && dot < slash))
    return "";
  std::string e = file.substr(dot);
  std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return e;
}

std::shared_ptr<const Scene> LoadScene(const std::string& file, const SceneOptions& options)
{
  auto scene = std::make_shared<Scene>();
  scene->File = file;
  const detail::SceneMemory memory(file);
  try
  {
    const std::string extension = Extension(file);
    if (extension != ".gltf" && extension != ".glb" && extension != ".obj")
      detail::Fail(file, "", "scenes of type \"" + extension + "\" are not supported", "use .gltf, .glb or .obj");
    detail::Bytes content;
    std::string reason;
    if (!detail::ReadFile(file, content, reason))
      detail::Fail(file, "", "the scene cannot be read: " + reason, "correct the path");
    detail::ContentHash hash;
    hash.Add(content.data(), content.size());
    if (extension != ".obj")
      detail::ReadGltf(*scene, content, hash, options.Animation);
    else if (options.Animation.empty())
      detail::ReadObj(*scene, content, hash);
    else
      detail::Fail(file, "", "no animation \"" + options.Animation + "\": OBJ files have none", "leave it empty");
    detail::CheckLights(*scene);
    if (scene->Instances.empty())
      detail::Warn(*scene, "", "the scene has no triangles", "check that the right file or scene was exported");
    scene->Hash = hash.Hexadecimal();
  }
  catch (const SceneError&)
  {
    throw;
  }
  catch (const std::bad_alloc&)
  {
    detail::Fail(file, "", "the scene needs more memory than there is", "use a smaller scene");
  }
  catch (const std::exception& e)
  {
    detail::Fail(file, "", std::string("the scene cannot be read: ") + e.what(), "export the file again");
  }
  return scene;
}

void LoadEnvironment(Scene& scene, const std::string& file, float scale)
{
  if (!(scale >= 0) || !std::isfinite(scale))
    detail::Fail(file, "", "the scale of an environment must be finite and not negative", "correct the scale");
  const detail::SceneMemory memory(file);
  Texture image;
  std::string reason;
  std::string repairs;
  if (!detail::LoadSky(file, image, repairs, reason))
    detail::Fail(file, "", "the environment cannot be read: " + reason, "name a latitude-longitude image");
  if (!repairs.empty())
    detail::Warn(scene, "environment \"" + file + "\"", repairs, "repair the image");
  scene.Sky.Present = true;
  scene.Sky.Color = Vec3f(scale);
  scene.Sky.Texture = int(scene.Textures.size());
  scene.Textures.push_back(std::move(image));
}

bool Scene::HasLight() const
{
  if (this->Sky.Present)
    return true;
  for (const PunctualLight& light : this->Lights)
    if (MaxComponent(light.Intensity) > 0)
      return true;
  bool unlit = true;
  for (const Instance& instance : this->Instances)
  {
    const Material& m = this->Materials[this->Meshes[instance.Mesh].Material];
    if (!m.Unlit && MaxComponent(m.Emission) > 0)
      return true;
    unlit &= m.Unlit;
  }
  return unlit;
}

void AddStudioSky(Scene& scene)
{
  constexpr double pi = 3.14159265358979323846;
  Texture image;
  image.Name = "studio";
  image.Width = 128;
  image.Height = 64;
  image.WrapT = Wrap::Clamp;
  std::vector<double> values(std::size_t(image.Width) * image.Height);
  const Vec3d key = Normalized(Vec3d(0.6, 0.8, 0.7));
  double irradiance = 0; // on a plane that faces up
  for (int y = 0; y < image.Height; ++y)
  {
    const double theta = pi * (y + 0.5) / image.Height, up = std::cos(theta);
    const double area = std::sin(theta) * (pi / image.Height) * (2 * pi / image.Width);
    for (int x = 0; x < image.Width; ++x)
    {
      const double phi = 2 * pi * ((x + 0.5) / image.Width - 0.5);
      const Vec3d d(std::sin(theta) * std::sin(phi), up, -std::sin(theta) * std::cos(phi));
      const double value = 0.4 + 0.3 * up + 6 * std::exp(14 * (Dot(d, key) - 1));
      values[std::size_t(y) * image.Width + x] = value;
      irradiance += value * std::max(0., up) * area;
    }
  }
  image.Floats.reserve(4 * values.size());
  for (const double value : values)
  {
    const float v = float(value * pi / irradiance);
    image.Floats.insert(image.Floats.end(), { v, v, v, 1.f });
  }
  scene.Sky.Present = true;
  scene.Sky.Color = Vec3f(1);
  scene.Sky.Texture = int(scene.Textures.size());
  scene.Textures.push_back(std::move(image));
}
}
