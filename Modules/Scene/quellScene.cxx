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

std::shared_ptr<const Scene> LoadScene(const std::string& file)
{
  auto scene = std::make_shared<Scene>();
  scene->File = file;
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
    if (extension == ".obj")
      detail::ReadObj(*scene, content, hash);
    else
      detail::ReadGltf(*scene, content, hash);
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
  Texture image;
  std::string reason;
  std::size_t repaired = 0;
  if (!detail::LoadSky(file, image, repaired, reason))
    detail::Fail(file, "", "the environment cannot be read: " + reason, "name a latitude-longitude image");
  if (repaired > 0)
    detail::Warn(scene, "environment \"" + file + "\"",
      std::to_string(repaired) + " value(s) are negative or not finite and became 0", "repair the image");
  scene.Sky.Present = true;
  scene.Sky.Color = Vec3f(scale);
  scene.Sky.Texture = int(scene.Textures.size());
  scene.Textures.push_back(std::move(image));
}
}
